/* The memory plans (pipeline/plan.h). Arithmetic, on fake devices: rows add up, divisible buffers
 * stay below the largest allocation, others are refused by name. Runs, on the actual device: none
 * allocates more than its plan or its limit, growth stops at the limit, and batches cut by a small
 * largest allocation train and render bit for bit like batches of that size. */
#include "unit.h"
#include <sys/resource.h>
#include <stdlib.h>
#include "pipeline/room.h"
#include "plan_fake.h"
#include "run_fixture.h"
#include "tests.h"

/* ---- arithmetic ---- */

static void test_adds_up(void **state)
{
    static const char *const presets[] = {"fast", "paper", "nerf", "kilonerf", "voxel"};
    fake f;
    cln_plan plan;

    (void)state;
    for (size_t i = 0; i < sizeof presets / sizeof presets[0]; i++) {
        const cln_config config = preset(presets[i]);
        double sum = 0;

        make_fake(&f, &config, 4096 * MIB, "gpu");
        cln_plan_device(&f.desc, &plan);
        for (int k = 0; k < plan.count; k++) {
            assert_true(plan.rows[k].largest > 0);
            assert_true(plan.rows[k].largest <= plan.rows[k].bytes ||
                        strcmp(plan.rows[k].purpose, "changes of the tree") == 0);
            sum += plan.rows[k].bytes;
        }
        assert_true(fabs(sum - plan.total) < 1);
        assert_true(plan.limit == 0.9 * 8192 * MIB);
        assert_true(plan.max_samples == 2 * (size_t)config.batch_samples);
        assert_true(plan.batch_samples == (size_t)config.batch_samples);
        assert_true(row_bytes(&plan, "leaf weights", true) == 64 * 4.0 * f.pipeline.net.params);
        assert_ok(cln_plan_check(&f.device, &plan));
    }
}

/* Lowering what is proposed has an effect. */
static void test_ways_out(void **state)
{
    cln_config fast = preset("fast"), whole = preset("voxel"), adaptive = preset("voxel");
    const cln_config *const configs[] = {&fast, &whole, &adaptive};
    fake f;
    cln_plan device, host;

    (void)state;
    whole.adaptive = false;
    adaptive.adaptive = true;
    for (int i = 0; i < 3; i++) {
        bool layers = false, budget = false;

        make_fake(&f, configs[i], 4096 * MIB, "gpu");
        cln_plan_device(&f.desc, &device);
        cln_plan_host(&f.desc, &device, &host);
        for (int k = 0; k < device.count + host.count; k++) {
            const char *way =
                k < device.count ? device.rows[k].way_out : host.rows[k - device.count].way_out;

            layers |= way && (strstr(way, "--width") || strstr(way, "--view-width"));
            budget |= way && strstr(way, "--max-leaves");
        }
        assert_true(layers == (configs[i] == &fast)); /* voxels have none */
        assert_true(budget == (configs[i] != &whole));
    }
}

/* A ray has at most 96 intervals. */
static cln_config fast_to_level_5(void)
{
    cln_config config = preset("fast");

    config.max_level = 5;
    return config;
}

/* Decreasing largest allocations: rows that grow with the batch fit down to the smallest batch;
 * then the check names the row that does not fit. */
static void test_cut_below_the_largest(void **state)
{
    const cln_config config = fast_to_level_5();
    size_t before = SIZE_MAX;
    fake f;
    cln_plan plan;

    (void)state;
    for (double most = 512 * MIB; most >= 4 * MIB; most *= 0.7) {
        make_fake(&f, &config, floor(most), "gpu");
        cln_plan_device(&f.desc, &plan);
        for (int i = 0; i < plan.count; i++)
            if (plan.rows[i].largest > most)
                fail_msg("%s: %.0f bytes, allowed are %.0f", plan.rows[i].purpose,
                         plan.rows[i].largest, most);
        assert_ok(cln_plan_check(&f.device, &plan));
        assert_true(plan.max_samples <= before);
        assert_true(plan.batch_samples < plan.max_samples);
        before = plan.max_samples;
    }
    assert_true(before < 2 * (size_t)config.batch_samples);
    make_fake(&f, &config, 1 * MIB, "gpu");
    f.desc.leaves = 1;
    cln_plan_device(&f.desc, &plan);
    assert_ok(cln_plan_check(&f.device, &plan));
    make_fake(&f, &config, 0.2 * MIB, "gpu"); /* one ray may have 768 samples */
    f.desc.leaves = 1;
    cln_plan_device(&f.desc, &plan);
    assert_int_equal(plan.max_samples, 768);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "activations");
}

static int row_parts(const cln_plan *plan, const char *purpose)
{
    for (int i = 0; i < plan->count; i++)
        if (strcmp(plan->rows[i].purpose, purpose) == 0)
            return plan->rows[i].parts;
    fail_msg("no row %s", purpose);
    return 0;
}

