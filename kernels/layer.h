/* needs: block leaves */
/* The operations of a layer on a block, forward and backward (method.md 1, 11).
 *
 *   layer_forward          x[s][n] = b[n] + sum_k in[s][k] w[k][n],   out = act(x)
 *   layer_weight_gradient  dw[k][n] (+)= sum_s in[s][k] d[s][n],      db[n] (+)= sum_s d[s][n]
 *   layer_input_gradient   din[s][k] = act'(x[s][k]) (sum_n d[s][n] wt[n][k] + the density head's)
 *
 * with s over samples, d the gradient of x and wt the transposed weights. All three use one
 * micro-kernel, TILE_MAD: T x NV vectors of sums in registers, lanes over the contiguous index, NV
 * vector loads of B and T broadcasts of A per step. Heads have one or three outputs, too few for
 * lanes: head_forward, head_weight_gradient, head_bias_gradient and head_input_gradient.
 *
 * Every work-item of a group calls these functions; only trunk_forward has barriers. */


/* An operand in local memory: element (s, k) is p[s * s_step + k * k_step]. */
typedef struct operand {
    const __local float *p;
    int rows, s_step, k_step; /* k < rows */
} operand;

/* [NB][width], like layers' outputs; [rows][NB], like encodings. */
HELPER operand by_sample(const __local float *p, int width)
{
    const operand o = {p, width, width, 1};

    return o;
}

HELPER operand by_row(const __local float *p, int rows)
{
    const operand o = {p, rows, 1, NB};

    return o;
}

/* The first `rows` of the encoded positions: stored row by row, but the grid's sample by sample. */
HELPER operand by_encoding(const __local float *enc, int rows)
{
    return ENCODING == 1 ? by_sample(enc, rows) : by_row(enc, rows);
}

/* sums[i][j] += sum over r < R of a[i * a_i + r * a_r] * B[r * b_r + vector j], i < T. A macro, as
 * B may be in local or global memory. */
#define TILE_MAD(T, sums, a, a_i, a_r, B, b_r, R)                                             \
    for (int r_ = 0; r_ < (R); r_++) {                                                        \
        vf b_[NV];                                                                            \
                                                                                              \
        UNROLL (j_, NV)                                                                       \
            b_[j_] = VLOAD((B) + r_ * (b_r) + j_ * STEP_N);                                   \
        UNROLL (i_, T) {                                                                      \
            const vf a_ = (vf)((a)[i_ * (a_i) + r_ * (a_r)]);                                 \
                                                                                              \
            UNROLL (j_, NV)                                                                   \
                sums[i_][j_] = MAD(a_, b_[j_], sums[i_][j_]);                                 \
        }                                                                                     \
    }

/* ---- forward ---- */

/* A layer: its number (for slopes and kept pre-activations), outputs, and weights, which the row of
 * biases follows. */
typedef struct layer {
    int number, outputs;
    const __global float *w;
} layer;

/* What a layer's first tile reads of `rows` rows of weights; n weights of heads. All rows have one
 * width, so that the compiler need not keep it. */
HELPER ahead weights_ahead(const __global float *w, int rows, int columns)
{
    return AHEAD_ROWS(w, rows, columns, NV * VW);
}

HELPER ahead heads_ahead(const __global float *w, int n)
{
    return weights_ahead(w, (n + NV * VW - 1) / (NV * VW), NV * VW);
}

/* A layer: inputs `in`, then `more` (an encoding, or nothing) -> activations to out [NB][outputs];
 * in training also pre-activations to acts [sample][ACTS]. Meanwhile it fetches the places that the
 * next layer's pre-activations go to; in a slice's first block the weights of the next tile; with
 * the last tile `next`. */
