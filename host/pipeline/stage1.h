/* The interface of stage-1 methods. A new one is a row of stage1_methods.c, a word of the setting
 * (base/config_rows.h), its reading of points and densities in kernels/stage1.h, and its kernels
 * and buffers (kernel_list.h, buffer_list.h). Every method starts from the cached densities
 * (cln_stage_refresh). */
#ifndef CLN_STAGE1_H
#define CLN_STAGE1_H

#include "pipeline/pipeline.h"

/* Rays [first_ray, first_ray + rays) of a batch, whose stage 1 is made together: those of some of
 * its views, or of a band of rows of one view. */
typedef struct cln_ray_group {
    int first_view, views, row_begin, row_end, first_ray, rays;
} cln_ray_group;

enum { CLN_MOST_ARGS = 32 };
typedef struct cln_args {
    cln_arg list[CLN_MOST_ARGS];
    int count;
} cln_args;

static inline void cln_args_add(cln_args *args, cln_arg arg)
{
    CLN_ASSERT(args->count < CLN_MOST_ARGS);
    args->list[args->count++] = arg;
}
#define CLN_ADD(args, x) cln_args_add(args, (cln_arg)CLN_ARG(x))

/* density: p->density or p->picture_density. */
typedef struct cln_stage1 {
    /* A batch has rays of few views, ordered by pad, then y (cln_pipeline_batch); else rays of any
     * pixels, and some may be skipped. */
    bool by_view;
    /* Each of the following but `front` may be NULL. Keeps what `cut` needs of a batch's pixels. */
    cln_status (*keep)(cln_pipeline *p, const cln_pixel *pixels, int n);
    /* Cuts a batch of n rays into groups, in order; NULL: one group. The caller frees *groups. */
    cln_status (*cut)(cln_pipeline *p, const cln_buffer *density, int n, cln_ray_group **groups,
                      int *count);
    /* Makes what the kernels read for a group's rays. */
    cln_status (*make)(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *group);
    /* Frees what `make` allocated. */
    void (*release)(cln_pipeline *p);
    /* Add arguments of the sampling kernels, which point into *p: STAGE1_ARGUMENTS in front,
     * LIST_ARGUMENTS at the end. */
    void (*front)(const cln_pipeline *p, const cln_buffer *density, cln_args *args);
    void (*back)(const cln_pipeline *p, cln_args *args);
} cln_stage1;

const cln_stage1 *cln_stage1_of(const cln_config *config);

/* Frees what the method made for past batches, as after a change of the memory plan. */
void cln_stage1_release(cln_pipeline *p);

#endif
