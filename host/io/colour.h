/* What an image file says of its colours - an ICC profile, a PNG's gAMA and cHRM chunks, a JPEG's
 * EXIF data that have Adobe RGB - and its pixels brought to sRGB, which all pictures here are in,
 * by Little CMS. Finding these in a file is image.c's. */
#ifndef CLN_COLOUR_H
#define CLN_COLOUR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

enum { CLN_COLOUR_PARTS = 256, CLN_COLOUR_NAME = 64 };

/* As found in a file, whose bytes it points to. Zeroed: nothing is said. */
typedef struct cln_colour_mark {
    struct {
        const uint8_t *at;
        size_t bytes;
    } part[CLN_COLOUR_PARTS]; /* of an ICC profile: a JPEG's by their numbers, from 1 on, a PNG's
                               * only one in part[1] */
    int parts;                /* how many there should be */
    bool deflated;            /* part[1] is zlib's */
    bool srgb;                /* PNG's sRGB chunk: gamma and chroma do not count */
    bool adobe;               /* JPEG: Adobe RGB by EXIF data; a profile goes first */
    double gamma;             /* PNG: the exponent that encoded values; 0: not told */
    double chroma[8];         /* PNG: x, y of white, red, green, blue; 0: not told */
} cln_colour_mark;

typedef enum {
    CLN_COLOUR_SRGB,   /* nothing is said, or sRGB within 2 of 255 */
    CLN_COLOUR_OTHER,  /* is converted */
    CLN_COLOUR_UNKNOWN /* is not: a damaged profile, one of grey or CMYK, no Little CMS */
} cln_colour_kind;

/* name: what a profile is called. Remembers the last answer of this thread. */
cln_colour_kind cln_colour_of(const cln_colour_mark *mark, char name[CLN_COLOUR_NAME]);

/* Why a profile cannot be converted. */
const char *cln_colour_unknown_reason(void);

/* Brings [count][3 or 4] values to sRGB if they are CLN_COLOUR_OTHER, by perceptual rendering as
 * far as a profile has it, alpha as it is. deep: `in` has 16 bits a value, else 8, and may be
 * `out`. *done: whether out was written. CLN_MEMORY. */
cln_status cln_colour_convert(const cln_colour_mark *mark, size_t count, int channels, bool deep,
                              const void *in, uint8_t *out, bool *done);

#endif
