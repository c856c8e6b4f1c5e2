/* cln_begin_model: makes or reads the model, and refuses settings that it cannot go on with. */
#include "train/begin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <jansson.h>
#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/run_folder.h"
#include "model/structure.h"
#include "scene/cameras_file.h"
#include "train/carve.h"

/* half sides by which a cube reaches beyond another before anybody needs to know */
static const double BEYOND = 0.02;

/* Checks the settings that a checkpoint fixes: the networks' shape and whatever the kernels' layout
 * depends on. */
static cln_status check_shape(const cln_config *saved, const cln_config *wanted)
{
    const cln_config_row *row = cln_config_differs(saved, wanted, CLN_ROW_FIXED);
    char value[CLN_TEXT_BYTES];

    if (!row)
        return CLN_OK;
    cln_config_text(wanted, row, value);
    if (cln_config_is_switch(row) && strcmp(value, "no") == 0)
        return cln_fail(CLN_CHECKPOINT,
                        "--resume: the checkpoint has --%s, which cannot change; leave it out, or "
                        "give it to a new run: train SCENE -o NEW --settings-of RUN --no-%s",
                        row->option, row->option);
    return cln_fail(CLN_CHECKPOINT,
                    "--resume: the checkpoint has another --%s, which cannot change; leave it out, "
                    "or give it to a new run: train SCENE -o NEW --settings-of RUN --%s%s",
                    row->option, row->option, cln_config_is_switch(row) ? "" : " ...");
}

/* Only a new run can take over a tree; a resumed one keeps what it began with. */
static cln_status check_same_tree(const cln_config *saved, const cln_config *wanted)
{
    if (strcmp(saved->tree_from, wanted->tree_from) == 0)
        return CLN_OK;
    return cln_fail(
        CLN_USAGE,
        "--tree-from '%s': the run to resume has %s%s%s; leave it out or start a new run",
        wanted->tree_from, saved->tree_from[0] ? "the tree of '" : "a tree of its own",
        saved->tree_from, saved->tree_from[0] ? "'" : "");
}

cln_status cln_begin_check_saved(const cln_config *saved, const cln_config *wanted)
{
    cln_status st = CLN_OK;

    CLN_TRY(check_shape(saved, wanted));
    CLN_TRY(check_same_tree(saved, wanted));
done:
    return st;
}

/* Leaves are boxes of the cube: in another cube they would be other boxes of the scene. */
static cln_status check_same_cube(const char *run, const cln_model *other, const cln_scene *scene)
{
    const cln_space *its = &other->space, *ours = &scene->space;

    if (cln_space_equal(its, ours))
        return CLN_OK;
    if (its->forward != ours->forward || its->shell != ours->shell)
        return cln_fail(CLN_USAGE,
                        "--tree-from '%s': its --space (cube, ndc or shell) differs from this "
                        "scene's; give both runs the same",
                        run);
    return cln_fail(CLN_USAGE,
                    "--tree-from '%s': its cube has centre %g,%g,%g and half side %g, this scene's "
                    "%g,%g,%g and %g; give both runs the same scene and --bbox",
                    run, its->centre[0], its->centre[1], its->centre[2], its->half, ours->centre[0],
                    ours->centre[1], ours->centre[2], ours->half);
}

cln_status cln_begin_check_tree(const char *run)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    st = cln_run_read(run, &document);
    if (st != CLN_OK)
        cln_note("looking for the tree of --tree-from");
    json_decref(document);
    return st;
}

/* A tree of other photos lacks leaves where something is that was not there, and gets none. */
static cln_status warn_other_photos(const char *run, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    cln_scene *its = NULL;
    cln_since since = {0};
    char many[96] = "";

    st = cln_cameras_read(run, &its);
    if (st == CLN_INPUT) { /* a run without them tells nothing */
        cln_clear_error();
        return CLN_OK;
    }
    CLN_TRY(st);
    if (its->digest == scene->digest)
        goto done;
    CLN_TRY(cln_scene_moved_since(scene, its, &since));
    if (since.changed + since.fresh > 0)
        snprintf(many, sizeof many, "%d of %d photos are not those that",
                 since.changed + since.fresh, scene->view_count);
    else if (since.told < since.known)
        snprintf(many, sizeof many, "the scene is not the one that");
    if (many[0])
        cln_warn("--tree-from '%s': %s it was trained on; where things have moved since, leaves "
                 "are missing, and none come; leave it out to train anew",
                 run, many);
done:
    cln_scene_free(its);
    return st;
}

