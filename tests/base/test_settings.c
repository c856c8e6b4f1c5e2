/* Settings by name and text behind the opaque type (cl_nascent.h, base/settings.h): every setting
 * through set and get, refused values, extending a budget, and warnings of settings without effect.
 * Oracle: the rows of config.h, and literal sentences. */
#include "unit.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "base/settings.h"
#include "comma.h"
#include "scratch.h"
#include "tests.h"

static cln_settings *create(const char *preset)
{
    cln_settings *settings = NULL;

    assert_int_equal(cln_settings_create(preset, &settings), CLN_OK);
    assert_non_null(settings);
    return settings;
}

static void set(cln_settings *settings, const char *name, const char *value)
{
    if (cln_settings_set(settings, name, value) != CLN_OK)
        fail_msg("%s", cln_error_text());
}

static void assert_set_refused(cln_settings *settings, const char *name, const char *value,
                               const char *words)
{
    const cln_settings before = *settings;
    char copy[256], *save = NULL;

    assert_int_equal(cln_settings_set(settings, name, value), CLN_USAGE);
    snprintf(copy, sizeof copy, "%s", words);
    for (char *word = strtok_r(copy, "|", &save); word; word = strtok_r(NULL, "|", &save)) {
        if (!strstr(cln_error_text(), word))
            fail_msg("'%s' is not in '%s'", word, cln_error_text());
    }
    assert_memory_equal(settings, &before, sizeof before);
    cln_clear_error();
}

/* Sets every setting of one preset, as text, in another; descriptions must match the rows. */
static void test_every_setting(void **state)
{
    cln_settings *from = create("paper"), *to = create(NULL);
    cln_setting_info info;
    int count = 0;

    (void)state;
    for (; cln_setting_describe(count, &info); count++) {
        const cln_config_row *row = cln_config_find(info.name);
        char text[CLN_SETTING_BYTES], back[CLN_SETTING_BYTES];

        assert_non_null(row);
        assert_ptr_equal(info.help, row->help);
        assert_true(info.min == row->min && info.max == row->max);
        assert_int_equal(info.words != NULL, strcmp(info.type, "word") == 0);
        assert_false(cln_settings_given(to, row));
        assert_int_equal(cln_settings_get(from, info.name, text, sizeof text), CLN_OK);
        set(to, info.name, text);
        assert_true(cln_settings_given(to, row));
        assert_int_equal(
            cln_settings_get(to, info.alias ? info.alias : info.name, back, sizeof back), CLN_OK);
        assert_string_equal(text, back);
    }
    assert_int_equal(count, cln_config_row_count);
    assert_false(cln_setting_describe(-1, &info));
    assert_null(cln_config_differs(&from->config, &to->config, 0));
    assert_int_equal(cln_settings_check(to), CLN_OK);
    cln_settings_free(from);
    cln_settings_free(to);
    cln_settings_free(NULL);
}

static void test_refused(void **state)
{
    cln_settings *settings = create("fast"), *none = settings;
    char small[2];

    (void)state;
    assert_set_refused(settings, "widht", "64", "'widht'|no such setting|'width'");
    assert_set_refused(settings, "width", "3", "--width|'3'|16 to 256");
    assert_set_refused(settings, "skip", "maybe", "--skip|yes");
    assert_set_refused(settings, "steps", "+5", "--steps +5|only a run");
    assert_int_equal(cln_settings_get(settings, "seed", small, sizeof small), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "3 bytes"));
    cln_clear_error();
    set(settings, "lr-final", "0.5");
    assert_int_equal(cln_settings_check(settings), CLN_USAGE);
    cln_clear_error();
    assert_int_equal(cln_settings_create(NULL, &none), CLN_OK);
    set(none, "encoding", "grid");
    assert_int_equal(cln_settings_check(none), CLN_USAGE); /* at voxels' learning rate */
    assert_non_null(strstr(cln_error_text(), "--preset fast"));
    cln_clear_error();
    set(none, "lr", "0.01");
    assert_int_equal(cln_settings_check(none), CLN_OK);
    cln_settings_free(none);
    none = create(NULL); /* of 100 x 100 pixels, 16,384 rays a step */
    assert_int_equal(cln_settings_epochs(none, 1e4), 24576);
    assert_int_equal(cln_settings_epochs(none, 1e9), 30);
    set(none, "steps", "120"); /* epochs are no budget then */
    assert_int_equal(cln_settings_epochs(none, 1e4), 30);
    set(none, "steps", "0");
    set(none, "time-limit", "60");
    assert_int_equal(cln_settings_epochs(none, 1e4), 30);
    set(none, "epochs", "30");
    assert_int_equal(cln_settings_epochs(none, 1e4), 30);
    cln_settings_free(none);
    assert_int_equal(cln_settings_epochs(settings, 1e4), 30); /* networks */
    assert_int_equal(cln_settings_create("slow", &none), CLN_USAGE);
    assert_null(none);
    cln_clear_error();
    assert_int_equal(cln_settings_of_run("/nonexistent", &none), CLN_INPUT);
    assert_null(none);
    cln_clear_error();
    assert_int_equal(cln_settings_of_run(NULL, &none), CLN_USAGE);
    assert_null(none);
    cln_clear_error();
    assert_set_refused(settings, "tree-from", "caf\xe9", "--tree-from|not UTF-8|run.json");
    assert_set_refused(settings, NULL, "64", "name is missing");
    assert_set_refused(settings, "rays", NULL, "value is missing");
    assert_int_equal(cln_settings_get(settings, NULL, small, sizeof small), CLN_USAGE);
    cln_clear_error();
    cln_settings_free(settings);
}

