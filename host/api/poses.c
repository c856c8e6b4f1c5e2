/* cln_find_poses: photos or a video in, a scene with poses out, by COLMAP's own program, where it
 * is installed. What it leaves:
 *
 *   SCENE/images/       hard links to the photos (copies on another disk), or the video's frames
 *                       (photo_folder.c)
 *   SCENE/masks/        likewise the photos' masks, if some were given (photo_masks.c)
 *   SCENE/sparse/0/     the largest model, which readers take; by GPS, if asked for (photo_gps.c)
 *   SCENE/colmap.db     COLMAP's features and matches, and colmap.stamp, of which photos they are
 *   SCENE/colmap.log    every command with its output
 *
 * Photos of one size and, by EXIF data, focal length are one camera's (photo_cameras.c), all with
 * one model of lens. This file checks and makes the folder; colmap.c runs the program.
 *
 * Photos are matched all with all, or each with the next ones where there are many and their
 * names are numbered without many gaps, as cameras and videos number them. */
#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/settings.h"
#include "base/text.h"
#include "api/colmap.h"
#include "api/photo_folder.h"
#include "api/photo_gps.h"
#include "api/photo_masks.h"
#include "cl_nascent.h"
#include "io/command.h"
#include "io/disk.h"
#include "io/image.h"
#include "scene/dataset.h"
#include "scene/found.h"
#include "scene/inspect.h"
#include "scene/origin.h"
#include "scene/reader.h"

/* Bytes that a photo's features need in the database: of so many pixels, and at most. */
static const double ROOM_PIXEL = 4, ROOM_PHOTO = 1 << 20;
static const double SWEEP = 2.2; /* a photo's sides; panoramas of all around have 2 */

typedef struct work {
    const cln_poses_desc *desc;
    cln_poses_result *result;
    cln_film film; /* where the photos come from a video */
    cln_colmap colmap;
    char *stamp; /* of which photos the features are */
    cln_photo_gps gps;
    cln_names photos, among; /* in their folder, and the masks there */
    int posed;               /* so many poses are there already, which are to be placed by GPS */
} work;

/* ---- photos ---- */

/* The number at the end of a name, before its extension; -1 without. */
static long number_of(const char *name)
{
    const char *dot = strrchr(name, '.'), *at = dot ? dot : name + strlen(name);
    const char *end = at;

    while (at > name && isdigit((unsigned char)at[-1]))
        at--;
    return at == end || end - at > 9 ? -1 : strtol(at, NULL, 10);
}

static int by_name(const void *a, const void *b)
{
    return cln_natural_compare(*(char *const *)a, *(char *const *)b);
}

/* Are the photos numbered in the order of their names, with few gaps? */
static bool in_sequence(const cln_names *photos)
{
    int steps = 0;

    for (int i = 1; i < photos->count; i++) {
        const long before = number_of(photos->name[i - 1]), now = number_of(photos->name[i]);

        steps += before >= 0 && now > before && now <= before + 3;
    }
    return steps >= 0.9 * (photos->count - 1);
}

/* ---- the scene ---- */

/* Refuses so few photos; `folder`: where those in other formats, or a video, may be, or NULL. */
static cln_status fail_few(const char *photos, int count, const char *folder)
{
    cln_status st = CLN_OK;
    char *unread = NULL, *video = NULL, quoted[CLN_QUOTED_BYTES];
    cln_names videos = {0};
    int others = 0;

    if (folder)
        CLN_TRY(cln_dataset_unread(folder, NULL, &others, &unread));
    if (folder)
        CLN_TRY(cln_dataset_videos(folder, &videos));
    if (unread)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: has %d PNG or JPEG photo%s, and %d in formats that are not read (the "
                         "first is '%s'): convert them to JPEG%s; finding poses needs at least "
                         "three",
                         photos, count, cln_plural(count, "", "s"), others, unread,
                         cln_dataset_converter(unread)));
    if (videos.count) {
        CLN_TRY(cln_path_join(&video, folder, videos.name[0]));
        cln_shell_quote(video, quoted, sizeof quoted);
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: has %d PNG or JPEG photo%s, and %d video%s; of a video give the file "
                         "itself: cl-nascent poses %s -o SCENE",
                         photos, count, cln_plural(count, "", "s"), videos.count,
                         cln_plural(videos.count, "", "s"), quoted));
    }
    CLN_TRY(cln_fail(CLN_INPUT, "%s: has %d PNG or JPEG photos; finding poses needs at least three",
                     photos, count));
