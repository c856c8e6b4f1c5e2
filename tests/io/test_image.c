/* Images and arrays on disk: PNG and JPEG through io/image.c, the area filter, and .npy.
 * Oracles: numbers calculated by hand, and the bytes of the formats' definitions. Damaged files:
 * every truncation and every flipped byte of a small image must give an error that names the path,
 * and no pixels. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "io/image.h"
#include "io/npy.h"
#include "io/png16.h"
#include "near.h"
#include "scratch.h"
#include "stb_image_write.h"
#include "tests.h"

/* An asymmetric picture, which exposes exchanged axes or channels. */
static uint8_t *make_pixels(int width, int height, int channels)
{
    uint8_t *pixels = malloc((size_t)(width * height * channels));

    assert_non_null(pixels);
    for (int i = 0; i < width * height * channels; i++)
        pixels[i] = (uint8_t)((i * 37 + i / 7 * 11) & 255);
    return pixels;
}

static void put_be32(uint8_t *p, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        p[i] = (uint8_t)(value >> (24 - 8 * i));
}

/* Appends a PNG chunk with its CRC; returns the new length. */
static size_t put_chunk(uint8_t *png, size_t at, const char *type, const void *data, size_t bytes)
{
    put_be32(png + at, (uint32_t)bytes);
    memcpy(png + at + 4, type, 4);
    if (bytes)
        memcpy(png + at + 8, data, bytes);
    put_be32(png + at + 8 + bytes, (uint32_t)crc32(0, png + at + 4, (uInt)bytes + 4));
    return at + 12 + bytes;
}

static size_t put_png_start(uint8_t *png, uint32_t width, uint32_t height, int colour_type)
{
    uint8_t ihdr[13] = {0, 0, 0, 0, 0, 0, 0, 0, 8, (uint8_t)colour_type, 0, 0, 0};

    memcpy(png, "\x89PNG\r\n\x1a\n", 8);
    put_be32(ihdr, width);
    put_be32(ihdr + 4, height);
    return put_chunk(png, 8, "IHDR", ihdr, sizeof ihdr);
}

/* Loading must fail with CLN_INPUT, the path and `word` in the sentence, and no pixels. */
static void assert_refused(const char *path, const char *word)
{
    uint8_t *pixels = (uint8_t *)1;
    int w, h, c;

    cln_clear_error();
    assert_int_equal(cln_image_load(path, &w, &h, &c, &pixels), CLN_INPUT);
    assert_null(pixels);
    if (!strstr(cln_error_text(), path) || !strstr(cln_error_text(), word))
        fail_msg("'%s' lacks the path or '%s'", cln_error_text(), word);
    cln_clear_error();
}

/* ---- PNG ---- */

static void test_png_round_trip(void **state)
{
    static const int sizes[][2] = {{1, 1}, {5, 3}, {3, 64}, {67, 2}};
    static const int channels[] = {1, 3, 4};
    const char *path = scratch_path(*state, "a.png");

    for (size_t s = 0; s < 4; s++)
        for (size_t k = 0; k < 3; k++) {
            const int w = sizes[s][0], h = sizes[s][1], n = channels[k];
            uint8_t *pixels = make_pixels(w, h, n), *back = NULL;
            int bw, bh, bn, iw, ih, in;

            assert_int_equal(cln_image_write_png(path, w, h, n, pixels), CLN_OK);
            assert_int_equal(cln_image_info(path, &iw, &ih, &in), CLN_OK);
            assert_int_equal(cln_image_load(path, &bw, &bh, &bn, &back), CLN_OK);
            assert_true(bw == w && bh == h && bn == (n == 4 ? 4 : 3));
            assert_true(iw == w && ih == h && in == bn);
            for (int i = 0; i < w * h; i++)
                for (int c = 0; c < bn; c++)
                    assert_int_equal(back[i * bn + c], pixels[i * n + (n == 1 ? 0 : c)]);
            free(pixels);
            free(back);
        }
}

