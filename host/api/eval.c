/* cln_eval: a run's newest checkpoint against the photos of one split. Every figure comes from
 * cln_quality_measure, as train's own do, so the two agree image by image. */
#include <stdlib.h>
#include <string.h>

#include "train/record.h"
#include "render/open_run.h"
#include "report/report.h"

cln_status cln_eval(const cln_eval_desc *desc, cln_eval_result *result)
{
    cln_status st = CLN_OK;
    cln_open_run opened = {0};
    cln_split split = CLN_SPLIT_TEST;
    bool pixels[CLN_SPLITS] = {false};
    const char *name = desc->split ? desc->split : cln_split_names[CLN_SPLIT_TEST];
    int *views = NULL, count = 0;
    char *folder = NULL;

    memset(result, 0, sizeof *result);
    for (int s = 0; s < CLN_SPLITS; s++)
        pixels[s] = strcmp(name, cln_split_names[s]) == 0;
    CLN_TRY(cln_open_run_open(desc->run, desc->scene, pixels, &opened));
    CLN_TRY(cln_open_run_split(opened.scene, name, &split));
    CLN_TRY(cln_quality_choose(opened.scene, split, desc->max_images, &views, &count));
    CLN_TRY(cln_open_run_start(&opened, &desc->device, opened.scene->lenses));
    CLN_TRY(cln_pipeline_scene(&opened.pipeline, opened.scene, &opened.model.space));
    if (desc->save_images)
        CLN_TRY(cln_record_folder(desc->run, opened.model.step, name, &folder));
    CLN_TRY(cln_quality_measure(&opened.pipeline, &opened.model, opened.scene, views, count, folder,
                                &desc->callbacks, result));
    result->step = opened.model.step;
    result->train_seconds = opened.model.train_seconds;
    result->digest = cln_model_digest(&opened.model);
    CLN_TRY(cln_record_eval(desc->run, result));
    CLN_TRY(cln_report_write(desc->run));
done:
    cln_open_run_close(&opened);
    free(views);
    free(folder);
    if (st != CLN_OK)
        cln_eval_free(result);
    return st;
}

cln_status cln_eval_json(const cln_eval_result *result, char **json)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    *json = NULL;
    CLN_TRY(cln_quality_json(result, &document));
    *json = json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(17));
    if (!*json)
        st = cln_fail(CLN_MEMORY, "evaluation: cannot make JSON");
done:
    json_decref(document);
    return st;
}
