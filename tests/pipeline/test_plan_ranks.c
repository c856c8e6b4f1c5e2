/* The memory plans by ranks (pipeline/plan.h), on fake devices: links and other ranks' leaves have
 * room, however leaves are dealt, and moves keep to what fits. */
#include "unit.h"
#include <math.h>
#include "pipeline/halo.h"
#include "pipeline/plan.h"
#include "plan_fake.h"
#include "ranks/ranks.h"
#include "run_fixture.h"
#include "tests.h"

enum { GRID = 32, MOST = 8 };

/* Ranks of leaves in a grid, in Morton order; -1: none. */
static int8_t leaf_at[GRID + 2][GRID + 2][GRID + 2];

/* ground: both sides of half the height; sheet: one side; ball: around the middle; all: 8^3. */
static bool is_leaf(int shape, int x, int y, int z)
{
    const double a = x - 15.5, b = y - 15.5, c = z - 15.5, r = sqrt(a * a + b * b + c * c);

    return shape == 0   ? z == 15 || z == 16
           : shape == 1 ? z == 16
           : shape == 2 ? r > 12 && r < 13.5
                        : x < 8 && y < 8 && z < 8;
}

static void find_place(int morton, int at[3])
{
    at[0] = at[1] = at[2] = 0;
    for (int bit = 0; bit < 15; bit++)
        at[bit % 3] |= (morton >> bit & 1) << bit / 3;
}

/* Deals the leaves of a shape evenly. Returns how many there are. */
static int deal(int shape, int ranks)
{
    int leaves = 0, at[3], n = 0;

    memset(leaf_at, -1, sizeof leaf_at);
    for (int m = 0; m < GRID * GRID * GRID; m++) {
        find_place(m, at);
        leaves += is_leaf(shape, at[0], at[1], at[2]);
    }
    for (int m = 0; m < GRID * GRID * GRID; m++) {
        find_place(m, at);
        if (is_leaf(shape, at[0], at[1], at[2]))
            leaf_at[at[2] + 1][at[1] + 1][at[0] + 1] = (int8_t)((int64_t)n++ * ranks / leaves);
    }
    return leaves;
}

/* The rank that owns a leaf's vertex: of the first leaf that has it. */
static int owner(int x, int y, int z, const int vertex[3], int cells)
{
    int from[3], to[3];

    for (int a = 0; a < 3; a++) {
        from[a] = vertex[a] == 0 ? -1 : 0;
        to[a] = vertex[a] == cells;
    }
    for (int k = from[2]; k <= to[2]; k++)
        for (int j = from[1]; j <= to[1]; j++)
            for (int i = from[0]; i <= to[0]; i++)
                if (leaf_at[z + k + 1][y + j + 1][x + i + 1] >= 0)
                    return leaf_at[z + k + 1][y + j + 1][x + i + 1];
    return -1;
}

/* The most links of a rank, in one direction, and the most leaves that gave it such. */
static void count_links(int cells, int *most, int *far)
{
    int up[MOST] = {0}, down[MOST] = {0}, theirs[MOST] = {0};

    for (int leaf = 0; leaf < GRID * GRID * GRID; leaf++) {
        const int x = leaf % GRID, y = leaf / GRID % GRID, z = leaf / GRID / GRID;
        const int rank = leaf_at[z + 1][y + 1][x + 1], side = cells + 1;
        bool met[MOST] = {false};

        for (int n = 0; rank >= 0 && n < side * side * side; n++) {
            const int vertex[3] = {n % side, n / side % side, n / side / side};
            const int other = owner(x, y, z, vertex, cells);

            up[rank] += other != rank;
            down[other] += other != rank;
            met[other] |= other != rank;
        }
        for (int r = 0; r < MOST; r++)
            theirs[r] += met[r];
    }
    *most = *far = 0;
    for (int r = 0; r < MOST; r++) {
        *most = up[r] > *most ? up[r] : *most;
        *most = down[r] > *most ? down[r] : *most;
        *far = theirs[r] > *far ? theirs[r] : *far;
    }
}

/* Links, and slices of other ranks' leaves, have room, also where the cut between ranks lies along
 * a surface; one process plans none. */
