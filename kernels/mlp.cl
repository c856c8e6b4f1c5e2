/* needs: rng leaves network adam */
/* The leaf networks, batched over leaves: densities on the stage-1 grid, forward, backward with weight
 * gradients and, where it can be, their update (method.md 1, 4, 8, 11). Parameters: network.h.
 *
 *   layer:      out[s][n] = act(b[n] + sum_k in[s][k] w[k][n])
 *   input grad: din[s][k] = sum_n d[s][n] w[k][n]      with a transposed copy wt[n][k]
 *   weight grad: dw[k][n] = sum_s in[s][k] d[s][n]
 *
 * All three are one micro-kernel with lanes over the contiguous index: T x NV vectors of accumulators in
 * registers, one vector load of B and T broadcasts of A per step. One work-group takes a slice: a run
 * of samples that lie in the same leaf, NB at a time, all layers while they are in cache.
 *
 *        samples of a leaf, grouped      work-group's local memory, NB samples
 *        |--- slice ---|--- slice -|     enc [ENC_PAD][NB]   h [NB][WIDTH]   d [NB][WIDTH]
 *        |NB|NB|NB|rest|NB|NB|rest |     dir [DIR_PAD][NB]   v [NB][VIEW]
 *
 * Most leaves have one slice: its gradient is the leaf's, and the work-group that has it takes Adam's step with it
 * at once. Gradients of slices that share a leaf go to buffers, and adam.cl adds them in order (no atomics).
 *
 * Rules: barriers only at a kernel's top level (helpers are called by all work-items, no barrier in
 * them); loop bounds around a barrier depend on the slice alone; rows past a block's count hold
 * garbage that never leaves its own row. */

/* ---- one layer forward: in, then in2 (an encoding) -> pre-activations to acts (if kept: rows of ACTS, of all
 * layers), activations to out. Element (s, k) of in stands at s * in_s + k * in_k; the bias is the row behind the
 * weights. While a tile is worked on, what stands a layer further in its rows of acts, or first in the next block's,
 * comes into the cache to be written; in a slice's first block the weights of the next columns; and with the last
 * columns the first ones of after_rows rows at after_w, what is read next. ---- */

HELPER void dense(const __local float *in, int in_rows, int in_s, int in_k,
                  const __local float *in2, int in2_rows, const __global float *w, int n_out,
                  __local float *out, int tiles, int count, __global kept_type *acts, int train,
                  int first, const __global float *after_w, int after_columns, int after_rows,
                  uint step_key, const __local uint *ids, uint layer, int lid)
{
    const int rows = in_rows + in2_rows;
    const __global float *bias = w + rows * n_out;

    for (int n = lid * VW; n < n_out; n += TILE_N) {
        const bool across = n + TILE_N < n_out;
        const __global float *next = across ? w + n + TILE_N : after_w + lid * VW;
        const int next_columns = across ? n_out : after_columns;
        const int next_rows = !across ? after_rows : first ? rows + 1 : 0;
        const int ahead = (int)layer * WIDTH + n + WIDTH;
        const __global kept_type *later = acts + (ahead < ACTS ? ahead : ahead - ACTS + count * ACTS);

        for (int t = 0; t < tiles; t++) {
            vf acc[TS][NV];

            if (next_rows > 0)
                fetch_rows(next, next_columns, next_rows * t / tiles, next_rows * (t + 1) / tiles);
            for (int i = 0; train && i < TS; i++)
                for (int j = 0; j < NV * VW; j += LINE_OF(acts))
                    FETCH_WRITE(later + (t * TS + i) * ACTS + j);
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
                        KEPT_STORE(acc[i][j], acts + s * ACTS + (int)layer * WIDTH + m);
                    VSTORE_IN(__local, activate(acc[i][j], negative_slope(train, key, m)), out + s * n_out + m);
                }
            }
        }
    }
}

/* Rows of a head: raw[r][s] = bias[r] + sum_k a[s][k] w[r][k], r < rows <= 3; four samples together, so
 * that the weights' loads are shared and the sums' latencies overlap. */
