/* Parts of a scene whose poses are of two frames. See merged.h.
 *
 * Photos belong together if what two of them share agrees with their poses. Of two parts, marks
 * that photos of both show have two places: where two rays of the one part meet, and where two of
 * the other do. One similarity takes most of the former to the latter (three marks tell it, many
 * agree with it: Fischler and Bolles, "Random Sample Consensus", CACM 1981); of parts in one frame
 * that is about the identity, and parts that show different things have none. */
#include "scene/merged.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/rng.h"
#include "scene/trials.h"
#include "scene/vectors.h"

/* LINK: exactly agreeing ties that join two photos. LEAST: photos of a part. ACROSS: photos of each
 * part that are compared. TRIALS: of three marks. COMMON: marks, at as many places, that make a
 * frame sure. */
enum { LINK = 8, LEAST = 4, ACROSS = 16, TRIALS = 2000, COMMON = 20 };
static const double EXACT = 0.25;       /* share of a tie's tolerance, as STRICT of trials.c */
static const double LINK_SHARE = 0.35;  /* of a pair's ties */
static const double LEAST_SHARE = 0.05; /* a part's, of the views that were compared */
static const double NEAR = 0.05;        /* share of a mark's distance by which places may differ, */
static const double NEAR_SPREAD = 0.2;  /* and of the marks' spread: a small thing is far away */
static const double APART = 0.005;      /* of a mark's distance: nearer ones are at one place */
static const double MOST = 0.3;         /* of the common marks: those that one similarity takes */
static const double SAME = 0.6;         /* of these: those that need none, if frames are one */

typedef struct place {
    double at[3], far; /* far: from the camera */
    double sine;       /* of the angle between its rays, the largest of several; 0: not known */
} place;

typedef struct common {
    place of[2]; /* by the small part, and by the large one */
} common;

typedef struct similarity {
    double scale, turn[9], shift[3];
} similarity;

typedef struct work {
    const cln_scene *scene;
    const cln_features *features;
    const cln_callbacks *callbacks;
    cln_agreement *out;
    int *part; /* [view], of a view that is its part's name */
    int *list; /* [parts], the largest first */
    int parts;
    place **places; /* [view][feature]; NULL: none */
    common *marks;
    int mark_count;
    double near[2]; /* a share of the marks' spread, on either side */
} work;

/* ---- parts ---- */

static int part_of(const work *w, int view)
{
    while (w->part[view] != view)
        view = w->part[view];
    return view;
}

static bool is_exact(const work *w, const cln_tie *t)
{
    static const cln_trial given = {.reading = &cln_readings[0], .focal = 1, .strict = EXACT};

    return t->agrees && cln_tie_agrees(w->scene, t, &given);
}

/* Joins views a pair of which agrees: ties of a pair follow each other. */
static void join(work *w)
{
    const cln_agreement *out = w->out;

    for (int from = 0, to = 0; from < out->tie_count; from = to) {
        const cln_tie *first = &out->ties[from];
        int exact = 0;

        for (to = from;
             to < out->tie_count && out->ties[to].a == first->a && out->ties[to].b == first->b;
             to++)
            exact += is_exact(w, &out->ties[to]);
        if (exact < LINK || exact < LINK_SHARE * (to - from))
            continue;
        w->part[part_of(w, first->b)] = part_of(w, first->a);
    }
}

/* Lists the parts that are large enough to be told, the largest first. */
static cln_status list_parts(work *w)
{
    cln_status st = CLN_OK;
    const int count = w->scene->view_count;
    const double least = fmax(LEAST, LEAST_SHARE * w->out->looked_at);
    int *size = NULL;

    CLN_TRY(cln_alloc(&size, (size_t)count, sizeof *size, "parts"));
    CLN_TRY(cln_alloc(&w->list, (size_t)count, sizeof *w->list, "parts"));
    for (int i = 0; i < count; i++) {
        w->part[i] = part_of(w, i);
        size[w->part[i]]++;
    }
    for (int i = 0; i < count; i++) {
        int at = w->parts;

        if (size[i] < least)
            continue;
        for (; at > 0 && size[w->list[at - 1]] < size[i]; at--)
            w->list[at] = w->list[at - 1];
        w->list[at] = i;
        w->parts++;
    }
done:
    free(size);
    return st;
}

/* ---- places of marks ---- */

