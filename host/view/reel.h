/* The film of a viewer, one at a time: a page begins it, asks for its frames one after another, and
 * fetches the file. It is made in a folder of its own under TMPDIR or /tmp, by ffmpeg if that is
 * installed. The finished file is unlinked, so that it vanishes with the viewer. No name of a file
 * comes from a request. On the thread that paints. */
#ifndef CLN_REEL_H
#define CLN_REEL_H

#include "io/film.h"
#include "view/request.h"

/* All zero: no film. */
typedef struct cln_reel {
    char name[CLN_FILM_NAME]; /* needed to continue and to fetch it; "" = none */
    int width, height, frames, done;
    cln_film *film;      /* while it is made */
    char *folder, *path; /* likewise */
    bool plain;          /* y4m, without ffmpeg */
    bool whole;
    int file;        /* if whole: descriptor */
    int64_t bytes;   /* of the file */
    double silent;   /* seconds without a request, as cln_reel_tend was told */
    bool scaled;     /* low and high are known: all frames have the depth scale of the first one */
    float low, high; /* inverse depths */
} cln_reel;

/* Begins the film that a request describes (size, frames, frames a second), under a made-up name,
 * and drops a finished one. CLN_USAGE: another film is being made, or this one is too large to be
 * made without ffmpeg; CLN_OUTPUT: no room on the disk. */
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

/* So many more seconds have passed in which a request would have been answered, but none came:
 * drops an unfinished film after two minutes of them, a finished one after an hour. */
void cln_reel_tend(cln_reel *reel, double seconds);
void cln_reel_drop(cln_reel *reel); /* accepts a zeroed one */

#endif