/* Alpha may also come from a tRNS chunk: one colour is transparent. */
static void test_png_transparent_colour(void **state)
{
    const char *path = scratch_path(*state, "key.png");
    const uint8_t rows[] = {0, 10, 20, 30, 40, 50, 60}; /* filter 0, two RGB pixels */
    const uint8_t key[6] = {0, 10, 0, 20, 0, 30};
    uint8_t png[256], packed[64], *pixels = NULL;
    uLongf bytes = sizeof packed;
    size_t used = put_png_start(png, 2, 1, 2);
    int w, h, c;
    const uint8_t expected[8] = {10, 20, 30, 0, 40, 50, 60, 255};

    assert_int_equal(compress(packed, &bytes, rows, sizeof rows), Z_OK);
    used = put_chunk(png, used, "tRNS", key, sizeof key);
    used = put_chunk(png, used, "IDAT", packed, bytes);
    used = put_chunk(png, used, "IEND", NULL, 0);
    scratch_put(path, png, used);
    assert_int_equal(cln_image_info(path, &w, &h, &c), CLN_OK);
    assert_int_equal(c, 4);
    assert_int_equal(cln_image_load(path, &w, &h, &c, &pixels), CLN_OK);
    assert_memory_equal(pixels, expected, sizeof expected);
    free(pixels);
}

/* Values of 16 bits are rounded: v / 257. 0x0080 is 0.498, 0x0081 0.502, 0xfeff 254.004. */
static void test_png_of_sixteen_bits(void **state)
{
    const char *path = scratch_path(*state, "deep.png");
    const uint8_t rows[] = {0, 0x00, 0x80, 0x00, 0x81, 0xfe, 0xff, 0xff, 0xff};
    uint8_t png[256], packed[64], ihdr[13] = {0, 0, 0, 1, 0, 0, 0, 1, 16, 6}, *pixels = NULL;
    uLongf bytes = sizeof packed;
    size_t used = 0;
    int w, h, c;
    const uint8_t expected[4] = {0, 1, 254, 255};

    memcpy(png, "\x89PNG\r\n\x1a\n", 8);
    used = put_chunk(png, 8, "IHDR", ihdr, sizeof ihdr);
    assert_int_equal(compress(packed, &bytes, rows, sizeof rows), Z_OK);
    used = put_chunk(png, used, "IDAT", packed, bytes);
    used = put_chunk(png, used, "IEND", NULL, 0);
    scratch_put(path, png, used);
    assert_int_equal(cln_image_load(path, &w, &h, &c, &pixels), CLN_OK);
    assert_int_equal(c, 4);
    assert_memory_equal(pixels, expected, sizeof expected);
    free(pixels);
    for (uint8_t kind = 0; kind < 7; kind += 2) { /* grey, RGB, + 4: with alpha */
        cln_image_head head;

        ihdr[9] = kind;
        put_chunk(png, 8, "IHDR", ihdr, sizeof ihdr);
        scratch_put(path, png, used);
        assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
        assert_int_equal(head.deep_grey, !(kind & 2));
    }
}

/* A smooth picture is preserved approximately, in few bytes. */
static void test_jpeg_of_a_gradient(void **state)
{
    enum { SIDE = 64 };
    uint8_t pixels[SIDE * SIDE * 3], *jpeg = NULL, *back = NULL;
    size_t bytes = 0;
    int w = 0, h = 0, c = 0;

    (void)state;
    for (int i = 0; i < SIDE * SIDE; i++) {
        pixels[3 * i] = (uint8_t)(3 * (i % SIDE));
        pixels[3 * i + 1] = (uint8_t)(3 * (i / SIDE));
        pixels[3 * i + 2] = 90;
    }
    assert_int_equal(cln_image_encode_jpeg(SIDE, SIDE, 3, pixels, 90, &jpeg, &bytes), CLN_OK);
    assert_in_range(bytes, 100, sizeof pixels / 4);
    assert_int_equal(cln_image_decode("memory", jpeg, bytes, &w, &h, &c, &back), CLN_OK);
    assert_true(w == SIDE && h == SIDE && c == 3);
    for (size_t i = 0; i < sizeof pixels; i++)
        assert_in_range(back[i] + 8 - pixels[i], 0, 16);
    free(back);
    free(jpeg);
    assert_int_equal(cln_image_encode_jpeg(0, 4, 3, pixels, 90, &jpeg, &bytes), CLN_OUTPUT);
    cln_clear_error();
}

