/* A COLMAP sparse model of exact cameras and exact points, as text. See colmap.h. */
#include "colmap.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/rng.h"

enum { PER_VIEW = 100 }; /* pixels of a view where points are looked for */

static const double SAME =
    1e-4; /* a hit is the point itself if their distances differ by at most this share */

static cln_status open_file(const char *folder, const char *name, FILE **out)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(cln_path_join(&path, folder, name));
    *out = fopen(path, "w");
    if (!*out)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot write it", path));
done:
    free(path);
    return st;
}

static cln_status close_file(FILE *f, const char *folder)
{
    const bool bad = ferror(f) != 0;

    if ((fclose(f) != 0) | bad)
        return cln_fail(CLN_OUTPUT, "%s: cannot write the model", folder);
    return CLN_OK;
}

/* Unit quaternion of the rotation r, row-major, by its largest component. */
static void quaternion(const double r[9], double q[4])
{
    const double square[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8],
                              1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]};
    /* 4 q_i q_j */
    const double product[4][4] = {{square[0], r[7] - r[5], r[2] - r[6], r[3] - r[1]},
                                  {r[7] - r[5], square[1], r[3] + r[1], r[2] + r[6]},
                                  {r[2] - r[6], r[3] + r[1], square[2], r[7] + r[5]},
                                  {r[3] - r[1], r[2] + r[6], r[7] + r[5], square[3]}};
    int most = 0;

    for (int i = 1; i < 4; i++)
        if (square[i] > square[most])
            most = i;
    for (int i = 0; i < 4; i++)
        q[i] = 0.5 * product[most][i] / sqrt(square[most]);
}

static void write_image(FILE *f, int id, const char *name, const double m[12])
{
    double r[9], q[4];

    for (int i = 0; i < 9; i++)
        r[i] = m[4 * (i % 3) + i / 3]; /* transposed: world to camera */
    quaternion(r, q);
    fprintf(f, "%d %.17g %.17g %.17g %.17g", id, q[0], q[1], q[2], q[3]);
    for (int i = 0; i < 3; i++)
        fprintf(f, " %.17g", -(r[3 * i] * m[3] + r[3 * i + 1] * m[7] + r[3 * i + 2] * m[11]));
    fprintf(f, " %d %s.png\n\n", id, name);
}

/* Whether the camera sees the point of a surface. */
static bool sees(const world *w, const cln_camera *camera, const double point[3])
{
    double u, v, z, o[3], d[3], square = 0;
    hit h;

    if (!cln_camera_project(camera, point, &u, &v, &z) || z <= 0 || u < 0 || v < 0 ||
        u >= camera->width || v >= camera->height || !cln_camera_ray(camera, u, v, o, d) ||
        !shapes_hit(&w->shapes, vec3(o[0], o[1], o[2]), vec3(d[0], d[1], d[2]), 0, INFINITY, &h))
        return false;
    for (int a = 0; a < 3; a++)
        square += (point[a] - o[a]) * (point[a] - o[a]);
    return fabs(h.t - sqrt(square)) <= SAME * h.t;
}

/* Writes what a random place of the view shows, if two views see it. */
static void write_point(const colmap_scene *s, FILE *f, int view, int i, int *count)
{
    const cln_camera *camera = &s->exact[view];
    double o[3], d[3], point[3];
    float u[4];
    int views = 0;
    hit h;

    cln_uniform4((uint64_t)s->seed, CLN_STREAM_SCENE, 7, (uint32_t)(view * PER_VIEW + i), 0, u);
    if (!cln_camera_ray(camera, (double)u[0] * camera->width, (double)u[1] * camera->height, o,
                        d) ||
        !shapes_hit(&s->world->shapes, vec3(o[0], o[1], o[2]), vec3(d[0], d[1], d[2]), 0, INFINITY,
                    &h))
        return;
    for (int a = 0; a < 3; a++)
        point[a] = o[a] + h.t * d[a];
    for (int v = 0; v < s->count; v++)
        views += sees(s->world, &s->exact[v], point);
    if (views < 2)
        return;
    fprintf(f, "%d", ++*count);
    for (int a = 0; a < 3; a++)
        fprintf(f, " %.17g", s->unit * point[a] + s->offset[a]);
    fprintf(f, " 128 128 128 0.5");
    for (int v = 0; v < s->count; v++)
        if (sees(s->world, &s->exact[v], point))
            fprintf(f, " %d 0", v + 1);
    fprintf(f, "\n");
}

cln_status colmap_write(const colmap_scene *s, const cln_camera *cameras)
{
    cln_status st = CLN_OK;
    char *folder = NULL;
    FILE *f = NULL;
    int points = 0;

    CLN_TRY(cln_path_join(&folder, s->out, "sparse/0"));
    CLN_TRY(cln_make_dirs(folder));
    CLN_TRY(open_file(folder, "cameras.txt", &f));
    for (int v = 0; v < s->count; v++)
        fprintf(f, "%d PINHOLE %d %d %.17g %.17g %.17g %.17g\n", v + 1, cameras[v].width,
                cameras[v].height, cameras[v].fx, cameras[v].fy, cameras[v].cx, cameras[v].cy);
    CLN_TRY(close_file(f, folder));
    CLN_TRY(open_file(folder, "images.txt", &f));
    for (int v = 0; v < s->count; v++)
        write_image(f, v + 1, strchr(s->names[v], '/') + 1, cameras[v].c2w);
    CLN_TRY(close_file(f, folder));
    CLN_TRY(open_file(folder, "points3D.txt", &f));
    for (int v = 0; v < s->count; v++)
        for (int i = 0; i < PER_VIEW; i++)
            write_point(s, f, v, i, &points);
    CLN_TRY(close_file(f, folder));
done:
    free(folder);
    return st;
}
