/* A forward space (scene/space.h) and cameras that look into it, for checks and tests. Its mean
 * camera is off the origin and not in line with the scene's axes. */
#ifndef CLN_FORWARD_SCENE_H
#define CLN_FORWARD_SCENE_H

#include "scene/scene.h"

enum { CLN_FORWARD_VIEWS = 4 };

/* Near plane at 1.5 units; tangents of half the fields of view: 0.8 and 0.625. */
cln_space cln_check_forward_space(double unit);

/* Camera 0 is the mean camera; the others are near it and turned a little; camera 3 is beyond the
 * near plane. width x height pixels. */
void cln_check_forward_camera(int i, const cln_space *space, int width, int height, cln_camera *c);

#endif
