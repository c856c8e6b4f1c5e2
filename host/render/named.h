/* Views chosen by the names of their photos. */
#ifndef CLN_NAMED_H
#define CLN_NAMED_H

#include "scene/scene.h"

/* Views of a split: those of `names`, with commas between, or, if that is NULL, `most` of them as
 * cln_quality_choose does. A name is the photo's path in the scene or its file's name, both with or
 * without the ending, or that of the view's pictures; views that share it are all meant. *views:
 * indices into scene->views, in their order, each once; the caller frees it. CLN_USAGE for a name
 * that no view of the split has, with the split that has it, or names that are like it. */
cln_status cln_views_choose(const cln_scene *scene, cln_split split, const char *names, int most,
                            int **views, int *count);

/* CLN_USAGE if both are given. */
cln_status cln_views_check(const char *names, int most);

#endif
