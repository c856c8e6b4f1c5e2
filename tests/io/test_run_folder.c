/* The run folder, and names of a view's files. Tested: only a new, empty or own folder is written,
 * a foreign one stays unchanged; run.json keeps every bit of its numbers and is never half written;
 * resuming truncates the metrics, so an interrupted run ends with the rows of an uninterrupted one.
 * Oracle: hand-made folders and files. Reading JSON is tested in scene_input. */
#include "unit.h"
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include "base/memory.h"
#include "io/disk.h"
#include "io/names.h"
#include "io/run_folder.h"
#include "io/run_history.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

static json_t *document(double number)
{
    return json_pack("{s:s, s:s, s:o}", "schema", "cl-nascent.run/1", "state", "running", "number",
                     cln_json_real(number));
}

static void test_new_folder(void **state)
{
    const char *run = scratch_path(*state, "deep/in/run");
    json_t *doc = document(1);

    assert_fails(cln_run_open(run, true), CLN_INPUT, "no run there");
    assert_false(cln_is_dir(run));
    assert_int_equal(cln_run_open(run, false), CLN_OK);
    assert_true(cln_is_dir(run));
    assert_int_equal(cln_run_open(run, false), CLN_OK); /* still empty */
    assert_fails(cln_run_open(run, true), CLN_INPUT, "no run there");
    scratch_put(scratch_path(run, "run.json.tmp.12.0"), "{", 1); /* a first write that was killed */
    assert_int_equal(cln_run_open(run, false), CLN_OK);

    assert_int_equal(cln_run_write(run, doc), CLN_OK);
    assert_fails(cln_run_open(run, false), CLN_OUTPUT, "before its first checkpoint");
    assert_int_equal(mkdir(scratch_path(run, "checkpoint"), 0777), 0);
    assert_fails(cln_run_open(run, false), CLN_OUTPUT, "--resume");
    assert_int_equal(cln_run_open(run, true), CLN_OK);
    json_decref(doc);
}

static void test_refuses_foreign(void **state)
{
    static const struct {
        const char *name, *text, *word;
    } foreign[] = {{"holiday.jpg", "x", "no run.json"},
                   {".hidden", "", "no run.json"},
                   {"run.json", "{\"name\": \"my jogging app\"}", "not named"},
                   {"run.json", "{\"schema\": \"cl-nascent.run/9\"}", "cl-nascent.run/9"},
                   {"run.json", "{\"schema\": \"cl-nas", "line 1"},
                   {"run.json", "[]", "not named"},
                   {"run.json", "", "line"}};
    const char *run = scratch_path(*state, "run");

    assert_int_equal(mkdir(run, 0777), 0);
    for (size_t i = 0; i < sizeof foreign / sizeof foreign[0]; i++)
        for (int resume = 0; resume < 2; resume++) {
            const char *path = scratch_path(run, foreign[i].name);
            size_t bytes = 0;
            char *data = NULL;
            scratch_put(path, foreign[i].text, strlen(foreign[i].text));
            assert_fails(cln_run_open(run, resume), CLN_OUTPUT, foreign[i].word);
            data = scratch_get(path, &bytes);
            assert_string_equal(data, foreign[i].text);
            free(data);
            unlink(path);
            assert_int_equal(rmdir(run), 0); /* it has no other file */
            assert_int_equal(mkdir(run, 0777), 0);
        }
    scratch_put(scratch_path(*state, "file"), "x", 1);
    assert_fails(cln_run_open(scratch_path(*state, "file"), false), CLN_OUTPUT, "not a folder");
    assert_fails(cln_run_open(scratch_path(*state, "file/run"), false), CLN_OUTPUT, "file");
    assert_int_equal(symlink("/nowhere/at/all", scratch_path(*state, "link")), 0);
    assert_fails(cln_run_open(scratch_path(*state, "link"), false), CLN_OUTPUT, "not a folder");
}

