/* Reserves, fills and releases the buffers of buffer_list.h, and computes their sizes. */
#include "pipeline/pipeline.h"

#include <string.h>

#include "base/config.h"
#include "pipeline/walk.h"

const cln_buffer_row cln_buffer_rows[CLN_BUFFERS] = {
#define ROW(member, number, per, purpose, when, what)                                          \
    {what,           offsetof(cln_pipeline, member), number, CLN_PER_##per, CLN_FOR_##purpose, \
     CLN_WHEN_##when},
#define X(member, type, n, per, purpose, when, what)    ROW(member, 1, per, purpose, when, what)
#define PAIR(member, type, n, per, purpose, when, what) ROW(member, 2, per, purpose, when, what)
    CLN_BUFFER_LIST(X, PAIR)
#undef X
#undef PAIR
#undef ROW
};

int cln_pipeline_measures(const cln_config *config)
{
    if (config->density_weight == CLN_WEIGHT_VISIBILITY)
        return CLN_MEASURES;
    return config->adaptive && !config->tree_from[0] ? 1 : 0;
}

/* Pre-activations, or features, kept per sample. */
static int acts_of(const cln_network *net)
{
    if (net->encoding == CLN_ENCODING_VOXEL)
        return net->decoder ? net->features : 0;
    return net->depth * net->width + (net->view_dependence ? net->view_width : 0);
}

size_t cln_pipeline_act_bytes(const cln_network *net, const cln_tune *tune)
{
    const bool half = tune->half && cln_leaf_kind_of(net->encoding)->network;

    return (size_t)acts_of(net) * (half ? sizeof(cl_half) : sizeof(cl_float));
}

int cln_pipeline_transposed(const cln_network *net)
{
    return (net->depth - 1) * net->width * net->width +
           (net->view_dependence ? net->view_width * net->width : 0);
}

/* ---- elements of a row ---- */

static size_t cells_of(const cln_pipeline *p)
{
    return (size_t)p->config.n1 * (size_t)p->config.n1 * (size_t)p->config.n1;
}

static size_t transposed_of(const cln_pipeline *p)
{
    return p->tune.leaf ? 0 : (size_t)cln_pipeline_transposed(&p->net);
}

static size_t firsts_of(const cln_pipeline *p)
{
    return cln_first_moment_bytes(&p->config) * (size_t)p->net.params;
}

static size_t moments_of(const cln_pipeline *p)
{
    return cln_moment_bytes(&p->config) * (size_t)p->net.params;
}

/* Voxels (kernels/voxel.cl): neighbours of a leaf; vertices of a slice that samples met. */
static size_t around_of(const cln_pipeline *p)
{
    return cln_leaf_kind_of(p->net.encoding)->joined ? 27 : 0;
}

static size_t met_of(const cln_pipeline *p)
{
    return p->net.encoding == CLN_ENCODING_VOXEL
               ? (size_t)(p->net.cells + 1) * (size_t)(p->net.cells + 1)
               : 0;
}

/* Common vertices of voxels on several ranks (kernels/halo.cl): a number of a link; its row. */
static size_t linked_of(const cln_pipeline *p)
{
    return cln_leaf_kind_of(p->net.encoding)->joined;
}

static size_t halo_row_of(const cln_pipeline *p)
{
    return linked_of(p) ? 1 + (size_t)p->net.features : 0;
}

/* Ranks share the walk of rays (walk.h). */
static size_t walked_of(const cln_pipeline *p)
{
    return p->ranks >= CLN_WALK_RANKS;
}

/* A slice's share of the gradients of a group of slices. */
static size_t decoder_part_of(const cln_pipeline *p)
{
    return (size_t)p->net.decoder_params / CLN_DECODER_EACH;
}

/* Features that the decoder reads, and their gradients. */
static size_t decoded_of(const cln_pipeline *p)
{
    return p->net.decoder ? (size_t)p->net.features : 0;
}

static size_t shown_of(const cln_pipeline *p)
{
    return p->depth_loss > 0;
}

/* float4s of a stretch's sums (kernels/stretch.cl). */
static size_t sums_of(const cln_pipeline *p)
{
    return p->depth_loss > 0 ? 3 : 2;
}

static size_t longest_of(const cln_pipeline *p)
{
    const size_t weights = (size_t)p->net.params * sizeof(cl_float);
    const size_t densities = cells_of(p) * sizeof(cl_ushort);

    return weights > densities ? weights : densities; /* moments are no longer than weights */
}

static size_t kept_of(const cln_pipeline *p)
{
    return cln_pipeline_act_bytes(&p->net, &p->tune);
}

size_t cln_buffer_row_bytes(const cln_pipeline *p, cln_buffer_id id)
{
    switch (id) {
#define X(member, type, n, per, purpose, when, what) \
    case CLN_BUFFER_##member:                        \
        return sizeof(type) * (size_t)(n);
        CLN_BUFFER_LIST(X, X)
#undef X
    case CLN_BUFFERS:
        break;
    }
    CLN_ASSERT(false);
    return 0;
}

cln_buffer *cln_pipeline_buffer(cln_pipeline *p, cln_buffer_id id)
{
    return (cln_buffer *)((char *)p + cln_buffer_rows[id].at);
}

/* Gives back the memory of culled and merged leaves. */
static void free_if_large(cln_device *device, cln_buffer *buffer, size_t bytes)
{
    if (buffer->bytes > bytes + bytes / 4 + 65536)
        cln_buffer_free(device, buffer);
}

/* Reserves rows of `id` in any buffer. */
static cln_status reserve(cln_pipeline *p, cln_buffer_id id, cln_buffer *buffer, size_t rows)
{
    const cln_buffer_row *row = &cln_buffer_rows[id];
    const size_t each = cln_buffer_row_bytes(p, id), bytes = rows * each;
    const int part_rows = row->per == CLN_PER_LEAF_P       ? p->part_leaves
                          : row->per == CLN_PER_GRADIENT_P ? p->part_slices
                                                           : 0;
    const size_t part = (size_t)part_rows * each;

    if (row->per == CLN_PER_LEAF || row->per == CLN_PER_LEAF_P)
        free_if_large(p->device, buffer, bytes);
    if (part_rows == 0 || p->parts == 1)
        return cln_buffer_reserve(p->device, buffer, bytes, row->what);
    return cln_buffer_reserve_parts(p->device, buffer, bytes, part ? part : 16, row->what);
}

cln_status cln_pipeline_reserve(cln_pipeline *p, cln_buffer_id id, size_t rows)
{
    cln_status st = CLN_OK;

    for (int i = 0; i < cln_buffer_rows[id].count; i++)
        CLN_TRY(reserve(p, id, &cln_pipeline_buffer(p, id)[i], rows));
done:
    return st;
}

cln_status cln_pipeline_succeed(cln_pipeline *p, cln_buffer_id array, size_t rows)
{
    return reserve(p, array, &p->successor, rows);
}

void cln_pipeline_replace(cln_pipeline *p, cln_buffer_id array)
{
    cln_buffer *old = cln_pipeline_buffer(p, array);

    cln_buffer_free(p->device, old);
    *old = p->successor;
    memset(&p->successor, 0, sizeof p->successor);
}

cln_status cln_pipeline_put(cln_pipeline *p, cln_buffer_id id, const void *data, size_t rows)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_reserve(p, id, rows));
    CLN_TRY(cln_buffer_write(p->device, cln_pipeline_buffer(p, id), 0, data,
                             rows * cln_buffer_row_bytes(p, id)));
