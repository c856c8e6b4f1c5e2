/* build/mpi/bench-scale: how training scales over ranks, for bench/scale/scale.sh. Reads only run
 * folders; model.h has the arithmetic and its assumptions.
 *
 *   mpirun -n 2 bench-scale messages   latency and bandwidth of training's messages, measured
 *   bench-scale bytes RUN              bytes per step that rank 0 sent: model, run, error; those
 *                                      about common vertices of voxels are apart, of the run
 *   bench-scale predict LATENCY BANDWIDTH CORES RUN... -- RUN...
 *
 * predict fits the costs to the runs before --, of one process each, compares the model with all
 * runs (those after -- are by ranks that share CORES cores and have messages of that LATENCY and
 * BANDWIDTH), and prints the model's figures for 1 to 1,024 ranks. Only the second half of a run's
 * steps counts. Exit status as cl-nascent's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/json.h"
#include "io/run_folder.h"
#include "ranks/ranks.h"
#include "scale/model.h"
#include "scene/dataset.h"

enum { MAX_RUNS = 32 };

/* Assumptions of the prediction in addition to model.h's. */
static const double BALANCE = 1.04;            /* leaves move above this (pipeline/share.c) */
static const double PHOTO_BYTES = 3 * 2e6;     /* a photo of 2 megapixels in host memory */
static const double TILE_BYTES = 64 * 36 * 12; /* its tiles of coverage (train/coverage.h) */
static const double MASK_BYTES = 2e6 / 8;      /* its mask, if it has one */
static const double STEP_SAMPLES = 262144;     /* of a step, the paper preset's */
static const double REFRESH_EVERY = 256;       /* steps, likewise */
/* Part of a passed leaf's time that goes into its cells: intervals_fill without them took 0.41 of
 * its time with 512 leaves, 0.31 with 4,096 (PoCL, one core of a Xeon, 2026-11-25). */
static const double CELLS = 0.64;
static const struct {
    const char *name;
    scale_network network;
} networks[] = {{"10 Gbit/s", {20e-6, 1.25e9}}, {"100 Gbit/s", {3e-6, 12.5e9}}};

typedef struct run {
    const char *path;
    scale_work work;                  /* ranks, leaves, samples and rays of a step */
    double steps, step;               /* measured steps; seconds per step */
    double shared, refresh, repeated; /* seconds per step */
    double sent, own_share, messages; /* rank 0's bytes per step and its share of what ranks send;
                                         seconds per step */
    double own_leaves;
    double vertices; /* of sent: about common vertices of voxels */
} run;

/* ---- from a run folder ---- */

static double number_or_0(const json_t *of, const char *name)
{
    const double x = cln_json_number(of, name);

    return isfinite(x) ? x : 0;
}

static double stage(const json_t *row, const char *name)
{
    return number_or_0(json_object_get(row, "stages"), name);
}

/* Stages whose work ranks share: each works on the samples of its own leaves. */
static const char *const shared_stages[] = {
    "samples", "group", "networks forward", "composite", "networks backward", "adam"};

static void add_row(const json_t *row, const json_t *before, run *r)
{
    const double seconds = cln_json_number(row, "seconds") - cln_json_number(before, "seconds");
    const double rays = cln_json_number(row, "rays_per_s") * seconds;
    const double samples = rays * cln_json_number(row, "samples_per_ray");
    const double steps = cln_json_number(row, "step") - cln_json_number(before, "step");
    const double stretches = cln_json_number(row, "stretches");
    const double share = cln_json_number(row, isfinite(stretches) ? "own_stretches" : "own_share");
    const double balance = cln_json_number(row, "balance");

    r->steps += steps;
    r->step += seconds;
    r->work.rays += rays;
    r->work.samples += samples;
    for (size_t i = 0; i < sizeof shared_stages / sizeof *shared_stages; i++)
        r->shared += stage(row, shared_stages[i]);
    r->work.stretches += isfinite(stretches) ? stretches * steps : 0;
    r->work.intervals += number_or_0(row, "intervals") * steps;
    r->refresh += stage(row, "stage 1 refresh");
    if (isfinite(share)) {
        r->sent += cln_json_number(row, "sent_bytes") - cln_json_number(before, "sent_bytes");
        r->vertices += number_or_0(row, "vertex_bytes") - number_or_0(before, "vertex_bytes");
        r->messages +=
            cln_json_number(row, "message_seconds") - cln_json_number(before, "message_seconds");
        r->own_share += share * samples;
        r->own_leaves += cln_json_number(row, "own_leaves") * samples;
        r->work.balance += balance * samples;
    }
}

