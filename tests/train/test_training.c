/* Training as a whole: it learns; seed and settings determine every bit, also across interruptions;
 * growth, culling and both kinds of stage 1; impossible requests fail with their status and write
 * nothing. test_results.c tests functions that read a run. */
#include "unit.h"
#include "model/model.h"
#include "run_fixture.h"
#include "render/quality.h"
#include "render/open_run.h"
#include "tests.h"

static FILE *open_metrics(const char *run)
{
    char name[64];
    FILE *f = NULL;

    snprintf(name, sizeof name, "%s/metrics.jsonl", run);
    f = fopen(fixture_path(name), "r");
    assert_non_null(f);
    return f;
}

/* Column `key` of a run's metrics.jsonl, of steps (event NULL) or of one kind of event; returns the
 * number of rows. */
static int column(const char *run, const char *event, const char *key, double *out, int most)
{
    char line[4096];
    FILE *f = open_metrics(run);
    int rows = 0;

    while (fgets(line, sizeof line, f)) {
        json_t *row = json_loads(line, 0, NULL);
        const char *is = json_string_value(json_object_get(row, "event"));

        if (is && event ? strcmp(is, event) == 0 : is == event) {
            assert_true(json_is_number(json_object_get(row, key)));
            assert_true(rows < most);
            out[rows++] = json_number_value(json_object_get(row, key));
        }
        json_decref(row);
    }
    fclose(f);
    return rows;
}

static int metrics(const char *run, const char *key, double *out, int most)
{
    return column(run, NULL, key, out, most);
}

static void assert_every_step_once(const char *run, int steps)
{
    double step[256];

    assert_int_equal(metrics(run, "step", step, 256), steps);
    for (int i = 0; i < steps; i++)
        assert_int_equal((int)step[i], i + 1);
}

static void test_learns(void **state)
{
    double loss[STEPS], first = 0, last = 0;
    json_t *run = NULL;
    char *left_out = NULL;

    NEED_DEVICE();
    assert_int_equal(fixture_whole.step, STEPS);
    assert_int_equal(fixture_whole.leaves, 8);
    assert_true(fixture_whole.psnr_test > fixture_constant_psnr() + 1);
    assert_true(fixture_whole.psnr_test < 60);
    assert_int_equal(metrics("whole", "loss", loss, STEPS), STEPS);
    for (int i = 0; i < 5; i++) {
        first += loss[i];
        last += loss[STEPS - 1 - i];
    }
    assert_true(last < 0.7 * first);
    run = fixture_json("whole/run.json");
    assert_string_equal(json_string_value(fixture_at(run, "state")), "done");
    assert_int_equal(json_integer_value(fixture_at(run, "result.step")), STEPS);
    left_out = json_dumps(fixture_at(run, "left_out"), 0);
    assert_non_null(strstr(left_out, "\"regularisers: sparsity, cauchy, opacity-entropy, "
                                     "distortion-loss, edge, view-l2\""));
    free(left_out);
    json_decref(run);
    assert_int_equal(fixture_digest("whole"), fixture_whole.digest);
    assert_true(cln_is_file(fixture_path("whole/report.html")));
}

static void test_seed_decides(void **state)
{
    cln_config config = fixture_config();
    cln_train_result again, other;
    fixture_stop seen = {0};

    NEED_DEVICE();
    assert_ok(fixture_train("again", false, &config, &seen, &again));
    assert_true(fabs(seen.psnr_seen - again.psnr_test) < 10);
    assert_int_equal(seen.steps_seen, STEPS);
    assert_int_equal(seen.train_calls, STEPS); /* after the first step, too */
    assert_int_equal(again.digest, fixture_whole.digest);
    config.seed = 7;
    assert_ok(fixture_train("other", false, &config, NULL, &other));
    assert_int_not_equal(other.digest, fixture_whole.digest);
}

/* Stopped after a step, then resumed: run.json keeps the settings not given to the second
 * process. */
