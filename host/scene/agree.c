/* Ties between neighbouring views and how far they agree with the poses; see agree.h.
 *
 * A tie agrees if its two rays meet, up to TOLERANCE pixels, before both cameras. With their
 * directions d1, d2 and the vector b from one camera to the other, they meet if (b x d1) . d2 = 0,
 * at any distance. A few of a hundred false ties agree by chance. */
#include "scene/agree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "scene/brightness.h"
#include "scene/features.h"
#include "scene/merged.h"
#include "scene/trials.h"

/* ASKED: views that are compared with others, each with NEIGHBOURS. STRAYS: photos that are
 * compared with all others. */
enum { ASKED = 96, NEIGHBOURS = 3, STRAYS = 8 };
/* Fewest ties that say anything about a set, about a view, and against one (objects of equal parts
 * have a dozen wrong ones); agreeing ties that make partners. */
enum {
    FEWEST = 100,
    FEWEST_TO_READ = 24, /* that tell other axes from given ones, where nearly all agree */
    FEWEST_OF_VIEW = 8,
    FEWEST_OF_BAD = 16, /* and FEW_OF_BAD of a view's mean */
    PARTNERS_SHARE = 6,
    STILL_OF_PAIR = 4
};
static const double TOLERANCE = 2; /* pixels, at the size at which features are found */
static const double STILL = 1;     /* pixels of the size at which features are found */
static const double STILL_SHARE = 0.1, STILL_PAIRS = 0.3; /* of the ties; of the pairs */
static const double GOOD = 0.5;      /* share of agreeing ties of a set that can tell bad views */
static const double KEPT_GOOD = 0.7; /* of kept ties, from which on they tell enough */
static const double BAD = 0.2;       /* share of a bad view over that of all and of the views it
                                         is compared with */
static const double FEW_OF_BAD = 0.25, GAIN = 0.2; /* share that another pose must gain */
static const double OVER = 0.25; /* share of a turned photo's ties, of others up to 0.13 */
static const double STRAY = 0.7; /* share of a stray over that of all views */
static const double NEAR = 0.25; /* how unlike a view of a video and the next are at most */
static const double BETWEEN = 0.25, BETWEEN_LEAST = 0.05; /* off the middle, over the way */

typedef struct work {
    const cln_scene *scene;
    const cln_callbacks *callbacks;
    cln_agreement *out;
    cln_features *features; /* [view]; list NULL: not found yet */
    double reach;           /* typical distance of a camera from the middle of all */
    int pairs[ASKED * (NEIGHBOURS + 1)][2]; /* that were compared: out->pairs */
} work;

static const cln_camera *camera_of(const work *w, int view)
{
    return &w->scene->views[view].camera;
}

static double tolerance_of(const work *w, int view)
{
    return TOLERANCE * w->features[view].pixel / camera_of(w, view)->fx;
}

static const cln_trial GIVEN = {.reading = &cln_readings[0], .focal = 1, .strict = 1};

/* ---- neighbours ---- */

/* How unlike two views are: the distance between them, in units of `reach`, plus the angle between
 * their directions, in units of 45 degrees. INFINITY for two in one place, whose rays always
 * meet. */
static double unlike(const work *w, int a, int b)
{
    const double *m = camera_of(w, a)->c2w, *n = camera_of(w, b)->c2w;
    double way = 0, cosine = 0;

    for (int i = 0; i < 3; i++) {
        way += (m[4 * i + 3] - n[4 * i + 3]) * (m[4 * i + 3] - n[4 * i + 3]);
        cosine += m[4 * i + 2] * n[4 * i + 2];
    }
    if (sqrt(way) <= 1e-6 * w->reach)
        return INFINITY;
    return sqrt(way) / w->reach + acos(fmax(-1, fmin(1, cosine))) / 0.7853981633974483;
}

static cln_status find_reach(work *w)
{
    cln_status st = CLN_OK;
    const int count = w->scene->view_count;
    double *values = NULL, middle[3];

    CLN_TRY(cln_alloc(&values, (size_t)count, sizeof *values, "cameras"));
    for (int a = 0; a < 3; a++) {
        for (int i = 0; i < count; i++)
            values[i] = camera_of(w, i)->c2w[4 * a + 3];
        cln_reals_sort(values, count);
        middle[a] = values[count / 2];
    }
    for (int i = 0; i < count; i++) {
        values[i] = 0;
        for (int a = 0; a < 3; a++)
            values[i] += pow(camera_of(w, i)->c2w[4 * a + 3] - middle[a], 2);
    }
    cln_reals_sort(values, count);
    w->reach = sqrt(values[count / 2]);
    if (!(w->reach > 0))
        w->reach = 1;
done:
    free(values);
    return st;
}

