/* The memory plans. See plan.h; the device's rows are the buffers of stages.h, one add() each. */
#include "pipeline/plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "pipeline/carry.h"
#include "io/progress.h"

static const char *const per_leaf = "--start-level, --max-leaves, --width or --depth";

static void row(cln_plan *plan, const char *purpose, const char *way_out)
{
    CLN_ASSERT(plan->count < CLN_PLAN_ROWS);
    plan->rows[plan->count].purpose = purpose;
    plan->rows[plan->count].parts = 1;
    plan->rows[plan->count++].way_out = way_out;
}

/* One buffer of the newest row. */
static void add(cln_plan *plan, double bytes)
{
    const int i = plan->count - 1;

    plan->rows[i].bytes += bytes;
    plan->rows[i].largest = fmax(plan->rows[i].largest, bytes);
    plan->total += bytes;
}

/* An array of rows that may be split (stages.h): one buffer, or parts of `room` rows each; where CLN_PARTS do
 * not do, equal ones, so that the longest rows' are too large. */
static void add_rows(cln_plan *plan, double rows, double room, double row_bytes)
{
    const int i = plan->count - 1;
    const double parts = fmin(ceil(rows / room), CLN_PARTS);
    const double most = fmax(fmin(rows, room), ceil(rows / CLN_PARTS));

    plan->rows[i].bytes += rows * row_bytes;
    plan->rows[i].largest = fmax(plan->rows[i].largest, most * row_bytes);
    plan->rows[i].parts = (int)fmax(plan->rows[i].parts, parts);
    plan->total += rows * row_bytes;
}

/* The row to lower first. */
static int largest_row(const cln_plan *plan)
{
    int worst = -1;

    for (int i = 0; i < plan->count; i++)
        if (plan->rows[i].way_out && (worst < 0 || plan->rows[i].bytes > plan->rows[worst].bytes))
            worst = i;
    return worst;
}

/* ---- the device ---- */

/* Everything that the sizes of buffers are made of. */
typedef struct sizes {
    double leaves, cells, measures;
    double params, moments, acts;    /* bytes; moments: of each of the two */
    double part_leaves, part_slices; /* rows of a part */
    bool split, leaf;                /* into parts; tune.leaf */
    double rays, extra_rays, samples, slices, points;
    double widest, sums, slice; /* counts of a digit of the sort, bytes of a scan's sums */
    bool distil;
} sizes;

/* Intervals that a ray can have, at the deepest level. */
static double most_intervals(void)
{
    return 3.0 * (1 << CLN_MAX_LEVEL);
}

/* Bytes of a radix sort's digit counts for n elements (sort.c). */
static double digits(double n, double widest)
{
    return 4 * (n / CLN_SORT_PER_DIGIT + widest + 1);
}

/* Most slices that n samples make: one a leaf that has any, and one for every `slice` samples. */
static double slices_of(double n, double leaves, double slice)
{
    return fmin(n, leaves) + floor(n / slice);
}

/* The other way round: samples that make at most `most` slices. */
static double samples_of(double most, double leaves, double slice)
{
    const double spread = floor(most / (1 + 1 / slice)); /* every sample in a leaf of its own */

    return most > leaves ? fmax(spread, (most - leaves) * slice) : spread;
}

/* Samples of a batch whose every buffer fits `largest`; at least what the smallest batch needs, so that the
 * check finds the buffer that does not fit. */
static double fit_samples(const cln_plan_desc *d, const sizes *s, double largest)
{
    const cln_config *c = &d->pipeline->config;
    double per_sample = 16, least = most_intervals() * c->samples_per_leaf;
    double wanted = c->batch_samples, room = 0;

    if (d->training) {
        wanted *= 2;
        per_sample = fmax(per_sample, fmax(s->acts, 4 * s->measures));
        least += cln_pipeline_extra_samples(d->pipeline);
    }
    if (s->distil)
        least = fmax(least, c->distil_samples);
    room = floor((largest - 2048) / per_sample);
    if (d->training) { /* gradients, cln_pipeline_gradients() the other way round */
        const double gradients = s->split ? CLN_PARTS * s->part_slices : floor(largest / s->params);

        room = fmin(room, s->leaf ? fmax(s->slice, gradients * floor(s->slice / 2))
                                  : samples_of(gradients, s->leaves, s->slice));
    }
    return fmax(fmin(wanted, room), least);
}

