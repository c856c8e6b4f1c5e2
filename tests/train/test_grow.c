/* When a whole level of voxels comes. Tested: whether its voxels are too fine for the photos
 * (--cell-pixels) does not depend on how far --refine-poses has moved the cameras, so that a
 * resumed run grows as one without interruption; which leaves are at --max-level, in a shell space,
 * too, whose tree is one level deeper; how long a level and a decision wait; how many leaves are
 * foreseen; what is said if no decision came. */
#include "unit.h"
#include "tests.h"
#include "near.h"
#include "base/log.h"
#include "scene/motion.h"
#include "train/advice.h"
#include "train/grow.h"
#include "train/measure.h"
#include "train/refine.h"
#include "train/refresh.h"
#include "trainer_fixture.h"

/* Settings under which level 2 comes at step 10, if its voxels have at least so many pixels. */
static cln_config settings(double cell_pixels)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset("voxel", &config));
    config.adaptive = false;
    config.start_level = 1;
    snprintf(config.level_at, sizeof config.level_at, "2:0");
    config.cell_pixels = cell_pixels;
    config.refine_poses = true;
    config.cull_after = 0;
    config.refresh_every = 10;
    config.rays = 96;
    config.batch_samples = 4096;
    config.steps = STEPS;
    assert_ok(cln_config_check(&config));
    return config;
}

/* Whether it grows with cameras `away` scene units farther from what they show, as they moved
 * before the start (a resumed run) or after it; *cell, if wanted: pixels of a voxel by the given
 * poses. */
static bool grows(double cell_pixels, float away, bool resumed, double *cell)
{
    const cln_config config = settings(cell_pixels);
    cln_trainer t;
    bool due = false;
    double pixel = 0;

    open_trainer(&config, &t);
    if (cell) {
        assert_ok(cln_scene_pixel_width(t.scene, NULL, &t.model.space, &pixel));
        *cell = 2 * 0.25 / config.grid_cells / pixel;
    }
    assert_ok(cln_alloc(&t.model.motions, TRAIN_VIEWS, sizeof *t.model.motions, "test"));
    t.model.motion_views = TRAIN_VIEWS;
    for (int i = 0; i < TRAIN_VIEWS && resumed; i++)
        t.model.motions[i][5] = -away;
    assert_ok(cln_refine_start(&t));
    for (int i = 0; i < TRAIN_VIEWS && !resumed; i++) {
        cln_camera *c = &cln_scene_training_view(t.scene, i)->camera;

        cln_motion_apply(c->c2w, (const double[CLN_MOTION]){[5] = -away}, c->c2w);
    }
    t.model.step = 9;
    assert_ok(cln_grow_due(&t, 0.5, &due));
    assert_false(due);
    t.model.step = 10;
    assert_ok(cln_grow_due(&t, 0.5, &due));
    cln_refine_free(&t.refine);
    close_trainer(&t);
    return due;
}

static void test_refined(void **state)
{
    double cell = 0;

    NEED_DEVICE();
    assert_true(grows(0, 0, false, &cell));
    for (int resumed = 0; resumed < 2; resumed++) { /* 2 of 4 units farther, or nearer */
        assert_true(grows(0.9 * cell, 2, resumed, NULL));
        assert_false(grows(1.1 * cell, -2, resumed, NULL));
    }
}

/* A level waits for two --cull-after and a refresh after the one before. */
static void test_waits(void **state)
{
    cln_config config = settings(0);
    bool due = false;
    cln_trainer t;

    NEED_DEVICE();
    config.cull_after = 8;
    open_trainer(&config, &t);
    t.model.growth_step = 4;
    for (t.model.step = 5; t.model.step < 4 + 2 * 8 + 10; t.model.step++) {
        assert_ok(cln_grow_due(&t, 0.5, &due));
        assert_false(due);
    }
    assert_ok(cln_grow_due(&t, 0.5, &due));
    assert_true(due);
    close_trainer(&t);
}

static void keep_text(cln_log_level level, const char *line, void *user)
{
    (void)level;
    snprintf(user, 512, "%s", line);
}

