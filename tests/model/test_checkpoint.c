/* Checkpoints. Tested: they read back bit for bit, with or without training state, also with an
 * empty tree; a damaged one (truncated, bits flipped, of another shape, type or tree, missing) is
 * refused and the previous one used with a warning; a failed or killed write leaves the old ones.
 * Oracle: the written model, compared byte for byte. */
#include "unit.h"
#include <math.h>
#include <dirent.h>
#include <inttypes.h>
#include <jansson.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include "base/config.h"
#include "base/memory.h"
#include "io/safetensors.h"
#include "model_fixture.h"
#include "scratch.h"
#include "tests.h"

static void same_model(const cln_model *a, const cln_model *b, bool training)
{
    size_t leaves = (size_t)a->tree.leaf_count, floats = leaves * (size_t)a->net.params * 4;
    size_t nodes = (size_t)a->tree.node_count;
    int32_t *rows_a = NULL, *rows_b = NULL;
    json_t *config_a = NULL, *config_b = NULL;

    assert_int_equal(a->tree.leaf_count, b->tree.leaf_count);
    assert_int_equal(a->tree.node_count, b->tree.node_count);
    assert_int_equal(cln_octree_pack(&a->tree, &rows_a), CLN_OK);
    assert_int_equal(cln_octree_pack(&b->tree, &rows_b), CLN_OK);
    same_bytes(rows_a, rows_b, nodes * 8 * 4);
    same_bytes(a->tree.leaf, b->tree.leaf, leaves * 4);
    free(rows_a);
    free(rows_b);
    assert_memory_equal(&a->net, &b->net, sizeof a->net);
    assert_int_equal(cln_config_to_json(&a->config, &config_a), CLN_OK);
    assert_int_equal(cln_config_to_json(&b->config, &config_b), CLN_OK);
    assert_true(json_equal(config_a, config_b));
    json_decref(config_a);
    json_decref(config_b);
    assert_memory_equal(&a->space, &b->space, sizeof a->space);
    assert_memory_equal(a->background, b->background, sizeof a->background);
    assert_memory_equal(&a->train_seconds, &b->train_seconds, sizeof a->train_seconds);
    assert_int_equal(a->has_alpha, b->has_alpha);
    assert_int_equal(a->has_distortion, b->has_distortion);
    assert_true(a->step == b->step && a->refresh_step == b->refresh_step);
    assert_int_equal(a->growth_step, b->growth_step);
    assert_int_equal(a->rays, b->rays);
    assert_int_equal(a->level, b->level);
    assert_int_equal(a->drawn, b->drawn);
    assert_int_equal(a->averaged, b->averaged);
    assert_int_equal(a->in_parts, b->in_parts);
    assert_int_equal(a->exposed, b->exposed);
    assert_true(a->training_names == b->training_names);
    assert_true(cln_model_digest(a) == cln_model_digest(b));
    same_bytes(a->params, b->params, floats);
    if (!training) {
        assert_null(b->adam_m);
        assert_null(b->adam_v);
        assert_null(b->adam_steps);
        assert_null(b->density);
        return;
    }
    same_bytes(a->adam_m, b->adam_m, leaves * moment_bytes(a));
    same_bytes(a->adam_v, b->adam_v, leaves * moment_bytes(a));
    same_bytes(a->adam_steps, b->adam_steps, leaves * 4);
    same_bytes(a->density, b->density, leaves * N1 * N1 * N1 * 2);
    same_bytes(a->sums, b->sums, leaves * CLN_MEASURES * 2 * sizeof(float));
    same_bytes(a->met, b->met, leaves * 4);
    same_bytes(a->error, b->error, leaves * 4);
    same_bytes(a->saved, b->saved, leaves * 4);
    assert_int_equal(a->sum_rays, b->sum_rays);
    assert_true(a->sum_square == b->sum_square && a->last_square == b->last_square);
    assert_int_equal(a->decisions, b->decisions);
    assert_memory_equal(&a->row, &b->row, sizeof a->row);
}