static void test_interrupted(void **state)
{
    const cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 13};
    cln_train_result result;
    json_t *before = NULL, *after = NULL;

    NEED_DEVICE();
    assert_fails(fixture_train("stopped", false, &config, &stop, &result), CLN_SIGINT, "--resume");
    assert_int_equal(result.step, 13);
    assert_int_not_equal(fixture_digest("stopped"), fixture_whole.digest);
    before = fixture_json("stopped/run.json");
    assert_string_equal(json_string_value(fixture_at(before, "state")), "interrupted");
    assert_ok(fixture_train("stopped", true, &config, NULL, &result));
    assert_int_equal(result.digest, fixture_whole.digest);
    assert_int_equal(fixture_digest("stopped"), fixture_whole.digest);
    assert_every_step_once("stopped", STEPS);
    after = fixture_json("stopped/run.json");
    assert_string_equal(json_string_value(fixture_at(after, "state")), "done");
    assert_true(json_equal(fixture_at(after, "started"), fixture_at(before, "started")));
    assert_true(json_equal(fixture_at(after, "dataset"), fixture_at(before, "dataset")));
    assert_string_equal(json_string_value(fixture_at(after, "dataset.path")),
                        fixture_path("scene"));
    assert_string_equal(json_string_value(fixture_at(after, "preset")), "fast");
    json_decref(before);
    json_decref(after);
}

/* How many steps of a run spent time on refreshing stage 1. */
static int refreshes(const char *run)
{
    char line[4096];
    FILE *f = open_metrics(run);
    int count = 0;

    while (fgets(line, sizeof line, f)) {
        json_t *row = json_loads(line, 0, NULL), *stages = json_object_get(row, "stages");

        count += json_number_value(json_object_get(stages, "stage 1 refresh")) > 0;
        json_decref(row);
    }
    fclose(f);
    return count;
}

/* A rolling refresh changes the training; it, too, resumes as if it had not been stopped. */
static void test_rolling_refresh(void **state)
{
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 21};
    cln_train_result whole, resumed;

    NEED_DEVICE();
    config.rolling_refresh = true;
    assert_ok(fixture_train("rolling", false, &config, NULL, &whole));
    assert_int_not_equal(whole.digest, fixture_whole.digest);
    assert_int_equal(refreshes("whole"), 4);   /* steps 0, 8, 16, 24 */
    assert_int_equal(refreshes("rolling"), 2); /* steps 0 and 16 */
    assert_fails(fixture_train("rolling-stopped", false, &config, &stop, &resumed), CLN_SIGINT,
                 "--resume");
    assert_ok(fixture_train("rolling-stopped", true, &config, NULL, &resumed));
    assert_int_equal(resumed.digest, whole.digest);
}

/* SIGTERM while test views are rendered: the training is complete; evaluations and their abortion
 * do not change it. */
static void test_interrupted_in_evaluation(void **state)
{
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGTERM, .pictures = 2};
    cln_train_result result;

    NEED_DEVICE();
    config.eval_every = 11;
    assert_fails(fixture_train("looking", false, &config, &stop, &result), CLN_SIGTERM, "step 11");
    assert_int_equal(result.step, 11);
    /* next pictures: at step 22, and at the end, where it is stopped again */
    stop = (fixture_stop){.signal = SIGINT, .pictures = TEST_VIEWS + 2};
    assert_fails(fixture_train("looking", true, &config, &stop, &result), CLN_SIGINT,
                 "last evaluation");
    assert_int_equal(result.digest, fixture_whole.digest);
    assert_false(cln_is_file(fixture_path("looking/eval/00000030-test.json")));
    assert_ok(fixture_train("looking", true, &config, NULL, &result));
    assert_int_equal(fixture_digest("looking"), fixture_whole.digest);
    assert_true(cln_is_file(fixture_path("looking/eval/00000030-test.json")));
    assert_every_step_once("looking", STEPS);
}

/* A signal while photos are read, long before the first step. */
static void test_interrupted_at_photos(void **state)
{
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .photos = 1};
    cln_train_result result;

    NEED_DEVICE();
    assert_fails(fixture_train("reading", false, &config, &stop, &result), CLN_SIGINT,
                 "before the first step");
    assert_int_equal(stop.photos_seen, 1);
    assert_int_equal(stop.pictures_seen, 0); /* no kernel was checked */
    assert_false(cln_is_file(fixture_path("reading/run.json")));
    config.steps = STEPS / 2;
    assert_ok(fixture_train("reading", false, &config, NULL, &result));
    config.steps = STEPS;
    stop = (fixture_stop){.signal = SIGTERM, .photos = 1};
    assert_fails(fixture_train("reading", true, &config, &stop, &result), CLN_SIGTERM,
                 "the run is as it was");
    assert_true(cln_is_file(fixture_path("reading/checkpoint/00000015.json")));
}

