/* Cameras that are tried in place of the given ones. See trials.h. */
#include "scene/trials.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/text.h"
#include "scene/vectors.h"

/* TRIED: ties on which readings are tried; PART_TRIED: focal lengths of a part. FOLDERS: most that
 * are tried as parts. */
enum { TRIED = 12000, PART_TRIED = 2000, FOLDERS = 8, NAME = 100 };
/* Of positions: axes in each order and with each sign; these, and one axis in feet or metres. */
enum { SIGNED_AXES = 48, PLACES = SIGNED_AXES + 6 };
enum { FEWEST = 100, FEWEST_VIEWS = 3 }; /* ties, views that say anything about a part */
static const double STRICT =
    0.25; /* share of the tolerance for focal lengths, whose effect is small */
static const double FAR_APART = 3e-4; /* squared sine of 1 deg, from which on distances are known */
static const double MOST_FOCAL = 2.7;
static const double COARSE = 1.02, FINE = 1.004; /* steps of focal lengths */
static const double DOUBT = 0.7, INEXACT = 0.45; /* as UNSURE and EXACT of inspect_poses.c */
static const double PART_GAIN = 1.5, PART_LEAST = 0.15, PART_EXACT = 0.5;
static const double ORDER_GAIN = 1.5, ORDER_LEAST = 0.35;
static const double TILT_MOST = 75, TILT_COARSE = 2.5, TILT_FINE = 0.5; /* degrees */
static const double AROUND = 0.9;       /* length of the mean of axes that go around something */
static const double EQUALLY_FAR = 1.02; /* the farthest camera over the nearest one */

/* ---- two rays ---- */

bool cln_rays_nearest(const double b[3], const double d1[3], const double d2[3], double *s,
                      double *t)
{
    const double c = cln_dot(d1, d2), far = 1 - c * c;

    *s = (cln_dot(d1, b) - c * cln_dot(d2, b)) / far;
    *t = (c * cln_dot(d1, b) - cln_dot(d2, b)) / far;
    return far > FAR_APART;
}

bool cln_rays_meet(const double o1[3], const double d1[3], const double o2[3], const double d2[3],
                   double tolerance)
{
    const double b[3] = {o2[0] - o1[0], o2[1] - o1[1], o2[2] - o1[2]};
    double n1[3], n2[3], s = 0, t = 0, size = 0;

    cln_cross(b, d1, n1);
    cln_cross(b, d2, n2);
    size = sqrt(cln_dot(n1, n1) + cln_dot(n2, n2));
    if (!(fabs(cln_dot(n1, d2)) <= tolerance * size) || size <= 1e-9 * sqrt(cln_dot(b, b)))
        return false;
    return !cln_rays_nearest(b, d1, d2, &s, &t) || (s > 0 && t > 0);
}

static double focal_of(const cln_trial *trial, int view)
{
    return !trial->group || trial->group[view] ? trial->focal : 1;
}

static cln_camera tried(const cln_scene *scene, int view, const cln_trial *trial)
{
    cln_camera c = scene->views[view].camera;
    const int pose = trial->pose_of ? trial->pose_of[view] : view;

    cln_reading_pose(trial->reading,
                     trial->poses ? trial->poses[pose] : scene->views[pose].camera.c2w, c.c2w);
    c.fx *= focal_of(trial, view);
    c.fy *= focal_of(trial, view);
    return c;
}

/* Does the trial have poses for both of a tie's views, and change one of them? */
static bool is_asked(const cln_tie *tie, const cln_trial *trial)
{
    if (trial->pose_of && (trial->pose_of[tie->a] < 0 || trial->pose_of[tie->b] < 0))
        return false;
    return !trial->group || trial->group[tie->a] || trial->group[tie->b];
}

bool cln_tie_agrees(const cln_scene *scene, const cln_tie *tie, const cln_trial *trial)
{
    const cln_camera a = tried(scene, tie->a, trial), b = tried(scene, tie->b, trial);
    double o1[3], d1[3], o2[3], d2[3];

    return cln_camera_ray(&a, tie->ua, tie->va, o1, d1) &&
           cln_camera_ray(&b, tie->ub, tie->vb, o2, d2) &&
           cln_rays_meet(o1, d1, o2, d2,
                         trial->strict * (double)tie->tolerance / focal_of(trial, tie->a));
}

