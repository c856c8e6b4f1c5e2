/* Checks the leaf networks (densities, forward, backward), the roulette, Adam, and compositing with
 * its gradient against host/reference/, and that the same launch gives the same bytes. */
#include "check/selftest_checks.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"

enum { STEP_KEY = 77 }; /* of random numbers; leaves 0, 3 and 6 have their turn to be smooth */
static const double FORWARD[2] = {1e-9, 1e-3}, GRADIENT[2] = {1e-8, 1e-3};

ref_network cln_check_network(const cln_config *config, const cln_model *model, int slot)
{
    const int level = model->tree.level[model->tree.leaf[slot]];
    ref_network r = {.net = model->net,
                     .decoder = model->decoder,
                     .density = config->density,
                     .kappa = (float)config->density_scale,
                     .bias = (float)cln_network_density_bias(config)};

    for (int k = 0; k < 10; k++)
        r.level_bands[k] = config->bands_by_level ? fmin(fmax(11 - level - k, 0), 1) : 1;
    return r;
}

ref_loss cln_check_loss(const cln_pipeline *p)
{
    return (ref_loss){.kind = p->config.loss,
                      .huber_delta = p->config.huber_delta,
                      .cauchy = p->config.cauchy,
                      .opacity_entropy = p->config.opacity_entropy,
                      .distortion = p->config.distortion_loss,
                      .alpha = p->opacity_loss,
                      .depth = p->config.depth_loss};
}

static double slope_of(const cln_checks *c)
{
    return 0.5 * (c->p->config.rrelu_lower + c->p->config.rrelu_upper);
}

/* Checks stage 1's densities at cell centres: values in two leaves, elsewhere only that they are
 * finite and >= 0. */
cln_status cln_check_densities(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int n1 = p->config.n1, cells = n1 * n1 * n1, leaves = p->leaves;
    const int slots[2] = {0, leaves - 1};
    uint16_t *density = NULL;
    float *got = NULL;
    double *want = NULL;
    int wrong = 0;

    CLN_TRY(cln_alloc(&density, (size_t)(leaves * cells), sizeof *density, "self-test"));
    CLN_TRY(cln_alloc(&got, (size_t)(2 * cells), sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, (size_t)(2 * cells), sizeof *want, "self-test"));
    CLN_TRY(cln_check_spoil(p->device, &p->density, (size_t)(leaves * cells) * sizeof *density));
    CLN_TRY(cln_stage_refresh(p, 0, p->leaves, false, 0, 0));
    CLN_TRY(cln_buffer_read(p->device, &p->density, 0, density,
                            (size_t)(leaves * cells) * sizeof *density));
    for (int i = 0; i < leaves * cells; i++)
        wrong += !(ref_from_bf16(density[i]) >= 0 && isfinite(ref_from_bf16(density[i])));
    for (int i = 0; i < 2 * cells; i++) {
        const int slot = slots[i / cells], cell = i % cells;
        const int at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
        const ref_network r = cln_check_network(&c->p->config, c->model, slot);
        const double along[3] = {0, 0, 1};
        double local[3], out[4];

        for (int a = 0; a < 3; a++)
            local[a] = 2 * (at[a] + 0.5) / n1 - 1;
        ref_forward(&r, c->model->params + slot * p->net.params, local, along, NULL, slope_of(c),
                    out);
        got[i] = ref_from_bf16(density[slot * cells + cell]);
        want[i] = out[3];
    }
    cln_check_say(c, "densities: numbers", wrong == 0, "%d of %d are not finite", wrong,
                  leaves * cells);
    /* bfloat16 keeps 8 bits: a relative rounding error of at most 2^-9 */
    cln_check_compare(c, "densities", got, want, (size_t)(2 * cells), 1.6e-5, 0.02);
done:
    free(density);
    free(got);
    free(want);
    return st;
}

/* ---- networks ---- */

/* Samples at exact local coordinates (t = 0 on a ray that starts there): the encoding multiplies
 * float32's rounding of a position by up to 2^bands, which is no error of the network. */
typedef struct data {
    uint32_t n, slices;
    cln_sample *samples;
    float (*ray_o)[4], (*ray_d)[4], (*dout)[4];
    float (*boxes)[4];
    float *out;                     /* [n][4] of the device */
    float *grads;                   /* [slices][params] of the device */
    cln_slice *slice;               /* [slices] */
    double (*want)[4], *want_grads; /* reference; gradients [leaf][params] */
    double *want_decoder;           /* its gradient, [decoder_params] */
} data;

/* A leaf's number of samples: none, one, some, more than a block. */
static uint32_t samples_of(const cln_checks *c, int slot)
{
    static const uint32_t counts[] = {0, 1, 7, 48, 50, 101, 130, 17};

    return c->tiny ? (counts[slot % 8] + 3) / 4 : counts[slot % 8];
}

