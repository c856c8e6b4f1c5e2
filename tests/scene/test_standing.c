/* Photos that show nothing (scene/photos.h), and what stands in all: logos, bars and round fields
 * are found and become a mask, of one colour with another text, as a round body may be before a
 * backdrop; bodies of other outlines, and photos that hardly differ, have none. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "io/image.h"
#include "scene/photos.h"
#include "scene/standing.h"
#include "scene_fixture.h"
#include "tests.h"

enum { COUNT = 12, WIDE = 96, HIGH = 64 };

typedef enum drawn { NOTHING, LOGO, BARS, FIELD, BODY, SAME, SKY } drawn;

typedef struct photos {
    cln_scene scene;
    cln_view views[COUNT];
    uint8_t pixels[COUNT][WIDE * HIGH * 3];
} photos;

/* Is it drawn there: black, or the logo's stripes? */
static bool is_drawn(drawn what, int view, int x, int y)
{
    const double r = hypot(x - 47.5, y - 31.5);

    switch (what) {
    case LOGO:
        return x >= 70 && x < 90 && y >= 50 && y < 60;
    case SKY:
        return y < 16;
    case BARS:
        return y < 8 || y >= 56;
    case FIELD:
        return r > 30;
    case BODY: /* its outline is another in each photo */
        return r > 24 + 5 * sin(3 * atan2(y - 31.5, x - 47.5) + view);
    default:
        return false;
    }
}

static char folder[] = "my photos";

static photos *draw(drawn what)
{
    photos *p = calloc(1, sizeof *p);

    assert_non_null(p);
    p->scene =
        (cln_scene){.views = p->views, .view_count = COUNT, .folder = folder, .path = folder};
    for (int v = 0; v < COUNT; v++) {
        p->views[v].camera = (cln_camera){.width = WIDE, .height = HIGH};
        p->views[v].camera.c2w[0] = p->views[v].camera.c2w[10] = cos(0.2 * v);
        p->views[v].camera.c2w[2] = sin(0.2 * v);
        p->views[v].camera.c2w[8] = -sin(0.2 * v);
        p->views[v].channels = 3;
        p->views[v].pixels = p->pixels[v];
        for (int i = 0; i < WIDE * HIGH; i++) {
            const int x = i % WIDE, y = i / WIDE, of = what == SAME ? 0 : v;
            const double noise =
                cln_uniform_hash(3, 1, 0, (uint32_t)(x / 3), (uint32_t)of, (uint32_t)(y / 3));
            const double level = !is_drawn(what, v, x, y) ? 20 + 220 * noise
                                 : what == LOGO           ? 100 + 100 * (x / 4 % 2)
                                 : what == SKY            ? 180 + y
                                                          : 0;

            memset(p->pixels[v] + 3 * i, (int)level + v % 3, 3); /* and a little noise */
        }
    }
    return p;
}

static void test_found(void **state)
{
    static const struct {
        drawn what;
        double share;
        const char *where; /* NULL: nothing stands */
        bool plain;
    } cases[] = {
        {NOTHING, 0, NULL, false},
        {LOGO, 200.0 / (WIDE * HIGH), "(bottom right)", false},
        {BARS, 0.25, "(top, bottom)", true},
        {FIELD, 1 - M_PI * 900 / (WIDE * HIGH), "(top left, top right, bottom left, bottom right)",
         true},
        {BODY, 0, NULL, false},
        {SAME, 0, NULL, false},
        {SKY, 0.25, "(top)", true}, /* before cameras that turn it is none */
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        photos *p = draw(cases[i].what);
        cln_standing found;
        char text[CLN_STANDING_BYTES];
        bool plain = false;

        assert_int_equal(cln_scene_find_standing(&p->scene, WIDE, &found), CLN_OK);
        if (!cases[i].where != !found.is)
            fail_msg("case %zu: %s", i, found.is ? found.where : "nothing");
        assert_true(fabs(found.share - cases[i].share) < 0.02);
        assert_int_equal(cln_scene_tell_standing(&p->scene, text, &plain), found.is != NULL);
        assert_int_equal(plain, cases[i].plain);
        assert_int_equal(found.is && strstr(text, "all is well"), plain);
        if (found.is && (!strstr(text, cases[i].where) ||
                         !strstr(text, "check 'my photos' --write-mask 'my photos/masks/all.png'")))
            fail_msg("case %zu: %s", i, text);
        free(found.is);
        /* alpha tells it; of cameras that do not turn only those that pass what they see tell */
        for (int k = 0; k < 3; k++) {
            p->scene.has_alpha = k == 0;
            p->scene.amid = k == 2;
            for (int v = 0; v < COUNT && k == 1; v++)
                p->views[v].camera = p->views[0].camera;
            assert_int_equal(cln_scene_find_standing(&p->scene, WIDE, &found), CLN_OK);
            if (!found.is != (k < 2 || !cases[i].where || cases[i].what == SKY))
                fail_msg("case %zu, %d: %s", i, k, found.is ? found.where : "nothing");
            assert_int_equal(found.one_way, k > 0);
            if (found.is &&
                (fabs(found.share - cases[i].share) > 0.02 || !strstr(cases[i].where, found.where)))
                fail_msg("case %zu: %g %s", i, found.share, found.where);
            free(found.is);
        }
        free(p);
    }
}

