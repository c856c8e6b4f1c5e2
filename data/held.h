/* Photos as a phone stores them that is held upright or turned: the pixels as its sensor lies, and
 * an EXIF orientation that tells viewers how to turn them. */
#ifndef DATA_HELD_H
#define DATA_HELD_H

#include "scene/scene.h"

/* Turns a level camera about its axis so that its picture, turned by the orientation (1, 3, 6 or
 * 8), stands; and makes the picture 4:3, as sensors are. */
void held_camera(int orientation, cln_camera *camera);

/* Adds the orientation to a PNG file, as a chunk eXIf behind its head. CLN_INPUT, CLN_OUTPUT. */
cln_status held_tag(const char *png, int orientation);

#endif
