/* Maps between scene space and the cube; space.h has the formulas. */
#include "scene/space.h"

#include <math.h>
#include <string.h>
#include "scene/vectors.h"

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

/* ---- shell spaces ---- */

/* The piece of a point of u: a face's axis and sign, or the core (CORE). */
enum { CORE = 3 };
typedef struct piece {
    int axis;
    double sign;
} piece;

/* least: where the core ends, 1 for points of u, 1/2 for those of the cube. */
static piece piece_of(const double p[3], double least)
{
    int a = 0;

    for (int b = 1; b < 3; b++)
        if (fabs(p[b]) > fabs(p[a]))
            a = b;
    if (fabs(p[a]) <= least)
        return (piece){CORE, 1};
    return (piece){a, p[a] < 0 ? -1 : 1};
}

/* Maps a point of u with a piece's map; the point is in the piece, on its border, or wherever the
 * map reaches. */
static void into_piece(piece f, const double u[3], double cube[3])
{
    const double w = f.axis == CORE ? 1 : f.sign / u[f.axis];

    for (int a = 0; a < 3; a++)
        cube[a] = a == f.axis ? f.sign * (1 - 0.5 * w) : 0.5 * w * u[a];
}

static void out_of_piece(piece f, const double cube[3], double u[3])
{
    const double w =
        f.axis == CORE ? 1 : fmax(2 * (1 - f.sign * cube[f.axis]), LEAST_TO_INFINITY / 2);

    for (int a = 0; a < 3; a++)
        u[a] = a == f.axis ? f.sign / w : 2 * cube[a] / w;
}

/* How the point u of the piece moves in the cube when it moves by v, times a positive factor, which
 * it returns. u and v may be a ray's origin and direction: all points of a line have the same. */
static double bend_in_piece(piece f, const double u[3], const double v[3], double out[3])
{
    if (f.axis == CORE) {
        memmove(out, v, 3 * sizeof *out);
        return 2;
    }
    for (int a = 0; a < 3; a++)
        if (a != f.axis)
            out[a] = f.sign * (v[a] * u[f.axis] - u[a] * v[f.axis]);
    out[f.axis] = v[f.axis];
    return 2 * u[f.axis] * u[f.axis];
}

/* Where the ray u = o + s d, at `s` in the piece, leaves it for *next: INFINITY if never. Beyond a
 * face's border the next piece's signed coordinate grows faster, so no piece comes twice. */
static double leave_piece(piece f, const double o[3], const double d[3], double s, piece *next)
{
    double leave = INFINITY;

    for (int a = 0; a < 3; a++)
        for (int k = 0; k < 2; k++) {
            const double sign = k ? 1 : -1;
            double lead = 1 - sign * o[a], falls = sign * d[a]; /* inside while lead > s falls */
            piece to = {a, sign};

            if (f.axis == a) { /* its own axis: back into the core */
                if (sign != f.sign)
                    continue;
                lead = sign * o[a] - 1;
                falls = -sign * d[a];
                to.axis = CORE;
            } else if (f.axis != CORE) {
                lead = f.sign * o[f.axis] - sign * o[a];
                falls = sign * d[a] - f.sign * d[f.axis];
            }
            if (falls > 0 && fmax(lead / falls, s) < leave) {
                leave = fmax(lead / falls, s);
                *next = to;
            }
        }
    return leave;
}

void cln_space_point_to_u(const double cube[3], double u[3])
{
    out_of_piece(piece_of(cube, 0.5), cube, u);
}

static double length_along(const double from[3], const double to[3], const double d[3])
{
    double sum = 0;

    for (int a = 0; a < 3; a++)
        sum += (to[a] - from[a]) * d[a];
    return sum;
}

int cln_space_lines(const cln_space *space, const double origin[3], const double direction[3],
                    double near, cln_space_line lines[CLN_SPACE_LINES])
{
    double o[3], d[3], u[3], s = near, t = 0;
    piece here, next = {CORE, 1};
    int count = 0;

    cln_space_ray_to_cube(space, origin, direction, o, d);
    for (int a = 0; a < 3; a++)
        u[a] = o[a] + s * d[a];
    here = piece_of(u, 1);
    for (int k = 0; k < CLN_SPACE_LINES && isfinite(s); k++, here = next) {
        cln_space_line *line = &lines[count];
        const double until = leave_piece(here, o, d, s, &next);
        double from[3], to[3];

        into_piece(here, u, from);
        for (int a = 0; a < 3; a++)
            u[a] = isfinite(until) ? o[a] + until * d[a] : d[a];
        into_piece(here, u, to);
        if (!isfinite(until)) /* the point at infinity is on the root's face */
            to[here.axis] = here.sign;
        s = until;
        *line = (cln_space_line){.begin = t};
        bend_in_piece(here, o, d, line->direction);
        cln_unit(line->direction);
        line->end = t + length_along(from, to, line->direction);
        if (!(line->end > line->begin))
            continue;
        for (int a = 0; a < 3; a++)
            line->origin[a] = from[a] - t * line->direction[a];
        t = line->end;
        count++;
    }
    return count;
}

