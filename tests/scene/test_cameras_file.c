/* A run's cameras.json (scene/cameras_file.h): there and back to the bit, by the scene that was
 * written; and what is refused. */
#include "unit.h"
#include <string.h>
#include "outcome.h"
#include "scene/cameras_file.h"
#include "scene_fixture.h"
#include "tests.h"

/* Rotations and places whose numbers need all their digits. */
#define POSE_A "[[0.8,0,0.6,0.1],[0,1,0,0.3333333333333333],[-0.6,0,0.8,4],[0,0,0,1]]"
#define POSE_B "[[0.28,0.96,0,1e-9],[-0.96,0.28,0,-2],[0,0,1,3.9999999999999996],[0,0,0,1]]"

#define SHOT(file, more, pose) "{\"file_path\":\"" file "\"," more "\"transform_matrix\":" pose "}"

/* Five views: of two sizes and lenses, in two splits, with masks, alpha, and a photo elsewhere. */
static cln_scene *make_scene(const char *folder)
{
    static const char masked[] = SHOT("a.png", "\"mask_path\":\"masks/a.png\",", POSE_A);
    static const char clear[] = SHOT("b.png", "\"alpha_path\":\"masks/b.png\",", POSE_B);
    static const char pinhole[] =
        SHOT("c.png", "\"w\":16,\"h\":16,\"k1\":0,\"k2\":0,\"p1\":0,\"fl_x\":17.9,", POSE_A);
    static const char outside[] = SHOT("../else/d.png", "", POSE_B);
    cln_config config = default_config();
    char *text = NULL;

    config.downscale = 2;
    put_folder(folder, "set/masks");
    put_folder(folder, "else");
    put_folder(folder, "run");
    put_image(folder, "set/a.png", 21, 13, 3, 1);
    put_image(folder, "set/b.png", 21, 13, 3, 2);
    put_image(folder, "set/c.png", 16, 16, 3, 3);
    put_image(folder, "set/masks/a.png", 21, 13, 3, 4);
    put_image(folder, "set/masks/b.png", 21, 13, 3, 5);
    put_image(folder, "else/d.png", 21, 13, 3, 6);
    put_image(folder, "set/e.png", 21, 13, 3, 7);
    assert_ok(cln_asprintf(
        &text,
        "{\"fl_x\":20.1,\"fl_y\":20.3,\"cx\":10.7,\"cy\":6.1,\"k1\":0.1,\"k2\":-0.013,"
        "\"p1\":0.0007,\"aabb_scale\":1,\"frames\":[%s,%s,%s,%s,%s],\"train_filenames\":[\"a.png\","
        "\"b.png\",\"c.png\"],\"test_filenames\":[\"../else/d.png\",\"e.png\"]}",
        masked, clear, pinhole, outside, FRAME("e.png", POSE_FRONT)));
    put_text(folder, "set/transforms.json", text);
    free(text);
    return load(scratch_path(folder, "set"), &config);
}

static void assert_same_text(const char *a, const char *b)
{
    if (!a || !b || strcmp(a, b) != 0)
        fail_msg("'%s' is not '%s'", a ? a : "NULL", b ? b : "NULL");
}

/* Paths from the scene's folder are the same. */
static void assert_same_path(const cln_scene *scene, const char *path, const cln_scene *other,
                             const char *its)
{
    char *a = NULL, *b = NULL;

    assert_int_equal(path == NULL, its == NULL);
    if (!path)
        return;
    assert_ok(cln_scene_path_from(scene, path, &a));
    assert_ok(cln_scene_path_from(other, its, &b));
    assert_same_text(a, b);
    free(a);
    free(b);
}

