/* cln_find_poses: photos or a video in, a scene with poses out, by COLMAP's own program, where it
 * is installed. What it leaves:
 *
 *   SCENE/images/       hard links to the photos (copies on another disk), or the video's frames
 *                       (photo_folder.c)
 *   SCENE/sparse/0/     the largest model, which readers take
 *   SCENE/colmap.db     COLMAP's features and matches
 *   SCENE/colmap.log    every command with its output
 *
 * Photos of one size and, by EXIF data, focal length are one camera's (photo_cameras.c).
 *
 * Photos are matched all with all, or each with the next ones where there are many and their
 * names are numbered without many gaps, as cameras and videos number them. */
#include <ctype.h>
#include <errno.h>
#include <ftw.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/callbacks.h"
#include "base/config.h"
#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "base/text.h"
#include "api/photo_cameras.h"
#include "api/photo_folder.h"
#include "cl_nascent.h"
#include "io/command.h"
#include "io/disk.h"
#include "io/image.h"
#include "scene/build.h"
#include "scene/dataset.h"
#include "scene/reader.h"

enum { PLAIN = 30, FEW = 120, MANY = 500, NEXT = 12, MODELS = 64, PHOTOS_LEAST = 3 };
enum { BLOCK_LEAST = 4, BLOCK_MOST = 50, RANGE = 64, CAMERAS = 32 };
/* Bytes free on a disk: with fewer, a command's files are cut off, or it failed for want of room;
 * what a photo's features need in the database: of so many pixels, and at most. */
static const double ROOM_LEAST = 1 << 12, ROOM_FAILED = 1 << 18, ROOM_PIXEL = 4,
                    ROOM_PHOTO = 1 << 20;

/* Models of fewer photos than that are thrown away, and other beginnings tried, up to 200. */
static const char SIZE[] = "--Mapper.min_model_size";
/* Photos matched before it says how far it is; its own is 50. */
static const char BLOCK[] = "--ExhaustiveMatching.block_size";
/* A file with the names of the photos to take, from which one run makes one camera. */
static const char LIST[] = "--image_list_path";

typedef struct work {
    const cln_poses_desc *desc;
    cln_poses_result *result;
    cln_names photos;
    cln_film film; /* where the photos come from a video */
    char *images, *database, *sparse, *log_path;
    FILE *log;
    const char *stage;                 /* name of this step on the progress line */
    int done, before;                  /* photos of this run; of runs before it */
    bool full;                         /* COLMAP found no room on the disk */
    int together;                      /* most photos that a model had */
    const char *extraction, *matching; /* how this COLMAP calls its options */
    bool sized, blocks, lists; /* it takes a model's least size; a block's size; lists of photos */
    int from_here;             /* photos of the model that grows now */
    bool anew;                 /* it is said that another model was begun */
    double focal_least, focal_most; /* by EXIF data, pixels */
} work;

/* ---- COLMAP's words ---- */

/* Behind the first of two phrases that the line has; NULL if it has neither. */
static const char *behind(const char *line, const char *phrase, const char *newer)
{
    const char *at = strstr(line, phrase), *other = strstr(line, newer);

    return at ? at + strlen(phrase) : other ? other + strlen(newer) : NULL;
}

/* "  Focal Length:    882.17px (Prior)" */
static void take_focal_length(work *w, const char *line)
{
    static const char name[] = "Focal Length:";
    const char *at = strstr(line, name), *end = NULL;
    double pixels = 0;

    w->result->focal_lengths++;
    if (!at)
        return;
    at += sizeof name - 1;
    at += strspn(at, " ");
    if (!cln_number_read(at, &pixels, &end) || !(pixels > 0))
        return;
    w->focal_least = w->focal_least > 0 ? fmin(w->focal_least, pixels) : pixels;
    w->focal_most = fmax(w->focal_most, pixels);
}

/* COLMAP may begin many models, of which it keeps some: the second one is told. */
static void begin_model(work *w)
{
    if (w->from_here > 0 && !w->anew) {
        cln_info("one start led to %d of %d photos; COLMAP begins anew from others", w->from_here,
                 w->photos.count);
        w->anew = true;
    }
    w->from_here = 0;
}

/* "882", or "850 to 900". */
static const char *range(double least, double most, char out[RANGE])
{
    if (round(least) == round(most))
        cln_format(out, RANGE, "%.0f", least);
    else
        cln_format(out, RANGE, "%.0f to %.0f", least, most);
    return out;
}

