/* composite.cl, and stretch.cl with three ranks, against the float64 reference: pictures, losses
 * and gradients of rays from none to many samples, with optical depths from 1e-12 to 1e6, opaque
 * first samples, and every loss and regulariser. Errors are compared over all rays, and each with
 * the scale of its own element: a faint ray's opacity, a hidden sample's gradient. */
#include "unit.h"
#include "device_test.h"
#include "pipeline/stretch.h"
#include "near.h"
#include "reference/reference.h"
#include "tests.h"

enum { RAYS = 203, MOST = 61 };

typedef struct batch {
    uint32_t starts[RAYS + 1], samples;
    cln_sample *sample;
    float (*out)[4], (*targets)[4], (*backgrounds)[4], (*ray_o)[4], (*ray_d)[4], (*shown)[4];
} batch;

/* sigma * delta of sample i of ray r: every kind of ray that sampling can produce. */
static double optical_of(int r, int i, int n)
{
    static const double extremes[] = {0, 1e-12, 1e-6, 1e-3, 1, 80, 1e4, 1e6};

    if (r % 9 == 0)
        return extremes[r / 9 % 8];
    if (r % 9 == 1) /* opaque first */
        return i == 0 ? 1e6 : 0.1;
    if (r % 9 == 2) /* empty, then a surface */
        return i == n / 2 ? 30 : 1e-9;
    if (r % 9 == 3)
        return extremes[(r + i) % 8];
    return pow(10, test_uniform(1, r * MOST + i, -4, 0.5));
}

static void make_batch(batch *b)
{
    uint32_t at = 0;

    for (int r = 0; r < RAYS; r++) {
        b->starts[r] = at;
        at += (uint32_t)(r % 7 == 6 ? 0 : r % 5 == 0 ? 1 : 1 + r * 13 % MOST);
    }
    b->starts[RAYS] = b->samples = at;
    b->sample = test_alloc(at, sizeof *b->sample);
    b->out = test_alloc(at, sizeof *b->out);
    b->targets = test_alloc(RAYS, sizeof *b->targets);
    b->backgrounds = test_alloc(RAYS, sizeof *b->backgrounds);
    b->ray_o = test_alloc(RAYS, sizeof *b->ray_o);
    b->ray_d = test_alloc(RAYS, sizeof *b->ray_d);
    b->shown = test_alloc(RAYS, sizeof *b->shown);
    for (int r = 0; r < RAYS; r++) {
        const int n = (int)(b->starts[r + 1] - b->starts[r]);
        double t = test_uniform(2, r, 0, 4);

        for (int i = 0; i < n; i++) {
            cln_sample *s = &b->sample[b->starts[r] + (uint32_t)i];
            float *out = b->out[b->starts[r] + (uint32_t)i];
            const double delta = pow(10, test_uniform(3, r * MOST + i, -4, -1));

            s->delta = (float)delta;
            s->t = (float)(t + delta / 2);
            s->ray = (uint32_t)r;
            t += delta;
            for (int k = 0; k < 3; k++)
                out[k] = (float)test_uniform(4, (r * MOST + i) * 3 + k, 0, 1);
            out[3] = (float)(optical_of(r, i, n) / delta);
        }
        for (int k = 0; k < 3; k++) {
            b->targets[r][k] = (float)test_uniform(5, 3 * r + k, 0, 1);
            b->backgrounds[r][k] = (float)test_uniform(6, 3 * r + k, 0, 1);
        }
        b->targets[r][3] = r % 3 ? (float)test_uniform(8, r, 0, 1) : (float)(r % 2);
        if (r % 7 == 5)
            b->targets[r][3] = CLN_ALPHA_UNTOLD;
        b->ray_d[r][3] = (float)test_uniform(7, r, 0.5, 1);
        for (int k = 0; k < 3; k++) { /* points on the ray and beside it; some rays have none */
            b->ray_o[r][k] = (float)test_uniform(10, 3 * r + k, -2, 2);
            b->ray_d[r][k] = k == r % 3 ? 0 : k == (r + 1) % 3 ? 0.8f : -0.6f;
            b->shown[r][k] = (float)test_uniform(11, 3 * r + k, -1, 1);
        }
        b->shown[r][3] = r % 5 ? (float)test_uniform(12, r, 0, 1) : 0;
        b->ray_o[r][3] = r % 4 ? 0 : (float)test_uniform(9, r, 0, 20);
    }
}

