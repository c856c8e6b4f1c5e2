/* The update of voxels against the float64 reference: gradients of leaves that share vertices are
 * added, and the smoothness' gradient, too; every copy of a vertex gets the bits of one step;
 * vertices that no sample met keep theirs. Also shared vertices after a change of the tree, and
 * samples of pictures, as they lie along rays. Forward to train, and backward: test_mlp.c. */
#include "unit.h"
#include "device_test.h"
#include "pipeline/carry.h"
#include "reference/reference.h"
#include "tests.h"

enum { CELLS = 4, SIDE = CELLS + 1, VERTICES = SIDE * SIDE * SIDE, MOST = 64 };
enum { DEEPEST = 3, WIDE = (CELLS << DEEPEST) + 1, KEYS = WIDE * WIDE * WIDE * (DEEPEST + 1) };

typedef struct voxel_case {
    const char *name;
    int set, harmonics, decoder;
    double beta1, smooth_density, smooth_colour, density_lr, harmonics_lr;
    double density_delta, colour_delta; /* where the squares turn linear; 0: never */
} voxel_case;

static const voxel_case cases[] = {
    {"default", 0, 1, 32, 0, 0, 0, 4, 0.2, 0, 0},
    {"smooth, no decoder", 0, 1, 0, 0, 3e-5, 1e-5, 4, 0.2, 0.2, 0.1},
    {"smooth, tiny deltas", 0, 1, 0, 0, 3e-5, 1e-5, 4, 0.2, 1e-160, 1e-20},
    {"slices", 1, 1, 16, 0, 0, 0, 4, 0.2, 0, 0},
    {"plain, momentum", 1, 2, 48, 0.9, 1e-5, 3e-5, 1, 1, 0, 0},
    {"wide vectors", 2, 2, 16, 0, 1e-5, 0, 2, 0.5, 0, 0},
    {"items, no view", 3, 0, 0, 0, 0, 1e-5, 1, 1, 0, 0},
    {"items", 3, 1, 16, 0, 0, 1e-5, 1, 1, 0, 0.1},
    {"gpu", 4, 1, 32, 0.9, 1e-5, 1e-5, 4, 0.2, 0.2, 0},
};

static cln_config config_of(const voxel_case *c)
{
    cln_config config = small_config();

    config.encoding = CLN_ENCODING_VOXEL;
    config.grid_cells = CELLS;
    config.view_dependence = c->harmonics > 0;
    config.harmonics = c->harmonics;
    config.decoder_width = c->decoder;
    config.decoder_rate = 0.5;
    config.start_level = 2;
    config.beta1 = c->beta1;
    config.beta2 = 0.99;
    config.epsilon = 1e-10;
    config.moments = CLN_MOMENTS_FLOAT32;
    config.roulette = 1e-6; /* samples without a gradient take no part, all others do */
    config.smooth_density = c->smooth_density;
    config.smooth_colour = c->smooth_colour;
    config.smooth_density_delta = c->density_delta;
    config.smooth_colour_delta = c->colour_delta;
    config.density_rate = c->density_lr;
    config.harmonic_rate = c->harmonics_lr;
    return config;
}

/* A vertex's place in a lattice of the cube at the leaf's size: the same for all leaves that share
 * it. */
static int key_of(const cln_octree *tree, int slot, int v)
{
    const int node = tree->leaf[slot], level = tree->level[node];
    const int at[3] = {v % SIDE, v / SIDE % SIDE, v / (SIDE * SIDE)};
    const int n = (CELLS << level) + 1;
    int key = 0;

    for (int a = 2; a >= 0; a--)
        key = key * n + tree->pos[node][a] * CELLS + at[a];
    return key * (DEEPEST + 1) + level;
}

/* The vertices that share a place, as circles of rows (slot * VERTICES + v): each has the
 * next row, the last one the first's. The caller frees it. */
static int *circles_of(const cln_octree *tree)
{
    const int rows = tree->leaf_count * VERTICES;
    int *next = test_alloc((size_t)rows, sizeof *next);
    int *last = test_alloc(KEYS, sizeof *last); /* its row + 1; 0: none yet */

    for (int row = 0; row < rows; row++) {
        const int key = key_of(tree, row / VERTICES, row % VERTICES);

        assert_in_range(key, 0, KEYS - 1);
        next[row] = row;
        if (last[key] > 0) {
            next[row] = next[last[key] - 1];
            next[last[key] - 1] = row;
        }
        last[key] = row + 1;
    }
    free(last);
    return next;
}

/* A number of a vertex; reds of neighbours are often equal. */
static float number_at(int key, int f)
{
    const double n = test_uniform(4, key * 32 + f, -1, 1);

    return (float)(f > 0 ? n : n < 0 ? -0.5 : 0.5);
}