static void assert_same_view(const cln_scene *scene, const cln_scene *other, int i)
{
    const cln_view *v = &scene->views[i], *w = &other->views[i];

    assert_same_text(v->name, w->name);
    assert_same_text(v->file, w->file);
    assert_same_path(scene, v->path, other, w->path);
    assert_same_path(scene, v->alpha_path, other, w->alpha_path);
    assert_same_path(scene, v->mask_path, other, w->mask_path);
    assert_memory_equal(v->camera.c2w, w->camera.c2w, sizeof v->camera.c2w);
    assert_true(cln_camera_is_like(&v->camera, &w->camera));
    assert_int_equal(v->split, w->split);
    assert_int_equal(v->file_width, w->file_width);
    assert_int_equal(v->file_height, w->file_height);
    assert_int_equal(v->downscale, w->downscale);
    assert_int_equal(v->leads_out, w->leads_out);
    assert_int_equal(v->turned, w->turned);
    assert_int_equal(v->trained, w->trained);
    assert_int_equal(v->orientation, w->orientation);
    assert_int_equal(v->edge, w->edge);
    assert_true(v->disc == w->disc && v->multiplied == w->multiplied);
    assert_int_equal(cln_view_turn(v), cln_view_turn(w));
    assert_int_equal(v->mask_path && v->mask_black, w->mask_black);
    assert_true(v->alpha_mask == w->alpha_mask && v->alpha_black == w->alpha_black);
    assert_false(cln_view_is_loaded(w));
}

static void test_there_and_back(void **state)
{
    const char *folder = *state, *run = scratch_path(folder, "run");
    cln_scene *scene = make_scene(folder), *back = NULL;
    int lenses = 0, alphas = 0, masks = 0, out = 0;

    assert_int_equal(scene->view_count, 5);
    scene->views[1].turned = true; /* as if EXIF data had said so */
    scene->views[1].orientation = 8;
    scene->views[2].orientation = 6;
    assert_non_null(scene->views[1].alpha_path);
    scene->views[1].alpha_mask = scene->views[1].alpha_black = true; /* as --masks inverted does */
    assert_non_null(scene->views[0].mask_path);
    scene->views[0].mask_black = true;
    scene->views[1].edge = 15;
    scene->views[2].disc = 0.4375;
    scene->views[3].multiplied = true;
    scene->views[0].mask_black = true; /* as by --masks inverted */
    assert_int_not_equal(scene->views[4].split, CLN_SPLIT_TRAIN);
    scene->views[4].trained = true; /* as if by an earlier split */
    assert_ok(cln_cameras_write(run, scene, NULL));
    assert_ok(cln_cameras_read(run, &back));
    assert_int_equal(back->view_count, 5);
    for (int i = 0; i < 5; i++) {
        const cln_view *v = &back->views[i];

        assert_same_view(scene, back, i);
        assert_true(v->digest && v->digest == scene->views[i].digest);
        lenses += cln_camera_is_distorted(&v->camera);
        alphas += v->alpha_path != NULL;
        masks += v->mask_path != NULL;
        out += v->leads_out;
    }
    assert_int_equal(lenses, 4); /* the scene has what this test is about */
    assert_true(alphas == 1 && masks == 1 && out == 1);
    assert_int_equal(back->lenses, scene->lenses);
    assert_int_equal(back->downscale, scene->downscale);
    assert_int_equal(back->downscale_least, scene->downscale_least);
    assert_true(back->digest == scene->digest);
    assert_same_text(back->split_rule, scene->split_rule);
    assert_int_equal(back->has_box, scene->has_box);
    if (scene->has_box)
        assert_memory_equal(back->box, scene->box, sizeof back->box);
    cln_scene_free(back);
    cln_scene_free(scene);
}

/* The poses of training views can be others: those before training moved them. */
static void test_given(void **state)
{
    const char *folder = *state, *run = scratch_path(folder, "run");
    cln_scene *scene = make_scene(folder), *back = NULL;
    double given[3][12];

    for (int i = 0; i < 3; i++) {
        memcpy(given[i], cln_scene_training_view(scene, i)->camera.c2w, sizeof given[i]);
        cln_scene_training_view(scene, i)->camera.c2w[3] += 1;
    }
    assert_ok(cln_cameras_write(run, scene, (const double(*)[12])given));
    assert_ok(cln_cameras_read(run, &back));
    for (int i = 0; i < 3; i++)
        assert_memory_equal(cln_scene_training_view(back, i)->camera.c2w, given[i],
                            sizeof given[i]);
    for (int i = 3; i < 5; i++)
        assert_memory_equal(back->views[i].camera.c2w, scene->views[i].camera.c2w, sizeof given[0]);
    cln_scene_free(back);
    cln_scene_free(scene);
}

