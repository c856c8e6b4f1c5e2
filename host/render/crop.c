/* Checks a box and crops pictures to it. See crop.h; the geometry is scene/space.h's. */
#include "render/crop.h"

#include <math.h>
#include <string.h>

#include "base/log.h"
#include "scene/vectors.h"

cln_status cln_crop_set(const char *name, const double box[6], const double angle[3], cln_crop *out)
{
    const double c[3] = {cos(angle[0]), cos(angle[1]), cos(angle[2])};
    const double s[3] = {sin(angle[0]), sin(angle[1]), sin(angle[2])};
    const double axes[9] = {c[2] * c[1],
                            s[2] * c[1],
                            0 - s[1],
                            c[2] * s[1] * s[0] - s[2] * c[0],
                            s[2] * s[1] * s[0] + c[2] * c[0],
                            c[1] * s[0],
                            c[2] * s[1] * c[0] + s[2] * s[0],
                            s[2] * s[1] * c[0] - c[2] * s[0],
                            c[1] * c[0]};

    memset(out, 0, sizeof *out);
    for (int a = 0; a < 3; a++)
        if (!(isfinite(box[a]) && isfinite(box[3 + a]) && box[a] < box[3 + a]))
            return cln_fail(
                CLN_USAGE,
                "%s: the minimum %g is not below the maximum %g along %c; give x0,y0,z0,x1,y1,z1, "
                "the lowest and the highest corner, in the scene's units",
                name, box[a], box[3 + a], "xyz"[a]);
    if (!isfinite(angle[0] + angle[1] + angle[2]))
        return cln_fail(CLN_USAGE, "%s: angles about x, y and z must be numbers", name);
    memcpy(out->box, box, sizeof out->box);
    if (angle[0] != 0 || angle[1] != 0 || angle[2] != 0)
        memcpy(out->turn, axes, sizeof axes);
    out->on = true;
    return CLN_OK;
}

cln_status cln_crop_read(const char *name, const char *text, double numbers[CLN_CROP_NUMBERS])
{
    memset(numbers, 0, CLN_CROP_NUMBERS * sizeof *numbers);
    if (!cln_reals_read(text, 6, numbers) && !cln_reals_read(text, CLN_CROP_NUMBERS, numbers))
        return cln_fail(CLN_USAGE,
                        "%s: give six numbers with commas, x0,y0,z0,x1,y1,z1, or nine: the last "
                        "three turn the box about x, y and z, in degrees",
                        name);
    return CLN_OK;
}

cln_status cln_crop_from_numbers(const char *name, const double numbers[CLN_CROP_NUMBERS],
                                 cln_crop *out)
{
    double angle[3];

    for (int a = 0; a < 3; a++)
        angle[a] = numbers[6 + a] * M_PI / 180;
    return cln_crop_set(name, numbers, angle, out);
}

cln_status cln_crop_of_option(const char *text, bool *cropped, double box[6], double turn[3])
{
    cln_status st = CLN_OK;
    double numbers[CLN_CROP_NUMBERS];

    if (!text)
        return CLN_OK;
    CLN_TRY(cln_crop_read("--crop", text, numbers));
    memcpy(box, numbers, 6 * sizeof *box);
    memcpy(turn, numbers + 6, 3 * sizeof *turn);
    *cropped = true;
done:
    return st;
}

cln_status cln_crop_of_desc(bool cropped, const double box[6], const double turn[3], cln_crop *out)
{
    double numbers[CLN_CROP_NUMBERS];

    memset(out, 0, sizeof *out);
    if (!cropped)
        return CLN_OK;
    memcpy(numbers, box, 6 * sizeof *box);
    memcpy(numbers + 6, turn, 3 * sizeof *turn);
    return cln_crop_from_numbers("--crop", numbers, out);
}

bool cln_crop_is_turned(const cln_crop *crop)
{
    for (int i = 0; i < 9; i++)
        if (crop->turn[i] != 0)
            return true;
    return false;
}

