/* Reader of Agisoft Metashape's cameras (File > Export > Export Cameras, Agisoft XML): the file, or
 * a folder with it, and the photos beside it, in a folder there or in one beside that. By
 * Metashape's manual (Appendix: Camera models), with x = X / Z, y = Y / Z, r^2 = x^2 + y^2:
 *   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 x^2) + 2 p2 x y
 *   y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p2 (r^2 + 2 y^2) + 2 p1 x y
 *   u = w / 2 + cx + x' (f + b1) + y' b2, v = h / 2 + cy + y' f
 * which is OpenCV's model with p1 and p2 exchanged; of a fisheye x and y are the directions' angles
 * instead. The centre of the top-left pixel is (0.5, 0.5), as ours.
 *
 * Coordinates: a chunk with a local coordinate system keeps that; one that lies on the earth is
 * brought to metres, east, north and up from the middle of its cameras; another keeps its own
 * scale. The region, if there is one, becomes the box of the scene. */
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "scene/dataset.h"
#include "scene/metashape.h"
#include "scene/origin.h"
#include "scene/placing.h"
#include "scene/vectors.h"

static const double SKEW_TOLD = 0.3; /* pixels at the picture's edge */

enum { WHAT_BYTES = 256 };

/* ---- coordinates ---- */

/* x = scale turn chunk + shift, turn a rotation. */
typedef struct frame {
    double scale, turn[9], shift[3];
} frame;

static void to_scene(const frame *f, const double at[3], double out[3])
{
    double x[3];

    for (int i = 0; i < 3; i++)
        x[i] = f->scale * cln_dot(f->turn + 3 * i, at) + f->shift[i];
    memcpy(out, x, sizeof x);
}

/* That of the component, else of the chunk; false if there is none. */
static bool find_transform(const cln_metashape *m, int component, frame *out)
{
    const cln_metashape_transform *found = NULL;

    for (int i = 0; i < m->transform_count; i++) {
        const cln_metashape_transform *t = &m->transforms[i];

        if ((t->has_rotation || t->has_translation || t->has_scale) &&
            (t->component == component || (t->component < 0 && !found)))
            found = t;
    }
    if (!found)
        return false;
    if (found->has_rotation)
        memcpy(out->turn, found->rotation, sizeof out->turn);
    if (found->has_translation)
        memcpy(out->shift, found->translation, sizeof out->shift);
    if (found->has_scale)
        out->scale = found->scale;
    return true;
}

/* Turns earth-centred coordinates to east, north and up from this place, which becomes 0. origin:
 * its latitude and longitude. */
static void stand_on_earth(const double place[3], const double origin[3], frame *f)
{
    double axes[3][3], turn[9], shift[3];

    cln_origin_axes(origin, axes);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            turn[3 * i + j] =
                axes[i][0] * f->turn[j] + axes[i][1] * f->turn[3 + j] + axes[i][2] * f->turn[6 + j];
        shift[i] = axes[i][0] * (f->shift[0] - place[0]) + axes[i][1] * (f->shift[1] - place[1]) +
                   axes[i][2] * (f->shift[2] - place[2]);
    }
    memcpy(f->turn, turn, sizeof turn);
    memcpy(f->shift, shift, sizeof shift);
}

/* The scene's frame; what: as words. Returns whether z is up in it. */
static bool choose_frame(const cln_metashape *m, int component, char what[WHAT_BYTES], frame *out,
                         double there[3])
{
    double middle[3] = {0};
    int count = 0;

    *out = (frame){.scale = 1, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    cln_format(what, WHAT_BYTES, "coordinates and units are the chunk's own");
    if (!find_transform(m, component, out))
        return false;
    cln_format(what, WHAT_BYTES, "coordinates are the chunk's local ones");
    if (!m->reference[0] || strncmp(m->reference, "LOCAL_CS", 8) == 0)
        return false;
    for (int i = 0; i < m->camera_count; i++) {
        const cln_metashape_camera *c = &m->cameras[i];
        double at[3] = {c->pose[3], c->pose[7], c->pose[11]};

        if (!c->aligned || !c->enabled || c->component != component)
            continue;
        to_scene(out, at, at);
        for (int a = 0; a < 3; a++)
            middle[a] += at[a];
        count++;
    }
    for (int a = 0; a < 3 && count; a++)
        middle[a] /= count;
    cln_origin_of_centred(middle, there);
    cln_format(what, WHAT_BYTES,
               "coordinates are metres east, north and up from the middle of the cameras, latitude "
               "%.8f, longitude %.8f, height %.3f",
               there[0], there[1], there[2]);
    stand_on_earth(middle, there, out);
    return true;
}

/* The box around the region. */
static cln_status set_box(const cln_metashape *m, int component, const frame *f,
                          cln_reader_result *result)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    if (!m->has_region || (m->region_component >= 0 && m->region_component != component) ||
        !(m->region_size[0] > 0 && m->region_size[1] > 0 && m->region_size[2] > 0))
        return CLN_OK;
    for (int corner = 0; corner < 8; corner++) {
        double at[3];

        for (int a = 0; a < 3; a++) {
            at[a] = m->region_centre[a];
            for (int k = 0; k < 3; k++)
                at[a] +=
                    m->region_turn[3 * a + k] * m->region_size[k] * (corner >> k & 1 ? 0.5 : -0.5);
        }
        to_scene(f, at, at);
        for (int a = 0; a < 3; a++) {
            low[a] = fmin(low[a], at[a]);
            high[a] = fmax(high[a], at[a]);
        }
    }
    result->has_bounds = result->has_box = true;
    for (int a = 0; a < 3; a++) {
        result->box[a] = low[a];
        result->box[3 + a] = high[a];
        result->space.centre[a] = (low[a] + high[a]) / 2;
        result->space.half = fmax(result->space.half, (high[a] - low[a]) / 2);
    }
    return cln_strdup(&result->bounds_rule, "around the region of Metashape");
}