static void free_batch(batch *b)
{
    free(b->sample);
    free(b->out);
    free(b->targets);
    free(b->backgrounds);
    free(b->ray_o);
    free(b->ray_d);
    free(b->shown);
}

static void upload(cln_pipeline *p, const batch *b, bool per_ray)
{
    cln_device *device = p->device;

    test_fill(device, &p->sample_starts, b->starts, sizeof b->starts);
    test_fill(device, &p->samples, b->sample, b->samples * sizeof *b->sample);
    test_fill(device, &p->out, b->out, b->samples * sizeof *b->out);
    test_fill(device, &p->targets, b->targets, RAYS * sizeof *b->targets);
    test_fill(device, &p->backgrounds, b->backgrounds,
              (per_ray ? RAYS : 1) * sizeof *b->backgrounds);
    test_fill(device, &p->ray_o, b->ray_o, RAYS * sizeof *b->ray_o);
    test_fill(device, &p->ray_d, b->ray_d, RAYS * sizeof *b->ray_d);
    if (p->config.depth_loss > 0)
        test_fill(device, &p->shown, b->shown, RAYS * sizeof *b->shown);
    test_fill(device, &p->results, NULL, RAYS * sizeof(cln_ray_result));
    test_fill(device, &p->dout, NULL, b->samples * sizeof *b->out);
}

/* One ray widened to double. */
typedef struct wide_ray {
    int n;
    double out[MOST][4], t[MOST], delta[MOST], background[3], target[4];
} wide_ray;

static void widen(const batch *b, int r, bool per_ray, wide_ray *w)
{
    w->n = (int)(b->starts[r + 1] - b->starts[r]);
    for (int i = 0; i < w->n; i++) {
        const uint32_t s = b->starts[r] + (uint32_t)i;

        w->t[i] = b->sample[s].t;
        w->delta[i] = b->sample[s].delta;
        for (int k = 0; k < 4; k++)
            w->out[i][k] = b->out[s][k];
    }
    for (int k = 0; k < 3; k++)
        w->background[k] = b->backgrounds[per_ray ? r : 0][k];
    for (int k = 0; k < 4; k++)
        w->target[k] = b->targets[r][k];
}

/* Pictures: colour, depth of each kind, opacity. */
static void check_pictures(cln_pipeline *p, const batch *b, bool per_ray, unsigned kind)
{
    cln_ray_result *results = NULL;
    float got[5][RAYS];
    double want[5][RAYS];

    upload(p, b, per_ray);
    assert_ok(cln_stage_composite(p, RAYS, kind));
    results = test_read(p->device, &p->results, RAYS * sizeof *results, "results");
    for (int r = 0; r < RAYS; r++) {
        wide_ray w;
        double rgb[3], depth = 0, opacity = 0;

        widen(b, r, per_ray, &w);
        ref_composite(w.n, w.out, w.t, w.delta, w.background, rgb, &depth, &opacity, NULL);
        for (int k = 0; k < 3; k++) {
            want[k][r] = rgb[k];
            got[k][r] = (&results[r].r)[k];
        }
        if (kind == CLN_DEPTH_MEDIAN)
            depth = ref_median_depth(w.n, (const double(*)[4])w.out, w.t, w.delta);
        depth += b->ray_o[r][3] * opacity / fmax(opacity, 1e-10); /* from the camera to the ray's
                                                                     begin */
        want[3][r] = depth;
        got[3][r] = results[r].depth;
        want[4][r] = opacity;
        got[4][r] = results[r].opacity;
        assert_true(results[r].opacity >= 0 && results[r].opacity <= 1.00001f);
    }
    /* all are sums of numbers above 0, so their scale is their value */
    for (int k = 0; k < 5; k++) {
        compare(k < 3    ? "colour"
                : k == 3 ? "depth"
                         : "opacity",
                got[k], want[k], RAYS, (bounds){k == 3 ? 1e-11 : 1e-12, 1e-5});
        compare_scaled(k < 3    ? "colour"
                       : k == 3 ? "depth"
                                : "opacity",
                       got[k], want[k], want[k], RAYS, 1e-5);
    }
    free(results);
}

