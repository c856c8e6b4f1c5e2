/* What a cameras.xml of Agisoft Metashape (File > Export > Export Cameras, Agisoft XML) says. The
 * geometry is in reader_metashape.c. Needs expat; without it cln_metashape_read fails, which says
 * so. */
#ifndef CLN_METASHAPE_H
#define CLN_METASHAPE_H

#include <stdbool.h>
#include "base/status.h"

enum { CLN_METASHAPE_BYTES = 256 }; /* of a text */

typedef enum cln_metashape_kind {
    CLN_METASHAPE_FRAME,
    CLN_METASHAPE_FISHEYE, /* equidistant */
    CLN_METASHAPE_SPHERICAL,
    CLN_METASHAPE_OTHER
} cln_metashape_kind;

/* f, b1, b2 and the principal point's offset from the image's middle, cx and cy, in pixels. */
typedef struct cln_metashape_sensor {
    int id, width, height;
    cln_metashape_kind kind;
    bool calibrated, adjusted; /* has a calibration; and that is the one that was adjusted */
    double f, cx, cy, b1, b2, k[4], p[4];
} cln_metashape_sensor;

/* A camera, that is a photo. */
typedef struct cln_metashape_camera {
    char label[CLN_METASHAPE_BYTES]; /* the photo's name, mostly without its ending */
    int sensor, component;           /* ids; component -1: none */
    bool enabled, aligned;           /* aligned: `pose` is there */
    double pose[16];                 /* row-major, camera (x right, y down, z forward) to chunk */
} cln_metashape_camera;

/* From the chunk's own coordinates to x = scale R chunk + translation. */
typedef struct cln_metashape_transform {
    int component; /* id; -1: the chunk's */
    bool has_rotation, has_translation, has_scale;
    double rotation[9], translation[3], scale;
} cln_metashape_transform;

typedef struct cln_metashape {
    int sensor_count, camera_count, transform_count, chunks;
    cln_metashape_sensor *sensors;
    cln_metashape_camera *cameras;
    cln_metashape_transform *transforms;
    bool has_region;
    int region_component; /* id of the component that it is of; -1: of all */
    double region_centre[3], region_size[3], region_turn[9]; /* in the chunk's coordinates */
    char reference[CLN_METASHAPE_BYTES]; /* "LOCAL_CS[...", "GEOGCS[...": begins so; or "" */
} cln_metashape;

/* Reads the first chunk that has aligned cameras; `chunks` counts those that have. CLN_INPUT:
 * "path: line L column C: reason". cln_metashape_free also after a failure. */
cln_status cln_metashape_read(const char *path, cln_metashape *out);
void cln_metashape_free(cln_metashape *m);

#endif