done:
    cln_dataset_free_names(&videos);
    free(video);
    free(unread);
    return st;
}

/* Those in formats that are not read, and videos, beside others, are told; a photo that is cut off,
 * as copies are, would be found after hours of COLMAP's work. */
static cln_status check_readable(const char *folder, const cln_names *photos)
{
    cln_status st = CLN_OK;
    char *path = NULL, *unread = NULL, *first = NULL;
    cln_names videos = {0};
    int others = 0, bad = 0;

    CLN_TRY(cln_dataset_videos(folder, &videos));
    if (videos.count)
        cln_info("%s: the photos are taken, %d video%s beside them (the first is '%s') %s not; "
                 "poses takes a video by itself",
                 folder, videos.count, cln_plural(videos.count, "", "s"), videos.name[0],
                 cln_plural(videos.count, "is", "are"));
    CLN_TRY(cln_dataset_unread_alone(folder, photos, &others, &unread));
    if (unread)
        cln_warn("%s: %d photo%s in formats that are not read %s left out (the first is '%s'); "
                 "convert them to JPEG%s to have them, too",
                 folder, others, cln_plural(others, "", "s"), cln_plural(others, "is", "are"),
                 unread, cln_dataset_converter(unread));
    for (int i = 0; i < photos->count; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, photos->name[i]));
        st = cln_image_check_ends(path);
        if (st == CLN_INPUT) {
            if (bad++ == 0)
                CLN_TRY(cln_strdup(&first, cln_error_text()));
            cln_clear_error();
            st = CLN_OK;
        }
        CLN_TRY(st);
    }
    if (bad)
        CLN_TRY(
            cln_fail(CLN_INPUT,
                     "%s: %d of %d photos cannot be read; mend %s or move %s out of the folder. "
                     "The first is %s",
                     folder, bad, photos->count, cln_plural(bad, "it", "them"),
                     cln_plural(bad, "it", "them"), first));
done:
    cln_dataset_free_names(&videos);
    free(path);
    free(unread);
    free(first);
    return st;
}

/* Leaves out what a phone puts together while it is swept round, which no lens explains: the poses
 * of all would suffer. in_place: COLMAP looks at all images of the folder. */
static cln_status leave_out_sweeps(const char *folder, bool in_place, cln_names *photos)
{
    cln_status st = CLN_OK;
    const char *first = NULL;
    char *path = NULL;
    bool *is = NULL;
    int count = 0, left = 0;

    CLN_TRY(cln_alloc(&is, (size_t)photos->count, sizeof *is, "photos"));
    for (int i = 0; i < photos->count; i++) {
        cln_image_head head;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, photos->name[i]));
        CLN_TRY(cln_image_read_head(path, &head));
        is[i] = fmax(head.width, head.height) > SWEEP * fmin(head.width, head.height);
        count += is[i];
        first = is[i] && !first ? photos->name[i] : first;
    }
    if (count == 0 || 4 * count > photos->count || photos->count - count < CLN_POSES_LEAST)
        goto done;
    cln_warn("%s: %d photo%s far longer than the others%s (%s%s): panoramas that a phone put "
             "together fit no lens, and spoil the poses of all%s",
             folder, count, cln_plural(count, "", "s"),
             in_place     ? ""
             : count == 1 ? " is left out"
                          : " are left out",
             first, count > 1 ? ", ..." : "", in_place ? "; move them out of the folder" : "");
    for (int i = 0; i < photos->count && !in_place; i++)
        if (is[i])
            free(photos->name[i]);
        else
            photos->name[left++] = photos->name[i];
    photos->count = in_place ? photos->count : left;
done:
    free(path);
    free(is);
    return st;
}

