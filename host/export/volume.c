/* export --volume: colour and density on a grid of cubes, sampled in their middles, slice by slice,
 * over the box of the active leaves. Colour depends on the direction: the mean of six, along the
 * axes, is written. A JSON file beside the array says where the grid lies. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/files.h"
#include "base/memory.h"
#include "export/export.h"
#include "io/disk.h"
#include "io/npy.h"
#include "pipeline/field.h"

enum { STANDARD_CELLS = 256, MOST_CELLS = 2048, CHUNK = 65536, CHANNELS = 4 };

/* Density over a cell that darkens by less has no colour: nothing shows it. */
static const double invisible = 1e-4;

typedef struct grid {
    int shape[3];                  /* z, y, x */
    double low[3], side;           /* lowest corner and side of a cube, in the cube; x, y, z */
    float (*at)[4], (*towards)[4]; /* [CHUNK] */
    float (*out)[4];               /* [CHUNK] */
    bool any;                      /* cube in the crop box */
} grid;

static cln_status fail_thin(void)
{
    return cln_fail(CLN_USAGE, "--crop: no cube of the grid has its middle in this box; give a "
                               "larger box, or less --spacing");
}

static cln_status place_grid(const cln_export_job *job, grid *g)
{
    const cln_model *model = &job->opened.model;
    const double spacing = job->desc->spacing, half = model->space.half;
    float low[3] = {1, 1, 1}, high[3] = {-1, -1, -1};
    double bytes = CHANNELS * sizeof(float), span[2][3] = {{0}};

    g->side = spacing > 0 ? spacing / half : 2.0 / STANDARD_CELLS;
    if (2 / g->side > MOST_CELLS * (1 + 1e-9))
        return cln_fail(CLN_USAGE,
                        "--spacing %g: that is %.0f cubes across the scene's cube of side %g, "
                        "more than the %d that are possible; give %g or more",
                        spacing, 2 / g->side, 2 * half, MOST_CELLS, 2 * half / MOST_CELLS);
    for (int s = 0; s < model->tree.leaf_count; s++) {
        float box[4];

        cln_octree_box(&model->tree, model->tree.leaf[s], box);
        for (int a = 0; a < 3; a++) {
            low[a] = fminf(low[a], box[a]);
            high[a] = fmaxf(high[a], box[a] + box[3]);
        }
    }
    if (job->crop.on)
        cln_crop_span(&model->space, &job->crop, span[0], span[1]);
    for (int a = 0; a < 3; a++) {
        double first = floor((low[a] + 1) / g->side + 1e-9);
        double last = ceil((high[a] + 1) / g->side - 1e-9);

        if (job->crop.on) { /* with their middles in what the box spans */
            first = fmax(first, ceil((span[0][a] + 1) / g->side - 0.5 - 1e-6));
            last = fmin(last, floor((span[1][a] + 1) / g->side + 0.5 + 1e-6));
            if (last <= first)
                return fail_thin();
        }
        g->shape[2 - a] = last > first ? (int)(last - first) : 1;
        g->low[a] = -1 + first * g->side;
        bytes *= g->shape[2 - a];
    }
    return cln_disk_check_file(job->desc->file, 4096 + bytes, "the volume");
}

/* Cubes first .. first + n of slice z; values: [n][CHANNELS] r, g, b, density per scene unit, that
 * scaled. */
static cln_status ask_cells(cln_export_job *job, grid *g, int z, size_t first, size_t n,
                            float (*values)[CHANNELS])
{
    cln_status st = CLN_OK;
    const cln_model *model = &job->opened.model;

    CLN_TRY(cln_export_poll(&job->desc->callbacks));
    for (size_t i = 0; i < n; i++) {
        const size_t cell[3] = {(first + i) % (size_t)g->shape[2],
                                (first + i) / (size_t)g->shape[2], (size_t)z};

        for (int a = 0; a < 3; a++)
            g->at[i][a] = (float)(g->low[a] + ((double)cell[a] + 0.5) * g->side);
        g->at[i][3] = 0;
    }
    memset(values, 0, n * sizeof *values);
    for (int look = 0; look < 6; look++) {
        bool any = false;

        for (size_t i = 0; i < n; i++) {
            memset(g->towards[i], 0, sizeof g->towards[i]);
            g->towards[i][look / 2] = look % 2 ? 1 : -1;
        }
        CLN_TRY(cln_field_points(&job->opened.pipeline, &model->tree, n, (const float(*)[4])g->at,
                                 (const float(*)[4])g->towards, g->out));
        for (size_t i = 0; i < n; i++) {
            const bool seen = (double)g->out[i][3] * g->side > invisible;

            any |= seen;
            values[i][3] =
                (float)(cln_space_density_to_scene(&model->space, NULL, NULL, g->out[i][3]) /
                        job->scale);
            for (int c = 0; c < 3 && seen; c++)
                values[i][c] += g->out[i][c] / 6;
        }
        if (!any)
            break;
    }
    for (size_t i = 0; i < n && job->crop.on; i++) {
        if (cln_crop_depth((const float(*)[4])job->crop.planes, g->at[i]) < -1e-6)
            memset(values[i], 0, sizeof values[i]);
        else
            g->any = true;
    }
done:
    return st;
}

