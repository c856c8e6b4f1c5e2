/* See similarity.h. In closed form by quaternions: Horn, "Closed-form solution of absolute
 * orientation using unit quaternions", J. Opt. Soc. Am. A 1987. */
#include "scene/similarity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/eigen.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/rng.h"
#include "scene/vectors.h"

/* Weights are 0 beyond so many times the middle distance: 6 standard deviations, of an axis, of
 * places that are all right, and 9 where 40 % are wrong. */
static const double TUKEY = 4;
static const double LEAST = 0.02; /* metres: that middle distance at least */
static const double SAME = 1e-12; /* of the places' spread: it moves no more */
/* Of fewer places the distances tell little of what these are off by: metres at least, an axis. */
static const double OFF = 3;
enum { DRAWS = 500, ROUNDS = 100, FEW = 6 };

void cln_similarity_apply(const cln_similarity *s, const double at[3], double out[3])
{
    double x[3];

    for (int i = 0; i < 3; i++)
        x[i] = s->scale * cln_dot(s->turn + (size_t)3 * i, at) + s->shift[i];
    memcpy(out, x, sizeof x);
}

static void turn_of(const double q[4], double turn[9])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];

    memcpy(
        turn,
        (const double[9]){w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
                          2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
                          2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z},
        9 * sizeof *turn);
}

static void multiply(const double a[9], const double b[9], double out[9])
{
    double m[9];

    for (int i = 0; i < 9; i++)
        m[i] = a[i / 3 * 3] * b[i % 3] + a[i / 3 * 3 + 1] * b[3 + i % 3] +
               a[i / 3 * 3 + 2] * b[6 + i % 3];
    memcpy(out, m, sizeof m);
}

void cln_similarity_turn(cln_similarity *s, const double by[3])
{
    double axis[3] = {by[0], by[1], by[2]}, turn[9];
    const double half = cln_unit(axis) / 2, sine = sin(half);

    turn_of((const double[4]){cos(half), sine * axis[0], sine * axis[1], sine * axis[2]}, turn);
    multiply(turn, s->turn, s->turn);
    for (int k = 0; k < 3; k++)
        axis[k] = cln_dot(turn + (size_t)3 * k, s->shift);
    memcpy(s->shift, axis, sizeof axis);
}

void cln_similarity_before(cln_similarity *s, const cln_similarity *first)
{
    multiply(s->turn, first->turn, s->turn);
}

/* Means with these weights; their sum. */
static double middles(int count, double (*from)[3], double (*to)[3], const double *weight,
                      double a[3], double b[3])
{
    double sum = 0;

    memset(a, 0, 3 * sizeof *a);
    memset(b, 0, 3 * sizeof *b);
    for (int i = 0; i < count; i++) {
        sum += weight[i];
        for (int k = 0; k < 3; k++) {
            a[k] += weight[i] * from[i][k];
            b[k] += weight[i] * to[i][k];
        }
    }
    for (int k = 0; k < 3 && sum > 0; k++) {
        a[k] /= sum;
        b[k] /= sum;
    }
    return sum;
}

/* The rotation that brings points with this sum of point times place to the places. */
static void best_turn(const double m[9], double turn[9])
{
    const double n[16] = {m[0] + m[4] + m[8], m[5] - m[7], m[6] - m[2], m[1] - m[3], m[5] - m[7],
                          m[0] - m[4] - m[8], m[1] + m[3], m[6] + m[2], m[6] - m[2], m[1] + m[3],
                          m[4] - m[0] - m[8], m[5] + m[7], m[1] - m[3], m[6] + m[2], m[5] + m[7],
                          m[8] - m[0] - m[4]};
    double value[4], vector[4][4];

    cln_eigen(4, n, value, vector[0]);
    turn_of(vector[3], turn);
}

/* Least squares with weights; level: *s turns about z alone. False if that tells nothing. */
static bool solve(int count, double (*from)[3], double (*to)[3], const double *weight, bool level,
                  cln_similarity *s)
{
    double a[3], b[3], m[9] = {0}, square = 0, along = 0;

    if (!(middles(count, from, to, weight, a, b) > 0))
        return false;
    for (int i = 0; i < count; i++) {
        double p[3], q[3];

        for (int k = 0; k < 3; k++) {
            p[k] = from[i][k] - a[k];
            q[k] = to[i][k] - b[k];
        }
        square += weight[i] * cln_dot(p, p);
        for (int k = 0; k < 9; k++)
            m[k] += weight[i] * p[k / 3] * q[k % 3];
    }
    if (!(square > 0))
        return false;
    if (level) {
        double turned[9]; /* the sum of turned point times place */

        multiply(s->turn, m, turned);
        cln_similarity_turn(
            s, (const double[3]){0, 0, atan2(turned[1] - turned[3], turned[0] + turned[4])});
    } else {
        best_turn(m, s->turn);
    }
    for (int k = 0; k < 9; k++) /* turn[i][j] m[j][i] */
        along += s->turn[k] * m[k % 3 * 3 + k / 3];
    s->scale = along / square;
    for (int k = 0; k < 3; k++)
        s->shift[k] = b[k] - s->scale * cln_dot(s->turn + (size_t)3 * k, a);
    return s->scale > 0;
}

