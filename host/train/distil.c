/* Distils merged leaves. See distil.h. Points are stratified in the new leaf's box; directions come
 * from training cameras that see it. Both are functions of seed, step and node, so they are made
 * twice, for some leaves at a time, and only their targets are kept between. */
#include "train/distil.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "pipeline/field.h"
#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "pipeline/stretch.h"
#include "ranks/ranks.h"
#include "train/plans.h"

enum { DIRECTIONS = 8, TRIES = 64, CHECK_EVERY = 25, ASKED = 65536 };

void cln_distil_free(cln_distil *d)
{
    free(d->nodes);
    free(d->targets);
    free(d->lengths);
    memset(d, 0, sizeof *d);
}

/* ---- points and directions ---- */

/* Points of some merged leaves. */
typedef struct points {
    float (*origins)[4], (*directions)[4]; /* [net][point] */
} points;

static cln_status create_points(const cln_distil *d, int nets, points *out)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)nets * (size_t)d->pool;

    CLN_TRY(cln_alloc(&out->origins, count, sizeof *out->origins, "points of merges"));
    CLN_TRY(cln_alloc(&out->directions, count, sizeof *out->directions, "points of merges"));
done:
    return st;
}

static void free_points(points *p)
{
    free(p->origins);
    free(p->directions);
}

void cln_distil_counter(int32_t node, uint32_t index, uint32_t what, uint32_t counter[2])
{
    const uint32_t n = (uint32_t)node;

    CLN_ASSERT(node >= 0 && what < 8 && index < 16u * 65536u);
    counter[0] = n << 16 | (index & 0xFFFF);
    counter[1] = n >> 16 << 7 | index >> 16 << 3 | what; /* at most 22 bits */
}

static void draw(const cln_trainer *t, int32_t node, uint32_t index, uint32_t what, float out[4])
{
    uint32_t counter[2];

    cln_distil_counter(node, index, what, counter);
    cln_uniform4((uint64_t)t->model.config.seed, CLN_STREAM_DISTIL, (uint32_t)t->model.step,
                 counter[0], counter[1], out);
}

/* Brings a point of the cube to the coordinates of the device's cameras: the cube's, or camera
 * units. */
static void place(const cln_trainer *t, const float cube[3], float out[3])
{
    const cln_space *space = &t->pipeline.space;
    const double point[3] = {cube[0], cube[1], cube[2]};
    double q[4];

    memmove(out, cube, 3 * sizeof *out); /* they may be one */
    if (space->shell) {
        cln_space_point_to_u(point, q);
        for (int a = 0; a < 3; a++)
            out[a] = (float)q[a];
    }
    if (!space->forward)
        return;
    cln_space_point_to_view(space, point, q);
    for (int a = 0; a < 3; a++)
        out[a] = (float)(q[a] / fmax(q[3], 1e-6));
}

/* Returns whether the point is in front of the camera and inside its image, as a pinhole. */
static bool sees(const cln_device_camera *c, const float point[3])
{
    float local[3] = {c->start * c->start_x, c->start * c->start_y, c->start}, u, v;

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            local[k] += c->c2w[4 * a + k] * (point[a] - c->c2w[4 * a + 3]);
    if (!(local[2] > 0))
        return false;
    u = c->fx * local[0] / local[2] + c->cx;
    v = c->fy * local[1] / local[2] + c->cy;
    return u >= 0 && v >= 0 && u < (float)c->width && v < (float)c->height;
}

/* Draws training views that see the centre of the box, up to DIRECTIONS; returns how many. */
static int choose_views(const cln_trainer *t, int32_t node, const float box[4],
                        int views[DIRECTIONS])
{
    const cln_pipeline *p = &t->pipeline;
    float centre[3], u[4];
    int count = 0;

    for (int a = 0; a < 3; a++)
        centre[a] = box[a] + 0.5f * box[3];
    place(t, centre, centre);
    for (uint32_t i = 0; i < TRIES && count < DIRECTIONS; i++) {
        int view = 0;

        draw(t, node, i, 1, u);
        view = (int)(u[0] * (float)p->training_views);
        view = view < p->training_views ? view : p->training_views - 1;
        if (sees(&p->host_cameras[view], centre))
            views[count++] = view;
    }
    return count;
}

/* Turns a direction at a point, both in camera units, into one of the cube. */
static void bend(const cln_space *space, const float at[3], float d[3])
{
    for (int a = 0; a < 2; a++)
        d[a] = (float)space->scale[a] * (d[a] * at[2] - at[a] * d[2]);
    d[2] *= 2;
}

