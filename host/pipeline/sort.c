/* Prefix sums and the stable radix sort (kernels/scan.cl): cuts the work into chunks and the keys
 * into digits. Chunks grow with n, so that their tables stay small; digits skip bits that are equal
 * in all keys. Neither changes a result. */
#include "pipeline/stages.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* ALONE: one group alone scans up to this many elements. LOOK: from this many keys on, finding the
 * bits that vary costs less than a pass. STREAM: this many pairs no longer stay in a CPU's caches
 * between passes, and whole lines are written past the caches. BUCKET: pairs that fit the caches of
 * one core. */
enum { ALONE = 32768, LOOK = 32768, STREAM = 1 << 20, BUCKET = 8192, MAX_PASSES = 64 };

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* Elements of a chunk, of n in all: enough to keep the table of `digits` counts per chunk small. */
static cl_uint chunk_of(const cln_pipeline *p, size_t n, size_t digits)
{
    const size_t groups = CLN_SORT_PARTS * larger(1, (size_t)p->device->info.compute_units);

    return (cl_uint)larger(larger((size_t)p->tune.chunk, CLN_SORT_PER_DIGIT * digits),
                           cln_groups(n, groups));
}

static cln_status scan(cln_pipeline *p, const cln_buffer *in, const cln_buffer *out, cl_uint n,
                       cl_uint chunk, cln_stage stage)
{
    return CLN_LAUNCH(p->device, p->k.scan_write, stage, larger(1, cln_groups(n, chunk)),
                      (size_t)p->tune.sg, CLN_ARG(in->mem), CLN_ARG(p->sums.mem), CLN_ARG(out->mem),
                      CLN_ARG(n), CLN_ARG(chunk));
}

cln_status cln_stage_scan(cln_pipeline *p, const cln_buffer *in, const cln_buffer *out, uint32_t n,
                          cln_stage stage, uint32_t *total)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const cl_uint count = n, chunk = n <= ALONE ? ALONE : chunk_of(p, n, 0);
    const cl_uint chunks = (cl_uint)cln_groups(n, chunk);

    CLN_TRY(CLN_RESERVE(p, sums, (size_t)chunks + 1));
    if (chunks > 1) {
        CLN_TRY(CLN_LAUNCH(device, p->k.scan_sums, stage, chunks, (size_t)p->tune.sg,
                           CLN_ARG(in->mem), CLN_ARG(p->sums.mem), CLN_ARG(count), CLN_ARG(chunk)));
        CLN_TRY(scan(p, &p->sums, &p->sums, chunks, chunks, stage));
    }
    CLN_TRY(scan(p, in, out, count, chunk, stage));
    if (total)
        CLN_TRY(cln_buffer_read(device, out, (size_t)n * sizeof(cl_uint), total, sizeof *total));
done:
    return st;
}

/* A digit of the keys: one or two pieces, see digit_of in scan.cl. */
typedef struct digit {
    cl_uint shift[2], mask[2];
    int bits;
} digit;

/* Length of the run of ones in `mask` from bit `from` upwards. */
static int run_of(uint64_t mask, int from)
{
    int length = 0;

    while (from + length < 64 && mask >> (from + length) & 1)
        length++;
    return length;
}

/* Bits from bit `from` of `mask` up to its highest set bit, looking at no more than `bits` bits. */
static int window(uint64_t mask, int from, int bits)
{
    int length = 0;

    for (int i = 0; i < bits && from + i < 64; i++)
        if (mask >> (from + i) & 1)
            length = i + 1;
    return length;
}

static uint64_t ones(int from, int bits)
{
    return (bits < 64 ? ((uint64_t)1 << bits) - 1 : ~(uint64_t)0) << from;
}

static int lowest(uint64_t mask)
{
    return mask ? __builtin_ctzll(mask) : 64;
}

/* Takes one digit of at most `bits` bits off the low end of *mask: a window of neighbours, or a run
 * of ones and a window above the next gap if that takes more ones. */