static void test_png_damage(void **state)
{
    const char *path = scratch_path(*state, "damaged.png");
    uint8_t *pixels = make_pixels(9, 7, 4), *png = NULL;
    size_t bytes = 0;

    assert_int_equal(cln_image_encode_png(9, 7, 4, pixels, &png, &bytes), CLN_OK);
    for (size_t cut = 0; cut < bytes; cut++) {
        scratch_put(path, png, cut);
        assert_refused(path, cut == 0 ? "empty file" : cut < 8 ? "not a PNG" : "truncated PNG");
    }
    for (size_t at = 0; at < bytes; at++) {
        png[at] ^= 0x10;
        scratch_put(path, png, bytes);
        assert_refused(path, "PNG");
        png[at] ^= 0x10;
    }
    free(pixels);
    free(png);
}

/* Headers with absurd sizes are refused before decoding or allocating. */
static void test_absurd_sizes(void **state)
{
    static const struct {
        uint32_t width, height;
        const char *word;
    } cases[] = {{200000, 200000, "200000 x 200000"},
                 {131073, 1, "131073 x 1"},
                 {1, 0xFFFFFFFF, "4294967295"},
                 {32768, 8193, "32768 x 8193"},
                 {0, 5, "0 x 5"},
                 {5, 0, "5 x 0"}};
    const char *path = scratch_path(*state, "huge.png");
    uint8_t png[128];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        size_t used = put_png_start(png, cases[i].width, cases[i].height, 6);
        int w, h, c;

        used = put_chunk(png, used, "IDAT", "x", 1);
        used = put_chunk(png, used, "IEND", NULL, 0);
        scratch_put(path, png, used);
        assert_refused(path, cases[i].word);
        assert_int_equal(cln_image_info(path, &w, &h, &c), CLN_INPUT);
        cln_clear_error();
    }
}

/* 8 x 8 pixels whose compressed data inflate to 64 MiB. */
static void test_inflating_png(void **state)
{
    const char *path = scratch_path(*state, "bomb.png");
    const size_t inflated = (size_t)64 << 20;
    uint8_t *zeros = calloc(inflated, 1), *packed = NULL, *png = NULL;
    uLongf bytes = compressBound(inflated);
    size_t used = 0;

    packed = malloc(bytes);
    assert_true(zeros && packed);
    assert_int_equal(compress2(packed, &bytes, zeros, inflated, 1), Z_OK);
    png = malloc(bytes + 256);
    assert_non_null(png);
    used = put_png_start(png, 8, 8, 2);
    used = put_chunk(png, used, "IDAT", packed, bytes);
    used = put_chunk(png, used, "IEND", NULL, 0);
    scratch_put(path, png, used);
    assert_refused(path, "damaged or unsupported PNG");
    free(zeros);
    free(packed);
    free(png);
}

/* ---- JPEG ---- */

typedef struct bytes {
    uint8_t data[65536];
    size_t used;
} bytes;

static void append(void *context, void *data, int size)
{
    bytes *out = context;

    assert_true(out->used + (size_t)size <= sizeof out->data);
    memcpy(out->data + out->used, data, (size_t)size);
    out->used += (size_t)size;
}

static void make_jpeg(int width, int height, bytes *out)
{
    uint8_t *pixels = malloc((size_t)(width * height * 3));

    assert_non_null(pixels);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            uint8_t *p = pixels + (y * width + x) * 3;

            p[0] = (uint8_t)(x * 255 / width);
            p[1] = (uint8_t)(y * 255 / height);
            p[2] = 90;
        }
    out->used = 0;
    assert_true(stbi_write_jpg_to_func(append, out, width, height, 3, pixels, 100));
    free(pixels);
}

