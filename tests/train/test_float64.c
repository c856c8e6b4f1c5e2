/* Training against a second trainer in float64: 50 steps from the same initial weights, on the same
 * rays and samples. It has its own weights and moments in double, and follows docs/method.md 1, 9,
 * 10 and 11 in plain loops (host/reference): networks, voxels and their decoder, compositing, loss,
 * gradient, roulette, Adam, moments of 16 bits. It takes from the device which pixels a step drew
 * and where its samples lie, which test_rays, test_sampling and test_splat compare, and from
 * base/rng.h the random numbers.
 *
 * Two trainings move apart: a rounding changes the side of an activation's kink or whether the
 * roulette takes a sample, and Adam, which divides by the gradient's size, makes steps of a
 * gradient that is all rounding. So the bound is on the loss curve. */
#include "unit.h"
#include "base/rng.h"
#include "check/selftest_checks.h"
#include "tests.h"
#include "trainer_fixture.h"

enum { CURVE = 50, BEGINNING = 20, REFRESH = 8, MOST_SLOPES = 8 * 64 + 64, MISTAKES = 8 };

/* A preset with few rays, and where its networks are large, smaller ones. */
typedef struct preset_case {
    const char *preset;
    int level, width, depth, view_width; /* 0: the preset's */
    double lr;                           /* enough to learn in 50 steps; 0: the preset's */
    double bound;                        /* relative, of a step's loss */
    int decoder;                         /* width of voxels' decoder */
} preset_case;

/* How a trainer is wrong on purpose, in its voxels: `right` is not. */
typedef struct mistake {
    const char *name;
    double step, smooth; /* factors of Adam's steps, of the smoothness */
    double harmonics;    /* rate of harmonics; 0: the preset's */
    double first;        /* factor of second moments that begin */
    double decoder;      /* factor of the decoder's steps */
    bool apart;          /* gradients of a vertex that leaves share are not added */
    bool at_once;        /* the rate of harmonics does not rise */
    bool early;          /* nor does the decoder's, which begins with the training */
} mistake;
static const mistake right = {NULL, 1, 1, 0, 1, 1, false, false, false};

/* ---- both trainings ---- */

typedef struct twin {
    const cln_config *config;
    const cln_network *net;
    double *params, *m, *v, *grads; /* [leaf][params] */
    int64_t *steps;                 /* [leaf] */
    float *boxes;                   /* [leaf][4] */
    /* voxels' */
    int leaves, vertices; /* vertices of a leaf; 0: networks */
    int *owner;           /* [leaf][vertex]: which leaf and vertex steps for it */
    uint8_t *met;         /* [leaf][vertex] */
    double *decoder, *decoder_m, *decoder_v, *decoder_grads; /* [decoder_params] */
    const mistake *wrong;
} twin;

/* What the device's step worked on. */
typedef struct step_work {
    uint32_t samples, slice_count;
    float (*ray_o)[4], (*ray_d)[4]; /* [ray] */
    cln_sample *sample;             /* [sample], of a ray side by side */
    uint32_t *order;                /* [grouped sample] */
    cln_slice *slice;
} step_work;

static cln_config config_of(const preset_case *c)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset(c->preset, &config));
    config.start_level = c->level;
    config.level_at[0] = 0;
    config.adaptive = false;
    config.cull_from = 1;
    config.width = c->width ? c->width : config.width;
    config.depth = c->depth ? c->depth : config.depth;
    config.view_width = c->view_width ? c->view_width : config.view_width;
    config.decoder_width = c->decoder;
    config.n1 = 8;
    config.rays = 96;
    config.views_per_batch = 3;
    config.batch_samples = 4096;
    config.steps = CURVE;
    config.seed = 3;
    config.depth_loss = 0; /* its scene has no sparse points */
    config.lr = c->lr > 0 ? c->lr : config.lr;
    config.lr_final = c->lr > 0 ? c->lr / 10 : config.lr_final;
    assert_ok(cln_config_check(&config));
    return config;
}