/* Arrays with a row per leaf are split into as few parts as possible, and never refused below four
 * full parts. */
static void test_parts(void **state)
{
    const cln_config config = fast_to_level_5();
    const double n1 = config.n1, cells = n1 * n1 * n1;
    fake f;
    cln_plan plan;
    char text[1024];

    (void)state;
    for (int leaf = 0; leaf < 2; leaf++) { /* tune.leaf */
        for (int leaves = 1; leaves <= 4 * 60 + 1; leaves++) {
            double weights = 0, row = 0;
            int parts = 0;

            make_fake(&f, &config, 0, "gpu");
            weights = 4.0 * f.pipeline.net.params;
            row = fmax(weights, 2 * cells);
            f.device.max_alloc = (size_t)(60.5 * row);
            f.pipeline.tune.leaf = leaf;
            f.desc.leaves = leaves;
            cln_plan_device(&f.desc, &plan);
            cln_plan_text(&plan, text, sizeof text);
            parts = leaves <= 60 ? 1 : leaves <= 120 ? 2 : leaves <= 180 ? 3 : 4;
            assert_int_equal(row_parts(&plan, "leaf weights"), parts);
            assert_int_equal(row_parts(&plan, "optimiser state"), parts);
            assert_int_equal(row_parts(&plan, "stage-1 densities"), parts);
            assert_int_equal(row_parts(&plan, "activations"), 1);
            assert_true(row_bytes(&plan, "leaf weights", false) == leaves * weights);
            assert_true((strncmp(strstr(text, ", optimiser") - 11, " in 3 parts", 11) == 0) ==
                        (parts == 3));
            assert_true(fabs(row_bytes(&plan, "stage-1 densities", false) - 8 * leaves -
                             3 * leaves * cells) < 1);
            if (leaves > 4 * 60 - !leaf) { /* a leaf with two slices makes 241 gradients */
                assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "in each of 4 parts");
                continue;
            }
            assert_true(row_bytes(&plan, "leaf weights", true) == fmin(leaves, 60) * weights);
            assert_ok(cln_plan_check(&f.device, &plan));
        }
    }
}

/* Weight gradients have a row per slice of up to 480 samples of a leaf, counted here leaf by
 * leaf. */
static void test_slices_fit(void **state)
{
    const cln_config config = preset("fast");
    static const int leaves[] = {1, 8, 100, 512};
    fake f;
    cln_plan plan;

    (void)state;
    for (size_t k = 0; k < sizeof leaves / sizeof leaves[0]; k++) {
        for (double most = 16 * MIB; most < 128 * MIB; most *= 2) {
            double params = 0, even = 0, spread = 0;
            size_t left = 0;

            make_fake(&f, &config, most, "gpu");
            f.desc.leaves = leaves[k];
            params = 4.0 * f.pipeline.net.params;
            cln_plan_device(&f.desc, &plan);
            left = plan.max_samples;
            for (int i = 0; i < leaves[k]; i++) { /* equal numbers */
                const size_t n = left / (size_t)(leaves[k] - i);

                even += ceil((double)n / 480);
                left -= n;
            }
            left = plan.max_samples; /* one each, the rest in the first */
            spread = fmin(leaves[k] - 1, (double)left);
            spread += ceil(((double)left - spread) / 480);
            assert_true(even * params <= row_bytes(&plan, "weight gradients", true));
            assert_true(spread * params <= row_bytes(&plan, "weight gradients", true));
            assert_true(row_bytes(&plan, "weight gradients", true) <= most);
        }
    }
}

/* Projected samples take half of what is left: of a CPU's memory, which is the host's, half of what
 * --host-mem leaves. */
static void test_entries_of_a_cpu(void **state)
{
    cln_config config = preset("fast");
    fake f;
    cln_plan cpu, gpu, host;

    (void)state;
    config.stage1 = CLN_STAGE1_SPLAT;
    config.host_mem = 2048 * MIB;
    make_fake(&f, &config, 8192 * MIB, "gpu");
    cln_plan_device(&f.desc, &gpu);
    make_fake(&f, &config, 8192 * MIB, "cpu");
    cln_plan_device(&f.desc, &cpu);
    assert_true(cpu.max_entries > 1 << 20 && gpu.max_entries > 3 * cpu.max_entries);
    assert_ok(cln_plan_check(&f.device, &cpu));
    cln_plan_host(&f.desc, &cpu, &host);
    assert_ok(cln_plan_check_host(&host));
}

/* The search for missing leaves (--regrow) counts by the rays that it looks at, however fine the
 * tree is. */