static cln_status read_rows(run *r, double from)
{
    cln_status st = CLN_OK;
    char *path = NULL, *text = NULL, *rest = NULL;
    size_t bytes = 0;
    json_t *before = NULL;
    bool moved = false;

    CLN_TRY(cln_path_join(&path, r->path, "metrics.jsonl"));
    CLN_TRY(cln_read_file(path, (size_t)1 << 28, &text, &bytes));
    for (char *line = strtok_r(text, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest)) {
        json_t *row = json_loads(line, 0, NULL);
        const char *event = json_string_value(json_object_get(row, "event"));

        moved = moved || (event && strcmp(event, "balance") == 0);
        if (!row || event) {
            json_decref(row);
            continue;
        }
        /* a row with an evaluation also counts the evaluation's bytes, one with a move those of
         * leaves */
        if (before && cln_json_number(before, "step") >= from &&
            !json_object_get(row, "psnr_test") && !moved)
            add_row(row, before, r);
        moved = false;
        r->work.ranks = cln_json_number(row, "ranks");
        json_decref(before);
        before = row;
    }
    if (!(r->steps > 0 && r->work.samples > 0))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the second half of the run has fewer than two rows; train with more "
                         "--steps or a smaller --log-every",
                         path));
    r->own_share /= r->work.samples;
    r->own_leaves /= r->work.samples;
    r->work.balance /= r->work.samples;
    for (size_t i = 0; i < 11; i++)
        *(double *[]){&r->step,           &r->work.rays, &r->work.samples, &r->work.stretches,
                      &r->work.intervals, &r->shared,    &r->refresh,      &r->sent,
                      &r->vertices,       &r->messages,  &r->repeated}[i] /= r->steps;
    if (!(r->work.ranks > 1)) {
        r->work.ranks = r->work.balance = 1;
        r->own_share = 1;
        r->own_leaves = r->work.leaves;
    }
    r->repeated = fmax(r->step - r->shared - r->refresh - r->messages, 1e-9);
done:
    json_decref(before);
    free(path);
    free(text);
    return st;
}

/* A vertex in a message is a number and its features (kernels/halo.cl). */
static void read_voxels(const json_t *config, scale_work *work)
{
    static const int features[] = {4, 16, 32}; /* by harmonics (model/network.c) */
    const char *encoding = json_string_value(json_object_get(config, "encoding"));
    const json_int_t degree = json_integer_value(json_object_get(config, "harmonics"));
    const bool views = json_is_true(json_object_get(config, "view_dependence"));

    if (!encoding || strcmp(encoding, "voxel") != 0)
        return;
    work->cells = cln_json_number(config, "grid_cells");
    work->row_bytes = 4 + 4 * features[views && degree >= 0 && degree <= 2 ? degree : 0];
    work->places = 1;
}

static cln_status read_run(const char *path, run *r)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *config = NULL, *result = NULL;

    *r = (run){.path = path};
    CLN_TRY(cln_run_read(path, &document));
    config = json_object_get(document, "config");
    result = json_object_get(document, "result");
    r->work.leaves = cln_json_number(result, "leaves");
    r->work.density_bytes = 2 * pow(cln_json_number(config, "n1"), 3);
    r->work.refresh_every = cln_json_number(config, "refresh_every");
    read_voxels(config, &r->work);
    CLN_TRY(read_rows(r, floor(cln_json_number(result, "step") / 2)));
done:
    json_decref(document);
    return st;
}

/* ---- messages ---- */

/* Seconds of gathering `count` rows of 16 bytes on both ranks, the least of several series. */
static double time_gather(char *rows, int count)
{
    const int half = count / 2, first[3] = {0, half, count};
    double least = INFINITY;

    for (int series = 0; series < 5; series++) {
        const int calls = count > 100000 ? 5 : 200;
        double began = 0, seconds = 0;

        cln_ranks_gather(rows, 16, first, true); /* both begin together */
        began = cln_now();
        for (int i = 0; i < calls; i++)
            cln_ranks_gather(rows, 16, first, true);
        seconds = (cln_now() - began) / calls;
        cln_ranks_largest(&seconds, 1);
        least = fmin(least, seconds);
    }
    return least;
}

