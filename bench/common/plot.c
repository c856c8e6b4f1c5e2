/* The plot of plot.h.
 *
 *     title                 at the end
 *     y |                 | -- label 30.12     plot area: from (LEFT, TOP)
 *       |_________________| -- ...             to (WIDTH - RIGHT, HEIGHT - BOTTOM)
 *               seconds */
#include "common/plot.h"

#include <math.h>
#include <stdbool.h>
#include "report/html.h"
#include "io/progress.h"

enum { WIDTH = 860, HEIGHT = 430, LEFT = 50, RIGHT = 300, TOP = 44, BOTTOM = 48, LEGEND_ROW = 22 };

static const char *const colours[] = {"#2f6da8", "#c2501c", "#4d8a5f", "#8a63a6",
                                      "#c59a2e", "#4f9bab", "#a65068", "#7d8791"};
static const char *const dashes[] = {"", " stroke-dasharray='6 3'", " stroke-dasharray='2 3'"};
enum { COLOURS = sizeof colours / sizeof colours[0], DASHES = sizeof dashes / sizeof dashes[0] };

/* Ticks of a logarithmic time axis at familiar durations, seconds. */
static const double ticks[] = {1e-6, 1e-5, 1e-4,  2e-4,  5e-4,  1e-3,   2e-3,  5e-3,
                               0.01, 0.02, 0.05,  0.1,   0.2,   0.5,    1,     2,
                               5,    10,   30,    60,    120,   300,    600,   1800,
                               3600, 7200, 18000, 36000, 86400, 172800, 432000};

/* Ticks of plain numbers: 1, 2 and 5 times a power of ten. */
enum { DECADES = 12 };

typedef struct frame {
    double x0, x1;         /* natural logarithm of seconds */
    double y0, y1, y_step; /* dB; scaling: decimal logarithm */
    bool scaling;
} frame;

static double level_of(const frame *f, double y)
{
    return f->scaling ? log10(y) : y;
}

static bool is_point(const frame *f, double x, double y)
{
    return x > 0 && isfinite(x) && isfinite(level_of(f, y));
}

static void extend(frame *f, double seconds, double psnr)
{
    if (!is_point(f, seconds, psnr))
        return;
    f->x0 = fmin(f->x0, log(seconds));
    f->x1 = fmax(f->x1, log(seconds));
    f->y0 = fmin(f->y0, level_of(f, psnr));
    f->y1 = fmax(f->y1, level_of(f, psnr));
}

static frame find_frame(const plot_line *lines, int count, bool scaling)
{
    frame f = {INFINITY, -INFINITY, INFINITY, -INFINITY, 1, scaling};
    static const double steps[] = {0.1, 0.2, 0.5, 1, 2, 5, 10, 20};
    size_t s = 0;

    for (int i = 0; i < count; i++) {
        for (int k = 0; k < lines[i].count; k++)
            extend(&f, lines[i].seconds[k], lines[i].psnr[k]);
        if (!scaling)
            extend(&f, lines[i].end_seconds, lines[i].end_psnr);
    }
    if (!(f.x1 >= f.x0))
        f = (frame){log(1), log(60), scaling ? 0 : 20, scaling ? 1 : 30, 1, scaling};
    if (f.x1 - f.x0 < log(4)) /* one point in time, or nearly */
        f.x0 = f.x1 - log(4);
    f.x1 += 0.03 * (f.x1 - f.x0); /* room for the last ring */
    while (s + 1 < sizeof steps / sizeof steps[0] && (f.y1 - f.y0) / steps[s] > 8)
        s++;
    f.y_step = scaling ? 1 : steps[s];
    if (scaling) { /* whole decades */
        f.y0 = floor(f.y0);
        f.y1 = fmax(ceil(f.y1), f.y0 + 1);
        return f;
    }
    f.y0 = floor(f.y0 / f.y_step - 0.2) * f.y_step;
    f.y1 = ceil(f.y1 / f.y_step + 0.2) * f.y_step;
    return f;
}

static double place_x(const frame *f, double seconds)
{
    return LEFT + (log(seconds) - f->x0) / (f->x1 - f->x0) * (WIDTH - LEFT - RIGHT);
}

static double place_y(const frame *f, double psnr)
{
    return TOP + (f->y1 - level_of(f, psnr)) / (f->y1 - f->y0) * (HEIGHT - TOP - BOTTOM);
}

static void put_time(FILE *to, double seconds)
{
    if (seconds < 1e-3)
        fprintf(to, "%g us", seconds * 1e6);
    else if (seconds < 0.1)
        fprintf(to, "%g ms", seconds * 1e3);
    else if (seconds < 60)
        fprintf(to, "%g s", seconds);
    else if (seconds < 3600)
        fprintf(to, "%g min", seconds / 60);
    else if (seconds < 86400)
        fprintf(to, "%g h", seconds / 3600);
    else
        fprintf(to, "%g d", seconds / 86400);
}

static void put_rows(FILE *to, const frame *f)
{
    const int rows = (int)round((f->y1 - f->y0) / f->y_step);
    const int decimals = f->y_step < 1 ? 1 : 0;

    for (int i = 0; i <= rows; i++) {
        const double level = f->y0 + i * f->y_step, y = f->scaling ? pow(10, level) : level;

        fprintf(to, "<path stroke='#e3e7ea' d='M%d %.1fH%d'/>", LEFT, place_y(f, y), WIDTH - RIGHT);
        fprintf(to, "<text x='%d' y='%.1f' text-anchor='end'>", LEFT - 7, place_y(f, y) + 4);
        if (f->scaling)
            fprintf(to, "%g</text>\n", y);
        else
            fprintf(to, "%.*f</text>\n", decimals, y);
    }
}

