/* safetensors files, written as a stream and read whole. See safetensors.h and docs/formats.md.
 *
 *   u64 LE N | N bytes of JSON, padded with spaces: data start at a multiple of 8 | data
 *
 * Reading trusts nothing: every length is compared with the file's before use, tensors must cover
 * the data section without holes or overlap (the format's rule), and the digest must agree. Hosts
 * are little-endian (asserted); no byte order is converted. */
#include "io/safetensors.h"

#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "base/files.h"
#include "base/memory.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "tensor data is written as it stands");

enum { LENGTH_BYTES = 8, MAX_HEADER = 1 << 24, MAX_DIMS = 4 };

static const struct {
    const char *name;
    size_t bytes;
} dtypes[] = {[CLN_DTYPE_F32] = {"F32", 4},
              [CLN_DTYPE_I32] = {"I32", 4},
              [CLN_DTYPE_U16] = {"U16", 2},
              [CLN_DTYPE_U8] = {"U8", 1},
              [CLN_DTYPE_BF16] = {"BF16", 2}};
enum { DTYPES = sizeof dtypes / sizeof dtypes[0] };

struct cln_safetensors {
    char *path;
    char *bytes;    /* the whole file */
    json_t *header; /* owns the names */
    int count;
    cln_tensor *tensors; /* in the order of their data */
    uint64_t digest;
};

size_t cln_tensor_bytes(const cln_tensor *tensor)
{
    size_t bytes = dtypes[tensor->dtype].bytes;

    for (int i = 0; i < tensor->dims; i++)
        bytes *= (size_t)tensor->shape[i];
    return bytes;
}

void cln_safetensors_digest_begin(const cln_tensor *t, uint64_t digest, cln_digest_part *out)
{
    const char *type = dtypes[t->dtype].name;

    digest = cln_digest(digest, t->name, strlen(t->name));
    digest = cln_digest(digest, type, strlen(type));
    digest = cln_digest(digest, t->shape, (size_t)t->dims * sizeof t->shape[0]);
    cln_digest_begin(out, digest);
}

/* Digest of names, types, shapes and data, to expose a flipped bit in header or data. */
static uint64_t digest_of(int count, const cln_tensor *tensors)
{
    uint64_t digest = CLN_DIGEST_START;
    cln_digest_part part;

    for (int i = 0; i < count; i++) {
        cln_safetensors_digest_begin(&tensors[i], digest, &part);
        cln_digest_more(&part, tensors[i].data, cln_tensor_bytes(&tensors[i]));
        digest = cln_digest_end(&part);
    }
    return digest;
}

/* *text = the header, padded; the caller frees it. */
static cln_status make_header(int count, const cln_tensor *tensors, uint64_t digest, char **text)
{
    cln_status st = CLN_OK;
    json_t *header = json_object();
    char *dump = NULL, hex[CLN_DIGEST_TEXT];
    size_t offset = 0, length = 0;
    int failed = 0;

    cln_digest_text(digest, hex);
    failed |= json_object_set_new(header, "__metadata__", json_pack("{s:s}", "digest", hex));
    for (int i = 0; i < count; i++) {
        const cln_tensor *t = &tensors[i];
        size_t end = offset + cln_tensor_bytes(t);
        json_t *shape = json_array();
        for (int k = 0; k < t->dims; k++)
            failed |= json_array_append_new(shape, json_integer(t->shape[k]));
        failed |= json_object_set_new(
            header, t->name,
            json_pack("{s:s, s:o, s:[I,I]}", "dtype", dtypes[t->dtype].name, "shape", shape,
                      "data_offsets", (json_int_t)offset, (json_int_t)end));
        offset = end;
    }
    if (!failed)
        dump = json_dumps(header, JSON_COMPACT);
    if (!dump)
        CLN_TRY(cln_fail(CLN_MEMORY, "safetensors header: out of host memory"));
    length = strlen(dump);
    CLN_TRY(cln_asprintf(text, "%s%*s", dump, (int)((8 - length % 8) % 8), ""));
done:
    free(dump);
    json_decref(header);
    return st;
}

cln_status cln_safetensors_head(int count, const cln_tensor *tensors, uint64_t digest, char **head,
                                size_t *bytes, size_t *offsets)
{
    cln_status st = CLN_OK;
    char *header = NULL;
    uint64_t length = 0;

    CLN_TRY(make_header(count, tensors, digest, &header));
    length = strlen(header);
    CLN_TRY(cln_alloc(head, LENGTH_BYTES + length, 1, "safetensors header"));
    memcpy(*head, &length, LENGTH_BYTES);
    memcpy(*head + LENGTH_BYTES, header, length);
    *bytes = LENGTH_BYTES + length;
    for (size_t i = 0, at = *bytes; offsets && i < (size_t)count; i++) {
        offsets[i] = at;
        at += cln_tensor_bytes(&tensors[i]);
    }
done:
    free(header);
    return st;
}

