/* What memory has room for (pipeline/room.h), on fake devices: photos before leaves up to a quarter
 * of host memory, numbers of leaves that the plans themselves then agree with, and what is said. */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include "pipeline/room.h"
#include "plan_fake.h"
#include "run_fixture.h"
#include "tests.h"

/* Voxels on a CPU whose host has so many MiB. */
static void make_voxels(fake *f, cln_config *config, double host)
{
    *config = preset("voxel");
    config->host_mem = host * MIB;
    make_fake(f, config, 4096 * MIB, "cpu");
    f->scene.space = cln_space_unit;
}

static cln_room_desc desc_of(fake *f, const cln_config *config, double photos)
{
    return cln_room_training(&f->device, config, &f->scene, NULL, 0, photos);
}

/* All of --max-leaves does not fit, with photos or without: up to a quarter of memory they stay,
 * and a tree has room beside them; more go to a file, unless --max-leaves is what is named. */
static void test_photos_before_leaves(void **state)
{
    enum { HOST = 3800 };
    static const double photos[] = {2, 74, 940, 960, 2000, 3400, 20000}; /* MiB */
    fake f;
    cln_config config, fewer;
    cln_room_desc kept;
    cln_room room;
    char text[CLN_ROOM_TEXT];

    (void)state;
    make_voxels(&f, &config, HOST);
    for (size_t i = 0; i < sizeof photos / sizeof *photos; i++) {
        const cln_room_desc desc = desc_of(&f, &config, photos[i] * MIB);

        assert_int_equal(desc.leaves, 16384);
        assert_ok(cln_room_find(&desc, &room));
        assert_true(room.host.total - room.kept > HOST * MIB);
        assert_false(room.whole);
        assert_true(room.in_memory == (photos[i] <= HOST / 4));
        assert_true(room.kept <= (room.in_memory ? photos[i] : HOST / 8) * MIB);
        assert_true(room.leaves > 64 && room.leaves < 16384 && room.needed <= HOST * MIB);
        cln_room_say_tree(&desc, &room, text);
        assert_non_null(strstr(text, "growth that would not fit is left out; --max-leaves "));
        assert_true(room.fitting <= room.leaves && room.fitting > 0.9 * room.leaves);
        cln_room_say_photos(&desc, &room, text);
        assert_non_null(strstr(text, room.in_memory ? "stay in memory" : "go to a file in "));
        /* with that, they do stay; where there is no room beside the first tree, none is named */
        assert_true((room.keeping > 0) == (photos[i] > HOST / 4 && photos[i] < 3000));
        if (room.keeping > 0) {
            assert_non_null(strstr(text, "keeps them in memory"));
            fewer = config;
            fewer.max_leaves = room.keeping;
            kept = desc_of(&f, &fewer, photos[i] * MIB);
            assert_int_equal(kept.leaves, room.keeping);
            assert_ok(cln_room_find(&kept, &room));
            assert_true(room.in_memory && room.leaves == fewer.max_leaves);
        }
    }
}