/* *out: the file, to be committed. */
static cln_status write_slices(cln_export_job *job, grid *g, cln_atomic_file **out)
{
    cln_status st = CLN_OK;
    const cln_callbacks *callbacks = &job->desc->callbacks;
    const size_t area = (size_t)g->shape[1] * (size_t)g->shape[2];
    const int shape[4] = {g->shape[0], g->shape[1], g->shape[2], CHANNELS};
    cln_atomic_file *file = NULL;
    float(*values)[CHANNELS] = NULL;

    CLN_TRY(cln_alloc(&values, CHUNK, sizeof *values, "slice"));
    CLN_TRY(cln_npy_begin_f32(job->desc->file, 4, shape, &file));
    for (int z = 0; z < g->shape[0]; z++) {
        cln_show_work(callbacks, "volume", z, g->shape[0]);
        for (size_t first = 0; first < area; first += CHUNK) {
            const size_t n = area - first < CHUNK ? area - first : CHUNK;

            CLN_TRY(ask_cells(job, g, z, first, n, values));
            CLN_TRY(cln_atomic_write(file, values, n * sizeof *values));
        }
    }
    *out = file;
    file = NULL;
    cln_show_work(callbacks, "volume", g->shape[0], g->shape[0]);
done:
    cln_atomic_abandon(file);
    free(values);
    return st;
}

/* NAME.npy -> NAME.json; NULL for a name without that ending. */
static cln_status name_about(const char *file, char **path)
{
    if (!cln_export_ends(file, ".npy"))
        return CLN_OK;
    return cln_asprintf(path, "%.*s.json", (int)strlen(file) - 4, file);
}

static cln_status write_about(const cln_export_job *job, const grid *g, const char *path,
                              cln_atomic_file **out)
{
    cln_status st = CLN_OK;
    const cln_space *space = &job->opened.model.space;
    double first[3], middle[3];
    char *comment = NULL, *text = NULL;
    json_t *about = NULL;

    for (int a = 0; a < 3; a++)
        middle[a] = g->low[a] + 0.5 * g->side;
    cln_space_point_to_scene(space, middle, first);
    for (int a = 0; a < 3; a++)
        first[a] *= job->scale;
    CLN_TRY(cln_export_comment(job, "colour and density on a grid", &comment));
    about = json_pack("{s:s, s:s, s:[i,i,i,i], s:[s,s,s,s], s:[s,s,s,s], s:[f,f,f], s:f}", "schema",
                      "cl-nascent.volume/1", "tool", comment, "shape", g->shape[0], g->shape[1],
                      g->shape[2], CHANNELS, "axes", "z", "y", "x", "channel", "channels", "r", "g",
                      "b", "density", "first", first[0], first[1], first[2], "spacing",
                      job->scale * cln_space_distance_to_scene(space, g->side));
    text = about ? json_dumps(about, JSON_INDENT(1)) : NULL;
    if (!text)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot make JSON", path));
    CLN_TRY(cln_atomic_open(path, out));
    CLN_TRY(cln_atomic_write(*out, text, strlen(text)));
done:
    json_decref(about);
    free(text);
    free(comment);
    return st;
}

cln_status cln_export_volume(cln_export_job *job)
{
    cln_status st = CLN_OK;
    grid g = {0};
    char *about = NULL;
    cln_atomic_file *files[2] = {NULL};

    CLN_TRY(place_grid(job, &g));
    CLN_TRY(name_about(job->desc->file, &about));
    if (about && cln_is_file(about) && !job->desc->overwrite)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: already exists, and would say where the grid lies; choose another "
                         "name, or give --overwrite",
                         about));
    if (about)
        CLN_TRY(cln_disk_check_new(about, true));
    CLN_TRY(cln_alloc(&g.at, CHUNK, sizeof *g.at, "points"));
    CLN_TRY(cln_alloc(&g.towards, CHUNK, sizeof *g.towards, "points"));
    CLN_TRY(cln_alloc(&g.out, CHUNK, sizeof *g.out, "points"));
    CLN_TRY(write_slices(job, &g, &files[0]));
    if (job->crop.on && !g.any)
        CLN_TRY(fail_thin());
    if (about)
        CLN_TRY(write_about(job, &g, about, &files[1]));
    CLN_TRY(
        cln_atomic_commit_all((cln_atomic_file **const[]){&files[0], &files[1]}, about ? 2 : 1));
    memcpy(job->result->shape, g.shape, sizeof g.shape);
done:
    cln_atomic_abandon(files[0]);
    cln_atomic_abandon(files[1]);
    free(about);
    free(g.at);
    free(g.towards);
    free(g.out);
    return st;
}
