/* The memory plans (pipeline/plan.h) of a training: of the tree that it has, of one that it will
 * have next, and by ranks of the leaves as they are dealt. */
#ifndef CLN_PLANS_H
#define CLN_PLANS_H

#include "train/trainer.h"

typedef struct cln_plans {
    cln_plan device, host;
} cln_plans;

/* What a plan is made of, for a tree of so many leaves and that depth. deal: may be NULL. */
cln_plan_desc cln_plans_desc(const cln_trainer *t, int leaves, int depth, const cln_deal *deal);

/* The plans of the tree as it is, without ranks' deals. */
void cln_plans_now(const cln_trainer *t, cln_plans *out);

/* The plans of a tree with `leaves` leaves after the next change, at most a level deeper. own:
 * those of the rank that will have most, as children stay on their parent's (cln_share_change); 0:
 * not known, so 1.5 times the mean is counted. */
void cln_plans_make(const cln_trainer *t, int leaves, int own, cln_plans *out);

/* Makes them, and tells whether they fit memory; on all ranks, as they change the tree together. If
 * not, cln_error_text() has the reason. */
bool cln_plans_fit(const cln_trainer *t, int leaves, int own, cln_plans *out);

/* Before a change of the tree: takes its plans. After it: no rank has more than was planned. */
void cln_plans_adopt(cln_trainer *t, const cln_plans *plans);
void cln_plans_check_own(const cln_pipeline *p, int own);

/* After leaves were culled, without ranks: takes the plans of those that are left, of which batches
 * may have more samples. So batches depend on the tree alone, not on what it was, and a resumed run
 * has the same. */
void cln_plans_renew(cln_trainer *t);

/* By ranks (else nothing is done), when a tree is new and when leaves have moved: makes the plans
 * of the tree as it is dealt (the pipeline's rank_first), or takes those of an earlier tree or deal
 * if they are larger, as buffers are then; and finds how many leaves a rank may get by moves.
 * Warns, once, of plans above their limits: it is too late to refuse them. */
cln_status cln_plans_deal(cln_trainer *t);

#endif
