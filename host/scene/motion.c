/* Rotation vectors and what a set of poses has in common. See motion.h. */
#include "scene/motion.h"

#include <math.h>
#include <string.h>

#include "scene/build.h"
#include "scene/vectors.h"

/* exp(w): Rodrigues' formula, r row-major 3x3. */
static void rotation_of(const double w[3], double r[9])
{
    const double square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(square);
    const double a = angle > 1e-6 ? sin(angle) / angle : 1 - square / 6;
    const double half = angle > 1e-6 ? sin(angle / 2) / angle : 0.5 - square / 48;
    const double b = 2 * half * half; /* (1 - cos) / angle^2, without cancellation */

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            r[3 * i + j] = b * w[i] * w[j] + (i == j ? 1 - b * square : 0);
    for (int i = 0; i < 3; i++) { /* a [w]x */
        r[3 * ((i + 2) % 3) + (i + 1) % 3] += a * w[i];
        r[3 * ((i + 1) % 3) + (i + 2) % 3] -= a * w[i];
    }
}

/* Its inverse, for angles of less than pi. */
static void vector_of(const double r[9], double w[3])
{
    const double c = 0.5 * (r[0] + r[4] + r[8] - 1);
    double sine = 0, by = 0;

    for (int i = 0; i < 3; i++)
        w[i] = 0.5 * (r[3 * ((i + 2) % 3) + (i + 1) % 3] - r[3 * ((i + 1) % 3) + (i + 2) % 3]);
    sine = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    by = sine > 1e-9 ? atan2(sine, c) / sine : 1;
    for (int i = 0; i < 3; i++)
        w[i] *= by;
}

void cln_motion_apply(const double c2w[12], const double motion[CLN_MOTION], double out[12])
{
    double r[9], pose[12];

    rotation_of(motion, r);
    for (int i = 0; i < 3; i++) {
        const double *row = c2w + 4 * i;

        for (int j = 0; j < 3; j++)
            pose[4 * i + j] = row[0] * r[j] + row[1] * r[3 + j] + row[2] * r[6 + j];
        pose[4 * i + 3] = row[3] + row[0] * motion[3] + row[1] * motion[4] + row[2] * motion[5];
    }
    memcpy(out, pose, sizeof pose);
}

void cln_motion_between(const double from[12], const double to[12], double out[CLN_MOTION])
{
    double r[9];

    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            r[3 * i + j] = from[i] * to[j] + from[4 + i] * to[4 + j] + from[8 + i] * to[8 + j];
        out[3 + i] = from[i] * (to[3] - from[3]) + from[4 + i] * (to[7] - from[7]) +
                     from[8 + i] * (to[11] - from[11]);
    }
    vector_of(r, out);
}

/* The rotation vector from one pose to another, in the scene's axes. */
static void turn_of(const double from[12], const double to[12], double turn[3])
{
    double motion[CLN_MOTION];

    cln_motion_between(from, to, motion);
    for (int i = 0; i < 3; i++)
        turn[i] =
            from[4 * i] * motion[0] + from[4 * i + 1] * motion[1] + from[4 * i + 2] * motion[2];
}

void cln_motion_hold(int count, const double (*from)[12], double reach, double (*to)[12])
{
    double middle[3] = {0}, shift[3] = {0}, m[9] = {0}, b[3] = {0}, turn[3], back[9];
    double along = 0, square = 0, scale = 0;

    for (int k = 0; k < count; k++)
        for (int a = 0; a < 3; a++) {
            middle[a] += from[k][4 * a + 3] / count;
            shift[a] += (to[k][4 * a + 3] - from[k][4 * a + 3]) / count;
        }
    /* least squares of |turn_k - turn|^2 reach^2 + |moved_k - shift - turn x x_k - scale x_k|^2 */
    for (int k = 0; k < count; k++) {
        double x[3], moved[3], own[3];

        turn_of(from[k], to[k], own);
        for (int a = 0; a < 3; a++) {
            x[a] = from[k][4 * a + 3] - middle[a];
            moved[a] = to[k][4 * a + 3] - from[k][4 * a + 3] - shift[a];
            along += x[a] * moved[a];
            square += x[a] * x[a];
        }
        for (int i = 0; i < 3; i++) {
            b[i] += reach * reach * own[i] + x[(i + 1) % 3] * moved[(i + 2) % 3] -
                    x[(i + 2) % 3] * moved[(i + 1) % 3];
            for (int j = 0; j < 3; j++)
                m[3 * i + j] -= x[i] * x[j];
            m[4 * i] += reach * reach + x[0] * x[0] + x[1] * x[1] + x[2] * x[2];
        }
    }
    cln_solve3(m, b, turn);
    scale = square > 0 ? along / square : 0;
    for (int a = 0; a < 3; a++)
        turn[a] = -turn[a];
    rotation_of(turn, back);
    for (int k = 0; k < count; k++) {
        double x[3], pose[12];

        for (int a = 0; a < 3; a++)
            x[a] = (to[k][4 * a + 3] - middle[a] - shift[a]) / (1 + scale);
        for (int i = 0; i < 3; i++) {
            pose[4 * i + 3] = middle[i];
            for (int j = 0; j < 3; j++) {
                pose[4 * i + 3] += back[3 * i + j] * x[j];
                pose[4 * i + j] = back[3 * i] * to[k][j] + back[3 * i + 1] * to[k][4 + j] +
                                  back[3 * i + 2] * to[k][8 + j];
            }
        }
        memcpy(to[k], pose, sizeof pose);
    }
}

void cln_motion_views(cln_scene *scene, const float (*motions)[CLN_MOTION])
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    for (int i = 0; i < count; i++) {
        cln_camera *c = &cln_scene_training_view(scene, i)->camera;
        double motion[CLN_MOTION];

        for (int k = 0; k < CLN_MOTION; k++)
            motion[k] = (double)motions[i][k];
        cln_motion_apply(c->c2w, motion, c->c2w);
    }
    cln_scene_place_sights(scene);
}
