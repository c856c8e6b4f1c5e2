/* A scene as the rest of the program sees it: views (camera + 8-bit image + split) in the dataset's
 * own frame and units ("scene units"), and the cube that the octree divides (space.h). Readers,
 * one file per format (reader.h), convert to one convention:
 *   camera  OpenCV axes (x right, y down, z forward), camera-to-world, double
 *   pixel   centre of the top-left pixel at (0.5, 0.5)
 *   image   sRGB values as stored, straight alpha
 * Knows no OpenCL and no networks. */
#ifndef CLN_SCENE_H
#define CLN_SCENE_H

#include <jansson.h>
#include <stdint.h>
#include "base/number.h"
#include "base/status.h"
#include "base/config_rows.h"
#include "scene/lens.h"
#include "scene/space.h"
#include "scene/store.h"

/* What differs from a backdrop does so by more than this, of 255 in a channel: noise, and rings of
 * JPEG beside edges, stay below. */
enum { CLN_UNLIKE_BACKDROP = 25 };

typedef enum { CLN_SPLIT_TRAIN, CLN_SPLIT_VAL, CLN_SPLIT_TEST, CLN_SPLITS } cln_split;
extern const char *const cln_split_names[CLN_SPLITS]; /* "train", "val", "test" */

/* A point at (x, y, z) in the camera's frame has a place (a', b') by the lens model (lens.h), which
 * is pixel position u = fx a' + cx, v = fy b' + cy. Of parallel rays, which pictures may have and
 * photos have not, the place is (x, y), and fx, fy are pixels per scene unit. */
typedef struct cln_camera {
    double c2w[12]; /* 3x4 row-major [R|o], R a rotation, o in scene units */
    double fx, fy, cx, cy;
    cln_lens lens;
    union {
        double distortion[CLN_LENS_PARAMS]; /* in the order of the model's parameters, then 0 */
        struct {
            double k1, k2, p1, p2; /* OPENCV's */
        };
    };
    int width, height;
    bool parallel; /* rays are, along z (an orthographic camera); then without a lens model */
} cln_camera;

bool cln_camera_is_distorted(const cln_camera *camera);

/* The same size, intrinsics and lens: pixels have the same rays, except for the pose. */
bool cln_camera_is_like(const cln_camera *a, const cln_camera *b);

/* What kernels must know to trace it: 1 << lens, of parallel rays 1 << CLN_LENSES; 0 for a pinhole.
 * Sets of cameras join with |. */
unsigned cln_camera_lenses(const cln_camera *camera);

/* Adds the third and fourth term of a radial series, k3 and k4, to OPENCV's two, as the FULL_OPENCV
 * that is nearest over the image. CLN_INPUT if that is off by more than a tenth of a pixel. */
cln_status cln_camera_add_terms(cln_camera *camera, const double terms[2], const char *frame);

/* Checks intrinsics and pose, and replaces the rotation by the nearest exact one. `frame` names the
 * camera in the sentence. CLN_INPUT. */
cln_status cln_camera_check(cln_camera *camera, const char *frame);

/* The unit quaternion w, x, y, z of a pose's rotation (c2w: 3x4, row-major). */
void cln_pose_quaternion(const double c2w[12], double q[4]);
/* And back: sets the rotation, the first three of each row of four. */
void cln_pose_turn(const double q[4], double c2w[12]);

/* Is it a panorama of the whole sphere, to a pixel? Others were cut above or below. */
bool cln_camera_spans_sphere(const cln_camera *camera);

/* Makes it EQUIRECTANGULAR, its image (width x height) spanning the whole sphere. */
void cln_camera_span_sphere(cln_camera *camera);

/* The ray through pixel position (u, v): origin in scene units, unit direction. A position that no
 * direction has (beyond the lens model's fold) yields false and the pinhole's direction. */
bool cln_camera_ray(const cln_camera *camera, double u, double v, double origin[3],
                    double direction[3]);

/* Whether the point (scene units) is in the camera's image, hidden or not; u, v: where. */
bool cln_camera_shows(const cln_camera *camera, const double point[3], double *u, double *v);

/* Point in scene units -> (u, v) and its z in the camera's frame, which is negative where a lens
 * sees behind the camera; false, (0, 0) and z if the lens model has no place for it. */