void cln_check_random_ray(const float box[4], uint32_t stream, uint32_t i, float o[4], float d[4])
{
    double length = 0;

    for (uint32_t a = 0; a < 3; a++) {
        const double part = floor(cln_check_uniform(stream, 3 * i + a, 0, 1024)) / 1024;

        o[a] = (float)(box[a] + part * box[3]);
        d[a] = (float)cln_check_uniform(stream + 1, 3 * i + a, -1, 1);
        length += (double)d[a] * d[a];
    }
    for (int a = 0; a < 3; a++)
        d[a] = (float)(d[a] / sqrt(length));
}

static cln_status make_data(const cln_checks *c, data *d)
{
    cln_status st = CLN_OK;
    const int leaves = c->p->leaves;
    uint32_t at = 0;

    for (int s = 0; s < leaves; s++)
        d->n += samples_of(c, s);
    CLN_TRY(cln_octree_boxes(&c->model->tree, (float **)&d->boxes));
    CLN_TRY(cln_alloc(&d->samples, d->n, sizeof *d->samples, "self-test"));
    CLN_TRY(cln_alloc(&d->ray_o, d->n, sizeof *d->ray_o, "self-test"));
    CLN_TRY(cln_alloc(&d->ray_d, d->n, sizeof *d->ray_d, "self-test"));
    CLN_TRY(cln_alloc(&d->dout, d->n, sizeof *d->dout, "self-test"));
    CLN_TRY(cln_alloc(&d->out, d->n, 4 * sizeof *d->out, "self-test"));
    CLN_TRY(cln_alloc(&d->want, d->n, sizeof *d->want, "self-test"));
    CLN_TRY(cln_alloc(&d->want_grads, (size_t)(leaves * c->p->net.params), sizeof *d->want_grads,
                      "self-test"));
    CLN_TRY(cln_alloc(&d->want_decoder, (size_t)c->p->net.decoder_params, sizeof *d->want_decoder,
                      "self-test"));
    for (uint32_t round = 0; at < d->n; round++) /* leaves in turn, so that grouping has work */
        for (int s = 0; s < leaves; s++)
            if (round < samples_of(c, s)) {
                cln_check_random_ray(d->boxes[s], 4, at, d->ray_o[at], d->ray_d[at]);
                for (uint32_t a = 0; a < 3; a++)
                    d->dout[at][a] = (float)cln_check_uniform(6, 3 * at + a, -1, 1);
                d->dout[at][3] = (float)cln_check_uniform(7, at, -0.01, 0.01);
                d->samples[at] = (cln_sample){.delta = 0.01f, .ray = at, .slot = s};
                at++;
            }
done:
    return st;
}

static void free_data(data *d)
{
    free(d->samples);
    free(d->ray_o);
    free(d->ray_d);
    free(d->dout);
    free(d->boxes);
    free(d->out);
    free(d->grads);
    free(d->slice);
    free(d->want);
    free(d->want_grads);
    free(d->want_decoder);
}

static void run_reference(const cln_checks *c, data *d)
{
    const int params = c->p->net.params;

    for (uint32_t i = 0; i < d->n; i++) {
        const int slot = d->samples[i].slot;
        ref_network r = cln_check_network(&c->p->config, c->model, slot);
        double local[3], dir[3], dout[4];

        for (int a = 0; a < 3; a++) {
            local[a] = 2 * ((double)d->ray_o[i][a] - d->boxes[slot][a]) / d->boxes[slot][3] - 1;
            dir[a] = d->ray_d[i][a];
        }
        for (int k = 0; k < 4; k++)
            dout[k] = d->dout[i][k];
        r.decoder_grad = d->want_decoder;
        ref_forward(&r, c->model->params + slot * params, local, dir, NULL, slope_of(c),
                    d->want[i]);
        ref_backward(&r, c->model->params + slot * params, local, dir, NULL, slope_of(c), dout,
                     d->want_grads + slot * params);
    }
}

static cln_status compare_outputs(cln_checks *c, const char *name, const data *d)
{
    cln_status st = CLN_OK;
    char full[48];
    float *got = NULL;
    double *want = NULL;

    CLN_TRY(cln_alloc(&got, 3 * (size_t)d->n, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, 3 * (size_t)d->n, sizeof *want, "self-test"));
    for (uint32_t i = 0; i < 3 * d->n; i++) {
        got[i] = d->out[i / 3 * 4 + i % 3];
        want[i] = d->want[i / 3][i % 3];
    }
    snprintf(full, sizeof full, "%s: colour", name);
    cln_check_compare(c, full, got, want, 3 * (size_t)d->n, FORWARD[0], FORWARD[1]);
    for (uint32_t i = 0; i < d->n; i++) {
        got[i] = d->out[4 * i + 3];
        want[i] = d->want[i][3];
    }
    snprintf(full, sizeof full, "%s: density", name);
    cln_check_compare(c, full, got, want, d->n, FORWARD[0], FORWARD[1]);
done:
    free(got);
    free(want);
    return st;
}

