/* A ray's way from its leaves through stage 1's points to its stage-2 samples, by rays.c and
 * sampling.c; and whether float32 may decide differently on it, so that comparisons of a device's
 * discrete results can leave such rays out. See reference.h. */
#include <math.h>
#include "base/rng.h"
#include "device_abi.h"
#include "reference/reference.h"

static bool near_integer(double x, double within)
{
    return fabs(x - round(x)) < within;
}

int ref_way_intervals(const ref_way *way, const double o[3], const double d[3],
                      ref_interval out[REF_MOST_INTERVALS])
{
    const int n = ref_intervals(way->tree, o, d, out, REF_MOST_INTERVALS);
    double begin = 0, end = INFINITY;
    int kept = 0;

    if (!way->crop)
        return n;
    for (int k = 0; k < 6; k++) {
        const float *plane = way->crop[k];
        double here = (double)plane[3], along = 0;

        for (int a = 0; a < 3; a++) {
            here += (double)plane[a] * o[a];
            along += (double)plane[a] * d[a];
        }
        if (along > 0)
            begin = fmax(begin, -here / along);
        else if (along < 0)
            end = fmin(end, -here / along);
        else if (here < 0)
            end = -1;
    }
    for (int i = 0; i < n; i++) {
        const ref_interval v = {out[i].slot, fmax(out[i].t_in, begin), fmin(out[i].t_out, end)};

        if (v.t_out - v.t_in > (double)CLN_MIN_CHORD)
            out[kept++] = v;
    }
    return kept;
}

/* A line of a ray, for t from begin to end; only in a shell space a ray has several. */
typedef struct line {
    double o[3], d[3], begin, end;
    int row;
} line;

static int lines_of(const ref_way *way, const float *fo, const float *fd, line out[CLN_LINE_ROWS])
{
    int count = 0;

    for (int row = way->lines; row < (way->lines ? CLN_LINE_ROWS : 1); row++) {
        const float *o = fo + 4 * row, *d = fd + 4 * row;

        if (way->lines && !(o[3] < 1e30f))
            break;
        out[count++] = (line){{o[0], o[1], o[2]},
                              {d[0], d[1], d[2]},
                              way->lines ? (double)o[3] : -INFINITY,
                              way->lines ? (double)d[3] : INFINITY,
                              row};
    }
    return count;
}

/* The intervals of a line whose origin is moved by `moved`. */
static int line_intervals(const ref_way *way, const line *l, const double moved[3],
                          ref_interval out[REF_MOST_INTERVALS])
{
    const double o[3] = {l->o[0] + moved[0], l->o[1] + moved[1], l->o[2] + moved[2]};
    const int n = ref_way_intervals(way, o, l->d, out);
    int kept = 0;

    for (int i = 0; i < n; i++) {
        const ref_interval v = {out[i].slot, fmax(out[i].t_in, l->begin),
                                fmin(out[i].t_out, l->end)};

        if (v.t_out - v.t_in > (double)CLN_MIN_CHORD)
            out[kept++] = v;
    }
    return kept;
}

/* Returns whether the line meets other leaves if it is moved a little, or only just meets one.
 * Lines of a shell space end at faces of leaves, many at a small angle: they are moved less. */
static bool near_edges(const ref_way *way, const line *l, const ref_interval *iv, int n)
{
    const double move = way->lines ? REF_NEAR / 8 : REF_NEAR;
    ref_interval other[REF_MOST_INTERVALS];

    for (int i = 0; i < n; i++)
        if (way->lines && iv[i].t_out - iv[i].t_in < 10 * REF_NEAR)
            return true;
    for (int k = 0; k < 6; k++) {
        double moved[3] = {0, 0, 0};
        int m = 0;

        moved[k / 2] += k % 2 ? move : -move;
        m = line_intervals(way, l, moved, other);
        if (m != n)
            return true;
        for (int i = 0; i < n; i++) {
            if (other[i].slot != iv[i].slot)
                return true;
        }
    }
    return false;
}

static double leaf_side(const cln_octree *tree, int slot)
{
    return 2.0 / (1 << tree->level[tree->leaf[slot]]);
}

double ref_interval_depth(const ref_interval *v, ref_points p)
{
    double edges[2 * REF_MOST_POINTS + 2], densities[2 * REF_MOST_POINTS + 1], tau = 0;
    const int bins = ref_bins(v->t_in, v->t_out, p, edges, densities);

    for (int j = 0; j < bins; j++)
        tau += densities[j] * (edges[j + 1] - edges[j]);
    return tau;
}

double ref_interval_sure(const ref_interval *v, ref_points p)
{
    double sum = 0;

    for (int j = 0; j + 1 < p.m; j++)
        sum += p.sigma[j] * (v->t_out - v->t_in) / p.m;
    return sum;
}

