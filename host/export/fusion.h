/* Rendered depths of many views as one function of space, whose zero is the surface: truncated
 * signed distances along the rays, averaged (Curless, Levoy, "A Volumetric Method for Building
 * Complex Models from Range Images", SIGGRAPH 1996), asked at single points instead of kept on a
 * grid. A level of density would be another surface with every training: how soft a field is where
 * it becomes opaque depends on the photos, while depths are what training fits. */
#ifndef CLN_FUSION_H
#define CLN_FUSION_H

#include "render/open_run.h"

typedef struct cln_fusion_view cln_fusion_view;

/* In a shell space only the core is fused, as if it were a plain space, whose points these are. */
typedef struct cln_fusion {
    const cln_space *space; /* the caller's, or &core: a fusion is not copied */
    cln_space core;
    double to_tree; /* from its points to the tree's */
    const cln_octree *tree;
    int count;
    cln_fusion_view *views; /* [count] */
    double pixel;           /* median width of a pixel where views see a surface; in the cube */
    double faint;           /* share of what views show, but at outlines, that is seen through */
    double band;            /* how far behind a surface a view still counts; in the cube */
} cln_fusion;

/* Renders up to 100 training views, evenly chosen, of at most 800 pixels across, and keeps their
 * depths. The run is started and has a scene. band is the caller's to set. CLN_INPUT if no view
 * sees anything opaque. */
cln_status cln_fusion_make(cln_open_run *opened, const cln_callbacks *callbacks, cln_fusion *out);
void cln_fusion_free(cln_fusion *fusion); /* accepts a zeroed one */

/* The same from depths of any origin: room for `count` views, then each view's camera (scene units)
 * and depths, [height][width] along the ray in the cube (in camera units, if the space is forward),
 * below 0 where nothing opaque is; they become the fusion's. Space and tree stay the caller's.
 * *pixel: of this view, 0 if all is below 0. CLN_MEMORY. */
cln_status cln_fusion_start(const cln_space *space, const cln_octree *tree, int count,
                            cln_fusion *out);
cln_status cln_fusion_set(cln_fusion *fusion, int view, const cln_camera *camera, float *depth,
                          double *pixel);

/* The value at a point of its space's cube: -1 .. 1, above 0 behind the surface; 1 behind all
 * surfaces, -1 where no view sees or where the tree is empty. */
float cln_fusion_at(const cln_fusion *fusion, const float at[3]);

/* How many views see a point of the surface from its front (normal: unit). Sets the unit direction
 * from the eye of the one that does so most; none: left as it is. */
int cln_fusion_seen(const cln_fusion *fusion, const float at[3], const float normal[3],
                    float towards[3]);

#endif