/* Room for the photos' features, and for the photos where they are copied to another disk. */
static cln_status check_photos_room(const char *folder, const cln_names *photos, const char *out)
{
    cln_status st = CLN_OK;
    char *path = NULL, *there = NULL, *copy = NULL, what[64];
    double bytes = 0;
    struct stat info, disk;

    CLN_TRY(cln_disk_nearest(out, &there));
    for (int i = 0; i < photos->count; i++) {
        int width = 0, height = 0, channels = 0;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, photos->name[i]));
        CLN_TRY(cln_image_info(path, &width, &height, &channels));
        bytes += fmin(ROOM_PHOTO, ROOM_PIXEL * width * height);
        CLN_TRY(cln_asprintf(&copy, "%s/images/%s", out, photos->name[i]));
        if (stat(path, &info) == 0 && stat(there, &disk) == 0 && info.st_dev != disk.st_dev &&
            !cln_is_file(copy))
            bytes += (double)info.st_size;
        free(copy);
        copy = NULL;
    }
    snprintf(what, sizeof what, "%d photos and their features", photos->count);
    CLN_TRY(cln_disk_check(out, bytes, what));
done:
    free(path);
    free(copy);
    free(there);
    return st;
}

/* COLMAP looks at all images of the scene's folder. in_place: that is the photos' own. */
static cln_status refuse_masks_in_place(const work *w, bool *in_place)
{
    cln_status st = CLN_OK;
    char *images = NULL;

    CLN_TRY(cln_path_join(&images, w->desc->out, "images"));
    *in_place = cln_is_same_file(images, w->desc->photos);
    if (w->among.count && *in_place)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the scene's own photos have %d mask%s among them (the first is "
                         "'%s'), which COLMAP would take for photos; move %s to %s/masks, and give "
                         "--mask-path with that",
                         images, w->among.count, cln_plural(w->among.count, "", "s"),
                         w->among.name[0], cln_plural(w->among.count, "it", "them"), w->desc->out));
done:
    free(images);
    return st;
}

/* Enough photos, before the folder of the scene is made. A folder that is a scene already needs no
 * poses. */
static cln_status check_photos(work *w)
{
    const char *folder = w->desc->photos, *out = w->desc->out;
    cln_status st = CLN_OK;
    const cln_reader *reader = NULL;
    char *others = NULL;
    cln_names *photos = &w->photos;
    bool in_place = false;
    cln_photo_gps gps = {0};

    if (cln_found_run(folder))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: it holds a run, whose pictures are no photos; give the folder of the "
                         "photos",
                         folder));
    if (photos->count < CLN_POSES_LEAST)
        CLN_TRY(fail_few(folder, photos->count, folder));
    CLN_TRY(check_readable(folder, photos));
    if (!w->posed) {
        CLN_TRY(refuse_masks_in_place(w, &in_place));
        CLN_TRY(leave_out_sweeps(folder, in_place, photos));
    }
    if (w->desc->gps) {
        CLN_TRY(cln_photo_gps_read(folder, photos, &gps));
        CLN_TRY(cln_photo_gps_check(&gps, folder, photos->count));
    }
    if (w->posed)
        goto done;
    CLN_TRY(check_photos_room(folder, photos, out));
    if (cln_reader_pick(folder, CLN_FORMAT_AUTO, &reader, &others) == CLN_OK && reader)
        cln_warn("%s: it is a scene with poses already (%s reads it); `cl-nascent info` shows "
                 "them",
                 folder, reader->name);
    cln_clear_error();
done:
    free(others);
    cln_photo_gps_free(&gps);
    return st;
}

/* The scene's folder can be written, and does not lie in that of the photos, where a second try
 * would take its images for photos, too. */
static cln_status check_out(const char *photos, const char *out)
{
    cln_status st = CLN_OK;
    char *there = NULL, *around = NULL, *up = NULL;
    size_t length = 0;

    if (!cln_is_dir(photos))
        goto done;
    CLN_TRY(cln_path_absolute(&there, photos));
    CLN_TRY(cln_disk_nearest(out, &up));
    CLN_TRY(cln_path_absolute(&around, up));
    length = strlen(there);
    if (strncmp(around, there, length) == 0 && (around[length] == 0 || around[length] == '/'))
        CLN_TRY(cln_fail(CLN_USAGE,
                         "-o %s: it lies in the folder of photos, where another try would take its "
                         "images for photos; give a folder beside %s",
                         out, there));
done:
    free(there);
    free(around);
    free(up);
    return st;
}

