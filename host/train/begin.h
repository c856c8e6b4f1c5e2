/* The model that a training begins with: on a first tree, on the tree of another run (--tree-from),
 * or of its own checkpoint (--resume). Not the plans, nor the device's part (plans.h, loop.h). */
#ifndef CLN_BEGIN_H
#define CLN_BEGIN_H

#include "train/trainer.h"

/* Checks settings that a checkpoint fixes: the shape of a leaf's numbers, whatever the kernels'
 * layout depends on (CLN_CHECKPOINT), and --tree-from (CLN_USAGE). */
cln_status cln_begin_check_saved(const cln_config *saved, const cln_config *wanted);

/* Checks before any work that there is a run to take the tree from. As reading a run fails. */
cln_status cln_begin_check_tree(const char *run);

/* Fills t->model, for t->desc and t->scene; of a resumed run also t->trained, and its space for the
 * scene. CLN_CHECKPOINT, CLN_USAGE: settings that do not fit it; CLN_INPUT, CLN_MEMORY. */
cln_status cln_begin_model(cln_trainer *t, const cln_config *config);

#endif
