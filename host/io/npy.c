/* NumPy .npy files. The format (numpy.lib.format, version 1.0):
 *   "\x93NUMPY" 1 0 | u16 header length | header: a Python dict as text, padded with spaces to a
 *   multiple of 64 and ended by a newline | data
 * Does not read .npz (see npz.c), records, strings, complex or big-endian numbers. */
#include "io/npy.h"

#include <stdlib.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"

/* Data are written as they are in memory. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "npy.c is for little-endian hosts");

enum { MAX_DIMS = 4, PREFIX_BYTES = 10, HEADER_MAX = 1024 };

static const char magic[8] = {(char)0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0};

/* Number of elements, or false if negative or beyond the limit. */
static bool element_count(int dims, const int *shape, size_t *count)
{
    *count = 1;
    for (int i = 0; i < dims; i++) {
        if (shape[i] < 0 ||
            (shape[i] && *count > CLN_NPY_MAX_BYTES / sizeof(float) / (size_t)shape[i]))
            return false;
        *count *= (size_t)shape[i];
    }
    return true;
}

cln_status cln_npy_begin_f32(const char *path, int dims, const int *shape, cln_atomic_file **out)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char header[PREFIX_BYTES + HEADER_MAX];
    size_t used = PREFIX_BYTES, padded = 0;

    *out = NULL;
    CLN_ASSERT(dims >= 0 && dims <= MAX_DIMS);
    memcpy(header, magic, sizeof magic);
    used += (size_t)snprintf(header + used, HEADER_MAX,
                             "{'descr': '<f4', 'fortran_order': False, 'shape': (");
    for (int i = 0; i < dims; i++) /* (3,) and (2, 3): a lone dimension keeps its comma */
        used += (size_t)snprintf(header + used, sizeof header - used, "%d%s", shape[i],
                                 i + 1 < dims ? ", "
                                 : dims == 1  ? ","
                                              : "");
    used += (size_t)snprintf(header + used, sizeof header - used, "), }");
    padded = (used + 1 + 63) / 64 * 64;
    memset(header + used, ' ', padded - used);
    header[padded - 1] = '\n';
    header[8] = (char)((padded - PREFIX_BYTES) & 255);
    header[9] = (char)((padded - PREFIX_BYTES) >> 8);

    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, header, padded));
    *out = file;
    file = NULL;
done:
    cln_atomic_abandon(file);
    return st;
}

cln_status cln_npy_write_f32(const char *path, int dims, const int *shape, const float *data)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    size_t count = 0;

    CLN_ASSERT(dims >= 0 && dims <= MAX_DIMS);
    if (!element_count(dims, shape, &count))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: the array is larger than the 2^31 bytes that are written",
                         path));
    CLN_TRY(cln_npy_begin_f32(path, dims, shape, &file));
    CLN_TRY(cln_atomic_write(file, data, count * sizeof(float)));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}

/* Text after "'key':" and blanks, or NULL. */
static const char *value_of(const char *header, const char *key)
{
    const char *p = strstr(header, key);

    if (!p)
        return NULL;
    p += strlen(key);
    p += strspn(p, " ");
    if (*p != ':')
        return NULL;
    return p + 1 + strspn(p + 1, " ");
}

/* "(2, 3)" -> shape; false if it is anything else. */
static bool parse_shape(const char *text, int *dims, int shape[MAX_DIMS])
{
    *dims = 0;
    if (*text++ != '(')
        return false;
    for (;;) {
        char *end = NULL;
        long value = 0;

        text += strspn(text, " ");
        if (*text == ')')
            return true;
        if (*text < '0' || *text > '9' || *dims == MAX_DIMS)
            return false;
        value = strtol(text, &end, 10);
        if (value > INT32_MAX)
            return false;
        shape[(*dims)++] = (int)value;
        text = end + strspn(end, " ");
        if (*text == ',')
            text++;
        else if (*text != ')')
            return false;
    }
}

/* A header's contents; `data`: the `bytes` bytes after it. */
typedef struct array {
    const char *type, *order; /* in `header` */
    char header[HEADER_MAX + 1];
    int *dims, *shape;
    size_t count;
    const char *data;
    size_t bytes;
} array;

