/* Colours of a leaf by its level or by its error, the same in PLY files, pictures of the tree and
 * the report's legend. */
#ifndef CLN_PALETTE_H
#define CLN_PALETTE_H

#include <stdbool.h>
#include <stdint.h>

enum { CLN_PALETTE_LEVELS = 9 };

/* Levels 0 to 8, from cold to warm up to 5; readers who cannot tell red from green can tell levels
 * apart. */
void cln_palette_level(int level, uint8_t rgb[3]);

/* Ends of a logarithmic scale over the finite, positive ones of values[count]: *high is the
 * largest, *low the smallest, but at least a thousandth of *high. False, with NaN in both, without
 * any. */
bool cln_palette_range(int count, const float *values, double *low, double *high);

/* The scale's colour at 0..1 (clamped), from dark violet to yellow. */
void cln_palette_ramp(double share, uint8_t rgb[3]);

/* A value's colour on the scale from low to high; grey if either is unknown (NaN). */
void cln_palette_error(double value, double low, double high, uint8_t rgb[3]);

#endif
