/* Kernel parameters: lists and rows as text (device/tune.h), precedence of sources, fallback to
 * plain ones, parameters kept by a resumed run. The tuner: test_tuner.c. Oracles: literal texts,
 * and digests of runs. */
#include "unit.h"
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "device/tune.h"
#include "pipeline/stages.h"
#include "run_fixture.h"
#include "tests.h"

/* ---- lists ---- */

static void test_lists(void **state)
{
    cln_tune tune, again;
    char text[CLN_TUNE_TEXT];

    (void)state;
    cln_tune_plain(&tune);
    assert_int_equal(tune.vw, 1);
    assert_int_equal(tune.nv, 1);
    assert_int_equal(tune.ls, 1);
    assert_int_equal(tune.wg, 1);
    assert_ok(cln_tune_parse("VW=16,SL=960", &tune));
    assert_int_equal(tune.vw, 16);
    assert_int_equal(tune.sl, 960);
    assert_int_equal(tune.nv, 1); /* parameters not named stay */
    assert_ok(cln_tune_parse("", &tune));
    cln_tune_text(&tune, text);
    assert_memory_equal(text, "VW=16,NV=1,", 11);
    cln_tune_plain(&again);
    assert_ok(cln_tune_parse(text, &again));
    assert_memory_equal(&again, &tune, sizeof tune);
    assert_fails(cln_tune_parse("VX=8", &again), CLN_USAGE, "--tune: 'VX'");
    assert_fails(cln_tune_parse("VW", &again), CLN_USAGE, "CHUNK");
    assert_fails(cln_tune_parse("VW=17", &again), CLN_USAGE, "VW takes 1, 2, 4, 8 or 16");
    assert_fails(cln_tune_parse("VW=3", &again), CLN_USAGE, "'VW=3': VW takes 1, 2, 4, 8 or 16");
    assert_fails(cln_tune_parse("SG=48", &again), CLN_USAGE, "256, 512 or 1024");
    assert_fails(cln_tune_parse("TS=33", &again), CLN_USAGE,
                 "TS takes a whole number from 1 to 32");
    cln_tune_unmet("VW=16,TS=7,SL=960", &(cln_tune){.vw = 8, .ts = 7, .sl = 480}, text);
    assert_string_equal(text, "VW=16 (8 is used), SL=960 (480 is used)");
    cln_tune_unmet("TS=7", &(cln_tune){.ts = 7}, text);
    assert_string_equal(text, "");
    assert_fails(cln_tune_parse("TS=4x", &again), CLN_USAGE, "'TS=4x'");
    assert_fails(cln_tune_parse("TS=", &again), CLN_USAGE, "TS takes");
    assert_fails(cln_tune_parse("TS=99999999999999999999", &again), CLN_USAGE, "TS takes");
}

/* ---- rows ---- */

static const char good[] = "# a comment\n"
                           "\n"
                           "* | * | * | VW=1\n"
                           "  pthread-* |3.?| W32-D3-V32 |VW=2,TS=5   # another\r\n"
                           "pthread-* | * | W64-* | VW=4\n"
                           "Big GPU [[]2] | 5* | * | VW=8"; /* no newline at the end */

static int vw_of(const cln_tune_rows *rows, const char *device, const char *driver,
                 const char *network)
{
    const cln_tune_row *row = cln_tune_rows_find(rows, device, driver, network);
    cln_tune tune;

    cln_tune_plain(&tune);
    if (!row)
        return 0;
    assert_ok(cln_tune_parse(row->list, &tune));
    return tune.vw;
}

static void test_rows(void **state)
{
    cln_tune_rows *rows = NULL;
    const cln_tune_row *row = NULL;

    (void)state;
    assert_int_equal(vw_of(NULL, "a", "b", "c"), 0);
    assert_ok(cln_tune_rows_add("good.txt", good, &rows));
    assert_int_equal(rows->count, 4);
    row = cln_tune_rows_find(rows, "pthread-zen", "3.1", "W32-D3-V32");
    assert_non_null(row);
    assert_string_equal(row->list, "VW=2,TS=5");
    assert_string_equal(row->file, "good.txt");
    assert_int_equal(row->line, 4);
    assert_int_equal(vw_of(rows, "pthread-zen", "3.1", "W32-D3-V16"), 1);
    assert_int_equal(vw_of(rows, "pthread-zen", "3.10", "W32-D3-V32"), 1); /* ? is one character */
    assert_int_equal(vw_of(rows, "pthread-zen", "6", "W64-D8-V256"), 4);
    assert_int_equal(vw_of(rows, "Big GPU [2]", "550.1", "W64-D8-V256"), 8);
    assert_int_equal(vw_of(rows, "  Big GPU [2]  ", "550.1", "W16-D2-V16"), 8); /* padded names */
    assert_int_equal(vw_of(rows, "big gpu [2]", "550.1", "W16-D2-V16"), 1);
    assert_ok(cln_tune_rows_add("more.txt", "* | * | W64-* | VW=16\n", &rows));
    assert_int_equal(vw_of(rows, "pthread-zen", "6", "W64-D8-V256"), 16); /* the last counts */
    assert_int_equal(vw_of(rows, "pthread-zen", "3.1", "W32-D3-V32"), 2);
    cln_tune_rows_free(rows);
    rows = NULL;
    assert_ok(cln_tune_rows_add("none.txt", "* | * | W64-* | VW=16\n", &rows));
    assert_int_equal(vw_of(rows, "pthread-zen", "6", "W32-D3-V32"), 0);
    cln_tune_rows_free(rows);
}