static void set_place(work *w, int view, float u, float v, const double at[3], double far,
                      double sine)
{
    const cln_features *f = &w->features[view];

    for (int i = 0; i < f->count; i++) {
        place *p = &w->places[view][i];

        if (f->list[i].u != u || f->list[i].v != v || sine <= p->sine)
            continue;
        memcpy(p->at, at, sizeof p->at);
        p->far = far;
        p->sine = sine;
    }
}

static cln_status find_places(work *w)
{
    cln_status st = CLN_OK;
    const cln_agreement *out = w->out;

    for (int i = 0; i < w->scene->view_count; i++)
        if (w->features[i].list && w->features[i].count)
            CLN_TRY(cln_alloc(&w->places[i], (size_t)w->features[i].count, sizeof **w->places,
                              "places of marks"));
    for (int i = 0; i < out->tie_count; i++) {
        const cln_tie *t = &out->ties[i];
        double o1[3], d1[3], o2[3], d2[3], s = 0, far = 0, at[3], normal[3], sine = 0;

        if (t->cut || part_of(w, t->a) != part_of(w, t->b) || !is_exact(w, t) ||
            !cln_camera_ray(&w->scene->views[t->a].camera, t->ua, t->va, o1, d1) ||
            !cln_camera_ray(&w->scene->views[t->b].camera, t->ub, t->vb, o2, d2))
            continue;
        cln_cross(d1, d2, normal);
        sine = sqrt(cln_dot(normal, normal));
        if (!cln_rays_nearest((const double[3]){o2[0] - o1[0], o2[1] - o1[1], o2[2] - o1[2]}, d1,
                              d2, &s, &far))
            continue;
        for (int k = 0; k < 3; k++)
            at[k] = .5 * (o1[k] + s * d1[k] + o2[k] + far * d2[k]);
        set_place(w, t->a, t->ua, t->va, at, s, sine);
        set_place(w, t->b, t->ub, t->vb, at, far, sine);
    }
done:
    return st;
}

/* ---- marks of two parts ---- */

static void add_marks(work *w, int a, int b)
{
    cln_match matches[CLN_FEATURES_MOST];
    const int count = cln_features_match(&w->features[a], &w->features[b], matches);

    for (int i = 0; i < count; i++) {
        const place *p = &w->places[a][matches[i].a], *q = &w->places[b][matches[i].b];

        if (p->sine > 0 && q->sine > 0)
            w->marks[w->mark_count++] = (common){{*p, *q}};
    }
}

/* The views of a part whose marks are known, at most ACROSS, spread over it. */
static int spread(const work *w, int part, int views[ACROSS])
{
    int size = 0, seen = 0, count = 0;

    for (int i = 0; i < w->scene->view_count; i++)
        size += part_of(w, i) == part && w->places[i];
    for (int i = 0; i < w->scene->view_count; i++)
        if (part_of(w, i) == part && w->places[i]) {
            if (count < ACROSS && seen >= (int64_t)count * size / ACROSS)
                views[count++] = i;
            seen++;
        }
    return count;
}

/* The median distance of the marks from their middle, which is that of each coordinate. */
static double spread_of(const work *w, int of, double *values)
{
    double middle[3];

    for (int a = 0; a < 3; a++) {
        for (int i = 0; i < w->mark_count; i++)
            values[i] = w->marks[i].of[of].at[a];
        cln_reals_sort(values, w->mark_count);
        middle[a] = values[w->mark_count / 2];
    }
    for (int i = 0; i < w->mark_count; i++) {
        values[i] = 0;
        for (int a = 0; a < 3; a++)
            values[i] += pow(w->marks[i].of[of].at[a] - middle[a], 2);
    }
    cln_reals_sort(values, w->mark_count);
    return sqrt(values[w->mark_count / 2]);
}

static cln_status find_marks(work *w, int part, int whole)
{
    cln_status st = CLN_OK;
    int of_part[ACROSS], of_whole[ACROSS];
    const int parts = spread(w, part, of_part), wholes = spread(w, whole, of_whole);
    double *values = NULL;

    w->mark_count = 0;
    for (int i = 0; i < parts; i++) {
        CLN_TRY(cln_tell_work(w->callbacks, NULL, 0, 0));
        for (int k = 0; k < wholes; k++)
            add_marks(w, of_part[i], of_whole[k]);
    }
    if (w->mark_count == 0)
        goto done;
    CLN_TRY(cln_alloc(&values, (size_t)w->mark_count, sizeof *values, "marks of two parts"));
    for (int of = 0; of < 2; of++)
        w->near[of] = NEAR_SPREAD * spread_of(w, of, values);
done:
    free(values);
    return st;
}

