/* Exposures of photos that training did not see (render/exposure_guess.h), against a direct search
 * for each view's neighbours. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "near.h"
#include "render/exposure_guess.h"
#include "scene_fixture.h"
#include "tests.h"

/* Photos of the first day, then of the second, whose first one is held out. */
enum { VIEWS = 18, A_DAY = 13, EVERY = 4 };

static bool held_out(int number)
{
    return number % EVERY == 1;
}

/* Photos 0, 1, ... in a folder for each day; the frames of the file are in another order. */
static cln_scene *days(const char *folder)
{
    static const char *const files[2] = {"transforms_train.json", "transforms_test.json"};

    put_folder(folder, "one");
    put_folder(folder, "two");
    for (int test = 0; test < 2; test++) {
        char json[4096] = "{\"camera_angle_x\":0.7,\"frames\":[";
        const char *comma = "";

        for (int i = VIEWS - 1; i >= 0; i--) {
            char name[32], frame[256];

            if (held_out(i) != (test == 1))
                continue;
            snprintf(name, sizeof name, "%s/v%d.png", i < A_DAY ? "one" : "two", i);
            put_image(folder, name, 4, 4, 3, i);
            snprintf(frame, sizeof frame,
                     "%s{\"file_path\":\"%s\",\"transform_matrix\":[[1,0,0,%d],[0,1,0,0],"
                     "[0,0,1,4],[0,0,0,1]]}",
                     comma, name, i);
            strcat(json, frame);
            comma = ",";
        }
        strcat(json, "]}");
        put_text(folder, files[test], json);
    }
    return load(folder, NULL);
}

static int number_of(const cln_view *view)
{
    return atoi(strchr(view->name, 'v') + 1);
}

static bool same_day(int a, int b)
{
    return a >= 0 && b >= 0 && a < VIEWS && b < VIEWS && (a < A_DAY) == (b < A_DAY);
}

/* The mean of the log gains of the nearest training photos of the day, before and after. */
static double around(const double *logs, int number)
{
    double sum = 0;
    int count = 0;

    for (int step = -1; step <= 1; step += 2) {
        int i = number + step;

        while (same_day(i, number) && held_out(i))
            i += step;
        if (same_day(i, number)) {
            sum += logs[i];
            count++;
        }
    }
    return count ? sum / count : 0;
}

/* Guesses gains whose logs in channel c are logs[] (c + 1), and compares them. */
static double compare(const char *folder, const double logs[VIEWS])
{
    cln_scene *scene = days(folder);
    cln_model model = {0};
    double cross = 0, square = 0, share = 0;
    float(*gains)[3] = NULL;

    model.exposure_views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    model.exposure = calloc((size_t)model.exposure_views, sizeof *model.exposure);
    assert_non_null(model.exposure);
    model.exposed = true;
    for (int i = 0; i < model.exposure_views; i++)
        for (int c = 0; c < 3; c++)
            model.exposure[i][c] =
                (float)exp(logs[number_of(cln_scene_training_view(scene, i))] * (c + 1));
    for (int i = 0; i < VIEWS; i++) {
        cross += held_out(i) ? 0 : logs[i] * around(logs, i);
        square += held_out(i) ? 0 : around(logs, i) * around(logs, i);
    }
    share = fmin(fmax(cross / square, 0), 1);
    assert_int_equal(cln_exposure_guess(&model, scene, &gains), CLN_OK);
    assert_non_null(gains);
    for (int v = 0; v < scene->view_count; v++)
        for (int c = 0; c < 3; c++) {
            const int number = number_of(&scene->views[v]);
            const double log = held_out(number) ? share * around(logs, number) : logs[number];

            assert_near(gains[v][c], exp(log * (c + 1)), 1e-6);
        }
    free(gains);
    model.exposure_views--; /* another scene's */
    assert_int_equal(cln_exposure_guess(&model, scene, &gains), CLN_OK);
    assert_null(gains);
    free(model.exposure);
    cln_scene_free(scene);
    return share;
}

static void test_clouds(void **state)
{
    double logs[VIEWS];

    for (int i = 0; i < VIEWS; i++)
        logs[i] = i < A_DAY ? 0.2 * sin(0.4 * i) : -0.3;
    assert_true(compare(*state, logs) > 0.8);
}

/* Of gains that alternate, neighbours tell nothing: not even the other sign. */
static void test_without_order(void **state)
{
    double logs[VIEWS];

    for (int i = 0, sign = 1; i < VIEWS; i++) {
        logs[i] = 0.1 * sign;
        sign = held_out(i) ? sign : -sign;
    }
    assert_true(compare(*state, logs) == 0);
}

static void test_without_gains(void **state)
{
    cln_scene *scene = days(*state);
    const cln_model model = {0};
    float(*gains)[3] = NULL;

    assert_int_equal(cln_exposure_guess(&model, scene, &gains), CLN_OK);
    assert_null(gains);
    cln_scene_free(scene);
}

int test_group_exposure_guess(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_clouds, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_without_order, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_without_gains, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("exposure_guess", tests, NULL, NULL);
}
