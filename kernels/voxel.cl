/* needs: adam space vertices decoder */
/* Leaves without a network: voxels (method.md 1). A leaf is a grid of CELLS cells an axis; a vertex
 * has a density and spherical harmonics of three colours, both before their activations, linear
 * between vertices:
 *
 *   raw(x)  = sum over the cell's corners c of weight_c(x) vertex_c        [FEATURES]
 *   sigma   = KAPPA f(raw[3] + BIAS)
 *   colour  = sigmoid(raw[0..2] + sum_k Y_k(d) raw[4 + 3 (k - 1) ..] + decoder)
 *             1 <= k < (degree + 1)^2; decoder.h: what it adds, if there is one
 *
 * Vertices on faces are stored in each leaf that has them. Leaves of one size keep them equal: the
 * first of those around a vertex sums the gradients of all, steps, and writes the result to all.
 *
 *   voxel_density   as mlp_density.cl        voxel_forward   as mlp_forward.cl, to train
 *   voxel_samples   voxel_forward for pictures, without slices
 *   voxel_backward  gradients of slices, from roulette.cl's of the heads, and of the smoothness
 *   voxel_update    Adam's steps             voxel_split, voxel_join   after a change of the tree
 *
 *   CELLS FEATURES  cells an axis; numbers of a vertex, padded: 4 | 16 | 32 for degrees 0 | 1 | 2
 *   PARAMS          of a leaf: [CELLS + 1]^3 vertices (z, y, x) of FEATURES, padded
 *   SMOOTH 0 | 1, SMOOTH_DENSITY SMOOTH_COLOUR   weights of half of (p - q)^2 of neighbouring
 *                   vertices' numbers, in leaves of side 1/16
 *   BEND_DENSITY BEND_COLOUR   1 / delta^2, where these squares turn linear; 0: never
 *   MOMENTUM 0 | 1  no first moment (beta1 is 0) | Adam's
 *   EACH            leaves that a work-group of voxel_update takes one after another
 *   DENSITY_RATE    learning rate of densities, as a share of colours'
 */
#ifndef EACH
#define EACH 16
#endif
#ifndef MOMENTUM
#define MOMENTUM 1
#endif
#ifndef SMOOTH
#define SMOOTH 1
#endif
#ifndef DENSITY_RATE
#define DENSITY_RATE   4.0f
#define SMOOTH_DENSITY 4e-9f
#define SMOOTH_COLOUR  4e-9f
#define BEND_DENSITY   1.0f
#define BEND_COLOUR    10.0f
#endif

#define HARMONICS (FEATURES == 4 ? 1 : FEATURES == 16 ? 4 : 9)
#define STEP_Y    (SIDE * FEATURES)
#define STEP_Z    (SIDE * STEP_Y)
#define BLOCK     (LS == 1 ? 32 : VW) /* samples that a work-item takes at a time (fetch_cell) */
#define UP_TO(n)  (((n) + VW - 1) / VW * VW) /* whole vectors */
#define SMOOTH_EVERY 4u /* of so many leaves that samples met, one is smoothed, so much more */
#define SMOOTH_KEY   0x632BE5ABu

/* A sample's cell: its first number in a leaf's row, and the corners' weights, x fastest. */
typedef struct place {
    int first;
    float weight[8];
} place;

/* How many cells lie below a place (-1 .. 1) of a leaf, along an axis, and its own cell. */
#define CELLS_BELOW(type, at) \
    fmin(fmax(((at) + 1.0f) * (0.5f * CELLS), (type)(0.0f)), (type)(CELLS))
#define WHOLE_CELLS(type, below) fmin(floor(below), (type)(CELLS - 1))

/* places_of of one sample, over axes instead of samples: keep their formulas equal. */
HELPER place place_of(float3 at)
{
    const float3 x = CELLS_BELOW(float3, at), cell = WHOLE_CELLS(float3, x), far = x - cell;
    const float3 near = 1.0f - far;
    const float yz[4] = {near.y * near.z, far.y * near.z, near.y * far.z, far.y * far.z};
    place p;

    p.first = (((int)cell.z * SIDE + (int)cell.y) * SIDE + (int)cell.x) * FEATURES;
    UNROLL (i, 4) {
        p.weight[2 * i] = near.x * yz[i];
        p.weight[2 * i + 1] = far.x * yz[i];
    }
    return p;
}

