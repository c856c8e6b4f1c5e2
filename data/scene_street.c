/* A fountain in a square, with all that a town has behind it (scenes.h): the part that the cameras
 * walk around fits in [-1.5, 1.5]^3; lamps and trees stand 3 away, houses 6 to 14, hills and a
 * tower 35 to 60, and the sky is a sphere of radius SKY. Every ray hits something. */
#include "scenes.h"

static const double SKY = 200;

static void fountain(builder *b)
{
    int stone = add_material(b, PATTERN_SPECKLE, 0xcfc6b4, 0x9c917d, 0.06);
    int brick = add_material(b, PATTERN_BRICK, 0xa9583f, 0xe2d6c6, 0.09);
    int water = add_glossy(b, 0x3f7fa6, 0.7, 60);
    int bronze = add_glossy(b, 0x7d6a35, 0.6, 35);
    int bench = add_material(b, PATTERN_WOOD, 0x8a5f3a, 0x5f3f24, 0.08);
    int stripes = add_material(b, PATTERN_STRIPES, 0xd9432f, 0xf3ead8, 0.08);

    add_cylinder(b, brick, vec3(0, 0, -1), vec3(0, 0, -0.72), 0.9);
    add_torus(b, stone, vec3(0, 0, -0.7), vec3(0, 0, 1), 0.86, 0.07);
    add_cylinder(b, water, vec3(0, 0, -0.73), vec3(0, 0, -0.71), 0.85);
    add_frustum(b, stone, vec3(0, 0, -0.72), vec3(0, 0, 0.1), 0.2, 0.11);
    add_frustum(b, stone, vec3(0, 0, 0.1), vec3(0, 0, 0.22), 0.12, 0.45);
    add_torus(b, bronze, vec3(0, 0, 0.24), vec3(0, 0, 1), 0.42, 0.04);
    add_rod(b, bronze, vec3(0, 0, 0.2), vec3(0, 0, 0.62), 0.06);
    add_sphere(b, bronze, vec3(0, 0, 0.74), 0.14);
    add_rod(b, bronze, vec3(0, 0, 0.55), vec3(0.33, 0.1, 0.78), 0.035);
    add_rod(b, bronze, vec3(0, 0, 0.55), vec3(-0.3, -0.15, 0.7), 0.035);
    for (int i = 0; i < 3; i++) {
        double angle = 0.6 + 2.0944 * i;

        add_turned_box(b, bench, vec3(1.2 * cos(angle), 1.2 * sin(angle), -0.8), 0.1, 0.32, 0.03,
                       angle);
        add_turned_box(b, stone, vec3(1.2 * cos(angle), 1.2 * sin(angle), -0.92), 0.08, 0.26, 0.09,
                       angle);
    }
    add_sphere(b, stripes, vec3(-0.75, 0.85, -0.86), 0.14);
    add_frustum(b, stripes, vec3(0.95, -0.75, -1), vec3(0.95, -0.75, -0.6), 0.12, 0.02);
}

static void square(builder *b)
{
    int paving = add_material(b, PATTERN_CHECKER, 0xa7a29a, 0x827b70, 0.5);
    int meadow = add_material(b, PATTERN_SPECKLE, 0x6f8f45, 0x53753a, 2);
    int iron = add_material(b, PATTERN_PLAIN, 0x2b2f33, 0x2b2f33, 1);
    int glass = add_material(b, PATTERN_PLAIN, 0xfff2cc, 0xfff2cc, 1);
    int trunk = add_material(b, PATTERN_WOOD, 0x6d5036, 0x4f3826, 0.1);
    int leaves = add_material(b, PATTERN_SPECKLE, 0x4f8a3a, 0x2f5f28, 0.16);

    add_box(b, paving, vec3(-16, -16, -1.2), vec3(16, 16, -1));
    add_box(b, meadow, vec3(-150, -150, -1.4), vec3(150, 150, -1.02));
    for (int i = 0; i < 8; i++) {
        const double angle = 0.4 + 0.7854 * i, far = 4.6 + 0.5 * (i % 3);
        const vec foot = vec3(far * cos(angle), far * sin(angle), -1);

        if (i % 2) {
            add_rod(b, iron, foot, add(foot, vec3(0, 0, 1.9)), 0.05);
            add_sphere(b, glass, add(foot, vec3(0, 0, 2.05)), 0.17);
        } else {
            add_frustum(b, trunk, foot, add(foot, vec3(0, 0, 1.2)), 0.16, 0.1);
            add_sphere(b, leaves, add(foot, vec3(0, 0, 1.7)), 0.7);
            add_sphere(b, leaves, add(foot, vec3(0.4, 0.2, 2.1)), 0.5);
        }
    }
}

