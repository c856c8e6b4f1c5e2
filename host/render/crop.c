/* Checks and uses a box. See crop.h; the geometry is scene/space.h's. */
#include "render/crop.h"

#include <math.h>
#include "base/log.h"

cln_status cln_crop_check(const char *name, const double box[6])
{
    for (int a = 0; a < 3; a++)
        if (!(isfinite(box[a]) && isfinite(box[3 + a]) && box[a] < box[3 + a]))
            return cln_fail(
                CLN_USAGE,
                "%s: the minimum %g is not below the maximum %g along %c; give x0,y0,z0,x1,y1,z1, "
                "the lowest and the highest corner, in the scene's units",
                name, box[a], box[3 + a], "xyz"[a]);
    return CLN_OK;
}

bool cln_crop_is_turned(const cln_crop *crop)
{
    for (int i = 0; i < 9; i++)
        if (crop->turn[i] != 0)
            return true;
    return false;
}

void cln_crop_warn(const char *name, const cln_space *space, const cln_crop *crop)
{
    bool apart = false;

    for (int a = 0; a < 3; a++)
        apart = apart || crop->box[a] > space->centre[a] + space->half ||
                crop->box[a + 3] < space->centre[a] - space->half;
    if (apart && !space->forward && !space->shell && !cln_crop_is_turned(crop))
        cln_warn("%s: nothing is in this box; the scene is in %g,%g,%g,%g,%g,%g", name,
                 space->centre[0] - space->half, space->centre[1] - space->half,
                 space->centre[2] - space->half, space->centre[0] + space->half,
                 space->centre[1] + space->half, space->centre[2] + space->half);
}

/* half +- axis (p - middle) >= 0 */
static void turned_planes(const cln_space *space, const cln_crop *crop, float planes[6][4])
{
    for (int i = 0; i < 6; i++) {
        const double *axis = crop->turn + 3 * (i % 3), sign = i < 3 ? 1 : -1;
        double plane[4] = {0, 0, 0, 0.5 * (crop->box[i % 3 + 3] - crop->box[i % 3])};

        for (int a = 0; a < 3; a++) {
            plane[a] = sign * axis[a];
            plane[3] -= plane[a] * 0.5 * (crop->box[a] + crop->box[a + 3]);
        }
        cln_space_plane_to_cube(space, plane, planes[i]);
    }
}

void cln_crop_place(const cln_space *space, cln_crop *crop)
{
    if (cln_crop_is_turned(crop))
        turned_planes(space, crop, crop->planes);
    else
        cln_space_box_to_planes(space, crop->box, crop->planes);
}

cln_status cln_crop_use(cln_pipeline *p, const cln_space *space, cln_crop *crop)
{
    cln_status st = CLN_OK;

    p->crop = NULL;
    if (!crop || !crop->on)
        return CLN_OK;
    CLN_TRY(cln_pipeline_want(p, CLN_PROGRAM_BIT(sampling_crop)));
    cln_crop_place(space, crop);
    p->crop = (const float(*)[4])crop->planes;
done:
    return st;
}
