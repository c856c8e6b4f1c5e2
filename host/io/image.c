/* Reads and writes PNG, reads JPEG. The only translation unit with stb_image and stb_image_write.
 * Not a general image library: 8-bit results in sRGB (colour.h), pixels as stored, whatever EXIF
 * data say (cln_image_turn turns them).
 *
 * Files are untrusted, so before stb decodes anything:
 *   1. our code reads the size from the header and checks it against the limits,
 *   2. our code walks the container to its end: PNG chunk lengths and CRCs up to IEND, JPEG
 *      segments and entropy-coded data up to EOI. stb checks neither, and fills missing data with
 *      grey,
 *   3. the size caps the decoder's largest single allocation, so that a small file cannot inflate
 *      to gigabytes.
 * stb_image 2.27 (Debian 12) needs that: without it damaged JPEGs write out of bounds. */
#include "io/image.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/colour.h"
#include "io/exif.h"
#include "io/xmp.h"

enum {
    FILE_MAX_BYTES = 1 << 30,
    HEAD_BYTES = 4096,    /* enough for most headers; else the whole file is read */
    PNG_CHUNK_BYTES = 12, /* length, type, CRC around the data of a chunk */
    PNG_IHDR_END = 33
};

/* Most bytes of one allocation by stb: set per decode, per thread. */
static _Thread_local size_t decoder_limit;

/* Zeroed: the JPEG decoder trusts tables that a damaged file never defines. */
static void *decoder_malloc(size_t bytes)
{
    return bytes <= decoder_limit ? calloc(bytes, 1) : NULL;
}

static void *decoder_realloc(void *p, size_t bytes)
{
    return bytes <= decoder_limit ? realloc(p, bytes) : NULL;
}

/* zlib compresses better and faster than the coder inside stb_image_write. The next levels take two
 * and four times as long for 3 and 6 % fewer bytes (docs/results.md, "Pictures in half the
 * time"). */
enum { PNG_LEVEL = 4, PNG_FILTER_UP = 2 };

static unsigned char *compress_png(unsigned char *data, int length, int *out_length, int quality)
{
    uLongf bytes = compressBound((uLong)length);
    unsigned char *out = malloc(bytes);

    (void)quality;
    if (out &&
        (compress2(out, &bytes, data, (uLong)length, PNG_LEVEL) != Z_OK || bytes > INT_MAX)) {
        free(out);
        out = NULL;
    }
    *out_length = out ? (int)bytes : 0;
    return out;
}

#define STBI_MALLOC(bytes)     decoder_malloc(bytes)
#define STBI_REALLOC(p, bytes) decoder_realloc(p, bytes)
#define STBI_FREE(p)           free(p)
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
#define STBI_MAX_DIMENSIONS CLN_IMAGE_MAX_SIDE
#define STB_IMAGE_IMPLEMENTATION
#include "stb_image.h"

#define STBI_WRITE_NO_STDIO
#define STBIW_ZLIB_COMPRESS compress_png
#define STB_IMAGE_WRITE_IMPLEMENTATION
#include "stb_image_write.h"

/* Contents of the header. problem: a reason to refuse the file, or NULL. cut: the data end before
 * the header does (in a whole walk: before the image does). */
typedef struct header {
    int64_t width, height;
    int channels;
    cln_exif exif;
    cln_panorama panorama;
    cln_colour_mark colour;
    bool png, cut;
    bool deep; /* 16 bits a value */
    bool grey;
    const char *problem;
} header;

/* The first that tells it counts. */
static void add_exif(header *head, cln_exif found)
{
    if (head->exif.orientation == 1)
        head->exif.orientation = found.orientation;
    if (head->exif.focal == 0)
        head->exif.focal = found.focal;
    if (head->exif.focal_film == 0)
        head->exif.focal_film = found.focal_film;
    if (head->exif.zoom == 1)
        head->exif.zoom = found.zoom;
    if (isnan(head->exif.gps[0]) || isnan(head->exif.gps[1]))
        memcpy(head->exif.gps, found.gps, sizeof head->exif.gps);
    head->colour.adobe = !head->png && (head->colour.adobe || found.adobe); /* DCF has no PNG */
}

