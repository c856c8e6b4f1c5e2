/* Stage 1 along a ray, stage-2 counts, positions and deltas, sort keys and bfloat16: method.md 4 to
 * 7 and the delta rule of 9. Works on one chord at a time. See reference.h. */
#include <math.h>
#include <string.h>
#include "reference/reference.h"

uint16_t ref_to_bf16(float value)
{
    uint32_t bits = 0, lower = 0;
    uint16_t upper = 0;

    memcpy(&bits, &value, sizeof bits);
    upper = (uint16_t)(bits >> 16);
    lower = bits & 0xFFFF;
    if (isnan(value))
        return upper | 0x40; /* made quiet, as its payload may have been in the lower half only */
    if (lower > 0x8000 || (lower == 0x8000 && (upper & 1)))
        upper++; /* may carry into the exponent: the largest float becomes infinity */
    return upper;
}

float ref_from_bf16(uint16_t bits)
{
    uint32_t wide = (uint32_t)bits << 16;
    float value = 0;

    memcpy(&value, &wide, sizeof value);
    return value;
}

uint64_t ref_key(uint32_t list, float t)
{
    uint32_t bits = 0;

    t += 0.0f; /* -0 is 0 */
    memcpy(&bits, &t, sizeof bits);
    return (uint64_t)list << 32 | bits;
}

int ref_gather(const double origin[3], const double direction[3], const ref_interval *interval,
               const float box[4], const float *cache, int n1, double *t, double *sigma, int max)
{
    double length = interval->t_out - interval->t_in, side = box[3];
    int m = (int)ceil(n1 * length / side);

    if (m < 1)
        m = 1;
    for (int j = 0; j < m && j < max; j++) {
        double at = interval->t_in + length * (j + 0.5) / m;
        int cell[3];

        for (int a = 0; a < 3; a++) {
            double local = (origin[a] + at * direction[a] - box[a]) / side;
            cell[a] = (int)floor(fmin(fmax(local * n1, 0), n1 - 1));
        }
        t[j] = at;
        sigma[j] = cache[((size_t)cell[2] * n1 + cell[1]) * n1 + cell[0]];
    }
    return m;
}

int ref_sample_count(const ref_sampling *s, double length, double side, double tau_in, double tau,
                     double roulette)
{
    double weight = exp(-tau_in) * -expm1(-tau);
    double count = 0;

    if (exp(-tau_in) < s->min_transmittance)
        return 0;
    if (!s->by_weight) {
        count = ceil(s->samples_per_leaf * length / (sqrt(3) * side));
        return count < 1 ? 1 : (int)count;
    }
    if (weight < s->empty_weight)
        return roulette < s->empty_share ? 1 : 0;
    count = 1 + floor(s->samples_per_ray * weight + 0.5);
    return count < s->samples_per_leaf ? (int)count : s->samples_per_leaf;
}

static double clip(double t, double t_in, double t_out)
{
    return fmin(fmax(t, t_in), t_out);
}

/* Edge j of the m bins: midpoints between the stage-1 points, the chord's ends outside. */
static double edge(int j, double t_in, double t_out, int m, const double *t)
{
    if (j == 0)
        return t_in;
    if (j == m)
        return t_out;
    return clip((t[j - 1] + t[j]) / 2, t_in, t_out);
}

/* Distance from a point to its bin's edge: `distance`, unless the point stands for too short a
 * length. */
static double reach_of(double distance, double length)
{
    return distance > 1.5 * length ? length / 2 : distance;
}

int ref_bins(double t_in, double t_out, ref_points p, double *edges, double *densities)
{
    const int m = p.m;
    const double *t = p.t;

    edges[0] = t_in;
    for (int j = 0; j < m; j++) {
        const double length = p.lengths ? p.lengths[j] : INFINITY;
        const double before = edge(j, t_in, t_out, m, t), after = edge(j + 1, t_in, t_out, m, t);

        edges[2 * j + 1] = clip(t[j] - reach_of(t[j] - before, length), t_in, t_out);
        edges[2 * j + 2] = clip(t[j] + reach_of(after - t[j], length), t_in, t_out);
        densities[2 * j] = 0;
        densities[2 * j + 1] = p.sigma[j];
    }
    edges[2 * m + 1] = t_out;
    densities[2 * m] = 0;
    return 2 * m + 1;
}

/* Unnormalised mass p of a bin; `tau` is the optical depth from the chord's start to it. */
static double bin_mass(const ref_sampling *s, double sigma, double width, double tau, double mean,
                       double length)
{
    if (s->cdf_weight)
        return exp(-tau) * -expm1(-sigma * width) + 1e-5 * width / length;
    return (sigma + 1e-5 * fmax(1, mean)) * width;
}

void ref_sample_positions(const ref_sampling *s, double t_in, double t_out, ref_points p, int n,
                          const double *xi, double *out)
{
    double edges[2 * REF_MOST_POINTS + 2], densities[2 * REF_MOST_POINTS + 1];
    const int bins = ref_bins(t_in, t_out, p, edges, densities);
    double length = t_out - t_in, mean = 0, total = 0, tau = 0;

    for (int j = 0; j < bins; j++)
        mean += densities[j] * (edges[j + 1] - edges[j]) / length;
    for (int j = 0; j < bins; j++) {
        double width = edges[j + 1] - edges[j];

        total += bin_mass(s, densities[j], width, tau, mean, length);
        tau += densities[j] * width;
    }
    for (int k = 0; k < n; k++) {
        double u = (k + xi[k]) / n, below = 0, at = t_out;
        bool found = false;

        tau = 0;
        for (int j = 0; j < bins && !found; j++) {
            double width = edges[j + 1] - edges[j];
            double q = (1 - s->uniform_share) *
                           bin_mass(s, densities[j], width, tau, mean, length) / total +
                       s->uniform_share * width / length;

            found = u < below + q;
            if (found) /* else rounding left u above all bins */
                at = edges[j] + (u - below) / q * width;
            below += q;
            tau += densities[j] * width;
        }
        out[k] = clip(at, t_in, t_out);
    }
}

void ref_deltas(double t_in, double t_out, int n, const double *t, double *delta)
{
    for (int i = 0; i < n; i++) {
        double start = i == 0 ? t_in : (t[i - 1] + t[i]) / 2;
        double end = i == n - 1 ? t_out : (t[i] + t[i + 1]) / 2;

        delta[i] = end - start;
    }
}
