/* A pipeline shared by ranks. See share.h. */
#include "pipeline/share.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/memory.h"
#include "cl_nascent.h"
#include "ranks/ranks.h"

cln_status cln_share_agree(const cln_pipeline *p, const size_t room[3])
{
    cln_status st = CLN_OK;
    const char *name = p->device->info.name;
    char text[CLN_TUNE_TEXT];
    uint64_t device = CLN_DIGEST_START;

    if (p->ranks <= 1)
        return CLN_OK;
    CLN_TRY(cln_ranks_agree(cln_digest(CLN_DIGEST_START, CLN_VERSION, strlen(CLN_VERSION)),
                            "version of this program"));
    cln_tune_text(&p->tune, text);
    device = cln_digest(device, text, strlen(text));
    device = cln_digest(device, name, strlen(name));
    device = cln_digest(device, room, 3 * sizeof *room);
    CLN_TRY(cln_ranks_agree(device, "device, or room on it for batches,"));
done:
    return st;
}

/* ---- who has which leaves ---- */

static void take_own(cln_pipeline *p)
{
    const int me = cln_ranks_me();

    p->first = p->rank_first[me];
    p->own = p->rank_first[me + 1] - p->first;
    p->leaf_rank_there = false;
    p->common.there = false;
}

void cln_share_evenly(cln_pipeline *p, int leaves)
{
    for (int r = 0; p->ranks > 1 && r <= p->ranks; r++)
        p->rank_first[r] = (int)((int64_t)leaves * r / p->ranks);
}

void cln_share_change(cln_pipeline *p, const cln_octree_change *change)
{
    int next = 1;

    if (p->ranks <= 1)
        return;
    for (int s = 0; s < change->count; s++) /* old slots ascend with the new ones */
        while (next < p->ranks && change->from[s] >= p->rank_first[next])
            p->rank_first[next++] = s;
    while (next <= p->ranks)
        p->rank_first[next++] = change->count;
}

cln_status cln_share_begin(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    p->own = p->leaves;
    if (p->ranks <= 1)
        return CLN_OK;
    CLN_ASSERT(p->rank_first[p->ranks] == p->leaves);
    take_own(p);
    free(p->load);
    CLN_TRY(cln_alloc(&p->load, (size_t)p->leaves, sizeof *p->load, "load of leaves"));
done:
    return st;
}

/* ---- samples and densities ---- */

cln_status cln_share_room(cln_pipeline *p, size_t bytes)
{
    cln_status st = CLN_OK;

    if (bytes <= p->message_bytes)
        return CLN_OK;
    free(p->message);
    p->message = NULL;
    p->message_bytes = 0;
    CLN_TRY(cln_alloc(&p->message, bytes, 1, "messages to other ranks"));
    p->message_bytes = bytes;
done:
    return st;
}

cln_status cln_share_leaf_ranks(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    uint32_t *rank = NULL;

    if (p->leaf_rank_there)
        return CLN_OK;
    CLN_TRY(cln_share_room(p, (size_t)p->leaves * sizeof *rank));
    rank = (uint32_t *)p->message;
    for (int r = 0; r < p->ranks; r++)
        for (int s = p->rank_first[r]; s < p->rank_first[r + 1]; s++)
            rank[s] = (uint32_t)r;
    CLN_TRY(CLN_PUT(p, leaf_rank, rank, (size_t)p->leaves));
    p->leaf_rank_there = true;
done:
    return st;
}

/* A leaf's work in a step, in samples: its own, and 12 for reading and writing weights and moments
 * once. This holds for networks of any size (docs/results.md, "How cost grows"). */
static double work_of(uint32_t samples)
{
    return samples > 0 ? samples + 12.0 : 0;
}

/* Reads how many grouped samples each of `count` leaves from `first` on has, to p->message. */
static cln_status read_counts(cln_pipeline *p, int first, int count, uint32_t **samples)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)count, at = (size_t)first * sizeof(cl_uint);
    uint32_t *begin = NULL, *end = NULL;

    CLN_TRY(cln_share_room(p, 2 * n * sizeof *begin));
    begin = (uint32_t *)p->message;
    end = begin + n;
    CLN_TRY(cln_buffer_read(p->device, &p->begin, at, begin, n * sizeof *begin));
    CLN_TRY(cln_buffer_read(p->device, &p->end, at, end, n * sizeof *end));
    for (size_t s = 0; s < n; s++)
        begin[s] = end[s] - begin[s];
    *samples = begin;
done:
    return st;
}

/* first[r]: grouped samples before those of rank r. In training, leaves' work is added to
 * p->load. */
