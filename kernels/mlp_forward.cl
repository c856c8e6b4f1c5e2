/* needs: layer encoding_grid */
/* The forward pass of the leaf networks: samples to colours and densities (method.md 1, 8). A
 * work-group takes a slice, a run of samples in one leaf, NB at a time through all layers (layer.h)
 * while they are in cache.
 *
 *        samples of a leaf, grouped      work-group's local memory, NB samples
 *        |--- slice ---|--- slice -|     enc [ENC_PAD][NB]   h0, h1 [NB][WIDTH]
 *        |NB|NB|NB|rest|NB|NB|rest |     dir [DIR_PAD][NB]   v [NB][VIEW]
 *
 *   position -> encoding -> trunk -> h -> density head
 *                                    h, encoded direction -> view layer -> v -> colour head
 *   without view layer the colour head reads h
 *
 * Built twice: TRAIN 0 for evaluation, TRAIN 1 for training.
 *
 * Rules, here and in mlp_backward.cl: all work-items call functions with barriers; loop bounds
 * around a barrier depend on the slice only. */

/* Fetches what this processor's next slice, mostly the next group's, reads first. */
HELPER void fetch_samples(const __global cln_sample *samples, const __global uint *order, int count,
                          int lid)
{
#if FETCHES
    for (int s = lid; s < count; s += LS)
        FETCH(samples + order[s]);
#endif
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_forward(LEAF_ARRAY(const float, params),             /* [row][PARAMS], row 0: leaf first */
            const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
            const __global cln_slice *restrict slices,   /* [slice] */
            const __global uint *restrict order,         /* [grouped sample] -> sample */
            const __global cln_sample *restrict samples, /* [sample] */
            const __global float4 *restrict ray_o,       /* [ray] */
            const __global float4 *restrict ray_d,       /* [ray] */
            __global float4 *restrict out,               /* [sample] r, g, b, sigma */
            __global kept_type *restrict acts, /* [grouped sample][ACTS], in training */
            uint n_slices, uint step_key, int first)
{
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH], at[AT_ROWS * NB], raw[4 * NB];
    __local uint ids[NB];
#if VIEW > 0
    __local float dir[NB * DIR_PAD], v[NB * VIEW], along[3 * NB];
#else
    __local float along[4];
#endif
    const uint group = slice_of(slices, get_group_id(0), n_slices);

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group], after = slices[min(group + 1u, n_slices - 1u)];
    const float4 box = boxes[slice.slot];
    const __global float *w = LEAF_ROW(params, slice.slot - first, PARAMS);
    const __global float *w_after = LEAF_ROW(params, max(after.slot, first) - first, PARAMS);
    const sample_source source = {samples, ray_o, ray_d};

    for (uint done = 0; done < slice.count; done += NB) {
        const block b = block_at(done, slice.count, ids, step_key);
        const int count_after = b.last ? (int)min((uint)NB, after.count) : 0;
        __global kept_type *kept = acts + (size_t)(slice.start + done) * ACTS;

        GROUP_SYNC();
        for (int s = b.lid; s < b.rows; s += LS) /* past the count, the last one again */
            ids[s] = order[slice.start + done + (uint)min(s, b.count - 1)];
        load_samples(b, source, box, at, along);
        GROUP_SYNC();
        encode_position(at, box, w, enc, b.rows, b.lid);
#if VIEW > 0
        encode_direction(along, dir, b.rows, b.lid);
#endif
        GROUP_SYNC();
        fetch_all(AHEAD_RUN(order + after.start, count_after));

#if VIEW > 0
        const ahead view = weights_ahead(w + VIEW_W, b.first ? VIEW_ROWS + 1 : 0, VIEW);
        const __local float *h = trunk_forward(b, w, enc, h0, h1, kept, view);

        fetch_samples(samples, order + after.start, count_after, b.lid);
        if (b.first) {
            fetch_all(AHEAD_RUN(w + SIGMA_W, WIDTH + 16));
            fetch_all(AHEAD_RUN(w + COLOUR_W, GRID_W - COLOUR_W));
        }
        const layer l = {DEPTH, VIEW, w + VIEW_W};

        layer_forward(b, l, by_sample(h, WIDTH), by_row(dir, DIR_PAD), v, kept,
                      weights_ahead(w_after, b.last ? ENC_PAD + 1 : 0, WIDTH));
        GROUP_SYNC();
        head_forward(b, by_sample(v, VIEW), w + COLOUR_W, w + COLOUR_B, 3, raw);
#else
        const ahead heads = heads_ahead(w + SIGMA_W, b.first ? GRID_W - SIGMA_W : 0);
        const __local float *h = trunk_forward(b, w, enc, h0, h1, kept, heads);

        fetch_samples(samples, order + after.start, count_after, b.lid);
        head_forward(b, by_sample(h, WIDTH), w + COLOUR_W, w + COLOUR_B, 3, raw);
#endif
        head_forward(b, by_sample(h, WIDTH), w + SIGMA_W, w + SIGMA_B, 1, raw + 3 * NB);
#if TRAIN && NOISE_ON
        GROUP_SYNC();
        for (int s = b.lid; s < b.count; s += LS)
            raw[3 * NB + s] += NOISE * normal_number(step_key, ids[s]);
#endif
        GROUP_SYNC();
        for (int s = b.lid * VW; s < b.rows; s += STEP_N) {
            for (int k = 0; k < 3; k++)
                VSTORE(1.0f / (1.0f + EXP(-VLOAD(raw + k * NB + s))), raw + k * NB + s);
            VSTORE(density_value(VLOAD(raw + 3 * NB + s)), raw + 3 * NB + s);
        }
        GROUP_SYNC();
        for (int s = b.lid; s < b.count; s += LS)
            out[ids[s]] = (float4)(raw[s], raw[NB + s], raw[2 * NB + s], raw[3 * NB + s]);
    }
}
