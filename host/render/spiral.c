/* `render --spiral`. See frames.h. About the mean pose it is LLFF's: two turns while the camera
 * moves once forwards and back. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/number.h"
#include "render/frames.h"
#include "scene/vectors.h"

static const double PI = 3.14159265358979323846;
static const double SHARE = 0.9;    /* of the cameras stand within the spiral */
static const double STEEPEST = 1.4; /* radians: above, an azimuth says nothing */
static const double LEAST = 0.02;   /* least radius over the target's distance, as for one camera */
enum { TURNS = 2 };

typedef struct basis {
    double right[3], down[3], forward[3], at[3];
} basis;

static const double *pose_of(const cln_scene *scene, int i)
{
    return cln_scene_training_view(scene, i)->camera.c2w;
}

/* Looks along `forward`, with its x axis across `down`. */
static void look(double forward[3], const double down[3], const double at[3], basis *out)
{
    memcpy(out->at, at, sizeof out->at);
    memcpy(out->forward, forward, sizeof out->forward);
    cln_cross(down, forward, out->right);
    cln_normalise(out->right);
    cln_cross(forward, out->right, out->down);
}

/* False if the cameras look into all directions, or along an up that is given. */
static bool find_mean(const cln_scene *scene, int count, const double up[3], basis *out)
{
    double at[3] = {0}, forward[3] = {0}, down[3] = {0};

    for (int i = 0; i < count; i++) {
        const double *c2w = NULL;
        cln_camera seen;

        cln_view_seen(cln_scene_training_view(scene, i), &seen);
        c2w = seen.c2w;
        for (int a = 0; a < 3; a++) {
            at[a] += c2w[4 * a + 3] / count;
            forward[a] += c2w[4 * a + 2] / count;
            down[a] += c2w[4 * a + 1] / count;
        }
    }
    for (int a = 0; a < 3 && cln_up_given(up); a++)
        down[a] = -up[a];
    if (!cln_normalise(forward) || !cln_normalise(down))
        return false;
    look(forward, down, at, out);
    return cln_dot(out->right, out->right) > 0.5;
}

/* How far most of the cameras are from `middle` along each axis. */
static cln_status find_radii(const cln_scene *scene, int count, const basis *middle, double least,
                             double radii[3])
{
    cln_status st = CLN_OK;
    const double *const axes[3] = {middle->right, middle->down, middle->forward};
    double *away = NULL;

    CLN_TRY(cln_alloc(&away, (size_t)count, sizeof *away, "spiral"));
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < count; i++) {
            const double *c2w = pose_of(scene, i);
            const double offset[3] = {c2w[3] - middle->at[0], c2w[7] - middle->at[1],
                                      c2w[11] - middle->at[2]};

            away[i] = fabs(cln_dot(offset, axes[k]));
        }
        cln_reals_sort(away, count);
        radii[k] = away[(int)(SHARE * (count - 1))];
        if (k < 2)
            radii[k] = fmax(radii[k], least);
    }
done:
    free(away);
    return st;
}

static cln_status about_mean(const cln_scene *scene, const cln_render_desc *desc,
                             const cln_orbit_frame *seen, const cln_camera *lens, cln_frames *out)
{
    cln_status st = CLN_OK;
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double radii[3], depth = 0, to_target[3];
    basis middle;

    if (!find_mean(scene, count, desc->up, &middle))
        CLN_TRY(cln_fail(CLN_INPUT, "--spiral: the training cameras have no common direction; take "
                                    "--orbit, or --interpolate between their poses"));
    for (int a = 0; a < 3; a++)
        to_target[a] = seen->target[a] - middle.at[a];
    depth = cln_dot(to_target, middle.forward);
    if (!(depth > 0))
        depth = seen->distance;
    CLN_TRY(find_radii(scene, count, &middle, LEAST * depth, radii));
    for (int i = 0; i < out->count; i++) {
        const double turn = 2 * PI * TURNS * i / out->count;
        const double step[3] = {cos(turn), sin(turn), sin(turn / TURNS)};
        double at[3], forward[3];
        basis b;

        for (int a = 0; a < 3; a++) {
            const double axes[3] = {middle.right[a], middle.down[a], middle.forward[a]};

            at[a] = middle.at[a];
            for (int k = 0; k < 3; k++)
                at[a] += desc->orbit_radius * radii[k] * step[k] * axes[k];
            forward[a] = middle.at[a] + depth * middle.forward[a] - at[a];
        }
        cln_normalise(forward);
        look(forward, middle.down, at, &b);
        out->frame[i].camera = *lens;
        cln_pose_of_axes(b.right, b.down, b.forward, b.at, out->frame[i].camera.c2w);
    }
done:
    return st;
}

static cln_status around(const cln_scene *scene, const cln_render_desc *desc,
                         const cln_orbit_frame *seen, const cln_camera *lens, cln_frames *out)
{
    cln_status st = CLN_OK;
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double *heights = NULL, middle = 0, swing = 0, down[3];

    CLN_TRY(cln_alloc(&heights, (size_t)count, sizeof *heights, "spiral"));
    for (int i = 0; i < count; i++) {
        const double *c2w = pose_of(scene, i);
        double away[3] = {c2w[3] - seen->target[0], c2w[7] - seen->target[1],
                          c2w[11] - seen->target[2]};

        heights[i] = cln_normalise(away) ? asin(fmax(-1, fmin(1, cln_dot(away, seen->up)))) : 0;
    }
    cln_reals_sort(heights, count);
    middle =
        0.5 * (heights[(int)((1 - SHARE) * (count - 1))] + heights[(int)(SHARE * (count - 1))]);
    swing = heights[(int)(SHARE * (count - 1))] - middle;
    middle = fmax(-STEEPEST, fmin(STEEPEST, middle));
    swing = fmin(swing, STEEPEST - fabs(middle));
    for (int a = 0; a < 3; a++)
        down[a] = -seen->up[a];
    for (int i = 0; i < out->count; i++) {
        const double turn = 2 * PI * TURNS * i / out->count;
        const double height = middle + swing * sin(turn / TURNS);
        double at[3], forward[3];
        basis b;

        for (int a = 0; a < 3; a++) {
            forward[a] = -cos(height) * (cos(turn) * seen->east[a] + sin(turn) * seen->north[a]) -
                         sin(height) * seen->up[a];
            at[a] = seen->target[a] - desc->orbit_radius * seen->distance * forward[a];
        }
        look(forward, down, at, &b);
        out->frame[i].camera = *lens;
        cln_pose_of_axes(b.right, b.down, b.forward, b.at, out->frame[i].camera.c2w);
    }
done:
    free(heights);
    return st;
}

cln_status cln_frames_spiral(const cln_scene *scene, const cln_render_desc *desc, cln_frames *out)
{
    cln_status st = CLN_OK;
    cln_render_desc own = *desc;
    cln_orbit_frame seen;
    cln_camera lens;

    if (!(own.orbit_radius > 0))
        own.orbit_radius = 1;
    CLN_TRY(cln_orbit_frame_of(scene, desc->up, &seen));
    CLN_TRY(cln_orbit_lens(&seen, &own, &lens));
    CLN_TRY(cln_frames_room(own.spiral_frames, out));
    for (int i = 0; i < out->count; i++)
        CLN_TRY(cln_asprintf(&out->frame[i].name, "spiral_%04d", i));
    if (seen.to - seen.from >= 360)
        CLN_TRY(around(scene, &own, &seen, &lens, out));
    else
        CLN_TRY(about_mean(scene, &own, &seen, &lens, out));
done:
    return st;
}
