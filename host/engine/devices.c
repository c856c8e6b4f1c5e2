/* cln_devices_list: what the loader finds, each with the verdict of the quick self-test. A device that
 * does not work is a row with its reason, never the end of the list. */
#include <stdio.h>
#include <stdlib.h>

#include "base/memory.h"
#include "device/device_list.h"
#include "engine/selftest.h"

static void judge(int row, cln_device_info *info)
{
    char spec[16];
    const cln_device_desc desc = {.spec = spec};
    cln_device *device = NULL;
    cln_status st = CLN_OK;

    snprintf(spec, sizeof spec, "%d", row);
    st = cln_device_open(&desc, &device);
    if (st == CLN_OK)
        st = cln_selftest_device(device, true, NULL, NULL);
    snprintf(info->verdict, sizeof info->verdict, "%s", st == CLN_OK ? "ok" : cln_error_text());
    cln_clear_error();
    cln_device_close(device);
}

cln_status cln_devices_list(bool test, cln_device_info **out, int *count)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;

    *out = NULL;
    *count = 0;
    CLN_TRY(cln_device_ids(&ids, count));
    CLN_TRY(cln_alloc(out, (size_t)*count, sizeof **out, "device list"));
    for (int i = 0; i < *count; i++) {
        cln_device_describe(ids[i], &(*out)[i]);
        if (test)
            judge(i, &(*out)[i]);
    }
done:
    free(ids);
    return st;
}
