/* Similarities of places with noise and wrong ones (scene/similarity.h), and with up by cameras
 * (api/place_turn.h), against the ones that the places were made by. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "api/place_turn.h"
#include "base/eigen.h"
#include "draws.h"
#include "near.h"
#include "scene/similarity.h"
#include "scene/vectors.h"
#include "tests.h"

enum { MOST = 36, TRIES = 200 };
static const double DEGREE = 3.14159265358979323846 / 180;

typedef struct flight {
    int count;
    double truth[MOST][3];              /* metres east, north and up */
    double at[MOST][3], place[MOST][3]; /* in the scene's frame; by GPS */
    cln_similarity to;                  /* the true one */
    uint64_t seed;
    int draw;
} flight;

/* About 0, with standard deviation 1. */
static double scatter(flight *f)
{
    double sum = 0;

    for (int k = 0; k < 12; k++)
        sum += uniform(f->seed, f->draw++, -0.5, 0.5);
    return sum;
}

static void begin(flight *f, uint64_t seed)
{
    memset(f, 0, sizeof *f);
    f->seed = seed;
    f->to = (cln_similarity){.scale = 7, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    cln_similarity_turn(&f->to, (const double[3]){0.7, -1.1, 0.4});
    memcpy(f->to.shift, (const double[3]){12, -5, 8}, sizeof f->to.shift);
}

/* A camera at this place, where GPS is off by these standard deviations. */
static void add(flight *f, double x, double y, double z, double across, double in_height)
{
    const double at[3] = {x, y, z};
    const int i = f->count++;

    memcpy(f->truth[i], at, sizeof at);
    for (int k = 0; k < 3; k++) {
        double moved[3];

        for (int j = 0; j < 3; j++)
            moved[j] = at[j] - f->to.shift[j];
        f->at[i][k] = 0;
        for (int j = 0; j < 3; j++)
            f->at[i][k] += f->to.turn[3 * j + k] * moved[j] / f->to.scale;
    }
    f->place[i][0] = x + across * scatter(f);
    f->place[i][1] = y + across * scatter(f);
    f->place[i][2] = z + in_height * scatter(f);
}

/* 80 x 80 m to and fro. */
static void fly_grid(flight *f, uint64_t seed, double across, double in_height)
{
    begin(f, seed);
    for (int i = 0; i < MOST; i++)
        add(f, -40 + 16 * (i % 6), -40 + 16 * (i / 6), 0.5 * scatter(f), across, in_height);
}

/* The turn from what it should be, as rotations about x, y and z, if small. */
static void turn_left(const flight *f, const cln_similarity *s, double out[3])
{
    double m[9];

    for (int i = 0; i < 9; i++) /* turn times the true one's transpose */
        m[i] = cln_dot(s->turn + (size_t)(i / 3) * 3, f->to.turn + (size_t)(i % 3) * 3);
    out[0] = (m[7] - m[5]) / 2 / DEGREE;
    out[1] = (m[2] - m[6]) / 2 / DEGREE;
    out[2] = (m[3] - m[1]) / 2 / DEGREE;
    if (m[0] + m[4] + m[8] < 1) /* by more than a quarter */
        out[0] = out[1] = out[2] = 180;
}

/* What the scene's cameras tell: up, or the line that is level; they lean by `by` degrees. */
static cln_up_told tell(const flight *f, cln_up_what what, const double level[3], double by)
{
    cln_up_told told = {.what = what, .sd = DEGREE};
    const double up[3] = {sin(by * DEGREE), 0, cos(by * DEGREE)};

    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++) {
            told.up[k] += f->to.turn[3 * j + k] * up[j];
            told.level[k] += f->to.turn[3 * j + k] * level[j];
        }
    memcpy(told.rough, told.up, sizeof told.rough);
    return told;
}

static const double EAST[3] = {1, 0, 0}, NORTH[3] = {0, 1, 0};

static void test_eigen(void **state)
{
    const double m[16] = {4, 1, 0, 2, 1, 3, -1, 0, 0, -1, 2, 0.5, 2, 0, 0.5, 1};
    double value[4], vector[4][4];

    (void)state;
    cln_eigen(4, m, value, vector[0]);
    for (int e = 0; e < 4; e++) {
        assert_true(e == 0 || value[e] >= value[e - 1]);
        for (int i = 0; i < 4; i++) {
            double sum = 0, length = 0;

            for (int k = 0; k < 4; k++) {
                sum += m[4 * i + k] * vector[e][k];
                length += vector[e][k] * vector[e][k];
            }
            assert_near(sum, value[e] * vector[e][i], 1e-12);
            assert_near(length, 1, 1e-12);
        }
    }
    cln_eigen(2, (const double[4]){2, 1, 1, 2}, value, vector[0]);
    assert_near(value[0], 1, 1e-12);
    assert_near(value[1], 3, 1e-12);
}

