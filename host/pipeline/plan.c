/* The memory plans. See plan.h; the device's rows are the list of buffers (buffer_list.h), summed
 * by purpose. */
#include "pipeline/plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "io/json.h"
#include "io/progress.h"
#include "pipeline/carry.h"
#include "pipeline/halo.h"
#include "pipeline/share.h"
#include "pipeline/splat.h"
#include "pipeline/stages.h"
#include "ranks/ranks.h"

static void row(cln_plan *plan, const char *purpose, const char *way_out)
{
    CLN_ASSERT(plan->count < CLN_PLAN_ROWS);
    plan->rows[plan->count].purpose = purpose;
    plan->rows[plan->count].parts = 1;
    plan->rows[plan->count++].way_out = way_out;
}

/* Returns what to lower. Voxels have no layers; they grow by --level-at, and may adapt. */
static const char *lower(const cln_plan_desc *d, const char *way_out)
{
    static const char *const voxels[][3] = {
        {CLN_LOWER_LEAVES, "--level-at, --start-level, --grid-cells or --harmonics",
         "--max-leaves, --start-level, --grid-cells or --harmonics"},
        {CLN_LOWER_BATCH, "--batch-samples", "--batch-samples"},
        {CLN_LOWER_CELLS, "--n1, --level-at or --start-level",
         "--n1, --max-leaves or --start-level"},
        {CLN_LOWER_TREE, "--level-at or --start-level", "--max-leaves or --start-level"},
    };
    const cln_config *config = &d->pipeline->config;

    if (!way_out || config->encoding != CLN_ENCODING_VOXEL)
        return way_out;
    for (size_t i = 0; i < sizeof voxels / sizeof *voxels; i++)
        if (strcmp(way_out, voxels[i][0]) == 0)
            return voxels[i][config->adaptive ? 2 : 1];
    return way_out;
}

/* Adds a buffer to the newest row. */
static void add(cln_plan *plan, double bytes)
{
    const int i = plan->count - 1;

    plan->rows[i].bytes += bytes;
    plan->rows[i].largest = fmax(plan->rows[i].largest, bytes);
    plan->total += bytes;
}

/* Adds an array that may be split (pipeline.h): one buffer, or parts of at most `room` rows; if
 * CLN_PARTS of those do not suffice, CLN_PARTS equal parts, so that the check finds them too
 * large. */
static void add_parts(cln_plan *plan, double rows, double room, double row_bytes)
{
    const int i = plan->count - 1;
    const double parts = fmin(ceil(rows / room), CLN_PARTS);
    const double most = fmax(fmin(rows, room), ceil(rows / CLN_PARTS));

    plan->rows[i].bytes += rows * row_bytes;
    plan->rows[i].largest = fmax(plan->rows[i].largest, most * row_bytes);
    plan->rows[i].parts = (int)fmax(plan->rows[i].parts, parts);
    plan->total += rows * row_bytes;
}

/* The largest row that can be lowered; -1 if none can. */
static int largest_row(const cln_plan *plan)
{
    int worst = -1;

    for (int i = 0; i < plan->count; i++)
        if (plan->rows[i].way_out && (worst < 0 || plan->rows[i].bytes > plan->rows[worst].bytes))
            worst = i;
    return worst;
}

/* ---- the device ---- */

/* Sizes from which the numbers of rows follow. */
typedef struct sizes {
    double leaves, rays, ray_rows, extra_rays, samples, slices, points, gradients;
    double views, pixels;            /* of a splatted batch; of the largest view */
    double runs;                     /* runs of cells: a work-item projects one into a view */
    double entries;                  /* projected samples held at a time */
    double part_leaves, part_slices; /* rows of a part */
    double widest;                   /* values of a digit of the sort */
    bool split;                      /* arrays are split into parts */
    bool distil;
} sizes;

/* Bytes of one row. */
static double bytes_of(const cln_plan_desc *d, cln_buffer_id id)
{
    return (double)cln_buffer_row_bytes(d->pipeline, id);
}
#define BYTES(d, member) bytes_of(d, CLN_BUFFER_##member)

/* Entries of a radix sort's table for n elements (sort.c). */
static double places_of(double n, double widest)
{
    return n / CLN_SORT_PER_DIGIT + widest + 1;
}

