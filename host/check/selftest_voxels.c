/* How voxels differ from networks: leaves share vertices, and one of them updates a vertex. See
 * selftest_checks.h; the checks themselves are in selftest_networks.c. */
#include "check/selftest_checks.h"

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
            ref_voxel_step(&to.want[i], to.grad[i], &to.m[i], &to.v[i], lr * rate,
                           (float)config->beta1, (float)config->beta2, (float)config->epsilon);
    }
    for (int i = 0; i < to.all; i++)
        to.want[i] = to.want[owner[i]];
}
