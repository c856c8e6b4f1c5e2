/* A model in host memory: creates it, carries it over a change of the tree, digests it. See
 * model.h. checkpoint.c reads and writes it. */
#include "model/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "model/encoding_voxel.h"
#include "model/shell_tree.h"

/* Frees the arrays that the device also holds during training. */
static void free_carried(cln_model *model)
{
    free(model->params);
    free(model->adam_m);
    free(model->adam_v);
    free(model->adam_steps);
    free(model->density);
    free(model->sums);
    free(model->met);
    model->params = NULL;
    model->adam_m = model->adam_v = NULL;
    model->adam_steps = model->met = NULL;
    model->density = NULL;
    model->sums = NULL;
}

void cln_model_free(cln_model *model)
{
    free_carried(model);
    cln_octree_free(&model->tree);
    free(model->error);
    free(model->saved);
    free(model->exposure);
    free(model->motions);
    free(model->decoder);
    free(model->decoder_m);
    free(model->decoder_v);
    memset(model, 0, sizeof *model);
}

static size_t cells_of(const cln_model *model)
{
    size_t n = (size_t)model->config.n1;

    return n * n * n;
}

static void fill_nan(float *array, size_t count)
{
    for (size_t i = 0; i < count; i++)
        array[i] = NAN;
}

size_t cln_moment_bytes(const cln_config *config)
{
    return config->moments == CLN_MOMENTS_BFLOAT16 ? sizeof(uint16_t) : sizeof(float);
}

size_t cln_first_moment_bytes(const cln_config *config)
{
    return config->encoding == CLN_ENCODING_VOXEL && config->beta1 == 0 ? 0
                                                                        : cln_moment_bytes(config);
}

/* Allocates *array, rows of row_bytes, if it is NULL. */
static cln_status make(void *array, size_t leaves, size_t row_bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *rows = NULL;

    memcpy(&rows, array, sizeof rows);
    if (rows)
        return CLN_OK;
    CLN_TRY(cln_alloc(&rows, leaves, row_bytes, what));
    memcpy(array, &rows, sizeof rows);
done:
    return st;
}

cln_status cln_model_make_room(cln_model *model, bool training)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)model->tree.leaf_count, stride = (size_t)model->net.params;
    const size_t moments = stride * cln_moment_bytes(&model->config);
    const size_t decoder = (size_t)model->net.decoder_params;

    CLN_TRY(make(&model->params, leaves, stride * sizeof *model->params, "weights"));
    CLN_TRY(make(&model->decoder, decoder, sizeof *model->decoder, "decoder"));
    if (!training)
        return CLN_OK;
    CLN_TRY(make(&model->decoder_m, decoder, sizeof *model->decoder_m, "decoder"));
    CLN_TRY(make(&model->decoder_v, decoder, sizeof *model->decoder_v, "decoder"));
    CLN_TRY(make(&model->adam_m, leaves, stride * cln_first_moment_bytes(&model->config),
                 "Adam's state"));
    CLN_TRY(make(&model->adam_v, leaves, moments, "Adam's state"));
    CLN_TRY(make(&model->adam_steps, leaves, sizeof *model->adam_steps, "Adam's state"));
    CLN_TRY(make(&model->density, leaves, cells_of(model) * sizeof *model->density, "densities"));
    CLN_TRY(make(&model->sums, leaves, 2 * CLN_MEASURES * sizeof *model->sums, "measures"));
    CLN_TRY(make(&model->met, leaves, sizeof *model->met, "measures"));
done:
    return st;
}

cln_status cln_model_create_on(const cln_config *config, const cln_octree *tree, cln_model *out)
{
    cln_status st = CLN_OK;
    size_t leaves = 0, stride = 0;

    memset(out, 0, sizeof *out);
    out->config = *config;
    out->space = cln_space_unit;
    CLN_TRY(cln_network_layout(config, &out->net));
    CLN_TRY(cln_octree_copy(tree, &out->tree));
    out->level = cln_octree_depth(&out->tree);
    leaves = (size_t)out->tree.leaf_count;
    stride = (size_t)out->net.params;
    CLN_TRY(cln_model_make_room(out, true));
    CLN_TRY(cln_alloc(&out->error, leaves, sizeof *out->error, "measures"));
    CLN_TRY(cln_alloc(&out->saved, leaves, sizeof *out->saved, "measures"));
    fill_nan(out->error, leaves);
    fill_nan(out->saved, leaves);
    cln_network_init(&out->net, config, out->params);
    if (out->net.decoder)
        cln_decoder_init(&out->net, config, out->decoder);
    for (size_t s = 1; s < leaves; s++) /* the same for all: no seams at step 0 */
        memcpy(out->params + s * stride, out->params, stride * sizeof *out->params);
done:
    if (st != CLN_OK)
        cln_model_free(out);
    return st;
}