static void test_jpeg_load(void **state)
{
    const char *path = scratch_path(*state, "a.jpg");
    bytes *jpeg = calloc(1, sizeof *jpeg);
    uint8_t *pixels = NULL;
    int w, h, c;

    assert_non_null(jpeg);
    make_jpeg(40, 24, jpeg);
    scratch_put(path, jpeg->data, jpeg->used);
    assert_int_equal(cln_image_info(path, &w, &h, &c), CLN_OK);
    assert_true(w == 40 && h == 24 && c == 3);
    assert_int_equal(cln_image_load(path, &w, &h, &c, &pixels), CLN_OK);
    assert_true(w == 40 && h == 24 && c == 3);
    /* Quality 100: rounding of colour conversion and of the transform, a few grey levels. */
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            const uint8_t *p = pixels + (y * w + x) * 3;

            assert_in_range(p[0] + 6 - x * 255 / w, 0, 12);
            assert_in_range(p[1] + 6 - y * 255 / h, 0, 12);
            assert_in_range(p[2], 84, 96);
        }
    free(pixels);
    free(jpeg);
}

/* Every truncation, also after a thumbnail, whose end-of-image marker must not count. */
static void test_jpeg_truncation(void **state)
{
    const char *path = scratch_path(*state, "cut.jpg");
    bytes *jpeg = calloc(1, sizeof *jpeg), *thumbnail = calloc(1, sizeof *thumbnail);
    bytes *both = calloc(1, sizeof *both);

    assert_true(jpeg && thumbnail && both);
    make_jpeg(24, 16, jpeg);
    make_jpeg(8, 8, thumbnail);
    append(both, jpeg->data, 2);
    append(both,
           (uint8_t[4]){0xFF, 0xE1, (uint8_t)((thumbnail->used + 2) >> 8),
                        (uint8_t)(thumbnail->used + 2)},
           4);
    append(both, thumbnail->data, (int)thumbnail->used);
    append(both, jpeg->data + 2, (int)jpeg->used - 2);
    for (int embedded = 0; embedded < 2; embedded++) {
        const bytes *whole = embedded ? both : jpeg;
        uint8_t *pixels = NULL;
        int w, h, c;

        scratch_put(path, whole->data, whole->used);
        assert_int_equal(cln_image_load(path, &w, &h, &c, &pixels), CLN_OK);
        assert_true(w == 24 && h == 16);
        free(pixels);
        for (size_t cut = 3; cut < whole->used; cut++) {
            scratch_put(path, whole->data, cut);
            assert_refused(path, "truncated JPEG");
        }
    }
    free(jpeg);
    free(thumbnail);
    free(both);
}

/* A JPEG has no checksum: damage may remain undetected, but must not harm the program (sanitizers
 * check), and the picture keeps its header's size. */
static void test_jpeg_damage(void **state)
{
    const char *path = scratch_path(*state, "damaged.jpg");
    bytes *jpeg = calloc(1, sizeof *jpeg);
    int refused = 0;

    assert_non_null(jpeg);
    make_jpeg(24, 16, jpeg);
    for (size_t at = 0; at < jpeg->used; at++)
        for (int bit = 0; bit < 8; bit += 3) {
            uint8_t *pixels = NULL;
            int w = 0, h = 0, c = 0;

            jpeg->data[at] ^= (uint8_t)(1 << bit);
            if (cln_image_decode(path, jpeg->data, jpeg->used, &w, &h, &c, &pixels) == CLN_OK) {
                assert_true(w > 0 && h > 0 && c == 3 && pixels);
            } else {
                assert_null(pixels);
                assert_non_null(strstr(cln_error_text(), path));
                refused++;
            }
            cln_clear_error();
            free(pixels);
            jpeg->data[at] ^= (uint8_t)(1 << bit);
        }
    assert_true(refused > 100); /* the headers at least */
    free(jpeg);
}

/* Tables with more symbols than possible, or than the segment holds: stb_image 2.27 would write out
 * of bounds. */
static void test_jpeg_tables(void **state)
{
    const char *path = scratch_path(*state, "tables.jpg");
    bytes *jpeg = calloc(1, sizeof *jpeg);
    uint8_t *counts = NULL;

    assert_non_null(jpeg);
    make_jpeg(24, 16, jpeg);
    for (size_t at = 0; !counts && at + 1 < jpeg->used; at++)
        if (jpeg->data[at] == 0xFF && jpeg->data[at + 1] == 0xC4)
            counts = jpeg->data + at + 5; /* marker, length, class and slot */
    assert_non_null(counts);
    counts[15] += 200;
    scratch_put(path, jpeg->data, jpeg->used);
    assert_refused(path, "Huffman");
    counts[14] += 200;
    scratch_put(path, jpeg->data, jpeg->used);
    assert_refused(path, "Huffman");
    free(jpeg);
}

