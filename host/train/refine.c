/* Poses from photos. See refine.h. */
#include "train/refine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/rng.h"
#include "device/queue.h"
#include "ranks/rows.h"
#include "render/ray_batch.h"
#include "scene/dealt.h"
#include "scene/motion.h"
#include "train/probe.h"
#include "train/step.h"

enum {
    EVERY = 64,    /* steps from one turn to the next */
    CAMERAS = 32,  /* of a turn, at most */
    FITTED = 384,  /* spots of a camera that its step is fitted to */
    CHECKED = 192, /* and those that must agree */
    SPOTS = FITTED + CHECKED,
    CHOICES = 4,      /* draws for a spot: the one of most contrast counts */
    TELLING = 24,     /* spots that a step needs */
    OUTLIER_VIEWS = 8 /* from which on one may stand out */
};
static const double FROM = 0.05;        /* of the budget: before, there is nothing to see */
static const double DAMPING = 0.01;     /* of the normal equations' diagonal */
static const double MOST_SHIFT = 1;     /* pixels of a step, root of the mean square */
static const double LEAST_SCALE = 0.01; /* residuals below are noise */
static const double SURE = 2;           /* standard errors by which a step must be better */
static const double LEAST_COLOUR = 0.01, MOST_GAIN = 8;
static const float LEAST_OPACITY = 0.02f;
/* A camera stands out that was turned by so many times the median, and so many degrees. */
static const double OUTLIER_TIMES = 6, OUTLIER_DEGREES = 0.03;

static const int looks_x[CLN_SPOT_LOOKS] = {0, -1, 1, 0, 0};
static const int looks_y[CLN_SPOT_LOOKS] = {0, 0, 0, -1, 1};

cln_status cln_refine_start(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    const int views = cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN);
    const uint64_t names = cln_scene_training_names(t->scene);

    if (!m->config.refine_poses)
        return CLN_OK;
    if (m->motions &&
        (m->motion_views != views || (m->training_names && m->training_names != names)))
        CLN_TRY(cln_fail(CLN_CHECKPOINT,
                         "the checkpoint has corrections of %d training poses, and the scene has "
                         "%s%d: resume with the same photos",
                         m->motion_views, m->motion_views == views ? "others, " : "", views));
    m->training_names = names;
    if (!m->motions)
        CLN_TRY(cln_alloc(&m->motions, (size_t)views, sizeof *m->motions, "poses"));
    m->motion_views = views;
    CLN_TRY(cln_alloc(&t->refine.given, (size_t)views, sizeof *t->refine.given, "poses"));
    for (int i = 0; i < views; i++)
        memcpy(t->refine.given[i], cln_scene_training_view(t->scene, i)->camera.c2w,
               sizeof *t->refine.given);
    cln_motion_views(t->scene, (const float(*)[CLN_MOTION])m->motions);
done:
    return st;
}

void cln_refine_free(cln_refine *refine)
{
    free(refine->given);
    memset(refine, 0, sizeof *refine);
}

/* ---- what to look at ---- */

static bool all_kept(const cln_view *view, int x, int y)
{
    bool kept = true;

    for (int k = 0; k < CLN_SPOT_LOOKS; k++)
        kept = kept && cln_view_keeps(view, x + looks_x[k], y + looks_y[k]);
    return kept;
}

/* How much the photo changes around a pixel; its colour to rgb. */
static float contrast(const cln_view *view, int x, int y, const float background[3], float rgb[3])
{
    float sum = 0, alpha = 0;

    cln_view_pixel(view, x, y, background, rgb, &alpha);
    for (int k = 1; k < CLN_SPOT_LOOKS; k++) {
        float beside[3];

        cln_view_pixel(view, x + looks_x[k], y + looks_y[k], background, beside, &alpha);
        for (int c = 0; c < 3; c++)
            sum += fabsf(beside[c] - rgb[c]);
    }
    return sum;
}

