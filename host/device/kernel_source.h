/* The kernel sources embedded by the Makefile (build/kernels_embed.c): one string per source line,
 * ended by NULL; the table is ended by {NULL, NULL}. */
#ifndef CLN_KERNEL_SOURCE_H
#define CLN_KERNEL_SOURCE_H

typedef struct cln_kernel_source {
    const char *name; /* "mlp.cl" */
    const char *const *lines;
} cln_kernel_source;

extern const cln_kernel_source cln_kernel_sources[];

#endif
