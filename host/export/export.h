/* What the exports of list.h share: the job that each gets from api/export.c, which checks the
 * request and opens the run. */
#ifndef CLN_EXPORT_H
#define CLN_EXPORT_H

#include "export/list.h"
#include "render/crop.h"
#include "render/open_run.h"

/* The checkpoint is always read. DEVICE: the field on a device; SCENE: the scene's cameras, its own
 * or those that the run keeps; VIEWS: both. BOXES: leaves that are boxes of the scene, as they are
 * not in a forward or shell space (scene/space.h); CELLS: the field on a grid of equal cells,
 * likewise. */
typedef enum {
    CLN_EXPORT_CHECKPOINT = 0,
    CLN_EXPORT_DEVICE = 1,
    CLN_EXPORT_SCENE = 2,
    CLN_EXPORT_VIEWS = CLN_EXPORT_DEVICE | CLN_EXPORT_SCENE,
    CLN_EXPORT_BOXES = 4,
    CLN_EXPORT_CELLS = CLN_EXPORT_BOXES | CLN_EXPORT_DEVICE
} cln_export_needs;

typedef struct cln_export_job {
    const cln_export_desc *desc;
    cln_open_run opened;
    cln_crop crop; /* its planes are set */
    double scale;  /* of lengths, above 0 */
    double up[3];  /* with SCENE: desc's, else what render --orbit takes for it */
    bool turns;    /* what is written is turned so that this is z (GLB: y, in any case) */
    cln_export_result *result;
} cln_export_job;

#define X(what, needs, form, help) cln_status cln_export_##what(cln_export_job *job);
CLN_EXPORT_LIST(X)
#undef X

/* "cl-nascent VERSION: WHAT at step N; scene units", with scale, up and offset if there are any,
 * the digest of a model with weights, a crop, and what was left out of the surface, as the result
 * has it, for the comment of a file whose numbers are so; the caller frees it. */
cln_status cln_export_comment(const cln_export_job *job, const char *what, char **text);

/* CLN_SIGINT or CLN_SIGTERM where the caller asked to stop: asked before a file is begun. */
cln_status cln_export_poll(const cln_callbacks *callbacks);

/* Returns whether the file's name has this ending (".obj"), in upper or lower case. */
bool cln_export_ends(const char *file, const char *ending);

#endif
