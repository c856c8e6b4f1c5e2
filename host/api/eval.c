/* cln_eval: compares a run's newest checkpoint with the photos of one split. Every figure comes
 * from cln_quality_measure, like those of training, so the two agree image by image. Only figures
 * of the run's own scene go into the run's folder. */
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/given.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/disk.h"
#include "ranks/ranks.h"
#include "train/record.h"
#include "render/open_run.h"
#include "render/named.h"
#include "render/quality.h"
#include "render/seams.h"
#include "report/report.h"

/* Checks an older file in the user's folder: only figures of the same model and scene may replace
 * it; older ones do not tell their scene. */
static cln_status check_place(const char *place, uint64_t model, uint64_t scene)
{
    cln_status st = CLN_OK;
    char *path = NULL, digest[CLN_DIGEST_TEXT];
    const char *saved = NULL;
    json_t *document = NULL;

    CLN_TRY(cln_asprintf(&path, "%s.json", place));
    if (!cln_is_file(path))
        goto done;
    CLN_TRY(cln_json_read(path, false, &document));
    cln_digest_text(model, digest);
    saved = json_string_value(json_object_get(document, "model_digest"));
    if (!saved || strcmp(saved, digest) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: holds the evaluation of another model (%s); choose another folder "
                         "with -o",
                         path, saved ? saved : "unknown"));
    cln_digest_text(scene, digest);
    saved = json_string_value(json_object_get(document, "scene_digest"));
    if (saved && strcmp(saved, digest) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: holds the evaluation of views of another scene; choose another "
                         "folder with -o",
                         path));
done:
    json_decref(document);
    free(path);
    return st;
}

/* What the files of some views by name have behind their number, so that other choices of as many
 * keep theirs; "" for all views. */
static void tell_choice(const cln_eval_desc *desc, const cln_scene *scene, const int *views,
                        int count, int all, char out[CLN_DIGEST_TEXT])
{
    uint64_t d = CLN_DIGEST_START;

    out[0] = 0;
    if (!desc->views || count == all)
        return;
    for (int i = 0; i < count; i++)
        d = cln_digest(d, scene->views[views[i]].name, strlen(scene->views[views[i]].name) + 1);
    snprintf(out, CLN_DIGEST_TEXT, "-%08" PRIx32, (uint32_t)d);
}

/* Takes another background for photos with alpha. `over`: how the files' names tell of it, "" if it
 * is the run's own. */
static cln_status take_background(const cln_eval_desc *desc, cln_scene *scene, char over[16])
{
    int digits[3];

    over[0] = 0;
    if (!desc->background)
        return CLN_OK;
    if (!scene->has_alpha)
        return cln_fail(CLN_USAGE,
                        "--background: the photos of %s have no alpha, so they show their own; "
                        "leave it out",
                        scene->folder);
    if (memcmp(scene->background, desc->background, sizeof scene->background) == 0)
        return CLN_OK;
    memcpy(scene->background, desc->background, sizeof scene->background);
    for (int c = 0; c < 3; c++)
        digits[c] = (int)lrint(255 * (double)desc->background[c]);
    snprintf(over, 16, "-over%02x%02x%02x", (unsigned)digits[0], (unsigned)digits[1],
             (unsigned)digits[2]);
    return CLN_OK;
}

/* Files of an evaluation do not go among those of a run or of frames. */
static cln_status check_out(const char *out)
{
    static const char *const others[][2] = {{"run.json", "a run"},
                                            {"render.json", "rendered frames"}};
    cln_status st = CLN_OK;
    char *path = NULL;

    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        CLN_TRY(cln_path_join(&path, out, others[i][0]));
        if (cln_is_file(path))
            CLN_TRY(cln_fail(CLN_USAGE,
                             "%s: holds %s; name a folder of its own with -o, or leave it out for "
                             "RUN/eval",
                             out, others[i][1]));
        free(path);
        path = NULL;
    }
    st = cln_disk_check(out, 0, "");
done:
    free(path);
    return st;
}

/* Finds the place of the evaluation's files, and whether they can be written, before anything is
 * rendered. */
