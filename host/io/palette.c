/* The colours of palette.h. */
#include "io/palette.h"

#include <math.h>
#include <string.h>

static const double DECADES = 1000; /* the scale spans at most this factor */

static const uint8_t level_colours[CLN_PALETTE_LEVELS][3] = {
    {0, 114, 178}, {86, 180, 233},  {0, 158, 115},  {240, 228, 66}, {230, 159, 0},
    {213, 94, 0},  {204, 121, 167}, {148, 85, 188}, {90, 90, 90}};

static const uint8_t ramp[][3] = {
    {13, 8, 135}, {126, 3, 168}, {204, 71, 120}, {248, 149, 64}, {240, 249, 33}};
enum { RAMP_PARTS = sizeof ramp / sizeof ramp[0] - 1 };

static const uint8_t unknown[3] = {128, 128, 128};

void cln_palette_level(int level, uint8_t rgb[3])
{
    level = level < 0 ? 0 : level < CLN_PALETTE_LEVELS ? level : CLN_PALETTE_LEVELS - 1;
    memcpy(rgb, level_colours[level], 3);
}

bool cln_palette_range(int count, const float *values, double *low, double *high)
{
    double least = INFINITY, greatest = 0;

    for (int i = 0; i < count; i++) {
        if (!isfinite(values[i]) || !(values[i] > 0))
            continue;
        least = fmin(least, values[i]);
        greatest = fmax(greatest, values[i]);
    }
    *low = greatest > 0 ? fmax(least, greatest / DECADES) : NAN;
    *high = greatest > 0 ? greatest : NAN;
    return greatest > 0;
}

void cln_palette_ramp(double share, uint8_t rgb[3])
{
    const double at = fmin(fmax(share, 0), 1) * RAMP_PARTS;
    const int part = at < RAMP_PARTS ? (int)at : RAMP_PARTS - 1;
    const double rest = at - part;

    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)lround((1 - rest) * ramp[part][c] + rest * ramp[part + 1][c]);
}

void cln_palette_error(double value, double low, double high, uint8_t rgb[3])
{
    if (!isfinite(value) || !(low > 0) || !(high > 0))
        memcpy(rgb, unknown, 3);
    else if (value >= high)
        cln_palette_ramp(1, rgb);
    else if (value <= low)
        cln_palette_ramp(0, rgb);
    else
        cln_palette_ramp(log(value / low) / log(high / low), rgb);
}
