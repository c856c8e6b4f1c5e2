/* Photos as a browser gets them (view/painter.h), by hand. */
#include "unit.h"
#include <stdlib.h>
#include "io/image.h"
#include "near.h"
#include "scratch.h"
#include "tests.h"
#include "view/painter.h"

enum { WIDTH = 64, HEIGHT = 32 };

/* Alpha in a file of its own, here turned by half, counts as alpha in the photo does. */
static void test_alpha_files(void **state)
{
    static const float blue[3] = {0, 0, 1};
    static uint8_t photo[WIDTH * HEIGHT * 3], alpha[WIDTH * HEIGHT];
    cln_view view = {.alpha_turn = 3};
    const cln_scene scene = {.views = &view, .view_count = 1};
    cln_pipeline pipeline = {0};
    cln_painter painter = {.pipeline = &pipeline, .scene = &scene};
    cln_painting g = {.ask = {.kind = CLN_ASK_PHOTO, .side = WIDTH}};
    int width = 0, height = 0, channels = 0;
    uint8_t *got = NULL;

    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        photo[3 * i] = 200;
        photo[3 * i + 1] = 100;
        photo[3 * i + 2] = 0;
        alpha[i] = i % WIDTH < WIDTH / 2 ? 255 : 0;
    }
    view.path = (char *)scratch_path(*state, "photo.png");
    view.alpha_path = (char *)scratch_path(*state, "alpha.png");
    assert_int_equal(cln_image_write_png(view.path, WIDTH, HEIGHT, 3, photo), CLN_OK);
    assert_int_equal(cln_image_write_png(view.alpha_path, WIDTH, HEIGHT, 1, alpha), CLN_OK);
    memcpy(g.ask.background, blue, sizeof blue);
    for (int n = 1; n <= 2; n++) { /* as it is, and half as large */
        g.ask.side = WIDTH / n;
        assert_int_equal(cln_painter_step(&painter, &g), CLN_OK);
        assert_int_equal(g.status, 200);
        assert_int_equal(
            cln_image_decode("photo", g.body, g.bytes, &width, &height, &channels, &got), CLN_OK);
        assert_int_equal(width, WIDTH / n);
        assert_int_equal(height, HEIGHT / n);
        for (int i = 0; i < width * height; i++) {
            const bool shown = i % width >= width / 2;

            assert_near(got[channels * i], shown ? 200 : 0, 12);
            assert_near(got[channels * i + 1], shown ? 100 : 0, 12);
            assert_near(got[channels * i + 2], shown ? 0 : 255, 12);
        }
        free(got);
        cln_painting_free(&g);
        g.ask = (cln_ask){.kind = CLN_ASK_PHOTO, .background = {0, 0, 1}};
    }
    g.ask.side = WIDTH;
    assert_int_equal(cln_image_write_png(view.alpha_path, HEIGHT, WIDTH, 1, alpha), CLN_OK);
    assert_int_equal(cln_painter_step(&painter, &g), CLN_OK);
    assert_int_equal(g.status, 404); /* the file is another one now */
    cln_painting_free(&g);
}

/* A photo comes as people see it, whether its pixels are stored so for its pose or turned. */
static void test_seen_photos(void **state)
{
    static uint8_t photo[WIDTH * HEIGHT * 3]; /* red on the left, blue on the right */
    cln_view view = {.orientation = 6};
    const cln_scene scene = {.views = &view, .view_count = 1};
    cln_pipeline pipeline = {0};
    cln_painter painter = {.pipeline = &pipeline, .scene = &scene};

    for (int i = 0; i < WIDTH * HEIGHT; i++)
        photo[3 * i + (i % WIDTH < WIDTH / 2 ? 0 : 2)] = 200;
    view.path = (char *)scratch_path(*state, "photo.png");
    assert_int_equal(cln_image_write_png(view.path, WIDTH, HEIGHT, 3, photo), CLN_OK);
    for (int turned = 0; turned < 2; turned++) {
        cln_painting g = {.ask = {.kind = CLN_ASK_PHOTO, .side = WIDTH}};
        int width = 0, height = 0, channels = 0;
        uint8_t *got = NULL;

        view.turned = turned;
        assert_int_equal(cln_painter_step(&painter, &g), CLN_OK);
        assert_int_equal(
            cln_image_decode("photo", g.body, g.bytes, &width, &height, &channels, &got), CLN_OK);
        assert_true(width == HEIGHT && height == WIDTH);
        for (int i = 0; i < width * height; i++) /* what is left is above then */
            assert_near(got[channels * i], i / width < height / 2 ? 200 : 0, 20);
        free(got);
        cln_painting_free(&g);
    }
}

int test_group_painter(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_seen_photos, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_alpha_files, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("painter", tests, NULL, NULL);
}
