/* Rays of a shell space, from inside its core and from far beyond it to infinity: against the
 * host's lines of scene/space.h, in scenes of tiny and huge units. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "scene/scene.h"

enum { VIEWS = 8, EACH = 90, RAYS = VIEWS * EACH, SIZE = 120, PLACES = 24 };

/* Half-cubes from the centre: in the core, on its face, a rounding beside it, outside, far away. */
static const double distances[VIEWS] = {0.01, 0.7, 1, 1.0000001, 1.7, 12, 150, 1000};

typedef struct batch {
    cln_camera cameras[VIEWS];
    cln_pixel pixels[RAYS];
    float o[RAYS][CLN_LINE_ROWS][4], d[RAYS][CLN_LINE_ROWS][4];
} batch;

/* View v is before the face of axis v % 3, a little aside. Those inside look anywhere, those
 * outside towards the core. */
static void make_camera(int v, const cln_space *space, cln_camera *c)
{
    const int ahead = v % 3, right = (v + 1) % 3, down = (v + 2) % 3;

    memset(c, 0, sizeof *c);
    c->c2w[4 * ahead + 2] = c->c2w[4 * right] = c->c2w[4 * down + 1] = 1;
    for (int a = 0; a < 3; a++)
        c->c2w[4 * a + 3] = space->centre[a] + space->half * distances[v] *
                                                   (a == ahead   ? -1
                                                    : a == right ? 0.13
                                                                 : -0.31);
    c->width = c->height = SIZE;
    c->fx = c->fy = 0.4 * SIZE * fmax(1, 0.25 * distances[v]);
    c->cx = 0.5 * SIZE + 0.13;
    c->cy = 0.5 * SIZE - 0.17;
    if (v >= 5) { /* brings the core into the image */
        c->cx -= c->fx * -0.13;
        c->cy -= c->fy * 0.31;
    }
}

static cln_status shoot(cln_pipeline *p, const cln_space *space, batch *b)
{
    for (int v = 0; v < VIEWS; v++) {
        make_camera(v, space, &b->cameras[v]);
    }
    for (uint32_t r = 0; r < RAYS; r++) {
        b->pixels[r] = (cln_pixel){.view = r % VIEWS};
        b->pixels[r].x = (uint32_t)cln_check_uniform(121, r, 0, SIZE);
        b->pixels[r].y = (uint32_t)cln_check_uniform(122, r, 0, SIZE);
    }
    return cln_extremes_shoot(
        p, space,
        &(cln_extremes_shot){VIEWS, RAYS, b->cameras, b->pixels, sizeof b->o, b->o, b->d});
}

typedef struct rows {
    cln_extreme places, ends, compared;
} rows;

/* Compares a ray's lines with the host's, at places that are not next to a line's end: there the
 * device may be on the next one. Positions have the rounding of the camera's place. Returns how
 * many places were compared. */
static int check_ray(const cln_space *space, const batch *b, int r, rows *out)
{
    const cln_pixel *pixel = &b->pixels[r];
    const double far = distances[pixel->view], bound = 5e-6 + 1e-7 * far;
    double origin[3], direction[3], u[3], along[3], end = 0;
    cln_space_line lines[CLN_SPACE_LINES];
    int count = 0, used = 1, compared = 0;

    CLN_ASSERT(cln_camera_ray(&b->cameras[pixel->view], pixel->x + 0.5, pixel->y + 0.5, origin,
                              direction));
    cln_space_ray_to_cube(space, origin, direction, u, along);
    count = cln_space_lines(space, origin, direction, 0, lines);
    for (int a = 0; a < 3; a++) /* row 0: the scene's ray */
        cln_extreme_meet(&out->places, b->o[r][0][a], u[a], 1, bound, "view %u's place",
                         pixel->view);
    for (; used < CLN_LINE_ROWS && b->o[r][used][3] < 1e30f; used++) {
        cln_extreme_meet(&out->ends, b->o[r][used][3], end, 1, 1e-6, "ray %d, line %d's begin", r,
                         used);
        end = b->d[r][used][3];
    }
    cln_extreme_meet(&out->ends, end, lines[count - 1].end, 1, bound, "ray %d, %g half-cubes away",
                     r, far);
    for (int k = 0; k < PLACES && used > 1; k++) {
        const double t = (k + 0.5) / PLACES * end;
        int line = 0, row = 1;

        while (line + 1 < count && t >= lines[line + 1].begin)
            line++;
        while (row + 1 < used && (double)b->o[r][row + 1][3] <= t)
            row++;
        if (fmin(t - lines[line].begin, lines[line].end - t) < 4 * bound)
            continue;
        for (int a = 0; a < 3; a++) {
            const double want = lines[line].origin[a] + t * lines[line].direction[a];
            const double got = b->o[r][row][a] + t * (double)b->d[r][row][a];

            cln_extreme_meet(&out->places, got, want, 1, bound, "ray %d, %g half-cubes away", r,
                             far);
        }
        compared++;
    }
    return compared;
}

cln_status cln_extremes_shell(cln_checks *c)
{
    static const double units[] = {1e-6, 1, 1e6};
    static const char range[] =
        "cameras 0.01 to 1000 half-cubes away, units of 1e-6 to 1e6, to infinity";
    cln_status st = CLN_OK;
    rows out = {cln_extreme_row(c, "places along the lines", range),
                cln_extreme_row(c, "begins and ends", range),
                cln_extreme_row(c, "share of places not compared", range)};
    batch *b = NULL;

    CLN_TRY(cln_alloc(&b, 1, sizeof *b, "self-test"));
    for (size_t i = 0; i < sizeof units / sizeof *units; i++) {
        const cln_space space = {.centre = {3 * units[i], -2 * units[i], 0.5 * units[i]},
                                 .half = units[i],
                                 .shell = true};
        int compared = 0;

        CLN_TRY(shoot(c->p, &space, b));
        for (int r = 0; r < RAYS; r++)
            compared += check_ray(&space, b, r, &out);
        cln_extreme_meet(&out.compared, (double)compared / (RAYS * PLACES), 1, 1, 0.1,
                         "a unit of %g", units[i]);
    }
    cln_extreme_report(&out.places);
    cln_extreme_report(&out.ends);
    cln_extreme_report(&out.compared);
done:
    free(b);
    return st;
}
