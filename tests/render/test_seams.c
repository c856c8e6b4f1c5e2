/* `eval --seams` on a field that is known: eight leaves, constant inside, a chessboard of two
 * colours and densities, thin enough that surfaces lie everywhere. Every face has the same jump,
 * and inside there is none. */
#include "unit.h"
#include "model/model.h"
#include "run_fixture.h"
#include "tests.h"

static const double colour_raw[2] = {-0.5, 1.2}, density_raw[2] = {0.2, 0.9};

static double sigma_of(const cln_config *config, double raw)
{
    return config->density_scale * log1p(exp(raw + cln_network_density_bias(config)));
}

/* Is the leaf in an odd octant of the cube? */
static bool is_odd(const cln_octree *tree, int slot)
{
    const int node = tree->leaf[slot], deeper = tree->level[node] - 1;
    const uint16_t *pos = tree->pos[node];

    return ((pos[0] >> deeper) + (pos[1] >> deeper) + (pos[2] >> deeper)) % 2;
}

/* A run whose leaves hold a constant each, by the parity of their octant; eight leaves instead of
 * each odd one, if these are to be fine. */
static void make_chessboard(const char *run, bool one_colour, bool fine)
{
    const cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 2};
    cln_train_result result;
    cln_model model = {0};

    assert_fails(fixture_train(run, false, &config, &stop, &result), CLN_SIGINT, "");
    assert_ok(cln_checkpoint_read(fixture_path(run), true, &model));
    assert_int_equal(model.tree.leaf_count, 8);
    if (fine) {
        cln_octree_change change;
        uint8_t marks[8];

        for (int s = 0; s < 8; s++)
            marks[s] = (uint8_t)is_odd(&model.tree, s);
        assert_ok(cln_octree_split(&model.tree, marks, &change));
        assert_ok(cln_model_apply(&model, &change));
        cln_octree_change_free(&change);
        assert_int_equal(model.tree.leaf_count, 4 + 8 * 4);
    }
    for (int s = 0; s < model.tree.leaf_count; s++) {
        const int odd = !one_colour && is_odd(&model.tree, s);
        float *own = model.params + (size_t)s * (size_t)model.net.params;

        memset(own, 0, (size_t)model.net.params * sizeof *own);
        own[model.net.sigma_b] = (float)density_raw[odd];
        for (int c = 0; c < 3; c++)
            own[model.net.colour_b + c] = (float)colour_raw[odd];
    }
    assert_ok(cln_checkpoint_write(fixture_path(run), &model));
    cln_model_free(&model);
}

static void measure(const char *run, cln_eval_result *result)
{
    fixture_stop none = {0};
    const cln_eval_desc desc = {.run = fixture_path(run),
                                .split = "test",
                                .seams = true,
                                .device = fixture_device(),
                                .callbacks = fixture_callbacks(&none)};

    assert_ok(cln_eval(&desc, result));
    assert_true(result->seams.measured);
}

static void assert_near(const char *what, double got, double want)
{
    if (!(fabs(got - want) < 1e-5))
        fail_msg("%s: %.9g, not %.9g", what, got, want);
}

static void test_chessboard(void **state)
{
    const cln_config config = fixture_config();
    const double length = 1.0 / config.n1; /* leaves of side 1 */
    const double colour = 1 / (1 + exp(-colour_raw[1])) - 1 / (1 + exp(-colour_raw[0]));
    const double alpha = exp(-sigma_of(&config, density_raw[0]) * length) -
                         exp(-sigma_of(&config, density_raw[1]) * length);
    cln_eval_result result, again;
    json_t *document = NULL;
    char *text = NULL;

    NEED_DEVICE();
    make_chessboard("chessboard", false, false);
    measure("chessboard", &result);
    print_message("%d pairs across faces, %d inside\n", result.seams.across.pairs,
                  result.seams.inside.pairs);
    assert_true(result.seams.across.pairs > 50 && result.seams.inside.pairs > 50);
    assert_near("colour", result.seams.across.colour, colour);
    assert_near("colour, 95 %", result.seams.across.colour_95, colour);
    assert_near("alpha", result.seams.across.alpha, alpha);
    assert_near("alpha, 95 %", result.seams.across.alpha_95, alpha);
    assert_true(result.seams.inside.colour == 0 && result.seams.inside.colour_95 == 0);
    assert_true(result.seams.inside.alpha == 0 && result.seams.inside.alpha_95 == 0);
    measure("chessboard", &again);
    assert_true(again.seams.across.colour == result.seams.across.colour);
    assert_true(again.seams.across.alpha == result.seams.across.alpha);
    assert_int_equal(again.seams.across.pairs, result.seams.across.pairs);
    assert_ok(cln_eval_json(&result, &text));
    document = fixture_parse(text);
    assert_int_equal(json_integer_value(fixture_at(document, "seams.across.pairs")),
                     result.seams.across.pairs);
    assert_true(json_real_value(fixture_at(document, "seams.across.alpha")) ==
                result.seams.across.alpha);
    assert_true(json_real_value(fixture_at(document, "seams.inside.colour_95")) == 0);
    json_decref(document);
    cln_eval_free(&again);
    cln_eval_free(&result);
}

/* Between leaves of two sizes the jump of alpha is that of a step in the finer one. */
static void test_two_sizes(void **state)
{
    const cln_config config = fixture_config();
    const double length = 0.5 / config.n1;
    const double alpha = exp(-sigma_of(&config, density_raw[0]) * length) -
                         exp(-sigma_of(&config, density_raw[1]) * length);
    cln_eval_result result;

    NEED_DEVICE();
    make_chessboard("two sizes", false, true);
    measure("two sizes", &result);
    assert_true(result.seams.across.pairs > 50);
    assert_near("alpha, 95 %", result.seams.across.alpha_95, alpha);
    assert_true(result.seams.inside.alpha == 0);
    cln_eval_free(&result);
}

/* A uniform field has no seam; an evaluation without --seams reports none. */
static void test_none(void **state)
{
    cln_eval_result result;
    json_t *document = NULL;

    NEED_DEVICE();
    make_chessboard("one colour", true, false);
    measure("one colour", &result);
    assert_true(result.seams.across.pairs > 50);
    assert_true(result.seams.across.colour == 0 && result.seams.across.alpha == 0);
    cln_eval_free(&result);
    document = fixture_json("whole/eval/00000030-test.json");
    assert_null(json_object_get(document, "seams"));
    json_decref(document);
}

int test_group_seams(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_chessboard),
                                       cmocka_unit_test(test_two_sizes),
                                       cmocka_unit_test(test_none)};

    return cmocka_run_group_tests_name("seams", tests, fixture_setup, fixture_teardown);
}