static void test_pictures(void **state)
{
    batch b;

    (void)state;
    make_batch(&b);
    for (int set = 0; set < TUNE_SETS; set++) {
        cln_config config = small_config();
        const bool per_ray = set % 2;
        cln_pipeline *p = NULL;

        config.random_background = per_ray;
        p = test_pipeline(&tune_sets[set], &config, false, true);
        check_pictures(p, &b, per_ray, CLN_DEPTH_MEDIAN);
        check_pictures(p, &b, per_ray, CLN_DEPTH_MEAN);
    }
    free_batch(&b);
    test_report("pictures");
}

/* Losses built into the kernel: each regulariser alone, then all. */
typedef struct loss_case {
    const char *name;
    ref_loss loss;
    bool per_ray;
} loss_case;

static const loss_case loss_cases[] = {
    {"l2", {.kind = CLN_LOSS_L2, .huber_delta = 0.1}, false},
    {"huber", {.kind = CLN_LOSS_HUBER, .huber_delta = 0.15}, true},
    {"cauchy", {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .cauchy = 0.01}, false},
    {"opacity entropy", {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .opacity_entropy = 0.1}, true},
    {"distortion", {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .distortion = 0.5}, false},
    {"alpha", {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .alpha = 0.3}, false},
    {"depth", {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .depth = 0.4}, false},
    {"all",
     {.kind = CLN_LOSS_HUBER,
      .huber_delta = 0.2,
      .cauchy = 0.001,
      .opacity_entropy = 0.05,
      .distortion = 0.2,
      .alpha = 0.1,
      .depth = 0.3},
     true},
};

enum { RANKS = 3 };

/* The rays' samples, cut into intervals of one to four in leaves 0 to RANKS - 1, one of each rank.
 * [k][ray], as the kernels have them. */
static cln_interval *make_intervals(const batch *b, uint32_t *used)
{
    cln_interval *all = test_alloc(MOST * RAYS, sizeof *all);

    for (int r = 0; r < RAYS; r++) {
        used[r] = 0;
        for (uint32_t i = b->starts[r]; i < b->starts[r + 1];) {
            const uint32_t left = b->starts[r + 1] - i;
            const uint32_t wanted = 1 + (uint32_t)test_uniform(10, (int)i, 0, 4);
            const uint32_t n = wanted < left ? wanted : left;
            cln_interval *v = &all[used[r]++ * RAYS + (uint32_t)r];

            v->t_in = b->sample[i].t - b->sample[i].delta / 2;
            v->slot = (int32_t)test_uniform(11, (int)i, 0, RANKS);
            v->count = CLN_INTERVAL_COUNT(n, 3u);
            i += n;
        }
    }
    return all;
}

