/* Between scene space and the cube; space.h has the formulas. */
#include "scene/space.h"

#include <math.h>
#include <string.h>

const cln_space cln_space_unit = {.half = 1};

void cln_space_point_to_cube(const cln_space *space, const double scene[3], double cube[3])
{
    for (int a = 0; a < 3; a++)
        cube[a] = (scene[a] - space->centre[a]) / space->half;
}

void cln_space_point_to_scene(const cln_space *space, const double cube[3], double scene[3])
{
    for (int a = 0; a < 3; a++)
        scene[a] = space->centre[a] + space->half * cube[a];
}

void cln_space_ray_to_cube(const cln_space *space, const double origin[3],
                           const double direction[3], double cube_origin[3],
                           double cube_direction[3])
{
    cln_space_point_to_cube(space, origin, cube_origin);
    memcpy(cube_direction, direction, 3 * sizeof *direction);
}

void cln_space_pose_to_cube(const cln_space *space, const double c2w[12], float out[12])
{
    const double position[3] = {c2w[3], c2w[7], c2w[11]};
    double cube[3];

    cln_space_point_to_cube(space, position, cube);
    for (int i = 0; i < 12; i++)
        out[i] = (float)(i % 4 < 3 ? c2w[i] : cube[i / 4]);
}

double cln_space_distance_to_scene(const cln_space *space, double cube)
{
    return space->half * cube;
}

float cln_space_depth_to_scene(const cln_space *space, float cube)
{
    return cube * (float)space->half;
}

void cln_space_box_to_scene(const cln_space *space, const float cube[4], float low[3],
                            float high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = (float)(space->centre[a] + space->half * cube[a]);
        high[a] = (float)(space->centre[a] + space->half * (cube[a] + cube[3]));
    }
}

bool cln_space_holds(const cln_space *space, const double scene[3])
{
    for (int a = 0; a < 3; a++)
        if (fabs(scene[a] - space->centre[a]) > space->half)
            return false;
    return true;
}

/* Slab test: the interval of t in which the ray is between both faces, for every axis. */
bool cln_space_met_by(const cln_space *space, const double origin[3], const double direction[3])
{
    double enter = 0, leave = INFINITY;

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

double cln_space_density_to_scene(const cln_space *space, double cube)
{
    return cube / space->half;
}

bool cln_space_equal(const cln_space *a, const cln_space *b)
{
    bool same = fabs(a->half - b->half) <= 1e-6 * b->half;

    for (int i = 0; i < 3; i++)
        same = same && fabs(a->centre[i] - b->centre[i]) <= 1e-6 * b->half;
    return same;
}
