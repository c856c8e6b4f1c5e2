/* build/bench-growth: how cost grows, for bench/growth/growth.sh. Reads only run folders.
 *
 *   bench-growth BASE SERIES=RUN...
 *
 * SERIES names the quantity that differs between its runs: leaves, samples (per step) or pixels
 * (per image); its runs come in ascending order. Prints three things in Markdown: one row per run
 * with the milliseconds of a step and of each stage, and the time and memory per unit of work; the
 * power of the work with which each grows, over the whole series and from its last run but one (1:
 * as fast as the work, 0: not at all); and the powers above 1. Writes BASE.csv and BASE-SERIES.svg.
 * Only the second half of a run's steps counts: by then the batch has its final size. Exit status
 * as cl-nascent's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/files.h"
#include "base/memory.h"
#include "device/device.h"
#include "io/run_folder.h"
#include "common/csv.h"
#include "common/plot.h"
#include "io/json.h"

enum { MAX_RUNS = 64, SERIES = 3 };

static const char *const series_names[SERIES] = {"leaves", "samples", "pixels"};
static const char *const series_units[SERIES] = {"leaves", "samples a step", "pixels an image"};

typedef struct run {
    int series;
    const char *path;
    double leaves, samples, pixels, steps; /* samples: per step; steps: measured */
    double step;                           /* seconds per step */
    double stages[CLN_STAGES];             /* seconds per step in each stage */
    double device, host;                   /* peak bytes */
} run;

static double work_of(const run *r)
{
    return r->series == 0 ? r->leaves : r->series == 1 ? r->samples : r->pixels;
}

/* ---- from a run folder ---- */

/* Adds a row to the measurement if it belongs to the second half: steps after `from`. */
static void add_row(const json_t *row, double from, double *last_step, double *last_seconds, run *r)
{
    const double step = cln_json_number(row, "step"), seconds = cln_json_number(row, "seconds");
    const json_t *stages = json_object_get(row, "stages");

    if (*last_step >= from) {
        const double spent = seconds - *last_seconds;

        r->steps += step - *last_step;
        r->step += spent;
        r->samples +=
            cln_json_number(row, "rays_per_s") * spent * cln_json_number(row, "samples_per_ray");
        for (int i = 0; i < CLN_STAGES; i++) {
            const double s = cln_json_number(stages, cln_stage_names[i]);

            r->stages[i] += isfinite(s) ? s : 0;
        }
    }
    *last_step = step;
    *last_seconds = seconds;
}

static cln_status read_rows(run *r, double steps)
{
    cln_status st = CLN_OK;
    char *path = NULL, *text = NULL, *line = NULL, *rest = NULL;
    size_t bytes = 0;
    double step = 0, seconds = 0;

    CLN_TRY(cln_path_join(&path, r->path, "metrics.jsonl"));
    CLN_TRY(cln_read_file(path, (size_t)1 << 28, &text, &bytes));
    for (line = strtok_r(text, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest)) {
        json_t *row = json_loads(line, 0, NULL);

        if (row && !json_object_get(row, "event"))
            add_row(row, floor(steps / 2), &step, &seconds, r);
        json_decref(row);
    }
    if (!(r->steps > 0))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the second half of the run has fewer than two rows; train with more "
                         "--steps or a smaller --log-every",
                         path));
    r->step /= r->steps;
    r->samples /= r->steps;
    for (int i = 0; i < CLN_STAGES; i++)
        r->stages[i] /= r->steps;
done:
    free(path);
    free(text);
    return st;
}

static cln_status read_run(const char *argument, run *r)
{
    cln_status st = CLN_OK;
    const char *equals = strchr(argument, '=');
    json_t *document = NULL;
    const json_t *result = NULL, *size = NULL;

    for (r->series = 0; equals && r->series < SERIES; r->series++)
        if (strlen(series_names[r->series]) == (size_t)(equals - argument) &&
            strncmp(argument, series_names[r->series], (size_t)(equals - argument)) == 0)
            break;
    if (!equals || r->series == SERIES)
        return cln_fail(CLN_USAGE, "'%s' is not leaves=RUN, samples=RUN or pixels=RUN", argument);
    r->path = equals + 1;
    CLN_TRY(cln_run_read(r->path, &document));
    result = json_object_get(document, "result");
    size = json_array_get(json_object_get(json_object_get(document, "dataset"), "sizes"), 0);
    r->leaves = cln_json_number(result, "leaves");
    r->device = cln_json_number(result, "device_peak");
    r->host = cln_json_number(result, "host_peak");
    r->pixels = cln_json_number(size, "width") * cln_json_number(size, "height");
    CLN_TRY(read_rows(r, cln_json_number(result, "step")));
done:
    json_decref(document);
    return st;
}

/* ---- the table ---- */

/* Does the stage take a hundredth of a step in any run? */
static bool matters(const run *runs, int count, int stage)
{
    for (int i = 0; i < count; i++)
        if (runs[i].stages[stage] >= 0.01 * runs[i].step)
            return true;
    return false;
}