bool cln_camera_project(const cln_camera *camera, const double point[3], double *u, double *v,
                        double *z);

/* Has it a pixel whose ray meets the space's cube? */
bool cln_camera_sees(const cln_camera *camera, const cln_space *space);

/* What of a camera its format does not give, so that it follows from the stored file's size. */
typedef struct cln_by_file {
    bool size, centre[2]; /* centre: cx, cy */
    bool none;    /* nor is there a file: the size is what the caller has for such a camera */
    bool cut;     /* of a panorama: focal lengths and centre are given, as it may have been cut */
    int angle[2]; /* fx, fy: 1 by an angle across the width, 2 across the height; 0: given */
} cln_by_file;

/* A depth image: a grey PNG of 16 bits of any size; 0 and 65535 are not known. */
typedef struct cln_depth_image {
    char *depth, *confidence; /* files; NULL: there is none. 255 of confidence is full */
    double unit, most;        /* scene units of a value of 1; the farthest that counts */
} cln_depth_image;

typedef struct cln_view {
    char *name;       /* as the dataset names it: path relative to the scene folder */
    char *path;       /* file */
    bool leads_out;   /* the dataset names it by a path out of its folder */
    char *file;       /* a file name made of `name` (io/names.h), unlike those of other names */
    char *alpha_path; /* a file whose brightness is the image's alpha; NULL = none */
    bool alpha_mask;  /* it is a mask, which may be of labels or a cut-out (cln_mask_to_alpha) */
    bool alpha_black; /* and black is what it keeps, not white */
    cln_depth_image depth;
    char *mask_path; /* a file that says which pixels count; NULL = all */
    bool mask_black; /* the black ones count; else all others do */
    int mask_least;  /* a mask's pixel is black if all its values are below this; 1: no JPEG */
    cln_split split;
    cln_split named;             /* of a scene without training views: its split */
    cln_camera camera;           /* at the size of `pixels` */
    double near, far;            /* depths that the scene lies between; both 0 = not told */
    int number;                  /* among the views as its reader gave them */
    int file_width, file_height; /* size before --downscale; of the turned picture, if turned */
    int downscale;               /* what divided them, 1..CLN_MOST_DOWNSCALE */
    int orientation;             /* EXIF's (io/exif.h); 1: none */
    cln_by_file by_file;
    bool turned;               /* `pixels` are turned as it says; else as stored */
    bool turn_known;           /* sizes or the format tell which of these the pose is of */
    int alpha_turn, mask_turn; /* orientations that bring those files onto `pixels`; 1: none */
    bool masks_known;          /* sizes or EXIF data tell these, or those of other masks */
    int channels;              /* 3, or 4 with straight alpha */
    bool multiplied;           /* its file's colours are multiplied by its alpha */
    int most_alpha;   /* 1 + its largest alpha (128 and more count alike); 0: was not read */
    bool hides;       /* its alpha is below 128 somewhere; if it was read */
    bool opaque;      /* its file has alpha, which is left out as it hides nothing */
    int rank;         /* that has its pixels (dealt.h) */
    uint8_t *pixels;  /* [height][width][channels], the scene's; NULL if not in memory */
    cln_store *store; /* the scene's, if it has the pixels, at `place`; else NULL */
    size_t place;
    const uint8_t *kept; /* the scene's; NULL if no pixel is left out (cln_view_keeps) */
    int64_t left_out;    /* number of pixels beyond the fold of its lens, along its edge or
                            beyond its disc */
    int edge;            /* pixels of its file along the edges that show nothing */
    double disc;         /* radius of what its file shows, about the middle; in its longer side; 0:
                            all is shown */
    bool trained;        /* the run that it is read for was trained on it; false where none is */
    uint8_t *masked;     /* what `kept` is, if the view has a mask and pixels; else NULL */
    uint64_t digest;     /* of the bytes of its photo, alpha and mask on disk; 0: not known */
} cln_view;

/* A pixel of a training view that shows a point whose place is known. */
typedef struct cln_sight {
    int view, x, y; /* index in cln_scene.views; x, y: -1 if a moved camera no longer shows it */
    float trust;    /* 0..1, less the worse the point fits its images */
    float z; /* along the axis, of a depth image, which moves with its camera; 0: a point's */
    double point[3];
} cln_sight;