/* A preset's own growth gives way to levels that are given; one that was given does not. */
static void test_levels(void **state)
{
    cln_settings *settings = create(NULL);

    (void)state;
    assert_string_equal(settings->config.level_at, "3:0.01,4:0.03,5:0.08");
    set(settings, "start-level", "4");
    assert_string_equal(settings->config.level_at, "5:0.08");
    assert_int_equal(cln_settings_check(settings), CLN_OK);
    set(settings, "start-level", "5");
    assert_string_equal(settings->config.level_at, "");
    assert_int_equal(cln_settings_check(settings), CLN_OK);
    set(settings, "start-level", "2");
    set(settings, "max-level", "3");
    assert_string_equal(settings->config.level_at, "3:0.01");
    assert_int_equal(cln_settings_check(settings), CLN_OK);
    set(settings, "adaptive", "no"); /* then it limits nothing */
    assert_string_equal(settings->config.level_at, "3:0.01,4:0.03,5:0.08");
    set(settings, "adaptive", "yes");
    set(settings, "level-at", "3:0.1,4:0.2");
    set(settings, "start-level", "3");
    assert_string_equal(settings->config.level_at, "3:0.1,4:0.2");
    assert_int_equal(cln_settings_check(settings), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "--start-level 3"));
    cln_clear_error();
    cln_settings_free(settings);
    settings = create(NULL);
    settings->preset[0] = 0; /* of a run that is resumed */
    set(settings, "start-level", "4");
    assert_string_equal(settings->config.level_at, "3:0.01,4:0.03,5:0.08");
    cln_settings_free(settings);
}

static void test_extend_in_other_locale(void **state)
{
    cln_settings *settings = NULL;
    cln_status st = CLN_OK;

    (void)state;
    comma_locale_begin();
    settings = create("fast");
    set(settings, "time-limit", "60.5");
    settings->base = settings->config;
    settings->preset[0] = 0;
    st = cln_settings_set(settings, "time-limit", "+0.25");
    comma_locale_end();
    assert_int_equal(st, CLN_OK);
    assert_true(settings->config.time_limit == 60.75);
    cln_settings_free(settings);
}

/* A sum that no budget can be leaves the settings as they are. */
static void test_extend_too_much(void **state)
{
    cln_settings *settings = create("fast");

    (void)state;
    set(settings, "time-limit", "60");
    set(settings, "steps", "100");
    memset(settings->given, 0, sizeof settings->given);
    settings->base = settings->config;
    settings->used.time_limit = 60;
    settings->used.steps = 100;
    settings->preset[0] = 0;
    assert_int_equal(cln_settings_set(settings, "steps", "+2000000000"), CLN_USAGE);
    cln_clear_error();
    assert_true(settings->config.time_limit == 60);
    assert_int_equal(settings->config.steps, 100);
    set(settings, "steps", "+10");
    assert_int_equal(settings->config.steps, 110);
    assert_true(settings->config.time_limit == 0);
    cln_settings_free(settings);
}