static digit next_digit(uint64_t *mask, int bits)
{
    const int low = lowest(*mask), alone = window(*mask, low, bits);
    int run = run_of(*mask, low), second = 0, rest = 0;
    uint64_t taken = ones(low, alone);
    digit d = {.shift = {(cl_uint)low}, .mask = {(1u << alone) - 1}, .bits = alone};

    run = run < bits ? run : bits;
    second = lowest(*mask & ~ones(0, low + run));
    if (run < bits && second < 64) {
        rest = window(*mask, second, bits - run);
        const uint64_t both = ones(low, run) | ones(second, rest);

        if (__builtin_popcountll(*mask & both) > __builtin_popcountll(*mask & taken)) {
            taken = both;
            d.bits = run + rest;
            d.mask[0] = (1u << run) - 1;
            d.shift[1] = (cl_uint)(second - run);
            d.mask[1] = ((1u << rest) - 1) << run;
        }
    }
    *mask &= ~taken;
    return d;
}

static int cut(uint64_t mask, int bits, digit digits[MAX_PASSES])
{
    int passes = 0;

    while (mask)
        digits[passes++] = next_digit(&mask, bits);
    return passes;
}

/* Time of a pass over n elements with digits of `bits` bits, in units of about one element's time.
 * A wider digit writes to more places and has more counts. */
static double pass_cost(size_t n, size_t chunks, int bits)
{
    const double digits = 1 << bits;

    return (double)n * (1 + digits / 4800) + 1.3 * (double)chunks * digits;
}

/* Cuts the keys into the digits of at most `most` bits that take the least time. */
static int plan_passes(const cln_pipeline *p, size_t n, uint64_t mask, int most,
                       digit digits[MAX_PASSES])
{
    const double launches = 10000; /* in elements, as pass_cost */
    double least = INFINITY;
    int best = most;

    for (int bits = 1; bits <= most; bits++) {
        const size_t chunks = cln_groups(n, chunk_of(p, n, (size_t)1 << bits));
        const double cost = cut(mask, bits, digits) * (pass_cost(n, chunks, bits) + launches);

        if (cost < least) {
            least = cost;
            best = bits;
        }
    }
    return cut(mask, best, digits);
}

/* The same for a bucket of n elements, whose keys differ only below bit `high`. Its digits are
 * windows of one width that end below `high`; a bit may be in two of them, which is harmless. */
static cl_uint plan_bucket(size_t n, uint64_t mask, int high, int most, cl_uint shifts[MAX_PASSES],
                           int *width)
{
    double least = INFINITY;
    cl_uint passes = 0;

    for (int bits = 1; bits <= most && bits <= high; bits++) {
        cl_uint windows[MAX_PASSES], count = 0;

        for (uint64_t rest = mask; rest; rest &= ~ones(lowest(rest), bits))
            windows[count++] = (cl_uint)(lowest(rest) < high - bits ? lowest(rest) : high - bits);
        if (count * pass_cost(n, 1, bits) < least) {
            least = count * pass_cost(n, 1, bits);
            *width = bits;
            passes = count;
            memcpy(shifts, windows, count * sizeof *windows);
        }
    }
    return passes;
}

/* Finds the bits in which 64-bit keys differ. Reads back. */
static cln_status varying(cln_pipeline *p, const cln_buffer *keys, cl_uint n, cln_stage stage,
                          uint64_t *mask)
{
    cln_status st = CLN_OK;
    const cl_uint chunk = chunk_of(p, n, 0);
    const size_t chunks = cln_groups(n, chunk);
    cl_ulong *masks = NULL;

    *mask = 0;
    CLN_TRY(cln_alloc(&masks, chunks, sizeof *masks, "sort masks"));
    CLN_TRY(CLN_RESERVE(p, sums, chunks));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.sort64_varying, stage, chunks, (size_t)p->tune.sg,
                       CLN_ARG(keys->mem), CLN_ARG(p->sums.mem), CLN_ARG(n), CLN_ARG(chunk)));
    CLN_TRY(cln_buffer_read(p->device, &p->sums, 0, masks, chunks * sizeof *masks));
    for (size_t i = 0; i < chunks; i++)
        *mask |= masks[i];
