/* Stage 1 by splatting: projection and lists. Some cells are projected in float64: each must be on
 * its list at its distance, and lists must be sorted. Cells that rounding may move to the next list
 * are skipped. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "bench_scene.h"
#include "pipeline/splat.h"

enum { PROJECT_PART, LISTS_PART };
static const bench_part parts[] = {
    {"splat_emit", "splat_count splat_emit scan_sums scan_write"},
    {"splat_lists", "sort64_count sort64_scatter scan_sums scan_write splat_bounds "
                    "splat_read splat_lengths splat_pad"},
};

static const struct {
    int rays, level, n1, lists;
} shapes[] = {{1, 0, 4, CLN_LISTS_CSR},
              {2048, 2, 12, CLN_LISTS_CSR},
              {2048, 2, 12, CLN_LISTS_PADDED},
              {2048, 3, 12, CLN_LISTS_CSR}};

typedef struct run {
    bench_scene scene;
    cln_ray_group *groups;
    int count;
} run;

static cln_status splat_body(void *context)
{
    cln_status st = CLN_OK;
    run *r = context;

    free(r->groups);
    r->groups = NULL;
    CLN_TRY(cln_splat_cut(r->scene.p, &r->scene.p->density, r->scene.rays, &r->groups, &r->count));
    for (int g = 0; g < r->count; g++)
        CLN_TRY(cln_splat_make(r->scene.p, &r->scene.p->density, &r->groups[g]));
done:
    return st;
}

/* The device's lists of the batch, all views in one group. */
typedef struct lists {
    cln_grid *grids;  /* [view][level] */
    uint32_t *start;  /* [lists + 1] */
    float *t, *sigma; /* [entry] */
} lists;

static int levels_of(const cln_pipeline *p)
{
    return cln_config_deepest(&p->config) + 1;
}

static cln_status read_lists(const run *r, lists *l)
{
    cln_status st = CLN_OK;
    const cln_pipeline *p = r->scene.p;
    const size_t grids = (size_t)(p->batch_view_count * levels_of(p)),
                 count = (size_t)p->list_total;

    CLN_TRY(cln_alloc(&l->grids, grids, sizeof *l->grids, "bench"));
    CLN_TRY(cln_alloc(&l->start, count + 1, sizeof *l->start, "bench"));
    CLN_TRY(cln_buffer_read(p->device, &p->grids, 0, l->grids, grids * sizeof *l->grids));
    CLN_TRY(
        cln_buffer_read(p->device, &p->list_start, 0, l->start, (count + 1) * sizeof *l->start));
    CLN_TRY(cln_alloc(&l->t, l->start[count], sizeof *l->t, "bench"));
    CLN_TRY(cln_alloc(&l->sigma, l->start[count], sizeof *l->sigma, "bench"));
    CLN_TRY(cln_buffer_read(p->device, &p->list_t, 0, l->t, l->start[count] * sizeof *l->t));
    CLN_TRY(cln_buffer_read(p->device, &p->list_sigma, 0, l->sigma,
                            l->start[count] * sizeof *l->sigma));
done:
    return st;
}

/* List of cell i for a view, and its distance along the list's ray; -1 if the cell is dropped or so
 * close to the next list that rounding may decide. */
static int project(const run *r, const lists *l, int view, int i, double *t)
{
    const bench_scene *s = &r->scene;
    const int n1 = s->p->config.n1, cells = n1 * n1 * n1, slot = i / cells, cell = i % cells;
    const int at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
    const float *box = s->boxes + 4 * slot;
    const cln_grid *grid =
        &l->grids[view * levels_of(s->p) + s->model.tree.level[s->model.tree.leaf[slot]]];
    const cln_camera *camera = &s->cameras[view];
    double point[3], x = 0, y = 0, z = 0, o[3], d[3];
    uint32_t column = 0, row = 0;

    for (int a = 0; a < 3; a++)
        point[a] = box[a] + (at[a] + 0.5) * box[3] / n1;
    if (!((double)s->cache[i] * box[3] / n1 >= 1.001 * s->p->config.splat_min_alpha) ||
        !cln_camera_project(camera, point, &x, &y, &z))
        return -1;
    if (fabs(x - round(x)) < 1e-2 || fabs(y - round(y)) < 1e-2 || x < 0 || y < 0 ||
        x >= camera->width || y >= camera->height)
        return -1;
    column = (uint32_t)x / grid->coarse_x;
    row = (uint32_t)y / grid->coarse_y;
    cln_camera_ray(camera, column * grid->coarse_x + grid->coarse_x / 2.0,
                   row * grid->coarse_y + grid->coarse_y / 2.0, o, d);
    *t = 0;
    for (int a = 0; a < 3; a++)
        *t += (point[a] - o[a]) * d[a];
    return (int)(grid->first + row * grid->row + column);
}

