/* Stages from samples to updated weights: group, forward, composite, backward, Adam; the refresh of
 * stage 1 and the statistics that structure decisions need. */
#include "pipeline/stages.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "pipeline/halo.h"
#include "pipeline/loss_args.h"
#include "pipeline/share.h"
#include "pipeline/stretch.h"
#include "ranks/ranks.h"

cln_status cln_stage_group(cln_pipeline *p, uint32_t sample_count, uint32_t *slice_count)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const cl_uint n = sample_count, leaves = (cl_uint)p->leaves, slice = (cl_uint)p->tune.sl;
    const cl_uint block = (cl_uint)p->tune.nb, first = (cl_uint)p->first, own = (cl_uint)p->own;
    const size_t wg = (size_t)p->tune.wg;
    const cl_uint most = (n < own ? n : own) + n / slice;
    int bits = 1;

    *slice_count = most;
    while (bits < 32 && (leaves - 1) >> bits)
        bits++;
    CLN_TRY(CLN_RESERVE(p, keys, n));
    CLN_TRY(CLN_RESERVE(p, values, n));
    CLN_TRY(cln_buffer_zero(device, &p->begin, leaves * sizeof(cl_uint)));
    CLN_TRY(cln_buffer_zero(device, &p->end, leaves * sizeof(cl_uint)));
    CLN_TRY(CLN_LAUNCH(device, p->k.group_keys, CLN_STAGE_GROUP, cln_groups(n, wg), wg,
                       CLN_ARG(p->samples.mem), CLN_ARG(p->keys[0].mem), CLN_ARG(p->values[0].mem),
                       CLN_ARG(n)));
    CLN_TRY(cln_stage_sort(p, p->keys, p->values, n, bits, false, CLN_STAGE_GROUP));
    CLN_TRY(CLN_LAUNCH(device, p->k.group_bounds, CLN_STAGE_GROUP, cln_groups(n, wg), wg,
                       CLN_ARG(p->keys[0].mem), CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem),
                       CLN_ARG(n)));
    CLN_TRY(CLN_LAUNCH(device, p->k.group_slice_counts, CLN_STAGE_GROUP, cln_groups(leaves, wg), wg,
                       CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem), CLN_ARG(p->slice_counts.mem),
                       CLN_ARG(leaves), CLN_ARG(slice), CLN_ARG(first), CLN_ARG(own)));
    CLN_TRY(cln_stage_scan(p, &p->slice_counts, &p->slice_starts, leaves, CLN_STAGE_GROUP, NULL));
    CLN_TRY(CLN_RESERVE(p, slices, most));
    CLN_TRY(CLN_LAUNCH(device, p->k.group_slices, CLN_STAGE_GROUP,
                       cln_groups(most > leaves ? most : leaves, wg), wg, CLN_ARG(p->begin.mem),
                       CLN_ARG(p->end.mem), CLN_ARG(p->slice_starts.mem), CLN_ARG(p->slices.mem),
                       CLN_ARG(leaves), CLN_ARG(block), CLN_ARG(most)));
done:
    return st;
}

cln_status cln_stage_slices(cln_pipeline *p, uint32_t *slice_count)
{
    return cln_buffer_read(p->device, &p->slice_starts, (size_t)p->leaves * sizeof(cl_uint),
                           slice_count, sizeof *slice_count);
}

cln_status cln_stage_fill(cln_pipeline *p, double *leaf_samples, double *padding)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves;
    const uint32_t tile = (uint32_t)p->tune.ts;
    uint32_t *begin = NULL, *end = NULL;
    double samples = 0, rows = 0, met = 0;

    CLN_TRY(cln_alloc(&begin, leaves, sizeof *begin, "leaves' samples"));
    CLN_TRY(cln_alloc(&end, leaves, sizeof *end, "leaves' samples"));
    CLN_TRY(cln_buffer_read(p->device, &p->begin, 0, begin, leaves * sizeof *begin));
    CLN_TRY(cln_buffer_read(p->device, &p->end, 0, end, leaves * sizeof *end));
    /* all slices of a leaf but the last are whole blocks of whole tiles (kernels/group.cl) */
    for (size_t leaf = 0; leaf < leaves; leaf++) {
        const uint32_t n = end[leaf] - begin[leaf];

        samples += n;
        met += n > 0;
        rows += (n + tile - 1) / tile * tile;
    }
    *leaf_samples = met > 0 ? samples / met : 0;
    *padding = rows > 0 ? 1 - samples / rows : 0;
