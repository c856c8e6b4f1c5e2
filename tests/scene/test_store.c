/* Photos in a file (scene/store.h): every pixel as it was written, scenes and batches of pixels
 * equal to those in memory, memory that keeps to --host-mem, and failures reported. */
#include "unit.h"
#include <dirent.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include "base/rng.h"
#include "scene_fixture.h"
#include "tests.h"
#include "train/batch.h"

static uint8_t value(int photo, int x, int y, int c)
{
    return (uint8_t)(cln_hash((uint32_t)(((photo * 4 + c) * 4096 + y) * 4096 + x)) >> 7);
}

/* Sizes that tiles fit and do not fit, of three and four channels; more tiles than the cache. */
static void test_round_trip(void **state)
{
    static const struct {
        int width, height, channels;
    } photos[] = {{32, 32, 4}, {33, 31, 3}, {1, 1, 3}, {500, 300, 3}, {64, 200, 4}, {7, 400, 4}};
    enum { PHOTOS = sizeof photos / sizeof *photos };
    size_t places[PHOTOS], bytes = 0;
    cln_store *store = NULL;

    (void)state;
    for (int i = 0; i < PHOTOS; i++) {
        places[i] = bytes;
        bytes += cln_store_room(photos[i].width, photos[i].height, photos[i].channels);
    }
    assert_int_equal(cln_store_create((double)bytes, 1, &store), CLN_OK);
    assert_true(cln_store_cached(store) < (double)bytes);
    for (int i = 0; i < PHOTOS; i++) {
        const int w = photos[i].width, h = photos[i].height, n = photos[i].channels;
        uint8_t *pixels = malloc((size_t)(w * h * n));

        assert_non_null(pixels);
        for (int k = 0; k < w * h * n; k++)
            pixels[k] = value(i, k / n % w, k / n / w, k % n);
        assert_int_equal(cln_store_write(store, places[i], w, h, n, pixels), CLN_OK);
        free(pixels);
    }
    for (int k = 0; k < 200000; k++) {
        const int i = (int)(cln_hash((uint32_t)k) % PHOTOS);
        const int x = (int)(cln_hash((uint32_t)k + 1000000) % (uint32_t)photos[i].width);
        const int y = (int)(cln_hash((uint32_t)k + 2000000) % (uint32_t)photos[i].height);
        uint8_t got[4];

        cln_store_fetch(store, places[i], photos[i].width, photos[i].channels, x, y);
        cln_store_pixel(store, places[i], photos[i].width, photos[i].channels, x, y, got);
        for (int c = 0; c < photos[i].channels; c++)
            if (got[c] != value(i, x, y, c))
                fail_msg("photo %d (%d, %d): %d, not %d", i, x, y, got[c], value(i, x, y, c));
    }
    assert_int_equal(cln_store_check(store), CLN_OK);
    cln_store_free(store);
}

/* `count` views of images of this size, each its own. */
static void put_scene(const char *folder, int count, int width, int height, int channels)
{
    char json[8192] = "{\"camera_angle_x\":0.7,\"frames\":[";

    for (int i = 0; i < count; i++) {
        char name[32], frame[256];

        snprintf(name, sizeof name, "v%d.png", i);
        put_image(folder, name, width, height, channels, i);
        snprintf(frame, sizeof frame,
                 "%s{\"file_path\":\"v%d\",\"transform_matrix\":[[1,0,0,%g],[0,1,0,0],[0,0,1,4],"
                 "[0,0,0,1]]}",
                 i ? "," : "", i, 0.1 * i);
        strcat(json, frame);
    }
    strcat(json, "]}");
    put_text(folder, "transforms_train.json", json);
    put_text(folder, "transforms_test.json", json);
}

/* The same scene with and without room for it. */
static void test_same_scene(void **state)
{
    for (int channels = 3; channels <= 4; channels++)
        for (int downscale = 1; downscale <= 2; downscale++) {
            cln_config config = default_config();
            cln_scene *whole = NULL, *stored = NULL;
            cln_batch a = {0}, b = {0};
            char folder[PATH_MAX];

            snprintf(folder, sizeof folder, "%s/%d%d", (const char *)*state, channels, downscale);
            assert_int_equal(cln_make_dirs(folder), CLN_OK);
            put_scene(folder, 5, 90, 70, channels);
            config.downscale = downscale;
            config.rays = 512;
            whole = load(folder, &config);
            assert_null(whole->store);
            config.host_mem = 120000; /* two images at a time; all have 189,000 or more */
            stored = load(folder, &config);
            assert_non_null(stored->store);
            assert_true(stored->digest == whole->digest);
            for (int v = 0; v < whole->view_count; v++) {
                const cln_view *one = &whole->views[v], *other = &stored->views[v];

                assert_true(one->pixels && !other->pixels && cln_view_is_loaded(other));
                assert_true(cln_view_digest(one, 1) == cln_view_digest(other, 1));
            }
            config.host_mem = 0;
            assert_int_equal(cln_batch_create(whole, &config, &a), CLN_OK);
            assert_int_equal(cln_batch_create(stored, &config, &b), CLN_OK);
            for (uint32_t step = 0; step < 20; step++) {
                const cln_draw draw = {.step = step, .n = 512};

                cln_batch_draw(&a, whole, &config, &draw);
                cln_batch_draw(&b, stored, &config, &draw);
                assert_memory_equal(a.pixels, b.pixels, 512 * sizeof *a.pixels);
                assert_memory_equal(a.targets, b.targets, 512 * sizeof *a.targets);
            }
            assert_int_equal(cln_scene_check_pixels(stored), CLN_OK);
            cln_batch_free(&a);
            cln_batch_free(&b);
            cln_scene_free(whole);
            cln_scene_free(stored);
        }
}

