/* Loading a scene: pick the reader, then the same steps for every format (build.h), cheapest first
 * so that bad input is reported before gigabytes are decoded. Also frees cln_scene and reads its
 * pixels. Knows no file format; those are in reader_*.c. */
#include "scene/scene.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/unicode.h"
#include "io/image.h"
#include "io/names.h"
#include "ranks/ranks.h"
#include "scene/build.h"
#include "scene/dealt.h"
#include "scene/dataset.h"
#include "scene/moved.h"

cln_status cln_scene_folder(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *slash = NULL;

    CLN_TRY(cln_strdup(out, path));
    if (cln_is_dir(path))
        goto done;
    slash = strrchr(*out, '/');
    if (slash)
        slash[slash == *out] = 0; /* "/x.json" is in "/" */
    else
        strcpy(*out, ".");
done:
    return st;
}

cln_status cln_scene_path_from(const cln_scene *scene, const char *path, char **out)
{
    cln_status st = CLN_OK;
    size_t folder = strlen(scene->folder);
    char *from = NULL, *to = NULL;

    while (folder > 0 && scene->folder[folder - 1] == '/')
        folder--;
    if (strncmp(path, scene->folder, folder) == 0 && path[folder] == '/')
        return cln_strdup(out, path + folder + strspn(path + folder, "/"));
    CLN_TRY(cln_path_absolute(&from, scene->folder));
    CLN_TRY(cln_path_absolute(&to, path));
    CLN_TRY(cln_path_relative(out, from, to));
done:
    free(from);
    free(to);
    return st;
}

static void free_views(cln_view *views, int count)
{
    for (int i = 0; i < count; i++) {
        free(views[i].name);
        free(views[i].path);
        free(views[i].alpha_path);
        free(views[i].depth.depth);
        free(views[i].depth.confidence);
        free(views[i].file);
        free(views[i].mask_path);
        free(views[i].masked);
    }
    free(views);
}

/* A view's camera as the dataset gives it, before --downscale, with its name and split. */
static uint64_t add_camera(uint64_t digest, const cln_view *view)
{
    const cln_camera *c = &view->camera;
    const cln_lens_model *lens = &cln_lens_models[c->lens];
    double lengths[4 + CLN_LENS_PARAMS] = {c->fx, c->fy, c->cx, c->cy};
    const int32_t numbers[3] = {(int32_t)view->split, c->width, c->height};

    digest = cln_digest(digest, view->name, strlen(view->name));
    digest = cln_digest(digest, numbers, sizeof numbers);
    digest = cln_digest(digest, c->c2w, sizeof c->c2w);
    memcpy(lengths + 4, c->distortion, sizeof c->distortion);
    digest = cln_digest(digest, lengths, (4 + (size_t)lens->count) * sizeof *lengths);
    if (c->lens != CLN_LENS_OPENCV) /* its digests are older than the names of models */
        digest = cln_digest(digest, lens->name, strlen(lens->name));
    return digest;
}

/* The bytes of the images follow when they are read. */
static void digest_cameras(cln_scene *scene)
{
    scene->digest = scene->test_digest = CLN_DIGEST_START;
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        scene->digest = add_camera(scene->digest, view);
        if (view->split == CLN_SPLIT_TEST)
            scene->test_digest = add_camera(scene->test_digest, view);
    }
}

/* `count` frames from `from` on. */
static cln_listed list_frames(const cln_scene *scene, int from, int count)
{
    cln_listed listed = {0};

    for (int i = from; i < from + count; i++)
        cln_listed_add(&listed, 3, "'%s'", scene->views[i].name);
    return listed;
}

/* Why frames are left out, a phrase with the first of their names. */
static cln_status say_left_out(const cln_scene *scene, char **out)
{
    cln_status st = CLN_OK;
    const int total = scene->view_count + scene->missing;
    const int absent = scene->missing - scene->unreadable;
    const cln_listed gone = list_frames(scene, scene->view_count, absent);
    const cln_listed broken = list_frames(scene, scene->view_count + absent, scene->unreadable);

    CLN_TRY(cln_strdup(out, ""));
    if (absent > 0)
        CLN_TRY(cln_append(out, "%d of %d images %s not there (%s)", absent, total,
                           cln_plural(absent, "is", "are"), gone.text));
    if (scene->unreadable > 0)
        CLN_TRY(cln_append(out, "%s%d of %d %scannot be read (%s)", absent ? ", " : "",
                           scene->unreadable, total, absent ? "" : "images ", broken.text));
done:
    return st;
}

