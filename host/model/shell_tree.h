/* The tree of a shell space (scene/space.h), whose root has seven pieces: the core, its middle half
 * along each axis, and six faces around it; what is in two of its outer quarters is in none. */
#ifndef CLN_SHELL_TREE_H
#define CLN_SHELL_TREE_H

#include "model/octree.h"

/* All leaves of a level, at least 2, of the faces, and of the next level of the core, which are as
 * large as a whole tree's of this level would be in a cube alone. CLN_MEMORY. */
cln_status cln_shell_tree_create(int level, cln_octree *out);

/* The most leaves that a ray can meet: the core's and those of five faces. CLN_MEMORY. */
cln_status cln_shell_tree_most_intervals(const cln_octree *tree, int *most);

/* The same of any tree down to a level. */
double cln_shell_most_intervals(int level);

/* Does the point of the cube lie in the core or a face? */
bool cln_shell_holds(const double cube[3]);

#endif
