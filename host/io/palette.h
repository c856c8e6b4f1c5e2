/* Colours of a leaf, by its level in the octree or by its error: the same in PLY files, pictures of
 * the tree and the report's legend. */
#ifndef CLN_PALETTE_H
#define CLN_PALETTE_H

#include <stdbool.h>
#include <stdint.h>

enum { CLN_PALETTE_LEVELS = 6 };

/* Levels 0 to 5, from cold to warm; distinct to readers who do not see red and green, too. */
void cln_palette_level(int level, uint8_t rgb[3]);

/* Ends of a logarithmic scale over values[count]: *high the largest, *low the smallest, but at
 * least a thousandth of *high. Only finite, positive values count; false, with NaN in both, if
 * there is none. */
bool cln_palette_range(int count, const float *values, double *low, double *high);

/* The scale's colour at 0..1 (clamped), from dark violet to yellow. */
void cln_palette_ramp(double share, uint8_t rgb[3]);

/* A value's colour on the scale from low to high; grey where it or the scale is unknown (NaN). */
void cln_palette_error(double value, double low, double high, uint8_t rgb[3]);

#endif
