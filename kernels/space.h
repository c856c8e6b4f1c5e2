/* needs: camera shell */
/* The spaces of kernels and the maps between them. Twin: host/scene/space.h.
 *
 *   scene   space of the cameras; pixels see it through camera.h
 *   cube    [-1, 1]^3, which the octree divides; rays walk in it, and t is measured in it
 *   leaf    [-1, 1]^3 of a leaf's box, its network's input
 *
 * The host moves and scales the scene into the cube once, cameras included: a ray of the scene is
 * straight in the cube, and t is a length up to a factor, which the host undoes.
 *
 * NDC 1: a forward space (method.md 3.2). The cameras are in camera units, where the near plane is
 * at z = 1, and pixel_ray() and point_pixel() bend space: (x, y, z) becomes
 * (NDC_X x / z, NDC_Y y / z, 1 - 2 / z). Straight lines stay straight. ray_depth() returns camera
 * units.
 *
 * SHELL 1: a shell space, by shell.h. The cameras are in u, and ray_depth() returns lengths of u.
 *
 * BEGINS 1: rays begin at a distance BEGIN from their camera, in u or the cube. */
#ifndef NDC
#define NDC 0
#endif
#ifndef NDC_X
#define NDC_X 1.0f
#define NDC_Y 1.0f
#endif

/* ---- scene and cube ---- */

#if NDC
#define LEAST_FORWARD     1e-6f
#define LEAST_TO_INFINITY 2e-6f
#endif

/* Unit direction in the scene, in its own axes or a forward space's, of a ray of the cube: a
 * network's colour depends on it. box: of the leaf where the ray is. */
HELPER float3 view_direction(float4 o, float4 d, float4 box)
{
#if SHELL
    const piece f = piece_of(box.xyz + 0.5f * box.w, 0.5f);

    if (f.axis == CORE)
        return d.xyz;
    /* the map's inverse has this derivative, times a positive factor, all along the line */
    const float ahead = along_axis(d.xyz, f.axis);
    const float w = 2.0f * (1.0f - f.sign * along_axis(o.xyz, f.axis));
    const float3 v =
        with_axis(MAD((float3)(w), d.xyz, 2.0f * f.sign * ahead * o.xyz), f.axis, ahead);

    return v * rsqrt(dot(v, v));
#elif NDC
    /* at the face z = 1, which is infinitely far, a ray's place is its direction */
    const float2 v = MAD((float2)((1.0f - o.z) / fmax(d.z, LEAST_FORWARD)), d.xy, o.xy) *
                     (float2)(1.0f / NDC_X, 1.0f / NDC_Y);

    return (float3)(v, 1.0f) * rsqrt(v.x * v.x + v.y * v.y + 1.0f);
#else
    return d.xyz;
#endif
}

/* The ray through pixel position (u, v), for ray_depth(): where it begins, and its distance from
 * the camera there; unit direction, and 0. False if there is none, or it cannot meet the cube; the
 * direction is then arbitrary. */
HELPER bool pixel_ray(cln_device_camera c, float u, float v, float4 *o, float4 *d)
{
#if NDC
    float4 p, q;
    const bool found = camera_ray(c, u, v, &p, &q) && q.z > LEAST_FORWARD;
    const float z = fmax(p.z, 1.0f), far = (z - p.z) / q.z;
    const float3 along = (float3)(NDC_X * (q.x * p.z - p.x * q.z), NDC_Y * (q.y * p.z - p.y * q.z),
                                  2.0f * q.z);

    if (!found) {
        *o = (float4)(0.0f, 0.0f, -1.0f, 0.0f);
        *d = (float4)(0.0f, 0.0f, 1.0f, 0.0f);
        return false;
    }
    *o = (float4)(NDC_X * MAD(far, q.x, p.x) / z, NDC_Y * MAD(far, q.y, p.y) / z, 1.0f - 2.0f / z,
                  far);
    *d = (float4)(along * rsqrt(dot(along, along)), 0.0f);
    return true;
#else
    const bool found = camera_ray(c, u, v, o, d);

#if BEGINS && !SHELL
    const float to_begin = fmax(BEGIN - o->w, 0.0f);

    *o = MAD((float4)(to_begin), (float4)(d->xyz, 1.0f), *o);
#endif
    return found;
#endif
}

/* The pixel position of a point of the cube; false if the camera does not see it. */
HELPER bool point_pixel(cln_device_camera c, float3 point, float2 *pixel)
{
#if NDC
    const float z = 2.0f / fmax(1.0f - point.z, LEAST_TO_INFINITY);

    point = (float3)(point.x * (z / NDC_X), point.y * (z / NDC_Y), z);
#endif
#if SHELL
    point = out_of_piece(piece_of(point, 0.5f), point);
#endif
    return camera_project(c, point, pixel);
}

/* Depth at t of ray r, along the ray; what is before the ray's begin counts by `share`. */
HELPER float ray_depth(float t, const __global float4 *ray_o, const __global float4 *ray_d, uint r,
                       float share)
{
#if SHELL
    const uint row = line_row(ray_o, r, t);
    const float3 p = MAD((float3)(t), ray_d[row].xyz, ray_o[row].xyz);
    const float4 o = ray_o[r * CLN_LINE_ROWS] * share, d = ray_d[r * CLN_LINE_ROWS];

    t = share * dot(out_of_piece(piece_of(p, 0.5f), p) - ray_o[r * CLN_LINE_ROWS].xyz, d.xyz);
#else
    const float4 o = ray_o[r] * share;
#endif
#if NDC
    const float4 d = ray_d[r];
    const float z = 2.0f / fmax(1.0f - MAD(t, d.z, o.z), LEAST_TO_INFINITY);

    t = (z - 2.0f / (1.0f - o.z)) / view_direction(o, d, (float4)(0.0f)).z;
#endif
    return t + o.w;
}

/* ---- cube and leaf; box: min x, y, z, side ---- */

HELPER float leaf_scale(float4 box)
{
    return 2.0f / box.w;
}

HELPER float4 leaf_scaled(float4 p, float4 box, float scale)
{
    return (p - box) * scale - 1.0f;
}

HELPER float4 leaf_local(float4 p, float4 box)
{
    return leaf_scaled(p, box, leaf_scale(box));
}

HELPER int leaf_level(float4 box)
{
    return (int)(1.5f - log2(box.w));
}

/* Centre of cell (z n1 + y) n1 + x of a leaf, in the cube. */
HELPER float3 cell_centre(float4 box, uint cell, uint n1)
{
    const float3 at =
        (float3)((float)(cell % n1), (float)(cell / n1 % n1), (float)(cell / (n1 * n1)));

    return box.xyz + (at + 0.5f) * (box.w / (float)n1);
}

/* What a sample's place and direction come from. */
typedef struct sample_source {
    const __global cln_sample *samples;   /* [sample] */
    const __global float4 *ray_o, *ray_d; /* [ray], [row] in a shell space */
} sample_source;
