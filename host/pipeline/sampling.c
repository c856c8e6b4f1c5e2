/* Stages from pixels to samples: rays, intervals, stage-2 samples. */
#include "pipeline/stages.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "pipeline/stage1.h"
#include "pipeline/stretch.h"
#include "pipeline/walk.h"
#include "ranks/ranks.h"

cln_status cln_stage_rays(cln_pipeline *p, int n)
{
    const cl_uint count = (cl_uint)n;
    const size_t wg = (size_t)p->tune.wg;

    return CLN_LAUNCH(p->device, p->k.rays_make, CLN_STAGE_RAYS, cln_groups((size_t)n, wg), wg,
                      CLN_ARG(p->cameras.mem), CLN_ARG(p->pixels.mem), CLN_ARG(p->ray_o.mem),
                      CLN_ARG(p->ray_d.mem), CLN_ARG(count));
}

static const cln_buffer *densities(const cln_pipeline *p, const cln_sampling *s)
{
    return s->pictures ? &p->picture_density : &p->density;
}

/* Work-items of a group; each takes CLN_RAYS_EACH rays, so a group takes about tune.wg rays. */
static size_t group_of(const cln_pipeline *p)
{
    return cln_groups((size_t)p->tune.wg, CLN_RAYS_EACH((size_t)p->tune.vw));
}

/* The rays that are in both. */
static cln_ray_group overlap(cln_ray_group a, cln_ray_group b)
{
    const int first = a.first_ray > b.first_ray ? a.first_ray : b.first_ray;
    const int end_a = a.first_ray + a.rays, end_b = b.first_ray + b.rays;
    const int end = end_a < end_b ? end_a : end_b;

    return (cln_ray_group){.first_ray = first, .rays = end > first ? end - first : 0};
}

/* Makes the intervals of the group's rays, as far as this rank walks them. */
static cln_status fill(cln_pipeline *p, const cln_sampling *s, const cln_ray_group *g, int all)
{
    const cln_ray_group own = overlap(*g, cln_walk_part(p, all));
    const cl_uint first = (cl_uint)own.first_ray, n = (cl_uint)own.rays;
    const cl_uint rays = (cl_uint)all;
    const cl_int depth = p->depth;
    const cl_float max_depth = s->min_transmittance > 0 ? -logf(s->min_transmittance) : 1e30f;
    const cl_uint per_leaf = (cl_uint)p->config.samples_per_leaf;
    const cl_uint per_ray = (cl_uint)p->config.samples_per_ray;
    const cl_uint2 seed = {{(cl_uint)s->seed, (cl_uint)(s->seed >> 32)}};
    const size_t each = CLN_RAYS_EACH((size_t)p->tune.vw), wg = group_of(p);
    const cln_stage1 *stage1 = cln_stage1_of(&p->config);
    cln_args a = {.count = 0};

    stage1->front(p, densities(p, s), &a);
    CLN_ADD(&a, p->ray_o.mem);
    CLN_ADD(&a, p->ray_d.mem);
    CLN_ADD(&a, p->map.mem);
    CLN_ADD(&a, p->intervals.mem);
    CLN_ADD(&a, p->used.mem);
    CLN_ADD(&a, p->sample_counts.mem);
    CLN_ADD(&a, first);
    CLN_ADD(&a, n);
    CLN_ADD(&a, rays);
    CLN_ADD(&a, depth);
    CLN_ADD(&a, max_depth);
    CLN_ADD(&a, per_leaf);
    CLN_ADD(&a, per_ray);
    CLN_ADD(&a, s->empty_weight);
    CLN_ADD(&a, s->empty_share);
    CLN_ADD(&a, seed);
    CLN_ADD(&a, s->step);
    if (s->crop)
        cln_args_add(&a, (cln_arg){sizeof(cl_float4), s->crop, 6});
    if (stage1->back)
        stage1->back(p, &a);
    return cln_launch(p->device, s->crop ? p->k.intervals_crop : p->k.intervals_fill,
                      CLN_STAGE_INTERVALS, cln_groups(cln_groups((size_t)own.rays, each), wg), wg,
                      a.list, a.count);
}

/* Writes the samples of the group's rays, but for rays that would exceed `most` samples in all. */
static cln_status emit(cln_pipeline *p, const cln_sampling *s, const cln_ray_group *g, int all,
                       size_t most)
{
    const cl_uint first = (cl_uint)g->first_ray;
    const cl_uint n = (cl_uint)g->rays, rays = (cl_uint)all, jitter = s->jitter;
    const cl_uint allowed = most < UINT32_MAX ? (cl_uint)most : UINT32_MAX;
    const cl_uint2 seed = {{(cl_uint)s->seed, (cl_uint)(s->seed >> 32)}};
    const size_t each = CLN_RAYS_EACH((size_t)p->tune.vw), wg = group_of(p);
    const cln_stage1 *stage1 = cln_stage1_of(&p->config);
    cln_args a = {.count = 0};

    stage1->front(p, densities(p, s), &a);
    CLN_ADD(&a, p->ray_o.mem);
    CLN_ADD(&a, p->ray_d.mem);
    CLN_ADD(&a, p->intervals.mem);
    CLN_ADD(&a, p->used.mem);
    CLN_ADD(&a, (s->stretches ? &p->own_starts : &p->sample_starts)->mem);
    CLN_ADD(&a, p->samples.mem);
    CLN_ADD(&a, first);
    CLN_ADD(&a, n);
    CLN_ADD(&a, rays);
    CLN_ADD(&a, allowed);
    CLN_ADD(&a, s->uniform_share);
    CLN_ADD(&a, jitter);
    CLN_ADD(&a, seed);
    CLN_ADD(&a, s->step);
    if (stage1->back)
        stage1->back(p, &a);
    return cln_launch(p->device, p->k.samples_emit, CLN_STAGE_SAMPLES,
                      cln_groups(cln_groups((size_t)g->rays, each), wg), wg, a.list, a.count);
}

