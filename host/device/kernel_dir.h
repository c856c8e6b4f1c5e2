/* The folder of --kernel-dir, asked before anything is built from it (program.h does). */
#ifndef CLN_KERNEL_DIR_H
#define CLN_KERNEL_DIR_H

#include "base/status.h"

/* CLN_INPUT if there is no such folder, or no kernel in it; NULL is fine. */
cln_status cln_kernel_dir_check(const char *folder);

#endif