/* Creates a model on the tree of the run config.tree_from: with its leaves, not its weights. */
static cln_status create_on_tree_of(const cln_config *config, const cln_scene *scene,
                                    cln_model *out)
{
    cln_status st = CLN_OK;
    const char *run = config->tree_from;
    cln_model other = {0};

    st = cln_checkpoint_read(run, false, &other);
    if (st != CLN_OK)
        cln_note("reading the tree for --tree-from");
    CLN_TRY(st);
    CLN_TRY(check_same_cube(run, &other, scene));
    CLN_TRY(warn_other_photos(run, scene));
    if (other.tree.leaf_count == 0)
        CLN_TRY(cln_fail(CLN_USAGE, "--tree-from '%s': its tree has no leaf left; give another run",
                         run));
    CLN_TRY(cln_model_create_on(config, &other.tree, out));
    out->level -= scene->space.shell; /* its depth is that of the core's leaves */
    cln_info("tree of %s, kept as it is: %d %s down to level %d", run, out->tree.leaf_count,
             cln_plural(out->tree.leaf_count, "leaf", "leaves"), out->level);
done:
    cln_model_free(&other);
    return st;
}

/* Creates a model on the first tree, without leaves that must be empty by geometry. */
static cln_status create(const cln_config *config, const cln_scene *scene, cln_model *out)
{
    cln_status st = CLN_OK;
    cln_octree tree = {0};
    cln_octree_change change = {0};
    uint8_t *marks = NULL;
    int level = 0, count = 0;

    CLN_TRY(cln_model_first_tree(config, scene->space.shell, &tree, &level));
    CLN_TRY(cln_carve_find(scene, &scene->space, config, &tree, true, &marks, &count));
    if (count > 0) {
        CLN_TRY(cln_octree_cull(&tree, marks, &change));
        cln_info("tree: %d of the first %d leaves %s left out: too few views see %s, %s outside "
                 "the box, or no sparse point is near",
                 count, count + tree.leaf_count, cln_plural(count, "is", "are"),
                 cln_plural(count, "it", "them"), cln_plural(count, "it is", "they are"));
    }
    CLN_TRY(cln_model_create_on(config, &tree, out));
    out->level = level;
done:
    free(marks);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
    return st;
}

/* Returns the deepest level that the settings allow a tree. Only splats have tables by level; with
 * others, a tree of any depth may stop adapting. */
static int deepest_asked(const cln_config *config)
{
    const int grown = cln_structure_level(config, 1);
    const bool adapts = config->adaptive || config->stage1 == CLN_STAGE1_GATHER;

    return adapts && config->max_level > grown ? config->max_level : grown;
}

/* Refuses new settings that allow less than the tree has. */
static cln_status check_depth(const char *run, const cln_config *saved, const cln_config *wanted,
                              const cln_model *model)
{
    const int depth = cln_octree_depth(&model->tree) - model->space.shell;
    const int asked = deepest_asked(wanted);
    char by[CLN_TEXT_BYTES + 64];

    if (depth <= asked || asked >= deepest_asked(saved))
        return CLN_OK;
    if (wanted->adaptive)
        snprintf(by, sizeof by, "--max-level %d", wanted->max_level);
    else
        snprintf(by, sizeof by, "--level-at '%s' with --no-adaptive", wanted->level_at);
    return cln_fail(CLN_USAGE,
                    "%s: its tree has leaves of level %d, and %s allows level %d; %s, or leave it "
                    "out",
                    run, depth, by, asked,
                    wanted->adaptive ? "give at least the tree's level" : "give --stage1 gather");
}