/* Voxels with a decoder take a row for those without, if none names them. */
static void test_decoder_rows(void **state)
{
    cln_tune_rows *rows = NULL;

    (void)state;
    assert_ok(cln_tune_rows_add("a", "* | * | X8x16 | VW=4\n", &rows));
    assert_int_equal(vw_of(rows, "a", "1", "X8x16-D32"), 4);
    assert_int_equal(vw_of(rows, "a", "1", "X8x32-D32"), 0);
    assert_ok(cln_tune_rows_add("b", "* | * | * | VW=1\n", &rows)); /* the last counts */
    assert_int_equal(vw_of(rows, "a", "1", "X8x16-D32"), 1);
    assert_ok(cln_tune_rows_add("c", "* | * | X8x16 | VW=2\n", &rows));
    assert_int_equal(vw_of(rows, "a", "1", "X8x16-D32"), 2);
    assert_ok(cln_tune_rows_add("d", "* | * | X8x16-D32 | VW=8\n", &rows));
    assert_ok(cln_tune_rows_add("e", "* | * | X8x16 | VW=4\n", &rows));
    assert_int_equal(vw_of(rows, "a", "1", "X8x16-D32"), 8);
    assert_int_equal(vw_of(rows, "a", "1", "X8x16"), 4);
    cln_tune_rows_free(rows);
}

/* The sentence names file, line and error. */
static void test_bad_rows(void **state)
{
    static const struct {
        const char *line, *words;
    } bad[] = {
        {"* | * | *", "four parts"},
        {"* | * | * | VW=1 | VW=2", "four parts"},
        {"nonsense", "cl-nascent tune"},
        {"* | | * | VW=1", "empty"},
        {"* | * | * |", "empty"},
        {"* | * | * | XY=3", "'XY' is not a tuning parameter"},
        {"* | * | * | VW=8,TS", "'TS'"},
        {"* | * | * | VW=8 TS=6", "'VW=8 TS=6'"},
        {"* | * | * | VW=many", "VW takes"},
        {"* | * | * | NB=0", "from 1 to 1024"},
        {"* | * | * | CHUNK=65537", "from 16 to 65536"},
        {"* | * | this-is-no-name-of-any-network-at-all | VW=8", "too long"},
    };
    char text[256], where[32];

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        cln_tune_rows *rows = NULL;
        cln_status st = CLN_OK;

        snprintf(text, sizeof text, "# a comment\n* | * | * | VW=1\n%s\n", bad[i].line);
        snprintf(where, sizeof where, "bad.txt: line 3");
        st = cln_tune_rows_add("bad.txt", text, &rows);
        if (!strstr(cln_error_text(), where))
            fail_msg("'%s': no '%s' in: %s", bad[i].line, where, cln_error_text());
        assert_fails(st, CLN_INPUT, bad[i].words);
        cln_tune_rows_free(rows);
    }
}

static void test_rows_of_the_program(void **state)
{
    cln_tune_rows *rows = NULL;

    (void)state;
    assert_ok(cln_tune_rows_shipped(&rows));
    assert_true(rows->count > 0);
    assert_true(strncmp(rows->row[0].file, "data/tune/", 10) == 0);
    cln_tune_rows_free(rows);
}

