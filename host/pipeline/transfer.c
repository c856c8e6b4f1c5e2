/* Brings tree, weights, cameras and batches to the pipeline's buffers, and weights and training
 * state back. */
#include "pipeline/share.h"
#include "pipeline/stage1.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "model/shell_tree.h"

cln_status cln_pipeline_derive(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->own;
    const cl_uint parts = (cl_uint)cln_groups((size_t)p->net.params, CLN_ADAM_PART);

    CLN_TRY(CLN_RESERVE(p, norms, leaves));
    CLN_TRY(CLN_RESERVE(p, transposed, leaves));
    if (!p->tune.leaf && cln_pipeline_transposed(&p->net) > 0)
        CLN_TRY(CLN_LAUNCH(p->device, p->k.transpose, CLN_STAGE_UPLOAD, leaves * parts,
                           (size_t)p->tune.ls, CLN_LEAF_ARG(p, params), CLN_LEAF_ARG(p, transposed),
                           CLN_ARG(parts)));
done:
    return st;
}

/* Uploads this rank's rows of an array that has a row for each leaf. */
static cln_status put_own(cln_pipeline *p, cln_buffer_id id, const void *array)
{
    const size_t row = cln_buffer_row_bytes(p, id);

    return cln_pipeline_put(p, id, (const char *)array + (size_t)p->first * row, (size_t)p->own);
}

cln_status cln_pipeline_around(cln_pipeline *p, const cln_octree *tree)
{
    cln_status st = CLN_OK;
    int32_t(*around)[CLN_AROUND] = NULL;

    if (!cln_leaf_kind_of(p->net.encoding)->joined)
        return CLN_OK;
    CLN_TRY(cln_octree_around(tree, &around));
    CLN_TRY(CLN_PUT(p, around, around, (size_t)tree->leaf_count));
    if (p->ranks > 1) { /* halo.c finds links with it */
        free(p->common.around);
        p->common.around = around;
        around = NULL;
    }
done:
    free(around);
    return st;
}

static cln_status upload_training(cln_pipeline *p, const cln_model *model)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves;

    CLN_TRY(put_own(p, CLN_BUFFER_adam_m, model->adam_m));
    CLN_TRY(put_own(p, CLN_BUFFER_adam_v, model->adam_v));
    CLN_TRY(CLN_PUT(p, decoder_m, model->decoder_m, 1));
    CLN_TRY(CLN_PUT(p, decoder_v, model->decoder_v, 1));
    CLN_TRY(put_own(p, CLN_BUFFER_adam_steps, model->adam_steps));
    if (cln_pipeline_measures(&p->config) > 0) {
        CLN_TRY(CLN_PUT(p, leaf_sums, model->sums, leaves));
        CLN_TRY(CLN_PUT(p, leaf_met, model->met, leaves));
    }
    cln_buffer_free(p->device, &p->grads); /* sized by the leaves of the batches so far */
    cln_buffer_free(p->device, &p->seen);  /* holds cells of the old leaves */
    CLN_TRY(cln_pipeline_around(p, &model->tree));
    CLN_TRY(cln_pipeline_derive(p));
done:
    return st;
}

cln_status cln_pipeline_tree(cln_pipeline *p, const cln_octree *tree)
{
    cln_status st = CLN_OK;
    float *boxes = NULL;
    int32_t *map = NULL;
    const size_t leaves = (size_t)tree->leaf_count;

    if (p->parts == 1 && cln_pipeline_in_parts(p, tree->leaf_count))
        return cln_fail(CLN_INTERNAL, "%zu leaves need parts: cln_pipeline_rebuild was not called",
                        leaves);
    p->leaves = (int)leaves;
    CLN_TRY(cln_share_begin(p));
    p->depth = cln_octree_depth(tree);
    p->leaf_levels = 0;
    for (size_t i = 0; i < leaves; i++)
        p->leaf_levels |= 1u << tree->level[tree->leaf[i]];
    if (p->space.shell)
        CLN_TRY(cln_shell_tree_most_intervals(tree, &p->most_intervals));
    else
        CLN_TRY(cln_octree_most_intervals(tree, &p->most_intervals));
    CLN_TRY(cln_octree_boxes(tree, &boxes));
    CLN_TRY(cln_octree_map(tree, p->depth, &map));
    CLN_TRY(CLN_PUT(p, boxes, boxes, leaves));
    CLN_TRY(CLN_PUT(p, map, map, (size_t)1 << (3 * p->depth)));
    CLN_TRY(CLN_RESERVE(p, begin, leaves));
    CLN_TRY(CLN_RESERVE(p, end, leaves));
    CLN_TRY(CLN_RESERVE(p, slice_counts, leaves));
    CLN_TRY(CLN_RESERVE(p, slice_starts, leaves + 1));
done:
    free(boxes);
    free(map);
    return st;
}

