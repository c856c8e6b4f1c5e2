/* Checkpoints of a run: RUN/checkpoint/NNNNNNNN.safetensors (tree, weights, training state), beside
 * it NNNNNNNN.json (all the rest), and `latest`, a text file with the newest one's number.
 * docs/formats.md has every key.
 *
 * A checkpoint exists when its .json does: it is written after its .safetensors, each by atomic
 * rename, so a crash at any point leaves the earlier ones whole. The .json holds the tensors'
 * digest and its own, so damaged files and halves of different checkpoints are never used. Every
 * size read is compared with the settings and the tree before it is used. Does not touch the rest
 * of the run folder. */
#include "model/checkpoint.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "cl_nascent.h"
#include "io/hold.h"
#include "io/run_folder.h"
#include "io/safetensors.h"

#define SCHEMA "cl-nascent.checkpoint/2"
#define FOLDER "checkpoint"
enum {
    KEEP = 2,
    SHOWN_TENSORS = 3,
    TRAINING_TENSORS = 10,
    ROW = 8,
    NAME_BYTES = 64,
    JSON_BYTES = 16384
};

/* ---- the JSON half ---- */

/* Digest of the document's text without its own "digest". 17 digits reproduce every double, so the
 * text is the same after it was read back. */
static cln_status digest_document(json_t *document, char hex[CLN_DIGEST_TEXT])
{
    char *text = NULL;

    json_object_del(document, "digest");
    text = json_dumps(document, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    if (!text)
        return cln_fail(CLN_MEMORY, "checkpoint: out of host memory");
    cln_digest_text(cln_digest(CLN_DIGEST_START, text, strlen(text)), hex);
    free(text);
    return CLN_OK;
}

/* NULL without memory, or if one is not finite. */
static json_t *reals(const double *v, size_t n)
{
    json_t *array = json_array();

    for (size_t i = 0; array && i < n; i++) {
        if (json_array_append_new(array, json_real(v[i])) != 0) {
            json_decref(array);
            array = NULL;
        }
    }
    return array;
}

/* What a forward space has besides centre and half. */
static json_t *forward_json(const cln_space *space)
{
    return json_pack("{s:o, s:o}", "axes", reals(space->axes, 9), "scale", reals(space->scale, 2));
}

static json_t *row_json(const cln_row_sums *row)
{
    return json_pack("{s:I, s:I, s:I, s:f, s:f, s:f}", "steps", (json_int_t)row->steps, "rays",
                     (json_int_t)row->rays, "samples", (json_int_t)row->samples, "loss", row->loss,
                     "square", row->square, "began", row->began);
}

static cln_status make_document(const cln_model *model, const char *tensors, uint64_t data_digest,
                                uint64_t model_digest, json_t **out)
{
    cln_status st = CLN_OK;
    json_t *config = NULL, *document = NULL;
    json_error_t why;
    char data_hex[CLN_DIGEST_TEXT], model_hex[CLN_DIGEST_TEXT], hex[CLN_DIGEST_TEXT];
    char names_hex[CLN_DIGEST_TEXT];

    CLN_TRY(cln_config_to_json(&model->config, &config));
    cln_digest_text(data_digest, data_hex);
    cln_digest_text(model_digest, model_hex);
    cln_digest_text(model->training_names, names_hex);
    document = json_pack_ex(
        &why, 0,
        "{s:s, s:s, s:I, s:I, s:I, s:f, s:i, s:i, s:b, s:i, s:i, s:{s:[f,f,f], s:f}, s:[f,f,f],"
        " s:b, s:b, s:s, s:s, s:s, s:O, s:{s:I, s:f, s:f, s:i}}",
        "schema", SCHEMA, "version", CLN_VERSION, "step", (json_int_t)model->step, "refresh_step",
        (json_int_t)model->refresh_step, "growth_step", (json_int_t)model->growth_step,
        "train_seconds", model->train_seconds, "rays", model->rays, "level", model->level,
        "training", model->adam_m != NULL, "leaves", model->tree.leaf_count, "params_per_leaf",
        model->net.params, "cube", "centre", model->space.centre[0], model->space.centre[1],
        model->space.centre[2], "half", model->space.half, "background",
        (double)model->background[0], (double)model->background[1], (double)model->background[2],
        "has_alpha", model->has_alpha, "has_distortion", model->has_distortion, "tensors", tensors,
        "tensors_digest", data_hex, "model_digest", model_hex, "config", config, "measured", "rays",
        (json_int_t)model->sum_rays, "square", model->sum_square, "last_square", model->last_square,
        "decisions", model->decisions);
    if (!document && json_error_code(&why) == json_error_numeric_overflow)
        CLN_TRY(cln_fail(CLN_INTERNAL, "checkpoint of step %" PRId64 ": a setting is not finite",
                         model->step));
    if (!document || json_object_set_new(document, "row", row_json(&model->row)) != 0 ||
        json_object_set_new(document, "drawn", json_integer((json_int_t)model->drawn)) != 0 ||
        json_object_set_new(document, "averaged", json_integer(cln_model_antialias(model))) != 0 ||
        (model->in_parts && json_object_set_new(document, "in_parts", json_true()) != 0) ||
        (model->exposed && json_object_set_new(document, "exposed", json_true()) != 0) ||
        (model->training_names &&
         json_object_set_new(document, "training_names", json_string(names_hex)) != 0) ||
        (model->space.forward && json_object_set_new(json_object_get(document, "cube"), "ndc",
                                                     forward_json(&model->space)) != 0) ||
        (model->space.shell &&
         json_object_set_new(json_object_get(document, "cube"), "shell", json_true()) != 0))
        CLN_TRY(cln_fail(CLN_MEMORY, "checkpoint of step %" PRId64 ": out of host memory",
                         model->step));
    CLN_TRY(digest_document(document, hex));
    if (json_object_set_new(document, "digest", json_string(hex)) != 0)
        CLN_TRY(cln_fail(CLN_MEMORY, "checkpoint: out of host memory"));
    *out = document;
    document = NULL;
done:
    json_decref(document);
    json_decref(config);
    return st;
}

/* More than any training counts; two of them add up without overflow. */
static const int64_t MOST_COUNT = INT64_MAX / 4;

/* A whole number in low..high, or CLN_CHECKPOINT. */
static cln_status get_int(const json_t *object, const char *path, const char *key, int64_t low,
                          int64_t high, int64_t *out)
{
    const json_t *value = json_object_get(object, key);

    if (!json_is_integer(value) || json_integer_value(value) < low ||
        json_integer_value(value) > high)
        return cln_fail(CLN_CHECKPOINT,
                        "%s: \"%s\" is not a whole number from %" PRId64 " to %" PRId64, path, key,
                        low, high);
    *out = json_integer_value(value);
    return CLN_OK;
}

static cln_status get_real(const json_t *value, const char *path, const char *key, double *out)
{
    if (!json_is_number(value))
        return cln_fail(CLN_CHECKPOINT, "%s: \"%s\" is not a number", path, key);
    *out = json_number_value(value);
    return CLN_OK;
}

/* row: NULL in older checkpoints. */
static cln_status read_row(const json_t *row, const char *path, cln_row_sums *out)
{
    cln_status st = CLN_OK;

    *out = (cln_row_sums){0};
    if (!row)
        goto done;
    CLN_TRY(get_int(row, path, "steps", 0, MOST_COUNT, &out->steps));
    CLN_TRY(get_int(row, path, "rays", 0, MOST_COUNT, &out->rays));
    CLN_TRY(get_int(row, path, "samples", 0, MOST_COUNT, &out->samples));
    CLN_TRY(get_real(json_object_get(row, "loss"), path, "loss", &out->loss));
    CLN_TRY(get_real(json_object_get(row, "square"), path, "square", &out->square));
    CLN_TRY(get_real(json_object_get(row, "began"), path, "began", &out->began));
done:
    return st;
}

static cln_status read_forward(const json_t *ndc, const char *path, cln_space *out)
{
    cln_status st = CLN_OK;

    out->forward = ndc != NULL;
    for (size_t i = 0; ndc && i < 9; i++)
        CLN_TRY(
            get_real(json_array_get(json_object_get(ndc, "axes"), i), path, "axes", &out->axes[i]));
    for (size_t i = 0; ndc && i < 2; i++) {
        CLN_TRY(get_real(json_array_get(json_object_get(ndc, "scale"), i), path, "scale",
                         &out->scale[i]));
        if (!(out->scale[i] > 0))
            CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: its cube has no size", path));
    }
done:
    return st;
}

static cln_status read_scalars(const json_t *document, const char *path, cln_model *out)
{
    cln_status st = CLN_OK;
    const json_t *cube = json_object_get(document, "cube");
    const json_t *alpha = json_object_get(document, "has_alpha");
    const json_t *distortion = json_object_get(document, "has_distortion");
    const json_t *measured = json_object_get(document, "measured");
    const char *training_names = json_string_value(json_object_get(document, "training_names"));
    int64_t rays = 0, level = 0, decisions = 0, averaged = 1;
    double channel = 0;

    CLN_TRY(get_int(document, path, "step", 0, MOST_COUNT, &out->step));
    CLN_TRY(get_int(document, path, "refresh_step", -MOST_COUNT, MOST_COUNT, &out->refresh_step));
    CLN_TRY(get_int(document, path, "growth_step", 0, MOST_COUNT, &out->growth_step));
    CLN_TRY(get_int(document, path, "rays", 0, INT32_MAX, &rays));
    CLN_TRY(get_int(document, path, "level", 0, CLN_MAX_LEVEL, &level));
    if (json_object_get(document, "drawn")) /* later than the others */
        CLN_TRY(get_int(document, path, "drawn", 0, MOST_COUNT, &out->drawn));
    if (json_object_get(document, "averaged"))
        CLN_TRY(get_int(document, path, "averaged", 1, 4, &averaged));
    CLN_TRY(read_row(json_object_get(document, "row"), path, &out->row));
    out->averaged = averaged > 1;
    out->in_parts = json_is_true(json_object_get(document, "in_parts"));
    CLN_TRY(get_real(json_object_get(document, "train_seconds"), path, "train_seconds",
                     &out->train_seconds));
    CLN_TRY(get_int(measured, path, "rays", 0, MOST_COUNT, &out->sum_rays));
    CLN_TRY(get_int(measured, path, "decisions", 0, INT32_MAX, &decisions));
    CLN_TRY(get_real(json_object_get(measured, "square"), path, "square", &out->sum_square));
    CLN_TRY(
        get_real(json_object_get(measured, "last_square"), path, "last_square", &out->last_square));
    CLN_TRY(get_real(json_object_get(cube, "half"), path, "half", &out->space.half));
    for (size_t a = 0; a < 3; a++) {
        CLN_TRY(get_real(json_array_get(json_object_get(cube, "centre"), a), path, "centre",
                         &out->space.centre[a]));
        CLN_TRY(get_real(json_array_get(json_object_get(document, "background"), a), path,
                         "background", &channel));
        out->background[a] = (float)channel;
    }
    CLN_TRY(read_forward(json_object_get(cube, "ndc"), path, &out->space));
    out->space.shell = json_is_true(json_object_get(cube, "shell"));
    if (!(out->space.half > 0))
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: its cube has no size", path));
    if (!json_is_boolean(alpha) || !json_is_boolean(distortion))
        CLN_TRY(
            cln_fail(CLN_CHECKPOINT, "%s: \"has_alpha\" or \"has_distortion\" is missing", path));
    out->has_alpha = json_is_true(alpha);
    out->has_distortion = json_is_true(distortion);
    out->rays = (int)rays;
    out->level = (int)level;
    out->decisions = (int)decisions;
    CLN_TRY(cln_config_from_json(json_object_get(document, "config"), &out->config));
    out->exposed = json_is_true(json_object_get(document, "exposed")) ||
                   out->config.exposure == CLN_EXPOSURE_YES; /* older ones do not tell it */
    out->training_names = training_names ? strtoull(training_names, NULL, 16) : 0;
    CLN_TRY(cln_network_layout(&out->config, &out->net));
done:
    return st;
}

/* Checks schema and digest, then fills in all but the tensors, and tensors_digest. */
static cln_status read_document(const char *path, bool training, cln_model *out,
                                char tensors_digest[CLN_DIGEST_TEXT])
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const char *schema = NULL, *wanted = NULL, *digest = NULL;
    char hex[CLN_DIGEST_TEXT], stated[CLN_DIGEST_TEXT];

    CLN_TRY(cln_json_read(path, false, &document));
    schema = json_string_value(json_object_get(document, "schema"));
    if (!schema || strcmp(schema, SCHEMA) != 0)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: its schema is %s, not %s", path,
                         schema ? schema : "not named", SCHEMA));
    wanted = json_string_value(json_object_get(document, "digest"));
    snprintf(stated, sizeof stated, "%s", wanted ? wanted : "");
    CLN_TRY(digest_document(document, hex));
    if (strcmp(stated, hex) != 0)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: it was changed or damaged (digest %s, not %s)", path,
                         hex, stated));
    digest = json_string_value(json_object_get(document, "tensors_digest"));
    if (!digest || strlen(digest) != CLN_DIGEST_TEXT - 1)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: \"tensors_digest\" is missing", path));
    memcpy(tensors_digest, digest, CLN_DIGEST_TEXT);
    if (training && json_is_false(json_object_get(document, "training")))
        CLN_TRY(cln_fail(CLN_CHECKPOINT,
                         "%s: it has no state of training, as `export --copy` leaves it out; go on "
                         "with the run that it is a copy of",
                         path));
    CLN_TRY(read_scalars(document, path, out));
