/* Float64 twin of every kernel, in plain loops, straight from method.md: the oracle of tests and
 * self-test. It shares no arithmetic with kernels/, only the data layout (network.h), the random
 * numbers (base/rng.h) and the definitions written here. Inputs are the kernels' float32 values,
 * widened. Clarity matters, speed does not.
 *
 * Units: normalised space, root cube [-1,1]^3, unit directions, t = distance; density per unit. */
#ifndef CLN_REFERENCE_H
#define CLN_REFERENCE_H

#include <stdint.h>
#include "model/network.h"
#include "model/octree.h"

/* ---- rays through the tree (method.md 3, 7) ---- */

typedef struct ref_interval {
    int slot;
    double t_in, t_out;
} ref_interval;

/* Finds the ACTIVE leaves along origin + t * direction, t >= 0, front to back, with chords longer
 * than 1e-5. Directions with zeros and origins inside boxes or on faces are ordinary input. Returns
 * the count; writes at most `max`. Brute force: slab tests on all leaves, then a sort. */
int ref_intervals(const cln_octree *tree, const double origin[3], const double direction[3],
                  ref_interval *out, int max);

/* ---- stage 1 (method.md 4, 5, 6) ---- */

/* Gather: m = max(1, ceil(n1 * L / side)) points at the midpoints of m equal parts of the chord,
 * with densities of the nearest cells of the leaf's cache [n1][n1][n1] (z, y, x). Returns m. */
int ref_gather(const double origin[3], const double direction[3], const ref_interval *interval,
               const float box[4], const float *cache, int n1, double *t, double *sigma, int max);

/* bfloat16 (round to nearest even) <-> float. */
uint16_t ref_to_bf16(float value);
float ref_from_bf16(uint16_t bits);

/* 64-bit sort key: list << 32 | bits of float t (t >= 0). */
uint64_t ref_key(uint32_t list, float t);

/* ---- stage 2 (method.md 7, 9) ---- */

typedef struct ref_sampling {
    bool by_weight;  /* allocate weight (else chord) */
    bool cdf_weight; /* cdf weight (else sigma) */
    int samples_per_leaf, samples_per_ray;
    double uniform_share, min_transmittance; /* min_transmittance 0 = no occlusion culling */
    double empty_weight, empty_share;
} ref_sampling;

/* Number of samples for a chord of length L in a leaf of side `side`, roulette in [0,1):
 *   0 if exp(-tau_in) < min_transmittance
 *   chord:  ceil(samples_per_leaf * L / (sqrt(3) side)), at least 1
 *   weight: with W = exp(-tau_in) * (1 - exp(-tau)), tau the chord's own optical depth of stage 1,
 *           if W < empty_weight: 1 if roulette < empty_share, else 0;
 *           otherwise min(samples_per_leaf, 1 + floor(samples_per_ray * W + 0.5)) */
int ref_sample_count(const ref_sampling *s, double length, double side, double tau_in, double tau,
                     double roulette);

/* Stage-1 points of a chord: t ascending, density, and the length that each stands for (NULL:
 * any). */
typedef struct ref_points {
    int m;
    const double *t, *sigma, *lengths; /* [m] */
} ref_points;

/* Bins of [t_in, t_out] by m points: a point's bin reaches half way to its neighbours, and to the
 * chord's ends; what bins leave free has density 0. On a side where that is more than 1.5 times
 * lengths[j], its bin reaches only half of lengths[j]. Writes edges [2 m + 2], densities [2 m + 1];
 * returns 2 m + 1. */
int ref_bins(double t_in, double t_out, ref_points p, double *edges, double *densities);

/* Places n samples, ascending, in the bins above.
 *   mass       p_j = (sigma_j + eps) * width_j, eps = 1e-5 max(1, mean sigma), or for cdf_weight
 *              T_j (1 - exp(-sigma_j width_j)) + 1e-5 width_j / L, T_j from the chord's start
 *   mixed      q_j = (1 - uniform_share) p_j / sum p + uniform_share width_j / L
 *   positions  u_k = (k + xi_k) / n, linear inverse inside a bin */
void ref_sample_positions(const ref_sampling *s, double t_in, double t_out, ref_points p, int n,
                          const double *xi, double *out);

/* Deltas of n ascending samples in the chord (method.md 9); they sum to t_out - t_in. */
void ref_deltas(double t_in, double t_out, int n, const double *t, double *delta);

/* ---- a ray's way to its samples ---- */

enum { REF_MOST_INTERVALS = 256, REF_MOST_POINTS = 512, REF_MOST_SAMPLES = 8192 };
#define REF_NEAR 4e-6 /* float32 may decide differently on rays closer to an edge than this */

/* Gives the stage-1 points of an interval of ray r, ascending, and the lengths that they stand for.
 * Returns their number, at most REF_MOST_POINTS. Sets *close if rounding may give other points. */
