/* A furnished room inside the cube, seen from within (scenes.h): rays start in the middle of the
 * octree, and every ray hits a surface. The middle is free for the cameras (|x|, |y| < 0.6); the
 * furniture is along the walls. */
#include "scenes.h"

static void walls(builder *b)
{
    int floor = add_material(b, PATTERN_CHECKER, 0xd9b98a, 0x8a5f3a, 0.2);
    int ceiling = add_material(b, PATTERN_PLAIN, 0xf2efe8, 0xf2efe8, 1);
    int brick = add_material(b, PATTERN_BRICK, 0xb65c42, 0xe2d6c6, 0.1);
    int blue = add_material(b, PATTERN_CHECKER, 0x7fa3c7, 0x9dbbd8, 0.14);
    int plaster = add_material(b, PATTERN_SPECKLE, 0xe6d9b8, 0xcbb98d, 0.12);
    int skirting = add_material(b, PATTERN_PLAIN, 0x6b4a2e, 0x6b4a2e, 1);
    const double in = 1.35, out = 1.42;

    add_box(b, floor, vec3(-out, -out, -1.1), vec3(out, out, -1));
    add_box(b, ceiling, vec3(-out, -out, 1), vec3(out, out, 1.1));
    add_box(b, brick, vec3(-out, -out, -1), vec3(-in, out, 1));
    add_box(b, blue, vec3(in, -out, -1), vec3(out, out, 1));
    add_box(b, plaster, vec3(-in, -out, -1), vec3(in, -in, 1));
    add_box(b, plaster, vec3(-in, in, -1), vec3(in, out, 1));
    add_box(b, skirting, vec3(-in, in - 0.02, -1), vec3(in, in, -0.88));
    add_box(b, skirting, vec3(-in, -in, -1), vec3(in, -in + 0.02, -0.88));
}

static void table(builder *b)
{
    int wood = add_material(b, PATTERN_WOOD, 0xb98550, 0x8a5a30, 0.1);
    int vase = add_glossy(b, 0x2e6fb0, 0.8, 45);
    int stem = add_material(b, PATTERN_PLAIN, 0x3d7a35, 0x3d7a35, 1);
    int flower = add_material(b, PATTERN_PLAIN, 0xe8536b, 0xe8536b, 1);
    int bowl = add_material(b, PATTERN_STRIPES, 0xf4efe2, 0xd9722e, 0.03);

    add_box(b, wood, vec3(0.72, -0.55, -0.43), vec3(1.3, 0.45, -0.39));
    for (int i = 0; i < 4; i++) {
        double x = i & 1 ? 1.25 : 0.77, y = i & 2 ? 0.4 : -0.5;
        add_cylinder(b, wood, vec3(x, y, -1), vec3(x, y, -0.43), 0.03);
    }
    add_frustum(b, vase, vec3(1.0, 0.2, -0.39), vec3(1.0, 0.2, -0.22), 0.06, 0.12);
    add_frustum(b, vase, vec3(1.0, 0.2, -0.22), vec3(1.0, 0.2, -0.05), 0.12, 0.05);
    add_torus(b, vase, vec3(1.0, 0.2, -0.05), vec3(0, 0, 1), 0.055, 0.015);
    for (int i = 0; i < 5; i++) {
        double angle = 1.2566 * i;
        vec top = vec3(1.0 + 0.14 * cos(angle), 0.2 + 0.14 * sin(angle), 0.22 + 0.05 * (i % 3));
        add_rod(b, stem, vec3(1.0, 0.2, -0.05), top, 0.008);
        add_sphere(b, flower, top, 0.045);
    }
    add_torus(b, bowl, vec3(1.0, -0.25, -0.35), vec3(0, 0, 1), 0.1, 0.04);
    add_sphere(b, flower, vec3(1.0, -0.25, -0.33), 0.06);
}

static void shelf(builder *b)
{
    static const unsigned colours[6] = {0xc0392b, 0x2f6f9f, 0xe0b040, 0x3b7d4f, 0x7d4f8f, 0xe8e2d0};
    int wood = add_material(b, PATTERN_WOOD, 0x7a5230, 0x5a3a20, 0.08);
    int books[6];

    for (int i = 0; i < 6; i++)
        books[i] = add_material(b, PATTERN_PLAIN, colours[i], colours[i], 1);
    for (int side = 0; side < 2; side++) {
        double x = side ? 0.6 : -0.6;
        add_box(b, wood, vec3(x - 0.02, 1.05, -1), vec3(x + 0.02, 1.34, 0.4));
    }
    for (int level = 0; level < 4; level++) {
        double z = -0.9 + 0.42 * level, x = -0.56;
        add_box(b, wood, vec3(-0.6, 1.05, z - 0.02), vec3(0.6, 1.34, z));
        for (int i = 0; level < 3 && i < 11; i++) {
            int k = (7 * i + 5 * level) % 6;
            double wide = 0.05 + 0.012 * ((3 * i + level) % 4),
                   high = 0.24 + 0.03 * ((5 * i + level) % 4);
            add_box(b, books[k], vec3(x, 1.1, z), vec3(x + wide, 1.32, z + high));
            x += wide + 0.012 + (i == 5 ? 0.09 : 0);
        }
    }
}