static void test_search(void **state)
{
    enum { RAY = 8 + 3 * 8 }; /* a difference, a depth, an old mark and two places in a new list */
    cln_config config = preset("voxel");
    double bytes[2][2]; /* [large photos][searched] */

    (void)state;
    for (int i = 0; i < 4; i++) {
        fake f;
        cln_plan plan, host;

        config.regrow = i % 2 ? 0.7 : 0;
        make_fake(&f, &config, 4096 * MIB, "gpu");
        f.desc.depth = i < 2 ? 3 : CLN_MAX_LEVEL;
        for (int v = 0; v < 4 && i >= 2; v++)
            f.views[v].camera.width = f.views[v].camera.height = 2000;
        cln_plan_device(&f.desc, &plan);
        cln_plan_host(&f.desc, &plan, &host);
        bytes[i / 2][i % 2] = row_bytes(&host, "changes of the tree", false);
    }
    assert_true(bytes[0][1] - bytes[0][0] == RAY * 4.0 * 100 * 50);
    assert_true(bytes[1][1] - bytes[1][0] == RAY * (double)CLN_LOOK_RAYS);
}

/* Where a smaller batch would fit, the message names one: the first that does, halved each time. */
static void test_fitting_batch(void **state)
{
    cln_config config = preset("voxel");
    fake f;
    cln_plan plan;
    const int whole = config.batch_samples;
    char words[96];

    (void)state;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    f.pipeline.config.batch_samples = whole / 4;
    cln_plan_device(&f.desc, &plan);
    f.pipeline.config.device_mem = plan.total + MIB;
    cln_plan_device(&f.desc, &plan);
    assert_ok(cln_plan_check(&f.device, &plan));
    assert_int_equal(plan.fitting_samples, 0);
    f.pipeline.config.batch_samples = whole;
    cln_plan_device(&f.desc, &plan);
    snprintf(words, sizeof words, "; give --batch-samples %d, which fits, or raise --device-mem",
             whole / 4);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, words);
    f.pipeline.config.batch_samples = 4096; /* the least alone is not enough */
    f.pipeline.config.rays = config.rays / 2;
    cln_plan_device(&f.desc, &plan);
    f.pipeline.config.device_mem = plan.total;
    f.pipeline.config.batch_samples = whole;
    f.pipeline.config.rays = config.rays;
    cln_plan_device(&f.desc, &plan);
    assert_true(plan.fitting_rays == config.rays / 2 && plan.fitting_samples >= 4096);
    snprintf(words, sizeof words, "; give --rays %d --batch-samples %d, which fit, or raise",
             plan.fitting_rays, plan.fitting_samples);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, words);
    f.pipeline.config.rays = plan.fitting_rays;
    f.pipeline.config.batch_samples = plan.fitting_samples;
    cln_plan_device(&f.desc, &plan);
    assert_ok(cln_plan_check(&f.device, &plan));
    f.desc.leaves = 65536; /* whose weights alone are more */
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "; even the smallest batch takes ");
    f.desc.training = false;
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "; raise --device-mem");
}

/* Where the device's memory is the host's, the host's plan names it. */
static void test_fitting_batch_of_host(void **state)
{
    cln_config config = preset("voxel");
    const int whole = config.batch_samples;
    fake f;
    cln_plan plan, host;
    char words[96];

    (void)state;
    make_fake(&f, &config, 4096 * MIB, "cpu");
    f.pipeline.config.batch_samples = whole / 4;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    f.pipeline.config.host_mem = host.total + MIB;
    f.pipeline.config.batch_samples = whole;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    assert_ok(cln_plan_check(&f.device, &plan));
    snprintf(words, sizeof words, "; give --batch-samples %d, which fits, or raise --host-mem",
             whole / 4);
    assert_fails(cln_plan_check_host(&host), CLN_MEMORY, words);
    f.pipeline.config.batch_samples = whole / 4;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    assert_ok(cln_plan_check_host(&host));
    f.pipeline.config.batch_samples = whole;
    f.pipeline.config.host_mem = 300 * MIB; /* not even the program */
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    assert_true(host.least > host.limit && host.least < host.total);
    assert_fails(cln_plan_check_host(&host), CLN_MEMORY, "; even the smallest batch takes ");
    f.pipeline.config.rays = 16; /* what is named is what they take */
    f.pipeline.config.batch_samples = 4096;
    cln_plan_device(&f.desc, &plan);
    f.pipeline.config.host_mem = 300 * MIB;
    const double named = host.least;
    cln_plan_host(&f.desc, &plan, &host);
    assert_true(host.total == named);
}

/* --host-mem above what the process may have is that. */
static void test_hard_limit(void **state)
{
    const cln_config config = preset("voxel");
    struct rlimit before, limit;
    fake f;
    cln_plan plan, host;

    (void)state;
    make_fake(&f, &config, 4096 * MIB, "cpu");
    f.pipeline.config.host_mem = 64.0 * 1024 * MIB;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    if (host.hard)
        skip(); /* of a control group here */
    assert_ok(cln_plan_check_host(&host));
    assert_int_equal(getrlimit(RLIMIT_DATA, &before), 0);
    limit = before;
    limit.rlim_cur = 400 * MIB;
    assert_int_equal(setrlimit(RLIMIT_DATA, &limit), 0);
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    assert_int_equal(setrlimit(RLIMIT_DATA, &before), 0);
    assert_true(host.hard && host.limit <= 400 * MIB);
    assert_fails(cln_plan_check_host(&host), CLN_MEMORY, "raise what this process may have");
}

