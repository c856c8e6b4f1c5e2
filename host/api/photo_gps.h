/* Where photos were taken by the GPS positions in their EXIF data, and a model that is turned,
 * scaled and moved to these. */
#ifndef CLN_PHOTO_GPS_H
#define CLN_PHOTO_GPS_H

#include <stdbool.h>
#include "api/colmap.h"

typedef struct cln_photo_gps {
    int count; /* photos with latitude, longitude and altitude; if flat, with the first two */
    int level; /* photos with latitude and longitude, and ones with an altitude beside them: */
    int high;  /* where these are too few, altitudes are 0: */
    bool flat;
    double (*at)[3]; /* [photo] these three, degrees and metres; NAN where it cannot be used */
} cln_photo_gps;

/* Reads those of photos in a folder. CLN_INPUT for a photo that cannot be read, CLN_MEMORY. Free
 * *out either way. */
cln_status cln_photo_gps_read(const char *folder, const cln_names *photos, cln_photo_gps *out);
void cln_photo_gps_free(cln_photo_gps *gps);

/* Refuses photos of which fewer than three have latitude and longitude. photos: how many there are.
 * CLN_INPUT. */
cln_status cln_photo_gps_check(const cln_photo_gps *gps, const char *folder, int photos);

/* Whether positions lie far enough apart for GPS, which is some metres off, to tell how large the
 * scene is. photos: how many there are. */
bool cln_photo_gps_wide(const cln_photo_gps *gps, int photos);

/* Replaces sparse/0 of the scene's folder by one that is turned, scaled and moved to positions,
 * and fills in result's placed, origin and what belongs to it. The cameras of `scene`, which was
 * read there, tell up, too (place_turn.h). Where positions do not fit, or COLMAP cannot, the model
 * stays as it was, and a warning says why. c->photos: in natural order, as those of gps.
 * CLN_OUTPUT, CLN_MEMORY, CLN_SIGINT, CLN_SIGTERM: likewise. */
cln_status cln_photo_gps_place(cln_colmap *c, const cln_photo_gps *gps, const cln_scene *scene,
                               cln_poses_result *result);

#endif
