/* Which way is up in a scene, told by its training cameras or by the user. */
#ifndef CLN_UP_H
#define CLN_UP_H

#include "scene/scene.h"

/* A unit vector in the scene's frame: an axis exactly, if it is within 0.1 degrees of one; z if the
 * cameras do not tell. False if it may as well be the opposite: photos that show the scene one way
 * up and the other, as of an object that was turned over, cancel out; then it is that of the
 * first. Where the scene's format has a fixed one, it is that; one by GPS alone only if it is
 * within 2 degrees of that of cameras which tell it. */
bool cln_up_of_cameras(const cln_scene *scene, double up[3]);

/* How far up and back must tell a side: flights that look down do by 0.25, and a quarter of the
 * photos upside down leaves more. */
#define CLN_UP_UNSURE 0.15

/* What the training cameras alone tell as ones that are held level: */
typedef enum cln_up_what {
    CLN_UP_UNTOLD,
    CLN_UP_LEVEL, /* that `level`, along which all their x axes lie, is horizontal */
    CLN_UP_TOLD   /* up */
} cln_up_what;
typedef struct cln_up_told {
    cln_up_what what;
    double up[3], level[3]; /* unit */
    double sd;              /* radians, of up or level */
    /* Above the horizon: mean of the pictures' up and, weighed less, of what is behind them. Less
     * than CLN_UP_UNSURE above or below it tells no side. */
    double rough[3];
} cln_up_told;
void cln_up_tell(const cln_scene *scene, cln_up_told *out);

/* Warns that it may, with the way out. what: what is made of it. */
void cln_up_warn(const char *what, const double up[3]);

/* Of a desc's member `up`: is one given? All 0 is none. */
bool cln_up_given(const double up[3]);

/* Of a desc of this call: CLN_USAGE unless it is a vector or all 0. */
cln_status cln_up_check(const char *call, const double up[3]);

/* Of an option: x, y, z, -x, -y, -z, or three numbers with commas, a vector longer than about 0; or
 * auto, for which it is all 0. CLN_USAGE; name: what the message calls it. */
cln_status cln_up_read(const char *name, const char *text, double up[3]);

#endif
