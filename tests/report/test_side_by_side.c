/* Runs side by side. Tested on hand-made run folders: which settings and facts are listed, which
 * evaluation counts, which run is best, when figures do not compare, runs without results or with
 * the same name or model, runs that do not tell all. Oracle: literal texts and numbers. */
#include "unit.h"
#include <fcntl.h>
#include <string.h>
#include <unistd.h>
#include "base/config.h"
#include "io/run_folder.h"
#include "io/run_history.h"
#include "near.h"
#include "report/side_by_side.h"
#include "scratch.h"
#include "tests.h"

static void put_json(const char *run, const char *name, json_t *document)
{
    assert_non_null(document);
    assert_int_equal(cln_run_write_json(run, name, document), CLN_OK);
    json_decref(document);
}

/* A run of 10 test views after 500 steps; settings: pairs of option and value, NULL at the end.
 * Returns its folder. */
static const char *put_run(const char *folder, const char *name, const char *digest,
                           const char *const settings[][2])
{
    const char *run = scratch_path(folder, name);
    json_t *values = NULL;
    cln_config config;

    assert_int_equal(cln_config_preset("voxel", &config), CLN_OK);
    for (; settings && (*settings)[0]; settings++)
        assert_int_equal(cln_config_set(&config, cln_config_find((*settings)[0]), (*settings)[1]),
                         CLN_OK);
    assert_int_equal(cln_config_to_json(&config, &values), CLN_OK);
    put_json(run, "run.json",
             json_pack("{s:s s:s s:s s:o s:{s:s} s:{s:s s:s s:s s:b s:i s:{s:i s:i s:i}} s:s s:s "
                       "s:{s:i s:f s:i s:f s:f s:i s:s}}",
                       "schema", "cl-nascent.run/1", "version", "0.1.0", "preset", "voxel",
                       "config", values, "device", "name", "A CPU", "dataset", "path", "/s/pot",
                       "space", "cube", "digest", digest, "alpha", 0, "downscale", 1, "splits",
                       "train", 90, "val", 0, "test", 10, "state", "done", "tune", "VW=8", "result",
                       "step", 500, "seconds", 20.5, "leaves", 64, "psnr_train", 30.001,
                       "psnr_test", 27.5, "eval_views", 8, "model_digest", name));
    return run;
}

static void put_eval(const char *run, const char *stem, int step, int images, double psnr,
                     bool fast)
{
    json_t *list = json_array();
    char name[64];

    for (int i = 0; i < images; i++)
        json_array_append_new(list, json_object());
    snprintf(name, sizeof name, "eval/%s.json", stem);
    put_json(run, name,
             json_pack("{s:s s:i s:s s:b s:{s:f s:f s:f} s:o}", "schema", "cl-nascent.eval/1",
                       "step", step, "split", "test", "fast", fast, "mean", "psnr", psnr, "ssim",
                       0.9, "seconds", 0.25, "images", list));
}

static json_t *beside(const char *a, const char *b)
{
    const char *const runs[] = {a, b};
    json_t *document = NULL;

    assert_int_equal(cln_side_by_side(2, runs, &document), CLN_OK);
    return document;
}

/* The row as compact JSON; "" if it is not there. */
static void assert_row(const json_t *document, const char *member, const char *key,
                       const char *wanted)
{
    char *text = json_dumps(json_object_get(json_object_get(document, member), key),
                            JSON_COMPACT | JSON_REAL_PRECISION(6));

    assert_string_equal(text ? text : "", wanted);
    free(text);
}

static void assert_note(const json_t *document, const char *part, bool there)
{
    char *text = json_dumps(json_object_get(document, "notes"), 0);

    assert_non_null(text);
    if (!strstr(text, part) == there)
        fail_msg("'%s' is %s %s", part, there ? "not in" : "in", text);
    free(text);
}