static cln_status find_runs(cln_pipeline *p, bool training, int *first)
{
    cln_status st = CLN_OK;
    uint32_t *samples = NULL, busiest = 0;

    CLN_TRY(read_counts(p, 0, p->leaves, &samples));
    first[0] = 0;
    for (int r = 0; r < p->ranks; r++) {
        uint32_t sum = 0;

        for (int s = p->rank_first[r]; s < p->rank_first[r + 1]; s++) {
            p->load[s] += training ? work_of(samples[s]) : 0;
            sum += samples[s];
        }
        first[r + 1] = first[r] + (int)sum;
        busiest = sum > busiest ? sum : busiest;
    }
    if (training) {
        p->samples_own += first[cln_ranks_me() + 1] - first[cln_ranks_me()];
        p->samples_busiest += busiest;
        p->samples_all += first[p->ranks];
    }
done:
    return st;
}

/* Begins to check that all ranks have placed the same samples and stretches: if not, they would
 * wait for each other forever. own: this rank's samples. */
static void meet(cln_pipeline *p, uint32_t samples, uint32_t stretches, uint32_t own)
{
    double *told = p->told;

    told[CLN_TOLD_SAMPLES] = samples;
    told[CLN_TOLD_SAMPLES + 1] = -(double)samples;
    told[CLN_TOLD_STRETCHES] = stretches;
    told[CLN_TOLD_STRETCHES + 1] = -(double)stretches;
    told[CLN_TOLD_OWN] = own;
    cln_ranks_largest_begin(told, CLN_TOLD);
}

static cln_status met(const cln_pipeline *p)
{
    const double *samples = p->told + CLN_TOLD_SAMPLES, *stretches = p->told + CLN_TOLD_STRETCHES;

    cln_ranks_largest_end();
    if (samples[0] == -samples[1] && stretches[0] == -stretches[1])
        return CLN_OK;
    return cln_fail(
        CLN_CL,
        "ranks placed different samples on the same rays (%.0f and %.0f, in %.0f and "
        "%.0f stretches): their devices differ in the last bits; give all ranks devices "
        "of one kind, with one driver",
        -samples[1], samples[0], -stretches[1], stretches[0]);
}

cln_status cln_share_count(cln_pipeline *p, uint32_t own, uint32_t samples)
{
    cln_status st = CLN_OK;
    uint32_t *each = NULL;

    meet(p, samples, p->stretch_total, own);
    p->samples_own += own;
    p->samples_all += samples;
    p->intervals_all += p->interval_total;
    CLN_TRY(read_counts(p, p->first, p->own, &each));
    for (int s = 0; s < p->own; s++)
        p->load[p->first + s] += work_of(each[s]);
done:
    return st;
}

cln_status cln_share_met(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    CLN_TRY(met(p));
    p->samples_busiest += p->told[CLN_TOLD_OWN];
done:
    return st;
}

static cln_status share_rows(cln_pipeline *p, cln_buffer_id id)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves, row = cln_buffer_row_bytes(p, id);

    CLN_TRY(cln_share_room(p, leaves * row));
    CLN_TRY(cln_pipeline_get(p, id, p->message, leaves));
    cln_ranks_gather(p->message, row, p->rank_first, true);
    CLN_TRY(cln_pipeline_put(p, id, p->message, leaves));
done:
    return st;
}

cln_status cln_share_sums(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    if (p->ranks <= 1 || cln_pipeline_measures(&p->config) == 0)
        return CLN_OK;
    CLN_TRY(share_rows(p, CLN_BUFFER_leaf_sums));
    CLN_TRY(share_rows(p, CLN_BUFFER_leaf_met));
done:
    return st;
}

cln_status cln_share_samples(cln_pipeline *p, uint32_t samples, bool training)
{
    cln_status st = CLN_OK;
    const int me = cln_ranks_me();
    const size_t wg = (size_t)p->tune.wg, each = sizeof(cl_float4);
    int runs[CLN_RANKS_MOST + 1];
    cl_uint first = 0, end = 0, count = 0;
    const cl_uint n = samples;

    if (p->ranks <= 1 || p->stretched)
        return CLN_OK;
    meet(p, samples, 0, 0);
    CLN_TRY(met(p));
    CLN_TRY(find_runs(p, training, runs));
    CLN_ASSERT(runs[p->ranks] == (int)samples);
    first = (cl_uint)runs[me];
    end = (cl_uint)runs[me + 1];
    count = end - first;
    CLN_TRY(CLN_RESERVE(p, packed, samples));
    CLN_TRY(cln_share_room(p, samples * each));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.share_pack, CLN_STAGE_COMPOSITE, cln_groups(count, wg), wg,
                       CLN_ARG(p->out.mem), CLN_ARG(p->values[0].mem), CLN_ARG(p->packed.mem),
                       CLN_ARG(first), CLN_ARG(count)));
    CLN_TRY(cln_buffer_read(p->device, &p->packed, first * each, p->message + first * each,
                            count * each));
    cln_ranks_gather(p->message, each, runs, true);
    CLN_TRY(cln_buffer_write(p->device, &p->packed, 0, p->message, first * each));
    CLN_TRY(cln_buffer_write(p->device, &p->packed, end * each, p->message + end * each,
                             (samples - end) * each));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.share_unpack, CLN_STAGE_COMPOSITE, cln_groups(n, wg), wg,
                       CLN_ARG(p->out.mem), CLN_ARG(p->values[0].mem), CLN_ARG(p->packed.mem),
                       CLN_ARG(first), CLN_ARG(end), CLN_ARG(n)));
