/* PNG of 16 bits a value, through zlib. See png16.h. */
#include "io/png16.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/files.h"
#include "base/memory.h"

static const size_t CHUNK = (size_t)1 << 30; /* a chunk has less than 2^31 bytes */

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

/* A byte for the filter (1: differences from the pixel before), then big-endian numbers. */
static void fill_row(int width, int channels, const uint16_t *values, uint8_t *row)
{
    const int bytes = 2 * channels;

    *row++ = 1;
    for (int i = 0; i < width * channels; i++) {
        row[2 * i] = (uint8_t)(values[i] >> 8);
        row[2 * i + 1] = (uint8_t)values[i];
    }
    for (int i = bytes * width - 1; i >= bytes; i--)
        row[i] = (uint8_t)(row[i] - row[i - bytes]);
}

cln_status cln_png16_write(const char *path, int width, int height, int channels,
                           const uint16_t *values)
{
    static const uint8_t signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
    static const uint8_t kinds[5] = {0, 0, 0, 2, 6}; /* by channels: grey, RGB, RGBA */
    cln_status st = CLN_OK;
    const size_t numbers = (size_t)width * (size_t)channels, row = 2 * numbers + 1;
    const size_t bytes = (size_t)height * row;
    uint8_t *rows = NULL, *packed = NULL, about[13] = {0};
    uLongf size = compressBound((uLong)bytes);
    cln_atomic_file *file = NULL;

    CLN_TRY(cln_alloc(&rows, bytes, 1, "picture"));
    CLN_TRY(cln_alloc(&packed, size, 1, "picture"));
    for (int y = 0; y < height; y++)
        fill_row(width, channels, values + (size_t)y * numbers, rows + (size_t)y * row);
    if (compress2(packed, &size, rows, (uLong)bytes, 6) != Z_OK)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot be compressed", path));
    put_u32(about, (uint32_t)width);
    put_u32(about + 4, (uint32_t)height);
    about[8] = 16;
    about[9] = kinds[channels];
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, signature, sizeof signature));
    CLN_TRY(write_chunk(file, "IHDR", about, sizeof about));
    for (size_t at = 0; at < size; at += CHUNK)
        CLN_TRY(write_chunk(file, "IDAT", packed + at, size - at < CHUNK ? size - at : CHUNK));
    CLN_TRY(write_chunk(file, "IEND", NULL, 0));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    free(rows);
    free(packed);
    return st;
}
