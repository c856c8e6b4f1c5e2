/* The surface of a run, as its training views see it, as a coloured mesh. What the exports of
 * points and meshes have in common. */
#ifndef CLN_SURFACE_H
#define CLN_SURFACE_H

#include "export/fusion.h"
#include "export/triangles.h"

/* Width of a cell of the finest leaves' cached densities, in the cube. */
double cln_surface_cell(const cln_model *model);

/* Marching cubes (marching.h) of the depths of views (fusion.h), whose band it sets: all but
 * colours. `cells` along an axis of the cube, a uniform grid; 0: as many as `cell` (the width of
 * the finest detail to expect, in the cube: that in the deepest leaves) and the views' pixels ask
 * for, and fewer where leaves are less deep. `closed`: also what no view sees. CLN_MEMORY for more
 * vertices than memory has room for; no face is no error. */
cln_status cln_surface_trace(cln_fusion *fusion, int cells, double cell, bool closed,
                             const cln_callbacks *callbacks, cln_surface *out);

typedef struct cln_surface_desc {
    cln_open_run *opened; /* started, with a scene; the cameras of the pipeline are replaced */
    double spacing;       /* of a uniform grid, scene units; 0 = by leaves and views */
    bool closed;          /* also what no training view sees */
    const cln_callbacks *callbacks;
} cln_surface_desc;

/* cln_surface_trace of the training views' rendered depths, and colours as the view that sees a
 * place most from the front would see it. CLN_USAGE for a grid that is too fine, CLN_MEMORY,
 * CLN_INPUT if no view sees a surface. */
cln_status cln_surface_make(const cln_surface_desc *desc, cln_surface *out);

#endif
