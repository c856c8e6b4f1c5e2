/* Stage 1 by splatting at extremes: cached samples in the views of far, near, narrow and wide
 * cameras, images of one row or pixel, densities of all sizes. Each entry of the lists is compared
 * with the float64 camera, and rays' optical depths with the lists. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "reference/reference.h"

enum {
    N1 = 4,
    CELLS = N1 * N1 * N1,
    LEAVES = 8,
    ALL = LEAVES * CELLS,
    FIELDS = 6,
    NEAR = 4,
    IMAGES = 3,
    VIEWS = CLN_EXTREMES_FAR + FIELDS + NEAR + IMAGES,
    EACH = 24, /* rays of a view */
    RAYS = VIEWS * EACH
};
static const double spacing = 1.0 / N1; /* leaves of level 1 */

typedef struct scene {
    cln_model model;
    const cln_space *space;
    cln_camera cameras[VIEWS];
    cln_pixel pixels[RAYS];
    float (*boxes)[4];
    /* the device's lists */
    uint32_t lists, entries, levels;
    cln_grid *grids; /* [view][level] */
    uint64_t *keys;
    uint32_t *values, *start, *count;
    float *t, *sigma;
} scene;

static void free_lists(scene *s)
{
    free(s->grids);
    free(s->keys);
    free(s->values);
    free(s->start);
    free(s->count);
    free(s->t);
    free(s->sigma);
    s->grids = NULL;
    s->keys = NULL;
    s->values = s->start = s->count = NULL;
    s->t = s->sigma = NULL;
}

/* ---- input ---- */

static double density_of(int i, double least)
{
    const uint32_t draw = (uint32_t)i;

    switch (i / CELLS) {
    case 0:
        return 0;
    case 1:
        return pow(10, cln_check_uniform(121, draw, -36, -20));
    case 2:
        return 1;
    case 3:
        return 1e4 * exp(70);
    case 4:
        return pow(10, cln_check_uniform(121, draw, -30, 34));
    case 5:
        return i % 7 ? 1e-9 : 1e30;
    case 6: /* on the edge of what is left out, and a last bit beside it */
        return least / spacing * (1 + (i % 3 - 1) / 128.0);
    default:
        return cln_check_uniform(121, draw, 0, 5);
    }
}

static void make_cameras(scene *s)
{
    static const double degrees[FIELDS] = {0.01, 1, 60, 120, 160, 170};
    /* on a face of the cube, in a corner of leaves, at a cell's centre, in a leaf */
    static const double places[NEAR][3] = {
        {0, 0, -1}, {0, 0, 0}, {0.125, 0.375, -0.125}, {0.31, -0.27, 0.17}};
    static const int sizes[IMAGES][2] = {{1, 1}, {1, 100000}, {100000, 1}};
    const cln_space *space = s->space;
    cln_camera *c = s->cameras;

    for (int i = 0; i < CLN_EXTREMES_FAR; i++)
        cln_extremes_far(i, space, c++);
    for (int i = 0; i < FIELDS; i++, c++) {
        cln_extremes_camera(i % 2 ? i : 0, space, 3, 0, c);
        c->width = c->height = 512;
        c->fx = c->fy = 256 / tan(degrees[i] * M_PI / 360);
    }
    for (int i = 0; i < NEAR; i++, c++) {
        cln_extremes_camera(i == 3, space, 0, 0, c);
        for (int a = 0; a < 3; a++)
            c->c2w[4 * a + 3] = space->centre[a] + space->half * places[i][a];
        c->width = 150;
        c->height = 131;
        c->fx = c->fy = 140;
    }
    for (int i = 0; i < IMAGES; i++, c++) {
        cln_extremes_camera(i, space, 3, 0, c);
        c->width = sizes[i][0];
        c->height = sizes[i][1];
        c->fx = c->width;
        c->fy = c->height;
    }
    for (int v = CLN_EXTREMES_FAR; v < VIEWS; v++) {
        s->cameras[v].cx = s->cameras[v].width / 2.0;
        s->cameras[v].cy = s->cameras[v].height / 2.0;
    }
}