static double fit_rays(const cln_plan_desc *d, double largest)
{
    const int wanted = d->training ? cln_config_most_rays(&d->pipeline->config) : 0;
    const double rays = wanted > CLN_RENDER_RAYS ? wanted : CLN_RENDER_RAYS;
    const double room = floor(largest / (most_intervals() * sizeof(cln_interval)));

    return fmax(16, fmin(rays, room));
}

static sizes find_sizes(const cln_plan_desc *d)
{
    const cln_pipeline *p = d->pipeline;
    const cln_config *c = &p->config;
    const double largest = (double)p->device->max_alloc;
    sizes s = {.leaves = d->leaves,
               .part_leaves = cln_pipeline_part_leaves(p),
               .part_slices = cln_pipeline_part_slices(p),
               .split = cln_pipeline_in_parts(p, d->leaves),
               .leaf = p->tune.leaf,
               .params = 4.0 * p->net.params,
               .moments = (double)cln_moment_bytes(c) * p->net.params,
               .acts = (double)cln_pipeline_act_bytes(&p->net, &p->tune),
               .cells = (double)c->n1 * c->n1 * c->n1,
               .measures = d->training ? cln_pipeline_measures(c) : 0,
               .extra_rays = d->training ? cln_pipeline_extra_rays(p) : 0,
               .widest = 1 << p->tune.db,
               .sums = 8.0 * CLN_SORT_PARTS * (p->device->info.compute_units + 1) + 512,
               .slice = p->tune.sl,
               .distil = d->training && c->adaptive && !c->tree_from[0]};

    s.samples = fit_samples(d, &s, largest);
    s.rays = fit_rays(d, largest);
    s.slices = slices_of(s.samples, s.leaves, s.slice);
    if (s.distil) { /* nets that are trained together, by samples and by points */
        const double pool = (double)CLN_DISTIL_BATCHES * c->distil_samples;
        const double nets =
            fmin(floor(s.samples / c->distil_samples), floor(largest / (16 * pool)));

        s.points = fmax(1, fmin(64, nets)) * pool;
    }
    return s;
}

static void add_networks(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const double n = s->leaves;
    double rows = 0;

    row(out, "network weights", per_leaf);
    add_rows(out, n, s->part_leaves, s->params);
    if (!d->training)
        return;
    row(out, "optimiser state", per_leaf);
    add_rows(out, n, s->part_leaves, s->moments);
    add_rows(out, n, s->part_leaves, s->moments);
    add_rows(out, n, s->part_leaves,
             s->leaf ? 0 : 4.0 * cln_pipeline_transposed(&d->pipeline->net));
    add(out, 4 * n); /* steps */
    add(out, 4 * n); /* norms */
    row(out, "weight gradients", "--batch-samples, --width or --depth");
    rows = cln_pipeline_gradients(&d->pipeline->tune, s->samples, s->slices);
    if (s->split)
        add_rows(out, rows, s->part_slices, s->params);
    else
        add(out, rows * s->params);
    row(out, "activations", "--batch-samples, --width or --depth");
    add(out, s->samples * s->acts);
    add(out, 16 * s->samples); /* gradients of heads, rows of the backward pass and their counts */
    add(out, 4 * s->samples);
    add(out, 4 * s->slices);
    if (s->measures > 0) {
        row(out, "measures", "--batch-samples, or --no-adaptive");
        add(out, n * 8 * CLN_MEASURES);
        add(out, 4 * n);
        add(out, s->samples * 4 * s->measures);
    }
}

static void add_samples(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const double n = s->samples;

    row(out, "samples", "--batch-samples or --samples-per-leaf");
    for (int i = 0; i < (d->training ? 3 : 2); i++)
        add(out, 16 * n); /* samples, out, dout */
    for (int i = 0; i < (s->distil ? 5 : 4); i++)
        add(out, 4 * n); /* keys and values twice, losses */
    add(out, 16 * s->slices);
    add(out, digits(n, s->widest));
    add(out, s->sums);
}

