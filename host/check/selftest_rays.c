/* Checks the way from pixels to samples: scan, sort, rays, intervals, samples. Reference: plain
 * loops, scene/camera.c and reference/rays.c. */
#include "check/selftest_checks.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "check/forward_scene.h"
#include "pipeline/stage1.h"

static uint32_t bits_of(uint32_t stream, uint32_t index)
{
    return (uint32_t)cln_check_uniform(stream, index, 0, 16777216);
}

cln_status cln_check_scan(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_device *device = c->p->device;
    const uint32_t chunk = (uint32_t)c->p->tune.chunk,
                   sizes[] = {0, 1, chunk - 1, 3 * chunk + 7, 6 * chunk + 40009};
    const uint32_t most = sizes[4];
    uint32_t *in = NULL, *out = NULL, total = 0, wrong = 0;
    cln_buffer from = {0}, to = {0};

    CLN_TRY(cln_alloc(&in, most, sizeof *in, "self-test"));
    CLN_TRY(cln_alloc(&out, most + 1, sizeof *out, "self-test"));
    for (uint32_t i = 0; i < most; i++)
        in[i] = bits_of(2, i);
    CLN_TRY(cln_check_put(device, &from, in, most * sizeof *in));
    for (int s = 0; s < 5; s++) {
        const uint32_t n = sizes[s];
        uint32_t sum = 0;

        CLN_TRY(cln_check_spoil(device, &to, (most + 1) * sizeof *out));
        CLN_TRY(cln_stage_scan(c->p, &from, &to, n, CLN_STAGE_OTHER, &total));
        CLN_TRY(cln_buffer_read(device, &to, 0, out, (n + 1) * sizeof *out));
        for (uint32_t i = 0; i <= n; i++) {
            wrong += out[i] != sum;
            sum += i < n ? in[i] : 0;
        }
        wrong += total != out[n];
    }
    cln_check_say(c, "scan", wrong == 0, "%u of %u sums wrong", wrong, most);
done:
    cln_buffer_free(device, &from);
    cln_buffer_free(device, &to);
    free(in);
    free(out);
    return st;
}

cln_status cln_check_sorted(const uint64_t *keys, const uint64_t *got, const uint32_t *values,
                            uint32_t n, uint32_t *wrong)
{
    cln_status st = CLN_OK;
    bool *seen = NULL;

    *wrong = 0;
    CLN_TRY(cln_alloc(&seen, n, sizeof *seen, "self-test"));
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t from = values[i];

        *wrong += from >= n || seen[from] || got[i] != keys[from];
        *wrong += i > 0 && (got[i] < got[i - 1] || (got[i] == got[i - 1] && from <= values[i - 1]));
        if (from < n)
            seen[from] = true;
    }
done:
    free(seen);
    return st;
}

/* The values are the keys' places before the sort. */
cln_status cln_check_sort_keys(cln_checks *c, const uint64_t *keys, uint32_t n, int bits, bool wide,
                               uint32_t *wrong)
{
    cln_status st = CLN_OK;
    cln_device *device = c->p->device;
    const size_t bytes = n * (wide ? sizeof(uint64_t) : sizeof(uint32_t));
    uint64_t *got = NULL;
    uint32_t *narrow = NULL, *values = NULL;
    cln_buffer key_buffers[2] = {{0}, {0}}, value_buffers[2] = {{0}, {0}};

    CLN_TRY(cln_alloc(&got, n, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&narrow, n, sizeof *narrow, "self-test"));
    CLN_TRY(cln_alloc(&values, n, sizeof *values, "self-test"));
    for (uint32_t i = 0; i < n; i++) {
        narrow[i] = (uint32_t)keys[i];
        values[i] = i;
    }
    CLN_TRY(cln_check_put(device, &key_buffers[0], wide ? (const void *)keys : narrow, bytes));
    CLN_TRY(cln_check_put(device, &value_buffers[0], values, n * sizeof *values));
    CLN_TRY(cln_stage_sort(c->p, key_buffers, value_buffers, n, bits, wide, CLN_STAGE_OTHER));
    CLN_TRY(cln_buffer_read(device, &key_buffers[0], 0, wide ? (void *)got : narrow, bytes));
    CLN_TRY(cln_buffer_read(device, &value_buffers[0], 0, values, n * sizeof *values));
    for (uint32_t i = 0; i < n && !wide; i++)
        got[i] = narrow[i];
    CLN_TRY(cln_check_sorted(keys, got, values, n, wrong));
done:
    for (int b = 0; b < 2; b++) {
        cln_buffer_free(device, &key_buffers[b]);
        cln_buffer_free(device, &value_buffers[b]);
    }
    free(got);
    free(narrow);
    free(values);
    return st;
}