static cln_status make_scene(cln_pipeline *p, scene *s)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_model_create(&p->config, &s->model));
    CLN_ASSERT(s->model.tree.leaf_count == LEAVES && p->config.n1 == N1);
    CLN_TRY(cln_octree_boxes(&s->model.tree, (float **)&s->boxes));
    for (int i = 0; i < ALL; i++)
        s->model.density[i] =
            ref_to_bf16((float)density_of(i, fmax(p->config.splat_min_alpha, 0x1p-13)));
    CLN_TRY(cln_pipeline_upload(p, &s->model, false));
done:
    return st;
}

/* In order of view, then row, as splatting requires. */
static cln_status put_views(cln_pipeline *p, scene *s)
{
    cln_status st = CLN_OK;
    static const float white[4] = {1, 1, 1, 1}; /* read later, by the queue */
    const cln_camera *list[VIEWS];

    for (int v = 0; v < VIEWS; v++)
        list[v] = &s->cameras[v];
    for (uint32_t r = 0; r < RAYS; r++) {
        const cln_camera *c = &s->cameras[r / EACH];

        s->pixels[r] = (cln_pixel){.view = r / EACH, .spot = r / EACH};
        s->pixels[r].x = (uint32_t)cln_check_uniform(122, r, 0, c->width);
        s->pixels[r].y = r % EACH * (uint32_t)c->height / EACH;
    }
    CLN_TRY(cln_pipeline_cameras(p, list, VIEWS, s->space));
    CLN_TRY(cln_pipeline_batch(p, s->pixels, RAYS, NULL, white));
done:
    return st;
}

static cln_status read_lists(cln_pipeline *p, scene *s)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->splat_entries, lists = (size_t)p->list_total;
    const size_t grids = (size_t)(VIEWS * (p->deepest + 1));
    cln_device *device = p->device;

    s->levels = (uint32_t)p->deepest + 1;
    s->lists = (uint32_t)lists;
    s->entries = (uint32_t)n;
    CLN_TRY(cln_alloc(&s->grids, grids, sizeof *s->grids, "self-test"));
    CLN_TRY(cln_alloc(&s->keys, n, sizeof *s->keys, "self-test"));
    CLN_TRY(cln_alloc(&s->values, n, sizeof *s->values, "self-test"));
    CLN_TRY(cln_alloc(&s->start, lists + 1, sizeof *s->start, "self-test"));
    CLN_TRY(cln_alloc(&s->count, lists, sizeof *s->count, "self-test"));
    CLN_TRY(cln_alloc(&s->t, n, sizeof *s->t, "self-test"));
    CLN_TRY(cln_alloc(&s->sigma, n, sizeof *s->sigma, "self-test"));
    CLN_TRY(cln_buffer_read(device, &p->grids, 0, s->grids, grids * sizeof *s->grids));
    CLN_TRY(cln_buffer_read(device, &p->keys64[0], 0, s->keys, n * sizeof *s->keys));
    CLN_TRY(cln_buffer_read(device, &p->values64[0], 0, s->values, n * sizeof *s->values));
    CLN_TRY(cln_buffer_read(device, &p->list_start, 0, s->start, (lists + 1) * sizeof *s->start));
    CLN_TRY(cln_buffer_read(device, &p->list_count, 0, s->count, lists * sizeof *s->count));
    CLN_TRY(cln_buffer_read(device, &p->list_t, 0, s->t, n * sizeof *s->t));
    CLN_TRY(cln_buffer_read(device, &p->list_sigma, 0, s->sigma, n * sizeof *s->sigma));
done:
    return st;
}

/* ---- projections ---- */

typedef struct rows {
    cln_extreme pixel, depth, density, lists, whole, seen, tau;
} rows;

/* A cell's centre in the cube, and in an image by the float64 camera. hair: how far from there, in
 * pixels, float32 may see it. */
typedef struct spot {
    double point[3], u, v, hair;
    bool placed;
} spot;

