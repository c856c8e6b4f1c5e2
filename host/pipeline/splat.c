/* Stage 1 by splatting (kernels/splat.cl): plans groups of views or bands of rows whose projected
 * samples fit the memory plan, and builds the sorted lists of a group. */
#include "pipeline/splat.h"

#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "pipeline/stages.h"

enum { MAX_COARSENING = 64, RUN = CLN_SPLAT_RUN };

/* Enlarges coarse pixels of kx x ky pixels, which are `wide` and `high` seen from a distance of 1.
 * Where pixels are far from square, only the shorter side grows, as long as it can. Sides are
 * powers of two, so that bands of rows never cut a coarse pixel. */
static void enlarge(double wide, double high, cl_uint *kx, cl_uint *ky)
{
    const bool x_waits = wide > M_SQRT2 * high && *ky < MAX_COARSENING;
    const bool y_waits = high > M_SQRT2 * wide && *kx < MAX_COARSENING;

    if (!x_waits && *kx < MAX_COARSENING)
        *kx *= 2;
    if (!y_waits && *ky < MAX_COARSENING)
        *ky *= 2;
}

/* Grid of a view and a level, all but `first`. A leaf's cells of spacing s = side / n1, seen from
 * distance z with focal lengths fx and fy, give n1 z^2 / (fx fy s^2) samples per pixel; kx ky times
 * that must reach splat_per_ray (method.md 4, "Coverage"). At t, a coarse pixel meets a sample
 * every s^3 fx fy / (kx ky t^2) of a ray on average. In a forward space, and of parallel rays, a
 * pixel has the same size at any t: about scale / f, that of the mean camera, and 1 / f. *reached:
 * samples of a coarse pixel that sees a whole leaf. */
static cln_grid make_grid(const cln_pipeline *p, const cln_device_camera *c, int level,
                          double *reached)
{
    const double n1 = p->config.n1, spacing = 2.0 / (1 << level) / n1;
    double o[3];
    cln_device_camera_origin(c, o);
    const double distance = fmax(sqrt(o[0] * o[0] + o[1] * o[1] + o[2] * o[2]), 0.5);
    const bool forward = p->space.forward || c->parallel; /* as there */
    const double scale = p->space.forward ? p->space.scale[0] * p->space.scale[1] : 1;
    const double area = forward ? scale / (c->fx * c->fy) : 0;
    const double footprint = distance * distance / (c->fx * c->fy * spacing * spacing);
    const double per_pixel = n1 * (forward ? area / (spacing * spacing) : footprint);
    const double volume = spacing * spacing * spacing;
    const double per_area = forward ? volume / area : volume * c->fx * c->fy;
    cl_uint kx = 1, ky = 1;

    while ((kx < MAX_COARSENING || ky < MAX_COARSENING) &&
           kx * ky * per_pixel < p->config.splat_per_ray)
        enlarge(kx / c->fx, ky / c->fy, &kx, &ky);
    *reached = kx * ky * per_pixel;
    const double spread = per_area / (kx * ky);
    const bool far = c->start > 0; /* t begins at the cube */
    const double at = forward ? 1 : distance;

    return (cln_grid){.coarse_x = kx,
                      .coarse_y = ky,
                      .row = ((cl_uint)c->width + kx - 1) / kx,
                      .cell = (float)(far || forward ? fmax(spacing, spread / (at * at)) : spacing),
                      .spread = far || forward ? 0 : (float)spread};
}

/* A result that is worse than asked for, once. */
static void say_short(cln_pipeline *p, int level, double reached)
{
    if (p->splat_short || reached >= p->config.splat_per_ray || !(p->leaf_levels >> level & 1))
        return;
    p->splat_short = true;
    cln_warn("splatting: in some views %d x %d pixels, the most that share their samples, have "
             "%.2g of a leaf of level %d, not --splat-per-ray %g; rays without any place theirs "
             "evenly: raise --n1 or --downscale, or use --stage1 gather",
             MAX_COARSENING, MAX_COARSENING, reached, level, p->config.splat_per_ray);
}