/* Uploads rank `me`'s part of the batch; mine: [sample] numbers of its samples. */
static void upload_part(cln_pipeline *p, const batch *b, int me, uint32_t *mine)
{
    cln_sample *sample = test_alloc(b->samples, sizeof *sample);
    float(*out)[4] = test_alloc(b->samples, sizeof *out);
    uint32_t used[RAYS], count = 0, starts[RAYS + 1], seen[RAYS + 1];
    cln_interval *intervals = make_intervals(b, used), *listed = NULL;

    for (int r = 0; r < RAYS; r++) {
        uint32_t i = b->starts[r];

        starts[r] = count;
        for (uint32_t k = 0; k < used[r]; k++) {
            const cln_interval v = intervals[k * RAYS + (uint32_t)r];

            for (uint32_t j = 0; j < CLN_INTERVAL_SAMPLES(v.count); j++, i++)
                if (v.slot == me) {
                    sample[count] = b->sample[i];
                    memcpy(out[count], b->out[i], sizeof *out);
                    mine[count++] = i;
                }
        }
    }
    starts[RAYS] = count;
    test_fill(p->device, &p->intervals, intervals, MOST * RAYS * sizeof *intervals);
    test_fill(p->device, &p->used, used, sizeof used);
    test_fill(p->device, &p->sample_starts, b->starts, sizeof b->starts);
    /* a batch that will be cut: rays behind have no samples and no stretches */
    assert_ok(cln_stretch_find(p, RAYS, me, b->starts[RAYS / 2]));
    assert_ok(cln_buffer_read(p->device, &p->own_starts, 0, seen, sizeof seen));
    for (int r = 0; r <= RAYS; r++)
        assert_int_equal(seen[r], starts[b->starts[r] <= b->starts[RAYS / 2] ? r : RAYS / 2]);
    assert_true(p->stretch_total < b->samples);
    assert_ok(cln_stretch_find(p, RAYS, me, SIZE_MAX));
    assert_ok(cln_buffer_read(p->device, &p->own_starts, 0, seen, sizeof seen));
    assert_memory_equal(seen, starts, sizeof seen);
    listed = test_read(p->device, &p->intervals, MOST * RAYS * sizeof *intervals, "intervals");
    for (int r = 0; r < RAYS; r++) /* others' samples are not placed here */
        for (uint32_t k = 0; k < used[r]; k++) {
            const cln_interval v = intervals[k * RAYS + (uint32_t)r];

            assert_int_equal(listed[k * RAYS + (uint32_t)r].count,
                             v.slot == me ? v.count : CLN_INTERVAL_COUNT(0u, 3u));
        }
    test_fill(p->device, &p->samples, sample, count * sizeof *sample);
    test_fill(p->device, &p->out, out, count * sizeof *out);
    test_fill(p->device, &p->results, NULL, RAYS * sizeof(cln_ray_result));
    free(sample);
    free(out);
    free(intervals);
    free(listed);
}

/* A leaf for each rank. */
static void deal_leaves(cln_pipeline *p)
{
    p->ranks = RANKS;
    p->leaves = RANKS;
    p->rank_first = test_alloc(RANKS + 1, sizeof *p->rank_first);
    for (int r = 0; r <= RANKS; r++)
        p->rank_first[r] = r;
    assert_ok(cln_pipeline_want(p, CLN_PROGRAM_BIT(stretch) | CLN_PROGRAM_BIT(scan)));
}

/* composite_train by RANKS ranks, one after the other: each sees only the others' sums. */
static void composite_stretches(cln_pipeline *p, const batch *b, float (*dout)[4],
                                cln_ray_result *results)
{
    uint32_t *mine = test_alloc(b->samples, sizeof *mine), *rank = NULL;
    char *all = NULL, *part = NULL; /* sums of stretches, of `row` bytes each */
    float(*got)[4] = test_alloc(b->samples, sizeof *got);
    const size_t row = cln_buffer_row_bytes(p, CLN_BUFFER_stretch_sums);
    cln_ray_result others[RAYS];
    size_t bytes = 0;

    deal_leaves(p);
    for (int me = 0; me < RANKS; me++) {
        upload_part(p, b, me, mine);
        bytes = p->stretch_total * row;
        all = all ? all : test_alloc(p->stretch_total, row);
        part = part ? part : test_alloc(p->stretch_total, row);
        rank = rank ? rank : test_alloc(p->stretch_total, sizeof *rank);
        assert_ok(cln_stretch_composite(p, RAYS, me));
        assert_ok(cln_buffer_read(p->device, &p->stretch_sums, 0, part, bytes));
        assert_ok(
            cln_buffer_read(p->device, &p->stretch_rank, 0, rank, p->stretch_total * sizeof *rank));
        for (uint32_t k = 0; k < p->stretch_total; k++)
            if ((int)rank[k] == me)
                memcpy(all + k * row, part + k * row, row);
    }
    for (int me = 0; me < RANKS; me++) {
        uint32_t count = 0;

        upload_part(p, b, me, mine);
        test_fill(p->device, &p->targets, b->targets, RAYS * sizeof *b->targets);
        assert_ok(cln_buffer_write(p->device, &p->stretch_sums, 0, all, bytes));
        assert_ok(cln_stretch_cut(p, RAYS, &count));
        assert_ok(cln_stretch_train(p, RAYS, me, count));
        assert_ok(cln_buffer_read(p->device, &p->dout, 0, got, count * sizeof *got));
        for (uint32_t i = 0; i < count; i++)
            memcpy(dout[mine[i]], got[i], sizeof *dout);
        assert_ok(cln_buffer_read(p->device, &p->results, 0, me ? others : results, sizeof others));
        if (me) /* the same on all ranks */
            assert_memory_equal(others, results, sizeof others);
    }
    free(mine);
    free(rank);
    free(all);
    free(part);
    free(got);
}

