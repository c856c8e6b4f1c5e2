/* cln_field_*: evaluates a trained run at points of the scene, by pipeline/field.h, and renders it
 * into memory, by render/view.h. This file checks what callers give and converts units: they have
 * the scene's, the pipeline the cube's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/given.h"
#include "base/memory.h"
#include "pipeline/field.h"
#include "io/image.h"
#include "render/open_run.h"
#include "render/view.h"

/* An array for what a caller does not want, kept from picture to picture. */
typedef struct spare {
    float *numbers;
    size_t count;
} spare;

struct cln_field {
    cln_open_run opened;     /* without a scene */
    bool prepared;           /* it has the densities of pictures */
    cln_rendering rendering; /* between calls without a picture */
    spare rgb, depth, opacity;
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

    cln_clear_error();
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
    cln_rendering_end(&field->rendering);
    free(field->rgb.numbers);
    free(field->depth.numbers);
    free(field->opacity.numbers);
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

    cln_clear_error();
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

/* ---- pictures ---- */

static const char RENDER[] = "cln_field_render";

_Static_assert(sizeof((cln_frame_desc){0}).params == sizeof((cln_camera){0}).distortion,
               "a lens has as many parameters in both");

/* Lens model and parameters, with the bounds of cln_camera_check. */
static cln_status read_lens(const cln_frame_desc *frame, cln_camera *out)
{
    cln_status st = CLN_OK;
    const cln_lens lens = frame->lens ? cln_lens_find(frame->lens) : CLN_LENS_OPENCV;
    const cln_lens_model *model = lens < CLN_LENSES ? &cln_lens_models[lens] : NULL;
    char name[32];

    if (!model)
        return cln_fail(CLN_USAGE,
                        "%s: lens is '%s', which is no lens model (docs/method.md 3.1); give "
                        "another, or NULL for a pinhole",
                        RENDER, frame->lens);
    for (int i = 0; i < CLN_LENS_PARAMS; i++) {
        const double most = frame->lens && i < model->count ? 1e3 : 0;

        snprintf(name, sizeof name, "params[%d]", i);
        CLN_TRY(cln_given_number(RENDER, name, frame->params[i], most > 0 ? -most : 0, most));
    }
    if (model->refuse && model->refuse(frame->params))
        CLN_TRY(cln_fail(CLN_USAGE, "%s: lens %s has no meaning with these params: %s", RENDER,
                         model->name, model->refuse(frame->params)));
    out->lens = lens;
    memcpy(out->distortion, frame->params, sizeof out->distortion);
    if (lens == CLN_LENS_EQUIRECTANGULAR)
        cln_camera_span_sphere(out);
done:
    return st;
}

static cln_status read_pose(const cln_frame_desc *frame, cln_camera *out)
{
    cln_status st = CLN_OK;
    char name[32], text[512];

    for (int i = 0; i < 12; i++) {
        snprintf(name, sizeof name, "c2w[%d]", i);
        CLN_TRY(cln_given_number(RENDER, name, frame->c2w[i], -1e12, 1e12));
    }
    memcpy(out->c2w, frame->c2w, sizeof out->c2w);
    if (cln_camera_check(out, "c2w") != CLN_OK) { /* as of a dataset: CLN_INPUT */
        snprintf(text, sizeof text, "%s", cln_error_text());
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_USAGE, "%s: %s", RENDER, text));
    }
done:
    return st;
}

static cln_status read_camera(const cln_frame_desc *frame, cln_camera *out)
{
    cln_status st = CLN_OK;
    const double pixels = (double)frame->width * frame->height,
                 most = 1e5 * fmax(frame->width, frame->height);
    const bool sphere = frame->lens && cln_lens_find(frame->lens) == CLN_LENS_EQUIRECTANGULAR;
    const struct {
        const char *what;
        double value, least, most;
        bool unused;
    } rows[] = {{"width", frame->width, 1, CLN_IMAGE_MAX_SIDE, false},
                {"height", frame->height, 1, CLN_IMAGE_MAX_SIDE, false},
                {"width x height", pixels, 1, CLN_IMAGE_MAX_PIXELS, false},
                {"fx", frame->fx, 1e-3 * frame->width, most, sphere},
                {"fy", frame->fy, 1e-3 * frame->width, most, sphere},
                {"cx", frame->cx, -most, most, sphere},
                {"cy", frame->cy, -most, most, sphere},
                {"antialias", frame->antialias, 0, 8, false}};

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (!rows[i].unused)
            CLN_TRY(
                cln_given_number(RENDER, rows[i].what, rows[i].value, rows[i].least, rows[i].most));
    for (int c = 0; frame->background && c < 3; c++)
        CLN_TRY(cln_given_number(RENDER, "background", (double)frame->background[c], 0, 1));
    *out = (cln_camera){.width = frame->width,
                        .height = frame->height,
                        .fx = frame->fx,
                        .fy = frame->fy,
                        .cx = frame->cx,
                        .cy = frame->cy};
    CLN_TRY(read_lens(frame, out));
    CLN_TRY(read_pose(frame, out));
done:
    return st;
}

