/* Buffers: an array in one OpenCL buffer or in CLN_PARTS of them; counts their bytes. */
#include "device/buffer.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "device/blocks.h"
#include "device/cl_error.h"
#include "device/queue.h"

static void CL_CALLBACK give_back(cl_mem buffer, void *block)
{
    (void)buffer;
    cln_block_give_back(block);
}

/* Frees what is kept but for as much as there was before, so that kept memory never counts. */
static void trim(const cln_device *device)
{
    cln_blocks_trim(device->blocks, device->peak - device->allocated);
}

/* A CPU device works in host memory, so it gets huge pages, and keeps them (blocks.h). */
static cl_mem make_mem(const cln_device *device, size_t bytes, cl_int *code)
{
    cln_block *block = NULL;
    cl_mem mem = NULL;

    if (strcmp(device->info.type, "cpu") == 0)
        block = cln_blocks_take(device->blocks, bytes);
    if (!block)
        return clCreateBuffer(device->context, CL_MEM_READ_WRITE, bytes, NULL, code);
    mem = clCreateBuffer(device->context, CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR, bytes,
                         block->memory, code);
    if (*code == CL_SUCCESS)
        *code = clSetMemObjectDestructorCallback(mem, give_back, block);
    if (*code == CL_SUCCESS)
        return mem;
    if (mem)
        clReleaseMemObject(mem);
    cln_block_give_back(block);
    return NULL;
}

/* Allocates an OpenCL buffer and counts it. */
static cln_status make(cln_device *device, size_t bytes, const char *what, cl_mem *out)
{
    cln_status st = CLN_OK;
    cl_int code = CL_SUCCESS;
    const cl_uint nan = 0xFFFFFFFFu;

    if (bytes > device->max_alloc)
        return cln_fail(
            CLN_MEMORY,
            "%s: %.0f MiB in one buffer, but %s allows %.0f MiB; lower --batch-samples, "
            "--n1 or the leaves' size (--width, --grid-cells)",
            what, (double)bytes / 1048576, device->info.name, (double)device->max_alloc / 1048576);
    if (device->limit && device->allocated + bytes > device->limit)
        return cln_fail(CLN_MEMORY,
                        "%s: %.0f MiB more would pass the device memory limit of %.0f MiB; raise "
                        "--device-mem or lower --batch-samples, --n1 or the leaves' "
                        "size (--width, --grid-cells)",
                        what, (double)bytes / 1048576, (double)device->limit / 1048576);
    *out = make_mem(device, bytes, &code);
    if (code != CL_SUCCESS) {
        *out = NULL;
        /* some drivers report missing memory as missing resources */
        st = code == CL_OUT_OF_RESOURCES
                 ? cln_fail(CLN_MEMORY, "clCreateBuffer: %s (%d)", cln_cl_name(code), (int)code)
                 : cln_cl_failed("clCreateBuffer", code);
        cln_note("allocating %.0f MiB for %s; if other programs have some of the device's memory, "
                 "stay under the rest with --device-mem",
                 (double)bytes / 1048576, what);
        return st;
    }
    device->allocated += bytes;
    if (device->allocated > device->peak)
        device->peak = device->allocated;
    trim(device);
    if (device->spoil)
        CLN_CL(clEnqueueFillBuffer(device->queue, *out, &nan, sizeof nan, 0, bytes / 4 * 4, 0, NULL,
                                   NULL));
done:
    return st;
}

static int parts_of(const cln_buffer *buffer)
{
    return buffer->part_bytes ? CLN_PARTS : 1;
}

/* Bytes of a part, at least 16. */
static size_t bytes_of(const cln_buffer *buffer, int part)
{
    const size_t before = (size_t)part * buffer->part_bytes;
    size_t bytes = buffer->bytes > before ? buffer->bytes - before : 0;

    if (buffer->part_bytes && bytes > buffer->part_bytes)
        bytes = buffer->part_bytes;
    return bytes < 16 ? 16 : bytes;
}

static cln_status reserve(cln_device *device, cln_buffer *buffer, size_t bytes, size_t part_bytes,
                          const char *what)
{
    cln_status st = CLN_OK;
    const size_t before = buffer->bytes;
    cln_buffer new = {.bytes = bytes < 16 ? 16 : bytes, .part_bytes = part_bytes};

    if (buffer->mem && buffer->bytes >= new.bytes && buffer->part_bytes == part_bytes)
        return CLN_OK;
    cln_buffer_free(device, buffer);
    for (int i = 0; i < parts_of(&new); i++)
        CLN_TRY(make(device, bytes_of(&new, i), what, &new.part[i]));
    *buffer = new;
    /* batches grow by a little all the time: not worth a line each */
    if (bytes / 2 >= before || bytes < before)
        cln_debug("buffer for %s: %zu bytes, %zu in all", what, bytes, device->allocated);
done:
    if (st != CLN_OK)
        cln_buffer_free(device, &new);
    return st;
}