/* Runs forward and, in training, backward; allocates *grads. */
static cln_status launch(cln_checks *c, data *d, bool training, float **grads)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const size_t out = (size_t)d->n * 4 * sizeof(float);
    const size_t floats = (size_t)d->slices * (size_t)p->net.params;

    CLN_TRY(cln_check_spoil(p->device, &p->out, out));
    CLN_TRY(cln_stage_forward(p, d->n, d->slices, training, STEP_KEY));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, d->out, out));
    if (training) {
        CLN_TRY(cln_alloc(grads, floats, sizeof **grads, "self-test"));
        CLN_TRY(cln_check_spoil(p->device, &p->grads, floats * sizeof **grads));
        if (p->net.encoding == CLN_ENCODING_VOXEL) /* only vertices near samples are written */
            CLN_TRY(cln_buffer_zero(p->device, &p->grads, floats * sizeof **grads));
        CLN_TRY(cln_stage_backward(p, d->n, d->slices, STEP_KEY));
        CLN_TRY(cln_buffer_read(p->device, &p->grads, 0, *grads, floats * sizeof **grads));
    }
done:
    return st;
}

/* Adds the smoothness' gradients of voxels: of a leaf's vertices that its first slice met, which
 * has the first of its samples. */
static cln_status add_smoothness(const cln_checks *c, data *d)
{
    cln_status st = CLN_OK;
    const cln_network *net = &c->p->net;
    const int side = net->cells + 1, vertices = side * side * side;
    uint32_t *left = NULL; /* [leaf] samples of its first slice */
    uint8_t *met = NULL;   /* [leaf][vertices] */

    CLN_TRY(cln_alloc(&left, (size_t)c->p->leaves, sizeof *left, "self-test"));
    CLN_TRY(cln_alloc(&met, (size_t)(c->p->leaves * vertices), 1, "self-test"));
    for (uint32_t s = d->slices; s-- > 0;)
        if (d->slice[s].count > 0)
            left[d->slice[s].slot] = d->slice[s].count;
    for (uint32_t i = 0; i < d->n; i++) {
        const int slot = d->samples[i].slot;
        int first = 0;

        if (left[slot] == 0)
            continue;
        left[slot]--;
        for (int a = 2; a >= 0; a--) {
            const double at = ((double)d->ray_o[i][a] - d->boxes[slot][a]) / d->boxes[slot][3];

            first = first * side + (int)fmin(at * net->cells, net->cells - 1);
        }
        for (int k = 0; k < 8; k++)
            met[slot * vertices + first + (k & 1) + (k >> 1 & 1) * side + (k >> 2) * side * side] =
                1;
    }
    for (int slot = 0; slot < c->p->leaves; slot++)
        ref_voxel_smooth(&c->p->config, net, c->model->tree.level[c->model->tree.leaf[slot]], slot,
                         STEP_KEY, c->model->params + slot * net->params, met + slot * vertices,
                         d->want_grads + slot * net->params);
done:
    free(left);
    free(met);
    return st;
}

/* Checks each leaf's gradient, the sum over its slices. */
static cln_status compare_gradients(cln_checks *c, data *d)
{
    cln_status st = CLN_OK;
    const size_t params = (size_t)c->p->net.params, all = (size_t)c->p->leaves * params;
    float *got = NULL;

    CLN_TRY(cln_alloc(&got, all, sizeof *got, "self-test"));
    if (c->p->net.encoding == CLN_ENCODING_VOXEL)
        CLN_TRY(add_smoothness(c, d));
    for (uint32_t s = 0; s < d->slices; s++)
        for (size_t i = 0; i < params; i++)
            got[(size_t)d->slice[s].slot * params + i] += d->grads[s * params + i];
    cln_check_compare(c, "networks backward", got, d->want_grads, all, GRADIENT[0], GRADIENT[1]);
    if (c->p->net.decoder)
        CLN_TRY(cln_check_decoder_gradient(c, d->want_decoder));
done:
    free(got);
    return st;
}

/* Checks one of Adam's moments as stored, to one unit in bfloat16's last place. Outputs nothing, as
 * rounding depends on a device's last bits. */