done:
    json_decref(document);
    return st;
}

/* ---- the tensor half ---- */

static cln_dtype moment_dtype(const cln_model *model)
{
    return model->config.moments == CLN_MOMENTS_BFLOAT16 ? CLN_DTYPE_BF16 : CLN_DTYPE_F32;
}

cln_status cln_checkpoint_tensors(const cln_model *model, cln_tensor *out, int *number,
                                  int32_t **rows)
{
    cln_status st = CLN_OK;
    int64_t leaves = model->tree.leaf_count, stride = model->net.params, n1 = model->config.n1;
    const int64_t firsts = cln_first_moment_bytes(&model->config) > 0 ? stride : 0;
    const int64_t decoder = model->net.decoder_params;
    int count = SHOWN_TENSORS;
    cln_tensor tensors[CLN_CHECKPOINT_TENSORS] = {
        {"octree", CLN_DTYPE_I32, 2, {model->tree.node_count, ROW}, NULL},
        {"params", CLN_DTYPE_F32, 2, {leaves, stride}, model->params},
        {"leaf_error", CLN_DTYPE_F32, 1, {leaves}, model->error},
        {"adam_m", moment_dtype(model), 2, {leaves, firsts}, model->adam_m},
        {"adam_v", moment_dtype(model), 2, {leaves, stride}, model->adam_v},
        {"adam_steps", CLN_DTYPE_I32, 1, {leaves}, model->adam_steps},
        {"density", CLN_DTYPE_BF16, 4, {leaves, n1, n1, n1}, model->density},
        {"leaf_sums", CLN_DTYPE_F32, 3, {leaves, CLN_MEASURES, 2}, model->sums},
        {"leaf_met", CLN_DTYPE_I32, 1, {leaves}, model->met},
        {"leaf_saved", CLN_DTYPE_F32, 1, {leaves}, model->saved}};

    CLN_TRY(cln_octree_pack(&model->tree, rows));
    tensors[0].data = *rows;
    if (model->adam_m)
        count = TRAINING_TENSORS;
    if (model->exposure)
        tensors[count++] = (cln_tensor){
            "exposure", CLN_DTYPE_F32, 2, {model->exposure_views, CLN_EXPOSURE}, model->exposure};
    if (model->motions)
        tensors[count++] = (cln_tensor){
            "poses", CLN_DTYPE_F32, 2, {model->motion_views, CLN_MOTION}, model->motions};
    if (decoder > 0)
        tensors[count++] = (cln_tensor){"decoder", CLN_DTYPE_F32, 1, {decoder}, model->decoder};
    if (decoder > 0 && model->adam_m) {
        tensors[count++] = (cln_tensor){"decoder_m", CLN_DTYPE_F32, 1, {decoder}, model->decoder_m};
        tensors[count++] = (cln_tensor){"decoder_v", CLN_DTYPE_F32, 1, {decoder}, model->decoder_v};
    }
    memcpy(out, tensors, sizeof tensors);
    *number = count;
done:
    return st;
}