cln_status cln_check_sort(cln_checks *c, bool wide)
{
    enum { VALUES = 97 };
    cln_status st = CLN_OK;
    /* 33333: enough for the sort of wide keys to skip bits that do not vary */
    const uint32_t n = c->tiny ? 331 : wide ? 33333 : 5003;
    uint64_t *keys = NULL;
    uint32_t wrong = 0;

    CLN_TRY(cln_alloc(&keys, n, sizeof *keys, "self-test"));
    for (uint32_t i = 0; i < n; i++)
        keys[i] = (uint64_t)(bits_of(3, i) % VALUES) * 0x9E3779B97F4A7C15ull >> (wide ? 12 : 40);
    CLN_TRY(cln_check_sort_keys(c, keys, n, wide ? 52 : 24, wide, &wrong));
    cln_check_say(c, wide ? "sort, 64 bit" : "sort, 32 bit", wrong == 0, "%u of %u places wrong",
                  wrong, n);
done:
    free(keys);
    return st;
}

/* ---- rays and samples ---- */

ref_way cln_check_way(const cln_octree *tree, const cln_config *config, const cln_sampling *s)
{
    return (ref_way){.tree = tree,
                     .rule = {.by_weight = config->allocate == CLN_ALLOCATE_WEIGHT,
                              .cdf_weight = config->cdf == CLN_CDF_WEIGHT,
                              .samples_per_leaf = config->samples_per_leaf,
                              .samples_per_ray = config->samples_per_ray,
                              .uniform_share = s->uniform_share,
                              .min_transmittance = s->min_transmittance,
                              .empty_weight = s->empty_weight,
                              .empty_share = s->empty_share},
                     .jitter = s->jitter,
                     .seed = s->seed,
                     .step = s->step,
                     .crop = s->crop};
}

enum { VIEWS = 3, SIDE = 40, STEP = 4, RAYS = VIEWS * (SIDE / STEP) * (SIDE / STEP) };

/* One camera inside the cube and two outside, or three that look into a forward space; distorted if
 * the kernels have lens code. */
static void make_cameras(const cln_pipeline *p, cln_camera cameras[VIEWS])
{
    const bool distorted = p->lenses != 0;
    static const double poses[VIEWS][12] = {
        {0.6, 0, 0.8, -0.3, 0, 1, 0, 0.21, -0.8, 0, 0.6, 0.37},
        {1, 0, 0, 0.1, 0, 1, 0, -0.2, 0, 0, 1, -3.1},
        {0, 0, -1, 2.7, 0, 1, 0, 0.3, 1, 0, 0, -0.1},
    };

    memset(cameras, 0, VIEWS * sizeof *cameras);
    for (int v = 0; v < VIEWS; v++) {
        cln_camera *k = &cameras[v];

        if (p->space.forward) { /* not the mean camera: its chords are whole numbers of cells */
            cln_check_forward_camera(v + 1, &p->space, SIDE, SIDE, k);
        } else {
            memcpy(k->c2w, poses[v], sizeof k->c2w);
            k->fx = 45 + v;
            k->fy = 46;
            k->cx = 0.5 * SIDE + 0.3;
            k->cy = 0.5 * SIDE - 0.2;
            k->width = k->height = SIDE;
        }
        k->k1 = distorted ? -0.08 : 0;
        k->k2 = distorted ? 0.02 : 0;
        k->p1 = distorted ? 1e-3 : 0;
        k->p2 = distorted ? -2e-3 : 0;
    }
}

