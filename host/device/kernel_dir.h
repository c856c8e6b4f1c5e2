/* Checks the folder of --kernel-dir, before program.h builds anything from it. */
#ifndef CLN_KERNEL_DIR_H
#define CLN_KERNEL_DIR_H

#include "base/status.h"

/* Returns CLN_INPUT if there is no such folder, or no kernel in it; NULL is allowed. */
cln_status cln_kernel_dir_check(const char *folder);

/* Tells which kernels it lacks; NULL is allowed. */
void cln_kernel_dir_say(const char *folder);

#endif
