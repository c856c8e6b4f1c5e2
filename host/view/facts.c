/* See facts.h. */
#include "view/facts.h"

#include <stdio.h>
#include <string.h>

#include "io/palette.h"
#include "render/frames.h"

enum { ERROR_COLOURS = 5 };

static json_t *numbers(const double *values, int count)
{
    json_t *list = json_array();

    for (int i = 0; i < count; i++)
        json_array_append_new(list, json_real(values[i]));
    return list;
}

static json_t *camera_json(const cln_view *view)
{
    cln_camera c;
    bool around = false;

    cln_view_seen(view, &c); /* as its photo and its pictures come */
    around = c.lens == CLN_LENS_EQUIRECTANGULAR;
    return json_pack("{s:s, s:s, s:o, s:f, s:i, s:i, s:b}", "name", view->name, "split",
                     cln_split_names[view->split], "pose", numbers(c.c2w, 12), "focal",
                     around ? 0.5 * c.width : c.fy, /* of a part of it, to look at */
                     "width", c.width, "height", c.height, "around", around);
}

/* The cube; in a forward space, which has no end, a box about the target as wide as the cameras are
 * far. */
static json_t *box_json(const cln_space *space, const cln_orbit_frame *frame)
{
    double box[6];

    for (int i = 0; i < 6; i++) {
        const double middle = space->forward ? frame->target[i % 3] : space->centre[i % 3];
        const double half = space->forward ? frame->distance : space->half;

        box[i] = middle + (i < 3 ? -half : half);
    }
    return numbers(box, 6);
}

static json_t *colour_json(const uint8_t rgb[3])
{
    char text[8];

    snprintf(text, sizeof text, "#%02x%02x%02x", rgb[0], rgb[1], rgb[2]);
    return json_string(text);
}

static json_t *levels_json(void)
{
    json_t *list = json_array();
    uint8_t rgb[3];

    for (int level = 0; level < CLN_PALETTE_LEVELS; level++) {
        cln_palette_level(level, rgb);
        json_array_append_new(list, colour_json(rgb));
    }
    return list;
}

static json_t *errors_json(void)
{
    json_t *list = json_array();
    uint8_t rgb[3];

    for (int i = 0; i < ERROR_COLOURS; i++) {
        cln_palette_ramp((double)i / (ERROR_COLOURS - 1), rgb);
        json_array_append_new(list, colour_json(rgb));
    }
    return list;
}

/* For paths in nerfstudio's frame. A damaged file does not hinder the rest. */
static cln_status applied_json(const cln_facts *facts, json_t **out)
{
    cln_status st = CLN_OK;
    static const double none[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    double applied[12], scale = 1;
    bool known = !facts->transforms_gone;
    json_t *rows = NULL;

    memcpy(applied, none, sizeof applied);
    if (facts->transforms)
        st = cln_frames_applied(facts->transforms, applied, &scale);
    if (st == CLN_INPUT) {
        cln_clear_error();
        memcpy(applied, none, sizeof applied);
        scale = 1;
        known = false;
        st = CLN_OK;
    }
    CLN_TRY(st);
    rows = json_array();
    for (int i = 0; i < 3; i++)
        json_array_append_new(rows, numbers(applied + (size_t)4 * (size_t)i, 4));
    *out = json_pack("{s:o, s:f, s:b}", "transform", rows, "scale", scale, "known", known);
done:
    return st;
}

cln_status cln_facts_text(const cln_facts *facts, char **out)
{
    cln_status st = CLN_OK;
    const cln_model *model = facts->model;
    const cln_orbit_frame *frame = facts->frame;
    const cln_camera *start = facts->start;
    const double background[3] = {model->background[0], model->background[1], model->background[2]};
    json_t *cameras = NULL, *document = NULL, *applied = NULL;

    *out = NULL;
    CLN_TRY(applied_json(facts, &applied));
    cameras = json_array();
    for (int i = 0; facts->scene && i < facts->scene->view_count; i++)
        json_array_append_new(cameras, camera_json(&facts->scene->views[i]));
    document = json_pack(
        "{s:s, s:I, s:i, s:b, s:o, s:o, s:o, s:f, s:o, s:f, s:o, s:b, s:o, s:o, s:o, s:i, s:i, "
        "s:f, "
        "s:o, s:o}",
        "run", facts->run, "step", (json_int_t)model->step, "leaves", model->tree.leaf_count,
        "training", facts->training, "background", numbers(background, 3), "target",
        numbers(frame->target, 3), "up", numbers(frame->up, 3), "distance", frame->distance,
        "centre", numbers(model->space.centre, 3), "half", model->space.half, "box",
        box_json(&model->space, frame), "endless", model->space.forward || model->space.shell,
        "levels", levels_json(), "errors", errors_json(), "start", numbers(start->c2w, 12), "width",
        start->width, "height", start->height, "focal", start->fy, "cameras", cameras, "applied",
        applied);
    *out = document ? json_dumps(document, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    if (!*out)
        CLN_TRY(cln_fail(CLN_MEMORY, "the facts of %s: cannot be put into JSON", facts->run));
done:
    json_decref(document);
    return st;
}

cln_status cln_facts_camera(const cln_orbit_frame *frame, cln_camera *out)
{
    cln_status st = CLN_OK;
    const cln_render_desc desc = {.orbit_elevation = frame->elevation};
    cln_orbit orbit;

    CLN_TRY(cln_orbit_make(frame, &desc, &orbit));
    cln_orbit_camera(&orbit, orbit.circle ? 0 : 1, 4, out);
done:
    return st;
}
