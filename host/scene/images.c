/* The image files of a scene: sizes from their headers, then all bytes for the digest and the
 * pixels of the wanted splits. Two threads share the reading; each view is worked on by one of them
 * and the results are put together in view order, so nothing depends on who was faster. */
#include "scene/build.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "io/progress.h"
#include "ranks/ranks.h"
#include "scene/dealt.h"

/* MASK_CHANNELS: as decoded, at least */
enum { THREADS = 2, AUTO_LONGEST_SIDE = 1600, MASK_CHANNELS = 3, NAME = 100 };
static const size_t FILE_MAX_BYTES = (size_t)1 << 30;
static const double NEARLY = 0.05; /* nobody makes copies that are so little smaller */

/* Is it in images_N, where datasets keep copies of 1/N of the size? */
static bool in_folder_of_copies(const char *path, double factor)
{
    char folder[32];

    snprintf(folder, sizeof folder, "/images_%.0f/", factor);
    return strstr(path, folder) != NULL;
}

/* Images of another size than their cameras are given for. Of a smaller copy of a dataset all are;
 * of some among others one may have been cropped. */
static void warn_resized(const cln_scene *scene, const cln_listed *r)
{
    if (r->count == scene->view_count)
        cln_warn("%s: images have other sizes than their cameras are given for (%s): cameras are "
                 "scaled to the images%s",
                 scene->folder, r->text, scene->nearly_sized ? "; " CLN_NEARLY_ADVICE : "");
    else if (r->count > 0)
        cln_warn("%s: %d of %d images %s another size than %s camera%s given for (%s): cameras are "
                 "scaled to the images, which is wrong of one that was cropped: replace it by the "
                 "whole one, or correct its camera's size, cx and cy",
                 scene->folder, r->count, scene->view_count, cln_plural(r->count, "has", "have"),
                 cln_plural(r->count, "its", "their"), cln_plural(r->count, " is", "s are"),
                 r->text);
}

/* Brings a camera that is given for another image size to the size of the file: smaller copies of a
 * dataset keep the cameras of the originals. Another shape is an error. */
static cln_status fit_camera(cln_scene *scene, cln_view *view, const char *more, cln_listed *others)
{
    const int width = view->file_width, height = view->file_height;
    const bool colmap = strcmp(scene->dialect, "COLMAP") == 0;
    cln_camera *camera = &view->camera;

    if (camera->width == 0 && camera->height == 0) {
        camera->width = width;
        camera->height = height;
    }
    if (camera->width == width && camera->height == height)
        return CLN_OK;
    if (!cln_camera_has_shape(camera, width, height))
        return cln_fail(
            CLN_INPUT, "%s: the image has %d x %d pixels, its camera is given for %d x %d%s; %s",
            view->path, width, height, camera->width, camera->height, more,
            cln_camera_has_shape(camera, height, width)
                ? "its sides are swapped, and no EXIF data tell how it is to be turned: "
                  "turn its pixels back to what the poses were found by, or correct the size that "
                  "the scene's files have"
            : camera->lens == CLN_LENS_EQUIRECTANGULAR
                ? "correct w and h, with fl_x = fl_y = w / (2 pi), cx and cy if the panorama was "
                  "cut above or below, or replace the image"
            : colmap ? "replace the image, or correct its camera in cameras.txt: the size, after a "
                       "crop also cx and cy (of .bin files, COLMAP's model_converter writes .txt)"
                     : "correct w and h, after a crop also cx and cy, or replace the image");
    if (!in_folder_of_copies(view->path, (double)camera->width / width))
        cln_listed_add(others, 3, "%.*s %d x %d for %d x %d", (int)cln_utf8_whole(view->name, NAME),
                       view->name, width, height, camera->width, camera->height);
    scene->nearly_sized += fabs(log((double)camera->width / width)) < NEARLY;
    cln_camera_resize(camera, width, height, (double)camera->width / width,
                      (double)camera->height / height);
    return CLN_OK;
}

/* Warns of images without alpha among others: they are right only if all that they show is
 * opaque. */
