/* Training pixels whose rays meet a leaf (train/coverage.h), against float64 rays through all
 * pixels, and the batches drawn from them (train/batch.h). */
#include "unit.h"
#include <math.h>
#include "base/rng.h"
#include "train/batch.h"
#include "check/forward_scene.h"
#include "scene_fixture.h"
#include "scene/build.h"
#include "tests.h"

static uint32_t random_state;

static uint32_t random_below(uint32_t n)
{
    random_state = cln_hash(random_state + 1);
    return cln_bounded(random_state, n);
}

/* A tree whose leaves are culled with probability 1 - 1 / keep_one_of. */
static cln_octree random_tree(int level, uint32_t keep_one_of)
{
    cln_octree tree;
    cln_octree_change change = {0};
    uint8_t *marks = NULL;

    assert_int_equal(cln_octree_create(level, &tree), CLN_OK);
    marks = calloc((size_t)tree.leaf_count, 1);
    assert_non_null(marks);
    for (int s = 1; s < tree.leaf_count; s++) /* keeps one */
        marks[s] = random_below(keep_one_of) != 0;
    assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
    cln_octree_change_free(&change);
    free(marks);
    return tree;
}

/* Views on a sphere of this radius around the cube's centre, looking roughly at it; the last one
 * looks away. */
static cln_scene *make_scene(const char *folder, int views, double radius, int width, int height,
                             int channels)
{
    char json[4096] = "{\"camera_angle_x\":0.7,\"frames\":[";

    for (int i = 0; i < views; i++) {
        const double yaw = 2.4 * i, up = 0.9 * sin(1.3 * i), r = sqrt(1 - up * up);
        const double sign = i == views - 1 ? -1 : 1;
        const double z[3] = {sign * r * cos(yaw), sign * r * sin(yaw), sign * up};
        const double x[3] = {-sin(yaw), cos(yaw), 0};
        const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                             z[0] * x[1] - z[1] * x[0]};
        char name[32], frame[512];

        snprintf(name, sizeof name, "v%d.png", i);
        put_image(folder, name, width, height, channels, i);
        snprintf(frame, sizeof frame,
                 "%s{\"file_path\":\"v%d\",\"transform_matrix\":[[%.17g,%.17g,%.17g,%.17g],[%.17g,"
                 "%.17g,%.17g,%.17g],[%.17g,%.17g,%.17g,%.17g],[0,0,0,1]]}",
                 i ? "," : "", i, x[0], y[0], z[0], sign * radius * z[0], x[1], y[1], z[1],
                 sign * radius * z[1], x[2], y[2], z[2], sign * radius * z[2]);
        strcat(json, frame);
    }
    strcat(json, "]}");
    put_text(folder, "transforms_train.json", json);
    put_text(folder, "transforms_test.json", json);
    return load(folder, NULL);
}

/* Does the ray meet a leaf's box? */
static bool meets(const cln_octree *tree, const double from[3], const double towards[3],
                  const cln_space *space)
{
    double o[3], d[3];

    cln_space_ray_to_cube(space, from, towards, o, d);
    for (int s = 0; s < tree->leaf_count; s++) {
        double near = 0, far = INFINITY;
        float box[4];

        cln_octree_box(tree, tree->leaf[s], box);
        for (int a = 0; a < 3; a++) {
            const double low = (double)box[a], high = low + (double)box[3];
            const double t0 = (low - o[a]) / d[a], t1 = (high - o[a]) / d[a];

            near = fmax(near, fmin(t0, t1));
            far = fmin(far, fmax(t0, t1));
        }
        if (near < far)
            return true;
    }
    return false;
}

/* [pixel of view i]: 1 where a tile covers it. The caller frees. */
static uint8_t *covered_pixels(const cln_coverage *c, const cln_scene *scene, int i)
{
    const cln_camera *camera = &scene->views[i].camera;
    uint8_t *out = calloc((size_t)(camera->width * camera->height), 1);

    assert_non_null(out);
    for (size_t k = c->start[i]; k < c->start[i + 1]; k++) {
        const cln_tile *tile = &c->tiles[k];
        const int left = tile->column * c->side, top = tile->row * c->side;

        assert_int_equal(tile->view, i);
        for (int y = top; y < top + c->side && y < camera->height; y++)
            for (int x = left; x < left + c->side && x < camera->width; x++)
                out[y * camera->width + x]++;
    }
    return out;
}

/* Every ray that meets a leaf goes through a covered pixel; checks share and error by counting.
 * Returns covered pixels over pixels that meet a leaf. */