/* The scene's folder has no poses, which would be read in place of the new ones. */
static cln_status check_unposed(const char *out)
{
    cln_status st = CLN_OK;
    const cln_reader *reader = NULL;
    char *others = NULL;

    if (cln_has_dir(out, "sparse"))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: it has poses already (sparse); give another folder with -o, or "
                         "remove that one (--gps places what is in sparse/0 by the photos' GPS "
                         "positions, also again)",
                         out));
    if (cln_is_dir(out) && cln_reader_pick(out, CLN_FORMAT_AUTO, &reader, &others) == CLN_OK)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: it has poses already, which would be read in place of new ones: %s "
                         "takes it, which wants %s; give another folder with -o, or move the old "
                         "poses away",
                         out, reader->name, reader->wants));
    cln_clear_error();
done:
    free(others);
    return st;
}

/* How many images has the model that is there, which GPS can place, also again? */
static cln_status find_posed(const char *out, int *posed)
{
    cln_status st = CLN_OK;
    char *model = NULL, *read = NULL;

    CLN_TRY(cln_path_join(&model, out, "sparse/0"));
    *posed = cln_colmap_images(model);
    if (*posed)
        CLN_TRY(cln_colmap_read_from(out, &read));
    if (read && !cln_is_same_file(read, model))
        CLN_TRY(
            cln_fail(CLN_OUTPUT,
                     "%s: --gps places sparse/0, but the model that is read of this scene is in "
                     "%s; move one of the two out of the scene, or give a folder with the one "
                     "as sparse/0",
                     out, read));
done:
    free(model);
    free(read);
    return st;
}

static cln_status check_folder(work *w)
{
    const char *out = w->desc->out;
    cln_status st = CLN_OK;

    if (w->desc->gps)
        CLN_TRY(find_posed(out, &w->posed));
    if (!w->posed)
        CLN_TRY(check_unposed(out));
    if (access(w->desc->photos, F_OK) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: it is not there; give a folder of photos, or a video",
                         w->desc->photos));
    if (!cln_is_dir(w->desc->photos) && cln_dataset_is_image(w->desc->photos))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: a single photo; give the folder that it is in with others",
                         w->desc->photos));
    if (!cln_is_dir(w->desc->photos) && cln_dataset_is_unread(w->desc->photos))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: a single photo, in a format that is not read; convert it and the "
                         "others to JPEG%s, and give their folder",
                         w->desc->photos, cln_dataset_converter(w->desc->photos)));
    if (!cln_is_dir(w->desc->photos) && !cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: neither a folder of photos nor a video; give one of these (an archive: unpack it)",
            w->desc->photos));
    if (cln_photos_are_video(w->desc->photos) && !w->colmap.lens &&
        strcasecmp(strrchr(w->desc->photos, '.'), ".insv") == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: a video of a camera that sees all around, before its two pictures "
                         "are put together; let Insta360's own program make a panorama video of "
                         "it (--lens OPENCV_FISHEYE takes it as it is)",
                         w->desc->photos));
    if (w->desc->gps && cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_fail(CLN_USAGE,
                         "%s: --gps: a video's frames have no GPS positions; leave it out, or give "
                         "a folder of photos that have them",
                         w->desc->photos));
    if (w->desc->masks && w->posed)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--mask-path: %s has poses already, which masks do not change; leave it "
                         "out",
                         out));
    if (cln_is_dir(w->desc->photos))
        CLN_TRY(cln_photos_find(w->desc->photos, w->desc->masks, &w->photos, &w->among));
    if (w->desc->masks)
        CLN_TRY(cln_photo_masks_check(w->desc->masks, w->desc->photos, &w->among));
    if (cln_is_dir(w->desc->photos))
        CLN_TRY(check_photos(w));
    CLN_TRY(cln_disk_check(out, 0, ""));
    if (!w->posed) {
        CLN_TRY(check_out(w->desc->photos, out));
        CLN_TRY(cln_photos_check_out(w->desc->photos, out));
    }
    if (!cln_command_found("colmap"))
        CLN_TRY(cln_fail(
            CLN_FAILED,
            "finding poses needs COLMAP, which is not installed; install it "
            "(Debian: apt install colmap; others: https://colmap.github.io), "
            "or bring poses of another program (transforms JSON, COLMAP, LLFF, NeuS, NSVF, "
            "OpenSfM, Metashape, Polycam, Record3D)"));
    if (cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_photos_probe(w->desc, &w->film));
