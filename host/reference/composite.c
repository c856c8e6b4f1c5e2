/* Compositing of a ray and its loss, forward and by a true backward sweep (method.md 9 and 10): the
 * adjoint of the transmittance runs back to front, so no prefix is subtracted from a total. See
 * reference.h. */
#include <math.h>
#include "reference/reference.h"

static const double max_depth = 80; /* clamp of sigma * delta */

static double optical_depth(double sigma, double delta)
{
    return fmin(sigma * delta, max_depth);
}

void ref_composite(int n, const double (*out)[4], const double *t, const double *delta,
                   const double background[3], double rgb[3], double *depth, double *opacity,
                   double *weights)
{
    double tau = 0, sum = 0, sum_t = 0;

    for (int c = 0; c < 3; c++)
        rgb[c] = 0;
    for (int i = 0; i < n; i++) {
        double x = optical_depth(out[i][3], delta[i]);
        double w = exp(-tau) * -expm1(-x);

        for (int c = 0; c < 3; c++)
            rgb[c] += w * out[i][c];
        sum += w;
        sum_t += w * t[i];
        tau += x;
        if (weights)
            weights[i] = w;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] += exp(-tau) * background[c];
    *depth = sum_t / fmax(sum, 1e-10);
    *opacity = sum;
}

double ref_median_depth(int n, const double (*out)[4], const double *t, const double *delta)
{
    double tau = 0, all = 0, goal = 0;

    for (int i = 0; i < n; i++)
        all += optical_depth(out[i][3], delta[i]);
    goal = -log1p(0.5 * expm1(-all)); /* optical depth where half of the opacity is reached */
    for (int i = 0; i < n && all > 0; i++) {
        const double x = optical_depth(out[i][3], delta[i]);

        if (x > 0 && tau + x >= goal)
            return t[i] + delta[i] * ((goal - tau) / x - 0.5);
        tau += x;
    }
    return 0;
}

/* Loss of a channel's error d; *slope = its derivative. */
static double channel_loss(const ref_loss *loss, double d, double *slope)
{
    double limit = loss->huber_delta;

    if (loss->kind == CLN_LOSS_L2) {
        *slope = 2 * d;
        return d * d;
    }
    if (fabs(d) < limit) {
        *slope = d;
        return d * d / 2;
    }
    *slope = copysign(limit, d);
    return limit * (fabs(d) - limit / 2);
}

/* Weight of sample i, computed from scratch. */
static double weight_of(int i, const double (*out)[4], const double *delta)
{
    double tau = 0;

    for (int j = 0; j < i; j++)
        tau += optical_depth(out[j][3], delta[j]);
    return exp(-tau) * -expm1(-optical_depth(out[i][3], delta[i]));
}

double ref_reach(const float origin[4], const float direction[4], const float point[4])
{
    double sum = 0;

    for (int k = 0; k < 3; k++)
        sum += ((double)point[k] - origin[k]) * direction[k];
    return sum;
}

/* sum_j w_j |t_i - t_j|: half the derivative of the distortion's first term by w_i. */
static double spread(int i, int n, const double (*out)[4], const double *t, const double *delta)
{
    double sum = 0;

    for (int j = 0; j < n; j++)
        sum += weight_of(j, out, delta) * fabs(t[i] - t[j]);
    return sum;
}

double ref_loss_of_ray(const ref_loss *loss, int n, const double (*out)[4], const double *t,
                       const double *delta, const double background[3], const double target[4],
                       double (*grad)[4])
{
    double rgb[3], depth = 0, opacity = 0, total = 0;
    double drgb[3], dopacity = 0, dtrans = 0, behind = 1, surplus = 0;

    ref_composite(n, out, t, delta, background, rgb, &depth, &opacity, NULL);
    for (int c = 0; c < 3; c++) {
        total += channel_loss(loss, rgb[c] - target[c], &drgb[c]) / 3;
        drgb[c] /= 3;
        dtrans += drgb[c] * background[c];
    }
    for (int i = 0; i < n; i++)
        behind *= exp(-optical_depth(out[i][3], delta[i]));
    surplus = target[3] > (double)CLN_ALPHA_TOLD ? behind - (1 - target[3]) : 0;
    total += loss->alpha * surplus * surplus;
    dtrans += 2 * loss->alpha * surplus;
    total += loss->depth * behind;
    dtrans += loss->depth;
    for (int i = 0; i < n; i++)
        total += loss->depth * weight_of(i, out, delta) * fabs(t[i] - loss->reach);
    for (int i = 0; i < n; i++)
        total += loss->cauchy * log1p(2 * out[i][3] * out[i][3]);
    total += loss->opacity_entropy * log1p(opacity * (1 - opacity) / 0.11);
    dopacity = loss->opacity_entropy * (1 - 2 * opacity) / (0.11 + opacity * (1 - opacity));
    for (int i = 0; loss->distortion != 0 && i < n; i++) {
        double w = weight_of(i, out, delta);

        total += loss->distortion * w * (spread(i, n, out, t, delta) + w * delta[i] / 3);
    }
    if (!grad)
        return total;

    /* Back to front. dtrans = dL/d(transmittance behind sample i), at first that of the last
     * sample. */
    for (int i = n - 1; i >= 0; i--) {
        double x = optical_depth(out[i][3], delta[i]), alpha = -expm1(-x);
        double w = weight_of(i, out, delta), trans = 1, dw = dopacity, dalpha = 0;

        for (int j = 0; j < i; j++)
            trans *= exp(-optical_depth(out[j][3], delta[j]));
        for (int c = 0; c < 3; c++) {
            dw += drgb[c] * out[i][c];
            grad[i][c] = w * drgb[c];
        }
        if (loss->distortion != 0)
            dw += loss->distortion * 2 * (spread(i, n, out, t, delta) + w * delta[i] / 3);
        dw += loss->depth * fabs(t[i] - loss->reach);
        dalpha = trans * (dw - dtrans);
        dtrans = alpha * dw + exp(-x) * dtrans;
        grad[i][3] = out[i][3] * delta[i] < max_depth ? dalpha * exp(-x) * delta[i] : 0;
        grad[i][3] += loss->cauchy * 4 * out[i][3] / (1 + 2 * out[i][3] * out[i][3]);
    }
    return total;
}
