/* Camera rays through the sub-pixels, and their average; see picture.h. It averages encoded values,
 * since radiance fields composite these and errors are measured in them. */
#include "picture.h"
#include "io/image.h"

void picture_render(const world *w, const cln_camera *camera, uint8_t *rgba, float *depth)
{
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            vec sum = vec3(0, 0, 0);
            int hits = 0;
            uint8_t *pixel = rgba + 4 * ((size_t)y * (size_t)camera->width + (size_t)x);
            double centre_depth = 0;
            for (int i = 0; i < SUBSAMPLES; i++) {
                double o[3], d[3];
                hit h;
                /* A position beyond the lens model's fold sees nothing. */
                if (!cln_camera_ray(camera, x + (i % 3 + 0.5) / 3, y + (i / 3 + 0.5) / 3, o, d))
                    continue;
                vec origin = vec3(o[0], o[1], o[2]), direction = vec3(d[0], d[1], d[2]);
                if (!shapes_hit(&w->shapes, origin, direction, 0, INFINITY, &h))
                    continue;
                sum = add(sum, shade(w, &h, origin, direction, i));
                hits++;
                if (i == SUBSAMPLES / 2)
                    centre_depth = h.t;
            }
            vec colour = hits ? scale(sum, 1.0 / hits) : sum;
            pixel[0] = cln_to_u8((float)colour.x);
            pixel[1] = cln_to_u8((float)colour.y);
            pixel[2] = cln_to_u8((float)colour.z);
            pixel[3] = cln_to_u8((float)hits / SUBSAMPLES);
            if (depth)
                depth[(size_t)y * (size_t)camera->width + (size_t)x] = (float)centre_depth;
        }
}

void picture_over_white(int pixels, uint8_t *image)
{
    for (size_t i = 0; i < (size_t)pixels; i++) {
        int alpha = image[4 * i + 3];
        for (size_t c = 0; c < 3; c++)
            image[3 * i + c] =
                (uint8_t)((image[4 * i + c] * alpha + 255 * (255 - alpha) + 127) / 255);
    }
}
