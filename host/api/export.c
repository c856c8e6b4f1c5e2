/* cln_export: what a run holds for other programs. Checks what is asked for and where it goes,
 * opens what the export needs, and calls its function (export/list.h). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "cl_nascent.h"
#include "export/export.h"
#include "export/reduce.h"
#include "io/disk.h"
#include "io/run_folder.h"
#include "render/orbit.h"
#include "render/tree_picture.h"
#include "scene/reader.h"
#include "scene/vectors.h"

typedef struct export_row {
    const char *what, *form;
    cln_export_needs needs;
    cln_status (*write)(cln_export_job *job);
} export_row;

static const export_row exports[] = {
#define X(what, needs, form, help) {#what, form, CLN_EXPORT_##needs, cln_export_##what},
    CLN_EXPORT_LIST(X)
#undef X
};

enum { EXPORTS = sizeof exports / sizeof exports[0] };

/* ---- for the exports ---- */

static bool moves(const cln_export_desc *desc)
{
    return desc->offset[0] != 0 || desc->offset[1] != 0 || desc->offset[2] != 0;
}

cln_status cln_export_comment(const cln_export_job *job, const char *what, char **text)
{
    const cln_export_desc *desc = job->desc;
    const double *offset = desc->offset;
    const uint64_t digest = cln_model_digest(&job->opened.model);
    const cln_export_result *r = job->result;
    char times[64] = "", up[128] = "", plus[128] = "", model[64] = "", crop[256] = "";
    char part[64] = "", fewer[128] = "";

    if (job->turns)
        cln_format(up, sizeof up, ", %.12g,%.12g,%.12g up", job->up[0], job->up[1], job->up[2]);
    if (digest)
        cln_format(model, sizeof model, "; model %016llx%s", (unsigned long long)digest,
                   desc->closed ? ", closed" : "");
    if (desc->cropped)
        cln_format(crop, sizeof crop, "; crop %.12g,%.12g,%.12g,%.12g,%.12g,%.12g,%g,%g,%g",
                   desc->crop[0], desc->crop[1], desc->crop[2], desc->crop[3], desc->crop[4],
                   desc->crop[5], desc->crop_turn[0], desc->crop_turn[1], desc->crop_turn[2]);
    if (r->parts > 1)
        cln_format(part, sizeof part, "; the largest of %lld parts", (long long)r->parts);
    if (r->faces_before > 0)
        cln_format(fewer, sizeof fewer, "; fewer triangles, moved by up to %.2g",
                   r->reduction_error);
    if (job->scale != 1)
        cln_format(times, sizeof times, " x %.12g", job->scale);
    if (moves(desc))
        cln_format(plus, sizeof plus, " + %.15g,%.15g,%.15g", offset[0], offset[1], offset[2]);
    return cln_asprintf(
        text, "cl-nascent " CLN_VERSION ": %s at step %lld; scene units%s%s%s%s%s%s%s", what,
        (long long)job->opened.model.step, times, up, plus, model, crop, part, fewer);
}

static const char *ending_of(const char *file)
{
    const char *slash = strrchr(file, '/');

    return strrchr(slash ? slash : file, '.');
}

cln_status cln_export_poll(const cln_callbacks *callbacks)
{
    return cln_stopped_by(cln_poll_signal(callbacks), "nothing was written");
}

bool cln_export_ends(const char *file, const char *ending)
{
    const char *its = ending_of(file);

    return its && strcasecmp(its, ending) == 0;
}

/* ---- what is asked for ---- */

/* Does a form such as "FILE.ply|.obj" list this ending? */
static bool may_end_so(const char *form, const char *ending)
{
    const size_t bytes = strlen(ending);

    for (const char *at = strchr(form, '.'); at; at = strchr(at + 1, '.'))
        if (strncasecmp(at, ending, bytes) == 0 && (at[bytes] == 0 || at[bytes] == '|'))
            return true;
    return false;
}

