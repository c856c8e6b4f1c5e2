/* Which photos one camera took with one focal length, as far as their sizes and EXIF data tell. */
#ifndef CLN_PHOTO_CAMERAS_H
#define CLN_PHOTO_CAMERAS_H

#include <stdbool.h>
#include "scene/dataset.h"

typedef struct cln_photo_cameras {
    int count;
    int *camera;         /* [photo] from 0, in the order in which they come */
    int *photos;         /* [camera] how many photos it has */
    int longest;         /* side of any photo, in pixels */
    double pixels;       /* of the largest photo */
    bool *sphere;        /* [camera] its photos are panoramas of the whole sphere: by XMP data, or
                            by 2 : 1 and no focal length that a lens of one picture has */
    int panoramas, told; /* photos of such cameras; of these, by XMP data */
    int cuts, cut;       /* panoramas of a part of the sphere, by XMP data; the first: a photo */
    int guessed;         /* the first panorama that is one by its shape: a photo; -1: none */
    bool sizes, lengths; /* photos differ in size; those of one size in focal length */
} cln_photo_cameras;

/* Photos of one size whose focal lengths differ by less than 2 % are one camera's; so are those of
 * one size without any. CLN_INPUT for a photo that cannot be read, CLN_MEMORY. Free *out either
 * way. */
cln_status cln_photo_cameras_find(const char *folder, const cln_names *photos,
                                  cln_photo_cameras *out);
void cln_photo_cameras_free(cln_photo_cameras *cameras);

/* Has an image of 2 : 1 two round pictures side by side on black, as fisheye lenses on both sides
 * of a camera make them? CLN_INPUT, CLN_MEMORY. */
cln_status cln_photo_has_circles(const char *path, bool *circles);

/* Whether every name can be a line of a list as COLMAP reads it. */
bool cln_photo_cameras_listable(const cln_names *photos);

/* Writes the names of a camera's photos to a file, a line each. CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_photo_cameras_list(const cln_photo_cameras *cameras, const cln_names *photos,
                                  int camera, const char *path);

#endif
