/* A rendered picture in memory, as float. Its files are render.c's and quality.c's. */
#ifndef CLN_PICTURE_H
#define CLN_PICTURE_H

typedef struct cln_picture {
    int width, height;
    float *rgb;     /* [height][width][3] */
    float *depth;   /* [height][width] normalised units; 0 where nothing is (opacity 0) */
    float *opacity; /* [height][width] */
} cln_picture;

void cln_picture_free(cln_picture *picture);

#endif