static double check(const cln_scene *scene, const cln_octree *tree, const cln_space *space)
{
    cln_coverage c;
    double hits = 0, covered = 0, all = 0, error = 0;

    assert_int_equal(cln_coverage_create(scene, &c), CLN_OK);
    for (int twice = 0; twice < 2; twice++) /* second time: errors of tiles are known */
        cln_coverage_update(&c, scene, tree, space);
    for (int i = 0; i < c.views; i++) {
        const cln_view *view = &scene->views[i];
        uint8_t *marks = covered_pixels(&c, scene, i);

        for (int k = 0; k < view->camera.width * view->camera.height; k++) {
            const int x = k % view->camera.width, y = k / view->camera.width;
            double o[3], d[3];
            float rgb[3], alpha = 0;

            assert_in_range(marks[k], 0, 1);
            if (!cln_view_keeps(view, x, y))
                continue;
            assert_true(cln_camera_ray(&view->camera, x + 0.5, y + 0.5, o, d));
            if (meets(tree, o, d, space)) {
                hits++;
                if (!marks[k])
                    fail_msg("view %d, pixel %d %d: a leaf without a tile", i, x, y);
            }
            all++;
            covered += marks[k];
            cln_view_pixel(view, x, y, scene->background, rgb, &alpha);
            for (int n = 0; n < 3 && !marks[k]; n++)
                error += pow((double)rgb[n] - (double)scene->background[n], 2) / 3;
        }
        free(marks);
    }
    assert_true(fabs(c.share - covered / all) < 1e-12);
    assert_true(fabs(c.error_other - error / all) < 1e-6);
    if (!c.kept)
        assert_int_equal(c.whole, covered == all);
    cln_coverage_free(&c);
    return covered / fmax(hits, 1);
}

/* From far, near and within the cube; sparse trees and full ones. */
static void test_no_leaf_is_missed(void **state)
{
    static const double radii[] = {4, 2.2, 1.1, 0.4};
    const cln_space cube = {.centre = {0.1, -0.2, 0.05}, .half = 0.8};

    random_state = 5;
    for (int r = 0; r < 4; r++) {
        cln_scene *scene = make_scene(*state, 5, radii[r], 53, 38, 4);

        for (int level = 0; level <= 4; level++) {
            cln_octree tree = random_tree(level, level < 4 ? 6 : 200);

            check(scene, &tree, &cube);
            cln_octree_free(&tree);
        }
        cln_scene_free(scene);
    }
}

/* Covers few more pixels than meet a leaf: only the rest of the tiles at its edge. */
static void test_tight(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 240, 200, 3);
    cln_octree tree = random_tree(3, 60);
    const cln_space cube = {.centre = {0.1, -0.2, 0.05}, .half = 1};
    const double more = check(scene, &tree, &cube);

    if (!(more >= 1 && more < 1.8))
        fail_msg("%.3f times as many pixels are covered as meet a leaf", more);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* Columns beyond 65,536 are told apart. */
static void test_wide(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 70000, 2, 3);
    cln_octree tree = random_tree(2, 16);
    const cln_space cube = {.centre = {0.1, -0.2, 0.05}, .half = 1};

    check(scene, &tree, &cube);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* Where masks leave little, that is all that counts and is drawn. */
static void test_masks(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 200, 150, 4);
    cln_octree tree = random_tree(3, 60);
    const cln_space cube = {.centre = {0.1, -0.2, 0.05}, .half = 1};
    static uint8_t masks[3][200 * 150 / 8];
    cln_config config = default_config();

    for (int v = 0; v < 3; v++) { /* 1 %, on 70 rows */
        for (int i = 0; i < 300; i++) {
            const uint32_t at = random_below(200 * 70) + 200 * 40;

            masks[v][at / 8] |= (uint8_t)(1 << at % 8);
        }
        scene->views[v].kept = masks[v];
    }
    check(scene, &tree, &cube);
    for (int way = 0; way < 3; way++) {
        cln_batch b;

        config.stage1 = way == 1 ? CLN_STAGE1_SPLAT : CLN_STAGE1_GATHER;
        assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
        cln_coverage_update(&b.coverage, scene, &tree, &cube);
        if (way == 2) { /* of tiles: the rest of the photos has none */
            assert_true(b.coverage.start[3] < b.coverage.first[3] * 70 / 150);
            assert_true(cln_batch_skips(&b, &config, 0));
        }
        cln_batch_draw(&b, scene, &config,
                       &(cln_draw){.step = 1, .n = b.capacity, .covered = way == 2});
        for (int i = 0; i < b.capacity; i++)
            assert_true(cln_view_keeps(&scene->views[b.pixels[i].view], (int)b.pixels[i].x,
                                       (int)b.pixels[i].y));
        cln_batch_free(&b);
    }
    for (int v = 0; v < 3; v++)
        scene->views[v].kept = NULL;
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* In a forward space, leaves are frusta: no ray that meets one is missed, and few others are taken.
 */