HELPER void head(const __local float *a, int width, const __global float *w,
                 const __global float *bias, int rows, __local float *raw, int padded, int lid)
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

/* The trunk, layer by layer, between two buffers; returns the one that holds the last layer's output. after_: what is
 * read after it, dense's. Work-items of a group all call it: it contains the barriers between layers (LS > 1). */
#define TRUNK_FORWARD(train_, acts_, after_w_, after_columns_, after_rows_)                       \
    for (int i = 0; i < DEPTH; i++) {                                                             \
        __local float *from = i & 1 ? h1 : h0, *to = i & 1 ? h0 : h1;                             \
        const int first_ = block == begin, end_ = i == DEPTH - 1;                                 \
        const __global float *after_w = w + (end_ ? (after_w_) : TRUNK_W(i + 1));                 \
        const int after_columns = end_ ? (after_columns_) : WIDTH;                                \
        const int after_rows =                                                                    \
            !first_ ? 0 : end_ ? (after_rows_) : WIDTH + (i + 1 == SKIP ? ENC_PAD : 0) + 1;       \
                                                                                                  \
        if (i == 0)                                                                               \
            dense(enc, ENC_PAD, 1, NB, enc, 0, w + TRUNK_W(0), WIDTH, to, tiles, count, acts_,    \
                  train_, first_, after_w, after_columns, after_rows, step_key, ids, 0u, lid);    \
        else                                                                                      \
            dense(from, WIDTH, WIDTH, 1, enc, i == SKIP ? ENC_PAD : 0, w + TRUNK_W(i), WIDTH, to, \
                  tiles, count, acts_, train_, first_, after_w, after_columns, after_rows,        \
                  step_key, ids, (uint)i, lid);                                                   \
        GROUP_SYNC();                                                                             \
    }                                                                                             \
    __local float *h = DEPTH & 1 ? h1 : h0;

/* ---- stage 1: densities on the jittered grid of a leaf ---- */

/* density[slot][cell] = bfloat16 of sigma at local position -1 + 2 (i + xi) / n1, cell = (z n1 + y) n1
 * + x; xi = 0.5 without jitter. Group g takes cells [g % per_leaf * cells, ...) of leaf g / per_leaf. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_density(LEAF_ARRAY(const float, params),       /* [leaf][PARAMS] */
            const __global float4 *restrict boxes, /* [leaf] min x, y, z, side */
            LEAF_ARRAY(ushort, density),           /* [leaf][n1^3] */
            uint n1, uint cells, uint per_leaf, uint jitter, uint2 seed, uint step, uint first)
{
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH], at[3 * NB];
    __local uint ids[NB];
    const uint group = get_group_id(0), leaf = first + group / per_leaf;
    const uint total = n1 * n1 * n1, begin = group % per_leaf * cells;
    const uint end = min(begin + cells, total);
    const __global float *w = LEAF_ROW(params, leaf, PARAMS);
    __global ushort *cached = LEAF_ROW(density, leaf, total);
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
        TRUNK_FORWARD(0, none, SIGMA_W, NV * VW, (WIDTH + 16 + NV * VW - 1) / (NV * VW))
        head(h, WIDTH, w + SIGMA_W, w + SIGMA_B, 1, at, tiles * TS, lid);
        GROUP_SYNC();
        for (int s = lid * VW; s < rows; s += STEP_N)
            VSTORE(density_value(VLOAD(at + s)), at + s);
        GROUP_SYNC();
        for (int s = lid; s < count; s += LS) {
            const uint bits = as_uint(at[s]);

            /* round to nearest even; a NaN stays one */
            cached[block + s] =
                (ushort)(isnan(at[s]) ? 0x7FC0u : (bits + 0x7FFFu + (bits >> 16 & 1u)) >> 16);
        }
    }
}

/* ---- forward ---- */

