/* PSNR and SSIM. See metrics_image.h for the definitions.
 *
 * SSIM filters a, b, aa, bb, ab with a separable Gaussian in one sweep down the image: each row is
 * filtered sideways once into a ring of 11 rows, and a row of the map is the weighted sum of the
 * ring. Memory is that of 55 rows, whatever the height. */
#include "render/metrics_image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/number.h"

enum { WINDOW = CLN_SSIM_WINDOW, MOMENTS = 5 /* a, b, aa, bb, ab */ };

/* Not fmin/fmax: they would turn a NaN into a number. */
static double clipped(float value)
{
    return value < 0 ? 0 : value > 1 ? 1 : (double)value;
}

double cln_image_mse(int width, int height, const uint8_t *kept, const float *a, const float *b)
{
    const size_t all = (size_t)width * (size_t)height * 3;
    size_t count = 0;
    double sum = 0;

    for (size_t i = 0; i < all; i++) {
        const double difference = clipped(a[i]) - clipped(b[i]);

        if (kept && !kept[i / 3])
            continue;
        sum += difference * difference;
        count++;
    }
    return count ? sum / (double)count : 0;
}

cln_status cln_image_most_mse(int width, int height, const uint8_t *kept, const float *a,
                              const float *b, double share, double *mse)
{
    cln_status st = CLN_OK;
    const size_t pixels = (size_t)width * (size_t)height;
    double *errors = NULL, sum = 0;
    size_t count = 0, most = 0;

    CLN_TRY(cln_alloc(&errors, pixels, sizeof *errors, "picture"));
    for (size_t i = 0; i < pixels; i++) {
        if (kept && !kept[i])
            continue;
        for (size_t c = 3 * i; c < 3 * i + 3; c++)
            errors[count] += pow(clipped(a[c]) - clipped(b[c]), 2) / 3;
        errors[count] = isnan(errors[count]) ? INFINITY : errors[count];
        count++;
    }
    most = (size_t)ceil(share * (double)count);
    cln_reals_split(errors, count, most);
    for (size_t i = 0; i < most; i++)
        sum += errors[i];
    *mse = most ? sum / (double)most : 0;
done:
    free(errors);
    return st;
}

/* An affine map of colours: to[i] = sum_j matrix[i][j] (from[j] - from_mean[j]) + to_mean[i]. */
typedef struct colour_map {
    double matrix[3][3], from_mean[3], to_mean[3];
} colour_map;

static void find_means(size_t pixels, const uint8_t *kept, const float *a, const float *b,
                       colour_map *map)
{
    double count = 0;

    for (size_t i = 0; i < pixels; i++) {
        if (kept && !kept[i])
            continue;
        for (size_t c = 0; c < 3; c++) {
            map->from_mean[c] += clipped(a[3 * i + c]);
            map->to_mean[c] += clipped(b[3 * i + c]);
        }
        count++;
    }
    for (int c = 0; c < 3; c++) {
        map->from_mean[c] /= count > 0 ? count : 1;
        map->to_mean[c] /= count > 0 ? count : 1;
    }
}

/* Solves matrix x = right for three right sides by Gauss-Jordan elimination; matrix is symmetric
 * and positive definite, so no pivots are needed. right becomes x. */
static void solve(double matrix[3][3], double right[3][3])
{
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) {
            const double factor = matrix[i][k] / matrix[k][k];

            for (int j = 0; i != k && j < 3; j++) {
                matrix[i][j] -= factor * matrix[k][j];
                right[i][j] -= factor * right[k][j];
            }
        }
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            right[k][j] /= matrix[k][k];
}

/* Least squares by the normal equations of centred colours. */
static colour_map fit_colours(size_t pixels, const uint8_t *kept, const float *a, const float *b)
{
    colour_map map = {0};
    double square[3][3] = {{0}}, product[3][3] = {{0}};

    find_means(pixels, kept, a, b, &map);
    for (size_t i = 0; i < pixels; i++) {
        double from[3], to[3];

        if (kept && !kept[i])
            continue;
        for (size_t c = 0; c < 3; c++) {
            from[c] = clipped(a[3 * i + c]) - map.from_mean[c];
            to[c] = clipped(b[3 * i + c]) - map.to_mean[c];
        }
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) {
                square[j][k] += from[j] * from[k];
                product[j][k] += from[j] * to[k];
            }
    }
    const double trace = square[0][0] + square[1][1] + square[2][2];

    /* grey pictures, or those of one colour, do not determine all of the matrix */
    for (int c = 0; c < 3; c++)
        square[c][c] += 1e-6 * trace + 1e-12;
    solve(square, product);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            map.matrix[i][j] = product[j][i];
    return map;
}

double cln_image_fitted_mse(int width, int height, const uint8_t *kept, const float *a,
                            const float *b)
{
    const size_t pixels = (size_t)width * (size_t)height;
    const colour_map map = fit_colours(pixels, kept, a, b);
    size_t count = 0;
    double sum = 0;

    for (size_t i = 0; i < pixels; i++) {
        if (kept && !kept[i])
            continue;
        for (size_t c = 0; c < 3; c++) {
            double fitted = map.to_mean[c];

            for (size_t j = 0; j < 3; j++)
                fitted += map.matrix[c][j] * (clipped(a[3 * i + j]) - map.from_mean[j]);
            fitted = fitted < 0 ? 0 : fitted > 1 ? 1 : fitted;
            sum += (fitted - clipped(b[3 * i + c])) * (fitted - clipped(b[3 * i + c]));
        }
        count += 3;
    }
    return count ? sum / (double)count : 0;
}

