/* Renders held-out views and measures them (method.md 14): the one way to every PSNR and SSIM that
 * train, eval and the report print. */
#ifndef CLN_QUALITY_H
#define CLN_QUALITY_H

#include <jansson.h>
#include "render/lpips.h"
#include "render/view.h"

/* Chooses `most` (0 = all) of a split's views, evenly, if any counts (cln_scene_view_counts) of
 * those; of all splits (CLN_SPLITS) each photo once, as the first of its views. *views: indices
 * into scene->views; the caller frees it. */
cln_status cln_quality_choose(const cln_scene *scene, cln_split split, int most, int **views,
                              int *count);

/* CLN_INPUT names a view that is too small for an SSIM; a warning, one that has none as no whole
 * window of it counts. Called before a training or a rendering. */
cln_status cln_quality_check(const cln_scene *scene, const int *views, int count);
/* CLN_INPUT names a view that is too small for LPIPS. */
cln_status cln_quality_check_lpips(const cln_scene *scene, const int *views, int count,
                                   const cln_lpips *lpips);

/* Renders the given views (their pixels must be loaded) and fills `result` (the caller sets digest,
 * step and train seconds). folder: NULL, or where NAME.png, NAME.truth.png and NAME.error.png go,
 * and, with a model, pictures of its tree for a few views, with tree.json. Makes the densities of
 * pictures and frees them again. lpips: measured, too; NULL = not. */
cln_status cln_quality_measure(cln_pipeline *p, const cln_model *model, const cln_scene *scene,
                               const int *views, int count, const char *folder, cln_lpips *lpips,
                               const cln_callbacks *callbacks, cln_eval_result *result);

/* Bytes that pictures of these views may take on the disk, as if nothing could be compressed. */
double cln_quality_bytes(const cln_scene *scene, const int *views, int count);

/* The document of RUN/eval/STEP-SPLIT.json (docs/formats.md). */
cln_status cln_quality_json(const cln_eval_result *result, json_t **out);

#endif