/* 14 of 36 places are 316 m off, each elsewhere, or all the same way. */
static void test_wrong_places(void **state)
{
    (void)state;
    for (int how = 0; how < 6; how++) {
        cln_similarity s, again;
        double left[3];
        flight f;

        fly_grid(&f, (uint64_t)(how / 2 + 1), how < 4 ? 1 : 0, how < 4 ? 1 : 0);
        for (int i = 0; i < 14; i++) {
            const double angle = how % 2 ? 0.7 : 2.4 * i;

            f.place[(5 * i + how) % MOST][0] += 316 * cos(angle);
            f.place[(5 * i + how) % MOST][1] += 316 * sin(angle);
        }
        assert_int_equal(cln_similarity_fit(f.count, f.at, f.place, &s), CLN_OK);
        assert_int_equal(cln_similarity_fit(f.count, f.at, f.place, &again), CLN_OK);
        assert_memory_equal(&s, &again, sizeof s);
        turn_left(&f, &s, left);
        for (int k = 0; k < 3; k++) {
            assert_near(left[k], 0, how < 4 ? 1.5 : 1e-5);
            assert_near(s.shift[k], f.to.shift[k], how < 4 ? 2 : 1e-5);
        }
        assert_near(s.scale / f.to.scale, 1, how < 4 ? 0.02 : 1e-7);
    }
}

/* What it says of turns and scale beside how they spread over many draws of the noise. */
static void test_doubt(void **state)
{
    (void)state;
    for (int how = 0; how < 3; how++) {
        double square[4] = {0}, said[4] = {0};

        for (int t = 0; t < TRIES; t++) {
            cln_similarity_doubt doubt;
            cln_similarity s;
            double left[3];
            flight f;

            if (how < 2) {
                fly_grid(&f, (uint64_t)(1000 * how + t), how ? 2 : 1, how ? 8 : 1);
            } else { /* a corridor, and one camera aside */
                begin(&f, (uint64_t)(5000 + t));
                for (int i = 0; i < 30; i++)
                    add(&f, -100 + 200.0 * i / 29, i ? 0.3 * scatter(&f) : 9, 0, 0.5, 0.5);
            }
            assert_int_equal(cln_similarity_fit(f.count, f.at, f.place, &s), CLN_OK);
            assert_int_equal(cln_similarity_judge(f.count, f.at, f.place, &s, &doubt), CLN_OK);
            turn_left(&f, &s, left);
            for (int k = 0; k < 3; k++) {
                square[k] += left[k] * left[k] / TRIES;
                said[k] += doubt.turn[4 * k] / DEGREE / DEGREE / TRIES;
            }
            square[3] += pow(s.scale / f.to.scale - 1, 2) / TRIES;
            said[3] += doubt.scale * doubt.scale / TRIES;
        }
        for (int k = 0; k < 4; k++)
            if (!(said[k] < 2.25 * square[k] && square[k] < 2.25 * said[k]))
                fail_msg("flight %d, number %d: %g, and %g is said", how, k, sqrt(square[k]),
                         sqrt(said[k]));
    }
}

/* Heights that are off from photo to photo, or drift, where cameras know up; RTK, and far heights,
 * which know it better. */
static void test_up(void **state)
{
    cln_up_told told;
    cln_place_turn turn;
    double left[3];
    flight f;

    (void)state;
    fly_grid(&f, 3, 2, 8);
    told = tell(&f, CLN_UP_TOLD, EAST, 0);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    turn_left(&f, &turn.to, left);
    assert_near(hypot(left[0], left[1]), 0, 1);
    assert_true(turn.up < 1.1 && !turn.differ && turn.by_gps > 1.5);
    fly_grid(&f, 4, 0.3, 0.3);
    for (int i = 0; i < MOST; i++)
        f.place[i][2] += 8 * i / 35.0;
    told = tell(&f, CLN_UP_TOLD, EAST, 0);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    turn_left(&f, &turn.to, left);
    assert_near(hypot(left[0], left[1]), 0, 0.5);
    assert_true(turn.differ && turn.theirs);
    assert_near(turn.apart, 5, 0.5); /* 8 m in 93, as the last row's first is 1.1 m lower */
    assert_near(turn.drift, 8, 1);
    fly_grid(&f, 5, 0.02, 0.03); /* and cameras that hang askew */
    told = tell(&f, CLN_UP_TOLD, EAST, 4);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    turn_left(&f, &turn.to, left);
    assert_near(hypot(left[0], left[1]), 0, 0.05);
    assert_true(turn.differ && !turn.theirs);
    assert_near(turn.apart, 4, 0.1);
    fly_grid(&f, 4, 1, 3); /* 9 m among heights that scatter by 3 */
    for (int i = 0; i < MOST; i++)
        f.place[i][2] += 9 * i / 35.0;
    told = tell(&f, CLN_UP_TOLD, EAST, 0);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    turn_left(&f, &turn.to, left);
    if (!(turn.differ && turn.theirs && turn.drift > 10 && hypot(left[0], left[1]) < 1.5))
        fail_msg("%g apart, %g m, by %g and %g", turn.apart, turn.drift, turn.by_gps, turn.by_them);
    fly_grid(&f, 6, 1, 1); /* 15 degrees of 80 m: no heights do that */
    told = tell(&f, CLN_UP_TOLD, EAST, 15);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    turn_left(&f, &turn.to, left);
    assert_near(hypot(left[0], left[1]), 0, 1);
    assert_true(turn.differ && !turn.theirs);
    fly_grid(&f, 7, 0, 0); /* upside down */
    told = tell(&f, CLN_UP_TOLD, EAST, 180);
    assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
    assert_near(turn.apart, 180, 1e-3);
    assert_true(turn.differ && !turn.theirs);
}

