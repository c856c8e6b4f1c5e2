/* The surface of a run, as its training views see it, as a coloured mesh. Shared by the exports of
 * points and meshes. */
#ifndef CLN_SURFACE_H
#define CLN_SURFACE_H

#include "export/fusion.h"
#include "export/parts.h"
#include "export/triangles.h"
#include "render/crop.h"

/* Width of a cell of the finest leaves' cached densities, in the cube. */
double cln_surface_cell(const cln_model *model);

/* Traces the surface in the fused depths of views (fusion.h), whose band it sets, by marching cubes
 * (marching.h); sets all but colours. cells: of a uniform grid along an axis of the cube; 0: as
 * many as `cell` (width of the finest detail to expect, that of the deepest leaves, in the cube)
 * and the views' pixels call for, and fewer where leaves are less deep. closed: also traces what no
 * view sees. crop: six planes of the fusion's space (render/crop.h) that the surface is cut to, or
 * NULL; it is open there, or `closed` by their faces. CLN_MEMORY for more vertices than memory has
 * room for. A surface without faces is not an error. */
cln_status cln_surface_trace(cln_fusion *fusion, int cells, double cell, bool closed,
                             const float (*crop)[4], const cln_callbacks *callbacks,
                             cln_surface *out);

double cln_surface_area(const cln_surface *s, size_t face); /* of a face, in the cube */

typedef struct cln_surface_desc {
    cln_open_run *opened; /* started, with a scene; the cameras of the pipeline are replaced */
    double spacing;       /* of a uniform grid, scene units; 0 = by leaves and views */
    bool closed;          /* also what no training view sees */
    const cln_crop *crop; /* placed; may be off */
    cln_parts *parts;     /* NULL: all stay; else only the largest, and this tells of them */
    const cln_callbacks *callbacks;
} cln_surface_desc;

/* cln_surface_trace of the training views' rendered depths, and colours as the view that sees a
 * place most from the front would see it. CLN_USAGE for a grid that is too fine, CLN_MEMORY,
 * CLN_INPUT if no view sees a surface, or none in the crop box. */
cln_status cln_surface_make(const cln_surface_desc *desc, cln_surface *out);

#endif
