/* Quality of held-out views. See quality.h. */
#include "render/quality.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/commit.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "render/exposure_guess.h"
#include "render/odd_views.h"
#include "render/tree_picture.h"
#include "io/image.h"
#include "render/metrics_image.h"
#include "io/run_folder.h"
#include "scene/dealt.h"

static const float SHOWN = 0.25f; /* the least opacity that shows something */
static const double MOST = 0.93;  /* of the pixels, without those that are farthest off */

enum { TREE_VIEWS = 2 }; /* views with pictures of the tree, evenly chosen */

void cln_eval_free(cln_eval_result *result)
{
    if (!result)
        return;
    for (int i = 0; result->images && i < result->count; i++) {
        free(result->images[i].name);
        free(result->images[i].file);
    }
    free(result->images);
    memset(result, 0, sizeof *result);
}

static int by_path(const void *a, const void *b)
{
    const cln_view *x = *(const cln_view *const *)a, *y = *(const cln_view *const *)b;
    const int order = strcmp(x->path, y->path);

    return order ? order : (x > y) - (x < y);
}

static int by_place(const void *a, const void *b)
{
    const int x = *(const int *)a, y = *(const int *)b;

    return (x > y) - (x < y);
}

/* The views of all splits, in their order: of a photo that is in several the first one. */
static cln_status list_photos(const cln_scene *scene, int **views, int *count)
{
    cln_status st = CLN_OK;
    const size_t total = (size_t)scene->view_count;
    const cln_view **order = NULL;

    CLN_TRY(cln_alloc(views, total, sizeof **views, "views"));
    CLN_TRY(cln_alloc(&order, total, sizeof *order, "views"));
    for (size_t i = 0; i < total; i++)
        order[i] = &scene->views[i];
    qsort(order, total, sizeof *order, by_path);
    *count = 0;
    for (size_t i = 0; i < total; i++)
        if (i == 0 || strcmp(order[i]->path, order[i - 1]->path) != 0)
            (*views)[(*count)++] = (int)(order[i] - scene->views);
    qsort(*views, (size_t)*count, sizeof **views, by_place);
done:
    free(order);
    return st;
}

cln_status cln_quality_choose(const cln_scene *scene, cln_split split, int most, int **views,
                              int *count)
{
    cln_status st = CLN_OK;
    int total = split == CLN_SPLITS ? 0 : cln_scene_split_count(scene, split), shown = 0;

    if (split == CLN_SPLITS) {
        CLN_TRY(list_photos(scene, views, &total));
    } else {
        CLN_TRY(cln_alloc(views, (size_t)total, sizeof **views, "views"));
        for (int i = 0; i < total; i++)
            (*views)[i] = cln_scene_split_view(scene, split, i);
    }
    for (int i = 0; i < total && most > 0; i++)
        shown += cln_scene_view_counts(scene, (*views)[i]);
    for (int i = 0, n = 0; i < total && shown > 0; i++)
        if (cln_scene_view_counts(scene, (*views)[i]))
            (*views)[n++] = (*views)[i];
    total = shown > 0 ? shown : total;
    *count = most > 0 && most < total ? most : total;
    for (int i = 0; i < *count; i++)
        (*views)[i] = (*views)[(int64_t)i * total / *count]; /* never before place i */
done:
    return st;
}

/* [height][width], 0 where a pixel is left out; NULL if none is. */
static cln_status list_kept(const cln_view *v, uint8_t **kept)
{
    cln_status st = CLN_OK;
    const int width = v->camera.width;
    const size_t pixels = (size_t)width * (size_t)v->camera.height;

    if (!v->kept)
        return CLN_OK;
    CLN_TRY(cln_alloc(kept, pixels, 1, "picture"));
    for (size_t i = 0; i < pixels; i++)
        (*kept)[i] = cln_view_keeps(v, (int)(i % (size_t)width), (int)(i / (size_t)width));
done:
    return st;
}