/* The places of VW samples: of each, its cell's first number, and the weights [8][BLOCK]. */
HELPER void places_of(const float *at_x, const float *at_y, const float *at_z, int *first,
                      float *weight)
{
    const float *const at[3] = {at_x, at_y, at_z};
    vi cell[3];
    vf far[3], near[3];

    UNROLL (a, 3) {
        const vf x = CELLS_BELOW(vf, VLOAD(at[a])), whole = WHOLE_CELLS(vf, x);

        far[a] = x - whole;
        near[a] = 1.0f - far[a];
        cell[a] = V_TO_INT(whole);
    }
    VSTORE(((cell[2] * SIDE + cell[1]) * SIDE + cell[0]) * FEATURES, first);
    UNROLL (i, 4) {
        const vf yz = (i & 1 ? far[1] : near[1]) * (i & 2 ? far[2] : near[2]);

        VSTORE(near[0] * yz, weight + 2 * i * BLOCK);
        VSTORE(far[0] * yz, weight + (2 * i + 1) * BLOCK);
    }
}

/* Numbers from a cell's first vertex to its corner c. */
HELPER int corner_at(int c)
{
    return (c >> 2) * STEP_Z + (c >> 1 & 1) * STEP_Y + (c & 1) * FEATURES;
}

/* Fetches the numbers of a cell: a block's places are all known before the first is read. */
HELPER void fetch_cell(int first, const __global float *row, bool write)
{
#if FETCHES
    UNROLL (yz, 4)
        for (int f = 0; f < 2 * FEATURES; f += CACHE_LINE / 4)
            if (write)
                FETCH_WRITE(row + first + corner_at(2 * yz) + f);
            else
                FETCH(row + first + corner_at(2 * yz) + f);
#endif
}

/* The sample's place, -1 .. 1. */
HELPER float3 local_of_sample(sample_source from, uint id, float4 box, float3 *along)
{
    const cln_sample s = from.samples[id];
    const float4 o = from.ray_o[s.ray], d = from.ray_d[s.ray];

    *along = view_direction(o, d, box);
    return leaf_local(MAD((float4)(s.t), d, o), box).xyz;
}

HELPER place place_of_sample(sample_source from, uint id, float4 box, float3 *along)
{
    return place_of(local_of_sample(from, id, box, along));
}

/* Group g takes cells [g % per_leaf * cells, ...) of leaf first + g / per_leaf (mlp_density.cl). */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_density(LEAF_ARRAY(const float, params),       /* [row][PARAMS], row 0: leaf `own` */
              const __global float4 *restrict boxes, /* [leaf] min x, y, z, side */
              LEAF_ARRAY(ushort, density),           /* [leaf][n1^3] bfloat16 */
              uint n1, uint cells, uint per_leaf, uint jitter, uint2 seed, uint step, uint first,
              uint own)
{
    const uint group = get_group_id(0), leaf = first + group / per_leaf;
    const uint total = n1 * n1 * n1, begin = group % per_leaf * cells;
    const uint end = min(begin + cells, total);
    const __global float *w = LEAF_ROW(params, leaf - own, PARAMS);
    __global ushort *cached = LEAF_ROW(density, leaf, total);

    for (uint at = begin + get_local_id(0) * VW; at < end; at += STEP_N) {
        const int count = (int)min((uint)VW, end - at);
        float sigma[VW];

        for (int i = 0; i < VW; i++) {
            const uint cell = min(at + (uint)i, end - 1u);
            const float3 low = (float3)((float)(cell % n1), (float)(cell / n1 % n1),
                                        (float)(cell / (n1 * n1)));
            float4 xi = (float4)(0.5f);

            if (jitter)
                xi = uniform4(seed, STREAM_GRID, step, leaf * total + cell, 0u);
            const place p = place_of(2.0f * (low + xi.xyz) / (float)n1 - 1.0f);

            sigma[i] = 0.0f;
            UNROLL (c, 8)
                sigma[i] = MAD(p.weight[c], w[p.first + corner_at(c) + 3], sigma[i]);
        }
        VSTORE(density_value(VLOAD(sigma)), sigma);
        for (int i = 0; i < count; i++)
            cached[at + (uint)i] = bfloat16_nearest(sigma[i]);
    }
    (void)boxes;
}

/* A block of samples: their numbers, places in their leaves, directions; of each, its leaf's
 * numbers, its cell's first one there, and the corners' weights. */
typedef struct voxel_block {
    uint id[BLOCK];
    float at[3][BLOCK];
    float3 along[BLOCK];
    const __global float *row[BLOCK];
    int first[BLOCK];
    float weight[8 * BLOCK];
} voxel_block;

/* Finds the cells of the first `count` samples, and fetches their numbers. */
HELPER void block_places(voxel_block *b, int count)
{
    for (int i = 0; i < count; i += VW)
        places_of(b->at[0] + i, b->at[1] + i, b->at[2] + i, b->first + i, b->weight + i);
    for (int i = 0; i < count; i++)
        fetch_cell(b->first[i], b->row[i], false);
}

