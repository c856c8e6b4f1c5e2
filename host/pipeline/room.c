/* What memory has room for. See room.h. */
#include "pipeline/room.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/disk.h"
#include "io/progress.h"
#include "ranks/ranks.h"
#include "scene/store.h"

cln_room_desc cln_room_training(cln_device *device, const cln_config *config,
                                const cln_scene *scene, const cln_octree *tree,
                                double coverage_bytes, double photos)
{
    const bool shell = scene->space.shell;
    const int level = config->start_level;
    cln_room_desc desc = {.device = device,
                          .config = config,
                          .scene = scene,
                          .leaves = cln_config_most_leaves(config, shell),
                          .first = cln_config_first_leaves(config, shell),
                          .first_depth = shell ? 1 + (level > 2 ? level : 2) : level,
                          .coverage_bytes = coverage_bytes,
                          .photos = photos};

    if (tree) {
        desc.first = tree->leaf_count;
        desc.first_depth = cln_octree_depth(tree);
    }
    if (desc.first > desc.leaves)
        desc.leaves = desc.first;
    return desc;
}

/* The plans of a tree, with so many bytes of photos in memory. */
static void plan(const cln_room_desc *d, const cln_pipeline *outline, int leaves, int depth,
                 double photos, cln_plan *device, cln_plan *host)
{
    const cln_plan_desc desc = {.pipeline = outline,
                                .scene = d->scene,
                                .leaves = leaves,
                                .training = d->coverage_bytes >= 0,
                                .coverage_bytes = fmax(0, d->coverage_bytes),
                                .depth = depth,
                                .photos = fmax(1, photos)};

    cln_plan_device(&desc, device);
    cln_plan_host(&desc, device, host);
}

/* Depth of a tree of so many leaves whose deepest level covers a surface (cln_config_most_leaves),
 * and a level more. */
static int usual_depth(const cln_room_desc *d, int leaves)
{
    int level = 1;

    while (level < CLN_MAX_LEVEL && 8.0 * exp2(2 * level) < leaves)
        level++;
    return level + 1 + d->scene->space.shell;
}

/* Leaves of the largest tree that fits with so many bytes of photos, if it is no deeper than usual;
 * 0 if not even the first does. */
static int most_leaves(const cln_room_desc *d, const cln_pipeline *outline, double photos)
{
    int low = d->first, high = d->leaves;
    cln_plan device, host;

    plan(d, outline, d->first, d->first_depth, photos, &device, &host);
    if (!cln_plan_fits(d->device, &device, &host))
        return 0;
    plan(d, outline, high, usual_depth(d, high), photos, &device, &host);
    if (cln_plan_fits(d->device, &device, &host))
        return high;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;

        plan(d, outline, middle, usual_depth(d, middle), photos, &device, &host);
        *(cln_plan_fits(d->device, &device, &host) ? &low : &high) = middle;
    }
    return low;
}

/* A --max-leaves by which no tree has more than `leaves`, in two digits; 0 if there is none. */
static int option(const cln_room_desc *d, int leaves)
{
    const bool shell = d->scene->space.shell;
    cln_config least = *d->config;
    double digit = 1;

    while (leaves / digit >= 100)
        digit *= 10;
    leaves = (int)(floor(leaves / digit) * digit);
    least.max_leaves = leaves;
    if (!least.adaptive || leaves <= d->first || leaves >= d->config->max_leaves ||
        cln_config_most_leaves(&least, shell) > leaves)
        return 0;
    return leaves;
}

/* The plans of the largest and the first tree. */
static void make(const cln_room_desc *d, const cln_pipeline *outline, cln_room *out)
{
    plan(d, outline, d->leaves, d->depth, out->kept, &out->device, &out->host);
    if (d->coverage_bytes >= 0)
        plan(d, outline, d->first, d->first_depth, out->kept, &out->first_device, &out->first_host);
}

static cln_status make_outline(const cln_room_desc *d, cln_pipeline *out)
{
    cln_status st = CLN_OK;
    const bool training = d->coverage_bytes >= 0;

    CLN_TRY(cln_pipeline_outline(d->device, d->config,
                                 &(cln_pipeline_facts){.lenses = d->scene->lenses,
                                                       .alpha = d->scene->has_alpha,
                                                       .depth = training ? 0 : d->depth,
                                                       .space = &d->scene->space},
                                 out));
    if (training && cln_ranks_count() > 1)
        out->ranks = cln_ranks_count(); /* as cln_pipeline_share */
done:
    return st;
}