static void test_links_fit(void **state)
{
    static const int ranks[] = {2, 3, 8};
    const cln_config config = preset("voxel");

    (void)state;
    for (int shape = 0; shape < 4; shape++)
        for (int k = 0; k < 3; k++) {
            const int leaves = deal(shape, ranks[k]), own = (leaves + ranks[k] - 1) / ranks[k];
            double one = 0, links = 0, slices = 0;
            int most = 0, far = 0;
            fake f;
            cln_plan plan;

            make_fake(&f, &config, 4096 * MIB, "gpu");
            f.pipeline.ranks = 1;
            f.desc.leaves = leaves;
            cln_plan_device(&f.desc, &plan);
            one = row_bytes(&plan, "tree and cameras", false);
            f.pipeline.ranks = ranks[k];
            cln_plan_device(&f.desc, &plan);
            count_links(f.pipeline.net.cells, &most, &far);
            assert_true(most > 0 && far > 0);
            /* leaf_rank, halo_far; two directions, marks, places */
            links = (row_bytes(&plan, "tree and cameras", false) - one - 8.0 * leaves) / 40;
            slices = row_bytes(&plan, "weight gradients", true) / (4.0 * f.pipeline.net.params);
            if (links < most || slices < own + far)
                fail_msg("shape %d, %d ranks: %.0f of %d links, %.0f of %d slices", shape, ranks[k],
                         links, most, slices, own + far);
            assert_true(links < 3.0 * leaves * pow(f.pipeline.net.cells + 1, 2)); /* bearable */
        }
}

/* By ranks, a plan of a known deal has its leaves, links and others' leaves: 4 ranks with 250 of
 * 1,000 leaves, where moves may bring 375. Moves are limited to what fits. */
static void test_deals(void **state)
{
    cln_config config = preset("voxel");
    const cln_deal even = {.own = 250, .far = 60, .sliced = 310, .links = 7000};
    fake f;
    cln_plan loose, plan;
    double params = 0;
    int most = 0, before = 375;

    (void)state;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    f.pipeline.ranks = 4;
    f.desc.leaves = 1000;
    params = 4.0 * f.pipeline.net.params;
    cln_plan_device(&f.desc, &loose);
    assert_true(fabs(row_bytes(&loose, "leaf weights", false) - 375 * params) < 1);
    f.desc.deal = &even;
    cln_plan_device(&f.desc, &plan);
    assert_true(fabs(row_bytes(&plan, "leaf weights", false) - 250 * params) < 1);
    assert_true(fabs(row_bytes(&plan, "changes of the tree", true) - 250 * params) < 1);
    assert_true(fabs(row_bytes(&plan, "weight gradients", true) -
                     (310 + floor((double)plan.max_samples / 480)) * params) < 1);
    /* gradients, more than weights, are free then: 8 bytes a leaf, densities of pictures */
    assert_true(fabs(row_bytes(&plan, "changes of the tree", false) - 8.0 * 1000 -
                     2000.0 * config.n1 * config.n1 * config.n1) < 1);
    /* two directions, marks, places: 40 bytes a link */
    assert_true(row_bytes(&loose, "tree and cameras", false) -
                    row_bytes(&plan, "tree and cameras", false) >
                40.0 * 7000);
    f.pipeline.config.device_mem = loose.total;
    assert_int_equal(cln_plan_most_own(&f.desc), before);
    for (double less = 0.98; less > 0.8; less -= 0.02) {
        f.pipeline.config.device_mem = less * loose.total;
        most = cln_plan_most_own(&f.desc);
        assert_true(most < before && (most == 0 || most >= 250));
        before = most > 0 ? most : 1;
    }
    f.pipeline.config.device_mem = plan.total / 2;
    assert_int_equal(cln_plan_most_own(&f.desc), 0);
    f.pipeline.config.device_mem = 0;
    f.pipeline.config.n1 = 64; /* densities of all leaves are more than a rank's weights */
    cln_plan_device(&f.desc, &plan);
    assert_true(fabs(row_bytes(&plan, "changes of the tree", true) - 1000.0 * 2 * 64 * 64 * 64) <
                1);
}

/* With few samples, a rank with fewer leaves and more of others' may have more slices than the one
 * that has most leaves, which here is the last and so has none of others'. */