/* Colours and densities of the first `count` samples. features: the block's rows, kept to train. */
HELPER void block_forward(const voxel_block *b, int count, const __global float *net,
                          __global float *features, uint step_key, uint decode,
                          __global float4 *out)
{
    float raw[4][BLOCK];
#if DECODER
    float inputs[DECODER_IN * BLOCK];
#endif

    for (int i = 0; i < count; i++) {
        float f[FEATURES], y[HARMONICS];
        vf sum[FEATURES / VW];

        UNROLL (v, FEATURES / VW)
            sum[v] = (vf)(0.0f);
        UNROLL (c, 8)
            UNROLL (v, FEATURES / VW)
                sum[v] = MAD((vf)(b->weight[c * BLOCK + i]),
                             VLOAD(b->row[i] + b->first[i] + corner_at(c) + v * VW), sum[v]);
        UNROLL (v, FEATURES / VW)
            VSTORE(sum[v], f + v * VW);
#if DECODER
        if (decode) {
            decoder_inputs(f, b->along[i], BLOCK, inputs + i);
#if TRAIN
            UNROLL (v, FEATURES / VW)
                VSTORE_IN(__global, sum[v], features + (size_t)i * FEATURES + v * VW);
#endif
        }
#endif
        harmonics_of(b->along[i], HARMONICS, 1, y);
        UNROLL (k, HARMONICS - 1)
            UNROLL (a, 3)
                f[a] = MAD(y[k + 1], f[4 + 3 * k + a], f[a]);
        UNROLL (a, 4)
            raw[a][i] = f[a];
#if TRAIN && NOISE_ON
        raw[3][i] += NOISE * normal_number(step_key, b->id[i]);
#endif
    }
    for (int i = count; i < BLOCK; i++) {
        UNROLL (a, 4)
            raw[a][i] = 0.0f;
#if DECODER
        for (int k = 0; k < DECODER_IN; k++)
            inputs[k * BLOCK + i] = 0.0f;
#endif
    }
    for (int i = 0; i < count; i += VW) {
#if DECODER
        if (decode) {
            vf x[DECODER_IN], h[DECODER], sum[3];

            for (int k = 0; k < DECODER_IN; k++)
                x[k] = VLOAD(inputs + k * BLOCK + i);
            decoder_hidden(net, x, h);
            UNROLL (a, 3)
                sum[a] = VLOAD(raw[a] + i);
            for (int j = 0; j < DECODER; j++)
                UNROLL (a, 3)
                    sum[a] = MAD((vf)(net[DECODER_OUT + a * DECODER + j]), h[j], sum[a]);
            UNROLL (a, 3)
                VSTORE(sum[a], raw[a] + i);
        }
#endif
        UNROLL (a, 3)
            VSTORE(1.0f / (1.0f + EXP(-VLOAD(raw[a] + i))), raw[a] + i);
        VSTORE(density_value(VLOAD(raw[3] + i)), raw[3] + i);
    }
    for (int i = 0; i < count; i++)
        out[b->id[i]] = (float4)(raw[0][i], raw[1][i], raw[2][i], raw[3][i]);
    (void)net;
    (void)features;
    (void)step_key;
    (void)decode;
}

