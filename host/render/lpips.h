/* LPIPS (Zhang et al., "The unreasonable effectiveness of deep features as a perceptual metric",
 * CVPR 2018; method.md section 14), version 0.1: how far two pictures are apart for a network that
 * was trained to recognise things, AlexNet or VGG-16, whose weights a file has. Runs on the device
 * (kernels/lpips.cl). 0: alike; the larger, the farther. */
#ifndef CLN_LPIPS_H
#define CLN_LPIPS_H

#include "device/device.h"

typedef struct cln_lpips cln_lpips;

/* Reads the weights: a safetensors file of the state of the class LPIPS of the authors' Python
 * package (docs/formats.md). CLN_INPUT: no such file, or another network. */
cln_status cln_lpips_open(cln_device *device, const char *path, cln_lpips **out);
void cln_lpips_close(cln_lpips *l); /* accepts NULL */

/* "alex" or "vgg"; the least side of a picture, pixels. */
const char *cln_lpips_network(const cln_lpips *l);
int cln_lpips_least(const cln_lpips *l);

/* a, b: [height][width][3] float, clipped to 0..1; kept: [height][width], 0 where both are black,
 * or NULL. CLN_MEMORY: the device has no room for a picture's features. */
cln_status cln_lpips_measure(cln_lpips *l, int width, int height, const uint8_t *kept,
                             const float *a, const float *b, double *distance);

#endif
