/* The tuner (cln_tune_search): it ends, writes a row that matches, and never times or chooses a set
 * whose kernels compute wrong results; it decides by the timings, as it says. Oracle: kernels made
 * wrong on purpose, for some sets or for all; decisions about made-up timings, by hand. Asserts no
 * speed. */
#include "unit.h"
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "check/tuner.h"
#include "device/tune.h"
#include "run_fixture.h"
#include "tests.h"

/* Appended to lanes.h: makes sums of products slightly wrong. */
#define WRONG "#undef MAD\n#define MAD(a, b, c) (1.001f * fma((a), (b), (c)))\n"

static cln_tune_desc tuner_desc(const char *kernel_dir, const char *tune)
{
    static cln_settings settings; /* outlives the desc */
    cln_tune_desc desc = {.device = fixture_device(), .settings = &settings, .budget = 600};

    settings.config = fixture_config();
    settings.config.batch_samples = 256;
    desc.device.tune = tune;
    if (kernel_dir)
        desc.device.kernel_dir = kernel_dir;
    return desc;
}

/* All sets but those with tiles of 4 samples are made wrong: none of these may be timed or
 * chosen. */
static void test_wrong_sets_are_refused(void **state)
{
    const char *wrong =
        fixture_kernels_with("wrong", "#if defined(TS) && TS != 4\n" WRONG "#endif");
    cln_tune_desc desc = tuner_desc(wrong, "VW=4,NV=1,TS=4,NB=16");
    const char *file = fixture_path("found.txt");
    cln_tune_result r;
    cln_tune_rows *rows = NULL;
    int refused = 0;

    NEED_DEVICE();
    desc.max_tries = 3;
    desc.file = file;
    assert_ok(cln_tune_search(&desc, &r));
    assert_in_range(r.count, 2, 3);
    for (int i = 0; i < r.count; i++) {
        if (strstr(r.tries[i].tune, "TS=4,"))
            continue;
        refused++;
        assert_int_equal(r.tries[i].verdict, CLN_SET_REFUSED);
        assert_true(isnan(r.tries[i].seconds));
        assert_non_null(strstr(r.tries[i].reason, "these networks: "));
    }
    assert_true(refused > 0);
    assert_non_null(strstr(r.tune, "TS=4,"));
    assert_string_equal(r.network, "W16-D2-V16");
    assert_true(r.seconds > 0);
    assert_ok(cln_tune_rows_read(file, &rows)); /* the row matches device and network */
    assert_non_null(cln_tune_rows_find(rows, r.device.name, r.device.driver, r.network));
    assert_string_equal(rows->row[0].list, r.tune);
    cln_tune_rows_free(rows);
    cln_tune_free(&r);
}

/* If its first set is wrong, the tuner starts from the plain one; even the smallest budget ends
 * with a correct set. */
static void test_wrong_start(void **state)
{
    const char *wrong = fixture_kernels_with("wrong", "#if VW > 1\n" WRONG "#endif");
    cln_tune_desc desc = tuner_desc(wrong, "VW=4");
    cln_tune_result r;

    NEED_DEVICE();
    desc.budget = 0.01;
    assert_ok(cln_tune_search(&desc, &r));
    assert_int_equal(r.tries[0].verdict, CLN_SET_REFUSED);
    assert_int_equal(r.tries[1].verdict, CLN_SET_TAKEN);
    assert_int_equal(r.count, 2);
    assert_memory_equal(r.tune, "VW=1,NV=1,LS=1,", 15);
    assert_false(r.complete);
    cln_tune_free(&r);
}

static void test_nothing_is_right(void **state)
{
    const char *wrong = fixture_kernels_with("wrong", WRONG);
    cln_tune_desc desc = tuner_desc(wrong, "VW=4");
    const char *file = fixture_path("never.txt");
    cln_tune_result r;

    NEED_DEVICE();
    desc.file = file;
    assert_fails(cln_tune_search(&desc, &r), CLN_CHECK, "these networks: ");
    assert_false(cln_is_file(file));
}

static void test_tuner_stops(void **state)
{
    fixture_stop stop = {.signal = SIGINT, .pictures = 1};
    cln_tune_desc desc = tuner_desc(NULL, "VW=4");
    const char *file = fixture_path("never.txt");
    cln_tune_result r;

    NEED_DEVICE();
    desc.callbacks = fixture_callbacks(&stop);
    desc.callbacks.train = NULL;
    desc.file = file;
    assert_fails(cln_tune_search(&desc, &r), CLN_SIGINT, "signal");
    assert_false(cln_is_file(file));
}

static int stop_at_fourth(void *user)
{
    int *asked = user;

    return ++*asked >= 4 ? SIGTERM : 0;
}

/* A signal is answered while the kernels of one set are built and checked, not after it. */
static void test_stops_within_a_set(void **state)
{
    int asked = 0;
    cln_tune_desc desc = tuner_desc(NULL, "VW=4");
    cln_tune_result r;

    NEED_DEVICE();
    desc.max_tries = 1;
    desc.callbacks = (cln_callbacks){.interrupted = stop_at_fourth, .user = &asked};
    assert_fails(cln_tune_search(&desc, &r), CLN_SIGTERM, "no row was written");
    assert_in_range(asked, 4, 8);
}

/* ---- decisions ---- */

static char told[512];