static void test_limits_by_name(void **state)
{
    cln_config config = preset("fast");
    fake f;
    cln_plan plan, host;

    (void)state;
    config.device_mem = 20 * MIB;
    config.host_mem = 320 * MIB;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    cln_plan_device(&f.desc, &plan);
    assert_true(plan.limit == 20 * MIB);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "--device-mem");
    cln_plan_host(&f.desc, &plan, &host);
    assert_true(host.limit == 320 * MIB);
    assert_true(row_bytes(&host, "images", false) == 4 * 100 * 50 * 4);
    assert_ok(cln_plan_check_host(&host));
    f.views[2].camera.width = 300000; /* one is large: 60 MB */
    cln_plan_host(&f.desc, &plan, &host);
    assert_fails(cln_plan_check_host(&host), CLN_MEMORY, "--host-mem");
    f.views[2].camera.width = 100;
    f.device.unified = true; /* its memory is the host's */
    cln_plan_host(&f.desc, &plan, &host);
    assert_true(row_bytes(&host, "the device's, the same memory", false) == plan.total);
    assert_fails(cln_plan_check_host(&host), CLN_MEMORY, "--host-mem");
    f.desc.leaves = 512 * 1024; /* 2.2e9 cells with n1 = 16 */
    f.pipeline.config.n1 = 64;
    f.pipeline.config.device_mem = 0;
    f.device.info.global_mem = 1e15;
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "--n1");
}

/* On a device without limits, what kernels count in 32 bits stays below that, or is refused: rays'
 * intervals, samples, cells; weights and gradients may have more, as their rows have places of 64
 * bits (test_counts.c). */
static void test_counts(void **state)
{
    const double two_32 = 4294967296.0;
    cln_config config = preset("paper");
    fake f;
    cln_plan plan;
    double most = 0;

    (void)state;
    config.max_level = 8;
    config.rays = 1048576;
    config.leaf_samples = 10000;
    config.batch_samples = 16777216;
    config.stage1 = CLN_STAGE1_GATHER;
    config.n1 = 64;
    make_fake(&f, &config, 1e15, "gpu");
    f.device.info.global_mem = 1e16;
    f.pipeline.part_leaves = 1 << 20;
    f.pipeline.part_slices = 1 << 30;
    f.desc.leaves = 16383; /* 2^32 cells but for one leaf's; 1e9 weights */
    cln_plan_device(&f.desc, &plan);
    assert_ok(cln_plan_check(&f.device, &plan));
    assert_true(plan.cells == two_32 - 64 * 64 * 64);
    most = cln_pipeline_most_intervals(&f.pipeline, config.max_level);
    assert_true((double)cln_config_most_rays(&config) * most > two_32);
    assert_true(plan.max_rays * most < two_32 && (plan.max_rays + 1) * most >= two_32);
    assert_true((double)plan.max_samples < two_32 / 2);
    f.desc.leaves = 16384;
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "lower --n1");
    f.pipeline.config.n1 = 12;
    f.desc.leaves = 262144; /* 1.6e10 weights */
    cln_plan_device(&f.desc, &plan);
    assert_ok(cln_plan_check(&f.device, &plan));
    assert_true(row_bytes(&plan, "leaf weights", false) ==
                262144.0 * f.pipeline.net.params * sizeof(float));
    f.device.info.global_mem = 1e9;
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "--device-mem");
}

/* Merges have room on the host where every leaf is one of two siblings, as many on a surface are,
 * and all groups merge: a target for each point. */
static void test_merges(void **state)
{
    cln_config config = preset("fast");
    const double points = 16.0 * config.distil_samples;
    fake f;
    cln_plan plan, with, without;

    (void)state;
    make_fake(&f, &config, 1024 * MIB, "gpu");
    f.desc.leaves = 3000;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &with);
    f.pipeline.config.merge_factor = 0.5; /* groups of one leaf, too */
    cln_plan_host(&f.desc, &plan, &without);
    assert_true(without.total - with.total == 1500 * points * sizeof(float[4]));
    f.pipeline.config.adaptive = false;
    cln_plan_host(&f.desc, &plan, &without);
    assert_true(with.total - without.total >= 1500 * points * sizeof(float[4]));
}

/* Pictures take the samples of four batches, or of two or one where the device's memory, or of a
 * CPU the host's, has no room for more. Only then is there too little. */
