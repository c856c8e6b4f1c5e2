/* PSNR and SSIM of pictures. Oracles: numbers calculated by hand, and SSIM of a separate program
 * with direct two-dimensional windows. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "near.h"
#include "render/metrics_image.h"
#include "tests.h"

/* Results of a separate program (direct 11 x 11 windows, centred moments, double) for make_pair. */
enum { W = 14, H = 13 };
static const double MSE_OF_PAIR = 0.14807978479853479, SSIM_OF_PAIR = 0.12970402123047567;

/* The images of that program. */
static void make_pair(float *a, float *b)
{
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++) {
                const int i = (y * W + x) * 3 + c, base = x * 7 + y * 3 + c * 5;

                a[i] = (float)(base % 16) / 16;
                b[i] = (float)((base + x * y) % 16) / 16;
            }
}

static void test_psnr(void **state)
{
    float a[W * H * 3], b[W * H * 3];
    const float two[6] = {0, 0.5f, 1, 0, 0, 0}, other[6] = {0.1f, 0.5f, 1, 0, 0, -5};
    const float not_a_number[3] = {NAN, 0, 0};

    (void)state;
    make_pair(a, b);
    assert_true(cln_image_mse(W, H, NULL, a, a) == 0);
    assert_true(cln_psnr(0) == 100);
    assert_true(cln_psnr(0.99e-10) == 100);
    assert_near(cln_psnr(1.01e-10), 99.9568, 1e-4); /* from there on without a step */
    assert_near(cln_psnr(0.01), 20, 1e-12);
    assert_near(cln_psnr(1), 0, 1e-12);
    /* One channel of six differs by 0.1; -5 is clipped to 0. */
    assert_near(cln_image_mse(2, 1, NULL, two, other), 0.01 / 6, 1e-9);
    assert_near(cln_image_mse(W, H, NULL, a, b), MSE_OF_PAIR, 1e-12);
    assert_true(isnan(cln_image_mse(1, 1, NULL, not_a_number, two)));
}

/* Of the pixels that differ least; others may be as far off as they like. */
static void test_most(void **state)
{
    float a[W * H * 3], b[W * H * 3];
    uint8_t kept[W * H];
    double mse = 0;

    (void)state;
    for (int i = 0; i < W * H; i++) {
        for (int c = 0; c < 3; c++) {
            a[3 * i + c] = 0.5f;
            b[3 * i + c] = i % 10 == 3 ? 1 : 0.4f; /* 18 of 182 */
        }
        kept[i] = i % 10 == 3 || i % 2;
    }
    assert_int_equal(cln_image_most_mse(W, H, NULL, a, b, 0.9, &mse), CLN_OK);
    assert_near(mse, 0.01, 1e-8);
    assert_int_equal(cln_image_most_mse(W, H, NULL, a, b, 1, &mse), CLN_OK);
    assert_near(mse, cln_image_mse(W, H, NULL, a, b), 1e-12);
    assert_int_equal(cln_image_most_mse(W, H, kept, a, b, 0.75, &mse), CLN_OK);
    assert_near(mse, 0.01, 1e-8); /* 73 others of 91 */
    a[0] = b[3 * 5 + 1] = NAN;    /* two that differ most */
    assert_int_equal(cln_image_most_mse(W, H, NULL, a, b, 0.8, &mse), CLN_OK);
    assert_near(mse, 0.01, 1e-8);
    a[0] = 0.5f;
    b[3 * 5 + 1] = 0.4f;
    assert_int_equal(cln_image_most_mse(W, H, kept, a, b, 1, &mse), CLN_OK);
    assert_near(mse, cln_image_mse(W, H, kept, a, b), 1e-12);
}

/* Another exposure and white balance cost nothing; other differences stay. */
static void test_fitted(void **state)
{
    float a[W * H * 3], b[W * H * 3], grey[W * H * 3], flat[W * H * 3];
    uint8_t kept[W * H];
    double rest = 0;

    (void)state;
    make_pair(a, b);
    for (int i = 0; i < W * H; i++) {
        const float *p = a + 3 * i;

        b[3 * i] = 0.1f + 0.5f * p[0] + 0.1f * p[2];
        b[3 * i + 1] = 0.05f + 0.8f * p[1];
        b[3 * i + 2] = 0.2f + 0.2f * p[0] + 0.3f * p[1] + 0.1f * p[2];
        grey[3 * i] = grey[3 * i + 1] = grey[3 * i + 2] = p[0];
        flat[3 * i] = flat[3 * i + 1] = flat[3 * i + 2] = 0.5f;
        kept[i] = i != 7;
    }
    assert_true(cln_image_mse(W, H, NULL, a, b) > 1e-3);
    assert_true(cln_image_fitted_mse(W, H, NULL, a, b) < 1e-8);
    for (int i = 0; i < W * H; i++)
        b[3 * i] += i % 2 ? 0.01f : -0.01f;
    rest = cln_image_fitted_mse(W, H, NULL, a, b);
    assert_true(rest > 0.9 * 1e-4 / 3 && rest < 1.01 * 1e-4 / 3);
    b[3 * 7] = 1; /* what is left out is left out of the fit, too */
    assert_true(cln_image_fitted_mse(W, H, NULL, a, b) > 2 * rest);
    assert_true(cln_image_fitted_mse(W, H, kept, a, b) < 1.01 * rest);
    /* a grey picture, and one of a single colour, which determines no matrix */
    assert_true(cln_image_fitted_mse(W, H, NULL, grey, grey) < 1e-8);
    assert_true(cln_image_fitted_mse(W, H, NULL, flat, grey) <=
                cln_image_mse(W, H, NULL, flat, grey));
    /* a fitted colour is never beyond white, as by the line through these some were 1.04 */
    for (int i = 0; i < W * H * 3; i++) {
        a[i] = i / 3 % 10 < 5 ? 0 : i / 3 % 10 < 9 ? 1 : 0.75f;
        b[i] = i / 3 % 10 < 5 ? 0 : 1;
    }
    assert_near(cln_image_fitted_mse(W, H, NULL, a, b), 0.00470773, 1e-7);
    a[0] = NAN;
    assert_true(isnan(cln_image_fitted_mse(W, H, NULL, a, b)));
}

