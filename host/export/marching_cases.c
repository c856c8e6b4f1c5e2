/* The cases of marching cubes. See marching.h. The table is computed: in each face of a cell, seen
 * from outside, the surface runs from where a walk around the face enters the inside to where it
 * leaves it; these pieces join to loops, and the loops are cut into triangles. */
#include "export/marching.h"

#include <string.h>

/* Edge from corner `from` along `axis`; `from` has the axis' bit clear. */
static int edge_of(int from, int axis)
{
    const int low = axis == 0 ? 1 : 0, high = axis == 2 ? 1 : 2;

    return 4 * axis + (from >> low & 1) + 2 * (from >> high & 1);
}

static int edge_between(int a, int b)
{
    const int axis = (a ^ b) >> 1; /* 1, 2, 4 -> 0, 1, 2 */

    return edge_of(a & b, axis);
}

int cln_marching_edge_start(int edge)
{
    const int axis = edge / 4, low = axis == 0 ? 1 : 0, high = axis == 2 ? 1 : 2;

    return (edge & 1) << low | (edge >> 1 & 1) << high;
}

/* Returns whether two edges lie in one face. A cut of a loop must not join such edges: the cell
 * beyond the face could have the same side. */
static bool share_face(int a, int b)
{
    const int from_a = cln_marching_edge_start(a), from_b = cln_marching_edge_start(b);

    for (int axis = 0; axis < 3; axis++)
        if (axis != a / 4 && axis != b / 4 && !((from_a ^ from_b) >> axis & 1))
            return true;
    return false;
}

/* next[e]: the edge to which the surface runs from edge e, in the face where a walk around it,
 * counter-clockwise as seen from outside the cell, enters the inside at e; -1: e is not cut. */
static void join_edges(int inside, int next[CLN_MARCHING_EDGES])
{
    for (int e = 0; e < CLN_MARCHING_EDGES; e++)
        next[e] = -1;
    for (int face = 0; face < 6; face++) {
        const int axis = face / 2, side = face % 2;
        const int b = 1 << (axis + 1) % 3, c = 1 << (axis + 2) % 3;
        const int at = side << axis;
        const int corner[4] = {at, at | (side ? b : c), at | b | c, at | (side ? c : b)};

        for (int i = 0; i < 4; i++) {
            int j = (i + 1) % 4;

            if (inside >> corner[i] & 1 || !(inside >> corner[j] & 1))
                continue;
            while (inside >> corner[(j + 1) % 4] & 1)
                j = (j + 1) % 4;
            next[edge_between(corner[i], corner[(i + 1) % 4])] =
                edge_between(corner[j], corner[(j + 1) % 4]);
        }
    }
}

/* The vertex of a loop from which all cuts go, chosen so that no cut lies in a face. */
static int apex_of(const int *loop, int n)
{
    for (int apex = 0; apex < n; apex++) {
        bool free = true;

        for (int k = 2; k < n - 1 && free; k++)
            free = !share_face(loop[apex], loop[(apex + k) % n]);
        if (free)
            return apex;
    }
    CLN_ASSERT(!"a loop that cannot be cut");
    return 0;
}

void cln_marching_cases(cln_marching_case cases[256])
{
    for (int inside = 0; inside < 256; inside++) {
        cln_marching_case *c = &cases[inside];
        int next[CLN_MARCHING_EDGES];

        memset(c, 0, sizeof *c);
        join_edges(inside, next);
        for (int e = 0; e < CLN_MARCHING_EDGES; e++) {
            int loop[CLN_MARCHING_EDGES], n = 0, apex = 0;

            for (int at = e; next[at] >= 0;) {
                const int following = next[at];

                loop[n++] = at;
                next[at] = -1;
                at = following;
            }
            if (n == 0)
                continue;
            apex = apex_of(loop, n);
            for (int k = 1; k < n - 1; k++, c->count++) {
                CLN_ASSERT(c->count < CLN_MARCHING_TRIANGLES);
                c->edge[c->count][0] = (uint8_t)loop[apex];
                c->edge[c->count][1] = (uint8_t)loop[(apex + k) % n];
                c->edge[c->count][2] = (uint8_t)loop[(apex + k + 1) % n];
            }
        }
    }
}
