/* The choice of samples for the backward pass at extremes: gradients from 0 to 1e30 in one leaf and
 * between leaves, colours and densities at their ends, leaves of one sample up to several segments,
 * cutoffs up to the largest. See extremes.h. */
#include "check/extremes.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "reference/reference.h"

enum { SEGMENT = CLN_ROULETTE_SEGMENT, LEAVES = 10, SLICES = LEAVES + 1, LEAST = 4, MOST = 1300 };

/* Samples per leaf, a slice each: too few, about a vector, about segments. Leaves differ in the
 * size of gradients, too. */
static const int counts[LEAVES] = {LEAST - 1, LEAST,       7,   9,   SEGMENT - 1,
                                   SEGMENT,   SEGMENT + 1, 300, 100, 40};
static const char *const names[LEAVES] = {
    "too few samples",   "gradients of 1e-30", "gradients of 1e-15", "gradients of 1",
    "gradients of 1e15", "gradients of 1e30",  "1e-30 to 1",         "1 large among 1e-30",
    "all equal",         "no gradient"};

typedef struct batch {
    uint32_t n;
    float out[MOST][4], dout[MOST][4]; /* [sample] */
    cl_uint order[MOST], begin[LEAVES], end[LEAVES];
    cln_slice slices[SLICES]; /* the last is empty */
    /* the device's choice */
    float heads[MOST][4];
    cl_uint chosen[MOST], counts[SLICES];
} batch;

static double gradient_of(int leaf, int i)
{
    const uint32_t draw = (uint32_t)(leaf * MOST + i);
    const double one = cln_check_uniform(131, draw, 0.1, 1) * (draw % 3 ? 1 : -1);

    switch (leaf) {
    case 1:
    case 2:
    case 3:
    case 4:
    case 5:
        return one * pow(10, 15 * leaf - 45);
    case 6:
        return one * pow(10, cln_check_uniform(132, draw, -30, 0));
    case 7:
        return one * (i / 4 == 123 ? 1 : 1e-30);
    case 8:
        return 0.25;
    case 9:
        return 0;
    default:
        return one;
    }
}

/* Colours up to the last float before an end of the sigmoid, and at it; densities from 0 up. */
static void make_batch(batch *b)
{
    static const float colours[] = {0, 1e-30f, 1e-7f, 0.25f, 0.5f, 0.9f, 1 - FLT_EPSILON / 2, 1};
    uint32_t at = 0;

    memset(b, 0, sizeof *b);
    for (int l = 0; l < LEAVES; l++) {
        b->slices[l] = (cln_slice){l, at, (cl_uint)counts[l], LEAVES};
        b->begin[l] = at;
        at = b->end[l] = at + (cl_uint)counts[l];
    }
    b->n = at;
    CLN_ASSERT(at <= MOST);
    for (int l = 0; l < LEAVES; l++)
        for (int i = 0; i < counts[l]; i++) {
            const uint32_t row =
                b->begin[l] + (uint32_t)i; /* 367 has no divisor in common with n */
            const uint32_t id = b->order[row] = (cl_uint)((uint64_t)row * 367 % b->n);

            for (int k = 0; k < 4; k++) {
                b->out[id][k] = l == 8 ? 0.5f : colours[cln_hash(4 * row + (uint32_t)k) % 8];
                b->dout[id][k] = (float)gradient_of(l, 4 * i + k);
            }
            if (l != 8)
                b->out[id][3] =
                    row % 5 ? (float)pow(10, cln_check_uniform(133, row, -36, l == 3 ? 34 : 4)) : 0;
        }
}

static cln_status run(cln_pipeline *p, double cutoff, uint32_t step_key, batch *b)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t n = b->n;

    CLN_TRY(cln_check_put(device, &p->slices, b->slices, sizeof b->slices));
    CLN_TRY(cln_check_put(device, &p->begin, b->begin, sizeof b->begin));
    CLN_TRY(cln_check_put(device, &p->end, b->end, sizeof b->end));
    CLN_TRY(cln_check_put(device, &p->values[0], b->order, n * sizeof *b->order));
    CLN_TRY(cln_check_put(device, &p->out, b->out, n * sizeof *b->out));
    CLN_TRY(cln_check_put(device, &p->dout, b->dout, n * sizeof *b->dout));
    CLN_TRY(cln_check_spoil(device, &p->heads, n * sizeof *b->heads));
    CLN_TRY(cln_check_spoil(device, &p->chosen, n * sizeof *b->chosen));
    CLN_TRY(cln_check_spoil(device, &p->chosen_counts, sizeof b->counts));
    CLN_TRY(cln_stage_roulette(p, b->n, SLICES, LEAST, cutoff, step_key));
    CLN_TRY(cln_buffer_read(device, &p->heads, 0, b->heads, n * sizeof *b->heads));
    CLN_TRY(cln_buffer_read(device, &p->chosen, 0, b->chosen, n * sizeof *b->chosen));
    CLN_TRY(cln_buffer_read(device, &p->chosen_counts, 0, b->counts, sizeof b->counts));
