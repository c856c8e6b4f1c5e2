/* What XMP data tell of panoramas (io/xmp.h), as attributes and as elements, in JPEG and PNG files.
 * Oracle: Google's schema GPano. */
#include "unit.h"
#include <zlib.h>
#include "io/image.h"
#include "scratch.h"
#include "tests.h"

#define SEGMENT "http://ns.adobe.com/xap/1.0/\0"
#define CHUNK   "XML:com.adobe.xmp\0\0\0\0\0"
#define WHOLE   "<rdf:Description GPano:ProjectionType=\"equirectangular\"/>"

static cln_panorama read_segment(const char *text)
{
    char data[1024] = SEGMENT;

    snprintf(data + sizeof SEGMENT - 1, sizeof data - sizeof SEGMENT, "%s", text);
    return cln_xmp_read_segment((const uint8_t *)data, sizeof SEGMENT - 1 + strlen(text));
}

static void test_panoramas(void **state)
{
    static const struct {
        const char *text;
        cln_panorama is;
    } cases[] = {
        {WHOLE, CLN_PANORAMA_WHOLE},
        {"<GPano:ProjectionType>equirectangular</GPano:ProjectionType>", CLN_PANORAMA_WHOLE},
        {"GPano:ProjectionType = 'equirectangular'", CLN_PANORAMA_WHOLE},
        {"GPano:ProjectionType\n\t=\r\n\t\"equirectangular\"", CLN_PANORAMA_WHOLE},
        {"GPano:ProjectionType=\"cylindrical\"", CLN_PANORAMA_UNTOLD},
        {"GPano:ProjectionType=\"\"", CLN_PANORAMA_UNTOLD},
        {"GPano:ProjectionType", CLN_PANORAMA_UNTOLD},
        {"", CLN_PANORAMA_UNTOLD},
        {WHOLE " GPano:FullPanoWidthPixels=\"800\" GPano:CroppedAreaImageWidthPixels=\"800\"",
         CLN_PANORAMA_WHOLE},
        {WHOLE " GPano:FullPanoWidthPixels=\"8000\" GPano:CroppedAreaImageWidthPixels=\"7999\"",
         CLN_PANORAMA_WHOLE},
        {WHOLE " GPano:FullPanoWidthPixels=\"800\" GPano:CroppedAreaImageWidthPixels=\"600\"",
         CLN_PANORAMA_CUT},
        {WHOLE " GPano:FullPanoWidthPixels=\"800\" GPano:CroppedAreaImageWidthPixels=\"780\"",
         CLN_PANORAMA_CUT},
        {WHOLE " GPano:FullPanoWidthPixels=\"800\"", CLN_PANORAMA_WHOLE}, /* of what, if not all? */
        {WHOLE "<GPano:CroppedAreaImageHeightPixels>280</GPano:CroppedAreaImageHeightPixels>"
               "<GPano:FullPanoHeightPixels>400</GPano:FullPanoHeightPixels>",
         CLN_PANORAMA_CUT},
        {WHOLE " GPano:FullPanoHeightPixels=\"x\" GPano:CroppedAreaImageHeightPixels=\"",
         CLN_PANORAMA_WHOLE},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (read_segment(cases[i].text) != cases[i].is)
            fail_msg("%s", cases[i].text);
    for (size_t bytes = 0; bytes < sizeof SEGMENT WHOLE - 1; bytes++) { /* wherever it is cut */
        uint8_t *data = malloc(bytes + 1);
        cln_panorama is;

        assert_non_null(data);
        memcpy(data, SEGMENT WHOLE, bytes);
        is = cln_xmp_read_segment(data, bytes);
        assert_true(is == CLN_PANORAMA_UNTOLD || (is == CLN_PANORAMA_WHOLE && bytes > 60));
        free(data);
    }
    assert_int_equal(cln_xmp_read_segment((const uint8_t *)WHOLE, sizeof WHOLE),
                     CLN_PANORAMA_UNTOLD);
    assert_int_equal(cln_xmp_read_chunk((const uint8_t *)CHUNK WHOLE, sizeof CHUNK WHOLE - 1),
                     CLN_PANORAMA_WHOLE);
    assert_int_equal(cln_xmp_read_chunk((const uint8_t *)"XML:com.adobe.xmp\0\1\0\0\0" WHOLE,
                                        sizeof CHUNK WHOLE - 1),
                     CLN_PANORAMA_UNTOLD); /* compressed */
}

/* Puts bytes into a file's, at a place. */
static void put_with(const char *path, const char *file, size_t bytes, size_t at, const char *more,
                     size_t more_bytes)
{
    char *all = malloc(bytes + more_bytes);

    assert_non_null(all);
    memcpy(all, file, at);
    memcpy(all + at, more, more_bytes);
    memcpy(all + at + more_bytes, file + at, bytes - at);
    scratch_put(path, all, bytes + more_bytes);
    free(all);
}

/* In a file it is found, behind EXIF data of 2.6 mm or not. */
static void test_files(void **state)
{
    static const uint8_t pixels[4 * 2 * 3];
    char segment[sizeof SEGMENT WHOLE + 4] = "\xFF\xE1\0", chunk[sizeof CHUNK WHOLE + 12] = {0};
    char two[2 * (sizeof segment - 1)];
    const char *path = scratch_path(*state, "p");
    uint8_t *file = NULL;
    size_t bytes = 0;
    uint32_t sum = 0;
    cln_image_head head;

    segment[3] = (char)(sizeof SEGMENT WHOLE - 1 + 2);
    memcpy(segment + 4, SEGMENT WHOLE, sizeof SEGMENT WHOLE - 1);
    assert_int_equal(cln_image_encode_jpeg(4, 2, 3, pixels, 90, &file, &bytes), CLN_OK);
    scratch_put(path, (const char *)file, bytes);
    assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
    assert_int_equal(head.panorama, CLN_PANORAMA_UNTOLD);
    put_with(path, (const char *)file, bytes, 2, segment, sizeof SEGMENT WHOLE - 1 + 4);
    assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
    assert_int_equal(head.panorama, CLN_PANORAMA_WHOLE);
    for (int i = 0; i < 2; i++) /* and a block of another projection: the first counts */
        memcpy(two + i * (sizeof segment - 1), segment, sizeof segment - 1);
    two[sizeof two - 8] = 'X';
    put_with(path, (const char *)file, bytes, 2, two, sizeof two);
    assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
    assert_int_equal(head.panorama, CLN_PANORAMA_WHOLE);
    free(file);

    assert_int_equal(cln_image_encode_png(4, 2, 3, pixels, &file, &bytes), CLN_OK);
    chunk[3] = (char)(sizeof CHUNK WHOLE - 1);
    memcpy(chunk + 4, "iTXt" CHUNK WHOLE, sizeof CHUNK WHOLE - 1 + 4);
    sum = (uint32_t)crc32(0, (const Bytef *)chunk + 4, sizeof CHUNK WHOLE - 1 + 4);
    for (int i = 0; i < 4; i++)
        chunk[8 + sizeof CHUNK WHOLE - 1 + (size_t)i] = (char)(sum >> (24 - 8 * i));
    put_with(path, (const char *)file, bytes, 33, chunk, sizeof CHUNK WHOLE - 1 + 12);
    assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
    assert_int_equal(head.panorama, CLN_PANORAMA_WHOLE);
    free(file);
}

int test_group_xmp(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_panoramas),
        cmocka_unit_test_setup_teardown(test_files, scratch_make, scratch_remove)};

    return cmocka_run_group_tests_name("xmp", tests, NULL, NULL);
}
