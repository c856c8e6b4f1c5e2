/* --test-views: a list of names decides which photos are test, in every format; what a name may be,
 * and what is said of lists that are not right. A run keeps what a list said, and what every Nth
 * (--holdout) was; what became of its photos and poses since it began. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "format_fixture.h"
#include "tests.h"

/* The settings with this list, which is written beside the scene. */
static cln_config with_list(const char *folder, const char *text)
{
    cln_config config = default_config();
    const char *path = scratch_path(folder, "list.txt");

    put_text(folder, "list.txt", text);
    snprintf(config.test_views, sizeof config.test_views, "%s", path);
    return config;
}

/* The names of a split's views, each with a blank behind it. */
static const char *names_of(const cln_scene *scene, cln_split split)
{
    static char names[1024];

    names[0] = 0;
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].split == split)
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s ",
                     scene->views[i].name);
    return names;
}

static const char *tests_of(const cln_scene *scene)
{
    return names_of(scene, CLN_SPLIT_TEST);
}

#define BEGIN "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":["

/* Photos of two folders, two of them of one name. */
static void put_scene(const char *folder)
{
    put_folder(folder, "left");
    put_folder(folder, "right");
    put_image(folder, "left/a.png", 4, 4, 3, 1);
    put_image(folder, "left/b 1.png", 4, 4, 3, 2);
    put_image(folder, "right/a.png", 4, 4, 3, 3);
    put_image(folder, "right/c.0.png", 4, 4, 3, 4);
    put_image(folder, "a.png", 4, 4, 3, 5);
    put_text(
        folder, "transforms.json",
        BEGIN FRAME("left/a.png", POSE_FRONT) "," FRAME("left/b 1.png", POSE_FRONT) "," FRAME(
            "./right/a.png", POSE_FRONT) "," FRAME("right/c.0",
                                                   POSE_FRONT) "," FRAME("a.png", POSE_FRONT) "]}");
}

static void test_names(void **state)
{
    static const struct {
        const char *list, *tests;
    } rows[] = {
        {"left/a.png\n", "left/a.png "},
        {"left/a", "left/a.png "},
        {"./left/a.png", "left/a.png "},
        {"b 1.png", "left/b 1.png "}, /* the file alone */
        {"  b 1\t\r\n", "left/b 1.png "},
        {"right/c.0", "right/c.0 "}, /* the dataset names it without ending */
        {"c.0.png", "right/c.0 "},
        {"c.0", "right/c.0 "},
        {"a.png", "a.png "}, /* a whole name goes before the files of others */
        {"a", "a.png "},
        {"\xEF\xBB\xBF# of a paper\n\nleft/a.png # one\r\nright/a.png\nleft/a\n",
         "left/a.png right/a.png "},
        {"\"left/a.png\";;\r\nright/a.png,,\r\n", "left/a.png right/a.png "}, /* a table's */
    };
    const char *folder = *state;
    cln_scene *scene = NULL;
    cln_config config;

    put_scene(folder);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        config = with_list(folder, rows[i].list);
        scene = load(folder, &config);
        if (strcmp(tests_of(scene), rows[i].tests) != 0)
            fail_msg("'%s': test views are %s", rows[i].list, tests_of(scene));
        assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_VAL), 0);
        assert_non_null(strstr(scene->split_rule, i < 10 ? "1 image that " : "2 images that "));
        assert_non_null(strstr(scene->split_rule, "list.txt names"));
        assert_false(scene->has_splits);
        cln_scene_free(scene);
    }
    config = with_list(folder, "");
    snprintf(config.test_views, sizeof config.test_views, "%s", folder); /* as a shell has it */
    assert_refused(folder, &config, (const char *const[3]){"is a folder", NULL}, "a folder");
    config = with_list(folder, scratch_path(folder, "right/a.png"));
    scene = load(folder, &config);
    assert_string_equal(tests_of(scene), "right/a.png ");
    cln_scene_free(scene);
}