/* The error for a path inside a run names the run, however the path ends; for other paths it says
 * that there is no run. */
static void test_in_a_run(void **state)
{
    static const char *const within[] = {"checkpoint", "checkpoint/", "run.json", "checkpoint///"};
    const char *run = scratch_path(*state, "a/run");
    char want[512];
    json_t *doc = document(1), *back = NULL;

    assert_int_equal(cln_run_open(run, false), CLN_OK);
    assert_int_equal(cln_run_write(run, doc), CLN_OK);
    assert_int_equal(mkdir(scratch_path(run, "checkpoint"), 0777), 0);
    snprintf(want, sizeof want, "in one: give %s", run);
    for (size_t i = 0; i < sizeof within / sizeof *within; i++)
        assert_fails(cln_run_read(scratch_path(run, within[i]), &back), CLN_INPUT, want);
    assert_fails(cln_run_read(scratch_path(*state, "a/"), &back), CLN_INPUT, "no run.json in it");
    assert_fails(cln_run_read(scratch_path(*state, "b"), &back), CLN_INPUT, "no such folder");
    json_decref(doc);
}

static void test_run_json(void **state)
{
    static const double numbers[] = {0.1,  1.0 / 3,   5e-324, 1.7976931348623157e308,
                                     -0.0, 12345678.9};
    const char *run = *state;
    json_t *doc = NULL, *back = NULL;

    assert_fails(cln_run_read(run, &back), CLN_INPUT, "no run.json");
    assert_null(back);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        double value = 0;
        doc = document(numbers[i]);
        assert_int_equal(cln_run_write(run, doc), CLN_OK);
        assert_int_equal(cln_run_read(run, &back), CLN_OK);
        value = json_real_value(json_object_get(back, "number"));
        assert_memory_equal(&value, &numbers[i], sizeof value);
        json_decref(doc);
        json_decref(back);
    }
    doc = document(NAN);
    assert_int_equal(cln_run_write(run, doc), CLN_OK);
    assert_int_equal(cln_run_read(run, &back), CLN_OK);
    assert_true(json_is_null(json_object_get(back, "number")));
    json_decref(doc);
    json_decref(back);
}

/* A full disk, or a folder in the file's place, leaves the old document. */
static void test_atomic(void **state)
{
    const char *run = *state, *blocked = scratch_path(run, "eval/00000001-test.json");
    json_t *doc = document(1), *larger = document(2), *back = NULL;
    char filler[4096] = "";

    memset(filler, 'x', sizeof filler - 1);
    json_object_set_new(larger, "filler", json_string(filler));
    assert_int_equal(cln_run_write(run, doc), CLN_OK);
    scratch_limit_files(1024);
    assert_fails(cln_run_write(run, larger), CLN_OUTPUT, "run.json");
    scratch_limit_files(RLIM_INFINITY);
    assert_int_equal(cln_run_read(run, &back), CLN_OK);
    assert_true(json_equal(doc, back));

    assert_int_equal(cln_run_write_json(run, "eval/00000002-test.json", doc), CLN_OK);
    assert_true(cln_is_file(scratch_path(run, "eval/00000002-test.json")));
    assert_int_equal(mkdir(blocked, 0777), 0);
    assert_fails(cln_run_write_json(run, "eval/00000001-test.json", doc), CLN_OUTPUT, "00000001");
    assert_fails(cln_run_write_json(run, "run.json/x.json", doc), CLN_OUTPUT, "run.json");
    json_decref(doc);
    json_decref(larger);
    json_decref(back);
}

static void add_rows(cln_metrics *metrics, int first, int last)
{
    for (int step = first; step <= last; step += 25) {
        json_t *row = json_pack("{s:i, s:o, s:o}", "step", step, "loss", cln_json_real(1.0 / step),
                                "psnr_test", cln_json_real(NAN));
        assert_int_equal(cln_metrics_add(metrics, row), CLN_OK);
        json_decref(row);
    }
}

