/* Rays, leaf intervals and samples (stage 1 by gather), cells that views see, and statistics of
 * leaves. Compares 400 rays: leaves and numbers of samples must be equal, positions close to
 * float64's. Skips rays on which rounding may change a decision of float32. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "bench_scene.h"

/* ---- the scene ---- */

/* A camera at `angle` around the vertical axis that looks at the middle. */
static cln_camera camera_of(double angle, bool distorted)
{
    const double s = sin(angle), c = cos(angle);
    cln_camera k = {.c2w = {c, 0, -s, 2.7 * s, 0, 1, 0, 0.13, s, 0, c, -2.7 * c},
                    .fx = 1.2 * SCENE_SIDE,
                    .fy = 1.21 * SCENE_SIDE,
                    .cx = 0.5 * SCENE_SIDE,
                    .cy = 0.5 * SCENE_SIDE,
                    .width = SCENE_SIDE,
                    .height = SCENE_SIDE};

    if (distorted) {
        k.k1 = -0.05;
        k.k2 = 0.01;
        k.p1 = 1e-3;
    }
    return k;
}

/* Empty, thin and thick cells. */
static void make_densities(cln_model *model)
{
    const int n1 = model->config.n1, cells = n1 * n1 * n1;

    for (int i = 0; i < model->tree.leaf_count * cells; i++) {
        const double u = cln_check_uniform(20, (uint32_t)i, 0, 1);
        const double leaf = cln_check_uniform(21, (uint32_t)(i / cells), 0, 1);
        const double most = leaf < 0.2 ? 2 : 0.3;

        model->density[i] =
            ref_to_bf16(u < 0.3 ? 0 : (float)pow(10, -3 + (u - 0.3) / 0.7 * (most + 3)));
    }
}

cln_status bench_scene_start(bench *b, const cln_config *config, bool distortion, int rays,
                             bench_scene *s)
{
    cln_status st = CLN_OK;
    const float white[4] = {1, 1, 1, 1};
    const cln_camera *list[SCENE_VIEWS];
    size_t cells = 0;

    s->rays = rays;
    CLN_TRY(bench_pipeline(b, config, distortion, NULL, &s->p));
    CLN_TRY(cln_model_create(config, &s->model));
    make_densities(&s->model);
    cells = (size_t)s->model.tree.leaf_count * (size_t)(config->n1 * config->n1 * config->n1);
    CLN_TRY(cln_alloc(&s->cache, cells, sizeof *s->cache, "bench"));
    for (size_t i = 0; i < cells; i++)
        s->cache[i] = ref_from_bf16(s->model.density[i]);
    CLN_TRY(cln_octree_boxes(&s->model.tree, &s->boxes));
    for (int v = 0; v < SCENE_VIEWS; v++) {
        s->cameras[v] = camera_of(1.6 * v + 0.2, distortion);
        list[v] = &s->cameras[v];
    }
    CLN_TRY(cln_alloc(&s->pixels, (size_t)rays, sizeof *s->pixels, "bench"));
    for (int r = 0; r < rays; r++) {
        const uint32_t v = (uint32_t)((int64_t)r * SCENE_VIEWS / rays);
        const int64_t first = ((int64_t)v * rays + SCENE_VIEWS - 1) / SCENE_VIEWS;

        s->pixels[r] = (cln_pixel){.view = v, .spot = v};
        s->pixels[r].x = (cln_u32)cln_check_uniform(22, (uint32_t)r, 0, SCENE_SIDE);
        s->pixels[r].y = (cln_u32)((r - first) * SCENE_SIDE * SCENE_VIEWS / (rays + SCENE_VIEWS));
    }
    CLN_TRY(cln_pipeline_rebuild(s->p, s->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(s->p, &s->model, false));
    CLN_TRY(cln_pipeline_cameras(s->p, list, SCENE_VIEWS, &cln_space_unit));
    s->p->training_views = SCENE_VIEWS;
    CLN_TRY(cln_pipeline_batch(s->p, s->pixels, rays, NULL, white));
    CLN_TRY(cln_stage_rays(s->p, rays));
done:
    return st;
}

void bench_scene_free(bench_scene *s)
{
    cln_model_free(&s->model);
    free(s->pixels);
    free(s->cache);
    free(s->boxes);
}

/* ---- rays, intervals, samples ---- */

enum { RAYS_PART, INTERVALS_PART, SAMPLES_PART };
static const bench_part parts[] = {
    {"rays_make", "rays_make"},
    {"intervals_fill", "intervals_fill scan_sums scan_write"},
    {"samples_emit", "samples_emit"},
};

static const struct {
    int rays, level;
    bool distortion;
} shapes[] = {{1, 2, false},    {64, 2, false},    {2048, 3, false},
              {16384, 3, true}, {65536, 4, false}, {262144, 3, false}};

static const cln_sampling sampling = {.jitter = true,
                                      .min_transmittance = 1e-3f,
                                      .uniform_share = 0.25f,
                                      .empty_weight = 1e-3f,
                                      .empty_share = 0.25f,
                                      .seed = 5,
                                      .step = 3,
                                      .max_samples = (size_t)1 << 28};

typedef struct run {
    bench_scene scene;
    uint32_t samples;
    double intervals;
} run;

static cln_status rays_body(void *context)
{
    const run *r = context;

    return cln_stage_rays(r->scene.p, r->scene.rays);
}

static cln_status sample_body(void *context)
{
    run *r = context;
    int used = 0;

    return cln_stage_sample(r->scene.p, r->scene.rays, &sampling, &used, &r->samples);
}

enum { COMPARED = 400 };

/* The k-th compared ray. */
static int ray_of(const run *r, int k)
{
    const int count = r->scene.rays < COMPARED ? r->scene.rays : COMPARED;

    return (int)((int64_t)k * r->scene.rays / count);
}

static cln_status read_rays(const run *r, float (**o)[4], float (**d)[4])
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)r->scene.rays;

    CLN_TRY(cln_alloc(o, n, sizeof **o, "bench"));
    CLN_TRY(cln_alloc(d, n, sizeof **d, "bench"));
    CLN_TRY(cln_buffer_read(r->scene.p->device, &r->scene.p->ray_o, 0, *o, n * sizeof **o));
    CLN_TRY(cln_buffer_read(r->scene.p->device, &r->scene.p->ray_d, 0, *d, n * sizeof **d));
