/* The table of the report's sections, and what they write in common. See report_sections.h. */
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "device/device.h"
#include "io/image.h"
#include "io/json.h"
#include "report/html.h"

enum { PICTURE_WIDTH = 400, JPEG_QUALITY = 80 };

#define ROW(id, title, function, when) {id, title, function, when},
const cln_report_section cln_report_sections[] = {CLN_REPORT_SECTIONS(ROW)};
#undef ROW
const int cln_report_section_count = sizeof cln_report_sections / sizeof cln_report_sections[0];

bool cln_report_always(const cln_report_data *data)
{
    (void)data;
    return true;
}

void cln_report_number(FILE *to, double value, int decimals)
{
    if (isfinite(value))
        fprintf(to, "%.*f", decimals, value);
    else
        fputs("&ndash;", to);
}

bool cln_report_of_voxels(const cln_report_data *data)
{
    const json_t *config = json_object_get(data->run, "config");

    return strcmp(cln_json_text(config, "encoding"), "voxel") == 0;
}

const char *cln_report_stage(const cln_report_data *data, const char *name)
{
    return cln_stage_text(name, cln_report_of_voxels(data));
}

/* PNG, or JPEG if that is smaller, as for photos: a page may be mailed and opened on a phone. The
 * files in eval/ keep all details. *type: "png" or "jpeg". */
static cln_status encode(int width, int height, int channels, const uint8_t *pixels,
                         const char **type, uint8_t **out, size_t *bytes)
{
    cln_status st = CLN_OK;
    uint8_t *png = NULL;
    size_t png_bytes = 0;

    *type = "png";
    CLN_TRY(cln_image_encode_png(width, height, channels, pixels, &png, &png_bytes));
    if (channels == 1 || channels == 3) {
        CLN_TRY(cln_image_encode_jpeg(width, height, channels, pixels, JPEG_QUALITY, out, bytes));
        if (*bytes < png_bytes) {
            *type = "jpeg";
            goto done;
        }
    }
    free(*out);
    *out = png;
    *bytes = png_bytes;
    png = NULL;
done:
    free(png);
    return st;
}

cln_status cln_report_picture(FILE *to, const char *path, const json_t *image, const char *what)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    uint8_t *pixels = NULL, *file = NULL;
    const char *type = NULL;
    const json_int_t turn = json_integer_value(json_object_get(image, "turn"));
    size_t bytes = 0;
    int width = 0, height = 0, channels = 0, smaller = 0;

    if (!cln_is_file(path) || cln_image_load(path, &width, &height, &channels, &pixels) != CLN_OK) {
        if (before == CLN_OK)
            cln_clear_error();
        fprintf(to, "<span class=none>no %s picture</span>", what);
        goto done;
    }
    if (turn > 1 && turn <= 8)
        CLN_TRY(cln_image_turn((int)turn, &width, &height, channels, &pixels));
    smaller = (width + PICTURE_WIDTH / 2) / PICTURE_WIDTH;
    if (smaller >= 2 && height >= 2)
        CLN_TRY(cln_image_downscale(smaller < height ? smaller : height, &width, &height, channels,
                                    &pixels));
    CLN_TRY(encode(width, height, channels, pixels, &type, &file, &bytes));
    fprintf(to, "<img width=%d height=%d alt=\"%s of ", width, height, what);
    cln_html_text(to, cln_json_text(image, "name"));
    fprintf(to, "\" src=\"data:image/%s;base64,", type);
    cln_base64_write(to, file, bytes);
    fputs("\">", to);
done:
    free(pixels);
    free(file);
    return st;
}