static void add_rays(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const double n = s->rays, all = fmax(n + s->extra_rays, s->points);

    row(out, "rays", d->training ? "--rays or --distil-samples" : "--width and --height");
    add(out, n * most_intervals() * sizeof(cln_interval));
    add(out, 16 * all); /* origins */
    add(out, 16 * all); /* directions */
    add(out, sizeof(cln_ray_result) * n);
    add(out, 16 * n); /* pixels */
    add(out, 16 * n); /* backgrounds */
    if (d->training)
        add(out, 16 * fmax(n, s->points)); /* targets */
    add(out, 4 * n);                       /* used */
    add(out, 4 * n + 4);                   /* counts, starts */
    add(out, 4 * n + 4);
}

static void add_tree(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    row(out, "stage-1 densities", "--n1, --start-level or --max-leaves");
    add_rows(out, s->leaves, s->part_leaves, 2 * s->cells);
    if (d->training) {
        add_rows(out, s->leaves, s->part_leaves, s->cells); /* seen */
        add(out, 8 * s->leaves);                            /* mean and peak */
    }
    if (d->training) { /* an array's successor, or the densities of pictures; never both */
        row(out, "changes of the tree", per_leaf);
        add_rows(out, s->leaves, s->part_leaves, fmax(fmax(s->params, s->moments), 2 * s->cells));
    }
    row(out, "tree and cameras", "--max-leaves");
    add(out, 16 * s->leaves);           /* boxes */
    add(out, 4 << (3 * CLN_MAX_LEVEL)); /* map */
    for (int i = 0; i < 4; i++)         /* begin, end, slice counts and starts */
        add(out, 4 * s->leaves + 4);
    add(out, (double)sizeof(cln_device_camera) * d->scene->view_count);
    add(out, 1024); /* buffers and parts of nothing have 16 bytes */
}

/* Pixels of the largest view. */
static double view_pixels(const cln_scene *scene)
{
    double most = 0;

    for (int i = 0; i < scene->view_count; i++)
        most = fmax(most, (double)scene->views[i].camera.width * scene->views[i].camera.height);
    return most;
}

/* ---- the host ---- */

static bool is_cpu(const cln_plan_desc *d)
{
    return strcmp(d->pipeline->device->info.type, "cpu") == 0;
}

/* Code, driver and the compiler of kernels inside it, as measured with PoCL 3.1, which has all three in this
 * process. */
static const double program_bytes = 300.0 * (1 << 20);

/* Per pixel of a view that is evaluated: render, depth, opacity, truth, rounded, SSIM, PNG. */
static const double picture_bytes = 64;

/* All but the device's memory where that is the host's. */
static void add_host(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const cln_config *c = &d->pipeline->config;
    const double densities = 2 * s->leaves * s->cells, params = s->leaves * s->params;
    double images = 0;

    out->limit = c->host_mem > 0 ? c->host_mem : cln_host_memory();
    for (int i = 0; i < d->scene->view_count; i++) {
        const cln_view *v = &d->scene->views[i];

        if (v->pixels)
            images += (double)v->camera.width * v->camera.height * v->channels;
    }
    row(out, "program and driver", NULL);
    add(out, program_bytes);
    row(out, "images", "the size with --downscale, or the number of views");
    add(out, images);
    row(out, "model", per_leaf);
    add(out, params);
    if (d->training) {
        add(out, 2 * s->leaves * s->moments);
        add(out, densities);
        row(out, "changes of the tree", per_leaf);
        add(out, fmin(s->leaves, CLN_CARRY_ROWS) * 2 * s->params); /* leaves folded at a time */
        if (s->distil) /* every eighth leaf may come from a merge */
            add(out, s->leaves / 8 * CLN_DISTIL_BATCHES * c->distil_samples * 48);
        row(out, "coverage of the images", "the number of views");
        add(out, d->coverage_bytes);
    }
    row(out, "batches and pictures", "--rays or the size with --downscale");
    add(out, (d->training ? 80.0 * cln_config_most_rays(c) : 0) + 80.0 * CLN_RENDER_RAYS);
    add(out, picture_bytes * view_pixels(d->scene));
}

/* ---- projected samples: what both leave ---- */

/* Lists of the batch's views at each level, and as many projected samples as half of the rest has room for;
 * padded lists are checked as they are made. */
