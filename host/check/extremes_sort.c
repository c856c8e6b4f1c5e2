/* Scan and sort, whose results are integers, at and over boundaries of sizes and sums. See
 * extremes.h. */
#include "check/extremes.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "check/selftest_checks.h"

static uint32_t random_bits(uint32_t i)
{
    return cln_hash(i * 2654435761u + 12345u);
}

/* Sizes at and over 2^8, 2^12, 2^16, 2^17; then beyond 2^20, and at and over 2^24. */
static const uint32_t sizes[] = {0,
                                 1,
                                 255,
                                 256,
                                 257,
                                 4095,
                                 4096,
                                 4097,
                                 65535,
                                 65536,
                                 65537,
                                 131073,
                                 (1u << 20) + 1,
                                 1u << 24,
                                 (1u << 24) + 1};
enum { SIZES = sizeof sizes / sizeof *sizes, QUICK = SIZES - 3 };

/* Totals of a scan. */
typedef enum total { TO_2_31, TO_2_32, WRAPPED, TOTALS } total;

static const char *const totals[TOTALS] = {"2^31", "2^32 - 1", "beyond 2^32"};

/* Fills in n values that sum to the total; the last one makes up the rest. */
static void fill(uint32_t *values, uint32_t n, total t)
{
    const uint32_t goal = t == TO_2_31 ? 1u << 31 : 0xFFFFFFFFu;
    const uint32_t each = goal / (n > 0 ? n : 1);
    uint32_t sum = 0;

    for (uint32_t i = 0; i < n; i++) {
        values[i] = t == WRAPPED ? random_bits(i)
                    : i + 1 < n  ? random_bits(i) % (each + 1)
                                 : goal - sum;
        sum += values[i];
    }
}

static cln_status check_scan(cln_checks *c, uint32_t n, total t, cln_extreme *row)
{
    cln_status st = CLN_OK;
    cln_device *device = c->p->device;
    const size_t bytes = ((size_t)n + 1) * sizeof(uint32_t);
    uint32_t *in = NULL, *out = NULL, all = 77, sum = 0, wrong = 0, first = 0;
    cln_buffer from = {0}, to = {0};

    CLN_TRY(cln_alloc(&in, (size_t)n + 1, sizeof *in, "self-test"));
    CLN_TRY(cln_alloc(&out, (size_t)n + 1, sizeof *out, "self-test"));
    fill(in, n, t);
    CLN_TRY(cln_check_put(device, &from, in, bytes));
    CLN_TRY(cln_check_spoil(device, &to, bytes));
    CLN_TRY(cln_stage_scan(c->p, &from, &to, n, CLN_STAGE_OTHER, &all));
    CLN_TRY(cln_buffer_read(device, &to, 0, out, bytes));
    for (uint32_t i = 0; i <= n; i++) {
        if (out[i] != sum && wrong++ == 0)
            first = i;
        sum += i < n ? in[i] : 0;
    }
    wrong += all != sum;
    cln_extreme_meet(row, wrong, 0, 1, 0, "%u numbers that sum to %s, the first wrong at %u", n,
                     totals[t], first);
done:
    cln_buffer_free(device, &from);
    cln_buffer_free(device, &to);
    free(in);
    free(out);
    return st;
}

typedef enum key_kind { RANDOM, EQUAL, FEW, ENDS, RAYS, KEYS } key_kind;

static const char *const key_names[KEYS] = {"random", "equal", "few", "0 and all bits", "rays'"};

static uint64_t key_of(key_kind k, uint32_t i)
{
    const uint64_t random = (uint64_t)random_bits(2 * i) << 32 | random_bits(2 * i + 1);

    switch (k) {
    case EQUAL:
        return 0x9E3779B97F4A7C15ull;
    case FEW:
        return random % 37 * 0x9E3779B97F4A7C15ull;
    case ENDS:
        return random & 1 ? ~(uint64_t)0 : 0;
    case RAYS: /* a ray of 10^7, and the bits of a float in [2, 8) */
        return (random >> 8) % 10000000 << 32 | (0x40000000u + (random & 0xFFFFFFu));
    default:
        return random;
    }
}

static cln_status check_sort(cln_checks *c, uint32_t n, key_kind k, bool wide, cln_extreme *row)
{
    cln_status st = CLN_OK;
    uint64_t *keys = NULL;
    uint32_t wrong = 0;

    CLN_TRY(cln_alloc(&keys, n, sizeof *keys, "self-test"));
    for (uint32_t i = 0; i < n; i++)
        keys[i] = wide ? key_of(k, i) : key_of(k, i) >> (k == RAYS ? 0 : 32) & 0xFFFFFFFFu;
    CLN_TRY(cln_check_sort_keys(c, keys, n, wide ? 64 : 32, wide, &wrong));
    cln_extreme_meet(row, wrong, 0, 1, 0, "%u %s keys", n, key_names[k]);
done:
    free(keys);
    return st;
}

/* Whether n elements fit: each takes 32 bytes of host and device memory, 8 of a buffer. */
static bool fits(const cln_device *device, uint32_t n)
{
    return 8.0 * n <= (double)device->max_alloc && 32.0 * n <= 0.5 * device->info.global_mem &&
           32.0 * n <= 0.5 * cln_host_memory();
}

cln_status cln_extremes_sort(cln_checks *c, bool quick)
{
    const int last = quick ? QUICK : SIZES;
    const char *range = quick ? "sizes 0 to 2^17 + 1" : "sizes 0 to 2^24 + 1";
    cln_status st = CLN_OK;
    cln_extreme scan = cln_extreme_row(c, "scan", range);
    cln_extreme narrow = cln_extreme_row(c, "sort, 32 bit", range);
    cln_extreme wide = cln_extreme_row(c, "sort, 64 bit", range);

    for (int i = 0; i < last; i++) {
        if (!fits(c->p->device, sizes[i])) {
            cln_check_report(c, "scan and sort", false, true, "no memory for the largest sizes");
            break;
        }
        for (total t = 0; t < TOTALS; t++)
            CLN_TRY(check_scan(c, sizes[i], t, &scan));
        for (key_kind k = 0; k < KEYS; k++) {
            if (sizes[i] > 1u << 20 && k != RANDOM && k != RAYS)
                continue;
            CLN_TRY(check_sort(c, sizes[i], k, false, &narrow));
            CLN_TRY(check_sort(c, sizes[i], k, true, &wide));
        }
    }
    cln_extreme_report(&scan);
    cln_extreme_report(&narrow);
    cln_extreme_report(&wide);
done:
    return st;
}