double cln_crop_level(const cln_crop *crop, const double up[3], double numbers[CLN_CROP_NUMBERS])
{
    double axes[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, from[3], about[3], cosine = 0;

    if (cln_crop_is_turned(crop))
        memcpy(axes, crop->turn, sizeof axes);
    for (int i = 0; i < 3; i++) {
        const double along = cln_dot(axes[i], up);

        if (fabs(along) <= cosine)
            continue;
        cosine = fabs(along);
        for (int a = 0; a < 3; a++)
            from[a] = along < 0 ? -axes[i][a] : axes[i][a];
    }
    cln_cross(from, up, about); /* its length is the sine; the cosine is 0.57 or more */
    for (int i = 0; i < 3; i++) {
        const double along = cln_dot(about, axes[i]) / (1 + cosine);
        double across[3];

        cln_cross(about, axes[i], across);
        for (int a = 0; a < 3; a++)
            axes[i][a] = cosine * axes[i][a] + across[a] + along * about[a];
    }
    memcpy(numbers, crop->box, sizeof crop->box);
    numbers[6] = atan2(axes[1][2], axes[2][2]) * 180 / M_PI;
    numbers[7] = asin(fmax(-1, fmin(1, -axes[0][2]))) * 180 / M_PI;
    numbers[8] = atan2(axes[0][1], axes[0][0]) * 180 / M_PI;
    return cosine;
}

/* Turns a half-space of u into one of the cube that holds in the piece of a shell space where the
 * point is. In a face it is multiplied by w, which makes it linear. */
static void plane_of_piece(const float plane[4], const double point[3], double out[4])
{
    int axis = -1;

    for (int a = 0; a < 3; a++)
        if (fabs(point[a]) > 0.5)
            axis = a;
    if (axis < 0) {
        for (int a = 0; a < 3; a++)
            out[a] = 2.0 * plane[a];
        out[3] = plane[3];
        return;
    }
    const double sign = point[axis] < 0 ? -1 : 1; /* w = 2 - 2 s p_a, u_a w = s, u_b w = 2 p_b */

    for (int a = 0; a < 3; a++)
        out[a] = a == axis ? -2 * sign * plane[3] : 2.0 * plane[a];
    out[3] = 2.0 * plane[3] + sign * plane[axis];
}

/* Is the whole leaf outside one side of the box? */
static bool is_outside(const cln_space *space, const cln_crop *crop, const float box[4])
{
    const double half = 0.5 * (double)box[3];
    const double middle[3] = {box[0] + half, box[1] + half, box[2] + half};

    for (int i = 0; i < 6; i++) {
        double plane[4], most = 0;

        if (space->shell)
            plane_of_piece(crop->planes[i], middle, plane);
        else
            for (int k = 0; k < 4; k++)
                plane[k] = crop->planes[i][k];
        most = plane[3];
        for (int a = 0; a < 3; a++)
            most += plane[a] * middle[a] + fabs(plane[a]) * half;
        if (most < 0)
            return true;
    }
    return false;
}

/* Is a leaf of a shell space beyond the cube? */
static bool is_beyond(const float box[4])
{
    for (int a = 0; a < 3; a++)
        if (fabsf(box[a] + 0.5f * box[3]) > 0.5f)
            return true;
    return false;
}

/* core: of a shell space, leaves beyond the cube do not count. */
static bool is_empty(const cln_space *space, const cln_octree *tree, bool core, cln_crop *crop)
{
    cln_crop_place(space, crop);
    for (int i = 0; i < tree->leaf_count; i++) {
        float box[4];

        cln_octree_box(tree, tree->leaf[i], box);
        if (!(core && space->shell && is_beyond(box)) && !is_outside(space, crop, box))
            return false;
    }
    return true;
}

bool cln_crop_is_empty(const cln_space *space, const cln_octree *tree, cln_crop *crop)
{
    return is_empty(space, tree, false, crop);
}

void cln_crop_cube(const cln_space *space, char text[CLN_BOX_BYTES])
{
    double box[6];

    for (int i = 0; i < 6; i++)
        box[i] = space->centre[i % 3] + (i < 3 ? -space->half : space->half);
    cln_box_write(box, 2 * space->half, text);
}

void cln_crop_warn(const char *name, const cln_space *space, const cln_octree *tree, cln_crop *crop)
{
    char text[CLN_BOX_BYTES];

    if (!is_empty(space, tree, true, crop))
        return;
    cln_crop_cube(space, text);
    if (space->forward)
        cln_warn("%s: nothing is in this box, as no leaf of the run reaches into it", name);
    else
        cln_warn("%s: %s as no leaf of the run%s reaches into it; the scene's cube is %s, in its "
                 "own coordinates, to which no offset is added",
                 name,
                 cln_crop_is_empty(space, tree, crop) ? "nothing is in this box,"
                                                      : "little is in this box,",
                 space->shell ? " within the cube" : "", text);
}

/* Of a plain or shell space, whose crop is placed. */
static bool holds_cube(const cln_crop *crop)
{
    for (int corner = 0; corner < 8; corner++) {
        float at[3];

        for (int a = 0; a < 3; a++)
            at[a] = corner >> a & 1 ? 1 : -1;
        if (cln_crop_depth((const float(*)[4])crop->planes, at) < 0)
            return false;
    }
    return true;
}

cln_status cln_crop_check(const char *name, const cln_space *space, const cln_octree *tree,
                          cln_crop *crop)
{
    char text[CLN_BOX_BYTES];

    const bool empty = crop->on && is_empty(space, tree, true, crop);

    cln_crop_cube(space, text);
    if (crop->on && !empty && !space->forward && holds_cube(crop))
        cln_warn("%s: this box cuts nothing off, as all of the scene's cube, %s, is in it; its "
                 "numbers are in the scene's units",
                 name, text);
    if (!empty)
        return CLN_OK;
    if (space->forward)
        return cln_fail(CLN_USAGE,
                        "%s: nothing is in this box, as no leaf of the run reaches into it", name);
    return cln_fail(CLN_USAGE,
                    "%s: nothing is in this box, as no leaf of the run%s reaches into it; the "
                    "scene's cube is %s",
                    name, space->shell ? " within the cube" : "", text);
}

/* half +- axis (p - middle) >= 0 */
static void turned_planes(const cln_space *space, const cln_crop *crop, float planes[6][4])
{
    for (int i = 0; i < 6; i++) {
        const double *axis = crop->turn + 3 * (i % 3), sign = i < 3 ? 1 : -1;
        double plane[4] = {0, 0, 0, 0.5 * (crop->box[i % 3 + 3] - crop->box[i % 3])};

        for (int a = 0; a < 3; a++) {
            plane[a] = sign * axis[a];
            plane[3] -= plane[a] * 0.5 * (crop->box[a] + crop->box[a + 3]);
        }
        cln_space_plane_to_cube(space, plane, planes[i]);
    }
}

void cln_crop_place(const cln_space *space, cln_crop *crop)
{
    if (cln_crop_is_turned(crop))
        turned_planes(space, crop, crop->planes);
    else
        cln_space_box_to_planes(space, crop->box, crop->planes);
}

double cln_crop_depth(const float planes[6][4], const float point[3])
{
    double least = INFINITY;

    for (int i = 0; i < 6; i++) {
        double depth = planes[i][3];

        for (int a = 0; a < 3; a++)
            depth += (double)planes[i][a] * point[a];
        least = fmin(least, depth);
    }
    return least;
}

void cln_crop_span(const cln_space *space, const cln_crop *crop, double low[3], double high[3])
{
    double corners[2][3];

    for (int a = 0; a < 3; a++) {
        double reach = 0;

        for (int k = 0; k < 3; k++)
            reach += 0.5 * (crop->box[3 + k] - crop->box[k]) * fabs(crop->turn[3 * k + a]);
        if (!cln_crop_is_turned(crop))
            reach = 0.5 * (crop->box[3 + a] - crop->box[a]);
        corners[0][a] = 0.5 * (crop->box[a] + crop->box[3 + a]) - reach;
        corners[1][a] = 0.5 * (crop->box[a] + crop->box[3 + a]) + reach;
    }
    cln_space_point_to_cube(space, corners[0], low);
    cln_space_point_to_cube(space, corners[1], high);
}

cln_status cln_crop_use(cln_pipeline *p, const cln_space *space, cln_crop *crop)
{
    cln_status st = CLN_OK;

    p->crop = NULL;
    if (!crop || !crop->on)
        return CLN_OK;
    CLN_TRY(cln_pipeline_want(p, CLN_PROGRAM_BIT(sampling_crop)));
    cln_crop_place(space, crop);
    p->crop = (const float(*)[4])crop->planes;
done:
    return st;
}
