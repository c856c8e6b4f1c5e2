/* The scene's cube, and whether any training camera sees it. The first of the `rules` below that
 * applies gives the cube, and bounds_rule says which it was. With --space ndc, and for formats of
 * forward-facing scenes unless --bbox or --space cube is given, the space of bounds_forward.c goes
 * before them.
 *   given_box       --bbox: the smallest cube around that box, with the same centre
 *   of_dataset      what the reader found in the files
 *   of_points       points on surfaces are known: the cube around them and around what the images
 *                   show there (bounds_points.c)
 *   of_depths       each image tells how near and how far its scene is: the cube around what their
 *                   corners show there
 *   looked_at       the cameras look at something together: centre = the point nearest to all
 *                   optical axes; half = out to every camera, and to the rim of what each camera
 *                   sees of the plane through the centre. So the cube holds what is looked at, and
 *                   as much behind it as the cameras are away. Through long lenses, which show far
 *                   less of it than that, it is what they show, unless alpha tells more.
 *   before_cameras  the cameras look in parallel or outwards, and nothing tells how far the scene
 *                   is: half = 4 times the spread of the cameras, and the cube is moved along their
 *                   mean direction until parallel cameras stand at its face. Where they look
 *                   outwards, or their lenses see far to the sides, photos have a shell around it,
 *                   as most of what they show may be beyond.
 * The last two are guesses; their bounds_rule names --bbox as the way to a better cube. */
#include "scene/build.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/memory.h"
#include "scene/vectors.h"

enum { GRID = 33, LATTICE = 9 };

/* Optical axes count as parallel when the nearest point is this badly determined: the smallest
 * eigenvalue of mean(I - d d^T) is about the squared sine of their typical angle. */
static const double PARALLEL = 1e-3;
static const double ONE_WAY = 0.9; /* length of the mean axis, from which all look one way */
static const double SPREADS = 4;
static const double CORE_SHARE = 0.5;
static const double LONG = 0.25; /* of a cube out to the cameras is seen, below which it is not */
/* A lens sees to the sides if such a share of its rays are so far off the axis (their cosine). */
static const double ASIDE = 0.5, ASIDE_SHARE = 0.125;
static const double HALF_MIN = 1e-9, HALF_MAX = 1e12;

static double max_norm_distance(const double a[3], const double b[3])
{
    return fmax(fabs(a[0] - b[0]), fmax(fabs(a[1] - b[1]), fabs(a[2] - b[2])));
}

static void position_and_axis(const cln_camera *camera, double position[3], double axis[3])
{
    for (int i = 0; i < 3; i++) {
        position[i] = camera->c2w[4 * i + 3];
        axis[i] = camera->c2w[4 * i + 2];
    }
}

/* Means over the training cameras, with position o and axis d: of I - d d^T, of that times o, of o
 * and of d. */
typedef struct axes {
    double matrix[9], right[3], position[3], direction[3];
} axes;

static void gather_axes(const cln_scene *scene, axes *out)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    memset(out, 0, sizeof *out);
    for (int v = 0; v < count; v++) {
        double o[3], d[3];

        position_and_axis(&scene->views[v].camera, o, d);
        for (int i = 0; i < 3; i++) {
            out->position[i] += o[i] / count;
            out->direction[i] += d[i] / count;
            for (int j = 0; j < 3; j++) {
                const double entry = ((i == j) - d[i] * d[j]) / count;

                out->matrix[3 * i + j] += entry;
                out->right[i] += entry * o[j];
            }
        }
    }
}

/* Smallest eigenvalue of a symmetric 3x3 matrix, in closed form. */
static double smallest_eigenvalue(const double m[9])
{
    const double mean = (m[0] + m[4] + m[8]) / 3;
    const double a = m[0] - mean, b = m[4] - mean, c = m[8] - mean;
    const double squares = a * a + b * b + c * c + 2 * (m[1] * m[1] + m[2] * m[2] + m[5] * m[5]);
    const double p = sqrt(squares / 6);
    double half_det = 0;

    if (p < 1e-15)
        return mean;
    half_det = (a * (b * c - m[5] * m[5]) - m[1] * (m[1] * c - m[5] * m[2]) +
                m[2] * (m[1] * m[5] - b * m[2])) /
               (2 * p * p * p);
    /* Angles in [0, pi/3]; the smallest root is the one shifted by 2 pi / 3. */
    return mean + 2 * p * cos(acos(fmax(-1, fmin(1, half_det))) / 3 + 2.0943951023931957);
}

