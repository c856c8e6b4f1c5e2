/* The surface of a run. See surface.h. The training views' rendered depths say where it is
 * (fusion.h), marching cubes makes triangles of it, and the field colours it as the view that sees
 * it most from the front would. */
#include "export/surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/memory.h"
#include "export/clip.h"
#include "export/export.h"
#include "export/marching.h"
#include "io/image.h"
#include "pipeline/field.h"
#include "scene/vectors.h"

enum {
    CHUNK = 65536,
    MOST_CELLS = 2048,
    BAND = 6,          /* cells or pixels */
    VERTEX_BYTES = 138 /* with its two faces, a third of them to grow by, and what a writer takes */
};

/* ---- the surface ---- */

typedef struct job {
    cln_fusion *fusion;
    const cln_callbacks *callbacks;
    bool closed;
    const float (*crop)[4]; /* [6]; NULL: none */
    double margin; /* how far beyond an open crop the surface is traced, to be as without it */
} job;

double cln_surface_cell(const cln_model *model)
{
    const double root = model->space.shell ? 4 : 2; /* in units of the cube that is traced */

    return root / ((double)(1 << cln_octree_depth(&model->tree)) * model->config.n1);
}

/* The function whose zero is the surface: the fusion, of a closed crop at most the depth in the
 * box. */
static float value_at(const job *j, const float at[3])
{
    double depth = 0;

    if (!j->crop)
        return cln_fusion_at(j->fusion, at);
    depth = cln_crop_depth(j->crop, at);
    if (!j->closed)
        return depth < -j->margin ? -1 : cln_fusion_at(j->fusion, at);
    depth /= j->fusion->band;
    return depth <= -1 ? -1 : fminf(cln_fusion_at(j->fusion, at), (float)depth);
}

static cln_status ask_fusion(void *user, size_t n, const float (*at)[4], float *values)
{
    const job *j = user;

    for (size_t i = 0; i < n; i++)
        values[i] = value_at(j, at[i]);
    return cln_export_poll(j->callbacks);
}

static cln_status report(void *user, int done, int total)
{
    cln_show_work(((const job *)user)->callbacks, "surface", done, total);
    return CLN_OK;
}

static double make_unit(float v[3])
{
    const double length = sqrt((double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2]);

    for (int a = 0; a < 3 && length > 0; a++)
        v[a] = (float)(v[a] / length);
    return length;
}

/* The cross product of two sides of a face: its normal, of twice its area. */
static void across(const cln_surface *s, size_t face, double out[3])
{
    const uint32_t *v = s->face[face];
    double p[2][3];

    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++)
            p[k][a] = (double)s->at[v[k + 1]][a] - s->at[v[0]][a];
    cln_cross(p[0], p[1], out);
}

double cln_surface_area(const cln_surface *s, size_t face)
{
    double n[3];

    across(s, face, n);
    return 0.5 * sqrt(cln_dot(n, n));
}

/* The normals of the faces, by area. */
static void add_face_normals(cln_surface *s)
{
    for (size_t f = 0; f < s->faces; f++) {
        const uint32_t *v = s->face[f];
        double n[3];

        across(s, f, n);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                s->normal[v[k]][a] += (float)n[a];
    }
}

/* Differences of the function to both sides; where these are 0, the faces'. */
static cln_status find_normals(const job *j, double step, cln_surface *s)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&s->normal, s->vertices, sizeof *s->normal, "normals"));
    add_face_normals(s);
    for (size_t i = 0; i < s->vertices; i++) {
        float normal[3];

        if (i % CHUNK == 0)
            CLN_TRY(cln_export_poll(j->callbacks));
        for (int a = 0; a < 3; a++) {
            float low[3], high[3];

            memcpy(low, s->at[i], sizeof low);
            memcpy(high, s->at[i], sizeof high);
            low[a] -= (float)step;
            high[a] += (float)step;
            normal[a] = value_at(j, low) - value_at(j, high);
        }
        if (make_unit(normal) > 1e-6)
            memcpy(s->normal[i], normal, sizeof normal);
        else
            make_unit(s->normal[i]);
    }
done:
    return st;
}

