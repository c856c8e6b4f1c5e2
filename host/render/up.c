/* Up from the training cameras. See up.h.
 *
 * Cameras are held level, or upright as EXIF data tell (cln_view_turn), so up is the axis along
 * which the x axes of the photos, as people see them, point least. Photos of an object or a room
 * show its side by their own up vectors, whose mean also decides where the x axes leave the axis
 * open, as all of them lie along a line. Of a flight to and fro that looks down, the up vectors
 * cancel out: there it is a camera's looking rather down than up that tells. */
#include "render/up.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/eigen.h"
#include "base/given.h"
#include "base/log.h"
#include "base/number.h"
#include "scene/vectors.h"

static const double LEVEL = 1e-3; /* the square of how level cameras are held */
static const double LONG = 0.5;   /* of a mean up vector that tells by itself */
static const double CLEAR = 10; /* times: how much more x axes spread across the axis than along */
static const double THIN = 0.1; /* of their spread: below, they lie along a line */
static const double FEWER = 0.25; /* of the cameras face back, of a flight to and fro */
/* How much looking down weighs against the pictures' up: a dome, seen from below, is not turned
 * over until cameras look up by 76 degrees, a flight not until they look back by 14. */
static const double DOWN = 0.25;

/* Radians that cameras which are held level all lean by; of the mean square of sines, one for each
 * photo, that is too much for level ones (10 degrees); so few tell nothing. */
static const double LEVELLED = 0.0174533, ASKEW = 0.03;
enum { FEWEST = 3 };
static const double APART = 0.9994; /* the cosine of 2 degrees: GPS may be wrong, or its scene */

static const double AT_AXIS = 0.0017453; /* the sine of 0.1 degrees */

static const double LONGEST = 1e30; /* of a vector that is given: its square is a number */

typedef struct facing {
    double up[3], back[3]; /* mean of the pictures' up, and against the mean viewing direction */
    double across[3][3];   /* mean of x x^T */
} facing;

/* The pose of photo i as people see it, in *seen. */
static const double *pose_of(const cln_scene *scene, int i, cln_camera *seen)
{
    cln_view_seen(cln_scene_training_view(scene, i), seen);
    return seen->c2w;
}

static void face(const cln_scene *scene, int count, facing *out)
{
    memset(out, 0, sizeof *out);
    for (int i = 0; i < count; i++) {
        cln_camera seen;
        const double *c2w = pose_of(scene, i, &seen);

        for (int a = 0; a < 3; a++) {
            out->up[a] -= c2w[4 * a + 1] / count; /* the camera's y points down */
            out->back[a] -= c2w[4 * a + 2] / count;
            for (int b = 0; b < 3; b++)
                out->across[a][b] += c2w[4 * a] * c2w[4 * b] / count;
        }
    }
}

/* Of a flight to and fro along a line: means in which both ways weigh alike, however many photos
 * each has. False if nearly all face the same way. */
static bool balance(const cln_scene *scene, int count, const double line[3], facing *f)
{
    double up[2][3] = {{0}}, back[2][3] = {{0}};
    int of[2] = {0, 0};

    for (int i = 0; i < count; i++) {
        cln_camera seen;
        const double *c2w = pose_of(scene, i, &seen);
        const int way = line[0] * c2w[0] + line[1] * c2w[4] + line[2] * c2w[8] < 0;

        of[way]++;
        for (int a = 0; a < 3; a++) {
            up[way][a] -= c2w[4 * a + 1];
            back[way][a] -= c2w[4 * a + 2];
        }
    }
    if (of[0] < FEWER * count || of[1] < FEWER * count)
        return false;
    for (int a = 0; a < 3; a++) {
        f->up[a] = 0.5 * (up[0][a] / of[0] + up[1][a] / of[1]);
        f->back[a] = 0.5 * (back[0][a] / of[0] + back[1][a] / of[1]);
    }
    return true;
}

