/* What photos without alpha stand before: one colour along their borders (scene.backdrop), and
 * whether it is evenly lit. test_scene.c tests other backgrounds. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "io/image.h"
#include "near.h"
#include "scene_fixture.h"
#include "tests.h"

/* Photos that stand before one colour have it behind them; if borders have others, if a mean is
 * asked for, if a lens sees far to the sides, or if cameras go along a path, it is the mean. A
 * colour that is given is a backdrop if the borders have it. */
static void test_backdrop(void **state)
{
    static const struct {
        const char *background, *angle;
        int others; /* of 28 pixels at the border of one of two photos */
        bool is;
        double step; /* of eight cameras ahead */
    } cases[] = {{"auto", "0.8", 0, true, 0},
                 {"auto", "0.8", 1, true, 0},
                 {"auto", "0.8", 8, false, 0},
                 {"mean", "0.8", 0, false, 0},
                 {"auto", "2.6", 0, false, 0},
                 {"auto", "0.8", 0, false, 0.2},
                 {"0.2,0.4,0.6", "0.8", 0, false, 0},
                 {"0.945,0.867,0.788", "0.8", 1, true, 0},
                 {"0.945,0.867,0.75", "0.8", 1, false, 0}};
    const char *folder = *state;
    uint8_t rgb[8 * 8 * 3];

    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_config config = default_config();
        cln_scene *scene = NULL;
        char json[2048], frames[1536] = "";
        size_t length = 0;

        for (int k = 0; k < (cases[i].step > 0 ? 8 : 2); k++) {
            char name[8];

            snprintf(name, sizeof name, "%d.png", k);
            for (int p = 0; p < 64; p++) {
                const bool inside = p % 8 % 7 && p / 8 % 7;
                const bool other = k == 1 && !inside && p < cases[i].others;

                for (int c = 0; c < 3; c++) /* sensors differ a little */
                    rgb[3 * p + c] =
                        (uint8_t)(inside || other ? 30 * c + p : 240 - 20 * c + (p * 7 + k) % 3);
            }
            assert_int_equal(cln_image_write_png(scratch_path(folder, name), 8, 8, 3, rgb), CLN_OK);
            length += (size_t)snprintf(frames + length, sizeof frames - length,
                                       "%s{\"file_path\":\"%s\",\"transform_matrix\":[[1,0,0,0],"
                                       "[0,1,0,0],[0,0,1,%g],[0,0,0,1]]}",
                                       k ? "," : "", name, 4 - cases[i].step * k);
        }
        snprintf(json, sizeof json, "{\"camera_angle_x\":%s,\"aabb_scale\":1,\"frames\":[%s]}",
                 cases[i].angle, frames);
        put_text(folder, "transforms.json", json);
        config.holdout = 0;
        snprintf(config.background, sizeof config.background, "%s", cases[i].background);
        scene = load(folder, &config);
        assert_int_equal(scene->backdrop, cases[i].is);
        for (int c = 0; c < 3 && cases[i].is; c++)
            assert_near(scene->background[c], (241 - 20 * c) / 255.0, 5.01e-4);
        assert_int_equal(scene->background_mean, i < 6);
        cln_scene_free(scene);
    }
}

/* A disc before a backdrop stands out at once; paper that is lit in its middle does not. */
static void test_uneven_backdrop(void **state)
{
    enum { N = 64 };
    const char *folder = *state;
    uint8_t rgb[N * N * 3];

    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "0.png", POSE_FRONT) "," FRAME("1.png", POSE_FRONT) "]}");
    for (int lit = 0; lit < 3; lit++) { /* the disc, the light, both */
        cln_config config = default_config();
        cln_scene *scene = NULL;

        for (int p = 0; p < N * N; p++) {
            const double x = p % N - 31.5, y = p / N - 31.5, r = hypot(x, y);
            const double light = lit && r < 31 ? 50 * (1 - r * r / (31 * 31)) : 0;
            const bool disc = lit != 1 && r < 14;

            memset(rgb + 3 * p, disc ? 30 : (int)(150 + light), 3);
        }
        assert_int_equal(cln_image_write_png(scratch_path(folder, "0.png"), N, N, 3, rgb), CLN_OK);
        assert_int_equal(cln_image_write_png(scratch_path(folder, "1.png"), N, N, 3, rgb), CLN_OK);
        config.holdout = 0;
        scene = load(folder, &config);
        assert_true(scene->backdrop);
        assert_int_equal(scene->backdrop_uneven, lit > 0);
        cln_scene_free(scene);
    }
}

int test_group_backdrop(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_backdrop, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_uneven_backdrop, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("backdrop", tests, NULL, NULL);
}