/* Pixels of the scene's largest view, if the caller does not tell how many there are. */
static double pixels_of(double told, const cln_scene *scene)
{
    double most = told;

    for (int i = 0; i < scene->view_count && told == 0; i++)
        most = fmax(most, (double)scene->views[i].camera.width * scene->views[i].camera.height);
    return most;
}

/* Leaves of this rank and of others have common vertices. */
static bool is_linked(const cln_plan_desc *d)
{
    return d->training && cln_halo_is_linked(d->pipeline);
}

/* Leaves that have their weights here, and slices of samples. */
static double own_leaves(const cln_plan_desc *d, double leaves)
{
    if (d->pipeline->ranks <= 1)
        return leaves;
    return d->deal ? d->deal->own : cln_share_most(d->pipeline, (int)leaves);
}

/* Of `leaves`, those of other ranks that have common vertices with `own` of this rank, whose owner
 * is here; or the other way round. Voxels lie on surfaces: if a cut between ranks lies along one,
 * each leaf has one across (ground at half the cube's height: half of all leaves, of two ranks).
 * And if a rank's m^3 leaves fill a block, three of its sides have 3 m^2 + 3 m + 1 at them. */
static int most_far(int leaves, int own)
{
    return (int)fmin(leaves, ceil(pow(cbrt(own) + 1, 3)));
}

/* Links of one direction (halo.h): each of those leaves has a face's. */
static int64_t most_links(const cln_pipeline *p, int far)
{
    return (int64_t)far * (p->net.cells + 1) * (p->net.cells + 1);
}

static double far_leaves(const cln_plan_desc *d, double leaves)
{
    if (!is_linked(d))
        return 0;
    return d->deal ? d->deal->far : most_far((int)leaves, (int)own_leaves(d, leaves));
}

/* Leaves that may have slices here. */
static double sliced_leaves(const cln_plan_desc *d, double leaves)
{
    if (d->deal && is_linked(d))
        return d->deal->sliced;
    return fmin(own_leaves(d, leaves) + far_leaves(d, leaves), leaves);
}

static double links_of(const cln_plan_desc *d, double leaves)
{
    return (double)(d->deal ? d->deal->links : most_links(d->pipeline, (int)far_leaves(d, leaves)));
}