/* Draws the spots of training view i, whose photo is here. */
static void draw_spots(const cln_trainer *t, int i, cln_spot spots[SPOTS])
{
    const cln_view *view = cln_scene_training_view(t->scene, i);
    const cln_camera *c = &view->camera;
    const float *gains = cln_model_gains(&t->model, i);
    const uint64_t seed = (uint64_t)t->model.config.seed;
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};

    for (int s = 0; s < SPOTS; s++) {
        float most = -1;

        spots[s] = (cln_spot){.x = -1};
        for (uint32_t k = 0; k < CHOICES && c->width > 2 && c->height > 2; k++) {
            const uint32_t counter[4] = {(uint32_t)s, CLN_STREAM_POSES << 24 | k,
                                         (uint32_t)t->model.step, (uint32_t)i};
            uint32_t bits[4];
            float rgb[3], found = 0;
            int x = 0, y = 0;

            cln_philox(counter, key, bits);
            x = 1 + (int)cln_bounded(bits[0], (uint32_t)c->width - 2);
            y = 1 + (int)cln_bounded(bits[1], (uint32_t)c->height - 2);
            if (!all_kept(view, x, y))
                continue;
            found = contrast(view, x, y, t->scene->background, rgb);
            if (!(found > most))
                continue;
            most = found;
            spots[s] = (cln_spot){x, y, {rgb[0], rgb[1], rgb[2]}};
        }
        for (int c3 = 0; c3 < 3 && gains; c3++)
            spots[s].photo[c3] /= gains[c3];
    }
}

/* ---- rendering ---- */

/* Renders n pixels, with samples placed by the training's densities. */
static cln_status render(cln_trainer *t, const cln_pixel *pixels, int n, cln_ray_result *out)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const int most = t->plan.max_rays < CLN_RENDER_RAYS ? t->plan.max_rays : CLN_RENDER_RAYS;
    float(*backgrounds)[4] = NULL;
    cln_ray_batch batch = {.sampling = cln_probe_sampling(t)};
    int used = 0;

    CLN_TRY(cln_alloc(&backgrounds, (size_t)most, sizeof *backgrounds, "poses"));
    for (int i = 0; i < most; i++)
        memcpy(backgrounds[i], t->scene->background, sizeof t->scene->background);
    batch.backgrounds = (const float(*)[4])backgrounds;
    for (int done = 0; done < n; done += used) {
        batch.pixels = pixels + done;
        batch.n = n - done < most ? n - done : most;
        CLN_TRY(cln_render_rays(p, &batch, out + done, &used));
    }
done:
    free(backgrounds);
    return st;
}

/* ---- a step ---- */

/* Solves a symmetric positive definite system by Cholesky; false if it is none. */
static bool solve6(double m[6][6], double b[6])
{
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j <= i; j++) {
            for (int k = 0; k < j; k++)
                m[i][j] -= m[i][k] * m[j][k];
            if (i > j)
                m[i][j] /= m[j][j];
        }
        if (!(m[i][i] > 0))
            return false;
        m[i][i] = sqrt(m[i][i]);
    }
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= m[i][k] * b[k];
        b[i] /= m[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++)
            b[i] -= m[k][i] * b[k];
        b[i] /= m[i][i];
    }
    return true;
}

/* The point that a spot shows, at the mean depth of its looks, weighed by opacity; false if they
 * are not opaque. */
static bool point_of(const cln_camera *camera, const cln_space *space, const cln_spot *spot,
                     const cln_ray_result looks[CLN_SPOT_LOOKS], double point[3], double *depth)
{
    double o[3], d[3], sum = 0, weight = 0;

    if (spot->x < 0)
        return false;
    for (int k = 0; k < CLN_SPOT_LOOKS; k++) {
        sum += (double)looks[k].opacity * (double)looks[k].depth;
        weight += (double)looks[k].opacity;
    }
    if (!(weight > CLN_SPOT_LOOKS * (double)LEAST_OPACITY) ||
        !cln_camera_ray(camera, spot->x + 0.5, spot->y + 0.5, o, d))
        return false;
    *depth = cln_space_distance_to_scene(space, sum / weight);
    for (int a = 0; a < 3; a++)
        point[a] = o[a] + *depth * d[a];
    return *depth > 0;
}

