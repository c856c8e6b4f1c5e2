/* scan.cl and group.cl through their stages: prefix sums, the stable radix sort, samples grouped
 * by leaf, against plain loops on the host. Results are integers and must be equal. Sizes: 0,
 * around the chunk length of every parameter set, over a million. Long runs of equal keys reveal
 * instability in the values. */
#include "unit.h"
#include "device_test.h"
#include "tests.h"

static uint32_t random_bits(int index)
{
    const uint32_t counter[4] = {(uint32_t)index, 1, 2, 3}, key[2] = {4, 5};
    uint32_t out[4];

    cln_philox(counter, key, out);
    return out[0];
}

static cln_pipeline *pipeline_of(int set)
{
    cln_config config = small_config();

    config.stage1 = CLN_STAGE1_SPLAT; /* only splatting builds the 64-bit sort */
    return test_pipeline(&tune_sets[set], &config, false, false);
}

/* 0, 1, around one chunk (the smallest, and that of the widest digit), and many chunks. */
enum { MOST_SIZES = 12 };
static int sizes_of(const cln_pipeline *p, uint32_t sizes[MOST_SIZES])
{
    const uint32_t chunk = (uint32_t)p->tune.chunk, wide = CLN_SORT_PER_DIGIT << p->tune.db;
    const uint32_t all[] = {0,        1,    2,        chunk - 1,    chunk, chunk + 1,
                            wide - 1, wide, wide + 1, 3 * wide + 7, 20011};

    memcpy(sizes, all, sizeof all);
    return sizeof all / sizeof all[0];
}

static void check_scan(cln_pipeline *p, uint32_t n, bool in_place)
{
    cln_buffer in = {0}, out = {0};
    uint32_t *values = test_alloc(n, sizeof *values), *got = NULL, total = 77, sum = 0;

    for (uint32_t i = 0; i < n; i++)
        values[i] =
            random_bits((int)i) >> (i % 7 ? 20 : 8); /* sums wrap at 2^32, like those of uint */
    if (in_place) {
        test_fill(p->device, &out, NULL, (n + 1) * sizeof *values);
        assert_ok(cln_buffer_write(p->device, &out, 0, values, n * sizeof *values));
    } else {
        test_fill(p->device, &in, values, n * sizeof *values);
        test_fill(p->device, &out, NULL, (n + 1) * sizeof *values);
    }
    assert_ok(cln_stage_scan(p, in_place ? &out : &in, &out, n, CLN_STAGE_OTHER, &total));
    got = test_read(p->device, &out, (n + 1) * sizeof *got, "scan");
    for (uint32_t i = 0; i <= n; i++) {
        if (got[i] != sum)
            fail_msg("scan of %u: element %u is %u, not %u", n, i, got[i], sum);
        sum += i < n ? values[i] : 0;
    }
    assert_int_equal(total, got[n]);
    free(got);
    free(values);
    cln_buffer_free(p->device, &in);
    cln_buffer_free(p->device, &out);
}

static void test_scan(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        cln_pipeline *p = pipeline_of(set);
        uint32_t sizes[MOST_SIZES];

        for (int i = 0, count = sizes_of(p, sizes); i < count; i++) {
            check_scan(p, sizes[i], false);
            check_scan(p, sizes[i], true);
        }
        check_scan(p, 300007, false); /* several chunks for every set */
        check_scan(p, 300007, true);
    }
}

typedef enum kind {
    RANDOM,
    FEW,      /* 37 different ones: long runs of equals */
    EQUAL,    /* one key */
    SORTED,   /* ascending, each key several times */
    REVERSED, /* descending, likewise */
    ONE_BIT,  /* differ in one bit in the middle */
    TOP_BITS, /* differ in the three highest */
    EXTREME,  /* 0, 1, the highest bit, all bits */
    GAPS,     /* differ in every third bit */
    RAYS,     /* ray << 32 | bits of a float in [2, 6], as splatting has them: 50 bits */
    ISLANDS,  /* differ in three groups of bits, far apart: 50 bits */
    ONE_LOW,  /* random low halves; of all keys but one the high half is 0 */
    KINDS
} kind;
static const char *const kinds[KINDS] = {"random",   "few",     "equal",    "sorted",
                                         "reversed", "one bit", "top bits", "extreme",
                                         "gaps",     "rays",    "islands",  "one low"};

