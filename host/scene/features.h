/* Marks of a photo that other photos of the same place show, too: corners and blobs at their scale,
 * each with a description that turning, resizing and brightness do not change (Lowe, "Distinctive
 * Image Features from Scale-Invariant Keypoints", IJCV 2004). For comparing photos with their poses
 * (agree.h); poses are found by other programs. Knows no cameras. */
#ifndef CLN_FEATURES_H
#define CLN_FEATURES_H

#include <stdint.h>
#include "scene/scene.h"

enum { CLN_FEATURE_BYTES = 128, CLN_FEATURES_MOST = 600 };

typedef struct cln_feature {
    float u, v;  /* pixel position in the view */
    float value; /* mean grey around it, 0..1, straight colours, of what is kept; NAN: beside what
                    is cut away */
    uint8_t about[CLN_FEATURE_BYTES];
} cln_feature;

typedef struct cln_features {
    int count;
    int cut; /* behind these, on or beside what masks drop or alpha makes transparent */
    cln_feature *list;
    double pixel; /* side of a pixel of the searched copy, in pixels of the view */
} cln_features;

/* Finds the features of highest contrast in a loaded view, at most CLN_FEATURES_MOST of either
 * kind; a large view is searched in a smaller copy. The caller frees out->list. */
cln_status cln_features_find(const cln_view *view, cln_features *out);

/* Those on what was cut away, as a list of their own within `all`. */
cln_features cln_features_cut(const cln_features *all);

typedef struct cln_match {
    int a, b; /* places in the two lists */
} cln_match;

/* Pairs of features that are each other's nearest and much nearer than the second nearest; out:
 * room for CLN_FEATURES_MOST. Returns their number. */
int cln_features_match(const cln_features *a, const cln_features *b, cln_match *out);

#endif