typedef int ref_points_fn(void *user, int r, const double o[3], const double d[3],
                          const ref_interval *interval, double *t, double *sigma, double *lengths,
                          bool *close);

/* Points by gather; `user` is one of these. */
typedef struct ref_gather_cache {
    int n1;
    const float *boxes; /* [slot][4] */
    const float *cache; /* [slot][n1^3] densities */
} ref_gather_cache;
ref_points_fn ref_gather_points;

typedef struct ref_way {
    const cln_octree *tree;
    ref_sampling rule;
    bool jitter;
    uint64_t seed;
    uint32_t step;
    ref_points_fn *points;
    void *user;
    const float (*crop)[4]; /* [6], as cln_sampling's; not with lines */
    bool lines;             /* a ray has CLN_LINE_ROWS rows, of a shell space */
} ref_way;

typedef struct ref_samples {
    bool close; /* float32 may decide differently somewhere */
    int n;
    double t[REF_MOST_SAMPLES], delta[REF_MOST_SAMPLES];
    int slot[REF_MOST_SAMPLES], row[REF_MOST_SAMPLES]; /* row: that of its line; 0 without lines */
} ref_samples;

/* The intervals of a ray in the tree's leaves; with a crop, their parts inside all half-spaces.
 * Front to back; returns their number. */
int ref_way_intervals(const ref_way *way, const double o[3], const double d[3],
                      ref_interval out[REF_MOST_INTERVALS]);

/* Optical depth of an interval: its bins' densities times their widths. */
double ref_interval_depth(const ref_interval *v, ref_points p);

/* The sure part of that, of evenly spaced points: without the last one. */
double ref_interval_sure(const ref_interval *v, ref_points p);

/* Makes the samples of ray r of a batch, in all intervals. o, d: its row, or all of its rows. */
void ref_ray_samples(const ref_way *way, int r, const float *o, const float *d, ref_samples *out);

/* ---- leaf networks (method.md 1) ---- */

typedef struct ref_network {
    cln_network net;
    int density;                /* CLN_DENSITY_* */
    double kappa, bias;         /* sigma = kappa * softplus(s + bias), etc. */
    double level_bands[10];     /* weight of band k (bands_by_level), else 1 */
    const double *wide;         /* if not NULL, used instead of params, which may be NULL then;
                               not with a network on a grid */
    const float *decoder;       /* voxels': its weights; NULL without one */
    const double *wide_decoder; /* if not NULL, used instead of decoder */
    double *decoder_grad;       /* ref_backward adds to it; NULL: not wanted */
} ref_network;

/* Encodings. Frequency: x[3] -> out[enc_pad]; zero padding. Grid: linear between the vertices of
 * grid [cells + 1]^3 (z, y, x) [features] over [-1,1]^3; out, dout [features]; adds to grad. */
void ref_encode(int bands, const double x[3], const double *weights, int pad, double *out);
void ref_grid(int cells, int features, const float *grid, const double x[3], double *out);
void ref_grid_wide(int cells, int features, const double *grid, const double x[3], double *out);
void ref_grid_backward(int cells, int features, const double x[3], const double *dout,
                       double *grad);
/* Voxels: raw colours and density at a leaf's local position in a direction, and the gradient of
 * the vertices, grad [params], which is added to. */
void ref_voxel(const ref_network *r, const float *params, const double local[3],
               const double dir[3], double raw[4]);
void ref_voxel_backward(const ref_network *r, const float *params, const double local[3],
                        const double dir[3], const double draw[4], double *grad);
/* The smallest |x| of the decoder's hidden units, before their activation; infinite without one. */
double ref_decoder_margin(const ref_network *r, const float *params, const double local[3],
                          const double dir[3]);
/* Finds the leaf that updates a vertex, which several leaves may share: owner[leaf * vertices +
 * vertex] is that leaf's own leaf * vertices + vertex. around: cln_octree_around. */
void ref_voxel_owners(const cln_network *net, int leaves, const int32_t (*around)[27], int *owner);
/* If it is the turn of leaf `slot` in the step of `key`, adds to grad [vertices][features] the
 * gradient of its smoothness at the vertices `met`, and returns true. One leaf in four has its
 * turn, and counts four times. params: the leaf's; level: its. */
bool ref_voxel_smooth(const cln_config *config, const cln_network *net, int level, int slot,
                      uint32_t key, const float *params, const uint8_t *met, double *grad);
typedef struct ref_adam_rule {
    double lr, beta1, beta2, epsilon;
} ref_adam_rule;

/* A step of one number by Adam, but the second moment begins as a tenth of the first gradient's
 * square, and the moments are not bias-corrected (method.md 1). */
void ref_voxel_step(double *param, double grad, double *m, double *v, ref_adam_rule rule);