/* grids[batch view][level] for all views of the batch; returns the number of lists. */
static cln_status make_grids(cln_pipeline *p, cln_grid **grids, cl_uint *lists)
{
    cln_status st = CLN_OK;
    cl_uint *views = NULL;
    uint64_t next = 0;
    const int count = p->batch_view_count, levels = p->deepest + 1;

    *grids = NULL;
    CLN_TRY(cln_alloc(grids, (size_t)(count * levels), sizeof **grids, "splat grids"));
    CLN_TRY(cln_alloc(&views, (size_t)count, sizeof *views, "batch views"));
    for (int i = 0; i < p->host_rays; i++)
        views[p->host_pixels[i].spot] = p->host_pixels[i].view;
    for (int v = 0; v < count; v++)
        for (int level = 0; level < levels; level++) {
            const cln_device_camera *c = &p->host_cameras[views[v]];
            cln_grid *grid = &(*grids)[v * levels + level];
            double reached = 0;

            *grid = make_grid(p, c, level, &reached);
            say_short(p, level, reached);
            grid->first = (cl_uint)next;
            next +=
                (uint64_t)grid->row * (((cl_uint)c->height + grid->coarse_y - 1) / grid->coarse_y);
        }
    if (next >= INT_MAX) {
        st = cln_fail(CLN_MEMORY,
                      "splatting: %d views have %.3g lists, more than the 2.1e9 that can be "
                      "counted; lower --views-per-batch, raise --downscale or use --stage1 gather",
                      count, (double)next);
        goto done;
    }
    *lists = (cl_uint)next;
    CLN_TRY(CLN_PUT(p, batch_views, views, (size_t)count));
    CLN_TRY(CLN_PUT(p, grids, *grids, (size_t)(count * levels)));
done:
    free(views);
    return st;
}

/* Launches splat_count, or splat_emit once the counts are scanned. */
static cln_status project(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *g,
                          bool emit, cl_uint *items)
{
    const cl_uint n1 = (cl_uint)p->config.n1, total = (cl_uint)p->leaves * n1 * n1 * n1;
    const cl_uint run = RUN, runs = (cl_uint)cln_groups(total, RUN);
    const cl_uint first = (cl_uint)g->first_view, views = (cl_uint)g->views;
    const cl_uint row_begin = (cl_uint)g->row_begin, row_end = (cl_uint)g->row_end;
    const cl_float min_alpha = (cl_float)p->config.splat_min_alpha;
    const size_t wg = 1;

    *items = views * runs;
    if (!emit)
        return CLN_LAUNCH(p->device, p->k.splat_count, CLN_STAGE_PROJECT, *items, wg,
                          CLN_ARG(p->cameras.mem), CLN_ARG(p->batch_views.mem),
                          CLN_LEAF_ARG_OF(p, density), CLN_ARG(p->boxes.mem), CLN_ARG(p->grids.mem),
                          CLN_ARG(p->splat_counts.mem), CLN_ARG(first), CLN_ARG(views),
                          CLN_ARG(total), CLN_ARG(n1), CLN_ARG(run), CLN_ARG(runs),
                          CLN_ARG(row_begin), CLN_ARG(row_end), CLN_ARG(min_alpha));
    return CLN_LAUNCH(
        p->device, p->k.splat_emit, CLN_STAGE_PROJECT, *items, wg, CLN_ARG(p->cameras.mem),
        CLN_ARG(p->batch_views.mem), CLN_LEAF_ARG_OF(p, density), CLN_ARG(p->boxes.mem),
        CLN_ARG(p->grids.mem), CLN_ARG(p->splat_starts.mem), CLN_ARG(p->keys64[0].mem),
        CLN_ARG(p->values64[0].mem), CLN_ARG(first), CLN_ARG(views), CLN_ARG(total), CLN_ARG(n1),
        CLN_ARG(run), CLN_ARG(runs), CLN_ARG(row_begin), CLN_ARG(row_end), CLN_ARG(min_alpha));
}

uint64_t cln_splat_most(const cln_pipeline *p, int views)
{
    const uint64_t n1 = (uint64_t)p->config.n1;

    return (uint64_t)views * (uint64_t)p->leaves * n1 * n1 * n1;
}

static cln_status count_entries(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *g,
                                uint32_t *entries)
{
    cln_status st = CLN_OK;
    const size_t n1 = (size_t)p->config.n1;
    const size_t runs = (size_t)g->views * cln_groups((size_t)p->leaves * n1 * n1 * n1, RUN);
    cl_uint items = 0;

    CLN_TRY(CLN_RESERVE(p, splat_counts, runs));
    CLN_TRY(CLN_RESERVE(p, splat_starts, runs + 1));
    CLN_TRY(project(p, density, g, false, &items));
    CLN_TRY(
        cln_stage_scan(p, &p->splat_counts, &p->splat_starts, items, CLN_STAGE_PROJECT, entries));
done:
    return st;
}

