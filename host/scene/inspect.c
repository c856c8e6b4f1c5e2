/* The findings of inspect.h: measures against bounds, and sentences. A bound lies between the
 * values of sound captures and of those with the fault (tests/cli/check.sh plants faults). If
 * photos and poses can be compared (agree.h), that decides: a finding by the poses alone is taken
 * back if the photos agree with them. */
#include "scene/inspect.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/json.h"
#include "ranks/ranks.h"
#include "scene/agree.h"
#include "scene/build.h"
#include "scene/copies.h"
#include "scene/inspection.h"
#include "scene/standing.h"

static const double FAR_OFF = 8;       /* distance from the middle, in median distances */
static const double KEPT_LEAST = 0.25; /* kept share of agreeing features over that of pixels */
static const double BLURRED = 0.7;     /* sharpness over the median of all photos */
/* Factors of 2; of an object that is cut out, on which light from one side does much. */
static const double EXPOSURE_RANGE = 0.6, EXPOSURE_RANGE_CUT = 0.8;
static const double EXPOSURE_TREND = 2;  /* a jump over those around it */
static const double FITTING_SHARE = 0.8; /* of ties that agree: poses are right beyond doubt */
static const double INSIDE_LEAST = 0.5, SPAN_LEAST = 0.12; /* points in the cube: share, span */
/* A room may be so large beside a cube about what cameras look at: share of points in it, span. */
static const double ROOM_INSIDE = 0.25, ROOM_SPAN = 5;
/* Degrees of a field of view: photos have more; as long lenses that marks can confirm have. */
static const double FOV_LEAST = 5, FOV_SURE = 0.3;
static const double FOLD_DOUBT = 0.05, ALONE_DOUBT = 0.25;
static const double ALONE_TIES = 20; /* of a pair, as FAR_TIES of inspect_poses.c: it overlaps */
enum { FEW_PHOTOS = 12, FEW_POINTS = 50, POINTS = 800 };
enum { EXPOSURE_PARTNERS = 2 };

/* ---- cameras ---- */

static cln_status check_far(cln_inspection *in)
{
    cln_status st = CLN_OK;
    const int count = in->scene->view_count;
    double *values = NULL, middle[3], typical = 0, farthest = 0;
    char names[512];
    json_t *far = json_array();

    CLN_TRY(cln_alloc(&values, 2 * (size_t)count, sizeof *values, "cameras"));
    for (int a = 0; a < 3; a++) {
        for (int i = 0; i < count; i++)
            values[i] = in->scene->views[i].camera.c2w[4 * a + 3];
        middle[a] = cln_inspect_median(values, count);
    }
    for (int i = 0; i < count; i++) {
        const double *m = in->scene->views[i].camera.c2w;

        values[i] =
            sqrt(pow(m[3] - middle[0], 2) + pow(m[7] - middle[1], 2) + pow(m[11] - middle[2], 2));
    }
    memcpy(values + count, values, (size_t)count * sizeof *values);
    typical = cln_inspect_median(values + count, count);
    for (int i = 0; i < count; i++)
        if (count > 3 && values[i] > FAR_OFF * typical && typical > 0) {
            cln_inspect_add(far, in, i);
            farthest = fmax(farthest, values[i] / typical);
        }
    if (json_array_size(far))
        cln_found_fault(in->findings, "far camera", true, json_incref(far),
                        "cameras far off: %s, up to %.3g times as far from the middle as "
                        "most; a wrong pose also makes the cube too large: leave such frames out",
                        cln_findings_names(far, names, sizeof names), farthest);
done:
    json_decref(far);
    free(values);
    return st;
}