/* SIGUSR1 writes an extra checkpoint and changes nothing else. */
static void test_checkpoint_on_the_way(void **state)
{
    const cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGUSR1, .step = 7};
    cln_train_result result;

    NEED_DEVICE();
    assert_ok(fixture_train("saved", false, &config, &stop, &result));
    assert_int_equal(result.digest, fixture_whole.digest);
    assert_true(cln_is_file(fixture_path("saved/checkpoint/00000007.json")));
    assert_true(cln_is_file(fixture_path("saved/checkpoint/00000030.json")));
}

/* On resume budgets may grow and batches shrink; the network may not change. */
static void test_resumed_with_other_settings(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;

    NEED_DEVICE();
    config.steps = STEPS / 2;
    assert_ok(fixture_train("more", false, &config, NULL, &result));
    config.steps = STEPS;
    config.rays = 32;
    assert_ok(fixture_train("more", true, &config, NULL, &result));
    assert_int_equal(result.step, STEPS);
    config.start_level = 2; /* of which a warning says that it has no effect */
    config.steps += 2;
    assert_ok(fixture_train("more", true, &config, NULL, &result));
    assert_int_equal(result.leaves, 8);
    config.width = 32;
    assert_fails(fixture_train("more", true, &config, NULL, &result), CLN_CHECKPOINT, "width");
}

/* Voxels keep Adam's first moments with --beta1 above 0 alone; a resumed run may begin or end
 * that. */
static void test_resumed_with_moments(void **state)
{
    cln_config config = fixture_config();
    cln_train_result first, more;

    NEED_DEVICE();
    config.encoding = CLN_ENCODING_VOXEL;
    config.start_level = 2;
    config.grid_cells = 8; /* moments of many bytes */
    config.beta1 = 0;
    config.steps = 10;
    assert_ok(fixture_train("moments", false, &config, NULL, &first));
    config.beta1 = 0.9;
    config.steps = 20;
    assert_ok(fixture_train("moments", true, &config, NULL, &more));
    assert_true(more.psnr_test > first.psnr_test - 1);
    config.steps = 25; /* from a checkpoint that has them */
    assert_ok(fixture_train("moments", true, &config, NULL, &more));
    assert_true(more.psnr_test > first.psnr_test - 1);
    config.beta1 = 0;
    config.steps = 30;
    assert_ok(fixture_train("moments", true, &config, NULL, &more));
    assert_int_equal(more.step, 30);
    assert_true(more.psnr_test > first.psnr_test - 1);
}

/* ---- structure ---- */

static double psnr_of(cln_open_run *v, const int *views, int count)
{
    cln_eval_result result = {0};
    double psnr = 0;

    assert_ok(cln_pipeline_upload(&v->pipeline, &v->model, false));
    assert_ok(
        cln_quality_measure(&v->pipeline, NULL, v->scene, views, count, NULL, NULL, NULL, &result));
    psnr = result.psnr;
    cln_eval_free(&result);
    return psnr;
}

/* method.md 11: the exact split by folding does not change pictures. */
static void test_split_keeps_pictures(void **state)
{
    const bool pixels[CLN_SPLITS] = {true, false, true};
    const cln_device_desc device = fixture_device();
    cln_open_run v;
    cln_octree_change change = {0};
    double before = 0, after = 0;
    int *views = NULL, count = 0;

    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 0, &views, &count));
    before = psnr_of(&v, views, count);
    assert_true(before == fixture_whole.psnr_test);
    assert_ok(cln_octree_split(&v.model.tree, NULL, &change));
    assert_ok(cln_model_apply(&v.model, &change));
    assert_int_equal(v.model.tree.leaf_count, 64);
    after = psnr_of(&v, views, count);
    print_message("PSNR before and after a split: %.4f %.4f dB\n", before, after);
    assert_true(fabs(before - after) < 0.05);
    cln_octree_change_free(&change);
    cln_open_run_close(&v);
    free(views);
}

static void test_growth(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;
    double leaves[STEPS], loss[STEPS];

    NEED_DEVICE();
    snprintf(config.level_at, sizeof config.level_at, "2:0.5");
    assert_ok(fixture_train("grown", false, &config, NULL, &result));
    assert_int_equal(result.leaves, 64);
    assert_int_equal(metrics("grown", "leaves", leaves, STEPS), STEPS);
    metrics("grown", "loss", loss, STEPS);
    assert_int_equal((int)leaves[STEPS / 2 - 1], 8);
    assert_int_equal((int)leaves[STEPS / 2], 64);
    assert_true(loss[STEPS - 1] < loss[0]);
}

