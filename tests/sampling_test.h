/* The float64 way from a ray's stage-1 points to its stage-2 samples, for the tests of both ways to those
 * points (test_sampling.c: gather, test_splat.c), and the comparison with what the device made. Discrete
 * results (leaves, counts) must be equal; a ray on which float32 may decide otherwise (it passes within
 * NEAR of an edge, or a count is within NEAR of the next) is left out, counted and capped. */
#ifndef CLN_TESTS_SAMPLING_TEST_H
#define CLN_TESTS_SAMPLING_TEST_H

#include "device_test.h"
#include "reference/reference.h"

enum { MOST_INTERVALS = 64, MOST_POINTS = 512, MOST_SAMPLES = 2048 };
static const double NEAR = 4e-6;

/* Stage-1 points of passage `interval` of ray r, ascending; returns their number. *close is set if
 * rounding may give others. */
typedef int points_fn(void *user, int r, const double o[3], const double d[3],
                      const ref_interval *interval, double *t, double *sigma, bool *close);

typedef struct ray_source {
    const cln_octree *tree;
    const cln_config *config;
    cln_sampling sampling;
    points_fn *points;
    void *user;
} ray_source;

typedef struct ray_samples {
    bool close; /* float32 may decide otherwise somewhere */
    int n;
    double t[MOST_SAMPLES], delta[MOST_SAMPLES];
    int slot[MOST_SAMPLES];
} ray_samples;

static inline bool near_integer(double x, double within)
{
    return fabs(x - round(x)) < within;
}

/* Other leaves when the ray is moved a little? */
static inline bool near_edges(const cln_octree *tree, const double o[3], const double d[3],
                              const ref_interval *iv, int n)
{
    ref_interval other[MOST_INTERVALS];

    for (int k = 0; k < 6; k++) {
        double moved[3] = {o[0], o[1], o[2]};
        int m = 0;

        moved[k / 2] += k % 2 ? NEAR : -NEAR;
        m = ref_intervals(tree, moved, d, other, MOST_INTERVALS);
        if (m != n)
            return true;
        for (int i = 0; i < n; i++) {
            if (other[i].slot != iv[i].slot)
                return true;
        }
    }
    return false;
}

static inline double leaf_side(const cln_octree *tree, int slot)
{
    return 2.0 / (1 << tree->level[tree->leaf[slot]]);
}

/* Optical depth of a passage: points' densities times their share of the chord. */
static inline double passage_depth(const ref_interval *v, int m, const double *t,
                                   const double *sigma)
{
    double tau = 0;

    for (int j = 0; j < m; j++) {
        const double left = j == 0 ? v->t_in : (t[j - 1] + t[j]) / 2;
        const double right = j == m - 1 ? v->t_out : (t[j] + t[j + 1]) / 2;

        tau += sigma[j] * (right - left);
    }
    return tau;
}

/* Is the number of samples of this passage one that rounding could change? */
static inline bool close_count(const ref_sampling *s, double length, double side, double tau_in,
                               double tau)
{
    const double weight = exp(-tau_in) * -expm1(-tau);

    if (s->t_min > 0 && fabs(exp(-tau_in) / s->t_min - 1) < 1e-3)
        return true;
    if (!s->by_weight)
        return near_integer(s->samples_per_leaf * length / (sqrt(3) * side), 1e-3);
    if (s->empty_weight > 0 && fabs(weight / s->empty_weight - 1) < 1e-3)
        return true;
    return near_integer(s->samples_per_ray * weight + 0.5, 1e-3);
}

static inline ref_sampling reference_sampling(const ray_source *from)
{
    const cln_config *c = from->config;

    return (ref_sampling){.by_weight = c->allocate == CLN_ALLOCATE_WEIGHT,
                          .cdf_weight = c->cdf == CLN_CDF_WEIGHT,
                          .samples_per_leaf = c->samples_per_leaf,
                          .samples_per_ray = c->samples_per_ray,
                          .uniform_share = from->sampling.uniform_share,
                          .t_min = from->sampling.t_min,
                          .empty_weight = from->sampling.empty_weight,
                          .empty_share = from->sampling.empty_share};
}