/* 64 leaves of level 2, some of them gone, one split. Numbers of a vertex follow from its place. */
static void make_model(const cln_config *config, cln_model *model)
{
    uint8_t cull[MOST] = {0}, split[MOST] = {0};
    cln_octree_change change = {0};

    assert_ok(cln_model_create(config, model));
    assert_int_equal(model->tree.leaf_count, MOST);
    for (int s = 5; s < MOST; s += 3)
        cull[s] = 1;
    assert_ok(cln_octree_cull(&model->tree, cull, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    split[7] = 1;
    assert_ok(cln_octree_split(&model->tree, split, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    for (int s = 0; s < model->tree.leaf_count; s++)
        for (int v = 0; v < VERTICES; v++)
            for (int f = 0; f < model->net.features; f++)
                model->params[s * model->net.params + v * model->net.features + f] =
                    number_at(key_of(&model->tree, s, v), f);
    for (int i = 0; i < model->net.decoder_params; i++)
        model->decoder[i] = (float)test_uniform(6, i, -0.5, 0.5);
}

typedef struct batch {
    uint32_t n;
    cln_sample *samples;
    float (*ray_o)[4], (*ray_d)[4], (*dout)[4];
} batch;

/* Every other leaf has samples, at exact places: t = 0. slice: some have two slices of so many and
 * a few more; 0: none. */
static void make_batch(const cln_octree *tree, uint32_t slice, batch *b)
{
    float *boxes = NULL;
    uint32_t counts[MOST * 2] = {0}, at = 0;

    for (int s = 0; s < tree->leaf_count; s++)
        b->n += counts[s] = s % 2 ? 0 : 3 + (uint32_t)s % 5 * 7 + (s % 3 ? 0 : 2 * slice);
    b->samples = test_alloc(b->n, sizeof *b->samples);
    b->ray_o = test_alloc(b->n, sizeof *b->ray_o);
    b->ray_d = test_alloc(b->n, sizeof *b->ray_d);
    b->dout = test_alloc(b->n, sizeof *b->dout);
    assert_ok(cln_octree_boxes(tree, &boxes));
    for (int s = 0; s < tree->leaf_count; s++)
        for (uint32_t k = 0; k < counts[s]; k++, at++) {
            const double d[3] = {test_uniform(1, (int)at, -1, 1), test_uniform(2, (int)at, -1, 1),
                                 0.5};
            const double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);

            b->samples[at] = (cln_sample){.ray = at, .slot = s, .delta = 0.01f};
            for (int a = 0; a < 3; a++) {
                const double part = floor(test_uniform(3, (int)(3 * at) + a, 0, 1024)) / 1024;

                b->ray_o[at][a] = (float)(boxes[4 * s + a] + part * boxes[4 * s + 3]);
                b->ray_d[at][a] = (float)(d[a] / length);
            }
            for (int i = 0; i < 4; i++)
                b->dout[at][i] = at % 3 == 1 ? 0
                                             : (float)test_uniform(5, (int)(4 * at) + i, -1, 1) *
                                                   (i == 3 ? 0.01f : 1);
        }
    free(boxes);
}

static void free_batch(batch *b)
{
    free(b->samples);
    free(b->ray_o);
    free(b->ray_d);
    free(b->dout);
}

/* ---- the reference's side ---- */

/* Gradients [leaf][params] of the batch, the decoder's [decoder_params], and which vertices it met
 * [leaf][VERTICES]: all of it, and the samples of each leaf's first slice, `starts` [sample]. */
static void backward(const cln_config *config, const cln_model *model, const batch *b,
                     const uint8_t *starts, double *grads, double *decoder, uint8_t *met,
                     uint8_t *met_first)
{
    ref_network r = {.net = model->net,
                     .density = config->density,
                     .decoder = model->decoder,
                     .decoder_grad = decoder};
    float *boxes = NULL;

    r.kappa = (float)config->density_scale;
    r.bias = (float)cln_network_density_bias(config);
    assert_ok(cln_octree_boxes(&model->tree, &boxes));
    for (uint32_t i = 0; i < b->n; i++) {
        const int s = b->samples[i].slot;
        const float *box = boxes + 4 * s;
        double local[3], dir[3], dout[4];
        int first = 0;

        if (b->dout[i][0] == 0)
            continue;
        for (int a = 2; a >= 0; a--) {
            local[a] = ((double)b->ray_o[i][a] - box[a]) * 2 / box[3] - 1;
            dir[a] = b->ray_d[i][a];
            first = first * SIDE + (int)fmin((local[a] + 1) / 2 * CELLS, CELLS - 1);
        }
        for (int k = 0; k < 4; k++)
            dout[k] = b->dout[i][k];
        for (int c = 0; c < 8; c++) {
            const int v = first + (c & 1) + (c >> 1 & 1) * SIDE + (c >> 2) * SIDE * SIDE;

            met[s * VERTICES + v] = 1;
            met_first[s * VERTICES + v] |= starts[i];
        }
        ref_backward(&r, model->params + s * model->net.params, local, dir, NULL, 0, dout,
                     grads + s * model->net.params);
    }
    free(boxes);
}

/* Which samples are in the first slices of their leaves, [sample]: the batch is in the order of
 * leaves, as grouped samples are. *several: leaves with more slices. */
static uint8_t *first_slices(cln_pipeline *p, const batch *b, int *several)
{
    uint8_t *starts = test_alloc(b->n, 1);
    cln_slice *slices = NULL;
    uint32_t count = 0;

    assert_ok(cln_stage_slices(p, &count));
    slices = test_alloc(count, sizeof *slices);
    assert_ok(cln_buffer_read(p->device, &p->slices, 0, slices, count * sizeof *slices));
    for (uint32_t k = 0; k < count; k++)
        if (k == 0 || slices[k].slot != slices[k - 1].slot)
            memset(starts + slices[k].start, 1, slices[k].count);
        else
            *several += k == 1 || slices[k].slot != slices[k - 2].slot;
    free(slices);
    return starts;
}

/* Adds the smoothness' gradient over leaves' edges, at vertices that first slices met. Edges on
 * faces count in every leaf that has them. */
static void smooth(const cln_config *config, const cln_model *model, uint32_t key, double *grads,
                   const uint8_t *met)
{
    const int params = model->net.params;

    for (int s = 0; s < model->tree.leaf_count; s++)
        ref_voxel_smooth(config, &model->net, model->tree.level[model->tree.leaf[s]], s, key,
                         model->params + s * params, met + s * VERTICES, grads + s * params);
}

/* One step of a leaf's vertex: the sum over all that share it, with the rates of its numbers. */
static void step(const cln_config *config, const cln_model *model, const double *grads,
                 const int *next, int row, double lr, double want[32], double second[32])
{
    const int features = model->net.features, params = model->net.params;

    for (int f = 0; f < features; f++) {
        const double rate = f == 3 ? config->density_rate : f > 3 ? config->harmonic_rate : 1;
        double g = 0, m = 0;
        int w = row;

        do
            g += grads[w / VERTICES * params + w % VERTICES * features + f];
        while ((w = next[w]) != row);
        want[f] = model->params[row / VERTICES * params + row % VERTICES * features + f];
        second[f] = 0;
        ref_voxel_step(&want[f], g, &m, &second[f],
                       (ref_adam_rule){lr * rate, (float)config->beta1, (float)config->beta2,
                                       (float)config->epsilon});
    }
}

static bool is_met(const int *next, const uint8_t *met, int row)
{
    bool any = met[row];

    for (int w = next[row]; w != row && !any; w = next[w])
        any = met[w];
    return any;
}

/* The decoder's gradient, and its first step: of the sign of a gradient alone, so that those which
 * nearly cancel are left out. */
static void check_decoder(const voxel_case *c, cln_pipeline *p, const cln_model *model,
                          const double *want, double lr)
{
    const int n = model->net.decoder_params;
    float *parts = test_alloc((size_t)(n * p->decoder_groups), sizeof *parts);
    float *weights = test_alloc((size_t)n, sizeof *weights);
    double *got = test_alloc((size_t)n, sizeof *got), largest = 0, worst = 0, off = 0;
    int stepped = 0;

    assert_true(p->decoder_groups > 1);
    assert_ok(cln_buffer_read(p->device, &p->decoder_grads, 0, parts,
                              (size_t)(n * p->decoder_groups) * sizeof *parts));
    assert_ok(CLN_GET(p, decoder_w, weights, 1));
    for (int i = 0; i < n * p->decoder_groups; i++)
        got[i % n] += parts[i];
    for (int i = 0; i < n; i++)
        largest = fmax(largest, fabs(want[i]));
    for (int i = 0; i < n; i++) {
        assert_true(isfinite(got[i]) && isfinite(weights[i]));
        worst = fmax(worst, fabs(got[i] - want[i]) / largest);
        if (fabs(want[i]) < 1e-3 * largest)
            continue;
        off = fmax(off, fabs((weights[i] - (double)model->decoder[i]) / (lr * sqrt(0.1)) +
                             (want[i] > 0 ? 1 : -1)));
        stepped++;
    }
    if (!(worst < 1e-6) || !(off < 1e-3) || stepped < n / 2)
        fail_msg(
            "%s: the decoder's gradient is off by %.2g of the largest, its step by %.2g; %d of "
            "%d weights",
            c->name, worst, off, stepped, n);
    free(parts);
    free(weights);
    free(got);
}

static void check_case(const voxel_case *c)
{
    const cln_config config = config_of(c);
    const uint32_t key = 0x1234567u;
    const double lr = 0.01;
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    cln_model model = {0};
    batch b = {0};
    double *grads = NULL, *decoder = NULL;
    float *got = NULL, *moments = NULL;
    const bool smoothed = c->smooth_density + c->smooth_colour > 0;
    uint8_t *met = NULL, *met_first = NULL, *starts = NULL;
    uint32_t slices = 0;
    int *next = NULL, row = 0, leaves = 0, met_count = 0, tied = 0, features = 0, several = 0;
    double worst = 0, wrong = 0, largest = 0;

    make_model(&config, &model);
    make_batch(&model.tree, smoothed ? (uint32_t)p->tune.sl : 0, &b);
    leaves = model.tree.leaf_count;
    next = circles_of(&model.tree);
    row = model.net.params;
    features = model.net.features;
    grads = test_alloc((size_t)(leaves * row), sizeof *grads);
    met = test_alloc((size_t)(leaves * VERTICES), 1);
    met_first = test_alloc((size_t)(leaves * VERTICES), 1);
    got = test_alloc((size_t)(leaves * row), sizeof *got);
    moments = test_alloc((size_t)(leaves * row), sizeof *moments);
    decoder = test_alloc((size_t)model.net.decoder_params + 1, sizeof *decoder);
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_ok(cln_pipeline_points(p, b.ray_o[0], b.ray_d[0], NULL, b.n));
    assert_ok(cln_pipeline_samples(p, b.samples, b.n));
    assert_ok(CLN_RESERVE(p, dout, b.n));
    assert_ok(cln_buffer_write(p->device, &p->dout, 0, b.dout, b.n * sizeof *b.dout));
    assert_ok(cln_stage_group(p, b.n, &slices));
    starts = first_slices(p, &b, &several);
    assert_true(!smoothed || several > 5);
    backward(&config, &model, &b, starts, grads, decoder, met, met_first);
    smooth(&config, &model, key, grads, met_first);
    assert_ok(cln_stage_forward(p, b.n, slices, true, key));
    assert_ok(cln_stage_update(p, b.n, slices, 1, key, lr));
    if (c->decoder)
        check_decoder(c, p, &model, decoder, lr * config.decoder_rate);
    assert_ok(CLN_GET(p, params, got, (size_t)leaves));
    assert_ok(CLN_GET(p, adam_v, moments, (size_t)leaves));

    for (int s = 0; s < leaves; s += 3)
        for (int v = s % 2; v < VERTICES; v += 2) {
            const float *mine = got + s * row + v * features;
            const int here = s * VERTICES + v;
            double want[32], second[32], seconds[32] = {0};
            int copy = here;

            if (!is_met(next, met, here)) {
                assert_memory_equal(mine, model.params + s * row + v * features,
                                    (size_t)features * sizeof *mine);
                continue;
            }
            met_count++;
            step(&config, &model, grads, next, here, lr, want, second);
            for (int f = 0; f < features; f++) {
                assert_true(isfinite(mine[f]));
                worst = fmax(worst, fabs(mine[f] - want[f]) / lr);
            }
            do {
                const int at = copy / VERTICES * row + copy % VERTICES * features;

                assert_memory_equal(mine, got + at, (size_t)features * sizeof *mine);
                for (int f = 0; f < features; f++) /* one of the copies has the moment */
                    seconds[f] += moments[at + f];
                tied += copy != here;
            } while ((copy = next[copy]) != here);
            for (int f = 0; f < features; f++) {
                largest = fmax(largest, second[f]);
                wrong = fmax(wrong, fabs(sqrt(seconds[f]) - sqrt(second[f])));
            }
        }
    /* a gradient that nearly cancels is a step of either sign: of the samples here none does */
    if (!(worst < 2e-3))
        fail_msg("%s: a vertex is off by %.2g of a step", c->name, worst);
    /* the first step hides the gradient's size, the second moment has it */
    if (!(wrong < 1e-6 * sqrt(largest)))
        fail_msg("%s: a gradient is off by %.2g of the largest", c->name, wrong / sqrt(largest));
    assert_true(met_count > 50 && tied > 50);
    print_message("%-20s %d vertices met, %d copies, off by %.1g of a step, gradient by %.1g\n",
                  c->name, met_count, tied, worst, wrong / sqrt(largest));
    free(moments);
    free(grads);
    free(decoder);
    free(met);
    free(met_first);
    free(starts);
    free(next);
    free(got);
    free_batch(&b);
    cln_model_free(&model);
}

static void test_update(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_case(&cases[i]);
}

/* Steps of the decoder after the first, by the gradients that the device has: its second moment
 * begins as a tenth of the first gradient's square. Weights whose gradient nearly cancels are left
 * out. */
static void test_decoder_steps(void **state)
{
    enum { STEPS = 3 };
    const voxel_case *c = &cases[0];
    const cln_config config = config_of(c);
    const double lr = 0.01, rate = lr * config.decoder_rate;
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    cln_model model = {0};
    batch b = {0};
    double *m = NULL, *v = NULL, *g = NULL, worst = 0;
    float *before = NULL, *after = NULL, *parts = NULL;
    uint32_t slices = 0;
    int n = 0, compared = 0;

    (void)state;
    make_model(&config, &model);
    make_batch(&model.tree, 0, &b);
    n = model.net.decoder_params;
    m = test_alloc((size_t)n, sizeof *m);
    v = test_alloc((size_t)n, sizeof *v);
    before = test_alloc((size_t)n, sizeof *before);
    after = test_alloc((size_t)n, sizeof *after);
    memcpy(before, model.decoder, (size_t)n * sizeof *before);
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_ok(cln_pipeline_points(p, b.ray_o[0], b.ray_d[0], NULL, b.n));
    assert_ok(cln_pipeline_samples(p, b.samples, b.n));
    assert_ok(CLN_RESERVE(p, dout, b.n));
    assert_ok(cln_buffer_write(p->device, &p->dout, 0, b.dout, b.n * sizeof *b.dout));
    for (int k = 0; k < STEPS; k++) {
        const uint32_t key = 0x1234567u + (uint32_t)k;
        double largest = 0;

        assert_ok(cln_stage_group(p, b.n, &slices));
        assert_ok(cln_stage_forward(p, b.n, slices, true, key));
        assert_ok(cln_stage_update(p, b.n, slices, 1, key, lr));
        parts = test_alloc((size_t)(n * p->decoder_groups), sizeof *parts);
        g = test_alloc((size_t)n, sizeof *g);
        assert_ok(cln_buffer_read(p->device, &p->decoder_grads, 0, parts,
                                  (size_t)(n * p->decoder_groups) * sizeof *parts));
        assert_ok(CLN_GET(p, decoder_w, after, 1));
        for (int i = 0; i < n * p->decoder_groups; i++)
            g[i % n] += parts[i];
        for (int i = 0; i < n; i++)
            largest = fmax(largest, fabs(g[i]));
        for (int i = 0; i < n; i++) {
            m[i] = 0.9 * m[i] + 0.1 * g[i];
            v[i] = v[i] > 0 ? 0.99 * v[i] + 0.01 * g[i] * g[i] : 0.1 * g[i] * g[i];
            if (fabs(g[i]) < 1e-3 * largest || k == 0)
                continue;
            worst = fmax(worst, fabs(((double)after[i] - (double)before[i]) / rate +
                                     m[i] / (sqrt(v[i]) + config.epsilon)));
            compared++;
        }
        memcpy(before, after, (size_t)n * sizeof *before);
        free(parts);
        free(g);
    }
    print_message("%d weights, a step is off by %.1g\n", compared, worst);
    assert_true(compared > n && worst < 1e-3);
    free(m);
    free(v);
    free(before);
    free(after);
    free_batch(&b);
    cln_model_free(&model);
}

/* One step from a decoder whose output is 0, at this rate: colours [sample], weights of leaves. */
static void first_step(const voxel_case *c, double rate, float (*out)[4], float *params,
                       float *decoder)
{
    const cln_config config = config_of(c);
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    cln_model model = {0};
    batch b = {0};
    uint32_t slices = 0;

    make_model(&config, &model);
    for (int i = model.net.decoder_params - 3 * c->decoder; i < model.net.decoder_params; i++)
        model.decoder[i] = 0;
    make_batch(&model.tree, 0, &b);
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_false(p->decodes);
    p->decoder_rate = rate;
    assert_ok(cln_pipeline_points(p, b.ray_o[0], b.ray_d[0], NULL, b.n));
    assert_ok(cln_pipeline_samples(p, b.samples, b.n));
    assert_ok(CLN_RESERVE(p, dout, b.n));
    assert_ok(cln_buffer_write(p->device, &p->dout, 0, b.dout, b.n * sizeof *b.dout));
    assert_ok(cln_stage_group(p, b.n, &slices));
    assert_ok(cln_stage_forward(p, b.n, slices, true, 0x1234567u));
    assert_ok(cln_stage_update(p, b.n, slices, 1, 0x1234567u, 0.01));
    assert_true(p->decodes == (rate > 0));
    assert_ok(cln_buffer_read(p->device, &p->out, 0, out, b.n * sizeof *out));
    assert_ok(CLN_GET(p, params, params, (size_t)model.tree.leaf_count));
    assert_ok(CLN_GET(p, decoder_w, decoder, 1));
    free_batch(&b);
    cln_model_free(&model);
}

/* A decoder that has not begun is left out, and nothing else changes, to the bit. */
static void test_decoder_waits(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const voxel_case *c = &cases[i];
        const cln_config config = config_of(c);
        cln_model model = {0};
        batch b = {0};
        float(*out[2])[4], *params[2], *decoder[2];
        size_t weights = 0, all = 0;

        if (!c->decoder)
            continue;
        make_model(&config, &model);
        make_batch(&model.tree, 0, &b);
        weights = (size_t)model.net.decoder_params;
        all = (size_t)(model.tree.leaf_count * model.net.params);
        for (int k = 0; k < 2; k++) {
            out[k] = test_alloc(b.n, sizeof *out[k]);
            params[k] = test_alloc(all, sizeof *params[k]);
            decoder[k] = test_alloc(weights, sizeof *decoder[k]);
            first_step(c, k * 0.1, out[k], params[k], decoder[k]);
        }
        assert_memory_equal(out[0], out[1], b.n * sizeof *out[0]);
        assert_memory_equal(params[0], params[1], all * sizeof *params[0]);
        assert_memory_not_equal(decoder[0], decoder[1], weights * sizeof *decoder[0]);
        for (int k = 0; k < 2; k++) {
            free(out[k]);
            free(params[k]);
            free(decoder[k]);
        }
        free_batch(&b);
        cln_model_free(&model);
    }
}

/* Colour and density of one sample in a leaf of these numbers. */
static void look(const cln_config *config, const cln_model *model, const float *params,
                 const batch *b, uint32_t i, const float box[4], double out[4])
{
    const cln_sample *s = &b->samples[i];
    ref_network r = {.net = model->net, .density = config->density, .decoder = model->decoder};
    double local[3], dir[3];

    r.kappa = (float)config->density_scale;
    r.bias = (float)cln_network_density_bias(config);
    for (int a = 0; a < 3; a++) {
        dir[a] = b->ray_d[s->ray][a];
        local[a] = (b->ray_o[s->ray][a] + s->t * dir[a] - box[a]) * 2 / box[3] - 1;
    }
    ref_forward(&r, params, local, dir, NULL, 0, out);
}

/* rng.h: the density noise, one normal number per sample and step (Box-Muller on two hashes). */
static double noise_of(uint32_t step_key, uint32_t sample)
{
    const uint32_t a = cln_hash((step_key ^ 0x27D4EB2Fu) + sample * 0x9E3779B9u);
    uint32_t b = a * 0x85EBCA6Bu + 0x165667B1u;

    b = (b ^ b >> 16) * 0x21F0AAADu;
    b ^= b >> 15;
    return sqrt(-2 * log(((a >> 8) + 1) * 0x1p-24)) * cos(2 * M_PI * (b >> 8) * 0x1p-24);
}

/* Densities of training have each sample's own noise, wherever it is in its slice. */
static void check_noise(const voxel_case *c)
{
    const uint32_t key = 0x7654321u;
    cln_config config = config_of(c);
    cln_pipeline *p = NULL;
    cln_model model = {0};
    batch b = {0};
    uint32_t slices = 0;
    float(*out)[4] = NULL, *got = NULL, *params = NULL, *boxes = NULL;
    double *want = NULL;

    config.density_noise = 0.5;
    p = test_pipeline(&tune_sets[c->set], &config, false, false);
    make_model(&config, &model);
    make_batch(&model.tree, (uint32_t)fmin(p->tune.sl, 64), &b);
    out = test_alloc(b.n, sizeof *out);
    got = test_alloc(b.n, sizeof *got);
    want = test_alloc(b.n, sizeof *want);
    params = test_alloc((size_t)model.net.params, sizeof *params);
    assert_ok(cln_octree_boxes(&model.tree, &boxes));
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_ok(cln_pipeline_points(p, b.ray_o[0], b.ray_d[0], NULL, b.n));
    assert_ok(cln_pipeline_samples(p, b.samples, b.n));
    assert_ok(cln_stage_group(p, b.n, &slices));
    assert_ok(cln_stage_forward(p, b.n, slices, true, key));
    assert_ok(cln_buffer_read(p->device, &p->out, 0, out, b.n * sizeof *out));
    for (uint32_t i = 0; i < b.n; i++) { /* noise of all vertices is that of their mean */
        const int s = b.samples[i].slot;
        double all[4];

        memcpy(params, model.params + s * model.net.params,
               (size_t)model.net.params * sizeof *params);
        for (int v = 3; v < VERTICES * model.net.features; v += model.net.features)
            params[v] += (float)(0.5 * noise_of(key, i));
        look(&config, &model, params, &b, i, boxes + 4 * s, all);
        want[i] = all[3];
        got[i] = out[i][3];
    }
    compare(c->name, got, want, b.n, (bounds){1e-11, 2e-5});
    free(out);
    free(got);
    free(want);
    free(params);
    free(boxes);
    free_batch(&b);
    cln_model_free(&model);
}

static void test_noise(void **state)
{
    (void)state;
    check_noise(&cases[0]);
    check_noise(&cases[5]); /* wide vectors */
    check_noise(&cases[7]); /* several work-items a slice */
}

/* ---- pictures ---- */

enum { SIGHTS = 400, ALONG = 5 };

/* Samples as they lie along rays. Each ray goes from a leaf, with none, one or two samples, to the
 * next ray's, with one or two: at times the leaf changes, at times the ray does, or both. */
static void make_sights(const cln_octree *tree, batch *b)
{
    float *boxes = NULL;

    b->samples = test_alloc(SIGHTS * ALONG, sizeof *b->samples);
    b->ray_o = test_alloc(SIGHTS, sizeof *b->ray_o);
    b->ray_d = test_alloc(SIGHTS, sizeof *b->ray_d);
    assert_ok(cln_octree_boxes(tree, &boxes));
    for (int r = 0; r < SIGHTS; r++) {
        const int leaf[2] = {(int)(cln_hash((uint32_t)r) % (uint32_t)tree->leaf_count),
                             (int)(cln_hash((uint32_t)r + 1) % (uint32_t)tree->leaf_count)};
        double at[2][3], length = 0;

        for (int a = 0; a < 3; a++) {
            for (int end = 0; end < 2; end++)
                at[end][a] =
                    boxes[4 * leaf[end] + a] +
                    test_uniform(8, 6 * r + 2 * a + end, 0.2, 0.8) * boxes[4 * leaf[end] + 3];
            length += (at[1][a] - at[0][a]) * (at[1][a] - at[0][a]);
        }
        length = sqrt(length);
        for (int a = 0; a < 3; a++) {
            b->ray_o[r][a] = (float)at[0][a];
            b->ray_d[r][a] = (float)((at[1][a] - at[0][a]) / length);
        }
        for (int end = 0; end < 2; end++) /* two are nearer than the box's edge */
            for (int k = (r + end) % 3 == 2 ? end : 0; k < 1 + (r / 3 + end) % 2; k++)
                b->samples[b->n++] = (cln_sample){
                    .t = (float)(end * length - k * 0.1 * boxes[4 * leaf[end] + 3] * (2 * end - 1)),
                    .delta = 0.01f,
                    .ray = (uint32_t)r,
                    .slot = leaf[end]};
    }
    free(boxes);
}

/* This process has the leaves from `first` on but the last `beyond`; samples of others keep what
 * was there. */
static void check_sights(const voxel_case *c, const cln_config *config, const cln_model *model,
                         const batch *b, int first, int beyond)
{
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], config, false, false);
    const int all = model->tree.leaf_count;
    double *want = test_alloc(b->n, 4 * sizeof *want);
    float(*got)[4] = NULL, *mine = test_alloc(b->n, 4 * sizeof *mine), *boxes = NULL;
    size_t n = 0;
    int same_leaf = 0, same_ray = 0;

    assert_ok(cln_pipeline_upload(p, model, true));
    p->first = first;
    p->own = all - first - beyond;
    assert_ok(CLN_PUT(p, params, model->params + first * model->net.params, (size_t)p->own));
    assert_ok(cln_pipeline_points(p, b->ray_o[0], b->ray_d[0], NULL, SIGHTS));
    assert_ok(cln_pipeline_samples(p, b->samples, b->n));
    test_fill(p->device, &p->out, NULL, b->n * sizeof *got);
    assert_ok(cln_stage_forward(p, b->n, 0, false, 0));
    got = test_read(p->device, &p->out, b->n * sizeof *got, "out");
    assert_ok(cln_octree_boxes(&model->tree, &boxes));
    for (uint32_t i = 0; i < b->n; i++) {
        const cln_sample *s = &b->samples[i];

        same_leaf += i > 0 && s->slot == s[-1].slot && s->ray != s[-1].ray;
        same_ray += i > 0 && s->slot != s[-1].slot && s->ray == s[-1].ray;
        if (s->slot < first || s->slot >= all - beyond) {
            for (int k = 0; k < 4; k++)
                assert_true(isnan(got[i][k]));
            continue;
        }
        look(config, model, model->params + s->slot * model->net.params, b, i, boxes + 4 * s->slot,
             want + n);
        memcpy(mine + n, got[i], sizeof got[i]);
        n += 4;
    }
    assert_true(same_leaf > SIGHTS / 4 && same_ray > SIGHTS / 4);
    assert_true((n < 4 * (size_t)b->n) == (first + beyond > 0) && n > b->n);
    compare(c->name, mine, want, n, (bounds){1e-11, 2e-5});
    p->first = 0;
    p->own = all;
    free(want);
    free(got);
    free(mine);
    free(boxes);
}

