/* Warnings at the start of a training about given settings without effect. See settings.h. A new
 * one is a row of the list below. */
#include "base/settings.h"

#include <string.h>
#include "base/log.h"

typedef struct idle {
    const char *options; /* separated by spaces */
    bool when;
    const char *why; /* reason; way out */
} idle;

enum { IDLE_ROWS = 56 };

#define ADAPTIVE                                                                          \
    "max-leaves max-level structure-from structure-every structure-until structure-wait " \
    "split-samples split-factor merge-factor cost-density distil-steps distil-samples "   \
    "distil-lr distil-stop"

/* The list. If several rows apply to an option, the first one counts. */
static void list_idle(const cln_config *c, const cln_settings_facts *facts, idle out[IDLE_ROWS])
{
    const bool tree = c->tree_from[0];
    const idle rows[] = {
        {"start-level init", facts->resume,
         "a resumed run has its tree and weights; start a new run for another"},
        {"level-at seen-by slab points-near", facts->grown && !tree,
         "the resumed run's tree has grown to its last level; give a deeper --level-at"},
        {"precrop-steps", facts->past_crop, "the resumed run is past these steps; leave it out"},
        {"start-level level-at adaptive regrow", tree,
         "--tree-from keeps that run's tree; leave one out"},
        {ADAPTIVE, tree, "--tree-from keeps that run's tree; leave one out"},
        {ADAPTIVE, !c->adaptive, "the tree does not adapt; give --adaptive"},
        {ADAPTIVE, facts->frozen,
         "the resumed run's tree is past --structure-until; give a later one, or more --steps"},
        {"merge-factor distil-steps distil-samples distil-lr distil-stop",
         !cln_leaf_kind_of(c->encoding)->merges, "voxels do not merge; leave it out"},
        {"regrow", c->regrow > 0 && facts->forward,
         "nothing grows back in normalised device coordinates; give --space cube"},
        {"skip", c->skip && c->depth < 6,
         "only networks of 6 layers or more have a skip connection; give --depth 6"},
        {"width depth skip bands bands-by-level view-width view-bands view-l2 rrelu-scope "
         "rrelu-lower rrelu-upper init min-leaf-samples",
         !cln_leaf_kind_of(c->encoding)->network, "voxels have no network; give --preset fast"},
        {"harmonics decoder-width decoder-lr decoder-after density-lr harmonics-lr harmonics-rise "
         "smooth-density smooth-colour smooth-density-delta smooth-colour-delta cell-pixels",
         c->encoding != CLN_ENCODING_VOXEL, "there are no voxels; give --preset voxel"},
        {"harmonics-lr harmonics-rise", c->harmonics == 0,
         "there are no harmonics; give --harmonics 1"},
        {"cell-pixels", tree, "--tree-from keeps that run's tree; leave one out"},
        {"cell-pixels", facts->frozen && facts->grown,
         "the resumed run's tree is past --structure-until; give a later one, or more --steps"},
        {"cell-pixels", facts->forward && !c->adaptive,
         "whole levels of normalised device coordinates have no width; give --adaptive"},
        {"decoder-lr decoder-after", c->decoder_width == 0,
         "there is no decoder; give --decoder-width 32"},
        {"harmonics harmonics-lr harmonics-rise decoder-width decoder-lr decoder-after",
         !c->view_dependence,
         "without view dependence there are no harmonics; give --view-dependence"},
        {"bands bands-by-level", c->encoding == CLN_ENCODING_GRID,
         "networks on a grid read no bands of the position; give --encoding frequency"},
        {"grid-cells", c->encoding == CLN_ENCODING_FREQUENCY,
         "there is no grid; give --encoding grid"},
        {"grid-features", c->encoding != CLN_ENCODING_GRID,
         "there is no grid; give --encoding grid"},
        {"view-width view-bands view-l2", !c->view_dependence,
         "without view dependence there is no view layer; give --view-dependence"},
        {"lr-final", c->lr_schedule == CLN_SCHEDULE_STEP,
         "--lr-schedule step only divides --lr by ten, twice; give --lr-schedule exp"},
        {"smooth-density-delta smooth-colour-delta", facts->shell,
         "in a shell squares stay squares; leave it out, or train with --space cube"},
        {"smooth-density-delta", c->smooth_density <= 0,
         "densities are not smoothed; give --smooth-density 4e-9"},
        {"smooth-colour-delta", c->smooth_colour <= 0,
         "colours are not smoothed; give --smooth-colour 4e-9"},
        {"huber-delta", c->loss != CLN_LOSS_HUBER, "the loss is l2; give --loss huber"},
        {"antialias-after", cln_config_antialias(c) <= 1,
         "there is one ray a pixel; give --antialias 2"},
        {"harmonics-rise", c->harmonics_rise > 0 && facts->has_alpha,
         "the images have alpha, which shows where surfaces are; leave it out"},
        {"alpha-loss", c->alpha_loss > 0 && !facts->has_alpha,
         "the images have no alpha; give --opaque-loss"},
        {"opaque-loss", c->opaque_loss > 0 && facts->has_alpha,
         "the images have alpha; give --alpha-loss"},
        {"depth-loss", c->depth_loss > 0 && c->stage1 == CLN_STAGE1_SPLAT,
         "--stage1 splat draws rays of a few views; give --stage1 gather"},
        {"depth-loss", c->depth_loss > 0 && facts->no_sights,
         "the scene's files name no points with the images that show them; leave it out"},
        {"depth-until", c->depth_loss <= 0, "there is no depth loss; give --depth-loss"},
        {"depth-until", c->depth_loss > 0 && facts->no_sights,
         "the scene's files name no points with the images that show them; leave it out"},
        {"exposure", c->exposure == CLN_EXPOSURE_YES && facts->has_alpha,
         "images with alpha get no gains; leave it out"},
        {"epochs", c->steps > 0 || c->time_limit > 0,
         "epochs count when no other budget is set; leave out --steps and --time-limit"},
        {"lists splat-per-ray splat-min-alpha views-per-batch", c->stage1 == CLN_STAGE1_GATHER,
         "nothing is splatted with --stage1 gather; give --stage1 splat"},
        {"skip-uncovered", c->skip_uncovered && c->stage1 == CLN_STAGE1_SPLAT,
         "--stage1 splat draws from all pixels of a view; give --stage1 gather"},
        {"refresh-every", c->rolling_refresh,
         "a rolling refresh has a rhythm of its own; give --no-rolling-refresh"},
        {"samples-per-ray empty-weight empty-share", c->allocate == CLN_ALLOCATE_CHORD,
         "samples are placed by the chord's length alone; give --allocate weight"},
        {"empty-share", c->empty_weight <= 0,
         "no interval counts as empty with --empty-weight 0; give that, too"},
        {"occlusion-from", c->min_transmittance <= 0,
         "nothing counts as occluded with --min-transmittance 0; give that, too"},
        {"cull-max cull-strikes", c->cull == CLN_CULL_MEAN,
         "--cull mean has no guards; give --cull guarded"},
        {"points-near", facts->no_sights,
         "no sparse points with photos that show them are known; leave it out"},
        {"slab", facts->forward || facts->shell,
         "only a cube has a box that ends the scene; give --space cube"},
        {"slab", c->slab && facts->no_box,
         "no box in the cube is known, as there are no sparse points; give --bbox"},
        {"masks", facts->no_masks, "no photo has a mask; leave it out"},
        {"multiplied-alpha", c->multiplied_alpha && !facts->has_alpha,
         "no photo has alpha; leave it out"},
        {"holdout holdout-from", facts->has_splits, "the dataset names the splits; leave it out"},
        {"holdout holdout-from", c->test_views[0],
         "--test-views names the test views; leave one out"},
        {"holdout-from", c->holdout == 0, "nothing is held out with --holdout 0; give that, too"},
        {"target-psnr eval-at eval-every eval-images", facts->no_tests,
         "the scene has no test view; name some in its files, or measure others afterwards: "
         "`cl-nascent eval RUN --split val`, or train"},
        {"seen-by", facts->few_views, "there are fewer training views; give less"},
        {"exchange", facts->ranks <= 1,
         "a single process exchanges nothing; start several (docs/scale-out.md)"},
        {"exchange", c->exchange == CLN_EXCHANGE_STRETCHES && (c->sparsity > 0 || c->edge > 0),
         "with --sparsity or --edge, samples are exchanged; leave it out"},
    };

    _Static_assert(sizeof rows / sizeof rows[0] == IDLE_ROWS, "IDLE_ROWS counts the rows");
    memcpy(out, rows, sizeof rows);
}