/* The same in a shell space, both in half sides of the core from its centre. */
static void bend_in_shell(const cln_space *space, const float at[3], float d[3])
{
    double scene[3], along[3];

    for (int a = 0; a < 3; a++) {
        scene[a] = space->centre[a] + space->half * (double)at[a];
        along[a] = d[a];
    }
    cln_space_direction_to_cube(space, scene, along, along);
    for (int a = 0; a < 3; a++)
        d[a] = (float)along[a];
}

static void direct(const cln_trainer *t, int view, const float point[3], const float u[4],
                   float out[4])
{
    float length = 0;

    if (view >= 0) {
        double origin[3];
        float at[3];

        cln_device_camera_origin(&t->pipeline.host_cameras[view], origin);
        place(t, point, at);
        for (int a = 0; a < 3; a++)
            out[a] = (float)(at[a] - origin[a]);
        if (t->pipeline.space.forward)
            bend(&t->pipeline.space, at, out);
        if (t->pipeline.space.shell)
            bend_in_shell(&t->pipeline.space, at, out);
    } else { /* no view sees it: uniform on the sphere */
        const float z = 2 * u[0] - 1, r = sqrtf(fmaxf(1 - z * z, 0));

        out[0] = r * cosf(6.2831853f * u[1]);
        out[1] = r * sinf(6.2831853f * u[1]);
        out[2] = z;
    }
    for (int a = 0; a < 3; a++)
        length += out[a] * out[a];
    length = sqrtf(length);
    for (int a = 0; a < 3; a++)
        out[a] = length > 0 ? out[a] / length : a == 2;
    out[3] = 1;
}

/* Makes the points of a leaf: [point]. */
static cln_status make_points(const cln_trainer *t, const cln_distil *d, int net,
                              float (*origins)[4], float (*directions)[4])
{
    cln_status st = CLN_OK;
    const int32_t node = d->nodes[net];
    const int cells = (int)floor(cbrt((double)d->pool) + 1e-9), full = cells * cells * cells;
    float box[4], u[4];
    int views[DIRECTIONS], view_count = 0, *order = NULL;

    cln_octree_box(&t->model.tree, node, box);
    view_count = choose_views(t, node, box, views);
    CLN_TRY(cln_alloc(&order, (size_t)d->pool, sizeof *order, "points of a merge"));
    for (int i = 0; i < d->pool; i++)
        order[i] = i;
    for (int i = d->pool - 1; i > 0; i--) { /* batches are runs of a shuffled order */
        int other = 0, kept = order[i];

        draw(t, node, (uint32_t)i, 2, u);
        other = (int)(u[0] * (float)(i + 1));
        other = other < i ? other : i;
        order[i] = order[other];
        order[other] = kept;
    }
    for (int i = 0; i < d->pool; i++) {
        const int cell = order[i];
        const int at[3] = {cell % cells, cell / cells % cells, cell / cells / cells};

        draw(t, node, (uint32_t)i, 3, u);
        for (int a = 0; a < 3; a++)
            origins[i][a] =
                box[a] + box[3] * (cell < full ? ((float)at[a] + u[a]) / (float)cells : u[a]);
        origins[i][3] = 0;
        draw(t, node, (uint32_t)i, 4, u);
        direct(t, view_count ? views[i % view_count] : -1, origins[i], u, directions[i]);
    }
done:
    free(order);
    return st;
}

/* Makes those of nets [first, end). */
static cln_status make_run(const cln_trainer *t, const cln_distil *d, int first, int end,
                           const points *out)
{
    cln_status st = CLN_OK;

    for (int n = first; n < end; n++) {
        const size_t at = (size_t)(n - first) * (size_t)d->pool;

        CLN_TRY(make_points(t, d, n, out->origins + at, out->directions + at));
    }
done:
    return st;
}

/* The same on all ranks, each of which makes some. */
static cln_status make_together(const cln_trainer *t, const cln_distil *d, int begin, int end,
                                const points *out)
{
    cln_status st = CLN_OK;
    const int ranks = cln_ranks_count();
    const size_t row = (size_t)d->pool * sizeof *out->origins;
    int first[CLN_RANKS_MOST + 1];
    points own = *out;

    for (int r = 0; r <= ranks; r++)
        first[r] = (int)((int64_t)(end - begin) * r / ranks);
    own.origins += (size_t)first[cln_ranks_me()] * (size_t)d->pool;
    own.directions += (size_t)first[cln_ranks_me()] * (size_t)d->pool;
    CLN_TRY(make_run(t, d, begin + first[cln_ranks_me()], begin + first[cln_ranks_me() + 1], &own));
    cln_ranks_gather(out->origins, row, first, true);
    cln_ranks_gather(out->directions, row, first, true);
done:
    return st;
}