/* *out = copy of a tensor that must have exactly this shape. */
static cln_status take_tensor(const cln_safetensors *file, const char *path, const char *name,
                              cln_dtype dtype, int dims, const int64_t *shape, void *out)
{
    cln_status st = CLN_OK;
    cln_tensor tensor;
    void *copy = NULL;
    size_t bytes = 0;
    bool same = true;

    CLN_TRY(cln_safetensors_get(file, name, dtype, &tensor));
    for (int i = 0; i < dims; i++)
        same = same && i < tensor.dims && tensor.shape[i] == shape[i];
    if (!same || tensor.dims != dims)
        CLN_TRY(cln_fail(CLN_CHECKPOINT,
                         "%s: tensor '%s' does not have the shape that settings and tree need",
                         path, name));
    bytes = cln_tensor_bytes(&tensor);
    CLN_TRY(cln_alloc(&copy, bytes, 1, name));
    if (bytes)
        memcpy(copy, tensor.data, bytes);
    memcpy(out, &copy, sizeof copy);
done:
    return st;
}

static cln_status read_tree(const cln_safetensors *file, const char *path, cln_octree *out)
{
    cln_status st = CLN_OK;
    cln_tensor tensor;
    int32_t *rows = NULL;

    CLN_TRY(cln_safetensors_get(file, "octree", CLN_DTYPE_I32, &tensor));
    if (tensor.dims != 2 || tensor.shape[1] != ROW || tensor.shape[0] > INT32_MAX)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: tensor 'octree' does not have the shape [nodes, %d]",
                         path, ROW));
    CLN_TRY(take_tensor(file, path, "octree", CLN_DTYPE_I32, 2, tensor.shape, &rows));
    CLN_TRY(cln_octree_unpack(rows, (int)tensor.shape[0], out));
