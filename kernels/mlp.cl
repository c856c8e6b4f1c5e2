/* The leaf networks, batched over leaves: densities on the stage-1 grid, forward, backward with weight
 * gradients (method.md 1, 4, 8; layout: host/model/network.h; float64 twin: host/reference/network.c).
 *
 *   layer:      out[s][n] = act(b[n] + sum_k in[s][k] w[k][n])
 *   input grad: din[s][k] = sum_n d[s][n] w[k][n]      with a transposed copy wt[n][k]
 *   weight grad: dw[k][n] = sum_s in[s][k] d[s][n]
 *
 * All three are one micro-kernel with lanes over the contiguous index: T x NV vectors of accumulators in
 * registers, one vector load of B and T broadcasts of A per step. One work-group takes a slice: a run
 * of samples that lie in the same leaf, NB at a time, all layers while they are in cache. A slice's
 * weight gradient goes to its own buffer; adam.cl adds the slices of a leaf in order (no atomics).
 *
 *        samples of a leaf, grouped      work-group's local memory, NB samples
 *        |--- slice ---|--- slice -|     enc [ENC_PAD][NB]   h [NB][WIDTH]   d [NB][WIDTH]
 *        |NB|NB|NB|rest|NB|NB|rest |     dir [DIR_PAD][NB]   v [NB][VIEW]
 *
 * Encodings stand row by row, so that lanes run over samples where they are made; the micro-kernel reads
 * them with other strides.
 *
 * Parameters, from the host (engine/programs.c); the defaults below let the file compile alone.
 *   VW NV LS TS NB   lanes.h; vectors per tile; work-items; samples per tile; samples in local memory
 *   WIDTH DEPTH BANDS ENC_PAD SKIP   trunk; SKIP = layer that reads the encoding again, or -1
 *   VIEW VIEW_BANDS DIR_PAD          view layer; VIEW 0 = none
 *   COLOUR                           inputs of the colour head: VIEW, or WIDTH without view layer
 *   TRUNK_W(i) TRUNK_B(i) SIGMA_W SIGMA_B VIEW_W VIEW_B COLOUR_W COLOUR_B PARAMS   offsets, floats
 *   DENSITY 0 softplus | 1 relu | 2 exp;  KAPPA BIAS: sigma = KAPPA f(s + BIAS)
 *   SLOPE_LOWER SLOPE_UPPER, RRELU 0 element | 1 neuron | 2 mean;  BANDS_BY_LEVEL 0 | 1
 *   NOISE_ON 0 | 1, NOISE   density noise in training: left out or not; its std
 *   HALF 0 | 1   pre-activations are kept for the way back as 32 or as 16 bits
 *
 * Rules: barriers only at a kernel's top level (helpers are called by all work-items, no barrier in
 * them); loop bounds around a barrier depend on the slice alone; rows past a block's count hold
 * garbage that never leaves its own row. */
#ifndef WIDTH
#define NV 1
#define LS 1
#define TS 4
#define NB 16
#define WIDTH 16
#define DEPTH 2
#define BANDS 2
#define ENC_PAD 16
#define SKIP (-1)
#define VIEW 16
#define VIEW_BANDS 1
#define DIR_PAD 12
#define COLOUR 16
#define TRUNK_W(i) ((i) == 0 ? 0 : 272)
#define TRUNK_B(i) ((i) == 0 ? 256 : 528)
#define SIGMA_W 544
#define SIGMA_B 560
#define VIEW_W 576
#define VIEW_B 1024
#define COLOUR_W 1040
#define COLOUR_B 1088
#define PARAMS 1104
#define DENSITY 0
#define KAPPA 10.0f
#define BIAS (-2.97f)
#define SLOPE_LOWER (-0.3f)
#define SLOPE_UPPER (-0.1f)
#define RRELU 0
#define BANDS_BY_LEVEL 0
#define NOISE_ON 1
#define NOISE 1.0f
#define HALF 0
#endif

#define TK 4                       /* rows of a weight-gradient tile; every K is a multiple of it */
#define STEP_N (LS * VW)           /* distance of a work-item's vectors */
#define TILE_N (LS * VW * NV)      /* neurons of one tile, over the group */
#define ACTS (DEPTH * WIDTH + VIEW) /* pre-activations kept per sample: [trunk layers | view] */
#define WT_TRUNK(i) (((i) - 1) * WIDTH * WIDTH)
#define WT_VIEW ((DEPTH - 1) * WIDTH * WIDTH)
#define WT_PARAMS ((DEPTH - 1) * WIDTH * WIDTH + VIEW * WIDTH)
#define SLOPE_MEAN (0.5f * (SLOPE_LOWER + SLOPE_UPPER))