/* Where the folder of the first frame without an image has images of other names, for half of such
 * frames and more, *likely becomes what that tells. */
static cln_status tell_renamed(const cln_scene *scene, char **likely)
{
    cln_status st = CLN_OK;
    cln_names names = {0};
    char *folder = NULL, *slash = NULL;
    int others = 0;

    CLN_TRY(cln_strdup(&folder, scene->views[scene->view_count].path));
    slash = strrchr(folder, '/');
    if (!slash)
        goto done;
    *slash = 0;
    if (!cln_is_dir(folder))
        goto done;
    CLN_TRY(cln_dataset_images(folder, &names));
    others = names.count - scene->view_count - scene->unreadable;
    if (others <= 0 || 2 * others < scene->missing)
        goto done;
    free(*likely);
    *likely = NULL;
    CLN_TRY(
        cln_asprintf(likely,
                     "; restore %s, or, if photos were renamed (%s has %d of other names), give "
                     "them these names back",
                     cln_plural(scene->missing, "it", "them"), folder, others));
done:
    cln_dataset_free_names(&names);
    free(folder);
    return st;
}

typedef enum { FINE, ABSENT, UNREADABLE } state;

/* With --missing fail, a file that cannot be read is an error that cln_scene_size_views reports; so
 * it is with auto among several ranks, of which each opens its own photos alone. *reason: that of
 * the first one. */
static cln_status look_for(const cln_view *view, int rule, state *out, char **reason)
{
    cln_status st = CLN_OK;

    *out = cln_is_file(view->path) ? FINE : ABSENT;
    if (*out == ABSENT || rule == CLN_MISSING_FAIL ||
        (rule == CLN_MISSING_AUTO && cln_ranks_count() > 1))
        return CLN_OK;
    st = rule == CLN_MISSING_SKIP ? cln_image_check(view->path) : cln_image_check_ends(view->path);
    if (st != CLN_INPUT)
        return st;
    *out = UNREADABLE;
    cln_debug("frame '%s' is left out: %s", view->name, cln_error_text());
    st = *reason ? CLN_OK : cln_strdup(reason, cln_error_text());
    if (st == CLN_OK)
        cln_clear_error();
    return st;
}

/* Puts the views that are left out behind those that stay, first those without an image. Stable.
 * *reason: why the first of the others cannot be read; NULL if all can. */
static cln_status move_missing(cln_scene *scene, int rule, char **reason)
{
    cln_status st = CLN_OK;
    const int total = scene->view_count;
    cln_view *views = NULL;
    state *states = NULL;
    int count[3] = {0}, filled = 0;

    CLN_TRY(cln_alloc(&views, (size_t)total, sizeof *views, "views"));
    CLN_TRY(cln_alloc(&states, (size_t)total, sizeof *states, "views"));
    for (int i = 0; i < total; i++) {
        CLN_TRY(look_for(&scene->views[i], rule, &states[i], reason));
        count[states[i]]++;
    }
    for (state s = FINE; s <= UNREADABLE; s++)
        for (int i = 0; i < total; i++)
            if (states[i] == s)
                views[filled++] = scene->views[i];
    memcpy(scene->views, views, (size_t)total * sizeof *views);
    scene->view_count = count[FINE];
    scene->missing = count[ABSENT] + count[UNREADABLE];
    scene->unreadable = count[UNREADABLE];
done:
    free(views);
    free(states);
    return st;
}

