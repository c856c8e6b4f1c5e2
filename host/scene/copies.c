/* Copies of photos, and of poses. See copies.h. A bound lies between the values of sound captures
 * and of those with the fault (tests/cli/check.sh plants faults). */
#include "scene/copies.h"

#include <math.h>
#include <string.h>

static const double COPY = 0.004, FLAT = 0.02; /* of thumbnails: their difference; contrast */
/* Of pixels: JPEGs of JPEGs differ by 39 dB, views of an object from nearly one place by more than
 * 34; photos of one place by their noise alone. */
static const double COPY_PIXELS = 0.02, SAME_PIXELS = 0.002;
static const double STOOD_STILL = 0.02, STOOD_ANGLE = 1; /* of half the cube; degrees */
static const double SAME_POSE = 1e-6;                    /* likewise, and of the axes */

/* Is a camera where another one is, to within `way` half sides, and are its axes to within
 * `turn`? */
static bool is_near(const cln_scene *scene, int a, int b, double way, double turn)
{
    const double *m = scene->views[a].camera.c2w, *n = scene->views[b].camera.c2w;

    for (int k = 0; k < 4; k++)
        if (!(hypot(hypot(m[k] - n[k], m[4 + k] - n[4 + k]), m[8 + k] - n[8 + k]) <=
              (k < 3 ? turn : way * scene->space.half)))
            return false;
    return true;
}

static bool in_two_held_out(const cln_view *a, const cln_view *b)
{
    return a->split != CLN_SPLIT_TRAIN && b->split != CLN_SPLIT_TRAIN && a->split != b->split &&
           strcmp(a->path, b->path) == 0;
}

/* Root of the mean square of the difference of two photos of one size, 0..1, over some of their
 * pixels; 0 for others, of which nothing is known. */
static double pixels_differ(const cln_view *a, const cln_view *b)
{
    enum { ROWS = 200 };
    const int width = a->camera.width, height = a->camera.height, each = height / ROWS + 1;
    double sum = 0;
    size_t n = 0;

    if (width != b->camera.width || height != b->camera.height)
        return 0;
    for (int y = 0; y < height; y += each)
        for (int x = 0; x < width; x += each) {
            uint8_t one[4], other[4];

            cln_view_bytes(a, x, y, one);
            cln_view_bytes(b, x, y, other);
            for (int c = 0; c < 3; c++, n++)
                sum += (one[c] - other[c]) * (one[c] - other[c]) / 65025.0;
        }
    return sqrt(sum / (double)n);
}

/* Most pairs differ in their means already, which is found faster. */
static bool look_alike(const cln_photo *a, const cln_photo *b)
{
    return a->contrast > (float)FLAT && fabsf(a->mean - b->mean) < (float)COPY + 1e-4f &&
           cln_photo_difference(a, b) < COPY;
}

cln_pair cln_pair_of(const cln_scene *scene, const cln_photo *photos, int a, int b, bool posed)
{
    const cln_view *one = &scene->views[a], *other = &scene->views[b];
    const bool alike = look_alike(&photos[a], &photos[b]);
    const double apart = alike ? pixels_differ(one, other) : 1;

    if (in_two_held_out(one, other))
        return CLN_PAIR_APART;
    if (apart < COPY_PIXELS && apart > SAME_PIXELS) {
        if (is_near(scene, a, b, STOOD_STILL, 2 * sin(STOOD_ANGLE * M_PI / 360)))
            return CLN_PAIR_NOISE;
        if (posed)
            return CLN_PAIR_APART;
    }
    if (apart < COPY_PIXELS)
        return CLN_PAIR_COPY;
    return is_near(scene, a, b, SAME_POSE, SAME_POSE) ? CLN_PAIR_SAME_POSE : CLN_PAIR_APART;
}