/* Without altitudes: cameras tell up, and places north, scale and where it is. */
static void test_flat(void **state)
{
    (void)state;
    for (int seed = 1; seed <= 5; seed++) {
        cln_up_told told;
        cln_place_turn turn;
        double left[3], middle = 0;
        flight f;

        begin(&f, (uint64_t)seed); /* a facade */
        for (int i = 0; i < MOST; i++) {
            add(&f, -25 + 5.0 * (i % 9), 0.3 * scatter(&f), 4 + 5.0 * (i / 9), 0.3, 0);
            middle += f.truth[i][2] / MOST;
            f.place[i][2] = 0;
        }
        f.place[7][0] += 400;
        told = tell(&f, CLN_UP_TOLD, NORTH, 0);
        assert_int_equal(cln_place_turn_flat(f.count, f.at, f.place, &told, &turn), CLN_OK);
        turn_left(&f, &turn.to, left);
        assert_near(hypot(left[0], left[1]), 0, 1e-6);
        assert_near(left[2], 0, 1);
        assert_near(turn.to.scale / f.to.scale, 1, 0.02);
        assert_true(turn.used == MOST - 1 && turn.north < 0.6 && turn.length < 0.02);
        for (int i = 0; i < MOST; i++) {
            double at[3];

            cln_similarity_apply(&turn.to, f.at[i], at);
            assert_near(at[2], f.truth[i][2] - middle, 0.2);
            assert_near(at[0], f.truth[i][0], 0.5);
        }
    }
}

/* Along a straight line noise may fit better turned over; a mirror image of a wide one fits not. */
static void test_flat_line(void **state)
{
    (void)state;
    for (int seed = 1; seed <= 20; seed++) {
        cln_up_told told;
        cln_place_turn turn;
        double left[3];
        flight f;

        begin(&f, (uint64_t)seed);
        for (int i = 0; i < MOST; i++) {
            add(&f, -150 + 300.0 * i / (MOST - 1), seed % 2 ? 0 : 0.3 * scatter(&f), 0, 3, 0);
            f.place[i][2] = 0;
        }
        told = tell(&f, CLN_UP_TOLD, EAST, 0);
        assert_int_equal(cln_place_turn_flat(f.count, f.at, f.place, &told, &turn), CLN_OK);
        turn_left(&f, &turn.to, left);
        assert_true(turn.north < 1 && turn.length < 0.02);
        assert_near(hypot(left[0], left[1]), 0, 1e-6);
        assert_near(left[2], 0, 2);
        fly_grid(&f, (uint64_t)seed, 1, 0);
        for (int i = 0; i < MOST; i++)
            f.place[i][2] = 0;
        told = tell(&f, CLN_UP_TOLD, EAST, 180);
        assert_int_equal(cln_place_turn_flat(f.count, f.at, f.place, &told, &turn), CLN_OK);
        if (turn.north <= 10 && turn.length <= 0.15)
            fail_msg("a mirror image: north to %g, length to %g", turn.north, turn.length);
    }
}

/* A straight flight leaves the roll about it open: cameras across it that are level close it, and
 * those along it do not. */
static void test_line(void **state)
{
    (void)state;
    for (int seed = 1; seed <= 20; seed++) {
        cln_up_told told;
        cln_place_turn turn;
        double left[3];
        flight f;

        begin(&f, (uint64_t)seed);
        for (int i = 0; i < 30; i++)
            add(&f, -100 + 200.0 * i / 29, seed % 2 ? 0.3 * scatter(&f) : 0, 0, 1.5, 3);
        told = tell(&f, CLN_UP_UNTOLD, NORTH, 0);
        assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
        assert_true(turn.up > 15);
        told = tell(&f, CLN_UP_LEVEL, EAST, 0);
        assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
        assert_true(turn.up > 15);
        told = tell(&f, CLN_UP_LEVEL, NORTH, 0);
        assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
        turn_left(&f, &turn.to, left);
        assert_true(turn.up < 1.2 && !turn.differ && turn.north < 1);
        assert_near(hypot(left[0], left[1]), 0, 2.5);
        assert_near(left[2], 0, 2);
        told = tell(&f, CLN_UP_TOLD, NORTH, 0);
        assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
        turn_left(&f, &turn.to, left);
        assert_near(hypot(left[0], left[1]), 0, 2);
    }
}

