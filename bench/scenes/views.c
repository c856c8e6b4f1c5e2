/* build/bench-views: how good pictures are away from the training cameras, for
 * bench/scenes/extrapolation.sh. A scene with exact depth (build/make-scene --depth), and runs that
 * were evaluated and rendered (cl-nascent eval RUN; render RUN -o RUN/render/test).
 *
 *   bench-views SCENE LABEL=RUN...
 *
 * Prints tables in Markdown. Groups test views by the angle, seen from the scene's middle, to the
 * nearest training camera, and by their distance from the middle over that camera's.
 *
 *   PSNR        mean of the views, of the newest evaluation of test views
 *   depth       of the pixels that show something: the median of abs(depth - exact) / exact, and
 *               the share where that is above 2 % or the picture shows nothing; means of the views
 *
 * Exit status as cl-nascent's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/json.h"
#include "io/npy.h"
#include "report/report_data.h"
#include "scene/scene.h"

static const char usage[] = "usage: bench-views SCENE LABEL=RUN...\n";

/* upper ends of the rows */
static const double angles[] = {5, 10, 20, 40, 60, 90, 181};
static const double ratios[] = {0.75, 0.95, 1.05, 1.35, INFINITY};

enum { ANGLES = sizeof angles / sizeof *angles, RATIOS = sizeof ratios / sizeof *ratios };

typedef struct place {
    const cln_view *view;
    double angle, ratio; /* degrees; distances */
} place;

typedef struct score {
    double psnr, median, wrong;
} score;

/* ---- where a view is ---- */

static double from_middle(const cln_camera *camera, const double middle[3], double out[3])
{
    double square = 0;

    for (int a = 0; a < 3; a++) {
        out[a] = camera->c2w[4 * a + 3] - middle[a];
        square += out[a] * out[a];
    }
    for (int a = 0; a < 3; a++)
        out[a] /= sqrt(square);
    return sqrt(square);
}

static place place_of(const cln_scene *scene, const cln_view *view, const double middle[3])
{
    place p = {.view = view, .angle = INFINITY};
    double own[3];
    const double distance = from_middle(&view->camera, middle, own);

    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++) {
        const cln_view *other = &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)];
        double to[3], cosine = 0;
        const double far = from_middle(&other->camera, middle, to);

        for (int a = 0; a < 3; a++)
            cosine += own[a] * to[a];
        const double angle = acos(fmax(-1, fmin(1, cosine))) * 180 / 3.14159265358979323846;
        if (angle < p.angle) {
            p.angle = angle;
            p.ratio = distance / far;
        }
    }
    return p;
}

/* ---- how good it is ---- */

static int compare(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;

    return (x > y) - (x < y);
}

static cln_status read_depth(const char *path, const cln_view *view, float **depth)
{
    int dims = 0, shape[4];
    cln_status st = cln_npy_read_f32(path, &dims, shape, depth);

    if (st == CLN_OK &&
        (dims != 2 || shape[0] != view->camera.height || shape[1] != view->camera.width))
        st = cln_fail(CLN_INPUT, "%s: the depth map is not as large as its view, %d x %d", path,
                      view->camera.width, view->camera.height);
    return st;
}

static cln_status score_depth(const char *run, const cln_view *view, score *s)
{
    cln_status st = CLN_OK;
    const size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    char *exact_path = NULL, *path = NULL;
    float *exact = NULL, *depth = NULL;
    size_t shown = 0, wrong = 0;

    CLN_TRY(cln_asprintf(&exact_path, "%.*s.depth.npy", (int)strlen(view->path) - 4, view->path));
    CLN_TRY(cln_asprintf(&path, "%s/render/test/%s.depth.npy", run, view->file));
    CLN_TRY(read_depth(exact_path, view, &exact));
    CLN_TRY(read_depth(path, view, &depth));
    for (size_t i = 0; i < pixels; i++) {
        if (!(exact[i] > 0))
            continue;
        const float off = depth[i] > 0 ? fabsf(depth[i] - exact[i]) / exact[i] : 1;

        wrong += off > 0.02f;
        depth[shown++] = off; /* shown <= i */
    }
    qsort(depth, shown, sizeof *depth, compare);
    s->median = shown ? depth[shown / 2] : NAN;
    s->wrong = shown ? (double)wrong / (double)shown : NAN;
done:
    free(exact_path);
    free(path);
    free(exact);
    free(depth);
    return st;
}

static cln_status score_run(const char *run, const place *places, int count, score *scores)
{
    cln_status st = CLN_OK;
    cln_report_data data = {0};
    const json_t *images = NULL;

    CLN_TRY(cln_report_data_read(run, INT64_MAX, &data));
    for (int i = 0; i < data.eval_count; i++) /* ascending steps */
        if (!strcmp(data.evals[i].split, "test"))
            images = json_object_get(data.evals[i].document, "images");
    for (int v = 0; v < count; v++) {
        const json_t *image = NULL;
        size_t at = 0;

        scores[v].psnr = NAN;
        json_array_foreach((json_t *)images, at, image)
        {
            if (!strcmp(cln_json_text(image, "name"), places[v].view->name))
                scores[v].psnr = cln_json_number(image, "psnr");
        }
        if (isnan(scores[v].psnr)) {
            st = cln_fail(CLN_INPUT, "%s: view %s is not evaluated; run `cl-nascent eval`", run,
                          places[v].view->name);
            goto done;
        }
        CLN_TRY(score_depth(run, places[v].view, &scores[v]));
    }
done:
    cln_report_data_free(&data);
    return st;
}