/* Of every so many-th tie that the trial asks about, the share that agrees. */
static double share_of(const cln_scene *scene, const cln_agreement *a, const cln_trial *trial,
                       int step)
{
    int met = 0, asked = 0, seen = 0;

    for (int i = 0; i < a->tie_count; i++) {
        if (!is_asked(&a->ties[i], trial) || seen++ % step != 0)
            continue;
        met += cln_tie_agrees(scene, &a->ties[i], trial);
        asked++;
    }
    return asked ? (double)met / asked : 0;
}

static int count_asked(const cln_agreement *a, const cln_trial *trial)
{
    int asked = 0;

    for (int i = 0; i < a->tie_count; i++)
        asked += is_asked(&a->ties[i], trial);
    return asked;
}

/* Finds the trial's focal length with which most ties agree exactly: in coarse steps, then in fine
 * ones around the best, as a hundredth beside the right one few marks at the border agree any more.
 * Returns their share; 1 is kept if none is better. */
static double try_focals(const cln_scene *scene, const cln_agreement *a, cln_trial *trial, int step)
{
    const int coarse = (int)(log(MOST_FOCAL) / log(COARSE)), fine = (int)(log(COARSE) / log(FINE));
    double best = 1, middle = 1, best_share = 0;

    trial->focal = 1;
    best_share = share_of(scene, a, trial, step);
    for (int pass = 0; pass < 2; pass++) {
        const int most = pass ? fine : coarse;

        middle = best;
        for (int i = -most; i <= most; i++) {
            double share = 0;

            trial->focal = middle * pow(pass ? FINE : COARSE, i);
            share = share_of(scene, a, trial, step);
            if (share > best_share) {
                best_share = share;
                best = trial->focal;
            }
        }
    }
    trial->focal = best;
    return best_share;
}

/* ---- readings, and focal lengths of all ---- */

void cln_try_readings(const cln_scene *scene, cln_agreement *out)
{
    const int step = out->tie_count / TRIED + 1;
    cln_trial trial = {.focal = 1, .strict = 1};

    for (int i = 0; i < CLN_READINGS; i++) {
        double share = 0;

        trial.reading = &cln_readings[i];
        share = share_of(scene, out, &trial, step);
        if (i == 0)
            out->given_share = share;
        if (i == 0 || share > out->reading_share) {
            out->reading = i;
            out->reading_share = share;
        }
    }
    trial.strict = STRICT;
    trial.reading = &cln_readings[out->reading];
    out->strict_share = share_of(scene, out, &trial, step);
    out->focal = 1;
    out->focal_share = out->strict_share;
    for (int i = 0; i < (out->reading ? 2 : 1); i++) { /* which fits best may be chance */
        double share = 0;

        trial.reading = &cln_readings[i ? out->reading : 0];
        trial.strict = STRICT;
        share = try_focals(scene, out, &trial, step);
        if (share < out->focal_share)
            continue;
        out->focal = trial.focal;
        out->focal_share = share;
        trial.strict = 1;
        out->focal_exact = share / share_of(scene, out, &trial, step);
    }
}

/* ---- focal lengths of some ---- */

static int by_name(const void *a, const void *b)
{
    const cln_view *const *left = a, *const *right = b;

    return cln_natural_compare((*left)->name, (*right)->name);
}

/* Allocates the views in the natural order of their names. */
static cln_status name_order(const cln_scene *scene, const cln_view ***out)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(out, (size_t)scene->view_count, sizeof **out, "views"));
    for (int i = 0; i < scene->view_count; i++)
        (*out)[i] = &scene->views[i];
    qsort(*out, (size_t)scene->view_count, sizeof **out, by_name);
done:
    return st;
}