/* --train-views: what is neither test nor named is val, also in a run that goes on. */
static void test_trained(void **state)
{
    static cln_view views[] = {{.name = "left/a.png", .split = CLN_SPLIT_VAL},
                               {.name = "right/a.png", .split = CLN_SPLIT_TEST},
                               {.name = "left/b 1.png", .split = CLN_SPLIT_TRAIN}};
    const cln_scene kept = {.views = views, .view_count = 3, .split_rule = "a list's"};
    const char *folder = *state;
    cln_config config = with_list(folder, "right/a");
    const cln_scene_desc desc = {.path = folder, .config = &config, .kept = &kept};
    cln_scene *scene = NULL;

    put_scene(folder);
    put_text(folder, "train.txt", "c.0\nleft/a\n");
    snprintf(config.train_views, sizeof config.train_views, "%s",
             scratch_path(folder, "train.txt"));
    scene = load(folder, &config);
    assert_string_equal(tests_of(scene), "right/a.png ");
    assert_string_equal(names_of(scene, CLN_SPLIT_TRAIN), "left/a.png right/c.0 ");
    assert_string_equal(names_of(scene, CLN_SPLIT_VAL), "a.png left/b 1.png ");
    assert_non_null(strstr(scene->split_rule, "1 image that "));
    assert_non_null(strstr(scene->split_rule, "; of the others 2 that "));
    cln_scene_free(scene);
    assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
    assert_string_equal(tests_of(scene), "right/a.png ");
    assert_string_equal(names_of(scene, CLN_SPLIT_TRAIN), "left/b 1.png ");
    cln_scene_free(scene);
    put_text(folder, "train.txt", "c.0\nright/a.png\n");
    assert_refused(folder, &config,
                   (const char *const[3]){"'right/a.png', which is a test view", "--test-views"},
                   "a test view that trains");
    put_text(folder, "train.txt", "# none\n");
    assert_refused(folder, &config, (const char *const[3]){"no training photo", "--train-views"},
                   "an empty list");
    config.test_views[0] = 0; /* where the dataset names splits, it leaves some of them out, too */
    put_text(folder, "train.txt", "left/b 1");
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"test_filenames\":[\"left/a.png\"],"
             "\"train_filenames\":[\"right/a.png\",\"left/b 1.png\"],\"frames\":[" FRAME(
                 "left/a.png", POSE_FRONT) "," FRAME("left/b 1.png",
                                                     POSE_FRONT) "," FRAME("right/a.png",
                                                                           POSE_FRONT) "]}");
    scene = load(folder, &config);
    assert_string_equal(names_of(scene, CLN_SPLIT_TRAIN), "left/b 1.png ");
    assert_string_equal(names_of(scene, CLN_SPLIT_VAL), "right/a.png ");
    cln_scene_free(scene);
}

static void test_wrong_lists(void **state)
{
    static const struct {
        const char *list, *words[3];
    } rows[] = {
        {"left/a.png\nleft/d.png\n\nx\n",
         {"2 of its 3 names are of no photo", "'left/d.png' (line 2), 'x' (line 4);",
          "'left/a.png', 'left/b 1.png', 'right/a.png', ..."}},
        {"b\nd\ne\n f\n", {"4 of its 4", "'b' (line 1), 'd' (line 2), 'e' (line 3), ...;"}},
        {"left/A.png", {"1 of its 1 names is of no photo", "'left/A.png' (line 1)"}},
        {"# none\n\n", {"it names no test photo", "--holdout 0"}},
        {"", {"it names no test photo"}},
        {"a.png\nleft/a\nright/a\nb 1\nc.0",
         {"no training view among 5", "--test-views", "name fewer"}},
    };
    const char *folder = *state;
    cln_config config;

    put_scene(folder);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        config = with_list(folder, rows[i].list);
        assert_refused(folder, &config, rows[i].words, rows[i].list);
    }
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "left/a.png", POSE_FRONT) "," FRAME("left/b 1.png",
                                                     POSE_FRONT) "," FRAME("right/a.png",
                                                                           POSE_FRONT) "]}");
    config = with_list(folder, "b 1\na.png");
    assert_refused(folder, &config,
                   (const char *const[3]){"1 of its 2 names is of several", "'a.png' (line 2)",
                                          "'left/a.png', 'right/a.png'"},
                   "a name of two");
    put_text(
        folder, "transforms.json",
        "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"test_filenames\":[\"left/a.png\"],"
        "\"frames\":[" FRAME("left/a.png", POSE_FRONT) "," FRAME("left/b 1.png", POSE_FRONT) "]}");
    config = with_list(folder, "b 1");
    assert_refused(folder, &config,
                   (const char *const[3]){"which views train and which are test", "leave it out"},
                   "a dataset with splits");
}

/* What a run keeps goes before the list, which need not be there; of another scene, what is there
 * of it counts. */
