/* What in a scene looks like a mistake in its splits, its lenses or its poses. Each mistake of
 * poses shows in a number, with a bound between its values in good captures and in faulty ones
 * (tests/scene/test_doubts.c). As captures of other kinds may pass the bound, too, the sentences
 * say "likely".
 *   cube_share   of the training rays, those that meet the cube: small where translations are too
 *                large for a cube that the dataset or --bbox fixes
 *   spread       of the training cameras, in half sides of the cube: small where they are too small
 *   apart_share  of pairs of training cameras whose axes differ, those whose axes come nearest to
 *                each other behind both: all if cameras around an object look away from it, by axes
 *                of another convention; few in a room, some over flat land. Sparse points before
 *                the cameras outweigh it: a strip of photos straight down may lean apart */
#include "scene/build.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "base/text.h"
#include "scene/inspect.h"
#include "scene/vectors.h"

enum { RAYS = 16, CAMERAS = 256, PAIRS_MIN = 3, POINTS = 256, POINTS_MIN = 16, PATH_MIN = 8 };
static const double OFF_MAX = 0.2; /* of a principal point, in sides of the image */
static const double CUBE_SHARE_MIN = 0.05, SPREAD_MIN = 0.01, ONE_PLACE = 1e-9, APART_MAX = 0.8;
static const double FROM_AROUND = 0.5;             /* cosine of 60 degrees between two axes */
static const double DIFFER = 0.030153689607045808; /* squared sine of 10 degrees */
static const double ONE_WAY = 0.95;                /* length of the mean of their axes */
static const double WITHIN = 0.05; /* of the points, on either side of a camera within them */
static const double PASSED = 0.9;  /* of the points in their pictures, where cameras pass them */
static const double PATH = 0.94;   /* squared, of the cameras' way what goes where they look */

/* At most CAMERAS training cameras, evenly chosen: their number, and below, camera i of them. */
static int chosen_count(const cln_scene *scene)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    return count < CAMERAS ? count : CAMERAS;
}

static const cln_camera *chosen(const cln_scene *scene, int i)
{
    const int64_t count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    return &scene->views[i * count / chosen_count(scene)].camera; /* train stands first */
}

double cln_scene_cube_share(const cln_scene *scene)
{
    const int count = chosen_count(scene);
    double met = 0;

    for (int i = 0; i < count; i++) {
        const cln_camera *c = chosen(scene, i);

        for (int k = 0; k < RAYS * RAYS; k++) {
            double o[3], d[3];

            (void)cln_camera_ray(c, (k % RAYS + 0.5) / RAYS * c->width,
                                 (k / RAYS + 0.5) / RAYS * c->height, o, d);
            met += cln_space_met_by(&scene->space, o, d);
        }
    }
    return met / (RAYS * RAYS * (double)count);
}

double cln_scene_spread(const cln_scene *scene)
{
    const int count = chosen_count(scene);
    double mean[3] = {0}, farthest = 0;

    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            mean[a] += chosen(scene, i)->c2w[4 * a + 3] / count;
    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            farthest = fmax(farthest, fabs(chosen(scene, i)->c2w[4 * a + 3] - mean[a]));
    return farthest / scene->space.half;
}

/* Where do two axes come nearest to each other? +1 before both cameras, -1 behind both, 0 before
 * one of them, or if they are too parallel to tell. s, t: how far along the axes. */
static int meet(const cln_camera *a, const cln_camera *b, bool *differ)
{
    double cosine = 0, along_a = 0, along_b = 0, s = 0, t = 0;

    for (int i = 0; i < 3; i++) {
        const double da = a->c2w[4 * i + 2], db = b->c2w[4 * i + 2];
        const double way = b->c2w[4 * i + 3] - a->c2w[4 * i + 3];

        cosine += da * db;
        along_a += da * way;
        along_b += db * way;
    }
    *differ = 1 - cosine * cosine > DIFFER;
    s = along_a - cosine * along_b; /* both times 1 - cosine^2, which is above 0 */
    t = cosine * along_a - along_b;
    return *differ ? (s > 0 && t > 0) - (s < 0 && t < 0) : 0;
}

