/* COLMAP's program on a folder of photos, for cln_find_poses (poses.c): its commands in their
 * order, shown as work, with the options and words of its versions. All that it says goes into a
 * log. */
#ifndef CLN_API_COLMAP_H
#define CLN_API_COLMAP_H

#include <stdio.h>
#include "cl_nascent.h"
#include "scene/dataset.h"
#include "scene/lens.h"
#include "scene/scene.h"
#include "scene/similarity.h"

enum { CLN_POSES_LEAST = 3 }; /* photos that poses can be found of */

#define CLN_POSES_ADVICE                                                                         \
    "Take more, at most 20 degrees apart, sharp, of something with texture that does not move, " \
    "and give them as the camera wrote them, not zoomed, cropped or blurred by software; of a "  \
    "thing on a turntable, give --mask-path"

/* How features are looked for. */
typedef struct cln_colmap_room {
    int threads; /* photos at once; 0: as COLMAP does, one a processor */
    int side;    /* pixels of a photo's longest side at which; 0: COLMAP's, at most 3200 */
    double each; /* bytes that one of the largest photos takes at its size of then */
} cln_colmap_room;

/* What fits in `memory` bytes. longest, pixels: of the largest photo. */
cln_colmap_room cln_colmap_fit(double memory, int processors, int longest, double pixels);

typedef struct cln_colmap {
    /* The caller's, for all steps. */
    const cln_poses_desc *desc;
    const cln_colmap_model *lens; /* of the cameras; NULL: by the number of photos */
    cln_names photos;             /* in `images`, by name */
    char *images, *database;      /* their folder; the features and matches */
    char *masks;                  /* the folder of IMAGE.png, black in which is no feature; NULL */
    char *sparse;                 /* the folder of the models, until one is chosen */
    char *log_path;
    FILE *log;
    /* Found out. */
    const char *extraction, *matching; /* how this COLMAP calls its options */
    const char *threads, *side; /* of features: how many at once, and at which longest side; NULL:
                                   it has no such option */
    cln_colmap_room room;
    bool sized, blocks, lists; /* it takes a model's least size; a block's size; lists of photos */
    bool by_matrix;            /* model_transformer reads a matrix (to 3.8), not a quaternion */
    bool spheres;              /* it has a camera model of panoramas (4.1 and newer) */
    bool mixed;                /* cameras of panoramas have that beside others */
    bool guesses;              /* it takes a focal length to begin with, without EXIF data */
    int focal_lengths;         /* photos with one by EXIF data, in pixels between these: */
    double focal_least, focal_most;
    int unread; /* photos that it could not read; the first of them: */
    char unread_name[128];
    /* Of the running command. */
    const char *stage; /* on the progress line */
    int done, before;  /* photos of this run; of runs before it */
    char name[128];    /* of the photo that it looks at */
    bool full;         /* it found no room on the disk */
    bool strange;      /* it has no such camera model */
    bool kept;         /* it left out photos whose features it had: their focal length, too */
    int together;      /* most photos that a model had */
    int from_here;     /* photos of the model that grows now */
    bool anew;         /* it is said that another model was begun */
} cln_colmap;

/* Asks the installed version for its options. */
void cln_colmap_ask(cln_colmap *c);

/* Finds features, of photos by their cameras (photo_cameras.h). The steps give CLN_FAILED with the
 * log's name, CLN_OUTPUT where the disk is full, CLN_SIGINT, CLN_SIGTERM. */
cln_status cln_colmap_features(cln_colmap *c);
/* Warns where so many photos are matched with all others that it takes long. */
void cln_colmap_warn_many(const cln_colmap *c, bool ordered);
/* Matches as desc->match says; "auto": each of many photos with the next ones if they are ordered,
 * as they were taken one after the other. */
cln_status cln_colmap_match(cln_colmap *c, bool ordered);
/* Finds poses; the largest model is sparse/0 of the scene's folder then. */
cln_status cln_colmap_map(cln_colmap *c);

/* Turns, scales and moves a model into a folder that is there. by_matrix: how it is told; a COLMAP
 * that reads it otherwise makes something else of the model, or fails. CLN_FAILED, too, if this
 * COLMAP cannot. */
cln_status cln_colmap_transform(cln_colmap *c, const char *model, const cln_similarity *by,
                                bool by_matrix, const char *out);

/* Removes a folder of models that an earlier attempt left, if it is there. CLN_OUTPUT. */
cln_status cln_colmap_remove(const char *folder);

/* Tells the focal length that it found. */
void cln_colmap_say_focal_length(const cln_colmap *c, const cln_scene *scene);

#endif
