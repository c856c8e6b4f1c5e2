/* Panoramas of transforms.json: whole spheres, ones that were cut, and ones that are not told from
 * photos. Oracle: numbers by hand. The lens itself is test_lens.c's. */
#include "unit.h"
#include <math.h>
#include "near.h"
#include "scene/build.h"
#include "scene_fixture.h"
#include "tests.h"

/* A panorama that was cut follows its numbers; others span the sphere, which is told if they
 * cannot, as is a panorama that is taken for a pinhole's photo. */
static void panoramas_follow_their_numbers(void **state)
{
    static const char kept[] = "\"fl_x\":3.1831,\"fl_y\":3.1831,\"cx\":10,\"cy\":5,";
    const struct {
        const char *keys;
        int height;
        bool sphere;
        double cy, fy;
        int warnings;
    } cases[] = {{kept, 8, false, 5, 3.1831, 0},
                 {kept, 12, false, 5, 3.1831, 0}, /* above and below are bars */
                 {"\"fl_x\":3.1831,\"cy\":6,", 8, false, 6, 3.1831, 0},
                 {"\"fl_x\":10,\"fl_y\":10,\"cx\":10,\"cy\":5,", 8, true, 4, 8 / M_PI, 1},
                 {"\"fl_x\":3.1831,\"fl_y\":10,\"cy\":5,", 8, true, 4, 8 / M_PI, 1},
                 {"\"fl_x\":3.1831,", 8, true, 4, 8 / M_PI, 1}, /* where it was cut is not told */
                 {"", 10, true, 5, 10 / M_PI, 0},
                 {"\"fl_x\":10,", 10, true, 5, 10 / M_PI, 0},
                 /* other pixels than square ones */
                 {"\"fl_x\":3.1831,\"fl_y\":6.3662,\"cy\":10,", 20, false, 10, 6.3662, 0}};
    const char *folder = *state;
    cln_config config = default_config();
    char text[512];

    config.holdout = 0;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int warnings = 0;
        cln_scene *scene = NULL;
        const cln_camera *c = NULL;

        put_image(folder, "p.png", 20, cases[i].height, 3, 1);
        snprintf(
            text, sizeof text,
            "{\"camera_model\":\"EQUIRECTANGULAR\",%s\"frames\":[" FRAME("p.png", POSE_FRONT) "]}",
            cases[i].keys);
        put_text(folder, "transforms.json", text);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, &config);
        c = &scene->views[0].camera;
        assert_int_equal(warnings, cases[i].warnings);
        assert_int_equal(scene->views[0].by_file.cut, !cases[i].sphere);
        assert_near(c->fx, 20 / (2 * M_PI), 1e-4);
        assert_near(c->fy, cases[i].fy, 1e-4);
        assert_near(c->cx, 10, 1e-12);
        assert_near(c->cy, cases[i].cy, 1e-12);
        cln_scene_free(scene);
    }
    for (int i = 0; i < 2; i++) {
        int warnings = 0;

        put_image(folder, "p.png", 20, 10, 3, 1);
        snprintf(text, sizeof text, "{\"fl_x\":%s,\"frames\":[" FRAME("p.png", POSE_FRONT) "]}",
                 i ? "9" : "3.1831");
        put_text(folder, "transforms.json", text);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        cln_scene_free(load(folder, &config));
        assert_int_equal(warnings, i == 0);
    }
    cln_log_set_sink(NULL, NULL);
}

int test_group_panoramas(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(panoramas_follow_their_numbers, scratch_make,
                                        scratch_remove),
    };

    return cmocka_run_group_tests_name("panoramas", tests, NULL, NULL);
}
