/* needs: layer */
/* The grid encoding (method.md 1): features at the vertices of a grid over the leaf, read by
 * trilinear interpolation. Its parameters are [CELLS + 1]^3 vertices (z, y, x) of FEATURES numbers,
 * at GRID_W of a leaf's row. ENCODING 1; directions keep their frequencies.
 *
 *   encode_position()        local positions -> inputs of the trunk's first layer, and places
 *   encode_position_begin()  before a slice's first block: zeroes the grid's gradient
 *   encode_position_back()   gradient of the first layer, places -> gradient of the vertices
 *
 * A place is a sample's cell and where in it the sample is: AT_ROWS rows instead of the position's
 * three, the far vertex's share along x, y and z and the cell's first vertex, as an offset in the
 * grid. A cell has four edges along x; both ends of one are 2 FEATURES neighbouring numbers.
 *
 * Backward, sums over samples have one order, and no two work-items write one vertex: the eight
 * corners of a cell differ in the parities of their coordinates, and in a group of several
 * work-items each takes one parity and feature of every sample.
 *
 * CELLS      along an axis
 * FEATURES   of a vertex, a multiple of 4; ENC_PAD is the same number
 */
#if ENCODING == 1
#define GRID_SIDE (CELLS + 1)
#define EDGE_V    (FEATURES / 4) /* vectors of eight for both ends of an edge */

/* Numbers from a cell's first edge to edge yz: 1 is the next along y, 2 along z. */
HELPER int grid_edge(int yz)
{
    return ((yz >> 1) * GRID_SIDE + (yz & 1)) * GRID_SIDE * FEATURES;
}

/* The weight of edge yz. */
HELPER float grid_edge_weight(const __local float *at, int s, int yz)
{
    const float y = at[NB + s], z = at[2 * NB + s];

    return (yz & 1 ? y : 1.0f - y) * (yz & 2 ? z : 1.0f - z);
}

/* Places of samples s .. s + VW - 1, instead of their positions. */
HELPER void grid_places(__local float *at, int s)
{
    vf first = (vf)(0.0f);

    for (int a = 2; a >= 0; a--) {
        const vf x = fmin(fmax((VLOAD(at + a * NB + s) + 1.0f) * (0.5f * CELLS), (vf)(0.0f)),
                          (vf)(CELLS));
        const vf cell = fmin(floor(x), (vf)(CELLS - 1));

        VSTORE_IN(__local, x - cell, at + a * NB + s);
        first = MAD(first, (vf)(GRID_SIDE), cell);
    }
    VSTORE_IN(__local, first * (float)FEATURES, at + 3 * NB + s);
}

/* w: the leaf's parameters. */
HELPER void encode_position(__local float *at, float4 box, const __global float *w,
                            __local float *enc, int rows, int lid)
{
    (void)box;
    for (int s0 = lid * VW; s0 < rows; s0 += STEP_N) {
        grid_places(at, s0);
        for (int s = s0; s < s0 + VW; s++) {
            const __global float *cell = w + GRID_W + (int)at[3 * NB + s];
            const float4 far = (float4)(at[s]), near = 1.0f - far;
            float8 sum[EDGE_V];
            float4 end[2 * EDGE_V];

            UNROLL (v, EDGE_V)
                sum[v] = (float8)(0.0f);
            UNROLL (yz, 4) {
                const float8 weight = (float8)(grid_edge_weight(at, s, yz));

                UNROLL (v, EDGE_V)
                    sum[v] = MAD(weight, vload8(v, cell + grid_edge(yz)), sum[v]);
            }
            UNROLL (v, EDGE_V) {
                end[2 * v] = sum[v].lo;
                end[2 * v + 1] = sum[v].hi;
            }
            UNROLL (v, EDGE_V)
                vstore4(MAD(far, end[EDGE_V + v], near * end[v]), v, enc + s * FEATURES);
        }
    }
}

#if TRAIN
HELPER void encode_position_begin(LEAF_SPACE float *grad, int lid)
{
    for (int p = GRID_W + lid; p < PARAMS; p += LS)
        grad[p] = 0.0f;
}

/* Adds one sample's gradient d [FEATURES] to its cell's eight vertices; lid: the work-item, where
 * a group has several. */
HELPER void grid_scatter(const __local float *at, int s, const __local float *d, int lid,
                         LEAF_SPACE float *grid)
{
    const int first = (int)at[3 * NB + s];

#if LS == 1
    const float4 far = (float4)(at[s]), near = 1.0f - far;
    float4 end[2 * EDGE_V];

    UNROLL (v, EDGE_V) {
        end[v] = near * vload4(v, d);
        end[EDGE_V + v] = far * vload4(v, d);
    }
    UNROLL (yz, 4) {
        const float8 weight = (float8)(grid_edge_weight(at, s, yz));

        UNROLL (v, EDGE_V) {
            LEAF_SPACE float *to = grid + first + grid_edge(yz) + 8 * v;

            VSTORE8_IN(LEAF_SPACE,
                       MAD(weight, (float8)(end[2 * v], end[2 * v + 1]), vload8(0, to)), to);
        }
    }
    (void)lid;
#else
    const int vertex = first / FEATURES;
    const int odd = vertex % GRID_SIDE % 2 + vertex / GRID_SIDE % GRID_SIDE % 2 * 2 +
                    vertex / (GRID_SIDE * GRID_SIDE) % 2 * 4;

    for (int i = lid; i < 8 * FEATURES; i += LS) {
        const int corner = i / FEATURES ^ odd, f = i % FEATURES;
        const float weight = (corner & 1 ? at[s] : 1.0f - at[s]) *
                             grid_edge_weight(at, s, corner >> 1);
        LEAF_SPACE float *to = grid + first + grid_edge(corner >> 1) + (corner & 1) * FEATURES + f;

        *to = MAD(weight, d[f], *to);
    }
#endif
}

/* d [NB][WIDTH]: gradient of the first layer's pre-activations; w0 [FEATURES][WIDTH]: its weights.
 * at: places. scratch: [NB][FEATURES]. Has a barrier. */
HELPER void encode_position_back(block b, const __local float *at, const __local float *d,
                                 const __global float *w0, __local float *scratch,
                                 LEAF_SPACE float *grad)
{
    for (int i = b.lid; i < b.count * FEATURES; i += LS) {
        const int s = i / FEATURES, f = i % FEATURES;
        vf sum = (vf)(0.0f);

        for (int n = 0; n < WIDTH; n += VW)
            sum = MAD(VLOAD(d + s * WIDTH + n), VLOAD(w0 + f * WIDTH + n), sum);
        scratch[i] = V_SUM(sum);
    }
    GROUP_SYNC();
    for (int s = 0; s < b.count; s++)
        grid_scatter(at, s, scratch + s * FEATURES, b.lid, grad + GRID_W);
}
#endif
#endif