static void put_axes(FILE *to, const frame *f, const char *x_title)
{
    const int bottom = HEIGHT - BOTTOM, right = WIDTH - RIGHT;
    const int count = f->scaling ? 3 * DECADES : (int)(sizeof ticks / sizeof ticks[0]);
    double last = -WIDTH;

    put_rows(to, f);
    for (int i = 0; i < count; i++) {
        const double x = f->scaling ? (i % 3 == 0   ? 1
                                       : i % 3 == 1 ? 2
                                                    : 5) *
                                          pow(10, i / 3)
                                    : ticks[i];
        char number[32];

        if (log(x) < f->x0 - 1e-9 || log(x) > f->x1 + 1e-9)
            continue;
        fprintf(to, "<path stroke='#8b949b' d='M%.1f %dv5'/>\n", place_x(f, x), bottom);
        if (place_x(f, x) < last + 42) /* the label does not fit */
            continue;
        last = place_x(f, x);
        fprintf(to, "<text x='%.1f' y='%d' text-anchor='middle'>", last, bottom + 19);
        cln_format_short(x, number);
        if (f->scaling)
            fputs(number, to);
        else
            put_time(to, x);
        fputs("</text>\n", to);
    }
    fprintf(to, "<path stroke='#8b949b' d='M%d %dH%d'/>", LEFT, bottom, right);
    fprintf(to, "<text x='%d' y='%d' text-anchor='end'>%s</text>\n", right, HEIGHT - 8, x_title);
}

static void put_hover(FILE *to, const frame *f, double x, double y)
{
    if (f->scaling)
        fprintf(to, "<title>%.4g at %.6g</title></circle>\n", y, x);
    else
        fprintf(to, "<title>%.2f dB after %.4g s</title></circle>\n", y, x);
}

static void put_dot(FILE *to, double x, double y, bool ring, const char *colour)
{
    fprintf(to, "<circle cx='%.1f' cy='%.1f' r='%s' fill='%s' stroke='%s' stroke-width='1.8'>", x,
            y, ring ? "4.5" : "2.4", ring ? "#fff" : colour, colour);
}

static void put_line(FILE *to, const frame *f, const plot_line *line, const char *colour,
                     const char *dash)
{
    bool drawing = false;

    fprintf(to, "<path fill='none' stroke='%s' stroke-width='1.6'%s d='", colour, dash);
    for (int k = 0; k < line->count; k++) {
        if (!is_point(f, line->seconds[k], line->psnr[k]))
            continue;
        fprintf(to, "%c%.1f %.1f", drawing ? 'L' : 'M', place_x(f, line->seconds[k]),
                place_y(f, line->psnr[k]));
        drawing = true;
    }
    fputs("'/>\n", to);
    for (int k = 0; k < line->count; k++) {
        if (!is_point(f, line->seconds[k], line->psnr[k]))
            continue;
        put_dot(to, place_x(f, line->seconds[k]), place_y(f, line->psnr[k]), false, colour);
        put_hover(to, f, line->seconds[k], line->psnr[k]);
    }
    if (!f->scaling && is_point(f, line->end_seconds, line->end_psnr)) {
        put_dot(to, place_x(f, line->end_seconds), place_y(f, line->end_psnr), true, colour);
        put_hover(to, f, line->end_seconds, line->end_psnr);
    }
}

static void put_legend(FILE *to, const plot_line *line, int row, const char *colour,
                       const char *dash)
{
    const int x = WIDTH - RIGHT + 18, y = TOP + 8 + LEGEND_ROW * row;

    fprintf(to, "<path stroke='%s' stroke-width='2'%s d='M%d %dh22'/>", colour, dash, x, y - 4);
    fprintf(to, "<text x='%d' y='%d'>", x + 30, y);
    cln_html_text(to, line->label);
    fputs("</text>", to);
    if (isfinite(line->end_psnr))
        fprintf(to, "<text x='%d' y='%d' text-anchor='end'>%.2f</text>", WIDTH - 10, y,
                line->end_psnr);
    fputc('\n', to);
}

static void put_plot(FILE *to, const frame *f, const plot_text *text, const plot_line *lines,
                     int count)
{
    const int legend = TOP + 8 + LEGEND_ROW * count + 10;
    const int height = legend > HEIGHT ? legend : HEIGHT;

    fprintf(to,
            "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 %d %d' width='%d' height='%d' "
            "font-family='sans-serif' font-size='12' fill='#333'>\n",
            WIDTH, height, WIDTH, height);
    fputs("<title>", to);
    cln_html_text(to, text->title);
    fprintf(to, "</title>\n<rect width='%d' height='%d' fill='#fff'/>\n", WIDTH, height);
    fputs("<text x='10' y='22' font-size='14' font-weight='bold'>", to);
    cln_html_text(to, text->title);
    fputs("</text>\n", to);
    fprintf(to, "<text x='%d' y='22' text-anchor='end'>%s</text>\n", WIDTH - 10, text->legend);
    put_axes(to, f, text->x_label);
    for (int i = 0; i < count; i++) {
        const char *colour = colours[i % COLOURS], *dash = dashes[i / COLOURS % DASHES];

        put_line(to, f, &lines[i], colour, dash);
        put_legend(to, &lines[i], i, colour, dash);
    }
    fputs("</svg>\n", to);
}

void plot_write(FILE *to, const plot_text *text, const plot_line *lines, int count)
{
    const frame f = find_frame(lines, count, false);

    put_plot(to, &f, text, lines, count);
}

void plot_write_scaling(FILE *to, const plot_text *text, const plot_line *lines, int count)
{
    const frame f = find_frame(lines, count, true);

    put_plot(to, &f, text, lines, count);
}
