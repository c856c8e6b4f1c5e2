/* SCENE/images of cln_find_poses. See photo_folder.h. */
#include "api/photo_folder.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/callbacks.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/command.h"
#include "scene/dataset.h"

enum { FRAMES = 150, FILTER = 256 };
static const size_t FILE_MOST = (size_t)1 << 30;
static const char frame_name[] = "frame_%05d.jpg"; /* ffmpeg's */

bool cln_photos_are_video(const char *path)
{
    return cln_dataset_is_video(path) && !cln_is_dir(path); /* folders of frames are called so */
}

/* ---- frames ---- */

typedef struct video {
    const cln_callbacks *callbacks;
    cln_film film;
    bool full; /* ffmpeg found no room on the disk */
} video;

static void read_probe(const char *line, void *user)
{
    static const char duration[] = "duration=", frames[] = "nb_frames=";
    video *v = user;
    double value = 0;
    const char *end = NULL;

    if (strncmp(line, duration, sizeof duration - 1) == 0 &&
        cln_number_read(line + sizeof duration - 1, &value, &end) && value > 0)
        v->film.duration = value;
    if (strncmp(line, frames, sizeof frames - 1) == 0 &&
        cln_number_read(line + sizeof frames - 1, &value, &end) && value > 0)
        v->film.frames = value;
}

static void read_ffmpeg(const char *line, void *user)
{
    if (strstr(line, "No space left on device"))
        ((video *)user)->full = true;
}

static int is_interrupted(void *user)
{
    return cln_poll_signal(((video *)user)->callbacks);
}

/* A pattern of names in a folder as ffmpeg takes it: a file whatever its name begins with, and with
 * numbers in the last name alone. */
static cln_status frame_names(const char *folder, char **out)
{
    cln_status st = CLN_OK;
    size_t used = 0;
    char *doubled = NULL;

    CLN_TRY(cln_alloc(&doubled, 2 * strlen(folder) + 1, 1, "name"));
    for (; *folder; folder++) {
        doubled[used++] = *folder;
        if (*folder == '%')
            doubled[used++] = '%';
    }
    CLN_TRY(cln_asprintf(out, "file:%s/%s", doubled, frame_name));
done:
    free(doubled);
    return st;
}

bool cln_photos_were_framed(const char *log)
{
    char *text = NULL;
    size_t bytes = 0;
    bool framed = false;

    if (cln_read_file(log, FILE_MOST, &text, &bytes) == CLN_OK)
        framed = strstr(text, frame_name) != NULL;
    else
        cln_clear_error();
    free(text);
    return framed;
}

/* Clears the way for a video's frames: removes those of an earlier attempt. CLN_OUTPUT for anything
 * else: it may be the only copy, or a link through which ffmpeg would write into a photo. */
static cln_status clear_frames(const char *images, bool framed)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    cln_names there = {0};

    CLN_TRY(cln_dataset_images(images, &there));
    for (int i = 0; i < there.count; i++) {
        struct stat info = {.st_nlink = 0};
        const char *name = there.name[i];
        int end = 0;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, images, name));
        (void)sscanf(name, "frame_%*5[0-9].jpg%n", &end);
        if (!framed || end == 0 || name[end] || lstat(path, &info) != 0 || info.st_nlink != 1)
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s: is there already, and is no frame of an earlier attempt; give an "
                             "empty folder with -o",
                             path));
        if (unlink(path) != 0)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", path, strerror(errno)));
    }
done:
    cln_dataset_free_names(&there);
    free(path);
    return st;
}

/* ffmpeg's filter that takes the first frame of each of `rate` spans a second, and none twice, as
 * fps= does where the video has fewer. A frame a little before a span's beginning is in it, as
 * times are rounded. The last two terms number frames anew, so that ffmpeg does not fill gaps. */
static void write_filter(double rate, char out[FILTER])
{
    cln_format(out, FILTER,
               "select='isnan(prev_selected_t)+gt(floor((t-start_t)*%.6f+0.05),"
               "floor((prev_selected_t-start_t)*%.6f+0.05))',settb=1/25,setpts=N",
               rate, rate);
}

/* How many frames were taken, which may be fewer than asked for. */
static cln_status say_taken(const char *images, const cln_film *film)
{
    cln_status st = CLN_OK;
    cln_names taken = {0};

    CLN_TRY(cln_dataset_images(images, &taken));
    if (film->frames >= taken.count)
        cln_info("%d of the video's %.0f frames are taken", taken.count, film->frames);
    else
        cln_info("%d of the video's frames are taken", taken.count);
done:
    cln_dataset_free_names(&taken);
    return st;
}