/* Interrupted at step 160 with a checkpoint of step 100, then resumed: the same bytes as without
 * the interruption. */
/* The last row gets what was measured at its step, and is found again. */
static void test_metrics_last(void **state)
{
    const char *run = *state;
    json_t *row = NULL, *event = json_pack("{s:s s:i}", "event", "structure", "step", 60);
    cln_metrics *metrics = NULL;
    char *text = NULL;
    size_t bytes = 0;

    assert_ok(cln_metrics_last(run, 100, NULL, &row)); /* no file */
    assert_null(row);
    assert_ok(cln_metrics_open(run, 0, &metrics));
    add_rows(metrics, 25, 75);
    assert_ok(cln_metrics_amend(metrics, 80, "psnr_end", 31.5)); /* no row of it */
    assert_ok(cln_metrics_amend(metrics, 75, "psnr_end", 31.5));
    assert_ok(cln_metrics_add(metrics, event));
    assert_ok(cln_metrics_amend(metrics, 60, "psnr_end", 1.5)); /* an event */
    cln_metrics_close(metrics);
    text = scratch_get(scratch_path(run, "metrics.jsonl"), &bytes);
    assert_non_null(strstr(text, "\"psnr_end\":31.5}\n{\"event\""));
    assert_null(strstr(text, "1.5}\n{\"step\":75"));
    assert_null(strstr(text, "\"psnr_end\":1.5"));
    free(text);
    assert_ok(cln_metrics_last(run, 100, NULL, &row));
    assert_int_equal(json_integer_value(json_object_get(row, "step")), 75);
    json_decref(row);
    assert_ok(cln_metrics_last(run, 74, NULL, &row));
    assert_int_equal(json_integer_value(json_object_get(row, "step")), 50);
    json_decref(row);
    assert_ok(cln_metrics_last(run, 3, NULL, &row));
    assert_null(row);
    assert_ok(cln_metrics_last(run, 100, "psnr_end", &row));
    assert_int_equal(json_integer_value(json_object_get(row, "step")), 75);
    json_decref(row);
    assert_ok(cln_metrics_last(run, 74, "psnr_end", &row)); /* rows, but none that has it */
    assert_null(row);
    json_decref(event);
    /* of where a stop left an interval unfinished, the last row is that one, too */
    event = json_pack("{s:i s:b}", "step", 80, "unfinished", true);
    assert_ok(cln_metrics_open(run, 75, &metrics));
    assert_ok(cln_metrics_add(metrics, event));
    assert_ok(cln_metrics_amend(metrics, 80, "psnr_end", 32.5));
    cln_metrics_close(metrics);
    json_decref(event);
    assert_ok(cln_metrics_last(run, 90, "psnr_end", &row));
    assert_int_equal(json_integer_value(json_object_get(row, "step")), 80);
    json_decref(row);
    assert_ok(cln_metrics_open(run, 80, &metrics)); /* one that goes on repeats the interval */
    cln_metrics_close(metrics);
    assert_ok(cln_metrics_last(run, 90, NULL, &row));
    assert_int_equal(json_integer_value(json_object_get(row, "step")), 75);
    json_decref(row);
    /* rows behind it stay */
    event = json_pack("{s:s s:i}", "event", "structure", "step", 76);
    assert_ok(cln_metrics_open(run, 76, &metrics));
    assert_ok(cln_metrics_add(metrics, event));
    assert_ok(cln_metrics_amend(metrics, 75, "psnr_end", 7.5));
    cln_metrics_close(metrics);
    json_decref(event);
    text = scratch_get(scratch_path(run, "metrics.jsonl"), &bytes);
    assert_null(strstr(text, "7.5"));
    assert_non_null(strstr(text, "\"step\":76}"));
    free(text);
}

