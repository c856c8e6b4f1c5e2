/* XMP is XML behind a name that ends with a zero; its values stand as attributes, NAME="VALUE", or
 * as elements, <NAME>VALUE</NAME>. See xmp.h. */
#include "io/xmp.h"

#include <string.h>
#include "base/number.h"

static const char SEGMENT[] = "http://ns.adobe.com/xap/1.0/", CHUNK[] = "XML:com.adobe.xmp";

/* Of a text that does not end with a zero. */
typedef struct span {
    const char *at;
    size_t bytes;
} span;

static const char *find(span text, const char *what)
{
    const size_t length = strlen(what);

    for (size_t i = 0; i + length <= text.bytes; i++)
        if (text.at[i] == *what && memcmp(text.at + i, what, length) == 0)
            return text.at + i;
    return NULL;
}

/* Copies the value of a name; "" if it has none. */
static void value_of(span text, const char *name, char out[32])
{
    const char *at = find(text, name), *end = text.at + text.bytes;
    size_t n = 0;

    if (at) {
        at += strlen(name);
        while (at < end && strchr(" \t\r\n=\"'>", *at))
            at++;
        while (at + n < end && n < 31 && !strchr("\"'<", at[n]))
            n++;
        memcpy(out, at, n);
    }
    out[n] = 0;
}

static double number_of(span text, const char *name)
{
    char value[32];
    const char *end = NULL;
    double number = 0;

    value_of(text, name, value);
    return cln_number_read(value, &number, &end) ? number : 0;
}

static cln_panorama read_text(span text)
{
    const double near = 0.99; /* programs round */
    char projection[32];
    double part[2], whole[2];

    value_of(text, "GPano:ProjectionType", projection);
    if (strncmp(projection, "equirectangular", 15) != 0)
        return CLN_PANORAMA_UNTOLD;
    part[0] = number_of(text, "GPano:CroppedAreaImageWidthPixels");
    part[1] = number_of(text, "GPano:CroppedAreaImageHeightPixels");
    whole[0] = number_of(text, "GPano:FullPanoWidthPixels");
    whole[1] = number_of(text, "GPano:FullPanoHeightPixels");
    for (int i = 0; i < 2; i++)
        if (part[i] > 0 && part[i] < near * whole[i])
            return CLN_PANORAMA_CUT;
    return CLN_PANORAMA_WHOLE;
}

cln_panorama cln_xmp_read_segment(const uint8_t *data, size_t bytes)
{
    if (bytes < sizeof SEGMENT || memcmp(data, SEGMENT, sizeof SEGMENT) != 0)
        return CLN_PANORAMA_UNTOLD;
    return read_text((span){(const char *)data + sizeof SEGMENT, bytes - sizeof SEGMENT});
}

cln_panorama cln_xmp_read_chunk(const uint8_t *data, size_t bytes)
{
    /* behind the name: compressed or not, and how; language and name, both empty */
    if (bytes < sizeof CHUNK + 2 || memcmp(data, CHUNK, sizeof CHUNK) != 0 ||
        data[sizeof CHUNK] != 0)
        return CLN_PANORAMA_UNTOLD;
    return read_text((span){(const char *)data + sizeof CHUNK, bytes - sizeof CHUNK});
}
