/* Buffers on a device: one array in one OpenCL buffer or in parts; the device counts their
 * bytes. */
#ifndef CLN_BUFFER_H
#define CLN_BUFFER_H

#include "device/device.h"

/* One buffer, or one array in CLN_PARTS buffers: byte b lies in part b / part_bytes. OpenCL
 * allows at least a quarter of the device's memory in one buffer, so that four reach all of it. */
enum { CLN_PARTS = 4 };
typedef struct cln_buffer {
    size_t bytes;      /* of all parts */
    size_t part_bytes; /* 0 = one buffer */
    union {
        cl_mem mem;
        cl_mem part[CLN_PARTS]; /* all there if part_bytes > 0 */
    };
} cln_buffer;

/* Makes *buffer hold at least `bytes` (contents are lost when it grows; at least 16 bytes are
 * there, so that a kernel always gets a valid buffer). `what` is for the CLN_MEMORY sentence. */
cln_status cln_buffer_reserve(cln_device *device, cln_buffer *buffer, size_t bytes,
                              const char *what);
/* The same in CLN_PARTS parts of at most part_bytes > 0, each with at least 16 bytes; contents
 * are lost when part_bytes changes, too. */
cln_status cln_buffer_reserve_parts(cln_device *device, cln_buffer *buffer, size_t bytes,
                                    size_t part_bytes, const char *what);
void cln_buffer_free(cln_device *device, cln_buffer *buffer);
/* Read and write take a range of the whole array, in however many parts it lies. */
cln_status cln_buffer_write(cln_device *device, const cln_buffer *buffer, size_t offset,
                            const void *data, size_t bytes);
cln_status cln_buffer_read(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                           size_t bytes);
/* The same without waiting. Send: `data` must stay as it is, fetch: it is there, once a later
 * cln_buffer_read, cln_buffer_write or cln_device_finish has returned. */
cln_status cln_buffer_send(cln_device *device, const cln_buffer *buffer, size_t offset,
                           const void *data, size_t bytes);
cln_status cln_buffer_fetch(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                            size_t bytes);
/* Not of parts. */
cln_status cln_buffer_zero(cln_device *device, const cln_buffer *buffer, size_t bytes);

#endif