/* ---- all spaces ---- */

void cln_space_point_to_cube(const cln_space *space, const double scene[3], double cube[3])
{
    double q[3];

    if (!space->forward) {
        for (int a = 0; a < 3; a++)
            cube[a] = (scene[a] - space->centre[a]) / space->half;
        if (space->shell) {
            memcpy(q, cube, sizeof q);
            into_piece(piece_of(q, 1), q, cube);
        }
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
        memcpy(q, cube, 3 * sizeof *q);
        if (space->shell)
            out_of_piece(piece_of(cube, 0.5), cube, q);
        for (int a = 0; a < 3; a++)
            scene[a] = space->centre[a] + space->half * q[a];
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
        for (int a = 0; a < 3; a++)
            cube_origin[a] = (origin[a] - space->centre[a]) / space->half;
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
    cln_unit(cube_direction);
}

void cln_space_depth_to_cube(const cln_space *space, const double origin[3],
                             const double direction[3], double depth, double cube[3])
{
    double o[3], d[3];

    if (!space->forward && !space->shell) {
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
        memcpy(d, direction, sizeof d);
        memcpy(cube, d, sizeof d);
        if (space->shell) {
            for (int a = 0; a < 3; a++)
                q[a] = (scene[a] - space->centre[a]) / space->half;
            bend_in_piece(piece_of(q, 1), q, d, cube);
            cln_unit(cube);
        }
        return;
    }
    to_camera_units(space, scene, q);
    turn(space, direction, d);
    bend(space, q, d, cube);
    cln_unit(cube);
}

void cln_space_normal_to_scene(const cln_space *space, const double cube[3], const float normal[3],
                               float scene[3])
{
    double q[4], n[3], out[3];
    const piece f = space->shell ? piece_of(cube, 0.5) : (piece){CORE, 1};

    if (!space->forward) {
        for (int a = 0; a < 3; a++)
            out[a] = normal[a];
        if (f.axis != CORE) {
            out[f.axis] *= 2 * (1 - f.sign * cube[f.axis]);
            for (int a = 0; a < 3; a++)
                out[f.axis] -= a == f.axis ? 0 : 2 * f.sign * cube[a] * out[a];
            cln_unit(out);
        }
        for (int a = 0; a < 3; a++)
            scene[a] = (float)out[a];
        return;
    }
    /* normals go by the transposed derivative */
    cln_space_point_to_view(space, cube, q);
    for (int a = 0; a < 2; a++)
        n[a] = space->scale[a] * normal[a];
    n[2] = 2 * q[3] * normal[2] - q[0] * n[0] - q[1] * n[1];
    turn_back(space, n, out);
    cln_unit(out);
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
        cln_space_ray_to_cube(space, position, position, moved, (double[3]){0});
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

    if (space->shell) {
        for (int a = 0; a < 3; a++)
            q[a] = (scene[a] - space->centre[a]) / space->half;
        cube /= bend_in_piece(piece_of(q, 1), q, direction, v);
        return cube * sqrt(cln_dot(v, v)) / space->half;
    }
    if (!space->forward)
        return cube / space->half;
    to_camera_units(space, scene, q);
    if (!(q[2] > LEAST_FORWARD))
        return 0;
    turn(space, direction, d);
    bend(space, q, d, v);
    return cube * sqrt(cln_dot(v, v)) / (q[2] * q[2] * space->half);
}

void cln_space_box_to_scene(const cln_space *space, const float cube[4], double low[3],
                            double high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = space->centre[a] + space->half * cube[a];
        high[a] = space->centre[a] + space->half * (cube[a] + cube[3]);
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

    if (space->shell)
        return true;
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

    if (space->shell)
        return true;
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

cln_space cln_space_core(const cln_space *space)
{
    cln_space core = *space;

    core.shell = false;
    return core;
}

const char *cln_space_name(const cln_space *space)
{
    return space->forward ? "ndc" : space->shell ? "shell" : "cube";
}

bool cln_space_equal(const cln_space *a, const cln_space *b)
{
    bool same = a->forward == b->forward && a->shell == b->shell &&
                fabs(a->half - b->half) <= 1e-6 * b->half;

    for (int i = 0; i < 3; i++)
        same = same && fabs(a->centre[i] - b->centre[i]) <= 1e-6 * b->half;
    for (int i = 0; b->forward && i < 9; i++)
        same = same && fabs(a->axes[i] - b->axes[i]) <= 1e-6;
    for (int i = 0; b->forward && i < 2; i++)
        same = same && fabs(a->scale[i] - b->scale[i]) <= 1e-6 * b->scale[i];
    return same;
}
