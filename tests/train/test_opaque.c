/* --opaque-loss and --random-background in a training on photos without alpha, a ball before white:
 * without them, rays that pass the ball stay empty, as the white background explains them; with one
 * of them, something must stand there. On photos with alpha the first changes nothing. */
#include "unit.h"
#include "run_fixture.h"
#include "tests.h"

/* The fixture's photos over white, without alpha, as another scene, whose borders have another
 * colour, too; or of a dim ball before black. */
static void put_photos(bool dim)
{
    static const struct {
        const char *split;
        int count;
    } splits[] = {{"train", TRAIN_VIEWS}, {"test", TEST_VIEWS}};

    for (int s = 0; s < 2; s++) {
        char name[64], *text = NULL;
        size_t bytes = 0;

        snprintf(name, sizeof name, "photos/%s", splits[s].split);
        assert_ok(cln_make_dirs(fixture_path(name)));
        snprintf(name, sizeof name, "scene/transforms_%s.json", splits[s].split);
        text = scratch_get(fixture_path(name), &bytes);
        snprintf(name, sizeof name, "photos/transforms_%s.json", splits[s].split);
        scratch_put(fixture_path(name), text, bytes);
        free(text);
        for (int i = 0; i < splits[s].count; i++) {
            uint8_t *rgba = NULL, rgb[SIDE * SIDE * 3];
            int width = 0, height = 0, channels = 0;

            snprintf(name, sizeof name, "scene/%s/r_%d.png", splits[s].split, i);
            assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &rgba));
            assert_true(width == SIDE && height == SIDE && channels == 4);
            for (int k = 0; k < SIDE * SIDE; k++)
                for (int c = 0; c < 3; c++)
                    rgb[3 * k + c] = dim ? (uint8_t)(rgba[4 * k + c] * rgba[4 * k + 3] / 765)
                                     : rgba[4 * k + 3] ? rgba[4 * k + c]
                                                       : 255;
            for (int k = 0; k < SIDE && !dim; k++)
                rgb[3 * SIDE * k + k % 3] = 200;
            snprintf(name, sizeof name, "photos/%s/r_%d.png", splits[s].split, i);
            assert_ok(cln_image_write_png(fixture_path(name), SIDE, SIDE, 3, rgb));
            free(rgba);
        }
    }
}

/* Mean opacity of the test views after a training, by default before white. digest: the model's;
 * off: its mean difference from the ball's alpha; both may be NULL. */
static double opacity_of(const char *scene, const char *run, const cln_config *config,
                         uint64_t *digest, double *off)
{
    cln_settings settings = {.config = *config};
    const cln_train_desc desc = {.scene = fixture_path(scene),
                                 .run = fixture_path(run),
                                 .skip_selftest = true,
                                 .settings = &settings,
                                 .device = fixture_device(),
                                 .command = "test"};
    char name[64];
    const cln_render_desc pictures = {
        .run = desc.run,
        .out = (snprintf(name, sizeof name, "%s views", run), fixture_path(name)),
        .split = "test",
        .device = fixture_device()};
    cln_train_result trained;
    cln_render_result rendered;
    double sum = 0, differences = 0;

    snprintf(settings.preset, sizeof settings.preset, "%s", fixture_preset(config));
    if (!strcmp(settings.config.background, "auto"))
        snprintf(settings.config.background, sizeof settings.config.background, "white");
    assert_ok(cln_train(&desc, &trained));
    assert_ok(cln_render(&pictures, &rendered));
    for (int i = 0; i < TEST_VIEWS; i++) {
        uint8_t *pixels = NULL, *ball = NULL;
        int width = 0, height = 0, channels = 0, four = 0;

        snprintf(name, sizeof name, "scene/test/r_%d.png", i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &four, &ball));
        assert_int_equal(four, 4);
        snprintf(name, sizeof name, "%s views/test_r_%d.opacity.png", run, i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &pixels));
        for (int k = 0; k < width * height; k++) {
            sum += pixels[k * channels];
            differences += abs(pixels[k * channels] - ball[4 * k + 3]);
        }
        free(pixels);
        free(ball);
    }
    sum /= 255.0 * SIDE * SIDE * TEST_VIEWS;
    if (off)
        *off = differences / (255.0 * SIDE * SIDE * TEST_VIEWS);
    if (digest)
        *digest = trained.digest;
    return sum;
}

/* The same with this weight. */
static double opacity_after(const char *scene, const char *run, double loss)
{
    cln_config config = fixture_config();

    config.opaque_loss = loss;
    config.steps = 150;
    return opacity_of(scene, run, &config, NULL, NULL);
}

static void photos_without_alpha_end_opaque(void **state)
{
    double without = 0, with = 0;

    NEED_DEVICE();
    put_photos(false);
    without = opacity_after("photos", "without", 0);
    with = opacity_after("photos", "with", 0.01);
    print_message("    opacity %.3f without the loss, %.3f with it\n", without, with);
    assert_true(without < 0.65);
    assert_true(with > without + 0.1);
}

/* Where borders have the background's colour, what differs from it is asked to be opaque, and
 * nothing else is. */
static void what_stands_before_a_backdrop_is_opaque(void **state)
{
    cln_config config = fixture_voxels();
    double without = 0, with = 0;

    NEED_DEVICE();
    put_photos(true);
    config.steps = 150;
    snprintf(config.background, sizeof config.background, "black");
    config.opaque_loss = 0;
    (void)opacity_of("photos", "backdrop without", &config, NULL, &without);
    config.opaque_loss = 0.1;
    (void)opacity_of("photos", "backdrop with", &config, NULL, &with);
    print_message("    opacity is off by %.3f without the loss, %.3f with it\n", without, with);
    assert_true(with < 0.5 * without);
}

static void photos_with_alpha_stay_as_they_are(void **state)
{
    NEED_DEVICE();
    assert_true(opacity_after("scene", "alpha without", 0) ==
                opacity_after("scene", "alpha with", 1));
}

/* Pale walls are no holes: before a background of any colour the photos' white is no air. */
static void random_backgrounds_end_opaque(void **state)
{
    static const char *const leaves[] = {"networks", "voxels"};

    NEED_DEVICE();
    put_photos(false);
    for (int voxels = 0; voxels < 2; voxels++) {
        cln_config config = voxels ? fixture_voxels() : fixture_config();
        uint64_t one = 0, any = 0;
        double without = 0, with = 0;
        char name[64];

        config.opaque_loss = 0; /* it does the same */
        config.steps = 150;
        snprintf(name, sizeof name, "%s before white", leaves[voxels]);
        without = opacity_of("photos", name, &config, &one, NULL);
        config.random_background = true;
        snprintf(name, sizeof name, "%s before any", leaves[voxels]);
        with = opacity_of("photos", name, &config, &any, NULL);
        print_message("    %s: opacity %.3f before white, %.3f before random colours\n",
                      leaves[voxels], without, with);
        assert_true(any != one);
        assert_true(without < 0.65); /* 0.54 and 0.38 */
        assert_true(with > 0.95);
    }
}

int test_group_opaque(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(photos_without_alpha_end_opaque),
        cmocka_unit_test(what_stands_before_a_backdrop_is_opaque),
        cmocka_unit_test(photos_with_alpha_stay_as_they_are),
        cmocka_unit_test(random_backgrounds_end_opaque),
    };

    return cmocka_run_group_tests_name("opaque", tests, fixture_setup, fixture_teardown);
}