/* Samples of one ray, all passages. */
static inline void reference_ray(const ray_source *from, int r, const float fo[4],
                                 const float fd[4], ray_samples *out)
{
    const double o[3] = {fo[0], fo[1], fo[2]}, d[3] = {fd[0], fd[1], fd[2]};
    const cln_sampling *s = &from->sampling;
    const ref_sampling rule = reference_sampling(from);
    ref_interval iv[MOST_INTERVALS];
    const int n = ref_intervals(from->tree, o, d, iv, MOST_INTERVALS);
    double tau = 0;
    uint32_t drawn = 0;

    out->n = 0;
    out->close = near_edges(from->tree, o, d, iv, n);
    for (int i = 0; i < n; i++) {
        const double side = leaf_side(from->tree, iv[i].slot), length = iv[i].t_out - iv[i].t_in;
        double t[MOST_POINTS], sigma[MOST_POINTS], xi[256], at[256], delta[256], passage = 0;
        const int m = from->points(from->user, r, o, d, &iv[i], t, sigma, &out->close);
        float u[4];
        int count = 0;

        passage = passage_depth(&iv[i], m, t, sigma);
        cln_uniform4(s->seed, CLN_STREAM_SAMPLES, s->step, (uint32_t)r,
                     CLN_DRAW_ROULETTE + (uint32_t)i, u);
        count = ref_sample_count(&rule, length, side, tau, passage, u[0]);
        out->close = out->close || close_count(&rule, length, side, tau, passage);
        tau += passage;
        for (int k = 0; k < count; k++, drawn++) {
            cln_uniform4(s->seed, CLN_STREAM_SAMPLES, s->step, (uint32_t)r, drawn >> 2, u);
            xi[k] = s->jitter ? (double)u[drawn & 3] : 0.5;
        }
        ref_sample_positions(&rule, iv[i].t_in, iv[i].t_out, m, t, sigma, count, xi, at);
        ref_deltas(iv[i].t_in, iv[i].t_out, count, at, delta);
        assert_true(out->n + count <= MOST_SAMPLES);
        for (int k = 0; k < count; k++) {
            out->t[out->n] = at[k];
            out->delta[out->n] = delta[k];
            out->slot[out->n++] = iv[i].slot;
        }
    }
}

/* Runs the stage twice, the second time into guarded buffers that start as NaN: the same bytes. */
typedef struct device_samples {
    int rays;
    uint32_t n, *starts; /* [rays + 1] */
    cln_sample *samples; /* [n] */
} device_samples;

static inline void device_samples_free(device_samples *d)
{
    free(d->starts);
    free(d->samples);
    memset(d, 0, sizeof *d);
}

static inline void run_stage(cln_pipeline *p, int rays, const cln_sampling *s, device_samples *out)
{
    const size_t n = (size_t)rays, word = sizeof(uint32_t);
    const size_t intervals = n * ((size_t)3 << p->depth) * sizeof(cln_interval);
    cln_device *device = p->device;
    cln_sample *first = NULL;
    uint32_t count = 0;
    int used = 0;

    memset(out, 0, sizeof *out);
    assert_ok(cln_stage_sample(p, rays, s, &out->rays, &out->n));
    first = test_alloc(out->n, sizeof *first);
    assert_ok(cln_buffer_read(device, &p->samples, 0, first, out->n * sizeof *first));
    test_fill(device, &p->used, NULL, n * word);
    test_fill(device, &p->sample_counts, NULL, n * word);
    test_fill(device, &p->sample_starts, NULL, (n + 1) * word);
    test_fill(device, &p->intervals, NULL, intervals);
    test_fill(device, &p->samples, NULL, out->n * sizeof *first);
    assert_ok(cln_stage_sample(p, rays, s, &used, &count));
    assert_int_equal(used, out->rays);
    assert_int_equal(count, out->n);
    free(test_read(device, &p->used, n * word, "used"));
    free(test_read(device, &p->sample_counts, n * word, "sample counts"));
    free(test_read(device, &p->intervals, intervals, "intervals"));
    out->starts = test_read(device, &p->sample_starts, (n + 1) * word, "sample starts");
    out->samples = test_read(device, &p->samples, out->n * sizeof *first, "samples");
    assert_memory_equal(first, out->samples, out->n * sizeof *first);
    free(first);
}

