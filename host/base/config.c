/* The option table as data. See config.h. The rows expand once into descriptions, and once for each
 * of the presets fast and paper into values; the baselines nerf and kilonerf are rows on top of
 * fast. Everything else walks the descriptions. config_check.c has the rules that bind several rows
 * and the small languages inside TEXT rows. */
#include "base/config.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/number.h"
#include "base/text.h"

/* Members of every type of row, and the flags and alias that follow its help. */
#define ROW(row_type, row_field, row_option, row_help, ...) \
    {.type = row_type,                                      \
     .field = #row_field,                                   \
     .option = row_option,                                  \
     .help = row_help,                                      \
     .offset = offsetof(cln_config, row_field),             \
     .group = GROUP,                                        \
     __VA_ARGS__},
#define ROW_INT(field, option, paper, fast, low, high, help, ...) \
    ROW(CLN_ROW_INT, field, option, help, .min = low, .max = high, __VA_ARGS__)
#define ROW_REAL(field, option, paper, fast, low, high, help, ...) \
    ROW(CLN_ROW_REAL, field, option, help, .min = low, .max = high, __VA_ARGS__)
#define ROW_BOOL(field, option, paper, fast, help, ...) \
    ROW(CLN_ROW_BOOL, field, option, help, .max = 1, __VA_ARGS__)
#define ROW_ENUM(field, option, paper, fast, list, help, ...) \
    ROW(CLN_ROW_ENUM, field, option, help, .words = list, __VA_ARGS__)
#define ROW_TEXT(field, option, paper, fast, help, ...) \
    ROW(CLN_ROW_TEXT, field, option, help, __VA_ARGS__)

/* clang-format off */
const cln_config_row cln_config_rows[] = {
#define GROUP "network"
    CLN_CONFIG_NETWORK(ROW_INT, ROW_REAL, ROW_BOOL, ROW_ENUM, ROW_TEXT)
#undef GROUP
#define GROUP "tree"
    CLN_CONFIG_TREE(ROW_INT, ROW_REAL, ROW_BOOL, ROW_ENUM, ROW_TEXT)
#undef GROUP
#define GROUP "sampling"
    CLN_CONFIG_SAMPLING(ROW_INT, ROW_REAL, ROW_BOOL, ROW_ENUM, ROW_TEXT)
#undef GROUP
#define GROUP "optim"
    CLN_CONFIG_OPTIM(ROW_INT, ROW_REAL, ROW_BOOL, ROW_ENUM, ROW_TEXT)
#undef GROUP
#define GROUP "run"
    CLN_CONFIG_RUN(ROW_INT, ROW_REAL, ROW_BOOL, ROW_ENUM, ROW_TEXT)
#undef GROUP
};
/* clang-format on */

const char *const cln_config_groups[CLN_CONFIG_GROUPS][2] = {
    {"run", "Data, budgets, output"},
    {"network", "Leaves: voxels or networks"},
    {"tree", "Octree"},
    {"sampling", "Sampling"},
    {"optim", "Loss and optimiser"}};

const int cln_config_row_count = sizeof cln_config_rows / sizeof cln_config_rows[0];

#define PAPER_NUMBER(field, option, paper, fast, min, max, help, ...) .field = paper,
#define PAPER_BOOL(field, option, paper, fast, help, ...)             .field = paper,
#define PAPER_ENUM(field, option, paper, fast, words, help, ...)      .field = paper,
#define PAPER_TEXT(field, option, paper, fast, help, ...)             .field = paper,
#define FAST_NUMBER(field, option, paper, fast, min, max, help, ...)  .field = fast,
#define FAST_BOOL(field, option, paper, fast, help, ...)              .field = fast,
#define FAST_ENUM(field, option, paper, fast, words, help, ...)       .field = fast,
#define FAST_TEXT(field, option, paper, fast, help, ...)              .field = fast,

static const cln_config preset_paper = {
    CLN_CONFIG_LIST(PAPER_NUMBER, PAPER_NUMBER, PAPER_BOOL, PAPER_ENUM, PAPER_TEXT)};
