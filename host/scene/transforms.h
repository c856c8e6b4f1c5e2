/* What reader_transforms.c (splits, bounds), transforms_keys.c (documents, their keys) and
 * transforms_frame.c (one frame) share; private to them and to render/pose_file.c. `file` and
 * `where` begin the sentences of errors. */
#ifndef CLN_SCENE_TRANSFORMS_H
#define CLN_SCENE_TRANSFORMS_H

#include <jansson.h>
#include "scene/moved.h"
#include "scene/scene.h"

/* Reads a document. Members of it and of its frames that are null count as absent and are not in
 * *root: other programs write them for what they do not know. The caller decrefs it. */
cln_status cln_transforms_read(const char *file, json_t **root);

/* The number under `key`, or *found = false and *out untouched; another type is CLN_INPUT. */
cln_status cln_transforms_number(const char *where, const json_t *object, const char *key,
                                 double *out, bool *found);

/* Adds the names of the members of a frame, or of the document, that are not read there to *list
 * (an array of strings, made if it is NULL), each once. */
cln_status cln_transforms_ignored(const json_t *object, bool frame, json_t **list);

/* Fills name, path and pose of a zeroed view from frames[index] of the document. Image files are
 * looked for from `folder`. On failure the view may be partly filled. */
cln_status cln_transforms_frame(const char *folder, const char *file, const json_t *root, int index,
                                cln_view *view);

/* Fills mask and intrinsics of a view whose path is final, if there is a file. */
cln_status cln_transforms_finish(const char *folder, const char *file, const json_t *root,
                                 int index, cln_moved *moved, cln_view *view);

/* Is there an alpha file as instant-ngp looks for, FILE_PATH.alpha.png, where the frame names none?
 * It is not read. */
cln_status cln_transforms_unread_alpha(const json_t *root, int index, const cln_view *view,
                                       bool *found);

/* Name and camera of frames[index], checked, for a picture to be rendered: no image need be there.
 * *camera has the size to take if neither file nor image gives one: *sized is false then. Without a
 * file_path its name is pose_0000. The caller frees *name, also on failure. */
cln_status cln_transforms_camera(const char *folder, const char *file, const json_t *root,
                                 int index, char **name, cln_camera *camera, bool *sized);

#endif
