/* Photos whose colours are not sRGB's (io/colour.h), as files: profiles in PNG and JPEG, gAMA and
 * cHRM. Oracle: the definitions of Adobe RGB (1998) and sRGB, in double. Damaged profiles. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "exif_fixture.h"
#include "io/image.h"
#include "near.h"
#include "scratch.h"
#include "tests.h"

#ifdef CLN_WITH_LCMS2
#include <lcms2.h>

enum { SIDE = 12, FILE_BYTES = 1 << 16 };

static const double adobe_chroma[8] = {0.3127, 0.329, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06};

static double srgb_of_linear(double v)
{
    v = fmin(fmax(v, 0), 1);
    return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
}

/* Adobe RGB (1998) to sRGB, 0..1: by way of CIE XYZ of D65. */
static void adobe_to_srgb(const double rgb[3], double out[3])
{
    static const double to_xyz[3][3] = {{0.5766690429, 0.1855582379, 0.1882286462},
                                        {0.2973449753, 0.6273635663, 0.0752914585},
                                        {0.0270313614, 0.0706888525, 0.9913375368}},
                        from_xyz[3][3] = {{3.2404541621, -1.5371385128, -0.4985314095},
                                          {-0.9692660305, 1.8760108454, 0.0415560175},
                                          {0.0556434310, -0.2040259135, 1.0572251882}};
    double xyz[3] = {0};

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            xyz[i] += to_xyz[i][k] * pow(rgb[k], 2.19921875);
    for (int i = 0; i < 3; i++)
        out[i] = srgb_of_linear(from_xyz[i][0] * xyz[0] + from_xyz[i][1] * xyz[1] +
                                from_xyz[i][2] * xyz[2]);
}

/* A value as it is stored; channel 3: alpha. */
static double pixel_at(int i, int channel, int bits)
{
    const double share = (double)(i * (channel + 1) * 5 % (SIDE * SIDE)) / (SIDE * SIDE - 1);
    const double most = bits == 16 ? 65535 : 255;

    return round((channel == 3 ? share : 0.05 + 0.9 * share) * most) / most;
}

static void put_be(uint8_t *p, uint32_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        p[i] = (uint8_t)(value >> (8 * (bytes - 1 - i)));
}

/* A file's chunks. */
typedef struct file {
    uint8_t data[FILE_BYTES];
    size_t bytes;
} file;

static void put_chunk(file *f, const char *type, const void *data, size_t bytes)
{
    uint8_t *p = f->data + f->bytes;

    assert_true(f->bytes + bytes + 12 <= sizeof f->data);
    put_be(p, (uint32_t)bytes, 4);
    memcpy(p + 4, type, 4);
    if (bytes)
        memcpy(p + 8, data, bytes);
    put_be(p + 8 + bytes, (uint32_t)crc32(0, p + 4, (uInt)bytes + 4), 4);
    f->bytes += bytes + 12;
}

static void begin_png(file *f, int channels, int bits)
{
    uint8_t head[13] = {0, 0, 0, SIDE, 0, 0, 0, SIDE, (uint8_t)bits, channels == 4 ? 6 : 2};

    memcpy(f->data, "\x89PNG\r\n\x1a\n", 8);
    f->bytes = 8;
    put_chunk(f, "IHDR", head, sizeof head);
}

static void end_png(file *f, int channels, int bits)
{
    uint8_t rows[SIDE * (1 + SIDE * 4 * 2)] = {0}, packed[sizeof rows + 100], *p = rows;
    uLongf bytes = sizeof packed;

    for (int i = 0; i < SIDE * SIDE; i++) {
        p += i % SIDE == 0;
        for (int c = 0; c < channels; c++, p += bits / 8)
            put_be(p, (uint32_t)lround(pixel_at(i, c, bits) * (bits == 16 ? 65535 : 255)),
                   bits / 8);
    }
    assert_int_equal(compress(packed, &bytes, rows, (uLong)(p - rows)), Z_OK);
    put_chunk(f, "IDAT", packed, bytes);
    put_chunk(f, "IEND", NULL, 0);
}

static cmsHPROFILE adobe(void)
{
    const cmsCIExyY white = {adobe_chroma[0], adobe_chroma[1], 1};
    const cmsCIExyYTRIPLE primaries = {{adobe_chroma[2], adobe_chroma[3], 1},
                                       {adobe_chroma[4], adobe_chroma[5], 1},
                                       {adobe_chroma[6], adobe_chroma[7], 1}};
    cmsToneCurve *curve = cmsBuildGamma(NULL, 2.19921875), *curves[3] = {curve, curve, curve};
    cmsHPROFILE profile = cmsCreateRGBProfile(&white, &primaries, curves);

    cmsFreeToneCurve(curve);
    assert_non_null(profile);
    return profile;
}

