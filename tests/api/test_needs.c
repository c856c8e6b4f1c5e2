/* What check tells of the time that a training of voxels would take, by the times of a step on the
 * first tree and on the largest. Oracle: means over the budget, by hand. */
#include "unit.h"
#include "api/needs.h"
#include "near.h"
#include "run_fixture.h"
#include "scene/scene.h"
#include "tests.h"

/* A tree of 64 leaves, too many for whole levels, whose leaves split between a quarter and three
 * quarters of the budget until there are 600. */
static json_t *needs_of(int steps, double time_limit)
{
    const cln_device_desc device = fixture_device();
    cln_settings settings = {.config = fixture_voxels(), .preset = "voxel"};
    const cln_scene_desc desc = {.path = fixture_path("scene"),
                                 .config = &settings.config,
                                 .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;
    json_t *about = NULL;

    settings.config.adaptive = true;
    settings.config.max_leaves = 600;
    settings.config.structure_from = 0.25;
    settings.config.structure_until = 0.75;
    settings.config.cull_after = 8;
    settings.config.steps = steps;
    settings.config.time_limit = time_limit;
    assert_ok(cln_scene_load(&desc, &scene));
    about = cln_needs_describe(scene, &settings, &device, 0.1, NULL);
    assert_non_null(about);
    cln_scene_free(scene);
    return about;
}

static double number_at(json_t *about, const char *path)
{
    return json_number_value(fixture_at(about, path));
}

/* As many steps on small trees as on large ones; at the least all are on the first, as single
 * leaves may not split, and half as long, and as much less as other programs worked meanwhile. */
static void test_steps(void **state)
{
    enum { COUNT = 1000 };
    json_t *about = NULL;
    double first = 0, last = 0, mean = 0, others = 0, alone = 1;

    NEED_DEVICE();
    about = needs_of(COUNT, 0);
    first = number_at(about, "time.step_seconds_first");
    last = number_at(about, "time.step_seconds_last");
    mean = (first + last) / 2;
    print_message("    %.3f and %.3f ms a step\n", 1000 * first, 1000 * last);
    assert_true(first > 0 && last > 0);
    assert_near(number_at(about, "time.step_seconds"), mean, 1e-6 * mean);
    assert_near(number_at(about, "time.seconds"), COUNT * mean, 1e-6 * COUNT * mean);
    others = number_at(about, "time.others"); /* 0: null, or a machine of our own */
    if (others > 0.25)
        alone = 1 - others;
    assert_int_equal(json_object_get(fixture_at(about, "time"), "others_note") != NULL, alone < 1);
    assert_near(number_at(about, "time.seconds_least"), 0.5 * COUNT * first * alone,
                1e-6 * COUNT * first);
    assert_near(number_at(about, "time.seconds_most"), 2.2 * COUNT * mean, 1e-5 * COUNT * mean);
    json_decref(about);
}

/* Of a budget in seconds, as much time goes by on small trees as on large ones: steps are counted
 * by the mean of their number in a second. */
static void test_seconds(void **state)
{
    const double limit = 1000;
    json_t *about = NULL;
    double first = 0, last = 0, wanted = 0;

    NEED_DEVICE();
    about = needs_of(0, limit);
    first = number_at(about, "time.step_seconds_first");
    last = number_at(about, "time.step_seconds_last");
    wanted = limit * (0.25 / first + 0.5 * log(last / first) / (last - first) + 0.25 / last);
    assert_near(number_at(about, "time.steps_in_time_limit"), wanted, 1 + 1e-3 * wanted);
    assert_true(json_is_null(fixture_at(about, "time.seconds")));
    json_decref(about);
}

int test_group_needs(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_steps),
                                       cmocka_unit_test(test_seconds)};

    return cmocka_run_group_tests_name("needs", tests, fixture_setup, fixture_teardown);
}
