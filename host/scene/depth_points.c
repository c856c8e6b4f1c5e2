/* Points on surfaces from depth images, where a dataset has no others: they say where the scene is.
 * A grid of pixels of each; what is unsure, or farther than sensors see, is left out. Depths are
 * along the optical axis. No loss is made of them. */
#include <math.h>
#include <stdlib.h>
#include "base/files.h"
#include "base/log.h"
#include "io/image.h"
#include "scene/dataset.h"

enum {
    ACROSS = 12,     /* points of an image along its longer side */
    SURE = 255,      /* confidence */
    UNKNOWN = 65535, /* of the sky, or where nothing came back; as 0 is */
};
static const double STEEPEST = 0.1; /* cosine to the optical axis */

typedef struct grid {
    int width, height;
    bool deep;
    uint16_t *values; /* [height][width]; NULL: there is none */
} grid;

/* A file that is not there, or cannot be read, is none. */
static cln_status read_grid(const char *file, grid *out)
{
    cln_status st = CLN_OK;

    *out = (grid){0};
    if (!file)
        return CLN_OK;
    st = cln_image_load_grey(file, &out->width, &out->height, &out->deep, &out->values);
    if (st != CLN_INPUT)
        return st;
    cln_clear_error();
    return CLN_OK;
}

static cln_status add_point(const cln_camera *camera, double u, double v, double depth,
                            cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_point *point = NULL;
    double o[3], d[3], along = 0;

    if (!cln_camera_ray(camera, u, v, o, d))
        return CLN_OK;
    for (int a = 0; a < 3; a++)
        along += d[a] * camera->c2w[4 * a + 2];
    if (!(along > STEEPEST) || !isfinite(o[0] + o[1] + o[2])) /* poses are checked later */
        return CLN_OK;
    CLN_TRY(cln_dataset_grow(&result->points, result->point_count, sizeof *point,
                             "points of depth images"));
    point = &result->points[result->point_count++];
    *point = (cln_point){0};
    result->depth_points = true;
    for (int a = 0; a < 3; a++)
        point->xyz[a] = o[a] + d[a] * depth / along;
done:
    return st;
}

cln_status cln_dataset_depth_points(const cln_view *view, const cln_depth_image *image,
                                    cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &view->camera;
    grid depth = {0}, sure = {0};
    int step = 1;
    bool rated = false;

    if (!image->depth || !cln_is_file(image->depth))
        return CLN_OK;
    result->depth_images++;
    CLN_TRY(read_grid(image->depth, &depth));
    if (!depth.values || !depth.deep || c->width < 1 || c->height < 1)
        goto done;
    CLN_TRY(read_grid(image->confidence, &sure));
    rated = sure.values && sure.width == depth.width && sure.height == depth.height;
    step = (depth.width > depth.height ? depth.width : depth.height) / ACROSS;
    step = step > 1 ? step : 1;
    for (int y = step / 2; y < depth.height; y += step)
        for (int x = step / 2; x < depth.width; x += step) {
            const size_t at = (size_t)y * (size_t)depth.width + (size_t)x;
            const double z = depth.values[at] * image->unit;

            if (z > 0 && z <= image->most && isfinite(z) && depth.values[at] < UNKNOWN &&
                !(rated && sure.values[at] < SURE))
                CLN_TRY(add_point(c, (x + 0.5) / depth.width * c->width,
                                  (y + 0.5) / depth.height * c->height, z, result));
        }
done:
    free(depth.values);
    free(sure.values);
    return st;
}

void cln_dataset_tell_depths(const char *where, const cln_reader_result *result)
{
    if (result->depth_images > 0 && !result->depth_points)
        cln_info(
            "%s: its depth images tell nothing of where the scene is: none of the %d that were "
            "looked at is a grey PNG of 16 bits with depths that are known and sure",
            where, result->depth_images);
}