static void *room(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);

    assert_non_null(p);
    return p;
}

static void open_voxels(const cln_model *model, twin *w)
{
    const int side = model->net.cells + 1, decoder = model->net.decoder_params;
    int32_t(*around)[27] = NULL;

    assert_true(w->config->beta1 == 0); /* there are no first moments */
    w->vertices = side * side * side;
    w->owner = room((size_t)(w->leaves * w->vertices), sizeof *w->owner);
    w->met = room((size_t)(w->leaves * w->vertices), sizeof *w->met);
    assert_ok(cln_octree_around(&model->tree, &around));
    ref_voxel_owners(&model->net, w->leaves, (const int32_t(*)[27])around, w->owner);
    free(around);
    w->decoder = room((size_t)decoder, sizeof *w->decoder);
    w->decoder_m = room((size_t)decoder, sizeof *w->decoder_m);
    w->decoder_v = room((size_t)decoder, sizeof *w->decoder_v);
    w->decoder_grads = room((size_t)decoder, sizeof *w->decoder_grads);
    for (int i = 0; i < decoder; i++)
        w->decoder[i] = model->decoder[i];
}

static void open_twin(const cln_model *model, const cln_config *config, const mistake *wrong,
                      twin *w)
{
    const size_t leaves = (size_t)model->tree.leaf_count, params = (size_t)model->net.params;

    *w = (twin){
        .config = config, .net = &model->net, .leaves = model->tree.leaf_count, .wrong = wrong};
    w->params = room(leaves * params, sizeof *w->params);
    w->m = room(leaves * params, sizeof *w->m);
    w->v = room(leaves * params, sizeof *w->v);
    w->grads = room(leaves * params, sizeof *w->grads);
    w->steps = room(leaves, sizeof *w->steps);
    assert_ok(cln_octree_boxes(&model->tree, &w->boxes));
    for (size_t i = 0; i < leaves * params; i++)
        w->params[i] = model->params[i];
    if (model->net.encoding == CLN_ENCODING_VOXEL)
        open_voxels(model, w);
}

static void close_twin(twin *w)
{
    free(w->params);
    free(w->m);
    free(w->v);
    free(w->grads);
    free(w->steps);
    free(w->boxes);
    free(w->owner);
    free(w->met);
    free(w->decoder);
    free(w->decoder_m);
    free(w->decoder_v);
    free(w->decoder_grads);
}

static void read_work(cln_trainer *t, int rays, uint32_t samples, step_work *w)
{
    cln_pipeline *p = &t->pipeline;
    uint32_t last = 0;

    *w = (step_work){.samples = samples};
    w->ray_o = room((size_t)rays, sizeof *w->ray_o);
    w->ray_d = room((size_t)rays, sizeof *w->ray_d);
    w->sample = room(samples, sizeof *w->sample);
    w->order = room(samples, sizeof *w->order);
    assert_ok(CLN_GET(p, ray_o, w->ray_o, (size_t)rays));
    assert_ok(CLN_GET(p, ray_d, w->ray_d, (size_t)rays));
    assert_ok(CLN_GET(p, samples, w->sample, samples));
    assert_ok(CLN_GET(p, values, w->order, samples));
    assert_ok(cln_stage_slices(p, &last));
    w->slice_count = last;
    w->slice = room(last, sizeof *w->slice);
    assert_ok(CLN_GET(p, slices, w->slice, last));
}

static void free_work(step_work *w)
{
    free(w->ray_o);
    free(w->ray_d);
    free(w->sample);
    free(w->order);
    free(w->slice);
}

/* ---- a step in double ---- */