/* Room for a picture that is larger than those before. */
static cln_status plan(cln_open_run *opened, double view_pixels, double picture_pixels)
{
    cln_status st = CLN_OK;
    const double before[2] = {opened->view_pixels, opened->picture_pixels};

    if (view_pixels <= before[0] && picture_pixels <= before[1])
        return CLN_OK;
    opened->view_pixels = fmax(view_pixels, before[0]);
    opened->picture_pixels = fmax(picture_pixels, before[1]);
    st = cln_open_run_plan(opened);
    if (st != CLN_OK) {
        opened->view_pixels = before[0];
        opened->picture_pixels = before[1];
    }
    return st;
}

/* Makes the device ready for the camera's picture, as view 0, with n x n rays at edges. */
static cln_status prepare(cln_field *field, const cln_camera *camera, int n)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &field->opened.pipeline;
    const double pixels = (double)camera->width * camera->height;

    CLN_TRY(plan(&field->opened, n * n * pixels, pixels));
    CLN_TRY(cln_pipeline_lenses(p, cln_camera_lenses(camera)));
    if (!field->prepared)
        CLN_TRY(cln_render_prepare(p));
    field->prepared = true;
    p->antialias = n;
    CLN_TRY(cln_pipeline_cameras(p, &camera, 1, &field->opened.model.space));
done:
    return st;
}

/* The caller's array, or a spare one. */
static cln_status choose_array(float *given, spare *s, size_t count, float **out)
{
    cln_status st = CLN_OK;

    if (!given && s->count < count) {
        free(s->numbers);
        *s = (spare){0};
        CLN_TRY(cln_alloc(&s->numbers, count, sizeof *s->numbers, "picture"));
        s->count = count;
    }
    *out = given ? given : s->numbers;
done:
    return st;
}

/* The arrays are the rendering's picture meanwhile. */
static cln_status render(cln_field *field, const cln_frame_desc *frame, const cln_camera *camera,
                         float *rgb, float *depth, float *opacity)
{
    cln_status st = CLN_OK;
    const cln_model *model = &field->opened.model;
    cln_picture *picture = &field->rendering.picture;
    const size_t n = (size_t)camera->width * (size_t)camera->height;

    CLN_TRY(prepare(field, camera, cln_open_run_antialias(&field->opened, frame->antialias)));
    CLN_TRY(choose_array(rgb, &field->rgb, 3 * n, &picture->rgb));
    CLN_TRY(choose_array(depth, &field->depth, n, &picture->depth));
    CLN_TRY(choose_array(opacity, &field->opacity, n, &picture->opacity));
    CLN_TRY(cln_render_into(&field->opened.pipeline,
                            frame->background ? frame->background : model->background,
                            frame->mean_depth ? CLN_DEPTH_MEAN : CLN_DEPTH_MEDIAN,
                            &frame->callbacks, &field->rendering));
    if (depth)
        cln_picture_to_scene(&model->space, picture);
    if (depth && frame->z_depth)
        cln_picture_along_axis(camera, picture);
done:
    memset(picture, 0, sizeof *picture);
    if (st != CLN_OK)
        cln_rendering_end(&field->rendering);
    return st;
}

cln_status cln_field_render(cln_field *field, const cln_frame_desc *frame, float *rgb, float *depth,
                            float *opacity)
{
    cln_status st = CLN_OK;
    cln_camera camera;

    cln_clear_error();
    CLN_TRY(cln_given(RENDER, "field", field));
    CLN_TRY(cln_given(RENDER, "frame", frame));
    CLN_TRY(read_camera(frame, &camera));
    CLN_TRY(render(field, frame, &camera, rgb, depth, opacity));
done:
    return st;
}
