/* The only header that host and kernels share: constants, and structs of fixed-width members. The
 * host includes it as C; every kernel program begins with it. No functions. */
#ifndef CLN_DEVICE_ABI_H
#define CLN_DEVICE_ABI_H

#ifdef __OPENCL_C_VERSION__
typedef int cln_i32;
typedef uint cln_u32;
typedef float cln_f32;
#else
#include <stdint.h>
typedef int32_t cln_i32;
typedef uint32_t cln_u32;
typedef float cln_f32;
#endif

/* The octree's deepest level; the root's is 0. One more costs eight times the map (at 8: 64 MiB).
 * CLN_LEVELS of cl_nascent.h is one more. */
#define CLN_MAX_LEVEL 8

/* Chords up to this length, in normalised units, are skipped (method.md 3). */
#define CLN_MIN_CHORD 1e-5f
/* Most lines of a ray in a shell space (method.md 3.3), and rows that it has on the device: the
 * scene's ray, then its lines. */
#define CLN_SPACE_LINES 7
#define CLN_LINE_ROWS   8
/* Clamp of sigma * delta: exp(-80) is close to the smallest normal float (method.md 9). */
#define CLN_MAX_OPTICAL_DEPTH 80.0f

/* A target's alpha where a photo does not tell it, and below what it is that: pixels of several
 * rays move it by up to 1. */
#define CLN_ALPHA_UNTOLD (-4.0f)
#define CLN_ALPHA_TOLD   (-1.0f)

/* Lens models (scene/lens.h), as COLMAP calls them. */
typedef enum cln_lens {
    CLN_LENS_OPENCV,
    CLN_LENS_FULL_OPENCV,
    CLN_LENS_OPENCV_FISHEYE,
    CLN_LENS_THIN_PRISM_FISHEYE,
    CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
    CLN_LENS_FOV,
    CLN_LENS_DIVISION,
    CLN_LENS_EUCM,
    CLN_LENS_EQUIRECTANGULAR,
    CLN_LENSES /* in a set of lenses, 1 << this: parallel rays (cln_camera) */
} cln_lens;

#define CLN_LENS_PARAMS 12 /* the most that a model has */

/* Rays of cameras further than this from the cube's centre, in normalised units, begin at a
 * `start`, but in forward and shell spaces. */
#define CLN_FAR 32.0f

/* A view's camera in normalised space (scene/scene.h has the model and the units). Rays begin where
 * they cross the plane at depth `start` of the camera's frame, which is 0 or, for a far camera, in
 * front of the cube: positions in float32 relative to a far point would be coarse. c2w's origin is
 * the point (start_x, start_y, 1) * start of the frame. */
typedef struct cln_device_camera {
    cln_f32 c2w[12]; /* 3x4 row-major, origin normalised */
    cln_f32 start, start_x, start_y;
    cln_i32 parallel; /* rays are: from the place in the plane z = 0 of the camera, forward */
    cln_f32 fx, fy, cx, cy;
    cln_i32 width, height;
    cln_i32 lens;               /* cln_lens; what follows is the lens model's */
    cln_f32 limit;              /* cln_lens_limit */
    cln_f32 k[CLN_LENS_PARAMS]; /* its parameters */
} cln_device_camera;

/* The pixel of a ray. spot: if the stage-1 method is by_view, the index of its view in the batch,
 * and the ray goes through the pixel's centre; else CLN_SPOT. */
typedef struct cln_pixel {
    cln_u32 view, x, y, spot;
} cln_pixel;

/* Where in its pixel a ray goes, and with how many others, whose mean is the pixel: x, y: offset
 * from the centre in 1/4096 pixels, -2048 to 2047; the ray is number `index` of `count`, 1 to 16,
 * which follow each other in the batch. 0: through the centre, alone. */
#define CLN_SPOT(x, y, index, count)                                                \
    (((cln_u32)(x)&0xfffu) | ((cln_u32)(y)&0xfffu) << 12 | (cln_u32)(index) << 24 | \
     ((cln_u32)(count)-1u) << 28)
#define CLN_SPOT_X(spot)     ((cln_i32)((spot) << 20) >> 20)
#define CLN_SPOT_Y(spot)     ((cln_i32)((spot) << 8) >> 20)
#define CLN_SPOT_INDEX(spot) ((spot) >> 24 & 0xfu)
#define CLN_SPOT_COUNT(spot) (((spot) >> 28) + 1u)

/* The interval of a ray in an ACTIVE leaf. mass: stage 1's optical depth, or with CLN_CDF_WEIGHT
 * its alpha. count: CLN_INTERVAL_COUNT. */
typedef struct cln_interval {
    cln_f32 t_in, t_out, mass;
    cln_i32 slot;
    cln_u32 count;
} cln_interval;

/* Holds the number of the interval's stage-2 samples and its leaf's level. */
#define CLN_INTERVAL_COUNT(samples, level) ((samples) | (cln_u32)(level) << 24)
#define CLN_INTERVAL_SAMPLES(count)        ((count)&0xFFFFFFu)
#define CLN_INTERVAL_LEVEL(count)          ((count) >> 24)