static void find_neighbours(const work *w, int view, int out[NEIGHBOURS], int *count)
{
    double best[NEIGHBOURS];

    *count = 0;
    for (int i = 0; i < w->scene->view_count; i++) {
        const double here = i == view ? INFINITY : unlike(w, view, i);
        int place = *count;

        if (here == INFINITY)
            continue;
        for (; place > 0 && best[place - 1] > here; place--)
            if (place < NEIGHBOURS) {
                best[place] = best[place - 1];
                out[place] = out[place - 1];
            }
        if (place < NEIGHBOURS) {
            best[place] = here;
            out[place] = i;
            *count += *count < NEIGHBOURS;
        }
    }
}

static cln_status need_features(work *w, int view)
{
    if (w->features[view].list)
        return CLN_OK;
    return cln_features_find(&w->scene->views[view], &w->features[view]);
}

/* ---- ties ---- */

/* cut: of what is cut away. */
static cln_status add_ties(work *w, int a, int b, bool cut)
{
    cln_status st = CLN_OK;
    cln_agreement *out = w->out;
    const cln_features *found[2] = {&w->features[a], &w->features[b]};
    const cln_features parts[2] = {cln_features_cut(found[0]), cln_features_cut(found[1])};
    const cln_features *of_a = cut ? &parts[0] : found[0], *of_b = cut ? &parts[1] : found[1];
    cln_match matches[CLN_FEATURES_MOST];
    const int count = cln_features_match(of_a, of_b, matches);

    for (int i = 0; i < count; i++) {
        const cln_feature *f = &of_a->list[matches[i].a], *g = &of_b->list[matches[i].b];

        CLN_TRY(cln_grow(&out->ties, out->tie_count, sizeof *out->ties, "ties"));

        out->ties[out->tie_count++] = (cln_tie){.a = a,
                                                .b = b,
                                                .ua = f->u,
                                                .va = f->v,
                                                .ub = g->u,
                                                .vb = g->v,
                                                .value_a = f->value,
                                                .value_b = g->value,
                                                .tolerance = (float)tolerance_of(w, a),
                                                .cut = cut};
    }
done:
    return st;
}

static cln_status compare(work *w, int a, int b)
{
    cln_status st = CLN_OK;

    for (int i = 0; i < w->out->pairs; i++)
        if ((w->pairs[i][0] == a && w->pairs[i][1] == b) ||
            (w->pairs[i][0] == b && w->pairs[i][1] == a))
            return CLN_OK;
    CLN_TRY(need_features(w, a));
    CLN_TRY(need_features(w, b));
    w->out->views[a].looked_at = w->out->views[b].looked_at = true;
    CLN_TRY(add_ties(w, a, b, false));
    CLN_TRY(add_ties(w, a, b, true));
    w->pairs[w->out->pairs][0] = a;
    w->pairs[w->out->pairs++][1] = b;
done:
    return st;
}

/* Compares each chosen view with its neighbours by pose, and with the next by name: photos are
 * mostly taken in order, and poses may be wrong. */
static cln_status find_ties(work *w)
{
    cln_status st = CLN_OK;
    const int count = w->scene->view_count, asked = count < ASKED ? count : ASKED;

    for (int i = 0; i < asked; i++) {
        const int view = (int)((int64_t)i * count / asked);
        int neighbours[NEIGHBOURS], found = 0;

        CLN_TRY(cln_tell_work(w->callbacks, "compared", i, asked));
        find_neighbours(w, view, neighbours, &found);
        for (int k = 0; k < found; k++)
            CLN_TRY(compare(w, view, neighbours[k]));
        if (view + 1 < count && unlike(w, view, view + 1) < INFINITY)
            CLN_TRY(compare(w, view, view + 1));
    }
    CLN_TRY(cln_tell_work(w->callbacks, "compared", asked, asked));
    for (int i = 0; i < count; i++) {
        w->out->looked_at += w->out->views[i].looked_at;
        w->out->views[i].features = w->features[i].count;
    }
done:
    return st;
}

