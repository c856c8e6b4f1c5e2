/* What the masks beside photos mean (scene/cutout.c): drawn masks of objects and of what else masks
 * are of, and what becomes of them. Oracle: what was drawn. */
#include "unit.h"
#include "format_fixture.h"
#include "scene/build.h"
#include "tests.h"

enum { TIMES = 4, WIDE = TIMES * FORMAT_WIDTH, HIGH = TIMES * FORMAT_HEIGHT };

typedef enum {
    THING,    /* an ellipse near the middle, and a bit beside it */
    BUST,     /* a thing that stands on the lower border */
    STRIPED,  /* a thing in three parts alike */
    CORNER,   /* a thing in a corner */
    PEOPLE,   /* all but a thing */
    LEG,      /* all but a strip at the border */
    BONNET,   /* all but the lower third */
    SKY,      /* the lower half */
    FISHEYE,  /* a disc as high as the photo */
    CROPPED,  /* a disc higher than the photo */
    VASE,     /* one and the same thing */
    RIG,      /* a window each of two cameras */
    NOTHING,  /* black */
    ALL,      /* white */
    CLOSE_UP, /* a thing; but the first is white, too near */
    ABSENT,   /* a thing; but of the first there is none */
    FEW,      /* a thing; but half of the photos have none */
} drawing;

static bool in_disc(double x, double y, double cx, double cy, double rx, double ry)
{
    return pow((x - cx) / rx, 2) + pow((y - cy) / ry, 2) <= 1;
}

/* Does the drawing keep pixel (x, y) of a view's mask? */
static bool keeps(drawing what, int view, int column, int row)
{
    const double x = column + .5, y = row + .5, n = view;
    const bool thing = in_disc(x, y, 30 + n, 22 + n / 2, 10 + n, 14) || (x < 4 && y > 44);

    switch (what) {
    case BUST:
        return in_disc(x, y, 32 + n, 40, 10 + n, 20);
    case STRIPED:
        return thing && column / 3 % 2;
    case CORNER:
        return in_disc(x, y, 52 + n, 40, 8, 6);
    case PEOPLE:
        return !thing;
    case LEG:
        return x > 5 + n;
    case BONNET:
        return y < 30 + n;
    case SKY:
        return y > 20 + n;
    case FISHEYE:
        return in_disc(x, y, 32 + n / 10, 24, 23.6, 23.6);
    case CROPPED:
        return in_disc(x, y, 32 + n / 10, 24, 26, 26);
    case VASE:
        return in_disc(x, y, 32, 24, 8, 20);
    case RIG:
        return in_disc(x, y, 28 + 6 * (view % 2), 24, 8, 20);
    case NOTHING:
        return false;
    case ALL:
        return true;
    case CLOSE_UP:
        return thing || view == 0;
    default:
        return thing;
    }
}

typedef enum { GREY, LABELS, CUT_OUT, JPEG, WAYS } way;

static void put_mask(const char *folder, drawing what, int view, way as)
{
    static uint8_t pixels[WIDE * HIGH * 4];
    const int channels = as == CUT_OUT ? 4 : as == JPEG ? 3 : 1;
    char name[32];
    uint8_t *file = NULL;
    size_t bytes = 0;

    for (int i = 0; i < WIDE * HIGH; i++) {
        const bool kept = keeps(what, view, i % WIDE, i / WIDE);

        for (int c = 0; c < channels; c++)
            pixels[i * channels + c] = (uint8_t)(as == LABELS ? kept : 255 * kept);
        if (as == CUT_OUT) /* dark, as a photo may be */
            pixels[i * channels] = pixels[i * channels + 1] = pixels[i * channels + 2] = 10;
    }
    snprintf(name, sizeof name, "view_%02d.png.png", view);
    if (as != JPEG) {
        assert_int_equal(
            cln_image_write_png(scratch_path(folder, name), WIDE, HIGH, channels, pixels), CLN_OK);
        return;
    }
    assert_int_equal(cln_image_encode_jpeg(WIDE, HIGH, 3, pixels, 80, &file, &bytes), CLN_OK);
    scratch_put(scratch_path(folder, name), file, bytes);
    free(file);
}

