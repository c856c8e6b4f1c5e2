/* See place_turn.h. A rotation vector away from the turn that positions alone give is found by
 * least squares: its squares by the covariance of that turn, and those of how far the cameras' up
 * is from z then, or the horizontal line that they tell from the horizon. */
#include "api/place_turn.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/eigen.h"
#include "base/memory.h"
#include "scene/vectors.h"

static const double DEGREE = M_PI / 180;
static const double LOOSE = 10; /* degrees: a turn that GPS knows no better is begun anew */
/* Degrees apart of turns that are others; degrees and standard deviations of lean by which two fit
 * alike. */
static const double OTHER = 30, LIKE = 10, LIKE_SIGMAS = 5;
/* Degrees and standard deviations by which two ups differ; metres that heights by GPS, the
 * barometer's most often, drift during a flight, beside as many of these; metres off of RTK, whose
 * do not. */
static const double DIFFER = 2, SIGMAS = 3, DRIFT = 10, EXACT = 0.1;
enum { ROUNDS = 10 };

static void turned(const cln_similarity *s, const double v[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = cln_dot(s->turn + (size_t)3 * k, v);
}

/* The rotation vector that is missing for what cameras tell, and in *sharp how well each part of it
 * is told: [x, y] by rows, 1 / radians^2 times sd^2. */
static void missing(const cln_similarity *s, const cln_up_told *told, double out[3],
                    double sharp[9])
{
    double is[3];

    memset(sharp, 0, 9 * sizeof *sharp);
    memset(out, 0, 3 * sizeof *out);
    if (told->what == CLN_UP_TOLD) {
        turned(s, told->up, is);
        cln_cross(is, (const double[3]){0, 0, 1}, out);
        if (cln_unit(out) == 0) /* upside down exactly, or not at all */
            out[0] = 1;
        for (int k = 0; k < 3; k++)
            out[k] *= atan2(hypot(is[0], is[1]), is[2]);
        sharp[0] = sharp[4] = 1;
    } else if (told->what == CLN_UP_LEVEL) {
        double flat = 0, angle = 0;

        turned(s, told->level, is);
        flat = fmax(hypot(is[0], is[1]), 1e-9);
        angle = -atan2(is[2], flat);
        out[0] = angle * is[1] / flat;
        out[1] = -angle * is[0] / flat;
        for (int k = 0; k < 4; k++) {
            const double a[2] = {is[1] / flat, -is[0] / flat};

            sharp[3 * (k / 2) + k % 2] = a[k / 2] * a[k % 2];
        }
    }
}

static double length(const double v[3])
{
    return sqrt(cln_dot(v, v));
}

/* How far, in radians, the scene stands from what cameras tell. *above: how far their rough up is
 * above the horizon. */
static double lean_of(const cln_similarity *s, const cln_up_told *told, double *above)
{
    double left[3], sharp[9], rough[3];

    missing(s, told, left, sharp);
    turned(s, told->what == CLN_UP_TOLD ? told->up : told->rough, rough);
    *above = rough[2];
    return length(left) + (rough[2] < 0 ? M_PI : 0);
}

/* Positions along a line leave the turn about it open: that by which cameras stand best. False if
 * these do not tell it, either: a level line fits half a turn about a steep flight as well, and any
 * turn about one along it. */
static bool begin_anew(const double covariance[9], const cln_up_told *told, cln_similarity *s)
{
    enum { TURNS = 72 };
    const cln_similarity first = *s;
    double value[3], axis[3][3], lean[TURNS], best_above = 0;
    int best = 0;

    cln_eigen(3, covariance, value, axis[0]);
    if (sqrt(value[2]) < LOOSE * DEGREE)
        return true;
    for (int i = 0; i < TURNS; i++) {
        cln_similarity other = first;
        double by[3], above = 0;

        for (int k = 0; k < 3; k++)
            by[k] = 2 * M_PI * i / TURNS * axis[2][k];
        cln_similarity_turn(&other, by);
        lean[i] = lean_of(&other, told, &above);
        if (i == 0 || lean[i] < lean[best]) {
            best = i;
            best_above = above;
            *s = other;
        }
    }
    if (told->what == CLN_UP_TOLD)
        return true;
    for (int i = 0; i < TURNS; i++) {
        const int apart = abs(i - best);
        const bool other = 360 * apart >= OTHER * TURNS && 360 * (TURNS - apart) >= OTHER * TURNS;

        if (other && lean[i] - lean[best] < LIKE * DEGREE + LIKE_SIGMAS * told->sd)
            return false;
    }
    return fabs(best_above) >= CLN_UP_UNSURE;
}

/* The rotation vector, in radians, that both agree on best. known: of positions, 1 / radians^2. */
static void agree(const double known[9], const cln_up_told *told, const cln_similarity *first,
                  cln_similarity *s, double covariance[9])
{
    double by[3] = {0};

    for (int round = 0; round < ROUNDS; round++) {
        double left[3], sharp[9], sum[9], right[3] = {0};

        missing(s, told, left, sharp);
        for (int k = 0; k < 9; k++) {
            sharp[k] /= told->sd * told->sd;
            sum[k] = known[k] + sharp[k];
            right[k / 3] += sharp[k] * (left[k % 3] + by[k % 3]);
        }
        cln_eigen_invert(sum, 0, covariance);
        for (int k = 0; k < 3; k++)
            by[k] = cln_dot(covariance + (size_t)3 * k, right);
        *s = *first;
        cln_similarity_turn(s, by);
    }
}

/* The larger standard deviation of up, in degrees: of turns about x and y. */
static double up_of(const double covariance[9])
{
    double value[2], axis[4];

    cln_eigen(2, (const double[4]){covariance[0], covariance[1], covariance[3], covariance[4]},
              value, axis);
    return sqrt(fmax(value[1], 0)) / DEGREE;
}

/* How far up by both is apart, about the axis `way`, and whether by more than they can be off. */
static void compare(int count, double (*from)[3], const cln_similarity_doubt *doubt,
                    const cln_up_told *told, cln_place_turn *out, double way[3])
{
    double left[3], sharp[9], variance = 0, least = INFINITY, most = -INFINITY;

    missing(&out->to, told, left, sharp);
    out->apart = length(left) / DEGREE;
    memcpy(way, left, sizeof left);
    cln_unit(way);
    for (int k = 0; k < 9; k++)
        variance += way[k / 3] * doubt->turn[k] * way[k % 3];
    out->by_gps = sqrt(variance) / DEGREE;
    out->by_them = told->sd / DEGREE;
    out->differ = out->apart > DIFFER && out->apart > SIGMAS * hypot(out->by_gps, out->by_them);
    for (int i = 0; i < count; i++) { /* the cameras' extent across the axis of that turn */
        double at[3], across = 0;

        cln_similarity_apply(&out->to, from[i], at);
        across = way[0] * at[1] - way[1] * at[0];
        least = fmin(least, across);
        most = fmax(most, across);
    }
    out->drift = (most - least) * tan(fmin(out->apart, 80) * DEGREE);
    out->theirs =
        out->differ && doubt->apart[2] > EXACT && out->drift < DRIFT + SIGMAS * doubt->apart[2];
}

cln_status cln_place_turn_find(int count, double (*from)[3], double (*to)[3],
                               const cln_up_told *told, cln_place_turn *out)
{
    cln_status st = CLN_OK;
    cln_similarity first;
    cln_similarity_doubt doubt;
    double known[9], covariance[9], way[3] = {0};
    bool tells = told->what != CLN_UP_UNTOLD, both = false;

    *out = (cln_place_turn){0};
    CLN_TRY(cln_similarity_fit(count, from, to, &out->to));
    CLN_TRY(cln_similarity_judge(count, from, to, &out->to, &doubt));
    memcpy(covariance, doubt.turn, sizeof covariance);
    tells = tells && begin_anew(doubt.turn, told, &out->to);
    if (tells)
        compare(count, from, &doubt, told, out, way);
    both = tells && (!out->differ || out->theirs);
    if (both) {
        const double worse = pow(out->apart * DEGREE, 2) - pow(out->by_gps * DEGREE, 2);

        for (int k = 0; k < 9 && out->differ; k++) /* as they drift, they are off by all of it */
            covariance[k] += worse * way[k / 3] * way[k % 3];
        cln_eigen_invert(covariance, 0, known);
        first = out->to;
        agree(known, told, &first, &out->to, covariance);
        CLN_TRY(cln_similarity_fit_level(count, from, to, &out->to));
    }
    out->up = up_of(covariance);
    CLN_TRY(cln_similarity_judge(count, from, to, &out->to, &doubt));
    out->north = sqrt(fmax(covariance[8], 0)) / DEGREE;
    out->length = doubt.scale;
    out->used = doubt.count;
done:
    return st;
}

cln_status cln_place_turn_flat(int count, double (*from)[3], double (*to)[3],
                               const cln_up_told *told, cln_place_turn *out)
{
    cln_status st = CLN_OK;
    cln_similarity up = {.scale = 1, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    cln_similarity_doubt doubt;
    double by[3], sharp[9], (*flat)[3] = NULL, height = 0;

    *out = (cln_place_turn){0};
    missing(&up, told, by, sharp);
    cln_similarity_turn(&up, by);
    CLN_TRY(cln_alloc(&flat, (size_t)count, sizeof *flat, "cameras"));
    for (int i = 0; i < count; i++) {
        cln_similarity_apply(&up, from[i], flat[i]);
        height += flat[i][2] / count;
        flat[i][2] = 0;
    }
    CLN_TRY(cln_similarity_fit_flat(count, flat, to, &out->to));
    CLN_TRY(cln_similarity_judge(count, flat, to, &out->to, &doubt));
    out->up = told->sd / DEGREE;
    out->north = doubt.north / DEGREE;
    out->length = doubt.scale;
    out->used = doubt.count;
    out->to.shift[2] = -out->to.scale * height;
    cln_similarity_before(&out->to, &up);
done:
    free(flat);
    return st;
}
