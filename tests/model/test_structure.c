/* Decisions about the tree (method.md 12.3). Tested: the guard on the peak keeps a thin rod,
 * culling needs two strikes in a row, never culls every leaf, ignores densities that are NaN, and
 * levels grow according to plan. Oracle: hand-made cases, thresholds calculated in comments. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/config.h"
#include "base/log.h"
#include "model/structure.h"
#include "tests.h"

typedef struct culling {
    cln_octree tree;
    cln_config config;
    float mean[8], peak[8];
    uint8_t cull[8];
} culling;

/* Eight leaves of side 1, n1 = 64; empty: mean 0.001, peak 0.5 (x 1/64 = 0.008 < 0.05). */
static void start_culling(culling *c, int rule)
{
    assert_int_equal(cln_config_preset("paper", &c->config), CLN_OK);
    c->config.cull = rule;
    assert_int_equal(cln_octree_create(1, &c->tree), CLN_OK);
    for (int s = 0; s < 8; s++) {
        c->mean[s] = s < 4 ? 0.001f : 2.0f;
        c->peak[s] = s < 4 ? 0.5f : 90.0f;
    }
}

static int check_once(culling *c)
{
    cln_leaf_stats stats = {c->mean, c->peak};

    memset(c->cull, 9, sizeof c->cull);
    return cln_structure_cull(&c->tree, &stats, &c->config, c->cull);
}

static void test_cull_two_strikes(void **state)
{
    culling c;

    (void)state;
    start_culling(&c, CLN_CULL_GUARDED);
    assert_int_equal(check_once(&c), 0);
    for (int s = 0; s < 8; s++)
        assert_int_equal(c.cull[s], 0);
    c.mean[1] = 0.02f; /* one check with substance resets the count */
    assert_int_equal(check_once(&c), 3);
    c.mean[1] = 0.001f;
    assert_int_equal(c.cull[1], 0);
    check_once(&c);
    assert_int_equal(c.cull[1], 0);
    assert_int_equal(check_once(&c), 4);
    assert_int_equal(c.cull[1], 1);
    assert_int_equal(c.cull[4], 0);
    for (int i = 0; i < 300; i++) /* however often, where they are not taken at once */
        assert_int_equal(check_once(&c), 4);
    cln_octree_free(&c.tree);
}

/* Children of a leaf of level 1 with 8 cells an axis, theirs being a sixteenth wide: a peak of 0.2
 * and more is kept by the guard, which is four times as strict as that of leaves. By octants:
 * nothing; three layers of 2; one cell of 0.5; one of 0.16; one of 0.5 that no view sees; nothing
 * but a cell of 0.5 next to it; one of 0.625, the only one seen; that cell of 0.5. */
static void test_children(void **state)
{
    enum { N = 8, HALF = 0x3f00, TWO = 0x4000, BELOW = 0x3e20, ABOVE = 0x3f20 }; /* bfloat16 */
    uint16_t density[N * N * N] = {0};
    uint8_t seen[N * N * N];
    cln_config config;

    (void)state;
    assert_int_equal(cln_config_preset("paper", &config), CLN_OK);
    config.n1 = N;
    config.cull_mean = 0.5;
    memset(seen, 1, sizeof seen);
    for (int i = 0; i < 27; i++)
        density[cln_cell_at(5 + i % 3, i / 3 % 3, i / 9, N)] = TWO;
    density[cln_cell_at(0, 7, 0, N)] = HALF;
    density[cln_cell_at(7, 7, 0, N)] = BELOW;
    density[cln_cell_at(0, 0, 7, N)] = HALF;
    seen[cln_cell_at(0, 0, 7, N)] = 0;
    density[cln_cell_at(7, 4, 7, N)] = HALF;
    for (int i = 0; i < 64; i++)
        seen[cln_cell_at(i % 4, 4 + i / 4 % 4, 4 + i / 16, N)] = i == 41;
    density[cln_cell_at(1, 6, 6, N)] = ABOVE;
    config.cull = CLN_CULL_GUARDED;
    assert_int_equal(cln_structure_children(&config, 1, density, seen),
                     1 << 1 | 1 << 2 | 1 << 5 | 1 << 6 | 1 << 7);
    config.cull = CLN_CULL_MEAN;
    assert_int_equal(cln_structure_children(&config, 1, density, seen), 1 << 1 | 1 << 6);
    config.cull = CLN_CULL_GUARDED; /* cells twice as wide */
    assert_int_equal(cln_structure_children(&config, 0, density, seen),
                     1 << 1 | 1 << 2 | 1 << 3 | 1 << 5 | 1 << 6 | 1 << 7);
}

