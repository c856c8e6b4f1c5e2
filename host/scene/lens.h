/* Lens models: the way from a direction to its place in the image, and back. The device's twin is
 * kernels/lens.h.
 *
 *   direction (x, y, z) in camera axes     distort ->  <- undistort     place (a', b')
 *
 * The camera turns a place into a pixel position: u = fx a' + cx, v = fy b' + cy. Models:
 *   OPENCV   parameters k1 k2 p1 p2; all 0: a pinhole. With a = x/z, b = y/z, r2 = a^2 + b^2,
 *              a' = a (1 + k1 r2 + k2 r2^2) + 2 p1 a b + p2 (r2 + 2 a^2)
 *              b' = b (1 + k1 r2 + k2 r2^2) + p1 (r2 + 2 b^2) + 2 p2 a b
 * To add one: its name in cln_lens, its row and two functions in lens.c, its branch in
 * kernels/lens.h, its row in tests/scene/test_camera.c. Readers find it by its name. */
#ifndef CLN_LENS_H
#define CLN_LENS_H

#include <stdbool.h>

typedef enum { CLN_LENS_OPENCV, CLN_LENSES } cln_lens;

enum { CLN_LENS_PARAMS = 4 }; /* the most that a model has */

typedef struct cln_lens_model {
    const char *name;                    /* as datasets call it */
    const char *covers[8];               /* special cases of it that datasets name, up to NULL */
    const char *params[CLN_LENS_PARAMS]; /* their names, as in transforms JSON */
    int count;                           /* number of parameters */
    bool pinhole_at_zero;                /* no distortion means: all parameters are 0 */

    /* False if the direction has no place, being behind the lens. It may have any length. */
    bool (*distort)(const double *params, const double direction[3], double place[2]);

    /* The inverse: a direction, of any length, whose place is this one to 1e-12. That is checked:
     * false if there is none (beyond the model's fold), or if none was found. */
    bool (*undistort)(const double *params, const double place[2], double direction[3]);
} cln_lens_model;

extern const cln_lens_model cln_lens_models[CLN_LENSES];

/* The model of that name, or the one that covers it; CLN_LENSES if there is none. */
cln_lens cln_lens_find(const char *name);

/* Is it a pinhole with these parameters: no distortion. */
bool cln_lens_is_pinhole(cln_lens lens, const double *params);

#endif