static void add_xmp(header *head, cln_panorama found)
{
    if (head->panorama == CLN_PANORAMA_UNTOLD)
        head->panorama = found;
}

static uint32_t big_endian(const uint8_t *p, int bytes)
{
    uint32_t value = 0;

    for (int i = 0; i < bytes; i++)
        value = value << 8 | p[i];
    return value;
}

/* An iCCP chunk: a name, its end, a method of compression, the profile. */
static void add_iccp(header *head, const uint8_t *data, size_t bytes)
{
    const uint8_t *end = memchr(data, 0, bytes < 80 ? bytes : 80);
    const size_t skipped = end ? (size_t)(end - data) + 2 : bytes;

    if (skipped >= bytes)
        return;
    head->colour.parts = 1;
    head->colour.deflated = true;
    head->colour.part[1].at = data + skipped;
    head->colour.part[1].bytes = bytes - skipped;
}

static void add_colour_chunk(header *head, const uint8_t *type, size_t length)
{
    if (!memcmp(type, "iCCP", 4))
        add_iccp(head, type + 4, length);
    if (!memcmp(type, "sRGB", 4))
        head->colour.srgb = true;
    if (!memcmp(type, "gAMA", 4) && length == 4)
        head->colour.gamma = 1e-5 * big_endian(type + 4, 4);
    for (int i = 0; !memcmp(type, "cHRM", 4) && length == 32 && i < 8; i++)
        head->colour.chroma[i] = 1e-5 * big_endian(type + 4 + 4 * i, 4);
}

/* An APP2 segment that has a part of a profile: a mark, its number and how many there are. */
static void add_icc(header *head, const uint8_t *data, size_t bytes)
{
    static const char mark[12] = "ICC_PROFILE";

    if (bytes < 14 || memcmp(data, mark, sizeof mark) != 0 || data[12] == 0 || data[12] > data[13])
        return;
    head->colour.parts = data[13];
    head->colour.part[data[12]].at = data + 14;
    head->colour.part[data[12]].bytes = bytes - 14;
}

/* Walks PNG chunks. Without `whole`, only up to the first IDAT (tRNS, which adds alpha, comes
 * before it); with it, to IEND, checking the CRC of every chunk that shapes the pixels. */
static void walk_png(const uint8_t *data, size_t bytes, bool whole, header *head)
{
    size_t at = 8;
    bool pixels = false;

    head->png = true;
    if (bytes < PNG_IHDR_END) {
        head->cut = true;
        return;
    }
    if (big_endian(data + 8, 4) != 13 || memcmp(data + 12, "IHDR", 4) != 0) {
        head->problem = "damaged PNG (no IHDR chunk); copy it again";
        return;
    }
    head->width = big_endian(data + 16, 4);
    head->height = big_endian(data + 20, 4);
    head->deep = data[24] == 16;
    head->grey = !(data[25] & 3);
    head->channels = data[25] & 4 ? 4 : 3;
    for (;;) {
        size_t length = 0;
        const uint8_t *type = NULL;

        if (bytes - at < PNG_CHUNK_BYTES) {
            head->cut = true;
            return;
        }
        length = big_endian(data + at, 4);
        type = data + at + 4;
        if (!memcmp(type, "IDAT", 4)) {
            pixels = true;
            if (!whole)
                return;
        }
        if (!memcmp(type, "tRNS", 4) && !pixels)
            head->channels = 4;
        if (length > bytes - at - PNG_CHUNK_BYTES) {
            head->cut = true;
            return;
        }
        if (!memcmp(type, "eXIf", 4))
            add_exif(head, cln_exif_read_tiff(type + 4, length));
        if (!memcmp(type, "iTXt", 4))
            add_xmp(head, cln_xmp_read_chunk(type + 4, length));
        if (!pixels)
            add_colour_chunk(head, type, length);
        /* Capital first letter: critical chunk. A bad text chunk or profile harms no pixel. */
        if (whole && (!(type[0] & 32) || !memcmp(type, "tRNS", 4)) &&
            crc32(0, type, (uInt)length + 4) != big_endian(type + 4 + length, 4)) {
            head->problem = "damaged PNG (checksum of a chunk is wrong); copy it again";
            return;
        }
        if (!memcmp(type, "IEND", 4)) {
            if (!pixels)
                head->problem = "damaged PNG (no image data); copy it again";
            return;
        }
        at += length + PNG_CHUNK_BYTES;
    }
}

