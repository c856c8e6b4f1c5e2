/* export --points: points on the surface that --mesh writes, at random in equal shares of its area,
 * so that their density is the same everywhere, whatever the views were; in a forward space by its
 * area in the cube, so that it falls with the distance, as detail does. (Depths of rendered views
 * would crowd where cameras are near, and lie between two surfaces along every edge.) */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "export/mesh.h"
#include "export/surface.h"
#include "scene/vectors.h"

enum { STANDARD_COUNT = 200000, MOST_POINTS = 100000000 };

/* Area of a face, in the cube. */
static double area_of(const cln_surface *s, size_t face)
{
    double n[3];

    cln_surface_across(s, face, n);
    return 0.5 * sqrt(cln_dot(n, n));
}

static cln_status count_points(const cln_export_job *job, double area, size_t *count)
{
    const cln_export_desc *desc = job->desc;
    const double spacing = desc->spacing;
    double wanted = desc->count > 0 ? (double)desc->count : STANDARD_COUNT;

    if (spacing > 0) {
        const double half = cln_space_distance_to_scene(&job->opened.model.space, 1);

        wanted = fmax(1, round(area * half * half / (spacing * spacing)));
    }
    if (wanted > MOST_POINTS || wanted * 64 > cln_host_memory() / 2)
        return cln_fail(CLN_USAGE,
                        "--points: %.0f points are more than %s; give a smaller --count or a "
                        "larger --spacing",
                        wanted,
                        wanted > MOST_POINTS ? "the most, 100,000,000"
                                             : "this machine's memory has room for");
    *count = (size_t)wanted;
    return CLN_OK;
}

/* Point i on a face: its place, normal and colour are between those of the corners. */
static void place(const cln_export_job *job, const cln_surface *s, size_t face, size_t i,
                  cln_mesh *mesh)
{
    const uint32_t *v = s->face[face];
    const cln_space space = cln_space_core(&job->opened.model.space);
    float u[4];
    double share[3], cube[3] = {0}, colour[3] = {0}, normal[3] = {0}, length = 0;

    cln_uniform4(1, CLN_STREAM_SURFACE, (uint32_t)((uint64_t)i >> 32), (uint32_t)i, 0, u);
    share[0] = 1 - sqrt((double)u[0]);
    share[1] = sqrt((double)u[0]) * u[1];
    share[2] = 1 - share[0] - share[1];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            cube[a] += share[k] * s->at[v[k]][a];
            normal[a] += share[k] * s->normal[v[k]][a];
            colour[a] += share[k] * s->colour[v[k]][a];
        }
    for (int a = 0; a < 3; a++)
        length += normal[a] * normal[a];
    length = sqrt(length);
    for (int a = 0; a < 3; a++) {
        mesh->normal[i][a] = length > 0 ? (float)(normal[a] / length) : s->normal[v[0]][a];
        mesh->colour[i][a] = (uint8_t)lround(colour[a]);
    }
    cln_space_point_to_scene(&space, cube, mesh->at[i]);
    cln_space_normal_to_scene(&space, cube, mesh->normal[i], mesh->normal[i]);
}

cln_status cln_export_points(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    cln_parts parts = {0};
    const cln_surface_desc how = {.opened = &job->opened,
                                  .closed = desc->closed,
                                  .crop = &job->crop,
                                  .parts = desc->largest ? &parts : NULL,
                                  .callbacks = &desc->callbacks};
    cln_surface s = {0};
    cln_mesh mesh = {0};
    double area = 0, passed = 0;
    size_t count = 0, face = 0;

    CLN_TRY(cln_surface_make(&how, &s));
    cln_export_tell_surface(job, &s);
    cln_export_tell_parts(job, &parts);
    for (size_t f = 0; f < s.faces; f++)
        area += area_of(&s, f);
    CLN_TRY(count_points(job, area, &count));
    CLN_TRY(cln_export_mesh_make(&mesh, count));
    passed = area_of(&s, 0);
    for (size_t i = 0; i < count; i++) {
        float u[4];
        double until = 0;

        cln_uniform4(1, CLN_STREAM_SURFACE, (uint32_t)((uint64_t)i >> 32), (uint32_t)i, 1, u);
        until = ((double)i + u[0]) / (double)count * area;
        while (passed < until && face + 1 < s.faces)
            passed += area_of(&s, ++face);
        place(job, &s, face, i, &mesh);
    }
    CLN_TRY(cln_export_mesh_write(job, "points of the surface", &mesh));
done:
    cln_export_mesh_free(&mesh);
    cln_surface_free(&s);
    return st;
}