/* Finds a group's rays: the batch is ordered by view and row. */
static void find_rays(const cln_pipeline *p, cln_ray_group *g)
{
    int first = 0, end = 0;

    while (first < p->host_rays && ((int)p->host_pixels[first].spot < g->first_view ||
                                    ((int)p->host_pixels[first].spot == g->first_view &&
                                     (int)p->host_pixels[first].y < g->row_begin)))
        first++;
    for (end = first; end < p->host_rays; end++) {
        const int view = (int)p->host_pixels[end].spot;

        if (view >= g->first_view + g->views ||
            (g->views == 1 && (int)p->host_pixels[end].y >= g->row_end))
            break;
    }
    g->first_ray = first;
    g->rays = end - first;
}

enum { WHOLE = 1 << 20 }; /* row_end of a group that is not cut by rows */

/* Halves a group, by views, or of one view by whole coarse rows; *a comes first. False if it is one
 * coarse row of one view. */
static bool halve(const cln_pipeline *p, cln_ray_group *g, cln_ray_group *a, cln_ray_group *b)
{
    int bands = 0;

    if (g->views == 1 && g->row_end == WHOLE)
        g->row_end =
            ((p->host_cameras[p->host_pixels[g->first_ray].view].height - 1) / MAX_COARSENING + 1) *
            MAX_COARSENING;
    bands = (g->row_end - g->row_begin) / MAX_COARSENING;
    *a = *b = *g;
    if (g->views > 1) {
        a->views = g->views / 2;
        b->first_view += a->views;
        b->views -= a->views;
        return true;
    }
    a->row_end = b->row_begin = g->row_begin + bands / 2 * MAX_COARSENING;
    return g->row_end - g->row_begin > MAX_COARSENING;
}

cln_status cln_splat_cut(cln_pipeline *p, const cln_buffer *density, int n, cln_ray_group **groups,
                         int *count)
{
    cln_status st = CLN_OK;
    cln_ray_group *stack = NULL;
    cln_grid *grids = NULL;
    cl_uint lists = 0;
    int depth = 0, capacity = 0;

    *groups = NULL;
    *count = 0;
    p->splat_entries = 0;
    CLN_ASSERT(n == p->host_rays);
    p->batch_view_count = n ? (int)p->host_pixels[n - 1].spot + 1 : 0;
    if (n == 0)
        return CLN_OK;
    CLN_TRY(make_grids(p, &grids, &lists));
    p->list_total = (int)lists;
    CLN_TRY(CLN_RESERVE(p, list_start, (size_t)lists + 1));
    CLN_TRY(CLN_RESERVE(p, list_count, lists));
    /* Halve views, then rows, until the entries fit; fail if the smallest band does not. */
    capacity = 4 * (p->batch_view_count + 32768);
    CLN_TRY(cln_alloc(&stack, (size_t)capacity, sizeof *stack, "splat plan"));
    CLN_TRY(cln_alloc(groups, (size_t)capacity, sizeof **groups, "splat plan"));
    stack[depth++] = (cln_ray_group){.views = p->batch_view_count, .row_end = WHOLE};
    while (depth > 0) {
        cln_ray_group g = stack[--depth], a, b;
        uint32_t entries = 0;

        find_rays(p, &g);
        if (g.rays == 0)
            continue;
        /* entries are counted in 32 bits; one view's always can be, as the plan checks */
        const bool countable = g.views == 1 || cln_splat_most(p, g.views) <= p->max_counted;

        if (countable)
            CLN_TRY(count_entries(p, density, &g, &entries));
        if (countable && entries <= p->max_entries) {
            CLN_ASSERT(*count < capacity);
            (*groups)[(*count)++] = g;
            p->splat_entries += entries;
            continue;
        }
        if (!halve(p, &g, &a, &b))
            CLN_TRY(
                cln_fail(CLN_MEMORY,
                         "splatting: %u samples fall on %d rows of one view, more than the %zu of "
                         "the memory plan; lower --n1, raise --device-mem or use --stage1 gather",
                         entries, g.row_end - g.row_begin, p->max_entries));
        CLN_ASSERT(depth + 2 <= capacity);
        stack[depth++] = b; /* below a: groups stay in the order of rays */
        stack[depth++] = a;
    }
done:
    free(grids);
    free(stack);
    if (st != CLN_OK) {
        free(*groups);
        *groups = NULL;
    }
    return st;
}