/* A COLMAP scene in `folder` whose photos have these masks. */
static void put_scene(const char *folder, drawing what, way as)
{
    cln_camera cameras[FORMAT_VIEWS];
    const cln_point point = {.xyz = {1, 2, 3}};
    const char *masks = scratch_path(folder, "masks");

    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        cln_camera_resize(&cameras[v], WIDE, HIGH, 1. / TIMES, 1. / TIMES);
    format_images(scratch_path(folder, "images"), TIMES);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, &point, 1);
    put_folder(folder, "masks");
    for (int v = 0; v < FORMAT_VIEWS; v++)
        if (!(what == ABSENT && v == 0) && !(what == FEW && v < FORMAT_VIEWS / 2))
            put_mask(masks, what, v, as);
}

static void test_kinds(void **state)
{
    static const struct {
        drawing what;
        bool alpha, doubtful;
        const char *why;
    } cases[] = {
        {THING, true, false, "of an object (6 of them keep 18 %"},
        {BUST, true, false, "of an object"},
        {CLOSE_UP, true, false, "of an object"},
        {ABSENT, true, false, "of an object (5 of them"},
        {STRIPED, false, true, "not clearly"},
        {CORNER, false, true, "not clearly"},
        {PEOPLE, false, false, "of an object that they drop"},
        {LEG, false, false, "not clearly"},
        {BONNET, false, false, "not clearly"},
        {SKY, false, false, "not clearly"},
        {FISHEYE, false, false, "round"},
        {CROPPED, false, false, "round"},
        {VASE, false, true, "the same for all"},
        {RIG, false, true, "the same for several photos each"},
        {ALL, false, false, "the same for all"},
        {FEW, false, true, "some of the photos"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, (const char[]){(char)('a' + i), 0});
        cln_scene *scene = NULL;
        bool same = false;

        put_scene(folder, cases[i].what, GREY);
        scene = load(folder, plain());
        same = strstr(scene->masks_rule, cases[i].why) && scene->masks_alpha == cases[i].alpha &&
               scene->masks_doubtful == cases[i].doubtful && scene->has_alpha == cases[i].alpha &&
               scene->space.shell != cases[i].alpha && scene->background_mean != cases[i].alpha;
        if (!same)
            fail_msg("case %zu: %s, %d", i, scene->masks_rule, scene->masks_doubtful);
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            const cln_view *view = &scene->views[v];
            const bool has = !(cases[i].what == ABSENT && v == 0) &&
                             !(cases[i].what == FEW && v < FORMAT_VIEWS / 2);

            assert_int_equal(view->channels, cases[i].alpha && has ? 4 : 3);
            assert_int_equal(view->masked != NULL, !cases[i].alpha && has);
        }
        cln_scene_free(scene);
    }
}

/* Whatever masks are like, alpha is 255 where they keep and 0 where they do not, at soft edges
 * between; also of downscaled photos the mean. */
static void test_values(void **state)
{
    for (way as = 0; as < WAYS; as++)
        for (int n = 1; n <= 2; n++) {
            const char *folder = scratch_path(*state, (const char[]){(char)('a' + as), 0});
            cln_config config = *plain();
            cln_scene *scene = NULL;
            int checked = 0;

            put_scene(folder, THING, as);
            config.downscale = n;
            scene = load(folder, &config);
            assert_true(scene->masks_alpha);
            for (int v = 0; v < FORMAT_VIEWS; v++)
                for (int i = 0; i < WIDE / n * (HIGH / n); i++) {
                    const int x = i % (WIDE / n), y = i / (WIDE / n);
                    int kept = 0, around = 0;
                    uint8_t p[4];

                    cln_view_bytes(&scene->views[v], x, y, p);
                    for (int k = 0; k < n * n; k++)
                        kept += keeps(THING, v, n * x + k % n, n * y + k / n);
                    for (int k = 0; k < 9; k++)
                        around += keeps(THING, v, n * x + k % 3 - 1, n * y + k / 3 - 1);
                    if (as == JPEG && around % 9)
                        continue;
                    checked++;
                    if (abs(p[3] - 255 * kept / (n * n)) > (as == JPEG ? 255 * (n - 1) : 1))
                        fail_msg("way %d, view %d, (%d, %d) of %d: %d", (int)as, v, x, y, n, p[3]);
                }
            assert_true(checked > WIDE * HIGH);
            cln_scene_free(scene);
        }
}

