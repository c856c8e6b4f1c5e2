/* Depth as a grey picture to look at: near is bright, linear in inverse depth along the ray, on one
 * scale for all frames of a film. First every frame is added, then the scale is made, then frames
 * are drawn. */
#ifndef CLN_DEPTH_PICTURE_H
#define CLN_DEPTH_PICTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_depth_scale {
    float low, high; /* the scale's ends: 2nd and 98th percentile of inverse depths */
    float *sample;
    size_t count;
} cln_depth_scale;

/* Adds a frame, depth and opacity of n pixels; keeps some thousands of those mostly opaque, evenly
 * chosen. */
cln_status cln_depth_scale_add(cln_depth_scale *scale, size_t n, const float *depth,
                               const uint8_t *opacity);

/* False if nothing opaque was added. */
bool cln_depth_scale_make(cln_depth_scale *scale);
void cln_depth_scale_free(cln_depth_scale *scale);

/* Transparent pixels fade to black. */
void cln_depth_draw(const cln_depth_scale *scale, size_t n, const float *depth,
                    const uint8_t *opacity, uint8_t *grey);

#endif
