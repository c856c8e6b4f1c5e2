/* Where the cameras of a generated scene stand. */
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "job.h"

static const double pi = 3.14159265358979323846;

static void look(cln_camera *camera, vec from, vec forward)
{
    vec z = unit(forward), x = unit(cross(z, vec3(0, 0, 1))), y = cross(z, x);
    const vec columns[4] = {x, y, z, from};

    for (int c = 0; c < 4; c++) {
        camera->c2w[c] = columns[c].x;
        camera->c2w[4 + c] = columns[c].y;
        camera->c2w[8 + c] = columns[c].z;
    }
}

/* Forward: a jittered grid of places in a plane before the scene, looking at its middle, as people
 * hold a phone. */
static void place_forward(const settings *set, int split, int i, const float u[4],
                          cln_camera *camera)
{
    const int side = (int)ceil(sqrt(set->views[split]));
    const double x = (i % side + 0.2 + 0.6 * u[0]) / side - 0.5;
    const double z = (i / side + 0.2 + 0.6 * u[1]) / side - 0.5;
    const vec from = vec3(0.9 * x, -3.3 + 0.2 * (u[2] - 0.5), 0.7 * z);
    const vec at = vec3(0.25 * x, 0.4, 0.2 * z);

    look(camera, from, sub(at, from));
}

/* Terrain: the first half of a split looks straight down, in a grid of photos that overlap by half,
 * along strips flown to and fro; the others look obliquely from all around, 35 to 50 degrees
 * steep. */
static void place_terrain(const settings *set, int split, int i, double turn, const float u[4],
                          cln_camera *camera)
{
    const int down = (set->views[split] + 1) / 2, side = (int)ceil(sqrt(down));

    if (i < down) {
        const double x = 2.4 * ((i % side + 0.4 + 0.2 * u[0]) / side - 0.5);
        const double y = 2.4 * ((i / side + 0.4 + 0.2 * u[1]) / side - 0.5);
        const double way = i / side % 2 ? -1 : 1; /* of flight, and the picture's up */

        look(camera, vec3(x, y, 4.5), vec3(0.04 * way * (u[2] + 0.2), 0.01 * (u[3] - 0.5), -1));
    } else {
        const double steep = 0.61 + 0.26 * u[0], far = 5.2;
        const vec at = vec3(1.2 * (u[1] - 0.5), 1.2 * (u[2] - 0.5), -0.2);
        const vec to = vec3(-cos(turn) * cos(steep), -sin(turn) * cos(steep), -sin(steep));

        look(camera, along(at, -far, to), to);
    }
}

/* Object: evenly over the sphere, from a little below the horizon to nearly overhead, by the golden
 * angle. With --from the training views cover less of it; with --from near the other splits have
 * many distances. */
static void place_object(const settings *set, int split, int i, double yaw, const float u[4],
                         cln_camera *camera)
{
    const int from = split == CLN_SPLIT_TRAIN || set->from == FROM_NEAR ? set->from : FROM_ALL;
    const double part = (i + 0.2 + 0.6 * u[0]) / set->views[split], usual = 4.03;
    double z = -0.12 + (from == FROM_LOW ? 0.38 : 1.07) * part, r = sqrt(1 - z * z),
           distance = usual;
    vec at = vec3(r * cos(yaw), r * sin(yaw), z);

    if (from == FROM_CONE) { /* around a direction 25 degrees above the horizon */
        const vec axis = vec3(0.906, 0, 0.423), side = vec3(0, 1, 0), up = vec3(-0.423, 0, 0.906);

        z = 1 - (1 - cos(40 * pi / 180)) * part;
        r = sqrt(1 - z * z);
        at = along(along(scale(axis, z), r * cos(yaw), side), r * sin(yaw), up);
    }
    if (from == FROM_NEAR && split != CLN_SPLIT_TRAIN)
        distance *= 0.55 * pow(1.8 / 0.55, fmod(0.618034 * i, 1));
    at = scale(at, distance);
    look(camera, at, scale(at, -1));
}

int job_orientation(const settings *set, int view)
{
    return set->held ? set->held[(size_t)view % strlen(set->held)] - '0' : 0;
}

/* Room: anywhere in its middle, looking all around. Street: from a walk around the fountain. Each
 * split has its own sequence. */
void job_place(const settings *set, int split, int i, cln_camera *camera)
{
    const double golden = pi * (3 - sqrt(5));
    static const double fovs[] = {
        [OBJECT] = 0.76, [ROOM] = 1.25, [FORWARD] = 0.56, [TERRAIN] = 0.3, [STREET] = 0.95};
    const double fov = fovs[set->kind];
    float start[4], u[4];

    *camera = (cln_camera){.width = set->size, .height = set->size};
    camera->fx = camera->fy = 0.5 * set->size / tan(0.5 * fov);
    camera->cx = camera->cy = 0.5 * set->size;
    camera->lens = set->lens;
    memcpy(camera->distortion, set->distortion, sizeof set->distortion);
    if (set->lens == CLN_LENS_EQUIRECTANGULAR)
        cln_camera_span_sphere(camera);

    cln_uniform4((uint64_t)set->seed, CLN_STREAM_SCENE, 1, (uint32_t)split, 0, start);
    cln_uniform4((uint64_t)set->seed, CLN_STREAM_SCENE, 2 + (uint32_t)split, (uint32_t)i, 0, u);
    double yaw = 2 * pi * start[0] + golden * i;
    if (set->kind == FORWARD) {
        place_forward(set, split, i, u, camera);
    } else if (set->kind == TERRAIN) {
        place_terrain(set, split, i, yaw, u, camera);
    } else if (set->kind == STREET) {
        const double far = 2.5 + 0.8 * u[0];
        const vec from = vec3(far * cos(yaw), far * sin(yaw), 1.1 * u[1] - 0.1);
        const vec at = vec3(0.5 * (u[2] - 0.5), 0.5 * (u[3] - 0.5), -0.1);

        look(camera, from, sub(at, from));
    } else if (set->kind == ROOM) {
        double pitch = 0.8 * (u[0] - 0.55);
        look(camera, vec3(1.1 * (u[1] - 0.5), 1.1 * (u[2] - 0.5), 0.7 * (u[3] - 0.4)),
             vec3(cos(yaw) * cos(pitch), sin(yaw) * cos(pitch), sin(pitch)));
    } else {
        place_object(set, split, i, yaw, u, camera);
    }
}
