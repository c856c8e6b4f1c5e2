/* The rows of config_rows.h as data: presets, setting by text, to and from JSON, comparison. For
 * the command line's parser and help, run.json and checkpoints. */
#ifndef CLN_BASE_CONFIG_H
#define CLN_BASE_CONFIG_H

#include <jansson.h>
#include <stddef.h>
#include "base/config_rows.h"
#include "base/status.h"

typedef enum { CLN_ROW_INT, CLN_ROW_REAL, CLN_ROW_BOOL, CLN_ROW_ENUM, CLN_ROW_TEXT } cln_row_type;

typedef struct cln_config_row {
    cln_row_type type;
    const char *field, *option, *help;
    const char *words; /* ENUM: "a|b|c" */
    double min, max;   /* INT, REAL */
    size_t offset;     /* into cln_config */
    const char *group; /* "network", "tree", "sampling", "optim", "run" */
    unsigned flags;    /* CLN_ROW_FIXED ... */
    const char *alias; /* an earlier name of the option; NULL = none */
} cln_config_row;

extern const cln_config_row cln_config_rows[];
extern const int cln_config_row_count;

/* The groups of rows in the order of help and report, with their titles. */
enum { CLN_CONFIG_GROUPS = 5 };
enum { CLN_MOST_DOWNSCALE = 64 }; /* of --downscale */
extern const char *const cln_config_groups[CLN_CONFIG_GROUPS][2];

/* Returns whether the first `length` characters of name are the row's option or alias. */
bool cln_config_named(const cln_config_row *row, const char *name, size_t length);

/* Returns whether the option may stand without a value, and as --no-option. */
bool cln_config_is_switch(const cln_config_row *row);

/* Returns whether the text is one of the row's words (ENUM). */
bool cln_config_is_word(const cln_config_row *row, const char *text);

/* The row of an option name or alias ("rays", without dashes), or of a key of run.json
 * ("view_width"), also of an older one ("t_min"), or NULL; and for misspelt names the
 * nearest option, or NULL if none is near. */
const cln_config_row *cln_config_find(const char *option);
const char *cln_config_nearest(const char *option);

#define CLN_PRESETS        "voxel|fast|paper|nerf|kilonerf"
#define CLN_DEFAULT_PRESET "voxel" /* best by error against run time: docs/results.md */

/* *out = preset "fast" or "paper"; "voxel" (no networks); or a baseline, "nerf" (one network) or
 * "kilonerf" (a uniform grid of small ones, from scratch); these three otherwise fast.
 * CLN_USAGE for another name. */
cln_status cln_config_preset(const char *name, cln_config *out);

/* Sets a value from text, range-checked, independent of LC_NUMERIC. Units by the row's flags
 * (CLN_ROW_SECONDS, _BYTES, _AUTO); BOOL and CLN_ROW_SWITCH take yes|no|true|false|1|0.
 * CLN_USAGE names the option, the text and the legal range, and leaves *config as it is. */
cln_status cln_config_set(cln_config *config, const cln_config_row *row, const char *text);

/* Its parsers, for options outside the table. */
cln_status cln_parse_bytes(const char *option, const char *text, double *bytes);
cln_status cln_parse_reals(const char *text, int count, double *out); /* "a,b,c" */

/* The value as text that cln_config_set reads back exactly. */
void cln_config_text(const cln_config *config, const cln_config_row *row, char out[CLN_TEXT_BYTES]);

/* To and from a JSON object of field -> value (ENUM as its word). An unknown or missing key is
 * CLN_INPUT; but an alias may replace its row's key, and a missing CLN_ROW_LATER row gets its paper
 * value. */
cln_status cln_config_to_json(const cln_config *config, json_t **out);
cln_status cln_config_from_json(const json_t *object, cln_config *out);

/* The first row with all these flags whose values differ, or NULL. */
const cln_config_row *cln_config_differs(const cln_config *a, const cln_config *b, unsigned flags);

/* Checks the rules that bind several values, and TEXT rows. CLN_USAGE. */
cln_status cln_config_check(const cln_config *config);

/* n x n rays that pixels at edges get once averages begin. */
int cln_config_antialias(const cln_config *config);

/* The most rays a batch ever has: --rays, or 8 times that with --leaf-samples. */
int cln_config_most_rays(const cln_config *config);

/* Largest number of leaves during training, in a shell space or another: at the start, by growth,
 * or --max-leaves, beyond which voxels that adapt do not grow. */
int cln_config_most_leaves(const cln_config *config, bool shell);

/* Leaves of the tree that a training begins with, before those that are empty are culled. */
int cln_config_first_leaves(const cln_config *config, bool shell);

/* Steps of --epochs over a scene with so many training pixels: an epoch draws a tenth of them
 * (method.md 11). */
int64_t cln_config_epoch_steps(const cln_config *config, double pixels);

/* The epochs, of such a scene, that so many steps are. */
double cln_config_step_epochs(const cln_config *config, double pixels, int64_t steps);

/* How leaves of a kind, a word of --encoding, behave. Code that depends on their numbers asks for
 * the word itself. */
typedef struct cln_leaf_kind {
    const char *name;  /* "networks" or "voxels" */
    bool network;      /* a leaf has layers */
    bool merges;       /* eight leaves may become one, which is trained on what they were */
    bool joined;       /* leaves of one size have common vertices with their neighbours */
    bool levels_first; /* in a tree that adapts, whole levels come before the first decision */
} cln_leaf_kind;
const cln_leaf_kind *cln_leaf_kind_of(int encoding);

/* Deepest level that leaves may have. */
int cln_config_deepest(const cln_config *config);

/* Whether leaves may merge: the tree adapts, and leaves are networks, which are trained on what
 * they replace. Voxels only split. */
bool cln_config_merges(const cln_config *config);

/* "2:0.067,3:0.133" -> fraction[level], 2 (= never) for levels not named. */
cln_status cln_config_levels(const cln_config *config, double fraction[CLN_LEVELS]);

/* out = those of "2:0.067,3:0.133" whose level is above `above` and at most `most`. */
void cln_config_keep_levels(const char *level_at, int above, int most, char out[CLN_TEXT_BYTES]);

/* "60s,2m,5000" -> points in the given, ascending order; seconds[i] > 0 or steps[i] > 0. */
enum { CLN_POINTS = 32 };
typedef struct cln_points {
    int count, steps[CLN_POINTS];
    double seconds[CLN_POINTS];
} cln_points;
cln_status cln_config_points(const char *option, const char *text, cln_points *out);

/* "auto", "mean", "white", "black" or "r,g,b"; rgb is white for the first two. */
typedef enum cln_background_kind {
    CLN_BACKGROUND_GIVEN,
    CLN_BACKGROUND_MEAN, /* the mean colour of the training photos */
    CLN_BACKGROUND_AUTO  /* by the photos: scene/background.c */
} cln_background_kind;
cln_status cln_config_background(const cln_config *config, cln_background_kind *kind, float rgb[3]);

/* "white", "black" or "r,g,b"; words: further ones that its sentence names, each with a comma and a
 * space behind. CLN_USAGE. */
cln_status cln_background_read(const char *text, const char *words, float rgb[3]);

#endif