static cln_status measure_messages(void)
{
    enum { ROWS = 1 << 20 };
    cln_status st = CLN_OK;
    char *rows = NULL;
    double small = 0, large = 0;

    CLN_TRY(cln_ranks_open());
    if (cln_ranks_count() != 2)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "messages takes two processes: start it by `mpirun -n 2`, as built by "
                         "`make bench-scale-programs`"));
    CLN_TRY(cln_alloc(&rows, ROWS, 16, "messages"));
    memset(rows, 1, (size_t)ROWS * 16);
    small = time_gather(rows, 2);
    large = time_gather(rows, ROWS);
    if (cln_ranks_me() == 0)
        printf("%.3e %.4e\n", small, 8.0 * ROWS / fmax(large - small, 1e-9));
done:
    free(rows);
    return st;
}

/* ---- checks ---- */

static cln_status compare_bytes(const char *path)
{
    cln_status st = CLN_OK;
    run r;
    double model = 0;

    CLN_TRY(read_run(path, &r));
    if (!(r.sent > 0))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: the run was not trained by several processes", path));
    r.sent -= r.vertices;
    model = scale_sent(&r.work, r.own_share, r.own_leaves / r.work.leaves);
    printf("%.0f %.0f %.4f", model, r.sent, model / r.sent - 1);
    if (r.vertices > 0)
        printf(" %.0f", r.vertices);
    puts("");
done:
    return st;
}

static void put_cost(const char *what, const scale_cost *c)
{
    printf("| %s | %.3f | %.3f | %.3f |\n", what, 1e3 * c->step, 1e6 * c->each, 1e6 * c->leaf);
}

/* The machine as ranks see it that share its cores. */
static scale_machine shared_cores(const scale_machine *m, double cores, double ranks)
{
    scale_machine slowed = *m;
    const double turns = fmax(1, ranks / cores); /* ranks that share a core */

    for (size_t i = 0; i < 3; i++) {
        *(double *[]){&slowed.shared.step, &slowed.shared.each, &slowed.shared.leaf}[i] *= turns;
        *(double *[]){&slowed.repeated.step, &slowed.repeated.each, &slowed.repeated.leaf}[i] *=
            turns;
    }
    slowed.refresh *= turns;
    return slowed;
}

/* The spread with which the model is nearest to the runs by ranks, by least squares of relative
 * errors; 0 if it is slower than these without. */
static double fit_spread(const scale_machine *m, const scale_network *here, double cores,
                         const run *runs, int count)
{
    double above = 0, below = 0;

    for (int i = 0; i < count; i++) {
        const run *r = &runs[i];
        scale_machine slowed = shared_cores(m, cores, r->work.ranks);
        scale_step s;
        double unit = 0;

        if (!(r->work.ranks > 1))
            continue;
        slowed.spread = 0;
        s = scale_predict(&slowed, here, &r->work);
        unit = scale_slowest(r->work.ranks) * (s.shared + s.repeated) / r->step;
        above += unit * (1 - s.total / r->step);
        below += unit * unit;
    }
    return below > 0 ? fmax(0, above / below) : 0;
}

/* The part of samples with which the model is nearest to the runs' bytes about common vertices: the
 * mean of its relative errors is 0. Runs of networks have none, and leave 1. */
static cln_status fit_places(const run *runs, int count, double *out)
{
    double low = 1e-6, high = 1e3;
    bool told = false;

    *out = 1;
    for (int i = 0; i < count; i++)
        told |= runs[i].vertices > 0;
    if (!told)
        return runs[0].work.cells > 0
                   ? cln_fail(CLN_INPUT, "predict: no run after -- has vertex_bytes in "
                                         "metrics.jsonl, from which what voxels send is computed; "
                                         "give runs of voxels by ranks")
                   : CLN_OK;
    while (high / low > 1.0001) {
        const double middle = sqrt(low * high);
        double error = 0;

        for (int i = 0; i < count; i++) {
            scale_work w = runs[i].work;

            w.places = middle;
            if (runs[i].vertices > 0)
                error += scale_first_vertices(&w) / runs[i].vertices - 1;
        }
        *(error < 0 ? &low : &high) = middle;
    }
    *out = low;
    return CLN_OK;
}

