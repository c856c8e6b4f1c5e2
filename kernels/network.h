/* needs: rng */
/* The leaf networks' constants and scalar functions: layout of the parameters, activation, density.
 * For the layers (layer.h), adam.h and roulette.cl. Layout: host/model/network.h; float64 twin:
 * host/reference/network.c.
 *
 * From the host (pipeline/programs.c); the defaults below let the file compile alone.
 *   VW NV LS TS NB   lanes.h; vectors per tile; work-items; samples per tile; samples of a block
 *   WIDTH DEPTH BANDS ENC_PAD SKIP   trunk; SKIP: the layer that reads the encoding again, or -1
 *   VIEW VIEW_BANDS DIR_PAD          view layer; VIEW 0: none
 *   COLOUR                           inputs of the colour head: VIEW, or WIDTH without view layer
 *   SIGMA_W SIGMA_B VIEW_W VIEW_B COLOUR_W COLOUR_B PARAMS   offsets, floats
 *   DENSITY 0 softplus | 1 relu | 2 exp;  KAPPA BIAS: sigma = KAPPA f(s + BIAS)
 *   SLOPE_LOWER SLOPE_UPPER, RRELU 0 element | 1 neuron | 2 mean;  BANDS_BY_LEVEL 0 | 1
 *   NOISE_ON 0 | 1, NOISE   density noise in training: off | on; its standard deviation
 *   TRAIN 0 | 1  evaluation: the mean slope | training: random slopes, noise, kept activations
 *   HALF 0 | 1   pre-activations kept for the backward pass have 32 | 16 bits
 *   ENCODING 0 frequency | 1 grid | 2 voxel;  CELLS FEATURES GRID_W: encoding_grid.h, voxel.cl.
 *                GRID_W is also where the layers end
 *   LEAF 0 | 1   a leaf's gradient and transposed weights are in global | local memory
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
#define CELLS 4
#define FEATURES 16
#define GRID_W 1104
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
#ifndef ENCODING
#define ENCODING 0
#endif
#if DENSITY > 2 || RRELU > 2
#error "no code for this DENSITY or RRELU"
#endif
/* Rows of a sample's position, which the grid encoding replaces by its place in the grid. */
#define AT_ROWS (ENCODING == 1 ? 4 : 3)
#ifndef LEAF
#define LEAF 1
#endif
#ifndef TRAIN
#define TRAIN 1
#endif

/* Offsets of the trunk's layers, as formulas: PoCL 3.1 cannot compile a table of pointers into
 * local memory. */
#define BEFORE_SKIP(i) (SKIP < 0 || (i) <= SKIP)
#define TRUNK_W(i)                                                                            \
    ((i) == 0 ? 0                                                                             \
              : (ENC_PAD + 1 + ((i)-1) * (WIDTH + 1) + (BEFORE_SKIP(i) ? 0 : ENC_PAD)) * WIDTH)
#define TRUNK_B(i) (TRUNK_W((i) + 1) - WIDTH)
#define VIEW_ROWS  (WIDTH + DIR_PAD)

/* The transposed copy: first WIDTH rows of the trunk's layers from the second on, and of the view
 * layer. */
#define WT_TRUNK(i) (((i) - 1) * WIDTH * WIDTH)
#define WT_VIEW ((DEPTH - 1) * WIDTH * WIDTH)
#define WT_PARAMS ((DEPTH - 1) * WIDTH * WIDTH + VIEW * WIDTH)

#define STEP_N (LS * VW)      /* distance between a work-item's vectors */
#define TILE_N (LS * VW * NV) /* neurons of one tile, over the group */
#define TILE_K 4              /* rows of a weight gradient's tile; every K is a multiple of it */

/* Pre-activations kept per grouped sample: of the trunk's layers, then of the view layer (layer
 * DEPTH). */
#define ACTS (DEPTH * WIDTH + VIEW)

#if WIDTH % (VW * NV * LS) || (VIEW > 0 && VIEW % (VW * NV * LS))
#error "VW * NV * LS must divide WIDTH and VIEW"
#endif
#if NB % TS || NB % VW
#error "TS and VW must divide NB"
#endif