/* ---- targets from the old leaves ---- */

/* Evaluates the targets of all points; 0 in culled octants. */
static cln_status ask(cln_trainer *t, cln_distil *d)
{
    cln_status st = CLN_OK;
    const int most = d->pool < ASKED ? ASKED / d->pool : 1;
    points p = {0};

    CLN_TRY(create_points(d, d->nets < most ? d->nets : most, &p));
    for (int first = 0, end = 0; first < d->nets; first = end) {
        const size_t base = (size_t)first * (size_t)d->pool;

        end = d->nets - first < most ? d->nets : first + most;
        CLN_TRY(make_together(t, d, first, end, &p));
        CLN_TRY(cln_field_points(
            &t->pipeline, &t->model.tree, (size_t)(end - first) * (size_t)d->pool,
            (const float(*)[4])p.origins, (const float(*)[4])p.directions, d->targets + base));
    }
    for (size_t i = 0; i < (size_t)d->nets * (size_t)d->pool; i++) {
        const double length = d->lengths[i / (size_t)d->pool];

        d->targets[i][3] = (float)-expm1(-d->targets[i][3] * length);
    }
done:
    free_points(&p);
    return st;
}

cln_status cln_distil_prepare(cln_trainer *t, const uint8_t *merge, cln_distil *out)
{
    cln_status st = CLN_OK;
    const cln_octree *tree = &t->model.tree;
    int32_t last = -1;

    memset(out, 0, sizeof *out);
    out->pool = CLN_DISTIL_BATCHES * t->model.config.distil_samples;
    CLN_TRY(cln_alloc(&out->nodes, (size_t)tree->leaf_count, sizeof *out->nodes, "merges"));
    for (int s = 0; s < tree->leaf_count; s++) { /* siblings that are all leaves are adjacent */
        const int32_t parent = merge[s] ? tree->parent[tree->leaf[s]] : -1;

        if (parent >= 0 && parent != last)
            out->nodes[out->nets++] = last = parent;
    }
    CLN_TRY(cln_alloc(&out->targets, (size_t)out->nets * (size_t)out->pool, sizeof *out->targets,
                      "points of merges"));
    CLN_TRY(cln_alloc(&out->lengths, (size_t)out->nets, sizeof *out->lengths, "merges"));
    for (int n = 0; n < out->nets; n++) {
        float box[4];

        cln_octree_box(tree, out->nodes[n], box);
        out->lengths[n] = sqrtf(3) * box[3] / 32;
    }
    CLN_TRY(ask(t, out));
done:
    if (st != CLN_OK)
        cln_distil_free(out);
    return st;
}

/* ---- training of the new ones ---- */

/* The row of a merged leaf; -1 if another rank has it. */
static int row_of(const cln_trainer *t, const cln_distil *d, int net)
{
    return cln_share_row(&t->pipeline, t->model.tree.slot[d->nodes[net]]);
}

/* The largest mean loss of nets [first, first + nets) in the batch just trained, on all ranks. */
static cln_status worst_loss(cln_trainer *t, const cln_distil *d, int first, int nets,
                             float *losses, double *worst)
{
    cln_status st = CLN_OK;
    const int samples = t->model.config.distil_samples;
    const size_t n = (size_t)nets * (size_t)samples;

    *worst = 0;
    if (n > 0)
        CLN_TRY(cln_buffer_read(t->device, &t->pipeline.losses, 0, losses, n * sizeof *losses));
    for (int k = 0; k < nets; k++) {
        double sum = 0;

        if (row_of(t, d, first + k) < 0)
            continue;
        for (int i = 0; i < samples; i++)
            sum += losses[(size_t)k * (size_t)samples + (size_t)i];
        *worst = fmax(*worst, sum / samples);
    }
    cln_ranks_largest(worst, 1);
done:
    return st;
}

/* One step of the samples in `batch`, whose points are on the device. */
static cln_status train_batch(cln_trainer *t, const cln_sample *batch, uint32_t n, uint32_t key)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    cln_pipeline *p = &t->pipeline;
    uint32_t slices = 0;

    CLN_TRY(cln_pipeline_samples(p, batch, n));
    p->stretched = true; /* no rank needs what others have */
    CLN_TRY(cln_stage_group(p, n, &slices));
    CLN_TRY(cln_stage_forward(p, n, slices, true, key));
    CLN_TRY(cln_stage_distil_gradient(p, n, 1.0 / c->distil_samples));
    CLN_TRY(cln_stage_update(p, n, slices, 1, key, c->distil_lr));
    CLN_TRY(cln_device_finish(p->device));
