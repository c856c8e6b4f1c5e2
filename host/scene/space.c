/* Between scene space and the cube; space.h has the formulas. */
#include "scene/space.h"

#include <math.h>
#include <string.h>

const cln_space cln_space_unit = {.half = 1};

/* Forward: rays less steep than this do not look forward; 1 - z of the cube counts as at least
 * this. kernels/space.h has the same. */
static const double LEAST_FORWARD = 1e-6, LEAST_TO_INFINITY = 2e-6;

/* ---- forward spaces: camera units ---- */

static void turn(const cln_space *space, const double v[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = space->axes[3 * k] * v[0] + space->axes[3 * k + 1] * v[1] +
                 space->axes[3 * k + 2] * v[2];
}

static void turn_back(const cln_space *space, const double v[3], double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = space->axes[a] * v[0] + space->axes[3 + a] * v[1] + space->axes[6 + a] * v[2];
}

static void to_camera_units(const cln_space *space, const double scene[3], double out[3])
{
    double from[3];

    for (int a = 0; a < 3; a++)
        from[a] = (scene[a] - space->centre[a]) / space->half;
    turn(space, from, out);
}

static void normalise(double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    for (int a = 0; a < 3 && length > 0; a++)
        v[a] /= length;
}

/* How the point q moves in the cube when it moves by v: the map's derivative, times q_z^2. */
static void bend(const cln_space *space, const double q[3], const double v[3], double out[3])
{
    for (int a = 0; a < 2; a++)
        out[a] = space->scale[a] * (v[a] * q[2] - q[a] * v[2]);
    out[2] = 2 * v[2];
}

void cln_space_point_to_view(const cln_space *space, const double cube[3], double out[4])
{
    for (int a = 0; a < 2; a++)
        out[a] = cube[a] / space->scale[a];
    out[2] = 1;
    out[3] = 0.5 * (1 - cube[2]);
}

/* ---- all spaces ---- */

void cln_space_point_to_cube(const cln_space *space, const double scene[3], double cube[3])
{
    double q[3];

    if (!space->forward) {
        for (int a = 0; a < 3; a++)
            cube[a] = (scene[a] - space->centre[a]) / space->half;
        return;
    }
    to_camera_units(space, scene, q);
    if (!(q[2] > LEAST_FORWARD))
        q[2] = LEAST_FORWARD;
    for (int a = 0; a < 2; a++)
        cube[a] = space->scale[a] * q[a] / q[2];
    cube[2] = 1 - 2 / q[2];
}

void cln_space_point_to_scene(const cln_space *space, const double cube[3], double scene[3])
{
    double q[4];

    if (!space->forward) {
        for (int a = 0; a < 3; a++)
            scene[a] = space->centre[a] + space->half * cube[a];
        return;
    }
    cln_space_point_to_view(space, cube, q);
    q[3] = fmax(q[3], 0.5 * LEAST_TO_INFINITY);
    for (int a = 0; a < 3; a++)
        q[a] *= space->half / q[3];
    turn_back(space, q, scene);
    for (int a = 0; a < 3; a++)
        scene[a] += space->centre[a];
}

void cln_space_ray_to_cube(const cln_space *space, const double origin[3],
                           const double direction[3], double cube_origin[3],
                           double cube_direction[3])
{
    double o[3], d[3], z = 0;

    if (!space->forward) {
        cln_space_point_to_cube(space, origin, cube_origin);
        memmove(cube_direction, direction, 3 * sizeof *direction);
        return;
    }
    to_camera_units(space, origin, o);
    turn(space, direction, d);
    if (!(d[2] > LEAST_FORWARD)) {
        memcpy(cube_origin, (const double[3]){3, 3, 3}, 3 * sizeof *cube_origin);
        memcpy(cube_direction, (const double[3]){1, 0, 0}, 3 * sizeof *cube_direction);
        return;
    }
    z = fmax(1, o[2]);
    for (int a = 0; a < 2; a++)
        cube_origin[a] = space->scale[a] * (o[a] + (z - o[2]) / d[2] * d[a]) / z;
    cube_origin[2] = 1 - 2 / z;
    bend(space, o, d, cube_direction);
    normalise(cube_direction);
}

void cln_space_depth_to_cube(const cln_space *space, const double origin[3],
                             const double direction[3], double depth, double cube[3])
{
    double o[3], d[3];

    if (!space->forward) {
        cln_space_ray_to_cube(space, origin, direction, o, d);
        for (int a = 0; a < 3; a++)
            cube[a] = o[a] + depth * d[a];
        return;
    }
    for (int a = 0; a < 3; a++)
        o[a] = origin[a] + space->half * depth * direction[a];
    cln_space_point_to_cube(space, o, cube);
}

void cln_space_direction_to_cube(const cln_space *space, const double scene[3],
                                 const double direction[3], double cube[3])
{
    double q[3], d[3];

    if (!space->forward) {
        memmove(cube, direction, 3 * sizeof *direction);
        return;
    }
    to_camera_units(space, scene, q);
    turn(space, direction, d);
    bend(space, q, d, cube);
    normalise(cube);
}

void cln_space_normal_to_scene(const cln_space *space, const double cube[3], const float normal[3],
                               float scene[3])
{
    double q[4], n[3], out[3];

    if (!space->forward) {
        memmove(scene, normal, 3 * sizeof *normal);
        return;
    }
    /* a normal goes by the transposed derivative */
    cln_space_point_to_view(space, cube, q);
    for (int a = 0; a < 2; a++)
        n[a] = space->scale[a] * normal[a];
    n[2] = 2 * q[3] * normal[2] - q[0] * n[0] - q[1] * n[1];
    turn_back(space, n, out);
    normalise(out);
    for (int a = 0; a < 3; a++)
        scene[a] = (float)out[a];
}

void cln_space_pose_to_cube(const cln_space *space, const double c2w[12], float out[12])
{
    const double position[3] = {c2w[3], c2w[7], c2w[11]};
    double moved[3];

    if (space->forward) {
        to_camera_units(space, position, moved);
        for (int k = 0; k < 3; k++) {
            const double axis[3] = {c2w[k], c2w[4 + k], c2w[8 + k]};
            double turned[3];

            turn(space, axis, turned);
            for (int a = 0; a < 3; a++)
                out[4 * a + k] = (float)turned[a];
        }
    } else {
        cln_space_point_to_cube(space, position, moved);
        for (int i = 0; i < 12; i++)
            if (i % 4 < 3)
                out[i] = (float)c2w[i];
    }
    for (int a = 0; a < 3; a++)
        out[4 * a + 3] = (float)moved[a];
}

double cln_space_distance_to_scene(const cln_space *space, double cube)
{
    return space->half * cube;
}

float cln_space_depth_to_scene(const cln_space *space, float cube)
{
    return cube * (float)space->half;
}

double cln_space_density_to_scene(const cln_space *space, const double scene[3],
                                  const double direction[3], double cube)
{
    double q[3], d[3], v[3];

    if (!space->forward)
        return cube / space->half;
    to_camera_units(space, scene, q);
    if (!(q[2] > LEAST_FORWARD))
        return 0;
    turn(space, direction, d);
    bend(space, q, d, v);
    return cube * sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) / (q[2] * q[2] * space->half);
}

