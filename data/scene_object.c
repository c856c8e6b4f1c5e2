/* The demo object: a toy steam engine on a round checkered base (scenes.h). It is hard to
 * reconstruct from every side: textures of several scales, spokes, rails and wires of one or two
 * pixels, a thin signal arm, see-through holes, a glossy boiler. The rails run along x, the engine
 * faces +x. In this file the ground is at z = 0; `shift` moves everything down. */
#include "scenes.h"

static const double pi = 3.14159265358979323846;

static void ground(builder *b)
{
    int checker = add_material(b, PATTERN_CHECKER, 0xb9d58a, 0x86b25c, 0.16);
    int rim = add_material(b, PATTERN_WOOD, 0xa8703c, 0x7a4a22, 0.11);
    int gravel = add_material(b, PATTERN_SPECKLE, 0x6f675d, 0xcfc4b2, 0.035);
    int sleeper = add_material(b, PATTERN_WOOD, 0x6e4526, 0x4a2c17, 0.05);
    int steel = add_glossy(b, 0x8d949c, 0.25, 30);

    add_cylinder(b, checker, vec3(0, 0, -0.03), vec3(0, 0, 0), 1.25);
    add_frustum(b, rim, vec3(0, 0, -0.14), vec3(0, 0, -0.03), 1.2, 1.3);
    add_box(b, gravel, vec3(-1.16, -0.36, 0), vec3(1.16, 0.36, 0.03));
    for (int i = 0; i < 12; i++) {
        double x = -1.1 + 0.2 * i;
        add_box(b, sleeper, vec3(x - 0.045, -0.32, 0.03), vec3(x + 0.045, 0.32, 0.055));
    }
    for (int side = -1; side <= 1; side += 2)
        add_box(b, steel, vec3(-1.16, 0.2 * side - 0.02, 0.055),
                vec3(1.16, 0.2 * side + 0.02, 0.1));
}

static void wheel(builder *b, int colour, int tyre, vec centre, double r, int spokes, double phase)
{
    vec axis = vec3(0, 1, 0);

    add_torus(b, tyre, centre, axis, r - 0.022, 0.022);
    add_cylinder(b, colour, along(centre, -0.03, axis), along(centre, 0.03, axis), 0.22 * r);
    for (int i = 0; i < spokes; i++) {
        double angle = phase + 2 * pi * i / spokes;
        vec out = vec3(cos(angle), 0, sin(angle));
        add_rod(b, colour, along(centre, 0.1 * r, out), along(centre, r - 0.03, out), 0.013);
    }
}

static void running_gear(builder *b)
{
    int red = add_glossy(b, 0xc22f26, 0.1, 20);
    int tyre = add_glossy(b, 0x3b3d42, 0.2, 25);
    int rod = add_glossy(b, 0xb9bdc4, 0.3, 30);
    int dark = add_material(b, PATTERN_PLAIN, 0x2b2d31, 0x2b2d31, 1);
    const double big = 0.21, small = 0.115, top = 0.1, crank = 0.1;

    add_box(b, dark, vec3(-0.82, -0.14, 0.3), vec3(0.84, 0.14, 0.4));
    for (int side = -1; side <= 1; side += 2) {
        double y = 0.2 * side, outer = 0.27 * side, phase = side < 0 ? 0.5 : 0.5 + 0.5 * pi;
        vec pin = vec3(crank * cos(phase), outer, crank * sin(phase));
        wheel(b, red, tyre, vec3(-0.52, y, top + big), big, 10, phase);
        wheel(b, red, tyre, vec3(-0.04, y, top + big), big, 10, phase);
        wheel(b, red, tyre, vec3(0.4, y, top + small), small, 6, 0.3);
        wheel(b, red, tyre, vec3(0.68, y, top + small), small, 6, 0.7);
        vec rear = add(pin, vec3(-0.52, 0, top + big)), front = add(pin, vec3(-0.04, 0, top + big));
        add_rod(b, rod, rear, front, 0.022);
        add_rod(b, rod, front, vec3(0.42, outer, 0.33), 0.016);
        add_rod(b, rod, vec3(rear.x, y, rear.z), rear, 0.02);
        add_rod(b, rod, vec3(front.x, y, front.z), front, 0.02);
        add_cylinder(b, red, vec3(0.42, outer, 0.33), vec3(0.68, outer, 0.33), 0.068);
        add_box(b, dark, vec3(0.44, 0.2 * side - 0.06, 0.3), vec3(0.66, 0.2 * side + 0.06, 0.36));
        add_box(b, red, vec3(-0.8, 0.235 * side - 0.075, 0.405),
                vec3(0.82, 0.235 * side + 0.075, 0.43));
    }
}