/* Key i of n, 64 bits; the sort uses its highest `bits`. */
static uint64_t key_of(kind k, uint32_t i, uint32_t n)
{
    const uint64_t random = (uint64_t)random_bits(2 * (int)i) << 32 | random_bits(2 * (int)i + 1);
    const uint64_t extremes[] = {0, (uint64_t)1 << 40, (uint64_t)1 << 63, ~(uint64_t)0};
    const float t = 2 + 4 * (float)(random >> 40) * 0x1p-24f;
    uint32_t t_bits = 0;

    memcpy(&t_bits, &t, sizeof t_bits);
    switch (k) {
    case FEW:
        return random % 37 * 0x9E3779B97F4A7C15ull;
    case EQUAL:
        return 0x9E3779B97F4A7C15ull;
    case SORTED:
        return (uint64_t)(i / 3) << 44;
    case REVERSED:
        return (uint64_t)((n - i) / 3) << 44;
    case ONE_BIT:
        return 0x9E3779B97F4A7C15ull ^ (random & (uint64_t)1 << 59);
    case TOP_BITS:
        return random >> 61 << 61;
    case EXTREME:
        return extremes[random % 4];
    case GAPS:
        return random & 0x9249249249249249ull;
    case RAYS:
        return ((uint64_t)cln_bounded((uint32_t)(random >> 8), 160000) << 32 | t_bits) << 14;
    case ISLANDS:
        return (random & 0x3FC00001FF1FFull) << 14;
    case ONE_LOW:
        return i == n / 2 ? random : random >> 32;
    default:
        return random;
    }
}

static uint64_t junk(uint32_t i)
{
    return (uint64_t)random_bits((int)i) * 0x9E3779B97F4A7C15ull;
}

/* n keys of 4 or 8 bytes, to be sorted by their lowest `bits`; their values are their places. */
typedef struct input {
    uint32_t n;
    int bits;
    bool wide;
    kind k;
    size_t size; /* of a key */
    unsigned char *keys;
    uint32_t *values;
} input;

static input make_input(uint32_t n, int bits, bool wide, kind k)
{
    input in = {.n = n, .bits = bits, .wide = wide, .k = k};

    in.size = wide ? sizeof(uint64_t) : sizeof(uint32_t);
    in.keys = test_alloc(n, in.size);
    in.values = test_alloc(n, sizeof *in.values);
    for (uint32_t i = 0; i < n; i++) {
        uint64_t key = key_of(k, i, n) >> (64 - bits);

        if (wide && bits < 64) /* bits above the sorted ones must not matter */
            key |= junk(i) << bits;
        memcpy(in.keys + i * in.size, &key, in.size); /* little endian like the device */
        in.values[i] = i;
    }
    return in;
}

static void free_input(input *in)
{
    free(in->keys);
    free(in->values);
}

/* Every value is there once, with its key; keys ascend, and values where keys are equal: there is
 * one such order, that of a stable sort. */
static void check_sorted(const input *in, const unsigned char *keys, const uint32_t *values)
{
    const uint64_t mask = ~(uint64_t)0 >> (64 - in->bits);
    uint8_t *met = test_alloc(in->n, 1);
    uint64_t before = 0;

    for (uint32_t i = 0; i < in->n; i++) {
        const uint32_t value = values[i];
        uint64_t key = 0;

        memcpy(&key, keys + i * in->size, in->size);
        if (value >= in->n || met[value])
            fail_msg("sort of %u %s keys by %d bits: place %u has value %u%s", in->n, kinds[in->k],
                     in->bits, i, value, value < in->n ? " again" : "");
        met[value] = 1;
        if (memcmp(&key, in->keys + value * in->size, in->size) != 0)
            fail_msg("sort of %u %s keys by %d bits: value %u has lost its key", in->n,
                     kinds[in->k], in->bits, value);
        key &= mask;
        if (i > 0 && (key < before || (key == before && value < values[i - 1])))
            fail_msg("sort of %u %s keys by %d bits: place %u has key %llx of %u after %llx of %u",
                     in->n, kinds[in->k], in->bits, i, (unsigned long long)key, value,
                     (unsigned long long)before, values[i - 1]);
        before = key;
    }
    free(met);
}