done:
    free(rows);
    return st;
}

/* A tensor with a row per training view, of which there are *views. */
static cln_status take_views(const cln_safetensors *file, const char *path, const char *name,
                             int width, void *out, int *views)
{
    cln_status st = CLN_OK;
    cln_tensor tensor;
    int64_t shape[2] = {0, width};

    CLN_TRY(cln_safetensors_get(file, name, CLN_DTYPE_F32, &tensor));
    shape[0] = tensor.dims == 2 && tensor.shape[0] < INT32_MAX ? tensor.shape[0] : 0;
    CLN_TRY(take_tensor(file, path, name, CLN_DTYPE_F32, 2, shape, out));
    *views = (int)shape[0];
done:
    return st;
}

/* Corrections of the training cameras: small ones. */
static cln_status read_motions(const cln_safetensors *file, const char *path, cln_model *out)
{
    cln_status st = CLN_OK;

    CLN_TRY(take_views(file, path, "poses", CLN_MOTION, &out->motions, &out->motion_views));
    for (int i = 0; i < out->motion_views; i++)
        for (int k = 0; k < CLN_MOTION; k++)
            if (!isfinite(out->motions[i][k]) || (k < 3 && fabsf(out->motions[i][k]) > 1))
                CLN_TRY(cln_fail(CLN_CHECKPOINT,
                                 "%s: tensor 'poses' has an impossible correction in row %d", path,
                                 i));
done:
    return st;
}