void cln_space_box_to_scene(const cln_space *space, const float cube[4], float low[3],
                            float high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = (float)(space->centre[a] + space->half * cube[a]);
        high[a] = (float)(space->centre[a] + space->half * (cube[a] + cube[3]));
    }
}

/* n p + d >= 0, p in the scene; forward: times 1 / q_z, which is positive. */
void cln_space_plane_to_cube(const cln_space *space, const double scene[4], float cube[4])
{
    double plane[4] = {0}, from = scene[3], length = 0;

    for (int a = 0; a < 3; a++)
        from += scene[a] * space->centre[a];
    if (space->forward) {
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                plane[k == 2 ? 3 : k] += scene[a] * space->half * space->axes[3 * k + a] /
                                         (k == 2 ? 1 : space->scale[k]);
        plane[2] = -0.5 * from;
        plane[3] += 0.5 * from;
    } else {
        for (int k = 0; k < 3; k++)
            plane[k] = scene[k] * space->half;
        plane[3] = from;
    }
    for (int k = 0; k < 3; k++)
        length = hypot(length, plane[k]);
    for (int k = 0; k < 4; k++)
        cube[k] = (float)fmax(-1e30, fmin(1e30, plane[k] / fmax(length, 1e-300)));
}

void cln_space_box_to_planes(const cln_space *space, const double box[6], float planes[6][4])
{
    for (int i = 0; i < 6; i++) {
        const double sign = i < 3 ? 1 : -1;
        double plane[4] = {0};

        plane[i % 3] = sign;
        plane[3] = -sign * box[i];
        cln_space_plane_to_cube(space, plane, planes[i]);
    }
}

bool cln_space_holds(const cln_space *space, const double scene[3])
{
    double cube[3];

    if (space->forward) {
        cln_space_point_to_cube(space, scene, cube);
        return fabs(cube[0]) <= 1 && fabs(cube[1]) <= 1 && fabs(cube[2]) <= 1;
    }
    for (int a = 0; a < 3; a++)
        if (fabs(scene[a] - space->centre[a]) > space->half)
            return false;
    return true;
}

/* Slab test: the interval of t in which the ray is between both faces, for every axis. */
bool cln_space_met_by(const cln_space *space, const double origin[3], const double direction[3])
{
    double enter = 0, leave = INFINITY, o[3], d[3];

    if (space->forward) {
        cln_space_ray_to_cube(space, origin, direction, o, d);
        return cln_space_met_by(&cln_space_unit, o, d);
    }
    for (int a = 0; a < 3; a++) {
        const double low = space->centre[a] - space->half - origin[a];
        const double high = space->centre[a] + space->half - origin[a];

        if (direction[a] == 0) {
            if (low > 0 || high < 0)
                return false;
            continue;
        }
        enter = fmax(enter, fmin(low / direction[a], high / direction[a]));
        leave = fmin(leave, fmax(low / direction[a], high / direction[a]));
    }
    return enter < leave;
}

bool cln_space_equal(const cln_space *a, const cln_space *b)
{
    bool same = a->forward == b->forward && fabs(a->half - b->half) <= 1e-6 * b->half;

    for (int i = 0; i < 3; i++)
        same = same && fabs(a->centre[i] - b->centre[i]) <= 1e-6 * b->half;
    for (int i = 0; b->forward && i < 9; i++)
        same = same && fabs(a->axes[i] - b->axes[i]) <= 1e-6;
    for (int i = 0; b->forward && i < 2; i++)
        same = same && fabs(a->scale[i] - b->scale[i]) <= 1e-6 * b->scale[i];
    return same;
}
