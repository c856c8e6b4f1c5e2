/* Extra samples for the regularisers of points (kernels/regularise.cl). */
#include "pipeline/stages.h"

enum { POINTS = 4096, PAIRS = 2048 };

static cl_uint points_of(const cln_pipeline *p)
{
    return p->config.sparsity > 0 ? POINTS : 0;
}

static cl_uint pairs_of(const cln_pipeline *p)
{
    return p->config.edge > 0 ? PAIRS : 0;
}

int cln_pipeline_extra_rays(const cln_pipeline *p)
{
    return (int)(points_of(p) + pairs_of(p));
}

int cln_pipeline_extra_samples(const cln_pipeline *p)
{
    return (int)(points_of(p) + 2 * pairs_of(p));
}

cln_status cln_stage_regularise(cln_pipeline *p, const cln_sampling *s, int rays, uint32_t *samples)
{
    cln_status st = CLN_OK;
    const cl_uint points = points_of(p), pairs = pairs_of(p), leaves = (cl_uint)p->leaves;
    const cl_uint first_ray = (cl_uint)(rays * cln_pipeline_rows(p)), first_sample = *samples;
    const cl_int depth = p->depth;
    const cl_uint2 seed = {{(cl_uint)s->seed, (cl_uint)(s->seed >> 32)}};
    const size_t wg = (size_t)p->tune.wg;

    if (points + pairs == 0)
        return CLN_OK;
    CLN_TRY(CLN_LAUNCH(
        p->device, p->k.regularise_points, CLN_STAGE_SAMPLES, cln_groups(points + pairs, wg), wg,
        CLN_ARG(p->boxes.mem), CLN_ARG(p->map.mem), CLN_ARG(p->ray_o.mem), CLN_ARG(p->ray_d.mem),
        CLN_ARG(p->samples.mem), CLN_ARG(first_ray), CLN_ARG(first_sample), CLN_ARG(points),
        CLN_ARG(pairs), CLN_ARG(leaves), CLN_ARG(depth), CLN_ARG(seed), CLN_ARG(s->step)));
    *samples += points + 2 * pairs;
done:
    return st;
}

cln_status cln_stage_regularise_gradient(cln_pipeline *p, const cln_sampling *s, uint32_t samples)
{
    const cl_uint points = points_of(p), pairs = pairs_of(p);
    const cl_uint first_sample = samples - (cl_uint)cln_pipeline_extra_samples(p);
    const cl_float n1 = (cl_float)p->config.n1, sparsity = (cl_float)p->config.sparsity;
    const cl_float edge = (cl_float)p->config.edge;
    const cl_uint2 seed = {{(cl_uint)s->seed, (cl_uint)(s->seed >> 32)}};
    const size_t wg = (size_t)p->tune.wg;

    if (points + pairs == 0)
        return CLN_OK;
    return CLN_LAUNCH(p->device, p->k.regularise_gradient, CLN_STAGE_COMPOSITE,
                      cln_groups(points + pairs, wg), wg, CLN_ARG(p->samples.mem),
                      CLN_ARG(p->boxes.mem), CLN_ARG(p->out.mem), CLN_ARG(p->dout.mem),
                      CLN_ARG(first_sample), CLN_ARG(points), CLN_ARG(pairs), CLN_ARG(n1),
                      CLN_ARG(sparsity), CLN_ARG(edge), CLN_ARG(seed), CLN_ARG(s->step));
}
