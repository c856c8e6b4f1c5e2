/* What stands behind the opaque cln_settings of cl_nascent.h: the values, where they began, and
 * which were given. Inside the library the values are read as plain fields of cln_config. */
#ifndef CLN_BASE_SETTINGS_H
#define CLN_BASE_SETTINGS_H

#include "base/config.h"

enum { CLN_SETTINGS_MAX = 160, CLN_PRESET_BYTES = 16 }; /* rows there is room for */

struct cln_settings {
    cln_config config;
    cln_config base;               /* the preset's, or the run's */
    char preset[CLN_PRESET_BYTES]; /* its name; "" for a run's settings */
    bool given[CLN_SETTINGS_MAX];  /* by row: set after that */
};

/* Whether this row was given, rather than left at the preset's or the run's value. */
bool cln_settings_given(const cln_settings *settings, const cln_config_row *row);

/* What a training knows besides its settings. */
typedef struct cln_settings_facts {
    bool resume;    /* the run has begun before */
    bool has_alpha; /* its images have */
} cln_settings_facts;

/* A warning in the log for each setting that was given and has no effect with the others and the
 * facts. */
void cln_settings_warn_idle(const cln_settings *settings, const cln_settings_facts *facts);

#endif