static spot project(const scene *s, int view, int index)
{
    const cln_camera *c = &s->cameras[view];
    const int cell = index % CELLS, at[3] = {cell % N1, cell / N1 % N1, cell / (N1 * N1)};
    double place[3], z = 0;
    spot out = {.hair = INFINITY};

    for (int a = 0; a < 3; a++)
        out.point[a] = s->boxes[index / CELLS][a] + (at[a] + 0.5) * spacing;
    cln_space_point_to_scene(s->space, out.point, place);
    out.placed = cln_camera_project(c, place, &out.u, &out.v, &z);
    z /= s->space->half;
    if (z > 1e-3) /* rounding of positions of size 1, and of the pixel's place */
        out.hair = 4e-7 * fmax(c->fx, c->fy) / z *
                       (1 + fabs(out.u - c->cx) / c->fx + fabs(out.v - c->cy) / c->fy) +
                   3e-7 * (fabs(c->cx) + fabs(c->cy) + fabs(out.u) + fabs(out.v));
    else if (z < -1e-3)
        out.hair = 0;
    return out;
}

/* How far a place is inside the side [low, high) of an image or a list; negative outside. */
static double inside(double at, double low, double high)
{
    return fmin(at - low, high - at);
}

static bool kept(const cln_config *config, const scene *s, int index)
{
    return ref_from_bf16(s->model.density[index]) * spacing >=
           (double)(float)config->splat_min_alpha;
}

/* An entry of list `list` of view and level: its place in the list's rectangle, and its depth
 * along the ray through the rectangle's middle, from where rays begin. */
static void compare_entry(const cln_pipeline *p, const scene *s, uint32_t i, int view,
                          const cln_grid *grid, rows *to)
{
    const int index = (int)s->values[i];
    const cln_camera *c = &s->cameras[view];
    const uint32_t list = (uint32_t)(s->keys[i] >> 32) - grid->first;
    const double kx = grid->coarse_x, x = list % grid->row * kx;
    const double ky = grid->coarse_y, y = list / grid->row * ky;
    const float start = p->host_cameras[view].start;
    const spot at = project(s, view, index);
    double o[3], d[3], t = 0, away = 0, distance = 0;
    const bool found = cln_camera_ray(c, x + kx / 2, y + ky / 2, o, d);
    const double ahead = c->c2w[2] * d[0] + c->c2w[6] * d[1] + c->c2w[10] * d[2];

    if (isfinite(at.hair))
        cln_extreme_meet(&to->pixel,
                         fmax(-fmin(inside(at.u, x, x + kx), inside(at.v, y, y + ky)), 0), 0,
                         at.hair, 1, "view %d, cell %d, %g pixels allowed", view, index, at.hair);
    cln_space_ray_to_cube(s->space, o, d, o, d);
    for (int a = 0; a < 3; a++) {
        t += (at.point[a] - o[a]) * d[a];
        away = hypot(away, at.point[a] - o[a]);
        distance = hypot(distance, o[a]);
    }
    t -= (double)start / ahead;
    if (found)
        cln_extreme_meet(&to->depth, s->t[i], fmax(t, 0), 1,
                         4e-6 * fmax(1, start > 0 ? 8 : away) +
                             3e-7 * (fabs(c->cx) + fabs(c->cy)) / c->fx * fmax(distance, 1),
                         "view %d, cell %d", view, index);
    cln_extreme_meet(&to->density, s->sigma[i], ref_from_bf16(s->model.density[index]), 1, 0,
                     "view %d, cell %d", view, index);
}

/* Each entry, their order, and where lists begin. met: [view][cell]. */
static void compare_lists(const cln_pipeline *p, const scene *s, uint8_t *met, rows *to)
{
    int view = 0, level = 0;
    uint32_t next = 0, wrong = 0;

    for (uint32_t i = 0; i < s->entries; i++) {
        const uint32_t list = (uint32_t)(s->keys[i] >> 32), index = s->values[i];
        const bool later = i == 0 || s->keys[i - 1] < s->keys[i] ||
                           (s->keys[i - 1] == s->keys[i] && s->values[i - 1] < index);
        const cln_grid *grid = NULL;

        for (; next <= list && next <= s->lists; next++)
            wrong += s->start[next] != i;
        while (view + 1 < VIEWS && list >= s->grids[(view + 1) * (int)s->levels].first)
            view++;
        for (level = (int)s->levels - 1; list < s->grids[view * (int)s->levels + level].first;)
            level--;
        grid = &s->grids[view * (int)s->levels + level];
        cln_extreme_meet(&to->lists, later && list < s->lists && index < ALL && level == 1, 1, 1, 0,
                         "entry %u", i);
        if (list >= s->lists || index >= ALL || level != 1)
            return;
        met[view * ALL + (int)index]++;
        compare_entry(p, s, i, view, grid, to);
    }
    for (; next <= s->lists; next++)
        wrong += s->start[next] != s->entries;
    for (uint32_t l = 0; l < s->lists; l++)
        wrong += s->count[l] != s->start[l + 1] - s->start[l];
    cln_extreme_meet(&to->lists, wrong, 0, 1, 0, "begins and lengths of %u lists", s->lists);
}