/* ---- cameras ---- */

static const cln_metashape_sensor *sensor_of(const cln_metashape *m, int id)
{
    for (int i = 0; i < m->sensor_count; i++)
        if (m->sensors[i].id == id)
            return &m->sensors[i];
    return NULL;
}

/* Pixels by which skew moves the picture's edge, which our cameras have not. */
static double skew_of(const cln_metashape_sensor *s)
{
    return s->f > 0 ? fabs(s->b2) * s->height / (2 * s->f) : 0;
}

static cln_status set_lens(const char *where, const cln_metashape_sensor *s, cln_camera *c)
{
    c->width = s->width;
    c->height = s->height;
    if (s->kind == CLN_METASHAPE_SPHERICAL) {
        cln_camera_span_sphere(c);
        return CLN_OK;
    }
    if (s->kind == CLN_METASHAPE_OTHER)
        return cln_fail(CLN_INPUT,
                        "%s: its sensor is neither of type frame, fisheye nor spherical; convert "
                        "the photos in Metashape (Undistort Photos) and export again",
                        where);
    if (!s->calibrated || !(s->f > 0))
        return cln_fail(CLN_INPUT, "%s: its sensor has no focal length; align the photos first",
                        where);
    if (s->p[2] != 0 || s->p[3] != 0)
        return cln_fail(CLN_INPUT,
                        "%s: its sensor has p3 or p4, which no lens model here has; fix it at 0 in "
                        "Metashape (Camera Calibration), optimise, and export again",
                        where);
    c->fx = s->f + s->b1;
    c->fy = s->f;
    c->cx = s->width / 2.0 + s->cx;
    c->cy = s->height / 2.0 + s->cy;
    if (s->kind == CLN_METASHAPE_FISHEYE) { /* k1 k2 p1 p2 k3 k4 */
        c->lens = CLN_LENS_THIN_PRISM_FISHEYE;
        c->distortion[4] = s->k[2];
        c->distortion[5] = s->k[3];
    } else if (s->k[2] != 0) { /* k1 k2 p1 p2 k3 and a denominator */
        c->lens = CLN_LENS_FULL_OPENCV;
        c->distortion[4] = s->k[2];
    } else {
        c->lens = CLN_LENS_OPENCV;
    }
    c->distortion[0] = s->k[0];
    c->distortion[1] = s->k[1];
    c->distortion[2] = s->p[1];
    c->distortion[3] = s->p[0];
    if (s->kind == CLN_METASHAPE_FRAME && s->k[3] != 0)
        return cln_camera_add_terms(c, s->k + 2, where);
    return CLN_OK;
}

/* The pose in the scene. A rotation that is none is refused later, for all formats. */
static void set_pose(const cln_metashape_camera *from, const frame *f, cln_camera *c)
{
    const double at[3] = {from->pose[3], from->pose[7], from->pose[11]};
    double out[3];

    to_scene(f, at, out);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            c->c2w[4 * i + j] = f->turn[3 * i] * from->pose[j] +
                                f->turn[3 * i + 1] * from->pose[4 + j] +
                                f->turn[3 * i + 2] * from->pose[8 + j];
        c->c2w[4 * i + 3] = out[i];
    }
}

/* The component with the most aligned cameras; -1: they have none. */
static int largest_component(const cln_metashape *m)
{
    int best = -1, most = 0;

    for (int i = 0; i < m->camera_count; i++) {
        int count = 0;

        if (!m->cameras[i].aligned || (most > 0 && m->cameras[i].component == best))
            continue;
        for (int k = i; k < m->camera_count; k++)
            count += m->cameras[k].aligned && m->cameras[k].component == m->cameras[i].component;
        if (count > most) {
            most = count;
            best = m->cameras[i].component;
        }
    }
    return best;
}

