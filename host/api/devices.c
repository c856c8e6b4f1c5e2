/* cln_devices_list, cln_devices_test: what the loader finds, each with its kernel parameters and
 * the verdict of the quick self-test. A device that does not work is a row with its reason, never
 * the end of the list. */
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

/* Opens device number `row`, and fills in its kernel parameters. CLN_INPUT (a bad file of tuning
 * rows), CLN_USAGE and signals are the caller's errors; any other is the verdict on this device, if
 * test is set. */
static cln_status judge(int row, const cln_device_desc *given, bool test,
                        const cln_callbacks *callbacks, cln_device_info *info)
{
    char spec[16];
    cln_device_desc desc = {0};
    cln_device *device = NULL;
    cln_status st = CLN_OK;

    if (given)
        desc = *given;
    snprintf(spec, sizeof spec, "%d", row);
    desc.spec = spec;
    st = cln_device_open(&desc, &device);
    if (st == CLN_OK)
        st = tell_tune(device, "fast", info->network, info->tune, info->tune_from);
    if (st == CLN_OK)
        st = tell_tune(device, "voxel", info->voxel_network, info->voxel_tune,
                       info->voxel_tune_from);
    if (st == CLN_OK && test)
        st = cln_selftest_device(
            device, &(cln_selftest_plan){.shapes = CLN_SHAPES_QUICK, .callbacks = callbacks});
    cln_device_close(device);
    if (st == CLN_INPUT || st == CLN_USAGE || st == CLN_SIGINT || st == CLN_SIGTERM)
        return st;
    if (test)
        snprintf(info->verdict, sizeof info->verdict, "%s", st == CLN_OK ? "ok" : cln_error_text());
    cln_clear_error();
    return CLN_OK;
}

cln_status cln_devices_list(const cln_device_desc *desc, bool test, cln_device_info **out,
                            int *count)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;
    cln_device_info *list = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_devices_list", "out", out));
    CLN_TRY(cln_given("cln_devices_list", "count", count));
    *out = NULL;
    *count = 0;
    CLN_TRY(cln_device_ids(&ids, count));
    CLN_TRY(cln_alloc(&list, (size_t)*count, sizeof *list, "device list"));
    for (int i = 0; i < *count; i++) {
        cln_device_describe(ids[i], &list[i]);
        if (desc)
            CLN_TRY(judge(i, desc, test, NULL, &list[i]));
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

cln_status cln_devices_test(const cln_device_desc *desc, int row, const cln_callbacks *callbacks,
                            cln_device_info *info)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;
    int count = 0;

    cln_clear_error();
    CLN_TRY(cln_given("cln_devices_test", "info", info));
    CLN_TRY(cln_device_ids(&ids, &count));
    if (row < 0 || row >= count)
        CLN_TRY(cln_fail(CLN_NO_DEVICE, "cln_devices_test: there is no device number %d, but %d",
                         row, count));
    CLN_TRY(judge(row, desc, true, callbacks, info));
done:
    free(ids);
    return st;
}