cln_status cln_photos_probe(const cln_poses_desc *desc, cln_film *out)
{
    cln_status st = CLN_OK;
    video v = {.callbacks = &desc->callbacks};
    const cln_command_watch watch = {read_probe, is_interrupted, &v, NULL};
    char *file = NULL, *why = NULL;

    if (!cln_command_found("ffmpeg") || !cln_command_found("ffprobe"))
        CLN_TRY(cln_fail(CLN_FAILED,
                         "%s: taking frames from a video needs ffmpeg, which is not installed; "
                         "install it (Debian: apt install ffmpeg), or take the frames with another "
                         "program and give their folder",
                         desc->photos));
    CLN_TRY(cln_asprintf(&file, "file:%s", desc->photos)); /* "12:30.mp4" would be an address */
    st = cln_command_run((const char *const[]){"ffprobe", "-v", "error", "-select_streams", "V:0",
                                               "-show_entries", "stream=nb_frames:format=duration",
                                               "-of", "default=nw=1", file, NULL},
                         &watch);
    if (st == CLN_FAILED) {
        CLN_TRY(cln_strdup(&why, cln_error_text()));
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: cannot be read as a video (%s); give another file, or a folder of "
                         "photos",
                         desc->photos, why));
    }
    CLN_TRY(st);
    if (!(v.film.duration > 0))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: ffprobe finds no duration in it; is it a video?",
                         desc->photos));
    *out = v.film;
done:
    free(file);
    free(why);
    return st;
}

cln_status cln_photos_take_frames(const cln_poses_desc *desc, const cln_film *film, bool framed,
                                  const char *images, FILE *log, const char *log_path)
{
    cln_status st = CLN_OK;
    const int frames = desc->frames > 0 ? desc->frames : FRAMES;
    const cln_callbacks *c = &desc->callbacks;
    video v = {.callbacks = c};
    const cln_command_watch watch = {read_ffmpeg, is_interrupted, &v, log};
    char *file = NULL, *names = NULL, filter[FILTER], most[16];

    CLN_TRY(cln_asprintf(&file, "file:%s", desc->photos));
    snprintf(most, sizeof most, "%d",
             film->frames > 0 && film->frames < frames ? (int)film->frames : frames);
    write_filter(frames / film->duration, filter);
    CLN_TRY(clear_frames(images, framed));
    CLN_TRY(frame_names(images, &names));
    if (c->work)
        c->work("poses: frames", 0, 0, c->user);
    st = cln_command_run((const char *const[]){"ffmpeg", "-nostdin", "-y", "-v", "error", "-i",
                                               file, "-vf", filter, "-r", "25", "-frames:v",
                                               most, /* ffmpeg 9 repeats the last one */
                                               "-qscale:v", "2", names, NULL},
                         &watch);
    if (v.full && (st == CLN_OK || st == CLN_FAILED)) {
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: no room is left on the disk for the video's frames; make room, take "
                         "fewer with --frames, or give a folder on another disk with -o",
                         desc->out));
    }
    if (st == CLN_FAILED)
        cln_note("finding poses; %s has all that it said", log_path);
    CLN_TRY(st);
    CLN_TRY(say_taken(images, film));
done:
    free(file);
    free(names);
    return st;
}

/* ---- photos ---- */

#define EMPTY_FOLDER "give an empty folder with -o"
#define MOVE_MASKS   "move the scene's folder masks away, or "

/* *out: the path of `masks` from the folder, if it is there and lies in it; else NULL. */
static cln_status find_within(const char *folder, const char *masks, char **out)
{
    cln_status st = CLN_OK;
    char *there = NULL, *around = NULL;
    size_t length = 0;

    *out = NULL;
    if (cln_path_absolute(&there, masks) != CLN_OK) {
        cln_clear_error();
        goto done;
    }
    CLN_TRY(cln_path_absolute(&around, folder));
    length = strlen(around);
    if (strncmp(there, around, length) == 0 && there[length] == '/')
        CLN_TRY(cln_strdup(out, there + length + 1));
done:
    free(there);
    free(around);
    return st;
}

/* Does an image lie in a folder that is called masks, or in (or is it) `within`? */
static cln_status lies_in_masks(const char *name, const char *within, bool *lies)
{
    cln_status st = CLN_OK;
    const size_t length = within ? strlen(within) : 0;
    char *top = NULL, *slash = NULL;

    CLN_TRY(cln_strdup(&top, name));
    slash = strchr(top, '/');
    if (slash)
        *slash = 0;
    *lies =
        (slash && cln_dataset_has_masks(top)) ||
        (within && strncmp(name, within, length) == 0 && (!name[length] || name[length] == '/'));
done:
    free(top);
    return st;
}

