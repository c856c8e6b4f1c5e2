/* A COLMAP sparse model as its files have it (colmap_model.c), for reader_colmap.c alone. */
#ifndef CLN_SCENE_COLMAP_H
#define CLN_SCENE_COLMAP_H

#include "scene/reader.h"

typedef struct cln_colmap_camera {
    uint32_t id;
    const cln_colmap_model *model; /* of the table in lens.h */
    int width, height;
    double params[CLN_COLMAP_PARAMS];
} cln_colmap_camera;

typedef struct cln_colmap_image {
    char *name;
    double pose[7]; /* world to camera: quaternion w x y z, translation */
    uint32_t id, camera;
} cln_colmap_image;

typedef struct cln_colmap {
    char *camera_file, *image_file; /* for sentences */
    int camera_count, image_count, point_count;
    cln_colmap_camera *cameras;
    cln_colmap_image *images;
    cln_point *points;
    int64_t observation_count;
    cln_observation *observations; /* view: the image's id, as cln_colmap_read leaves it */
} cln_colmap;

/* Does the folder have a model: cameras and images, both .bin or both .txt? *missing as in
 * cln_reader. */
bool cln_colmap_is_model(const char *folder, const char **missing);

/* Reads the model's .bin files or, without them, its .txt files; points are optional. CLN_INPUT
 * names the file and what is wrong; *out may then be partly filled. */
cln_status cln_colmap_read(const char *folder, cln_colmap *out);
void cln_colmap_free(cln_colmap *model);

#endif