cln_status cln_pipeline_upload(cln_pipeline *p, const cln_model *model, bool training)
{
    cln_status st = CLN_OK;

    cln_share_evenly(p, model->tree.leaf_count);
    CLN_TRY(cln_pipeline_tree(p, &model->tree));
    CLN_TRY(put_own(p, CLN_BUFFER_params, model->params));
    CLN_TRY(CLN_PUT(p, decoder_w, model->decoder, 1));
    p->decodes = cln_decoder_adds(&model->net, model->decoder);
    if (model->density)
        CLN_TRY(CLN_PUT(p, density, model->density, (size_t)p->leaves));
    else if (training)
        CLN_TRY(CLN_RESERVE(p, density, (size_t)p->leaves));
    if (training)
        CLN_TRY(upload_training(p, model));
done:
    return st;
}

cln_status cln_pipeline_download_own(cln_pipeline *p, cln_model *model, bool training)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves;

    CLN_ASSERT(model->tree.leaf_count == p->leaves);
    CLN_TRY(cln_model_make_room(model, training));
    CLN_TRY(cln_share_get(p, CLN_BUFFER_params, model->params));
    CLN_TRY(CLN_GET(p, decoder_w, model->decoder, 1));
    if (training) {
        CLN_TRY(CLN_GET(p, decoder_m, model->decoder_m, 1));
        CLN_TRY(CLN_GET(p, decoder_v, model->decoder_v, 1));
        CLN_TRY(cln_share_get(p, CLN_BUFFER_adam_m, model->adam_m));
        CLN_TRY(cln_share_get(p, CLN_BUFFER_adam_v, model->adam_v));
        CLN_TRY(cln_share_get(p, CLN_BUFFER_adam_steps, model->adam_steps));
        CLN_TRY(CLN_GET(p, density, model->density, leaves));
        if (cln_pipeline_measures(&p->config) > 0) {
            CLN_TRY(cln_share_sums(p));
            CLN_TRY(CLN_GET(p, leaf_sums, model->sums, leaves));
            CLN_TRY(CLN_GET(p, leaf_met, model->met, leaves));
        }
    }
done:
    return st;
}

void cln_pipeline_collect(cln_pipeline *p, cln_model *model, bool training)
{
    cln_share_collect(p, CLN_BUFFER_params, model->params);
    if (training) {
        cln_share_collect(p, CLN_BUFFER_adam_m, model->adam_m);
        cln_share_collect(p, CLN_BUFFER_adam_v, model->adam_v);
        cln_share_collect(p, CLN_BUFFER_adam_steps, model->adam_steps);
    }
}

cln_status cln_pipeline_download(cln_pipeline *p, cln_model *model, bool training)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_download_own(p, model, training));
    cln_pipeline_collect(p, model, training);
done:
    return st;
}

/* Sets the start of a camera that is far away and sees the cube less than 60 degrees off its axis:
 * a plane in front of the cube, on which c2w's origin is the point towards the cube's centre. */
static void begin_near_cube(const double c2w[12], const cln_space *space, cln_device_camera *out)
{
    const double in_scene[3] = {c2w[3], c2w[7], c2w[11]};
    double o[3], centre[3] = {0, 0, 0}, distance = 0;

    cln_space_ray_to_cube(space, in_scene, in_scene, o, centre);
    memset(centre, 0, sizeof centre);
    for (int a = 0; a < 3; a++) {
        distance = hypot(distance, o[a]);
        for (int k = 0; k < 3; k++) /* the cube's centre in the camera's frame */
            centre[k] -= c2w[4 * a + k] * o[a];
    }
    if (!(distance > (double)CLN_FAR) || centre[2] < distance / 2)
        return;
    out->start = (float)(centre[2] - 2);
    out->start_x = (float)(centre[0] / centre[2]);
    out->start_y = (float)(centre[1] / centre[2]);
    for (int a = 0; a < 3; a++)
        out->c2w[4 * a + 3] =
            (float)(o[a] +
                    (double)out->start * (c2w[4 * a] * (double)out->start_x +
                                          c2w[4 * a + 1] * (double)out->start_y + c2w[4 * a + 2]));
}

static cln_device_camera in_cube(const cln_camera *c, const cln_space *space)
{
    cln_device_camera out = {.fx = (float)c->fx,
                             .fy = (float)c->fy,
                             .cx = (float)c->cx,
                             .cy = (float)c->cy,
                             .lens = (cln_i32)c->lens,
                             .limit = (float)cln_lens_limit(c->lens, c->distortion),
                             .width = c->width,
                             .height = c->height};

    for (int i = 0; i < CLN_LENS_PARAMS; i++)
        out.k[i] = (float)c->distortion[i];
    cln_space_pose_to_cube(space, c->c2w, out.c2w);
    if (c->parallel) { /* places are lengths */
        CLN_ASSERT(!space->forward);
        out.parallel = 1;
        out.fx *= (float)space->half;
        out.fy *= (float)space->half;
        return out;
    }
    /* a forward space's rays begin at the near plane; those of a shell space at the camera, as it
     * holds what is in between, too */
    if (!space->forward && !space->shell)
        begin_near_cube(c->c2w, space, &out);
    return out;
}