static void test_put(void **state)
{
    const cln_device_info info = {.name = " Odd|name #3 [x]* ", .driver = "1.2?"};
    const char *path = fixture_path("config/cl-nascent/tune.txt"), *bad = fixture_path("bad.txt");
    cln_tune_rows *rows = NULL;
    cln_tune tune;
    char line[1024], *text = NULL;
    size_t bytes = 0;

    (void)state;
    cln_tune_plain(&tune);
    tune.vw = 4;
    cln_tune_row_text(&info, "W16-D2-V16", &tune, "older", line);
    assert_ok(cln_tune_row_put(path, line)); /* makes the folder and the file */
    assert_ok(cln_tune_row_put(path, "* | * | * | VW=2  # by hand"));
    tune.vw = 8;
    cln_tune_row_text(&info, "W16-D2-V16", &tune, "newer", line);
    assert_ok(cln_tune_row_put(path, line)); /* replaces the first, after the manual row */
    text = scratch_get(path, &bytes);
    assert_null(strstr(text, "older"));
    assert_non_null(strstr(text, "# by hand\n"));
    assert_non_null(strstr(text, "# newer\n"));
    assert_memory_equal(text, "# Tuning rows", 13);
    free(text);
    assert_ok(cln_tune_rows_read(path, &rows));
    assert_int_equal(rows->count, 2);
    assert_int_equal(vw_of(rows, info.name, info.driver, "W16-D2-V16"), 8);
    assert_int_equal(vw_of(rows, info.name, info.driver, "W32-D2-V16"), 2);
    cln_tune_rows_free(rows);

    scratch_put(bad, "* | *\n", 6);
    assert_fails(cln_tune_row_put(bad, line), CLN_INPUT, "bad.txt: line 1");
    text = scratch_get(bad, &bytes);
    assert_string_equal(text, "* | *\n");
    free(text);
}

/* ---- the choice ---- */

static int chosen_vw(const cln_device *device, const char *network, const char *from_words)
{
    cln_tune tune;
    char from[CLN_TUNE_FROM];

    cln_device_tune(device, network, &tune, from);
    if (!strstr(from, from_words))
        fail_msg("'%s' is not in '%s'", from_words, from);
    return tune.vw;
}

/* Precedence: --tune, the user's rows, the program's rows, the class; the first gives all. */
static void test_precedence(void **state)
{
    cln_device device = {.info = {.name = "a", .driver = "1", .type = "cpu"}};
    cln_tune tune;
    char from[CLN_TUNE_FROM];

    (void)state;
    cln_tune_plain(&device.tune);
    device.tune.ts = 7;
    assert_ok(cln_tune_rows_add("user.txt", "a | * | W32-* | VW=2\n", &device.rows[0]));
    assert_ok(cln_tune_rows_add(
        "data/tune/x.txt", "a | * | W?2-* | VW=4,TS=3\na | * | W64-* | VW=8\n", &device.rows[1]));
    assert_int_equal(chosen_vw(&device, "W32-D3-V32", "user.txt, line 1"), 2);
    assert_int_equal(chosen_vw(&device, "W64-D3-V32", "data/tune/x.txt, line 2"), 8);
    assert_int_equal(chosen_vw(&device, "W16-D3-V32", "built-in CPU defaults"), 1);
    cln_device_tune(&device, "W32-D3-V32", &tune, from);
    assert_int_equal(tune.ts, 7); /* the class's, not that of the row that lost */
    snprintf(device.tune_from, sizeof device.tune_from, "--tune");
    device.tune.vw = 16;
    assert_int_equal(chosen_vw(&device, "W32-D3-V32", "--tune"), 16);
    device.tune_from[0] = 0;
    device.tune_exact = true;
    assert_int_equal(chosen_vw(&device, "W32-D3-V32", ""), 16);
    cln_tune_rows_free(device.rows[0]);
    cln_tune_rows_free(device.rows[1]);
}

/* A set whose programs do not build is replaced by the plain one, with a warning; not if exactly
 * this set is asked for, as in tests. */
static void test_plain_comes_last(void **state)
{
    cln_device_desc desc = fixture_device();
    const cln_config config = fixture_config();
    cln_device *device = NULL;
    cln_pipeline p;
    int warnings = 0;

    NEED_DEVICE();
    desc.kernel_dir =
        fixture_kernels_with("novectors", "#if VW > 1\n#error no vectors here\n#endif");
    desc.tune = "VW=4";
    assert_ok(cln_device_open(&desc, &device));
    cln_log_set_sink(scratch_count_warnings, &warnings);
    assert_ok(cln_pipeline_create(device, &config, &(cln_pipeline_facts){.space = &cln_space_unit},
                                  CLN_PROGRAMS_ALL, &p));
    cln_log_set_sink(fixture_no_log, NULL);
    assert_true(warnings > 0);
    assert_int_equal(p.tune.vw, 1);
    assert_non_null(strstr(p.tune_from, "plain"));
    cln_pipeline_free(&p);
    device->tune_exact = true;
    assert_fails(cln_pipeline_create(device, &config,
                                     &(cln_pipeline_facts){.space = &cln_space_unit},
                                     CLN_PROGRAMS_ALL, &p),
                 CLN_BUILD, "scan.cl");
    cln_device_close(device);
}

static void put_kernel(const char *file, const char *text)
{
    scratch_put(fixture_path(file), text, strlen(text));
}

