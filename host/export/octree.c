/* export --octree: the active leaves as boxes. Reads only the checkpoint. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "export/export.h"
#include "export/surface.h"
#include "io/disk.h"
#include "io/palette.h"
#include "io/ply.h"

/* The leaves' boxes in scene units, scaled. */
static cln_status make_boxes(const cln_export_job *job, bool by_error, cln_ply_box **out)
{
    cln_status st = CLN_OK;
    const cln_model *model = &job->opened.model;
    const cln_octree *tree = &model->tree;
    double low = NAN, high = NAN;

    CLN_TRY(cln_alloc(out, (size_t)tree->leaf_count, sizeof **out, "boxes of the leaves"));
    if (!cln_palette_range(model->error ? tree->leaf_count : 0, model->error, &low, &high) &&
        by_error && tree->leaf_count > 0)
        cln_warn("no leaf has a measured error: all boxes are grey; errors are measured while a "
                 "tree adapts (--adaptive)");
    for (int s = 0; s < tree->leaf_count; s++) {
        cln_ply_box *box = &(*out)[s];
        const int node = tree->leaf[s], level = tree->level[node];
        float cube[4];

        cln_octree_box(tree, node, cube);
        cln_space_box_to_scene(&model->space, cube, box->min, box->max);
        for (int a = 0; a < 3; a++) {
            box->min[a] *= job->scale;
            box->max[a] *= job->scale;
        }
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

cln_status cln_export_octree(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    const cln_model *model = &job->opened.model;
    const char *colour = desc->colour ? desc->colour : "level";
    const bool by_error = strcmp(colour, "error") == 0;
    cln_ply_box *boxes = NULL;
    char *what = NULL, *comment = NULL;
    double fine = 0;

    CLN_TRY(make_boxes(job, by_error, &boxes));
    CLN_TRY(cln_disk_check_file(
        desc->file, 1024 + (double)CLN_PLY_BOX_BYTES * model->tree.leaf_count, "the boxes"));
    CLN_TRY(cln_asprintf(&what, "leaves of the octree, coloured by %s,", colour));
    CLN_TRY(cln_export_comment(job, what, &comment));
    fine = job->scale * cln_space_distance_to_scene(&model->space, cln_surface_cell(model));
    CLN_TRY(cln_ply_write_boxes(desc->file, model->tree.leaf_count, boxes, fine, comment));
done:
    free(boxes);
    free(what);
    free(comment);
    return st;
}
