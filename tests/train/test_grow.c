/* When a whole level of voxels comes. Tested: whether its voxels are too fine for the photos
 * (--cell-pixels) does not depend on how far --refine-poses has moved the cameras, so that a
 * resumed run grows as one without interruption. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "tests.h"
#include "scene/motion.h"
#include "train/grow.h"
#include "train/refine.h"
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

int test_group_grow(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_refined)};

    return cmocka_run_group_tests_name("grow", tests, fixture_setup, fixture_teardown);
}
