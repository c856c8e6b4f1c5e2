/* Several lines as one stand-alone SVG file: decibels over seconds, with a logarithmic time axis, since what a
 * bench compares differs by factors, or anything over what it grows with; and a legend beside the plot. The report's
 * own charts are io/svg.h;
 * they have a style sheet around them and an axis from 0. */
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

/* A plot without any finite point has its axes alone. Numbers in the C locale: the caller's business. */
void plot_write(FILE *to, const plot_text *text, const plot_line *lines, int count);

/* The same with other quantities: `seconds` is a number of x, `psnr` one of y, both axes logarithmic; end_psnr is
 * written in the legend alone. */
void plot_write_scaling(FILE *to, const plot_text *text, const plot_line *lines, int count);

#endif
