/* The walk of rays, dealt to ranks. See walk.h. */
#include "pipeline/walk.h"

#include <stdlib.h>

#include "base/memory.h"
#include "pipeline/share.h"
#include "ranks/ranks.h"

static int first_ray(const cln_pipeline *p, int rank, int n)
{
    return (int)((int64_t)n * rank / p->ranks);
}

cln_ray_group cln_walk_part(const cln_pipeline *p, int n)
{
    const int me = cln_ranks_me();
    cln_ray_group part = {.rays = n};

    if (p->ranks >= CLN_WALK_RANKS) {
        part.first_ray = first_ray(p, me, n);
        part.rays = first_ray(p, me + 1, n) - part.first_ray;
    }
    return part;
}

/* Of a ray. */
typedef struct walked {
    cl_uint intervals, samples;
} walked;

/* All rays' counts, [ray], of which the device has those of `part`. */
static cln_status share_counts(cln_pipeline *p, int n, cln_ray_group part, walked *rays)
{
    cln_status st = CLN_OK;
    const size_t at = (size_t)part.first_ray, own = (size_t)part.rays;
    int first[CLN_RANKS_MOST + 1];
    cl_uint *used = NULL, *samples = NULL;

    CLN_TRY(cln_share_room(p, 2 * own * sizeof *used));
    used = (cl_uint *)(void *)p->message;
    samples = used + own;
    CLN_TRY(cln_buffer_fetch(p->device, &p->used, at * sizeof *used, used, own * sizeof *used));
    CLN_TRY(cln_buffer_read(p->device, &p->sample_counts, at * sizeof *samples, samples,
                            own * sizeof *samples));
    for (size_t i = 0; i < own; i++)
        rays[at + i] = (walked){used[i], samples[i]};
    for (int r = 0; r <= p->ranks; r++)
        first[r] = first_ray(p, r, n);
    cln_ranks_gather(rays, sizeof *rays, first, true);
done:
    return st;
}

/* Sends the device all rays' counts, and where their intervals begin in p->walked; starts: [n + 1],
 * the same. */
static cln_status put_counts(cln_pipeline *p, int n, const walked *rays, size_t max_samples,
                             cl_uint *starts)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)n;
    cl_uint *used = NULL, *samples = NULL;
    uint64_t sum = 0;

    CLN_TRY(cln_share_room(p, 2 * count * sizeof *used));
    used = (cl_uint *)(void *)p->message;
    samples = used + count;
    starts[0] = 0;
    for (size_t r = 0; r < count; r++) {
        samples[r] = rays[r].samples;
        sum += samples[r];
        used[r] = r == 0 || sum <= max_samples ? rays[r].intervals : 0;
        starts[r + 1] = starts[r] + used[r];
    }
    CLN_TRY(CLN_PUT_SOON(p, used, used, count));
    CLN_TRY(CLN_PUT_SOON(p, sample_counts, samples, count));
    CLN_TRY(CLN_PUT(p, walk_starts, starts, count + 1));
done:
    return st;
}

static cln_status share_intervals(cln_pipeline *p, int n, cln_ray_group part, const cl_uint *starts)
{
    cln_status st = CLN_OK;
    const size_t row = sizeof(cln_interval), wg = (size_t)p->tune.wg;
    const cl_uint first = (cl_uint)part.first_ray, own = (cl_uint)part.rays, rays = (cl_uint)n;
    const cl_uint end = first + own;
    const size_t all = starts[n] * row, before = starts[first] * row, after = starts[end] * row;
    int runs[CLN_RANKS_MOST + 1];

    CLN_TRY(CLN_RESERVE(p, walked, starts[n]));
    CLN_TRY(cln_share_room(p, all));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.walk_pack, CLN_STAGE_INTERVALS, cln_groups(own, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->walk_starts.mem),
                       CLN_ARG(p->walked.mem), CLN_ARG(first), CLN_ARG(own), CLN_ARG(rays)));
    CLN_TRY(cln_buffer_read(p->device, &p->walked, before, p->message + before, after - before));
    for (int r = 0; r <= p->ranks; r++)
        runs[r] = (int)starts[first_ray(p, r, n)];
    p->interval_total = starts[n];
    cln_ranks_gather(p->message, row, runs, true);
    CLN_TRY(cln_buffer_write(p->device, &p->walked, 0, p->message, before));
    CLN_TRY(cln_buffer_write(p->device, &p->walked, after, p->message + after, all - after));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.walk_unpack, CLN_STAGE_INTERVALS, cln_groups(rays, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->walk_starts.mem),
                       CLN_ARG(p->walked.mem), CLN_ARG(first), CLN_ARG(end), CLN_ARG(rays)));
done:
    return st;
}

cln_status cln_walk_share(cln_pipeline *p, int n, size_t max_samples)
{
    cln_status st = CLN_OK;
    const cln_ray_group part = cln_walk_part(p, n);
    walked *rays = NULL;
    cl_uint *starts = NULL;

    if (p->ranks < CLN_WALK_RANKS)
        return CLN_OK;
    CLN_TRY(cln_alloc(&rays, (size_t)n, sizeof *rays, "counts of rays"));
    CLN_TRY(cln_alloc(&starts, (size_t)n + 1, sizeof *starts, "counts of rays"));
    CLN_TRY(share_counts(p, n, part, rays));
    CLN_TRY(put_counts(p, n, rays, max_samples, starts));
    CLN_TRY(share_intervals(p, n, part, starts));
done:
    free(rays);
    free(starts);
    return st;
}
