/* What single views of an evaluation tell (render/odd_views.h). */
#include "unit.h"
#include <math.h>
#include "near.h"
#include "render/odd_views.h"
#include "tests.h"

enum { VIEWS = 8 };

/* Views of which a fit of colours brings `lit` from 30 to 33 dB, as gains do, and `veiled` from 10
 * to 16 dB, as a fit does of a veil; others stay at 32 dB, as does one that cannot be measured. */
static cln_eval_result views_of(cln_eval_image images[VIEWS], int lit, int veiled, double near)
{
    for (int i = 0; i < VIEWS; i++) {
        const bool is_lit = i < lit, is_veiled = !is_lit && i < lit + veiled;

        images[i] = (cln_eval_image){.psnr = is_lit      ? 30
                                             : is_veiled ? 10
                                                         : 32,
                                     .psnr_fitted = is_lit      ? 33
                                                    : is_veiled ? 16
                                                                : 32,
                                     .depth = is_veiled ? near : 2};
    }
    images[VIEWS - 1].psnr = images[VIEWS - 1].psnr_fitted = images[VIEWS - 1].depth = NAN;
    return (cln_eval_result){.count = VIEWS, .images = images};
}

/* What gains make good is exposure; what lifts views that stay far below the others is not. */
static void test_fitted_gain(void **state)
{
    static const struct {
        int lit, veiled;
        double gain;
    } cases[] = {{0, 0, 0},       {7, 0, 3}, {2, 0, 6.0 / 7},
                 {3, 0, 9.0 / 7}, {0, 2, 0}, {3, 2, 9.0 / 5}};
    cln_eval_image images[VIEWS];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_eval_result result = views_of(images, cases[i].lit, cases[i].veiled, 2);

        assert_int_equal(cln_odd_views(&result), CLN_OK);
        assert_near(result.fitted_gain, cases[i].gain, 1e-12);
        for (int k = 0; k < VIEWS; k++)
            assert_false(images[k].hidden);
    }
}

/* Images without a fit, as those of photos of one colour, tell no gain. */
static void test_gain_without_fit(void **state)
{
    cln_eval_image images[VIEWS];
    cln_eval_result result = views_of(images, 3, 0, 2);

    (void)state;
    images[0].psnr_fitted = images[3].psnr_fitted = NAN;
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    assert_near(result.fitted_gain, 6.0 / 5, 1e-12); /* of two lit ones and three others */
}

/* Hidden are views that are far below the others and see as far as something before the camera. */
static void test_hidden(void **state)
{
    cln_eval_image images[VIEWS];
    cln_eval_result result = views_of(images, 0, 2, 0.1);

    (void)state;
    images[5].depth = 0.1; /* near, but as good as the others */
    images[1].depth = NAN; /* bad, but transparent */
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    for (int k = 0; k < VIEWS; k++)
        assert_int_equal(images[k].hidden, k == 0);
    result.count = 1;
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    assert_false(images[0].hidden);
}

/* Partly off are views whose PSNR gains much without a few pixels, unless all gain that. */
static void test_partly(void **state)
{
    cln_eval_image images[VIEWS];
    cln_eval_result result = views_of(images, 0, 0, 2);

    (void)state;
    for (int i = 0; i < VIEWS; i++)
        images[i].psnr_most = images[i].psnr + (i < 2 ? 9.5 : 5.4);
    images[6].psnr_most = NAN; /* of a photo with alpha */
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    for (int i = 0; i < VIEWS; i++)
        assert_int_equal(images[i].partly, i < 2);
    for (int i = 2; i < VIEWS; i++)
        images[i].psnr_most = images[i].psnr + 5.6;
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    for (int i = 0; i < VIEWS; i++)
        assert_false(images[i].partly);
}

