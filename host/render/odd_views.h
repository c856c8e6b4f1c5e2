/* What the single views of an evaluation tell: of their photos' exposure, and which are hidden by
 * something before their camera. */
#ifndef CLN_ODD_VIEWS_H
#define CLN_ODD_VIEWS_H

#include "render/picture.h"
#include "render/view.h"

/* Median distance of the pixels that are more opaque than not, in the picture's units; NAN if most
 * are not. CLN_MEMORY. */
cln_status cln_odd_depth(const cln_picture *picture, double *depth);

/* Fills fitted_gain of the result, `hidden`, `partly` and `off` of its images; their PSNRs and
 * depths are there, and which are apart. */
cln_status cln_odd_views(cln_eval_result *result);

#endif