cln_status cln_scene_leave_out(cln_scene *scene, int rule)
{
    cln_status st = CLN_OK;
    const int total = scene->view_count;
    cln_moved moved = {.folder = scene->folder};
    char *why = NULL, *likely = NULL, *reason = NULL, *first = NULL;

    CLN_TRY(move_missing(scene, rule, &reason));
    if (scene->missing == 0)
        goto done;
    CLN_TRY(say_left_out(scene, &why));
    if (scene->missing > scene->unreadable)
        CLN_TRY(cln_asprintf(&first, " (the first should be %s%s%s)",
                             scene->views[scene->view_count].path, reason ? "; " : "",
                             reason ? reason : ""));
    else
        CLN_TRY(cln_asprintf(&first, " (%s)", reason));
    errno = 0;
    if (scene->missing > scene->unreadable && !cln_is_file(scene->views[scene->view_count].path) &&
        errno == EACCES)
        CLN_TRY(cln_strdup(&likely, "; its folder may not be read by this user"));
    else if (scene->missing > scene->unreadable)
        CLN_TRY(cln_moved_hint(&moved, scene->views[scene->view_count].name, &likely));
    else
        CLN_TRY(cln_strdup(&likely, ""));
    if (!*likely && scene->missing > scene->unreadable)
        CLN_TRY(tell_renamed(scene, &likely));
    if (rule == CLN_MISSING_FAIL)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: frame '%s': there is no image file %s%s; restore it, or leave such "
                         "frames out with --missing skip",
                         scene->folder, scene->views[scene->view_count].name,
                         scene->views[scene->view_count].path, likely));
    if (rule == CLN_MISSING_AUTO && 10 * scene->missing >= total)
        CLN_TRY(cln_fail(
            CLN_INPUT, "%s: %s, a tenth or more%s%s%s%s", scene->folder, why, first, likely,
            *likely || reason     ? ""
            : scene->missing == 1 ? "; restore it"
                                  : "; restore them",
            scene->missing < total ? ", or leave such frames out with --missing skip" : ""));
    if (cln_scene_split_count(scene, CLN_SPLIT_TRAIN) == 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: no training view is left: %s%s%s%s", scene->folder, why,
                         reason ? first : "", likely, *likely || reason ? "" : "; restore them"));
    cln_warn("%s: %s; %s left out%s", scene->folder, why,
             cln_plural(scene->missing, "this frame is", "these frames are"), reason ? first : "");
done:
    cln_moved_free(&moved);
    free(reason);
    free(first);
    free(why);
    free(likely);
    return st;
}

static bool has_alpha(const cln_view *view)
{
    return view->alpha_path || view->channels == 4;
}

cln_status cln_scene_leave_uncut_out(cln_scene *scene)
{
    cln_status st = CLN_OK;
    const int total = scene->view_count;
    cln_view *views = NULL;
    cln_listed names;
    int cut = 0, filled = 0, left = 0;

    for (int i = 0; i < total; i++)
        cut += has_alpha(&scene->views[i]);
    if (cut == total || 2 * cut < total)
        return CLN_OK;
    left = total - cut;
    CLN_TRY(cln_alloc(&views, (size_t)total, sizeof *views, "views"));
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < total; i++)
            if (has_alpha(&scene->views[i]) == (pass == 0))
                views[filled++] = scene->views[i];
    memcpy(scene->views, views, (size_t)total * sizeof *views);
    scene->view_count = cut;
    scene->missing += left;
    names = list_frames(scene, cut, left);
    if (cln_scene_split_count(scene, CLN_SPLIT_TRAIN) == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no training view is left: %d of %d images have no %s (%s); make it, "
                         "or go without --missing skip",
                         scene->folder, left, total, scene->masks_alpha ? "mask" : "alpha",
                         names.text));
    cln_warn("%s: %d of %d images %s no %s, unlike the others (%s); %s left out (--missing skip)",
             scene->folder, left, total, cln_plural(left, "has", "have"),
             scene->masks_alpha ? "mask" : "alpha", names.text,
             cln_plural(left, "this frame is", "these frames are"));
done:
    free(views);
    return st;
}

cln_status cln_scene_name_files(cln_scene *scene)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)scene->view_count;
    const char **names = NULL;
    char **files = NULL;
    size_t within = 0;
    bool absolute = count > 0;

    CLN_TRY(cln_alloc(&names, count, sizeof *names, "views"));
    CLN_TRY(cln_alloc(&files, count, sizeof *files, "views"));
    for (size_t i = 0; i < count; i++) {
        names[i] = scene->views[i].name;
        absolute = absolute && cln_name_is_absolute(names[i]);
    }
    if (absolute) /* where they once were tells nobody a photo from another */
        within = cln_names_folder((int)count, names);
    for (size_t i = 0; i < count; i++)
        names[i] += within;
    st = cln_view_file_names(scene->view_count, names, files);
    for (size_t i = 0; i < count; i++)
        scene->views[i].file = files[i];
done:
    free(names);
    free(files);
    return st;
}