/* The lines that a camera's ray consists of in the cube: one, or several in a shell space. */
static int lines_of(const cln_space *space, const cln_camera *camera, const cln_pixel *pixel,
                    cln_space_line lines[CLN_SPACE_LINES])
{
    double origin[3], direction[3];

    cln_camera_ray(camera, pixel->x + 0.5, pixel->y + 0.5, origin, direction);
    if (space->shell)
        return cln_space_lines(space, origin, direction, 0, lines);
    cln_space_ray_to_cube(space, origin, direction, lines->origin, lines->direction);
    lines->begin = -INFINITY;
    lines->end = INFINITY;
    return 1;
}

/* The same from the device's rows of rays. */
static int device_lines(const cln_pipeline *p, const float (*ray_o)[4], const float (*ray_d)[4],
                        int r, cln_space_line lines[CLN_SPACE_LINES])
{
    const int rows = cln_pipeline_rows(p);
    int count = 0;

    for (int row = rows > 1; row < rows; row++) {
        const float *o = ray_o[r * rows + row], *d = ray_d[r * rows + row];

        if (rows > 1 && !(o[3] < 1e30f))
            break;
        lines[count++] = (cln_space_line){{o[0], o[1], o[2]},
                                          {d[0], d[1], d[2]},
                                          rows > 1 ? (double)o[3] : -INFINITY,
                                          rows > 1 ? (double)d[3] : INFINITY};
    }
    return count;
}

static int line_intervals(const ref_way *way, const cln_space_line *line,
                          ref_interval out[REF_MOST_INTERVALS])
{
    const int n = ref_way_intervals(way, line->origin, line->direction, out);
    int kept = 0;

    for (int i = 0; i < n; i++) {
        const ref_interval v = {out[i].slot, fmax(out[i].t_in, line->begin),
                                fmin(out[i].t_out, line->end)};

        if (v.t_out - v.t_in > (double)CLN_MIN_CHORD)
            out[kept++] = v;
    }
    return kept;
}

/* Checks the middles of a ray's lines, and their ends. */
static cln_status check_lines(cln_checks *c, const cln_camera *cameras, const cln_pixel *pixels,
                              const float (*ray_o)[4], const float (*ray_d)[4], int rays)
{
    cln_status st = CLN_OK;
    float *got = NULL;
    double *want = NULL;
    size_t n = 0;

    CLN_TRY(cln_alloc(&got, RAYS * CLN_SPACE_LINES * 4, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, RAYS * CLN_SPACE_LINES * 4, sizeof *want, "self-test"));
    for (int r = 0; r < rays; r++) {
        cln_space_line host[CLN_SPACE_LINES], device[CLN_SPACE_LINES];
        const int count = lines_of(&c->p->space, &cameras[pixels[r].view], &pixels[r], host);
        const int found = device_lines(c->p, ray_o, ray_d, r, device);

        for (int k = 0; k < count; k++) {
            const double t = 0.5 * (host[k].begin + host[k].end);
            int at = 0;

            if (host[k].end - host[k].begin < 1e-4) /* too short to compare */
                continue;
            while (at + 1 < found && device[at + 1].begin <= t)
                at++;
            for (int a = 0; a < 3; a++, n++) {
                want[n] = host[k].origin[a] + t * host[k].direction[a];
                got[n] = (float)(device[at].origin[a] + t * device[at].direction[a]);
            }
            want[n] = host[k].end;
            got[n++] = (float)device[at].end;
        }
    }
    cln_check_compare(c, "lines of rays", got, want, n, 1e-12, 1e-5);
done:
    free(got);
    free(want);
    return st;
}

static cln_status check_directions(cln_checks *c, const cln_camera *cameras,
                                   const cln_pixel *pixels, const float (*ray_o)[4],
                                   const float (*ray_d)[4], int rays)
{
    cln_status st = CLN_OK;
    const int rows = cln_pipeline_rows(c->p);
    float *got = NULL;
    double *want = NULL, origin[3], direction[3];

    CLN_TRY(cln_alloc(&got, RAYS * 6, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, RAYS * 6, sizeof *want, "self-test"));
    for (int r = 0; r < rays; r++) {
        cln_camera_ray(&cameras[pixels[r].view], pixels[r].x + 0.5, pixels[r].y + 0.5, origin,
                       direction);
        cln_space_ray_to_cube(&c->p->space, origin, direction, want + 6 * r, want + 6 * r + 3);
        memcpy(got + 6 * r, ray_o[r * rows], 3 * sizeof(float));
        memcpy(got + 6 * r + 3, ray_d[r * rows], 3 * sizeof(float));
    }
    cln_check_compare(c, "rays", got, want, (size_t)rays * 6, 1e-12, 1e-5);
done:
    free(got);
    free(want);
    return st;
}

