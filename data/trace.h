/* Analytic ray tracing of closed-form shapes, in double: the first shape that a ray hits, the place
 * and the normal. shade.h has the colours. */
#ifndef DATA_TRACE_H
#define DATA_TRACE_H

#include <stdbool.h>
#include "base/status.h"
#include "vec.h"

/* Shapes in a local frame (u, v, w) around `centre`. */
typedef enum {
    SHAPE_SPHERE,  /* radius a */
    SHAPE_BOX,     /* half sides a, b, c */
    SHAPE_FRUSTUM, /* along w, capped: radius a at -c, radius b at +c; a = b is a cylinder */
    SHAPE_CAPSULE, /* along w: radius a, half length c without its caps */
    SHAPE_TORUS    /* around w: radius a to the middle of the tube, b of the tube; b < a */
} shape_kind;

typedef struct shape {
    shape_kind kind;
    vec centre, u, v, w;
    double a, b, c;
    int material;  /* shade.h */
    vec low, high; /* bounding box, set by shapes_finish */
} shape;

typedef struct tree_node {
    vec low, high;
    /* Leaf: `count` shapes from order[first]. Inner node: count 0, children first, first + 1. */
    int first, count;
} tree_node;

/* The shapes of a scene with a bounding-volume tree over them. */
typedef struct shapes {
    int count, capacity;
    shape *list;
    tree_node *nodes;
    int *order;
} shapes;

typedef struct hit {
    double t;         /* distance along the unit direction */
    vec normal;       /* unit, world, towards the ray's origin */
    vec local;        /* hit point in the shape's frame */
    vec local_normal; /* outward, in the shape's frame */
    const shape *shape;
} hit;

/* Appends a copy of *s (frame vectors unit and orthogonal). */
cln_status shapes_add(shapes *scene, const shape *s);

/* Makes bounding boxes and tree; call once after the last shapes_add. */
cln_status shapes_finish(shapes *scene);
void shapes_free(shapes *scene);

/* Finds the nearest hit with t in (t_min, t_max); false without any. */
bool shapes_hit(const shapes *scene, vec origin, vec direction, double t_min, double t_max,
                hit *out);

/* Returns whether anything lies in (t_min, t_max). */
bool shapes_blocked(const shapes *scene, vec origin, vec direction, double t_min, double t_max);

#endif