/* An odd number of cells: those in the middle are of both sides. */
static void test_children_of_odd_cells(void **state)
{
    uint16_t density[27] = {0};
    uint8_t seen[27];
    cln_config config;

    (void)state;
    assert_int_equal(cln_config_preset("paper", &config), CLN_OK);
    config.n1 = 3;
    config.cull = CLN_CULL_MEAN;
    memset(seen, 1, sizeof seen);
    density[cln_cell_at(1, 2, 0, 3)] = 0x4000;
    assert_int_equal(cln_structure_children(&config, 1, density, seen), 1 << 2 | 1 << 3);
    density[cln_cell_at(1, 1, 1, 3)] = 0x4000;
    assert_int_equal(cln_structure_children(&config, 1, density, seen), 0xff);
}

/* Marks without a new check: the same, and never all. */
static void test_marked(void **state)
{
    uint8_t marks[8];
    culling c;

    (void)state;
    start_culling(&c, CLN_CULL_GUARDED);
    check_once(&c);
    memset(marks, 9, sizeof marks);
    assert_int_equal(cln_structure_marked(&c.tree, &c.config, marks), 0);
    assert_int_equal(marks[0], 0);
    assert_int_equal(check_once(&c), 4);
    assert_int_equal(cln_structure_marked(&c.tree, &c.config, marks), 4);
    assert_memory_equal(marks, c.cull, sizeof marks);
    for (int s = 4; s < 8; s++)
        c.mean[s] = c.peak[s] = 0;
    check_once(&c);
    check_once(&c);
    assert_int_equal(cln_structure_marked(&c.tree, &c.config, marks), 0);
    assert_int_equal(marks[0], 0);
    cln_octree_free(&c.tree);
}

/* A rod that fills 1e-5 of the leaf at sigma 500: mean 0.005 is below the threshold of 0.01. */
static void test_cull_keeps_thin_rod(void **state)
{
    culling c;

    (void)state;
    start_culling(&c, CLN_CULL_GUARDED);
    c.mean[0] = 500 * 1e-5f;
    c.peak[0] = 500;
    for (int i = 0; i < 10; i++)
        check_once(&c);
    assert_int_equal(c.cull[0], 0);
    assert_int_equal(c.cull[1], 1);
    c.peak[0] = 0.05f * 64 * 0.99f; /* the guard's edge: side / n1 = 1/64 */
    check_once(&c);
    assert_int_equal(check_once(&c), 4);
    c.peak[0] = 0.05f * 64 * 1.01f;
    assert_int_equal(check_once(&c), 3);
    cln_octree_free(&c.tree);

    start_culling(&c, CLN_CULL_MEAN); /* the paper's rule: the mean alone, at once */
    c.mean[0] = 500 * 1e-5f;
    c.peak[0] = 500;
    assert_int_equal(check_once(&c), 4);
    assert_int_equal(c.cull[0], 1);
    cln_octree_free(&c.tree);
}

static void count_lines(cln_log_level level, const char *line, void *user)
{
    assert_int_equal(level, CLN_LOG_WARN);
    assert_non_null(strstr(line, "all 8 leaves look empty"));
    ++*(int *)user;
}

static void test_cull_never_all(void **state)
{
    culling c;
    int lines = 0;

    (void)state;
    start_culling(&c, CLN_CULL_MEAN);
    for (int s = 0; s < 8; s++)
        c.mean[s] = s == 5 ? 0.002f : 0.001f;
    cln_log_set_sink(count_lines, &lines);
    assert_int_equal(check_once(&c), 7);
    cln_log_set_sink(NULL, NULL);
    assert_int_equal(lines, 1);
    for (int s = 0; s < 8; s++)
        assert_int_equal(c.cull[s], s != 5);
    cln_octree_free(&c.tree);
}

/* A NaN density does not mean empty. */
static void test_cull_keeps_nan(void **state)
{
    culling c;

    (void)state;
    start_culling(&c, CLN_CULL_GUARDED);
    c.mean[0] = NAN;
    c.peak[1] = NAN;
    check_once(&c);
    assert_int_equal(check_once(&c), 2);
    assert_int_equal(c.cull[0] + c.cull[1], 0);
    cln_octree_free(&c.tree);
}

static void test_growth(void **state)
{
    cln_config config;

    (void)state;
    assert_int_equal(cln_config_preset("paper", &config), CLN_OK); /* 1, 2:0.067, 3:0.133 */
    assert_int_equal(cln_structure_level(&config, 0), 1);
    assert_int_equal(cln_structure_level(&config, 0.0669), 1);
    assert_int_equal(cln_structure_level(&config, 0.067), 2);
    assert_int_equal(cln_structure_level(&config, 0.133), 3);
    assert_int_equal(cln_structure_level(&config, 1), 3);
    strcpy(config.level_at, "");
    assert_int_equal(cln_structure_level(&config, 1), 1);
}

int test_group_structure(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cull_two_strikes),      cmocka_unit_test(test_children),
        cmocka_unit_test(test_children_of_odd_cells), cmocka_unit_test(test_marked),
        cmocka_unit_test(test_cull_keeps_thin_rod),   cmocka_unit_test(test_cull_never_all),
        cmocka_unit_test(test_cull_keeps_nan),        cmocka_unit_test(test_growth),
    };

    return cmocka_run_group_tests_name("structure", tests, NULL, NULL);
}
