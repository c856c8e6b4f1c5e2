/* The table of the report's sections, and what they write in common. See report_sections.h. */
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include "base/files.h"
#include "io/image.h"
#include "report/html.h"

enum { PICTURE_WIDTH = 400 };

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

cln_status cln_report_picture(FILE *to, const char *path, const char *view, const char *what)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    uint8_t *pixels = NULL, *png = NULL;
    size_t bytes = 0;
    int width = 0, height = 0, channels = 0;

    if (!cln_is_file(path) || cln_image_load(path, &width, &height, &channels, &pixels) != CLN_OK) {
        if (before == CLN_OK)
            cln_clear_error();
        fprintf(to, "<span class=none>no %s picture</span>", what);
        goto done;
    }
    if (width >= 2 * PICTURE_WIDTH && height >= 2)
        CLN_TRY(cln_image_downscale(width / PICTURE_WIDTH < height ? width / PICTURE_WIDTH : height,
                                    &width, &height, channels, &pixels));
    CLN_TRY(cln_image_encode_png(width, height, channels, pixels, &png, &bytes));
    fprintf(to, "<img width=%d height=%d alt=\"%s of ", width, height, what);
    cln_html_text(to, view);
    fputs("\" src=\"data:image/png;base64,", to);
    cln_base64_write(to, png, bytes);
    fputs("\">", to);
done:
    free(pixels);
    free(png);
    return st;
}