/* Solves (mean of x x^T + LEVEL) out = mean up, which keeps to the mean where x axes leave it open.
 * The mean alone would lean over where cameras look down in an arc. */
static void lean_least(const facing *f, double out[3])
{
    double column[3][3];

    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            column[b][a] = f->across[a][b] + (a == b ? LEVEL : 0);
    for (int a = 0; a < 3; a++) { /* Cramer, but for the determinant, which is above 0 */
        double n[3];

        cln_cross(column[(a + 1) % 3], column[(a + 2) % 3], n);
        out[a] = cln_dot(f->up, n);
    }
}

/* How far the up of photo i points along an axis. */
static double up_along(const cln_scene *scene, int i, const double axis[3])
{
    cln_camera seen;
    const double *c2w = pose_of(scene, i, &seen);

    return 0 - (axis[0] * c2w[1] + axis[1] * c2w[5] + axis[2] * c2w[9]);
}

static double length(const double v[3])
{
    return sqrt(cln_dot(v, v));
}

/* Of x axes along a line: up across it, or where that is too short, up and back. False if they are,
 * too. */
static bool across_line(const facing *f, const double line[3], double out[3])
{
    const double weight = length(f->up) > LONG ? 0 : 1;
    double along = 0;

    for (int a = 0; a < 3; a++)
        out[a] = f->up[a] + weight * f->back[a];
    along = cln_dot(out, line);
    for (int a = 0; a < 3; a++)
        out[a] -= along * line[a];
    return length(out) > DOWN;
}

/* An axis, of the x axes' plane, on the side of up and back. False if they do not tell, as of an
 * object that was turned over for a second pass: then on the side of the first picture's up. */
static bool off_plane(const cln_scene *scene, int count, const facing *f, const double axis[3],
                      double out[3])
{
    double side = cln_dot(axis, f->up) + DOWN * cln_dot(axis, f->back);
    bool sure = fabs(side) >= CLN_UP_UNSURE;
    int most = 0; /* along the axis, less those against it */

    for (int i = 0; i < count && !sure; i++)
        most += up_along(scene, i, axis) < 0 ? -1 : 1;
    sure = sure || count - abs(most) < 2 * FEWER * count; /* they agree, if by little */
    if (!sure)
        side = up_along(scene, 0, axis);
    for (int a = 0; a < 3; a++)
        out[a] = side < 0 ? -axis[a] : axis[a];
    return sure;
}

/* Scenes whose cameras were placed or aligned have an axis upright; their mean has it nearly, and
 * the turn of a GLB file or a path's horizon would be odd by as little. */
static void snap(double up[3])
{
    for (int a = 0; a < 3; a++) {
        double axis[3] = {0};

        if (hypot(up[(a + 1) % 3], up[(a + 2) % 3]) > AT_AXIS)
            continue;
        axis[a] = up[a] < 0 ? -1 : 1;
        memcpy(up, axis, sizeof axis);
        return;
    }
}

/* cln_up_tell, and whether the side is sure. */
static bool estimate(const cln_scene *scene, cln_up_told *out)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double value[3], axis[3][3], *up = out->up;
    bool found = false, sure = true, line = false, balanced = false;
    facing f;

    face(scene, count, &f);
    for (int a = 0; a < 3; a++)
        out->rough[a] = f.up[a] + DOWN * f.back[a];
    cln_eigen(3, f.across[0], value, axis[0]);
    line = value[1] < THIN * value[2];
    if (line) {
        balanced = balance(scene, count, axis[2], &f);
        if (balanced || length(f.up) < LONG)
            found = across_line(&f, axis[2], up);
    } else if (length(f.up) < LONG && value[1] > CLEAR * (value[0] + LEVEL)) {
        sure = off_plane(scene, count, &f, axis[0], up);
        found = true;
    }
    balanced = balanced && found;
    if (!found) {
        sure = length(f.up) >= CLN_UP_UNSURE; /* by itself */
        off_plane(scene, count, &f, axis[0], up);
        if (cln_dot(f.up, up) < 0) /* a strip would lean to the nadir by mere scatter */
            for (int a = 0; a < 3; a++)
                f.up[a] += DOWN * f.back[a];
        lean_least(&f, up);
    }
    memcpy(out->level, axis[2], sizeof out->level);
    out->what = count < FEWEST || value[0] > ASKEW ? CLN_UP_UNTOLD
                : line && !balanced                ? CLN_UP_LEVEL
                : sure                             ? CLN_UP_TOLD
                                                   : CLN_UP_UNTOLD;
    out->sd =
        sqrt(LEVELLED * LEVELLED + value[0] / (count * (line ? value[2] : fmax(value[1], LEVEL))));
    return sure;
}

