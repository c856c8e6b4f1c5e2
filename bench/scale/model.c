/* A step's time by ranks, and the fit of costs. See model.h. */
#include "scale/model.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum {
    SAMPLE_BYTES = 16,
    STRETCH_BYTES = 32,
    DEPTH_BYTES = 4,
    COUNT_BYTES = 8,
    INTERVAL_BYTES = 20,
    PIXEL_BYTES = 4
};

static double change_rate(double leaves, double ranks)
{
    return fmin(1, cbrt(ranks / leaves));
}

double scale_stretches(double passed, double leaves, double ranks)
{
    return 1 + (passed - 1) * change_rate(leaves, ranks);
}

double scale_passed(double stretches, double leaves, double ranks)
{
    return 1 + (stretches - 1) / change_rate(leaves, ranks);
}

double scale_passes(double leaves)
{
    return cbrt(leaves);
}

/* The integral of 1 - F^n to the right of 0 and of -F^n to its left, F: the distribution. */
double scale_slowest(double n)
{
    const double step = 1.0 / 256;
    double sum = 0;

    for (double x = -10 + step / 2; x < 10; x += step)
        sum += (x > 0) - pow(0.5 * erfc(-x / sqrt(2)), n);
    return sum * step;
}

static bool deals_rays(const scale_work *w)
{
    return w->walk == SCALE_OWN_RAYS && w->ranks > 2;
}

double scale_sent(const scale_work *w, double share, double leaf_share)
{
    const double stretch = STRETCH_BYTES + (w->walk == SCALE_OWN_CELLS ? DEPTH_BYTES : 0);
    const double told = w->stretches > 0 ? stretch * w->stretches : SAMPLE_BYTES * w->samples;
    const double kept = w->walk == SCALE_OWN_CELLS ? 0 : w->density_bytes * w->leaves;
    const double met = deals_rays(w) ? COUNT_BYTES * w->rays + INTERVAL_BYTES * w->intervals : 0;
    const double even = (PIXEL_BYTES * w->rays + met) / w->ranks;

    if (!(w->ranks > 1))
        return 0;
    return (share * told + even + leaf_share * kept / w->refresh_every) * (w->ranks - 1);
}

/* Parts into which boxes cut an axis. */
static double parts_of(double ranks, int axis)
{
    const double bits = floor(log2(ranks) + 1e-9);
    const double parts = exp2(floor((bits + axis) / 3));

    return axis == 2 ? parts * ranks / exp2(bits) : parts; /* the axis that is cut first */
}

double scale_faces(double leaves, double ranks)
{
    double cuts = 0;

    for (int axis = 0; axis < 3; axis++)
        cuts += parts_of(ranks, axis) - 1;
    return cuts * pow(leaves, 2.0 / 3);
}

double scale_first_faces(double leaves, double ranks)
{
    double parts = 0;

    for (int axis = 0; axis < 3; axis++)
        parts += parts_of(ranks, axis) > 1 ? parts_of(ranks, axis) : 0;
    return parts / ranks * pow(leaves, 2.0 / 3);
}

/* Of the vertices on a face, those with samples in the cells around them. */
static double met_of(const scale_work *w, double around)
{
    return -expm1(-w->places * around * w->samples / w->leaves / pow(w->cells, 3));
}

static double face_bytes(const scale_work *w)
{
    return w->row_bytes * (w->cells + 1) * (w->cells + 1);
}

double scale_vertices(const scale_work *w)
{
    if (!(w->cells > 0))
        return 0;
    return scale_faces(w->leaves, w->ranks) / w->ranks * face_bytes(w) *
           (met_of(w, 4) + met_of(w, 8));
}

double scale_first_vertices(const scale_work *w)
{
    return w->cells > 0 ? scale_first_faces(w->leaves, w->ranks) * face_bytes(w) * met_of(w, 8) : 0;
}

