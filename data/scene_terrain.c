/* Fields, roads, hills and a village, seen from the air (scenes.h): wide and flat, with the ground
 * at z = -0.2 and roofs, trees and a tower up to 0.5 above it. Cameras fly at z = 4.5, three times
 * the half width away, so that a pixel sees little of the sides of things. */
#include "scenes.h"

static const double floor_z = -0.2, edge = 1.5;

static void land(builder *b)
{
    static const uint32_t colours[6][2] = {{0x7d9a4a, 0x62803a}, {0xc9b56a, 0xae9a50},
                                           {0x8fae5e, 0x6f9448}, {0x9a7d52, 0x83683f},
                                           {0x5f8a3f, 0x7aa356}, {0xb7a46c, 0x96a055}};
    int road = add_material(b, PATTERN_SPECKLE, 0x8a8a86, 0x76767a, 0.05);
    int hill = add_material(b, PATTERN_SPECKLE, 0x587a3c, 0x7d9a52, 0.1);
    int water = add_material(b, PATTERN_SPECKLE, 0x3f6f8f, 0x4f82a0, 0.08);
    int fields[6];

    for (int i = 0; i < 6; i++)
        fields[i] = add_material(b, i % 2 ? PATTERN_SPECKLE : PATTERN_STRIPES, colours[i][0],
                                 colours[i][1], 0.04 + 0.01 * i);
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 4; i++)
            add_box(b, fields[(3 * k + 2 * i + k / 2) % 6],
                    vec3(-edge + 0.75 * i, -edge + 0.75 * k, floor_z - 0.1),
                    vec3(-edge + 0.75 * (i + 1), -edge + 0.75 * (k + 1), floor_z));
    add_box(b, road, vec3(-edge, -0.06, floor_z), vec3(edge, 0.06, floor_z + 0.004));
    add_box(b, road, vec3(0.32, -edge, floor_z), vec3(0.42, edge, floor_z + 0.003));
    add_box(b, water, vec3(-1.4, -1.4, floor_z), vec3(-0.95, -0.8, floor_z + 0.002));
    add_sphere(b, hill, vec3(-0.95, 0.95, floor_z - 0.75), 0.98);
    add_sphere(b, hill, vec3(1.1, -1.05, floor_z - 0.55), 0.7);
}

static void house(builder *b, double x, double y, double turn, double size, int wall, int roof)
{
    const double hx = 0.13 * size, hy = 0.08 * size, high = 0.11 * size;

    add_turned_box(b, wall, vec3(x, y, floor_z + 0.5 * high), hx, hy, 0.5 * high, turn);
    add_gable(b, roof, vec3(x, y, floor_z + high), 1.08 * hx, 1.1 * hy, turn);
}

static void village(builder *b)
{
    int white = add_material(b, PATTERN_PLAIN, 0xe9e3d6, 0xe9e3d6, 1);
    int brick = add_material(b, PATTERN_BRICK, 0xa8573f, 0xd2c4b0, 0.03);
    int tiles = add_material(b, PATTERN_STRIPES, 0xb0492f, 0x93381f, 0.018);
    int slate = add_material(b, PATTERN_STRIPES, 0x5a5f66, 0x474b52, 0.015);
    int hall = add_material(b, PATTERN_CHECKER, 0xc9ccd0, 0xa9adb3, 0.08);

    for (int i = 0; i < 9; i++) /* along the road, on both sides */
        house(b, -1.25 + 0.29 * i, i % 2 ? 0.24 : -0.26, 0.12 * ((i * 5) % 7 - 3),
              1 + 0.1 * (i % 3), i % 3 ? white : brick, i % 4 ? tiles : slate);
    for (int i = 0; i < 5; i++)
        house(b, i % 2 ? 0.58 : 0.17, 0.45 + 0.22 * i, 1.57 + 0.1 * (i % 3), 0.9, brick,
              i % 2 ? tiles : slate);
    add_box(b, hall, vec3(-0.6, -1.0, floor_z), vec3(-0.1, -0.65, floor_z + 0.16));
    add_box(b, slate, vec3(-0.5, -0.9, floor_z + 0.16), vec3(-0.4, -0.75, floor_z + 0.2));
    add_box(b, white, vec3(0.6, -0.34, floor_z), vec3(0.72, -0.22, floor_z + 0.36));
    add_frustum(b, slate, vec3(0.66, -0.28, floor_z + 0.36), vec3(0.66, -0.28, floor_z + 0.5), 0.09,
                0.0);
}

static void trees(builder *b)
{
    int leaves = add_material(b, PATTERN_SPECKLE, 0x2f5c2a, 0x5f8f42, 0.04);
    int trunk = add_material(b, PATTERN_PLAIN, 0x4f3a26, 0x4f3a26, 1);

    for (int i = 0; i < 26; i++) { /* a wood, and a row along the second road */
        const bool row = i >= 16;
        const double x = row ? 0.5 : 0.78 + 0.19 * (i % 4) + 0.05 * ((i * 7) % 3);
        const double y = row ? -1.4 + 0.11 * (i - 16) : 0.65 + 0.2 * (i / 4) + 0.04 * ((i * 5) % 3);
        const double r = 0.05 + 0.012 * ((3 * i) % 4);

        add_cylinder(b, trunk, vec3(x, y, floor_z), vec3(x, y, floor_z + 0.07), 0.012);
        add_sphere(b, leaves, vec3(x, y, floor_z + 0.06 + r), r);
    }
}

cln_status scene_terrain(world *w)
{
    builder b = {.world = w, .shift = vec3(0, 0, 0)};

    w->light = unit(vec3(0.5, -0.45, 0.75));
    w->light_size = 0.02;
    w->light_colour = vec3(0.85, 0.82, 0.74);
    w->sky = vec3(0.45, 0.48, 0.55);
    w->ground = vec3(0.28, 0.27, 0.24);
    w->sky_reach = 0.15;
    land(&b);
    village(&b);
    trees(&b);
    return b.st == CLN_OK ? shapes_finish(&w->shapes) : b.st;
}
