/* The leaf encoding: a network's input in place of a position in its leaf (or a direction). The
 * only one is the frequency encoding of method.md section 1. An encoding consists of
 *
 *   rows, parameters,   this header: model/network.c lays out layers by cln_encoding_rows(). The
 *   initial values      frequency encoding has no parameters; another one's would stand in a leaf's
 *                       block beside the layers' (take() in network.c), and cln_network_init()
 *                       would fill them
 *   split, merge        this header: model/fold.c applies them to every layer that reads the
 *                       encoding
 *   forward, backward   kernels/encoding_frequency.h, named in the first line of kernels/block.h;
 *                       the end of kernels/mlp_backward.cl says where parameters' gradients begin
 *   float64 twin        host/reference/encoding.c
 *
 * A second encoding is a second file beside each of these, and an option that chooses. */
#ifndef CLN_ENCODING_H
#define CLN_ENCODING_H

/* Rows of `bands` bands of a point p. Rows 0 .. 2 are p; with a = axis, row 3 + 6k + a is
 * sin(2^k p_a) and row 6 + 6k + a is cos(2^k p_a). */
int cln_encoding_rows(int bands);

/* Brings a layer's weights over the encoding of a leaf's position, [cln_encoding_rows()][width],
 * and its bias [width] to the coordinates of child `octant`: the same function there, but for band
 * 0 (see encoding.c). Outputs may not overlap inputs. */
void cln_encoding_split(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

/* The inverse: from child `octant` to its parent's coordinates. The child's top band is dropped. */
void cln_encoding_merge(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

#endif
