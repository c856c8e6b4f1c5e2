/* How bright each photo is beside those that show the same: part of agree.h, whose ties tell it. */
#ifndef CLN_BRIGHTNESS_H
#define CLN_BRIGHTNESS_H

#include "scene/agreement.h"

/* Finds whether the light goes along with the camera, and how one mark then fades with its distance
 * from it: falloff. Takes the median ratio of brightness of each pair of views, without what that
 * explains; then finds one value for each view by relaxation, so that the differences of values fit
 * the pairs' ratios best: fills exposure, jump and around of out->views. CLN_MEMORY. */
cln_status cln_agree_brightness(const cln_scene *scene, cln_agreement *out);

#endif