/* With --masks inverted black is what they keep; of a few among others that is found. */
static void test_inverted(void **state)
{
    for (way as = 0; as < WAYS; as++) {
        const char *folder = scratch_path(*state, (const char[]){(char)('a' + as), 0});
        cln_config config = *plain();
        cln_scene *scene = NULL;
        char text[CLN_EMPTY_BYTES];

        put_scene(folder, PEOPLE, as);
        scene = load(folder, &config);
        assert_true(scene->masks_reversed && !scene->masks_alpha);
        cln_scene_free(scene);
        config.masks = CLN_MASKS_INVERTED;
        scene = load(folder, &config);
        assert_true(scene->masks_alpha && !scene->masks_reversed);
        for (int v = 0; v < FORMAT_VIEWS; v++)
            for (int x = 0; x < WIDE; x += 3) {
                const bool thing = keeps(THING, v, x, 24);
                uint8_t p[4];

                if (thing != keeps(THING, v, x - 1, 24) || thing != keeps(THING, v, x + 1, 24))
                    continue;
                cln_view_bytes(&scene->views[v], x, 24, p);
                assert_int_equal(p[3], 255 * thing);
            }
        cln_scene_free(scene);
        put_scene(folder, THING, as);
        put_mask(scratch_path(folder, "masks"), PEOPLE, 2, as);
        config.masks = CLN_MASKS_AUTO;
        scene = load(folder, &config);
        assert_true(scene->masks_alpha);
        assert_int_equal(cln_scene_find_reversed(scene, text), CLN_OK);
        assert_non_null(strstr(text, "of 1 of 6 photos the mask hides the object"));
        assert_non_null(strstr(text, "'view_02.png'"));
        cln_scene_free(scene);
    }
}

/* Of masks that are white where the people are, what is white does not count: the pixels that count
 * without it do not, and the others do. */
static void test_ignore_white(void **state)
{
    for (way as = 0; as < WAYS; as++) {
        const char *folder = scratch_path(*state, (const char[]){(char)('a' + as), 0});
        cln_config config = *plain();
        int white = 0, black = 0;
        cln_scene *scene = NULL;

        if (as == CUT_OUT) /* its colours tell nothing */
            continue;
        put_scene(folder, THING, as);
        config.masks = CLN_MASKS_IGNORE_WHITE;
        scene = load(folder, &config);
        assert_true(!scene->masks_alpha && !scene->has_alpha);
        for (int v = 0; v < FORMAT_VIEWS; v++)
            for (int x = 0; x < WIDE; x += 3) {
                const bool thing = keeps(THING, v, x, 24);

                if (thing != keeps(THING, v, x - 1, 24) || thing != keeps(THING, v, x + 1, 24))
                    continue;
                assert_int_equal(cln_view_keeps(&scene->views[v], x, 24), !thing);
                white += thing;
                black += !thing;
            }
        assert_true(white > 0 && black > 0);
        cln_scene_free(scene);
    }
}

/* Masks of some photos that follow each other are exchanged: the fewer are named. */
static void test_partly_inverted(void **state)
{
    static const struct {
        int exchanged;
        bool alpha;
        const char *text;
    } cases[] = {
        {2, true, "of 2 of 6 photos the mask hides the object"},
        {3, true, "of 3 of 6 photos the mask hides the object"},
        {4, false, "in 4 of 6 photos, and the object in 2: 'view_04.png'"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, (const char[]){(char)('a' + i), 0});
        cln_config config = *plain();
        cln_scene *scene = NULL;
        char text[CLN_EMPTY_BYTES];

        put_scene(folder, THING, GREY);
        for (int v = 0; v < cases[i].exchanged; v++)
            put_mask(scratch_path(folder, "masks"), PEOPLE, v, GREY);
        scene = load(folder, &config);
        assert_true(scene->masks_alpha == cases[i].alpha);
        assert_true(scene->masks_reversed == !cases[i].alpha);
        if (!cases[i].alpha) {
            cln_scene_free(scene);
            config.masks = CLN_MASKS_ALPHA;
            scene = load(folder, &config);
        }
        assert_int_equal(cln_scene_find_reversed(scene, text), CLN_OK);
        if (!strstr(text, cases[i].text))
            fail_msg("%d exchanged: '%s'", cases[i].exchanged, text);
        cln_scene_free(scene);
    }
}

