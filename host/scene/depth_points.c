/* Depth images of photos: a grid of pixels of each, of which what is unsure, or farther than
 * sensors see, is left out. Their points say where the scene is, where a dataset has no others, and
 * are depths of training pixels, as those of sights.c are, if they fit each other from photo to
 * photo: in another unit than the poses' they do not. Depths are along the optical axis. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/build.h"
#include "scene/dataset.h"

enum {
    ACROSS = 12, /* points of an image along its longer side, for the cube */
    SIGHTS = 32, /* and as depths of pixels */
    SIGHTS_MOST = 1 << 19,
    SURE = 255,        /* confidence */
    UNKNOWN = 65535,   /* of the sky, or where nothing came back; as 0 is */
    COMPARED = 64,     /* photos whose points are looked for in others' depths */
    OTHERS = 12,       /* such others, at the following powers of two and between these */
    POINTS = 128,      /* about so many of a photo */
    LEAST_ALIKE = 100, /* points that tell, of all photos; of one: */
    LEAST_OF_ONE = 20,
    DECADES = 3, /* of other units, either way */
    STEPS = 12,  /* a decade: below what ALIKE spans; then finer ones */
    FINE_STEPS = 12,
};
static const double STEEPEST = 0.1;    /* cosine to the optical axis */
static const double SMOOTH = 0.15;     /* by which depths around a pixel may differ from its own, */
static const double MOST_ALIKE = 0.85; /* and how many of them must not */
static const double ALIKE = 0.1;       /* by which depths may differ, in logarithms: */
static const double EXACT = 0.03;      /* exactly */
static const double FINE = 0.025;      /* step of a fine search */
static const double AGREE = 0.5;       /* of the points that others' depths tell; of one photo's: */
static const double AGREE_ONE = 0.3, LEAST_SEEN = 0.1; /* the latter: hidden ones, too */
static const double LARGER = 1.5;                      /* than this a unit differs from another */
static const double MORE = 2; /* times as many in another unit than in the given one; by the ray: */
static const double MORE_BY_RAY = 1.1;
/* Trust of depths beside alpha, which tells most of an object's shape: more costs colours. */
static const float TRUST_BESIDE_ALPHA = 0.25f;
static const double SHAPE = 0.03; /* by which a depth image's may differ from its photo's */

/* Depths at a grid of an image's pixels; 0 where none is known. */
typedef struct grid {
    int width, height, step; /* of the image; the grid begins at step / 2 */
    int columns, rows;
    float *z;      /* [rows][columns], scene units; NULL: there is no such image */
    uint8_t *even; /* [rows][columns] 1: those around are alike */
} grid;

typedef struct pixels {
    int width, height;
    bool deep;
    uint16_t *values; /* [height][width]; NULL: there are none */
} pixels;

/* A file that is not there, or cannot be read, is none. */
static cln_status read_pixels(const char *file, pixels *out)
{
    cln_status st = CLN_OK;

    *out = (pixels){0};
    if (!file || !cln_is_file(file))
        return CLN_OK;
    st = cln_image_load_grey(file, &out->width, &out->height, &out->deep, &out->values);
    if (st != CLN_INPUT)
        return st;
    cln_clear_error();
    return CLN_OK;
}

/* Are the depths around pixel (x, y) like its own? At edges a coarser pixel sees both sides, and
 * sensors neither. */
static bool is_even(const pixels *depth, int x, int y, int around)
{
    const double value = depth->values[(size_t)y * (size_t)depth->width + (size_t)x];
    int all = 0, alike = 0;

    for (int j = y - around; j <= y + around; j++)
        for (int i = x - around; i <= x + around; i++) {
            double there = 0;

            if (i < 0 || j < 0 || i >= depth->width || j >= depth->height)
                continue;
            there = depth->values[(size_t)j * (size_t)depth->width + (size_t)i];
            all++;
            alike += there > 0 && there < UNKNOWN && fabs(there - value) <= SMOOTH * value + 1;
        }
    return alike >= MOST_ALIKE * all;
}