/* The host waits for the device once a step, and once for a row of metrics. */
static void test_waits(void **state)
{
    enum { EVERY = 10 };
    cln_config config = fixture_config();
    cln_train_result result;
    double waits[STEPS] = {0}, least = INFINITY;
    int rows = 0;

    (void)state;
    NEED_DEVICE();
    config.level_at[0] = 0;
    config.adaptive = false;
    config.log_every = EVERY;
    assert_ok(fixture_train("watched", false, &config, NULL, &result));
    rows = metrics("watched", "host_waits", waits, STEPS);
    assert_int_equal(rows, STEPS / EVERY);
    for (int i = 0; i < rows; i++) /* rows with a refresh or an evaluation have more */
        least = fmin(least, waits[i]);
    assert_int_equal((int)least, EVERY + 1);
}

/* Number of leaves after `step` steps. */
static double leaves_at(const char *run, int step)
{
    double leaves[STEPS];

    metrics(run, "leaves", leaves, STEPS);
    return leaves[step - 1];
}

/* Culling that would remove every leaf keeps one; training continues with it and the pixels that
 * see it, also when resumed just before and after. */
static void test_culling(void **state)
{
    static const int stops[] = {6, 7, 8, 9, 20};
    cln_config config = fixture_config();
    cln_train_result all, part;
    json_t *run = NULL;
    char *left_out = NULL;

    NEED_DEVICE();
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0.2;
    config.refresh_every = 4;
    assert_ok(fixture_train("culled", false, &config, NULL, &all));
    assert_int_equal(all.leaves, 1);
    assert_true(isfinite(all.psnr_test));
    run = fixture_json("culled/run.json");
    left_out = json_dumps(fixture_at(run, "left_out"), 0);
    assert_non_null(strstr(left_out, "87.5% of the cube"));
    assert_non_null(strstr(left_out, "of the training pixels"));
    free(left_out);
    json_decref(run);
    assert_int_equal((int)leaves_at("culled", stops[0]), 8);
    assert_int_equal((int)leaves_at("culled", stops[3]), 1);
    for (size_t i = 0; i < sizeof stops / sizeof stops[0]; i++) {
        fixture_stop stop = {.signal = SIGINT, .step = stops[i]};
        char name[32];

        snprintf(name, sizeof name, "cut-%d", stops[i]);
        assert_fails(fixture_train(name, false, &config, &stop, &part), CLN_SIGINT, "");
        assert_ok(fixture_train(name, true, &config, NULL, &part));
        assert_int_equal(part.digest, all.digest);
    }
    config.cull_after = 10; /* a check every four steps */
    assert_ok(fixture_train("later", false, &config, NULL, &all));
    assert_int_equal((int)leaves_at("later", 11), 8);
    assert_int_equal((int)leaves_at("later", 13), 1);
}

/* Mean square error of the last rows of a run, by their PSNR. */
static double last_error(const char *run)
{
    double psnr[STEPS], sum = 0;
    const int rows = metrics(run, "psnr_train", psnr, STEPS);

    for (int i = rows / 3; i < rows; i++)
        sum += pow(10, -psnr[i] / 10) / (rows - rows / 3);
    return sum;
}

/* The training PSNR is over all training pixels, even if rays only go through some of them. */
static void test_psnr_of_all_pixels(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;
    double all = 0, covered = 0;

    NEED_DEVICE();
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0.1;
    config.refresh_every = 4;
    config.lr = config.lr_final = 1e-8;
    config.rays = 2048;
    config.batch_samples = 65536;
    assert_ok(fixture_train("covered", false, &config, NULL, &result));
    covered = last_error("covered");
    config.skip_uncovered = false;
    assert_ok(fixture_train("all", false, &config, NULL, &result));
    all = last_error("all");
    if (!(fabs(covered / all - 1) < 0.03))
        fail_msg("mean square error %.4g, by the covered pixels %.4g", all, covered);
}

/* Number of structure decisions of a run; *sum: the sum of their column `key`. */
static int decisions(const char *run, const char *key, double *sum)
{
    double values[STEPS];
    const int rows = column(run, "structure", key, values, STEPS);

    *sum = 0;
    for (int i = 0; i < rows; i++)
        *sum += values[i];
    return rows;
}

