/* Rays through the octree where float32 is on an edge: along axes, in faces, edges and corners of
 * leaves and one float beside them, grazing, starting inside a leaf or on its face. In a tree
 * without holes the samples of such a ray fill its chord of the cube, whichever leaf it is in. See
 * extremes.h; ordinary rays are selftest_rays.c's. */
#include "check/extremes_intervals.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* ---- the tree ---- */

/* Leaves of levels 1 to 8, the deepest in a corner, beside the middle and on a face. */
static cln_status make_model(const cln_config *config, cln_model *model)
{
    static const double deep[3][3] = {
        {-0.999, -0.999, -0.999}, {0.001, 0.001, 0.001}, {0.999, 0.001, -0.999}};
    cln_status st = CLN_OK;
    cln_octree_change change = {0};
    uint8_t *split = NULL;

    CLN_TRY(cln_model_create(config, model));
    for (int level = 2; level <= CLN_MAX_LEVEL; level++) {
        CLN_TRY(cln_alloc(&split, (size_t)model->tree.leaf_count, 1, "self-test"));
        for (int i = 0; i < 3; i++)
            split[cln_octree_find(&model->tree, deep[i])] = 1;
        CLN_TRY(cln_octree_split(&model->tree, split, &change));
        CLN_TRY(cln_model_apply(model, &change));
        cln_octree_change_free(&change);
        free(split);
        split = NULL;
    }
done:
    cln_octree_change_free(&change);
    free(split);
    return st;
}

/* ---- rays ---- */

typedef struct batch {
    int rays;
    float (*o)[4], (*d)[4];
} batch;

/* Origins on faces, edges, corners and middles of leaves. */
static const double lattice[] = {-1, -0.75, -0.5, -0.0625, 0, 0.3, 0.5, 1};
enum { LATTICE = sizeof lattice / sizeof *lattice };

/* Slopes off an axis: 0, one so small that it counts as 0, and small ones. */
static const double grazes[] = {0, 1e-13, 1e-9, 1e-6, 1e-4, 1e-2};
enum { GRAZES = sizeof grazes / sizeof *grazes };

enum { DIRECTIONS = 27, NUDGES = 3, STARTS = 2 };
enum {
    LATTICE_RAYS = LATTICE * LATTICE * LATTICE * STARTS * 2,
    GRAZING_RAYS = LATTICE * LATTICE * GRAZES * 6 * NUDGES
};

static void put(batch *b, const double from[3], const double along[3])
{
    const double length = sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);

    for (int a = 0; a < 3; a++) {
        b->o[b->rays][a] = (float)from[a];
        b->d[b->rays][a] = (float)(along[a] / length);
    }
    b->d[b->rays][3] = 1;
    b->rays++;
}

/* Adds rays through each point of the lattice, in two of the 26 directions to faces, edges and
 * corners, which take turns: one ray starts at the point, one 3 before it. */
static void put_lattice(batch *b)
{
    int turn = 0;

    for (int i = 0; i < LATTICE * LATTICE * LATTICE; i++)
        for (int k = 0; k < 2; k++) {
            const double at[3] = {lattice[i % LATTICE], lattice[i / LATTICE % LATTICE],
                                  lattice[i / LATTICE / LATTICE]};
            double along[3], before[3];

            if (turn % DIRECTIONS == 13) /* 0, 0, 0 is not a direction */
                turn++;
            for (int a = 0, t = turn++ % DIRECTIONS; a < 3; a++, t /= 3) {
                along[a] = t % 3 - 1;
                before[a] = at[a] - 3 * along[a];
            }
            put(b, at, along);
            put(b, before, along);
        }
}

/* Adds rays along every axis, both ways, in planes of the lattice and one float beside them. */
static void put_grazing(batch *b)
{
    for (int i = 0; i < LATTICE * LATTICE * GRAZES; i++)
        for (int way = 0; way < 6; way++)
            for (int nudge = -1; nudge <= 1; nudge++) {
                const int axis = way / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
                double from[3], along[3];

                along[axis] = way % 2 ? 1 : -1;
                along[u] = grazes[i / (LATTICE * LATTICE)];
                along[v] = -along[u] / 3;
                from[axis] = -2 * along[axis];
                from[u] = lattice[i % LATTICE];
                from[v] = lattice[i / LATTICE % LATTICE];
                if (nudge != 0)
                    from[u] = nextafterf((float)from[u], 2.0f * (float)nudge);
                put(b, from, along);
            }
}

/* ---- samples ---- */

/* The cube as half-spaces, as cln_sampling's crop. */
static const float cube[6][4] = {{1, 0, 0, 1},  {-1, 0, 0, 1}, {0, 1, 0, 1},
                                 {0, -1, 0, 1}, {0, 0, 1, 1},  {0, 0, -1, 1}};