/* ---- memory ---- */

enum { LARGE = 2048, COPIES = 12 };
static const double MIB = 1 << 20;

/* In a process of its own: what loading the scene and drawing from it adds to its peak, MiB. */
static int peak_of(const char *folder, double host_mem)
{
    const pid_t child = fork();
    int status = 0;

    if (child == 0) {
        cln_config config = default_config();
        const double before = cln_peak_rss();
        cln_scene *scene = NULL;
        cln_batch batch = {0};
        cln_status st = CLN_OK;

        config.downscale = 1;
        config.host_mem = host_mem;
        st = try_load(folder, &config, &scene);
        if (st == CLN_OK)
            st = cln_batch_create(scene, &config, &batch);
        for (uint32_t step = 0; step < 30 && st == CLN_OK; step++)
            cln_batch_draw(&batch, scene, &config, &(cln_draw){.step = step, .n = config.rays});
        _exit(st == CLN_OK ? (int)((cln_peak_rss() - before) / MIB) : 255);
    }
    assert_true(child > 0);
    assert_true(waitpid(child, &status, 0) == child && WIFEXITED(status));
    assert_int_not_equal(WEXITSTATUS(status), 255);
    return WEXITSTATUS(status);
}

/* 12 photos of 2048 x 2048 x 3 bytes, 144 MiB, under 80. */
static void test_peak(void **state)
{
    const char *folder = *state;
    char name[PATH_MAX], first[PATH_MAX];
    int whole = 0, stored = 0;

    put_scene(folder, COPIES, 4, 4, 3);
    put_image(folder, "v0.png", LARGE, LARGE, 3, 1);
    snprintf(first, sizeof first, "%s/v0.png", folder);
    for (int i = 1; i < COPIES; i++) {
        snprintf(name, sizeof name, "%s/v%d.png", folder, i);
        unlink(name);
        assert_int_equal(link(first, name), 0);
    }
    unlink(scratch_path(folder, "transforms_test.json"));
    whole = peak_of(folder, 0);
    stored = peak_of(folder, 80 * MIB);
    print_message("peak: %d MiB, with --host-mem 80M %d\n", whole, stored);
#if !defined __SANITIZE_ADDRESS__ /* which keeps what was freed */
    assert_true(whole > 144);
    assert_true(stored < 80);
#endif
}

/* ---- failures ---- */

static void test_no_folder(void **state)
{
    const char *kept = getenv("TMPDIR");
    char *before = kept ? strdup(kept) : NULL;
    cln_config config = default_config();
    cln_scene *scene = NULL;

    put_scene(*state, 5, 90, 70, 3);
    config.host_mem = 120000;
    setenv("TMPDIR", scratch_path(*state, "v0.png"), 1); /* no folder */
    assert_int_equal(try_load(*state, &config, &scene), CLN_OUTPUT);
    assert_null(scene);
    assert_non_null(strstr(cln_error_text(), "TMPDIR is "));
    assert_non_null(strstr(cln_error_text(), "no such folder"));
    cln_clear_error();
    if (before)
        setenv("TMPDIR", before, 1);
    else
        unsetenv("TMPDIR");
    free(before);
}

/* The store's file, which has no name any more. */
static int find_file(void)
{
    DIR *dir = opendir("/proc/self/fd");
    int found = -1;

    for (struct dirent *e = dir ? readdir(dir) : NULL; e; e = readdir(dir)) {
        char path[64], target[PATH_MAX] = "";

        snprintf(path, sizeof path, "/proc/self/fd/%.20s", e->d_name);
        if (readlink(path, target, sizeof target - 1) > 0 && strstr(target, "cl-nascent-photos-"))
            found = (int)strtol(e->d_name, NULL, 10);
    }
    if (dir)
        closedir(dir);
    return found;
}

/* A disk that loses what was written: reported, though reading pixels returns no error. */
static void test_lost(void **state)
{
    cln_config config = default_config();
    cln_scene *scene = NULL;
    const float white[3] = {1, 1, 1};
    float rgb[3], alpha = 0;

    put_scene(*state, 5, 90, 70, 4); /* of 3, borders would be in memory already */
    config.host_mem = 120000;
    strcpy(config.background, "white"); /* as would be what their mean has read */
    scene = load(*state, &config);
    if (find_file() < 0) {
        cln_scene_free(scene);
        skip();
    }
    assert_int_equal(ftruncate(find_file(), 10), 0);
    cln_view_pixel(&scene->views[2], 5, 5, white, rgb, &alpha);
    assert_int_equal(cln_scene_check_pixels(scene), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "TMPDIR"));
    cln_clear_error();
    cln_scene_free(scene);
    assert_int_equal(find_file(), -1);
}

int test_group_store(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test_setup_teardown(test_same_scene, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_peak, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_no_folder, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_lost, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("store", tests, NULL, NULL);
}
