/* `cl-nascent eval`: PSNR, SSIM and LPIPS per image and in the mean, as a table or as the document
 * that is in RUN/eval/STEP-SPLIT.json. */
#include "cli/commands.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/number.h"
#include "base/text.h"
#include "cli/console.h"
#include "ranks/ranks.h"

/* dB by which a fit of colours raises PSNR where exposures differ; by less, other errors do. And to
 * which it does: of what hardly shows the scene any fit gains. */
static const double EXPOSURE_HINT = 1, LEAST_FITTED = 18;

/* `network` that LPIPS is by, or "". */
static void print_row(int width, const char *name, const char *network, const double figures[3],
                      double seconds, bool apart)
{
    char p[32], s[32], l[32];

    cln_format_real(figures[0], 2, p);
    cln_format_real(figures[1], 4, s);
    cln_format_real(figures[2], 4, l);
    cln_print_name(name, width);
    printf("  %6s  %6s%s%s  %7.2f%s\n", p, s, *network ? "  " : "", *network ? l : "", seconds,
           apart ? "  *" : "");
}

static void print_jump(const char *where, const cln_eval_jump *jump)
{
    char numbers[4][32], pairs[32];

    cln_format_count(jump->pairs, pairs);
    cln_format_real(jump->colour, 4, numbers[0]);
    cln_format_real(jump->colour_95, 4, numbers[1]);
    cln_format_real(jump->alpha, 4, numbers[2]);
    cln_format_real(jump->alpha_95, 4, numbers[3]);
    printf("%-22s  %8s  %10s  %10s  %10s  %10s\n", where, pairs, numbers[0], numbers[1], numbers[2],
           numbers[3]);
}

static void print_seams(const cln_eval_seams *seams)
{
    printf("%-22s  %8s  %10s  %10s  %10s  %10s\n", "changes at surfaces", "pairs", "colour", "95 %",
           "alpha", "95 %");
    print_jump("from leaf to leaf", &seams->across);
    print_jump("the same step inside", &seams->inside);
    putchar('\n');
}

/* Was it trained with --exposure? If that cannot be read, the evaluation says why. */
static bool has_exposure(const char *run)
{
    cln_settings *settings = NULL;
    char text[CLN_SETTING_BYTES] = "";

    if (cln_settings_of_run(run, &settings) != CLN_OK ||
        cln_settings_get(settings, "exposure", text, sizeof text) != CLN_OK)
        cln_clear_error();
    cln_settings_free(settings);
    return strcmp(text, "yes") == 0;
}

/* exposure: the run was trained with it. */
static void print_fitted(const cln_eval_result *r, bool exposure)
{
    const bool alpha = isfinite(r->opacity_error), gains = isfinite(r->psnr_exposed);
    const int all = r->count - r->apart;
    char of[48] = "";
    int fitted = 0;

    for (int i = 0; i < r->count; i++)
        fitted += !r->images[i].apart && isfinite(r->images[i].psnr_fitted);
    if (fitted < all) /* any render fits a photo of one colour */
        cln_format(of, sizeof of, ", of %d of %d image%s", fitted, all, cln_plural(all, "", "s"));
    if (gains)
        printf("PSNR at %s: %.2f\n",
               strcmp(r->split, "train") == 0
                   ? "the gains that --exposure fitted"
                   : "the exposure that photos before and after each one tell",
               r->psnr_exposed);
    if (isfinite(r->psnr_fitted))
        printf("PSNR after an affine fit of each render's colours to its photo: %.2f%s\n",
               r->psnr_fitted, of);
    if (!gains && !alpha && r->fitted_gain > EXPOSURE_HINT && r->psnr_fitted > LEAST_FITTED)
        puts(exposure
                 ? "Exposure or white balance differs between photos, and the run, though trained "
                   "with --exposure, has no gains for these"
                 : "Exposure or white balance differs between photos: train with --exposure, "
                   "or see what `cl-nascent check` says of them");
}

/* The views whose member `flag` is set. */
static cln_listed list_views(const cln_eval_result *r, size_t flag)
{
    cln_listed listed = {0};

    for (int i = 0; i < r->count; i++)
        if (*(const bool *)((const char *)&r->images[i] + flag))
            cln_listed_add(&listed, 3, "%s", r->images[i].name);
    return listed;
}

