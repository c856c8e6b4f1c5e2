/* The rest of base/: random numbers against Random123's published known answers, the error record,
 * checked allocation, files (whole reads, atomic writes that keep the old file, folders, digests)
 * and the log. Oracle: published or literal values. */
#include "unit.h"
#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include "base/clock.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/rng.h"
#include "base/text.h"
#include "scratch.h"
#include "tests.h"

/* ---- random numbers ---- */

/* Random123-1.14, tests/kat_vectors, lines "philox4x32 10". */
static void test_philox_known_answers(void **state)
{
    static const struct {
        uint32_t counter[4], key[2], out[4];
    } known[] = {
        {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
        {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
         {0xffffffff, 0xffffffff},
         {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
        {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
         {0xa4093822, 0x299f31d0},
         {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
    };

    (void)state;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        uint32_t out[4] = {0};

        cln_philox(known[i].counter, known[i].key, out);
        for (int k = 0; k < 4; k++)
            assert_int_equal(out[k], known[i].out[k]);
    }
}

/* In [0,1), a pure function of all its arguments, and flat: 65,536 numbers in 16 bins of 4,096;
 * chi-square with 15 degrees of freedom exceeds 44.3 by chance once in 10,000. */
static void test_uniform(void **state)
{
    enum { N = 16384, BINS = 16 };
    int bin[BINS] = {0};
    double sum = 0, chi = 0;
    float a[4], b[4];

    (void)state;
    for (uint32_t i = 0; i < N; i++) {
        cln_uniform4(42, CLN_STREAM_PIXELS, 7, i, 3, a);
        for (int k = 0; k < 4; k++) {
            assert_true(a[k] >= 0 && a[k] < 1);
            bin[(int)(a[k] * BINS)]++;
            sum += a[k];
        }
    }
    for (int i = 0; i < BINS; i++)
        chi += (bin[i] - 4.0 * N / BINS) * (bin[i] - 4.0 * N / BINS) / (4.0 * N / BINS);
    assert_true(chi < 44.3);
    assert_true(sum / (4 * N) > 0.49 && sum / (4 * N) < 0.51);

    cln_uniform4(1, 2, 3, 4, 5, a);
    cln_uniform4(1, 2, 3, 4, 5, b);
    assert_memory_equal(a, b, sizeof a);
    cln_uniform4(1 + (1ull << 32), 2, 3, 4, 5, b);
    assert_memory_not_equal(a, b, sizeof a);
    cln_uniform4(1, 6, 3, 4, 5, b);
    assert_memory_not_equal(a, b, sizeof a);
    cln_uniform4(1, 2, 6, 4, 5, b);
    assert_memory_not_equal(a, b, sizeof a);
    cln_uniform4(1, 2, 3, 6, 5, b);
    assert_memory_not_equal(a, b, sizeof a);
    cln_uniform4(1, 2, 3, 4, 6, b);
    assert_memory_not_equal(a, b, sizeof a);
}

/* Numbers by hash are uniform, and neighbours in any of the five arguments are uncorrelated (the
 * correlation of 100,000 pairs stays within five standard deviations). */
static void test_uniform_hash(void **state)
{
    enum { N = 100000 };
    double sum = 0, squares = 0, products[5] = {0};

    (void)state;
    for (uint32_t i = 0; i < N; i++) {
        const uint32_t seed = i % 3, step = i % 7, index = i, number = i % 11, draw = i % 13;
        const double a = (double)cln_uniform_hash(seed, 4, step, index, number, draw) - 0.5;
        const float next[5] = {
            cln_uniform_hash(seed + 3, 4, step, index, number, draw),
            cln_uniform_hash(seed, 4, step + 7, index, number, draw),
            cln_uniform_hash(seed, 4, step, index + 1, number, draw),
            cln_uniform_hash(seed, 4, step, index, number + 11, draw),
            cln_uniform_hash(seed, 4, step, index, number, draw + 13),
        };

        assert_true(a >= -0.5 && a < 0.5);
        sum += a;
        squares += a * a;
        for (int k = 0; k < 5; k++)
            products[k] += a * ((double)next[k] - 0.5);
    }
    assert_true(fabs(sum / N) < 5 * sqrt(1.0 / 12 / N));
    assert_true(fabs(squares / N - 1.0 / 12) < 5 * sqrt(1.0 / 180 / N));
    for (int k = 0; k < 5; k++)
        assert_true(fabs(products[k] / N) < 5 * sqrt(1.0 / 144 / N));
}

/* The documented packing of the counter: index, stream << 24 | draw, step, 0; 24 high bits. */
static void test_uniform_packing(void **state)
{
    const uint32_t counter[4] = {11, 3u << 24 | 5, 9, 0}, key[2] = {0x89abcdef, 0x01234567};
    uint32_t bits[4];
    float out[4];

    (void)state;
    cln_philox(counter, key, bits);
    cln_uniform4(0x0123456789abcdefull, 3, 9, 11, 5, out);
    for (int k = 0; k < 4; k++)
        assert_true(out[k] == (float)(bits[k] >> 8) / 16777216.0f);
}

static void test_bounded(void **state)
{
    (void)state;
    assert_int_equal(cln_bounded(0, 10), 0);
    assert_int_equal(cln_bounded(UINT32_MAX, 10), 9);
    assert_int_equal(cln_bounded(UINT32_MAX, 1), 0);
    assert_int_equal(cln_bounded(0x80000000u, 10), 5);
    assert_int_equal(cln_bounded(UINT32_MAX, UINT32_MAX), UINT32_MAX - 1);
}

/* ---- status ---- */

static void test_first_failure_wins(void **state)
{
    (void)state;
    cln_clear_error();
    assert_string_equal(cln_error_text(), "");
    assert_int_equal(cln_error_status(), CLN_OK);
    cln_note("nothing stands yet");
    assert_string_equal(cln_error_text(), "");

    assert_int_equal(cln_fail(CLN_INPUT, "%s: %d", "file", 3), CLN_INPUT);
    assert_int_equal(cln_fail(CLN_OUTPUT, "cleanup failed too"), CLN_OUTPUT);
    assert_string_equal(cln_error_text(), "file: 3");
    assert_int_equal(cln_error_status(), CLN_INPUT);
    cln_note("loading %s", "scene");
    cln_note("training");
    assert_string_equal(cln_error_text(), "file: 3; while loading scene; while training");

    cln_clear_error();
    assert_int_equal(cln_fail(CLN_MEMORY, "again"), CLN_MEMORY);
    assert_string_equal(cln_error_text(), "again");
    cln_clear_error();
}

/* A sentence longer than the record is truncated. */
static void test_long_sentence(void **state)
{
    char *text = malloc(20000);

    (void)state;
    assert_non_null(text);
    memset(text, 'y', 19999);
    text[19999] = 0;
    cln_fail(CLN_FAILED, "x%s", text);
    assert_true(strlen(cln_error_text()) > 1000 && strlen(cln_error_text()) < 19999);
    assert_memory_equal(cln_error_text(), "xyyy", 4);
    for (int i = 0; i < 1000; i++)
        cln_note("%s", text);
    assert_true(strlen(cln_error_text()) < 19999);
    cln_clear_error();
    free(text);
}

static void *other_thread(void *user)
{
    *(bool *)user = cln_error_status() == CLN_OK && cln_error_text()[0] == 0;
    cln_fail(CLN_OUTPUT, "the other thread's");
    return NULL;
}

static void test_record_per_thread(void **state)
{
    pthread_t thread;
    bool clean = false;

    (void)state;
    cln_fail(CLN_INPUT, "mine");
    assert_int_equal(pthread_create(&thread, NULL, other_thread, &clean), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_true(clean);
    assert_string_equal(cln_error_text(), "mine");
    cln_clear_error();
}

/* The exit codes that the manual promises. */
static void test_exit_codes(void **state)
{
    static const struct {
        cln_status st;
        int code;
    } promised[] = {{CLN_OK, 0},        {CLN_FAILED, 1},    {CLN_INTERNAL, 1}, {CLN_USAGE, 2},
                    {CLN_INPUT, 3},     {CLN_NO_DEVICE, 4}, {CLN_CL, 4},       {CLN_BUILD, 4},
                    {CLN_MEMORY, 5},    {CLN_DIVERGED, 6},  {CLN_OUTPUT, 7},   {CLN_CHECKPOINT, 8},
                    {CLN_THRESHOLD, 9}, {CLN_CHECK, 10},    {CLN_SIGINT, 130}, {CLN_SIGTERM, 143}};

    (void)state;
    for (size_t i = 0; i < sizeof promised / sizeof promised[0]; i++) {
        assert_int_equal(cln_status_exit_code(promised[i].st), promised[i].code);
        assert_true(strlen(cln_status_phrase(promised[i].st)) > 1);
    }
    for (int i = 0; i < 3; i++) { /* of a newer or a broken library */
        static const int unknown[] = {CLN_SIGTERM + 1, 999, -1};

        assert_int_equal(cln_status_exit_code((cln_status)unknown[i]), 1);
        assert_string_equal(cln_status_phrase((cln_status)unknown[i]), "unknown status");
    }
}

static cln_status try_it(cln_status result, int *after)
{
    cln_status st = CLN_OK;

    *after = 0;
    CLN_TRY(result);
    *after = 1;
done:
    return st;
}

static void test_try(void **state)
{
    int after = 0;

    (void)state;
    assert_int_equal(try_it(CLN_OK, &after), CLN_OK);
    assert_int_equal(after, 1);
    assert_int_equal(try_it(CLN_CL, &after), CLN_CL);
    assert_int_equal(after, 0);
}

/* ---- memory ---- */

/* NULL is correct on systems without such pages. */
/* It moves at powers of two alone, with what it holds. */
static void test_grow(void **state)
{
    int *list = NULL, moves = 0;

    (void)state;
    for (int i = 0; i < 100; i++) {
        const int *before = list;

        assert_int_equal(cln_grow(&list, i, sizeof *list, "numbers"), CLN_OK);
        moves += list != before;
        list[i] = 7 * i;
    }
    for (int i = 0; i < 100; i++)
        assert_int_equal(list[i], 7 * i);
    assert_in_range(moves, 1, 8);
    free(list);
}

static void test_huge_pages(void **state)
{
    const size_t page = 2 << 20;
    unsigned char *p = cln_huge_pages(page + 1);

    (void)state;
    assert_null(cln_huge_pages(page - 1));
    if (!p)
        skip();
    assert_int_equal((uintptr_t)p % page, 0);
    memset(p, 1, page + 1);
    free(p);
}

static void test_alloc(void **state)
{
    unsigned char *p = NULL;
    char *text = NULL;

    (void)state;
    assert_int_equal(cln_alloc(&p, 1000, 4, "numbers"), CLN_OK);
    for (int i = 0; i < 4000; i++)
        assert_int_equal(p[i], 0);
    free(p);
    assert_int_equal(cln_alloc(&p, 0, 4, "nothing"), CLN_OK);
    assert_non_null(p);
    free(p);
    assert_int_equal(cln_alloc(&p, (5 << 20) + 3, 1, "huge pages' worth"), CLN_OK);
    for (int i = 0; i < (5 << 20) + 3; i++)
        if (p[i])
            fail_msg("byte %d is %d", i, p[i]);
    free(p);
    p = (unsigned char *)&text;
    assert_int_equal(cln_alloc(&p, SIZE_MAX / 2, 3, "rays of a batch"), CLN_MEMORY);
    assert_null(p);
    assert_non_null(strstr(cln_error_text(), "rays of a batch"));
    assert_int_equal(cln_error_status(), CLN_MEMORY);
    cln_clear_error();
    /* The product wraps round to 8 bytes. */
    assert_int_equal(cln_alloc(&p, SIZE_MAX / 8 + 2, 8, "wrap"), CLN_MEMORY);
    assert_null(p);
    cln_clear_error();

    assert_int_equal(cln_strdup(&text, "abc"), CLN_OK);
    assert_string_equal(text, "abc");
    free(text);
    assert_int_equal(cln_strdup(&text, NULL), CLN_OK);
    assert_null(text);
    assert_int_equal(cln_asprintf(&text, "%05d|%s", 42, "x"), CLN_OK);
    assert_string_equal(text, "00042|x");
    free(text);
}

/* ---- files ---- */

static char *in_folder(const char *folder, const char *name)
{
    char *path = NULL;

    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    return path;
}

static int entries(const char *folder)
{
    DIR *dir = opendir(folder);
    int count = 0;

    assert_non_null(dir);
    for (struct dirent *e = readdir(dir); e; e = readdir(dir))
        count += strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    closedir(dir);
    return count;
}

static void assert_content(const char *path, const char *content)
{
    char *text = NULL;
    size_t bytes = 0;

    assert_int_equal(cln_read_file(path, 1 << 20, &text, &bytes), CLN_OK);
    assert_int_equal(bytes, strlen(content));
    assert_string_equal(text, content); /* also tests the zero byte after it */
    free(text);
}

static void assert_failed(cln_status got, cln_status st, const char *word)
{
    assert_int_equal(got, st);
    if (!strstr(cln_error_text(), word))
        fail_msg("'%s' is not in '%s'", word, cln_error_text());
    cln_clear_error();
}

static void test_read_write(void **state)
{
    char *path = in_folder(*state, "a.txt"), *missing = in_folder(*state, "missing.txt"),
         *text = NULL;
    size_t bytes = 0;

    assert_int_equal(cln_write_file(path, "one", 3), CLN_OK);
    assert_content(path, "one");
    assert_int_equal(cln_write_file(path, "three", 5), CLN_OK);
    assert_content(path, "three");
    assert_int_equal(cln_write_file(path, "", 0), CLN_OK);
    assert_content(path, "");
    assert_int_equal(entries(*state), 1); /* no temp file left */
    assert_true(cln_is_file(path) && !cln_is_dir(path));
    assert_true(cln_is_dir(*state) && !cln_is_file(*state));
    assert_false(cln_is_file(missing) || cln_is_dir(missing));
    assert_true(cln_has_file(*state, "a.txt") && !cln_has_dir(*state, "a.txt"));
    assert_true(cln_has_dir(*state, ".") && !cln_has_file(*state, "."));
    assert_false(cln_has_file(*state, "missing.txt") || cln_has_dir(*state, "missing.txt"));

    assert_failed(cln_read_file(missing, 100, &text, &bytes), CLN_INPUT, "missing.txt");
    assert_int_equal(cln_write_file(path, "0123456789", 10), CLN_OK);
    assert_failed(cln_read_file(path, 9, &text, &bytes), CLN_INPUT, "a.txt");
    assert_int_equal(cln_read_file(path, 10, &text, &bytes), CLN_OK);
    free(text);
    assert_failed(cln_read_file(*state, 100, &text, &bytes), CLN_INPUT, (const char *)*state);
    free(path);
    free(missing);
}

/* An abandoned or failed atomic write leaves only the old file. */
static void test_atomic(void **state)
{
    char *path = in_folder(*state, "model.bin"), *nowhere = in_folder(*state, "no/such/file");
    cln_atomic_file *file = NULL;

    assert_int_equal(cln_write_file(path, "old", 3), CLN_OK);
    assert_int_equal(cln_atomic_open(path, &file), CLN_OK);
    assert_int_equal(cln_atomic_write(file, "new and longer", 14), CLN_OK);
    assert_int_equal(fflush(cln_atomic_stream(file)), 0);
    assert_content(path, "old"); /* not before the commit */
    cln_atomic_abandon(file);
    assert_content(path, "old");
    assert_int_equal(entries(*state), 1);

    assert_int_equal(cln_atomic_open(path, &file), CLN_OK);
    assert_int_equal(cln_atomic_write(file, "new", 3), CLN_OK);
    assert_true(fprintf(cln_atomic_stream(file), "er") > 0);
    assert_int_equal(cln_atomic_commit(&file), CLN_OK);
    assert_content(path, "newer");
    assert_int_equal(entries(*state), 1);

    assert_failed(cln_write_file(nowhere, "x", 1), CLN_OUTPUT, "no/such/file");
    cln_atomic_abandon(NULL);
    free(path);
    free(nowhere);
}

/* Files that belong together: if one cannot be written, none is replaced. */
static void test_atomic_together(void **state)
{
    char *path[2] = {in_folder(*state, "a.npy"), in_folder(*state, "a.json")};
    cln_atomic_file *file[2] = {NULL};
    cln_atomic_file **const both[2] = {&file[0], &file[1]};

    for (int broken = 0; broken < 3; broken++) {
        for (int i = 0; i < 2; i++) {
            assert_int_equal(cln_write_file(path[i], "old", 3), CLN_OK);
            assert_int_equal(cln_atomic_open(path[i], &file[i]), CLN_OK);
            assert_int_equal(cln_atomic_write(file[i], "new", 3), CLN_OK);
        }
        if (broken < 2) {
            assert_int_equal(close(fileno(cln_atomic_stream(file[broken]))), 0);
            assert_failed(cln_atomic_commit_all(both, 2), CLN_OUTPUT, path[broken]);
        } else {
            assert_int_equal(cln_atomic_commit_all(both, 2), CLN_OK);
        }
        for (int i = 0; i < 2; i++) {
            assert_null(file[i]);
            assert_content(path[i], broken < 2 ? "old" : "new");
        }
        assert_int_equal(entries(*state), 2);
    }
    free(path[0]);
    free(path[1]);
}

/* fsync of this program: what was synced while it is watched, and the file that then had the
 * watched path. */
static struct {
    const char *path;
    int count;
    struct {
        struct stat what, at_path;
    } calls[4];
} watched;

int fsync(int fd)
{
    const int i = watched.count;

    if (watched.path && i < 4 && fstat(fd, &watched.calls[i].what) == 0 &&
        stat(watched.path, &watched.calls[i].at_path) == 0)
        watched.count++;
    return (int)syscall(SYS_fsync, fd);
}

/* What is committed survives a power cut: the file is synced before it replaces the old one, then
 * the folder, with its new name in it. */
static void test_synced(void **state)
{
    char *path = in_folder(*state, "model.bin");
    struct stat old, new, folder;

    assert_int_equal(cln_write_file(path, "old", 3), CLN_OK);
    assert_int_equal(stat(path, &old), 0);
    watched.path = path;
    assert_int_equal(cln_write_file(path, "new", 3), CLN_OK);
    watched.path = NULL;
    assert_int_equal(stat(path, &new), 0);
    assert_int_equal(stat(*state, &folder), 0);
    assert_int_equal(watched.count, 2);
    assert_int_equal(watched.calls[0].what.st_ino, new.st_ino);
    assert_int_equal(watched.calls[0].at_path.st_ino, old.st_ino);
    assert_int_equal(watched.calls[1].what.st_ino, folder.st_ino);
    assert_int_equal(watched.calls[1].at_path.st_ino, new.st_ino);
    free(path);
}

/* /dev/full simulates a full disk: the temp file's stream is redirected there, so the flush
 * fails. */
static void test_disk_full(void **state)
{
    char *path = in_folder(*state, "model.bin");
    cln_atomic_file *file = NULL;
    cln_status st = CLN_OK;
    char *block = calloc(1, 1 << 16);
    int full = open("/dev/full", O_WRONLY);

    assert_non_null(block);
    if (full < 0) {
        free(block);
        free(path);
        skip();
    }
    assert_int_equal(cln_write_file(path, "old", 3), CLN_OK);
    assert_int_equal(cln_atomic_open(path, &file), CLN_OK);
    assert_true(dup2(full, fileno(cln_atomic_stream(file))) >= 0);
    close(full);
    st = cln_atomic_write(file, block, 1 << 16);
    if (st == CLN_OK) {
        st = cln_atomic_commit(&file);
        assert_null(file);
    }
    cln_atomic_abandon(file);
    assert_failed(st, CLN_OUTPUT, "model.bin");
    assert_content(path, "old");
    assert_int_equal(entries(*state), 1);
    free(block);
    free(path);
}

static void test_folders(void **state)
{
    static const struct {
        const char *from, *to, *path;
    } relative[] = {{"/a/b", "/a/b/c/d", "c/d"},
                    {"/a/b/c", "/a/d", "../../d"},
                    {"/a/b/c", "/a/b", "../"},
                    {"/a/b", "/a/bc", "../bc"},
                    {"/a/b", "/a/b", "."}};
    char *deep = in_folder(*state, "a/b/c"), *file = in_folder(*state, "f");
    char *under_file = in_folder(*state, "f/g"), *joined = NULL;

    assert_int_equal(cln_make_dirs(deep), CLN_OK);
    assert_true(cln_is_dir(deep));
    assert_int_equal(cln_make_dirs(deep), CLN_OK);
    assert_int_equal(cln_write_file(file, "x", 1), CLN_OK);
    assert_failed(cln_make_dirs(under_file), CLN_OUTPUT, "f");
    assert_int_equal(cln_path_join(&joined, "dir", "name"), CLN_OK);
    assert_string_equal(joined, "dir/name");
    free(joined);
    assert_int_equal(cln_path_join(&joined, "", "name"), CLN_OK);
    assert_string_equal(joined, "name");
    free(joined);
    assert_int_equal(cln_path_join(&joined, "dir", "/abs"), CLN_OK);
    assert_string_equal(joined, "/abs");
    free(joined);
    for (size_t i = 0; i < sizeof relative / sizeof *relative; i++) {
        assert_int_equal(cln_path_relative(&joined, relative[i].from, relative[i].to), CLN_OK);
        assert_string_equal(joined, relative[i].path);
        free(joined);
    }
    free(deep);
    free(file);
    free(under_file);
}

static void test_natural_compare(void **state)
{
    static const char *const ordered[] = {"",       "9",       "10",     "a",     "a/r_2",
                                          "a/r_10", "a/r_10b", "a/r_11", "b0001", "b1",
                                          "b2",     "b002x",   "c"};
    const int count = sizeof ordered / sizeof *ordered;

    (void)state;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            const int order = cln_natural_compare(ordered[i], ordered[j]);

            if ((order > 0) - (order < 0) != (i > j) - (i < j))
                fail_msg("'%s' and '%s': %d", ordered[i], ordered[j], order);
        }
}

static void test_ends(void **state)
{
    (void)state;
    assert_true(cln_ends_with("plan.total", "total") && cln_ends_with("total", "total"));
    assert_true(cln_ends_with("x", "") && cln_ends_with("", ""));
    assert_false(cln_ends_with("otal", "total") || cln_ends_with("total.", "total"));
}

/* The digest depends on every bit and the length, not on the data's address or the pieces that they
 * come in. */
static void test_digest(void **state)
{
    unsigned char data[48] = {0}, shifted[49] = {0};
    cln_digest_part part;
    uint64_t base = 0;
    char text[CLN_DIGEST_TEXT];

    (void)state;
    cln_digest_text(0xA0F, text);
    assert_string_equal(text, "0000000000000a0f");
    for (int i = 0; i < 40; i++)
        data[i] = (unsigned char)(i * 37 + 1);
    memcpy(shifted + 1, data, sizeof data);
    for (size_t n = 0; n <= 40; n++) {
        base = cln_digest(CLN_DIGEST_START, data, n);
        assert_true(base == cln_digest(CLN_DIGEST_START, shifted + 1, n));
        assert_true(base != cln_digest(CLN_DIGEST_START, data, n + 1));
        for (size_t bit = 0; bit < 8 * n; bit++) {
            data[bit / 8] ^= (unsigned char)(1u << bit % 8);
            assert_true(base != cln_digest(CLN_DIGEST_START, data, n));
            data[bit / 8] ^= (unsigned char)(1u << bit % 8);
        }
        for (size_t cut = 0; cut <= n; cut++)
            for (size_t next = cut; next <= n; next++) {
                cln_digest_begin(&part, CLN_DIGEST_START);
                cln_digest_more(&part, data, cut);
                cln_digest_more(&part, data + cut, next - cut);
                cln_digest_more(&part, data + next, n - next);
                assert_true(base == cln_digest_end(&part));
            }
    }
    assert_true(cln_digest(CLN_DIGEST_START, "ab", 2) !=
                cln_digest(cln_digest(CLN_DIGEST_START, "a", 1), "b", 1));
    /* checkpoints hold digests, so these stay what they are */
    assert_true(cln_digest(CLN_DIGEST_START, "", 0) == 0xdb01c3104e99566d);
    assert_true(cln_digest(CLN_DIGEST_START, "abc", 3) == 0x92119cfaa0bb31a0);
    assert_true(cln_digest(CLN_DIGEST_START, "The digest of a checkpoint", 26) ==
                0x8016fec6b0965c8d);
}

/* ---- log ---- */

static void collect(cln_log_level level, const char *line, void *user)
{
    char *text = user;
    size_t used = strlen(text);

    snprintf(text + used, 256 - used, "%d:%s\n", (int)level, line);
}

static void test_log(void **state)
{
    char text[256] = "";

    (void)state;
    cln_log_set_sink(collect, text);
    cln_warn("disk at %d %%", 90);
    cln_info("hello");
    cln_debug("dropped");
    cln_log_set_level(CLN_LOG_WARN);
    cln_info("dropped too");
    cln_log_set_level(CLN_LOG_DEBUG);
    cln_debug("seen");
    cln_log_set_level(CLN_LOG_INFO);
    cln_log_set_sink(NULL, NULL);
    assert_string_equal(text, "1:warning: disk at 90 %\n2:hello\n3:seen\n");
}

/* The limits of RFC 3629: shortest forms only, no surrogates, nothing beyond U+10FFFF. */
static void test_utf8(void **state)
{
    static const struct {
        const char *text;
        int bytes;
    } cases[] = {
        {"", 1},
        {"a", 1},
        {"\x7f", 1},
        {"\xc2\x80", 2},
        {"\xdf\xbf", 2},
        {"\xe0\xa0\x80", 3},
        {"\xed\x9f\xbf", 3},
        {"\xef\xbf\xbf", 3},
        {"\xf0\x90\x80\x80", 4},
        {"\xf4\x8f\xbf\xbf", 4},
        {"\x80", 0},
        {"\xc1\xbf", 0},
        {"\xc3", 0},
        {"\xc3(", 0},
        {"\xe0\x9f\xbf", 0},
        {"\xed\xa0\x80", 0},
        {"\xf0\x8f\xbf\xbf", 0},
        {"\xf4\x90\x80\x80", 0},
        {"\xf8\x88\x80\x80", 0},
        {"\xff", 0},
        {"\xe2\x82", 0},
    };
    char name[] = "Xeon\xae \xc3\xbc \xe2\x82";

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(cln_utf8_bytes(cases[i].text), cases[i].bytes);
    assert_true(cln_utf8_valid("") && cln_utf8_valid("\xc3\xbc\xe2\x82\xac"));
    assert_false(cln_utf8_valid("a\xfc"));
    assert_int_equal(cln_utf8_whole("a\xc3\xbc", 2), 1);
    assert_int_equal(cln_utf8_whole("a\xc3\xbc", 3), 3);
    assert_int_equal(cln_utf8_whole("a\xc3\xbc", 9), 3);
    assert_int_equal(cln_utf8_whole("\xe2\x82\xac", 2), 0);
    assert_int_equal(cln_utf8_whole("a\xf0\x9f\x98\x80", 4), 1);
    assert_int_equal(cln_utf8_whole("a\x80\x80\x80\x80", 4), 4); /* no character at all */
    assert_int_equal(cln_utf8_whole("", 4), 0);
    cln_utf8_repair(name);
    assert_string_equal(name, "Xeon? \xc3\xbc ??");
}

static void test_shell_quote(void **state)
{
    static const struct {
        const char *text, *word;
    } cases[] = {
        {"runs/lego-1.2,a=b+c@d:e%", "runs/lego-1.2,a=b+c@d:e%"},
        {"", "''"},
        {"a b", "'a b'"},
        {"it's", "'it'\\''s'"},
        {"~", "'~'"},
        {"a\nb\\c\"$`*", "'a\nb\\c\"$`*'"},
        {"\xc3\xbc", "\xc3\xbc"},
    };
    char word[128];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(cln_shell_quote(cases[i].text, word, sizeof word), cases[i].word);
    assert_string_equal(cln_shell_quote("a b", word, 14), "..."); /* 15 are surely enough */
    assert_string_equal(cln_shell_quote("a b", word, 15), "'a b'");
}

/* So many that a thousandth of the least length shows in the largest value. */
static void test_digits(void **state)
{
    static const struct {
        double values[2], least;
        int digits;
    } cases[] = {{{-1.5, 1.5}, 3, 4},       {{2, 1}, 1, 4},       {{500000, 4600000}, 1, 10},
                 {{4600000, -1}, 0.01, 12}, {{1e-4, 0}, 1e-4, 4}, {{1e12, 0}, 1e-9, 17},
                 {{0, 0}, INFINITY, 4},     {{1e6, 0}, 1e6, 4}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_int_equal(cln_reals_digits(2, cases[i].values, cases[i].least), cases[i].digits);
}

/* Seconds in /proc/stat, of all kinds but idle ones and those of waiting for a disk; 0: unknown. */
static double worked_so_far(void)
{
    double ticks[8] = {0}, sum = 0;
    FILE *f = fopen("/proc/stat", "r");
    char line[256] = "", *at = line + 3;

    if (f && fgets(line, sizeof line, f))
        for (int i = 0; i < 8; i++)
            ticks[i] = strtod(at, &at);
    if (f)
        fclose(f);
    for (int i = 0; i < 8; i++)
        sum += i == 3 || i == 4 ? 0 : ticks[i];
    return sum / (double)sysconf(_SC_CLK_TCK);
}

/* What other programs work is what the machine does and this process does not. */
static void test_load(void **state)
{
    const cln_load none = {0}, begin = {10, 20, 1}, end = {13, 24, 2};
    const double least = worked_so_far();
    const cln_load before = cln_load_now();
    const double most = worked_so_far();
    cln_load after;
    volatile double sum = 0;

    (void)state;
    assert_true(cln_load_of_others(&begin, &end) == 0.5);
    assert_true(cln_load_of_others(&begin, &(cln_load){13, 24, 9}) == 0);
    assert_true(isnan(cln_load_of_others(&none, &none)));
    assert_true(isnan(cln_load_of_others(&begin, &begin)));
    assert_true(before.worked >= least - 1e-6 && before.worked <= most + 1e-6);
    for (double until = cln_now() + 0.1; cln_now() < until;)
        sum = sum + 1;
    after = cln_load_now();
    assert_true(after.own > before.own);
    if (before.could > 0) {
        const double others = cln_load_of_others(&before, &after);

        assert_true(after.could - before.could > 0.05 && others >= 0 && others <= 1);
    }
}

/* The first few by name, all by number, and what is long between its characters. */
static void test_listed(void **state)
{
    cln_listed some = {0}, full = {0};
    char name[400];

    (void)state;
    for (int i = 0; i < 5; i++)
        cln_listed_add(&some, 3, "'%c'", 'a' + i);
    assert_int_equal(some.count, 5);
    assert_string_equal(some.text, "'a', 'b', 'c', ...");
    memset(&some, 0, sizeof some);
    for (int i = 0; i < 3; i++)
        cln_listed_add(&some, 3, "%d", i);
    assert_string_equal(some.text, "0, 1, 2");
    memset(name, 'x', sizeof name);
    for (size_t i = 1; i + 2 < sizeof name; i += 2)
        memcpy(name + i, "\xC3\xA4", 2);
    name[sizeof name - 1] = 0;
    for (int i = 0; i < 9; i++)
        cln_listed_add(&full, 5, "%s", name);
    assert_int_equal(full.count, 9);
    assert_true(cln_utf8_valid(full.text));
    assert_int_equal(strlen(full.text), 5 * 159 + 5 * 2 + 3);
    assert_string_equal(full.text + strlen(full.text) - 7, "\xC3\xA4, ...");
    name[131] = 0;
    for (int i = 0; i < 2; i++) { /* more than the text holds */
        memset(&full, 0, sizeof full);
        for (int k = 0; k < 9; k++)
            cln_listed_add(&full, 9, "%.*s%s", i && !k, "x", name);
        assert_true(cln_utf8_valid(full.text) && strlen(full.text) >= CLN_LISTED_BYTES - 2);
    }
}

static void test_sort(void **state)
{
    static const double sorted[] = {-INFINITY, -2.5, -0.25, 0, 1e-300, 0.5, 0.5, 3};
    double reals[] = {0.5, -2.5, 3, 0, 0.5, -INFINITY, 1e-300, -0.25};
    float floats[] = {0.5f, -2.5f, 3, 0, 0.5f, -INFINITY, 1e-30f, -0.25f};

    (void)state;
    cln_reals_sort(reals, 8);
    cln_floats_sort(floats, 8);
    for (int i = 0; i < 8; i++) {
        assert_true(reals[i] == sorted[i]);
        assert_true(floats[i] == (i == 4 ? 1e-30f : (float)sorted[i]));
    }
    cln_floats_sort(floats, 0);
    assert_true(floats[0] == -INFINITY);
}

/* The smallest ones are in front, whatever stands where, and none is lost. */
static void test_split(void **state)
{
    enum { COUNT = 97 };

    (void)state;
    for (size_t first = 0; first <= COUNT; first++)
        for (int kind = 0; kind < 5; kind++) {
            double values[COUNT], sorted[COUNT];

            for (int i = 0; i < COUNT; i++)
                values[i] = kind == 0   ? i
                            : kind == 1 ? -i
                            : kind == 2 ? i * 37 % COUNT
                            : kind == 3 ? i * 37 % 5
                                        : 1;
            memcpy(sorted, values, sizeof sorted);
            cln_reals_sort(sorted, COUNT);
            cln_reals_split(values, COUNT, first);
            for (size_t i = 0; i < COUNT && first > 0; i++)
                assert_true(i < first ? values[i] <= sorted[first - 1]
                                      : values[i] >= sorted[first - 1]);
            cln_reals_sort(values, COUNT);
            assert_memory_equal(values, sorted, sizeof sorted);
        }
    cln_reals_split(NULL, 0, 0);
}

static void put_limit(const char *root, const char *folder, const char *file, const char *text)
{
    const char *place = scratch_path(root, folder), *path = scratch_path(place, file);

    assert_int_equal(cln_make_dirs(place), CLN_OK);
    assert_int_equal(cln_write_file(path, text, strlen(text)), CLN_OK);
}

/* The least limit of a control group and those above it counts, in either version's files. */
static void test_group_memory(void **state)
{
    const char *root = *state;

    assert_true(isinf(cln_group_memory(root))); /* no control groups */
    put_limit(root, "proc/self", "cgroup", "9:cpu:/x\n4:memory:/job/step\n0::/user/shell\n");
    assert_true(isinf(cln_group_memory(root)));
    put_limit(root, "sys/fs/cgroup/memory", "memory.limit_in_bytes", "9223372036854771712\n");
    put_limit(root, "sys/fs/cgroup/user/shell", "memory.max", "max\n");
    assert_true(cln_group_memory(root) > 9e18);
    put_limit(root, "sys/fs/cgroup/memory/job", "memory.limit_in_bytes", "2147483648\n");
    assert_true(cln_group_memory(root) == 2147483648.0);
    put_limit(root, "sys/fs/cgroup", "memory.max", "1073741824\n");
    assert_true(cln_group_memory(root) == 1073741824.0);
    put_limit(root, "sys/fs/cgroup/cpu/x", "memory.max", "1000\n"); /* another's */
    assert_true(cln_group_memory(root) == 1073741824.0);
    assert_true(cln_host_memory() > 1e8);
}

/* What is free and what this process has; of groups their limits less their use, without what the
 * system drops at need. */
static void test_available_memory(void **state)
{
    const char *root = *state;
    const double page = (double)sysconf(_SC_PAGESIZE), mib = 1 << 20;

    assert_true(isinf(cln_available_memory(root)));
    put_limit(root, "proc", "meminfo",
              "MemTotal:        3891200 kB\nMemFree:          100000 kB\n"
              "MemAvailable:     921600 kB\nBuffers: 1 kB\n");
    assert_true(cln_available_memory(root) == 900 * mib);
    put_limit(root, "proc/self", "statm", "90000 3000 1000 5 0 80000 0\n");
    assert_true(cln_available_memory(root) == 900 * mib + 2000 * page);
    put_limit(root, "proc/self", "statm", "90000 1000 1000 5 0 80000 0\n");
    put_limit(root, "proc/self", "cgroup", "4:memory:/job/step\n0::/user/shell\n");
    put_limit(root, "sys/fs/cgroup/user", "memory.max", "1073741824\n");
    assert_true(cln_available_memory(root) == 900 * mib); /* its use is not told */
    put_limit(root, "sys/fs/cgroup/user", "memory.current", "524288000\n");
    assert_true(cln_available_memory(root) == 524 * mib);
    put_limit(root, "sys/fs/cgroup/user", "memory.stat",
              "anon 209715200\ninactive_file 104857600\nactive_file 104857600\n");
    assert_true(cln_available_memory(root) == 724 * mib);
    put_limit(root, "sys/fs/cgroup/memory/job", "memory.limit_in_bytes", "419430400\n");
    put_limit(root, "sys/fs/cgroup/memory/job", "memory.usage_in_bytes", "314572800\n");
    put_limit(root, "sys/fs/cgroup/memory/job", "memory.stat",
              "inactive_file 1\ntotal_inactive_file 52428800\ntotal_active_file 0\n");
    assert_true(cln_available_memory(root) == 150 * mib);
    put_limit(root, "sys/fs/cgroup/memory/job", "memory.usage_in_bytes", "514572800\n");
    assert_true(cln_available_memory(root) == 0);
    assert_true(cln_group_memory(root) == 400 * mib);
    assert_true(cln_available_memory("") > 1e7);
}

/* What a terminal would obey, or what would look like a line of ours. */
static void test_plain(void **state)
{
    static const struct {
        const char *text, *plain;
    } cases[] = {
        {"a\tb \xc3\xbc \xe2\x82\xac \xf0\x9f\x98\x80",
         "a\tb \xc3\xbc \xe2\x82\xac \xf0\x9f\x98\x80"},
        {"a\nwarning: b\r\x1b[31m\x7f", "a?warning: b??[31m?"},
        {"\xc2\x80\xc2\x9b\xc2\x9f\xc2\xa0", "??????\xc2\xa0"},
        {"\xe2\x80\xa7\xe2\x80\xa8\xe2\x80\xae\xe2\x80\xaf", "\xe2\x80\xa7??????\xe2\x80\xaf"},
        {"\xe2\x81\xa5\xe2\x81\xa6\xe2\x81\xa9\xe2\x81\xaa", "\xe2\x81\xa5??????\xe2\x81\xaa"},
        {"\xe2", "\xe2"},
        {"\xe2\x80", "\xe2\x80"},
        {"\xc2", "\xc2"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[64];

        snprintf(text, sizeof text, "%s", cases[i].text);
        cln_text_plain(text);
        assert_string_equal(text, cases[i].plain);
    }
}

int test_group_base(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shell_quote),
        cmocka_unit_test(test_philox_known_answers),
        cmocka_unit_test(test_uniform),
        cmocka_unit_test(test_uniform_hash),
        cmocka_unit_test(test_uniform_packing),
        cmocka_unit_test(test_bounded),
        cmocka_unit_test(test_first_failure_wins),
        cmocka_unit_test(test_long_sentence),
        cmocka_unit_test(test_record_per_thread),
        cmocka_unit_test(test_exit_codes),
        cmocka_unit_test(test_try),
        cmocka_unit_test(test_alloc),
        cmocka_unit_test(test_grow),
        cmocka_unit_test(test_huge_pages),
        cmocka_unit_test_setup_teardown(test_available_memory, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_read_write, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_atomic, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_atomic_together, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_synced, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_disk_full, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_folders, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_group_memory, scratch_make, scratch_remove),
        cmocka_unit_test(test_digits),
        cmocka_unit_test(test_load),
        cmocka_unit_test(test_listed),
        cmocka_unit_test(test_sort),
        cmocka_unit_test(test_split),
        cmocka_unit_test(test_natural_compare),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_digest),
        cmocka_unit_test(test_log),
        cmocka_unit_test(test_utf8),
        cmocka_unit_test(test_plain),
    };

    return cmocka_run_group_tests_name("base", tests, NULL, NULL);
}
