/* Compares the stable radix sort of (64-bit key, 32-bit value) pairs with other sorts on this
 * machine's cores: all on the same data, in one process, in turn, round after round. Not part of
 * the build or the tests; C++ because the peers are. Checks the results: keys must equal
 * std::stable_sort's, and so must the values of stable sorts; after other sorts every value must
 * still be with its key.
 *
 *   build/bench-sort [DEVICE [LOG2 [ROUNDS [TUNE [KERNEL_DIR]]]]]     "" or - = default
 *
 * LOG2: sizes 2^16, 2^20, ... up to 2^LOG2 pairs (24); 0 = only the small sorts of a training step.
 * Two kinds of keys: 64 random bits, and the program's keys, ray << 32 | bits of a float in [2, 6]
 * for 160,000 rays. The peers' pairs are structs of 16 bytes, ours two arrays. "device": from and
 * to device buffers; "with transfers": from and to host memory. Every method's scratch memory is
 * touched beforehand. Times are minima over all rounds. */
#include <parallel/algorithm>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#define _Static_assert static_assert /* the C headers' spelling */
extern "C" {
#include "base/clock.h"
#include "base/config.h"
#include "base/rng.h"
#include "pipeline/stages.h"
}

namespace
{

struct pair {
    uint64_t key;
    uint32_t value;
    bool operator<(const pair &other) const
    {
        return key < other.key;
    }
};

struct failed {
};

void must(cln_status st)
{
    if (st != CLN_OK)
        throw failed();
}

int by_key(const void *a, const void *b)
{
    const uint64_t x = static_cast<const pair *>(a)->key, y = static_cast<const pair *>(b)->key;

    return x < y ? -1 : x > y;
}

/* A plain LSD radix sort, 8 bits a pass, one thread per core, unoptimised. */
void plain_radix(std::vector<pair> &data, std::vector<pair> &spare)
{
    const size_t threads = std::max(1u, std::thread::hardware_concurrency()), n = data.size();
    std::vector<size_t> counts(threads * 256);
    const auto parallel = [&](const std::function<void(size_t, size_t, size_t)> &body) {
        std::vector<std::thread> team;

        for (size_t t = 0; t < threads; t++)
            team.emplace_back(body, t, n * t / threads, n * (t + 1) / threads);
        for (std::thread &thread : team)
            thread.join();
    };

    for (int shift = 0; shift < 64; shift += 8) {
        parallel([&](size_t t, size_t begin, size_t end) {
            size_t local[256] = {0};

            for (size_t i = begin; i < end; i++)
                local[data[i].key >> shift & 255]++;
            std::copy(local, local + 256, &counts[t * 256]);
        });
        for (size_t d = 0, sum = 0; d < 256; d++)
            for (size_t t = 0; t < threads; t++) {
                const size_t count = counts[t * 256 + d];

                counts[t * 256 + d] = sum;
                sum += count;
            }
        parallel([&](size_t t, size_t begin, size_t end) {
            size_t local[256];

            std::copy(&counts[t * 256], &counts[t * 256] + 256, local);
            for (size_t i = begin; i < end; i++)
                spare[local[data[i].key >> shift & 255]++] = data[i];
        });
        data.swap(spare);
    }
}

/* Our sort, through the stage that the program calls. */
class device_sort
{
  public:
    device_sort(cln_device *opened)
    {
        cln_config config;
        cln_pipeline_facts facts = {};

        device = opened;
        must(cln_config_preset("fast", &config));
        config.stage1 = CLN_STAGE1_SPLAT; /* only splatting builds the 64-bit sort */
        facts.space = &cln_space_unit;
        must(cln_pipeline_create(device, &config, &facts, CLN_PROGRAMS_ALL, &pipeline));
    }
    ~device_sort()
    {
        for (int b = 0; b < 2; b++) {
            cln_buffer_free(device, &keys[b]);
            cln_buffer_free(device, &values[b]);
        }
        cln_pipeline_free(&pipeline);
    }
    void upload(const void *k, const uint32_t *v, size_t n, size_t key_bytes)
    {
        must(cln_buffer_reserve(device, &keys[0], n * key_bytes, "keys"));
        must(cln_buffer_reserve(device, &values[0], n * sizeof *v, "values"));
        must(cln_buffer_write(device, &keys[0], 0, k, n * key_bytes));
        must(cln_buffer_write(device, &values[0], 0, v, n * sizeof *v));
    }
    void sort(size_t n, int bits, bool wide)
    {
        must(cln_stage_sort(&pipeline, keys, values, (uint32_t)n, bits, wide, CLN_STAGE_SORT));
        must(cln_device_finish(device));
    }
    void download(void *k, uint32_t *v, size_t n, size_t key_bytes)
    {
        must(cln_buffer_read(device, &keys[0], 0, k, n * key_bytes));
        must(cln_buffer_read(device, &values[0], 0, v, n * sizeof *v));
    }
    cln_pipeline pipeline{};

