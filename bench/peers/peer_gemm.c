/* build/bench-peers: compares the leaf networks with libraries for small matrix products, in turn,
 * in one process, on the same cores: eight layers of 64 x 64 with bias and activation, every leaf
 * with its own weights. Prints a table in Markdown.
 *
 *   bench-peers [DEVICE [ROUNDS [LEAVESxSAMPLES...]]]        "" or - = default
 *
 * Times forward, and training: forward, gradients of the inputs (not the first layer's) and of the
 * weights, in a scene's order and, for the peers, also block by block (peers/peer.h). Rates count 2
 * FLOP per weight and sample of each product. Each round measures the FMA ceiling, then every
 * contestant; rates and shares are medians over rounds; a share refers to its round's ceiling.
 *
 * Rows of the leaf networks: W64-D8 without view layer, through the library's stages. "layers" is
 * the time that six of its layers add to a network of two: without encoding, heads and grouping,
 * which the peers lack, but with the transposes and the biases' gradients, which they skip. "with
 * the rest" is the whole time, and the FLOP of every learned number.
 *
 * First, loops in double check the results of some samples and the gradients of two leaves. A peer
 * that fails, or was not found at build time, has no row. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/config.h"
#include "base/memory.h"
#include "base/number.h"
#include "peers/timing.h"
#include "peers/peer.h"
#include "reference/reference.h"

enum { W = PEER_WIDTH, L = PEER_LAYERS, FEW = 2, MAX_ROUNDS = 32 };
enum { MOST_LEAVES = 1 << (3 * CLN_MAX_LEVEL), MOST_SAMPLES = 1 << 22 };

static const peer *const peers[] = {
#ifdef PEER_XSMM
    &peer_xsmm,
#endif
#ifdef PEER_ONEDNN
    &peer_onednn,
#endif
#ifdef PEER_OPENBLAS
    &peer_openblas,
#endif
#ifdef PEER_CLBLAST
    &peer_clblast,
#endif
    NULL,
};
enum { PEERS = sizeof peers / sizeof peers[0] - 1 };

typedef struct shape {
    int leaves, samples;
} shape;

static const shape standard[] = {{64, 3072}, {64, 1536}, {256, 384}, {1024, 96}, {2048, 48}};

/* ---- the peers' data ---- */

/* Aligned like the device's buffers. */
static float *large(size_t n)
{
    float *out = cln_huge_pages(n * sizeof *out);

    return out ? out : malloc(n * sizeof *out);
}

static float *noise(size_t n, float scale, uint64_t seed)
{
    float *out = large(n);
    uint64_t x = seed;

    for (size_t i = 0; out && i < n; i++) { /* splitmix64 */
        uint64_t z = x += 0x9E3779B97F4A7C15u;

        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
        z = (z ^ z >> 27) * 0x94D049BB133111EBu;
        out[i] = scale * ((float)((z ^ z >> 31) >> 40) / (1 << 23) - 1);
    }
    return out;
}

static void free_data(peer_data *d)
{
    free((float *)d->x);
    free((float *)d->w);
    free((float *)d->wt);
    free((float *)d->bias);
    free((float *)d->dout);
    free(d->out);
    free(d->dw);
    free(d->kept);
}

static cln_status make_data(shape s, int threads, peer_data *d)
{
    const size_t layers = (size_t)s.leaves * L, all = (size_t)s.leaves * (size_t)s.samples * W;
    float *wt = large(layers * PEER_CELLS);

    *d = (peer_data){.leaves = s.leaves,
                     .samples = s.samples,
                     .threads = threads,
                     .x = noise(all, 1, 1),
                     .w = noise(layers * PEER_CELLS, sqrtf(6.0f / W), 2),
                     .wt = wt,
                     .bias = noise(layers * W, 0.1f, 3),
                     .dout = noise(all, 1e-3f, 4),
                     .out = large(all),
                     .dw = large(layers * PEER_CELLS),
                     .kept = large(all * L)};
    if (!d->x || !d->w || !wt || !d->bias || !d->dout || !d->out || !d->dw || !d->kept)
        return cln_fail(CLN_MEMORY, "bench-peers: out of host memory");
    for (size_t i = 0; i < layers; i++)
        for (int k = 0; k < PEER_CELLS; k++)
            wt[i * PEER_CELLS + (size_t)(k % W * W + k / W)] = d->w[i * PEER_CELLS + (size_t)k];
    return CLN_OK;
}

/* ---- checks ---- */

/* Worst error in units of the reference's rms. */
typedef struct error {
    double worst, square;
    size_t n;
} error;

