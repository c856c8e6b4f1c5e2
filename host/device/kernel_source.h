/* The kernel sources and the tuning rows of data/tune, which the Makefile embeds
 * (build/kernels_embed.c): a string per source line, then NULL; a table ends with {NULL, NULL}. */
#ifndef CLN_KERNEL_SOURCE_H
#define CLN_KERNEL_SOURCE_H

typedef struct cln_kernel_source {
    const char *name; /* "mlp_forward.cl" */
    const char *const *lines;
} cln_kernel_source;

extern const cln_kernel_source cln_kernel_sources[];
extern const cln_kernel_source cln_tune_sources[]; /* "pocl.txt" */

#endif