static void test_pictures_fit(void **state)
{
    static const char *const types[] = {"gpu", "cpu"};
    cln_config config = preset("fast");

    (void)state;
    for (int cpu = 0; cpu < 2; cpu++) {
        fake f;
        cln_plan plan, host;

        config.device_mem = config.host_mem = 0;
        make_fake(&f, &config, 4096 * MIB, types[cpu]);
        f.desc.training = false;
        for (int batches = 4; batches > 0; batches /= 2) {
            cln_plan_device(&f.desc, &plan);
            cln_plan_host(&f.desc, &plan, &host);
            assert_ok(cln_plan_check(&f.device, &plan));
            assert_ok(cln_plan_check_host(&host));
            assert_true(plan.max_samples == (size_t)batches * (size_t)config.batch_samples);
            if (cpu)
                f.pipeline.config.host_mem = host.total - 1;
            else
                f.pipeline.config.device_mem = plan.total - 1;
        }
        cln_plan_device(&f.desc, &plan);
        cln_plan_host(&f.desc, &plan, &host);
        assert_true(plan.max_samples == (size_t)config.batch_samples);
        assert_fails(cpu ? cln_plan_check_host(&host) : cln_plan_check(&f.device, &plan),
                     CLN_MEMORY, cpu ? "--host-mem" : "--device-mem");
        /* two frames of floats, colour, depth, opacity and normals: one is rendered, one written
         * with its 8-bit picture, raw and packed */
        assert_true(row_bytes(&host, "batches and pictures", false) >=
                    80.0 * CLN_RENDER_RAYS + (2 * 8 * 4 + 3 + 3) * 100 * 50);
    }
}

/* Pictures of a shallow tree need less than those of the deepest that its settings allow: images
 * that fit beside them stay in memory. */
static void test_images_stay(void **state)
{
    enum { WIDE = 1024, DEPTH = 2 };
    cln_config config = preset("fast");
    fake f;
    cln_pipeline outline;
    cln_plan plan, host;
    cln_room found;
    cln_room_desc room = {.depth = DEPTH, .coverage_bytes = -1, .photos = 4.0 * WIDE * WIDE * 4};
    uint8_t *pixels = calloc((size_t)WIDE * WIDE, 4);

    (void)state;
    assert_non_null(pixels);
    make_fake(&f, &config, 4096 * MIB, "cpu");
    f.scene.space = cln_space_unit;
    for (int i = 0; i < 4; i++) {
        f.views[i].camera.width = f.views[i].camera.height = WIDE;
        f.views[i].pixels = pixels;
    }
    assert_true(DEPTH + 2 < cln_config_deepest(&config));
    config.host_mem = 1; /* the smallest plan */
    assert_ok(cln_pipeline_outline(&f.device, &config,
                                   &(cln_pipeline_facts){.depth = DEPTH, .space = &f.scene.space},
                                   &outline));
    f.desc.pipeline = &outline;
    f.desc.training = false;
    f.desc.depth = DEPTH;
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    config.host_mem = host.total;
    room.device = &f.device;
    room.config = &config;
    room.scene = &f.scene;
    room.leaves = f.desc.leaves;
    assert_ok(cln_room_place_images(&room, &f.scene, &found));
    assert_null(f.scene.store);
    config.host_mem = host.total - 1;
    assert_ok(cln_room_place_images(&room, &f.scene, &found));
    assert_non_null(f.scene.store);
    cln_store_free(f.scene.store);
    free(pixels);
}

/* ---- runs ---- */

static char warnings[4096], said[16384];

static void keep_log(cln_log_level level, const char *line, void *user)
{
    char *to = level == CLN_LOG_WARN ? warnings : said;
    const size_t size = level == CLN_LOG_WARN ? sizeof warnings : sizeof said, used = strlen(to);

    (void)user;
    snprintf(to + used, size - used, "%s\n", line);
}

/* A new run, as fixture_train, on a device with this largest allocation. */
static cln_status train_on(const char *run, const cln_config *config, const char *max_alloc,
                           cln_train_result *result)
{
    fixture_stop none = {0};
    const cln_settings settings = {.config = *config, .preset = "fast"};
    cln_train_desc desc = {.scene = fixture_path("scene"),
                           .run = fixture_path(run),
                           .skip_selftest = true,
                           .settings = &settings,
                           .device = fixture_device(),
                           .command = "test",
                           .callbacks = fixture_callbacks(&none)};

    desc.device.max_alloc = max_alloc;
    warnings[0] = said[0] = 0;
    cln_log_set_sink(keep_log, NULL);
    cln_log_set_level(CLN_LOG_DEBUG); /* plans are for -v */
    return cln_train(&desc, result);
}

static double planned(const char *run, const char *path)
{
    char name[64];
    json_t *document = NULL;
    double value = 0;

    snprintf(name, sizeof name, "%s/run.json", run);
    document = fixture_json(name);
    value = json_number_value(fixture_at(document, path));
    json_decref(document);
    return value;
}