/* Grey is a soft edge; a mask whose brightest is not quite white is brought there. */
static void test_soft(void **state)
{
    uint8_t grey[] = {0, 0, 0, 100, 100, 100, 200, 200, 200};
    uint8_t labels[] = {0, 0, 0, 1, 1, 1, 2, 2, 2};
    uint8_t coloured[] = {0, 0, 0, 0, 0, 255, 90, 120, 0};
    uint8_t opaque[] = {0, 0, 0, 255, 255, 255, 255, 255};

    (void)state;
    cln_mask_to_alpha(grey, 3, 3, false);
    assert_memory_equal(grey, ((uint8_t[]){0, 0, 0, 127, 127, 127, 255, 255, 255}), 9);
    cln_mask_to_alpha(labels, 3, 3, false);
    assert_memory_equal(labels, ((uint8_t[]){0, 0, 0, 255, 255, 255, 255, 255, 255}), 9);
    cln_mask_to_alpha(coloured, 3, 3, false);
    assert_memory_equal(coloured, ((uint8_t[]){0, 0, 0, 255, 255, 255, 120, 120, 120}), 9);
    cln_mask_to_alpha(opaque, 2, 4, false);
    assert_memory_equal(opaque, ((uint8_t[]){0, 0, 0, 255, 255, 255, 255, 255}), 8);
}

/* --masks decides; what says nothing is told; photos with alpha of their own keep it with auto. */
static void test_settings(void **state)
{
    const char *folder = *state;
    const char *images = scratch_path(folder, "images");
    cln_config config = *plain();
    cln_scene *scene = NULL;
    uint64_t digest = 0;
    int warnings = 0;

    put_scene(folder, THING, GREY);
    config.masks = CLN_MASKS_IGNORE;
    scene = load(folder, &config);
    assert_false(scene->has_alpha || scene->masks_alpha || scene->masks_doubtful);
    assert_non_null(scene->views[0].masked);
    digest = scene->digest;
    cln_scene_free(scene);
    config.masks = CLN_MASKS_AUTO;
    scene = load(folder, &config);
    assert_true(scene->digest == digest); /* of the same files */
    cln_scene_free(scene);
    put_mask(scratch_path(folder, "masks"), NOTHING, 2, GREY);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    cln_scene_free(load(folder, &config));
    assert_int_equal(warnings, 1);
    put_scene(folder, VASE, GREY);
    cln_scene_free(load(folder, &config)); /* if they are of an object ... */
    assert_int_equal(warnings, 2);
    config.masks = CLN_MASKS_ALPHA;
    scene = load(folder, &config);
    assert_true(scene->has_alpha && scene->masks_alpha && !scene->views[0].masked);
    cln_scene_free(scene);
    assert_int_equal(warnings, 2);
    put_scene(folder, THING, GREY);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        static uint8_t clear[WIDE * HIGH * 4];
        char name[32];

        clear[3] = 255;
        snprintf(name, sizeof name, "view_%02d.png", v);
        assert_int_equal(cln_image_write_png(scratch_path(images, name), WIDE, HIGH, 4, clear),
                         CLN_OK);
    }
    config.masks = CLN_MASKS_AUTO;
    scene = load(folder, &config);
    assert_true(scene->has_alpha && !scene->masks_alpha && scene->views[0].masked);
    assert_non_null(strstr(scene->masks_rule, "alpha of their own"));
    cln_scene_free(scene);
}

/* Photos without a mask are left out where those of most cut an object out, if --missing skip asks
 * for it; not where few have one. */
static void test_uncut(void **state)
{
    static const struct {
        drawing what;
        int missing, views;
    } cases[] = {
        {ABSENT, CLN_MISSING_AUTO, FORMAT_VIEWS},
        {ABSENT, CLN_MISSING_SKIP, FORMAT_VIEWS - 1},
        {FEW, CLN_MISSING_SKIP, FORMAT_VIEWS - FORMAT_VIEWS / 2},
        {THING, CLN_MISSING_SKIP, FORMAT_VIEWS},
    };

    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char name[2] = {(char)('a' + (char)i), 0};
        const char *folder = scratch_path(*state, name);
        cln_config config = *plain();
        cln_scene *scene = NULL;

        put_folder(*state, name);
        put_scene(folder, cases[i].what, GREY);
        config.masks = CLN_MASKS_ALPHA;
        config.missing = cases[i].missing;
        scene = load(folder, &config);
        assert_true(scene->has_alpha);
        assert_int_equal(scene->view_count, cases[i].views);
        assert_int_equal(scene->missing, FORMAT_VIEWS - cases[i].views);
        for (int v = 0; v < scene->view_count && i > 0; v++)
            assert_int_equal(scene->views[v].channels, 4);
        cln_scene_free(scene);
    }
}

int test_group_cutout(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_kinds, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_values, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_inverted, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_uncut, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_ignore_white, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_partly_inverted, scratch_make, scratch_remove),
        cmocka_unit_test(test_soft),
        cmocka_unit_test_setup_teardown(test_settings, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("cutout", tests, NULL, NULL);
}
