/* A rendered picture in memory. See picture.h. */
#include "render/picture.h"

#include <stdlib.h>
#include <string.h>

void cln_picture_free(cln_picture *picture)
{
    free(picture->rgb);
    free(picture->depth);
    free(picture->opacity);
    memset(picture, 0, sizeof *picture);
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
