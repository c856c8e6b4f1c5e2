/* A model in host memory: made, carried over a change of structure, digested. See model.h. Its
 * way to and from the disk is checkpoint.c; decides nothing and evaluates nothing. */
#include "model/model.h"

#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"

void cln_model_free(cln_model *model)
{
    cln_octree_free(&model->tree);
    free(model->params);
    free(model->adam_m);
    free(model->adam_v);
    free(model->adam_steps);
    free(model->density);
    memset(model, 0, sizeof *model);
}

static size_t cells_of(const cln_model *model)
{
    size_t n = (size_t)model->config.n1;

    return n * n * n;
}

cln_status cln_model_create(const cln_config *config, cln_model *out)
{
    cln_status st = CLN_OK;
    size_t leaves = 0, stride = 0;

    memset(out, 0, sizeof *out);
    out->config = *config;
    out->half = 1;
    out->level = config->start_level;
    CLN_TRY(cln_network_layout(config, &out->net));
    CLN_TRY(cln_octree_create(config->start_level, &out->tree));
    leaves = (size_t)out->tree.leaf_count;
    stride = (size_t)out->net.params;
    CLN_TRY(cln_alloc(&out->params, leaves * stride, sizeof *out->params, "weights"));
    CLN_TRY(cln_alloc(&out->adam_m, leaves * stride, sizeof *out->adam_m, "Adam's state"));
    CLN_TRY(cln_alloc(&out->adam_v, leaves * stride, sizeof *out->adam_v, "Adam's state"));
    CLN_TRY(cln_alloc(&out->adam_steps, leaves, sizeof *out->adam_steps, "Adam's state"));
    CLN_TRY(cln_alloc(&out->density, leaves * cells_of(out), sizeof *out->density, "densities"));
    cln_network_init(&out->net, config, out->params);
    for (size_t s = 1; s < leaves; s++) /* the same for all: no seams at step 0 */
        memcpy(out->params + s * stride, out->params, stride * sizeof *out->params);
done:
    if (st != CLN_OK)
        cln_model_free(out);
    return st;
}

/* *array = [change->count][stride] floats: kept leaves copied, new ones left zero. */
static cln_status carry(const cln_octree_change *change, size_t stride, float **array)
{
    cln_status st = CLN_OK;
    float *fresh = NULL;

    if (!*array)
        return CLN_OK;
    CLN_TRY(cln_alloc(&fresh, (size_t)change->count * stride, sizeof *fresh, "weights"));
    for (int s = 0; s < change->count; s++)
        if (change->octant[s] < 0)
            memcpy(fresh + (size_t)s * stride, *array + (size_t)change->from[s] * stride,
                   stride * sizeof *fresh);
    free(*array);
    *array = fresh;
done:
    return st;
}

/* The child's grid [n][n][n] (z, y, x) from the octant of its parent's, nearest cell: the centre of
 * child cell i lies at ((i + 1/2) / n + upper half) / 2 of the parent's side. */
static void densities_of_child(int n, const uint16_t *parent, int octant, uint16_t *child)
{
    int half[3];

    for (int a = 0; a < 3; a++)
        half[a] = 2 * n * ((octant >> a) & 1);
    for (int z = 0; z < n; z++)
        for (int y = 0; y < n; y++) {
            int pz = (2 * z + 1 + half[2]) / 4, py = (2 * y + 1 + half[1]) / 4;
            const uint16_t *row = parent + ((size_t)pz * n + py) * n;
            for (int x = 0; x < n; x++)
                *child++ = row[(2 * x + 1 + half[0]) / 4];
        }
}

cln_status cln_model_apply(cln_model *model, const cln_octree_change *change)
{
    cln_status st = CLN_OK;
    size_t stride = (size_t)model->net.params, cells = cells_of(model);
    size_t count = (size_t)change->count;
    float *params = NULL;
    int32_t *steps = NULL;
    uint16_t *density = NULL;

    CLN_ASSERT(change->count == model->tree.leaf_count);
    CLN_TRY(cln_alloc(&params, count * stride, sizeof *params, "weights"));
    if (model->adam_steps)
        CLN_TRY(cln_alloc(&steps, count, sizeof *steps, "Adam's state"));
    if (model->density)
        CLN_TRY(cln_alloc(&density, count * cells, sizeof *density, "densities"));
    CLN_TRY(carry(change, stride, &model->adam_m));
    CLN_TRY(carry(change, stride, &model->adam_v));
    for (size_t s = 0; s < count; s++) {
        size_t from = (size_t)change->from[s];
        int octant = change->octant[s];

        if (octant >= 0)
            cln_network_fold(&model->net, model->params + from * stride, octant,
                             params + s * stride);
        else
            memcpy(params + s * stride, model->params + from * stride, stride * sizeof *params);
        if (steps && octant < 0)
            steps[s] = model->adam_steps[from];
        if (density && octant >= 0)
            densities_of_child(model->config.n1, model->density + from * cells, octant,
                               density + s * cells);
        else if (density)
            memcpy(density + s * cells, model->density + from * cells, cells * sizeof *density);
    }
    free(model->params);
    free(model->adam_steps);
    free(model->density);
    model->params = params;
    model->adam_steps = steps;
    model->density = density;
    params = NULL;
    steps = NULL;
    density = NULL;
done:
    free(params);
    free(steps);
    free(density);
    return st;
}

uint64_t cln_model_digest(const cln_model *model)
{
    const cln_octree *tree = &model->tree;
    uint64_t digest = CLN_DIGEST_START;

    /* Leaves only: strikes and culled nodes do not change what the model shows. */
    for (int s = 0; s < tree->leaf_count; s++) {
        int node = tree->leaf[s];
        const uint16_t *pos = tree->pos[node];
        uint16_t row[4] = {tree->level[node], pos[0], pos[1], pos[2]};
        digest = cln_digest(digest, row, sizeof row);
    }
    return cln_digest(digest, model->params,
                      (size_t)tree->leaf_count * (size_t)model->net.params * sizeof(float));
}