/* Warns once of views without a whole window. */
static cln_status warn_windows(const cln_scene *scene, const int *views, int count)
{
    cln_status st = CLN_OK;
    const cln_view *first = NULL;
    uint8_t *kept = NULL;
    char others[64] = "";
    int without = 0;

    for (int i = 0; i < count; i++) {
        const cln_view *v = &scene->views[views[i]];
        bool has = true;

        CLN_TRY(list_kept(v, &kept));
        if (kept)
            CLN_TRY(cln_ssim_has_window(v->camera.width, v->camera.height, kept, &has));
        free(kept);
        kept = NULL;
        without += !has;
        first = has || first ? first : v;
    }
    if (without > 1)
        snprintf(others, sizeof others, ", and %d other%s alike", without - 1,
                 cln_plural(without - 1, "", "s"));
    if (first)
        cln_warn("%s: '%s' has no SSIM: no block of %d x %d of its pixels counts%s; means of SSIM "
                 "leave it out",
                 scene->folder, first->name, CLN_SSIM_WINDOW, CLN_SSIM_WINDOW, others);
done:
    free(kept);
    return st;
}

cln_status cln_quality_check(const cln_scene *scene, const int *views, int count)
{
    for (int i = 0; i < count; i++) {
        const cln_view *v = &scene->views[views[i]];

        if (v->camera.width < CLN_SSIM_WINDOW || v->camera.height < CLN_SSIM_WINDOW)
            return cln_fail(CLN_INPUT,
                            "%s: '%s' has %d x %d pixels with --downscale %d; to be measured it "
                            "needs %d x %d; give larger photos or less --downscale",
                            scene->folder, v->name, v->camera.width, v->camera.height, v->downscale,
                            CLN_SSIM_WINDOW, CLN_SSIM_WINDOW);
    }
    return warn_windows(scene, views, count);
}

cln_status cln_quality_check_lpips(const cln_scene *scene, const int *views, int count,
                                   const cln_lpips *lpips)
{
    const int least = cln_lpips_least(lpips);

    for (int i = 0; i < count; i++) {
        const cln_view *v = &scene->views[views[i]];

        if (v->camera.width < least || v->camera.height < least)
            return cln_fail(CLN_INPUT,
                            "%s: '%s' has %d x %d pixels; for LPIPS it needs %d x %d; leave "
                            "--lpips out",
                            scene->folder, v->name, v->camera.width, v->camera.height, least,
                            least);
    }
    return CLN_OK;
}

static cln_status write_picture(const char *folder, const char *name, const char *suffix, int width,
                                int height, const float *rgb)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    uint8_t *bytes = NULL;
    const size_t n = (size_t)width * (size_t)height * 3;

    CLN_TRY(cln_asprintf(&path, "%s/%s%s", folder, name, suffix));
    CLN_TRY(cln_alloc(&bytes, n, 1, "picture"));
    for (size_t i = 0; i < n; i++)
        bytes[i] = cln_to_u8(rgb[i]);
    CLN_TRY(cln_image_write_png(path, width, height, 3, bytes));
done:
    free(path);
    free(bytes);
    return st;
}

/* Truth, render and their absolute difference times four; what does not count is grey in the truth
 * and no difference. */
static cln_status save(const char *folder, const char *name, int width, int height,
                       const float *rgb, const float *truth, const uint8_t *kept, float *scratch)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)width * (size_t)height * 3;

    CLN_TRY(write_picture(folder, name, ".png", width, height, rgb));
    for (size_t i = 0; i < n; i++)
        scratch[i] = kept && !kept[i / 3] ? CLN_LEFT_OUT_GREY : truth[i];
    CLN_TRY(write_picture(folder, name, ".truth.png", width, height, scratch));
    for (size_t i = 0; i < n; i++)
        scratch[i] = kept && !kept[i / 3] ? 0 : 4.0f * fabsf(rgb[i] - truth[i]);
    CLN_TRY(write_picture(folder, name, ".error.png", width, height, scratch));
done:
    return st;
}

/* Compares opacity with alpha, as colours over one background do not show it: an opaque surface of
 * the background's colour looks like air. */