static void test_sights(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const cln_config config = config_of(&cases[i]);
        cln_model model = {0};
        batch b = {0};

        make_model(&config, &model);
        make_sights(&model.tree, &b);
        check_sights(&cases[i], &config, &model, &b, 0, 0);
        check_sights(&cases[i], &config, &model, &b, 9, 13);
        free_batch(&b);
        cln_model_free(&model);
    }
}

/* ---- changes of the tree ---- */

/* Culled leaves come back: vertices shared with leaves that stayed have their numbers, the others
 * initial ones. */
static void test_regrown(void **state)
{
    const cln_config config = config_of(&cases[0]);
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, false, false);
    uint8_t empty[2 * MOST] = {0};
    cln_marks marks = {0};
    cln_octree_change change = {0};
    cln_model model = {0};
    float *got = NULL;
    int *next = NULL, row = 0, features = 0, fresh = 0, joined = 0, new = 0;

    (void)state;
    assert_ok(cln_marks_add(&marks, 0, (int[3]){0, 0, 0})); /* all cells */
    make_model(&config, &model);
    row = model.net.params;
    features = model.net.features;
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_ok(cln_octree_regrow(&model.tree, &marks, 2, 2, empty, &change));
    assert_ok(cln_pipeline_carry(p, &model.tree, &change));
    next = circles_of(&model.tree);
    got = test_alloc((size_t)(model.tree.leaf_count * row), sizeof *got);
    assert_ok(CLN_GET(p, params, got, (size_t)model.tree.leaf_count));
    for (int s = 0; s < model.tree.leaf_count; s++) {
        fresh += change.octant[s] == CLN_FRESH;
        for (int v = 0; change.octant[s] == CLN_FRESH && v < VERTICES; v++) {
            const int here = s * VERTICES + v;
            const float zero[32] = {0};
            const float *want = zero;

            for (int copy = next[here]; copy != here; copy = next[copy])
                if (change.octant[copy / VERTICES] != CLN_FRESH)
                    want = got + copy / VERTICES * row + copy % VERTICES * features;
            joined += want != zero;
            new += want == zero;
            assert_memory_equal(got + s * row + v * features, want,
                                (size_t)features * sizeof *want);
        }
    }
    assert_true(fresh > 3 && joined > 50 && new > 50);
    free(next);
    free(got);
    cln_octree_change_free(&change);
    cln_marks_free(&marks);
    cln_model_free(&model);
}