/* A run of grouped samples that a work-group takes through a leaf's network. */
typedef struct cln_slice {
    cln_i32 slot;
    cln_u32 start, count;
    cln_u32 used; /* number of slices in the list that are not empty */
} cln_slice;

/* A sample: its place on a ray, and its leaf. */
typedef struct cln_sample {
    cln_f32 t, delta;
    cln_u32 ray;
    cln_i32 slot;
} cln_sample;

/* Results of a ray. In training loss and square_error are its pixel's, and share is 1 over the rays
 * that the pixel has in the batch; below 0 if the ray was shot at a sparse point. */
typedef struct cln_ray_result {
    cln_f32 r, g, b, depth;
    cln_f32 opacity, loss, square_error, share;
} cln_ray_result;

/* Kinds of a picture's depth, along the ray: what half of the opacity lies before, or the mean. */
#define CLN_DEPTH_MEDIAN 0u
#define CLN_DEPTH_MEAN   1u

/* `number` of a ray's random values (base/rng.h): the interval's number for its samples, plus this
 * for its roulette. */
#define CLN_DRAW_ROULETTE 0x800000u

/* Entries of the octree map. Cells of a leaf: its slot and level. */
#define CLN_MAP_LEVEL_BITS        4
#define CLN_MAP_LEAF(slot, level) (((slot) + 1) << CLN_MAP_LEVEL_BITS | (level))
#define CLN_MAP_SLOT(entry)       (((entry) >> CLN_MAP_LEVEL_BITS) - 1)
#define CLN_MAP_LEVEL(entry)      ((entry) & ((1 << CLN_MAP_LEVEL_BITS) - 1))

/* Empty cells: the sign bit, and a box of empty cells around them, its lowest and highest x, y, z
 * of CLN_BOX_LEVEL bits each, in cells of that level if the map is deeper (CLN_MAP_UNIT). Empty
 * nodes below that level: CLN_MAP_NODE, with the level in the same bits as a leaf's. */
#define CLN_BOX_LEVEL       5
#define CLN_MAP_EMPTY       0x80000000u
#define CLN_MAP_NODE(level) (0xC0000000u | (cln_u32)(level))
#define CLN_MAP_UNIT(depth) \
    ((depth) > CLN_BOX_LEVEL ? (depth)-CLN_BOX_LEVEL : 0) /* log2 of cells */
#define CLN_MAP_IS_BOX(entry) ((entry) < -0x40000000)     /* of a signed entry */
#define CLN_MAP_BOX(corner, high)                                          \
    ((cln_u32)((corner)[0] - (high)) << CLN_BOX_LEVEL * (3 * (high)) |     \
     (cln_u32)((corner)[1] - (high)) << CLN_BOX_LEVEL * (3 * (high) + 1) | \
     (cln_u32)((corner)[2] - (high)) << CLN_BOX_LEVEL * (3 * (high) + 2))
#define CLN_MAP_SIDE(entry, side) ((entry) >> CLN_BOX_LEVEL * (side) & ((1 << CLN_BOX_LEVEL) - 1))
#define CLN_MAP_LOW(entry, axis)  CLN_MAP_SIDE(entry, axis)
#define CLN_MAP_HIGH(entry, axis) (CLN_MAP_SIDE(entry, 3 + (axis)) + 1)

/* Lists of projected samples of a view and a level (splat.cl): coarse pixels of coarse_x x coarse_y
 * pixels, `row` of them in a row of the image. longest: length of the longest list, if lists are
 * padded. A sample at t stands for a piece of the ray of length max(cell, spread / t^2) (method.md
 * 5). */
typedef struct cln_grid {
    cln_u32 first, coarse_x, coarse_y, row, longest;
    cln_f32 cell, spread;
} cln_grid;

/* Samples of a slice that roulette.cl decides on together. */
#define CLN_ROULETTE_SEGMENT 256
/* Slices over which a work-group sums the decoder's gradient (kernels/decoder.cl). */
#define CLN_DECODER_EACH 16u

/* Rays of a work-item of the sampling kernels, with vectors of vw floats. */
#define CLN_RAYS_EACH(vw) ((vw) == 1 ? 1 : 64)

#ifndef __OPENCL_C_VERSION__
_Static_assert(6 * CLN_BOX_LEVEL < 31, "a box of empty cells fits beside the signs");
_Static_assert(CLN_MAX_LEVEL < 1 << CLN_MAP_LEVEL_BITS, "a level fits a leaf's entry");
_Static_assert(3 * CLN_MAX_LEVEL + 1 + CLN_MAP_LEVEL_BITS < 32, "slot + 1 fits beside the level");
_Static_assert(CLN_MAX_LEVEL < 1 << 8, "a level fits above an interval's samples");
_Static_assert(sizeof(cln_device_camera) == 144, "layout shared with kernels");
_Static_assert(sizeof(cln_pixel) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_interval) == 20, "layout shared with kernels");
_Static_assert(sizeof(cln_grid) == 28, "layout shared with kernels");
_Static_assert(sizeof(cln_slice) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_sample) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_ray_result) == 32, "layout shared with kernels");
#endif

#endif