#if TRAIN
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_forward(LEAF_ARRAY(const float, params),             /* [row][PARAMS], row 0: leaf first */
              const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
              const __global cln_slice *restrict slices,   /* [slice] */
              const __global uint *restrict order,         /* [grouped sample] -> sample */
              const __global cln_sample *restrict samples, /* [sample] */
              const __global float4 *restrict ray_o,       /* [ray] */
              const __global float4 *restrict ray_d,       /* [ray] */
              __global float4 *restrict out,               /* [sample] r, g, b, sigma */
              const __global float *restrict net,          /* [DECODER_SIZE] */
              __global float *restrict features, /* [grouped sample][FEATURES], kept to train */
              uint n_slices, uint step_key, int first,
              uint decode) /* 0: the decoder adds 0, and is left out */
{
    const uint group = slice_of(slices, get_group_id(0), n_slices);

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group];
    const float4 box = boxes[slice.slot];
    const __global float *w = LEAF_ROW(params, slice.slot - first, PARAMS);
    const sample_source source = {samples, ray_o, ray_d};

    for (uint done = get_local_id(0) * BLOCK; done < slice.count; done += LS * BLOCK) {
        const int count = (int)min((uint)BLOCK, slice.count - done);
        const uint start = slice.start + done;
        voxel_block b;

        for (int i = 0; i < UP_TO(count); i++) {
            b.id[i] = order[start + (uint)min(i, count - 1)];
            const float3 at = local_of_sample(source, b.id[i], box, &b.along[i]);

            b.at[0][i] = at.x;
            b.at[1][i] = at.y;
            b.at[2][i] = at.z;
            b.row[i] = w;
        }
        block_places(&b, count);
        block_forward(&b, count, net, features + (size_t)start * FEATURES, step_key, decode,
                      out);
    }
}
#else
/* The same without training, of samples as they lie along rays: neighbours are in few leaves, so
 * nothing is gained by grouping them first. Group g takes those of samples [g each, (g + 1) each)
 * that are in leaves [first, first + own); the others' colours are left as they are. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_samples(LEAF_ARRAY(const float, params),             /* [row][PARAMS], row 0: leaf first */
              const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
              const __global cln_sample *restrict samples, /* [sample] */
              const __global float4 *restrict ray_o,       /* [ray] */
              const __global float4 *restrict ray_d,       /* [ray] */
              __global float4 *restrict out,               /* [sample] r, g, b, sigma */
              const __global float *restrict net,          /* [DECODER_SIZE] */
              uint n, uint each, uint first, uint own, uint decode)
{
    const uint begin = get_group_id(0) * each, end = min(begin + each, n);

    for (uint start = begin + get_local_id(0) * BLOCK; start < end; start += LS * BLOCK) {
        const uint after = min(start + BLOCK, end);
        cln_sample last = {0.0f, 0.0f, 0u, -1}; /* of the same ray and leaf? */
        float4 o, d, box;
        float3 along;
        float scale = 0.0f;
        const __global float *w = 0;
        int count = 0;
        voxel_block b;

        for (uint id = start; id < after; id++) {
            const cln_sample s = samples[id];

            if ((uint)s.slot - first >= own)
                continue;
            if (s.slot != last.slot || s.ray != last.ray) {
                o = ray_o[s.ray];
                d = ray_d[s.ray];
                box = boxes[s.slot];
                scale = leaf_scale(box);
                along = view_direction(o, d, box);
                w = LEAF_ROW(params, (uint)s.slot - first, PARAMS);
                last = s;
            }
            const float3 at = leaf_scaled(MAD((float4)(s.t), d, o), box, scale).xyz;

            b.id[count] = id;
            b.at[0][count] = at.x;
            b.at[1][count] = at.y;
            b.at[2][count] = at.z;
            b.along[count] = along;
            b.row[count] = w;
            count++;
        }
        for (int i = count; i < UP_TO(count); i++)
            UNROLL (a, 3)
                b.at[a][i] = 0.0f;
        block_places(&b, count);
        block_forward(&b, count, net, 0, 0u, decode, out);
    }
}
#endif

/* ---- backward ---- */

/* Weight of an edge from vertex (x, y, z) along axis a: leaves that share it add it once each. */
HELPER float edge_share(int3 at, int a)
{
    const bool x = at.x == 0 || at.x == CELLS, y = at.y == 0 || at.y == CELLS,
               z = at.z == 0 || at.z == CELLS;

    return (a != 0 && x ? 0.5f : 1.0f) * (a != 1 && y ? 0.5f : 1.0f) * (a != 2 && z ? 0.5f : 1.0f);
}

/* The slope of delta^2 (sqrt(1 + (d / delta)^2) - 1), which is half of d^2 while d is small. */
HELPER vf smooth_slope(vf d, vf bend)
{
    return d / sqrt(MAD(bend * d, d, (vf)(1.0f)));
}

/* Adds a sample's gradient d to its cell's corners: grad, a slice's [VERTICES][FEATURES], of which
 * `met` has the vertices that samples met, [SIDE * SIDE] bits. LS 1: begins those that none met. */
HELPER void add_to_corners(const place *p, const float *d, int lid, __global uint *met,
                           __global float *grad)
{
#if LS == 1
    UNROLL (c, 8) {
        const int at = p->first + corner_at(c);
        const int vertex = at / FEATURES, row = vertex / SIDE;
        const uint bit = 1u << vertex % SIDE;
        __global float *to = grad + at;

        if (met[row] & bit) {
            UNROLL (v, FEATURES / VW)
                VSTORE_IN(__global,
                          MAD((vf)(p->weight[c]), VLOAD(d + v * VW), VLOAD(to + v * VW)),
                          to + v * VW);
        } else {
            UNROLL (v, FEATURES / VW)
                VSTORE_IN(__global, p->weight[c] * VLOAD(d + v * VW), to + v * VW);
            met[row] |= bit;
        }
    }
#else
    /* each work-item takes one feature of the corners of one parity of every sample: no two
     * write one number */
    const int vertex = p->first / FEATURES;
    const int odd = vertex % SIDE % 2 + vertex / SIDE % SIDE % 2 * 2 +
                    vertex / (SIDE * SIDE) % 2 * 4;

    for (int j = lid; j < 8 * FEATURES; j += LS) {
        const int c = j / FEATURES ^ odd, f = j % FEATURES, at = p->first + corner_at(c);

        grad[at + f] = MAD(p->weight[c], d[f], grad[at + f]);
        if (f == 0)
            atomic_or(met + at / FEATURES / SIDE, 1u << at / FEATURES % SIDE);
    }
#endif
}

#if SMOOTH
/* Adds the gradient of the smoothness of a leaf of this side at the vertices that samples met. w:
 * the leaf's numbers. */
