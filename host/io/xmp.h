/* What XMP data say of an image: whether it is a panorama of the whole sphere, by Google's schema
 * GPano (Photo Sphere XMP Metadata), which cameras that see all around and their programs write. */
#ifndef CLN_XMP_H
#define CLN_XMP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum cln_panorama {
    CLN_PANORAMA_UNTOLD,
    CLN_PANORAMA_WHOLE,
    CLN_PANORAMA_CUT /* a part of the sphere: cut above, below or at the sides */
} cln_panorama;

/* Of the contents of a JPEG's APP1 segment; of a PNG's iTXt chunk. Other text, and what is damaged
 * or compressed, is untold. */
cln_panorama cln_xmp_read_segment(const uint8_t *data, size_t bytes);
cln_panorama cln_xmp_read_chunk(const uint8_t *data, size_t bytes);

#endif
