/* How bright each photo is beside those that show the same: part of agree.h, whose ties tell it. */
#ifndef CLN_BRIGHTNESS_H
#define CLN_BRIGHTNESS_H

#include "scene/agreement.h"

/* Takes the median ratio of brightness of each pair of views; then finds one value for each view by
 * relaxation, so that the differences of values fit the pairs' ratios best: fills exposure, jump
 * and around of out->views. CLN_MEMORY. */
cln_status cln_agree_brightness(int views, cln_agreement *out);

#endif
