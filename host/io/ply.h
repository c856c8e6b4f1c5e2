/* PLY files of axis-parallel boxes, for mesh viewers. Binary, little-endian; docs/formats.md has
 * the layout. */
#ifndef CLN_PLY_H
#define CLN_PLY_H

#include <stdint.h>
#include "base/status.h"

typedef struct cln_ply_box {
    double min[3], max[3];
    uint8_t colour[3];
    uint8_t level;
    float error; /* NaN: not known */
} cln_ply_box;

enum { CLN_PLY_BOX_BYTES = 8 * 32 + 6 * 17 }; /* of a box in the file, at most */

/* Writes eight vertices and six faces a box, in the order of `boxes`, atomically. Coordinates are
 * doubles where floats do not keep them to a hundredth of `fine`. comment: one line. */
cln_status cln_ply_write_boxes(const char *path, int count, const cln_ply_box *boxes, double fine,
                               const char *comment);

#endif
