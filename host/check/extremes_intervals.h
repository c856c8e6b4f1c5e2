/* The tree and the comparison of samples that several subjects share. */
#ifndef CLN_EXTREMES_INTERVALS_H
#define CLN_EXTREMES_INTERVALS_H

#include "check/extremes.h"

/* Makes and uploads a tree without holes, its leaves at levels 1 to 8. */
cln_status cln_extreme_tree(cln_checks *c, cln_model *model);

/* Places samples on the device's rays in that tree: they must fill the chords, in order, each in
 * its leaf. Reports the rows. */
cln_status cln_extreme_chords(cln_checks *c, const cln_octree *tree, int rays, const char *range);

#endif