static cln_status find_place(const cln_eval_desc *desc, const cln_open_run *opened,
                             const char *split, const int *views, int count, const char *over,
                             char **place)
{
    cln_status st = CLN_OK;
    int *whole = NULL, all = 0;
    char *evals = NULL, *plain = NULL, *why = NULL, finer[24] = "", choice[CLN_DIGEST_TEXT];

    if (!desc->out && !opened->same_scene)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: not the scene of %s, so its figures do not go into the run; name a "
                         "folder for them with -o",
                         opened->scene->folder, desc->run));
    CLN_TRY(cln_quality_choose(opened->scene,
                               strcmp(split, "all") == 0 ? CLN_SPLITS
                                                         : opened->scene->views[views[0]].split,
                               0, &whole, &all));
    CLN_TRY(cln_path_join(&evals, desc->run, "eval"));
    CLN_TRY(cln_record_place(desc->out ? desc->out : evals, opened->model.step, split, count, all,
                             &plain));
    tell_choice(desc, opened->scene, views, count, all, choice);
    if (cln_open_run_antialias(opened, desc->antialias) != cln_model_antialias(&opened->model))
        snprintf(finer, sizeof finer, "-antialias%d", desc->antialias);
    CLN_TRY(
        cln_asprintf(place, "%s%s%s%s%s", plain, choice, finer, desc->fast ? "-fast" : "", over));
    if (desc->out)
        CLN_TRY(check_place(*place, cln_model_digest(&opened->model), opened->scene->digest));
    if (desc->save_images) {
        st = cln_disk_check(desc->out ? desc->out : evals,
                            cln_quality_bytes(opened->scene, views, count),
                            "the evaluation's pictures");
        if (st == CLN_OUTPUT && (why = strdup(cln_error_text()))) {
            cln_clear_error();
            (void)cln_fail(
                st,
                "%s: with -o, or see the figures alone with --no-save-images, which then "
                "ends with exit code 7, as the run cannot keep them",
                why);
        }
        CLN_TRY(st);
    }
done:
    free(evals);
    free(whole);
    free(plain);
    free(why);
    return st;
}

/* Checks what all ranks must have in common; if it differed, they would wait for each other
 * forever. */
static cln_status check_ranks(const cln_eval_desc *desc, const cln_open_run *opened,
                              const int *views, int count)
{
    cln_status st = CLN_OK;
    uint64_t d = CLN_DIGEST_START;

    if (cln_ranks_count() == 1)
        return CLN_OK;
    CLN_TRY(cln_ranks_agree(cln_model_digest(&opened->model), "checkpoint"));
    d = cln_digest(d, &desc->antialias, sizeof desc->antialias);
    d = cln_digest(d, &desc->fast, sizeof desc->fast);
    for (int i = 0; i < count; i++) {
        const cln_camera *c = &opened->scene->views[views[i]].camera;

        d = cln_digest(d, &views[i], sizeof views[i]);
        d = cln_digest(d, &c->width, sizeof c->width);
        d = cln_digest(d, &c->height, sizeof c->height);
        d = cln_digest(d, c->c2w, sizeof c->c2w);
    }
    CLN_TRY(cln_ranks_agree(d, "choice of views"));
done:
    return st;
}

