/* The octree over the root cube [-1,1]^3 (method.md section 3): leaves, their places and slots. It
 * carries changes out; structure.h and integer_program.h decide on them.
 *
 *   node states   INNER (8 children), ACTIVE leaf (has weights), CULLED leaf (zero density)
 *   geometry      node at level l: integer position (x, y, z) in 0..2^l-1, side 2 * 2^-l,
 *                 box [min, max) half-open, closed at +1
 *   child i       bit 0 of i = upper half along x, bit 1 along y, bit 2 along z
 *   slots         ACTIVE leaves numbered 0.. in Morton order; weights are packed by slot
 *
 * Arrays are indexed by node; node 0 is the root; eight siblings are adjacent. */
#ifndef CLN_OCTREE_H
#define CLN_OCTREE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"
#include "device_abi.h"
#include "model/marks.h"

enum { CLN_NODE_INNER, CLN_NODE_ACTIVE, CLN_NODE_CULLED };

typedef struct cln_octree {
    int node_count, node_capacity;
    uint8_t *state;     /* [node] */
    uint8_t *level;     /* [node] */
    uint8_t *strikes;   /* [node] consecutive checks that found the leaf empty */
    int32_t *parent;    /* [node] -1 for the root */
    int32_t *child;     /* [node] first of eight, -1 for leaves */
    int32_t *slot;      /* [node] slot of an ACTIVE leaf, else -1 */
    uint16_t (*pos)[3]; /* [node] */
    int leaf_count;     /* ACTIVE leaves */
    int32_t *leaf;      /* [slot] node */
} cln_octree;

/* A change of the tree by slots: new slot s comes from old slot from[s], as
 *   octant[s] = CLN_COPIED             the same leaf
 *   octant[s] = k in 0..7              its child k (a split: fold)
 *   octant[s] = CLN_MERGED - k         the parent of the old leaf, its child k (a merge: unfold)
 *   octant[s] = CLN_FRESH              no leaf: weights as at step 0; from[s] is its neighbour's,
 *                                      so that from[] ascends */
enum { CLN_COPIED = -1, CLN_MERGED = -2, CLN_FRESH = CLN_MERGED - 8 };
typedef struct cln_octree_change {
    int count;      /* new leaf_count */
    int32_t *from;  /* [count] */
    int8_t *octant; /* [count] */
} cln_octree_change;

cln_status cln_octree_create(int level, cln_octree *out); /* full tree, all leaves ACTIVE */
void cln_octree_free(cln_octree *tree);
void cln_octree_change_free(cln_octree_change *change);

/* Splits every marked ACTIVE leaf (split[slot] != 0; NULL = all) of a level below CLN_MAX_LEVEL. */
cln_status cln_octree_split(cln_octree *tree, const uint8_t *split, cln_octree_change *change);

/* Makes every marked ACTIVE leaf CULLED; a parent with eight CULLED children becomes a CULLED leaf
 * itself (its children stay in the arrays, unreachable). */
cln_status cln_octree_cull(cln_octree *tree, const uint8_t *cull, cln_octree_change *change);

/* The same right after another change, *change, which becomes both. CLN_MEMORY. */
cln_status cln_octree_cull_after(cln_octree *tree, const uint8_t *cull, cln_octree_change *change);

/* Returns whether the ACTIVE leaf's group may merge: it has siblings, none of them INNER. */
bool cln_octree_can_merge(const cln_octree *tree, int slot);

/* Replaces every sibling group with a marked leaf (merge[slot] != 0) by its parent as one ACTIVE
 * leaf (the children stay in the arrays as CULLED nodes, unreachable). In the change, the parent
 * comes from the sibling of the largest weight[slot]. CLN_INTERNAL if a group may not merge. */
cln_status cln_octree_merge(cln_octree *tree, const uint8_t *merge, const float *weight,
                            cln_octree_change *change);

/* Whether a node lies in the middle half of the cube along each axis: a shell space's core. */
bool cln_octree_in_middle(const cln_octree *tree, int node);

/* Makes ACTIVE leaves of `level`, in the middle (above) of `core_level`, again in CULLED nodes
 * where cells are marked (marks in order); a marked CULLED node of that level or deeper becomes
 * ACTIVE itself. ACTIVE leaves that are `empty` [slot] but have a marked cell begin anew. */
cln_status cln_octree_regrow(cln_octree *tree, const cln_marks *marks, int level, int core_level,
                             const uint8_t *empty, cln_octree_change *change);

/* Joins two successive changes: *change becomes *change, then `next`. A leaf is new in at most one
 * of them. CLN_MEMORY. */
cln_status cln_octree_change_join(cln_octree_change *change, const cln_octree_change *next);

cln_status cln_octree_copy(const cln_octree *tree, cln_octree *out);

/* Deepest level with an ACTIVE leaf (0 without any). */
int cln_octree_depth(const cln_octree *tree);

/* The most leaves that a straight line can meet: one for each plane of leaves' faces across the
 * three axes or, if those are fewer, one for each cell of the deepest level along them. */
cln_status cln_octree_most_intervals(const cln_octree *tree, int *most);

/* Slot of the ACTIVE leaf that holds a point of the cube, or -1. */
int cln_octree_find(const cln_octree *tree, const double point[3]);

/* Neighbours of each leaf: (*around)[slot][CLN_SELF + (dz * 3 + dy) * 3 + dx] is the slot of the
 * leaf of the same size at an offset of dx, dy, dz sides, or -1; [slot][CLN_SELF] is the leaf
 * itself. The caller frees it. CLN_MEMORY. */
enum { CLN_AROUND = 27, CLN_SELF = 13 };
cln_status cln_octree_around(const cln_octree *tree, int32_t (**around)[CLN_AROUND]);

/* Place of a cell in [z][y][x] of n^3 cells. */
static inline size_t cln_cell_at(int x, int y, int z, int n)
{
    return ((size_t)z * (size_t)n + (size_t)y) * (size_t)n + (size_t)x;
}

/* The tree as the kernels read it: a dense map at level `depth`, n = 2^depth cells along an axis.
 *
 *   (*map)[(z * n + y) * n + x]   CLN_MAP_LEAF of the leaf there; else CLN_MAP_EMPTY with the
 *                                 CLN_MAP_BOX of empty cells around it, grown as far as it goes
 *
 * The caller frees *map. CLN_MEMORY. */
cln_status cln_octree_map(const cln_octree *tree, int depth, int32_t **map);

/* Minimum and side of a node's box, normalised units; exact. */
void cln_octree_box(const cln_octree *tree, int node, float box[4]);

/* Per-slot geometry for the kernels: {min x, min y, min z, side} in normalised units; [slot][4]. */
cln_status cln_octree_boxes(const cln_octree *tree, float **boxes);

/* To and from flat rows of a checkpoint, int32 [node][8]: {state, level, strikes, parent, child, x,
 * y, z}. Unpack checks every link, level and position. CLN_CHECKPOINT, CLN_MEMORY. */
cln_status cln_octree_pack(const cln_octree *tree, int32_t **rows);
cln_status cln_octree_unpack(const int32_t *rows, int node_count, cln_octree *out);

#endif
