/* Lens models: from a direction in the camera's axes to its place in the image, and back. Twin of
 * host/scene/lens.c and lens_plane.c; docs/method.md 3.1 has the formulas.
 *
 * LENSES  bits 1 << cln_lens: the models that the scene's cameras have. A camera of any other one
 *         is a pinhole. 0: no lens code. 1 << CLN_LENSES: cameras whose rays are parallel.
 */
#ifndef LENSES
#define LENSES 0x7FFFFFFF /* all */
#endif
#define HAS_LENS(model)   ((LENSES) >> (model)&1)
#define IS_LENS(c, model) (HAS_LENS(model) && (c).lens == (model))
#define IS_PARALLEL(c)    (HAS_LENS(CLN_LENSES) && (c).parallel)

/* Models that bend a plane (lens_bend), and those whose plane is a fisheye's. */
#define IS_FISHEYE(c)                                                                  \
    (IS_LENS(c, CLN_LENS_OPENCV_FISHEYE) || IS_LENS(c, CLN_LENS_THIN_PRISM_FISHEYE) || \
     IS_LENS(c, CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE))
#define IS_BENT(c) \
    (IS_LENS(c, CLN_LENS_OPENCV) || IS_LENS(c, CLN_LENS_FULL_OPENCV) || IS_FISHEYE(c))

/* A perspective has no place for points nearer to the camera's plane than this. */
#define LENS_NEAR 1e-6f
#define FOV_LEAST 1e-5f /* rad: a FOV lens bends less than float32 tells */

#if LENSES
/* 1 + k0 s + .. + k5 s^6, and its derivative. */
HELPER float lens_series(float s, float k0, float k1, float k2, float k3, float k4, float k5,
                         float *slope)
{
    *slope =
        k0 + s * (2.0f * k1 +
                  s * (3.0f * k2 + s * (4.0f * k3 + s * (5.0f * k4 + s * (6.0f * k5)))));
    return 1.0f + s * (k0 + s * (k1 + s * (k2 + s * (k3 + s * (k4 + s * k5)))));
}

/* The radial factor at squared radius s, and its derivative by s. */
HELPER float lens_radial(cln_device_camera c, float s, float *slope)
{
    if (IS_LENS(c, CLN_LENS_FULL_OPENCV)) {
        float up, down;
        const float n = lens_series(s, c.k[0], c.k[1], c.k[4], 0.0f, 0.0f, 0.0f, &up);
        const float d = lens_series(s, c.k[5], c.k[6], c.k[7], 0.0f, 0.0f, 0.0f, &down);

        *slope = (up - n / d * down) / d;
        return n / d;
    }
    if (IS_LENS(c, CLN_LENS_OPENCV_FISHEYE))
        return lens_series(s, c.k[0], c.k[1], c.k[2], c.k[3], 0.0f, 0.0f, slope);
    if (IS_LENS(c, CLN_LENS_THIN_PRISM_FISHEYE))
        return lens_series(s, c.k[0], c.k[1], c.k[4], c.k[5], 0.0f, 0.0f, slope);
    if (IS_LENS(c, CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE))
        return lens_series(s, c.k[0], c.k[1], c.k[2], c.k[3], c.k[4], c.k[5], slope);
    *slope = c.k[0] + 2.0f * c.k[1] * s;
    return 1.0f + s * (c.k[0] + c.k[1] * s);
}