cln_status cln_eval(const cln_eval_desc *desc, cln_eval_result *result)
{
    cln_status st = CLN_OK;
    cln_open_run opened = {0};
    const bool writes = cln_ranks_me() == 0;
    cln_split split = CLN_SPLIT_TEST;
    int antialias = 1;
    bool pixels[CLN_SPLITS] = {false}, measured = false;
    const char *name = cln_split_names[CLN_SPLIT_TEST];
    int *views = NULL, count = 0;
    char *place = NULL, over[16];
    cln_lpips *lpips = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_eval", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_eval", "desc", desc));
    name = desc->split ? desc->split : name;
    CLN_TRY(cln_given("cln_eval", "run", desc->run));
    CLN_TRY(cln_given_number("cln_eval", "max_images", desc->max_images, 0, INT_MAX));
    CLN_TRY(cln_given_number("cln_eval", "antialias", desc->antialias, 0, 8));
    CLN_TRY(cln_views_check(desc->views, desc->max_images));
    for (int c = 0; c < 3 && desc->background; c++)
        CLN_TRY(cln_given_number("cln_eval", "background", (double)desc->background[c], 0, 1));
    for (int s = 0; s < CLN_SPLITS; s++)
        pixels[s] = strcmp(name, cln_split_names[s]) == 0 || strcmp(name, "all") == 0;
    if (desc->out && !*desc->out)
        CLN_TRY(cln_fail(CLN_USAGE, "cln_eval: out is empty; give a folder, or NULL"));
    if (desc->out && writes)
        CLN_TRY(check_out(desc->out)); /* before photos are read */
    if (desc->lpips && !cln_is_file(desc->lpips))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no such file; LPIPS needs the weights of a network, which two lines "
                         "of Python write (man cl-nascent, LPIPS)",
                         desc->lpips));
    CLN_TRY(cln_device_check(&desc->device));
    CLN_TRY(cln_open_run_open(desc->run, desc->scene, pixels, &desc->callbacks, &opened));
    antialias = cln_open_run_antialias(&opened, desc->antialias);
    CLN_TRY(take_background(desc, opened.scene, over));
    CLN_TRY(cln_open_run_split(opened.scene, name, true, &split));
    CLN_TRY(cln_views_choose(opened.scene, split, desc->views, desc->max_images, &views, &count));
    CLN_TRY(cln_quality_check(opened.scene, views, count));
    if (writes)
        CLN_TRY(find_place(desc, &opened, name, views, count, over, &place));
    CLN_TRY(check_ranks(desc, &opened, views, count));
    if (desc->seams && cln_scene_split_count(opened.scene, CLN_SPLIT_TRAIN) == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: --seams looks where training views see a surface, and "
                         "there is none",
                         opened.scene->folder));
    if (desc->seams && cln_ranks_count() > 1)
        CLN_TRY(cln_fail(CLN_USAGE, "--seams: works in one process only; run eval without mpirun"));
    for (int i = 0; i < opened.scene->view_count && antialias > 1; i++) {
        const cln_camera *c = &opened.scene->views[i].camera;

        opened.view_pixels =
            fmax(opened.view_pixels, (double)c->width * c->height * antialias * antialias);
    }
    if (!opened.same_scene)
        opened.model.exposure_views = 0; /* they are of other photos */
    opened.fast = desc->fast;
    CLN_TRY(cln_open_run_start(&opened, &desc->device, opened.scene->lenses));
    opened.pipeline.antialias = antialias;
    CLN_TRY(cln_pipeline_scene(&opened.pipeline, opened.scene, &opened.model.space));
    if (desc->lpips) {
        CLN_TRY(cln_lpips_open(opened.device, desc->lpips, &lpips));
        CLN_TRY(cln_quality_check_lpips(opened.scene, views, count, lpips));
    }
    CLN_TRY(cln_quality_measure(&opened.pipeline, &opened.model, opened.scene, views, count,
                                desc->save_images && writes ? place : NULL, lpips, &desc->callbacks,
                                result));
    if (desc->seams)
        CLN_TRY(cln_seams_measure(&opened.pipeline, &opened.model, opened.scene, &desc->callbacks,
                                  &result->seams));
    cln_format(result->split, sizeof result->split, "%s", name);
    result->antialias = antialias;
    result->fast = desc->fast;
    result->step = opened.model.step;
    result->train_seconds = opened.model.train_seconds;
    result->digest = cln_model_digest(&opened.model);
    measured = true;
    if (!writes)
        goto done;
    st = cln_record_eval(place, result);
    if (st == CLN_OK && !desc->out)
        st = cln_report_write(desc->run, opened.model.step);
    if (st == CLN_OUTPUT && !desc->out)
        cln_note("writing the figures, which are complete, into the run (-o puts them elsewhere)");
done:
    cln_lpips_close(lpips);
    cln_open_run_close(&opened);
    free(views);
    free(place);
    if (st != CLN_OK && !(measured && st == CLN_OUTPUT))
        cln_eval_free(result);
    return st;
}

cln_status cln_eval_json(const cln_eval_result *result, char **json)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    CLN_TRY(cln_given("cln_eval_json", "json", json));
    *json = NULL;
    CLN_TRY(cln_given("cln_eval_json", "result", result));
    CLN_TRY(cln_quality_json(result, &document));
    *json = json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(17));
    if (!*json)
        st = cln_fail(CLN_MEMORY, "evaluation: cannot make JSON");
done:
    json_decref(document);
    return st;
}