static void measure_opacity(const cln_view *view, const uint8_t *kept, const cln_picture *picture,
                            cln_eval_image *image)
{
    const size_t pixels = (size_t)picture->width * (size_t)picture->height;
    size_t count = 0, air = 0, opaque = 0;
    double square = 0;

    image->opacity_error = image->opaque_air = NAN;
    if (view->channels != 4)
        return;
    for (size_t i = 0; i < pixels; i++) {
        uint8_t rgba[4], alpha = 0;
        double d = 0;

        if (kept && !kept[i])
            continue;
        cln_view_bytes(view, (int)(i % (size_t)picture->width), (int)(i / (size_t)picture->width),
                       rgba);
        alpha = rgba[3];
        d = picture->opacity[i] - alpha / 255.0;
        count++;
        square += d * d;
        air += alpha == 0;
        opaque += alpha == 0 && picture->opacity[i] > 0.5f;
    }
    image->opacity_error = sqrt(square / (double)count);
    if (air > 0)
        image->opaque_air = (double)opaque / (double)air;
}

/* Is there next to nothing in all of its pixels that count? */
static bool is_empty(const cln_picture *picture, const uint8_t *kept)
{
    const size_t pixels = (size_t)picture->width * (size_t)picture->height;

    for (size_t i = 0; i < pixels; i++)
        if ((!kept || kept[i]) && picture->opacity[i] > SHOWN)
            return false;
    return true;
}

/* Are all pixels that count of one colour? */
static bool is_plain(const float *rgb, const uint8_t *kept, size_t pixels)
{
    const float *first = NULL;

    for (size_t i = 0; i < pixels; i++) {
        if (kept && !kept[i])
            continue;
        if (first && memcmp(first, rgb + 3 * i, 3 * sizeof *rgb) != 0)
            return false;
        first = rgb + 3 * i;
    }
    return true;
}

/* The PSNR of the picture times a gain for each channel. lit: a picture for its own use. */
static double psnr_at(const float gain[3], const cln_picture *picture, const float *truth,
                      const uint8_t *kept, float *lit)
{
    const size_t values = 3 * (size_t)picture->width * (size_t)picture->height;

    for (size_t i = 0; i < values; i++)
        lit[i] = picture->rgb[i] * gain[i % 3];
    return cln_psnr(cln_image_mse(picture->width, picture->height, kept, lit, truth));
}

/* gain: the photo's, as far as it is known; NULL = not. */
static cln_status measure(const cln_scene *scene, int view, const cln_picture *picture,
                          const float *gain, const char *folder, cln_lpips *lpips,
                          cln_eval_image *image)
{
    cln_status st = CLN_OK;
    cln_view photo, *v = &photo;
    const int width = picture->width, height = picture->height;
    const size_t pixels = (size_t)width * (size_t)height;
    float *truth = NULL, *rounded = NULL, alpha = 0;
    double mse = 0;
    uint8_t *kept = NULL;

    CLN_TRY(cln_view_borrow(&scene->views[view], v));
    CLN_TRY(cln_alloc(&truth, pixels * 3, sizeof *truth, "picture"));
    CLN_TRY(cln_alloc(&rounded, pixels * 3, sizeof *rounded, "picture"));
    for (size_t i = 0; i < pixels; i++)
        cln_view_pixel(v, (int)(i % (size_t)width), (int)(i / (size_t)width), scene->background,
                       truth + 3 * i, &alpha);
    CLN_TRY(list_kept(v, &kept));
    image->psnr_exposed = gain ? psnr_at(gain, picture, truth, kept, rounded) : NAN;
    for (size_t i = 0; i < pixels * 3; i++)
        rounded[i] = (float)cln_to_u8(picture->rgb[i]) / 255.0f;
    image->turn = cln_view_turn(v);
    image->file_width = v->file_width;
    image->file_height = v->file_height;
    image->downscale = v->downscale;
    image->width = width;
    image->height = height;
    image->mse = cln_image_mse(width, height, kept, picture->rgb, truth);
    image->psnr = cln_psnr(image->mse);
    image->psnr_u8 = cln_psnr(cln_image_mse(width, height, kept, rounded, truth));
    image->psnr_fitted =
        is_plain(truth, kept, pixels)
            ? NAN /* any render fits that */
            : cln_psnr(cln_image_fitted_mse(width, height, kept, picture->rgb, truth));
    image->psnr_most = NAN;
    if (!scene->has_alpha) {
        CLN_TRY(cln_image_most_mse(width, height, kept, picture->rgb, truth, MOST, &mse));
        image->psnr_most = cln_psnr(mse);
    }
    CLN_TRY(cln_image_ssim(width, height, kept, picture->rgb, truth, &image->ssim));
    image->lpips = NAN;
    if (lpips)
        CLN_TRY(cln_lpips_measure(lpips, width, height, kept, picture->rgb, truth, &image->lpips));
    measure_opacity(v, kept, picture, image);
    image->empty = !image->apart && is_empty(picture, kept);
    CLN_TRY(cln_odd_depth(picture, &image->depth));
    if (isfinite(image->depth))
        image->depth = cln_space_depth_to_scene(&scene->space, (float)image->depth);
    CLN_TRY(cln_scene_check_pixels(scene));
    if (folder)
        CLN_TRY(save(folder, v->file, width, height, picture->rgb, truth, kept, rounded));
done:
    cln_view_give_back(&scene->views[view], v);
    free(kept);
    free(truth);
    free(rounded);
    return st;
}

