/* Image files: reads PNG and JPEG through stb_image after checks of its own, writes PNG through
 * stb_image_write, atomically, and JPEG to memory. */
#ifndef CLN_IMAGE_H
#define CLN_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"
#include "io/colour.h"
#include "io/xmp.h"

enum { CLN_IMAGE_MAX_SIDE = 1 << 17, CLN_IMAGE_MAX_PIXELS = 1 << 28 };

/* Reads size and channels (3, or 4 with alpha; grey counts as 3 or 4) from the header. */
cln_status cln_image_info(const char *path, int *width, int *height, int *channels);

/* The same, and what EXIF data tell (io/exif.h): how viewers turn it (1: as it is), which decoding
 * does not do, focal lengths (mm; 0: none), the digital zoom (1: none), and the place by GPS
 * (degrees and metres; NAN: none); and what XMP data tell (io/xmp.h). */
typedef struct cln_image_head {
    int width, height, channels, orientation;
    double focal, focal_film, zoom, gps[3];
    cln_panorama panorama;
    bool jpeg;      /* else PNG */
    bool deep_grey; /* grey of 16 bits a value, as sensors' depths are */
    cln_colour_kind colour;
    char profile[CLN_COLOUR_NAME];
} cln_image_head;
cln_status cln_image_read_head(const char *path, cln_image_head *out);

/* Decodes to [height][width][channels] u8 in sRGB, channels as cln_image_info says. CLN_INPUT with
 * the path and the decoder's reason; a truncated file is an error. The caller frees *pixels. */
cln_status cln_image_load(const char *path, int *width, int *height, int *channels,
                          uint8_t **pixels);

/* The same from the bytes of a file; path: its name in the error sentence. */
cln_status cln_image_decode(const char *path, const void *data, size_t bytes, int *width,
                            int *height, int *channels, uint8_t **pixels);

/* Decodes a grey PNG to [height][width] values as they are stored, without colours; deep: of 16
 * bits, else 0..255. CLN_INPUT, too, if it is not grey. The caller frees *values. */
cln_status cln_image_load_grey(const char *path, int *width, int *height, bool *deep,
                               uint16_t **values);

/* Fails like cln_image_decode if the file is not an image or is truncated, without decoding it. */
cln_status cln_image_check(const char *path);

/* The same by its first and last bytes alone, where these are as they should be. */
cln_status cln_image_check_ends(const char *path);

/* Divides the size by n (floor; partial blocks are dropped) by the mean of n x n blocks, to
 * nearest; with 4 channels the mean of premultiplied values, divided by alpha. In place; *pixels is
 * reallocated. */
cln_status cln_image_downscale(int n, int *width, int *height, int channels, uint8_t **pixels);

/* Whether two pictures have the same shape, to less than a pixel of the smaller. */
bool cln_image_alike(int width, int height, int other_width, int other_height);

/* Brings a mask to another size, by the nearest pixel of each; nothing to do at that size.
 * CLN_MEMORY. */
cln_status cln_image_fit(int to_width, int to_height, int *width, int *height, int channels,
                         uint8_t **pixels);

/* Turns an image as an EXIF orientation says; from 5 on, width and height change places. *pixels is
 * replaced. CLN_MEMORY. */
cln_status cln_image_turn(int orientation, int *width, int *height, int channels, uint8_t **pixels);

/* Divides colours by their alpha, in place: pixels of four channels whose colours were multiplied
 * by it. Where alpha is 0 they stay. */
void cln_image_divide_alpha(uint8_t *pixels, size_t count);

/* Gives an image of `count` pixels the alpha of another of 3 or 4 channels: the largest of its
 * three colours, as it may be a coloured mask. *pixels is replaced and has 4 channels.
 * CLN_MEMORY. */
cln_status cln_image_put_alpha(size_t count, const uint8_t *alpha, int alpha_channels,
                               int *channels, uint8_t **pixels);

/* Writes a PNG of [height][width][channels] u8, channels 1, 3 or 4. */
cln_status cln_image_write_png(const char *path, int width, int height, int channels,
                               const uint8_t *pixels);

/* The same, to memory; the caller frees *out. */
cln_status cln_image_encode_png(int width, int height, int channels, const uint8_t *pixels,
                                uint8_t **out, size_t *bytes);

/* JPEG of [height][width][3 or 1] u8 in memory, quality 1..100; the caller frees *out. CLN_OUTPUT,
 * CLN_MEMORY. */
cln_status cln_image_encode_jpeg(int width, int height, int channels, const uint8_t *pixels,
                                 int quality, uint8_t **out, size_t *bytes);

/* 0..1 float -> u8 or u16, clamped, rounded to nearest; NaN becomes 0. */
uint8_t cln_to_u8(float value);
uint16_t cln_to_u16(float value);

#endif