done:
    return st;
}

/* Names and sizes of files; timed: when they were written, too. */
static cln_status add_files(const char *folder, const cln_names *names, bool timed, uint64_t *d)
{
    cln_status st = CLN_OK;
    char *path = NULL, *line = NULL;

    for (int i = 0; i < names->count; i++) {
        struct stat info = {0};

        free(path);
        free(line);
        path = line = NULL;
        CLN_TRY(cln_path_join(&path, folder, names->name[i]));
        if (stat(path, &info) != 0)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path, strerror(errno)));
        CLN_TRY(cln_asprintf(&line, "%s %lld %lld.%09ld", names->name[i], (long long)info.st_size,
                             timed ? (long long)info.st_mtim.tv_sec : 0,
                             timed ? info.st_mtim.tv_nsec : 0));
        *d = cln_digest(*d, line, strlen(line) + 1);
    }
done:
    free(path);
    free(line);
    return st;
}

/* A digest of what features and matches are of: the photos, their masks, and what was asked for. */
static cln_status tell_photos(const work *w, char text[CLN_DIGEST_TEXT])
{
    cln_status st = CLN_OK;
    const cln_colmap *c = &w->colmap;
    uint64_t d = CLN_DIGEST_START;
    char *line = NULL, *masks = NULL;
    cln_names names = {0};

    CLN_TRY(cln_asprintf(&line, "%s %s", c->lens ? c->lens->name : "auto",
                         w->desc->match ? w->desc->match : "auto"));
    d = cln_digest(d, line, strlen(line) + 1);
    /* frames are written anew */
    CLN_TRY(add_files(c->images, &c->photos, !cln_photos_are_video(w->desc->photos), &d));
    if (w->desc->masks) {
        CLN_TRY(cln_path_join(&masks, w->desc->out, "masks"));
        CLN_TRY(cln_dataset_images(masks, &names));
        CLN_TRY(add_files(masks, &names, true, &d));
    }
    cln_digest_text(d, text);
done:
    free(line);
    free(masks);
    cln_dataset_free_names(&names);
    return st;
}

/* Goes on with the features and matches of an earlier attempt by the same photos and the same
 * words, which may be the work of hours: COLMAP does what is missing. Removes those of others. */
static cln_status keep_features(work *w)
{
    static const char *const beside[] = {"", "-wal", "-shm", "-journal"}; /* SQLite's */
    cln_status st = CLN_OK;
    const cln_colmap *c = &w->colmap;
    char *path = NULL, *kept = NULL, text[CLN_DIGEST_TEXT];
    size_t bytes = 0;

    CLN_TRY(tell_photos(w, text));
    CLN_TRY(cln_path_join(&w->stamp, w->desc->out, "colmap.stamp"));
    if (cln_is_file(w->stamp) && cln_is_file(c->database)) {
        CLN_TRY(cln_read_file(w->stamp, SIZE_MAX / 2, &kept, &bytes));
        if (bytes == strlen(text) && memcmp(kept, text, bytes) == 0) {
            cln_info("poses: goes on with the features and matches of the attempt before (%s; "
                     "remove it to begin anew)",
                     c->database);
            goto done;
        }
    }
    for (size_t i = 0; i < sizeof beside / sizeof *beside; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s%s", c->database, beside[i]));
        if (unlink(path) != 0 && errno != ENOENT)
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s: of an earlier attempt, and cannot be removed: %s; remove it, or "
                             "give another folder with -o",
                             path, strerror(errno)));
    }
    CLN_TRY(cln_write_file(w->stamp, text, strlen(text)));