cln_status cln_safetensors_write(const char *path, int count, const cln_tensor *tensors,
                                 uint64_t *digest)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char *head = NULL;
    size_t bytes = 0;
    const uint64_t data_digest = digest_of(count, tensors);

    CLN_TRY(cln_safetensors_head(count, tensors, data_digest, &head, &bytes, NULL));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, head, bytes));
    for (int i = 0; i < count; i++)
        CLN_TRY(cln_atomic_write(file, tensors[i].data, cln_tensor_bytes(&tensors[i])));
    CLN_TRY(cln_atomic_commit(&file));
    if (digest)
        *digest = data_digest;
done:
    cln_atomic_abandon(file);
    free(head);
    return st;
}

/* Reads an entry of the header; size: bytes of the data section. Returns NULL, or the defect. */
static const char *read_entry(const json_t *entry, const char *data, size_t size, cln_tensor *out)
{
    const json_t *shape = json_object_get(entry, "shape");
    const json_t *offsets = json_object_get(entry, "data_offsets");
    const char *dtype = json_string_value(json_object_get(entry, "dtype"));
    json_int_t begin = 0, end = 0;
    size_t bytes = 0;
    int type = 0;

    while (dtype && type < DTYPES && strcmp(dtypes[type].name, dtype) != 0)
        type++;
    if (!dtype || type == DTYPES)
        return "its dtype is not F32, I32, U16, U8 or BF16";
    if (!json_is_array(shape) || json_array_size(shape) > MAX_DIMS)
        return "its shape is not a list of up to 4 numbers";
    out->dtype = (cln_dtype)type;
    out->dims = (int)json_array_size(shape);
    bytes = dtypes[type].bytes;
    for (int k = 0; k < out->dims; k++) {
        const json_t *side = json_array_get(shape, (size_t)k);
        if (!json_is_integer(side) || json_integer_value(side) < 0)
            return "its shape is not a list of whole numbers from 0 on";
        out->shape[k] = json_integer_value(side);
        /* An empty tensor may have any sides; another one cannot be larger than the file. */
        if (out->shape[k] != 0 && bytes > size / (uint64_t)out->shape[k])
            bytes = SIZE_MAX;
        else
            bytes *= (size_t)out->shape[k];
    }
    if (json_array_size(offsets) != 2 || !json_is_integer(json_array_get(offsets, 0)) ||
        !json_is_integer(json_array_get(offsets, 1)))
        return "its data_offsets are not two whole numbers";
    begin = json_integer_value(json_array_get(offsets, 0));
    end = json_integer_value(json_array_get(offsets, 1));
    if (begin < 0 || end < begin || (uint64_t)end > size)
        return "its data_offsets lie outside the file";
    if ((uint64_t)(end - begin) != bytes)
        return "its data_offsets do not agree with its shape";
    out->data = data + begin;
    return NULL;
}

static int by_offset(const void *a, const void *b)
{
    const cln_tensor *x = a, *y = b;
    const char *p = x->data, *q = y->data;

    if (p != q)
        return p < q ? -1 : 1;
    return (cln_tensor_bytes(x) > 0) - (cln_tensor_bytes(y) > 0);
}

/* Parses length, header and data section; fills in file->header, file->tensors and the digest. */
static cln_status parse(cln_safetensors *file, size_t bytes, bool foreign)
{
    cln_status st = CLN_OK;
    const char *path = file->path, *data = NULL, *name = NULL, *wanted = NULL;
    uint64_t length = 0;
    size_t size = 0, covered = 0;
    json_error_t error;
    json_t *entry = NULL;
    char hex[CLN_DIGEST_TEXT];

    if (bytes >= LENGTH_BYTES)
        memcpy(&length, file->bytes, LENGTH_BYTES);
    if (bytes < LENGTH_BYTES || length > MAX_HEADER || length > bytes - LENGTH_BYTES)
        return cln_fail(CLN_CHECKPOINT,
                        "%s: %zu bytes with a header of %" PRIu64
                        ": truncated, or not a safetensors file",
                        path, bytes, length);
    data = file->bytes + LENGTH_BYTES + length;
    size = bytes - LENGTH_BYTES - (size_t)length;
    file->header =
        json_loadb(file->bytes + LENGTH_BYTES, (size_t)length, JSON_REJECT_DUPLICATES, &error);
    if (!json_is_object(file->header))
        return cln_fail(CLN_CHECKPOINT, "%s: its header is not a JSON object: %s", path,
                        file->header ? "another kind of value" : error.text);
    CLN_TRY(cln_alloc(&file->tensors, json_object_size(file->header), sizeof *file->tensors, path));
    json_object_foreach(file->header, name, entry)
    {
        const char *defect = NULL;
        cln_tensor *tensor = &file->tensors[file->count];
        if (strcmp(name, "__metadata__") == 0)
            continue;
        defect = read_entry(entry, data, size, tensor);
        if (defect)
            CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: tensor '%s': %s", path, name, defect));
        tensor->name = name;
        file->count++;
    }
    file->digest = digest_of(file->count, file->tensors);
    qsort(file->tensors, (size_t)file->count, sizeof *file->tensors, by_offset);
    for (int i = 0; i < file->count; i++) {
        if ((const char *)file->tensors[i].data != data + covered)
            CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: tensor '%s' overlaps another or leaves a hole",
                             path, file->tensors[i].name));
        covered += cln_tensor_bytes(&file->tensors[i]);
    }
    if (covered != size)
        CLN_TRY(
            cln_fail(CLN_CHECKPOINT, "%s: %zu bytes follow the last tensor", path, size - covered));
    wanted =
        json_string_value(json_object_get(json_object_get(file->header, "__metadata__"), "digest"));
    cln_digest_text(file->digest, hex);
    if (wanted ? strcmp(wanted, hex) != 0 : !foreign)
        CLN_TRY(cln_fail(CLN_CHECKPOINT,
                         "%s: its tensors have digest %s, its header says %s: damaged", path, hex,
                         wanted ? wanted : "none"));