done:
    return st;
}

static void check_rays(const run *r, float (*o)[4], float (*d)[4], bench_errors *errors)
{
    const int count = r->scene.rays < COMPARED ? r->scene.rays : COMPARED;
    float got[COMPARED * 6];
    double want[COMPARED * 6];

    for (int k = 0; k < count; k++) {
        const int i = ray_of(r, k);
        const cln_pixel *pixel = &r->scene.pixels[i];

        cln_camera_ray(&r->scene.cameras[pixel->view], pixel->x + 0.5, pixel->y + 0.5, want + 6 * k,
                       want + 6 * k + 3);
        memcpy(got + 6 * k, o[i], 3 * sizeof(float));
        memcpy(got + 6 * k + 3, d[i], 3 * sizeof(float));
    }
    bench_compare(errors, got, want, (size_t)count * 6, 1e-12, 1e-5);
}

/* Compares leaves and numbers of samples into *counts, positions of samples into *places. */
static cln_status check_samples(const run *r, float (*o)[4], float (*d)[4], bench_errors *counts,
                                bench_errors *places)
{
    enum { MOST = 65536 };
    cln_status st = CLN_OK;
    const bench_scene *s = &r->scene;
    const int rays = s->rays < COMPARED ? s->rays : COMPARED;
    ref_gather_cache gather = {s->p->config.n1, s->boxes, s->cache};
    ref_way way = cln_check_way(&s->model.tree, &s->p->config, &sampling);
    uint32_t *starts = NULL;
    cln_sample *samples = NULL;
    ref_samples *ray = NULL;
    float *got = NULL;
    double *want = NULL;
    size_t n = 0, wrong = 0, compared = 0;

    way.points = ref_gather_points;
    way.user = &gather;
    CLN_TRY(cln_alloc(&starts, (size_t)s->rays + 1, sizeof *starts, "bench"));
    CLN_TRY(cln_alloc(&samples, r->samples, sizeof *samples, "bench"));
    CLN_TRY(cln_alloc(&ray, 1, sizeof *ray, "bench"));
    CLN_TRY(cln_alloc(&got, MOST, sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&want, MOST, sizeof *want, "bench"));
    CLN_TRY(cln_buffer_read(s->p->device, &s->p->sample_starts, 0, starts,
                            ((size_t)s->rays + 1) * sizeof *starts));
    CLN_TRY(
        cln_buffer_read(s->p->device, &s->p->samples, 0, samples, r->samples * sizeof *samples));
    for (int k = 0; k < rays; k++) {
        const int i = ray_of(r, k);
        const uint32_t count = starts[i + 1] - starts[i];

        ref_ray_samples(&way, i, o[i], d[i], ray);
        if (ray->close)
            continue;
        compared++;
        wrong += (int)count != ray->n;
        for (int j = 0; j < ray->n && (int)count == ray->n && n + 2 <= MOST; j++) {
            const cln_sample *sample = &samples[starts[i] + (uint32_t)j];

            wrong += sample->slot != ray->slot[j] || sample->ray != (cln_u32)i;
            got[n] = sample->t;
            want[n++] = ray->t[j];
        }
    }
    bench_equal(counts, wrong, compared);
    bench_compare(places, got, want, n, 1e-12, 2e-5);
    places->failed = places->failed || wrong > 0;
done:
    free(starts);
    free(samples);
    free(ray);
    free(got);
    free(want);
    return st;
}