static void keep_line(cln_log_level level, const char *line, void *user)
{
    (void)level;
    (void)user;
    snprintf(told, sizeof told, "%s", line);
}

/* Taken exactly if the middle ratio is below 0.98 and at most two pairs are against it, of five or
 * more; otherwise not, or undecided; the log has the reason. */
static void test_decides(void **state)
{
    static const struct {
        double ratios[9];
        int pairs;
        cln_tune_verdict verdict;
        double ratio;
        int slower;
        const char *says;
    } cases[] = {
        {{0.9, 0.97, 0.95, 0.9, 0.96}, 5, CLN_SET_TAKEN, 0.95, 0, "0.95 times|of 5 pairs|: taken"},
        {{0.9, 1.2, 0.9, 1, 0.9}, 5, CLN_SET_TAKEN, 0.9, 2, "not faster in 2 of them: taken"},
        {{0.97, 0.979, 0.9, 0.99, 0.99, 1.1, 1.1, 0.9, 0.9},
         9,
         CLN_SET_TAKEN,
         0.979,
         2,
         "0.98 times|of 9 pairs|: taken"},
        {{0.97, 0.98, 0.9, 0.99, 0.99, 1.1, 1.1, 0.9, 0.9},
         9,
         CLN_SET_SLOWER,
         0.98,
         2,
         "not taken, as it must be 2 % faster"},
        {{0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 1, 1.3, 1.4},
         9,
         CLN_SET_SLOWER,
         0.9,
         3,
         "in 3 of them|not taken, as too many pairs are against it"},
        {{1.2, 1.3, 1.1}, 3, CLN_SET_SLOWER, 1.2, 3, "1.20 times|of 3 pairs|2 % faster"},
        {{0.5, 0.5, 0.5, 0.5}, 4, CLN_SET_UNDECIDED, NAN, 0, "no time is left to time it"},
        {{1.2, 1.2}, 2, CLN_SET_UNDECIDED, NAN, 0, "no time is left to time it"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_tune_try set = {.tune = "VW=4",
                            .seconds = 0.002,
                            .against = 0.004,
                            .ratio = NAN,
                            .verdict = CLN_SET_UNDECIDED};
        char words[128];

        cln_tune_decide(cases[i].ratios, cases[i].pairs, &set);
        assert_int_equal(set.verdict, cases[i].verdict);
        assert_int_equal(set.pairs, set.verdict == CLN_SET_UNDECIDED ? 0 : cases[i].pairs);
        assert_int_equal(set.slower, cases[i].slower);
        assert_true(isnan(cases[i].ratio) ? isnan(set.ratio) : set.ratio == cases[i].ratio);
        cln_log_set_sink(keep_line, NULL);
        cln_tune_tell(&set);
        cln_log_set_sink(fixture_no_log, NULL);
        snprintf(words, sizeof words, "%s", cases[i].says);
        for (char *rest = words, *word; (word = strtok_r(rest, "|", &rest));)
            if (!strstr(told, word))
                fail_msg("'%s' lacks '%s'", told, word);
        assert_memory_equal(told, "VW=4: ", 6);
    }
    cln_log_set_sink(keep_line, NULL);
    cln_tune_tell(&(cln_tune_try){
        .tune = "VW=4", .reason = "given up", .verdict = CLN_SET_UNDECIDED, .ratio = NAN});
    cln_log_set_sink(fixture_no_log, NULL);
    assert_string_equal(told, "VW=4: given up");
}

/* A search decides by its own figures. */
static void test_decides_by_figures(void **state)
{
    cln_tune_desc desc = tuner_desc(NULL, "VW=4");
    cln_tune_result r;
    double gain = 1;
    int taken = 0;

    NEED_DEVICE();
    desc.max_tries = 3;
    assert_ok(cln_tune_search(&desc, &r));
    for (int i = 0; i < r.count; i++) {
        const cln_tune_try *set = &r.tries[i];
        const bool timed = set->pairs > 0;

        assert_true(timed || i == 0 || set->verdict == CLN_SET_UNDECIDED);
        assert_true(timed == (isfinite(set->ratio) != 0));
        assert_in_range(set->slower, 0, set->pairs);
        if (!timed)
            continue;
        assert_true(set->seconds > 0 && set->against > 0);
        assert_int_equal(set->verdict,
                         set->ratio < 0.98 && set->slower <= 2 ? CLN_SET_TAKEN : CLN_SET_SLOWER);
        if (set->verdict == CLN_SET_TAKEN) {
            gain /= set->ratio;
            taken = i;
        }
    }
    assert_int_equal(r.tries[0].verdict, CLN_SET_TAKEN);
    assert_float_equal(r.gain, gain, 1e-9 * gain);
    assert_string_equal(r.tune, r.tries[taken].tune); /* the last one that was taken */
    cln_tune_free(&r);
}

int test_group_tuner(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrong_sets_are_refused), cmocka_unit_test(test_wrong_start),
        cmocka_unit_test(test_nothing_is_right),       cmocka_unit_test(test_tuner_stops),
        cmocka_unit_test(test_stops_within_a_set),     cmocka_unit_test(test_decides),
        cmocka_unit_test(test_decides_by_figures),
    };

    return cmocka_run_group_tests_name("tuner", tests, fixture_setup, fixture_teardown);
}