/* How the point moves in the image, in pixels for each number of the motion; false where the lens
 * has no place for it. */
static bool slopes_of(const cln_camera *camera, const double point[3], double depth,
                      double out[6][2])
{
    double u = 0, v = 0, z = 0;

    if (!cln_camera_project(camera, point, &u, &v, &z))
        return false;
    for (int k = 0; k < 6; k++) {
        const double by = k < 3 ? 1e-4 : 1e-4 * depth;
        double motion[CLN_MOTION] = {0}, u1 = 0, v1 = 0;
        cln_camera moved = *camera;

        motion[k] = by;
        cln_motion_apply(camera->c2w, motion, moved.c2w);
        if (!cln_camera_project(&moved, point, &u1, &v1, &z))
            return false;
        out[k][0] = (u1 - u) / by;
        out[k][1] = (v1 - v) / by;
    }
    return true;
}

static double channel(const cln_ray_result *r, int c)
{
    return (double)(c == 0 ? r->r : c == 1 ? r->g : r->b);
}

/* A spot's photo less its render. */
static double lack(const cln_spot *spot, const cln_ray_result *look, const double gain[3], int c)
{
    return (double)spot->photo[c] / gain[c] - channel(look, c);
}

static double residual(const cln_spot *spot, const cln_ray_result *look, const double gain[3])
{
    double sum = 0;

    for (int c = 0; c < 3; c++)
        sum += pow(lack(spot, look, gain, c), 2) / 3;
    return sum;
}

/* The medians of photo over rendered colour: a photo that is brighter as a whole has not moved. */
static void find_gain(int count, const int *found, const cln_spot *spots,
                      const cln_ray_result (*looks)[CLN_SPOT_LOOKS], double gain[3])
{
    for (int c = 0; c < 3; c++) {
        double ratios[SPOTS];

        for (int i = 0; i < count; i++)
            ratios[i] = (double)spots[found[i]].photo[c] /
                        fmax(channel(&looks[found[i]][0], c), LEAST_COLOUR);
        cln_reals_sort(ratios, count);
        gain[c] = fmin(fmax(ratios[count / 2], 1 / MOST_GAIN), MOST_GAIN);
    }
}

/* A spot's part of the normal equations, weighed by 1 / (1 + r^2 / scale^2). */
static void add_spot(const cln_spot *spot, const cln_ray_result looks[CLN_SPOT_LOOKS],
                     double slopes[6][2], const double gain[3], double weight, double m[6][6],
                     double b[6])
{
    for (int c = 0; c < 3; c++) {
        const double across = (channel(&looks[2], c) - channel(&looks[1], c)) / 2;
        const double down = (channel(&looks[4], c) - channel(&looks[3], c)) / 2;
        const double lacks = lack(spot, &looks[0], gain, c);
        double j[6];

        for (int k = 0; k < 6; k++) /* the picture moves with the point */
            j[k] = -(across * slopes[k][0] + down * slopes[k][1]);
        for (int k = 0; k < 6; k++) {
            b[k] += weight * j[k] * lacks;
            for (int l = 0; l <= k; l++)
                m[k][l] += weight * j[k] * j[l];
        }
    }
}

/* Root mean square of how far a motion moves the points in the image. */
static double shift_of(const cln_camera *camera, int count, const double (*points)[3],
                       const double *depths, const double motion[6])
{
    double square = 0, slopes[6][2];

    for (int i = 0; i < count; i++) {
        double shift[2] = {0};

        if (!slopes_of(camera, points[i], depths[i], slopes))
            continue;
        for (int k = 0; k < 6; k++)
            for (int a = 0; a < 2; a++)
                shift[a] += slopes[k][a] * motion[k];
        square += (shift[0] * shift[0] + shift[1] * shift[1]) / count;
    }
    return sqrt(square);
}

