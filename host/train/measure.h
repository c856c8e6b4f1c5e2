/* What decisions about the tree read of the leaves: densities that stage 1 has cached, and sums
 * over the training rays since measuring began anew (method.md 12.2, 12.3). By ranks, each has the
 * measures of all leaves. Decides nothing: model/structure.h and model/integer_program.h do. */
#ifndef CLN_MEASURE_H
#define CLN_MEASURE_H

#include "model/integer_program.h"
#include "model/structure.h"
#include "train/trainer.h"

/* Begins a new interval of measuring, on host and device. CLN_CL. */
cln_status cln_measure_restart(cln_trainer *t);

/* Mean density (--density-weight) and peak of every leaf; the caller frees them, also on failure.
 * Cached densities must be fresh. CLN_MEMORY, CLN_CL. */
cln_status cln_measure_stats(cln_trainer *t, cln_leaf_stats *out);

/* Measures every leaf, (*out)[slot]: error per ray, density, whether it may split, and into which
 * children, (*children)[slot] (children.h): before --cull-from, into all. *fine: how many of those
 * that met enough samples may not for --cell-pixels. Errors also go into the model. fraction: 0..1
 * of the budget. The caller frees both. Cached densities must be fresh, some rays measured, and no
 * results owed. CLN_MEMORY, CLN_CL. */
cln_status cln_measure_leaves(cln_trainer *t, double fraction, cln_leaf_measure **out,
                              uint8_t **children, int *fine);

/* The least pixels of a photo that a voxel may have now: --cell-pixels, and where pixels are means
 * of n x n rays, an n-th of that, as what is between their centres is seen, too. */
double cln_measure_cell_pixels(const cln_trainer *t);

/* *share: of the leaves of the whole level `level`, which the present tree has or may grow to,
 * those that could be split by --max-level and --cell-pixels, however much they are met; 0..1, of a
 * few thousand of them. CLN_MEMORY. */
cln_status cln_measure_can_split(cln_trainer *t, int level, double *share);

#endif