static void put_check(const scale_machine *m, const scale_network *here, double cores, const run *r)
{
    const scale_machine slowed = shared_cores(m, cores, r->work.ranks);
    const scale_step s = scale_predict(&slowed, here, &r->work);

    printf("| %.0f | %.0f | %.0f | %.2f | %.2f | %.2f | %.2f | %+.0f %% |", r->work.ranks,
           r->work.leaves, r->work.samples, r->work.balance, 1e3 * s.waiting, 1e3 * s.total,
           1e3 * r->step, 100 * (s.total / r->step - 1));
    if (r->work.ranks > 1) {
        const double vertices = scale_first_vertices(&r->work);
        const double sent =
            scale_sent(&r->work, r->own_share, r->own_leaves / r->work.leaves) + vertices;

        printf(" %.0f | %.0f | %+.1f %% |", sent, r->sent, 100 * (sent / r->sent - 1));
        if (r->work.cells > 0)
            printf(" %.0f | %.0f | %+.1f %% |", vertices, r->vertices,
                   100 * (vertices / r->vertices - 1));
        puts("");
    } else {
        puts(r->work.cells > 0 ? " | | | | | |" : " | | |");
    }
}

/* ---- the prediction ---- */

/* The largest of the costs that more ranks do not reduce. */
static const char *reason(const scale_step *s)
{
    if (s->waiting > s->messages && s->waiting > s->repeated)
        return "waiting for the slowest rank";
    return s->messages >= s->repeated ? "messages: what all tell all"
                                      : "work repeated on every rank";
}

