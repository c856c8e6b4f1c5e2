/* See faults.h. write.c applies `axes`, `inverse` and `upright`, when it writes the matrix. */
#include "faults.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/rng.h"
#include "scene/motion.h"

const char *const fault_names[FAULTS + 1] = {
#define X(name, what) #name,
    FAULT_LIST(X)
#undef X
        NULL};

/* A vector of length `by`, evenly distributed over directions, from two numbers in [0, 1). */
static void direction(const float of[2], double by, double out[3])
{
    const double z = 2 * (double)of[0] - 1, angle = 2 * M_PI * (double)of[1], r = sqrt(1 - z * z);

    out[0] = by * r * cos(angle);
    out[1] = by * r * sin(angle);
    out[2] = by * z;
}

/* A turn and a shift of fixed sizes, each about a direction of its own. */
static void shake(int view, cln_camera *camera)
{
    const double distance = hypot(hypot(camera->c2w[3], camera->c2w[7]), camera->c2w[11]);
    double motion[CLN_MOTION];
    float random[4];

    cln_uniform4(1, CLN_STREAM_SCENE, 0, (uint32_t)view, 99, random);
    direction(random, 0.3 * M_PI / 180, motion);
    direction(random + 2, 0.005 * distance, motion + 3);
    cln_motion_apply(camera->c2w, motion, camera->c2w);
}

void fault_camera(fault which, int view, cln_camera *camera)
{
    const double by = which == FAULT_scale ? 8 : which == FAULT_far && view == FAULT_VIEW ? 40 : 1;

    if (which == FAULT_focal) {
        camera->fx *= 1.3;
        camera->fy *= 1.3;
    }
    for (int a = 0; a < 3; a++)
        camera->c2w[4 * a + 3] *= by;
    if (which == FAULT_pose &&
        view == FAULT_VIEW) /* the rows of world x and y: a half turn around z */
        for (int k = 0; k < 8; k++)
            camera->c2w[k] *= -1;
    if (which == FAULT_shaken && view >= 0)
        shake(view, camera);
}

int fault_photo(fault which, int view, int train)
{
    const int other = FAULT_OTHER(train);

    if ((which == FAULT_swap || which == FAULT_copy) && view == other && other < train)
        return FAULT_VIEW;
    if (which == FAULT_swap && view == FAULT_VIEW && other < train)
        return other;
    return view;
}

static void dim(double factor, size_t bytes, int channels, uint8_t *pixels)
{
    for (size_t i = 0; i < bytes; i++)
        if (channels == 3 || i % 4 < 3)
            pixels[i] = (uint8_t)lround(pixels[i] * factor);
}

cln_status fault_pixels(fault which, int view, int width, int height, int channels, uint8_t *pixels)
{
    cln_status st = CLN_OK;
    const int reach = 1 + width / 60;
    const size_t bytes = (size_t)width * (size_t)height * (size_t)channels;
    uint8_t *sharp = NULL;

    if (which == FAULT_clouds && view >= 0)
        dim(exp2((sin(2 * M_PI * view / 12) - 1) / 2.2), bytes, channels, pixels);
    if (which == FAULT_exposure && view == FAULT_VIEW)
        dim(exp2(-1 / 2.2), bytes, channels, pixels); /* half of the light */
    if (which != FAULT_blur || view != FAULT_VIEW)
        return CLN_OK;
    CLN_TRY(cln_alloc(&sharp, bytes, 1, "an image"));
    memcpy(sharp, pixels, bytes);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            for (int c = 0; c < channels; c++) {
                int sum = 0, count = 0;

                for (int k = y - reach; k <= y + reach; k++)
                    for (int i = x - reach; i <= x + reach; i++)
                        if (k >= 0 && i >= 0 && k < height && i < width) {
                            sum += sharp[(size_t)(k * width + i) * (size_t)channels + (size_t)c];
                            count++;
                        }
                pixels[(size_t)(y * width + x) * (size_t)channels + (size_t)c] =
                    (uint8_t)(sum / count);
            }
done:
    free(sharp);
    return st;
}
