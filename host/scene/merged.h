/* Are photos of two captures, or of two models of one, put together, whose poses are of two frames,
 * with other units, axes or origin? Each part's photos fit its poses; no pair within one tells.
 * Part of agree.h, which finds the ties. */
#ifndef CLN_MERGED_H
#define CLN_MERGED_H

#include "scene/agreement.h"
#include "scene/features.h"

/* Fills out->merged; features: [view], list NULL where they were not found. After count_agreeing.
 * CLN_MEMORY; CLN_SIGINT, CLN_SIGTERM. */
cln_status cln_find_merged(const cln_scene *scene, const cln_features *features,
                           const cln_callbacks *callbacks, cln_agreement *out);

#endif