/* The mask drops what stands and little around it, in a folder that was not there. */
static void test_mask(void **state)
{
    const char *path = scratch_path(*state, "masks/all.png");
    photos *p = draw(LOGO), *other = draw(NOTHING);
    int width = 0, height = 0, channels = 0, wrong = 0, wider = 0;
    uint8_t *mask = NULL;

    assert_int_equal(cln_scene_write_standing(&other->scene, path), CLN_INPUT);
    assert_int_equal(cln_scene_write_standing(&p->scene, path), CLN_OK);
    assert_int_equal(cln_image_load(path, &width, &height, &channels, &mask), CLN_OK);
    assert_int_equal(width, WIDE);
    assert_int_equal(height, HIGH);
    for (int i = 0; i < WIDE * HIGH; i++) {
        const bool logo = is_drawn(LOGO, 0, i % WIDE, i / WIDE);

        wrong += logo && mask[channels * i] != 0;
        wider += !logo && mask[channels * i] == 0;
    }
    assert_int_equal(wrong, 0);
    assert_in_range(wider, 40, 140);
    free(mask);
    free(p);
    free(other);
}

/* Photos of one colour among others are named, but for noise. */
static void test_blank(void **state)
{
    char text[CLN_BLANK_BYTES];

    (void)state;
    for (int blank = 0; blank < COUNT; blank += 3) {
        static char names[COUNT][8];
        photos *p = draw(NOTHING);

        for (int v = 0; v < COUNT; v++) {
            snprintf(names[v], sizeof names[v], "%d.png", v);
            p->views[v].name = names[v];
        }
        for (int v = 0; v < blank; v++)
            for (int i = 0; i < WIDE * HIGH; i++)
                memset(p->pixels[v] + 3 * i, 100 + i % 5, 3);
        assert_int_equal(cln_scene_has_blank(&p->scene, text), blank > 0 && blank <= COUNT / 2);
        if (blank == 3)
            assert_non_null(strstr(text, "3 of 12 photos show one colour alone, as of a camera "
                                         "that failed: 0.png, 1.png, 2.png. "));
        free(p);
    }
}

/* Photos that are of one colour in all are refused for training; not those of several, each of one
 * alone, nor with depth images, nor where test photos alone are blank. */
static void test_shown(void **state)
{
    static char depth[] = "depth.png";

    (void)state;
    for (int i = 0; i < 5; i++) {
        photos *p = draw(NOTHING);

        for (int v = 0; v < COUNT; v++) {
            p->views[v].split = i == 4 && v < 6 ? CLN_SPLIT_TRAIN : CLN_SPLIT_TEST;
            if (i < 4)
                p->views[v].split = CLN_SPLIT_TRAIN;
            if (i == 2 && v == 7)
                p->views[v].depth.depth = depth;
            for (int k = 0; k < WIDE * HIGH && (i < 4 || v >= 6); k++)
                memset(p->pixels[v] + 3 * k, 3 + k % 5 + (i == 1 ? v : 0), 3);
            if (i == 3) /* one pixel of one photo */
                p->pixels[5][3 * WIDE * HIGH - 1] = 14;
        }
        assert_int_equal(cln_scene_check_shown(&p->scene), i == 0 ? CLN_INPUT : CLN_OK);
        free(p);
    }
}

int test_group_standing(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_found),
        cmocka_unit_test(test_blank),
        cmocka_unit_test(test_shown),
        cmocka_unit_test_setup_teardown(test_mask, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("standing", tests, NULL, NULL);
}
