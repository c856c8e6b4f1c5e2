/* cln_devices_list: what the loader finds, each with its kernel parameters and the verdict of the
 * quick self-test. A device that does not work is a row with its reason, never the end of the
 * list. */
#include <stdio.h>
#include <stdlib.h>

#include "base/config.h"
#include "base/given.h"
#include "base/memory.h"
#include "device/tune.h"
#include "check/selftest.h"

/* Fills in the kernel parameters that a training with a preset would use. */
static cln_status tell_tune(const cln_device *device, const char *preset, char network[32],
                            char text[256], char from[512])
{
    cln_status st = CLN_OK;
    cln_config config;
    cln_network net;
    cln_tune tune;

    CLN_TRY(cln_config_preset(preset, &config));
    CLN_TRY(cln_network_layout(&config, &net));
    cln_network_text(&net, network);
    cln_device_tune(device, network, &tune, from);
    cln_pipeline_fit(device, &net, &tune);
    cln_tune_text(&tune, text);
done:
    return st;
}

/* Describes device number `row`. CLN_INPUT (a bad file of tuning rows) and CLN_USAGE are the
 * caller's errors; any other is the verdict on this device. */
static cln_status judge(int row, const cln_device_desc *given, bool test, cln_device_info *info)
{
    char spec[16];
    cln_device_desc desc = *given;
    cln_device *device = NULL;
    cln_status st = CLN_OK;

    snprintf(spec, sizeof spec, "%d", row);
    desc.spec = spec;
    st = cln_device_open(&desc, &device);
    if (st == CLN_INPUT || st == CLN_USAGE)
        return st;
    if (st == CLN_OK)
        st = tell_tune(device, "fast", info->network, info->tune, info->tune_from);
    if (st == CLN_OK)
        st = tell_tune(device, "voxel", info->voxel_network, info->voxel_tune,
                       info->voxel_tune_from);
    if (st == CLN_OK && test)
        st = cln_selftest_device(device, &(cln_selftest_plan){.shapes = CLN_SHAPES_QUICK});
    if (test)
        snprintf(info->verdict, sizeof info->verdict, "%s", st == CLN_OK ? "ok" : cln_error_text());
    cln_clear_error();
    cln_device_close(device);
    return CLN_OK;
}

cln_status cln_devices_list(const cln_device_desc *desc, bool test, cln_device_info **out,
                            int *count)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;
    cln_device_info *list = NULL;

    CLN_TRY(cln_given("cln_devices_list", "out", out));
    CLN_TRY(cln_given("cln_devices_list", "count", count));
    *out = NULL;
    *count = 0;
    CLN_TRY(cln_device_ids(&ids, count));
    CLN_TRY(cln_alloc(&list, (size_t)*count, sizeof *list, "device list"));
    for (int i = 0; i < *count; i++) {
        cln_device_describe(ids[i], &list[i]);
        if (desc)
            CLN_TRY(judge(i, desc, test, &list[i]));
    }
    *out = list;
    list = NULL;
done:
    free(list);
    free(ids);
    if (st != CLN_OK && count)
        *count = 0;
    return st;
}
