/* Lines in an SVG file of its own, with a legend beside the plot: decibels over seconds on a
 * logarithmic axis, or a quantity over the work that it grows with. The report's charts, which have
 * a style sheet and axes from 0, are host/report/svg.h. */
#ifndef BENCH_PLOT_H
#define BENCH_PLOT_H

#include <stdio.h>

typedef struct plot_line {
    const char *label;
    int count;
    const double *seconds, *psnr; /* [count] ascending; points that are not finite are left out */
    double end_seconds, end_psnr; /* the last evaluation: a ring, not on the line; NaN = none */
} plot_line;

typedef struct plot_text {
    const char *title, *x_label, *legend; /* legend: what the numbers in it are */
} plot_text;

/* Without a finite point the plot has its axes alone. The caller sets the locale to "C". */
void plot_write(FILE *to, const plot_text *text, const plot_line *lines, int count);

/* The same for other quantities, both axes logarithmic: `seconds` has x, `psnr` y; end_psnr is
 * written in the legend alone. */
void plot_write_scaling(FILE *to, const plot_text *text, const plot_line *lines, int count);

#endif