done:
    return st;
}

static cln_status read_file(const char *path, bool foreign, cln_safetensors **out)
{
    cln_status st = CLN_OK;
    cln_safetensors *file = NULL;
    size_t bytes = 0;

    *out = NULL;
    CLN_TRY(cln_alloc(&file, 1, sizeof *file, path));
    CLN_TRY(cln_strdup(&file->path, path));
    CLN_TRY(cln_read_file(path, SIZE_MAX / 4, &file->bytes, &bytes));
    CLN_TRY(parse(file, bytes, foreign));
    *out = file;
    file = NULL;
done:
    cln_safetensors_free(file);
    return st;
}

cln_status cln_safetensors_read(const char *path, cln_safetensors **out)
{
    return read_file(path, false, out);
}

cln_status cln_safetensors_read_foreign(const char *path, cln_safetensors **out)
{
    cln_status st = read_file(path, true, out);

    if (st == CLN_CHECKPOINT) { /* which it is not */
        char text[1024];

        snprintf(text, sizeof text, "%s", cln_error_text());
        cln_clear_error();
        st = cln_fail(CLN_INPUT, "%s", text);
    }
    return st;
}

void cln_safetensors_free(cln_safetensors *file)
{
    if (!file)
        return;
    json_decref(file->header);
    free(file->tensors);
    free(file->bytes);
    free(file->path);
    free(file);
}

uint64_t cln_safetensors_digest(const cln_safetensors *file)
{
    return file->digest;
}

bool cln_safetensors_has(const cln_safetensors *file, const char *name)
{
    for (int i = 0; i < file->count; i++)
        if (strcmp(file->tensors[i].name, name) == 0)
            return true;
    return false;
}

bool cln_safetensors_fits_header(const char *path)
{
    FILE *file = fopen(path, "rb");
    uint8_t count[LENGTH_BYTES] = {0};
    uint64_t length = 0;
    json_int_t end = 0;
    json_t *header = NULL, *entry = NULL;
    char *text = NULL;
    const char *name = NULL;
    struct stat info = {0};

    if (file && fstat(fileno(file), &info) == 0 &&
        fread(count, 1, LENGTH_BYTES, file) == LENGTH_BYTES)
        for (int i = 0; i < LENGTH_BYTES; i++)
            length |= (uint64_t)count[i] << 8 * i;
    if (length > 0 && length <= MAX_HEADER && length < (uint64_t)info.st_size)
        text = malloc((size_t)length);
    if (text && fread(text, 1, (size_t)length, file) == (size_t)length)
        header = json_loadb(text, (size_t)length, 0, NULL);
    json_object_foreach(header, name, entry)
    {
        const json_t *to = json_array_get(json_object_get(entry, "data_offsets"), 1);

        end = json_integer_value(to) > end ? json_integer_value(to) : end;
    }
    if (file)
        fclose(file);
    free(text);
    json_decref(header);
    return end > 0 && (int64_t)end == (int64_t)info.st_size - LENGTH_BYTES - (int64_t)length;
}

cln_status cln_safetensors_get(const cln_safetensors *file, const char *name, cln_dtype dtype,
                               cln_tensor *out)
{
    for (int i = 0; i < file->count; i++) {
        if (strcmp(file->tensors[i].name, name) != 0)
            continue;
        if (file->tensors[i].dtype != dtype)
            return cln_fail(CLN_CHECKPOINT, "%s: tensor '%s' is of type %s, not %s", file->path,
                            name, dtypes[file->tensors[i].dtype].name, dtypes[dtype].name);
        *out = file->tensors[i];
        return CLN_OK;
    }
    return cln_fail(CLN_CHECKPOINT, "%s: no tensor '%s' in it", file->path, name);
}