static void test_ssim(void **state)
{
    float a[W * H * 3], b[W * H * 3];
    double ssim = 0;

    (void)state;
    make_pair(a, b);
    assert_int_equal(cln_image_ssim(W, H, NULL, a, a, &ssim), CLN_OK);
    assert_near(ssim, 1, 1e-12);
    assert_int_equal(cln_image_ssim(W, H, NULL, a, b, &ssim), CLN_OK);
    assert_near(ssim, SSIM_OF_PAIR, 1e-9);
    assert_int_equal(cln_image_ssim(W, H, NULL, b, a, &ssim), CLN_OK);
    assert_near(ssim, SSIM_OF_PAIR, 1e-9);

    for (int grey = 1; grey < 60; grey++) { /* equal is 1, whatever rounding leaves */
        for (int i = 0; i < W * H * 3; i++)
            a[i] = (float)grey / 60;
        assert_int_equal(cln_image_ssim(W, H, NULL, a, a, &ssim), CLN_OK);
        assert_near(ssim, 1, 1e-15);
    }

    /* Constant images have no variance: (2 * 0.5 * 0.75 + C1) / (0.25 + 0.5625 + C1). */
    for (int i = 0; i < W * H * 3; i++) {
        a[i] = 0.5f;
        b[i] = 0.75f;
    }
    assert_int_equal(cln_image_ssim(W, H, NULL, a, b, &ssim), CLN_OK);
    assert_near(ssim, (0.75 + 1e-4) / (0.8125 + 1e-4), 1e-9);

    assert_int_equal(cln_image_ssim(11, 11, NULL, a, b, &ssim), CLN_OK);
    assert_int_equal(cln_image_ssim(10, 13, NULL, a, b, &ssim), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "10 x 13"));
    cln_clear_error();
}

/* Pixels left out do not count, however wrong; SSIM takes the windows that hold none. */
static void test_left_out(void **state)
{
    float a[W * H * 3], b[W * H * 3], part[2][W * H * 3];
    uint8_t kept[W * H];
    const float two[6] = {0, 0.5f, 1, 0, 0, 0}, other[6] = {0.1f, 0.5f, 1, 1, 1, NAN};
    double ssim = 0, want = 0;

    (void)state;
    assert_near(cln_image_mse(2, 1, (uint8_t[]){1, 0}, two, other), 0.01 / 3, 1e-9);
    make_pair(a, b);
    memset(kept, 1, sizeof kept);
    assert_int_equal(cln_image_ssim(W, H, kept, a, b, &ssim), CLN_OK);
    assert_near(ssim, SSIM_OF_PAIR, 1e-9);
    /* The last column and the first row: what remains are 2 x 3 windows less the first row's. */
    for (int y = 0; y < H; y++)
        kept[y * W + W - 1] = 0;
    memset(kept, 0, W);
    assert_int_equal(cln_image_ssim(W, H, kept, a, b, &ssim), CLN_OK);
    for (int y = 1; y < H; y++)
        for (int i = 0; i < (W - 1) * 3; i++) {
            part[0][(y - 1) * (W - 1) * 3 + i] = a[y * W * 3 + i];
            part[1][(y - 1) * (W - 1) * 3 + i] = b[y * W * 3 + i];
        }
    assert_int_equal(cln_image_ssim(W - 1, H - 1, NULL, part[0], part[1], &want), CLN_OK);
    assert_near(ssim, want, 1e-12);
    kept[6 * W + 6] = 0; /* no window is left */
    assert_int_equal(cln_image_ssim(W, H, kept, a, b, &ssim), CLN_OK);
    assert_true(isnan(ssim));
}

int test_group_metrics_image(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_psnr), cmocka_unit_test(test_most),     cmocka_unit_test(test_fitted),
        cmocka_unit_test(test_ssim), cmocka_unit_test(test_left_out),
    };

    return cmocka_run_group_tests_name("metrics_image", tests, NULL, NULL);
}
