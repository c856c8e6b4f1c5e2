/* What the files of inspect.h share: an inspection under way, and how findings are told. */
#ifndef CLN_INSPECTION_H
#define CLN_INSPECTION_H

#include "scene/agreement.h"
#include "scene/findings.h"
#include "scene/photos.h"

typedef struct cln_inspection {
    const cln_scene *scene;
    const cln_callbacks *callbacks;
    cln_agreement agreement;
    cln_photo *photos; /* [view] */
    json_t *findings, *measures;
    bool posed;    /* photos fit their poses, as far as is known */
    bool thin;     /* too few marks to tell what photos share: */
    double marks;  /* of a photo, the median */
    bool standing; /* something stands in all photos (standing.h) */
} cln_inspection;

void cln_inspect_measure(const cln_inspection *in, const char *name, double value);

void cln_inspect_add(json_t *views, const cln_inspection *in, int view);

/* Sorts them; NaN: none. */
double cln_inspect_median(double *values, int count);

/* Do the photos fit their poses? Sets in->posed. CLN_MEMORY. */
cln_status cln_inspect_poses(cln_inspection *in);
/* Photos that do not, while the others do. */
void cln_inspect_strays(cln_inspection *in);

#endif
