/* How much the field jumps between neighbouring leaves, compared with its change over the same step
 * inside a leaf, at the surfaces that the training views see. */
#ifndef CLN_SEAMS_H
#define CLN_SEAMS_H

#include "pipeline/stages.h"
#include "scene/scene.h"

/* Renders up to 16 training views, takes the points of their pixels' depths, and evaluates pairs of
 * points (docs/formats.md). The views' cameras must be the pipeline's, no photos are needed. Makes
 * the densities of pictures and frees them again. Same model, same device: same bits. */
cln_status cln_seams_measure(cln_pipeline *p, const cln_model *model, const cln_scene *scene,
                             const cln_callbacks *callbacks, cln_eval_seams *out);

#endif
