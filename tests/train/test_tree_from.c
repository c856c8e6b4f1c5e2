/* --tree-from: a run on another run's tree keeps its leaves regardless of the rows about growth,
 * culling and adaptation, learns, and resumes after an interruption as if there had been none; an
 * unusable tree is refused, and nothing written. */
#include "unit.h"
#include "run_fixture.h"
#include "tests.h"
#include "train/advice.h"

/* Settings of a run on the tree of `run`; enables everything that changes a tree. */
static cln_config config_on(const char *run)
{
    cln_config config = fixture_config();
    const int length = snprintf(config.tree_from, sizeof config.tree_from, "%s", fixture_path(run));

    if (length >= (int)sizeof config.tree_from)
        skip(); /* a temporary folder with a long name */
    config.start_level = 0;
    snprintf(config.level_at, sizeof config.level_at, "1:0.1,2:0.3");
    config.refresh_every = 4;
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0.2;
    config.adaptive = true;
    config.structure_from = 0.1;
    config.structure_every = 0.1;
    config.structure_until = 0.9;
    config.structure_wait = 0;
    config.split_samples = 0;
    return config;
}

/* "[0,8,0,0,0,0,0,0,0]": leaves by level. */
static void assert_levels(const char *run, const char *wanted)
{
    char *text = NULL, *levels = NULL;
    json_t *about = NULL;

    assert_ok(cln_info_run(fixture_path(run), &text));
    about = fixture_parse(text);
    levels = json_dumps(fixture_at(about, "leaves_by_level"), JSON_COMPACT);
    assert_string_equal(levels, wanted);
    free(levels);
    json_decref(about);
}

static void test_keeps_the_tree(void **state)
{
    cln_config config;
    cln_train_result result;
    json_t *run = NULL;

    NEED_DEVICE();
    config = config_on("whole");
    config.width = config.view_width = 32; /* takes only the tree: the network differs */
    config.seed = 7;
    assert_ok(fixture_train("on-whole", false, &config, NULL, &result));
    assert_int_equal(result.leaves, 8);
    assert_levels("on-whole", "[0,8,0,0,0,0,0,0,0]");
    assert_true(result.psnr_test > fixture_constant_psnr() + 1 && result.psnr_test < 60);
    run = fixture_json("on-whole/run.json");
    assert_string_equal(json_string_value(fixture_at(run, "config.tree_from")), config.tree_from);
    json_decref(run);
}

static void count_too_many(cln_log_level level, const char *line, void *user)
{
    *(int *)user += level == CLN_LOG_WARN && strstr(line, "more than --max-leaves") != NULL;
}

/* That a first tree is too large to be split is told, but not of another run's, which stays as it
 * is anyhow. */
static void test_too_many_leaves(void **state)
{
    static const struct {
        bool adaptive, from;
        int leaves;
        bool told;
    } cases[] = {{true, false, 512, true},
                 {true, true, 512, false},
                 {false, false, 512, false},
                 {true, false, 511, false}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_trainer t = {.pipeline = {.leaves = cases[i].leaves}};
        int told = 0;

        t.model.config = fixture_config();
        t.model.config.adaptive = cases[i].adaptive;
        t.model.config.max_leaves = 511;
        snprintf(t.model.config.tree_from, sizeof t.model.config.tree_from, "%s",
                 cases[i].from ? "other" : "");
        cln_log_set_sink(count_too_many, &told);
        cln_advise_first_tree(&t);
        cln_log_set_sink(fixture_no_log, NULL);
        assert_int_equal(told, cases[i].told);
        assert_int_equal(t.said.too_many, cases[i].told);
    }
}

/* A tree culled down to a single leaf of level 1 is not a full tree at any level. */
static void test_keeps_a_culled_tree(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;

    NEED_DEVICE();
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0.2;
    config.refresh_every = 4;
    config.adaptive = false;
    assert_ok(fixture_train("culled", false, &config, NULL, &result));
    assert_levels("culled", "[0,1,0,0,0,0,0,0,0]");
    config = config_on("culled");
    assert_ok(fixture_train("on-culled", false, &config, NULL, &result));
    assert_int_equal(result.leaves, 1);
    assert_levels("on-culled", "[0,1,0,0,0,0,0,0,0]");
}

/* A tree that is deeper than --max-level: it is kept, and so is the setting. */
static void test_keeps_a_deeper_tree(void **state)
{
    cln_config config;
    cln_train_result result;
    json_t *run = NULL;

    NEED_DEVICE();
    config = config_on("whole");
    config.level_at[0] = 0;
    config.max_level = 0;
    config.stage1 = CLN_STAGE1_SPLAT; /* has tables by level */
    assert_ok(fixture_train("on-deeper", false, &config, NULL, &result));
    assert_levels("on-deeper", "[0,8,0,0,0,0,0,0,0]");
    run = fixture_json("on-deeper/run.json");
    assert_int_equal(json_integer_value(fixture_at(run, "config.max_level")), 0);
    json_decref(run);
}

/* With the tree that it would have anyway, and equal settings: the same bits. */
static void test_same_as_its_own(void **state)
{
    cln_config config = fixture_config();
    cln_train_result own, taken;

    NEED_DEVICE();
    config.adaptive = false;
    assert_ok(fixture_train("own", false, &config, NULL, &own));
    snprintf(config.tree_from, sizeof config.tree_from, "%.*s", (int)sizeof config.tree_from - 1,
             fixture_path("own"));
    assert_ok(fixture_train("taken", false, &config, NULL, &taken));
    assert_int_equal(taken.digest, own.digest);
}

static void test_resumed(void **state)
{
    cln_config config;
    fixture_stop stop = {.signal = SIGINT, .step = 13};
    cln_train_result all, part;

    NEED_DEVICE();
    config = config_on("whole");
    assert_ok(fixture_train("straight", false, &config, NULL, &all));
    assert_fails(fixture_train("halted", false, &config, &stop, &part), CLN_SIGINT, "--resume");
    assert_ok(fixture_train("halted", true, &config, NULL, &part));
    assert_int_equal(part.digest, all.digest);
    assert_int_equal(part.leaves, 8);
    config.steps = 2 * STEPS;
    config.tree_from[0] = 0;
    assert_fails(fixture_train("halted", true, &config, NULL, &part), CLN_USAGE, "new run");
}

static void test_refused(void **state)
{
    cln_config config;
    cln_train_result result;

    NEED_DEVICE();
    config = config_on("whole");
    snprintf(config.bbox, sizeof config.bbox, "-2,-2,-2,2,2,2");
    assert_fails(fixture_train("never", false, &config, NULL, &result), CLN_USAGE, "--bbox");
    config = config_on("scene");
    assert_fails(fixture_train("never", false, &config, NULL, &result), CLN_INPUT, "--tree-from");
    assert_false(cln_is_dir(fixture_path("never")));
}

int test_group_tree_from(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keeps_the_tree),
        cmocka_unit_test(test_too_many_leaves),
        cmocka_unit_test(test_keeps_a_culled_tree),
        cmocka_unit_test(test_keeps_a_deeper_tree),
        cmocka_unit_test(test_same_as_its_own),
        cmocka_unit_test(test_resumed),
        cmocka_unit_test(test_refused),
    };

    return cmocka_run_group_tests_name("tree_from", tests, fixture_setup, fixture_teardown);
}
