/* needs: space leaves bfloat16 */
/* Stage 1 by projection (method.md 4, 5, 6; paper section 4): every cached sample of every leaf
 * goes to the nearest (coarse) pixel of a view; sorted by the 64-bit key list << 32 | bits of t,
 * the samples of a list are in order front to back. t >= 0, so its IEEE bits order like the floats:
 * the paper's key r * z_max + z_s, without z_max and rounding.
 *
 *   list = grid.first + y / ky * grid.row + x / kx, one grid of coarse pixels per leaf level, kx ky
 *   such that a list meets enough samples; t = distance along the list's own ray
 *
 *   splat_count, splat_emit   a work-item projects a run of samples; a scan between them
 *   (scan.cl's radix sort)
 *   splat_bounds, splat_read  entries -> list_start, list_t, list_sigma (sampling.cl reads them)
 *   splat_pad                 the paper's padded groups: every list at list * longest
 */

#ifndef LEVELS
#define LEVELS 6u /* of the tree, from the host */
#endif

#define SPLAT_ARGUMENTS                                                                            \
    const __global cln_device_camera *restrict cameras, /* [view] */                               \
        const __global uint *restrict views,     /* [batch view] -> view */                        \
        LEAF_ARRAY(const ushort, density),       /* [leaf][n1^3] bfloat16 */                       \
        const __global float4 *restrict boxes,   /* [leaf] */                                      \
        const __global cln_grid *restrict grids  /* [batch view][LEVELS] */
#define SPLAT_PARAMETERS                                                                           \
    uint first_view, uint n_views, uint total, uint n1, uint run, uint runs, uint row_begin,       \
        uint row_end, float min_alpha

/* Key of a sample; false if it is dropped: too faint, without a place in the image, or in a
 * coarse pixel outside the band of rows (bands are cut at multiples of every ky). */
HELPER bool splat_key(SPLAT_ARGUMENTS, uint view, uint n1, uint row_begin, uint row_end,
                      float min_alpha, uint index, ulong *key)
{
    const uint cells = n1 * n1 * n1, cell = index % cells;
    const float4 box = boxes[index / cells];
    const float spacing = box.w / (float)n1;
    const float sigma = bfloat16_value(LEAF_ELEMENT(density, index, cells));
    const cln_device_camera camera = cameras[views[view]];
    const float3 point = cell_centre(box, cell, n1);
    float2 pixel;
    float4 o, d;

    if (!(sigma * spacing >= min_alpha) || !point_pixel(camera, point, &pixel))
        return false;
    const cln_grid grid = grids[view * LEVELS + (uint)leaf_level(box)];
    const uint cx = (uint)pixel.x / grid.coarse_x, cy = (uint)pixel.y / grid.coarse_y;

    if ((cy + 1u) * grid.coarse_y <= row_begin || cy * grid.coarse_y >= row_end)
        return false;
    const float u = (float)(cx * grid.coarse_x) + 0.5f * (float)grid.coarse_x;
    const float v = (float)(cy * grid.coarse_y) + 0.5f * (float)grid.coarse_y;

    /* the lens may end between a pixel and its list's middle */
    if (!pixel_ray(camera, u, v, &o, &d))
        d.xyz = normalize(point - o.xyz);
    const float t = fmax(dot(point - o.xyz, d.xyz), 0.0f);

#if BEGINS
    if (dot(point - o.xyz, d.xyz) < 0.0f) /* before the ray begins */
        return false;
#endif

    *key = (ulong)(grid.first + cy * grid.row + cx) << 32 | as_uint(t);
    return true;
}

/* Work-item c: run c % runs of batch view first_view + c / runs. */
__kernel void splat_count(SPLAT_ARGUMENTS, __global uint *restrict counts /* [view][run] */,
                          SPLAT_PARAMETERS)
{
    const uint c = get_global_id(0), view = first_view + c / runs;
    const uint begin = min(total, c % runs * run), end = begin + min(run, total - begin);
    uint count = 0;
    ulong key;

    if (c >= n_views * runs)
        return;
    for (uint i = begin; i < end; i++)
        count += splat_key(cameras, views, LEAF_PASS(density), boxes, grids, view, n1, row_begin,
                           row_end, min_alpha, i, &key);
    counts[c] = count;
}

__kernel void splat_emit(SPLAT_ARGUMENTS, const __global uint *restrict starts, /* [view][run] */
                         __global ulong *restrict keys,  /* [entry] */
                         __global uint *restrict values, /* [entry] */
                         SPLAT_PARAMETERS)
{
    const uint c = get_global_id(0), view = first_view + c / runs;
    const uint begin = min(total, c % runs * run), end = begin + min(run, total - begin);
    uint at;
    ulong key;

    if (c >= n_views * runs)
        return;
    at = starts[c];
    for (uint i = begin; i < end; i++)
        if (splat_key(cameras, views, LEAF_PASS(density), boxes, grids, view, n1, row_begin,
                      row_end, min_alpha, i, &key)) {
            keys[at] = key;
            values[at++] = i;
        }
}

/* list_start[l] = first entry of list l, for every l in 0 .. lists. */
__kernel void splat_bounds(const __global ulong *restrict keys, __global uint *restrict list_start,
                           uint n, uint lists)
{
    const uint i = get_global_id(0);

    if (i > n)
        return;
    const uint from = i == 0 ? 0u : (uint)(keys[i - 1u] >> 32) + 1u;
    const uint to = i == n ? lists : (uint)(keys[i] >> 32);

    for (uint l = from; l <= to; l++)
        list_start[l] = i;
}

__kernel void splat_read(const __global ulong *restrict keys, const __global uint *restrict values,
                         LEAF_ARRAY(const ushort, density), /* [leaf][cells] */
                         __global float *restrict list_t, __global float *restrict list_sigma,
                         uint n, uint cells)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    list_t[i] = as_float((uint)(keys[i] & 0xFFFFFFFFul));
    list_sigma[i] = bfloat16_value(LEAF_ELEMENT(density, values[i], cells));
}

__kernel void splat_lengths(const __global uint *restrict list_start,
                            __global uint *restrict list_count, uint lists)
{
    const uint l = get_global_id(0);

    if (l < lists)
        list_count[l] = list_start[l + 1u] - list_start[l];
}

__kernel void splat_pad(const __global uint *restrict list_start, const __global float *restrict t,
                        const __global float *restrict sigma, __global float *restrict padded_t,
                        __global float *restrict padded_sigma, /* [list][longest] */
                        uint lists, uint longest)
{
    const uint l = get_global_id(0);

    if (l >= lists)
        return;
    const uint begin = list_start[l], count = list_start[l + 1u] - begin;

    for (uint j = 0; j < longest; j++) {
        padded_t[l * longest + j] = j < count ? t[begin + j] : MAXFLOAT;
        padded_sigma[l * longest + j] = j < count ? sigma[begin + j] : 0.0f;
    }
}
