/* needs: lens */
/* A camera behind a lens (lens.h): pixel position to direction and back, twin of
 * host/scene/camera.c (host/scene/scene.h has the model). Its frame is space.h's, which is what
 * kernels go through. */

HELPER float3 camera_origin(cln_device_camera c)
{
    return (float3)(c.c2w[3], c.c2w[7], c.c2w[11]);
}

/* Unit direction through pixel position (u, v); w: its z in the camera's frame. False if the lens
 * has none there. */
HELPER bool camera_direction(cln_device_camera c, float u, float v, float4 *direction)
{
    float3 p;
    const bool found = lens_undistort(c, (float2)((u - c.cx) / c.fx, (v - c.cy) / c.fy), &p);
    const float3 d = (float3)(c.c2w[0] * p.x + c.c2w[1] * p.y + c.c2w[2] * p.z,
                              c.c2w[4] * p.x + c.c2w[5] * p.y + c.c2w[6] * p.z,
                              c.c2w[8] * p.x + c.c2w[9] * p.y + c.c2w[10] * p.z);
    const float scale = rsqrt(p.x * p.x + p.y * p.y + p.z * p.z);

    *direction = (float4)(d * scale, p.z * scale);
    return found;
}

/* Pixel position of a point; false if it is outside the lens model's domain or the image. */
HELPER bool camera_project(cln_device_camera c, float3 point, float2 *pixel)
{
    const float3 q = point - camera_origin(c);
    const float z = c.c2w[2] * q.x + c.c2w[6] * q.y + c.c2w[10] * q.z;
    float2 p = (float2)(c.c2w[0] * q.x + c.c2w[4] * q.y + c.c2w[8] * q.z,
                        c.c2w[1] * q.x + c.c2w[5] * q.y + c.c2w[9] * q.z);

    if (!lens_distort(c, (float3)(p, z), &p))
        return false;
    *pixel = (float2)(MAD(c.fx, p.x, c.cx), MAD(c.fy, p.y, c.cy));
    return pixel->x >= 0.0f && pixel->y >= 0.0f && pixel->x < (float)c.width &&
           pixel->y < (float)c.height;
}