/* Training variants that use different buffers. The tree does not shrink, so the last plan is the
 * largest; a limit of 4 MiB per buffer keeps the plan for rays close to its use. */
static void test_peak_is_planned(void **state)
{
    static const struct {
        const char *name, *options[4][2];
    } cases[] = {
        {"plain", {{NULL}}},
        {"deep", {{"level-at", "2:0.3,3:0.6"}}},
        {"deep-splat", {{"level-at", "2:0.3"}, {"stage1", "splat"}, {"device-mem", "256M"}}},
        {"regularised", {{"sparsity", "0.01"}, {"edge", "0.01"}, {"rays", "16"}}},
        {"backgrounds", {{"random-background", "yes"}, {"density-weight", "visibility"}}},
        {"splitting",
         {{"adaptive", "yes"},
          {"split-samples", "0"},
          {"structure-from", "0.3"},
          {"max-level", "3"}}},
    };
    NEED_DEVICE();
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_config config = fixture_config();
        cln_train_result result;

        config.max_leaves = 64;
        for (int k = 0; k < 4 && cases[i].options[k][0]; k++)
            assert_ok(cln_config_set(&config, cln_config_find(cases[i].options[k][0]),
                                     cases[i].options[k][1]));
        assert_ok(train_on(cases[i].name, &config, "4M", &result));
        print_message("%-12s %4d leaves, device peak %5.1f %% of the plan\n", cases[i].name,
                      result.leaves,
                      100 * result.device_peak / planned(cases[i].name, "plan.total"));
        assert_true(result.device_peak > 0);
        assert_true(result.device_peak <= planned(cases[i].name, "plan.total"));
        assert_true(result.device_peak == planned(cases[i].name, "result.device_peak"));
        assert_true(result.device_peak <= planned(cases[i].name, "plan.limit"));
        assert_true(result.host_peak >= 1 << 20);
        assert_true(planned(cases[i].name, "host_plan.total") > 0);
    }
}

/* The limit only allows level 1, level 2 exceeds it: the run warns and ends successfully. */
static void test_growth_stops_at_the_limit(void **state)
{
    cln_config config = fixture_config();
    cln_train_result result;
    double small = 0, large = 0;

    NEED_DEVICE();
    config.width = config.view_width = 32; /* larger weights */
    assert_ok(train_on("small", &config, NULL, &result));
    small = planned("small", "plan.total");
    snprintf(config.level_at, sizeof config.level_at, "2:0.5");
    assert_ok(train_on("large", &config, NULL, &result));
    assert_int_equal(result.leaves, 64);
    large = planned("large", "plan.total");
    assert_true(large > 1.02 * small);
    config.device_mem = 0.5 * (small + large);
    assert_ok(train_on("limited", &config, NULL, &result));
    assert_int_equal(result.leaves, 8);
    assert_int_equal(result.step, STEPS);
    assert_non_null(strstr(warnings, "the tree stays at level 1"));
    assert_true(result.device_peak <= config.device_mem);
    config.device_mem = 0;
    config.host_mem =
        0.5 * (planned("small", "host_plan.total") + planned("large", "host_plan.total"));
    assert_ok(train_on("host-limited", &config, NULL, &result));
    assert_int_equal(result.leaves, 8);
    assert_non_null(strstr(warnings, "--host-mem"));
}

/* No room for a level, and none for a single leaf: each is said, whichever comes first. */
static void test_both_growths_are_said(void **state)
{
    static const char *const level_at[] = {"2:0.2", "2:0.9"}; /* before the decision, after it */
    cln_config config = fixture_config();
    cln_train_result result;

    NEED_DEVICE();
    config.max_leaves = 64;
    config.adaptive = true;
    config.structure_from = config.structure_every = 0.5;
    config.steps = 1;
    assert_ok(train_on("level-1", &config, NULL, &result));
    config.device_mem = planned("level-1", "plan.total");
    config.steps = STEPS;
    for (int i = 0; i < 2; i++) {
        snprintf(config.level_at, sizeof config.level_at, "%s", level_at[i]);
        assert_ok(train_on(i ? "leaves-first" : "level-first", &config, NULL, &result));
        assert_non_null(strstr(warnings, "the tree stays at level 1"));
        assert_non_null(strstr(warnings, "no room for more than the present 8 leaves"));
    }
}

/* A largest allocation of 256 KiB cuts the batch; a run with this batch as its setting gives the
 * same bits, in training and pictures. */
