/* Brings a change of the tree to the device. The caller has changed the model before: its tree
 * (model/octree.h) and the arrays that only the host has (cln_model_follow). */
#ifndef CLN_CHANGE_H
#define CLN_CHANGE_H

#include "train/trainer.h"

/* Carries what the device has of each leaf over `change`, and finds again what training views see
 * of the new tree. No results may be owed. CLN_BUILD, CLN_MEMORY, CLN_CL: training cannot go on. */
cln_status cln_change_carry(cln_trainer *t, const cln_octree_change *change);

#endif
