/* What the leaf networks' kernels share (mlp.cl): parameters, the register tile, activations, encodings, samples in
 * their leaf. Layout: host/model/network.h; float64 twin: host/reference/network.c.
 *
 * Encodings stand row by row, so that lanes run over samples where they are made; the tile reads them with other
 * strides.
 *
 * Parameters, from the host (pipeline/programs.c); the defaults below let the file compile alone.
 *   VW NV LS TS NB   lanes.h; vectors per tile; work-items; samples per tile; samples in local memory
 *   WIDTH DEPTH BANDS ENC_PAD SKIP   trunk; SKIP = layer that reads the encoding again, or -1
 *   VIEW VIEW_BANDS DIR_PAD          view layer; VIEW 0 = none
 *   COLOUR                           inputs of the colour head: VIEW, or WIDTH without view layer
 *   SIGMA_W SIGMA_B VIEW_W VIEW_B COLOUR_W COLOUR_B PARAMS   offsets, floats
 *   DENSITY 0 softplus | 1 relu | 2 exp;  KAPPA BIAS: sigma = KAPPA f(s + BIAS)
 *   SLOPE_LOWER SLOPE_UPPER, RRELU 0 element | 1 neuron | 2 mean;  BANDS_BY_LEVEL 0 | 1
 *   NOISE_ON 0 | 1, NOISE   density noise in training: left out or not; its std
 *   HALF 0 | 1   pre-activations are kept for the way back as 32 or as 16 bits
 *   LEAF 0 | 1   a leaf's gradient and transposed weights: in global memory, or in a work-group's local memory
 */
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
#ifndef LEAF
#define LEAF 1
#endif

/* Offsets of the trunk's layers. Formulas, no tables: a table of pointers into local memory is more than PoCL 3.1 can
 * compile. */
#define TRUNK_W(i)                                                                                 \
    ((i) == 0 ? 0                                                                                  \
              : (ENC_PAD + 1 + ((i) - 1) * (WIDTH + 1) + (SKIP >= 0 && (i) > SKIP ? ENC_PAD : 0)) * \
                    WIDTH)
#define TRUNK_B(i) (TRUNK_W((i) + 1) - WIDTH)
#define VIEW_ROWS  (WIDTH + DIR_PAD)

/* A transposed copy of the trunk's layers from the second on, and of the view layer, first WIDTH rows each. */
#define WT_TRUNK(i) (((i) - 1) * WIDTH * WIDTH)
#define WT_VIEW ((DEPTH - 1) * WIDTH * WIDTH)
#define WT_PARAMS ((DEPTH - 1) * WIDTH * WIDTH + VIEW * WIDTH)

#define TK 4                       /* rows of a weight-gradient tile; every K is a multiple of it */
#define STEP_N (LS * VW)           /* distance of a work-item's vectors */
#define TILE_N (LS * VW * NV)      /* neurons of one tile, over the group */
/* Pre-activations kept of each grouped sample: of the trunk's layers, then of the view layer. */
#define ACTS (DEPTH * WIDTH + VIEW)
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
#define KEPT_STORE(v, p) VSTORE_IN(__global, v, p)
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

/* Fetches rows from .. to - 1 of a tile's columns at w, `columns` floats apart. */
HELPER void fetch_rows(const __global float *w, int columns, int from, int to)
{
    for (int r = from; r < to; r++)
        for (int j = 0; j < NV * VW; j += FETCH_FLOATS)
            FETCH(w + r * columns + j);
}

/* Lines of the cache that are one of `shares` shares of n elements at p, rounded up. */
#define LINE_OF(p)               ((int)(64 / sizeof *(p)))
#define SHARE_OF(p, n, shares)   (((n) + LINE_OF(p) * (shares)-1) / (LINE_OF(p) * (shares)))
#define FETCH_SHARE(p, lines, i)                                                                   \
    for (int l_ = 0; l_ < (lines); l_++)                                                           \
        FETCH((p) + ((i) * (lines) + l_) * LINE_OF(p));

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

/* The larger of the two, as no slope is above 1: one instruction less than to ask for x > 0. */
HELPER vf activate(vf x, vf slope)
{
    const vf below = x * slope;

    return select(below, x, x > below);
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

            VSTORE_IN(__local, value, out + a * NB + s);
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
                VSTORE_IN(__local, sine * weight, out + (3 + 6 * k + a) * NB + s);
                VSTORE_IN(__local, cosine * weight, out + (6 + 6 * k + a) * NB + s);
            }
        }
        for (int row = 3 + 6 * bands; row < pad; row++)
            VSTORE_IN(__local, (vf)(0.0f), out + row * NB + s);
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

/* The slice of a work-group. Those at the end are empty (group.cl), and come first: a driver that deals out groups in ever
 * smaller parts would end with nothing to balance. */
HELPER uint slice_of(const __global cln_slice *slices, uint group, uint n_slices)
{
    const uint used = slices[0].used;

    return group + used < n_slices ? group + used : group + used - n_slices;
}

/* ---- samples: where they are, in their leaf ---- */

/* Local position at [3][NB], direction along [3][NB] of `rows` samples, whose numbers this work-item has put into ids. */
HELPER void load_samples(const __global cln_sample *samples, const __global float4 *ray_o,
                         const __global float4 *ray_d, float4 box, int rows,
                         const __local uint *ids, __local float *at, __local float *along, int lid)
{
    const float scale = 2.0f / box.w;

    /* one kind of load at a time, so that many are under way together */
    for (int s = lid; s < rows; s += LS) {
        const cln_sample sample = samples[ids[s]];

        at[s] = sample.t;
        at[NB + s] = as_float(sample.ray);
    }
    for (int s = lid; s < rows; s += LS) {
        const uint ray = as_uint(at[NB + s]);
        const float4 d = ray_d[ray];
        const float4 p = (MAD((float4)(at[s]), d, ray_o[ray]) - box) * scale - 1.0f;

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