/* Position of the next marker byte (after 0xFF and fill bytes) from `at` on, or `bytes`. In
 * entropy-coded data FF00 is a data byte and FFD0..FFD7 are restarts. */
static size_t next_marker(const uint8_t *data, size_t bytes, size_t at, bool entropy)
{
    while (at < bytes) {
        const uint8_t *ff = memchr(data + at, 0xFF, bytes - at);

        if (!ff)
            break;
        at = (size_t)(ff - data) + 1;
        while (at < bytes && data[at] == 0xFF)
            at++;
        if (at < bytes && data[at] != 0 && !(entropy && data[at] >= 0xD0 && data[at] <= 0xD7))
            return at;
    }
    return bytes;
}

/* Checks the Huffman tables of a DHT segment (after its length): 16 counts, then as many symbols.
 * The decoder writes beyond its own tables if the counts add up to more than 256. */
static bool huffman_tables_fit(const uint8_t *p, size_t bytes)
{
    while (bytes >= 17) {
        size_t symbols = 0;

        for (int i = 1; i <= 16; i++)
            symbols += p[i];
        if (symbols > 256 || bytes < 17 + symbols)
            return false;
        p += 17 + symbols;
        bytes -= 17 + symbols;
    }
    return bytes == 0;
}

/* Walks JPEG segments: to the frame header, or with `whole` to EOI. APP segments are skipped with
 * the thumbnails in them, so a thumbnail's EOI does not count. */
static void walk_jpeg(const uint8_t *data, size_t bytes, bool whole, header *head)
{
    size_t at = 2;
    bool entropy = false;

    head->channels = 3;
    for (;;) {
        size_t length = 0;
        uint8_t marker = 0;

        at = next_marker(data, bytes, at, entropy);
        if (at < bytes && data[at] == 0xD9)
            break;
        if (bytes - at < 3) {
            head->cut = true;
            return;
        }
        marker = data[at];
        at++;
        if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8))
            continue;
        length = big_endian(data + at, 2);
        if (length < 2) {
            head->problem = "damaged JPEG (segment length); copy it again";
            return;
        }
        if (length > bytes - at) {
            head->cut = true;
            return;
        }
        if (marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 &&
            marker != 0xCC) {
            if (marker > 0xC2)
                head->problem = "JPEG of a kind that is not read (lossless or arithmetic coding); "
                                "save it again";
            else if (length < 11 || head->width)
                head->problem = "damaged JPEG (frame header); copy it again";
            if (head->problem)
                return;
            head->height = big_endian(data + at + 3, 2);
            head->width = big_endian(data + at + 5, 2);
            if (!whole)
                return;
        }
        if (marker == 0xE1) {
            add_exif(head, cln_exif_read(data + at + 2, length - 2));
            add_xmp(head, cln_xmp_read_segment(data + at + 2, length - 2));
        }
        if (marker == 0xE2)
            add_icc(head, data + at + 2, length - 2);
        if (marker == 0xC4 && !huffman_tables_fit(data + at + 2, length - 2)) {
            head->problem = "damaged JPEG (Huffman tables); copy it again";
            return;
        }
        entropy = marker == 0xDA;
        at += length;
    }
    if (!head->width)
        head->problem = "damaged JPEG (no frame header); copy it again";
}