static void test_forward(void **state)
{
    const cln_space space = cln_check_forward_space(1);
    cln_scene *scene = make_scene(*state, 4, 4, 80, 60, 3);
    double more[2] = {0};

    random_state = 7;
    for (int i = 0; i < 4; i++) {
        cln_check_forward_camera(i, &space, 80, 60, &scene->views[i].camera);
        if (i == 3) /* not beyond the near plane: leaves reach around that */
            scene->views[i].camera = scene->views[2].camera;
    }
    for (int level = 0; level <= 4; level++) {
        cln_octree tree = random_tree(level, level < 4 ? 6 : 60);

        more[level == 4] = check(scene, &tree, &space);
        cln_octree_free(&tree);
    }
    if (!(more[1] >= 1 && more[1] < 2.5))
        fail_msg("%.3f times as many pixels are covered as meet a leaf", more[1]);
    cln_check_forward_camera(3, &space, 80, 60,
                             &scene->views[3].camera); /* covered as a whole, then */
    for (int level = 1; level <= 3; level++) {
        cln_octree tree = random_tree(level, 6);

        check(scene, &tree, &space);
        cln_octree_free(&tree);
    }
    cln_scene_free(scene);
}

/* A view through a distorting lens, or inside a leaf, is covered as a whole. Without a leaf no tile
 * is covered. */
static void test_whole_and_nothing(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 40, 30, 3);
    cln_octree tree = random_tree(3, 400);
    cln_octree_change change = {0};
    uint8_t all[512];
    cln_coverage c;

    memset(all, 1, sizeof all);
    assert_int_equal(cln_coverage_create(scene, &c), CLN_OK);
    cln_coverage_update(&c, scene, &tree, &cln_space_unit);
    assert_true(c.share < 1 && !c.whole);
    scene->views[1].camera.k1 = 1e-3;
    cln_coverage_update(&c, scene, &tree, &cln_space_unit);
    assert_int_equal(c.start[2] - c.start[1], c.first[2] - c.first[1]);
    assert_true(c.start[1] < c.first[1]);
    cln_coverage_update(&c, scene, &tree,
                        &(cln_space){.half = 100}); /* all cameras stand in the cube */
    assert_int_equal(cln_octree_cull(&tree, all, &change), CLN_OK);
    cln_octree_change_free(&change);
    scene->views[1].camera.k1 = 0;
    cln_coverage_update(&c, scene, &tree, &cln_space_unit);
    assert_int_equal(c.start[3], 0);
    assert_true(c.share == 0 && !c.whole);
    cln_coverage_free(&c);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* A batch draws covered pixels uniformly, and the same ones for the same step. Views of several
 * sizes, none a multiple of a tile. */
