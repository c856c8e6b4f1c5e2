/* See standing.h. */
#include "scene/standing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/vectors.h"

/* Photos at least; pairs of them that are compared, of large grids and at most; levels by which
 * two may differ and be alike; cells that stand, at least; of a cell and the eight around it, those
 * that must; cells along the longer side, where it is only told. */
enum {
    LEAST_VIEWS = 8,
    FEWEST_PAIRS = 24,
    MOST_PAIRS = 96,
    ALIKE = 8,
    LEAST_CELLS = 24,
    SPECK = 5,
    CELLS = 192,
    BLOCK = 8,
    BLACK = 16,
    SHARP = 64,
    SHARP_PARTS = 64
};
static const double TURNED = 0.97; /* length of the mean of their axes, or of their right sides */
static const double STANDS = 0.97; /* share of the pairs that are alike where something stands */
/* Mean of that share elsewhere, at most; and beside what stands, of the way from there to 1. The
 * second is of what has one colour. */
static const double MOVES[2] = {0.5, 0.25};
static const double EDGE[2] = {0.35, 0.1};
static const double EDGE_MOST = 0.0125; /* of the longer side: such a block, in small photos */
static const double MOST = 0.4;  /* of the picture, unless it is of one colour, as bars are */
static const double PART = 0.12; /* of what stands, from which on a part of the picture is named */
static const double WIDER = 0.003; /* of the longer side, by which a mask is wider */

/* The views that are compared, all of one size. */
typedef struct chosen {
    const cln_view **views;
    int count, width, height;
} chosen;