HELPER void layer_forward(block b, layer l, operand in, operand more, __local float *out,
                          __global kept_type *acts, ahead next)
{
    const int rows = in.rows + more.rows;
    const __global float *bias = l.w + rows * l.outputs;

    for (int n = b.lid * VW; n < l.outputs; n += TILE_N) {
        const ahead beside = weights_ahead(l.w + n + TILE_N, b.first ? rows + 1 : 0, l.outputs);
        const ahead weights = in_turns(n + TILE_N < l.outputs ? beside : next, b.tiles);
        const int place = l.number * WIDTH + n, above = place + WIDTH;
        const int soon = above < ACTS ? above : above - ACTS + b.count * ACTS;
        const ahead kept = AHEAD_ROWS(acts + soon, b.tiles * TS, ACTS, NV * VW);

        for (int t = 0; t < b.tiles; t++) {
            vf x[TS][NV];

            fetch_turn(weights, t);
            if (TRAIN)
                fetch_rows(kept, t * TS, TS, true);
            UNROLL (i, TS)
                UNROLL (j, NV)
                    x[i][j] = VLOAD(bias + n + j * STEP_N);
            TILE_MAD(TS, x, in.p + t * TS * in.s_step, in.s_step, in.k_step, l.w + n, l.outputs,
                     in.rows)
            if (more.rows > 0)
                TILE_MAD(TS, x, more.p + t * TS * more.s_step, more.s_step, more.k_step,
                         l.w + in.rows * l.outputs + n, l.outputs, more.rows)
            UNROLL (i, TS) {
                const int s = t * TS + i;
                const uint key = block_slope_key(b, s, l.number);

                UNROLL (j, NV) {
                    const int m = j * STEP_N;

                    if (TRAIN && s < b.count)
                        KEPT_STORE(x[i][j], acts + s * ACTS + place + m);
                    VSTORE_IN(__local, activate(x[i][j], negative_slope(key, n + m)),
                              out + s * l.outputs + n + m);
                }
            }
        }
    }
}

/* A head: raw[r][s] = bias[r] + sum_k in[s][k] w[r][k], r < rows <= 3. Four samples together share
 * the loads of weights, and the latencies of their sums overlap. */
HELPER void head_forward(block b, operand in, const __global float *w, const __global float *bias,
                         int rows, __local float *raw)
{
    const int padded = b.tiles * TS;

    for (int s = b.lid * 4; s < padded; s += LS * 4) {
        vf sum[4][3];

        UNROLL (i, 4)
            UNROLL (r, rows)
                sum[i][r] = (vf)(0.0f);
        for (int k = 0; k < in.rows; k += VW)
            UNROLL (i, 4) {
                const vf h = VLOAD(in.p + min(s + i, padded - 1) * in.s_step + k);

                UNROLL (r, rows)
                    sum[i][r] = MAD(h, VLOAD(w + r * in.rows + k), sum[i][r]);
            }
        UNROLL (i, 4)
            UNROLL (r, rows)
                if (s + i < padded)
                    raw[r * NB + s + i] = V_SUM(sum[i][r]) + bias[r];
    }
}

/* The trunk, layer by layer, between two buffers; returns the one with the last layer's output.
 * next: what is read after it. Ends with a barrier. */
HELPER const __local float *trunk_forward(block b, const __global float *w,
                                          const __local float *enc, __local float *h0,
                                          __local float *h1, __global kept_type *acts, ahead next)
{
    for (int i = 0; i < DEPTH; i++) {
        const __local float *from = i & 1 ? h1 : h0;
        __local float *to = i & 1 ? h0 : h1;
        const int rows_above = WIDTH + (i + 1 == SKIP ? ENC_PAD : 0) + 1;
        const ahead above = weights_ahead(w + TRUNK_W(i + 1), b.first ? rows_above : 0, WIDTH);
        const ahead after = i == DEPTH - 1 ? next : above;
        const layer l = {i, WIDTH, w + TRUNK_W(i)};

        if (i == 0)
            layer_forward(b, l, by_encoding(enc, ENC_PAD), by_encoding(enc, 0), to, acts, after);
        else
            layer_forward(b, l, by_sample(from, WIDTH), by_encoding(enc, i == SKIP ? ENC_PAD : 0),
                          to, acts, after);
        GROUP_SYNC();
    }
    return DEPTH & 1 ? h1 : h0;
}

/* ---- backward ---- */

/* Memory of a leaf's gradient and transposed weights. */
#if LEAF
#define LEAF_SPACE  __local
#define LEAF_SYNC() GROUP_SYNC()
#else
#define LEAF_SPACE  __global
#define LEAF_SYNC() barrier(CLK_GLOBAL_MEM_FENCE)
#endif

/* Pre-activations kept by the forward pass: those of the block's sample s begin at x + places[s],
 * layer by layer. */
