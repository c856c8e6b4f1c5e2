/* A picture's files beside the rendering of the next. See frame_writer.h. */
#include "api/frame_writer.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"

cln_status cln_frame_writer_begin(const cln_render_job *job, cln_film *film, cln_frame_writer *w)
{
    *w = (cln_frame_writer){.job = job, .film = film};
    return film ? cln_alloc(&w->kept, (size_t)job->count, sizeof *w->kept, "a film's pictures")
                : CLN_OK;
}

void cln_frame_writer_release(cln_frame_writer *w)
{
    CLN_ASSERT(!w->busy);
    for (int i = 0; w->kept && i < w->job->count; i++)
        free(w->kept[i]);
    free(w->kept);
    w->kept = NULL;
}

static cln_status add_to_film(cln_frame_writer *w)
{
    cln_status st = CLN_OK;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_picture_to_bytes(&w->picture, w->job->desc->transparent, &pixels));
    CLN_TRY(cln_film_add(w->film, pixels));
    w->written = 1;
    if (w->job->frames[w->frame].next >= 0) {
        w->kept[w->frame] = pixels;
        pixels = NULL;
    }
done:
    free(pixels);
    return st;
}

/* The files of all frames with this picture. Of warnings, which are alike, the first is kept. */
static cln_status write_files(cln_frame_writer *w)
{
    cln_status st = CLN_OK;
    const cln_render_frame *frames = w->job->frames;
    char *warning = NULL;

    for (int i = w->frame; i >= 0; i = frames[i].next) {
        st = cln_render_write_frame(w->job, &frames[i], &w->picture, w->normals, &warning);
        if (!w->warning) {
            w->warning = warning;
            warning = NULL;
        }
        free(warning);
        warning = NULL;
        if (st != CLN_OK)
            return st;
        w->written++;
    }
    return st;
}

static void *write_picture(void *argument)
{
    cln_frame_writer *w = argument;

    w->failure = w->film ? add_to_film(w) : write_files(w);
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
    *written = w->written;
    if (w->failure != CLN_OK)
        st = cln_fail(w->failure, "%s", w->sentence ? w->sentence : "out of memory");
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
    w->written = 0;
    memset(picture, 0, sizeof *picture);
    *normals = NULL;
    w->alone = pthread_create(&w->thread, NULL, write_picture, w) != 0;
    if (w->alone)
        write_picture(w);
}

cln_status cln_frame_writer_again(cln_frame_writer *w, int frame)
{
    const cln_render_frame *f = &w->job->frames[frame];
    cln_status st = CLN_OK;

    CLN_ASSERT(!w->busy && w->kept[f->first]);
    st = cln_film_add(w->film, w->kept[f->first]);
    if (f->next < 0) {
        free(w->kept[f->first]);
        w->kept[f->first] = NULL;
    }
    return st;
}
