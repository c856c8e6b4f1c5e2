/* Rays of extreme cameras against the double camera of scene/camera.c: far ones, tiny and huge
 * fields of view, cubes of tiny and huge units, lenses up to their fold and beyond. See
 * extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* A batch of rays on the device: every view has the same number. */
typedef struct shot {
    int views, rays;
    cln_camera *cameras; /* [views] */
    cln_pixel *pixels;   /* [rays] */
    float (*o)[4], (*d)[4];
} shot;

static cln_status make(shot *s, int views, int each)
{
    cln_status st = CLN_OK;
    const size_t rays = (size_t)(views * each);

    *s = (shot){.views = views, .rays = views * each};
    CLN_TRY(cln_alloc(&s->cameras, (size_t)views, sizeof *s->cameras, "self-test"));
    CLN_TRY(cln_alloc(&s->pixels, rays, sizeof *s->pixels, "self-test"));
    CLN_TRY(cln_alloc(&s->o, rays, sizeof *s->o, "self-test"));
    CLN_TRY(cln_alloc(&s->d, rays, sizeof *s->d, "self-test"));
    for (int r = 0; r < s->rays; r++)
        s->pixels[r].view = (uint32_t)(r / each);
done:
    return st;
}

static void free_shot(shot *s)
{
    free(s->cameras);
    free(s->pixels);
    free(s->o);
    free(s->d);
}

cln_status cln_extremes_shoot(cln_pipeline *p, const cln_space *space, const cln_extremes_shot *s)
{
    cln_status st = CLN_OK;
    const cln_camera **list = NULL;
    static const float white[4] = {1, 1, 1, 1}; /* read later, by the queue */

    CLN_TRY(cln_alloc(&list, (size_t)s->views, sizeof *list, "self-test"));
    for (int v = 0; v < s->views; v++)
        list[v] = &s->cameras[v];
    CLN_TRY(cln_pipeline_cameras(p, list, s->views, space));
    CLN_TRY(cln_pipeline_batch(p, s->pixels, s->rays, NULL, white));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_o, s->bytes));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_d, s->bytes));
    CLN_TRY(cln_stage_rays(p, s->rays));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_o, 0, s->o, s->bytes));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_d, 0, s->d, s->bytes));
done:
    free(list);
    return st;
}

static cln_status shoot(cln_pipeline *p, shot *s, const cln_space *space)
{
    const cln_extremes_shot all = {
        s->views, s->rays, s->cameras, s->pixels, (size_t)s->rays * sizeof *s->o, s->o, s->d};

    return cln_extremes_shoot(p, space, &all);
}

/* The float64 camera's ray, in the cube; false beyond a fold. */
static bool exact_ray(const shot *s, const cln_space *space, int r, double o[3], double d[3])
{
    const cln_pixel *pixel = &s->pixels[r];
    double origin[3], direction[3];
    const bool found =
        cln_camera_ray(&s->cameras[pixel->view], pixel->x + 0.5, pixel->y + 0.5, origin, direction);

    cln_space_ray_to_cube(space, origin, direction, o, d);
    return found;
}

void cln_extremes_camera(int v, const cln_space *space, double distance, double aside,
                         cln_camera *c)
{
    const double yaw = 0.37 * v, up = 0.21 * v;
    const double z[3] = {sin(yaw) * cos(up), sin(up), cos(yaw) * cos(up)};
    const double x[3] = {cos(yaw), 0, -sin(yaw)};
    const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                         z[0] * x[1] - z[1] * x[0]};

    memset(c, 0, sizeof *c);
    for (int a = 0; a < 3; a++) {
        c->c2w[4 * a] = x[a];
        c->c2w[4 * a + 1] = y[a];
        c->c2w[4 * a + 2] = z[a];
        c->c2w[4 * a + 3] = space->centre[a] - space->half * distance * (z[a] + aside * x[a]);
    }
}

/* ---- far cameras, in cubes of any unit ---- */