static void test_uneven_deal(void **state)
{
    enum { SAMPLES = 8192, OWN = 8000, LEAVES = 32768 };
    const int first[3] = {0, OWN, LEAVES};
    cln_config config = preset("voxel");
    int64_t links[CLN_RANKS_MOST];
    int far[CLN_RANKS_MOST], starts[3];
    cln_octree tree = {0};
    cln_deal deal;
    cln_plan plan;
    fake f;

    (void)state;
    config.batch_samples = SAMPLES / CLN_TRAINING_BATCHES;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    memcpy(starts, first, sizeof starts);
    f.pipeline.ranks = 2;
    f.pipeline.rank_first = starts;
    f.desc.leaves = LEAVES;
    f.desc.deal = &deal;
    assert_ok(cln_octree_create(5, &tree));
    assert_ok(cln_halo_count(&f.pipeline, &tree, first, links, far));
    assert_ok(cln_plan_deal(&f.pipeline, &tree, &deal));
    cln_plan_device(&f.desc, &plan);
    assert_true(plan.max_samples == SAMPLES && far[1] == 0 && OWN + far[0] > SAMPLES);
    assert_true(row_bytes(&plan, "weight gradients", true) >=
                (OWN + far[0] + SAMPLES / 480) * 4.0 * f.pipeline.net.params);
    assert_int_equal(deal.own, LEAVES - OWN);
    assert_int_equal(deal.sliced, LEAVES - OWN);
    assert_int_equal(deal.far, far[0]);
    cln_octree_free(&tree);
}

/* What a plan's check refuses, moves do not bring about: also an array that would be too large in
 * all its parts, here that of gradients, of 700 rows. */
static void test_moves_into_a_buffer(void **state)
{
    cln_config config = preset("voxel");
    const cln_deal even = {.own = 250, .far = 60, .sliced = 310, .links = 7000};
    fake f;
    cln_plan plan, host;
    int most = 0;

    (void)state;
    config.batch_samples = 256;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    f.pipeline.ranks = 4;
    f.desc.leaves = 1000;
    f.desc.depth = 4;
    f.desc.deal = &even;
    assert_int_equal(cln_plan_most_own(&f.desc), 375);
    f.device.max_alloc = (size_t)(700.0 / CLN_PARTS * 4 * f.pipeline.net.params);
    cln_plan_device(&f.desc, &plan);
    cln_plan_host(&f.desc, &plan, &host);
    assert_true(cln_plan_fits(&f.device, &plan, &host));
    assert_ok(cln_plan_check(&f.device, &plan));
    most = cln_plan_most_own(&f.desc);
    assert_true(most >= 250 && most < 300);
    f.device.max_alloc /= 64;
    cln_plan_device(&f.desc, &plan);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "allows only");
    assert_false(cln_plan_fits(&f.device, &plan, &host));
    assert_int_equal(cln_plan_most_own(&f.desc), 0);
}

/* The present deal counts as it is, though an estimate of one with so many leaves is above the
 * limit: more cannot move, but as many can. */
static void test_the_deal_itself(void **state)
{
    const cln_config config = preset("voxel");
    const cln_deal now = {.own = 360, .far = 10, .sliced = 365, .links = 100};
    fake f;
    cln_plan plan;

    (void)state;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    f.pipeline.ranks = 4;
    f.desc.leaves = 1000;
    f.desc.deal = &now;
    cln_plan_device(&f.desc, &plan);
    f.pipeline.config.device_mem = plan.total + 1;
    assert_int_equal(cln_plan_most_own(&f.desc), 360);
}

/* The largest tree that there can be, of the largest leaves: more links than an int counts. */
static void test_most_links(void **state)
{
    cln_config config = preset("voxel");
    fake f;
    cln_plan plan;
    cln_deal deal;

    (void)state;
    config.grid_cells = CLN_VOXEL_CELLS;
    make_fake(&f, &config, 4096 * MIB, "gpu");
    f.pipeline.ranks = 2;
    f.desc.leaves = 1 << (3 * CLN_MAX_LEVEL);
    deal = cln_plan_any_deal(&f.desc, f.desc.leaves / 2);
    assert_true(deal.far >= f.desc.leaves / 2);
    assert_true(deal.links == (int64_t)deal.far * 17 * 17);
    assert_true(deal.links > INT32_MAX);
    f.desc.deal = &deal;
    cln_plan_device(&f.desc, &plan);
    assert_true(row_bytes(&plan, "tree and cameras", false) > 40.0 * deal.far * 17 * 17);
    assert_fails(cln_plan_check(&f.device, &plan), CLN_MEMORY, "more device memory");
}

int test_group_plan_ranks(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_links_fit),       cmocka_unit_test(test_deals),
        cmocka_unit_test(test_uneven_deal),     cmocka_unit_test(test_moves_into_a_buffer),
        cmocka_unit_test(test_the_deal_itself), cmocka_unit_test(test_most_links),
    };

    return cmocka_run_group_tests_name("plan_ranks", tests, NULL, NULL);
}
