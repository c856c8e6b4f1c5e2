/* A training step's rays shared by ranks. See stretch.h. */
#include "pipeline/stretch.h"

#include <string.h>

#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "ranks/ranks.h"

bool cln_stretch_wanted(const cln_pipeline *p)
{
    return p->ranks > 1 && p->config.exchange == CLN_EXCHANGE_STRETCHES &&
           cln_pipeline_extra_samples(p) == 0;
}

cln_status cln_stretch_find(cln_pipeline *p, int n, int me)
{
    cln_status st = CLN_OK;
    const size_t wg = (size_t)p->tune.wg, rays = (size_t)n;
    const cl_uint count = (cl_uint)n, own = (cl_uint)me;

    CLN_TRY(cln_share_leaf_ranks(p));
    CLN_TRY(CLN_RESERVE(p, own_counts, rays));
    CLN_TRY(CLN_RESERVE(p, own_starts, rays + 1));
    CLN_TRY(CLN_RESERVE(p, stretch_counts, rays));
    CLN_TRY(CLN_RESERVE(p, stretch_starts, rays + 1));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.stretch_count, CLN_STAGE_INTERVALS, cln_groups(rays, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->used.mem), CLN_ARG(p->leaf_rank.mem),
                       CLN_ARG(p->own_counts.mem), CLN_ARG(p->stretch_counts.mem), CLN_ARG(count),
                       CLN_ARG(count), CLN_ARG(own)));
    CLN_TRY(cln_stage_scan(p, &p->own_counts, &p->own_starts, count, CLN_STAGE_INTERVALS, NULL));
    CLN_TRY(cln_stage_scan(p, &p->stretch_counts, &p->stretch_starts, count, CLN_STAGE_INTERVALS,
                           &p->stretch_total));
    CLN_TRY(CLN_RESERVE(p, stretch_rank, p->stretch_total));
    CLN_TRY(CLN_RESERVE(p, stretch_first, (size_t)p->stretch_total + 1));
    CLN_TRY(CLN_RESERVE(p, stretch_sums, p->stretch_total));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.stretch_list, CLN_STAGE_INTERVALS, cln_groups(rays, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->used.mem), CLN_ARG(p->leaf_rank.mem),
                       CLN_ARG(p->own_starts.mem), CLN_ARG(p->stretch_starts.mem),
                       CLN_ARG(p->stretch_rank.mem), CLN_ARG(p->stretch_first.mem), CLN_ARG(count),
                       CLN_ARG(count), CLN_ARG(own)));
done:
    return st;
}

cln_status cln_stretch_cut(cln_pipeline *p, int n, uint32_t *samples)
{
    cln_status st = CLN_OK;
    const size_t at = (size_t)n * sizeof(cl_uint);

    CLN_TRY(cln_buffer_read(p->device, &p->own_starts, at, samples, sizeof *samples));
    CLN_TRY(cln_buffer_read(p->device, &p->stretch_starts, at, &p->stretch_total,
                            sizeof p->stretch_total));
done:
    return st;
}

/* Adds what kernels have only if the loss of depths is built in; *depth: its weight, which must
 * stay until the launch. */
static int add_depth(const cln_pipeline *p, const cl_float *depth, cln_arg *args)
{
    const cln_arg all[] = {CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem), CLN_ARG(p->shown.mem),
                           CLN_ARG(*depth)};

    if (p->config.depth_loss <= 0)
        return 0;
    memcpy(args, all, sizeof all);
    return sizeof all / sizeof *all;
}

cln_status cln_stretch_composite(cln_pipeline *p, int n, int me)
{
    const cl_uint rays = (cl_uint)n, own = (cl_uint)me;
    const cl_float depth = (float)p->config.depth_loss;
    const size_t wg = (size_t)p->tune.wg;
    cln_arg args[13] = {CLN_ARG(p->intervals.mem),
                        CLN_ARG(p->stretch_starts.mem),
                        CLN_ARG(p->stretch_rank.mem),
                        CLN_ARG(p->stretch_first.mem),
                        CLN_ARG(p->samples.mem),
                        CLN_ARG(p->out.mem),
                        CLN_ARG(p->stretch_sums.mem),
                        CLN_ARG(rays),
                        CLN_ARG(own)};
    const int count = 9 + add_depth(p, &depth, args + 9);

    return cln_launch(p->device, p->k.stretch_composite, CLN_STAGE_COMPOSITE, cln_groups(rays, wg),
                      wg, args, count);
}