static double apart_share(const cln_scene *scene)
{
    const int count = chosen_count(scene);
    int pairs = 0, apart = 0;

    for (int i = 0; i < count; i++) {
        for (int k = 0; k < i; k++) {
            bool differ = false;

            apart += meet(chosen(scene, i), chosen(scene, k), &differ) < 0;
            pairs += differ;
        }
    }
    return pairs < PAIRS_MIN ? NAN : (double)apart / pairs;
}

/* Of the points that project into a picture, from before or from behind, those that lie before it:
 * about all, or none by axes of another convention. NAN: too few to tell. */
static double before_share(const cln_scene *scene, const cln_reader_result *result)
{
    const int count = chosen_count(scene), points = result ? result->point_count : 0;
    const int step = points / POINTS + 1;
    int64_t seen = 0, before = 0;

    for (int i = 0; i < count; i++) {
        const cln_camera *c = chosen(scene, i);

        for (int k = 0; k < points; k += step) {
            double p[3], u = 0, v = 0, along = 0;

            for (int a = 0; a < 3; a++) {
                p[a] = result->points[k].xyz[a];
                along += c->c2w[4 * a + 2] * (p[a] - c->c2w[4 * a + 3]);
            }
            for (int a = 0; a < 3 && along < 0; a++) /* through the camera, to its other side */
                p[a] = 2 * c->c2w[4 * a + 3] - p[a];
            if (!cln_camera_shows(c, p, &u, &v))
                continue;
            seen++;
            before += along > 0;
        }
    }
    return seen < POINTS_MIN ? NAN : (double)before / (double)seen;
}

/* Do most cameras stand within the sparse points? */
static bool are_within(const cln_scene *scene, const cln_reader_result *result)
{
    const int count = chosen_count(scene), points = result ? result->point_count : 0;
    const int step = points / POINTS + 1;
    int within = 0;

    for (int i = 0; i < count; i++) {
        bool is = points >= POINTS_MIN;

        for (int a = 0; a < 3 && is; a++) {
            int below = 0, all = 0;

            for (int k = 0; k < points; k += step, all++)
                below += result->points[k].xyz[a] < chosen(scene, i)->c2w[4 * a + 3];
            is = fmin(below, all - below) >= WITHIN * all;
        }
        within += is;
    }
    return 2 * within > count;
}

/* Of cameras that look one way: how far they stand from their middle at most, squared, and along
 * where they look. False of others. */
static bool one_way(const cln_scene *scene, double *farthest, double *along)
{
    const int count = chosen_count(scene);
    double mean[3] = {0}, axis[3] = {0}, length = 0;

    *farthest = *along = 0;
    for (int i = 0; i < count; i++)
        for (int a = 0; a < 3; a++) {
            mean[a] += chosen(scene, i)->c2w[4 * a + 3] / count;
            axis[a] += chosen(scene, i)->c2w[4 * a + 2] / count;
        }
    length = sqrt(cln_dot(axis, axis));
    for (int i = 0; i < count; i++) {
        double way[3];

        for (int a = 0; a < 3; a++)
            way[a] = chosen(scene, i)->c2w[4 * a + 3] - mean[a];
        *farthest = fmax(*farthest, cln_dot(way, way));
        *along = fmax(*along, pow(cln_dot(way, axis) / length, 2));
    }
    return length > ONE_WAY;
}

bool cln_scene_is_path(const cln_scene *scene)
{
    double farthest = 0, along = 0;

    return chosen_count(scene) >= PATH_MIN && one_way(scene, &farthest, &along) &&
           along > PATH * farthest;
}

/* Do cameras that look one way pass what they see: do they move further than the points in their
 * pictures are away or, if nothing tells that, along a path? */
static bool pass_by(const cln_scene *scene, const cln_reader_result *result)
{
    const int count = chosen_count(scene), points = result ? result->point_count : 0;
    const int step = points / POINTS + 1;
    double farthest = 0, along = 0;
    int seen = 0, passed = 0;

    if (!one_way(scene, &farthest, &along))
        return false;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < points; k += step) {
            const cln_camera *c = chosen(scene, i);
            double p[3], way[3], u = 0, v = 0;

            for (int a = 0; a < 3; a++) {
                p[a] = result->points[k].xyz[a];
                way[a] = p[a] - c->c2w[4 * a + 3];
            }
            if (!cln_camera_shows(c, p, &u, &v))
                continue;
            seen++;
            passed += cln_dot(way, way) < 4 * farthest;
        }
    return seen >= POINTS_MIN ? passed >= PASSED * seen : cln_scene_is_path(scene);
}

