/* Archives of NumPy arrays (io/npz.h): one, written by hand, of a single deflated array, and what
 * is wrong with it. Oracle: APPNOTE.TXT 4.3. */
#include "unit.h"
#include <stdlib.h>
#include <zlib.h>
#include "io/npz.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

enum { ARRAY = 80 + 3 * 8, LOCAL = 30 + 5, ENTRY = 46 + 5, END = 22, MOST = 1024 };

/* An archive, and where its directory begins. */
typedef struct archive {
    uint8_t data[MOST];
    size_t bytes, directory;
} archive;

static void put(uint8_t *at, uint32_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> (8 * i));
}

/* a.npy: 1, 2, 3; then `comment` bytes behind the end record. */
static archive make(size_t comment)
{
    const double values[3] = {1, 2, 3};
    archive a = {.bytes = LOCAL};
    uint8_t array[ARRAY], *entry = NULL, *end = NULL;
    z_stream z = {
        .next_in = array, .avail_in = ARRAY, .next_out = a.data + LOCAL, .avail_out = 512};

    memset(array, ' ', sizeof array);
    memcpy(array, "\x93NUMPY\1\0\x46\0", 10);
    memcpy(array + 10, "{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }", 57);
    array[79] = '\n';
    memcpy(array + 80, values, sizeof values);
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    a.bytes += z.total_out;
    deflateEnd(&z);
    memcpy(a.data, "PK\3\4", 4);
    put(a.data + 26, 5, 2);
    memcpy(a.data + 30, "a.npy", 5);
    a.directory = a.bytes;
    entry = a.data + a.bytes;
    memcpy(entry, "PK\1\2", 4);
    put(entry + 10, 8, 2);
    put(entry + 16, (uint32_t)crc32(0, array, ARRAY), 4);
    put(entry + 20, (uint32_t)(a.bytes - LOCAL), 4);
    put(entry + 24, ARRAY, 4);
    put(entry + 28, 5, 2);
    memcpy(entry + 46, "a.npy", 5);
    end = entry + ENTRY;
    memcpy(end, "PK\5\6", 4);
    put(end + 10, 1, 2);
    put(end + 12, ENTRY, 4);
    put(end + 16, (uint32_t)a.directory, 4);
    put(end + 20, (uint32_t)comment, 2);
    memset(end + END, '#', comment);
    a.bytes += ENTRY + END + comment;
    return a;
}

static cln_status read_array(const char *path, const archive *a, double *sum)
{
    cln_npz *npz = NULL;
    cln_status st = CLN_OK;
    int dims = 0, shape[4] = {0};
    double *data = NULL;

    scratch_put(path, a->data, a->bytes);
    st = cln_npz_open(path, &npz);
    if (st == CLN_OK)
        st = cln_npz_read(npz, "a", &dims, shape, &data);
    if (st == CLN_OK) {
        assert_int_equal(dims, 1);
        assert_int_equal(shape[0], 3);
        *sum = data[0] + 10 * data[1] + 100 * data[2];
    }
    free(data);
    cln_npz_close(npz);
    return st;
}

static void test_a_comment_may_follow(void **state)
{
    static const size_t comments[] = {0, 1, 300};
    const char *path = scratch_path(*state, "a.npz");

    for (size_t i = 0; i < sizeof comments / sizeof *comments; i++) {
        const archive a = make(comments[i]);
        double sum = 0;

        assert_ok(read_array(path, &a, &sum));
        assert_true(sum == 321);
    }
}

/* What the directory says is held against the file and what it unpacks to. */
static void test_wrong_directories(void **state)
{
    static const struct {
        int at, bytes; /* of the entry */
        uint32_t value;
        const char *words;
    } cases[] = {
        {16, 4, 1, "checksum is wrong"},
        {20, 4, MOST, "not a whole .npz file: a"}, /* behind the file's end */
        {20, 4, 8, "not a whole .npz file: a"},
        {24, 4, ARRAY - 1, "not a whole .npz file: a"},
        {24, 4, ARRAY + 1, "not a whole .npz file: a"},
        {24, 4, (1 << 26) + 1, "an array of 67108865 bytes is more than the 67108864"},
        {28, 2, 256, "its directory is damaged"},
        {30, 2, 1, "its directory is damaged"}, /* more than is before the end record */
        {32, 2, 1, "its directory is damaged"},
        {42, 4, MOST, "not a whole .npz file: a"},
        {10, 2, 9, "packed by method 9"},
    };
    const char *path = scratch_path(*state, "a.npz");

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        archive a = make(0);
        double sum = 0;

        put(a.data + a.directory + cases[i].at, cases[i].value, cases[i].bytes);
        print_message("    case %zu\n", i);
        assert_fails(read_array(path, &a, &sum), CLN_INPUT, cases[i].words);
    }
}

int test_group_npz(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_a_comment_may_follow, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_wrong_directories, scratch_make, scratch_remove)};

    return cmocka_run_group_tests_name("npz", tests, NULL, NULL);
}