bool cln_refine_solve(const cln_camera *camera, const cln_space *space, int n,
                      const cln_spot *spots, const cln_ray_result (*looks)[CLN_SPOT_LOOKS],
                      cln_pose_step *out)
{
    double residuals[SPOTS], m[6][6] = {{0}}, shift = 0;
    double points[SPOTS][3], depths[SPOTS], slopes[6][2];
    int found[SPOTS], count = 0;

    CLN_ASSERT(n <= SPOTS);
    memset(out, 0, sizeof *out);
    for (int i = 0; i < n; i++)
        if (point_of(camera, space, &spots[i], looks[i], points[count], &depths[count]))
            found[count++] = i;
    if (count < TELLING)
        return false;
    find_gain(count, found, spots, looks, out->gain);
    for (int i = 0; i < count; i++)
        residuals[i] = residual(&spots[found[i]], &looks[found[i]][0], out->gain);
    cln_reals_sort(residuals, count);
    out->scale = fmax(2 * sqrt(residuals[count / 2]), LEAST_SCALE);
    for (int i = 0; i < count; i++) {
        const cln_spot *spot = &spots[found[i]];
        const double lacks =
            residual(spot, &looks[found[i]][0], out->gain) / (out->scale * out->scale);

        if (slopes_of(camera, points[i], depths[i], slopes))
            add_spot(spot, looks[found[i]], slopes, out->gain, 1 / (1 + lacks), m, out->motion);
    }
    for (int k = 0; k < 6; k++)
        m[k][k] *= 1 + DAMPING;
    if (!solve6(m, out->motion))
        return false;
    shift = shift_of(camera, count, (const double(*)[3])points, depths, out->motion);
    if (!isfinite(shift))
        return false;
    for (int k = 0; k < 6 && shift > MOST_SHIFT; k++)
        out->motion[k] *= MOST_SHIFT / shift;
    return true;
}

bool cln_refine_is_better(int count, const cln_spot *spots, const cln_ray_result *before,
                          const cln_ray_result *after, const cln_pose_step *step)
{
    const double square = step->scale * step->scale;
    double sum = 0, squares = 0, n = 0;

    for (int i = 0; i < count; i++) {
        double fall = 0;

        if (spots[i].x < 0)
            continue;
        fall = log1p(residual(&spots[i], &before[i], step->gain) / square) -
               log1p(residual(&spots[i], &after[i], step->gain) / square);
        sum += fall;
        squares += fall * fall;
        n++;
    }
    return n > 1 && sum > 0 && sum * sum > SURE * SURE * (squares - sum * sum / n) * n / (n - 1);
}

/* ---- a turn ---- */

/* A camera that has its turn. */
typedef struct turn {
    cln_spot spots[SPOTS]; /* fitted, then checked */
    cln_ray_result looks[FITTED][CLN_SPOT_LOOKS];
    cln_ray_result before[CHECKED], after[CHECKED];
    int view; /* among the training views */
    bool moved;
    cln_pose_step step;
    double pose[12]; /* before */
} turn;

static cln_pixel pixel_of(const cln_trainer *t, const turn *c, int spot, int look)
{
    const cln_spot *s = &c->spots[spot];
    const bool none = s->x < 0;

    return (cln_pixel){.view = (cln_u32)cln_scene_split_view(t->scene, CLN_SPLIT_TRAIN, c->view),
                       .x = (cln_u32)(none ? 0 : s->x + looks_x[look]),
                       .y = (cln_u32)(none ? 0 : s->y + looks_y[look])};
}