static void town(builder *b)
{
    static const uint32_t walls[4] = {0xd9a45b, 0xc8705a, 0xe3d8bd, 0x8fa9b8};
    int wall[4], roof = add_material(b, PATTERN_STRIPES, 0x8f3b2c, 0x6e2c22, 0.25);
    int window = add_glossy(b, 0x32485a, 0.5, 30);

    for (int i = 0; i < 4; i++)
        wall[i] = add_material(b, i % 2 ? PATTERN_BRICK : PATTERN_SPECKLE, walls[i], 0xf0e6d2, 0.3);
    for (int i = 0; i < 11; i++) {
        const double angle = 0.2 + 0.5712 * i, far = 9 + 1.7 * (i * 7 % 4);
        const double high = 1.6 + 0.5 * (i * 5 % 4), wide = 1.7 + 0.2 * (i % 3);
        const vec at = vec3(far * cos(angle), far * sin(angle), -1 + high);

        add_turned_box(b, wall[i % 4], at, 1.4, wide, high, angle);
        add_gable(b, roof, vec3(at.x, at.y, at.z + high), 1.5, wide, angle);
        for (int k = 0; k < 4; k++) {
            const double side = 0.45 * wide * (k % 2 ? 1 : -1), up = high * (k / 2 ? 0.4 : -0.3);
            const vec out = vec3(-cos(angle), -sin(angle), 0), across = vec3(out.y, -out.x, 0);

            add_turned_box(b, window,
                           along(along(vec3(at.x, at.y, at.z + up), 1.4, out), side, across), 0.05,
                           0.25, 0.35, angle);
        }
    }
}

static void far_away(builder *b)
{
    int wood = add_material(b, PATTERN_SPECKLE, 0x5d7a4a, 0x3f5a3c, 4);
    int rock = add_material(b, PATTERN_SPECKLE, 0x8c8f98, 0x6d6f7a, 5);
    int tower = add_material(b, PATTERN_STRIPES, 0xf2efe8, 0xc0392b, 1.5);
    int sky = add_material(b, PATTERN_SPECKLE, 0xdfe9f5, 0x8fb6e0, 60);

    b->world->materials[sky].glow = 1;
    for (int i = 0; i < 7; i++) {
        const double angle = 0.9 * i, far = 38 + 9 * (i * 3 % 4);

        add_sphere(b, i % 2 ? rock : wood, vec3(far * cos(angle), far * sin(angle), -9),
                   14 + i % 3);
    }
    add_cylinder(b, tower, vec3(24, -26, -1), vec3(24, -26, 14), 1.2);
    add_sphere(b, sky, vec3(0, 0, 0), SKY);
}

cln_status scene_street(world *w)
{
    builder b = {.world = w, .shift = vec3(0, 0, 0)};

    w->light = vec3(54, -60, 89); /* in the sky's sphere, which would hide what is beyond it */
    w->light_near = true;
    w->light_size = 5;
    w->light_colour = vec3(0.75, 0.7, 0.6);
    w->sky = vec3(0.42, 0.46, 0.52);
    w->ground = vec3(0.3, 0.28, 0.25);
    w->sky_reach = 1;
    fountain(&b);
    square(&b);
    town(&b);
    far_away(&b);
    return b.st == CLN_OK ? shapes_finish(&w->shapes) : b.st;
}
