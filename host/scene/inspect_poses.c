/* Whether photos fit their poses, and what would fit better: findings of inspect.h by what two
 * photos show alike (agree.h). */
#include "scene/inspect.h"
#include "scene/inspection.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/text.h"
#include "scene/build.h"

static const double SOUND = 0.5;   /* share of agreeing ties above which poses are right */
static const double UNSOUND = 0.3; /* share below which they are wrong */
static const double UNSURE = 0.7;  /* share below which poses are wrong if ties are inexact: */
static const double EXACT = 0.45; /* share of agreeing ties that agree within a quarter; 1/4 if they
                                      do by chance or nearly, as beside the true pose */
/* Of photos far apart most ties are false. The same share, from which on their poses are right all
 * the same, and below which they are wrong; the share of ties that agree by chance. */
static const double FAR_EXACT = 0.55, FAR_UNCLEAR = 0.38, FAR_CHANCE = 0.06;
/* Of theirs: ties of a pair, at most; agreeing ones that tell how exactly they do. */
enum { FAR_TIES = 20, FAR_AGREEING = 12 };
/* Below both, photos show too little: of surfaces of one colour, marks are corners and ends of
 * edges, which are found inexactly, and which others are alike. */
enum { THIN_MARKS = 20, THIN_TIES = 4 }; /* of a photo; of a pair */
/* Standard deviations by which a share of few ties must be beyond a bound; the best of many focal
 * lengths. */
static const double SURE = 2, SURE_BEST = 3;
static const double READING = 0.6;      /* the given reading's share over another's */
static const double FOCAL_GAIN = 1.15;  /* share with other focal lengths over the given ones' */
static const double FOCAL_WIDER = 1.15; /* the same of the shares that agree at all */
/* Factor and degrees by which frames of two parts differ, to be told. */
static const double FRAME_SCALE = 1.04, FRAME_TURN = 6;
static const double FOCAL_LEAST = 1.04, LEAST_STRICT = 0.2, FOCAL_EXACT = 0.55; /* as EXACT */
static const double ONE_WAY = 0.985; /* mean cosine from the mean of directions: 10 degrees */
static const double TILT_LEAST = 2;  /* degrees; of gains, the bounds of focal lengths hold */
/* Of positions: their width in degrees, of which 0.01 are a kilometre; FAR_FROM_0: over it.
 * COARSE_STEP: share of the cameras' spread from which on steps show in photos. */
static const double DEGREES_WIDE = 1e-2, FAR_FROM_0 = 100, COARSE_STEP = 1e-3;

/* Of cameras that look apart, where photos have too little in common to decide: those of a rig do
 * and share little, those around something would show the same from behind. */
static void soften_axes(cln_inspection *in)
{
    const cln_agreement *a = &in->agreement;

    if (in->scene->before_share <= 0.5 ||
        (a->reading > 0 && a->reading_share > SOUND &&
         a->given_share < READING * a->reading_share) ||
        !cln_findings_take_back(in->findings, "axes"))
        return;
    cln_found_fault(in->findings, "axes", false, NULL,
                    "the cameras look apart: for %.0f%% of the pairs of cameras, the point that "
                    "both axes pass lies behind both. Of photos taken outwards from one place, as "
                    "by a rig, that is right; of photos around something, the axes of the poses "
                    "are wrong. The photos show too little in common to tell which",
                    100 * in->scene->apart_share);
}

typedef enum { WRONG, UNCLEAR, RIGHT } verdict;

/* Of poses that few ties agree with. Where photos stand so far apart that one shows little of what
 * another does, most ties are false, and agree by chance alone; but true ones agree exactly, if the
 * poses are right. */
static verdict judge_few(const cln_agreement *a, double exact, bool thin)
{
    const bool apart = a->tie_count < FAR_TIES * a->pairs;

    if (thin && a->share > 2 * FAR_CHANCE)
        return UNCLEAR;
    if (a->reading > 0)
        return WRONG;
    if (a->agreeing < FAR_AGREEING)
        return apart && a->share > FAR_CHANCE ? UNCLEAR : WRONG;
    return exact > FAR_EXACT ? RIGHT : apart && exact > FAR_UNCLEAR ? UNCLEAR : WRONG;
}

