/* build/bench-table: runs side by side, for docs/results.md and the scene benches. Reads only run
 * folders.
 *
 *   bench-table [-t TITLE] BASE LABEL=RUN...
 *
 * Prints a table in Markdown, one row per run, and writes BASE.csv (the same in full precision) and
 * BASE.svg (PSNR over training seconds, one line per run). Columns:
 *
 *   leaves, parameters, steps   at the end of the run
 *   s/epoch                     training seconds per epoch (a tenth of all training pixels in rays)
 *                               over the run
 *   s/view                      seconds to render a test view
 *   PSNR, SSIM                  of the newest evaluation of test views
 *   PSNR at T                   of the first evaluation while training at or after each time of any
 *                               run's --eval-at; a dash without an evaluation within 20 % of it
 *
 * Seconds are training seconds. Exit status as cl-nascent's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "io/progress.h"
#include "report/report_data.h"
#include "io/run_folder.h"
#include "common/csv.h"
#include "common/plot.h"
#include "io/json.h"

enum { POINTS = 64, LABEL_BYTES = 64 };

static const char usage[] = "usage: bench-table [-t TITLE] BASE LABEL=RUN...\n";

typedef struct run {
    char label[LABEL_BYTES];
    const char *path;
    cln_report_data data;
    double *seconds, *psnr; /* [test_count] test PSNR during training */
    int test_count;
    int width, depth, view_width;
    double leaves, params, steps, trained; /* trained: seconds */
    double epoch_seconds, view_seconds, end_seconds, end_psnr, end_ssim;
    int views; /* of the last evaluation */
} run;

typedef struct bench {
    run *runs; /* [run_count] */
    int run_count;
    double points[POINTS]; /* seconds, ascending */
    int point_count;
} bench;

/* ---- from a run folder ---- */

/* Rays of an epoch: a tenth of the training pixels. run.json lists sizes over all splits: views of
 * different sizes count with their mean. */
static double rays_of_epoch(const json_t *document)
{
    const json_t *dataset = json_object_get(document, "dataset"), *row = NULL;
    const double train = cln_json_number(json_object_get(dataset, "splits"), "train");
    double pixels = 0, views = 0;
    size_t i = 0;

    json_array_foreach((json_t *)json_object_get(dataset, "sizes"), i, row)
    {
        const double n = cln_json_number(row, "views");

        pixels += n * cln_json_number(row, "width") * cln_json_number(row, "height");
        views += n;
    }
    return 0.1 * train * pixels / views;
}

/* Seconds per ray, from the rates of the rows: each covers the time since the previous row. */
static double seconds_per_ray(const cln_report_rows *rows)
{
    double rays = 0, before = 0;

    for (int i = 0; i < rows->count; i++) {
        if (!isfinite(rows->seconds[i]) || !isfinite(rows->rays_per_s[i]))
            continue;
        rays += rows->rays_per_s[i] * (rows->seconds[i] - before);
        before = rows->seconds[i];
    }
    return rays > 0 ? before / rays : NAN;
}

static cln_status take_tests(run *r)
{
    cln_status st = CLN_OK;
    const cln_report_rows *rows = &r->data.rows;

    CLN_TRY(cln_alloc(&r->seconds, (size_t)rows->count, sizeof *r->seconds, "test points"));
    CLN_TRY(cln_alloc(&r->psnr, (size_t)rows->count, sizeof *r->psnr, "test points"));
    for (int i = 0; i < rows->count; i++) {
        if (!isfinite(rows->psnr_test[i]) || !(rows->seconds[i] > 0))
            continue;
        r->seconds[r->test_count] = rows->seconds[i];
        r->psnr[r->test_count++] = rows->psnr_test[i];
    }
done:
    return st;
}

/* The newest evaluation of the test split. */
static void take_evaluation(run *r)
{
    r->end_seconds = r->end_psnr = r->end_ssim = r->view_seconds = NAN;
    for (int i = 0; i < r->data.eval_count; i++) {
        const cln_report_eval *e = &r->data.evals[i]; /* ascending steps */

        if (strcmp(e->split, "test") != 0)
            continue;
        r->end_seconds = e->seconds;
        r->end_psnr = e->psnr;
        r->end_ssim = e->ssim;
        r->view_seconds = cln_json_number(json_object_get(e->document, "mean"), "seconds");
        r->views = e->images;
    }
}

static int whole(const json_t *object, const char *key)
{
    return (int)json_integer_value(json_object_get(object, key));
}

