/* What a dataset reader is: one per format, each a file and a row of the table in readers.c, in
 * whose order they are tried. A reader fills views without pixels; load.c then splits, checks,
 * downscales and loads them, and finds the cube and the digest, the same for every format.
 *
 * To add a format: write reader_x.c with one `const cln_reader cln_reader_x`, declare it below, add
 * it to readers.c, and its name to the setting `format` and its constant CLN_FORMAT_... beside it
 * (base/config_rows.h). dataset.h has what readers share.
 *
 * What a dataset says of one image is in cln_view (scene.h): name, file, split, and a camera with
 * its own pose, intrinsics and lens. What it says of the whole is in cln_reader_result; zero means
 * that it says nothing. Something new (a mask, a unit) becomes a member of the one or the other.
 * Poses keep the dataset's frame and units, which users see everywhere; a reader turns only the
 * camera's axes, to OpenCV's. */
#ifndef CLN_READER_H
#define CLN_READER_H

#include <jansson.h>
#include "scene/scene.h"

/* A point that structure from motion found on a surface. */
typedef struct cln_point {
    double xyz[3]; /* scene units */
    uint8_t rgb[3];
    int views;   /* images that it was found in; 0 = not given */
    float error; /* mean reprojection error, pixels; 0 = not given */
} cln_point;

/* An image in which a point was found, at the point's projection. */
typedef struct cln_observation {
    int32_t point, view; /* indices in the result's arrays */
} cln_observation;

typedef struct cln_reader_result {
    int view_count;
    cln_view *views;   /* name, path, camera (at file size; width/height 0 = ask the image) */
    bool named_splits; /* the dataset says which view is what; else --holdout applies */
    bool has_bounds;   /* the dataset says where the scene is: `space`, and why, a phrase */
    cln_space space;
    char *bounds_rule;
    bool has_box;  /* `space` is around a box, which may be a slab: */
    double box[6]; /* minimum and maximum */
    int point_count;
    cln_point *points;
    bool *dropped; /* [point_count] by masks (points_dropped.c); NULL = none */
    int dropped_count;
    bool depth_points;         /* these are of depth images */
    int depth_images;          /* that were looked at, also if they have no point */
    int64_t observation_count; /* 0 = not given */
    cln_observation *observations;
    bool forward;        /* a format of forward-facing scenes: NDC, if the cameras look one way */
    bool beyond;         /* its photos show what lies around, too: a shell */
    double up[3];        /* unit, where its format has a fixed one (gravity); all 0: it does not */
    bool up_by_gps;      /* that is as good as GPS was: level cameras did not count */
    bool on_earth;       /* its frame is metres east, north and up from: */
    double origin[3];    /* latitude, longitude, height (origin.h) */
    double gps_distance; /* of the middle one of the cameras, metres; NAN: not told */
    bool wide;           /* its box has room for that: no cube for what the cameras look at */
    bool stored_poses;   /* for cln_scene.stored_poses */
    const char *dialect; /* for cln_scene.dialect */
    char *because;       /* why it was read as that, a phrase */
    int moved_count;     /* images that are not where it names them and were found (moved.h) */
    char *moved_from, *moved_to; /* one of them; NULL without any */
    int mask_count;              /* masks that lie beside the photos, of the views' */
    int unposed;                 /* images beside the views' without a pose, of a reconstruction */
    bool tailed;                 /* an image may have one more ending than its name: NAME.jpg.jpg */
    json_t *ignored; /* array of strings: keys of its files that are not read; may be NULL */
} cln_reader_result;

typedef struct cln_reader {
    const char *name;
    const char *wants; /* a phrase that ends "NAME wants ..." */

    /* Does this folder or file look like the format? Cheap, never an error. On false, *missing is a
     * phrase that says what is missing if a part of the format is there; else NULL. */
    bool (*detect)(const char *path, const char **missing);

    /* Reads it; on failure the result may be partly filled and is freed by the caller. */
    cln_status (*read)(const char *path, cln_reader_result *result);
} cln_reader;

extern const cln_reader cln_reader_transforms; /* reader_transforms.c */
extern const cln_reader cln_reader_colmap;     /* reader_colmap.c */
extern const cln_reader cln_reader_llff;       /* reader_llff.c */
extern const cln_reader cln_reader_neus;       /* reader_neus.c */
extern const cln_reader cln_reader_nsvf;       /* reader_nsvf.c */
extern const cln_reader cln_reader_opensfm;    /* reader_opensfm.c */
extern const cln_reader cln_reader_metashape;  /* reader_metashape.c */
extern const cln_reader cln_reader_polycam;    /* reader_polycam.c */
extern const cln_reader cln_reader_record3d;   /* reader_record3d.c */

/* colmap_model.c: number of images of the model in a folder, by its first bytes, as its file may
 * have gigabytes; 0 if there is none. */
int cln_colmap_images(const char *folder);

/* reader_colmap.c: the folder of the model that is read of a scene; *folder: NULL if there is none.
 * The caller frees it. CLN_MEMORY. */
cln_status cln_colmap_read_from(const char *scene, char **folder);

/* reader_colmap.c: the names and places of the cameras of the model in a folder, [image], in its
 * own frame and unit. CLN_INPUT, CLN_MEMORY. The caller frees both, also after a failure. */
struct cln_names;
cln_status cln_colmap_places(const char *folder, struct cln_names *names, double (**at)[3]);

/* readers.c: the reader of the setting `format`, or the first that detects its format at `path`. A
 * phrase in *others names the formats that are there besides, for --format; NULL if there are none,
 * and the caller frees it. CLN_INPUT if there is no such format: the sentence says what lies there
 * instead, what each reader wants and misses, and what to do. */
cln_status cln_reader_pick(const char *path, int format, const cln_reader **out, char **others);

/* Is it a scene by the looks of any format? */
bool cln_reader_detects(const char *path);

/* As cln_run_read; where there is no run, the error says what is there, as a scene. */
cln_status cln_reader_run(const char *path, json_t **document);

#endif