/* Radius of what a camera sees around its axis at depth 1: the farthest corner. At most 1 for
 * lenses that are not perspective: they may see a half-space and more, which says nothing about the
 * scene. */
static double view_radius(const cln_camera *camera)
{
    const double x = fmax(camera->cx, camera->width - camera->cx) / camera->fx;
    const double y = fmax(camera->cy, camera->height - camera->cy) / camera->fy;
    double corner[3], across = 0;

    if (camera->lens == CLN_LENS_OPENCV || camera->lens == CLN_LENS_FULL_OPENCV)
        return hypot(x, y);
    if (!cln_lens_undistort(camera->lens, camera->distortion, (double[2]){x, y}, corner))
        return 1;
    across = hypot(corner[0], corner[1]);
    return corner[2] > across ? across / corner[2] : 1;
}

/* The point nearest to all axes; false if they are parallel. */
static bool nearest_point(const axes *mean, double point[3])
{
    if (!(smallest_eigenvalue(mean->matrix) > PARALLEL))
        return false;
    cln_solve3(mean->matrix, mean->right, point);
    return true;
}

/* The smallest cube around a box, with the same centre. */
static void enclose(const double low[3], const double high[3], cln_space *space)
{
    space->half = 0;
    for (int a = 0; a < 3; a++) {
        space->centre[a] = 0.5 * (low[a] + high[a]);
        space->half = fmax(space->half, 0.5 * (high[a] - low[a]));
    }
}

/* Keeps the box around which the cube was put. */
static void keep_box(cln_scene *scene, const double low[3], const double high[3])
{
    scene->has_box = true;
    memcpy(scene->box, low, 3 * sizeof *low);
    memcpy(scene->box + 3, high, 3 * sizeof *high);
}

/* ---- the rules: each leaves *because NULL if it does not apply ---- */

typedef struct evidence {
    cln_scene *scene; /* its box and in_parallel may be filled in */
    const cln_reader_result *result;
    const char *bbox; /* "" = none */
    axes mean;        /* of the training cameras */
} evidence;

static cln_status given_box(const evidence *e, cln_space *space, char **because)
{
    cln_status st = CLN_OK;
    double box[6];

    if (!e->bbox[0])
        return CLN_OK;
    CLN_TRY(cln_parse_reals(e->bbox, 6, box));
    for (int i = 0; i < 3; i++)
        if (!(box[i] < box[i + 3]))
            CLN_TRY(cln_fail(CLN_USAGE,
                             "--bbox %s: the minimum %g is not below the maximum %g; give the "
                             "lowest corner, then the highest",
                             e->bbox, box[i], box[i + 3]));
    enclose(box, box + 3, space);
    keep_box(e->scene, box, box + 3);
    CLN_TRY(cln_asprintf(because, "the cube around --bbox %s", e->bbox));
done:
    return st;
}

static cln_status of_dataset(const evidence *e, cln_space *space, char **because)
{
    if (!e->result->has_bounds)
        return CLN_OK;
    *space = e->result->space;
    if (e->result->has_box)
        keep_box(e->scene, e->result->box, e->result->box + 3);
    return cln_strdup(because, e->result->bounds_rule);
}

static cln_status of_points(const evidence *e, cln_space *space, char **because)
{
    cln_status st = CLN_OK;
    double low[3], high[3];
    bool found = false;

    CLN_TRY(cln_scene_box_of_points(e->scene, e->result, low, high, &found));
    if (!found)
        goto done;
    enclose(low, high, space);
    keep_box(e->scene, low, high);
    CLN_TRY(
        cln_asprintf(because,
                     "around the %d %s%s and what the images show there, without outliers; --bbox "
                     "sets a tighter one",
                     e->result->point_count - e->result->dropped_count,
                     e->result->depth_points ? "points of depth images" : "sparse points",
                     e->result->dropped_count ? " that masks do not drop" : ""));
done:
    return st;
}

/* The cube by the dataset's near and far depths, if every training view has them. */
static cln_status of_depths(const evidence *e, cln_space *space, char **because)
{
    const int count = cln_scene_split_count(e->scene, CLN_SPLIT_TRAIN);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    for (int v = 0; v < count; v++)
        if (!(e->scene->views[v].far > 0))
            return CLN_OK;
    for (int corner = 0; corner < 8 * count; corner++) {
        const cln_view *view = &e->scene->views[corner / 8];
        const cln_camera *camera = &view->camera;
        const double depth = corner & 4 ? view->far : view->near;
        double o[3], d[3], along = 0;

        if (!cln_camera_ray(camera, corner & 1 ? camera->width : 0, corner & 2 ? camera->height : 0,
                            o, d))
            continue;
        for (int a = 0; a < 3; a++)
            along += d[a] * camera->c2w[4 * a + 2];
        for (int a = 0; a < 3 && along > 0; a++) {
            low[a] = fmin(low[a], o[a] + d[a] * depth / along);
            high[a] = fmax(high[a], o[a] + d[a] * depth / along);
        }
    }
    enclose(low, high, space);
    return cln_strdup(because, "around what the images show between the dataset's near and far "
                               "depths; --bbox sets a tighter one");
}