done:
    free(begin);
    free(end);
    return st;
}

static bool is_voxel(const cln_pipeline *p)
{
    return p->net.encoding == CLN_ENCODING_VOXEL;
}

/* Is the decoder needed? While it adds 0 and no update changes that, it has no gradient either. */
static bool decodes(const cln_pipeline *p, bool training)
{
    return p->net.decoder > 0 && (p->decodes || (training && p->decoder_rate > 0));
}

cln_status cln_stage_forward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                             bool training, uint32_t step_key)
{
    cln_status st = CLN_OK;
    const cl_uint decode = decodes(p, training);
    cln_device *device = p->device;
    const cl_uint slices = slice_count, key = step_key;
    const cl_uint count = sample_count, each = (cl_uint)p->tune.sl, own = (cl_uint)p->own;
    const cl_int first = p->first;

    CLN_TRY(CLN_RESERVE(p, out, sample_count));
    CLN_TRY(CLN_RESERVE(p, acts, training ? sample_count : 0));
    if (is_voxel(p) && training)
        CLN_TRY(CLN_LAUNCH(device, p->k.voxel_forward_train, CLN_STAGE_FORWARD, slices,
                           (size_t)p->tune.ls, CLN_LEAF_ARG(p, params), CLN_ARG(p->boxes.mem),
                           CLN_ARG(p->slices.mem), CLN_ARG(p->values[0].mem),
                           CLN_ARG(p->samples.mem), CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem),
                           CLN_ARG(p->out.mem), CLN_ARG(p->decoder_w.mem), CLN_ARG(p->acts.mem),
                           CLN_ARG(slices), CLN_ARG(key), CLN_ARG(first), CLN_ARG(decode)));
    else if (is_voxel(p))
        CLN_TRY(CLN_LAUNCH(device, p->k.voxel_samples, CLN_STAGE_FORWARD,
                           cln_groups(sample_count, each), (size_t)p->tune.ls,
                           CLN_LEAF_ARG(p, params), CLN_ARG(p->boxes.mem), CLN_ARG(p->samples.mem),
                           CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem), CLN_ARG(p->out.mem),
                           CLN_ARG(p->decoder_w.mem), CLN_ARG(count), CLN_ARG(each), CLN_ARG(first),
                           CLN_ARG(own), CLN_ARG(decode)));
    else
        CLN_TRY(CLN_LAUNCH(device, training ? p->k.mlp_forward_train : p->k.mlp_forward_eval,
                           CLN_STAGE_FORWARD, slices, (size_t)p->tune.ls, CLN_LEAF_ARG(p, params),
                           CLN_ARG(p->boxes.mem), CLN_ARG(p->slices.mem), CLN_ARG(p->values[0].mem),
                           CLN_ARG(p->samples.mem), CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem),
                           CLN_ARG(p->out.mem), CLN_ARG(p->acts.mem), CLN_ARG(slices), CLN_ARG(key),
                           CLN_ARG(first)));
    CLN_TRY(cln_share_samples(p, sample_count, training));
done:
    return st;
}

cln_status cln_stage_evaluate(cln_pipeline *p, uint32_t sample_count)
{
    cln_status st = CLN_OK;
    uint32_t slices = 0;

    if (!is_voxel(p) || p->ranks > 1) /* ranks exchange runs of grouped samples */
        CLN_TRY(cln_stage_group(p, sample_count, &slices));
    CLN_TRY(cln_stage_forward(p, sample_count, slices, false, 0));
done:
    return st;
}

cln_status cln_stage_composite(cln_pipeline *p, int n, unsigned depth)
{
    const cl_uint rays = (cl_uint)n, kind = depth;
    const size_t wg = (size_t)p->tune.wg;

    return CLN_LAUNCH(p->device, p->k.composite, CLN_STAGE_COMPOSITE, cln_groups(rays, wg), wg,
                      CLN_ARG(p->sample_starts.mem), CLN_ARG(p->samples.mem), CLN_ARG(p->out.mem),
                      CLN_ARG(p->backgrounds.mem), CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem),
                      CLN_ARG(p->results.mem), CLN_ARG(rays), CLN_ARG(kind));
}

