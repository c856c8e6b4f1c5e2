/* Gains of the training photos. See exposure.h. */
#include "train/exposure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "ranks/ranks.h"
#include "render/exposure_guess.h"
#include "scene/agree.h"

enum { EXPOSURE_STEPS = 64 };
static const float MOST = 8;  /* largest gain; its inverse is the smallest */
static const float DOUBT = 5; /* weight of a gain of 1, in rays of a white wall */
/* From here on photos differ, in stops, and follow those around them. Early gains show a part only,
 * as the scene has learned the rest (docs/results.md, Photos that differ in exposure). */
static const double DIFFER = 0.1, FOLLOW = 0.5;
static const double CONFIRM = 0.3; /* of what gains differ by, what marks differ by at least */
/* Where marks differ by more than so many times that, the scene has learned the rest as haze, which
 * would stay: gains go on from what marks say. */
static const double LEARNT = 1.7;
static const double GAMMA = 2.2; /* light goes with this power of a photo's values */

static bool is_wanted(const cln_model *model)
{
    switch (model->has_alpha ? CLN_EXPOSURE_NO : model->config.exposure) {
    case CLN_EXPOSURE_YES:
        return true;
    case CLN_EXPOSURE_AUTO:
        return model->exposed || model->step <= EXPOSURE_STEPS;
    default:
        return false;
    }
}

static void drop(cln_model *model, cln_exposure *e)
{
    free(model->exposure);
    model->exposure = NULL;
    model->exposure_views = e->views = 0;
    model->exposed = false;
}

cln_status cln_exposure_start(const cln_scene *scene, int capacity, cln_model *model,
                              cln_exposure *out)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const uint64_t names = cln_scene_training_names(scene);

    memset(out, 0, sizeof *out);
    if (!is_wanted(model)) {
        drop(model, out);
        return CLN_OK;
    }
    model->exposed = model->exposed || model->config.exposure == CLN_EXPOSURE_YES;
    if (model->exposure && (model->exposure_views != views ||
                            (model->training_names && model->training_names != names))) {
        if (model->exposed)
            cln_warn("exposure: training photos have come or gone, so gains begin anew");
        free(model->exposure);
        model->exposure = NULL;
    }
    model->training_names = names;
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

/* Divides gains by their geometric mean over the views. */
static void centre(cln_model *model)
{
    for (int c = 0; c < 3; c++) {
        double sum = 0;

        for (int i = 0; i < model->exposure_views; i++)
            sum += log((double)model->exposure[i][c]);
        for (int i = 0; i < model->exposure_views; i++)
            model->exposure[i][c] =
                (float)(model->exposure[i][c] / exp(sum / model->exposure_views));
    }
}

static double stops_of(const float gains[3])
{
    return GAMMA * log2((double)gains[0] * (double)gains[1] * (double)gains[2]) / 3;
}

/* How much views differ, in stops: the standard deviation. */
static double spread_of(const cln_model *model)
{
    double sum = 0;

    for (int i = 0; i < model->exposure_views; i++) {
        const double mean = stops_of(model->exposure[i]);

        sum += mean * mean; /* their mean over the views is 0 */
    }
    return sqrt(sum / model->exposure_views);
}

/* What marks that two training photos show tell. */
typedef struct marks {
    double falloff; /* of cln_agreement; 0 */
    double share;   /* how much of what gains differ by they differ by; 1 */
    double *stops; /* [exposure_views] how bright photos are beside others; NAN: it was not asked */
} marks;

/* Asks some of this rank's photos that follow each other, so that it does not take long. */
static cln_status ask_marks(const cln_scene *scene, const cln_model *model, marks *out)
{
    cln_status st = CLN_OK;
    enum { RUNS = 4, RUN = 12 };
    int all = 0, asked = 0, *here = NULL;
    cln_agreement found = {0};
    cln_scene some = *scene;
    int numbers[RUNS * RUN];
    double cross = 0, square = 0;

    some.views = NULL;
    CLN_TRY(cln_alloc(&here, (size_t)model->exposure_views, sizeof *here, "exposure"));
    for (int i = 0; i < model->exposure_views; i++)
        if (cln_view_is_loaded(cln_scene_training_view(scene, i)))
            here[all++] = i;
    asked = all < RUNS * RUN ? all : RUNS * RUN;
    some.view_count = asked;
    if (asked < 2)
        goto done;
    CLN_TRY(cln_alloc(&some.views, (size_t)asked, sizeof *some.views, "exposure"));
    for (int i = 0; i < asked; i++) {
        numbers[i] = here[all > asked ? i / RUN * (all - RUN) / (RUNS - 1) + i % RUN : i];
        some.views[i] = *cln_scene_training_view(scene, numbers[i]);
    }
    CLN_TRY(cln_agree(&some, NULL, &found));
    out->falloff = found.falloff;
    for (int i = 0; i < asked; i++)
        out->stops[numbers[i]] = found.views[i].exposure;
    for (int i = 0; i < found.tie_count; i++) {
        const cln_tie *t = &found.ties[i];
        const double gains =
            stops_of(model->exposure[numbers[t->a]]) - stops_of(model->exposure[numbers[t->b]]);
        const double apart = found.views[t->a].exposure - found.views[t->b].exposure;

        if (!isnan(apart)) {
            cross += gains * apart;
            square += gains * gains;
        }
    }
    if (square > 0)
        out->share = cross / square;
done:
    cln_agreement_free(&found);
    free(some.views);
    free(here);
    return st;
}

