/* The small languages inside TEXT rows (level-at, eval-at, background, bbox) and the rules that
 * bind several rows. See config.h. Single values are checked where they are set, in config.c. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/number.h"

/* Copies *text up to the next comma and steps past it. False at the end of the text, or at an empty
 * part (then *text is not at its end). */
static bool next_part(const char **text, char part[CLN_TEXT_BYTES])
{
    size_t length = strcspn(*text, ",");

    if (length == 0)
        return false;
    snprintf(part, CLN_TEXT_BYTES, "%.*s", (int)length, *text);
    if ((*text)[length] == ',' && (*text)[length + 1])
        length++; /* leaves a comma at the very end, as an empty part */
    *text += length;
    return true;
}

/* "3:0.08" -> level, fraction. */
static bool read_level(const char *part, long long *level, double *fraction)
{
    const char *colon = strchr(part, ':');
    const char *end = NULL;
    char number[CLN_TEXT_BYTES];

    if (!colon)
        return false;
    snprintf(number, sizeof number, "%.*s", (int)(colon - part), part);
    return cln_integer_read(number, level) && cln_number_read(colon + 1, fraction, &end) &&
           *end == 0;
}

int cln_config_most_rays(const cln_config *config)
{
    return config->leaf_samples > 0 ? 8 * config->rays : config->rays;
}

int64_t cln_config_epoch_steps(const cln_config *config, double pixels)
{
    return (int64_t)fmax(1, ceil(config->epochs * pixels / 10 / config->rays));
}

double cln_config_step_epochs(const cln_config *config, double pixels, int64_t steps)
{
    return (double)steps * config->rays * 10 / pixels;
}

const cln_leaf_kind *cln_leaf_kind_of(int encoding)
{
    static const cln_leaf_kind kinds[] = {
        [CLN_ENCODING_FREQUENCY] = {.name = "networks", .network = true, .merges = true},
        [CLN_ENCODING_GRID] = {.name = "networks", .network = true, .merges = true},
        [CLN_ENCODING_VOXEL] = {.name = "voxels", .joined = true, .levels_first = true},
    };

    CLN_ASSERT(encoding >= 0 && (size_t)encoding < sizeof kinds / sizeof *kinds);
    return &kinds[encoding];
}

int cln_config_deepest(const cln_config *config)
{
    int most = config->adaptive || config->tree_from[0] ? config->max_level : 0;
    double at[CLN_LEVELS];

    if (cln_config_levels(config, at) != CLN_OK)
        cln_clear_error(); /* cln_config_check reports it */
    else
        for (int level = CLN_FULL_LEVELS; level < CLN_LEVELS; level++)
            if (at[level] <= 1 && level > most)
                most = level;
    return most < CLN_FULL_LEVELS - 1 ? CLN_FULL_LEVELS - 1 : most;
}

cln_status cln_config_levels(const cln_config *config, double fraction[CLN_LEVELS])
{
    const char *at = config->level_at;
    char part[CLN_TEXT_BYTES];
    long long last_level = config->start_level;
    double found[CLN_LEVELS], last_fraction = 0;

    for (int i = 0; i < CLN_LEVELS; i++)
        found[i] = 2;
    while (next_part(&at, part)) {
        long long level = 0;
        double value = 0;

        if (!read_level(part, &level, &value))
            return cln_fail(CLN_USAGE,
                            "--level-at: '%s' in '%s' is not LEVEL:FRACTION, as in 3:0.1", part,
                            config->level_at);
        if (level <= last_level || level >= CLN_LEVELS)
            return cln_fail(CLN_USAGE,
                            "--level-at: level %lld in '%s' is not in %lld..%d: levels ascend from "
                            "above --start-level %d",
                            level, config->level_at, last_level + 1, CLN_LEVELS - 1,
                            config->start_level);
        if (!(value >= last_fraction && value <= 1))
            return cln_fail(CLN_USAGE,
                            "--level-at: the fraction in '%s' of '%s' is outside 0..1, or below "
                            "the one before it",
                            part, config->level_at);
        found[level] = value;
        last_level = level;
        last_fraction = value;
    }
    if (*at)
        return cln_fail(CLN_USAGE, "--level-at: '%s' has an empty part; write LEVEL:FRACTION,...",
                        config->level_at);
    memcpy(fraction, found, sizeof found);
    return CLN_OK;
}