static cln_status count_intervals(run *r)
{
    cln_status st = CLN_OK;
    uint32_t *used = NULL;

    CLN_TRY(cln_alloc(&used, (size_t)r->scene.rays, sizeof *used, "bench"));
    CLN_TRY(cln_buffer_read(r->scene.p->device, &r->scene.p->used, 0, used,
                            (size_t)r->scene.rays * sizeof *used));
    for (int i = 0; i < r->scene.rays; i++)
        r->intervals += used[i];
done:
    free(used);
    return st;
}

static cln_status run_rays(bench *b, int shape)
{
    cln_status st = CLN_OK;
    const double rays = shapes[shape].rays;
    bench_errors directions = {0}, counts = {0}, places = {0};
    float(*o)[4] = NULL, (*d)[4] = NULL;
    double cells = 0;
    run r = {0};
    cln_config config;

    CLN_TRY(bench_small_config(&config));
    config.start_level = shapes[shape].level;
    config.stage1 = CLN_STAGE1_GATHER;
    CLN_TRY(bench_scene_start(b, &config, shapes[shape].distortion, shapes[shape].rays, &r.scene));
    cells = (double)r.scene.p->leaves * config.n1 * config.n1 * config.n1;
    CLN_TRY(read_rays(&r, &o, &d));
    if (b->wanted[RAYS_PART]) {
        check_rays(&r, o, d, &directions);
        CLN_TRY(bench_add(b, RAYS_PART, rays_body, NULL, &r, CLN_STAGES, bench_work_rays(rays),
                          &directions));
    }
    if (!b->wanted[INTERVALS_PART] && !b->wanted[SAMPLES_PART])
        goto done;
    CLN_TRY(sample_body(&r));
    CLN_TRY(count_intervals(&r));
    cells = fmin(cells, r.intervals * config.n1); /* an interval visits at most n1 cells */
    CLN_TRY(check_samples(&r, o, d, &counts, &places));
    if (b->wanted[INTERVALS_PART])
        CLN_TRY(bench_add(b, INTERVALS_PART, sample_body, NULL, &r, CLN_STAGE_INTERVALS,
                          bench_work_intervals(rays, r.intervals, cells), &counts));
    if (b->wanted[SAMPLES_PART])
        CLN_TRY(bench_add(b, SAMPLES_PART, sample_body, NULL, &r, CLN_STAGE_SAMPLES,
                          bench_work_samples(rays, r.intervals, cells, r.samples), &places));
done:
    bench_scene_free(&r.scene);
    free(o);
    free(d);
    return st;
}

static void rays_text(int shape, char out[64])
{
    snprintf(out, 64, "%d rays %d leaves%s", shapes[shape].rays, 1 << (3 * shapes[shape].level),
             shapes[shape].distortion ? " distorted" : "");
}

const bench_family bench_rays = {"rays",    parts,   3, sizeof shapes / sizeof shapes[0],
                                 rays_text, run_rays};

/* ---- cells that views see, statistics of leaves ---- */

enum { SEEN_PART, STATS_PART };
static const bench_part stats_parts[] = {{"stats_seen", "stats_seen"},
                                         {"stats_leaf", "stats_leaf"}};
static const int stats_levels[] = {0, 2, 4};

typedef struct stats {
    bench_scene scene;
    float (*out)[2];
} stats;

static cln_status seen_body(void *context)
{
    const stats *s = context;

    return cln_stage_seen(s->scene.p);
}

