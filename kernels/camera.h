/* Camera maths on the device: pixel position -> direction and back, the twin of host/scene/camera.c
 * (host/scene/scene.h has the model). Used by rays.cl, splat.cl and stats.cl.
 *
 * DISTORTION  0 | 1: OPENCV distortion; without it none of its code is built
 */
#ifndef CLN_CAMERA_CL
#define CLN_CAMERA_CL

#ifndef DISTORTION
#define DISTORTION 1
#endif

#if DISTORTION
/* (a, b) with distort(a, b) = target. Newton's method from the distorted point; a step where the model
 * stops being one-to-one (determinant near 0) ends it. */
HELPER float2 undistort(float2 target, float4 k)
{
    float2 p = target;

    for (int i = 0; i < 10; i++) {
        const float a = p.x, b = p.y, r2 = a * a + b * b;
        const float radial = 1.0f + r2 * (k.x + k.y * r2), slope = k.x + 2.0f * k.y * r2;
        const float2 f = (float2)(a * radial + 2.0f * k.z * a * b + k.w * (r2 + 2.0f * a * a),
                                  b * radial + k.z * (r2 + 2.0f * b * b) + 2.0f * k.w * a * b) -
                         target;
        const float fa = radial + 2.0f * a * a * slope + 2.0f * k.z * b + 6.0f * k.w * a;
        const float fb = 2.0f * a * b * slope + 2.0f * k.z * a + 2.0f * k.w * b;
        const float gb = radial + 2.0f * b * b * slope + 6.0f * k.z * b + 2.0f * k.w * a;
        const float det = fa * gb - fb * fb;

        if (fabs(det) < 1e-6f)
            break;
        p -= (float2)(gb * f.x - fb * f.y, fa * f.y - fb * f.x) / det;
    }
    return p;
}
#endif

/* Unit direction through pixel position (u, v); w: its z in the camera's frame. */
HELPER float4 camera_direction(cln_device_camera c, float u, float v)
{
    float2 p = (float2)((u - c.cx) / c.fx, (v - c.cy) / c.fy);

#if DISTORTION
    p = undistort(p, (float4)(c.k1, c.k2, c.p1, c.p2));
#endif
    const float3 d = (float3)(c.c2w[0] * p.x + c.c2w[1] * p.y + c.c2w[2],
                              c.c2w[4] * p.x + c.c2w[5] * p.y + c.c2w[6],
                              c.c2w[8] * p.x + c.c2w[9] * p.y + c.c2w[10]);
    const float scale = rsqrt(p.x * p.x + p.y * p.y + 1.0f);

    return (float4)(d * scale, scale);
}

HELPER float3 camera_origin(cln_device_camera c)
{
    return (float3)(c.c2w[3], c.c2w[7], c.c2w[11]);
}

/* Pixel position of a point; false if it is behind the camera, outside the image, or (distorted) where
 * the model has folded over. */
HELPER bool camera_project(cln_device_camera c, float3 point, float2 *pixel)
{
    const float3 q = point - camera_origin(c);
    const float z = c.c2w[2] * q.x + c.c2w[6] * q.y + c.c2w[10] * q.z;
    float2 p = (float2)(c.c2w[0] * q.x + c.c2w[4] * q.y + c.c2w[8] * q.z,
                        c.c2w[1] * q.x + c.c2w[5] * q.y + c.c2w[9] * q.z);

    if (!(z > 1e-6f))
        return false;
    p /= z;
#if DISTORTION
    const float a = p.x, b = p.y, r2 = a * a + b * b;
    const float radial = 1.0f + r2 * (c.k1 + c.k2 * r2);

    if (1.0f + r2 * (3.0f * c.k1 + 5.0f * c.k2 * r2) <= 0.0f)
        return false;
    p = (float2)(a * radial + 2.0f * c.p1 * a * b + c.p2 * (r2 + 2.0f * a * a),
                 b * radial + c.p1 * (r2 + 2.0f * b * b) + 2.0f * c.p2 * a * b);
#endif
    *pixel = (float2)(MAD(c.fx, p.x, c.cx), MAD(c.fy, p.y, c.cy));
    return pixel->x >= 0.0f && pixel->y >= 0.0f && pixel->x < (float)c.width &&
           pixel->y < (float)c.height;
}

#endif
