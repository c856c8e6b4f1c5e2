/* needs: vertices */
/* Common vertices of voxels on several ranks (host/pipeline/halo.c). One leaf steps for all that
 * have a vertex, its owner. A link is a leaf's copy of a vertex whose owner is on another rank:
 *
 *   x, y   leaf, and the vertex' number there
 *   z, w   owner, and the vertex' number there
 *
 * The leaf's rank sends the gradient, if samples met the vertex there; the owner's rank sends the
 * new numbers, if samples met it anywhere. A message has rows: a link's number, and FEATURES
 * numbers of the vertex.
 *
 *   halo_mark   links with something to send -> 1, else 0; (scan.cl) -> places of rows
 *   halo_pack_gradients, halo_pack_values   rows to send
 *   halo_put_gradients,  halo_put_values    rows that came
 */
#define HALO_ROW (1 + FEATURES)

#define MARK_LEAF   0u /* met in the leaf's slices */
#define MARK_VERTEX 1u /* met in slices of any leaf that has the vertex */
#define MARK_ALL    2u

HELPER bool is_met(const __global uint *met, leaf_slices of, int leaf, int vertex)
{
    const uint2 slices = slices_of(of, leaf);

    for (uint slice = slices.x; slice < slices.y; slice++)
        if (met_from(met, slice, vertex) & 1u)
            return true;
    return false;
}

/* Whether a vertex is met in any leaf that has it. near [27]: neighbours of one of them. */
HELPER bool is_met_around(const __global uint *met, leaf_slices of, const __global int *near,
                          int vertex)
{
    const int3 face = faces_of(vertex);

    for (int z = min(face.z, 0); z <= max(face.z, 0); z++)
        for (int y = min(face.y, 0); y <= max(face.y, 0); y++)
            for (int x = min(face.x, 0); x <= max(face.x, 0); x++) {
                const int leaf = near[13 + (z * 3 + y) * 3 + x];
                const int there = vertex - ((z * SIDE + y) * SIDE + x) * CELLS;

                if (leaf >= 0 && is_met(met, of, leaf, there))
                    return true;
            }
    return false;
}

__kernel void halo_mark(const __global uint4 *restrict links,       /* [link] */
                        const __global uint *restrict slice_starts, /* [leaf + 1] */
                        const __global uint *restrict far,          /* [leaf] */
                        const __global int *restrict around,        /* [leaf][27] */
                        const __global uint *restrict met,          /* [slice][SIDE * SIDE] */
                        __global uint *restrict marks,              /* [link] */
                        uint n, uint what, uint first, uint own)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    const leaf_slices of = {slice_starts, far, first, own};
    const uint4 link = links[i];
    bool marked = true;

    if (what == MARK_LEAF)
        marked = is_met(met, of, (int)link.x, (int)link.y);
    if (what == MARK_VERTEX)
        marked = is_met_around(met, of, around + (size_t)link.z * 27u, (int)link.w);
    marks[i] = marked;
}

HELPER __global float *row_of(__global float *rows, uint row, uint link)
{
    __global float *to = rows + (size_t)row * HALO_ROW;

    *(__global uint *)to = link;
    return to + 1;
}

/* The leaf's gradient: its sum over slices. */
__kernel void halo_pack_gradients(const __global uint4 *restrict links,
                                  const __global uint *restrict slice_starts,
                                  LEAF_ARRAY(const float, grads),    /* [slice][PARAMS] */
                                  const __global uint *restrict met, /* [slice][SIDE * SIDE] */
                                  const __global uint *restrict places, /* [link + 1] */
                                  __global float *restrict rows,        /* [row][HALO_ROW] */
                                  uint n)
{
    const uint i = get_global_id(0);

    if (i >= n || places[i] == places[i + 1u])
        return;
    const uint4 link = links[i];
    __global float *to = row_of(rows, places[i], i);
    float sum[FEATURES];

    for (int f = 0; f < FEATURES; f++)
        sum[f] = 0.0f;
    for (uint slice = slice_starts[link.x]; slice < slice_starts[link.x + 1u]; slice++)
        if (met_from(met, slice, (int)link.y) & 1u)
            for (int f = 0; f < FEATURES; f++)
                sum[f] += SLICE_ROW(grads, slice, PARAMS)[link.y * FEATURES + f];
    for (int f = 0; f < FEATURES; f++)
        to[f] = sum[f];
}

/* The owner's numbers. first: leaf of row 0. */
__kernel void halo_pack_values(const __global uint4 *restrict links,
                               LEAF_ARRAY(const float, params),
                               const __global uint *restrict places, __global float *restrict rows,
                               uint n, uint first)
{
    const uint i = get_global_id(0);

    if (i >= n || places[i] == places[i + 1u])
        return;
    const uint4 link = links[i];
    const __global float *from = LEAF_ROW(params, link.z - first, PARAMS) + link.w * FEATURES;
    __global float *to = row_of(rows, places[i], i);

    for (int f = 0; f < FEATURES; f++)
        to[f] = from[f];
}

HELPER uint link_of(const __global float *row)
{
    return *(const __global uint *)row;
}

/* To the slices of other ranks' leaves. */
__kernel void halo_put_gradients(const __global uint4 *restrict links,
                                 const __global uint *restrict far, /* [leaf] */
                                 LEAF_ARRAY(float, grads), const __global float *restrict rows,
                                 uint n)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    const __global float *from = rows + (size_t)i * HALO_ROW;
    const uint4 link = links[link_of(from)];
    __global float *to = SLICE_ROW(grads, far[link.x], PARAMS) + link.y * FEATURES;

    for (int f = 0; f < FEATURES; f++)
        to[f] = from[1 + f];
}

/* To copies in leaves here. */
__kernel void halo_put_values(const __global uint4 *restrict links, LEAF_ARRAY(float, params),
                              const __global float *restrict rows, uint n, uint first)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    const __global float *from = rows + (size_t)i * HALO_ROW;
    const uint4 link = links[link_of(from)];
    __global float *to = LEAF_ROW(params, link.x - first, PARAMS) + link.y * FEATURES;

    for (int f = 0; f < FEATURES; f++)
        to[f] = from[1 + f];
}
