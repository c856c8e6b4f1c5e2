/* Films from pictures: through ffmpeg, which gets them as they come, or as YUV4MPEG2 (.y4m), which
 * needs no other program and which ffmpeg and players read. */
#ifndef CLN_FILM_H
#define CLN_FILM_H

#include <stdint.h>
#include "base/status.h"

/* Does the name end as a film's: .mp4 .mov .mkv .webm .gif .y4m? */
bool cln_film_named(const char *path);

/* Begins a film; pictures are width x height. Where ffmpeg is not installed, it becomes a .y4m file
 * with a warning. It lies under a temporary name until cln_film_end. The file at *path must not be
 * there, or may be replaced (overwrite): else CLN_OUTPUT. */
typedef struct cln_film cln_film;
const char *cln_film_path(const cln_film *f); /* of the file that it becomes */
cln_status cln_film_begin(const char *path, int width, int height, double fps, bool overwrite,
                          cln_film **out);

cln_status cln_film_add(cln_film *film, const uint8_t *rgb); /* [height][width][3] */

/* Completes it, or leaves nothing of it: one of them; both free it. */
cln_status cln_film_end(cln_film *film);
void cln_film_abandon(cln_film *film); /* accepts NULL */

#endif
