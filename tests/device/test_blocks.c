/* Memory of a CPU device's buffers that is kept for the next ones (device/blocks.h). */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "device/blocks.h"
#include "device/buffer.h"
#include "run_fixture.h"
#include "tests.h"

enum { MIB = 1 << 20 };

static bool have_huge_pages(void)
{
    void *page = cln_huge_pages(CLN_HUGE_PAGE);

    free(page);
    return page != NULL;
}

static void test_blocks_are_kept(void **state)
{
    cln_blocks *blocks = NULL;
    cln_block *small = NULL, *large = NULL, *other = NULL;
    void *memory = NULL;

    (void)state;
    assert_ok(cln_blocks_create(&blocks));
    assert_null(cln_blocks_take(blocks, 1000)); /* less than a huge page */
    small = cln_blocks_take(blocks, 4 * MIB);
    large = cln_blocks_take(blocks, 32 * MIB);
    if (!small || !large)
        skip(); /* a system without huge pages */
    memset(large->memory, 1, 32 * MIB);
    memory = large->memory;
    cln_block_give_back(large);
    cln_block_give_back(small);
    assert_int_equal(cln_blocks_trim(blocks, SIZE_MAX), 36 * MIB);

    other = cln_blocks_take(blocks, 3 * MIB); /* the large one's pages would lie idle */
    assert_ptr_equal(other, small);
    assert_int_equal(other->used, 3 * MIB); /* what it does not need counts nowhere */
    large = cln_blocks_take(blocks, cln_address_space_is_free() ? 40 * MIB : 32 * MIB);
    assert_ptr_equal(large->memory, memory); /* grows where it is */
    memset(large->memory, 2, 32 * MIB);
    assert_int_equal(cln_blocks_trim(blocks, SIZE_MAX), 0);
    cln_block_give_back(large);
    cln_block_give_back(other);
    assert_int_equal(cln_blocks_trim(blocks, SIZE_MAX), large->used + other->used);
    assert_int_equal(cln_blocks_trim(blocks, large->used + 1),
                     large->used); /* the small one went */
    small = cln_blocks_take(blocks, 4 * MIB);
    cln_blocks_close(blocks);
    cln_block_give_back(small); /* frees the rest: seen by sanitizers */
}

/* What is kept and what buffers take is never more than buffers alone took before. */
static void test_kept_memory_never_counts(void **state)
{
    cln_device *device = NULL;
    const cln_device_desc desc = fixture_device();
    cln_buffer a = {0}, b = {0}, c = {0};

    (void)state;
    if (cln_device_open(&desc, &device) == CLN_NO_DEVICE)
        skip();
    assert_ok(cln_buffer_reserve(device, &a, 24 * MIB, "a"));
    assert_ok(cln_buffer_reserve(device, &b, 16 * MIB, "b"));
    cln_buffer_free(device, &a);
    assert_int_equal(device->peak, 40 * MIB);
    if (strcmp(device->info.type, "cpu") == 0 && have_huge_pages())
        assert_int_equal(cln_blocks_trim(device->blocks, SIZE_MAX), 24 * MIB);
    assert_ok(cln_buffer_reserve(device, &c, 8 * MIB, "c"));
    assert_true(device->allocated + cln_blocks_trim(device->blocks, SIZE_MAX) <= device->peak);
    assert_ok(cln_buffer_reserve(device, &a, 60 * MIB, "a"));
    assert_true(device->allocated + cln_blocks_trim(device->blocks, SIZE_MAX) <= device->peak);
    cln_buffer_free(device, &a);
    cln_buffer_free(device, &b);
    cln_buffer_free(device, &c);
    assert_int_equal(device->allocated, 0);
    cln_device_close(device);
}

int test_group_blocks(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_blocks_are_kept),
                                       cmocka_unit_test(test_kept_memory_never_counts)};

    return cmocka_run_group_tests_name("blocks", tests, NULL, NULL);
}
