/* Colours of vertices that have none, from their neighbours. See triangles.h. */
#include <stdlib.h>
#include "base/memory.h"
#include "export/triangles.h"

/* Lists each vertex's faces, of those that have a corner without a colour: (*list)[begin[v]] to
 * [begin[v + 1]]. */
static cln_status list_bare(const cln_surface *s, const uint8_t *known, uint32_t **begin,
                            uint32_t **list)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(begin, s->vertices + 2, sizeof **begin, "faces of vertices"));
    for (int round = 0; round < 2; round++) { /* counts, then fills */
        for (size_t f = 0; f < s->faces; f++) {
            const uint32_t *v = s->face[f];

            for (int k = 0; k < 3 && !(known[v[0]] && known[v[1]] && known[v[2]]); k++) {
                if (round)
                    (*list)[(*begin)[v[k] + 1]] = (uint32_t)f;
                (*begin)[v[k] + (round ? 1 : 2)]++;
            }
        }
        for (size_t v = 2; v < s->vertices + 2 && !round; v++)
            (*begin)[v] += (*begin)[v - 1];
        if (!round)
            CLN_TRY(cln_alloc(list, (*begin)[s->vertices + 1], sizeof **list, "faces of vertices"));
    }
done:
    return st;
}

cln_status cln_surface_bleed(cln_surface *s, uint8_t *known)
{
    cln_status st = CLN_OK;
    uint32_t(*sum)[4] = NULL, *begin = NULL, *list = NULL, *now = NULL, *next = NULL;
    size_t count = 0;

    CLN_TRY(list_bare(s, known, &begin, &list));
    if (begin[s->vertices] == 0) /* all have one */
        goto done;
    CLN_TRY(cln_alloc(&sum, s->vertices, sizeof *sum, "colours"));
    CLN_TRY(cln_alloc(&now, s->vertices, sizeof *now, "vertices"));
    CLN_TRY(cln_alloc(&next, s->vertices, sizeof *next, "vertices"));
    for (size_t v = 0; v < s->vertices; v++)
        if (known[v] && begin[v] < begin[v + 1])
            now[count++] = (uint32_t)v;
    while (count > 0) { /* those that got one last */
        uint32_t *last = now;
        size_t more = 0;

        for (size_t i = 0; i < count; i++)
            for (uint32_t k = begin[now[i]]; k < begin[now[i] + 1]; k++)
                for (int corner = 0; corner < 3; corner++) {
                    const uint32_t to = s->face[list[k]][corner];

                    if (known[to])
                        continue;
                    if (sum[to][3]++ == 0)
                        next[more++] = to;
                    for (int c = 0; c < 3; c++)
                        sum[to][c] += s->colour[now[i]][c];
                }
        for (size_t i = 0; i < more; i++) {
            const uint32_t v = next[i];

            for (int c = 0; c < 3; c++)
                s->colour[v][c] = (uint8_t)((sum[v][c] + sum[v][3] / 2) / sum[v][3]);
            known[v] = 1;
        }
        now = next;
        next = last;
        count = more;
    }
done:
    free(sum);
    free(begin);
    free(list);
    free(now);
    free(next);
    return st;
}