typedef struct cln_scene {
    char *path; /* as given: the folder, or a file in it */
    char *folder;
    const char *dialect; /* "blender", "nerfstudio", "instant-ngp" */
    char *because;       /* why it was read as that, a phrase */
    json_t *ignored;     /* array of strings: keys of its files that are not read; may be NULL */
    char *split_rule;    /* how views were split, a phrase */
    bool has_splits;     /* the dataset named the splits */
    double up[3];        /* unit, as its format has it; all 0: its cameras tell (render/up.h) */
    bool up_by_gps;      /* alone: they may tell it better */
    bool on_earth;       /* its frame is metres east, north and up from: */
    double origin[3];    /* latitude, longitude, height (origin.h) */
    double gps_distance; /* of the middle one of the cameras, metres; NAN: not told */
    bool lent;           /* views count as training views that are not (cln_view.named) */
    bool stored_poses;   /* its poses are of pixels as stored, whatever EXIF data say */
    int downscale, downscale_least; /* the views' largest and least */
    int view_count;
    cln_view *views;       /* train, then val, then test; by name within a split */
    int missing;           /* frames left out, as they lack an image: they stand behind the views */
    int unposed;           /* photos beside the views' that a reconstruction found no pose of */
    int nearly_sized;      /* views whose image has nearly, but not quite their camera's size */
    int unreadable;        /* the last of these: their image is there, but cannot be read */
    uint8_t *pixels;       /* of all loaded views: one piece, so that it lies in huge pages */
    cln_store *store;      /* or they are here, if memory has no room for them */
    double cached;         /* bytes of them that may be in memory; 0: all are */
    uint8_t **maps;        /* [view_count] of the views' kept pixels; as many as there are lenses */
    bool has_alpha;        /* over the views of all splits */
    int mask_count;        /* views with a mask, whatever it means */
    bool masks_alpha;      /* masks are alpha */
    bool masks_doubtful;   /* they are not, but may be of an object: nobody said */
    bool masks_reversed;   /* what they drop looks like an object, in most */
    char *masks_rule;      /* what they are and how they are read, a phrase; NULL: there are none */
    bool hides;            /* a photo that was to be opaque is not: it is read again */
    unsigned lenses;       /* cln_camera_lenses of all views */
    cln_space space;       /* its cube */
    char *bounds_rule;     /* where the cube comes from, a phrase */
    bool has_box;          /* the cube is around a box, which may be a slab: */
    double box[6];         /* minimum and maximum, scene units */
    bool box_given;        /* it is around config.bbox */
    bool cube_guessed;     /* from the cameras alone */
    bool in_parallel;      /* and these look in parallel, so that nothing tells how far it is */
    bool outwards;         /* or they look outwards, likewise */
    double cube_share;     /* of the training rays, those that meet the cube */
    double spread;         /* of the training cameras about their middle, half sides */
    double apart_share;    /* of pairs of them, those that look apart; NaN: too few to tell */
    double before_share;   /* of sparse points in their pictures, those before them; likewise */
    bool amid;             /* cameras stand amid what they see, or pass it along their way */
    bool has_sights;       /* its files name points and images that show them */
    int64_t sight_count;   /* with config.depth_loss, for training: what points tell of depths */
    cln_sight *sights;     /* by point or by view */
    bool depths_fit;       /* its depth images, each other; false: it has none */
    int64_t depth_sights;  /* of these, those by depth images */
    float background[3];   /* composited behind alpha and behind the scene */
    bool backdrop;         /* it is the one colour along the photos' borders ... */
    bool backdrop_uneven;  /* ... but not further in: lit by a spot, or darker towards corners */
    bool still;            /* the photos' borders are one picture, although the cameras turn */
    bool background_mean;  /* it is that, or the training photos' mean colour ... */
    bool background_known; /* ... and these are loaded; else it is white here */
    uint64_t digest;       /* of poses, intrinsics, split, names and image bytes on disk */
    uint64_t test_digest;  /* the same of the test views alone */
} cln_scene;