/* True of any samples: in order, in their leaf's chord, deltas that fill each chord. */
static inline void check_samples(const cln_octree *tree, const device_samples *d, float (*o)[4],
                                 float (*dir)[4])
{
    for (int r = 0; r < d->rays; r++) {
        double chord = 0, filled = 0, last = 0;

        assert_true(d->starts[r] <= d->starts[r + 1] && d->starts[r + 1] <= d->n);
        for (uint32_t i = d->starts[r]; i < d->starts[r + 1]; i++) {
            const cln_sample *s = &d->samples[i];
            const bool first = i == d->starts[r] || d->samples[i - 1].slot != s->slot;

            assert_int_equal(s->ray, r);
            assert_true(s->slot >= 0 && s->slot < tree->leaf_count);
            if (!(isfinite(s->t) && isfinite(s->delta) && s->t >= last && s->delta >= 0))
                fail_msg("ray %d: sample %u at %g after %g, delta %g", r, i - d->starts[r],
                         (double)s->t, last, (double)s->delta);
            last = s->t;
            filled = first ? (double)s->delta : filled + (double)s->delta;
            if (i + 1 == d->starts[r + 1] || d->samples[i + 1].slot != s->slot) {
                const double from[3] = {o[r][0], o[r][1], o[r][2]};
                const double along[3] = {dir[r][0], dir[r][1], dir[r][2]};
                ref_interval iv[MOST_INTERVALS];
                const int n = ref_intervals(tree, from, along, iv, MOST_INTERVALS);

                chord = 0;
                for (int k = 0; k < n; k++) {
                    if (iv[k].slot == s->slot) {
                        chord = iv[k].t_out - iv[k].t_in;
                        assert_true(s->t >= iv[k].t_in - 1e-5 && s->t <= iv[k].t_out + 1e-5);
                    }
                }
                if (!(fabs(chord - filled) < 2e-5))
                    fail_msg("ray %d, leaf %d: deltas sum to %.9g, the chord is %.9g", r, s->slot,
                             filled, chord);
            }
        }
    }
}

/* All samples against the reference. Returns the share of rays that were left out. */
static inline double compare_samples(const char *name, const ray_source *from,
                                     const device_samples *d, float (*o)[4], float (*dir)[4],
                                     double most_left_out)
{
    float *t = test_alloc(d->n, sizeof *t), *delta = test_alloc(d->n, sizeof *delta);
    double *want_t = test_alloc(d->n, sizeof *want_t),
           *want_delta = test_alloc(d->n, sizeof *want_t);
    ray_samples *ray = test_alloc(1, sizeof *ray);
    size_t n = 0;
    int left_out = 0;

    for (int r = 0; r < d->rays; r++) {
        const uint32_t first = d->starts[r], count = d->starts[r + 1] - first;

        reference_ray(from, r, o[r], dir[r], ray);
        if (ray->close) {
            left_out++;
            continue;
        }
        if ((int)count != ray->n)
            fail_msg("%s: ray %d has %u samples, the reference %d", name, r, count, ray->n);
        for (uint32_t i = 0; i < count; i++) {
            if (d->samples[first + i].slot != ray->slot[i])
                fail_msg("%s: ray %d, sample %u is in leaf %d, not %d", name, r, i,
                         d->samples[first + i].slot, ray->slot[i]);
            t[n] = d->samples[first + i].t;
            delta[n] = d->samples[first + i].delta;
            want_t[n] = ray->t[i];
            want_delta[n++] = ray->delta[i];
        }
    }
    /* t to a few ulp of its size; a delta is a difference of such t. */
    compare(name, t, want_t, n, (bounds){1e-12, 2e-5});
    compare(name, delta, want_delta, n, (bounds){1e-7, 5e-3});
    if (left_out > most_left_out * d->rays)
        fail_msg("%s: %d of %d rays are too close to decide", name, left_out, d->rays);
    free(t);
    free(delta);
    free(want_t);
    free(want_delta);
    free(ray);
    return (double)left_out / d->rays;
}

/* A model with leaves at levels 1 to 3, some culled, and random densities: empty, thin and thick. */
static inline void make_sampling_model(const cln_config *config, cln_model *model)
{
    const int cells = config->n1 * config->n1 * config->n1;

    assert_ok(cln_model_create(config, model));
    for (int round = 0; round < 3; round++) {
        const int leaves = model->tree.leaf_count;
        uint8_t *mark = test_alloc((size_t)leaves, 1);
        cln_octree_change change = {0};

        for (int s = 0; s < leaves; s++)
            mark[s] = test_uniform(20 + (uint64_t)round, s, 0, 1) < (round == 0 ? 0.6 : 0.25);
        if (round < 2)
            assert_ok(cln_octree_split(&model->tree, mark, &change));
        else
            assert_ok(cln_octree_cull(&model->tree, mark, &change));
        assert_ok(cln_model_apply(model, &change));
        cln_octree_change_free(&change);
        free(mark);
    }
    for (int i = 0; i < model->tree.leaf_count * cells; i++) {
        const double u = test_uniform(30, i, 0, 1), leaf = test_uniform(31, i / cells, 0, 1);
        const double sigma = u < 0.3 ? 0 : pow(10, test_uniform(32, i, -3, leaf < 0.2 ? 2 : 0.3));

        model->density[i] = ref_to_bf16((float)sigma);
    }
}

#endif