/* What is meant by names of files that the web knows, but no export writes. */
static const char *meant_by(const cln_export_desc *desc, const char *ending)
{
    if (strcmp(desc->what, "mesh") != 0 || !ending)
        return NULL;
    if (strcasecmp(ending, ".3mf") == 0 || strcasecmp(ending, ".amf") == 0)
        return "slicers read .stl, too: end the name so";
    if (strcasecmp(ending, ".gltf") == 0)
        return "glTF in one file is .glb: end the name so";
    if (strcasecmp(ending, ".usdz") == 0 || strcasecmp(ending, ".usd") == 0)
        return "browsers and Blender read .glb, which other programs turn into USDZ: end the name "
               "so";
    if (strcasecmp(ending, ".fbx") == 0)
        return "Blender and Unreal read .glb, and Unity by its package glTFast: end the name so";
    return NULL;
}

/* Checks the target before the work begins: its name has an ending of the format, its folder can be
 * written to, and what is there is a plain file that may be replaced. An export that writes a
 * folder checks the files in it itself. */
static cln_status check_target(const cln_export_desc *desc, const export_row *row)
{
    const char *ending = ending_of(desc->file), *wanted = strchr(row->form, '.');
    const bool folders = strstr(row->form, "FOLDER") != NULL;
    struct stat info;
    const bool there = lstat(desc->file, &info) == 0;

    if (folders && (!wanted || (there && S_ISDIR(info.st_mode))))
        return CLN_OK;
    if (meant_by(desc, ending))
        return cln_fail(CLN_USAGE, "%s: %s", desc->file, meant_by(desc, ending));
    if (ending ? !may_end_so(row->form, ending) : !folders && (!there || S_ISREG(info.st_mode)))
        return cln_fail(CLN_USAGE, "%s: --%s writes %s%s; end the name with %.*s", desc->file,
                        desc->what, wanted, folders ? "" : " files", (int)strcspn(wanted, "|"),
                        wanted);
    if (!there && folders)
        return cln_disk_check_file(desc->file, 0, "");
    return cln_disk_check_new(desc->file, desc->overwrite);
}

static cln_status find_export(const char *what, const export_row **found)
{
    char known[256] = "";

    for (int i = 0; i < EXPORTS; i++) {
        const size_t used = strlen(known);

        *found = &exports[i];
        if (what && strcmp(what, exports[i].what) == 0)
            return CLN_OK;
        snprintf(known + used, sizeof known - used, "%s%s", i ? "|" : "", exports[i].what);
    }
    return cln_fail(CLN_USAGE, "export: '%s' is not one of %s", what ? what : "", known);
}

/* An option that this export does not read is a mistake. */
static cln_status check_options(const cln_export_desc *desc)
{
    const struct {
        const char *option, *of; /* the exports that read it */
        bool given;
    } rows[] = {
        {"spacing", "points mesh volume", desc->spacing != 0},
        {"count", "points", desc->count != 0},
        {"closed", "points mesh", desc->closed},
        {"crop", "points mesh volume", desc->cropped},
        {"largest", "points mesh", desc->largest},
        {"up", "points mesh", cln_up_given(desc->up) || desc->up_auto},
        {"offset", "points mesh", moves(desc)},
        {"triangles", "mesh", desc->triangles != 0},
        {"colour", "octree", desc->colour && strcmp(desc->colour, "level") != 0},
        {"overwrite", "points mesh volume cameras octree", desc->overwrite},
        {"scale", "points mesh volume cameras octree", desc->scale != 0 && desc->scale != 1},
        {"scene", "points mesh volume cameras octree", desc->scene != NULL},
    };
    cln_status st = CLN_OK;

    if (desc->colour && strcmp(desc->colour, "error") != 0 && strcmp(desc->colour, "level") != 0)
        return cln_fail(CLN_USAGE, "--colour: '%s' is not one of level|error", desc->colour);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (rows[i].given && !strstr(rows[i].of, desc->what))
            return cln_fail(CLN_USAGE, "--%s: has no effect on --%s, only on %s; leave it out",
                            rows[i].option, desc->what, rows[i].of);
    if (desc->spacing != 0 && desc->count != 0)
        return cln_fail(CLN_USAGE,
                        "--spacing and --count: each sets the number of points; leave one out");
    CLN_TRY(cln_given_number("cln_export", "spacing", desc->spacing, 0, 1e12));
    CLN_TRY(cln_given_number("cln_export", "count", (double)desc->count, 0, 1e12));
    CLN_TRY(cln_given_number("cln_export", "triangles", (double)desc->triangles, 0, 1e12));
    CLN_TRY(cln_given_number("cln_export", "scale", desc->scale, 0, 1e12));
    CLN_TRY(cln_up_check("cln_export", desc->up));
    if (desc->up_auto && cln_up_given(desc->up))
        CLN_TRY(cln_fail(CLN_USAGE, "cln_export: up_auto is for an `up` of all 0; leave one out"));
    for (int a = 0; a < 3; a++)
        CLN_TRY(cln_given_number("cln_export", "offset", desc->offset[a], -1e12, 1e12));
    if (moves(desc) && (cln_export_ends(desc->file, ".glb") || cln_export_ends(desc->file, ".stl")))
        CLN_TRY(
            cln_fail(CLN_USAGE,
                     "--offset: not for %s: programs read .glb and .stl in 32 bits, too few for "
                     "a survey's coordinates; write .ply or .obj",
                     desc->file));
    if (desc->triangles)
        CLN_TRY(cln_mesh_reduce_possible());
done:
    return st;
}

