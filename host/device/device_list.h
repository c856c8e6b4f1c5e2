/* Raw device handles, for device.c and the `devices` listing alone. */
#ifndef CLN_DEVICE_LIST_H
#define CLN_DEVICE_LIST_H

#include "device/device.h"

/* All devices of all platforms in the loader's order; CLN_NO_DEVICE if there is none. */
cln_status cln_device_ids(cl_device_id **out, int *count);
void cln_device_describe(cl_device_id id, cln_device_info *info);

#endif