void cln_scene_find_doubts(cln_scene *scene, const cln_reader_result *result)
{
    scene->amid = are_within(scene, result) || pass_by(scene, result);
    scene->before_share = before_share(scene, result);
    scene->cube_share = cln_scene_cube_share(scene);
    scene->spread = cln_scene_spread(scene);
    scene->apart_share = apart_share(scene);
}

static int by_name(const void *a, const void *b)
{
    return cln_natural_compare(((const cln_view *)a)->name, ((const cln_view *)b)->name);
}

/* Adds a finding of test views that are training views, too: a dataset that names splits may have
 * the same file in both. */
static void tell_shared(const cln_scene *scene, json_t *findings)
{
    const int train = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const int test = cln_scene_split_count(scene, CLN_SPLIT_TEST);
    json_t *names = json_array();
    int count = 0;

    for (int i = 0; i < test; i++) {
        const cln_view *view = &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TEST, i)];

        if (bsearch(view, scene->views, (size_t)train, sizeof *view, by_name))
            json_array_append_new(names, json_string(view->name));
    }
    count = (int)json_array_size(names);
    if (count > 0)
        cln_found_fault(findings, "split", true, json_incref(names),
                        "%d of %d test photos %s trained on, too ('%s'%s): test PSNR tells less of "
                        "new views; name each photo in one split alone",
                        count, test, cln_plural(count, "is", "are"),
                        json_string_value(json_array_get(names, 0)), count > 1 ? ", ..." : "");
    json_decref(names);
}

bool cln_scene_few_around(const cln_scene *scene)
{
    const int train = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double point[3];
    bool around = false;

    if (train < CLN_LEAST_PHOTOS || train >= CLN_FEW_AROUND || !cln_scene_focus(scene, point))
        return false;
    for (int i = 0; i < train; i++) {
        const double *m = cln_scene_training_view(scene, i)->camera.c2w;
        double along = 0;

        for (int a = 0; a < 3; a++)
            along += m[4 * a + 2] * (point[a] - m[4 * a + 3]);
        if (along <= 0)
            return false; /* it looks away */
        for (int k = 0; k < i; k++) {
            const double *n = cln_scene_training_view(scene, k)->camera.c2w;

            around |= m[2] * n[2] + m[6] * n[6] + m[10] * n[10] < FROM_AROUND;
        }
    }
    return around;
}

/* Where every Nth photo is held out of few. */
static const char *few_held(const cln_scene *scene)
{
    const bool held = !scene->has_splits && cln_scene_split_count(scene, CLN_SPLIT_TEST) > 0;

    return held ? ", or hold none out: --holdout 0 (or fewer: --test-views)" : "";
}

static void tell_few(const cln_scene *scene, json_t *findings)
{
    const int train = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    if (cln_scene_few_around(scene))
        cln_found_fault(findings, "photos", false, NULL,
                        "only %d training photos around an object: views between them will be "
                        "hardly better than a blend of the photos (9 gave 5 dB more than 5). Take "
                        "more%s",
                        train, few_held(scene));
    if (train < CLN_LEAST_PHOTOS)
        cln_found_fault(findings, "photos", true, NULL,
                        "only %d training photo%s: what fewer than three show can be at any "
                        "distance, so views from elsewhere will be wrong. Take more photos%s",
                        train, cln_plural(train, "", "s"), few_held(scene));
}

/* The sign of a camera that is given for another image size, where no width and height tell it. */
static void tell_principal(const cln_scene *scene, json_t *findings)
{
    double off = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_camera *c = &scene->views[i].camera;

        if (c->lens != CLN_LENS_EQUIRECTANGULAR)
            off = fmax(off, fmax(fabs(c->cx / c->width - .5), fabs(c->cy / c->height - .5)));
    }
    if (off > OFF_MAX)
        cln_found_fault(findings, "intrinsics", true, NULL,
                        "the principal point is %sup to %.0f%% of the image's side off its middle. "
                        "Likely cx, cy (and focal lengths) of another image size, unless photos "
                        "were cropped",
                        off > .5 ? "outside the image, " : "", 100 * off);
}

