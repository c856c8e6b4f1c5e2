/* cln_export: what a run holds for other programs, one function for each row of export.h. Reads the
 * newest checkpoint; opens no device and no scene. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "api/export.h"
#include "base/log.h"
#include "base/memory.h"
#include "cl_nascent.h"
#include "render/tree_picture.h"
#include "io/disk.h"
#include "io/palette.h"
#include "io/ply.h"
#include "io/run_folder.h"
#include "model/model.h"

/* Nothing that is there is replaced unasked, and nothing but a plain file ever; and no file is
 * called what it is not. form: "FILE.ply". */
static cln_status check_target(const cln_export_desc *desc, const char *form)
{
    const char *slash = strrchr(desc->file, '/');
    const char *ending = strrchr(slash ? slash : desc->file, '.'), *wanted = strchr(form, '.');
    struct stat info;

    if (ending && strcasecmp(ending, wanted) != 0)
        return cln_fail(CLN_USAGE, "%s: --%s writes %s files; end the name with %s", desc->file,
                        desc->what, wanted, wanted);
    if (lstat(desc->file, &info) != 0)
        return CLN_OK;
    if (!S_ISREG(info.st_mode))
        return cln_fail(CLN_OUTPUT,
                        "%s: already exists and is not a plain file; choose another name",
                        desc->file);
    if (!desc->overwrite)
        return cln_fail(CLN_OUTPUT, "%s: already exists; choose another name, or give --overwrite",
                        desc->file);
    return CLN_OK;
}

/* The leaves' boxes in scene units. */
static cln_status make_boxes(const cln_model *model, bool by_error, cln_ply_box **out)
{
    cln_status st = CLN_OK;
    const cln_octree *tree = &model->tree;
    double low = NAN, high = NAN;

    CLN_TRY(cln_alloc(out, (size_t)tree->leaf_count, sizeof **out, "boxes of the leaves"));
    if (!cln_palette_range(model->error ? tree->leaf_count : 0, model->error, &low, &high) &&
        by_error && tree->leaf_count > 0)
        cln_warn("no leaf has a measured error yet: all boxes are grey");
    for (int s = 0; s < tree->leaf_count; s++) {
        cln_ply_box *box = &(*out)[s];
        const int node = tree->leaf[s], level = tree->level[node];
        float cube[4];

        cln_octree_box(tree, node, cube);
        cln_space_box_to_scene(&model->space, cube, box->min, box->max);
        box->level = (uint8_t)level;
        box->error = model->error ? model->error[s] : NAN;
        if (by_error)
            cln_palette_error(box->error, low, high, box->colour);
        else
            cln_palette_level(level, box->colour);
    }
done:
    return st;
}

/* ---- octree ---- */

static cln_status write_octree(const cln_export_desc *desc, const cln_model *model)
{
    cln_status st = CLN_OK;
    const char *colour = desc->colour ? desc->colour : "level";
    const bool by_error = strcmp(colour, "error") == 0;
    cln_ply_box *boxes = NULL;
    char *comment = NULL;

    CLN_TRY(make_boxes(model, by_error, &boxes));
    CLN_TRY(cln_asprintf(&comment,
                         "cl-nascent " CLN_VERSION ": leaves of the octree at step %lld, coloured "
                         "by %s; scene units",
                         (long long)model->step, colour));
    CLN_TRY(cln_ply_write_boxes(desc->file, model->tree.leaf_count, boxes, comment));
done:
    free(boxes);
    free(comment);
    return st;
}

/* ---- the list ---- */

static const struct {
    const char *what, *form;
    cln_status (*write)(const cln_export_desc *desc, const cln_model *model);
} exports[] = {
#define X(what, form, help) {#what, form, write_##what},
    CLN_EXPORT_LIST(X)
#undef X
};

enum { EXPORTS = sizeof exports / sizeof exports[0] };

static cln_status find_export(const char *what, int *found)
{
    char known[256] = "";

    for (int i = 0; i < EXPORTS; i++) {
        const size_t used = strlen(known);

        *found = i;
        if (what && strcmp(what, exports[i].what) == 0)
            return CLN_OK;
        snprintf(known + used, sizeof known - used, "%s%s", i ? "|" : "", exports[i].what);
    }
    return cln_fail(CLN_USAGE, "export: '%s' is not one of %s", what ? what : "", known);
}

cln_status cln_export(const cln_export_desc *desc, cln_export_result *result)
{
    cln_status st = CLN_OK;
    int wanted = 0;
    json_t *run = NULL;
    cln_model model = {0};

    memset(result, 0, sizeof *result);
    CLN_TRY(find_export(desc->what, &wanted));
    if (desc->colour && strcmp(desc->colour, "error") != 0 && strcmp(desc->colour, "level") != 0)
        CLN_TRY(cln_fail(CLN_USAGE, "--colour: '%s' is not one of level|error", desc->colour));
    /* tells a folder that is no run from one without checkpoint */
    CLN_TRY(cln_run_read(desc->run, &run));
    CLN_TRY(check_target(desc, exports[wanted].form));
    CLN_TRY(cln_checkpoint_read(desc->run, false, &model));
    CLN_TRY(cln_disk_check_file(
        desc->file, 1024 + (double)CLN_PLY_BOX_BYTES * model.tree.leaf_count, "the boxes"));
    CLN_TRY(exports[wanted].write(desc, &model));
    result->step = model.step;
    result->leaves = model.tree.leaf_count;
    cln_tree_levels(&model.tree, result->levels);
done:
    json_decref(run);
    cln_model_free(&model);
    return st;
}