done:
    return st;
}

cln_status cln_share_densities(cln_pipeline *p, const cln_buffer *density, int first, int count)
{
    cln_status st = CLN_OK;
    const size_t row = cln_buffer_row_bytes(p, CLN_BUFFER_density);
    int runs[CLN_RANKS_MOST + 1];
    size_t mine = 0, after = 0;

    if (p->ranks <= 1)
        return CLN_OK;
    for (int r = 0; r <= p->ranks; r++) {
        const int from = p->rank_first[r] - first;

        runs[r] = from < 0 ? 0 : from > count ? count : from;
    }
    mine = (size_t)runs[cln_ranks_me()] * row;
    after = (size_t)runs[cln_ranks_me() + 1] * row;
    CLN_TRY(cln_share_room(p, (size_t)count * row));
    CLN_TRY(cln_buffer_read(p->device, density, (size_t)first * row + mine, p->message + mine,
                            after - mine));
    cln_ranks_gather(p->message, row, runs, true);
    CLN_TRY(cln_buffer_write(p->device, density, (size_t)first * row, p->message, mine));
    CLN_TRY(cln_buffer_write(p->device, density, (size_t)first * row + after, p->message + after,
                             (size_t)count * row - after));
done:
    return st;
}

cln_status cln_share_get(cln_pipeline *p, cln_buffer_id id, void *array)
{
    const size_t row = cln_buffer_row_bytes(p, id);

    return cln_pipeline_get(p, id, (char *)array + (size_t)p->first * row, (size_t)p->own);
}

void cln_share_collect(cln_pipeline *p, cln_buffer_id id, void *array)
{
    if (p->ranks > 1)
        cln_ranks_gather(array, cln_buffer_row_bytes(p, id), p->rank_first, false);
}

/* ---- balance ---- */

/* Leaves move if the busiest rank has more than this many times the mean work: a move takes as long
 * as some hundred steps lose by waiting for that rank. */
static const double LIMIT = 1.04;

/* Lending pays if the busiest rank needs longer to train its merged leaves in excess of the mean
 * than it takes to move all leaves; training one takes as long as moving WORTH leaves. */
enum { WORTH = 256 };

int cln_share_most(const cln_pipeline *p, int leaves)
{
    return p->ranks > 1 ? (int)ceil(1.5 * leaves / p->ranks) : leaves;
}

/* Leaves may move: ranks have room for their even share or more. */
static bool may_move(const cln_pipeline *p)
{
    return p->ranks > 1 && (int64_t)p->most_own * p->ranks >= p->leaves;
}

/* Finds each rank's first leaf so that all ranks have about the same load. A leaf counts with its
 * own load and, because its densities are computed anew, with a tenth of the mean load. A rank gets
 * at most 1.5 times the mean number of leaves, and no more than its memory has room for. */
static void find_balance(const cln_pipeline *p, const double *load, int *first)
{
    const int by_mean = cln_share_most(p, p->leaves);
    const int most = p->most_own < by_mean ? p->most_own : by_mean;
    double total = 0, sum = 0;
    int rank = 1;

    for (int s = 0; s < p->leaves; s++)
        total += load[s];
    const double each = 0.1 * total / p->leaves;

    total *= 1.1;
    first[0] = 0;
    for (int s = 0; s < p->leaves && rank < p->ranks; s++) {
        const double half = (load[s] + each) / 2;
        const int left = p->leaves - s; /* the ranks after must be able to hold them */

        if ((sum + half > total * rank / p->ranks || s - first[rank - 1] >= most) &&
            left <= most * (p->ranks - rank))
            first[rank++] = s;
        sum += 2 * half;
    }
    while (rank <= p->ranks)
        first[rank++] = p->leaves;
}