/* Begins anew with gains as marks say; of photos that were not asked with as many times the stops
 * that they have. */
static void take_marks(const marks *m, cln_model *model)
{
    double between = 0; /* of both scales, over the photos that were asked */
    int count = 0;

    for (int i = 0; i < model->exposure_views; i++)
        if (!isnan(m->stops[i])) {
            between += m->stops[i] - m->share * stops_of(model->exposure[i]);
            count++;
        }
    for (int i = 0; i < model->exposure_views && count; i++) {
        float *row = model->exposure[i];
        const double now = stops_of(row);
        const double wanted = isnan(m->stops[i]) ? m->share * now : m->stops[i] - between / count;

        for (int c = 0; c < 3; c++) {
            row[c] *= (float)exp2((wanted - now) / GAMMA);
            row[3 + c] = row[6 + c] = 0;
        }
    }
    centre(model);
}

/* Says why photos get gains or not. */
static void say_decision(const cln_model *model, double spread, const marks *m)
{
    if (model->exposed)
        cln_info("exposure: photos are brighter or darker as those before and after them are; each "
                 "gets gains (--no-exposure: none)");
    else if (m->falloff > 0)
        cln_info("exposure: photos differ in brightness by %.2g stops, but so do near things and "
                 "far ones, as the light goes along with the camera: they are taken as they are "
                 "(--exposure gives each gains)",
                 spread);
    else if (m->share < CONFIRM)
        cln_info("exposure: photos differ in brightness by %.2g stops, but marks that two of "
                 "them show do not: they are taken as they are (--exposure gives each gains, as of "
                 "visits in other light)",
                 spread);
    else if (spread >= DIFFER)
        cln_info("exposure: photos differ in brightness by %.2g stops, but not as those before and "
                 "after them: they are taken as they are (--exposure gives each gains)",
                 spread);
}

/* After the first update: are there to be gains, and do marks know better? */
static cln_status decide(cln_exposure *e, const cln_scene *scene, cln_model *model)
{
    cln_status st = CLN_OK;
    const bool given = model->exposed;
    const double spread = spread_of(model);
    const size_t bytes = (size_t)model->exposure_views * sizeof(double);
    marks m = {.share = 1};
    double follow = 0;

    CLN_TRY(cln_exposure_follow(model, scene, &follow));
    CLN_TRY(cln_alloc(&m.stops, (size_t)model->exposure_views, sizeof *m.stops, "exposure"));
    for (int i = 0; i < model->exposure_views; i++)
        m.stops[i] = NAN;
    if (spread >= DIFFER && (given || follow >= FOLLOW)) { /* of several ranks, rank 0's photos */
        if (cln_ranks_me() == 0)
            CLN_TRY(ask_marks(scene, model, &m));
        cln_ranks_tell(&m.falloff, sizeof m.falloff);
        cln_ranks_tell(&m.share, sizeof m.share);
        cln_ranks_tell(m.stops, bytes);
    }
    cln_debug("exposure: gains differ by %.3f stops so far, by %.2f as neighbours do, by %.2f as "
              "marks do; these fade with the power %.2f of distance",
              spread, follow, m.share, m.falloff);
    model->exposed =
        given || (spread >= DIFFER && follow >= FOLLOW && m.falloff == 0 && m.share >= CONFIRM);
    if (!given)
        say_decision(model, spread, &m);
    if (!model->exposed)
        drop(model, e);
    else if (m.share > LEARNT)
        take_marks(&m, model);
done:
    free(m.stops);
    return st;
}

static void update(const cln_exposure *e, cln_model *model)
{
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < e->views; i++) {
            float *row = model->exposure[i];
            float *cross = &row[3 + c], *square = &row[6 + c];

            row[c] = (*cross + DOUBT) / (*square + DOUBT);
            row[c] = fminf(fmaxf(row[c], 1 / MOST), MOST);
            *cross /= 2;
            *square /= 2;
        }
    centre(model);
}

cln_status cln_exposure_update(cln_exposure *e, const cln_scene *scene, int64_t step,
                               cln_model *model)
{
    update(e, model);
    return step == EXPOSURE_STEPS ? decide(e, scene, model) : CLN_OK;
}

void cln_exposure_divide(const cln_exposure *e, const cln_model *model, int view, float rgb[3])
{
    const float *gains = e->views > 0 ? cln_model_gains(model, e->number_of[view]) : NULL;

    for (int c = 0; c < 3 && gains; c++)
        rgb[c] /= gains[c];
}

void cln_exposure_divide_batch(const cln_exposure *e, const cln_model *model, cln_batch *batch,
                               int n)
{
    for (int i = 0; i < n; i++)
        if (batch->targets[i][3] != 0)
            cln_exposure_divide(e, model, (int)batch->pixels[i].view, batch->targets[i]);
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

        rays->view[i] = target[3] != 0 ? view : -1; /* 0: the pixel does not count */
        memcpy(rays->photo[i], target, sizeof rays->photo[i]);
    }
    cln_exposure_divide_batch(e, model, batch, n);
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
    if (e->views > 0 && model->exposed)
        cln_info("exposure: the training photos have gains of %.2f to %.2f", (double)least,
                 (double)most);
}
