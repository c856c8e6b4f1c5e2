/* Adam with bias correction (method.md 11), on a block of parameters. See reference.h. */
#include <math.h>
#include "reference/reference.h"

void ref_adam(int n, double *param, const double *grad, double *m, double *v, int64_t steps,
              double lr, double beta1, double beta2, double epsilon)
{
    for (int i = 0; i < n; i++) {
        double mean = 0, variance = 0;

        m[i] = beta1 * m[i] + (1 - beta1) * grad[i];
        v[i] = beta2 * v[i] + (1 - beta2) * grad[i] * grad[i];
        mean = m[i] / (1 - pow(beta1, (double)steps));
        variance = v[i] / (1 - pow(beta2, (double)steps));
        param[i] -= lr * mean / (sqrt(variance) + epsilon);
    }
}