#if WIDTH % (VW * NV * LS) || (VIEW > 0 && VIEW % (VW * NV * LS))
#error "VW * NV * LS must divide WIDTH and VIEW"
#endif
#if NB % TS || NB % VW
#error "TS and VW must divide NB"
#endif

/* Kept pre-activations in memory: OpenCL 1.2 loads and stores halves without any half arithmetic. */
#if HALF
#define kept_type half
#if VW == 1
#define KEPT_LOAD(p)     vload_half(0, p)
#define KEPT_STORE(v, p) vstore_half(v, 0, p)
#else
#define KEPT_LOAD(p)     CLN_PASTE(vload_half, VW)(0, p)
#define KEPT_STORE(v, p) CLN_PASTE(vstore_half, VW)(v, 0, p)
#endif
#else
#define kept_type        float
#define KEPT_LOAD(p)     VLOAD(p)
#define KEPT_STORE(v, p) VSTORE(v, p)
#endif

/* Rows of a block that are worked on: the count, up to whole tiles and whole vectors. */
#define PADDED(count) (((((count) + TS - 1) / TS * TS) + VW - 1) / VW * VW)

#if LS > 1
#define GROUP_SYNC() barrier(CLK_LOCAL_MEM_FENCE)
#else
#define GROUP_SYNC()
#endif

/* acc[i][j] += sum over r < R of a[i * ai + r * ar] * B[r * ldb + j vectors]. */
#define TILE_MAD(T, a, ai, ar, B, ldb, R)                                                          \
    for (int r_ = 0; r_ < (R); r_++) {                                                             \
        vf b_[NV];                                                                                 \
        _Pragma("unroll") for (int j_ = 0; j_ < NV; j_++) b_[j_] =                                 \
            VLOAD((B) + r_ * (ldb) + j_ * STEP_N);                                                 \
        _Pragma("unroll") for (int i_ = 0; i_ < (T); i_++)                                         \
        {                                                                                          \
            const vf a_ = (vf)((a)[i_ * (ai) + r_ * (ar)]);                                        \
            _Pragma("unroll") for (int j_ = 0; j_ < NV; j_++) acc[i_][j_] =                        \
                MAD(a_, b_[j_], acc[i_][j_]);                                                      \
        }                                                                                          \
    }

/* ---- activations and encodings ---- */

HELPER vf negative_slope(int train, uint key, int neuron)
{
#if RRELU == 2
    return (vf)(SLOPE_MEAN);
#else
    if (!train)
        return (vf)(SLOPE_MEAN);
    return MAD(uniform_lanes(key, (uint)neuron), (vf)(SLOPE_UPPER - SLOPE_LOWER),
               (vf)(SLOPE_LOWER));
#endif
}

/* Key of the slopes of one layer: of this sample (element) or of all samples of the step (neuron). */
HELPER uint slope_key(uint step_key, uint sample, uint layer)
{
#if RRELU == 0
    return (step_key + sample * 0x85EBCA6Bu) ^ (layer * 0xC2B2AE35u + 0x165667B1u);
#else
    return step_key ^ (layer * 0xC2B2AE35u + 0x165667B1u);
#endif
}

HELPER vf activate(vf x, vf slope)
{
    return select(x * slope, x, x > (vf)(0.0f));
}

HELPER vf activate_gradient(vf x, vf slope)
{
    return select(slope, (vf)(1.0f), x > (vf)(0.0f));
}

/* sin and cos of |x| <= 1, to 2e-7: Taylor to x^11 and x^12. */
HELPER vf sin_unit(vf x)
{
    const vf q = x * x;
    vf p = MAD(q, (vf)(-2.5052108e-8f), (vf)(2.7557319e-6f));

    p = MAD(p, q, (vf)(-1.9841270e-4f));
    p = MAD(p, q, (vf)(8.3333333e-3f));
    p = MAD(p, q, (vf)(-1.6666667e-1f));
    return MAD(p * q, x, x);
}

HELPER vf cos_unit(vf x)
{
    const vf q = x * x;
    vf p = MAD(q, (vf)(2.0876757e-9f), (vf)(-2.7557319e-7f));

    p = MAD(p, q, (vf)(2.4801587e-5f));
    p = MAD(p, q, (vf)(-1.3888889e-3f));
    p = MAD(p, q, (vf)(4.1666667e-2f));
    p = MAD(p, q, (vf)(-0.5f));
    return MAD(p, q, (vf)(1.0f));
}

/* gamma(x) of the first `rows` samples: x [3][NB] -> out [pad][NB]; rows 0..2 x, 3 + 6k + a sin,
 * 6 + 6k + a cos of 2^k x_a, the rest zero. Bands double the angle of the one before; every sixth starts
 * afresh, so that rounding does not grow past 2^5 ulp. */