/* ---- round trips ---- */

static void test_round_trip(void **state)
{
    cln_model model, back;

    make_model(12345, &model);
    assert_int_equal(cln_checkpoint_write(*state, &model), CLN_OK);
    assert_int_equal(cln_checkpoint_read(*state, true, &back), CLN_OK);
    same_model(&model, &back, true);
    cln_model_free(&back);
    assert_int_equal(cln_checkpoint_read(*state, false, &back), CLN_OK);
    same_model(&model, &back, false);
    assert_int_equal(cln_checkpoint_write(*state, &back), CLN_OK); /* now weights only */
    cln_model_free(&back);
    assert_int_equal(cln_checkpoint_read(*state, false, &back), CLN_OK);
    same_model(&model, &back, false);
    cln_model_free(&back);
    assert_int_equal(cln_checkpoint_read(*state, true, &back), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "no state of training"));
    cln_model_free(&model);
}

/* Corrections of poses are read for pictures, too; impossible ones are refused. */
static void test_poses(void **state)
{
    enum { VIEWS = 3 };
    cln_model model, back;

    make_model(7, &model);
    model.config.refine_poses = true;
    assert_int_equal(cln_checkpoint_write(*state, &model), CLN_OK);
    assert_int_equal(cln_checkpoint_read(*state, false, &back), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "poses"));
    cln_clear_error();
    assert_int_equal(cln_alloc(&model.motions, VIEWS, sizeof *model.motions, "test"), CLN_OK);
    model.motion_views = VIEWS;
    for (int i = 0; i < VIEWS; i++)
        for (int k = 0; k < 6; k++)
            model.motions[i][k] = 0.01f * (float)(6 * i + k) - 0.05f;
    for (int training = 0; training < 2; training++) {
        assert_int_equal(cln_checkpoint_write(*state, &model), CLN_OK);
        assert_int_equal(cln_checkpoint_read(*state, training, &back), CLN_OK);
        same_model(&model, &back, training);
        assert_int_equal(back.motion_views, VIEWS);
        same_bytes(model.motions, back.motions, VIEWS * sizeof *model.motions);
        cln_model_free(&back);
    }
    for (int kind = 0; kind < 2; kind++) {
        model.motions[1][2] = kind == 0 ? NAN : 1.5f; /* radians */
        assert_int_equal(cln_checkpoint_write(*state, &model), CLN_OK);
        assert_int_equal(cln_checkpoint_read(*state, true, &back), CLN_CHECKPOINT);
        assert_non_null(strstr(cln_error_text(), "row 1"));
        cln_clear_error();
    }
    cln_model_free(&model);
}

