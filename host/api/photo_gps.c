/* Places a model on the earth. See photo_gps.h. COLMAP's model_aligner does the work, by a list of
 * names and positions that are metres already, about the middle of the cameras: what it makes of
 * degrees differs by version. */
#include "api/photo_gps.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/origin.h"
#include "scene/reader.h"
#include "scene/vectors.h"

/* Metres from a straight line that some photo must be: GPS is as far off. */
static const double LEAST = 5;
/* Of that distance, what the middle one of the cameras may be from its position. */
static const double MISFIT = 0.5;

/* ---- positions ---- */

static bool has_blank(const char *name)
{
    while (*name && !isspace((unsigned char)*name))
        name++;
    return *name != 0;
}

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
        if (isnan(head.gps[0] + head.gps[1] + head.gps[2]))
            out->at[i][0] = NAN;
        else
            out->count++;
        if (!isnan(out->at[i][0]) && has_blank(photos->name[i])) {
            out->at[i][0] = NAN;
            out->unnamed++;
        }
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
    char names[160] = "";

    if (gps->count - gps->unnamed >= CLN_POSES_LEAST)
        return CLN_OK;
    if (gps->unnamed)
        snprintf(names, sizeof names,
                 "; %d more with a space in the name cannot be used, as COLMAP reads a list of "
                 "names: rename %s",
                 gps->unnamed, cln_plural(gps->unnamed, "it", "them"));
    return cln_fail(CLN_INPUT,
                    "%s: --gps: %d of %d photos have a GPS position (latitude, longitude and "
                    "altitude in EXIF data), and three are needed%s. Give the photos as the camera "
                    "wrote them, as programs that change or send photos may drop it, or leave "
                    "--gps out",
                    folder, gps->count - gps->unnamed, photos, names);
}

double cln_gps_width(int count, double (*at)[3])
{
    double along[3] = {0}, width = 0;
    int ends[2] = {0};

    for (int e = 0; e < 2; e++) { /* the farthest from any one, and the farthest from that */
        double most = -1;

        for (int i = 0; i < count; i++) {
            double apart[3];

            for (int a = 0; a < 3; a++)
                apart[a] = at[i][a] - at[ends[0]][a];
            if (cln_dot(apart, apart) > most) {
                most = cln_dot(apart, apart);
                ends[1] = i;
                memcpy(along, apart, sizeof along);
            }
        }
        if (e == 0)
            ends[0] = ends[1];
    }
    cln_unit(along);
    for (int i = 0; i < count; i++) {
        double apart[3], across[3];

        for (int a = 0; a < 3; a++)
            apart[a] = at[i][a] - at[ends[0]][a];
        cln_cross(apart, along, across);
        width = fmax(width, sqrt(cln_dot(across, across)));
    }
    return width;
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

    if (gps->count == gps->unnamed ||
        cln_alloc(&at, (size_t)photos, sizeof *at, "positions") != CLN_OK)
        return false;
    for (int i = 0; i < photos; i++)
        if (!isnan(gps->at[i][0])) {
            first = first ? first : gps->at[i];
            cln_origin_local(first, gps->at[i], at[count++]);
        }
    wide = count >= CLN_POSES_LEAST && cln_gps_width(count, at) >= LEAST;
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

    CLN_TRY(cln_colmap_places(folder, &out->names, &out->at));
    most = (size_t)out->names.count + 1;
    CLN_TRY(cln_alloc(&out->which, most, sizeof *out->which, "cameras"));
    CLN_TRY(cln_alloc(&out->place, most, sizeof *out->place, "cameras"));
    for (int i = 0; i < out->names.count; i++) {
        char *const *found = bsearch(&out->names.name[i], c->photos.name, (size_t)c->photos.count,
                                     sizeof *c->photos.name, by_name);

        if (!found || isnan(gps->at[found - c->photos.name][0]))
            continue;
        memcpy(out->place[out->count], gps->at[found - c->photos.name], sizeof *out->place);
        out->which[out->count++] = i;
    }
done:
    return st;
}

static cln_status write_list(const cameras *m, const char *path)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char line[128];

    CLN_TRY(cln_atomic_open(path, &file));
    for (int i = 0; i < m->count; i++) {
        const char *name = m->names.name[m->which[i]];

        cln_format(line, sizeof line, " %.4f %.4f %.4f\n", m->place[i][0], m->place[i][1],
                   m->place[i][2]);
        CLN_TRY(cln_atomic_write(file, name, strlen(name)));
        CLN_TRY(cln_atomic_write(file, line, strlen(line)));
    }
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}

