/* safetensors files. Tested: written files have the documented format byte for byte and read back
 * bit for bit (every dtype, empty tensors, scalars); every damage is refused: truncation, flipped
 * bits, wrong lengths, offsets, shapes and dtypes; a failed write leaves the old file. Oracles: a
 * hand-made file, and the format's own rules. The address sanitizer detects reads out of bounds. */
#include "unit.h"
#include <dirent.h>
#include <inttypes.h>
#include <string.h>
#include "io/safetensors.h"
#include "scratch.h"
#include "tests.h"

static const float numbers[6] = {1.5f, -0.0f, 3e-41f, 4, 5, 6};
static const int32_t whole[3] = {-1, 0, INT32_MAX};
static const uint16_t halves[2] = {0x3f80, 0xffff};
static const uint8_t octets[5] = {1, 2, 3, 4, 255};

enum { TENSORS = 6 };
static const cln_tensor tensors[TENSORS] = {
    {"numbers", CLN_DTYPE_F32, 2, {2, 3}, numbers},     {"whole", CLN_DTYPE_I32, 1, {3}, whole},
    {"nothing", CLN_DTYPE_F32, 3, {0, 7, 2}, NULL},     {"scalar", CLN_DTYPE_BF16, 0, {0}, halves},
    {"halves", CLN_DTYPE_U16, 4, {1, 2, 1, 1}, halves}, {"octets", CLN_DTYPE_U8, 1, {5}, octets},
};

static void test_round_trip(void **state)
{
    const char *path = scratch_path(*state, "a.safetensors");
    cln_safetensors *file = NULL;
    uint64_t digest = 0;

    assert_int_equal(cln_safetensors_write(path, TENSORS, tensors, &digest), CLN_OK);
    assert_int_equal(cln_safetensors_read(path, &file), CLN_OK);
    assert_true(cln_safetensors_digest(file) == digest);
    for (int i = 0; i < TENSORS; i++) {
        cln_tensor t;
        size_t bytes = cln_tensor_bytes(&tensors[i]);
        assert_int_equal(cln_safetensors_get(file, tensors[i].name, tensors[i].dtype, &t), CLN_OK);
        assert_int_equal(t.dims, tensors[i].dims);
        assert_memory_equal(t.shape, tensors[i].shape, (size_t)t.dims * sizeof t.shape[0]);
        assert_int_equal(cln_tensor_bytes(&t), bytes);
        if (bytes)
            assert_memory_equal(t.data, tensors[i].data, bytes);
    }
    cln_safetensors_free(file);
}

static void test_get_refuses(void **state)
{
    const char *path = scratch_path(*state, "a.safetensors");
    cln_safetensors *file = NULL;
    cln_tensor t;

    assert_int_equal(cln_safetensors_write(path, TENSORS, tensors, NULL), CLN_OK);
    assert_int_equal(cln_safetensors_read(path, &file), CLN_OK);
    assert_int_equal(cln_safetensors_get(file, "number", CLN_DTYPE_F32, &t), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "no tensor 'number'"));
    cln_clear_error();
    assert_int_equal(cln_safetensors_get(file, "numbers", CLN_DTYPE_I32, &t), CLN_CHECKPOINT);
    assert_non_null(strstr(cln_error_text(), "F32, not I32"));
    cln_clear_error();
    cln_safetensors_free(file);
}

/* The documented digest of a file with one tensor of one dimension. */
static uint64_t digest_of_one(const char *name, const char *dtype, int64_t side, const void *data,
                              size_t bytes)
{
    uint64_t digest = cln_digest(CLN_DIGEST_START, name, strlen(name));

    digest = cln_digest(digest, dtype, strlen(dtype));
    digest = cln_digest(digest, &side, sizeof side);
    return cln_digest(digest, data, bytes);
}

/* The documented bytes of a file with one tensor. */
static void test_bytes(void **state)
{
    const char *path = scratch_path(*state, "a.safetensors");
    char header[256];
    size_t bytes = 0, length = 0;
    uint64_t digest = digest_of_one("whole", "I32", 3, whole, sizeof whole), stated = 0;
    char *data = NULL;

    snprintf(header, sizeof header,
             "{\"__metadata__\":{\"digest\":\"%016" PRIx64 "\"},\"whole\":{\"dtype\":\"I32\","
             "\"shape\":[3],\"data_offsets\":[0,12]}}",
             digest);
    length = (strlen(header) + 7) / 8 * 8;
    assert_int_equal(cln_safetensors_write(path, 1, &tensors[1], NULL), CLN_OK);
    data = scratch_get(path, &bytes);
    assert_int_equal(bytes, 8 + length + 12);
    memcpy(&stated, data, 8);
    assert_int_equal(stated, length);
    assert_memory_equal(data + 8, header, strlen(header));
    for (size_t i = 8 + strlen(header); i < 8 + length; i++)
        assert_int_equal(data[i], ' ');
    assert_memory_equal(data + 8 + length, whole, 12);
    free(data);
}

