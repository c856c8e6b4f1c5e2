/* Writes a picture while the next one is rendered: one thread, one picture at a time, in order. */
#ifndef CLN_FRAME_WRITER_H
#define CLN_FRAME_WRITER_H

#include <pthread.h>
#include "api/render_folder.h"
#include "io/film.h"

typedef struct cln_frame_writer {
    const cln_render_job *job;
    cln_film *film;     /* gets the pictures instead of files, or NULL */
    uint8_t **kept;     /* [frames] a film's pictures that come again */
    bool busy, alone;   /* with the frame below; it is written already, as no thread began */
    int frame, written; /* written: frames with this picture, so far */
    cln_picture picture;
    float *normals; /* NULL if they are not wanted */
    pthread_t thread;
    cln_status failure;
    /* Of the failure, as the caller's thread has its own record of errors; of a warning, as the log
     * is for that thread alone. */
    char *sentence, *warning;
} cln_frame_writer;

/* film: gets the pictures instead of files, or NULL. CLN_MEMORY. Release: after the last wait. */
cln_status cln_frame_writer_begin(const cln_render_job *job, cln_film *film, cln_frame_writer *w);
void cln_frame_writer_release(cln_frame_writer *w);

/* Waits for the picture before, if there is one: *written counts the frames that it was for. Says
 * its warning, and returns its failure. */
cln_status cln_frame_writer_wait(cln_frame_writer *w, int *written);

/* Takes a rendered picture over, which with its normals is then empty. Files are written of all
 * frames that share it; a film gets it once, and cln_frame_writer_again adds it for a later frame.
 * Wait first. */
void cln_frame_writer_give(cln_frame_writer *w, int frame, cln_picture *picture, float **normals);
cln_status cln_frame_writer_again(cln_frame_writer *w, int frame);

#endif
