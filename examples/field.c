/* Evaluates a trained scene at points: prints a slice through the middle of its box as text, denser
 * is darker, and the colour of the slice's densest point seen from above.
 *   cc field.c $(pkg-config --cflags --libs cl-nascent) -lm -o field
 *   ./field RUN */
#include <cl_nascent.h>

#include <math.h>
#include <stdio.h>

enum { COLUMNS = 64, ROWS = 32, POINTS = COLUMNS * ROWS };

static double at[POINTS][3];
static float sigma[POINTS];

static cln_status show(cln_field *field)
{
    static const char shades[] = " .:-=+*#%@";
    const float down[1][3] = {{0, 0, -1}};
    double min[3], max[3];
    float rgb[1][3];
    int densest = 0;
    cln_status st = CLN_OK;

    cln_field_box(field, min, max);
    for (int i = 0; i < POINTS; i++) {
        const double u = (i % COLUMNS + 0.5) / COLUMNS, v = (i / COLUMNS + 0.5) / ROWS;

        at[i][0] = min[0] + u * (max[0] - min[0]);
        at[i][1] = max[1] - v * (max[1] - min[1]);
        at[i][2] = 0.5 * (min[2] + max[2]);
    }
    /* Density in the box does not depend on the direction, so it needs none. */
    st = cln_field_at(field, POINTS, (const double(*)[3])at, NULL, NULL, sigma);
    if (st != CLN_OK)
        return st;
    for (int i = 0; i < POINTS; i++) {
        /* opacity of a column of this point's width */
        const double opacity = 1 - exp(-sigma[i] * (max[0] - min[0]) / COLUMNS);

        putchar(shades[(int)(9.999 * opacity)]);
        if (i % COLUMNS == COLUMNS - 1)
            putchar('\n');
        densest = sigma[i] > sigma[densest] ? i : densest;
    }
    st = cln_field_at(field, 1, (const double(*)[3])at[densest], down, rgb, NULL);
    if (st == CLN_OK)
        printf("densest at %.3f, %.3f, %.3f: %.3g per unit, from above %.2f, %.2f, %.2f\n",
               at[densest][0], at[densest][1], at[densest][2], sigma[densest], rgb[0][0], rgb[0][1],
               rgb[0][2]);
    return st;
}

int main(int argc, char **argv)
{
    cln_field *field = NULL;
    cln_status st = CLN_OK;

    if (argc != 2) {
        fprintf(stderr, "usage: %s RUN\n", argv[0]);
        return 2;
    }
    st = cln_field_open(argv[1], NULL, &field); /* NULL: any device */
    if (st == CLN_OK)
        st = show(field);
    if (st != CLN_OK)
        fprintf(stderr, "%s: %s\n", argv[0], cln_error_text());
    cln_field_close(field);
    return cln_status_exit_code(st);
}