HELPER void encode(const __local float *x, int bands, int level, __local float *out, int pad, int rows,
                   int lid)
{
    (void)level;
    for (int s = lid * VW; s < rows; s += STEP_N) {
#pragma unroll
        for (int a = 0; a < 3; a++) {
            const vf value = VLOAD(x + a * NB + s);
            vf sine = sin_unit(value), cosine = cos_unit(value);

            VSTORE(value, out + a * NB + s);
#pragma unroll
            for (int k = 0; k < bands; k++) {
                if (k > 0 && k % 6 == 0) {
                    sine = SIN(value * (float)(1 << k));
                    cosine = COS(value * (float)(1 << k));
                } else if (k > 0) {
                    const vf twice = 2.0f * sine;

                    sine = twice * cosine;
                    cosine = MAD(twice * -0.5f, twice, (vf)(1.0f));
                }
#if BANDS_BY_LEVEL
                const float weight = clamp((float)(11 - level - k), 0.0f, 1.0f);
#else
                const float weight = 1.0f;
#endif
                VSTORE(sine * weight, out + (3 + 6 * k + a) * NB + s);
                VSTORE(cosine * weight, out + (6 + 6 * k + a) * NB + s);
            }
        }
        for (int row = 3 + 6 * bands; row < pad; row++)
            VSTORE((vf)(0.0f), out + row * NB + s);
    }
}

/* select keeps a NaN visible where fmax and fmin would hide it. */
HELPER vf density_value(vf z)
{
    z += BIAS;
#if DENSITY == 0
    const vf e = EXP(-fabs(z)); /* log(1 + e), as a series where the sum would round e away */
    const vf series =
        e * MAD(e, MAD(e, MAD(e, MAD(e, (vf)(0.2f), (vf)(-0.25f)), (vf)(0.33333333f)), (vf)(-0.5f)),
                (vf)(1.0f));

    return KAPPA * (select((vf)(0.0f), z, !(z <= 0.0f)) + select(LOG(1.0f + e), series, e < 0.06f));
#elif DENSITY == 1
    return KAPPA * select((vf)(0.0f), z, !(z <= 0.0f));
#else
    return KAPPA * EXP(select(z, (vf)(80.0f), z > 80.0f));
#endif
}

/* d sigma / d s from sigma itself. */
HELPER vf density_gradient(vf sigma)
{
#if DENSITY == 0
    const vf x = sigma * (1.0f / KAPPA);

    return KAPPA * ONE_MINUS_EXP(vf, x);
#elif DENSITY == 1
    return select((vf)(0.0f), (vf)(KAPPA), sigma > 0.0f);
#else
    return fmin(sigma, KAPPA * 3269017.4f); /* exp(15), as in nerfacc and instant-ngp */
#endif
}

/* ---- one layer forward: in, then in2 (an encoding) -> pre-activations to acts (if kept), activations to
 * out. Element (s, k) of in stands at s * in_s + k * in_k. ---- */

