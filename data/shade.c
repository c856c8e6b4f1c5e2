/* Textures and light of the generated scenes; see shade.h. */
#include "shade.h"
#include "base/rng.h"

static double to_linear(double c)
{
    return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
}

static double to_srgb(double c)
{
    c = fmin(fmax(c, 0), 1);
    return c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1 / 2.4) - 0.055;
}

vec colour_of(uint32_t rgb)
{
    return vec3(to_linear((double)(rgb >> 16 & 255) / 255),
                to_linear((double)(rgb >> 8 & 255) / 255), to_linear((double)(rgb & 255) / 255));
}

void world_noise(world *w, uint64_t seed)
{
    for (uint32_t i = 0; i < NOISE_SIDE * NOISE_SIDE * NOISE_SIDE; i += 4)
        cln_uniform4(seed, CLN_STREAM_SCENE, 0, i, 0, w->noise + i);
}

/* Smooth value noise in 0..1, one lattice point per unit, repeating every NOISE_SIDE. */
static double noise(const world *w, vec p)
{
    const double at[3] = {p.x, p.y, p.z};
    int cell[3];
    double f[3], sum = 0;

    for (int a = 0; a < 3; a++) {
        cell[a] = (int)floor(at[a]);
        f[a] = at[a] - cell[a];
        f[a] = f[a] * f[a] * (3 - 2 * f[a]);
    }
    for (int i = 0; i < 8; i++) {
        unsigned index = 0;
        double weight = 1;
        for (int a = 2; a >= 0; a--) {
            int upper = i >> a & 1;
            index = index * NOISE_SIDE + ((unsigned)(cell[a] + upper) & (NOISE_SIDE - 1));
            weight *= upper ? f[a] : 1 - f[a];
        }
        sum += weight * w->noise[index];
    }
    return sum;
}

static double modulo(double a, double b)
{
    return a - b * floor(a / b);
}

/* Position on the surface as two lengths: along the axes of a box's face, by angle and height on
 * round shapes. */
static void unroll(const hit *h, double *a, double *b)
{
    vec p = h->local, n = h->local_normal;
    double nx = fabs(n.x), ny = fabs(n.y), nz = fabs(n.z);

    if (h->shape->kind == SHAPE_BOX || nz > 0.9) {
        *a = nx > ny && nx > nz ? p.y : p.x;
        *b = nz >= nx && nz >= ny ? p.y : p.z;
    } else {
        *a = atan2(p.y, p.x) * fmax(h->shape->a, h->shape->b);
        *b = p.z;
    }
}

/* 0 = first colour, 1 = second colour. */
static double pattern_at(const world *w, const surface *m, const hit *h)
{
    vec p = h->local;
    double a, b, s = m->size;

    switch (m->pattern) {
    case PATTERN_PLAIN:
        return 0;
    case PATTERN_CHECKER:
        unroll(h, &a, &b);
        return modulo(floor(a / s) + floor(b / s), 2);
    case PATTERN_STRIPES:
        return modulo(floor(p.z / s), 2);
    case PATTERN_RINGS:
        return modulo(floor(sqrt(p.x * p.x + p.y * p.y) / s), 2);
    case PATTERN_BRICK:
        unroll(h, &a, &b);
        a += modulo(floor(b / s), 2) * s;
        return modulo(b, s) < 0.14 * s || modulo(a, 2 * s) < 0.14 * s;
    case PATTERN_WOOD:
        return fabs(2 * modulo(p.y / s + 0.7 * noise(w, vec3(2 * p.x, 14 * p.y + 5, 14 * p.z)), 1) -
                    1);
    case PATTERN_SPECKLE:
        return 0.65 * noise(w, scale(p, 1 / s)) + 0.35 * noise(w, scale(p, 2.7 / s));
    }
    return 0;
}

/* Sub-sample number -> point of the unit disc: one in the middle, eight around it. */
static void disc_point(int sample, double *x, double *y)
{
    double angle = 2 * 3.14159265358979323846 * sample / (SUBSAMPLES - 1);
    double r = sample == SUBSAMPLES - 1 ? 0 : sample % 2 ? 0.92 : 0.6;
    *x = r * cos(angle);
    *y = r * sin(angle);
}

vec shade(const world *w, const hit *h, vec origin, vec direction, int sample)
{
    const double lift = 1e-6;
    const surface *m = &w->materials[h->shape->material];
    vec base = mix(m->colour[0], m->colour[1], pattern_at(w, m, h));
    vec p = along(along(origin, h->t, direction), lift, h->normal);
    vec u, v, light, sky;
    double x, y, reach = INFINITY;

    if (w->plain)
        return vec3(to_srgb(m->colour[0].x), to_srgb(m->colour[0].y), to_srgb(m->colour[0].z));
    disc_point(sample, &x, &y);
    light = w->light_near ? sub(w->light, p) : w->light;
    if (w->light_near) {
        /* The lamp's own shape is around the light's position: stop short of it. */
        reach = sqrt(dot(light, light)) - 1.3 * w->light_size;
        frame_of(unit(light), &u, &v);
    } else {
        frame_of(light, &u, &v);
    }
    light = unit(along(along(light, w->light_size * x, u), w->light_size * y, v));
    double lit = dot(h->normal, light);
    if (lit > 0 && m->glow < 1 && shapes_blocked(&w->shapes, p, light, 0, reach))
        lit = 0;
    lit = fmax(lit, 0);

    frame_of(h->normal, &u, &v);
    sky = add(add(scale(u, 0.95 * x), scale(v, 0.95 * y)),
              scale(h->normal, sqrt(1 - 0.9025 * (x * x + y * y))));
    bool open = m->glow >= 1 || !shapes_blocked(&w->shapes, p, sky, 0, w->sky_reach);
    vec ambient = mix(w->ground, w->sky, 0.5 + 0.5 * h->normal.z);

    vec c = mul(base, add(scale(w->light_colour, lit), scale(ambient, open ? 1 : 0.4)));
    if (m->gloss > 0 && lit > 0) {
        vec mirror = sub(scale(h->normal, 2 * dot(h->normal, light)), light);
        double highlight = pow(fmax(-dot(mirror, direction), 0), m->exponent);
        c = along(c, m->gloss * highlight, w->light_colour);
    }
    c = mix(c, base, m->glow);
    return vec3(to_srgb(c.x), to_srgb(c.y), to_srgb(c.z));
}
