/* Kernels of single points at extreme optical depths: the gradients of distillation and of the
 * regularisers of points. See extremes.h. */
#include "check/extremes_intervals.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/rng.h"
#include "reference/reference.h"

static const char range[] = "sigma delta 0 to 1e6";

/* ---- distillation ---- */

/* Targets without alpha: the loss is alpha squared, and nothing cancels. */
cln_status cln_extremes_distil(cln_checks *c)
{
    enum { POINTS = 512 };
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    cln_sample samples[POINTS];
    float out[POINTS][4], targets[POINTS][4] = {{0}}, losses[POINTS], dout[POINTS][4];
    cln_extreme loss = cln_extreme_row(c, "loss", range);
    cln_extreme gradient = cln_extreme_row(c, "density gradient", range);

    for (uint32_t i = 0; i < POINTS; i++) {
        const double delta = pow(10, cln_check_uniform(61, i, -4, -1));
        const double depth = i % 16 == 0 ? 0 : pow(10, cln_check_uniform(62, i, -12, 6));

        samples[i] = (cln_sample){.delta = (float)delta, .ray = i};
        for (uint32_t k = 0; k < 3; k++)
            out[i][k] = (float)cln_check_uniform(63, 3 * i + k, 0, 1);
        out[i][3] = (float)(depth / delta);
    }
    CLN_TRY(cln_check_put(p->device, &p->samples, samples, sizeof samples));
    CLN_TRY(cln_check_put(p->device, &p->out, out, sizeof out));
    CLN_TRY(cln_check_put(p->device, &p->targets, targets, sizeof targets));
    CLN_TRY(cln_check_spoil(p->device, &p->dout, sizeof dout));
    CLN_TRY(cln_check_spoil(p->device, &p->losses, sizeof losses));
    CLN_TRY(cln_stage_distil_gradient(p, POINTS, 1));
    CLN_TRY(cln_buffer_read(p->device, &p->dout, 0, dout, sizeof dout));
    CLN_TRY(cln_buffer_read(p->device, &p->losses, 0, losses, sizeof losses));
    for (int i = 0; i < POINTS; i++) {
        const double target[4] = {0}, delta = samples[i].delta, x = (double)out[i][3] * delta;
        double wide[4], grad[4], want = 0;

        for (int k = 0; k < 4; k++)
            wide[k] = out[i][k];
        want = ref_distil(wide, target, delta, grad);
        cln_extreme_meet(&loss, losses[i], want, want, 1e-5, "sigma delta %.3g", x);
        for (int k = 0; k < 3; k++)
            cln_extreme_meet(&gradient, dout[i][k], 0, 1, 0, "sigma delta %.3g", x);
        if (x < 79) /* optical depths end at 80 */
            cln_extreme_meet(&gradient, dout[i][3], grad[3], grad[3], 1e-5 + 1e-6 * x,
                             "sigma delta %.3g", x);
        else
            cln_extreme_meet(&gradient, dout[i][3], 0, 1, 1e-33, "sigma delta %.3g", x);
    }
    cln_extreme_report(&loss);
    cln_extreme_report(&gradient);
done:
    return st;
}

/* ---- regularisers ---- */

enum { MOST = 1 << 15 };

typedef struct points {
    uint32_t points, pairs, all; /* samples: points, one side of each pair, the other */
    cln_sample samples[MOST];
    float out[MOST][4], got[MOST][4], (*boxes)[4];
} points;

/* Sets densities whose optical depth across a cell of stage 1 is 0 to 1e6. */
static void fill(const cln_pipeline *p, points *b)
{
    for (uint32_t i = 0; i < b->all; i++) {
        const double side = b->boxes[b->samples[i].slot][3];
        const double x = i % 16 == 0 ? 0 : pow(10, cln_check_uniform(64, i, -12, 6));

        for (uint32_t k = 0; k < 3; k++)
            b->out[i][k] = (float)cln_check_uniform(65, 3 * i + k, 0, 1);
        b->out[i][3] = (float)(x * p->config.n1 / side);
    }
}