static void boiler(builder *b)
{
    int green = add_glossy(b, 0x17694a, 1.1, 32);
    int brass = add_glossy(b, 0xe0aa3e, 0.6, 24);
    int black = add_glossy(b, 0x26282c, 0.15, 12);
    int lamp = add_material(b, PATTERN_PLAIN, 0xfff0b0, 0xfff0b0, 1);
    int wire = add_glossy(b, 0xd8dade, 0.3, 30);
    vec ahead = vec3(1, 0, 0);
    const double z = 0.66, r = 0.23;

    b->world->materials[lamp].glow = 0.9;
    add_cylinder(b, green, vec3(-0.3, 0, z), vec3(0.56, 0, z), r);
    for (int i = 0; i < 4; i++)
        add_torus(b, brass, vec3(-0.2 + 0.24 * i, 0, z), ahead, r, 0.013);
    add_cylinder(b, black, vec3(0.54, 0, z), vec3(0.8, 0, z), r + 0.012);
    add_frustum(b, black, vec3(0.8, 0, z), vec3(0.84, 0, z), 0.19, 0.13);
    add_torus(b, brass, vec3(0.8, 0, z), ahead, 0.2, 0.012);
    add_sphere(b, brass, vec3(0.85, 0, z), 0.028);
    add_box(b, black, vec3(0.5, -0.12, 0.4), vec3(0.78, 0.12, 0.55));

    add_frustum(b, black, vec3(0.67, 0, 0.86), vec3(0.67, 0, 1.1), 0.085, 0.072);
    add_frustum(b, black, vec3(0.67, 0, 1.1), vec3(0.67, 0, 1.19), 0.072, 0.135);
    add_torus(b, brass, vec3(0.67, 0, 1.19), vec3(0, 0, 1), 0.125, 0.02);

    add_cylinder(b, brass, vec3(0.16, 0, 0.86), vec3(0.16, 0, 0.96), 0.1);
    add_sphere(b, brass, vec3(0.16, 0, 0.96), 0.1);
    add_torus(b, brass, vec3(0.16, 0, 0.885), vec3(0, 0, 1), 0.11, 0.018);
    add_rod(b, brass, vec3(-0.14, 0.03, 0.86), vec3(-0.14, 0.03, 1.0), 0.016);
    add_rod(b, brass, vec3(-0.14, -0.04, 0.86), vec3(-0.14, -0.04, 0.95), 0.016);

    add_cylinder(b, brass, vec3(0.72, 0, 0.955), vec3(0.83, 0, 0.955), 0.055);
    add_cylinder(b, lamp, vec3(0.83, 0, 0.955), vec3(0.836, 0, 0.955), 0.045);

    for (int side = -1; side <= 1; side += 2) {
        double y = 0.262 * side;
        add_rod(b, wire, vec3(-0.26, y, 0.74), vec3(0.76, y, 0.74), 0.01);
        for (int i = 0; i < 4; i++) {
            double x = -0.2 + 0.31 * i;
            add_rod(b, wire, vec3(x, 0.2 * side, 0.73), vec3(x, y, 0.74), 0.012);
        }
    }
}