static void what_differs_is_listed(void **state)
{
    const char *const black[][2] = {
        {"rays", "1024"},      {"space", "cube"},   {"alpha-loss", "0.5"},  {"width", "64"},
        {"time-limit", "90s"}, {"depth-loss", "0"}, {"depth-until", "0.5"}, {NULL}};
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", black);
    json_t *document = beside(a, b), *settings = json_object_get(document, "settings");

    assert_row(document, "settings", "rays", "[\"16384\",\"1024\"]");
    assert_row(document, "settings", "time-limit", "[\"0\",\"90\"]");
    assert_row(document, "settings", "depth-until", "[\"1\",null]"); /* no effect in one */
    assert_row(document, "settings", "width", "");                   /* nor in any */
    assert_row(document, "settings", "alpha-loss", "");
    assert_row(document, "settings", "space", ""); /* auto came to the same */
    assert_int_equal(json_object_size(settings), 4);
    assert_int_equal(json_object_size(json_object_get(document, "facts")), 0);
    assert_true(json_is_true(json_object_get(document, "comparable")));
    assert_int_equal(json_array_size(json_object_get(document, "notes")), 0);
    assert_row(document, "results", "step", "[500,500]");
    assert_row(document, "results", "seconds", "[20.5,20.5]");
    assert_row(document, "results", "ssim", ""); /* no run has one */
    json_decref(document);
}

static void the_best_is_told(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", NULL);
    json_t *document = NULL;

    document = beside(a, b);
    assert_row(document, "best", "psnr_test", "[]"); /* all the same */
    assert_row(document, "results", "eval_views", "[8,8]");
    json_decref(document);

    /* all views at an earlier step count, more than some at the end; --fast does not */
    put_eval(a, "00000400-test", 400, 10, 26.0, false);
    put_eval(a, "00000500-test-8", 500, 8, 29.0, false);
    put_eval(a, "00000500-test-fast", 500, 10, 25.0, true);
    document = beside(a, b);
    assert_row(document, "results", "psnr_test", "[26,27.5]");
    assert_row(document, "results", "eval_views", "[10,8]");
    assert_row(document, "results", "eval_step", "[400,null]");
    assert_row(document, "best", "psnr_test", "[]"); /* of different views */
    assert_note(document, "different numbers of views", true);
    assert_note(document, "a: test figures are of step 400", true);
    json_decref(document);

    put_eval(b, "00000500-test", 500, 10, 25.996, false);
    document = beside(b, a);
    assert_row(document, "best", "psnr_test", "[]"); /* both print 26.00 */
    json_decref(document);
    put_eval(b, "00000500-test", 500, 10, 25.5, false);
    document = beside(b, a);
    assert_row(document, "best", "psnr_test", "[1]");
    assert_row(document, "results", "seconds_a_view", "[0.25,0.25]");
    assert_note(document, "different numbers of views", false);
    json_decref(document);
}

static void other_scenes_do_not_compare(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d2", NULL);
    json_t *run = NULL, *document = beside(a, b);

    assert_false(json_is_true(json_object_get(document, "comparable")));
    assert_note(document, "Scenes or their test photos differ", true);
    assert_row(document, "facts", "digest", "[\"d1\",\"d2\"]");
    assert_row(document, "best", "psnr_train", "[]");
    json_decref(document);

    assert_int_equal(cln_run_read(b, &run), CLN_OK);
    json_object_set_new(json_object_get(json_object_get(run, "dataset"), "splits"), "test",
                        json_integer(9));
    json_object_set_new(json_object_get(run, "result"), "psnr_train", json_real(31));
    put_json(b, "run.json", json_incref(run));
    document = beside(a, b);
    assert_note(document, "Scenes or their test photos differ", true);
    assert_row(document, "facts", "views",
               "[\"90 train, 0 val, 10 test\",\"90 train, 0 val, 9 test\"]");
    assert_row(document, "best", "psnr_train", "[]");
    json_decref(document);

    json_object_set_new(json_object_get(run, "dataset"), "path", json_string("/s/cup"));
    put_json(b, "run.json", run);
    document = beside(a, b);
    assert_note(document, "Scenes or their test photos differ", true);
    assert_row(document, "facts", "scene", "[\"/s/pot\",\"/s/cup\"]");
    json_decref(document);
}

/* Changes a member of a run's run.json or, if `object` is not NULL, of its object; NULL: takes it
 * out. */
static void change_run(const char *run, const char *object, const char *key, json_t *value)
{
    json_t *document = NULL, *of = NULL;

    assert_int_equal(cln_run_read(run, &document), CLN_OK);
    of = object ? json_object_get(document, object) : document;
    assert_int_equal(value ? json_object_set_new(of, key, value) : json_object_del(of, key), 0);
    put_json(run, "run.json", document);
}

