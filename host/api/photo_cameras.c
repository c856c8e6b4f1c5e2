/* Groups photos by size and focal length. See photo_cameras.h. */
#include "api/photo_cameras.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/image.h"

static const double ALIKE = 1.02; /* times: EXIF data are rounded */

/* A camera's size and focal length are those of its first photo. On 35 mm film, the length tells
 * what was cut off, too, but programs that change photos may drop it. */
static bool took(const cln_image_head *first, const cln_image_head *photo)
{
    const bool film = first->focal_film > 0 && photo->focal_film > 0;
    const double a = film ? first->focal_film : first->focal;
    const double b = film ? photo->focal_film : photo->focal;

    if (first->width != photo->width || first->height != photo->height)
        return false;
    if (!film && (!(a > 0) || !(b > 0))) /* they cannot be compared: both without any? */
        return fmax(first->focal, first->focal_film) == 0 &&
               fmax(photo->focal, photo->focal_film) == 0;
    return fmax(a, b) <= ALIKE * fmin(a, b);
}

/* mm: those of cameras that see all around have 1.0 to 1.4, those of phones 1.5 and more. */
static const double SHORTEST = 1.45;

cln_status cln_photo_cameras_find(const char *folder, const cln_names *photos,
                                  cln_photo_cameras *out)
{
    cln_status st = CLN_OK;
    const size_t most = (size_t)photos->count + 1;
    cln_image_head head, *first = NULL; /* [camera] */
    char *path = NULL;

    *out = (cln_photo_cameras){0};
    CLN_TRY(cln_alloc(&out->camera, most, sizeof *out->camera, "photos"));
    CLN_TRY(cln_alloc(&out->photos, most, sizeof *out->photos, "photos"));
    CLN_TRY(cln_alloc(&first, most, sizeof *first, "photos"));
    for (int i = 0; i < photos->count; i++) {
        int camera = 0;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, photos->name[i]));
        CLN_TRY(cln_image_read_head(path, &head));
        while (camera < out->count && !took(&first[camera], &head))
            camera++;
        if (camera == out->count) {
            for (int k = 0; k < out->count; k++)
                if (first[k].width == head.width && first[k].height == head.height)
                    out->lengths = true;
                else
                    out->sizes = true;
            first[out->count++] = head;
        }
        out->longest = head.width > out->longest ? head.width : out->longest;
        out->longest = head.height > out->longest ? head.height : out->longest;
        out->pixels = fmax(out->pixels, (double)head.width * head.height);
        out->panoramas += head.width == 2 * head.height && head.focal < SHORTEST;
        out->camera[i] = camera;
        out->photos[camera]++;
    }
done:
    free(first);
    free(path);
    return st;
}

void cln_photo_cameras_free(cln_photo_cameras *cameras)
{
    free(cameras->camera);
    free(cameras->photos);
    *cameras = (cln_photo_cameras){0};
}

/* COLMAP takes the spaces around a line away. */
static bool is_line(const char *name)
{
    const size_t length = strlen(name);

    return length > 0 && !strpbrk(name, "\n\r") && !isspace((unsigned char)name[0]) &&
           !isspace((unsigned char)name[length - 1]);
}

bool cln_photo_cameras_listable(const cln_names *photos)
{
    for (int i = 0; i < photos->count; i++)
        if (!is_line(photos->name[i]))
            return false;
    return true;
}

cln_status cln_photo_cameras_list(const cln_photo_cameras *cameras, const cln_names *photos,
                                  int camera, const char *path)
{
    cln_status st = CLN_OK;
    size_t bytes = 0, used = 0;
    char *text = NULL;

    for (int i = 0; i < photos->count; i++)
        if (cameras->camera[i] == camera)
            bytes += strlen(photos->name[i]) + 1;
    CLN_TRY(cln_alloc(&text, bytes + 1, 1, "names of photos"));
    for (int i = 0; i < photos->count; i++)
        if (cameras->camera[i] == camera) {
            const size_t length = strlen(photos->name[i]);

            memcpy(text + used, photos->name[i], length);
            used += length;
            text[used++] = '\n';
        }
    CLN_TRY(cln_write_file(path, text, used));
done:
    free(text);
    return st;
}