static void warn_mixed_alpha(const cln_scene *scene)
{
    const char *first = NULL, *first_alpha = NULL;
    int opaque = 0;

    for (int i = 0; i < scene->view_count && scene->has_alpha; i++) {
        const cln_view *v = &scene->views[i];
        const char **name = v->channels == 4 ? &first_alpha : &first;

        *name = *name ? *name : v->name;
        opaque += v->channels != 4;
    }
    if (2 * opaque > scene->view_count && !scene->masks_alpha)
        cln_warn("%s: only %d of %d images %s transparent pixels ('%s'), but for these the scene "
                 "is taken for an object that alpha cuts out: a cube, and nothing beyond it. If "
                 "they cut nothing out, save the images without alpha; else cut it out in the "
                 "others, too",
                 scene->folder, scene->view_count - opaque, scene->view_count,
                 cln_plural(scene->view_count - opaque, "has", "have"), first_alpha);
    else if (opaque > 0)
        cln_warn("%s: %d of %d images %s no %s ('%s'%s), unlike the others: all that "
                 "%s counts as opaque, background included; make %s, or leave these photos out "
                 "(--missing skip)",
                 scene->folder, opaque, scene->view_count, cln_plural(opaque, "has", "have"),
                 scene->masks_alpha ? "mask" : "alpha channel", first, opaque > 1 ? ", ..." : "",
                 cln_plural(opaque, "it shows", "these show"),
                 scene->masks_alpha ? "their masks" : "it");
}

static bool can_decode(const char *path)
{
    int width = 0, height = 0, channels = 0;
    uint8_t *pixels = NULL;
    const cln_status st = cln_image_load(path, &width, &height, &channels, &pixels);

    free(pixels);
    return st == CLN_OK;
}

/* After an image could not be read: the error also names the others, so that they need not be found
 * one by one, and the way to go on without them. A file that looks whole and fails in the decoder
 * is found too late to be left out. */
static void name_other_failures(const cln_scene *scene)
{
    char *first = strdup(cln_error_text());
    const cln_status status = cln_error_status();
    const char *way = "";
    cln_listed others = {0};

    for (int i = 0; first && i < scene->view_count; i++) {
        const char *path = scene->views[i].path;
        const bool whole = cln_image_check(path) == CLN_OK;

        if (strncmp(first, path, strlen(path)) == 0 && first[strlen(path)] == ':') {
            if (!whole)
                way = "; --missing skip leaves such frames out";
            else if (!can_decode(path))
                way = "; remove the file, and --missing skip leaves its frame out";
            continue;
        }
        if (!whole)
            cln_listed_add(&others, 5, "'%s'", scene->views[i].name);
    }
    cln_clear_error();
    if (others.count + 1 >= scene->view_count)
        way = "";
    if (others.count > 0)
        (void)cln_fail(status, "%s; %d more image%s cannot be read: %s%s", first, others.count,
                       cln_plural(others.count, "", "s"), others.text, way);
    else
        (void)cln_fail(status, "%s%s", first ? first : "out of memory", way);
    free(first);
}

/* Photos whose colours are not sRGB's, and what becomes of them. */
typedef struct profiles {
    int count[CLN_COLOUR_UNKNOWN + 1];
    const char *first[CLN_COLOUR_UNKNOWN + 1]; /* photo */
    char name[CLN_COLOUR_UNKNOWN + 1][CLN_COLOUR_NAME];
} profiles;

static void add_profile(profiles *p, const cln_view *view, const cln_image_head *head)
{
    if (p->count[head->colour]++ == 0) {
        p->first[head->colour] = view->name;
        memcpy(p->name[head->colour], head->profile, sizeof head->profile);
    }
}

static void tell_profiles(const cln_scene *scene, const profiles *p)
{
    const int other = p->count[CLN_COLOUR_OTHER], unknown = p->count[CLN_COLOUR_UNKNOWN];

    if (other > 0)
        cln_info("colours: of %d of %d images, converted to sRGB from their profile ('%s'%s)",
                 other, scene->view_count, p->name[CLN_COLOUR_OTHER], other > 1 ? ", ..." : "");
    if (unknown > 0)
        cln_warn("%s: %d of %d images ('%s'%s) %s a colour profile that cannot be converted "
                 "(%s): their colours count as sRGB; convert them to sRGB first if they are not",
                 scene->folder, unknown, scene->view_count, p->first[CLN_COLOUR_UNKNOWN],
                 unknown > 1 ? ", ..." : "", cln_plural(unknown, "has", "have"),
                 cln_colour_unknown_reason());
}

/* Panoramas that are no whole spheres, or are taken for photos of a pinhole. */
static void tell_panoramas(const cln_scene *scene)
{
    const double near = 0.01;
    const cln_view *stretched = NULL, *flat = NULL;
    int others = 0, pinholes = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];
        const cln_camera *c = &v->camera;
        const bool whole = fabs(c->width - 2.0 * c->height) <= near * c->width;

        if (c->lens == CLN_LENS_EQUIRECTANGULAR && !whole && !v->by_file.cut) {
            stretched = stretched ? stretched : v;
            others++;
        } else if (whole && !cln_camera_is_distorted(c) &&
                   fabs(c->fx - c->width / 6.283185307179586) <= near * c->fx) {
            flat = flat ? flat : v;
            pinholes++;
        }
    }
    if (stretched)
        cln_warn("%s: %d of %d images are panoramas that are not 2 : 1 ('%s', %d x %d): they are "
                 "taken for whole spheres, and stretched; of ones that were cut above or below "
                 "transforms.json tells that by fl_x = fl_y = w / (2 pi), cx and cy, or fill them "
                 "up to 2 : 1 and mask that",
                 scene->folder, others, scene->view_count, stretched->name, stretched->camera.width,
                 stretched->camera.height);
    if (flat)
        cln_warn("%s: %d of %d images ('%s') are 2 : 1, with the focal length of a panorama, but "
                 "their lens is that of a pinhole: of panoramas camera_model is EQUIRECTANGULAR",
                 scene->folder, pinholes, scene->view_count, flat->name);
}

