/* Rays of a forward space (normalised device coordinates), from the near plane to infinity: against
 * the host's maps of scene/space.h, in scenes of tiny and huge units. See extremes.h. */
#include "check/extremes_intervals.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "check/forward_scene.h"

enum { RAYS = 613, WIDTH = 160, HEIGHT = 120 };

typedef struct batch {
    cln_camera cameras[CLN_FORWARD_VIEWS];
    cln_pixel pixels[RAYS];
    float o[RAYS][4], d[RAYS][4], out[RAYS][4];
    cln_sample samples[RAYS];
    uint32_t starts[RAYS + 1];
    double depths[RAYS];
    cln_ray_result results[RAYS];
} batch;

static cln_status shoot(cln_pipeline *p, const cln_space *space, batch *b)
{
    for (int v = 0; v < CLN_FORWARD_VIEWS; v++) {
        cln_check_forward_camera(v, space, WIDTH, HEIGHT, &b->cameras[v]);
        if (p->lenses)
            b->cameras[v].k1 = 0.05 * (v - 1);
    }
    for (uint32_t r = 0; r < RAYS; r++) {
        b->pixels[r] = (cln_pixel){.view = r % CLN_FORWARD_VIEWS};
        b->pixels[r].x = (uint32_t)cln_check_uniform(81, r, 0, WIDTH);
        b->pixels[r].y = (uint32_t)cln_check_uniform(82, r, 0, HEIGHT);
    }
    return cln_extremes_shoot(p, space,
                              &(cln_extremes_shot){CLN_FORWARD_VIEWS, RAYS, b->cameras, b->pixels,
                                                   sizeof b->o, b->o, b->d});
}

/* Puts an opaque sample of known depth on each ray: compositing must give that depth. */
static cln_status check_depths(cln_checks *c, const cln_space *space, batch *b, cln_extreme *row)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;

    for (uint32_t r = 0; r < RAYS; r++) {
        const cln_camera *k = &b->cameras[b->pixels[r].view];
        double origin[3], direction[3], at[3], t = 0;

        CLN_ASSERT(
            cln_camera_ray(k, b->pixels[r].x + 0.5, b->pixels[r].y + 0.5, origin, direction));
        b->depths[r] = (double)b->o[r][3] + pow(10, cln_check_uniform(83, r, -2, 2.5));
        cln_space_depth_to_cube(space, origin, direction, b->depths[r], at);
        for (int a = 0; a < 3; a++)
            t += (at[a] - (double)b->o[r][a]) * (double)b->d[r][a];
        b->starts[r + 1] = r + 1;
        b->samples[r] = (cln_sample){.t = (float)t, .delta = 0.01f, .ray = r};
        b->out[r][3] = 1e4f;
    }
    CLN_TRY(cln_check_put(p->device, &p->sample_starts, b->starts, sizeof b->starts));
    CLN_TRY(cln_check_put(p->device, &p->samples, b->samples, sizeof b->samples));
    CLN_TRY(cln_check_put(p->device, &p->out, b->out, sizeof b->out));
    CLN_TRY(cln_check_spoil(p->device, &p->results, sizeof b->results));
    CLN_TRY(cln_stage_composite(p, RAYS, CLN_DEPTH_MEAN));
    CLN_TRY(cln_buffer_read(p->device, &p->results, 0, b->results, sizeof b->results));
    for (int r = 0; r < RAYS; r++)
        cln_extreme_meet(row, b->results[r].depth, b->depths[r], b->depths[r], 1e-4,
                         "%.3g near planes away, a unit of %g", b->depths[r], space->half / 1.5);
done:
    return st;
}

cln_status cln_extremes_forward(cln_checks *c)
{
    static const double units[] = {1e-6, 1e-3, 1, 1e3, 1e6};
    static const char range[] = "cameras before and behind the near plane, units of 1e-6 to 1e6";
    cln_status st = CLN_OK;
    cln_extreme origins = cln_extreme_row(c, "where rays begin", range);
    cln_extreme directions = cln_extreme_row(c, "directions", range);
    cln_extreme depths =
        cln_extreme_row(c, "depth", "0.01 to 300 near planes, units of 1e-6 to 1e6");
    cln_model model = {0};
    batch *b = NULL;

    CLN_TRY(cln_alloc(&b, 1, sizeof *b, "self-test"));
    for (size_t i = 0; i < sizeof units / sizeof *units; i++) {
        const cln_space space = cln_check_forward_space(units[i]);

        CLN_TRY(shoot(c->p, &space, b));
        for (int r = 0; r < RAYS; r++) {
            const cln_pixel *pixel = &b->pixels[r];
            double origin[3], direction[3], o[3], d[3];

            CLN_ASSERT(cln_camera_ray(&b->cameras[pixel->view], pixel->x + 0.5, pixel->y + 0.5,
                                      origin, direction));
            cln_space_ray_to_cube(&space, origin, direction, o, d);
            for (int a = 0; a < 3; a++) {
                cln_extreme_meet(&origins, b->o[r][a], o[a], 1, 2e-6, "view %u, a unit of %g",
                                 pixel->view, units[i]);
                cln_extreme_meet(&directions, b->d[r][a], d[a], 1, 2e-6, "view %u, a unit of %g",
                                 pixel->view, units[i]);
            }
        }
        CLN_TRY(check_depths(c, &space, b, &depths));
    }
    cln_extreme_report(&origins);
    cln_extreme_report(&directions);
    cln_extreme_report(&depths);
    CLN_TRY(cln_extreme_tree(c, &model));
    CLN_TRY(cln_check_put(c->p->device, &c->p->ray_o, b->o, sizeof b->o));
    CLN_TRY(cln_check_put(c->p->device, &c->p->ray_d, b->d, sizeof b->d));
    CLN_TRY(cln_extreme_chords(c, &model.tree, RAYS, "rays from the near plane to infinity"));
done:
    cln_model_free(&model);
    free(b);
    return st;
}
