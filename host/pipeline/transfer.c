/* What goes into and comes out of the pipeline's buffers: tree and weights, cameras, batches. */
#include "pipeline/stages.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

static cln_status put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes,
                      const char *what)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(device, buffer, bytes, what));
    CLN_TRY(cln_buffer_write(device, buffer, 0, data, bytes));
done:
    return st;
}

/* Without waiting. */
static cln_status put_soon(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes,
                           const char *what)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(device, buffer, bytes, what));
    CLN_TRY(cln_buffer_send(device, buffer, 0, data, bytes));
done:
    return st;
}

/* What leaves had that were culled or merged is given back. */
static void free_if_large(cln_device *device, cln_buffer *buffer, size_t bytes)
{
    if (buffer->bytes > bytes + bytes / 4 + 65536)
        cln_buffer_free(device, buffer);
}

/* Room for `bytes`, and not much more. */
static cln_status fit(cln_device *device, cln_buffer *buffer, size_t bytes, const char *what)
{
    free_if_large(device, buffer, bytes);
    return cln_buffer_reserve(device, buffer, bytes, what);
}

static cln_status rows(cln_pipeline *p, cln_buffer *array, size_t count, int each, size_t row_bytes,
                       const char *what)
{
    const size_t part = (size_t)each * row_bytes;

    if (p->parts == 1)
        return cln_buffer_reserve(p->device, array, count * row_bytes, what);
    return cln_buffer_reserve_parts(p->device, array, count * row_bytes, part ? part : 16, what);
}

cln_status cln_pipeline_slice_rows(cln_pipeline *p, cln_buffer *array, size_t count,
                                   size_t row_bytes, const char *what)
{
    return rows(p, array, count, p->part_slices, row_bytes, what);
}

cln_status cln_pipeline_leaf_rows(cln_pipeline *p, cln_buffer *array, size_t row_bytes,
                                  const char *what)
{
    free_if_large(p->device, array, (size_t)p->leaves * row_bytes);
    return rows(p, array, (size_t)p->leaves, p->part_leaves, row_bytes, what);
}

static cln_status put_leaf_rows(cln_pipeline *p, cln_buffer *array, const void *data,
                                size_t row_bytes, const char *what)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_leaf_rows(p, array, row_bytes, what));
    CLN_TRY(cln_buffer_write(p->device, array, 0, data, (size_t)p->leaves * row_bytes));
done:
    return st;
}

static cln_status fit_and_put(cln_device *device, cln_buffer *buffer, const void *data,
                              size_t bytes, const char *what)
{
    cln_status st = CLN_OK;

    CLN_TRY(fit(device, buffer, bytes, what));
    CLN_TRY(put(device, buffer, data, bytes, what));
done:
    return st;
}

static size_t cells(const cln_pipeline *p)
{
    return (size_t)p->config.n1 * (size_t)p->config.n1 * (size_t)p->config.n1;
}

/* What follows from a training pipeline's leaves and weights: room for norms, and transposed weights. */
cln_status cln_pipeline_derive(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves;
    const size_t transposed =
        p->tune.leaf ? 0 : (size_t)cln_pipeline_transposed(&p->net) * sizeof(float);
    const cl_uint parts = (cl_uint)cln_groups((size_t)p->net.params, CLN_ADAM_PART);

    CLN_TRY(fit(p->device, &p->norms, leaves * sizeof(float), "norms"));
    CLN_TRY(cln_pipeline_leaf_rows(p, &p->transposed, transposed, "transposed weights"));
    if (!p->tune.leaf)
        CLN_TRY(CLN_LAUNCH(p->device, p->k.transpose, CLN_STAGE_UPLOAD, leaves * parts,
                           (size_t)p->tune.ls, CLN_LEAF_ARG(p, params), CLN_LEAF_ARG(p, transposed),
                           CLN_ARG(parts)));
done:
    return st;
}