cln_status cln_stage_composite_pixels(cln_pipeline *p, int n)
{
    const cl_uint rays = (cl_uint)n;
    const size_t wg = (size_t)p->tune.wg;

    return CLN_LAUNCH(p->device, p->k.composite_pixels, CLN_STAGE_COMPOSITE, cln_groups(rays, wg),
                      wg, CLN_ARG(p->sample_starts.mem), CLN_ARG(p->samples.mem),
                      CLN_ARG(p->out.mem), CLN_ARG(p->backgrounds.mem), CLN_ARG(p->pixels.mem),
                      CLN_ARG(p->targets.mem), CLN_ARG(rays));
}

cln_status cln_stage_composite_train(cln_pipeline *p, int n, uint32_t sample_count)
{
    cln_status st = CLN_OK;
    const cl_uint rays = (cl_uint)n;
    const size_t wg = (size_t)p->tune.wg;
    const cln_loss_args loss = cln_loss_args_of(p, n);
    cln_args a = {.count = 0};

    if (p->stretched) {
        const int me = cln_ranks_me();

        CLN_TRY(cln_stretch_composite(p, n, me));
        CLN_TRY(cln_stretch_exchange(p));
        CLN_TRY(cln_stretch_train(p, n, me, sample_count));
        goto done;
    }
    CLN_TRY(CLN_RESERVE(p, dout, sample_count));
    CLN_TRY(CLN_RESERVE(p, measures, sample_count));
    if (p->averaged)
        CLN_TRY(cln_stage_composite_pixels(p, n));
    CLN_ADD(&a, p->sample_starts.mem);
    CLN_ADD(&a, p->samples.mem);
    CLN_ADD(&a, p->out.mem);
    CLN_ADD(&a, p->backgrounds.mem);
    CLN_ADD(&a, p->targets.mem);
    CLN_ADD(&a, p->pixels.mem);
    CLN_ADD(&a, p->dout.mem);
    CLN_ADD(&a, p->results.mem);
    CLN_ADD(&a, rays);
    cln_loss_add(p, &loss, &a);
    CLN_TRY(cln_launch(p->device, p->k.composite_train, CLN_STAGE_COMPOSITE, cln_groups(rays, wg),
                       wg, a.list, a.count));
done:
    return st;
}

cln_status cln_stage_measure(cln_pipeline *p, uint32_t samples)
{
    const cl_uint n = samples, first = (cl_uint)p->first;

    if (cln_pipeline_measures(&p->config) == 0)
        return CLN_OK;
    return CLN_LAUNCH(p->device, p->k.leaf_measure, CLN_STAGE_STRUCTURE, (size_t)p->own,
                      (size_t)p->tune.ls, CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem),
                      CLN_ARG(p->values[0].mem), CLN_ARG(p->measures.mem),
                      CLN_ARG(p->leaf_sums.mem), CLN_ARG(p->leaf_met.mem), CLN_ARG(n),
                      CLN_ARG(first));
}

cln_status cln_stage_measure_reset(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const size_t leaves = (size_t)p->leaves;

    if (cln_pipeline_measures(&p->config) == 0)
        return CLN_OK;
    CLN_TRY(
        cln_buffer_zero(p->device, &p->leaf_sums, leaves * CLN_MEASURES * 2 * sizeof(cl_float)));
    CLN_TRY(cln_buffer_zero(p->device, &p->leaf_met, leaves * sizeof(cl_int)));
done:
    return st;
}

cln_status cln_stage_distil_gradient(cln_pipeline *p, uint32_t samples, double scale)
{
    cln_status st = CLN_OK;
    const cl_uint n = samples;
    const cl_float factor = (cl_float)scale;
    const size_t wg = (size_t)p->tune.wg;

    CLN_TRY(CLN_RESERVE(p, dout, samples));
    CLN_TRY(CLN_RESERVE(p, losses, samples));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.distil_gradient, CLN_STAGE_STRUCTURE, cln_groups(n, wg), wg,
                       CLN_ARG(p->samples.mem), CLN_ARG(p->out.mem), CLN_ARG(p->targets.mem),
                       CLN_ARG(p->dout.mem), CLN_ARG(p->losses.mem), CLN_ARG(n), CLN_ARG(factor)));