/* In a message, the stretches of each rank are a run, in the order of all. */
cln_status cln_stretch_exchange(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const size_t count = p->stretch_total, row = cln_buffer_row_bytes(p, CLN_BUFFER_stretch_sums);
    const int me = cln_ranks_me();
    int first[CLN_RANKS_MOST + 1] = {0}, next[CLN_RANKS_MOST] = {0};
    const uint32_t *rank = NULL;
    char *sums = NULL, *sent = NULL;

    CLN_TRY(cln_share_room(p, count * (2 * row + sizeof *rank)));
    sums = p->message;
    sent = sums + count * row;
    rank = (const uint32_t *)(sent + count * row);
    CLN_TRY(
        cln_buffer_read(p->device, &p->stretch_rank, 0, sent + count * row, count * sizeof *rank));
    CLN_TRY(cln_buffer_read(p->device, &p->stretch_sums, 0, sums, count * row));
    for (size_t k = 0; k < count; k++)
        first[rank[k] + 1]++;
    for (int r = 0; r < p->ranks; r++) {
        next[r] = first[r];
        first[r + 1] += first[r];
    }
    for (size_t k = 0; k < count; k++)
        if ((int)rank[k] == me)
            memcpy(sent + (size_t)next[me]++ * row, sums + k * row, row);
    p->stretches_own += next[me] - first[me];
    p->stretches_all += (double)count;
    next[me] = first[me];
    CLN_TRY(cln_share_met(p));
    cln_ranks_gather(sent, row, first, true);
    for (size_t k = 0; k < count; k++)
        memcpy(sums + k * row, sent + (size_t)next[rank[k]]++ * row, row);
    CLN_TRY(cln_buffer_write(p->device, &p->stretch_sums, 0, sums, count * row));
done:
    return st;
}

cln_status cln_stretch_train(cln_pipeline *p, int n, int me, uint32_t samples)
{
    cln_status st = CLN_OK;
    const cl_uint rays = (cl_uint)n, own = (cl_uint)me;
    const size_t wg = (size_t)p->tune.wg;
    const cl_float scale = n ? 1.0f / (float)n : 0.0f, huber = (float)p->config.huber_delta;
    const cl_float alpha = (float)p->opacity_loss, cauchy = (float)p->config.cauchy;
    const cl_float opacity = (float)p->config.opacity_entropy;
    const cl_float distort = (float)p->config.distortion_loss;
    const cl_float depth = (float)p->config.depth_loss;
    cln_arg args[24] = {CLN_ARG(p->intervals.mem),
                        CLN_ARG(p->stretch_starts.mem),
                        CLN_ARG(p->stretch_rank.mem),
                        CLN_ARG(p->stretch_first.mem),
                        CLN_ARG(p->samples.mem),
                        CLN_ARG(p->out.mem),
                        CLN_ARG(p->backgrounds.mem),
                        CLN_ARG(p->targets.mem),
                        CLN_ARG(p->stretch_sums.mem),
                        CLN_ARG(p->dout.mem),
                        CLN_ARG(p->results.mem),
                        CLN_ARG(rays),
                        CLN_ARG(own),
                        CLN_ARG(scale),
                        CLN_ARG(huber),
                        CLN_ARG(alpha),
                        CLN_ARG(cauchy),
                        CLN_ARG(opacity),
                        CLN_ARG(distort)};
    int count = 19 + add_depth(p, &depth, args + 19);

    CLN_TRY(CLN_RESERVE(p, dout, samples));
    CLN_TRY(CLN_RESERVE(p, measures, samples));
    if (cln_pipeline_measures(&p->config) > 0)
        args[count++] = (cln_arg)CLN_ARG(p->measures.mem);
    CLN_TRY(cln_launch(p->device, p->k.stretch_train, CLN_STAGE_COMPOSITE, cln_groups(rays, wg), wg,
                       args, count));
done:
    return st;
}