/* A ray's distance inside a half-space, at t = 0 and more per unit of t. */
static void approach(const float n[4], const float o[4], const float d[4], double *at,
                     double *along)
{
    *at = n[3];
    *along = 0;
    for (int a = 0; a < 3; a++) {
        *at += (double)n[a] * o[a];
        *along += fabs((double)d[a]) < 1e-12 ? 0 : (double)n[a] * d[a];
    }
}

/* Length of a ray's part in the cube and in the crop, if there is one. *vague: the ray runs in a
 * face of one, as far as float32 can tell, so it may count as inside or outside. */
static double chord_of(const float (*crop)[4], const float o[4], const float d[4], bool *vague)
{
    const int planes = crop ? 12 : 6;
    double from = 0, upto = INFINITY, at = 0, along = 0;

    *vague = false;
    for (int i = 0; i < planes; i++) {
        approach(i < 6 ? cube[i] : crop[i - 6], o, d, &at, &along);
        if (along == 0) {
            *vague |= fabs(at) < 2e-7;
            if (at < 0)
                return 0;
        } else if (along > 0) {
            from = fmax(from, -at / along);
        } else {
            upto = fmin(upto, -at / along);
        }
    }
    for (int i = 0; i < planes; i++) {
        approach(i < 6 ? cube[i] : crop[i - 6], o, d, &at, &along);
        /* grazes a face: rounding its place there moves its end by the rounding over the slope */
        *vague |= along != 0 && fabs(along) < 0.1 &&
                  (fabs(at + along * from) < 1e-6 || fabs(at + along * upto) < 1e-6);
    }
    return fmax(upto - from, 0);
}

/* Rays of the pipeline, and the samples that they got. */
typedef struct sampled {
    const cln_octree *tree;
    float (*boxes)[4], (*o)[4], (*d)[4]; /* [leaf]; [ray], both */
    uint32_t samples, *starts, *used;    /* starts: [ray + 1]; used: [ray] intervals */
    cln_sample *sample;                  /* [sample] */
} sampled;

static void free_sampled(sampled *s)
{
    free(s->boxes);
    free(s->starts);
    free(s->used);
    free(s->sample);
    free(s->o);
    free(s->d);
}

/* On failure *out may be partly filled. */
static cln_status sample_rays(const cln_checks *c, const cln_octree *tree, int rays, sampled *out)
{
    /* leaves no interval out, so samples fill chords */
    const cln_sampling sampling = {.jitter = true,
                                   .crop = c->crop,
                                   .uniform_share = 0.25f,
                                   .empty_share = 1,
                                   .seed = 3,
                                   .step = 1,
                                   .max_samples = 1 << 24};
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const size_t n = (size_t)rays;
    int whole = 0;

    out->tree = tree;
    CLN_TRY(cln_octree_boxes(tree, (float **)&out->boxes));
    CLN_TRY(cln_alloc(&out->starts, n + 1, sizeof *out->starts, "self-test"));
    CLN_TRY(cln_alloc(&out->used, n, sizeof *out->used, "self-test"));
    CLN_TRY(cln_alloc(&out->o, n, sizeof *out->o, "self-test"));
    CLN_TRY(cln_alloc(&out->d, n, sizeof *out->d, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_o, 0, out->o, n * sizeof *out->o));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_d, 0, out->d, n * sizeof *out->d));
    CLN_TRY(cln_stage_sample(p, rays, &sampling, &whole, &out->samples));
    CLN_TRY(cln_buffer_read(p->device, &p->sample_starts, 0, out->starts,
                            (n + 1) * sizeof *out->starts));
    CLN_TRY(cln_buffer_read(p->device, &p->used, 0, out->used, n * sizeof *out->used));
    CLN_TRY(cln_alloc(&out->sample, out->samples, sizeof *out->sample, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->samples, 0, out->sample,
                            out->samples * sizeof *out->sample));
done:
    return st;
}

/* How far a sample is outside of its leaf. */
static double distance_outside(const sampled *s, int ray, const cln_sample *sample)
{
    const float *box = s->boxes[sample->slot];
    double off = 0;

    for (int a = 0; a < 3; a++) {
        const double at = s->o[ray][a] + (double)sample->t * s->d[ray][a] - box[a];

        off = fmax(off, fmax(-at, at - box[3]));
    }
    return off;
}

/* Checks order and places of a ray's samples; returns the length that they fill. */
static double check_samples(const sampled *s, int r, cln_extreme *order, cln_extreme *places)
{
    const float *o = s->o[r], *d = s->d[r];
    double filled = 0, last = 0;

    for (uint32_t i = s->starts[r]; i < s->starts[r + 1]; i++) {
        const cln_sample *sample = &s->sample[i];
        const bool valid = sample->slot >= 0 && sample->slot < s->tree->leaf_count;

        cln_extreme_meet(
            order, sample->t >= last && sample->delta >= 0 && valid && sample->ray == (uint32_t)r,
            1, 1, 0, "ray %d, from %g %g %g along %g %g %g", r, (double)o[0], (double)o[1],
            (double)o[2], (double)d[0], (double)d[1], (double)d[2]);
        cln_extreme_finite(order, sample->delta, "ray %d", r);
        if (!valid)
            break;
        cln_extreme_meet(places, distance_outside(s, r, sample), 0, 1, 2e-6, "ray %d from %g %g %g",
                         r, (double)o[0], (double)o[1], (double)o[2]);
        last = sample->t;
        filled += sample->delta;
    }
    return filled;
}