static void check_sort_of(cln_pipeline *p, const input *in)
{
    cln_buffer keys[2] = {{0}, {0}}, values[2] = {{0}, {0}};
    const size_t key_bytes = in->n * in->size, value_bytes = in->n * sizeof *in->values;
    unsigned char *got_keys = NULL;
    uint32_t *got_values = NULL;

    for (int b = 0; b < 2; b++) {
        test_fill(p->device, &keys[b], b ? NULL : in->keys, key_bytes);
        test_fill(p->device, &values[b], b ? NULL : in->values, value_bytes);
    }
    assert_ok(cln_stage_sort(p, keys, values, in->n, in->bits, in->wide, CLN_STAGE_SORT));
    got_keys = test_read(p->device, &keys[0], key_bytes, "sorted keys");
    got_values = test_read(p->device, &values[0], value_bytes, "sorted values");
    free(test_read(p->device, &keys[1], key_bytes, "spare keys"));
    free(test_read(p->device, &values[1], value_bytes, "spare values"));
    check_sorted(in, got_keys, got_values);
    for (int b = 0; b < 2; b++) {
        cln_buffer_free(p->device, &keys[b]);
        cln_buffer_free(p->device, &values[b]);
    }
    free(got_keys);
    free(got_values);
}

static void check_sort(cln_pipeline *p, uint32_t n, int bits, bool wide, kind k)
{
    input in = make_input(n, bits, wide, k);

    check_sort_of(p, &in);
    free_input(&in);
}

static void test_sort(void **state)
{
    static const int narrow_bits[] = {1, 8, 9, 12, 32}, wide_bits[] = {8, 40, 52, 64};

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        cln_pipeline *p = pipeline_of(set);
        uint32_t sizes[MOST_SIZES];

        for (int i = 0, count = sizes_of(p, sizes); i < count; i++) {
            for (int b = 0; b < 5; b++)
                check_sort(p, sizes[i], narrow_bits[b], false, b % 2 ? RANDOM : FEW);
            for (int b = 0; b < 4; b++)
                check_sort(p, sizes[i], wide_bits[b], true, b % 2 ? RANDOM : FEW);
        }
        for (kind k = 0; k < KINDS; k++) {
            check_sort(p, 5003, 32, false, k);
            check_sort(p, 5003, 64, true, k);
            check_sort(p, 40009, 64, true, k); /* enough to look for varying bits */
        }
    }
}

/* A million and more keys: writes whole lines and sorts buckets; also where a bucket would be too
 * large for that. */
static void test_large_sort(void **state)
{
    static const struct {
        int bits;
        bool wide;
        kind k;
    } of_all_sets[] = {
        {64, true, RANDOM},  {50, true, RAYS},    {50, true, ISLANDS},
        {64, true, ONE_LOW}, {32, false, RANDOM},
    };
    const uint32_t n = (1u << 20) + 77;

    (void)state;
    for (size_t i = 0; i < sizeof of_all_sets / sizeof of_all_sets[0]; i++) {
        input in = make_input(n, of_all_sets[i].bits, of_all_sets[i].wide, of_all_sets[i].k);

        for (int set = 0; set < TUNE_SETS; set++)
            check_sort_of(pipeline_of(set), &in);
        free_input(&in);
    }
    for (kind k = 0; k < KINDS; k++)
        if (k != RANDOM && k != ONE_LOW) /* those are above */
            check_sort(pipeline_of(0), n, 64, true, k);
}