static bool grows(const cln_room_desc *d)
{
    return d->leaves > d->first;
}

/* Does a plan take no more than half of what the least one leaves? */
static bool is_modest(const cln_plan *plan, const cln_plan *least)
{
    return plan->total - least->total <= (plan->limit - least->total) / 2;
}

/* Bytes of the photos that will be in memory whatever else is. */
static double photos_beside(const cln_room_desc *d, double limit)
{
    return d->photos <= fmax(CLN_STORE_LEAST, CLN_ROOM_PHOTOS * limit) ? d->photos
                                                                       : CLN_STORE_LEAST;
}

cln_status cln_room_fit_batch(const cln_room_desc *d, bool rays_too, int *samples, int *rays)
{
    cln_status st = CLN_OK;
    cln_pipeline p;
    cln_config *c = &p.config;
    cln_plan device, host, least_device, least_host;
    double photos = 0;

    *samples = d->config->batch_samples;
    *rays = d->config->rays;
    CLN_TRY(make_outline(d, &p));
    plan(d, &p, d->leaves, d->depth, 0, &device, &host);
    photos = photos_beside(d, host.limit);
    plan(d, &p, d->leaves, d->depth, photos, &device, &host);
    if (cln_plan_fits(d->device, &device, &host))
        goto done;
    for (c->rays = *rays; c->rays >= CLN_LEAST_RAYS; c->rays = rays_too ? c->rays / 2 : 0) {
        c->batch_samples = CLN_LEAST_BATCH;
        plan(d, &p, d->first, d->first_depth, photos, &least_device, &least_host);
        for (c->batch_samples = d->config->batch_samples; c->batch_samples >= CLN_LEAST_BATCH;
             c->batch_samples /= 2) {
            plan(d, &p, d->first, d->first_depth, photos, &device, &host);
            if (cln_plan_fits(d->device, &device, &host) &&
                (!grows(d) ||
                 (is_modest(&device, &least_device) && is_modest(&host, &least_host)))) {
                *samples = c->batch_samples;
                *rays = c->rays;
                goto done;
            }
        }
    }
done:
    return st;
}

cln_status cln_room_find(const cln_room_desc *d, cln_room *out)
{
    cln_status st = CLN_OK;
    cln_pipeline outline;
    const bool training = d->coverage_bytes >= 0;
    bool fits = false; /* the first tree, beside all photos */
    cln_plan device, host;

    memset(out, 0, sizeof *out);
    CLN_TRY(make_outline(d, &outline));
    out->kept = d->photos;
    make(d, &outline, out);
    host = out->host;
    if (training)
        plan(d, &outline, d->leaves, usual_depth(d, d->leaves), d->photos, &device, &host);
    fits = training && out->first_host.total <= out->first_host.limit;
    out->in_memory = d->photos <= CLN_STORE_LEAST || host.total <= host.limit ||
                     (fits && d->photos <= CLN_ROOM_PHOTOS * out->host.limit);
    if (!out->in_memory) {
        const double rest = (training ? out->first_host.total : out->host.total) - d->photos;

        out->budget = fits;
        if (fits)
            out->keeping = option(d, most_leaves(d, &outline, d->photos));
        out->kept =
            fmax(CLN_STORE_LEAST, fmin(out->host.limit - rest, CLN_ROOM_CACHED * out->host.limit));
        make(d, &outline, out);
    }
    out->whole = cln_plan_fits(d->device, &out->device, &out->host);
    if (training) {
        out->leaves = out->whole ? d->leaves : most_leaves(d, &outline, out->kept);
        out->fitting = out->whole ? 0 : option(d, out->leaves);
        out->needed = out->whole ? out->host.total : out->first_host.total;
        if (!out->whole && out->leaves > d->first) {
            plan(d, &outline, out->leaves, usual_depth(d, out->leaves), out->kept, &device, &host);
            out->needed = host.total;
        }
    }
done:
    return st;
}

/* ---- where photos lie ---- */

