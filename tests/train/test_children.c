/* Which children a split makes (train/children.h). Tested: that those which are none go right after
 * it, as one change, on a tree by hand. */
#include "unit.h"
#include <stdlib.h>
#include "outcome.h"
#include "tests.h"
#include "train/children.h"

/* Splits slot 2 of eight; kept: which of its children are some. */
static void check_drop(uint8_t kept, int leaves, const int8_t *octants)
{
    const uint8_t split[8] = {0, 0, 1};
    uint8_t *children = NULL;
    int node = 0;
    cln_octree tree;
    cln_octree_change change;

    assert_ok(cln_octree_create(1, &tree));
    node = tree.leaf[2];
    assert_ok(cln_octree_split(&tree, split, &change));
    children = calloc((size_t)tree.node_count, 1);
    assert_non_null(children);
    children[node] = kept;
    assert_ok(cln_children_drop(&tree, children, &change));
    assert_int_equal(tree.leaf_count, leaves);
    assert_int_equal(change.count, leaves);
    for (int s = 0; s < leaves; s++)
        assert_int_equal(change.octant[s], octants[s]);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
    free(children);
}

static void test_drop(void **state)
{
    (void)state;
    check_drop(0xF6, 13, (const int8_t[]){-1, -1, 1, 2, 4, 5, 6, 7, -1, -1, -1, -1, -1});
    check_drop(0x7F, 14, (const int8_t[]){-1, -1, 0, 1, 2, 3, 4, 5, 6, -1, -1, -1, -1, -1});
    check_drop(0xFF, 15, (const int8_t[]){-1, -1, 0, 1, 2, 3, 4, 5, 6, 7, -1, -1, -1, -1, -1});
}

int test_group_children(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_drop)};

    return cmocka_run_group_tests_name("children", tests, NULL, NULL);
}