static uint8_t *saved(cmsHPROFILE profile, cmsUInt32Number *bytes)
{
    uint8_t *data = NULL;

    assert_true(cmsSaveProfileToMem(profile, NULL, bytes));
    data = malloc(*bytes);
    assert_true(cmsSaveProfileToMem(profile, data, bytes));
    cmsCloseProfile(profile);
    return data;
}

/* An iCCP chunk of a profile. */
static void put_profile(file *f, const uint8_t *profile, size_t bytes)
{
    uint8_t chunk[16384] = "some name";
    uLongf room = sizeof chunk - 11;

    assert_int_equal(compress(chunk + 11, &room, profile, bytes), Z_OK);
    put_chunk(f, "iCCP", chunk, 11 + room);
}

static cln_colour_kind kind_of(void **state, const file *f)
{
    const char *path = scratch_path(*state, "image");
    cln_image_head head;

    scratch_put(path, f->data, f->bytes);
    assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
    return head.colour;
}

/* The pixels [SIDE * SIDE][channels]; the caller frees them. */
static uint8_t *decoded(const file *f, int channels)
{
    int width = 0, height = 0, got = 0;
    uint8_t *pixels = NULL;

    assert_int_equal(cln_image_decode("image", f->data, f->bytes, &width, &height, &got, &pixels),
                     CLN_OK);
    assert_int_equal(width, SIDE);
    assert_int_equal(height, SIDE);
    assert_int_equal(got, channels);
    return pixels;
}

/* The file has the colours of the same one without a profile, when kind is not CLN_COLOUR_OTHER. */
static void check_plain(void **state, const file *f, cln_colour_kind kind)
{
    uint8_t *pixels = decoded(f, 3);

    assert_int_equal(kind_of(state, f), kind);
    for (int i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++)
            assert_int_equal(pixels[3 * i + c], lround(pixel_at(i, c, 8) * 255));
    free(pixels);
}

/* Colours are converted, from 8 and from 16 bits; alpha is kept. */
static void test_png(void **state)
{
    cmsUInt32Number bytes = 0;
    uint8_t *profile = saved(adobe(), &bytes);
    static file f;

    for (int k = 0; k < 4; k++) {
        const int channels = 3 + k % 2, bits = k < 2 ? 8 : 16;
        uint8_t *pixels = NULL;
        double largest = 0;

        begin_png(&f, channels, bits);
        put_profile(&f, profile, bytes);
        end_png(&f, channels, bits);
        assert_int_equal(kind_of(state, &f), CLN_COLOUR_OTHER);
        pixels = decoded(&f, channels);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double in[3] = {pixel_at(i, 0, bits), pixel_at(i, 1, bits), pixel_at(i, 2, bits)};
            double out[3];

            adobe_to_srgb(in, out);
            for (int c = 0; c < 3; c++)
                largest = fmax(largest, fabs(pixels[channels * i + c] - 255 * out[c]));
            if (channels == 4)
                assert_near(pixels[4 * i + 3], 255 * pixel_at(i, 3, bits), 1);
        }
        print_message("%d channels of %d bits: off by up to %.2f of 255\n", channels, bits,
                      largest);
        assert_true(largest < 2.5);
        free(pixels);
    }
    free(profile);
}

/* In a JPEG the profile lies in parts, in any order. */
static void test_jpeg(void **state)
{
    cmsUInt32Number bytes = 0;
    uint8_t *profile = saved(adobe(), &bytes), *jpeg = NULL, *plain = NULL, *pixels = NULL;
    uint8_t grey[SIDE * SIDE * 3];
    const size_t first = bytes / 3;
    size_t length = 0;
    static file f;

    for (int i = 0; i < SIDE * SIDE * 3; i++)
        grey[i] = (uint8_t)(60 + 50 * (i % 3)); /* one colour, which JPEG keeps */
    assert_int_equal(cln_image_encode_jpeg(SIDE, SIDE, 3, grey, 100, &jpeg, &length), CLN_OK);
    memcpy(f.data, jpeg, length);
    f.bytes = length;
    plain = decoded(&f, 3);
    for (int parts = 2; parts >= 1; parts--) { /* first all, then the second part alone */
        f.bytes = 2;
        for (int number = 2; number > 2 - parts; number--) {
            const size_t from = number == 2 ? first : 0, some = number == 2 ? bytes - first : first;
            uint8_t *p = f.data + f.bytes;

            put_be(p, 0xFFE2, 2);
            put_be(p + 2, (uint32_t)some + 16, 2);
            memcpy(p + 4, "ICC_PROFILE", 12);
            p[16] = (uint8_t)number;
            p[17] = 2;
            memcpy(p + 18, profile + from, some);
            f.bytes += some + 18;
        }
        memcpy(f.data + f.bytes, jpeg + 2, length - 2);
        f.bytes += length - 2;
        assert_int_equal(kind_of(state, &f), parts == 2 ? CLN_COLOUR_OTHER : CLN_COLOUR_UNKNOWN);
        pixels = decoded(&f, 3);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double in[3] = {plain[3 * i] / 255., plain[3 * i + 1] / 255.,
                                  plain[3 * i + 2] / 255.};
            double out[3];

            adobe_to_srgb(in, out);
            for (int c = 0; c < 3; c++)
                assert_near(pixels[3 * i + c], parts == 2 ? 255 * out[c] : plain[3 * i + c], 2.5);
        }
        free(pixels);
    }
    free(plain);
    free(jpeg);
    free(profile);
}

