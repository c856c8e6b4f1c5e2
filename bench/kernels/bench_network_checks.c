/* Compares leaf networks with float64: up to 512 samples of a forward pass, all gradients of one to
 * four leaves, one leaf of Adam and of the transposed weights. See bench_network.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "bench_network.h"

/* Native functions have no bound that all devices keep; half activations have the bounds of
 * tests/pipeline/test_mlp.c. */
static void bounds_of(const network_run *r, bool gradient, double bounds[2])
{
    bounds[0] = gradient ? 1e-8 : 1e-9;
    bounds[1] = 1e-3;
    if (gradient && r->p->tune.half) {
        bounds[0] = 1e-6;
        bounds[1] = 5e-2;
    }
    if (r->p->tune.native)
        bounds[0] = bounds[1] = 1;
}

static void input_of(const network_run *r, uint32_t i, double local[3], double dir[3])
{
    const cln_sample *s = &r->samples[i];
    const float *o = r->ray_o[s->ray], *d = r->ray_d[s->ray];
    float box[4];

    cln_octree_box(&r->model.tree, r->model.tree.leaf[s->slot], box);
    for (int a = 0; a < 3; a++) {
        local[a] = 2 * (o[a] + (double)s->t * d[a] - box[a]) / box[3] - 1;
        dir[a] = d[a];
    }
}

static cln_status check_outputs(const network_run *r, bench_errors *errors)
{
    enum { MOST = 512 };
    cln_status st = CLN_OK;
    const cln_config *config = &r->p->config;
    const uint32_t count = r->n < MOST ? r->n : MOST;
    float(*all)[4] = NULL, colours[MOST * 3], densities[MOST];
    double want_colours[MOST * 3], want_densities[MOST], bounds[2];

    bounds_of(r, false, bounds);
    CLN_TRY(cln_alloc(&all, r->n, sizeof *all, "bench"));
    CLN_TRY(cln_buffer_read(r->p->device, &r->p->out, 0, all, r->n * sizeof *all));
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t i = (uint32_t)((uint64_t)k * r->n / count);
        const int slot = r->samples[i].slot;
        const ref_network net = cln_check_network(config, &r->model, slot);
        double local[3], dir[3], out[4];

        input_of(r, i, local, dir);
        ref_forward(&net, r->model.params + (size_t)slot * (size_t)net.net.params, local, dir, NULL,
                    config->rrelu_lower, out);
        for (uint32_t c = 0; c < 3; c++) {
            colours[3 * k + c] = all[i][c];
            want_colours[3 * k + c] = out[c];
        }
        densities[k] = all[i][3];
        want_densities[k] = out[3];
    }
    bench_compare(errors, colours, want_colours, 3 * (size_t)count, bounds[0], bounds[1]);
    bench_compare(errors, densities, want_densities, count, bounds[0], bounds[1]);
done:
    free(all);
    return st;
}

/* Compares centres of some cells; bfloat16 keeps 8 bits. */
static cln_status check_densities(const network_run *r, bench_errors *errors)
{
    enum { MOST = 512 };
    cln_status st = CLN_OK;
    const cln_config *config = &r->p->config;
    const int n1 = config->n1, cells = n1 * n1 * n1, total = r->refreshed * cells;
    const double along[3] = {0, 0, 1};
    uint16_t *density = NULL;
    float got[MOST];
    double want[MOST];

    CLN_TRY(cln_alloc(&density, (size_t)total, sizeof *density, "bench"));
    CLN_TRY(
        cln_buffer_read(r->p->device, &r->p->density, 0, density, (size_t)total * sizeof *density));
    for (int k = 0; k < MOST; k++) {
        const int i = (int)((int64_t)k * total / MOST), slot = i / cells, cell = i % cells;
        const int at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
        const ref_network net = cln_check_network(config, &r->model, slot);
        double local[3], out[4];

        for (int a = 0; a < 3; a++)
            local[a] = 2 * (at[a] + 0.5) / n1 - 1;
        ref_forward(&net, r->model.params + (size_t)slot * (size_t)net.net.params, local, along,
                    NULL, config->rrelu_lower, out);
        got[k] = ref_from_bf16(density[i]);
        want[k] = out[3];
    }
    bench_compare(errors, got, want, MOST, 1.6e-5 + r->p->tune.native, 0.02 + r->p->tune.native);
done:
    free(density);
    return st;
}