/* Returns whether rounding could change this interval's number of samples. */
static bool close_count(const ref_sampling *s, double length, double side, double tau_in,
                        double tau)
{
    const double weight = exp(-tau_in) * -expm1(-tau);

    if (s->min_transmittance > 0 && fabs(exp(-tau_in) / s->min_transmittance - 1) < 1e-3)
        return true;
    if (!s->by_weight)
        return near_integer(s->samples_per_leaf * length / (sqrt(3) * side), 1e-3);
    if (s->empty_weight > 0 && fabs(weight / s->empty_weight - 1) < 1e-3)
        return true;
    return near_integer(s->samples_per_ray * weight + 0.5, 1e-3);
}

int ref_gather_points(void *user, int r, const double o[3], const double d[3],
                      const ref_interval *v, double *t, double *sigma, double *lengths, bool *close)
{
    const ref_gather_cache *g = user;
    const int n1 = g->n1;
    const float *box = g->boxes + 4 * v->slot;
    const double scale = n1 / (double)box[3];
    const int m =
        ref_gather(o, d, v, box, g->cache + v->slot * n1 * n1 * n1, n1, t, sigma, REF_MOST_POINTS);

    (void)r;
    CLN_ASSERT(m <= REF_MOST_POINTS);
    *close = *close || near_integer((v->t_out - v->t_in) * scale, 1e-3);
    for (int j = 0; j < m; j++) {
        lengths[j] = INFINITY;
        for (int a = 0; a < 3; a++) {
            const double cell = (o[a] + t[j] * d[a] - box[a]) * scale;

            *close = *close ||
                     (near_integer(cell, REF_NEAR / 4 * scale) && cell > 0.5 && cell < n1 - 0.5);
        }
    }
    return m;
}

/* A ray that is being sampled. */
typedef struct progress {
    double all, sure;   /* optical depth that was met */
    uint32_t met, kept; /* intervals; those with samples */
} progress;

static void sample_interval(const ref_way *way, int r, const line *l, const ref_interval *v,
                            progress *at_ray, ref_samples *out)
{
    const double side = leaf_side(way->tree, v->slot), length = v->t_out - v->t_in;
    double t[REF_MOST_POINTS], sigma[REF_MOST_POINTS], lengths[REF_MOST_POINTS];
    double xi[256], at[256], delta[256];
    const int m = way->points(way->user, r, l->o, l->d, v, t, sigma, lengths, &out->close);
    const ref_points points = {m, t, sigma, lengths};
    const double optical_depth = ref_interval_depth(v, points);
    const float chance = cln_uniform_hash(way->seed, CLN_STREAM_SAMPLES, way->step, (uint32_t)r,
                                          CLN_DRAW_ROULETTE + at_ray->met++, 0);
    const double tau = fmin(at_ray->all, at_ray->sure + log(4));
    const int count = ref_sample_count(&way->rule, length, side, tau, optical_depth, chance);

    out->close = out->close || close_count(&way->rule, length, side, tau, optical_depth);
    at_ray->all += optical_depth;
    at_ray->sure += way->points == ref_gather_points ? ref_interval_sure(v, points) : optical_depth;
    CLN_ASSERT(count <= 256 && out->n + count <= REF_MOST_SAMPLES);
    for (int k = 0; k < count; k++) {
        xi[k] = way->jitter ? (double)cln_uniform_hash(way->seed, CLN_STREAM_SAMPLES, way->step,
                                                       (uint32_t)r, at_ray->kept, (uint32_t)k)
                            : 0.5;
    }
    at_ray->kept += count > 0;
    ref_sample_positions(&way->rule, v->t_in, v->t_out, points, count, xi, at);
    ref_deltas(v->t_in, v->t_out, count, at, delta);
    for (int k = 0; k < count; k++) {
        out->t[out->n] = at[k];
        out->delta[out->n] = delta[k];
        out->row[out->n] = l->row;
        out->slot[out->n++] = v->slot;
    }
}

void ref_ray_samples(const ref_way *way, int r, const float *fo, const float *fd, ref_samples *out)
{
    line lines[CLN_LINE_ROWS];
    const int count = lines_of(way, fo, fd, lines);
    progress at = {0, 0, 0, 0};

    out->n = 0;
    out->close = false;
    for (int k = 0; k < count; k++) {
        ref_interval iv[REF_MOST_INTERVALS];
        const int n = line_intervals(way, &lines[k], (double[3]){0, 0, 0}, iv);

        out->close = out->close || near_edges(way, &lines[k], iv, n);
        for (int i = 0; i < n; i++)
            sample_interval(way, r, &lines[k], &iv[i], &at, out);
    }
}
