/* Cameras as members of a transforms JSON file in nerfstudio's form: what export/cameras.c writes
 * of a scene and api/render_folder.c of rendered frames. Reading is reader_transforms.c's. */
#ifndef CLN_SCENE_TRANSFORMS_WRITE_H
#define CLN_SCENE_TRANSFORMS_WRITE_H

#include <jansson.h>
#include <stdbool.h>
#include "scene/scene.h"

/* Adds size, focal lengths, middle and lens parameters to a frame, or to the document. Not the
 * lens' name, camera_model, which nerfstudio looks for in the document alone. False without
 * memory. */
bool cln_transforms_put_camera(json_t *to, const cln_camera *camera);

/* A frame of that file_path with the camera's pose, camera to scene with OpenGL's axes; positions
 * times scale. NULL without memory. */
json_t *cln_transforms_new_frame(const char *file_path, const cln_camera *camera, double scale);

#endif
