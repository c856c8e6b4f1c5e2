/* Stage 1 by splatting (kernels/splat.cl): plans groups of views or bands of rows whose projected samples
 * fit the memory plan, and builds the sorted lists of a group. */
#include "pipeline/stages.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"

enum { LEVELS = CLN_MAX_LEVEL + 1, MAX_COARSENING = 64, RUN = 4096 };

/* Coarsening k of a level: a leaf sample grid of spacing s, seen from distance z with focal length f,
 * gives n1 (z / (f s))^2 samples per pixel and leaf; k^2 times that must reach splat_per_ray
 * (method.md 4, "Coverage", with s = side / n1). */
static int coarsening(const cln_pipeline *p, const cln_device_camera *c, int level)
{
    const double n1 = p->config.n1, side = 2.0 / (1 << level);
    const double x = c->c2w[3], y = c->c2w[7], z = c->c2w[11];
    const double distance = fmax(sqrt(x * x + y * y + z * z), 0.5);
    const double footprint = distance / (c->fx * side / n1);
    const double per_pixel = n1 * footprint * footprint;
    int k = 1;

    /* a power of two, so that bands of rows never cut a coarse pixel */
    while (k < MAX_COARSENING && k * k * per_pixel < p->config.splat_per_ray)
        k *= 2;
    return k;
}

/* grids[batch view][level] for all views of the batch; returns the number of lists. */
static cln_status make_grids(cln_pipeline *p, cl_uint (**grids)[4], cl_uint *lists)
{
    cln_status st = CLN_OK;
    cl_uint *views = NULL, next = 0;
    const int count = p->batch_view_count;

    *grids = NULL;
    CLN_TRY(cln_alloc(grids, (size_t)count * LEVELS, sizeof **grids, "splat grids"));
    CLN_TRY(cln_alloc(&views, (size_t)count, sizeof *views, "batch views"));
    for (int i = 0; i < p->host_rays; i++)
        views[p->host_pixels[i].pad] = p->host_pixels[i].view;
    for (int v = 0; v < count; v++)
        for (int level = 0; level < LEVELS; level++) {
            const cln_device_camera *c = &p->host_cameras[views[v]];
            const cl_uint k = (cl_uint)coarsening(p, c, level);
            const cl_uint row = ((cl_uint)c->width + k - 1) / k,
                          rows = ((cl_uint)c->height + k - 1) / k;
            cl_uint *grid = (*grids)[v * LEVELS + level];

            grid[0] = next;
            grid[1] = k;
            grid[2] = row;
            grid[3] = 0;
            next += row * rows;
        }
    *lists = next;
    CLN_TRY(cln_buffer_reserve(p->device, &p->batch_views, (size_t)count * sizeof *views, "views"));
    CLN_TRY(cln_buffer_write(p->device, &p->batch_views, 0, views, (size_t)count * sizeof *views));
    CLN_TRY(
        cln_buffer_reserve(p->device, &p->grids, (size_t)count * LEVELS * sizeof **grids, "grids"));
    CLN_TRY(
        cln_buffer_write(p->device, &p->grids, 0, *grids, (size_t)count * LEVELS * sizeof **grids));
done:
    free(views);
    return st;
}

/* Launches splat_count, or splat_emit once the counts are scanned. */
static cln_status project(cln_pipeline *p, const cln_buffer *density, const cln_splat_group *g,
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
        CLN_ARG(p->values[0].mem), CLN_ARG(first), CLN_ARG(views), CLN_ARG(total), CLN_ARG(n1),
        CLN_ARG(run), CLN_ARG(runs), CLN_ARG(row_begin), CLN_ARG(row_end), CLN_ARG(min_alpha));
}