/* Writes a file with this header and data; %s stands for the digest of a tensor x of bytes. */
static void put_file(const char *path, const char *header, const void *data, size_t bytes)
{
    char text[1024], hex[17], file[2048];
    uint64_t length = 0;

    snprintf(hex, sizeof hex, "%016" PRIx64, digest_of_one("x", "U8", (int64_t)bytes, data, bytes));
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
    snprintf(text, sizeof text, header, hex);
#pragma GCC diagnostic pop
    length = strlen(text);
    memcpy(file, &length, 8);
    memcpy(file + 8, text, length);
    memcpy(file + 8 + length, data, bytes);
    scratch_put(path, file, 8 + length + bytes);
}

#define META "\"__metadata__\":{\"digest\":\"%s\",\"format\":\"pt\"}"

/* Files of other programs: other order of keys, more metadata, no padding, unaligned data. */
static void test_reads_others(void **state)
{
    const char *path = scratch_path(*state, "b.safetensors");
    cln_safetensors *file = NULL;
    cln_tensor t;

    put_file(path, "{\"x\":{\"shape\":[1],\"data_offsets\":[0,1],\"dtype\":\"U8\"}," META "}",
             "\x07", 1);
    assert_int_equal(cln_safetensors_read(path, &file), CLN_OK);
    assert_int_equal(cln_safetensors_get(file, "x", CLN_DTYPE_U8, &t), CLN_OK);
    assert_int_equal(*(const uint8_t *)t.data, 7);
    cln_safetensors_free(file);
}

/* Four bytes of data after headers that contradict them. */
static void test_refuses_headers(void **state)
{
#define X(fields) "{" META ",\"x\":{" fields "}}"
    static const struct {
        const char *header, *word;
    } cases[] = {
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,5]"), "outside"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[-4,0]"), "outside"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[4,0]"), "outside"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,9223372036854775807]"), "outside"},
        {X("\"dtype\":\"U8\",\"shape\":[3],\"data_offsets\":[0,4]"), "shape"},
        {X("\"dtype\":\"F32\",\"shape\":[4],\"data_offsets\":[0,4]"), "shape"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,3]"), "shape"},
        {X("\"dtype\":\"U8\",\"shape\":[3],\"data_offsets\":[1,4]"), "hole"},
        {X("\"dtype\":\"U8\",\"shape\":[3],\"data_offsets\":[0,3]"), "follow"},
        {X("\"dtype\":\"U8\",\"shape\":[3],\"data_offsets\":[0,3]},"
           "\"y\":{\"dtype\":\"U8\",\"shape\":[2],\"data_offsets\":[2,4]"),
         "overlaps"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]},"
           "\"y\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]"),
         "overlaps"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]},"
           "\"x\":{\"dtype\":\"U8\",\"shape\":[0],\"data_offsets\":[4,4]"),
         "duplicate"},
        /* 2^62 x 4 x 1 wraps to 0, and 2^32 x 2^32 x 4 bytes too */
        {X("\"dtype\":\"U8\",\"shape\":[4611686018427387904,4],\"data_offsets\":[0,0]"), "shape"},
        {X("\"dtype\":\"F32\",\"shape\":[4294967296,4294967296],\"data_offsets\":[0,0]"), "shape"},
        {X("\"dtype\":\"U8\",\"shape\":[-1],\"data_offsets\":[0,4]"), "whole numbers"},
        {X("\"dtype\":\"U8\",\"shape\":[4.0],\"data_offsets\":[0,4]"), "whole numbers"},
        {X("\"dtype\":\"U8\",\"shape\":[1,1,1,1,4],\"data_offsets\":[0,4]"), "up to 4"},
        {X("\"dtype\":\"U8\",\"shape\":4,\"data_offsets\":[0,4]"), "up to 4"},
        {X("\"dtype\":\"F64\",\"shape\":[4],\"data_offsets\":[0,4]"), "dtype"},
        {X("\"shape\":[4],\"data_offsets\":[0,4]"), "dtype"},
        {X("\"dtype\":\"U8\",\"data_offsets\":[0,4]"), "shape"},
        {X("\"dtype\":\"U8\",\"shape\":[4]"), "data_offsets"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0]"), "data_offsets"},
        {X("\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,\"4\"]"), "data_offsets"},
        {"{" META ",\"x\":7}", "dtype"},
        {"{\"x\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]}}", "none"},
        {"{\"__metadata__\":{\"digest\":\"0123456789abcdef\"},"
         "\"x\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[0,4]}}",
         "damaged"},
        {"[1,2]", "not a JSON object"},
        {"{", "not a JSON object"},
        {"", "not a JSON object"},
    };