static void see(error *e, double got, double want)
{
    const double off = fabs(got - want);

    if (!isnan(e->worst) && !(off <= e->worst)) /* a NaN stays */
        e->worst = off;
    e->square += want * want;
    e->n++;
}

static double worst_of(const error *e)
{
    return e->worst / sqrt(e->square / (double)e->n);
}

/* One sample through the layers of its leaf: z and h of each, in double. */
static void layers_of(const peer_data *d, int leaf, const float *x, double z[L][W], double h[L][W])
{
    for (int i = 0; i < L; i++) {
        const size_t layer = (size_t)leaf * L + (size_t)i;

        for (int o = 0; o < W; o++) {
            z[i][o] = d->bias[layer * W + (size_t)o];
            for (int k = 0; k < W; k++)
                z[i][o] +=
                    (i ? h[i - 1][k] : x[k]) * d->w[layer * PEER_CELLS + (size_t)(k * W + o)];
            h[i][o] = z[i][o] > 0 ? z[i][o] : PEER_SLOPE * z[i][o];
        }
    }
}

static double check_forward(const peer_data *d)
{
    error e = {0};
    double z[L][W], h[L][W];

    for (int i = 0; i < 64; i++) {
        const int leaf = (int)((int64_t)i * 7919 % d->leaves);
        const int sample = i % 4 ? (int)((int64_t)i * 104729 % d->samples) : d->samples - 1;
        const size_t at = ((size_t)leaf * (size_t)d->samples + (size_t)sample) * W;

        layers_of(d, leaf, d->x + at, z, h);
        for (int o = 0; o < W; o++)
            see(&e, d->out[at + (size_t)o], h[L - 1][o]);
    }
    return worst_of(&e);
}

/* Gradients of one leaf's weights, all its samples. */
static void gradients_of(const peer_data *d, int leaf, double (*dw)[PEER_CELLS])
{
    double z[L][W], h[L][W], g[W], next[W];

    memset(dw, 0, L * sizeof *dw);
    for (int s = 0; s < d->samples; s++) {
        const size_t at = ((size_t)leaf * (size_t)d->samples + (size_t)s) * W;

        layers_of(d, leaf, d->x + at, z, h);
        for (int o = 0; o < W; o++)
            g[o] = d->dout[at + (size_t)o];
        for (int i = L - 1; i >= 0; i--) {
            const float *w = d->w + ((size_t)leaf * L + (size_t)i) * PEER_CELLS;

            memset(next, 0, sizeof next);
            for (int o = 0; o < W; o++)
                g[o] *= z[i][o] > 0 ? 1 : PEER_SLOPE;
            for (int k = 0; k < W; k++)
                for (int o = 0; o < W; o++) {
                    dw[i][k * W + o] += (i ? h[i - 1][k] : d->x[at + (size_t)k]) * g[o];
                    next[k] += g[o] * w[k * W + o];
                }
            memcpy(g, next, sizeof g);
        }
    }
}

/* Raises *worst to the largest error found. */
static cln_status check_train(const peer_data *d, double *worst)
{
    cln_status st = CLN_OK;
    double(*dw)[PEER_CELLS] = NULL;
    error e = {0};

    CLN_TRY(cln_alloc(&dw, L, sizeof *dw, "gradients"));
    for (int leaf = 0; leaf < d->leaves; leaf += d->leaves - 1) { /* the first and the last */
        gradients_of(d, leaf, dw);
        for (int i = 0; i < L; i++)
            for (int k = 0; k < PEER_CELLS; k++)
                see(&e, d->dw[((size_t)leaf * L + (size_t)i) * PEER_CELLS + (size_t)k], dw[i][k]);
    }
    if (!isnan(*worst) && !(worst_of(&e) <= *worst))
        *worst = worst_of(&e);
done:
    free(dw);
    return st;
}

/* ---- ours ---- */

typedef struct ours {
    cln_model model;
    cln_pipeline p;
    uint32_t samples, slices;
    float (*origins)[4]; /* [sample], leaf i * 7919 % leaves */
    int leaves;
    bool training;
} ours;

static cln_status our_body(void *context)
{
    cln_status st = CLN_OK;
    ours *o = context;

    CLN_TRY(cln_stage_forward(&o->p, o->samples, o->slices, o->training, 1));
    if (o->training)
        CLN_TRY(cln_stage_backward(&o->p, o->samples, o->slices, 1));
    CLN_TRY(cln_device_finish(o->p.device));
done:
    return st;
}

/* A tree with exactly this many leaves: splits a part of the finest whole level that has no more,
 * then culls the surplus. */