done:
    return st;
}

double cln_pipeline_gradients(const cln_tune *tune, double samples, double slices)
{
    if (!tune->leaf)
        return slices;
    return samples > tune->sl ? ceil(samples / floor(tune->sl / 2.0)) : 0;
}

cln_status cln_stage_roulette(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t min_samples, double cutoff, uint32_t step_key)
{
    cln_status st = CLN_OK;
    const cl_uint count = sample_count, slices = slice_count, least = min_samples;
    const cl_uint key = cln_hash(step_key);
    const cl_float share = (float)cutoff;

    CLN_TRY(CLN_RESERVE(p, heads, sample_count));
    CLN_TRY(CLN_RESERVE(p, chosen, sample_count));
    CLN_TRY(CLN_RESERVE(p, chosen_counts, slice_count));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.roulette, CLN_STAGE_BACKWARD, slices, (size_t)p->tune.ls,
                       CLN_ARG(p->slices.mem), CLN_ARG(p->values[0].mem), CLN_ARG(p->out.mem),
                       CLN_ARG(p->dout.mem), CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem),
                       CLN_ARG(p->heads.mem), CLN_ARG(p->chosen.mem), CLN_ARG(p->chosen_counts.mem),
                       CLN_ARG(count), CLN_ARG(slices), CLN_ARG(least), CLN_ARG(share),
                       CLN_ARG(key)));
done:
    return st;
}

static cln_status decoder_backward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count)
{
    cln_status st = CLN_OK;
    const cl_uint slices = slice_count;
    int rows = 0;

    CLN_TRY(CLN_RESERVE(p, feature_grads, sample_count));
    if (!decodes(p, true))
        return CLN_OK;
    p->decoder_groups = (int)cln_groups(slice_count, CLN_DECODER_EACH);
    rows = p->decoder_groups > p->ranks ? p->decoder_groups : p->ranks;
    CLN_TRY(CLN_RESERVE(p, decoder_grads, (size_t)rows * CLN_DECODER_EACH));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.decoder_backward, CLN_STAGE_BACKWARD,
                       (size_t)p->decoder_groups, (size_t)p->tune.ls, CLN_ARG(p->decoder_w.mem),
                       CLN_ARG(p->boxes.mem), CLN_ARG(p->slices.mem), CLN_ARG(p->values[0].mem),
                       CLN_ARG(p->samples.mem), CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem),
                       CLN_ARG(p->heads.mem), CLN_ARG(p->chosen.mem), CLN_ARG(p->chosen_counts.mem),
                       CLN_ARG(p->acts.mem), CLN_ARG(p->feature_grads.mem),
                       CLN_ARG(p->decoder_grads.mem), CLN_ARG(slices)));
done:
    return st;
}

/* How the backward pass updates leaves of one slice. */
typedef struct at_once {
    uint32_t min_samples; /* of a leaf */
    double lr;
} at_once;

