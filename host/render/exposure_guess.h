/* How much brighter than the scene a photo is, by channel, that training did not see: guessed from
 * the photos taken before and after it (method.md 14). Nothing of the photo itself is used. */
#ifndef CLN_EXPOSURE_GUESS_H
#define CLN_EXPOSURE_GUESS_H

#include "model/model.h"

/* Gains r, g, b of every view of the scene, which the caller frees; NULL if the model has none
 * (no --exposure, photos with alpha, other training views). Of training views they are the fitted
 * ones.
 *
 * A view's neighbours are the nearest training views before and after it among those of its folder,
 * in natural order of their names. Its log gains are the mean m of theirs, times the factor in
 * 0..1 that serves the training views best: sum g m / sum m^2 over their own log gains g and their
 * neighbours' m. So gains that follow no order are guessed as 1. Without a neighbour: 1. */
cln_status cln_exposure_guess(const cln_model *model, const cln_scene *scene, float (**gains)[3]);

/* That factor, of gains that are only measured so far, too; the model has some of all training
 * views. */
cln_status cln_exposure_follow(const cln_model *model, const cln_scene *scene, double *share);

#endif