static cln_config adaptive_config(void)
{
    cln_config config = fixture_config();

    config.adaptive = true;
    config.start_level = 2;
    config.max_leaves = 90;
    config.structure_from = 0.2;
    config.structure_every = 0.2;
    config.structure_until = 0.9;
    config.split_samples = 0;
    config.merge_factor = 0.9; /* merges and splits in a few steps */
    config.distil_steps = 30;
    config.distil_samples = 32;
    return config;
}

/* What a later decision and culling need of the last one is in the checkpoint: when many leaves
 * became others, and what the leaves cost that merged ones replaced. */
static void check_kept_of_decisions(const char *run)
{
    double step[STEPS], leaves[STEPS], kept[STEPS];
    const int n = column(run, "structure", "step", step, STEPS);
    int changed = 0, saved = 0;
    cln_model model;

    assert_int_equal(column(run, "structure", "leaves", leaves, STEPS), n);
    assert_int_equal(column(run, "structure", "kept", kept, STEPS), n);
    for (int i = 0; i < n; i++)
        if (leaves[i] - kept[i] > leaves[i] / 8)
            changed = (int)step[i];
    assert_true(changed > 0);
    assert_ok(cln_checkpoint_read(fixture_path(run), true, &model));
    assert_int_equal(model.growth_step, changed);
    for (int s = 0; s < model.tree.leaf_count; s++)
        if (!isnan(model.saved[s])) {
            assert_true(model.saved[s] > 0);
            saved++;
        }
    assert_true(saved > 0);
    cln_model_free(&model);
}

/* The integer program in training: merges to meet the budget, then splits and merges within it; the
 * same bits when interrupted before, between and after decisions. */
static void test_adaptive(void **state)
{
    static const int stops[] = {5, 6, 13, 25};
    cln_config config = adaptive_config();
    cln_train_result whole, part;
    double sum = 0, leaves[STEPS];

    NEED_DEVICE();
    assert_ok(fixture_train("adaptive", false, &config, NULL, &whole));
    assert_true(whole.leaves <= 90 && isfinite(whole.psnr_test));
    assert_int_equal(decisions("adaptive", "merged", &sum), 4);
    assert_true(sum >= 1);
    decisions("adaptive", "split", &sum);
    assert_true(sum >= 1);
    decisions("adaptive", "distil_steps", &sum);
    assert_true(sum >= 25);
    metrics("adaptive", "leaves", leaves, STEPS);
    assert_int_equal((int)leaves[5], 64);
    assert_true((int)leaves[6] != 64 && leaves[6] <= 90);
    check_kept_of_decisions("adaptive");
    for (size_t i = 0; i < sizeof stops / sizeof stops[0]; i++) {
        fixture_stop stop = {.signal = SIGINT, .step = stops[i]};
        char run[32];

        snprintf(run, sizeof run, "adaptive-%d", stops[i]);
        assert_fails(fixture_train(run, false, &config, &stop, &part), CLN_SIGINT, "");
        assert_ok(fixture_train(run, true, &config, NULL, &part));
        assert_int_equal(part.digest, whole.digest);
        assert_int_equal(decisions(run, "leaves", &sum), 4);
    }
}

/* Voxels split within the budget, but never merge nor become finer than the photos tell; the same
 * bits when interrupted. */
static void test_adaptive_voxels(void **state)
{
    cln_config config = adaptive_config();
    fixture_stop stop = {.signal = SIGINT, .step = 13};
    cln_train_result whole, part;
    double sum = 0;

    NEED_DEVICE();
    config.encoding = CLN_ENCODING_VOXEL;
    config.grid_cells = 4;
    config.beta1 = 0;
    config.smooth_density = config.smooth_colour = 1e-8;
    config.cell_pixels = 0.1;
    config.max_leaves = 120;
    assert_ok(fixture_train("voxels", false, &config, NULL, &whole));
    assert_true(whole.leaves > 64 && whole.leaves <= 120 && isfinite(whole.psnr_test));
    assert_int_equal(decisions("voxels", "merged", &sum), 4);
    assert_true(sum == 0);
    decisions("voxels", "split", &sum);
    assert_true(whole.leaves - 64 <= 7 * (int)sum); /* a split drops children that are empty */
    assert_fails(fixture_train("halves", false, &config, &stop, &part), CLN_SIGINT, "");
    assert_ok(fixture_train("halves", true, &config, NULL, &part));
    assert_int_equal(part.digest, whole.digest);
    config.cell_pixels = 100;
    assert_ok(fixture_train("coarse", false, &config, NULL, &whole));
    assert_int_equal(whole.leaves, 64);
}

