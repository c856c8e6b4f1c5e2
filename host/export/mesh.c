/* export --mesh: the surface as triangles. */
#include "export/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "export/crowded.h"
#include "export/reduce.h"
#include "export/surface.h"
#include "io/disk.h"
#include "io/progress.h"

/* A part that is longer than this share of the largest may be an object of its own. */
static const double OWN_OBJECT = 0.25;

cln_status cln_export_mesh_make(cln_mesh *mesh, size_t vertices)
{
    cln_status st = CLN_OK;

    mesh->vertices = vertices;
    CLN_TRY(cln_alloc(&mesh->at, vertices, sizeof *mesh->at, "vertices"));
    CLN_TRY(cln_alloc(&mesh->normal, vertices, sizeof *mesh->normal, "vertices"));
    CLN_TRY(cln_alloc(&mesh->colour, vertices, sizeof *mesh->colour, "vertices"));
    CLN_TRY(cln_alloc(&mesh->views, vertices, sizeof *mesh->views, "vertices"));
done:
    return st;
}

void cln_export_mesh_free(cln_mesh *mesh)
{
    free(mesh->at);
    free(mesh->normal);
    free(mesh->colour);
    free(mesh->views);
}

void cln_export_tell_parts(cln_export_job *job, const cln_parts *parts)
{
    job->result->parts = (int64_t)parts->parts;
    job->result->faces_left_out = (int64_t)parts->left_out;
    if (parts->next > OWN_OBJECT)
        cln_warn("--largest leaves out a part that is %.2g times as long as the one that stays: if "
                 "it is an object of its own, export that by --crop, or leave --largest out",
                 parts->next);
}

/* STL has floats alone. Coordinates that are too large for them, a survey's, begin elsewhere. */
static cln_status write_stl(cln_export_job *job, const char *file, cln_mesh *mesh)
{
    const double rounding = cln_mesh_rounding(mesh);
    double *off = job->result->taken_off;

    if (rounding > mesh->fine / 1000) {
        for (int a = 0; a < 3; a++)
            off[a] = floor(mesh->origin[a]);
        for (size_t i = 0; i < mesh->vertices; i++)
            for (int a = 0; a < 3; a++)
                mesh->at[i][a] -= off[a];
        cln_warn("%s: %.17g,%.17g,%.17g were taken off all coordinates, as STL has 32-bit numbers, "
                 "which would move them by up to %.2g units, where a finest cell has %.2g; .ply "
                 "keeps them",
                 file, off[0], off[1], off[2], rounding, mesh->fine);
    }
    return cln_mesh_write_stl(file, mesh);
}

/* Turns, scales and moves: for glTF, where up is y, by a node; else, where z is up if any is given,
 * the numbers themselves. */
static void stand_up(const cln_export_job *job, bool glb, cln_mesh *mesh)
{
    static const double none[3] = {0};
    double turn[4];

    cln_mesh_upright(glb ? job->up : none, 1, mesh->turn);
    mesh->scale = glb ? job->scale : 1;
    if (glb)
        return;
    cln_mesh_upright(job->turns ? job->up : none, 2, turn);
    if (job->turns || job->scale != 1)
        cln_mesh_place(mesh, turn, job->scale);
    cln_mesh_move(mesh, job->desc->offset);
}

/* low, high: of all vertices, as a node with this turn and scale places them. */
static void span(const cln_mesh *mesh, const double turn[4], double scale, double low[3],
                 double high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
    }
    for (size_t i = 0; i < mesh->vertices; i++) {
        double at[3];

        cln_mesh_turned(turn, mesh->at[i], at);
        for (int a = 0; a < 3; a++) {
            low[a] = fmin(low[a], scale * at[a]);
            high[a] = fmax(high[a], scale * at[a]);
        }
    }
}

/* Tells that what lies beyond the cube is not written, as a warning if what is written ends at one
 * of the cube's faces and it should not: of a shell, of photos that show by alpha where things end,
 * and of what is closed, by these faces. box: where it is, in scene units. cell: of the finest,
 * likewise. */
