/* The search for places that lack a leaf. Tested: on the fixture's ball, in a tree of a single
 * place far from it, that the ball's inside is found and what photos show to be empty is not; that
 * what it hands back follows what is found, not the finest leaf; when culling waits for what came
 * back, and for enough leaves to cull. Oracle: the ball. tests/cli/training.sh trains. */
#include "unit.h"
#include <malloc.h>
#include "tests.h"
#include "train/cull.h"
#include "train/grow.h"
#include "train/refresh.h"
#include "train/regrow.h"
#include "trainer_fixture.h"

enum { LEVEL = 5, SIDE_CELLS = 1 << LEVEL };

static cln_config settings(void)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset("fast", &config));
    config.start_level = 2;
    config.max_level = CLN_MAX_LEVEL;
    config.regrow = 0.7; /* five of six photos: one may see the corner's leaves behind the ball */
    config.rays = 96;
    config.batch_samples = 4096;
    config.steps = STEPS;
    config.depth_loss = 0;
    assert_ok(cln_config_check(&config));
    return config;
}

/* Whether the leaf of level 2 with that slot is at this place along each axis. */
static bool is_at(const cln_octree *tree, int slot, int place)
{
    const uint16_t *pos = tree->pos[tree->leaf[slot]];

    return pos[0] == place && pos[1] == place && pos[2] == place;
}

/* Keeps the leaf at the cube's lowest corner alone, and splits the one in its corner down to the
 * last level. */