typedef struct cln_scene_desc {
    const char *path;         /* scene folder, or its transforms JSON file */
    const cln_config *config; /* downscale, bbox, background, holdout, test_views, missing,
                                 masks */
    const cln_scene *kept;   /* the views that a run keeps: its test views count instead of those of
                                 config.test_views and, by an unchanged rule and in the same
                                 scene, of config.holdout; test views that it was trained on are
                                 told. NULL: no run's */
    bool pixels[CLN_SPLITS]; /* load the images of these splits, of several ranks each its own;
                                 cameras, sizes and masks always */
    bool unseen;             /* no error if no camera sees the cube */
    bool all_told;           /* config.missing is nobody's choice: photos without alpha stay */
    bool measured;           /* its views are only measured: nor if there is no training view, but
                                 all count as such until cln_scene_return_splits */
    bool held_out;           /* the run that is read has test views: of 2 or 3 photos, too */
    bool without_masks;      /* those that there are do not count, which is said */
    bool keep_alpha;         /* photos that are opaque everywhere keep their alpha, too */
    uint64_t opaque_digest;  /* of the scene when its photos were found to be opaque: they are not
                                 looked at again if they still are the same; 0: not known */
    double elsewhere;        /* bytes of host memory that images must leave */
    const cln_callbacks *callbacks; /* told of the images that are read; NULL: none */
} cln_scene_desc;

/* Reads a scene. Limits: 100,000 frames, CLN_IMAGE_MAX_SIDE and CLN_IMAGE_MAX_PIXELS of an image.
 * Errors (CLN_INPUT) name the file, the frame and the reason: images that are missing (as
 * config.missing says; those left out are a warning), a truncated image, malformed JSON with line
 * and column, non-finite or non-rigid pose (rotation off by more than 1e-3), zero frames, absurd
 * sizes, no training view, and no camera that sees the cube. *out is NULL on failure. */
cln_status cln_scene_load(const cln_scene_desc *desc, cln_scene **out);
void cln_scene_free(cln_scene *scene); /* accepts NULL */

/* Digest of the training views' names, in order. */
uint64_t cln_scene_training_names(const cln_scene *scene);

/* What became of a run's views, by name: how many the scene still has (known), has besides, and
 * lacks. Of the known ones how many moved by more than a hundredth of the cameras' median distance
 * from their middle, or turned by more than a degree, about ten pixels, and the first of these; the
 * medians of both, that distance being 1. elsewhere: these are beyond it, or no view is known, by
 * its name or, of most, by its place. Of those whose files' digests are known on both sides (told),
 * how many have another one, and the first of them. */
typedef struct cln_since {
    int known, fresh, gone, moved, told, changed;
    const char *first_changed, *first_moved; /* the scene's; NULL: none */
    double shift, degrees;
    bool elsewhere;
} cln_since;
cln_status cln_scene_moved_since(const cln_scene *scene, const cln_scene *kept, cln_since *out);

/* That as text: "2 photos are new, 1 is gone"; empty if none of it is so. */
enum { CLN_SINCE_BYTES = 240 };
void cln_since_text(const cln_since *since, char out[CLN_SINCE_BYTES]);

/* The folder of a scene given as folder or file; the caller frees *out. */
cln_status cln_scene_folder(const char *path, char **out);

/* The path of a file of the scene from its folder; the caller frees *out. CLN_INPUT if a file
 * outside of the folder is not there. */
cln_status cln_scene_path_from(const cln_scene *scene, const char *path, char **out);

/* Warns of what looks like a mistake in the poses, with its likely cause (doubts.c). */
void cln_scene_warn_doubts(const cln_scene *scene);

/* doubts.c: do the training cameras look one way and stand along it, as those of a walk, a drive or
 * a pipe? */
bool cln_scene_is_path(const cln_scene *scene);

/* silhouette.c: the box, in scene units, of what the alpha of the training photos shows within
 * `box` (low x, y, z, high x, y, z): of their visual hull, which holds all that all photos show.
 * *any: false if it is empty. Photos that are not loaded, or show nothing, do not count.
 * CLN_MEMORY. */
cln_status cln_scene_silhouette(const cln_scene *scene, const double box[6], double low[3],
                                double high[3], bool *any);

/* alpha.c: that of the cube, with a margin; false if there is none, or no cube. */
bool cln_scene_shown_box(const cln_scene *scene, double box[6]);

