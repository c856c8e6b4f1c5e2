/* See allowance.h. */
#include "train/allowance.h"

#include <math.h>

bool cln_allowance_pass(cln_allowance *a, double now)
{
    a->credit = fmin(a->credit + a->share * (now - a->at), a->most);
    a->at = now;
    return a->credit >= 0;
}

void cln_allowance_spend(cln_allowance *a, double seconds)
{
    a->credit -= seconds;
}
