/* cln_field_*: evaluates a trained run at points of the scene, by pipeline/field.h. This file only
 * converts units: callers have scene units, the pipeline the cube. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/given.h"
#include "base/memory.h"
#include "pipeline/field.h"
#include "render/open_run.h"

struct cln_field {
    cln_open_run opened; /* without a scene */
};

enum {
    CHUNK = 65536,  /* points converted at a time */
    FARTHEST = 1000 /* depth of a forward space's box, in near planes */
};

cln_status cln_field_open(const char *run, const cln_device_desc *device, cln_field **out)
{
    cln_status st = CLN_OK;
    const cln_device_desc any = {0};
    cln_field *field = NULL;

    CLN_TRY(cln_given("cln_field_open", "out", out));
    *out = NULL;
    CLN_TRY(cln_given("cln_field_open", "run", run));
    CLN_TRY(cln_alloc(&field, 1, sizeof *field, "field"));
    CLN_TRY(cln_open_run_model(run, &field->opened));
    CLN_TRY(cln_open_run_start(&field->opened, device ? device : &any, false));
    field->opened.run = NULL; /* the caller owns the string */
    *out = field;
    field = NULL;
done:
    cln_field_close(field);
    return st;
}

void cln_field_close(cln_field *field)
{
    if (!field)
        return;
    cln_open_run_close(&field->opened);
    free(field);
}

void cln_field_box(const cln_field *field, double min[3], double max[3])
{
    const cln_space *space = field ? &field->opened.model.space : NULL;

    if (!space || !min || !max)
        return;
    if (space->forward) { /* around the part of the cube up to FARTHEST near planes away */
        for (int k = 0; k < 8; k++) {
            const double cube[3] = {k & 1 ? 1 : -1, k & 2 ? 1 : -1,
                                    k & 4 ? 1 - 2.0 / FARTHEST : -1};
            double corner[3];

            cln_space_point_to_scene(space, cube, corner);
            for (int a = 0; a < 3; a++) {
                min[a] = k ? fmin(min[a], corner[a]) : corner[a];
                max[a] = k ? fmax(max[a], corner[a]) : corner[a];
            }
        }
        return;
    }
    for (int a = 0; a < 3; a++) { /* in a shell space, the core */
        min[a] = space->centre[a] - space->half;
        max[a] = space->centre[a] + space->half;
    }
}

static cln_status to_cube(const cln_space *space, size_t i, const double position[3], float out[4])
{
    double cube[3];

    for (int a = 0; a < 3; a++)
        if (!isfinite(position[a]))
            return cln_fail(CLN_USAGE, "position %zu: %g,%g,%g is not finite", i, position[0],
                            position[1], position[2]);
    cln_space_point_to_cube(space, position, cube);
    for (int a = 0; a < 3; a++)
        out[a] = (float)cube[a];
    out[3] = 0;
    return CLN_OK;
}

/* Normalises a direction; NULL gives any, as densities in the cube do not depend on it. */
static cln_status to_unit(size_t i, const float *direction, float out[4])
{
    double length = 0;

    memcpy(out, (const float[4]){0, 0, 1, 1}, 4 * sizeof *out);
    if (!direction)
        return CLN_OK;
    for (int a = 0; a < 3; a++)
        length += (double)direction[a] * direction[a];
    length = sqrt(length);
    if (!(length > 0 && isfinite(length)))
        return cln_fail(CLN_USAGE, "direction %zu: %g,%g,%g has no finite length above 0", i,
                        (double)direction[0], (double)direction[1], (double)direction[2]);
    for (int a = 0; a < 3; a++)
        out[a] = (float)(direction[a] / length);
    return CLN_OK;
}

/* Turns the direction `towards` of the scene into one of the cube, in a forward or shell space.
 * look: the scene's direction; if none was given, the mean camera's axis, in a shell space z. */
static void turn_to_cube(const cln_space *space, const double position[3], bool given,
                         float towards[4], double look[3])
{
    double cube[3];

    for (int a = 0; a < 3; a++)
        look[a] = given || space->shell ? (double)towards[a] : space->axes[6 + a];
    cln_space_direction_to_cube(space, position, look, cube);
    for (int a = 0; a < 3; a++)
        towards[a] = (float)cube[a];
}

cln_status cln_field_at(cln_field *field, size_t n, const double (*positions)[3],
                        const float (*directions)[3], float (*rgb)[3], float *sigma)
{
    cln_status st = CLN_OK;
    const cln_model *model = field ? &field->opened.model : NULL;
    const size_t most = n < CHUNK ? n : CHUNK;
    float(*at)[4] = NULL, (*towards)[4] = NULL, (*out)[4] = NULL;
    double(*looks)[3] = NULL;

    CLN_TRY(cln_given("cln_field_at", "field", field));
    if (n > 0)
        CLN_TRY(cln_given("cln_field_at", "positions", positions));
    if (rgb && !directions)
        CLN_TRY(cln_fail(CLN_USAGE, "colour depends on the direction: give directions, or no rgb"));
    CLN_TRY(cln_alloc(&at, most, sizeof *at, "points"));
    CLN_TRY(cln_alloc(&towards, most, sizeof *towards, "points"));
    CLN_TRY(cln_alloc(&out, most, sizeof *out, "points"));
    CLN_TRY(cln_alloc(&looks, most, sizeof *looks, "points"));
    for (size_t first = 0; first < n; first += most) {
        const size_t count = n - first < most ? n - first : most;

        for (size_t i = 0; i < count; i++) {
            CLN_TRY(to_cube(&model->space, first + i, positions[first + i], at[i]));
            CLN_TRY(to_unit(first + i, directions ? directions[first + i] : NULL, towards[i]));
            if (model->space.forward || model->space.shell)
                turn_to_cube(&model->space, positions[first + i], directions != NULL, towards[i],
                             looks[i]);
        }
        CLN_TRY(cln_field_points(&field->opened.pipeline, &model->tree, count,
                                 (const float(*)[4])at, (const float(*)[4])towards, out));
        for (size_t i = 0; i < count; i++) {
            if (rgb)
                memcpy(rgb[first + i], out[i], sizeof rgb[0]);
            if (sigma)
                sigma[first + i] = (float)cln_space_density_to_scene(
                    &model->space, positions[first + i], looks[i], out[i][3]);
        }
    }
done:
    free(at);
    free(towards);
    free(looks);
    free(out);
    return st;
}