/* What a leaf would have after a change without its neighbours: its own numbers, those of a split,
 * or zeros. grade: whether its neighbours' numbers hold before its own, by the change's kind. */
static void alone(const cln_model *old, const cln_octree_change *change, int slot, float *out,
                  int *grade)
{
    const float *from = old->params + change->from[slot] * old->net.params;
    const int octant = change->octant[slot];

    *grade = octant == CLN_COPIED ? 0 : octant == CLN_FRESH ? 2 : 1;
    memset(out, 0, (size_t)old->net.params * sizeof *out);
    if (octant == CLN_COPIED)
        memcpy(out, from, (size_t)old->net.params * sizeof *out);
    else if (octant != CLN_FRESH)
        cln_network_fold(&old->net, from, octant, out);
}

/* Some leaves split, next to smaller ones that stay, and, if `fresh`, to some that begin anew: the
 * device has the host's numbers, and all copies of a vertex are equal: those of a leaf that stays,
 * else the split's, else zeros. */
static void check_split(const voxel_case *c, bool fresh)
{
    const cln_config config = config_of(c);
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    cln_octree_change change = {0}, same = {0};
    cln_model model = {0}, host = {0};
    uint8_t split[2 * MOST] = {0};
    float *got = NULL, *before = NULL;
    int *next = NULL, *grade = NULL, row = 0, features = 0, all = 0, copies = 0;
    int joined = 0, exact = 0, given = 0;

    make_model(&config, &model);
    make_model(&config, &host);
    row = model.net.params;
    features = model.net.features;
    for (int s = 0; s < model.tree.leaf_count; s += 2)
        split[s] = model.tree.level[model.tree.leaf[s]] == 2;
    assert_ok(cln_pipeline_upload(p, &model, true));
    assert_ok(cln_octree_split(&model.tree, split, &change));
    assert_ok(cln_octree_split(&host.tree, split, &same));
    all = model.tree.leaf_count;
    for (int s = 0; fresh && s < all; s++)
        if (change.octant[s] >= 0 && cln_hash((uint32_t)s) % 3 == 0)
            change.octant[s] = same.octant[s] = CLN_FRESH;
    assert_ok(cln_pipeline_carry(p, &model.tree, &change));
    next = circles_of(&model.tree);
    got = test_alloc((size_t)(all * row), sizeof *got);
    before = test_alloc((size_t)(all * row), sizeof *before);
    grade = test_alloc((size_t)all, sizeof *grade);
    for (int s = 0; s < all; s++)
        alone(&host, &change, s, before + s * row, &grade[s]);
    assert_ok(CLN_GET(p, params, got, (size_t)all));
    for (int here = 0; here < all * VERTICES; here++) {
        const float *mine = got + here / VERTICES * row + here % VERTICES * features;
        const int own = grade[here / VERTICES];
        int copy = here, least = own;

        while ((copy = next[copy]) != here) {
            least = grade[copy / VERTICES] < least ? grade[copy / VERTICES] : least;
            copies++;
        }
        do {
            const int at = copy / VERTICES * row + copy % VERTICES * features;

            assert_memory_equal(mine, got + at, (size_t)features * sizeof *mine);
            if (grade[copy / VERTICES] == least)
                assert_memory_equal(mine, before + at, (size_t)features * sizeof *mine);
        } while ((copy = next[copy]) != here);
        joined += own > 0 && least == 0;
        exact += own == 1 && least == 1;
        given += own == 2 && least == 1;
    }
    assert_true(copies > 1000 && joined > 10 && exact > 1000 && (given > 100) == fresh);
    assert_ok(cln_model_apply(&host, &same));
    assert_memory_equal(got, host.params, (size_t)(all * row) * sizeof *got);
    free(next);
    free(grade);
    free(before);
    free(got);
    cln_octree_change_free(&change);
    cln_octree_change_free(&same);
    cln_model_free(&model);
    cln_model_free(&host);
}

