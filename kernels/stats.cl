/* What the structure decisions need from the cached stage-1 densities (method.md 12.3): per leaf the
 * mean over samples that some training view sees, and the peak. */

/* seen[leaf][cell] = 1 if the cell's centre projects into a view. */
__kernel void stats_seen(const __global cln_device_camera *restrict cameras,
                         const __global float4 *restrict boxes, __global uchar *restrict seen, uint n1,
                         uint views, uint total)
{
    const uint i = get_global_id(0), cells = n1 * n1 * n1;

    if (i >= total)
        return;
    const uint cell = i % cells;
    const float4 box = boxes[i / cells];
    const float3 point = box.xyz + ((float3)((float)(cell % n1), (float)(cell / n1 % n1),
                                             (float)(cell / (n1 * n1))) +
                                    0.5f) *
                                       (box.w / (float)n1);
    bool found = false;
    float2 pixel;

    for (uint v = 0; v < views && !found; v++)
        found = camera_project(cameras[v], point, &pixel);
    seen[i] = found;
}

/* stats[leaf] = (mean of seen, peak); 0 for a leaf that nobody sees. */
__kernel void stats_leaf(const __global ushort *restrict density, const __global uchar *restrict seen,
                         __global float2 *restrict stats, uint cells, uint leaves)
{
    const uint leaf = get_global_id(0);
    float sum = 0.0f, peak = 0.0f;
    uint count = 0;

    if (leaf >= leaves)
        return;
    for (uint i = 0; i < cells; i++)
        if (seen[(size_t)leaf * cells + i]) {
            const float sigma = as_float((uint)density[(size_t)leaf * cells + i] << 16);

            sum += sigma;
            peak = fmax(peak, sigma);
            count++;
        }
    stats[leaf] = (float2)(count ? sum / (float)count : 0.0f, peak);
}
