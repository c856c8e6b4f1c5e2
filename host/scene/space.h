/* Scene space and the cube: the one place that maps between them.
 *
 *   scene   the dataset's own frame and units: cameras, --bbox, exported boxes, written depth
 *   cube    [-1, 1]^3, which the octree divides: everything on the device, and everything in a tree
 *
 *   point       cube = (scene - centre) / half           scene = centre + half * cube
 *   direction   unit vectors, the same in both
 *   distance    (also t of a ray, and depth) scene = half * cube
 *   density     (per unit of distance) scene = cube / half
 *
 * Nothing else does this arithmetic: a space of another shape (forward-facing, unbounded) joins
 * here, and in kernels/space.h, the twin. No function fails. */
#ifndef CLN_SPACE_H
#define CLN_SPACE_H

#include <stdbool.h>

/* The scene's cube: centre + [-half, half]^3 in scene units, half > 0. */
typedef struct cln_space {
    double centre[3], half;
} cln_space;

/* Centre 0, half 1: the scene is in the cube already. */
extern const cln_space cln_space_unit;

void cln_space_point_to_cube(const cln_space *space, const double scene[3], double cube[3]);
void cln_space_point_to_scene(const cln_space *space, const double cube[3], double scene[3]);

/* A ray of the scene (unit direction) as a ray of the cube, whose t is in cube units. */
void cln_space_ray_to_cube(const cln_space *space, const double origin[3],
                           const double direction[3], double cube_origin[3],
                           double cube_direction[3]);

/* A camera's pose, 3x4 row-major [R|o], for the device. */
void cln_space_pose_to_cube(const cln_space *space, const double c2w[12], float out[12]);

double cln_space_distance_to_scene(const cln_space *space, double cube);
/* The same in float arithmetic, for the depth of pictures. */
float cln_space_depth_to_scene(const cln_space *space, float cube);

/* A density per unit of distance in the cube, per scene unit. */
double cln_space_density_to_scene(const cln_space *space, double cube);

/* A node's box {x, y, z, side} (model/octree.h) as its lowest and highest corner. Faces that two
 * nodes share get the same numbers, whatever their levels: positions in the cube are dyadic. */
void cln_space_box_to_scene(const cln_space *space, const float cube[4], float low[3],
                            float high[3]);

/* Does the cube hold a point of the scene, faces included? Does the scene's ray
 * origin + t direction, t >= 0, pass through it? */
bool cln_space_holds(const cln_space *space, const double scene[3]);
bool cln_space_met_by(const cln_space *space, const double origin[3], const double direction[3]);

/* Are they the same to a millionth of b's half? */
bool cln_space_equal(const cln_space *a, const cln_space *b);

#endif