/* Slopes of a sample (method.md 1.1, 15): [depth][width], then [view_width]. NULL: the mean. */
static const double *slopes_of(const twin *w, uint32_t key, uint32_t sample, double *slopes)
{
    const cln_config *c = w->config;
    const int width = w->net->width, count = w->net->depth * width + w->net->view_width;

    if (c->rrelu_scope == CLN_RRELU_MEAN)
        return NULL;
    assert_true(count <= MOST_SLOPES);
    for (int i = 0; i < count; i++) {
        const int layer = i / width < w->net->depth ? i / width : w->net->depth;
        const uint32_t own = c->rrelu_scope == CLN_RRELU_ELEMENT ? key + sample * 0x85EBCA6Bu : key;
        const uint32_t of_layer = own ^ ((uint32_t)layer * 0xC2B2AE35u + 0x165667B1u);
        const uint32_t bits = cln_hash((uint32_t)(i - layer * width) * 0x9E3779B9u ^ of_layer) >> 8;

        slopes[i] = c->rrelu_lower + (c->rrelu_upper - c->rrelu_lower) * bits / 0x1p24;
    }
    return slopes;
}

/* A sample's place in its leaf, from -1 to 1. */
static void place_of(const twin *w, const step_work *k, uint32_t i, double local[3])
{
    const cln_sample *s = &k->sample[i];
    const float *box = w->boxes + 4 * s->slot;

    for (int a = 0; a < 3; a++)
        local[a] =
            (k->ray_o[s->ray][a] + (double)s->t * k->ray_d[s->ray][a] - box[a]) * 2 / box[3] - 1;
}

/* One sample through its leaf's network: forward to out, or with dout backward into grads. */
static void network(const twin *w, const step_work *k, uint32_t key, uint32_t i, double out[4],
                    const double *dout)
{
    const cln_sample *s = &k->sample[i];
    const size_t own = (size_t)s->slot * (size_t)w->net->params;
    ref_network r = {.net = *w->net,
                     .density = w->config->density,
                     .kappa = w->config->density_scale,
                     .bias = cln_network_density_bias(w->config),
                     .wide = w->params + own,
                     .wide_decoder = w->decoder,
                     .decoder_grad = w->decoder_grads};
    double local[3], dir[3], slopes[MOST_SLOPES];
    const double *use = slopes_of(w, key, i, slopes);
    const double mean = 0.5 * (w->config->rrelu_lower + w->config->rrelu_upper);

    for (int b = 0; b < 10; b++)
        r.level_bands[b] = 1;
    for (int a = 0; a < 3; a++)
        dir[a] = k->ray_d[s->ray][a];
    place_of(w, k, i, local);
    if (dout)
        ref_backward(&r, NULL, local, dir, use, mean, dout, w->grads + own);
    else
        ref_forward(&r, NULL, local, dir, use, mean, out);
}

/* Factors of samples that the roulette takes, and 0 (method.md 11): slices in parts. */
static void choose(const twin *w, const step_work *k, uint32_t key, const double (*out)[4],
                   const double (*dout)[4], double *factors)
{
    const ref_network r = {.density = w->config->density, .kappa = w->config->density_scale};
    float(*narrow)[4] = room(k->samples, sizeof *narrow), (*slope)[4] = room(k->samples, 16);
    double heads[CLN_ROULETTE_SEGMENT][4], chosen[CLN_ROULETTE_SEGMENT];

    for (uint32_t i = 0; i < k->samples; i++)
        for (int c = 0; c < 4; c++) {
            narrow[i][c] = (float)out[i][c];
            slope[i][c] = (float)dout[i][c];
        }
    for (uint32_t s = 0; s < k->slice_count; s++)
        for (uint32_t at = 0; at < k->slice[s].count; at += CLN_ROULETTE_SEGMENT) {
            const uint32_t left = k->slice[s].count - at, first = k->slice[s].start + at;
            const uint32_t n = left < CLN_ROULETTE_SEGMENT ? left : CLN_ROULETTE_SEGMENT;

            ref_roulette(&r, w->config->roulette, cln_hash(key), (int)n, k->order + first,
                         (const float(*)[4])narrow, (const float(*)[4])slope, heads, chosen);
            for (uint32_t i = 0; i < n; i++)
                factors[k->order[first + i]] = chosen[i];
        }
    free(narrow);
    free(slope);
}

