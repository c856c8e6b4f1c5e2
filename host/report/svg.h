/* Line charts as inline SVG: axes with round ticks, a few series, a legend. Numbers are printed in
 * the current locale; the caller sets it to "C". */
#ifndef CLN_SVG_H
#define CLN_SVG_H

#include <stdbool.h>
#include <stdio.h>

typedef enum { CLN_AXIS_NUMBER, CLN_AXIS_COUNT, CLN_AXIS_SECONDS } cln_axis;

typedef enum {
    CLN_SERIES_LINE,
    CLN_SERIES_FAINT, /* a thin line behind the others */
    CLN_SERIES_STEPS, /* keeps its value until the next point */
    CLN_SERIES_DOTS,  /* points on a line */
    CLN_SERIES_RINGS  /* points only */
} cln_series_style;

typedef struct cln_series {
    const char *name; /* for the legend; NULL = not in it */
    const char *colour;
    cln_series_style style;
    int count;
    const double *x, *y; /* [count], x ascending; points with a NaN are left out */
} cln_series;

typedef struct cln_chart {
    const char *title, *x_label;
    cln_axis x_axis, y_axis;
    int width, height;
    bool y_from_zero;
    int series_count;
    const cln_series *series;
    int line_count; /* dashed vertical lines at x */
    const double *lines;
    int mark_count; /* short marks at the foot of the plot at x */
    const double *marks;
} cln_chart;

/* False (and nothing written) if there is no finite point to draw. x starts at 0. */
bool cln_svg_chart(FILE *to, const cln_chart *chart);

#endif