/* Of a thing in the middle of all photos masks are rarely meant to drop that. */
static void tell_reversed(const cln_scene *scene, json_t *findings)
{
    if (scene->masks_reversed)
        cln_found_fault(findings, "masks", false, NULL,
                        "the masks drop one part around the middle of most photos, and keep "
                        "what is around it. Likely black is the object: --masks inverted reads "
                        "them so; if it is to be left out, --masks ignore says so");
}

static bool of_transforms(const cln_scene *scene)
{
    static const char *const dialects[] = {"blender", "nerfstudio", "instant-ngp"};

    for (size_t i = 0; i < sizeof dialects / sizeof *dialects; i++)
        if (scene->dialect && strcmp(scene->dialect, dialects[i]) == 0)
            return true;
    return false;
}

void cln_scene_tell_doubts(const cln_scene *scene, json_t *findings)
{
    const cln_space *space = &scene->space;

    cln_scene_doubt_turns(scene, findings);
    tell_shared(scene, findings);
    tell_few(scene, findings);
    tell_principal(scene, findings);
    tell_reversed(scene, findings);
    if (scene->apart_share > APART_MAX && !(scene->before_share > 0.5))
        cln_found_fault(
            findings, "axes", true, NULL,
            "the cameras look apart: for %.0f%% of the pairs of cameras, the point that both "
            "axes pass lies behind both%s. Likely the axes of the poses are wrong%s. Photos taken "
            "outwards from one place are right as they are",
            100 * scene->apart_share,
            scene->before_share <= 0.5 ? ", and most sparse points lie behind the cameras" : "",
            of_transforms(scene) ? ": in a transforms file they are OpenGL's (y up, z backwards); "
                                   "if this one has OpenCV's (y down, z forward), negate the "
                                   "second and third column of each matrix; if it is world to "
                                   "camera, as solvePnP and calibrateCamera have it, invert each "
                                   "before that"
                                 : ", or the poses are camera to world where the format has world "
                                   "to camera: export them again");
    if (scene->cube_share < CUBE_SHARE_MIN)
        cln_found_fault(
            findings, "scale", true, NULL,
            "only %.1f%% of the training rays meet the cube (centre %g, %g, %g, half side "
            "%g; %s), so there is little to learn from. Likely the scale is wrong: "
            "translations are in another unit than the cube; scale them, or give a larger box "
            "with --bbox",
            100 * scene->cube_share, space->centre[0], space->centre[1], space->centre[2],
            space->half, scene->bounds_rule);
    if (scene->spread < ONE_PLACE && cln_scene_split_count(scene, CLN_SPLIT_TRAIN) > PAIRS_MIN)
        cln_found_fault(findings, "scale", true, NULL,
                        "all training cameras stand in one place, so no distance can be found. "
                        "Likely the poses are missing; a panorama does not show distances");
    else if (scene->spread < SPREAD_MIN &&
             cln_scene_split_count(scene, CLN_SPLIT_TRAIN) > PAIRS_MIN)
        cln_found_fault(findings, "scale", true, NULL,
                        "the training cameras stand within %.2g half sides of the cube of each "
                        "other, too near to tell distances. Likely the scale is wrong: "
                        "translations are in another unit than the cube (half side %g; %s); scale "
                        "them, or give a smaller box with --bbox",
                        scene->spread, space->half, scene->bounds_rule);
}

void cln_scene_warn_doubts(const cln_scene *scene)
{
    json_t *findings = json_array();

    cln_scene_tell_doubts(scene, findings);
    cln_scene_tell_missed(scene, findings);
    for (size_t i = 0; i < json_array_size(findings); i++)
        cln_warn("%s: %s", scene->folder,
                 json_string_value(json_object_get(json_array_get(findings, i), "text")));
    json_decref(findings);
    if (scene->cube_guessed && (scene->in_parallel || scene->outwards))
        cln_warn("%s: the cube is a guess, half side %g, by how far the cameras moved, as they "
                 "look %s: it may be far smaller than what the photos show, %s, or several times "
                 "as large, and detail is lost then. `cl-nascent check` proposes a box for --bbox; "
                 "sparse points give one, too",
                 scene->folder, scene->space.half, scene->outwards ? "outwards" : "in parallel",
                 scene->space.shell ? "and what is far beyond it is coarse"
                                    : "which is painted onto its faces then");
}