/* bfloat16 by chance, 16 random bits (method.md 11). */
static double round_by_chance(double value, uint32_t chance)
{
    const float narrow = (float)value;
    uint32_t bits = 0;

    memcpy(&bits, &narrow, sizeof bits);
    return ref_from_bf16((uint16_t)((bits + chance) >> 16));
}

static void update(twin *w, int slot, double lr)
{
    const cln_config *c = w->config;
    const int params = w->net->params;
    const size_t own = (size_t)slot * (size_t)params;
    const int64_t steps = ++w->steps[slot];
    const uint32_t key = (uint32_t)steps * 0x85EBCA6Bu + (uint32_t)slot * 0xC2B2AE35u;

    ref_adam(params, w->params + own, w->grads + own, w->m + own, w->v + own, steps,
             (ref_adam_rule){lr, c->beta1, c->beta2, c->epsilon});
    for (int i = 0; i < params && c->moments == CLN_MOMENTS_BFLOAT16; i++) {
        const uint32_t chance = cln_hash((uint32_t)i * 0x9E3779B9u ^ key);

        w->m[own + (size_t)i] = round_by_chance(w->m[own + (size_t)i], chance & 0xFFFF);
        w->v[own + (size_t)i] = round_by_chance(w->v[own + (size_t)i], chance >> 16);
    }
}

/* ---- voxels (method.md 1) ---- */

static void mark_corners(const twin *w, const step_work *k, uint32_t i, uint8_t *near)
{
    const int cells = w->net->cells, side = cells + 1;
    double local[3];
    int first = 0;

    place_of(w, k, i, local);
    for (int a = 2; a >= 0; a--)
        first =
            first * side + (int)fmin(fmax(floor((local[a] + 1) / 2 * cells), 0), (double)cells - 1);
    for (int c = 0; c < 8; c++)
        near[first + (c & 1) + (c >> 1 & 1) * side + (c >> 2) * side * side] = 1;
}

/* Adds the gradient of the smoothness at the vertices `near` samples of leaf `slot`: an edge of the
 * lattice counts in equal parts in the leaves that have it. */
static void smooth(twin *w, int slot, const uint8_t *near)
{
    const cln_config *c = w->config;
    const int features = w->net->features, cells = w->net->cells, side = cells + 1;
    const int stride[3] = {1, side, side * side};
    const double *p = w->params + (size_t)slot * (size_t)w->net->params;
    double *grad = w->grads + (size_t)slot * (size_t)w->net->params;
    const double width = w->boxes[4 * slot + 3];

    for (int v = 0; v < w->vertices; v++)
        for (int edge = 0; near[v] && edge < 6; edge++) {
            const int a = edge / 2, to = v / stride[a] % side + (edge % 2 ? 1 : -1);
            const int other = v + (edge % 2 ? stride[a] : -stride[a]);
            double share = 4 * w->wrong->smooth * 256 * width * width; /* of one leaf in four */

            if (to < 0 || to > cells)
                continue;
            for (int b = 0; b < 3; b++)
                if (b != a && v / stride[b] % side % cells == 0)
                    share /= 2;
            for (int f = 0; f < features; f++) {
                const double delta = f == 3 ? c->smooth_density_delta : c->smooth_colour_delta;
                const double d = p[v * features + f] - p[other * features + f];

                grad[v * features + f] += share * (f == 3 ? c->smooth_density : c->smooth_colour) *
                                          (delta > 0 ? d / sqrt(1 + d * d / (delta * delta)) : d);
            }
        }
}

/* The gradients of all leaves, and which vertices the samples that take part are near. Of a slice
 * of which none takes part the first does, with a gradient of 0 (roulette.cl). */