/* Does not apply if the axes are parallel, or if a quarter of the cameras have the point behind
 * them. */
static cln_status looked_at(const evidence *e, cln_space *space, char **because)
{
    const int count = cln_scene_split_count(e->scene, CLN_SPLIT_TRAIN);
    int behind = 0;

    if (!nearest_point(&e->mean, space->centre))
        return CLN_OK;
    space->half = 0;
    for (int v = 0; v < count; v++) {
        double o[3], d[3], depth = 0;

        position_and_axis(&e->scene->views[v].camera, o, d);
        for (int i = 0; i < 3; i++)
            depth += d[i] * (space->centre[i] - o[i]);
        behind += depth <= 0;
        space->half = fmax(space->half, max_norm_distance(o, space->centre));
        space->half = fmax(space->half, depth * view_radius(&e->scene->views[v].camera));
    }
    if (4 * behind >= count)
        return CLN_OK;
    return cln_strdup(because, "around the point nearest to all optical axes, out to the cameras; "
                               "--bbox sets a tighter one");
}

static cln_status before_cameras(const evidence *e, cln_space *space, char **because)
{
    const double *d = e->mean.direction;
    double spread = 0;

    for (int v = 0; v < cln_scene_split_count(e->scene, CLN_SPLIT_TRAIN); v++) {
        double o[3], axis[3];

        position_and_axis(&e->scene->views[v].camera, o, axis);
        spread = fmax(spread, max_norm_distance(o, e->mean.position));
    }
    e->scene->outwards = nearest_point(&e->mean, space->centre) ||
                         hypot(hypot(d[0], d[1]), d[2]) < ONE_WAY; /* opposite ones, along a line */
    e->scene->in_parallel = spread > 0 && !e->scene->outwards;
    space->half =
        spread > 0 ? SPREADS * spread : 1; /* one camera, or all in one place: any scale */
    for (int i = 0; i < 3; i++)
        space->centre[i] = e->mean.position[i] + space->half * d[i];
    return cln_asprintf(because,
                        "a guess, 4 times the spread of the cameras, because they look %s; --bbox "
                        "sets a better one",
                        e->scene->outwards ? "outwards" : "in parallel");
}

/* In this order; the last one always applies. */
static cln_status (*const rules[])(const evidence *, cln_space *, char **) = {
    given_box, of_dataset, of_points, of_depths, looked_at, before_cameras};

/* bounds_rule stays NULL if a cube is wanted, or if a scene is not forward-facing although its
 * format is for such scenes: refused[] then says why. */
static cln_status find_forward(cln_scene *scene, const cln_reader_result *result,
                               const cln_config *config, char refused[CLN_REFUSED_BYTES])
{
    cln_status st = CLN_OK;
    const bool wanted = config->space == CLN_SPACE_NDC;

    refused[0] = 0;
    if (!wanted && !(config->space == CLN_SPACE_AUTO && result->forward && !config->bbox[0]))
        return CLN_OK;
    CLN_TRY(cln_scene_find_forward(scene, result, &scene->space, &scene->bounds_rule, refused));
    if (wanted && !scene->bounds_rule)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: --space ndc: there are no normalised device coordinates, because %s; "
                         "leave the option out",
                         scene->folder, refused));
done:
    return st;
}

/* How far from a point pictures show what is as far from their cameras as it is: the largest of the
 * training cameras. */
static double seen_radius(const cln_scene *scene, const double point[3])
{
    double radius = 0;

    for (int v = 0; v < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); v++) {
        const cln_camera *camera = &scene->views[v].camera;
        double o[3], d[3], depth = 0;

        position_and_axis(camera, o, d);
        for (int i = 0; i < 3; i++)
            depth += d[i] * (point[i] - o[i]);
        radius = fmax(radius, depth * view_radius(camera));
    }
    return radius;
}

/* Without points, the cube of a shell is half of what looked_at finds, as the cameras may stand in
 * the shell; through long lenses it is what they show, with a shell or without. It also replaces a
 * larger box of instant-ngp, which holds what lies beyond, too. */
