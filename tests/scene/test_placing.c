/* Files beside a dataset that it does not name: masks by the names that programs give them, and
 * OpenSfM's undistorted photos, which have one more ending than its shots. */
#include "unit.h"
#include "base/log.h"
#include "format_fixture.h"
#include "scene/placing.h"
#include "tests.h"

static char warned[2048];

static void keep_warnings(cln_log_level level, const char *line, void *user)
{
    const size_t used = strlen(warned);

    (void)user;
    if (level == CLN_LOG_WARN)
        snprintf(warned + used, sizeof warned - used, "%s\n", line);
}

/* COLMAP's photos view_00.png ... in the folder, without masks yet. */
static void put_scene(const char *folder)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
}

/* Loads it with masks that are ignored pixels: which of the first two photos has which, "" for
 * none; warnings have `words`, or there are none. */
static void expect_masks(const char *folder, const char *first, const char *second,
                         const char *words)
{
    const char *const wanted[2] = {first, second};
    cln_config config = *plain();
    cln_scene *scene = NULL;

    config.masks = CLN_MASKS_IGNORE;
    warned[0] = 0;
    cln_log_to(CLN_LOG_WARN, keep_warnings, NULL);
    scene = load(folder, &config);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    for (int v = 0; v < 2; v++) {
        const char *path = scene->views[v].mask_path;

        if (!path != !*wanted[v] || (path && !strstr(path, wanted[v])))
            fail_msg("view %d: %s instead of '%s'", v, path ? path : "none", wanted[v]);
    }
    if (*words ? !strstr(warned, words) : *warned)
        fail_msg("'%s' instead of '%s'", warned, words);
    cln_scene_free(scene);
}

