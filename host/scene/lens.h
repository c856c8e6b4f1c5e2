/* Lens models: where the ray of a direction meets the image, and which direction a place in the
 * image has. kernels/lens.h is the device's twin.
 *
 *   direction (x, y, z), camera axes     distort ->  <- undistort     place (a', b') in the image
 *
 * A camera adds u = fx a' + cx, v = fy b' + cy (pixels). Models:
 *   OPENCV   parameters k1 k2 p1 p2; all 0 is the pinhole. With a = x/z, b = y/z, r2 = a2 + b2:
 *              a' = a (1 + k1 r2 + k2 r2^2) + 2 p1 a b + p2 (r2 + 2 a2)
 *              b' = b (1 + k1 r2 + k2 r2^2) + p1 (r2 + 2 b2) + 2 p2 a b
 * To add one: its name in cln_lens, its row and two functions in lens.c, its branch in
 * kernels/lens.h, its row in tests/scene/test_camera.c. Readers find it by its name. */
#ifndef CLN_LENS_H
#define CLN_LENS_H

#include <stdbool.h>

typedef enum { CLN_LENS_OPENCV, CLN_LENSES } cln_lens;

enum { CLN_LENS_PARAMS = 4 }; /* of the model that has most */

typedef struct cln_lens_model {
    const char *name;                    /* as datasets call it */
    const char *covers[8];               /* their names of its special cases, up to NULL */
    const char *params[CLN_LENS_PARAMS]; /* names of its parameters */
    int count;                           /* of parameters */
    bool pinhole_at_zero;                /* no distortion: all parameters 0 */

    /* False if no such place is in front of the lens. `direction` needs no length. */
    bool (*distort)(const double *params, const double direction[3], double place[2]);

    /* The inverse, a direction of any length with the place's distance to it below 1e-12; false if
     * no direction has that place (beyond the model's fold). Checked: never a wrong direction. */
    bool (*undistort)(const double *params, const double place[2], double direction[3]);
} cln_lens_model;

extern const cln_lens_model cln_lens_models[CLN_LENSES];

/* The model that a dataset calls `name`, or covers it; CLN_LENSES if there is none. */
cln_lens cln_lens_find(const char *name);

/* Do the parameters leave everything where a pinhole has it. */
bool cln_lens_is_pinhole(cln_lens lens, const double *params);

#endif