static void tell_cut(cln_export_job *job, const char *what, const double box[6], double cell)
{
    const cln_model *model = &job->opened.model;
    const cln_space core = cln_space_core(&model->space);
    bool cut = false;

    if (model->space.forward)
        return;
    job->result->beyond_left_out = model->space.shell;
    for (int a = 0; a < 3; a++)
        cut = cut || box[a] < core.centre[a] - core.half + 2 * cell ||
              box[3 + a] > core.centre[a] + core.half - 2 * cell;
    if (model->space.shell && cut)
        cln_warn(
            "%s: it ends at the faces of the cube (half side %.6g), as what lies beyond the "
            "cube, in its shell, is left out. If it is a surface that ends there, train with a "
            "larger --bbox; if it is haze behind walls, cut it off with --crop",
            what, core.half);
    else if (model->space.shell)
        cln_info("%s: what lies beyond the cube, in its shell, is left out", what);
    else if ((model->has_alpha || job->desc->closed) && cut)
        cln_warn("%s: it ends at the faces of the cube (half side %.6g), where training saw "
                 "nothing beyond. If the object goes on there, train with a larger --bbox; "
                 "`cl-nascent check SCENE` proposes one",
                 what, core.half);
}

/* Area, and what closed triangles enclose, as they are written. */
static cln_status measure(cln_export_job *job, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    cln_mesh_edges edges;
    double area = 0, volume = 0;

    CLN_TRY(cln_mesh_count_edges(mesh, &edges));
    for (size_t f = 0; f < mesh->faces; f++) {
        double normal[3];
        const double *first = mesh->at[mesh->face[f][0]];

        area += cln_mesh_area(mesh, f, normal);
        for (int a = 0; a < 3; a++)
            volume += (first[a] - mesh->origin[a]) * normal[a] / 3;
    }
    job->result->area = mesh->scale * mesh->scale * area;
    job->result->open_edges = (int64_t)edges.open;
    if (edges.open == 0)
        job->result->volume = mesh->scale * mesh->scale * mesh->scale * volume;
done:
    return st;
}

cln_status cln_export_mesh_write(cln_export_job *job, const char *what, cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    const cln_space *space = &job->opened.model.space;
    const char *file = job->desc->file;
    const bool glb = cln_export_ends(file, ".glb");
    double low[3], high[3];
    char *comment = NULL;

    CLN_TRY(cln_export_comment(job, what, &comment));
    mesh->comment = comment;
    mesh->fine = cln_space_distance_to_scene(space, cln_surface_cell(&job->opened.model));
    memcpy(mesh->origin, space->centre, sizeof mesh->origin);
    span(mesh, (const double[4]){0, 0, 0, 1}, 1, job->result->box, job->result->box + 3);
    tell_cut(job, what, job->result->box, mesh->fine);
    stand_up(job, glb, mesh);
    span(mesh, mesh->turn, mesh->scale, low, high);
    for (int a = 0; a < 3; a++)
        job->result->size[a] = high[a] - low[a];
    if (mesh->faces > 0)
        CLN_TRY(measure(job, mesh));
    CLN_TRY(cln_disk_check_file(file, cln_mesh_bytes(mesh), what));
    if (cln_export_ends(file, ".obj"))
        CLN_TRY(cln_mesh_write_obj(file, mesh));
    else if (glb)
        CLN_TRY(cln_mesh_write_glb(file, mesh));
    else if (cln_export_ends(file, ".stl"))
        CLN_TRY(write_stl(job, file, mesh));
    else
        CLN_TRY(cln_mesh_write_ply(file, mesh));
    for (int a = 0; a < 3; a++) {
        job->result->written[a] = low[a] - job->result->taken_off[a];
        job->result->written[3 + a] = high[a] - job->result->taken_off[a];
    }
    job->result->vertices = (int64_t)mesh->vertices;
    job->result->faces = (int64_t)mesh->faces;
done:
    mesh->comment = NULL;
    free(comment);
    return st;
}

/* Views that see the corner of a triangle that most of them see. */
static int most_views(const cln_surface *surface, size_t face)
{
    int most = 0;

    for (int k = 0; k < 3; k++)
        if (surface->views[surface->face[face][k]] > most)
            most = surface->views[surface->face[face][k]];
    return most;
}

