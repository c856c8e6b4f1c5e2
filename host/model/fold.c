/* The split by folding (method.md section 11): a child's weights compute on its local coordinates
 * what the parent's compute on the parent's, so a split changes no picture. Its inverse, unfolding,
 * is the start of a merge. Only layers that read the position's encoding change, layer 0 and the
 * skip layer; encoding.h says how. */
#include <string.h>

#include "model/encoding.h"
#include "model/encoding_grid.h"
#include "model/encoding_voxel.h"
#include "model/network.h"

typedef void change_layer(int bands, int width, int octant, const float *rows, const float *bias,
                          float *out_rows, float *out_bias);

static void change_network(const cln_network *net, change_layer *change, int octant,
                           const float *from, float *to)
{
    const int layers[] = {0, net->skip_layer};

    memcpy(to, from, (size_t)net->params * sizeof *to);
    for (int i = 0; i < 2; i++) {
        const int layer = layers[i], hidden = layer > 0 ? net->width * net->width : 0;

        if (layer < 0)
            continue;
        change(net->bands, net->width, octant, from + net->trunk_w[layer] + hidden,
               from + net->trunk_b[layer], to + net->trunk_w[layer] + hidden,
               to + net->trunk_b[layer]);
    }
}

void cln_network_fold(const cln_network *net, const float *parent, int octant, float *child)
{
    if (net->encoding == CLN_ENCODING_VOXEL)
        cln_voxel_split(net, octant, parent, child);
    else if (net->encoding != CLN_ENCODING_FREQUENCY)
        cln_grid_split(net, octant, parent, child);
    else
        change_network(net, cln_encoding_split, octant, parent, child);
}

void cln_network_unfold(const cln_network *net, const float *child, int octant, float *parent)
{
    if (net->encoding != CLN_ENCODING_FREQUENCY)
        cln_grid_merge(net, octant, child, parent);
    else
        change_network(net, cln_encoding_merge, octant, child, parent);
}