static void test_metrics_resume(void **state)
{
    const char *whole = scratch_path(*state, "whole"), *parts = scratch_path(*state, "parts");
    const char *path = scratch_path(parts, "metrics.jsonl");
    cln_metrics *metrics = NULL;
    char *a = NULL, *b = NULL;
    size_t a_bytes = 0, b_bytes = 0;
    FILE *f = NULL;

    assert_int_equal(mkdir(whole, 0777), 0);
    assert_int_equal(mkdir(parts, 0777), 0);
    assert_int_equal(cln_metrics_open(whole, 0, &metrics), CLN_OK);
    add_rows(metrics, 25, 300);
    cln_metrics_close(metrics);

    assert_int_equal(cln_metrics_open(parts, 0, &metrics), CLN_OK);
    add_rows(metrics, 25, 150);
    cln_metrics_close(metrics);
    f = fopen(path, "ab"); /* killed in the middle of a row */
    assert_non_null(f);
    fputs("{\"step\":175,\"lo", f);
    fclose(f);
    assert_int_equal(cln_metrics_open(parts, 100, &metrics), CLN_OK);
    a = scratch_get(path, &a_bytes);
    assert_int_equal(a[a_bytes - 1], '\n');
    assert_non_null(strstr(a, "\"step\":100,"));
    assert_null(strstr(a, "\"step\":125,"));
    assert_null(strstr(a, "175"));
    free(a);
    add_rows(metrics, 125, 300);
    cln_metrics_close(metrics);

    a = scratch_get(scratch_path(whole, "metrics.jsonl"), &a_bytes);
    b = scratch_get(path, &b_bytes);
    assert_int_equal(a_bytes, b_bytes);
    assert_memory_equal(a, b, a_bytes);
    assert_non_null(strstr(a, "\"psnr_test\":null"));
    free(a);
    free(b);
}

/* Figures of later steps are set aside, those of others and other files stay. */
static void test_drop_evals(void **state)
{
    static const struct {
        const char *name;
        bool dropped;
    } files[] = {{"00000111-test-8.json", false},
                 {"00000112-test.json", true},
                 {"100000000-val.json", true},
                 {"00000112-test.png", false},
                 {"notes.json", false}};
    const char *run = scratch_path(*state, "run");

    assert_int_equal(cln_run_drop_evals(run, 111), CLN_OK); /* without any */
    assert_int_equal(cln_make_dirs(scratch_path(run, "eval")), CLN_OK);
    for (int pass = 0; pass < 2; pass++) { /* names of before are replaced */
        for (size_t i = 0; i < sizeof files / sizeof files[0]; i++)
            scratch_put(scratch_path(scratch_path(run, "eval"), files[i].name), "{}", 2);
        assert_int_equal(cln_run_drop_evals(run, 111), CLN_OK);
        for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
            char aside[64];

            snprintf(aside, sizeof aside, "eval/%s.dropped", files[i].name);
            assert_int_equal(access(scratch_path(scratch_path(run, "eval"), files[i].name), F_OK),
                             files[i].dropped ? -1 : 0);
            assert_int_equal(access(scratch_path(run, aside), F_OK), files[i].dropped ? 0 : -1);
        }
    }
}

/* Truncation removes lines that are not rows, and events of the step itself, which happen again; it
 * does not write a file without such lines. */
static void test_metrics_cut(void **state)
{
    const char *run = *state, *path = scratch_path(run, "metrics.jsonl");
    static const char text[] =
        "{\"step\":1}\nnonsense\n{\"stop\":2}\n\n{\"event\":\"x\",\"step\":2}\n{\"step\":3}\n"
        "{\"event\":\"x\",\"step\":3}\n{\"step\":9}\n";
    cln_metrics *metrics = NULL;
    char *data = NULL;
    size_t bytes = 0;
    struct stat before, after;

    scratch_put(path, text, strlen(text));
    assert_int_equal(cln_metrics_open(run, 3, &metrics), CLN_OK);
    cln_metrics_close(metrics);
    data = scratch_get(path, &bytes);
    assert_string_equal(data, "{\"step\":1}\n{\"event\":\"x\",\"step\":2}\n{\"step\":3}\n");
    free(data);
    assert_int_equal(stat(path, &before), 0);
    assert_int_equal(cln_metrics_open(run, 3, &metrics), CLN_OK);
    cln_metrics_close(metrics);
    assert_int_equal(stat(path, &after), 0);
    assert_int_equal(before.st_ino, after.st_ino);
    cln_metrics_close(NULL);
}

