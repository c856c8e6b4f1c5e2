/* Adam on the leaves that a batch touched (method.md 11; twin: host/reference/adam.c), and the
 * transposed weights that mlp.cl's input gradient reads. A leaf's gradient is the sum of its slices'
 * buffers, in slice order. Leaves with fewer than min_samples samples are left alone, moments included.
 * Bias correction counts the updates of the leaf itself, since leaves are born during training.
 *
 * WIDTH DEPTH VIEW PARAMS TRUNK_W(i) VIEW_W   the network's layout (mlp.cl)
 * PART   parameters one work-group updates;  LS, VW: its work-items and lanes
 * VIEW_L2 0 | 1   regulariser: the norm of the view layer's weights
 */
#ifndef WIDTH
#define LS 1
#define WIDTH 16
#define DEPTH 2
#define VIEW 16
#define PARAMS 1104
#define TRUNK_W(i) ((i) == 0 ? 0 : 272)
#define VIEW_W 576
#define VIEW_ROWS 28
#define PART 1024
#define VIEW_L2 1
#endif

#define WT_TRUNK(i) (((i) - 1) * WIDTH * WIDTH)
#define WT_VIEW ((DEPTH - 1) * WIDTH * WIDTH)
#define WT_PARAMS ((DEPTH - 1) * WIDTH * WIDTH + VIEW * WIDTH)

/* steps[leaf] += 1 for touched leaves; norms[leaf]: of the view layer's weights, before the update. */
__kernel void adam_count(const __global uint *restrict begin, const __global uint *restrict end,
                         __global int *restrict steps, const __global float *restrict params,
                         __global float *restrict norms, uint leaves, uint min_samples)
{
    const uint leaf = get_global_id(0);

    if (leaf >= leaves || end[leaf] - begin[leaf] < min_samples)
        return;
    steps[leaf]++;
#if VIEW_L2
    float sum = 0.0f;

    for (uint i = 0; i < VIEW_ROWS * VIEW; i++) {
        const float w = params[(size_t)leaf * PARAMS + VIEW_W + i];

        sum = MAD(w, w, sum);
    }
    norms[leaf] = sqrt(sum);
#endif
}

/* Where row-major weights [rows WIDTH][columns] at `offset` hold parameter p: also store them
 * transposed. p and its VW - 1 successors stand in one row. */
HELPER void store_transposed(vf value, uint p, uint offset, uint columns, __global float *wt)
{
    const uint q = p - offset;

    if (p < offset || q >= WIDTH * columns)
        return;
    const uint k = q / columns, n = q % columns;
    float lanes[VW];

    VSTORE(value, lanes);
    for (uint j = 0; j < VW; j++)
        wt[(n + j) * WIDTH + k] = lanes[j];
}

HELPER void store_all_transposed(vf value, uint p, __global float *wt)
{
    for (int i = 1; i < DEPTH; i++)
        store_transposed(value, p, TRUNK_W(i), WIDTH, wt + WT_TRUNK(i));
#if VIEW > 0
    store_transposed(value, p, VIEW_W, VIEW, wt + WT_VIEW);
#endif
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
adam(const __global uint *restrict begin, const __global uint *restrict end, /* [leaf] */
     const __global uint *restrict slice_starts,                             /* [leaf + 1] */
     const __global float *restrict grads,                                   /* [slice][PARAMS] */
     const __global int *restrict steps,                                     /* [leaf] */
     const __global float *restrict norms,                                   /* [leaf] */
     __global float *restrict params, __global float *restrict m, __global float *restrict v,
     __global float *restrict transposed, /* [leaf][WT_PARAMS] */
     uint parts, uint min_samples, float lr, float beta1, float beta2, float epsilon, float view_l2,
     float decay1, float decay2) /* -log(beta) */
{
    const uint leaf = get_group_id(0) / parts, part = get_group_id(0) % parts;
    const size_t base = (size_t)leaf * PARAMS;
    const uint first = slice_starts[leaf], last = slice_starts[leaf + 1u];

    if (end[leaf] - begin[leaf] < min_samples)
        return;
    const float t = (float)steps[leaf];
    const float rate = lr / ONE_MINUS_EXP(float, t * decay1);
    const float second = 1.0f / ONE_MINUS_EXP(float, t * decay2);
    __global float *wt = transposed + (size_t)leaf * WT_PARAMS;

    for (uint p = part * PART + get_local_id(0) * VW; p < min((part + 1u) * PART, (uint)PARAMS);
         p += LS * VW) {
        vf g = VLOAD(grads + (size_t)first * PARAMS + p);

        for (uint s = first + 1u; s < last; s++)
            g += VLOAD(grads + (size_t)s * PARAMS + p);
        vf w = VLOAD(params + base + p);
#if VIEW_L2
        if (p >= VIEW_W && p < VIEW_W + VIEW_ROWS * VIEW)
            g += w * (view_l2 / fmax(norms[leaf], 1e-12f));
#endif
        const vf m1 = MAD((vf)(beta1), VLOAD(m + base + p), (1.0f - beta1) * g);
        const vf v1 = MAD((vf)(beta2), VLOAD(v + base + p), (1.0f - beta2) * g * g);

        w -= rate * m1 / (sqrt(v1 * second) + epsilon);
        VSTORE(m1, m + base + p);
        VSTORE(v1, v + base + p);
        VSTORE(w, params + base + p);
        store_all_transposed(w, p, wt);
    }
}

/* The transposed copy of freshly uploaded weights. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
transpose(const __global float *restrict params, __global float *restrict transposed, uint parts)
{
    const uint leaf = get_group_id(0) / parts, part = get_group_id(0) % parts;

    for (uint p = part * PART + get_local_id(0) * VW; p < min((part + 1u) * PART, (uint)PARAMS);
         p += LS * VW)
        store_all_transposed(VLOAD(params + (size_t)leaf * PARAMS + p), p,
                             transposed + (size_t)leaf * WT_PARAMS);
}
