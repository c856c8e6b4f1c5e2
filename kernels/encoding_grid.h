/* needs: layer */
/* The grid encoding (method.md 1): features at the vertices of a grid over the leaf, read by
 * trilinear interpolation. Its parameters are [CELLS + 1]^3 vertices (z, y, x) of FEATURES numbers,
 * at GRID_W of a leaf's row. ENCODING 1; directions keep their frequencies.
 *
 *   encode_position()        local positions -> inputs of the trunk's first layer
 *   encode_position_begin()  before a slice's first block: zeroes the grid's gradient
 *   encode_position_back()   gradient of the first layer -> gradient of the vertices
 *
 * Backward: the eight corners of a cell differ in the parity of their coordinates, and a work-item
 * takes corners of its own parities alone, over all samples in order. So no two work-items write
 * one vertex, and sums have one order.
 *
 * CELLS      along an axis
 * FEATURES   of a vertex, a multiple of 4; ENC_PAD is the same number
 */
#if ENCODING == 1
#define GRID_SIDE (CELLS + 1)

/* The cell of a position, and the far vertex's share along each axis. */
typedef struct grid_place {
    int cell[3];
    float share[3];
} grid_place;

HELPER grid_place grid_at(const __local float *at, int s)
{
    grid_place p;

    UNROLL (a, 3) {
        const float x = clamp((at[a * NB + s] + 1.0f) * (0.5f * CELLS), 0.0f, (float)CELLS);
        const int i = min((int)x, CELLS - 1);

        p.cell[a] = i;
        p.share[a] = x - (float)i;
    }
    return p;
}

HELPER int grid_vertex(grid_place p, int corner)
{
    const int x = p.cell[0] + (corner & 1), y = p.cell[1] + (corner >> 1 & 1);
    const int z = p.cell[2] + (corner >> 2);

    return ((z * GRID_SIDE + y) * GRID_SIDE + x) * FEATURES;
}

HELPER float grid_weight(grid_place p, int corner)
{
    return (corner & 1 ? p.share[0] : 1.0f - p.share[0]) *
           (corner & 2 ? p.share[1] : 1.0f - p.share[1]) *
           (corner & 4 ? p.share[2] : 1.0f - p.share[2]);
}

/* w: the leaf's parameters. */
HELPER void encode_position(const __local float *at, float4 box, const __global float *w,
                            __local float *enc, int rows, int lid)
{
    const __global float *grid = w + GRID_W;

    (void)box;
    for (int s = lid; s < rows; s += LS) {
        const grid_place p = grid_at(at, s);

        UNROLL (f, FEATURES / 4) {
            float4 sum = (float4)(0.0f);

            UNROLL (corner, 8)
                sum = MAD((float4)(grid_weight(p, corner)),
                          vload4(0, grid + grid_vertex(p, corner) + 4 * f), sum);
            enc[(4 * f + 0) * NB + s] = sum.x;
            enc[(4 * f + 1) * NB + s] = sum.y;
            enc[(4 * f + 2) * NB + s] = sum.z;
            enc[(4 * f + 3) * NB + s] = sum.w;
        }
    }
}

#if TRAIN
HELPER void encode_position_begin(LEAF_SPACE float *grad, int lid)
{
    for (int p = GRID_W + lid; p < PARAMS; p += LS)
        grad[p] = 0.0f;
}

/* d [NB][WIDTH]: gradient of the first layer's pre-activations; w0 [FEATURES][WIDTH]: its weights.
 * scratch: [NB][FEATURES]. Has a barrier. */
HELPER void encode_position_back(block b, const __local float *at, const __local float *d,
                                 const __global float *w0, __local float *scratch,
                                 LEAF_SPACE float *grad)
{
    for (int i = b.lid; i < b.count * FEATURES; i += LS) {
        const int s = i / FEATURES, f = i % FEATURES;
        vf sum = (vf)(0.0f);

        for (int n = 0; n < WIDTH; n += VW)
            sum = MAD(VLOAD(d + s * WIDTH + n), VLOAD(w0 + f * WIDTH + n), sum);
        scratch[s * FEATURES + f] = V_SUM(sum);
    }
    GROUP_SYNC();
    for (int parity = b.lid; parity < 8; parity += LS)
        for (int s = 0; s < b.count; s++) {
            const grid_place p = grid_at(at, s);
            const int corner = parity ^ ((p.cell[0] & 1) | (p.cell[1] & 1) << 1 |
                                         (p.cell[2] & 1) << 2);
            const float weight = grid_weight(p, corner);
            LEAF_SPACE float *to = grad + GRID_W + grid_vertex(p, corner);

            UNROLL (f, FEATURES)
                to[f] = MAD(weight, scratch[s * FEATURES + f], to[f]);
        }
}
#endif
#endif
