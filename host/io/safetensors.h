/* safetensors files: 8-byte little-endian header length, a JSON header {name: {dtype, shape,
 * data_offsets}}, then raw little-endian data; numpy and torch read them. Written as a stream,
 * atomically; read whole. docs/formats.md has the layout byte by byte. "__metadata__" holds the
 * content's "digest" (16 hex digits, cln_safetensors_digest). Reading checks it: a damaged file is
 * CLN_CHECKPOINT, never used. */
#ifndef CLN_SAFETENSORS_H
#define CLN_SAFETENSORS_H

#include <stddef.h>
#include <stdint.h>
#include "base/files.h"
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
    const void *data; /* host memory, little-endian like the host */
} cln_tensor;

/* Bytes of one tensor's data. */
size_t cln_tensor_bytes(const cln_tensor *tensor);

/* Writes all tensors in order; *digest (may be NULL): their digest. CLN_OUTPUT. */
cln_status cln_safetensors_write(const char *path, int count, const cln_tensor *tensors,
                                 uint64_t *digest);

/* For callers that write such a file in pieces. Head: *head is the file up to the data, *bytes long
 * whatever the digest; tensor i's data begin at offsets[i] (may be NULL); the caller frees *head.
 * Digest: begins a tensor's part of the digest; the caller adds its data. CLN_MEMORY. */
cln_status cln_safetensors_head(int count, const cln_tensor *tensors, uint64_t digest, char **head,
                                size_t *bytes, size_t *offsets);
void cln_safetensors_digest_begin(const cln_tensor *tensor, uint64_t digest, cln_digest_part *out);

typedef struct cln_safetensors cln_safetensors;

/* Reads the whole file and checks structure (lengths, offsets in order and inside the file, dtypes,
 * shapes against byte counts, no overlap) and digest. CLN_CHECKPOINT names path and defect. */
cln_status cln_safetensors_read(const char *path, cln_safetensors **out);
/* The same of another program's file, which need not have a digest. CLN_INPUT. */
cln_status cln_safetensors_read_foreign(const char *path, cln_safetensors **out);
void cln_safetensors_free(cln_safetensors *file); /* accepts NULL */

/* Is the file as long as its header says? What is in it is not looked at, which takes long. */
bool cln_safetensors_fits_header(const char *path);

/* Digest of all tensors, the one cln_safetensors_write gave: cln_digest over each one's name,
 * dtype's name, shape as int64 and data, in the header's order. */
uint64_t cln_safetensors_digest(const cln_safetensors *file);

/* Finds a tensor by name. Its data point into `file`, unaligned perhaps in other programs' files:
 * copy them. CLN_CHECKPOINT if absent or of another dtype. */
cln_status cln_safetensors_get(const cln_safetensors *file, const char *name, cln_dtype dtype,
                               cln_tensor *out);
bool cln_safetensors_has(const cln_safetensors *file, const char *name);

#endif
