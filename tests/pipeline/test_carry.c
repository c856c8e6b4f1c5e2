/* Changes of the tree on the device. Tested: after any history of merges, splits, culls and
 * returns of culled leaves, the device's model equals bit for bit the host's (cln_model_apply), in
 * one buffer and in parts, with both kinds of moments; a change frees the memory it allocates.
 * Oracle: model/model.c. */
#include "unit.h"
#include "device_test.h"
#include "model_fixture.h"
#include "pipeline/carry.h"
#include "tests.h"

enum { ROUNDS = 7 };

/* The same change in both models; `other` only follows: the device holds its weights. */
static void change_both(cln_model *host, cln_model *other, const uint8_t *marks, int kind,
                        cln_octree_change *change)
{
    cln_octree_change again;
    cln_model *models[2] = {host, other};
    cln_marks all_cells = {0};
    float *weight = test_alloc((size_t)host->tree.leaf_count + 1, sizeof *weight);

    for (int s = 0; s < host->tree.leaf_count; s++)
        weight[s] = (float)test_uniform(5, s, 0, 1);
    assert_ok(cln_marks_add(&all_cells, 0, (int[3]){0, 0, 0}));
    for (int i = 0; i < 2; i++) {
        cln_octree_change *out = i ? &again : change;

        if (kind == 0)
            assert_ok(cln_octree_merge(&models[i]->tree, marks, weight, out));
        else if (kind == 1)
            assert_ok(cln_octree_split(&models[i]->tree, marks, out));
        else if (kind == 2)
            assert_ok(cln_octree_cull(&models[i]->tree, marks, out));
        else /* all cells are marked: every culled node comes back, every marked leaf restarts */
            assert_ok(cln_octree_regrow(&models[i]->tree, &all_cells, 0, 0, marks, out));
    }
    assert_ok(cln_model_apply(host, change));
    assert_ok(cln_model_follow(other, &again));
    assert_null(other->params);
    cln_octree_change_free(&again);
    cln_marks_free(&all_cells);
    free(weight);
}

/* The marks of a round: groups to merge, leaves to split that no merge made, leaves to cull. */
static void mark(const cln_octree *tree, const cln_octree_change *before, int kind,
                 uint32_t *counter, uint8_t *marks)
{
    const uint32_t one_of = kind == 0 ? 3 : kind == 1 ? 5 : 7;

    memset(marks, 0, (size_t)tree->leaf_count);
    for (int s = 0; s < tree->leaf_count; s++) {
        const bool new = before && before->octant[s] != CLN_COPIED;

        if (draw(counter) % one_of == 0 && !new)
            marks[s] = kind != 0 || cln_octree_can_merge(tree, s);
    }
}

static void assert_same(const cln_model *a, const cln_model *b)
{
    const size_t leaves = (size_t)a->tree.leaf_count, params = leaves * (size_t)a->net.params;

    assert_int_equal(b->tree.leaf_count, leaves);
    same_bytes(a->params, b->params, params * sizeof(float));
    same_bytes(a->adam_m, b->adam_m, leaves * moment_bytes(a));
    same_bytes(a->adam_v, b->adam_v, leaves * moment_bytes(a));
    same_bytes(a->adam_steps, b->adam_steps, leaves * sizeof(int32_t));
    same_bytes(a->density, b->density, leaves * N1 * N1 * N1 * sizeof(uint16_t));
    same_bytes(a->sums, b->sums, leaves * CLN_MEASURES * 2 * sizeof(float));
    same_bytes(a->met, b->met, leaves * sizeof(int32_t));
    same_bytes(a->error, b->error, leaves * sizeof(float));
    same_bytes(a->saved, b->saved, leaves * sizeof(float));
}

/* Transposed weights after the carry equal those that an upload makes. */
static void assert_transposed(cln_pipeline *p, const cln_model *host)
{
    const size_t bytes =
        (size_t)p->leaves * (size_t)cln_pipeline_transposed(&p->net) * sizeof(float);
    float *carried = NULL, *uploaded = NULL;

    if (p->tune.leaf)
        return;
    carried = test_alloc(bytes, 1);
    uploaded = test_alloc(bytes, 1);
    assert_ok(cln_buffer_read(p->device, &p->transposed, 0, carried, bytes));
    assert_ok(cln_pipeline_upload(p, host, true));
    assert_ok(cln_buffer_read(p->device, &p->transposed, 0, uploaded, bytes));
    assert_memory_equal(carried, uploaded, bytes);
    free(carried);
    free(uploaded);
}

