/* A pipeline shared by ranks (host/ranks): which leaves' weights are here, and what the ranks tell
 * each other about the rest. With one rank nothing is done.
 *
 *   every rank has        the tree, stage 1's densities, rays and their intervals: of all leaves
 *   only its rank has     weights, their gradients, Adam's state: of leaves [first, first + own)
 *   after a refresh       the leaves' densities go to all ranks
 *
 * Training steps share rays by stretches (stretch.h), in which a rank has the samples of its own
 * leaves alone, or, with --exchange samples, and for pictures, by samples: all ranks place all
 * samples, each sample's colour and density go to all ranks after the forward pass, all composite
 * all rays, and each takes its own leaves' gradients, bit for bit those of one rank. No weight or
 * gradient travels, except weights of leaves that are dealt to another rank, and those of vertices
 * that voxels of several ranks have in common (halo.h). */
#ifndef CLN_SHARE_H
#define CLN_SHARE_H

#include "pipeline/pipeline.h"

/* CLN_USAGE unless all ranks run the same version, and will place the same samples in the same
 * batches: their devices are of one kind and have room for as much. room: the plan's most
 * samples, samples aimed at, most rays. */
cln_status cln_share_agree(const cln_pipeline *p, const size_t room[3]);

/* Set p->rank_first, each rank's first leaf. Evenly: all ranks get equally many. Change: after a
 * change of the tree, new leaves stay on the rank of the old ones that they come from. */
void cln_share_evenly(cln_pipeline *p, int leaves);
void cln_share_change(cln_pipeline *p, const cln_octree_change *change);

/* Takes this rank's leaves of a new tree's p->leaves; without ranks, all of them. */
cln_status cln_share_begin(cln_pipeline *p);

/* Row of a leaf's weights in the arrays here, -1 if another rank has it. */
static inline int cln_share_row(const cln_pipeline *p, int slot)
{
    return slot >= p->first && slot < p->first + p->own ? slot - p->first : -1;
}

/* Makes room for messages on the host, in p->message. */
cln_status cln_share_room(cln_pipeline *p, size_t bytes);

/* Makes p->leaf_rank [leaf], if it is missing. */
cln_status cln_share_leaf_ranks(cln_pipeline *p);

/* Each rank has measured its own leaves since the last time: brings p->leaf_sums and p->leaf_met of
 * all leaves to all ranks. */
cln_status cln_share_sums(cln_pipeline *p);

/* Count: in a step shared by stretches, counts this rank's `own` samples of all `samples`, and
 * sends p->told to the other ranks without waiting. Met: waits for theirs; CLN_CL unless all ranks
 * agree on the samples and stretches. */
cln_status cln_share_count(cln_pipeline *p, uint32_t own, uint32_t samples);
cln_status cln_share_met(cln_pipeline *p);

/* After the forward pass: brings p->out of all samples to all ranks, and counts the samples of a
 * training step. Also exchanges p->told. */
cln_status cln_share_samples(cln_pipeline *p, uint32_t samples, bool training);
/* After a refresh of leaves [first, first + count) by the ranks that have them: brings the new
 * densities to all ranks. */
cln_status cln_share_densities(cln_pipeline *p, const cln_buffer *density, int first, int count);

/* Get: brings this rank's rows of an array P or of adam_steps to `array` [leaf]. Collect: brings
 * the rows of all ranks to rank 0's `array`. */
cln_status cln_share_get(cln_pipeline *p, cln_buffer_id id, void *array);
void cln_share_collect(cln_pipeline *p, cln_buffer_id id, void *array);

/* The most leaves that a rank can get of `leaves` by moves: 1.5 times the mean. After a change of
 * the tree it may have more, until the next balance, as it keeps what comes from its own. */
int cln_share_most(const cln_pipeline *p, int leaves);

typedef struct cln_share_move {
    int leaves;           /* leaves that changed their rank */
    double before, after; /* the busiest rank's work over the mean; after: had they moved before */
} cln_share_move;

/* Moves leaves between ranks, weights and all, if the busiest rank has recently had more than LIMIT
 * times the mean work. */
cln_status cln_share_balance(cln_pipeline *p, cln_share_move *out);

/* Lend: before a task of uneven work, work[leaf], moves leaves so that ranks share it evenly, if
 * that saves time. Return: moves them back. *lent: where they were, NULL if they stayed; the caller
 * frees it. */
cln_status cln_share_lend(cln_pipeline *p, const double *work, int **lent);
cln_status cln_share_return(cln_pipeline *p, const int *lent);

#endif
