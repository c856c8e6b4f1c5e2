/* Checks and uses a box. See crop.h; the geometry is scene/space.h's. */
#include "render/crop.h"

#include <math.h>
#include "base/log.h"

cln_status cln_crop_check(const char *name, const double box[6])
{
    for (int a = 0; a < 3; a++)
        if (!(isfinite(box[a]) && isfinite(box[3 + a]) && box[a] < box[3 + a]))
            return cln_fail(CLN_USAGE,
                            "%s: from %g to %g along %c is no box; x0,y0,z0,x1,y1,z1 are wanted, "
                            "the lowest and the highest corner in the scene's units",
                            name, box[a], box[3 + a], "xyz"[a]);
    return CLN_OK;
}

void cln_crop_warn(const char *name, const cln_space *space, const double box[6])
{
    bool apart = false;

    for (int a = 0; a < 3; a++)
        apart = apart || box[a] > space->centre[a] + space->half ||
                box[a + 3] < space->centre[a] - space->half;
    if (apart && !space->forward && !space->shell)
        cln_warn("%s: nothing is in this box; the scene is in %g,%g,%g,%g,%g,%g", name,
                 space->centre[0] - space->half, space->centre[1] - space->half,
                 space->centre[2] - space->half, space->centre[0] + space->half,
                 space->centre[1] + space->half, space->centre[2] + space->half);
}

cln_status cln_crop_use(cln_pipeline *p, const cln_space *space, cln_crop *crop)
{
    cln_status st = CLN_OK;

    p->crop = NULL;
    if (!crop || !crop->on)
        return CLN_OK;
    CLN_TRY(cln_pipeline_want(p, CLN_PROGRAM_BIT(sampling_crop)));
    cln_space_box_to_planes(space, crop->box, crop->planes);
    p->crop = (const float(*)[4])crop->planes;
done:
    return st;
}