done:
    free(masks);
    return st;
}

typedef struct sort {
    cln_pipeline *p;
    cln_buffer *keys, *values; /* [2] each */
    cl_uint n;
    bool wide, streams; /* 64-bit keys; writes whole lines */
    cln_stage stage;
} sort;

static void swap(cln_buffer pair[2])
{
    const cln_buffer first = pair[0];

    pair[0] = pair[1];
    pair[1] = first;
}

/* Sets p->digit_counts: the first place of each chunk's elements with each digit. */
static cln_status find_places(const sort *s, const digit *d, cl_uint *chunks)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = s->p;
    const cl_uint digits = 1u << d->bits, chunk = chunk_of(p, s->n, digits);

    *chunks = (cl_uint)cln_groups(s->n, chunk);
    CLN_TRY(CLN_RESERVE(p, digit_counts, (size_t)digits * *chunks + 1));
    CLN_TRY(CLN_LAUNCH(p->device, s->wide ? p->k.sort64_count : p->k.sort_count, s->stage, *chunks,
                       (size_t)p->tune.sg, CLN_ARG(s->keys[0].mem), CLN_ARG(p->digit_counts.mem),
                       CLN_ARG(s->n), CLN_ARG(chunk), CLN_ARG(*chunks), CLN_ARG(digits),
                       CLN_ARG(d->shift[0]), CLN_ARG(d->mask[0]), CLN_ARG(d->shift[1]),
                       CLN_ARG(d->mask[1])));
    CLN_TRY(
        cln_stage_scan(p, &p->digit_counts, &p->digit_counts, digits * *chunks, s->stage, NULL));
done:
    return st;
}

static cln_status scatter(const sort *s, const digit *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = s->p;
    const cl_uint digits = 1u << d->bits, chunk = chunk_of(p, s->n, digits), lines = s->streams;
    const cl_uint chunks = (cl_uint)cln_groups(s->n, chunk);

    CLN_TRY(CLN_LAUNCH(
        p->device, s->wide ? p->k.sort64_scatter : p->k.sort_scatter, s->stage, chunks,
        (size_t)p->tune.sg, CLN_ARG(s->keys[0].mem), CLN_ARG(s->values[0].mem),
        CLN_ARG(p->digit_counts.mem), CLN_ARG(s->keys[1].mem), CLN_ARG(s->values[1].mem),
        CLN_ARG(s->n), CLN_ARG(chunk), CLN_ARG(chunks), CLN_ARG(digits), CLN_ARG(d->shift[0]),
        CLN_ARG(d->mask[0]), CLN_ARG(d->shift[1]), CLN_ARG(d->mask[1]), CLN_ARG(lines)));
    swap(s->keys);
    swap(s->values);
done:
    return st;
}

static cln_status passes_by(const sort *s, const digit *digits, int count)
{
    cln_status st = CLN_OK;
    cl_uint chunks = 0;

    for (int i = 0; i < count; i++) {
        CLN_TRY(find_places(s, &digits[i], &chunks));
        CLN_TRY(scatter(s, &digits[i]));
    }
done:
    return st;
}

/* The largest count of a digit, from find_places' table. Reads back. */
static cln_status most_of_a_digit(const sort *s, cl_uint digits, cl_uint chunks, cl_uint *most)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)digits * chunks + 1;
    cl_uint *places = NULL;

    *most = 0;
    CLN_TRY(cln_alloc(&places, count, sizeof *places, "sort counts"));
    CLN_TRY(cln_buffer_read(s->p->device, &s->p->digit_counts, 0, places, count * sizeof *places));
    for (cl_uint d = 0; d < digits; d++)
        *most = (cl_uint)larger(*most, places[(d + 1) * chunks] - places[d * chunks]);