cln_status cln_buffer_reserve(cln_device *device, cln_buffer *buffer, size_t bytes,
                              const char *what)
{
    return reserve(device, buffer, bytes, 0, what);
}

cln_status cln_buffer_reserve_parts(cln_device *device, cln_buffer *buffer, size_t bytes,
                                    size_t part_bytes, const char *what)
{
    if (bytes > CLN_PARTS * part_bytes)
        return cln_fail(CLN_MEMORY,
                        "%s: %.0f MiB are more than %d parts of %.0f MiB hold; lower "
                        "--start-level, --max-leaves, --n1 or the leaves' size "
                        "(--width, --grid-cells)",
                        what, (double)bytes / 1048576, CLN_PARTS, (double)part_bytes / 1048576);
    return reserve(device, buffer, bytes, part_bytes, what);
}

void cln_buffer_free(cln_device *device, cln_buffer *buffer)
{
    for (int i = 0; i < parts_of(buffer); i++)
        if (buffer->part[i]) {
            clReleaseMemObject(buffer->part[i]);
            device->allocated -= bytes_of(buffer, i);
            trim(device);
        }
    memset(buffer, 0, sizeof *buffer);
}

/* The leading bytes of a range that lie in one part. */
typedef struct piece {
    cl_mem mem;
    size_t offset, bytes;
} piece;

static piece piece_of(const cln_buffer *buffer, size_t offset, size_t bytes)
{
    const size_t size = buffer->part_bytes;
    const size_t part = size ? offset / size : 0, within = offset - part * size;

    return (piece){buffer->part[part], within,
                   size && bytes > size - within ? size - within : bytes};
}

static cln_status move_in(cln_device *device, const cln_buffer *buffer, size_t offset,
                          const void *data, size_t bytes, cl_bool wait)
{
    cln_status st = CLN_OK;

    CLN_ASSERT(offset + bytes <= buffer->bytes);
    for (size_t done = 0, n = 0; done < bytes; done += n) {
        const piece at = piece_of(buffer, offset + done, bytes - done);

        n = at.bytes;
        CLN_CL(clEnqueueWriteBuffer(device->queue, at.mem, wait, at.offset, n,
                                    (const char *)data + done, 0, NULL, NULL));
    }
    if (wait && bytes > 0)
        cln_queue_waited(device);
done:
    return st;
}

static cln_status move_out(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                           size_t bytes, cl_bool wait)
{
    cln_status st = CLN_OK;

    CLN_ASSERT(offset + bytes <= buffer->bytes);
    for (size_t done = 0, n = 0; done < bytes; done += n) {
        const piece at = piece_of(buffer, offset + done, bytes - done);

        n = at.bytes;
        CLN_CL(clEnqueueReadBuffer(device->queue, at.mem, wait, at.offset, n, (char *)data + done,
                                   0, NULL, NULL));
    }
    if (wait && bytes > 0)
        cln_queue_waited(device);
done:
    return st;
}

cln_status cln_buffer_write(cln_device *device, const cln_buffer *buffer, size_t offset,
                            const void *data, size_t bytes)
{
    return move_in(device, buffer, offset, data, bytes, CL_TRUE);
}

cln_status cln_buffer_read(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                           size_t bytes)
{
    return move_out(device, buffer, offset, data, bytes, CL_TRUE);
}

cln_status cln_buffer_send(cln_device *device, const cln_buffer *buffer, size_t offset,
                           const void *data, size_t bytes)
{
    return move_in(device, buffer, offset, data, bytes, CL_FALSE);
}

cln_status cln_buffer_fetch(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                            size_t bytes)
{
    return move_out(device, buffer, offset, data, bytes, CL_FALSE);
}

cln_status cln_buffer_zero(cln_device *device, const cln_buffer *buffer, size_t bytes)
{
    cln_status st = CLN_OK;
    const cl_uint zero = 0;

    if (bytes == 0)
        return CLN_OK;
    CLN_ASSERT(bytes <= buffer->bytes && bytes % 4 == 0 && buffer->part_bytes == 0);
    CLN_CL(clEnqueueFillBuffer(device->queue, buffer->mem, &zero, sizeof zero, 0, bytes, 0, NULL,
                               NULL));
done:
    return st;
}