void cln_up_tell(const cln_scene *scene, cln_up_told *out)
{
    *out = (cln_up_told){0};
    if (cln_scene_split_count(scene, CLN_SPLIT_TRAIN) > 0)
        (void)estimate(scene, out);
    if (!cln_normalise(out->up) && out->what == CLN_UP_TOLD)
        out->what = CLN_UP_UNTOLD;
}

bool cln_up_of_cameras(const cln_scene *scene, double up[3])
{
    cln_up_told told = {0};
    bool sure = false;

    if (cln_up_given(scene->up) && !scene->up_by_gps) {
        memcpy(up, scene->up, sizeof scene->up);
        return true;
    }
    sure = estimate(scene, &told);
    memcpy(up, told.up, sizeof told.up);
    if (cln_normalise(up)) {
        if (cln_up_given(scene->up) && (told.what != CLN_UP_TOLD || cln_dot(up, scene->up) > APART))
            memcpy(up, scene->up, sizeof scene->up);
        snap(up);
        return sure || cln_up_given(scene->up);
    }
    memcpy(up, cln_up_given(scene->up) ? scene->up : (const double[3]){0, 0, 1}, 3 * sizeof *up);
    return cln_up_given(scene->up);
}

void cln_up_warn(const char *what, const double up[3])
{
    char other[96];
    double rounded[3];

    for (int a = 0; a < 3; a++)
        rounded[a] = 0 - round(1000 * up[a]) / 1000;
    cln_format(other, sizeof other, "%g,%g,%g", rounded[0], rounded[1], rounded[2]);
    cln_warn("%s: which way is up is a guess, as about as many photos show the scene one way up as "
             "the other; if it is upside down, give --up=%s",
             what, other);
}

bool cln_up_given(const double up[3])
{
    return up[0] != 0 || up[1] != 0 || up[2] != 0;
}

cln_status cln_up_check(const char *call, const double up[3])
{
    cln_status st = CLN_OK;
    double copy[3];

    memcpy(copy, up, sizeof copy);
    for (int a = 0; a < 3; a++)
        CLN_TRY(cln_given_number(call, "up", up[a], -LONGEST, LONGEST));
    if (cln_up_given(up) && !cln_normalise(copy))
        CLN_TRY(cln_fail(CLN_USAGE, "%s: up is too short to have a direction; give a longer one",
                         call));
done:
    return st;
}

cln_status cln_up_read(const char *name, const char *text, double up[3])
{
    const bool minus = text[0] == '-';
    const char *letter = text[minus] ? strchr("xyz", text[minus]) : NULL; /* strchr finds a 0 */

    memset(up, 0, 3 * sizeof *up);
    if (strcmp(text, "auto") == 0)
        return CLN_OK;
    if (letter && !text[minus + 1])
        up[letter[0] - 'x'] = minus ? -1 : 1;
    else if (!cln_reals_read(text, 3, up) || !cln_up_given(up) || cln_up_check(name, up) != CLN_OK)
        return cln_fail(CLN_USAGE,
                        "%s: '%s' is no direction; give x, y, z, -x, -y or -z, an axis of the "
                        "scene's frame, three numbers with commas, or auto, as the training "
                        "cameras tell",
                        name, text);
    return CLN_OK;
}