/* Whether the cell has a place in the image: 1, 0, or -1 if float32 may decide. */
static int in_image(const scene *s, int view, int index)
{
    const cln_camera *c = &s->cameras[view];
    const spot at = project(s, view, index);
    const double in = fmin(inside(at.u, 0, c->width), inside(at.v, 0, c->height));

    if (!at.placed)
        return at.hair == 0 ? 0 : -1;
    return fabs(in) <= at.hair ? -1 : in > 0;
}

/* Every cell is once in each view that sees it, unless it is too faint. */
static void compare_whole(const cln_config *config, const scene *s, const uint8_t *met, rows *to)
{
    for (int v = 0; v < VIEWS; v++)
        for (int i = 0; i < ALL; i++) {
            const int in = in_image(s, v, i), got = met[v * ALL + i];

            cln_extreme_meet(&to->whole, got,
                             !kept(config, s, i) ? 0
                             : in < 0            ? got > 0
                                                 : in,
                             1, 0, "view %d, cell %d", v, i);
        }
}

/* stats.cl, of one view at a time. */
static cln_status check_seen(cln_pipeline *p, scene *s, rows *to)
{
    cln_status st = CLN_OK;
    uint8_t seen[ALL];

    p->training_views = 1;
    for (int v = 0; v < VIEWS; v++) {
        const cln_camera *one = &s->cameras[v];

        CLN_TRY(cln_pipeline_cameras(p, &one, 1, s->space));
        CLN_TRY(cln_check_spoil(p->device, &p->seen, sizeof seen));
        CLN_TRY(cln_stage_seen(p));
        CLN_TRY(cln_buffer_read(p->device, &p->seen, 0, seen, sizeof seen));
        for (int i = 0; i < ALL; i++) {
            const int in = in_image(s, v, i);

            cln_extreme_meet(&to->seen, seen[i], in < 0 ? seen[i] > 0 : in, 1, 0,
                             "view %d, cell %d", v, i);
        }
    }
done:
    return st;
}

/* ---- optical depths ---- */

/* The lists' entries in the interval, with lengths of `share` of what they stand for. *size: sum of
 * densities times lengths of rounding. */
static double depth_of(const cln_config *config, const scene *s, const cln_interval *v, int r,
                       double share, double *size)
{
    const cln_grid *grid = &s->grids[r / EACH * (int)s->levels + 1];
    const uint32_t list =
        grid->first + s->pixels[r].y / grid->coarse_y * grid->row + s->pixels[r].x / grid->coarse_x;
    const ref_interval whole = {v->slot, v->t_in, v->t_out};
    double t[ALL], sigma[ALL], lengths[ALL];
    int m = 0;

    *size = 0;
    for (uint32_t i = s->start[list]; i < s->start[list + 1]; i++)
        if (s->t[i] >= v->t_in && s->t[i] < v->t_out) {
            t[m] = s->t[i];
            sigma[m] = s->sigma[i];
            lengths[m] = INFINITY;
            if (config->splat_min_alpha > 0)
                lengths[m] = share * fmax(grid->cell, grid->spread / fmax(t[m] * t[m], 1e-12));
            *size += 0.05 * (1 + t[m]) * sigma[m]; /* edges are rounded */
            m++;
        }
    return ref_interval_depth(&whole, (ref_points){m, t, sigma, lengths});
}