/* ---- the work ---- */

/* Cells or distances that a surface falls through: fewer than two of them across the cube. */
static cln_status check_spacing(const cln_export_desc *desc, const cln_model *model)
{
    const double side = 2 * model->space.half;

    if (desc->spacing > side / 2)
        return cln_fail(CLN_USAGE,
                        "--spacing %g: too large for the scene, whose cube has a side of %.4g; "
                        "give less, such as %.2g, or leave it out",
                        desc->spacing, side, side / 256);
    return CLN_OK;
}

/* Boxes and a grid of equal cells have no meaning in a forward or shell space (scene/space.h). */
static cln_status check_space(const export_row *row, const cln_export_desc *desc,
                              const cln_model *model)
{
    const char *cells = row->needs & CLN_EXPORT_DEVICE ? "cells" : "leaves";

    if (model->space.shell && row->needs & CLN_EXPORT_BOXES)
        return cln_fail(CLN_USAGE,
                        "%s: trained with a shell beyond the cube (--space shell), where %s are "
                        "not boxes of the scene, so --%s cannot write them; train with --space "
                        "cube, or export --points or --mesh of what is in the cube",
                        desc->run, cells, desc->what);
    if (!model->space.forward)
        return check_spacing(desc, model);
    if (row->needs & CLN_EXPORT_BOXES)
        return cln_fail(CLN_USAGE,
                        "%s: trained in normalised device coordinates (--space ndc), where %s are "
                        "not boxes of the scene, so --%s cannot write them; train with --space "
                        "cube, or export --points or --mesh",
                        desc->run, cells, desc->what);
    if (desc->spacing != 0)
        return cln_fail(CLN_USAGE,
                        "--spacing: %s was trained in normalised device coordinates (--space ndc), "
                        "where cells grow with the distance; leave it out",
                        desc->run);
    return CLN_OK;
}

/* As render --orbit has it, so that what stands upright there does so here. */
static void find_up(const json_t *run, cln_export_job *job)
{
    cln_orbit_frame frame = {0};
    const bool glb = cln_export_ends(job->desc->file, ".glb");

    if (cln_up_given(job->desc->up)) {
        memcpy(job->up, job->desc->up, sizeof job->up);
    } else if (cln_orbit_frame_read(json_object_get(run, "orbit"), &frame) == CLN_OK) {
        memcpy(job->up, frame.up, sizeof job->up);
    } else { /* an older run has none */
        cln_clear_error();
        frame.guessed = !cln_up_of_cameras(job->opened.scene, job->up);
    }
    job->turns = cln_up_given(job->desc->up) || job->desc->up_auto;
    if (frame.guessed && (glb || job->turns))
        cln_up_warn(job->desc->file, job->up);
}

