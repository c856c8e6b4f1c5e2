/* needs: lens */
/* A camera with a lens (lens.h): pixel position to direction and back, twin of host/scene/camera.c
 * (host/scene/scene.h has the model). Kernels use it through space.h, which has the frame. */

/* Turns the vector (x, y, z) out of the camera's frame. */
HELPER float3 camera_turn(cln_device_camera c, float x, float y, float z)
{
    return (float3)(c.c2w[0] * x + c.c2w[1] * y + c.c2w[2] * z,
                    c.c2w[4] * x + c.c2w[5] * y + c.c2w[6] * z,
                    c.c2w[8] * x + c.c2w[9] * y + c.c2w[10] * z);
}

HELPER float3 camera_origin(cln_device_camera c)
{
    return (float3)(c.c2w[3], c.c2w[7], c.c2w[11]);
}

/* Ray through pixel position (u, v): where it begins, and how far that is from the camera; unit
 * direction, and 0. False if the lens has none there, or if it does not
 * cross the plane where rays begin. */
HELPER bool camera_ray(cln_device_camera c, float u, float v, float4 *origin, float4 *direction)
{
    const float2 place = (float2)((u - c.cx) / c.fx, (v - c.cy) / c.fy);
    float3 p;

    if (IS_PARALLEL(c)) {
        *origin = (float4)(camera_origin(c) + camera_turn(c, place.x, place.y, 0.0f), 0.0f);
        *direction = (float4)(camera_turn(c, 0.0f, 0.0f, 1.0f), 0.0f);
        return true;
    }
    const bool found = lens_undistort(c, place, &p);
    const float scale = rsqrt(p.x * p.x + p.y * p.y + p.z * p.z);

    *origin = (float4)(camera_origin(c), 0.0f);
    *direction = (float4)(camera_turn(c, p.x, p.y, p.z) * scale, 0.0f);
    if (c.start > 0.0f) {
        if (!(p.z > 0.0f))
            return false;
        origin->xyz += camera_turn(c, c.start * (p.x / p.z - c.start_x),
                                   c.start * (p.y / p.z - c.start_y), 0.0f);
        origin->w = c.start / (p.z * scale);
    }
    return found;
}

/* Pixel position of a point; false if it is outside the lens model's domain or the image. */
HELPER bool camera_project(cln_device_camera c, float3 point, float2 *pixel)
{
    const float3 q = point - camera_origin(c);
    const float z = c.c2w[2] * q.x + c.c2w[6] * q.y + c.c2w[10] * q.z + c.start;
    float2 p = (float2)(c.c2w[0] * q.x + c.c2w[4] * q.y + c.c2w[8] * q.z + c.start * c.start_x,
                        c.c2w[1] * q.x + c.c2w[5] * q.y + c.c2w[9] * q.z + c.start * c.start_y);

    if (IS_PARALLEL(c) ? !(z > 0.0f) : !lens_distort(c, (float3)(p, z), &p))
        return false;
    *pixel = (float2)(MAD(c.fx, p.x, c.cx), MAD(c.fy, p.y, c.cy));
    return pixel->x >= 0.0f && pixel->y >= 0.0f && pixel->x < (float)c.width &&
           pixel->y < (float)c.height;
}