static void walk(const uint8_t *data, size_t bytes, bool whole, header *head)
{
    static const uint8_t png[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};

    static const struct {
        size_t at;
        const char *mark, *problem;
    } others[] = {
#define OTHER(at, mark, name) \
    {at, mark, "is " name ", which is not read; convert it to PNG or JPEG"}
#define HEIC "HEIC (of which heif-convert makes JPEG)"
        OTHER(8, "WEBP", "WebP"),      OTHER(0, "GIF8", "GIF"),
        OTHER(0, "BM", "BMP"),         OTHER(0, "II*", "TIFF or a camera's raw format"),
        OTHER(0, "MM", "TIFF"),        OTHER(4, "ftyphe", HEIC),
        OTHER(4, "ftypmif", HEIC),     OTHER(4, "ftypavif", "AVIF"),
        OTHER(0, "v/1\x01", "OpenEXR")};
#undef HEIC
#undef OTHER

    memset(head, 0, sizeof *head);
    head->exif = cln_exif_read(NULL, 0);
    if (bytes == 0)
        head->problem = "empty file; copy it again";
    else if (bytes >= 8 && !memcmp(data, png, 8))
        walk_png(data, bytes, whole, head);
    else if (bytes >= 3 && data[0] == 0xFF && data[1] == 0xD8 && data[2] == 0xFF)
        walk_jpeg(data, bytes, whole, head);
    else
        head->problem = "not a PNG or JPEG image; convert it to one";
    for (size_t i = 0; head->problem && i < sizeof others / sizeof others[0]; i++) {
        const size_t n = strlen(others[i].mark);

        if (bytes >= others[i].at + n && memcmp(data + others[i].at, others[i].mark, n) == 0)
            head->problem = others[i].problem;
    }
}

/* Sizes first: the user can act on them even if the rest is cut. */
static cln_status check_header(const char *path, const header *head)
{
    if (head->problem)
        return cln_fail(CLN_INPUT, "%s: %s", path, head->problem);
    if (head->width > CLN_IMAGE_MAX_SIDE || head->height > CLN_IMAGE_MAX_SIDE ||
        head->width * head->height > CLN_IMAGE_MAX_PIXELS)
        return cln_fail(CLN_INPUT,
                        "%s: %lld x %lld pixels, more than the %d a side or %d in all that are "
                        "accepted; make the image smaller",
                        path, (long long)head->width, (long long)head->height, CLN_IMAGE_MAX_SIDE,
                        CLN_IMAGE_MAX_PIXELS);
    if (head->cut)
        return cln_fail(CLN_INPUT, "%s: truncated %s, the file ends too early; copy it again", path,
                        head->png ? "PNG" : "JPEG");
    if (head->width < 1 || head->height < 1)
        return cln_fail(CLN_INPUT,
                        "%s: image without pixels (%lld x %lld); copy or export it again", path,
                        (long long)head->width, (long long)head->height);
    return CLN_OK;
}

cln_status cln_image_read_head(const char *path, cln_image_head *out)
{
    cln_status st = CLN_OK;
    FILE *file = NULL;
    uint8_t start[HEAD_BYTES];
    char *all = NULL;
    size_t bytes = 0;
    header head;

    errno = 0;
    if (!cln_is_file(path) || !(file = fopen(path, "rb")))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path,
                         errno              ? strerror(errno)
                         : cln_is_dir(path) ? "is a folder, not an image"
                                            : "not a regular file"));
    bytes = fread(start, 1, sizeof start, file);
    if (ferror(file))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path, strerror(errno)));
    walk(start, bytes, false, &head);
    if (head.cut && bytes == sizeof start) {
        CLN_TRY(cln_read_file(path, FILE_MAX_BYTES, &all, &bytes));
        walk((const uint8_t *)all, bytes, false, &head);
    }
    CLN_TRY(check_header(path, &head));
    *out = (cln_image_head){.width = (int)head.width,
                            .height = (int)head.height,
                            .channels = head.channels,
                            .orientation = head.exif.orientation,
                            .focal = head.exif.focal,
                            .focal_film = head.exif.focal_film,
                            .zoom = head.exif.zoom,
                            .panorama = head.panorama,
                            .jpeg = !head.png,
                            .deep_grey = head.deep && head.grey};
    memcpy(out->gps, head.exif.gps, sizeof out->gps);
    out->colour = cln_colour_of(&head.colour, out->profile);
