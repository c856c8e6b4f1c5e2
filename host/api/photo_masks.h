/* Masks of the photos whose poses are to be found, given or their own alpha: COLMAP looks for no
 * features where they are black. Given ones become the scene's, in its folder masks, where readers
 * find them (scene/masks.c). */
#ifndef CLN_PHOTO_MASKS_H
#define CLN_PHOTO_MASKS_H

#include "api/colmap.h"

/* Whether `masks` is a PNG or JPEG file, of all photos, or a folder with such; among: the masks in
 * the folder `photos`, which are those that count if it is the same. CLN_INPUT; CLN_USAGE if it has
 * the folder of photos. */
cln_status cln_photo_masks_check(const char *masks, const char *photos, const cln_names *among);

/* The folder that stands for the masks `among` photos, of which there are some: one called masks,
 * else that of the photos. The caller frees *out. */
cln_status cln_photo_masks_among(const char *photos, const cln_names *among, char **out);

/* Links or copies them to the folder `masks` of the scene `out`, unless they are there. CLN_OUTPUT
 * if that has others. */
cln_status cln_photo_masks_link(const char *masks, const char *photos, const cln_names *among,
                                const char *out);

/* Writes those of c->photos, and what their own alpha cuts away, as COLMAP reads them to a new
 * folder, *folder, which the caller frees (NULL: there is nothing), and says how many there are.
 * CLN_INPUT if masks were given and none is any photo's; CLN_OUTPUT, CLN_MEMORY, CLN_SIGINT,
 * CLN_SIGTERM. */
cln_status cln_photo_masks_write(const cln_colmap *c, char **folder);

#endif