/* Sums of a leaf's slices on the device, in double. */
static cln_status read_gradient(const network_run *r, int slot, double *sums)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)r->p->net.params;
    float *part = NULL;

    memset(sums, 0, n * sizeof *sums);
    CLN_TRY(cln_alloc(&part, n, sizeof *part, "bench"));
    for (uint32_t s = 0; s < r->slice_count; s++) {
        if (r->slices[s].slot != slot)
            continue;
        CLN_TRY(cln_buffer_read(r->p->device, &r->p->grads, s * n * sizeof *part, part,
                                n * sizeof *part));
        for (size_t i = 0; i < n; i++)
            sums[i] += part[i];
    }
done:
    free(part);
    return st;
}

/* The leaves whose gradients are compared: how many, as float64 takes long, and the k-th of
 * them. */
static int compared_leaves(const network_run *r)
{
    const int per_leaf = (int)r->n / r->p->leaves;
    const int fit = 50000000 / (per_leaf * r->p->net.learned);
    const int most = fit < 1 ? 1 : fit > 4 ? 4 : fit;

    return most < r->p->leaves ? most : r->p->leaves;
}

static int compared_leaf(const network_run *r, int k)
{
    return (int)((int64_t)k * r->p->leaves / compared_leaves(r));
}

void network_drop_kinks(network_run *r)
{
    const cln_config *config = &r->p->config;

    for (int k = 0; k < compared_leaves(r); k++) {
        const int slot = compared_leaf(r, k);
        const ref_network net = cln_check_network(config, &r->model, slot);
        const float *params = r->model.params + (size_t)slot * (size_t)net.net.params;

        for (uint32_t i = 0; i < r->n; i++) {
            double local[3], dir[3];

            if (r->samples[i].slot != slot)
                continue;
            input_of(r, i, local, dir);
            if (ref_margin(&net, params, local, dir, NULL, config->rrelu_lower) < 2e-5)
                memset(r->dout[i], 0, sizeof r->dout[i]);
        }
    }
}

static cln_status check_gradients(const network_run *r, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const cln_config *config = &r->p->config;
    const size_t n = (size_t)r->p->net.params;
    const int leaves = compared_leaves(r);
    double *sums = NULL, *want = NULL, bounds[2];
    float *got = NULL;

    bounds_of(r, true, bounds);
    CLN_TRY(cln_alloc(&sums, n, sizeof *sums, "bench"));
    CLN_TRY(cln_alloc(&want, n, sizeof *want, "bench"));
    CLN_TRY(cln_alloc(&got, n, sizeof *got, "bench"));
    for (int k = 0; k < leaves; k++) {
        const int slot = compared_leaf(r, k);
        const ref_network net = cln_check_network(config, &r->model, slot);

        CLN_TRY(read_gradient(r, slot, sums));
        memset(want, 0, n * sizeof *want);
        for (uint32_t i = 0; i < r->n; i++) {
            double local[3], dir[3], dout[4];

            if (r->samples[i].slot != slot)
                continue;
            input_of(r, i, local, dir);
            for (int c = 0; c < 4; c++)
                dout[c] = r->dout[i][c];
            ref_backward(&net, r->model.params + (size_t)slot * n, local, dir, NULL,
                         config->rrelu_lower, dout, want);
        }
        for (size_t i = 0; i < n; i++)
            got[i] = (float)sums[i];
        bench_compare(errors, got, want, n, bounds[0], bounds[1]);
    }
done:
    free(sums);
    free(want);
    free(got);
    return st;
}

/* Voxels: replaces the gradient of each number of the leaf by the sum over all leaves that share
 * the number. grad [params]. */
static cln_status share_gradient(const network_run *r, int slot, double *grad)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)r->p->net.params, all = (size_t)r->p->leaves * n;
    int *owner = NULL;
    double *sums = NULL, *leaf = NULL;

    CLN_TRY(cln_check_owners(&r->model, &owner));
    if (!owner)
        goto done;
    CLN_TRY(cln_alloc(&sums, all, sizeof *sums, "bench"));
    CLN_TRY(cln_alloc(&leaf, n, sizeof *leaf, "bench"));
    for (int s = 0; s < r->p->leaves; s++) {
        memset(leaf, 0, n * sizeof *leaf);
        CLN_TRY(read_gradient(r, s, leaf));
        for (size_t i = 0; i < n; i++)
            sums[owner[(size_t)s * n + i]] += leaf[i];
    }
    for (size_t i = 0; i < n; i++)
        grad[i] = sums[owner[(size_t)slot * n + i]];
