/* safetensors files: 8-byte little-endian header length, a JSON header {name: {dtype, shape,
 * data_offsets}}, then raw little-endian data; numpy and torch read them. Written as a stream,
 * atomically; read whole. docs/formats.md has it byte by byte. "__metadata__" holds the digest of
 * the content ("digest", 16 hex digits, cln_safetensors_digest), which reading checks: a damaged
 * file is CLN_CHECKPOINT, never used. */
#ifndef CLN_SAFETENSORS_H
#define CLN_SAFETENSORS_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef enum {
    CLN_DTYPE_F32,
    CLN_DTYPE_I32,
    CLN_DTYPE_U16,
    CLN_DTYPE_U8,
    CLN_DTYPE_BF16
} cln_dtype;

typedef struct cln_tensor {
    const char *name;
    cln_dtype dtype;
    int dims;
    int64_t shape[4];
    const void *data; /* host memory, little-endian as the host is */
} cln_tensor;

/* Bytes of one tensor's data. */
size_t cln_tensor_bytes(const cln_tensor *tensor);

/* Writes all tensors in order; their digest also to *digest if not NULL. CLN_OUTPUT. */
cln_status cln_safetensors_write(const char *path, int count, const cln_tensor *tensors,
                                 uint64_t *digest);

typedef struct cln_safetensors cln_safetensors;

/* Reads the whole file and checks structure (lengths, offsets in order and inside the file, dtypes,
 * shapes against byte counts, no overlap) and digest. CLN_CHECKPOINT names path and defect. */
cln_status cln_safetensors_read(const char *path, cln_safetensors **out);
void cln_safetensors_free(cln_safetensors *file); /* accepts NULL */

/* Digest of all tensors, as cln_safetensors_write gave it: of each, in the header's order, the
 * name, the dtype's name, the shape as int64 and the data, folded with cln_digest. */
uint64_t cln_safetensors_digest(const cln_safetensors *file);

/* Tensor by name; its data points into `file` and may be unaligned in files that others wrote: copy
 * it. CLN_CHECKPOINT if absent or of another dtype. */
cln_status cln_safetensors_get(const cln_safetensors *file, const char *name, cln_dtype dtype,
                               cln_tensor *out);

#endif