static cln_status looked_at_in_shell(const evidence *e, cln_space *space, char **because)
{
    cln_status st = CLN_OK;
    cln_space core = *space;
    char *rule = NULL;
    double seen = 0;

    CLN_TRY(looked_at(e, &core, &rule));
    seen = seen_radius(e->scene, core.centre);
    core.half *= CORE_SHARE;
    if (!rule || (e->result->has_bounds && fmin(core.half, seen) >= space->half))
        goto done;
    space->half = fmin(core.half, seen);
    memcpy(space->centre, core.centre, sizeof space->centre);
    free(*because);
    *because = NULL;
    CLN_TRY(cln_strdup(because, seen < core.half
                                    ? "around the point nearest to all optical axes, as wide as "
                                      "the photos show there; --bbox sets a tighter one"
                                    : "around the point nearest to all optical axes, half way out "
                                      "to the cameras; --bbox sets a tighter one"));
done:
    free(rule);
    return st;
}

/* Photos show what lies beyond a cube that was found by sparse points or guessed, but not if their
 * alpha cuts an object out, nor if their file gives a box that is not for that, too. */
static bool chooses_shell(const evidence *e, const cln_config *config, bool found)
{
    return config->space == CLN_SPACE_AUTO && config->stage1 == CLN_STAGE1_GATHER && found &&
           e->result->beyond && !e->scene->has_alpha;
}

/* instant-ngp's box with room for all around, of cameras that look at nothing in it, says nothing
 * of where the scene is. */
static cln_status is_void(const evidence *e, const cln_config *config, bool *is)
{
    cln_status st = CLN_OK;
    cln_space core;
    char *rule = NULL;

    *is = false;
    if (!e->result->wide || e->result->space.half > HALF_MAX ||
        !(chooses_shell(e, config, true) || config->space == CLN_SPACE_SHELL))
        return CLN_OK;
    CLN_TRY(looked_at(e, &core, &rule));
    *is = !rule;
done:
    free(rule);
    return st;
}

/* Whether the lens of the first training camera sees far to the sides, by a grid of its pixels. */
static bool sees_aside(const cln_scene *scene)
{
    const cln_camera *c = &scene->views[0].camera;
    int rays = 0, aside = 0;

    for (int k = 0; k < GRID * GRID; k++) {
        double o[3], d[3], along = 0;

        if (!cln_camera_ray(c, (k % GRID + 0.5) / GRID * c->width,
                            (k / GRID + 0.5) / GRID * c->height, o, d))
            continue;
        for (int a = 0; a < 3; a++)
            along += d[a] * c->c2w[4 * a + 2];
        rays++;
        aside += along < ASIDE;
    }
    return aside > ASIDE_SHARE * rays;
}

/* Adds to bounds_rule why the space is not a forward one, and that a shell is around the cube. */
static cln_status add_reasons(cln_scene *scene, const char *refused, bool chosen)
{
    return cln_append(&scene->bounds_rule, "%s%s%s",
                      refused[0] ? "; not normalised device coordinates, because " : "", refused,
                      !scene->space.shell ? ""
                      : chosen ? "; and a shell, as photos may show what lies beyond it, too "
                                 "(--space cube: without)"
                               : "; and a shell with what lies beyond it");
}

