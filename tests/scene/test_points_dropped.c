/* Sparse points that masks drop in all their photos do not widen the cube. Oracle: points on rays
 * of known cameras, near and far. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "format_fixture.h"
#include "scene/build.h"
#include "tests.h"

enum { HERE = 120, AWAY = 40, LEFT = 6 };

/* A point of view 0, on the ray of a pixel's middle. */
static cln_point point_at(const cln_camera *camera, int x, int y, double distance, int views)
{
    cln_point p = {.rgb = {1, 2, 3}, .views = views};
    double o[3], d[3];

    assert_true(cln_camera_ray(camera, x + 0.5, y + 0.5, o, d));
    for (int a = 0; a < 3; a++)
        p.xyz[a] = o[a] + distance * d[a];
    return p;
}

/* Black to the left of column `from`. */
static void put_mask(const char *folder, const char *name, int from)
{
    uint8_t pixels[FORMAT_WIDTH * FORMAT_HEIGHT];

    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        pixels[i] = i % FORMAT_WIDTH >= from ? 255 : 0;
    put_folder(folder, "masks");
    assert_int_equal(
        cln_image_write_png(scratch_path(folder, name), FORMAT_WIDTH, FORMAT_HEIGHT, 1, pixels),
        CLN_OK);
}

#define SOME "120 sparse points that masks do not drop"
#define ALL  "160 sparse points and"

static void test_cube(void **state)
{
    static const struct {
        const char *mask; /* NULL: none */
        int from, far_views, downscale, here;
        const char *rule;
        bool small;
    } rows[] = {
        {NULL, 0, 1, 1, HERE, ALL, false},
        {"masks/all.png", LEFT, 1, 1, HERE, SOME, true},
        {"masks/all.png", LEFT, 1, 2, HERE, SOME, true},
        {"masks/view_00.png.png", LEFT, 1, 1, HERE, SOME, true},
        {"masks/view_01.png.png", LEFT, 1, 1, HERE, ALL, false}, /* of another photo */
        {"masks/all.png", 1, 1, 1, HERE, ALL, false},        /* farther to the left than they are */
        {"masks/all.png", LEFT, 0, 1, HERE, ALL, false},     /* found nobody knows where */
        {"masks/all.png", LEFT, 1, 1, 15, "cameras", true}}; /* too few are left */

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char name[32];
        const char *folder = NULL;
        cln_camera cameras[FORMAT_VIEWS];
        cln_point points[HERE + AWAY];
        cln_config config = *plain();
        cln_scene *scene = NULL;

        snprintf(name, sizeof name, "%d", (int)i);
        folder = scratch_path(*state, name);
        format_cameras(cameras);
        for (int k = 0; k < HERE; k++)
            points[k] = point_at(&cameras[0], 8 + k % 7, 2 + k / 7 % 8, 4 + 0.01 * k, 1);
        for (int k = 0; k < AWAY; k++)
            points[rows[i].here + k] =
                point_at(&cameras[0], 2 + k % 3, 2 + k % 8, 300 + k, rows[i].far_views);
        format_images(scratch_path(folder, "images"), 1);
        format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points,
                      rows[i].here + AWAY);
        if (rows[i].mask)
            put_mask(folder, rows[i].mask, rows[i].from);
        config.downscale = rows[i].downscale;
        config.masks = CLN_MASKS_IGNORE;
        scene = load(folder, &config);
        if (!strstr(scene->bounds_rule, rows[i].rule))
            fail_msg("row %d: %s", (int)i, scene->bounds_rule);
        if (rows[i].small != (scene->space.half < 20))
            fail_msg("row %d: half side %g", (int)i, scene->space.half);
        cln_scene_free(scene);
    }
}

/* ---- the points alone ---- */

enum { MANY = 17, POINTS = 3 }; /* more masks than are read; points on columns 2, 10 and 13 */

typedef struct seen {
    cln_view views[MANY];
    cln_scene scene;
    cln_point points[POINTS];
    cln_observation observations[4];
    cln_reader_result result;
    char path[MANY][600];
} seen;