done:
    free(all);
    if (file)
        fclose(file);
    return st;
}

cln_status cln_image_info(const char *path, int *width, int *height, int *channels)
{
    cln_image_head head;
    const cln_status st = cln_image_read_head(path, &head);

    if (st != CLN_OK)
        return st;
    *width = head.width;
    *height = head.height;
    *channels = head.channels;
    return CLN_OK;
}

cln_status cln_image_check(const char *path)
{
    cln_status st = CLN_OK;
    char *data = NULL;
    size_t bytes = 0;
    header head;

    CLN_TRY(cln_read_file(path, FILE_MAX_BYTES, &data, &bytes));
    walk((const uint8_t *)data, bytes, true, &head);
    CLN_TRY(check_header(path, &head));
done:
    free(data);
    return st;
}

cln_status cln_image_check_ends(const char *path)
{
    static const uint8_t jpeg_end[] = {0xFF, 0xD9};
    static const uint8_t png_end[] = {0, 0, 0, 0, 'I', 'E', 'N', 'D', 0xAE, 0x42, 0x60, 0x82};
    cln_image_head head;
    uint8_t last[sizeof png_end];
    const cln_status st = cln_image_read_head(path, &head);
    size_t n = 0;
    FILE *file = NULL;
    bool ended = false;

    if (st != CLN_OK)
        return st;
    n = head.jpeg ? sizeof jpeg_end : sizeof png_end;
    file = fopen(path, "rb");
    ended = file && fseek(file, -(long)n, SEEK_END) == 0 && fread(last, 1, n, file) == n &&
            memcmp(last, head.jpeg ? jpeg_end : png_end, n) == 0;
    if (file)
        fclose(file);
    return ended ? CLN_OK : cln_image_check(path);
}

/* Values of 16 bits, in sRGB or rounded to 8; the decoder by itself cuts them. */
static cln_status from_deep(const header *head, const uint16_t *deep, uint8_t **pixels)
{
    const size_t count = (size_t)head->width * (size_t)head->height;
    const size_t values = count * (size_t)head->channels;
    cln_status st = CLN_OK;
    bool done = false;

    CLN_TRY(cln_alloc(pixels, values, 1, "image"));
    CLN_TRY(cln_colour_convert(&head->colour, count, head->channels, true, deep, *pixels, &done));
    for (size_t i = 0; i < values && !done; i++) {
        const uint32_t value = deep[i];

        (*pixels)[i] = (uint8_t)((value * 255 + 32767) / 65535);
    }
done:
    return st;
}

/* Checks the file's header and decodes it, to values of 16 bits if `wide`. */
static cln_status decode(const char *path, const void *data, size_t bytes, const header *head,
                         bool wide, int channels, void **decoded)
{
    int w = 0, h = 0, file_channels = 0;

    if (bytes > INT_MAX)
        return cln_fail(CLN_INPUT, "%s: %zu bytes are too large for an image; make a smaller copy",
                        path, bytes);
    /* Enough for 16-bit RGBA twice (inflate doubles its buffer), a progressive JPEG's coefficients
     * padded to blocks of 32 pixels, the file, and the decoder's tables. */
    decoder_limit =
        (size_t)(head->width + 64) * (size_t)(head->height + 64) * 32 + bytes + (1 << 20);
    *decoded =
        wide ? (void *)stbi_load_16_from_memory(data, (int)bytes, &w, &h, &file_channels, channels)
             : stbi_load_from_memory(data, (int)bytes, &w, &h, &file_channels, channels);
    if (!*decoded)
        return cln_fail(CLN_INPUT,
                        "%s: damaged or unsupported %s (decoder: %s); save the image again", path,
                        head->png ? "PNG" : "JPEG", stbi_failure_reason());
    CLN_ASSERT(w == head->width && h == head->height);
    return CLN_OK;
}

