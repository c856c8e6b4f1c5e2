/* The table of stage-1 methods, and gather, which needs only cached densities. See stage1.h. */
#include "pipeline/stage1.h"

#include "pipeline/splat.h"

static void gather_front(const cln_pipeline *p, const cln_buffer *density, cln_args *args)
{
    cln_args_add(args, (cln_arg)CLN_LEAF_ARG_OF(p, density));
    cln_args_add(args, (cln_arg)CLN_ARG(p->boxes.mem));
    cln_args_add(args, (cln_arg)CLN_ARG(p->config.n1));
}

static const cln_stage1 methods[] = {
    [CLN_STAGE1_GATHER] = {.front = gather_front},
    [CLN_STAGE1_SPLAT] = {.by_view = true,
                          .keep = cln_splat_keep,
                          .cut = cln_splat_cut,
                          .make = cln_splat_make,
                          .release = cln_splat_release,
                          .front = cln_splat_front,
                          .back = cln_splat_back},
};

const cln_stage1 *cln_stage1_of(const cln_config *config)
{
    return &methods[config->stage1];
}

void cln_stage1_release(cln_pipeline *p)
{
    const cln_stage1 *method = cln_stage1_of(&p->config);

    if (method->release)
        method->release(p);
}
