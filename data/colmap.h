/* Writes a scene as COLMAP's sparse model, in text: its cameras, and points of its surfaces that
 * two views or more see, where they are exactly. */
#ifndef DATA_COLMAP_H
#define DATA_COLMAP_H

#include "scene/scene.h"
#include "scenes.h"

typedef struct colmap_scene {
    const char *out; /* folder of the scene; the model is in its sparse/0 */
    const world *world;
    int count, seed;
    const cln_camera *exact; /* [count] pinholes that took the photos */
    char *const *names;      /* [count] images/NAME, without ".png" */
    double unit;             /* written points: unit * the world's + offset */
    const double *offset;    /* [3] */
} colmap_scene;

/* cameras: as the model states them, right or wrong. CLN_OUTPUT. */
cln_status colmap_write(const colmap_scene *scene, const cln_camera *cameras);

#endif