/* Who sees it; what none does is dropped. */
static cln_status look(const job *j, cln_surface *s)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&s->towards, s->vertices, sizeof *s->towards, "directions"));
    CLN_TRY(cln_alloc(&s->views, s->vertices, sizeof *s->views, "vertices"));
    for (size_t i = 0; i < s->vertices; i++)
        s->views[i] = (uint8_t)cln_fusion_seen(j->fusion, s->at[i], s->normal[i], s->towards[i]);
    if (!j->closed)
        CLN_TRY(cln_surface_keep(s, s->views));
done:
    return st;
}

/* As seen from the best view; what none sees, from the front, or as beside it where the field is
 * empty: an empty field is black. */
static cln_status paint(const cln_surface_desc *desc, cln_surface *s)
{
    cln_status st = CLN_OK;
    const float to_tree = desc->opened->model.space.shell ? 0.5f : 1;
    float(*at)[4] = NULL, (*looks)[4] = NULL, (*out)[4] = NULL;
    uint8_t *known = NULL;

    CLN_TRY(cln_alloc(&known, s->vertices, 1, "vertices"));
    CLN_TRY(cln_alloc(&at, CHUNK, sizeof *at, "points"));
    CLN_TRY(cln_alloc(&looks, CHUNK, sizeof *looks, "points"));
    CLN_TRY(cln_alloc(&out, CHUNK, sizeof *out, "points"));
    CLN_TRY(cln_alloc(&s->colour, s->vertices, sizeof *s->colour, "colours"));
    for (size_t first = 0; first < s->vertices; first += CHUNK) {
        const size_t n = s->vertices - first < CHUNK ? s->vertices - first : CHUNK;

        CLN_TRY(cln_export_poll(desc->callbacks));
        for (size_t i = 0; i < n; i++) {
            const float *towards = s->towards[first + i], *normal = s->normal[first + i];
            const bool seen = s->views[first + i] > 0;

            for (int a = 0; a < 3; a++) {
                at[i][a] = s->at[first + i][a] * to_tree;
                looks[i][a] = seen ? towards[a] : -normal[a];
            }
            at[i][3] = 0;
            looks[i][3] = 1;
        }
        CLN_TRY(cln_field_points(&desc->opened->pipeline, &desc->opened->model.tree, n,
                                 (const float(*)[4])at, (const float(*)[4])looks, out));
        for (size_t i = 0; i < n; i++)
            for (int c = 0; c < 3; c++) {
                s->colour[first + i][c] = cln_to_u8(out[i][c]);
                known[first + i] |= s->colour[first + i][c] > 0 || s->views[first + i] > 0;
            }
    }
    CLN_TRY(cln_surface_bleed(s, known));
done:
    free(known);
    free(at);
    free(looks);
    free(out);
    return st;
}

/* ---- the grid ---- */

/* What block of the grid a coordinate of the traced cube is in. */
static int block_at(int cells, double at)
{
    const int block = (int)floor(0.5 * (at + 1) * cells / CLN_MARCHING_BLOCK);
    const int last = cln_marching_blocks(cells) - 1;

    return block < 0 ? 0 : block > last ? last : block;
}

/* How wide the cells of each block may be: as the cached densities' cells of the finest leaf within
 * a cell of the grid of it, but not narrower than a pixel. cell: of the deepest leaves. */
static cln_status choose_levels(const cln_fusion *f, int cells, double cell, uint8_t **levels)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)cln_marching_blocks(cells);
    const int depth = cln_octree_depth(f->tree);
    const double width = 2.0 / cells;

    CLN_TRY(cln_alloc(levels, n * n * n, sizeof **levels, "blocks of the grid"));
    memset(*levels, CLN_MARCHING_LEVELS, n * n * n);
    for (int i = 0; i < f->tree->leaf_count; i++) {
        const int node = f->tree->leaf[i];
        const double wanted = fmax(ldexp(cell, depth - f->tree->level[node]), f->pixel);
        const int level = (int)floor(log2(wanted / width) + 1e-6);
        int low[3], high[3];
        float box[4];

        cln_octree_box(f->tree, node, box);
        for (int a = 0; a < 3; a++) {
            low[a] = block_at(cells, box[a] / f->to_tree - width);
            high[a] = block_at(cells, (box[a] + (double)box[3]) / f->to_tree + width);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++)
                for (int x = low[0]; x <= high[0]; x++) {
                    uint8_t *at = &(*levels)[((size_t)z * n + (size_t)y) * n + (size_t)x];

                    *at = (uint8_t)(level < 0 ? 0 : level < *at ? level : *at);
                }
    }