/* "+N" counts from the run's own budget, however often it is given. */
static void test_extend(void **state)
{
    cln_settings *settings = create("fast");

    (void)state;
    set(settings, "steps", "100");
    set(settings, "time-limit", "60");
    settings->base = settings->config; /* as of a run */
    settings->preset[0] = 0;
    set(settings, "steps", "+20");
    set(settings, "steps", "+50");
    set(settings, "time-limit", "+2m");
    assert_int_equal(settings->config.steps, 150);
    assert_true(settings->config.time_limit == 180);
    settings->base.steps = 0;
    assert_set_refused(settings, "steps", "+5", "--steps +5|no such budget");
    settings->used.steps = 320; /* without such a budget: from where the run ended */
    settings->used.time_limit = 60;
    settings->config.steps = 0;
    settings->config.time_limit = 60; /* a used-up budget is dropped */
    memset(settings->given, 0, sizeof settings->given);
    set(settings, "steps", "+5");
    assert_int_equal(settings->config.steps, 325);
    assert_true(settings->config.time_limit == 0);
    settings->base.steps = 300; /* lowered below what was trained: from there, too */
    set(settings, "steps", "+5");
    assert_int_equal(settings->config.steps, 325);
    settings->config.time_limit = settings->base.time_limit = 60; /* dropped beside an own budget */
    set(settings, "steps", "+5");
    assert_int_equal(settings->config.steps, 325);
    assert_true(settings->config.time_limit == 0);
    settings->base.time_limit = 60; /* the last step ended after it */
    settings->used.time_limit = 61;
    set(settings, "time-limit", "+10");
    assert_true(settings->config.time_limit == 70);
    settings->used.time_limit = 600;
    set(settings, "time-limit", "+10");
    assert_true(settings->config.time_limit == 610);
    assert_set_refused(settings, "lr", "+x", "--lr|'+x'");
    assert_set_refused(settings, "steps", "+0", "--steps +0|adds nothing");
    cln_settings_free(settings);
}

/* A budget that is given beside "+N" counts, used up or not, whichever is given first. */
static void test_extend_beside_given(void **state)
{
    (void)state;
    for (int first = 0; first < 2; first++) {
        cln_settings *settings = create("fast");

        settings->preset[0] = 0; /* as of a run */
        settings->base.steps = settings->config.steps = 100;
        settings->used.steps = 100;
        settings->used.time_limit = 90;
        if (first)
            set(settings, "time-limit", "60");
        set(settings, "steps", "+5");
        if (!first)
            set(settings, "time-limit", "60");
        assert_int_equal(settings->config.steps, 105);
        assert_true(settings->config.time_limit == 60);
        cln_settings_free(settings);
    }
}

/* "+N" of a budget that another one ended before: N more from there, not all that was left, too. */
static void test_extend_after_other(void **state)
{
    cln_settings *settings = create("fast");

    (void)state;
    settings->preset[0] = 0; /* as of a run */
    settings->base.steps = settings->config.steps = 1000;
    settings->base.time_limit = settings->config.time_limit = 600;
    settings->used.steps = 1000;
    settings->used.time_limit = 100;
    set(settings, "time-limit", "+60");
    assert_true(settings->config.time_limit == 160);
    assert_int_equal(settings->config.steps, 0);
    settings->used.steps = 400; /* stopped by a signal: nothing is used up */
    set(settings, "time-limit", "+60");
    assert_true(settings->config.time_limit == 660);
    settings->used.time_limit = 601;
    settings->config.steps = 1000;
    memset(settings->given, 0, sizeof settings->given);
    set(settings, "steps", "+50");
    assert_int_equal(settings->config.steps, 450);
    cln_settings_free(settings);
}

/* Epochs, too; they are a run's budget only if it has no other. */
static void test_extend_epochs(void **state)
{
    cln_settings *settings = create("fast");

    (void)state;
    settings->preset[0] = 0; /* as of a run */
    set(settings, "epochs", "+5");
    assert_int_equal(settings->config.epochs, 35);
    settings->used.epochs = 30;
    set(settings, "epochs", "+5");
    assert_int_equal(settings->config.epochs, 35);
    settings->used.epochs = 31; /* its last step ended a little beyond the 30 */
    set(settings, "epochs", "+5");
    assert_int_equal(settings->config.epochs, 35);
    settings->used.epochs = 30;
    settings->base.epochs = 2; /* lowered below what was trained */
    set(settings, "epochs", "+5");
    assert_int_equal(settings->config.epochs, 35);
    settings->base.steps = settings->config.steps = 100;
    settings->used.steps = 100;
    settings->used.epochs = 7;
    set(settings, "epochs", "+5");
    assert_int_equal(settings->config.epochs, 12);
    assert_int_equal(settings->config.steps, 0); /* used up, so it is dropped */
    settings->used.epochs = 0;                   /* a run from before they were recorded */
    assert_set_refused(settings, "epochs", "+5", "--epochs +5|no such budget");
    cln_settings_free(settings);
}