/* room: leaves per part; 0 = all in one buffer. Returns whether the arrays were split. */
static bool check_history(const tune_set *set, int64_t step, int room)
{
    cln_device *device = test_device(set);
    const size_t largest = device->max_alloc;
    uint32_t counter = 31u * (uint32_t)step + (uint32_t)room;
    cln_model host, other;
    cln_pipeline p;
    bool began_whole = true, in_parts = false;
    int met[4] = {0};

    make_model(step, &host);
    make_model(step, &other);
    assert_ok(cln_pipeline_create(device, &host.config,
                                  &(cln_pipeline_facts){.space = &cln_space_unit}, CLN_PROGRAMS_ALL,
                                  &p));
    assert_true(cln_pipeline_measures(&host.config) > 0);
    device->spoil = true;
    if (room > 0)
        device->max_alloc = (size_t)room * (size_t)p.net.params * sizeof(float);
    assert_ok(cln_pipeline_upload(&p, &other, true));
    began_whole = p.parts == 1;
    for (int round = 0; round < ROUNDS; round++) {
        cln_octree_change change = {0}, next = {0};
        uint8_t *marks = test_alloc(8 * 512, 1);

        assert_true(host.tree.leaf_count < 300);
        if (round == 2) { /* growth: split all leaves */
            memset(marks, 1, (size_t)host.tree.leaf_count);
            change_both(&host, &other, marks, 1, &change);
        } else if (round == 5) {
            mark(&host.tree, NULL, 2, &counter, marks);
            change_both(&host, &other, marks, 3, &change);
        } else if (round % 3 == 1) {
            mark(&host.tree, NULL, 2, &counter, marks);
            change_both(&host, &other, marks, 2, &change);
        } else {
            mark(&host.tree, NULL, 0, &counter, marks);
            change_both(&host, &other, marks, 0, &change);
            mark(&host.tree, &change, 1, &counter, marks);
            change_both(&host, &other, marks, 1, &next);
            assert_ok(cln_octree_change_join(&change, &next));
        }
        for (int s = 0; s < change.count; s++)
            met[change.octant[s] == CLN_COPIED  ? 0
                : change.octant[s] == CLN_FRESH ? 3
                : change.octant[s] >= 0         ? 1
                                                : 2]++;
        assert_ok(cln_pipeline_rebuild(&p, other.tree.leaf_count));
        assert_ok(cln_pipeline_carry(&p, &other.tree, &change));
        assert_ok(cln_pipeline_download(&p, &other, true));
        assert_same(&host, &other);
        assert_int_equal(p.params.bytes, (size_t)p.leaves * (size_t)p.net.params * sizeof(float));
        assert_transposed(&p, &host);
        in_parts = p.parts > 1;
        cln_octree_change_free(&change);
        cln_octree_change_free(&next);
        free(marks);
    }
    print_message("%s: %d leaves kept, %d split off, %d merged, %d fresh, %s\n", set->name, met[0],
                  met[1], met[2], met[3], in_parts ? "in parts" : "whole");
    assert_true(began_whole && met[0] > 0 && met[1] > 0 && met[2] > 0 && met[3] > 0);
    device->max_alloc = largest;
    device->spoil = false;
    cln_pipeline_free(&p);
    cln_model_free(&host);
    cln_model_free(&other);
    return in_parts;
}

static void test_histories(void **state)
{
    (void)state;
    for (int64_t step = 1; step <= 4; step++) /* odd: moments of 32 bits, even: of 16 */
        assert_false(check_history(&tune_sets[0], step, 0));
    assert_false(check_history(&tune_sets[4], 5, 0));
}

static void test_into_parts(void **state)
{
    (void)state;
    assert_true(check_history(&tune_sets[0], 6, 60));
    assert_true(check_history(&tune_sets[4], 7, 60));
}

/* A change beyond the available memory fails with a sentence, and the pipeline can be freed. */
static void test_no_memory(void **state)
{
    cln_device *device = test_device(&tune_sets[0]);
    cln_octree_change change;
    cln_model model;
    cln_pipeline p;

    (void)state;
    make_model(3, &model);
    assert_ok(cln_pipeline_create(device, &model.config,
                                  &(cln_pipeline_facts){.space = &cln_space_unit}, CLN_PROGRAMS_ALL,
                                  &p));
    assert_ok(cln_pipeline_upload(&p, &model, true));
    assert_ok(cln_octree_split(&model.tree, NULL, &change));
    assert_ok(cln_model_follow(&model, &change));
    device->limit = device->allocated + 4096;
    assert_int_equal(cln_pipeline_carry(&p, &model.tree, &change), CLN_MEMORY);
    cln_clear_error();
    device->limit = 0;
    cln_pipeline_free(&p);
    assert_int_equal(device->allocated, 0);
    cln_octree_change_free(&change);
    cln_model_free(&model);
}

int test_group_carry(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_histories),
        cmocka_unit_test(test_into_parts),
        cmocka_unit_test(test_no_memory),
    };

    return cmocka_run_group_tests_name("carry", tests, NULL, test_device_close);
}