/* Did more training photos help? */
static void the_same_test_photos_compare(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d2", NULL);
    json_t *document = NULL;

    change_run(a, "result", "psnr_test", json_real(20));
    change_run(b, "result", "psnr_train", json_real(31));
    change_run(a, "dataset", "test_digest", json_string("t"));
    for (int i = 0; i < 2; i++) {
        change_run(b, "dataset", "test_digest", json_string(i ? "t" : "u"));
        document = beside(a, b);
        assert_int_equal(json_is_true(json_object_get(document, "comparable")), i);
        assert_note(document, "training photos differ", i);
        assert_row(document, "best", "psnr_test", i ? "[1]" : "[]");
        assert_row(document, "best", "psnr_train", "[]");
        json_decref(document);
    }
}

static void untold_scenes_do_not_compare(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", NULL);
    json_t *document = NULL;

    change_run(a, "result", "psnr_test", json_real(20));
    change_run(a, "dataset", "alpha", json_true());
    document = beside(a, b);
    assert_note(document, "tells its background", true);
    assert_row(document, "best", "psnr_test", "[]");
    json_decref(document);

    /* each photo by its own number beside all by the largest */
    change_run(a, "dataset", "downscale", json_integer(3));
    change_run(b, "dataset", "downscale", json_integer(3));
    change_run(b, "dataset", "downscale_least", json_integer(1));
    document = beside(a, b);
    assert_note(document, "Photos differ in size", true);
    assert_row(document, "settings", "downscale", "[\"3 (auto)\",\"1 to 3 (auto)\"]");
    json_decref(document);

    change_run(b, "dataset", "downscale", NULL);
    change_run(b, "dataset", "downscale_least", NULL);
    document = beside(a, b);
    assert_note(document, "tells the size of its photos", true);
    json_decref(document);

    change_run(b, "dataset", "path", json_string("/s/cup"));
    change_run(b, "dataset", "digest", NULL);
    for (int i = 0; i < 2; i++) { /* one tells, none does */
        document = beside(a, b);
        assert_false(json_is_true(json_object_get(document, "comparable")));
        assert_note(document, "tells which scene it is of", true);
        assert_row(document, "facts", "scene", "[\"/s/pot\",\"/s/cup\"]");
        assert_row(document, "best", "psnr_test", "[]");
        json_decref(document);
        if (i == 0)
            change_run(a, "dataset", "digest", NULL);
    }
}

/* The same masks, read in other ways: other pixels count. */
static void masks_read_otherwise_do_not_compare(void **state)
{
    static const struct {
        const char *first, *as, *second, *other, *row;
    } cases[] = {
        {"ignore", "ignore", "ignore-white", "ignore", "[\"ignore\",\"ignore-white\"]"},
        {"alpha", "alpha", "inverted", "alpha", "[\"alpha\",\"inverted\"]"},
        {"auto", "alpha", "ignore", "ignore", "[\"alpha (auto)\",\"ignore\"]"},
        {"auto", "ignore", "ignore", "ignore", ""},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *const first[][2] = {{"masks", cases[i].first}, {NULL}};
        const char *const second[][2] = {{"masks", cases[i].second}, {NULL}};
        const char *a = put_run(*state, "a", "d1", first), *b = put_run(*state, "b", "d1", second);
        json_t *document = NULL;

        change_run(a, "dataset", "masks", json_pack("{s:s}", "as", cases[i].as));
        change_run(b, "dataset", "masks", json_pack("{s:s}", "as", cases[i].other));
        document = beside(a, b);
        assert_row(document, "settings", "masks", cases[i].row);
        assert_int_equal(json_is_true(json_object_get(document, "comparable")), !*cases[i].row);
        assert_note(document, "Masks are read in different ways", *cases[i].row);
        json_decref(document);
    }
}

