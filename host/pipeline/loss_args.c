/* See loss_args.h. */
#include "pipeline/loss_args.h"

cln_loss_args cln_loss_args_of(const cln_pipeline *p, int n)
{
    const cln_config *c = &p->config;

    return (cln_loss_args){.scale = n ? (float)(p->rays_per_pixel / n) : 0.0f,
                           .huber = (float)c->huber_delta,
                           .alpha = (float)p->opacity_loss,
                           .cauchy = (float)c->cauchy,
                           .opacity = (float)c->opacity_entropy,
                           .distort = (float)c->distortion_loss,
                           .depth = (float)p->depth_loss};
}

void cln_loss_add_depth(const cln_pipeline *p, const cln_loss_args *loss, cln_args *args)
{
    if (p->depth_loss <= 0)
        return;
    CLN_ADD(args, p->ray_o.mem);
    CLN_ADD(args, p->ray_d.mem);
    CLN_ADD(args, p->shown.mem);
    CLN_ADD(args, loss->depth);
}

void cln_loss_add(const cln_pipeline *p, const cln_loss_args *loss, cln_args *args)
{
    CLN_ADD(args, loss->scale);
    CLN_ADD(args, loss->huber);
    CLN_ADD(args, loss->alpha);
    CLN_ADD(args, loss->cauchy);
    CLN_ADD(args, loss->opacity);
    CLN_ADD(args, loss->distort);
    cln_loss_add_depth(p, loss, args);
    if (cln_pipeline_measures(&p->config) > 0)
        CLN_ADD(args, p->measures.mem);
}