/* ---- without effect ---- */

static void collect(cln_log_level level, const char *line, void *user)
{
    char *text = user;
    const size_t used = strlen(text);

    assert_int_equal(level, CLN_LOG_WARN);
    snprintf(text + used, 4096 - used, "%s\n", line);
}

/* The warnings of a preset with "name=value name=value ...". */
static const char *warnings_with(const char *preset, const char *given,
                                 const cln_settings_facts *facts)
{
    static char text[4096];
    cln_settings *settings = create(preset);
    char copy[512], *save = NULL;

    snprintf(copy, sizeof copy, "%s", given);
    for (char *one = strtok_r(copy, " ", &save); one; one = strtok_r(NULL, " ", &save)) {
        char *equals = strchr(one, '=');

        *equals = 0;
        set(settings, one, equals + 1);
    }
    text[0] = 0;
    cln_log_set_sink(collect, text);
    cln_settings_warn_idle(settings, facts);
    cln_log_set_sink(NULL, NULL);
    cln_settings_free(settings);
    return text;
}

/* Points of evaluations and checkpoints beyond the budget, in steps or in seconds. */
static void test_points(void **state)
{
    static const struct {
        int steps;
        double seconds;
        const char *eval_at, *save_at;
        int said;
    } cases[] = {
        {100, 0, "100,50s", "", 0}, {100, 0, "101", "", 1},     {100, 0, "5,101,200", "300", 3},
        {0, 60, "60s,1000", "", 0}, {0, 60, "61s", "1m,2m", 2}, {0, 0, "5,9h", "7", 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_config config;
        int said = 0;

        assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
        config.steps = cases[i].steps;
        config.time_limit = cases[i].seconds;
        snprintf(config.eval_at, sizeof config.eval_at, "%s", cases[i].eval_at);
        snprintf(config.save_at, sizeof config.save_at, "%s", cases[i].save_at);
        cln_log_set_sink(scratch_count_warnings, &said);
        cln_settings_warn_points(&config);
        cln_log_set_sink(NULL, NULL);
        if (said != cases[i].said)
            fail_msg("case %zu: %d warnings, not %d", i, said, cases[i].said);
    }
}

static bool no_sights; /* a fact, like the arguments */
static const char *warnings(const char *preset, const char *given, bool resume, bool has_alpha)
{
    return warnings_with(
        preset, given,
        &(cln_settings_facts){
            .resume = resume, .has_alpha = has_alpha, .ranks = 1, .no_sights = no_sights});
}

static void test_idle(void **state)
{
    static const struct {
        const char *given, *idle, *way_out;
        const char *busy; /* the same with the setting that makes it matter */
    } cases[] = {
        {"skip=yes", "--skip", "--depth 6", "skip=yes depth=6"},
        {"skip=yes depth=5", "--skip", "--depth 6", "skip=yes depth=8"},
        {"lr-final=1e-4 lr-schedule=step", "--lr-final", "--lr-schedule exp", "lr-final=1e-4"},
        {"huber-delta=0.2", "--huber-delta", "--loss huber", "huber-delta=0.2 loss=huber"},
        {"bands=3 encoding=grid", "--bands", "--encoding frequency", "bands=3"},
        {"grid-cells=4", "--grid-cells", "--encoding grid", "grid-cells=4 encoding=grid"},
        {"grid-features=8 encoding=voxel", "--grid-features", "--encoding grid",
         "grid-features=8 encoding=grid"},
        {"harmonics=2", "--harmonics", "--preset voxel", "harmonics=2 encoding=voxel"},
        {"smooth-colour=1e-9 encoding=grid", "--smooth-colour", "--preset voxel",
         "smooth-colour=1e-9 encoding=voxel"},
        {"decoder-lr=1 encoding=voxel", "--decoder-lr", "--decoder-width 32",
         "decoder-lr=1 encoding=voxel decoder-width=32"},
        {"harmonics=2 encoding=voxel view-dependence=no", "--harmonics", "--view-dependence",
         "harmonics=2 encoding=voxel"},
        {"width=16 encoding=voxel", "--width", "--preset fast", "width=16"},
        {"rrelu-lower=-0.5 encoding=voxel", "--rrelu-lower", "--preset fast", "rrelu-lower=-0.5"},
        {"view-width=64 view-dependence=no", "--view-width", "--view-dependence", "view-width=64"},
        {"view-l2=1 view-dependence=no", "--view-l2", "--view-dependence", "view-l2=1"},
        {"epochs=3 steps=5", "--epochs", "leave out --steps", "epochs=3 target-psnr=30"},
        {"epochs=3 time-limit=5m", "--epochs", "--time-limit", "epochs=3"},
        {"lists=padded", "--lists", "--stage1 splat", "lists=padded stage1=splat"},
        {"views-per-batch=2", "--views-per-batch", "--stage1 splat",
         "views-per-batch=2 stage1=splat"},
        {"skip-uncovered=yes stage1=splat", "--skip-uncovered", "--stage1 gather",
         "skip-uncovered=no stage1=splat"},
        {"refresh-every=9 rolling-refresh=yes", "--refresh-every", "--no-rolling-refresh",
         "refresh-every=9"},
        {"samples-per-ray=9 allocate=chord", "--samples-per-ray", "--allocate weight",
         "samples-per-ray=9"},
        {"empty-share=0.5 empty-weight=0", "--empty-share", "--empty-weight", "empty-share=0.5"},
        {"occlusion-from=0.5 t-min=0", "--occlusion-from", "--min-transmittance",
         "occlusion-from=0.5"},
        {"holdout-from=1 holdout=0", "--holdout-from", "--holdout 0", "holdout-from=1"},
        {"holdout=4 test-views=x", "--holdout", "--test-views names", "test-views=x"},
        {"cull-max=1 cull=mean", "--cull-max", "--cull guarded", "cull-max=1"},
        {"merge-factor=1 adaptive=no", "--merge-factor", "--adaptive", "merge-factor=1"},
        {"merge-factor=1 encoding=voxel adaptive=yes", "--merge-factor", "do not merge",
         "merge-factor=1"},
        {"max-leaves=9 tree-from=x", "--max-leaves", "--tree-from", "max-leaves=9"},
        {"depth-loss=0.1 stage1=splat", "--depth-loss", "--stage1 gather", "depth-loss=0.1"},
        {"depth-until=0.2 depth-loss=0", "--depth-until", "--depth-loss",
         "depth-until=0.2 depth-loss=0.1"},
        {"level-at= tree-from=x", "--level-at", "--tree-from", "level-at="},
        {"regrow=0.5 tree-from=x", "--regrow", "--tree-from", "regrow=0.5"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *said = warnings("fast", cases[i].given, false, true);
        char begin[64];

        snprintf(begin, sizeof begin, "warning: %s has no effect: ", cases[i].idle);
        if (strncmp(said, begin, strlen(begin)) != 0 || !strstr(said, cases[i].way_out) ||
            strchr(said, '\n') != said + strlen(said) - 1)
            fail_msg("%s: '%s'", cases[i].given, said);
        said = warnings("fast", cases[i].busy, false, true);
        if (*said)
            fail_msg("%s: '%s'", cases[i].busy, said);
    }
    assert_string_equal(warnings("fast", "random-background=yes", false, false), "");
    assert_non_null(strstr(warnings("fast", "opaque-loss=0.1", false, true), "have alpha"));
    assert_string_equal(warnings("fast", "opaque-loss=0.1", false, false), "");
    assert_non_null(strstr(warnings("fast", "alpha-loss=0.1", false, false), "no alpha"));
    assert_string_equal(warnings("fast", "alpha-loss=0.1", false, true), "");
    assert_non_null(
        strstr(warnings("voxel", "harmonics-rise=0.2", false, true), "--harmonics-rise has no"));
    assert_string_equal(warnings("voxel", "harmonics-rise=0.2", false, false), "");
    no_sights = true;
    assert_non_null(strstr(warnings("fast", "depth-loss=0.1", false, false), "name no points"));
    assert_non_null(strstr(warnings("fast", "depth-until=0.2 depth-loss=0.1", false, false),
                           "--depth-until has no effect: the scene's files name no points"));
    no_sights = false;
    assert_non_null(
        strstr(warnings_with("fast", "slab=yes", &(cln_settings_facts){.ranks = 1, .no_box = true}),
               "--slab has no effect: no box in the cube is known"));
    assert_string_equal(warnings_with("fast", "slab=yes", &(cln_settings_facts){.ranks = 1}), "");
    assert_non_null(strstr(
        warnings_with("fast", "seen-by=9", &(cln_settings_facts){.ranks = 1, .few_views = true}),
        "--seen-by has no effect: there are fewer"));
    assert_string_equal(warnings_with("fast", "seen-by=9", &(cln_settings_facts){.ranks = 1}), "");
    assert_non_null(strstr(
        warnings_with("fast", "holdout=4", &(cln_settings_facts){.ranks = 1, .has_splits = true}),
        "--holdout has no effect: the dataset names the splits"));
    assert_string_equal(warnings_with("fast", "holdout=4", &(cln_settings_facts){.ranks = 1}), "");
    assert_non_null(strstr(
        warnings_with("fast", "masks=alpha", &(cln_settings_facts){.ranks = 1, .no_masks = true}),
        "--masks has no effect: no photo has a mask"));
    assert_string_equal(warnings_with("fast", "masks=alpha", &(cln_settings_facts){.ranks = 1}),
                        "");
    for (size_t i = 0; i < 4; i++) {
        static const char *const measured[] = {"target-psnr=20", "eval-at=10", "eval-every=5",
                                               "eval-images=2"};

        assert_non_null(strstr(
            warnings_with("fast", measured[i], &(cln_settings_facts){.ranks = 1, .no_tests = true}),
            "has no effect: the scene has no test view"));
        assert_string_equal(warnings_with("fast", measured[i], &(cln_settings_facts){.ranks = 1}),
                            "");
    }
    assert_non_null(strstr(warnings("fast", "start-level=1", true, true), "--start-level has no"));
    assert_non_null(strstr(
        warnings_with("fast", "level-at=4:0.1", &(cln_settings_facts){.ranks = 1, .grown = true}),
        "--level-at has no effect: the resumed run's tree has grown"));
    assert_non_null(strstr(
        warnings_with("fast", "max-leaves=9", &(cln_settings_facts){.ranks = 1, .frozen = true}),
        "--max-leaves has no effect: the resumed run's tree is past"));
    assert_non_null(strstr(warnings_with("fast", "precrop-steps=9",
                                         &(cln_settings_facts){.ranks = 1, .past_crop = true}),
                           "--precrop-steps has no effect: the resumed run is past"));
    assert_string_equal(warnings_with("fast", "level-at=4:0.1 max-leaves=9 precrop-steps=9",
                                      &(cln_settings_facts){.ranks = 1}),
                        "");
    assert_string_equal(warnings("fast", "start-level=1", false, true), "");
    assert_non_null(strstr(warnings_with("fast", "regrow=0.5",
                                         &(cln_settings_facts){.has_alpha = true, .forward = true}),
                           "--regrow has no effect: nothing grows back"));
    assert_non_null(
        strstr(warnings_with("fast", "slab=yes", &(cln_settings_facts){.ranks = 1, .shell = true}),
               "--slab has no effect: only a cube"));
    assert_non_null(strstr(warnings_with("voxel", "smooth-density-delta=2",
                                         &(cln_settings_facts){.ranks = 1, .shell = true}),
                           "--smooth-density-delta has no effect: in a shell"));
    assert_string_equal(
        warnings_with("voxel", "smooth-density-delta=2", &(cln_settings_facts){.ranks = 1}), "");
    assert_non_null(
        strstr(warnings_with("fast", "exchange=samples", &(cln_settings_facts){.ranks = 1}),
               "--exchange has no effect: a single process"));
    assert_string_equal(
        warnings_with("fast", "exchange=samples slab=yes", &(cln_settings_facts){.ranks = 2}), "");
    /* no warning of a preset's own settings, though the paper's has both a final rate and steps */
    assert_string_equal(warnings("paper", "rays=100", false, false), "");
    assert_string_equal(warnings("nerf", "rays=100", true, false), "");
    assert_string_equal(warnings("kilonerf", "rays=100", true, false), "");
}

int test_group_settings(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_setting),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_levels),
        cmocka_unit_test(test_extend),
        cmocka_unit_test(test_extend_too_much),
        cmocka_unit_test(test_extend_in_other_locale),
        cmocka_unit_test(test_extend_beside_given),
        cmocka_unit_test(test_extend_after_other),
        cmocka_unit_test(test_extend_epochs),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_idle),
    };

    return cmocka_run_group_tests_name("settings", tests, NULL, NULL);
}