cln_status cln_extreme_chords(cln_checks *c, const cln_octree *tree, int rays, const char *range)
{
    cln_status st = CLN_OK;
    cln_extreme chords = cln_extreme_row(c, "samples fill the chord", range);
    cln_extreme places = cln_extreme_row(c, "samples in their leaf", range);
    cln_extreme order = cln_extreme_row(c, "order of samples", range);
    cln_extreme compared = cln_extreme_row(c, "share of rays not compared", range);
    sampled s = {0};
    int met = 0;

    CLN_TRY(sample_rays(c, tree, rays, &s));
    cln_extreme_meet(&order, s.starts[rays], s.samples, 1, 0, "the last start");
    for (int r = 0; r < rays && s.starts[rays] == s.samples; r++) {
        const float *o = s.o[r], *d = s.d[r];
        const bool ascends = s.starts[r] <= s.starts[r + 1] && s.starts[r + 1] <= s.samples;
        bool vague = false;
        const double chord = chord_of(c->crop, o, d, &vague);
        double filled = 0;

        cln_extreme_meet(&order, ascends, 1, 1, 0, "ray %d's start", r);
        if (!ascends)
            break;
        filled = check_samples(&s, r, &order, &places);
        if (vague)
            continue;
        met += chord > 0;
        /* a ray may lose chords shorter than CLN_MIN_CHORD in a few leaves */
        cln_extreme_meet(&chords, filled, chord, 1, (s.used[r] + 3) * (double)CLN_MIN_CHORD,
                         "ray %d, from %g %g %g along %g %g %g", r, (double)o[0], (double)o[1],
                         (double)o[2], (double)d[0], (double)d[1], (double)d[2]);
    }
    cln_extreme_report(&chords);
    cln_extreme_report(&places);
    cln_extreme_report(&order);
    cln_extreme_meet(&compared, (double)met / rays, 1, 1, 0.75, "all rays");
    cln_extreme_report(&compared);
done:
    free_sampled(&s);
    return st;
}

cln_status cln_extreme_tree(cln_checks *c, cln_model *model)
{
    cln_status st = CLN_OK;

    CLN_TRY(make_model(&c->p->config, model));
    CLN_TRY(cln_pipeline_upload(c->p, model, false));
done:
    return st;
}

cln_status cln_extremes_intervals(cln_checks *c)
{
    static const char *const names[2][2] = {{"rays in faces", "rays, grazing"},
                                            {"cropped rays in faces", "cropped rays, grazing"}};
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const char *shape = c->shape;
    cln_model model = {0};
    batch b = {0};

    CLN_TRY(cln_extreme_tree(c, &model));
    CLN_TRY(cln_alloc(&b.o, LATTICE_RAYS + GRAZING_RAYS, sizeof *b.o, "self-test"));
    CLN_TRY(cln_alloc(&b.d, LATTICE_RAYS + GRAZING_RAYS, sizeof *b.d, "self-test"));
    for (int grazing = 0; grazing < 2; grazing++) {
        b.rays = 0;
        if (grazing)
            put_grazing(&b);
        else
            put_lattice(&b);
        CLN_TRY(cln_check_put(p->device, &p->ray_o, b.o, (size_t)b.rays * sizeof *b.o));
        CLN_TRY(cln_check_put(p->device, &p->ray_d, b.d, (size_t)b.rays * sizeof *b.d));
        c->shape = names[c->crop != NULL][grazing];
        CLN_TRY(cln_extreme_chords(
            c, &model.tree, b.rays,
            grazing ? "along axes, in and beside faces, slopes 0 to 0.01, leaves of levels 1 to 8"
                    : "on faces, edges, corners, to all 26 sides, leaves of levels 1 to 8"));
    }
done:
    c->shape = shape;
    cln_model_free(&model);
    free(b.o);
    free(b.d);
    return st;
}

/* A crop box with faces that are leaves', faces that are not, one beyond the cube, and one that is
 * aslant. */
cln_status cln_extremes_cropped(cln_checks *c)
{
    static const float box[6][4] = {{1, 0, 0, 0.75f}, {-1, 0, 0, 0.8f}, {0, 1, 0, 1.5f},
                                    {0, -1, 0, 0.9f}, {0, 0, 1, 0.95f}, {-0.6f, 0, -0.8f, 0.9f}};
    cln_status st = CLN_OK;

    c->crop = box;
    st = cln_extremes_intervals(c);
    c->crop = NULL;
    return st;
}