static void voxel_gradients(twin *w, const step_work *k, uint32_t key, const double (*dout)[4],
                            const double *factors)
{
    uint8_t *near = room((size_t)w->vertices, 1);
    int last = -1;

    memset(w->met, 0, (size_t)(w->leaves * w->vertices));
    memset(w->decoder_grads, 0, (size_t)w->net->decoder_params * sizeof *w->decoder_grads);
    for (uint32_t s = 0; s < k->slice_count; s++) {
        const cln_slice *slice = &k->slice[s];
        const int slot = slice->slot;
        bool any = false;

        if (slice->count == 0)
            continue;
        memset(near, 0, (size_t)w->vertices);
        for (uint32_t i = 0; i < slice->count; i++) {
            const uint32_t id = k->order[slice->start + i];

            if (factors[id] == 0)
                continue;
            any = true;
            mark_corners(w, k, id, near);
            network(w, k, key, id, NULL, dout[id]);
        }
        if (!any)
            mark_corners(w, k, k->order[slice->start], near);
        for (int v = 0; v < w->vertices; v++)
            w->met[slot * w->vertices + v] |= near[v];
        if (slot != last && cln_hash((key ^ 0x632BE5ABu) + (uint32_t)slot * 0x9E3779B9u) % 4 == 0)
            smooth(w, slot, near);
        last = slot;
    }
    free(near);
}

static double *row_of(const twin *w, double *numbers, int vertex)
{
    return numbers + (size_t)(vertex / w->vertices) * (size_t)w->net->params +
           vertex % w->vertices * w->net->features;
}

/* Rates of this step: of colours, and as shares of it of harmonics and of the decoder. */
typedef struct step_rates {
    double lr, harmonics, decoder;
} step_rates;

static step_rates rates_of(const twin *w, double fraction)
{
    const cln_config *c = w->config;
    const double harmonics = w->wrong->harmonics > 0 ? w->wrong->harmonics : c->harmonic_rate;
    const bool rises = c->harmonics_rise > 0 && !w->wrong->at_once;
    const double since = w->wrong->early ? 1 : (fraction - c->decoder_after) / 0.2;

    return (step_rates){c->lr_schedule == CLN_SCHEDULE_STEP
                            ? c->lr * pow(0.1, floor(3 * fraction))
                            : c->lr * pow(c->lr_final / c->lr, fraction),
                        harmonics * (rises ? fmin(fraction / c->harmonics_rise, 1) : 1),
                        w->wrong->decoder * c->decoder_rate * fmin(fmax(since, 0), 1)};
}

static void step_vertex(twin *w, int vertex, uint32_t key, step_rates rates)
{
    const cln_config *c = w->config;
    const uint32_t leaf = (uint32_t)(vertex / w->vertices);
    const uint32_t of_leaf = cln_hash(key ^ leaf * 0xC2B2AE35u);
    double *param = row_of(w, w->params, vertex), *grad = row_of(w, w->grads, vertex);
    double *v = row_of(w, w->v, vertex);

    for (int f = 0; f < w->net->features; f++) {
        const uint32_t p = (uint32_t)(vertex % w->vertices * w->net->features + f);
        const double rate = f == 3 ? c->density_rate : f > 3 ? rates.harmonics : 1;
        const bool begins = v[f] == 0;
        double none = 0, at = param[f];

        ref_voxel_step(&at, grad[f], &none, &v[f],
                       (ref_adam_rule){rates.lr * rate, c->beta1, c->beta2, c->epsilon});
        v[f] *= begins ? w->wrong->first : 1;
        param[f] += w->wrong->step * (at - param[f]) / (begins ? sqrt(w->wrong->first) : 1);
        if (c->moments == CLN_MOMENTS_BFLOAT16)
            v[f] = round_by_chance(v[f], cln_hash(p * 0x9E3779B9u ^ of_leaf) >> 16);
    }
}