HELPER void dense(const __local float *in, int in_rows, int in_s, int in_k, const __local float *in2,
                  int in2_rows, const __global float *w,
                  const __global float *bias, int n_out, __local float *out, int tiles, int count,
                  __global kept_type *acts, int train, uint step_key, const __local uint *ids, uint layer,
                  int lid)
{
    for (int n = lid * VW; n < n_out; n += TILE_N) {
        for (int t = 0; t < tiles; t++) {
            vf acc[TS][NV];

#pragma unroll
            for (int i = 0; i < TS; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    acc[i][j] = VLOAD(bias + n + j * STEP_N);
            TILE_MAD(TS, in + t * TS * in_s, in_s, in_k, w + n, n_out, in_rows)
            if (in2_rows > 0)
                TILE_MAD(TS, in2 + t * TS, 1, NB, w + in_rows * n_out + n, n_out, in2_rows)
#pragma unroll
            for (int i = 0; i < TS; i++) {
                const int s = t * TS + i;
                const uint key = slope_key(step_key, ids[s], layer);

#pragma unroll
                for (int j = 0; j < NV; j++) {
                    const int m = n + j * STEP_N;

                    if (train && s < count)
                        KEPT_STORE(acc[i][j], acts + s * ACTS + m);
                    VSTORE(activate(acc[i][j], negative_slope(train, key, m)),
                           out + s * n_out + m);
                }
            }
        }
    }
}

/* Rows of a head: raw[r][s] = bias[r] + sum_k a[s][k] w[r][k], r < rows <= 3; four samples together, so
 * that the weights' loads are shared and the sums' latencies overlap. */
HELPER void head(const __local float *a, int width, const __global float *w, const __global float *bias,
                 int rows, __local float *raw, int padded, int lid)
{
    for (int s = lid * 4; s < padded; s += LS * 4) {
        vf acc[4][3];

#pragma unroll
        for (int i = 0; i < 4; i++)
#pragma unroll
            for (int r = 0; r < rows; r++)
                acc[i][r] = (vf)(0.0f);
        for (int k = 0; k < width; k += VW)
#pragma unroll
            for (int i = 0; i < 4; i++) {
                const vf in = VLOAD(a + min(s + i, padded - 1) * width + k);

#pragma unroll
                for (int r = 0; r < rows; r++)
                    acc[i][r] = MAD(in, VLOAD(w + r * width + k), acc[i][r]);
            }
#pragma unroll
        for (int i = 0; i < 4; i++)
#pragma unroll
            for (int r = 0; r < rows; r++)
                if (s + i < padded)
                    raw[r * NB + s + i] = V_SUM(acc[i][r]) + bias[r];
    }
}

/* The trunk, layer by layer, between two buffers; returns the one that holds the last layer's output.
 * Work-items of a group all call it: it contains the barriers between layers (LS > 1). */
#define TRUNK_FORWARD(train_, acts_)                                                               \
    for (int i = 0; i < DEPTH; i++) {                                                              \
        __local float *from = i & 1 ? h1 : h0, *to = i & 1 ? h0 : h1;                              \
                                                                                                   \
        if (i == 0)                                                                                \
            dense(enc, ENC_PAD, 1, NB, enc, 0, w + TRUNK_W(0), w + TRUNK_B(0), WIDTH, to, tiles,   \
                  count, acts_, train_, step_key, ids, 0u, lid);                                   \
        else                                                                                       \
            dense(from, WIDTH, WIDTH, 1, enc, i == SKIP ? ENC_PAD : 0, w + TRUNK_W(i),             \
                  w + TRUNK_B(i), WIDTH, to, tiles, count, train_ ? acts_ + i * WIDTH : acts_,     \
                  train_, step_key, ids, (uint)i, lid);                                            \
        GROUP_SYNC();                                                                              \
    }                                                                                              \
    __local float *h = DEPTH & 1 ? h1 : h0;

/* ---- stage 1: densities on the jittered grid of a leaf ---- */

/* density[slot][cell] = bfloat16 of sigma at local position -1 + 2 (i + xi) / n1, cell = (z n1 + y) n1
 * + x; xi = 0.5 without jitter. Group g takes cells [g % per_leaf * cells, ...) of leaf g / per_leaf. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_density(const __global float *restrict params, /* [leaf][PARAMS] */
            const __global float4 *restrict boxes, /* [leaf] min x, y, z, side */
            __global ushort *restrict density,     /* [leaf][n1^3] */
            uint n1, uint cells, uint per_leaf, uint jitter, uint2 seed, uint step, uint first)
{
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH], at[3 * NB];
    __local uint ids[NB];
    const uint group = get_group_id(0), leaf = first + group / per_leaf;
    const uint total = n1 * n1 * n1, begin = group % per_leaf * cells;
    const uint end = min(begin + cells, total);
    const __global float *w = params + (size_t)leaf * PARAMS;
    const int lid = (int)get_local_id(0);
    const int level = (int)(1.5f - log2(boxes[leaf].w));
    const uint step_key = 0u;
    __global kept_type *none = 0;

    for (uint block = begin; block < end; block += NB) {
        const int count = (int)min((uint)NB, end - block), tiles = (count + TS - 1) / TS;
        const int rows = PADDED(count);

        GROUP_SYNC();
        for (int s = lid; s < rows; s += LS) {
            const uint cell = min(block + (uint)s, total - 1u);
            float4 xi = (float4)(0.5f);

            if (jitter)
                xi = uniform4(seed, STREAM_GRID, step, leaf * total + cell, 0u);
            ids[s] = 0u;
            at[s] = 2.0f * (convert_float(cell % n1) + xi.x) / (float)n1 - 1.0f;
            at[NB + s] = 2.0f * (convert_float(cell / n1 % n1) + xi.y) / (float)n1 - 1.0f;
            at[2 * NB + s] = 2.0f * (convert_float(cell / (n1 * n1)) + xi.z) / (float)n1 - 1.0f;
        }
        GROUP_SYNC();
        encode(at, BANDS, level, enc, ENC_PAD, rows, lid);
        GROUP_SYNC();
        TRUNK_FORWARD(0, none)
        head(h, WIDTH, w + SIGMA_W, w + SIGMA_B, 1, at, tiles * TS, lid);
        GROUP_SYNC();
        for (int s = lid * VW; s < rows; s += STEP_N)
            VSTORE(density_value(VLOAD(at + s)), at + s);
        GROUP_SYNC();
        for (int s = lid; s < count; s += LS) {
            const uint bits = as_uint(at[s]);

            /* round to nearest even; a NaN stays one */
            density[(size_t)leaf * total + block + s] =
                (ushort)(isnan(at[s]) ? 0x7FC0u : (bits + 0x7FFFu + (bits >> 16 & 1u)) >> 16);
        }
    }
}