done:
    free(places);
    return st;
}

/* Sorts by the highest digit first, then each bucket in cache. *sorted: false, with nothing done,
 * if the other compute units would wait for a large bucket. */
static cln_status by_buckets(const sort *s, uint64_t mask, bool *sorted)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = s->p;
    const int most = p->tune.db < p->line_bits ? p->tune.db : p->line_bits;
    const int high = 64 - __builtin_clzll(mask);
    digit top = {.bits = 1};
    cl_uint shifts[MAX_PASSES], chunks = 0, largest = 0, passes = 0, low_mask = 0;
    int width = 1;
    const size_t fair = s->n / (CLN_SORT_PARTS * larger(1, (size_t)p->device->info.compute_units));

    *sorted = false;
    while (top.bits < most && s->n >> top.bits > BUCKET)
        top.bits++;
    top.shift[0] = (cl_uint)(high - top.bits);
    top.mask[0] = (1u << top.bits) - 1;
    CLN_TRY(find_places(s, &top, &chunks));
    CLN_TRY(most_of_a_digit(s, 1u << top.bits, chunks, &largest));
    if (largest > larger(fair, BUCKET))
        return CLN_OK;
    CLN_TRY(scatter(s, &top));
    passes = plan_bucket(s->n >> top.bits, mask & ones(0, high - top.bits), high - top.bits,
                         p->tune.db, shifts, &width);
    low_mask = (1u << width) - 1;
    CLN_TRY(CLN_RESERVE(p, sums, passes));
    CLN_TRY(cln_buffer_write(p->device, &p->sums, 0, shifts, passes * sizeof *shifts));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.sort64_buckets, s->stage, passes ? (size_t)1 << top.bits : 0,
                       1, CLN_ARG(s->keys[0].mem), CLN_ARG(s->values[0].mem),
                       CLN_ARG(s->keys[1].mem), CLN_ARG(s->values[1].mem),
                       CLN_ARG(p->digit_counts.mem), CLN_ARG(p->sums.mem), CLN_ARG(chunks),
                       CLN_ARG(passes), CLN_ARG(low_mask)));
    if (passes % 2) {
        swap(s->keys);
        swap(s->values);
    }
    *sorted = true;
done:
    return st;
}

cln_status cln_stage_sort(cln_pipeline *p, cln_buffer *keys, cln_buffer *values, uint32_t n,
                          int bits, bool wide, cln_stage stage)
{
    cln_status st = CLN_OK;
    const sort s = {.p = p,
                    .keys = keys,
                    .values = values,
                    .n = n,
                    .wide = wide,
                    .streams = p->tune.sg == 1 && n >= STREAM,
                    .stage = stage};
    const int most = s.streams && p->tune.db > p->line_bits ? p->line_bits : p->tune.db;
    uint64_t mask = ones(0, bits), differ = mask;
    digit digits[MAX_PASSES];
    bool sorted = false;
    int passes = 0;

    if (n == 0)
        return CLN_OK;
    CLN_TRY(cln_buffer_reserve(p->device, &keys[1], n * (wide ? sizeof(cl_ulong) : sizeof(cl_uint)),
                               "sort keys"));
    CLN_TRY(cln_buffer_reserve(p->device, &values[1], n * sizeof(cl_uint), "sort values"));
    if (wide && n >= LOOK)
        CLN_TRY(varying(p, &keys[0], n, stage, &differ));
    passes = plan_passes(p, n, mask & differ, most, digits);
    if (wide && s.streams && passes > 2)
        CLN_TRY(by_buckets(&s, mask & differ, &sorted));
    if (!sorted)
        CLN_TRY(passes_by(&s, digits, passes));
done:
    return st;
}