/* How many of the 256 levels hold nearly all of what a photo of 16 bits shows besides its commonest
 * one, as of a sky? 256 if it cannot be read, which others tell. */
static int levels_left(const char *path)
{
    int width = 0, height = 0, levels = 0;
    int64_t counts[256] = {0}, held = 0, all = 0;
    bool deep = false;
    uint16_t *values = NULL;

    if (cln_image_load_grey(path, &width, &height, &deep, &values) != CLN_OK) {
        cln_clear_error();
        return 256;
    }
    for (int64_t i = 0; i < (int64_t)width * height; i++)
        counts[values[i] >> 8]++;
    free(values);
    for (int pass = 0; pass <= 256; pass++) { /* the commonest first, which does not count */
        int most = 0;

        for (int v = 1; v < 256; v++)
            most = counts[v] > counts[most] ? v : most;
        if (pass == 0)
            all = (int64_t)width * height - counts[most];
        else if (50 * held >= 49 * all)
            break;
        held += pass ? counts[most] : 0;
        levels += pass > 0;
        counts[most] = 0;
    }
    return levels;
}

static void tell_deep(const cln_scene *scene, const cln_view *first, int count)
{
    enum { FEW = 100 }; /* of an object before black, stretched, there were 120 */
    const int levels = levels_left(first->path);
    char few[320] = "";

    if (levels < FEW)
        snprintf(few, sizeof few,
                 ": what '%s' shows has %d level%s of 256 then. If they are measurements, as of "
                 "heat, stretch all from their lowest to their highest value first, (v - low) / "
                 "(high - low)",
                 first->name, levels, cln_plural(levels, "", "s"));
    cln_warn("%s: %d of %d images ('%s'%s) %s grey of 16 bits and rounded to 8%s. If they are a "
             "sensor's depths, name the photos in their place",
             scene->folder, count, scene->view_count, first->name, count > 1 ? ", ..." : "",
             cln_plural(count, "is", "are"), few);
}

static cln_status read_heads(cln_scene *scene, const cln_callbacks *callbacks)
{
    const cln_view *deep_grey = NULL; /* the first such photo */
    profiles found = {0};
    int count = 0;

    for (int i = 0; i < scene->view_count; i++) {
        cln_view *view = &scene->views[i];
        cln_image_head head;
        cln_status st = cln_tell_work(callbacks, NULL, 0, 0);

        if (st == CLN_OK)
            st = cln_image_read_head(view->path, &head);
        if (st == CLN_INPUT)
            name_other_failures(scene);
        if (st != CLN_OK)
            return st;
        view->file_width = head.width;
        view->file_height = head.height;
        view->channels = head.channels;
        view->orientation = head.orientation;
        deep_grey = head.deep_grey && !deep_grey ? view : deep_grey;
        count += head.deep_grey;
        add_profile(&found, view, &head);
    }
    tell_profiles(scene, &found);
    tell_panoramas(scene);
    if (count > 0)
        tell_deep(scene, deep_grey, count);
    return CLN_OK;
}

/* What divides a photo's size by itself: its longest side has at most AUTO_LONGEST_SIDE pixels
 * then, or as few as --downscale allows, its shortest at least one. */
static int own_downscale(const cln_view *v)
{
    const int longest = v->file_width > v->file_height ? v->file_width : v->file_height;
    const int shortest = v->file_width + v->file_height - longest;
    const int needed = (longest + AUTO_LONGEST_SIDE - 1) / AUTO_LONGEST_SIDE;
    const int n = needed < CLN_MOST_DOWNSCALE ? needed : CLN_MOST_DOWNSCALE;

    return n < shortest ? n : shortest;
}

/* " (and so with 8 other photos)": those that fit_camera refuses after the first; "" without. */
static void count_misshapen(const cln_scene *scene, char out[64])
{
    int count = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        count += (v->camera.width || v->camera.height) &&
                 (v->camera.width != v->file_width || v->camera.height != v->file_height) &&
                 !cln_camera_has_shape(&v->camera, v->file_width, v->file_height);
    }
    *out = 0;
    if (count > 1)
        snprintf(out, 64, " (and so with %d other photo%s)", count - 1,
                 cln_plural(count - 1, "", "s"));
}