static double device_seconds(const run *r)
{
    double sum = 0;

    for (int i = 0; i < CLN_STAGES; i++)
        sum += r->stages[i];
    return sum;
}

static void put_table(const run *runs, int count)
{
    printf(
        "| grows | leaves | samples a step | pixels | ms a step | ns a sample | us a leaf | device "
        "MiB | KiB a leaf | host MiB");
    for (int k = 0; k < CLN_STAGES; k++)
        if (matters(runs, count, k))
            printf(" | %s, ms", cln_stage_names[k]);
    printf(" | between launches, ms |\n|---");
    for (int k = 0; k < CLN_STAGES; k++)
        if (matters(runs, count, k))
            printf("|---");
    printf("|---|---|---|---|---|---|---|---|---|---|\n");
    for (int i = 0; i < count; i++) {
        const run *r = &runs[i];

        printf("| %s | %.0f | %.0f | %.0f | %.1f | %.0f | %.1f | %.1f | %.0f | %.0f",
               series_names[r->series], r->leaves, r->samples, r->pixels, 1e3 * r->step,
               1e9 * r->step / r->samples, 1e6 * r->step / r->leaves, r->device / 1048576,
               r->device / r->leaves / 1024, r->host / 1048576);
        for (int k = 0; k < CLN_STAGES; k++)
            if (matters(runs, count, k))
                printf(" | %.2f", 1e3 * r->stages[k]);
        printf(" | %.2f |\n", 1e3 * (r->step - device_seconds(r)));
    }
}

/* The power of the work with which a quantity grew from run a to run b. */
static double power(const run *a, const run *b, double from, double to)
{
    return log(to / from) / log(work_of(b) / work_of(a));
}

/* First, last and last but one run of a series; false unless two of its runs differ in work. */
static bool ends_of(const run *runs, int count, int series, const run **first, const run **near,
                    const run **last)
{
    *first = *near = *last = NULL;
    for (int i = 0; i < count; i++) {
        if (runs[i].series != series)
            continue;
        *first = *first ? *first : &runs[i];
        *near = *last;
        *last = &runs[i];
    }
    return *first && work_of(*last) > 1.01 * work_of(*first);
}

/* ---- the powers ---- */

/* Quantities that grow: the stages, then a whole step and its memory. */
enum { STEP = CLN_STAGES, MEMORY, HOST_MEMORY, QUANTITIES };

static const char *name_of(int quantity)
{
    return quantity == STEP          ? "time a step"
           : quantity == MEMORY      ? "device memory"
           : quantity == HOST_MEMORY ? "host memory"
                                     : cln_stage_names[quantity];
}

/* Milliseconds or MiB. */
static double value_of(const run *r, int quantity)
{
    return quantity == STEP          ? 1e3 * r->step
           : quantity == MEMORY      ? r->device / 1048576
           : quantity == HOST_MEMORY ? r->host / 1048576
                                     : 1e3 * r->stages[quantity];
}

/* The columns, in order: a step as a whole, then stages; returns how many. */
static int columns_of(const run *runs, int count, int columns[QUANTITIES])
{
    int used = 0;

    for (int q = STEP; q < QUANTITIES; q++)
        columns[used++] = q;
    for (int q = 0; q < CLN_STAGES; q++)
        if (matters(runs, count, q))
            columns[used++] = q;
    return used;
}

static double power_of(const run *a, const run *b, int quantity)
{
    return power(a, b, value_of(a, quantity), value_of(b, quantity));
}

static void put_row_of_powers(const run *a, const run *b, const char *which, const int *columns,
                              int used)
{
    printf("| %s%s | %.3g times", series_names[a->series], which, work_of(b) / work_of(a));
    for (int i = 0; i < used; i++) {
        const double p = power_of(a, b, columns[i]);

        if (isfinite(p))
            printf(" | %.2f", p);
        else
            printf(" | –");
    }
    printf(" |\n");
}

/* Prints the powers above 1 of one row ("faster than the work: samples 1.04"). Returns how many. */
static int put_faster(const run *a, const run *b, const char *which, const int *columns, int used)
{
    int found = 0;

    for (int i = 0; i < used; i++) {
        const double p = power_of(a, b, columns[i]);

        if (!(p >= 1.005)) /* as the table rounds it */
            continue;
        if (found++ == 0)
            printf("\nFaster than the work, %s%s:", series_names[a->series], which);
        printf("%s %s %.2f", found > 1 ? "," : "", name_of(columns[i]), p);
    }
    if (found)
        printf(".\n");
    return found;
}

static void put_powers(const run *runs, int count)
{
    static const char last_two[] = ", last two runs";
    const run *first = NULL, *near = NULL, *last = NULL;
    int columns[QUANTITIES];
    const int used = columns_of(runs, count, columns);
    int faster = 0;

    printf("\n| power of | work grew");
    for (int i = 0; i < used; i++)
        printf(" | %s", name_of(columns[i]));
    printf(" |\n|---|---");
    for (int i = 0; i < used; i++)
        printf("|---");
    printf("|\n");
    for (int s = 0; s < SERIES; s++) {
        if (!ends_of(runs, count, s, &first, &near, &last))
            continue;
        put_row_of_powers(first, last, "", columns, used);
        if (near != first)
            put_row_of_powers(near, last, last_two, columns, used);
    }
    for (int s = 0; s < SERIES; s++) {
        if (!ends_of(runs, count, s, &first, &near, &last))
            continue;
        faster += put_faster(first, last, "", columns, used);
        if (near != first)
            faster += put_faster(near, last, last_two, columns, used);
    }
    if (!faster)
        printf("\nNothing grew faster than its work.\n");
}