  private:
    cln_device *device;
    cln_buffer keys[2] = {}, values[2] = {};
};

uint64_t random64(size_t index)
{
    const uint32_t counter[4] = {(uint32_t)index, 1, 2, 3}, key[2] = {4, 5};
    uint32_t out[4];

    cln_philox(counter, key, out);
    return (uint64_t)out[0] << 32 | out[1];
}

std::vector<pair> make_data(size_t n, bool rays)
{
    std::vector<pair> data(n);

    for (size_t i = 0; i < n; i++) {
        const uint64_t random = random64(i);

        data[i].key = random;
        data[i].value = (uint32_t)i;
        if (rays) {
            const float t = 2 + 4 * (float)((uint32_t)random >> 8) * 0x1p-24f;
            uint32_t bits;

            memcpy(&bits, &t, sizeof bits);
            data[i].key = (uint64_t)cln_bounded((uint32_t)(random >> 32), 160000) << 32 | bits;
        }
    }
    return data;
}

struct method {
    const char *name;
    bool stable, comparison;
    std::function<double(std::vector<pair> &)> seconds; /* sorts; the last round's time */
    double least;
};

double clocked(const std::function<void()> &body)
{
    const double start = cln_now();

    body();
    return cln_now() - start;
}

void check(const method &m, const std::vector<pair> &got, const std::vector<pair> &want,
           const std::vector<pair> &data)
{
    for (size_t i = 0; i < got.size(); i++) {
        if (got[i].key != want[i].key || (m.stable && got[i].value != want[i].value) ||
            data[got[i].value].key != got[i].key) {
            fprintf(stderr, "bench-sort: %s: place %zu of %zu is wrong\n", m.name, i, got.size());
            exit(1);
        }
    }
}

void compare(device_sort &ours, size_t n, bool rays, int rounds)
{
    const std::vector<pair> data = make_data(n, rays);
    std::vector<pair> want = data, work(n), spare(n);
    std::vector<uint64_t> keys(n), got_keys(n);
    std::vector<uint32_t> values(n), got_values(n);
    const int bits = rays ? 32 + 18 : 64; /* bits that splat.c sorts for 160,000 rays */
    const auto host = [](void (*sort)(std::vector<pair> &)) {
        return [sort](std::vector<pair> &v) { return clocked([&] { sort(v); }); };
    };
    const auto put_back = [&](std::vector<pair> &v) {
        for (size_t i = 0; i < n; i++)
            v[i] = {got_keys[i], got_values[i]};
    };
    std::vector<method> methods = {
        {"qsort", false, true,
         host([](std::vector<pair> &v) { qsort(v.data(), v.size(), sizeof v[0], by_key); }), 0},
        {"std::sort", false, true,
         host([](std::vector<pair> &v) { std::sort(v.begin(), v.end()); }), 0},
        {"std::stable_sort", true, true,
         host([](std::vector<pair> &v) { std::stable_sort(v.begin(), v.end()); }), 0},
        {"gcc parallel sort", false, true,
         host([](std::vector<pair> &v) { __gnu_parallel::sort(v.begin(), v.end()); }), 0},
        {"gcc parallel stable_sort", true, true,
         host([](std::vector<pair> &v) { __gnu_parallel::stable_sort(v.begin(), v.end()); }), 0},
        {"plain radix, threads", true, false,
         [&](std::vector<pair> &v) { return clocked([&] { plain_radix(v, spare); }); }, 0},
        {"ours, device", true, false,
         [&](std::vector<pair> &v) {
             ours.upload(keys.data(), values.data(), n, sizeof keys[0]);
             const double time = clocked([&] { ours.sort(n, bits, true); });
             ours.download(got_keys.data(), got_values.data(), n, sizeof keys[0]);
             put_back(v);
             return time;
         },
         0},
        {"ours, with transfers", true, false,
         [&](std::vector<pair> &v) {
             const double time = clocked([&] {
                 ours.upload(keys.data(), values.data(), n, sizeof keys[0]);
                 ours.sort(n, bits, true);
                 ours.download(got_keys.data(), got_values.data(), n, sizeof keys[0]);
             });
             put_back(v);
             return time;
         },
         0},
    };
    double best = 0, standard = 0;

    for (size_t i = 0; i < n; i++) {
        keys[i] = data[i].key;
        values[i] = data[i].value;
    }
    std::stable_sort(want.begin(), want.end());
    ours.upload(keys.data(), values.data(), n, sizeof keys[0]); /* touches its buffers */
    ours.sort(n, bits, true);
    for (int r = 0; r < rounds; r++)
        for (method &m : methods) {
            work = data;
            const double time = m.seconds(work);
            m.least = r == 0 ? time : std::min(m.least, time);
            check(m, work, want, data);
        }
    for (const method &m : methods) {
        if (m.comparison && (best == 0 || m.least < best))
            best = m.least;
        if (std::string(m.name) == "std::sort")
            standard = m.least;
    }
    printf("%zu pairs, %s\n", n, rays ? "ray << 32 | float" : "64 random bits");
    for (const method &m : methods)
        printf("  %-26s %8.2f ns/pair  %5.2f x std::sort  %5.2f x best comparison sort\n", m.name,
               1e9 * m.least / (double)n, standard / m.least, best / m.least);
    fflush(stdout);
}

/* The group stage's sorts: 32-bit keys of a few bits, samples by leaf. */
void small(device_sort &ours, size_t n, int bits, int rounds)
{
    std::vector<uint32_t> keys(n), values(n), got_keys(n), got_values(n);
    double least = 0;

    for (size_t i = 0; i < n; i++) {
        keys[i] = (uint32_t)random64(i) >> (32 - bits);
        values[i] = (uint32_t)i;
    }
    for (int r = 0; r < 20 * rounds; r++) {
        ours.upload(keys.data(), values.data(), n, sizeof keys[0]);
        const double time = clocked([&] { ours.sort(n, bits, false); });
        least = r == 0 ? time : std::min(least, time);
    }
    ours.download(got_keys.data(), got_values.data(), n, sizeof keys[0]);
    for (size_t i = 0; i < n; i++)
        if (got_keys[i] != keys[got_values[i]] ||
            (i && (got_keys[i - 1] > got_keys[i] ||
                   (got_keys[i - 1] == got_keys[i] && got_values[i - 1] >= got_values[i])))) {
            fprintf(stderr, "bench-sort: %zu keys of %d bits: place %zu is wrong\n", n, bits, i);
            exit(1);
        }
    printf("%6zu keys of %2d bits: %8.1f us  %6.2f ns/pair\n", n, bits, 1e6 * least,
           1e9 * least / (double)n);
    fflush(stdout);
}

} // namespace

