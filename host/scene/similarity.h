/* Similarities: turn, scale and shift that bring points to places. */
#ifndef CLN_SIMILARITY_H
#define CLN_SIMILARITY_H

#include "base/status.h"

/* out = scale turn at + shift; turn: a rotation, rows. */
typedef struct cln_similarity {
    double scale, turn[9], shift[3];
} cln_similarity;

void cln_similarity_apply(const cln_similarity *s, const double at[3], double out[3]);

/* Turns what it brings about 0, by this vector: axis times radians. */
void cln_similarity_turn(cln_similarity *s, const double by[3]);

/* Makes *s what it does behind a turn by `first`, whose scale is 1 and shift 0. */
void cln_similarity_before(cln_similarity *s, const cln_similarity *first);

/* How well it is known by places with errors that are independent of each other. */
typedef struct cln_similarity_doubt {
    double turn[9];  /* covariance of a rotation vector, radians^2; symmetric */
    double north;    /* standard deviation of the turn about z if z is right, radians */
    double scale;    /* that of the scale, relative */
    double apart[3]; /* that of the places, an axis */
    int count;       /* places that have a weight */
} cln_similarity_doubt;

/* The similarity of most of three points or more [count] and their places: up to 40 % may be
 * anywhere. Least squares with Tukey's weights, from that of all, or of the three, of many drawn,
 * which half of all fit best (least median of squares: Rousseeuw, J. Am. Stat. Assoc. 1984),
 * whichever ends better; a function of the numbers alone. CLN_MEMORY. */
cln_status cln_similarity_fit(int count, double (*from)[3], double (*to)[3], cln_similarity *out);

/* Likewise with turns about z alone: those of a plane are not turned over. CLN_MEMORY. */
cln_status cln_similarity_fit_flat(int count, double (*from)[3], double (*to)[3],
                                   cln_similarity *out);

/* Fits again from *s on: turns about z, scale and shift alone. CLN_MEMORY. */
cln_status cln_similarity_fit_level(int count, double (*from)[3], double (*to)[3],
                                    cln_similarity *s);

/* CLN_MEMORY. */
cln_status cln_similarity_judge(int count, double (*from)[3], double (*to)[3],
                                const cln_similarity *s, cln_similarity_doubt *out);

#endif