/* Progress: "Processed file [3/14]", "Matching block [1/2, 1/2]", "Matching image [3/14]",
 * "Registering image #5 (7)". COLMAP 3.13 and newer begin lines with time and place, write
 * "Processing" for "Matching", and "(num_reg_frames=7)". */
static void read_line(const char *line, void *user)
{
    work *w = user;
    const char *at = NULL;
    int a = 0, b = 0, of_a = 0, of_b = 0;

    /* SQLite's words, and the system's; the commands of 3.8 may end with 0 all the same */
    if (strstr(line, "database or disk is full") || strstr(line, "No space left on device"))
        w->full = true;
    if (strstr(line, "(Prior)"))
        take_focal_length(w, line);
    if (behind(line, "Initializing with image pair", "Registering initial image pair"))
        begin_model(w);
    if ((at = strstr(line, "Registering image #")) && (at = strchr(at, '(')) &&
        (sscanf(at, "(%d)", &a) == 1 || sscanf(at, "(num_reg_frames=%d)", &a) == 1)) {
        w->from_here = a;
        w->together = a > w->together ? a : w->together;
        w->done = w->together; /* another model begins small */
    } else if ((at = behind(line, "Matching block [", "Processing block ["))) {
        const int found = sscanf(at, "%d/%d, %d/%d]", &a, &of_a, &b, &of_b);

        if (found == 4 && of_a > 0 && of_b > 0)
            w->done = (int)((a - 1 + (b - 1) / (double)of_b) / of_a * w->photos.count);
    } else if ((at = strstr(line, "Processed file [")) &&
               sscanf(at, "Processed file [%d", &a) == 1) {
        w->done = w->before + a;
    } else if ((at = behind(line, "Matching image [", "Processing image [")) &&
               sscanf(at, "%d", &a) == 1) {
        w->done = a;
    } else {
        return;
    }
    cln_show_work(&w->desc->callbacks, w->stage, w->done, w->photos.count);
}

static int is_interrupted(void *user)
{
    return cln_poll_signal(&((work *)user)->desc->callbacks);
}

/* After a command: was the disk full? A model that is cut off for it is no error of COLMAP's. */
static cln_status check_room(const work *w, cln_status st, double least)
{
    if (st != CLN_OK && st != CLN_FAILED)
        return st;
    if (!w->full && cln_disk_room(w->desc->out) >= least)
        return st;
    cln_clear_error();
    return cln_fail(CLN_OUTPUT,
                    "%s: no room is left on the disk for what COLMAP writes (%s has all that it "
                    "said); make room, or give a folder on another disk with -o",
                    w->desc->out, w->log_path);
}

static cln_status run(work *w, const char *stage, const char *const *argv)
{
    const cln_command_watch watch = {read_line, is_interrupted, w, w->log};
    cln_status st = CLN_OK;

    w->stage = stage;
    w->done = w->before;
    cln_show_work(&w->desc->callbacks, stage, w->done, w->photos.count);
    st = cln_command_run(argv, &watch);
    CLN_TRY(check_room(w, st, st == CLN_OK ? ROOM_LEAST : ROOM_FAILED));
done:
    if (st == CLN_FAILED)
        cln_note("finding poses; %s has all that it said", w->log_path);
    return st;
}

/* COLMAP 3.13 renamed SiftExtraction.use_gpu to FeatureExtraction.use_gpu, and so for matching. */
static void learn_names(const char *line, void *user)
{
    work *w = user;

    if (strstr(line, "--FeatureExtraction.use_gpu"))
        w->extraction = "--FeatureExtraction.use_gpu";
    if (strstr(line, "--FeatureMatching.use_gpu"))
        w->matching = "--FeatureMatching.use_gpu";
    w->sized = w->sized || strstr(line, SIZE);
    w->blocks = w->blocks || strstr(line, BLOCK);
    w->lists = w->lists || strstr(line, LIST);
}

static void ask_names(work *w)
{
    static const char *const commands[] = {"feature_extractor", "exhaustive_matcher", "mapper"};
    const cln_command_watch watch = {learn_names, NULL, w, NULL};

    w->extraction = "--SiftExtraction.use_gpu";
    w->matching = "--SiftMatching.use_gpu";
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (cln_command_run((const char *const[]){"colmap", commands[i], "-h", NULL}, &watch) !=
            CLN_OK)
            cln_clear_error(); /* some versions end help with another code than 0 */
}

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

