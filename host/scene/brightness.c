/* How bright each photo is beside those that show the same. See brightness.h. */
#include "scene/brightness.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/number.h"
#include "scene/features.h"
#include "scene/trials.h"

const double cln_exposure_jump = 0.7;

/* Powers of distance that are exceeded where light goes along, and how surely: fading(). */
static const double BESIDE = 0.25, SURE_BESIDE = 3, THROUGH = 1, SURE = 5;

/* Of a pair of views: that of a over b's, in stops, and how many marks tell it. */
typedef struct brightness {
    int a, b, marks;
    double ratio;
} brightness;

/* Marks from which a pair counts whole, and may tell of a single photo; and counts at all: visits
 * in other light have few marks in common, but many such pairs. */
enum { ENOUGH_MARKS = 8, FEWEST_MARKS = 3 };

static bool jumps(const cln_agree_view *v)
{
    return fabs(v->jump) > cln_exposure_jump;
}

/* jump: the median over a view's pairs, then over its pairs with views that do not jump, if there
 * are any: next to two faulty photos, the good ones look faulty at first. values: room for those of
 * a view. next: for all views. */
static void find_jumps(cln_agree_view *views, int view_count, const brightness *pairs,
                       int pair_count, double *values, double *next)
{
    enum { ROUNDS = 4 };

    for (int v = 0; v < view_count; v++)
        views[v].jump = 0;
    for (int round = 0; round < ROUNDS; round++) {
        for (int v = 0; v < view_count; v++) {
            int count = 0;

            next[v] = round == 0 ? NAN : views[v].jump;
            for (int p = 0; p < pair_count; p++) {
                const bool is_a = pairs[p].a == v;

                if ((is_a || pairs[p].b == v) && !jumps(&views[is_a ? pairs[p].b : pairs[p].a]))
                    values[count++] = is_a ? pairs[p].ratio : -pairs[p].ratio;
            }
            cln_reals_sort(values, count);
            if (count > 0)
                next[v] = values[count / 2];
        }
        for (int v = 0; v < view_count; v++)
            views[v].jump = next[v];
    }
}

/* around: the median over a view's partners of the largest difference from others, but for those
 * that jump, too: these may be as faulty. most: for all views. */
static void find_around(cln_agree_view *views, int view_count, const brightness *pairs,
                        int pair_count, double *values, double *most)
{
    for (int v = 0; v < view_count; v++) {
        int count = 0;

        memset(most, 0, (size_t)view_count * sizeof *most);
        for (int p = 0; p < pair_count; p++) {
            const int a = pairs[p].a, b = pairs[p].b;

            if (a == v || b == v)
                continue;
            if (!jumps(&views[b]))
                most[a] = fmax(most[a], fabs(pairs[p].ratio));
            if (!jumps(&views[a]))
                most[b] = fmax(most[b], fabs(pairs[p].ratio));
        }
        for (int p = 0; p < pair_count; p++)
            if (pairs[p].a == v || pairs[p].b == v)
                values[count++] = most[pairs[p].a == v ? pairs[p].b : pairs[p].a];
        cln_reals_sort(values, count);
        views[v].around = count ? values[count / 2] : 0;
    }
}

/* Of a tie, in factors of 2; or NaN. ratio: the mark's brightness in a over that in b; way: its
 * distance from b over that from a. */
typedef struct compared {
    double ratio, way;
} compared;

static compared compare(const cln_scene *scene, const cln_tie *t)
{
    compared c = {NAN, NAN};
    double o1[3], d1[3], o2[3], d2[3], from_a = 0, from_b = 0;

    if (!t->agrees || isnan(t->value_a) || isnan(t->value_b))
        return c;
    c.ratio = 2.2 * log2(((double)t->value_a + .01) / ((double)t->value_b + .01));
    if (cln_camera_ray(&scene->views[t->a].camera, t->ua, t->va, o1, d1) &&
        cln_camera_ray(&scene->views[t->b].camera, t->ub, t->vb, o2, d2) &&
        cln_rays_nearest((const double[3]){o2[0] - o1[0], o2[1] - o1[1], o2[2] - o1[2]}, d1, d2,
                         &from_a, &from_b) &&
        from_a > 0 && from_b > 0)
        c.way = log2(from_b / from_a);
    return c;
}

/* Do marks fade faster than with this power of their distance? In standard deviations of what
 * chance brings. beside: one mark beside the next of the same two photos, whose exposures do not
 * matter then; else as if there were one exposure. */
