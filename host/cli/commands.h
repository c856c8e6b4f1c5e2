/* The commands, one per cmd_*.c: each turns options into calls of cl_nascent.h and prints what
 * comes back. They return the status of the call; main.c alone prints errors and exits. */
#ifndef CLN_COMMANDS_H
#define CLN_COMMANDS_H

#include <stdio.h>
#include "base/status.h"

struct cln_options;

cln_status cln_cmd_train(const struct cln_options *options);
cln_status cln_cmd_eval(const struct cln_options *options);
cln_status cln_cmd_render(const struct cln_options *options);
cln_status cln_cmd_view(const struct cln_options *options);
cln_status cln_cmd_info(const struct cln_options *options);
cln_status cln_cmd_poses(const struct cln_options *options);
cln_status cln_cmd_check(const struct cln_options *options);
cln_status cln_cmd_export(const struct cln_options *options);
cln_status cln_cmd_devices(const struct cln_options *options);
cln_status cln_cmd_selftest(const struct cln_options *options);
cln_status cln_cmd_tune(const struct cln_options *options);
cln_status cln_cmd_bugreport(const struct cln_options *options);
cln_status cln_cmd_completion(const struct cln_options *options);

/* The table of several runs, of `info`. */
cln_status cln_info_runs(const struct cln_options *options);

/* A device as `devices` shows it. */
void cln_print_device(FILE *to, int index, const cln_device_info *device);

#endif
