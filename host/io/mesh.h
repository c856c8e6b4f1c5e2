/* Meshes of triangles and clouds of points as files for other programs: PLY, OBJ, GLB (binary glTF
 * 2.0) and, of triangles alone, binary STL. docs/formats.md says what each has. */
#ifndef CLN_MESH_H
#define CLN_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_mesh {
    size_t vertices, faces; /* faces 0: points */
    double (*at)[3];
    float (*normal)[3];   /* unit */
    uint8_t (*colour)[3]; /* sRGB */
    uint8_t *views;       /* how many views see it, of PLY alone; NULL: not known */
    uint32_t (*face)[3];  /* counter-clockwise as seen from outside */
    double origin[3];     /* a point near all vertices */
    double fine;          /* smallest length that positions must resolve */
    const char *comment;  /* one line */
    /* GLB: how its root node places the numbers; other files have none. */
    double turn[4]; /* unit quaternion x, y, z, w */
    double scale;   /* above 0 */
} cln_mesh;

/* The shortest turn that brings the direction `up` (of any length; all 0: no turn) onto an axis (1:
 * y, 2: z), as a unit quaternion x, y, z, w. Of the opposite one half a turn about x. */
void cln_mesh_upright(const double up[3], int axis, double turn[4]);

/* A vector, turned; out may be v. */
void cln_mesh_turned(const double turn[4], const double v[3], double out[3]);

/* Turns places, origin and normals about 0, and scales all lengths. */
void cln_mesh_place(cln_mesh *mesh, const double turn[4], double scale);

/* Adds to places and origin; not for GLB. */
void cln_mesh_move(cln_mesh *mesh, const double offset[3]);

/* Area of triangle f. normal: outwards, of that length. */
double cln_mesh_area(const cln_mesh *mesh, size_t f, double normal[3]);

/* How far positions move at most as floats. */
double cln_mesh_rounding(const cln_mesh *mesh);

/* Returns whether floats keep positions to a hundredth of `fine`. Else files have doubles, or
 * positions relative to the origin (GLB); STL has floats alone. */
bool cln_mesh_fits_floats(const cln_mesh *mesh);

/* The most bytes that the file may have. */
double cln_mesh_bytes(const cln_mesh *mesh);

/* Writes atomically. CLN_OUTPUT, also for more than the format can count. */
cln_status cln_mesh_write_ply(const char *path, const cln_mesh *mesh);
cln_status cln_mesh_write_obj(const char *path, const cln_mesh *mesh);
cln_status cln_mesh_write_glb(const char *path, const cln_mesh *mesh);
cln_status cln_mesh_write_stl(const char *path, const cln_mesh *mesh);

#endif