static void keep_corner(cln_trainer *t)
{
    cln_plan_desc plan = {
        .pipeline = &t->pipeline, .scene = t->scene, .training = true, .depth = CLN_MAX_LEVEL};
    cln_model *model = &t->model;
    cln_octree_change change;
    uint8_t marks[64];

    memset(marks, 1, sizeof marks);
    marks[0] = 0;
    assert_ok(cln_octree_cull(&model->tree, marks, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    memset(marks, 0, sizeof marks);
    marks[0] = 1;
    for (int level = 2; level < CLN_MAX_LEVEL; level++) {
        assert_ok(cln_octree_split(&model->tree, marks, &change));
        assert_ok(cln_model_apply(model, &change));
        cln_octree_change_free(&change);
    }
    plan.leaves = model->tree.leaf_count;
    cln_plan_device(&plan, &t->plan);
    cln_plan_apply(&t->plan, &t->pipeline);
    assert_ok(cln_pipeline_rebuild(&t->pipeline, model->tree.leaf_count));
    assert_ok(cln_pipeline_upload(&t->pipeline, model, true));
    assert_ok(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
    assert_ok(cln_stage_refresh(&t->pipeline, 0, t->pipeline.leaves, true, 1, 0));
}

/* Bytes that this process has allocated; 0 under sanitizers. */
static double allocated(void)
{
    const struct mallinfo2 all = mallinfo2();

    return (double)all.uordblks + (double)all.hblkhd;
}

static void test_ball(void **state)
{
    const cln_config config = settings();
    const double most = 1 << 20; /* of 2^(3 CLN_MAX_LEVEL) cells there are 16 of these */
    cln_trainer t;
    cln_missing missing, again;
    uint8_t *empty = NULL;
    double before = 0;
    int inside = 0, outside = 0;

    (void)state;
    open_trainer(&config, &t);
    keep_corner(&t);
    assert_int_equal(cln_octree_depth(&t.model.tree), CLN_MAX_LEVEL);
    assert_ok(cln_alloc(&empty, (size_t)t.pipeline.leaves, 1, "test"));
    assert_ok(cln_regrow_find(&t, empty, &again)); /* the device's buffers are there now */
    before = allocated();
    assert_ok(cln_regrow_find(&t, empty, &missing));
    assert_true(allocated() - before < most);
    assert_int_equal(missing.errors, again.errors);
    assert_int_equal(missing.cut, again.cut);
    assert_int_equal(missing.marks.count, again.marks.count);
    assert_memory_equal(missing.marks.mark, again.marks.mark,
                        (size_t)again.marks.count * sizeof *again.marks.mark);
    for (int i = 0; i < SIDE_CELLS * SIDE_CELLS * SIDE_CELLS; i++) {
        const int cell[3] = {i % SIDE_CELLS, i / SIDE_CELLS % SIDE_CELLS,
                             i / SIDE_CELLS / SIDE_CELLS};
        double cube[3], scene[3], square = 0;

        for (int a = 0; a < 3; a++)
            cube[a] = 2 * (cell[a] + 0.5) / SIDE_CELLS - 1;
        cln_space_point_to_scene(&t.model.space, cube, scene);
        for (int a = 0; a < 3; a++)
            square += scene[a] * scene[a];
        if (square < 0.8 * 0.8) {
            if (!cln_marks_meet(&missing.marks, LEVEL, cell))
                fail_msg("cell %d %d %d of the ball is not found; %d are", cell[0], cell[1],
                         cell[2], missing.errors);
            inside++;
        } else if (square > 2 * 2 && fmax(cube[0], fmax(cube[1], cube[2])) > 0) {
            /* not near the corner's leaves, which the photos do not show */
            if (cln_marks_meet(&missing.marks, LEVEL, cell))
                fail_msg("cell %d %d %d, which is empty, is found", cell[0], cell[1], cell[2]);
            outside++;
        }
    }
    assert_true(inside > 1000 && outside > 500);
    assert_in_range(missing.errors, inside, SIDE_CELLS * SIDE_CELLS * SIDE_CELLS - outside);
    cln_marks_free(&missing.marks);
    cln_marks_free(&again.marks);
    free(empty);
    close_trainer(&t);
}

/* ---- what counts ---- */

/* Brings a changed tree to the device. */
static void reload(cln_trainer *t)
{
    assert_ok(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    assert_ok(cln_pipeline_upload(&t->pipeline, &t->model, true));
    assert_ok(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
    assert_ok(cln_refresh_all(t));
}

/* Pixels of all but the first `count` training photos do not count. */
static void keep_views(cln_trainer *t, int count)
{
    static const uint8_t none[SIDE * SIDE / 8];

    for (int i = count; i < TRAIN_VIEWS; i++)
        cln_scene_training_view(t->scene, i)->kept = none;
}

/* Makes all photos white, with this opacity where they show the ball, or only the middle of it. */
static void fade(cln_trainer *t, double opacity, bool middle)
{
    for (int i = 0; i < TRAIN_VIEWS; i++) {
        uint8_t *pixels = cln_scene_training_view(t->scene, i)->pixels;

        for (int k = 0; k < SIDE * SIDE; k++) {
            const int x = k % SIDE, y = k / SIDE;
            const bool in = x >= 9 && x < 16 && y >= 9 && y < 16;

            memset(pixels + 4 * k, 255, 3);
            if (pixels[4 * k + 3])
                pixels[4 * k + 3] = in || !middle ? (uint8_t)lround(255 * opacity) : 0;
        }
    }
}

static int errors_found(cln_trainer *t)
{
    cln_missing missing;
    uint8_t *empty = NULL;
    int found = 0;

    assert_ok(cln_alloc(&empty, (size_t)t->pipeline.leaves, 1, "test"));
    assert_ok(cln_regrow_find(t, empty, &missing));
    found = missing.errors;
    cln_marks_free(&missing.marks);
    free(empty);
    return found;
}

/* Differences above twice those of all pixels, and above a tenth; of photos that differ all over,
 * those above a quarter. */
static void test_errors(void **state)
{
    static const struct {
        double opacity;
        bool middle, found;
    } cases[] = {{0.08, true, false},
                 {0.14, true, true},
                 {0.2, false, false},
                 {0.35, false, true},
                 {1, false, true}};
    cln_config config = settings();

    NEED_DEVICE();
    config.initial_depth = 1e-4; /* nothing is to be seen of the leaves */
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_trainer t;
        int found = 0;

        open_trainer(&config, &t);
        keep_corner(&t);
        fade(&t, cases[i].opacity, cases[i].middle);
        found = errors_found(&t);
        if (cases[i].found != (found > 0))
            fail_msg("opacity %g: %d cells are found", cases[i].opacity, found);
        close_trainer(&t);
    }
}

/* What two photos show may stand anywhere before them. */
static void test_seen_by(void **state)
{
    cln_config config = settings();

    NEED_DEVICE();
    config.initial_depth = 1e-4;
    for (int views = 2; views <= 3; views++) {
        cln_trainer t;
        int found = 0;

        open_trainer(&config, &t);
        keep_corner(&t);
        keep_views(&t, views);
        found = errors_found(&t);
        if ((views > 2) != (found > 0))
            fail_msg("%d photos: %d cells are found", views, found);
        close_trainer(&t);
    }
}

/* Faces before which a surface goes on, of one leaf beside the middle, as dense all over as takes
 * half of the light on this part of its side; by the first photos. */
static int faces_cut(double part, int views)
{
    cln_config config = settings();
    cln_octree_change change;
    cln_trainer t;
    cln_missing missing;
    uint8_t marks[64], *empty = NULL;
    const double sigma = log(2) / (0.5 * part);
    int cut = 0;

    open_trainer(&config, &t);
    for (int s = 0; s < 64; s++)
        marks[s] = !is_at(&t.model.tree, s, 2);
    assert_ok(cln_octree_cull(&t.model.tree, marks, &change));
    assert_ok(cln_model_apply(&t.model, &change));
    cln_octree_change_free(&change);
    assert_int_equal(t.model.tree.leaf_count, 1);
    memset(t.model.params, 0, (size_t)t.model.net.params * sizeof *t.model.params);
    t.model.params[t.model.net.sigma_b] =
        (float)(log(expm1(sigma / config.density_scale)) - cln_network_density_bias(&config));
    reload(&t);
    keep_views(&t, views);
    assert_ok(cln_alloc(&empty, 1, 1, "test"));
    assert_ok(cln_regrow_find(&t, empty, &missing));
    cut = missing.cut;
    cln_marks_free(&missing.marks);
    free(empty);
    close_trainer(&t);
    return cut;
}

/* Rays that end right behind a face, several of them, show that it cuts a surface off. */
static void test_faces(void **state)
{
    NEED_DEVICE();
    assert_true(faces_cut(0.01, TRAIN_VIEWS) > 5);
    assert_true(faces_cut(0.08, TRAIN_VIEWS) > 5);
    assert_int_equal(faces_cut(0.2, TRAIN_VIEWS), 0);
    assert_int_equal(faces_cut(0.01, 1), 0);
}

/* Empty leaves with errors begin anew at every decision: culling does not wait for them, or it
 * would never come; it does for leaves in places that had none. */
static void test_culling_goes_on(void **state)
{
    cln_config config = settings();
    cln_trainer t;

    (void)state;
    config.initial_depth = 1e-4; /* nothing is in the way of the ball's errors */
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0;
    config.cull_after = 50;
    for (int gone = 0; gone < 2; gone++) {
        cln_octree_change change;
        uint8_t marks[64] = {0};
        bool came_back = false;

        open_trainer(&config, &t);
        for (int s = 0; s < 64; s++) /* one of the eight around the middle */
            marks[s] = gone && is_at(&t.model.tree, s, 1);
        assert_ok(cln_octree_cull(&t.model.tree, marks, &change));
        assert_ok(cln_model_apply(&t.model, &change));
        cln_octree_change_free(&change);
        reload(&t);
        assert_int_equal(t.model.tree.leaf_count, 64 - gone);
        t.model.step = 60;
        assert_true(cln_cull_due(&t, 0.5));
        assert_ok(cln_grow_back(&t, 1, &came_back));
        assert_true(came_back);
        assert_int_equal(t.model.tree.leaf_count, 64);
        assert_int_equal(cln_cull_due(&t, 0.5), !gone);
        close_trainer(&t);
    }
}

/* Empty leaves go once they are a hundredth of all, and before that only with another change. What
 * was measured begins anew with each look, but where decisions need it. */
static void test_culling_waits(void **state)
{
    static const struct {
        int marked;
        bool now, goes;
    } cases[] = {{5, false, false}, {5, true, true}, {6, false, true}}; /* of 512 */
    cln_config config = settings();

    (void)state;
    config.start_level = 3;
    config.cull = CLN_CULL_GUARDED;
    config.cull_mean = config.cull_max = 1e6;
    config.cull_strikes = 9;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_octree *tree = NULL;
        cln_trainer t;

        config.adaptive = i == 0;
        open_trainer(&config, &t);
        t.model.sum_rays = 9;
        assert_ok(cln_stage_refresh(&t.pipeline, 0, t.pipeline.leaves, true, 1, 0));
        tree = &t.model.tree;
        assert_int_equal(tree->leaf_count, 512);
        for (int k = 0; k < cases[i].marked; k++)
            tree->strikes[tree->leaf[17 * k]] = 8; /* and this time */
        assert_ok(cln_cull(&t, cases[i].now));
        assert_int_equal(t.model.tree.leaf_count, 512 - (cases[i].goes ? cases[i].marked : 0));
        assert_true((t.model.sum_rays == 0) == !config.adaptive);
        close_trainer(&t);
    }
}

int test_group_regrow(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_ball),
                                       cmocka_unit_test(test_errors),
                                       cmocka_unit_test(test_seen_by),
                                       cmocka_unit_test(test_faces),
                                       cmocka_unit_test(test_culling_goes_on),
                                       cmocka_unit_test(test_culling_waits)};

    return cmocka_run_group_tests_name("regrow", tests, fixture_setup, fixture_teardown);
}