cln_status cln_scene_size_views(cln_scene *scene, const cln_scene_desc *desc)
{
    const int downscale = desc->config->downscale;
    cln_status st = CLN_OK;
    char *frame = NULL;
    cln_listed others = {0};
    char more[64];

    CLN_TRY(read_heads(scene, desc->callbacks));
    if (!desc->keep_alpha)
        CLN_TRY(cln_scene_find_opaque(scene, desc));
    CLN_TRY(cln_scene_read_masks(scene, desc));
    if (desc->config->missing == CLN_MISSING_SKIP && !desc->all_told)
        CLN_TRY(cln_scene_leave_uncut_out(scene));
    cln_scene_find_turns(scene);
    CLN_TRY(cln_scene_turn_masks(scene));
    count_misshapen(scene, more);
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *view = &scene->views[i];

        view->multiplied =
            desc->config->multiplied_alpha && view->channels == 4 && !view->alpha_path;
        if (view->alpha_path)
            view->channels = 4;
        CLN_TRY(fit_camera(scene, view, more, &others));
        free(frame);
        CLN_TRY(cln_asprintf(&frame, "%s: frame '%s'", scene->folder, view->name));
        CLN_TRY(cln_camera_check(&view->camera, frame));
        scene->has_alpha |= view->channels == 4;
        scene->lenses |= cln_camera_lenses(&view->camera);
    }
    warn_resized(scene, &others);
    warn_mixed_alpha(scene);
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *view = &scene->views[i];
        const int n = downscale > 0 ? downscale : own_downscale(view);

        if (view->file_width < n || view->file_height < n)
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: --downscale %d leaves nothing of %d x %d pixels; choose less",
                             view->path, n, view->file_width, view->file_height));
        cln_camera_resize(&view->camera, view->file_width / n, view->file_height / n, n, n);
        view->downscale = n;
        scene->downscale = n > scene->downscale ? n : scene->downscale;
        scene->downscale_least = i > 0 && scene->downscale_least < n ? scene->downscale_least : n;
    }
done:
    free(frame);
    return st;
}

static void say_in_file(int images, double bytes, const char *why, const char *way_out)
{
    char need[32];

    cln_format_bytes(bytes, need);
    cln_info("scene: %d image%s take%s %s, %s: their pixels go to a file in %s%s%s", images,
             cln_plural(images, "", "s"), cln_plural(images, "s", ""), need, why,
             cln_store_folder(), *way_out ? "; " : "", way_out);
}

/* Room that a view's pixels take in a store. */
static size_t room_of(const cln_view *v)
{
    return cln_store_room(v->camera.width, v->camera.height, v->channels);
}

cln_status cln_scene_place_images(cln_scene *scene, const cln_scene_desc *desc)
{
    const double limit = desc->config->host_mem;
    const double room =
        limit > 0 ? fmin(limit, cln_hard_memory()) : cln_shared_memory(cln_ranks_here());
    double kept = 0, largest = 0, reading = 0;
    char need[32], have[32], why[128];
    int images = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (!desc->pixels[v->split])
            continue;
        if (v->mask_path) /* every rank reads all masks */
            largest = fmax(largest, (double)v->file_width * v->file_height * MASK_CHANNELS);
        if (!cln_view_is_here(v))
            continue;
        images++;
        kept += (double)v->camera.width * v->camera.height * v->channels;
        largest = fmax(largest, (double)v->file_width * v->file_height * (v->channels + v->opaque));
    }
    reading = 2 * THREADS * largest; /* the file or the row filters, and the pixels */
    if (kept + reading <= room && kept + desc->elsewhere <= room)
        return CLN_OK;
    cln_format_bytes(reading, need);
    cln_format_bytes(room, have);
    if (reading > room)
        return cln_fail(CLN_MEMORY,
                        "%s: reading its largest images needs %s of host memory, but %s is %s; "
                        "make smaller copies of them%s",
                        scene->folder, need,
                        limit <= 0      ? "this machine's"
                        : room == limit ? "--host-mem"
                                        : "what this process may have",
                        have, limit > 0 && room == limit ? ", or raise --host-mem" : "");
    if (images == 0) /* all are other ranks' */
        return CLN_OK;
    scene->cached = room / 8;
    cln_format_bytes(fmax(reading, desc->elsewhere), need);
    snprintf(why, sizeof why, "and %s %s, of the %s of host memory",
             reading > desc->elsewhere ? "the reading of them" : "the program itself", need, have);
    say_in_file(images, kept, why, "");
    return CLN_OK;
}