HELPER void add_smoothness(const __global float *w, float side, int lid, const __global uint *met,
                           __global float *grad)
{
    /* as many samples as its face is large */
    const float area = SMOOTH_EVERY * 256.0f * side * side;

    for (int v = lid; v < VERTICES; v += LS) {
        const int3 at = (int3)(v % SIDE, v / SIDE % SIDE, v / (SIDE * SIDE));
        const int c[3] = {at.x, at.y, at.z}, step[3] = {FEATURES, STEP_Y, STEP_Z};
        const __global float *p = w + v * FEATURES;
        __global float *g = grad + v * FEATURES;

        if (!(met[v / SIDE] >> v % SIDE & 1u))
            continue;
        UNROLL (f, FEATURES / VW) {
            vf sum = (vf)(0.0f);
            float weight[VW], bends[VW];

            UNROLL (i, VW) {
                weight[i] = area * (f * VW + i == 3 ? SMOOTH_DENSITY : SMOOTH_COLOUR);
                bends[i] = f * VW + i == 3 ? BEND_DENSITY : BEND_COLOUR;
            }
            const vf here = VLOAD(p + f * VW), bend = VLOAD(bends);

            for (int a = 0; a < 3; a++) {
                const float share = edge_share(at, a);

                if (c[a] > 0)
                    sum += share * smooth_slope(here - VLOAD(p + f * VW - step[a]), bend);
                if (c[a] < CELLS)
                    sum += share * smooth_slope(here - VLOAD(p + f * VW + step[a]), bend);
            }
            VSTORE_IN(__global, MAD(VLOAD(weight), sum, VLOAD(g + f * VW)), g + f * VW);
        }
    }
}
#endif

/* The gradient of a slice to grads [slice][PARAMS], of the vertices that samples are near: met
 * [slice][z][y], bit x. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_backward(LEAF_ARRAY(const float, params),             /* [row][PARAMS] */
               const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
               const __global cln_slice *restrict slices,   /* [slice] */
               const __global uint *restrict order,         /* [grouped sample] -> sample */
               const __global cln_sample *restrict samples, /* [sample] */
               const __global float4 *restrict ray_o,       /* [ray] */
               const __global float4 *restrict ray_d,       /* [ray] */
               const __global float4 *restrict heads,       /* [grouped sample], roulette.cl's */
               const __global uint *restrict chosen,        /* [grouped sample] of each slice */
               const __global uint *restrict chosen_counts, /* [slice] */
               LEAF_ARRAY(float, grads), __global uint *restrict met, uint n_slices,
               const __global uint *restrict begin,
               const __global float *restrict feature_grads, /* [grouped sample][FEATURES] */
               uint step_key, int first, uint decode)
{
    const uint group = slice_of(slices, get_group_id(0), n_slices);
    const int lid = (int)get_local_id(0);

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group];

    if (slice.count == 0u)
        return;
    const __global float *w = LEAF_ROW(params, slice.slot - first, PARAMS);
    __global float *grad = SLICE_ROW(grads, group, PARAMS);
    __global uint *mine = met + (size_t)group * SIDE * SIDE;
    const float4 box = boxes[slice.slot];
    const uint all = chosen_counts[group];
    const sample_source source = {samples, ray_o, ray_d};

    for (int row = lid; row < SIDE * SIDE; row += LS)
        mine[row] = 0u;
#if LS > 1
    for (int p = lid; p < VERTICES * FEATURES; p += LS)
        grad[p] = 0.0f;
    barrier(CLK_GLOBAL_MEM_FENCE);
#endif
    place p[BLOCK];
    float3 along[BLOCK];

    for (uint i = 0; i < all; i++) {
        const uint k = i % BLOCK;

        if (k == 0u)
            for (uint b = 0; b < min((uint)BLOCK, all - i); b++) {
                p[b] = place_of_sample(source, order[slice.start + chosen[slice.start + i + b]],
                                       box, &along[b]);
                fetch_cell(p[b].first, grad, true);
            }
        const float4 head = heads[slice.start + i];
        float d[FEATURES], y[HARMONICS];

        harmonics_of(along[k], HARMONICS, 1, y);
        UNROLL (f, FEATURES)
            d[f] = 0.0f;
        d[0] = head.x;
        d[1] = head.y;
        d[2] = head.z;
        d[3] = head.w;
        UNROLL (h, HARMONICS - 1)
            UNROLL (a, 3)
                d[4 + 3 * h + a] = y[h + 1] * d[a];
#if DECODER
        if (decode) {
            UNROLL (f, FEATURES)
                d[f] += feature_grads[(size_t)(slice.start + i) * FEATURES + f];
        }
#endif
        add_to_corners(&p[k], d, lid, mine, grad);
    }
#if SMOOTH
#if LS > 1
    barrier(CLK_GLOBAL_MEM_FENCE);
