/* needs: layer bfloat16 encoding_grid */
/* Stage 1: densities of the leaf networks on each leaf's jittered grid (method.md 4). A work-group
 * takes a run of a leaf's cells, NB at a time, through the trunk and the density head (layer.h).
 *
 *   density[leaf][cell] = sigma at local position -1 + 2 (i + xi) / n1 along each axis,
 *   cell = (z n1 + y) n1 + x; xi = 0.5 without jitter
 *
 * TRAIN is 0: the mean slope, no kept activations. */

/* Group g takes cells [g % per_leaf * cells, ...) of leaf first + g / per_leaf. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_density(LEAF_ARRAY(const float, params),       /* [row][PARAMS], row 0: leaf `own` */
            const __global float4 *restrict boxes, /* [leaf] min x, y, z, side */
            LEAF_ARRAY(ushort, density),           /* [leaf][n1^3] bfloat16 */
            uint n1, uint cells, uint per_leaf, uint jitter, uint2 seed, uint step, uint first,
            uint own)
{
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH];
    __local float at[AT_ROWS * NB];
    __local uint ids[NB];
    const uint group = get_group_id(0), leaf = first + group / per_leaf;
    const uint total = n1 * n1 * n1, begin = group % per_leaf * cells;
    const uint end = min(begin + cells, total);
    const __global float *w = LEAF_ROW(params, leaf - own, PARAMS);
    __global ushort *cached = LEAF_ROW(density, leaf, total);
    const float4 box = boxes[leaf];

    for (uint at_cell = begin; at_cell < end; at_cell += NB) {
        const block b = block_at(at_cell - begin, end - begin, ids, 0u);
        const ahead head = heads_ahead(w + SIGMA_W, b.first ? WIDTH + 16 : 0);

        GROUP_SYNC();
        for (int s = b.lid; s < b.rows; s += LS) {
            const uint cell = min(at_cell + (uint)s, total - 1u);
            float4 xi = (float4)(0.5f);

            if (jitter)
                xi = uniform4(seed, STREAM_GRID, step, leaf * total + cell, 0u);
            ids[s] = 0u;
            at[s] = 2.0f * (convert_float(cell % n1) + xi.x) / (float)n1 - 1.0f;
            at[NB + s] = 2.0f * (convert_float(cell / n1 % n1) + xi.y) / (float)n1 - 1.0f;
            at[2 * NB + s] = 2.0f * (convert_float(cell / (n1 * n1)) + xi.z) / (float)n1 - 1.0f;
        }
        GROUP_SYNC();
        encode_position(at, box, w, enc, b.rows, b.lid);
        GROUP_SYNC();
        const __local float *h = trunk_forward(b, w, enc, h0, h1, 0, head);

        head_forward(b, by_sample(h, WIDTH), w + SIGMA_W, w + SIGMA_B, 1, at);
        GROUP_SYNC();
        for (int s = b.lid * VW; s < b.rows; s += STEP_N)
            VSTORE(density_value(VLOAD(at + s)), at + s);
        GROUP_SYNC();
        for (int s = b.lid; s < b.count; s += LS)
            cached[at_cell + (uint)s] = bfloat16_nearest(at[s]);
    }
}
