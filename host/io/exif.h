/* What EXIF data say of an image's orientation. */
#ifndef CLN_EXIF_H
#define CLN_EXIF_H

#include <stddef.h>
#include <stdint.h>

/* The orientation, 1 to 8, in the contents of an APP1 segment: how viewers turn the stored picture
 * (3: by half a turn; 6 and 8: by a quarter turn, clockwise and back; 2, 4, 5, 7 also mirror it). 1
 * if they do not say it, or are damaged. */
int cln_exif_orientation(const uint8_t *data, size_t bytes);

/* The same of the TIFF file in it, which is all of a PNG's eXIf chunk. */
int cln_exif_tiff_orientation(const uint8_t *tiff, size_t bytes);

#endif