static cln_status make_tree(int leaves, cln_octree *tree)
{
    cln_status st = CLN_OK;
    int level = 0, more = 0;
    uint8_t *marks = NULL;
    cln_octree_change change = {0};

    while (1 << (3 * (level + 1)) <= leaves)
        level++;
    CLN_TRY(cln_octree_create(level, tree));
    more = (leaves - tree->leaf_count + 6) / 7;
    CLN_TRY(cln_alloc(&marks, (size_t)tree->leaf_count + 8 * (size_t)more, 1, "leaf marks"));
    memset(marks, 1, (size_t)more);
    CLN_TRY(cln_octree_split(tree, marks, &change));
    cln_octree_change_free(&change);
    memset(marks, 0, (size_t)more);
    memset(marks, 1, (size_t)(tree->leaf_count - leaves));
    CLN_TRY(cln_octree_cull(tree, marks, &change));
    CLN_ASSERT(tree->leaf_count == leaves);
done:
    cln_octree_change_free(&change);
    free(marks);
    return st;
}

static cln_status make_ours(cln_device *device, shape s, int depth, ours *o)
{
    cln_status st = CLN_OK;
    cln_config config;
    cln_octree tree = {0};

    CLN_TRY(cln_config_preset("fast", &config));
    config.width = W;
    config.depth = depth;
    config.bands = 10; /* 63 inputs: the first layer is as large as the others */
    config.view_dependence = config.skip = config.adaptive = false;
    config.n1 = 2;
    config.roulette = 0; /* every sample takes part in the backward pass */
    CLN_TRY(make_tree(s.leaves, &tree));
    CLN_TRY(cln_model_create_on(&config, &tree, &o->model));
    CLN_TRY(cln_pipeline_create(device, &config, &(cln_pipeline_facts){.space = &cln_space_unit},
                                CLN_PROGRAMS_ALL, &o->p));
    CLN_TRY(cln_pipeline_rebuild(&o->p, o->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(&o->p, &o->model, true));
    o->leaves = s.leaves;
    o->samples = (uint32_t)(s.leaves * s.samples);
    CLN_TRY(bench_fill_leaves(&o->p, &o->model, s.leaves, s.samples, &o->slices, &o->origins));
done:
    cln_octree_free(&tree);
    return st;
}

static void free_ours(ours *o)
{
    cln_pipeline_free(&o->p);
    cln_model_free(&o->model);
    free(o->origins);
}

/* Compares some samples with the float64 twin; the tests check the gradients. */
static cln_status check_ours(ours *o, double *worst)
{
    cln_status st = CLN_OK;
    const cln_config *c = &o->model.config;
    ref_network net = {.net = o->p.net,
                       .density = c->density,
                       .kappa = c->density_scale,
                       .bias = cln_network_density_bias(c)};
    const double dir[3] = {0, 0, 1}, slope = 0.5 * (c->rrelu_lower + c->rrelu_upper);
    error colour = {0}, sigma = {0};
    float *boxes = NULL, got[4];

    for (int k = 0; k < 10; k++)
        net.level_bands[k] = 1;
    CLN_TRY(cln_octree_boxes(&o->model.tree, &boxes));
    o->training = false;
    CLN_TRY(our_body(o));
    for (uint32_t i = 0; i < 64; i++) {
        const uint32_t at = (uint32_t)((uint64_t)i * 104729 % o->samples);
        const size_t leaf = (size_t)at * 7919 % (size_t)o->leaves;
        const float *box = boxes + 4 * leaf;
        double local[3], want[4];

        for (int a = 0; a < 3; a++)
            local[a] = ((double)o->origins[at][a] - box[a]) / (0.5 * box[3]) - 1;
        ref_forward(&net, o->model.params + leaf * (size_t)net.net.params, local, dir, NULL, slope,
                    want);
        CLN_TRY(cln_buffer_read(o->p.device, &o->p.out, at * sizeof got, got, sizeof got));
        for (int k = 0; k < 4; k++)
            see(k < 3 ? &colour : &sigma, got[k], want[k]);
    }
    *worst = fmax(worst_of(&colour), worst_of(&sigma));
done:
    free(boxes);
    return st;
}

/* ---- in turn ---- */

typedef enum way { FORWARD, TRAIN, BLOCKS, WAYS } way; /* BLOCKS: training block by block */

/* A peer, or a network of ours. error: NaN = checked by the tests */
typedef struct contestant {
    const peer *peer; /* NULL = ours */
    void *own;
    bool takes[WAYS];
    double error[WAYS];
    double seconds[WAYS][MAX_ROUNDS]; /* NaN = not timed */
} contestant;

typedef struct turn {
    const contestant *who;
    way way;
} turn;

static cln_status take_turn(void *context)
{
    const turn *t = context;
    const contestant *c = t->who;

    if (!c->peer) {
        ((ours *)c->own)->training = t->way == TRAIN;
        return our_body(c->own);
    }
    return t->way == FORWARD ? c->peer->forward(c->own) : c->peer->train(c->own, t->way == TRAIN);
}

static cln_status take_turns(cln_device *device, contestant *list, int count, int rounds,
                             double *peak)
{
    cln_status st = CLN_OK;
    bench_time time;

    for (int r = 0; r < rounds; r++) {
        CLN_TRY(bench_peak(device, &peak[r]));
        for (int i = 0; i < count; i++)
            for (way w = FORWARD; w < WAYS; w++) {
                turn t = {&list[i], w};

                list[i].seconds[w][r] = NAN;
                if (!list[i].takes[w])
                    continue;
                CLN_TRY(bench_run(take_turn, &t, w == FORWARD ? 0.15 : 0.3, &time));
                list[i].seconds[w][r] = time.min;
            }
    }
done:
    return st;
}

static double median(const double *values, int n)
{
    double sorted[MAX_ROUNDS];

    memcpy(sorted, values, (size_t)n * sizeof *sorted);
    cln_reals_sort(sorted, n);
    return n % 2 ? sorted[n / 2] : 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]);
}