static const cln_config preset_fast = {
    CLN_CONFIG_LIST(FAST_NUMBER, FAST_NUMBER, FAST_BOOL, FAST_ENUM, FAST_TEXT)};

/* ---- baselines: other methods' shapes in this program ----
 *
 * Each is the fast preset with these rows changed, so that a comparison has the same rays, budget,
 * loss and machine, and differs in the scene's representation. They are not the authors' programs:
 * density activation, batch and losses are this program's. */
typedef struct setting {
    const char *option, *value;
} setting;

/* NeRF (Mildenhall et al., arXiv 2003.08934, section 5 and appendix A; bmild/nerf: run_nerf.py):
 * one network for the whole cube, 8 x 256 with the encoding again at layer 5, view layer 128, 10
 * and 4 frequencies, ReLU, Adam and its rates. Left out: the linear layer before the view layer
 * (method.md section 1) and the coarse network. Stage 1 replaces the coarse network: 64 cells along
 * an axis for its 64 samples of a ray, refreshed at least every 64 steps, as NeRF's is never stale.
 * Stage 2 follows the compositing weight, like NeRF's fine samples, 64 for an opaque ray: the fast
 * preset's 8 a leaf are too few for a leaf that is the whole cube. No culling: there is one
 * leaf. */
static const setting nerf[] = {
    {"start-level", "0"},
    {"level-at", ""},
    {"adaptive", "no"},
    {"cull-from", "1"},
    {"width", "256"},
    {"depth", "8"},
    {"skip", "yes"},
    {"view-width", "128"},
    {"bands", "10"},
    {"view-bands", "4"},
    {"rrelu-lower", "0"},
    {"rrelu-upper", "0"},
    {"lr", "5e-4"},
    {"lr-final", "5e-5"},
    {"beta2", "0.999"},
    {"epsilon", "1e-7"},
    {"n1", "64"},
    {"refresh-every", "64"},
    {"cdf", "weight"},
    {"samples-per-leaf", "64"},
    {"samples-per-ray", "64"},
    {"min-leaf-samples", "1"},
};

/* KiloNeRF (Reiser et al., arXiv 2103.13744; creiser/kilonerf: cfgs/): a uniform grid of networks,
 * each two layers of 32 and a view layer of 32, 10 and 4 frequencies, ReLU. This one has 16^3 cells
 * over the cube, the original a grid over each scene's tight box (lego: 9 x 16 x 10). This one
 * trains from scratch, while the original distils a trained NeRF into the grid and fine-tunes with
 * a weight on the view layer: without that teacher it has KiloNeRF's shape, not its quality.
 * Culling and stage 1 replace its occupancy grid. */
static const setting kilonerf[] = {
    {"start-level", "4"}, {"level-at", ""},     {"adaptive", "no"},   {"width", "32"},
    {"depth", "2"},       {"skip", "no"},       {"view-width", "32"}, {"bands", "10"},
    {"view-bands", "4"},  {"rrelu-lower", "0"}, {"rrelu-upper", "0"},
};

/* Voxels instead of networks (method.md section 1): leaves of 8 cells an axis, whole levels first,
 * then single leaves down to level 7. The numbers are measured: docs/results.md, "Voxels". */
static const setting voxel[] = {
    {"encoding", "voxel"},
    {"density-scale", "128"},
    {"initial-depth", "0.1"},
    {"level-at", "3:0.01,4:0.03,5:0.08"},
    {"cell-pixels", "0.6"},
    {"max-leaves", "16384"},
    {"max-level", "7"},
    {"structure-from", "0.25"},
    {"structure-every", "0.1"},
    {"split-samples", "100"},
    {"n1", "8"},
    {"refresh-every", "32"},
    {"cull-strikes", "1"},
    {"cull-after", "32"},
    {"samples-per-leaf", "16"},
    {"samples-per-ray", "24"},
    {"rays", "16384"},
    {"batch-samples", "524288"},
    {"roulette", "2"},
    {"min-leaf-samples", "1"},
    {"antialias", "auto"},
    {"lr", "0.1"},
    {"lr-final", "0.01"},
    {"beta1", "0"},
    {"distortion-loss", "0.004"},
    {"density-lr", "4"},
    {"harmonics-lr", "0.2"},
    {"harmonics-rise", "0.1"},
    {"decoder-after", "0.5"},
    {"smooth-density", "4e-9"},
    {"smooth-colour", "4e-9"},
    {"smooth-density-delta", "1"},
    {"smooth-colour-delta", "0.3"},
};