cln_status cln_model_first_tree(const cln_config *config, bool shell, cln_octree *out, int *level)
{
    *level = config->start_level;
    if (!shell)
        return cln_octree_create(*level, out);
    *level = *level > 2 ? *level : 2; /* a shell space has no coarser tree */
    return cln_shell_tree_create(*level, out);
}

static cln_status create(const cln_config *config, bool shell, cln_model *out)
{
    cln_status st = CLN_OK;
    cln_octree tree = {0};
    int level = 0;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_model_first_tree(config, shell, &tree, &level));
    CLN_TRY(cln_model_create_on(config, &tree, out));
    out->level = level;
done:
    cln_octree_free(&tree);
    return st;
}

cln_status cln_model_create(const cln_config *config, cln_model *out)
{
    return create(config, false, out);
}

cln_status cln_model_create_shell(const cln_config *config, cln_model *out)
{
    return create(config, true, out);
}

void cln_model_restart_measures(cln_model *model)
{
    size_t leaves = (size_t)model->tree.leaf_count;

    if (model->sums) {
        memset(model->sums, 0, leaves * 2 * CLN_MEASURES * sizeof *model->sums);
        memset(model->met, 0, leaves * sizeof *model->met);
    }
    model->sum_rays = 0;
    model->sum_square = 0;
}

/* Carries *array, which has rows of row_bytes or is NULL: kept leaves keep their rows, new ones get
 * zeros. */
static cln_status carry(const cln_octree_change *change, size_t row_bytes, void *array)
{
    cln_status st = CLN_OK;
    char *old = NULL, *carried = NULL;

    memcpy(&old, array, sizeof old);
    if (!old)
        return CLN_OK;
    CLN_TRY(cln_alloc(&carried, (size_t)change->count, row_bytes, "training state of leaves"));
    for (size_t s = 0; s < (size_t)change->count; s++)
        if (change->octant[s] == CLN_COPIED)
            memcpy(carried + s * row_bytes, old + (size_t)change->from[s] * row_bytes, row_bytes);
    free(old);
    memcpy(array, &carried, sizeof carried);
done:
    return st;
}

/* The same for one number per leaf; new leaves get NaN. */
static cln_status carry_known(const cln_octree_change *change, float **array)
{
    cln_status st = CLN_OK;

    CLN_TRY(carry(change, sizeof **array, array));
    for (int s = 0; *array && s < change->count; s++)
        if (change->octant[s] != CLN_COPIED)
            (*array)[s] = NAN;
done:
    return st;
}

/* The child's grid [n][n][n] (z, y, x) from the nearest cells of its octant in the parent's: the
 * centre of child cell i lies at ((i + 1/2) / n + upper half) / 2 of the parent's side. */
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

/* The parent's grid from its child's: the nearest cell, which outside the child's octant is at the
 * grid's edge. */
static void densities_of_parent(int n, const uint16_t *child, int octant, uint16_t *parent)
{
    for (int z = 0; z < n; z++)
        for (int y = 0; y < n; y++)
            for (int x = 0; x < n; x++) {
                const int at[3] = {x, y, z};
                int cell[3];

                for (int a = 0; a < 3; a++) {
                    cell[a] = 2 * at[a] + 1 - ((octant >> a) & 1) * n;
                    cell[a] = cell[a] < 0 ? 0 : cell[a] >= n ? n - 1 : cell[a];
                }
                *parent++ = child[((size_t)cell[2] * n + cell[1]) * n + cell[0]];
            }
}