/* Views from one place, each with the mask of its name in the folder, or none. */
static seen *make_seen(const char *folder, const char *const *masks, int count)
{
    seen *s = calloc(1, sizeof *s);

    assert_non_null(s);
    for (int i = 0; i < count; i++) {
        cln_view *view = &s->views[i];

        view->camera = (cln_camera){.width = FORMAT_WIDTH,
                                    .height = FORMAT_HEIGHT,
                                    .fx = FORMAT_WIDTH,
                                    .fy = FORMAT_WIDTH,
                                    .cx = FORMAT_WIDTH / 2.0,
                                    .cy = FORMAT_HEIGHT / 2.0,
                                    .c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
        view->file_width = FORMAT_WIDTH;
        view->file_height = FORMAT_HEIGHT;
        view->downscale = view->mask_turn = view->mask_least = 1;
        view->number = i;
        snprintf(s->path[i], sizeof s->path[i], "%s",
                 masks[i] ? scratch_path(folder, masks[i]) : "");
        view->mask_path = masks[i] ? s->path[i] : NULL;
    }
    for (int i = 0; i < POINTS; i++)
        s->points[i] = point_at(&s->views[0].camera, (const int[]){2, 10, 13}[i], 5, 2, 1);
    s->scene = (cln_scene){.views = s->views, .view_count = count};
    s->result = (cln_reader_result){
        .points = s->points, .point_count = POINTS, .observations = s->observations};
    return s;
}

static void observe(seen *s, int point, int view)
{
    s->observations[s->result.observation_count++] = (cln_observation){point, view};
}

/* Frees it. Which points are dropped, "-" for one that is not; "" if none was looked at. */
static const char *dropped(seen *s)
{
    static char told[POINTS + 1];
    int count = 0;

    assert_int_equal(cln_scene_drop_points(&s->scene, &s->result), CLN_OK);
    told[0] = told[POINTS] = 0;
    for (int i = 0; i < POINTS && s->result.dropped; i++) {
        told[i] = s->result.dropped[i] ? (char)('0' + i) : '-';
        count += s->result.dropped[i];
    }
    assert_int_equal(s->result.dropped_count, count);
    free(s->result.dropped);
    free(s);
    return told;
}

/* A point that masks drop in one of its photos alone is kept; each photo has its own mask. */
static void test_all_photos(void **state)
{
    const char *folder = *state, *const masks[] = {"masks/all.png", "masks/left.png", NULL,
                                                   "masks/left.png"};
    seen *s = NULL;

    put_mask(folder, "masks/all.png", 0);
    put_mask(folder, "masks/left.png", LEFT);
    s = make_seen(folder, masks, 4);
    observe(s, 0, 1);
    observe(s, 0, 3);
    assert_string_equal(dropped(s), "0--");
    s = make_seen(folder, masks, 4);
    observe(s, 0, 1);
    observe(s, 0, 0);
    assert_string_equal(dropped(s), "---");
    s = make_seen(folder, masks, 4);
    observe(s, 0, 2);
    observe(s, 0, 1);
    observe(s, 1, 1);
    assert_string_equal(dropped(s), "---");
    s = make_seen(folder, masks, 4); /* of a photo that was left out nobody knows */
    s->scene.missing = 1;
    for (int i = 0; i < 4; i++)
        s->views[i].number = i + 1;
    observe(s, 0, 2);
    observe(s, 1, 0);
    assert_string_equal(dropped(s), "0--");
}

/* One file that is read in two ways is two masks. */
static void test_read_otherwise(void **state)
{
    enum { W = FORMAT_WIDTH, H = FORMAT_HEIGHT };
    const char *folder = *state, *const masks[] = {"masks/grey.png", "masks/grey.png"};
    uint8_t pixels[W * H];
    static const struct {
        int turn, least, downscale, width;
        bool black;
        int point;
        const char *told;
    } rows[] = {{3, 1, 1, W, false, 2, "--2"},   /* upside down: its right side is black */
                {1, 128, 1, W, false, 1, "-1-"}, /* grey is black, too */
                {1, 1, 1, W, true, 1, "-1-"},    /* black is what counts */
                {1, 1, 2, W, false, 1, "---"},   /* in a smaller picture at column 5 */
                {1, 1, 1, 2 * W, false, 1, "---"}};

    put_folder(folder, "masks");
    for (int i = 0; i < W * H; i++)
        pixels[i] = i % W < LEFT ? 0 : i % W < 12 ? 60 : 255;
    assert_int_equal(cln_image_write_png(scratch_path(folder, masks[0]), W, H, 1, pixels), CLN_OK);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        seen *s = make_seen(folder, masks, 2);
        cln_view *view = &s->views[1];

        view->mask_turn = rows[i].turn;
        view->mask_least = rows[i].least;
        view->mask_black = rows[i].black;
        view->downscale = rows[i].downscale;
        view->file_width = rows[i].width;
        view->file_height = rows[i].width * H / W;
        view->camera.width = rows[i].width / rows[i].downscale;
        view->camera.height = view->file_height / rows[i].downscale;
        view->camera.fx = view->camera.fy = view->camera.width;
        view->camera.cx = view->camera.width / 2.0;
        view->camera.cy = view->camera.height / 2.0;
        observe(s, rows[i].point, 1);
        if (strcmp(dropped(s), rows[i].told) != 0)
            fail_msg("row %d", (int)i);
    }
}

/* 16 masks are read, 17 are not, nor any if one of them cannot be. */
static void test_many_masks(void **state)
{
    const char *folder = *state, *masks[MANY];
    char names[MANY][32];
    seen *s = NULL;

    for (int i = 0; i < MANY; i++) {
        snprintf(names[i], sizeof names[i], "masks/%d.png", i);
        put_mask(folder, names[i], i == MANY - 2 ? LEFT : 0);
        masks[i] = names[i];
    }
    s = make_seen(folder, masks, MANY - 1);
    observe(s, 0, MANY - 2);
    assert_string_equal(dropped(s), "0--");
    s = make_seen(folder, masks, MANY);
    observe(s, 0, MANY - 2);
    assert_string_equal(dropped(s), "");
    put_text(folder, "masks/3.png", "no picture");
    s = make_seen(folder, masks, MANY - 1);
    observe(s, 0, MANY - 2);
    assert_string_equal(dropped(s), "");
    assert_string_equal(cln_error_text(), "");
}

int test_group_points_dropped(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_all_photos, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_read_otherwise, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_many_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_cube, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("points_dropped", tests, NULL, NULL);
}