static cln_status check_moments(cln_checks *c, const char *name, const cln_buffer *buffer,
                                const double *want, size_t n)
{
    cln_status st = CLN_OK;
    const size_t each = cln_moment_bytes(&c->p->config);
    double square = 0;
    size_t wrong = 0;
    char *got = NULL;

    CLN_TRY(cln_alloc(&got, n, each, "self-test"));
    CLN_TRY(cln_buffer_read(c->p->device, buffer, 0, got, n * each));
    for (size_t i = 0; i < n; i++)
        square += want[i] * want[i];
    for (size_t i = 0; i < n; i++) {
        float value = 0;
        uint16_t upper = 0;

        if (each == sizeof value) {
            memcpy(&value, got + i * each, sizeof value);
        } else {
            memcpy(&upper, got + i * each, sizeof upper);
            value = ref_from_bf16(upper);
        }
        wrong += !(fabs(value - want[i]) <= 0.01 * fabs(want[i]) + 1e-5 * sqrt(square / (double)n));
    }
    cln_check_say(c, name, wrong == 0, "%zu of %zu are off", wrong, n);
done:
    free(got);
    return st;
}

/* Checks an update of the leaves with enough samples; the others must keep every bit. */
static cln_status check_adam(cln_checks *c, const data *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_config *config = &p->config;
    const int params = p->net.params, all = p->leaves * params;
    const double lr = (float)1e-3;
    float *got = NULL;
    double *want = NULL, *grad = NULL, *m = NULL, *v = NULL;
    int *owner = NULL, changed = 0, idle = 0;
    bool within = false;
    char text[256];

    CLN_TRY(cln_alloc(&got, (size_t)all, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, (size_t)all, sizeof *want, "self-test"));
    CLN_TRY(cln_alloc(&grad, (size_t)all, sizeof *grad, "self-test"));
    CLN_TRY(cln_alloc(&m, (size_t)all, sizeof *m, "self-test"));
    CLN_TRY(cln_alloc(&v, (size_t)all, sizeof *v, "self-test"));
    for (uint32_t s = 0; s < d->slices; s++)
        for (int i = 0; i < params; i++)
            grad[d->slice[s].slot * params + i] += d->grads[s * (uint32_t)params + (uint32_t)i];
    CLN_TRY(cln_stage_adam(p, (uint32_t)config->min_leaf_samples, lr));
    if (p->net.decoder)
        CLN_TRY(cln_check_decoder_step(c, d->want_decoder, lr * config->decoder_rate));
    CLN_TRY(cln_buffer_read(p->device, &p->params, 0, got, (size_t)all * sizeof *got));
    for (int i = 0; i < all; i++)
        want[i] = c->model->params[i];
    CLN_TRY(cln_check_owners(c->model, &owner));
    if (owner)
        cln_check_step_voxels(config, &p->net, owner, lr, (cln_moving){all, want, grad, m, v});
    for (int i = 0; owner && i < all; i++) {
        idle += grad[owner[i]] == 0 && i % params % p->net.features == 3; /* once a vertex */
        changed += grad[owner[i]] == 0 && got[i] != c->model->params[i];
    }
    for (int s = 0; !owner && s < p->leaves; s++) {
        const int at = s * params;

        if ((int)samples_of(c, s) >= config->min_leaf_samples) {
            ref_adam(params, want + at, grad + at, m + at, v + at, 1,
                     (ref_adam_rule){lr, (float)config->beta1, (float)config->beta2,
                                     (float)config->epsilon});
            continue;
        }
        idle++;
        for (int i = 0; i < params; i++)
            changed += got[at + i] != c->model->params[at + i];
    }
    /* compare the steps: large weights would hide their errors */
    for (int i = 0; i < all; i++) {
        got[i] -= c->model->params[i];
        want[i] -= c->model->params[i];
    }
    /* output nothing: the first step is nearly the sign of the device's own gradient */
    within = cln_compare_values(got, want, (size_t)all, 1e-6, 1e-2, text);
    cln_check_say(c, "adam", within, "%s", text);
    cln_check_say(c, "adam: leaves with few samples stay", changed == 0 && idle > 0,
                  "%d weights of %d %s changed", changed, idle,
                  owner ? "vertices without gradient" : "leaves");
    if (!owner || config->beta1 > 0)
        CLN_TRY(check_moments(c, "adam: first moments", &p->adam_m, m, (size_t)all));
    CLN_TRY(check_moments(c, "adam: second moments", &p->adam_v, v, (size_t)all));
done:
    free(got);
    free(want);
    free(grad);
    free(m);
    free(v);
    free(owner);
    return st;
}

/* Checks that backward and Adam in one pass, as in training, give the same weights. */
static cln_status check_update(cln_checks *c, const data *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const size_t floats = (size_t)p->leaves * (size_t)p->net.params;
    float *apart = NULL, *at_once = NULL;
    bool same = false;

    CLN_TRY(cln_alloc(&apart, floats, sizeof *apart, "self-test"));
    CLN_TRY(cln_alloc(&at_once, floats, sizeof *at_once, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->params, 0, apart, floats * sizeof *apart));
    CLN_TRY(cln_pipeline_upload(p, c->model, true));
    CLN_TRY(cln_stage_forward(p, d->n, d->slices, true, STEP_KEY));
    CLN_TRY(
        cln_stage_update(p, d->n, d->slices, (uint32_t)p->config.min_leaf_samples, STEP_KEY, 1e-3));
    CLN_TRY(cln_buffer_read(p->device, &p->params, 0, at_once, floats * sizeof *at_once));
    same = memcmp(apart, at_once, floats * sizeof *apart) == 0;
    cln_check_say(c, "networks: backward and adam at once", same, "%zu weights", floats);
done:
    free(apart);
    free(at_once);
    return st;
}