/* Photos that go to a file, in a folder that takes none: as the training says it. */
static void test_no_folder(void **state)
{
    const char *kept = getenv("TMPDIR");
    char *before = kept ? strdup(kept) : NULL;
    fake f;
    cln_config config;
    cln_room_desc desc;
    cln_room room;
    char text[CLN_ROOM_TEXT];

    (void)state;
    make_voxels(&f, &config, 3800);
    desc = desc_of(&f, &config, 960 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    assert_false(room.in_memory);
    setenv("TMPDIR", "/nonexistent", 1);
    cln_room_say_photos(&desc, &room, text);
    assert_non_null(strstr(text, "a training is refused: TMPDIR is /nonexistent: no such folder"));
    setenv("TMPDIR", "/proc", 1); /* read-only, for root as well */
    cln_room_say_photos(&desc, &room, text);
    assert_non_null(strstr(text, "a training is refused: /proc: "));
    assert_string_equal(cln_error_text(), "");
    if (before)
        setenv("TMPDIR", before, 1);
    else
        unsetenv("TMPDIR");
    free(before);
}

/* Memory for all of it: nothing is said, and nothing gives way. Too little for the first tree: what
 * a training will be refused with. */
static void test_all_and_nothing(void **state)
{
    fake f;
    cln_config config;
    cln_room_desc desc;
    cln_room room;
    char text[CLN_ROOM_TEXT];

    (void)state;
    make_voxels(&f, &config, 16000);
    desc = desc_of(&f, &config, 5000 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    assert_true(room.whole && room.in_memory && room.leaves == 16384 && room.fitting == 0);
    cln_room_say_tree(&desc, &room, text);
    assert_string_equal(text, "");
    cln_room_say_photos(&desc, &room, text);
    assert_string_equal(text, "");

    make_voxels(&f, &config, 1000); /* few leaves may still be in a deep tree */
    config.max_leaves = 64;
    desc = desc_of(&f, &config, 2 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    assert_true(room.leaves == 64 && !room.whole && room.fitting == 0 && room.in_memory);
    cln_room_say_tree(&desc, &room, text);
    assert_non_null(strstr(text, "room for that tree while it is no deeper than level 3: "));

    make_voxels(&f, &config, 320);
    desc = desc_of(&f, &config, 2 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    assert_true(room.leaves == 0 && !room.whole && room.fitting == 0 && room.keeping == 0);
    cln_room_say_tree(&desc, &room, text);
    assert_non_null(strstr(text, "a training is refused with its first tree of 64 leaves: the plan "
                                 "needs more host memory than there is"));
    assert_int_equal(cln_error_status(), CLN_OK);
}

/* Pictures of large photos leave hardly a leaf: the size that does is named. */
static void test_large_photos(void **state)
{
    fake f;
    cln_config config;
    cln_room_desc desc;
    cln_room room;
    char text[CLN_ROOM_TEXT];

    (void)state;
    make_voxels(&f, &config, 2000);
    for (int i = 0; i < f.scene.view_count; i++) {
        f.scene.views[i].camera.width = 5000;
        f.scene.views[i].camera.height = 4000;
    }
    desc = desc_of(&f, &config, 100 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    cln_room_say_tree(&desc, &room, text);
    print_message("%d leaves: %s\n", room.leaves, text);
    assert_int_equal(cln_room_downscale(&desc, &room), 4);
    assert_non_null(strstr(text, "--downscale 4 makes room"));
}

/* The plans with another batch: do they fit? *spare: bytes of memory that the first tree leaves. */
static bool batch_fits(fake *f, const cln_config *config, int samples, double *total, double *limit)
{
    cln_config other = *config;
    cln_room_desc desc;
    cln_room room;

    other.batch_samples = samples;
    desc = desc_of(f, &other, 2 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    *total = room.first_host.total;
    *limit = room.first_host.limit;
    return room.leaves > 0;
}

/* A batch takes no more than half of what the first tree leaves, the next larger one does; one that
 * is not short of memory, or does not grow, has all that fits. */
static void test_batch(void **state)
{
    static const int limits[] = {396, 420, 450, 500, 600, 700, 900, 4000, 16000}; /* MiB */
    fake f;
    cln_config config;
    cln_room_desc desc;
    int samples = 0, rays = 0, last = 0;
    char text[CLN_ROOM_TEXT];

    (void)state;
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
        double total = 0, limit = 0, least = 0;

        make_voxels(&f, &config, limits[i]);
        desc = desc_of(&f, &config, 2 * MIB);
        assert_ok(cln_room_fit_batch(&desc, true, &samples, &rays));
        assert_true(samples >= last && rays == config.rays);
        last = samples;
        assert_true(batch_fits(&f, &config, 4096, &least, &limit));
        assert_true(batch_fits(&f, &config, samples, &total, &limit));
        assert_true(total - least <= (limit - least) / 2);
        cln_room_say_batch(&desc, samples, rays, text);
        if (samples == config.batch_samples) {
            assert_string_equal(text, "");
            continue;
        }
        assert_non_null(strstr(text, "not 524288 (--batch-samples), so that the tree has room"));
        assert_null(strstr(text, "--rays"));
        batch_fits(&f, &config, 2 * samples, &total, &limit);
        assert_true(total - least > (limit - least) / 2);
    }
    assert_int_equal(last, config.batch_samples);

    make_voxels(&f, &config, 500);
    config.adaptive = false;
    config.level_at[0] = 0; /* nothing grows */
    desc = desc_of(&f, &config, 2 * MIB);
    assert_ok(cln_room_fit_batch(&desc, true, &samples, &rays));
    assert_int_equal(samples, 262144);
    cln_room_say_batch(&desc, samples, rays, text);
    assert_non_null(strstr(text, "as there is no room for more"));

    make_voxels(&f, &config, 380); /* not even the smallest, but with fewer rays */
    config.rays = 1 << 20;
    config.batch_samples = 4096;
    desc = desc_of(&f, &config, 2 * MIB);
    assert_ok(cln_room_fit_batch(&desc, false, &samples, &rays));
    assert_true(samples == 4096 && rays == 1 << 20);
    assert_ok(cln_room_fit_batch(&desc, true, &samples, &rays));
    assert_true(samples == 4096 && rays < 1 << 20 && rays >= CLN_LEAST_RAYS);
    cln_room_say_batch(&desc, samples, rays, text);
    assert_non_null(strstr(text, " rays, not 1048576 (--rays)"));
    make_voxels(&f, &config, 200); /* nothing does */
    desc = desc_of(&f, &config, 2 * MIB);
    assert_ok(cln_room_fit_batch(&desc, true, &samples, &rays));
    assert_true(samples == config.batch_samples && rays == config.rays);
    cln_room_say_batch(&desc, samples, rays, text);
    assert_string_equal(text, "");
}

/* A tree that is there does not give way: that of a resumed run, which may have grown beside photos
 * in a file. */
static void test_resumed(void **state)
{
    fake f;
    cln_config config;
    cln_room room;

    (void)state;
    make_voxels(&f, &config, 3800);
    for (int first = 64; first <= 16384; first *= 4) {
        cln_room_desc desc = desc_of(&f, &config, 900 * MIB);

        desc.first = first;
        desc.first_depth = 0; /* any */

        assert_ok(cln_room_find(&desc, &room));
        assert_true(room.in_memory == (room.first_host.total <= room.first_host.limit));
        assert_true(room.in_memory == (first <= 4096));
        desc.first = 64; /* fewer leave room */
        assert_ok(cln_room_find(&desc, &room));
        assert_true(room.in_memory);
    }
}

/* The first tree of settings is the one that a training makes. */
static void test_first_tree(void **state)
{
    fake f;
    cln_config config;

    (void)state;
    make_voxels(&f, &config, 3800);
    for (int shell = 0; shell < 2; shell++)
        for (config.start_level = 0; config.start_level <= 5; config.start_level++) {
            cln_octree tree = {0};
            cln_room_desc desc, made;
            int level = 0;

            f.scene.space.shell = shell;
            assert_ok(cln_model_first_tree(&config, shell, &tree, &level));
            desc = desc_of(&f, &config, 0);
            made = cln_room_training(&f.device, &config, &f.scene, &tree, 0, 0);
            assert_int_equal(desc.first, tree.leaf_count);
            assert_int_equal(desc.first_depth, cln_octree_depth(&tree));
            assert_true(made.first == desc.first && made.first_depth == desc.first_depth);
            cln_octree_free(&tree);
        }
}

/* What is free now is compared with what the tree that fits needs. */
static void test_free_now(void **state)
{
    static const struct {
        double mib;
        const char *words;
        bool now;
    } cases[] = {{1e6, "", false},
                 {3790, "", false}, /* read as the 3.7 GiB that are needed */
                 {3000, "--host-mem 3000M keeps it below", false},
                 {2345, "--host-mem 2300M keeps it below", false},
                 {912, "912 MiB are free now", false},
                 {912, "--host-mem 910M keeps it below", false},
                 {300, "only 300 MiB are free now", true},
                 {300, "from its first tree of 64 leaves on", true}};
    fake f;
    cln_config config;
    cln_room_desc desc;
    cln_room room;
    char text[CLN_ROOM_TEXT];
    bool now = true;

    (void)state;
    make_voxels(&f, &config, 3800);
    desc = desc_of(&f, &config, 74 * MIB);
    assert_ok(cln_room_find(&desc, &room));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_room_say_free(&desc, &room, cases[i].mib * MIB, &now, text);
        assert_true(now == cases[i].now);
        if (!*cases[i].words)
            assert_string_equal(text, "");
        else if (!strstr(text, cases[i].words))
            fail_msg("'%s' is not in '%s'", cases[i].words, text);
    }
    config.host_mem = 910 * MIB; /* what it names is within its limit, and trains */
    assert_ok(cln_room_find(&desc, &room));
    assert_true(room.leaves > 64 && room.in_memory);
    cln_room_say_free(&desc, &room, 912 * MIB, &now, text);
    assert_true(!now);
    assert_string_equal(text, "");
    cln_room_say_free(&desc, &room, INFINITY, &now, text); /* unknown */
    assert_string_equal(text, "");
}

int test_group_room(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_photos_before_leaves),
        cmocka_unit_test(test_no_folder),
        cmocka_unit_test(test_all_and_nothing),
        cmocka_unit_test(test_large_photos),
        cmocka_unit_test(test_batch),
        cmocka_unit_test(test_resumed),
        cmocka_unit_test(test_first_tree),
        cmocka_unit_test(test_free_now),
    };

    return cmocka_run_group_tests_name("room", tests, NULL, NULL);
}