void cln_extremes_far(int i, const cln_space *space, cln_camera *k)
{
    static const cln_lens lenses[] = {CLN_LENS_OPENCV, CLN_LENS_OPENCV_FISHEYE, CLN_LENS_EUCM};
    const double distance = pow(10, 1 + i / 2), aside = i % 2 ? 0.6 : 0;

    cln_extremes_camera(i < 2 ? 0 : 1 + i % 5, space, distance, aside, k);
    k->width = k->height = 500;
    k->fx = k->fy = 100 * distance; /* the cube has 200 to 350 pixels */
    k->cx = k->cy = 250;
    k->lens = lenses[i % 3];
    if (k->lens == CLN_LENS_EUCM) {
        k->distortion[0] = 0.5;
        k->distortion[1] = 1;
    }
    if (aside > 0) { /* brings the cube into the image */
        double u = 0, v = 0, z = 0;

        cln_camera_project(k, space->centre, &u, &v, &z);
        k->cx += 250 - u;
        k->cy += 250 - v;
    }
}

/* Cameras 10 to 10^6 half sides away see the cube on and off their axis, through several lenses.
 * Near the cube, rays must be where the float64 camera's are, to a fraction of the deepest leaf and
 * of a pixel, and depths must be right. */
static cln_status check_far(cln_checks *c, const cln_space *space, cln_extreme *lateral,
                            cln_extreme *depth, cln_extreme *starts)
{
    enum { FAR = CLN_EXTREMES_FAR, EACH = 60 };
    cln_status st = CLN_OK;
    shot s = {0};

    CLN_TRY(make(&s, FAR, EACH));
    for (int i = 0; i < FAR; i++)
        cln_extremes_far(i, space, &s.cameras[i]);
    for (int r = 0; r < s.rays; r++) {
        s.pixels[r].x = (uint32_t)cln_check_uniform(71, (uint32_t)r, 150, 350);
        s.pixels[r].y = (uint32_t)cln_check_uniform(72, (uint32_t)r, 150, 350);
    }
    CLN_TRY(shoot(c->p, &s, space));
    for (int r = 0; r < s.rays; r++) {
        const int i = (int)s.pixels[r].view;
        const double away = pow(10, 1 + i / 2);
        /* rounding of positions of size 4, and of the pixel's place, which float32 has to 6e-8 of
         * its distance from the principal point */
        const double most = 2e-6 + 2e-7 * fabs(s.cameras[i].cx) / 100;
        double o[3], d[3], near = 0, t = 0, off = 0;

        CLN_ASSERT(exact_ray(&s, space, r, o, d));
        for (int a = 0; a < 3; a++) /* t where the ray is nearest the centre */
            near -= (double)s.o[r][a] * (double)s.d[r][a];
        for (int a = 0; a < 3; a++)
            t += (s.o[r][a] + near * (double)s.d[r][a] - o[a]) * d[a];
        for (int a = 0; a < 3; a++)
            off = hypot(off, s.o[r][a] + near * (double)s.d[r][a] - o[a] - t * d[a]);
        cln_extreme_meet(lateral, off, 0, 1, most, "%g half-cubes, of %g units", away, space->half);
        cln_extreme_meet(depth, near + (double)s.o[r][3], t, away, 1e-6,
                         "%g half-cubes, of %g units", away, space->half);
        if (away > 40) /* t begins at the cube: it is 0 to 8 where the ray is nearest the centre */
            cln_extreme_meet(starts, near, 4, 1, 4, "%g half-cubes, of %g units", away,
                             space->half);
    }
done:
    free_shot(&s);
    return st;
}

