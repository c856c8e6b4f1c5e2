/* The leaf network (method.md sections 1, 2, 11): its layout in memory, initial weights, and the
 * exact split by folding. kernels/mlp_*.cl evaluate it (float64 twin in reference/).
 *
 * Encoding (model/encoding.h): rows zero-padded to a multiple of 4. Position: leaf-local x in
 * [-1,1]^3; direction: unit world vector.
 *
 * Parameters of one leaf, floats, in this order; a matrix is [input][output] row-major; every block
 * starts at a multiple of 16 floats:
 *   trunk layer 0        W [enc_pad][width]                b [width]
 *   trunk layer i >= 1   W [width (+ enc_pad)][width]      b [width]   + enc_pad: skip layer only;
 *                                                                      rows: h, then encoding
 *   density head         w [width]                         b [16]      only b[0] is used
 *   view layer           W [width + dir_pad][view_width]   b [view_width]
 *   colour head          W [3][view_width]                 b [16]      only b[0..2] are used
 *   grid, if there is one   [cells + 1]^3 (z, y, x) [features]        enc_pad is features then
 * Without view dependence the view layer is absent and the colour head is W [3][width]. Skip layer:
 * i = depth/2 + 1, for depth >= 6 with config.skip; else none. Voxels have no layers, only the
 * grid: see encoding_voxel.h; width is features then. All leaves may share a decoder, whose
 * layout is in kernels/decoder.h.
 */
#ifndef CLN_NETWORK_H
#define CLN_NETWORK_H

#include <stddef.h>
#include "base/status.h"
#include "base/config_rows.h"

/* Most voxels of a leaf along an axis: kernels mark the vertices of a row as bits of one number. */
enum { CLN_VOXEL_CELLS = 16 };

/* Inputs of a decoder beside the features: spherical harmonics of degrees 1 and 2. */
enum { CLN_DECODER_HARMONICS = 8 };

typedef struct cln_network {
    int width, depth, view_width, bands, view_bands;
    bool view_dependence;
    int skip_layer;   /* -1 = none */
    int enc, enc_pad; /* rows of the position encoding, padded */
    int dir, dir_pad; /* rows of the direction encoding, padded; 0 without view dependence */
    int colour_width; /* inputs of the colour head */
    int trunk_w[8], trunk_b[8]; /* offsets, floats */
    int sigma_w, sigma_b;
    int view_w, view_b; /* -1 without view dependence */
    int colour_w, colour_b;
    int encoding;                /* CLN_ENCODING_* of the position */
    int cells, features;         /* of the grid; 0 without one */
    int decoder, decoder_params; /* width and floats of voxels' decoder; 0 without one */
    int grid_w;                  /* offset behind the layers; equals params without a grid */
    int params;                  /* floats per leaf, padded (the stride of packed buffers) */
    int learned;                 /* of these, without padding (for reports) */
} cln_network;

/* Rows of a trunk layer's matrix: enc_pad, width or width + enc_pad. */
int cln_network_rows(const cln_network *net, int layer);

cln_status cln_network_layout(const cln_config *config, cln_network *out);

/* What a model of so many leaves has learnt: numbers without padding, a decoder's once. */
double cln_network_learned(const cln_network *net, int leaves);

/* "W32-D3-V16": width, depth, width of the view layer (V0: none); followed by "-G8x4": a grid of 8
 * cells along each axis and 4 features. At most 31 characters. */
void cln_network_text(const cln_network *net, char out[32]);

/* Fills in a leaf's initial weights, [params] (method.md section 2); the same for every leaf. */
void cln_network_init(const cln_network *net, const cln_config *config, float *params);

/* Fills in the initial weights of voxels' decoder, [decoder_params] (kernels/decoder.h): its output
 * is 0. */
void cln_decoder_init(const cln_network *net, const cln_config *config, float *params);

/* Does it add anything: is a weight of its output not 0? No without a decoder. */
bool cln_decoder_adds(const cln_network *net, const float *params);

/* Density activation's bias b, from initial_depth (method.md section 1). */
double cln_network_density_bias(const cln_config *config);

/* Makes weights of child `octant` that compute on its local coordinates what the parent's compute
 * on the parent's (method.md section 11, "Split by folding"): exact but for band 0, whose
 * half-angle functions are fitted to 6e-7 by four bands or more. parent, child: [params], may not
 * overlap. */
void cln_network_fold(const cln_network *net, const float *parent, int octant, float *child);

/* The inverse, from which a merge starts: weights of the parent that compute what its child
 * `octant` computes, inside the octant and beyond, without the child's top band. */
void cln_network_unfold(const cln_network *net, const float *child, int octant, float *parent);

#endif