#endif
    if (slice.start == begin[slice.slot] &&
        !(hash_one((step_key ^ SMOOTH_KEY) + (uint)slice.slot * 0x9E3779B9u) & (SMOOTH_EVERY - 1u)))
        add_smoothness(w, box.w, lid, mine, grad);
#endif
    (void)w;
    (void)begin;
    (void)feature_grads;
    (void)decode;
}

/* ---- update ---- */

#define LANES (LS < FEATURES / VW ? LS : FEATURES / VW) /* work-items of a vertex */

/* The leaves that share vertices: a leaf and those around it that have them, too. */
typedef struct sharers {
    int count;               /* 0: another leaf is the first of them, and steps for all */
    int row[8], shift[8];    /* row: of its weights, -1 if another rank has them; shift: what to
                              * add to a vertex' number in the own leaf */
    int side[8];             /* along x: -1, 0, 1 */
    uint first[8], last[8];  /* their slices */
} sharers;

/* What the update of a leaf needs to know. */
typedef struct leaf_update {
    sharers by_face[27];
    uint met[SIDE * SIDE]; /* vertices to step: bit x of row z SIDE + y */
} leaf_update;

/* Of vertices inside the leaf (0), on its lower (-1) or upper face (1) along each axis. near [27]:
 * neighbours. */
HELPER void find_sharers(const __global int *near, leaf_slices of, int3 face, __local sharers *s)
{
    s->count = 0;
    for (int z = min(face.z, 0); z <= max(face.z, 0); z++)
        for (int y = min(face.y, 0); y <= max(face.y, 0); y++)
            for (int x = min(face.x, 0); x <= max(face.x, 0); x++) {
                const int n = 13 + (z * 3 + y) * 3 + x, leaf = near[n], k = s->count;

                if (leaf < 0)
                    continue;
                if (n < 13) {
                    s->count = 0;
                    return;
                }
                const uint2 slices = slices_of(of, leaf);

                s->row[k] = is_here(of, leaf) ? leaf - (int)of.first : -1;
                s->shift[k] = -((z * SIDE + y) * SIDE + x) * CELLS;
                s->side[k] = x;
                s->first[k] = slices.x;
                s->last[k] = slices.y;
                s->count++;
            }
}

/* Whether, and from `vertex` on along x where, samples met vertices in the sharers on one side:
 * bits. */
HELPER uint met_beside(const __global uint *met, const __local sharers *s, int side, int vertex)
{
    uint bits = 0u;

    for (int i = 0; i < s->count; i++)
        if (s->side[i] == side)
            for (uint slice = s->first[i]; slice < s->last[i]; slice++)
                bits |= met_from(met, slice, vertex + s->shift[i]);
    return bits;
}

/* The sharers of a row's vertices at its lower end (-1), between the ends, at the upper one. */
HELPER const __local sharers *sharers_of(const __local leaf_update *u, int row, int end)
{
    return &u->by_face[13 + (face_of(row / SIDE) * 3 + face_of(row % SIDE)) * 3 + end];
}

HELPER void find_update(const __global uint *met, const __global int *near, leaf_slices of,
                        __local leaf_update *u)
{
    const int lid = (int)get_local_id(0);

    for (int n = lid; n < 27; n += LS)
        find_sharers(near, of, (int3)(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1), &u->by_face[n]);
    GROUP_SYNC();
    for (int row = lid; row < SIDE * SIDE; row += LS) {
        const __local sharers *low = sharers_of(u, row, -1), *high = sharers_of(u, row, 1);
        uint bits = met_beside(met, sharers_of(u, row, 0), 0, row * SIDE) & ((1u << SIDE) - 1u);

        bits |= met_beside(met, low, -1, row * SIDE) & 1u;
        bits |= (met_beside(met, high, 1, row * SIDE + CELLS) & 1u) << CELLS;
        if (low->count == 0)
            bits &= ~1u;
        if (high->count == 0)
            bits &= ~(1u << CELLS);
        u->met[row] = bits;
    }
    GROUP_SYNC();
}

/* A step of numbers p .. p + VW - 1 of a vertex: Adam's (adam.h), but steps of the vertex alone
 * count. So there is no number of steps to correct moments by: the second begins as a tenth of the
 * first gradient's square (method.md 1), the first, if there is one, as 0. key: of the random
 * numbers that round moments. */
HELPER vf voxel_step(vf rate, uint key, vf g, uint p, __global float *params,
                     __global moment_type *m, __global moment_type *v)
{
    const vf before = moment_load(v + p), square = g * g;
    const vf v1 = select(MAD((vf)(BETA2), before, (1.0f - BETA2) * square), 0.1f * square,
                         before == (vf)(0.0f));
    const vu chance = hash_lanes((p + V_IOTA) * 0x9E3779B9u ^ key);
#if MOMENTUM
    const vf m1 = MAD((vf)(BETA1), moment_load(m + p), (1.0f - BETA1) * g);
#else
    const vf m1 = g;
#endif
    const vf w = VLOAD(params + p) - rate * m1 / (sqrt(v1) + EPSILON);

#if MOMENTUM
    moment_store(m1, chance & 0xFFFFu, m + p);
#endif
    moment_store(v1, chance >> 16, v + p);
    VSTORE_IN(__global, w, params + p);
    return w;
}

