/* The generated scenes, as lists of shapes and materials. All but the street's background fit in
 * [-1.5, 1.5]^3; z is up. */
#ifndef DATA_SCENES_H
#define DATA_SCENES_H

#include "shade.h"

/* A scene under construction: calls after a failure do nothing, and `st` holds the first
 * failure. */
typedef struct builder {
    world *world;
    vec shift; /* added to every position */
    cln_status st;
} builder;

int add_material(builder *b, texture_kind pattern, uint32_t first, uint32_t second, double size);
int add_glossy(builder *b, uint32_t colour, double gloss, double exponent);
void add_sphere(builder *b, int material, vec centre, double r);
void add_box(builder *b, int material, vec low, vec high);
/* A box of half sides hx, hy, hz turned around z by `turn` radians. */
void add_turned_box(builder *b, int material, vec centre, double hx, double hy, double hz,
                    double turn);
/* A roof with its ridge along the turned x axis: half of a square bar, whose lower edges are at the
 * height of `eaves`, hx and hy away from it. */
void add_gable(builder *b, int material, vec eaves, double hx, double hy, double turn);
/* From p (radius rp) to q (radius rq), flat ends. */
void add_frustum(builder *b, int material, vec p, vec q, double rp, double rq);
void add_cylinder(builder *b, int material, vec p, vec q, double r);
/* The same with round ends. */
void add_rod(builder *b, int material, vec p, vec q, double r);
void add_torus(builder *b, int material, vec centre, vec axis, double ring, double tube);
/* A thin hanging wire from p to q. */
void add_wire(builder *b, int material, vec p, vec q, double sag, double r);

/* A toy steam engine on a round checkered base, with signal, poles, wires and trees. */
cln_status scene_object(world *w);

/* A furnished room seen from inside, lit by a lamp under its ceiling. */
cln_status scene_room(world *w);

/* A still life before a wall with a window, seen from the front. */
cln_status scene_forward(world *w);

/* Fields and a village seen from the air. */
cln_status scene_terrain(world *w);

/* A fountain that the cameras walk around; a square, a town, hills and the sky behind it. */
cln_status scene_street(world *w);

#endif
