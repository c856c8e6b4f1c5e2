/* Eigenvalues of small symmetric matrices. */
#ifndef CLN_EIGEN_H
#define CLN_EIGEN_H

enum { CLN_EIGEN_MOST = 4 };

/* Of matrix [n][n], n of 2 to CLN_EIGEN_MOST: value [n] ascending, and rows of vector [n][n] that
 * are their unit vectors, by Jacobi's turns. */
void cln_eigen(int n, const double *matrix, double *value, double *vector);

/* The inverse of a symmetric 3x3 matrix, row-major, none of whose eigenvalues is negative but by
 * rounding: they count as `least` times the largest at least, and as 1e-30. */
void cln_eigen_invert(const double m[9], double least, double out[9]);

#endif