/* ---- similarities ---- */

/* Axes of a triangle: along its first side, across it, off it; false: it has hardly any area. */
static bool axes_of(double p[3][3], double axes[3][3], double *size)
{
    double other[3];

    *size = 0;
    for (int a = 0; a < 3; a++) {
        axes[0][a] = p[1][a] - p[0][a];
        other[a] = p[2][a] - p[0][a];
        *size += pow(p[1][a] - p[0][a], 2) + pow(p[2][a] - p[1][a], 2) + pow(other[a], 2);
    }
    *size = sqrt(*size);
    cln_cross(axes[0], other, axes[2]);
    if (!(sqrt(cln_dot(axes[2], axes[2])) > 0.02 * *size * *size))
        return false;
    cln_unit(axes[0]);
    cln_unit(axes[2]);
    cln_cross(axes[2], axes[0], axes[1]);
    return true;
}

static bool similar(common *const marks[3], similarity *out)
{
    double p[2][3][3], axes[2][3][3], size[2], middle[2][3] = {{0}};

    for (int of = 0; of < 2; of++) {
        for (int i = 0; i < 3; i++)
            for (int a = 0; a < 3; a++) {
                p[of][i][a] = marks[i]->of[of].at[a];
                middle[of][a] += p[of][i][a] / 3;
            }
        if (!axes_of(p[of], axes[of], &size[of]))
            return false;
    }
    out->scale = size[1] / size[0];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            out->turn[3 * i + k] = 0;
            for (int a = 0; a < 3; a++)
                out->turn[3 * i + k] += axes[1][a][i] * axes[0][a][k];
        }
    for (int i = 0; i < 3; i++)
        out->shift[i] = middle[1][i] - out->scale * cln_dot(&out->turn[3 * i], middle[0]);
    return true;
}

static bool fits(const work *w, const common *m, const similarity *s)
{
    const double near = fmin(fmin(NEAR * m->of[1].far, w->near[1]),
                             s->scale * fmin(NEAR * m->of[0].far, w->near[0]));
    double square = 0;

    for (int i = 0; i < 3; i++)
        square +=
            pow(s->scale * cln_dot(&s->turn[3 * i], m->of[0].at) + s->shift[i] - m->of[1].at[i], 2);
    return square < near * near;
}

static int count_fitting(const work *w, const similarity *s)
{
    int count = 0;

    for (int i = 0; i < w->mark_count; i++)
        count += fits(w, &w->marks[i], s);
    return count;
}

static int find_similarity(const work *w, similarity *best)
{
    int most = 0;

    for (uint32_t t = 0; t < TRIALS && w->mark_count >= COMMON; t++) {
        similarity s;
        common *marks[3];
        int count = 0;

        for (uint32_t k = 0; k < 3; k++)
            marks[k] = &w->marks[(int)(cln_uniform_hash(0, CLN_STREAM_MERGED, 0, t, k, 0) *
                                       (float)w->mark_count)];
        if (!similar(marks, &s))
            continue;
        count = count_fitting(w, &s);
        if (count > most) {
            most = count;
            *best = s;
        }
    }
    return most;
}

/* The ratio of the sizes of what fits: surer than that of three marks. */
static double scale_of(const work *w, const similarity *s)
{
    double middle[2][3] = {{0}}, square[2] = {0};
    int count = 0;

    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < w->mark_count; i++) {
            const common *m = &w->marks[i];

            if (!fits(w, m, s))
                continue;
            count += !pass;
            for (int of = 0; of < 2; of++)
                for (int a = 0; a < 3; a++) {
                    if (!pass)
                        middle[of][a] += m->of[of].at[a];
                    else
                        square[of] += pow(m->of[of].at[a] - middle[of][a] / count, 2);
                }
        }
    return sqrt(square[1] / square[0]);
}

static const similarity none = {1, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0}};

static bool is_near(const place *a, const place *b)
{
    const double d[3] = {a->at[0] - b->at[0], a->at[1] - b->at[1], a->at[2] - b->at[2]};

    return sqrt(cln_dot(d, d)) <= APART * a->far;
}

/* Do the marks that fit lie at COMMON places by either part? What looks alike in many photos of
 * both is as many marks as there are pairs of these, but few places, and any three of them fit. */