static cln_status check(const run *r, bench_errors *errors)
{
    enum { MOST = 4096 };
    cln_status st = CLN_OK;
    const cln_pipeline *p = r->scene.p;
    const int n1 = p->config.n1, total = p->leaves * n1 * n1 * n1;
    const int step = 1 + total * p->batch_view_count / MOST;
    float got[MOST];
    double want[MOST];
    lists l = {0};
    size_t n = 0, wrong = 0;

    CLN_TRY(read_lists(r, &l));
    for (int list = 0; list < p->list_total; list++)
        for (uint32_t k = l.start[list] + 1; k < l.start[list + 1]; k++)
            wrong += l.t[k] < l.t[k - 1];
    for (int i = 0; i < total * p->batch_view_count; i += step) {
        double t = 0, off = INFINITY;
        const int list = project(r, &l, i / total, i % total, &t);

        if (list < 0)
            continue;
        for (uint32_t k = l.start[list]; k < l.start[list + 1]; k++)
            if (l.sigma[k] == r->scene.cache[i % total] && fabs(l.t[k] - t) < off) {
                off = fabs(l.t[k] - t);
                got[n] = l.t[k];
            }
        if (off < 1e-3)
            want[n++] = t;
        else
            wrong++;
    }
    bench_compare(errors, got, want, n, 1e-12, 1e-5);
    errors->failed = errors->failed || wrong > 0;
done:
    free(l.grids);
    free(l.start);
    free(l.t);
    free(l.sigma);
    return st;
}

static cln_status run_splat(bench *b, int shape)
{
    cln_status st = CLN_OK;
    bench_errors errors = {0};
    double cells = 0, padded = 0;
    run r = {0};
    cln_config config;

    CLN_TRY(bench_small_config(&config));
    config.start_level = shapes[shape].level;
    config.stage1 = CLN_STAGE1_SPLAT;
    config.n1 = shapes[shape].n1;
    config.lists = shapes[shape].lists;
    CLN_TRY(bench_scene_start(b, &config, false, shapes[shape].rays, &r.scene));
    CLN_TRY(splat_body(&r));
    if (r.count != 1) {
        st = cln_fail(CLN_MEMORY, "splat: the views do not fit into one group on this device");
        goto done;
    }
    CLN_TRY(check(&r, &errors));
    cells = (double)r.scene.p->leaves * config.n1 * config.n1 * config.n1;
    if (config.lists == CLN_LISTS_PADDED)
        padded = (double)r.scene.p->padded_t.bytes / sizeof(float);
    if (b->wanted[PROJECT_PART])
        CLN_TRY(bench_add(b, PROJECT_PART, splat_body, NULL, &r, CLN_STAGE_PROJECT,
                          bench_work_project(cells, r.scene.p->batch_view_count,
                                             (double)r.scene.p->splat_entries),
                          &errors));
    if (b->wanted[LISTS_PART])
        CLN_TRY(bench_add(b, LISTS_PART, splat_body, NULL, &r, CLN_STAGE_SORT,
                          bench_work_lists((double)r.scene.p->splat_entries, cells,
                                           r.scene.p->list_total, padded),
                          &errors));
done:
    bench_scene_free(&r.scene);
    free(r.groups);
    return st;
}

static void splat_text(int shape, char out[64])
{
    snprintf(out, 64, "%d leaves n1 %d %s %s", 1 << (3 * shapes[shape].level), shapes[shape].n1,
             shapes[shape].rays > 1 ? "4 views" : "1 view",
             shapes[shape].lists == CLN_LISTS_PADDED ? "padded" : "csr");
}

const bench_family bench_splat = {"splat",    parts,    2, sizeof shapes / sizeof shapes[0],
                                  splat_text, run_splat};