done:
    return st;
}

/* Trains nets [first, end) together, none of them if another rank has more; *steps becomes at least
 * the steps done. */
static cln_status train_chunk(cln_trainer *t, const cln_distil *d, int first, int end, int *steps)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int samples = c->distil_samples;
    const uint32_t n = (uint32_t)((end - first) * samples);
    cln_sample *batch = NULL;
    float *losses = NULL;
    points p = {0};
    double worst = 0;
    int done_steps = 0;

    CLN_TRY(cln_alloc(&batch, n, sizeof *batch, "samples of merges"));
    CLN_TRY(cln_alloc(&losses, n, sizeof *losses, "samples of merges"));
    if (n > 0) {
        CLN_TRY(create_points(d, end - first, &p));
        CLN_TRY(make_run(t, d, first, end, &p));
        CLN_TRY(cln_pipeline_points(&t->pipeline, p.origins[0], p.directions[0],
                                    d->targets[(size_t)first * (size_t)d->pool],
                                    (uint32_t)(end - first) * (uint32_t)d->pool));
    }
    while (done_steps < c->distil_steps) {
        const int part = done_steps % CLN_DISTIL_BATCHES;
        const uint32_t key = (uint32_t)done_steps * 0x9E3779B9u + (uint32_t)t->model.step;

        for (uint32_t i = 0; i < n; i++) {
            const int net = (int)i / samples;

            batch[i] =
                (cln_sample){.delta = d->lengths[first + net],
                             .ray = (cln_u32)(net * d->pool + part * samples + (int)i % samples),
                             .slot = t->model.tree.slot[d->nodes[first + net]]};
        }
        if (n > 0)
            CLN_TRY(train_batch(t, batch, n, key));
        done_steps++;
        if (done_steps % CHECK_EVERY == 0) {
            CLN_TRY(worst_loss(t, d, first, end - first, losses, &worst));
            if (worst < c->distil_stop)
                break;
        }
    }
    *steps = done_steps > *steps ? done_steps : *steps;
done:
    free_points(&p);
    free(batch);
    free(losses);
    return st;
}

/* Zeroes the new leaves' Adam state: distillation's gradients are not those of rays. */
static cln_status forget_moments(cln_trainer *t, const cln_distil *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const size_t bytes = (size_t)p->net.params * cln_moment_bytes(&p->config);
    const int32_t none = 0;
    char *zeros = NULL;

    CLN_TRY(cln_alloc(&zeros, bytes, 1, "Adam's state"));
    for (int n = 0; n < d->nets; n++) {
        const int row = row_of(t, d, n);
        const size_t at = (size_t)row;

        if (row < 0)
            continue;
        CLN_TRY(cln_buffer_write(p->device, &p->adam_m, at * bytes, zeros, bytes));
        CLN_TRY(cln_buffer_write(p->device, &p->adam_v, at * bytes, zeros, bytes));
        CLN_TRY(cln_buffer_write(p->device, &p->adam_steps, at * sizeof none, &none, sizeof none));
    }
done:
    free(zeros);
    return st;
}

cln_status cln_distil_train(cln_trainer *t, const cln_distil *d, int *steps)
{
    cln_status st = CLN_OK;
    const bool alone = cln_stretch_wanted(&t->pipeline);
    int first = 0, end = d->nets, most = 0;
    double *work = NULL, chunks = 0;
    int *lent = NULL;

    *steps = 0;
    CLN_TRY(cln_alloc(&work, (size_t)t->pipeline.leaves, sizeof *work, "merges"));
    for (int n = 0; n < d->nets; n++)
        work[t->model.tree.slot[d->nodes[n]]] = 1;
    CLN_TRY(cln_share_lend(&t->pipeline, work, &lent));
    if (lent)
        CLN_TRY(cln_plans_deal(t));
    most = t->plan.distil_nets; /* of the deal from now on */
    /* A rank goes only through its own nets, which are a run. By samples, its batches have the
     * samples of all, so that they are those of one process. */
    while (alone && first < end && row_of(t, d, first) < 0)
        first++;
    while (alone && first < end && row_of(t, d, end - 1) < 0)
        end--;
    chunks = (end - first + most - 1) / most;
    cln_ranks_largest(&chunks, 1);
    for (int k = 0; k < (int)chunks; k++) {
        const int to = end - first < most ? end : first + most;

        CLN_TRY(train_chunk(t, d, first, to, steps));
        first = to;
    }
    CLN_TRY(forget_moments(t, d));
    CLN_TRY(cln_share_return(&t->pipeline, lent));
done:
    free(work);
    free(lent);
    return st;
}