static const struct {
    const char *name;
    const setting *settings; /* [count], on top of the fast preset */
    size_t count;
} baselines[] = {
    {"nerf", nerf, sizeof nerf / sizeof nerf[0]},
    {"kilonerf", kilonerf, sizeof kilonerf / sizeof kilonerf[0]},
    {"voxel", voxel, sizeof voxel / sizeof voxel[0]},
};

/* ---- rows ---- */

static void *field_of(cln_config *config, const cln_config_row *row)
{
    return (char *)config + row->offset;
}

static const void *const_field_of(const cln_config *config, const cln_config_row *row)
{
    return (const char *)config + row->offset;
}

/* Index of `text` among "a|b|c", or -1. */
static int word_index(const char *words, const char *text)
{
    size_t wanted = strlen(text);

    for (int i = 0; *words; i++) {
        size_t length = strcspn(words, "|");
        if (length == wanted && memcmp(words, text, length) == 0)
            return i;
        words += length + (words[length] == '|');
    }
    return -1;
}

/* Copies word number `index` of "a|b|c". */
static void word_copy(const char *words, int index, char out[CLN_TEXT_BYTES])
{
    for (; index > 0; index--)
        words += strcspn(words, "|") + 1;
    snprintf(out, CLN_TEXT_BYTES, "%.*s", (int)strcspn(words, "|"), words);
}

bool cln_config_is_switch(const cln_config_row *row)
{
    return row->type == CLN_ROW_BOOL || row->flags & CLN_ROW_SWITCH;
}

bool cln_config_is_word(const cln_config_row *row, const char *text)
{
    return row->words && word_index(row->words, text) >= 0;
}

bool cln_config_named(const cln_config_row *row, const char *name, size_t length)
{
    const char *const names[] = {row->option, row->alias};

    for (int i = 0; i < 2; i++) {
        if (names[i] && strlen(names[i]) == length && memcmp(names[i], name, length) == 0)
            return true;
    }
    return false;
}

/* Records "--rays: 'x' is not a whole number from 16 to 1048576" and returns st. */
static cln_status fail_value(cln_status st, const cln_config_row *row, const char *text)
{
    char min[CLN_NUMBER_BYTES], max[CLN_NUMBER_BYTES];
    const char *form = "";

    cln_number_write(row->min, min);
    cln_number_write(row->max, max);
    if (row->flags & CLN_ROW_SECONDS)
        form = " seconds (or 90s, 10m, 2h, 1:30)";
    else if (row->flags & CLN_ROW_BYTES)
        form = " bytes (or 512M, 4G)";
    switch (row->type) {
    case CLN_ROW_INT:
        snprintf(min, sizeof min, "%lld", (long long)row->min);
        snprintf(max, sizeof max, "%lld", (long long)row->max);
        return cln_fail(st, "--%s: '%s' is not a whole number from %s to %s", row->option, text,
                        min, max);
    case CLN_ROW_REAL:
        return cln_fail(st, "--%s: '%s' is not a number from %s to %s%s%s", row->option, text, min,
                        max, form, strchr(text, ',') ? "; fractions have a point, as in 0.5" : "");
    case CLN_ROW_BOOL:
        return cln_fail(st, "--%s: '%s' is not yes, no, true, false, 1 or 0", row->option, text);
    case CLN_ROW_ENUM:
        return cln_fail(st, "--%s: '%s' is not one of %s", row->option, text, row->words);
    case CLN_ROW_TEXT:
        return cln_fail(st, "--%s: '%.40s...' is longer than %d characters", row->option, text,
                        CLN_TEXT_BYTES - 1);
    }
    return st;
}