static cln_status upload_training(cln_pipeline *p, const cln_model *model)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t leaves = (size_t)p->leaves;
    const size_t row = (size_t)p->net.params * cln_moment_bytes(&p->config);

    CLN_TRY(put_leaf_rows(p, &p->adam_m, model->adam_m, row, "Adam's first moments"));
    CLN_TRY(put_leaf_rows(p, &p->adam_v, model->adam_v, row, "Adam's second moments"));
    CLN_TRY(fit_and_put(device, &p->adam_steps, model->adam_steps, leaves * sizeof(cl_int),
                        "step counts"));
    if (cln_pipeline_measures(&p->config) > 0) {
        CLN_TRY(fit_and_put(device, &p->leaf_sums, model->sums,
                            leaves * 2 * CLN_MEASURES * sizeof(float), "measures of leaves"));
        CLN_TRY(fit_and_put(device, &p->leaf_met, model->met, leaves * sizeof(cl_int),
                            "measures of leaves"));
    }
    cln_buffer_free(device, &p->grads); /* sized by the leaves of the batches so far */
    cln_buffer_free(device, &p->seen);  /* of the leaves before */
    CLN_TRY(cln_pipeline_derive(p));
done:
    return st;
}

cln_status cln_pipeline_tree(cln_pipeline *p, const cln_octree *tree)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    float *boxes = NULL;
    int32_t *map = NULL;
    const size_t leaves = (size_t)tree->leaf_count;

    CLN_TRY(cln_pipeline_split(p, tree->leaf_count));
    p->leaves = (int)leaves;
    p->depth = cln_octree_depth(tree);
    CLN_TRY(cln_octree_boxes(tree, &boxes));
    CLN_TRY(cln_octree_map(tree, p->depth, &map));
    CLN_TRY(put(device, &p->boxes, boxes, leaves * 4 * sizeof(float), "leaf boxes"));
    CLN_TRY(put(device, &p->map, map, sizeof(int32_t) << (3 * p->depth), "leaf map"));
    CLN_TRY(cln_buffer_reserve(device, &p->begin, leaves * sizeof(cl_uint), "leaf runs"));
    CLN_TRY(cln_buffer_reserve(device, &p->end, leaves * sizeof(cl_uint), "leaf runs"));
    CLN_TRY(cln_buffer_reserve(device, &p->slice_counts, leaves * sizeof(cl_uint), "slice counts"));
    CLN_TRY(cln_buffer_reserve(device, &p->slice_starts, (leaves + 1) * sizeof(cl_uint),
                               "slice counts"));
done:
    free(boxes);
    free(map);
    return st;
}

cln_status cln_pipeline_upload(cln_pipeline *p, const cln_model *model, bool training)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_tree(p, &model->tree));
    CLN_TRY(put_leaf_rows(p, &p->params, model->params, (size_t)p->net.params * sizeof(float),
                          "network weights"));
    if (training || model->density)
        CLN_TRY(cln_pipeline_leaf_rows(p, &p->density, cells(p) * sizeof(uint16_t),
                                       "stage-1 densities"));
    if (model->density)
        CLN_TRY(cln_buffer_write(p->device, &p->density, 0, model->density,
                                 (size_t)p->leaves * cells(p) * sizeof(uint16_t)));
    if (training)
        CLN_TRY(upload_training(p, model));
done:
    return st;
}

cln_status cln_pipeline_download(cln_pipeline *p, cln_model *model, bool training)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t leaves = (size_t)p->leaves;
    const size_t weights = leaves * (size_t)p->net.params;
    const size_t moments = weights * cln_moment_bytes(&p->config);

    CLN_ASSERT(model->tree.leaf_count == p->leaves);
    CLN_TRY(cln_model_make_room(model, training));
    CLN_TRY(cln_buffer_read(device, &p->params, 0, model->params, weights * sizeof(float)));
    if (training) {
        CLN_TRY(cln_buffer_read(device, &p->adam_m, 0, model->adam_m, moments));
        CLN_TRY(cln_buffer_read(device, &p->adam_v, 0, model->adam_v, moments));
        CLN_TRY(cln_buffer_read(device, &p->adam_steps, 0, model->adam_steps,
                                leaves * sizeof(int32_t)));
        CLN_TRY(cln_buffer_read(device, &p->density, 0, model->density,
                                leaves * cells(p) * sizeof(uint16_t)));
        if (cln_pipeline_measures(&p->config) > 0) {
            CLN_TRY(cln_buffer_read(device, &p->leaf_sums, 0, model->sums,
                                    leaves * 2 * CLN_MEASURES * sizeof(float)));
            CLN_TRY(cln_buffer_read(device, &p->leaf_met, 0, model->met, leaves * sizeof(cl_int)));
        }
    }