static void check_overlap(cln_inspection *in)
{
    const cln_agreement *a = &in->agreement;
    const int train = cln_scene_split_count(in->scene, CLN_SPLIT_TRAIN);
    json_t *alone = json_array();
    double lone = 0, ties = 0;
    char names[512];
    double partners = 0;
    bool over = false; /* then neighbours of sound photos have few ties that agree */

    for (int i = 0; i < in->scene->view_count; i++) {
        over |= a->views[i].over;
        partners += a->looked_at ? (double)a->views[i].partners / a->looked_at : 0;
        if (a->views[i].looked_at && a->views[i].partners == 0 && !a->views[i].bad &&
            !a->views[i].over) {
            cln_inspect_add(alone, in, i);
            ties += a->views[i].ties;
        }
    }
    cln_inspect_measure(in, "mean_partners", a->looked_at ? partners : NAN);
    lone = (double)json_array_size(alone);
    cln_inspect_measure(in, "views_alone", lone);
    if (over)
        json_array_clear(alone);
    else if (in->posed && in->thin && lone > ALONE_DOUBT * a->looked_at) {
        cln_found_fault(
            in->findings, "overlap", false, json_incref(alone),
            "a photo has %.0f mark%s (of most captures 100 or more), as dark photos, "
            "haze, low contrast or surfaces of one colour show few: too few to tell "
            "what neighbours share. A short training tells whether there are enough photos",
            in->marks, cln_plural(in->marks, "", "s"));
    } else if (in->posed && !isnan(a->share) && lone > ALONE_DOUBT * a->looked_at &&
               ties * a->looked_at >= ALONE_TIES * lone * 2 * a->pairs) {
        cln_findings_take_back(in->findings, "overlap"); /* it does overlap */
        cln_found_fault(in->findings, "poses", false, json_incref(alone),
                        "%zu of %d photos share many marks with their neighbours (about %.0f with "
                        "each), but hardly any lies where both poses put it, while many of the "
                        "others' do: %s. More photos do not help. Likely the poses are wrong in "
                        "what matters to these most, as the unit of one axis, or are of another "
                        "model than the others'; or the photos were cropped or turned after their "
                        "poses were found; or what they show repeats, as tiles do",
                        json_array_size(alone), a->looked_at,
                        ties / lone * a->looked_at / (2 * a->pairs),
                        cln_findings_names(alone, names, sizeof names));
    } else if (in->posed && !isnan(a->share) && json_array_size(alone)) {
        cln_found_fault(
            in->findings, "overlap", false, json_incref(alone),
            "%zu of %d photos %s hardly anything with %s neighbours: %s; what %s alone "
            "%s is learnt badly. %s",
            json_array_size(alone), a->looked_at, cln_plural(lone, "shares", "share"),
            cln_plural(lone, "its", "their"), cln_findings_names(alone, names, sizeof names),
            cln_plural(lone, "it", "they"), cln_plural(lone, "shows", "show"),
            lone > ALONE_DOUBT * a->looked_at
                ? "Take more photos, at most 20 degrees apart; or, if these were cropped or "
                  "mirrored after their poses were found, find poses anew"
            : lone == 1
                ? "Look at it: of something else, cropped, mirrored, or with a wrong pose, it is "
                  "better left out. Else keep it, as one along the narrow side of a thing shows "
                  "little; photos "
                  "between it and the others would help"
                : "Look at them: of something else, cropped, mirrored, or with wrong poses, they "
                  "are better left out. Else keep them, as some along the narrow side of a thing "
                  "show little; "
                  "photos between them and the others would help");
    }
    if (train >= CLN_LEAST_PHOTOS && train < FEW_PHOTOS && !cln_scene_few_around(in->scene))
        cln_found_fault(in->findings, "overlap", false, NULL,
                        "only %d training photos: surfaces that fewer than three of them show are "
                        "learnt badly",
                        train);
    json_decref(alone);
}

/* ---- the cube ---- */

/* As --bbox takes it. */
static void write_box(const double low[3], const double high[3], char out[CLN_BOX_BYTES])
{
    const double box[6] = {low[0], low[1], low[2], high[0], high[1], high[2]};
    double least = INFINITY;

    for (int a = 0; a < 3; a++)
        if (high[a] > low[a])
            least = fmin(least, high[a] - low[a]);
    cln_box_write(box, least, out);
}

static void count_cameras(cln_inspection *in)
{
    const cln_space core = cln_space_core(&in->scene->space);
    double cameras = 0;

    for (int i = 0; i < in->scene->view_count; i++) {
        const double *m = in->scene->views[i].camera.c2w;

        cameras += cln_space_holds(&core, (const double[3]){m[3], m[7], m[11]});
    }
    cln_inspect_measure(in, "cameras_inside", cameras);
    cln_inspect_measure(in, "cameras_outside", in->scene->view_count - cameras);
}

/* Share of the points that photos agree on which the cube holds. */
static double share_inside(const cln_inspection *in)
{
    const cln_agreement *a = &in->agreement;
    const cln_space core = cln_space_core(&in->scene->space);
    double inside = 0;

    for (int i = 0; i < a->point_count; i++)
        inside += cln_space_holds(&core, a->points[i]) / (double)a->point_count;
    return inside;
}

/* A forward space is endless: only its near plane can be wrong. */
static void judge_near_plane(cln_inspection *in, double inside)
{
    if (inside < INSIDE_LEAST)
        cln_found_fault(in->findings, "cube", true, NULL,
                        "only %.0f%% of what the photos show is beyond the near plane (%s): "
                        "are the dataset's near depths right? --space cube needs none",
                        100 * inside, in->scene->bounds_rule);
}

/* Where the middle nine tenths of the points lie along each axis. */
static cln_status find_middle(const cln_agreement *a, double low[3], double high[3])
{
    cln_status st = CLN_OK;
    const int count = a->point_count;
    double *values = NULL;

    CLN_TRY(cln_alloc(&values, (size_t)count + 1, sizeof *values, "points"));
    for (int axis = 0; axis < 3; axis++) {
        for (int i = 0; i < count; i++)
            values[i] = a->points[i][axis];
        cln_reals_sort(values, count);
        low[axis] = values[count / 20];
        high[axis] = values[count - 1 - count / 20];
    }
done:
    free(values);
    return st;
}

/* Widens a box by a share of its sides, to either side. */
static void add_margin(double low[3], double high[3], double share)
{
    for (int axis = 0; axis < 3; axis++) {
        const double margin = share * (high[axis] - low[axis]);

        low[axis] -= margin;
        high[axis] += margin;
    }
}

/* What the training photos show alike, of several ranks each one's own among themselves; `out` then
 * has all their points, and the share of them all. */