/* Level x axes along a line that climbs do not tell the turn about it, nor away from it: such a
 * flight is not placed, or one that is wide enough as well as is said. */
static void test_climbing_line(void **state)
{
    static const double slopes[] = {0.1, 0.3, 1, 2}, widths[] = {0.3, 3};
    int taken[2] = {0};

    (void)state;
    for (int how = 0; how < 8; how++)
        for (int seed = 1; seed <= 10; seed++) {
            const double slope = slopes[how / 2], long_one = hypot(1, slope);
            cln_up_told told;
            cln_place_turn turn;
            double left[3];
            flight f;

            begin(&f, (uint64_t)seed);
            for (int i = 0; i < 30; i++) {
                const double along = (-100 + 200.0 * i / 29) / long_one;

                add(&f, along, widths[how % 2] * scatter(&f), along * slope + 0.3 * scatter(&f),
                    1.5, 3);
            }
            told = tell(&f, CLN_UP_LEVEL, EAST, 0);
            assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
            if (!(turn.up <= 10 && turn.north <= 10))
                continue;
            taken[how % 2]++;
            turn_left(&f, &turn.to, left);
            if (!(hypot(left[0], left[1]) < 5 * turn.up && fabs(left[2]) < 5 * turn.north))
                fail_msg("slope %g, seed %d: off by %g, %g, %g, and up to %g, north to %g are said",
                         slope, seed, left[0], left[1], left[2], turn.up, turn.north);
        }
    assert_true(taken[0] == 0 && taken[1] > 0);
}

/* Steep straight flights, whose turn about them positions do not know, and cameras that tell it, or
 * that fit another turn, too: within so much as they can be off, turned by 30 degrees; half a turn
 * about; with the rough up at the horizon. */
static void test_turns_that_fit_alike(void **state)
{
    static const struct {
        cln_up_what what;
        double climb, by, sd; /* degrees */
        bool told;
    } cases[] = {
        {CLN_UP_LEVEL, 40, 0, 1, true},   {CLN_UP_LEVEL, 40, 0, 3.2, false},
        {CLN_UP_LEVEL, 50, 0, 1, false},  {CLN_UP_LEVEL, 0, 75, 1, true},
        {CLN_UP_LEVEL, 0, 85, 1, false},  {CLN_UP_TOLD, 70, 0, 1, true},
        {CLN_UP_UNTOLD, 40, 0, 1, false},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int seed = 1; seed <= 10; seed++) {
            const double climb = cases[i].climb * DEGREE;
            cln_up_told told;
            cln_place_turn turn;
            cln_similarity alone;
            double left[3];
            flight f;

            begin(&f, (uint64_t)seed);
            for (int k = 0; k < 30; k++) {
                const double along = -100 + 200.0 * k / 29;

                add(&f, along * cos(climb), 0, along * sin(climb), 1.5, 3);
            }
            told = tell(&f, cases[i].what, NORTH, cases[i].by);
            told.sd = cases[i].sd * DEGREE;
            assert_int_equal(cln_place_turn_find(f.count, f.at, f.place, &told, &turn), CLN_OK);
            if ((turn.by_them > 0) != cases[i].told)
                fail_msg("case %zu, seed %d", i, seed);
            turn_left(&f, &turn.to, left);
            if (cases[i].told && !(turn.up < 2 && hypot(left[0], left[1]) < 4))
                fail_msg("case %zu, seed %d: off by %g, %g", i, seed, left[0], left[1]);
            assert_int_equal(cln_similarity_fit(f.count, f.at, f.place, &alone), CLN_OK);
            if (cases[i].what == CLN_UP_UNTOLD) /* what they have is no reason to turn it */
                assert_memory_equal(&turn.to, &alone, sizeof alone);
        }
}

int test_group_similarity(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_eigen),
        cmocka_unit_test(test_wrong_places),
        cmocka_unit_test(test_doubt),
        cmocka_unit_test(test_up),
        cmocka_unit_test(test_line),
        cmocka_unit_test(test_flat),
        cmocka_unit_test(test_climbing_line),
        cmocka_unit_test(test_flat_line),
        cmocka_unit_test(test_turns_that_fit_alike),
    };

    return cmocka_run_group_tests_name("similarity", tests, NULL, NULL);
}
