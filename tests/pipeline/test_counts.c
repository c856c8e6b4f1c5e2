/* Numbers at and over 2^31 and 2^32, without their memory: places of rows in arrays with a row per
 * leaf, by the macros of kernels/leaves.h; and pixels of photos, in memory that is only reserved.
 * test_plan.c has the memory plans of such sizes, test_splat.c counts of projected samples, the
 * extremes sums of a scan. */
#include "unit.h"
#include <string.h>
#include <sys/mman.h>
#include "base/config.h"
#include "base/status.h"
#include "scene/scene.h"
#include "tests.h"
#include "train/batch.h"

/* ---- rows (kernels/leaves.h as C) ---- */

#define uint     uint32_t
#define __global const

#include "../../kernels/leaves.h"
static const char *row_of_one(const char *name, uint leaf, uint row)
{
    return LEAF_ROW(name, leaf, row);
}
static const char *slice_of_one(const char *name, uint slice, uint row)
{
    return SLICE_ROW(name, slice, row);
}

#undef PARTS
#undef PART_LEAVES
#undef PART_SLICES
#undef LEAF_ARRAY
#undef LEAF_PASS
#undef PART_ROW
#undef LEAF_ELEMENT
#undef LEAF_ROW
#undef SLICE_ROW
#define PARTS       4
#define PART_LEAVES 70000u
#define PART_SLICES 1200000000u /* two of them are beyond 2^31 */
#include "../../kernels/leaves.h"
static const char *row_of_four(const char *name_0, const char *name_1, const char *name_2,
                               const char *name_3, uint leaf, uint row)
{
    return LEAF_ROW(name, leaf, row);
}
static const char *slice_of_four(const char *name_0, const char *name_1, const char *name_2,
                                 const char *name_3, uint slice, uint row)
{
    return SLICE_ROW(name, slice, row);
}
static char element_of_four(const char *name_0, const char *name_1, const char *name_2,
                            const char *name_3, uint index, uint row)
{
    return LEAF_ELEMENT(name, index, row);
}
#undef uint
#undef __global

/* Addresses without memory behind them. */
static char *reserve(size_t bytes, int protection)
{
    void *at = mmap(NULL, bytes, protection, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

    if (at == MAP_FAILED)
        skip();
    return at;
}

static void test_rows(void **state)
{
    const size_t bytes = (size_t)1 << 36;
    const uint32_t row = 61636; /* of W64-D8-V256: 2^31 elements from leaf 34842 on */
    const uint32_t leaves[] = {0,     1,      34841,  34842,  69684,  69999,
                               70000, 139999, 140000, 209999, 210000, 262143};
    const uint32_t slices[] = {0, 1199999999u, 1200000000u, 2399999999u, 2400000000u, 4294967295u};
    char *at = reserve(bytes, PROT_NONE);

    (void)state;
    for (size_t i = 0; i < sizeof leaves / sizeof *leaves; i++) {
        const size_t place = (size_t)leaves[i] * row, part = leaves[i] / 70000;
        const char *base = at + (part << 33);

        assert_true(row_of_one(at, leaves[i], row) == at + place);
        assert_true(row_of_four(at, at + ((size_t)1 << 33), at + ((size_t)2 << 33),
                                at + ((size_t)3 << 33), leaves[i],
                                row) == base + (size_t)(leaves[i] % 70000) * row);
    }
    for (size_t i = 0; i < sizeof slices / sizeof *slices; i++) {
        const size_t part = slices[i] / 1200000000u;

        assert_true(slice_of_one(at, slices[i], 8) == at + (size_t)slices[i] * 8);
        assert_true(slice_of_four(at, at + ((size_t)1 << 34), at + ((size_t)2 << 34),
                                  at + ((size_t)3 << 34), slices[i],
                                  8) == at + (part << 34) + (size_t)(slices[i] % 1200000000u) * 8);
    }
    assert_int_equal(munmap(at, bytes), 0);
}

/* Element 2^32 - 1 of an array in four parts of 70,000 rows: leaf 69684 of part 0. */
static void test_elements(void **state)
{
    const uint32_t row = 61636, index = UINT32_MAX;
    const size_t bytes = (size_t)70000 * row;
    char *at = reserve(bytes, PROT_READ | PROT_WRITE);

    (void)state;
    at[index] = 7;
    assert_int_equal(element_of_four(at, NULL, NULL, NULL, index, row), 7);
    assert_int_equal(element_of_four(at, NULL, NULL, NULL, index - 1, row), 0);
    assert_int_equal(munmap(at, bytes), 0);
}

/* ---- photos ---- */

enum { VIEWS = 3, SIDE = 40000, RAYS = 4096 };

/* Three photos of 1.6e9 pixels, 4.8e9 in all and 4.8e9 bytes each: every pixel is drawn with the
 * same probability, and read where it is. All show the same memory. */
static void test_photos(void **state)
{
    const size_t bytes = (size_t)SIDE * SIDE * 3;
    const cln_draw draw = {.step = 5, .n = RAYS};
    uint8_t *pixels = (uint8_t *)reserve(bytes, PROT_READ | PROT_WRITE);
    cln_view views[VIEWS] = {0};
    cln_scene scene = {.views = views, .view_count = VIEWS};
    int by_view[VIEWS] = {0}, late = 0, beyond = 0;
    cln_config config;
    cln_batch batch;

    (void)state;
    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    for (int i = 0; i < VIEWS; i++) {
        views[i].split = CLN_SPLIT_TRAIN;
        views[i].camera.width = views[i].camera.height = SIDE;
        views[i].channels = 3;
        views[i].pixels = pixels;
    }
    assert_int_equal(cln_batch_create(&scene, &config, &batch), CLN_OK);
    assert_true(batch.first[VIEWS] == (uint64_t)4800000000u);
    cln_batch_draw(&batch, &scene, &config, &draw);
    for (int i = 0; i < RAYS; i++) {
        const cln_pixel *p = &batch.pixels[i];
        const size_t place = ((size_t)p->y * SIDE + p->x) * 3;

        assert_in_range(p->view, 0, VIEWS - 1);
        assert_in_range(p->x, 0, SIDE - 1);
        assert_in_range(p->y, 0, SIDE - 1);
        by_view[p->view]++;
        late += p->y >= SIDE / 2;
        beyond += place > UINT32_MAX;
        for (size_t c = 0; c < 3; c++)
            pixels[place + c] = (uint8_t)(1 + (place + c * 50) % 255);
    }
    cln_batch_draw(&batch, &scene, &config, &draw); /* the same pixels, now coloured */
    for (int i = 0; i < RAYS; i++) {
        const cln_pixel *p = &batch.pixels[i];
        const size_t place = ((size_t)p->y * SIDE + p->x) * 3;

        for (size_t c = 0; c < 3; c++)
            assert_true(batch.targets[i][c] == (float)pixels[place + c] / 255 &&
                        pixels[place + c] == 1 + (place + c * 50) % 255);
    }
    for (int i = 0; i < VIEWS; i++) /* six standard deviations */
        assert_in_range(by_view[i], RAYS / 3 - 181, RAYS / 3 + 181);
    assert_in_range(late, RAYS / 2 - 192, RAYS / 2 + 192);
    assert_true(beyond > 200);
    cln_batch_free(&batch);
    assert_int_equal(munmap(pixels, bytes), 0);
}

int test_group_counts(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_rows), cmocka_unit_test(test_elements),
                                       cmocka_unit_test(test_photos)};

    return cmocka_run_group_tests_name("counts", tests, NULL, NULL);
}