static void update_voxels(twin *w, uint32_t key, step_rates rates)
{
    const int all = w->leaves * w->vertices, features = w->net->features;

    for (int u = 0; u < w->net->decoder_params && rates.decoder > 0; u++)
        ref_voxel_step(&w->decoder[u], w->decoder_grads[u], &w->decoder_m[u], &w->decoder_v[u],
                       (ref_adam_rule){rates.lr * rates.decoder, 0.9, 0.99, /* kernels/decoder.cl */
                                       w->config->epsilon});
    for (int u = 0; u < all; u++) {
        const int owner = w->owner[u];

        if (owner == u)
            continue;
        w->met[owner] |= w->met[u];
        for (int f = 0; f < features && !w->wrong->apart; f++)
            row_of(w, w->grads, owner)[f] += row_of(w, w->grads, u)[f];
    }
    for (int u = 0; u < all; u++)
        if (w->owner[u] == u && w->met[u])
            step_vertex(w, u, key, rates);
    for (int u = 0; u < all; u++)
        if (w->owner[u] != u)
            memcpy(row_of(w, w->params, u), row_of(w, w->params, w->owner[u]),
                   (size_t)features * sizeof *w->params);
}

/* ---- a whole step ---- */

/* Step number `step` on the device's rays and samples; returns the mean loss of its rays. */
static double step_in_double(twin *w, const step_work *k, const cln_batch *batch, int rays,
                             uint32_t step)
{
    const cln_config *c = w->config;
    const ref_loss loss = {.kind = c->loss,
                           .huber_delta = c->huber_delta,
                           .distortion = c->distortion_loss,
                           .alpha = c->alpha_loss};
    const uint32_t key = cln_hash(step + cln_hash((uint32_t)c->seed));
    const step_rates rates = rates_of(w, (double)step / CURVE);
    double(*out)[4] = room(k->samples, sizeof *out), (*dout)[4] = room(k->samples, sizeof *dout);
    double *factors = room(k->samples, sizeof *factors), total = 0;
    int *met = room((size_t)w->leaves, sizeof *met);

    for (uint32_t i = 0; i < k->samples; i++)
        network(w, k, key, i, out[i], NULL);
    for (uint32_t i = 0, r = 0; r < (uint32_t)rays; r++) {
        double t[512], delta[512], back[3], target[4];
        const uint32_t first = i;

        for (; i < k->samples && k->sample[i].ray == r; i++) {
            assert_true(i - first < 512);
            t[i - first] = k->sample[i].t;
            delta[i - first] = k->sample[i].delta;
        }
        for (int a = 0; a < 4; a++)
            target[a] = batch->targets[r][a];
        for (int a = 0; a < 3; a++)
            back[a] = batch->backgrounds[0][a];
        total += ref_loss_of_ray(&loss, (int)(i - first), (const double(*)[4])out + first, t, delta,
                                 back, target, dout + first);
    }
    for (uint32_t i = 0; i < k->samples; i++)
        for (int a = 0; a < 4; a++)
            dout[i][a] /= rays;
    choose(w, k, key, (const double(*)[4])out, (const double(*)[4])dout, factors);
    memset(w->grads, 0, (size_t)w->leaves * (size_t)w->net->params * sizeof *w->grads);
    for (uint32_t i = 0; i < k->samples; i++) {
        met[k->sample[i].slot]++;
        for (int a = 0; a < 4; a++)
            dout[i][a] *= factors[i];
    }
    if (w->vertices) {
        voxel_gradients(w, k, key, (const double(*)[4])dout, factors);
        update_voxels(w, key, rates);
    }
    for (uint32_t i = 0; i < k->samples && !w->vertices; i++)
        if (factors[i] > 0 && met[k->sample[i].slot] >= c->min_leaf_samples)
            network(w, k, key, i, NULL, dout[i]);
    for (int s = 0; s < w->leaves && !w->vertices; s++)
        if (met[s] >= c->min_leaf_samples && met[s] > 0)
            update(w, s, rates.lr);
    free(out);
    free(dout);
    free(factors);
    free(met);
    return total / rays;
}

