/* needs: network fetch bfloat16 */
/* A step of Adam on VW neighbouring weights (method.md 11; twin: host/reference/adam.c), and the
 * transposed copy of the weights that input gradients read. For adam.cl, and for mlp_backward.cl
 * where it has a leaf's whole gradient. Bias correction counts the leaf's own updates, as leaves
 * appear during training.
 *
 *   BETA1 BETA2 EPSILON   Adam's;  DECAY1 DECAY2: -log of the betas
 *   VIEW_L2 0 | 1, VIEW_L2_WEIGHT   regulariser: the norm of the view layer's weights
 *   MOMENTS 0 | 1   both moments are float | bfloat16 (Adam is bound by memory)
 */
#ifndef BETA1
#define BETA1 0.9f
#define BETA2 0.99f
#define EPSILON 1e-10f
#define DECAY1 0.105360516f
#define DECAY2 0.0100503359f
#define VIEW_L2 1
#define VIEW_L2_WEIGHT 0.1f
#define MOMENTS 1
#endif

/* Common to all weights of a leaf. */
typedef struct adam_leaf {
    float rate, second; /* learning rate over the first moment's correction; 1 over the second's */
    float pull;         /* gradient of the view layer's norm over the weight */
    uint key;           /* of the random numbers that round moments */
} adam_leaf;

/* steps: updates of the leaf, this one included; norm: of the view layer's weights. */
HELPER adam_leaf adam_leaf_of(float lr, int steps, float norm, uint slot)
{
    const float t = (float)steps;
    adam_leaf a;

    a.rate = lr / ONE_MINUS_EXP(float, t * DECAY1);
    a.second = 1.0f / ONE_MINUS_EXP(float, t * DECAY2);
#if VIEW_L2
    a.pull = VIEW_L2_WEIGHT / fmax(norm, 1e-12f);
#else
    a.pull = norm * 0.0f;
#endif
    a.key = (uint)steps * 0x85EBCA6Bu + slot * 0xC2B2AE35u;
    return a;
}

/* Moments in memory. chance: 16 random bits. With rounding to the nearest bfloat16, a second moment
 * would never change by steps below half a unit in its 8 bits; stochastic rounding is right on
 * average. */
#if MOMENTS
#define moment_type ushort

HELPER vf moment_load(const __global moment_type *p)
{
    return bfloat16_values(VLOAD(p));
}

HELPER void moment_store(vf value, vu chance, __global moment_type *p)
{
    VSTORE_H(__global, bfloat16_by_chance(value, chance), p);
}
#else
#define moment_type float

HELPER vf moment_load(const __global moment_type *p)
{
    return VLOAD(p);
}

HELPER void moment_store(vf value, vu chance, __global moment_type *p)
{
    (void)chance;
    VSTORE_IN(__global, value, p);
}
#endif

/* Bytes by which moments and weights are fetched ahead: hardware prefetching stops at the end of a
 * 4 KiB page. Beyond a row's end is the next leaf's row, or nothing. */
#define MOMENTS_AHEAD 2048
#define WEIGHTS_AHEAD 1024

/* Whether to skip an update: vertices of a grid without a sample of the batch nearby keep weights
 * and moments. In most steps these are most vertices. */
HELPER bool adam_spares(vf g, uint p)
{
    return p >= GRID_W && !V_ANY(g != 0.0f);
}

/* Updates weights p .. p + VW - 1 of a leaf, given their gradient g and the leaf's rows; returns
 * the new weights, computed from the moments before rounding. */
HELPER vf adam_step(adam_leaf a, vf g, uint p, __global float *params, __global moment_type *m,
                    __global moment_type *v)
{
    vf w = VLOAD(params + p);

    FETCH_STREAM(params, p, WEIGHTS_AHEAD);
    FETCH_STREAM(m, p, MOMENTS_AHEAD);
    FETCH_STREAM(v, p, MOMENTS_AHEAD);
#if VIEW_L2
    if (p >= VIEW_W && p < VIEW_W + VIEW_ROWS * VIEW)
        g += w * a.pull;
#endif
    const vf m1 = MAD((vf)(BETA1), moment_load(m + p), (1.0f - BETA1) * g);
    const vf v1 = MAD((vf)(BETA2), moment_load(v + p), (1.0f - BETA2) * g * g);
    const vu chance = hash_lanes((p + V_IOTA) * 0x9E3779B9u ^ a.key);

    w -= a.rate * m1 / (sqrt(v1 * a.second) + EPSILON);
    moment_store(m1, chance & 0xFFFFu, m + p);
    moment_store(v1, chance >> 16, v + p);
    VSTORE_IN(__global, w, params + p);
    return w;
}

/* If parameter p is in the row-major weights [WIDTH][columns] at `offset`, also stores it
 * transposed. p and its VW - 1 successors are in one row. */
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

HELPER void store_all_transposed(vf value, uint p, __global float *wt /* [WT_PARAMS] */)
{
    for (int i = 1; i < DEPTH; i++)
        store_transposed(value, p, TRUNK_W(i), WIDTH, wt + WT_TRUNK(i));
#if VIEW > 0
    store_transposed(value, p, VIEW_W, VIEW, wt + WT_VIEW);
#endif
}