/* wide: the photo's width, as it is learnt. */
static cln_status read_grid(const cln_depth_image *image, int across, int wide, grid *out)
{
    cln_status st = CLN_OK;
    pixels depth = {0}, sure = {0};
    int around = 1;

    *out = (grid){0};
    CLN_TRY(read_pixels(image->depth, &depth));
    if (!depth.values || !depth.deep)
        goto done;
    CLN_TRY(read_pixels(image->confidence, &sure));
    if (sure.width != depth.width || sure.height != depth.height) {
        free(sure.values);
        sure.values = NULL;
    }
    around = (depth.width + wide - 1) / wide;
    out->width = depth.width;
    out->height = depth.height;
    out->step = (depth.width > depth.height ? depth.width : depth.height) / across;
    out->step = out->step > 1 ? out->step : 1;
    out->columns = (depth.width - out->step / 2 + out->step - 1) / out->step;
    out->rows = (depth.height - out->step / 2 + out->step - 1) / out->step;
    CLN_TRY(cln_alloc(&out->z, (size_t)out->columns * (size_t)out->rows, sizeof *out->z,
                      "a depth image"));
    CLN_TRY(cln_alloc(&out->even, (size_t)out->columns * (size_t)out->rows, 1, "a depth image"));
    for (int cell = 0; cell < out->columns * out->rows; cell++) {
        const int x = out->step / 2 + cell % out->columns * out->step;
        const int y = out->step / 2 + cell / out->columns * out->step;
        const size_t at = (size_t)y * (size_t)depth.width + (size_t)x;
        const double z = depth.values[at] * image->unit;

        if (!(z > 0 && z <= image->most && isfinite(z)) || depth.values[at] == UNKNOWN ||
            (sure.values && sure.values[at] < SURE))
            continue;
        out->z[cell] = (float)z;
        out->even[cell] = is_even(&depth, x, y, around);
    }
done:
    free(depth.values);
    free(sure.values);
    return st;
}

/* The place in the photo of a cell, in shares of its sides. */
static double across_of(const grid *g, int i)
{
    return (g->step / 2 + i * g->step + 0.5) / g->width;
}

static double down_of(const grid *g, int j)
{
    return (g->step / 2 + j * g->step + 0.5) / g->height;
}

/* Origin of the ray of pixel (u, v), and its direction for a depth of 1; false if it has none. */
static bool ray_of(const cln_camera *camera, double u, double v, double o[3], double d[3])
{
    double along = 0;

    if (!cln_camera_ray(camera, u, v, o, d))
        return false;
    for (int a = 0; a < 3; a++)
        along += d[a] * camera->c2w[4 * a + 2];
    if (!(along > STEEPEST) || !isfinite(o[0] + o[1] + o[2])) /* poses are checked later */
        return false;
    for (int a = 0; a < 3; a++)
        d[a] /= along;
    return true;
}

/* ---- where the scene is ---- */

cln_status cln_dataset_depth_points(const cln_view *view, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &view->camera;
    grid g = {0};

    if (!view->depth.depth || !cln_is_file(view->depth.depth))
        return CLN_OK;
    result->depth_images++;
    if (c->width >= 1 && c->height >= 1)
        CLN_TRY(read_grid(&view->depth, ACROSS, c->width, &g));
    for (int at = 0; g.z && at < g.columns * g.rows; at++) {
        double o[3], d[3];
        cln_point *point = NULL;

        if (!(g.z[at] > 0) || !ray_of(c, across_of(&g, at % g.columns) * c->width,
                                      down_of(&g, at / g.columns) * c->height, o, d))
            continue;
        CLN_TRY(cln_grow(&result->points, result->point_count, sizeof *point,
                         "points of depth images"));
        point = &result->points[result->point_count++];
        *point = (cln_point){0};
        result->depth_points = true;
        for (int a = 0; a < 3; a++)
            point->xyz[a] = o[a] + d[a] * (double)g.z[at];
    }
done:
    free(g.z);
    free(g.even);
    return st;
}