static verdict judge(const cln_agreement *a, double exact, bool thin)
{
    if (a->share < UNSOUND)
        return judge_few(a, exact, thin);
    if (!(a->share < UNSURE && exact < EXACT))
        return RIGHT;
    return thin || exact + SURE * sqrt(exact * (1 - exact) / a->agreeing) > EXACT ? UNCLEAR : WRONG;
}

/* Is a share that agrees exactly above that with the given poses by more than chance, where the
 * best of many was taken? */
static bool gains(const cln_agreement *a, double exact)
{
    return exact > FOCAL_GAIN * a->strict_share && exact > LEAST_STRICT &&
           (exact - a->strict_share) * a->tie_count >
               SURE_BEST * sqrt(a->strict_share * a->tie_count);
}

static bool has_tilt(const cln_agreement *a)
{
    return fabs(a->tilt) >= TILT_LEAST && gains(a, a->tilt_exact) &&
           a->tilt_exact > a->focal_share && !(a->order && a->order_exact >= a->tilt_exact);
}

/* Do other focal lengths fit better, by more than chance? */
static bool has_other_focal(const cln_agreement *a)
{
    return gains(a, a->focal_share) && fmax(a->focal, 1 / a->focal) > FOCAL_LEAST &&
           a->focal_exact > FOCAL_EXACT &&
           a->focal_share / a->focal_exact > FOCAL_WIDER * a->given_share;
}

/* The median over the photos that were compared; NaN: none. */
static cln_status count_marks(const cln_inspection *in, double *marks)
{
    cln_status st = CLN_OK;
    double *values = NULL;
    int count = 0;

    CLN_TRY(cln_alloc(&values, (size_t)in->scene->view_count, sizeof *values, "marks"));
    for (int i = 0; i < in->scene->view_count; i++)
        if (in->agreement.views[i].looked_at)
            values[count++] = in->agreement.views[i].features;
    *marks = cln_inspect_median(values, count);
done:
    free(values);
    return st;
}

static void tell_unclear(cln_inspection *in, double exact, double marks, bool thin)
{
    const cln_agreement *a = &in->agreement;
    char few[160] = "";

    if (thin)
        snprintf(few, sizeof few,
                 "a photo has %.0f mark%s (of most captures 100 or more), as dark photos and "
                 "surfaces of one colour show few, and a pair of neighbours shares %.2g; ",
                 marks, cln_plural(marks, "", "s"), (double)a->tie_count / a->pairs);
    cln_found_fault(in->findings, "poses", false, NULL,
                    "too little to tell whether the photos fit their poses: %sof %d marks that two "
                    "photos share, %.0f%% lie where both poses put them, and %.0f%% of these "
                    "exactly, which right and wrong poses may both do. A short training tells "
                    "more",
                    few, a->tie_count, 100 * a->share, 100 * exact);
}

/* ---- positions ---- */

/* Does another order, sign or unit of the positions' axes fit better than all else? */
static bool has_place(const cln_agreement *a)
{
    return a->place.exact > a->focal_share && a->place.exact > a->tilt_exact &&
           !(a->order && a->order_exact >= a->place.exact);
}

static void tell_place(cln_inspection *in)
{
    const cln_agree_place *place = &in->agreement.place;
    char what[200] = "";
    int n = 0;

    for (int i = 0; i < 3; i++)
        if (fabs(place->factor[i]) != 1)
            snprintf(what, sizeof what,
                     "their %c is multiplied by %.6g. Likely it is in %s, and the other two are in "
                     "%s: bring all three to one unit",
                     'x' + i, place->factor[i], place->factor[i] < 1 ? "feet" : "metres",
                     place->factor[i] < 1 ? "metres" : "feet");
    if (!what[0]) {
        for (int i = 0; i < 3; i++)
            n += snprintf(what + n, sizeof what - (size_t)n, "%s%s%c", i ? ", " : "they are (",
                          place->factor[i] < 0 ? "-" : "", 'x' + place->axis[i]);
        snprintf(what + n, sizeof what - (size_t)n,
                 ") instead of (x, y, z), and rotations stay. Likely axes of one of the two were "
                 "exchanged or negated: give both in one frame");
    }
    cln_found_fault(in->findings, "poses", true, NULL,
                    "the photos do not fit the cameras' positions (%.0f%% of what two photos show "
                    "lies exactly where both poses put it), but do (%.0f%%) if %s",
                    100 * in->agreement.strict_share, 100 * place->exact, what);
}

