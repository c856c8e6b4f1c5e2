/* needs: layer adam encoding_grid */
/* The backward pass of the leaf networks: from gradients of the heads' raw outputs (roulette.cl) to
 * gradients of the weights, and for leaves of one slice to new weights (method.md 1, 8, 11). A
 * work-group takes the samples of a slice that roulette.cl chose, NB at a time, from the heads down
 * through the layers (layer.h); the slice's gradient is the sum over them.
 *
 * Most leaves have one slice: its gradient is the leaf's, and its work-group takes Adam's step at
 * once (adam.h). Gradients of slices that share a leaf go to buffers, and adam.cl adds them in
 * order, without atomics.
 *
 * TRAIN is 1. Rules: mlp_forward.cl. */

#if LEAF
/* wt[n][k] = w[k][n] of a layer, k < WIDTH: VW x VW at a time. log2(VW) perfect shuffles of the
 * rows make the transpose. */
HELPER void transpose_layer(const __global float *w, int columns, __local float *wt, int lid)
{
    const int across = columns / VW;

    for (int tile = lid; tile < WIDTH / VW * across; tile += LS) {
        const int k = tile / across * VW, n = tile % across * VW;
        vf row[VW];

        UNROLL (i, VW)
            row[i] = VLOAD(w + (k + i) * columns + n);
#if VW > 1
#pragma unroll
        for (int round = 1; round < VW; round *= 2) {
            vf next[VW];

            UNROLL (i, VW / 2) {
                next[2 * i] = V_ZIP_LO(row[i], row[i + VW / 2]);
                next[2 * i + 1] = V_ZIP_HI(row[i], row[i + VW / 2]);
            }
            UNROLL (i, VW)
                row[i] = next[i];
        }
#endif
        UNROLL (i, VW)
            VSTORE_IN(__local, row[i], wt + (n + i) * WIDTH + k);
    }
}
#endif

/* update 0: the gradient of every slice goes to grads [slice][PARAMS]. update 1: leaves with fewer
 * than min_samples samples stay as they are; of the others, leaves of one slice are updated, and
 * the rest write their gradients: LEAF 0 as above, LEAF 1 to grads [slice start /
 * half_slice][PARAMS], as starts of slices that share a leaf are at least half_slice apart
 * (group.cl). Leaf `first` has row 0 of the arrays of weights. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_backward(LEAF_ARRAY(float, params),                   /* [row][PARAMS] */
             LEAF_ARRAY(float, transposed),               /* [row][WT_PARAMS], LEAF 0 */
             const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
             const __global cln_slice *restrict slices,   /* [slice] */
             const __global uint *restrict order,         /* [grouped sample] -> sample */
             const __global cln_sample *restrict samples, /* [sample] */
             const __global float4 *restrict ray_o,       /* [ray] */
             const __global float4 *restrict ray_d,       /* [ray] */
             const __global float4 *restrict heads,       /* [grouped sample], roulette.cl's */
             const __global uint *restrict chosen,        /* [grouped sample] of each slice */
             const __global uint *restrict chosen_counts, /* [slice] */
             const __global kept_type *restrict acts,     /* [grouped sample][ACTS] */
             LEAF_ARRAY(float, grads), uint n_slices, uint step_key, uint update, uint half_slice,
             uint min_samples, float lr, const __global uint *restrict begin,
             const __global uint *restrict end,   /* [leaf] */
             const __global int *restrict steps,  /* [row] */
             const __global float *restrict norms, /* [row] */
             LEAF_ARRAY(moment_type, moment1), /* [row][PARAMS], both */
             LEAF_ARRAY(moment_type, moment2), int first)
{
    __local float enc[NB * ENC_PAD], h[NB * WIDTH], d0[NB * WIDTH], d1[NB * WIDTH];
    __local float at[AT_ROWS * NB];
    __local float4 dhead[NB];
    __local uint ids[NB];
    __local int places[NB], places_after[FETCHES ? NB : 1];
#if VIEW > 0
    __local float dir[NB * DIR_PAD], v[NB * VIEW], dv[NB * VIEW], along[3 * NB];
#else
    __local float along[4];
#endif
#if LEAF
    __local float grad[PARAMS], wt[WT_PARAMS];
#endif
    const uint group = slice_of(slices, get_group_id(0), n_slices);
    const int lid = (int)get_local_id(0);

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group];
    const uint whole = end[slice.slot] - begin[slice.slot];
    const int at_row = slice.slot - first;

    if (slice.count == 0u || (update && whole < min_samples))
        return;
    const __global float *w = LEAF_ROW(params, at_row, PARAMS);