/* Refuses so few photos; `folder`: where those in other formats may be, or NULL. */
static cln_status fail_few(const char *photos, int count, const char *folder)
{
    cln_status st = CLN_OK;
    char *unread = NULL;
    int others = 0;

    if (folder)
        CLN_TRY(cln_dataset_unread(folder, NULL, &others, &unread));
    if (unread)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: has %d PNG or JPEG photo%s, and %d in formats that are not read (the "
                         "first is '%s'): convert them; finding poses needs at least three",
                         photos, count, cln_plural(count, "", "s"), others, unread));
    CLN_TRY(cln_fail(CLN_INPUT, "%s: has %d PNG or JPEG photos; finding poses needs at least three",
                     photos, count));
done:
    free(unread);
    return st;
}

/* Those in formats that are not read, beside others, are told; a photo that is cut off, as copies
 * are, would be found after hours of COLMAP's work. */
static cln_status check_readable(const char *folder, const cln_names *photos)
{
    cln_status st = CLN_OK;
    char *path = NULL, *unread = NULL, *first = NULL;
    int others = 0, bad = 0;

    CLN_TRY(cln_dataset_unread(folder, NULL, &others, &unread));
    if (unread)
        cln_warn("%s: %d photo%s in formats that are not read %s left out (the first is '%s'); "
                 "convert them to JPEG to have them, too",
                 folder, others, cln_plural(others, "", "s"), cln_plural(others, "is", "are"),
                 unread);
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
    free(path);
    free(unread);
    free(first);
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

/* Enough photos, before the folder is made. A folder that is a scene already needs no poses. */
static cln_status check_photos(const char *folder, const char *out)
{
    cln_status st = CLN_OK;
    const cln_reader *reader = NULL;
    char *others = NULL;
    cln_names photos = {0};

    CLN_TRY(cln_dataset_images(folder, &photos));
    if (photos.count < PHOTOS_LEAST)
        CLN_TRY(fail_few(folder, photos.count, folder));
    CLN_TRY(check_readable(folder, &photos));
    CLN_TRY(check_photos_room(folder, &photos, out));
    if (cln_reader_pick(folder, CLN_FORMAT_AUTO, &reader, &others) == CLN_OK && reader)
        cln_warn("%s: it is a scene with poses already (%s reads it); `cl-nascent info` shows "
                 "them",
                 folder, reader->name);
    cln_clear_error();
done:
    free(others);
    cln_dataset_free_names(&photos);
    return st;
}

/* The scene's folder can be written, and does not lie in that of the photos, where a second try
 * would take its images for photos, too. */
static cln_status check_out(const char *photos, const char *out)
{
    cln_status st = CLN_OK;
    char *there = NULL, *around = NULL, *up = NULL;
    size_t length = 0;

    CLN_TRY(cln_disk_check(out, 0, ""));
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

static cln_status check_folder(work *w)
{
    const char *out = w->desc->out;
    cln_status st = CLN_OK;

    if (cln_has_dir(out, "sparse"))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: it has poses already (sparse); give another folder with -o, or "
                         "remove that one",
                         out));
    if (access(w->desc->photos, F_OK) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: it is not there; give a folder of photos, or a video",
                         w->desc->photos));
    if (!cln_is_dir(w->desc->photos) && cln_dataset_is_image(w->desc->photos))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: a single photo; give the folder that it is in with others",
                         w->desc->photos));
    if (!cln_is_dir(w->desc->photos) && !cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: neither a folder of photos nor a video; give one of these (an archive: unpack it)",
            w->desc->photos));
    if (cln_is_dir(w->desc->photos))
        CLN_TRY(check_photos(w->desc->photos, out));
    CLN_TRY(check_out(w->desc->photos, out));
    CLN_TRY(cln_photos_check_out(w->desc->photos, out));
    if (!cln_command_found("colmap"))
        CLN_TRY(cln_fail(
            CLN_FAILED,
            "finding poses needs COLMAP, which is not installed; install it "
            "(Debian: apt install colmap; others: https://colmap.github.io), "
            "or bring poses of another program (transforms JSON, LLFF, NeuS, NSVF, OpenSfM)"));
    if (cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_photos_probe(w->desc, &w->film));
done:
    return st;
}

static int remove_one(const char *path, const struct stat *info, int kind, struct FTW *where)
{
    (void)info;
    (void)kind;
    (void)where;
    return remove(path);
}

/* Removes what an earlier attempt left, which found no poses: features of other photos, and models
 * that would be taken for this one's. */
