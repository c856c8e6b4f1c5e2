/* Two photos of a scene that may be one, or two with one pose. Measures alone; the sentences about
 * them are inspect.c's. */
#ifndef CLN_COPIES_H
#define CLN_COPIES_H

#include "scene/photos.h"
#include "scene/scene.h"

typedef enum cln_pair {
    CLN_PAIR_APART,     /* nothing of these */
    CLN_PAIR_COPY,      /* one photo twice */
    CLN_PAIR_NOISE,     /* alike but for noise, from one place: the camera stood still */
    CLN_PAIR_SAME_POSE, /* different photos with one pose */
} cln_pair;

/* What views a and b, which are loaded, are to each other; photos: [view]. One frame that the val
 * and the test set share, as in many datasets, is no copy; nor are two that differ a little, of
 * places apart, if both are known to fit their poses, as in a light field. */
cln_pair cln_pair_of(const cln_scene *scene, const cln_photo *photos, int a, int b, bool posed);

#endif
