/* The model of bench/scale: its arithmetic against speed-ups and bytes worked out by hand, and the
 * fit of costs against costs that made the data. No time is measured; tests/cli/ranks.sh compares
 * its bytes with those of a real training. */
#include "unit.h"
#include <math.h>
#include "scale/model.h"
#include "tests.h"

static const scale_network nothing = {0, INFINITY};

static double speed_up(const scale_machine *m, const scale_network *net, double ranks)
{
    scale_work w = {.samples = 1000,
                    .leaves = 50,
                    .rays = 500,
                    .density_bytes = 128,
                    .refresh_every = 10,
                    .ranks = 1,
                    .balance = 1};
    const double alone = scale_predict(m, net, &w).total;

    w.ranks = ranks;
    return alone / scale_predict(m, net, &w).total;
}

/* All work is shared and messages cost nothing: the speed-up is the number of ranks. */
static void test_all_shared(void **state)
{
    const scale_machine m = {.shared = {0, 2e-6, 3e-6}, .refresh = 1e-4};

    (void)state;
    for (double n = 1; n <= 1024; n *= 2)
        assert_true(fabs(speed_up(&m, &nothing, n) / n - 1) < 1e-12);
}

/* A fifth of the work is repeated, by 500 rays: Amdahl's law, at most five times as fast. */
static void test_amdahl(void **state)
{
    const scale_machine m = {.shared = {0, 4e-6, 0}, .repeated = {0, 2e-6, 0}};

    (void)state;
    for (double n = 1; n <= 1024; n *= 2)
        assert_true(fabs(speed_up(&m, &nothing, n) * (0.2 + 0.8 / n) - 1) < 1e-12);
    assert_true(speed_up(&m, &nothing, 1024) < 5);
}

/* 4 ranks: 16 x 1000 / 4 bytes to each of 3, 4 x 100 / 4 of pixels, and 128 x 50 / 4 of densities
 * every tenth step. At 1e6 bytes a second and 1 ms, one message a step, one a refresh, in
 * log2(4) = 2 turns. */
static void test_messages(void **state)
{
    const scale_machine m = {.shared = {0, 1e-6, 0}};
    const scale_network slow = {1e-3, 1e6};
    const scale_work w = {.samples = 1000,
                          .leaves = 50,
                          .rays = 100,
                          .density_bytes = 128,
                          .refresh_every = 10,
                          .ranks = 4,
                          .balance = 1,
                          .walk = SCALE_REPEATED};
    const scale_work alone = {.samples = 1000,
                              .leaves = 50,
                              .rays = 100,
                              .density_bytes = 128,
                              .refresh_every = 10,
                              .ranks = 1,
                              .balance = 1};
    const scale_step s = scale_predict(&m, &slow, &w);

    (void)state;
    assert_true(fabs(s.sent - (3 * 4000 + 3 * 100 + 3 * 160)) < 1e-9);
    assert_true(fabs(s.messages - (1e-3 * 2 * 1.1 + 12780e-6)) < 1e-12);
    assert_true(fabs(s.total - s.messages - 1000e-6 / 4) < 1e-12);
    assert_true(scale_predict(&m, &slow, &alone).messages == 0);
    assert_true(fabs(scale_sent(&w, 0.5, 0.25) - (3 * 8000 + 3 * 100 + 3 * 160)) < 1e-9);
}

/* 300 stretches of 32 bytes instead of samples. A ray through 9 leaves of 512: with 8 ranks every
 * fourth face is a border of regions, with 4,096 each. */
static void test_stretches(void **state)
{
    const scale_work w = {.samples = 1000,
                          .leaves = 50,
                          .stretches = 300,
                          .density_bytes = 128,
                          .refresh_every = 10,
                          .ranks = 4,
                          .balance = 1};

    (void)state;
    assert_true(fabs(scale_sent(&w, 0.25, 0.25) - (3 * 2400 + 3 * 160)) < 1e-9);
    assert_true(fabs(scale_stretches(9, 512, 8) - 3) < 1e-12);
    assert_true(fabs(scale_stretches(9, 512, 4096) - 9) < 1e-12);
    assert_true(fabs(scale_passed(3, 512, 8) - 9) < 1e-12);
}

