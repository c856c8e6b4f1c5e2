/* Writes a frame while the next one is rendered: one thread, one frame at a time, in order. */
#ifndef CLN_FRAME_WRITER_H
#define CLN_FRAME_WRITER_H

#include <pthread.h>
#include "api/render_folder.h"
#include "io/film.h"

typedef struct cln_frame_writer {
    const cln_render_job *job;
    cln_film *film;   /* gets the pictures instead of files, or NULL */
    bool busy, alone; /* with the frame below; it is written already, as no thread began */
    int frame;
    cln_picture picture;
    float *normals; /* NULL if they are not wanted */
    pthread_t thread;
    cln_status failure;
    /* Of the failure, as the caller's thread has its own record of errors; of a warning, as the log
     * is for that thread alone. */
    char *sentence, *warning;
} cln_frame_writer;

/* Waits for the frame before, if there is one: *written is then 1, else 0. Says its warning, and
 * returns its failure. */
cln_status cln_frame_writer_wait(cln_frame_writer *w, int *written);

/* Takes a rendered frame over, whose picture and normals are then empty. Wait first. */
void cln_frame_writer_give(cln_frame_writer *w, int frame, cln_picture *picture, float **normals);

#endif
