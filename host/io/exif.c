/* EXIF is a TIFF file in a JPEG's APP1 segment, or in a PNG's eXIf chunk: a header with the byte
 * order and the place of the first directory, whose entries of 12 bytes are tag, type, count and
 * value. See exif.h. */
#include "io/exif.h"

#include <stdbool.h>
#include <string.h>

enum { HEADER = 8, ENTRY = 12, ORIENTATION = 0x112, SHORT = 3 };

static uint32_t number(const uint8_t *p, int bytes, bool little)
{
    uint32_t value = 0;

    for (int i = 0; i < bytes; i++)
        value = value << 8 | p[little ? bytes - 1 - i : i];
    return value;
}

int cln_exif_orientation(const uint8_t *data, size_t bytes)
{
    if (bytes < 6 || memcmp(data, "Exif\0", 6) != 0)
        return 1;
    return cln_exif_tiff_orientation(data + 6, bytes - 6);
}

int cln_exif_tiff_orientation(const uint8_t *tiff, size_t bytes)
{
    size_t at = 0, entries = 0;
    bool little = false;

    if (bytes < HEADER)
        return 1;
    little = tiff[0] == 'I';
    if (tiff[0] != tiff[1] || (tiff[0] != 'I' && tiff[0] != 'M') ||
        number(tiff + 2, 2, little) != 42)
        return 1;
    at = number(tiff + 4, 4, little);
    if (at > bytes - 2)
        return 1;
    entries = number(tiff + at, 2, little);
    at += 2;
    for (size_t i = 0; i < entries && bytes - at >= ENTRY; i++, at += ENTRY) {
        const uint32_t value = number(tiff + at + 8, 2, little);

        if (number(tiff + at, 2, little) == ORIENTATION)
            return number(tiff + at + 2, 2, little) == SHORT &&
                           number(tiff + at + 4, 4, little) == 1 && value >= 1 && value <= 8
                       ? (int)value
                       : 1;
    }
    return 1;
}