cln_status cln_image_decode(const char *path, const void *data, size_t bytes, int *width,
                            int *height, int *channels, uint8_t **pixels)
{
    header head;
    cln_status st = CLN_OK;
    void *decoded = NULL;
    bool done = false;

    *pixels = NULL;
    walk(data, bytes, true, &head);
    CLN_TRY(check_header(path, &head));
    CLN_TRY(decode(path, data, bytes, &head, head.deep, head.channels, &decoded));
    *width = (int)head.width;
    *height = (int)head.height;
    *channels = head.channels;
    if (head.deep) {
        CLN_TRY(from_deep(&head, decoded, pixels));
    } else {
        CLN_TRY(cln_colour_convert(&head.colour, (size_t)head.width * (size_t)head.height,
                                   head.channels, false, decoded, decoded, &done));
        *pixels = decoded;
        decoded = NULL;
    }
done:
    free(decoded);
    if (st != CLN_OK) {
        free(*pixels);
        *pixels = NULL;
    }
    return st;
}

cln_status cln_image_load_grey(const char *path, int *width, int *height, bool *deep,
                               uint16_t **values)
{
    cln_status st = CLN_OK;
    header head;
    char *data = NULL;
    void *decoded = NULL;
    size_t bytes = 0, count = 0;

    *values = NULL;
    CLN_TRY(cln_read_file(path, FILE_MAX_BYTES, &data, &bytes));
    walk((const uint8_t *)data, bytes, true, &head);
    CLN_TRY(check_header(path, &head));
    if (!head.png || !head.grey)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: not a grey PNG; export it again", path));
    CLN_TRY(decode(path, data, bytes, &head, true, 1, &decoded));
    *values = decoded;
    *width = (int)head.width;
    *height = (int)head.height;
    *deep = head.deep;
    count = (size_t)head.width * (size_t)head.height;
    for (size_t i = 0; !head.deep && i < count; i++)
        (*values)[i] /= 257; /* as the decoder widened it */
done:
    free(data);
    return st;
}

void cln_image_divide_alpha(uint8_t *pixels, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint8_t *p = pixels + 4 * i;

        for (int c = 0; c < 3 && p[3] > 0; c++) {
            const int value = (255 * p[c] + p[3] / 2) / p[3];

            p[c] = (uint8_t)(value < 255 ? value : 255);
        }
    }
}

cln_status cln_image_load(const char *path, int *width, int *height, int *channels,
                          uint8_t **pixels)
{
    cln_status st = CLN_OK;
    char *data = NULL;
    size_t bytes = 0;

    *pixels = NULL;
    CLN_TRY(cln_read_file(path, FILE_MAX_BYTES, &data, &bytes));
    CLN_TRY(cln_image_decode(path, data, bytes, width, height, channels, pixels));
done:
    free(data);
    return st;
}

/* numerator / denominator to the nearest integer, halves up; 0 if the denominator is 0. */
static uint8_t rounded_ratio(uint64_t numerator, uint64_t denominator)
{
    return denominator ? (uint8_t)((2 * numerator + denominator) / (2 * denominator)) : 0;
}

