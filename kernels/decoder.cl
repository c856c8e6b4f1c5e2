/* needs: space leaves decoder */
/* The decoder's gradient and its step (decoder.h). Runs between roulette.cl and voxel.cl's backward
 * pass, which takes the features' gradients from here.
 *
 * A work-group takes CLN_DECODER_EACH slices, LS * VW samples at a time, and sums the weights'
 * gradient over them; decoder_update adds the groups' sums in order and takes Adam's step. */

#ifndef EPSILON
#define EPSILON 1e-10f
#endif
#define DECODER_BETA1 0.9f
#define DECODER_BETA2 0.99f

#if LS == 1 /* a weight's sum stays in lanes until the end */
#define SUM_LANES VW
#else
#define SUM_LANES 1
#endif

/* sum += a row [LS][VW]. */
HELPER void add_row(const __local float *a, __local float *sum)
{
#if LS == 1
    VSTORE_IN(__local, VLOAD(a) + VLOAD(sum), sum);
#else
    vf all = (vf)(0.0f);

    for (int l = 0; l < LS; l++)
        all += VLOAD(a + l * VW);
    *sum += V_SUM(all);
#endif
}

/* sum += the products of two rows [LS][VW], over all samples of the block. */
HELPER void add_products(const __local float *a, const __local float *b, __local float *sum)
{
#if LS == 1
    VSTORE_IN(__local, MAD(VLOAD(a), VLOAD(b), VLOAD(sum)), sum);
#else
    vf products = (vf)(0.0f);

    for (int l = 0; l < LS; l++)
        products = MAD(VLOAD(a + l * VW), VLOAD(b + l * VW), products);
    *sum += V_SUM(products);
#endif
}