void cln_config_keep_levels(const char *level_at, int above, int most, char out[CLN_TEXT_BYTES])
{
    char part[CLN_TEXT_BYTES];
    size_t used = 0;

    out[0] = 0;
    while (next_part(&level_at, part)) {
        long long level = 0;
        double value = 0;

        if (read_level(part, &level, &value) && level > above && level <= most)
            used +=
                (size_t)snprintf(out + used, CLN_TEXT_BYTES - used, "%s%s", used ? "," : "", part);
    }
}

cln_status cln_config_points(const char *option, const char *text, cln_points *out)
{
    const char *at = text;
    char part[CLN_TEXT_BYTES];
    double last_seconds = 0;
    int last_step = 0;

    *out = (cln_points){0};
    while (next_part(&at, part)) {
        long long step = 0;
        double time = 0;
        bool has_unit = false;
        bool right = cln_seconds_read(part, &time, &has_unit);

        if (right && has_unit)
            right = time > last_seconds;
        else
            right = cln_integer_read(part, &step) && step > last_step && step <= 2000000000;
        if (!right)
            return cln_fail(CLN_USAGE,
                            "--%s: '%s' in '%s' is not a time (60s, 2m, 1h) or a step that is "
                            "above 0 and later than the one before it",
                            option, part, text);
        if (out->count == CLN_POINTS)
            return cln_fail(CLN_USAGE, "--%s: '%s' has more than %d points; give fewer", option,
                            text, CLN_POINTS);
        out->seconds[out->count] = has_unit ? time : 0;
        out->steps[out->count++] = has_unit ? 0 : (int)step;
        if (has_unit)
            last_seconds = time;
        else
            last_step = (int)step;
    }
    if (*at)
        return cln_fail(CLN_USAGE, "--%s: '%s' has an empty part; write 60s,2m,5000", option, text);
    return CLN_OK;
}

cln_status cln_background_read(const char *text, const char *words, float rgb[3])
{
    double value[3] = {1, 1, 1};

    if (strcmp(text, "black") == 0)
        value[0] = value[1] = value[2] = 0;
    else if (strcmp(text, "white") != 0 && !cln_reals_read(text, 3, value))
        return cln_fail(CLN_USAGE, "--background: '%s' is not %swhite, black or r,g,b in 0..1",
                        text, words);
    for (int c = 0; c < 3; c++) {
        if (!(value[c] >= 0 && value[c] <= 1))
            return cln_fail(CLN_USAGE, "--background: '%s' has a value outside 0..1", text);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)value[c];
    return CLN_OK;
}

cln_status cln_config_background(const cln_config *config, cln_background_kind *kind, float rgb[3])
{
    const bool automatic = strcmp(config->background, "auto") == 0,
               mean = strcmp(config->background, "mean") == 0;

    *kind = automatic ? CLN_BACKGROUND_AUTO : mean ? CLN_BACKGROUND_MEAN : CLN_BACKGROUND_GIVEN;
    return cln_background_read(automatic || mean ? "white" : config->background, "auto, mean, ",
                               rgb);
}

static cln_status check_bbox(const char *text)
{
    double box[6];

    if (text[0] == 0)
        return CLN_OK;
    if (!cln_reals_read(text, 6, box))
        return cln_fail(CLN_USAGE, "--bbox: '%s' is not minx,miny,minz,maxx,maxy,maxz", text);
    for (int a = 0; a < 3; a++) {
        if (!(box[a] < box[a + 3]))
            return cln_fail(CLN_USAGE,
                            "--bbox: '%s' is empty along %c: its minimum must be below "
                            "its maximum",
                            text, 'x' + a);
    }
    return CLN_OK;
}

static int deepest_level(const cln_config *config, const double fraction[CLN_LEVELS])
{
    int deepest = config->start_level;

    for (int level = 0; level < CLN_LEVELS; level++) {
        if (fraction[level] <= 1)
            deepest = level;
    }
    return deepest;
}

int cln_config_most_leaves(const cln_config *config, bool shell)
{
    double fraction[CLN_LEVELS];
    int deepest = config->start_level, all = 0;

    if (cln_config_levels(config, fraction) != CLN_OK)
        cln_clear_error(); /* cln_config_check reports it */
    else if (!cln_leaf_kind_of(config->encoding)->levels_first || !config->adaptive)
        deepest = deepest_level(config, fraction);
    if (shell && deepest < 2)
        deepest = 2;
    all = 1 << (3 * deepest);
    /* where a tree cannot be full, leaves follow surfaces: count eight for each cell of a face */
    if (deepest >= CLN_FULL_LEVELS)
        all = 8 << (2 * deepest);
    if (shell) /* its core has as many as a cube, its faces 24 cells of level 2 beside 64 */
        all += all / 8 * 3;
    return config->adaptive && config->max_leaves > all ? config->max_leaves : all;
}