/* Returns whether the row's option is among "a b c". */
static bool is_among(const char *options, const cln_config_row *row)
{
    while (*options) {
        const size_t length = strcspn(options, " ");

        if (cln_config_named(row, options, length))
            return true;
        options += length + (options[length] == ' ');
    }
    return false;
}

const char *cln_settings_why_idle(const cln_config *config, const cln_settings_facts *facts,
                                  const cln_config_row *row)
{
    idle list[IDLE_ROWS];

    list_idle(config, facts, list);
    for (int k = 0; k < IDLE_ROWS; k++)
        if (list[k].when && is_among(list[k].options, row))
            return list[k].why;
    return NULL;
}

/* A number alone is a step. */
static void warn_points(const char *option, const char *text, const cln_config *c)
{
    cln_points at;

    if (cln_config_points(option, text, &at) != CLN_OK) { /* refused elsewhere */
        cln_clear_error();
        return;
    }
    for (int i = 0; i < at.count; i++) {
        if (c->steps > 0 && at.steps[i] > c->steps)
            cln_warn("--%s %d has no effect: it is a step, beyond --steps %d; seconds end in s",
                     option, at.steps[i], c->steps);
        else if (c->time_limit > 0 && at.seconds[i] > c->time_limit)
            cln_warn("--%s %gs has no effect: it is beyond --time-limit %gs", option, at.seconds[i],
                     c->time_limit);
    }
}

void cln_settings_warn_idle(const cln_settings *settings, const cln_settings_facts *facts)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        const char *why = cln_settings_given(settings, row)
                              ? cln_settings_why_idle(&settings->config, facts, row)
                              : NULL;

        if (why)
            cln_warn("--%s has no effect: %s", row->option, why);
    }
}

void cln_settings_warn_points(const cln_config *config)
{
    warn_points("eval-at", config->eval_at, config);
    warn_points("save-at", config->save_at, config);
}