/* Runs without a result: their test views are told by settings. */
static void unfinished_runs_compare_by_the_same_views(void **state)
{
    const char *const one[][2] = {{"eval-images", "1"}, {NULL}};
    const char *const all[][2] = {{"eval-images", "99"}, {NULL}};
    const char *a = put_run(*state, "a", "d1", one), *b = put_run(*state, "b", "d1", all);
    const char *const runs[] = {a, b};
    json_t *document = NULL;

    for (int i = 0; i < 2; i++) {
        char rows[128];

        snprintf(rows, sizeof rows, "{\"step\":7,\"psnr_test\":%d}\n{\"step\":9}\n", 20 + i);
        scratch_put(scratch_path(runs[i], "metrics.jsonl"), rows, strlen(rows));
    }
    document = beside(a, b);
    assert_row(document, "results", "eval_step", ""); /* a result's evaluation has no row */
    json_decref(document);

    change_run(a, NULL, "result", json_null());
    change_run(b, NULL, "result", json_null());
    document = beside(a, b);
    assert_row(document, "results", "psnr_test", "[20,21]");
    assert_row(document, "results", "eval_views", "[1,10]");
    assert_row(document, "results", "eval_step", "[7,7]");
    assert_row(document, "best", "psnr_test", "[]");
    assert_note(document, "are over different numbers of views", true);
    json_decref(document);

    change_run(a, "config", "eval_images", json_integer(10));
    document = beside(a, b);
    assert_row(document, "best", "psnr_test", "[1]");
    assert_note(document, "different numbers of views", false);
    json_decref(document);

    change_run(a, "config", "novel", json_integer(1)); /* nor does it tell its views then */
    change_run(b, "config", "novel", json_integer(1));
    document = beside(a, b);
    assert_row(document, "results", "eval_views", "");
    assert_row(document, "best", "psnr_test", "[]");
    assert_note(document, "may be over different numbers of views", true);
    json_decref(document);
}

/* Of a run that was killed, its newest checkpoint counts: rows behind it are lost. */
static void killed_runs_are_as_their_checkpoints(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", NULL);
    const char *const rows =
        "{\"step\":10,\"seconds\":1,\"leaves\":8,\"psnr_train\":11,\"psnr_test\":12}\n"
        "{\"step\":20,\"seconds\":2,\"leaves\":16,\"psnr_train\":21}\n"
        "{\"step\":30,\"seconds\":3,\"leaves\":24,\"psnr_train\":31,\"psnr_test\":32}\n";
    json_t *document = NULL;

    change_run(b, NULL, "result", json_null());
    change_run(b, NULL, "state", json_string("running"));
    scratch_put(scratch_path(b, "metrics.jsonl"), rows, strlen(rows));
    document = beside(a, b);
    assert_row(document, "results", "step", "[500,30]"); /* none yet */
    assert_row(document, "results", "psnr_test", "[27.5,32]");
    json_decref(document);

    assert_int_equal(cln_make_dirs(scratch_path(b, "checkpoint")), CLN_OK);
    scratch_put(scratch_path(b, "checkpoint/00000025.json"), "{}", 2);
    document = beside(a, b);
    assert_row(document, "results", "step", "[500,25]");
    assert_row(document, "results", "seconds", "[20.5,2]");
    assert_row(document, "results", "leaves", "[64,16]");
    assert_row(document, "results", "psnr_train", "[30.001,21]");
    assert_row(document, "results", "psnr_test", "[27.5,12]");
    assert_row(document, "results", "eval_step", "[null,10]");
    json_decref(document);
}

/* A run whose newest checkpoint is gone is as the one before it. */
static void runs_that_went_back_are_as_their_checkpoints(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", NULL);
    const char *const rows = "{\"step\":400,\"seconds\":9,\"psnr_train\":11,\"psnr_test\":12}\n"
                             "{\"step\":500,\"seconds\":20,\"psnr_train\":21}\n";
    json_t *document = NULL;

    scratch_put(scratch_path(b, "metrics.jsonl"), rows, strlen(rows));
    put_eval(b, "00000300-test", 300, 10, 20.0, false);
    put_eval(b, "00000500-test", 500, 10, 29.0, false);
    assert_int_equal(cln_make_dirs(scratch_path(b, "checkpoint")), CLN_OK);
    scratch_put(scratch_path(b, "checkpoint/00000500.json"), "{}", 2);
    document = beside(a, b);
    assert_row(document, "results", "psnr_test", "[27.5,29]");
    assert_note(document, "it ended at step", false);
    json_decref(document);

    assert_int_equal(rename(scratch_path(b, "checkpoint/00000500.json"),
                            scratch_path(b, "checkpoint/00000400.json")),
                     0);
    document = beside(a, b);
    assert_row(document, "results", "step", "[500,400]");
    assert_row(document, "results", "seconds", "[20.5,9]");
    assert_row(document, "results", "psnr_train", "[30.001,11]");
    assert_row(document, "results", "psnr_test", "[27.5,20]");
    assert_row(document, "results", "eval_step", "[null,300]");
    assert_note(document, "b: it ended at step 500, but the checkpoint of that is gone", true);
    json_decref(document);
}