/* Moves the pixels of all loaded views from memory into a store. */
static cln_status move_to_store(cln_scene *scene)
{
    cln_status st = CLN_OK;
    cln_store *store = NULL;
    size_t place = 0;

    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].pixels)
            place += room_of(&scene->views[i]);
    CLN_TRY(cln_store_create((double)place, scene->cached, &store));
    place = 0;
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];

        if (!v->pixels)
            continue;
        CLN_TRY(cln_store_write(store, place, v->camera.width, v->camera.height, v->channels,
                                v->pixels));
        v->place = place;
        place += room_of(v);
    }
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].pixels) {
            scene->views[i].store = store;
            scene->views[i].pixels = NULL;
        }
    free(scene->pixels);
    scene->pixels = NULL;
    scene->store = store;
    store = NULL;
done:
    cln_store_free(store);
    return st;
}

cln_status cln_scene_shrink(cln_scene *scene, double bytes, const char *why, const char *way_out)
{
    cln_status st = CLN_OK;
    const double kept = cln_scene_pixel_bytes(scene);
    int images = 0;

    if (kept <= bytes)
        return CLN_OK;
    scene->cached = fmax(bytes, 1);
    if (scene->store) {
        CLN_TRY(cln_store_resize(scene->store, bytes));
        goto done;
    }
    for (int i = 0; i < scene->view_count; i++)
        images += scene->views[i].pixels != NULL;
    say_in_file(images, kept, why, way_out);
    CLN_TRY(move_to_store(scene));
done:
    return st;
}

/* One reading of all files. Indices are handed out in order and none after a failure, so the lowest
 * failing index is always among the results: the reported error is the same on every run. */
typedef struct job {
    cln_scene *scene;
    const bool *wanted;
    const cln_callbacks *callbacks; /* called by `thread` alone */
    pthread_t thread;
    uint64_t *digests; /* [view] */
    size_t *places;    /* [view] in scene->pixels, or in the store */
    bool believed;     /* that photos are opaque: nobody looked */
    atomic_bool hides; /* one of these is not */
    atomic_int next;
    atomic_bool stop;
    pthread_mutex_t mutex; /* guards the failure */
    int failed_view;       /* -1: none */
    cln_status failure;
    char *sentence;
} job;

/* Reads and decodes one file; its bytes go into *digest, unless that is NULL. */
static cln_status decode(const char *path, bool wanted, uint64_t *digest, int *width, int *height,
                         int *channels, uint8_t **pixels)
{
    cln_status st = CLN_OK;
    char *data = NULL;
    size_t bytes = 0;

    CLN_TRY(cln_read_file(path, FILE_MAX_BYTES, &data, &bytes));
    if (digest)
        *digest = cln_digest(*digest, data, bytes);
    if (wanted)
        CLN_TRY(cln_image_decode(path, data, bytes, width, height, channels, pixels));
done:
    free(data);
    return st;
}

static cln_status changed(const char *path)
{
    return cln_fail(CLN_INPUT, "%s: the file changed while it was read; try again", path);
}

cln_status cln_view_add_alpha(const cln_view *view, int width, int height, uint64_t *digest,
                              int *channels, uint8_t **pixels)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)width * (size_t)height;
    uint8_t *alpha = NULL;
    int across = 0, down = 0, alpha_channels = 0;

    CLN_TRY(decode(view->alpha_path, true, digest, &across, &down, &alpha_channels, &alpha));
    CLN_TRY(cln_image_turn(view->alpha_turn, &across, &down, alpha_channels, &alpha));
    if (!cln_image_alike(across, down, width, height))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: its shape is not the photo's any more; put the file back",
                         view->alpha_path));
    CLN_TRY(cln_image_fit(width, height, &across, &down, alpha_channels, &alpha));
    if (view->alpha_mask)
        cln_mask_to_alpha(alpha, count, alpha_channels, view->mask_least > 1);
    for (size_t i = 0; i < count * (size_t)alpha_channels && view->alpha_black; i++)
        alpha[i] = (uint8_t)(255 - alpha[i]);
    CLN_TRY(cln_image_put_alpha(count, alpha, alpha_channels, channels, pixels));
done:
    free(alpha);
    return st;
}

/* Takes the alpha from decoded pixels that are opaque. */
static cln_status drop_alpha(job *work, const cln_view *view, int *channels, uint8_t *pixels)
{
    const size_t count = (size_t)view->file_width * (size_t)view->file_height;
    const bool opaque = *channels == 4 && cln_image_is_opaque(pixels, count);

    if (*channels != 4 || (!opaque && !work->believed))
        return changed(view->path);
    if (!opaque)
        atomic_store(&work->hides, true); /* all ranks read on, and then all read again */
    for (size_t i = 1; i < count; i++)
        memmove(pixels + 3 * i, pixels + 4 * i, 3);
    *channels = 3;
    return CLN_OK;
}