void cln_device_camera_origin(const cln_device_camera *c, double origin[3])
{
    for (int a = 0; a < 3; a++) {
        const float *row = c->c2w + 4 * a;

        origin[a] =
            row[3] - (double)c->start * ((double)row[0] * (double)c->start_x +
                                         (double)row[1] * (double)c->start_y + (double)row[2]);
    }
}

/* The same camera with n x n pixels for each pixel. */
static cln_device_camera finer(cln_device_camera c, int n)
{
    c.fx *= (float)n;
    c.fy *= (float)n;
    c.cx *= (float)n;
    c.cy *= (float)n;
    c.width *= n;
    c.height *= n;
    return c;
}

cln_status cln_pipeline_cameras(cln_pipeline *p, const cln_camera *const *cameras, int count,
                                const cln_space *space)
{
    cln_status st = CLN_OK;
    const size_t all = (size_t)count * (p->antialias > 1 ? 2 : 1);

    free(p->host_cameras);
    p->view_count = 0;
    CLN_TRY(cln_alloc(&p->host_cameras, all, sizeof *p->host_cameras, "cameras"));
    for (int i = 0; i < count; i++)
        p->host_cameras[i] = in_cube(cameras[i], space);
    if (p->antialias > 1)
        for (int i = 0; i < count; i++)
            p->host_cameras[count + i] = finer(p->host_cameras[i], p->antialias);
    CLN_TRY(CLN_PUT(p, cameras, p->host_cameras, all));
    p->view_count = count;
done:
    return st;
}

cln_status cln_pipeline_scene(cln_pipeline *p, const cln_scene *scene, const cln_space *space)
{
    cln_status st = CLN_OK;
    const cln_camera **cameras = NULL;

    CLN_TRY(cln_alloc(&cameras, (size_t)scene->view_count, sizeof *cameras, "cameras"));
    for (int i = 0; i < scene->view_count; i++)
        cameras[i] = &scene->views[i].camera;
    CLN_TRY(cln_pipeline_cameras(p, cameras, scene->view_count, space));
    p->training_views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
done:
    free(cameras);
    return st;
}

static double rays_per_pixel(const cln_pixel *pixels, int n)
{
    int alone = 0;

    for (int i = 0; i < n; i++)
        alone += CLN_SPOT_INDEX(pixels[i].spot) == 0;
    return n ? (double)n / alone : 1;
}

cln_status cln_pipeline_batch(cln_pipeline *p, const cln_pixel *pixels, int n, const float *targets,
                              const float *backgrounds)
{
    cln_status st = CLN_OK;
    const size_t rays = (size_t)n;
    const size_t all = rays * (size_t)cln_pipeline_rows(p) + (size_t)cln_pipeline_extra_rays(p);
    const cln_stage1 *stage1 = cln_stage1_of(&p->config);

    if (p->averaged)
        p->rays_per_pixel = rays_per_pixel(pixels, n);
    CLN_TRY(CLN_PUT_SOON(p, pixels, pixels, rays));
    CLN_TRY(CLN_RESERVE(p, ray_o, all));
    CLN_TRY(CLN_RESERVE(p, ray_d, all));
    CLN_TRY(CLN_RESERVE(p, results, rays));
    CLN_TRY(CLN_PUT_SOON(p, backgrounds, backgrounds, p->ray_background ? rays : 1));
    if (targets)
        CLN_TRY(CLN_PUT_SOON(p, targets, targets, rays));
    if (stage1->keep)
        CLN_TRY(stage1->keep(p, pixels, n));
done:
    return st;
}

cln_status cln_pipeline_shown(cln_pipeline *p, const float *shown, int n)
{
    return CLN_PUT_SOON(p, shown, shown, (size_t)n);
}

cln_status cln_pipeline_points(cln_pipeline *p, const float *origins, const float *directions,
                               const float *targets, uint32_t rays)
{
    cln_status st = CLN_OK;

    CLN_TRY(CLN_PUT(p, ray_o, origins, rays));
    CLN_TRY(CLN_PUT(p, ray_d, directions, rays));
    if (targets)
        CLN_TRY(CLN_PUT(p, targets, targets, rays));
done:
    return st;
}

cln_status cln_pipeline_samples(cln_pipeline *p, const cln_sample *samples, uint32_t n)
{
    p->stretched = false;
    return CLN_PUT(p, samples, samples, n);
}