/* A kernel file's first line names headers; each header's own come before it, each once. */
static void test_needs(void **state)
{
    cln_device_desc desc = fixture_device();
    cln_device *device = NULL;
    cln_program program;

    NEED_DEVICE();
    assert_ok(cln_make_dirs(fixture_path("needs")));
    put_kernel("needs/first.h", "/* needs: second */\n#define FIRST 1\n");
    put_kernel("needs/second.h", "/* needs: first */\n#define SECOND (FIRST + VW)\n#if FIRST != 1\n"
                                 "#error first.h is missing\n#endif\n");
    put_kernel("needs/probe.cl", "/* needs: second first */\n"
                                 "__kernel void probe(__global int *out) { out[0] = SECOND; }\n");
    put_kernel("needs/lost.cl", "/* needs: nowhere */\n__kernel void lost(void) {}\n");
    desc.kernel_dir = fixture_path("needs");
    assert_ok(cln_device_open(&desc, &device));
    assert_ok(cln_program_build(device, "probe", NULL, &program));
    cln_program_free(&program);
    assert_fails(cln_program_build(device, "lost", NULL, &program), CLN_INTERNAL, "nowhere.h");
    cln_device_close(device);
}

/* ---- runs ---- */

static cln_status train(const char *run, bool resume, const char *tune, const char *file,
                        fixture_stop *stop)
{
    fixture_stop none = {0};
    cln_train_result result;
    const cln_settings settings = {.config = fixture_config(), .preset = "fast"};
    cln_train_desc desc = {.scene = resume ? NULL : fixture_path("scene"),
                           .run = fixture_path(run),
                           .resume = resume,
                           .skip_selftest = true,
                           .settings = &settings,
                           .device = fixture_device(),
                           .callbacks = fixture_callbacks(stop ? stop : &none)};

    desc.device.tune = tune;
    desc.device.tune_file = file;
    return cln_train(&desc, &result);
}

/* The text at `key` of a run's run.json begins with this. */
static void assert_recorded(const char *run, const char *key, const char *begin)
{
    char path[96];
    json_t *document = NULL;
    const char *text = NULL;

    snprintf(path, sizeof path, "%s/run.json", run);
    document = fixture_json(path);
    text = json_string_value(fixture_at(document, key));
    if (!text || !strstr(text, begin))
        fail_msg("%s: %s is '%s', has no '%s'", run, key, text ? text : "", begin);
    json_decref(document);
}

/* Slices of other lengths are summed in another order: the last bits show whose row was used. */
static void test_a_run_keeps_its_parameters(void **state)
{
    const char *first = fixture_path("first.txt"), *second = fixture_path("second.txt");
    static const char rows[2][64] = {"* | * | W16-D2-V16 | VW=4,NV=1,TS=4,NB=4,SL=8\n",
                                     "* | * | W16-D2-V16 | VW=4,NV=1,TS=4,NB=64,SL=640\n"};
    fixture_stop stop = {.signal = SIGINT, .step = STEPS / 2};

    NEED_DEVICE();
    scratch_put(first, rows[0], strlen(rows[0]));
    scratch_put(second, rows[1], strlen(rows[1]));
    assert_ok(train("one", false, NULL, first, NULL));
    assert_ok(train("two", false, NULL, second, NULL));
    assert_true(fixture_digest("one") != fixture_digest("two")); /* else this test is void */
    assert_recorded("one", "tune", "SL=8,");
    assert_recorded("one", "tune_from", "first.txt, line 1");

    assert_fails(train("stopped", false, NULL, first, &stop), CLN_SIGINT, "signal");
    assert_ok(train("stopped", true, NULL, second, NULL));
    assert_true(fixture_digest("stopped") == fixture_digest("one"));
    assert_recorded("stopped", "tune", "SL=8,");
    assert_recorded("stopped", "tune_from", "first.txt, line 1");

    stop = (fixture_stop){.signal = SIGINT, .step = STEPS / 2};
    assert_fails(train("told", false, NULL, first, &stop), CLN_SIGINT, "signal");
    assert_ok(train("told", true, "VW=4,NV=1,TS=4,NB=64,SL=640", first, NULL));
    assert_true(fixture_digest("told") != fixture_digest("one"));
    assert_recorded("told", "tune", "SL=640,");
    assert_recorded("told", "tune_from", "--tune");

    assert_fails(train("none", false, NULL, fixture_path("nowhere.txt"), NULL), CLN_INPUT,
                 "nowhere.txt");
    assert_false(cln_is_dir(fixture_path("none")));
}

int test_group_tune(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lists),
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_decoder_rows),
        cmocka_unit_test(test_bad_rows),
        cmocka_unit_test(test_rows_of_the_program),
        cmocka_unit_test(test_put),
        cmocka_unit_test(test_precedence),
        cmocka_unit_test(test_plain_comes_last),
        cmocka_unit_test(test_needs),
        cmocka_unit_test(test_a_run_keeps_its_parameters),
    };

    return cmocka_run_group_tests_name("tune", tests, fixture_setup, fixture_teardown);
}
