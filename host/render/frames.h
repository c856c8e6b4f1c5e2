/* What `render` shows: a list of cameras with names, from a split, a file of poses, an orbit, a
 * spiral, or a path through poses. Geometry and reading only; files of pictures are
 * api/render.c's. */
#ifndef CLN_FRAMES_H
#define CLN_FRAMES_H

#include <jansson.h>
#include "cl_nascent.h"
#include "render/crop.h"
#include "render/orbit.h"

typedef struct cln_frame {
    char *name; /* of its files, without ending */
    cln_camera camera;
} cln_frame;

typedef struct cln_frames {
    int count;
    cln_frame *frame;  /* [count] */
    const char *poses; /* where they come from: "test", "orbit", "spiral", "file", "path" */
    bool foreign;      /* a camera_path.json that may be in nerfstudio's frame */
    double fps;        /* as their file says; 0 = it does not */
    cln_crop crop;     /* likewise, with the colour around it */
    float crop_background[3];
} cln_frames;

/* Whether run.json has all that desc's frames need of the scene, as it has for an orbit. */
bool cln_frames_have_orbit(const cln_render_desc *desc, const json_t *run);

/* Whether desc's frames need the scene's cameras: all others, and an orbit about another up. */
bool cln_frames_need_scene(const cln_render_desc *desc, const json_t *run);

/* The frames that desc asks for. scene: NULL if they need none. CLN_USAGE, CLN_INPUT,
 * CLN_MEMORY. */
cln_status cln_frames_make(const cln_render_desc *desc, const cln_scene *scene, const json_t *run,
                           cln_frames *out);
void cln_frames_free(cln_frames *frames); /* accepts a zeroed one */

/* Room for `count` frames, zeroed, in an empty list. */
cln_status cln_frames_room(int count, cln_frames *out);

/* Where the transforms JSON is, folder or file, that the poses of the run's scene come from: NULL
 * of scenes of other formats, and if it is not there (*gone). scene: where it was read from; NULL:
 * where the run finds it. dialect: the scene's. The caller frees *path. */
cln_status cln_frames_transforms(const char *run, const char *scene, const char *dialect,
                                 char **path, bool *gone);

/* ---- pose_file.c ---- */

/* Sizes of pictures, where neither a file of poses nor a photo gives them. Lenses of transforms
 * JSON are of the photos' files, as in a scene; those of a path are angles. */
typedef struct cln_frame_sizes {
    int width, height;           /* of a path: the training views' */
    int file_width, file_height; /* of transforms frames: the first training view's file's */
    bool vary;                   /* not all photos have that one */
} cln_frame_sizes;

/* Reads nerfstudio's camera_path.json, or the frames of a transforms JSON file with its lenses.
 * CLN_INPUT. */
cln_status cln_frames_read(const char *path, const cln_frame_sizes *sizes, cln_frames *out);

/* ---- pose_frame.c ---- */

/* nerfstudio's dataparser_transforms.json beside a path; if there is none, NULL, and a line of the
 * log says what it would do. The caller frees *path. */
cln_status cln_frames_dataparser(const char *poses, char **path);

/* What ns-process-data did to the poses of such a scene, which is its folder or file: p' = scale
 * (R p + t), R | t in applied, [3][4]. None if it says nothing, or is no transforms JSON.
 * CLN_INPUT. */
cln_status cln_frames_applied(const char *scene, double applied[12], double *scale);

/* Brings the poses of a path, and its crop, by that file from nerfstudio's frame to the scene's,
 * and says so. scene: the scene's folder or file if that is transforms JSON, which may say what was
 * done to its poses before; else NULL. CLN_INPUT. */
cln_status cln_frames_from_nerfstudio(const char *path, const char *poses, const char *scene,
                                      cln_frames *out);

/* ---- path.c ---- */

/* A smooth path of `count` frames through the keys, in their order, at an even pace, from the first
 * to the last: cubic splines of positions and quaternions. Size and lens are the first key's; if
 * lenses differ, a pinhole of the first key's size that is no panorama. Focal lengths change evenly
 * from key to key, but for panoramas'. around: what the keys stand around, to which the path keeps
 * distance and direction if they look at it; NULL = nothing. up: the direction against which the
 * path rolls as its keys do; NULL = none. closed: it goes on from the last key to the first, and
 * the last frame is the one before the first again. CLN_USAGE for fewer than two keys. */
cln_status cln_frames_through(const cln_frames *keys, int count, const cln_orbit_frame *around,
                              const double *up, bool closed, cln_frames *out);

/* ---- spiral.c ---- */

/* A closed path of two turns. If the cameras stand all around, it leads around the target, up and
 * down within their elevations. Else, as for forward-facing cameras, it leads around their mean
 * pose, as wide as they stand, and looks at the target's distance. desc: frames, size, field of
 * view, radius. */
cln_status cln_frames_spiral(const cln_scene *scene, const cln_render_desc *desc, cln_frames *out);

#endif