/* Where whole levels end, single leaves are promised while there is time for them alone. */
static void test_ends(void **state)
{
    cln_config config = settings(0);

    NEED_DEVICE();
    config.adaptive = true;
    config.max_leaves = 16;
    for (int late = 0; late < 2; late++) {
        char text[512] = "";
        bool due = false;
        cln_trainer t;

        open_trainer(&config, &t);
        t.model.step = 10;
        cln_log_to(CLN_LOG_INFO, keep_text, text);
        assert_ok(cln_grow_due(&t, config.structure_until + (late ? 0.01 : -0.01), &due));
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        assert_false(due);
        assert_non_null(strstr(text, "whole levels end at level 1, with 8 leaves"));
        assert_int_equal(!strstr(text, "; single leaves split from --structure-from on"), late);
        close_trainer(&t);
    }
}

/* The first decision waits for one --cull-after and a refresh, and any for a level that is due, but
 * not for one that cannot come. */
static void test_awaited(void **state)
{
    cln_trainer t;

    (void)state;
    memset(&t, 0, sizeof t);
    t.model.config = settings(0);
    t.model.config.cull_after = 8;
    t.model.level = 1;
    t.model.growth_step = 100;
    t.model.step = 118;
    assert_true(cln_grow_awaited(&t, 0.5)); /* level 2 */
    t.next_level.no_room = true;
    assert_false(cln_grow_awaited(&t, 0.5));
    t.model.step = 117;
    assert_true(cln_grow_awaited(&t, 0.5));
    t.model.decisions = 1;
    assert_false(cln_grow_awaited(&t, 0.5));
    t.next_level.no_room = false;
    assert_true(cln_grow_awaited(&t, 0.5));
    t.next_level.finest = true;
    assert_false(cln_grow_awaited(&t, 0.5));
    t.next_level.finest = false;
    t.model.level = 2;
    assert_false(cln_grow_awaited(&t, 0.5));
}

/* A trainer without a device, of leaves of level 2 (in a shell, its core has those of level 3), of
 * which `parts` of 64 are split. */
static void plant(bool shell, int max_level, int parts, cln_trainer *t)
{
    cln_config config = settings(1e-6);
    const cln_scene_desc scene = {.path = fixture_path("scene"), .config = &config};
    cln_octree_change change;
    uint8_t marks[128];

    memset(t, 0, sizeof *t);
    config.start_level = 2;
    config.max_level = max_level;
    assert_ok(cln_scene_load(&scene, &t->scene));
    assert_ok(shell ? cln_model_create_shell(&config, &t->model)
                    : cln_model_create(&config, &t->model));
    t->model.space = t->scene->space;
    t->model.space.shell = shell;
    assert_int_equal(t->model.tree.leaf_count, shell ? 64 + 24 : 64);
    for (size_t i = 0; i < sizeof marks; i++)
        marks[i] = (uint8_t)((i % 64 + 1) * (size_t)parts / 64 > i % 64 * (size_t)parts / 64);
    if (parts > 0) {
        assert_ok(cln_octree_split(&t->model.tree, marks, &change));
        cln_octree_change_free(&change);
    }
}

static void uproot(cln_trainer *t)
{
    cln_model_free(&t->model);
    cln_scene_free(t->scene);
}

/* The share of leaves that can be split; every second one is, if so wanted. */
static double share_of(bool shell, int max_level, bool split)
{
    double share = 0;
    cln_trainer t;

    plant(shell, max_level, split ? 32 : 0, &t);
    assert_ok(cln_measure_can_split(&t, t.model.level, &share));
    uproot(&t);
    return share;
}

/* Where no decision came, more steps are proposed, unless they would split fewer leaves than one
 * of 20. */
static void test_none_came(void **state)
{
    static const struct {
        int parts;
        bool few;
    } cases[] = {{0, false}, {32, false}, {48, true}, {64, true}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512] = "";
        double share = 0;
        cln_trainer t;

        plant(false, 3, cases[i].parts, &t);
        t.model.config.adaptive = true;
        t.model.config.level_at[0] = 0;
        t.model.config.structure_from = 0.25;
        t.model.config.structure_until = 0.5;
        t.steps = 100;
        t.model.step = t.model.growth_step = 50;
        t.pipeline.leaves = t.model.tree.leaf_count;
        assert_ok(cln_measure_can_split(&t, t.model.level, &share));
        cln_log_to(CLN_LOG_INFO, keep_text, text);
        cln_advise_none_came(&t, 0.5);
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        print_message("    %.3f of the leaves: %s\n", share, text);
        assert_int_equal(share < 0.05, cases[i].few);
        assert_true(!strstr(text, " in more steps: ") == !cases[i].few);
        assert_true(!strstr(text, "no single leaf was split: of 100 steps") == cases[i].few);
        uproot(&t);
    }
}