/* " | GFLOP/s | share"; less: seconds to subtract, NULL = none */
static void put_rate(double flop, const double *seconds, const double *less, const double *peak,
                     int rounds)
{
    double rate[MAX_ROUNDS], share[MAX_ROUNDS];

    for (int r = 0; r < rounds; r++) {
        rate[r] = flop / (seconds[r] - (less ? less[r] : 0)) * 1e-9;
        share[r] = 1e11 * rate[r] / peak[r];
    }
    if (isfinite(rate[0]))
        printf(" | %.1f | %.1f %%", median(rate, rounds), median(share, rounds));
    else
        printf(" | – | –");
}

static void put_error(const contestant *c, way w)
{
    if (c->peer && !c->takes[w])
        printf(" | –");
    else if (isfinite(c->error[w]))
        printf(" | %.1e", c->error[w]);
    else
        printf(" | tests");
}

/* flop: of forward and of training. */
static void put_row(shape s, const char *name, const contestant *c, const contestant *less,
                    const double flop[2], const double *peak, int rounds)
{
    printf("| %d x %d | %s", s.leaves, s.samples, name);
    for (way w = FORWARD; w < WAYS; w++) {
        put_rate(flop[w != FORWARD], c->seconds[w], less ? less->seconds[w] : NULL, peak, rounds);
        if (w != TRAIN)
            put_error(c, w);
    }
    printf(" |\n");
}

static cln_status open_peer(const peer *p, const peer_data *data, cln_device *device,
                            contestant *out)
{
    cln_status st = CLN_OK;
    double *trained = &out->error[BLOCKS];

    *out = (contestant){.peer = p, .takes = {true, p->train, p->train}};
    CLN_TRY(p->prepare(data, device, &out->own));
    CLN_TRY(p->forward(out->own));
    if (p->fetch)
        CLN_TRY(p->fetch(out->own));
    out->error[FORWARD] = check_forward(data);
    for (int kept = 0; kept < 2 && p->train; kept++) {
        CLN_TRY(p->train(out->own, kept));
        CLN_TRY(check_train(data, trained));
    }
done:
    return st;
}

/* Float32 over eight layers and 1,536 samples errs by about 1e-6, a wrong layer by about 1. */
static const double bound = 1e-4;

static cln_status open_ours(cln_device *device, shape s, int depth, ours *o, contestant *out)
{
    cln_status st = CLN_OK;

    *out = (contestant){.own = o, .takes = {true, true, false}, .error[BLOCKS] = NAN};
    CLN_TRY(make_ours(device, s, depth, o));
    CLN_TRY(check_ours(o, &out->error[FORWARD]));
    if (!(out->error[FORWARD] <= bound))
        CLN_TRY(cln_fail(CLN_CHECK,
                         "the leaf networks differ from float64 by %.2g of the rms; `cl-nascent "
                         "selftest` says where",
                         out->error[FORWARD]));
done:
    return st;
}

