/* The chart writer of svg.h.
 *
 *     title                 legend
 *     y |                             plot area: (LEFT, TOP) to (width - RIGHT, height - BOTTOM)
 *       |____________
 *          x label */
#include "report/svg.h"

#include <math.h>
#include <string.h>
#include "report/html.h"
#include "io/progress.h"

enum { LEFT = 52, RIGHT = 20, TOP = 34, BOTTOM = 40 };

typedef struct range {
    double min, max, step;
} range;

typedef struct plot {
    FILE *to;
    const cln_chart *chart;
    range x, y;
} plot;

static bool is_point(const cln_series *s, int i)
{
    return isfinite(s->x[i]) && isfinite(s->y[i]);
}

/* Smallest of 1, 2, 5 x 10^k that cuts span into at most `parts`. */
static double round_step(double span, int parts)
{
    double rough = span / parts;
    double power = pow(10, floor(log10(rough)));

    for (int i = 0; i < 3; i++) {
        static const double factor[] = {1, 2, 5};
        if (factor[i] * power >= rough * (1 - 1e-9))
            return factor[i] * power;
    }
    return 10 * power;
}

/* The same, in units that people divide time into. */
static double round_seconds(double span, int parts)
{
    static const double steps[] = {1,   2,   5,    10,   15,   20,   30,    60,    120,   300,
                                   600, 900, 1200, 1800, 3600, 7200, 10800, 21600, 43200, 86400};

    if (span < 1.0 * parts)
        return round_step(span, parts);
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        if (steps[i] * parts >= span)
            return steps[i];
    }
    return 86400 * round_step(span / 86400, parts);
}

/* The range of all series along one axis; false if they have no finite point. */
static bool extent(const cln_chart *chart, bool along_y, range *out)
{
    out->min = INFINITY;
    out->max = -INFINITY;
    for (int s = 0; s < chart->series_count; s++) {
        const cln_series *series = &chart->series[s];
        for (int i = 0; i < series->count; i++) {
            double value = along_y ? series->y[i] : series->x[i];
            if (!is_point(series, i))
                continue;
            out->min = fmin(out->min, value);
            out->max = fmax(out->max, value);
        }
    }
    return out->max >= out->min;
}

static bool find_ranges(plot *p)
{
    const cln_chart *chart = p->chart;
    int y_parts = chart->height > 220 ? 6 : 3;

    if (!extent(chart, false, &p->x) || !extent(chart, true, &p->y))
        return false;
    p->x.min = 0;
    if (p->x.max <= 0)
        p->x.max = 1;
    p->x.step = chart->x_axis == CLN_AXIS_SECONDS
                    ? round_seconds(p->x.max, chart->width > 400 ? 8 : 5)
                    : round_step(p->x.max, chart->width > 400 ? 8 : 4);
    if (ceil(p->x.max / p->x.step) * p->x.step < 1.02 * p->x.max)
        p->x.max = ceil(p->x.max / p->x.step) * p->x.step; /* a tick just beyond the end */
    if (chart->y_from_zero)
        p->y.min = 0;
    if (p->y.max - p->y.min <= 1e-9 * fabs(p->y.max)) {
        p->y.max += 0.5 + 0.01 * fabs(p->y.max);
        p->y.min -= chart->y_from_zero ? 0 : 0.5;
    }
    p->y.step = round_step(p->y.max - p->y.min, y_parts);
    p->y.min = floor(p->y.min / p->y.step + 1e-9) * p->y.step;
    p->y.max = ceil(p->y.max / p->y.step - 1e-9) * p->y.step;
    return true;
}

static double place_x(const plot *p, double x)
{
    return LEFT + (x - p->x.min) / (p->x.max - p->x.min) * (p->chart->width - LEFT - RIGHT);
}

static double place_y(const plot *p, double y)
{
    double height = p->chart->height - TOP - BOTTOM;

    return TOP + (p->y.max - y) / (p->y.max - p->y.min) * height;
}

static void put_tick_label(FILE *to, cln_axis axis, double value, double step)
{
    char text[32];

    if (axis == CLN_AXIS_COUNT) {
        char *zero = NULL;

        cln_format_short(value, text);
        zero = strstr(text, ".0");
        if (zero)
            memmove(zero, zero + 2, strlen(zero + 2) + 1);
    } else if (axis == CLN_AXIS_SECONDS && value == 0)
        snprintf(text, sizeof text, "0");
    else if (axis == CLN_AXIS_SECONDS && step < 60)
        snprintf(text, sizeof text, "%g s", value);
    else if (axis == CLN_AXIS_SECONDS && step < 3600)
        snprintf(text, sizeof text, "%g min", value / 60);
    else if (axis == CLN_AXIS_SECONDS)
        snprintf(text, sizeof text, "%g h", value / 3600);
    else
        snprintf(text, sizeof text, "%.*f", step < 1 ? (int)ceil(-log10(step) - 1e-9) : 0, value);
    cln_html_text(to, text);
}