static cln_status add_views(const char *file, const cln_metashape *m, int component, const frame *f,
                            cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *where = NULL;
    double skew = 0;
    int lacking = 0, apart = 0;

    CLN_TRY(cln_alloc(&result->views, (size_t)m->camera_count, sizeof *result->views, "views"));
    for (int i = 0; i < m->camera_count; i++) {
        const cln_metashape_camera *from = &m->cameras[i];
        const cln_metashape_sensor *sensor = sensor_of(m, from->sensor);
        cln_view *view = &result->views[result->view_count];

        if (!from->aligned || !from->enabled || from->component != component) {
            lacking += !from->aligned || !from->enabled;
            apart += from->aligned && from->enabled;
            continue;
        }
        free(where);
        CLN_TRY(cln_asprintf(&where, "%s: camera '%s'", file, from->label));
        if (!sensor)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: its sensor %d is not there; export the cameras again",
                             where, from->sensor));
        result->view_count++;
        CLN_TRY(cln_dataset_name(where, from->label, &view->name));
        CLN_TRY(set_lens(where, sensor, &view->camera));
        set_pose(from, f, &view->camera);
        skew = fmax(skew, skew_of(sensor));
    }
    if (lacking)
        cln_warn("%s: %d of its %d cameras %s not aligned, or disabled, and left out", file,
                 lacking, m->camera_count, cln_plural(lacking, "is", "are"));
    if (apart)
        cln_warn("%s: %d camera%s of other components than the largest, and left out", file, apart,
                 cln_plural(apart, " is", "s are"));
    if (m->chunks > 1)
        cln_warn("%s: %d chunks have aligned cameras, only the first is read", file, m->chunks);
    if (skew > SKEW_TOLD)
        cln_warn("%s: pixels are skew (b2), by up to %.1f of them at the edge, which is left out; "
                 "fix b2 at 0 in Metashape if that matters",
                 file, skew);
done:
    free(where);
    return st;
}

/* ---- the reader ---- */

static bool is_metashape(const char *path)
{
    enum { HEAD = 4096 };
    char text[HEAD + 1];
    const char *dot = strrchr(path, '.');
    FILE *file = dot && !strcasecmp(dot, ".xml") && cln_is_file(path) ? fopen(path, "rb") : NULL;

    if (!file)
        return false;
    text[fread(text, 1, HEAD, file)] = 0;
    fclose(file);
    return strstr(text, "<chunk") != NULL;
}

/* The file, or that in the folder, the first of several by name; *out is NULL if there is none. */
static cln_status find_file(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *file = NULL;
    DIR *dir = NULL;

    *out = NULL;
    if (!cln_is_dir(path))
        return is_metashape(path) ? cln_strdup(out, path) : CLN_OK;
    dir = opendir(path);
    for (struct dirent *entry = NULL; dir && (entry = readdir(dir));) {
        const char *dot = strrchr(entry->d_name, '.');

        if (!dot || strcasecmp(dot, ".xml") != 0)
            continue;
        free(file);
        CLN_TRY(cln_path_join(&file, path, entry->d_name));
        if (is_metashape(file) && (!*out || strcmp(file, *out) < 0)) {
            free(*out);
            *out = file;
            file = NULL;
        }
    }
done:
    if (dir)
        closedir(dir);
    free(file);
    return st;
}

static bool detect(const char *path, const char **missing)
{
    char *file = NULL;
    bool found = false;

    *missing = NULL;
    if (find_file(path, &file) != CLN_OK)
        cln_clear_error();
    found = file != NULL;
    free(file);
    return found;
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_metashape m = {0};
    char *file = NULL, *folder = NULL, *around = NULL, *images = NULL, masks[64];
    char what[WHAT_BYTES];
    int component = -1;
    frame f;

    CLN_TRY(find_file(path, &file));
    CLN_TRY(cln_scene_folder(path, &folder));
    CLN_TRY(cln_metashape_read(file, &m));
    if (m.chunks == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its cameras is aligned; align the photos in Metashape, and "
                         "export the cameras again",
                         file));
    component = largest_component(&m);
    result->on_earth = choose_frame(&m, component, what, &f, result->origin);
    result->up[2] = result->on_earth;
    result->gps_distance = NAN;
    CLN_TRY(add_views(file, &m, component, &f, result));
    if (result->view_count == 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: all its aligned cameras are disabled; enable some", file));
    CLN_TRY(set_box(&m, component, &f, result));
    CLN_TRY(cln_path_join(&around, folder, ".."));
    CLN_TRY(cln_dataset_find_images(file, folder, (const char *const[1]){folder}, 1, around, result,
                                    &images));
    result->dialect = "Metashape";
    result->beyond = true;
    result->stored_poses = true;
    cln_dataset_tell_masks(result, masks);
    CLN_TRY(cln_asprintf(&result->because, "it has cameras of Metashape; %s; images are from %s%s",
                         what, cln_dataset_within(folder, images), masks));
done:
    cln_metashape_free(&m);
    free(file);
    free(folder);
    free(around);
    free(images);
    return st;
}

const cln_reader cln_reader_metashape = {
    .name = "the Metashape reader",
    .wants = "an .xml file of Metashape's cameras, or a folder with it",
    .detect = detect,
    .read = read_scene,
};