static cln_status stats_body(void *context)
{
    const stats *s = context;

    return cln_stage_stats(s->scene.p, s->out[0]);
}

/* 1 or 0; -1 if rounding may decide. */
static int is_seen(const bench_scene *s, const double point[3])
{
    int seen = 0;

    for (int v = 0; v < SCENE_VIEWS && seen < 1; v++) {
        const double edge = 1e-2;
        double x = 0, y = 0, z = 0;

        if (!cln_camera_project(&s->cameras[v], point, &x, &y, &z))
            continue;
        if (x >= edge && y >= edge && x < SCENE_SIDE - edge && y < SCENE_SIDE - edge)
            seen = 1;
        else if (x >= -edge && y >= -edge && x < SCENE_SIDE + edge && y < SCENE_SIDE + edge)
            seen = -1;
    }
    return seen;
}

static cln_status check_stats(const stats *s, bench_errors *seen_errors, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const bench_scene *scene = &s->scene;
    const int n1 = scene->p->config.n1, cells = n1 * n1 * n1, leaves = scene->p->leaves;
    const int total = leaves * cells, step = 1 + total / 20000;
    size_t wrong = 0, compared = 0;
    uint8_t *seen = NULL;
    double *want = NULL;

    CLN_TRY(cln_alloc(&seen, (size_t)total, 1, "bench"));
    CLN_TRY(cln_alloc(&want, 2 * (size_t)leaves, sizeof *want, "bench"));
    CLN_TRY(cln_buffer_read(scene->p->device, &scene->p->seen, 0, seen, (size_t)total));
    for (int i = 0; i < total; i += step) {
        const float *box = scene->boxes + 4 * (i / cells);
        const int cell = i % cells, at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
        double point[3];
        int right = 0;

        for (int a = 0; a < 3; a++)
            point[a] = box[a] + (at[a] + 0.5) * box[3] / n1;
        right = is_seen(scene, point);
        compared += right >= 0;
        wrong += right >= 0 && seen[i] != right;
    }
    bench_equal(seen_errors, wrong, compared);
    for (int leaf = 0; leaf < leaves; leaf++) {
        double sum = 0, peak = 0, count = 0;

        for (int i = leaf * cells; i < (leaf + 1) * cells; i++) {
            sum += seen[i] ? scene->cache[i] : 0;
            peak = fmax(peak, seen[i] ? scene->cache[i] : 0);
            count += seen[i];
        }
        want[2 * leaf] = count > 0 ? sum / count : 0;
        want[2 * leaf + 1] = peak;
    }
    bench_compare(errors, s->out[0], want, 2 * (size_t)leaves, 1e-12, 1e-5);
done:
    free(seen);
    free(want);
    return st;
}

static cln_status run_stats(bench *b, int shape)
{
    cln_status st = CLN_OK;
    bench_errors seen_errors = {0}, errors = {0};
    double cells = 0;
    stats s = {0};
    cln_config config;

    CLN_TRY(bench_small_config(&config));
    config.start_level = stats_levels[shape];
    config.stage1 = CLN_STAGE1_GATHER;
    CLN_TRY(bench_scene_start(b, &config, false, 1, &s.scene));
    CLN_TRY(cln_alloc(&s.out, (size_t)s.scene.p->leaves, sizeof *s.out, "bench"));
    cells = (double)s.scene.p->leaves * config.n1 * config.n1 * config.n1;
    CLN_TRY(seen_body(&s));
    CLN_TRY(stats_body(&s));
    CLN_TRY(check_stats(&s, &seen_errors, &errors));
    if (b->wanted[SEEN_PART])
        CLN_TRY(bench_add(b, SEEN_PART, seen_body, NULL, &s, CLN_STAGES,
                          bench_work_seen(cells, SCENE_VIEWS), &seen_errors));
    if (b->wanted[STATS_PART])
        CLN_TRY(bench_add(b, STATS_PART, stats_body, NULL, &s, CLN_STAGES,
                          bench_work_stats(cells, s.scene.p->leaves), &errors));
done:
    bench_scene_free(&s.scene);
    free(s.out);
    return st;
}

static void stats_text(int shape, char out[64])
{
    snprintf(out, 64, "%d leaves", 1 << (3 * stats_levels[shape]));
}

const bench_family bench_stats = {
    "stats", stats_parts, 2, sizeof stats_levels / sizeof stats_levels[0], stats_text, run_stats};
