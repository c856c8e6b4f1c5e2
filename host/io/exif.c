/* EXIF is a TIFF file in a JPEG's APP1 segment, or in a PNG's eXIf chunk: a header with the byte
 * order and the place of the first directory, whose entries of 12 bytes are tag, type, count and
 * value. One of them has the place of a second directory, of how the picture was taken, and that
 * one the place of a third, of how files are exchanged; a fourth is of the place by GPS. See
 * exif.h. */
#include "io/exif.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { HEADER = 8, ENTRY = 12 };
enum { BYTE = 1, ASCII = 2, SHORT = 3, LONG = 4, RATIONAL = 5 };
enum {
    ORIENTATION = 0x112,
    TAKEN = 0x8769,
    FOCAL_LENGTH = 0x920A,
    ZOOM = 0xA404,
    FOCAL_LENGTH_FILM = 0xA405
};
enum { GPS = 0x8825, LATITUDE_OF = 1, LATITUDE, LONGITUDE_OF, LONGITUDE, ALTITUDE_OF, ALTITUDE };
enum { COLOUR_SPACE = 0xA001, UNCALIBRATED = 0xFFFF, EXCHANGED = 0xA005, RULE = 1 };

static const cln_exif nothing = {.orientation = 1, .zoom = 1, .gps = {NAN, NAN, NAN}};

typedef struct tiff {
    const uint8_t *data;
    size_t bytes; /* at least HEADER */
    bool little;
} tiff;

static uint32_t number(const tiff *t, size_t at, int bytes)
{
    uint32_t value = 0;

    for (int i = 0; i < bytes; i++)
        value = value << 8 | t->data[at + (size_t)(t->little ? bytes - 1 - i : i)];
    return value;
}

/* The first entry of a directory with this tag, if it has so many values of this type. */
static bool find_entry(const tiff *t, size_t at, uint32_t tag, uint32_t type, uint32_t count,
                       size_t *entry)
{
    size_t entries = 0;

    if (at > t->bytes - 2)
        return false;
    entries = number(t, at, 2);
    at += 2;
    for (size_t i = 0; i < entries && t->bytes - at >= ENTRY; i++, at += ENTRY)
        if (number(t, at, 2) == tag) {
            *entry = at;
            return number(t, at + 2, 2) == type && number(t, at + 4, 4) == count;
        }
    return false;
}

/* The value of such an entry, if it is one number: of a rational, its place. */
static bool find(const tiff *t, size_t at, uint32_t tag, uint32_t type, uint32_t *value)
{
    size_t entry = 0;

    if (!find_entry(t, at, tag, type, 1, &entry))
        return false;
    *value = number(t, entry + 8, type == SHORT ? 2 : 4);
    return true;
}

/* DCF 2.0 (JEITA CP-3461B) has cameras tell Adobe RGB so: a colour space that EXIF does not know,
 * by the rule "R03" of how files are exchanged. */
static bool is_adobe(const tiff *t, size_t directory)
{
    uint32_t space = 0, exchanged = 0;
    size_t entry = 0;

    return find(t, directory, COLOUR_SPACE, SHORT, &space) && space == UNCALIBRATED &&
           find(t, directory, EXCHANGED, LONG, &exchanged) &&
           find_entry(t, exchanged, RULE, ASCII, 4, &entry) &&
           memcmp(t->data + entry + 8, "R03", 4) == 0;
}

/* `count` rationals; false where they are not there, or one is divided by 0. 0 / 0 is
 * 0 behind the first, as some write minutes and seconds. */
static bool find_rationals(const tiff *t, size_t directory, uint32_t tag, size_t count, double *out)
{
    size_t entry = 0, at = 0;

    if (!find_entry(t, directory, tag, RATIONAL, (uint32_t)count, &entry))
        return false;
    at = number(t, entry + 8, 4);
    if (t->bytes < 8 * count || at > t->bytes - 8 * count)
        return false;
    for (size_t i = 0; i < count; i++) {
        const uint32_t below = number(t, at + 8 * i + 4, 4);

        const uint32_t above = number(t, at + 8 * i, 4);

        if (below == 0 && (above != 0 || i == 0))
            return false;
        out[i] = below ? (double)above / below : 0;
    }
    return true;
}

