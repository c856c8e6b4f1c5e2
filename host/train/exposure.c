/* Gains of the training photos. See exposure.h. */
#include "train/exposure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"

enum { EXPOSURE_STEPS = 64 };
static const float MOST = 8;  /* largest gain; its inverse is the smallest */
static const float DOUBT = 5; /* weight of a gain of 1, in rays of a white wall */

cln_status cln_exposure_start(const cln_scene *scene, int capacity, cln_model *model,
                              cln_exposure *out)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    memset(out, 0, sizeof *out);
    if (!model->config.exposure || model->has_alpha) {
        free(model->exposure);
        model->exposure = NULL;
        return CLN_OK;
    }
    if (model->exposure && model->exposure_views != views)
        CLN_TRY(cln_fail(CLN_CHECKPOINT,
                         "the checkpoint has gains of %d training photos, and the scene has %d: "
                         "resume with the same photos, or with --no-exposure",
                         model->exposure_views, views));
    for (int k = 0; k < 2; k++) {
        cln_exposure_rays *r = &out->rays[k];

        CLN_TRY(cln_alloc(&r->view, (size_t)capacity, sizeof *r->view, "exposure"));
        CLN_TRY(cln_alloc(&r->photo, (size_t)capacity, sizeof *r->photo, "exposure"));
    }
    CLN_TRY(
        cln_alloc(&out->number_of, (size_t)scene->view_count, sizeof *out->number_of, "exposure"));
    out->capacity = capacity;
    out->views = views;
    for (int i = 0; i < views; i++)
        out->number_of[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)] = i;
    if (!model->exposure) {
        CLN_TRY(cln_alloc(&model->exposure, (size_t)views, sizeof *model->exposure, "exposure"));
        model->exposure_views = views;
        for (int i = 0; i < views; i++)
            for (int c = 0; c < 3; c++)
                model->exposure[i][c] = 1;
    }
done:
    if (st != CLN_OK)
        cln_exposure_free(out);
    return st;
}

void cln_exposure_free(cln_exposure *e)
{
    for (int k = 0; k < 2; k++) {
        free(e->rays[k].view);
        free(e->rays[k].photo);
    }
    free(e->number_of);
    memset(e, 0, sizeof *e);
}

bool cln_exposure_due(const cln_exposure *e, int64_t step)
{
    return e->views > 0 && step > 0 && step % EXPOSURE_STEPS == 0;
}

void cln_exposure_update(const cln_exposure *e, cln_model *model)
{
    for (int c = 0; c < 3; c++) {
        double sum = 0, mean = 1;

        for (int i = 0; i < e->views; i++) {
            float *row = model->exposure[i];
            float *cross = &row[3 + c], *square = &row[6 + c];

            row[c] = (*cross + DOUBT) / (*square + DOUBT);
            row[c] = fminf(fmaxf(row[c], 1 / MOST), MOST);
            *cross /= 2;
            *square /= 2;
            sum += log(row[c]);
        }
        mean = exp(sum / e->views);
        for (int i = 0; i < e->views; i++)
            model->exposure[i][c] = (float)(model->exposure[i][c] / mean);
    }
}

void cln_exposure_divide(const cln_exposure *e, const cln_model *model, cln_batch *batch, int n)
{
    for (int i = 0; i < n && e->views > 0; i++) {
        const int32_t view = e->number_of[batch->pixels[i].view];
        float *target = batch->targets[i];

        for (int c = 0; c < 3 && target[3] > 0; c++)
            target[c] /= model->exposure[view][c];
    }
}

void cln_exposure_apply(cln_exposure *e, const cln_model *model, cln_batch *batch, int64_t step,
                        int n)
{
    cln_exposure_rays *rays = &e->rays[step % 2];

    if (e->views == 0)
        return;
    CLN_ASSERT(n <= e->capacity);
    rays->n = n;
    for (int i = 0; i < n; i++) {
        const int32_t view = e->number_of[batch->pixels[i].view];
        const float *target = batch->targets[i];

        rays->view[i] = target[3] > 0 ? view : -1; /* 0: the pixel does not count */
        memcpy(rays->photo[i], target, sizeof rays->photo[i]);
    }
    cln_exposure_divide(e, model, batch, n);
}

void cln_exposure_add(const cln_exposure *e, const cln_ray_result *results, int64_t step, int n,
                      cln_model *model)
{
    const cln_exposure_rays *rays = &e->rays[step % 2];

    CLN_ASSERT(e->views == 0 || n <= rays->n);
    for (int i = 0, count = 1; i < n && e->views > 0; i += count) {
        float rgb[3] = {0}; /* of the pixel, whose rays follow each other */

        count = results[i].share != 0 ? (int)lround(1 / fabs((double)results[i].share)) : 1;
        for (int k = i; k < i + count && k < n; k++) {
            rgb[0] += results[k].r / (float)count;
            rgb[1] += results[k].g / (float)count;
            rgb[2] += results[k].b / (float)count;
        }
        for (int c = 0; c < 3 && rays->view[i] >= 0; c++) {
            float *row = model->exposure[rays->view[i]];

            row[3 + c] += rgb[c] * rays->photo[i][c];
            row[6 + c] += rgb[c] * rgb[c];
        }
    }
}

void cln_exposure_say(const cln_exposure *e, const cln_model *model)
{
    float least = MOST, most = 0;

    for (int i = 0; i < e->views; i++)
        for (int c = 0; c < 3; c++) {
            least = fminf(least, model->exposure[i][c]);
            most = fmaxf(most, model->exposure[i][c]);
        }
    if (e->views > 0)
        cln_info("exposure: the training photos have gains of %.2f to %.2f", (double)least,
                 (double)most);
}