done:
    return st;
}

/* ---- the work ---- */

cln_status cln_surface_trace(cln_fusion *fusion, int cells, double cell, bool closed,
                             const float (*crop)[4], const cln_callbacks *callbacks,
                             cln_surface *out)
{
    cln_status st = CLN_OK;
    job j = {fusion, callbacks, closed, crop, 0};
    const double finest = fmax(cell, fusion->pixel), wanted = ceil(2 / finest * (1 - 1e-9));
    cln_marching marching = {.ask = ask_fusion, .progress = report, .user = (void *)&j};
    uint8_t *levels = NULL;

    marching.cells = cells > 0 ? cells : wanted < MOST_CELLS ? (int)fmax(wanted, 2) : MOST_CELLS;
    fusion->band = BAND * fmax(2.0 / marching.cells, fusion->pixel);
    j.margin = 2.0 * (2 << CLN_MARCHING_LEVELS) / marching.cells;
    memset(out, 0, sizeof *out);
    out->fine = finest;
    out->faint = fusion->faint;
    out->most = (size_t)fmin(UINT32_MAX, cln_host_memory() / 2 / VERTEX_BYTES);
    if (cells == 0)
        CLN_TRY(choose_levels(fusion, marching.cells, cell, &levels));
    marching.levels = levels;
    CLN_TRY(cln_marching_run(&marching, out));
    if (crop && !closed)
        CLN_TRY(cln_surface_clip(out, crop));
    CLN_TRY(find_normals(&j, 2.0 / marching.cells, out));
    CLN_TRY(look(&j, out));
done:
    free(levels);
    if (st != CLN_OK)
        cln_surface_free(out);
    return st;
}

cln_status cln_surface_make(const cln_surface_desc *desc, cln_surface *out)
{
    cln_status st = CLN_OK;
    const cln_model *model = &desc->opened->model;
    const double side = 2 * model->space.half, spacing = desc->spacing;
    const double wanted = spacing > 0 ? fmax(2, ceil(side / spacing * (1 - 1e-9))) : 0;
    cln_fusion fusion = {0};

    memset(out, 0, sizeof *out);
    if (wanted > MOST_CELLS)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--spacing %g: that is %.0f cells across the cube of side %g, more "
                         "than the %d that are possible; give %g or more",
                         spacing, wanted, side, MOST_CELLS, side / MOST_CELLS));
    CLN_TRY(cln_fusion_make(desc->opened, desc->callbacks, &fusion));
    CLN_TRY(cln_surface_trace(&fusion, (int)wanted, cln_surface_cell(model), desc->closed,
                              desc->crop->on ? desc->crop->planes : NULL, desc->callbacks, out));
    if (out->faces == 0 && desc->crop->on) {
        char cube[CLN_BOX_BYTES];

        cln_crop_cube(&model->space, cube);
        CLN_TRY(
            cln_fail(CLN_INPUT, "--crop: no training view sees a surface in this box%s%s%s",
                     spacing > 0 ? "; give a larger one, or less --spacing" : "; give a larger one",
                     model->space.forward ? "" : "; the scene's cube is ",
                     model->space.forward ? "" : cube));
    }
    if (out->faces == 0 && spacing > 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--spacing %g: no surface is found with %.0f cells across the cube of "
                         "side %.4g; give less, such as %.2g, or leave it out",
                         spacing, wanted, side, side / 256));
    if (out->faces == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no training view sees a surface in its field; train it longer",
                         desc->opened->run));
    if (desc->parts)
        CLN_TRY(cln_surface_keep_largest(out, desc->parts));
    CLN_TRY(paint(desc, out));
done:
    if (st != CLN_OK)
        cln_surface_free(out);
    cln_fusion_free(&fusion);
    return st;
}
