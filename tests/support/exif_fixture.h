/* A JPEG with EXIF data, for tests of photos that viewers turn. */
#ifndef CLN_TESTS_EXIF_FIXTURE_H
#define CLN_TESTS_EXIF_FIXTURE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "io/image.h"

enum { EXIF_BYTES = 6 + 8 + 2 + 2 * 12 + 4, EXIF_SEGMENT = 4 + EXIF_BYTES };

static inline void exif_number(uint8_t *to, int bytes, bool little, uint32_t value)
{
    for (int i = 0; i < bytes; i++)
        to[little ? i : bytes - 1 - i] = (uint8_t)(value >> 8 * i);
}

/* The contents of an APP1 segment, by the EXIF standard: a directory of an image's description (of
 * two letters) and its orientation. */
static inline void exif_write(uint8_t out[EXIF_BYTES], bool little, int orientation)
{
    uint8_t *tiff = out + 6, *entry = tiff + 10;

    memset(out, 0, EXIF_BYTES);
    memcpy(out, "Exif", 4);
    memcpy(tiff, little ? "II" : "MM", 2);
    exif_number(tiff + 2, 2, little, 42);
    exif_number(tiff + 4, 4, little, 8);
    exif_number(tiff + 8, 2, little, 2);
    exif_number(entry, 2, little, 0x10e); /* ASCII, 3 bytes with the end */
    exif_number(entry + 2, 2, little, 2);
    exif_number(entry + 4, 4, little, 3);
    memcpy(entry + 8, "ab", 2);
    exif_number(entry + 12, 2, little, 0x112); /* SHORT */
    exif_number(entry + 14, 2, little, 3);
    exif_number(entry + 16, 4, little, 1);
    exif_number(entry + 20, 2, little, (uint32_t)orientation);
}

/* A TIFF file of a directory with nothing but the place of another, of a GPS position: letters of
 * the halves of the earth; latitude and longitude in degrees, minutes and seconds, and altitude,
 * each as its two numbers; below: the altitude is below the sea. */
enum { GPS_AT = 26, GPS_VALUES = 104, GPS_BYTES = GPS_VALUES + 7 * 8 };

static inline void exif_write_gps(uint8_t out[GPS_BYTES], bool little, const char halves[2],
                                  const uint32_t values[7][2], int below)
{
    static const uint32_t entries[6][3] = {{1, 2, 2},                       /* ASCII */
                                           {2, 5, 3}, {3, 2, 2}, {4, 5, 3}, /* RATIONAL */
                                           {5, 1, 1},                       /* BYTE */
                                           {6, 5, 1}};

    memset(out, 0, GPS_BYTES);
    memcpy(out, little ? "II" : "MM", 2);
    exif_number(out + 2, 2, little, 42);
    exif_number(out + 4, 4, little, 8);
    exif_number(out + 8, 2, little, 1);
    exif_number(out + 10, 2, little, 0x8825); /* LONG */
    exif_number(out + 12, 2, little, 4);
    exif_number(out + 14, 4, little, 1);
    exif_number(out + 18, 4, little, GPS_AT);
    exif_number(out + GPS_AT, 2, little, 6);
    for (int i = 0; i < 6; i++) {
        uint8_t *entry = out + GPS_AT + 2 + 12 * i;

        exif_number(entry, 2, little, entries[i][0]);
        exif_number(entry + 2, 2, little, entries[i][1]);
        exif_number(entry + 4, 4, little, entries[i][2]);
        if (entries[i][1] == 5)
            exif_number(entry + 8, 4, little, GPS_VALUES + 12 * (entries[i][0] - 2));
        else
            entry[8] = (uint8_t)(entries[i][1] == 1 ? below : halves[i / 2]);
    }
    for (int i = 0; i < 7; i++)
        for (int k = 0; k < 2; k++)
            exif_number(out + GPS_VALUES + 8 * i + 4 * k, 4, little, values[i][k]);
}

/* A JPEG of RGB pixels; orientation 0: without EXIF data. The caller frees it; NULL: no memory. */
static inline uint8_t *exif_jpeg(int width, int height, const uint8_t *pixels, int orientation,
                                 size_t *bytes)
{
    static const uint8_t head[] = {0xFF, 0xE1, 0, EXIF_BYTES + 2};
    uint8_t *plain = NULL, *out = NULL;

    if (cln_image_encode_jpeg(width, height, 3, pixels, 95, &plain, bytes) != CLN_OK ||
        orientation == 0)
        return plain;
    out = malloc(*bytes + EXIF_SEGMENT);
    if (out) {
        memcpy(out, plain, 2);
        memcpy(out + 2, head, 4);
        exif_write(out + 6, orientation % 2, orientation);
        memcpy(out + 2 + EXIF_SEGMENT, plain + 2, *bytes - 2);
        *bytes += EXIF_SEGMENT;
    }
    free(plain);
    return out;
}

#endif