cln_status cln_image_downscale(int n, int *width, int *height, int channels, uint8_t **pixels)
{
    const int w = n > 0 ? *width / n : 0, h = n > 0 ? *height / n : 0;
    const uint64_t area = (uint64_t)n * (uint64_t)n;
    const size_t row = (size_t)*width * (size_t)channels;
    const uint8_t *in = *pixels;
    uint8_t *out = *pixels, *shrunk = NULL;

    CLN_ASSERT(channels == 3 || channels == 4);
    if (w < 1 || h < 1)
        return cln_fail(CLN_INPUT, "downscale %d leaves nothing of a %d x %d image; choose less", n,
                        *width, *height);
    if (n == 1)
        return CLN_OK;
    /* In place: a mean is written at or before its block. */
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            uint64_t sum[4] = {0}, alpha = 0;

            for (int j = 0; j < n; j++) {
                const uint8_t *p = in + ((size_t)y * (size_t)n + (size_t)j) * row +
                                   (size_t)x * (size_t)n * (size_t)channels;

                for (int i = 0; i < n; i++, p += channels) {
                    const uint64_t a = channels == 4 ? p[3] : 1;

                    alpha += a;
                    for (int c = 0; c < 3; c++)
                        sum[c] += a * p[c];
                }
            }
            for (int c = 0; c < 3; c++)
                *out++ = rounded_ratio(sum[c], alpha);
            if (channels == 4)
                *out++ = rounded_ratio(alpha, area);
        }
    shrunk = realloc(*pixels, (size_t)w * (size_t)h * (size_t)channels);
    if (shrunk)
        *pixels = shrunk;
    *width = w;
    *height = h;
    return CLN_OK;
}

cln_status cln_image_turn(int orientation, int *width, int *height, int channels, uint8_t **pixels)
{
    cln_status st = CLN_OK;
    const size_t w = (size_t)*width, h = (size_t)*height, n = (size_t)channels;
    const bool swapped = orientation >= 5;
    const size_t columns = swapped ? h : w, rows = swapped ? w : h;
    /* where the stored picture's first column and first row come to lie: at the far end? */
    const bool far_column =
        orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool far_row =
        orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    uint8_t *turned = NULL, *to = NULL;

    CLN_ASSERT(orientation >= 1 && orientation <= 8);
    if (orientation == 1)
        return CLN_OK;
    CLN_TRY(cln_alloc(&turned, w * h, n, "a turned image"));
    to = turned;
    for (size_t y = 0; y < rows; y++)
        for (size_t x = 0; x < columns; x++, to += n) {
            const size_t column = swapped ? y : x, row = swapped ? x : y;
            const size_t from_x = far_column ? w - 1 - column : column;
            const size_t from_y = far_row ? h - 1 - row : row;

            memcpy(to, *pixels + (from_y * w + from_x) * n, n);
        }
    free(*pixels);
    *pixels = turned;
    *width = (int)columns;
    *height = (int)rows;
done:
    return st;
}

bool cln_image_alike(int width, int height, int other_width, int other_height)
{
    const double a = (double)width * other_height, b = (double)height * other_width;

    return fabs(a - b) < fmax(fmax(width, height), fmax(other_width, other_height));
}

cln_status cln_image_fit(int to_width, int to_height, int *width, int *height, int channels,
                         uint8_t **pixels)
{
    cln_status st = CLN_OK;
    const size_t step = (size_t)channels;
    uint8_t *out = NULL;

    if (*width == to_width && *height == to_height)
        return CLN_OK;
    CLN_TRY(cln_alloc(&out, (size_t)to_width * (size_t)to_height, step, "a mask"));
    for (int y = 0; y < to_height; y++)
        for (int x = 0; x < to_width; x++) {
            const int64_t column = (2 * (int64_t)x + 1) * *width / (2 * (int64_t)to_width);
            const int64_t row = (2 * (int64_t)y + 1) * *height / (2 * (int64_t)to_height);

            memcpy(out + step * ((size_t)y * (size_t)to_width + (size_t)x),
                   *pixels + step * (size_t)(row * *width + column), step);
        }
    free(*pixels);
    *pixels = out;
    *width = to_width;
    *height = to_height;
done:
    return st;
}