#if LEAF
    for (int i = 1; i < DEPTH; i++)
        transpose_layer(w + TRUNK_W(i), WIDTH, wt + WT_TRUNK(i), lid);
#if VIEW > 0
    transpose_layer(w + VIEW_W, VIEW, wt + WT_VIEW, lid);
#endif
#else
    __global float *wt = LEAF_ROW(transposed, at_row, WT_PARAMS);
    __global float *grad = SLICE_ROW(grads, group, PARAMS);
#endif

    /* the next group's slice is mostly this processor's next one */
    const uint group_after = min(group + 1u, n_slices - 1u);
    const cln_slice after = slices[group_after];
    const int count_after = (int)min((uint)NB, chosen_counts[group_after]);
    const __global float *w_after = LEAF_ROW(params, max(after.slot, first) - first, PARAMS);
    const kept_block kept_after = {acts + (size_t)after.start * ACTS, places_after};

    const uint all = chosen_counts[group];
    const float4 box = boxes[slice.slot];
    const sample_source source = {samples, ray_o, ray_d};
    const kept_block kept = {acts + (size_t)slice.start * ACTS, places};

#if ENCODING == 1
    encode_position_begin(grad, lid);
    LEAF_SYNC();
#endif
    for (uint done = 0; done < all; done += NB) {
        const block b = block_at(done, all, ids, step_key);

        GROUP_SYNC();
        for (int s = lid; s < b.rows; s += LS) { /* past the count, the last one again */
            const uint row = chosen[slice.start + done + (uint)min(s, b.count - 1)];

            ids[s] = order[slice.start + row];
            places[s] = (int)row * ACTS;
            dhead[s] = s < b.count ? heads[slice.start + done + (uint)s] : (float4)(0.0f);
        }
#if FETCHES
        for (int s = lid; b.last && s < count_after; s += LS) {
            const uint row = chosen[after.start + (uint)s];

            places_after[s] = (int)row * ACTS;
            FETCH(samples + order[after.start + row]);
        }
#endif
        load_samples(b, source, box, at, along);
        GROUP_SYNC();
        encode_position(at, box, w, enc, b.rows, lid);
        restore(b, kept, DEPTH - 1, WIDTH, h);
#if VIEW > 0
        encode_direction(along, dir, b.rows, lid);
        restore(b, kept, DEPTH, VIEW, v);
#endif
        GROUP_SYNC();

        /* heads and view layer; d0: gradient of the trunk's last pre-activations */
        head_bias_gradient(b, dhead, 0, 3, grad + COLOUR_B);
        head_bias_gradient(b, dhead, 3, 1, grad + SIGMA_B);
        GROUP_SYNC(); /* only for PoCL 3.1, which loses the stores of biases without it */
        head_weight_gradient(b, by_sample(h, WIDTH), dhead, 3, 1, grad + SIGMA_W);
#if VIEW > 0
        head_weight_gradient(b, by_sample(v, VIEW), dhead, 0, 3, grad + COLOUR_W);
        head_input_gradient(b, kept, DEPTH, VIEW, dhead, w + COLOUR_W, 0, dv);
        GROUP_SYNC();
        layer_weight_gradient(b, by_sample(h, WIDTH), dv, VIEW, grad + VIEW_W, grad + VIEW_B,
                              kept_ahead(kept, DEPTH - 2, b.count, WIDTH),
                              AHEAD_RUN(w_after + VIEW_W, b.last ? WIDTH * VIEW : 0));
        layer_weight_gradient(b, by_row(dir, DIR_PAD), dv, VIEW, grad + VIEW_W + WIDTH * VIEW, 0,
                              AHEAD_NOTHING, AHEAD_NOTHING);
        layer_input_gradient(b, kept, DEPTH - 1, dv, VIEW, wt + WT_VIEW, dhead, w + SIGMA_W, d0);
#else
        head_weight_gradient(b, by_sample(h, WIDTH), dhead, 0, 3, grad + COLOUR_W);
        head_input_gradient(b, kept, DEPTH - 1, WIDTH, dhead, w + COLOUR_W, w + SIGMA_W, d0);
#endif

        /* the trunk, from its last layer to its second; d: gradient of layer i, below: of layer
         * i - 1 */
        for (int i = DEPTH - 1; i > 0; i--) {
            __local float *d = (DEPTH - 1 - i) & 1 ? d1 : d0;
            __local float *below = (DEPTH - 1 - i) & 1 ? d0 : d1;

            GROUP_SYNC();
            restore(b, kept, i - 1, WIDTH, h);
            GROUP_SYNC();
            layer_weight_gradient(b, by_sample(h, WIDTH), d, WIDTH, grad + TRUNK_W(i),
                                  grad + TRUNK_B(i),
                                  kept_ahead(kept, i - 2, i > 1 ? b.count : 0, WIDTH),
                                  AHEAD_RUN(w_after + TRUNK_W(i), b.last ? WIDTH * WIDTH : 0));
            if (i == SKIP)
                layer_weight_gradient(b, by_encoding(enc, ENC_PAD), d, WIDTH,
                                      grad + TRUNK_W(i) + WIDTH * WIDTH, 0, AHEAD_NOTHING,
                                      AHEAD_NOTHING);
            layer_input_gradient(b, kept, i - 1, d, WIDTH, wt + WT_TRUNK(i), dhead, 0, below);
        }
        GROUP_SYNC();

        /* the first layer, and below it an encoding with parameters */
        layer_weight_gradient(b, by_encoding(enc, ENC_PAD), (DEPTH - 1) & 1 ? d1 : d0, WIDTH,
                              grad + TRUNK_W(0), grad + TRUNK_B(0),
                              kept_ahead(kept_after, DEPTH - 1, b.last ? count_after : 0,
                                         WIDTH + VIEW),
                              AHEAD_RUN(w_after, b.last ? ENC_PAD * WIDTH : 0));
#if ENCODING == 1
        GROUP_SYNC(); /* enc becomes scratch */
        encode_position_back(b, at, (DEPTH - 1) & 1 ? d1 : d0, w + TRUNK_W(0), enc, grad);
#endif
    }
    LEAF_SYNC();

    /* this is the leaf's whole gradient: take Adam's step */
    if (update && slice.count == whole) {
        const adam_leaf a = adam_leaf_of(lr, steps[at_row], norms[at_row], slice.slot);
        __global float *w_row = LEAF_ROW(params, at_row, PARAMS);
        __global moment_type *m_row = LEAF_ROW(moment1, at_row, PARAMS);
        __global moment_type *v_row = LEAF_ROW(moment2, at_row, PARAMS);

        for (uint p = (uint)lid * VW; p < PARAMS; p += STEP_N) {
            const vf g = VLOAD(grad + p);

            if (adam_spares(g, p))
                continue;
            const vf updated = adam_step(a, g, p, w_row, m_row, v_row);

#if LEAF
            (void)updated;
#else
            store_all_transposed(updated, p, wt);
#endif
        }
        return;
    }
#if LEAF
    __global float *to = SLICE_ROW(grads, update ? slice.start / half_slice : group, PARAMS);

    for (uint p = (uint)lid * VW; p < PARAMS; p += STEP_N)
        VSTORE_IN(__global, VLOAD(grad + p), to + p);
#endif
}