done:
    free(path);
    free(kept);
    return st;
}

/* Readers want the photos of poses that are there, too: where none lie in the scene, links. */
static cln_status link_missing(const work *w)
{
    cln_status st = CLN_OK;
    char *images = NULL, *there = NULL, *scene = NULL;
    cln_names names = {0};
    size_t length = 0;

    CLN_TRY(cln_path_join(&images, w->desc->out, "images"));
    CLN_TRY(cln_path_absolute(&there, w->desc->photos));
    CLN_TRY(cln_path_absolute(&scene, w->desc->out));
    length = strlen(scene);
    if (strncmp(there, scene, length) == 0 && (there[length] == 0 || there[length] == '/'))
        goto done;
    CLN_TRY(cln_make_dirs(images));
    CLN_TRY(cln_dataset_images(images, &names));
    if (names.count == 0)
        CLN_TRY(cln_photos_link(w->desc->photos, &w->photos, images, false));
done:
    cln_dataset_free_names(&names);
    free(images);
    free(there);
    free(scene);
    return st;
}

/* Masks among the photos; in the scene, or beside the photos, that nobody spoke of. */
static cln_status tell_masks(const work *w)
{
    cln_status st = CLN_OK;
    char *at[2] = {NULL}, *folder = NULL, quoted[CLN_QUOTED_BYTES];
    const char *found = NULL;

    CLN_TRY(cln_path_join(&at[0], w->desc->out, "masks"));
    CLN_TRY(cln_path_join(&at[1], w->desc->photos, "../masks"));
    for (int i = 0; i < 2 && !found; i++)
        found = cln_is_dir(at[i]) ? at[i] : NULL;
    if (w->among.count) {
        CLN_TRY(cln_photo_masks_among(w->desc->photos, &w->among, &folder));
        cln_shell_quote(folder, quoted, sizeof quoted);
        cln_info("%s: %d image%s left out of the photos (the first is '%s')%s%s%s", w->desc->photos,
                 w->among.count, cln_plural(w->among.count, " is a mask, and", "s are masks, and"),
                 w->among.name[0], w->desc->masks ? "" : "; with --mask-path ",
                 w->desc->masks ? "" : quoted,
                 w->desc->masks ? "" : " what is black there is not looked at to find poses");
    } else if (found && !w->desc->masks) {
        cln_shell_quote(found, quoted, sizeof quoted);
        cln_info("%s: is not looked at to find poses; with --mask-path %s what is black there is "
                 "left out",
                 found, quoted);
    }
done:
    free(at[0]);
    free(at[1]);
    free(folder);
    return st;
}

static cln_status set_up(work *w)
{
    cln_status st = CLN_OK;
    cln_colmap *c = &w->colmap;
    bool framed = false;

    if (w->posed) { /* tags may have come later */
        CLN_TRY(cln_strdup(&c->images, w->desc->photos));
        CLN_TRY(link_missing(w));
    } else {
        CLN_TRY(cln_path_join(&c->images, w->desc->out, "images"));
    }
    CLN_TRY(cln_path_join(&c->database, w->desc->out, "colmap.db"));
    CLN_TRY(cln_path_join(&c->log_path, w->desc->out, "colmap.log"));
    CLN_TRY(cln_path_join(&c->sparse, w->desc->out, "sparse.new"));
    if (!w->posed)
        CLN_TRY(cln_make_dirs(c->images));
    /* before the log, which means an attempt was here */
    if (!w->posed && !cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_photos_link(w->desc->photos, &w->photos, c->images, false));
    if (w->desc->masks)
        CLN_TRY(cln_photo_masks_link(w->desc->masks, w->desc->photos, &w->among, w->desc->out));
    CLN_TRY(cln_colmap_remove(c->sparse));        /* it would be taken for this attempt's */
    framed = cln_photos_were_framed(c->log_path); /* by the log that is written over now */
    c->log = fopen(c->log_path, w->posed ? "a" : "w");
    if (!c->log)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", c->log_path, strerror(errno)));
    if (cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_photos_take_frames(w->desc, &w->film, framed, c->images, c->log, c->log_path));
    if (w->posed) {
        c->photos = w->photos;
        w->photos = (cln_names){0};
    } else {
        CLN_TRY(cln_dataset_images(c->images, &c->photos));
    }
    qsort(c->photos.name, (size_t)c->photos.count, sizeof *c->photos.name, by_name);
    w->result->photos = c->photos.count;
    if (c->photos.count < CLN_POSES_LEAST) /* of a video */
        CLN_TRY(fail_few(w->desc->photos, c->photos.count, NULL));
    if (w->posed)
        cln_info("poses: %s has poses of %d photos already, which are placed by the GPS positions "
                 "of %s; to find poses (of more photos, by --lens or --match) give another folder "
                 "with -o",
                 w->desc->out, w->posed, w->desc->photos);
    else
        CLN_TRY(keep_features(w));
    if (!w->posed)
        CLN_TRY(tell_masks(w));
done:
    return st;
}