static void test_kept(void **state)
{
    static cln_view views[] = {{.name = "left/a.png", .split = CLN_SPLIT_TRAIN},
                               {.name = "right/a.png", .split = CLN_SPLIT_TEST},
                               {.name = "b 1", .split = CLN_SPLIT_TEST}, /* no whole name */
                               {.name = "gone.png", .split = CLN_SPLIT_TEST}};
    const cln_scene kept = {.views = views, .view_count = 4, .split_rule = "a list's"};
    const char *folder = *state;
    cln_config config = default_config();
    const cln_scene_desc desc = {.path = folder, .config = &config, .kept = &kept};
    cln_scene *scene = NULL;

    put_scene(folder);
    snprintf(config.test_views, sizeof config.test_views, "/nowhere/list.txt");
    assert_refused(folder, &config, (const char *const[3]){"/nowhere/list.txt", NULL}, "no list");
    if (cln_scene_load(&desc, &scene) != CLN_OK)
        fail_msg("%s", cln_error_text());
    assert_string_equal(tests_of(scene), "right/a.png ");
    assert_non_null(strstr(scene->split_rule, "/nowhere/list.txt"));
    cln_scene_free(scene);
    /* a dataset that has splits by now keeps these */
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"test_filenames\":[\"left/a.png\"],"
             "\"train_filenames\":[\"right/a.png\"],\"frames\":[" FRAME(
                 "left/a.png", POSE_FRONT) "," FRAME("right/a.png", POSE_FRONT) "]}");
    assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
    assert_string_equal(tests_of(scene), "left/a.png ");
    cln_scene_free(scene);
}

enum { WARNING_BYTES = 1024 };

static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN && strstr(line, "was trained on"))
        snprintf(user, WARNING_BYTES, "%s", line);
}

#define HALF "1 in 2 images by name, from the first, is test (--holdout)"

/* Every Nth photo is another one once photos came or went: those of a run stay what they were. By
 * another rule, what it was trained on is told, and not forgotten. */
static void test_counted(void **state)
{
    static cln_view views[] = {{.name = "left/a.png", .split = CLN_SPLIT_TEST},
                               {.name = "left/b 1.png", .split = CLN_SPLIT_TRAIN},
                               {.name = "right/a.png", .split = CLN_SPLIT_TEST},
                               {.name = "gone.png", .split = CLN_SPLIT_TRAIN}};
    static char plain[] = HALF, again[] = HALF ", of the photos that the run began with",
                other[] = "1 in 3 images";
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene kept = {.views = views, .view_count = 4};
    const cln_scene_desc desc = {.path = folder, .config = &config, .kept = &kept};
    const struct {
        char *rule;
        bool trained; /* all of the run's, long ago */
        bool turned;  /* its cameras, by a quarter */
        const char *tests, *told, *warned;
    } rows[] = {
        {plain, false, false, "left/a.png right/a.png ", again, ""},
        {again, false, false, "left/a.png right/a.png ", again, ""},
        {other, false, false, "a.png left/b 1.png right/c.0 ", HALF,
         "trained on 1 of its 3 test photos ('left/b 1.png')"},
        {plain, true, false, "left/a.png right/a.png ", again, "trained on 2 of its 2"},
        {plain, false, true, "a.png left/b 1.png right/c.0 ", HALF, ""}}; /* another scene */
    cln_scene *scene = NULL;
    char warning[WARNING_BYTES];

    put_scene(folder);
    config.holdout = 2;
    scene = load(folder, &config);
    assert_string_equal(tests_of(scene), "a.png left/b 1.png right/c.0 ");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_scene *now = NULL;

        kept.split_rule = rows[i].rule;
        for (int v = 0; v < 4; v++) {
            views[v].trained = rows[i].trained;
            views[v].camera = scene->views[0].camera;
            for (int k = 0; k < 3 && rows[i].turned; k++) {
                views[v].camera.c2w[k] = -scene->views[0].camera.c2w[4 + k];
                views[v].camera.c2w[4 + k] = scene->views[0].camera.c2w[k];
            }
        }
        warning[0] = 0;
        cln_log_set_sink(keep_warning, warning);
        assert_int_equal(cln_scene_load(&desc, &now), CLN_OK);
        cln_log_set_sink(NULL, NULL);
        assert_string_equal(tests_of(now), rows[i].tests);
        assert_string_equal(now->split_rule, rows[i].told);
        assert_int_equal(warning[0] != 0, rows[i].warned[0] != 0);
        assert_non_null(strstr(warning, rows[i].warned));
        cln_scene_free(now);
    }
    cln_scene_free(scene);
}

