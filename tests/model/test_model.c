/* The model on the host. Tested: contents of a new model, how a change of structure carries every
 * buffer (copies, folds, zeroes, nearest cells), and what the digest depends on. Oracles: hand-made
 * index tables, and the model before the change compared byte for byte. */
#include "unit.h"
#include <stdlib.h>
#include "model_fixture.h"
#include "tests.h"

static bool all_zero(const void *data, size_t bytes)
{
    const char *at = data;

    for (size_t i = 0; i < bytes; i++)
        if (at[i] != 0)
            return false;
    return true;
}

static const void *moments_of(const cln_model *model, const void *moments, size_t slot)
{
    return (const char *)moments + slot * moment_bytes(model);
}

static void test_create(void **state)
{
    cln_config config;
    cln_model model;

    (void)state;
    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    config.start_level = 1;
    config.n1 = 2;
    assert_int_equal(cln_model_create(&config, &model), CLN_OK);
    assert_int_equal(model.tree.leaf_count, 8);
    for (int s = 0; s < 8; s++) { /* the same weights, all else zero */
        assert_memory_equal(model.params + s * model.net.params, model.params,
                            (size_t)model.net.params * sizeof(float));
        assert_int_equal(model.adam_steps[s], 0);
    }
    assert_true(all_zero(model.adam_m, 8 * moment_bytes(&model)));
    assert_true(all_zero(model.adam_v, 8 * moment_bytes(&model)));
    for (int i = 0; i < 8 * 8; i++)
        assert_int_equal(model.density[i], 0);
    cln_model_free(&model);
    config.width = 17;
    assert_int_equal(cln_model_create(&config, &model), CLN_USAGE);
    cln_clear_error();
    cln_model_free(&model);
}

/* Slot 1 of 14 is split again: other leaves keep everything; children restart Adam and take the
 * nearest cells of their octant of the parent's grid. */
static void check_apply(int64_t step)
{
    /* n1 = 3: child cells 0, 1, 2 of the lower half have centres at 1/12, 3/12, 5/12 of the
     * parent's side: its cells 0, 0, 1; the upper half 7/12, 9/12, 11/12: cells 1, 2, 2. */
    static const int nearest[2][3] = {{0, 0, 1}, {1, 2, 2}};
    uint8_t marks[14] = {0, 1};
    cln_model before, model;
    cln_octree_change change;
    size_t stride = 0, cells = N1 * N1 * N1;
    float *folded = NULL;

    make_model(step, &before);
    make_model(step, &model);
    stride = (size_t)model.net.params;
    folded = malloc(stride * sizeof *folded);
    assert_int_equal(cln_octree_split(&model.tree, marks, &change), CLN_OK);
    assert_int_equal(cln_model_apply(&model, &change), CLN_OK);
    assert_int_equal(model.tree.leaf_count, 21);
    for (int s = 0; s < 21; s++) {
        size_t from = (size_t)change.from[s], to = (size_t)s;
        int octant = change.octant[s];
        if (octant < 0) {
            same_bytes(before.params + from * stride, model.params + to * stride, stride * 4);
            same_bytes(moments_of(&before, before.adam_m, from),
                       moments_of(&model, model.adam_m, to), moment_bytes(&model));
            same_bytes(moments_of(&before, before.adam_v, from),
                       moments_of(&model, model.adam_v, to), moment_bytes(&model));
            same_bytes(before.density + from * cells, model.density + to * cells, cells * 2);
            assert_int_equal(before.adam_steps[from], model.adam_steps[to]);
            continue;
        }
        cln_network_fold(&model.net, before.params + from * stride, octant, folded);
        same_bytes(folded, model.params + to * stride, stride * 4);
        assert_true(all_zero(moments_of(&model, model.adam_m, to), moment_bytes(&model)));
        assert_true(all_zero(moments_of(&model, model.adam_v, to), moment_bytes(&model)));
        assert_int_equal(model.adam_steps[to], 0);
        for (size_t i = 0; i < cells; i++) {
            int x = nearest[octant & 1][i % N1], y = nearest[octant >> 1 & 1][i / N1 % N1];
            int z = nearest[octant >> 2][i / N1 / N1];
            assert_int_equal(model.density[to * cells + i],
                             before.density[from * cells + (size_t)((z * N1 + y) * N1 + x)]);
        }
    }
    free(folded);
    cln_octree_change_free(&change);
    cln_model_free(&before);
    cln_model_free(&model);
}

/* With moments of 32 and of 16 bits. */
static void test_apply(void **state)
{
    (void)state;
    check_apply(7);
    check_apply(8);
}

static void test_digest(void **state)
{
    cln_model a, b;
    cln_octree_change change;
    uint8_t marks[14] = {1};

    (void)state;
    make_model(1, &a);
    make_model(1, &b);
    assert_true(cln_model_digest(&a) == cln_model_digest(&b));
    b.tree.strikes[b.tree.leaf[3]]++; /* does not affect pictures */
    b.step++;
    assert_true(cln_model_digest(&a) == cln_model_digest(&b));
    ((uint32_t *)(void *)b.params)[b.net.params + 5] ^= 1; /* the last bit of one weight */
    assert_true(cln_model_digest(&a) != cln_model_digest(&b));
    ((uint32_t *)(void *)b.params)[b.net.params + 5] ^= 1;
    assert_true(cln_model_digest(&a) == cln_model_digest(&b));
    b.tree.pos[b.tree.leaf[3]][1]++;
    assert_true(cln_model_digest(&a) != cln_model_digest(&b));
    b.tree.pos[b.tree.leaf[3]][1]--;
    assert_int_equal(cln_octree_cull(&b.tree, marks, &change), CLN_OK);
    assert_int_equal(cln_model_apply(&b, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_true(cln_model_digest(&a) != cln_model_digest(&b));
    cln_model_free(&a);
    cln_model_free(&b);
}

int test_group_model(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_create),
        cmocka_unit_test(test_apply),
        cmocka_unit_test(test_digest),
    };

    return cmocka_run_group_tests_name("model", tests, NULL, NULL);
}