/* The device's results for the batch. */
typedef struct made {
    int rays;
    uint32_t used[RAYS], sample_starts[RAYS + 1], most; /* intervals of a ray */
    cln_interval *intervals;                            /* [most][rays] */
    cln_sample *samples;
    float chords[RAYS];
} made;

/* Checks the sums of chords per ray against brute force over the leaves, on the device's own
 * rays. */
static cln_status check_chords(cln_checks *c, const float (*ray_o)[4], const float (*ray_d)[4],
                               const made *m)
{
    cln_status st = CLN_OK;
    double *want = NULL;
    const ref_way way = {.tree = &c->model->tree, .crop = c->crop};
    ref_interval crossed[REF_MOST_INTERVALS];

    CLN_TRY(cln_alloc(&want, RAYS, sizeof *want, "self-test"));
    for (int r = 0; r < m->rays; r++) {
        cln_space_line lines[CLN_SPACE_LINES];
        const int found = device_lines(c->p, ray_o, ray_d, r, lines);

        for (int k = 0; k < found; k++) {
            const int count = line_intervals(&way, &lines[k], crossed);

            for (int i = 0; i < count; i++)
                want[r] += crossed[i].t_out - crossed[i].t_in;
        }
    }
    cln_check_compare(c, "intervals: chord of a ray", m->chords, want, (size_t)m->rays, 1e-10,
                      1e-4);
done:
    free(want);
    return st;
}

/* Checks that samples of an interval lie in its chord, ascending, and their deltas add up to it. */
static void check_samples(cln_checks *c, made *m)
{
    const uint32_t rows = (uint32_t)cln_pipeline_rows(c->p);
    double worst = 0;
    int wrong = 0, intervals = 0;

    for (int r = 0; r < m->rays; r++) {
        const cln_sample *s = m->samples + m->sample_starts[r];
        const cln_sample *end = m->samples + m->sample_starts[r + 1];

        for (uint32_t i = 0; i < m->used[r]; i++, intervals++) {
            const cln_interval v = m->intervals[i * (uint32_t)m->rays + (uint32_t)r];
            const uint32_t count = CLN_INTERVAL_SAMPLES(v.count);
            double sum = 0, chord = (double)v.t_out - v.t_in;
            float last = v.t_in;

            m->chords[r] += (float)chord;
            if (count < 1 || count > (uint32_t)(end - s)) {
                wrong++;
                break;
            }
            for (uint32_t k = 0; k < count; k++, s++) {
                wrong += !(s->t >= last && s->t <= v.t_out && s->delta >= 0 && s->slot == v.slot &&
                           s->ray / rows == (uint32_t)r);
                last = s->t;
                sum += s->delta;
            }
            worst = fmax(worst, fabs(sum - chord) / fmax(fabs((double)v.t_out), chord));
        }
        wrong += s != end;
    }
    cln_check_say(c, "samples: order", wrong == 0 && intervals > 0, "%d of %u misplaced", wrong,
                  m->sample_starts[m->rays]);
    cln_check_say(c, "samples: deltas add up to the chord", worst <= 1e-5 && intervals > 0,
                  "%.1f %% of the bound, %d intervals", 100 * worst / 1e-5, intervals);
}

/* A cell's density as put_densities() uploads it, bfloat16. */
static uint16_t density_bits(uint32_t cell)
{
    const float value = (float)pow(10, cln_check_uniform(14, cell, -2, 1));
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    return (uint16_t)(bits >> 16);
}

/* Compares where samples lie, and their deltas, with the reference, on the device's own rays; only
 * by gather, whose points need no other stage. Rays that float32 may decide differently are left
 * out. */
