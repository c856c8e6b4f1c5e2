/* Do two rays of a tie meet, with cameras as given or with others that are tried? And which others
 * fit best: readings of the poses (readings.c), focal lengths of all photos or of some, orders of
 * the poses, axes and units of positions alone, a tilt of all cameras. Part of agree.h, which finds
 * the ties. */
#ifndef CLN_TRIALS_H
#define CLN_TRIALS_H

#include "scene/agreement.h"

/* Cameras that are tried in place of the given ones. */
typedef struct cln_trial {
    const cln_reading *reading; /* of all poses */
    double focal;               /* factor on focal lengths: of the views of `group`, NULL: of all */
    const bool *group;          /* [view] */
    const int *pose_of;         /* [view] whose pose its photo has, -1: none; NULL: its own */
    const double (*poses)[12];  /* [view] instead of the given ones, as cln_reading_pose; NULL */
    double strict;              /* share of a tie's tolerance that counts */
} cln_trial;

/* Finds how far along two rays, with b from one's origin to the other's, they come nearest to each
 * other; false if they are too parallel. */
bool cln_rays_nearest(const double b[3], const double d1[3], const double d2[3], double *s,
                      double *t);

/* Do they meet, up to an angle, before both origins? */
bool cln_rays_meet(const double o1[3], const double d1[3], const double o2[3], const double d2[3],
                   double tolerance);

bool cln_tie_agrees(const cln_scene *scene, const cln_tie *tie, const cln_trial *trial);

/* Fills reading, reading_share, given_share, focal, focal_share, focal_exact, strict_share. */
void cln_try_readings(const cln_scene *scene, cln_agreement *out);

/* Fills `part`, `order` and `place`, if a large part of the ties does not agree. CLN_MEMORY. */
cln_status cln_try_parts(const cln_scene *scene, cln_agreement *out);
cln_status cln_try_orders(const cln_scene *scene, cln_agreement *out);
cln_status cln_try_places(const cln_scene *scene, cln_agreement *out);

/* Fills tilt, tilt_exact, if cameras stand around something. CLN_MEMORY. */
cln_status cln_try_tilts(const cln_scene *scene, cln_agreement *out);

#endif