/* Poses of a run's photos since it began: medians of the shift, by how far cameras are from their
 * middle, and of the turn. */
static void test_moved(void **state)
{
    static char names[5][8] = {"a", "b", "c", "d", "new"};
    static const struct {
        double shift, degrees;
        bool elsewhere;
    } rows[] = {
        {0, 0, false}, {0.009, 0, false}, {0.011, 0, true}, {0, 0.9, false}, {0, 1.1, true}};
    cln_view were[4] = {{.name = NULL}}, are[5] = {{.name = NULL}};
    const cln_scene kept = {.views = were, .view_count = 4},
                    scene = {.views = are, .view_count = 5};
    cln_since since;

    (void)state;
    for (size_t r = 0; r < sizeof rows / sizeof *rows; r++) {
        const double angle = rows[r].degrees * 3.141592653589793 / 180;

        for (int i = 0; i < 5; i++) {
            const double x = i < 2 ? 100 : -100; /* their middle is at 0 */
            const bool stays = i == 3;           /* one of four does not tell */

            are[i] = (cln_view){.name = names[i], .camera.c2w = {1, 0, 0, x, 0, 1, 0, 7, 0, 0, 1}};
            if (i < 4)
                were[i] = are[i];
            are[i].camera.c2w[11] += stays ? 0 : 100 * rows[r].shift;
            for (int k = 0; k < 2 && !stays; k++) {
                are[i].camera.c2w[5 * k] = cos(angle);
                are[i].camera.c2w[k ? 4 : 1] = (k ? 1 : -1) * sin(angle);
            }
        }
        assert_int_equal(cln_scene_moved_since(&scene, &kept, &since), CLN_OK);
        assert_int_equal(since.known, 4);
        assert_int_equal(since.moved, rows[r].elsewhere ? 3 : 0);
        assert_int_equal(since.elsewhere, rows[r].elsewhere);
        assert_true(fabs(since.shift - rows[r].shift) < 1e-12);
        assert_true(fabs(since.degrees - rows[r].degrees) < 1e-6);
    }
}

/* A few poses that were corrected are no other scene, but are told. */
static void test_few_moved(void **state)
{
    static char names[5][8] = {"a", "b", "c", "d", "e"};
    cln_view were[5] = {{.name = NULL}}, are[5] = {{.name = NULL}};
    const cln_scene kept = {.views = were, .view_count = 5},
                    scene = {.views = are, .view_count = 5};
    char text[CLN_SINCE_BYTES];
    cln_since since;

    (void)state;
    for (int i = 0; i < 5; i++)
        were[i] = are[i] =
            (cln_view){.name = names[i], .camera.c2w = {1, 0, 0, i - 2, 0, 1, 0, 0, 0, 0, 1}};
    are[3].camera.c2w[7] = 0.5;
    assert_int_equal(cln_scene_moved_since(&scene, &kept, &since), CLN_OK);
    assert_false(since.elsewhere);
    cln_since_text(&since, text);
    assert_string_equal(text, "1 of the 5 photos that it knows has another pose ('d')");
    are[1].camera.c2w[11] = -0.5;
    assert_int_equal(cln_scene_moved_since(&scene, &kept, &since), CLN_OK);
    assert_false(since.elsewhere);
    cln_since_text(&since, text);
    assert_string_equal(text, "2 of the 5 photos that it knows have other poses ('b', ...)");
}

/* Photos with other bytes are counted, where both tell theirs, and the first is named: by the
 * scene's order, whatever the run's is. */
