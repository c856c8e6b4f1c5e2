/* The device's samples of stage 2 against float64 (reference/ray_samples.c), for both kinds of
 * stage 1: gather (test_sampling.c) and splat (test_splat.c). Discrete results (leaves, counts)
 * must be equal. Rays on which rounding may change a decision of float32 are skipped and counted;
 * their share is limited. */
#ifndef CLN_TESTS_SAMPLING_TEST_H
#define CLN_TESTS_SAMPLING_TEST_H

#include "device_test.h"
#include "check/selftest_checks.h"

/* The rays of a batch, and the parameters of their samples. */
typedef struct ray_source {
    const cln_octree *tree;
    const cln_config *config;
    cln_sampling sampling;
    ref_points_fn *points;
    void *user;
    bool lines; /* rays have CLN_LINE_ROWS rows */
} ray_source;

/* Result of running the stage twice, the second time into guarded buffers of NaN; both must give
 * the same bytes. */
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
    const size_t intervals = n * (size_t)p->most_intervals * sizeof(cln_interval);
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

/* Samples must be in order and in their leaf's chord, and their deltas must fill it. */
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
                ref_interval iv[REF_MOST_INTERVALS];
                const int n = ref_intervals(tree, from, along, iv, REF_MOST_INTERVALS);

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

/* Compares all samples with the reference; returns the share of skipped rays. */
static inline double compare_samples(const char *name, const ray_source *from,
                                     const device_samples *d, float (*o)[4], float (*dir)[4],
                                     double most_left_out)
{
    float *t = test_alloc(d->n, sizeof *t), *delta = test_alloc(d->n, sizeof *delta);
    double *want_t = test_alloc(d->n, sizeof *want_t),
           *want_delta = test_alloc(d->n, sizeof *want_t);
    ref_samples *ray = test_alloc(1, sizeof *ray);
    ref_way way = cln_check_way(from->tree, from->config, &from->sampling);
    size_t n = 0;
    int left_out = 0;

    way.points = from->points;
    way.user = from->user;
    way.lines = from->lines;
    for (int r = 0; r < d->rays; r++) {
        const uint32_t first = d->starts[r], count = d->starts[r + 1] - first;

        const int row = from->lines ? r * CLN_LINE_ROWS : r;

        ref_ray_samples(&way, r, o[row], dir[row], ray);
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
            if (from->lines && d->samples[first + i].ray != (uint32_t)(row + ray->row[i]))
                fail_msg("%s: ray %d, sample %u is on row %u, not %d", name, r, i,
                         d->samples[first + i].ray, row + ray->row[i]);
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

/* Gives a model's tree leaves of two more levels, some culled, and random densities from empty to
 * thick. */
static inline void vary_sampling_model(const cln_config *config, cln_model *model)
{
    const int cells = config->n1 * config->n1 * config->n1;

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

/* A model with leaves at levels 1 to 3. */
static inline void make_sampling_model(const cln_config *config, cln_model *model)
{
    assert_ok(cln_model_create(config, model));
    vary_sampling_model(config, model);
}

#endif