done:
    return st;
}

/* Compares a leaf's choice. A segment with a draw that is too near its threshold for float32 may
 * choose otherwise, but only samples, and in order. */
static void compare_leaf(const cln_pipeline *p, const batch *b, int l, double cutoff,
                         uint32_t step_key, cln_extreme *choice, cln_extreme *heads)
{
    const ref_network r = {.density = p->config.density, .kappa = p->config.density_scale};
    const cl_uint *chosen = b->chosen + b->begin[l];
    const float(*got)[4] = b->heads + b->begin[l];
    const cl_uint count = b->counts[l], all = (cl_uint)counts[l];
    cl_uint used = 0;

    cln_extreme_meet(choice, count >= 1 && count <= all, 1, 1, 0, "%s, cutoff %g", names[l],
                     cutoff);
    if (count < 1 || count > all)
        return;
    for (cl_uint first = 0; first < all; first += SEGMENT) {
        const int n = all - first < SEGMENT ? (int)(all - first) : SEGMENT;
        double want[SEGMENT][4], factors[SEGMENT], most = 0;
        const bool near =
            ref_roulette(&r, cutoff, cln_hash(step_key), n, b->order + b->begin[l] + first, b->out,
                         b->dout, want, factors) < 1e-5;

        for (int i = 0; i < n; i++)
            most = fmax(most, factors[i]);
        for (int i = 0; i < n; i++) {
            const cl_uint row = first + (cl_uint)i;
            const bool here = used < count && chosen[used] == row;

            /* where none has a gradient, the first takes part for all */
            if (!near && (most > 0 || row > 0))
                cln_extreme_meet(choice, here, factors[i] > 0, 1, 0, "%s, cutoff %g, sample %u",
                                 names[l], cutoff, row);
            if (!here)
                continue;
            for (int k = 0; k < 4; k++) {
                const double head = (double)got[used][k];

                if (near)
                    cln_extreme_finite(heads, head, "%s, sample %u", names[l], row);
                else
                    cln_extreme_meet(heads, head, want[i][k], fabs(want[i][k]), 1e-5,
                                     "%s, cutoff %g, sample %u, head %d", names[l], cutoff, row, k);
            }
            used++;
        }
    }
    cln_extreme_meet(choice, used, count, 1, 0, "%s, cutoff %g, number", names[l], cutoff);
}

cln_status cln_extremes_roulette(cln_checks *c)
{
    static const double cutoffs[] = {0, 1e-3, 0.1, 4, 1000};
    cln_status st = CLN_OK;
    cln_extreme choice =
        cln_extreme_row(c, "samples that take part",
                        "gradients 0, 1e-30 to 1e30, cutoffs 0 to 1000, 4 to 300 samples");
    cln_extreme heads =
        cln_extreme_row(c, "gradients of heads", "the same, colours and densities at their ends");
    batch *b = NULL;

    CLN_TRY(cln_alloc(&b, 1, sizeof *b, "self-test"));
    make_batch(b);
    for (size_t k = 0; k < sizeof cutoffs / sizeof *cutoffs; k++)
        for (uint32_t key = 1; key <= 4; key++) {
            CLN_TRY(run(c->p, cutoffs[k], key, b));
            cln_extreme_meet(&choice, b->counts[0] + b->counts[LEAVES], 0, 1, 0, "%s", names[0]);
            for (int l = 1; l < LEAVES; l++)
                compare_leaf(c->p, b, l, cutoffs[k], key, &choice, &heads);
        }
    cln_extreme_report(&choice);
    cln_extreme_report(&heads);
done:
    free(b);
    return st;
}