/* How much of what views see is seen by one or two alone. */
static void tell_few(cln_export_job *job, const cln_surface *surface)
{
    double few = 0, all = 0;

    for (size_t f = 0; f < surface->faces; f++) {
        const int views = most_views(surface, f);
        const double area = cln_surface_area(surface, f);

        all += views > 0 ? area : 0;
        few += views > 0 && views < 3 ? area : 0;
    }
    job->result->few_views = all > 0 ? few / all : 0;
    if (job->result->few_views > 0.01)
        cln_info("%.2g %% of the surface is seen by only one or two training views, and less sure "
                 "than the rest (PLY files have their number at each vertex)",
                 100 * job->result->few_views);
}

/* Told from this share on: leaves, hair and glass have some, and young models. */
static const double FAINT = 0.05;

void cln_export_tell_surface(cln_export_job *job, const cln_surface *surface)
{
    const cln_space *space = &job->opened.model.space;
    const bool cut_out = !space->shell && !job->opened.model.has_alpha;

    if (!space->forward)
        job->result->fine = job->scale * cln_space_distance_to_scene(space, surface->fine);
    job->result->faint = surface->faint;
    tell_few(job, surface);
    if (!space->forward && surface->faint > FAINT)
        cln_warn(
            "%.0f %% of what the training views show is seen through (its opacity is below 0.9), "
            "so depths lie too far there and the surface too deep: train longer%s",
            100 * surface->faint,
            cut_out ? ", or cut the object out (alpha, --masks), if photos show it before a colour "
                      "that parts of it have, too"
                    : "");
}

/* Crumbs hang in the air: a print needs them gone, and pictures rarely show them. */
static cln_status tell_loose(const cln_surface *surface)
{
    cln_status st = CLN_OK;
    cln_parts parts;
    char pieces[32], triangles[32], all[32], what[256];

    CLN_TRY(cln_surface_count_parts(surface, &parts));
    if (parts.parts < 2)
        goto done;
    cln_format_count((double)parts.parts - 1, pieces);
    cln_format_count((double)parts.left_out, triangles);
    cln_format_count((double)surface->faces, all);
    snprintf(what, sizeof what,
             "the surface has %s loose piece%s beside the largest, with %s of its %s triangles "
             "(%.3g %%)",
             pieces, cln_plural((double)parts.parts - 1, "", "s"), triangles, all,
             100.0 * (double)parts.left_out / (double)surface->faces);
    if (cln_parts_are_broken(&parts, surface->faces))
        cln_info("%s, which reach %.2g times as far: of what is thinner than the cells, which "
                 "breaks into pieces, or of a surface that has holes as its training is short. "
                 "Keep them: --largest would leave all of that out",
                 what, parts.others);
    else
        cln_info("%s: --largest leaves %s out", what,
                 cln_plural((double)parts.parts - 1, "it", "them"));
done:
    return st;
}

/* Which side of the crop box each face lies in: 1 to 6, or 0. */
static cln_status find_planes(const cln_crop *crop, const cln_surface *surface, uint8_t **out)
{
    const double flat = 1e-5; /* in the cube */
    cln_status st = CLN_OK;

    if (!crop->on)
        return CLN_OK;
    CLN_TRY(cln_alloc(out, surface->faces, 1, "triangles"));
    for (size_t f = 0; f < surface->faces; f++)
        for (int p = 0; p < 6 && !(*out)[f]; p++) {
            bool in = true;

            for (int k = 0; k < 3 && in; k++) {
                const float *at = surface->at[surface->face[f][k]];
                double depth = (double)crop->planes[p][3];

                for (int a = 0; a < 3; a++)
                    depth += (double)crop->planes[p][a] * (double)at[a];
                in = fabs(depth) < flat;
            }
            (*out)[f] = in ? (uint8_t)(p + 1) : 0;
        }
done:
    return st;
}

/* Tells how much of a closed surface no training view sees, which is made up: below what stands on
 * the ground, say. plane: NULL, or 0 for all faces but those that the crop box cut, which are as
 * they are to be. */
