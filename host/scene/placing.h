/* For readers whose dataset tells the names of its images, but not their folder. Private to this
 * room. */
#ifndef CLN_SCENE_PLACING_H
#define CLN_SCENE_PLACING_H

#include "scene/reader.h"

/* Fills the paths of the views, whose names are known, from the first folder that has any of them.
 * It tries for each of `bases`, nearest first: images, images_2, images_4, images_8, the base
 * itself, any other folder in it; then the same for names in another case, then the ends of names
 * in the scene (moved.h); CLN_INPUT if no folder has one. Warns if images of the folder are
 * no views. *folder: that folder; the caller frees it. */
cln_status cln_dataset_find_images(const char *where, const char *scene, const char *const *bases,
                                   int base_count, cln_reader_result *result, char **folder);

#endif