static void test_changed(void **state)
{
    static char names[5][8] = {"d", "c", "new", "b", "a"};
    static const uint64_t digests[5] = {1, 2, 3, 4, 0};
    static const struct {
        uint64_t was[5];
        int changed, told;
        const char *first;
    } rows[] = {
        {{1, 2, 0, 4, 9}, 0, 3, NULL},
        {{1, 7, 0, 8, 9}, 2, 3, "c"},
        {{0, 2, 0, 8, 9}, 1, 2, "b"},
        {{6, 7, 0, 8, 9}, 3, 3, "d"},
    };

    (void)state;
    for (size_t r = 0; r < sizeof rows / sizeof *rows; r++) {
        cln_view were[5] = {{.name = NULL}}, are[5] = {{.name = NULL}};
        const cln_scene kept = {.views = were, .view_count = 4},
                        scene = {.views = are, .view_count = 5};
        cln_since since;
        int n = 0;

        for (int i = 0; i < 5; i++)
            are[i] = (cln_view){.name = names[i],
                                .digest = digests[i],
                                .camera.c2w = {1, 0, 0, i, 0, 1, 0, 0, 0, 0, 1}};
        for (int i = 4; i >= 0; i--)
            if (i != 2) {
                were[n] = are[i];
                were[n++].digest = rows[r].was[i];
            }
        assert_int_equal(cln_scene_moved_since(&scene, &kept, &since), CLN_OK);
        assert_int_equal(since.known, 4);
        assert_int_equal(since.changed, rows[r].changed);
        assert_int_equal(since.told, rows[r].told);
        if (rows[r].first)
            assert_string_equal(since.first_changed, rows[r].first);
        else
            assert_null(since.first_changed);
    }
}

static void test_every_format(void **state)
{
    static const char *const formats[] = {"COLMAP", "LLFF",    "NeuS",
                                          "NSVF",   "OpenSfM", "nerfstudio"};
    const cln_point points[1] = {{.xyz = {1, 2, 3}}};
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (int i = 0; i < 6; i++) {
        const char *folder = scratch_path(*state, formats[i]);
        char whole[1024] = "";
        cln_scene *scene = NULL;
        cln_config config;

        if (i != 3)
            format_images(scratch_path(folder, i == 2 ? "image" : "images"), 1);
        if (i == 0)
            format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points, 1);
        if (i == 1)
            format_llff(folder, cameras, 1, false);
        if (i == 2)
            format_neus(folder, cameras, false);
        if (i == 3)
            format_nsvf(folder, cameras, "", 0);
        if (i == 4)
            format_opensfm(folder, cameras, "perspective", points, 1);
        if (i == 5)
            format_transforms(folder, "nerfstudio", cameras);
        config = with_list(folder, "view_01\nview_04.png\n");
        scene = load(folder, &config);
        assert_string_equal(scene->dialect, formats[i]);
        assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 2);
        assert_non_null(strstr(scene->views[4].path, "view_01.png"));
        assert_non_null(strstr(scene->views[5].path, "view_04.png"));
        snprintf(whole, sizeof whole, "%s\n", scene->views[1].name);
        cln_scene_free(scene);
        config = with_list(folder, whole); /* as the scene's photos are named */
        scene = load(folder, &config);
        assert_int_equal(strncmp(tests_of(scene), whole, strlen(whole) - 1), 0);
        assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 1);
        cln_scene_free(scene);
    }
}

/* Of two or three photos none is held out, unless a --holdout of no more asks for it; nor of a run
 * that had none, once others came. */
static void test_holds_none_of_few(void **state)
{
    static const struct {
        int photos, holdout, tests;
    } cases[] = {{2, 8, 0}, {3, 8, 0}, {4, 8, 1}, {3, 3, 1}, {2, 2, 1}, {3, 2, 2}};
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL, *kept = NULL;
    cln_scene_desc desc = {.path = folder, .config = &config};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char json[2048] = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[";

        for (int v = 0; v < cases[i].photos; v++) {
            char name[32], frame[256];

            snprintf(name, sizeof name, "few_%d.png", v);
            put_image(folder, name, 4, 4, 3, v);
            snprintf(frame, sizeof frame, FRAME("%s", POSE_FRONT) "%s", name,
                     v + 1 < cases[i].photos ? "," : "]}");
            strcat(json, frame);
        }
        put_text(folder, "transforms.json", json);
        config.holdout = cases[i].holdout;
        desc.kept = i == 2 ? kept : NULL; /* four photos, of which a run has three */
        assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
        assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), i == 2 ? 0 : cases[i].tests);
        assert_true(strstr(scene->split_rule, "but of 2 or 3 none") != NULL || cases[i].tests > 0);
        cln_scene_free(kept);
        kept = scene;
    }
    cln_scene_free(kept);
}

int test_group_test_views(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_holds_none_of_few, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_names, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_trained, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_wrong_lists, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_kept, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_counted, scratch_make, scratch_remove),
        cmocka_unit_test(test_few_moved),
        cmocka_unit_test(test_changed),
        cmocka_unit_test(test_moved),
        cmocka_unit_test_setup_teardown(test_every_format, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("test_views", tests, NULL, NULL);
}