/* The disk fills up in the middle of a row: the whole row is removed again. */
static void test_metrics_full_disk(void **state)
{
    const char *run = *state, *path = scratch_path(run, "metrics.jsonl");
    cln_metrics *metrics = NULL;
    size_t before = 0, after = 0;
    char *data = NULL, filler[200] = "";
    json_t *row = NULL;

    memset(filler, 'y', sizeof filler - 1);
    row = json_pack("{s:i, s:s}", "step", 75, "filler", filler);
    assert_int_equal(cln_metrics_open(run, 0, &metrics), CLN_OK);
    add_rows(metrics, 25, 50);
    free(scratch_get(path, &before));
    scratch_limit_files(before + 100);
    assert_fails(cln_metrics_add(metrics, row), CLN_OUTPUT, "metrics.jsonl");
    scratch_limit_files(RLIM_INFINITY);
    data = scratch_get(path, &after);
    assert_int_equal(after, before);
    free(data);
    assert_int_equal(cln_metrics_add(metrics, row), CLN_OK); /* has space again */
    data = scratch_get(path, &after);
    assert_int_equal(after, before + strlen("{\"step\":75,\"filler\":\"\"}\n") + 199);
    free(data);
    cln_metrics_close(metrics);
    json_decref(row);
    assert_fails(cln_metrics_open(scratch_path(run, "missing"), 0, &metrics), CLN_OUTPUT,
                 "metrics.jsonl");
    assert_null(metrics);
}

static void test_machine(void **state)
{
    char now[32] = "";
    int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
    volatile char *memory = NULL;
    double before = cln_peak_rss();

    (void)state;
    cln_utc_now(now);
    assert_int_equal(
        sscanf(now, "%4d-%2d-%2dT%2d:%2d:%2dZ", &year, &month, &day, &hour, &minute, &second), 6);
    assert_int_equal(strlen(now), 20);
    assert_true(year >= 2024 && month >= 1 && month <= 12 && day >= 1 && hour < 24);
    memory = malloc(1 << 28);
    assert_non_null(memory);
    for (size_t i = 0; i < 1 << 28; i += 4096)
        memory[i] = 1;
    assert_true(cln_peak_rss() >= before);
    assert_true(cln_peak_rss() >= 1 << 28);
    free((void *)memory);
}

static void test_view_file_name(void **state)
{
    static const char *const cases[][2] = {{"train/r_0.png", "train_r_0"},
                                           {"./test/a/b.JPG", "test_a_b"},
                                           {"r_0", "r_0"},
                                           {"frame.0001", "frame.0001"},
                                           {"frame.0001.jpeg", "frame.0001"},
                                           {"shot.1001.EXR", "shot.1001"},
                                           {"a/b.tiff", "a_b"},
                                           {".png", ".png"},
                                           {"v1.5/r_0", "v1.5_r_0"},
                                           {"a\\b.png", "a_b"},
                                           {"ü (1)*.png", "ü (1)*"}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char *name = NULL;

        assert_int_equal(cln_view_file_name(cases[i][0], &name), CLN_OK);
        assert_string_equal(name, cases[i][1]);
        free(name);
    }
}

/* Two names with the same beginning, of "ü", which has two bytes: files have whole characters of
 * it, and differ. */