static void add_splatting(const cln_plan_desc *d, const sizes *s, cln_plan *out)
{
    const cln_config *c = &d->pipeline->config;
    const double views = d->training ? c->views_per_batch : 1, levels = CLN_MAX_LEVEL + 1;
    const double runs = ceil(s->leaves * s->cells / 4096);
    const double scratch = 4.0 / CLN_SORT_PER_DIGIT; /* of the sort, bytes an element */
    double entries = 0, most = 0, room = 0;
    cln_plan host = {.count = 0};

    row(out, "lists of views", "--views-per-batch, --downscale or use --stage1 gather");
    add(out, 4 * (views * levels * view_pixels(d->scene) + 1));
    add(out, 4 * views * levels * view_pixels(d->scene));
    add(out, 20 * views * levels); /* grids, views */
    add(out, 4 * views * runs);
    add(out, 4 * views * runs + 4);
    most = ((double)d->pipeline->device->max_alloc - 2048) / fmax(8, scratch);
    room = out->limit - out->total;
    if (is_cpu(d)) {
        add_host(d, s, &host);
        room = fmin(room, host.limit - host.total - out->total);
    }
    entries = (0.5 * room - digits(0, s->widest)) / (32 + scratch);
    entries = fmax(1, fmin(fmin(entries, most), 1u << 28));
    out->max_entries = (size_t)entries;
    row(out, "projected samples", "--n1, or use --stage1 gather");
    for (int i = 0; i < 2; i++) {
        add(out, 8 * entries); /* keys */
        add(out, 4 * entries); /* values */
        add(out, 4 * entries); /* t, sigma */
    }
    add(out, digits(entries, s->widest));
    add(out, s->sums);
}

void cln_plan_device(const cln_plan_desc *d, cln_plan *out)
{
    const cln_config *c = &d->pipeline->config;
    const sizes s = find_sizes(d);
    const double memory = d->pipeline->device->info.global_mem;

    memset(out, 0, sizeof *out);
    out->limit = c->device_mem > 0 ? fmin(c->device_mem, memory) : 0.9 * memory;
    out->cells = s.leaves * s.cells;
    out->max_rays = (int)s.rays;
    out->max_samples = (size_t)s.samples;
    out->batch_samples = (size_t)fmin(c->batch_samples, d->training ? 0.75 * s.samples : s.samples);
    out->distil_nets = s.distil ? (int)(s.points / CLN_DISTIL_BATCHES / c->distil_samples) : 0;
    add_networks(d, &s, out);
    add_tree(d, &s, out);
    add_samples(d, &s, out);
    add_rays(d, &s, out);
    if (c->stage1 == CLN_STAGE1_SPLAT)
        add_splatting(d, &s, out);
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
    const sizes s = find_sizes(d);

    memset(out, 0, sizeof *out);
    add_host(d, &s, out);
    if (is_cpu(d)) {
        row(out, "the device's, a CPU", device_plan->rows[largest_row(device_plan)].way_out);
        add(out, device_plan->total);
    }
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

/* CLN_MEMORY with the plan if it is above its limit, which `option` gives. */
static cln_status check_total(const cln_plan *plan, const char *whose, const char *option)
{
    char text[1024];

    cln_plan_text(plan, text, sizeof text);
    if (plan->total <= plan->limit)
        return CLN_OK;
    return cln_fail(CLN_MEMORY,
                    "the plan needs more %s memory than there is: %s; lower %s, or raise %s", whose,
                    text, plan->rows[largest_row(plan)].way_out, option);
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
    if (plan->cells >= 4294967296.0)
        CLN_TRY(cln_fail(CLN_MEMORY,
                         "%.3g stage-1 samples over all leaves, 4.29e9 can be counted; lower --n1",
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
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: %s in %s, %s allows %s; lower %s (the plan: %s)",
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
        json_object_set_new(*out, plan->rows[i].purpose, json_real(plan->rows[i].bytes));
    if (*out) {
        json_object_set_new(*out, "total", json_real(plan->total));
        json_object_set_new(*out, "limit", json_real(plan->limit));
    }
    return *out ? CLN_OK : cln_fail(CLN_MEMORY, "memory plan: cannot make JSON");
}
