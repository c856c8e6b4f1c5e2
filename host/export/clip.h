/* Cuts a surface to half-spaces, exactly: triangles that a plane passes through are cut along it.
 * Knows no run and no scene. */
#ifndef CLN_CLIP_H
#define CLN_CLIP_H

#include "export/triangles.h"

/* Keeps what has plane[0..2] . p + plane[3] >= 0 for all six. Sets places and faces alone, so the
 * other arrays must be NULL. Triangles that shared a side still do, and new sides are open.
 * CLN_MEMORY. */
cln_status cln_surface_clip(cln_surface *surface, const float planes[6][4]);

#endif
