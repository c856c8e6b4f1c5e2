/* Programs and kernels from the embedded kernel files or those of --kernel-dir. */
#ifndef CLN_PROGRAM_H
#define CLN_PROGRAM_H

#include "device/device.h"

typedef struct cln_program {
    cl_program program;
    char name[32];
} cln_program;

/* Builds `defines`, device_abi.h, lanes.h, the headers that NAME.cl names in its first line, and
 * NAME.cl. defines: "#define A 1" lines, part of the source since some drivers' caches ignore -D.
 * On CLN_BUILD the whole build log goes to the log at warn level; CLN_OUTPUT: the driver has no
 * place for what it compiles (cache.h). A line at info level says once per device that it
 * compiles. */
cln_status cln_program_build(cln_device *device, const char *name, const char *defines,
                             cln_program *out);
void cln_program_free(cln_program *program);
cln_status cln_kernel_create(const cln_program *program, const char *name, cl_kernel *out);
void cln_kernel_free(cl_kernel *kernel);

#endif
