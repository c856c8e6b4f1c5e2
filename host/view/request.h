/* What a page asks for, read from the texts of its request: a picture, a photo, a point, a film.
 * Bounds and defaults are here; no HTTP, no device. Nothing in a request names a file: photos go by
 * number, a film by a name that the viewer made up. */
#ifndef CLN_VIEW_REQUEST_H
#define CLN_VIEW_REQUEST_H

#include "render/crop.h"
#include "scene/scene.h"

enum {
    CLN_ASK_SIDE = 8192,       /* pixels */
    CLN_ASK_PIXELS = 1 << 23,  /* a little more than 3840 x 2160 */
    CLN_ASK_PHOTO_SIDE = 2048, /* longer side of a photo as sent */
    CLN_VIEWER_BYTES = 32,
    CLN_FILM_FRAMES = 7200,
    CLN_FILM_NAME = 33 /* of cln_ask_make_token */
};
#define CLN_FILM_PIXELS 1e10 /* of all frames together: 1920 x 1080, 3 min 20 s at 24 a second */

typedef enum {
    CLN_ASK_PICTURE,
    CLN_ASK_PHOTO,
    CLN_ASK_POINT,
    CLN_ASK_FILM_BEGIN,
    CLN_ASK_FILM_FRAME, /* a picture that is added to the film */
    CLN_ASK_FILM_END,
    CLN_ASK_FILM_DROP,
    CLN_ASK_FILM_FILE,
    CLN_ASK_KINDS
} cln_ask_kind;
typedef enum {
    CLN_SHOW_COLOUR,
    CLN_SHOW_DEPTH,
    CLN_SHOW_OPACITY,
    CLN_SHOW_LEVEL, /* the leaf of each pixel's surface, by level or by error (tree_picture.h) */
    CLN_SHOW_ERROR,
    CLN_SHOWS
} cln_show;

typedef struct cln_ask {
    cln_ask_kind kind;
    int view;          /* index into the scene's views, whose photo or camera it is; or -1 */
    int side;          /* photo: at most so many pixels */
    cln_camera camera; /* picture, point: at full size; scene units; of a view as its pixels are
                          stored, and without its pose, which the painter takes */
    double x, y;       /* point: pixel position in the camera's picture */
    double budget;     /* picture: seconds that it may take, for which its size is reduced; 0 = full
                          size, however long it takes */
    bool edges;        /* picture: pixels at edges as the model learnt them, if by several rays */
    cln_show show;
    bool png;                  /* else JPEG */
    float background[3];       /* picture, photo */
    cln_crop crop;             /* picture, point */
    int width, height, frames; /* film to begin */
    double fps;
    char film[CLN_FILM_NAME]; /* name of a film; "" before it begins */
} cln_ask;

/* The text of a query's value, or NULL. */
typedef const char *cln_ask_get(void *query, const char *name);

/* Reads the query of /picture, /photo, /point or one of /film:
 *   view=I                 the camera of view I of the scene, or
 *   pose=12 numbers        camera to world, row-major 3x4, OpenCV's axes, scene units, with
 *   focal=PIXELS           of both axes at the full size
 *   width= height=         full size (of a view: 0 or none as the photo, or by the other), as the
 *                          picture is seen: of a view turned as its photo (cln_view_turn)
 *   crop=X0,Y0,Z0,X1,Y1,Z1[,RX,RY,RZ] only what is in this box; scene units, degrees
 *   ms= edges=0|1 show=colour|depth|opacity|level|error format=jpeg|png background=R,G,B (0..1)
 *                          picture
 *   x= y=                  point, in the picture as it is seen
 *   view=I side=PIXELS background=   photo
 *   width= height= frames= fps=      film to begin
 *   film=NAME              further requests of a film; a frame: also a picture's but ms, format
 * scene may be NULL: no view then. CLN_USAGE names what is wrong. */
cln_status cln_ask_read(cln_ask_kind kind, const cln_scene *scene, const float background[3],
                        cln_ask_get *get, void *query, cln_ask *out);

/* Decides who may ask. `host`, `origin` and `site` are the headers Host, Origin and Sec-Fetch-Site,
 * or NULL. False with a reason for a Host that is not this machine's loopback by name or number;
 * for an Origin other than the Host; and for a page of another site. With `far` (others may ask,
 * with a token), the Host may have any name, as a container or a router gives it: a page whose name
 * was made to lead here (DNS rebinding) has neither the token nor the cookie, which the browser
 * keeps by the name that was opened. */
bool cln_ask_allowed(const char *host, const char *origin, const char *site, bool far,
                     const char **reason);

/* 32 random hexadecimal digits. CLN_FAILED. */
cln_status cln_ask_make_token(char out[33]);

/* Whether two texts are equal, in a time that does not depend on where they differ. NULL equals
 * nothing. */
bool cln_ask_same_token(const char *given, const char *wanted);

#endif
