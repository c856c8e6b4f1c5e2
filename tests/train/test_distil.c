/* Random numbers of distilled leaves. Tested: none is drawn twice, up to the most nodes and points
 * that there can be. Training itself is test_training.c's. */
#include "unit.h"
#include "tests.h"
#include "train/distil.h"

/* Nodes and indices on both sides of 2^16, which fills half a counter. */
static void test_counters(void **state)
{
    static const int32_t nodes[] = {0, 1, 255, 65535, 65536, 65537, 131072, 16777216, INT32_MAX};
    static const uint32_t indices[] = {0, 1, 255, 65535, 65536, 131071, 16 * 65536 - 1};
    enum { NODES = sizeof nodes / sizeof *nodes, INDICES = sizeof indices / sizeof *indices };
    enum { WHATS = 4, ALL = NODES * INDICES * WHATS };
    uint32_t counter[ALL][2];

    (void)state;
    for (int i = 0; i < ALL; i++) {
        cln_distil_counter(nodes[i / WHATS / INDICES], indices[i / WHATS % INDICES],
                           1 + (uint32_t)(i % WHATS), counter[i]);
        assert_true(counter[i][1] < 1 << 24); /* above is the stream's number */
        for (int k = 0; k < i; k++)
            assert_true(counter[i][0] != counter[k][0] || counter[i][1] != counter[k][1]);
    }
}

int test_group_distil(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_counters)};

    return cmocka_run_group_tests_name("distil", tests, NULL, NULL);
}
