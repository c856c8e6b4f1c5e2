/* Evaluates a trained scene at points, and renders it into memory: prints a slice through the
 * middle of its box as text, denser is darker, the colour of the slice's densest point seen from
 * above, and a picture from above, more opaque is darker, with its mean colour.
 *   cc field.c $(pkg-config --cflags --libs cl-nascent) -lm -o field
 *   ./field RUN */
#include <cl_nascent.h>

#include <math.h>
#include <stdio.h>

enum { COLUMNS = 64, ROWS = 32, POINTS = COLUMNS * ROWS };

static const char shades[] = " .:-=+*#%@";
static double at[POINTS][3];
static float sigma[POINTS], rgb[POINTS][3], opacity[POINTS];

static void print_shade(int i, double share)
{
    putchar(shades[(int)(9.999 * share)]);
    if (i % COLUMNS == COLUMNS - 1)
        putchar('\n');
}

static cln_status show_slice(cln_field *field)
{
    const float down[1][3] = {{0, 0, -1}};
    double min[3], max[3];
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
        print_shade(i, 1 - exp(-sigma[i] * (max[0] - min[0]) / COLUMNS));
        densest = sigma[i] > sigma[densest] ? i : densest;
    }
    st = cln_field_at(field, 1, (const double(*)[3])at[densest], down, rgb, NULL);
    if (st == CLN_OK)
        printf("densest at %.3f, %.3f, %.3f: %.3g per unit, from above %.2f, %.2f, %.2f\n",
               at[densest][0], at[densest][1], at[densest][2], sigma[densest], rgb[0][0], rgb[0][1],
               rgb[0][2]);
    return st;
}

static cln_status show_from_above(cln_field *field)
{
    double min[3], max[3], mean[3] = {0, 0, 0}, seen = 0;
    cln_frame_desc frame = {.width = COLUMNS, .height = ROWS, .cx = COLUMNS / 2, .cy = ROWS / 2};
    cln_status st = CLN_OK;

    cln_field_box(field, min, max);
    /* right is x, down is -y, forward is -z: the columns of a rotation; then the position, at which
     * the picture is as wide as the box at its middle; characters are twice as high as wide */
    frame.fx = 1.5 * COLUMNS;
    frame.fy = 1.5 * ROWS;
    frame.c2w[0] = 1;
    frame.c2w[5] = frame.c2w[10] = -1;
    frame.c2w[3] = 0.5 * (min[0] + max[0]);
    frame.c2w[7] = 0.5 * (min[1] + max[1]);
    frame.c2w[11] = 0.5 * (min[2] + max[2]) + 1.5 * (max[0] - min[0]);
    st = cln_field_render(field, &frame, rgb[0], NULL, opacity); /* NULL: no depth */
    for (int i = 0; i < POINTS && st == CLN_OK; i++) {
        print_shade(i, opacity[i]);
        for (int c = 0; c < 3; c++)
            mean[c] += opacity[i] * rgb[i][c];
        seen += opacity[i];
    }
    if (st == CLN_OK && seen > 0)
        printf("from above: %.0f %% of the picture, mean colour %.2f, %.2f, %.2f\n",
               100 * seen / POINTS, mean[0] / seen, mean[1] / seen, mean[2] / seen);
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
        st = show_slice(field);
    if (st == CLN_OK)
        st = show_from_above(field);
    if (st != CLN_OK)
        fprintf(stderr, "%s: %s\n", argv[0], cln_error_text());
    cln_field_close(field);
    return cln_status_exit_code(st);
}