/* Whether a further whole level comes first depends on how many leaves it leaves: both numbers of
 * steps are told. Not where more steps than that go by until pixels are means, without which voxels
 * would be too fine. */
static void test_two_numbers(void **state)
{
    static const int most[] = {1000000, 4000, 4000}; /* 3 * 4 * 256 are less, 3 * 4 * 512 more */

    (void)state;
    for (int i = 0; i < 3; i++) {
        char text[512] = "";
        const char *more = NULL;
        uint64_t first[TRAIN_VIEWS + 1] = {[TRAIN_VIEWS] = 100000};
        double share = 1;
        cln_trainer t;

        plant(false, 5, 0, &t);
        t.model.config.adaptive = true;
        t.model.config.max_leaves = most[i];
        t.model.config.cull_after = t.model.config.refresh_every = 16;
        strcpy(t.model.config.level_at, "3:0.1,4:0.3");
        t.model.config.structure_from = 0.05;
        t.model.config.structure_until = 0.5;
        t.steps = 60;
        t.model.step = t.model.growth_step = 30;
        t.pipeline.leaves = t.model.tree.leaf_count;
        for (; i == 2 && share >= 0.05; t.model.config.cell_pixels *= 1.5)
            assert_ok(cln_measure_can_split(&t, 2, &share));
        t.pipeline.averaged = i == 2;
        t.model.config.antialias = 8; /* two levels and a half */
        t.batch.first = first;
        t.batch.train_views = TRAIN_VIEWS;
        t.model.drawn = 30 * 256;
        cln_log_to(CLN_LOG_INFO, keep_text, text);
        cln_advise_none_came(&t, 0.5);
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        print_message("    %s\n", text);
        more = strstr(text, " or more");
        assert_non_null(more);
        assert_true(!strstr(more, ", or with ") == (i != 1));
        if (i == 1) /* 2 (16 + 16) + 16 steps are half of it */
            assert_non_null(strstr(more, ", or with 170 if no further whole level comes"));
        uproot(&t);
    }
}

static void test_can_split(void **state)
{
    (void)state;
    assert_true(share_of(false, 3, false) > 0.8);
    assert_true(share_of(true, 3, false) > 0.8); /* the core's, too */
    assert_true(share_of(false, 2, false) == 0);
    assert_true(share_of(true, 2, false) == 0);
    assert_in_range((int)(288 * share_of(false, 3, true) + 0.5), 20, 32); /* not those of level 3 */
    assert_true(share_of(false, 4, true) > 0.8);
}

/* How many leaves, of level 2, may not be split because voxels half as wide were too fine: so many
 * `times` as wide would be fine enough. */
static int too_fine(bool shell, int max_level, double times)
{
    cln_config config = settings(1e6);
    cln_leaf_measure *measures = NULL;
    uint8_t *children = NULL;
    cln_trainer t;
    double pixel = 0;
    int fine = 0;

    config.start_level = 2;
    config.max_level = max_level;
    config.adaptive = true;
    config.split_samples = 0;
    open_trainer(&config, &t);
    assert_ok(cln_scene_pixel_width(t.scene, NULL, &t.model.space, &pixel));
    t.model.config.cell_pixels = times * 0.25 / config.grid_cells / pixel;
    t.model.space.shell = shell;
    t.model.sum_rays = 1;
    assert_ok(cln_refresh_all(&t));
    assert_ok(cln_measure_leaves(&t, 0, &measures, &children, &fine));
    for (int s = 0; s < t.model.tree.leaf_count; s++)
        fine -= !measures[s].may_split;
    assert_int_equal(fine, 0); /* and no others */
    for (int s = 0; s < t.model.tree.leaf_count; s++)
        fine += !measures[s].may_split;
    free(measures);
    free(children);
    close_trainer(&t);
    return fine;
}

/* Leaves at --max-level are not said to be too fine. */
static void test_too_fine(void **state)
{
    NEED_DEVICE();
    assert_true(too_fine(false, 3, 1e6) > 30);
    assert_int_equal(too_fine(false, 2, 1e6), 0);
    assert_true(too_fine(true, 2, 1e6) > 30);
    assert_int_equal(too_fine(true, 1, 1e6), 0);
    assert_true(too_fine(false, 3, 1.6) > 30);
    assert_in_range(too_fine(false, 3, 0.6), 0, 10);
}