/* Finds the middle of the positions along each axis, and how far they spread around it. */
static void find_extent(const cln_scene *scene, double middle[3], double spread[3])
{
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;

        for (int i = 0; i < scene->view_count; i++) {
            low = fmin(low, scene->views[i].camera.c2w[4 * a + 3]);
            high = fmax(high, scene->views[i].camera.c2w[4 * a + 3]);
        }
        middle[a] = .5 * (low + high);
        spread[a] = high - low;
    }
}

/* The axis along which positions are metres if along the others they are degrees: within the
 * globe's, far from 0 and a kilometre wide at most; or -1. */
static int metres_beside_degrees(const double middle[3], const double spread[3])
{
    for (int up = 0; up < 3; up++) {
        const int a = (up + 1) % 3, b = (up + 2) % 3;
        const double wide = fmax(spread[a], spread[b]);
        const double most = fmax(fabs(middle[a]), fabs(middle[b]));
        const double least = fmin(fabs(middle[a]), fabs(middle[b]));

        if (most <= 180 && least <= 90 && wide > 0 && wide <= DEGREES_WIDE &&
            least > FAR_FROM_0 * wide && spread[up] > FAR_FROM_0 * wide)
            return up;
    }
    return -1;
}

/* The axis along which positions have coarse steps, as 32 bits tell no others; or -1. */
static int rounded_axis(const cln_scene *scene, const double middle[3], const double spread[3],
                        double *step)
{
    int coarse = 0;

    for (int i = 0; i < 3 * scene->view_count; i++) {
        const double at = scene->views[i / 3].camera.c2w[4 * (i % 3) + 3];

        if ((double)(float)at != at)
            return -1;
    }
    for (int a = 1; a < 3; a++)
        if (fabs(middle[a]) > fabs(middle[coarse]))
            coarse = a;
    *step = nextafterf((float)fabs(middle[coarse]), INFINITY) - (float)fabs(middle[coarse]);
    return *step > COARSE_STEP * fmax(fmax(spread[0], spread[1]), spread[2]) ? coarse : -1;
}

/* What the positions' numbers alone tell, if photos do not fit: are they of degrees, or of steps?
 * Returns whether there is a finding. */
static bool tell_numbers(cln_inspection *in, double exact)
{
    const cln_agreement *a = &in->agreement;
    double middle[3], spread[3], step = 0;
    int axis = 0;

    find_extent(in->scene, middle, spread);
    axis = metres_beside_degrees(middle, spread);
    if (axis >= 0) {
        cln_found_fault(in->findings, "poses", true, NULL,
                        "the photos do not fit their poses (%.0f%% of what two photos show lies "
                        "where both poses put it): the cameras' positions look like longitude and "
                        "latitude in degrees (%c about %.5g, %c about %.5g) beside metres (%c). "
                        "Convert them to metres along all three axes, as of UTM or of a local "
                        "frame",
                        100 * a->share, 'x' + (axis + 1) % 3, middle[(axis + 1) % 3],
                        'x' + (axis + 2) % 3, middle[(axis + 2) % 3], 'x' + axis);
        return true;
    }
    axis = rounded_axis(in->scene, middle, spread, &step);
    if (axis >= 0)
        cln_found_fault(in->findings, "poses", true, NULL,
                        "the photos do not fit their poses well (%.0f%% of what two photos show "
                        "lies where both poses put it, and %.0f%% of that exactly): the cameras' "
                        "positions were rounded to 32 bits, which tell their %c, about %.3g, in "
                        "steps of %.3g alone. Write them in 64 bits, or with the survey's origin "
                        "subtracted before; `cl-nascent export --offset` adds it again",
                        100 * a->share, 100 * exact, 'x' + axis, middle[axis], step);
    return axis >= 0;
}

