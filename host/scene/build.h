/* The steps of cln_scene_load, in the order in which load.c calls them; private to this room. Each
 * works on the scene being built and leaves it consistent on failure, so that cln_scene_free can
 * follow. */
#ifndef CLN_SCENE_BUILD_H
#define CLN_SCENE_BUILD_H

#include "scene/agree.h"
#include "scene/reader.h"
#include "scene/scene.h"

/* camera.c: divides the image size and everything in pixels by x (width) and y (height). */
void cln_camera_resize(cln_camera *camera, int width, int height, double x, double y);

/* split.c: every holdout-th view by name, from number holdout_from on, becomes test, or those that
 * test_views lists or a run kept, unless the dataset named the splits; fills split_rule; then
 * orders the views, and checks for duplicates and for a training view, or as
 * cln_scene_desc.measured has it. */
cln_status cln_scene_split_views(cln_scene *scene, bool named_splits, const cln_scene_desc *desc);

/* test_list.c: the photos whose names are in a file, one a line, become test views; or those that
 * are test views of `kept`, if that is not NULL, by their names, of which some may be gone.
 * CLN_INPUT if a name is of no photo, or of several, or if there is none. */
cln_status cln_scene_list_tests(cln_scene *scene, const char *file, const cln_scene *kept);
/* Likewise those that train, once all are split: other training views become val. CLN_INPUT also if
 * one that is named is no training view. */
cln_status cln_scene_list_trained(cln_scene *scene, const char *file, const cln_scene *kept);

/* since.c: after the split, of a scene that is the run's by most names and by their poses. If it
 * was split by a count, as `kept` was, every Nth is another one once photos came or went: those
 * that the run had stay what they were, and new ones train, which split_rule tells. Fills in which
 * views the run was trained on, and warns of such test views. */
cln_status cln_scene_keep_split(cln_scene *scene, const cln_scene *kept, bool counted);

/* load.c: takes frames whose image file is missing or cannot be read (by its first and last bytes;
 * with CLN_MISSING_SKIP by all of it, undecoded) out of the views and puts them behind these, with
 * a warning. CLN_INPUT if `rule` (config.missing) allows none to be left out, or not so many, or if
 * no training view remains. Called after the split, so that the others stay in theirs. */
cln_status cln_scene_leave_out(cln_scene *scene, int rule);

/* load.c: likewise frames without alpha or mask, where masks or images of at least half the others
 * cut an object out: what surrounds it would be part of it. Once masks are read, before sizes.
 * CLN_INPUT if no training view remains. */
cln_status cln_scene_leave_uncut_out(cln_scene *scene);

/* load.c: fills in the views' `file`. CLN_MEMORY. */
cln_status cln_scene_name_files(cln_scene *scene);

/* cutout.c: gives masks that are alpha, by config.masks, to the views as alpha files; fills
 * mask_count, masks_alpha, masks_doubtful and masks_rule. Once it is known which photos have alpha.
 * CLN_INPUT if a mask cannot be read. */
cln_status cln_scene_read_masks(cln_scene *scene, const cln_scene_desc *desc);

/* images.c: the share of their pixels that the masks of loaded views leave, 1 without any; views:
 * how many have one. */
double cln_scene_masks_leave(const cln_scene *scene, int *views);

/* Below this share likely the wrong colour counts. */
#define CLN_MASKS_LEAST 0.1
/* Below this share of the pixels masks leave little; then masks_doubtful is worth a remark. */
#define CLN_MASKS_LEAVE 0.7
#define CLN_MASKS_ADVICE                                                                           \
    "if the masks are of an object, what they drop is not only of no use but empty: --masks alpha" \
    " reads them so, --masks ignore as now, without this remark"

/* cutout.c: turns a decoded mask of `count` pixels into alpha, in its first three channels: of
 * labels (0 and 1) all but 0 is opaque, of a cut-out its own alpha counts. */
void cln_mask_to_alpha(uint8_t *mask, size_t count, int channels, bool jpeg);

/* What the alpha of loaded views keeps: [view_count] CLN_ALPHA_*. NONE: no alpha, or its pixels are
 * not here; REVERSED: all but one part around the middle, which is well below the whole.
 * CLN_MEMORY. */
enum { CLN_ALPHA_NONE, CLN_ALPHA_OBJECT, CLN_ALPHA_REVERSED, CLN_ALPHA_OTHER };
cln_status cln_alpha_shapes(const cln_scene *scene, uint8_t *shapes);

/* Of images that have nearly, but not quite the size that their cameras are given for. */
#define CLN_NEARLY_ADVICE                                                                         \
    "so small a difference is that between photos and their undistorted or cropped copies: give " \
    "those that the poses are of (of COLMAP's dense/sparse, dense/images)"

/* turned.c: has the camera the shape of such an image? False if it has no size. */
bool cln_camera_has_shape(const cln_camera *camera, int width, int height);

/* turned.c: decides which photos with an EXIF orientation are turned, and swaps their file_width
 * and file_height if it is a quarter turn. Before cameras are brought to the files' size. */
void cln_scene_find_turns(cln_scene *scene);
/* turned.c: how alpha and mask files are turned to lie on their photos' pixels, and what is black
 * in masks. CLN_INPUT if one has neither the stored nor the turned picture's size. */
cln_status cln_scene_turn_masks(cln_scene *scene);
/* Adds those of which nothing tells that they are right to the findings. */
void cln_scene_doubt_turns(const cln_scene *scene, json_t *findings);
/* And all others, by what marks of photos tell of them. */
void cln_scene_tell_turns(const cln_scene *scene, const cln_agreement *agreement, json_t *findings);