cln_status cln_scene_find_bounds(cln_scene *scene, const cln_reader_result *result,
                                 const cln_config *config)
{
    cln_status st = CLN_OK;
    cln_space *space = &scene->space;
    evidence e = {.scene = scene, .result = result, .bbox = config->bbox};
    char refused[CLN_REFUSED_BYTES];
    bool sane = true, chosen = false, wide = false, says_nothing = false;

    CLN_TRY(find_forward(scene, result, config, refused));
    gather_axes(scene, &e.mean);
    CLN_TRY(is_void(&e, config, &says_nothing));
    for (size_t i = 0; i < sizeof rules / sizeof *rules && !scene->bounds_rule; i++) {
        if (rules[i] == of_dataset && says_nothing)
            continue;
        CLN_TRY(rules[i](&e, space, &scene->bounds_rule));
        if (!scene->bounds_rule)
            continue;
        scene->box_given = rules[i] == given_box;
        scene->cube_guessed = rules[i] == looked_at || rules[i] == before_cameras;
        wide = rules[i] == of_dataset && result->wide;
        chosen = chooses_shell(
            &e, config,
            rules[i] == of_points || rules[i] == looked_at || wide ||
                (rules[i] == before_cameras && (scene->outwards || sees_aside(scene))));
        space->shell = chosen || config->space == CLN_SPACE_SHELL;
        if (space->shell ? rules[i] == looked_at || (rules[i] == of_dataset && result->beyond)
                         : rules[i] == looked_at && !scene->has_alpha &&
                               seen_radius(scene, space->centre) < LONG * space->half)
            CLN_TRY(looked_at_in_shell(&e, space, &scene->bounds_rule));
        if (chosen && wide && space->half == result->space.half) /* it is smaller than the box */
            space->shell = chosen = false;
    }
    if (!space->forward)
        CLN_TRY(add_reasons(scene, refused, chosen));
    sane = space->half >= HALF_MIN && space->half <= HALF_MAX;
    for (int i = 0; i < 3; i++)
        sane = sane && fabs(space->centre[i]) <= HALF_MAX; /* false for NaN, too */
    if (!sane)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: absurd scene cube, centre (%g, %g, %g) and half side %g (%s); half "
                         "sides of %g to %g units are taken: rescale the scene, or, if wrong poses "
                         "make it so (or all cameras stand in one point), give a box with --bbox",
                         scene->folder, space->centre[0], space->centre[1], space->centre[2],
                         space->half, scene->bounds_rule, HALF_MIN, HALF_MAX));
done:
    return st;
}

cln_status cln_scene_take_box(cln_scene *scene, const char *bbox)
{
    cln_status st = CLN_OK;
    const evidence e = {.scene = scene, .bbox = bbox};
    char *because = NULL;

    CLN_TRY(given_box(&e, &scene->space, &because));
    free(scene->bounds_rule);
    scene->bounds_rule = because;
    scene->cube_guessed = false;
    scene->cube_share = cln_scene_cube_share(scene);
    scene->spread = cln_scene_spread(scene);
done:
    return st;
}

bool cln_scene_focus(const cln_scene *scene, double point[3])
{
    axes mean;

    gather_axes(scene, &mean);
    return nearest_point(&mean, point);
}

static bool pixel_meets_cube(const cln_space *space, const cln_camera *camera, double u, double v)
{
    double o[3], d[3];

    return u > 0 && v > 0 && u < camera->width && v < camera->height &&
           cln_camera_ray(camera, floor(u) + 0.5, floor(v) + 0.5, o, d) &&
           cln_space_met_by(space, o, d);
}

/* Tests only some pixels: a grid over the image finds cubes that are large in it; the pixels to
 * which a lattice of points in the cube projects find small ones. */
bool cln_camera_sees(const cln_camera *camera, const cln_space *space)
{
    for (int j = 0; j < GRID; j++)
        for (int i = 0; i < GRID; i++)
            if (pixel_meets_cube(space, camera, (i + 0.5) / GRID * camera->width,
                                 (j + 0.5) / GRID * camera->height))
                return true;
    for (int n = 0; n < LATTICE * LATTICE * LATTICE; n++) {
        const int index[3] = {n % LATTICE, n / LATTICE % LATTICE, n / LATTICE / LATTICE};
        double point[3], u, v, z;

        for (int k = 0; k < 3; k++)
            point[k] = 2.0 * index[k] / (LATTICE - 1) - 1;
        cln_space_point_to_scene(space, point, point);
        if (!cln_camera_project(camera, point, &u, &v, &z))
            continue;
        /* Neighbours too: the centre of the pixel with the cube's corner may just miss the cube. */
        for (int k = 0; k < 9; k++)
            if (pixel_meets_cube(space, camera, u + k % 3 - 1, v + k / 3 - 1))
                return true;
    }
    return false;
}

bool cln_scene_view_counts(const cln_scene *scene, int view)
{
    const cln_space core = cln_space_core(&scene->space);

    return scene->space.forward || (scene->space.shell && !scene->box_given) ||
           cln_camera_sees(&scene->views[view].camera, &core);
}

cln_status cln_scene_check_seen(const cln_scene *scene)
{
    const cln_space *space = &scene->space;
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    for (int v = 0; v < count; v++)
        if (cln_camera_sees(&scene->views[v].camera, space))
            return CLN_OK;
    return cln_fail(
        CLN_INPUT,
        "%s: no camera looks at the cube: none of the %d training views has a ray through "
        "centre (%g, %g, %g), half side %g (%s); give the box of the scene with --bbox or "
        "check axes and units of the poses",
        scene->folder, count, space->centre[0], space->centre[1], space->centre[2], space->half,
        scene->bounds_rule);
}