/* Marks the photos of the `which`-th part, in the order of names: folders, then every second photo,
 * from the first or from the second on. Returns whether there is such a part, of not too few. */
static bool mark_part(const cln_scene *scene, const cln_view **order, int which,
                      cln_agree_part *out)
{
    const int count = scene->view_count;
    int folders = 0, marked = 0;

    for (int i = 0; i < count; i++) {
        const size_t length = cln_folder_length(order[i]->name);
        const bool same = i && cln_folder_length(order[i - 1]->name) == length &&
                          memcmp(order[i - 1]->name, order[i]->name, length) == 0;

        folders += !same;
        out->has[order[i] - scene->views] =
            which < FOLDERS ? folders - 1 == which : i % 2 == which - FOLDERS;
        if (which < FOLDERS && folders - 1 == which && !same)
            snprintf(out->name, sizeof out->name, "photos in %.*s", (int)(length ? length : 1),
                     length ? order[i]->name : ".");
        if (which >= FOLDERS && i == which - FOLDERS)
            snprintf(out->name, sizeof out->name, "every second photo from %.*s on",
                     (int)cln_utf8_whole(order[i]->name, NAME), order[i]->name);
        marked += out->has[order[i] - scene->views];
    }
    if (which < FOLDERS && (folders < 2 || folders > FOLDERS))
        return false;
    return marked >= FEWEST_VIEWS && count - marked >= FEWEST_VIEWS;
}

cln_status cln_try_parts(const cln_scene *scene, cln_agreement *out)
{
    cln_status st = CLN_OK;
    const cln_view **order = NULL;
    bool *has = NULL;

    if (out->share >= DOUBT || isnan(out->share))
        return CLN_OK;
    CLN_TRY(name_order(scene, &order));
    CLN_TRY(cln_alloc(&has, (size_t)scene->view_count, sizeof *has, "views"));
    for (int which = 0; which < FOLDERS + 2; which++) {
        cln_agree_part part = {.has = has};
        cln_trial trial = {.reading = &cln_readings[0], .focal = 1, .group = has, .strict = STRICT};
        int ties = 0, step = 0;

        if (!mark_part(scene, order, which, &part) || (ties = count_asked(out, &trial)) < FEWEST)
            continue;
        step = ties / PART_TRIED + 1;
        part.given = share_of(scene, out, &trial, step);
        part.share = try_focals(scene, out, &trial, step);
        part.focal = trial.focal;
        trial.strict = 1;
        if (part.share < PART_LEAST || part.share < PART_GAIN * part.given ||
            part.share < PART_EXACT * share_of(scene, out, &trial, step) ||
            part.share - part.given <= out->part.share - out->part.given)
            continue;
        if (!out->part.has)
            CLN_TRY(cln_alloc(&part.has, (size_t)scene->view_count, sizeof *has, "views"));
        else
            part.has = out->part.has;
        memcpy(part.has, has, (size_t)scene->view_count * sizeof *has);
        out->part = part;
    }
done:
    free(order);
    free(has);
    return st;
}

/* ---- orders ---- */

static int by_bytes(const void *a, const void *b)
{
    const cln_view *const *left = a, *const *right = b;

    return strcmp((*left)->name, (*right)->name);
}

enum { REVERSED = 100, BY_NUMBER, AS_TEXT };

/* Mistakes of scripts that put names and poses together; what would be right. */
static const struct {
    int shift; /* by how many places, in the order of names; or one of the above */
    const char *text;
} orders[CLN_ORDERS] = {
    {1, "each has the pose that the one after it by name has now"},
    {-1, "each has the pose that the one before it by name has now"},
    {2, "each has the pose that the second one after it by name has now"},
    {-2, "each has the pose that the second one before it by name has now"},
    {REVERSED, "the poses are put to the names in the opposite order"},
    {BY_NUMBER, "the names are sorted by their numbers (1, 2, 10), not as text (1, 10, 2)"},
    {AS_TEXT, "the names are sorted as text (1, 10, 2), not by their numbers (1, 2, 10)"},
};

/* natural, bytes: the views in the order of their names, by numbers and as text. Returns whether it
 * changes anything. */