/* images.c: sizes and channels from the files' headers; cameras are brought to the files' size,
 * checked, then brought to the downscaled size. Fills downscale, has_alpha, lenses. */
cln_status cln_scene_size_views(cln_scene *scene, const cln_scene_desc *desc);

/* opaque.c: if no photo of a scene without alpha files has a pixel that is not opaque, those with
 * alpha get 3 channels, and are `opaque`. Every rank looks, and finds the same. By
 * desc.opaque_digest, it is believed; once the images are read, cln_scene_check_opaque sets `hides`
 * if it was wrong, as it can be of a changed scene. */
cln_status cln_scene_find_opaque(cln_scene *scene, const cln_scene_desc *desc);
cln_status cln_scene_check_opaque(cln_scene *scene, const cln_scene_desc *desc);
/* Are all of `count` pixels of 4 channels opaque? */
bool cln_image_is_opaque(const uint8_t *pixels, size_t count);

/* kept.c: finds the pixels that have no ray; fills maps, and the views' kept and left_out.
 * CLN_INPUT if no pixel of a view has a ray. */
cln_status cln_scene_find_kept(cln_scene *scene);

/* images.c: decides where the images of the wanted splits go, and fills cached. They go into memory
 * if they and two that are being read need at most config.host_mem bytes (0: those of the machine)
 * and leave desc.elsewhere of them; else into a store, of which an eighth of host_mem is in memory.
 * Other needs of memory can move them there later (cln_scene_shrink). CLN_MEMORY if not even two
 * can be read. */
cln_status cln_scene_place_images(cln_scene *scene, const cln_scene_desc *desc);

/* images.c: reads every image file for the digest, and decodes those of the wanted splits; of
 * several ranks, each its own. Sets `hides` if one that is believed to be opaque is not. CLN_USAGE
 * if their files, masks or turns differ. */
cln_status cln_scene_read_images(cln_scene *scene, const cln_scene_desc *desc);

/* background.c: the background, by config.background and the training photos that are loaded. */
cln_status cln_scene_find_background(cln_scene *scene, const cln_config *config);

/* bounds.c: the cube, by the first of its rules that applies; fills space and bounds_rule. Of
 * config: space, bbox, stage1. */
cln_status cln_scene_find_bounds(cln_scene *scene, const cln_reader_result *result,
                                 const cln_config *config);

/* bounds_forward.c: finds the forward space of the training cameras and *because, a phrase that
 * says why. If there is none, refused[] says why, and *because stays as it was. CLN_MEMORY. */
enum { CLN_REFUSED_BYTES = 256 };
cln_status cln_scene_find_forward(const cln_scene *scene, const cln_reader_result *result,
                                  cln_space *space, char **because,
                                  char refused[CLN_REFUSED_BYTES]);

/* points_dropped.c: marks the points that masks drop in all photos in which they were found, and
 * counts them. Once views have their sizes and kept pixels; CLN_MEMORY. */
cln_status cln_scene_drop_points(const cln_scene *scene, cln_reader_result *result);

/* images.c: reads the view's mask into its `kept` and `masked`. CLN_INPUT. */
cln_status cln_view_read_mask(cln_view *view);

/* bounds_points.c: the box of the reader's points and of what the training images show there;
 * *found = false if there are too few of them. */
cln_status cln_scene_box_of_points(const cln_scene *scene, const cln_reader_result *result,
                                   double low[3], double high[3], bool *found);

/* sights.c: fills sights from the reader's observations. Views have their sizes and kept pixels. */
cln_status cln_scene_find_sights(cln_scene *scene, const cln_reader_result *result);
/* depth_points.c: whether training views' depth images fit each other: depths_fit. If not, that is
 * told, and their points are no points. CLN_MEMORY. */
cln_status cln_scene_check_depths(cln_scene *scene, cln_reader_result *result,
                                  const cln_callbacks *callbacks);
/* Adds the sights of depth images, if they fit. CLN_MEMORY. */
cln_status cln_scene_depth_sights(cln_scene *scene);
/* Leaves those out whose pixels alpha cuts away or masks drop: what a depth image or a point shows
 * there is not of the object. Photos are read. CLN_MEMORY. */
cln_status cln_scene_clear_sights(cln_scene *scene);
/* Finds their pixels anew, after the cameras have moved. */
void cln_scene_place_sights(cln_scene *scene);

/* bounds.c: CLN_INPUT if no training camera has a ray through the cube. */
cln_status cln_scene_check_seen(const cln_scene *scene);

/* doubts.c: of fewer training photos, nothing is known of what lies how far. */
enum { CLN_LEAST_PHOTOS = 3 };
/* Do fewer than CLN_FEW_AROUND training photos, but not fewer than those, stand around what they
 * look at, apart by 60 degrees or more? */
enum { CLN_FEW_AROUND = 9 };
bool cln_scene_few_around(const cln_scene *scene);

/* Tells if most rays through opaque pixels of training photos with alpha miss the cube, and names a
 * box around what they show. Counts loaded photos alone. */
void cln_scene_tell_missed(const cln_scene *scene, json_t *findings);

/* doubts.c: fills cube_share, spread, apart_share and, by the reader's points, before_share. */
void cln_scene_find_doubts(cln_scene *scene, const cln_reader_result *result);
/* Adds what they make doubtful to the findings (inspect.h). */
void cln_scene_tell_doubts(const cln_scene *scene, json_t *findings);

#endif