#define FORWARD_ARGUMENTS                                                                         \
    LEAF_ARRAY(const float, params),                 /* [leaf][PARAMS] */                         \
        const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */               \
        const __global cln_slice *restrict slices,   /* [slice] */                                \
        const __global uint *restrict order,         /* [grouped sample] -> sample */             \
        const __global cln_sample *restrict samples, /* [sample] */                               \
        const __global float4 *restrict ray_o, const __global float4 *restrict ray_d, /* [ray] */ \
        __global float4 *restrict out,     /* [sample] r, g, b, sigma */                          \
        __global kept_type *restrict acts, /* ACTS of each grouped sample, training only */       \
        uint n_slices, uint step_key

#if VIEW > 0
#define VIEW_BUFFERS __local float dir[NB * DIR_PAD], v[NB * VIEW], along[3 * NB];
#else
#define VIEW_BUFFERS __local float along[4];
#endif

#define FORWARD_BODY(train)                                                                       \
    __local float enc[NB * ENC_PAD], h0[NB * WIDTH], h1[NB * WIDTH], at[3 * NB], raw[4 * NB];     \
    __local uint ids[NB];                                                                         \
    VIEW_BUFFERS                                                                                  \
    const uint group = slice_of(slices, get_group_id(0), n_slices);                               \
    const int lid = (int)get_local_id(0);                                                         \
                                                                                                  \
    if (group >= n_slices)                                                                        \
        return;                                                                                   \
    const cln_slice slice = slices[group];                                                        \
    const __global float *w = LEAF_ROW(params, slice.slot, PARAMS);                               \
    const uint begin = 0u;                                                                        \
    /* the next group's slice is most often this processor's next, too */                         \
    const cln_slice after = slices[min(group + 1u, n_slices - 1u)];                               \
    const __global float *w_after = LEAF_ROW(params, after.slot, PARAMS);                         \
                                                                                                  \
    for (uint block = begin; block < slice.count; block += NB) {                                  \
        const int count = (int)min((uint)NB, slice.count - block);                                \
        const int tiles = (count + TS - 1) / TS, rows = PADDED(count);                            \
        __global kept_type *kept = acts + (size_t)(slice.start + block) * ACTS;                   \
                                                                                                  \
        GROUP_SYNC();                                                                             \
        for (int s = lid; s < rows; s += LS) /* past the count, the last one again */             \
            ids[s] = order[slice.start + block + (uint)min(s, count - 1)];                        \
        load_samples(samples, ray_o, ray_d, boxes[slice.slot], rows, ids, at, along, lid);        \
        GROUP_SYNC();                                                                             \
        ENCODE_SAMPLES(boxes[slice.slot])                                                         \
        GROUP_SYNC();                                                                             \
        const int last = slice.count - block <= NB;                                               \
        const int count_after = last ? (int)min((uint)NB, after.count) : 0;                       \
        for (int s = lid * FETCH_FLOATS; s < count_after + FETCH_FLOATS; s += LS * FETCH_FLOATS)  \
            FETCH(order + after.start + s);                                                       \
        FORWARD_TRUNK(train)                                                                      \
        for (int s = lid; FETCHES && s < count_after; s += LS)                                    \
            FETCH(samples + order[after.start + (uint)s]);                                        \
        FORWARD_VIEW(train)                                                                       \
        head(COLOUR_IN, COLOUR, w + COLOUR_W, w + COLOUR_B, 3, raw, tiles * TS, lid);             \
        head(h, WIDTH, w + SIGMA_W, w + SIGMA_B, 1, raw + 3 * NB, tiles * TS, lid);               \
        if (train && NOISE_ON) {                                                                  \
            GROUP_SYNC();                                                                         \
            for (int s = lid; s < count; s += LS)                                                 \
                raw[3 * NB + s] += NOISE * normal_number(step_key, ids[s]);                       \
        }                                                                                         \
        GROUP_SYNC();                                                                             \
        for (int s = lid * VW; s < rows; s += STEP_N) {                                           \
            for (int k = 0; k < 3; k++)                                                           \
                VSTORE(1.0f / (1.0f + EXP(-VLOAD(raw + k * NB + s))), raw + k * NB + s);          \
            VSTORE(density_value(VLOAD(raw + 3 * NB + s)), raw + 3 * NB + s);                     \
        }                                                                                         \
        GROUP_SYNC();                                                                             \
        for (int s = lid; s < count; s += LS)                                                     \
            out[ids[s]] = (float4)(raw[s], raw[NB + s], raw[2 * NB + s], raw[3 * NB + s]);        \
    }

