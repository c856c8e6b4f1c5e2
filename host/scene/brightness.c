/* How bright each photo is beside those that show the same. See brightness.h. */
#include "scene/brightness.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/number.h"
#include "scene/features.h"

const double cln_exposure_jump = 0.7;

/* Of a pair of views: that of a over b's, in stops. */
typedef struct brightness {
    int a, b;
    double ratio;
} brightness;

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

cln_status cln_agree_brightness(int views, cln_agreement *out)
{
    cln_status st = CLN_OK;
    enum { ROUNDS = 200, FEWEST_RATIOS = 8 };
    brightness *pairs = NULL;
    double *ratios = NULL, *sum = NULL, *weight = NULL;
    int count = 0, pair_count = 0;

    CLN_TRY(cln_alloc(&pairs, (size_t)out->pairs + 1, sizeof *pairs, "pairs"));
    CLN_TRY(cln_alloc(&ratios, CLN_FEATURES_MOST + (size_t)out->pairs, sizeof *ratios, "ratios"));
    CLN_TRY(cln_alloc(&sum, (size_t)views, sizeof *sum, "views"));
    CLN_TRY(cln_alloc(&weight, (size_t)views, sizeof *weight, "views"));
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];
        const bool last = i + 1 == out->tie_count || t[1].a != t->a || t[1].b != t->b;

        if (t->agrees && !isnan(t->value_a) && !isnan(t->value_b))
            ratios[count++] = 2.2 * log2(((double)t->value_a + .01) / ((double)t->value_b + .01));
        if (last && count >= FEWEST_RATIOS) {
            cln_reals_sort(ratios, count);
            pairs[pair_count].a = t->a;
            pairs[pair_count].b = t->b;
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
            cln_agree_view *a = &out->views[pairs[p].a], *b = &out->views[pairs[p].b];

            sum[pairs[p].a] += b->exposure + pairs[p].ratio;
            sum[pairs[p].b] += a->exposure - pairs[p].ratio;
            weight[pairs[p].a]++;
            weight[pairs[p].b]++;
        }
        for (int v = 0; v < views; v++)
            if (weight[v] > 0)
                out->views[v].exposure = 0.5 * out->views[v].exposure + 0.5 * sum[v] / weight[v];
    }
    find_jumps(out->views, views, pairs, pair_count, ratios, weight);
    find_around(out->views, views, pairs, pair_count, ratios, sum);
done:
    free(pairs);
    free(ratios);
    free(sum);
    free(weight);
    return st;
}