/* Moves a point of the plane to its place; by: derivatives da'/da, da'/db, db'/da, db'/db. */
HELPER float2 lens_bend(cln_device_camera c, float2 p, float4 *by)
{
    const float a = p.x, b = p.y, r2 = a * a + b * b;
    float slope;
    const float radial = lens_radial(c, r2, &slope);
    const float fa = radial + 2.0f * a * a * slope, fb = 2.0f * a * b * slope;
    const float gb = radial + 2.0f * b * b * slope;

    if (IS_LENS(c, CLN_LENS_OPENCV_FISHEYE)) {
        *by = (float4)(fa, fb, fb, gb);
        return radial * p;
    }
    if (IS_LENS(c, CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE)) {
        const float x = radial * a, y = radial * b, s = x * x + y * y;
        const float p0 = c.k[6], p1 = c.k[7];
        const float sx = c.k[8] + 2.0f * s * c.k[9], sy = c.k[10] + 2.0f * s * c.k[11];
        const float fx = 1.0f + 2.0f * p1 * y + (6.0f * p0 + 2.0f * sx) * x;
        const float fy = 2.0f * p1 * x + (2.0f * p0 + 2.0f * sx) * y;
        const float gx = 2.0f * p0 * y + (2.0f * p1 + 2.0f * sy) * x;
        const float gy = 1.0f + 2.0f * p0 * x + (6.0f * p1 + 2.0f * sy) * y;

        *by = (float4)(fx * fa + fy * fb, fx * fb + fy * gb, gx * fa + gy * fb, gx * fb + gy * gb);
        return (float2)(x + 2.0f * p1 * x * y + p0 * (s + 2.0f * x * x) +
                            s * (c.k[8] + s * c.k[9]),
                        y + p1 * (s + 2.0f * y * y) + 2.0f * p0 * x * y +
                            s * (c.k[10] + s * c.k[11]));
    }
    const float p1 = c.k[2], p2 = c.k[3];

    *by = (float4)(fa + 2.0f * p1 * b + 6.0f * p2 * a, fb + 2.0f * p1 * a + 2.0f * p2 * b,
                   fb + 2.0f * p1 * a + 2.0f * p2 * b, gb + 6.0f * p1 * b + 2.0f * p2 * a);
    p = (float2)(a * radial + 2.0f * p1 * a * b + p2 * (r2 + 2.0f * a * a),
                 b * radial + p1 * (r2 + 2.0f * b * b) + 2.0f * p2 * a * b);
    if (IS_LENS(c, CLN_LENS_THIN_PRISM_FISHEYE)) {
        *by += 2.0f * (float4)(c.k[6] * a, c.k[6] * b, c.k[7] * a, c.k[7] * b);
        p += r2 * (float2)(c.k[6], c.k[7]);
    }
    return p;
}

HELPER float2 lens_step(float4 by, float2 f)
{
    return (float2)(by.w * f.x - by.y * f.y, by.x * f.y - by.z * f.x) /
           (by.x * by.w - by.y * by.z);
}

/* Is p before the fold, and its place the target, to 0.01 pixels at f = 1000? */
HELPER bool lens_solved(cln_device_camera c, float2 target, float2 p)
{
    float4 by;
    const float2 f = lens_bend(c, p, &by) - target;

    return dot(f, f) <= 1e-10f * dot(target, target) && dot(p, p) < c.limit * c.limit &&
           by.x * by.w - by.y * by.z > 0.0f;
}

/* The point of the plane that is moved to `target`, by Newton's method; false if there is none.
 * Starts at the target itself, which is enough for a mild lens; else at the solution of the radial
 * part by bisection, kept off the fold, with steps that are halved until they help. */
HELPER bool lens_unbend(cln_device_camera c, float2 target, float2 *point)
{
    float2 p = target;
    float4 by;

    for (int i = 0; i < 10; i++) {
        const float2 f = lens_bend(c, p, &by) - target;

        if (fabs(by.x * by.w - by.y * by.z) < 1e-6f)
            break;
        p -= lens_step(by, f);
    }
    *point = p;
    if (lens_solved(c, target, p))
        return true;

    const float radius = length(target);
    float low = 0.0f, high = fmin(c.limit, 1e4f), error, slope;

    for (int i = 0; i < 40; i++) {
        const float middle = 0.5f * (low + high);

        if (middle * lens_radial(c, middle * middle, &slope) < radius)
            low = middle;
        else
            high = middle;
    }
    p = target * (0.999f * low / radius);
    error = length(lens_bend(c, p, &by) - target);
    for (int i = 0; i < 30; i++) {
        const float2 whole = lens_step(by, lens_bend(c, p, &by) - target);
        float share = 1.0f, next = INFINITY;

        for (; share > 1e-3f; share *= 0.5f) {
            next = length(lens_bend(c, p - share * whole, &by) - target);
            if (next < error)
                break;
        }
        if (!(next < error))
            break;
        p -= share * whole;
        error = next;
    }
    *point = p;
    return lens_solved(c, target, p);
}
#endif

