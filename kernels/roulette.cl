/* needs: network fetch */
/* Russian roulette before the backward pass: chooses the samples of a slice that take part, and
 * computes the gradients of their heads. Most gradients of a leaf are far below their mean (samples
 * in empty space or behind opaque ones). Of these a few take part, with probabilities in proportion
 * to their gradients, and count for more, so that the expected gradient stays the same. Runs
 * between composite.cl and mlp_backward.cl. Twin: host/reference/roulette.c. */

#define SEGMENT CLN_ROULETTE_SEGMENT
#define AHEAD   16 /* samples by which fetches run ahead */

/* The size of a gradient of the heads' raw outputs: a sum, as squares could over- or underflow. */
HELPER float size_of(float4 g)
{
    const float4 a = fabs(g);

    return (a.x + a.y) + (a.z + a.w);
}

/* Gradient of the raw colours, given that of the colours, g. Where a sigmoid is saturated,
 * o (1 - o) is 0 in float32, and a colour would stay there for good. So a gradient that leads back
 * counts with a slope of at least SLOPE_LEAST, which is less than any unsaturated slope. */
#define SLOPE_LEAST 0x1p-25f
HELPER float4 colour_gradient(float4 o, float4 g)
{
    const float4 slope = o * (1.0f - o);
    const int4 back = (g > 0.0f) == (o > 0.5f);

    return g * select(slope, fmax(slope, (float4)(SLOPE_LEAST)), back);
}

/* A work-group per slice. From the slice's start on, heads and chosen hold the chosen_counts[slice]
 * samples that take part (chosen: ascending, counted from the slice's start). A sample with a
 * gradient below `cutoff` times its segment's mean takes part with the ratio of the two as
 * probability; with cutoff 0 all do. At least one takes part, but none of an empty slice or of a
 * leaf with fewer than min_samples samples (mlp_backward also reads the next slice's count). */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
roulette(const __global cln_slice *restrict slices, /* [slice] */
         const __global uint *restrict order,       /* [grouped sample] -> sample */
         const __global float4 *restrict out,       /* [sample] r, g, b, sigma */
         const __global float4 *restrict dout,      /* [sample] gradient of it */
         const __global uint *restrict begin, const __global uint *restrict end, /* [leaf] */
         __global float4 *restrict heads,                                        /* [grouped] */
         __global uint *restrict chosen,                                         /* [grouped] */
         __global uint *restrict chosen_counts,                                  /* [slice] */
         uint n, uint n_slices, uint min_samples, float cutoff, uint key)
{
    __local float4 raw[SEGMENT];
    __local float sizes[SEGMENT + VW], sums[LS];
    __local uint counts[LS];
    const uint group = slice_of(slices, get_group_id(0), n_slices), lid = get_local_id(0);
    uint used = 0u;

    if (group >= n_slices)
        return;
    const cln_slice slice = slices[group];

    const uint all = end[slice.slot] - begin[slice.slot] < min_samples ? 0u : slice.count;

    for (uint first = 0; first < all; first += SEGMENT) {
        const uint count = min((uint)SEGMENT, all - first), at = slice.start + first;
        const uint each = (count + STEP_N - 1) / STEP_N * VW; /* per work-item, in a row */
        const uint from = min(lid * each, count), upto = min(from + each, count);
        float sum = 0.0f, least = 0.0f;
        uint mine = 0u;

        GROUP_SYNC();
        for (uint s = from; s < upto; s += VW) {
            float sigma[VW];

#pragma unroll
            for (uint l = 0; l < VW; l++) {
                const uint later = order[min(at + s + l + AHEAD, n - 1u)];

                FETCH(out + later);
                FETCH(dout + later);
            }
#pragma unroll
            for (uint l = 0; l < VW; l++)
                sigma[l] = out[order[at + min(s + l, upto - 1u)]].w;
            VSTORE(density_gradient(VLOAD(sigma)), sigma);
            for (uint l = 0; l < VW && s + l < upto; l++) {
                const uint id = order[at + s + l];
                const float4 o = out[id], g = dout[id], d = colour_gradient(o, g);
                const float4 head = (float4)(d.xyz, g.w * sigma[l]);

                raw[s + l] = head;
                sizes[s + l] = size_of(head);
                sum += sizes[s + l];
            }
        }
        sums[lid] = sum;
        GROUP_SYNC();
        for (uint l = 0; l < LS; l++)
            least += sums[l];
        least *= cutoff / (float)count;
        /* all take part also if the mean is not finite, so that the defect shows */
        const vi every = (vi)(cutoff == 0.0f || !(least < MAXFLOAT) ? -1 : 0);

        /* sizes become factors: 0 for samples that do not take part */
        for (uint s = from; s < upto; s += VW) {
            const vf size = VLOAD(sizes + s);
            uint ids[VW];

#pragma unroll
            for (uint l = 0; l < VW; l++)
                ids[l] = order[at + min(s + l, upto - 1u)];
            const vf draw = uniform_lanes_of(key, VLOAD(ids), (vu)(0u), 0u) + 0x1p-25f;
            const vf factor = select(fmax((vf)(least) / size, (vf)(1.0f)), (vf)(1.0f), every);

            VSTORE(select((vf)(0.0f), factor, every | (draw * least < size)), sizes + s);
        }
        for (uint s = from; s < upto; s++)
            mine += sizes[s] > 0.0f;
        counts[lid] = mine;
        GROUP_SYNC();
        for (uint l = 0; l < lid; l++)
            used += counts[l];
        for (uint s = from; s < upto; s++) {
            const bool is_chosen = sizes[s] > 0.0f;

            /* the next sample overwrites one that is not chosen: faster than a branch */
            if (LS == 1 || is_chosen) {
                heads[slice.start + used] = raw[s] * sizes[s];
                chosen[slice.start + used] = first + s;
            }
            used += is_chosen;
        }
        for (uint l = lid + 1u; l < LS; l++)
            used += counts[l];
    }
    if (lid == 0u) {
        if (all > 0u && used == 0u) { /* none has a gradient */
            chosen[slice.start] = 0u;
            heads[slice.start] = (float4)(0.0f);
        }
        chosen_counts[group] = all > 0u ? max(used, 1u) : 0u;
    }
}