/* By each form of names; the same in every folder that is called so, but not in two. */
static void test_mask_names(void **state)
{
    static const char all[] = "of 6 photos have a mask";
    static const struct {
        const char *folder, *there[3], *first, *second, *warning;
    } cases[] = {
        {"masks", {"view_00.png.png", "view_01.PNG.png"}, "00.png.png", "01.PNG.png", all},
        {"masks", {"view_00.png", "VIEW_01.PNG"}, "view_00.png", "VIEW_01.PNG", all},
        {"masks", {"view_00.jpg", "view_01.png"}, "view_00.jpg", "view_01.png", all},
        {"masks", {"view_00_mask.png", "view_01.jpeg"}, "00_mask.png", "01.jpeg", all},
        {"masks", {"view_00.png", "view_00.png.png"}, "view_00.png.png", "", all},
        {"masks", {"view_00.jpg", "view_00.jpeg", "view_01.png"}, "", "view_01.png", all},
        {"masks", {"mask_00.png", "mask_01.png"}, "", "", "no mask is read"},
        {"Masks", {"view_00.png.png"}, "Masks/view_00.png.png", "", all},
        {"mask", {"view_00.png", "view_01.png"}, "mask/view_00.png", "mask/view_01.png", all},
        {"MASK", {"view_00_mask.png"}, "MASK/view_00_mask.png", "", all},
        {"Masken", {"view_00.png"}, "", "", "Masken: is not read; if it has masks, call it masks"},
        {"people_masks", {"view_00.png"}, "", "", "people_masks: is not read; if it has masks"},
        {"damask", {"view_00.png"}, "", "", ""},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char name[64];
        const char *folder = NULL;

        snprintf(name, sizeof name, "%zu", i);
        put_folder(*state, name);
        folder = scratch_path(*state, name);
        put_scene(folder);
        put_folder(folder, cases[i].folder);
        for (int k = 0; k < 3 && cases[i].there[k]; k++) {
            snprintf(name, sizeof name, "%s/%s", cases[i].folder, cases[i].there[k]);
            put_image(folder, name, FORMAT_WIDTH, FORMAT_HEIGHT, 1, k);
        }
        expect_masks(folder, cases[i].first, cases[i].second, cases[i].warning);
        if (i != 8)
            continue;
        put_folder(folder, "Masks");
        expect_masks(folder, "", "", "2 folders may have masks");
        put_folder(folder, "masks"); /* called as documents have it */
        put_image(folder, "masks/view_01.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 1);
        expect_masks(folder, "", "masks/view_01.png", all);
    }
}

/* A single image is all photos' mask, if none is called like it and it has their shape. */
static void test_one_for_all(void **state)
{
    const char *folder = *state;

    put_scene(folder);
    put_folder(folder, "masks");
    put_image(folder, "masks/rig.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 200);
    expect_masks(folder, "masks/rig.png", "masks/rig.png", "");
    put_image(folder, "masks/rig.png", FORMAT_WIDTH, 3 * FORMAT_HEIGHT, 1, 200);
    expect_masks(folder, "", "", "no mask is read");
    put_image(folder, "masks/rig.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 200);
    put_image(folder, "images/rig.jpg", FORMAT_WIDTH, FORMAT_HEIGHT, 3, 200); /* without a pose */
    expect_masks(folder, "", "", "no mask is read");
    assert_int_equal(remove(scratch_path(folder, "images/rig.jpg")), 0);
    put_image(folder, "masks/other.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 200);
    expect_masks(folder, "", "", "no mask is read");
}

/* Photos named by paths of another machine: masks by what the photos are called. */
static void test_other_machine(void **state)
{
    const char *folder = *state, *images = scratch_path(folder, "sparse/0/images.txt");
    char *text = NULL, *at = NULL, all[8192] = "";
    size_t bytes = 0;
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), false, cameras, NULL, NULL, 0);
    text = scratch_get(images, &bytes);
    for (char *from = text; (at = strstr(from, "view_")); from = at + 1)
        snprintf(all + strlen(all), sizeof all - strlen(all), "%.*sD:\\P\\v", (int)(at - from),
                 from);
    for (char *last = strrchr(text, 'v'); last; last = NULL)
        snprintf(all + strlen(all), sizeof all - strlen(all), "%s", last + 1);
    scratch_put(images, all, strlen(all));
    free(text);
    put_folder(folder, "masks");
    put_image(folder, "masks/view_00.png.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 200);
    put_image(folder, "masks/view_01.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 200);
    expect_masks(folder, "masks/view_00.png.png", "masks/view_01.png", "of 6 photos have a mask");
}

/* What lies beside a scene whose photos are in its own folder is another one's. */
static void test_masks_beside_a_scene(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const char *folder = NULL;

    put_folder(*state, "scene");
    put_folder(*state, "masks");
    put_image(*state, "masks/view_00.png", FORMAT_WIDTH, FORMAT_HEIGHT, 1, 0);
    folder = scratch_path(*state, "scene");
    format_cameras(cameras);
    format_images(folder, 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    expect_masks(folder, "", "", "");
}

/* A mask of any ending is that of one photo: not of two that differ in their ending alone, where
 * one has it by its own name. */
static void test_shared_mask(void **state)
{
    const char *folder = *state;
    const char *const frames[] = {"a.jpg", "a.png", "b.jpg", "b.jpeg"};
    cln_reader_result result = {0};
    cln_view views[4] = {0};

    put_folder(folder, "images");
    put_folder(folder, "masks");
    put_image(folder, "masks/a.png", 8, 8, 1, 0);
    put_image(folder, "masks/b.png", 8, 8, 1, 0);
    result.views = views;
    result.view_count = 4;
    for (int v = 0; v < 4; v++) {
        char name[32];

        snprintf(name, sizeof name, "images/%s", frames[v]);
        put_image(folder, name, 8, 8, 3, v);
        views[v].name = (char *)frames[v];
        views[v].path = (char *)scratch_path(folder, name);
    }
    warned[0] = 0;
    cln_log_to(CLN_LOG_WARN, keep_warnings, NULL);
    assert_int_equal(cln_dataset_find_masks(folder, scratch_path(folder, "images"), &result),
                     CLN_OK);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    assert_int_equal(result.mask_count, 1);
    assert_non_null(views[1].mask_path);
    assert_true(!views[0].mask_path && !views[2].mask_path && !views[3].mask_path);
    free(views[1].mask_path);
}

/* LLFF's masks beside its images, with the photos' names. */
static void test_llff_masks(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const char *folder = *state;

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_llff(folder, cameras, 1, false);
    put_folder(folder, "masks");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[32];

        snprintf(name, sizeof name, "masks/view_%02d.png", v);
        put_image(folder, name, FORMAT_WIDTH, FORMAT_HEIGHT, 1, v);
    }
    expect_masks(folder, "masks/view_00.png", "masks/view_01.png", "");
}

/* OpenSfM's undistorted photos: NAME.jpg.jpg for NAME.jpg; as TIFF they cannot be read, also where
 * those of another scene are meant. */
static void test_second_ending(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const char *folder = *state;
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_images(scratch_path(folder, "undistorted/images"), 1);
    format_opensfm(scratch_path(folder, "undistorted"), cameras, "perspective", NULL, 0);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char from[64], to[96];

        snprintf(from, sizeof from, "%s/undistorted/images/view_%02d.png", folder, v);
        snprintf(to, sizeof to, "%s.%s", from, v % 2 ? "jpg" : "png");
        assert_int_equal(rename(from, to), 0);
    }
    scene = load(scratch_path(folder, "undistorted"), plain());
    assert_string_equal(scene->views[1].name, "view_01.png");
    assert_non_null(strstr(scene->views[1].path, "images/view_01.png.jpg"));
    cln_scene_free(scene);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char from[96], to[96];

        snprintf(from, sizeof from, "%s/undistorted/images/view_%02d.png.%s", folder, v,
                 v % 2 ? "jpg" : "png");
        snprintf(to, sizeof to, "%s/undistorted/images/view_%02d.png.tif", folder, v);
        assert_int_equal(rename(from, to), 0);
    }
    assert_refused(scratch_path(folder, "undistorted"), plain(),
                   (const char *const[3]){"'images/view_00.png.tif'", "formats that are not read",
                                          "convert them to PNG or JPEG"},
                   "TIFF");
    format_opensfm(folder, cameras, "perspective", NULL, 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"none of its 6 images", "folder 'undistorted' in",
                                          "convert them to PNG or JPEG and give that folder"},
                   "TIFF of another scene");
}

int test_group_placing(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_mask_names, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_one_for_all, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_other_machine, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks_beside_a_scene, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_shared_mask, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_llff_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_second_ending, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("placing", tests, NULL, NULL);
}