static cln_status read_tensors(const char *path, const char *digest, bool training, cln_model *out)
{
    cln_status st = CLN_OK;
    cln_safetensors *file = NULL;
    char hex[CLN_DIGEST_TEXT];
    int64_t n1 = out->config.n1, shape[4] = {0, out->net.params};
    int64_t grid[4] = {0, n1, n1, n1}, sums[3] = {0, CLN_MEASURES, 2};
    const int64_t decoder = out->net.decoder_params;

    CLN_TRY(cln_safetensors_read(path, &file));
    cln_digest_text(cln_safetensors_digest(file), hex);
    if (strcmp(hex, digest) != 0)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: its digest is %s, not %s as its .json says", path,
                         hex, digest));
    CLN_TRY(read_tree(file, path, &out->tree));
    shape[0] = grid[0] = sums[0] = out->tree.leaf_count;
    CLN_TRY(take_tensor(file, path, "params", CLN_DTYPE_F32, 2, shape, &out->params));
    CLN_TRY(take_tensor(file, path, "leaf_error", CLN_DTYPE_F32, 1, shape, &out->error));
    if (training) {
        if (cln_first_moment_bytes(&out->config) > 0) /* older files may have them all the same */
            CLN_TRY(take_tensor(file, path, "adam_m", moment_dtype(out), 2, shape, &out->adam_m));
        else
            CLN_TRY(cln_alloc(&out->adam_m, 0, 1, "Adam's state"));
        CLN_TRY(take_tensor(file, path, "adam_v", moment_dtype(out), 2, shape, &out->adam_v));
        CLN_TRY(take_tensor(file, path, "adam_steps", CLN_DTYPE_I32, 1, shape, &out->adam_steps));
        CLN_TRY(take_tensor(file, path, "density", CLN_DTYPE_BF16, 4, grid, &out->density));
        CLN_TRY(take_tensor(file, path, "leaf_sums", CLN_DTYPE_F32, 3, sums, &out->sums));
        CLN_TRY(take_tensor(file, path, "leaf_met", CLN_DTYPE_I32, 1, shape, &out->met));
        CLN_TRY(take_tensor(file, path, "leaf_saved", CLN_DTYPE_F32, 1, shape, &out->saved));
    }
    /* pictures do without */
    if (cln_safetensors_has(file, "exposure") ||
        (training && out->config.exposure == CLN_EXPOSURE_YES && !out->has_alpha))
        CLN_TRY(
            take_views(file, path, "exposure", CLN_EXPOSURE, &out->exposure, &out->exposure_views));
    if (out->config.refine_poses)
        CLN_TRY(read_motions(file, path, out));
    if (decoder > 0)
        CLN_TRY(take_tensor(file, path, "decoder", CLN_DTYPE_F32, 1, &decoder, &out->decoder));
    if (decoder > 0 && training) {
        CLN_TRY(take_tensor(file, path, "decoder_m", CLN_DTYPE_F32, 1, &decoder, &out->decoder_m));
        CLN_TRY(take_tensor(file, path, "decoder_v", CLN_DTYPE_F32, 1, &decoder, &out->decoder_v));
    }