static cln_status remove_rest(const work *w)
{
    enum { OPEN = 8 };
    static const char *const beside[] = {"", "-wal", "-shm", "-journal"}; /* SQLite's */
    cln_status st = CLN_OK;
    char *path = NULL;

    for (size_t i = 0; i < sizeof beside / sizeof *beside; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s%s", w->database, beside[i]));
        if (unlink(path) != 0 && errno != ENOENT)
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s: of an earlier attempt, and cannot be removed: %s; remove it, or "
                             "give another folder with -o",
                             path, strerror(errno)));
    }
    if (cln_is_dir(w->sparse) && nftw(w->sparse, remove_one, OPEN, FTW_DEPTH | FTW_PHYS) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: of an earlier attempt, and cannot be removed: %s; remove it, or give "
                         "another folder with -o",
                         w->sparse, strerror(errno)));
done:
    free(path);
    return st;
}

static cln_status set_up(work *w)
{
    cln_status st = CLN_OK;
    bool framed = false;

    CLN_TRY(cln_path_join(&w->images, w->desc->out, "images"));
    CLN_TRY(cln_path_join(&w->database, w->desc->out, "colmap.db"));
    CLN_TRY(cln_path_join(&w->log_path, w->desc->out, "colmap.log"));
    CLN_TRY(cln_path_join(&w->sparse, w->desc->out, "sparse.new"));
    CLN_TRY(cln_make_dirs(w->images));
    if (!cln_photos_are_video(
            w->desc->photos)) /* before the log, which means an attempt was here */
        CLN_TRY(cln_photos_link(w->desc->photos, w->images));
    CLN_TRY(remove_rest(w));
    framed = cln_photos_were_framed(w->log_path); /* by the log that is written over now */
    w->log = fopen(w->log_path, "w");
    if (!w->log)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", w->log_path, strerror(errno)));
    if (cln_photos_are_video(w->desc->photos))
        CLN_TRY(cln_photos_take_frames(w->desc, &w->film, framed, w->images, w->log, w->log_path));
    CLN_TRY(cln_dataset_images(w->images, &w->photos));
    qsort(w->photos.name, (size_t)w->photos.count, sizeof *w->photos.name, by_name);
    w->result->photos = w->photos.count;
    if (w->photos.count < PHOTOS_LEAST) /* of a video */
        CLN_TRY(fail_few(w->desc->photos, w->photos.count, NULL));
done:
    return st;
}

/* Finds the features of photos that a camera took, or of all, each with a camera of its own. list:
 * their names, NULL for all. A few photos cannot tell four parameters of a lens. */
static cln_status extract(work *w, int photos, bool one_camera, const char *list)
{
    return run(w, "poses: features",
               (const char *const[]){"colmap", "feature_extractor", "--database_path", w->database,
                                     "--image_path", w->images, "--ImageReader.camera_model",
                                     photos < PLAIN ? "SIMPLE_RADIAL" : "OPENCV",
                                     "--ImageReader.single_camera", one_camera ? "1" : "0",
                                     w->extraction, "0", list ? LIST : NULL, list, NULL});
}

/* A run for each camera: its photos, and no others, get one in the database. */
static cln_status extract_by_camera(work *w, const cln_photo_cameras *cameras)
{
    cln_status st = CLN_OK;
    char *list = NULL;

    CLN_TRY(cln_path_join(&list, w->desc->out, "colmap.photos"));
    for (int c = 0; c < cameras->count; c++) {
        CLN_TRY(cln_photo_cameras_list(cameras, &w->photos, c, list));
        CLN_TRY(extract(w, cameras->photos[c], true, list));
        w->before += cameras->photos[c];
    }
done:
    w->before = 0;
    if (list)
        (void)unlink(list);
    free(list);
    return st;
}

