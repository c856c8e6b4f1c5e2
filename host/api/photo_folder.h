/* The photos whose poses are to be found, in a folder of the scene: links to them, or the frames of
 * a video, taken by ffmpeg. What is there of an earlier attempt must not mix with them. */
#ifndef CLN_PHOTO_FOLDER_H
#define CLN_PHOTO_FOLDER_H

#include <stdbool.h>
#include <stdio.h>
#include "cl_nascent.h"
#include "scene/dataset.h"

/* Whether a path is a video: no folder, by its name. */
bool cln_photos_are_video(const char *path);

/* Whether the log of an earlier attempt has a command that made frames. */
bool cln_photos_were_framed(const char *log);

/* Whether a scene may be made in the folder `out`: CLN_OUTPUT if it has things of no earlier
 * attempt beside images and masks, unless the photos, a folder or a video, are directly in it. */
cln_status cln_photos_check_out(const char *photos, const char *out);

typedef struct cln_film {
    double duration; /* seconds */
    double frames;   /* 0: the file does not tell */
} cln_film;

/* Asks ffprobe about the video desc->photos, before anything is written. CLN_FAILED if it or ffmpeg
 * is not there, CLN_INPUT if the file is no video, CLN_SIGINT and CLN_SIGTERM. */
cln_status cln_photos_probe(const cln_poses_desc *desc, cln_film *out);

/* Puts frames of the video into the folder `images`, and removes those of an earlier attempt, if
 * that was `framed`; log gets what ffmpeg says, log_path is its name. CLN_FAILED if ffmpeg fails,
 * CLN_OUTPUT if there is anything else in the folder or no room on its disk, CLN_SIGINT and
 * CLN_SIGTERM. */
cln_status cln_photos_take_frames(const cln_poses_desc *desc, const cln_film *film, bool framed,
                                  const char *images, FILE *log, const char *log_path);

/* The images in a folder, ordered: photos, and the masks among them: what lies in a folder of it
 * that is called masks, or in `masks` (a file: that itself; NULL: none), and NAME_mask of a photo
 * NAME. The caller frees both. CLN_INPUT, CLN_MEMORY. */
cln_status cln_photos_find(const char *folder, const char *masks, cln_names *photos,
                           cln_names *among);

/* Links or copies these photos of a folder, or their masks, to the folder `to`, unless it is the
 * same. CLN_OUTPUT if that has others, or another one of a name. */
cln_status cln_photos_link(const char *folder, const cln_names *names, const char *to, bool masks);

/* The same of one file, of which `to` is the new name. */
cln_status cln_photos_link_file(const char *from, const char *to, bool masks);

#endif
