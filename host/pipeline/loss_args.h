/* The arguments of the loss of a ray, in the order in which kernels have them (kernels/loss.h):
 * written once for composite.cl and stretch.cl. */
#ifndef CLN_LOSS_ARGS_H
#define CLN_LOSS_ARGS_H

#include "pipeline/stage1.h"

/* Weights as the kernels take them. Arguments point into it: it must stay until the launch. */
typedef struct cln_loss_args {
    cl_float scale, huber, alpha, cauchy, opacity, distort, depth;
} cln_loss_args;

/* The weights for a batch of n rays: its loss is the mean over pixels. */
cln_loss_args cln_loss_args_of(const cln_pipeline *p, int n);

/* Adds DEPTH_ARGUMENTS: nothing unless the loss of depths is built in. */
void cln_loss_add_depth(const cln_pipeline *p, const cln_loss_args *loss, cln_args *args);

/* Adds all arguments from `scale` to MEASURE_ARGUMENT. */
void cln_loss_add(const cln_pipeline *p, const cln_loss_args *loss, cln_args *args);

#endif