/* Of numbers f .. f + VW - 1 of vertex `at`: the sum over the sharers of their sums over slices. */
HELPER vf shared_gradient(const __local sharers *s, const __global uint *met,
                          LEAF_ARRAY(const float, grads), int at, int f)
{
    vf all = (vf)(0.0f);

    for (int i = 0; i < s->count; i++) {
        const int v = at + s->shift[i];
        vf sum = (vf)(0.0f);

        for (uint slice = s->first[i]; slice < s->last[i]; slice++)
            if (met_from(met, slice, v) & 1u)
                sum += VLOAD(SLICE_ROW(grads, slice, PARAMS) + v * FEATURES + f);
        all += sum;
    }
    return all;
}

#if FETCHES
/* Fetches what the update of a leaf, row `leaf` of its arrays, will read of a row of vertices. */
HELPER void fetch_update(const __local leaf_update *u, int row, uint leaf,
                         LEAF_ARRAY(const float, grads), LEAF_ARRAY(float, params),
                         LEAF_ARRAY(moment_type, m), LEAF_ARRAY(moment_type, v))
{
    for (uint bits = u->met[row]; bits;) {
        const int x = 31 - (int)clz(bits), at = row * SIDE + x;
        const __local sharers *s = sharers_of(u, row, face_of(x));

        bits ^= 1u << x;
        for (int f = 0; f < FEATURES; f += CACHE_LINE / 4) {
            const int p = at * FEATURES + f;

            FETCH_WRITE(LEAF_ROW(params, leaf, PARAMS) + p);
#if MOMENTUM
            FETCH_WRITE(LEAF_ROW(m, leaf, PARAMS) + p);
#endif
            FETCH_WRITE(LEAF_ROW(v, leaf, PARAMS) + p);
            for (int i = 0; i < s->count; i++)
                if (s->first[i] < s->last[i])
                    FETCH(SLICE_ROW(grads, s->first[i], PARAMS) + p + s->shift[i] * FEATURES);
        }
    }
}
#endif

/* Leaf around[leaf][13 + (dz * 3 + dy) * 3 + dx] is the neighbour of this size there, or -1. A
 * work-group updates EACH of the `own` leaves from `first` on, by the rate lr, and times
 * harmonic_rate for a_k, k > 0. A gradient is the sum over leaves of their sums over slices, of
 * which other ranks' leaves have one (halo.cl). What a leaf's update reads is fetched during the
 * one before, row by row. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_update(const __global uint *restrict slice_starts, /* [leaf + 1] */
             LEAF_ARRAY(const float, grads),             /* [slice][PARAMS] */
             const __global uint *restrict met,          /* [slice][SIDE * SIDE] */
             const __global int *restrict around,        /* [leaf][27] */
             LEAF_ARRAY(float, params), LEAF_ARRAY(moment_type, m), LEAF_ARRAY(moment_type, v),
             const __global uint *restrict far, /* [leaf]; not read if all leaves are here */
             uint first, uint own, float lr, float harmonic_rate, uint step_key)
{
    __local leaf_update updates[1 + FETCHES]; /* of this leaf, and of the next to fetch for */
    const leaf_slices of = {slice_starts, far, first, own};
    const uint from = first + get_group_id(0) * EACH, to = min(from + EACH, first + own);
    const int lid = (int)get_local_id(0);
    vf rate[FEATURES / VW];

    UNROLL (f, FEATURES / VW) {
        float lanes[VW];

        UNROLL (i, VW)
            lanes[i] = f * VW + i == 3 ? DENSITY_RATE : f * VW + i > 3 ? harmonic_rate : 1.0f;
        rate[f] = lr * VLOAD(lanes);
    }
    if (FETCHES && from < to)
        find_update(met, around + from * 27u, of, &updates[from & FETCHES]);
    for (uint leaf = from; leaf < to; leaf++) {
        const uint key = hash_one(step_key ^ leaf * 0xC2B2AE35u), ahead = leaf + FETCHES;
        const __local leaf_update *u = &updates[leaf & FETCHES];
        __global float *w_row = LEAF_ROW(params, leaf - first, PARAMS);
        __global moment_type *m_row = LEAF_ROW(m, leaf - first, PARAMS);
        __global moment_type *v_row = LEAF_ROW(v, leaf - first, PARAMS);

        GROUP_SYNC(); /* the leaf before is done */
        if (ahead < to)
            find_update(met, around + ahead * 27u, of, &updates[ahead & FETCHES]);
        for (int row = lid / LANES; row < SIDE * SIDE; row += LS / LANES) {
#if FETCHES
            if (ahead < to)
                fetch_update(&updates[ahead & FETCHES], row, ahead - first, LEAF_PASS(grads),
                             LEAF_PASS(params), LEAF_PASS(m), LEAF_PASS(v));
#endif
            for (uint bits = u->met[row]; bits;) {
                const int x = 31 - (int)clz(bits), at = row * SIDE + x;
                const __local sharers *s = sharers_of(u, row, face_of(x));

                bits ^= 1u << x;
                for (int f = lid % LANES * VW; f < FEATURES; f += LANES * VW) {
                    const uint p = (uint)(at * FEATURES + f);
                    const vf g = shared_gradient(s, met, LEAF_PASS(grads), at, f);
                    const vf w = voxel_step(rate[f / VW], key, g, p, w_row, m_row, v_row);

                    for (int i = 1; i < s->count; i++)
                        if (s->row[i] >= 0)
                            VSTORE_IN(__global, w,
                                      LEAF_ROW(params, s->row[i], PARAMS) +
                                          (at + s->shift[i]) * FEATURES + f);
                }
            }
        }
    }
}

