/* Other readings of poses: mistakes that converters of poses make. See agreement.h. */
#include "scene/agreement.h"

#include <math.h>
#include <string.h>

/* Poses that were taken for OpenGL's come with the second and third column negated: two rows. */
#define BODY                                                                                       \
    "take the poses of the camera's optical frame (x right, y down, z forward); or multiply each " \
    "camera-to-world rotation from the right by (0 0 1; -1 0 0; 0 -1 0), which gives these axes, " \
    "OpenCV's; in a transforms file, whose axes are OpenGL's, then negate the second and third "   \
    "column"
#define QUATERNIONS                                                                        \
    "make the matrices anew: TUM's and ROS's quaternions are x y z w, those of EuRoC and " \
    "COLMAP w x y z"

const cln_reading cln_readings[CLN_READINGS] = {
    {"as given", "", {1, 0, 0, 0, 1, 0, 0, 0, 1}, false, CLN_W_IS_RIGHT},
    {"with the axes of the other convention",
     "in a transforms file, axes are OpenGL's (y up, z backwards); if this one has OpenCV's (y "
     "down, z forward), negate the second and third column of each matrix",
     {1, 0, 0, 0, -1, 0, 0, 0, -1},
     false,
     CLN_W_IS_RIGHT},
    {"as world-to-camera matrices with OpenCV's axes",
     "invert each matrix; in a transforms file, whose axes are OpenGL's, then negate its second "
     "and third column",
     {1, 0, 0, 0, 1, 0, 0, 0, 1},
     true,
     CLN_W_IS_RIGHT},
    {"as world-to-camera matrices with OpenGL's axes",
     "invert each matrix; in a file of another format than transforms, then negate its second and "
     "third column",
     {1, 0, 0, 0, -1, 0, 0, 0, -1},
     true,
     CLN_W_IS_RIGHT},
    {"of photos upside down",
     "turn the photos",
     {-1, 0, 0, 0, -1, 0, 0, 0, 1},
     false,
     CLN_W_IS_RIGHT},
    {"of photos turned to the left",
     "turn the photos",
     {0, -1, 0, 1, 0, 0, 0, 0, 1},
     false,
     CLN_W_IS_RIGHT},
    {"of photos turned to the right",
     "turn the photos",
     {0, 1, 0, -1, 0, 0, 0, 0, 1},
     false,
     CLN_W_IS_RIGHT},
    {"of mirrored photos",
     "poses that were computed, as of a turntable, go round the wrong way: negate the angle. Only "
     "if "
     "writing reads backwards in the photos, mirror these (by the wrong one of the two all becomes "
     "its mirror image)",
     {-1, 0, 0, 0, 1, 0, 0, 0, 1},
     false,
     CLN_W_IS_RIGHT},
    {"with the axes of a robot's body (x forward, y left, z up, as of ROS's base_link, "
     "camera_link)",
     BODY,
     {0, 0, 1, -1, 0, 0, 0, -1, 0},
     false,
     CLN_W_IS_RIGHT},
    {"with the axes of a robot's body (x forward, y left, z up, as of ROS's base_link, "
     "camera_link)",
     BODY,
     {0, 0, 1, 1, 0, 0, 0, 1, 0},
     false,
     CLN_W_IS_RIGHT},
    {"whose quaternions were read with w first, and have it last",
     QUATERNIONS,
     {1, 0, 0, 0, 1, 0, 0, 0, 1},
     false,
     CLN_W_IS_LAST},
    {"whose quaternions were read with w last, and have it first",
     QUATERNIONS,
     {1, 0, 0, 0, 1, 0, 0, 0, 1},
     false,
     CLN_W_IS_FIRST},
};

/* The quaternion (w, x, y, z) of the turn of a pose, by its largest number: of either sign. */
static void quaternion_of(const double m[12], double q[4])
{
    const double d[4] = {m[0] + m[5] + m[10], m[0] - m[5] - m[10], m[5] - m[0] - m[10],
                         m[10] - m[0] - m[5]};
    const double sum[3] = {m[4] + m[1], m[8] + m[2], m[9] + m[6]};  /* 4 xy, 4 xz, 4 yz */
    const double turn[3] = {m[9] - m[6], m[2] - m[8], m[4] - m[1]}; /* 4 wx, 4 wy, 4 wz */
    const double rows[4][4] = {{1 + d[0], turn[0], turn[1], turn[2]},
                               {turn[0], 1 + d[1], sum[0], sum[1]},
                               {turn[1], sum[0], 1 + d[2], sum[2]},
                               {turn[2], sum[1], sum[2], 1 + d[3]}};
    int best = 0;

    for (int i = 1; i < 4; i++)
        if (d[i] > d[best])
            best = i;
    for (int i = 0; i < 4; i++)
        q[i] = rows[best][i] / (2 * sqrt(1 + d[best]));
}

static void set_turn(const double q[4], double m[12])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                         2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                         2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};

    for (int i = 0; i < 9; i++)
        m[4 * (i / 3) + i % 3] = r[i];
}

/* Reads the quaternion's four numbers, in the order in which they were given, in the other. */
static void move_w(cln_reading_w is, double m[12])
{
    double q[4];

    quaternion_of(m, q);
    if (is == CLN_W_IS_LAST) /* (w, x, y, z) were given as x y z w */
        set_turn((const double[4]){q[3], q[0], q[1], q[2]}, m);
    else /* (x, y, z, w) were given as w x y z */
        set_turn((const double[4]){q[1], q[2], q[3], q[0]}, m);
}

void cln_reading_pose(const cln_reading *reading, const double given[12], double out[12])
{
    double turned[12];

    memcpy(turned, given, sizeof turned);
    if (reading->inverse) {
        double m[12];

        /* undoes the reader's turn of the matrix's axes, if there was one */
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 4; k++)
                m[4 * i + k] = given[4 * i + k] * (k < 3 ? reading->axes[4 * k] : 1);
        for (int i = 0; i < 3; i++) {
            turned[4 * i + 3] = 0;
            for (int k = 0; k < 3; k++) {
                turned[4 * i + k] = m[4 * k + i];
                turned[4 * i + 3] -= m[4 * k + i] * m[4 * k + 3];
            }
        }
    }
    if (reading->w != CLN_W_IS_RIGHT)
        move_w(reading->w, turned);
    for (int i = 0; i < 3; i++) {
        out[4 * i + 3] = turned[4 * i + 3];
        for (int k = 0; k < 3; k++) {
            out[4 * i + k] = 0;
            for (int j = 0; j < 3; j++)
                out[4 * i + k] += turned[4 * i + j] * reading->axes[3 * j + k];
        }
    }
}
