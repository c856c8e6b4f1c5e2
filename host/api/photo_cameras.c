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

/* mm: those of cameras that see all around have 1.0 to 1.4, or more behind a large sensor, those of
 * phones 1.5 and more; on 35 mm film a lens of one picture that is no fisheye has 10 and more. */
static const double SHORTEST = 1.45, SHORTEST_FILM = 10;

static bool is_double(const cln_image_head *head)
{
    return head->width == 2 * head->height;
}

/* Is it cut, by what it says of itself, or by its shape? */
static bool is_cut(const cln_image_head *head)
{
    return head->panorama == CLN_PANORAMA_CUT ||
           (head->panorama == CLN_PANORAMA_WHOLE && abs(head->width - 2 * head->height) > 2);
}

static bool is_sphere(const cln_image_head *head)
{
    if (head->panorama != CLN_PANORAMA_UNTOLD)
        return !is_cut(head);
    return is_double(head) &&
           (head->focal_film > 0 ? head->focal_film < SHORTEST_FILM : head->focal < SHORTEST);
}

/* A camera's size and focal length are those of its first photo. On 35 mm film, the length tells
 * what was cut off, too, but programs that change photos may drop it, and phones leave their
 * digital zoom out of it. */
static bool took(const cln_image_head *first, const cln_image_head *photo)
{
    const bool film = first->focal_film > 0 && photo->focal_film > 0;
    const double a = film ? first->focal_film : first->focal;
    const double b = film ? photo->focal_film : photo->focal;

    if (first->width != photo->width || first->height != photo->height ||
        fmax(first->zoom, photo->zoom) > ALIKE * fmin(first->zoom, photo->zoom) ||
        is_sphere(first) != is_sphere(photo))
        return false;
    if (!film && (!(a > 0) || !(b > 0))) /* they cannot be compared: both without any? */
        return fmax(first->focal, first->focal_film) == 0 &&
               fmax(photo->focal, photo->focal_film) == 0;
    return fmax(a, b) <= ALIKE * fmin(a, b);
}

static void add_panorama(cln_photo_cameras *out, const cln_image_head *head, int photo)
{
    if (is_cut(head) && out->cuts++ == 0)
        out->cut = photo;
    if (!is_sphere(head))
        return;
    out->panoramas++;
    out->told += head->panorama != CLN_PANORAMA_UNTOLD;
    if (head->panorama == CLN_PANORAMA_UNTOLD && out->guessed < 0)
        out->guessed = photo;
}

cln_status cln_photo_cameras_find(const char *folder, const cln_names *photos,
                                  cln_photo_cameras *out)
{
    cln_status st = CLN_OK;
    const size_t most = (size_t)photos->count + 1;
    cln_image_head head, *first = NULL; /* [camera] */
    char *path = NULL;

    *out = (cln_photo_cameras){.guessed = -1};
    CLN_TRY(cln_alloc(&out->sphere, most, sizeof *out->sphere, "photos"));
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
            out->sphere[out->count] = is_sphere(&head);
            first[out->count++] = head;
        }
        out->longest = head.width > out->longest ? head.width : out->longest;
        out->longest = head.height > out->longest ? head.height : out->longest;
        out->pixels = fmax(out->pixels, (double)head.width * head.height);
        add_panorama(out, &head, i);
        out->camera[i] = camera;
        out->photos[camera]++;
    }
done:
    free(first);
    free(path);
    return st;
}

/* The largest value, or the mean, of a patch about a place of a picture, (x, y) of its sides. */
static void look(const uint8_t *pixels, int width, int height, int channels, double x, double y,
                 int *largest, double *mean)
{
    const int r = height / 50 > 1 ? height / 50 : 1;
    const int column = (int)(x * width), row = (int)(y * height);
    int64_t sum = 0, count = 0;

    for (int v = row - r; v <= row + r; v++)
        for (int u = column - r; u <= column + r; u++)
            for (int k = 0; k < 3 && u >= 0 && u < width && v >= 0 && v < height; k++) {
                const int value =
                    pixels[((size_t)v * (size_t)width + (size_t)u) * (size_t)channels + (size_t)k];

                *largest = value > *largest ? value : *largest;
                sum += value;
                count++;
            }
    *mean = count ? (double)sum / (double)count : 0;
}

cln_status cln_photo_has_circles(const char *path, bool *circles)
{
    const double edge = 0.02, high = 0.12; /* outside of a circle there, within it in the middle */
    const int black = 24;
    cln_status st = CLN_OK;
    int width = 0, height = 0, channels = 0, outside = 0, any = 0;
    double mean = 0, least = 255;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_image_load(path, &width, &height, &channels, &pixels));
    for (int half = 0; half < 2; half++)
        for (int up = 0; up < 2; up++) {
            const double y = up ? high : 1 - high, x = 0.5 * half;

            look(pixels, width, height, channels, x + edge / 2, y, &outside, &mean);
            look(pixels, width, height, channels, x + 0.5 - edge / 2, y, &outside, &mean);
            look(pixels, width, height, channels, x + 0.25, y, &any, &mean);
            least = fmin(least, mean);
        }
    *circles = outside < black && least > 2 * black;
done:
    free(pixels);
    return st;
}

void cln_photo_cameras_free(cln_photo_cameras *cameras)
{
    free(cameras->camera);
    free(cameras->photos);
    free(cameras->sphere);
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