/* Renders the checked spots of all turns, and before a motion also the looks of the fitted ones. */
static cln_status look(cln_trainer *t, turn *turns, int count, bool after)
{
    cln_status st = CLN_OK;
    const size_t each = after ? CHECKED : FITTED * CLN_SPOT_LOOKS + CHECKED;
    const size_t all = (size_t)count * each;
    cln_pixel *pixels = NULL;
    cln_ray_result *results = NULL;
    size_t n = 0;

    CLN_TRY(cln_alloc(&pixels, all, sizeof *pixels, "poses"));
    CLN_TRY(cln_alloc(&results, all, sizeof *results, "poses"));
    for (int i = 0; i < count; i++) {
        for (int s = 0; s < FITTED && !after; s++)
            for (int k = 0; k < CLN_SPOT_LOOKS; k++)
                pixels[n++] = pixel_of(t, &turns[i], s, k);
        for (int s = FITTED; s < SPOTS; s++)
            pixels[n++] = pixel_of(t, &turns[i], s, 0);
    }
    CLN_TRY(render(t, pixels, (int)n, results));
    for (int i = 0; i < count; i++) {
        const cln_ray_result *r = results + (size_t)i * each;

        if (after) {
            memcpy(turns[i].after, r, sizeof turns[i].after);
            continue;
        }
        memcpy(turns[i].looks, r, sizeof turns[i].looks);
        memcpy(turns[i].before, r + FITTED * CLN_SPOT_LOOKS, sizeof turns[i].before);
    }
done:
    free(pixels);
    free(results);
    return st;
}

/* Takes out what all cameras have in common, and keeps motions as they are stored. */
static cln_status settle(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    double(*poses)[12] = NULL;

    CLN_TRY(cln_alloc(&poses, (size_t)m->motion_views, sizeof *poses, "poses"));
    for (int i = 0; i < m->motion_views; i++)
        memcpy(poses[i], cln_scene_training_view(t->scene, i)->camera.c2w, sizeof *poses);
    cln_motion_hold(m->motion_views, (const double(*)[12])t->refine.given, m->space.half, poses);
    for (int i = 0; i < m->motion_views; i++) {
        double motion[CLN_MOTION];

        cln_motion_between(t->refine.given[i], poses[i], motion);
        for (int k = 0; k < CLN_MOTION; k++)
            m->motions[i][k] = (float)motion[k];
        memcpy(cln_scene_training_view(t->scene, i)->camera.c2w, t->refine.given[i],
               sizeof *t->refine.given);
    }
    cln_motion_views(t->scene, (const float(*)[CLN_MOTION])m->motions);
    CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &m->space));
    CLN_TRY(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
done:
    free(poses);
    return st;
}

static cln_status take_turns(cln_trainer *t, turn *turns, int count)
{
    cln_status st = CLN_OK;
    int moved = 0, kept = 0;

    CLN_TRY(look(t, turns, count, false));
    for (int i = 0; i < count; i++) {
        turn *c = &turns[i];
        cln_camera *camera = &cln_scene_training_view(t->scene, c->view)->camera;

        c->moved = cln_refine_solve(camera, &t->model.space, FITTED, c->spots,
                                    (const cln_ray_result(*)[CLN_SPOT_LOOKS])c->looks, &c->step);
        memcpy(c->pose, camera->c2w, sizeof c->pose);
        if (c->moved)
            cln_motion_apply(c->pose, c->step.motion, camera->c2w);
        moved += c->moved;
    }
    if (moved == 0)
        return CLN_OK;
    CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    CLN_TRY(look(t, turns, count, true));
    for (int i = 0; i < count; i++) {
        turn *c = &turns[i];

        if (c->moved &&
            cln_refine_is_better(CHECKED, c->spots + FITTED, c->before, c->after, &c->step))
            kept++;
        else
            memcpy(cln_scene_training_view(t->scene, c->view)->camera.c2w, c->pose, sizeof c->pose);
    }
    CLN_TRY(settle(t));
    cln_debug("step %lld: %d of %d cameras moved", (long long)t->model.step, kept, count);
done:
    return st;
}