/* Does a block of n x n pixels of a mask count? All of them must. */
static bool counts(const cln_view *view, const uint8_t *mask, int channels, int x, int y, int n)
{
    for (int row = y * n; row < (y + 1) * n; row++)
        for (int column = x * n; column < (x + 1) * n; column++) {
            const uint8_t *p =
                mask + ((size_t)row * (size_t)view->file_width + (size_t)column) * (size_t)channels;
            const bool black =
                p[0] < view->mask_least && p[1] < view->mask_least && p[2] < view->mask_least;

            if (black != view->mask_black)
                return false;
        }
    return true;
}

/* Reads the view's mask; the pixels that count become view->kept. */
static cln_status add_mask(cln_view *view, bool wanted, uint64_t *digest)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)view->camera.width * (size_t)view->camera.height;
    uint8_t *mask = NULL, *kept = NULL;
    int width = 0, height = 0, channels = 0;
    bool any = false;

    CLN_TRY(decode(view->mask_path, wanted, digest, &width, &height, &channels, &mask));
    if (!wanted)
        goto done;
    CLN_TRY(cln_image_turn(view->mask_turn, &width, &height, channels, &mask));
    if (!cln_image_alike(width, height, view->file_width, view->file_height))
        CLN_TRY(changed(view->mask_path));
    CLN_TRY(cln_image_fit(view->file_width, view->file_height, &width, &height, channels, &mask));
    CLN_TRY(cln_alloc(&kept, (count + 7) / 8, 1, view->mask_path));
    for (size_t i = 0; i < count; i++) {
        const int x = (int)(i % (size_t)view->camera.width);
        const int y = (int)(i / (size_t)view->camera.width);

        if (cln_view_keeps(view, x, y) && counts(view, mask, channels, x, y, view->downscale)) {
            kept[i / 8] |= (uint8_t)(1 << i % 8);
            any = true;
        }
    }
    if (!any)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the mask leaves no pixel of its image (%s ones count); remove the "
                         "frame or correct the mask, or, if all masks are %s where something is to "
                         "be left out, %s",
                         view->mask_path, view->mask_black ? "black" : "other than black",
                         view->mask_black ? "black" : "white",
                         view->mask_black ? "exchange their black and white, or leave --masks "
                                            "ignore-white out"
                                          : "give --masks ignore-white"));
    view->kept = view->masked = kept;
    kept = NULL;
done:
    free(mask);
    free(kept);
    return st;
}

cln_status cln_view_read_mask(cln_view *view)
{
    return add_mask(view, true, NULL);
}

/* cln_view.most_alpha of pixels of four channels. */
static int most_alpha(const uint8_t *pixels, size_t count)
{
    int most = 0;

    for (size_t i = 0; i < count && most < 128; i++)
        most = pixels[4 * i + 3] > most ? pixels[4 * i + 3] : most;
    return 1 + most;
}

/* cln_view.hides of pixels of four channels. */
static bool hides(const uint8_t *pixels, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (pixels[4 * i + 3] < 128)
            return true;
    return false;
}

double cln_scene_masks_leave(const cln_scene *scene, int *views)
{
    double left = 0, all = 0;

    *views = 0;
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const size_t count = (size_t)view->camera.width * (size_t)view->camera.height;

        if (!view->masked)
            continue;
        ++*views;
        all += (double)count;
        for (size_t k = 0; k < (count + 7) / 8; k++)
            left += __builtin_popcount(view->masked[k]);
    }
    return all > 0 ? left / all : 1;
}

/* Logs how much the masks leave, as a warning if it is all or little: then their colours are mostly
 * swapped, or, if nobody said what they are, they may be of an object. */
static void say_masks(const cln_scene *scene)
{
    int views = 0;
    const double left = cln_scene_masks_leave(scene, &views);

    if (views)
        cln_log(left < CLN_MASKS_LEAST || left >= 1 ? CLN_LOG_WARN : CLN_LOG_INFO,
                "%s: the mask%s of %d image%s leave%s %.3g %% of %s pixels", scene->folder,
                cln_plural(views, "", "s"), views, cln_plural(views, "", "s"),
                cln_plural(views, "s", ""), 100 * left, cln_plural(views, "its", "their"));
    if (views && scene->masks_doubtful && left < CLN_MASKS_LEAVE)
        cln_warn("%s: " CLN_MASKS_ADVICE, scene->folder);
}

/* A view whose pixels are another rank's. The next rank's files are read here too, for their
 * digest, so that each file has been compared on two ranks. */