static cln_status check_places(cln_checks *c, const float (*ray_o)[4], const float (*ray_d)[4],
                               const cln_sampling *sampling, const made *m)
{
    cln_status st = CLN_OK;
    const cln_pipeline *p = c->p;
    const int n1 = p->config.n1, rows = (int)cln_pipeline_rows(p);
    const size_t cells = (size_t)(p->leaves * n1 * n1 * n1), all = m->sample_starts[m->rays];
    float *boxes = NULL, *cache = NULL, *got = NULL;
    double *want = NULL;
    ref_samples *ray = NULL;
    ref_way way = cln_check_way(&c->model->tree, &p->config, sampling);
    ref_gather_cache densities = {.n1 = n1};
    size_t used = 0;
    int close = 0, other = 0;

    if (p->config.stage1 != CLN_STAGE1_GATHER)
        return CLN_OK;
    CLN_TRY(cln_octree_boxes(&c->model->tree, &boxes));
    CLN_TRY(cln_alloc(&cache, cells, sizeof *cache, "self-test"));
    CLN_TRY(cln_alloc(&got, 2 * all, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, 2 * all, sizeof *want, "self-test"));
    CLN_TRY(cln_alloc(&ray, 1, sizeof *ray, "self-test"));
    for (size_t i = 0; i < cells; i++)
        cache[i] = ref_from_bf16(density_bits((uint32_t)i));
    densities.boxes = boxes;
    densities.cache = cache;
    way.points = ref_gather_points;
    way.user = &densities;
    way.lines = rows > 1;
    for (int r = 0; r < m->rays; r++) {
        const cln_sample *s = m->samples + m->sample_starts[r];
        const uint32_t count = m->sample_starts[r + 1] - m->sample_starts[r];

        ref_ray_samples(&way, r, ray_o[r * rows], ray_d[r * rows], ray);
        if (ray->close || (int)count != ray->n) {
            close += ray->close;
            other += !ray->close;
            continue;
        }
        for (uint32_t i = 0; i < count; i++, used++) {
            other += s[i].slot != ray->slot[i];
            got[used] = s[i].t;
            want[used] = ray->t[i];
            got[all + used] = s[i].delta;
            want[all + used] = ray->delta[i];
        }
    }
    cln_check_say(c, "samples: counts and leaves", other == 0 && close < m->rays / 2,
                  "%d rays or samples differ, %d of %d left out", other, close, m->rays);
    /* t to a few ulp of its size; a delta is a difference of such t */
    cln_check_compare(c, "samples: t", got, want, used, 1e-11, 1e-4);
    cln_check_compare(c, "samples: deltas", got + all, want + all, used, 1e-6, 1e-2);
done:
    free(boxes);
    free(cache);
    free(got);
    free(want);
    free(ray);
    return st;
}

static cln_status read_batch(cln_checks *c, uint32_t samples, made *m)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    size_t intervals = 0;

    m->most = (uint32_t)p->most_intervals;
    intervals = (size_t)m->rays * m->most;

    CLN_TRY(cln_alloc(&m->intervals, intervals, sizeof *m->intervals, "self-test"));
    CLN_TRY(cln_alloc(&m->samples, samples, sizeof *m->samples, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->used, 0, m->used, (size_t)m->rays * sizeof *m->used));
    CLN_TRY(cln_buffer_read(p->device, &p->sample_starts, 0, m->sample_starts,
                            (size_t)(m->rays + 1) * sizeof *m->sample_starts));
    CLN_TRY(cln_buffer_read(p->device, &p->intervals, 0, m->intervals,
                            intervals * sizeof *m->intervals));
    CLN_TRY(cln_buffer_read(p->device, &p->samples, 0, m->samples, samples * sizeof *m->samples));
done:
    return st;
}

static bool counts_agree(const made *m, uint32_t samples)
{
    bool agree = m->sample_starts[0] == 0 && m->sample_starts[m->rays] == samples;

    for (int r = 0; r < m->rays; r++)
        agree &= m->sample_starts[r] <= m->sample_starts[r + 1] && m->used[r] <= m->most;
    return agree;
}

/* Returns whether rounding cannot change a line's stage-1 points: they are clear of borders between
 * cells, and their number is clear, too. */