/* ---- what agrees ---- */

/* Leaves out ties of what is cut away, unless these fit the poses and the others do not, or are too
 * few: then masks keep the wrong side, or a thing without texture in a sound place. */
static void leave_cut_out(work *w)
{
    cln_agreement *out = w->out;
    int all[2] = {0}, agreeing[2] = {0}, left = 0;
    int kept = 0, could = 0; /* of what agrees where both photos could cut it away */

    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];
        const bool agrees = cln_tie_agrees(w->scene, t, &GIVEN);

        all[t->cut]++;
        agreeing[t->cut] += agrees;
        if (agrees && cln_view_cut(&w->scene->views[t->a]) &&
            cln_view_cut(&w->scene->views[t->b])) {
            could++;
            kept += !t->cut;
        }
    }
    if (could >= FEWEST)
        out->kept_share = (double)kept / could;
    if (agreeing[1] >= FEWEST && agreeing[1] >= GOOD * all[1] &&
        (all[0] < FEWEST || agreeing[0] < KEPT_GOOD * all[0]))
        return;
    for (int i = 0; i < out->tie_count; i++)
        if (!out->ties[i].cut)
            out->ties[left++] = out->ties[i];
    out->tie_count = left;
}

/* Is a mark of `view` at one place in both pictures? */
static bool in_place(const work *w, int view, float ua, float va, float ub, float vb)
{
    const float most = (float)(STILL * w->features[view].pixel);

    return fabsf(ua - ub) < most && fabsf(va - vb) < most;
}

/* Is the tie that, although by the likeliest reading it should not be? */
static bool is_still(const work *w, const cln_tie *t)
{
    const cln_trial read = {.reading = &cln_readings[w->out->reading], .focal = 1, .strict = 1};

    return in_place(w, t->a, t->ua, t->va, t->ub, t->vb) && !cln_tie_agrees(w->scene, t, &read);
}

/* Leaves out what stands still, if that is many ties of many pairs: not of copies of a photo. */
static bool leave_still_out(work *w)
{
    cln_agreement *out = w->out;
    int still = 0, pairs = 0, of_pair = 0, left = 0;

    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];

        of_pair = i && t[-1].a == t->a && t[-1].b == t->b ? of_pair : 0;
        of_pair += is_still(w, t);
        still += is_still(w, t);
        pairs += is_still(w, t) && of_pair == STILL_OF_PAIR;
    }
    if (still < FEWEST || still < STILL_SHARE * out->tie_count || pairs < STILL_PAIRS * out->pairs)
        return false;
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];

        if (!in_place(w, t->a, t->ua, t->va, t->ub, t->vb)) /* some agree by chance */
            out->ties[left++] = *t;
    }
    out->still = out->tie_count - left;
    out->still_share = (double)out->still / out->tie_count;
    out->tie_count = left;
    return true;
}

/* Counts in `turned` and `stored`. */
static void count_turned(work *w)
{
    cln_agreement *out = w->out;

    for (int i = 0; i < out->tie_count; i++) {
        cln_tie t = out->ties[i];
        const bool a = cln_view_turn_spot(&w->scene->views[t.a], &t.ua, &t.va);
        const bool b = cln_view_turn_spot(&w->scene->views[t.b], &t.ub, &t.vb);

        if (!a && !b)
            continue;
        out->turned += cln_tie_agrees(w->scene, &t, &GIVEN);
        out->stored += cln_tie_agrees(w->scene, &out->ties[i], &GIVEN);
    }
}

bool cln_agree_turned(const cln_agreement *a)
{
    return a->turned >= FEWEST_OF_BAD && a->turned > 2 * a->stored;
}

bool cln_agree_stored(const cln_agreement *a)
{
    return a->stored >= FEWEST_OF_BAD && a->stored > 2 * a->turned;
}

