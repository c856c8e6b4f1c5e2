/* Colours that tell something of a leaf: its level in the octree, or its error. Kept in one place, so that
 * PLY files, pictures of the tree and the report's legend agree. */
#ifndef CLN_PALETTE_H
#define CLN_PALETTE_H

#include <stdbool.h>
#include <stdint.h>

enum { CLN_PALETTE_LEVELS = 6 };

/* Of levels 0 to 5, from cold to warm; told apart also by who does not see red and green. */
void cln_palette_level(int level, uint8_t rgb[3]);

/* Ends of a logarithmic scale: *high the largest value, *low the smallest positive one, but no less than
 * a thousandth of *high. Values that are not finite or not positive do not count; false (and NaN in both)
 * if there is no other. */
bool cln_palette_range(int count, const float *values, double *low, double *high);

/* The scale's colour at 0..1 (clamped), from dark violet to yellow. */
void cln_palette_ramp(double share, uint8_t rgb[3]);

/* A value's colour on the scale from low to high; grey where it or the scale is unknown (NaN). */
void cln_palette_error(double value, double low, double high, uint8_t rgb[3]);

#endif