/* A larger budget on resume brings decisions again, at their fractions of it; the same bits when
 * interrupted then. Whole levels of voxels stay over, and so does the first decision. */
static void test_adaptive_extended(void **state)
{
    cln_config config = adaptive_config();
    fixture_stop stop = {.signal = SIGINT, .step = 40};
    cln_train_result whole, part;
    double sum = 0, step[STEPS];

    NEED_DEVICE();
    assert_ok(fixture_train("extended", false, &config, NULL, &whole));
    assert_ok(fixture_train("prolonged", false, &config, NULL, &part));
    config.steps = 3 * STEPS; /* now at 1/3 of it */
    assert_ok(fixture_train("extended", true, &config, NULL, &whole));
    assert_int_equal(column("extended", "structure", "step", step, STEPS), 7);
    for (int i = 0; i < 4; i++) /* a step late where the fraction is rounded down */
        assert_in_range((int)step[i], 6 * (i + 1), 6 * (i + 1) + 1);
    for (int i = 0; i < 3; i++)
        assert_in_range((int)step[4 + i], 36 + 18 * i, 36 + 18 * i + 1);
    assert_fails(fixture_train("prolonged", true, &config, &stop, &part), CLN_SIGINT, "");
    assert_ok(fixture_train("prolonged", true, &config, NULL, &part));
    assert_int_equal(part.digest, whole.digest);
    config = adaptive_config();
    config.encoding = CLN_ENCODING_VOXEL;
    config.grid_cells = 4;
    config.beta1 = 0;
    config.max_leaves = 300;
    strcpy(config.level_at, "3:0.5"); /* which decisions come before */
    assert_ok(fixture_train("voxels-on", false, &config, NULL, &whole));
    assert_int_equal(decisions("voxels-on", "merged", &sum), 4);
    config.steps = 6 * STEPS; /* now at 1/6, before --structure-from */
    assert_ok(fixture_train("voxels-on", true, &config, NULL, &whole));
    assert_int_equal(column("voxels-on", "structure", "step", step, STEPS), 7);
    for (int i = 0; i < 3; i++)
        assert_in_range((int)step[4 + i], 72 + 36 * i, 72 + 36 * i + 1);
    assert_true(whole.leaves <= 300);
}

/* No decision comes after structure_until; the weight of density is part of the decisions. */
static void test_adaptive_settings(void **state)
{
    cln_config config = adaptive_config();
    cln_train_result ends, weighs;
    double sum = 0, leaves[STEPS];

    NEED_DEVICE();
    config.structure_until = 0.5;
    assert_ok(fixture_train("ends", false, &config, NULL, &ends));
    assert_int_equal(decisions("ends", "leaves", &sum), 2); /* at 0.2 and 0.4 */
    metrics("ends", "leaves", leaves, STEPS);
    assert_int_equal((int)leaves[STEPS - 1], (int)leaves[STEPS / 2]);
    config = adaptive_config();
    config.cost_density = 2;
    assert_ok(fixture_train("weighs", false, &config, NULL, &weighs));
    assert_true(weighs.leaves <= 90);
    assert_true(weighs.digest != fixture_digest("adaptive"));
}

/* A falling error delays decisions; densities weighted by visibility give another measure. */
static void test_adaptive_waits(void **state)
{
    cln_config config = adaptive_config();
    cln_train_result waits, weighted, again;
    fixture_stop stop = {.signal = SIGINT, .step = 14};
    double sum = 0;

    NEED_DEVICE();
    config.structure_wait = 1;
    assert_ok(fixture_train("waits", false, &config, NULL, &waits));
    assert_true(decisions("waits", "leaves", &sum) < 4);
    config.structure_wait = 0;
    config.density_weight = CLN_WEIGHT_VISIBILITY;
    assert_ok(fixture_train("weighted", false, &config, NULL, &weighted));
    assert_true(weighted.leaves <= 90);
    assert_true(weighted.digest != fixture_digest("adaptive"));
    assert_fails(fixture_train("weighted-cut", false, &config, &stop, &again), CLN_SIGINT, "");
    assert_ok(fixture_train("weighted-cut", true, &config, NULL, &again));
    assert_int_equal(again.digest, weighted.digest);
}

