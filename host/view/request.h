/* What a page asks for, read from the texts of its request: a picture, a photo, a point. Bounds and
 * defaults are here; no HTTP, no device. Nothing in a request names a file: photos go by number. */
#ifndef CLN_VIEW_REQUEST_H
#define CLN_VIEW_REQUEST_H

#include "scene/scene.h"

enum {
    CLN_ASK_SIDE = 8192,       /* pixels */
    CLN_ASK_PIXELS = 1 << 23,  /* a little more than 3840 x 2160 */
    CLN_ASK_PHOTO_SIDE = 2048, /* a photo's longer side as it is sent */
    CLN_VIEWER_BYTES = 32
};

typedef enum { CLN_ASK_PICTURE, CLN_ASK_PHOTO, CLN_ASK_POINT } cln_ask_kind;
typedef enum { CLN_SHOW_COLOUR, CLN_SHOW_DEPTH, CLN_SHOW_OPACITY } cln_show;

typedef struct cln_ask {
    cln_ask_kind kind;
    int view;          /* photo: index into the scene's views */
    int side;          /* photo: at most so many pixels */
    cln_camera camera; /* picture, point: at full size; scene units */
    double x, y;       /* point: pixel position */
    double budget;     /* picture: seconds that it may take, its size is reduced for that; 0 = full
                          size however long */
    cln_show show;
    bool png; /* else JPEG */
    float background[3];
} cln_ask;

/* The text of a query's value, or NULL. */
typedef const char *cln_ask_get(void *query, const char *name);

/* Reads the query of /picture, /photo or /point:
 *   view=I                 the camera of view I of the scene, or
 *   pose=12 numbers        camera to world, row-major 3x4, OpenCV's axes, scene units, with
 *   focal=PIXELS           of both axes at the full size
 *   width= height=         full size (of a view: 0 or none as the photo, or by the other)
 *   ms= show=colour|depth|opacity format=jpeg|png background=R,G,B (0..1)    picture
 *   x= y=                  point
 *   view=I side=PIXELS     photo
 * scene may be NULL: no view then. CLN_USAGE names what is wrong. */
cln_status cln_ask_read(cln_ask_kind kind, const cln_scene *scene, const float background[3],
                        cln_ask_get *get, void *query, cln_ask *out);

/* Who may ask. `host`, `origin` and `site` are the headers Host, Origin and Sec-Fetch-Site, or
 * NULL. False with a reason for a Host that is neither this machine's loopback by name or number
 * nor, with `far` (others may ask, with a token), a numeric address or a name of this machine
 * (`own`); for an Origin other than the Host; and for a page of another site. */
bool cln_ask_allowed(const char *host, const char *origin, const char *site, bool far,
                     const char *own, const char **reason);

/* Whether two texts are equal, in a time that does not depend on where they differ. NULL equals
 * nothing. */
bool cln_ask_same_token(const char *given, const char *wanted);

#endif
