/* Stage 1 by splatting (kernels/splat.cl), the functions of stage1.h: a batch's views are projected
 * together if their entries fit max_entries, else in groups of views or bands of rows. cut counts
 * entries and cuts the batch, first into views whose entries can be counted in 32 bits; make builds
 * the lists of a group. Both read back totals. */
#ifndef CLN_SPLAT_H
#define CLN_SPLAT_H

#include "pipeline/stage1.h"

/* Cells that a work-item projects. */
enum { CLN_SPLAT_RUN = 4096 };

/* The most entries that this number of views of the uploaded tree can have: all cells in each. */
uint64_t cln_splat_most(const cln_pipeline *p, int views);
cln_status cln_splat_keep(cln_pipeline *p, const cln_pixel *pixels, int n);
cln_status cln_splat_cut(cln_pipeline *p, const cln_buffer *density, int n, cln_ray_group **groups,
                         int *count);
cln_status cln_splat_make(cln_pipeline *p, const cln_buffer *density, const cln_ray_group *group);
void cln_splat_release(cln_pipeline *p);
void cln_splat_front(const cln_pipeline *p, const cln_buffer *density, cln_args *args);
void cln_splat_back(const cln_pipeline *p, cln_args *args);

#endif