static cln_status check_all_far(cln_checks *c)
{
    static const cln_space spaces[] = {{.centre = {4.5e5, 5.4e6, 120}, .half = 0.5}, /* UTM */
                                       {.centre = {2e-6, -1e-6, 0}, .half = 1e-6},
                                       {.centre = {3e3, 2e3, 1e3}, .half = 1e3},
                                       {.centre = {3e6, -2e6, 1e6}, .half = 1e6}};
    static const char range[] = "cameras 10 to 10^6 half-cubes away, cubes of 1e-6 to 1e6 units";
    cln_status st = CLN_OK;
    cln_extreme lateral = cln_extreme_row(c, "place near the cube", range);
    cln_extreme depth = cln_extreme_row(c, "depth / distance", range);
    cln_extreme starts = cln_extreme_row(c, "t begins at the cube", "cameras 100 to 10^6 away");

    for (size_t i = 0; i < sizeof spaces / sizeof *spaces; i++)
        CLN_TRY(check_far(c, &spaces[i], &lateral, &depth, &starts));
    cln_extreme_report(&lateral);
    cln_extreme_report(&depth);
    cln_extreme_report(&starts);
done:
    return st;
}

/* ---- fields of view ---- */

static cln_status check_fields(cln_checks *c)
{
    enum { EACH = 64 };
    static const double degrees[] = {0.01, 0.1, 1, 10, 60, 120, 160, 170};
    enum { FIELDS = sizeof degrees / sizeof *degrees };
    cln_status st = CLN_OK;
    cln_extreme directions =
        cln_extreme_row(c, "direction", "fields of view of 0.01 to 170 degrees, along axes or not");
    cln_extreme lengths = cln_extreme_row(c, "length of directions", directions.range);
    shot s = {0};

    CLN_TRY(make(&s, 2 * FIELDS, EACH));
    for (int v = 0; v < s.views; v++) {
        cln_camera *k = &s.cameras[v];

        cln_extremes_camera(v < FIELDS ? 0 : v, &cln_space_unit, 3, 0, k);
        k->width = k->height = 512;
        k->cx = k->cy = 255.5; /* a pixel's centre: rays straight along the axis */
        k->fx = k->fy = 256 / tan(degrees[v % FIELDS] * M_PI / 360);
    }
    for (int r = 0; r < s.rays; r++) {
        const int i = r % EACH;

        s.pixels[r].x = i == 0 ? 255 : (uint32_t)(i % 8 * 73);
        s.pixels[r].y = i == 0 ? 255 : (uint32_t)(i / 8 * 73);
    }
    CLN_TRY(shoot(c->p, &s, &cln_space_unit));
    for (int r = 0; r < s.rays; r++) {
        const double field = degrees[s.pixels[r].view % FIELDS];
        double o[3], d[3], length = 0;

        CLN_ASSERT(exact_ray(&s, &cln_space_unit, r, o, d));
        for (int a = 0; a < 3; a++) {
            cln_extreme_meet(&directions, s.d[r][a], d[a], 1, 5e-7, "%g degrees, pixel %u, %u",
                             field, s.pixels[r].x, s.pixels[r].y);
            length += (double)s.d[r][a] * s.d[r][a];
        }
        cln_extreme_meet(&lengths, sqrt(length), 1, 1, 5e-7, "%g degrees", field);
    }
    cln_extreme_report(&directions);
    cln_extreme_report(&lengths);
done:
    free_shot(&s);
    return st;
}

/* ---- lenses whose image holds pixels beyond the fold ---- */

static const struct {
    const char *name;
    cln_lens lens;
    double params[CLN_LENS_PARAMS];
    double wide, share; /* image width over fx; share of pixels with a ray, about */
} folds[] = {
    {"OPENCV", CLN_LENS_OPENCV, {-0.5}, 1.6, 0.363},
    {"OPENCV, four", CLN_LENS_OPENCV, {-0.4, 0.05, -0.03, 0.02}, 1.8, 0.41},
    /* Newton's method alone ends beyond the fold for a third of these rays */
    {"OPENCV, outwards first", CLN_LENS_OPENCV, {1, -0.5}, 4, 0.557},
    {"FULL_OPENCV", CLN_LENS_FULL_OPENCV, {-0.4, 0, 0, 0, 0, 0.1}, 1.5, 0.444},
    {"OPENCV_FISHEYE", CLN_LENS_OPENCV_FISHEYE, {-0.1}, 3, 0.517},
    {"FOV", CLN_LENS_FOV, {1.5}, 2.5, 0.551},
    {"DIVISION", CLN_LENS_DIVISION, {0.25}, 4.5, 0.62},
    {"EUCM", CLN_LENS_EUCM, {1, 1}, 2.2, 0.649},
};
enum { FOLDS = sizeof folds / sizeof *folds, SIDE = 48 };