/* Photos of the folder with a pose by the model that is there. */
static cln_status count_posed(const work *w, int *registered)
{
    cln_status st = CLN_OK;
    const cln_names *photos = &w->colmap.photos;
    cln_names names = {0};
    char *model = NULL;
    double(*at)[3] = NULL;

    *registered = 0;
    CLN_TRY(cln_path_join(&model, w->desc->out, "sparse/0"));
    CLN_TRY(cln_colmap_places(model, &names, &at));
    for (int i = 0; i < names.count; i++)
        *registered += bsearch(&names.name[i], photos->name, (size_t)photos->count,
                               sizeof *photos->name, by_name) != NULL;
done:
    cln_dataset_free_names(&names);
    free(model);
    free(at);
    return st;
}

/* Reads the scene as train will, which warns of photos without a pose; places it. */
static cln_status count_registered(work *w, bool places)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;
    cln_scene *scene = NULL;
    int stands = 0;

    CLN_TRY(cln_settings_create(NULL, &settings));
    CLN_TRY(cln_settings_set(settings, "format", "colmap"));
    CLN_TRY(cln_settings_set(settings, "holdout", "0"));
    CLN_TRY(cln_scene_load(
        &(cln_scene_desc){.path = w->desc->out, .config = &settings->config, .unseen = true},
        &scene));
    w->result->registered = scene->view_count;
    if (w->posed)
        CLN_TRY(count_posed(w, &w->result->registered));
    if (2 * scene->view_count <= w->result->photos)
        cln_warn("%s: COLMAP found poses of %d of %d photos alone, and of so few they are often "
                 "wrong: the others show too little in common with these. " CLN_POSES_ADVICE
                 "%s (%s)",
                 w->desc->photos, scene->view_count, w->result->photos,
                 w->colmap.lens ? "" : "; of a fisheye, give --lens OPENCV_FISHEYE, too",
                 w->colmap.log_path);
    stands = cln_scene_few_stands(scene);
    if (stands > 0)
        cln_warn("%s: " CLN_STANDS_ADVICE, w->desc->photos, scene->view_count, stands);
    cln_colmap_say_focal_length(&w->colmap, scene);
    if (places)
        CLN_TRY(cln_photo_gps_place(&w->colmap, &w->gps, scene, w->result));
done:
    cln_scene_free(scene);
    cln_settings_free(settings);
    return st;
}

/* Reads GPS positions, and says what becomes of them; true: the scene is placed by them. */
static cln_status read_gps(work *w, bool *places)
{
    const cln_colmap *c = &w->colmap;
    cln_status st = CLN_OK;
    bool wide = false;

    CLN_TRY(cln_photo_gps_read(c->images, &c->photos, &w->gps));
    w->result->gps_photos = w->gps.count;
    wide = cln_photo_gps_wide(&w->gps, c->photos.count);
    *places = w->desc->gps && wide;
    if (w->desc->gps && !wide)
        cln_warn("--gps: the GPS positions lie within 10 m of one place, and are some metres off "
                 "themselves: they cannot tell how the scene is turned and how large it is; it "
                 "stays as COLMAP makes it, without unit and north (a length that is known gives "
                 "the unit: man cl-nascent, MEASURING)");
    else if (!w->desc->gps && wide)
        cln_info("%d photos have GPS positions, which are not used: --gps, now or later, turns and "
                 "scales the scene by them to metres, east, north and up",
                 w->gps.count);
done:
    return st;
}