/* Number of kernels that a sort of n keys by `bits` bits launches. */
static int launches_of(cln_pipeline *p, uint32_t n, int bits, kind k)
{
    cln_buffer keys[2] = {{0}, {0}}, values[2] = {{0}, {0}};
    uint64_t *in_keys = test_alloc(n, sizeof *in_keys), before = 0, after = 0;
    unsigned char *spare = NULL;

    for (uint32_t i = 0; i < n; i++)
        in_keys[i] = key_of(k, i, n) >> (64 - bits);
    for (int b = 0; b < 2; b++) {
        test_fill(p->device, &keys[b], b ? NULL : in_keys, n * sizeof *in_keys);
        test_fill(p->device, &values[b], NULL, n * sizeof(uint32_t));
    }
    assert_ok(cln_device_finish(p->device));
    before = p->device->settled;
    assert_ok(cln_stage_sort(p, keys, values, n, bits, true, CLN_STAGE_SORT));
    assert_ok(cln_device_finish(p->device));
    after = p->device->settled;
    spare = test_read(p->device, &keys[1], n * sizeof *in_keys, "spare keys");
    for (size_t i = 0; k == EQUAL && i < n * sizeof *in_keys; i++)
        assert_int_equal(spare[i], 0xFF);
    for (int b = 0; b < 2; b++) {
        cln_buffer_free(p->device, &keys[b]);
        cln_buffer_free(p->device, &values[b]);
    }
    free(in_keys);
    free(spare);
    return (int)(after - before);
}

/* Only the bits in which keys differ need passes: none for equal keys (the spare buffers stay
 * unchanged), one for a few bits at any positions. */
static void test_passes(void **state)
{
    enum { N = 40009, LOOK = 1, PASS = 3 }; /* looking at the bits; count, scan, scatter */

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        cln_pipeline *p = pipeline_of(set);
        const int all = launches_of(p, N, 64, RANDOM), db = p->tune.db;

        assert_int_equal(launches_of(p, N, 64, EQUAL), LOOK);
        assert_int_equal(launches_of(p, N, 64, ONE_BIT), LOOK + PASS);
        assert_int_equal(launches_of(p, N, 64, TOP_BITS), LOOK + PASS);
        assert_int_equal(launches_of(p, N, 4, RANDOM), LOOK + PASS * ((4 + db - 1) / db));
        assert_true(all >= LOOK + PASS * ((64 + db - 1) / db));
    }
}

/* ---- samples grouped by leaf ---- */

