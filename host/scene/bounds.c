/* The root cube, and whether any training camera sees it. The first that applies:
 *   1. --bbox: the smallest cube around that box, with the same centre.
 *   2. what the dataset says (the reader).
 *   3. cameras that look at something together: centre = the point nearest to all optical axes;
 *      half = large enough for every camera, and for the part of the plane through the centre that
 *      each camera sees. So the cube holds what is looked at and as much behind it as the cameras
 *      are away.
 *   4. cameras that look in parallel or outwards: nothing tells how far the scene is. half = 4
 *      times the spread of the cameras, and the cube is moved along their mean direction until, for
 *      parallel cameras, they stand at its face.
 * 3 and 4 are guesses; bounds_rule says so and users give --bbox to do better. */
#include "scene/build.h"

#include <math.h>
#include <string.h>
#include "base/config.h"
#include "base/memory.h"

enum { GRID = 33, LATTICE = 9 };

/* Optical axes count as parallel when the nearest point is this badly determined: the smallest
 * eigenvalue of mean(I - d d^T) is about the squared sine of their typical angle. */
static const double PARALLEL = 1e-3;
static const double SPREADS = 4;
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

/* Mean of I - d d^T over the training cameras, of that times o, of o and of d. */
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

static void solve3(const double m[9], const double right[3], double out[3])
{
    const double det = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                       m[2] * (m[3] * m[7] - m[4] * m[6]);

    for (int k = 0; k < 3; k++) { /* Cramer: column k replaced */
        double n[9];

        memcpy(n, m, sizeof n);
        for (int i = 0; i < 3; i++)
            n[3 * i + k] = right[i];
        out[k] = (n[0] * (n[4] * n[8] - n[5] * n[7]) - n[1] * (n[3] * n[8] - n[5] * n[6]) +
                  n[2] * (n[3] * n[7] - n[4] * n[6])) /
                 det;
    }
}

/* Radius of what a camera sees around its axis at depth 1: the farthest corner. */
static double view_radius(const cln_camera *camera)
{
    const double x = fmax(camera->cx, camera->width - camera->cx) / camera->fx;
    const double y = fmax(camera->cy, camera->height - camera->cy) / camera->fy;

    return hypot(x, y);
}

/* The point nearest to all axes; false if they are parallel. */
static bool nearest_point(const axes *mean, double point[3])
{
    if (!(smallest_eigenvalue(mean->matrix) > PARALLEL))
        return false;
    solve3(mean->matrix, mean->right, point);
    return true;
}

/* Rule 3; false if the axes are parallel, or if the point lies behind a quarter of the cameras. */
static bool looked_at(const cln_scene *scene, const axes *mean, double centre[3], double *half)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int behind = 0;

    if (!nearest_point(mean, centre))
        return false;
    *half = 0;
    for (int v = 0; v < count; v++) {
        double o[3], d[3], depth = 0;

        position_and_axis(&scene->views[v].camera, o, d);
        for (int i = 0; i < 3; i++)
            depth += d[i] * (centre[i] - o[i]);
        behind += depth <= 0;
        *half = fmax(*half, max_norm_distance(o, centre));
        *half = fmax(*half, depth * view_radius(&scene->views[v].camera));
    }
    return 4 * behind < count;
}

/* Rule 4. */
static void in_front_of_cameras(const cln_scene *scene, const axes *mean, double centre[3],
                                double *half)
{
    double spread = 0;

    for (int v = 0; v < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); v++) {
        double o[3], d[3];

        position_and_axis(&scene->views[v].camera, o, d);
        spread = fmax(spread, max_norm_distance(o, mean->position));
    }
    *half = spread > 0 ? SPREADS * spread : 1; /* one camera, or all in one place: any scale */
    for (int i = 0; i < 3; i++)
        centre[i] = mean->position[i] + *half * mean->direction[i];
}

static cln_status box_of_option(cln_scene *scene, const char *bbox)
{
    cln_status st = CLN_OK;
    double box[6];

    CLN_TRY(cln_parse_reals(bbox, 6, box));
    scene->half = 0;
    for (int i = 0; i < 3; i++) {
        if (!(box[i] < box[i + 3]))
            CLN_TRY(cln_fail(CLN_USAGE, "--bbox %s: the minimum %g is not below the maximum %g",
                             bbox, box[i], box[i + 3]));
        scene->centre[i] = 0.5 * (box[i] + box[i + 3]);
        scene->half = fmax(scene->half, 0.5 * (box[i + 3] - box[i]));
    }
    CLN_TRY(cln_asprintf(&scene->bounds_rule, "the cube around --bbox %s", bbox));
done:
    return st;
}