static double off(const cln_similarity *s, const double from[3], const double to[3],
                  double apart[3])
{
    cln_similarity_apply(s, from, apart);
    for (int k = 0; k < 3; k++)
        apart[k] -= to[k];
    return sqrt(cln_dot(apart, apart));
}

/* The distance of the middle one; sorted: room for all. */
static double middle_off(int count, double (*from)[3], double (*to)[3], const cln_similarity *s,
                         double *sorted)
{
    double apart[3];

    for (int i = 0; i < count; i++)
        sorted[i] = off(s, from[i], to[i], apart);
    cln_reals_sort(sorted, count);
    return sorted[count / 2];
}

static void weigh(int count, double (*from)[3], double (*to)[3], const cln_similarity *s,
                  double *sorted, double *weight)
{
    const double edge = TUKEY * fmax(middle_off(count, from, to, s, sorted), LEAST);
    double apart[3];

    for (int i = 0; i < count; i++) {
        const double x = off(s, from[i], to[i], apart) / edge;

        weight[i] = x < 1 ? (1 - x * x) * (1 - x * x) : 0;
    }
}

/* From *s on until it stays. */
static void refine(int count, double (*from)[3], double (*to)[3], bool level, double *sorted,
                   double *weight, cln_similarity *s)
{
    for (int round = 0; round < ROUNDS; round++) {
        cln_similarity next = *s;
        double moved = 0, spread = 0;

        weigh(count, from, to, s, sorted, weight);
        if (!solve(count, from, to, weight, level, &next))
            return;
        for (int i = 0; i < count; i++) {
            double before[3], after[3];

            cln_similarity_apply(s, from[i], before);
            cln_similarity_apply(&next, from[i], after);
            for (int k = 0; k < 3; k++) {
                moved = fmax(moved, fabs(after[k] - before[k]));
                spread = fmax(spread, fabs(after[k] - next.shift[k]));
            }
        }
        *s = next;
        if (moved <= SAME * spread)
            return;
    }
}

/* Biweights of all distances, with edges that are the same for those who are compared. */
static double cost(int count, double (*from)[3], double (*to)[3], const cln_similarity *s,
                   double edge)
{
    double apart[3], sum = 0;

    for (int i = 0; i < count; i++) {
        const double x = off(s, from[i], to[i], apart) / edge;

        sum += x < 1 ? 1 - pow(1 - x * x, 3) : 1;
    }
    return sum;
}

/* By three of them, of which half of all are nearest. */
static void begin(int count, double (*from)[3], double (*to)[3], bool level, double *sorted,
                  double *weight, cln_similarity *out)
{
    double least = INFINITY;

    for (int t = 0; t < DRAWS; t++) {
        cln_similarity s = *out;
        double middle = 0;
        float u[4];

        cln_uniform4(0, CLN_STREAM_PLACES, 0, (uint32_t)t, 0, u);
        memset(weight, 0, (size_t)count * sizeof *weight);
        for (int k = 0; k < 3; k++)
            weight[(int)fmin(u[k] * count, count - 1)] = 1;
        if (!solve(count, from, to, weight, level, &s))
            continue;
        middle = middle_off(count, from, to, &s, sorted);
        if (middle < least) {
            least = middle;
            *out = s;
        }
    }
}