/* The file with `from` replaced by `to`, once; NULL: cut there. */
static void put_changed(const char *path, const char *text, const char *from, const char *to)
{
    const char *at = strstr(text, from);
    char *changed = NULL;

    if (!at)
        fail_msg("'%s' is not in the file", from);
    assert_ok(cln_asprintf(&changed, "%.*s%s%s", (int)(at - text), text, to ? to : "",
                           to ? at + strlen(from) : ""));
    scratch_put(path, changed, strlen(changed));
    free(changed);
}

static void test_refused(void **state)
{
    const char *folder = *state, *run = scratch_path(folder, "run");
    const char *path = scratch_path(folder, "run/cameras.json");
    static const struct {
        const char *from, *to, *words;
    } rows[] = {
        {"cameras/1", "cameras/2", "its schema is cl-nascent.cameras/2, not"},
        {"\"schema\"", "\"scheme\"", "its schema is not named"},
        {"\"folder\"", "\"holder\"", "its folder, digest or box is damaged; copy"},
        {"\"digest\": \"", "\"digest\": \"x", "its folder, digest or box is damaged"},
        {"\"digest\": \"", "\"digest\": \"0", "its folder, digest or box is damaged"},
        {"\"views\"", NULL, "line "},
        {"\"views\"", "\"nothing\"", "it has 0 views and"},
        {"\"cameras\"", "\"nothing\"", "and 0 cameras; copy"},
        {"\"width\":", "\"width\":-", "cameras[0]: 'width'"},
        {"\"width\":", "\"width\":9999999", "cameras[0]: 'width'"},
        {"\"downscale\":2", "\"downscale\":2.5", "cameras[0]: 'downscale'"},
        {"\"downscale\":2", "\"downscale\":64", ""},
        {"\"downscale\":2", "\"downscale\":65", "cameras[0]: 'downscale'"},
        {"\"cx\"", "\"cz\"", "cameras[0]: 'cx'"},
        {"\"lens\":\"OPENCV\"", "\"lens\":\"MONOCLE\"", "cameras[0]: 'lens'"},
        {"\"params\":[", "\"params\":[1,", "cameras[0]: 'params'"},
        {"\"params\":[", "\"params\":[1e9],\"x\":[", "cameras[0]: 'params'"},
        {"\"fx\":", "\"fx\":-", "fl_x"},
        {"\"name\":\"a.png\"", "\"name\":\"\"", "views[0]: 'name'"},
        {"\"split\":\"train\"", "\"split\":\"trial\"", "views[0]: 'split'"},
        {"\"split\":\"train\"", "\"split\":\"test\"", "views[0]: 'split'"},
        {"\"split\":\"test\"", "\"split\":\"train\"", ""},
        {"\"camera\":0", "\"camera\":5", "views[0]: 'camera'"},
        {"\"camera\":0", "\"camera\":-1", "views[0]: 'camera'"},
        {"\"pose\":[", "\"pose\":[0,", "views[0]: 'pose'"},
        {"\"pose\":[", "\"pose\":[\"x\"],\"x\":[", "views[0]: 'pose'"},
        {"\"pose\":[", "\"pose\":[2,0,0,0,0,2,0,0,0,0,2,0],\"x\":[", "not rigid"},
    };
    cln_scene *scene = make_scene(folder), *back = NULL;
    char *text = NULL;
    size_t bytes = 0;

    assert_fails(cln_cameras_read(run, &back), CLN_INPUT, "cameras.json");
    assert_ok(cln_cameras_write(run, scene, NULL));
    assert_ok(cln_read_file(path, 1 << 20, &text, &bytes));
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        put_changed(path, text, rows[i].from, rows[i].to);
        if (!*rows[i].words) {
            assert_ok(cln_cameras_read(run, &back));
            cln_scene_free(back);
            continue;
        }
        back = scene;
        assert_fails(cln_cameras_read(run, &back), CLN_INPUT, rows[i].words);
        assert_null(back);
    }
    free(text);
    cln_scene_free(scene);
}

int test_group_cameras_file(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_there_and_back, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_given, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refused, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("cameras file", tests, NULL, NULL);
}
