/* A stand-alone SVG file of lines with a legend beside the plot: decibels over seconds on a
 * logarithmic axis, or a quantity over the work that it grows with. host/report/svg.h draws the
 * report's charts, which have a style sheet and axes from 0. */
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
    const char *title, *x_label, *legend; /* legend: heading of its numbers */
} plot_text;

/* A plot without a finite point shows only its axes. The caller sets the locale to "C". */
void plot_write(FILE *to, const plot_text *text, const plot_line *lines, int count);

/* The same for other quantities, both axes logarithmic: `seconds` holds x, `psnr` y; end_psnr
 * appears only in the legend. */
void plot_write_scaling(FILE *to, const plot_text *text, const plot_line *lines, int count);

#endif