/* Outputs the order of samples by leaf. */
static cln_status put_out_order(cln_checks *c, uint32_t n)
{
    cln_status st = CLN_OK;
    uint32_t *order = NULL;

    CLN_TRY(cln_alloc(&order, n, sizeof *order, "self-test"));
    CLN_TRY(cln_buffer_read(c->p->device, &c->p->values[0], 0, order, n * sizeof *order));
    cln_check_numbers(c, "grouping: order", order, n);
done:
    free(order);
    return st;
}

/* No leaf here has more samples than the roulette decides on together. */
enum { MOST_OF_SLICE = CLN_ROULETTE_SEGMENT, CUTOFF = 2 };

/* What roulette.cl chose. Arrays: [grouped sample], but for counts [slice]. */
typedef struct choice {
    uint32_t *order, *chosen, *counts;
    float (*heads)[4];
    float (*got)[4];   /* gradients of heads, 0 for samples left out */
    double (*want)[4]; /* the reference's */
} choice;

/* Counts the samples of a slice that the reference chooses differently, and fills in its part of
 * got and want. If a draw is too close to its threshold for float32, the slice is not compared. */
static int compare_choice(const cln_checks *c, const data *d, uint32_t s, const choice *of)
{
    const uint32_t count = of->counts[s];
    float(*got)[4] = of->got;
    double(*want)[4] = of->want;
    const ref_network r = cln_check_network(&c->p->config, c->model, d->slice[s].slot);
    const cln_slice *slice = &d->slice[s];
    double factors[MOST_OF_SLICE];
    bool went[MOST_OF_SLICE] = {false}, any = false, near = false;
    int other = 0;

    CLN_ASSERT(slice->count <= MOST_OF_SLICE);
    memset(got + slice->start, 0, slice->count * sizeof *got);
    near = ref_roulette(&r, CUTOFF, cln_hash(STEP_KEY), (int)slice->count, of->order + slice->start,
                        (const float(*)[4])d->out, d->dout, want + slice->start, factors) < 1e-5;
    for (uint32_t i = 0; i < count && i < slice->count; i++) {
        const uint32_t row = of->chosen[slice->start + i];

        if (row >= slice->count || went[row])
            return 1;
        went[row] = true;
        for (int k = 0; k < 4; k++)
            got[slice->start + row][k] = of->heads[slice->start + i][k];
    }
    for (uint32_t i = 0; i < slice->count; i++)
        any |= factors[i] > 0;
    for (uint32_t i = 0; i < slice->count; i++) {
        if (near)
            memset(want[slice->start + i], 0, sizeof *want);
        if (near)
            memset(got[slice->start + i], 0, sizeof *got);
        other += !near && (any || i > 0) && went[i] != (factors[i] > 0);
    }
    return other;
}

/* Checks the choice of samples for the backward pass (kernels/roulette.cl) of the newest forward
 * pass. */
static cln_status check_roulette(cln_checks *c, const data *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    choice of = {0};
    uint32_t all = 0;
    int other = 0;

    CLN_TRY(cln_alloc(&of.order, d->n, sizeof *of.order, "self-test"));
    CLN_TRY(cln_alloc(&of.chosen, d->n, sizeof *of.chosen, "self-test"));
    CLN_TRY(cln_alloc(&of.counts, d->slices, sizeof *of.counts, "self-test"));
    CLN_TRY(cln_alloc(&of.heads, d->n, sizeof *of.heads, "self-test"));
    CLN_TRY(cln_alloc(&of.got, d->n, sizeof *of.got, "self-test"));
    CLN_TRY(cln_alloc(&of.want, d->n, sizeof *of.want, "self-test"));
    CLN_TRY(cln_check_spoil(p->device, &p->heads, d->n * sizeof *of.heads));
    CLN_TRY(cln_check_spoil(p->device, &p->chosen, d->n * sizeof *of.chosen));
    CLN_TRY(cln_stage_roulette(p, d->n, d->slices, 0, CUTOFF, STEP_KEY));
    CLN_TRY(cln_buffer_read(p->device, &p->values[0], 0, of.order, d->n * sizeof *of.order));
    CLN_TRY(cln_buffer_read(p->device, &p->chosen, 0, of.chosen, d->n * sizeof *of.chosen));
    CLN_TRY(
        cln_buffer_read(p->device, &p->chosen_counts, 0, of.counts, d->slices * sizeof *of.counts));
    CLN_TRY(cln_buffer_read(p->device, &p->heads, 0, of.heads, d->n * sizeof *of.heads));
    for (uint32_t s = 0; s < d->slices; s++) {
        other += compare_choice(c, d, s, &of);
        all += of.counts[s];
    }
    /* some must be left out if any slice has more than one sample */
    cln_check_say(c, "roulette: samples", other == 0 && (all < d->n || d->slices >= d->n),
                  "%d of %u not chosen as by the reference, %u chosen", other, d->n, all);
    cln_check_compare(c, "roulette: gradients", of.got[0], of.want[0], 4 * (size_t)d->n, 1e-11,
                      1e-4);
done:
    free(of.order);
    free(of.chosen);
    free(of.counts);
    free(of.heads);
    free(of.got);
    free(of.want);
    return st;
}