static void cab(builder *b)
{
    int side_paint = add_material(b, PATTERN_PLAIN, 0x17694a, 0x17694a, 1);
    int panel = add_material(b, PATTERN_CHECKER, 0xf2d35c, 0x1f7a56, 0.05);
    int roof = add_material(b, PATTERN_STRIPES, 0xb63a2e, 0xb63a2e, 1);
    int inside = add_material(b, PATTERN_PLAIN, 0x8a5a34, 0x8a5a34, 1);
    int coal = add_material(b, PATTERN_SPECKLE, 0x17181b, 0x4c4f55, 0.03);
    int rod = add_glossy(b, 0xe0aa3e, 0.4, 24);
    const double back = -0.84, front = -0.3, y = 0.29, sill = 0.72, eaves = 0.985;

    add_box(b, inside, vec3(back, -y, 0.43), vec3(front, y, 0.46));
    add_box(b, side_paint, vec3(front - 0.02, -y, 0.43), vec3(front, y, sill + 0.1));
    add_box(b, side_paint, vec3(back, -y, 0.43), vec3(back + 0.02, y, 0.62));
    for (int side = -1; side <= 1; side += 2) {
        double outer = y * side, inner = (y - 0.02) * side;
        add_box(b, side_paint, vec3(-0.72, fmin(outer, inner), 0.43),
                vec3(front, fmax(outer, inner), sill));
        add_box(b, panel, vec3(-0.66, outer - 0.004, 0.49), vec3(-0.36, outer + 0.004, 0.66));
        add_rod(b, rod, vec3(back + 0.02, inner, 0.46), vec3(back + 0.02, inner, eaves), 0.014);
        add_rod(b, side_paint, vec3(front - 0.01, inner, sill), vec3(front - 0.01, inner, eaves),
                0.016);
        add_rod(b, side_paint, vec3(-0.6, inner, sill), vec3(-0.6, inner, eaves), 0.016);
    }
    /* a roof of five thin planks, bent over the cab */
    for (int i = -2; i <= 2; i++) {
        double lift = 0.018 * (4 - i * i) + 0.03;
        add_box(b, roof, vec3(back - 0.06, 0.13 * i - 0.066, eaves + lift - 0.03),
                vec3(front + 0.07, 0.13 * i + 0.066, eaves + lift));
    }
    for (int i = 0; i < 9; i++) {
        double row = i % 3;
        add_sphere(b, coal,
                   vec3(-0.77 + 0.06 * (i / 3), -0.17 + 0.16 * row + 0.02 * (i / 3),
                        0.5 + 0.01 * (i * 5 % 4)),
                   0.062);
    }
}

static void front_and_steam(builder *b)
{
    int red = add_glossy(b, 0xc22f26, 0.1, 20);
    int steel = add_glossy(b, 0x9aa0a8, 0.3, 30);
    int steam = add_material(b, PATTERN_SPECKLE, 0xffffff, 0xd5dbe6, 0.09);

    add_box(b, red, vec3(0.82, -0.3, 0.3), vec3(0.87, 0.3, 0.41));
    for (int side = -1; side <= 1; side += 2) {
        double y = 0.2 * side;
        add_rod(b, steel, vec3(0.86, y, 0.36), vec3(0.95, y, 0.36), 0.025);
        add_cylinder(b, steel, vec3(0.94, y, 0.36), vec3(0.965, y, 0.36), 0.06);
        add_rod(b, steel, vec3(-0.84, y, 0.36), vec3(-0.92, y, 0.36), 0.025);
        add_cylinder(b, steel, vec3(-0.91, y, 0.36), vec3(-0.935, y, 0.36), 0.06);
    }
    for (int i = -3; i <= 3; i++)
        add_rod(b, red, vec3(0.86, 0.05 * i, 0.31), vec3(1.05, 0.085 * i, 0.125), 0.013);
    add_rod(b, red, vec3(1.05, -0.27, 0.125), vec3(1.05, 0.27, 0.125), 0.016);

    add_sphere(b, steam, vec3(0.64, 0.0, 1.32), 0.085);
    add_sphere(b, steam, vec3(0.56, 0.03, 1.46), 0.115);
    add_sphere(b, steam, vec3(0.42, -0.02, 1.63), 0.15);
    add_sphere(b, steam, vec3(0.28, 0.08, 1.57), 0.1);
}

