/* Lens models: the way from a direction to its place in the image, and back. The device's twin is
 * kernels/lens.h. docs/method.md section 3.1 has the formulas, with their sources.
 *
 *   direction (x, y, z) in camera axes     distort ->  <- undistort     place (a', b')
 *
 * The camera turns a place into a pixel position: u = fx a' + cx, v = fy b' + cy. Only perspective
 * models divide directions by z, so that a lens may see more than a half-space.
 *
 * A model has a domain: the directions around the axis up to its fold, where places stop moving
 * outwards. Beyond it, directions have no place, as two of them would share one.
 *
 * To add one: its name in cln_lens (include/device_abi.h), its row in lens.c, its branch in
 * kernels/lens.h, its rows in tests/scene/test_lens.c. Readers find it by its name. */
#ifndef CLN_LENS_H
#define CLN_LENS_H

#include <stdbool.h>
#include "device_abi.h"
#include "scene/lens_plane.h"

typedef struct cln_lens_model {
    const char *name;                    /* as COLMAP calls it */
    const char *params[CLN_LENS_PARAMS]; /* their names, as in transforms JSON */
    int count;                           /* number of parameters */
    bool pinhole_at_zero;                /* no distortion means: all parameters are 0 */

    /* Either: how it bends a plane (lens_plane.h). */
    void (*plane)(const double *params, cln_lens_plane *out);

    /* Or: closed forms of both ways, as of cln_lens_distort and cln_lens_undistort. */
    bool (*distort)(const double *params, const double direction[3], double place[2]);
    bool (*undistort)(const double *params, const double place[2], double direction[3]);

    /* Says what is wrong with parameters: a phrase, or NULL if they are right. NULL: all are
     * right. */
    const char *(*refuse)(const double *params);
} cln_lens_model;

extern const cln_lens_model cln_lens_models[CLN_LENSES];

/* The model of that name, or the one that covers it: COLMAP's names, and what nerfstudio calls
 * PERSPECTIVE and FISHEYE624, in any case; CLN_LENSES if there is none. */
cln_lens cln_lens_find(const char *name);

/* Do these parameters make the lens a pinhole, without distortion? */
bool cln_lens_is_pinhole(cln_lens lens, const double *params);

/* The place of a direction, which may have any length. False outside the model's domain. */
bool cln_lens_distort(cln_lens lens, const double *params, const double direction[3],
                      double place[2]);

/* The inverse: a direction, of any length, whose place is this one to 1e-12. That is checked: false
 * if there is none (beyond the model's fold), or if none was found. */
bool cln_lens_undistort(cln_lens lens, const double *params, const double place[2],
                        double direction[3]);

/* Radius of the plane up to which a model's radial part grows (lens_plane.h); INFINITY if there is
 * no end, and for models with closed forms, which check their own. */
double cln_lens_limit(cln_lens lens, const double *params);

/* Whether a model's radius grows with the angle off the axis, as a fisheye's, not with its
 * tangent. */
bool cln_lens_is_fisheye(cln_lens lens);

/* lens_series.c: a radial series of four terms, 1 + k1 t + ... + k4 t^4 with t the squared radius,
 * by FULL_OPENCV's quotient: out has its k1, k2, k3, then k4, k5, k6. place: the largest radius in
 * the image, in focal lengths. Returns what places are off by at most, in focal lengths; infinite
 * if no quotient is near. */
double cln_lens_from_series(const double k[4], double place, double out[6]);

/* ---- COLMAP's camera models ---- */

/* How the parameter list of a COLMAP camera is to be read: `focals` focal lengths (f, or fx fy),
 * cx, cy, then the first parameters of the lens model, in its order. No focal length: the list is
 * w, h, and the image spans the sphere. Place in the table: COLMAP's id of the model. */
typedef struct cln_colmap_model {
    const char *name;
    cln_lens lens;
    int focals, count; /* count: length of the list */
} cln_colmap_model;

enum {
    CLN_COLMAP_EQUIRECTANGULAR = 17,
    CLN_COLMAP_MODELS,
    CLN_COLMAP_PARAMS = 4 + CLN_LENS_PARAMS /* the longest list */
};
extern const cln_colmap_model cln_colmap_models[CLN_COLMAP_MODELS];

/* The one of that name, in any case; NULL if there is none. */
const cln_colmap_model *cln_colmap_find(const char *name);

/* Splits such a list, values[model->count], into fx, fy, cx, cy and the lens model's parameters, of
 * which those that the list lacks are 0. */
void cln_colmap_split(const cln_colmap_model *model, const double *values, double pixels[4],
                      double params[CLN_LENS_PARAMS]);

#endif