done:
    cln_safetensors_free(file);
    return st;
}

/* ---- the folder ---- */

/* Returns whether a file name is at least eight digits, *step, then `suffix`; whole: and nothing
 * else. */
static bool parse_name(const char *name, const char *suffix, bool whole, int64_t *step)
{
    size_t digits = strspn(name, "0123456789"), length = strlen(suffix);

    if (digits < 8 || digits > 18 || strncmp(name + digits, suffix, length) != 0)
        return false;
    *step = strtoll(name, NULL, 10);
    return !whole || name[digits + length] == 0;
}

static int descending(const void *a, const void *b)
{
    const int64_t *x = a, *y = b;

    return (*x < *y) - (*x > *y);
}

static cln_status cannot_list(const char *folder)
{
    return cln_fail(errno == EACCES ? CLN_INPUT : CLN_CHECKPOINT,
                    "%s: cannot list the checkpoints in it: %s; give a run's folder that you may "
                    "read",
                    folder, strerror(errno));
}

/* Lists the steps of a folder's checkpoints, newest first; none if the folder is missing.
 * CLN_INPUT if this account may not, CLN_CHECKPOINT if it cannot be read, CLN_MEMORY: *steps is
 * freed. */
static cln_status list_steps(const char *folder, int64_t **steps, int *count)
{
    cln_status st = CLN_OK;
    DIR *dir = opendir(folder);
    const struct dirent *e = NULL;
    int64_t step = 0;

    *steps = NULL;
    *count = 0;
    if (!dir && errno != ENOENT)
        CLN_TRY(cannot_list(folder));
    while (dir) {
        errno = 0; /* the only sign of a failed read */
        e = readdir(dir);
        if (!e && errno != 0)
            CLN_TRY(cannot_list(folder));
        if (!e)
            break;
        if (!parse_name(e->d_name, ".json", true, &step))
            continue;
        CLN_TRY(cln_grow(steps, *count, sizeof **steps, folder));
        (*steps)[(*count)++] = step;
    }
    if (*count)
        qsort(*steps, (size_t)*count, sizeof **steps, descending);
done:
    if (st != CLN_OK) {
        free(*steps);
        *steps = NULL;
        *count = 0;
    }
    if (dir)
        closedir(dir);
    return st;
}

/* Removes all checkpoints but the one just written and the newest before it, and leftovers of
 * crashes. Later steps go, too: they are damaged, or the run would have resumed from them. */
static cln_status remove_old(const char *folder, int64_t newest)
{
    cln_status st = CLN_OK;
    DIR *dir = NULL;
    int64_t *steps = NULL, step = 0, before = -1;
    int count = 0, kept = 1;
    char *path = NULL;

    st = list_steps(folder, &steps, &count);
    if (st == CLN_CHECKPOINT || st == CLN_INPUT) { /* the new one is whole */
        cln_warn("old checkpoints stay: %s", cln_error_text());
        cln_clear_error();
        return CLN_OK;
    }
    CLN_TRY(st);
    for (int i = 0; i < count; i++)
        if (steps[i] < newest && kept++ < KEEP)
            before = steps[i];
    dir = opendir(folder);
    for (struct dirent *e = dir ? readdir(dir) : NULL; e; e = readdir(dir)) {
        const char *name = e->d_name;
        bool temp = parse_name(name, ".safetensors.tmp.", false, &step) ||
                    parse_name(name, ".json.tmp.", false, &step) ||
                    strncmp(name, "latest.tmp.", 11) == 0;
        bool ours = temp || parse_name(name, ".safetensors", true, &step) ||
                    parse_name(name, ".json", true, &step);
        if (!ours || (!temp && (step == newest || step == before)))
            continue;
        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, name));
        if (unlink(path) != 0)
            cln_warn("%s: an old checkpoint that cannot be removed: %s", path, strerror(errno));
    }