static cln_status find_features(work *w)
{
    cln_status st = CLN_OK;
    cln_photo_cameras cameras = {0};
    char focal[RANGE], several[96];

    CLN_TRY(cln_photo_cameras_find(w->images, &w->photos, &cameras));
    cln_format(several, sizeof several, "of several %s",
               !cameras.lengths ? "sizes"
               : cameras.sizes  ? "sizes and focal lengths by EXIF, or none"
                                : "focal lengths by EXIF, or none");
    if (cameras.count == 1) {
        cln_info("%d photos, all of one size: one camera", w->photos.count);
        CLN_TRY(extract(w, w->photos.count, true, NULL));
    } else if (cameras.count > CAMERAS || !w->lists || !cln_photo_cameras_listable(&w->photos)) {
        cln_info("%d photos, %s: a camera for each photo", w->photos.count, several);
        CLN_TRY(extract(w, w->photos.count, false, NULL));
    } else {
        cln_info("%d photos, %s: %d cameras", w->photos.count, several, cameras.count);
        CLN_TRY(extract_by_camera(w, &cameras));
    }
    if (w->result->focal_lengths)
        cln_info("EXIF tells the focal length of %d photo%s: %s pixels", w->result->focal_lengths,
                 cln_plural(w->result->focal_lengths, "", "s"),
                 range(w->focal_least, w->focal_most, focal));
    else
        cln_info("EXIF tells no focal length: COLMAP estimates it from the photos");
done:
    cln_photo_cameras_free(&cameras);
    return st;
}

static cln_status match(work *w)
{
    const char *how = w->desc->match ? w->desc->match : "auto";
    const bool automatic = strcmp(how, "auto") == 0;
    const bool ordered = cln_photos_are_video(w->desc->photos) || in_sequence(&w->photos);
    const bool next = automatic ? w->photos.count > FEW && ordered : strcmp(how, "next") == 0;
    char overlap[16], block[16];

    snprintf(block, sizeof block, "%d",
             w->photos.count < 10 * BLOCK_LEAST  ? BLOCK_LEAST
             : w->photos.count > 10 * BLOCK_MOST ? BLOCK_MOST
                                                 : w->photos.count / 10);
    snprintf(overlap, sizeof overlap, "%d", NEXT);
    if (next) {
        cln_info("matching each photo with the next %d%s", NEXT,
                 automatic ? ", as there are many and they are numbered" : "");
        return run(w, "poses: matches",
                   (const char *const[]){"colmap", "sequential_matcher", "--database_path",
                                         w->database, "--SequentialMatching.overlap", overlap,
                                         w->matching, "0", NULL});
    }
    cln_info("matching all photos with all: %lld pairs",
             (long long)w->photos.count * (w->photos.count - 1) / 2);
    if (w->photos.count > MANY)
        cln_warn("matching %d photos, each with all others, takes hours; give --match next if they "
                 "were taken one after the other",
                 w->photos.count);
    return run(w, "poses: matches",
               (const char *const[]){"colmap", "exhaustive_matcher", "--database_path", w->database,
                                     w->matching, "0", w->blocks ? BLOCK : NULL, block, NULL});
}

/* Number of images of a model: the first number of images.bin, which may have gigabytes. */
static int images_of(const char *model)
{
    char *path = NULL;
    FILE *f = NULL;
    uint64_t count = 0;

    if (cln_path_join(&path, model, "images.bin") == CLN_OK)
        f = fopen(path, "rb");
    if (f && fread(&count, sizeof count, 1, f) != 1)
        count = 0;
    if (f)
        fclose(f);
    cln_clear_error();
    free(path);
    return count > (uint64_t)CLN_MAX_VIEWS ? 0 : (int)count;
}

/* COLMAP writes a model for each group of photos that overlap: the largest becomes number 0. */
static cln_status choose_model(work *w)
{
    cln_status st = CLN_OK;
    char *model[2] = {0}, *kept = NULL, *final = NULL, most_text[64] = "";
    int best = -1, most = 0, models = 0;

    for (int i = 0; i < MODELS; i++) {
        char name[16];
        int count = 0;

        snprintf(name, sizeof name, "%d", i);
        free(model[0]);
        model[0] = NULL;
        CLN_TRY(cln_path_join(&model[0], w->sparse, name));
        count = images_of(model[0]);
        models += count > 0;
        if (count > most) {
            most = count;
            best = i;
        }
    }
    if (w->together > 0)
        snprintf(most_text, sizeof most_text, " (at most %d of %d hung together)", w->together,
                 w->photos.count);
    if (best < 0)
        CLN_TRY(cln_fail(CLN_FAILED,
                         "%s: COLMAP found no poses: the photos show too little in common%s. Take "
                         "more, at most 20 degrees apart, sharp, of something with texture that "
                         "does not move (%s)",
                         w->desc->photos, most_text, w->log_path));
    if (models > 1)
        cln_warn("the photos fall into %d groups that share nothing: the largest is used; the "
                 "others are beside it in sparse",
                 models);
    if (best > 0) {
        char name[16];

        snprintf(name, sizeof name, "%d", best);
        CLN_TRY(cln_path_join(&model[1], w->sparse, name));
        free(model[0]);
        model[0] = NULL;
        CLN_TRY(cln_path_join(&model[0], w->sparse, "0"));
        CLN_TRY(cln_path_join(&kept, w->sparse, "aside"));
        if (rename(model[0], kept) || rename(model[1], model[0]) || rename(kept, model[1]))
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", w->sparse, strerror(errno)));
    }
    CLN_TRY(cln_path_join(&final, w->desc->out, "sparse"));
    if (rename(w->sparse, final))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", final, strerror(errno)));
done:
    free(model[0]);
    free(model[1]);
    free(kept);
    free(final);
    return st;
}