/* If view i of `count` is one of the TREE_VIEWS, draws its pictures of the tree and adds its name
 * to `drawn`. */
static cln_status draw_tree(const cln_model *model, const cln_view *view, int i, int count,
                            const cln_picture *picture, const char *folder, json_t *drawn)
{
    cln_status st = CLN_OK;
    bool wanted = false;

    for (int k = 0; k < TREE_VIEWS; k++)
        wanted |= i == (int)((int64_t)k * count / TREE_VIEWS);
    if (!wanted)
        return CLN_OK;
    CLN_TRY(cln_tree_save(model, view, picture, folder));
    json_array_append_new(drawn, json_string(view->name));
done:
    return st;
}

/* Is image i in the means? */
static bool counts(const cln_eval_result *result, int i)
{
    return !result->images[i].apart || result->apart == result->count;
}

/* Mean of a member over the images where it is a number; NAN if there is none. */
static double mean_of(const cln_eval_result *result, size_t member)
{
    double sum = 0;
    int count = 0;

    for (int i = 0; i < result->count; i++) {
        double value = 0;

        memcpy(&value, (const char *)&result->images[i] + member, sizeof value);
        if (counts(result, i) && isfinite(value)) {
            sum += value;
            count++;
        }
    }
    return count > 0 ? sum / count : NAN;
}

