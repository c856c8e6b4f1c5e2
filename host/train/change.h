/* Brings a change of the tree to the device. The caller has changed the model before: its tree
 * (model/octree.h) and the arrays that only the host has (cln_model_follow). */
#ifndef CLN_CHANGE_H
#define CLN_CHANGE_H

#include "train/plans.h"

/* Carries what the device has of each leaf over `change`, and finds again what training views see
 * of the new tree. No results may be owed. CLN_BUILD, CLN_MEMORY, CLN_CL: training cannot go on. */
cln_status cln_change_carry(cln_trainer *t, const cln_octree_change *change);

/* The same for a change that may add leaves, or for which measuring begins anew: by the plans that
 * were made for it, of at most `own` leaves on a rank (cln_plans_make). */
cln_status cln_change_adopt(cln_trainer *t, const cln_octree_change *change, const cln_plans *plans,
                            int own);

#endif
