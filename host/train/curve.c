/* See curve.h. */
#include "train/curve.h"

#include <math.h>

/* Halves the points. Of every two, one with a test PSNR stays, as these are few. */
static void thin_out(cln_curve *c)
{
    for (int i = 0; i < CLN_CURVE_POINTS / 2; i++)
        c->points[i] = c->points[isfinite(c->points[2 * i + 1].test) ? 2 * i + 1 : 2 * i];
    c->count = CLN_CURVE_POINTS / 2;
    c->every *= 2;
}

void cln_curve_add(cln_curve *c, const cln_curve_point *point)
{
    if (c->count > 0 && !isfinite(point->test) &&
        point->seconds < c->points[c->count - 1].seconds + c->every)
        return;
    if (c->count == CLN_CURVE_POINTS)
        thin_out(c);
    c->points[c->count++] = *point;
}