cln_status cln_quality_measure(cln_pipeline *p, const cln_model *model, const cln_scene *scene,
                               const int *views, int count, const char *folder, cln_lpips *lpips,
                               const cln_callbacks *callbacks, cln_eval_result *result)
{
    cln_status st = CLN_OK;
    const bool tree = model && folder;
    json_t *drawn = json_array();
    float(*gains)[3] = NULL;
    int counted = 0;

    if (model)
        CLN_TRY(cln_exposure_guess(model, scene, &gains));
    CLN_TRY(cln_alloc(&result->images, (size_t)count, sizeof *result->images, "evaluation"));
    result->count = count;
    for (int i = 0; i < count; i++) {
        result->images[i].apart = !cln_scene_view_counts(scene, views[i]);
        result->apart += result->images[i].apart;
    }
    counted = result->apart < count ? count - result->apart : count;
    memcpy(result->background, scene->background, sizeof result->background);
    result->scene_digest = scene->digest;
    if (count > 0)
        snprintf(result->split, sizeof result->split, "%s",
                 cln_split_names[scene->views[views[0]].split]);
    if (folder)
        CLN_TRY(cln_make_dirs(folder));
    cln_show_work(callbacks, "eval", 0, count);
    CLN_TRY(cln_render_prepare(p));
    for (int i = 0; i < count; i++) {
        cln_eval_image *image = &result->images[i];
        cln_picture picture;
        const double start = cln_now();

        CLN_TRY(cln_strdup(&image->name, scene->views[views[i]].name));
        CLN_TRY(cln_strdup(&image->file, scene->views[views[i]].file));
        CLN_TRY(
            cln_render_view(p, views[i], scene->background, CLN_DEPTH_MEDIAN, callbacks, &picture));
        image->seconds = cln_now() - start;
        st = measure(scene, views[i], &picture, gains ? gains[views[i]] : NULL, folder, lpips,
                     image);
        if (st == CLN_OK && tree)
            st = draw_tree(model, &scene->views[views[i]], i, count, &picture, folder, drawn);
        cln_picture_free(&picture);
        CLN_TRY(st);
        cln_show_work(callbacks, "eval", i + 1, count);
        if (!counts(result, i))
            continue;
        result->psnr += image->psnr / counted;
        result->psnr_u8 += image->psnr_u8 / counted;
        result->mse += image->mse / counted;
        result->seconds += image->seconds / counted;
    }
    CLN_TRY(cln_odd_views(result));
    result->psnr_of_mean_mse = cln_psnr(result->mse);
    result->psnr_fitted = mean_of(result, offsetof(cln_eval_image, psnr_fitted));
    result->psnr_exposed = mean_of(result, offsetof(cln_eval_image, psnr_exposed));
    result->ssim = mean_of(result, offsetof(cln_eval_image, ssim));
    result->lpips = mean_of(result, offsetof(cln_eval_image, lpips));
    if (lpips)
        cln_format(result->lpips_network, sizeof result->lpips_network, "%s",
                   cln_lpips_network(lpips));
    result->opacity_error = mean_of(result, offsetof(cln_eval_image, opacity_error));
    result->opaque_air = mean_of(result, offsetof(cln_eval_image, opaque_air));
    if (tree)
        CLN_TRY(cln_tree_describe(model, drawn, folder));
done:
    cln_render_release(p);
    json_decref(drawn);
    free(gains);
    return st;
}

/* Each view has render, truth and error; a few also have the tree by level and by error. */
double cln_quality_bytes(const cln_scene *scene, const int *views, int count)
{
    double bytes = 0, largest = 0;

    for (int i = 0; i < count; i++) {
        const cln_camera *c = &scene->views[views[i]].camera;
        const double picture = 3.0 * c->width * c->height;

        bytes += 3 * picture;
        largest = fmax(largest, picture);
    }
    return bytes + 2 * TREE_VIEWS * largest;
}

/* Images without an SSIM are left out of its deviation. */
static double deviation(const cln_eval_result *r, bool ssim)
{
    double sum = 0;
    int count = 0;

    for (int i = 0; i < r->count; i++) {
        const double d = ssim ? r->images[i].ssim - r->ssim : r->images[i].psnr - r->psnr;

        if (!counts(r, i) || (ssim && !isfinite(r->images[i].ssim)))
            continue;
        sum += d * d;
        count++;
    }
    if (count == 0)
        return r->count > 0 ? NAN : 0;
    return sqrt(sum / count);
}

static json_t *jump_json(const cln_eval_jump *jump)
{
    return json_pack("{s:i, s:o, s:o, s:o, s:o}", "pairs", jump->pairs, "colour",
                     cln_json_real(jump->colour), "colour_95", cln_json_real(jump->colour_95),
                     "alpha", cln_json_real(jump->alpha), "alpha_95",
                     cln_json_real(jump->alpha_95));
}

