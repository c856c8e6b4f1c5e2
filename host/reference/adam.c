/* Adam with bias correction (method.md 11), on a block of parameters. See reference.h. */
#include <math.h>
#include "reference/reference.h"

void ref_adam(int n, double *param, const double *grad, double *m, double *v, int64_t steps,
              ref_adam_rule rule)
{
    for (int i = 0; i < n; i++) {
        double mean = 0, variance = 0;

        m[i] = rule.beta1 * m[i] + (1 - rule.beta1) * grad[i];
        v[i] = rule.beta2 * v[i] + (1 - rule.beta2) * grad[i] * grad[i];
        mean = m[i] / (1 - pow(rule.beta1, (double)steps));
        variance = v[i] / (1 - pow(rule.beta2, (double)steps));
        param[i] -= rule.lr * mean / (sqrt(variance) + rule.epsilon);
    }
}