static cln_status agree_training(const cln_scene *scene, const cln_callbacks *callbacks,
                                 cln_agreement *out)
{
    cln_status st = CLN_OK;
    const int ranks = cln_ranks_count(), me = cln_ranks_me();
    cln_scene own = *scene;
    cln_agreement found = {0};
    int first[CLN_RANKS_MOST + 1] = {0};
    double(*shares)[3] = NULL; /* by rank: points, ties, ties that fit */
    double sums[3] = {0};

    if (ranks == 1)
        return cln_agree(scene, callbacks, out);
    own.view_count = 0;
    CLN_TRY(cln_alloc(&own.views, (size_t)scene->view_count, sizeof *own.views, "views"));
    CLN_TRY(cln_alloc(&shares, (size_t)ranks, sizeof *shares, "views"));
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].split == CLN_SPLIT_TRAIN && cln_view_is_loaded(&scene->views[i]))
            own.views[own.view_count++] = scene->views[i];
    CLN_TRY(cln_agree(&own, callbacks, &found));
    shares[me][0] = found.point_count;
    shares[me][1] = found.tie_count;
    shares[me][2] = isfinite(found.share) ? found.share * found.tie_count : 0;
    for (int r = 0; r <= ranks; r++)
        first[r] = r;
    cln_ranks_gather(shares, sizeof *shares, first, true);
    for (int r = 0; r < ranks; r++) {
        first[r] = (int)sums[0];
        for (int k = 0; k < 3; k++)
            sums[k] += shares[r][k];
    }
    first[ranks] = out->point_count = (int)sums[0];
    out->share = sums[2] / sums[1];
    CLN_TRY(cln_alloc(&out->points, (size_t)out->point_count + 1, sizeof *out->points, "points"));
    if (found.point_count > 0)
        memcpy(out->points + first[me], found.points,
               (size_t)found.point_count * sizeof *out->points);
    cln_ranks_gather(out->points, sizeof *out->points, first, true);
done:
    cln_agreement_free(&found);
    free(own.views);
    free(shares);
    return st;
}

cln_status cln_scene_place_cube(cln_scene *scene, const cln_config *config,
                                const cln_callbacks *callbacks, cln_placed *out)
{
    cln_status st = CLN_OK;
    cln_agreement found = {0};
    double low[3], high[3];

    *out = (cln_placed){.space = config->space};
    CLN_TRY(cln_scene_narrow_cube(scene, out->box));
    if (out->box[0] || !scene->cube_guessed || !scene->in_parallel)
        goto done;
    for (int i = 0; i < scene->view_count && cln_ranks_count() == 1; i++)
        if (scene->views[i].split == CLN_SPLIT_TRAIN && !cln_view_is_loaded(&scene->views[i]))
            goto done;
    CLN_TRY(agree_training(scene, callbacks, &found));
    if (found.point_count < FEW_POINTS || !(found.share > FITTING_SHARE))
        goto done;
    CLN_TRY(find_middle(&found, low, high));
    add_margin(low, high, 0.1);
    write_box(low, high, out->box);
    CLN_TRY(cln_scene_take_box(scene, out->box));
    if (config->space == CLN_SPACE_AUTO && !scene->has_alpha &&
        config->stage1 == CLN_STAGE1_GATHER) {
        scene->space.shell = true;
        out->space = CLN_SPACE_SHELL;
    }
    cln_info("%s: a box around %d places that photos show alike, as cameras that look in parallel "
             "do not tell how far things are: %s--bbox=%s",
             scene->folder, found.point_count,
             out->space == CLN_SPACE_SHELL ? "--space shell " : "", out->box);
done:
    cln_agreement_free(&found);
    return st;
}

/* Do hardly any cameras stand in the box, as those in a room do? */
static bool is_around(const cln_scene *scene, const double low[3], const double high[3])
{
    int within = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const double *m = scene->views[i].camera.c2w;
        bool here = true;

        for (int a = 0; a < 3; a++)
            here = here && m[4 * a + 3] > low[a] && m[4 * a + 3] < high[a];
        within += here;
    }
    return within < 0.1 * scene->view_count;
}

/* Compares a cube, plain or a shell's core, with find_middle()'s box, and advises a better one: of
 * photos with alpha that of their silhouettes, as points are rare on thin parts. */
static void judge_cube(cln_inspection *in, double inside, double low[3], double high[3])
{
    const cln_space *space = &in->scene->space;
    double span = 0, shown[6];
    char box[CLN_BOX_BYTES], advice[CLN_BOX_BYTES + 80] = "";
    bool tighter = true; /* the box is smaller than the cube, on all axes */
    /* of a thing that cameras stand around, smooth parts have no marks: a head, legs, a rim */
    const double more = is_around(in->scene, low, high) ? 1.0 / 3 : 0; /* half, with a tenth */

    for (int axis = 0; axis < 3; axis++)
        span = fmax(span, (high[axis] - low[axis]) / (2 * space->half));
    add_margin(low, high, 0.1);
    cln_inspect_measure(in, "points_span", span);
    json_object_set_new(
        in->measures, "points_box",
        json_pack("[f,f,f,f,f,f]", low[0], low[1], low[2], high[0], high[1], high[2]));
    add_margin(low, high, more);
    if (inside >= INSIDE_LEAST && cln_scene_shown_box(in->scene, shown)) {
        memcpy(low, shown, 3 * sizeof *low);
        memcpy(high, shown + 3, 3 * sizeof *high);
        span = 0;
        for (int axis = 0; axis < 3; axis++)
            span = fmax(span, (high[axis] - low[axis]) / (2 * space->half));
    }
    for (int axis = 0; axis < 3; axis++)
        tighter = tighter && high[axis] - low[axis] < 2 * space->half;
    write_box(low, high, box);
    if (tighter)
        snprintf(advice, sizeof advice, ". A tighter box: %s--bbox=%s",
                 space->shell ? "--space shell " : "", box);
    else if (!space->shell || in->scene->outwards || in->scene->in_parallel)
        snprintf(advice, sizeof advice, ". A box around all of that: %s--bbox=%s",
                 space->shell ? "--space shell " : "", box);
    else if (inside < ROOM_INSIDE && span < ROOM_SPAN)
        snprintf(advice, sizeof advice,
                 ". If that is a room, the box around it may be better: --space shell --bbox=%s",
                 box);
    if (inside < INSIDE_LEAST && !space->shell)
        cln_found_fault(in->findings, "cube", true, NULL,
                        "the cube (half side %g; %s) holds only %.0f%% of what the photos show. "
                        "A box around all of that: --bbox=%s",
                        space->half, in->scene->bounds_rule, 100 * inside, box);
    else if (span < SPAN_LEAST || in->scene->cube_guessed)
        cln_found_fault(in->findings, "cube", span < SPAN_LEAST, NULL,
                        "%s (half side %g; %s): it holds %.0f%% of what the photos show, which "
                        "spans %.0f%% of its side%s",
                        span < SPAN_LEAST ? "the cube is much too large" : "the cube is a guess",
                        space->half, in->scene->bounds_rule, 100 * inside, 100 * span, advice);
}