#undef X
    const char *path = scratch_path(*state, "c.safetensors");

    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_safetensors *file = NULL;
        put_file(path, cases[i].header, "abcd", 4);
        assert_int_equal(cln_safetensors_read(path, &file), CLN_CHECKPOINT);
        assert_null(file);
        if (!strstr(cln_error_text(), cases[i].word) || !strstr(cln_error_text(), path))
            fail_msg("case %zu: '%s' does not name the file and '%s'", i, cln_error_text(),
                     cases[i].word);
        cln_clear_error();
    }
}

static void must_refuse(const char *path, const char *data, size_t bytes, size_t where)
{
    cln_safetensors *file = NULL;

    scratch_put(path, data, bytes);
    if (cln_safetensors_read(path, &file) != CLN_CHECKPOINT)
        fail_msg("damage at byte %zu was not seen", where);
    cln_clear_error();
}

/* Truncated anywhere, extended, or any one bit flipped. */
static void test_refuses_damage(void **state)
{
    const char *path = scratch_path(*state, "d.safetensors");
    size_t bytes = 0;
    char *data = NULL, *longer = NULL;

    assert_int_equal(cln_safetensors_write(path, TENSORS, tensors, NULL), CLN_OK);
    data = scratch_get(path, &bytes);
    for (size_t cut = 0; cut < bytes; cut++)
        must_refuse(path, data, cut, cut);
    longer = calloc(bytes + 1, 1);
    memcpy(longer, data, bytes);
    must_refuse(path, longer, bytes + 1, bytes);
    for (size_t bit = 0; bit < 8 * bytes; bit++) {
        data[bit / 8] ^= (char)(1 << bit % 8);
        must_refuse(path, data, bytes, bit / 8);
        data[bit / 8] ^= (char)(1 << bit % 8);
    }
    free(longer);
    free(data);
}

static void test_missing_file(void **state)
{
    cln_safetensors *file = NULL;

    assert_int_not_equal(cln_safetensors_read(scratch_path(*state, "no.safetensors"), &file),
                         CLN_OK);
    assert_non_null(strstr(cln_error_text(), "no.safetensors"));
    cln_clear_error();
    assert_null(file);
}

static int count_entries(const char *folder)
{
    DIR *dir = opendir(folder);
    int count = 0;

    assert_non_null(dir);
    while (readdir(dir))
        count++;
    closedir(dir);
    return count - 2;
}

/* The disk fills up in the middle of the data: only the old file remains. */
static void test_full_disk(void **state)
{
    const char *path = scratch_path(*state, "e.safetensors");
    static float large[1 << 16];
    cln_tensor big = {"big", CLN_DTYPE_F32, 1, {1 << 16}, large};
    size_t bytes = 0, after = 0;
    char *before = NULL, *now = NULL;

    assert_int_equal(cln_safetensors_write(path, TENSORS, tensors, NULL), CLN_OK);
    before = scratch_get(path, &bytes);
    scratch_limit_files(1 << 15);
    assert_int_equal(cln_safetensors_write(path, 1, &big, NULL), CLN_OUTPUT);
    scratch_limit_files(RLIM_INFINITY);
    assert_non_null(strstr(cln_error_text(), path));
    cln_clear_error();
    now = scratch_get(path, &after);
    assert_int_equal(after, bytes);
    assert_memory_equal(now, before, bytes);
    assert_int_equal(count_entries(*state), 1);
    free(before);
    free(now);
    assert_int_equal(cln_safetensors_write(scratch_path(*state, "no/e"), TENSORS, tensors, NULL),
                     CLN_OUTPUT);
    cln_clear_error();
}

int test_group_safetensors(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_round_trip, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_get_refuses, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bytes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_reads_others, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refuses_headers, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refuses_damage, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_missing_file, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_full_disk, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("safetensors", tests, NULL, NULL);
}