/* What takes most besides photos, in host memory: on a CPU, of its device's rows. */
static const char *largest(const cln_plan *device, const cln_plan *host)
{
    const char *name = "";
    double most = 0;

    for (int i = 0; i < host->count + device->count; i++) {
        const bool of_host = i < host->count;
        const cln_plan *plan = of_host ? host : device;
        const int k = of_host ? i : i - host->count;
        const char *purpose = plan->rows[k].purpose;

        if (strcmp(purpose, CLN_PLAN_IMAGES) == 0 || strcmp(purpose, CLN_PLAN_SHARED) == 0 ||
            (!of_host && strcmp(host->rows[host->count - 1].purpose, CLN_PLAN_SHARED) != 0))
            continue;
        if (plan->rows[k].bytes > most) {
            most = plan->rows[k].bytes;
            name = purpose;
        }
    }
    return name;
}

/* Why photos go to a file: what takes the room that they do not have. */
static void say_why(const cln_room_desc *d, const cln_room *room, char out[CLN_ROOM_TEXT])
{
    const bool leaves = room->budget, training = d->coverage_bytes >= 0;
    const cln_plan *device = leaves || !training ? &room->device : &room->first_device;
    const cln_plan *host = leaves || !training ? &room->host : &room->first_host;
    char limit[32], rest[32];

    cln_format_bytes(host->limit, limit);
    cln_format_bytes(host->total - room->kept, rest);
    if (leaves)
        snprintf(out, CLN_ROOM_TEXT,
                 "and a tree of up to %d leaves with all else %s, of the %s of host memory",
                 d->leaves, rest, limit);
    else
        snprintf(out, CLN_ROOM_TEXT, "and all else %s, most of it for %s, of the %s of host memory",
                 rest, largest(device, host), limit);
}

cln_status cln_room_place_images(const cln_room_desc *d, cln_scene *scene, cln_room *out)
{
    cln_status st = CLN_OK;
    char why[CLN_ROOM_TEXT], way_out[96] = "";

    CLN_TRY(cln_room_find(d, out));
    if (out->in_memory)
        goto done;
    say_why(d, out, why);
    if (out->keeping > 0)
        snprintf(way_out, sizeof way_out, "--max-leaves %d keeps them in memory", out->keeping);
    st = cln_scene_shrink(scene, out->kept, why, way_out);
    if (st == CLN_OUTPUT && out->keeping > 0)
        cln_note("memory is kept for a tree of up to %d leaves: --max-leaves %d keeps the photos "
                 "there instead",
                 d->leaves, out->keeping);
done:
    return st;
}

/* ---- sentences ---- */

void cln_room_say_batch(const cln_room_desc *d, int samples, int rays, char out[CLN_ROOM_TEXT])
{
    const cln_config *c = d->config;
    char fewer[96] = "";

    out[0] = 0;
    if (rays < c->rays)
        snprintf(fewer, sizeof fewer, " and at most %d rays, not %d (--rays)", rays, c->rays);
    if (samples < c->batch_samples || rays < c->rays)
        snprintf(out, CLN_ROOM_TEXT, "a step has %d samples, not %d (--batch-samples)%s, %s",
                 samples, c->batch_samples, fewer,
                 grows(d) ? "so that the tree has room to grow" : "as there is no room for more");
}

/* Why not even the first tree fits. */
static void say_refused(const cln_room_desc *d, const cln_room *room, char out[CLN_ROOM_TEXT])
{
    if (cln_plan_check(d->device, &room->first_device) == CLN_OK)
        (void)cln_plan_check_host(&room->first_host);
    snprintf(out, CLN_ROOM_TEXT, "a training is refused with its first tree of %d %s: %s", d->first,
             cln_plural(d->first, "leaf", "leaves"), cln_error_text());
    cln_clear_error();
}

int cln_room_downscale(const cln_room_desc *d, const cln_room *room)
{
    const int far = 20; /* times fewer leaves */
    const double limit = room->first_host.limit;
    double bytes = 0;
    int by = 1;

    for (int i = 0; i < room->first_host.count; i++)
        if (strcmp(room->first_host.rows[i].purpose, CLN_PLAN_PICTURES) == 0)
            bytes = room->first_host.rows[i].bytes;
    if (room->whole || room->leaves > d->config->max_leaves / far || bytes < limit / 4)
        return 0;
    while (bytes / by / by > limit / 16)
        by *= 2;
    by *= d->scene->downscale > 1 ? d->scene->downscale : 1;
    return by <= CLN_MOST_DOWNSCALE ? by : CLN_MOST_DOWNSCALE;
}

