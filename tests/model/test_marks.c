/* Marked cells. Tested: what meets a marked cell, how often cells were marked, room. Oracle: the
 * cells' boxes, one by one. */
#include "unit.h"
#include <string.h>
#include "base/rng.h"
#include "device_abi.h"
#include "model/marks.h"
#include "tests.h"

enum { SEED = 20261126, MARKS = 60, LOOKS = 4000 };

typedef struct box {
    int level, cell[3];
} box;

static uint32_t draw(uint32_t *counter)
{
    uint32_t c[4] = {(*counter)++, 0, 0, 0}, key[2] = {SEED, 0}, out[4];

    cln_philox(c, key, out);
    return out[0];
}

/* A cell of a level, drawn; half of them in the lowest corner, where there are few. */
static box draw_box(uint32_t *counter, int least_level)
{
    box b = {.level =
                 least_level + (int)(draw(counter) % (uint32_t)(CLN_MAX_LEVEL + 1 - least_level))};
    const uint32_t n = draw(counter) % 2 && b.level > 2 ? 4 : 1u << b.level;

    for (int a = 0; a < 3; a++)
        b.cell[a] = (int)(draw(counter) % n);
    return b;
}

static bool overlap(const box *a, const box *b)
{
    for (int axis = 0; axis < 3; axis++) {
        const int low_a = a->cell[axis] << (CLN_MAX_LEVEL - a->level);
        const int low_b = b->cell[axis] << (CLN_MAX_LEVEL - b->level);

        if (low_a + (1 << (CLN_MAX_LEVEL - a->level)) <= low_b ||
            low_b + (1 << (CLN_MAX_LEVEL - b->level)) <= low_a)
            return false;
    }
    return true;
}

static void test_meet(void **state)
{
    uint32_t counter = 0;
    int met = 0, looks = 0;

    (void)state;
    for (int round = 0; round < 20; round++) {
        box marked[MARKS];
        cln_marks marks = {0};
        const int count = round * 3; /* none at first */

        for (int i = 0; i < count; i++) {
            marked[i] = draw_box(&counter, 2 + round % 5);
            assert_int_equal(cln_marks_add(&marks, marked[i].level, marked[i].cell), CLN_OK);
        }
        cln_marks_order(&marks);
        for (int i = 1; i < marks.count; i++)
            assert_true(marks.mark[i].first > marks.mark[i - 1].end);
        for (int k = 0; k < LOOKS; k++, looks++) {
            const box b = draw_box(&counter, 0);
            bool want = false;

            for (int i = 0; i < count && !want; i++)
                want = overlap(&b, &marked[i]);
            assert_int_equal(cln_marks_meet(&marks, b.level, b.cell), want);
            met += want;
        }
        cln_marks_free(&marks);
    }
    assert_in_range(met, looks / 10, looks - looks / 10);
}

/* Cells of one level that were marked often enough, each once; room for no more than twice what
 * came. */
static void test_keep(void **state)
{
    enum { LEVEL = CLN_MAX_LEVEL, SIDE = 4, TIMES = 3, ADDED = 150 };
    uint32_t counter = 1 << 20;
    int often[SIDE * SIDE * SIDE] = {0}, kept = 0;
    cln_marks marks = {0};

    (void)state;
    cln_marks_keep(&marks, TIMES);
    assert_int_equal(marks.count, 0);
    for (int i = 0; i < ADDED; i++) {
        const int at = (int)(draw(&counter) % (SIDE * SIDE * SIDE));
        const int cell[3] = {at % SIDE, at / SIDE % SIDE, 200 + at / SIDE / SIDE};

        often[at]++;
        assert_int_equal(cln_marks_add(&marks, LEVEL, cell), CLN_OK);
    }
    cln_marks_keep(&marks, TIMES);
    for (int at = 0; at < SIDE * SIDE * SIDE; at++) {
        const int cell[3] = {at % SIDE, at / SIDE % SIDE, 200 + at / SIDE / SIDE};

        assert_int_equal(cln_marks_meet(&marks, LEVEL, cell), often[at] >= TIMES);
        kept += often[at] >= TIMES;
    }
    assert_int_equal(marks.count, kept);
    assert_in_range(kept, SIDE, SIDE * SIDE * SIDE - SIDE);
    cln_marks_free(&marks);
}

int test_group_marks(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_meet), cmocka_unit_test(test_keep)};

    return cmocka_run_group_tests_name("marks", tests, NULL, NULL);
}