/* ---- comparison ---- */

/* Trains both for the first `steps` steps; returns the largest relative difference of a step's
 * loss. *fell: the loss of the last five steps over that of the first five. off[i]: the difference
 * of a trainer with mistake i, on the same samples. */
static double compare_curves(const preset_case *c, uint32_t steps, double *fell, int mistakes,
                             const mistake *wrong, double *off)
{
    const cln_config config = config_of(c);
    double worst[1 + MISTAKES] = {0}, first = 0, last = 0, apart = 0, moved = 0;
    int worst_step = 0;
    cln_trainer t;
    cln_batch batch;
    twin w[1 + MISTAKES];

    open_trainer(&config, &t);
    t.model.has_alpha = false; /* the harmonics' rate rises as it does without */
    assert_ok(cln_batch_create(t.scene, &config, &batch));
    for (int i = 0; i <= mistakes; i++)
        open_twin(&t.model, &config, i == 0 ? &right : &wrong[i - 1], &w[i]);
    for (uint32_t step = 0; step < steps; step++) {
        const cln_draw draw = {.step = step, .n = t.model.rays};
        double device = 0;
        step_work k;

        assert_false(cln_batch_skips(&t.batch, &config, step)); /* all leaves are there */
        cln_batch_draw(&batch, t.scene, &config, &draw);
        if (step % REFRESH == 0)
            assert_ok(cln_stage_refresh(&t.pipeline, 0, t.pipeline.leaves, true,
                                        (uint64_t)config.seed, step));
        assert_ok(cln_step(&t, (double)step / CURVE));
        assert_int_equal(t.owed.rays, draw.n);
        assert_ok(cln_step_catch_up(&t));
        for (int i = 0; i < draw.n; i++)
            device += t.results[i].loss / draw.n;
        read_work(&t, draw.n, t.owed.samples, &k);
        for (int i = 0; i <= mistakes; i++) {
            const double own = step_in_double(&w[i], &k, &batch, draw.n, step);
            const double error = isfinite(device) ? fabs(device / own - 1) : INFINITY;

            if (i == 0 && error > worst[0])
                worst_step = (int)step;
            worst[i] = fmax(worst[i], error);
            first += i == 0 && step < 5 ? own : 0;
            last += i == 0 && step >= steps - 5 ? own : 0;
        }
        free_work(&k);
    }
    assert_ok(cln_pipeline_download(&t.pipeline, &t.model, false));
    for (int i = 0; i < t.model.tree.leaf_count * w[0].net->params; i++) {
        apart += pow(t.model.params[i] - w[0].params[i], 2);
        moved += pow(w[0].params[i], 2);
    }
    *fell = last / first;
    print_message("%s%s: the loss falls to %.3f; float32 is off by %.1e of it at most (step %d), "
                  "weights by %.1e\n",
                  c->preset, c->decoder ? ", decoder" : "", *fell, worst[0], worst_step,
                  sqrt(apart / moved));
    for (int i = 0; i <= mistakes; i++) {
        if (i > 0) {
            off[i - 1] = worst[i];
            print_message("    %s: off by %.1e\n", wrong[i - 1].name, worst[i]);
        }
        close_twin(&w[i]);
    }
    cln_batch_free(&batch);
    close_trainer(&t);
    return worst[0];
}

/* Bounds: ten times what PoCL is off by, on the whole curve. */
static const preset_case cases[] = {
    {"fast", 2, 0, 0, 0, 0, 5e-4, 0},
    {"paper", 1, 16, 8, 32, 5e-3, 1e-3, 0},
    {"nerf", 0, 32, 8, 32, 5e-3, 4e-3, 0},
    {"kilonerf", 2, 0, 0, 0, 0, 5e-3, 0},
};

/* PoCL is off by 7e-4, with the decoder by 6e-5. A sample that lies a rounding beside a cell's face
 * gives vertices of one more cell whole steps of Adam, in one of the trainings alone. */