static void test_not_an_image(void **state)
{
    const char *path = scratch_path(*state, "a.png");
    uint8_t pixel[3] = {0};
    int w, h, c;

    scratch_put(path, "GIF89a and more", 15);
    assert_refused(path, "is GIF, which is not read; convert it");
    scratch_put(path,
                "\0\0\0\x1C"
                "ftypheic",
                12);
    assert_refused(path, "is HEIC");
    scratch_put(path, "RIFF", 4); /* too short for the mark at 8 */
    assert_refused(path, "not a PNG or JPEG");
    scratch_put(path, "anything", 8);
    assert_refused(path, "not a PNG or JPEG");
    for (int i = 0; i < 3; i++) { /* two of the three bytes that a JPEG begins with */
        uint8_t almost[8] = {0xFF, 0xD8, 0xFF};

        almost[i] = 0x01;
        scratch_put(path, almost, sizeof almost);
        assert_refused(path, "not a PNG or JPEG");
    }
    assert_refused(scratch_path(*state, "missing.png"), "No such file");
    assert_refused(*state, "folder");
    assert_int_equal(cln_image_info(*state, &w, &h, &c), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "folder"));
    cln_clear_error();
    assert_int_equal(cln_image_write_png(scratch_path(*state, "no/such.png"), 1, 1, 3, pixel),
                     CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "no/such.png"));
    cln_clear_error();
}

/* ---- the area filter ---- */

static void check_downscale(int n, int w, int h, int channels, const uint8_t *in, int out_w,
                            int out_h, const uint8_t *expected)
{
    uint8_t *pixels = malloc((size_t)(w * h * channels));

    assert_non_null(pixels);
    memcpy(pixels, in, (size_t)(w * h * channels));
    assert_int_equal(cln_image_downscale(n, &w, &h, channels, &pixels), CLN_OK);
    assert_true(w == out_w && h == out_h);
    assert_memory_equal(pixels, expected, (size_t)(w * h * channels));
    free(pixels);
}

static void test_downscale(void **state)
{
    /* 3 x 3 by 2 drops the last row and column; (0+2+3+4)/4 = 2.25, (1+1+2+2)/4 = 1.5 rounds up,
     * (255*3+254)/4 = 254.75. */
    static const uint8_t rgb[27] = {0,   1, 255, 2, 1, 255, 9, 9, 9, 3, 2, 255, 4, 2,
                                    254, 9, 9,   9, 9, 9,   9, 9, 9, 9, 9, 9,   9};
    /* Premultiplied: opaque red, green at alpha 1/3, the colour at alpha 0 has no weight: alpha
     * (255+85+0+0)/4 = 85, red 200*255/340 = 150, green 100*85/340 = 25. */
    static const uint8_t rgba[16] = {200, 0, 0, 255, 0, 100, 0, 85, 255, 255, 255, 0, 9, 9, 9, 0};
    static const uint8_t clear[16] = {50, 60, 70, 0, 50, 60, 70, 0, 50, 60, 70, 0, 50, 60, 70, 0};
    /* Two blocks side by side: the order of blocks. */
    static const uint8_t wide[24] = {10, 20, 30, 10, 20, 30, 40, 50, 60, 40, 50, 60,
                                     10, 20, 30, 10, 20, 30, 40, 50, 60, 40, 50, 60};
    uint8_t *pixels = NULL;
    int w = 3, h = 3;

    (void)state;
    check_downscale(2, 3, 3, 3, rgb, 1, 1, (uint8_t[3]){2, 2, 255});
    check_downscale(2, 2, 2, 4, rgba, 1, 1, (uint8_t[4]){150, 25, 0, 85});
    check_downscale(2, 2, 2, 4, clear, 1, 1, (uint8_t[4]){0, 0, 0, 0});
    check_downscale(2, 4, 2, 3, wide, 2, 1, (uint8_t[6]){10, 20, 30, 40, 50, 60});
    check_downscale(1, 3, 3, 3, rgb, 3, 3, rgb);
    pixels = make_pixels(3, 3, 3);
    assert_int_equal(cln_image_downscale(4, &w, &h, 3, &pixels), CLN_INPUT);
    assert_true(w == 3 && h == 3);
    assert_non_null(strstr(cln_error_text(), "downscale 4"));
    cln_clear_error();
    assert_int_equal(cln_image_downscale(0, &w, &h, 3, &pixels), CLN_INPUT);
    cln_clear_error();
    free(pixels);
}

