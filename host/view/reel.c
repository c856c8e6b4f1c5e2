/* A film that grows by requests. See reel.h; its bytes are io/film.h's. */
#include "view/reel.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"
#include "base/memory.h"
#include "io/command.h"
#include "io/disk.h"

static const double MAKING_SECONDS = 120, WHOLE_SECONDS = 3600;
static const double MOST_PLAIN = 4e9; /* bytes */

bool cln_reel_is(const cln_reel *reel, const char *name)
{
    return reel->name[0] && cln_ask_same_token(name, reel->name);
}

const char *cln_reel_file(const cln_reel *reel)
{
    return reel->plain ? "film.y4m" : "film.mp4";
}

const char *cln_reel_type(const cln_reel *reel)
{
    return reel->plain ? "video/x-yuv4mpeg" : "video/mp4";
}

void cln_reel_drop(cln_reel *reel)
{
    cln_film_abandon(reel->film);
    if (reel->path)
        (void)unlink(reel->path);
    if (reel->folder)
        (void)rmdir(reel->folder);
    free(reel->path);
    free(reel->folder);
    if (reel->whole)
        close(reel->file);
    memset(reel, 0, sizeof *reel);
}

void cln_reel_tend(cln_reel *reel, double seconds)
{
    reel->silent += seconds;
    if (reel->name[0] && reel->silent > (reel->whole ? WHOLE_SECONDS : MAKING_SECONDS))
        cln_reel_drop(reel);
}

cln_status cln_reel_begin(cln_reel *reel, const cln_ask *ask)
{
    cln_status st = CLN_OK;
    const char *place = getenv("TMPDIR");
    const double plain_bytes = 3.0 * ask->width * ask->height * ask->frames;

    if (reel->film)
        return cln_fail(CLN_USAGE,
                        "another film is being made (%d of %d frames); try again when it "
                        "is done",
                        reel->done, reel->frames);
    cln_reel_drop(reel);
    reel->plain = !cln_command_found("ffmpeg");
    if (reel->plain && plain_bytes > MOST_PLAIN)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "a film of %d x %d x %d would have %.1f GB, as ffmpeg is not installed "
                         "where the viewer runs; make it smaller, or install ffmpeg",
                         ask->width, ask->height, ask->frames, 1e-9 * plain_bytes));
    CLN_TRY(
        cln_asprintf(&reel->folder, "%s/cl-nascent-film-XXXXXX", place && *place ? place : "/tmp"));
    if (!mkdtemp(reel->folder)) {
        const int reason = errno;

        st = cln_fail(CLN_OUTPUT, "%s: cannot make a folder for a film: %s", reel->folder,
                      strerror(reason));
        free(reel->folder);
        reel->folder = NULL;
        goto done;
    }
    if (reel->plain)
        CLN_TRY(cln_disk_check(reel->folder, plain_bytes, "the film"));
    CLN_TRY(cln_path_join(&reel->path, reel->folder, cln_reel_file(reel)));
    CLN_TRY(cln_film_begin(
        reel->path,
        &(cln_film_form){
            .width = ask->width, .height = ask->height, .frames = ask->frames, .fps = ask->fps},
        &reel->film));
    CLN_TRY(cln_ask_make_token(reel->name));
    reel->width = ask->width;
    reel->height = ask->height;
    reel->frames = ask->frames;
    reel->silent = 0;
done:
    if (st != CLN_OK)
        cln_reel_drop(reel);
    return st;
}

cln_status cln_reel_add(cln_reel *reel, const uint8_t *rgb)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_film_add(reel->film, rgb));
    reel->done++;
    reel->silent = 0;
done:
    if (st != CLN_OK)
        cln_reel_drop(reel);
    return st;
}

cln_status cln_reel_end(cln_reel *reel)
{
    cln_status st = CLN_OK;
    cln_film *film = reel->film;
    struct stat about;

    if (reel->done < reel->frames)
        CLN_TRY(
            cln_fail(CLN_USAGE, "the film has only %d of its %d frames", reel->done, reel->frames));
    reel->film = NULL;
    CLN_TRY(cln_film_end(film));
    reel->file = open(reel->path, O_RDONLY | O_CLOEXEC);
    reel->whole = reel->file >= 0;
    if (!reel->whole || fstat(reel->file, &about) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", reel->path, strerror(errno)));
    reel->bytes = about.st_size;
    (void)unlink(reel->path);
    (void)rmdir(reel->folder);
    free(reel->path);
    free(reel->folder);
    reel->path = reel->folder = NULL;
    reel->silent = 0;
done:
    if (st != CLN_OK)
        cln_reel_drop(reel);
    return st;
}