/* Whole levels come every 2 x 32 + 32 steps until four times their leaves are more than a third of
 * the most; single leaves from a quarter of the steps on, but no sooner than 32 + 32 steps behind
 * the last level, all of them at 0.7. */
static void test_foresee(void **state)
{
    static const struct {
        double step, leaves;
    } cases[] = {{10, 64},
                 {95, 64},
                 {97, 256},
                 {191, 256},
                 {193, 1024},
                 {249, 1024},
                 {289, 4096},
                 {351, 4096},
                 {353, 4096 + 12288 * 0.103 / 0.45},
                 {383, 4096 + 12288 * 0.133 / 0.45},
                 {701, 16384}};
    cln_config config;
    double before = 0;

    (void)state;
    assert_ok(cln_config_preset("voxel", &config));
    config.structure_from = 0.25;
    config.structure_until = 0.7;
    config.cull_after = config.refresh_every = 32;
    config.max_leaves = 16384;
    config.start_level = 2;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_near(cln_grow_foresee(&config, 64, 16384, true, cases[i].step / 1000, 1000),
                    cases[i].leaves, 1e-9);
    for (int step = 0; step < 1000; step++) {
        const double leaves = cln_grow_foresee(&config, 64, 16384, true, step / 1000.0, 1000);

        assert_true(leaves >= before && leaves <= 16384);
        before = leaves;
    }
    assert_near(cln_grow_foresee(&config, 64, 100, true, 0.9, 1000), 100, 1e-9);
    assert_near(cln_grow_foresee(&config, 64, 16384, false, 0.9, 1000), 4096, 1e-9);
    config.adaptive = false; /* whole levels alone, whatever --max-leaves says */
    assert_near(cln_grow_foresee(&config, 64, 16384, true, 0.9, 1000), 4096, 1e-9);
    config.max_leaves = 100;
    assert_near(cln_grow_foresee(&config, 64, 16384, true, 0.9, 1000), 4096, 1e-9);
    config.max_leaves = 16384;
    config.adaptive = true; /* too few steps for single leaves, of any number of them */
    assert_near(cln_grow_foresee(&config, 64, 16384, true, 0.9, 200), 256, 1e-9);
}

/* By --level-at, of a budget in seconds and, no sooner than levels may follow, in steps. */
static void test_foresee_levels(void **state)
{
    static const struct {
        double fraction, steps, leaves;
    } cases[] = {{0.09, 0, 64},     {0.11, 0, 256},  {0.29, 0, 256},
                 {0.31, 0, 1024},   {0.49, 0, 1024}, {0.29, 1e4, 256},
                 {0.31, 1e4, 1024}, {0.31, 200, 64}, {0.49, 200, 256}};
    cln_config config;

    (void)state;
    assert_ok(cln_config_preset("voxel", &config));
    config.structure_from = 0.5;
    config.structure_until = 0.7;
    config.cull_after = config.refresh_every = 32;
    config.max_leaves = 1 << 20;
    config.start_level = 2;
    snprintf(config.level_at, sizeof config.level_at, "3:0.1,4:0.3,5:0.9");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_near(cln_grow_foresee(&config, 64, 1 << 20, true, cases[i].fraction, cases[i].steps),
                    cases[i].leaves, 1e-9);
    /* levels that it leaves out come one by one before the next that it names */
    snprintf(config.level_at, sizeof config.level_at, "5:0.3");
    assert_near(cln_grow_foresee(&config, 64, 1 << 20, true, 0.29, 0), 64, 1e-9);
    assert_near(cln_grow_foresee(&config, 64, 1 << 20, true, 0.31, 0), 4096, 1e-9);
    assert_near(cln_grow_foresee(&config, 64, 1 << 20, true, 0.31, 1000), 256, 1e-9);
    assert_near(cln_grow_foresee(&config, 64, 1 << 20, true, 0.49, 1000), 1024, 1e-9);
}

int test_group_grow(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_refined),        cmocka_unit_test(test_waits),
        cmocka_unit_test(test_awaited),        cmocka_unit_test(test_foresee),
        cmocka_unit_test(test_foresee_levels), cmocka_unit_test(test_can_split),
        cmocka_unit_test(test_none_came),      cmocka_unit_test(test_too_fine),
        cmocka_unit_test(test_two_numbers),    cmocka_unit_test(test_ends),
    };

    return cmocka_run_group_tests_name("grow", tests, fixture_setup, fixture_teardown);
}