/* Photos of one camera with the intrinsics of another. */
static void tell_part(cln_inspection *in)
{
    const cln_agree_part *part = &in->agreement.part;
    json_t *views = json_array();

    in->posed = false;
    for (int i = 0; i < in->scene->view_count; i++)
        if (part->has[i])
            cln_inspect_add(views, in, i);
    cln_found_fault(in->findings, "focal length", true, views,
                    "%s (%zu of %d) fit focal lengths %.2f times as long better than the given "
                    "ones (%.0f%% of what they share with other photos lies exactly where both "
                    "poses put it, with the given ones %.0f%%). Likely they are of another camera "
                    "than the others: give each photo its own camera's focal length, middle and "
                    "lens",
                    part->name, json_array_size(views), in->scene->view_count, part->focal,
                    100 * part->share, 100 * part->given);
}

/* To two digits. */
static double rounded(double value)
{
    const double unit = pow(10, floor(log10(value)) - 1);

    return round(value / unit) * unit;
}

/* Photos of two captures, or of two models of one, put together. */
static void tell_merged(cln_inspection *in)
{
    const cln_agree_merged *merged = &in->agreement.merged;
    char names[512], differs[128] = "";
    json_t *views = json_array();
    int length = 0;

    in->posed = false;
    for (int i = 0; i < in->scene->view_count; i++)
        if (merged->has[i])
            cln_inspect_add(views, in, i);
    if (fabs(log(merged->scale)) > log(FRAME_SCALE))
        length = snprintf(differs, sizeof differs, ", about %.6g times as %s",
                          rounded(fmax(merged->scale, 1 / merged->scale)),
                          merged->scale > 1 ? "small" : "large");
    if (merged->degrees > FRAME_TURN)
        length += snprintf(differs + length, sizeof differs - (size_t)length,
                           ", turned by %.0f degrees", merged->degrees);
    if (!length)
        snprintf(differs, sizeof differs, ", with another origin");
    cln_found_fault(
        in->findings, "frames", true, json_incref(views),
        "%zu of %d photos (%s) have poses of another frame than the others%s: they fit each other, "
        "but of %d marks that both kinds show, %.0f%% lie in one place only once %s frame is "
        "brought to the others' one. Likely two captures, or two models of one, were put "
        "together: take poses of all photos that were found together, or one part alone (or the "
        "two show different things that look alike)",
        json_array_size(views), in->scene->view_count,
        cln_findings_names(views, names, sizeof names), differs, merged->marks,
        100.0 * merged->fitting / merged->marks, merged->parts > 1 ? "a part's" : "their");
    json_decref(views);
}

/* Do all training cameras look the same way, from one side of what they look at? So do those before
 * which an object turned; where the cube is, the cameras of those in parallel do not tell. */
static bool stand_still(const cln_scene *scene)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double axes[3] = {0}, sides[3] = {0};

    for (int i = 0; i < count; i++) {
        const double *m = cln_scene_training_view(scene, i)->camera.c2w, *c = scene->space.centre;
        const double to[3] = {c[0] - m[3], c[1] - m[7], c[2] - m[11]};

        for (int k = 0; k < 3; k++) {
            axes[k] += m[4 * k + 2] / count;
            sides[k] += to[k] / fmax(hypot(hypot(to[0], to[1]), to[2]), 1e-12) / count;
        }
    }
    /* a mean of unit vectors is as short as they differ */
    return count > 1 && hypot(hypot(axes[0], axes[1]), axes[2]) > ONE_WAY &&
           (scene->in_parallel || hypot(hypot(sides[0], sides[1]), sides[2]) > ONE_WAY);
}

/* Do masks drop most of their photos, while what they drop just does not count? */
static bool drop_most(const cln_scene *scene)
{
    int masks = 0;

    return cln_scene_masks_leave(scene, &masks) < 0.5;
}

