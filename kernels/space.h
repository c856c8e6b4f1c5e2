/* needs: camera */
/* The spaces of kernels and the maps between them. Twin: host/scene/space.h.
 *
 *   scene   space of the cameras; pixels see it through camera.h
 *   cube    [-1, 1]^3, which the octree divides; rays walk in it, and t is measured in it
 *   leaf    [-1, 1]^3 of a leaf's box, its network's input
 *
 * The host moves and scales the scene into the cube once, cameras included: a ray of the scene is
 * straight in the cube, and t is a length but for a factor, which the host undoes. A map that bends
 * space (forward-facing scenes, an unbounded contraction) would join here: pixel_ray() would turn
 * the scene's ray into the cube's, point_pixel() the cube's point into the scene's, and ray_depth()
 * the cube's t into a depth. */

/* ---- scene and cube ---- */

/* The ray through pixel position (u, v), for ray_depth(): where it begins, and its distance from
 * the camera there; unit direction, and factor of depths along the axis. False if it has none, or
 * none that meets the cube; the direction is then any. */
HELPER bool pixel_ray(cln_device_camera c, float u, float v, float4 *o, float4 *d)
{
    return camera_ray(c, u, v, o, d);
}

/* The pixel position of a point of the cube; false if the camera does not see it. */
HELPER bool point_pixel(cln_device_camera c, float3 point, float2 *pixel)
{
    return camera_project(c, point, pixel);
}

/* Depth at t of a ray, along its camera's axis or itself. */
HELPER float ray_depth(float t, float4 o, float4 d, bool axis)
{
    return (t + o.w) * (axis ? d.w : 1.0f);
}

/* ---- cube and leaf; box: min x, y, z, side ---- */

HELPER float4 leaf_local(float4 p, float4 box)
{
    const float scale = 2.0f / box.w;

    return (p - box) * scale - 1.0f;
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