#if VIEW > 0
#define COLOUR_IN v
#define FORWARD_TRUNK(train) TRUNK_FORWARD(train, kept, VIEW_W, VIEW, VIEW_ROWS + 1)
#define FORWARD_VIEW(train)                                                                       \
    if (block == begin && lid == 0) {                                                             \
        FETCH_SHARE(w + SIGMA_W, SHARE_OF(w, WIDTH + 16, 1), 0)                                   \
        FETCH_SHARE(w + COLOUR_W, SHARE_OF(w, PARAMS - COLOUR_W, 1), 0)                           \
    }                                                                                             \
    dense(h, WIDTH, WIDTH, 1, dir, DIR_PAD, w + VIEW_W, VIEW, v, tiles, count,                    \
          kept, train, block == begin, w_after, WIDTH, last ? ENC_PAD + 1 : 0, step_key, ids,     \
          (uint)DEPTH, lid);                                                                      \
    GROUP_SYNC();
#else
#define COLOUR_IN h
#define FORWARD_TRUNK(train)                                                                      \
    TRUNK_FORWARD(train, kept, SIGMA_W, NV * VW, (PARAMS - SIGMA_W + NV * VW - 1) / (NV * VW))
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

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void mlp_forward_train(FORWARD_ARGUMENTS){
    FORWARD_BODY(1)}

__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void mlp_forward_eval(FORWARD_ARGUMENTS){
    FORWARD_BODY(0)}

/* ---- backward ---- */

/* h = act(x) for one layer's kept pre-activations: of sample s at x + places[s]. */
HELPER void restore(const __global kept_type *x, const __local int *places, int width, int count,
                    __local float *h, uint step_key, const __local uint *ids, uint layer, int lid)
{
    for (int s = 0; s < count; s++) {
        const uint key = slope_key(step_key, ids[s], layer);
        const __global kept_type *row = x + places[s];

        for (int n = lid * VW; n < width; n += STEP_N)
            VSTORE_IN(__local, activate(KEPT_LOAD(row + n), negative_slope(1, key, n)), h + s * width + n);
    }
}

/* Gradient and transposed weights of a leaf. */
#if LEAF
#define LEAF_SPACE  __local
#define LEAF_SYNC() GROUP_SYNC()
#else
#define LEAF_SPACE  __global
#define LEAF_SYNC() barrier(CLK_GLOBAL_MEM_FENCE)
#endif

#if LEAF
/* wt[n][k] = w[k][n] of one layer, k < WIDTH: VW x VW at a time. A perfect shuffle of the rows, log2(VW)
 * times over, is the transpose. */
HELPER void transpose_layer(const __global float *w, int columns, __local float *wt, int lid)
{
    const int across = columns / VW;

    for (int tile = lid; tile < WIDTH / VW * across; tile += LS) {
        const int k = tile / across * VW, n = tile % across * VW;
        vf row[VW];

#pragma unroll
        for (int i = 0; i < VW; i++)
            row[i] = VLOAD(w + (k + i) * columns + n);
#if VW > 1
#pragma unroll
        for (int round = 1; round < VW; round *= 2) {
            vf next[VW];

#pragma unroll
            for (int i = 0; i < VW / 2; i++) {
                next[2 * i] = V_ZIP_LO(row[i], row[i + VW / 2]);
                next[2 * i + 1] = V_ZIP_HI(row[i], row[i + VW / 2]);
            }
#pragma unroll
            for (int i = 0; i < VW; i++)
                row[i] = next[i];
        }
#endif
#pragma unroll
        for (int i = 0; i < VW; i++)
            VSTORE_IN(__local, row[i], wt + (n + i) * WIDTH + k);
    }
}
#endif