done:
    if (dir)
        closedir(dir);
    free(path);
    free(steps);
    return st;
}

cln_status cln_checkpoint_path(const char *run, const cln_model *model, char **path)
{
    cln_status st = CLN_OK;
    char *folder = NULL;

    CLN_TRY(cln_path_join(&folder, run, FOLDER));
    CLN_TRY(cln_make_dirs(folder));
    CLN_TRY(cln_asprintf(path, "%s/%08" PRId64 ".safetensors", folder, model->step));
done:
    free(folder);
    return st;
}

cln_status cln_checkpoint_finish(const char *run, const cln_model *model, uint64_t tensors_digest,
                                 uint64_t model_digest)
{
    cln_status st = CLN_OK;
    char tensors[NAME_BYTES], document[NAME_BYTES], latest[NAME_BYTES];
    char *folder = NULL, *path = NULL;
    json_t *json = NULL;

    snprintf(tensors, sizeof tensors, "%08" PRId64 ".safetensors", model->step);
    snprintf(document, sizeof document, FOLDER "/%08" PRId64 ".json", model->step);
    snprintf(latest, sizeof latest, "%08" PRId64 "\n", model->step);
    CLN_TRY(make_document(model, tensors, tensors_digest, model_digest, &json));
    CLN_TRY(cln_run_write_json(run, document, json));
    CLN_TRY(cln_path_join(&folder, run, FOLDER));
    CLN_TRY(cln_path_join(&path, folder, "latest"));
    CLN_TRY(cln_write_file(path, latest, strlen(latest)));
    CLN_TRY(remove_old(folder, model->step));
done:
    json_decref(json);
    free(path);
    free(folder);
    return st;
}

cln_status cln_checkpoint_write(const char *run, const cln_model *model)
{
    cln_status st = CLN_OK;
    cln_tensor tensors[CLN_CHECKPOINT_TENSORS];
    int32_t *rows = NULL;
    char *path = NULL;
    uint64_t digest = 0;
    int count = 0;

    CLN_TRY(cln_checkpoint_path(run, model, &path));
    CLN_TRY(cln_checkpoint_tensors(model, tensors, &count, &rows));
    CLN_TRY(cln_safetensors_write(path, count, tensors, &digest));
    CLN_TRY(cln_checkpoint_finish(run, model, digest, cln_model_digest(model)));
done:
    if (st != CLN_OK)
        cln_note("writing a checkpoint of step %" PRId64, model->step);
    free(rows);
    free(path);
    return st;
}

static cln_status read_one(const char *folder, int64_t step, bool training, cln_model *out)
{
    cln_status st = CLN_OK;
    char *json_path = NULL, *tensor_path = NULL, digest[CLN_DIGEST_TEXT];

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_asprintf(&json_path, "%s/%08" PRId64 ".json", folder, step));
    CLN_TRY(cln_asprintf(&tensor_path, "%s/%08" PRId64 ".safetensors", folder, step));
    CLN_TRY(read_document(json_path, training, out, digest));
    CLN_TRY(read_tensors(tensor_path, digest, training, out));
done:
    if (st != CLN_OK)
        cln_model_free(out);
    free(json_path);
    free(tensor_path);
    return st;
}

cln_status cln_checkpoint_read(const char *run, bool training, cln_model *out)
{
    cln_status st = CLN_OK;
    char *folder = NULL, *defect = NULL;
    int64_t *steps = NULL;
    int count = 0;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_path_join(&folder, run, FOLDER));
    if (!cln_is_dir(run))
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: no such folder; give the folder of a run", run));
    CLN_TRY(list_steps(folder, &steps, &count));
    if (count == 0)
        CLN_TRY(cln_fail(CLN_CHECKPOINT, "%s: there is no checkpoint in it%s", run,
                         cln_run_is_held(run) || (!training && cln_held_by(run) == CLN_HOLDER_US)
                             ? " yet: it is being trained, and --save-every says when the first "
                               "is written"
                             : ": it ended before its first, or they were deleted; put them "
                               "back, or train again, in a new folder"));
    for (int i = 0; i < count; i++) {
        st = read_one(folder, steps[i], training, out);
        if (st == CLN_OK || st == CLN_MEMORY)
            goto done;
        free(defect);
        defect = NULL;
        CLN_TRY(cln_strdup(&defect, cln_error_text()));
        cln_clear_error();
        if (i + 1 < count)
            cln_warn("%s; going back from step %" PRId64 " to %" PRId64, defect, steps[i],
                     steps[i + 1]);
    }
    /* Missing files and bad JSON are damaged checkpoints here. */
    st = cln_fail(CLN_CHECKPOINT, "%s: none of its %d checkpoints can be read; the oldest: %s", run,
                  count, defect);