static void signal_and_wires(builder *b)
{
    int pole = add_material(b, PATTERN_STRIPES, 0xf4f4f0, 0x2c2e33, 0.11);
    int arm = add_material(b, PATTERN_CHECKER, 0xd43328, 0xf6f4ec, 0.075);
    int wood = add_material(b, PATTERN_WOOD, 0x7d5733, 0x5c3c20, 0.03);
    int wire = add_material(b, PATTERN_PLAIN, 0x2a2a2e, 0x2a2a2e, 1);
    int red = add_material(b, PATTERN_PLAIN, 0xff4a38, 0xff4a38, 1);
    vec foot = vec3(0.62, -0.62, 0);

    b->world->materials[red].glow = 0.6;
    add_cylinder(b, pole, foot, add(foot, vec3(0, 0, 1.22)), 0.024);
    add_sphere(b, wire, add(foot, vec3(0, 0, 1.25)), 0.038);
    add_box(b, arm, add(foot, vec3(-0.42, -0.04, 1.04)), add(foot, vec3(0.03, -0.028, 1.14)));
    add_cylinder(b, red, add(foot, vec3(0.065, -0.045, 1.09)), add(foot, vec3(0.065, -0.02, 1.09)),
                 0.042);
    for (int i = 0; i < 9; i++) { /* ladder */
        double z = 0.1 + 0.1 * i;
        add_rod(b, wire, add(foot, vec3(0.06, -0.045, z)), add(foot, vec3(0.06, 0.045, z)), 0.007);
    }
    for (int side = -1; side <= 1; side += 2)
        add_rod(b, wire, add(foot, vec3(0.06, 0.045 * side, 0)),
                add(foot, vec3(0.06, 0.045 * side, 1.0)), 0.008);

    for (int i = -1; i <= 1; i++) {
        vec at = vec3(0.78 * i, i ? 0.68 : 0.88, 0);
        add_cylinder(b, wood, at, add(at, vec3(0, 0, 0.98)), 0.022);
        add_box(b, wood, add(at, vec3(-0.016, -0.15, 0.86)), add(at, vec3(0.016, 0.15, 0.895)));
        for (int side = -1; side <= 1; side += 2)
            add_sphere(b, pole, add(at, vec3(0, 0.12 * side, 0.915)), 0.022);
        if (i < 1)
            for (int side = -1; side <= 1; side += 2)
                add_wire(b, wire, add(at, vec3(0, 0.12 * side, 0.92)),
                         vec3(0.78 * (i + 1), (i ? 0.88 : 0.68) + 0.12 * side, 0.92), 0.07, 0.007);
    }
}

static void trees(builder *b)
{
    int leaves = add_material(b, PATTERN_SPECKLE, 0x1d5c2c, 0x6fb04a, 0.05);
    int trunk = add_material(b, PATTERN_WOOD, 0x6a4526, 0x452a14, 0.03);
    int ball = add_material(b, PATTERN_STRIPES, 0xe8433a, 0xf6f2e6, 0.05);
    static const double at[3][3] = {{-0.62, -0.72, 1}, {-0.2, -0.95, 0.72}, {-0.92, -0.5, 0.6}};

    for (int i = 0; i < 3; i++) {
        double s = at[i][2];
        vec foot = vec3(at[i][0], at[i][1], 0);
        add_cylinder(b, trunk, foot, add(foot, vec3(0, 0, 0.2 * s)), 0.045 * s);
        for (int k = 0; k < 3; k++) {
            double low = (0.16 + 0.2 * k) * s, r = (0.26 - 0.06 * k) * s;
            add_frustum(b, leaves, add(foot, vec3(0, 0, low)), add(foot, vec3(0, 0, low + 0.3 * s)),
                        r, 0.02 * s);
        }
    }
    add_sphere(b, ball, vec3(0.2, -0.72, 0.1), 0.1);
    add_box(b, trunk, vec3(-0.5, 0.78, 0), vec3(-0.2, 0.98, 0.16));
    add_turned_box(b, trunk, vec3(-0.38, 0.88, 0.23), 0.1, 0.08, 0.07, 0.5);
}

cln_status scene_object(world *w)
{
    builder b = {.world = w, .shift = vec3(0, 0, -0.72)};

    w->light = unit(vec3(0.35, -0.5, 0.8));
    w->light_size = 0.07;
    w->light_colour = vec3(0.86, 0.82, 0.74);
    w->sky = vec3(0.5, 0.54, 0.62);
    w->ground = vec3(0.3, 0.29, 0.26);
    w->sky_reach = 0.5;
    ground(&b);
    running_gear(&b);
    boiler(&b);
    cab(&b);
    front_and_steam(&b);
    signal_and_wires(&b);
    trees(&b);
    return b.st == CLN_OK ? shapes_finish(&w->shapes) : b.st;
}