/* Gives leaves that a split made their numbers: those of the old leaf where it has a vertex, and
 * means of its nearest ones between these. places [leaf]: kernels/carry.cl. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_split(LEAF_ARRAY(const float, from), /* [old leaf][PARAMS] */
            LEAF_ARRAY(float, params),     /* [leaf][PARAMS] */
            const __global int2 *restrict places)
{
    const uint leaf = get_group_id(0);
    const int2 place = places[leaf];

    if (place.y < 0)
        return;
    const __global float *old = LEAF_ROW(from, place.x, PARAMS);
    __global float *new = LEAF_ROW(params, leaf, PARAMS);
    const int x0 = place.y & 1 ? CELLS : 0, y0 = place.y & 2 ? CELLS : 0,
              z0 = place.y & 4 ? CELLS : 0;

    for (int v = (int)get_local_id(0); v < VERTICES; v += LS) {
        const int x = x0 + v % SIDE, y = y0 + v / SIDE % SIDE, z = z0 + v / (SIDE * SIDE);

        for (int f = 0; f < FEATURES; f += VW) {
            vf n[8];

            UNROLL (c, 8)
                n[c] = VLOAD(old + (z + (c >> 2)) / 2 * STEP_Z + (y + (c >> 1 & 1)) / 2 * STEP_Y +
                             (x + (c & 1)) / 2 * FEATURES + f);
            VSTORE_IN(__global,
                      0.125f * (((n[0] + n[1]) + (n[2] + n[3])) + ((n[4] + n[5]) + (n[6] + n[7]))),
                      new + v * FEATURES + f);
        }
    }
}

#define FRESH (-10) /* CLN_FRESH */

/* Whose numbers hold at a common vertex after a change of the tree: 0: a leaf that stayed; 1: one
 * that was split or merged; 2: one that begins anew. */
HELPER int join_rank(int octant)
{
    return octant == -1 ? 0 : octant == FRESH ? 2 : 1;
}

/* After a change of the tree, gives leaves of one size the same numbers at common vertices: those
 * of the leaf of lowest rank, the first of these in the order of `around`. That leaf keeps its own,
 * so none reads what another writes. places [leaf]: kernels/carry.cl. Here are the `own` leaves
 * from `first` on; numbers of others have come before (halo.cl). */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
voxel_join(const __global int *restrict around,  /* [leaf][27] */
           const __global int2 *restrict places, /* [leaf] */
           LEAF_ARRAY(float, params), uint first, uint own)
{
    const uint leaf = first + get_group_id(0);
    const __global int *near = around + leaf * 27u;

    if (join_rank(places[leaf].y) == 0)
        return;
    for (int v = (int)get_local_id(0); v < VERTICES; v += LS) {
        const int3 face = faces_of(v);
        int best = -1, rank = 3, there = v;

        for (int z = min(face.z, 0); z <= max(face.z, 0); z++)
            for (int y = min(face.y, 0); y <= max(face.y, 0); y++)
                for (int x = min(face.x, 0); x <= max(face.x, 0); x++) {
                    const int other = near[13 + (z * 3 + y) * 3 + x];

                    if (other >= 0 && join_rank(places[other].y) < rank) {
                        best = other;
                        rank = join_rank(places[other].y);
                        there = v - ((z * SIDE + y) * SIDE + x) * CELLS;
                    }
                }
        if (best == (int)leaf || (uint)best - first >= own)
            continue;
        for (int f = 0; f < FEATURES; f++)
            LEAF_ROW(params, leaf - first, PARAMS)[v * FEATURES + f] =
                LEAF_ROW(params, best - (int)first, PARAMS)[there * FEATURES + f];
    }
}