static void odd_runs_are_ordinary(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "x/a", "d1", NULL);
    const char *const with_scene[] = {a, *state}, *row = "{\"step\":7,\"psnr_train\":12.5}\n";
    json_t *run = NULL, *document = beside(a, a);

    assert_note(document, "are the same run", true);
    json_decref(document);

    assert_int_equal(cln_run_read(b, &run), CLN_OK);
    json_object_set_new(run, "state", json_string("interrupted"));
    json_object_set_new(run, "result", json_null());
    put_json(b, "run.json", json_incref(run));
    document = beside(a, b);
    assert_note(document, "x/a: it has no results yet (interrupted)", true);
    assert_row(document, "results", "step", "[500,null]");
    assert_row(document, "best", "psnr_train", "[]");
    assert_string_equal(json_string_value(json_array_get(json_object_get(document, "names"), 1)),
                        b); /* both folders are called a */
    json_decref(document);

    scratch_put(scratch_path(b, "metrics.jsonl"), row, strlen(row));
    json_object_set_new(json_object_get(run, "config"), "novel", json_integer(1));
    put_json(b, "run.json", run);
    document = beside(b, a);
    assert_note(document, "interrupted at step 7", true);
    assert_note(document, "another version's", true);
    assert_true(json_is_false(json_array_get(json_object_get(document, "readable"), 0)));
    assert_true(json_is_true(json_array_get(json_object_get(document, "readable"), 1)));
    assert_row(document, "results", "psnr_train", "[12.5,30.001]");
    assert_row(document, "best", "psnr_train", "[1]");
    assert_int_equal(json_object_size(json_object_get(document, "settings")), 0);
    json_decref(document);

    assert_int_equal(cln_side_by_side(2, with_scene, &document), CLN_INPUT);
    assert_null(document);
    assert_non_null(strstr(cln_error_text(), "not a run"));
}

/* JSON holds UTF-8 alone: a run in a folder whose name is none is called as it was given. */
static void a_name_that_is_no_utf8(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = scratch_path(*state, "\xff");
    const int before = open(".", O_RDONLY | O_DIRECTORY);
    json_t *document = NULL;

    assert_int_equal(rename(put_run(*state, "b", "d1", NULL), b), 0);
    assert_true(before >= 0 && chdir(b) == 0);
    document = beside(".", a);
    assert_true(fchdir(before) == 0);
    close(before);
    assert_row(document, "results", "step", "[500,500]");
    assert_string_equal(json_string_value(json_array_get(json_object_get(document, "names"), 0)),
                        ".");
    json_decref(document);
}

/* Adds a start with these settings, by this program, to a history, which is freed. */
static void add_start(json_t **history, int64_t step, const cln_config *saved,
                      const cln_config *now, const char *program)
{
    const char *const programs[2] = {"1.0 of commit ab", program};
    json_t *longer = NULL;

    static const char *const same[2] = {"12ab", "12ab"};

    assert_int_equal(
        cln_history_add(*history, step, "train", "today", saved, now, same, programs, &longer),
        CLN_OK);
    json_decref(*history);
    *history = longer;
}