static cln_status read_run(const char *argument, run *r)
{
    cln_status st = CLN_OK;
    const char *equals = strchr(argument, '=');
    const json_t *config = NULL, *result = NULL;
    json_t *document = NULL;

    if (!equals || equals == argument || !equals[1])
        return cln_fail(CLN_USAGE, "'%s' is not LABEL=RUN", argument);
    snprintf(r->label, sizeof r->label, "%.*s", (int)(equals - argument), argument);
    r->path = equals + 1;
    CLN_TRY(
        cln_run_read(r->path, &document)); /* unlike the reader below, refuses what is not a run */
    CLN_TRY(cln_report_data_read(r->path, INT64_MAX, &r->data));
    config = json_object_get(document, "config");
    result = json_object_get(document, "result");
    r->width = whole(config, "width");
    r->depth = whole(config, "depth");
    r->view_width = whole(config, "view_width");
    r->leaves = cln_json_number(result, "leaves");
    r->params = cln_json_number(result, "params");
    r->steps = cln_json_number(result, "step");
    r->trained = cln_json_number(result, "seconds");
    r->epoch_seconds = seconds_per_ray(&r->data.rows) * rays_of_epoch(document);
    take_evaluation(r);
    CLN_TRY(take_tests(r));
    if (strcmp(cln_json_text(document, "state"), "done") != 0)
        fprintf(stderr, "bench-table: %s is not finished; its state: %s\n", r->path,
                cln_json_text(document, "state"));
done:
    json_decref(document);
    return st;
}

static void free_run(run *r)
{
    cln_report_data_free(&r->data);
    free(r->seconds);
    free(r->psnr);
}

/* ---- points in time ---- */

static void add_point(bench *b, double seconds)
{
    int at = 0;

    while (at < b->point_count && b->points[at] < seconds * (1 - 1e-6))
        at++;
    if (at < b->point_count && b->points[at] <= seconds * (1 + 1e-6))
        return;
    if (b->point_count == POINTS)
        return;
    memmove(b->points + at + 1, b->points + at, (size_t)(b->point_count - at) * sizeof *b->points);
    b->points[at] = seconds;
    b->point_count++;
}

/* All times of the runs' --eval-at. */
static cln_status find_points(bench *b)
{
    cln_status st = CLN_OK;
    cln_points at;

    for (int i = 0; i < b->run_count; i++) {
        const json_t *own = json_object_get(b->runs[i].data.run, "config");

        CLN_TRY(cln_config_points("eval-at", cln_json_text(own, "eval_at"), &at));
        for (int k = 0; k < at.count; k++) {
            if (at.seconds[k] > 0)
                add_point(b, at.seconds[k]);
        }
    }
done:
    return st;
}

/* A test follows the step that passes the point; in a slow run this may be much later. */
static double psnr_at(const run *r, double point)
{
    for (int i = 0; i < r->test_count; i++) {
        if (r->seconds[i] >= point * (1 - 1e-9))
            return r->seconds[i] <= 1.2 * point ? r->psnr[i] : NAN;
    }
    return NAN;
}

/* ---- Markdown ---- */

static void put_cell(double value, const char *format)
{
    printf(" | ");
    if (isfinite(value))
        printf(format, value);
    else
        printf("–");
}

static void put_count(double value)
{
    char text[32];

    cln_format_count(value, text);
    printf(" | %s", isfinite(value) ? text : "–");
}

static void put_point(double seconds)
{
    if (seconds < 120)
        printf(" | %.3g s", seconds);
    else if (seconds < 7200)
        printf(" | %.3g min", seconds / 60);
    else
        printf(" | %.3g h", seconds / 3600);
}

/* Three digits, whatever the size. */
static const char *format_of(double seconds)
{
    return seconds < 0.1 ? "%.3f" : seconds < 10 ? "%.2f" : seconds < 100 ? "%.1f" : "%.0f";
}

static void put_row(const bench *b, const run *r)
{
    char params[32];

    cln_format_short(r->params, params);
    printf("| %s", r->label);
    put_count(r->leaves);
    printf(" | %s", isfinite(r->params) ? params : "–");
    put_count(r->steps);
    put_cell(r->epoch_seconds, format_of(r->epoch_seconds));
    put_cell(r->view_seconds, format_of(r->view_seconds));
    for (int k = 0; k < b->point_count; k++)
        put_cell(psnr_at(r, b->points[k]), "%.2f");
    put_cell(r->end_psnr, "%.2f");
    put_cell(r->end_ssim, "%.3f");
    printf(" |\n");
}