static void count_agreeing(work *w)
{
    cln_agreement *out = w->out;
    int64_t before = -1;
    int good = 0;

    for (int i = 0; i < out->tie_count; i++) {
        cln_tie *t = &out->ties[i];
        cln_agree_view *a = &out->views[t->a], *b = &out->views[t->b];
        const int64_t pair = (int64_t)t->a * w->scene->view_count + t->b;

        t->agrees = cln_tie_agrees(w->scene, t, &GIVEN);
        a->ties++;
        b->ties++;
        a->agreeing += t->agrees;
        b->agreeing += t->agrees;
        out->agreeing += t->agrees;
        good = before == pair ? good + t->agrees : t->agrees;
        before = pair; /* ties of a pair follow each other */
        if (t->agrees && good == PARTNERS_SHARE) {
            a->partners++;
            b->partners++;
        }
    }
    out->share = out->tie_count < FEWEST ? NAN : (double)out->agreeing / out->tie_count;
}

/* ---- single views ---- */

/* Finds the photos that were turned by 180 degrees, of views that agree with no other: by ties with
 * those that do. */
static cln_status find_over(work *w)
{
    cln_status st = CLN_OK;
    cln_agreement *out = w->out;
    int(*counts)[2] = NULL; /* [view] ties, and those that agree once it is turned */

    CLN_TRY(cln_alloc(&counts, (size_t)w->scene->view_count, sizeof *counts, "views"));
    for (int i = 0; i < out->tie_count; i++) {
        cln_tie t = out->ties[i];
        const bool alone = out->views[t.a].partners == 0;
        const int view = alone ? t.a : t.b;
        const cln_camera *c = camera_of(w, view);

        if (alone == (out->views[t.b].partners == 0))
            continue;
        *(alone ? &t.ua : &t.ub) = (float)c->width - (alone ? t.ua : t.ub);
        *(alone ? &t.va : &t.vb) = (float)c->height - (alone ? t.va : t.vb);
        counts[view][0]++;
        counts[view][1] += cln_tie_agrees(w->scene, &t, &GIVEN);
    }
    for (int i = 0; i < w->scene->view_count; i++)
        out->views[i].over = counts[i][1] >= FEWEST_OF_VIEW && counts[i][1] > OVER * counts[i][0];
done:
    free(counts);
    return st;
}

/* Counts the ties of a photo with the neighbours of a pose, and those that would agree if it had
 * been taken there. */
static cln_status try_pose(work *w, int photo, int pose, int *ties, int *agreeing)
{
    cln_status st = CLN_OK;
    const cln_camera *there = camera_of(w, pose);
    cln_match matches[CLN_FEATURES_MOST];
    int neighbours[NEIGHBOURS], found = 0;

    *ties = *agreeing = 0;
    find_neighbours(w, pose, neighbours, &found);
    CLN_TRY(need_features(w, photo));
    for (int k = 0; k < found; k++) {
        int count = 0;

        if (neighbours[k] == photo || w->out->views[neighbours[k]].bad)
            continue;
        CLN_TRY(need_features(w, neighbours[k]));
        count = cln_features_match(&w->features[photo], &w->features[neighbours[k]], matches);
        for (int i = 0; i < count; i++) {
            const cln_feature *f = &w->features[photo].list[matches[i].a];
            const cln_feature *g = &w->features[neighbours[k]].list[matches[i].b];
            double o1[3], d1[3], o2[3], d2[3];

            *agreeing += cln_camera_ray(there, f->u, f->v, o1, d1) &&
                         cln_camera_ray(camera_of(w, neighbours[k]), g->u, g->v, o2, d2) &&
                         cln_rays_meet(o1, d1, o2, d2, tolerance_of(w, photo));
        }
        *ties += count;
    }
done:
    return st;
}

/* Does the photo show what other photos show, wherever those are? */
static bool is_related(const work *w, int photo)
{
    enum { MANY = 24 };
    cln_match matches[CLN_FEATURES_MOST];

    for (int i = 0; i < w->scene->view_count; i++) {
        int count = 0, moved = 0;

        if (i == photo || !w->features[i].list)
            continue;
        count = cln_features_match(&w->features[photo], &w->features[i], matches);
        for (int k = 0; k < count; k++) {
            const cln_feature *f = &w->features[photo].list[matches[k].a];
            const cln_feature *g = &w->features[i].list[matches[k].b];

            moved += !w->out->still || !in_place(w, photo, f->u, f->v, g->u, g->v);
        }
        if (moved >= MANY)
            return true;
    }
    return false;
}

static double share_of_view(const cln_agree_view *v)
{
    return (double)v->agreeing / (v->ties + 1);
}