cln_status cln_photos_find(const char *folder, const char *masks, cln_names *photos,
                           cln_names *among)
{
    cln_status st = CLN_OK;
    cln_names all = {0};
    char *within = NULL;

    *photos = *among = (cln_names){0};
    CLN_TRY(cln_dataset_images(folder, &all));
    if (masks)
        CLN_TRY(find_within(folder, masks, &within));
    if (all.count) {
        CLN_TRY(cln_alloc(&photos->name, (size_t)all.count, sizeof *photos->name, "photos"));
        CLN_TRY(cln_alloc(&among->name, (size_t)all.count, sizeof *among->name, "masks"));
    }
    for (int i = 0; i < all.count; i++) {
        bool is = false;
        cln_names *to = photos;

        CLN_TRY(lies_in_masks(all.name[i], within, &is));
        if (!is)
            CLN_TRY(cln_dataset_is_mask_of(all.name[i], &all, &is));
        if (is)
            to = among;
        CLN_TRY(cln_strdup(&to->name[to->count], all.name[i]));
        to->count++;
    }
done:
    cln_dataset_free_names(&all);
    free(within);
    return st;
}

/* Links or copies a photo, not the symbolic link that it may be; one that is there already must be
 * the same. */
cln_status cln_photos_link_file(const char *from, const char *to, bool masks)
{
    cln_status st = CLN_OK;
    char *data = NULL, *there = NULL;
    size_t bytes = 0, there_bytes = 0;

    if (!cln_is_file(to))
        return cln_link_or_copy(from, to);
    CLN_TRY(cln_read_file(from, FILE_MOST, &data, &bytes));
    CLN_TRY(cln_read_file(to, FILE_MOST, &there, &there_bytes));
    if (bytes != there_bytes || memcmp(data, there, bytes) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: already there, and is another %s; %s", to,
                         masks ? "mask" : "photo", masks ? MOVE_MASKS EMPTY_FOLDER : EMPTY_FOLDER));
done:
    free(data);
    free(there);
    return st;
}

/* COLMAP would match what an earlier attempt left in the scene, too. */
static cln_status refuse_others(const char *from, const cln_names *names, const char *images,
                                bool masks)
{
    cln_status st = CLN_OK;
    cln_names there = {0};

    CLN_TRY(cln_dataset_images(images, &there));
    for (int i = 0; i < there.count; i++)
        if (!cln_dataset_has_name(names, there.name[i]))
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s/%s: is none of the %s in %s, and would be %s; %s",
                             images, there.name[i], masks ? "masks" : "photos", from,
                             masks ? "taken for one" : "matched with them",
                             masks ? MOVE_MASKS EMPTY_FOLDER : EMPTY_FOLDER));
done:
    cln_dataset_free_names(&there);
    return st;
}

/* The folder that a path is in, as cln_path_absolute makes it. */
static cln_status parent_of(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *slash = NULL;

    CLN_TRY(cln_path_absolute(out, path));
    slash = strrchr(*out, '/');
    if (slash)
        slash[slash == *out] = 0; /* "/x" is in "/" */
done:
    return st;
}

cln_status cln_photos_check_out(const char *photos, const char *out)
{
    cln_status st = CLN_OK;
    char *scene = NULL, *around = NULL, other[NAME_MAX + 1] = "";
    DIR *dir = NULL;
    bool within = false;

    if (!cln_is_dir(out) || cln_has_file(out, "colmap.log"))
        goto done;
    if (cln_has_file(out, "colmap.db"))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: has a colmap.db that is of no earlier attempt, and that would be "
                         "replaced; give another folder with -o",
                         out));
    CLN_TRY(cln_path_absolute(&scene, out));
    CLN_TRY(parent_of(photos, &around));
    within = strcmp(scene, around) == 0;
    dir = within ? NULL : opendir(out);
    for (struct dirent *entry = dir ? readdir(dir) : NULL; entry; entry = readdir(dir))
        if (entry->d_name[0] != '.' && strcmp(entry->d_name, "images") != 0 &&
            strcmp(entry->d_name, "masks") != 0 && (!*other || strcmp(entry->d_name, other) < 0))
            snprintf(other, sizeof other, "%s", entry->d_name);
    if (*other)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: this folder has other things in it ('%s'); give a new or an empty "
                         "folder with -o",
                         out, other));
done:
    if (dir)
        closedir(dir);
    free(scene);
    free(around);
    return st;
}

cln_status cln_photos_link(const char *folder, const cln_names *names, const char *images,
                           bool masks)
{
    cln_status st = CLN_OK;
    char *from = NULL, *to = NULL, *there = NULL, *here = NULL;

    CLN_TRY(cln_path_absolute(&there, folder));
    CLN_TRY(cln_path_absolute(&here, images));
    if (strcmp(there, here) == 0)
        goto done;
    CLN_TRY(refuse_others(folder, names, images, masks));
    for (int i = 0; i < names->count; i++) {
        char *slash = NULL;

        free(from);
        free(to);
        from = to = NULL;
        CLN_TRY(cln_path_join(&from, there, names->name[i]));
        CLN_TRY(cln_path_join(&to, images, names->name[i]));
        slash = strrchr(to, '/');
        *slash = 0;
        CLN_TRY(cln_make_dirs(to));
        *slash = '/';
        CLN_TRY(cln_photos_link_file(from, to, masks));
    }
done:
    free(from);
    free(to);
    free(there);
    free(here);
    return st;
}