static const preset_case voxels[] = {
    {"voxel", 2, 0, 0, 0, 0, 7e-3, 0},
    {"voxel", 2, 0, 0, 0, 0, 7e-3, 16},
};

static void test_curves(void **state)
{
    NEED_DEVICE();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double fell = 0;
        const double worst = compare_curves(&cases[i], CURVE, &fell, 0, NULL, NULL);

        if (!(worst < cases[i].bound))
            fail_msg("%s: off by %.2e, the bound is %.0e", cases[i].preset, worst, cases[i].bound);
        assert_true(fell < 0.9); /* it is training that is compared */
    }
}

/* A trainer that differs from the device by a mistake leaves the bound, so a device that differs
 * from a right one does. */
static void test_voxels(void **state)
{
    static const mistake mistakes[] = {
        {"1 % of Adam's steps", 1.01, 1, 0, 1, 1, false, false, false},
        {"no smoothness", 1, 0, 0, 1, 1, false, false, false},
        {"the harmonics' rate of one", 1, 1, 1, 1, 1, false, false, false},
        {"second moments that begin 2 % lower", 1, 1, 0, 0.98, 1, false, false, false},
        {"gradients of neighbours not added", 1, 1, 0, 1, 1, true, false, false},
        {"harmonics whose rate does not rise", 1, 1, 0, 1, 1, false, true, false},
        {"10 % of the decoder's steps", 1, 1, 0, 1, 1.1, false, false, false},
        {"a decoder from the start", 1, 1, 0, 1, 1, false, false, true},
    };
    const int count = sizeof mistakes / sizeof *mistakes;
    double off[MISTAKES];

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof voxels / sizeof *voxels; i++) {
        const int these = voxels[i].decoder ? count : count - 2;
        double fell = 0;
        const double worst = compare_curves(&voxels[i], CURVE, &fell, these, mistakes, off);

        if (!(worst < voxels[i].bound))
            fail_msg("voxel: off by %.2e, the bound is %.0e", worst, voxels[i].bound);
        assert_true(fell < 0.9);
        for (int k = 0; k < these; k++)
            if (!(off[k] > voxels[i].bound))
                fail_msg("%s: not noticed, off by %.2e", mistakes[k].name, off[k]);
    }
}

/* Kernels that are slightly wrong leave the curve. */
static void test_notices(void **state)
{
    static const struct {
        const char *file, *from, *to;
    } faults[] = {
        {"adam.h", "a.rate * m1 /", "1.01f * a.rate * m1 /"},
        {"adam.h", "a.second = 1.0f /", "a.second = 0.98f /"},
        {"roulette.cl", "fmax((vf)(least) / size, (vf)(1.0f))", "(vf)(1.0f)"},
        {"loss.h", "#define OPTICAL_DEPTH(x) (", "#define OPTICAL_DEPTH(x) 1.005f * ("},
    };
    const char *before = getenv("CLN_TEST_KERNEL_DIR");

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        double fell = 0, worst = 0;
        char folder[32];

        snprintf(folder, sizeof folder, "wrong %zu", i);
        setenv("CLN_TEST_KERNEL_DIR",
               fixture_kernels_changed(folder, faults[i].file, faults[i].from, faults[i].to), 1);
        worst = compare_curves(&cases[0], BEGINNING, &fell, 0, NULL, NULL);
        if (before)
            setenv("CLN_TEST_KERNEL_DIR", before, 1);
        else
            unsetenv("CLN_TEST_KERNEL_DIR");
        if (!(worst > cases[0].bound))
            fail_msg("%s is not noticed: %.2e", faults[i].to, worst);
    }
}

int test_group_float64(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_curves), cmocka_unit_test(test_voxels),
                                       cmocka_unit_test(test_notices)};

    return cmocka_run_group_tests_name("float64", tests, fixture_setup, fixture_teardown);
}