static cln_status compare_depths(cln_pipeline *p, const scene *s, rows *to)
{
    cln_status st = CLN_OK;
    const size_t most = (size_t)p->most_intervals * RAYS;
    cln_interval *all = NULL;
    uint32_t used[RAYS];

    CLN_TRY(cln_alloc(&all, most, sizeof *all, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->intervals, 0, all, most * sizeof *all));
    CLN_TRY(cln_buffer_read(p->device, &p->used, 0, used, sizeof used));
    for (int r = 0; r < RAYS; r++)
        for (uint32_t i = 0; i < used[r] && i < (uint32_t)p->most_intervals; i++) {
            const cln_interval *v = &all[i * RAYS + (uint32_t)r];
            double size = 0;
            const double want = depth_of(&p->config, s, v, r, 1, &size);
            const double less = depth_of(&p->config, s, v, r, 0.999, &size);

            /* a gap that is as long as the limit may count as one or not */
            if (fabs(want - less) > 0.002 * want) {
                cln_extreme_finite(&to->tau, v->mass, "ray %d", r);
                continue;
            }
            cln_extreme_meet(&to->tau, v->mass, want, want + size, 1e-5,
                             "view %d, leaf %d, %g to %g", r / EACH, v->slot, (double)v->t_in,
                             (double)v->t_out);
        }
done:
    free(all);
    return st;
}

/* ---- the subject ---- */

static cln_status check_space(cln_pipeline *p, scene *s, rows *to)
{
    /* leaves no interval out */
    const cln_sampling sampling = {.empty_share = 1, .max_samples = 1 << 24};
    cln_status st = CLN_OK;
    uint8_t *met = NULL;
    uint32_t samples = 0;
    int whole = 0;

    CLN_TRY(cln_alloc(&met, VIEWS * ALL, 1, "self-test"));
    make_cameras(s);
    CLN_TRY(put_views(p, s));
    CLN_TRY(cln_stage_rays(p, RAYS));
    p->max_entries = 1 << 24;
    CLN_TRY(cln_stage_sample(p, RAYS, &sampling, &whole, &samples));
    CLN_ASSERT(whole == RAYS && p->splat_entries > ALL);
    CLN_TRY(read_lists(p, s));
    compare_lists(p, s, met, to);
    compare_whole(&p->config, s, met, to);
    CLN_TRY(compare_depths(p, s, to));
    CLN_TRY(check_seen(p, s, to));
done:
    free_lists(s);
    free(met);
    return st;
}

cln_status cln_extremes_splat(cln_checks *c)
{
    static const cln_space spaces[] = {{.half = 1},
                                       {.centre = {4.5e5, 5.4e6, 120}, .half = 0.5}, /* UTM */
                                       {.centre = {2e-6, -1e-6, 0}, .half = 1e-6},
                                       {.centre = {3e6, -2e6, 1e6}, .half = 1e6}};
    static const char range[] = "cameras inside the cube to 10^6 away, 0.01 to 170 degrees, images "
                                "of 1 to 10^5 pixels";
    static const char densities[] = "densities 0, 1e-36 to 2.5e34, at the limit of faint ones";
    cln_status st = CLN_OK;
    rows to = {.pixel = cln_extreme_row(c, "distance from the list's square", range),
               .depth = cln_extreme_row(c, "depth along its ray", range),
               .density = cln_extreme_row(c, "density", densities),
               .lists = cln_extreme_row(c, "lists and their order", range),
               .whole = cln_extreme_row(c, "samples that a view has", densities),
               .seen = cln_extreme_row(c, "cells that a view sees", range),
               .tau = cln_extreme_row(c, "optical depth of intervals", densities)};
    scene *s = NULL;

    CLN_TRY(cln_alloc(&s, 1, sizeof *s, "self-test"));
    CLN_TRY(make_scene(c->p, s));
    for (size_t i = 0; i < sizeof spaces / sizeof *spaces; i++) {
        s->space = &spaces[i];
        CLN_TRY(check_space(c->p, s, &to));
    }
    cln_extreme_report(&to.pixel);
    cln_extreme_report(&to.depth);
    cln_extreme_report(&to.density);
    cln_extreme_report(&to.lists);
    cln_extreme_report(&to.whole);
    cln_extreme_report(&to.seen);
    cln_extreme_report(&to.tau);
done:
    if (s) {
        cln_model_free(&s->model);
        free(s->boxes);
    }
    free(s);
    return st;
}
