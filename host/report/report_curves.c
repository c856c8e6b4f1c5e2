/* The report's section "Error against run time": PSNR over seconds and over steps, the tree and the
 * speed over seconds, the test points as a table. */
#include "base/text.h"
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "io/json.h"
#include "io/progress.h"
#include "report/svg.h"

enum { EVENTS = 16, MARKS = 64, TABLE_ROWS = 16 };

static const char train_colour[] = "#2f6da8";
static const char train_faint[] = "#c3d5e6";
static const char test_colour[] = "#c2501c";
static const char other_colour[] = "#4d6a57";

typedef struct curve {
    int count;
    double x[CLN_REPORT_POINTS], y[CLN_REPORT_POINTS];
} curve;

/* ---- error against run time ---- */

/* Whether it is of no training view. */
static bool is_held_out(const cln_report_eval *e)
{
    return strcmp(e->split, "train") != 0 && strcmp(e->split, "all") != 0;
}

/* Positions on an axis of the decisions on single leaves; returns how many, at most MARKS. */
static int find_marks(const cln_report_data *data, bool over_steps, double x[MARKS])
{
    int count = 0;

    for (int i = 0; i < data->decision_count && count < MARKS; i++) {
        const double at = over_steps ? data->decisions[i].step : data->decisions[i].seconds;
        if (isfinite(at))
            x[count++] = at;
    }
    return count;
}

/* PSNR of train and test over an axis, with the full evaluations as rings. */
static bool put_psnr(FILE *to, const cln_report_data *data, bool over_steps)
{
    curve raw, smooth, test, full;
    double marks[MARKS];
    const cln_report_rows *r = &data->rows;
    const double *x = over_steps ? r->step : r->seconds;
    cln_series series[] = {
        {NULL, train_faint, CLN_SERIES_FAINT, 0, raw.x, raw.y},
        {"train", train_colour, CLN_SERIES_LINE, 0, smooth.x, smooth.y},
        {"test, while training", test_colour, CLN_SERIES_DOTS, 0, test.x, test.y},
        {"evaluation", test_colour, CLN_SERIES_RINGS, 0, full.x, full.y},
    };
    cln_chart chart = {.title = over_steps ? "PSNR over steps" : "PSNR over training time, dB",
                       .x_label = over_steps ? "steps" : "training time",
                       .x_axis = over_steps ? CLN_AXIS_COUNT : CLN_AXIS_SECONDS,
                       .width = 560,
                       .height = 330,
                       .series_count = 4,
                       .series = series,
                       .mark_count = find_marks(data, over_steps, marks),
                       .marks = marks};

    series[0].count = cln_report_decimate(r->count, x, r->psnr_train, raw.x, raw.y);
    series[1].count = cln_report_decimate(r->count, x, r->smooth, smooth.x, smooth.y);
    series[2].count = cln_report_decimate(r->count, x, r->psnr_test, test.x, test.y);
    full.count = 0;
    for (int i = 0; i < data->eval_count && full.count < CLN_REPORT_POINTS; i++) {
        const cln_report_eval *e = &data->evals[i];
        if (!is_held_out(e) || e->chosen)
            continue;
        full.x[full.count] = over_steps ? e->step : e->seconds;
        full.y[full.count++] = e->psnr;
    }
    series[3].count = full.count;
    return cln_svg_chart(to, &chart);
}

static bool was_decided(const cln_report_data *data, double after, double until)
{
    for (int i = 0; i < data->decision_count; i++) {
        if (data->decisions[i].step >= after && data->decisions[i].step < until)
            return true;
    }
    return false;
}

/* Times at which the tree grew by half or more, other than by a decision on single leaves. */
static int find_growth(const cln_report_data *data, double seconds[EVENTS])
{
    const cln_report_rows *r = &data->rows;
    int count = 0;

    for (int i = 1; i < r->count && count < EVENTS; i++) {
        if (r->leaves[i] > 1.5 * r->leaves[i - 1] && !was_decided(data, r->step[i - 1], r->step[i]))
            seconds[count++] = r->seconds[i];
    }
    return count;
}

static void put_small(FILE *to, const cln_report_data *data, const char *title, const double *y,
                      cln_series_style style, cln_axis axis)
{
    curve c;
    const cln_report_rows *r = &data->rows;
    double growth[EVENTS], marks[MARKS];
    cln_series series = {NULL, other_colour, style, 0, c.x, c.y};
    cln_chart chart = {.title = title,
                       .x_label = "training time",
                       .x_axis = CLN_AXIS_SECONDS,
                       .y_axis = axis,
                       .width = 360,
                       .height = 190,
                       .y_from_zero = true,
                       .series_count = 1,
                       .series = &series,
                       .lines = growth,
                       .marks = marks};

    series.count = cln_report_decimate(r->count, r->seconds, y, c.x, c.y);
    chart.line_count = find_growth(data, growth);
    chart.mark_count = find_marks(data, false, marks);
    cln_svg_chart(to, &chart);
}

/* One row of the table of test points. */
typedef struct point {
    double seconds, step, psnr, ssim, train;
    int images;      /* 0 = a measurement during training */
    const char *how; /* of the evaluation */
    int order;       /* in the file or list, for those of the same time and images */
} point;