static cln_status read_others(job *work, int index)
{
    cln_status st = CLN_OK;
    cln_view *view = &work->scene->views[index];
    const bool masks = work->wanted[view->split] && view->mask_path;
    uint64_t *digest = &work->digests[index], ignored = 0;

    if (view->rank == (cln_ranks_me() + 1) % cln_ranks_count()) {
        CLN_TRY(decode(view->path, false, digest, NULL, NULL, NULL, NULL));
        if (view->alpha_path)
            CLN_TRY(decode(view->alpha_path, false, digest, NULL, NULL, NULL, NULL));
        if (view->mask_path && !masks)
            CLN_TRY(decode(view->mask_path, false, digest, NULL, NULL, NULL, NULL));
    } else {
        digest = &ignored;
    }
    if (masks)
        CLN_TRY(add_mask(view, true, digest));
done:
    return st;
}

static cln_status read_view(job *work, int index)
{
    cln_status st = CLN_OK;
    cln_view *view = &work->scene->views[index];
    const bool wanted = work->wanted[view->split];
    uint64_t *digest = &work->digests[index];
    uint8_t *pixels = NULL;
    int width = 0, height = 0, channels = 0;

    *digest = CLN_DIGEST_START;
    if (!cln_view_is_here(view))
        return read_others(work, index);
    CLN_TRY(decode(view->path, wanted, digest, &width, &height, &channels, &pixels));
    if (wanted && view->turned)
        CLN_TRY(cln_image_turn(view->orientation, &width, &height, channels, &pixels));
    if (wanted && (width != view->file_width || height != view->file_height))
        CLN_TRY(changed(view->path));
    if (wanted && view->opaque)
        CLN_TRY(drop_alpha(work, view, &channels, pixels));
    if (wanted && view->multiplied && channels == 4)
        cln_image_divide_alpha(pixels, (size_t)width * (size_t)height);
    if (view->alpha_path && wanted)
        CLN_TRY(cln_view_add_alpha(view, width, height, digest, &channels, &pixels));
    else if (view->alpha_path)
        CLN_TRY(decode(view->alpha_path, false, digest, NULL, NULL, NULL, NULL));
    if (view->mask_path)
        CLN_TRY(add_mask(view, wanted, digest));
    if (!wanted)
        goto done;
    if (channels != view->channels)
        CLN_TRY(changed(view->path));
    if (channels == 4) {
        view->most_alpha = most_alpha(pixels, (size_t)width * (size_t)height);
        view->hides = hides(pixels, (size_t)width * (size_t)height);
    }
    CLN_TRY(cln_image_downscale(view->downscale, &width, &height, channels, &pixels));
    CLN_ASSERT(width == view->camera.width && height == view->camera.height);
    view->place = work->places[index];
    if (work->scene->store) {
        CLN_TRY(cln_store_write(work->scene->store, view->place, width, height, channels, pixels));
        view->store = work->scene->store;
        goto done;
    }
    view->pixels = work->scene->pixels + view->place;
    memcpy(view->pixels, pixels, (size_t)width * (size_t)height * (size_t)channels);
done:
    free(pixels);
    return st;
}

/* Errors are thread-local: hands the sentence over to the thread that started the work. */
static void take_failure(job *work, int index, cln_status st)
{
    pthread_mutex_lock(&work->mutex);
    if (work->failed_view < 0 || index < work->failed_view) {
        free(work->sentence);
        work->sentence = strdup(cln_error_text()); /* NULL is reported as "out of memory" below */
        work->failed_view = index;
        work->failure = st;
    }
    pthread_mutex_unlock(&work->mutex);
    cln_clear_error();
}

static void *read_views(void *argument)
{
    job *work = argument;

    while (!atomic_load(&work->stop)) {
        const int index = atomic_fetch_add(&work->next, 1);
        cln_status st = CLN_OK;

        if (index >= work->scene->view_count)
            break;
        if (pthread_equal(pthread_self(), work->thread))
            st = cln_tell_work(work->callbacks, "images", index, work->scene->view_count);
        if (st == CLN_OK)
            st = read_view(work, index);
        if (st != CLN_OK) {
            atomic_store(&work->stop, true);
            take_failure(work, index, st);
        }
    }
    return NULL;
}

