/* Scene of the ray benches: a full tree with random densities, seen by cameras around it. */
#ifndef BENCH_SCENE_H
#define BENCH_SCENE_H

#include "bench.h"

enum { SCENE_VIEWS = 4, SCENE_SIDE = 1024 };

typedef struct bench_scene {
    cln_pipeline *p;
    cln_model model;
    cln_camera cameras[SCENE_VIEWS];
    cln_pixel *pixels;
    int rays;
    float *cache; /* the model's densities as floats */
    float *boxes;
} bench_scene;

/* Uploads everything and makes the rays of a batch of `rays` pixels, in order of view and row. */
cln_status bench_scene_start(bench *b, const cln_config *config, bool distortion, int rays,
                             bench_scene *s);
void bench_scene_free(bench_scene *s);

#endif