/* base: of one rank, without leaves; passed: leaves with samples per ray. */
static void put_network(const scale_machine *m, int n, const scale_work *base, double passed)
{
    printf(
        "\n### %s, %.0f us\n\n"
        "| leaves | steps/s of 1 rank | speed-up of 2 | 4 | 16 | 64 | 256 | 1,024 ranks | most | "
        "by ranks | half efficiency up to | MB per step and rank beyond it | limited by | GiB "
        "of densities on every rank |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        networks[n].name, 1e6 * networks[n].network.latency);
    for (double leaves = 1e4; leaves < 2e7; leaves *= 10) {
        scale_work w = *base;
        double alone = 0, most = 1, by = 1, half = 1;
        scale_step end;

        w.leaves = leaves;
        end = scale_predict(m, &networks[n].network, &w);
        alone = end.total;
        printf("| %.0e | %.3g", leaves, 1 / alone);
        for (int ranks = 2; ranks <= 1024; ranks *= 2) {
            scale_step s;

            w.ranks = ranks;
            w.intervals = w.rays * passed;
            w.stretches = w.rays * scale_stretches(passed, leaves, ranks);
            w.balance = BALANCE;
            s = scale_predict(m, &networks[n].network, &w);
            if (alone / s.total > most) {
                most = alone / s.total;
                by = ranks;
            }
            if (alone / s.total >= 0.5 * ranks)
                half = ranks;
            if (half * 2 >= ranks) /* the last count with half efficiency, or the first without */
                end = s;
            if (ranks == 2 || ranks == 4 || ranks == 16 || ranks == 64 || ranks == 256 ||
                ranks == 1024)
                printf(" | %.2f", alone / s.total);
        }
        printf(" | %.2f | %.0f | %.0f | %.2f | %s | %.3g |\n", most, by, half, 1e-6 * end.sent,
               reason(&end), leaves * w.density_bytes / (1 << 30));
    }
}

/* What the walk of own rays gains, and what another way would, which no run checks. */
static void put_walks(const scale_machine *m, const scale_work *base, double passed)
{
    static const struct {
        const char *name;
        scale_walk walk;
    } ways[] = {{"own rays alone, as it is", SCALE_OWN_RAYS},
                {"repeated", SCALE_REPEATED},
                {"cells of own leaves alone", SCALE_OWN_CELLS}};

    printf("\n## The walk of rays\n\n%s. The last way is not in the program: see walk in "
           "bench/scale/model.h.\n\n| walk | leaves | speed-up of 2 | 4 | 16 | 64 | 256 | 1,024 "
           "ranks | GiB of densities on one of 1,024 |\n|---|---|---|---|---|---|---|---|---|\n",
           networks[0].name);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
        for (double leaves = 1e4; leaves < 2e7; leaves *= 10) {
            const double held = ways[i].walk == SCALE_OWN_CELLS ? leaves / 1024 : leaves;
            scale_work w = *base;
            double alone = 0;

            w.leaves = leaves;
            w.walk = ways[i].walk;
            w.intervals = w.rays * passed;
            alone = scale_predict(m, &networks[0].network, &w).total;

            printf("| %s | %.0e", ways[i].name, leaves);
            for (size_t k = 0; k < 6; k++) {
                w.ranks = (double[]){2, 4, 16, 64, 256, 1024}[k];
                w.stretches = w.rays * scale_stretches(passed, leaves, w.ranks);
                w.balance = BALANCE;
                printf(" | %.2f", alone / scale_predict(m, &networks[0].network, &w).total);
            }
            printf(" | %.3g |\n", held * w.density_bytes / (1 << 30));
        }
}

static void put_photos(double seconds, double rays)
{
    printf(
        "\n## Photos\n\nOf 2 megapixels, dealt to the ranks' host memories. One pass: steps until "
        "each pixel was drawn\nonce, at %.0f rays a step and %.3g s a step (1 rank, 10,000 "
        "leaves). No more than %d photos are read.\n\n| photos | GiB in all | GiB a rank of 16 | "
        "of 1,024 | GiB of coverage on every rank | of masks | steps of a pass | days of a pass "
        "|\n|---|---|---|---|---|---|---|---|\n",
        rays, seconds, CLN_MAX_VIEWS);
    for (double photos = 1e3; photos <= CLN_MAX_VIEWS; photos *= 10) {
        const double all = photos * PHOTO_BYTES / (1 << 30);

        printf("| %.0e | %.3g | %.3g | %.3g | %.3g | %.3g | %.3g | %.3g |\n", photos, all, all / 16,
               all / 1024, photos * TILE_BYTES / (1 << 30), photos * MASK_BYTES / (1 << 30),
               photos * 2e6 / rays, photos * 2e6 / rays * seconds / 86400);
    }
}

static cln_status predict(int argc, char **argv)
{
    cln_status st = CLN_OK;
    run runs[MAX_RUNS];
    double x[MAX_RUNS][3], met[MAX_RUNS][3], shared_s[MAX_RUNS], repeated_s[MAX_RUNS];
    const scale_network here = {atof(argv[0]), atof(argv[1])};
    const double cores = atof(argv[2]);
    scale_machine m = {0};
    scale_work base = {.samples = STEP_SAMPLES,
                       .leaves = 1e4,
                       .refresh_every = REFRESH_EVERY,
                       .ranks = 1,
                       .balance = 1};
    int count = 0, alone = 0, refreshed = 0, several = 0;
    double passed = 0;

    for (int i = 3; i < argc; i++) {
        if (strcmp(argv[i], "--") == 0) {
            alone = count;
            continue;
        }
        if (count == MAX_RUNS)
            CLN_TRY(cln_fail(CLN_USAGE, "predict: give at most %d runs", MAX_RUNS));
        CLN_TRY(read_run(argv[i], &runs[count++]));
    }
    if (alone < 3 || !(here.bandwidth > 0) || !(cores > 0))
        CLN_TRY(cln_fail(
            CLN_USAGE, "predict needs LATENCY BANDWIDTH CORES, at least three runs of one process, "
                       "-- and runs by ranks"));
    for (int i = 0; i < alone; i++) {
        const scale_work *w = &runs[i].work;

        x[i][0] = met[i][0] = 1;
        met[i][1] = w->samples;
        x[i][1] = w->rays;
        x[i][2] = w->rays * scale_passes(w->leaves);
        met[i][2] = w->leaves * -expm1(-w->samples / w->leaves);
        shared_s[i] = runs[i].shared;
        repeated_s[i] = runs[i].repeated;
        if (runs[i].refresh > 0) {
            m.refresh += runs[i].refresh * w->refresh_every / w->leaves;
            refreshed++;
        }
        base.rays += w->rays / w->samples / alone * STEP_SAMPLES;
    }
    for (int i = alone; i < count; i++)
        if (runs[i].work.stretches > 0) {
            const run *by = &runs[i];

            passed +=
                scale_passed(by->work.stretches / by->work.rays, by->work.leaves, by->work.ranks);
            several++;
        }
    if (several == 0)
        CLN_TRY(cln_fail(CLN_USAGE, "predict: no run after -- has stretches; give runs by ranks"));
    passed /= several;
    m.refresh /= refreshed > 0 ? refreshed : 1;
    m.shared = scale_fit(alone, (const double(*)[3])met, shared_s);
    m.repeated = scale_fit(alone, (const double(*)[3])x, repeated_s);
    m.cells = CELLS;
    base.density_bytes = runs[0].work.density_bytes;
    base.cells = runs[0].work.cells;
    base.row_bytes = runs[0].work.row_bytes;
    CLN_TRY(fit_places(runs, count, &base.places));
    for (int i = 0; i < count; i++)
        runs[i].work.places = base.places;
    m.spread = fit_spread(&m, &here, cores, runs, count);
    printf("# Scaling by ranks\n\n| a step costs | ms | us each | us a leaf |\n"
           "|---|---|---|---|\n");
    put_cost("samples and networks, shared: a sample, a leaf with samples", &m.shared);
    put_cost("all else, repeated on every rank: a ray, a leaf that it passes", &m.repeated);
    printf("\nA leaf's refresh: %.1f us every %.0f steps, shared. Messages here: %.1f us, %.2f "
           "GB/s.\n",
           1e6 * m.refresh, runs[0].work.refresh_every, 1e6 * here.latency, 1e-9 * here.bandwidth);
    printf(
        "A ray has samples in %.1f leaves, by the stretches of the runs by ranks; their steps tell "
        "that\na rank's time for a step has a standard deviation of %.0f %%.\n",
        passed, 100 * m.spread);
    if (base.cells > 0)
        printf("Of a leaf's samples, a part of %.3f counts as at random places, by the runs' bytes "
               "about\ncommon vertices, %.0f each.\n",
               base.places, base.row_bytes);
    printf("\n## The model and the runs here, on %.0f cores\n\n| ranks | leaves | samples | "
           "balance | ms of waiting, model | ms a step, model | run | error | bytes a step of rank "
           "0, model | run | error |%s\n|---|---|---|---|---|---|---|---|---|---|---|%s\n",
           cores, base.cells > 0 ? " of common vertices, model | run | error |" : "",
           base.cells > 0 ? "---|---|---|" : "");
    for (int i = 0; i < count; i++)
        put_check(&m, &here, cores, &runs[i]);
    printf("\n## What 1 to 1,024 ranks would do\n\nEach rank is a machine with one core like this "
           "one's; %.0f samples a step, a refresh every %.0f;\nthe busiest rank has %.2f times "
           "the mean. Half "
           "efficiency: a speed-up of at least half the ranks. See bench/scale/model.h.\n",
           STEP_SAMPLES, REFRESH_EVERY, BALANCE);
    for (int n = 0; n < 2; n++)
        put_network(&m, n, &base, passed);
    put_walks(&m, &base, passed);
    put_photos(scale_predict(&m, &here, &base).total, base.rays);
done:
    return st;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;

    cln_log_set_sink(cln_log_stderr, NULL);
    if (argc == 2 && strcmp(argv[1], "messages") == 0)
        st = measure_messages();
    else if (argc == 3 && strcmp(argv[1], "bytes") == 0)
        st = compare_bytes(argv[2]);
    else if (argc > 5 && strcmp(argv[1], "predict") == 0)
        st = predict(argc - 2, argv + 2);
    else
        st = cln_fail(CLN_USAGE, "usage: bench-scale messages | bytes RUN | predict LATENCY "
                                 "BANDWIDTH CORES RUN... -- RUN...");
    if (st != CLN_OK)
        fprintf(stderr, "bench-scale: %s: %s\n", cln_status_phrase(st), cln_error_text());
    fflush(stdout);
    cln_ranks_close(st != CLN_OK, cln_status_exit_code(st));
    return cln_status_exit_code(st);
}