/* What comes into the cache meanwhile, in equal shares: `width` pre-activations of `samples` samples each, at x +
 * places[s], and w_n weights that are needed next. */
typedef struct fetches {
    const __global kept_type *x;
    const __local int *places;
    const __global float *w;
    int samples, width, w_n;
} fetches;

/* dw[k][n] (+)= sum_s a(s, k) d[s][n], db[n] (+)= sum_s d[s][n]; a(s, k) stands at s * a_s + k * a_k;
 * `first`: overwrite. */
HELPER void weight_gradient(const __local float *a, int rows, int a_s, int a_k,
                            const __local float *d, int n_out, LEAF_SPACE float *dw,
                            LEAF_SPACE float *db, int count, int first, const fetches *next,
                            int lid)
{
    const int shares = rows / TK * (n_out / TILE_N);
    const int x_each = (next->samples + shares - 1) / shares;
    const int w_lines = SHARE_OF(next->w, next->w_n, shares);
    int share = 0;

    for (int n = lid * VW; n < n_out; n += TILE_N) {
        for (int k = 0; k < rows; k += TK, share++) {
            vf acc[TK][NV];

            for (int s = share * x_each; s < min((share + 1) * x_each, next->samples); s++)
                for (int l = 0; l < next->width; l += LINE_OF(next->x))
                    FETCH(next->x + next->places[s] + l);
            FETCH_SHARE(next->w, w_lines, share)

#pragma unroll
            for (int i = 0; i < TK; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    acc[i][j] = first ? (vf)(0.0f) : VLOAD(dw + (k + i) * n_out + n + j * STEP_N);
            TILE_MAD(TK, a + k * a_k, a_k, a_s, d + n, n_out, count)
#pragma unroll
            for (int i = 0; i < TK; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    VSTORE_IN(LEAF_SPACE, acc[i][j], dw + (k + i) * n_out + n + j * STEP_N);
        }
        if (db) { /* four sums at a time: one would wait for its own additions */
            vf part[4][NV];
            int s = 0;

#pragma unroll
            for (int i = 0; i < 4; i++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    part[i][j] = first || i > 0 ? (vf)(0.0f) : VLOAD(db + n + j * STEP_N);
            for (; s + 4 <= count; s += 4)
#pragma unroll
                for (int i = 0; i < 4; i++)
#pragma unroll
                    for (int j = 0; j < NV; j++)
                        part[i][j] += VLOAD(d + (s + i) * n_out + n + j * STEP_N);
            for (; s < count; s++)
#pragma unroll
                for (int j = 0; j < NV; j++)
                    part[0][j] += VLOAD(d + s * n_out + n + j * STEP_N);
#pragma unroll
            for (int j = 0; j < NV; j++)
                VSTORE_IN(LEAF_SPACE, (part[0][j] + part[1][j]) + (part[2][j] + part[3][j]), db + n + j * STEP_N);
        }
    }
}

/* out[s][k] = act'(x of s)[k] (sum_n d[s][n] wt[n][k] + ds[s] extra[k]); extra may be absent (0). */
HELPER void input_gradient(const __local float *d, int n_in, const LEAF_SPACE float *wt,
                           const __global kept_type *x, const __local int *places,
                           const __local float4 *dout, const __global float *extra, __local float *out, int tiles, int count,
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
                const __global kept_type *row = x + places[s];

#pragma unroll
                for (int j = 0; j < NV; j++) {
                    const int m = n + j * STEP_N;
                    const vf g = activate_gradient(KEPT_LOAD(row + m), negative_slope(1, key, m));

                    VSTORE_IN(__local, acc[i][j] * g, out + (t * TS + i) * WIDTH + m);
                }
            }
        }
    }
}

