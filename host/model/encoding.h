/* What a network reads in place of a position in its leaf, or of a direction (method.md section 1).
 * Frequencies have no parameters and are all in encoding.c. Kernels: encoding_frequency.h; float64
 * twin: host/reference/encoding.c. The other encoding of positions, a grid of features, is in
 * encoding_grid.h. */
#ifndef CLN_ENCODING_H
#define CLN_ENCODING_H

/* Number of rows of the encoding of a point p by `bands` bands. Rows 0 .. 2 are p; with a = axis,
 * row 3 + 6k + a is sin(2^k p_a) and row 6 + 6k + a is cos(2^k p_a). */
int cln_encoding_rows(int bands);

/* Number of vertices of a grid of `cells` cells along each axis. */
int cln_encoding_vertices(int cells);

/* Converts a layer's weights for the encoding of a leaf's position, [cln_encoding_rows()][width],
 * and its bias [width] to the coordinates of child `octant`: they compute the same function there,
 * but for band 0 (see encoding.c). Outputs may not overlap inputs. */
void cln_encoding_split(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

/* The inverse: from child `octant` to its parent's coordinates. The child's top band is dropped. */
void cln_encoding_merge(int bands, int width, int octant, const float *rows, const float *bias,
                        float *out_rows, float *out_bias);

#endif
