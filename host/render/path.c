/* A smooth path through poses. See frames.h. Knots are as far apart as the poses are; tangents are
 * those of the parabola through a key and its neighbours. Frames are evenly spread over the length
 * of the way, as it is gone faster in some parts than in others. */
#include "render/frames.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "scene/vectors.h"

/* Numbers of a key: position, unit quaternion w x y z, distance from the target (0 without one),
 * the sine and cosine of the roll against a level camera of the same direction, times how far it
 * looks from straight up or down (0 to 1), where there is no roll. Around a target, the quaternion
 * is relative to a level camera that looks at it from the same position. */
enum { DISTANCE = 7, ROLL, PARTS = ROLL + 2 };
/* Pieces of the way between two keys by which its length is found. */
enum { PIECES = 128 };
/* Less is rounding: of places, as a share of their largest coordinate; of turns, in radians. */
static const double LEAST_WAY = 1e-12, LEAST_TURN = 1e-9;

typedef struct key {
    double at, part[PARTS], slope[PARTS];
} key;

/* The axes of a level camera that looks at the target, as columns. At the pole any will do. */
static void look(const cln_orbit_frame *around, const double c2w[12], double axes[3][3])
{
    double forward[3], right[3], down[3];

    for (int a = 0; a < 3; a++)
        forward[a] = around->target[a] - c2w[4 * a + 3];
    cln_normalise(forward);
    cln_cross(forward, around->up, right);
    if (!cln_normalise(right))
        memcpy(right, around->north, sizeof right);
    cln_cross(forward, right, down);
    for (int a = 0; a < 3; a++) {
        axes[a][0] = right[a];
        axes[a][1] = down[a];
        axes[a][2] = forward[a];
    }
}

/* The level axes right and down of a camera's direction. Returns the sine of its angle with up, 0
 * if there are none. */
static double level(const double up[3], const double c2w[12], double right[3], double down[3])
{
    const double forward[3] = {c2w[2], c2w[6], c2w[10]};
    double sine = 0;

    cln_cross(forward, up, right);
    sine = sqrt(cln_dot(right, right));
    if (!cln_normalise(right))
        return 0;
    cln_cross(forward, right, down);
    return sine;
}

/* The angle by which a camera's x axis is turned from level to down. */
static double roll_of(const double c2w[12], const double right[3], const double down[3])
{
    const double x[3] = {c2w[0], c2w[4], c2w[8]};

    return atan2(cln_dot(x, down), cln_dot(x, right));
}

/* Turns a camera about its direction so that its roll is the keys': between directions that are far
 * apart, the quaternions' straight way rolls level cameras. */
static void keep_roll(const double up[3], const double roll[2], double c2w[12])
{
    double right[3], down[3], turn = 0;
    const double sine = level(up, c2w, right, down), known = hypot(roll[0], roll[1]);
    const double weight =
        fmin(1, 2 * fmin(sine, known)); /* less within 30 degrees of up and down */

    if (!(weight > 1e-6))
        return;
    turn = atan2(roll[0], roll[1]) - roll_of(c2w, right, down);
    turn = weight * remainder(turn, 2 * acos(-1));
    for (int a = 0; a < 12; a += 4) {
        const double x = c2w[a], y = c2w[a + 1];

        c2w[a] = cos(turn) * x + sin(turn) * y;
        c2w[a + 1] = cos(turn) * y - sin(turn) * x;
    }
}

/* Turns the rotation R of a pose into one relative to the axes, axes^T R, or back, axes R. */
static void turn(double axes[3][3], bool back, double c2w[12])
{
    double from[12];

    memcpy(from, c2w, sizeof from);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            c2w[4 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                c2w[4 * i + j] += (back ? axes[i][k] : axes[k][i]) * from[4 * k + j];
        }
}