double cln_psnr(double mse)
{
    /* Equal images have no finite PSNR; 100 dB is beyond what 8 or 16 bits can show. */
    return mse < 1e-10 ? 100 : -10 * log10(mse);
}

static void gaussian(double weight[WINDOW])
{
    double sum = 0;

    for (int i = 0; i < WINDOW; i++) {
        const double x = (i - WINDOW / 2) / 1.5;

        weight[i] = exp(-0.5 * x * x);
        sum += weight[i];
    }
    for (int i = 0; i < WINDOW; i++)
        weight[i] /= sum;
}

/* Moments of one row and channel, filtered sideways: out[moment][valid]. */
static void filter_row(int valid, const double weight[WINDOW], const float *a, const float *b,
                       double *out)
{
    for (int x = 0; x < valid; x++) {
        double m[MOMENTS] = {0};

        for (int i = 0; i < WINDOW; i++) {
            const double va = clipped(a[(x + i) * 3]), vb = clipped(b[(x + i) * 3]);

            m[0] += weight[i] * va;
            m[1] += weight[i] * vb;
            m[2] += weight[i] * va * va;
            m[3] += weight[i] * vb * vb;
            m[4] += weight[i] * va * vb;
        }
        for (int k = 0; k < MOMENTS; k++)
            out[(size_t)k * (size_t)valid + (size_t)x] = m[k];
    }
}

static double ssim_of_moments(const double m[MOMENTS])
{
    const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    const double mu00 = m[0] * m[0], mu11 = m[1] * m[1], mu01 = m[0] * m[1];
    double s00 = m[2] - mu00, s11 = m[3] - mu11, s01 = m[4] - mu01, bound = 0;

    /* Rounding may leave tiny negative variances, and a covariance beyond them. */
    if (s00 < 0)
        s00 = 0;
    if (s11 < 0)
        s11 = 0;
    bound = sqrt(s00 * s11);
    if (fabs(s01) > bound)
        s01 = copysign(bound, s01);
    return (2 * mu01 + c1) * (2 * s01 + c2) / ((mu00 + mu11 + c1) * (s00 + s11 + c2));
}

/* Marks whole windows by their lowest row and first column: [height][valid]. */
static cln_status find_windows(int width, int height, const uint8_t *kept, uint8_t **out)
{
    cln_status st = CLN_OK;
    const int valid = width - WINDOW + 1;
    int *run = NULL; /* [width] run of kept pixels in each column that ends in this row */

    CLN_TRY(cln_alloc(&run, (size_t)width, sizeof *run, "SSIM windows"));
    CLN_TRY(cln_alloc(out, (size_t)height * (size_t)valid, 1, "SSIM windows"));
    for (int y = 0; y < height; y++) {
        int columns = 0;

        for (int x = 0; x < width; x++) {
            run[x] = kept[(size_t)y * (size_t)width + (size_t)x] ? run[x] + 1 : 0;
            columns = run[x] >= WINDOW ? columns + 1 : 0;
            if (columns >= WINDOW)
                (*out)[(size_t)y * (size_t)valid + (size_t)(x - WINDOW + 1)] = 1;
        }
    }
done:
    free(run);
    return st;
}

cln_status cln_ssim_has_window(int width, int height, const uint8_t *kept, bool *has)
{
    cln_status st = CLN_OK;
    uint8_t *whole = NULL;

    CLN_TRY(find_windows(width, height, kept, &whole));
    *has = memchr(whole, 1, (size_t)height * (size_t)(width - WINDOW + 1)) != NULL;
done:
    free(whole);
    return st;
}

cln_status cln_image_ssim(int width, int height, const uint8_t *kept, const float *a,
                          const float *b, double *ssim)
{
    cln_status st = CLN_OK;
    const int valid = width - WINDOW + 1;
    double weight[WINDOW], total = 0, windows = 0;
    uint8_t *whole = NULL;
    double *ring = NULL; /* [WINDOW][MOMENTS][valid] */
    size_t stride = 0;

    if (width < WINDOW || height < WINDOW)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "SSIM needs images of %d x %d pixels or more, this one is %d x %d", WINDOW,
                         WINDOW, width, height));
    if (kept)
        CLN_TRY(find_windows(width, height, kept, &whole));
    gaussian(weight);
    stride = MOMENTS * (size_t)valid;
    CLN_TRY(cln_alloc(&ring, WINDOW * stride, sizeof *ring, "SSIM rows"));
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < height; y++) {
            const size_t row = (size_t)y * (size_t)width * 3 + (size_t)c;
            double row_sum = 0;

            filter_row(valid, weight, a + row, b + row, ring + (size_t)(y % WINDOW) * stride);
            if (y < WINDOW - 1)
                continue;
            for (int x = 0; x < valid; x++) {
                double m[MOMENTS] = {0};

                if (whole && !whole[(size_t)y * (size_t)valid + (size_t)x])
                    continue;
                windows++;
                for (int i = 0; i < WINDOW; i++) {
                    const double *from = ring + (size_t)((y + 1 + i) % WINDOW) * stride + x;

                    for (int k = 0; k < MOMENTS; k++)
                        m[k] += weight[i] * from[(size_t)k * (size_t)valid];
                }
                row_sum += ssim_of_moments(m);
            }
            total += row_sum;
        }
    *ssim = windows > 0 ? total / windows : NAN;
done:
    free(whole);
    free(ring);
    return st;
}
