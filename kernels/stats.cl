/* needs: space leaves bfloat16 */
/* Measures for structure decisions (method.md 12.3): per leaf, mean and peak of the cached
 * densities that a training view sees, and sums of composite.cl's measures over a step's samples
 * (float64 twins: tests/pipeline/test_measure.c).
 *
 * MEASURES 0 | 1 | 3   numbers per sample (composite.cl)
 * LS, SG               work-items per leaf of leaf_measure and of stats_leaf, SG a power of two
 */
#ifndef MEASURES
#define MEASURES 3
#define LS 4
#define SG 4
#endif

#define SUMS 3 /* pairs kept per leaf, for any MEASURES */

/* seen[leaf][cell] = 1 if the cell's centre projects into a view; of `total` cells from leaf
 * `first` on. */
__kernel void stats_seen(const __global cln_device_camera *restrict cameras,
                         const __global float4 *restrict boxes, LEAF_ARRAY(uchar, seen), uint n1,
                         uint views, uint first, uint total)
{
    const uint cells = n1 * n1 * n1, i = get_global_id(0) + first * cells;

    if (get_global_id(0) >= total)
        return;
    const uint cell = i % cells;
    const float4 box = boxes[i / cells];
    const float3 point = cell_centre(box, cell, n1);
    bool found = false;
    float2 pixel;

    for (uint v = 0; v < views && !found; v++)
        found = point_pixel(cameras[v], point, &pixel);
    LEAF_ELEMENT(seen, i, cells) = found;
}

/* stats[leaf] = (mean, peak) of seen cells, from leaf `first` on; 0 for a leaf without any. A group
 * per leaf adds its partial sums as a tree. */
__kernel __attribute__((reqd_work_group_size(SG, 1, 1))) void
stats_leaf(LEAF_ARRAY(const ushort, density), /* [leaf][cells] */
           LEAF_ARRAY(const uchar, seen),     /* [leaf][cells] */
           __global float2 *restrict stats, uint cells, uint first)
{
    __local float sums[SG], peaks[SG];
    __local uint counts[SG];
    const uint leaf = get_group_id(0) + first, lid = get_local_id(0);
    const __global ushort *sigmas = LEAF_ROW(density, leaf, cells);
    const __global uchar *is_seen = LEAF_ROW(seen, leaf, cells);
    float sum = 0.0f, peak = 0.0f;
    uint count = 0;

    for (uint i = lid; i < cells; i += SG)
        if (is_seen[i]) {
            const float sigma = bfloat16_value(sigmas[i]);

            sum += sigma;
            peak = fmax(peak, sigma);
            count++;
        }
    sums[lid] = sum;
    peaks[lid] = peak;
    counts[lid] = count;
#if SG > 1
    for (uint half_group = SG / 2; half_group > 0; half_group /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (lid < half_group) {
            sums[lid] += sums[lid + half_group];
            peaks[lid] = fmax(peaks[lid], peaks[lid + half_group]);
            counts[lid] += counts[lid + half_group];
        }
    }
#endif
    if (lid == 0)
        stats[leaf] = (float2)(counts[0] ? sums[0] / (float)counts[0] : 0.0f, peaks[0]);
}

#if MEASURES > 0
/* sums[leaf][q] += sum of measures[sample][q] over the leaf's samples among the first `composited`,
 * met[leaf] += their number, from leaf `first` on. A group per leaf adds its partial sums in order;
 * {sum, compensation} (Kahan), as a sum grows over thousands of steps. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
leaf_measure(const __global uint *restrict begin, const __global uint *restrict end, /* [leaf] */
             const __global uint *restrict order,       /* [grouped sample] -> sample */
             const __global float *restrict measures,   /* [sample][MEASURES] */
             __global float2 *restrict sums,            /* [leaf][SUMS] */
             __global int *restrict met,                /* [leaf] */
             uint composited, uint first)
{
    __local float part[LS * MEASURES];
    __local int counts[LS];
    const uint leaf = get_group_id(0) + first, lid = get_local_id(0);
    float sum[MEASURES];
    int count = 0;

    for (int q = 0; q < MEASURES; q++)
        sum[q] = 0.0f;
    for (uint i = begin[leaf] + lid; i < end[leaf]; i += LS) {
        const uint id = order[i];

        if (id >= composited)
            continue;
        for (int q = 0; q < MEASURES; q++)
            sum[q] += measures[id * MEASURES + q];
        count++;
    }
    for (int q = 0; q < MEASURES; q++)
        part[lid * MEASURES + q] = sum[q];
    counts[lid] = count;
#if LS > 1
    barrier(CLK_LOCAL_MEM_FENCE);
#endif
    if (lid > 0)
        return;
    for (int other = 1; other < LS; other++)
        count += counts[other];
    met[leaf] = min(met[leaf], INT_MAX - count) + count;
    for (int q = 0; q < MEASURES; q++) {
        const float2 old = sums[leaf * SUMS + q];
        float add = part[q];

        for (int other = 1; other < LS; other++)
            add += part[other * MEASURES + q];
        add -= old.y;
        const float total = old.x + add;

        sums[leaf * SUMS + q] = (float2)(total, (total - old.x) - add);
    }
}
#endif