/* The paper's padded groups: every list as long as the longest. */
static cln_status pad(cln_pipeline *p, cl_uint lists)
{
    cln_status st = CLN_OK;
    cl_uint *counts = NULL, longest = 0;
    const size_t wg = (size_t)p->tune.wg;

    CLN_TRY(cln_alloc(&counts, lists, sizeof *counts, "list lengths"));
    CLN_TRY(cln_buffer_read(p->device, &p->list_count, 0, counts, lists * sizeof *counts));
    for (cl_uint l = 0; l < lists; l++)
        longest = counts[l] > longest ? counts[l] : longest;
    if ((double)lists * longest > 4294967295.0) {
        st = cln_fail(CLN_MEMORY,
                      "padded lists: %u lists of %u entries cannot be counted in 32 bits; use "
                      "--lists csr",
                      lists, longest);
        goto done;
    }
    CLN_TRY(cln_buffer_write(p->device, &p->grids, offsetof(cln_grid, longest), &longest,
                             sizeof longest));
    CLN_TRY(CLN_RESERVE(p, padded_t, (size_t)lists * longest));
    CLN_TRY(CLN_RESERVE(p, padded_sigma, (size_t)lists * longest));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.splat_pad, CLN_STAGE_SORT, cln_groups(lists, wg), wg,
                       CLN_ARG(p->list_start.mem), CLN_ARG(p->list_t.mem),
                       CLN_ARG(p->list_sigma.mem), CLN_ARG(p->padded_t.mem),
                       CLN_ARG(p->padded_sigma.mem), CLN_ARG(lists), CLN_ARG(longest)));
done:
    free(counts);
    return st;
}

cln_status cln_splat_make(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *g)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t wg = (size_t)p->tune.wg;
    const cl_uint lists = (cl_uint)p->list_total, n1 = (cl_uint)p->config.n1;
    const cl_uint cells = n1 * n1 * n1;
    uint32_t entries = 0;
    cl_uint items = 0, n = 0;
    int bits = 32;

    CLN_TRY(count_entries(p, density, g, &entries));
    n = entries;
    CLN_TRY(CLN_RESERVE(p, keys64, n));
    CLN_TRY(CLN_RESERVE(p, values64, n));
    CLN_TRY(CLN_RESERVE(p, list_t, n));
    CLN_TRY(CLN_RESERVE(p, list_sigma, n));
    CLN_TRY(project(p, density, g, true, &items));
    while (bits < 64 && (lists - 1) >> (bits - 32))
        bits++;
    CLN_TRY(cln_stage_sort(p, p->keys64, p->values64, n, bits, true, CLN_STAGE_SORT));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_bounds, CLN_STAGE_SORT, cln_groups((size_t)n + 1, wg), wg,
                       CLN_ARG(p->keys64[0].mem), CLN_ARG(p->list_start.mem), CLN_ARG(n),
                       CLN_ARG(lists)));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_read, CLN_STAGE_SORT, cln_groups(n, wg), wg,
                       CLN_ARG(p->keys64[0].mem), CLN_ARG(p->values64[0].mem),
                       CLN_LEAF_ARG_OF(p, density), CLN_ARG(p->list_t.mem),
                       CLN_ARG(p->list_sigma.mem), CLN_ARG(n), CLN_ARG(cells)));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_lengths, CLN_STAGE_SORT, cln_groups(lists, wg), wg,
                       CLN_ARG(p->list_start.mem), CLN_ARG(p->list_count.mem), CLN_ARG(lists)));
    if (p->config.lists == CLN_LISTS_PADDED)
        CLN_TRY(pad(p, lists));
done:
    return st;
}

cln_status cln_splat_keep(cln_pipeline *p, const cln_pixel *pixels, int n)
{
    cln_status st = CLN_OK;

    free(p->host_pixels);
    p->host_rays = 0;
    CLN_TRY(cln_alloc(&p->host_pixels, (size_t)n, sizeof *pixels, "pixels"));
    if (n)
        memcpy(p->host_pixels, pixels, (size_t)n * sizeof *pixels);
    p->host_rays = n;
done:
    return st;
}

void cln_splat_release(cln_pipeline *p)
{
    cln_pipeline_release(p, CLN_FOR_PROJECTED);
    cln_buffer_free(p->device, &p->digit_counts);
}

void cln_splat_front(const cln_pipeline *p, const cln_buffer *density, cln_args *args)
{
    const bool padded = p->config.lists == CLN_LISTS_PADDED;

    (void)density; /* the lists hold it */
    cln_args_add(args, (cln_arg)CLN_ARG(p->list_start.mem));
    cln_args_add(args,
                 padded ? (cln_arg)CLN_ARG(p->padded_t.mem) : (cln_arg)CLN_ARG(p->list_t.mem));
    cln_args_add(args, padded ? (cln_arg)CLN_ARG(p->padded_sigma.mem)
                              : (cln_arg)CLN_ARG(p->list_sigma.mem));
}

void cln_splat_back(const cln_pipeline *p, cln_args *args)
{
    cln_args_add(args, (cln_arg)CLN_ARG(p->pixels.mem));
    cln_args_add(args, (cln_arg)CLN_ARG(p->grids.mem));
    cln_args_add(args, (cln_arg)CLN_ARG(p->list_count.mem));
}