cln_status cln_inspect_poses(cln_inspection *in)
{
    cln_status st = CLN_OK;
    const cln_agreement *a = &in->agreement;
    const cln_reading *reading = &cln_readings[a->reading];
    const double exact = a->strict_share / a->reading_share;
    const int stands = cln_scene_few_stands(in->scene);
    double marks = NAN;
    bool thin = false;
    verdict judged = RIGHT;

    CLN_TRY(count_marks(in, &marks));
    thin = in->thin = marks < THIN_MARKS && a->tie_count < THIN_TIES * a->pairs;
    in->marks = marks;
    judged = isnan(a->share) ? RIGHT : judge(a, exact, thin);

    cln_inspect_measure(in, "compared_views", a->looked_at);
    cln_inspect_measure(in, "compared_pairs", a->pairs);
    cln_inspect_measure(in, "marks", marks);
    cln_inspect_measure(in, "ties", a->tie_count);
    cln_inspect_measure(in, "agreeing_share", a->share);
    cln_inspect_measure(in, "exact_share", isnan(a->share) ? NAN : exact);
    cln_inspect_measure(in, "still_share", a->still_share);
    if (a->still && !in->standing)
        cln_found_fault(in->findings, "backdrop", true, NULL,
                        "%.0f%% of what two photos show stands at one place in both pictures, "
                        "although the cameras move: a backdrop, lamp or ruler that stands still "
                        "while the object turns before a camera. " CLN_STILL_EFFECT,
                        100 * a->still_share);
    else if (in->scene->still)
        cln_found_fault(in->findings, "backdrop", true, NULL, "%s", CLN_STILL_ADVICE);
    if (stands > 0)
        cln_found_fault(in->findings, "places", true, NULL, CLN_STANDS_ADVICE,
                        in->scene->view_count, stands);
    in->posed = judged == RIGHT;
    if (isnan(a->share))
        soften_axes(in);
    if (isnan(a->share) && a->pairs == 0) {
        cln_found_fault(in->findings, "overlap", false, NULL,
                        "no two photos stand apart, so that none can be compared with their poses: "
                        "a scene needs photos from several places");
        goto done;
    }
    if (isnan(a->share)) {
        cln_found_fault(
            in->findings, "overlap", false, NULL,
            "the photos show too little in common (%d mark%s in %d pair%s of neighbours) "
            "to compare them with their poses: they stand far apart, or show little "
            "texture",
            a->tie_count, cln_plural(a->tie_count, "", "s"), a->pairs,
            cln_plural(a->pairs, "", "s"));
        goto done;
    }
    if ((a->share < UNSURE || exact < EXACT) && tell_numbers(in, exact)) {
        in->posed = false;
        goto done;
    }
    if (has_place(a)) {
        cln_findings_take_back(in->findings, "axes");
        cln_findings_take_back(in->findings, "scale"); /* as below */
        in->posed = false;
        tell_place(in);
        goto done;
    }
    if (a->reading > 0 && a->share < READING * a->reading_share && a->reading_share > SOUND / 2) {
        cln_findings_take_back(in->findings, "axes");
        cln_findings_take_back(in->findings,
                               "scale"); /* likely rays miss the cube for this reason */
        in->posed = false;
        cln_found_fault(in->findings, "axes", true, NULL,
                        "the photos do not fit the poses as given (%.0f%% of what two photos show "
                        "lies where both poses put it), but fit poses %s (%.0f%%): %s",
                        100 * a->share, reading->name, 100 * a->reading_share, reading->advice);
        goto done;
    }
    if (a->merged.parts) {
        tell_merged(in);
        goto done;
    }
    if (has_tilt(a)) {
        in->posed = false;
        cln_found_fault(
            in->findings, "tilt", true, NULL,
            "the photos fit cameras that all stand about %.0f degrees %s around what they "
            "look at, and look %s at it (%.0f%% of what two photos show lies exactly "
            "where both poses put it, as given %.0f%%). Likely the poses were computed "
            "on a circle without the camera's tilt: compute them with it",
            fabs(a->tilt), a->tilt > 0 ? "higher" : "lower", a->tilt > 0 ? "down" : "up",
            100 * a->tilt_exact, 100 * a->strict_share);
        goto done;
    }
    if (a->order && a->order_exact > a->focal_share && (judged != RIGHT || a->share < UNSOUND)) {
        in->posed = false;
        cln_found_fault(
            in->findings, "order", true, NULL,
            "the photos do not fit their poses (%.0f%% of what two photos show lies exactly "
            "where both poses put it), but do (%.0f%%) if %s",
            100 * a->strict_share, 100 * a->order_exact, a->order);
        goto done;
    }
    if (has_other_focal(a)) {
        in->posed = a->share > SOUND;
        cln_found_fault(
            in->findings, "focal length", true, NULL,
            "the photos fit focal lengths %.2f times as long better than the given "
            "ones (%.0f%% of what two photos show lies exactly where both poses put it, "
            "with the given ones %.0f%%). Likely the focal length is given for "
            "another image size, or the field of view is that across the other side",
            a->focal, 100 * a->focal_share, 100 * a->strict_share);
        goto done;
    }
    if (a->part.has && a->part.share > a->focal_share) {
        tell_part(in);
        goto done;
    }
    if (judged == UNCLEAR && (thin || a->share >= UNSOUND))
        tell_unclear(in, exact, marks, thin);
    else if (a->share < UNSOUND && judged != WRONG)
        cln_found_fault(
            in->findings, "overlap", false, NULL,
            "the photos stand so far apart that one shows little of what another does: "
            "only %.0f%% of %d marks that look alike in two photos lie where both poses "
            "put them%s. Photos at most 20 degrees apart tell more, and are learnt "
            "better",
            100 * a->share, a->tie_count,
            judged == RIGHT ? ", but these exactly, so the poses are right as far as "
                              "can be told"
                            : ", and whether the poses are right cannot be told");
    else if (a->share < UNSOUND)
        cln_found_fault(in->findings, "poses", true, NULL,
                        "the photos do not fit their poses: only %.0f%% of what two photos show "
                        "lies where both poses put it. Likely %snames and poses are in different "
                        "orders, or the poses are those of other photos or of another thing than "
                        "the camera, or quaternions were read in a wrong order, or the photos were "
                        "cropped and the intrinsics were not%s, or what they show repeats, as "
                        "tiles do",
                        100 * a->share,
                        stand_still(in->scene)
                            ? "the object turned before cameras that stood still (give poses in "
                              "the object's frame), or "
                            : "",
                        drop_most(in->scene) ? ", or masks have black and white exchanged" : "");
    else if (!in->posed)
        cln_found_fault(in->findings, "poses", true, NULL,
                        "the photos hardly fit their poses: %.0f%% of what two photos show lies "
                        "where both poses put it (of most good captures 80%% or more), and only "
                        "%.0f%% of that exactly (60%% or more). Likely each photo has the pose of "
                        "another one near it, as if names and poses are in different orders, or "
                        "the poses are inexact, or computed on a circle without the cameras' tilt, "
                        "or what they show repeats, as tiles do",
                        100 * a->share, 100 * exact);
    else if (a->share > SOUND)
        cln_findings_take_back(in->findings, "axes");
done:
    return st;
}