/* The busiest rank's part determines the step; leaves without samples cost the networks nothing. */
static void test_balance_and_leaves(void **state)
{
    const scale_machine m = {.shared = {0, 1e-6, 0}}, leaves = {.shared = {0, 0, 1}};
    const scale_work
        w = {.samples = 1000, .leaves = 50, .refresh_every = 10, .ranks = 4, .balance = 1.2},
        many = {.samples = 1000, .leaves = 1e9, .refresh_every = 10, .ranks = 1, .balance = 1};

    (void)state;
    assert_true(fabs(scale_predict(&m, &nothing, &w).shared - 1.2 * 1000e-6 / 4) < 1e-12);
    assert_true(fabs(scale_predict(&leaves, &nothing, &many).shared / 1000 - 1) < 1e-5);
}

/* 100 rays through 8 x 8 x 8 leaves pass 8 each, on both of two ranks. */
static void test_passes(void **state)
{
    const scale_machine m = {.repeated = {1e-3, 1e-6, 2e-6}};
    const scale_work w = {
        .samples = 1000, .leaves = 512, .rays = 100, .refresh_every = 10, .ranks = 2, .balance = 1};

    (void)state;
    assert_true(fabs(scale_predict(&m, &nothing, &w).repeated - (1e-3 + 100 * 17e-6)) < 1e-12);
}

/* Of the 16 us that a ray takes for its 8 leaves, three quarters are shared by 4 ranks; each
 * stretch costs 36 bytes then, and densities stay where they are. Two messages wait. */
static void test_own_cells(void **state)
{
    const scale_machine m = {.repeated = {0, 0, 2e-6}, .cells = 0.75};
    const scale_network slow = {1e-3, 1e6};
    const scale_work w = {.samples = 1000,
                          .leaves = 512,
                          .rays = 100,
                          .stretches = 300,
                          .density_bytes = 128,
                          .refresh_every = 10,
                          .ranks = 4,
                          .balance = 1,
                          .walk = SCALE_OWN_CELLS};
    const scale_step s = scale_predict(&m, &slow, &w);

    (void)state;
    assert_true(fabs(s.repeated - 100 * 4e-6) < 1e-12);
    assert_true(fabs(s.shared - 100 * 12e-6 / 4) < 1e-12);
    assert_true(fabs(s.sent - (3 * 36 * 300 / 4 + 3 * 100)) < 1e-9);
    assert_true(fabs(s.messages - (1e-3 * 2 * 2 + s.sent * 1e-6)) < 1e-12);
}

/* The same 16 us, all shared; 8 bytes for each ray and 20 for each of 650 leaves with samples;
 * densities travel. Three messages wait, and after a refresh a fourth. */
static void test_own_rays(void **state)
{
    const scale_machine m = {.repeated = {0, 0, 2e-6}, .cells = 0.75};
    const scale_network slow = {1e-3, 1e6};
    const scale_work w = {.samples = 1000,
                          .leaves = 512,
                          .rays = 100,
                          .stretches = 300,
                          .density_bytes = 125,
                          .refresh_every = 10,
                          .ranks = 4,
                          .balance = 1,
                          .walk = SCALE_OWN_RAYS,
                          .intervals = 650};
    const scale_step s = scale_predict(&m, &slow, &w);

    (void)state;
    assert_true(fabs(s.repeated) < 1e-12);
    assert_true(fabs(s.shared - 100 * 16e-6 / 4) < 1e-12);
    assert_true(fabs(s.sent - (3 * 32 * 300 / 4 + 3 * 100 + 3 * 200 + 3 * 3250 + 3 * 1600)) < 1e-9);
    assert_true(fabs(s.messages - (1e-3 * 2 * 3.1 + s.sent * 1e-6)) < 1e-12);
}

/* Voxels of 4 cells on 4,096 leaves, 16 along an axis: two ranks have a face of 16 x 16 leaves
 * between them, all copies of rank 1's; four have two, of which a half is rank 0's; eight three, of
 * which it has a quarter. A face has 5 x 5 vertices of 20 bytes. With as many samples as leaves, a
 * part of 64 cells, met with 1 - exp(-c / 64) where c cells are around a vertex. */