/* Gradients of a head's rows: dw[r][n] (+)= sum_s ds[s] a[s][n] for components k .. k + rows - 1 of dout, rows <= 3. */
HELPER void head_gradient(const __local float *a, int width, const __local float4 *dout, int k,
                          int rows, LEAF_SPACE float *dw, int count, int first, int lid)
{
    for (int n = lid * VW; n < width; n += STEP_N) {
        vf part[4][3];
        int s = 0;

#pragma unroll
        for (int i = 0; i < 4; i++)
#pragma unroll
            for (int r = 0; r < rows; r++)
                part[i][r] = first || i > 0 ? (vf)(0.0f) : VLOAD(dw + r * width + n);
        for (; s + 4 <= count; s += 4)
#pragma unroll
            for (int i = 0; i < 4; i++) {
                const vf in = VLOAD(a + (s + i) * width + n);

#pragma unroll
                for (int r = 0; r < rows; r++)
                    part[i][r] =
                        MAD((vf)(((const __local float *)(dout + s + i))[k + r]), in, part[i][r]);
            }
        for (; s < count; s++) {
            const vf in = VLOAD(a + s * width + n);

#pragma unroll
            for (int r = 0; r < rows; r++)
                part[0][r] = MAD((vf)(((const __local float *)(dout + s))[k + r]), in, part[0][r]);
        }
#pragma unroll
        for (int r = 0; r < rows; r++)
            VSTORE_IN(LEAF_SPACE, (part[0][r] + part[1][r]) + (part[2][r] + part[3][r]), dw + r * width + n);
    }
}

/* The same of its biases, with their padding up to 16, which is zero. */
HELPER void head_bias_gradient(const __local float4 *dout, int k, int rows, LEAF_SPACE float *db,
                               int count, int first, int lid)
{
    for (int r = lid; r < 16; r += LS) {
        float sum = first ? 0.0f : db[r];

        for (int s = 0; s < count && r < rows; s++)
            sum += ((const __local float *)(dout + s))[k + r];
        db[r] = sum;
    }
}

/* d[s][n] = act'(x of s)[n] sum_k dout[s][k] w[k][n], k over the colour head's three rows. */
HELPER void colour_input_gradient(const __global float *w, int width, const __global kept_type *x,
                                  const __local int *places, const __local float4 *dout,
                                  __local float *d, int padded, int count, uint step_key,
                                  const __local uint *ids, uint layer, int lid)
{
    for (int s = 0; s < padded; s++) {
        const int from = min(s, count - 1);
        const uint key = slope_key(step_key, ids[from], layer);
        const __global kept_type *row = x + places[from];
        const float4 g = dout[s];

        for (int n = lid * VW; n < width; n += STEP_N) {
            vf sum = g.x * VLOAD(w + n);

            sum = MAD((vf)(g.y), VLOAD(w + width + n), sum);
            sum = MAD((vf)(g.z), VLOAD(w + 2 * width + n), sum);
            VSTORE_IN(__local, sum * activate_gradient(KEPT_LOAD(row + n), negative_slope(1, key, n)),
                   d + s * width + n);
        }
    }
}

/* update 0: the gradient of every slice to grads [slice][PARAMS]. update 1: leaves with fewer than min_samples samples
 * are left alone; of the others, those of one slice are updated (adam.h) and the rest leave their gradients, LEAF
 * 0 as above and LEAF 1 at grads [slice start / half_slice][PARAMS]: starts of slices that share a leaf are at least
 * half_slice apart (group.cl). */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
