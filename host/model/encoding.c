/* The frequency encoding's rows, and its change of coordinates at a split and at a merge (method.md
 * section 11).
 *
 * With x = x'/2 + o (o = -1/2 or +1/2 per axis), band k >= 1 of the parent is band k-1 of the
 * child, its (sin, cos) pair of weights turned by the angle 2^k o; the identity rows are halved and
 * add o w to the bias. Only band 0 leaves the basis: sin(x'/2), cos(x'/2) are written as
 *   sin(x/2) ~ s[0] x + sum_k s[k+1] sin(2^k x)      cos(x/2) ~ c[0] + sum_k c[k+1] cos(2^k x)
 * over the first min(bands, 4) bands. The coefficients are minimax on [-1, 1], found by the
 * Remez exchange in 40 digits (method.md has least-squares ones for two bands). Largest errors:
 *   bands        1        2        3        4
 *   sin(x/2)  4.9e-5   1.1e-6   6.8e-8   1.3e-8
 *   cos(x/2)  1.0e-3   3.3e-5   2.5e-6   6.2e-7
 * The rest is exact but for rounding to float; sums are in double.
 *
 * Unfolding writes a child's function in its parent's coordinates, x' = 2 x - s with s = -1 or +1:
 * band k becomes band k+1, turned by 2^k s; the identity is exact. The child's top band is beyond
 * the parent's bands and is dropped: the training after a merge makes up for it. */
#include "model/encoding.h"

#include <math.h>

enum { FIT_BANDS = 4, MAX_BANDS = 10, PAIR = 6, MAX_ENC = 3 + PAIR * MAX_BANDS };

int cln_encoding_rows(int bands)
{
    return 3 + PAIR * bands;
}

int cln_encoding_vertices(int cells)
{
    return (cells + 1) * (cells + 1) * (cells + 1);
}

static const double fit_sin[FIT_BANDS][FIT_BANDS + 1] = {
    {0.369210112812264881, 0.131038119641640675},
    {0.347948042022971999, 0.161190504587067449, -0.0045733064731247909},
    {0.343418726909348872, 0.167898943520978231, -0.00575942333409521212, 0.0000504503201101738266},
    {0.342650506464727456, 0.169041893427366595, -0.00596430586594816176, 0.0000596647491666570433,
     -3.24600631128881778e-7},
};

static const double fit_cos[FIT_BANDS][FIT_BANDS + 1] = {
    {0.734697820128950915, 0.266299874183212473},
    {0.694506830847997422, 0.32435048352177826, -0.0188898479515624822},
    {0.686128394868950916, 0.336847745600285569, -0.0234085608729164402, 0.000434958054376141008},
    {0.684908997901115093, 0.338666826010266382, -0.0240660375212245877, 0.000496021225228522852,
     -6.43056025168570182e-6},
};

/* Folds one neuron's weights over the encoding along one axis, in[enc] -> out[enc] (rows of this
 * axis only). sign: which half of the parent, -1 or 1; turn[k]: cos, sin of 2^k / 2. Returns the
 * change of its bias. */
static double fold_axis(int bands, int axis, double sign, const double (*turn)[2], const double *in,
                        double *out)
{
    int fit = bands < FIT_BANDS ? bands : FIT_BANDS;
    const double *s = fit_sin[fit - 1], *c = fit_cos[fit - 1];
    double bias = 0.5 * sign * in[axis];

    out[axis] = 0.5 * in[axis];
    for (int k = 0; k < bands; k++) {
        int sin_row = 3 + PAIR * k + axis, cos_row = sin_row + 3;
        double cos_phi = turn[k][0], sin_phi = sign * turn[k][1];
        double a = in[sin_row] * cos_phi - in[cos_row] * sin_phi; /* weight of sin(2^k x'/2) */
        double b = in[sin_row] * sin_phi + in[cos_row] * cos_phi; /* weight of cos(2^k x'/2) */

        if (k > 0) {
            out[sin_row - PAIR] += a;
            out[cos_row - PAIR] += b;
            continue;
        }
        out[axis] += a * s[0];
        bias += b * c[0];
        for (int j = 0; j < fit; j++) {
            out[3 + PAIR * j + axis] += a * s[j + 1];
            out[6 + PAIR * j + axis] += b * c[j + 1];
        }
    }
    return bias;
}

/* Unfolds likewise; turn[k]: cos, sin of 2^k. */
static double unfold_axis(int bands, int axis, double sign, const double (*turn)[2],
                          const double *in, double *out)
{
    out[axis] = 2 * in[axis];
    for (int k = 0; k + 1 < bands; k++) {
        int sin_row = 3 + PAIR * k + axis, cos_row = sin_row + 3;
        double cos_phi = turn[k][0], sin_phi = sign * turn[k][1];

        out[sin_row + PAIR] = in[sin_row] * cos_phi + in[cos_row] * sin_phi;
        out[cos_row + PAIR] = in[cos_row] * cos_phi - in[sin_row] * sin_phi;
    }
    return -sign * in[axis];
}

typedef double change_axis(int bands, int axis, double sign, const double (*turn)[2],
                           const double *in, double *out);

/* What a split or a merge does to the rows of the encoding; angle: the turn of band 0. */
typedef struct change {
    change_axis *axis;
    double angle;
} change;

static void change_rows(change c, int bands, int w, int octant, const float *rows,
                        const float *bias, float *out_rows, float *out_bias)
{
    double turn[MAX_BANDS][2];
    const int enc = cln_encoding_rows(bands);

    for (int k = 0; k < bands; k++) {
        turn[k][0] = cos(ldexp(c.angle, k));
        turn[k][1] = sin(ldexp(c.angle, k));
    }
    for (int n = 0; n < w; n++) {
        double in[MAX_ENC], out[MAX_ENC] = {0}, sum = bias[n];
        for (int r = 0; r < enc; r++)
            in[r] = rows[r * w + n];
        for (int a = 0; a < 3; a++)
            sum += c.axis(bands, a, (octant >> a) & 1 ? 1 : -1, turn, in, out);
        for (int r = 0; r < enc; r++)
            out_rows[r * w + n] = (float)out[r];
        out_bias[n] = (float)sum;
    }
}

void cln_encoding_split(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias)
{
    change_rows((change){fold_axis, 0.5}, bands, width, octant, rows, bias, out_rows, out_bias);
}

void cln_encoding_merge(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias)
{
    change_rows((change){unfold_axis, 1}, bands, width, octant, rows, bias, out_rows, out_bias);
}
