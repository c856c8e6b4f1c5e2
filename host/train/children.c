/* Finds the children that a split makes. See children.h. */
#include "train/children.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "model/structure.h"
#include "ranks/ranks.h"

/* Cells that are on the host at a time, where a leaf has no more. */
enum { CHUNK_CELLS = 1 << 22 };

cln_status cln_children_find(cln_trainer *t, const uint8_t *asked, uint8_t **children)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const cln_octree *tree = &t->model.tree;
    const size_t n1 = (size_t)p->config.n1, cells = n1 * n1 * n1;
    const int end = p->first + p->own;
    int chunk = (int)(CHUNK_CELLS / cells); /* leaves */
    uint16_t *density = NULL;               /* [leaf of the chunk][cell] */
    uint8_t *seen = NULL;                   /* [leaf of the chunk][cell] */

    CLN_TRY(cln_alloc(children, (size_t)p->leaves, 1, "children of leaves"));
    memset(*children, 0xff, (size_t)p->leaves);
    if (p->config.encoding != CLN_ENCODING_VOXEL)
        return CLN_OK;
    chunk = chunk < p->own ? chunk : p->own;
    chunk = chunk > 1 ? chunk : 1;
    CLN_TRY(cln_alloc(&density, (size_t)chunk * cells, sizeof *density, "children of leaves"));
    CLN_TRY(cln_alloc(&seen, (size_t)chunk * cells, 1, "children of leaves"));
    for (int first = p->first; first < end; first += chunk) {
        const int count = end - first < chunk ? end - first : chunk;
        const size_t from = (size_t)first * cells, all = (size_t)count * cells;

        CLN_TRY(cln_buffer_read(t->device, &p->density, from * sizeof *density, density,
                                all * sizeof *density));
        CLN_TRY(cln_buffer_read(t->device, &p->seen, from, seen, all));
        for (int i = 0; i < count; i++)
            if (asked[first + i])
                (*children)[first + i] =
                    cln_structure_children(&p->config, tree->level[tree->leaf[first + i]],
                                           density + (size_t)i * cells, seen + (size_t)i * cells);
    }
    if (p->ranks > 1)
        cln_ranks_gather(*children, 1, p->rank_first, true);
done:
    free(density);
    free(seen);
    return st;
}

int cln_children_count(uint8_t children)
{
    return __builtin_popcount(children);
}

cln_status cln_children_drop(cln_octree *tree, const uint8_t *children, cln_octree_change *splits)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;
    int count = 0;

    CLN_TRY(cln_alloc(&marks, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count; s++)
        if (splits->octant[s] >= 0) {
            marks[s] = !(children[tree->parent[tree->leaf[s]]] >> splits->octant[s] & 1);
            count += marks[s];
        }
    if (count > 0)
        CLN_TRY(cln_octree_cull_after(tree, marks, splits));
done:
    free(marks);
    return st;
}