static cln_status check_cube(cln_inspection *in)
{
    cln_status st = CLN_OK;
    const cln_scene *scene = in->scene;
    double low[3], high[3], inside = 0;

    count_cameras(in);
    cln_inspect_measure(in, "cube_share", scene->cube_share);
    json_object_set_new(in->measures, "cube_guessed", json_boolean(scene->cube_guessed));
    if (in->agreement.point_count < FEW_POINTS || !in->posed) {
        if (scene->cube_guessed)
            cln_found_fault(in->findings, "cube", false, NULL,
                            "the cube is a guess (%s): half side %g, and %.0f%% of the rays meet "
                            "it",
                            scene->bounds_rule, scene->space.half, 100 * scene->cube_share);
        return CLN_OK;
    }
    inside = share_inside(in);
    cln_inspect_measure(in, "points", in->agreement.point_count);
    cln_inspect_measure(in, "points_inside", inside);
    if (scene->space.forward) {
        judge_near_plane(in, inside);
        return CLN_OK;
    }
    CLN_TRY(find_middle(&in->agreement, low, high));
    judge_cube(in, inside, low, high);
done:
    return st;
}

/* ---- cameras ---- */

/* Degrees from the axis to an end of the longer side, or to the outermost place before it that has
 * a ray; below 0 if the axis is not in the image, and the end on this side of it. */
static double reach(const cln_camera *c, bool end)
{
    enum { STEPS = 256 };
    const bool wide = c->width >= c->height;
    const double middle = wide ? c->cx : c->cy, last = end ? (wide ? c->width : c->height) : 0;
    const double sign = (last > middle) == end ? 1 : -1;

    for (int i = STEPS; i > 0; i--) {
        const double at = middle + (last - middle) * i / STEPS;
        double o[3], d[3], along = 0;

        if (!cln_camera_ray(c, wide ? at : c->cx, wide ? c->cy : at, o, d))
            continue;
        for (int a = 0; a < 3; a++)
            along += d[a] * c->c2w[4 * a + 2];
        return sign * acos(fmin(fmax(along, -1), 1)) * 57.29577951308232;
    }
    return 0;
}

static void check_intrinsics(cln_inspection *in)
{
    const cln_fold fold = cln_scene_fold(in->scene);
    const bool fits = in->posed && in->agreement.share > FITTING_SHARE;
    double narrowest = INFINITY, widest = 0, ratio = 1;
    bool planes = true, odd = false;
    char range[64];

    for (int i = 0; i < in->scene->view_count; i++) {
        const cln_camera *c = &in->scene->views[i].camera;
        const double fov = reach(c, false) + reach(c, true);
        const bool flat = c->lens <= CLN_LENS_FULL_OPENCV; /* not for more than half a sphere */

        odd = odd || (fov < FOV_LEAST && !in->posed) || (flat && fov > 130);
        planes = planes && c->lens != CLN_LENS_EQUIRECTANGULAR;
        narrowest = fmin(narrowest, fov);
        widest = fmax(widest, fov);
        ratio = fmax(ratio, fmax(c->fx / c->fy, c->fy / c->fx));
    }
    if (planes) {
        cln_inspect_measure(in, "fov_least", narrowest);
        cln_inspect_measure(in, "fov_most", widest);
    }
    cln_inspect_measure(in, "beyond_fold", fold.share);
    cln_format(range, sizeof range, "%.3g", narrowest);
    if (widest > 1.005 * narrowest)
        cln_format(range, sizeof range, "%.3g to %.3g", narrowest, widest);
    if (planes && odd)
        cln_found_fault(in->findings, "focal length", true, NULL,
                        "the field of view is %s degrees along the longer side: unusual for "
                        "photos. Likely a focal length of another image size, or in millimetres",
                        range);
    else if (planes && narrowest < (fits ? FOV_SURE : FOV_LEAST))
        cln_found_fault(in->findings, "focal length", false, NULL,
                        "the field of view is %s degrees along the longer side: a long lens or a "
                        "microscope; else the focal length is of another image size",
                        range);
    if (planes && ratio > 1.1)
        cln_found_fault(in->findings, "intrinsics", true, NULL,
                        "fx and fy differ by a factor of up to %.3g, as if pixels were not square. "
                        "Likely width and height are exchanged in one of them",
                        ratio);
    if (fold.views)
        cln_found_fault(in->findings, "lens", fold.share > FOLD_DOUBT, NULL,
                        "the lens model folds within %d photo%s: %.2g%% of %s pixels have no ray "
                        "and are left out%s",
                        fold.views, cln_plural(fold.views, "", "s"), 100 * fold.share,
                        cln_plural(fold.views, "its", "their"),
                        fold.share > FOLD_DOUBT ? ". Likely distortion parameters that were fitted "
                                                  "to the middle of the photos alone"
                                                : "");
}