void cln_dataset_tell_depths(const char *where, const cln_reader_result *result)
{
    if (result->depth_images > 0 && !result->depth_points)
        cln_info(
            "%s: its depth images tell nothing of where the scene is: none of the %d that were "
            "looked at is a grey PNG of 16 bits with depths that are known and sure",
            where, result->depth_images);
}

/* ---- depths of pixels ---- */

/* A cell's ray, from the camera on, for a depth of 1. */
typedef struct ray {
    double o[3], d[3], cosine; /* of the ray to the axis; 0: there is no ray, or no depth */
} ray;

typedef struct depths {
    const cln_scene *scene;
    int count;   /* training views with a depth image */
    int *view;   /* [count] */
    grid *grids; /* [count] */
    ray **rays;  /* [count][cells]: of the cells that are compared */
    int shapes;  /* images of another shape than their photo's, which are not used */
    int none;    /* those that are no such images */
} depths;

/* Pixel (u, v) of a cell, at the size that is trained on. */
static void pixel_of(const depths *d, int k, int at, double *u, double *v)
{
    const cln_view *view = &d->scene->views[d->view[k]];
    const grid *g = &d->grids[k];

    *u = across_of(g, at % g->columns) * view->file_width / view->downscale;
    *v = down_of(g, at / g->columns) * view->file_height / view->downscale;
}

/* The cell that holds pixel (u, v); -1: none with a depth. */
static int cell_at(const depths *d, int k, double u, double v)
{
    const cln_view *view = &d->scene->views[d->view[k]];
    const grid *g = &d->grids[k];
    const int i = (int)(u * view->downscale / view->file_width * g->width / g->step);
    const int j = (int)(v * view->downscale / view->file_height * g->height / g->step);

    return i < 0 || j < 0 || i >= g->columns || j >= g->rows || !(g->z[j * g->columns + i] > 0)
               ? -1
               : j * g->columns + i;
}

static int stride_of(const grid *g)
{
    return 1 + g->columns * g->rows / POINTS;
}

static cln_status find_rays(depths *d)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&d->rays, (size_t)d->count, sizeof *d->rays, "depth images"));
    for (int k = 0; k < d->count; k++) {
        const grid *g = &d->grids[k];
        const cln_camera *c = &d->scene->views[d->view[k]].camera;

        if (!g->z)
            continue;
        CLN_TRY(cln_alloc(&d->rays[k], (size_t)g->columns * (size_t)g->rows, sizeof **d->rays,
                          "depth images"));
        for (int at = 0; at < g->columns * g->rows; at++) {
            ray *r = &d->rays[k][at];
            double u = 0, v = 0;

            pixel_of(d, k, at, &u, &v);
            if (g->z[at] > 0 && ray_of(c, u, v, r->o, r->d))
                r->cosine = 1 / sqrt(r->d[0] * r->d[0] + r->d[1] * r->d[1] + r->d[2] * r->d[2]);
        }
    }
done:
    return st;
}

/* How depths are read: times `factor`, along the ray or along the axis. */
typedef struct reading {
    double factor;
    bool by_ray;
} reading;

/* Points of photos whose places other photos' depths tell: they show a surface there, or see
 * through the point. What is hidden behind their surfaces they do not know. */
typedef struct agreement {
    reading as;
    int alike, exact, through, hidden;
} agreement;

static double share_of(const agreement *a)
{
    return a->alike ? (double)a->alike / (a->alike + a->through) : 0;
}