static void read_focal(const tiff *t, size_t directory, cln_exif *out)
{
    uint32_t value = 0;
    double told = 0;

    if (find(t, directory, FOCAL_LENGTH_FILM, SHORT, &value))
        out->focal_film = value;
    if (find_rationals(t, directory, FOCAL_LENGTH, 1, &told))
        out->focal = told;
    if (find_rationals(t, directory, ZOOM, 1, &told) && told > 1)
        out->zoom = told;
}

/* Degrees, minutes and seconds, with the letter of their half of the earth; NAN without. */
static double read_angle(const tiff *t, size_t directory, uint32_t tag, const char halves[2],
                         double most)
{
    double parts[3], angle = 0;
    size_t entry = 0;
    int half = 0;

    if (!find_entry(t, directory, tag - 1, ASCII, 2, &entry) ||
        !find_rationals(t, directory, tag, 3, parts))
        return NAN;
    angle = parts[0] + parts[1] / 60 + parts[2] / 3600;
    if (!(angle <= most))
        return NAN;
    half = t->data[entry + 8] & 0xDF; /* in either case */
    return half == halves[0] ? angle : half == halves[1] ? -angle : NAN;
}

/* EXIF 3.0 also has heights over the ellipsoid (2), and below it (3). */
static double read_altitude(const tiff *t, size_t directory)
{
    const double most = 100e3; /* metres; nothing below the sea that was taken for unsigned */
    double altitude = 0;
    size_t entry = 0;
    uint32_t whole = 0;

    if (find(t, directory, ALTITUDE, LONG, &whole) || find(t, directory, ALTITUDE, SHORT, &whole))
        altitude = whole; /* against the standard */
    else if (!find_rationals(t, directory, ALTITUDE, 1, &altitude))
        return NAN;
    if (!(altitude <= most))
        return NAN;
    if (find_entry(t, directory, ALTITUDE_OF, BYTE, 1, &entry) && t->data[entry + 8] % 2 == 1)
        return -altitude;
    return altitude;
}

static void read_gps(const tiff *t, size_t directory, cln_exif *out)
{
    out->gps[0] = read_angle(t, directory, LATITUDE, "NS", 90);
    out->gps[1] = read_angle(t, directory, LONGITUDE, "EW", 180);
    out->gps[2] = read_altitude(t, directory);
    if (out->gps[0] == 0 && out->gps[1] == 0)
        out->gps[0] = out->gps[1] = NAN;
}

cln_exif cln_exif_read(const uint8_t *data, size_t bytes)
{
    if (bytes < 6 || memcmp(data, "Exif\0", 6) != 0)
        return nothing;
    return cln_exif_read_tiff(data + 6, bytes - 6);
}

cln_exif cln_exif_read_tiff(const uint8_t *data, size_t bytes)
{
    tiff t = {data, bytes, bytes > 0 && data[0] == 'I'};
    cln_exif out = nothing;
    uint32_t first = 0, value = 0;

    if (bytes < HEADER || data[0] != data[1] || (data[0] != 'I' && data[0] != 'M') ||
        number(&t, 2, 2) != 42)
        return out;
    first = number(&t, 4, 4);
    if (find(&t, first, ORIENTATION, SHORT, &value) && value >= 1 && value <= 8)
        out.orientation = (int)value;
    if (find(&t, first, TAKEN, LONG, &value)) {
        read_focal(&t, value, &out);
        out.adobe = is_adobe(&t, value);
    }
    if (find(&t, first, GPS, LONG, &value))
        read_gps(&t, value, &out);
    return out;
}