/* An unknown word would match all pairs, which can take hours. */
static cln_status check_match(const char *match)
{
    if (!match || !strcmp(match, "auto") || !strcmp(match, "all") || !strcmp(match, "next"))
        return CLN_OK;
    return cln_fail(CLN_USAGE, "cln_find_poses: match is '%s'; give auto, all or next", match);
}

/* One of the models that readers know. */
static cln_status find_lens(const char *name, const cln_colmap_model **out)
{
    cln_status st = CLN_OK;
    char *names = NULL;

    *out = NULL;
    if (!name || !strcasecmp(name, "auto"))
        return CLN_OK;
    *out = cln_colmap_find(name);
    if (*out)
        return CLN_OK;
    CLN_TRY(cln_strdup(&names, "auto"));
    for (int i = 0; i < CLN_COLMAP_MODELS; i++)
        CLN_TRY(cln_append(&names, ", %s", cln_colmap_models[i].name));
    CLN_TRY(cln_fail(CLN_USAGE, "--lens %s: not the name of a camera model; give one of %s", name,
                     names));
done:
    free(names);
    return st;
}

static cln_status find_poses(work *w)
{
    cln_colmap *c = &w->colmap;
    const bool ordered = cln_photos_are_video(w->desc->photos) || in_sequence(&c->photos);
    cln_status st = CLN_OK;

    cln_colmap_warn_many(c, ordered);
    CLN_TRY(cln_photo_masks_write(c, &c->masks));
    st = cln_colmap_features(c);
    w->result->focal_lengths = c->focal_lengths;
    if (c->masks)
        (void)cln_colmap_remove(c->masks);
    CLN_TRY(st);
    CLN_TRY(cln_colmap_match(c, ordered));
    CLN_TRY(cln_colmap_map(c));
done:
    return st;
}

cln_status cln_find_poses(const cln_poses_desc *desc, cln_poses_result *result)
{
    cln_status st = CLN_OK;
    bool places = false;
    work w = {.desc = desc, .result = result, .colmap.desc = desc};

    cln_clear_error();
    CLN_TRY(cln_given("cln_find_poses", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_find_poses", "desc", desc));
    CLN_TRY(cln_given("cln_find_poses", "photos", desc->photos));
    CLN_TRY(cln_given("cln_find_poses", "out", desc->out));
    CLN_TRY(check_match(desc->match));
    CLN_TRY(find_lens(desc->lens, &w.colmap.lens));
    CLN_TRY(cln_given_number("cln_find_poses", "frames", desc->frames, 0, INT_MAX));
    CLN_TRY(check_folder(&w));
    cln_colmap_ask(&w.colmap);
    CLN_TRY(set_up(&w));
    CLN_TRY(read_gps(&w, &places));
    if (!w.posed)
        CLN_TRY(find_poses(&w));
    CLN_TRY(count_registered(&w, places));
done:
    if (st == CLN_SIGINT || st == CLN_SIGTERM)
        cln_note(
            "finding poses; the same command goes on with the features and matches that are there");
    else if (st != CLN_OK && st != CLN_OUTPUT && w.stamp) /* what is there may be the cause */
        (void)unlink(w.stamp);
    if (w.colmap.log)
        fclose(w.colmap.log);
    free(w.stamp);
    cln_dataset_free_names(&w.colmap.photos);
    cln_dataset_free_names(&w.photos);
    cln_dataset_free_names(&w.among);
    cln_photo_gps_free(&w.gps);
    free(w.colmap.images);
    free(w.colmap.database);
    free(w.colmap.sparse);
    free(w.colmap.masks);
    free(w.colmap.log_path);
    return st;
}