static cln_status choose(const cln_scene *scene, chosen *out)
{
    cln_status st = CLN_OK;
    const cln_camera *first = &cln_scene_training_view(scene, 0)->camera;

    out->width = first->width;
    out->height = first->height;
    CLN_TRY(cln_alloc(&out->views, (size_t)scene->view_count, sizeof *out->views, "views"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        if (cln_view_is_loaded(view) && view->camera.width == out->width &&
            view->camera.height == out->height)
            out->views[out->count++] = view;
    }
done:
    return st;
}

/* Are two photos alike at a pixel that counts in both? -1: it does not. */
static int are_alike(const cln_view *a, const cln_view *b, int x, int y)
{
    uint8_t p[4], q[4];
    int most = 0;

    if (!cln_view_keeps(a, x, y) || !cln_view_keeps(b, x, y))
        return -1;
    cln_view_bytes(a, x, y, p);
    cln_view_bytes(b, x, y, q);
    for (int c = 0; c < 3; c++)
        most = abs(p[c] - q[c]) > most ? abs(p[c] - q[c]) : most;
    return most <= ALIKE;
}

/* share[cell]: of the pairs, those that are alike there; NaN: few count. Photos are compared with
 * those half the set away, and a third, as neighbours differ less. */
static cln_status compare(const chosen *c, const cln_standing *grid, float *share)
{
    cln_status st = CLN_OK;
    const int n = c->count, w = grid->width, cells = grid->width * grid->height;
    const int most = (int)fmax(FEWEST_PAIRS, fmin(MOST_PAIRS, (double)(1 << 27) / cells));
    const int pairs = 2 * n < most ? 2 * n : most;
    uint8_t *counted = NULL, *alike = NULL;

    CLN_TRY(cln_alloc(&counted, (size_t)cells, 1, "pixels"));
    CLN_TRY(cln_alloc(&alike, (size_t)cells, 1, "pixels"));
    for (int k = 0; k < pairs; k++) {
        const int a = (int)((int64_t)k * n / pairs), b = (a + (k % 2 ? n / 2 : n / 3)) % n;

        for (int i = 0; i < cells; i++) {
            const int x = (int)((2 * (i % w) + 1) * (int64_t)c->width / (2 * w));
            const int y = (int)((2 * (i / w) + 1) * (int64_t)c->height / (2 * grid->height));
            const int is = are_alike(c->views[a], c->views[b], x, y);

            counted[i] = (uint8_t)(counted[i] + (is >= 0));
            alike[i] = (uint8_t)(alike[i] + (is > 0));
        }
    }
    for (int i = 0; i < cells; i++)
        share[i] = 2 * counted[i] >= pairs ? (float)alike[i] / (float)counted[i] : NAN;
done:
    free(counted);
    free(alike);
    return st;
}

/* Marks the cells that stand and have others of these around them. Returns their number. */
static int mark(const cln_standing *grid, const float *share, uint8_t *is)
{
    const int w = grid->width, h = grid->height;
    int count = 0;

    for (int i = 0; i < w * h; i++) {
        const int x = i % w, y = i / w;
        int around = 0, all = 0;

        for (int k = 0; k < 9; k++) {
            const int cx = x + k % 3 - 1, cy = y + k / 3 - 1;

            if (cx < 0 || cy < 0 || cx >= w || cy >= h)
                continue;
            all++;
            around += share[cy * w + cx] >= (float)STANDS;
        }
        is[i] = share[i] >= (float)STANDS && 9 * around >= SPECK * all;
        count += is[i];
    }
    return count;
}

/* out: the cells within `reach` of those, along the rows and then along the columns. */
static cln_status widen(const cln_standing *grid, const uint8_t *is, int reach, uint8_t *out)
{
    cln_status st = CLN_OK;
    const int w = grid->width, h = grid->height;
    uint8_t *rows = NULL;

    CLN_TRY(cln_alloc(&rows, (size_t)w * (size_t)h, 1, "pixels"));
    memset(out, 0, (size_t)w * (size_t)h);
    for (int i = 0; i < w * h; i++)
        for (int x = i % w - reach; is[i] && x <= i % w + reach; x++)
            if (x >= 0 && x < w)
                rows[i / w * w + x] = 1;
    for (int i = 0; i < w * h; i++)
        for (int y = i / w - reach; rows[i] && y <= i / w + reach; y++)
            if (y >= 0 && y < h)
                out[y * w + i % w] = 1;
done:
    free(rows);
    return st;
}

/* *has: do the photos differ elsewhere, and beside what stands nearly as much? plain: it may as
 * well be what is behind an object, so they must do so more. */
static cln_status find_edges(const chosen *c, const cln_standing *grid, const float *share,
                             const uint8_t *is, bool plain, bool *has)
{
    cln_status st = CLN_OK;
    const int cells = grid->width * grid->height;
    const double longer = fmax(grid->width, grid->height);
    /* the pixels of an edge are of both, and those of a JPEG file's blocks across it */
    const int edge =
        (int)fmax(1, fmin(ceil((double)BLOCK * grid->width / c->width), round(EDGE_MOST * longer)));
    uint8_t *near[2] = {NULL, NULL};
    double all = 0, beside = 0;
    int all_count = 0, beside_count = 0;

    for (int k = 0; k < 2; k++) {
        CLN_TRY(cln_alloc(&near[k], (size_t)cells, 1, "pixels"));
        CLN_TRY(widen(grid, is, edge + 2 * k, near[k]));
    }
    for (int i = 0; i < cells; i++) {
        if (isnan(share[i]) || near[0][i])
            continue;
        all += (double)share[i];
        all_count++;
        beside += near[1][i] ? (double)share[i] : 0;
        beside_count += near[1][i];
    }
    all /= all_count;
    beside /= beside_count;
    *has = all_count > 0 && beside_count > 0 && all < MOVES[plain] &&
           beside < all + EDGE[plain] * (1 - all);
done:
    free(near[0]);
    free(near[1]);
    return st;
}

/* The grey of a cell in the first photo. */
static double grey(const chosen *c, const cln_standing *grid, int cell)
{
    const int w = grid->width, h = grid->height;
    uint8_t p[4];

    cln_view_bytes(c->views[0], (int)((2 * (cell % w) + 1) * (int64_t)c->width / (2 * w)),
                   (int)((2 * (cell / w) + 1) * (int64_t)c->height / (2 * h)), p);
    return (p[0] + p[1] + p[2]) / 3.0;
}

/* Is what stands of one grey, but for noise? */
static bool is_plain(const chosen *c, const cln_standing *grid, const uint8_t *is)
{
    double sum = 0, squares = 0;
    int count = 0;

    for (int i = 0; i < grid->width * grid->height; i++) {
        const double at = is[i] ? grey(c, grid, i) : 0;

        sum += at;
        squares += at * at;
        count += is[i];
    }
    return squares / count - pow(sum / count, 2) < ALIKE * ALIKE;
}

/* Names the thirds of the picture that have much of it: whole rows first. */
static void name_parts(const cln_standing *grid, const uint8_t *is, int count, char *text,
                       size_t bytes)
{
    static const char *const row_names[3] = {"top", "middle", "bottom"};
    static const char *const names[9] = {"top left",    "top",    "top right",
                                         "left",        "middle", "right",
                                         "bottom left", "bottom", "bottom right"};
    int of[9] = {0};
    size_t length = 0;

    for (int i = 0; i < grid->width * grid->height; i++)
        of[3 * (3 * (i / grid->width) / grid->height) + 3 * (i % grid->width) / grid->width] +=
            is[i];
    text[0] = 0;
    for (int row = 0; row < 3; row++) {
        const int *r = of + 3 * row;
        bool whole = true;

        for (int k = 0; k < 3; k++)
            whole = whole && r[k] >= PART * count;
        for (int k = 0; k < 3 && length < bytes; k++)
            if (whole ? k == 0 : r[k] >= PART * count)
                length +=
                    (size_t)snprintf(text + length, bytes - length, "%s%s", length ? ", " : "",
                                     whole ? row_names[row] : names[3 * row + k]);
    }
    if (!length)
        snprintf(text, bytes, "all over");
}

/* Do the cameras turn, so that what is far away cannot stand still in their photos? */
static bool cameras_turn(const chosen *c)
{
    double sum[2][3] = {{0}};

    for (int i = 0; i < c->count; i++)
        for (int a = 0; a < 3; a++) {
            sum[0][a] += c->views[i]->camera.c2w[4 * a] / c->count;
            sum[1][a] += c->views[i]->camera.c2w[4 * a + 2] / c->count;
        }
    return fmin(cln_dot(sum[0], sum[0]), cln_dot(sum[1], sum[1])) < TURNED * TURNED;
}

/* Drops what may as well be the sky before cameras that do not turn: what is neither black nor
 * beside something else of what stands, as letters are. */
static void drop_smooth(const chosen *c, const cln_standing *grid, float *share, uint8_t *is)
{
    const int w = grid->width, h = grid->height, most = w > h ? w : h;
    const int reach = most / SHARP_PARTS > 2 ? most / SHARP_PARTS : 2;

    for (int i = 0; i < w * h; i++) {
        const double at = grey(c, grid, i);
        bool keeps = at < BLACK;

        if (!is[i])
            continue;
        for (int k = 0; k < 8 && !keeps; k++) {
            const int far = (k % 2 ? reach : (reach + 1) / 2) * (k & 2 ? 1 : -1);
            const int x = i % w + (k & 4 ? far : 0), y = i / w + (k & 4 ? 0 : far);

            keeps = x >= 0 && y >= 0 && x < w && y < h && is[y * w + x] &&
                    fabs(grey(c, grid, y * w + x) - at) > SHARP;
        }
        if (!keeps)
            share[i] = NAN;
    }
    for (int i = 0; i < w * h; i++)
        is[i] = is[i] && !isnan(share[i]);
}

cln_status cln_scene_find_standing(const cln_scene *scene, int longer, cln_standing *out)
{
    cln_status st = CLN_OK;
    chosen c = {0};
    float *share = NULL;
    int side = 0, count = 0;
    bool plain = false, turns = false, found = false;

    *out = (cln_standing){0};
    if (scene->has_alpha || cln_scene_split_count(scene, CLN_SPLIT_TRAIN) < 1)
        return CLN_OK;
    CLN_TRY(choose(scene, &c));
    turns = cameras_turn(&c);
    out->one_way = c.count >= LEAST_VIEWS && !turns;
    if (c.count < LEAST_VIEWS || (!turns && !scene->amid))
        goto done;
    side = c.width > c.height ? c.width : c.height;
    longer = longer < side ? longer : side;
    out->width = (int)fmax(1, round((double)longer * c.width / side));
    out->height = (int)fmax(1, round((double)longer * c.height / side));
    CLN_TRY(cln_alloc(&share, (size_t)out->width * (size_t)out->height, sizeof *share, "pixels"));
    CLN_TRY(
        cln_alloc(&out->is, (size_t)out->width * (size_t)out->height, sizeof *out->is, "pixels"));
    CLN_TRY(compare(&c, out, share));
    count = mark(out, share, out->is);
    if (!turns) {
        drop_smooth(&c, out, share, out->is);
        count = mark(out, share, out->is);
    }
    out->share = (double)count / ((double)out->width * out->height);
    plain = out->plain = count >= LEAST_CELLS && is_plain(&c, out, out->is);
    if (count >= LEAST_CELLS && (plain || out->share <= MOST))
        CLN_TRY(find_edges(&c, out, share, out->is, plain, &found));
    if (found)
        name_parts(out, out->is, count, out->where, sizeof out->where);
    else {
        free(out->is);
        *out = (cln_standing){.one_way = !turns};
    }
done:
    if (st != CLN_OK) {
        free(out->is);
        *out = (cln_standing){0};
    }
    free(share);
    free(c.views);
    return st;
}

bool cln_scene_tell_standing(const cln_scene *scene, char text[CLN_STANDING_BYTES], bool *plain)
{
    cln_standing found = {0};
    char file[640], quoted[2][700];
    double percent = 0;
    bool any = false;

    *plain = false;
    if (scene->still)
        return false;
    if (cln_scene_find_standing(scene, CELLS, &found) != CLN_OK)
        cln_clear_error(); /* a sentence less */
    any = found.is != NULL;
    *plain = found.plain;
    percent = 100 * found.share;
    free(found.is);
    if (!any)
        return false;
    snprintf(file, sizeof file, "%.500s/masks/all.png", scene->folder);
    snprintf(text, CLN_STANDING_BYTES,
             "%.*f%% of the picture (%s) is the same in all photos although the cameras move%s "
             "would be learnt as fog before each camera: mask it. `cl-nascent check %s "
             "--write-mask %s` draws that mask%s",
             percent < 9.95, percent, found.where,
             found.plain ? ", and of one colour. If it is sky, a wall or a backdrop, behind what "
                           "keeps its place in all photos, all is well; bars, a round field or "
                           "what carries the camera"
                         : ": a logo, date or HUD burnt into them, or what carries the camera. It",
             cln_shell_quote(scene->path, quoted[0], sizeof quoted[0]),
             cln_shell_quote(file, quoted[1], sizeof quoted[1]),
             scene->mask_count > 0 ? "; add it to the photos' own ones" : " for all photos");
    return true;
}

/* The folder of a file, if it is not there. */
static cln_status make_folder(const char *path)
{
    cln_status st = CLN_OK;
    const char *slash = strrchr(path, '/');
    char *folder = NULL;

    if (!slash || slash == path)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&folder, "%.*s", (int)(slash - path), path));
    CLN_TRY(cln_make_dirs(folder));
