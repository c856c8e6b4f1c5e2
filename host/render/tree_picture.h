/* Pictures of the octree over rendered views: which leaf holds the surface that each pixel shows,
 * coloured by the leaf's level or by its error. Host work on a picture that was rendered; no
 * device. */
#ifndef CLN_TREE_PICTURE_H
#define CLN_TREE_PICTURE_H

#include <jansson.h>
#include "render/view.h"

/* Active leaves of each level. */
void cln_tree_levels(const cln_octree *tree, int count[CLN_MAX_LEVEL + 1]);

/* slots [height][width]: the leaf at ray origin + depth * direction of each pixel; -1 where the
 * picture is mostly transparent, or that point lies in no active leaf. Depth along the ray. */
void cln_tree_surface(const cln_model *model, const cln_camera *camera, const cln_picture *picture,
                      int32_t *slots);

/* rgb [height][width][3]: the render in grey, blended with the colour of the pixel's leaf (colours
 * [leaf][3]); darker at the borders of leaves; as rendered where there is no slot. */
void cln_tree_draw(const cln_picture *picture, const int32_t *slots, const uint8_t *colours,
                   uint8_t *rgb);

/* The colours of the leaves, [leaf][3], by level or by error. For errors, *low and *high are the
 * ends of the scale, NaN if no error is known. */
void cln_tree_colours(const cln_model *model, bool error, uint8_t *colours, double *low,
                      double *high);

/* Writes FOLDER/NAME.tree.png, by level, and FOLDER/NAME.tree-error.png if the error of any leaf is
 * known. */
cln_status cln_tree_save(const cln_model *model, const cln_view *view, const cln_picture *picture,
                         const char *folder);

/* Writes FOLDER/tree.json, which describes those pictures of `views`, an array of names
 * (docs/formats.md). */
cln_status cln_tree_describe(const cln_model *model, const json_t *views, const char *folder);

#endif
