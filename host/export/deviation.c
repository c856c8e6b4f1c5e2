/* How far points are from triangles, by a tree of boxes: triangles in the order of a curve that
 * fills space (Morton's), a few of them to a leaf, and over these a whole binary tree whose boxes
 * tell which parts are farther than what has been found. See deviation.h. */
#include "export/deviation.h"

#include <math.h>
#include <stdlib.h>
#include "base/memory.h"
#include "scene/vectors.h"

enum { LEAF = 4, BITS = 10 }; /* triangles of a leaf; of each coordinate along the curve */

typedef struct ordered {
    uint32_t code, face;
} ordered;

typedef struct box {
    float low[3], high[3];
} box;

typedef struct tree {
    size_t faces, leaves; /* leaves: a power of two */
    const uint32_t (*face)[3];
    const float (*at)[3];
    ordered *order; /* [faces] */
    box *boxes;     /* [2 leaves]: of node 1, the root, and of 2 i and 2 i + 1 below node i */
} tree;

/* The square of a point's distance from a triangle (Ericson, Real-Time Collision Detection, 5.1.5):
 * the nearest place is a corner, on an edge, or within. */
static double square_to(const tree *t, uint32_t f, const double p[3])
{
    double ab[3], ac[3], ap[3], to[3], v = 0, w = 0;

    for (int a = 0; a < 3; a++) {
        const double corner = (double)t->at[t->face[f][0]][a];

        ab[a] = (double)t->at[t->face[f][1]][a] - corner;
        ac[a] = (double)t->at[t->face[f][2]][a] - corner;
        ap[a] = p[a] - corner;
    }
    const double d1 = cln_dot(ab, ap), d2 = cln_dot(ac, ap), bb = cln_dot(ab, ab),
                 bc = cln_dot(ab, ac);
    const double cc = cln_dot(ac, ac), d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc;
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;

    if (d1 <= 0 && d2 <= 0) {
        v = w = 0;
    } else if (d3 >= 0 && d4 <= d3) {
        v = 1;
    } else if (d6 >= 0 && d5 <= d6) {
        w = 1;
    } else if (vc <= 0 && d1 >= 0 && d3 <= 0) {
        v = bb > 0 ? d1 / bb : 0;
    } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
        w = cc > 0 ? d2 / cc : 0;
    } else if (va <= 0 && d4 >= d3 && d5 >= d6) {
        const double length = d4 - d3 + d5 - d6;

        w = length > 0 ? (d4 - d3) / length : 0;
        v = 1 - w;
    } else {
        v = vb / (va + vb + vc);
        w = vc / (va + vb + vc);
    }
    for (int a = 0; a < 3; a++)
        to[a] = ap[a] - v * ab[a] - w * ac[a];
    return cln_dot(to, to);
}

/* ---- the tree ---- */

static uint32_t spread(uint32_t x) /* bits three apart */
{
    x = (x | x << 16) & 0x030000FF;
    x = (x | x << 8) & 0x0300F00F;
    x = (x | x << 4) & 0x030C30C3;
    return (x | x << 2) & 0x09249249;
}

static int by_code(const void *a, const void *b)
{
    const ordered *x = a, *y = b;

    if (x->code != y->code)
        return x->code < y->code ? -1 : 1;
    return x->face < y->face ? -1 : x->face > y->face;
}

static void add_face(const tree *t, uint32_t f, box *out)
{
    for (int i = 0; i < 9; i++) {
        const float x = t->at[t->face[f][i / 3]][i % 3];

        out->low[i % 3] = fminf(out->low[i % 3], x);
        out->high[i % 3] = fmaxf(out->high[i % 3], x);
    }
}

/* The first triangle of a leaf. */
static size_t first_of(const tree *t, size_t leaf)
{
    return (size_t)((uint64_t)t->faces * leaf / t->leaves);
}

static cln_status make_tree(tree *t)
{
    static const box none = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    cln_status st = CLN_OK;
    box all = none;

    for (t->leaves = 1; t->leaves * LEAF < t->faces;)
        t->leaves *= 2;
    CLN_TRY(cln_alloc(&t->order, t->faces, sizeof *t->order, "boxes of triangles"));
    CLN_TRY(cln_alloc(&t->boxes, 2 * t->leaves, sizeof *t->boxes, "boxes of triangles"));
    for (size_t f = 0; f < t->faces; f++)
        add_face(t, (uint32_t)f, &all);
    for (size_t f = 0; f < t->faces; f++) {
        box own = none;
        uint32_t code = 0;

        add_face(t, (uint32_t)f, &own);
        for (int a = 0; a < 3; a++) {
            const double side = (double)all.high[a] - (double)all.low[a];
            const double middle = ((double)own.low[a] + (double)own.high[a]) / 2;
            const double share = side > 0 ? (middle - (double)all.low[a]) / side : 0;

            code |= spread((uint32_t)(share * ((1 << BITS) - 1))) << a;
        }
        t->order[f] = (ordered){code, (uint32_t)f};
    }
    qsort(t->order, t->faces, sizeof *t->order, by_code);
    for (size_t leaf = 0; leaf < t->leaves; leaf++) {
        t->boxes[t->leaves + leaf] = none;
        for (size_t i = first_of(t, leaf); i < first_of(t, leaf + 1); i++)
            add_face(t, t->order[i].face, &t->boxes[t->leaves + leaf]);
    }
    for (size_t i = t->leaves; i-- > 1;)
        for (int a = 0; a < 3; a++) {
            const box *x = &t->boxes[2 * i], *y = &t->boxes[2 * i + 1];

            t->boxes[i].low[a] = fminf(x->low[a], y->low[a]);
            t->boxes[i].high[a] = fmaxf(x->high[a], y->high[a]);
        }
done:
    return st;
}

static double square_to_box(const box *b, const double p[3])
{
    double square = 0;

    for (int a = 0; a < 3; a++) {
        const double away = fmax(0, fmax((double)b->low[a] - p[a], p[a] - (double)b->high[a]));

        square += away * away;
    }
    return square;
}

/* The least square of `least` and those below a node; the nearer half goes first. */
static double nearest(const tree *t, size_t node, const double p[3], double least)
{
    if (node >= t->leaves) {
        const size_t leaf = node - t->leaves;

        for (size_t i = first_of(t, leaf); i < first_of(t, leaf + 1); i++)
            least = fmin(least, square_to(t, t->order[i].face, p));
        return least;
    }
    const double x = square_to_box(&t->boxes[2 * node], p);
    const double y = square_to_box(&t->boxes[2 * node + 1], p);
    const size_t nearer = 2 * node + (y < x);

    if (fmin(x, y) < least)
        least = nearest(t, nearer, p, least);
    if (fmax(x, y) < least)
        least = nearest(t, nearer ^ 1, p, least);
    return least;
}

cln_status cln_deviation(size_t points, const float (*point)[3], size_t faces,
                         const uint32_t (*face)[3], const float (*at)[3], double *out)
{
    cln_status st = CLN_OK;
    const size_t step = (points + CLN_DEVIATION - 1) / CLN_DEVIATION;
    tree t = {.faces = faces, .face = face, .at = at};

    *out = 0;
    if (faces == 0)
        return CLN_OK;
    CLN_TRY(make_tree(&t));
    for (size_t i = 0; i < points; i += step) {
        const double p[3] = {(double)point[i][0], (double)point[i][1], (double)point[i][2]};

        *out = fmax(*out, sqrt(nearest(&t, 1, p, INFINITY)));
    }
done:
    free(t.order);
    free(t.boxes);
    return st;
}