done:
    return st;
}

cln_status cln_pipeline_put_soon(cln_pipeline *p, cln_buffer_id id, const void *data, size_t rows)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_reserve(p, id, rows));
    CLN_TRY(cln_buffer_send(p->device, cln_pipeline_buffer(p, id), 0, data,
                            rows * cln_buffer_row_bytes(p, id)));
done:
    return st;
}

cln_status cln_pipeline_get(cln_pipeline *p, cln_buffer_id id, void *data, size_t rows)
{
    return cln_buffer_read(p->device, cln_pipeline_buffer(p, id), 0, data,
                           rows * cln_buffer_row_bytes(p, id));
}

static void release(cln_pipeline *p, cln_buffer_id id)
{
    for (int i = 0; i < cln_buffer_rows[id].count; i++)
        cln_buffer_free(p->device, &cln_pipeline_buffer(p, id)[i]);
}

void cln_pipeline_release(cln_pipeline *p, cln_purpose purpose)
{
    for (int id = 0; id < CLN_BUFFERS; id++)
        if (cln_buffer_rows[id].purpose == purpose)
            release(p, (cln_buffer_id)id);
}

void cln_pipeline_release_all(cln_pipeline *p)
{
    for (int id = 0; id < CLN_BUFFERS; id++)
        release(p, (cln_buffer_id)id);
}