static void test_long_file_names(void **state)
{
    char a[301], b[301];
    const char *const names[] = {a, b};
    char *files[2] = {NULL};

    (void)state;
    a[0] = 'x'; /* so that a character spans the last byte */
    for (int i = 1; i < 299; i += 2)
        memcpy(a + i, "ü", 3);
    a[299] = 0;
    memcpy(b, a, sizeof b);
    b[298] = (char)(b[298] + 1);
    assert_int_equal(cln_names_folder(2, (const char *const[2]){"C:\\a\\b1.png", "C:\\a\\b2.png"}),
                     5);
    assert_int_equal(cln_names_folder(2, (const char *const[2]){"/a/b/1.png", "/a/c/1.png"}), 3);
    assert_int_equal(cln_names_folder(2, (const char *const[2]){"a.png", "ab.png"}), 0);
    assert_true(cln_name_is_absolute("d:/x") && cln_name_is_absolute("/x"));
    assert_false(cln_name_is_absolute("d:x") || cln_name_is_absolute("x/y") ||
                 cln_name_is_absolute(""));
    assert_int_equal(cln_view_file_names(2, names, files), CLN_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(strlen(files[i]), 179 + 9);
        assert_int_equal(memcmp(files[i], a, 179), 0);
        assert_int_equal(files[i][179], '-');
    }
    assert_string_not_equal(files[0], files[1]);
    for (int i = 0; i < 2; i++)
        free(files[i]);
}

/* Names that give the same file name get their digest as a suffix; the others, and one that is in
 * two splits, stay as they are. */
static void test_view_file_names(void **state)
{
    static const char *const names[] = {"a/b.png", "train/r_0", "a_b.jpg", "two.png",
                                        "two.png", "a_b",       "a_c"};
    char *files[7] = {NULL};

    (void)state;
    assert_int_equal(cln_view_file_names(7, names, files), CLN_OK);
    for (int i = 0; i < 7; i++)
        for (int k = 0; k < i; k++)
            assert_true((strcmp(files[i], files[k]) == 0) == (strcmp(names[i], names[k]) == 0));
    assert_string_equal(files[1], "train_r_0");
    assert_string_equal(files[3], "two");
    assert_string_equal(files[6], "a_c");
    assert_int_equal(strncmp(files[0], "a_b-", 4), 0);
    assert_int_equal(strlen(files[0]), 12);
    for (int i = 0; i < 7; i++)
        free(files[i]);
}

/* Names that a stick takes for one get digests, too; what it does not take becomes "_". */
static void test_files_on_sticks(void **state)
{
    static const char *const names[] = {"Bild 1.png", "bild 1.png", "a\\b:c.png"};
    char *files[3] = {NULL};

    (void)state;
    assert_int_equal(cln_view_file_names(3, names, files), CLN_OK);
    assert_int_equal(strncmp(files[0], "Bild 1-", 7), 0);
    assert_int_equal(strncmp(files[1], "bild 1-", 7), 0);
    assert_true(strcasecmp(files[0], files[1]) != 0);
    assert_string_equal(files[2], "a_b_c");
    for (int i = 0; i < 3; i++)
        free(files[i]);
}

/* The free space is that of the nearest existing folder; nothing is created. */
static void test_disk_check(void **state)
{
    const char *deep = scratch_path(*state, "new/deeper/run");

    assert_int_equal(cln_disk_check(deep, 1000, "things"), CLN_OK);
    assert_false(cln_is_dir(scratch_path(*state, "new")));
    assert_int_equal(cln_disk_check(deep, 1e18, "9 things"), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "too little room for 9 things: up to"));
    assert_non_null(strstr(cln_error_text(), "are free"));
    cln_clear_error();
    scratch_put(scratch_path(*state, "new"), "x", 1);
    assert_int_equal(cln_disk_check(deep, 0, "things"), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "new is not a folder"));
    cln_clear_error();
    assert_int_equal(cln_disk_check("/proc/run", 0, "things"), CLN_OUTPUT); /* also as root */
    cln_clear_error();
    assert_int_equal(cln_disk_check_file(scratch_path(*state, "file.ply"), 10, "boxes"), CLN_OK);
    assert_int_equal(cln_disk_check_file("file.ply", 1e18, "boxes"), CLN_OUTPUT);
    cln_clear_error();
    assert_int_equal(cln_disk_check_file("/proc/a.ply", 0, ""), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "/proc/a.ply: no file can be created in /proc"));
    cln_clear_error();
}

