/* A rendered picture in memory. See picture.h. */
#include "render/picture.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "io/image.h"

void cln_picture_free(cln_picture *picture)
{
    free(picture->rgb);
    free(picture->depth);
    free(picture->opacity);
    free(picture->seen);
    memset(picture, 0, sizeof *picture);
}

void cln_picture_to_scene(const cln_space *space, cln_picture *picture)
{
    const int n = picture->width * picture->height;

    for (int i = 0; i < n; i++)
        picture->depth[i] =
            picture->opacity[i] > 0 ? cln_space_depth_to_scene(space, picture->depth[i]) : 0;
}

void cln_picture_along_axis(const cln_camera *camera, cln_picture *picture)
{
    const int width = picture->width, n = width * picture->height;

    for (int i = 0; i < n; i++)
        picture->depth[i] =
            cln_depth_along_axis(camera, i % width, i / width, false, picture->depth[i]);
}

float cln_depth_along_axis(const cln_camera *camera, int x, int y, bool back, float depth)
{
    double origin[3], direction[3], cosine = 0;

    if (depth == 0 || !cln_camera_ray(camera, x + 0.5, y + 0.5, origin, direction))
        return 0;
    for (int a = 0; a < 3; a++)
        cosine += direction[a] * camera->c2w[4 * a + 2];
    return (float)(back ? (double)depth / cosine : (double)depth * cosine);
}

cln_status cln_picture_to_bytes(const cln_picture *p, bool alpha, uint8_t **bytes)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height, channels = alpha ? 4 : 3;

    CLN_TRY(cln_alloc(bytes, n, channels, "picture"));
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < channels; k++)
            (*bytes)[channels * i + k] = cln_to_u8(k < 3 ? p->rgb[3 * i + k] : p->opacity[i]);
done:
    return st;
}

cln_status cln_picture_to_words(const cln_picture *p, bool alpha, uint16_t **words)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height, channels = alpha ? 4 : 3;

    CLN_TRY(cln_alloc(words, n * channels, sizeof **words, "picture"));
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < channels; k++)
            (*words)[channels * i + k] = cln_to_u16(k < 3 ? p->rgb[3 * i + k] : p->opacity[i]);
done:
    return st;
}

void cln_picture_straight(const float background[3], cln_picture *p)
{
    const size_t n = (size_t)p->width * (size_t)p->height;

    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            const float behind = (1 - p->opacity[i]) * background[k];

            p->rgb[3 * i + k] =
                p->opacity[i] > 0 ? (p->rgb[3 * i + k] - behind) / p->opacity[i] : 0;
        }
}