static int by_seconds(const void *a, const void *b)
{
    const point *x = a, *y = b;

    if (x->seconds != y->seconds)
        return x->seconds < y->seconds ? -1 : 1;
    return x->images != y->images ? x->images - y->images : x->order - y->order;
}

/* Train PSNR of the last row up to a time, as it was measured: a smoothed one would be another
 * number once the run goes on. */
static double train_at(const cln_report_rows *r, double seconds)
{
    double psnr = NAN;

    for (int i = 0; i < r->count && r->seconds[i] <= seconds + 1e-6; i++)
        psnr = isfinite(r->psnr_train[i]) ? r->psnr_train[i] : psnr;
    return psnr;
}

/* Whether a row's figure is that of an evaluation, which tells more: the one at the end. */
static bool has_eval(const cln_report_data *data, int row)
{
    const cln_report_rows *r = &data->rows;

    for (int i = 0; i < data->eval_count; i++) {
        const cln_report_eval *e = &data->evals[i];

        if (strcmp(e->split, "test") == 0 && !e->how[0] && e->step == (int64_t)r->step[row] &&
            fabs(e->psnr - r->psnr_test[row]) < 1e-6)
            return true;
    }
    return false;
}

static int find_points(const cln_report_data *data, point *out)
{
    const cln_report_rows *r = &data->rows;
    int count = 0;

    for (int i = 0; i < r->count; i++) {
        if (isfinite(r->psnr_test[i]) && isfinite(r->seconds[i]) && !has_eval(data, i))
            out[count++] = (point){r->seconds[i], r->step[i], r->psnr_test[i], NAN, NAN, 0, "", i};
    }
    for (int i = 0; i < data->eval_count; i++) {
        const cln_report_eval *e = &data->evals[i];
        if (is_held_out(e) && isfinite(e->seconds))
            out[count++] =
                (point){e->seconds, e->step, e->psnr, e->ssim, NAN, e->images, e->how, i};
    }
    qsort(out, (size_t)count, sizeof *out, by_seconds);
    return count;
}

static void put_points(FILE *to, const cln_report_data *data)
{
    point *points = calloc((size_t)data->rows.count + (size_t)data->eval_count + 1, sizeof *points);
    int count = points ? find_points(data, points) : 0;
    int shown = count < TABLE_ROWS ? count : TABLE_ROWS;
    const json_t *splits = json_object_get(json_object_get(data->run, "dataset"), "splits");
    const bool sees_all = cln_json_number(json_object_get(data->run, "config"), "eval_images") >=
                          cln_json_number(splits, "test");

    if (count > 0) {
        fputs("<table><tr><th>training time<th class=n>steps<th class=n>test PSNR<th class=n>SSIM"
              "<th class=n>train PSNR, of rays<th>measured on\n",
              to);
        for (int k = 0; k < shown; k++) {
            const point *p = &points[shown > 1 ? (int64_t)k * (count - 1) / (shown - 1) : 0];
            char time[32], steps[32];

            cln_format_duration(p->seconds, time);
            cln_format_count(p->step, steps);
            fprintf(to, "<tr><td>%s<td class=n>%s<td class=n>", time, steps);
            cln_report_number(to, p->psnr, 2);
            fputs("<td class=n>", to);
            cln_report_number(to, p->ssim, 4);
            fputs("<td class=n>", to);
            cln_report_number(to, train_at(&data->rows, p->seconds), 2);
            if (p->images > 0)
                fprintf(to, "<td>an evaluation of %d image%s%s\n", p->images,
                        cln_plural(p->images, "", "s"), p->how);
            else
                fprintf(to, "<td>%s images, while training\n", sees_all ? "all" : "some");
        }
        fputs("</table>\n", to);
        if (shown < count)
            fprintf(to, "<p class=soft>%d of %d, in even steps.</p>\n", shown, count);
    }
    free(points);
}

cln_status cln_report_curves(FILE *to, const cln_report_data *data)
{
    const cln_report_rows *r = &data->rows;

    fputs("<div class=two>\n", to);
    if (!put_psnr(to, data, false)) {
        fputs("</div><p class=soft>Nothing was measured yet.</p>\n", to);
        return CLN_OK;
    }
    put_psnr(to, data, true);
    fputs("</div>\n<div class=three>\n", to);
    put_small(to, data, "Leaves", r->leaves, CLN_SERIES_STEPS, CLN_AXIS_COUNT);
    put_small(to, data, "Rays per second", r->rays_per_s, CLN_SERIES_LINE, CLN_AXIS_COUNT);
    put_small(to, data, "Samples per ray", r->samples_per_ray, CLN_SERIES_LINE, CLN_AXIS_NUMBER);
    fputs("</div>\n<p class=soft>Train PSNR is that of each batch of training rays: pale as "
          "measured, as in the table, dark smoothed. The mean of whole training photos, which "
          "<code>eval --split train</code> measures, is another number, mostly higher. Dashed "
          "lines: the tree grew by a level.",
          to);
    if (data->decision_count > 0)
        fputs(" Marks at the foot: decisions on single leaves.", to);
    fputs("</p>\n", to);
    put_points(to, data);
    return CLN_OK;
}
