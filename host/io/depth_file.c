/* Depth files. See depth_file.h. */
#include "io/depth_file.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/files.h"
#include "base/memory.h"

/* Numbers are written as they are in memory. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "PFM of little-endian hosts");

static void put_u32(uint8_t out[4], uint32_t value)
{
    for (int i = 0; i < 4; i++)
        out[i] = (uint8_t)(value >> (24 - 8 * i));
}

static cln_status write_chunk(cln_atomic_file *file, const char *kind, const uint8_t *data,
                              size_t bytes)
{
    cln_status st = CLN_OK;
    uint8_t head[8], sum[4];
    uLong crc = 0;

    put_u32(head, (uint32_t)bytes);
    memcpy(head + 4, kind, 4);
    crc = crc32(0, head + 4, 4);
    if (bytes > 0)
        crc = crc32(crc, data, (uInt)bytes);
    put_u32(sum, (uint32_t)crc);
    CLN_TRY(cln_atomic_write(file, head, sizeof head));
    if (bytes > 0)
        CLN_TRY(cln_atomic_write(file, data, bytes));
    CLN_TRY(cln_atomic_write(file, sum, sizeof sum));
done:
    return st;
}

/* Fills PNG rows: a byte for the filter (0, none), then big-endian numbers. Returns how many pixels
 * are beyond 65535 units; *behind: how many are negative. */
static int fill_rows(int width, int height, const float *depth, double unit, uint8_t *rows,
                     int *behind)
{
    int beyond = 0;

    *behind = 0;
    for (int y = 0; y < height; y++) {
        *rows++ = 0;
        for (int x = 0; x < width; x++) {
            const double steps = round(*depth++ / unit);
            const unsigned value = steps > 0 ? (unsigned)fmin(steps, 65535) : 0;

            beyond += steps > 65535;
            *behind += steps < 0;
            *rows++ = (uint8_t)(value >> 8);
            *rows++ = (uint8_t)value;
        }
    }
    return beyond;
}

cln_status cln_depth_write_png16(const char *path, int width, int height, const float *depth,
                                 double unit, int *beyond, int *behind)
{
    static const uint8_t signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
    cln_status st = CLN_OK;
    const size_t bytes = (size_t)height * (2 * (size_t)width + 1);
    uint8_t *rows = NULL, *packed = NULL, about[13] = {0};
    uLongf size = compressBound((uLong)bytes);
    cln_atomic_file *file = NULL;
    int over = 0, under = 0;

    CLN_TRY(cln_alloc(&rows, bytes, 1, "depth"));
    CLN_TRY(cln_alloc(&packed, size, 1, "depth"));
    over = fill_rows(width, height, depth, unit, rows, &under);
    if (compress2(packed, &size, rows, (uLong)bytes, 6) != Z_OK)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot be compressed", path));
    put_u32(about, (uint32_t)width);
    put_u32(about + 4, (uint32_t)height);
    about[8] = 16; /* bits; grey, the rest 0 */
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, signature, sizeof signature));
    CLN_TRY(write_chunk(file, "IHDR", about, sizeof about));
    CLN_TRY(write_chunk(file, "IDAT", packed, size));
    CLN_TRY(write_chunk(file, "IEND", NULL, 0));
    CLN_TRY(cln_atomic_commit(&file));
    if (beyond)
        *beyond = over;
    if (behind)
        *behind = under;
done:
    cln_atomic_abandon(file);
    free(rows);
    free(packed);
    return st;
}

cln_status cln_depth_write_pfm(const char *path, int width, int height, const float *depth)
{
    cln_status st = CLN_OK;
    char head[64];
    const int bytes = snprintf(head, sizeof head, "Pf\n%d %d\n-1.0\n", width, height);
    cln_atomic_file *file = NULL;

    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, head, (size_t)bytes));
    for (int y = height - 1; y >= 0; y--)
        CLN_TRY(cln_atomic_write(file, depth + (size_t)y * (size_t)width,
                                 (size_t)width * sizeof *depth));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
