/* Maps. See map.h. */
#include "render/map.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/image.h"
#include "io/mesh.h"

static const double MOST_PIXELS = 1999; /* of the longer side, where no spacing is given; and one
                                           more, as corners are at whole ones */
enum { CELL_BYTES = 400 };              /* of a height, with what stands behind it */

/* Cosines of 20 degrees, to which z is taken for up, as scenes on the earth have it, and of 2, to
 * which training cameras tell it. */
static const double NEARLY = 0.94, EXACT = 0.9994;

/* The axis that a direction is, to what training cameras can tell; else the direction. */
static void to_axis(const double direction[3], double out[3])
{
    memcpy(out, direction, 3 * sizeof *out);
    for (int a = 0; a < 3; a++)
        if (fabs(direction[a]) >= EXACT) {
            memset(out, 0, 3 * sizeof *out);
            out[a] = direction[a] < 0 ? -1 : 1;
        }
}

void cln_map_up(const cln_orbit_frame *seen, double up[3])
{
    double theirs[3];

    memcpy(up, (const double[3]){0, 0, 1}, 3 * sizeof *up);
    if (!seen)
        return;
    to_axis(seen->up, theirs);
    if (theirs[2] > EXACT)
        return;
    if (seen->guessed)
        cln_warn("--map looks along the scene's z, as the training cameras do not tell for sure "
                 "which way is up; perhaps it is --up=%.4g,%.4g,%.4g, or the opposite",
                 theirs[0], theirs[1], theirs[2]);
    else if (seen->up[2] >= NEARLY)
        cln_warn("--map looks along the scene's z; by the training cameras up is %.1f degrees from "
                 "it: --up=%.4g,%.4g,%.4g, unless z is the plumb line",
                 acos(seen->up[2]) * 180 / M_PI, theirs[0], theirs[1], theirs[2]);
    else {
        memcpy(up, theirs, sizeof theirs);
        cln_warn("--map: the scene's z is not up, so the map has a frame of its own, with the "
                 "training cameras' up (%.4g, %.4g, %.4g) in the scene's (\"axes\" in "
                 "render.json); --up z looks along z all the same",
                 up[0], up[1], up[2]);
    }
}

/* The least of 1, 2 and 5 times a power of ten that is no smaller. */
static double round_up(double x)
{
    const double ten = pow(10, floor(log10(x)));

    return x <= ten ? ten : x <= 2 * ten ? 2 * ten : x <= 5 * ten ? 5 * ten : 10 * ten;
}

void cln_map_axes(const double up[3], double axes[9])
{
    double turn[4];

    cln_mesh_upright(up, 2, turn);
    for (int k = 0; k < 3; k++) {
        double axis[3] = {0};

        axis[k] = 1;
        cln_mesh_turned(turn, axis, axis);
        for (int a = 0; a < 3; a++)
            axes[3 * a + k] = axis[a];
    }
}

/* The box that a corner-aligned box of the scene spans in the map's frame. */
static void span(const double axes[9], const double low[3], const double high[3], double map_low[3],
                 double map_high[3])
{
    for (int a = 0; a < 3; a++) {
        map_low[a] = map_high[a] = 0;
        for (int k = 0; k < 3; k++) {
            const double one = axes[3 * a + k] * low[k], other = axes[3 * a + k] * high[k];

            map_low[a] += fmin(one, other);
            map_high[a] += fmax(one, other);
        }
    }
}

