/* Which pixels of a picture need more than one ray: those at edges of colour, of opacity or of
 * depth, where one ray through the centre stands for a pixel that sees two things. No rendering
 * here (view.c). */
#ifndef CLN_ANTIALIAS_H
#define CLN_ANTIALIAS_H

#include "base/status.h"
#include "render/picture.h"

/* The pixels, row by row, that differ from one of their eight neighbours by more than a threshold
 * in a colour channel, in opacity, or in depth (relative to the nearer one, where both are mostly
 * opaque). The caller frees *pixels: indices y * width + x. CLN_MEMORY. */
cln_status cln_antialias_edges(const cln_picture *picture, int **pixels, int *count);

#endif