/* Views whose camera stands in, or right behind, what nothing contradicts. */
static void print_hidden(const cln_eval_result *r)
{
    const cln_listed hidden = list_views(r, offsetof(cln_eval_image, hidden));
    char depth[32];
    double nearest = INFINITY;

    for (int i = 0; i < r->count; i++)
        if (r->images[i].hidden)
            nearest = fmin(nearest, r->images[i].depth);
    cln_format_real(nearest, 3, depth);
    if (hidden.count)
        printf("%d of %d views %s hidden by something right before the camera, at a distance of %s "
               "(%s): where no training photo looks through, anything may be. Photos from there, "
               "or from farther away, tell; else keep to the photos' places\n",
               hidden.count, r->count, cln_plural(hidden.count, "is", "are"), depth, hidden.text);
}

/* Are all that are in the mean empty? Then a PSNR tells how little the photos show. */
static bool shows_nothing(const cln_eval_result *r)
{
    return list_views(r, offsetof(cln_eval_image, empty)).count == r->count - r->apart &&
           r->apart < r->count;
}

static void print_empty(const cln_eval_result *r)
{
    const cln_listed empty = list_views(r, offsetof(cln_eval_image, empty));

    if (shows_nothing(r))
        puts("the renders show nothing: nothing was learnt, and the figures tell only how little "
             "of the photos is not background (see what `cl-nascent check` says of them, and "
             "whether --bbox is around the object)");
    else if (empty.count)
        printf("%d of %d renders %s nothing, so their figures tell only how little of these photos "
               "is not background (%s)\n",
               empty.count, r->count, cln_plural(empty.count, "shows", "show"), empty.text);
}

/* Views of which a small part is off. */
static void print_partly(const cln_eval_result *r)
{
    const cln_listed partly = list_views(r, offsetof(cln_eval_image, partly));

    if (partly.count)
        printf("%d of %d views differ%s from the photo in a small part of it, less than 7 %% of "
               "its pixels (%s): something that moved, or that few photos show (NAME.error.png)? "
               "Masks take it out\n",
               partly.count, r->count, cln_plural(partly.count, "s", ""), partly.text);
}

/* Views that fit worse than the others. */
static void print_off(const cln_eval_result *r)
{
    const cln_listed off = list_views(r, offsetof(cln_eval_image, off));
    const bool held_out = strcmp(r->split, "train") != 0;
    double worst = INFINITY;

    for (int i = 0; i < r->count; i++)
        if (r->images[i].off)
            worst = fmin(worst, r->images[i].psnr);
    if (off.count)
        printf("%d of %d photos fit%s far worse than the others, down to %.1f dB (%s): %s may be "
               "wrong, as of a camera that was bumped or exchanged, or the mask, or the photo is "
               "blurred, or things moved then%s. Look at NAME.error.png, train with "
               "--refine-poses, or leave %s out\n",
               off.count, r->count, cln_plural(off.count, "s", ""), worst, off.text,
               cln_plural(off.count, "its pose", "their poses"),
               held_out ? "; of a held-out photo, few others may show the same" : "",
               cln_plural(off.count, "it", "them"));
}

/* Photos that were divided: figures of them do not compare with those of whole ones. */
static void print_sizes(const cln_eval_result *r)
{
    const cln_eval_image *most = &r->images[0];
    bool alike = true;

    for (int i = 1; i < r->count; i++) {
        const cln_eval_image *e = &r->images[i];

        alike = alike && e->downscale == most->downscale && e->file_width == most->file_width &&
                e->file_height == most->file_height;
        most = e->downscale > most->downscale ? e : most;
    }
    if (most->downscale > 1)
        printf("%s of %d x %d pixels, measured at %d x %d (--downscale %d; a training with 1 "
               "leaves them as they are)\n",
               alike ? "photos:" : "photos: some", most->file_width, most->file_height, most->width,
               most->height, most->downscale);
}