/* Makes room for the pixels of all wanted views. */
static cln_status make_room(job *work)
{
    cln_status st = CLN_OK;
    cln_scene *scene = work->scene;
    size_t bytes = 0;

    CLN_TRY(cln_alloc(&work->places, (size_t)scene->view_count, sizeof *work->places, "images"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        work->places[i] = bytes;
        if (!work->wanted[v->split] || !cln_view_is_here(v))
            continue;
        bytes += scene->cached > 0
                     ? room_of(v)
                     : (size_t)v->camera.width * (size_t)v->camera.height * (size_t)v->channels;
    }
    if (scene->cached > 0)
        CLN_TRY(cln_store_create((double)bytes, scene->cached, &scene->store));
    else
        CLN_TRY(cln_alloc(&scene->pixels, bytes, 1, "images"));
done:
    return st;
}

/* Brings the digests of all views to all ranks. CLN_USAGE on all if a file is another one on the
 * rank before its own. */
static cln_status share_digests(job *work)
{
    cln_status st = CLN_OK;
    const cln_scene *scene = work->scene;
    const int next = (cln_ranks_me() + 1) % cln_ranks_count();
    uint64_t *read = NULL;
    double other = -1;

    if (cln_ranks_count() == 1)
        return CLN_OK;
    CLN_TRY(cln_alloc(&read, (size_t)scene->view_count, sizeof *read, "digests"));
    memcpy(read, work->digests, (size_t)scene->view_count * sizeof *read);
    for (int s = 0; s < CLN_SPLITS; s++) {
        int first[CLN_RANKS_MOST + 1];

        cln_scene_dealt(scene, (cln_split)s, first);
        cln_ranks_gather(work->digests + cln_scene_split_view(scene, (cln_split)s, 0), sizeof *read,
                         first, true);
    }
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].rank == next && read[i] != work->digests[i])
            other = i;
    cln_ranks_largest(&other, 1);
    if (other >= 0)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "ranks have different files of '%s' in %s; start all ranks with the same "
                         "scene, or bring its copies up to date",
                         scene->views[(int)other].name, scene->folder));
done:
    free(read);
    return st;
}

/* Digest of which pixels count, which all ranks must know alike: by these and the random numbers
 * they draw pixels, and so know how long messages are. */
static uint64_t digest_of_kept(const cln_scene *scene)
{
    uint64_t digest = CLN_DIGEST_START;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];
        const size_t count = (size_t)v->camera.width * (size_t)v->camera.height;
        const int32_t turns[4] = {v->turned, v->alpha_turn, v->mask_turn, v->kept != NULL};

        digest = cln_digest(digest, turns, sizeof turns);
        if (v->kept)
            digest = cln_digest(digest, v->kept, (count + 7) / 8);
    }
    return digest;
}

cln_status cln_scene_read_images(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    char empty[CLN_EMPTY_BYTES];
    job work = {.scene = scene,
                .wanted = desc->pixels,
                .callbacks = desc->callbacks,
                .thread = pthread_self(),
                .believed = desc->opaque_digest != 0,
                .failed_view = -1};
    pthread_t threads[THREADS - 1];
    double hides = 0;
    int started = 0;

    pthread_mutex_init(&work.mutex, NULL);
    CLN_TRY(cln_alloc(&work.digests, (size_t)scene->view_count, sizeof *work.digests, "digests"));
    CLN_TRY(make_room(&work));
    CLN_TRY(cln_tell_work(desc->callbacks, "images", 0, scene->view_count));
    /* This thread works too; if no other can be started it works alone. */
    while (started < THREADS - 1 && !pthread_create(&threads[started], NULL, read_views, &work))
        started++;
    read_views(&work);
    for (int i = 0; i < started; i++)
        pthread_join(threads[i], NULL);
    if (work.failed_view >= 0) {
        st = cln_fail(work.failure, "%s", work.sentence ? work.sentence : "out of memory");
        if (st == CLN_INPUT)
            name_other_failures(scene);
        goto done;
    }
    CLN_TRY(share_digests(&work));
    hides = atomic_load(&work.hides);
    cln_ranks_largest(&hides, 1);
    scene->hides = hides > 0;
    if (cln_ranks_count() > 1)
        CLN_TRY(cln_ranks_agree(digest_of_kept(scene), "set of masks, or turns of photos,"));
    for (int i = 0; i < scene->view_count; i++) {
        uint64_t *test = &scene->test_digest;

        scene->views[i].digest = work.digests[i];
        scene->digest = cln_digest(scene->digest, &work.digests[i], sizeof work.digests[i]);
        if (scene->views[i].split == CLN_SPLIT_TEST)
            *test = cln_digest(*test, &work.digests[i], sizeof work.digests[i]);
    }
    say_masks(scene);
    if (cln_scene_is_empty(scene, empty))
        cln_warn("%s: %s", scene->folder, empty);
    if (cln_scene_is_whole(scene, empty))
        cln_warn("%s: %s", scene->folder, empty);
    if (scene->has_alpha && cln_scene_is_multiplied(scene, empty))
        cln_warn("%s: %s", scene->folder, empty);
    CLN_TRY(cln_scene_find_reversed(scene, empty));
    if (empty[0])
        cln_warn("%s: %s", scene->folder, empty);
done:
    free(work.digests);
    free(work.places);
    free(work.sentence);
    pthread_mutex_destroy(&work.mutex);
    return st;
}