static void pictures_and_lamps(builder *b)
{
    int frame = add_glossy(b, 0xd9a441, 0.4, 25);
    int rings = add_material(b, PATTERN_CHECKER, 0xf0e6d2, 0x20506b, 0.09);
    int target = add_material(b, PATTERN_RINGS, 0xd43a2f, 0xf6f1e4, 0.05);
    int bulb = add_material(b, PATTERN_PLAIN, 0xfff2cc, 0xfff2cc, 1);
    int cable = add_material(b, PATTERN_PLAIN, 0x26262a, 0x26262a, 1);
    int shade = add_material(b, PATTERN_STRIPES, 0xe7dcc0, 0xa8443a, 0.06);

    b->world->materials[bulb].glow = 1;
    add_box(b, frame, vec3(-0.9, -1.35, 0.0), vec3(-0.2, -1.33, 0.6));
    add_box(b, rings, vec3(-0.85, -1.335, 0.05), vec3(-0.25, -1.325, 0.55));
    add_cylinder(b, target, vec3(0.45, -1.35, 0.3), vec3(0.45, -1.32, 0.3), 0.28);
    add_torus(b, frame, vec3(0.45, -1.33, 0.3), vec3(0, 1, 0), 0.28, 0.025);

    add_rod(b, cable, vec3(0, 0, 1), vec3(0, 0, 0.88), 0.01);
    add_sphere(b, bulb, vec3(0, 0, 0.82), 0.08);

    vec foot = vec3(-1.05, -0.9, -1);
    add_cylinder(b, cable, foot, add(foot, vec3(0, 0, 0.03)), 0.16);
    add_rod(b, frame, foot, add(foot, vec3(0, 0, 1.15)), 0.014);
    add_frustum(b, shade, add(foot, vec3(0, 0, 1.1)), add(foot, vec3(0, 0, 1.4)), 0.22, 0.12);
}

static void chair_and_toys(builder *b)
{
    int seat = add_material(b, PATTERN_CHECKER, 0x2f7f7a, 0xe9e2cf, 0.07);
    int leg = add_glossy(b, 0xa9adb3, 0.4, 30);
    int ball = add_material(b, PATTERN_STRIPES, 0xe2542f, 0xf3ead8, 0.07);
    int tin = add_glossy(b, 0x6aa84f, 0.5, 30);

    add_box(b, seat, vec3(-1.25, 0.15, -0.6), vec3(-0.8, 0.6, -0.55));
    add_box(b, seat, vec3(-1.25, 0.15, -0.55), vec3(-1.21, 0.6, 0.05));
    for (int i = 0; i < 4; i++) {
        double x = i & 1 ? -0.84 : -1.21, y = i & 2 ? 0.56 : 0.19;
        add_rod(b, leg, vec3(x, y, -0.99), vec3(x, y, -0.6), 0.015);
    }
    add_sphere(b, ball, vec3(-0.85, -0.3, -0.82), 0.18);
    add_torus(b, tin, vec3(0.3, -0.95, -0.93), vec3(0, 0, 1), 0.2, 0.07);
    add_turned_box(b, seat, vec3(0.85, -1.05, -0.82), 0.18, 0.18, 0.18, 0.6);
    add_frustum(b, tin, vec3(-0.3, -1.1, -1), vec3(-0.3, -1.1, -0.55), 0.16, 0.0);
}

cln_status scene_room(world *w)
{
    builder b = {.world = w, .shift = vec3(0, 0, 0)};

    w->light = vec3(0, 0, 0.82);
    w->light_near = true;
    w->light_size = 0.08;
    w->light_colour = vec3(0.62, 0.58, 0.5);
    w->sky = vec3(0.42, 0.42, 0.42);
    w->ground = vec3(0.36, 0.33, 0.3);
    w->sky_reach = 0.35;
    walls(&b);
    table(&b);
    shelf(&b);
    pictures_and_lamps(&b);
    chair_and_toys(&b);
    return b.st == CLN_OK ? shapes_finish(&w->shapes) : b.st;
}
