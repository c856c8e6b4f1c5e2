/* A hash table with open addressing, at most half full. See marching_edges.h. */
#include "export/marching_edges.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

void cln_edges_free(cln_edges *edges)
{
    free(edges->key);
    free(edges->vertex);
    memset(edges, 0, sizeof *edges);
}

static size_t spot_of(const cln_edges *e, uint64_t key)
{
    size_t spot = (size_t)(key * 0x9e3779b97f4a7c15u >> 20) & (e->room - 1);

    while (e->key[spot] != 0 && e->key[spot] != key)
        spot = (spot + 1) & (e->room - 1);
    return spot;
}

static cln_status widen(cln_edges *e)
{
    cln_status st = CLN_OK;
    cln_edges wide = {.room = e->room ? 2 * e->room : 8192, .count = e->count};

    CLN_TRY(cln_alloc(&wide.key, wide.room, sizeof *wide.key, "edges"));
    CLN_TRY(cln_alloc(&wide.vertex, wide.room, sizeof *wide.vertex, "edges"));
    for (size_t i = 0; i < e->room; i++)
        if (e->key[i] != 0) {
            const size_t spot = spot_of(&wide, e->key[i]);

            wide.key[spot] = e->key[i];
            wide.vertex[spot] = e->vertex[i];
        }
    cln_edges_free(e);
    *e = wide;
    memset(&wide, 0, sizeof wide);
done:
    cln_edges_free(&wide);
    return st;
}

cln_status cln_edges_find(cln_edges *e, uint64_t key, uint32_t **vertex, bool *fresh)
{
    cln_status st = CLN_OK;
    size_t spot = 0;

    if (2 * (e->count + 1) > e->room)
        CLN_TRY(widen(e));
    spot = spot_of(e, key);
    *fresh = e->key[spot] != key;
    *vertex = &e->vertex[spot];
    e->count += *fresh;
    e->key[spot] = key;
done:
    return st;
}

cln_status cln_edges_keep(cln_edges *e, bool (*keep)(const void *user, uint64_t key),
                          const void *user)
{
    cln_status st = CLN_OK;
    cln_edges old = *e;

    memset(e, 0, sizeof *e);
    for (size_t i = 0; i < old.room; i++) {
        uint32_t *vertex = NULL;
        bool fresh = false;

        if (old.key[i] == 0 || !keep(user, old.key[i]))
            continue;
        CLN_TRY(cln_edges_find(e, old.key[i], &vertex, &fresh));
        *vertex = old.vertex[i];
    }
done:
    cln_edges_free(&old);
    return st;
}