/* ---- files ---- */

static void put_csv(FILE *to, const run *runs, int count)
{
    fputs("series,run,leaves,samples_per_step,pixels,steps,seconds_per_step,device_peak,host_peak",
          to);
    for (int k = 0; k < CLN_STAGES; k++)
        fprintf(to, ",\"%s\"", cln_stage_names[k]);
    for (int i = 0; i < count; i++) {
        const run *r = &runs[i];

        fprintf(to, "\n%s,", series_names[r->series]);
        csv_text(to, r->path);
        fprintf(to, ",%.10g,%.10g,%.10g,%.10g,%.10g,%.10g,%.10g", r->leaves, r->samples, r->pixels,
                r->steps, r->step, r->device, r->host);
        for (int k = 0; k < CLN_STAGES; k++)
            fprintf(to, ",%.10g", r->stages[k]);
    }
    fputc('\n', to);
}

static cln_status write_csv(const run *runs, int count, const char *base)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char *path = NULL;

    CLN_TRY(cln_asprintf(&path, "%s.csv", base));
    CLN_TRY(cln_atomic_open(path, &file));
    put_csv(cln_atomic_stream(file), runs, count);
    st = cln_atomic_commit(&file);
done:
    free(path);
    return st;
}

/* One line: a step, the device's memory, or a stage; its power in the legend. */
typedef struct line {
    double work[MAX_RUNS], value[MAX_RUNS];
    plot_line plot;
} line;

static cln_status write_plot(const run *runs, int count, int series, const char *base)
{
    cln_status st = CLN_OK;
    line *lines = NULL;
    plot_line plots[QUANTITIES];
    int columns[QUANTITIES];
    const int wanted = columns_of(runs, count, columns);
    int used = 0;
    cln_atomic_file *file = NULL;
    char *path = NULL, title[128];
    const run *a = NULL, *near = NULL, *b = NULL;

    if (!ends_of(runs, count, series, &a, &near, &b))
        return CLN_OK;
    CLN_TRY(cln_alloc(&lines, QUANTITIES, sizeof *lines, "plot"));
    for (int n = 0; n < wanted; n++) {
        const int q = columns[n];
        line *l = &lines[used];
        int points = 0;

        if (q == HOST_MEMORY)
            continue;
        for (int i = 0; i < count; i++) {
            if (runs[i].series != series)
                continue;
            l->work[points] = work_of(&runs[i]);
            l->value[points++] = value_of(&runs[i], q);
        }
        plots[used++] = (plot_line){q == STEP     ? "a step, ms"
                                    : q == MEMORY ? "device memory, MiB"
                                                  : cln_stage_names[q],
                                    points,
                                    l->work,
                                    l->value,
                                    NAN,
                                    power_of(a, b, q)};
    }
    snprintf(title, sizeof title, "Milliseconds of a step, and memory, over %s",
             series_units[series]);
    CLN_TRY(cln_asprintf(&path, "%s-%s.svg", base, series_names[series]));
    CLN_TRY(cln_atomic_open(path, &file));
    plot_write_scaling(cln_atomic_stream(file),
                       &(plot_text){title, series_units[series], "power of the work"}, plots, used);
    st = cln_atomic_commit(&file);
done:
    free(lines);
    free(path);
    return st;
}

static cln_status tabulate(const char *base, char **arguments, int count)
{
    cln_status st = CLN_OK;
    run *runs = NULL;

    if (count > MAX_RUNS)
        return cln_fail(CLN_USAGE, "%d runs are too many; give at most %d", count, MAX_RUNS);
    CLN_TRY(cln_alloc(&runs, (size_t)count, sizeof *runs, "runs"));
    for (int i = 0; i < count; i++)
        CLN_TRY(read_run(arguments[i], &runs[i]));
    CLN_TRY(write_csv(runs, count, base));
    for (int s = 0; s < SERIES; s++)
        CLN_TRY(write_plot(runs, count, s, base));
    put_table(runs, count);
    put_powers(runs, count);
    if (fflush(stdout) != 0)
        st = cln_fail(CLN_OUTPUT, "standard output cannot be written");
done:
    free(runs);
    return st;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;

    cln_log_set_sink(cln_log_stderr, NULL);
    if (argc < 3) {
        fputs("usage: bench-growth BASE SERIES=RUN...\n", stderr);
        return 2;
    }
    st = tabulate(argv[1], argv + 2, argc - 2);
    if (st != CLN_OK)
        fprintf(stderr, "bench-growth: %s: %s\n", cln_status_phrase(st), cln_error_text());
    return cln_status_exit_code(st);
}