/* Load of the busiest rank over the mean. */
static double imbalance(const cln_pipeline *p, const double *load, const int *first)
{
    double most = 0, total = 0;

    for (int r = 0; r < p->ranks; r++) {
        double sum = 0;

        for (int s = first[r]; s < first[r + 1]; s++)
            sum += load[s];
        most = fmax(most, sum);
        total += sum;
    }
    return total > 0 ? most * p->ranks / total : 1;
}

static cln_status move(cln_pipeline *p, cln_buffer_id id, const int *new_first)
{
    cln_status st = CLN_OK;
    const int me = cln_ranks_me();
    const size_t row = cln_buffer_row_bytes(p, id);
    const size_t rows = (size_t)(new_first[me + 1] - new_first[me]);
    char *old = NULL, *new = NULL;

    if (row == 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&old, (size_t)p->own, row, "leaves to other ranks"));
    CLN_TRY(cln_alloc(&new, rows, row, "leaves from other ranks"));
    CLN_TRY(cln_pipeline_get(p, id, old, (size_t)p->own));
    cln_ranks_deal(old, p->rank_first, new, new_first, row);
    CLN_TRY(cln_pipeline_put(p, id, new, rows));
done:
    free(old);
    free(new);
    return st;
}

/* Deals the leaves so that ranks begin at next[rank]; does not move p->load. */
static cln_status deal(cln_pipeline *p, const int *next)
{
    cln_status st = CLN_OK;
    static const cln_buffer_id arrays[] = {CLN_BUFFER_params, CLN_BUFFER_adam_m, CLN_BUFFER_adam_v,
                                           CLN_BUFFER_adam_steps};

    CLN_TRY(cln_share_sums(p));
    for (size_t i = 0; i < sizeof arrays / sizeof arrays[0]; i++)
        CLN_TRY(move(p, arrays[i], next));
    memcpy(p->rank_first, next, sizeof *next * ((size_t)p->ranks + 1));
    take_own(p);
    cln_buffer_free(p->device, &p->grads); /* sized by the leaves of the batches so far */
    CLN_TRY(cln_pipeline_derive(p));
done:
    return st;
}

cln_status cln_share_balance(cln_pipeline *p, cln_share_move *out)
{
    cln_status st = CLN_OK;
    const int me = cln_ranks_me();
    int next[CLN_RANKS_MOST + 1], each[CLN_RANKS_MOST + 1];
    double loads[CLN_RANKS_MOST] = {0};

    *out = (cln_share_move){.before = 1, .after = 1};
    if (!may_move(p))
        return CLN_OK;
    for (int s = p->first; s < p->first + p->own; s++)
        loads[me] += p->load[s];
    for (int r = 0; r <= p->ranks; r++)
        each[r] = r;
    cln_ranks_gather(loads, sizeof *loads, each, true);
    out->before = imbalance(p, loads, each);
    if (out->before > LIMIT) {
        cln_ranks_gather(p->load, sizeof *p->load, p->rank_first, true);
        find_balance(p, p->load, next);
        out->after = imbalance(p, p->load, next);
    }
    if (out->before > LIMIT && out->after < out->before) {
        for (int r = 0; r < p->ranks; r++) /* leaves that are new to rank r */
            for (int s = next[r]; s < next[r + 1]; s++)
                out->leaves += s < p->rank_first[r] || s >= p->rank_first[r + 1];
        CLN_TRY(deal(p, next));
        memset(p->load, 0, sizeof *p->load * (size_t)p->leaves);
    }
    for (int s = 0; s < p->leaves; s++)
        p->load[s] /= 2;
done:
    return st;
}

cln_status cln_share_lend(cln_pipeline *p, const double *work, int **lent)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)p->ranks + 1;
    double total = 0;
    int next[CLN_RANKS_MOST + 1];

    *lent = NULL;
    if (!may_move(p))
        return CLN_OK;
    for (int s = 0; s < p->leaves; s++)
        total += work[s];
    if (!((imbalance(p, work, p->rank_first) - 1) * total / p->ranks * WORTH > p->leaves))
        return CLN_OK;
    find_balance(p, work, next);
    if (imbalance(p, work, next) >= imbalance(p, work, p->rank_first))
        return CLN_OK;
    CLN_TRY(cln_alloc(lent, count, sizeof **lent, "ranks"));
    memcpy(*lent, p->rank_first, count * sizeof **lent);
    CLN_TRY(deal(p, next));
done:
    return st;
}

cln_status cln_share_return(cln_pipeline *p, const int *lent)
{
    return lent ? deal(p, lent) : CLN_OK;
}
