/* Images on disk, decoded nowhere else: PNG and JPEG are read through stb_image, after the header's
 * size was checked; PNG is written through stb_image_write, atomically. */
#ifndef CLN_IMAGE_H
#define CLN_IMAGE_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

enum { CLN_IMAGE_MAX_SIDE = 32768, CLN_IMAGE_MAX_PIXELS = 1 << 28 };

/* Size and channels (3, or 4 if the file has alpha; grey counts as 3 or 4) from the header alone.
 */
cln_status cln_image_info(const char *path, int *width, int *height, int *channels);

/* Decodes to [height][width][channels] u8, channels as cln_image_info says. CLN_INPUT with the path
 * and the decoder's reason; a truncated file is an error. The caller frees *pixels. */
cln_status cln_image_load(const char *path, int *width, int *height, int *channels,
                          uint8_t **pixels);

/* The same from the bytes of a file; path is for the sentence. */
cln_status cln_image_decode(const char *path, const void *data, size_t bytes, int *width,
                            int *height, int *channels, uint8_t **pixels);

/* Area filter: divides the size by n (floor; the last partial block is dropped), averaging n x n
 * blocks; with 4 channels on premultiplied values, un-premultiplied after. Rounds to nearest. In
 * place, *pixels is reallocated. */
cln_status cln_image_downscale(int n, int *width, int *height, int channels, uint8_t **pixels);

/* PNG of [height][width][channels] u8, channels 1, 3 or 4. */
cln_status cln_image_write_png(const char *path, int width, int height, int channels,
                               const uint8_t *pixels);

/* The same, to memory; the caller frees *out. */
cln_status cln_image_encode_png(int width, int height, int channels, const uint8_t *pixels,
                                uint8_t **out, size_t *bytes);

/* 0..1 float -> u8, clamped, rounded to nearest; NaN becomes 0. */
uint8_t cln_to_u8(float value);

#endif