/* A name of 255 bytes is possible for a folder, but not for a file, which is called a little longer
 * while it is written. */
static void test_names_too_long(void **state)
{
    static const struct {
        int bytes;
        bool folder, file, within;
    } cases[] = {{231, true, true, true},
                 {232, true, false, true},
                 {255, true, false, true},
                 {256, false, false, false}};
    const char *folder = *state;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char name[300], path[1024];

        memset(name, 'n', sizeof name);
        name[cases[i].bytes] = 0;
        snprintf(path, sizeof path, "%s/%s", folder, name);
        assert_int_equal(cln_disk_check(path, 0, ""), cases[i].folder ? CLN_OK : CLN_OUTPUT);
        assert_int_equal(cln_disk_check_file(path, 0, ""), cases[i].file ? CLN_OK : CLN_OUTPUT);
        if (!cases[i].file)
            assert_non_null(strstr(cln_error_text(), "this name is too long: it has "));
        cln_clear_error();
        snprintf(path, sizeof path, "%s/%s/a.ply", folder, name);
        assert_int_equal(cln_disk_check_file(path, 0, ""), cases[i].within ? CLN_OK : CLN_OUTPUT);
        cln_clear_error();
    }
}

/* A new file needs an existing folder, and must not replace anything. */
static void test_disk_check_new(void **state)
{
    char there[512];

    snprintf(there, sizeof there, "%s", scratch_path(*state, "there.ply"));
    scratch_put(there, "x", 1);
    assert_int_equal(cln_disk_check_new(scratch_path(*state, "new.ply"), false), CLN_OK);
    assert_false(cln_is_file(scratch_path(*state, "new.ply")));
    assert_int_equal(cln_disk_check_new(there, true), CLN_OK);
    assert_int_equal(cln_disk_check_new(there, false), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "--overwrite"));
    cln_clear_error();
    assert_int_equal(cln_disk_check_new(scratch_path(*state, "none/new.ply"), true), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "there is no folder"));
    cln_clear_error();
    assert_int_equal(cln_disk_check_new(scratch_path(*state, "there.ply/new"), true), CLN_OUTPUT);
    cln_clear_error();
    assert_int_equal(cln_disk_check_new("/dev/null", true), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "not a plain file"));
    cln_clear_error();
}

/* A command that looks who trains a run has its lock for a moment; a training keeps it. */
/* Of the starts before, those whose steps are trained anew are dropped, but never the first. */
static void test_starts(void **state)
{
    static const int from[3] = {0, 20, 40};
    static const int kept[4][2] = {/* resumed at, starts then */ {0, 2}, {20, 2}, {30, 3}, {50, 4}};
    static const char *const scenes[2] = {NULL, NULL};
    json_t *before = json_array();

    (void)state;
    for (int i = 0; i < 3; i++)
        json_array_append_new(
            before, json_pack("{s:i, s:s, s:{}}", "step", from[i], "command", "x", "changed"));
    for (int i = 0; i < 4; i++) {
        json_t *all = NULL;

        assert_ok(
            cln_history_add(before, kept[i][0], "now", "then", NULL, NULL, scenes, scenes, &all));
        assert_int_equal(json_array_size(all), kept[i][1]);
        assert_int_equal(json_integer_value(json_object_get(json_array_get(all, 0), "step")), 0);
        assert_string_equal(json_string_value(json_object_get(
                                json_array_get(all, json_array_size(all) - 1), "command")),
                            "now");
        json_decref(all);
    }
    json_decref(before);
}

