/* needs: leaves adam */
/* Adam on the leaves that a batch touched, with gradients from memory: a leaf's is the sum of its
 * slices' gradients, in slice order. Leaves with fewer than min_samples samples stay as they are,
 * moments included. adam.h has the step itself. mlp_backward.cl updates leaves of one slice, if the
 * host wants that.
 *
 * Leaf first_leaf has row 0 of the arrays of weights, of `leaves` rows.
 *
 *   PART    parameters that a work-group updates, of EACH leaves one after another
 *   LS, VW  its work-items and lanes
 */
#ifndef PART
#define PART 1024
#define EACH 16
#endif

/* For touched leaves: steps += 1; norms = norm of the view layer's weights before the update. */
__kernel void adam_count(const __global uint *restrict begin, const __global uint *restrict end,
                         __global int *restrict steps, LEAF_ARRAY(const float, params),
                         __global float *restrict norms, uint leaves, uint min_samples, uint first)
{
    const uint row = get_global_id(0), leaf = first + row;

    if (row >= leaves || end[leaf] - begin[leaf] < min_samples)
        return;
    steps[row]++;
#if VIEW_L2
    float sum = 0.0f;

    for (uint i = 0; i < VIEW_ROWS * VIEW; i++) {
        const float w = LEAF_ROW(params, row, PARAMS)[VIEW_W + i];

        sum = MAD(w, w, sum);
    }
    norms[row] = sqrt(sum);
#endif
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
adam(const __global uint *restrict begin, const __global uint *restrict end, /* [leaf] */
     const __global uint *restrict slice_starts,                             /* [leaf + 1] */
     const __global cln_slice *restrict slices,                              /* [slice] */
     LEAF_ARRAY(const float, grads),                                         /* [place][PARAMS] */
     const __global int *restrict steps,                                     /* [row] */
     const __global float *restrict norms,                                   /* [row] */
     LEAF_ARRAY(float, params), LEAF_ARRAY(moment_type, m),
     LEAF_ARRAY(moment_type, v),    /* [row][PARAMS] */
     LEAF_ARRAY(float, transposed), /* [row][WT_PARAMS], if there is one */
     uint leaves, uint parts,
     uint min_samples, uint min_slices, /* leaves with fewer stay as they are */
     uint half_slice, /* 0: slice s' gradient at place s; else at its start / half_slice */
     float lr, uint first_leaf)
{
    const uint part = get_group_id(0) % parts, first_row = get_group_id(0) / parts * EACH;

    for (uint row = first_row; row < min(first_row + EACH, leaves); row++) {
        const uint leaf = first_leaf + row;
        const uint first = slice_starts[leaf], last = slice_starts[leaf + 1u];

        if (last - first < min_slices || end[leaf] - begin[leaf] < min_samples)
            continue;
        const adam_leaf a = adam_leaf_of(lr, steps[row], norms[row], leaf);
        __global float *w_row = LEAF_ROW(params, row, PARAMS);
        __global moment_type *m_row = LEAF_ROW(m, row, PARAMS), *v_row = LEAF_ROW(v, row, PARAMS);

        for (uint p = part * PART + get_local_id(0) * VW; p < min((part + 1u) * PART, (uint)PARAMS);
             p += LS * VW) {
            vf g = (vf)(0.0f);

            for (uint s = first; s < last; s++) {
                const uint place = half_slice ? slices[s].start / half_slice : s;
                const vf more = VLOAD(SLICE_ROW(grads, place, PARAMS) + p);

                g = s == first ? more : g + more;
            }
            if (adam_spares(g, p))
                continue;
            const vf w = adam_step(a, g, p, w_row, m_row, v_row);

#if LEAF
            (void)w;
#else
            store_all_transposed(w, p, LEAF_ROW(transposed, row, WT_PARAMS));
#endif
        }
    }
}

/* Makes the transposed copy of freshly uploaded weights. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
transpose(LEAF_ARRAY(const float, params), LEAF_ARRAY(float, transposed), uint parts)
{
    const uint leaf = get_group_id(0) / parts, part = get_group_id(0) % parts;

    for (uint p = part * PART + get_local_id(0) * VW; p < min((part + 1u) * PART, (uint)PARAMS);
         p += LS * VW)
        store_all_transposed(VLOAD(LEAF_ROW(params, leaf, PARAMS) + p), p,
                             LEAF_ROW(transposed, leaf, WT_PARAMS));
}