cln_status cln_check_networks(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    data d = {0};
    float *first_out = NULL, *again = NULL;
    bool same = false;

    CLN_TRY(make_data(c, &d));
    run_reference(c, &d);
    CLN_TRY(cln_check_put(p->device, &p->samples, d.samples, d.n * sizeof *d.samples));
    CLN_TRY(cln_check_put(p->device, &p->ray_o, d.ray_o, d.n * sizeof *d.ray_o));
    CLN_TRY(cln_check_put(p->device, &p->ray_d, d.ray_d, d.n * sizeof *d.ray_d));
    CLN_TRY(cln_check_put(p->device, &p->dout, d.dout, d.n * sizeof *d.dout));
    CLN_TRY(cln_stage_group(p, d.n, &d.slices));
    CLN_TRY(cln_stage_slices(p, &d.slices));
    CLN_TRY(put_out_order(c, d.n));
    CLN_TRY(cln_alloc(&d.slice, d.slices, sizeof *d.slice, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->slices, 0, d.slice, d.slices * sizeof *d.slice));
    for (uint32_t s = 0; s < d.slices; s++)
        if (d.slice[s].slot < 0 || d.slice[s].slot >= p->leaves) {
            cln_check_say(c, "grouping", false, "slice %u is of leaf %d of %d", s, d.slice[s].slot,
                          p->leaves);
            goto done;
        }
    CLN_TRY(launch(c, &d, false, NULL));
    CLN_TRY(compare_outputs(c, "networks", &d));
    CLN_TRY(launch(c, &d, true, &d.grads));
    CLN_TRY(compare_outputs(c, "networks in training", &d));
    CLN_TRY(compare_gradients(c, &d));
    first_out = d.out;
    d.out = NULL;
    CLN_TRY(cln_alloc(&d.out, d.n, 4 * sizeof *d.out, "self-test"));
    CLN_TRY(launch(c, &d, true, &again));
    same = memcmp(first_out, d.out, (size_t)d.n * 4 * sizeof *d.out) == 0 &&
           memcmp(d.grads, again, (size_t)d.slices * (size_t)p->net.params * sizeof *again) == 0;
    cln_check_say(c, "networks: same launch, same bytes", same, "%u samples, %u slices", d.n,
                  d.slices);
    CLN_TRY(check_roulette(c, &d));
    CLN_TRY(check_adam(c, &d));
    CLN_TRY(check_update(c, &d));
done:
    free(first_out);
    free(again);
    free_data(&d);
    return st;
}

/* ---- compositing ---- */

enum { RAYS = 61, MOST = 40, ALONE = 30, EACH = 4 };

typedef struct batch {
    uint32_t starts[RAYS + 1];
    cln_sample samples[RAYS * MOST];
    float out[RAYS * MOST][4], dout[RAYS * MOST][4], targets[RAYS][4], backgrounds[RAYS][4];
    float ray_o[RAYS][4], ray_d[RAYS][4], shown[RAYS][4];
    cln_ray_result pictures[RAYS], results[RAYS];
    float got[RAYS * MOST * 4], shares[RAYS * MOST];
    double want[RAYS * MOST * 4], ref_out[MOST][4], ref_t[MOST], ref_delta[MOST], ref_grad[MOST][4];
} batch;