/* A camera's JPEG in Adobe RGB has no profile, but says so in its EXIF data, as DCF has it: a
 * colour space without a name (other: sRGB's), and the rule R03 (other: R98). */
static void put_dcf(file *f, bool little, uint32_t space, const char *rule)
{
    uint8_t *const p = f->data + 2, *const tiff = p + 10;
    const uint32_t at[3] = {8, 26, 56};
    const struct {
        int directory;
        uint32_t tag, type, count, value;
    } entries[] = {{0, 0x8769, 4, 1, 26},
                   {1, 0xA001, 3, 1, space},
                   {1, 0xA005, 4, 1, 56},
                   {2, 0x0001, 2, 4, 0}};
    int filled[3] = {0};

    memset(p, 0, 10 + 74);
    put_be(p, 0xFFE1, 2);
    put_be(p + 2, 8 + 74, 2);
    memcpy(p + 4, "Exif", 4);
    memcpy(tiff, little ? "II" : "MM", 2);
    exif_number(tiff + 2, 2, little, 42);
    exif_number(tiff + 4, 4, little, at[0]);
    for (size_t i = 0; i < sizeof entries / sizeof *entries; i++) {
        const int d = entries[i].directory;
        uint8_t *entry = tiff + at[d] + 2 + 12 * filled[d]++;

        exif_number(entry, 2, little, entries[i].tag);
        exif_number(entry + 2, 2, little, entries[i].type);
        exif_number(entry + 4, 4, little, entries[i].count);
        exif_number(entry + 8, entries[i].type == 3 ? 2 : 4, little, entries[i].value);
        if (entries[i].type == 2)
            memcpy(entry + 8, rule, 4);
        exif_number(tiff + at[d], 2, little, (uint32_t)filled[d]);
    }
    f->bytes = 2 + 10 + 74;
}

static void test_dcf(void **state)
{
    static const struct {
        uint32_t space;
        const char *rule;
        cln_colour_kind kind;
    } cases[] = {{0xFFFF, "R03", CLN_COLOUR_OTHER},
                 {0xFFFF, "R98", CLN_COLOUR_SRGB},
                 {1, "R03", CLN_COLOUR_SRGB}};
    cmsUInt32Number bytes = 0;
    cmsHPROFILE srgb = cmsCreate_sRGBProfile();
    uint8_t *profile = saved(srgb, &bytes);
    uint8_t grey[SIDE * SIDE * 3], *jpeg = NULL, *plain = NULL, *pixels = NULL;
    size_t length = 0;
    static file f;

    for (int i = 0; i < SIDE * SIDE * 3; i++)
        grey[i] = (uint8_t)(60 + 50 * (i % 3));
    assert_int_equal(cln_image_encode_jpeg(SIDE, SIDE, 3, grey, 100, &jpeg, &length), CLN_OK);
    memcpy(f.data, jpeg, length);
    f.bytes = length;
    plain = decoded(&f, 3);
    for (int k = 0; k < 8; k++) {
        const size_t c = (size_t)k / 2;
        const bool profiled = k >= 6, other = !profiled && cases[c].kind == CLN_COLOUR_OTHER;

        put_dcf(&f, k % 2, profiled ? 0xFFFF : cases[c].space, profiled ? "R03" : cases[c].rule);
        if (profiled) { /* a profile tells more */
            uint8_t *p = f.data + f.bytes;

            put_be(p, 0xFFE2, 2);
            put_be(p + 2, (uint32_t)bytes + 16, 2);
            memcpy(p + 4, "ICC_PROFILE", 12);
            p[16] = p[17] = 1;
            memcpy(p + 18, profile, bytes);
            f.bytes += bytes + 18;
        }
        memcpy(f.data + f.bytes, jpeg + 2, length - 2);
        f.bytes += length - 2;
        assert_int_equal(kind_of(state, &f), other ? CLN_COLOUR_OTHER : CLN_COLOUR_SRGB);
        pixels = decoded(&f, 3);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double in[3] = {plain[3 * i] / 255., plain[3 * i + 1] / 255.,
                                  plain[3 * i + 2] / 255.};
            double out[3];

            adobe_to_srgb(in, out);
            for (int a = 0; a < 3; a++)
                assert_near(pixels[3 * i + a], other ? 255 * out[a] : plain[3 * i + a], 2.5);
        }
        free(pixels);
    }
    free(plain);
    free(jpeg);
    free(profile);
}

