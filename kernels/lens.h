/* Lens models: from a point of the ideal image plane, at z = 1, to its place in the image, and
 * back. Twin of host/scene/lens.c. There are two: a pinhole, and OPENCV with k1 k2 p1 p2; another
 * one joins here as a branch of both functions, by c.lens.
 *
 * DISTORTION  0 | 1: pinhole; OPENCV
 */
#ifndef DISTORTION
#define DISTORTION 1
#endif

#if DISTORTION
/* p (1 + k1 r^2 + k2 r^4), and tangential terms. False where the radial part has folded over. */
HELPER bool lens_distort(cln_device_camera c, float2 p, float2 *out)
{
    const float a = p.x, b = p.y, r2 = a * a + b * b;
    const float radial = 1.0f + r2 * (c.k[0] + c.k[1] * r2);

    *out = (float2)(a * radial + 2.0f * c.k[2] * a * b + c.k[3] * (r2 + 2.0f * a * a),
                    b * radial + c.k[2] * (r2 + 2.0f * b * b) + 2.0f * c.k[3] * a * b);
    return 1.0f + r2 * (3.0f * c.k[0] + 5.0f * c.k[1] * r2) > 0.0f;
}

/* The point that is distorted to `target`. Newton's method from the target; it ends where the model
 * stops being one-to-one (a determinant near 0). */
HELPER float2 lens_undistort(cln_device_camera c, float2 target)
{
    float2 p = target;

    for (int i = 0; i < 10; i++) {
        const float a = p.x, b = p.y, r2 = a * a + b * b;
        const float radial = 1.0f + r2 * (c.k[0] + c.k[1] * r2), slope = c.k[0] + 2.0f * c.k[1] * r2;
        const float2 f = (float2)(a * radial + 2.0f * c.k[2] * a * b + c.k[3] * (r2 + 2.0f * a * a),
                                  b * radial + c.k[2] * (r2 + 2.0f * b * b) + 2.0f * c.k[3] * a * b) -
                         target;
        const float fa = radial + 2.0f * a * a * slope + 2.0f * c.k[2] * b + 6.0f * c.k[3] * a;
        const float fb = 2.0f * a * b * slope + 2.0f * c.k[2] * a + 2.0f * c.k[3] * b;
        const float gb = radial + 2.0f * b * b * slope + 6.0f * c.k[2] * b + 2.0f * c.k[3] * a;
        const float det = fa * gb - fb * fb;

        if (fabs(det) < 1e-6f)
            break;
        p -= (float2)(gb * f.x - fb * f.y, fa * f.y - fb * f.x) / det;
    }
    return p;
}
#else
HELPER bool lens_distort(cln_device_camera c, float2 p, float2 *out)
{
    (void)c;
    *out = p;
    return true;
}

HELPER float2 lens_undistort(cln_device_camera c, float2 target)
{
    (void)c;
    return target;
}
#endif