static void compare_pair(const cln_pipeline *p, const cln_sampling *s, const points *b, uint32_t i,
                         cln_extreme *row)
{
    const uint32_t at[2] = {i, i + b->pairs};
    const double side =
        fmin(b->boxes[b->samples[at[0]].slot][3], b->boxes[b->samples[at[1]].slot][3]);
    const double spacing = side / p->config.n1;
    double wide[2][4], want[2][4];
    float u[4];

    cln_uniform4(s->seed, CLN_STREAM_POINTS, s->step, i, 1, u);
    for (int side_of = 0; side_of < 2; side_of++)
        for (int k = 0; k < 4; k++)
            wide[side_of][k] = b->out[at[side_of]][k];
    ref_edge_gradient(wide[0], wide[1], spacing, want[0], want[1]);
    for (int j = 0; j < 2; j++) {
        const double x = spacing * wide[j][3], weight = p->config.edge * u[3] / b->pairs;
        const double alpha = -expm1(-x), through = exp(-x);

        for (int k = 0; k < 4; k++) {
            const double got = b->got[at[j]][k], size = k < 3 ? alpha : spacing * through;

            cln_extreme_finite(row, got, "sigma delta %.3g", x);
            if (fmax(wide[0][3], wide[1][3]) * spacing < 15) /* else both alphas may round to 1 */
                cln_extreme_meet(row, got, weight * want[j][k], weight * size, 1e-5 + 1e-6 * x,
                                 "sigma delta %.3g and %.3g, value %d", x, spacing * wide[1 - j][3],
                                 k);
        }
    }
}

cln_status cln_extremes_regularisers(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_sampling s = {.jitter = true, .seed = 5, .step = 9, .max_samples = 1 << 20};
    cln_extreme sparsity = cln_extreme_row(c, "sparsity gradient", range);
    cln_extreme edge = cln_extreme_row(c, "edge gradient / alpha or light behind", range);
    cln_model model = {0};
    uint32_t samples = 0;
    points *b = NULL;

    CLN_TRY(cln_alloc(&b, 1, sizeof *b, "self-test"));
    CLN_TRY(cln_extreme_tree(c, &model));
    CLN_TRY(cln_octree_boxes(&model.tree, (float **)&b->boxes));
    b->all = (uint32_t)cln_pipeline_extra_samples(p);
    b->pairs = b->all - (uint32_t)cln_pipeline_extra_rays(p);
    b->points = b->all - 2 * b->pairs;
    CLN_ASSERT(b->all <= MOST && b->pairs > 0 && b->points > 0);
    CLN_TRY(cln_check_spoil(p->device, &p->ray_o, (b->points + b->pairs) * 4 * sizeof(float)));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_d, (b->points + b->pairs) * 4 * sizeof(float)));
    CLN_TRY(cln_check_spoil(p->device, &p->samples, b->all * sizeof *b->samples));
    CLN_TRY(cln_stage_regularise(p, &s, 0, &samples));
    CLN_TRY(cln_buffer_read(p->device, &p->samples, 0, b->samples, b->all * sizeof *b->samples));
    for (uint32_t i = 0; i < b->all; i++)
        if (b->samples[i].slot < 0 || b->samples[i].slot >= model.tree.leaf_count) {
            cln_check_say(c, "points", false, "sample %u is of leaf %d", i, b->samples[i].slot);
            goto done;
        }
    fill(p, b);
    CLN_TRY(cln_check_put(p->device, &p->out, b->out, b->all * sizeof *b->out));
    CLN_TRY(cln_check_spoil(p->device, &p->dout, b->all * sizeof *b->got));
    CLN_TRY(cln_stage_regularise_gradient(p, &s, b->all));
    CLN_TRY(cln_buffer_read(p->device, &p->dout, 0, b->got, b->all * sizeof *b->got));
    for (uint32_t i = 0; i < b->points; i++) {
        const double sigma = b->out[i][3];
        const double want = p->config.sparsity * ref_sparsity_gradient(sigma) / b->points;

        cln_extreme_meet(&sparsity, b->got[i][3], want, want, 1e-5 + 1e-8 * sigma, "sigma %.3g",
                         sigma);
        for (int k = 0; k < 3; k++)
            cln_extreme_meet(&sparsity, b->got[i][k], 0, 1, 0, "sigma %.3g", sigma);
    }
    for (uint32_t i = b->points; i < b->points + b->pairs; i++)
        compare_pair(p, &s, b, i, &edge);
    cln_extreme_report(&sparsity);
    cln_extreme_report(&edge);
done:
    cln_model_free(&model);
    if (b)
        free(b->boxes);
    free(b);
    return st;
}