/* How far the middle one of the cameras is from its position, and how far they are from a line. */
static cln_status measure(const cameras *m, double *distance, double *width)
{
    cln_status st = CLN_OK;
    double *apart = NULL, (*at)[3] = NULL;

    CLN_TRY(cln_alloc(&apart, (size_t)m->count, sizeof *apart, "cameras"));
    CLN_TRY(cln_alloc(&at, (size_t)m->count, sizeof *at, "cameras"));
    for (int i = 0; i < m->count; i++) {
        double off[3];

        memcpy(at[i], m->at[m->which[i]], sizeof *at);
        for (int a = 0; a < 3; a++)
            off[a] = at[i][a] - m->place[i][a];
        apart[i] = sqrt(cln_dot(off, off));
    }
    cln_reals_sort(apart, m->count);
    *distance = apart[m->count / 2];
    *width = cln_gps_width(m->count, at);
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

#define STAYS "; the scene stays as COLMAP made it, without unit and north"

/* From `model` to the folder `made`. *fits: it is to be taken. */
static cln_status make(cln_colmap *c, const cln_photo_gps *gps, const char *model, const char *made,
                       const char *list, cln_poses_result *result, bool *fits)
{
    cln_status st = CLN_OK;
    cameras before = {0}, after = {0};
    double origin[3], width = 0;

    CLN_TRY(read_cameras(c, gps, model, &before));
    if (before.count < CLN_POSES_LEAST) {
        cln_warn("--gps: of the photos that have a pose, %d have a GPS position, and three are "
                 "needed" STAYS,
                 before.count);
        goto done;
    }
    CLN_TRY(middle_of(before.count, before.place, origin));
    for (int i = 0; i < before.count; i++)
        cln_origin_local(origin, before.place[i], before.place[i]);
    CLN_TRY(write_list(&before, list));
    CLN_TRY(cln_make_dirs(made));
    CLN_TRY(cln_colmap_align(c, model, list, made));
    CLN_TRY(read_cameras(c, gps, made, &after));
    if (after.count != before.count)
        CLN_TRY(cln_fail(CLN_FAILED, "%s: COLMAP wrote %d of %d cameras", made, after.count,
                         before.count));
    for (int i = 0; i < after.count; i++)
        cln_origin_local(origin, after.place[i], after.place[i]);
    CLN_TRY(measure(&after, &result->gps_distance, &width));
    if (!(width >= LEAST) || !(result->gps_distance <= MISFIT * width)) {
        cln_warn("--gps: half of the cameras are %.3g m and more from their GPS positions, and all "
                 "within %.3g m of one line or place: too little to tell how the scene is turned "
                 "and how large it is" STAYS,
                 result->gps_distance, width);
        goto done;
    }
    CLN_TRY(cln_origin_write(made, origin));
    memcpy(result->origin, origin, sizeof origin);
    *fits = true;
done:
    free_cameras(&before);
    free_cameras(&after);
    return st;
}

cln_status cln_photo_gps_place(cln_colmap *c, const cln_photo_gps *gps, cln_poses_result *result)
{
    cln_status st = CLN_OK;
    char *model = NULL, *made = NULL, *list = NULL;
    bool fits = false;

    CLN_TRY(cln_path_join(&model, c->desc->out, "sparse/0"));
    CLN_TRY(cln_path_join(&made, c->desc->out, "sparse.gps"));
    CLN_TRY(cln_path_join(&list, c->desc->out, "colmap.places"));
    CLN_TRY(cln_colmap_remove(made));
    st = make(c, gps, model, made, list, result, &fits);
    if (st == CLN_FAILED || st == CLN_INPUT) {
        cln_warn("--gps: %s" STAYS, cln_error_text());
        cln_clear_error();
        st = CLN_OK;
    }
    CLN_TRY(st);
    if (fits)
        CLN_TRY(exchange(made, model));
    result->placed = fits;
    CLN_TRY(cln_colmap_remove(made));
done:
    if (!result->placed)
        result->gps_distance = 0;
    if (list)
        (void)unlink(list);
    free(model);
    free(made);
    free(list);
    return st;
}
