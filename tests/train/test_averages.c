/* Pixels at edges of a photo that are the mean of several rays (--antialias): which pixels, where
 * their rays go, that all else is drawn as without, and when it begins. Their loss and its gradient
 * are in tests/pipeline/test_composite.c. */
#include "unit.h"
#include "format_fixture.h"
#include "tests.h"
#include "train/batch.h"

enum { EDGE = 8, FAINT = 4, RAYS = 1000, STEPS = 20 };

/* Photos that jump at column EDGE, and change by less than an edge at FAINT. */
static cln_scene *make_scene(const char *folder, cln_config *config)
{
    cln_point points[20];
    cln_camera cameras[FORMAT_VIEWS];
    const cln_scene_desc desc = {
        .path = folder, .config = config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;

    for (int i = 0; i < 20; i++)
        points[i] = (cln_point){{1 + 0.05 * (i % 8), 2 + 0.04 * (i / 8), 3}, {0}, 2 + i % 4, 0};
    *config = *plain();
    config->depth_loss = 0.1;
    config->rays = RAYS;
    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        uint8_t pixels[FORMAT_HEIGHT * FORMAT_WIDTH][3];
        char name[32];

        for (int i = 0; i < FORMAT_HEIGHT * FORMAT_WIDTH; i++)
            memset(pixels[i],
                   i % FORMAT_WIDTH < FAINT  ? 30
                   : i % FORMAT_WIDTH < EDGE ? 50
                                             : 200,
                   3);
        snprintf(name, sizeof name, "images/view_%02d.png", v);
        assert_int_equal(cln_image_write_png(scratch_path(folder, name), FORMAT_WIDTH,
                                             FORMAT_HEIGHT, 3, pixels[0]),
                         CLN_OK);
    }
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points, 20);
    assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
    assert_true(scene->sight_count > 0);
    return scene;
}

static bool is_edge(const cln_pixel *p)
{
    return p->x == EDGE - 1 || p->x == EDGE;
}

/* The rays from i on: one, or side x side, one in each part of the pixel. Returns how many. */
static int check_pixel(const cln_batch *b, int i, int side)
{
    const int count = (int)CLN_SPOT_COUNT(b->pixels[i].spot);
    bool parts[16] = {false};

    assert_int_equal(CLN_SPOT_INDEX(b->pixels[i].spot), 0);
    if (count == 1) {
        assert_int_equal(b->pixels[i].spot, 0); /* through the centre */
        return 1;
    }
    assert_int_equal(count, side * side);
    assert_true(is_edge(&b->pixels[i]));
    for (int k = 0; k < count && i + k < b->n; k++) {
        const cln_pixel *p = &b->pixels[i + k];
        const int x = (CLN_SPOT_X(p->spot) + 2048) / (4096 / side);
        const int y = (CLN_SPOT_Y(p->spot) + 2048) / (4096 / side);

        assert_int_equal(CLN_SPOT_INDEX(p->spot), k);
        assert_int_equal(CLN_SPOT_COUNT(p->spot), count);
        assert_memory_equal(p, &b->pixels[i], offsetof(cln_pixel, spot));
        assert_memory_equal(b->targets[i + k], b->targets[i], sizeof *b->targets);
        assert_in_range(x, 0, side - 1);
        assert_in_range(y, 0, side - 1);
        assert_false(parts[y * side + x]);
        parts[y * side + x] = true;
    }
    return count;
}

static void test_draw(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    cln_batch b, plain_batch;
    double sum = 0, square = 0;
    int spots = 0, edges = 0, others = 0;

    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    assert_int_equal(cln_batch_create(scene, &config, &plain_batch), CLN_OK);
    for (uint32_t step = 0; step < STEPS; step++)
        for (int side = 2; side <= 4; side++) {
            const cln_draw d = {
                .step = step, .n = RAYS, .antialias = side, .depth = 0.5, .space = &scene->space};
            int pixel = 0;

            cln_batch_draw(&b, scene, &config, &d);
            cln_batch_draw(&plain_batch, scene, &config,
                           &(cln_draw){.step = step, .n = RAYS, .depth = 0.5, .space = d.space});
            for (int i = 0; i < RAYS; pixel++) {
                const bool sight = b.shown[i][3] > 0;
                const int count = check_pixel(&b, i, side);

                /* the pixel of this number is the same as without */
                assert_memory_equal(&b.pixels[i], &plain_batch.pixels[pixel],
                                    offsetof(cln_pixel, spot));
                assert_memory_equal(b.shown[i], plain_batch.shown[pixel], sizeof *b.shown);
                assert_int_equal(count > 1, is_edge(&b.pixels[i]) && !cln_batch_is_sight(pixel));
                assert_false(sight && count > 1);
                edges += count > 1;
                others += count == 1;
                for (int k = 0; k < count && count > 1 && i + k < RAYS; k++) {
                    const double x = CLN_SPOT_X(b.pixels[i + k].spot) / 4096.0;

                    sum += x;
                    square += x * x;
                    spots++;
                }
                i += count;
            }
            assert_int_equal(b.drawn, pixel);
            assert_int_equal(plain_batch.drawn, RAYS);
        }
    assert_true(edges > 1000 && others > 1000 && spots > 4 * edges);
    /* even over the pixel: mean 0, variance 1/12 */
    assert_float_equal(sum / spots, 0, 4 * 0.29 / sqrt(spots));
    assert_float_equal(square / spots, 1.0 / 12, 0.01);
    cln_batch_free(&b);
    cln_batch_free(&plain_batch);
    cln_scene_free(scene);
}

/* One background for all rays of a pixel. */
static void test_backgrounds(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    const cln_draw d = {.n = RAYS, .antialias = 2, .ray_background = true, .space = &scene->space};
    cln_batch b;
    int same = 0;

    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    cln_batch_draw(&b, scene, &config, &d);
    for (int i = 1; i < RAYS; i++) {
        const bool equal =
            memcmp(b.backgrounds[i], b.backgrounds[i - 1], sizeof *b.backgrounds) == 0;

        assert_int_equal(equal, CLN_SPOT_INDEX(b.pixels[i].spot) > 0);
        same += equal;
    }
    assert_true(same > 0);
    cln_batch_free(&b);
    cln_scene_free(scene);
}

int test_group_averages(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_draw, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_backgrounds, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("averages", tests, NULL, NULL);
}