static cln_status count_entries(cln_pipeline *p, const cln_buffer *density,
                                const cln_splat_group *g, uint32_t *entries)
{
    cln_status st = CLN_OK;
    const size_t n1 = (size_t)p->config.n1;
    const size_t runs = cln_groups((size_t)p->leaves * n1 * n1 * n1, RUN);
    cl_uint items = 0;

    CLN_TRY(cln_buffer_reserve(p->device, &p->splat_counts,
                               (size_t)g->views * runs * sizeof(cl_uint), "splat counts"));
    CLN_TRY(cln_buffer_reserve(p->device, &p->splat_starts,
                               ((size_t)g->views * runs + 1) * sizeof(cl_uint), "splat counts"));
    CLN_TRY(project(p, density, g, false, &items));
    CLN_TRY(
        cln_stage_scan(p, &p->splat_counts, &p->splat_starts, items, CLN_STAGE_PROJECT, entries));
done:
    return st;
}

/* Rays of a group: those of its views and rows (the batch is in that order). */
static void find_rays(const cln_pipeline *p, cln_splat_group *g)
{
    int first = 0, end = 0;

    while (first < p->host_rays && ((int)p->host_pixels[first].pad < g->first_view ||
                                    ((int)p->host_pixels[first].pad == g->first_view &&
                                     (int)p->host_pixels[first].y < g->row_begin)))
        first++;
    for (end = first; end < p->host_rays; end++) {
        const int view = (int)p->host_pixels[end].pad;

        if (view >= g->first_view + g->views ||
            (g->views == 1 && (int)p->host_pixels[end].y >= g->row_end))
            break;
    }
    g->first_ray = first;
    g->rays = end - first;
}

cln_status cln_stage_splat_plan(cln_pipeline *p, const cln_buffer *density, int n,
                                cln_splat_group **groups, int *count)
{
    cln_status st = CLN_OK;
    cln_splat_group *stack = NULL;
    cl_uint(*grids)[4] = NULL, lists = 0;
    int depth = 0, capacity = 0;

    *groups = NULL;
    *count = 0;
    p->splat_entries = 0;
    CLN_ASSERT(n == p->host_rays);
    p->batch_view_count = n ? (int)p->host_pixels[n - 1].pad + 1 : 0;
    if (n == 0)
        return CLN_OK;
    CLN_TRY(make_grids(p, &grids, &lists));
    p->list_total = (int)lists;
    CLN_TRY(cln_buffer_reserve(p->device, &p->list_start, ((size_t)lists + 1) * sizeof(cl_uint),
                               "list starts"));
    CLN_TRY(cln_buffer_reserve(p->device, &p->list_count, (size_t)lists * sizeof(cl_uint),
                               "list lengths"));
    /* Halve views, then rows, until the entries fit; a row that does not fit is too much. */
    capacity = 4 * (p->batch_view_count + 32768);
    CLN_TRY(cln_alloc(&stack, (size_t)capacity, sizeof *stack, "splat plan"));
    CLN_TRY(cln_alloc(groups, (size_t)capacity, sizeof **groups, "splat plan"));
    stack[depth++] = (cln_splat_group){.views = p->batch_view_count, .row_end = 1 << 20};
    while (depth > 0) {
        cln_splat_group g = stack[--depth];
        uint32_t entries = 0;

        find_rays(p, &g);
        if (g.rays == 0)
            continue;
        CLN_TRY(count_entries(p, density, &g, &entries));
        if (entries <= p->max_entries) {
            CLN_ASSERT(*count < capacity);
            (*groups)[(*count)++] = g;
            p->splat_entries += entries;
            continue;
        }
        if (g.row_end == 1 << 20 && g.views == 1) /* bands are cut at a coarse row's multiple */
            g.row_end =
                ((p->host_cameras[p->host_pixels[g.first_ray].view].height - 1) / MAX_COARSENING +
                 1) *
                MAX_COARSENING;
        if (g.views == 1 && g.row_end - g.row_begin <= MAX_COARSENING) {
            st = cln_fail(
                CLN_MEMORY,
                "splatting: %u samples fall on %d rows of one view, the memory plan has room "
                "for %zu; lower --n1, raise --device-mem or use --stage1 gather",
                entries, g.row_end - g.row_begin, p->max_entries);
            goto done;
        }
        CLN_ASSERT(depth + 2 <= capacity);
        cln_splat_group a = g, b = g;

        if (g.views > 1) {
            a.views = g.views / 2;
            b.first_view += a.views;
            b.views -= a.views;
        } else {
            const int bands = (g.row_end - g.row_begin) / MAX_COARSENING;

            a.row_end = b.row_begin = g.row_begin + bands / 2 * MAX_COARSENING;
        }
        stack[depth++] = b; /* a is taken first: groups stay in the order of rays */
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
    CLN_TRY(cln_buffer_write(p->device, &p->grids, 3 * sizeof(cl_uint), &longest, sizeof longest));
    CLN_TRY(cln_buffer_reserve(p->device, &p->padded_t, (size_t)lists * longest * sizeof(float),
                               "padded lists (--lists csr needs less)"));
    CLN_TRY(cln_buffer_reserve(p->device, &p->padded_sigma, (size_t)lists * longest * sizeof(float),
                               "padded lists (--lists csr needs less)"));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.splat_pad, CLN_STAGE_SORT, cln_groups(lists, wg), wg,
                       CLN_ARG(p->list_start.mem), CLN_ARG(p->list_t.mem),
                       CLN_ARG(p->list_sigma.mem), CLN_ARG(p->padded_t.mem),
                       CLN_ARG(p->padded_sigma.mem), CLN_ARG(lists), CLN_ARG(longest)));