/* A run that went on with other settings is told from one that has them from the start. */
static void resumed_with_other_settings_is_told(void **state)
{
    const char *a = put_run(*state, "a", "d1", NULL), *b = put_run(*state, "b", "d1", NULL);
    json_t *history = NULL, *run = NULL, *document = NULL;
    cln_config first, second;

    assert_int_equal(cln_config_preset("voxel", &first), CLN_OK);
    second = first;
    second.seed = 7;
    second.eval_images = 1; /* is only measured by */
    add_start(&history, 0, NULL, &first, "1.0 of commit ab");
    add_start(&history, 100, &first, &first, "1.0 of commit ab");
    assert_int_equal(cln_run_read(b, &run), CLN_OK);
    json_object_set(run, "history", history);
    put_json(b, "run.json", json_incref(run));
    document = beside(a, b);
    assert_note(document, "resumed", false); /* with the same settings */
    json_decref(document);

    add_start(&history, 120, &first, &second, "1.0 of commit ab");
    add_start(&history, 120, &first, &second,
              "1.0 of commit ab"); /* the start before left no step */
    assert_int_equal(json_array_size(history), 3);
    json_object_set(run, "history", history);
    put_json(b, "run.json", json_incref(run));
    document = beside(a, b);
    assert_note(document, "b: resumed at step 120 with other settings: seed 42 -> 7\"", true);
    assert_int_equal(json_array_size(json_array_get(json_object_get(document, "resumed"), 0)), 0);
    assert_int_equal(json_array_size(json_array_get(json_object_get(document, "resumed"), 1)), 1);
    json_decref(document);

    json_array_clear(history);
    add_start(&history, 0, NULL, &first, "1.0 of commit ab");
    add_start(&history, 60, &first, &first, "1.0 of commit cd");
    json_object_set_new(run, "history", history);
    put_json(b, "run.json", run);
    document = beside(a, b);
    assert_note(document,
                "b: resumed at step 60 with the same settings, by another program: "
                "1.0 of commit ab -> 1.0 of commit cd\"",
                true);
    assert_int_equal(json_array_size(json_array_get(json_object_get(document, "resumed"), 1)), 1);
    json_decref(document);
}

/* Mean and standard deviation of runs that differ by their seeds alone; nothing of others. */
static void seeds_have_a_spread(void **state)
{
    static const char *const members[] = {"mean", "deviation"};
    static const double psnr[3] = {27, 28, 30}, wanted[2] = {28.333333, 1.527525};
    const char *runs[3];
    json_t *document = NULL, *row = NULL;

    for (int i = 0; i < 3; i++) {
        const char seed[2] = {(char)('1' + i), 0}, name[2] = {(char)('a' + i), 0};
        const char *const settings[][2] = {{"seed", seed}, {NULL}};

        runs[i] = put_run(*state, name, "d1", settings);
        put_eval(runs[i], "00000500-test", 500, 10, psnr[i], false);
    }
    assert_int_equal(cln_side_by_side(3, runs, &document), CLN_OK);
    row = json_object_get(json_object_get(document, "over_seeds"), "psnr_test");
    for (int k = 0; k < 2; k++)
        assert_near(json_number_value(json_object_get(row, members[k])), wanted[k], 1e-5);
    assert_non_null(json_object_get(json_object_get(document, "over_seeds"), "ssim"));
    assert_null(json_object_get(json_object_get(document, "over_seeds"), "leaves"));
    json_decref(document);
    put_eval(runs[1], "00000500-test", 500, 4, 28, false); /* of other views */
    assert_int_equal(cln_side_by_side(3, runs, &document), CLN_OK);
    row = json_object_get(document, "over_seeds");
    assert_null(json_object_get(row, "psnr_test"));
    assert_non_null(json_object_get(row, "psnr_train"));
    json_decref(document);
    runs[1] = runs[0]; /* one seed twice */
    assert_int_equal(cln_side_by_side(3, runs, &document), CLN_OK);
    assert_int_equal(json_object_size(json_object_get(document, "over_seeds")), 0);
    json_decref(document);
    runs[1] = put_run(*state, "rays", "d1", (const char *const[][2]){{"rays", "1024"}, {NULL}});
    assert_int_equal(cln_side_by_side(3, runs, &document), CLN_OK);
    assert_int_equal(json_object_size(json_object_get(document, "over_seeds")), 0);
    json_decref(document);
}

int test_group_side_by_side(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_differs_is_listed, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(the_best_is_told, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(other_scenes_do_not_compare, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(the_same_test_photos_compare, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(untold_scenes_do_not_compare, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(masks_read_otherwise_do_not_compare, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(unfinished_runs_compare_by_the_same_views, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(runs_that_went_back_are_as_their_checkpoints, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(killed_runs_are_as_their_checkpoints, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(odd_runs_are_ordinary, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(a_name_that_is_no_utf8, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(resumed_with_other_settings_is_told, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(seeds_have_a_spread, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("side by side", tests, NULL, NULL);
}