mlp_backward(LEAF_ARRAY(float, params),                   /* [leaf][PARAMS] */
             LEAF_ARRAY(float, transposed),               /* [leaf][WT_PARAMS], LEAF 0 */
             const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
             const __global cln_slice *restrict slices,   /* [slice] */
             const __global uint *restrict order,         /* [grouped sample] -> sample */
             const __global cln_sample *restrict samples, /* [sample] */
             const __global float4 *restrict ray_o,
             const __global float4 *restrict ray_d,   /* [ray] */
             const __global float4 *restrict heads,   /* [grouped sample], roulette.cl's */
             const __global uint *restrict chosen,    /* [grouped sample] which go, of each slice */
             const __global uint *restrict chosen_counts, /* [slice] how many */
             const __global kept_type *restrict acts, /* ACTS of each grouped sample */
             LEAF_ARRAY(float, grads), uint n_slices, uint step_key, uint update, uint half_slice,
             uint min_samples, float lr, const __global uint *restrict begin,
             const __global uint *restrict end,                      /* [leaf] */
             const __global int *restrict steps,                     /* [leaf] */
             const __global float *restrict norms,                   /* [leaf] */
             LEAF_ARRAY(moment_type, moment1), LEAF_ARRAY(moment_type, moment2)) /* [leaf][PARAMS] */
{
    __local float enc[NB * ENC_PAD], h[NB * WIDTH], d0[NB * WIDTH], d1[NB * WIDTH], at[3 * NB];
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

    if (slice.count == 0u || (update && whole < min_samples))
        return;
    const __global float *w = LEAF_ROW(params, slice.slot, PARAMS);
#if LEAF
    for (int i = 1; i < DEPTH; i++)
        transpose_layer(w + TRUNK_W(i), WIDTH, wt + WT_TRUNK(i), lid);
#if VIEW > 0
    transpose_layer(w + VIEW_W, VIEW, wt + WT_VIEW, lid);
#endif
#else
    __global float *wt = LEAF_ROW(transposed, slice.slot, WT_PARAMS);
    __global float *grad = SLICE_ROW(grads, group, PARAMS);
#endif

    /* the next group's slice is most often this processor's next, too */
    const uint group_after = min(group + 1u, n_slices - 1u);
    const cln_slice after = slices[group_after];
    const int count_after = (int)min((uint)NB, chosen_counts[group_after]);
    const __global float *w_after = LEAF_ROW(params, after.slot, PARAMS);

    const uint all = chosen_counts[group];
    const __global kept_type *x = acts + (size_t)slice.start * ACTS;
    const __global kept_type *x_last = x + (DEPTH - 1) * WIDTH;

    for (uint block = 0; block < all; block += NB) {
        const int first = block == 0, count = (int)min((uint)NB, all - block);
        const int last = all - block <= NB;
        const int tiles = (count + TS - 1) / TS, rows = PADDED(count);
        fetches next = {x_last - WIDTH, places, w_after + VIEW_W, DEPTH > 1 ? count : 0, WIDTH,
                        last ? WIDTH * VIEW : 0};
        const fetches nothing = {x, places, w, 0, 0, 0};

        GROUP_SYNC();
        for (int s = lid; s < rows; s += LS) { /* past the count, the last one again */
            const uint row = chosen[slice.start + block + (uint)min(s, count - 1)];

            ids[s] = order[slice.start + row];
            places[s] = (int)row * ACTS;
            dhead[s] = s < count ? heads[slice.start + block + (uint)s] : (float4)(0.0f);
        }
        for (int s = lid; FETCHES && last && s < count_after; s += LS) {
            const uint row = chosen[after.start + (uint)s];

            places_after[s] = (int)row * ACTS;
            FETCH(samples + order[after.start + row]);
        }
        load_samples(samples, ray_o, ray_d, boxes[slice.slot], rows, ids, at, along, lid);
        GROUP_SYNC();
        ENCODE_SAMPLES(boxes[slice.slot])
        restore(x_last, places, WIDTH, count, h, step_key, ids, DEPTH - 1, lid);
#if VIEW > 0
        restore(x + DEPTH * WIDTH, places, VIEW, count, v, step_key, ids, DEPTH, lid);
#endif
        GROUP_SYNC();
        head_bias_gradient(dhead, 0, 3, grad + COLOUR_B, count, first, lid);
        head_bias_gradient(dhead, 3, 1, grad + SIGMA_B, count, first, lid);
        GROUP_SYNC(); /* needed by nobody but PoCL 3.1, which loses the biases' stores without it */
        head_gradient(h, WIDTH, dhead, 3, 1, grad + SIGMA_W, count, first, lid);
#if VIEW > 0
        head_gradient(v, VIEW, dhead, 0, 3, grad + COLOUR_W, count, first, lid);
        colour_input_gradient(w + COLOUR_W, VIEW, x + DEPTH * WIDTH, places, dhead, dv, tiles * TS,
                              count, step_key, ids, DEPTH, lid);
        GROUP_SYNC();
        weight_gradient(h, WIDTH, WIDTH, 1, dv, VIEW, grad + VIEW_W, grad + VIEW_B, count, first,
                        &next, lid);
        weight_gradient(dir, DIR_PAD, 1, NB, dv, VIEW, grad + VIEW_W + WIDTH * VIEW, 0, count,
                        first, &nothing, lid);
        input_gradient(dv, VIEW, wt + WT_VIEW, x_last, places, dhead, w + SIGMA_W, d0, tiles, count,
                       step_key, ids, DEPTH - 1, lid);
#else
        head_gradient(h, WIDTH, dhead, 0, 3, grad + COLOUR_W, count, first, lid);
        for (int s = 0; s < tiles * TS; s++) {
            const int from = min(s, count - 1);
            const uint key = slope_key(step_key, ids[from], DEPTH - 1);
            const __global kept_type *row = x_last + places[from];

            for (int n = lid * VW; n < WIDTH; n += STEP_N) {
                vf sum = dhead[s].w * VLOAD(w + SIGMA_W + n);

                for (int k = 0; k < 3; k++)
                    sum = MAD((vf)(((const __local float *)(dhead + s))[k]),
                              VLOAD(w + COLOUR_W + k * WIDTH + n), sum);
                VSTORE_IN(__local, sum * activate_gradient(KEPT_LOAD(row + n), negative_slope(1, key, n)),
                       d0 + s * WIDTH + n);
            }
        }
#endif
        for (int i = DEPTH - 1; i > 0; i--) {
            __local float *d = (DEPTH - 1 - i) & 1 ? d1 : d0,
                          *below = (DEPTH - 1 - i) & 1 ? d0 : d1;

            GROUP_SYNC();
            restore(x + (i - 1) * WIDTH, places, WIDTH, count, h, step_key, ids, (uint)(i - 1),
                    lid);
            GROUP_SYNC();
            next.x = x + (i - 2) * WIDTH;
            next.samples = i > 1 ? count : 0;
            next.w = w_after + TRUNK_W(i);
            next.w_n = last ? WIDTH * WIDTH : 0;
            weight_gradient(h, WIDTH, WIDTH, 1, d, WIDTH, grad + TRUNK_W(i), grad + TRUNK_B(i),
                            count, first, &next, lid);
            if (i == SKIP)
                weight_gradient(enc, ENC_PAD, 1, NB, d, WIDTH, grad + TRUNK_W(i) + WIDTH * WIDTH, 0,
                                count, first, &nothing, lid);
            input_gradient(d, WIDTH, wt + WT_TRUNK(i), x + (i - 1) * WIDTH, places, dhead, 0, below,
                           tiles, count, step_key, ids, (uint)(i - 1), lid);
        }
        GROUP_SYNC();
        next.x = acts + (size_t)after.start * ACTS + (DEPTH - 1) * WIDTH; /* what a slice begins with */
        next.places = places_after;
        next.samples = last ? count_after : 0;
        next.width = WIDTH + VIEW;
        next.w = w_after;
        next.w_n = last ? ENC_PAD * WIDTH : 0;
        weight_gradient(enc, ENC_PAD, 1, NB, (DEPTH - 1) & 1 ? d1 : d0, WIDTH, grad + TRUNK_W(0),
                        grad + TRUNK_B(0), count, first, &next, lid);
    }
    LEAF_SYNC();
    if (update && slice.count == whole) {
        const adam_leaf a = adam_leaf_of(lr, steps[slice.slot], norms[slice.slot], slice.slot);
        __global float *w_row = LEAF_ROW(params, slice.slot, PARAMS);
        __global moment_type *m_row = LEAF_ROW(moment1, slice.slot, PARAMS);
        __global moment_type *v_row = LEAF_ROW(moment2, slice.slot, PARAMS);

        for (uint p = (uint)lid * VW; p < PARAMS; p += STEP_N) {
            const vf updated = adam_step(a, VLOAD(grad + p), p, w_row, m_row, v_row);

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