static void test_to_u8(void **state)
{
    (void)state;
    assert_int_equal(cln_to_u8(0), 0);
    assert_int_equal(cln_to_u8(1), 255);
    assert_int_equal(cln_to_u8(0.5f), 128); /* 127.5 */
    assert_int_equal(cln_to_u8(0.499f), 127);
    assert_int_equal(cln_to_u8(-3), 0);
    assert_int_equal(cln_to_u8(1e30f), 255);
    assert_int_equal(cln_to_u8(INFINITY), 255);
    assert_int_equal(cln_to_u8(-INFINITY), 0);
    assert_int_equal(cln_to_u8(NAN), 0);
    for (int i = 0; i < 256; i++)
        assert_int_equal(cln_to_u8((float)i / 255), i);
}

/* ---- .npy ---- */

static void test_npy_round_trip(void **state)
{
    static const int shapes[][4] = {{0}, {6}, {2, 3}, {1, 3, 2}, {3, 1, 1, 2}, {0, 5}};
    static const int dims[] = {0, 1, 2, 3, 4, 2}, counts[] = {1, 6, 6, 6, 6, 0};
    const float data[6] = {0, -0.0f, 1e-40f, -INFINITY, 3.25f, NAN};
    const char *path = scratch_path(*state, "a.npy");

    for (size_t i = 0; i < 6; i++) {
        float *back = NULL;
        int n = -1, shape[4] = {-1, -1, -1, -1};

        assert_int_equal(cln_npy_write_f32(path, dims[i], shapes[i], data), CLN_OK);
        assert_int_equal(cln_npy_read_f32(path, &n, shape, &back), CLN_OK);
        assert_int_equal(n, dims[i]);
        assert_memory_equal(shape, shapes[i], (size_t)n * sizeof *shape);
        assert_memory_equal(back, data, (size_t)counts[i] * sizeof *data);
        free(back);
    }
}

/* The bytes that numpy.lib.format defines: numpy.save of a (2, 3) '<f4' array starts like this. */
static void test_npy_bytes(void **state)
{
    static const char text[] = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
    const char *path = scratch_path(*state, "a.npy");
    const float data[6] = {1, 2, 3, 4, 5, 6};
    size_t size = 0;
    char *file = NULL;

    assert_int_equal(cln_npy_write_f32(path, 2, (int[2]){2, 3}, data), CLN_OK);
    file = scratch_get(path, &size);
    assert_int_equal(size, 128 + sizeof data);
    assert_memory_equal(file, "\x93NUMPY\x01\x00\x76\x00", 10); /* 118 = 128 - 10 */
    assert_memory_equal(file + 10, text, sizeof text - 1);
    assert_int_equal(file[127], '\n');
    assert_memory_equal(file + 128, data, sizeof data);
    free(file);
    assert_int_equal(cln_npy_write_f32(path, 1, (int[1]){3}, data), CLN_OK);
    file = scratch_get(path, &size);
    assert_non_null(strstr(file + 10, "'shape': (3,), }"));
    free(file);
}

