/* See held.h. Orientations by the EXIF standard: where the stored picture's first row and first
 * column are seen. */
#include "held.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "base/files.h"
#include "base/memory.h"

void held_camera(int orientation, cln_camera *camera)
{
    for (int a = 0; a < 3; a++) {
        const double right = camera->c2w[4 * a], down = camera->c2w[4 * a + 1];
        double *x = &camera->c2w[4 * a], *y = &camera->c2w[4 * a + 1];

        if (orientation == 3) { /* first row below, first column at the right */
            *x = -right;
            *y = -down;
        } else if (orientation == 6) { /* first row at the right, first column above */
            *x = down;
            *y = -right;
        } else if (orientation == 8) { /* first row at the left, first column below */
            *x = -down;
            *y = right;
        }
    }
    camera->height = camera->width / 4 * 3;
    camera->cy = 0.5 * camera->height;
}

cln_status held_tag(const char *png, int orientation)
{
    enum { HEAD = 8 + 25, EXIF = 26, CHUNK = 12 + EXIF }; /* bytes: signature and IHDR */
    cln_status st = CLN_OK;
    uint8_t chunk[CHUNK] = {
        0, 0,    0, EXIF, 'e', 'X', 'I', 'f', 'M', 'M',
        0, 42,   0, 0,    0,   8,   0,   1, /* one entry: 0x112, a number of 16 bits */
        1, 0x12, 0, 3,    0,   0,   0,   1,   0,   (uint8_t)orientation};
    const uLong sum = crc32(0, chunk + 4, 4 + EXIF);
    char *data = NULL, *tagged = NULL;
    size_t bytes = 0;

    for (int i = 0; i < 4; i++)
        chunk[CHUNK - 4 + i] = (uint8_t)(sum >> (24 - 8 * i));
    CLN_TRY(cln_read_file(png, SIZE_MAX, &data, &bytes));
    CLN_TRY(cln_alloc(&tagged, bytes + CHUNK, 1, "a picture"));
    memcpy(tagged, data, HEAD);
    memcpy(tagged + HEAD, chunk, CHUNK);
    memcpy(tagged + HEAD + CHUNK, data + HEAD, bytes - HEAD);
    CLN_TRY(cln_write_file(png, tagged, bytes + CHUNK));
done:
    free(data);
    free(tagged);
    return st;
}
