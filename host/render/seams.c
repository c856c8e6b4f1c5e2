/* Pairs of points across faces and inside leaves. See seams.h. */
#include "render/seams.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/memory.h"
#include "base/number.h"
#include "pipeline/field.h"
#include "render/view.h"

enum {
    MOST_VIEWS = 16,       /* training views, evenly chosen */
    MOST_PIXELS = 1 << 18, /* of all these views */
};

/* In sides of the leaf: distance between the points of a pair; a point nearer than NEAR to a face
 * is moved onto it; one farther than INSIDE from every face is inside. */
static const double STEP = 1.0 / 64, NEAR = 1.0 / 32, INSIDE = 1.0 / 8;

enum { ACROSS, WITHIN, KINDS };

/* Pairs: points 2 i and 2 i + 1. */
typedef struct pairs {
    int count, most;
    uint8_t *kind;        /* [pair] */
    float *length;        /* [pair] of the ray, for its alpha */
    float (*position)[4]; /* [pair][2] */
    float (*direction)[4];
    float (*field)[4];
} pairs;

static void free_pairs(pairs *a)
{
    free(a->kind);
    free(a->length);
    free(a->position);
    free(a->direction);
    free(a->field);
}

static cln_status make_room(int most, pairs *a)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)most;

    a->most = most;
    CLN_TRY(cln_alloc(&a->kind, n, sizeof *a->kind, "seams"));
    CLN_TRY(cln_alloc(&a->length, n, sizeof *a->length, "seams"));
    CLN_TRY(cln_alloc(&a->position, 2 * n, sizeof *a->position, "seams"));
    CLN_TRY(cln_alloc(&a->direction, 2 * n, sizeof *a->direction, "seams"));
    CLN_TRY(cln_alloc(&a->field, 2 * n, sizeof *a->field, "seams"));
done:
    return st;
}

/* Adds the pair at a surface point of the cube, seen along `direction`: across the face that is
 * very near, or, if all faces are far, inside the leaf along the axis of the nearest face. */
static void add_pair(const cln_model *model, const double point[3], const double direction[3],
                     pairs *a)
{
    const cln_octree *tree = &model->tree;
    const int slot = cln_octree_find(tree, point);
    double nearest = INFINITY, face = 0, middle[3], end[2][3], length = 0;
    float box[4];
    int axis = 0, kind = WITHIN, other = slot;

    if (slot < 0 || a->count == a->most)
        return;
    cln_octree_box(tree, tree->leaf[slot], box);
    for (int k = 0; k < 6; k++) {
        const double at = (double)box[k / 2] + (k % 2 ? (double)box[3] : 0);
        const double away = fabs(point[k / 2] - at) / (double)box[3];

        if (away < nearest) {
            nearest = away;
            axis = k / 2;
            face = at;
        }
    }
    if (nearest >= NEAR && nearest <= INSIDE)
        return;
    memcpy(middle, point, sizeof middle);
    if (nearest < NEAR) {
        kind = ACROSS;
        middle[axis] = face;
    }
    length = (double)box[3];
    for (int i = 0; i < 2; i++) {
        memcpy(end[i], middle, sizeof middle);
        end[i][axis] += (i ? 0.5 : -0.5) * STEP * (double)box[3];
    }
    if (kind == ACROSS) {
        const int below = cln_octree_find(tree, end[0]), above = cln_octree_find(tree, end[1]);

        other = below == slot ? above : below;
        if (below < 0 || above < 0 || below == above)
            return; /* nothing, or the same leaf, on the other side */
        cln_octree_box(tree, tree->leaf[other], box);
        length = fmin(length, (double)box[3]);
    }
    a->kind[a->count] = (uint8_t)kind;
    a->length[a->count] = (float)(length / model->config.n1);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            a->position[2 * a->count + i][k] = (float)end[i][k];
            a->direction[2 * a->count + i][k] = (float)direction[k];
        }
    a->count++;
}