typedef struct kept_block {
    const __global kept_type *x;
    const __local int *places;
} kept_block;

HELPER const __global kept_type *kept_row(kept_block kept, int s, int layer)
{
    return kept.x + kept.places[s] + layer * WIDTH;
}

/* `width` pre-activations of each of n samples, from a layer on. */
HELPER ahead kept_ahead(kept_block kept, int layer, int n, int width)
{
    const ahead a = {(const __global char *)(kept.x + layer * WIDTH), kept.places, n,
                     (int)sizeof(kept_type), width * (int)sizeof(kept_type), n};

    return a;
}

/* act'(x) from neuron n on of a sample's layer. */
HELPER vf kept_gradient(const __global kept_type *row, uint key, int n)
{
    return activate_gradient(KEPT_LOAD(row + n), negative_slope(key, n));
}

/* h[s][n] = act(x[s][n]) of a layer. */
HELPER void restore(block b, kept_block kept, int layer, int width, __local float *h)
{
    for (int s = 0; s < b.count; s++) {
        const uint key = block_slope_key(b, s, layer);
        const __global kept_type *row = kept_row(kept, s, layer);

        for (int n = b.lid * VW; n < width; n += STEP_N)
            VSTORE_IN(__local, activate(KEPT_LOAD(row + n), negative_slope(key, n)),
                      h + s * width + n);
    }
}

/* d [NB][outputs]: gradients of a layer's pre-activations. A slice's first block overwrites dw
 * [in.rows][outputs] and db [outputs] (or 0: none), the others add to them. Meanwhile it fetches
 * `acts` and `weights`, which are read next. */
HELPER void layer_weight_gradient(block b, operand in, const __local float *d, int outputs,
                                  LEAF_SPACE float *dw, LEAF_SPACE float *db, ahead acts,
                                  ahead weights)
{
    const int turns = in.rows / TILE_K * (outputs / TILE_N);
    int turn = 0;

    acts = in_turns(acts, turns);
    weights = in_turns(weights, turns);
    for (int n = b.lid * VW; n < outputs; n += TILE_N) {
        const __local float *column = d + n;

        for (int k = 0; k < in.rows; k += TILE_K, turn++) {
            LEAF_SPACE float *to = dw + k * outputs + n;
            vf sum[TILE_K][NV];

            fetch_turn(acts, turn);
            fetch_turn(weights, turn);
            UNROLL (i, TILE_K)
                UNROLL (j, NV)
                    sum[i][j] = b.first ? (vf)(0.0f) : VLOAD(to + i * outputs + j * STEP_N);
            TILE_MAD(TILE_K, sum, in.p + k * in.k_step, in.k_step, in.s_step, column, outputs,
                     b.count)
            UNROLL (i, TILE_K)
                UNROLL (j, NV)
                    VSTORE_IN(LEAF_SPACE, sum[i][j], to + i * outputs + j * STEP_N);
        }
        if (db) { /* four sums at a time hide the latency of additions */
            vf part[4][NV];
            int s = 0;

            UNROLL (i, 4)
                UNROLL (j, NV)
                    part[i][j] = b.first || i > 0 ? (vf)(0.0f) : VLOAD(db + n + j * STEP_N);
            for (; s + 4 <= b.count; s += 4)
                UNROLL (i, 4)
                    UNROLL (j, NV)
                        part[i][j] += VLOAD(column + (s + i) * outputs + j * STEP_N);
            for (; s < b.count; s++)
                UNROLL (j, NV)
                    part[0][j] += VLOAD(column + s * outputs + j * STEP_N);
            UNROLL (j, NV)
                VSTORE_IN(LEAF_SPACE, (part[0][j] + part[1][j]) + (part[2][j] + part[3][j]),
                          db + n + j * STEP_N);
        }
    }
}

/* From gradients d [NB][outputs] of a layer's pre-activations to those of the trunk's layer
 * `below`, out [NB][WIDTH]. sigma: the density head's weights if `below` is the trunk's last layer,
 * which that head also reads, with gradients dhead; else 0. */