/* ---- samples: where they are, in their leaf ---- */

/* ids, local position at [3][NB], direction along [3][NB] of `rows` samples; those past count repeat the
 * last. */
HELPER void load_samples(const __global cln_sample *samples, const __global uint *order,
                         const __global float4 *ray_o, const __global float4 *ray_d, float4 box,
                         uint start, int count, int rows, __local uint *ids, __local float *at,
                         __local float *along, int lid)
{
    const float scale = 2.0f / box.w;

    for (int s = lid; s < rows; s += LS) {
        const uint id = order[start + (uint)min(s, count - 1)];
        const cln_sample sample = samples[id];
        const float4 d = ray_d[sample.ray];
        const float4 p = (MAD((float4)(sample.t), d, ray_o[sample.ray]) - box) * scale - 1.0f;

        ids[s] = id;
        at[s] = p.x;
        at[NB + s] = p.y;
        at[2 * NB + s] = p.z;
#if VIEW > 0
        along[s] = d.x;
        along[NB + s] = d.y;
        along[2 * NB + s] = d.z;
#endif
    }
}

/* Encodings of the samples just loaded. */
#if VIEW > 0
#define ENCODE_SAMPLES(box)                                                                        \
    encode(at, BANDS, (int)(1.5f - log2((box).w)), enc, ENC_PAD, rows, lid);                       \
    encode(along, VIEW_BANDS, 0, dir, DIR_PAD, rows, lid);
#else
#define ENCODE_SAMPLES(box)                                                                        \
    encode(at, BANDS, (int)(1.5f - log2((box).w)), enc, ENC_PAD, rows, lid);
#endif

/* ---- forward ---- */

#define FORWARD_ARGUMENTS                                                                          \
    const __global float *restrict params,          /* [leaf][PARAMS] */                           \
        const __global float4 *restrict boxes,      /* [leaf] min x, y, z, side */                 \
        const __global cln_slice *restrict slices,  /* [slice] */                                  \
        const __global uint *restrict order,        /* [grouped sample] -> sample */               \
        const __global cln_sample *restrict samples, /* [sample] */                                \
        const __global float4 *restrict ray_o, const __global float4 *restrict ray_d, /* [ray] */  \
        __global float4 *restrict out,              /* [sample] r, g, b, sigma */                  \
        __global kept_type *restrict acts,          /* [grouped sample][ACTS], training only */    \
        uint n_slices, uint step_key

#if VIEW > 0
#define VIEW_BUFFERS __local float dir[NB * DIR_PAD], v[NB * VIEW], along[3 * NB];
#else
#define VIEW_BUFFERS __local float along[4];
#endif

#define FORWARD_BODY(train)                                                                        \
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH], at[3 * NB], raw[4 * NB];      \
    __local uint ids[NB];                                                                          \
    VIEW_BUFFERS                                                                                   \
    const uint group = get_group_id(0);                                                            \
    const int lid = (int)get_local_id(0);                                                          \
                                                                                                   \
    if (group >= n_slices)                                                                         \
        return;                                                                                    \
    const cln_slice slice = slices[group];                                                         \
    const __global float *w = params + (size_t)slice.slot * PARAMS;                                \
    for (uint block = 0; block < slice.count; block += NB) {                                       \
        const int count = (int)min((uint)NB, slice.count - block);                                 \
        const int tiles = (count + TS - 1) / TS, rows = PADDED(count);                             \
        __global kept_type *kept = acts + (size_t)(slice.start + block) * ACTS;                    \
                                                                                                   \
        GROUP_SYNC();                                                                              \
        load_samples(samples, order, ray_o, ray_d, boxes[slice.slot], slice.start + block, count,  \
                     rows, ids, at, along, lid);                                                   \
        GROUP_SYNC();                                                                              \
        ENCODE_SAMPLES(boxes[slice.slot])                                                          \
        GROUP_SYNC();                                                                              \
        TRUNK_FORWARD(train, kept)                                                                 \
        FORWARD_VIEW(train)                                                                        \
        head(COLOUR_IN, COLOUR, w + COLOUR_W, w + COLOUR_B, 3, raw, tiles * TS, lid);              \
        head(h, WIDTH, w + SIGMA_W, w + SIGMA_B, 1, raw + 3 * NB, tiles * TS, lid);                \
        if (train && NOISE_ON) {                                                                   \
            GROUP_SYNC();                                                                          \
            for (int s = lid; s < count; s += LS)                                                  \
                raw[3 * NB + s] += NOISE * normal_number(step_key, ids[s]);                        \
        }                                                                                          \
        GROUP_SYNC();                                                                              \
        for (int s = lid * VW; s < rows; s += STEP_N) {                                            \
            for (int k = 0; k < 3; k++)                                                            \
                VSTORE(1.0f / (1.0f + EXP(-VLOAD(raw + k * NB + s))), raw + k * NB + s);           \
            VSTORE(density_value(VLOAD(raw + 3 * NB + s)), raw + 3 * NB + s);                      \
        }                                                                                          \
        GROUP_SYNC();                                                                              \
        for (int s = lid; s < count; s += LS)                                                      \
            out[ids[s]] = (float4)(raw[s], raw[NB + s], raw[2 * NB + s], raw[3 * NB + s]);         \
    }

