/* PSNR and leaves against seconds of a training of any length, in a bounded number of points: when
 * they are full, every second point is dropped. */
#ifndef CLN_CURVE_H
#define CLN_CURVE_H

enum { CLN_CURVE_POINTS = 256 };

typedef struct cln_curve_point {
    double seconds, train, test; /* PSNRs in dB; NaN = none */
    int leaves;
} cln_curve_point;

/* The owner zeroes it and sets `every`. */
typedef struct cln_curve {
    double every; /* least seconds between points without a test PSNR; doubles */
    int count;
    cln_curve_point points[CLN_CURVE_POINTS];
} cln_curve;

/* Adds a point, unless it has no test PSNR and the last one is near. */
void cln_curve_add(cln_curve *curve, const cln_curve_point *point);

#endif