/* each: [count], of the pairs that a photo is in; NULL: not wanted. */
static void compare(const depths *d, int a, int b, agreement *out, agreement *each)
{
    const cln_camera *to = &d->scene->views[d->view[b]].camera;
    const grid *g = &d->grids[a];

    for (int at = 0; at < g->columns * g->rows; at += stride_of(g)) {
        const ray *r = &d->rays[a][at];
        const double z = out->as.factor * (double)g->z[at] * (out->as.by_ray ? r->cosine : 1);
        double u = 0, v = 0, far = 0, off = 0, point[3];
        int cell = 0;

        if (r->cosine == 0)
            continue;
        for (int c = 0; c < 3; c++)
            point[c] = r->o[c] + r->d[c] * z;
        if (!cln_camera_shows(to, point, &u, &v) || !cln_camera_project(to, point, &u, &v, &far))
            continue;
        cell = cell_at(d, b, u, v);
        if (cell < 0 || d->rays[b][cell].cosine == 0)
            continue;
        off = log(far / (out->as.factor * (double)d->grids[b].z[cell] *
                         (out->as.by_ray ? d->rays[b][cell].cosine : 1)));
        out->alike += fabs(off) < ALIKE;
        out->exact += fabs(off) < EXACT;
        out->through += off <= -ALIKE;
        for (int side = 0; each && side < 2; side++) {
            each[side ? a : b].alike += fabs(off) < ALIKE;
            each[side ? a : b].through += off <= -ALIKE;
            each[side ? a : b].hidden += off >= ALIKE;
        }
    }
}

static agreement agree(const depths *d, reading as, agreement *each)
{
    static const int steps[OTHERS] = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};
    agreement out = {.as = as};
    const int most = each ? d->count : COMPARED;

    for (int i = 0; i < most && i < d->count; i++) {
        const int a = d->count <= most ? i : (int)((int64_t)i * d->count / most);

        for (int k = 0; k < OTHERS && steps[k] < d->count; k++)
            if (d->grids[a].z && d->grids[(a + steps[k]) % d->count].z)
                compare(d, a, (a + steps[k]) % d->count, &out, each);
    }
    return out;
}

/* The unit in which most points are alike: by large steps, then by small ones, exactly. */
static cln_status find_unit(const depths *d, const cln_callbacks *callbacks, agreement *best)
{
    cln_status st = CLN_OK;
    agreement coarse = {.as = {.factor = 1}};

    for (int k = -DECADES * STEPS; k <= DECADES * STEPS; k++) {
        const agreement other = agree(d, (reading){pow(10, (double)k / STEPS), false}, NULL);

        CLN_TRY(cln_tell_work(callbacks, NULL, 0, 0));
        if (other.alike > coarse.alike && share_of(&other) >= AGREE)
            coarse = other;
    }
    *best = coarse;
    for (int k = -FINE_STEPS; k <= FINE_STEPS && coarse.alike > 0; k++) {
        const agreement other = agree(d, (reading){coarse.as.factor * exp(FINE * k), false}, NULL);

        CLN_TRY(cln_tell_work(callbacks, NULL, 0, 0));
        if (other.exact > best->exact && share_of(&other) >= AGREE)
            *best = other;
    }
done:
    return st;
}

/* Do depths fit each other from photo to photo? Says so if they do not; cube: that they do not tell
 * where the scene is, either. Where few photos show the same, that cannot be told, and they are
 * believed. */