/* Evaluates a sample. local[3] in [-1,1]; dir[3] unit (ignored without view dependence). slopes:
 * negative-side slopes r of all elements, [depth][width] of the trunk, then [view_width] of the
 * view layer; NULL = `slope` everywhere. out[4] = colour r, g, b in 0..1 and sigma. */
void ref_forward(const ref_network *r, const float *params, const double local[3],
                 const double dir[3], const double *slopes, double slope, double out[4]);

/* dc/d(raw) of a colour c = sigmoid(raw), given dL/dc: c (1 - c), but at least this where a step
 * would lead c away from the end, 0 or 1, that it is near (method.md 9). */
#define REF_SLOPE_LEAST 0x1p-25
double ref_colour_slope(double colour, double gradient);

/* The smallest absolute pre-activation of a sample: if it is below rounding errors, float32 may
 * have it on the other side of zero, with another gradient. */
double ref_margin(const ref_network *r, const float *params, const double local[3],
                  const double dir[3], const double *slopes, double slope);

/* Adds dL/dparams of a sample to grad[params], given dL/dout[4]. */
void ref_backward(const ref_network *r, const float *params, const double local[3],
                  const double dir[3], const double *slopes, double slope, const double dout[4],
                  double *grad);

/* ---- Russian roulette before the backward pass (kernels/roulette.cl) ---- */

/* Decides on n samples ids[0..n) of out and dout [sample] together, by draws in (0, 1] that hash
 * key and id. heads [n]: dL/d(raw r, g, b, sigma) times factors. factors [n]: with size = |heads|_1
 * and `least` = cutoff times the mean size, 0 if draw * least >= size, else max(1, least / size); 1
 * without cutoff. Returns the smallest distance of a draw from its threshold. */
double ref_roulette(const ref_network *r, double cutoff, uint32_t key, int n, const uint32_t *ids,
                    const float (*out)[4], const float (*dout)[4], double (*heads)[4],
                    double *factors);

/* ---- compositing and loss (method.md 9, 10) ---- */

typedef struct ref_loss {
    int kind; /* CLN_LOSS_* */
    double huber_delta;
    double cauchy, opacity_entropy, distortion, alpha;
    double depth, reach; /* weight times the point's trust; t of the point that the ray shows */
} ref_loss;

/* Composites n samples front to back: out[i] = r, g, b, sigma. sigma * delta is clamped to 80.
 * Depth = sum w t / max(sum w, 1e-10). weights: [n] or NULL. */
void ref_composite(int n, const double (*out)[4], const double *t, const double *delta,
                   const double background[3], double rgb[3], double *depth, double *opacity,
                   double *weights);

/* The t before which half of the weights' sum lies; 0 if the sum is 0. Sample i is t[i] +- delta[i]
 * / 2. */
double ref_median_depth(int n, const double (*out)[4], const double *t, const double *delta);

/* t of the point of a ray that is nearest to `point`. */
double ref_reach(const float origin[4], const float direction[4], const float point[4]);

/* Loss of a ray, not yet averaged over rays. l2: mean_c (C - target)^2; huber: mean_c of d^2/2
 * below huber_delta, huber_delta (|d| - huber_delta/2) above; plus cauchy * sum log(1 + 2 sigma^2)
 * + opacity_entropy * log1p(A (1-A) / 0.11) + distortion * (sum_ij w_i w_j |t_i - t_j| + 1/3 sum
 * w_i^2 delta_i) + alpha * (T_end - (1 - target[3]))^2 + depth * (sum_i w_i |t_i - reach| + T_end).
 * grad (may be NULL): dL/d(r, g, b, sigma) per sample, by a true backward sweep. */
double ref_loss_of_ray(const ref_loss *loss, int n, const double (*out)[4], const double *t,
                       const double *delta, const double background[3], const double target[4],
                       double (*grad)[4]);

/* ---- single samples and points (method.md 10, 11, 12.3) ---- */

/* Measures of each sample of a ray: its share of the ray's mean squared error, T sigma delta, T
 * delta. */
void ref_measures(int n, const double (*out)[4], const double *delta, const double background[3],
                  const double target[3], double (*measures)[3]);

/* (alpha - alpha*)^2 + alpha* |c - c*|^2 / 3 of a point, target = c*, alpha*; and its gradient. */
double ref_distil(const double out[4], const double target[4], double delta, double grad[4]);

/* d/dsigma of 1 - exp(-0.05 sigma); gradient of a quarter of |f_a - f_b|, f = alpha (r, g, b,
 * 1). */
double ref_sparsity_gradient(double sigma);
void ref_edge_gradient(const double a[4], const double b[4], double spacing, double grad_a[4],
                       double grad_b[4]);

/* ---- Adam (method.md 11) ---- */

/* One update with bias correction by `steps` (1 = first update). */
void ref_adam(int n, double *param, const double *grad, double *m, double *v, int64_t steps,
              ref_adam_rule rule);

#endif
