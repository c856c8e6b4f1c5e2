/* The film of a viewer: a page begins it, asks for one frame after the other, and fetches the
 * whole; one at a time. It is made in a folder of its own under TMPDIR or /tmp, by ffmpeg where
 * that is installed; when it is whole its file has no name any more, and goes with the viewer. No
 * name of a file comes from a request. On the thread that paints. */
#ifndef CLN_REEL_H
#define CLN_REEL_H

#include "io/film.h"
#include "view/request.h"

/* Zeroed: none. */
typedef struct cln_reel {
    char name[CLN_FILM_NAME]; /* who knows it may go on with the film and fetch it; "" = none */
    int width, height, frames, done;
    cln_film *film;      /* while it is made */
    char *folder, *path; /* so long */
    bool plain;          /* y4m, without ffmpeg */
    bool whole;
    int file;        /* if whole: descriptor of its file */
    int64_t bytes;   /* of that */
    double touched;  /* monotonic seconds */
    bool scaled;     /* low and high are known: all frames have the depth scale of the first one */
    float low, high; /* inverse depths */
} cln_reel;

/* Begins the film that the question asks for (its size, frames, pace), in place of a whole one; its
 * name is made up. CLN_USAGE: another is being made, or it is too large to be made without ffmpeg;
 * CLN_OUTPUT: no room on the disk. */
cln_status cln_reel_begin(cln_reel *reel, const cln_ask *ask);

/* Adds a frame, [height][width][3]; completes the film. An error drops it. CLN_FAILED, CLN_OUTPUT;
 * end: CLN_USAGE if frames are missing. */
cln_status cln_reel_add(cln_reel *reel, const uint8_t *rgb);
cln_status cln_reel_end(cln_reel *reel);

/* Is this its name? */
bool cln_reel_is(const cln_reel *reel, const char *name);

/* "film.mp4" or "film.y4m", and its type. */
const char *cln_reel_file(const cln_reel *reel);
const char *cln_reel_type(const cln_reel *reel);

/* Drops it if nobody has asked for a frame for two minutes, or for a whole one for an hour. */
void cln_reel_tend(cln_reel *reel);
void cln_reel_drop(cln_reel *reel); /* accepts a zeroed one */

#endif
