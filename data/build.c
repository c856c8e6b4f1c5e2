/* Shapes and materials by appearance: two end points and a radius instead of frames (scenes.h). */
#include "scenes.h"

int add_material(builder *b, texture_kind pattern, uint32_t first, uint32_t second, double size)
{
    world *w = b->world;

    CLN_ASSERT(w->material_count < MAX_MATERIALS);
    surface *m = &w->materials[w->material_count];
    *m = (surface){.pattern = pattern, .size = size, .exponent = 1};
    m->colour[0] = colour_of(first);
    m->colour[1] = colour_of(second);
    return w->material_count++;
}

int add_glossy(builder *b, uint32_t colour, double gloss, double exponent)
{
    int m = add_material(b, PATTERN_PLAIN, colour, colour, 1);
    b->world->materials[m].gloss = gloss;
    b->world->materials[m].exponent = exponent;
    return m;
}

static void add_shape(builder *b, shape s)
{
    s.centre = add(s.centre, b->shift);
    if (b->st == CLN_OK)
        b->st = shapes_add(&b->world->shapes, &s);
}

static shape upright(shape_kind kind, int material, vec centre)
{
    shape s = {.kind = kind, .material = material, .centre = centre};
    s.u = vec3(1, 0, 0);
    s.v = vec3(0, 1, 0);
    s.w = vec3(0, 0, 1);
    return s;
}

static shape between(shape_kind kind, int material, vec p, vec q)
{
    shape s = upright(kind, material, mix(p, q, 0.5));
    s.w = unit(sub(q, p));
    frame_of(s.w, &s.u, &s.v);
    s.c = 0.5 * sqrt(dot(sub(q, p), sub(q, p)));
    return s;
}

void add_sphere(builder *b, int material, vec centre, double r)
{
    shape s = upright(SHAPE_SPHERE, material, centre);
    s.a = r;
    add_shape(b, s);
}

void add_box(builder *b, int material, vec low, vec high)
{
    vec half = scale(sub(high, low), 0.5);
    add_turned_box(b, material, mix(low, high, 0.5), half.x, half.y, half.z, 0);
}

void add_turned_box(builder *b, int material, vec centre, double hx, double hy, double hz,
                    double turn)
{
    shape s = upright(SHAPE_BOX, material, centre);
    s.u = vec3(cos(turn), sin(turn), 0);
    s.v = vec3(-sin(turn), cos(turn), 0);
    s.a = hx;
    s.b = hy;
    s.c = hz;
    add_shape(b, s);
}

void add_gable(builder *b, int material, vec eaves, double hx, double hy, double turn)
{
    const double lean = sqrt(0.5);
    shape s = upright(SHAPE_BOX, material, eaves); /* turned by 45 degrees: a corner is the ridge */
    const vec side = vec3(-sin(turn), cos(turn), 0), up = vec3(0, 0, 1);

    s.u = vec3(cos(turn), sin(turn), 0);
    s.v = scale(add(side, up), lean);
    s.w = scale(sub(up, side), lean);
    s.a = hx;
    s.b = s.c = hy * lean;
    add_shape(b, s);
}

void add_frustum(builder *b, int material, vec p, vec q, double rp, double rq)
{
    shape s = between(SHAPE_FRUSTUM, material, p, q);
    s.a = rp;
    s.b = rq;
    add_shape(b, s);
}

void add_cylinder(builder *b, int material, vec p, vec q, double r)
{
    add_frustum(b, material, p, q, r, r);
}

void add_rod(builder *b, int material, vec p, vec q, double r)
{
    shape s = between(SHAPE_CAPSULE, material, p, q);
    s.a = r;
    add_shape(b, s);
}

void add_torus(builder *b, int material, vec centre, vec axis, double ring, double tube)
{
    shape s = upright(SHAPE_TORUS, material, centre);
    s.w = unit(axis);
    frame_of(s.w, &s.u, &s.v);
    s.a = ring;
    s.b = tube;
    add_shape(b, s);
}

void add_wire(builder *b, int material, vec p, vec q, double sag, double r)
{
    enum { PIECES = 10 };
    vec from = p;

    for (int i = 1; i <= PIECES; i++) {
        double f = (double)i / PIECES;
        vec to = mix(p, q, f);
        to.z -= 4 * sag * f * (1 - f);
        add_rod(b, material, from, to, r);
        from = to;
    }
}