/* Near the fold a direction's place in the image hardly moves, so host and device may differ. */
static cln_status check_folds(cln_checks *c)
{
    static const char range[] = "lenses from the middle to beyond their fold";
    cln_status st = CLN_OK;
    cln_extreme finite = cln_extreme_row(c, "every ray", range);
    cln_extreme marks = cln_extreme_row(c, "rays beyond a fold miss the cube", range);
    cln_extreme judged = cln_extreme_row(c, "share of pixels judged otherwise, or off 1e-3", range);
    cln_extreme shares = cln_extreme_row(c, "share of pixels with rays", range);
    shot s = {0};

    CLN_TRY(make(&s, FOLDS, SIDE * SIDE));
    for (int v = 0; v < FOLDS; v++) {
        cln_camera *k = &s.cameras[v];

        cln_extremes_camera(1, &cln_space_unit, 3, 0, k);
        k->lens = folds[v].lens;
        memcpy(k->distortion, folds[v].params, sizeof k->distortion);
        k->width = k->height = SIDE;
        k->fx = k->fy = SIDE / folds[v].wide;
        k->cx = k->cy = SIDE / 2;
    }
    for (int r = 0; r < s.rays; r++) {
        s.pixels[r].x = (uint32_t)(r % SIDE);
        s.pixels[r].y = (uint32_t)(r / SIDE % SIDE);
    }
    CLN_TRY(shoot(c->p, &s, &cln_space_unit));
    for (int v = 0; v < FOLDS; v++) {
        int rays = 0, differ = 0;

        for (int r = v * SIDE * SIDE; r < (v + 1) * SIDE * SIDE; r++) {
            const bool sees = s.o[r][0] != 3;
            double o[3], d[3], off = 0;
            const bool found = exact_ray(&s, &cln_space_unit, r, o, d);

            rays += found;
            for (int a = 0; a < 3; a++) {
                cln_extreme_finite(&finite, s.o[r][a], "%s, pixel %u, %u", folds[v].name,
                                   s.pixels[r].x, s.pixels[r].y);
                cln_extreme_finite(&finite, s.d[r][a], "%s, pixel %u, %u", folds[v].name,
                                   s.pixels[r].x, s.pixels[r].y);
                off = fmax(off, fabs((double)s.d[r][a] - d[a]));
                if (!sees) {
                    cln_extreme_meet(&marks, s.o[r][a], 3, 1, 0, "%s", folds[v].name);
                    cln_extreme_meet(&marks, s.d[r][a], a == 0, 1, 0, "%s", folds[v].name);
                }
            }
            differ += found != sees || (found && !(off <= 1e-3));
        }
        cln_extreme_meet(&judged, (double)differ / (SIDE * SIDE), 0, 1, 8.0 / (SIDE * SIDE), "%s",
                         folds[v].name);
        cln_extreme_meet(&shares, (double)rays / (SIDE * SIDE), folds[v].share, 1, 0.03, "%s",
                         folds[v].name);
    }
    cln_extreme_report(&finite);
    cln_extreme_report(&marks);
    cln_extreme_report(&judged);
    cln_extreme_report(&shares);
done:
    free_shot(&s);
    return st;
}

cln_status cln_extremes_cameras(cln_checks *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(check_all_far(c));
    CLN_TRY(check_fields(c));
    CLN_TRY(check_folds(c));
done:
    return st;
}