static void put_axes(const plot *p)
{
    const cln_chart *chart = p->chart;
    double bottom = chart->height - BOTTOM, right = chart->width - RIGHT;

    for (double y = p->y.min; y <= p->y.max + 1e-6 * p->y.step; y += p->y.step) {
        fprintf(p->to, "<path class='grid' d='M%d %.1fH%.1f'/>", LEFT, place_y(p, y), right);
        fprintf(p->to, "<text class='tick' x='%d' y='%.1f' text-anchor='end'>", LEFT - 7,
                place_y(p, y) + 4);
        put_tick_label(p->to, chart->y_axis, fabs(y) < 1e-9 * p->y.step ? 0 : y, p->y.step);
        fputs("</text>", p->to);
    }
    for (double x = 0; x <= p->x.max + 1e-6 * p->x.step; x += p->x.step) {
        fprintf(p->to, "<path class='axis' d='M%.1f %.1fv4'/>", place_x(p, x), bottom);
        fprintf(p->to, "<text class='tick' x='%.1f' y='%.1f' text-anchor='middle'>", place_x(p, x),
                bottom + 17);
        put_tick_label(p->to, chart->x_axis, x, p->x.step);
        fputs("</text>", p->to);
    }
    fprintf(p->to, "<path class='axis' d='M%d %.1fH%.1f'/>", LEFT, bottom, right);
    fprintf(p->to, "<text class='label' x='%.1f' y='%d' text-anchor='end'>", right,
            chart->height - 6);
    cln_html_text(p->to, chart->x_label);
    fputs("</text>", p->to);
    for (int i = 0; i < chart->line_count; i++) {
        if (chart->lines[i] > 0 && chart->lines[i] <= p->x.max)
            fprintf(p->to, "<path class='event' d='M%.1f %dV%.1f'/>", place_x(p, chart->lines[i]),
                    TOP, bottom);
    }
    for (int i = 0; i < chart->mark_count; i++) {
        if (chart->marks[i] >= 0 && chart->marks[i] <= p->x.max)
            fprintf(p->to, "<path class='mark' d='M%.1f %.1fv-9'/>", place_x(p, chart->marks[i]),
                    bottom);
    }
}

static void put_line(const plot *p, const cln_series *s)
{
    bool drawing = false;
    double y = 0;

    fprintf(p->to, "<path fill='none' stroke='%s' stroke-width='%s' d='", s->colour,
            s->style == CLN_SERIES_FAINT  ? "1"
            : s->style == CLN_SERIES_DOTS ? "1.2"
                                          : "1.8");
    for (int i = 0; i < s->count; i++) {
        if (!is_point(s, i))
            continue;
        if (drawing && s->style == CLN_SERIES_STEPS)
            fprintf(p->to, "L%.1f %.1f", place_x(p, s->x[i]), y);
        y = place_y(p, s->y[i]);
        fprintf(p->to, "%c%.1f %.1f", drawing ? 'L' : 'M', place_x(p, s->x[i]), y);
        drawing = true;
    }
    fputs("'/>", p->to);
}

static void put_dots(const plot *p, const cln_series *s)
{
    bool ring = s->style == CLN_SERIES_RINGS;

    for (int i = 0; i < s->count; i++) {
        if (is_point(s, i))
            fprintf(p->to,
                    "<circle cx='%.1f' cy='%.1f' r='%s' fill='%s' stroke='%s' stroke-width='1.8'>"
                    "<title>%.2f</title></circle>",
                    place_x(p, s->x[i]), place_y(p, s->y[i]), ring ? "4.5" : "2.6",
                    ring ? "#fff" : s->colour, s->colour, s->y[i]);
    }
}

static void put_legend(const plot *p)
{
    double x = p->chart->width - RIGHT;

    /* Right-aligned with the plot; 5.8 px is the mean advance of a letter of 11.5 px. */
    for (int s = p->chart->series_count - 1; s >= 0; s--) {
        const cln_series *series = &p->chart->series[s];
        bool drawn = false;

        for (int i = 0; i < series->count && !drawn; i++)
            drawn = is_point(series, i);
        if (!series->name || !drawn)
            continue;
        fprintf(p->to, "<text class='label' x='%.1f' y='20' text-anchor='end'>", x);
        cln_html_text(p->to, series->name);
        x -= 5.8 * (double)strlen(series->name) + 6;
        fputs("</text>", p->to);
        if (series->style == CLN_SERIES_RINGS || series->style == CLN_SERIES_DOTS)
            fprintf(p->to,
                    "<circle cx='%.1f' cy='16' r='3.5' fill='%s' stroke='%s' stroke-width='1.8'/>",
                    x - 4, series->style == CLN_SERIES_RINGS ? "#fff" : series->colour,
                    series->colour);
        else
            fprintf(p->to, "<path stroke='%s' stroke-width='%s' d='M%.1f 16h14'/>", series->colour,
                    series->style == CLN_SERIES_FAINT ? "1" : "2", x - 14);
        x -= 28;
    }
}

bool cln_svg_chart(FILE *to, const cln_chart *chart)
{
    plot p = {.to = to, .chart = chart};

    if (!find_ranges(&p))
        return false;
    fprintf(to, "<svg viewBox='0 0 %d %d' role='img' aria-label='", chart->width, chart->height);
    cln_html_text(to, chart->title);
    fputs("'>", to);
    put_axes(&p);
    for (int s = 0; s < chart->series_count; s++) {
        if (chart->series[s].style != CLN_SERIES_RINGS)
            put_line(&p, &chart->series[s]);
    }
    for (int s = 0; s < chart->series_count; s++) {
        if (chart->series[s].style == CLN_SERIES_RINGS || chart->series[s].style == CLN_SERIES_DOTS)
            put_dots(&p, &chart->series[s]);
    }
    fprintf(to, "<text class='title' x='0' y='20'>");
    cln_html_text(to, chart->title);
    fputs("</text>", to);
    put_legend(&p);
    fputs("</svg>\n", to);
    return true;
}