/* Finds the largest number of rays, at least one, whose samples fit. */
static cln_status cut(cln_pipeline *p, int n, size_t max_samples, int *rays_used, uint32_t *total)
{
    cln_status st = CLN_OK;
    uint32_t *starts = NULL;
    int low = 1, high = n;

    CLN_TRY(cln_alloc(&starts, (size_t)n + 1, sizeof *starts, "sample counts"));
    CLN_TRY(
        cln_buffer_read(p->device, &p->sample_starts, 0, starts, ((size_t)n + 1) * sizeof *starts));
    while (low < high) {
        const int middle = low + (high - low + 1) / 2;

        if (starts[middle] <= max_samples)
            low = middle;
        else
            high = middle - 1;
    }
    *rays_used = low;
    *total = starts[low];
done:
    free(starts);
    return st;
}

cln_status cln_stage_sample(cln_pipeline *p, int n, const cln_sampling *s, int *rays_used,
                            uint32_t *sample_count)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t rays = (size_t)n;
    const cl_uint count = (cl_uint)n;
    const cln_stage1 *stage1 = cln_stage1_of(&p->config);
    cln_ray_group all = {.first_ray = 0, .rays = n}, *cut_groups = NULL, *groups = &all;
    int group_count = 1;
    cln_mark mark = {.event = NULL};
    cln_status made = CLN_OK;
    const size_t extra = s->extra;
    const size_t there = p->samples.bytes / sizeof(cln_sample);
    const size_t room = there > extra ? there - extra : 0;
    const size_t limit = room < s->max_samples ? room : s->max_samples;

    *rays_used = n;
    *sample_count = 0;
    p->stretched = s->stretches;
    CLN_TRY(CLN_RESERVE(p, intervals, rays * (size_t)p->most_intervals));
    CLN_TRY(CLN_RESERVE(p, used, rays));
    CLN_TRY(CLN_RESERVE(p, sample_counts, rays));
    CLN_TRY(CLN_RESERVE(p, sample_starts, rays + 1));
    if (stage1->cut) {
        CLN_TRY(stage1->cut(p, densities(p, s), n, &cut_groups, &group_count));
        groups = cut_groups;
    }
    for (int g = 0; g < group_count; g++) {
        if (stage1->make)
            CLN_TRY(stage1->make(p, densities(p, s), &groups[g]));
        CLN_TRY(fill(p, s, &groups[g], n));
    }
    CLN_TRY(cln_walk_share(p, n, s->max_samples));
    CLN_TRY(
        cln_stage_scan(p, &p->sample_counts, &p->sample_starts, count, CLN_STAGE_INTERVALS, NULL));
    CLN_TRY(cln_buffer_fetch(device, &p->sample_starts, rays * sizeof(cl_uint), &p->sample_total,
                             sizeof p->sample_total));
    if (s->stretches) {
        CLN_TRY(cln_stretch_find(p, n, cln_ranks_me(), s->max_samples));
        CLN_TRY(cln_buffer_fetch(device, &p->own_starts, rays * sizeof(cl_uint), &p->samples_here,
                                 sizeof p->samples_here));
    }
    CLN_TRY(cln_device_mark(device, &mark));
    /* The reserved room is usually enough: the device then goes on while the host waits. */
    if (group_count == 1 && limit > 0)
        made = emit(p, s, &groups[0], n, limit);
    CLN_TRY(cln_device_wait(device, &mark));
    CLN_TRY(made);
    *sample_count = p->sample_total;
    if (!s->stretches)
        p->samples_here = *sample_count;
    if (n > 0 && *sample_count > s->max_samples) {
        CLN_TRY(cut(p, n, s->max_samples, rays_used, sample_count));
        p->samples_here = *sample_count;
        if (s->stretches)
            CLN_TRY(cln_stretch_cut(p, *rays_used, &p->samples_here));
    }
    if (group_count == 1 && p->samples_here <= limit)
        goto done;
    CLN_TRY(CLN_RESERVE(p, samples, p->samples_here + extra));
    for (int g = 0; g < group_count; g++) {
        if (stage1->make && group_count > 1) /* a single group's lists are still there */
            CLN_TRY(stage1->make(p, densities(p, s), &groups[g]));
        CLN_TRY(emit(p, s, &groups[g], n, p->samples_here));
    }
done:
    free(cut_groups);
    return st;
}
