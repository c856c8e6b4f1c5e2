/* See odd_views.h. */
#include "render/odd_views.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/number.h"

/* A fit of colours brings a view among the others if it comes so near to the median of all that
 * were fitted, in dB: it takes a veil away in part alone. */
static const double AMONG_DB = 3;

/* A view is hidden if it is so far below the median, in dB, and sees as near. */
static const double HIDDEN_DB = 6, HIDDEN_DEPTH = 0.2;

/* Where something moved, an image gains so much, and more than the one that gains least, without a
 * few of its pixels. Of 17 evaluations without such things the most were 8 dB, and 3 more. */
static const double PARTLY_DB = 9, MORE_DB = 4;

/* An image is off if it is so many dB below the median of OFF_VIEWS and more, and so many times as
 * far as the lower quartile: never more than a quarter of them. At evaluations of all photos of
 * four sound scenes the worst were 2 to 5 dB below; where the pose was wrong by a degree, two were
 * exchanged or the wind blew, 6 to 15. */
static const double OFF_DB = 5.5, OFF_TIMES = 4;
enum { OFF_VIEWS = 8 };

/* Sorts them; NAN of none. */
static double median(double *values, size_t count)
{
    cln_reals_sort(values, (int)count);
    return count ? values[count / 2] : NAN;
}

cln_status cln_odd_depth(const cln_picture *picture, double *depth)
{
    cln_status st = CLN_OK;
    const size_t pixels = (size_t)picture->width * (size_t)picture->height;
    double *depths = NULL;
    size_t count = 0;

    CLN_TRY(cln_alloc(&depths, pixels, sizeof *depths, "picture"));
    for (size_t i = 0; i < pixels; i++)
        if (picture->opacity[i] > 0.5f)
            depths[count++] = (double)picture->depth[i];
    *depth = 2 * count > pixels ? median(depths, count) : NAN;
done:
    free(depths);
    return st;
}

/* The median of a member over the images where it is finite. */
static double median_of(const cln_eval_result *result, size_t member, double *values)
{
    size_t count = 0;

    for (int i = 0; i < result->count; i++) {
        memcpy(values + count, (const char *)&result->images[i] + member, sizeof *values);
        count += isfinite(values[count]);
    }
    return median(values, count);
}

/* The PSNR below which an image is off by this member; -INFINITY if there are too few. */
static double off_below(const cln_eval_result *result, size_t member, double *values)
{
    size_t count = 0;
    double middle = 0;

    for (int i = 0; i < result->count; i++) {
        memcpy(values + count, (const char *)&result->images[i] + member, sizeof *values);
        count += isfinite(values[count]) && !result->images[i].apart;
    }
    if (count < OFF_VIEWS)
        return -INFINITY;
    middle = median(values, count);
    return middle - fmax(OFF_DB, OFF_TIMES * (middle - values[count / 4]));
}

static void find_off(cln_eval_result *result, double *values)
{
    const double psnr = off_below(result, offsetof(cln_eval_image, psnr), values);
    const double fitted = off_below(result, offsetof(cln_eval_image, psnr_fitted), values);

    for (int i = 0; i < result->count; i++) {
        cln_eval_image *image = &result->images[i];

        image->off = image->psnr < psnr && !(image->psnr_fitted >= fitted) && !image->hidden &&
                     !image->apart;
    }
}

cln_status cln_odd_views(cln_eval_result *result)
{
    cln_status st = CLN_OK;
    double *values = NULL, psnr = 0, fitted = 0, depth = 0, gain = 0, least = INFINITY;
    int among = 0;

    CLN_TRY(cln_alloc(&values, (size_t)result->count + 1, sizeof *values, "evaluation"));
    psnr = median_of(result, offsetof(cln_eval_image, psnr), values);
    fitted = median_of(result, offsetof(cln_eval_image, psnr_fitted), values);
    depth = median_of(result, offsetof(cln_eval_image, depth), values);
    for (int i = 0; i < result->count; i++)
        least = fmin(least, result->images[i].psnr_most - result->images[i].psnr);
    for (int i = 0; i < result->count; i++) {
        cln_eval_image *image = &result->images[i];
        const double without = image->psnr_most - image->psnr;

        image->partly = without > PARTLY_DB && without > least + MORE_DB;
        image->hidden = image->psnr < psnr - HIDDEN_DB && image->depth < HIDDEN_DEPTH * depth;
        if (!(image->psnr_fitted >= fitted - AMONG_DB) || !isfinite(image->psnr))
            continue;
        gain += image->psnr_fitted - image->psnr;
        among++;
    }
    result->fitted_gain = among ? gain / among : NAN;
    find_off(result, values);
done:
    free(values);
    return st;
}
