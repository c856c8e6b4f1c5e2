/* Chooses samples of the backward pass and their factors (kernels/roulette.cl). See reference.h. */
#include <math.h>
#include "base/rng.h"
#include "reference/reference.h"

static double draw(uint32_t key, uint32_t sample)
{
    return (cln_hash(cln_hash(cln_hash(sample ^ key)) + 0x9E3779B9u) >> 8) * 0x1p-24 + 0x1p-25;
}

/* d sigma / d raw, computed from sigma. */
static double density_slope(int density, double kappa, double sigma)
{
    if (density == CLN_DENSITY_SOFTPLUS)
        return -kappa * expm1(-sigma / kappa);
    if (density == CLN_DENSITY_RELU)
        return sigma > 0 ? kappa : 0;
    return fmin(sigma, kappa * exp(15));
}

double ref_roulette(const ref_network *r, double cutoff, uint32_t key, int n, const uint32_t *ids,
                    const float (*out)[4], const float (*dout)[4], double (*heads)[4],
                    double *factors)
{
    double least = 0, margin = INFINITY;

    for (int i = 0; i < n; i++) {
        factors[i] = 0;
        for (int k = 0; k < 4; k++) {
            const double o = out[ids[i]][k];
            const double g = dout[ids[i]][k];

            heads[i][k] =
                g * (k < 3 ? ref_colour_slope(o, g) : density_slope(r->density, r->kappa, o));
            factors[i] += fabs(heads[i][k]); /* the size, for now */
        }
        least += factors[i] * cutoff / n;
    }
    for (int i = 0; i < n; i++) {
        const double size = factors[i], u = draw(key, ids[i]);

        if (cutoff > 0 && least > 0)
            margin = fmin(margin, fabs(u - size / least));
        factors[i] = cutoff == 0 ? 1 : u * least < size ? fmax(1, least / size) : 0;
        for (int k = 0; k < 4; k++)
            heads[i][k] *= factors[i];
    }
    return margin;
}