done:
    free(owner);
    free(sums);
    free(leaf);
    return st;
}

/* Learning rate of a voxel's number, as a share of --lr. */
static double rate_of(const network_run *r, size_t number)
{
    const cln_network *net = &r->p->net;
    const size_t f = number % (size_t)net->features;

    return f == 3 ? r->p->config.density_rate : f > 3 ? r->p->config.harmonic_rate : 1;
}

/* The first update of one leaf, in one pass or two. Compares the step rather than the weights,
 * whose size would hide its error. */
static cln_status check_adam(const network_run *r, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const cln_config *config = &r->p->config;
    const size_t n = (size_t)r->p->net.params;
    const int slot = r->p->leaves / 2;
    const double lr = (float)1e-3;
    const float *before = r->model.params + (size_t)slot * n;
    double *grad = NULL, *want = NULL, *m = NULL, *v = NULL;
    float *got = NULL;

    CLN_TRY(cln_alloc(&grad, n, sizeof *grad, "bench"));
    CLN_TRY(cln_alloc(&want, n, sizeof *want, "bench"));
    CLN_TRY(cln_alloc(&m, n, sizeof *m, "bench"));
    CLN_TRY(cln_alloc(&v, n, sizeof *v, "bench"));
    CLN_TRY(cln_alloc(&got, n, sizeof *got, "bench"));
    CLN_TRY(cln_stage_forward(r->p, r->n, r->slice_count, true, 1));
    CLN_TRY(cln_stage_backward(r->p, r->n, r->slice_count, 1));
    CLN_TRY(read_gradient(r, slot, grad));
    CLN_TRY(share_gradient(r, slot, grad));
    if (r->part == UPDATE)
        CLN_TRY(cln_stage_update(r->p, r->n, r->slice_count, 1, 1, lr));
    else
        CLN_TRY(cln_stage_adam(r->p, 1, lr));
    CLN_TRY(cln_buffer_read(r->p->device, &r->p->params, (size_t)slot * n * sizeof *got, got,
                            n * sizeof *got));
    for (size_t i = 0; i < n; i++)
        want[i] = before[i];
    if (r->p->net.encoding == CLN_ENCODING_VOXEL)
        for (size_t i = 0; i < n; i++)
            ref_voxel_step(&want[i], grad[i], &m[i], &v[i],
                           (ref_adam_rule){lr * rate_of(r, i), (float)config->beta1,
                                           (float)config->beta2, (float)config->epsilon});
    else
        ref_adam((int)n, want, grad, m, v, 1,
                 (ref_adam_rule){lr, (float)config->beta1, (float)config->beta2,
                                 (float)config->epsilon});
    for (size_t i = 0; i < n; i++) {
        got[i] -= before[i];
        want[i] -= before[i];
    }
    bench_compare(errors, got, want, n, 1e-6, 1e-2);
done:
    free(grad);
    free(want);
    free(m);
    free(v);
    free(got);
    return st;
}