cln_status cln_refine_poses(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    const int views = t->model.motion_views, count = views < CAMERAS ? views : CAMERAS;
    const int64_t number = t->model.step / EVERY;
    turn *turns = NULL;
    cln_spot(*spots)[SPOTS] = NULL;
    cln_rows asked = {0};

    if (!t->model.config.refine_poses || t->model.step % EVERY != 0 || fraction < FROM)
        return CLN_OK;
    CLN_TRY(cln_step_catch_up(t));
    cln_queue_book(t->device, CLN_STAGE_POSES);
    CLN_TRY(cln_alloc(&turns, (size_t)count, sizeof *turns, "poses"));
    CLN_TRY(cln_alloc(&spots, (size_t)count, sizeof *spots, "poses"));
    CLN_TRY(cln_rows_create(count, sizeof *spots, &asked));
    for (int i = 0; i < count; i++) {
        turns[i].view = (int)((number * count + i) % views);
        asked.rank[i] = (uint16_t)cln_scene_training_view(t->scene, turns[i].view)->rank;
        if (cln_view_is_here(cln_scene_training_view(t->scene, turns[i].view)))
            draw_spots(t, turns[i].view, spots[i]);
    }
    cln_rows_share(&asked, count, spots);
    for (int i = 0; i < count; i++)
        memcpy(turns[i].spots, spots[i], sizeof *spots);
    CLN_TRY(take_turns(t, turns, count));
done:
    cln_queue_book(t->device, CLN_STAGES);
    cln_rows_free(&asked);
    free(spots);
    free(turns);
    return st;
}

/* The degrees by which camera i was turned, and the way that it was moved. */
static void get_motion(const cln_model *m, int i, double *angle, double *way)
{
    const float *w = m->motions[i];

    *angle = sqrt((double)(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])) * 180 / M_PI;
    *way = sqrt((double)(w[3] * w[3] + w[4] * w[4] + w[5] * w[5]));
}

int cln_refine_outlier(const cln_model *m, double *median)
{
    double *angles = NULL, most = 0;
    int index = -1;

    *median = NAN;
    if (m->motion_views < OUTLIER_VIEWS ||
        cln_alloc(&angles, (size_t)m->motion_views, sizeof *angles, "poses") != CLN_OK) {
        cln_clear_error(); /* a sentence less */
        return -1;
    }
    for (int i = 0; i < m->motion_views; i++) {
        double way = 0;

        get_motion(m, i, &angles[i], &way);
        if (angles[i] > most) {
            most = angles[i];
            index = i;
        }
    }
    cln_reals_sort(angles, m->motion_views);
    *median = angles[m->motion_views / 2];
    free(angles);
    return most > OUTLIER_TIMES * *median && most > OUTLIER_DEGREES ? index : -1;
}

void cln_refine_say(const cln_trainer *t)
{
    const cln_model *m = &t->model;
    double turned = 0, moved = 0, most_turned = 0, most_moved = 0, median = 0;
    const int outlier = cln_refine_outlier(m, &median);

    for (int i = 0; i < m->motion_views; i++) {
        double angle = 0, way = 0;

        get_motion(m, i, &angle, &way);
        turned += angle / m->motion_views;
        moved += way / m->motion_views;
        most_turned = fmax(most_turned, angle);
        most_moved = fmax(most_moved, way);
    }
    if (m->motion_views > 0 && most_turned <= 0 && most_moved <= 0)
        cln_info("poses: no training camera was corrected: the training was too short for that, "
                 "or nothing was to be gained");
    else if (m->motion_views > 0)
        cln_info("poses: the training cameras were turned by %.3f degrees and moved by %.3g units "
                 "on average, at most %.3f and %.3g",
                 turned, moved, most_turned, most_moved);
    if (outlier >= 0)
        cln_info(
            "poses: '%s' was turned by %.3f degrees, far more than the others (half of them by "
            "%.3f at most): it may have been bumped, and be off by more than these steps "
            "corrected; `cl-nascent eval --split all` shows how well it fits now",
            cln_scene_training_view(t->scene, outlier)->name, most_turned, median);
}