done:
    free(folder);
    return st;
}

cln_status cln_scene_write_standing(const cln_scene *scene, const char *path)
{
    cln_status st = CLN_OK;
    cln_standing found = {0};
    uint8_t *mask = NULL;
    int reach = 0;

    CLN_TRY(cln_scene_find_standing(scene, 1 << 16, &found));
    if (!found.is)
        CLN_TRY(cln_fail(
            CLN_INPUT,
            found.one_way && !scene->amid
                ? "%s: its cameras look one way and move little, or nothing tells how far "
                  "they see: before them, what is far away stands still as a logo does, so "
                  "that nothing was looked for. Draw a mask of bars, text or a round field"
            : found.one_way
                ? "%s: nothing black or sharply drawn was found that stands still in its photos, "
                  "or in "
                  "what masks leave of them, and its cameras look one way, so that the "
                  "rest may be far away; draw a mask if something stands in all photos"
                : "%s: nothing was found that stands still in its photos, or in what masks leave "
                  "of them, "
                  "so there is no mask to write; draw one if something does that changes, "
                  "as the digits of a clock, or a person who carries the camera (man cl-nascent, "
                  "EXAMPLES: nadir.png)",
            scene->path));
    CLN_TRY(cln_alloc(&mask, (size_t)found.width * (size_t)found.height, 1, "mask"));
    reach = (int)fmax(1, round(WIDER * fmax(found.width, found.height)));
    CLN_TRY(widen(&found, found.is, reach, mask));
    for (int i = 0; i < found.width * found.height; i++)
        mask[i] = mask[i] ? 0 : 255;
    CLN_TRY(make_folder(path));
    CLN_TRY(cln_image_write_png(path, found.width, found.height, 1, mask));
done:
    free(mask);
    free(found.is);
    return st;
}
