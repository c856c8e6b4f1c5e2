/* The options of make-scene and its work in progress: shared by make_scene.c, place.c and
 * write.c. */
#ifndef DATA_JOB_H
#define DATA_JOB_H

#include <pthread.h>
#include "scene/scene.h"
#include "faults.h"
#include "scenes.h"

enum { OBJECT, ROOM, FORWARD, TERRAIN, STREET };
enum { FROM_ALL, FROM_CONE, FROM_LOW, FROM_NEAR };
enum { BLENDER, NERFSTUDIO, NGP, LLFF, COLMAP };

/* Their words, in order, and NULL. */
extern const char *const job_kinds[], *const job_places[], *const job_formats[];

typedef struct settings {
    const char *out;
    int kind, format, fault, from;
    bool depth, masks, plain;
    int size, seed;
    int views[CLN_SPLITS];
    cln_lens lens;
    const char *bent_by; /* text of --distortion; NULL without */
    double distortion[CLN_LENS_PARAMS];
    double unit, offset[3]; /* written positions: unit * ours + offset */
    const char *held;       /* digits: EXIF orientations of the views, in turn; NULL: untold */
} settings;

typedef struct job {
    const settings *set;
    world world;
    int view_count;
    cln_camera *cameras; /* [view]: train, val, test */
    char **names;        /* [view] relative to the folder, without extension */
    pthread_mutex_t lock;
    int next; /* view to render */
    cln_status st;
    char error[1024];
} job;

/* The exact camera of view i of the split, in the generator's own units. */
void job_place(const settings *set, int split, int i, cln_camera *camera);

/* The EXIF orientation of a view; 0: it has none. */
int job_orientation(const settings *set, int view);

/* Writes the camera files in the job's format. CLN_OUTPUT. */
cln_status job_write(const job *j);

/* generator.json records the options, and marks the folder as one that may be overwritten.
 * CLN_OUTPUT. */
cln_status job_mark(const settings *set);

#endif