static void tell_unseen(cln_export_job *job, const cln_surface *surface, const cln_mesh *mesh,
                        const uint8_t *plane)
{
    double all = 0, unseen = 0,
           box[6] = {INFINITY, INFINITY, INFINITY, -INFINITY, -INFINITY, -INFINITY};
    char text[CLN_BOX_BYTES];

    for (size_t f = 0; f < mesh->faces; f++) {
        const uint32_t *v = mesh->face[f];
        const double area = cln_mesh_area(mesh, f, (double[3]){0});
        const bool seen = (plane && plane[f]) || most_views(surface, f) > 0;

        all += area;
        unseen += seen ? 0 : area;
        for (int k = 0; k < 3 && !seen; k++)
            for (int a = 0; a < 3; a++) {
                box[a] = fmin(box[a], mesh->at[v[k]][a]);
                box[3 + a] = fmax(box[3 + a], mesh->at[v[k]][a]);
            }
    }
    if (!(unseen > 0))
        return;
    job->result->unseen = unseen / all;
    cln_box_write(box, fmax(fmax(box[3] - box[0], box[4] - box[1]), box[5] - box[2]), text);
    cln_info(
        "%.2g %% of the surface is what no training view sees, within %s: size and volume have "
        "it, too; --crop cuts it off",
        100 * unseen / all, text);
}

cln_status cln_export_mesh(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    cln_parts parts = {0};
    const cln_surface_desc how = {.opened = &job->opened,
                                  .spacing = desc->spacing,
                                  .closed = desc->closed,
                                  .crop = &job->crop,
                                  .parts = desc->largest ? &parts : NULL,
                                  .callbacks = &desc->callbacks};
    const cln_space space = cln_space_core(&job->opened.model.space);
    cln_surface surface = {0};
    cln_mesh mesh = {0};
    size_t crowded = 0, bent = 0;
    uint8_t *plane = NULL;

    CLN_TRY(cln_surface_make(&how, &surface));
    cln_export_tell_surface(job, &surface);
    cln_export_tell_parts(job, &parts);
    if (!desc->largest)
        CLN_TRY(tell_loose(&surface));
    CLN_TRY(cln_export_mesh_make(&mesh, surface.vertices));
    for (size_t i = 0; i < mesh.vertices; i++) {
        const double cube[3] = {surface.at[i][0], surface.at[i][1], surface.at[i][2]};

        cln_space_point_to_scene(&space, cube, mesh.at[i]);
        cln_space_normal_to_scene(&space, cube, surface.normal[i], mesh.normal[i]);
    }
    memcpy(mesh.colour, surface.colour, mesh.vertices * sizeof *mesh.colour);
    memcpy(mesh.views, surface.views, mesh.vertices * sizeof *mesh.views);
    mesh.face = surface.face;
    mesh.faces = surface.faces;
    memcpy(mesh.origin, job->opened.model.space.centre, sizeof mesh.origin);
    CLN_TRY(find_planes(&job->crop, &surface, &plane));
    if (desc->closed)
        tell_unseen(job, &surface, &mesh, plane);
    if (desc->triangles != 0 && (size_t)desc->triangles < mesh.faces) {
        job->result->faces_before = (int64_t)mesh.faces;
        CLN_TRY(cln_mesh_reduce(&mesh, (size_t)desc->triangles, plane,
                                &job->result->reduction_error, &crowded, &bent));
        if (bent > 0)
            cln_warn("--triangles %lld: the box's faces are not flat any more, as their outlines "
                     "alone take %zu; give %zu or more, or a larger --spacing",
                     (long long)desc->triangles, bent, 4 * bent);
        if (crowded > 0)
            cln_warn("--triangles %lld: %zu edges have more than two triangles, which slicers take "
                     "for torn; give more, or leave --triangles out",
                     (long long)desc->triangles, crowded);
        job->result->reduction_error *= job->scale;
        if (mesh.faces > (size_t)desc->triangles)
            cln_warn("--triangles %lld: %zu are left, as fewer would tear the surface",
                     (long long)desc->triangles, mesh.faces);
    }
    CLN_TRY(cln_export_mesh_write(job, "the surface", &mesh));
done:
    free(plane);
    cln_export_mesh_free(&mesh);
    cln_surface_free(&surface);
    return st;
}
