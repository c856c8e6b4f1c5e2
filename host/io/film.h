/* Films from pictures: through ffmpeg, which gets them as they come, or as YUV4MPEG2 (.y4m), which
 * needs no other program and which ffmpeg and players read. */
#ifndef CLN_FILM_H
#define CLN_FILM_H

#include <stdint.h>
#include "base/status.h"

/* Returns whether the name has a film's ending: .mp4 .mov .mkv .webm .gif .y4m. */
bool cln_film_named(const char *path);

/* Whether a film of that name can have alpha: .mov (ProRes 4444) and .webm (VP9); the sentence if
 * not, with the name. */
bool cln_film_takes_alpha(const char *path);
#define CLN_FILM_NO_ALPHA                                                                        \
    "--transparent: %s, a film of that kind, has no alpha; name it .mov (ProRes 4444) or .webm " \
    "(VP9), or give a folder for pictures with -o"

/* Frames a second: at least, as a film's length in time must stay a number that files hold. */
#define CLN_FILM_LEAST_FPS 0.001

/* Of a .gif: its delays are hundredths of a second, and players slow the shortest down. */
#define CLN_FILM_GIF_FPS 50

/* Frames a second as the fraction *num / *den that is meant: 29.97 is 30000/1001, as 23.976, 59.94
 * and 119.88 are of 24, 60 and 120; other numbers are the simplest fraction within 1e-9 of them. */
void cln_film_rate(double fps, int64_t *num, int64_t *den);

/* Reads frames a second, "25", "23.976" or "30000/1001", LEAST_FPS to 1000. False: it is not. */
bool cln_film_read_rate(const char *text, double *fps);

/* How a film is made. */
typedef struct cln_film_form {
    int width, height; /* of the pictures */
    int frames;        /* that will be added; 0: not known. Of a .gif all are in memory. */
    double fps;        /* as cln_film_rate takes it */
    bool alpha;        /* pictures have a fourth channel, straight alpha */
    bool overwrite;    /* a file that is there */
} cln_film_form;

/* Begins a film. If ffmpeg is not installed, the film becomes a .y4m file, with a warning. It has a
 * temporary name until cln_film_end. CLN_OUTPUT if there is a file already, unless form->overwrite;
 * CLN_USAGE if it cannot have alpha or so many frames a second; CLN_MEMORY if a .gif of so many has
 * no room in memory; CLN_FAILED if it needs ffmpeg for alpha. */
typedef struct cln_film cln_film;
const char *cln_film_path(const cln_film *f); /* the file that it will be */
bool cln_film_is_plain(const cln_film *f);    /* .y4m: 3 bytes a pixel and frame */
cln_status cln_film_begin(const char *path, const cln_film_form *form, cln_film **out);

cln_status cln_film_add(cln_film *film, const uint8_t *pixels); /* [height][width][3 or 4] */

/* Completes a film, or removes it. Call exactly one of them; both free it. */
cln_status cln_film_end(cln_film *film);
void cln_film_abandon(cln_film *film); /* accepts NULL */

#endif
