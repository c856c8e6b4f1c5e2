/* Frames of render: ranges of them, pictures without their background, files that a copy cut
 * short. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include "run_fixture.h"
#include "io/image.h"
#include "tests.h"

static cln_render_desc desc_of(const char *out)
{
    return (cln_render_desc){.run = fixture_path("whole"),
                             .out = fixture_path(out),
                             .orbit_frames = 4,
                             .orbit_elevation = 10,
                             .orbit_radius = 1,
                             .width = 20,
                             .device = fixture_device()};
}

static void assert_rendered(const cln_render_desc *desc, int rendered, int skipped)
{
    cln_render_result result;

    assert_ok(cln_render(desc, &result));
    assert_int_equal(result.rendered, rendered);
    assert_int_equal(result.skipped, skipped);
}

static bool is_there(const char *name)
{
    return cln_is_file(fixture_path(name));
}

static void some_frames_are_those_of_all(void **state)
{
    cln_render_desc all = desc_of("all"), some = desc_of("some");
    cln_render_result result;
    size_t bytes[2] = {0};
    char *png[2];

    NEED_DEVICE();
    assert_rendered(&all, 4, 0);
    some.first_frame = 1;
    some.frame_count = 2;
    assert_rendered(&some, 2, 0);
    assert_true(is_there("some/orbit_0001.png") && is_there("some/orbit_0002.png"));
    assert_false(is_there("some/orbit_0000.png") || is_there("some/orbit_0003.png"));
    png[0] = scratch_get(fixture_path("all/orbit_0002.png"), &bytes[0]);
    png[1] = scratch_get(fixture_path("some/orbit_0002.png"), &bytes[1]);
    assert_int_equal(bytes[0], bytes[1]);
    assert_memory_equal(png[0], png[1], bytes[0]);
    free(png[0]);
    free(png[1]);
    some.first_frame = 3;
    some.frame_count = 0; /* to the end */
    assert_rendered(&some, 1, 0);
    some.first_frame = 0;
    assert_rendered(&some, 1, 3);
    some.first_frame = 4;
    assert_fails(cln_render(&some, &result), CLN_USAGE, "--frames: there are 4");
    some.first_frame = 3;
    some.frame_count = 2;
    assert_fails(cln_render(&some, &result), CLN_USAGE, "numbered from 0 to 3");
    some.first_frame = -1;
    assert_fails(cln_render(&some, &result), CLN_USAGE, "first_frame");
}

/* Over the model's background a picture without it is the one that has it, to the rounding of
 * colours and alpha. */
static void backgrounds_are_taken_out(void **state)
{
    cln_render_desc on = desc_of("on"), off = desc_of("off");
    int width = 0, height = 0, channels = 0, clear = 0, partly = 0;
    uint8_t *with = NULL, *without = NULL;
    cln_render_result result;

    NEED_DEVICE();
    off.transparent = true;
    on.cropped = off.cropped = true; /* so that some rays meet nothing */
    for (int a = 0; a < 6; a++)
        on.crop[a] = off.crop[a] = a < 3 ? -0.3 : 0.3;
    assert_rendered(&on, 4, 0);
    assert_rendered(&off, 4, 0);
    assert_ok(cln_image_load(fixture_path("on/orbit_0002.png"), &width, &height, &channels, &with));
    assert_int_equal(channels, 3);
    assert_ok(
        cln_image_load(fixture_path("off/orbit_0002.png"), &width, &height, &channels, &without));
    assert_int_equal(channels, 4);
    for (int i = 0; i < width * height; i++) {
        const double alpha = without[4 * i + 3] / 255.0;

        clear += alpha == 0;
        partly += alpha > 0.1 && alpha < 0.9;
        for (int k = 0; k < 3; k++) { /* white, as photos with alpha are read */
            const double over = alpha * without[4 * i + k] + (1 - alpha) * 255;

            assert_true(fabs(over - with[3 * i + k]) < 1.6);
        }
    }
    assert_true(clear > 0 && partly > 0);
    assert_rendered(&off, 0, 4);
    off.transparent = false; /* another kind of picture: made again */
    assert_rendered(&off, 4, 0);
    free(with);
    free(without);
    off.transparent = true;
    off.out = fixture_path("film.y4m");
    assert_fails(cln_render(&off, &result), CLN_USAGE, "--transparent: a film");
}

static void files_cut_short_are_made_again(void **state)
{
    static const char *const files[] = {"cut/orbit_0001.png", "cut/orbit_0001.opacity.png",
                                        "cut/orbit_0001.depth.npy"};
    cln_render_desc desc = desc_of("cut");

    NEED_DEVICE();
    assert_rendered(&desc, 4, 0);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        for (int empty = 0; empty < 2; empty++) {
            size_t bytes = 0, again = 0;
            char *whole = scratch_get(fixture_path(files[i]), &bytes), *after = NULL;

            scratch_put(fixture_path(files[i]), whole, empty ? 0 : bytes / 2);
            assert_rendered(&desc, 1, 3);
            after = scratch_get(fixture_path(files[i]), &again);
            assert_int_equal(again, bytes);
            assert_memory_equal(after, whole, bytes);
            free(whole);
            free(after);
        }
}

int test_group_render_frames(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(some_frames_are_those_of_all),
        cmocka_unit_test(backgrounds_are_taken_out),
        cmocka_unit_test(files_cut_short_are_made_again),
    };

    return cmocka_run_group_tests_name("render_frames", tests, fixture_setup, fixture_teardown);
}