/* Place of a direction of any length; false outside the model's domain. */
HELPER bool lens_distort(cln_device_camera c, float3 q, float2 *place)
{
#if LENSES
    const float across2 = q.x * q.x + q.y * q.y;

    if (IS_LENS(c, CLN_LENS_EQUIRECTANGULAR)) {
        *place = (float2)(atan2(q.x, q.z), atan2(q.y, sqrt(q.x * q.x + q.z * q.z)));
        return true;
    }
    if (IS_LENS(c, CLN_LENS_EUCM)) {
        const float alpha = c.k[0], d = sqrt(c.k[1] * across2 + q.z * q.z);
        const float below = alpha * d + (1.0f - alpha) * q.z;

        *place = q.xy / below;
        return below > 0.0f && (alpha <= 0.5f || alpha * q.z > (alpha - 1.0f) * d);
    }
    if (IS_LENS(c, CLN_LENS_DIVISION)) {
        const float bent = -4.0f * c.k[0] * across2;
        const float root = sqrt(fmax(q.z * q.z + bent, 0.0f));
        const float below = q.z > 0.0f ? q.z + root : bent / (root - q.z);

        *place = 2.0f * q.xy / below;
        return q.z * q.z + bent >= 0.0f && below > 0.0f;
    }
    if (IS_FISHEYE(c)) {
        const float across = sqrt(across2), theta = atan2(across, q.z);
        const float2 p = q.xy * (across > 0.0f ? theta / across : 0.0f);
        float4 by;

        *place = lens_bend(c, p, &by);
        return theta < c.limit;
    }
#endif
    if (!(q.z > LENS_NEAR))
        return false;
    *place = q.xy / q.z;
#if LENSES
    if (IS_LENS(c, CLN_LENS_FOV)) {
        const float r = sqrt(across2) / q.z, omega = c.k[0];

        if (r > 0.0f && fabs(omega) > FOV_LEAST)
            *place *= atan(2.0f * r * tan(0.5f * omega)) / (omega * r);
        return true;
    }
    if (IS_BENT(c)) {
        const float2 p = *place;
        float4 by;

        *place = lens_bend(c, p, &by);
        return dot(p, p) < c.limit * c.limit;
    }
#endif
    return true;
}

/* A direction of any length that has this place; false if there is none. */
HELPER bool lens_undistort(cln_device_camera c, float2 place, float3 *q)
{
#if LENSES
    if (IS_LENS(c, CLN_LENS_EQUIRECTANGULAR)) {
        const float level = cos(place.y);

        *q = (float3)(level * sin(place.x), sin(place.y), level * cos(place.x));
        return fabs(place.x) <= M_PI_F && fabs(place.y) <= M_PI_2_F;
    }
    if (IS_LENS(c, CLN_LENS_EUCM)) {
        const float alpha = c.k[0], s = c.k[1] * dot(place, place);
        const float square = 1.0f - (2.0f * alpha - 1.0f) * s;

        *q = (float3)(place, (1.0f - alpha * alpha * s) /
                                 (alpha * sqrt(fmax(square, 0.0f)) + 1.0f - alpha));
        return square > 0.0f;
    }
    if (IS_LENS(c, CLN_LENS_DIVISION)) {
        const float bent = c.k[0] * dot(place, place);

        *q = (float3)(place, 1.0f + bent);
        return bent < 1.0f;
    }
    if (IS_FISHEYE(c)) {
        float2 p;
        const bool found = lens_unbend(c, place, &p);
        const float theta = length(p);

        *q = (float3)(p * (theta > 0.0f ? sin(theta) / theta : 1.0f), cos(theta));
        return found;
    }
    if (IS_LENS(c, CLN_LENS_FOV)) {
        const float r = length(place), omega = c.k[0];
        const bool bent = r > 0.0f && fabs(omega) > FOV_LEAST;
        const float scale = bent ? tan(r * omega) / (2.0f * tan(0.5f * omega) * r) : 1.0f;

        *q = (float3)(place * scale, 1.0f);
        return r * fabs(omega) < M_PI_2_F;
    }
    if (IS_BENT(c)) {
        float2 p;
        const bool found = lens_unbend(c, place, &p);

        *q = (float3)(p, 1.0f);
        return found;
    }
#else
    (void)c;
#endif
    *q = (float3)(place, 1.0f);
    return true;
}
