/* Image files that are not where a dataset names them, as it was made on another machine, or on a
 * system that takes IMG_1.JPG for img_1.jpg. Private to this room; used by every reader whose
 * dataset names its images. What is found by their names, also in
 * the other Unicode form (base/unicode.h):
 *   - a file below the folder with the same path but for upper and lower case;
 *   - the file that the longest end of the path leads to from the folder, with a folder at least:
 *     images/a.png for /home/x/data/images/a.png;
 *   - of a path that leads out of the folder, or (bare) has no folders where the dataset does not
 *     say where its images are, the only file below it with that name, but in folders of masks and
 *     the like;
 *   - that file, too, if no image of the dataset is anywhere else, and each has one; of several in
 *     images, images_2, images_4 and images_8 the first.
 * Nothing is taken where two files match alike, nor a file that a frame of another name has by an
 * earlier rule or by the same one; nor one of another scene in the folder: COLMAP's undistorted
 * photos, in dense/0/images beside dense/0/sparse, have the names of those that lenses bent. */
#ifndef CLN_SCENE_MOVED_H
#define CLN_SCENE_MOVED_H

#include "scene/dataset.h"

/* A folder that is looked through, once the first file is missing; {.folder = F} begins it. */
typedef struct cln_moved {
    const char *folder;
    const char *model; /* where the dataset's poses are, below `folder`: no other scene; or NULL */
    bool shallow;      /* not the folders in it */
    bool bare;         /* names without folders are found in any */
    bool listed;
    cln_names files; /* relative to it, ordered by name without case and ending */
    cln_names apart; /* likewise, of other scenes */
} cln_moved;
void cln_moved_free(cln_moved *moved);

/* Does a path of a dataset lead out of its folder? */
bool cln_path_leads_out(const char *path);

/* Has a folder of this name other pictures of views than photos: masks, depths? */
bool cln_is_no_photos(const char *name);

/* Finds the file that is meant by `name` (of cln_dataset_name); leads_out: its path did. *out: its
 * path, which the caller frees; NULL if there is none, or more than one. */
cln_status cln_moved_find(cln_moved *moved, const char *name, bool leads_out, char **out);

/* For lists that name frames in another way than the frames do: which of the names is meant by
 * `name`, that has folders before it which the other lacks, or lacks them, or the ending, or
 * differs in case. found: NULL twice if none is; two names if there is no telling which. The names
 * are sorted by cln_moved_sort. */
void cln_moved_sort(cln_names *names);
void cln_moved_meant(const cln_names *names, const char *name, const char *found[2]);

/* Does the file lie in a folder of masks and the like, or of photos in another size? */
bool cln_moved_is_aside(const char *file);

/* Gives the views whose file is not at their path the path of the file that is meant, and counts
 * these in the result, with an example. */
cln_status cln_moved_views(cln_moved *moved, cln_reader_result *result);

/* For another file that a dataset names: the longest end of the path that leads to a file from
 * the folder; *out is NULL if there is none. */
cln_status cln_moved_file(const char *folder, const char *path, char **out);

/* Length of the first folder on the way from `folder` to a file in it that is another scene; 0 if
 * none is. */
cln_status cln_moved_scene(const cln_moved *moved, const char *file, size_t *length);

/* The folder in `folder` that is another scene, and has a file of this name; *out is NULL if there
 * is none. The caller frees it. */
cln_status cln_moved_apart(cln_moved *moved, const char *name, char **out);

/* Which files of the folder are called like `name`, as "; A is there: ..." or "". The caller frees
 * *out. */
cln_status cln_moved_hint(cln_moved *moved, const char *name, char **out);

#endif