/* What slicers want of an STL, where it is not so. */
static void advise_print(const cln_export_job *job)
{
    const double level = 0.996; /* cosine of 5 degrees */
    const cln_export_desc *desc = job->desc;

    if (!cln_export_ends(desc->file, ".stl"))
        return;
    if (!job->turns && job->up[2] < level)
        cln_info("%s: up is (%.3g, %.3g, %.3g) in this scene, and slicers take z for it: --up auto "
                 "turns it there",
                 desc->file, job->up[0], job->up[1], job->up[2]);
    if (!desc->closed && job->result->open_edges > 0)
        cln_info("%s: the mesh is open, as a print must not be: --closed, with --largest for the "
                 "largest part alone, and --crop for a flat base",
                 desc->file);
}

/* A box's face is the base of what is cut by it, and is to be level where up is turned to z. */
static void advise_level(const cln_export_job *job)
{
    const double level = 0.99985; /* cosine of a degree */
    double numbers[CLN_CROP_NUMBERS], up[3], cosine = 0;
    char box[CLN_BOX_BYTES], turn[64];

    memcpy(up, job->up, sizeof up);
    if (!job->crop.on || !job->turns || !cln_normalise(up)) /* it may be as long as it was given */
        return;
    cosine = cln_crop_level(&job->crop, up, numbers);
    if (cosine > level)
        return;
    cln_box_write(numbers, numbers[3] - numbers[0], box);
    cln_format(turn, sizeof turn, "%.5g,%.5g,%.5g", numbers[6], numbers[7], numbers[8]);
    cln_info("%s: the box of --crop is %.2g degrees off level by --up, and so is what it cuts off; "
             "turned upright about its middle: --crop=%s,%s",
             job->desc->file, acos(fmin(1, cosine)) * 57.29577951308232, box, turn);
}

static cln_status open_for(const export_row *row, cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    cln_open_run *opened = &job->opened;
    bool alike = false;

    if (row->needs & CLN_EXPORT_DEVICE)
        CLN_TRY(cln_device_check(&desc->device));
    if (row->needs & CLN_EXPORT_SCENE)
        CLN_TRY(cln_open_run_cameras(desc->run, desc->scene, &desc->callbacks, &alike, opened));
    else
        CLN_TRY(cln_open_run_model(desc->run, opened));
    CLN_TRY(check_space(row, desc, &opened->model));
    CLN_TRY(cln_crop_check("--crop", &opened->model.space, &opened->model.tree, &job->crop));
    if (row->needs & CLN_EXPORT_DEVICE)
        CLN_TRY(
            cln_open_run_start(opened, &desc->device, opened->scene ? opened->scene->lenses : 0));
done:
    return st;
}

cln_status cln_export(const cln_export_desc *desc, cln_export_result *result)
{
    cln_status st = CLN_OK;
    const export_row *row = NULL;
    cln_export_job job = {.desc = desc, .result = result, .scale = 1};
    const cln_model *model = &job.opened.model;
    json_t *run = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_export", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_export", "desc", desc));
    CLN_TRY(cln_given("cln_export", "run", desc->run));
    CLN_TRY(cln_given("cln_export", "file", desc->file));
    CLN_TRY(find_export(desc->what, &row));
    job.scale = desc->scale != 0 ? desc->scale : 1;
    CLN_TRY(check_options(desc));
    CLN_TRY(cln_crop_of_desc(desc->cropped, desc->crop, desc->crop_turn, &job.crop));
    CLN_TRY(cln_reader_run(desc->run, &run));
    CLN_TRY(check_target(desc, row));
    CLN_TRY(open_for(row, &job));
    if (row->needs & CLN_EXPORT_SCENE)
        find_up(run, &job);
    CLN_TRY(row->write(&job));
    advise_print(&job);
    advise_level(&job);
    result->step = model->step;
    result->leaves = model->tree.leaf_count;
    cln_tree_levels(&model->tree, result->levels);
done:
    json_decref(run);
    cln_open_run_close(&job.opened);
    return st;
}
