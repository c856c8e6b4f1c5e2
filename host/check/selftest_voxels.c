/* How voxels differ from networks: leaves share vertices, and one of them updates a vertex; all
 * share the decoder. See
 * selftest_checks.h; the checks themselves are in selftest_networks.c. */
#include "check/selftest_checks.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "reference/reference.h"

cln_status cln_check_owners(const cln_model *model, int **owner)
{
    cln_status st = CLN_OK;
    const cln_network *net = &model->net;
    const int leaves = model->tree.leaf_count, side = net->cells + 1;
    const int vertices = side * side * side, numbers = vertices * net->features;
    int32_t(*around)[27] = NULL;
    int *vertex = NULL;

    *owner = NULL;
    if (net->encoding != CLN_ENCODING_VOXEL)
        return CLN_OK;
    CLN_TRY(cln_octree_around(&model->tree, &around));
    CLN_TRY(cln_alloc(&vertex, (size_t)(leaves * vertices), sizeof *vertex, "self-test"));
    CLN_TRY(cln_alloc(owner, (size_t)(leaves * net->params), sizeof **owner, "self-test"));
    ref_voxel_owners(net, leaves, (const int32_t(*)[27])around, vertex);
    for (int i = 0; i < leaves * net->params; i++) {
        const int at = i % net->params, v = i / net->params * vertices + at / net->features;

        (*owner)[i] = at < numbers ? vertex[v] / vertices * net->params +
                                         vertex[v] % vertices * net->features + at % net->features
                                   : i;
    }
done:
    free(around);
    free(vertex);
    return st;
}

void cln_check_step_voxels(const cln_config *config, const cln_network *net, const int *owner,
                           double lr, cln_moving to)
{
    for (int i = 0; i < to.all; i++)
        if (owner[i] != i)
            to.grad[owner[i]] += to.grad[i];
    for (int i = 0; i < to.all; i++) {
        const int f = i % net->params % net->features;
        const double rate = f == 3 ? config->density_rate : f > 3 ? config->harmonic_rate : 1;

        if (owner[i] == i && to.grad[i] != 0)
            ref_voxel_step(&to.want[i], to.grad[i], &to.m[i], &to.v[i],
                           (ref_adam_rule){lr * rate, (float)config->beta1, (float)config->beta2,
                                           (float)config->epsilon});
    }
    for (int i = 0; i < to.all; i++)
        to.want[i] = to.want[owner[i]];
}

/* *out [decoder_params]: the sums over the groups' gradients. */
static cln_status read_gradient(const cln_pipeline *p, float *out)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->net.decoder_params, groups = (size_t)p->decoder_groups;
    float *parts = NULL;

    CLN_TRY(cln_alloc(&parts, groups * n, sizeof *parts, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->decoder_grads, 0, parts, groups * n * sizeof *parts));
    for (size_t i = 0; i < groups * n; i++)
        out[i % n] += parts[i];
done:
    free(parts);
    return st;
}

cln_status cln_check_decoder_gradient(cln_checks *c, const double *want)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)c->p->net.decoder_params;
    float *got = NULL;

    CLN_TRY(cln_alloc(&got, n, sizeof *got, "self-test"));
    CLN_TRY(read_gradient(c->p, got));
    cln_check_compare(c, "decoder backward", got, want, n, 1e-7, 1e-3);
done:
    free(got);
    return st;
}

/* The first step of a weight does not depend on the size of its gradient, only on the sign: weights
 * with a gradient that nearly cancels are left out. */
cln_status cln_check_decoder_step(cln_checks *c, const double *grad, double lr)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)c->p->net.decoder_params;
    float *got = NULL;
    double *want = NULL, largest = 0;

    CLN_TRY(cln_alloc(&got, n, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, n, sizeof *want, "self-test"));
    CLN_TRY(CLN_GET(c->p, decoder_w, got, 1));
    for (size_t i = 0; i < n; i++)
        largest = fmax(largest, fabs(grad[i]));
    for (size_t i = 0; i < n; i++) {
        const double g = grad[i];

        got[i] -= c->model->decoder[i];
        if (g == 0)
            want[i] = 0;
        else if (fabs(g) < 1e-4 * largest)
            want[i] = got[i] = 0;
        else
            want[i] = -lr * 0.1 * g / (sqrt(0.1 * g * g) + c->p->config.epsilon);
    }
    cln_check_compare(c, "decoder step", got, want, n, 1e-6, 1e-2);
done:
    free(got);
    free(want);
    return st;
}