done:
    free(counts);
    return st;
}

cln_status cln_stage_splat_lists(cln_pipeline *p, const cln_buffer *density,
                                 const cln_splat_group *g)
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
    for (int b = 0; b < 2; b++) {
        CLN_TRY(cln_buffer_reserve(device, &p->keys64[b], n * sizeof(cl_ulong), "splat keys"));
        CLN_TRY(cln_buffer_reserve(device, &p->values[b], n * sizeof(cl_uint), "splat values"));
    }
    CLN_TRY(cln_buffer_reserve(device, &p->list_t, n * sizeof(float), "splat lists"));
    CLN_TRY(cln_buffer_reserve(device, &p->list_sigma, n * sizeof(float), "splat lists"));
    CLN_TRY(project(p, density, g, true, &items));
    while (bits < 64 && (lists - 1) >> (bits - 32))
        bits++;
    CLN_TRY(cln_stage_sort(p, p->keys64, p->values, n, bits, true, CLN_STAGE_SORT));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_bounds, CLN_STAGE_SORT, cln_groups((size_t)n + 1, wg), wg,
                       CLN_ARG(p->keys64[0].mem), CLN_ARG(p->list_start.mem), CLN_ARG(n),
                       CLN_ARG(lists)));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_read, CLN_STAGE_SORT, cln_groups(n, wg), wg,
                       CLN_ARG(p->keys64[0].mem), CLN_ARG(p->values[0].mem),
                       CLN_LEAF_ARG_OF(p, density), CLN_ARG(p->list_t.mem),
                       CLN_ARG(p->list_sigma.mem), CLN_ARG(n), CLN_ARG(cells)));
    CLN_TRY(CLN_LAUNCH(device, p->k.splat_lengths, CLN_STAGE_SORT, cln_groups(lists, wg), wg,
                       CLN_ARG(p->list_start.mem), CLN_ARG(p->list_count.mem), CLN_ARG(lists)));
    if (p->config.lists == CLN_LISTS_PADDED)
        CLN_TRY(pad(p, lists));
done:
    return st;
}

void cln_stage_splat_release(cln_pipeline *p)
{
    cln_buffer *const buffers[] = {&p->keys64[0], &p->keys64[1],    &p->list_t,      &p->list_sigma,
                                   &p->padded_t,  &p->padded_sigma, &p->digit_counts};

    for (size_t i = 0; i < sizeof buffers / sizeof buffers[0]; i++)
        cln_buffer_free(p->device, buffers[i]);
}