/* update: NULL writes the gradient of each slice to the slice's row of p->grads. */
static cln_status launch_backward(cln_pipeline *p, double gradients, uint32_t sample_count,
                                  uint32_t slice_count, uint32_t step_key, const at_once *update)
{
    cln_status st = CLN_OK;
    const cl_uint slices = slice_count, key = step_key, updates = update != NULL;
    const cl_uint half = (cl_uint)p->tune.sl / 2, least = update ? update->min_samples : 0;
    const cl_float rate = update ? (float)update->lr : 0;
    const cl_int first = p->first;
    const cl_uint decode = decodes(p, true);
    size_t far = 0; /* of other ranks' leaves */

    CLN_TRY(cln_halo_room(p, &far));
    CLN_TRY(CLN_RESERVE(p, grads, (size_t)gradients + far));
    if (is_voxel(p)) {
        CLN_TRY(CLN_RESERVE(p, met, slice_count + far));
        CLN_TRY(decoder_backward(p, sample_count, slice_count));
        CLN_TRY(CLN_LAUNCH(
            p->device, p->k.voxel_backward, CLN_STAGE_BACKWARD, slices, (size_t)p->tune.ls,
            CLN_LEAF_ARG(p, params), CLN_ARG(p->boxes.mem), CLN_ARG(p->slices.mem),
            CLN_ARG(p->values[0].mem), CLN_ARG(p->samples.mem), CLN_ARG(p->ray_o.mem),
            CLN_ARG(p->ray_d.mem), CLN_ARG(p->heads.mem), CLN_ARG(p->chosen.mem),
            CLN_ARG(p->chosen_counts.mem), CLN_LEAF_ARG(p, grads), CLN_ARG(p->met.mem),
            CLN_ARG(slices), CLN_ARG(p->begin.mem), CLN_ARG(p->feature_grads.mem), CLN_ARG(key),
            CLN_ARG(first), CLN_ARG(decode)));
        goto done;
    }
    CLN_TRY(CLN_LAUNCH(p->device, p->k.mlp_backward, CLN_STAGE_BACKWARD, slices, (size_t)p->tune.ls,
                       CLN_LEAF_ARG(p, params), CLN_LEAF_ARG(p, transposed), CLN_ARG(p->boxes.mem),
                       CLN_ARG(p->slices.mem), CLN_ARG(p->values[0].mem), CLN_ARG(p->samples.mem),
                       CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem), CLN_ARG(p->heads.mem),
                       CLN_ARG(p->chosen.mem), CLN_ARG(p->chosen_counts.mem), CLN_ARG(p->acts.mem),
                       CLN_LEAF_ARG(p, grads), CLN_ARG(slices), CLN_ARG(key), CLN_ARG(updates),
                       CLN_ARG(half), CLN_ARG(least), CLN_ARG(rate), CLN_ARG(p->begin.mem),
                       CLN_ARG(p->end.mem), CLN_ARG(p->adam_steps.mem), CLN_ARG(p->norms.mem),
                       CLN_LEAF_ARG(p, adam_m), CLN_LEAF_ARG(p, adam_v), CLN_ARG(first)));
done:
    return st;
}

static cln_status count_updates(cln_pipeline *p, uint32_t min_samples)
{
    const size_t wg = (size_t)p->tune.wg;
    const cl_uint leaves = (cl_uint)p->own, least = min_samples, first = (cl_uint)p->first;

    return CLN_LAUNCH(p->device, p->k.adam_count, CLN_STAGE_ADAM, cln_groups(leaves, wg), wg,
                      CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem), CLN_ARG(p->adam_steps.mem),
                      CLN_LEAF_ARG(p, params), CLN_ARG(p->norms.mem), CLN_ARG(leaves),
                      CLN_ARG(least), CLN_ARG(first));
}

static cln_status decoder_update(cln_pipeline *p, double lr)
{
    const size_t wg = (size_t)p->tune.wg;
    const cl_uint groups = (cl_uint)p->decoder_groups;
    const cl_float rate = (cl_float)(lr * p->decoder_rate);

    if (!decodes(p, true))
        return CLN_OK;
    p->decodes = true;
    return CLN_LAUNCH(p->device, p->k.decoder_update, CLN_STAGE_ADAM,
                      cln_groups((size_t)p->net.decoder_params, wg), wg,
                      CLN_ARG(p->decoder_grads.mem), CLN_ARG(p->decoder_w.mem),
                      CLN_ARG(p->decoder_m.mem), CLN_ARG(p->decoder_v.mem), CLN_ARG(groups),
                      CLN_ARG(rate));
}

static cln_status launch_voxel_update(cln_pipeline *p, double lr, uint32_t step_key)
{
    cln_status st = CLN_OK;
    const cl_uint first = (cl_uint)p->first, own = (cl_uint)p->own, key = step_key;
    const cl_float rate = (cl_float)lr, harmonics = (cl_float)p->harmonic_rate;
    const cln_buffer *far = p->ranks > 1 ? &p->halo_far : &p->slice_starts;

    CLN_TRY(decoder_update(p, lr));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.voxel_update, CLN_STAGE_ADAM,
                       cln_groups((size_t)p->own, CLN_ADAM_EACH), (size_t)p->tune.ls,
                       CLN_ARG(p->slice_starts.mem), CLN_LEAF_ARG(p, grads), CLN_ARG(p->met.mem),
                       CLN_ARG(p->around.mem), CLN_LEAF_ARG(p, params), CLN_LEAF_ARG(p, adam_m),
                       CLN_LEAF_ARG(p, adam_v), CLN_ARG(far->mem), CLN_ARG(first), CLN_ARG(own),
                       CLN_ARG(rate), CLN_ARG(harmonics), CLN_ARG(key)));
