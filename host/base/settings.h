/* The opaque cln_settings of cl_nascent.h: values, the preset's or run's values that they began
 * with, and which ones were given. The library reads values as plain fields of cln_config. */
#ifndef CLN_BASE_SETTINGS_H
#define CLN_BASE_SETTINGS_H

#include "base/config.h"

enum { CLN_SETTINGS_MAX = 160, CLN_PRESET_BYTES = 16 }; /* most rows; bytes of a name */

struct cln_settings {
    cln_config config;
    cln_config base;               /* the preset's, or the run's */
    char preset[CLN_PRESET_BYTES]; /* its name; "" for a run's settings */
    bool given[CLN_SETTINGS_MAX];  /* [row] set explicitly */
    cln_config used;               /* of a run: its CLN_ROW_BUDGET are where it ended, or 0 */
    char *run;                     /* NULL: they are no run's */
};

/* Returns whether this row was set explicitly. */
bool cln_settings_given(const cln_settings *settings, const cln_config_row *row);

/* The same of a row by its option's name, which must be one. */
bool cln_settings_has(const cln_settings *settings, const char *option);

/* Of a run that goes on by the line that it began with: what is given again with the value that the
 * run has counts as not given, and no warning says that it comes too late. */
void cln_settings_forget_same(cln_settings *settings);

/* The epochs of a new training over so many training pixels: those that are given; else the
 * preset's, but of voxels as many as CLN_VOXEL_STEPS steps are, or more: each level and the first
 * splits wait for steps, not for epochs. Beside steps or a time, epochs are no budget, and stay the
 * preset's. */
enum { CLN_VOXEL_STEPS = 1500 };
int cln_settings_epochs(const cln_settings *settings, double pixels);

/* Facts about a training besides its settings. */
typedef struct cln_settings_facts {
    bool resume;     /* it resumes a run */
    bool grown;      /* its tree has grown to the last level of --level-at, new and old */
    bool frozen;     /* its tree no longer adapts, by both --structure-until */
    bool past_crop;  /* its steps are beyond both --precrop-steps */
    bool has_alpha;  /* its images have alpha */
    bool forward;    /* its space is normalised device coordinates */
    bool shell;      /* its space is a cube and a shell */
    int ranks;       /* processes */
    bool no_sights;  /* no sparse point comes with the training images that show it */
    bool no_box;     /* no box is known within the cube */
    bool has_splits; /* its dataset names the splits */
    bool few_views;  /* --seen-by asks for more training views than there are */
    bool no_tests;   /* there is no test view */
    bool no_masks;   /* no photo has a mask */
} cln_settings_facts;

/* Why the row's setting has no effect with the others and the facts: reason; way out. NULL if it
 * has one. */
const char *cln_settings_why_idle(const cln_config *config, const cln_settings_facts *facts,
                                  const cln_config_row *row);

/* Warns in the log of each given setting that has no effect with the others and the facts. */
void cln_settings_warn_idle(const cln_settings *settings, const cln_settings_facts *facts);
/* Warns of points of --eval-at and --save-at that the budget does not come to. */
void cln_settings_warn_points(const cln_config *config);

/* *own: the default preset's settings if none are given, else NULL; the caller frees it. Returns
 * those that count in *use. */
cln_status cln_given_settings(const cln_settings *given, cln_settings **own,
                              const cln_settings **use);

#endif