/* ---- photos ---- */

/* The share of a grid of pixels that masks and alpha keep. */
static double kept_pixels(const cln_view *view)
{
    enum { STEPS = 64 };
    int kept = 0;

    for (int i = 0; i < STEPS * STEPS; i++) {
        const int x = i % STEPS * view->camera.width / STEPS;
        const int y = i / STEPS * view->camera.height / STEPS;
        const float black[3] = {0};
        float rgb[3], alpha = 1;

        cln_view_pixel(view, x, y, black, rgb, &alpha);
        kept += cln_view_keeps(view, x, y) && alpha > 0.5f;
    }
    return (double)kept / (STEPS * STEPS);
}

/* What several photos show alike is to be learnt: masks that keep a much smaller share of it than
 * of the pixels keep the wrong side. */
static void check_masks(cln_inspection *in)
{
    const double agreeing = in->agreement.kept_share;
    double area = 0, left = 0;
    int masks = 0, cut = 0;
    bool black = false;

    for (int i = 0; i < in->scene->view_count; i++)
        if (cln_view_cut(&in->scene->views[i])) {
            black = black || in->scene->views[i].mask_black;
            area += kept_pixels(&in->scene->views[i]);
            cut++;
        }
    area = cut ? area / cut : 1;
    left = cln_scene_masks_leave(in->scene, &masks);
    if (!masks && !in->scene->has_alpha)
        return;
    cln_inspect_measure(in, "kept", area);
    cln_inspect_measure(in, "agreeing_kept", agreeing);
    if (in->posed && agreeing < KEPT_LEAST * area)
        cln_found_fault(in->findings, "masks", true, NULL,
                        "the %s keep %.0f%% of the pixels, but only %.0f%% of what several photos "
                        "show alike. Likely the wrong colour counts: %s",
                        masks || in->scene->masks_alpha ? "masks" : "alpha channels", 100 * area,
                        100 * agreeing,
                        black   ? "invert them, or leave --masks ignore-white out"
                        : masks ? "--masks ignore-white reads them so, or, if they are of an "
                                  "object, --masks inverted"
                                : "invert them");
    else if (masks && (left < CLN_MASKS_LEAST || left >= 1))
        cln_found_fault(in->findings, "masks", false, NULL,
                        "the mask%s of %d photo%s leave%s %.3g%% of %s pixels; if the wrong colour "
                        "counts, invert %s",
                        cln_plural(masks, "", "s"), masks, cln_plural(masks, "", "s"),
                        cln_plural(masks, "s", ""), 100 * left, cln_plural(masks, "its", "their"),
                        cln_plural(masks, "it", "them"));
    else if (masks && in->scene->masks_doubtful && left < CLN_MASKS_LEAVE)
        cln_found_fault(in->findings, "masks", false, NULL,
                        "the mask%s of %d photo%s leave%s %.3g%% of %s pixels: " CLN_MASKS_ADVICE,
                        cln_plural(masks, "", "s"), masks, cln_plural(masks, "", "s"),
                        cln_plural(masks, "s", ""), 100 * left, cln_plural(masks, "its", "their"));
}

/* Finds photos that are brighter or darker than their neighbours, much more than these than theirs:
 * where light changes with the place, all differ. If there are none, slow changes over the set; not
 * where the light goes along with the camera, as a chain of photos adds up what little is left. */
static void check_exposure(cln_inspection *in)
{
    const double falloff = in->posed ? in->agreement.falloff : 0;
    double low = INFINITY, high = -INFINITY, most = 0;
    json_t *views = json_array();
    char names[512];

    for (int i = 0; i < in->scene->view_count; i++) {
        const cln_agree_view *v = &in->agreement.views[i];

        if (isnan(v->exposure) || !in->posed || v->partners < EXPOSURE_PARTNERS)
            continue; /* few marks with one other photo say little */
        low = fmin(low, v->exposure);
        high = fmax(high, v->exposure);
        if (fabs(v->jump) > fmax(cln_exposure_jump, EXPOSURE_TREND * v->around)) {
            cln_inspect_add(views, in, i);
            most = fmax(most, fabs(v->jump));
        }
    }
    cln_inspect_measure(in, "light_falloff", falloff);
    cln_inspect_measure(in, "exposure_range", high > -INFINITY ? high - low : NAN);
    if (json_array_size(views))
        cln_found_fault(in->findings, "exposure", falloff <= 0, json_incref(views),
                        "brighter or darker than photos of the same things, by up to %.1f stops: "
                        "%s; %s%s",
                        most, cln_findings_names(views, names, sizeof names),
                        falloff > 0 ? "what the distance of the lamp does is taken off, as well as "
                                      "it is known: look at them before you leave them out"
                                    : "take photos with fixed exposure, or leave these out",
                        in->scene->has_alpha || falloff > 0
                            ? ""
                            : "; train gives photos gains by itself where it finds that they "
                              "differ (--exposure: in any case)");
    if (falloff > 0)
        cln_found_fault(in->findings, "exposure", false, NULL,
                        "what is twice as far from the camera has 1/%.2g of the light, as under a "
                        "lamp or flash that goes along. That is no change of exposure: train gives "
                        "such photos no gains by itself; --exposure would likely cost quality",
                        pow(2, falloff));
    else if (!json_array_size(views) &&
             high - low > (in->scene->has_alpha ? EXPOSURE_RANGE_CUT : EXPOSURE_RANGE))
        cln_found_fault(in->findings, "exposure", false, NULL,
                        "exposure changes over the set, by %.1f stops in all: the model will "
                        "average it; fixed exposure and white balance are better%s%s",
                        high - low,
                        in->scene->has_alpha ? ""
                                             : "; train gives photos gains by itself where it "
                                               "finds that they differ (--exposure: in any case)",
                        in->scene->outwards ? ""
                                            : ". If the thing turned before a lamp that stands "
                                              "still, that is why, and all is well");
    json_decref(views);
}