done:
    return st;
}

/* Updates leaves of at least min_slices slices. half_slice: where gradients lie
 * (kernels/mlp_backward.cl). */
static cln_status launch_adam(cln_pipeline *p, uint32_t min_samples, cl_uint min_slices,
                              cl_uint half_slice, double lr)
{
    const size_t leaves = (size_t)p->own;
    const cl_uint count = (cl_uint)leaves, least = min_samples, first = (cl_uint)p->first;
    const cl_uint parts = (cl_uint)cln_groups((size_t)p->net.params, CLN_ADAM_PART);
    const cl_float rate = (float)lr;

    return CLN_LAUNCH(p->device, p->k.adam, CLN_STAGE_ADAM,
                      cln_groups(leaves, CLN_ADAM_EACH) * parts, (size_t)p->tune.ls,
                      CLN_ARG(p->begin.mem), CLN_ARG(p->end.mem), CLN_ARG(p->slice_starts.mem),
                      CLN_ARG(p->slices.mem), CLN_LEAF_ARG(p, grads), CLN_ARG(p->adam_steps.mem),
                      CLN_ARG(p->norms.mem), CLN_LEAF_ARG(p, params), CLN_LEAF_ARG(p, adam_m),
                      CLN_LEAF_ARG(p, adam_v), CLN_LEAF_ARG(p, transposed), CLN_ARG(count),
                      CLN_ARG(parts), CLN_ARG(least), CLN_ARG(min_slices), CLN_ARG(half_slice),
                      CLN_ARG(rate), CLN_ARG(first));
}

cln_status cln_stage_backward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t step_key)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_stage_roulette(p, sample_count, slice_count, 0, p->config.roulette, step_key));
    CLN_TRY(launch_backward(p, slice_count, sample_count, slice_count, step_key, NULL));
done:
    return st;
}

cln_status cln_stage_adam(cln_pipeline *p, uint32_t min_samples, double lr)
{
    cln_status st = CLN_OK;

    if (is_voxel(p))
        return launch_voxel_update(p, lr, 0);
    CLN_TRY(count_updates(p, min_samples));
    CLN_TRY(launch_adam(p, min_samples, 1, 0, lr));
done:
    return st;
}

cln_status cln_stage_update(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                            uint32_t min_samples, uint32_t step_key, double lr)
{
    cln_status st = CLN_OK;
    const at_once update = {min_samples, lr};
    const double gradients = cln_pipeline_gradients(&p->tune, sample_count, slice_count);

    if (is_voxel(p)) {
        CLN_TRY(cln_stage_backward(p, sample_count, slice_count, step_key));
        CLN_TRY(cln_halo_gradients(p, slice_count));
        if (decodes(p, true))
            CLN_TRY(cln_halo_decoder(p));
        CLN_TRY(launch_voxel_update(p, lr, step_key));
        CLN_TRY(cln_halo_values(p));
        goto done;
    }
    CLN_TRY(count_updates(p, min_samples));
    CLN_TRY(cln_stage_roulette(p, sample_count, slice_count, min_samples, p->config.roulette,
                               step_key));
    CLN_TRY(launch_backward(p, gradients, sample_count, slice_count, step_key, &update));
    if (sample_count > (uint32_t)p->tune.sl)
        CLN_TRY(launch_adam(p, min_samples, 2, p->tune.leaf ? (cl_uint)p->tune.sl / 2 : 0, lr));
done:
    return st;
}

enum { RUN = 512 }; /* cells that a work-group takes one after the other */

