/* NumPy .npy files of float32. The format (numpy.lib.format, version 1.0):
 *   "\x93NUMPY" 1 0 | u16 header length | header: a Python dict as text, padded with spaces to a
 *   multiple of 64 and ended by a newline | data, C order
 * Reads only that; not .npz, other types, or Fortran order. */
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
static const size_t MAX_BYTES = (size_t)1 << 31;

static const char magic[8] = {(char)0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0};

/* Number of elements, or false if negative or beyond the limit. */
static bool element_count(int dims, const int *shape, size_t *count)
{
    *count = 1;
    for (int i = 0; i < dims; i++) {
        if (shape[i] < 0 || (shape[i] && *count > MAX_BYTES / sizeof(float) / (size_t)shape[i]))
            return false;
        *count *= (size_t)shape[i];
    }
    return true;
}

cln_status cln_npy_write_f32(const char *path, int dims, const int *shape, const float *data)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL, *finished = NULL;
    char header[PREFIX_BYTES + HEADER_MAX];
    size_t used = PREFIX_BYTES, padded = 0, count = 0;

    CLN_ASSERT(dims >= 0 && dims <= MAX_DIMS);
    if (!element_count(dims, shape, &count))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: array too large for a .npy file of ours", path));
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
    CLN_TRY(cln_atomic_write(file, data, count * sizeof(float)));
    finished = file;
    file = NULL;
    CLN_TRY(cln_atomic_commit(finished));
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

cln_status cln_npy_read_f32(const char *path, int *dims, int shape[4], float **data)
{
    cln_status st = CLN_OK;
    char *file = NULL;
    char header[HEADER_MAX + 1];
    const char *descr = NULL, *order = NULL, *extent = NULL;
    size_t bytes = 0, length = 0, count = 0;

    *data = NULL;
    CLN_TRY(cln_read_file(path, MAX_BYTES + PREFIX_BYTES + HEADER_MAX, &file, &bytes));
    if (bytes < PREFIX_BYTES || memcmp(file, magic, sizeof magic) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: not a .npy file of version 1.0", path));
    length = (size_t)(uint8_t)file[8] | (size_t)(uint8_t)file[9] << 8;
    if (length > HEADER_MAX || length > bytes - PREFIX_BYTES)
        CLN_TRY(
            cln_fail(CLN_INPUT, "%s: .npy header of %zu bytes is cut or too long", path, length));
    memcpy(header, file + PREFIX_BYTES, length);
    header[length] = 0;
    descr = value_of(header, "'descr'");
    order = value_of(header, "'fortran_order'");
    extent = value_of(header, "'shape'");
    if (!descr || !order || !extent)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: .npy header lacks descr, fortran_order or shape", path));
    if (strncmp(descr, "'<f4'", 5) != 0 || strncmp(order, "False", 5) != 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: only little-endian float32 in C order is read; save the array with "
                         "numpy.ascontiguousarray(a, '<f4')",
                         path));
    if (!parse_shape(extent, dims, shape) || !element_count(*dims, shape, &count))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: .npy shape is not up to %d sizes within 2^31 bytes", path,
                         MAX_DIMS));
    if (bytes - PREFIX_BYTES - length != count * sizeof(float))
        CLN_TRY(cln_fail(
            CLN_INPUT, "%s: %zu bytes of data where the shape needs %zu; the file is %s", path,
            bytes - PREFIX_BYTES - length, count * sizeof(float),
            bytes - PREFIX_BYTES - length < count * sizeof(float) ? "truncated" : "too long"));
    CLN_TRY(cln_alloc(data, count, sizeof(float), path));
    memcpy(*data, file + PREFIX_BYTES + length, count * sizeof(float));
done:
    free(file);
    return st;
}
