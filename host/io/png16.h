/* PNG of 16 bits a value, which stb_image_write does not write. */
#ifndef CLN_PNG16_H
#define CLN_PNG16_H

#include <stdint.h>
#include "base/status.h"

/* Writes [height][width][channels] values, channels 1, 3 or 4 (alpha straight), atomically.
 * CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_png16_write(const char *path, int width, int height, int channels,
                           const uint16_t *values);

#endif