static void test_draw(void **state)
{
    enum { STEPS = 100 };
    cln_config config = default_config();
    cln_scene *scene = make_scene(*state, 4, 3.5, 50, 46, 4);
    cln_octree tree = random_tree(3, 40);
    cln_batch b;
    double square = 0, expected = 0, pixels = 0;
    int32_t *counts[4] = {0};
    cln_pixel *before = NULL;

    config.leaf_samples = 0;
    put_image(*state, "v0.png", 37, 31, 4, 9); /* one view of another size */
    cln_scene_free(scene);
    scene = load(*state, NULL);
    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    assert_false(cln_batch_skips(&b, &config, 0)); /* no tree yet */
    cln_coverage_update(&b.coverage, scene, &tree, &cln_space_unit);
    assert_true(cln_batch_skips(&b, &config, 0));
    for (int i = 0; i < 4; i++)
        counts[i] = calloc(50 * 46, sizeof *counts[i]);
    for (uint32_t step = 0; step < STEPS; step++) {
        const cln_draw draw = {.step = step, .n = config.rays, .covered = true};

        cln_batch_draw(&b, scene, &config, &draw);
        for (int i = 0; i < config.rays; i++)
            counts[b.pixels[i].view][b.pixels[i].y * 50 + b.pixels[i].x]++;
    }
    before = malloc((size_t)config.rays * sizeof *before);
    memcpy(before, b.pixels, (size_t)config.rays * sizeof *before);
    cln_batch_draw(&b, scene, &config,
                   &(cln_draw){.step = STEPS - 1, .n = config.rays, .covered = true});
    assert_memory_equal(before, b.pixels, (size_t)config.rays * sizeof *before);
    for (int i = 0; i < 4; i++) {
        const cln_camera *camera = &scene->views[i].camera;
        uint8_t *marks = covered_pixels(&b.coverage, scene, i);

        expected =
            (double)config.rays * STEPS / (b.coverage.share * (double)b.first[b.train_views]);
        for (int y = 0; y < camera->height; y++)
            for (int x = 0; x < camera->width; x++) {
                const int count = counts[i][y * 50 + x];

                if (!marks[y * camera->width + x])
                    assert_int_equal(count, 0);
                else
                    square += pow(count - expected, 2) / expected, pixels++;
            }
        free(marks);
        free(counts[i]);
    }
    /* chi squared of n pixels: mean n, standard deviation sqrt(2 n) */
    if (fabs(square - pixels) > 4 * sqrt(2 * pixels))
        fail_msg("chi squared %.0f of %.0f pixels", square, pixels);
    free(before);
    cln_batch_free(&b);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* All pixels count: without the option, when splatting, while training on image centres, or without
 * leaves. */
static void test_when_all_count(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 40, 30, 3);
    cln_octree tree = random_tree(3, 400);
    cln_config config = default_config(), other = config;
    cln_batch b;

    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    cln_coverage_update(&b.coverage, scene, &tree, &cln_space_unit);
    assert_true(cln_batch_skips(&b, &config, 0));
    other.skip_uncovered = false;
    assert_false(cln_batch_skips(&b, &other, 0));
    other = config;
    other.stage1 = CLN_STAGE1_SPLAT;
    assert_false(cln_batch_skips(&b, &other, 0));
    other = config;
    other.precrop_steps = 10;
    assert_false(cln_batch_skips(&b, &other, 9));
    assert_true(cln_batch_skips(&b, &other, 10));
    b.coverage.share = 0;
    assert_false(cln_batch_skips(&b, &config, 0));
    cln_batch_free(&b);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* Pixels that no ray goes through are not drawn, whichever way pixels are drawn. */
static void test_left_out(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 40, 30, 3);
    const double corner = 25 / scene->views[0].camera.fx;

    free(scene->maps);
    scene->maps = NULL;
    for (int v = 0; v < scene->view_count; v++) /* folds at 0.385 / sqrt(-k1): 0.6 of the way */
        scene->views[v].camera.k1 = -pow(0.3849 / (0.6 * corner), 2);
    assert_int_equal(cln_scene_find_kept(scene), CLN_OK);
    assert_in_range(scene->views[0].left_out, 300, 900);
    for (int way = 0; way < 3; way++) {
        cln_config config = default_config();
        int out = 0;
        cln_batch b;

        config.stage1 = way == 1 ? CLN_STAGE1_SPLAT : CLN_STAGE1_GATHER;
        config.precrop_steps = way == 2 ? 10 : 0;
        assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
        cln_batch_draw(&b, scene, &config, &(cln_draw){.step = 1, .n = b.capacity});
        for (int i = 0; i < b.capacity; i++)
            out += !cln_view_keeps(&scene->views[b.pixels[i].view], (int)b.pixels[i].x,
                                   (int)b.pixels[i].y);
        assert_int_equal(out, 0);
        cln_batch_free(&b);
    }
    cln_scene_free(scene);
}

/* With a lens that bends, a view counts whole or, if it sees nothing of the cube, not at all. */
static void test_bent(void **state)
{
    cln_scene *scene = make_scene(*state, 3, 4, 40, 30, 3);
    cln_octree tree = random_tree(1, 1);
    cln_coverage c;

    for (int v = 0; v < scene->view_count; v++)
        scene->views[v].camera.k1 = 0.01;
    assert_int_equal(cln_coverage_create(scene, &c), CLN_OK);
    cln_coverage_update(&c, scene, &tree, &cln_space_unit);
    assert_true(c.start[1] == c.first[1] && c.start[2] == c.first[2]);
    assert_true(c.start[3] == c.first[2]); /* the last one looks away */
    cln_coverage_free(&c);
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

int test_group_coverage(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_no_leaf_is_missed, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_tight, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_wide, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_forward, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_whole_and_nothing, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bent, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_left_out, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_draw, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_when_all_count, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("coverage", tests, NULL, NULL);
}
