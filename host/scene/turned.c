/* Photos whose EXIF data tell viewers to turn them. COLMAP, OpenSfM, nerfstudio and instant-ngp
 * read pixels as they are stored, so poses belong to these, and so does this program. Where only
 * the turned picture has the shape of its camera, poses were made from turned pixels, and they are
 * turned here, too. Mirrors and half turns keep the shape: they follow the other photos. */
#include "scene/build.h"

#include <math.h>
#include "scene/inspect.h"

bool cln_camera_has_shape(const cln_camera *camera, int width, int height)
{
    return camera->width > 0 && camera->height > 0 &&
           fabs((double)camera->width * height - (double)camera->height * width) <=
               fmax(camera->width, camera->height) + fmax(width, height);
}

/* By the sizes of a photo that EXIF turns by a quarter: 1: turned, -1: as stored, 0: both fit, or
 * none. */
static int told_by_size(const cln_view *v)
{
    const bool stored = cln_camera_has_shape(&v->camera, v->file_width, v->file_height);
    const bool turned = cln_camera_has_shape(&v->camera, v->file_height, v->file_width);

    return v->orientation < 5 || v->sized_by_file || stored == turned ? 0 : turned ? 1 : -1;
}

void cln_scene_find_turns(cln_scene *scene)
{
    bool turned = false, stored = scene->stored_poses;

    for (int i = 0; i < scene->view_count; i++) {
        turned |= told_by_size(&scene->views[i]) > 0;
        stored |= told_by_size(&scene->views[i]) < 0;
    }
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];
        const int told = told_by_size(v), width = v->file_width;

        if (v->orientation == 1)
            continue;
        v->turn_known = told || turned || stored;
        v->turned = told ? told > 0 : turned && !stored;
        if (v->turned && v->orientation >= 5) {
            v->file_width = v->file_height;
            v->file_height = width;
        }
    }
}

/* Adds a finding, `before` and `after` the number and first name of those photos with an EXIF
 * orientation that are turned or not, and known to belong so or not. */
static void tell(const cln_scene *scene, json_t *findings, bool known, bool turned,
                 const char *before, const char *after)
{
    json_t *names = json_array();

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (v->orientation > 1 && v->turn_known == known && v->turned == turned)
            json_array_append_new(names, json_string(v->name));
    }
    if (json_array_size(names) > 0)
        cln_found_fault(findings, "orientation", false, json_incref(names),
                        "%s %d photos ('%s'%s)%s", before, (int)json_array_size(names),
                        json_string_value(json_array_get(names, 0)),
                        json_array_size(names) > 1 ? ", ..." : "", after);
    json_decref(names);
}

void cln_scene_doubt_turns(const cln_scene *scene, json_t *findings)
{
    tell(scene, findings, false, false, "EXIF data tell viewers to turn",
         ", and nothing tells whether the poses are of turned pixels: they are taken as stored, as "
         "COLMAP, nerfstudio and instant-ngp do. If the poses are of turned ones, turn the pixels "
         "(mogrify -auto-orient)");
}

void cln_scene_tell_turns(const cln_scene *scene, json_t *findings)
{
    tell(scene, findings, true, false, "EXIF data tell viewers to turn",
         ": their pixels are taken as stored, as the poses are of these");
    tell(scene, findings, true, true, "turned as EXIF data say: pixels of",
         ", as the poses are of turned ones");
}
