/* The frames of a cln_render, and their files in its folder: which are there, what they were made
 * from, writing and reading them. Internal to api/. */
#ifndef CLN_API_RENDER_FOLDER_H
#define CLN_API_RENDER_FOLDER_H

#include <jansson.h>
#include "base/files.h"
#include "render/crop.h"
#include "render/depth_picture.h"
#include "render/frames.h"
#include "render/open_run.h"
#include "render/picture.h"
#include "render/seen.h"

typedef struct cln_render_frame {
    const char *name;
    cln_camera camera;
    char made_from[CLN_DIGEST_TEXT]; /* digest of all that its pictures depend on */
    bool alike;     /* by render.json, what the folder may have of it was made from the same */
    bool there;     /* that is there, whole, and stays */
    bool recounted; /* it would, but for its shares, which are of other training views */
    cln_seen_shares seen; /* NAN if it was not asked for, or nothing is shown */
    /* Frames that are made from the same share a picture: the number of the first of them, which is
     * rendered for all, and of the next behind this one, -1 for none. */
    int first, next;
} cln_render_frame;

typedef struct cln_render_job {
    const cln_render_desc *desc;
    bool writes; /* rank 0 (ranks/ranks.h) */
    cln_open_run opened;
    int antialias;         /* n x n rays for pixels at edges */
    uint64_t model_digest; /* once: it takes half a second for many voxels */
    cln_frames cameras;
    cln_seen seen;                 /* by training views; none if it is not asked for */
    char seen_by[CLN_DIGEST_TEXT]; /* digest of these views */
    cln_crop crop;
    cln_render_frame *frames;
    cln_camera *eyes;           /* [count][1 or 2] what is rendered */
    int count, there, pictured; /* frames; those that are there; those with a depth picture */
    int earlier;                /* frames of other names that stay in the folder */
    json_t *run;                /* run.json */
    json_t *before;             /* the folder's render.json; NULL if there is none */
} cln_render_job;

/* Eyes of a frame: 2 in a stereo pair, else 1. Width of a frame's pictures, which have the eyes
 * side by side. */
int cln_render_eyes(const cln_render_job *j);
int cln_render_width(const cln_render_job *j, const cln_render_frame *f);

/* Holds the folder, which is made, for this process alone (io/hold.h): two renders at once would
 * mix their frames. CLN_OUTPUT names the process that has it. A folder that cannot be written to is
 * not held. Release: removes it if it was made and nothing came into it. */
typedef struct cln_render_hold {
    int lock; /* -1: not held */
    bool made;
} cln_render_hold;
cln_status cln_render_hold_folder(const char *out, cln_render_hold *hold);
void cln_render_release_folder(const char *out, const cln_render_hold *hold);

/* CLN_OUTPUT if the folder holds files but no render.json of ours. *before: its render.json, NULL
 * if there is none. */
cln_status cln_render_check_folder(const char *out, json_t **before);

/* Finds the frames in the folder that are as they would be made now, by j->before: sets
 * frame.alike and .there, j->there and j->pictured. Counts in j->earlier, and tells, how many
 * others stay; those whose pictures are gone leave j->before. j->pictured is 0 if the folder's
 * newest render was of other poses: their depths had another scale. */
cln_status cln_render_find_there(cln_render_job *j);

/* CLN_OUTPUT if pictures of these frames are there that were made otherwise, and desc.overwrite
 * does not ask to replace them: they may have taken hours. */
cln_status cln_render_refuse_others(const cln_render_job *j);

/* CLN_OUTPUT if the disk has no room for the frames that are not there yet. */
cln_status cln_render_check_disk(const cln_render_job *j);

/* Removes all files of frames that are rendered again, also those of a kind that is not asked for
 * now: the folder then has what render.json says. */
cln_status cln_render_drop_stale(const cln_render_job *j);

/* Writes render.json, and the frames' cameras as transforms.json. scale: of the depth pictures,
 * NULL before they are drawn, or if all frames are there: then as before. */
cln_status cln_render_write_about(const cln_render_job *j, const cln_depth_scale *scale);

/* Writes a frame's files except its depth picture. p has depths in scene units; normals: NULL or
 * [height][width][3]. May run on a thread of its own, so nothing is logged: *warning is NULL or a
 * sentence, which the caller frees. */
cln_status cln_render_write_frame(const cln_render_job *j, const cln_render_frame *f,
                                  const cln_picture *p, const float *normals, char **warning);

/* Draws all depth pictures on one scale, and writes render.json with it. */
cln_status cln_render_draw_depths(const cln_render_job *j);

#endif