/* Scales of the gradients of a ray's samples: of dL/dc the sample's weight; of dL/dsigma delta
 * times the light that reaches behind the sample times the largest dL/dw that the losses can have,
 * and Cauchy's own. The bound's share that grows with the optical depth before is in them, too. */
static void scale_gradients(const ref_loss *loss, const wide_ray *w, double *colour,
                            double *density)
{
    const int n = w->n;
    const double span = n ? w->t[n - 1] - w->t[0] + w->delta[n - 1] : 0;
    const double most = 3 + loss->opacity_entropy / 0.11 + 4 * loss->distortion * span +
                        2 * loss->alpha +
                        loss->depth * (1 + fabs(loss->reach) + (n ? w->t[n - 1] : 0));
    double tau = 0;

    for (int i = 0; i < n; i++) {
        const double sigma = w->out[i][3], x = fmin(sigma * w->delta[i], 80);
        const double weight = exp(-tau) * -expm1(-x);

        tau += x;
        for (int k = 0; k < 3; k++)
            colour[3 * i + k] = weight * (1 + 0.03 * tau) / RAYS;
        density[i] = (most * w->delta[i] * exp(-tau) * (1 + 0.1 * tau) +
                      loss->cauchy * 4 * sigma / (1 + 2 * sigma * sigma)) /
                     RAYS;
    }
}

/* Rays of the pixel that ray r belongs to, where pixels have several: 1, 4, 9, 1, 4, 9 ... The last
 * one has fewer than it should. */
static int find_pixel(int r, int *first, int *count)
{
    static const int counts[] = {1, 4, 9};
    int pixel = 0;

    for (*first = 0; *first + counts[pixel % 3] <= r; pixel++)
        *first += counts[pixel % 3];
    *count = *first + counts[pixel % 3] <= RAYS ? counts[pixel % 3] : RAYS - *first;
    return counts[pixel % 3];
}

static void upload_pixels(cln_pipeline *p)
{
    cln_pixel pixels[RAYS] = {{0}};
    int alone = 0;

    for (int r = 0; r < RAYS; r++) {
        int first = 0, count = 0;
        const int each = find_pixel(r, &first, &count);

        pixels[r].spot = CLN_SPOT(r - 100, 100 - r, r - first, each);
        alone += r == first;
    }
    p->rays_per_pixel = (double)RAYS / alone;
    test_fill(p->device, &p->pixels, pixels, sizeof pixels);
}

/* Colour and transmittance of a ray, the mean ones of its pixel. */
static void find_means(const batch *b, int r, bool per_ray, double own[4], double mean[4])
{
    int first = 0, count = 0;

    find_pixel(r, &first, &count);
    memset(mean, 0, 4 * sizeof *mean);
    for (int i = first; i < first + count; i++) {
        wide_ray w;
        double rgbt[4], depth = 0;

        widen(b, i, per_ray, &w);
        ref_composite(w.n, w.out, w.t, w.delta, w.background, rgbt, &depth, &rgbt[3], NULL);
        rgbt[3] = 1 - rgbt[3];
        for (int k = 0; k < 4; k++)
            mean[k] += rgbt[k] / count;
        if (i == r)
            memcpy(own, rgbt, sizeof rgbt);
    }
}

