/* The stage-1 methods: the one place for a new one, which is a row of stage1_methods.c. Besides
 * it needs a word of the setting (base/config_rows.h), its way to read points and densities in
 * kernels/stage1.h, and what it builds and keeps (kernel_list.h, buffer_list.h). Cached
 * densities (cln_stage_refresh) are what each method starts from. */
#ifndef CLN_STAGE1_H
#define CLN_STAGE1_H

#include "pipeline/pipeline.h"

/* Rays of a batch whose stage 1 is made at a time, [first_ray, first_ray + rays): those of some
 * of its views, or of a band of rows of one view. */
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

/* density: p->density or p->picture_density. */
typedef struct cln_stage1 {
    /* A batch is of rays of few views, in order of pad, then y (cln_pipeline_batch); else rays of
     * any pixels, of which some may be skipped. */
    bool by_view;
    /* Each may be NULL. Keeps of a batch's pixels what `cut` needs. */
    cln_status (*keep)(cln_pipeline *p, const cln_pixel *pixels, int n);
    /* The groups of a batch of n rays, in their order; NULL: one of all. The caller frees
     * *groups. */
    cln_status (*cut)(cln_pipeline *p, const cln_buffer *density, int n, cln_ray_group **groups,
                      int *count);
    /* What the kernels read for the rays of a group. */
    cln_status (*make)(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *group);
    /* Gives back memory that grows with what is made. */
    void (*release)(cln_pipeline *p);
    /* Arguments of the sampling kernels: STAGE1_ARGUMENTS in front and LIST_ARGUMENTS at the
     * end. They point into *p. */
    void (*front)(const cln_pipeline *p, const cln_buffer *density, cln_args *args);
    void (*back)(const cln_pipeline *p, cln_args *args);
} cln_stage1;

const cln_stage1 *cln_stage1_of(const cln_config *config);

/* Gives back what the method has made of past batches, as after a change of the memory plan. */
void cln_stage1_release(cln_pipeline *p);

#endif