/* Head gradients of the dropped samples, in the first segment of every slice. */
static cln_status check_roulette(const network_run *r, bench_errors *errors)
{
    enum { SEGMENT = CLN_ROULETTE_SEGMENT };
    cln_status st = CLN_OK;
    cln_pipeline *p = r->p;
    const size_t n = r->n, word = sizeof(cl_uint);
    float(*out)[4] = NULL, (*heads)[4] = NULL, (*got)[4] = NULL;
    double(*want)[4] = NULL;
    cl_uint *order = NULL, *chosen = NULL, *counts = NULL;
    size_t used = 0;

    CLN_TRY(cln_alloc(&out, n, sizeof *out, "bench"));
    CLN_TRY(cln_alloc(&heads, n, sizeof *heads, "bench"));
    CLN_TRY(cln_alloc(&got, n, sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&want, n, sizeof *want, "bench"));
    CLN_TRY(cln_alloc(&order, n, word, "bench"));
    CLN_TRY(cln_alloc(&chosen, n, word, "bench"));
    CLN_TRY(cln_alloc(&counts, r->slice_count, word, "bench"));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, out, n * sizeof *out));
    CLN_TRY(cln_buffer_read(p->device, &p->heads, 0, heads, n * sizeof *heads));
    CLN_TRY(cln_buffer_read(p->device, &p->values[0], 0, order, n * word));
    CLN_TRY(cln_buffer_read(p->device, &p->chosen, 0, chosen, n * word));
    CLN_TRY(cln_buffer_read(p->device, &p->chosen_counts, 0, counts, r->slice_count * word));
    for (uint32_t s = 0; s < r->slice_count; s++) {
        const cln_slice *slice = &r->slices[s];
        const int count = slice->count < SEGMENT ? (int)slice->count : SEGMENT;
        const ref_network net = cln_check_network(&p->config, &r->model, slice->slot);
        double ours[SEGMENT][4], factors[SEGMENT];

        ref_roulette(&net, ROULETTE_CUTOFF, cln_hash(1), count, order + slice->start, out, r->dout,
                     ours, factors);
        for (uint32_t i = slice->start; i < slice->start + counts[s]; i++)
            if (chosen[i] < (uint32_t)count) {
                memcpy(got[used], heads[i], sizeof *got);
                memcpy(want[used++], ours[chosen[i]], sizeof *want);
            }
    }
    bench_compare(errors, got[0], want[0], 4 * used, 1e-9, 1e-3);
done:
    free(out);
    free(heads);
    free(got);
    free(want);
    free(order);
    free(chosen);
    free(counts);
    return st;
}

cln_status network_check(network_run *r, bench_body *body, bench_errors *errors)
{
    cln_status st = CLN_OK;

    if (r->part == UPDATE) /* the timed runs of Adam have changed the moments */
        CLN_TRY(cln_pipeline_rebuild(r->p, r->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(r->p, &r->model, true));
    if (r->p->net.encoding == CLN_ENCODING_VOXEL) { /* only touched vertices get gradients */
        CLN_TRY(CLN_RESERVE(r->p, grads, r->slice_count));
        CLN_TRY(cln_buffer_zero(r->p->device, &r->p->grads,
                                r->slice_count * cln_buffer_row_bytes(r->p, CLN_BUFFER_grads)));
    }
    if (r->part == ADAM || r->part == UPDATE) {
        CLN_TRY(check_adam(r, errors));
        goto done;
    }
    if (r->part == BACKWARD || r->part == ROULETTE)
        CLN_TRY(cln_stage_forward(r->p, r->n, r->slice_count, true, 1));
    CLN_TRY(body(r));
    if (r->part == DENSITY)
        CLN_TRY(check_densities(r, errors));
    else if (r->part == EVAL || r->part == FORWARD)
        CLN_TRY(check_outputs(r, errors));
    else if (r->part == ROULETTE)
        CLN_TRY(check_roulette(r, errors));
    else
        CLN_TRY(check_gradients(r, errors));
done:
    return st;
}

/* wt[n][k] = w[k][n] of one leaf's trunk and view layers. */
cln_status network_check_transposed(const network_run *r, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const cln_network *net = &r->p->net;
    const size_t stride = (size_t)cln_pipeline_transposed(net), slot = (size_t)r->p->leaves - 1;
    const float *params = r->model.params + slot * (size_t)net->params;
    float *wt = NULL, *at = NULL;
    size_t wrong = 0;

    CLN_TRY(cln_alloc(&wt, stride, sizeof *wt, "bench"));
    CLN_TRY(cln_buffer_read(r->p->device, &r->p->transposed, slot * stride * sizeof *wt, wt,
                            stride * sizeof *wt));
    at = wt;
    for (int layer = 1; layer <= net->depth - !net->view_dependence; layer++) {
        const bool view = layer == net->depth;
        const int columns = view ? net->view_width : net->width;
        const float *w = params + (view ? net->view_w : net->trunk_w[layer]);

        for (int k = 0; k < net->width; k++)
            for (int j = 0; j < columns; j++)
                wrong += at[j * net->width + k] != w[k * columns + j];
        at += columns * net->width;
    }
    bench_equal(errors, wrong, stride);
done:
    free(wt);
    return st;
}