static cln_status run_shape(cln_device *device, shape s, int rounds)
{
    enum { WHOLE, SHALLOW, OURS };
    cln_status st = CLN_OK;
    const double samples = (double)s.leaves * s.samples, layer = 2.0 * PEER_CELLS * samples;
    const double peers_flop[2] = {L * layer, (3 * L - 1) * layer};
    const double layers_flop[2] = {(L - FEW) * layer, 3 * (L - FEW) * layer};
    double all_flop[2], peak[MAX_ROUNDS];
    peer_data data = {0};
    ours own[OURS] = {{.leaves = 0}};
    contestant list[OURS + PEERS + 1];
    int count = OURS;

    CLN_TRY(make_data(s, device->info.compute_units, &data));
    CLN_TRY(open_ours(device, s, L, &own[WHOLE], &list[WHOLE]));
    CLN_TRY(open_ours(device, s, FEW, &own[SHALLOW], &list[SHALLOW]));
    for (int i = 0; peers[i]; i++) {
        contestant *c = &list[count];

        if (peers[i]->host && strcmp(device->info.type, "cpu") != 0)
            continue;
        memset(data.out, 0xFF, (size_t)samples * W * sizeof *data.out); /* NaN */
        if (open_peer(peers[i], &data, device, c) == CLN_OK && c->error[FORWARD] <= bound &&
            c->error[BLOCKS] <= bound) {
            count++;
            continue;
        }
        fprintf(stderr, "bench-peers: %s is left out: %s (errors %.2g, %.2g)\n", peers[i]->name,
                cln_error_text(), c->error[FORWARD], c->error[BLOCKS]);
        cln_clear_error();
        peers[i]->release(c->own);
    }
    CLN_TRY(take_turns(device, list, count, rounds, peak));
    all_flop[0] = 2.0 * own[WHOLE].p.net.learned * samples;
    all_flop[1] =
        3 * all_flop[0] - 2.0 * own[WHOLE].p.net.enc * W * samples; /* encoding's gradient */
    put_row(s, "ours, layers", &list[WHOLE], &list[SHALLOW], layers_flop, peak, rounds);
    put_row(s, "ours, with the rest", &list[WHOLE], NULL, all_flop, peak, rounds);
    for (int i = OURS; i < count; i++)
        put_row(s, list[i].peer->name, &list[i], NULL, peers_flop, peak, rounds);
    printf("| %d x %d | FMA ceiling | %.1f | | | | | | | |\n", s.leaves, s.samples,
           1e-9 * median(peak, rounds));
    fflush(stdout);
done:
    for (int i = OURS; i < count; i++)
        list[i].peer->release(list[i].own);
    for (int i = 0; i < OURS; i++)
        free_ours(&own[i]);
    free_data(&data);
    return st;
}

static const char *argument(int argc, char **argv, int i)
{
    return argc > i && argv[i][0] && strcmp(argv[i], "-") != 0 ? argv[i] : NULL;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;
    const cln_device_desc desc = {.spec = argument(argc, argv, 1)};
    const char *given = argument(argc, argv, 2);
    cln_device *device = NULL;
    int rounds = given ? atoi(given) : 3;
    shape s;

    cln_log_set_sink(cln_log_stderr, NULL);
    rounds = rounds < 1 ? 1 : rounds > MAX_ROUNDS ? MAX_ROUNDS : rounds;
    CLN_TRY(cln_device_open(&desc, &device));
    printf("%s, %d threads, %d rounds; peers:", device->info.name, device->info.compute_units,
           rounds);
    for (int i = 0; peers[i]; i++)
        printf(" %s%s", peers[i]->name, peers[i + 1] ? "," : "");
    printf(
        "%s\n\n| leaves x samples | | forward, GFLOP/s | of ceiling | error | training, GFLOP/s | "
        "of ceiling | block by block | of ceiling | error "
        "|\n|---|---|---|---|---|---|---|---|---|---|\n",
        peers[0] ? "" : " none");
    for (int i = 3; i < argc; i++) {
        if (sscanf(argv[i], "%dx%d", &s.leaves, &s.samples) != 2 || s.leaves < 2 ||
            s.leaves > MOST_LEAVES || s.samples < 4 || s.samples % 4 ||
            (int64_t)s.leaves * s.samples > MOST_SAMPLES)
            CLN_TRY(cln_fail(
                CLN_USAGE,
                "'%s' is not LEAVESxSAMPLES: give 2 to %d leaves, a multiple of 4 samples, "
                "and a product of at most %d",
                argv[i], MOST_LEAVES, MOST_SAMPLES));
        CLN_TRY(run_shape(device, s, rounds));
    }
    for (size_t i = 0; argc < 4 && i < sizeof standard / sizeof standard[0]; i++)
        CLN_TRY(run_shape(device, standard[i], rounds));
done:
    if (st != CLN_OK)
        fprintf(stderr, "bench-peers: %s\n", cln_error_text());
    cln_device_close(device);
    return cln_status_exit_code(st);
}
