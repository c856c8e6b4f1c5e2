/* `cl-nascent devices`: every OpenCL device, what it has, its kernel parameters, and the verdict of
 * a quick self-test. */
#include "cli/commands.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/text.h"
#include "cli/console.h"
#include "io/json.h"

static json_t *device_json(int index, const cln_device_info *d)
{
    return json_pack(
        "{s:i s:s s:s s:s s:s s:s s:s s:o s:o s:o s:i s:i s:b s:s* s:s* s:s* s:s* s:s* s:s* s:s*}",
        "index", index, "name", d->name, "type", d->type, "vendor", d->vendor, "platform",
        d->platform, "version", d->version, "driver", d->driver, "global_mem",
        cln_json_whole(d->global_mem), "max_alloc", cln_json_whole(d->max_alloc), "local_mem",
        cln_json_whole(d->local_mem), "compute_units", d->compute_units, "max_group", d->max_group,
        "shared_mem", d->shared_mem, "verdict", *d->verdict ? d->verdict : NULL, "tune",
        *d->tune ? d->tune : NULL, "tune_from", *d->tune_from ? d->tune_from : NULL, "tune_network",
        *d->network ? d->network : NULL, "voxel_tune", *d->voxel_tune ? d->voxel_tune : NULL,
        "voxel_tune_from", *d->voxel_tune_from ? d->voxel_tune_from : NULL, "voxel_tune_network",
        *d->voxel_network ? d->voxel_network : NULL);
}

static void print_verdict(FILE *to, const cln_device_info *d)
{
    if (*d->verdict)
        fprintf(to, "    self-test  %s\n", d->verdict);
}

void cln_print_device(FILE *to, int index, const cln_device_info *d)
{
    const bool both = *d->voxel_tune && strcmp(d->tune, d->voxel_tune) == 0 &&
                      strcmp(d->tune_from, d->voxel_tune_from) == 0;
    char global[32], largest[32], local[32];

    cln_format_bytes(d->global_mem, global);
    cln_format_bytes(d->max_alloc, largest);
    cln_format_bytes(d->local_mem, local);
    fprintf(to, "%2d  %s\n", index, d->name);
    fprintf(to, "    type       %s, %d compute unit%s\n", d->type, d->compute_units,
            cln_plural(d->compute_units, "", "s"));
    fprintf(to, "    memory     %s%s, largest allocation %s\n", global,
            d->shared_mem ? ", the host's" : "", largest);
    fprintf(to, "    groups     at most %d work-item%s, with %s of local memory\n", d->max_group,
            cln_plural(d->max_group, "", "s"), local);
    fprintf(to, "    platform   %s (%s)\n", d->platform, d->vendor);
    fprintf(to, "    version    %s\n", d->version);
    fprintf(to, "    driver     %s\n", d->driver);
    if (*d->voxel_tune) /* the default preset's first */
        fprintf(to, "    kernels    %s\n               from %s, for voxels of %s%s%s\n",
                d->voxel_tune, d->voxel_tune_from, d->voxel_network,
                both ? " and networks of " : "", both ? d->network : "");
    if (*d->tune && !both)
        fprintf(to, "    %-9s  %s\n               from %s, for networks of %s (preset fast)\n",
                *d->voxel_tune ? "or" : "kernels", d->tune, d->tune_from, d->network);
    print_verdict(to, d);
}

/* Tests a device, with a line of progress of its own. */
static cln_status test(const cln_options *options, int index, cln_device_info *d)
{
    cln_status st = CLN_OK;
    cln_console console = {0};

    CLN_TRY(cln_console_open(options, &console));
    CLN_TRY(cln_devices_test(&options->device, index, &console.callbacks, d));
done:
    cln_console_close(&console);
    return st;
}

/* A row is printed before its test, which takes a minute when the driver has to compile. */
cln_status cln_cmd_devices(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_device_info *devices = NULL;
    json_t *list = NULL;
    int count = 0;

    CLN_TRY(cln_devices_list(&options->device, false, &devices, &count));
    if (options->json)
        list = json_array();
    for (int i = 0; i < count; i++) {
        if (!options->json)
            cln_print_device(stdout, i, &devices[i]);
        if (options->test) {
            CLN_TRY(cln_flush_stdout());
            CLN_TRY(test(options, i, &devices[i]));
            if (!options->json)
                print_verdict(stdout, &devices[i]);
        }
        if (options->json)
            json_array_append_new(list, device_json(i, &devices[i]));
    }
    if (options->json) {
        st = cln_print_json(
            json_pack("{s:s s:o}", "schema", "cl-nascent.devices/1", "devices", list));
        list = NULL; /* handed over */
    }
done:
    json_decref(list);
    free(devices);
    return st;
}
