/* The field at points (cl_nascent.h: cln_field_*; host/pipeline/field.h): colours and densities of
 * a trained run against the float64 networks of reference/, in scene units, with leaves of two
 * levels, culled octants and points outside the cube; odd batch sizes; refused arguments; a run in
 * normalised device coordinates, whose networks see the scene's directions. */
#include "unit.h"
#include <pthread.h>
#include "base/rng.h"
#include "check/selftest_checks.h"
#include "check/forward_scene.h"
#include "run_fixture.h"
#include "tests.h"

enum { POINTS = 4000 };

typedef struct points {
    double at[POINTS][3];
    float towards[POINTS][3];
    float rgb[POINTS][3], sigma[POINTS];
} points;

/* The run "whole" with one octant culled and another split; *model: its model. */
static const char *make_run(const char *name, const cln_space *space, cln_model *model)
{
    const char *run = fixture_path(name);
    json_t *document = fixture_json("whole/run.json");
    uint8_t chosen[8] = {0, 0, 1};
    cln_octree_change change;

    assert_ok(cln_checkpoint_read(fixture_path("whole"), true, model));
    assert_int_equal(model->tree.leaf_count, 8);
    assert_ok(cln_octree_cull(&model->tree, chosen, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    assert_ok(cln_octree_split(&model->tree, chosen, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    assert_int_equal(model->tree.leaf_count, 14);
    if (space)
        model->space = *space;
    assert_ok(cln_make_dirs(run));
    assert_ok(cln_run_write(run, document));
    json_decref(document);
    assert_ok(cln_checkpoint_write(run, model));
    return run;
}

/* Points in the cube and around it, with directions of many lengths. */
static void make_points(const cln_model *model, points *p)
{
    for (uint32_t i = 0; i < POINTS; i++) {
        float u[4], v[4];

        cln_uniform4(7, CLN_STREAM_DISTIL, 0, i, 0, u);
        cln_uniform4(7, CLN_STREAM_DISTIL, 0, i, 1, v);
        for (int a = 0; a < 3; a++) {
            p->at[i][a] = model->space.centre[a] + model->space.half * 1.2 * (2 * u[a] - 1);
            p->towards[i][a] = (v[a] - 0.5f) * (0.1f + 10 * v[3]);
        }
    }
}

/* r, g, b and sigma per scene unit; false outside the leaves. */
static bool reference_at(const cln_model *model, const double at[3], const float towards[3],
                         double out[4])
{
    const cln_config *c = &model->config;
    double cube[3], local[3], dir[3], length = 0;
    float box[4];
    int slot = -1;
    ref_network r;

    for (int a = 0; a < 3; a++) {
        cube[a] = (float)((at[a] - model->space.centre[a]) / model->space.half);
        length += (double)towards[a] * towards[a];
    }
    slot = cln_octree_find(&model->tree, cube);
    memset(out, 0, 4 * sizeof *out);
    if (slot < 0)
        return false;
    cln_octree_box(&model->tree, model->tree.leaf[slot], box);
    for (int a = 0; a < 3; a++) {
        local[a] = 2 * (cube[a] - box[a]) / box[3] - 1;
        dir[a] = towards[a] / sqrt(length);
    }
    r = cln_check_network(c, model, slot);
    ref_forward(&r, model->params + (size_t)slot * (size_t)model->net.params, local, dir, NULL,
                0.5 * (c->rrelu_lower + c->rrelu_upper), out);
    out[3] /= model->space.half;
    return true;
}

static void test_field_is_the_networks(void **state)
{
    static points p;
    const cln_device_desc device = fixture_device();
    cln_model model = {0};
    cln_field *field = NULL;
    const char *run = NULL;
    double min[3], max[3], worst[2] = {0, 0}, dense = 0;
    int empty = 0;

    NEED_DEVICE();
    run = make_run("odd", NULL, &model);
    make_points(&model, &p);
    assert_ok(cln_field_open(run, &device, &field));
    cln_field_box(field, min, max);
    for (int a = 0; a < 3; a++) {
        assert_true(min[a] == model.space.centre[a] - model.space.half);
        assert_true(max[a] == model.space.centre[a] + model.space.half);
    }
    assert_ok(cln_field_at(field, POINTS, (const double(*)[3])p.at, (const float(*)[3])p.towards,
                           p.rgb, p.sigma));
    for (int i = 0; i < POINTS; i++) {
        double want[4];
        const bool inside = reference_at(&model, p.at[i], p.towards[i], want);

        empty += !inside;
        dense = fmax(dense, want[3]);
        for (int a = 0; a < 3; a++) {
            worst[0] = fmax(worst[0], fabs(p.rgb[i][a] - want[a]));
            if (!inside)
                assert_true(p.rgb[i][a] == 0);
        }
        worst[1] = fmax(worst[1], fabs(p.sigma[i] - want[3]) / (1e-2 + want[3]));
        if (!inside)
            assert_true(p.sigma[i] == 0);
    }
    assert_in_range(empty, POINTS / 4, POINTS / 2 + POINTS / 8); /* 1 - (5/6)^3 * 7/8 = 0.49 */
    assert_true(dense > 0.1);                                    /* it has learned something */
    /* rounding of float32 in the position and the layers; the self-test's bound is 1e-3 of the
     * rms */
    if (!(worst[0] < 1e-4 && worst[1] < 1e-3))
        fail_msg("the colour is off by %g, the density by %g of its value", worst[0], worst[1]);
    cln_field_close(field);
    cln_model_free(&model);
}

/* Points in a forward space, from the near plane to 20 times as far, seen from the front. */
static void test_forward(void **state)
{
    static points p;
    const cln_device_desc device = fixture_device();
    const cln_space space = cln_check_forward_space(2);
    cln_model model = {0};
    cln_field *field = NULL;
    const char *run = NULL;
    double min[3], max[3], worst[2] = {0, 0};
    int empty = 0;

    NEED_DEVICE();
    run = make_run("forward", &space, &model);
    for (uint32_t i = 0; i < POINTS; i++) {
        float u[4], v[4];

        cln_uniform4(7, CLN_STREAM_DISTIL, 0, i, 0, u);
        cln_uniform4(7, CLN_STREAM_DISTIL, 0, i, 1, v);
        cln_space_point_to_scene(
            &space, (double[3]){2 * u[0] - 1, 2 * u[1] - 1, 1.9 * (double)u[2] - 1}, p.at[i]);
        for (int a = 0; a < 3; a++)
            p.towards[i][a] = (float)(space.axes[6 + a] + 0.8 * ((double)v[a] - 0.5));
    }
    assert_ok(cln_field_open(run, &device, &field));
    cln_field_box(field, min, max);
    assert_ok(cln_field_at(field, POINTS, (const double(*)[3])p.at, (const float(*)[3])p.towards,
                           p.rgb, p.sigma));
    for (int i = 0; i < POINTS; i++) {
        double cube[3], step[3], moved = 0, length = 0, want[4];
        cln_model plain = model;
        float turned[3];
        bool inside = false;

        for (int a = 0; a < 3; a++) {
            assert_true(p.at[i][a] >= min[a] && p.at[i][a] <= max[a]);
            length += (double)p.towards[i][a] * (double)p.towards[i][a];
            turned[a] = 0;
            for (int k = 0; k < 3; k++)
                turned[a] += (float)space.axes[3 * a + k] * p.towards[i][k];
        }
        /* the same networks in a plain cube, at the same place, from the scene's direction */
        plain.space = cln_space_unit;
        cln_space_point_to_cube(&space, p.at[i], cube);
        inside = reference_at(&plain, cube, turned, want);
        for (int a = 0; a < 3; a++)
            step[a] = p.at[i][a] + 1e-6 * (double)p.towards[i][a] / sqrt(length);
        cln_space_point_to_cube(&space, step, step);
        for (int a = 0; a < 3; a++)
            moved = hypot(moved, step[a] - cube[a]);
        want[3] *= moved / 1e-6;
        empty += !inside;
        for (int a = 0; a < 3; a++)
            worst[0] = fmax(worst[0], fabs(p.rgb[i][a] - want[a]));
        worst[1] = fmax(worst[1], fabs(p.sigma[i] - want[3]) / (1e-2 + want[3]));
    }
    assert_in_range(empty, POINTS / 16, POINTS / 4); /* an octant is culled */
    if (!(worst[0] < 1e-4 && worst[1] < 1e-3))
        fail_msg("the colour is off by %g, the density by %g of its value", worst[0], worst[1]);
    cln_field_close(field);
    cln_model_free(&model);
}

/* Any number of points, and any subset of the outputs, give the same bits. */
static void test_parts_are_the_whole(void **state)
{
    static points p, q;
    const cln_device_desc device = fixture_device();
    cln_model model = {0};
    cln_field *field = NULL;
    const size_t cuts[] = {0, 1, 2, 61, 1000, POINTS};

    NEED_DEVICE();
    assert_ok(cln_checkpoint_read(fixture_path("whole"), false, &model));
    make_points(&model, &p);
    assert_ok(cln_field_open(fixture_path("whole"), &device, &field));
    assert_ok(cln_field_at(field, 0, NULL, NULL, NULL, NULL));
    assert_ok(cln_field_at(field, POINTS, (const double(*)[3])p.at, (const float(*)[3])p.towards,
                           p.rgb, p.sigma));
    for (size_t k = 0; k + 1 < sizeof cuts / sizeof cuts[0]; k++) {
        const size_t from = cuts[k], n = cuts[k + 1] - from;

        assert_ok(cln_field_at(field, n, (const double(*)[3])p.at + from,
                               (const float(*)[3])p.towards + from, q.rgb + from, NULL));
        assert_ok(
            cln_field_at(field, n, (const double(*)[3])p.at + from, NULL, NULL, q.sigma + from));
    }
    assert_memory_equal(p.rgb, q.rgb, sizeof p.rgb);
    assert_memory_equal(p.sigma, q.sigma, sizeof p.sigma);
    cln_field_close(field);
    cln_model_free(&model);
}

typedef struct thread {
    const char *run;
    const points *asked;
    points got;
    cln_status status;
} thread;

static void *ask(void *user)
{
    thread *t = user;
    const cln_device_desc device = fixture_device();
    cln_field *field = NULL;

    t->status = cln_field_open(t->run, &device, &field);
    if (t->status == CLN_OK)
        t->status = cln_field_at(field, POINTS, (const double(*)[3])t->asked->at,
                                 (const float(*)[3])t->asked->towards, t->got.rgb, t->got.sigma);
    cln_field_close(field);
    return NULL;
}

/* Two threads, each with its own field and its own error record. */
static void test_two_threads(void **state)
{
    static points p;
    static thread both[2];
    cln_model model = {0};
    pthread_t other;

    NEED_DEVICE();
    assert_ok(cln_checkpoint_read(fixture_path("whole"), false, &model));
    make_points(&model, &p);
    both[0] = both[1] = (thread){.run = fixture_path("whole"), .asked = &p};
    assert_int_equal(pthread_create(&other, NULL, ask, &both[1]), 0);
    ask(&both[0]);
    assert_int_equal(pthread_join(other, NULL), 0);
    for (int i = 0; i < 2; i++)
        assert_int_equal(both[i].status, CLN_OK);
    assert_memory_equal(both[0].got.rgb, both[1].got.rgb, sizeof p.rgb);
    assert_memory_equal(both[0].got.sigma, both[1].got.sigma, sizeof p.sigma);
    both[1].run = fixture_path("nowhere");
    assert_int_equal(pthread_create(&other, NULL, ask, &both[1]), 0);
    assert_int_equal(pthread_join(other, NULL), 0);
    assert_int_equal(both[1].status, CLN_INPUT);
    assert_string_equal(cln_error_text(), "");
    cln_model_free(&model);
}

static void test_field_refuses(void **state)
{
    const cln_device_desc device = fixture_device();
    double at[2][3] = {{0, 0, 0}, {0, NAN, 0}};
    float towards[2][3] = {{0, 0, 1}, {0, 0, 0}};
    float rgb[2][3], sigma[2];
    cln_field *field = (cln_field *)&device;

    NEED_DEVICE();
    assert_fails(cln_field_open(fixture_path("scene"), &device, &field), CLN_INPUT, "not a run");
    assert_null(field);
    cln_field_close(NULL);
    assert_ok(cln_field_open(fixture_path("whole"), NULL, &field));
    assert_fails(cln_field_at(field, 2, (const double(*)[3])at, NULL, NULL, sigma), CLN_USAGE,
                 "position 1");
    at[1][1] = 0;
    assert_fails(cln_field_at(field, 2, (const double(*)[3])at, NULL, rgb, sigma), CLN_USAGE,
                 "directions");
    assert_fails(
        cln_field_at(field, 2, (const double(*)[3])at, (const float(*)[3])towards, rgb, NULL),
        CLN_USAGE, "direction 1");
    towards[1][0] = -2;
    assert_ok(
        cln_field_at(field, 2, (const double(*)[3])at, (const float(*)[3])towards, rgb, sigma));
    assert_true(sigma[0] == sigma[1]);
    cln_field_close(field);
}

int test_group_field(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_field_is_the_networks), cmocka_unit_test(test_forward),
        cmocka_unit_test(test_parts_are_the_whole),   cmocka_unit_test(test_two_threads),
        cmocka_unit_test(test_field_refuses),
    };

    return cmocka_run_group_tests_name("field", tests, fixture_setup, fixture_teardown);
}