cln_status cln_scene_find_bounds(cln_scene *scene, const cln_reader_result *result,
                                 const char *bbox)
{
    cln_status st = CLN_OK;
    axes mean;

    if (bbox[0]) {
        CLN_TRY(box_of_option(scene, bbox));
    } else if (result->has_bounds) {
        memcpy(scene->centre, result->centre, sizeof scene->centre);
        scene->half = result->half;
        CLN_TRY(cln_strdup(&scene->bounds_rule, result->bounds_rule));
    } else {
        gather_axes(scene, &mean);
        if (looked_at(scene, &mean, scene->centre, &scene->half)) {
            CLN_TRY(cln_strdup(&scene->bounds_rule,
                               "around the point nearest to all optical axes, out to the cameras; "
                               "--bbox sets a tighter one"));
        } else {
            in_front_of_cameras(scene, &mean, scene->centre, &scene->half);
            CLN_TRY(cln_strdup(&scene->bounds_rule,
                               "a guess, 4 times the spread of the cameras, because they look in "
                               "parallel or outwards; --bbox sets a better one"));
        }
    }
    for (int i = 0; i < 3; i++)
        if (!isfinite(scene->centre[i]) || fabs(scene->centre[i]) > HALF_MAX ||
            !(scene->half >= HALF_MIN && scene->half <= HALF_MAX))
            CLN_TRY(
                cln_fail(CLN_INPUT,
                         "%s: absurd scene cube, centre (%g, %g, %g) and half side %g (%s); give "
                         "a box with --bbox",
                         scene->folder, scene->centre[0], scene->centre[1], scene->centre[2],
                         scene->half, scene->bounds_rule));
done:
    return st;
}

bool cln_scene_focus(const cln_scene *scene, double point[3])
{
    axes mean;

    gather_axes(scene, &mean);
    return nearest_point(&mean, point);
}

/* Slab test of the ray o + t d, t >= 0, against the cube. */
static bool ray_meets_cube(const cln_scene *scene, const double o[3], const double d[3])
{
    double enter = 0, leave = INFINITY;

    for (int i = 0; i < 3; i++) {
        const double low = scene->centre[i] - scene->half - o[i];
        const double high = scene->centre[i] + scene->half - o[i];

        if (d[i] == 0) {
            if (low > 0 || high < 0)
                return false;
            continue;
        }
        enter = fmax(enter, fmin(low / d[i], high / d[i]));
        leave = fmin(leave, fmax(low / d[i], high / d[i]));
    }
    return enter < leave;
}

static bool pixel_meets_cube(const cln_scene *scene, const cln_camera *camera, double u, double v)
{
    double o[3], d[3];

    return u > 0 && v > 0 && u < camera->width && v < camera->height &&
           cln_camera_ray(camera, floor(u) + 0.5, floor(v) + 0.5, o, d) &&
           ray_meets_cube(scene, o, d);
}

/* Not every pixel: a grid over the image finds cubes that are large in it, the pixels onto which a
 * lattice of points of the cube falls find small ones. */
static bool camera_sees_cube(const cln_scene *scene, const cln_camera *camera)
{
    for (int j = 0; j < GRID; j++)
        for (int i = 0; i < GRID; i++)
            if (pixel_meets_cube(scene, camera, (i + 0.5) / GRID * camera->width,
                                 (j + 0.5) / GRID * camera->height))
                return true;
    for (int n = 0; n < LATTICE * LATTICE * LATTICE; n++) {
        const int index[3] = {n % LATTICE, n / LATTICE % LATTICE, n / LATTICE / LATTICE};
        double point[3], u, v, z;

        for (int k = 0; k < 3; k++)
            point[k] = scene->centre[k] + scene->half * (2.0 * index[k] / (LATTICE - 1) - 1);
        if (!cln_camera_project(camera, point, &u, &v, &z))
            continue;
        /* Neighbours too: the centre of the pixel with the cube's corner may just miss it. */
        for (int k = 0; k < 9; k++)
            if (pixel_meets_cube(scene, camera, u + k % 3 - 1, v + k / 3 - 1))
                return true;
    }
    return false;
}

cln_status cln_scene_check_seen(const cln_scene *scene)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    for (int v = 0; v < count; v++)
        if (camera_sees_cube(scene, &scene->views[v].camera))
            return CLN_OK;
    return cln_fail(
        CLN_INPUT,
        "%s: no camera looks at the cube: none of the %d training views has a ray through "
        "centre (%g, %g, %g), half side %g (%s); give the box of the scene with --bbox or "
        "check the axes of the poses",
        scene->folder, count, scene->centre[0], scene->centre[1], scene->centre[2], scene->half,
        scene->bounds_rule);
}