/* ---- tables ---- */

typedef struct table {
    const char *what, *unit;
    const double *ends;
    int rows;
    bool by_angle;
} table;

static bool in_row(const table *t, int row, const place *p)
{
    const double value = t->by_angle ? p->angle : p->ratio;

    return value >= (row ? t->ends[row - 1] : 0) && value < t->ends[row];
}

static int views_in(const table *t, int row, const place *places, int count)
{
    int views = 0;

    for (int v = 0; v < count; v++)
        views += in_row(t, row, &places[v]);
    return views;
}

static void put_row(const table *t, int row, int runs, const place *places, int count,
                    const score *scores)
{
    const double low = row ? t->ends[row - 1] : 0, high = t->ends[row];
    const int views = views_in(t, row, places, count);

    if (isfinite(high))
        printf("| %.4g to %.4g%s | %d", low, fmin(high, 180), t->unit, views);
    else
        printf("| %.4g and more%s | %d", low, t->unit, views);
    for (int r = 0; r < runs; r++) {
        score sum = {0};

        for (int v = 0; v < count; v++) {
            const score *s = &scores[r * count + v];

            if (!in_row(t, row, &places[v]))
                continue;
            sum.psnr += s->psnr / views;
            sum.median += s->median / views;
            sum.wrong += s->wrong / views;
        }
        printf(" | %.2f | %.2f %% | %.1f %%", sum.psnr, 100 * sum.median, 100 * sum.wrong);
    }
    printf(" |\n");
}

/* Nothing if all views are in one row. */
static void put_table(const table *t, char **labels, int runs, const place *places, int count,
                      const score *scores)
{
    int filled = 0;

    for (int row = 0; row < t->rows; row++)
        filled += views_in(t, row, places, count) > 0;
    if (filled < 2)
        return;
    printf("| %s | views", t->what);
    for (int r = 0; r < runs; r++)
        printf(" | %.*s: PSNR | depth off by | above 2 %%", (int)strcspn(labels[r], "="),
               labels[r]);
    printf(" |\n|---|---");
    for (int r = 0; r < runs; r++)
        printf("|---|---|---");
    printf("|\n");
    for (int row = 0; row < t->rows; row++)
        if (views_in(t, row, places, count) > 0)
            put_row(t, row, runs, places, count, scores);
    printf("\n");
}

static cln_status compare_runs(const char *folder, char **runs, int run_count)
{
    static const table tables[] = {
        {"angle to the nearest training camera", " degrees", angles, ANGLES, true},
        {"distance, over that camera's", "", ratios, RATIOS, false}};
    cln_status st = CLN_OK;
    cln_config config;
    cln_scene *scene = NULL;
    place *places = NULL;
    score *scores = NULL;
    double middle[3];

    CLN_TRY(cln_config_preset("fast", &config));
    CLN_TRY(cln_scene_load(&(cln_scene_desc){.path = folder, .config = &config}, &scene));
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TEST);
    if (count == 0 || !cln_scene_focus(scene, middle)) {
        st = cln_fail(CLN_INPUT, "%s: no test views, or cameras that look in parallel", folder);
        goto done;
    }
    CLN_TRY(cln_alloc(&places, (size_t)count, sizeof *places, "views"));
    CLN_TRY(cln_alloc(&scores, (size_t)(run_count * count), sizeof *scores, "scores"));
    for (int v = 0; v < count; v++)
        places[v] =
            place_of(scene, &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TEST, v)], middle);
    for (int r = 0; r < run_count; r++) {
        const char *equals = strchr(runs[r], '=');

        if (!equals || equals == runs[r] || !equals[1]) {
            st = cln_fail(CLN_USAGE, "'%s' is not LABEL=RUN", runs[r]);
            goto done;
        }
        CLN_TRY(score_run(equals + 1, places, count, scores + r * count));
    }
    for (size_t t = 0; t < sizeof tables / sizeof *tables; t++)
        put_table(&tables[t], runs, run_count, places, count, scores);
done:
    cln_scene_free(scene);
    free(places);
    free(scores);
    return st;
}

int main(int argc, char **argv)
{
    cln_status st;

    cln_log_set_sink(cln_log_stderr, NULL);
    if (argc < 3) {
        fputs(usage, stderr);
        return cln_status_exit_code(CLN_USAGE);
    }
    st = compare_runs(argv[1], argv + 2, argc - 2);
    if (st != CLN_OK)
        fprintf(stderr, "bench-views: %s\n", cln_error_text());
    return cln_status_exit_code(st);
}