/* A shell came by --space auto, which the check of the settings cannot know. */
static cln_status check_straight(const char *run, const cln_config *wanted, bool shell)
{
    if (!shell || wanted->stage1 != CLN_STAGE1_SPLAT)
        return CLN_OK;
    return cln_fail(CLN_USAGE,
                    "--stage1 splat: the run %s is in a shell (--space), where a ray bends, and "
                    "splatting needs straight rays; give --stage1 gather, or start a new run with "
                    "--space cube",
                    run);
}

/* Gives the model the settings of this call. Adam's first moments begin at 0 where only these keep
 * them (--beta1 of voxels), and go where these do not. */
static cln_status take_settings(const cln_config *wanted, cln_model *model)
{
    cln_status st = CLN_OK;

    if (cln_first_moment_bytes(wanted) != cln_first_moment_bytes(&model->config)) {
        free(model->adam_m);
        model->adam_m = NULL;
    }
    model->config = *wanted;
    CLN_TRY(cln_model_make_room(model, true));
done:
    return st;
}

/* A resumed run keeps its space: leaves are boxes of it. Tells where its photos would have a cube
 * today that reaches beyond. */
static cln_status keep_space(cln_scene *scene, const cln_space *kept, const char *run)
{
    cln_status st = CLN_OK;
    const cln_space *now = &scene->space;
    char quoted[CLN_QUOTED_BYTES];
    double beyond = 0;

    if (cln_space_equal(kept, now))
        return CLN_OK;
    for (int a = 0; a < 3; a++)
        beyond = fmax(beyond, fabs(now->centre[a] - kept->centre[a]) + now->half - kept->half);
    if (!kept->forward && !now->forward && beyond > BEYOND * kept->half)
        cln_warn("the run keeps its cube, centre %.5g,%.5g,%.5g and half side %.4g; its photos "
                 "would have %.5g,%.5g,%.5g and %.4g today: what lies outside the run's is in no "
                 "mesh and no points; for that train them anew, by --settings-of %s",
                 kept->centre[0], kept->centre[1], kept->centre[2], kept->half, now->centre[0],
                 now->centre[1], now->centre[2], now->half,
                 cln_shell_quote(run, quoted, sizeof quoted));
    scene->space = *kept;
    free(scene->bounds_rule);
    scene->bounds_rule = NULL;
    CLN_TRY(cln_strdup(&scene->bounds_rule, "the run's, as it began"));
done:
    return st;
}

cln_status cln_begin_model(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;
    char limit[32] = "", steps[32] = "";

    if (t->desc->resume) {
        CLN_TRY(cln_checkpoint_read(t->desc->run, true, &t->model));
        CLN_TRY(cln_begin_check_saved(&t->model.config, config));
        CLN_TRY(check_straight(t->desc->run, config, t->model.space.shell));
        CLN_TRY(check_depth(t->desc->run, &t->model.config, config, &t->model));
        t->trained = t->model.config;
        CLN_TRY(take_settings(config, &t->model));
        CLN_TRY(keep_space(t->scene, &t->model.space, t->desc->run));
        memcpy(t->model.background, t->scene->background, sizeof t->model.background);
        if (config->time_limit > 0)
            snprintf(limit, sizeof limit, " of %.0f", config->time_limit);
        if (config->steps > 0)
            snprintf(steps, sizeof steps, " of %d", config->steps);
        cln_info("resumed at step %lld%s, %.0f%s s, %d %s", (long long)t->model.step, steps,
                 t->model.train_seconds, limit, t->model.tree.leaf_count,
                 cln_plural(t->model.tree.leaf_count, "leaf", "leaves"));
    } else {
        if (config->tree_from[0])
            CLN_TRY(create_on_tree_of(config, t->scene, &t->model));
        else
            CLN_TRY(create(config, t->scene, &t->model));
        t->model.space = t->scene->space;
        memcpy(t->model.background, t->scene->background, sizeof t->model.background);
        t->model.has_alpha = t->scene->has_alpha;
        t->model.has_distortion = t->scene->lenses != 0;
    }
done:
    return st;
}