/* Do the names of two files differ in their Unicode form alone, which nobody sees? */
static bool is_other_form(const char *a, const char *b)
{
    char *x = cln_unicode_form(a, true), *y = cln_unicode_form(b, true);
    const bool other = strcmp(a, b) != 0 && strcmp(x ? x : a, y ? y : b) == 0;

    free(x);
    free(y);
    return other;
}

static bool learns_depths(const cln_scene_desc *desc)
{
    return (desc->config->depth_loss > 0 || desc->config->points_near > 0) &&
           desc->pixels[CLN_SPLIT_TRAIN];
}

static cln_status build(const cln_scene_desc *desc, cln_scene *scene, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const cln_reader *reader = NULL;
    cln_scene_desc lent = *desc;
    char *others = NULL;

    CLN_TRY(cln_reader_pick(desc->path, desc->config->format, &reader, &others));
    if (reader == &cln_reader_transforms && others &&
        (strstr(others, "polycam") || strstr(others, "record3d")))
        cln_warn("%s: read by a transforms file, as a converter leaves, which knows less than what "
                 "the phone wrote: --format %s reads that",
                 desc->path, strstr(others, "polycam") ? "polycam" : "record3d");
    CLN_TRY(cln_strdup(&scene->path, desc->path));
    CLN_TRY(cln_scene_folder(desc->path, &scene->folder));
    st = reader->read(desc->path, result);
    if (st != CLN_OK && others)
        cln_note("reading it with %s; it can be read with --format %s, too", reader->name, others);
    CLN_TRY(st);
    if (result->view_count < 1)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: zero frames in this scene; add some, or give another scene",
                         desc->path));
    if (result->view_count > CLN_MAX_VIEWS)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %d frames, more than the %d that are read; leave some out",
                         desc->path, result->view_count, CLN_MAX_VIEWS));
    scene->views = result->views;
    scene->view_count = result->view_count;
    for (int i = 0; i < scene->view_count; i++)
        scene->views[i].number = i;
    result->views = NULL;
    result->view_count = 0;
    if (result->moved_count)
        cln_info("%s: %d of its images %s not where it says and %s taken by %s, as %s for %s%s",
                 scene->folder, result->moved_count, cln_plural(result->moved_count, "is", "are"),
                 cln_plural(result->moved_count, "is", "are"),
                 cln_plural(result->moved_count, "its name", "their names"),
                 cln_dataset_within(scene->folder, result->moved_to),
                 cln_dataset_within(scene->folder, result->moved_from),
                 is_other_form(result->moved_from, result->moved_to)
                     ? ", which look alike (another Unicode form)"
                     : "");
    scene->dialect = result->dialect;
    memcpy(scene->up, result->up, sizeof scene->up);
    scene->up_by_gps = result->up_by_gps;
    scene->on_earth = result->on_earth;
    memcpy(scene->origin, result->origin, sizeof scene->origin);
    scene->gps_distance = result->gps_distance;
    scene->stored_poses = result->stored_poses;
    scene->unposed = result->unposed;
    scene->has_sights = result->observation_count > 0;
    scene->ignored = json_incref(result->ignored);
    CLN_TRY(cln_asprintf(&scene->because, "%s%s%s", result->because,
                         others ? "; also there, not read: --format " : "", others ? others : ""));
    cln_utf8_repair(scene->because); /* it names folders; JSON needs UTF-8 */
    CLN_TRY(cln_scene_split_views(scene, result->named_splits, desc));
    for (int s = 0; s < CLN_SPLITS && scene->lent; s++)
        lent.pixels[CLN_SPLIT_TRAIN] |= desc->pixels[s];
    desc = scene->lent ? &lent : desc;
    CLN_TRY(cln_scene_leave_out(scene, desc->config->missing));
    CLN_TRY(cln_scene_name_files(scene));
    digest_cameras(scene);
    CLN_TRY(cln_scene_size_views(scene, desc));
    CLN_TRY(cln_scene_find_kept(scene));
    if (learns_depths(desc) || result->depth_points)
        CLN_TRY(cln_scene_check_depths(scene, result, desc->callbacks));
    CLN_TRY(cln_scene_drop_points(scene, result));
    CLN_TRY(cln_scene_find_bounds(scene, result, desc->config));
    if (!desc->unseen)
        CLN_TRY(cln_scene_check_seen(scene));
    cln_scene_find_doubts(scene, result);
    if (learns_depths(desc)) {
        CLN_TRY(cln_scene_find_sights(scene, result));
        CLN_TRY(cln_scene_depth_sights(scene));
    }
    CLN_TRY(cln_scene_deal(scene));
    CLN_TRY(cln_scene_place_images(scene, desc));
    CLN_TRY(cln_scene_read_images(scene, desc));
    CLN_TRY(cln_scene_clear_sights(scene));
    CLN_TRY(cln_scene_check_opaque(scene, desc));
    CLN_TRY(cln_scene_find_background(scene, desc->config));
