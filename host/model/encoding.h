/* The leaf encoding: what a network reads instead of a position in its leaf (or a direction). There is one, the
 * frequency encoding of method.md section 1, and this is its seam: what one consists of, and where.
 *
 *   rows, parameters, initial values  here; rows: cln_encoding_rows(), which model/network.c lays layers out by. The
 *                                     frequency encoding has no parameters: another one's take() their place in a
 *                                     leaf's block there, beside the layers', and are filled by cln_network_init()
 *   split, merge                      here; model/fold.c applies them to every layer that reads the encoding
 *   forward, backward                 kernels/encoding_frequency.h, named in the first line of kernels/block.h; the
 *                                     gradient of parameters would begin at the end of kernels/mlp_backward.cl
 *   float64 twin                      host/reference/encoding.c
 *
 * Another encoding is a second file beside each of these, and an option that chooses. */
#ifndef CLN_ENCODING_H
#define CLN_ENCODING_H

/* Rows of `bands` bands: row 0 .. 2 = p; row 3 + 6k + a = sin(2^k p_a), row 6 + 6k + a = cos(2^k p_a), a = axis. */
int cln_encoding_rows(int bands);

/* A layer's weights over the encoding of a leaf's position, rows [cln_encoding_rows()][width], and its bias
 * [width], in the coordinates of child `octant`: the same function there, but for band 0 (see encoding.c). Outputs
 * may not overlap inputs. */
void cln_encoding_split(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

/* The inverse: of child `octant` in its parent's coordinates. The child's top band has no place there and is left
 * out. */
void cln_encoding_merge(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

#endif