void cln_inspect_strays(cln_inspection *in)
{
    const cln_agree_view *views = in->agreement.views;
    char names[512];
    json_t *astray = json_array(), *over = json_array();

    for (int i = 0; i < in->scene->view_count; i++) {
        const int k = views[i].pose_of;

        if (views[i].over)
            cln_inspect_add(over, in, i);
        if (!views[i].bad || views[i].over)
            continue;
        if (k >= 0 && views[k].pose_of == i) {
            if (i < k) {
                json_t *both = json_array();

                cln_inspect_add(both, in, i);
                cln_inspect_add(both, in, k);
                cln_found_fault(in->findings, "swapped", true, both,
                                "the photos of %s and %s are swapped: each fits the other's pose",
                                in->scene->views[i].name, in->scene->views[k].name);
            }
        } else {
            cln_inspect_add(astray, in, i);
        }
    }
    if (json_array_size(astray))
        cln_found_fault(in->findings, "pose", true, json_incref(astray),
                        "photos that show what others show, but not as seen from their poses: "
                        "%s; leave them out or find their poses again",
                        cln_findings_names(astray, names, sizeof names));
    if (json_array_size(over)) {
        cln_findings_take_back(in->findings, "overlap"); /* by ties with these photos, too */
        cln_found_fault(in->findings, "upside down", true, json_incref(over),
                        "photos that lie upside down for their poses, as a program turned them by "
                        "180 degrees after these were found: %s; turn them back, or find poses "
                        "anew",
                        cln_findings_names(over, names, sizeof names));
    }
    json_decref(astray);
    json_decref(over);
}