static bool fill_order(const cln_scene *scene, const cln_view **natural, const cln_view **bytes,
                       int shift, int *pose_of)
{
    const int count = scene->view_count;
    bool changes = false;

    for (int r = 0; r < count; r++) {
        const cln_view *photo = shift == AS_TEXT ? bytes[r] : natural[r], *pose = NULL;

        if (shift == REVERSED)
            pose = natural[count - 1 - r];
        else if (shift == BY_NUMBER)
            pose = bytes[r];
        else if (shift == AS_TEXT)
            pose = natural[r];
        else if (r + shift >= 0 && r + shift < count)
            pose = natural[r + shift];
        pose_of[photo - scene->views] = pose ? (int)(pose - scene->views) : -1;
        changes = changes || pose != photo;
    }
    return changes;
}

/* Or is there too little to tell? */
static bool is_sound(const cln_agreement *a)
{
    return isnan(a->share) || (a->share >= DOUBT && a->strict_share >= INEXACT * a->reading_share);
}

/* Of ties with the trial's poses: the share that agrees exactly; 0 if it is not clearly above that
 * of the likeliest reading. */
static double exact_if_clear(const cln_scene *scene, const cln_agreement *a, cln_trial trial)
{
    const int step = a->tie_count / TRIED + 1;
    double share = 0, exact = 0;

    trial.strict = 1;
    share = share_of(scene, a, &trial, step);
    trial.strict = STRICT;
    exact = share_of(scene, a, &trial, step);
    return share < ORDER_LEAST || exact < INEXACT * share || exact <= ORDER_GAIN * a->strict_share
               ? 0
               : exact;
}

cln_status cln_try_orders(const cln_scene *scene, cln_agreement *out)
{
    cln_status st = CLN_OK;
    const cln_view **natural = NULL, **bytes = NULL;
    int *pose_of = NULL;

    if (is_sound(out))
        return CLN_OK;
    CLN_TRY(name_order(scene, &natural));
    CLN_TRY(cln_alloc(&bytes, (size_t)scene->view_count, sizeof *bytes, "views"));
    memcpy(bytes, natural, (size_t)scene->view_count * sizeof *bytes);
    qsort(bytes, (size_t)scene->view_count, sizeof *bytes, by_bytes);
    CLN_TRY(cln_alloc(&pose_of, (size_t)scene->view_count, sizeof *pose_of, "views"));
    for (int i = 0; i < CLN_ORDERS; i++) {
        const cln_trial trial = {.reading = &cln_readings[0], .focal = 1, .pose_of = pose_of};
        double exact = 0;

        if (!fill_order(scene, natural, bytes, orders[i].shift, pose_of))
            continue;
        exact = exact_if_clear(scene, out, trial);
        if (exact <= out->order_exact)
            continue;
        out->order = orders[i].text;
        out->order_exact = exact;
    }
done:
    free(natural);
    free(bytes);
    free(pose_of);
    return st;
}

/* ---- positions ---- */

/* The i-th of PLACES, the given one first: those that change least before others, as along an axis
 * in which all cameras are level its sign does not matter. */
static cln_agree_place place_of(int i)
{
    static const int axes[6][3] = {{0, 1, 2}, {1, 0, 2}, {2, 1, 0},
                                   {0, 2, 1}, {1, 2, 0}, {2, 0, 1}};
    cln_agree_place place = {.axis = {0, 1, 2}, .factor = {1, 1, 1}};

    if (i >= SIGNED_AXES)
        place.factor[i % 3] = i < SIGNED_AXES + 3 ? CLN_FOOT : 1 / CLN_FOOT;
    for (int a = 0; a < 3 && i < SIGNED_AXES; a++) {
        place.axis[a] = axes[i % 6][a];
        place.factor[a] = (i / 6) >> a & 1 ? -1 : 1;
    }
    return place;
}