/* Finds the views whose ties agree less often than those of most, the worst first. */
static int find_strays(const work *w, int strays[STRAYS])
{
    const cln_agreement *out = w->out;
    int count = 0;

    for (int i = 0; i < w->scene->view_count; i++) {
        const double share = share_of_view(&out->views[i]);
        int place = count;

        if (!out->views[i].looked_at || out->views[i].features < FEWEST_OF_VIEW ||
            share > STRAY * out->share)
            continue;
        for (; place > 0 && share_of_view(&out->views[strays[place - 1]]) > share; place--)
            if (place < STRAYS)
                strays[place] = strays[place - 1];
        if (place < STRAYS) {
            strays[place] = i;
            count += count < STRAYS;
        }
    }
    return count;
}

/* The share of agreeing ties of the views with which one was compared, its own ties apart. */
static cln_status share_around(const work *w, int view, double *share)
{
    cln_status st = CLN_OK;
    const cln_agreement *out = w->out;
    bool *near = NULL;
    int ties = 0, agreeing = 0;

    CLN_TRY(cln_alloc(&near, (size_t)w->scene->view_count, sizeof *near, "views"));
    for (int i = 0; i < w->scene->view_count; i++)
        near[i] = false;
    for (int i = 0; i < out->pairs; i++)
        for (int k = 0; k < 2; k++)
            if (w->pairs[i][k] == view)
                near[w->pairs[i][1 - k]] = true;
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];

        if (t->a == view || t->b == view)
            continue;
        ties += near[t->a] + near[t->b];
        agreeing += t->agrees ? near[t->a] + near[t->b] : 0;
    }
    *share = (double)agreeing / (ties + 1);
done:
    free(near);
    return st;
}

/* Does the pose lie between those of the photos before and after it by name, all near each other,
 * as in a video? Then it is right, whatever one picture of a swing has in common with others. */
static bool is_between(const work *w, int view)
{
    const cln_view *views = w->scene->views;
    const double *before = NULL, *after = NULL, *here = camera_of(w, view)->c2w;
    int sides[2] = {-1, -1};

    for (int i = 0; i < w->scene->view_count; i++) {
        const int order = cln_natural_compare(views[i].name, views[view].name);
        int *side = &sides[order > 0];
        const int nearer = *side < 0 ? 0 : cln_natural_compare(views[i].name, views[*side].name);

        if (order != 0 && (*side < 0 || (order < 0 ? nearer > 0 : nearer < 0)))
            *side = i;
    }
    if (sides[0] < 0 || sides[1] < 0 || unlike(w, sides[0], view) > NEAR ||
        unlike(w, view, sides[1]) > NEAR)
        return false;
    before = camera_of(w, sides[0])->c2w;
    after = camera_of(w, sides[1])->c2w;
    for (int k = 0; k < 4; k++) { /* the axes, and the place */
        double way = 0, off = 0;

        for (int i = 0; i < 12; i += 4) {
            way += pow(after[i + k] - before[i + k], 2);
            off += pow(here[i + k] - .5 * (before[i + k] + after[i + k]), 2);
        }
        if (sqrt(off) > BETWEEN * sqrt(way) + BETWEEN_LEAST * (k < 3 ? 1 : w->reach))
            return false;
    }
    return true;
}

/* Do hardly any of a view's ties agree, although it has as many as others, and those of the views
 * around it do? */
static cln_status is_bad(const work *w, int view, bool *bad)
{
    cln_status st = CLN_OK;
    const cln_agreement *out = w->out;
    const cln_agree_view *v = &out->views[view];
    const double mean = 2.0 * out->tie_count / out->looked_at;
    double around = 0;

    *bad = v->partners == 0 && v->ties >= fmax(FEWEST_OF_BAD, FEW_OF_BAD * mean);
    if (*bad)
        CLN_TRY(share_around(w, view, &around));
    *bad = *bad && share_of_view(v) < BAD * fmin(out->share, around) && !is_between(w, view) &&
           is_related(w, view);
done:
    return st;
}

/* A view is bad if hardly any of its ties agree although its photo is related to others; or if its
 * photo fits the pose of another stray and not its own. A neighbour of a bad view has bad ties with
 * it, but good ones with others. */