/* An infeasible budget is reported, and merges bring the tree as close to it as possible. */
static void test_adaptive_infeasible(void **state)
{
    cln_config config = adaptive_config();
    cln_train_result result;
    double sum = 0;
    FILE *f = NULL;
    char line[4096] = "";

    NEED_DEVICE();
    config.max_leaves = 3;
    assert_ok(fixture_train("infeasible", false, &config, NULL, &result));
    assert_true(decisions("infeasible", "merged", &sum) >= 1);
    assert_true(result.leaves <= 8);
    f = fopen(fixture_path("infeasible/metrics.jsonl"), "r");
    while (fgets(line, sizeof line, f) && !strstr(line, "\"infeasible\":true"))
        ;
    assert_non_null(strstr(line, "\"infeasible\":true"));
    fclose(f);
}

/* The tree of another run is kept unchanged. */
static void test_tree_from(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result, base;

    NEED_DEVICE();
    config.adaptive = true;
    snprintf(config.tree_from, sizeof config.tree_from, "%s", fixture_path("adaptive"));
    assert_ok(fixture_train("taken", false, &config, NULL, &result));
    config = adaptive_config();
    assert_ok(fixture_train("adaptive-again", false, &config, NULL, &base));
    assert_int_equal(result.leaves, base.leaves);
    assert_int_not_equal(result.digest, base.digest);
}

/* Memory of culled leaves is freed. */
static void test_memory_given_back(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;
    double memory[STEPS];

    NEED_DEVICE();
    config.start_level = 3;
    config.n1 = 8;
    config.cull = CLN_CULL_MEAN;
    config.cull_mean = 1e6;
    config.cull_from = 0.4;
    config.refresh_every = 4;
    assert_ok(fixture_train("returned", false, &config, NULL, &result));
    assert_int_equal(result.leaves, 1);
    assert_int_equal(metrics("returned", "dev_mem", memory, STEPS), STEPS);
    assert_true(memory[STEPS - 1] < 0.5 * memory[5]);
}

/* ---- stage 1 by projection ---- */

static void train_splat(const char *run, int lists, cln_train_result *result)
{
    cln_config config = fixture_config();

    config.stage1 = CLN_STAGE1_SPLAT;
    config.lists = lists;
    assert_ok(fixture_train(run, false, &config, NULL, result));
}

static void test_splat(void **state)
{
    cln_train_result csr, padded;
    double loss[STEPS];

    NEED_DEVICE();
    train_splat("csr", CLN_LISTS_CSR, &csr);
    assert_int_equal(metrics("csr", "loss", loss, STEPS), STEPS);
    assert_true(loss[STEPS - 1] < 0.8 * loss[0]);
    assert_int_not_equal(csr.digest, fixture_whole.digest);
    train_splat("padded", CLN_LISTS_PADDED, &padded);
    assert_int_equal(padded.digest, csr.digest);
}

/* Memory for only a part of a view's projected samples: bands of rows give the same picture. */
static void test_splat_in_bands(void **state)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    const float white[3] = {1, 1, 1};
    const cln_camera *pointer = NULL;
    cln_camera tall;
    cln_open_run v;
    cln_picture whole, bands;
    cln_train_result result;
    size_t n = 0;

    NEED_DEVICE();
    train_splat("tall", CLN_LISTS_CSR, &result);
    assert_ok(cln_open_run_open(fixture_path("tall"), NULL, pixels, NULL, &v));
    tall = v.scene->views[0].camera;
    tall.width = 64;
    tall.height = 192; /* three bands of 64 rows, the coarsest pixel */
    tall.fx = tall.fy = 8 * tall.fx;
    tall.cx = 32;
    tall.cy = 96;
    n = (size_t)tall.width * (size_t)tall.height;
    pointer = &tall;
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_cameras(&v.pipeline, &pointer, 1, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_render_view(&v.pipeline, 0, white, false, NULL, &whole));
    assert_true(v.pipeline.splat_entries > 100);
    v.pipeline.max_entries = (size_t)v.pipeline.splat_entries * 3 / 5;
    assert_ok(cln_render_view(&v.pipeline, 0, white, false, NULL, &bands));
    assert_memory_equal(whole.rgb, bands.rgb, 3 * n * sizeof(float));
    assert_memory_equal(whole.depth, bands.depth, n * sizeof(float));
    cln_picture_free(&bands);
    v.pipeline.max_entries = 10;
    assert_fails(cln_render_view(&v.pipeline, 0, white, false, NULL, &bands), CLN_MEMORY,
                 "--stage1 gather");
    cln_picture_free(&whole);
    cln_open_run_close(&v);
}