/* If a cube that was guessed from the cameras is much wider than that, takes a box around that
 * instead, as --bbox does, and says so. text: the box, or "": nothing changed, as where training
 * photos are not loaded. CLN_MEMORY. */
cln_status cln_scene_narrow_cube(cln_scene *scene, char text[CLN_BOX_BYTES]);

/* bounds.c: the cube of --bbox in place of what it was, and what follows from it. CLN_USAGE. */
cln_status cln_scene_take_box(cln_scene *scene, const char *bbox);

/* doubts.c: the share of the training rays that meet the cube; how far the training cameras are
 * from their middle at most, in half sides of it. */
double cln_scene_cube_share(const cln_scene *scene);
double cln_scene_spread(const cln_scene *scene);

/* stands.c: how many poses the views have that differ by a hundredth of how far they stand apart,
 * or by a degree, if these are at most half as many as views, and five, or less than a third and
 * mostly far from each other (a film's are not); 0 if there are more, or fewer than nine views. */
int cln_scene_few_stands(const cln_scene *scene);

/* Of photos that were read: does alpha, or a mask that is alpha, show nothing in some, or is it
 * nowhere above a few of 255, as if labels of 0 and 1 were given as alpha? A sentence about it. */
enum { CLN_EMPTY_BYTES = 1280 };
bool cln_scene_is_empty(const cln_scene *scene, char text[CLN_EMPTY_BYTES]);

/* Likewise: does alpha, or a mask, hide nothing in a few of them, where most of a photo is hidden
 * in the others? */
bool cln_scene_is_whole(const cln_scene *scene, char text[CLN_EMPTY_BYTES]);

/* Likewise: does alpha, or a mask that is alpha, hide the object in a few of them, and show what is
 * around it? *text is empty if not. CLN_MEMORY. */
cln_status cln_scene_find_reversed(const cln_scene *scene, char text[CLN_EMPTY_BYTES]);

/* Likewise: do colours look as if they were multiplied by alpha? */
bool cln_scene_is_multiplied(const cln_scene *scene, char text[CLN_EMPTY_BYTES]);

/* Gives views that count as training views, as the scene names none, their own splits again. */
void cln_scene_return_splits(cln_scene *scene);

/* bounds.c: does a view show something of what is looked at? Not if no ray of it meets the cube,
 * beyond which there is nothing or, in a shell, what is around a box that was given. */
bool cln_scene_view_counts(const cln_scene *scene, int view);

/* Number of views of a split, and the index in views[] of its i-th. */
int cln_scene_split_count(const cln_scene *scene, cln_split split);
int cln_scene_split_view(const cln_scene *scene, cln_split split, int i);

/* The i-th training view. */
cln_view *cln_scene_training_view(const cln_scene *scene, int i);

/* Width of a pixel of the training photos at the cube's centre, in half sides of the scene's cube:
 * the median over them; 0 in a forward space, where there is no such place. poses [training view]:
 * instead of the scene's, NULL for these. CLN_MEMORY. */
cln_status cln_scene_pixel_width(const cln_scene *scene, const double (*poses)[12],
                                 const cln_space *space, double *width);

/* Width of a cell in pixels of the training photos: the median over those that see its centre;
 * infinite if none does. centre, cell: in half sides of the cube; its widest edge across the line
 * of sight counts. each [training views]: scratch. */
double cln_scene_cell_pixels(const cln_scene *scene, const cln_space *space, const double centre[3],
                             double cell, double *each);

/* Of `count` views of a split, evenly chosen: the index of the i-th, and the least stride in x and
 * y at which they have at most about `most` pixels in all. */
int cln_scene_spread_view(const cln_scene *scene, cln_split split, int i, int count);
int cln_scene_spread_stride(const cln_scene *scene, cln_split split, int count, double most);

/* Pixels of the training views, masked ones, too. */
double cln_scene_training_pixels(const cln_scene *scene);

/* The point nearest to the optical axes of the training views, scene units; false if these are
 * parallel. */
bool cln_scene_focus(const cln_scene *scene, double point[3]);