/* sRGB's own profile changes nothing, nor does one that is damaged or of grey. */
static void test_kept(void **state)
{
    cmsUInt32Number bytes = 0;
    cmsToneCurve *curve = cmsBuildGamma(NULL, 1.8);
    uint8_t *profile = saved(cmsCreate_sRGBProfile(), &bytes);
    static file f;

    begin_png(&f, 3, 8);
    put_profile(&f, profile, bytes);
    end_png(&f, 3, 8);
    check_plain(state, &f, CLN_COLOUR_SRGB);
    for (size_t at = 0; at < 132; at += 4) { /* its head and how many parts it has */
        profile[at] ^= 0xFF;
        begin_png(&f, 3, 8);
        put_profile(&f, profile, bytes);
        end_png(&f, 3, 8);
        if (kind_of(state, &f) == CLN_COLOUR_UNKNOWN)
            check_plain(state, &f, CLN_COLOUR_UNKNOWN);
        profile[at] ^= 0xFF;
    }
    begin_png(&f, 3, 8);
    put_profile(&f, profile, 100);
    end_png(&f, 3, 8);
    check_plain(state, &f, CLN_COLOUR_UNKNOWN);
    begin_png(&f, 3, 8);
    put_chunk(&f, "iCCP", "name\0\0not deflated", 18);
    end_png(&f, 3, 8);
    check_plain(state, &f, CLN_COLOUR_UNKNOWN);
    free(profile);
    profile = saved(cmsCreateGrayProfile(cmsD50_xyY(), curve), &bytes);
    begin_png(&f, 3, 8);
    put_profile(&f, profile, bytes);
    end_png(&f, 3, 8);
    check_plain(state, &f, CLN_COLOUR_UNKNOWN);
    cmsFreeToneCurve(curve);
    free(profile);
}

/* A PNG without a profile that tells gamma and primaries. */
static void test_chunks(void **state)
{
    static const struct {
        double gamma;
        bool chroma, srgb;
        cln_colour_kind kind;
    } rows[] = {{1, false, false, CLN_COLOUR_OTHER},
                {0.45455, false, false, CLN_COLOUR_SRGB},
                {1, false, true, CLN_COLOUR_SRGB},
                {0, false, false, CLN_COLOUR_SRGB},
                {1 / 2.19921875, true, false, CLN_COLOUR_OTHER}};
    static file f;

    for (size_t k = 0; k < sizeof rows / sizeof *rows; k++) {
        uint8_t gamma[4], chroma[32], *pixels = NULL;

        put_be(gamma, (uint32_t)lround(rows[k].gamma * 1e5), 4);
        for (int i = 0; i < 8; i++)
            put_be(chroma + 4 * i, (uint32_t)lround(adobe_chroma[i] * 1e5), 4);
        begin_png(&f, 3, 16);
        if (rows[k].gamma > 0)
            put_chunk(&f, "gAMA", gamma, 4);
        if (rows[k].chroma)
            put_chunk(&f, "cHRM", chroma, 32);
        if (rows[k].srgb)
            put_chunk(&f, "sRGB", "", 1);
        end_png(&f, 3, 16);
        assert_int_equal(kind_of(state, &f), rows[k].kind);
        pixels = decoded(&f, 3);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double in[3] = {pixel_at(i, 0, 16), pixel_at(i, 1, 16), pixel_at(i, 2, 16)};
            double out[3];

            adobe_to_srgb(in, out);
            for (int c = 0; c < 3; c++) {
                const double linear = srgb_of_linear(in[c]);
                const double wanted = rows[k].kind == CLN_COLOUR_SRGB ? in[c]
                                      : rows[k].chroma                ? out[c]
                                                                      : linear;

                assert_near(pixels[3 * i + c], 255 * wanted, rows[k].chroma ? 4 : 1.5);
            }
        }
        free(pixels);
    }
}

int test_group_colour(void)
{
#define WITH_SCRATCH(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)
    const struct CMUnitTest tests[] = {WITH_SCRATCH(test_png), WITH_SCRATCH(test_jpeg),
                                       WITH_SCRATCH(test_dcf), WITH_SCRATCH(test_kept),
                                       WITH_SCRATCH(test_chunks)};

    return cmocka_run_group_tests_name("colour", tests, NULL, NULL);
}

#else

int test_group_colour(void)
{
    print_message("colour: built without Little CMS\n");
    return 0;
}

#endif
