/* Depth as a grey picture. See depth_picture.h. */
#include "render/depth_picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/number.h"
#include "io/image.h"

enum { OF_A_FRAME = 4096, OPAQUE = 128 };

cln_status cln_depth_scale_add(cln_depth_scale *scale, size_t n, const float *depth,
                               const uint8_t *opacity)
{
    cln_status st = CLN_OK;
    const size_t stride = (n + OF_A_FRAME - 1) / OF_A_FRAME;

    for (size_t i = 0; i < n; i += stride)
        if (opacity[i] >= OPAQUE && depth[i] > 0) {
            CLN_TRY(cln_grow(&scale->sample, (int64_t)scale->count, sizeof *scale->sample,
                             "depth pictures"));
            scale->sample[scale->count++] = 1 / depth[i];
        }
done:
    return st;
}

bool cln_depth_scale_make(cln_depth_scale *scale)
{
    const size_t n = scale->count;

    if (n == 0)
        return false;
    cln_floats_sort(scale->sample, n);
    scale->low = scale->sample[n / 50];
    scale->high = scale->sample[n - 1 - n / 50];
    return true;
}

void cln_depth_scale_free(cln_depth_scale *scale)
{
    free(scale->sample);
    memset(scale, 0, sizeof *scale);
}

void cln_depth_draw(const cln_depth_scale *scale, size_t n, const float *depth,
                    const uint8_t *opacity, uint8_t *grey)
{
    const float low = scale->low, width = scale->high - scale->low;

    for (size_t i = 0; i < n; i++) {
        const float near = depth[i] > 0 ? 1 / depth[i] : 0;
        const float share = width > 0 ? fminf(fmaxf((near - low) / width, 0), 1) : 1;

        grey[i] = cln_to_u8((float)opacity[i] / 255 * (0.15f + 0.85f * share));
    }
}
