/* The frequency encoding (method.md 1), twin of kernels/encoding_frequency.h. See reference.h and
 * model/encoding.h. */
#include <math.h>
#include "reference/reference.h"

void ref_encode(int bands, const double x[3], const double *weights, int pad, double *out)
{
    for (int i = 0; i < pad; i++)
        out[i] = 0;
    for (int a = 0; a < 3; a++)
        out[a] = x[a];
    for (int k = 0; k < bands; k++) {
        double weight = weights ? weights[k] : 1;

        for (int a = 0; a < 3; a++) {
            out[3 + 6 * k + a] = weight * sin(ldexp(x[a], k));
            out[6 + 6 * k + a] = weight * cos(ldexp(x[a], k));
        }
    }
}