static void put_markdown(const bench *b)
{
    int least = b->runs[0].views, most = least;
    double shortest = b->runs[0].trained, longest = shortest;

    printf("| run | leaves | parameters | steps | s/epoch | s/view");
    for (int k = 0; k < b->point_count; k++)
        put_point(b->points[k]);
    printf(" | PSNR | SSIM |\n|---");
    for (int k = 0; k < b->point_count + 7; k++)
        printf("|---");
    printf("|\n");
    for (int i = 0; i < b->run_count; i++) {
        const run *r = &b->runs[i];

        put_row(b, r);
        least = r->views < least ? r->views : least;
        most = r->views > most ? r->views : most;
        shortest = fmin(shortest, r->trained);
        longest = fmax(longest, r->trained);
    }
    printf("\nPSNR and SSIM at the end (%.4g to %.4g s of training) over ", shortest, longest);
    if (least == most)
        printf("%d test views", most);
    else
        printf("%d to %d test views", least, most);
    printf("; in between over the views of --eval-images.\n");
}

/* ---- files ---- */

static void put_csv_number(FILE *to, double value)
{
    fputc(',', to);
    if (isfinite(value))
        fprintf(to, "%.10g", value);
}

static void put_csv(FILE *to, const bench *b)
{
    fputs("label,run,width,depth,view_width,leaves,params,steps,seconds,seconds_per_epoch,"
          "seconds_per_view,views,psnr,ssim",
          to);
    for (int k = 0; k < b->point_count; k++)
        fprintf(to, ",psnr_at_%.10g", b->points[k]);
    fputc('\n', to);
    for (int i = 0; i < b->run_count; i++) {
        const run *r = &b->runs[i];
        const double columns[] = {r->width,        r->depth, r->view_width, r->leaves,
                                  r->params,       r->steps, r->trained,    r->epoch_seconds,
                                  r->view_seconds, r->views, r->end_psnr,   r->end_ssim};

        csv_text(to, r->label);
        fputc(',', to);
        csv_text(to, r->path);
        for (size_t c = 0; c < sizeof columns / sizeof columns[0]; c++)
            put_csv_number(to, columns[c]);
        for (int k = 0; k < b->point_count; k++)
            put_csv_number(to, psnr_at(r, b->points[k]));
        fputc('\n', to);
    }
}

static cln_status write_csv(const bench *b, const char *base)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char *path = NULL;

    CLN_TRY(cln_asprintf(&path, "%s.csv", base));
    CLN_TRY(cln_atomic_open(path, &file));
    put_csv(cln_atomic_stream(file), b);
    st = cln_atomic_commit(&file);
done:
    free(path);
    return st;
}

static cln_status write_plot(const bench *b, const char *base, const char *title)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    plot_line *lines = NULL;
    char *path = NULL;

    CLN_TRY(cln_alloc(&lines, (size_t)b->run_count, sizeof *lines, "plot"));
    for (int i = 0; i < b->run_count; i++) {
        const run *r = &b->runs[i];

        lines[i] =
            (plot_line){r->label, r->test_count, r->seconds, r->psnr, r->end_seconds, r->end_psnr};
    }
    CLN_TRY(cln_asprintf(&path, "%s.svg", base));
    CLN_TRY(cln_atomic_open(path, &file));
    plot_write(cln_atomic_stream(file), &(plot_text){title, "training time", "at the end, dB"},
               lines, b->run_count);
    st = cln_atomic_commit(&file);
done:
    free(lines);
    free(path);
    return st;
}

static cln_status tabulate(const char *base, const char *title, char **arguments, int count)
{
    cln_status st = CLN_OK;
    bench b = {.run_count = 0};

    CLN_TRY(cln_alloc(&b.runs, (size_t)count, sizeof *b.runs, "runs"));
    for (; b.run_count < count; b.run_count++)
        CLN_TRY(read_run(arguments[b.run_count], &b.runs[b.run_count]));
    CLN_TRY(find_points(&b));
    CLN_TRY(write_csv(&b, base));
    CLN_TRY(write_plot(&b, base, title));
    put_markdown(&b);
    if (fflush(stdout) != 0)
        st = cln_fail(CLN_OUTPUT, "standard output cannot be written");
done:
    for (int i = 0; b.runs && i < count; i++)
        free_run(&b.runs[i]);
    free(b.runs);
    return st;
}

int main(int argc, char **argv)
{
    const char *title = "PSNR over training time, dB";
    cln_status st = CLN_OK;
    int first = 1;

    cln_log_set_sink(cln_log_stderr, NULL);
    if (argc > 2 && strcmp(argv[1], "-t") == 0) {
        title = argv[2];
        first = 3;
    }
    if (argc < first + 2) {
        fputs(usage, stderr);
        return 2;
    }
    st = tabulate(argv[first], title, argv + first + 1, argc - first - 1);
    if (st != CLN_OK)
        fprintf(stderr, "bench-table: %s: %s\n", cln_status_phrase(st), cln_error_text());
    return cln_status_exit_code(st);
}