static bool line_is_steady(const cln_checks *c, const ref_way *way, const cln_space_line *line,
                           const float (*boxes)[4])
{
    const double margin = 3e-5, n1 = c->p->config.n1;
    ref_interval crossed[REF_MOST_INTERVALS];
    const int count = line_intervals(way, line, crossed);

    for (int i = 0; i < count; i++) {
        const float *box = boxes[crossed[i].slot];
        const double length = crossed[i].t_out - crossed[i].t_in, cells = length * n1 / box[3];
        const double points = fmax(1, ceil(cells));

        if (length < 10 * CLN_MIN_CHORD || fabs(cells - round(cells)) < margin)
            return false;
        for (int k = 0; k < (int)points; k++)
            for (int a = 0; a < 3; a++) {
                const double at =
                    line->origin[a] +
                    line->direction[a] * (crossed[i].t_in + (k + 0.5) * length / points);
                const double cell = (at - box[a]) * n1 / box[3];

                if (fabs(cell - round(cell)) < margin)
                    return false;
            }
    }
    return true;
}

/* Returns whether all lines of a camera's ray are steady. Else rounding decides which density
 * counts, and devices may differ. */
static bool is_steady(const cln_checks *c, const cln_camera *camera, const cln_pixel *pixel,
                      const float (*boxes)[4])
{
    const ref_way way = {.tree = &c->model->tree, .crop = c->crop};
    cln_space_line lines[CLN_SPACE_LINES];
    int count = 0;

    if (c->p->config.stage1 == CLN_STAGE1_SPLAT) /* reads no cells */
        return true;
    count = lines_of(&c->p->space, camera, pixel, lines);
    for (int k = 0; k < count; k++)
        if (!line_is_steady(c, &way, &lines[k], boxes))
            return false;
    return true;
}

/* Outputs the leaves that rays meet, and the numbers and places of their samples there. */
static cln_status put_out_batch(cln_checks *c, const cln_camera *cameras, const cln_pixel *pixels,
                                const made *m)
{
    cln_status st = CLN_OK;
    uint32_t *numbers = NULL, intervals = 0, samples = 0;
    float *ends = NULL, *places = NULL, (*boxes)[4] = NULL;
    int left_out = 0;

    for (int r = 0; r < m->rays; r++)
        intervals += m->used[r];
    CLN_TRY(cln_octree_boxes(&c->model->tree, (float **)&boxes));
    CLN_TRY(cln_alloc(&numbers, 2 * (size_t)intervals, sizeof *numbers, "self-test"));
    CLN_TRY(cln_alloc(&ends, 2 * (size_t)intervals, sizeof *ends, "self-test"));
    CLN_TRY(cln_alloc(&places, 2 * (size_t)m->sample_starts[m->rays], sizeof *places, "self-test"));
    intervals = 0;
    for (int r = 0; r < m->rays; r++) {
        if (!is_steady(c, &cameras[pixels[r].view], &pixels[r], (const float(*)[4])boxes)) {
            left_out++;
            continue;
        }
        for (uint32_t i = 0; i < m->used[r]; i++, intervals++) {
            const cln_interval v = m->intervals[i * (uint32_t)m->rays + (uint32_t)r];

            numbers[2 * intervals] = (uint32_t)v.slot;
            numbers[2 * intervals + 1] = v.count;
            ends[2 * intervals] = v.t_in;
            ends[2 * intervals + 1] = v.t_out;
        }
        for (uint32_t i = m->sample_starts[r]; i < m->sample_starts[r + 1]; i++, samples++) {
            places[2 * samples] = m->samples[i].t;
            places[2 * samples + 1] = m->samples[i].delta;
        }
    }
    /* a ray in a shell has several lines, which end at faces */
    cln_check_say(c, "rays clear of borders",
                  left_out <= 1 + m->rays / (c->p->space.shell ? 20 : 50), "all but %d of %d",
                  left_out, m->rays);
    cln_check_numbers(c, "intervals: leaves and samples", numbers, 2 * (size_t)intervals);
    cln_check_values(c, "intervals: ends", ends, 2 * (size_t)intervals, 1e-12, 1e-5);
    cln_check_values(c, "samples: places", places, 2 * (size_t)samples, 1e-10, 1e-4);
done:
    free(numbers);
    free(ends);
    free(places);
    free(boxes);
    return st;
}

/* Uploads densities that are the same on every device: computed ones may round to either of two
 * bfloat16 numbers, which moves samples. */