static void test_cut_batches(void **state)
{
    cln_config config = fixture_config();
    cln_train_result cut, set, plain;
    unsigned long samples = 0;
    const char *at = NULL;

    NEED_DEVICE();
    config.batch_samples = 4096;
    config.rays = 128;
    assert_ok(train_on("uncut", &config, NULL, &plain));
    assert_null(strstr(said, "batches are cut"));
    assert_ok(train_on("cut", &config, "256K", &cut));
    at = strstr(said, "batches are cut to ");
    assert_non_null(at);
    samples = strtoul(at + strlen("batches are cut to "), NULL, 10);
    assert_true(samples > 500 && samples < 4096);
    assert_int_not_equal(cut.digest, plain.digest);
    print_message("PSNR %.2f dB, cut to %lu samples %.2f dB\n", plain.psnr_test, samples,
                  cut.psnr_test);
    config.batch_samples = (int)samples;
    assert_ok(train_on("set", &config, NULL, &set));
    assert_int_equal(set.digest, cut.digest);
    assert_true(set.psnr_test == cut.psnr_test);
    assert_true(cut.device_peak < plain.device_peak);
    /* one leaf's weights fit; two leaves' in each of four parts do not */
    config.width = config.view_width = 64;
    assert_fails(train_on("never", &config, "64K", &cut), CLN_MEMORY,
                 "leaf weights: 81.8 KiB in each of 4 parts");
    assert_false(cln_is_dir(fixture_path("never")));
    assert_fails(train_on("never", &config, "64X", &cut), CLN_USAGE, "--max-alloc");
}

/* A largest allocation that fits the batch but not the arrays of 512 leaves: these are split, at
 * the start or when the tree grows, and training gives the same bits. */
static void test_split_arrays(void **state)
{
    static const char *const stage1[] = {"gather", "splat"};

    NEED_DEVICE();
    for (int i = 0; i < 2; i++) {
        cln_config config = fixture_config();
        cln_train_result whole, parts;
        char run[32];

        assert_ok(cln_config_set(&config, cln_config_find("stage1"), stage1[i]));
        config.batch_samples = 1024;
        config.rays = 128;
        config.n1 = 4;
        config.steps = 16;
        config.start_level = i == 0 ? 2 : 3;
        snprintf(config.level_at, sizeof config.level_at, "%s", i == 0 ? "3:0.5" : "");
        snprintf(run, sizeof run, "whole-%s", stage1[i]);
        assert_ok(train_on(run, &config, NULL, &whole));
        assert_null(strstr(said, "in 4 parts"));
        snprintf(run, sizeof run, "parts-%s", stage1[i]);
        assert_ok(train_on(run, &config, "640K", &parts));
        assert_true((strstr(said, "in 4 parts") != NULL) == (i == 1)); /* level 2 needs none */
        assert_true(parts.leaves > 64);
        assert_int_equal(parts.leaves, whole.leaves);
        assert_int_equal(parts.digest, whole.digest);
        assert_true(parts.psnr_test == whole.psnr_test);
        assert_true(parts.device_peak <= planned(run, "plan.total"));
    }
}

/* Without room for the images, they are in a file, and not in the host's plan; without room to read
 * them they are refused before any is read. */
static void test_images_that_do_not_fit(void **state)
{
    cln_config config = fixture_config();
    cln_scene *scene = NULL;
    char path[PATH_MAX + 64];
    cln_scene_desc desc = {.config = &config, .pixels = {true, true, true}};
    uint64_t digests[8];

    (void)state;
    snprintf(path, sizeof path, "%s/scene", fixture_folder);
    desc.path = path;
    config.host_mem = 80000; /* 8 images of 2,304 bytes, plus two being read */
    assert_ok(cln_scene_load(&desc, &scene));
    assert_null(scene->store);
    assert_true(cln_scene_pixel_bytes(scene) == 8 * 2304);
    for (int i = 0; i < scene->view_count; i++)
        digests[i] = cln_view_digest(&scene->views[i], CLN_DIGEST_START);
    assert_ok(cln_scene_shrink(scene, 8 * 2304, "", "")); /* they need no more than that */
    assert_null(scene->store);
    for (int k = 0; k < 2; k++) { /* into a file; then less of it in memory */
        assert_ok(cln_scene_shrink(scene, k ? 1 : 8 * 2304 - 1, "", ""));
        assert_non_null(scene->store);
        assert_null(scene->pixels);
        for (int i = 0; i < scene->view_count; i++)
            assert_true(cln_view_digest(&scene->views[i], CLN_DIGEST_START) == digests[i]);
    }
    assert_ok(cln_scene_check_pixels(scene));
    cln_scene_free(scene);
    assert_ok(cln_scene_load(&desc, &scene));
    scene->view_count--; /* as of an image that is left out: its view stays behind the others */
    scene->missing++;
    said[0] = 0;
    cln_log_set_sink(keep_log, NULL);
    assert_ok(cln_scene_shrink(scene, 0, "because", "do so"));
    assert_non_null(strstr(said, "7 images take 15.8 KiB, because: their pixels go to a file in "));
    assert_non_null(strstr(said, "; do so\n"));
    cln_scene_free(scene);
    config.host_mem = 12000;
    assert_ok(cln_scene_load(&desc, &scene));
    assert_non_null(scene->store);
    assert_true(cln_scene_pixel_bytes(scene) == cln_store_cached(scene->store));
    cln_scene_free(scene);
    config.host_mem = 9000;
    assert_fails(cln_scene_load(&desc, &scene), CLN_MEMORY, "--host-mem");
    assert_null(scene);
    memset(desc.pixels, 0, sizeof desc.pixels); /* cameras only */
    config.host_mem = 1;
    assert_ok(cln_scene_load(&desc, &scene));
    assert_true(cln_scene_pixel_bytes(scene) == 0);
    cln_scene_free(scene);
}