/* A tree without leaves: empty tensors. */
static void test_empty_tree(void **state)
{
    uint8_t marks[14];
    cln_model model, back;
    cln_octree_change change;

    memset(marks, 1, sizeof marks);
    make_model(3, &model);
    assert_int_equal(cln_octree_cull(&model.tree, marks, &change), CLN_OK);
    assert_int_equal(cln_model_apply(&model, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(model.tree.leaf_count, 0);
    assert_int_equal(cln_checkpoint_write(*state, &model), CLN_OK);
    assert_int_equal(cln_checkpoint_read(*state, true, &back), CLN_OK);
    same_model(&model, &back, true);
    cln_model_free(&model);
    cln_model_free(&back);
}

static bool exists(const char *run, const char *name)
{
    return cln_is_file(scratch_path(scratch_path(run, "checkpoint"), name));
}

static int count_entries(const char *run)
{
    DIR *dir = opendir(scratch_path(run, "checkpoint"));
    int count = 0;

    assert_non_null(dir);
    while (readdir(dir))
        count++;
    closedir(dir);
    return count - 2;
}

static void write_step(const char *run, int64_t step)
{
    cln_model model;

    make_model(step, &model);
    assert_int_equal(cln_checkpoint_write(run, &model), CLN_OK);
    cln_model_free(&model);
}

static void test_keeps_two(void **state)
{
    size_t bytes = 0;
    char *latest = NULL;

    for (int64_t step = 1; step <= 5; step++)
        write_step(*state, 40 * step);
    assert_int_equal(count_entries(*state), 5);
    assert_true(exists(*state, "00000160.json") && exists(*state, "00000160.safetensors"));
    assert_true(exists(*state, "00000200.json") && exists(*state, "00000200.safetensors"));
    latest = scratch_get(scratch_path(*state, "checkpoint/latest"), &bytes);
    assert_string_equal(latest, "00000200\n");
    free(latest);
    write_step(*state, 1234567890); /* more than eight digits */
    assert_true(exists(*state, "1234567890.json"));
    assert_true(exists(*state, "00000200.json"));
    assert_int_equal(count_entries(*state), 5);
}

/* ---- damage ---- */

/* Reads; expects the model of `step`, or CLN_CHECKPOINT for -1, and this many warnings. */
static void expect_step(const char *run, int64_t step, int warnings, const char *what)
{
    cln_model back;
    int counted = 0;
    cln_status st = CLN_OK;

    cln_log_set_sink(scratch_count_warnings, &counted);
    st = cln_checkpoint_read(run, true, &back);
    cln_log_set_sink(NULL, NULL);
    if (st != (step < 0 ? CLN_CHECKPOINT : CLN_OK) || (st == CLN_OK && back.step != step) ||
        counted != warnings)
        fail_msg("%s: status %d, step %" PRId64 ", %d warnings, '%s'", what, (int)st, back.step,
                 counted, cln_error_text());
    assert_int_equal(cln_error_status(), st); /* a fallback leaves no error record */
    if (step < 0)
        assert_non_null(strstr(cln_error_text(), run));
    cln_clear_error();
    cln_model_free(&back);
}

/* Damage to the .json is refused, or (last digit of a real, last newline) changes no value. */
static void expect_harmless(const char *run, const cln_model *newer, const char *what)
{
    cln_model back;
    int warnings = 0;

    cln_log_set_sink(scratch_count_warnings, &warnings);
    assert_int_equal(cln_checkpoint_read(run, true, &back), CLN_OK);
    cln_log_set_sink(NULL, NULL);
    if (warnings == 0)
        same_model(newer, &back, true);
    else if (warnings != 1 || back.step != 1)
        fail_msg("%s: step %" PRId64 ", %d warnings", what, back.step, warnings);
    cln_model_free(&back);
}

/* Any damage to one file of the newer of two checkpoints selects the older one. */
static void damage_everywhere(const char *run, const char *name, size_t stride)
{
    const char *path = scratch_path(scratch_path(run, "checkpoint"), name);
    bool json = strstr(name, ".json") != NULL;
    size_t bytes = 0;
    char *data = scratch_get(path, &bytes), what[128];
    cln_model newer;

    make_model(2, &newer);
    for (size_t at = 0; at < bytes; at += stride) {
        int bit = 1 << at % 8;
        data[at] ^= (char)bit;
        scratch_put(path, data, bytes);
        snprintf(what, sizeof what, "%s with bit %d of byte %zu flipped", name, (int)(at % 8), at);
        if (json)
            expect_harmless(run, &newer, what);
        else
            expect_step(run, 1, 1, what);
        data[at] ^= (char)bit;
        scratch_put(path, data, at);
        snprintf(what, sizeof what, "%s cut to %zu bytes", name, at);
        if (json)
            expect_harmless(run, &newer, what);
        else
            expect_step(run, 1, 1, what);
    }
    scratch_put(path, data, bytes);
    expect_step(run, 2, 0, "whole again");
    unlink(path);
    /* A checkpoint without its .json was never finished: no warning; one without its tensors is
     * damaged. */
    expect_step(run, 1, json ? 0 : 1, "missing file");
    scratch_put(path, data, bytes);
    free(data);
    cln_model_free(&newer);
}

/* One digit changed in each number of the .json. */
static void test_edited_by_hand(void **state)
{
    static const char *const edits[][2] = {{"\"step\": 2", "\"step\": 3"},
                                           {"\"rays\": 4711", "\"rays\": 4712"},
                                           {"\"width\": 16", "\"width\": 32"},
                                           {"\"n1\": 3", "\"n1\": 4"},
                                           {"\"level\": 2", "\"level\": 5"},
                                           {"\"seed\": 42", "\"seed\": 43"},
                                           {"\"has_alpha\": false", "\"has_alpha\": true "},
                                           {"checkpoint/2", "checkpoint/3"}};
    const char *run = *state, *path = scratch_path(run, "checkpoint/00000002.json");
    size_t bytes = 0;
    char *text = NULL;

    write_step(run, 1);
    write_step(run, 2);
    text = scratch_get(path, &bytes);
    for (size_t i = 0; i < sizeof edits / sizeof edits[0]; i++) {
        char *edited = strdup(text), *at = strstr(edited, edits[i][0]);
        assert_non_null(at);
        memcpy(at, edits[i][1], strlen(edits[i][1]));
        scratch_put(path, edited, bytes);
        expect_step(run, 1, 1, edits[i][1]);
        free(edited);
    }
    free(text);
}

/* Intact halves of two different checkpoints are refused. */
static void test_mixed_halves(void **state)
{
    const char *run = *state;
    size_t bytes = 0;
    char *older = NULL;

    write_step(run, 1);
    write_step(run, 2);
    older = scratch_get(scratch_path(run, "checkpoint/00000001.safetensors"), &bytes);
    scratch_put(scratch_path(run, "checkpoint/00000002.safetensors"), older, bytes);
    expect_step(run, 1, 1, "the older one's tensors");
    free(older);
}

static void test_damaged(void **state)
{
    write_step(*state, 1);
    write_step(*state, 2);
    damage_everywhere(*state, "00000002.json", 7);
    damage_everywhere(*state, "00000002.safetensors", 331);
    unlink(scratch_path(*state, "checkpoint/latest")); /* only people and scripts read it */
    expect_step(*state, 2, 0, "without latest");
}

static void test_all_damaged(void **state)
{
    const char *run = *state;
    cln_model model;

    expect_step(run, -1, 0, "no folder");
    assert_int_equal(mkdir(scratch_path(run, "checkpoint"), 0777), 0);
    expect_step(run, -1, 0, "empty folder");
    assert_int_equal(cln_checkpoint_read(run, true, &model), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "ended before its first, or they were deleted"));
    cln_clear_error();
    write_step(run, 1);
    write_step(run, 2);
    scratch_put(scratch_path(run, "checkpoint/00000001.json"), "{}", 2);
    scratch_put(scratch_path(run, "checkpoint/00000002.json"), "{", 1);
    expect_step(run, -1, 1, "both damaged");
    /* The next complete checkpoint replaces the damaged newer one. */
    write_step(run, 1);
    expect_step(run, 1, 0, "written again");
    assert_false(exists(run, "00000002.json"));
}

/* Writes checkpoint 2's document with the digest that it should have. */
static void put_document(const char *run, json_t *doc)
{
    char hex[17], *text = NULL;

    json_object_del(doc, "digest");
    text = json_dumps(doc, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    snprintf(hex, sizeof hex, "%016" PRIx64, cln_digest(CLN_DIGEST_START, text, strlen(text)));
    json_object_set_new(doc, "digest", json_string(hex));
    assert_int_equal(
        json_dump_file(doc, scratch_path(run, "checkpoint/00000002.json"), JSON_REAL_PRECISION(17)),
        0);
    free(text);
}

/* Puts other tensors into checkpoint 2 with correct digests: only the sizes reveal it. */
static void forge(const char *run, int count, const cln_tensor *tensors)
{
    const char *path = scratch_path(run, "checkpoint/00000002.json");
    uint64_t digest = 0;
    char hex[17];
    json_t *doc = json_load_file(path, 0, NULL);

    assert_non_null(doc);
    assert_int_equal(cln_safetensors_write(scratch_path(run, "checkpoint/00000002.safetensors"),
                                           count, tensors, &digest),
                     CLN_OK);
    snprintf(hex, sizeof hex, "%016" PRIx64, digest);
    json_object_set_new(doc, "tensors_digest", json_string(hex));
    put_document(run, doc);
    json_decref(doc);
}

static void test_forged(void **state)
{
    enum { OCTREE, PARAMS, M, V, STEPS, DENSITY, ERROR, SUMS, MET, SAVED, COUNT };
    const char *run = *state;
    cln_model model;
    int32_t *rows = NULL, *bad_rows = NULL;
    cln_tensor good[COUNT], bad[COUNT];
    int64_t leaves = 14, stride = 0, nodes = 0;

    write_step(run, 1);
    write_step(run, 2);
    make_model(2, &model);
    stride = model.net.params;
    nodes = model.tree.node_count;
    assert_int_equal(cln_octree_pack(&model.tree, &rows), CLN_OK);
    bad_rows = malloc((size_t)nodes * 32);
    memcpy(bad_rows, rows, (size_t)nodes * 32);
    good[OCTREE] = (cln_tensor){"octree", CLN_DTYPE_I32, 2, {nodes, 8}, rows};
    good[PARAMS] = (cln_tensor){"params", CLN_DTYPE_F32, 2, {leaves, stride}, model.params};
    good[M] = (cln_tensor){"adam_m", CLN_DTYPE_BF16, 2, {leaves, stride}, model.adam_m};
    good[V] = (cln_tensor){"adam_v", CLN_DTYPE_BF16, 2, {leaves, stride}, model.adam_v};
    good[STEPS] = (cln_tensor){"adam_steps", CLN_DTYPE_I32, 1, {leaves}, model.adam_steps};
    good[DENSITY] = (cln_tensor){"density", CLN_DTYPE_BF16, 4, {leaves, 3, 3, 3}, model.density};
    good[ERROR] = (cln_tensor){"leaf_error", CLN_DTYPE_F32, 1, {leaves}, model.error};
    good[SUMS] = (cln_tensor){"leaf_sums", CLN_DTYPE_F32, 3, {leaves, CLN_MEASURES, 2}, model.sums};
    good[MET] = (cln_tensor){"leaf_met", CLN_DTYPE_I32, 1, {leaves}, model.met};
    good[SAVED] = (cln_tensor){"leaf_saved", CLN_DTYPE_F32, 1, {leaves}, model.saved};
    forge(run, COUNT, good);
    expect_step(run, 2, 0, "forged, but right");
#define FORGED(what, change)           \
    do {                               \
        memcpy(bad, good, sizeof bad); \
        change;                        \
        forge(run, COUNT, bad);        \
        expect_step(run, 1, 1, what);  \
    } while (0)
    FORGED("a dimension more", bad[STEPS].shape[bad[STEPS].dims++] = 1);
    for (int i = 0; i < COUNT; i++) {
        FORGED("tensor missing", bad[i].name = "other");
        FORGED("one row less", bad[i].shape[0]--);
        FORGED("no rows", bad[i].shape[0] = 0);
        if (good[i].dims > 1)
            FORGED("one dimension less",
                   (bad[i].dims--, bad[i].shape[bad[i].dims - 1] *= good[i].shape[bad[i].dims]));
    }
    FORGED("stride", bad[PARAMS].shape[1] -= 16);
    FORGED("transposed", (bad[PARAMS].shape[0] = stride, bad[PARAMS].shape[1] = leaves));
    FORGED("density grid", bad[DENSITY].shape[3] = 2);
    FORGED("dtype of the octree", bad[OCTREE].dtype = CLN_DTYPE_F32);
    FORGED("dtype of the weights", bad[PARAMS].dtype = CLN_DTYPE_I32);
    FORGED("dtype of the density", bad[DENSITY].dtype = CLN_DTYPE_U16);
    FORGED("row of the octree", (bad[OCTREE].shape[0] = nodes * 2, bad[OCTREE].shape[1] = 4));
    bad[OCTREE].data = bad_rows;
    for (int i = 0; i < nodes; i++) { /* one culled leaf turned active: 15 leaves, 14 weights */
        if (rows[8 * i] != CLN_NODE_CULLED)
            continue;
        bad_rows[8 * i] = CLN_NODE_ACTIVE;
        FORGED("one more leaf", bad[OCTREE].data = bad_rows);
        bad_rows[8 * i] = CLN_NODE_CULLED;
    }
    bad_rows[4] = 1 << 30; /* the root's children, far outside */
    FORGED("links", bad[OCTREE].data = bad_rows);
#undef FORGED
    free(rows);
    free(bad_rows);
    cln_model_free(&model);
}

/* A document that lacks only the digest of its tensors. */
static void test_no_tensors_digest(void **state)
{
    const char *run = *state, *path = NULL;

    for (int kind = 0; kind < 3; kind++) {
        json_t *doc = NULL;

        write_step(run, 1);
        write_step(run, 2);
        path = scratch_path(run, "checkpoint/00000002.json");
        doc = json_load_file(path, 0, NULL);
        assert_non_null(doc);
        json_object_del(doc, "tensors_digest");
        if (kind > 0)
            json_object_set_new(doc, "tensors_digest",
                                kind == 1 ? json_integer(7) : json_string("0123"));
        put_document(run, doc);
        json_decref(doc);
        expect_step(run, 1, 1, "without a digest of its tensors");
    }
}

/* The space that is required before training is what checkpoints take. */
static void test_bytes_are_foreseen(void **state)
{
    const char *run = *state;
    cln_model model;
    cln_config config;
    double bytes = 0, room = 0, after = 0;
    size_t there = 0;

    make_model(3, &model);
    config = model.config;
    config.max_leaves = 100000;
    config.adaptive = true;
    assert_int_equal(cln_checkpoint_bytes(&config, model.tree.leaf_count, &bytes), CLN_OK);
    assert_int_equal(cln_checkpoint_newest(run), -1);
    assert_int_equal(cln_checkpoint_room(run, &config, false, &room), CLN_OK);
    assert_int_equal(cln_checkpoint_write(run, &model), CLN_OK);
    assert_int_equal(cln_checkpoint_newest(run), 3);
    free(scratch_get(scratch_path(run, "checkpoint/00000003.safetensors"), &there));
    assert_true((double)there <= bytes && (double)there > 0.9 * (bytes - 16384) - 8192);
    assert_int_equal(cln_checkpoint_bytes(&config, 100000, &bytes), CLN_OK);
    assert_true(fabs(room - 3 * bytes) < 1); /* two are kept while a third is written */
    assert_int_equal(cln_checkpoint_room(run, &config, false, &after), CLN_OK);
    assert_true(after <= room - (double)there && after > room - (double)there - 16384);
    cln_model_free(&model);
}

/* What cannot be listed is not a run without checkpoints, which would be trained again. */
static void test_unreadable_folder(void **state)
{
    const char *run = *state;
    cln_model model;

    scratch_put(scratch_path(run, "checkpoint"), "", 0);
    assert_int_equal(cln_checkpoint_read(run, true, &model), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "cannot list the checkpoints"));
    cln_clear_error();
}

/* ---- interruption ---- */

static void test_full_disk(void **state)
{
    const char *run = *state;
    cln_model model;
    rlim_t limits[] = {0, 1000, 20000, 0};
    size_t bytes = 0;

    write_step(run, 1);
    write_step(run, 2);
    free(scratch_get(scratch_path(run, "checkpoint/00000002.safetensors"), &bytes));
    limits[3] = bytes - 1;
    make_model(3, &model);
    for (int i = 0; i < 4; i++) {
        scratch_limit_files(limits[i]);
        assert_int_equal(cln_checkpoint_write(run, &model), CLN_OUTPUT);
        scratch_limit_files(RLIM_INFINITY);
        assert_non_null(strstr(cln_error_text(), "00000003"));
        assert_non_null(strstr(cln_error_text(), "checkpoint of step 3"));
        cln_clear_error();
        expect_step(run, 2, 0, "after a failed write");
        assert_int_equal(count_entries(run), 5);
    }
    assert_int_equal(cln_checkpoint_write(run, &model), CLN_OK);
    expect_step(run, 3, 0, "room again");

    /* A folder in the .json's place: the tensors exist, the checkpoint does not. */
    model.step = 4;
    assert_int_equal(mkdir(scratch_path(run, "checkpoint/00000004.json"), 0777), 0);
    assert_int_equal(cln_checkpoint_write(run, &model), CLN_OUTPUT);
    cln_clear_error();
    expect_step(run, 3, 1, "a folder of that name");
    assert_int_equal(rmdir(scratch_path(run, "checkpoint/00000004.json")), 0);
    expect_step(run, 3, 0, "and without it");
    cln_model_free(&model);
    scratch_put(scratch_path(run, "file"), "", 0);
    make_model(5, &model);
    assert_int_equal(cln_checkpoint_write(scratch_path(run, "file"), &model), CLN_OUTPUT);
    cln_clear_error();
    cln_model_free(&model);
}

/* Kills a child that writes checkpoints without pause: existing checkpoints are complete, with the
 * contents of their step, and the next write removes unfinished files. */
static void test_killed(void **state)
{
    const char *run = *state;
    int64_t step = 1;

    write_step(run, step);
    for (int round = 0; round < 8; round++) {
        cln_model back, expected;
        int status = 0;
        pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            cln_model model;
            make_model(step, &model);
            for (;;) {
                model.step++;
                model.refresh_step = model.step - 1;
                if (cln_checkpoint_write(run, &model) != CLN_OK)
                    _exit(1);
            }
        }
        usleep(20000 + 7000 * (useconds_t)round);
        kill(child, SIGKILL);
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status));
        assert_int_equal(cln_checkpoint_read(run, true, &back), CLN_OK);
        assert_true(back.step >= step);
        make_model(step, &expected);
        expected.step = back.step;
        expected.refresh_step = back.refresh_step;
        same_model(&expected, &back, true);
        step = back.step + 1;
        cln_model_free(&back);
        cln_model_free(&expected);
        write_step(run, step);
        assert_int_equal(count_entries(run), 5);
    }
}