static bool in_range(const cln_config_row *row, double value)
{
    return value >= row->min && value <= row->max;
}

/* A key of run.json, by its field or its option: "t_min" is "t-min". */
static bool is_key_of(const char *key, const char *name)
{
    while (*key && (*key == *name || (*key == '_' && *name == '-'))) {
        key++;
        name++;
    }
    return !*key && !*name;
}

const cln_config_row *cln_config_find(const char *option)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        if (cln_config_named(&cln_config_rows[i], option, strlen(option)))
            return &cln_config_rows[i];
    }
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        if (is_key_of(option, row->field) || (row->alias && is_key_of(option, row->alias)))
            return row;
    }
    return NULL;
}

const char *cln_config_nearest(const char *option)
{
    const char *nearest = NULL;
    int best = 0;

    option += strspn(option, "-");
    if (strncmp(option, "no-", 3) == 0)
        option += 3;
    best = strlen(option) >= 6 ? 4 : (int)strlen(option) / 2 + 1; /* fewer edits than this */
    for (int i = 0; i < cln_config_row_count; i++) {
        int distance = cln_edit_distance(option, cln_config_rows[i].option);
        if (distance < best) {
            best = distance;
            nearest = cln_config_rows[i].option;
        }
    }
    return nearest;
}

/* ---- values from and to text ---- */

/* "20000" or "2e4". */
static bool read_whole(const char *text, long long *value)
{
    const char *end = NULL;
    double real = 0;

    if (cln_integer_read(text, value))
        return true;
    if (!strpbrk(text, "eE") || !cln_number_read(text, &real, &end) || *end != 0 ||
        real != floor(real) || fabs(real) > 1e15)
        return false;
    *value = (long long)real;
    return true;
}

static bool read_bool(const char *text, bool *value)
{
    int index = word_index("no|yes|false|true|0|1", text);

    *value = index % 2 == 1;
    return index >= 0;
}

static bool read_real(const cln_config_row *row, const char *text, double *value)
{
    const char *end = NULL;

    if (row->flags & CLN_ROW_SECONDS)
        return cln_seconds_read(text, value, NULL);
    if (row->flags & CLN_ROW_BYTES)
        return cln_bytes_read(text, value);
    return cln_number_read(text, value, &end) && *end == 0;
}

cln_status cln_config_set(cln_config *config, const cln_config_row *row, const char *text)
{
    void *field = field_of(config, row);
    long long integer = 0;
    double real = 0;
    bool flag = false;
    int index = 0;

    switch (row->type) {
    case CLN_ROW_INT:
        if (row->flags & CLN_ROW_AUTO && strcmp(text, "auto") == 0)
            integer = (long long)row->min;
        else if (!read_whole(text, &integer) || !in_range(row, (double)integer))
            return fail_value(CLN_USAGE, row, text);
        *(int *)field = (int)integer;
        break;
    case CLN_ROW_REAL:
        if (!read_real(row, text, &real) || !in_range(row, real))
            return fail_value(CLN_USAGE, row, text);
        *(double *)field = real;
        break;
    case CLN_ROW_BOOL:
        if (!read_bool(text, &flag))
            return fail_value(CLN_USAGE, row, text);
        *(bool *)field = flag;
        break;
    case CLN_ROW_ENUM:
        index = row->flags & CLN_ROW_SWITCH && read_bool(text, &flag)
                    ? flag
                    : word_index(row->words, text);
        if (index < 0)
            return fail_value(CLN_USAGE, row, text);
        *(int *)field = index;
        break;
    case CLN_ROW_TEXT:
        if (strlen(text) >= CLN_TEXT_BYTES)
            return fail_value(CLN_USAGE, row, text);
        if (!cln_utf8_valid(text))
            return cln_fail(CLN_USAGE,
                            "--%s: its text is not UTF-8, and run.json could not hold it; give it "
                            "as UTF-8",
                            row->option);
        if (row->flags & CLN_ROW_NONE && strcmp(text, "none") == 0)
            text = "";
        memset(field, 0, CLN_TEXT_BYTES);
        memcpy(field, text, strlen(text));
        break;
    }
    return CLN_OK;
}

