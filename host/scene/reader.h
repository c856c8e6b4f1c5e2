/* What a dataset reader is: one per format, one file each, listed in scene.c in order of detection.
 * A reader fills views without pixels; scene.c then checks poses, splits, downscales, loads images,
 * finds bounds and the digest, the same for every format. To add a format: write reader_x.c with
 * one `const cln_reader cln_reader_x`, and add it to the list in scene.c. */
#ifndef CLN_READER_H
#define CLN_READER_H

#include "scene/scene.h"

typedef struct cln_reader_result {
    int view_count;
    cln_view *views;   /* name, path, camera (at file size; width/height 0 = ask the image) */
    bool named_splits; /* the dataset says which view is what; else --holdout applies */
    bool has_bounds;
    cln_space space;
    char *bounds_rule;
    const char *dialect;
    char *because;
} cln_reader_result;

typedef struct cln_reader {
    const char *name;
    /* Does this folder (or file) look like the format? Cheap, never an error. */
    bool (*detect)(const char *path);
    /* Reads it; on failure the result may be partly filled and is freed by the caller. */
    cln_status (*read)(const char *path, cln_reader_result *result);
} cln_reader;

extern const cln_reader cln_reader_transforms; /* reader_transforms.c */

#endif
