/* The tree of a shell space (scene/space.h), whose root has seven pieces: the core, its middle half
 * along each axis, and six faces around it; what is in the outer quarters of two axes or more is in
 * no piece. */
#ifndef CLN_SHELL_TREE_H
#define CLN_SHELL_TREE_H

#include "model/octree.h"

/* Makes all leaves of `level`, at least 2, in the faces, and of the next level in the core: these
 * are as large as leaves of `level` would be if the tree had the core alone. CLN_MEMORY. */
cln_status cln_shell_tree_create(int level, cln_octree *out);

/* The most leaves that a ray can meet: the core's and those of five faces. CLN_MEMORY. */
cln_status cln_shell_tree_most_intervals(const cln_octree *tree, int *most);

/* The same for any tree down to `level`. */
double cln_shell_most_intervals(int level);

/* Does the point of the cube lie in the core or a face? */
bool cln_shell_holds(const double cube[3]);

#endif