static cln_status fit(const depths *d, bool cube, const cln_callbacks *callbacks, bool *is)
{
    cln_status st = CLN_OK;
    const char *folder = d->scene->folder, *also = cube ? ", neither for the cube" : "";
    const agreement given = agree(d, (reading){1, false}, NULL);
    const agreement by_ray = agree(d, (reading){1, true}, NULL);
    agreement best = given;

    *is = false;
    if (by_ray.alike >= LEAST_ALIKE && share_of(&by_ray) >= AGREE &&
        by_ray.exact > MORE_BY_RAY * given.exact && by_ray.alike > MORE_BY_RAY * given.alike) {
        cln_warn("%s: depth images are not used%s: they are along the ray (of their points, %d lie "
                 "where another one has them by the poses, %d if they were along the axis), and "
                 "must be along the optical axis: multiply each by its ray's cosine to the axis",
                 folder, also, by_ray.alike, given.alike);
        goto done;
    }
    if (given.alike >= LEAST_ALIKE && share_of(&given) >= AGREE) {
        *is = true;
        goto done;
    }
    CLN_TRY(find_unit(d, callbacks, &best));
    if (best.alike >= LEAST_ALIKE && best.alike > MORE * given.alike &&
        fabs(log(best.as.factor)) > log(LARGER))
        cln_warn("%s: depth images are not used%s: of their points, %d lie where another one has "
                 "them by the poses, and %d if depths are %.3g times as large: correct their unit "
                 "(depth_unit_scale_factor, integer_depth_scale)",
                 folder, also, given.alike, best.alike, best.as.factor);
    else if (given.alike + given.through >= LEAST_ALIKE && share_of(&given) < AGREE)
        cln_warn("%s: depth images are not used%s: of %d of their points another one shows that "
                 "there is nothing, by the poses, and %d alone lie where it has them. Likely they "
                 "are guessed from single photos, or of other photos",
                 folder, also, given.through, given.alike);
    else
        *is = true;
done:
    return st;
}

/* Leaves out the depths of photos that do not fit the others'; they are named. */
static cln_status leave_odd_out(depths *d)
{
    cln_status st = CLN_OK;
    agreement *each = NULL;
    cln_listed odd = {0};

    CLN_TRY(cln_alloc(&each, (size_t)d->count, sizeof *each, "depth images"));
    (void)agree(d, (reading){1, false}, each);
    for (int k = 0; k < d->count; k++) {
        const int alike = each[k].alike, told = alike + each[k].through;
        const int all = told + each[k].hidden;

        if (!(told >= LEAST_OF_ONE && share_of(&each[k]) < AGREE_ONE) &&
            !(all >= LEAST_OF_ONE && alike < LEAST_SEEN * all))
            continue;
        free(d->grids[k].z);
        d->grids[k].z = NULL;
        cln_listed_add(&odd, 3, "'%s'", d->scene->views[d->view[k]].name);
    }
    if (odd.count)
        cln_warn("%s: the depth image%s of %d of %d photos %s not used, as %s not fit the others' "
                 "by the poses: %s",
                 d->scene->folder, cln_plural(odd.count, "", "s"), odd.count, d->count,
                 cln_plural(odd.count, "is", "are"), cln_plural(odd.count, "it does", "they do"),
                 odd.text);
done:
    free(each);
    return st;
}

static cln_status add_sights(const depths *d, cln_scene *scene)
{
    cln_status st = CLN_OK;
    int64_t most = scene->sight_count;
    cln_sight *sights = NULL;

    for (int k = 0; k < d->count; k++)
        most += d->grids[k].z ? (int64_t)d->grids[k].columns * d->grids[k].rows : 0;
    CLN_TRY(cln_alloc(&sights, (size_t)most, sizeof *sights, "depths of pixels"));
    if (scene->sight_count)
        memcpy(sights, scene->sights, (size_t)scene->sight_count * sizeof *sights);
    free(scene->sights);
    scene->sights = sights;
    for (int k = 0; k < d->count; k++) {
        const grid *g = &d->grids[k];
        const cln_camera *c = &scene->views[d->view[k]].camera;

        for (int at = 0; g->z && at < g->columns * g->rows; at++) {
            const ray *r = &d->rays[k][at];
            cln_sight *s = &sights[scene->sight_count];
            double u = 0, v = 0;

            pixel_of(d, k, at, &u, &v);
            if (r->cosine == 0 || !g->even[at] || u >= c->width || v >= c->height)
                continue;
            *s = (cln_sight){.view = d->view[k],
                             .x = (int)u,
                             .y = (int)v,
                             .z = g->z[at],
                             .trust = scene->has_alpha ? TRUST_BESIDE_ALPHA : 1};
            for (int a = 0; a < 3; a++)
                s->point[a] = r->o[a] + r->d[a] * (double)g->z[at];
            scene->sight_count++;
            scene->depth_sights++;
        }
    }
done:
    return st;
}