#if VIEW > 0
#define COLOUR_IN v
#define FORWARD_VIEW(train)                                                                        \
    dense(h, WIDTH, WIDTH, 1, dir, DIR_PAD, w + VIEW_W, w + VIEW_B, VIEW, v, tiles, count,   \
          kept + DEPTH * WIDTH, train, step_key, ids, (uint)DEPTH, lid);                           \
    GROUP_SYNC();
#else
#define COLOUR_IN h
#define FORWARD_VIEW(train)
#endif

/* One normal number per sample (Box-Muller on two hashes). */
HELPER float normal_number(uint step_key, uint sample)
{
    const uint a = (step_key ^ 0x27D4EB2Fu) + sample * 0x9E3779B9u;
    uint x = a ^ a >> 16, y = 0;

    x *= 0x21F0AAADu;
    x ^= x >> 15;
    x *= 0xD35A2D97u;
    x ^= x >> 15;
    y = x * 0x85EBCA6Bu + 0x165667B1u;
    y ^= y >> 16;
    y *= 0x21F0AAADu;
    y ^= y >> 15;
    return sqrt(-2.0f * LOG((convert_float(x >> 8) + 1.0f) * 0x1p-24f)) *
           cospi(2.0f * convert_float(y >> 8) * 0x1p-24f);
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void mlp_forward_train(FORWARD_ARGUMENTS)
{
    FORWARD_BODY(1)
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void mlp_forward_eval(FORWARD_ARGUMENTS)
{
    FORWARD_BODY(0)
}

/* ---- backward ---- */

/* h = act(x) for one layer's kept pre-activations x [s][ACTS]. */
HELPER void restore(const __global kept_type *x, int width, int count, __local float *h, uint step_key,
                    const __local uint *ids, uint layer, int lid)
{
    for (int s = 0; s < count; s++) {
        const uint key = slope_key(step_key, ids[s], layer);

        for (int n = lid * VW; n < width; n += STEP_N)
            VSTORE(activate(KEPT_LOAD(x + s * ACTS + n), negative_slope(1, key, n)), h + s * width + n);
    }
}

/* dw[k][n] (+)= sum_s a(s, k) d[s][n], db[n] (+)= sum_s d[s][n]; a(s, k) stands at s * a_s + k * a_k;
 * `first`: overwrite. */
HELPER void weight_gradient(const __local float *a, int rows, int a_s, int a_k, const __local float *d,
                            int n_out, __global float *dw, __global float *db, int count, int first,
                            int lid)
{
    for (int n = lid * VW; n < n_out; n += TILE_N) {
        for (int k = 0; k < rows; k += TK) {
            vf acc[TK][NV];

#pragma unroll
            for (int i = 0; i < TK; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    acc[i][j] =
                        first ? (vf)(0.0f) : VLOAD(dw + (k + i) * n_out + n + j * STEP_N);
            TILE_MAD(TK, a + k * a_k, a_k, a_s, d + n, n_out, count)
#pragma unroll
            for (int i = 0; i < TK; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    VSTORE(acc[i][j], dw + (k + i) * n_out + n + j * STEP_N);
        }
        if (db)
#pragma unroll
            for (int j = 0; j < NV; j++) {
                vf sum = first ? (vf)(0.0f) : VLOAD(db + n + j * STEP_N);

                for (int s = 0; s < count; s++)
                    sum += VLOAD(d + s * n_out + n + j * STEP_N);
                VSTORE(sum, db + n + j * STEP_N);
            }
    }
}

/* out[s][k] = act'(x[s][k]) (sum_n d[s][n] wt[n][k] + ds[s] extra[k]); extra may be absent (0). */
HELPER void input_gradient(const __local float *d, int n_in, const __global float *wt,
                           const __global kept_type *x, const __local float4 *dout,
                           const __global float *extra, __local float *out, int tiles, int count,
                           uint step_key, const __local uint *ids, uint layer, int lid)
{
    for (int n = lid * VW; n < WIDTH; n += TILE_N) {
        for (int t = 0; t < tiles; t++) {
            vf acc[TS][NV];

#pragma unroll
            for (int i = 0; i < TS; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    acc[i][j] = (vf)(0.0f);
            if (extra)
#pragma unroll
                for (int i = 0; i < TS; i++)
#pragma unroll
                    for (int j = 0; j < NV; j++)
                        acc[i][j] = (vf)(dout[t * TS + i].w) * VLOAD(extra + n + j * STEP_N);
            TILE_MAD(TS, d + t * TS * n_in, n_in, 1, wt + n, WIDTH, n_in)
#pragma unroll
            for (int i = 0; i < TS; i++) {
                const int s = min(t * TS + i, count - 1);
                const uint key = slope_key(step_key, ids[s], layer);

#pragma unroll
                for (int j = 0; j < NV; j++) {
                    const int m = n + j * STEP_N;
                    const vf g = activate_gradient(KEPT_LOAD(x + s * ACTS + m),
                                                   negative_slope(1, key, m));

                    VSTORE(acc[i][j] * g, out + (t * TS + i) * WIDTH + m);
                }
            }
        }
    }
}

/* Gradients of one head: dw[n] (+)= sum_s ds[s] a[s][n] for component k of dout. */
HELPER void head_gradient(const __local float *a, int width, const __local float4 *dout, int k,
                          __global float *dw, int count, int first, int lid)
{
    for (int n = lid * VW; n < width; n += STEP_N) {
        vf sum = first ? (vf)(0.0f) : VLOAD(dw + n);

        for (int s = 0; s < count; s++)
            sum = MAD((vf)(((const __local float *)(dout + s))[k]), VLOAD(a + s * width + n), sum);
        VSTORE(sum, dw + n);
    }
}

/* d[s][n] = act'(x[s][n]) sum_k dout[s][k] w[k][n], k over the colour head's three rows. */
HELPER void colour_input_gradient(const __global float *w, int width, const __global kept_type *x,
                                  const __local float4 *dout, __local float *d, int padded,
                                  int count, uint step_key, const __local uint *ids, uint layer,
                                  int lid)
{
    for (int s = 0; s < padded; s++) {
        const int row = min(s, count - 1);
        const uint key = slope_key(step_key, ids[row], layer);
        const float4 g = dout[s];

        for (int n = lid * VW; n < width; n += STEP_N) {
            vf sum = g.x * VLOAD(w + n);

            sum = MAD((vf)(g.y), VLOAD(w + width + n), sum);
            sum = MAD((vf)(g.z), VLOAD(w + 2 * width + n), sum);
            VSTORE(sum * activate_gradient(KEPT_LOAD(x + row * ACTS + n), negative_slope(1, key, n)),
                   d + s * width + n);
        }
    }
}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_backward(const __global float *restrict params,      /* [leaf][PARAMS] */
             const __global float *restrict transposed,  /* [leaf][WT_PARAMS] */
             const __global float4 *restrict boxes,      /* [leaf] min x, y, z, side */
             const __global cln_slice *restrict slices,  /* [slice] */
             const __global uint *restrict order,        /* [grouped sample] -> sample */
             const __global cln_sample *restrict samples, /* [sample] */
             const __global float4 *restrict ray_o, const __global float4 *restrict ray_d, /* [ray] */
             const __global float4 *restrict out,        /* [sample] r, g, b, sigma */
             const __global float4 *restrict dout,       /* [sample] gradient of it */
             const __global kept_type *restrict acts,    /* [grouped sample][ACTS] */
             __global float *restrict grads,             /* [slice][PARAMS] */
             uint n_slices, uint step_key)
{
    __local float enc[NB * ENC_PAD], h[NB * WIDTH], d0[NB * WIDTH], d1[NB * WIDTH], at[3 * NB];
    __local float4 dhead[NB];
    __local float slope[NB];
    __local uint ids[NB];
#if VIEW > 0
    __local float dir[NB * DIR_PAD], v[NB * VIEW], dv[NB * VIEW], along[3 * NB];
#else
    __local float along[4];
#endif
    const uint group = get_group_id(0);
    const int lid = (int)get_local_id(0);

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group];
    const __global float *w = params + (size_t)slice.slot * PARAMS;
    const __global float *wt = transposed + (size_t)slice.slot * WT_PARAMS;
    __global float *grad = grads + (size_t)group * PARAMS;

    for (uint block = 0; block < slice.count; block += NB) {
        const int first = block == 0, count = (int)min((uint)NB, slice.count - block);
        const int tiles = (count + TS - 1) / TS, rows = PADDED(count);
        const __global kept_type *x = acts + (size_t)(slice.start + block) * ACTS;
        const __global kept_type *x_last = x + (DEPTH - 1) * WIDTH;

        GROUP_SYNC();
        load_samples(samples, order, ray_o, ray_d, boxes[slice.slot], slice.start + block, count,
                     rows, ids, at, along, lid);
        GROUP_SYNC();
        ENCODE_SAMPLES(boxes[slice.slot])
        for (int s = lid; s < tiles * TS; s += LS) {
            const float4 o = out[ids[s]], g = dout[ids[s]];
            const float4 raw = g * (o * (1.0f - o));

            slope[s] = o.w;
            dhead[s] = s < count ? (float4)(raw.xyz, g.w) : (float4)(0.0f);
        }
        GROUP_SYNC();
        for (int s = lid * VW; s < rows; s += STEP_N)
            VSTORE(density_gradient(VLOAD(slope + s)), slope + s);
        GROUP_SYNC();
        for (int s = lid; s < tiles * TS; s += LS)
            dhead[s].w *= s < count ? slope[s] : 0.0f;
        GROUP_SYNC();
        restore(x_last, WIDTH, count, h, step_key, ids, DEPTH - 1, lid);
#if VIEW > 0
        restore(x + DEPTH * WIDTH, VIEW, count, v, step_key, ids, DEPTH, lid);
#endif
        GROUP_SYNC();
        for (int k = lid; k < 32; k += LS) { /* biases of the heads, and their padding, which is zero */
            const int part = k < 3 ? k : k == 16 ? 3 : -1; /* r, g, b; sigma */
            __global float *db = grad + (k < 16 ? COLOUR_B + k : SIGMA_B + k - 16);
            float sum = first ? 0.0f : *db;

            for (int s = 0; s < count && part >= 0; s++)
                sum += ((const __local float *)(dhead + s))[part];
            *db = sum;
        }
        head_gradient(h, WIDTH, dhead, 3, grad + SIGMA_W, count, first, lid);
#if VIEW > 0
        for (int k = 0; k < 3; k++)
            head_gradient(v, VIEW, dhead, k, grad + COLOUR_W + k * VIEW, count, first, lid);
        colour_input_gradient(w + COLOUR_W, VIEW, x + DEPTH * WIDTH, dhead, dv, tiles * TS, count,
                              step_key, ids, DEPTH, lid);
        GROUP_SYNC();
        weight_gradient(h, WIDTH, WIDTH, 1, dv, VIEW, grad + VIEW_W, grad + VIEW_B, count, first, lid);
        weight_gradient(dir, DIR_PAD, 1, NB, dv, VIEW, grad + VIEW_W + WIDTH * VIEW, 0, count,
                        first, lid);
        input_gradient(dv, VIEW, wt + WT_VIEW, x_last, dhead, w + SIGMA_W, d0, tiles, count,
                       step_key, ids, DEPTH - 1, lid);
#else
        for (int k = 0; k < 3; k++)
            head_gradient(h, WIDTH, dhead, k, grad + COLOUR_W + k * WIDTH, count, first, lid);
        for (int s = 0; s < tiles * TS; s++) {
            const int row = min(s, count - 1);
            const uint key = slope_key(step_key, ids[row], DEPTH - 1);

            for (int n = lid * VW; n < WIDTH; n += STEP_N) {
                vf sum = dhead[s].w * VLOAD(w + SIGMA_W + n);

                for (int k = 0; k < 3; k++)
                    sum = MAD((vf)(((const __local float *)(dhead + s))[k]),
                              VLOAD(w + COLOUR_W + k * WIDTH + n), sum);
                VSTORE(sum * activate_gradient(KEPT_LOAD(x_last + row * ACTS + n),
                                               negative_slope(1, key, n)),
                       d0 + s * WIDTH + n);
            }
        }
#endif
        for (int i = DEPTH - 1; i > 0; i--) {
            __local float *d = (DEPTH - 1 - i) & 1 ? d1 : d0, *below = (DEPTH - 1 - i) & 1 ? d0 : d1;

            GROUP_SYNC();
            restore(x + (i - 1) * WIDTH, WIDTH, count, h, step_key, ids, (uint)(i - 1), lid);
            GROUP_SYNC();
            weight_gradient(h, WIDTH, WIDTH, 1, d, WIDTH, grad + TRUNK_W(i), grad + TRUNK_B(i), count,
                            first, lid);
            if (i == SKIP)
                weight_gradient(enc, ENC_PAD, 1, NB, d, WIDTH,
                                grad + TRUNK_W(i) + WIDTH * WIDTH, 0, count, first, lid);
            input_gradient(d, WIDTH, wt + WT_TRUNK(i), x + (i - 1) * WIDTH, dhead, 0, below, tiles,
                           count, step_key, ids, (uint)(i - 1), lid);
        }
        GROUP_SYNC();
        weight_gradient(enc, ENC_PAD, 1, NB, (DEPTH - 1) & 1 ? d1 : d0, WIDTH, grad + TRUNK_W(0),
                        grad + TRUNK_B(0), count, first, lid);
    }
}
