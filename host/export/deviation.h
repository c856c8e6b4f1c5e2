/* How far two surfaces of triangles are apart. Knows no field. */
#ifndef CLN_DEVIATION_H
#define CLN_DEVIATION_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

/* The largest distance of these points from the nearest triangle: of all points, or of up to
 * CLN_DEVIATION of them, evenly chosen. at: the triangles' vertices. Without triangles it is 0.
 * CLN_MEMORY. */
enum { CLN_DEVIATION = 50000 };
cln_status cln_deviation(size_t points, const float (*point)[3], size_t faces,
                         const uint32_t (*face)[3], const float (*at)[3], double *out);

#endif
