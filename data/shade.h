/* Colour of a hit: procedural textures, one light with soft shadows, sky light with ambient
 * occlusion, a Phong highlight. Colours are linear inside, and sRGB-encoded on return. Each
 * sub-sample of a pixel has fixed points on the light and directions to the sky, so a surface has
 * the same colour in every view. */
#ifndef DATA_SHADE_H
#define DATA_SHADE_H

#include <stdint.h>
#include "trace.h"

enum { SUBSAMPLES = 9 }; /* 3 x 3 in a pixel */

typedef enum {
    PATTERN_PLAIN,
    PATTERN_CHECKER, /* cells of side `size` */
    PATTERN_STRIPES, /* along local z, period 2 size */
    PATTERN_RINGS,   /* around local z by radius, period 2 size */
    PATTERN_BRICK,   /* size high, 2 size long, joints in the second colour */
    PATTERN_WOOD,    /* streaks along local x */
    PATTERN_SPECKLE  /* noise between the two colours */
} texture_kind;

typedef struct surface {
    texture_kind pattern;
    vec colour[2];
    double size;
    double gloss, exponent; /* Phong */
    double glow;            /* share of the colour that needs no light */
} surface;

enum { MAX_MATERIALS = 64, NOISE_SIDE = 16 };

typedef struct world {
    shapes shapes;
    surface materials[MAX_MATERIALS];
    int material_count;
    vec light;                     /* towards the light (unit), or its position */
    bool light_near;               /* light is a position inside the scene */
    double light_size;             /* radius of its disc: at distance 1, or of the lamp itself */
    vec light_colour, sky, ground; /* linear */
    double sky_reach;              /* reach of ambient occlusion */
    bool plain;                    /* first colours alone, without pattern or light */
    float noise[NOISE_SIDE * NOISE_SIDE * NOISE_SIDE];
} world;

/* sRGB bytes as in 0xrrggbb -> linear. */
vec colour_of(uint32_t rgb);

/* Fills the noise table from the seed. */
void world_noise(world *w, uint64_t seed);

/* Colour, 0..1 sRGB-encoded, of a hit seen along `direction`; sample in 0..SUBSAMPLES-1. */
vec shade(const world *w, const hit *h, vec origin, vec direction, int sample);

#endif