/* Makes rays with none, one and many samples; empty, faint and opaque ones. */
static void make_batch(batch *b)
{
    uint32_t at = 0;

    for (uint32_t r = 0; r < RAYS; r++) {
        const uint32_t n = r % 7 == 6 ? 0 : r % 5 == 0 ? 1 : 1 + r * 13 % (MOST - 1);
        double t = cln_check_uniform(8, r, 0, 2);

        b->starts[r] = at;
        for (uint32_t i = 0; i < n; i++, at++) {
            const double delta = cln_check_uniform(9, at, 1e-3, 0.1);
            const double depth =
                r % 4 == 0 && i == n / 2 ? 50 : pow(10, cln_check_uniform(10, at, -6, 0));

            b->samples[at] = (cln_sample){
                .t = (float)(t + delta / 2), .delta = (float)delta, .ray = r, .slot = 0};
            t += delta;
            for (uint32_t k = 0; k < 3; k++)
                b->out[at][k] = (float)cln_check_uniform(11, 3 * at + k, 0, 1);
            b->out[at][3] = (float)(depth / delta);
        }
        for (uint32_t k = 0; k < 3; k++) {
            b->targets[r][k] = (float)cln_check_uniform(12, 3 * r + k, 0, 1);
            b->backgrounds[r][k] = (float)cln_check_uniform(13, 3 * r + k, 0, 1);
        }
        b->ray_o[r][3] = (float)cln_check_uniform(14, r, 0, 3);
        b->ray_d[r][3] = 1;
        b->ray_d[r][r % 3] = 1;
        for (uint32_t k = 0; k < 4; k++)
            b->shown[r][k] = (float)cln_check_uniform(15, 4 * r + k, 0, 1);
    }
    b->starts[RAYS] = at;
}

/* The rays of the pixel that ray r belongs to: from ALONE on EACH a pixel, in the last one
 * fewer. */
static int find_pixel(const cln_pipeline *p, int r, int *first)
{
    *first = r;
    if (!p->averaged || r < ALONE)
        return 1;
    *first = r - (r - ALONE) % EACH;
    return RAYS - *first < EACH ? RAYS - *first : EACH;
}

static cln_status put_pixels(cln_pipeline *p)
{
    cln_pixel pixels[RAYS] = {{0}};
    int count = 0;

    for (int r = 0; r < RAYS; r++) {
        int first = 0;

        if (find_pixel(p, r, &first) > 1)
            pixels[r].spot = CLN_SPOT(r, -r, r - first, EACH);
        count += r == first;
    }
    p->rays_per_pixel = (double)RAYS / count;
    return cln_check_put(p->device, &p->pixels, pixels, sizeof pixels);
}

static cln_status run_batch(cln_pipeline *p, batch *b)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const uint32_t n = b->starts[RAYS];

    CLN_TRY(cln_check_put(device, &p->sample_starts, b->starts, sizeof b->starts));
    CLN_TRY(cln_check_put(device, &p->samples, b->samples, n * sizeof *b->samples));
    CLN_TRY(cln_check_put(device, &p->out, b->out, n * sizeof *b->out));
    CLN_TRY(cln_check_put(device, &p->targets, b->targets, sizeof b->targets));
    CLN_TRY(cln_check_put(device, &p->backgrounds, b->backgrounds, sizeof b->backgrounds));
    CLN_TRY(cln_check_put(device, &p->ray_o, b->ray_o, sizeof b->ray_o));
    CLN_TRY(cln_check_put(device, &p->ray_d, b->ray_d, sizeof b->ray_d));
    if (p->depth_loss > 0)
        CLN_TRY(cln_check_put(device, &p->shown, b->shown, sizeof b->shown));
    CLN_TRY(put_pixels(p));
    CLN_TRY(cln_check_spoil(device, &p->results, sizeof b->results));
    CLN_TRY(cln_stage_composite(p, RAYS, CLN_DEPTH_MEDIAN));
    CLN_TRY(cln_buffer_read(device, &p->results, 0, b->pictures, sizeof b->pictures));
    CLN_TRY(cln_check_spoil(device, &p->results, sizeof b->results));
    CLN_TRY(cln_check_spoil(device, &p->dout, n * sizeof *b->dout));
    CLN_TRY(cln_stage_composite_train(p, RAYS, n));
    CLN_TRY(cln_buffer_read(device, &p->results, 0, b->results, sizeof b->results));
    CLN_TRY(cln_buffer_read(device, &p->dout, 0, b->dout, n * sizeof *b->dout));
    if (cln_pipeline_measures(&p->config) == 1)
        CLN_TRY(cln_buffer_read(device, &p->measures, 0, b->shares, n * sizeof *b->shares));
done:
    return st;
}

/* Copies ray r to float64 for the reference; returns its number of samples. */
static int widen(const cln_pipeline *p, batch *b, int r, double background[3], double target[4])
{
    const int n = (int)(b->starts[r + 1] - b->starts[r]);

    for (int i = 0; i < n; i++) {
        const uint32_t at = b->starts[r] + (uint32_t)i;

        b->ref_t[i] = b->samples[at].t;
        b->ref_delta[i] = b->samples[at].delta;
        for (int k = 0; k < 4; k++)
            b->ref_out[i][k] = b->out[at][k];
    }
    for (int k = 0; k < 3; k++)
        background[k] = b->backgrounds[p->ray_background ? r : 0][k];
    for (int k = 0; k < 4; k++)
        target[k] = b->targets[r][k];
    return n;
}

