/* Shell spaces (method.md 3.3; twin: host/scene/space.c), where the cube's middle half, the core,
 * is the scene's cube, and six faces around it hold what lies beyond. u: the scene moved and
 * scaled, so that its cube is [-1, 1]^3.
 *
 *   core   p = u / 2                       where max |u| <= 1
 *   face   p_a = s (1 - w / 2), p_b = u_b w / 2, w = 1 / (s u_a)    where s u_a is the largest |u|
 *
 * In each piece straight lines stay straight. A ray has CLN_LINE_ROWS rows: the scene's ray, then
 * its lines: origin and begin, direction and end. Rows without a line have NEVER as begin and end.
 * t is the length of all lines so far. A sample's `ray` is the row of its line.
 *
 *   SHELL 0 | 1
 *   BEGINS 0 | 1   1: rays begin at a distance BEGIN of u from their camera
 */
#ifndef SHELL
#define SHELL 0
#endif
#ifndef BEGINS
#define BEGINS 0
#endif
#ifndef BEGIN
#define BEGIN 0.0f
#endif

#define NEVER 1e30f

#if SHELL
#define LEAST_TO_INFINITY 2e-6f /* 1 - |p| of the cube counts as at least half of this */

/* A face's axis and sign, or the core. */
typedef struct piece {
    int axis; /* CORE: none */
    float sign;
} piece;
#define CORE 3

HELPER float along_axis(float3 v, int axis)
{
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

/* v with `value` along the axis; v itself for the core. */
HELPER float3 with_axis(float3 v, int axis, float value)
{
    return (float3)(axis == 0 ? value : v.x, axis == 1 ? value : v.y, axis == 2 ? value : v.z);
}

/* least: where the core ends, 1 for points of u, 1/2 for those of the cube. */
HELPER piece piece_of(float3 p, float least)
{
    const float3 size = fabs(p);
    piece f = {0, 1.0f};

    if (size.y > size.x)
        f.axis = 1;
    if (size.z > along_axis(size, f.axis))
        f.axis = 2;
    if (along_axis(size, f.axis) <= least)
        f.axis = CORE;
    else if (along_axis(p, f.axis) < 0.0f)
        f.sign = -1.0f;
    return f;
}

HELPER float3 into_piece(piece f, float3 u)
{
    const float w = f.axis == CORE ? 1.0f : f.sign / along_axis(u, f.axis);

    return with_axis(0.5f * w * u, f.axis, f.sign * (1.0f - 0.5f * w));
}

HELPER float3 out_of_piece(piece f, float3 p)
{
    const float w = f.axis == CORE ? 1.0f
                                   : fmax(2.0f * (1.0f - f.sign * along_axis(p, f.axis)),
                                          0.5f * LEAST_TO_INFINITY);

    return with_axis(p * (2.0f / w), f.axis, f.sign / w);
}

/* Direction in the cube of a line through u along v, inside the piece; not of length 1. */
HELPER float3 bend_in_piece(piece f, float3 u, float3 v)
{
    if (f.axis == CORE)
        return v;
    return with_axis(f.sign * (v * along_axis(u, f.axis) - u * along_axis(v, f.axis)), f.axis,
                     along_axis(v, f.axis));
}

/* Where the ray u = o + s d leaves the piece for *next, at `s` or later: NEVER if it does not. */
HELPER float leave_piece(piece f, float3 o, float3 d, float s, piece *next)
{
    float leave = NEVER;

    for (int k = 0; k < 6; k++) {
        const int a = k >> 1;
        const float sign = k & 1 ? 1.0f : -1.0f, oa = along_axis(o, a), da = along_axis(d, a);
        float lead = 1.0f - sign * oa, falls = sign * da; /* inside while lead > s falls */
        piece to = {a, sign};

        if (f.axis == a) { /* its own axis: back into the core */
            if (sign != f.sign)
                continue;
            lead = sign * oa - 1.0f;
            falls = -sign * da;
            to.axis = CORE;
        } else if (f.axis != CORE) {
            lead = f.sign * along_axis(o, f.axis) - sign * oa;
            falls = sign * da - f.sign * along_axis(d, f.axis);
        }
        if (falls > 0.0f && fmax(lead / falls, s) < leave) {
            leave = fmax(lead / falls, s);
            *next = to;
        }
    }
    return leave;
}

/* Writes a ray's rows, without lines unless `found`; o, d: of u; o.w: how far the ray's origin is
 * from the camera. */
HELPER void shell_lines(bool found, float4 o, float4 d, __global float4 *ray_o,
                        __global float4 *ray_d)
{
    float s = found ? fmax(BEGIN - o.w, 0.0f) : NEVER, t = 0.0f;
    piece here = piece_of(MAD((float3)(s), d.xyz, o.xyz), 1.0f), next = {CORE, 1.0f};
    uint row = 1;

    ray_o[0] = o;
    ray_d[0] = d;
    for (int k = 0; k < CLN_SPACE_LINES && s < NEVER; k++) {
        const float until = leave_piece(here, o.xyz, d.xyz, s, &next);
        const float3 along = normalize(bend_in_piece(here, o.xyz, d.xyz));
        const float3 from = into_piece(here, MAD((float3)(s), d.xyz, o.xyz));
        float3 to;

        if (until < NEVER)
            to = into_piece(here, MAD((float3)(until), d.xyz, o.xyz));
        else
            to = with_axis(into_piece(here, d.xyz), here.axis, here.sign);
        const float length = dot(to - from, along);

        if (length > CLN_MIN_CHORD) {
            ray_o[row] = (float4)(from - t * along, t);
            ray_d[row++] = (float4)(along, t + length);
            t += length;
        }
        s = until;
        here = next;
    }
    for (; row < CLN_LINE_ROWS; row++) {
        ray_o[row] = (float4)(0.0f, 0.0f, 0.0f, NEVER);
        ray_d[row] = (float4)(0.0f, 0.0f, 1.0f, NEVER);
    }
}

/* The row of ray r that t is on. */
HELPER uint line_row(const __global float4 *ray_o, uint r, float t)
{
    uint row = r * CLN_LINE_ROWS + 1u;

    for (int k = 2; k < CLN_LINE_ROWS; k++)
        row += ray_o[r * CLN_LINE_ROWS + k].w <= t;
    return row;
}
#endif
