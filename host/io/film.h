/* Films from pictures: through ffmpeg, which gets them as they come, or as YUV4MPEG2 (.y4m), which
 * needs no other program and which ffmpeg and players read. */
#ifndef CLN_FILM_H
#define CLN_FILM_H

#include <stdint.h>
#include "base/status.h"

/* Returns whether the name has a film's ending: .mp4 .mov .mkv .webm .gif .y4m. */
bool cln_film_named(const char *path);

/* Fewer frames a second would be 0 in the head of a .y4m file. */
#define CLN_FILM_LEAST_FPS 0.001

/* Begins a film; pictures are width x height. If ffmpeg is not installed, the film becomes a .y4m
 * file, with a warning. It has a temporary name until cln_film_end. CLN_OUTPUT if there is a file
 * already, unless `overwrite` is set. */
typedef struct cln_film cln_film;
const char *cln_film_path(const cln_film *f); /* the file that it will be */
bool cln_film_is_plain(const cln_film *f);    /* .y4m: 3 bytes a pixel and frame */
cln_status cln_film_begin(const char *path, int width, int height, double fps, bool overwrite,
                          cln_film **out);

cln_status cln_film_add(cln_film *film, const uint8_t *rgb); /* [height][width][3] */

/* Completes a film, or removes it. Call exactly one of them; both free it. */
cln_status cln_film_end(cln_film *film);
void cln_film_abandon(cln_film *film); /* accepts NULL */

#endif