/* ---- presets ---- */

static void take_baseline(const setting *settings, size_t count, cln_config *out)
{
    *out = preset_fast;
    for (size_t i = 0; i < count; i++) {
        const cln_config_row *row = cln_config_find(settings[i].option);
        const cln_status st = row ? cln_config_set(out, row, settings[i].value) : CLN_INTERNAL;

        CLN_ASSERT(st == CLN_OK);
    }
}

cln_status cln_config_preset(const char *name, cln_config *out)
{
    for (size_t i = 0; i < sizeof baselines / sizeof baselines[0]; i++) {
        if (strcmp(name, baselines[i].name) == 0) {
            take_baseline(baselines[i].settings, baselines[i].count, out);
            return CLN_OK;
        }
    }
    if (strcmp(name, "paper") == 0)
        *out = preset_paper;
    else if (strcmp(name, "fast") == 0)
        *out = preset_fast;
    else
        return cln_fail(CLN_USAGE, "--preset: '%s' is not one of " CLN_PRESETS, name);
    return CLN_OK;
}

/* ---- parsers outside the table ---- */

cln_status cln_parse_bytes(const char *option, const char *text, double *bytes)
{
    double value = 0;

    if (!cln_bytes_read(text, &value))
        return cln_fail(CLN_USAGE, "%s: '%s' is not a size of 0 or more: give bytes, or 512M, 4G",
                        option, text);
    *bytes = value;
    return CLN_OK;
}

cln_status cln_parse_reals(const char *text, int count, double *out)
{
    if (!cln_reals_read(text, count, out))
        return cln_fail(CLN_USAGE, "'%s' is not %d numbers separated by commas", text, count);
    return CLN_OK;
}

void cln_config_text(const cln_config *config, const cln_config_row *row, char out[CLN_TEXT_BYTES])
{
    const void *field = const_field_of(config, row);

    switch (row->type) {
    case CLN_ROW_INT:
        if (row->flags & CLN_ROW_AUTO && *(const int *)field == (int)row->min)
            snprintf(out, CLN_TEXT_BYTES, "auto");
        else
            snprintf(out, CLN_TEXT_BYTES, "%d", *(const int *)field);
        break;
    case CLN_ROW_REAL:
        cln_number_write(*(const double *)field, out);
        break;
    case CLN_ROW_BOOL:
        snprintf(out, CLN_TEXT_BYTES, "%s", *(const bool *)field ? "yes" : "no");
        break;
    case CLN_ROW_ENUM:
        word_copy(row->words, *(const int *)field, out);
        break;
    case CLN_ROW_TEXT:
        snprintf(out, CLN_TEXT_BYTES, "%s", (const char *)field);
        break;
    }
}

/* ---- JSON ---- */

cln_status cln_config_to_json(const cln_config *config, json_t **out)
{
    json_t *object = json_object();
    int failed = object == NULL;

    *out = NULL;
    for (int i = 0; i < cln_config_row_count && !failed; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        const void *field = const_field_of(config, row);
        char text[CLN_TEXT_BYTES];
        json_t *value = NULL;

        cln_config_text(config, row, text);
        if (row->type == CLN_ROW_INT)
            value = json_integer(*(const int *)field);
        else if (row->type == CLN_ROW_REAL)
            value = json_real(*(const double *)field);
        else if (row->type == CLN_ROW_BOOL)
            value = json_boolean(*(const bool *)field);
        else
            value = json_string(text);
        failed = json_object_set_new(object, row->field, value);
    }
    if (failed) {
        json_decref(object);
        return cln_fail(CLN_MEMORY,
                        "settings: cannot be put into JSON (out of memory or not UTF-8)");
    }
    *out = object;
    return CLN_OK;
}

