/* A training step's rays shared by ranks. See stretch.h. */
#include "pipeline/stretch.h"

#include <string.h>

#include "pipeline/loss_args.h"
#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "ranks/ranks.h"

bool cln_stretch_wanted(const cln_pipeline *p)
{
    return p->ranks > 1 && p->config.exchange == CLN_EXCHANGE_STRETCHES &&
           cln_pipeline_extra_samples(p) == 0;
}

cln_status cln_stretch_find(cln_pipeline *p, int n, int me, size_t max_samples)
{
    cln_status st = CLN_OK;
    const size_t wg = (size_t)p->tune.wg, rays = (size_t)n;
    const cl_uint count = (cl_uint)n, own = (cl_uint)me;
    const cl_uint most = max_samples < UINT32_MAX ? (cl_uint)max_samples : UINT32_MAX;

    CLN_TRY(cln_share_leaf_ranks(p));
    CLN_TRY(CLN_RESERVE(p, own_counts, rays));
    CLN_TRY(CLN_RESERVE(p, own_starts, rays + 1));
    CLN_TRY(CLN_RESERVE(p, stretch_counts, rays));
    CLN_TRY(CLN_RESERVE(p, stretch_starts, rays + 1));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.stretch_count, CLN_STAGE_INTERVALS, cln_groups(rays, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->used.mem),
                       CLN_ARG(p->sample_starts.mem), CLN_ARG(p->leaf_rank.mem),
                       CLN_ARG(p->own_counts.mem), CLN_ARG(p->stretch_counts.mem), CLN_ARG(count),
                       CLN_ARG(count), CLN_ARG(own), CLN_ARG(most)));
    CLN_TRY(cln_stage_scan(p, &p->own_counts, &p->own_starts, count, CLN_STAGE_INTERVALS, NULL));
    CLN_TRY(cln_stage_scan(p, &p->stretch_counts, &p->stretch_starts, count, CLN_STAGE_INTERVALS,
                           &p->stretch_total));
    CLN_TRY(CLN_RESERVE(p, stretch_rank, p->stretch_total));
    CLN_TRY(CLN_RESERVE(p, stretch_first, (size_t)p->stretch_total + 1));
    CLN_TRY(CLN_RESERVE(p, stretch_sums, p->stretch_total));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.stretch_list, CLN_STAGE_INTERVALS, cln_groups(rays, wg), wg,
                       CLN_ARG(p->intervals.mem), CLN_ARG(p->used.mem),
                       CLN_ARG(p->sample_starts.mem), CLN_ARG(p->leaf_rank.mem),
                       CLN_ARG(p->own_starts.mem), CLN_ARG(p->stretch_starts.mem),
                       CLN_ARG(p->stretch_rank.mem), CLN_ARG(p->stretch_first.mem), CLN_ARG(count),
                       CLN_ARG(count), CLN_ARG(own), CLN_ARG(most)));
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

/* Adds the first arguments of stretch_composite and stretch_train: the stretches and their
 * samples. */
static void add_stretches(const cln_pipeline *p, cln_args *args)
{
    CLN_ADD(args, p->intervals.mem);
    CLN_ADD(args, p->stretch_starts.mem);
    CLN_ADD(args, p->stretch_rank.mem);
    CLN_ADD(args, p->stretch_first.mem);
    CLN_ADD(args, p->samples.mem);
    CLN_ADD(args, p->out.mem);
}

cln_status cln_stretch_composite(cln_pipeline *p, int n, int me)
{
    const cl_uint rays = (cl_uint)n, own = (cl_uint)me;
    const size_t wg = (size_t)p->tune.wg;
    const cln_loss_args loss = cln_loss_args_of(p, n);
    cln_args a = {.count = 0};

    add_stretches(p, &a);
    CLN_ADD(&a, p->stretch_sums.mem);
    CLN_ADD(&a, rays);
    CLN_ADD(&a, own);
    cln_loss_add_depth(p, &loss, &a);
    return cln_launch(p->device, p->k.stretch_composite, CLN_STAGE_COMPOSITE, cln_groups(rays, wg),
                      wg, a.list, a.count);
}

/* In a message, the stretches of each rank are adjacent; within a rank they keep their order. */
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

static cln_status move_targets(cln_pipeline *p, int n)
{
    const cl_uint rays = (cl_uint)n;
    const size_t wg = (size_t)p->tune.wg;

    return CLN_LAUNCH(p->device, p->k.stretch_pixels, CLN_STAGE_COMPOSITE, cln_groups(rays, wg), wg,
                      CLN_ARG(p->stretch_starts.mem), CLN_ARG(p->stretch_sums.mem),
                      CLN_ARG(p->backgrounds.mem), CLN_ARG(p->pixels.mem), CLN_ARG(p->targets.mem),
                      CLN_ARG(rays));
}

cln_status cln_stretch_train(cln_pipeline *p, int n, int me, uint32_t samples)
{
    cln_status st = CLN_OK;
    const cl_uint rays = (cl_uint)n, own = (cl_uint)me;
    const size_t wg = (size_t)p->tune.wg;
    const cln_loss_args loss = cln_loss_args_of(p, n);
    cln_args a = {.count = 0};

    CLN_TRY(CLN_RESERVE(p, dout, samples));
    CLN_TRY(CLN_RESERVE(p, measures, samples));
    if (p->averaged)
        CLN_TRY(move_targets(p, n));
    add_stretches(p, &a);
    CLN_ADD(&a, p->backgrounds.mem);
    CLN_ADD(&a, p->targets.mem);
    CLN_ADD(&a, p->pixels.mem);
    CLN_ADD(&a, p->stretch_sums.mem);
    CLN_ADD(&a, p->dout.mem);
    CLN_ADD(&a, p->results.mem);
    CLN_ADD(&a, rays);
    CLN_ADD(&a, own);
    cln_loss_add(p, &loss, &a);
    CLN_TRY(cln_launch(p->device, p->k.stretch_train, CLN_STAGE_COMPOSITE, cln_groups(rays, wg), wg,
                       a.list, a.count));
done:
    return st;
}