/* Off are a few views far below the median of eight and more, after a fit of colours, too. */
static void test_off(void **state)
{
    enum { MANY = 24 };
    static const struct {
        int count, low, apart;              /* views; those that are; the last ones */
        double below, fitted, spread, last; /* dB */
        bool off;
    } cases[] = {{24, 1, 0, 6, 6, 0, 32, true},
                 {24, 3, 0, 6, 6, 0, 32, true},
                 {24, 1, 0, 5, 6, 0, 32, false},
                 {24, 1, 0, 6, 2, 0, 32, false}, /* its exposure differs */
                 {24, 6, 0, 6, 6, 0, 32, true},
                 {24, 7, 0, 6, 6, 0, 32, false}, /* of another kind */
                 {24, 7, 0, 20, 20, 0, 32, false},
                 {7, 1, 0, 9, 9, 0, 32, false},
                 {8, 1, 0, 9, 9, 0, 32, true},
                 {24, 1, 0, 10, 10, 2, 32, false}, /* all are spread */
                 {24, 1, 0, 6, 6, 0, NAN, true},
                 {8, 1, 1, 9, 9, 0, 32, false}, /* seven see the part that is evaluated */
                 {9, 1, 1, 9, 9, 0, 32, true},
                 {24, 24, 24, 9, 9, 0, 32, false}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_eval_image images[MANY] = {0};
        cln_eval_result result = {.count = cases[i].count, .images = images};

        for (int k = 0; k < result.count; k++) {
            const bool low = k < cases[i].low;
            const double psnr = 32 - k % 4 * cases[i].spread;

            images[k] = (cln_eval_image){.psnr = low ? 32 - cases[i].below : psnr,
                                         .psnr_fitted = low ? 32 - cases[i].fitted : psnr,
                                         .depth = 2,
                                         .apart = k >= result.count - cases[i].apart};
        }
        if (isnan(cases[i].last))
            images[MANY - 1].psnr = images[MANY - 1].psnr_fitted = NAN;
        assert_int_equal(cln_odd_views(&result), CLN_OK);
        for (int k = 0; k < result.count; k++)
            assert_int_equal(images[k].off, cases[i].off && k < cases[i].low);
    }
}

/* What is told of as hidden, or does not see the part, is not off besides. */
static void test_off_is_told_once(void **state)
{
    cln_eval_image images[VIEWS + 2];
    cln_eval_result result = {.count = VIEWS + 2, .images = images};

    (void)state;
    for (int i = 0; i < result.count; i++) {
        const double psnr = i < 3 ? 20 : 32;

        images[i] = (cln_eval_image){.psnr = psnr, .psnr_fitted = psnr, .depth = 2};
    }
    images[0].depth = 0.1;
    images[1].apart = true;
    assert_int_equal(cln_odd_views(&result), CLN_OK);
    for (int i = 0; i < result.count; i++) {
        assert_int_equal(images[i].hidden, i == 0);
        assert_int_equal(images[i].off, i == 2);
    }
}

/* The depth is the median of opaque pixels, if most are. */
static void test_depth(void **state)
{
    float depth[5] = {3, 1, 2, 9, 9}, opacity[5] = {1, 0.6f, 1, 0.4f, 0};
    cln_picture picture = {.width = 5, .height = 1, .depth = depth, .opacity = opacity};
    double got = 0;

    (void)state;
    assert_int_equal(cln_odd_depth(&picture, &got), CLN_OK);
    assert_true(got == 2);
    opacity[1] = 0.5f;
    assert_int_equal(cln_odd_depth(&picture, &got), CLN_OK);
    assert_true(isnan(got));
}

int test_group_odd_views(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fitted_gain),
        cmocka_unit_test(test_hidden),
        cmocka_unit_test(test_partly),
        cmocka_unit_test(test_off),
        cmocka_unit_test(test_depth),
        cmocka_unit_test(test_gain_without_fit),
        cmocka_unit_test(test_off_is_told_once),
    };

    return cmocka_run_group_tests_name("odd_views", tests, NULL, NULL);
}