/* Layers of 48 and 32, worked out by hand: vectors and work-items divide both, blocks are whole
 * tiles and vectors, slices an even number of blocks, and groups no larger than the device's. */
static void test_fit(void **state)
{
    static const struct {
        size_t group;
        cln_tune wanted, fits;
    } rows[] = {
        {64,
         {.vw = 8, .nv = 2, .ls = 1, .ts = 6, .nb = 50, .sl = 480, .wg = 16},
         {.vw = 8, .nv = 2, .ls = 1, .ts = 6, .nb = 48, .sl = 480, .wg = 16}},
        {64,
         {.vw = 16, .nv = 3, .ls = 16, .ts = 6, .nb = 5, .sl = 500, .wg = 256},
         {.vw = 16, .nv = 1, .ls = 1, .ts = 6, .nb = 48, .sl = 480, .wg = 64}},
        {2,
         {.vw = 1, .nv = 3, .ls = 8, .ts = 4, .nb = 8, .sl = 9, .wg = 3},
         {.vw = 1, .nv = 2, .ls = 2, .ts = 4, .nb = 8, .sl = 16, .wg = 1}},
    };
    const cln_network net = {.width = 48, .view_width = 32, .view_dependence = true, .depth = 2};

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const cln_device device = {.max_group = rows[i].group, .local_mem = 1 << 20};
        const cln_tune *want = &rows[i].fits;
        cln_tune got = rows[i].wanted;

        cln_pipeline_fit(&device, &net, &got);
        assert_int_equal(got.vw, want->vw);
        assert_int_equal(got.nv, want->nv);
        assert_int_equal(got.ls, want->ls);
        assert_int_equal(got.ts, want->ts);
        assert_int_equal(got.nb, want->nb);
        assert_int_equal(got.sl, want->sl);
        assert_int_equal(got.wg, want->wg);
    }
}

/* Pictures of poses that are not a scene's take as much as a scene's of that size. */
static void test_pictures_without_a_scene(void **state)
{
    cln_config config = preset("fast");
    fake f;
    cln_plan plan[3], host[3];

    (void)state;
    config.stage1 = CLN_STAGE1_SPLAT;
    for (int i = 0; i < 3; i++) {
        make_fake(&f, &config, 4096 * MIB, "gpu");
        f.desc.training = false;
        if (i > 0)
            f.scene.view_count = 0;
        if (i == 2)
            f.desc.view_pixels = f.desc.picture_pixels = 100 * 50;
        cln_plan_device(&f.desc, &plan[i]);
        cln_plan_host(&f.desc, &plan[i], &host[i]);
    }
    assert_true(plan[1].total < plan[2].total && host[1].total < host[2].total);
    assert_true(row_bytes(&host[2], "batches and pictures", false) ==
                row_bytes(&host[0], "batches and pictures", false));
    assert_true(row_bytes(&plan[2], "lists of views", false) ==
                row_bytes(&plan[0], "lists of views", false));
}

int test_group_plan(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fit),
        cmocka_unit_test(test_adds_up),
        cmocka_unit_test(test_ways_out),
        cmocka_unit_test(test_cut_below_the_largest),
        cmocka_unit_test(test_slices_fit),
        cmocka_unit_test(test_entries_of_a_cpu),
        cmocka_unit_test(test_search),
        cmocka_unit_test(test_fitting_batch),
        cmocka_unit_test(test_fitting_batch_of_host),
        cmocka_unit_test(test_hard_limit),
        cmocka_unit_test(test_limits_by_name),
        cmocka_unit_test(test_pictures_fit),
        cmocka_unit_test(test_pictures_without_a_scene),
        cmocka_unit_test(test_images_stay),
        cmocka_unit_test(test_peak_is_planned),
        cmocka_unit_test(test_growth_stops_at_the_limit),
        cmocka_unit_test(test_both_growths_are_said),
        cmocka_unit_test(test_cut_batches),
        cmocka_unit_test(test_images_that_do_not_fit),
        cmocka_unit_test(test_parts),
        cmocka_unit_test(test_split_arrays),
        cmocka_unit_test(test_counts),
        cmocka_unit_test(test_merges),
    };

    return cmocka_run_group_tests_name("plan", tests, fixture_setup, fixture_teardown);
}