static cln_status refresh(cln_pipeline *p, const cln_buffer *density, int first, int count,
                          bool jitter, uint64_t seed, uint32_t step)
{
    cln_status st = CLN_OK;
    const int own_end = p->first + p->own, end = first + count < own_end ? first + count : own_end;
    const cl_uint n1 = (cl_uint)p->config.n1, cells = RUN, key = step, shake = jitter;
    const cl_uint own = (cl_uint)p->first, begin = first > p->first ? (cl_uint)first : own;
    const cl_uint per_leaf = (cl_uint)cln_groups((size_t)n1 * n1 * n1, cells);
    const cl_uint2 words = {{(cl_uint)seed, (cl_uint)(seed >> 32)}};

    if (end > (int)begin)
        CLN_TRY(CLN_LAUNCH(p->device, is_voxel(p) ? p->k.voxel_density : p->k.mlp_density,
                           CLN_STAGE_REFRESH, (size_t)(end - (int)begin) * per_leaf,
                           (size_t)p->tune.ls, CLN_LEAF_ARG(p, params), CLN_ARG(p->boxes.mem),
                           CLN_LEAF_ARG_OF(p, density), CLN_ARG(n1), CLN_ARG(cells),
                           CLN_ARG(per_leaf), CLN_ARG(shake), CLN_ARG(words), CLN_ARG(key),
                           CLN_ARG(begin), CLN_ARG(own)));
    CLN_TRY(cln_share_densities(p, density, first, count));
done:
    return st;
}

cln_status cln_stage_refresh(cln_pipeline *p, int first, int count, bool jitter, uint64_t seed,
                             uint32_t step)
{
    return refresh(p, &p->density, first, count, jitter, seed, step);
}

cln_status cln_stage_picture_densities(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    CLN_TRY(CLN_RESERVE(p, picture_density, (size_t)p->leaves));
    CLN_TRY(refresh(p, &p->picture_density, 0, p->leaves, false, 0, 0));
done:
    return st;
}

void cln_stage_picture_release(cln_pipeline *p)
{
    cln_buffer_free(p->device, &p->picture_density);
}

/* Marks the seen cells of leaves [first, end). */
static cln_status see(cln_pipeline *p, int first, int end)
{
    const cl_uint n1 = (cl_uint)p->config.n1, views = (cl_uint)p->training_views;
    const cl_uint cells = n1 * n1 * n1, from = (cl_uint)first;
    const cl_uint total = end > first ? (cl_uint)(end - first) * cells : 0;
    const size_t wg = (size_t)p->tune.wg;

    return CLN_LAUNCH(p->device, p->k.stats_seen, CLN_STAGE_STRUCTURE, cln_groups(total, wg), wg,
                      CLN_ARG(p->cameras.mem), CLN_ARG(p->boxes.mem), CLN_LEAF_ARG(p, seen),
                      CLN_ARG(n1), CLN_ARG(views), CLN_ARG(from), CLN_ARG(total));
}

cln_status cln_stage_seen(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    CLN_TRY(CLN_RESERVE(p, seen, (size_t)p->leaves));
    p->seen_first = p->first;
    p->seen_end = p->first + p->own;
    CLN_TRY(see(p, p->seen_first, p->seen_end));
done:
    return st;
}

/* Marks those of leaves that have come to this rank since. */
static cln_status see_more(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const int end = p->first + p->own;

    if (p->first > p->seen_end || end < p->seen_first)
        return cln_stage_seen(p);
    CLN_TRY(see(p, p->first, p->seen_first));
    CLN_TRY(see(p, p->seen_end, end));
    p->seen_first = p->first < p->seen_first ? p->first : p->seen_first;
    p->seen_end = end > p->seen_end ? end : p->seen_end;
done:
    return st;
}

cln_status cln_stage_stats(cln_pipeline *p, float *stats)
{
    cln_status st = CLN_OK;
    const cl_uint n1 = (cl_uint)p->config.n1, cells = n1 * n1 * n1, first = (cl_uint)p->first;

    CLN_TRY(CLN_RESERVE(p, leaf_stats, (size_t)p->leaves));
    if (p->ranks > 1)
        CLN_TRY(see_more(p));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.stats_leaf, CLN_STAGE_STRUCTURE, (size_t)p->own,
                       (size_t)p->tune.sg, CLN_LEAF_ARG(p, density), CLN_LEAF_ARG(p, seen),
                       CLN_ARG(p->leaf_stats.mem), CLN_ARG(cells), CLN_ARG(first)));
    CLN_TRY(CLN_GET(p, leaf_stats, stats, (size_t)p->leaves));
    if (p->ranks > 1)
        cln_ranks_gather(stats, 2 * sizeof *stats, p->rank_first, true);
done:
    return st;
}