static const char *argument(int argc, char **argv, int i)
{
    return argc > i && argv[i][0] && strcmp(argv[i], "-") != 0 ? argv[i] : nullptr;
}

int main(int argc, char **argv)
{
    const int largest = argument(argc, argv, 2) ? atoi(argv[2]) : 24;
    const int rounds = argument(argc, argv, 3) ? atoi(argv[3]) : 3;
    cln_device_desc desc = {};
    cln_device *device = nullptr;
    int code = 0;

    desc.spec = argument(argc, argv, 1);
    desc.tune = argument(argc, argv, 4);
    desc.kernel_dir = argument(argc, argv, 5);
    try {
        must(cln_device_open(&desc, &device));
        device_sort ours(device);
        char tune[256];

        cln_tune_text(&ours.pipeline.tune, tune);
        printf("%s, %u threads, %s\n", device->info.name, std::thread::hardware_concurrency(),
               tune);
        for (size_t n : {5000, 20000, 60000})
            for (int bits : {6, 9, 12})
                small(ours, n, bits, rounds);
        for (int log2 = 16; log2 <= largest; log2 += 4)
            for (bool rays : {false, true})
                compare(ours, (size_t)1 << log2, rays, rounds);
    } catch (const failed &) {
        fprintf(stderr, "bench-sort: %s\n", cln_error_text());
        code = 1;
    }
    cln_device_close(device);
    return code;
}