void cln_room_say_tree(const cln_room_desc *d, const cln_room *room, char out[CLN_ROOM_TEXT])
{
    const int by = cln_room_downscale(d, room);
    char way_out[128] = "";

    out[0] = 0;
    if (by > 0)
        snprintf(way_out, sizeof way_out,
                 ", as pictures of the photos' size take most: --downscale %d makes room", by);
    else if (room->fitting > 0)
        snprintf(way_out, sizeof way_out, "; --max-leaves %d --max-level %d asks for no more",
                 room->fitting, usual_depth(d, room->fitting));
    if (room->leaves == 0)
        say_refused(d, room, out);
    else if (!room->whole && room->leaves == d->leaves)
        snprintf(out, CLN_ROOM_TEXT,
                 "there is room for that tree while it is no deeper than level %d: growth that "
                 "would not fit is left out",
                 usual_depth(d, d->leaves));
    else if (!room->whole)
        snprintf(
            out, CLN_ROOM_TEXT,
            "there is room for a tree of about %d leaves: growth that would not fit is left out%s",
            room->leaves, way_out);
}

void cln_room_say_photos(const cln_room_desc *d, const cln_room *room, char out[CLN_ROOM_TEXT])
{
    char photos[32], there[32], way_out[64] = "";

    out[0] = 0;
    cln_format_bytes(d->photos, photos);
    cln_format_bytes(cln_disk_room(cln_store_folder()), there);
    if (room->keeping > 0)
        snprintf(way_out, sizeof way_out, "; --max-leaves %d keeps them in memory", room->keeping);
    if (!room->in_memory && cln_store_possible(d->photos) != CLN_OK) {
        snprintf(out, CLN_ROOM_TEXT,
                 "the photos' pixels, %s, go to a file in a folder that TMPDIR names, and a "
                 "training is refused: %s%s",
                 photos, cln_error_text(), way_out);
        cln_clear_error();
    } else if (!room->in_memory) {
        snprintf(out, CLN_ROOM_TEXT,
                 "the photos' pixels, %s, go to a file in %s, which has %s free%s", photos,
                 cln_store_folder(), there, way_out);
    } else if (!room->whole && d->photos > 0) {
        snprintf(out, CLN_ROOM_TEXT, "the photos' pixels, %s, stay in memory", photos);
    }
}

void cln_room_say_free(const cln_room_desc *d, const cln_room *room, double available, bool *now,
                       char out[CLN_ROOM_TEXT])
{
    const double most = room->needed, mib = 1 << 20;
    const double least =
        room->first_host.total - room->kept + fmin(room->kept, (double)CLN_STORE_LEAST);
    double digit = 1, fits = floor(available / mib);
    char all[32], free_bytes[32], need[32];

    *now = available < least;
    out[0] = 0;
    if (most <= available)
        return;
    while (fits / digit >= 100)
        digit *= 10;
    if (floor(fits / digit) * digit * mib > least)
        fits = floor(fits / digit) * digit;
    cln_format_bytes(cln_host_memory(), all);
    cln_format_bytes(available, free_bytes);
    cln_format_bytes(*now ? least : most, need);
    if (!*now && strcmp(need, free_bytes) == 0) /* but for what is small beside what is planned */
        return;
    if (*now && cln_host_memory() <= available)
        snprintf(out, CLN_ROOM_TEXT,
                 "this process may have %s (ulimit -v, -d), and the training needs %s from its "
                 "first tree of %d %s on: raise the limit",
                 all, need, d->first, cln_plural(d->first, "leaf", "leaves"));
    else if (*now)
        snprintf(out, CLN_ROOM_TEXT,
                 "of %s of host memory only %s are free now, and the training needs %s from its "
                 "first tree of %d %s on: the system may end it; close other programs",
                 all, free_bytes, need, d->first, cln_plural(d->first, "leaf", "leaves"));
    else
        snprintf(out, CLN_ROOM_TEXT,
                 "of %s of host memory %s are free now, and the training may come to need %s: "
                 "--host-mem %.0fM keeps it below what is free",
                 all, free_bytes, need, fits);
}