done:
    return st;
}

static cln_device_camera in_cube(const cln_camera *c, const cln_space *space)
{
    cln_device_camera out = {.fx = (float)c->fx,
                             .fy = (float)c->fy,
                             .cx = (float)c->cx,
                             .cy = (float)c->cy,
                             .k1 = (float)c->k1,
                             .k2 = (float)c->k2,
                             .p1 = (float)c->p1,
                             .p2 = (float)c->p2,
                             .width = c->width,
                             .height = c->height};

    cln_space_pose_to_cube(space, c->c2w, out.c2w);
    return out;
}

cln_status cln_pipeline_cameras(cln_pipeline *p, const cln_camera *const *cameras, int count,
                                const cln_space *space)
{
    cln_status st = CLN_OK;

    free(p->host_cameras);
    p->view_count = 0;
    CLN_TRY(cln_alloc(&p->host_cameras, (size_t)count, sizeof *p->host_cameras, "cameras"));
    for (int i = 0; i < count; i++)
        p->host_cameras[i] = in_cube(cameras[i], space);
    CLN_TRY(put(p->device, &p->cameras, p->host_cameras, (size_t)count * sizeof *p->host_cameras,
                "cameras"));
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

cln_status cln_pipeline_batch(cln_pipeline *p, const cln_pixel *pixels, int n, const float *targets,
                              const float *backgrounds)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t rays = (size_t)n, vector = 4 * sizeof(float);
    const size_t all = rays + (size_t)cln_pipeline_extra_rays(p);

    CLN_TRY(put_soon(device, &p->pixels, pixels, rays * sizeof *pixels, "pixels"));
    CLN_TRY(cln_buffer_reserve(device, &p->ray_o, all * vector, "rays"));
    CLN_TRY(cln_buffer_reserve(device, &p->ray_d, all * vector, "rays"));
    CLN_TRY(cln_buffer_reserve(device, &p->results, rays * sizeof(cln_ray_result), "ray results"));
    CLN_TRY(put_soon(device, &p->backgrounds, backgrounds, (p->ray_background ? rays : 1) * vector,
                     "backgrounds"));
    if (targets)
        CLN_TRY(put_soon(device, &p->targets, targets, rays * vector, "targets"));
    if (p->config.stage1 == CLN_STAGE1_SPLAT) {
        free(p->host_pixels);
        p->host_rays = 0;
        CLN_TRY(cln_alloc(&p->host_pixels, rays, sizeof *pixels, "pixels"));
        if (rays)
            memcpy(p->host_pixels, pixels, rays * sizeof *pixels);
        p->host_rays = n;
    }
done:
    return st;
}

cln_status cln_pipeline_points(cln_pipeline *p, const float *origins, const float *directions,
                               const float *targets, uint32_t rays)
{
    cln_status st = CLN_OK;
    const size_t bytes = (size_t)rays * 4 * sizeof(float);

    CLN_TRY(put(p->device, &p->ray_o, origins, bytes, "points"));
    CLN_TRY(put(p->device, &p->ray_d, directions, bytes, "points"));
    if (targets)
        CLN_TRY(put(p->device, &p->targets, targets, bytes, "targets"));
done:
    return st;
}

cln_status cln_pipeline_samples(cln_pipeline *p, const cln_sample *samples, uint32_t n)
{
    return put(p->device, &p->samples, samples, (size_t)n * sizeof *samples, "samples");
}