static cln_status check_blur(cln_inspection *in)
{
    cln_status st = CLN_OK;
    double *values = NULL, typical = 0;
    int count = 0;
    json_t *views = json_array();
    char names[512];

    CLN_TRY(cln_alloc(&values, (size_t)in->scene->view_count, sizeof *values, "photos"));
    for (int i = 0; i < in->scene->view_count; i++)
        if (!isnan(in->photos[i].sharpness))
            values[count++] = in->photos[i].sharpness;
    typical = cln_inspect_median(values, count);
    cln_inspect_measure(in, "sharpness", typical);
    for (int i = 0; i < in->scene->view_count; i++)
        if (in->photos[i].sharpness < BLURRED * typical)
            cln_inspect_add(views, in, i);
    if (json_array_size(views))
        cln_found_fault(in->findings, "blur", false, json_incref(views),
                        "less sharp than most: %s; blurred photos make what they show soft: take "
                        "sharper ones from there, or leave them out if many sharp ones from nearly "
                        "the same places remain, as a gap costs more than blur",
                        cln_findings_names(views, names, sizeof names));
done:
    json_decref(views);
    free(values);
    return st;
}

/* Of at least so many photos with one pose it is said at once, not of each pair. */
enum { GROUP = 4 };
/* Ties of a photo that tell, by the share of them that agree, that its pose is right. */
enum { FITTING = 24 };
static const double MOVED = 0.1; /* pixels between a mark's places in two photos */

/* Tells of photos with one pose: first[i] is the first photo with photo i's. Takes those told out
 * of the list of pairs. */
static void tell_groups(cln_inspection *in, const int *first, json_t *pairs)
{
    for (int k = 0; k < in->scene->view_count; k++) {
        json_t *group = json_array();
        char names[512];

        for (int i = k; i < in->scene->view_count; i++)
            if (first[i] == k)
                cln_inspect_add(group, in, i);
        if (json_array_size(group) < GROUP) {
            json_decref(group);
            continue;
        }
        for (size_t i = json_array_size(pairs); i > 0; i -= 2) {
            const char *name = json_string_value(json_array_get(pairs, i - 2));
            size_t j = 0;
            json_t *one = NULL;

            json_array_foreach(group, j, one)
            {
                if (strcmp(json_string_value(one), name) == 0) {
                    json_array_remove(pairs, i - 1);
                    json_array_remove(pairs, i - 2);
                    break;
                }
            }
        }
        cln_found_fault(in->findings, "duplicates", true, json_incref(group),
                        "%zu different photos have the same pose: %s. Of all but one it is wrong, "
                        "as of a tracker that was lost: leave them out",
                        json_array_size(group), cln_findings_names(group, names, sizeof names));
        json_decref(group);
    }
}

/* Is a photo known to fit its pose? */
static bool fits(const cln_inspection *in, int view)
{
    const cln_agree_view *v = &in->agreement.views[view];

    return v->ties >= FITTING && v->agreeing >= FITTING_SHARE * v->ties;
}

/* Do marks that two photos share stand elsewhere in one than in the other? So it is, too, if they
 * were not compared. */
static bool shows_moves(const cln_inspection *in, int a, int b)
{
    const cln_agreement *all = &in->agreement;
    int ties = 0, moved = 0;

    for (int i = 0; i < all->tie_count; i++) {
        const cln_tie *t = &all->ties[i];

        if ((t->a != a || t->b != b) && (t->a != b || t->b != a))
            continue;
        ties++;
        moved += hypot((double)(t->ub - t->ua), (double)(t->vb - t->va)) > MOVED;
    }
    return 2 * moved >= ties;
}