static int64_t more_links(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

static int larger(int a, int b)
{
    return a > b ? a : b;
}

cln_status cln_plan_deal(const cln_pipeline *p, const cln_octree *tree, cln_deal *out)
{
    cln_status st = CLN_OK;
    int64_t links[CLN_RANKS_MOST];
    int far[CLN_RANKS_MOST];

    *out = (cln_deal){.own = tree->leaf_count, .sliced = tree->leaf_count};
    if (p->ranks > 1)
        *out = (cln_deal){0};
    CLN_TRY(cln_halo_count(p, tree, p->rank_first, links, far));
    for (int r = 0; p->ranks > 1 && r < p->ranks; r++) {
        const int own = p->rank_first[r + 1] - p->rank_first[r];

        out->own = larger(out->own, own);
        out->links = more_links(out->links, links[r]);
        out->far = larger(out->far, far[r]);
        out->sliced = larger(out->sliced, own + far[r]);
    }
done:
    return st;
}

static bool is_there(const cln_plan_desc *d, const sizes *s, cln_when when)
{
    switch (when) {
    case CLN_WHEN_ALWAYS:
        return true;
    case CLN_WHEN_TRAINING:
        return d->training;
    case CLN_WHEN_MEASURED:
        return d->training && cln_pipeline_measures(&d->pipeline->config) > 0;
    case CLN_WHEN_DISTILLING:
        return s->distil;
    case CLN_WHEN_SPLATTING:
        return d->pipeline->config.stage1 == CLN_STAGE1_SPLAT;
    case CLN_WHEN_SHARED:
        return d->pipeline->ranks > 1;
    case CLN_WHEN_INSTEAD:
        return false;
    }
    return true;
}

/* The most rows of a buffer of this kind. */
static double most_rows(const cln_plan_desc *d, const sizes *s, cln_per per)
{
    const int deepest = d->pipeline->deepest;
    const int depth = d->depth > 0 && d->depth < deepest ? d->depth : deepest;
    const double levels = deepest + 1;

    switch (per) {
    case CLN_PER_MODEL:
        return 1;
    case CLN_PER_LEAF:
    case CLN_PER_LEAF_P:
        return s->leaves;
    case CLN_PER_LEAF_START:
        return s->leaves + 1;
    case CLN_PER_CELL:
        return 1 << (3 * depth);
    case CLN_PER_VIEW:
        return d->scene->view_count;
    case CLN_PER_RAY:
        return s->rays;
    case CLN_PER_RAY_START:
        return s->rays + 1;
    case CLN_PER_ORIGIN:
        return fmax(s->rays * s->ray_rows + s->extra_rays, s->points);
    case CLN_PER_TARGET:
        return fmax(s->rays, s->points);
    case CLN_PER_INTERVAL:
        return s->rays * cln_pipeline_most_intervals(d->pipeline, depth);
    case CLN_PER_SAMPLE:
        return s->samples;
    case CLN_PER_SAMPLE_START:
        return s->samples + 1;
    case CLN_PER_SLICE:
        return s->slices;
    case CLN_PER_GRADIENT_P:
        return s->gradients;
    case CLN_PER_CHUNK:
        return CLN_SORT_PARTS * (d->pipeline->device->info.compute_units + 1) + 64;
    case CLN_PER_PLACE:
        return places_of(fmax(s->samples, s->entries), s->widest);
    case CLN_PER_BATCH_VIEW:
        return s->views;
    case CLN_PER_GRID:
        return s->views * levels;
    case CLN_PER_LIST:
        return s->views * levels * s->pixels;
    case CLN_PER_LIST_START:
        return s->views * levels * s->pixels + 1;
    case CLN_PER_RUN:
        return s->views * s->runs;
    case CLN_PER_RUN_START:
        return s->views * s->runs + 1;
    case CLN_PER_ENTRY:
        return s->entries;
    case CLN_PER_PADDED: /* checked when they are made */
        return 0;
    case CLN_PER_LINK:
        return is_linked(d) ? links_of(d, s->leaves) + 1 : 0;
    }
    return 0;
}

/* Bytes of the longest row among buffers of this kind. */
static double longest_row(const cln_plan_desc *d, const sizes *s, cln_per per)
{
    double longest = 0;

    for (int id = 0; id < CLN_BUFFERS; id++)
        if (cln_buffer_rows[id].per == per && is_there(d, s, cln_buffer_rows[id].when))
            longest = fmax(longest, bytes_of(d, (cln_buffer_id)id));
    return longest;
}

/* Most slices of n samples: one for each leaf that has any, and one for every `slice` samples; and
 * one for each leaf of other ranks, wherever samples are (halo.h). */
static double slices_of(const cln_plan_desc *d, double n, double leaves)
{
    const double own = fmin(n, own_leaves(d, leaves)), far = far_leaves(d, leaves);

    return fmin(own + far, sliced_leaves(d, leaves)) + floor(n / d->pipeline->tune.sl);
}

/* The inverse: samples that make at most `most` slices. */
static double samples_of(const cln_plan_desc *d, double most, double leaves)
{
    const double slice = d->pipeline->tune.sl, left = most - far_leaves(d, leaves);
    const double own = own_leaves(d, leaves);
    double n = floor(left / (1 + 1 / slice)); /* every sample in a leaf of its own */

    if (left > own)
        n = fmax(n, (left - own) * slice);
    return fmax(n, (most - sliced_leaves(d, leaves)) * slice);
}

/* The most intervals of a ray in the deepest tree. */
static double most_intervals(const cln_plan_desc *d)
{
    return cln_pipeline_most_intervals(d->pipeline, d->pipeline->deepest);
}

/* Samples of so many batches, or as many that each of their buffers fits `largest`; at least those
 * of the smallest batch, so that the check finds the buffer that does not fit. */
static double fit_samples(const cln_plan_desc *d, const sizes *s, int batches, double largest)
{
    const cln_config *c = &d->pipeline->config;
    const double slice = d->pipeline->tune.sl;
    double least = most_intervals(d) * c->samples_per_leaf;
    const double wanted = (double)batches * c->batch_samples;
    double room = 0;

    if (d->training)
        least += cln_pipeline_extra_samples(d->pipeline);
    if (s->distil)
        least = fmax(least, c->distil_samples);
    room = floor((largest - 2048) / longest_row(d, s, CLN_PER_SAMPLE));
    if (d->training) { /* for gradients: the inverse of cln_pipeline_gradients() */
        const double gradients =
            s->split ? CLN_PARTS * s->part_slices : floor(largest / BYTES(d, grads));

        room = fmin(room, d->pipeline->tune.leaf ? fmax(slice, gradients * floor(slice / 2))
                                                 : samples_of(d, gradients, s->leaves));
    }
    return fmax(fmin(wanted, room), least);
}

static double fit_rays(const cln_plan_desc *d, double largest)
{
    const int wanted = d->training ? cln_config_most_rays(&d->pipeline->config) : 0;
    const double rays = wanted > CLN_RENDER_RAYS ? wanted : CLN_RENDER_RAYS;
    const double each = most_intervals(d);
    const double room = floor(largest / (each * BYTES(d, intervals)));

    return fmax(16,
                fmin(rays, fmin(room, floor(UINT32_MAX / each)))); /* kernels count in 32 bits */
}

static sizes find_sizes(const cln_plan_desc *d, int batches)
{
    const cln_pipeline *p = d->pipeline;
    const cln_config *c = &p->config;
    const double largest = (double)p->device->max_alloc;
    const double cells = (double)c->n1 * c->n1 * c->n1;
    sizes s = {.leaves = d->leaves,
               .part_leaves = cln_pipeline_part_leaves(p),
               .part_slices = cln_pipeline_part_slices(p),
               .split = cln_pipeline_in_parts(p, d->leaves),
               .ray_rows = cln_pipeline_rows(p),
               .extra_rays = d->training ? cln_pipeline_extra_rays(p) : 0,
               .views = d->training ? c->views_per_batch : 1,
               .pixels = pixels_of(d->view_pixels, d->scene),
               .runs = ceil(d->leaves * cells / CLN_SPLAT_RUN),
               .widest = 1 << p->tune.db,
               .distil = d->training && cln_config_merges(c)};

    s.samples = fit_samples(d, &s, batches, largest);
    s.rays = fit_rays(d, largest);
    s.slices = slices_of(d, s.samples, s.leaves);
    s.gradients = cln_pipeline_gradients(&p->tune, s.samples, s.slices);
    if (s.distil) { /* nets trained together, limited by samples and by points */
        const double pool = (double)CLN_DISTIL_BATCHES * c->distil_samples;
        const double nets =
            fmin(floor(s.samples / c->distil_samples), floor(largest / (BYTES(d, targets) * pool)));

        s.points = fmax(1, fmin(64, nets)) * pool;
    }
    return s;
}

/* A change of the tree has an array twice: this rank's weights, or densities of all leaves. */
static void find_successor(const cln_plan_desc *d, const sizes *s, double *rows, double *bytes)
{
    const double weights = BYTES(d, params), densities = BYTES(d, density);

    *rows = own_leaves(d, s->leaves);
    *bytes = weights;
    if (s->leaves * densities > *rows * weights) {
        *rows = s->leaves;
        *bytes = densities;
    }
}

/* It frees some arrays before, and pictures, which have densities of their own, free theirs. Counts
 * of the successor, added last, only what is more than these. */
static void share_successor(const cln_plan_desc *d, const sizes *s, double bytes, cln_plan *out)
{
    const double freed = s->gradients * BYTES(d, grads) + s->leaves * BYTES(d, seen) +
                         own_leaves(d, s->leaves) * BYTES(d, transposed);
    const double counted = fmax(bytes - freed, s->leaves * BYTES(d, picture_density));

    out->rows[out->count - 1].bytes += fmin(counted, bytes) - bytes;
    out->total += fmin(counted, bytes) - bytes;
}

/* Adds the rows of all planned buffers, in the order of their purposes. */
static void add_buffers(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    static const struct {
        const char *name, *ways_out[2]; /* rendering, training */
    } purposes[CLN_PURPOSES] = {
#define X(purpose, name, training, rendering) {name, {rendering, training}},
        CLN_PURPOSE_LIST(X)
#undef X
    };

    for (int purpose = 0; purpose < CLN_PURPOSES; purpose++) {
        bool begun = false;

        for (int id = 0; id < CLN_BUFFERS; id++) {
            const cln_buffer_row *buffer = &cln_buffer_rows[id];
            const bool own = buffer->per != CLN_PER_MODEL &&
                             (purpose == CLN_FOR_WEIGHTS || purpose == CLN_FOR_OPTIMISER);
            const double all = most_rows(d, s, buffer->per);
            double rows = own ? own_leaves(d, s->leaves) : all;
            double bytes = bytes_of(d, (cln_buffer_id)id);

            if ((int)buffer->purpose != purpose || !is_there(d, s, buffer->when))
                continue;
            if (!begun)
                row(out, purposes[purpose].name, lower(d, purposes[purpose].ways_out[d->training]));
            begun = true;
            if (id == CLN_BUFFER_successor)
                find_successor(d, s, &rows, &bytes);
            if (buffer->per == CLN_PER_LEAF_P)
                add_parts(out, rows, s->part_leaves, bytes);
            else if (buffer->per == CLN_PER_GRADIENT_P && s->split)
                add_parts(out, rows, s->part_slices, bytes);
            else
                for (int i = 0; i < buffer->count; i++)
                    add(out, rows * bytes);
            if (id == CLN_BUFFER_successor)
                share_successor(d, s, rows * bytes, out);
        }
        if (purpose == CLN_FOR_TREE) /* empty buffers and parts have 16 bytes */
            add(out, 16.0 * CLN_PARTS * CLN_BUFFERS);
    }
}

/* ---- the host ---- */

static bool is_unified(const cln_plan_desc *d)
{
    return d->pipeline->device->unified;
}

/* Bytes per pixel of an evaluated view: render, depth, opacity, truth, rounded, SSIM, PNG. */
static const double picture_bytes = 64;

/* Of a frame that is written while the next one is rendered: colour, depth, opacity, normals, a
 * file. */
static const double written_bytes = 40;

/* The most groups of leaves that merge at once. Those of a single leaf only do where that costs
 * less than the leaf (integer_program.c). */
static double most_merges(const cln_config *config, double leaves)
{
    return config->merge_factor < 1 ? leaves : floor(leaves / 2);
}

/* Adds the host's rows, without the memory of a device that is a CPU. */
static void add_host(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const cln_config *c = &d->pipeline->config;
    const double densities = s->leaves * BYTES(d, density), params = s->leaves * BYTES(d, params);
    const double hard = cln_hard_memory();

    out->limit = c->host_mem > 0 ? fmin(c->host_mem, hard) : cln_shared_memory(cln_ranks_here());
    out->hard = out->limit == hard;
    row(out, "program and driver", NULL);
    add(out, CLN_PROGRAM_BYTES);
    row(out, CLN_PLAN_IMAGES, "the size with --downscale, or the number of views");
    add(out, d->photos > 0 ? d->photos : cln_scene_pixel_bytes(d->scene));
    row(out, "model", lower(d, CLN_LOWER_LEAVES));
    add(out, params);
    if (d->training) {
        add(out, s->leaves * (BYTES(d, adam_m) + BYTES(d, adam_v)));
        add(out, densities);
        row(out, "changes of the tree", lower(d, CLN_LOWER_LEAVES));
        add(out, fmin(s->leaves, CLN_CARRY_ROWS) * 2 * BYTES(d, params)); /* folded together */
        if (s->distil) { /* a target of each point; origin and direction of those in use */
            const double pool = (double)CLN_DISTIL_BATCHES * c->distil_samples;
            const double all = most_merges(c, s->leaves) * pool;

            add(out, all * BYTES(d, targets));
            add(out, fmin(all, CLN_TRAINING_BATCHES * s->points) * 2 * BYTES(d, targets));
        }
        if (c->regrow > 0) /* an error and a depth of each ray, a mark of it in a list that grows */
            add(out, (8 + 3.0 * 8) * fmin(cln_scene_training_pixels(d->scene), CLN_LOOK_RAYS));
        row(out, "coverage of the images", "the number of views");
        add(out, d->coverage_bytes);
    }
    if (d->pipeline->ranks > 1) {
        const double links = d->training ? 2 * links_of(d, s->leaves) * BYTES(d, halo_rows) : 0;
        const double samples = s->samples * fmax(BYTES(d, packed), BYTES(d, walked));

        row(out, "messages to other ranks", lower(d, CLN_LOWER_LEAVES));
        add(out, fmax(links, fmax(densities, samples)));
        if (d->training) /* an array of the leaves that move, as they were and as they will be */
            add(out, 2.0 * cln_share_most(d->pipeline, (int)s->leaves) * BYTES(d, params));
    }
    row(out, CLN_PLAN_PICTURES,
        d->training ? "--rays or the size with --downscale" : "the size of the pictures");
    add(out, (d->training ? 80.0 * cln_config_most_rays(c) : 0) + 80.0 * CLN_RENDER_RAYS);
    add(out, (picture_bytes + (d->training ? 0 : written_bytes)) *
                 pixels_of(d->picture_pixels, d->scene));
}

/* ---- what is left ---- */

/* The most that the device's plan may have: its limit, of a CPU also what the host's leaves. */
static double most_bytes(const cln_plan_desc *d, const sizes *s, double limit)
{
    cln_plan host = {.count = 0};

    if (!is_unified(d))
        return limit;
    add_host(d, s, &host);
    return fmin(limit, host.limit - host.total);
}

/* The number of projected samples that fits half of what is left. `out`: the device's plan without
 * them. */
static double fit_entries(const cln_plan_desc *d, const sizes *s, const cln_plan *out)
{
    const double table = BYTES(d, digit_counts) / CLN_SORT_PER_DIGIT; /* bytes an entry */
    const double each = 2 * (BYTES(d, keys64) + BYTES(d, values64)) + BYTES(d, list_t) +
                        BYTES(d, list_sigma) + table;
    const double most =
        ((double)d->pipeline->device->max_alloc - 2048) / fmax(BYTES(d, keys64), table);
    const double room = most_bytes(d, s, out->limit) - out->total;
    const double entries = (0.5 * room - BYTES(d, digit_counts) * places_of(0, s->widest)) / each;

    return floor(fmax(1, fmin(fmin(entries, most), 1u << 28)));
}

/* With so many batches' samples. Returns whether it is within the limits. */
static bool plan_batches(const cln_plan_desc *d, int batches, cln_plan *out)
{
    const cln_config *c = &d->pipeline->config;
    sizes s = find_sizes(d, batches);
    const double memory = d->pipeline->device->info.global_mem;
    cln_plan plan = {.rendering = !d->training,
                     .limit = c->device_mem > 0
                                  ? fmin(c->device_mem, memory)
                                  : 0.9 * memory / (is_unified(d) ? cln_ranks_here() : 1),
                     .cells = s.leaves * BYTES(d, seen), /* a byte each */
                     .max_rays = (int)s.rays,
                     .max_samples = (size_t)s.samples};

    plan.batch_samples = (size_t)fmin(c->batch_samples, d->training ? 0.75 * s.samples : s.samples);
    plan.distil_nets = s.distil ? (int)(s.points / CLN_DISTIL_BATCHES / c->distil_samples) : 0;
    *out = plan;
    add_buffers(d, &s, out);
    if (c->stage1 == CLN_STAGE1_SPLAT) {
        plan.max_entries = (size_t)(s.entries = fit_entries(d, &s, out));
        *out = plan;
        add_buffers(d, &s, out);
    }
    return out->total <= most_bytes(d, &s, out->limit);
}

/* Is the host's plan, with this one of the device, within its limit? */
static bool host_fits(const cln_plan_desc *d, const cln_plan *device_plan)
{
    const sizes s = find_sizes(d, 1);
    cln_plan host = {.count = 0};

    add_host(d, &s, &host);
    return host.total + (is_unified(d) ? device_plan->total : 0) <= host.limit;
}

/* Finds half of --batch-samples, and so on, by which the training is within the limits, the host's,
 * too; if there is none, with half of --rays, and so on; if there is none, either, what the
 * smallest takes. of_host: `out` is the host's plan. */
static void fit_batch(const cln_plan_desc *d, bool of_host, cln_plan *out)
{
    cln_pipeline smaller = *d->pipeline;
    cln_config *c = &smaller.config;
    cln_plan_desc desc = *d;
    cln_plan plan;

    desc.pipeline = &smaller;
    for (; c->rays >= CLN_LEAST_RAYS; c->rays /= 2)
        for (c->batch_samples = d->pipeline->config.batch_samples / 2;
             c->batch_samples >= CLN_LEAST_BATCH; c->batch_samples /= 2)
            if (plan_batches(&desc, CLN_TRAINING_BATCHES, &plan) && host_fits(&desc, &plan)) {
                out->fitting_samples = c->batch_samples;
                out->fitting_rays = c->rays < d->pipeline->config.rays ? c->rays : 0;
                return;
            }
    c->rays = larger(1, fmin(d->pipeline->config.rays, CLN_LEAST_RAYS));
    c->batch_samples = (int)fmin(d->pipeline->config.batch_samples, CLN_LEAST_BATCH);
    (void)plan_batches(&desc, CLN_TRAINING_BATCHES, &plan);
    if (of_host) {
        const sizes s = find_sizes(&desc, 1);
        cln_plan host = {.count = 0};

        add_host(&desc, &s, &host);
        if (is_unified(d)) {
            row(&host, CLN_PLAN_SHARED, NULL);
            add(&host, plan.total);
        }
        plan = host;
    }
    if (plan.total <= plan.limit) {
        out->fitting_samples = c->batch_samples;
        out->fitting_rays = c->rays < d->pipeline->config.rays ? c->rays : 0;
        return;
    }
    out->least = plan.total;
    out->least_fixed = of_host ? plan.rows[0].bytes : 0;
}

/* Pictures take more samples at a time where there is room: that is faster, and changes nothing
 * else. */
void cln_plan_device(const cln_plan_desc *d, cln_plan *out)
{
    int batches = d->training ? CLN_TRAINING_BATCHES : CLN_RENDER_BATCHES;

    while (!plan_batches(d, batches, out) && !d->training && batches > 1)
        batches /= 2;
    if (d->training && out->total > out->limit)
        fit_batch(d, false, out);
}

cln_deal cln_plan_any_deal(const cln_plan_desc *d, int own)
{
    const int far = is_linked(d) ? most_far(d->leaves, own) : 0;
    const int sliced = own < d->leaves - far ? own + far : d->leaves;

    return (cln_deal){own, far, sliced, most_links(d->pipeline, far)};
}

static bool fits_with(const cln_plan_desc *d, int own)
{
    const cln_deal *now = d->deal;
    cln_deal deal = *now;
    cln_plan_desc moved = *d;
    cln_plan plan, host;

    if (own > now->own) { /* moves need not change the ranks that have most of the rest */
        deal = cln_plan_any_deal(d, own);
        deal.far = larger(deal.far, now->far);
        deal.sliced = larger(deal.sliced, now->sliced);
        deal.links = more_links(deal.links, now->links);
    }
    moved.deal = &deal;
    cln_plan_device(&moved, &plan);
    cln_plan_host(&moved, &plan, &host);
    return cln_plan_fits(d->pipeline->device, &plan, &host);
}

int cln_plan_most_own(const cln_plan_desc *d)
{
    int low = d->deal->own, high = cln_share_most(d->pipeline, d->leaves);

    if (high <= low || fits_with(d, high))
        return high > low ? high : low;
    if (!fits_with(d, low))
        return 0;
    while (high - low > 1) {
        const int middle = low + (high - low) / 2;

        *(fits_with(d, middle) ? &low : &high) = middle;
    }
    return low;
}

void cln_plan_apply(const cln_plan *plan, cln_pipeline *p)
{
    p->device->limit = (size_t)plan->limit;
    p->max_rays = plan->max_rays;
    p->max_samples = plan->max_samples;
    p->max_entries = plan->max_entries;
}

void cln_plan_host(const cln_plan_desc *d, const cln_plan *device_plan, cln_plan *out)
{
    const sizes s = find_sizes(d, 1); /* what the host keeps does not depend on it */

    memset(out, 0, sizeof *out);
    add_host(d, &s, out);
    if (is_unified(d)) {
        row(out, CLN_PLAN_SHARED, device_plan->rows[largest_row(device_plan)].way_out);
        add(out, device_plan->total);
    }
    if (d->training && out->total > out->limit)
        fit_batch(d, true, out);
}

/* ---- both ---- */

void cln_plan_text(const cln_plan *plan, char *out, size_t bytes)
{
    size_t used = 0;
    char amount[32], limit[32];

    for (int i = 0; i < plan->count && used < bytes; i++) {
        cln_format_bytes(plan->rows[i].bytes, amount);
        used += (size_t)snprintf(out + used, bytes - used, "%s%s %s", i ? ", " : "",
                                 plan->rows[i].purpose, amount);
        if (plan->rows[i].parts > 1 && used < bytes)
            used += (size_t)snprintf(out + used, bytes - used, " in %d parts", plan->rows[i].parts);
    }
    cln_format_bytes(plan->total, amount);
    cln_format_bytes(plan->limit, limit);
    if (used < bytes)
        snprintf(out + used, bytes - used, " = %s of %s", amount, limit);
}

/* No more cells of stage 1 can be counted. */
static const double COUNTABLE = 4294967296.0;

bool cln_plan_fits(const cln_device *device, const cln_plan *plan, const cln_plan *host)
{
    for (int i = 0; i < plan->count; i++)
        if (plan->rows[i].largest > (double)device->max_alloc)
            return false;
    return plan->total <= plan->limit && plan->cells < COUNTABLE && host->total <= host->limit;
}

/* CLN_MEMORY with the plan if it exceeds its limit, which `option` sets. */
static cln_status check_total(const cln_plan *plan, const char *whose, const char *option)
{
    char text[1024], least[32], way_out[160] = "", raise[96];

    cln_plan_text(plan, text, sizeof text);
    if (plan->total <= plan->limit)
        return CLN_OK;
    cln_format_bytes(plan->least, least);
    if (plan->hard)
        snprintf(raise, sizeof raise,
                 "raise what this process may have (ulimit -v and -d, or its "
                 "control group)");
    else
        snprintf(raise, sizeof raise, "raise %s", option);
    if (plan->fitting_rays > 0)
        snprintf(way_out, sizeof way_out, "give --rays %d --batch-samples %d, which fit, or ",
                 plan->fitting_rays, plan->fitting_samples);
    else if (plan->fitting_samples > 0)
        snprintf(way_out, sizeof way_out, "give --batch-samples %d, which fits, or ",
                 plan->fitting_samples);
    else if (plan->least > 0)
        snprintf(way_out, sizeof way_out, "even the smallest batch takes %s: %s", least,
                 plan->least_fixed < plan->limit ? "lower --max-leaves, --max-level or the photos' "
                                                   "size with --downscale, or "
                                                 : "");
    return cln_fail(CLN_MEMORY, "the plan needs more %s memory than there is: %s; %s%s", whose,
                    text, way_out, raise);
}

cln_status cln_plan_check_host(const cln_plan *plan)
{
    return check_total(plan, "host", "--host-mem");
}

cln_status cln_plan_check(const cln_device *device, const cln_plan *plan)
{
    cln_status st = CLN_OK;
    char text[1024], amount[32], largest[32], where[32];

    CLN_TRY(check_total(plan, "device", "--device-mem"));
    if (plan->cells >= COUNTABLE)
        CLN_TRY(cln_fail(CLN_MEMORY,
                         "%.3g stage-1 samples over all leaves are more than the 4.29e9 that can "
                         "be counted; lower --n1",
                         plan->cells));
    for (int i = 0; i < plan->count; i++) {
        if (plan->rows[i].largest <= (double)device->max_alloc)
            continue;
        cln_plan_text(plan, text, sizeof text);
        cln_format_bytes(plan->rows[i].largest, amount);
        cln_format_bytes((double)device->max_alloc, largest);
        if (plan->rows[i].parts > 1)
            snprintf(where, sizeof where, "each of %d parts", plan->rows[i].parts);
        else
            snprintf(where, sizeof where, "one buffer");
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: %s in %s, but %s allows only %s; lower %s (the plan: %s)",
                         plan->rows[i].purpose, amount, where, device->info.name, largest,
                         plan->rows[i].way_out, text));
    }
done:
    return st;
}

cln_status cln_plan_json(const cln_plan *plan, json_t **out)
{
    *out = json_object();
    for (int i = 0; *out && i < plan->count; i++)
        json_object_set_new(*out, plan->rows[i].purpose, cln_json_whole(plan->rows[i].bytes));
    if (*out) {
        json_object_set_new(*out, "total", cln_json_whole(plan->total));
        json_object_set_new(*out, "limit", cln_json_whole(plan->limit));
    }
    return *out ? CLN_OK : cln_fail(CLN_MEMORY, "memory plan: cannot make JSON");
}