cln_status cln_image_put_alpha(size_t count, const uint8_t *alpha, int alpha_channels,
                               int *channels, uint8_t **pixels)
{
    cln_status st = CLN_OK;
    uint8_t *both = NULL;

    CLN_TRY(cln_alloc(&both, count, 4, "an image with alpha"));
    for (size_t i = 0; i < count; i++) {
        const uint8_t *mask = alpha + (size_t)alpha_channels * i;

        memcpy(both + 4 * i, *pixels + (size_t)*channels * i, 3);
        for (int c = 0; c < 3; c++)
            if (both[4 * i + 3] < mask[c])
                both[4 * i + 3] = mask[c];
    }
    free(*pixels);
    *pixels = both;
    *channels = 4;
done:
    return st;
}

cln_status cln_image_encode_png(int width, int height, int channels, const uint8_t *pixels,
                                uint8_t **out, size_t *bytes)
{
    int length = 0;

    *out = NULL;
    *bytes = 0;
    CLN_ASSERT(channels == 1 || channels == 3 || channels == 4);
    if (width < 1 || height < 1 || width > CLN_IMAGE_MAX_SIDE || height > CLN_IMAGE_MAX_SIDE ||
        ((int64_t)width * channels + 1) * height > INT_MAX / 2)
        return cln_fail(CLN_OUTPUT, "cannot make a PNG of %d x %d pixels; the limit is %d a side",
                        width, height, CLN_IMAGE_MAX_SIDE);
    stbi_write_force_png_filter = PNG_FILTER_UP; /* the best of five, by row, gains nothing */
    *out = stbi_write_png_to_mem(pixels, 0, width, height, channels, &length);
    if (!*out)
        return cln_fail(CLN_MEMORY, "no memory to encode a PNG of %d x %d pixels", width, height);
    *bytes = (size_t)length;
    return CLN_OK;
}

cln_status cln_image_write_png(const char *path, int width, int height, int channels,
                               const uint8_t *pixels)
{
    cln_status st = CLN_OK;
    uint8_t *png = NULL;
    size_t bytes = 0;

    CLN_TRY(cln_image_encode_png(width, height, channels, pixels, &png, &bytes));
    CLN_TRY(cln_write_file(path, png, bytes));
done:
    if (st != CLN_OK)
        cln_note("writing %s", path);
    free(png);
    return st;
}

typedef struct growing {
    uint8_t *data;
    size_t bytes, room;
    bool failed;
} growing;

static void grow(void *context, void *data, int length)
{
    growing *to = context;
    const size_t needed = to->bytes + (size_t)length;

    if (needed > to->room) {
        uint8_t *larger = realloc(to->data, 2 * needed);

        to->failed = to->failed || !larger;
        if (!larger)
            return;
        to->data = larger;
        to->room = 2 * needed;
    }
    memcpy(to->data + to->bytes, data, (size_t)length);
    to->bytes = needed;
}

cln_status cln_image_encode_jpeg(int width, int height, int channels, const uint8_t *pixels,
                                 int quality, uint8_t **out, size_t *bytes)
{
    growing to = {0};

    *out = NULL;
    *bytes = 0;
    CLN_ASSERT(channels == 1 || channels == 3);
    if (width < 1 || height < 1 || width > CLN_IMAGE_MAX_SIDE || height > CLN_IMAGE_MAX_SIDE)
        return cln_fail(CLN_OUTPUT, "cannot make a JPEG of %d x %d pixels; the limit is %d a side",
                        width, height, CLN_IMAGE_MAX_SIDE);
    if (!stbi_write_jpg_to_func(grow, &to, width, height, channels, pixels, quality) || to.failed) {
        free(to.data);
        return cln_fail(CLN_MEMORY, "no memory to encode a JPEG of %d x %d pixels", width, height);
    }
    *out = to.data;
    *bytes = to.bytes;
    return CLN_OK;
}

uint8_t cln_to_u8(float value)
{
    if (!(value > 0)) /* NaN too */
        return 0;
    return value >= 1 ? 255 : (uint8_t)(value * 255 + 0.5f);
}

uint16_t cln_to_u16(float value)
{
    if (!(value > 0))
        return 0;
    return value >= 1 ? 65535 : (uint16_t)(value * 65535 + 0.5f);
}
