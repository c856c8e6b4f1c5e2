/* Losses and measures of single samples or points: the structure optimisation's measures of a
 * sample (method.md 12.3), distillation of merged leaves (11), regularisers over points of the
 * volume (10). Derivatives are analytic; tests check them by differences. See reference.h. */
#include <math.h>
#include "reference/reference.h"

void ref_measures(int n, const double (*out)[4], const double *delta, const double background[3],
                  const double target[3], double (*measures)[3])
{
    double through = 1, length = 0, square = 0, rgb[3] = {0, 0, 0};

    for (int i = 0; i < n; i++) {
        const double depth = fmin(out[i][3] * delta[i], 80), weight = through * -expm1(-depth);

        measures[i][0] = weight;
        measures[i][1] = through * out[i][3] * delta[i];
        measures[i][2] = through * delta[i];
        for (int k = 0; k < 3; k++)
            rgb[k] += weight * out[i][k];
        through *= exp(-depth);
        length += delta[i];
    }
    for (int k = 0; k < 3; k++) {
        const double miss = rgb[k] + through * background[k] - target[k];

        square += miss * miss / 3;
    }
    for (int i = 0; i < n; i++)
        measures[i][0] = square * (measures[i][0] + through * delta[i] / length);
}

double ref_distil(const double out[4], const double target[4], double delta, double grad[4])
{
    const double tau = out[3] * delta, miss = -expm1(-tau) - target[3];
    double loss = miss * miss;

    for (int k = 0; k < 3; k++) {
        const double off = out[k] - target[k];

        loss += target[3] * off * off / 3;
        grad[k] = 2.0 / 3 * target[3] * off;
    }
    grad[3] = 2 * miss * delta * exp(-tau);
    return loss;
}

double ref_sparsity_gradient(double sigma)
{
    return 0.05 * exp(-0.05 * sigma);
}

void ref_edge_gradient(const double a[4], const double b[4], double spacing, double grad_a[4],
                       double grad_b[4])
{
    const double alpha = -expm1(-spacing * a[3]), beta = -expm1(-spacing * b[3]);
    double sum_a = 0, sum_b = 0;

    for (int k = 0; k < 4; k++) {
        const double fa = alpha * (k < 3 ? a[k] : 1), fb = beta * (k < 3 ? b[k] : 1);
        const double sign = fa > fb ? 0.25 : fa < fb ? -0.25 : 0;

        sum_a += sign * (k < 3 ? a[k] : 1);
        sum_b += sign * (k < 3 ? b[k] : 1);
        grad_a[k] = sign * alpha;
        grad_b[k] = -sign * beta;
    }
    grad_a[3] = spacing * exp(-spacing * a[3]) * sum_a;
    grad_b[3] = -spacing * exp(-spacing * b[3]) * sum_b;
}
