/* See given.h. */
#include "base/given.h"

cln_status cln_given(const char *call, const char *what, const void *pointer)
{
    return pointer ? CLN_OK : cln_fail(CLN_USAGE, "%s: %s is missing (NULL); give it", call, what);
}

cln_status cln_given_number(const char *call, const char *what, double value, double least,
                            double most)
{
    if (value >= least && value <= most)
        return CLN_OK;
    return cln_fail(CLN_USAGE, "%s: %s is %.10g; give %.10g to %.10g", call, what, value, least,
                    most);
}
