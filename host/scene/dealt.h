/* Photos dealt to ranks (ranks/ranks.h): each rank has the pixels of a run of every split's views,
 * so that all have about equally many pixels; cameras, sizes and masks are on all. What a rank asks
 * of another's photos comes in messages. One rank has all. */
#ifndef CLN_SCENE_DEALT_H
#define CLN_SCENE_DEALT_H

#include "scene/scene.h"

/* Fills in the views' ranks; sizes are known. CLN_USAGE unless all ranks read the same views
 * and sparse points. */
cln_status cln_scene_deal(cln_scene *scene);

/* first[r] .. first[r + 1]: rank r's of the split's views, [ranks + 1]. */
void cln_scene_dealt(const cln_scene *scene, cln_split split, int *first);

/* Are its pixels this rank's? (In memory they are if its split was loaded.) */
bool cln_view_is_here(const cln_view *view);

/* Borrow: a copy of a view, whose pixels its rank has loaded, with pixels on all ranks; all call
 * it. CLN_MEMORY; CLN_OUTPUT if that rank cannot read them. Give back: frees these, not what the
 * view itself has. */
cln_status cln_view_borrow(const cln_view *view, cln_view *out);
void cln_view_give_back(const cln_view *view, cln_view *borrowed);

#endif