static void test_vertices(void **state)
{
    const scale_machine m = {.shared = {0, 1e-6, 0}};
    const scale_network slow = {1e-3, 1e6};
    scale_work w = {.samples = 4096,
                    .leaves = 4096,
                    .stretches = 1,
                    .refresh_every = 1e9,
                    .ranks = 2,
                    .balance = 1,
                    .cells = 4,
                    .row_bytes = 20,
                    .places = 1};
    const double own = 1 - exp(-4.0 / 64), any = 1 - exp(-8.0 / 64);
    scale_step s;

    (void)state;
    assert_true(fabs(scale_faces(4096, 2) - 256) < 1e-9);
    assert_true(fabs(scale_faces(4096, 4) - 512) < 1e-9);
    assert_true(fabs(scale_faces(4096, 8) - 768) < 1e-9);
    assert_true(fabs(scale_faces(4096, 16) - 5 * 256) < 1e-9);
    assert_true(fabs(scale_faces(4096, 4096) - 3 * 15 * 256) < 1e-6); /* every face */
    assert_true(fabs(scale_first_faces(4096, 2) - 256) < 1e-9);
    assert_true(fabs(scale_first_faces(4096, 4) - 256) < 1e-9);
    assert_true(fabs(scale_first_faces(4096, 8) - 192) < 1e-9);
    assert_true(scale_faces(4096, 1) == 0 && scale_first_faces(4096, 1) == 0);
    assert_true(fabs(scale_first_vertices(&w) - 256 * 500 * any) < 1e-6);
    assert_true(fabs(scale_vertices(&w) - 128 * 500 * (own + any)) < 1e-6);
    s = scale_predict(&m, &slow, &w); /* 16 bytes of a stretch */
    assert_true(fabs(s.sent - 16 - scale_vertices(&w)) < 1e-3);
    assert_true(fabs(s.messages - 3e-3 - s.sent * 1e-6) < 1e-9); /* two messages more */
    w.places = 0.5;
    assert_true(fabs(scale_first_vertices(&w) - 256 * 500 * own) < 1e-6);
    w.cells = 0;
    assert_true(scale_vertices(&w) == 0 && scale_first_vertices(&w) == 0);
}

/* The largest of two normal numbers is 1 / sqrt(pi) on average, of three 1.5 / sqrt(pi), of ten
 * 1.53875 by tables. A step of 2 ms that spreads by a tenth ends so much later. */
static void test_waiting(void **state)
{
    const scale_machine m = {.shared = {0, 2e-6, 0}, .repeated = {1e-3, 0, 0}, .spread = 0.1};
    const scale_work w = {.samples = 1000,
                          .leaves = 50,
                          .stretches = 300,
                          .refresh_every = 10,
                          .ranks = 2,
                          .balance = 1};
    const scale_step s = scale_predict(&m, &nothing, &w);

    (void)state;
    assert_true(fabs(scale_slowest(1)) < 1e-9);
    assert_true(fabs(scale_slowest(2) - 1 / sqrt(M_PI)) < 1e-6);
    assert_true(fabs(scale_slowest(3) - 1.5 / sqrt(M_PI)) < 1e-6);
    assert_true(fabs(scale_slowest(10) - 1.53875) < 1e-5);
    assert_true(fabs(s.waiting - 2e-4 / sqrt(M_PI)) < 1e-9);
    assert_true(fabs(s.total - 2e-3 - s.waiting) < 1e-12);
}

static void test_fit(void **state)
{
    static const double x[4][3] = {{1, 4096, 64}, {1, 16384, 64}, {1, 4096, 512}, {1, 16384, 512}};
    double exact[4], negative[4];
    scale_cost c;

    (void)state;
    for (int i = 0; i < 4; i++) {
        exact[i] = 2e-3 + 1e-6 * x[i][1] + 5e-6 * x[i][2];
        negative[i] = 2e-2 + 1e-6 * x[i][1] - 5e-6 * x[i][2];
    }
    c = scale_fit(4, x, exact);
    assert_true(fabs(c.step / 2e-3 - 1) < 1e-6);
    assert_true(fabs(c.each / 1e-6 - 1) < 1e-6);
    assert_true(fabs(c.leaf / 5e-6 - 1) < 1e-6);
    c = scale_fit(4, x, negative); /* a leaf that saves time is noise */
    assert_true(c.leaf == 0 && c.step > 0 && c.each > 0);
}

int test_group_scale(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_shared), cmocka_unit_test(test_amdahl),
        cmocka_unit_test(test_messages),   cmocka_unit_test(test_stretches),
        cmocka_unit_test(test_passes),     cmocka_unit_test(test_balance_and_leaves),
        cmocka_unit_test(test_own_cells),  cmocka_unit_test(test_own_rays),
        cmocka_unit_test(test_vertices),   cmocka_unit_test(test_waiting),
        cmocka_unit_test(test_fit),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