/* Removes our own leftovers and nothing else from the folder. */
static void test_clears_leftovers(void **state)
{
    static const char *const ours[] = {"00000009.safetensors", "00000001.safetensors",
                                       "00000003.safetensors.tmp.99.1", "00000002.json.tmp.99.2"};
    static const char *const theirs[] = {"notes.txt", "best.safetensors", "0001.json",
                                         "00000009.json.bak"};
    const char *run = *state, *folder = scratch_path(run, "checkpoint");

    write_step(run, 2);
    for (int i = 0; i < 4; i++) {
        scratch_put(scratch_path(folder, ours[i]), "x", 1);
        scratch_put(scratch_path(folder, theirs[i]), "x", 1);
    }
    expect_step(run, 2, 0, "with leftovers");
    write_step(run, 3);
    for (int i = 0; i < 4; i++) {
        assert_false(exists(run, ours[i]));
        assert_true(exists(run, theirs[i]));
    }
    expect_step(run, 3, 0, "cleared");
}

int test_group_checkpoint(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_round_trip, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_empty_tree, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_poses, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_keeps_two, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_mixed_halves, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_damaged, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_edited_by_hand, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_all_damaged, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_forged, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_no_tensors_digest, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bytes_are_foreseen, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_unreadable_folder, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_full_disk, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_killed, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_clears_leftovers, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("checkpoint", tests, NULL, NULL);
}