static cln_status check_duplicates(cln_inspection *in)
{
    cln_status st = CLN_OK;
    json_t *photos = json_array(), *poses = json_array(), *still = json_array();
    char names[512];
    bool across = false, still_across = false;
    int *first = NULL; /* [view] with the same pose */

    CLN_TRY(cln_alloc(&first, (size_t)in->scene->view_count, sizeof *first, "photos"));
    for (int i = 0; i < in->scene->view_count; i++) {
        CLN_TRY(cln_tell_work(in->callbacks, NULL, 0, 0));
        first[i] = i;
        for (int k = 0; k < i; k++) {
            cln_pair pair = cln_pair_of(in->scene, in->photos, i, k, false);
            json_t *list = NULL;

            if (pair == CLN_PAIR_COPY && fits(in, i) && fits(in, k) && shows_moves(in, i, k))
                pair = cln_pair_of(in->scene, in->photos, i, k, true);
            if (pair == CLN_PAIR_APART)
                continue;
            list = pair == CLN_PAIR_NOISE ? still : pair == CLN_PAIR_COPY ? photos : poses;
            if (list == poses && first[i] == i)
                first[i] = first[k];
            cln_inspect_add(list, in, k);
            cln_inspect_add(list, in, i);
            *(pair == CLN_PAIR_NOISE ? &still_across : &across) |=
                (in->scene->views[i].split == CLN_SPLIT_TRAIN) !=
                (in->scene->views[k].split == CLN_SPLIT_TRAIN);
        }
    }
    if (json_array_size(photos))
        cln_found_fault(in->findings, "duplicates", true, json_incref(photos),
                        "the same photo more than once: %s. Leave the copies out%s",
                        cln_findings_pairs(photos, names, sizeof names),
                        across ? ". One of a pair is held out: its score would be too good" : "");
    if (json_array_size(still))
        cln_found_fault(in->findings, "duplicates", false, json_incref(still),
                        "photos that differ by no more than noise, of one place: %s. The camera "
                        "stood still there, or they are one photo saved anew: more than one tells "
                        "nothing new%s",
                        cln_findings_pairs(still, names, sizeof names),
                        still_across ? ". One of a pair is held out: its score flatters" : "");
    tell_groups(in, first, poses);
    if (json_array_size(poses))
        cln_found_fault(in->findings, "duplicates", true, json_incref(poses),
                        "different photos with the same pose: %s. One of each pair is wrong",
                        cln_findings_pairs(poses, names, sizeof names));
done:
    free(first);
    json_decref(photos);
    json_decref(poses);
    json_decref(still);
    return st;
}

static json_t *list_blank(const cln_inspection *in)
{
    json_t *views = json_array();

    for (int i = 0; i < in->scene->view_count; i++)
        if (cln_photo_is_blank(&in->scene->views[i]))
            cln_inspect_add(views, in, i);
    return views;
}

static void check_files(cln_inspection *in)
{
    const cln_scene *scene = in->scene;
    const int all = scene->view_count + scene->missing;
    json_t *gone = json_array();
    char names[512];

    for (int i = scene->view_count; i < all; i++)
        cln_inspect_add(gone, in, i);
    if (scene->missing)
        cln_found_fault(in->findings, "missing", true, json_incref(gone),
                        "%d of %d photos %s not there%s: %s; %s left out%s", scene->missing, all,
                        cln_plural(scene->missing, "is", "are"),
                        scene->unreadable ? " or cannot be read" : "",
                        cln_findings_names(gone, names, sizeof names),
                        cln_plural(scene->missing, "its frame is", "their frames are"),
                        10 * scene->missing >= all ? ", by train with --missing skip alone" : "");
    json_decref(gone);
    if (scene->unposed >= all)
        cln_found_fault(in->findings, "no pose", true, NULL,
                        "%d of %d photos have no pose: what they alone show is not learnt, and "
                        "where so few hang together their poses are often wrong, too. Unless that "
                        "was the choice, find them again, with more photos, at most 20 degrees "
                        "apart, sharp, of something with texture that does not move",
                        scene->unposed, scene->unposed + all);
    if (scene->nearly_sized)
        cln_found_fault(
            in->findings, "size", false, NULL,
            "%d of %d images %s nearly, but not quite the size that %s for, which %s "
            "scaled: " CLN_NEARLY_ADVICE,
            scene->nearly_sized, scene->view_count, cln_plural(scene->nearly_sized, "has", "have"),
            cln_plural(scene->nearly_sized, "its camera is given", "their cameras are given"),
            cln_plural(scene->nearly_sized, "is", "are"));
    if (!cln_scene_split_count(scene, CLN_SPLIT_TEST))
        cln_found_fault(in->findings, "split", false, NULL,
                        "no photo is held out: how good views between the photos are will not be "
                        "known");
}

/* Does a key that is not read look as if it had to do with cameras? */
static bool is_of_camera(const char *key)
{
    static const char *const words[] = {"camera", "distort", "intrinsic", "focal", "lens",
                                        "matrix", "pose",    "fov",       "shift", "aspect",
                                        "ortho",  "sensor",  "principal"};

    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcasestr(key, words[i]))
            return true;
    return false;
}

static void check_keys(cln_inspection *in)
{
    json_t *keys = json_array();
    char names[512];
    size_t i = 0;
    json_t *key = NULL;

    json_array_foreach(in->scene->ignored, i, key)
    {
        if (is_of_camera(json_string_value(key)))
            json_array_append(keys, key);
    }
    if (json_array_size(keys))
        cln_found_fault(in->findings, "keys", false, NULL,
                        "keys of the scene's files that are not used: %s. Focal lengths are read "
                        "as fl_x and fl_y, the middle as cx and cy, the lens as camera_model with "
                        "k1, k2, p1, p2 ..., poses as transform_matrix (docs/formats.md): shifts "
                        "belong into cx and cy, pixels that are not square into camera_angle_y",
                        cln_findings_names(keys, names, sizeof names));
    json_decref(keys);
}

/* ---- together ---- */

