/* A still life on a table before a wall with a window, seen only from the front (scenes.h): things
 * from near to far, thin ones before a textured wall, and a view out of the window farther back.
 * Cameras stand around (0, -3.3, 0) and look along +y. */
#include "scenes.h"

static void behind(builder *b)
{
    int paper = add_material(b, PATTERN_SPECKLE, 0xd8c9a4, 0xa3875a, 0.09);
    int stripes = add_material(b, PATTERN_STRIPES, 0x8fb0a8, 0xb7cfc6, 0.11);
    int frame = add_material(b, PATTERN_PLAIN, 0xf3efe6, 0xf3efe6, 1);
    int hills = add_material(b, PATTERN_SPECKLE, 0x4f7d3a, 0x8fae5e, 0.16);
    int sky = add_material(b, PATTERN_SPECKLE, 0x9fc4e8, 0xc3dcf2, 0.4);
    const double w = 1.5, back = 1.0;

    /* the wall around the window, then what is seen through it */
    add_box(b, paper, vec3(-w, back, -w), vec3(0.1, back + 0.05, w));
    add_box(b, paper, vec3(1.0, back, -w), vec3(w, back + 0.05, w));
    add_box(b, stripes, vec3(0.1, back, -w), vec3(1.0, back + 0.05, 0.1));
    add_box(b, stripes, vec3(0.1, back, 1.0), vec3(1.0, back + 0.05, w));
    for (int i = 0; i < 3; i++) {
        const double at = 0.1 + 0.45 * i;

        add_box(b, frame, vec3(at - 0.02, back - 0.03, 0.1), vec3(at + 0.02, back, 1.0));
        add_box(b, frame, vec3(0.1, back - 0.03, at - 0.02), vec3(1.0, back, at + 0.02));
    }
    add_box(b, sky, vec3(-w, 1.49, -w), vec3(w, 1.5, w));
    add_sphere(b, hills, vec3(0.3, 1.42, -0.05), 0.34);
    add_sphere(b, hills, vec3(0.85, 1.42, -0.02), 0.3);
}

static void table(builder *b)
{
    int cloth = add_material(b, PATTERN_CHECKER, 0xf1ede2, 0xb8433c, 0.12);
    int wood = add_material(b, PATTERN_WOOD, 0xa8754a, 0x7a4f2c, 0.1);
    int jug = add_material(b, PATTERN_STRIPES, 0x2f5f8f, 0xe8e4d6, 0.06);
    int apple = add_glossy(b, 0xc23b2e, 0.6, 30);
    int lemon = add_material(b, PATTERN_SPECKLE, 0xe8c93a, 0xd0a828, 0.05);
    int book = add_material(b, PATTERN_PLAIN, 0x3b6b4d, 0x3b6b4d, 1);
    int pages = add_material(b, PATTERN_STRIPES, 0xf0ead8, 0xd8ceb4, 0.012);

    add_box(b, cloth, vec3(-1.35, -1.2, -0.62), vec3(1.35, 0.8, -0.56));
    add_box(b, wood, vec3(-1.35, -1.21, -1.5), vec3(1.35, -1.15, -0.62));
    add_frustum(b, jug, vec3(-0.55, -0.1, -0.56), vec3(-0.55, -0.1, -0.1), 0.22, 0.26);
    add_frustum(b, jug, vec3(-0.55, -0.1, -0.1), vec3(-0.55, -0.1, 0.2), 0.26, 0.12);
    add_torus(b, jug, vec3(-0.28, -0.1, -0.08), vec3(0, 1, 0), 0.14, 0.03);
    add_sphere(b, apple, vec3(0.05, -0.55, -0.43), 0.13);
    add_sphere(b, apple, vec3(0.34, -0.42, -0.43), 0.13);
    add_sphere(b, lemon, vec3(0.18, -0.72, -0.47), 0.09);
    add_turned_box(b, book, vec3(0.75, -0.15, -0.53), 0.3, 0.22, 0.03, 0.3);
    add_turned_box(b, pages, vec3(0.75, -0.15, -0.47), 0.28, 0.2, 0.03, 0.3);
    add_turned_box(b, book, vec3(0.72, -0.12, -0.41), 0.26, 0.2, 0.03, -0.2);
}

/* Thin, and nearer than the rest. */
static void twigs(builder *b)
{
    int stem = add_material(b, PATTERN_WOOD, 0x5a6b2e, 0x3d4a20, 0.05);
    int leaf = add_material(b, PATTERN_SPECKLE, 0x3f8f3a, 0x9fcf5a, 0.05);
    int vase = add_glossy(b, 0xd9d4c6, 0.5, 30);

    add_frustum(b, vase, vec3(-0.95, -0.75, -0.56), vec3(-0.95, -0.75, -0.25), 0.1, 0.07);
    for (int i = 0; i < 7; i++) {
        const double turn = 0.9 * i;
        const vec foot = vec3(-0.95, -0.75, -0.27);
        const vec top = vec3(-0.95 + 0.34 * cos(turn), -0.75 + 0.3 * sin(turn), 0.2 + 0.07 * i);

        add_rod(b, stem, foot, top, 0.011);
        for (int k = 1; k <= 4; k++) {
            const vec at = mix(foot, top, 0.25 * k);

            add_sphere(b, leaf, add(at, vec3(0.03, 0, 0.02)), 0.02 + 0.008 * k);
        }
    }
}

cln_status scene_forward(world *w)
{
    builder b = {.world = w, .shift = vec3(0, 0, 0)};

    w->light = unit(vec3(-0.5, -0.8, 0.7));
    w->light_size = 0.1;
    w->light_colour = vec3(0.7, 0.66, 0.58);
    w->sky = vec3(0.5, 0.52, 0.56);
    w->ground = vec3(0.34, 0.32, 0.3);
    w->sky_reach = 0.4;
    behind(&b);
    table(&b);
    twigs(&b);
    return b.st == CLN_OK ? shapes_finish(&w->shapes) : b.st;
}