/* The loss of a pixel from its definition: that of the mean colour and the mean opacity. */
static double loss_of_means(const ref_loss *loss, const double mean[4], const double target[4])
{
    const double surplus = target[3] == CLN_ALPHA_UNTOLD ? 0 : mean[3] - (1 - target[3]);
    double sum = loss->alpha * surplus * surplus;

    for (int k = 0; k < 3; k++)
        sum += (mean[k] - target[k]) * (mean[k] - target[k]) / 3;
    return sum;
}

/* Gradients of l2 and of the loss of opacity, of each ray's first sample, against differences of
 * that definition. */
static void check_definition(const ref_loss *loss, const batch *b, const double (*want)[4])
{
    int checked = 0;

    for (int r = 0; r < RAYS; r++)
        for (int k = 0; k < 4 && b->starts[r] < b->starts[r + 1]; k++) {
            float *value = &b->out[b->starts[r]][k];
            const float before = *value, step = 1e-3f * fmaxf(before, 1e-2f);
            double own[4], mean[4], target[4], places[2], losses[2];
            int first = 0, count = 0;

            if (k == 3 && before * b->sample[b->starts[r]].delta > 5)
                continue; /* opaque: its slope is below what differences tell */
            find_pixel(r, &first, &count);
            for (int c = 0; c < 4; c++)
                target[c] = b->targets[r][c];
            for (int side = 0; side < 2; side++) {
                *value = before + (side ? step : -step);
                places[side] = *value;
                find_means(b, r, false, own, mean);
                losses[side] = loss_of_means(loss, mean, target);
            }
            *value = before;
            assert_near((losses[1] - losses[0]) / (places[1] - places[0]),
                        want[b->starts[r]][k] / count, 1e-3 * fabs(want[b->starts[r]][k]) + 1e-9);
            checked++;
        }
    assert_true(checked > 2 * RAYS);
}

/* Who composites, one rank or several; and whether pixels have several rays. */
typedef struct way {
    bool stretches, pixels;
} way;

