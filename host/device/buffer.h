/* Buffers on a device: an array in one OpenCL buffer or in parts; the device counts their bytes. */
#ifndef CLN_BUFFER_H
#define CLN_BUFFER_H

#include "device/device.h"

/* An array in one OpenCL buffer, or in CLN_PARTS of them: byte b lies in part b / part_bytes.
 * Devices allow a buffer of at least a quarter of their memory, so four buffers reach all of it. */
enum { CLN_PARTS = 4 };
typedef struct cln_buffer {
    size_t bytes;      /* of all parts */
    size_t part_bytes; /* 0 = one buffer */
    union {
        cl_mem mem;
        cl_mem part[CLN_PARTS]; /* all allocated if part_bytes > 0 */
    };
} cln_buffer;

/* Makes *buffer hold at least `bytes`, and never fewer than 16, so that a kernel always gets a
 * valid buffer. Contents are lost when it grows. what: its name in the CLN_MEMORY sentence. */
cln_status cln_buffer_reserve(cln_device *device, cln_buffer *buffer, size_t bytes,
                              const char *what);
/* The same in CLN_PARTS parts of at most part_bytes > 0, each with at least 16 bytes. Contents are
 * also lost when part_bytes changes. */
cln_status cln_buffer_reserve_parts(cln_device *device, cln_buffer *buffer, size_t bytes,
                                    size_t part_bytes, const char *what);
void cln_buffer_free(cln_device *device, cln_buffer *buffer);
/* Write and read a range of the array, whatever its parts; wait. */
cln_status cln_buffer_write(cln_device *device, const cln_buffer *buffer, size_t offset,
                            const void *data, size_t bytes);
cln_status cln_buffer_read(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                           size_t bytes);
/* The same without waiting; done once a later cln_buffer_read, cln_buffer_write or
 * cln_device_finish has returned. Until then, data that are sent must stay unchanged, and data that
 * are fetched are not valid. */
cln_status cln_buffer_send(cln_device *device, const cln_buffer *buffer, size_t offset,
                           const void *data, size_t bytes);
cln_status cln_buffer_fetch(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                            size_t bytes);
/* Zeroes the first bytes, a multiple of 4, of a buffer without parts. */
cln_status cln_buffer_zero(cln_device *device, const cln_buffer *buffer, size_t bytes);

#endif
