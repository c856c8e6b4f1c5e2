/* Depth as files for other programs, beside npy: 16-bit PNG in steps of a unit, and PFM. */
#ifndef CLN_DEPTH_FILE_H
#define CLN_DEPTH_FILE_H

#include "base/status.h"

/* Writes [height][width] as 16-bit grey, round(depth / unit), atomically; 0 where nothing is.
 * Depths beyond 65535 units become 65535, negative ones 0; *beyond and *behind (may be NULL) count
 * them. CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_depth_write_png16(const char *path, int width, int height, const float *depth,
                                 double unit, int *beyond, int *behind);

/* PFM, little-endian, rows from the bottom up. */
cln_status cln_depth_write_pfm(const char *path, int width, int height, const float *depth);

#endif