static cln_status map(work *w)
{
    cln_status st = CLN_OK;
    char least[16];

    snprintf(least, sizeof least, "%d", PHOTOS_LEAST);
    CLN_TRY(cln_make_dirs(w->sparse));
    /* COLMAP's ten is much of a few photos; where there are many, a good start has more */
    st = run(w, "poses: registered photos",
             (const char *const[]){"colmap", "mapper", "--database_path", w->database,
                                   "--image_path", w->images, "--output_path", w->sparse,
                                   w->sized && w->photos.count < PLAIN ? SIZE : NULL, least, NULL});
    if (st == CLN_FAILED && strstr(cln_error_text(), "failed to create sparse model")) {
        cln_clear_error(); /* a better sentence follows below */
        st = CLN_OK;
    }
    CLN_TRY(st);
    CLN_TRY(choose_model(w));
done:
    return st;
}

/* What COLMAP made of the focal length, which a person may know. */
static void say_focal_length(const cln_scene *scene)
{
    double least = INFINITY, most = 0;
    bool one_width = true;
    char focal[RANGE], wide[64] = "";

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const double pixels = view->camera.fx * view->file_width / view->camera.width;

        least = fmin(least, pixels);
        most = fmax(most, pixels);
        one_width &= view->file_width == scene->views[0].file_width;
    }
    if (scene->view_count > 0 && one_width)
        cln_format(wide, sizeof wide, ", of photos %d pixels wide", scene->views[0].file_width);
    if (scene->view_count > 0)
        cln_info("COLMAP's focal length: %s pixels%s", range(least, most, focal), wide);
}

/* Reads the scene as train will, which warns of photos without a pose. */
static cln_status count_registered(work *w)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;
    cln_scene *scene = NULL;

    CLN_TRY(cln_settings_create(NULL, &settings));
    CLN_TRY(cln_settings_set(settings, "format", "colmap"));
    CLN_TRY(cln_settings_set(settings, "holdout", "0"));
    CLN_TRY(cln_scene_load(
        &(cln_scene_desc){.path = w->desc->out, .config = &settings->config, .unseen = true},
        &scene));
    w->result->registered = scene->view_count;
    say_focal_length(scene);
done:
    cln_scene_free(scene);
    cln_settings_free(settings);
    return st;
}

/* An unknown word would match all pairs, which can take hours. */
static cln_status check_match(const char *match)
{
    if (!match || !strcmp(match, "auto") || !strcmp(match, "all") || !strcmp(match, "next"))
        return CLN_OK;
    return cln_fail(CLN_USAGE, "cln_find_poses: match is '%s'; give auto, all or next", match);
}

cln_status cln_find_poses(const cln_poses_desc *desc, cln_poses_result *result)
{
    cln_status st = CLN_OK;
    work w = {.desc = desc, .result = result};

    CLN_TRY(cln_given("cln_find_poses", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_find_poses", "desc", desc));
    CLN_TRY(cln_given("cln_find_poses", "photos", desc->photos));
    CLN_TRY(cln_given("cln_find_poses", "out", desc->out));
    CLN_TRY(check_match(desc->match));
    CLN_TRY(cln_given_number("cln_find_poses", "frames", desc->frames, 0, INT_MAX));
    CLN_TRY(check_folder(&w));
    ask_names(&w);
    CLN_TRY(set_up(&w));
    CLN_TRY(find_features(&w));
    CLN_TRY(match(&w));
    CLN_TRY(map(&w));
    CLN_TRY(count_registered(&w));
done:
    if (st == CLN_SIGINT || st == CLN_SIGTERM)
        cln_note("finding poses; the same command begins anew");
    if (w.log)
        fclose(w.log);
    cln_dataset_free_names(&w.photos);
    free(w.images);
    free(w.database);
    free(w.sparse);
    free(w.log_path);
    return st;
}