done:
    free(others);
    return st;
}

static cln_status load(const cln_scene_desc *desc, cln_scene **out)
{
    cln_status st = CLN_OK;
    cln_scene *scene = NULL;
    cln_reader_result result = {0};

    *out = NULL;
    CLN_TRY(cln_alloc(&scene, 1, sizeof *scene, "scene"));
    CLN_TRY(build(desc, scene, &result));
    *out = scene;
    scene = NULL;
done:
    free_views(result.views, result.view_count);
    free(result.points);
    free(result.dropped);
    free(result.observations);
    free(result.bounds_rule);
    free(result.because);
    free(result.moved_from);
    free(result.moved_to);
    json_decref(result.ignored);
    cln_scene_free(scene);
    return st;
}

cln_status cln_scene_load(const cln_scene_desc *desc, cln_scene **out)
{
    cln_status st = load(desc, out);
    cln_scene_desc looked = *desc;

    if (st != CLN_OK || !(*out)->hides)
        return st;
    cln_scene_free(*out);
    looked.opaque_digest = 0;
    return load(&looked, out);
}

void cln_scene_free(cln_scene *scene)
{
    if (!scene)
        return;
    for (int i = 0; scene->maps && i < scene->view_count; i++)
        free(scene->maps[i]);
    free(scene->maps);
    free_views(scene->views, scene->view_count + scene->missing);
    free(scene->pixels);
    cln_store_free(scene->store);
    free(scene->path);
    free(scene->folder);
    free(scene->because);
    json_decref(scene->ignored);
    free(scene->split_rule);
    free(scene->bounds_rule);
    free(scene->masks_rule);
    free(scene->sights);
    free(scene);
}

bool cln_view_is_loaded(const cln_view *view)
{
    return view->pixels || view->store;
}

static const uint8_t *pixel_of(const cln_view *view, int x, int y)
{
    return view->pixels +
           ((size_t)y * (size_t)view->camera.width + (size_t)x) * (size_t)view->channels;
}

void cln_view_fetch(const cln_view *view, int x, int y)
{
    if (view->store)
        cln_store_fetch(view->store, view->place, view->camera.width, view->channels, x, y);
    else
        __builtin_prefetch(pixel_of(view, x, y));
}

void cln_view_bytes(const cln_view *view, int x, int y, uint8_t out[4])
{
    if (view->store)
        cln_store_pixel(view->store, view->place, view->camera.width, view->channels, x, y, out);
    else
        memcpy(out, pixel_of(view, x, y), (size_t)view->channels);
}

uint64_t cln_view_digest(const cln_view *view, uint64_t digest)
{
    for (int y = 0; y < view->camera.height; y++)
        for (int x = 0; x < view->camera.width; x++) {
            uint8_t p[4];

            cln_view_bytes(view, x, y, p);
            digest = cln_digest(digest, p, (size_t)view->channels);
        }
    return digest;
}

double cln_scene_pixel_bytes(const cln_scene *scene)
{
    double bytes = scene->store ? cln_store_cached(scene->store) : 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (v->pixels)
            bytes += (double)v->camera.width * v->camera.height * v->channels;
    }
    return bytes;
}

cln_status cln_scene_check_pixels(const cln_scene *scene)
{
    return scene->store ? cln_store_check(scene->store) : CLN_OK;
}

void cln_pixel_over(const uint8_t *pixel, int channels, const float background[3], float rgb[3],
                    float *alpha)
{
    *alpha = channels == 4 ? (float)pixel[3] / 255 : 1;
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)pixel[c] / 255 * *alpha + background[c] * (1 - *alpha);
}

void cln_view_pixel(const cln_view *view, int x, int y, const float background[3], float rgb[3],
                    float *alpha)
{
    uint8_t p[4];

    cln_view_bytes(view, x, y, p);
    cln_pixel_over(p, view->channels, background, rgb, alpha);
}