/* What way and turn must exceed to count. */
static void find_least(int n, const key *keys, double least[2])
{
    double most = 0;

    for (int i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            most = fmax(most, fabs(keys[i].part[a]));
    least[0] = LEAST_WAY * most;
    least[1] = LEAST_TURN;
}

/* Places the keys by the distances between neighbours: those of positions and of directions, each
 * divided by its mean. */
static cln_status place_keys(int n, key *keys)
{
    cln_status st = CLN_OK;
    double(*apart)[2] = NULL, mean[2] = {0}, least[2];

    CLN_TRY(cln_alloc(&apart, (size_t)n, sizeof *apart, "path"));
    for (int i = 1; i < n; i++) {
        double square = 0, turn = 0;

        for (int a = 0; a < DISTANCE; a++) {
            const double d = keys[i].part[a] - keys[i - 1].part[a];

            square += a < 3 ? d * d : 0;
            turn += a < 3 ? 0 : d * d;
        }
        apart[i][0] = sqrt(square);
        apart[i][1] = 4 * asin(fmin(1, sqrt(turn) / 2)); /* by acos, none would be 1e-8 */
        for (int k = 0; k < 2; k++)
            mean[k] += apart[i][k] / (n - 1);
    }
    find_least(n, keys, least);
    for (int i = 1; i < n; i++) {
        double length = 0;

        for (int k = 0; k < 2; k++)
            length += mean[k] > least[k] ? apart[i][k] / mean[k] : 0;
        keys[i].at = keys[i - 1].at + fmax(length, 1e-3); /* a pose given twice is a short halt */
    }
done:
    free(apart);
    return st;
}

/* What comes before the first key of a closed path, or after its last one: a key that is `turn`
 * farther on, with the quaternion that is on `beside`'s side. */
static key across(const key *from, double turn, const key *beside)
{
    key k = *from;
    double cosine = 0;

    k.at += turn;
    for (int a = 3; a < DISTANCE; a++)
        cosine += k.part[a] * beside->part[a];
    for (int a = 3; a < DISTANCE && cosine < 0; a++)
        k.part[a] = -k.part[a];
    return k;
}

/* closed: the last key is the first one again. */
static void find_slopes(int n, bool closed, key *keys)
{
    const double turn = keys[n - 1].at;
    const key first = across(&keys[n - 2], -turn, &keys[0]);
    const key last = across(&keys[1], turn, &keys[n - 1]);

    for (int i = 0; i < n; i++) {
        const key *before = i > 0 ? &keys[i - 1] : closed ? &first : &keys[i];
        const key *after = i < n - 1 ? &keys[i + 1] : closed ? &last : &keys[i];
        const double h = keys[i].at - before->at, g = after->at - keys[i].at;

        for (int a = 0; a < PARTS; a++) {
            const double back = h > 0 ? (keys[i].part[a] - before->part[a]) / h : 0;
            const double on = g > 0 ? (after->part[a] - keys[i].part[a]) / g : 0;

            keys[i].slope[a] = (back * g + on * h) / (h + g);
            if (!closed && (i == 0 || i == n - 1))
                keys[i].slope[a] = back + on; /* one of them is 0 */
        }
    }
}

static void pose_at(const key *a, const key *b, double at, const cln_orbit_frame *around,
                    const double *up, double c2w[12])
{
    const double h = b->at - a->at, u = (at - a->at) / h, v = 1 - u;
    double part[PARTS], axes[3][3], square = 0;

    for (int k = 0; k < PARTS; k++)
        part[k] = v * v * ((1 + 2 * u) * a->part[k] + u * h * a->slope[k]) +
                  u * u * ((1 + 2 * v) * b->part[k] - v * h * b->slope[k]);
    for (int k = 3; k < DISTANCE; k++)
        square += part[k] * part[k];
    if (!(square > 1e-6)) { /* opposite directions: jumps half way */
        memcpy(part + 3, (u < 0.5 ? a : b)->part + 3, 4 * sizeof *part);
        square = 1;
    }
    for (int k = 3; k < DISTANCE; k++)
        part[k] /= sqrt(square);
    cln_pose_turn(part + 3, c2w);
    square = 0;
    for (int k = 0; k < 3 && around; k++)
        square += (part[k] - around->target[k]) * (part[k] - around->target[k]);
    for (int k = 0; k < 3; k++) {
        c2w[4 * k + 3] = part[k];
        if (square > 1e-12 * part[DISTANCE] * part[DISTANCE])
            c2w[4 * k + 3] =
                around->target[k] + part[DISTANCE] / sqrt(square) * (part[k] - around->target[k]);
    }
    if (around) {
        look(around, c2w, axes);
        turn(axes, true, c2w);
    }
    if (up)
        keep_roll(up, part + ROLL, c2w);
}

/* Whether the keys look at what others stand around, as they do not from within a room. */
static bool look_at_it(const cln_frames *from, const cln_orbit_frame *around)
{
    double sum = 0;

    for (int i = 0; i < from->count; i++) {
        const double *c2w = from->frame[i].camera.c2w;
        const double forward[3] = {c2w[2], c2w[6], c2w[10]};
        double to[3];

        for (int a = 0; a < 3; a++)
            to[a] = around->target[a] - c2w[4 * a + 3];
        if (cln_normalise(to))
            sum += cln_dot(to, forward);
    }
    return sum > 0.5 * from->count;
}

/* n: of the frames, or one more, which is the first one again. */
static cln_status make_keys(const cln_frames *from, int n, const cln_orbit_frame *around,
                            const double *up, key *keys)
{
    for (int i = 0; i < n; i++) {
        double cosine = 0, square = 0, axes[3][3], c2w[12];

        memcpy(c2w, from->frame[i % from->count].camera.c2w, sizeof c2w);
        if (up) {
            double right[3], down[3];
            const double sine = level(up, c2w, right, down);
            const double roll = sine > 0 ? roll_of(c2w, right, down) : 0;

            keys[i].part[ROLL] = sine * sin(roll);
            keys[i].part[ROLL + 1] = sine * cos(roll);
        }
        if (around) {
            look(around, c2w, axes);
            turn(axes, false, c2w);
        }
        for (int a = 0; a < 3; a++) {
            const double away = around ? c2w[4 * a + 3] - around->target[a] : 0;

            keys[i].part[a] = c2w[4 * a + 3];
            square += away * away;
        }
        keys[i].part[DISTANCE] = sqrt(square);
        cln_pose_quaternion(c2w, keys[i].part + 3);
        for (int a = 3; a < DISTANCE && i > 0; a++)
            cosine += keys[i].part[a] * keys[i - 1].part[a];
        for (int a = 3; a < DISTANCE && cosine < 0; a++) /* the shorter way round */
            keys[i].part[a] = -keys[i].part[a];
    }
    return place_keys(n, keys);
}

/* The shorter one: of keys of another shape as much is seen along it, by square pixels. */
static double side_of(const cln_camera *c)
{
    return c->width < c->height ? c->width : c->height;
}

/* The first key's camera. If other keys have another lens, a pinhole, of the first key that is no
 * panorama: one of them is none, as panoramas have one lens. */
static cln_camera lens_of(const cln_frames *keys)
{
    cln_camera c = keys->frame[0].camera;
    bool same = true;

    for (int i = 1; i < keys->count; i++) {
        const cln_camera *other = &keys->frame[i].camera;

        same = same && other->lens == c.lens &&
               memcmp(other->distortion, c.distortion, sizeof c.distortion) == 0;
    }
    for (int i = keys->count - 1; i >= 0 && !same; i--)
        if (keys->frame[i].camera.lens != CLN_LENS_EQUIRECTANGULAR)
            c = keys->frame[i].camera;
    if (!same) {
        c.lens = CLN_LENS_OPENCV;
        memset(c.distortion, 0, sizeof c.distortion);
    }
    return c;
}

/* Focal lengths of a key along a path of this lens, over the shorter side: a panorama's is none of
 * a pinhole. */
static void focal_of(const cln_camera *of, const cln_camera *path, double focal[2])
{
    const bool other =
        of->lens == CLN_LENS_EQUIRECTANGULAR && path->lens != CLN_LENS_EQUIRECTANGULAR;
    const cln_camera *from = other ? path : of;

    focal[0] = from->fx / side_of(from);
    focal[1] = from->fy / side_of(from);
}

/* A path that is laid. */
typedef struct path {
    const cln_orbit_frame *around;
    const double *up;
    key *keys;
    int n;
    double *length; /* [PIECES * (n - 1) + 1] of the way up to the end of each piece */
} path;

static int segment_of(const path *p, double at)
{
    int segment = 0;

    for (int below = p->n - 1; below - segment > 1;) { /* halving */
        const int middle = (segment + below) / 2;

        if (p->keys[middle].at <= at)
            segment = middle;
        else
            below = middle;
    }
    return segment;
}

static double at_of_piece(const path *p, int piece)
{
    const key *from = &p->keys[piece / PIECES];

    return piece % PIECES ? from[0].at + (from[1].at - from[0].at) * (piece % PIECES) / PIECES
                          : from[0].at;
}

/* How far two poses are apart: in place, and in direction. */
static void find_apart(const double a[12], const double b[12], double apart[2])
{
    double square = 0, turn = 0;

    for (int i = 0; i < 12; i++)
        *(i % 4 == 3 ? &square : &turn) += (a[i] - b[i]) * (a[i] - b[i]);
    apart[0] = sqrt(square);
    apart[1] = 2 * asin(fmin(1, sqrt(turn / 8))); /* |A - B|^2 = 4 (1 - cos) */
}

/* Lengths count as between keys: place and direction, each by its sum over the way. */
static cln_status measure(path *p)
{
    cln_status st = CLN_OK;
    const int pieces = PIECES * (p->n - 1);
    double(*apart)[2] = NULL, sum[2] = {0}, least[2], before[12], here[12];

    CLN_TRY(cln_alloc(&apart, (size_t)pieces, sizeof *apart, "path"));
    CLN_TRY(cln_alloc(&p->length, (size_t)pieces + 1, sizeof *p->length, "path"));
    for (int i = 0; i <= pieces; i++) {
        const int segment = i < pieces ? i / PIECES : p->n - 2;

        pose_at(&p->keys[segment], &p->keys[segment + 1], at_of_piece(p, i), p->around, p->up,
                here);
        if (i > 0)
            find_apart(before, here, apart[i - 1]);
        for (int k = 0; k < 2 && i > 0; k++)
            sum[k] += apart[i - 1][k];
        memcpy(before, here, sizeof before);
    }
    find_least(p->n, p->keys, least);
    p->length[0] = 0;
    for (int i = 0; i < pieces; i++) {
        p->length[i + 1] = p->length[i];
        for (int k = 0; k < 2; k++)
            p->length[i + 1] += sum[k] > least[k] ? apart[i][k] / sum[k] : 0;
    }
done:
    free(apart);
    return st;
}

/* Where a share of the way is gone. */
static double at_of_share(const path *p, double share)
{
    const int pieces = PIECES * (p->n - 1);
    const double wanted = share * p->length[pieces];
    int piece = 0;
    double part = 0;

    if (share >= 1)
        return p->keys[p->n - 1].at;
    if (!(p->length[pieces] > 0)) /* all keys are one */
        return share * p->keys[p->n - 1].at;
    for (int below = pieces; below - piece > 1;) {
        const int middle = (piece + below) / 2;

        if (p->length[middle] <= wanted)
            piece = middle;
        else
            below = middle;
    }
    part = (wanted - p->length[piece]) / (p->length[piece + 1] - p->length[piece]);
    return at_of_piece(p, piece) + part * (at_of_piece(p, piece + 1) - at_of_piece(p, piece));
}

/* Is a path closed by one more key? If the last one is the first again, it is as it stands. */
static bool needs_closing(const cln_frames *from)
{
    double apart[2], most = 0;

    for (int i = 0; i < from->count; i++)
        for (int a = 3; a < 12; a += 4)
            most = fmax(most, fabs(from->frame[i].camera.c2w[a]));
    find_apart(from->frame[0].camera.c2w, from->frame[from->count - 1].camera.c2w, apart);
    return apart[0] > LEAST_WAY * most || apart[1] > LEAST_TURN;
}

cln_status cln_frames_through(const cln_frames *from, int count, const cln_orbit_frame *around,
                              const double *up, bool closed, cln_frames *out)
{
    cln_status st = CLN_OK;
    const int n = from->count > 1 ? from->count + (closed && needs_closing(from)) : from->count;
    const cln_camera lens = n > 0 ? lens_of(from) : (cln_camera){0};
    path p = {.up = up, .n = n};

    if (n < 2)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--interpolate: a path needs at least two poses, not %d; "
                         "choose others with --split or --poses",
                         n));
    if (around && !look_at_it(from, around))
        around = NULL;
    p.around = around;
    CLN_TRY(cln_alloc(&p.keys, (size_t)n, sizeof *p.keys, "path"));
    CLN_TRY(make_keys(from, n, around, up, p.keys));
    find_slopes(n, closed, p.keys);
    CLN_TRY(measure(&p));
    CLN_TRY(cln_frames_room(count, out));
    for (int i = 0; i < count; i++) {
        const double at = count > 1 ? at_of_share(&p, (double)i / (closed ? count : count - 1)) : 0;
        const int segment = segment_of(&p, at);
        const key *keys = &p.keys[segment];
        const double u = (at - keys[0].at) / (keys[1].at - keys[0].at);
        cln_camera *c = &out->frame[i].camera;
        double a[2], b[2];

        *c = lens;
        focal_of(&from->frame[segment].camera, &lens, a);
        focal_of(&from->frame[(segment + 1) % from->count].camera, &lens, b);
        c->fx = side_of(c) * ((1 - u) * a[0] + u * b[0]);
        c->fy = side_of(c) * ((1 - u) * a[1] + u * b[1]);
        pose_at(&keys[0], &keys[1], at, around, up, c->c2w);
        CLN_TRY(cln_asprintf(&out->frame[i].name, "path_%04d", i));
    }
done:
    free(p.keys);
    free(p.length);
    return st;
}