static cln_status fit(int count, double (*from)[3], double (*to)[3], bool level,
                      cln_similarity *out)
{
    const cln_similarity none = {.scale = 1, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    cln_similarity by_half = none;
    cln_status st = CLN_OK;
    double *sorted = NULL, *weight = NULL, edge = 0;

    *out = none;
    CLN_TRY(cln_alloc(&sorted, (size_t)count + 1, sizeof *sorted, "places"));
    CLN_TRY(cln_alloc(&weight, (size_t)count + 1, sizeof *weight, "places"));
    begin(count, from, to, level, sorted, weight, &by_half);
    refine(count, from, to, level, sorted, weight, &by_half);
    for (int i = 0; i < count; i++)
        weight[i] = 1;
    (void)solve(count, from, to, weight, level, out);
    refine(count, from, to, level, sorted, weight, out);
    /* one camera aside of a line, which tells the turn about it, is in no half that counts */
    edge = TUKEY * fmax(LEAST, fmin(middle_off(count, from, to, &by_half, sorted),
                                    middle_off(count, from, to, out, sorted)));
    if (cost(count, from, to, &by_half, edge) + 1 < cost(count, from, to, out, edge))
        *out = by_half;
done:
    free(sorted);
    free(weight);
    return st;
}

cln_status cln_similarity_fit(int count, double (*from)[3], double (*to)[3], cln_similarity *out)
{
    return fit(count, from, to, false, out);
}

cln_status cln_similarity_fit_flat(int count, double (*from)[3], double (*to)[3],
                                   cln_similarity *out)
{
    return fit(count, from, to, true, out);
}

cln_status cln_similarity_fit_level(int count, double (*from)[3], double (*to)[3],
                                    cln_similarity *s)
{
    cln_status st = CLN_OK;
    double *sorted = NULL, *weight = NULL;

    CLN_TRY(cln_alloc(&sorted, (size_t)count + 1, sizeof *sorted, "places"));
    CLN_TRY(cln_alloc(&weight, (size_t)count + 1, sizeof *weight, "places"));
    refine(count, from, to, true, sorted, weight, s);
done:
    free(sorted);
    free(weight);
    return st;
}

cln_status cln_similarity_judge(int count, double (*from)[3], double (*to)[3],
                                const cln_similarity *s, cln_similarity_doubt *out)
{
    const double none = 1e-9; /* of turns that they do not tell */
    cln_status st = CLN_OK;
    double *sorted = NULL, *weight = NULL, a[3], b[3], apart[3], sum = 0, square = 0;
    double tells[9] = {0}, noise[9] = {0}, inverse[9], stretch = 0;

    *out = (cln_similarity_doubt){0};
    CLN_TRY(cln_alloc(&sorted, (size_t)count + 1, sizeof *sorted, "places"));
    CLN_TRY(cln_alloc(&weight, (size_t)count + 1, sizeof *weight, "places"));
    weigh(count, from, to, s, sorted, weight);
    sum = middles(count, from, to, weight, a, b);
    cln_similarity_apply(s, a, a);
    for (int i = 0; i < count; i++) {
        (void)off(s, from[i], to[i], apart);
        out->count += weight[i] > 0;
        for (int k = 0; k < 3; k++)
            out->apart[k] += weight[i] * apart[k] * apart[k];
    }
    for (int k = 0; k < 3; k++) { /* seven numbers were fitted to three axes */
        out->apart[k] = sqrt(out->apart[k] / fmax(sum - 7 / 3.0, 0.5));
        if (sum < FEW)
            out->apart[k] = fmax(out->apart[k], OFF);
    }
    for (int i = 0; i < count; i++) {
        double p[3];

        cln_similarity_apply(s, from[i], p);
        for (int k = 0; k < 3; k++)
            p[k] -= a[k];
        square += weight[i] * cln_dot(p, p);
        for (int k = 0; k < 3;
             k++) { /* each axis of the place: how turns move the point along it */
            const double e[3] = {k == 0, k == 1, k == 2};
            const double variance = out->apart[k] * out->apart[k];
            double lever[3];

            cln_cross(p, e, lever);
            stretch += weight[i] * variance * p[k] * p[k];
            for (int c = 0; c < 9; c++) {
                tells[c] += weight[i] * lever[c / 3] * lever[c % 3];
                noise[c] += weight[i] * variance * lever[c / 3] * lever[c % 3];
            }
        }
    }
    out->north = tells[8] > 0 ? sqrt(noise[8]) / tells[8] : INFINITY;
    out->scale = square > 0 ? sqrt(stretch) / square : INFINITY;
    for (int c = 0; c < 9; c += 4) { /* a line's turn has neither a lever nor noise on it */
        const double more = none * square + 1e-12;

        tells[c] += more;
        noise[c] += more * (out->apart[0] * out->apart[0] + 1e-12);
    }
    cln_eigen_invert(tells, 1e-15, inverse);
    multiply(inverse, noise, noise);
    multiply(noise, inverse, out->turn);
done:
    free(sorted);
    free(weight);
    return st;
}