static cln_status set_from_json(cln_config *config, const cln_config_row *row, const json_t *value)
{
    void *field = field_of(config, row);
    bool right = false;

    switch (row->type) {
    case CLN_ROW_INT:
        right = json_is_integer(value) && in_range(row, (double)json_integer_value(value));
        if (right)
            *(int *)field = (int)json_integer_value(value);
        break;
    case CLN_ROW_REAL:
        right = json_is_number(value) && in_range(row, json_number_value(value));
        if (right)
            *(double *)field = json_number_value(value);
        break;
    case CLN_ROW_BOOL:
        right = json_is_boolean(value);
        if (right)
            *(bool *)field = json_is_true(value);
        break;
    case CLN_ROW_ENUM:
        right = json_is_string(value) && word_index(row->words, json_string_value(value)) >= 0;
        if (right)
            *(int *)field = word_index(row->words, json_string_value(value));
        if (row->flags & CLN_ROW_SWITCH && json_is_boolean(value)) { /* BOOL in older runs */
            right = true;
            *(int *)field = json_is_true(value);
        }
        break;
    case CLN_ROW_TEXT:
        right = json_is_string(value) && json_string_length(value) < CLN_TEXT_BYTES;
        if (right) {
            memset(field, 0, CLN_TEXT_BYTES);
            memcpy(field, json_string_value(value), json_string_length(value));
        }
        break;
    }
    if (!right) {
        char *text = json_dumps(value, JSON_ENCODE_ANY);
        fail_value(CLN_INPUT, row, text ? text : "?");
        free(text);
        return CLN_INPUT;
    }
    return CLN_OK;
}

/* The key of a row in an object: its field, else its earlier name ("t-min" is "t_min" there). NULL
 * if the object has neither. */
static const char *key_of(const json_t *object, const cln_config_row *row, char earlier[64])
{
    if (json_object_get(object, row->field))
        return row->field;
    snprintf(earlier, 64, "%s", row->alias ? row->alias : "");
    for (char *c = earlier; *c; c++)
        *c = *c == '-' ? '_' : *c;
    return json_object_get(object, earlier) ? earlier : NULL;
}

static bool is_read(const json_t *object, const char *key)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        char earlier[64];
        const char *own = key_of(object, &cln_config_rows[i], earlier);

        if (own && strcmp(own, key) == 0)
            return true;
    }
    return false;
}

cln_status cln_config_from_json(const json_t *object, cln_config *out)
{
    cln_status st = CLN_OK;
    cln_config config = preset_paper; /* for missing CLN_ROW_LATER rows; others are overwritten */
    const char *key = NULL;
    json_t *given = NULL;

    if (!json_is_object(object))
        return cln_fail(CLN_INPUT, "settings: a JSON object is expected");
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        char earlier[64];
        const char *own = key_of(object, row, earlier);

        if (own)
            CLN_TRY(set_from_json(&config, row, json_object_get(object, own)));
        else if (!(row->flags & CLN_ROW_LATER))
            return cln_fail(CLN_INPUT, "settings: '%s' is missing; written by another version?",
                            row->field);
    }
    json_object_foreach((json_t *)object, key, given)
    {
        if (!is_read(object, key))
            return cln_fail(CLN_INPUT, "settings: '%s' is unknown; written by another version?",
                            key);
    }
    *out = config;
done:
    return st;
}

/* ---- comparing ---- */

static bool same_value(const cln_config *a, const cln_config *b, const cln_config_row *row)
{
    const void *x = const_field_of(a, row), *y = const_field_of(b, row);

    switch (row->type) {
    case CLN_ROW_INT:
    case CLN_ROW_ENUM:
        return *(const int *)x == *(const int *)y;
    case CLN_ROW_REAL:
        return *(const double *)x == *(const double *)y;
    case CLN_ROW_BOOL:
        return *(const bool *)x == *(const bool *)y;
    case CLN_ROW_TEXT:
        return strcmp(x, y) == 0;
    }
    return false;
}

const cln_config_row *cln_config_differs(const cln_config *a, const cln_config *b, unsigned flags)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        if ((row->flags & flags) == flags && !same_value(a, b, row))
            return row;
    }
    return NULL;
}

int cln_config_antialias(const cln_config *config)
{
    if (config->stage1 == CLN_STAGE1_SPLAT)
        return 1;
    return config->antialias ? config->antialias : 2;
}