cln_status cln_quality_json(const cln_eval_result *r, json_t **out)
{
    char digest[CLN_DIGEST_TEXT];
    json_t *images = json_array();

    cln_digest_text(r->digest, digest);
    for (int i = 0; i < r->count; i++) {
        const cln_eval_image *e = &r->images[i];
        json_t *one = json_pack(
            "{s:s, s:s, s:i, s:i, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:f}", "name", e->name,
            "file", e->file, "width", e->width, "height", e->height, "psnr", cln_json_real(e->psnr),
            "psnr_u8", cln_json_real(e->psnr_u8), "psnr_fitted", cln_json_real(e->psnr_fitted),
            "psnr_exposed", cln_json_real(e->psnr_exposed), "ssim", cln_json_real(e->ssim), "mse",
            cln_json_real(e->mse), "opacity_error", cln_json_real(e->opacity_error), "opaque_air",
            cln_json_real(e->opaque_air), "seconds", e->seconds);

        json_object_set_new(one, "downscale", json_integer(e->downscale));
        json_object_set_new(one, "depth", cln_json_real(e->depth));
        if (one && e->hidden)
            json_object_set_new(one, "hidden", json_true());
        if (one && isfinite(e->lpips))
            json_object_set_new(one, "lpips", json_real(e->lpips));
        if (one && isfinite(e->psnr_most))
            json_object_set_new(one, "psnr_most", json_real(e->psnr_most));
        if (one && e->partly)
            json_object_set_new(one, "partly", json_true());
        if (one && e->apart)
            json_object_set_new(one, "apart", json_true());
        if (one && e->empty)
            json_object_set_new(one, "empty", json_true());
        if (one && e->off)
            json_object_set_new(one, "off", json_true());
        if (one && e->turn > 1)
            json_object_set_new(one, "turn", json_integer(e->turn));
        json_array_append_new(images, one);
    }
    *out = json_pack(
        "{s:s, s:s, s:s, s:s, s:I, s:f, s:s, s:s, s:[f,f,f], s:f, s:{s:o, s:o, s:o, s:o, s:o, s:o, "
        "s:o, "
        "s:o, s:f}, "
        "s:{s:o, s:o}, s:o, s:o}",
        "schema", "cl-nascent.eval/1", "tool", "cl-nascent " CLN_VERSION, "commit", cln_commit(),
        "model_digest", digest, "step", (json_int_t)r->step, "train_seconds", r->train_seconds,
        "split", r->split, "color_space", "srgb", "background", cln_json_digits(r->background[0]),
        cln_json_digits(r->background[1]), cln_json_digits(r->background[2]), "pixel_centre", 0.5,
        "mean", "psnr", cln_json_real(r->psnr), "psnr_u8", cln_json_real(r->psnr_u8), "psnr_fitted",
        cln_json_real(r->psnr_fitted), "psnr_exposed", cln_json_real(r->psnr_exposed), "ssim",
        cln_json_real(r->ssim), "mse", cln_json_real(r->mse), "opacity_error",
        cln_json_real(r->opacity_error), "opaque_air", cln_json_real(r->opaque_air), "seconds",
        r->seconds, "std", "psnr", cln_json_real(deviation(r, false)), "ssim",
        cln_json_real(deviation(r, true)), "psnr_of_mean_mse", cln_json_real(r->psnr_of_mean_mse),
        "images", images);
    cln_digest_text(r->scene_digest, digest);
    if (*out && r->scene_digest)
        json_object_set_new(*out, "scene_digest", json_string(digest));
    if (*out && r->apart > 0)
        json_object_set_new(*out, "apart", json_integer(r->apart));
    if (*out && *r->lpips_network) {
        json_object_set_new(json_object_get(*out, "mean"), "lpips", cln_json_real(r->lpips));
        json_object_set_new(*out, "lpips",
                            json_pack("{s:s, s:s}", "network", r->lpips_network, "version", "0.1"));
    }
    if (*out && r->antialias > 1)
        json_object_set_new(*out, "antialias", json_integer(r->antialias));
    if (*out && r->fast)
        json_object_set_new(*out, "fast", json_true());
    if (*out && r->seams.measured)
        json_object_set_new(*out, "seams",
                            json_pack("{s:o, s:o}", "across", jump_json(&r->seams.across), "inside",
                                      jump_json(&r->seams.inside)));
    return *out ? CLN_OK : cln_fail(CLN_MEMORY, "evaluation: cannot make JSON");
}