done:
    free(defect);
    free(steps);
    free(folder);
    return st;
}

/* ---- room ---- */

/* The tensors' rows; JSON and header are small. */
cln_status cln_checkpoint_bytes(const cln_config *config, int leaves, double *bytes)
{
    cln_status st = CLN_OK;
    const double cells = pow(config->n1, 3);
    const double moments = (double)(cln_first_moment_bytes(config) + cln_moment_bytes(config));
    const double rest = 4 + 4 + 2 * cells + 8.0 * CLN_MEASURES + 4 + 4;
    cln_network net;

    CLN_TRY(cln_network_layout(config, &net));
    *bytes = leaves * (net.params * (4 + moments) + rest) + 4.0 * ROW * (leaves * 8.0 / 7 + 1) +
             12.0 * net.decoder_params + JSON_BYTES;
done:
    return st;
}

/* What lies in RUN/checkpoint. */
static double bytes_there(const char *folder)
{
    DIR *dir = opendir(folder);
    struct stat info;
    double bytes = 0;

    for (struct dirent *e = dir ? readdir(dir) : NULL; e; e = readdir(dir))
        if (fstatat(dirfd(dir), e->d_name, &info, 0) == 0 && S_ISREG(info.st_mode))
            bytes += (double)info.st_size;
    if (dir)
        closedir(dir);
    return bytes;
}

cln_status cln_checkpoint_room(const char *run, const cln_config *config, bool shell, double *bytes)
{
    cln_status st = CLN_OK;
    char *folder = NULL;

    CLN_TRY(cln_checkpoint_bytes(config, cln_config_most_leaves(config, shell), bytes));
    *bytes *= KEEP + 1;
    if (run) {
        CLN_TRY(cln_path_join(&folder, run, FOLDER));
        *bytes = fmax(0, *bytes - bytes_there(folder));
    }
done:
    free(folder);
    return st;
}

cln_status cln_checkpoint_exists(const char *run, bool *exists)
{
    cln_status st = CLN_OK;
    char *folder = NULL;
    int64_t *steps = NULL;
    int count = 0;

    CLN_TRY(cln_path_join(&folder, run, FOLDER));
    CLN_TRY(list_steps(folder, &steps, &count));
    *exists = count > 0;
done:
    free(folder);
    free(steps);
    return st;
}

int64_t cln_checkpoint_newest(const char *run)
{
    char *folder = NULL;
    int64_t *steps = NULL, newest = -1;
    int count = 0;

    if (cln_path_join(&folder, run, FOLDER) == CLN_OK &&
        list_steps(folder, &steps, &count) == CLN_OK && count > 0)
        newest = steps[0];
    free(folder);
    free(steps);
    return newest;
}

int64_t cln_checkpoint_newest_whole(const char *run)
{
    const cln_status before = cln_error_status();
    char *folder = NULL, *path = NULL;
    int64_t *steps = NULL, newest = -1;
    int count = 0;

    if (cln_path_join(&folder, run, FOLDER) == CLN_OK)
        (void)list_steps(folder, &steps, &count);
    for (int i = 0; i < count && newest < 0; i++) {
        free(path);
        path = NULL;
        if (cln_asprintf(&path, "%s/%08" PRId64 ".safetensors", folder, steps[i]) == CLN_OK &&
            cln_safetensors_fits_header(path))
            newest = steps[i];
    }
    if (before == CLN_OK)
        cln_clear_error();
    free(path);
    free(folder);
    free(steps);
    return newest;
}

double cln_checkpoint_newest_bytes(const char *run)
{
    char name[64], *path = NULL;
    struct stat info;
    double bytes = 0;

    snprintf(name, sizeof name, FOLDER "/%08" PRId64 ".safetensors", cln_checkpoint_newest(run));
    if (cln_path_join(&path, run, name) == CLN_OK && stat(path, &info) == 0)
        bytes = (double)info.st_size;
    free(path);
    return bytes;
}
