/* Which pixels of a picture need more than one ray, and the means of these: pixels at edges of
 * colour, of opacity or of depth, where one ray through the centre stands for a pixel that sees two
 * things. No rendering here (view.c). */
#ifndef CLN_ANTIALIAS_H
#define CLN_ANTIALIAS_H

#include "pipeline/pipeline.h"
#include "render/picture.h"

/* The pixels at edges, and those of some whole rows whose n x n rays are under way. Memory is that
 * of a batch of rays or of one row's, however large the picture. */
typedef struct cln_antialias {
    int n;
    int *pixels; /* [count] row by row: y * width + x */
    int count;
    int first, some;    /* the ones under way: pixels[first] to pixels[first + some - 1] */
    int rays, finished; /* of these: some n n, and how many of them were added */
    cln_pixel *ray;     /* [some n n] by rows of the finer picture, as splatting by view needs */
    int *edge_of;       /* [some n n] index into the ones under way */
    double (*sums)[4];  /* [some] r, g, b, opacity */
    float (*best)[2];   /* [some] opacity and depth of the most opaque ray */
    int most;           /* `some` at the most */
} cln_antialias;

/* Finds the pixels that differ from one of their eight neighbours by more than a threshold in a
 * colour channel, in opacity, or in depth (relative to the nearer one, where both are mostly
 * opaque). picture: of one ray a pixel; batch: rays of a batch. The caller frees it. CLN_MEMORY. */
cln_status cln_antialias_find(const cln_picture *picture, int n, int batch, cln_antialias *out);

/* The next rays, at most `most`: pixels of a picture n times as wide and high, of the camera
 * `view`. 0: there are no more. */
int cln_antialias_rays(const cln_antialias *edges, cln_u32 view, int most, cln_pixel *out);

/* Adds the results of the first `rendered` of them. Pixels whose rays are all there become their
 * mean; their depth stays that of the ray through the centre, as a mean of depths is on no surface,
 * or, if that ray met nothing, that of the most opaque one. */
void cln_antialias_add(cln_antialias *edges, const cln_ray_result *results, int rendered,
                       cln_picture *picture);

bool cln_antialias_done(const cln_antialias *edges);
void cln_antialias_free(cln_antialias *edges); /* accepts a zeroed one */

#endif
