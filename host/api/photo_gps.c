/* Places a model on the earth. See photo_gps.h. The similarity is found here (place_turn.h), and
 * COLMAP's model_transformer applies it: its model_aligner would take one of the turns that a third
 * of the positions fit. */
#include "api/photo_gps.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api/place_turn.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/origin.h"
#include "scene/reader.h"
#include "scene/vectors.h"

/* Metres that some photos are apart at least: GPS is as far off. */
static const double LEAST = 10;
/* Degrees of up and north, and of the length, that a placed scene may be off by, in standard
 * deviations. */
static const double TURN_MOST = 10, LENGTH_MOST = 0.15;
/* Of the cameras' largest distance: what COLMAP's result may be from what it was asked for. */
static const double DONE = 1e-3;

/* ---- positions ---- */

cln_status cln_photo_gps_read(const char *folder, const cln_names *photos, cln_photo_gps *out)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    *out = (cln_photo_gps){0};
    CLN_TRY(cln_alloc(&out->at, (size_t)photos->count + 1, sizeof *out->at, "photos"));
    for (int i = 0; i < photos->count; i++) {
        cln_image_head head;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, photos->name[i]));
        CLN_TRY(cln_image_read_head(path, &head));
        memcpy(out->at[i], head.gps, sizeof head.gps);
        out->level += !isnan(head.gps[0] + head.gps[1]);
        out->high += !isnan(head.gps[0] + head.gps[1] + head.gps[2]);
    }
    out->flat = out->high < CLN_POSES_LEAST && out->level >= CLN_POSES_LEAST;
    for (int i = 0; i < photos->count; i++) {
        if (out->flat)
            out->at[i][2] = 0;
        if (isnan(out->at[i][0] + out->at[i][1] + out->at[i][2]))
            out->at[i][0] = NAN;
        else
            out->count++;
    }
done:
    free(path);
    return st;
}

void cln_photo_gps_free(cln_photo_gps *gps)
{
    free(gps->at);
    *gps = (cln_photo_gps){0};
}

cln_status cln_photo_gps_check(const cln_photo_gps *gps, const char *folder, int photos)
{
    if (gps->count >= CLN_POSES_LEAST)
        return CLN_OK;
    return cln_fail(
        CLN_INPUT,
        "%s: --gps: %d of %d photos have a GPS position (latitude and longitude in EXIF "
        "data, %d of them an altitude), and three are needed. Give the photos as the "
        "camera wrote them, as programs that change or send photos may drop it, or "
        "leave --gps out",
        folder, gps->level, photos, gps->high);
}

/* Of the largest distance from the first place: half of what they are apart at least. */
static double reach(int count, double (*at)[3])
{
    double most = 0;

    for (int i = 1; i < count; i++) {
        double apart[3];

        for (int a = 0; a < 3; a++)
            apart[a] = at[i][a] - at[0][a];
        most = fmax(most, sqrt(cln_dot(apart, apart)));
    }
    return most;
}

/* The middle one of each coordinate, which some wrong ones do not move. */
static cln_status middle_of(int count, double (*at)[3], double out[3])
{
    cln_status st = CLN_OK;
    double *sorted = NULL;

    CLN_TRY(cln_alloc(&sorted, (size_t)count, sizeof *sorted, "positions"));
    for (int a = 0; a < 3; a++) {
        for (int i = 0; i < count; i++)
            sorted[i] = at[i][a];
        cln_reals_sort(sorted, count);
        out[a] = sorted[count / 2];
        if (out[a] - sorted[(count - 1) / 2] < 1) /* not across the 180th meridian */
            out[a] = (out[a] + sorted[(count - 1) / 2]) / 2;
    }
    cln_origin_round(out);
done:
    free(sorted);
    return st;
}