/* Moves a ray's target as far as the ray is from its pixel's mean, in colour and opacity. Returns
 * the rays of the pixel. want: b->want's pictures. */
static int move_target(const cln_pipeline *p, const double *want, int r, double target[4])
{
    int first = 0;
    const int count = find_pixel(p, r, &first);

    for (int k = 0; k < 3 && count > 1; k++) {
        double mean = 0;

        for (int i = first; i < first + count; i++)
            mean += want[5 * i + k] / count;
        target[k] += want[5 * r + k] - mean;
    }
    for (int i = first; i < first + count && count > 1; i++)
        target[3] += (want[5 * r + 4] - want[5 * i + 4]) / count;
    return count;
}

static void compare_batch(cln_checks *c, batch *b)
{
    const cln_config *config = &c->p->config;
    ref_loss loss = cln_check_loss(c->p);
    double background[3], target[4], losses[RAYS], pictures[5 * RAYS];
    float got_losses[RAYS];

    for (int r = 0; r < RAYS; r++) {
        const int n = widen(c->p, b, r, background, target);
        const cln_ray_result *got = &b->pictures[r];
        double *want = b->want + 5 * r;

        ref_composite(n, (const double(*)[4])b->ref_out, b->ref_t, b->ref_delta, background, want,
                      want + 3, want + 4, NULL);
        want[3] = ref_median_depth(n, (const double(*)[4])b->ref_out, b->ref_t, b->ref_delta);
        want[3] += (double)b->ray_o[r][3] * want[4] / fmax(want[4], 1e-10); /* from the camera */
        memcpy(b->got + 5 * r, (const float[5]){got->r, got->g, got->b, got->depth, got->opacity},
               5 * sizeof(float));
    }
    cln_check_compare(c, "composite", b->got, b->want, RAYS * 5, 1e-10, 1e-4);
    memcpy(pictures, b->want, sizeof pictures);
    for (int r = 0; r < RAYS; r++) {
        const int n = widen(c->p, b, r, background, target);
        const double share = c->p->rays_per_pixel / move_target(c->p, pictures, r, target);

        loss.depth = config->depth_loss * b->shown[r][3];
        loss.reach = ref_reach(b->ray_o[r], b->ray_d[r], b->shown[r]);
        losses[r] = ref_loss_of_ray(&loss, n, (const double(*)[4])b->ref_out, b->ref_t,
                                    b->ref_delta, background, target, b->ref_grad);
        got_losses[r] = b->results[r].loss;
        for (int i = 0; i < n; i++)
            for (int k = 0; k < 4; k++) {
                const size_t at = b->starts[r] + (size_t)i;

                b->got[4 * at + (size_t)k] = b->dout[at][k];
                /* the loss is a mean over pixels, a pixel's over its rays */
                b->want[4 * at + (size_t)k] = share * b->ref_grad[i][k] / RAYS;
            }
    }
    cln_check_compare(c, "loss", got_losses, losses, RAYS, 1e-9, 1e-3);
    cln_check_compare(c, "composite backward", b->got, b->want, 4 * (size_t)b->starts[RAYS],
                      GRADIENT[0], GRADIENT[1]);
}

/* Checks the samples' shares of their ray's error: by weight, and by length for the transmitted
 * part. */
static void compare_shares(cln_checks *c, batch *b)
{
    double background[3], target[4], measures[MOST][3], pictures[5 * RAYS], depth = 0;

    for (int r = 0; r < RAYS; r++) {
        const int n = widen(c->p, b, r, background, target);

        ref_composite(n, (const double(*)[4])b->ref_out, b->ref_t, b->ref_delta, background,
                      pictures + 5 * r, &depth, pictures + 5 * r + 4, NULL);
    }
    for (int r = 0; r < RAYS; r++) {
        const int n = widen(c->p, b, r, background, target);
        const int count = move_target(c->p, pictures, r, target);

        ref_measures(n, (const double(*)[4])b->ref_out, b->ref_delta, background, target, measures);
        for (int i = 0; i < n; i++)
            b->want[b->starts[r] + (uint32_t)i] = measures[i][0] / count;
    }
    cln_check_compare(c, "shares of the error", b->shares, b->want, b->starts[RAYS], 1e-9, 1e-3);
}

cln_status cln_check_composite(cln_checks *c)
{
    cln_status st = CLN_OK;
    batch *b = NULL;

    CLN_TRY(cln_alloc(&b, 1, sizeof *b, "self-test"));
    make_batch(b);
    CLN_TRY(run_batch(c->p, b));
    compare_batch(c, b);
    if (cln_pipeline_measures(&c->p->config) == 1)
        compare_shares(c, b);
done:
    free(b);
    return st;
}
