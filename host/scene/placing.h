/* For readers whose dataset tells the names of its images, but not their folder. Private to this
 * room. */
#ifndef CLN_SCENE_PLACING_H
#define CLN_SCENE_PLACING_H

#include "scene/reader.h"

/* Fills the paths of the views, whose names are known, from the first folder that has any of them.
 * It tries for each of `bases`, nearest first: images, images_2, images_4, images_8, the base
 * itself, any other folder in it; then the same for names in another case, then the ends of names
 * in the scene (moved.h), then folders in `around` (NULL: none) that have half of them or more;
 * CLN_INPUT if no folder has one. Finds their masks, and warns if other images of the folder are no
 * views. *folder: that folder; the caller frees it. */
cln_status cln_dataset_find_images(const char *where, const char *scene, const char *const *bases,
                                   int base_count, const char *around, cln_reader_result *result,
                                   char **folder);

/* Warns of images beside those of the views, if these are all in one folder that is not the
 * scene's: photos that were added, but have no pose yet. */
cln_status cln_dataset_tell_unposed(const char *scene, const cln_reader_result *result);

/* masks.c: gives views the masks that lie beside their photos, in a folder masks or by the name;
 * warns of those that cannot be used. cln_dataset_find_images does it. */
cln_status cln_dataset_find_masks(const char *scene, const char *images, cln_reader_result *result);
void cln_dataset_tell_masks(const cln_reader_result *result, char text[64]); /* "", or a phrase */
bool cln_dataset_is_mask(const char *name); /* by its name, as OpenDroneMap has it */

#endif