cln_status cln_map_camera(const cln_space *space, const cln_crop *crop, const double axes[9],
                          double spacing, cln_camera *out)
{
    double box[6], low[3], high[3], sides[2];

    if (space->forward)
        return cln_fail(CLN_USAGE,
                        "--map: the model has --space ndc, which is seen from its cameras "
                        "alone; train with another --space");
    if (cln_crop_is_turned(crop))
        return cln_fail(CLN_USAGE,
                        "--map: its rows and columns are straight, and the box of --crop "
                        "is turned; give six numbers");
    for (int a = 0; a < 3; a++) {
        const double from = space->centre[a] - space->half, to = space->centre[a] + space->half;

        box[a] = !crop->on ? from : space->shell ? crop->box[a] : fmax(from, crop->box[a]);
        box[3 + a] = !crop->on ? to : space->shell ? crop->box[3 + a] : fmin(to, crop->box[3 + a]);
        if (!(box[a] < box[3 + a]))
            return cln_fail(CLN_USAGE, "--map: the box of --crop is outside the scene's cube");
    }
    span(axes, box, box + 3, low, high);
    for (int a = 0; a < 2; a++)
        sides[a] = high[a] - low[a];
    if (!(spacing > 0))
        spacing = round_up(fmax(sides[0], sides[1]) / MOST_PIXELS);
    low[0] = floor(low[0] / spacing + 1e-6) * spacing;  /* corners at whole pixels, as maps */
    high[1] = ceil(high[1] / spacing - 1e-6) * spacing; /* that lie over each other have them */
    sides[0] = fmax(1, ceil((high[0] - low[0]) / spacing - 1e-6));
    sides[1] = fmax(1, ceil((high[1] - low[1]) / spacing - 1e-6));
    if (fmax(sides[0], sides[1]) > CLN_IMAGE_MAX_SIDE || sides[0] * sides[1] > CLN_IMAGE_MAX_PIXELS)
        return cln_fail(CLN_USAGE,
                        "--map: %.0f x %.0f pixels of %g are more than the %d a side or %d in all "
                        "that are possible; give a larger --spacing, or a smaller box by --crop",
                        sides[0], sides[1], spacing, CLN_IMAGE_MAX_SIDE, CLN_IMAGE_MAX_PIXELS);
    *out = (cln_camera){.fx = 1 / spacing,
                        .fy = 1 / spacing,
                        .width = (int)sides[0],
                        .height = (int)sides[1],
                        .parallel = true};
    for (int a = 0; a < 3; a++) {
        out->c2w[4 * a] = axes[a];
        out->c2w[4 * a + 1] = -axes[3 + a];
        out->c2w[4 * a + 2] = -axes[6 + a];
        out->c2w[4 * a + 3] = axes[a] * low[0] + axes[3 + a] * high[1] + axes[6 + a] * high[2];
    }
    return CLN_OK;
}

void cln_map_corner(const cln_camera *c, const double offset[3], double corner[3])
{
    for (int k = 0; k < 3; k++) {
        corner[k] = offset[k];
        for (int a = 0; a < 3; a++)
            corner[k] += (k > 0 ? -1 : 1) * c->c2w[4 * a + k] * c->c2w[4 * a + 3];
    }
}

cln_status cln_map_write_world(const char *path, const cln_camera *camera, const double offset[3])
{
    char text[512];
    double corner[3];
    const double spacing = 1 / camera->fx;
    int bytes = 0;

    cln_map_corner(camera, offset, corner);
    bytes = cln_format(text, sizeof text, "%.15g\n0\n0\n%.15g\n%.15g\n%.15g\n", spacing, -spacing,
                       corner[0] + 0.5 * spacing, corner[1] - 0.5 * spacing);
    return cln_write_file(path, text, (size_t)bytes);
}

static bool shows(const cln_picture *p, size_t i)
{
    return p->opacity[i] >= CLN_SURFACE && !(p->seen && p->seen[i] == 0);
}

/* A number that is no height: below all of them. */
static double no_data(double top, const cln_picture *p)
{
    double none = -9999, lowest = INFINITY;

    for (size_t i = 0; i < (size_t)p->width * (size_t)p->height; i++)
        if (shows(p, i))
            lowest = fmin(lowest, top - (double)p->depth[i]);
    while (none > lowest - 1 && isfinite(none))
        none = 10 * none - 9;
    return none;
}

cln_status cln_map_write_heights(const char *path, const cln_camera *camera, const double offset[3],
                                 const cln_picture *p)
{
    cln_status st = CLN_OK;
    const double spacing = 1 / camera->fx;
    const int decimals = (int)fmin(fmax(ceil(-log10(spacing / 1000)), 0), 15);
    const size_t width = (size_t)p->width;
    cln_atomic_file *file = NULL;
    char head[512], cell[CELL_BYTES], empty[CELL_BYTES], *row = NULL;
    double corner[3], none = 0;
    size_t bytes = 0;

    cln_map_corner(camera, offset, corner);
    none = no_data(corner[2], p);
    bytes = (size_t)cln_format(
        head, sizeof head,
        "ncols %d\nnrows %d\nxllcorner %.15g\nyllcorner %.15g\ncellsize %.15g\n"
        "NODATA_value %.0f\n",
        p->width, p->height, corner[0], corner[1] - p->height * spacing, spacing, none);
    cln_format(empty, sizeof empty, "%.0f", none);
    CLN_TRY(cln_alloc(&row, width * CELL_BYTES, 1, "map"));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, head, bytes));
    for (int y = 0; y < p->height; y++) {
        bytes = 0;
        for (size_t x = 0; x < width; x++) {
            const size_t i = (size_t)y * width + x;
            const bool shown = shows(p, i);

            if (shown)
                cln_format(cell, sizeof cell, "%.*f", decimals, corner[2] - (double)p->depth[i]);
            bytes = (size_t)(stpcpy(row + bytes, shown ? cell : empty) - row);
            row[bytes++] = x + 1 < width ? ' ' : '\n';
        }
        CLN_TRY(cln_atomic_write(file, row, bytes));
    }
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    free(row);
    return st;
}