HELPER void layer_input_gradient(block b, kept_block kept, int below, const __local float *d,
                                 int outputs, const LEAF_SPACE float *wt,
                                 const __local float4 *dhead, const __global float *sigma,
                                 __local float *out)
{
    for (int n = b.lid * VW; n < WIDTH; n += TILE_N) {
        for (int t = 0; t < b.tiles; t++) {
            vf sum[TS][NV];

            UNROLL (i, TS)
                UNROLL (j, NV)
                    sum[i][j] = (vf)(0.0f);
            if (sigma)
                UNROLL (i, TS)
                    UNROLL (j, NV)
                        sum[i][j] = (vf)(dhead[t * TS + i].w) * VLOAD(sigma + n + j * STEP_N);
            TILE_MAD(TS, sum, d + t * TS * outputs, outputs, 1, wt + n, WIDTH, outputs)
            UNROLL (i, TS) {
                const int s = min(t * TS + i, b.count - 1);
                const uint key = block_slope_key(b, s, below);
                const __global kept_type *row = kept_row(kept, s, below);

                UNROLL (j, NV) {
                    const int m = n + j * STEP_N;

                    VSTORE_IN(__local, sum[i][j] * kept_gradient(row, key, m),
                              out + (t * TS + i) * WIDTH + m);
                }
            }
        }
    }
}

/* A head's rows: dw[r][n] (+)= sum_s dhead[s][k + r] in[s][n], r < rows <= 3. dhead: three
 * gradients of the colour, then the density's. */
HELPER void head_weight_gradient(block b, operand in, const __local float4 *dhead, int k, int rows,
                                 LEAF_SPACE float *dw)
{
    const __local float *d = (const __local float *)dhead + k;

    for (int n = b.lid * VW; n < in.rows; n += STEP_N) {
        vf part[4][3];
        int s = 0;

        UNROLL (i, 4)
            UNROLL (r, rows)
                part[i][r] = b.first || i > 0 ? (vf)(0.0f) : VLOAD(dw + r * in.rows + n);
        for (; s + 4 <= b.count; s += 4)
            UNROLL (i, 4) {
                const vf h = VLOAD(in.p + (s + i) * in.s_step + n);

                UNROLL (r, rows)
                    part[i][r] = MAD((vf)(d[(s + i) * 4 + r]), h, part[i][r]);
            }
        for (; s < b.count; s++) {
            const vf h = VLOAD(in.p + s * in.s_step + n);

            UNROLL (r, rows)
                part[0][r] = MAD((vf)(d[s * 4 + r]), h, part[0][r]);
        }
        UNROLL (r, rows)
            VSTORE_IN(LEAF_SPACE, (part[0][r] + part[1][r]) + (part[2][r] + part[3][r]),
                      dw + r * in.rows + n);
    }
}

/* The same for its biases, zero-padded to 16. */
HELPER void head_bias_gradient(block b, const __local float4 *dhead, int k, int rows,
                               LEAF_SPACE float *db)
{
    const __local float *d = (const __local float *)dhead + k;

    for (int r = b.lid; r < 16; r += LS) {
        float sum = b.first ? 0.0f : db[r];

        for (int s = 0; s < b.count && r < rows; s++)
            sum += d[s * 4 + r];
        db[r] = sum;
    }
}

/* out[s][n] = act'(x[s][n]) sum_k dhead[s][k] w[k][n] of the layer that the colour head reads, k
 * over its three rows. sigma: the density head's weights without view layer, when both heads read
 * the trunk's last layer; else 0. */
HELPER void head_input_gradient(block b, kept_block kept, int layer, int width,
                                const __local float4 *dhead, const __global float *w,
                                const __global float *sigma, __local float *out)
{
    for (int s = 0; s < b.tiles * TS; s++) {
        const int from = min(s, b.count - 1);
        const uint key = block_slope_key(b, from, layer);
        const __global kept_type *row = kept_row(kept, from, layer);
        const float4 g = dhead[s];

        for (int n = b.lid * VW; n < width; n += STEP_N) {
            vf sum = g.x * VLOAD(w + n);

            if (sigma)
                sum = MAD((vf)(g.x), VLOAD(w + n), g.w * VLOAD(sigma + n));
            sum = MAD((vf)(g.y), VLOAD(w + width + n), sum);
            sum = MAD((vf)(g.z), VLOAD(w + 2 * width + n), sum);
            VSTORE_IN(__local, sum * kept_gradient(row, key, n), out + s * width + n);
        }
    }
}