cln_status cln_try_places(const cln_scene *scene, cln_agreement *out)
{
    cln_status st = CLN_OK;
    double(*poses)[12] = NULL;

    if (is_sound(out))
        return CLN_OK;
    CLN_TRY(cln_alloc(&poses, (size_t)scene->view_count, sizeof *poses, "poses"));
    for (int i = 1; i < PLACES; i++) {
        const cln_trial trial = {
            .reading = &cln_readings[0], .focal = 1, .poses = (const double(*)[12])poses};
        cln_agree_place place = place_of(i);

        for (int k = 0; k < scene->view_count; k++) {
            const double *given = scene->views[k].camera.c2w;

            memcpy(poses[k], given, sizeof poses[k]);
            for (int a = 0; a < 3; a++)
                poses[k][4 * a + 3] = place.factor[a] * given[4 * place.axis[a] + 3];
        }
        place.exact = exact_if_clear(scene, out, trial);
        if (place.exact > out->place.exact)
            out->place = place;
    }
done:
    free(poses);
    return st;
}

/* ---- tilts ---- */

/* Do the cameras look at one point, from around it and equally far, as poses that are computed of
 * circles do? */
static bool look_inwards(const cln_scene *scene, double centre[3])
{
    double mean[3] = {0}, nearest = INFINITY, farthest = 0;

    if (!cln_scene_focus(scene, centre))
        return false;
    for (int i = 0; i < scene->view_count; i++) {
        const double *m = scene->views[i].camera.c2w;
        double square = 0;

        for (int a = 0; a < 3; a++) {
            mean[a] += m[4 * a + 2] / scene->view_count;
            square += pow(m[4 * a + 3] - centre[a], 2);
        }
        nearest = fmin(nearest, sqrt(square));
        farthest = fmax(farthest, sqrt(square));
    }
    return cln_dot(mean, mean) < AROUND * AROUND && farthest <= EQUALLY_FAR * nearest;
}

/* Raises each camera by an angle around a line through the centre that is parallel to its rows of
 * pixels. */
static void raise_all(const cln_scene *scene, const double centre[3], double degrees,
                      double (*out)[12])
{
    const double angle = degrees / 57.295779513082321, c = cos(angle), s = sin(angle);

    for (int i = 0; i < scene->view_count; i++) {
        const double *m = scene->views[i].camera.c2w;
        const double axis[3] = {m[0], m[4], m[8]};

        for (int k = 0; k < 4; k++) { /* of the pose's columns the last is a point */
            double v[3], across[3];

            for (int a = 0; a < 3; a++)
                v[a] = m[4 * a + k] - (k == 3 ? centre[a] : 0);
            cln_cross(axis, v, across);
            for (int a = 0; a < 3; a++) /* by Rodrigues' formula */
                out[i][4 * a + k] = c * v[a] - s * across[a] +
                                    (1 - c) * cln_dot(axis, v) * axis[a] + (k == 3 ? centre[a] : 0);
        }
    }
}

cln_status cln_try_tilts(const cln_scene *scene, cln_agreement *out)
{
    cln_status st = CLN_OK;
    const int step = out->tie_count / PART_TRIED + 1;
    double centre[3], middle = 0, (*poses)[12] = NULL;

    if (isnan(out->share) || !look_inwards(scene, centre))
        return CLN_OK;
    CLN_TRY(cln_alloc(&poses, (size_t)scene->view_count, sizeof *poses, "poses"));
    for (int pass = 0; pass < 2; pass++) {
        const double by = pass ? TILT_FINE : TILT_COARSE, most = pass ? TILT_COARSE : TILT_MOST;

        middle = out->tilt;
        for (int i = -(int)(most / by); i <= (int)(most / by); i++) {
            const double degrees = middle + i * by;
            const cln_trial trial = {.reading = &cln_readings[0],
                                     .focal = 1,
                                     .poses = (const double(*)[12])poses,
                                     .strict = STRICT};
            double share = 0;

            raise_all(scene, centre, degrees, poses);
            share = share_of(scene, out, &trial, step);
            if (share > out->tilt_exact) {
                out->tilt_exact = share;
                out->tilt = degrees;
            }
        }
    }
done:
    free(poses);
    return st;
}