/* Samples of each leaf in their own order, in slices that cover every sample once. */
static void check_groups(cln_pipeline *p, const int *counts, int leaves)
{
    double leaf_samples = 0, padding = 0, met = 0, rows = 0;
    uint32_t n = 0, at = 0, slices = 0, most = 0, *order = NULL, *begin = NULL, *end = NULL;
    cln_sample *samples = NULL;
    cln_slice *slice = NULL;

    for (int s = 0; s < leaves; s++)
        n += (uint32_t)counts[s];
    samples = test_alloc(n, sizeof *samples);
    for (int s = 0; s < leaves; s++) {
        for (int i = 0; i < counts[s]; i++)
            samples[at++].slot = s;
    }
    for (uint32_t i = n; i > 1; i--) { /* shuffled */
        const uint32_t j = cln_bounded(random_bits((int)i), i);
        const cln_sample kept = samples[i - 1];

        samples[i - 1] = samples[j];
        samples[j] = kept;
    }
    p->leaves = p->own = leaves;
    test_fill(p->device, &p->samples, samples, n * sizeof *samples);
    test_fill(p->device, &p->begin, NULL, (size_t)leaves * sizeof *begin);
    test_fill(p->device, &p->end, NULL, (size_t)leaves * sizeof *end);
    test_fill(p->device, &p->slice_counts, NULL, (size_t)leaves * sizeof *begin);
    test_fill(p->device, &p->slice_starts, NULL, (size_t)(leaves + 1) * sizeof *begin);
    for (int b = 0; b < 2; b++) {
        test_fill(p->device, &p->keys[b], NULL, n * sizeof *order);
        test_fill(p->device, &p->values[b], NULL, n * sizeof *order);
    }
    test_fill(p->device, &p->slices, NULL, (2 * n + 1) * sizeof *slice);
    assert_ok(cln_stage_group(p, n, &most));
    assert_ok(cln_stage_slices(p, &slices));
    assert_true(slices <= most && most <= 2 * n);
    order = test_read(p->device, &p->values[0], n * sizeof *order, "order");
    begin = test_read(p->device, &p->begin, (size_t)leaves * sizeof *begin, "begin");
    end = test_read(p->device, &p->end, (size_t)leaves * sizeof *end, "end");
    slice = test_read(p->device, &p->slices, (2 * n + 1) * sizeof *slice, "slices");
    free(test_read(p->device, &p->slice_starts, (size_t)(leaves + 1) * sizeof *begin, "slices"));
    at = 0;
    for (uint32_t i = 0, s = 0; s < (uint32_t)leaves; s++) {
        const uint32_t first = at;

        assert_int_equal(end[s] - begin[s], counts[s]);
        assert_true(counts[s] == 0 || begin[s] == first);
        for (uint32_t j = 0; j < (uint32_t)counts[s]; j++, at++) {
            assert_true(order[at] < n);
            assert_int_equal(samples[order[at]].slot, s);
            assert_true(j == 0 || order[at] > order[at - 1]);
        }
        for (uint32_t covered = first; covered < at; i++) {
            /* with several slices none is short (kernels/group.cl) */
            assert_true(counts[s] <= p->tune.sl || slice[i].count >= (uint32_t)p->tune.sl / 2);
            assert_true(i < slices);
            assert_int_equal(slice[i].slot, s);
            assert_int_equal(slice[i].start, covered);
            assert_true(slice[i].count > 0 && slice[i].count <= (uint32_t)p->tune.sl);
            covered += slice[i].count;
            assert_true(covered == at || slice[i].count % (uint32_t)p->tune.nb == 0);
            assert_true(covered <= at);
        }
        assert_true(s + 1 < (uint32_t)leaves || i == slices);
    }
    for (uint32_t i = slices; i < most; i++)
        assert_int_equal(slice[i].count, 0);
    for (int s = 0; s < leaves; s++)
        met += counts[s] > 0;
    for (uint32_t i = 0; i < slices; i++)
        rows += ceil((double)slice[i].count / p->tune.ts) * p->tune.ts;
    assert_ok(cln_stage_fill(p, &leaf_samples, &padding));
    assert_true(fabs(leaf_samples - (n > 0 ? n / met : 0)) < 1e-12);
    assert_true(fabs(padding - (n > 0 ? 1 - n / rows : 0)) < 1e-12);
    free(samples);
    free(order);
    free(begin);
    free(end);
    free(slice);
}

static void test_grouping(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        cln_pipeline *p = pipeline_of(set);
        const int sl = p->tune.sl, none[3] = {0, 0, 0}, one[1] = {1};
        const int mixed[9] = {0, 1, sl - 1, sl, sl + 1, 0, 3 * sl + 7, 2, 2 * sl - 1};
        int many[600];

        for (int s = 0; s < 600; s++) /* more leaves than one digit of the sort */
            many[s] = s % 3;
        check_groups(p, none, 3);
        check_groups(p, one, 1);
        check_groups(p, mixed, 9);
        check_groups(p, many, 600);
    }
}

int test_group_scan_sort(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scan),       cmocka_unit_test(test_sort),
        cmocka_unit_test(test_large_sort), cmocka_unit_test(test_passes),
        cmocka_unit_test(test_grouping),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(sort64) | CLN_PROGRAM_BIT(group);
    return cmocka_run_group_tests_name("scan_sort", tests, NULL, test_device_close);
}
