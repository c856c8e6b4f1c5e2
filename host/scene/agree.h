/* Do the photos agree with their poses? Features that two photos share (features.h) must lie on
 * rays that meet: this finds how many do, of each photo and of all; which other axes, matrices or
 * focal length would make more of them meet; and where they meet. What masks or alpha cut away does
 * not count, nor what stands still in the pictures although the cameras move, as the backdrop of a
 * turntable. Needs loaded pixels. */
#ifndef CLN_AGREE_H
#define CLN_AGREE_H

#include "scene/agreement.h"

/* callbacks: told of the views that are compared; NULL: none. CLN_MEMORY; CLN_SIGINT, CLN_SIGTERM:
 * it was interrupted. Free *out in any case. */
cln_status cln_agree(const cln_scene *scene, const cln_callbacks *callbacks, cln_agreement *out);

/* Are the poses of photos that EXIF data turn of turned pixels, taken as stored here? */
bool cln_agree_turned(const cln_agreement *a);
bool cln_agree_stored(const cln_agreement *a); /* are they of stored ones, by what photos show? */
void cln_agreement_free(cln_agreement *a);

#endif
