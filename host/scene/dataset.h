/* What readers share: names, image files and folders, lens models by the names that datasets use,
 * and poses given the other way round. Private to this room. `where` begins the sentences of
 * errors: the file, and what in it. */
#ifndef CLN_SCENE_DATASET_H
#define CLN_SCENE_DATASET_H

#include "scene/reader.h"

enum { CLN_MAX_VIEWS = 100000, CLN_IMAGE_FOLDERS = 4 };

/* "images" and those of smaller copies, the largest first. */
extern const char *const cln_image_folders[CLN_IMAGE_FOLDERS];

/* Endings of videos, in lower case. */
#define CLN_VIDEO_ENDINGS " mp4 mov m4v mkv webm avi mts m2ts ts mpg mpeg wmv ogv 3gp insv "

/* `path` relative to the scene, for messages; unchanged if it lies elsewhere. */
const char *cln_dataset_within(const char *scene, const char *path);

/* "./train//r_0" -> "train/r_0". Components "." and ".." go, so that a name never leads out of a
 * folder that results are written to. CLN_INPUT if nothing is left or if it is not UTF-8, as JSON
 * must be. The caller frees *out. */
cln_status cln_dataset_name(const char *where, const char *file_path, char **out);

/* The PNG and JPEG files in a folder and the folders in it, relative to it, ordered byte by byte.
 * The caller frees them with cln_dataset_free_names, also after a failure. */
typedef struct cln_names {
    int count;
    char **name; /* [count] */
} cln_names;
cln_status cln_dataset_images(const char *folder, cln_names *out);
/* Orders names so; whether ordered ones have a name. */
void cln_dataset_sort_names(cln_names *names);
bool cln_dataset_has_name(const cln_names *names, const char *name);
cln_status cln_dataset_videos(const char *folder, cln_names *out);  /* likewise */
cln_status cln_dataset_folders(const char *folder, cln_names *out); /* of the folders in it */
/* The images in no order; shallow: not of the folders in it. */
cln_status cln_dataset_images_of(const char *folder, bool shallow, cln_names *out);
bool cln_dataset_is_image(const char *name); /* by the ending of PNG and JPEG files */
bool cln_dataset_is_video(const char *name); /* by the ending */
void cln_dataset_free_names(cln_names *names);

/* masks.c: whether an image is called as OpenDroneMap's mask of one of these (NAME_mask of NAME);
 * CLN_MEMORY. And whether readers look for masks in a folder of that name. */
cln_status cln_dataset_is_mask_of(const char *name, const cln_names *images, bool *is);
bool cln_dataset_has_masks(const char *folder);

/* Photos in formats that are not read, by their endings, in a folder and the folders in it: how
 * many and, relative to the folder, the first that is called like the photo `name` but for the
 * ending; name NULL: the first of all. *first is NULL if there is none; the caller frees it. */
cln_status cln_dataset_unread(const char *folder, const char *name, int *count, char **first);
/* The same of all but those that are beside one of the photos that are read, called alike but for
 * the ending, as a camera's raw file or a phone's HEIC. */
cln_status cln_dataset_unread_alone(const char *folder, const cln_names *photos, int *count,
                                    char **first);

/* By the ending: is it a photo in such a format? And how it becomes one that is read, " (...)", of
 * phones' formats; else "". */
bool cln_dataset_is_unread(const char *name);
const char *cln_dataset_converter(const char *name);

/* "a/b.png" -> "FOLDER/a/bENDING", the file that belongs to an image. The caller frees *out. */
cln_status cln_dataset_beside(const char *folder, const char *image, const char *ending,
                              char **out);

/* Keeps the images that have such a file, in their order; without: how many have none. */
cln_status cln_dataset_keep_with(const char *folder, const char *ending, cln_names *images,
                                 int *without);

/* Frees the names from `kept` on. */
void cln_dataset_cut_names(cln_names *names, int kept);

/* Warns of photos in a folder that are left out, if there are any, as they have none of `what`. */
void cln_dataset_tell_without(const char *folder, const char *what, int without, int kept);

/* Makes a view for each of these images of a folder, with name (below the folder) and path. */
cln_status cln_dataset_views(const char *where, const char *folder, const cln_names *images,
                             cln_reader_result *result);

/* The folder of images of `base` where a dataset fixes their order but not their folder: `images`,
 * else the first of images_2, images_4 and images_8, which have smaller copies. *out is NULL if
 * there is none of them; the caller frees it. */
cln_status cln_dataset_image_folder(const char *base, char **out);

/* masks_black.c: writes, for each of these images that has a mask (as readers find it in `scene` or
 * beside them; NULL: not looked for) or alpha that cuts something away, OUT/NAME.png: grey, as
 * large as the image is stored, 0 where the mask is black or nothing is. CLN_INPUT, CLN_OUTPUT,
 * CLN_MEMORY, CLN_SIGINT, CLN_SIGTERM. */
typedef struct cln_black_masks {
    int written, count, cut; /* images; with a mask; whose alpha cuts away */
    double black;            /* share of black in what was written, in the mean */
} cln_black_masks;
cln_status cln_dataset_write_black(const char *scene, const char *images, const cln_names *names,
                                   const char *out, const cln_callbacks *callbacks,
                                   cln_black_masks *masks);

/* points_ply.c: reads the points of a PLY file into result->points. CLN_INPUT, CLN_MEMORY. */
cln_status cln_dataset_read_ply(const char *path, cln_reader_result *result);

/* depth_points.c: points of the view's depth image, for the cube. A view's pose and camera are read
 * before; of a file that is no such image there are no points. CLN_MEMORY. */
cln_status cln_dataset_depth_points(const cln_view *view, cln_reader_result *result);
/* Tells if there were some, but no point in any of them. */
void cln_dataset_tell_depths(const char *where, const cln_reader_result *result);
/* Of so many photos, evenly chosen, depth images are read. */
enum { CLN_DEPTH_PHOTOS = 200 };

/* "OPENCV (k1 k2 p1 p2), ...": every lens model there is. The caller frees *out. */
cln_status cln_dataset_lenses(char **out);

/* A camera-to-world pose with OpenGL's axes (x right, y up, z backwards) -> ours. */
void cln_dataset_from_opengl(double c2w[12]);

/* World-to-camera x' = R x + t (R row-major) -> camera-to-world. R is taken as it is: checks follow
 * for every format. */
void cln_dataset_pose(const double rotation[9], const double translation[3], double c2w[12]);

#endif
