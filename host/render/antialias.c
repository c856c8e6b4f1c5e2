/* Pixels at edges. See antialias.h. */
#include "render/antialias.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "base/memory.h"

/* A larger difference of colour or opacity, 0..1, is an edge: about 6 of 255 steps. A smaller
 * threshold gains nothing (docs/results.md, "More rays where edges are"). */
static const float STEP = 0.024f;
static const float DEPTH_STEP = 0.05f; /* the same for depths, as a share of the nearer one */

static bool differ(const cln_picture *p, size_t a, size_t b)
{
    const float nearer = fminf(p->depth[a], p->depth[b]);

    for (size_t c = 0; c < 3; c++)
        if (fabsf(p->rgb[3 * a + c] - p->rgb[3 * b + c]) > STEP)
            return true;
    if (fabsf(p->opacity[a] - p->opacity[b]) > STEP)
        return true;
    return p->opacity[a] > 0.5f && p->opacity[b] > 0.5f &&
           fabsf(p->depth[a] - p->depth[b]) > DEPTH_STEP * nearer;
}

static bool is_edge(const cln_picture *p, int x, int y)
{
    const size_t here = (size_t)y * (size_t)p->width + (size_t)x;

    for (int v = y - 1; v <= y + 1; v++)
        for (int u = x - 1; u <= x + 1; u++)
            if (u >= 0 && v >= 0 && u < p->width && v < p->height &&
                differ(p, here, (size_t)v * (size_t)p->width + (size_t)u))
                return true;
    return false;
}

cln_status cln_antialias_edges(const cln_picture *picture, int **pixels, int *count)
{
    cln_status st = CLN_OK;
    const int total = picture->width * picture->height;

    *count = 0;
    CLN_TRY(cln_alloc(pixels, (size_t)total, sizeof **pixels, "edges"));
    for (int i = 0; i < total; i++)
        if (is_edge(picture, i % picture->width, i / picture->width))
            (*pixels)[(*count)++] = i;
done:
    return st;
}