/* The program that trained up to a step: of starts that left none behind, too. */
static void test_history_programs(void **state)
{
    static const struct {
        const char *history; /* so far; run.json is of "last" */
        int step;
        const char *trained_by; /* NULL: this one, "us" */
    } cases[] = {
        {"[]", 5, "last"},
        {"[{'step':0}]", 5, "last"},
        {"[{'step':0,'program':'us'}]", 5, NULL},
        {"[{'step':0,'program':'a'},{'step':5,'program':'last'}]", 5, "a"}, /* it left no step */
        {"[{'step':0,'program':'a'},{'step':5,'program':'last'}]", 9, "last"},
        {"[{'step':0,'program':'a'},{'step':5,'program':'us'},{'step':7,'program':'last'}]", 7,
         NULL},
        /* the first is of a program that told none */
        {"[{'step':0},{'step':5,'program':'us','changed':{'program':['old','us']}}]", 5, "old"},
        {"[{'step':0},{'step':5,'program':'us'}]", 5, NULL}};
    static const char *const scenes[2] = {NULL, NULL}, *const programs[2] = {"last", "us"};
    cln_config config;

    (void)state;
    assert_ok(cln_config_preset("fast", &config));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        json_t *before = NULL, *all = NULL;
        char text[512];

        snprintf(text, sizeof text, "%s", cases[i].history);
        for (char *c = text; *c; c++)
            *c = *c == '\'' ? '"' : *c;
        before = json_loads(text, 0, NULL);
        assert_non_null(before);
        assert_ok(cln_history_add(before, cases[i].step, "now", "then", &config, &config, scenes,
                                  programs, &all));
        if (cases[i].trained_by)
            assert_string_equal(cln_history_other_program(all), cases[i].trained_by);
        else
            assert_null(cln_history_other_program(all));
        json_decref(before);
        json_decref(all);
    }
}

static void test_hold(void **state)
{
    const char *run = *state, *path = scratch_path(*state, "lock");
    const struct timespec moment = {.tv_nsec = 10000000};
    int ready[2], lock = -1, second = -1, file = -1;
    bool empty = false;
    json_t *running = NULL;
    char byte = 0;
    pid_t child = 0;

    scratch_put(path, "", 0);
    assert_int_equal(pipe(ready), 0);
    child = fork();
    if (child == 0) {
        file = open(path, O_RDONLY);
        if (flock(file, LOCK_SH) == 0 && write(ready[1], "x", 1) == 1)
            nanosleep(&moment, NULL);
        _exit(0);
    }
    assert_true(child > 0);
    close(ready[1]);
    assert_int_equal(read(ready[0], &byte, 1), 1);
    assert_ok(cln_run_hold(run, &lock));
    assert_int_equal(waitpid(child, NULL, 0), child);
    assert_fails(cln_run_hold(run, &second), CLN_OUTPUT, "trains this run");
    running = document(1);
    assert_ok(cln_run_write(run, running));
    json_decref(running);
    assert_fails(cln_run_check(run, false, &empty), CLN_OUTPUT, "trains this run");
    cln_run_release(lock);
    assert_ok(cln_run_hold(run, &second));
    cln_run_release(second);
    close(ready[0]);
}

int test_group_run_folder(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_new_folder, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refuses_foreign, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_run_json, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_in_a_run, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_atomic, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_metrics_last, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_metrics_resume, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_drop_evals, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_metrics_cut, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_metrics_full_disk, scratch_make, scratch_remove),
        cmocka_unit_test(test_starts),
        cmocka_unit_test(test_history_programs),
        cmocka_unit_test_setup_teardown(test_hold, scratch_make, scratch_remove),
        cmocka_unit_test(test_machine),
        cmocka_unit_test(test_view_file_name),
        cmocka_unit_test(test_view_file_names),
        cmocka_unit_test(test_files_on_sticks),
        cmocka_unit_test(test_long_file_names),
        cmocka_unit_test_setup_teardown(test_disk_check, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_names_too_long, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_disk_check_new, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("run_folder", tests, NULL, NULL);
}