bool cln_photo_gps_wide(const cln_photo_gps *gps, int photos)
{
    double(*at)[3] = NULL;
    const double *first = NULL;
    bool wide = false;
    int count = 0;

    if (gps->count == 0 || cln_alloc(&at, (size_t)photos, sizeof *at, "positions") != CLN_OK)
        return false;
    for (int i = 0; i < photos; i++)
        if (!isnan(gps->at[i][0])) {
            first = first ? first : gps->at[i];
            cln_origin_local(first, gps->at[i], at[count++]);
        }
    wide = count >= CLN_POSES_LEAST && reach(count, at) >= LEAST;
    free(at);
    return wide;
}

/* ---- the model ---- */

/* Cameras of a model, and where GPS has them. */
typedef struct cameras {
    cln_names names;
    double (*at)[3];    /* [camera] by the model */
    int count;          /* with a position: */
    int *which;         /* [count] of the cameras */
    double (*place)[3]; /* [count] latitude, longitude, height; then metres from the origin */
} cameras;

static void free_cameras(cameras *m)
{
    cln_dataset_free_names(&m->names);
    free(m->at);
    free(m->which);
    free(m->place);
}

static int by_name(const void *a, const void *b)
{
    return cln_natural_compare(*(char *const *)a, *(char *const *)b);
}

static cln_status read_cameras(const cln_colmap *c, const cln_photo_gps *gps, const char *folder,
                               cameras *out)
{
    cln_status st = CLN_OK;
    size_t most = 0;
    int *image = NULL;

    CLN_TRY(cln_colmap_places(folder, &out->names, &out->at));
    most = (size_t)out->names.count + 1;
    CLN_TRY(cln_alloc(&out->which, most, sizeof *out->which, "cameras"));
    CLN_TRY(cln_alloc(&out->place, most, sizeof *out->place, "cameras"));
    CLN_TRY(cln_alloc(&image, (size_t)c->photos.count + 1, sizeof *image, "photos"));
    for (int i = 0; i < out->names.count; i++) {
        char *const *found = bsearch(&out->names.name[i], c->photos.name, (size_t)c->photos.count,
                                     sizeof *c->photos.name, by_name);

        if (found)
            image[found - c->photos.name] = i + 1;
    }
    for (int i = 0; i < c->photos.count; i++) /* in their order, as COLMAP changes its own */
        if (image[i] && !isnan(gps->at[i][0])) {
            memcpy(out->place[out->count], gps->at[i], sizeof *out->place);
            out->which[out->count++] = image[i] - 1;
        }
done:
    free(image);
    return st;
}

/* How far the middle one of the cameras is from its position; fails if they are not where they were
 * to be brought. */
static cln_status measure(const cameras *before, const cln_similarity *to, const cameras *after,
                          bool flat, double *distance)
{
    cln_status st = CLN_OK;
    double *apart = NULL, (*at)[3] = NULL, most = 0;

    if (after->count != before->count)
        CLN_TRY(cln_fail(CLN_FAILED, "COLMAP wrote %d of %d cameras", after->count, before->count));
    CLN_TRY(cln_alloc(&apart, (size_t)after->count, sizeof *apart, "cameras"));
    CLN_TRY(cln_alloc(&at, (size_t)after->count, sizeof *at, "cameras"));
    for (int i = 0; i < after->count; i++) {
        const double *is = after->at[after->which[i]];
        double off[3];

        cln_similarity_apply(to, before->at[before->which[i]], at[i]);
        for (int a = 0; a < 3; a++)
            off[a] = is[a] - at[i][a];
        most = fmax(most, sqrt(cln_dot(off, off)));
        for (int a = 0; a < 3; a++)
            off[a] = is[a] - after->place[i][a];
        if (flat)
            off[2] = 0;
        apart[i] = sqrt(cln_dot(off, off));
    }
    cln_reals_sort(apart, after->count);
    *distance = apart[after->count / 2];
    if (!(most <= DONE * reach(after->count, at) + DONE))
        CLN_TRY(
            cln_fail(CLN_FAILED, "COLMAP left cameras up to %.3g m from where they belong", most));
done:
    free(apart);
    free(at);
    return st;
}