static void test_split(void **state)
{
    (void)state;
    for (int fresh = 0; fresh < 2; fresh++) {
        check_split(&cases[0], fresh);
        check_split(&cases[5], fresh); /* wide vectors */
        check_split(&cases[7], fresh); /* several work-items a leaf */
    }
}

/* The neighbours are those that a separate search finds, and no others. */
static void test_around(void **state)
{
    const cln_config config = config_of(&cases[0]);
    int32_t(*around)[27] = NULL;
    cln_model model = {0};
    int found = 0;

    (void)state;
    make_model(&config, &model);
    assert_ok(cln_octree_around(&model.tree, &around));
    for (int s = 0; s < model.tree.leaf_count; s++)
        for (int i = 0; i < 27; i++) {
            const int node = model.tree.leaf[s];
            int want = -1;

            for (int o = 0; o < model.tree.leaf_count; o++) {
                const int other = model.tree.leaf[o];

                if (model.tree.level[other] == model.tree.level[node] &&
                    model.tree.pos[other][0] - model.tree.pos[node][0] == i % 3 - 1 &&
                    model.tree.pos[other][1] - model.tree.pos[node][1] == i / 3 % 3 - 1 &&
                    model.tree.pos[other][2] - model.tree.pos[node][2] == i / 9 - 1)
                    want = o;
            }
            assert_int_equal(around[s][i], want);
            found += want >= 0;
        }
    assert_true(found > 4 * model.tree.leaf_count);
    free(around);
    cln_model_free(&model);
}

int test_group_voxel(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_update),        cmocka_unit_test(test_decoder_steps),
        cmocka_unit_test(test_decoder_waits), cmocka_unit_test(test_noise),
        cmocka_unit_test(test_sights),        cmocka_unit_test(test_regrown),
        cmocka_unit_test(test_split),         cmocka_unit_test(test_around),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(group) | CLN_PROGRAM_BIT(voxel_train) |
                  CLN_PROGRAM_BIT(voxel_eval) | CLN_PROGRAM_BIT(roulette) | CLN_PROGRAM_BIT(adam) |
                  CLN_PROGRAM_BIT(carry) | CLN_PROGRAM_BIT(decoder);
    return cmocka_run_group_tests_name("voxel", tests, NULL, test_device_close);
}