static void print_table(const cln_eval_result *r, bool exposure)
{
    const bool all = strcmp(r->split, "all") == 0;
    char digest[32], step[32], duration[32];
    int width = 5;

    cln_digest_text(r->digest, digest);
    cln_format_count((double)r->step, step);
    cln_format_duration(r->train_seconds, duration);
    for (int i = 0; i < r->count; i++) {
        const int own = cln_name_width(r->images[i].name);

        width = own > width ? own : width;
    }
    printf("%-*s  %6s  %6s%s  %7s\n", width, "image", "PSNR", "SSIM",
           *r->lpips_network ? "   LPIPS" : "", "seconds");
    for (int i = 0; i < r->count; i++) {
        const cln_eval_image *e = &r->images[i];

        print_row(width, e->name, r->lpips_network, (const double[3]){e->psnr, e->ssim, e->lpips},
                  e->seconds, e->apart);
    }
    print_row(width, "mean", r->lpips_network, (const double[3]){r->psnr, r->ssim, r->lpips},
              r->seconds, false);
    putchar('\n');
    if (r->apart == r->count)
        puts("* none of the photos shows anything of the scene's cube, so their figures "
             "tell nothing of what was trained");
    else if (r->apart > 0)
        printf("* photos that show nothing of the scene's cube; the mean is over the other %d of "
               "%d\n",
               r->count - r->apart, r->count);
    if (r->seams.measured)
        print_seams(&r->seams);
    print_fitted(r, exposure);
    print_empty(r);
    print_hidden(r);
    print_partly(r);
    print_off(r);
    if (isfinite(r->opacity_error)) {
        printf("opacity: RMS error %.4f", r->opacity_error);
        if (isfinite(r->opaque_air))
            printf("; opaque where the images are transparent: %.2f %% of the pixels",
                   100 * r->opaque_air);
        putchar('\n');
    }
    print_sizes(r);
    if (*r->lpips_network)
        printf("LPIPS 0.1 by %s\n", strcmp(r->lpips_network, "alex") == 0 ? "AlexNet" : "VGG-16");
    printf("\n%d%s%s image%s%s at step %s, after %s of training; background %g,%g,%g; model %s\n",
           r->count, all ? "" : " ", all ? "" : r->split, cln_plural(r->count, "", "s"),
           all ? " of all splits" : "", step, duration, r->background[0], r->background[1],
           r->background[2], digest);
}

cln_status cln_cmd_eval(const cln_options *options)
{
    cln_status st = CLN_OK, evaluated = CLN_OK;
    cln_console console = {0};
    cln_eval_result result = {0};
    char *json = NULL;
    bool exposure = false;
    float background[3] = {0};
    cln_eval_desc desc = {.run = options->operand,
                          .scene = options->scene,
                          .split = options->split,
                          .max_images = options->max_images,
                          .views = options->views,
                          .antialias = options->antialias,
                          .fast = options->fast,
                          .seams = options->seams,
                          .lpips = options->lpips,
                          .save_images = options->save_images,
                          .out = options->output,
                          .device = options->device};

    if (options->background)
        CLN_TRY(cln_background_read(options->background, "", background));
    desc.background = options->background ? background : NULL;
    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    exposure = has_exposure(options->operand); /* before there is an error to be told */
    evaluated = cln_eval(&desc, &result);
    cln_console_close(&console);
    if (result.count == 0)
        CLN_TRY(evaluated);
    if (options->json && cln_ranks_me() == 0)
        CLN_TRY(cln_eval_json(&result, &json));
    if (json)
        CLN_TRY(cln_print_json(json_loads(json, 0, NULL)));
    else if (cln_ranks_me() == 0)
        print_table(&result, exposure);
    CLN_TRY(evaluated); /* an error of writing comes after the figures */
    if (!(result.psnr >= options->min_psnr))
        CLN_TRY(cln_fail(CLN_THRESHOLD, "%s: mean PSNR %.2f dB is below --min-psnr %g",
                         options->operand, result.psnr, options->min_psnr));
    if (options->min_psnr > 0 && shows_nothing(&result))
        CLN_TRY(cln_fail(CLN_THRESHOLD,
                         "%s: the renders show nothing, so their mean PSNR of %.2f dB does not "
                         "count for --min-psnr; nothing was learnt, or nothing is in these photos: "
                         "see what `cl-nascent check` says of them",
                         options->operand, result.psnr));
done:
    cln_console_close(&console);
    cln_eval_free(&result);
    free(json);
    return st;
}