scale_step scale_predict(const scale_machine *m, const scale_network *net, const scale_work *w)
{
    scale_step s = {.sent = scale_sent(w, 1 / w->ranks, 1 / w->ranks) + scale_vertices(w)};
    const double met = w->leaves * -expm1(-w->samples / w->leaves);
    const double passes = m->repeated.leaf * scale_passes(w->leaves) * w->rays;
    double dealt = 0, waits = 1; /* of the time for passes; messages that wait, of a step */

    if (deals_rays(w)) {
        dealt = passes;
        waits += 2;
    } else if (w->walk == SCALE_OWN_CELLS) {
        dealt = m->cells * passes;
        waits += 1;
    }
    if (w->walk != SCALE_OWN_CELLS)
        waits += 1 / w->refresh_every;
    s.shared = m->shared.step + (dealt + m->shared.each * w->samples + m->shared.leaf * met +
                                 m->refresh * w->leaves / w->refresh_every) *
                                    w->balance / w->ranks;
    s.repeated = m->repeated.step + m->repeated.each * w->rays + passes - dealt;
    if (w->ranks > 1) /* with equal shares a rank receives as much as it sends */
        s.messages = net->latency * (ceil(log2(w->ranks)) * waits + (w->cells > 0 ? 2 : 0)) +
                     s.sent / net->bandwidth;
    s.waiting = m->spread * scale_slowest(w->ranks) * (s.shared + s.repeated);
    s.total = s.shared + s.repeated + s.messages + s.waiting;
    return s;
}

/* Brings the normal equations to diagonal form; columns not in use have 1 on the diagonal. 0 if the
 * columns depend on each other. */
static int solve(double a[3][4])
{
    for (int i = 0; i < 3; i++) {
        int pivot = i;

        for (int r = i + 1; r < 3; r++)
            if (fabs(a[r][i]) > fabs(a[pivot][i]))
                pivot = r;
        if (!(fabs(a[pivot][i]) > 1e-12))
            return 0;
        for (int c = 0; c < 4; c++) {
            const double t = a[i][c];

            a[i][c] = a[pivot][c];
            a[pivot][c] = t;
        }
        for (int r = 0; r < 3; r++) {
            const double f = a[r][i] / a[i][i];

            for (int c = i; c < 4 && r != i; c++)
                a[r][c] -= f * a[i][c];
        }
    }
    return 1;
}

scale_cost scale_fit(int n, const double (*x)[3], const double *seconds)
{
    double best[3] = {0}, least = INFINITY, unit[3];

    for (int k = 0; k < 3; k++) { /* columns of the order of 1 */
        unit[k] = 0;
        for (int i = 0; i < n; i++)
            unit[k] = fmax(unit[k], x[i][k] / seconds[i]);
    }
    /* tries every choice of columns, keeps the best fit without negative costs */
    for (int used = 1; used < 8; used++) {
        double a[3][4] = {{0}}, error = 0;
        int legal = 1;

        for (int r = 0; r < 3; r++) {
            for (int i = 0; i < n && (used >> r & 1); i++) {
                const double xr = x[i][r] / seconds[i] / unit[r];

                for (int c = 0; c < 3; c++)
                    if (used >> c & 1)
                        a[r][c] += xr * x[i][c] / seconds[i] / unit[c];
                a[r][3] += xr;
            }
            if (!(used >> r & 1))
                a[r][r] = 1;
        }
        if (!solve(a))
            continue;
        for (int k = 0; k < 3; k++)
            legal = legal && a[k][3] / a[k][k] >= 0;
        for (int i = 0; i < n; i++) {
            double sum = -1;

            for (int k = 0; k < 3; k++)
                sum += a[k][3] / a[k][k] * x[i][k] / seconds[i] / unit[k];
            error += sum * sum;
        }
        if (legal && error < least) {
            least = error;
            for (int k = 0; k < 3; k++)
                best[k] = a[k][3] / a[k][k] / unit[k];
        }
    }
    return (scale_cost){best[0], best[1], best[2]};
}