static cln_status read_header(const char *path, const char *file, size_t bytes, array *a)
{
    const char *extent = NULL;
    size_t length = 0;

    if (bytes < PREFIX_BYTES || memcmp(file, magic, sizeof magic) != 0)
        return cln_fail(CLN_INPUT, "%s: not a .npy file of version 1.0; save it with numpy.save",
                        path);
    length = (size_t)(uint8_t)file[8] | (size_t)(uint8_t)file[9] << 8;
    if (length > HEADER_MAX || length > bytes - PREFIX_BYTES)
        return cln_fail(CLN_INPUT,
                        "%s: .npy header of %zu bytes is cut or too long; copy or save it again",
                        path, length);
    memcpy(a->header, file + PREFIX_BYTES, length);
    a->header[length] = 0;
    a->type = value_of(a->header, "'descr'");
    a->order = value_of(a->header, "'fortran_order'");
    extent = value_of(a->header, "'shape'");
    if (!a->type || !a->order || !extent)
        return cln_fail(
            CLN_INPUT,
            "%s: .npy header lacks descr, fortran_order or shape; save it with numpy.save", path);
    if (!parse_shape(extent, a->dims, a->shape) || !element_count(*a->dims, a->shape, &a->count))
        return cln_fail(CLN_INPUT,
                        "%s: .npy shape is not a list of at most %d sizes, or has over 2^31 bytes; "
                        "save a smaller array",
                        path, MAX_DIMS);
    a->data = file + PREFIX_BYTES + length;
    a->bytes = bytes - PREFIX_BYTES - length;
    return CLN_OK;
}

static cln_status check_bytes(const char *path, const array *a, size_t element)
{
    if (a->bytes == a->count * element)
        return CLN_OK;
    return cln_fail(
        CLN_INPUT,
        "%s: %zu bytes of data where the shape needs %zu: the file is %s; copy or save it again",
        path, a->bytes, a->count * element,
        a->bytes < a->count * element ? "truncated" : "too long");
}

cln_status cln_npy_read_f32(const char *path, int *dims, int shape[4], float **data)
{
    cln_status st = CLN_OK;
    char *file = NULL;
    size_t bytes = 0;
    array a = {.dims = dims, .shape = shape};

    *data = NULL;
    CLN_TRY(cln_read_file(path, CLN_NPY_MAX_BYTES + PREFIX_BYTES + HEADER_MAX, &file, &bytes));
    CLN_TRY(read_header(path, file, bytes, &a));
    if (strncmp(a.type, "'<f4'", 5) != 0 || strncmp(a.order, "False", 5) != 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: only little-endian float32 in C order is read; save the array with "
                         "numpy.ascontiguousarray(a, '<f4')",
                         path));
    CLN_TRY(check_bytes(path, &a, sizeof(float)));
    CLN_TRY(cln_alloc(data, a.count, sizeof(float), path));
    memcpy(*data, a.data, a.bytes);
done:
    free(file);
    return st;
}

static double element_at(const array *a, bool is_double, size_t index)
{
    double wide = 0;
    float narrow = 0;

    if (is_double)
        memcpy(&wide, a->data + index * sizeof wide, sizeof wide);
    else
        memcpy(&narrow, a->data + index * sizeof narrow, sizeof narrow);
    return is_double ? wide : (double)narrow;
}

cln_status cln_npy_decode(const char *path, const char *file, size_t bytes, int *dims, int shape[4],
                          double **data)
{
    cln_status st = CLN_OK;
    array a = {.dims = dims, .shape = shape};
    bool is_double = false, fortran = false;

    *data = NULL;
    CLN_TRY(read_header(path, file, bytes, &a));
    is_double = !strncmp(a.type, "'<f8'", 5);
    fortran = !strncmp(a.order, "True", 4);
    if (!is_double && strncmp(a.type, "'<f4'", 5) != 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: only little-endian float32 and float64 are read; save the array with "
                         "a.astype('<f8')",
                         path));
    CLN_TRY(check_bytes(path, &a, is_double ? sizeof(double) : sizeof(float)));
    CLN_TRY(cln_alloc(data, a.count, sizeof **data, path));
    for (size_t i = 0; i < a.count; i++) {
        size_t from = 0, rest = i, stride = a.count;

        /* i counts in C order, last index fastest; in Fortran order the first index is fastest. */
        for (int k = *dims - 1; fortran && k >= 0; k--) {
            stride /= (size_t)shape[k];
            from += rest % (size_t)shape[k] * stride;
            rest /= (size_t)shape[k];
        }
        (*data)[i] = element_at(&a, is_double, fortran ? from : i);
    }
done:
    return st;
}