static void check_losses(const loss_case *c, const tune_set *set, const batch *b, way by)
{
    char square_name[96], colour_name[96], density_name[96];
    cln_config config = small_config();
    cln_ray_result *results = NULL;
    float(*dout)[4] = NULL, *colour_gradient = test_alloc(3 * b->samples, sizeof(float));
    float *density_gradient = test_alloc(b->samples, sizeof(float)), loss[RAYS], square[RAYS];
    double(*want)[4] = test_alloc(b->samples + 1, sizeof *want), want_loss[RAYS], want_square[RAYS];
    double *want_colour = test_alloc(3 * b->samples, sizeof(double));
    double *want_density = test_alloc(b->samples, sizeof(double));
    double *colour_scale = test_alloc(3 * b->samples, sizeof(double));
    double *density_scale = test_alloc(b->samples, sizeof(double));
    double loss_scale[RAYS], square_scale[RAYS];
    cln_pipeline *p = NULL;

    config.loss = c->loss.kind;
    config.huber_delta = c->loss.huber_delta;
    config.cauchy = c->loss.cauchy;
    config.opacity_entropy = c->loss.opacity_entropy;
    config.distortion_loss = c->loss.distortion;
    config.alpha_loss = c->loss.alpha;
    config.depth_loss = c->loss.depth;
    config.random_background = c->per_ray;
    config.antialias = by.pixels ? 2 : 1;
    p = test_pipeline(set, &config, false, true);
    upload(p, b, c->per_ray);
    if (by.pixels)
        upload_pixels(p);
    if (by.stretches) {
        results = test_alloc(RAYS, sizeof *results);
        dout = test_alloc(b->samples, sizeof *dout);
        composite_stretches(p, b, dout, results);
    } else {
        assert_ok(cln_stage_composite_train(p, RAYS, b->samples));
        results = test_read(p->device, &p->results, RAYS * sizeof *results, "results");
        dout = test_read(p->device, &p->dout, b->samples * sizeof *dout, "dout");
    }
    for (int r = 0; r < RAYS; r++) {
        wide_ray w;
        ref_loss rule = c->loss;
        double rgb[3], depth = 0, opacity = 0, own[4], mean[4];

        rule.depth *= b->shown[r][3];
        rule.reach = ref_reach(b->ray_o[r], b->ray_d[r], b->shown[r]);
        widen(b, r, c->per_ray, &w);
        if (by.pixels) { /* as far from its target as the mean is from the pixel's */
            find_means(b, r, c->per_ray, own, mean);
            for (int k = 0; k < 4; k++)
                w.target[k] += (k < 3 ? 1 : -1) * (own[k] - mean[k]);
        }
        ref_composite(w.n, w.out, w.t, w.delta, w.background, rgb, &depth, &opacity, NULL);
        want_loss[r] = ref_loss_of_ray(&rule, w.n, w.out, w.t, w.delta, w.background, w.target,
                                       want + b->starts[r]);
        want_square[r] = 0;
        for (int k = 0; k < 3; k++)
            want_square[r] += (rgb[k] - w.target[k]) * (rgb[k] - w.target[k]) / 3;
        scale_gradients(&rule, &w, colour_scale + 3 * b->starts[r], density_scale + b->starts[r]);
        loss_scale[r] = fmax(fabs(want_loss[r]), 1e-2);
        square_scale[r] = sqrt(want_square[r]); /* of a difference, whose error is the colours' */
        loss[r] = results[r].loss;
        square[r] = results[r].square_error;
        assert_true(results[r].opacity >= 0 && results[r].opacity <= 1.00001f);
    }
    if (by.pixels && c->loss.kind == CLN_LOSS_L2 && !c->per_ray && c->loss.cauchy == 0 &&
        c->loss.distortion == 0 && c->loss.depth == 0)
        check_definition(&c->loss, b, (const double(*)[4])want);
    for (uint32_t i = 0; i < b->samples; i++) {
        const int ray = (int)b->sample[i].ray;
        int first = 0, count = 1;

        if (by.pixels)
            find_pixel(ray, &first, &count);
        for (int k = 0; k < 4; k++) /* the loss is a mean over pixels, a pixel's over its rays */
            want[i][k] *= p->rays_per_pixel / count;
        assert_near(fabs(results[ray].share), 1.0 / count, 1e-6);
        assert_int_equal(results[ray].share<0, c->loss.depth> 0 && b->shown[ray][3] > 0);
        for (int k = 0; k < 3; k++) {
            colour_gradient[3 * i + (uint32_t)k] = dout[i][k];
            want_colour[3 * i + (uint32_t)k] = want[i][k] / RAYS;
        }
        density_gradient[i] = dout[i][3];
        want_density[i] = want[i][3] / RAYS;
    }
    snprintf(square_name, sizeof square_name, "%s: square error", c->name);
    snprintf(colour_name, sizeof colour_name, "%s: colour gradient", c->name);
    snprintf(density_name, sizeof density_name, "%s: density gradient", c->name);
    compare(c->name, loss, want_loss, RAYS, (bounds){1e-10, 1e-4});
    compare(square_name, square, want_square, RAYS, (bounds){1e-11, 1e-5});
    compare(colour_name, colour_gradient, want_colour, 3 * b->samples, (bounds){1e-10, 1e-4});
    compare(density_name, density_gradient, want_density, b->samples, (bounds){1e-9, 1e-3});
    compare_scaled(c->name, loss, want_loss, loss_scale, RAYS, 1e-4);
    compare_scaled(square_name, square, want_square, square_scale, RAYS, 1e-5);
    compare_scaled(colour_name, colour_gradient, want_colour, colour_scale, 3 * b->samples, 1e-5);
    compare_scaled(density_name, density_gradient, want_density, density_scale, b->samples, 1e-5);
    free(colour_scale);
    free(density_scale);
    free(results);
    free(dout);
    free(colour_gradient);
    free(density_gradient);
    free(want);
    free(want_colour);
    free(want_density);
}

