/* What a caller of the library must give. */
#ifndef CLN_BASE_GIVEN_H
#define CLN_BASE_GIVEN_H

#include "base/status.h"

/* CLN_USAGE if the pointer is NULL: "CALL: WHAT is missing (NULL); give it". */
cln_status cln_given(const char *call, const char *what, const void *pointer);

/* CLN_USAGE if the number is outside its range, or none. */
cln_status cln_given_number(const char *call, const char *what, double value, double least,
                            double most);

#endif