static bool has_places(const work *w, const similarity *s)
{
    int count = 0;

    for (int of = 0; of < 2; of++) {
        const place *seen[COMMON];

        count = 0;
        for (int i = 0; i < w->mark_count && count < COMMON; i++) {
            const place *p = &w->marks[i].of[of];
            int k = 0;

            if (!fits(w, &w->marks[i], s))
                continue;
            while (k < count && !is_near(p, seen[k]))
                k++;
            if (k == count)
                seen[count++] = p;
        }
        if (count < COMMON)
            return false;
    }
    return true;
}

/* Leaves in the list the largest part, and those that the poses as they are do not join to it, not
 * even over others: of a large set so few photos are compared that it falls apart. */
static cln_status leave_joined_out(work *w)
{
    cln_status st = CLN_OK;
    int *joined = NULL, count = 1, left = 1;

    CLN_TRY(cln_alloc(&joined, (size_t)w->parts, sizeof *joined, "parts"));
    joined[0] = w->list[0];
    for (int at = 0; at < count; at++) {
        left = 1;
        for (int i = 1; i < w->parts; i++) {
            int same = 0;

            CLN_TRY(find_marks(w, w->list[i], joined[at]));
            same = count_fitting(w, &none);
            if (same >= COMMON && same >= MOST * w->mark_count)
                joined[count++] = w->list[i];
            else
                w->list[left++] = w->list[i];
        }
        w->parts = left;
    }
done:
    free(joined);
    return st;
}

/* Do the poses as they are join the part to the others, by the ties of all its pairs together? Of
 * neighbours that share little, as photos along the narrow side of a thing, it is one by chance. */
static bool is_joined(const work *w, int part)
{
    int ties = 0, exact = 0;

    for (int i = 0; i < w->out->tie_count; i++) {
        const cln_tie *t = &w->out->ties[i];

        if ((part_of(w, t->a) == part) == (part_of(w, t->b) == part))
            continue;
        ties++;
        exact += is_exact(w, t);
    }
    return exact >= LINK && exact >= LINK_SHARE * ties;
}

/* Is the part in another frame than the largest? */
static cln_status judge(work *w, int part)
{
    cln_status st = CLN_OK;
    cln_agree_merged *out = &w->out->merged;
    similarity s = none;
    int most = 0;

    if (is_joined(w, part))
        goto done;
    CLN_TRY(find_marks(w, part, w->list[0]));
    most = find_similarity(w, &s);
    if (most < COMMON || most < MOST * w->mark_count || count_fitting(w, &none) > SAME * most ||
        !has_places(w, &s))
        goto done;
    if (!out->parts++) {
        out->marks = w->mark_count;
        out->fitting = most;
        out->scale = scale_of(w, &s);
        out->degrees = 57.29577951308232 *
                       acos(fmax(-1, fmin(1, .5 * (s.turn[0] + s.turn[4] + s.turn[8] - 1))));
    }
    for (int i = 0; i < w->scene->view_count; i++)
        out->has[i] = out->has[i] || part_of(w, i) == part;
done:
    return st;
}

cln_status cln_find_merged(const cln_scene *scene, const cln_features *features,
                           const cln_callbacks *callbacks, cln_agreement *out)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)scene->view_count;
    work w = {.scene = scene, .features = features, .callbacks = callbacks, .out = out};

    CLN_TRY(cln_alloc(&w.part, count, sizeof *w.part, "parts"));
    CLN_TRY(cln_alloc(&w.places, count, sizeof *w.places, "places of marks"));
    CLN_TRY(cln_alloc(&out->merged.has, count, sizeof *out->merged.has, "parts"));
    for (int i = 0; i < scene->view_count; i++)
        w.part[i] = i;
    join(&w);
    CLN_TRY(list_parts(&w));
    if (w.parts < 2)
        goto done;
    CLN_TRY(cln_alloc(&w.marks, (size_t)ACROSS * ACROSS * CLN_FEATURES_MOST, sizeof *w.marks,
                      "marks of two parts"));
    CLN_TRY(find_places(&w));
    CLN_TRY(leave_joined_out(&w));
    for (int i = 1; i < w.parts; i++)
        CLN_TRY(judge(&w, w.list[i]));
done:
    for (size_t i = 0; w.places && i < count; i++)
        free(w.places[i]);
    free(w.places);
    free(w.marks);
    free(w.list);
    free(w.part);
    return st;
}