static double fading(const cln_agreement *a, const compared *marks, double power, bool beside)
{
    double sum = 0, squares = 0;

    for (int i = 0, last = -1; i < a->tie_count; i++) {
        const int other = beside ? last : -1;
        double way = marks[i].way, more = marks[i].ratio;

        if (isnan(way))
            continue;
        last = i;
        if (beside &&
            (other < 0 || a->ties[other].a != a->ties[i].a || a->ties[other].b != a->ties[i].b))
            continue;
        way -= beside ? marks[other].way : 0;
        more -= power * way + (beside ? marks[other].ratio : 0);
        sum += more > 0 ? way : -way;
        squares += way * way;
    }
    return squares > 0 ? sum / sqrt(squares) : 0;
}

/* The power of its distance with which a mark fades where a lamp goes along with the camera, 2 or
 * so, of least absolute errors; 0: it does not do so beyond doubt. Exposure that changes along a
 * way forward looks like that, but not in two photos: there less is told, as far things are others
 * than near ones. */
static double find_falloff(const cln_agreement *a, const compared *marks)
{
    double low = 0, high = 8;

    if (fading(a, marks, BESIDE, true) < SURE_BESIDE || fading(a, marks, THROUGH, false) < SURE)
        return 0;
    while (high - low > 0.01)
        *(fading(a, marks, (low + high) / 2, false) > 0 ? &low : &high) = (low + high) / 2;
    return low;
}

cln_status cln_agree_brightness(const cln_scene *scene, cln_agreement *out)
{
    cln_status st = CLN_OK;
    enum { ROUNDS = 200 };
    const int views = scene->view_count;
    brightness *pairs = NULL;
    compared *marks = NULL;
    double *ratios = NULL, *sum = NULL, *weight = NULL;
    int count = 0, pair_count = 0, firm = 0;

    CLN_TRY(cln_alloc(&pairs, (size_t)out->pairs + 1, sizeof *pairs, "pairs"));
    CLN_TRY(cln_alloc(&ratios, (size_t)out->tie_count + (size_t)out->pairs + 1, sizeof *ratios,
                      "ratios"));
    CLN_TRY(cln_alloc(&sum, (size_t)views, sizeof *sum, "views"));
    CLN_TRY(cln_alloc(&weight, (size_t)views, sizeof *weight, "views"));
    CLN_TRY(cln_alloc(&marks, (size_t)out->tie_count + 1, sizeof *marks, "ties"));
    for (int i = 0; i < out->tie_count; i++)
        marks[i] = compare(scene, &out->ties[i]);
    out->falloff = find_falloff(out, marks);
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];
        const double ratio = marks[i].ratio - (out->falloff > 0 ? out->falloff * marks[i].way : 0);
        const bool last = i + 1 == out->tie_count || t[1].a != t->a || t[1].b != t->b;

        if (!isnan(ratio))
            ratios[count++] = ratio;
        if (last && count >= FEWEST_MARKS) {
            cln_reals_sort(ratios, count);
            pairs[pair_count].a = t->a;
            pairs[pair_count].b = t->b;
            pairs[pair_count].marks = count;
            pairs[pair_count++].ratio = ratios[count / 2];
        }
        count = last ? 0 : count;
    }
    for (int v = 0; v < views; v++)
        out->views[v].exposure = NAN;
    for (int p = 0; p < pair_count; p++)
        out->views[pairs[p].a].exposure = out->views[pairs[p].b].exposure = 0;
    for (int round = 0; round < ROUNDS; round++) {
        memset(sum, 0, (size_t)views * sizeof *sum);
        memset(weight, 0, (size_t)views * sizeof *weight);
        for (int p = 0; p < pair_count; p++) {
            const double whole = fmin(1, (double)pairs[p].marks / ENOUGH_MARKS);
            cln_agree_view *a = &out->views[pairs[p].a], *b = &out->views[pairs[p].b];

            sum[pairs[p].a] += whole * (b->exposure + pairs[p].ratio);
            sum[pairs[p].b] += whole * (a->exposure - pairs[p].ratio);
            weight[pairs[p].a] += whole;
            weight[pairs[p].b] += whole;
        }
        for (int v = 0; v < views; v++)
            if (weight[v] > 0)
                out->views[v].exposure = 0.5 * out->views[v].exposure + 0.5 * sum[v] / weight[v];
    }
    for (int p = 0; p < pair_count; p++)
        if (pairs[p].marks >= ENOUGH_MARKS)
            pairs[firm++] = pairs[p];
    find_jumps(out->views, views, pairs, firm, ratios, weight);
    find_around(out->views, views, pairs, firm, ratios, sum);
done:
    free(marks);
    free(pairs);
    free(ratios);
    free(sum);
    free(weight);
    return st;
}