/* ---- what cannot work ---- */

static void assert_nothing_written(const char *run)
{
    assert_false(cln_is_dir(fixture_path(run)));
}

static void test_too_little_memory(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;

    NEED_DEVICE();
    config.device_mem = 1 << 20;
    assert_fails(fixture_train("never", false, &config, NULL, &result), CLN_MEMORY, "--device-mem");
    assert_nothing_written("never");
}

static void test_broken_kernel(void **state)
{
    const char text[] = "this is no OpenCL;\n";
    const cln_settings settings = {.config = fixture_config(), .preset = "fast"};
    cln_train_desc desc = {.scene = fixture_path("scene"),
                           .run = fixture_path("never"),
                           .skip_selftest = true,
                           .settings = &settings,
                           .device = fixture_device()};
    cln_train_result result;

    NEED_DEVICE();
    assert_ok(cln_make_dirs(fixture_path("kernels")));
    scratch_put(fixture_path("kernels/composite.cl"), text, strlen(text));
    desc.device.kernel_dir = fixture_path("kernels");
    assert_fails(cln_train(&desc, &result), CLN_BUILD, "composite.cl");
    assert_nothing_written("never");
}

static void test_no_such_device(void **state)
{
    const cln_settings settings = {.config = fixture_config(), .preset = "fast"};
    cln_train_desc desc = {.scene = fixture_path("scene"),
                           .run = fixture_path("never"),
                           .settings = &settings,
                           .device = {.spec = "no such device"}};
    cln_train_result result;

    (void)state;
    assert_fails(cln_train(&desc, &result), CLN_NO_DEVICE, "");
    assert_nothing_written("never");
}

static void test_folders_of_others(void **state)
{
    const cln_config config = fixture_config();
    const cln_train_desc again = {.scene = fixture_path("scene"),
                                  .run = fixture_path("whole"),
                                  .device = fixture_device(),
                                  .restart = true};
    cln_train_result result;

    NEED_DEVICE();
    assert_fails(cln_train(&again, &result), CLN_OUTPUT, "--resume"); /* it has checkpoints */
    assert_fails(fixture_train("scene", false, &config, NULL, &result), CLN_OUTPUT, "run.json");
    assert_fails(fixture_train("whole", false, &config, NULL, &result), CLN_OUTPUT, "--resume");
    assert_int_equal(fixture_digest("whole"), fixture_whole.digest);
}

int test_group_training(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_learns),
        cmocka_unit_test(test_seed_decides),
        cmocka_unit_test(test_interrupted),
        cmocka_unit_test(test_rolling_refresh),
        cmocka_unit_test(test_interrupted_in_evaluation),
        cmocka_unit_test(test_interrupted_at_photos),
        cmocka_unit_test(test_checkpoint_on_the_way),
        cmocka_unit_test(test_resumed_with_other_settings),
        cmocka_unit_test(test_resumed_with_moments),
        cmocka_unit_test(test_split_keeps_pictures),
        cmocka_unit_test(test_growth),
        cmocka_unit_test(test_waits),
        cmocka_unit_test(test_culling),
        cmocka_unit_test(test_psnr_of_all_pixels),
        cmocka_unit_test(test_adaptive),
        cmocka_unit_test(test_adaptive_voxels),
        cmocka_unit_test(test_adaptive_extended),
        cmocka_unit_test(test_adaptive_settings),
        cmocka_unit_test(test_adaptive_waits),
        cmocka_unit_test(test_adaptive_infeasible),
        cmocka_unit_test(test_tree_from),
        cmocka_unit_test(test_memory_given_back),
        cmocka_unit_test(test_splat),
        cmocka_unit_test(test_splat_in_bands),
        cmocka_unit_test(test_too_little_memory),
        cmocka_unit_test(test_broken_kernel),
        cmocka_unit_test(test_no_such_device),
        cmocka_unit_test(test_folders_of_others),
    };

    return cmocka_run_group_tests_name("training", tests, fixture_setup, fixture_teardown);
}