/* Puts the folder `made` in the place of `model`, and the other way round. */
static cln_status exchange(const char *made, const char *model)
{
    cln_status st = CLN_OK;
    char *aside = NULL;

#ifdef RENAME_EXCHANGE
    if (renameat2(AT_FDCWD, made, AT_FDCWD, model, RENAME_EXCHANGE) == 0)
        return CLN_OK;
#endif
    CLN_TRY(cln_asprintf(&aside, "%s.before", made)); /* file systems without that, as NFS */
    if (rename(model, aside) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", model, strerror(errno)));
    if (rename(made, model) != 0) {
        st = cln_fail(CLN_OUTPUT, "%s: %s", model, strerror(errno));
        (void)rename(aside, model);
        goto done;
    }
    if (rename(aside, made) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", aside, strerror(errno)));
done:
    free(aside);
    return st;
}

/* What the folder of the model before has beside the model, and where it goes. */
typedef struct leftover {
    const char *made, *model;
    char *aside;     /* what would be of the model before; NULL: there is no such file yet */
    const char *out; /* the scene */
    int stay;        /* files that are with the new model; the first of them: */
    char *first;
} leftover;

static bool is_model(const char *name, const char *ending)
{
    static const char *const files[] = {"cameras", "images", "points3D", "rigs", "frames"};

    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        const size_t length = strlen(files[i]);

        if (strncmp(name, files[i], length) == 0 && strcmp(name + length, ending) == 0)
            return true;
    }
    return false;
}

/* The folder of files that cannot stay: a new one each time. */
static cln_status make_aside(leftover *l)
{
    cln_status st = CLN_OK;
    struct stat info;

    CLN_TRY(cln_path_join(&l->aside, l->out, "sparse.before"));
    for (int i = 2; lstat(l->aside, &info) == 0; i++) {
        free(l->aside);
        l->aside = NULL;
        CLN_TRY(cln_asprintf(&l->aside, "%s/sparse.before.%d", l->out, i));
    }
    CLN_TRY(cln_make_dirs(l->aside));
done:
    return st;
}

static cln_status move_one(leftover *l, const char *name)
{
    cln_status st = CLN_OK;
    char *from = NULL, *to = NULL;
    double origin[3];
    cln_origin_doubt doubt;
    struct stat info;
    const bool place = cln_origin_is_named(name);

    CLN_TRY(cln_path_join(&from, l->made, name));
    if (is_model(name, ".bin") || (place && cln_origin_read(l->made, origin, &doubt))) {
        if (unlink(from) != 0)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", from, strerror(errno)));
        goto done;
    }
    CLN_TRY(cln_path_join(&to, l->model, name));
    if (is_model(name, ".txt") || place || lstat(to, &info) == 0) {
        free(to);
        to = NULL;
        if (!l->aside)
            CLN_TRY(make_aside(l));
        CLN_TRY(cln_path_join(&to, l->aside, name));
    } else if (strcmp(name, "project.ini") != 0 && l->stay++ == 0) { /* the mapper's, of no frame */
        CLN_TRY(cln_strdup(&l->first, name));
    }
    if (rename(from, to) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot be moved to %s: %s", from, to, strerror(errno)));
done:
    free(from);
    free(to);
    return st;
}

/* Removes `made`, the model before; what is not of it goes to `model`, text files of a model to a
 * folder of their own. After an attempt that was interrupted, too. */
static cln_status settle(const char *out, const char *made, const char *model)
{
    cln_status st = CLN_OK;
    leftover l = {.made = made, .model = model, .out = out};
    struct stat info;
    DIR *dir = NULL;

    if (lstat(made, &info) != 0)
        return CLN_OK;
    if (S_ISLNK(info.st_mode)) { /* the folder that it points to is another's */
        if (unlink(made) != 0)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", made, strerror(errno)));
        goto done;
    }
    dir = opendir(made);
    if (!dir)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", made, strerror(errno)));
    for (struct dirent *entry = readdir(dir); entry; entry = readdir(dir))
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
            CLN_TRY(move_one(&l, entry->d_name));
    if (rmdir(made) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", made, strerror(errno)));
    if (l.aside)
        cln_warn("--gps: COLMAP writes the placed model as binary files; those that %s had as text "
                 "are in %s now, as they were",
                 model, l.aside);
    if (l.stay)
        cln_warn("--gps: %s holds %d file%s that COLMAP does not turn (the first is '%s'), and "
                 "that stay%s as %s: what has coordinates is of the frame before, so make it anew",
                 model, l.stay, cln_plural(l.stay, "", "s"), l.first, cln_plural(l.stay, "s", ""),
                 cln_plural(l.stay, "it is", "they are"));
done:
    if (dir)
        closedir(dir);
    free(l.aside);
    free(l.first);
    return st;
}

#define STAYS "; the scene stays as it was"

/* "up is known to about 0.4 degrees, ...": result's, and whether that is enough. */
static bool take_doubt(const cln_place_turn *turn, cln_poses_result *result)
{
    result->gps_used = turn->used;
    result->up_sd = turn->up;
    result->north_sd = turn->north;
    result->length_sd = turn->length;
    if (turn->up <= TURN_MOST && turn->north <= TURN_MOST && turn->length <= LENGTH_MOST)
        return true;
    cln_warn(
        "--gps: by %d positions that are some metres off, up is known to about %.2g degrees, "
        "north to %.2g and length to %.2g %%: too little, as they lie near one line or place, "
        "or do not fit" STAYS " (a length that is known gives the unit: man cl-nascent, MEASURING)",
        turn->used, fmin(turn->up, 180), fmin(turn->north, 180), fmin(100 * turn->length, 100));
    return false;
}

static void tell_difference(const cln_place_turn *turn, const cln_up_told *told)
{
    char theirs[96] = "";

    if (told->what == CLN_UP_TOLD)
        cln_format(theirs, sizeof theirs, "=%.3f,%.3f,%.3f", cln_dot(turn->to.turn, told->up),
                   cln_dot(turn->to.turn + 3, told->up), cln_dot(turn->to.turn + 6, told->up));
    if (!turn->differ)
        return;
    if (turn->theirs)
        cln_warn(
            "--gps: by heights of GPS up is %.1f degrees from where the cameras have it, which "
            "are held level to about %.1f: %.2g m from end to end, as heights drift during a "
            "flight. The cameras' up is taken; if they were all held askew, give --up to "
            "render and export",
            turn->apart, turn->by_them, turn->drift);
    else
        cln_warn("--gps: by the cameras, if they are held level, up is %.1f degrees from where GPS "
                 "has it, which tells it to about %.1f and is taken, as %.2g m from end to end are "
                 "more than heights drift; if GPS is wrong, give --up%s to render and export",
                 turn->apart, turn->by_gps, turn->drift, theirs);
}

/* Has COLMAP apply it. *distance: as measure. */
static cln_status apply(cln_colmap *c, const cln_photo_gps *gps, const char *model,
                        const char *made, const cameras *before, const cln_similarity *to,
                        bool by_matrix, const double origin[3], double *distance)
{
    cln_status st = CLN_OK;
    cameras after = {0};

    CLN_TRY(cln_colmap_remove(made));
    CLN_TRY(cln_make_dirs(made));
    CLN_TRY(cln_colmap_transform(c, model, to, by_matrix, made));
    CLN_TRY(read_cameras(c, gps, made, &after));
    for (int i = 0; i < after.count; i++)
        cln_origin_local(origin, after.place[i], after.place[i]);
    CLN_TRY(measure(before, to, &after, gps->flat, distance));
done:
    free_cameras(&after);
    return st;
}

/* From `model` to the folder `made`. *fits: it is to be taken. */
static cln_status make(cln_colmap *c, const cln_photo_gps *gps, const cln_up_told *told,
                       const char *model, const char *made, cln_poses_result *result, bool *fits)
{
    cln_status st = CLN_OK;
    cameras before = {0};
    char *why = NULL;
    double origin[3], last[3], (*from)[3] = NULL;
    cln_place_turn turn;
    cln_origin_doubt doubt;

    CLN_TRY(read_cameras(c, gps, model, &before));
    if (before.count < CLN_POSES_LEAST) {
        cln_warn("--gps: of the photos in %s, %d have a pose (by their names) and a GPS position, "
                 "and three are needed" STAYS,
                 c->images, before.count);
        goto done;
    }
    CLN_TRY(middle_of(before.count, before.place, origin));
    CLN_TRY(cln_alloc(&from, (size_t)before.count, sizeof *from, "cameras"));
    for (int i = 0; i < before.count; i++) {
        cln_origin_local(origin, before.place[i], before.place[i]);
        memcpy(from[i], before.at[before.which[i]], sizeof *from);
    }
    if (gps->flat && told->what != CLN_UP_TOLD) {
        cln_warn("--gps: %d photos have latitude and longitude, %d an altitude, without which "
                 "cameras tell which way is up, if they are held level, and these do not for sure: "
                 "write altitudes into the photos (exiftool \"-GPSAltitude<AbsoluteAltitude\" "
                 "-GPSAltitudeRef=0 of a drone's, any one number for a flight at one height)" STAYS,
                 gps->level, gps->high);
        goto done;
    }
    if (gps->flat)
        cln_warn("--gps: %d photos have latitude and longitude, %d an altitude: north and length "
                 "are by these, up by the cameras, and heights are from the middle of the cameras "
                 "(man cl-nascent tells how altitudes get into photos)",
                 gps->level, gps->high);
    if (gps->flat)
        CLN_TRY(cln_place_turn_flat(before.count, from, before.place, told, &turn));
    else
        CLN_TRY(cln_place_turn_find(before.count, from, before.place, told, &turn));
    if (!take_doubt(&turn, result))
        goto done;
    st = apply(c, gps, model, made, &before, &turn.to, c->by_matrix, origin, &result->gps_distance);
    if (st == CLN_FAILED && (why = strdup(cln_error_text()))) { /* a version that is not known */
        cln_clear_error();
        st = apply(c, gps, model, made, &before, &turn.to, !c->by_matrix, origin,
                   &result->gps_distance);
        if (st == CLN_FAILED) {
            cln_clear_error();
            st = cln_fail(CLN_FAILED, "%s", why);
        }
    }
    CLN_TRY(st);
    tell_difference(&turn, told);
    if (cln_origin_read(model, last, &doubt) && 2 * before.count < before.names.count)
        cln_warn("--gps: placed again, but by the positions of %d of %d cameras alone; the same "
                 "command on a folder with all their photos places it better",
                 before.count, before.names.count);
    CLN_TRY(cln_origin_write(made, origin, (cln_origin_doubt){result->gps_distance, turn.up}));
    memcpy(result->origin, origin, sizeof origin);
    *fits = true;
done:
    free_cameras(&before);
    free(why);
    free(from);
    return st;
}

cln_status cln_photo_gps_place(cln_colmap *c, const cln_photo_gps *gps, const cln_scene *scene,
                               cln_poses_result *result)
{
    cln_status st = CLN_OK;
    cln_up_told told;
    char *model = NULL, *made = NULL;
    bool fits = false;

    CLN_TRY(cln_path_join(&model, c->desc->out, "sparse/0"));
    CLN_TRY(cln_path_join(&made, c->desc->out, "sparse.gps"));
    CLN_TRY(settle(c->desc->out, made, model));
    cln_up_tell(scene, &told);
    st = make(c, gps, &told, model, made, result, &fits);
    if (st == CLN_FAILED || st == CLN_INPUT) {
        cln_warn("--gps: %s" STAYS, cln_error_text());
        cln_clear_error();
        st = CLN_OK;
    }
    CLN_TRY(st);
    if (fits)
        CLN_TRY(exchange(made, model));
    result->placed = fits;
    CLN_TRY(fits ? settle(c->desc->out, made, model) : cln_colmap_remove(made));
done:
    if (!result->placed)
        result->gps_distance = result->up_sd = result->north_sd = result->length_sd = 0;
    free(model);
    free(made);
    return st;
}