int cln_config_first_leaves(const cln_config *config, bool shell)
{
    cln_config first = *config;

    first.max_leaves = 1;
    first.level_at[0] = 0;
    return cln_config_most_leaves(&first, shell);
}

bool cln_config_merges(const cln_config *config)
{
    return config->adaptive && !config->tree_from[0] && cln_leaf_kind_of(config->encoding)->merges;
}

/* Checks the adaptive rows among themselves and against growth by level. They have no effect with
 * --tree-from, which keeps its tree. */
static cln_status check_adaptive(const cln_config *config, const double fraction[CLN_LEVELS])
{
    const int deepest = deepest_level(config, fraction);

    if (!config->adaptive || config->tree_from[0])
        return CLN_OK;
    if (config->structure_from >= config->structure_until)
        return cln_fail(
            CLN_USAGE,
            "--structure-from: %g is not below --structure-until %g, so that the tree would "
            "never adapt; give others, or --no-adaptive",
            config->structure_from, config->structure_until);
    if (config->max_level < config->start_level)
        return cln_fail(CLN_USAGE,
                        "--max-level: %d is below --start-level %d; lower that, too, or give "
                        "--no-adaptive",
                        config->max_level, config->start_level);
    if (config->max_level < deepest)
        return cln_fail(
            CLN_USAGE,
            "--max-level: %d is below level %d of --level-at '%s'; shorten that, too, or "
            "give --no-adaptive",
            config->max_level, deepest, config->level_at);
    return CLN_OK;
}

cln_status cln_config_check(const cln_config *config)
{
    cln_status st = CLN_OK;
    double fraction[CLN_LEVELS];
    cln_points points;
    float rgb[3];
    cln_background_kind background = CLN_BACKGROUND_GIVEN;

    if (config->width & (config->width - 1))
        return cln_fail(CLN_USAGE, "--width: %d is not 16, 32, 64, 128 or 256", config->width);
    if (config->view_dependence && config->view_width % 16)
        return cln_fail(CLN_USAGE, "--view-width: %d is not a multiple of 16 from 16 to 256",
                        config->view_width);
    if (config->rrelu_lower > config->rrelu_upper)
        return cln_fail(CLN_USAGE, "--rrelu-lower: %g is above --rrelu-upper %g; swap them",
                        config->rrelu_lower, config->rrelu_upper);
    if (config->lr_final > config->lr)
        return cln_fail(CLN_USAGE, "--lr-final: %g is above --lr %g; give both", config->lr_final,
                        config->lr);
    CLN_TRY(cln_config_levels(config, fraction));
    CLN_TRY(check_adaptive(config, fraction));
    CLN_TRY(cln_config_points("eval-at", config->eval_at, &points));
    CLN_TRY(cln_config_points("save-at", config->save_at, &points));
    CLN_TRY(cln_config_background(config, &background, rgb));
    CLN_TRY(check_bbox(config->bbox));
    if (config->holdout > 0 && config->holdout_from >= config->holdout)
        return cln_fail(CLN_USAGE,
                        "--holdout-from: %d is not below --holdout %d, by which numbers of test "
                        "images are apart; give one from 0 to %d",
                        config->holdout_from, config->holdout, config->holdout - 1);
    if (config->space == CLN_SPACE_SHELL && config->stage1 == CLN_STAGE1_SPLAT)
        return cln_fail(CLN_USAGE,
                        "--space shell and --stage1 splat: splatting needs straight rays, and in "
                        "a shell a ray bends; give --stage1 gather, or --space cube");
    if (config->space == CLN_SPACE_NDC && config->bbox[0])
        return cln_fail(CLN_USAGE, "--space ndc and --bbox: normalised device coordinates reach to "
                                   "infinity, so they have no box; leave one out");
    if (config->antialias > 1 && config->stage1 == CLN_STAGE1_SPLAT)
        return cln_fail(CLN_USAGE,
                        "--antialias %d and --stage1 splat: splatting goes through pixels' centres "
                        "alone; give --stage1 gather",
                        config->antialias);
    if (config->refine_poses && config->stage1 == CLN_STAGE1_SPLAT)
        return cln_fail(CLN_USAGE,
                        "--refine-poses and --stage1 splat: refining renders single pixels of many "
                        "views, which splatting cannot do; give --stage1 gather");
done:
    return st;
}