static cln_status put_densities(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int n1 = p->config.n1;
    const uint32_t cells = (uint32_t)(p->leaves * n1 * n1 * n1);
    uint16_t *density = NULL;

    CLN_TRY(cln_alloc(&density, cells, sizeof *density, "self-test"));
    for (uint32_t i = 0; i < cells; i++)
        density[i] = density_bits(i);
    CLN_TRY(cln_check_put(p->device, &p->density, density, cells * sizeof *density));
done:
    free(density);
    return st;
}

cln_status cln_check_rays(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    /* leaves no interval out, so that chords can be compared */
    const cln_sampling sampling = {.jitter = true,
                                   .uniform_share = 0.25f,
                                   .empty_share = 1,
                                   .seed = 3,
                                   .step = 1,
                                   .max_samples = 1 << 24,
                                   .crop = c->crop};
    cln_camera cameras[VIEWS];
    const cln_camera *pointers[VIEWS] = {&cameras[0], &cameras[1], &cameras[2]};
    cln_pixel *pixels = NULL;
    const int rays = c->tiny ? RAYS / 10 : RAYS;
    const size_t rows = (size_t)cln_pipeline_rows(p);
    float(*backgrounds)[4] = NULL, (*ray_o)[4] = NULL, (*ray_d)[4] = NULL;
    made *m = NULL;
    uint32_t samples = 0;
    int used = 0;

    CLN_TRY(cln_alloc(&m, 1, sizeof *m, "self-test"));
    CLN_TRY(cln_alloc(&pixels, RAYS, sizeof *pixels, "self-test"));
    CLN_TRY(cln_alloc(&backgrounds, RAYS, sizeof *backgrounds, "self-test"));
    CLN_TRY(cln_alloc(&ray_o, RAYS * rows, sizeof *ray_o, "self-test"));
    CLN_TRY(cln_alloc(&ray_d, RAYS * rows, sizeof *ray_d, "self-test"));
    make_cameras(p, cameras);
    m->rays = rays;
    for (int r = 0; r < rays; r++) {
        const cln_u32 row = SIDE / STEP, pixel = (cln_u32)(r * (RAYS / rays));
        const cln_u32 at = pixel % (row * row);

        pixels[r].view = pixel / (row * row);
        pixels[r].spot = cln_stage1_of(&p->config)->by_view ? pixels[r].view : 0;
        pixels[r].x = at % row * STEP + 1;
        pixels[r].y = at / row * STEP + 2;
    }
    CLN_TRY(cln_pipeline_cameras(p, pointers, VIEWS, &p->space));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_o, (size_t)rays * rows * sizeof *ray_o));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_d, (size_t)rays * rows * sizeof *ray_d));
    CLN_TRY(cln_pipeline_batch(p, pixels, rays, NULL, backgrounds[0]));
    CLN_TRY(cln_stage_rays(p, rays));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_o, 0, ray_o, (size_t)rays * rows * sizeof *ray_o));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_d, 0, ray_d, (size_t)rays * rows * sizeof *ray_d));
    CLN_TRY(check_directions(c, cameras, pixels, (const float(*)[4])ray_o, (const float(*)[4])ray_d,
                             rays));
    if (p->space.shell)
        CLN_TRY(check_lines(c, cameras, pixels, (const float(*)[4])ray_o, (const float(*)[4])ray_d,
                            rays));
    CLN_TRY(put_densities(c));
    CLN_TRY(cln_stage_sample(p, rays, &sampling, &used, &samples));
    CLN_TRY(read_batch(c, samples, m));
    if (!counts_agree(m, samples)) {
        cln_check_say(c, "intervals", false, "counts and starts of the rays do not agree");
        goto done;
    }
    check_samples(c, m);
    CLN_TRY(check_places(c, (const float(*)[4])ray_o, (const float(*)[4])ray_d, &sampling, m));
    CLN_TRY(put_out_batch(c, cameras, pixels, m));
    CLN_TRY(check_chords(c, (const float(*)[4])ray_o, (const float(*)[4])ray_d, m));
done:
    if (m) {
        free(m->intervals);
        free(m->samples);
    }
    free(m);
    free(pixels);
    free(backgrounds);
    free(ray_o);
    free(ray_d);
    return st;
}