/* Measures that not every scene has are null where nothing tells them. */
static void fill_measures(cln_inspection *in)
{
    static const char *const names[] = {"points",     "points_inside", "points_span",
                                        "points_box", "fov_least",     "fov_most",
                                        "kept",       "agreeing_kept"};

    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!json_object_get(in->measures, names[i]))
            cln_inspect_measure(in, names[i], NAN);
}

static json_t *describe_views(const cln_inspection *in)
{
    const cln_space core = cln_space_core(&in->scene->space);
    json_t *views = json_array();

    for (int i = 0; i < in->scene->view_count; i++) {
        const cln_view *view = &in->scene->views[i];
        const cln_agree_view *a = &in->agreement.views[i];
        const double *m = view->camera.c2w, place[3] = {m[3], m[7], m[11]};

        json_array_append_new(
            views, json_pack("{s:s, s:s, s:[f,f,f], s:[f,f,f], s:b, s:o, s:o, s:o, s:o, s:i, s:i, "
                             "s:i}",
                             "name", view->name, "split", cln_split_names[view->split], "place",
                             m[3], m[7], m[11], "axis", m[2], m[6], m[10], "inside_cube",
                             cln_space_holds(&core, place), "sharpness",
                             cln_json_real(in->photos[i].sharpness), "exposure",
                             cln_json_real(a->exposure), "exposure_jump", cln_json_real(a->jump),
                             "exposure_around", cln_json_real(isnan(a->jump) ? NAN : a->around),
                             "partners", a->partners, "ties", a->ties, "agreeing", a->agreeing));
    }
    return views;
}

/* At most POINTS of the places where rays of two photos meet. */
static json_t *describe_points(const cln_agreement *a)
{
    json_t *points = json_array();
    const int step = a->point_count / POINTS + 1;

    for (int i = 0; i < a->point_count; i += step)
        json_array_append_new(
            points, json_pack("[f,f,f]", a->points[i][0], a->points[i][1], a->points[i][2]));
    return points;
}

/* Likely faults first; else in the order in which they were found. */
static json_t *by_weight(const json_t *findings)
{
    json_t *sorted = json_array();

    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < json_array_size(findings); i++) {
            json_t *one = json_array_get(findings, i);

            if (json_is_true(json_object_get(one, "likely_fault")) == (pass == 0))
                json_array_append(sorted, one);
        }
    return sorted;
}

cln_status cln_scene_inspect(const cln_scene *scene, const cln_callbacks *callbacks, json_t **out)
{
    cln_status st = CLN_OK;
    cln_inspection in = {.scene = scene,
                         .callbacks = callbacks,
                         .findings = json_array(),
                         .measures = json_object()};
    char empty[CLN_EMPTY_BYTES], standing[CLN_STANDING_BYTES];
    bool plain = false;

    *out = NULL;
    CLN_TRY(cln_alloc(&in.photos, (size_t)scene->view_count, sizeof *in.photos, "photos"));
    for (int i = 0; i < scene->view_count; i++) {
        CLN_TRY(cln_tell_work(callbacks, "measured", i, scene->view_count));
        cln_photo_measure(&scene->views[i], &in.photos[i]);
    }
    CLN_TRY(cln_tell_work(callbacks, "measured", scene->view_count, scene->view_count));
    CLN_TRY(cln_agree(scene, callbacks, &in.agreement));
    CLN_TRY(cln_scene_check_pixels(scene));
    cln_scene_tell_doubts(scene, in.findings);
    cln_scene_tell_turns(scene, &in.agreement, in.findings);
    if (cln_scene_is_multiplied(scene, empty))
        cln_found_fault(in.findings, "alpha", false, NULL, "%s", empty);
    cln_scene_tell_missed(scene, in.findings);
    if (cln_scene_is_empty(scene, empty))
        cln_found_fault(in.findings, "alpha", true, NULL, "%s", empty);
    if (cln_scene_is_whole(scene, empty))
        cln_found_fault(in.findings, scene->has_alpha ? "alpha" : "masks", false, NULL, "%s",
                        empty);
    CLN_TRY(cln_scene_find_reversed(scene, empty));
    if (empty[0])
        cln_found_fault(in.findings, scene->masks_alpha ? "masks" : "alpha", true, NULL, "%s",
                        empty);
    if (cln_scene_has_blank(scene, empty))
        cln_found_fault(in.findings, "blank", true, list_blank(&in), "%s", empty);
    in.standing = cln_scene_tell_standing(scene, standing, &plain);
    if (in.standing)
        cln_found_fault(in.findings, "overlay", !plain, NULL, "%s", standing);
    CLN_TRY(cln_inspect_poses(&in));
    cln_inspect_strays(&in);
    CLN_TRY(check_far(&in));
    check_overlap(&in);
    CLN_TRY(check_cube(&in));
    check_intrinsics(&in);
    check_masks(&in);
    check_exposure(&in);
    CLN_TRY(check_blur(&in));
    CLN_TRY(check_duplicates(&in));
    check_files(&in);
    check_keys(&in);
    fill_measures(&in);
    *out = json_pack("{s:o, s:O, s:o, s:o}", "findings", by_weight(in.findings), "measures",
                     in.measures, "views", describe_views(&in), "points",
                     describe_points(&in.agreement));
    if (!*out)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot describe the findings as JSON", scene->folder));
done:
    cln_agreement_free(&in.agreement);
    json_decref(in.findings);
    json_decref(in.measures);
    free(in.photos);
    return st;
}