static bool has_shape_of(const grid *g, const cln_view *view)
{
    return fabs(log((double)g->width * view->file_height / g->height / view->file_width)) < SHAPE;
}

/* Reads the depth images of at most so many training views, evenly chosen, at a grid of so many
 * pixels along the longer side. */
static cln_status read_grids(cln_scene *scene, int most, depths *d)
{
    cln_status st = CLN_OK;
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int all = 0, across = SIGHTS;

    *d = (depths){.scene = scene};
    CLN_TRY(cln_alloc(&d->view, (size_t)count, sizeof *d->view, "depth images"));
    for (int i = 0; i < count; i++) {
        const int view = cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i);

        /* as stored: a photo that EXIF data turn has none that fits */
        if (scene->views[view].depth.depth &&
            !(scene->views[view].turned && scene->views[view].orientation > 1))
            d->view[all++] = view;
    }
    d->count = all < most ? all : most;
    for (int k = 0; k < d->count; k++)
        d->view[k] = d->view[(int64_t)k * all / d->count];
    while (across > 1 && 2.0 * d->count * across * across > SIGHTS_MOST)
        across--;
    CLN_TRY(cln_alloc(&d->grids, (size_t)d->count, sizeof *d->grids, "depth images"));
    for (int k = 0; k < d->count; k++) {
        const cln_view *view = &scene->views[d->view[k]];
        grid *g = &d->grids[k];

        CLN_TRY(read_grid(&view->depth, across, view->camera.width, g));
        d->none += !g->z;
        if (g->z && !has_shape_of(g, view)) {
            d->shapes++;
            free(g->z);
            g->z = NULL;
        }
    }
    CLN_TRY(find_rays(d));
done:
    return st;
}

static void free_depths(depths *d)
{
    for (int k = 0; d->grids && k < d->count; k++) {
        free(d->grids[k].z);
        free(d->grids[k].even);
    }
    for (int k = 0; d->rays && k < d->count; k++)
        free(d->rays[k]);
    free(d->grids);
    free(d->rays);
    free(d->view);
}

/* Tells of depth images that cannot be used at all. */
static void tell_unusable(const depths *d)
{
    if (d->shapes)
        cln_warn("%s: %d of %d depth images have another shape than their photos, and are not "
                 "used: bring them to the photos' view first (align them to colour)",
                 d->scene->folder, d->shapes, d->count);
    if (d->none == d->count)
        cln_info("%s: its depth images are not learnt from: none of the %d that were looked at is "
                 "there as a grey PNG of 16 bits",
                 d->scene->folder, d->count);
}

cln_status cln_scene_check_depths(cln_scene *scene, cln_reader_result *result,
                                  const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    depths d = {0};

    CLN_TRY(read_grids(scene, CLN_DEPTH_PHOTOS, &d));
    if (d.count == 0)
        goto done;
    tell_unusable(&d);
    CLN_TRY(fit(&d, result->depth_points, callbacks, &scene->depths_fit));
    /* behind what alpha cuts out they show what is around it */
    if (result->depth_points && (!scene->depths_fit || scene->has_alpha || d.shapes == d.count)) {
        result->point_count = 0;
        result->depth_points = false;
    }
done:
    free_depths(&d);
    return st;
}

cln_status cln_scene_depth_sights(cln_scene *scene)
{
    cln_status st = CLN_OK;
    depths d = {0};

    if (!scene->depths_fit)
        return CLN_OK;
    CLN_TRY(read_grids(scene, INT_MAX, &d));
    CLN_TRY(leave_odd_out(&d));
    CLN_TRY(add_sights(&d, scene));
done:
    free_depths(&d);
    return st;
}
