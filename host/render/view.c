/* A view in batches of rays, top to bottom. See view.h. */
#include "render/view.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "pipeline/plan.h"
#include "render/ray_batch.h"

void cln_picture_free(cln_picture *picture)
{
    free(picture->rgb);
    free(picture->depth);
    free(picture->opacity);
    memset(picture, 0, sizeof *picture);
}

cln_status cln_render_prepare(cln_pipeline *p)
{
    return cln_stage_picture_densities(p);
}

void cln_render_release(cln_pipeline *p)
{
    cln_stage_picture_release(p);
}

cln_status cln_render_view(cln_pipeline *p, int view, const float background[3], bool axis_depth,
                           const cln_callbacks *callbacks, cln_picture *out)
{
    cln_status st = CLN_OK;
    const cln_device_camera *camera = &p->host_cameras[view];
    const int width = camera->width, total = camera->width * camera->height;
    const int most =
        p->max_rays > 0 && p->max_rays < CLN_RENDER_RAYS ? p->max_rays : CLN_RENDER_RAYS;
    cln_pixel *pixels = NULL;
    cln_ray_result *results = NULL;
    float(*backgrounds)[4] = NULL;
    cln_ray_batch batch = {.axis_depth = axis_depth, .sampling = cln_render_sampling(p)};

    memset(out, 0, sizeof *out);
    out->width = width;
    out->height = camera->height;
    CLN_TRY(cln_alloc(&out->rgb, (size_t)total * 3, sizeof *out->rgb, "picture"));
    CLN_TRY(cln_alloc(&out->depth, (size_t)total, sizeof *out->depth, "picture"));
    CLN_TRY(cln_alloc(&out->opacity, (size_t)total, sizeof *out->opacity, "picture"));
    CLN_TRY(cln_alloc(&pixels, (size_t)most, sizeof *pixels, "ray batch"));
    CLN_TRY(cln_alloc(&results, (size_t)most, sizeof *results, "ray batch"));
    CLN_TRY(cln_alloc(&backgrounds, (size_t)most, sizeof *backgrounds, "ray batch"));
    batch.pixels = pixels;
    batch.backgrounds = (const float(*)[4])backgrounds;
    for (int i = 0; i < most; i++)
        memcpy(backgrounds[i], background, 3 * sizeof(float));
    for (int first = 0, done_rays = 0; first < total; first += done_rays) {
        const int n = total - first < most ? total - first : most;
        const int signal =
            callbacks && callbacks->interrupted ? callbacks->interrupted(callbacks->user) : 0;

        if (signal == SIGINT || signal == SIGTERM) {
            st = cln_fail(signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal");
            goto done;
        }
        for (int i = 0; i < n; i++)
            pixels[i] = (cln_pixel){.view = (cln_u32)view,
                                    .x = (cln_u32)((first + i) % width),
                                    .y = (cln_u32)((first + i) / width)};
        batch.n = n;
        CLN_TRY(cln_render_rays(p, &batch, results, &done_rays));
        for (int i = 0; i < done_rays; i++) {
            const cln_ray_result *r = &results[i];

            out->rgb[3 * (first + i)] = r->r;
            out->rgb[3 * (first + i) + 1] = r->g;
            out->rgb[3 * (first + i) + 2] = r->b;
            out->depth[first + i] = r->depth;
            out->opacity[first + i] = r->opacity;
        }
    }
done:
    if (st != CLN_OK) { /* the queue may still have to do with these arrays */
        (void)cln_device_finish(p->device);
        cln_picture_free(out);
    }
    free(pixels);
    free(results);
    free(backgrounds);
    return st;
}
