/* Measures of single photos, without their poses: sharpness, and a thumbnail to find copies by. */
#ifndef CLN_PHOTOS_H
#define CLN_PHOTOS_H

#include "scene/scene.h"

enum { CLN_THUMB = 16 };

typedef struct cln_photo {
    double sharpness;                   /* NaN where there is no contrast */
    float thumb[CLN_THUMB * CLN_THUMB]; /* mean grey of its parts, 0..1 */
    float mean, contrast;               /* and its standard deviation */
} cln_photo;

/* Measures a loaded view. Sharpness: the mean change of the gradient from pixel to pixel over the
 * mean gradient, where the gradient is strong; a blur makes both smaller, the former more. */
void cln_photo_measure(const cln_view *view, cln_photo *out);

/* Do loaded photos without alpha show one colour alone, as of a camera that failed? Then a text
 * with the first names, and what to do. */
enum { CLN_BLANK_BYTES = 1280 };
bool cln_scene_has_blank(const cln_scene *scene, char text[CLN_BLANK_BYTES]);
bool cln_photo_is_blank(const cln_view *view); /* is this one of them? */

/* Do the training photos that were read show anything? CLN_INPUT if alpha is 0 everywhere in all of
 * them, or they are of one colour and no depth images tell more. All ranks call it. */
cln_status cln_scene_check_shown(const cln_scene *scene);

/* Root mean square difference of two thumbnails; not below that of their means. */
double cln_photo_difference(const cln_photo *a, const cln_photo *b);

#endif