static cln_status find_bad(work *w)
{
    cln_status st = CLN_OK;
    cln_agreement *out = w->out;
    int strays[STRAYS], count = 0;

    for (int i = 0; i < w->scene->view_count; i++)
        out->views[i].pose_of = -1;
    if (!(out->share >= GOOD))
        goto done;
    count = find_strays(w, strays);
    for (int i = 0; i < count; i++) {
        cln_agree_view *v = &out->views[strays[i]];
        int ties = 0, agreeing = 0;
        double own = 0, best = 0;

        CLN_TRY(is_bad(w, strays[i], &v->bad));
        CLN_TRY(try_pose(w, strays[i], strays[i], &ties, &agreeing));
        own = (double)agreeing / (ties + 1);
        for (int k = 0; k < count; k++) {
            if (i == k)
                continue;
            CLN_TRY(try_pose(w, strays[i], strays[k], &ties, &agreeing));
            if (agreeing >= FEWEST_OF_VIEW &&
                (double)agreeing / (ties + 1) > fmax(best, own + GAIN)) {
                best = (double)agreeing / (ties + 1);
                v->pose_of = strays[k];
            }
        }
    }
    for (int i = 0; i < count; i++) { /* must hold both ways, else one is just near the other */
        cln_agree_view *v = &out->views[strays[i]];

        if (v->pose_of >= 0 && out->views[v->pose_of].pose_of == strays[i])
            v->bad = out->views[v->pose_of].bad = true;
    }
done:
    return st;
}

/* ---- points ---- */

static cln_status find_points(work *w)
{
    cln_status st = CLN_OK;
    cln_agreement *out = w->out;

    CLN_TRY(cln_alloc(&out->points, (size_t)out->agreeing, sizeof *out->points, "points"));
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *tie = &out->ties[i];
        double o1[3], d1[3], o2[3], d2[3], s = 0, t = 0;

        if (!tie->agrees || !cln_camera_ray(camera_of(w, tie->a), tie->ua, tie->va, o1, d1) ||
            !cln_camera_ray(camera_of(w, tie->b), tie->ub, tie->vb, o2, d2))
            continue;
        if (!cln_rays_nearest((const double[3]){o2[0] - o1[0], o2[1] - o1[1], o2[2] - o1[2]}, d1,
                              d2, &s, &t))
            continue;
        for (int a = 0; a < 3; a++)
            out->points[out->point_count][a] = .5 * (o1[a] + s * d1[a] + o2[a] + t * d2[a]);
        out->point_count++;
    }
done:
    return st;
}

cln_status cln_agree(const cln_scene *scene, const cln_callbacks *callbacks, cln_agreement *out)
{
    cln_status st = CLN_OK;
    work w = {.scene = scene, .callbacks = callbacks, .out = out};

    *out = (cln_agreement){.share = NAN, .kept_share = NAN, .focal = 1};
    CLN_TRY(cln_alloc(&out->views, (size_t)scene->view_count, sizeof *out->views, "views"));
    CLN_TRY(cln_alloc(&w.features, (size_t)scene->view_count, sizeof *w.features, "features"));
    CLN_TRY(find_reach(&w));
    CLN_TRY(find_ties(&w));
    leave_cut_out(&w);
    if (out->tie_count >= FEWEST_TO_READ)
        cln_try_readings(scene, out);
    if (leave_still_out(&w) && out->tie_count >= FEWEST_TO_READ)
        cln_try_readings(scene, out);
    count_agreeing(&w);
    CLN_TRY(cln_find_merged(scene, w.features, callbacks, out));
    CLN_TRY(cln_try_parts(scene, out));
    CLN_TRY(cln_try_orders(scene, out));
    CLN_TRY(cln_try_places(scene, out));
    CLN_TRY(cln_try_tilts(scene, out));
    count_turned(&w);
    CLN_TRY(find_over(&w));
    CLN_TRY(find_bad(&w));
    CLN_TRY(cln_agree_brightness(scene, out));
    CLN_TRY(find_points(&w));
done:
    for (int i = 0; w.features && i < scene->view_count; i++)
        free(w.features[i].list);
    free(w.features);
    return st;
}

void cln_agreement_free(cln_agreement *a)
{
    free(a->part.has);
    free(a->merged.has);
    free(a->views);
    free(a->ties);
    free(a->points);
    *a = (cln_agreement){0};
}