static void test_losses(void **state)
{
    batch b;

    (void)state;
    make_batch(&b);
    for (size_t c = 0; c < sizeof loss_cases / sizeof loss_cases[0]; c++)
        check_losses(&loss_cases[c], &tune_sets[c % TUNE_SETS], &b, (way){false, false});
    free_batch(&b);
    test_report("losses and gradients");
}

static void test_stretches(void **state)
{
    batch b;

    (void)state;
    make_batch(&b);
    for (size_t c = 0; c < sizeof loss_cases / sizeof loss_cases[0]; c++)
        check_losses(&loss_cases[c], &tune_sets[(c + 1) % TUNE_SETS], &b, (way){true, false});
    free_batch(&b);
    test_report("losses and gradients by ranks");
}

/* Pixels that are the mean of several rays: one target and one background each. */
static void test_pixels(void **state)
{
    batch b;

    (void)state;
    make_batch(&b);
    for (int r = 0; r < RAYS; r++) {
        int first = 0, count = 0;

        find_pixel(r, &first, &count);
        memcpy(b.targets[r], b.targets[first], sizeof *b.targets);
        memcpy(b.backgrounds[r], b.backgrounds[first], sizeof *b.backgrounds);
    }
    for (size_t c = 0; c < sizeof loss_cases / sizeof loss_cases[0]; c++)
        for (int stretches = 0; stretches < 2; stretches++)
            check_losses(&loss_cases[c], &tune_sets[(c + 2) % TUNE_SETS], &b,
                         (way){stretches, true});
    free_batch(&b);
    test_report("losses and gradients of pixels with several rays");
}

/* The first ray keeps its samples and stretches although it alone has more than there is room for;
 * those behind it have none. */
static void test_too_long(void **state)
{
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, false, false);
    uint32_t *mine = NULL, starts[2][RAYS + 1], of_first[2];
    batch b;

    (void)state;
    make_batch(&b);
    mine = test_alloc(b.samples, sizeof *mine);
    assert_true(b.starts[1] > 0);
    deal_leaves(p);
    upload_part(p, &b, 0, mine);
    for (int cut = 0; cut < 2; cut++) {
        assert_ok(cln_stretch_find(p, RAYS, 0, cut ? 0 : SIZE_MAX));
        assert_ok(cln_buffer_read(p->device, &p->stretch_starts, 0, starts[cut], sizeof *starts));
        of_first[cut] = starts[cut][1];
    }
    assert_true(of_first[0] > 0 && starts[0][RAYS] > of_first[0]);
    assert_int_equal(of_first[1], of_first[0]);
    assert_int_equal(starts[1][RAYS], of_first[0]);
    free(mine);
    free_batch(&b);
}

/* No rays at all: nothing is launched, nothing written. */
static void test_no_rays(void **state)
{
    const cln_config config = small_config();
    const uint32_t start = 0;
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, false, false);

    (void)state;
    test_fill(p->device, &p->sample_starts, &start, sizeof start);
    test_fill(p->device, &p->results, NULL, 0);
    test_fill(p->device, &p->dout, NULL, 0);
    assert_ok(cln_stage_composite(p, 0, 0));
    assert_ok(cln_stage_composite_train(p, 0, 0));
    free(test_read(p->device, &p->results, 0, "results"));
    free(test_read(p->device, &p->dout, 0, "dout"));
}

int test_group_composite(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pictures),  cmocka_unit_test(test_losses),
        cmocka_unit_test(test_stretches), cmocka_unit_test(test_too_long),
        cmocka_unit_test(test_pixels),    cmocka_unit_test(test_no_rays),
    };

    test_wanted = CLN_PROGRAM_BIT(composite);
    return cmocka_run_group_tests_name("composite", tests, NULL, test_device_close);
}