/* From each slice's start on, feature_grads gets the samples that take part; 0 for densities. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
decoder_backward(const __global float *restrict net,          /* [DECODER_SIZE] */
                 const __global float4 *restrict boxes,       /* [leaf] min x, y, z, side */
                 const __global cln_slice *restrict slices,   /* [slice] */
                 const __global uint *restrict order,         /* [grouped sample] -> sample */
                 const __global cln_sample *restrict samples, /* [sample] */
                 const __global float4 *restrict ray_o,       /* [ray] */
                 const __global float4 *restrict ray_d,       /* [ray] */
                 const __global float4 *restrict heads,       /* [grouped sample], roulette.cl's */
                 const __global uint *restrict chosen,        /* [grouped sample] of each slice */
                 const __global uint *restrict chosen_counts, /* [slice] */
                 const __global float *restrict features, /* [grouped sample][FEATURES], kept */
                 __global float *restrict feature_grads,  /* [grouped sample][FEATURES] */
                 __global float *restrict grads,              /* [group][DECODER_SIZE] */
                 uint n_slices)
{
    __local float x[DECODER_IN * LS * VW], h[DECODER * LS * VW], d[3 * LS * VW];
    __local float sums[DECODER_SIZE * SUM_LANES];
    const uint group = get_group_id(0), begin = group * CLN_DECODER_EACH;
    const int lid = (int)get_local_id(0), own = lid * VW;

    for (int i = lid; i < DECODER_SIZE * SUM_LANES; i += LS)
        sums[i] = 0.0f;
    for (uint s = begin; s < min(begin + CLN_DECODER_EACH, n_slices); s++) {
        const cln_slice slice = slices[s];
        const uint all = slice.count ? chosen_counts[s] : 0u;
        const float4 box = boxes[slice.count ? slice.slot : 0];

        for (uint done = 0; done < all; done += LS * VW) {
            const int count = (int)min((uint)(LS * VW), all - done);
            float inputs[DECODER_IN * VW], raws[3 * VW];
            vf in[DECODER_IN], hidden[DECODER], raw[3];

            for (int l = 0; l < VW; l++) { /* past the count the last one again, without gradient */
                const uint at = slice.start + done + (uint)min(own + l, count - 1);
                const uint row = slice.start + chosen[at], ray = samples[order[row]].ray;
                const float4 head = own + l < count ? heads[at] : (float4)(0.0f);
                float f[FEATURES];

                for (int v = 0; v < FEATURES; v += VW)
                    VSTORE(VLOAD(features + (size_t)row * FEATURES + v), f + v);
                decoder_inputs(f, view_direction(ray_o[ray], ray_d[ray], box), VW, inputs + l);
                raws[l] = head.x;
                raws[VW + l] = head.y;
                raws[2 * VW + l] = head.z;
            }
            for (int i = 0; i < DECODER_IN; i++)
                in[i] = VLOAD(inputs + i * VW);
            for (int c = 0; c < 3; c++)
                raw[c] = VLOAD(raws + c * VW);
            decoder_hidden(net, in, hidden);

            /* the output layer; hidden becomes the gradient before the activation */
            GROUP_SYNC(); /* the block before has been summed */
            for (int i = 0; i < DECODER_IN; i++)
                VSTORE_IN(__local, in[i], x + i * LS * VW + own);
            for (int c = 0; c < 3; c++)
                VSTORE_IN(__local, raw[c], d + c * LS * VW + own);
            for (int j = 0; j < DECODER; j++)
                VSTORE_IN(__local, hidden[j], h + j * LS * VW + own);
            GROUP_SYNC();
            for (int c = 0; c < 3; c++)
                for (int j = lid; j < DECODER; j += LS)
                    add_products(d + c * LS * VW, h + j * LS * VW,
                                 sums + (DECODER_OUT + c * DECODER + j) * SUM_LANES);
            GROUP_SYNC();
            for (int j = 0; j < DECODER; j++) {
                vf sum = (vf)(0.0f);

                for (int c = 0; c < 3; c++)
                    sum = MAD(raw[c], (vf)(net[DECODER_OUT + c * DECODER + j]), sum);
                hidden[j] = select((vf)(0.0f), sum, hidden[j] > 0.0f);
                VSTORE_IN(__local, hidden[j], h + j * LS * VW + own);
            }
            GROUP_SYNC();

            /* the input layer */
            for (int j = lid; j < DECODER; j += LS)
                add_row(h + j * LS * VW, sums + (DECODER_B + j) * SUM_LANES);
            for (int i = 0; i < DECODER_IN; i++)
                for (int j = lid; j < DECODER; j += LS)
                    add_products(x + i * LS * VW, h + j * LS * VW,
                                 sums + (i * DECODER + j) * SUM_LANES);
            for (int i = 0; i < FEATURES - 1; i++) {
                vf sum = (vf)(0.0f);

                for (int j = 0; j < DECODER; j++)
                    sum = MAD((vf)(net[i * DECODER + j]), hidden[j], sum);
                VSTORE(sum, inputs + i * VW);
            }
            for (int l = 0; l < VW && own + l < count; l++) {
                __global float *to =
                    feature_grads + (size_t)(slice.start + done + (uint)(own + l)) * FEATURES;

                for (int i = 0; i < FEATURES; i++)
                    to[i] = i == 3 ? 0.0f : inputs[(i < 3 ? i : i - 1) * VW + l];
            }
        }
    }
    GROUP_SYNC();
    for (int i = lid; i < DECODER_SIZE; i += LS)
#if LS == 1
        grads[(size_t)group * DECODER_SIZE + i] = V_SUM(VLOAD(sums + i * VW));
#else
        grads[(size_t)group * DECODER_SIZE + i] = sums[i];
#endif
}

/* Adam's step of every weight. As with voxels, no steps are counted: the second moment begins as a
 * tenth of the first gradient's square. */
__kernel void decoder_update(const __global float *restrict grads, /* [group][DECODER_SIZE] */
                             __global float *restrict net, __global float *restrict m,
                             __global float *restrict v, uint groups, float lr)
{
    const uint i = get_global_id(0);
    float g = 0.0f;

    if (i >= DECODER_SIZE)
        return;
    for (uint k = 0; k < groups; k++)
        g += grads[(size_t)k * DECODER_SIZE + i];
    const float before = v[i];

    m[i] = MAD(DECODER_BETA1, m[i], (1.0f - DECODER_BETA1) * g);
    v[i] = before > 0.0f ? MAD(DECODER_BETA2, before, (1.0f - DECODER_BETA2) * g * g)
                         : 0.1f * g * g;
    net[i] -= lr * m[i] / (sqrt(v[i]) + EPSILON);
}
