/* Steps one at a time: what is told of a step's loss, worked out by hand, and how often cached
 * densities are refreshed, and how many steps it takes until pixels are means (train/step.h,
 * train/refresh.h). */
#include "unit.h"
#include "tests.h"
#include "train/refresh.h"
#include "trainer_fixture.h"

static void assert_is(double got, double want)
{
    if (!(fabs(got - want) < 1e-6))
        fail_msg("%.9g, not %.9g", got, want);
}

/* A pixel of two rays has two halves; a ray that was drawn for a point that is known counts in the
 * loss alone; behind the last ray is nothing. */
static void owe(cln_trainer *t, float loss)
{
    static const float shares[] = {1, 0.5f, 0.5f, -0.25f, 1}, squares[] = {.3f, .1f, .2f, 9, 9};
    const float losses[] = {loss, .2f, .6f, .8f, 9};

    for (int i = 0; i < 5; i++)
        t->results[i] =
            (cln_ray_result){.share = shares[i], .loss = losses[i], .square_error = squares[i]};
    t->owed.due = true;
    t->owed.step = 7;
    t->owed.rays = 4;
    t->owed.samples = 60;
}

/* Where a quarter of the pixels is drawn, the others have no loss and the error that is known. */
static void test_told(void **state)
{
    cln_config config = fixture_config();
    cln_trainer t;

    (void)state;
    for (int skips = 0; skips < 2; skips++) {
        const double rays = skips ? 8 : 2, square = .45 + (skips ? 8 * .02 : 0);

        config.skip_uncovered = skips;
        open_trainer(&config, &t);
        t.batch.coverage.whole = false;
        t.batch.coverage.share = .25;
        t.batch.coverage.error_other = .02;
        owe(&t, .5f);
        for (int again = 0; again < 2; again++) { /* no step is told twice */
            assert_ok(cln_step_catch_up(&t));
            assert_is(t.model.row.loss, 1.1 / 2.25 * (skips ? .25 : 1));
            assert_is(t.model.row.square, square / rays);
            assert_is(t.model.sum_square, square);
            assert_int_equal(t.model.sum_rays, rays);
            assert_int_equal(t.model.row.steps, 1);
            assert_int_equal(t.model.row.rays, 4);
            assert_int_equal(t.model.row.samples, 60);
        }
        owe(&t, .5f);
        assert_ok(cln_step_catch_up(&t));
        assert_is(t.model.row.loss, 2.2 / 2.25 * (skips ? .25 : 1));
        assert_is(t.model.row.square, 2 * square / rays);
        assert_is(t.model.sum_square, 2 * square);
        assert_int_equal(t.model.row.steps, 2);
        owe(&t, NAN);
        assert_fails(cln_step_catch_up(&t), CLN_DIVERGED, "step 7");
        assert_int_equal(t.model.row.steps, 2);
        close_trainer(&t);
    }
}

/* The steps, of `steps` after a growth of the tree, from one refresh of all to the next. Returns
 * how many refreshes there were. */
static int intervals(cln_trainer *t, int64_t steps, int64_t *each, int most)
{
    const int64_t begin = t->model.step, end = begin + steps;
    int64_t before = begin;
    int count = 0;
    bool whole = false;

    t->model.growth_step = begin;
    assert_ok(cln_refresh_due(t, true, &whole)); /* as a growth asks for */
    assert_true(whole && t->model.refresh_step == begin);
    while (++t->model.step <= end) {
        assert_ok(cln_refresh_due(t, false, &whole));
        assert_int_equal(whole, t->model.refresh_step == t->model.step);
        if (!whole)
            continue;
        assert_true(count < most);
        each[count++] = t->model.step - before;
        before = t->model.step;
    }
    return count;
}

/* Refreshes are frequent after each growth, then ever rarer, at most one in refresh_every steps. */
static void test_refreshes(void **state)
{
    enum { MOST = 200 };
    static const int every[] = {1, 20, 40, 200};
    cln_config config = fixture_config();
    cln_trainer t;

    (void)state;
    for (size_t i = 0; i < sizeof every / sizeof *every; i++) {
        int64_t each[MOST];

        config.refresh_every = every[i];
        open_trainer(&config, &t);
        t.model.step = 5;
        for (int growth = 0; growth < 2; growth++) {
            const int count = intervals(&t, every[i] == 1 ? 90 : 9 * every[i], each, MOST);
            int between = 0;

            assert_true(count >= 9);
            for (int k = 0; k < count; k++) {
                assert_in_range(each[k], k > 0 ? each[k - 1] : 1, every[i]);
                between += each[k] > each[0] && each[k] < every[i];
            }
            assert_int_equal(each[count - 1], every[i]);
            if (every[i] >= 40)
                assert_true(each[0] < every[i]);
            if (every[i] >= 200)
                assert_true(each[0] < every[i] / 4 && between >= 2);
        }
        close_trainer(&t);
    }
}

/* A training has so many steps that pixels become means with a fifth of the time to decide about
 * the tree left: before half of it, or, where N was asked for, before decisions end. */
static void test_steps_to_average(void **state)
{
    uint64_t first[2] = {0, 5000};
    cln_trainer t = {.batch = {.first = first, .train_views = 1}};

    (void)state;
    t.model.config.antialias_after = 3; /* 15,000 rays, which 100 a step draw in 150 steps */
    t.model.config.structure_until = 0.75;
    t.model.step = 7;
    t.model.drawn = 700;
    assert_is(cln_steps_to_average(&t), 380); /* 150 / 0.4 = 375, in tens */
    t.model.config.antialias = 2;
    assert_is(cln_steps_to_average(&t), 250); /* 150 / 0.6 */
}

int test_group_step(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steps_to_average),
        cmocka_unit_test(test_told),
        cmocka_unit_test(test_refreshes),
    };

    return cmocka_run_group_tests_name("step", tests, fixture_setup, fixture_teardown);
}