cln_status cln_model_apply(cln_model *model, const cln_octree_change *change)
{
    cln_status st = CLN_OK;
    size_t stride = (size_t)model->net.params, cells = cells_of(model);
    size_t count = (size_t)change->count;
    int n1 = model->config.n1;
    float *params = NULL;
    uint16_t *density = NULL;

    CLN_ASSERT(change->count == model->tree.leaf_count);
    CLN_TRY(cln_alloc(&params, count * stride, sizeof *params, "weights"));
    if (model->density)
        CLN_TRY(cln_alloc(&density, count * cells, sizeof *density, "densities"));
    CLN_TRY(carry(change, stride * cln_first_moment_bytes(&model->config), &model->adam_m));
    CLN_TRY(carry(change, stride * cln_moment_bytes(&model->config), &model->adam_v));
    CLN_TRY(carry(change, sizeof *model->adam_steps, &model->adam_steps));
    CLN_TRY(carry(change, 2 * CLN_MEASURES * sizeof *model->sums, &model->sums));
    CLN_TRY(carry(change, sizeof *model->met, &model->met));
    CLN_TRY(carry_known(change, &model->error));
    CLN_TRY(carry_known(change, &model->saved));
    for (size_t s = 0; s < count; s++) {
        const float *from = model->params + (size_t)change->from[s] * stride;
        const uint16_t *old = density ? model->density + (size_t)change->from[s] * cells : NULL;
        uint16_t *grid = density ? density + s * cells : NULL;
        int octant = change->octant[s];

        if (octant >= 0) {
            cln_network_fold(&model->net, from, octant, params + s * stride);
            if (grid)
                densities_of_child(n1, old, octant, grid);
        } else if (octant == CLN_FRESH) {
            cln_network_init(&model->net, &model->config, params + s * stride);
        } else if (octant == CLN_COPIED) {
            memcpy(params + s * stride, from, stride * sizeof *params);
            if (grid)
                memcpy(grid, old, cells * sizeof *grid);
        } else {
            cln_network_unfold(&model->net, from, CLN_MERGED - octant, params + s * stride);
            if (grid)
                densities_of_parent(n1, old, CLN_MERGED - octant, grid);
        }
    }
    if (cln_leaf_kind_of(model->net.encoding)->joined)
        CLN_TRY(cln_voxel_join(&model->net, &model->tree, change, params));
    free(model->params);
    free(model->density);
    model->params = params;
    model->density = density;
    params = NULL;
    density = NULL;
done:
    free(params);
    free(density);
    if (st != CLN_OK) { /* the old weights belong to another tree */
        free(model->params);
        model->params = NULL;
    }
    return st;
}

cln_status cln_model_follow(cln_model *model, const cln_octree_change *change)
{
    cln_status st = CLN_OK;

    CLN_ASSERT(change->count == model->tree.leaf_count);
    free_carried(model);
    CLN_TRY(carry_known(change, &model->error));
    CLN_TRY(carry_known(change, &model->saved));
done:
    return st;
}

void cln_model_digest_begin(const cln_model *model, cln_digest_part *out)
{
    const cln_octree *tree = &model->tree;
    uint64_t digest = CLN_DIGEST_START;

    /* Leaves only: strikes and culled nodes do not change pictures. */
    for (int s = 0; s < tree->leaf_count; s++) {
        int node = tree->leaf[s];
        const uint16_t *pos = tree->pos[node];
        uint16_t row[4] = {tree->level[node], pos[0], pos[1], pos[2]};
        digest = cln_digest(digest, row, sizeof row);
    }
    if (model->net.decoder_params > 0)
        digest = cln_digest(digest, model->decoder,
                            (size_t)model->net.decoder_params * sizeof *model->decoder);
    cln_digest_begin(out, digest);
}

uint64_t cln_model_digest(const cln_model *model)
{
    cln_digest_part part;

    if (!model->params)
        return 0;
    cln_model_digest_begin(model, &part);
    cln_digest_more(&part, model->params,
                    (size_t)model->tree.leaf_count * (size_t)model->net.params * sizeof(float));
    return cln_digest_end(&part);
}

const float *cln_model_gains(const cln_model *model, int view)
{
    return model->exposure && model->exposed ? model->exposure[view] : NULL;
}

int cln_model_antialias(const cln_model *model)
{
    return model->averaged ? cln_config_antialias(&model->config) : 1;
}