/* Kept pre-activations in memory: OpenCL 1.2 can load and store halves without half arithmetic. */
#if HALF
#define kept_type   half
#define HALF_MOST   65504.0f /* beyond is infinity, which the backward pass makes NaN */
#define IN_HALF(v)  fmax(fmin(v, (vf)(HALF_MOST)), (vf)(-HALF_MOST))
#if VW == 1
#define KEPT_LOAD(p)     vload_half(0, p)
#define KEPT_STORE(v, p) vstore_half(IN_HALF(v), 0, p)
#else
#define KEPT_LOAD(p)     CLN_PASTE(vload_half, VW)(0, p)
#define KEPT_STORE(v, p) CLN_PASTE(vstore_half, VW)(IN_HALF(v), 0, p)
#endif
#else
#define kept_type        float
#define KEPT_LOAD(p)     VLOAD(p)
#define KEPT_STORE(v, p) VSTORE_IN(__global, v, p)
#endif

#if LS > 1
#define GROUP_SYNC() barrier(CLK_LOCAL_MEM_FENCE)
#else
#define GROUP_SYNC()
#endif

/* ---- activation: RReLU, with a random slope below zero in training ---- */

/* Key of a layer's slopes: of this sample (element) or of all samples of the step (neuron). */
HELPER uint slope_key(uint step_key, uint sample, uint layer)
{
#if RRELU == 0
    return (step_key + sample * 0x85EBCA6Bu) ^ (layer * 0xC2B2AE35u + 0x165667B1u);
#else
    return step_key ^ (layer * 0xC2B2AE35u + 0x165667B1u);
#endif
}

/* Slopes of neurons `neuron` .. neuron + VW - 1. */
HELPER vf negative_slope(uint key, int neuron)
{
#if RRELU == 2 || !TRAIN
    return (vf)(0.5f * (SLOPE_LOWER + SLOPE_UPPER));
#else
    return MAD(uniform_lanes(key, (uint)neuron), (vf)(SLOPE_UPPER - SLOPE_LOWER),
               (vf)(SLOPE_LOWER));
#endif
}

/* The larger of x and slope * x, as no slope exceeds 1: one instruction fewer than a test of x. */
HELPER vf activate(vf x, vf slope)
{
    const vf below = x * slope;

    return select(below, x, x > below);
}

HELPER vf activate_gradient(vf x, vf slope)
{
    return select(slope, (vf)(1.0f), x > (vf)(0.0f));
}

/* ---- density ---- */

/* sigma of the density head's raw output. select() keeps a NaN, fmax and fmin would hide it. */
HELPER vf density_value(vf z)
{
    z += BIAS;
#if DENSITY == 0
    const vf e = EXP(-fabs(z)); /* log(1 + e): a series where the sum would round e away */
    const vf series =
        e * MAD(e, MAD(e, MAD(e, MAD(e, (vf)(0.2f), (vf)(-0.25f)), (vf)(0.33333333f)), (vf)(-0.5f)),
                (vf)(1.0f));

    return KAPPA * (select((vf)(0.0f), z, !(z <= 0.0f)) + select(LOG(1.0f + e), series, e < 0.06f));
#elif DENSITY == 1
    return KAPPA * select((vf)(0.0f), z, !(z <= 0.0f));
#else
    return KAPPA * EXP(select(z, (vf)(70.0f), z > 70.0f)); /* finite for every KAPPA */
#endif
}

/* d sigma / d raw, computed from sigma. */
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

/* ---- slices ---- */

/* The slice of a work-group. Empty slices are at the end of the list (group.cl) but are taken
 * first: drivers that hand out ever smaller portions of groups need full ones at the end to balance
 * the load. */
HELPER uint slice_of(const __global cln_slice *slices, uint group, uint n_slices)
{
    const uint used = slices[0].used;

    return group + used < n_slices ? group + used : group + used - n_slices;
}
