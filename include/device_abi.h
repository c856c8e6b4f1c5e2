/* The one header that host and kernels share: constants and structs of fixed-width members. The host
 * includes it as C, the kernels get it as the first lines of every program. No functions. */
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

/* Chords shorter than this, in units of the normalised cube, are left out (method.md 7). */
#define CLN_MIN_CHORD 1e-5f
/* sigma * delta is clamped here: exp(-80) is the last normal float's neighbourhood (method.md 9). */
#define CLN_MAX_OPTICAL_DEPTH 80.0f

/* A view's camera in normalised space (scene/scene.h has the model and the units). */
typedef struct cln_device_camera {
    cln_f32 c2w[12]; /* 3x4 row-major, origin normalised */
    cln_f32 fx, fy, cx, cy;
    cln_f32 k1, k2, p1, p2;
    cln_i32 width, height;
    cln_i32 pad[2];
} cln_device_camera;

/* One ray asked for: which pixel of which view. The ray goes through its centre. */
typedef struct cln_pixel {
    cln_u32 view, x, y, pad;
} cln_pixel;

/* The interval of a ray in an ACTIVE leaf. mass: by stage 1, its optical depth, or its alpha with
 * CLN_CDF_WEIGHT. count: stage-2 samples in it | the leaf's level << 24. */
typedef struct cln_interval {
    cln_f32 t_in, t_out, mass;
    cln_i32 slot;
    cln_u32 count;
} cln_interval;

/* A run of grouped samples that one work-group takes through one leaf's network. */
typedef struct cln_slice {
    cln_i32 slot;
    cln_u32 start, count;
    cln_u32 used; /* slices that are not empty, of the whole list */
} cln_slice;

/* What the network needs to know of a sample: where, in which leaf, on which ray. */
typedef struct cln_sample {
    cln_f32 t, delta;
    cln_u32 ray;
    cln_i32 slot;
} cln_sample;

/* What a ray came to. */
typedef struct cln_ray_result {
    cln_f32 r, g, b, depth;
    cln_f32 opacity, loss, square_error, pad;
} cln_ray_result;

/* Numbers of a ray's random values (base/rng.h): those of its samples go by the number of the interval. */
#define CLN_DRAW_ROULETTE 0x800000u /* on, by the interval's number */

/* Entries of the octree map that stand for empty cells: the sign bit, and a box of cells around: five bits each for
 * its lowest x, y, z and its highest. */
#define CLN_MAP_EMPTY 0x80000000u
#define CLN_MAP_BOX(corner, high)                           \
    ((cln_u32)((corner)[0] - (high)) << 15 * (high) |       \
     (cln_u32)((corner)[1] - (high)) << (15 * (high) + 5) | \
     (cln_u32)((corner)[2] - (high)) << (15 * (high) + 10))
#define CLN_MAP_LOW(entry, axis)  ((entry) >> 5 * (axis)&31)
#define CLN_MAP_HIGH(entry, axis) (((entry) >> (15 + 5 * (axis)) & 31) + 1)

/* Samples of a slice that roulette.cl decides upon together. */
#define CLN_ROULETTE_SEGMENT 256

/* Rays of a work-item of the sampling kernels, with vectors of vw floats. */
#define CLN_RAYS_EACH(vw) ((vw) == 1 ? 1 : 64)

#ifndef __OPENCL_C_VERSION__
_Static_assert(sizeof(cln_device_camera) == 96, "layout shared with kernels");
_Static_assert(sizeof(cln_pixel) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_interval) == 20, "layout shared with kernels");
_Static_assert(sizeof(cln_slice) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_sample) == 16, "layout shared with kernels");
_Static_assert(sizeof(cln_ray_result) == 32, "layout shared with kernels");
#endif

#endif
