/* A frame's files beside the rendering of the next. See frame_writer.h. */
#include "api/frame_writer.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"

static cln_status add_to_film(cln_film *film, const cln_picture *p, bool alpha)
{
    cln_status st = CLN_OK;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_picture_to_bytes(p, alpha, &pixels));
    CLN_TRY(cln_film_add(film, pixels));
done:
    free(pixels);
    return st;
}

static void *write_frame(void *argument)
{
    cln_frame_writer *w = argument;

    if (w->film)
        w->failure = add_to_film(w->film, &w->picture, w->job->desc->transparent);
    else
        w->failure = cln_render_write_frame(w->job, &w->job->frames[w->frame], &w->picture,
                                            w->normals, &w->warning);
    if (w->failure != CLN_OK) {
        w->sentence = strdup(cln_error_text());
        cln_clear_error();
    }
    return NULL;
}

cln_status cln_frame_writer_wait(cln_frame_writer *w, int *written)
{
    cln_status st = CLN_OK;

    *written = 0;
    if (!w->busy)
        return CLN_OK;
    if (!w->alone)
        pthread_join(w->thread, NULL);
    w->busy = false;
    cln_picture_free(&w->picture);
    free(w->normals);
    w->normals = NULL;
    if (w->warning)
        cln_warn("%s", w->warning);
    free(w->warning);
    w->warning = NULL;
    if (w->failure != CLN_OK)
        st = cln_fail(w->failure, "%s", w->sentence ? w->sentence : "out of memory");
    else
        *written = 1;
    free(w->sentence);
    w->sentence = NULL;
    return st;
}

void cln_frame_writer_give(cln_frame_writer *w, int frame, cln_picture *picture, float **normals)
{
    CLN_ASSERT(!w->busy);
    w->frame = frame;
    w->picture = *picture;
    w->normals = *normals;
    w->busy = true;
    memset(picture, 0, sizeof *picture);
    *normals = NULL;
    w->alone = pthread_create(&w->thread, NULL, write_frame, w) != 0;
    if (w->alone)
        write_frame(w);
}
