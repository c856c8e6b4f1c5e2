/* What a caller of the library must give, and settings where none are given. */
#ifndef CLN_BASE_GIVEN_H
#define CLN_BASE_GIVEN_H

#include "base/settings.h"
#include "base/status.h"

/* CLN_USAGE if the pointer is NULL: "CALL: WHAT is missing (NULL); give it". */
cln_status cln_given(const char *call, const char *what, const void *pointer);

/* CLN_USAGE if the number is outside its range, or none. */
cln_status cln_given_number(const char *call, const char *what, double value, double least,
                            double most);

/* *own: the default preset's settings if none are given, else NULL; the caller frees it. Returns
 * those that count in *use. */
cln_status cln_given_settings(const cln_settings *given, cln_settings **own,
                              const cln_settings **use);

#endif
