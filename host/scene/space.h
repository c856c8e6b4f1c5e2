/* Scene space and the cube: the one place that maps between them.
 *
 *   scene   the dataset's own frame and units: cameras, --bbox, exported boxes, written depth
 *   cube    [-1, 1]^3, which the octree divides: everything on the device, and everything in a tree
 *
 * A plain space moves and scales:
 *   point       cube = (scene - centre) / half           scene = centre + half * cube
 *   direction   unit vectors, the same in both
 *   distance    (also t of a ray, and depth) scene = half * cube
 *   density     (per unit of distance) scene = cube / half
 *
 * A forward space (normalised device coordinates, method.md 3.2) holds what cameras see that all
 * look one way, from a near plane to infinity. With q = axes (scene - centre) / half, "camera
 * units":
 *   point       cube = (scale_x q_x / q_z, scale_y q_y / q_z, 1 - 2 / q_z)
 * so q_z is 1 at the near plane, the cube's face z = -1, and infinite at z = 1. Straight lines stay
 * straight, lengths and angles change. Rays of the cube begin at the near plane, or where the
 * camera is if that is beyond. Depths are lengths in camera units, which the device returns.
 *
 * A shell space (method.md 3.3) is a plain one with all that lies beyond its cube around it. With u
 * = (scene - centre) / half and m = max |u_a|:
 *   core    cube = u / 2 where m <= 1: the root's middle [-1/2, 1/2]^3
 *   face    elsewhere, of the axis a and the sign s for which s u_a = m, w = 1 / m:
 *           cube_a = s (1 - w / 2), in (1/2, 1];  the others cube_b = u_b w / 2, in [-1/2, 1/2]
 * so infinity is at |cube_a| = 1; the root's edges and corners, where two |cube_a| are above 1/2,
 * hold nothing. Each of these seven pieces is convex in the scene, and in each straight lines stay
 * straight: a ray is at most CLN_SPACE_LINES lines. Depths are lengths of u, which the device
 * returns.
 *
 * Nothing else does this arithmetic: a space of another shape is added here and in the twin,
 * kernels/space.h. No function fails. */
#ifndef CLN_SPACE_H
#define CLN_SPACE_H

#include <stdbool.h>
#include "device_abi.h"

/* The scene's cube: centre + [-half, half]^3 in scene units, half > 0; or with `forward`, the mean
 * camera at `centre`, its axes (right, down, forward: the rows of a rotation), the near plane's
 * distance `half` from it, and the inverse tangents of the cube's sides. shell: with what lies
 * beyond the cube; not with forward. */
typedef struct cln_space {
    double centre[3], half;
    bool forward;
    double axes[9], scale[2];
    bool shell;
} cln_space;

/* Centre 0, half 1: the scene is in the cube already. */
extern const cln_space cln_space_unit;

/* Forward: a point that is not before the mean camera is far outside the cube; and points nearer
 * than 1e-6 to the face at infinity come back at 10^6 near planes. */
void cln_space_point_to_cube(const cln_space *space, const double scene[3], double cube[3]);
void cln_space_point_to_scene(const cln_space *space, const double cube[3], double scene[3]);

/* A ray of the scene (unit direction) as a ray of the cube (unit direction), whose t is in cube
 * units. Forward: one that does not look forward meets nothing. Shell: as a ray of u instead, where
 * the scene's cube is [-1, 1]^3. */
void cln_space_ray_to_cube(const cln_space *space, const double origin[3],
                           const double direction[3], double cube_origin[3],
                           double cube_direction[3]);

/* A part of a ray: from begin to end, its point at t is origin + t direction. t is the length of
 * the path in the cube. From one part to the next it may jump over an edge that holds nothing. */
typedef struct cln_space_line {
    double origin[3], direction[3], begin, end;
} cln_space_line;

/* The lines of a ray of the scene, in order, from a distance `near` (of u) on; returns how many, at
 * most CLN_SPACE_LINES. For shell spaces only. */
int cln_space_lines(const cln_space *space, const double origin[3], const double direction[3],
                    double near, cln_space_line lines[CLN_SPACE_LINES]);

/* The point of the cube at a depth of the device along a ray of the scene. */
void cln_space_depth_to_cube(const cln_space *space, const double origin[3],
                             const double direction[3], double depth, double cube[3]);

/* A unit direction of the scene at a point of the scene, as a unit direction of the cube; and a
 * normal at a point of the cube, as one of the scene. */
void cln_space_direction_to_cube(const cln_space *space, const double scene[3],
                                 const double direction[3], double cube[3]);
void cln_space_normal_to_scene(const cln_space *space, const double cube[3], const float normal[3],
                               float scene[3]);

/* A camera's pose, 3x4 row-major [R|o], for the device: in the cube, or in camera units. */
void cln_space_pose_to_cube(const cln_space *space, const double c2w[12], float out[12]);

/* Converts a distance of the cube, or a depth of the device, to scene units; forward: depths
 * only. */
double cln_space_distance_to_scene(const cln_space *space, double cube);
/* The same in float arithmetic, for the depth of pictures. */
float cln_space_depth_to_scene(const cln_space *space, float cube);

/* Converts a density per unit of distance in the cube to one per scene unit. Forward: in the
 * direction of the scene (unit) at the point of the scene; both may be NULL otherwise. */
double cln_space_density_to_scene(const cln_space *space, const double scene[3],
                                  const double direction[3], double cube);

/* A node's box {x, y, z, side} (model/octree.h) as its lowest and highest corner in the scene.
 * Faces that two nodes share get the same numbers, whatever their levels: positions in the cube are
 * dyadic. Not for a forward space, whose nodes are not boxes in the scene. */
void cln_space_box_to_scene(const cln_space *space, const float cube[4], double low[3],
                            double high[3]);

/* A box of the scene, x0, y0, z0, x1, y1, z1, as six half-spaces of the cube: points with
 * plane[0..2] . p + plane[3] >= 0 for all six are those in the box. Straight lines stay straight,
 * so this holds in a forward space, too. */
void cln_space_box_to_planes(const cln_space *space, const double box[6], float planes[6][4]);

/* One half-space, of unit normal in the cube: n p + d >= 0 in the scene. */
void cln_space_plane_to_cube(const cln_space *space, const double scene[4], float cube[4]);

/* A point of the cube in a forward space's camera units, over its q_z: (q_x / q_z, q_y / q_z, 1)
 * and 1 / q_z, which is 0 at infinity. */
void cln_space_point_to_view(const cln_space *space, const double cube[3], double out[4]);

/* Maps a point of a shell space's cube to u. */
void cln_space_point_to_u(const double cube[3], double u[3]);

/* Does the cube hold a point of the scene, faces included? Does the scene's ray
 * origin + t direction, t >= 0, pass through it? */
bool cln_space_holds(const cln_space *space, const double scene[3]);
bool cln_space_met_by(const cln_space *space, const double origin[3], const double direction[3]);

/* The scene's cube alone: of a shell space, the plain space of its core; else a copy. */
cln_space cln_space_core(const cln_space *space);

/* Its name, as for --space. */
const char *cln_space_name(const cln_space *space);

/* Are they the same to a millionth of b's half? */
bool cln_space_equal(const cln_space *a, const cln_space *b);

#endif