/* Gives a decoded photo, turned as it is in the scene, the alpha of the view's other file
 * (cln_image_put_alpha): *pixels is another array then, *channels 4. That file's bytes go into
 * *digest, unless it is NULL. CLN_INPUT if its size is another; the photo then stays as it is. */
cln_status cln_view_add_alpha(const cln_view *view, int width, int height, uint64_t *digest,
                              int *channels, uint8_t **pixels);

/* How its `pixels` are to be turned to stand as people see the photo, as an EXIF orientation: 1, 3,
 * 6 or 8. Of mirrors half or quarter turns alone: the scene is not mirrored, either. */
int cln_view_turn(const cln_view *view);

/* Of a view whose pixels are as stored although EXIF data turn them: where (x, y) of these is in
 * the turned picture. False for other views, and where that has not the camera's shape. */
bool cln_view_turn_spot(const cln_view *view, float *x, float *y);

/* Its camera as people see the photo: turned about its axis by cln_view_turn, with the size, focal
 * lengths and principal point of that picture. The rays are the view's own, but for the lens, which
 * a turned one goes without. */
void cln_view_seen(const cln_view *view, cln_camera *out);

/* Are its pixels there, in memory or in the store? */
bool cln_view_is_loaded(const cln_view *view);

/* Pixel (x, y) of a loaded view as it is stored: its channels. */
void cln_view_bytes(const cln_view *view, int x, int y, uint8_t out[4]);
/* How far a colour is from the scene's background, in the channel where most, of 255; beyond
 * CLN_UNLIKE_BACKDROP it differs from it. */
float cln_scene_off_background(const cln_scene *scene, const uint8_t rgb[3]);

/* CLN_OUTPUT if pixels could not be read from the store: what was made of them is wrong. */
cln_status cln_scene_check_pixels(const cln_scene *scene);

/* Bytes of host memory that the loaded views' pixels take here. */
double cln_scene_pixel_bytes(const cln_scene *scene);

/* Brings the loaded pixels down to about so many bytes of memory, if they
 * take more: those in memory go to a file, of which so much stays in memory; of those in a file
 * less stays. why: what takes the room, a clause after "50 images take 74 MiB, "; way_out: a clause
 * at the sentence's end, or "". CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_scene_shrink(cln_scene *scene, double bytes, const char *why, const char *way_out);

/* A digest of a loaded view's pixels. */
uint64_t cln_view_digest(const cln_view *view, uint64_t digest);

/* A stored pixel as float RGB in 0..1 over `background`, alpha in *alpha (1 without). */
void cln_pixel_over(const uint8_t *pixel, int channels, const float background[3], float rgb[3],
                    float *alpha);
/* Pixel (x, y) of a loaded view, likewise. */
void cln_view_pixel(const cln_view *view, int x, int y, const float background[3], float rgb[3],
                    float *alpha);
/* Whether pixel (x, y) counts, in training and in figures. Those beyond the fold of the view's
 * lens, which have no ray, and those that its mask leaves out do not. */
bool cln_view_keeps(const cln_view *view, int x, int y);
/* Has the loaded view a mask or alpha? */
bool cln_view_cut(const cln_view *view);
/* What people see there, in place of what a mask is to hide. */
#define CLN_LEFT_OUT_GREY 0.5f
/* Views that have pixels beyond a fold, and the share of those in all pixels of these views. */
typedef struct cln_fold {
    int views;
    double share;
} cln_fold;
cln_fold cln_scene_fold(const cln_scene *scene);

/* Prefetches that pixel, for those who read single pixels in any order. */
void cln_view_fetch(const cln_view *view, int x, int y);

/* The scene as a JSON object (docs/formats.md): dialect, because, folder, views, missing (how
 * many), unreadable (of these), missing_names (the first), splits, split_rule, ignored_keys, sizes,
 * channels, alpha, masks ({views, as, because, doubtful} or null), distortion, beyond_fold
 * (cln_fold), downscale, downscale_least, centre, half, space (cube, ndc or shell), bounds_rule,
 * cube_guessed, background, digest (16 hex digits), camera_distance (mean, to the centre),
 * cube_share, spread, apart_share, intrinsics [{views, width, height, fx, fy, cx, cy, lens,
 * params}], cameras [{name, split, width, height}]. */
cln_status cln_scene_describe(const cln_scene *scene, json_t **out);

#endif