static void add_view(const cln_model *model, const cln_camera *camera, const cln_picture *picture,
                     int stride, pairs *a)
{
    for (int y = stride / 2; y < picture->height; y += stride)
        for (int x = stride / 2; x < picture->width; x += stride) {
            const size_t i = (size_t)y * (size_t)picture->width + (size_t)x;
            double origin[3], look[3], point[3], scene[3], direction[3];

            if (!(picture->opacity[i] >= CLN_SURFACE) || !(picture->depth[i] > 0) ||
                !cln_camera_ray(camera, x + 0.5, y + 0.5, origin, look))
                continue;
            cln_space_depth_to_cube(&model->space, origin, look, (double)picture->depth[i], point);
            cln_space_point_to_scene(&model->space, point, scene);
            memcpy(direction, look, sizeof direction);
            if (model->space.forward)
                cln_space_direction_to_cube(&model->space, scene, look, direction);
            add_pair(model, point, direction, a);
        }
}

/* Mean and 95th percentile of the values; NAN if there are none. Sorts them. */
static void summarise(double *values, int n, double *mean, double *most)
{
    double sum = 0;

    *mean = *most = NAN;
    if (n == 0)
        return;
    cln_reals_sort(values, n);
    for (int i = 0; i < n; i++)
        sum += values[i];
    *mean = sum / n;
    *most = values[(int)ceil(0.95 * n) - 1];
}

static cln_status summarise_pairs(const pairs *a, int kind, cln_eval_jump *out)
{
    cln_status st = CLN_OK;
    const size_t room = a->count > 0 ? (size_t)a->count : 1;
    double *colour = NULL, *alpha = NULL;

    CLN_TRY(cln_alloc(&colour, room, sizeof *colour, "seams"));
    CLN_TRY(cln_alloc(&alpha, room, sizeof *alpha, "seams"));
    for (int i = 0; i < a->count; i++) {
        const float *f = a->field[2 * i], *g = a->field[2 * i + 1];
        const double length = (double)a->length[i];
        double sum = 0;

        if (a->kind[i] != kind)
            continue;
        for (int k = 0; k < 3; k++)
            sum += fabs((double)f[k] - (double)g[k]) / 3;
        colour[out->pairs] = sum;
        alpha[out->pairs++] = fabs(exp(-(double)f[3] * length) - exp(-(double)g[3] * length));
    }
    summarise(colour, out->pairs, &out->colour, &out->colour_95);
    summarise(alpha, out->pairs, &out->alpha, &out->alpha_95);
done:
    free(colour);
    free(alpha);
    return st;
}

cln_status cln_seams_measure(cln_pipeline *p, const cln_model *model, const cln_scene *scene,
                             const cln_callbacks *callbacks, cln_eval_seams *out)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const int count = views < MOST_VIEWS ? views : MOST_VIEWS,
              stride = cln_scene_spread_stride(scene, CLN_SPLIT_TRAIN, count, MOST_PIXELS);
    pairs all = {0};

    memset(out, 0, sizeof *out);
    /* a stride rounds up: no more pixels than this */
    CLN_TRY(make_room(MOST_PIXELS + MOST_PIXELS / 8 + 4096, &all));
    CLN_TRY(cln_render_prepare(p));
    for (int i = 0; i < count; i++) {
        const int view = cln_scene_spread_view(scene, CLN_SPLIT_TRAIN, i, count);
        cln_picture picture = {0};

        st = cln_render_view(p, view, model->background, CLN_DEPTH_MEDIAN, callbacks, &picture);
        if (st == CLN_OK)
            add_view(model, &scene->views[view].camera, &picture, stride, &all);
        cln_picture_free(&picture);
        CLN_TRY(st);
        cln_show_work(callbacks, "seams", i + 1, count);
    }
    CLN_TRY(cln_field_points(p, &model->tree, 2 * (size_t)all.count,
                             (const float(*)[4])all.position, (const float(*)[4])all.direction,
                             all.field));
    CLN_TRY(summarise_pairs(&all, ACROSS, &out->across));
    CLN_TRY(summarise_pairs(&all, WITHIN, &out->inside));
    out->measured = true;
done:
    cln_render_release(p);
    free_pairs(&all);
    return st;
}