static void test_npy_broken(void **state)
{
    static const struct {
        const char *header, *word;
    } cases[] = {
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", "float32"},
        {"{'descr': '<f4', 'fortran_order': True, 'shape': (2,), }", "C order"},
        {"{'descr': '<f4', 'fortran_order': False, }", "shape"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }", "truncated"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", "too long"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }", "shape"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1, 1, 2), }", "shape"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (65536, 65536), }", "shape"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }", "shape"},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (2", "shape"},
        {"", "lacks"},
    };
    const char *path = scratch_path(*state, "broken.npy");
    float *data = (float *)1;
    int dims, shape[4];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char file[256] = "\x93NUMPY\x01";
        const size_t length = strlen(cases[i].header);

        file[7] = 0;
        file[8] = (char)length;
        file[9] = 0;
        memcpy(file + 10, cases[i].header, length);
        memset(file + 10 + length, 0, 8);
        scratch_put(path, file, 10 + length + 8);
        assert_int_equal(cln_npy_read_f32(path, &dims, shape, &data), CLN_INPUT);
        assert_null(data);
        if (!strstr(cln_error_text(), path) || !strstr(cln_error_text(), cases[i].word))
            fail_msg("case %zu: '%s' lacks the path or '%s'", i, cln_error_text(), cases[i].word);
        cln_clear_error();
    }
    scratch_put(path, "\x93NUMPY\x01\0\xff\xff", 10);
    assert_int_equal(cln_npy_read_f32(path, &dims, shape, &data), CLN_INPUT);
    cln_clear_error();
    scratch_put(path, "no array", 8);
    assert_int_equal(cln_npy_read_f32(path, &dims, shape, &data), CLN_INPUT);
    cln_clear_error();
}

/* 16-bit PNG, decoded by hand as far as its definition asks: chunks, deflate, filter 1. */
static void test_png_of_words(void **state)
{
    enum { WIDTH = 5, HEIGHT = 3 };
    static const int kinds[5] = {-1, 0, -1, 2, 6};

    for (int channels = 1; channels <= 4; channels += channels == 1 ? 2 : 1) {
        const size_t row = 1 + 2 * (size_t)(WIDTH * channels);
        const char *path = scratch_path(*state, "words.png");
        uint16_t words[HEIGHT * WIDTH * 4];
        uint8_t rows[HEIGHT * (1 + 2 * WIDTH * 4)];
        uLongf got = sizeof rows;
        size_t size = 0;
        char *file = NULL;

        for (int i = 0; i < HEIGHT * WIDTH * channels; i++)
            words[i] = (uint16_t)(i * 12345 + 257 * channels);
        words[7] = 65535;
        words[8] = 0;
        assert_int_equal(cln_png16_write(path, WIDTH, HEIGHT, channels, words), CLN_OK);
        file = scratch_get(path, &size);
        assert_memory_equal(file, "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\5\0\0\0\3\x10", 25);
        assert_int_equal(file[25], kinds[channels]);
        assert_int_equal(cln_image_check(path), CLN_OK); /* the checksums */
        assert_memory_equal(file + 37, "IDAT", 4);
        assert_int_equal(uncompress(rows, &got, (const Bytef *)file + 41, (uLong)size - 57), Z_OK);
        assert_int_equal(got, HEIGHT * row);
        for (int y = 0; y < HEIGHT; y++) {
            uint8_t *line = rows + (size_t)y * row + 1;

            assert_int_equal(line[-1], 1);
            for (int i = 2 * channels; i < 2 * WIDTH * channels; i++)
                line[i] = (uint8_t)(line[i] + line[i - 2 * channels]);
            for (int i = 0; i < WIDTH * channels; i++)
                assert_int_equal(line[2 * i] * 256 + line[2 * i + 1],
                                 words[y * WIDTH * channels + i]);
        }
        free(file);
    }
    assert_int_equal(cln_to_u16(NAN), 0);
    assert_int_equal(cln_to_u16(-1), 0);
    assert_int_equal(cln_to_u16(2), 65535);
    assert_int_equal(cln_to_u16(0.5f), 32768);
}

int test_group_image(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_png_round_trip, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_png_transparent_colour, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_png_of_sixteen_bits, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_png_of_words, scratch_make, scratch_remove),
        cmocka_unit_test(test_jpeg_of_a_gradient),
        cmocka_unit_test_setup_teardown(test_png_damage, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_absurd_sizes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_inflating_png, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_jpeg_load, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_jpeg_truncation, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_jpeg_damage, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_jpeg_tables, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_not_an_image, scratch_make, scratch_remove),
        cmocka_unit_test(test_downscale),
        cmocka_unit_test(test_to_u8),
        cmocka_unit_test_setup_teardown(test_npy_round_trip, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_npy_bytes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_npy_broken, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("image", tests, NULL, NULL);
}
