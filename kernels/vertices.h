/* needs: network leaves */
/* Vertices of leaves of voxels, which neighbours of one size have in common (voxel.cl), on one rank
 * or on several (halo.cl).
 *
 *   CELLS FEATURES  cells of a leaf along an axis; numbers of a vertex
 */
#define SIDE     (CELLS + 1)
#define VERTICES (SIDE * SIDE * SIDE)
#define NO_SLICE 0xFFFFFFFFu

/* Which leaves a rank has, and where their slices lie. */
typedef struct leaf_slices {
    const __global uint *starts; /* [leaf + 1] */
    const __global uint *far;    /* [leaf] the one slice of another rank's leaf, or NO_SLICE */
    uint first, own;             /* leaves here */
} leaf_slices;

HELPER bool is_here(leaf_slices of, int leaf)
{
    return (uint)leaf - of.first < of.own;
}

/* Slices (x .. y - 1) of a leaf. */
HELPER uint2 slices_of(leaf_slices of, int leaf)
{
    if (is_here(of, leaf))
        return (uint2)(of.starts[leaf], of.starts[leaf + 1]);
    return of.far[leaf] == NO_SLICE ? (uint2)(0u) : (uint2)(of.far[leaf], of.far[leaf] + 1u);
}

/* Whether samples of a slice met vertices from `vertex` on along x: bits. */
HELPER uint met_from(const __global uint *met, uint slice, int vertex)
{
    return met[(size_t)slice * SIDE * SIDE + vertex / SIDE] >> vertex % SIDE;
}

/* -1, 0 or 1: on the leaf's lower face along an axis, inside, on its upper face. */
HELPER int face_of(int at)
{
    return at == 0 ? -1 : at == CELLS;
}

HELPER int3 faces_of(int vertex)
{
    return (int3)(face_of(vertex % SIDE), face_of(vertex / SIDE % SIDE),
                  face_of(vertex / (SIDE * SIDE)));
}
