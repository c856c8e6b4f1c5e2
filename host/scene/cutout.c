/* What the masks beside photos mean, by --masks: pixels that do not count (images.c), or the
 * silhouette of an object, outside of which is nothing; then a mask becomes its photo's alpha file.
 * Nothing in the files says which. `auto` looks at some masks, evenly chosen:
 *   of an object     what is kept is one part around the middle, well below the whole, and nearly
 *                    all of the border is dropped
 *   of the camera    the same for all photos (a window), or for all of each camera of a rig, or
 *                    round (a fisheye's image)
 *   else             a bonnet, a drone's leg, people, the sky: the border is mostly kept
 * Masks are alpha if nearly all photos have one and nearly all of these are of an object; where
 * something speaks against it, they are not, as pixels that do not count do less harm. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "base/callbacks.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/build.h"
#include "scene/dealt.h"

enum { FIXED_KINDS = 3, MOST_BYTES = 1 << 28 };  /* masks of a file, at least; of a file */
enum { LOOKED_AT = 16, LEAST = 3, CELLS = 128 }; /* masks; cells along the longer side of one */
static const double NEARLY_ALL = 0.8;            /* of photos and of masks */
static const double MOST_KEPT = 0.7;             /* of an object's mask */
static const double BORDER = 0.8;                /* of its border, what it drops at least */
static const double HALF = 0.5;                  /* of it, what others keep beyond doubt */
static const double ONE_PART = 0.6;              /* of what it keeps, the largest part at least */
static const double MIDDLE = 0.2;                /* its middle's distance from a side, at least */
static const double ROUND = 0.95; /* of what it keeps, what a disc as large holds: a square 0.91 */
static const double WIDE = 0.75;  /* and that disc's width over the shorter side */
static const double OF_FISHEYE = 0.35; /* kept by masks of fisheye lenses, whatever their shape */
static const double CENTRAL = 0.1; /* and its middle's distance from the photo's, over that side */

typedef enum { OTHER, OBJECT, DISC } shape;

/* A mask in coarse cells; `kept` is 1, or 2 once it was counted. */
typedef struct grid {
    int width, height, kept_count, border, border_kept;
    uint8_t kept[CELLS * CELLS];
    double middle[2]; /* of what is kept, in cells */
} grid;

void cln_mask_to_alpha(uint8_t *mask, size_t count, int channels, bool jpeg)
{
    bool clear = false;
    int most = 0;

    for (size_t i = 0; i < count && channels == 4 && !clear; i++)
        clear = mask[4 * i + 3] < 255;
    for (size_t i = 0; i < count; i++) {
        uint8_t *p = mask + (size_t)channels * i;

        if (clear) /* a cut-out: its colours are the photo's */
            p[0] = p[3];
        for (int c = 1; c < 3 && !clear; c++)
            p[0] = p[c] > p[0] ? p[c] : p[0];
        most = p[0] > most ? p[0] : most;
    }
    for (size_t i = 0; i < count; i++) {
        uint8_t *p = mask + (size_t)channels * i;

        if (jpeg) /* black and white are not quite that beside an edge */
            p[0] = p[0] <= 64 ? 0 : p[0] >= 192 ? 255 : (uint8_t)((p[0] - 64) * 255 / 128);
        else if (most < 128) /* labels, as 0 and 1 */
            p[0] = p[0] ? 255 : 0;
        else
            p[0] = (uint8_t)(p[0] * 255 / most);
        p[1] = p[2] = p[0];
    }
}

static bool is_kept(const grid *g, int x, int y)
{
    return x >= 0 && y >= 0 && x < g->width && y < g->height && g->kept[y * g->width + x] == 1;
}

/* Samples a mask of cln_mask_to_alpha(), one pixel of each cell. */
static void fill(grid *g, const uint8_t *alpha, int width, int height, int channels)
{
    const int longer = width > height ? width : height, step = (longer + CELLS - 1) / CELLS;

    *g = (grid){.width = (width + step - 1) / step, .height = (height + step - 1) / step};
    for (int i = 0; i < g->width * g->height; i++) {
        const int x = i % g->width, y = i / g->width;
        const int column = x * step + step / 2 < width ? x * step + step / 2 : width - 1;
        const int row = y * step + step / 2 < height ? y * step + step / 2 : height - 1;
        const bool rim = x == 0 || y == 0 || x == g->width - 1 || y == g->height - 1;

        g->kept[i] = alpha[((size_t)row * (size_t)width + (size_t)column) * (size_t)channels] > 127;
        g->border += rim;
        g->border_kept += rim && g->kept[i];
        g->kept_count += g->kept[i];
        g->middle[0] += g->kept[i] * (x + .5);
        g->middle[1] += g->kept[i] * (y + .5);
    }
    for (int a = 0; a < 2 && g->kept_count; a++)
        g->middle[a] /= g->kept_count;
}

/* Cells of the part that holds `from`, corners joining them, which are then counted. stack: room
 * for CELLS * CELLS. */
static int count_part(grid *g, int from, int *stack)
{
    int count = 0, waiting = 0;

    stack[waiting++] = from;
    g->kept[from] = 2;
    while (waiting) {
        const int at = stack[--waiting];

        count++;
        for (int k = 0; k < 9; k++) {
            const int x = at % g->width + k % 3 - 1, y = at / g->width + k / 3 - 1;

            if (!is_kept(g, x, y))
                continue;
            g->kept[y * g->width + x] = 2;
            stack[waiting++] = y * g->width + x;
        }
    }
    return count;
}

/* Is what is kept a wide disc in the middle, or one that the border cuts? */
static bool is_disc(const grid *g)
{
    const double shorter = fmin(g->width, g->height);
    const double square = g->kept_count / 3.141592653589793;
    int held = 0;

    if (2 * sqrt(square) < WIDE * shorter ||
        hypot(g->middle[0] - .5 * g->width, g->middle[1] - .5 * g->height) > CENTRAL * shorter)
        return false;
    for (int i = 0; i < g->width * g->height; i++)
        held += g->kept[i] && pow(i % g->width + .5 - g->middle[0], 2) +
                                      pow(i / g->width + .5 - g->middle[1], 2) <=
                                  square;
    return held > ROUND * g->kept_count;
}

static shape shape_of(grid *g, int *stack)
{
    const int cells = g->width * g->height;
    int largest = 0;

    if (is_disc(g))
        return DISC;
    if (g->kept_count == 0 || g->kept_count > MOST_KEPT * cells ||
        g->border_kept > (1 - BORDER) * g->border)
        return OTHER;
    for (int a = 0; a < 2; a++) {
        const double place = g->middle[a] / (a ? g->height : g->width);

        if (place < MIDDLE || place > 1 - MIDDLE)
            return OTHER;
    }
    for (int i = 0; i < cells; i++)
        if (g->kept[i] == 1) {
            const int part = count_part(g, i, stack);

            largest = part > largest ? part : largest;
        }
    return largest >= ONE_PART * g->kept_count ? OBJECT : OTHER;
}

/* Exchanges what is kept and what is not, of a mask that was not counted. */
static void reverse(grid *g)
{
    const int cells = g->width * g->height;

    for (int a = 0; a < 2; a++) {
        const double all = .5 * (a ? g->height : g->width) * cells;

        if (g->kept_count < cells)
            g->middle[a] = (all - g->middle[a] * g->kept_count) / (cells - g->kept_count);
    }
    for (int i = 0; i < cells; i++)
        g->kept[i] = !g->kept[i];
    g->kept_count = cells - g->kept_count;
    g->border_kept = g->border - g->border_kept;
}

/* What was seen of masks. */
typedef struct looks {
    int count, of[DISC + 1], alike; /* alike: those with the pixels of the first */
    int reversed;                   /* those that would be of an object if black were kept */
    double kept, border;            /* their shares of the pixels, of the border, summed */
    uint64_t first;
} looks;

static cln_status look_at(const char *path, grid *g, int *stack, looks *out)
{
    cln_status st = CLN_OK;
    uint8_t *mask = NULL;
    int width = 0, height = 0, channels = 0;
    uint64_t digest = CLN_DIGEST_START;
    cln_image_head head;
    grid whole;

    CLN_TRY(cln_image_read_head(path, &head));
    CLN_TRY(cln_image_load(path, &width, &height, &channels, &mask));
    digest = cln_digest(digest, mask, (size_t)width * (size_t)height * (size_t)channels);
    cln_mask_to_alpha(mask, (size_t)width * (size_t)height, channels, head.jpeg);
    fill(g, mask, width, height, channels);
    out->first = out->count ? out->first : digest;
    out->alike += digest == out->first;
    out->count++;
    out->kept += (double)g->kept_count / (g->width * g->height);
    out->border += (double)g->border_kept / g->border;
    whole = *g;
    out->of[shape_of(g, stack)]++;
    reverse(&whole);
    out->reversed += shape_of(&whole, stack) == OBJECT;
done:
    free(mask);
    return st;
}

static bool is_mask(const cln_view *view)
{
    return view->mask_path && !view->mask_black;
}

/* Looks at some of `masks` masks, at most until enough of them are not of an object, nor exchanged:
 * masks of one ring or one day may be, and they follow each other. */
static cln_status look(const cln_scene *scene, int masks, const cln_callbacks *callbacks,
                       looks *out)
{
    cln_status st = CLN_OK;
    const int wanted = masks < LOOKED_AT ? masks : LOOKED_AT;
    grid *g = NULL;
    int *stack = NULL, next = 0;

    CLN_TRY(cln_alloc(&g, 1, sizeof *g, "masks"));
    CLN_TRY(cln_alloc(&stack, CELLS * CELLS, sizeof *stack, "masks"));
    for (int i = 0, met = 0; i < scene->view_count; i++) {
        if (!is_mask(&scene->views[i]) || met++ != (int)((int64_t)next * masks / wanted))
            continue;
        next++;
        CLN_TRY(cln_tell_work(callbacks, NULL, 0, 0));
        CLN_TRY(look_at(scene->views[i].mask_path, g, stack, out));
        if (out->count >= LEAST && out->of[OTHER] - out->reversed > (1 - NEARLY_ALL) * wanted)
            break;
    }
done:
    free(g);
    free(stack);
    return st;
}

static const char REVERSED[] = "of an object that they drop: it is black, and white is around it";

/* Why masks cannot be of an object, or not so that it can be told, a phrase; NULL: nothing says so.
 * *doubt: they may be of one all the same. */
static const char *why_not(const cln_scene *scene, int masks, const looks *seen, bool *doubt)
{
    bool fisheye = false;

    *doubt = false;
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (v->channels == 4 || v->alpha_path)
            return "beside photos with alpha of their own";
        if (v->camera.lens == CLN_LENS_EQUIRECTANGULAR)
            return "of panoramas";
        fisheye = fisheye || cln_lens_is_fisheye(v->camera.lens);
    }
    if (fisheye && seen->kept > OF_FISHEYE * seen->count)
        return "of fisheye lenses, and keep much";
    if (seen->of[DISC] > (1 - NEARLY_ALL) * seen->count && seen->of[DISC] >= seen->of[OBJECT])
        return "round, as the images of fisheye lenses are";
    if (masks < LEAST)
        return "too few to tell what they are of";
    *doubt = seen->border < HALF * seen->count;
    if (seen->alike == seen->count) { /* as of a vase that turns */
        *doubt = *doubt && seen->of[OBJECT] == seen->count;
        return "the same for all photos";
    }
    /* some may be exchanged: alpha.c tells which */
    if (seen->of[OBJECT] + seen->reversed >= NEARLY_ALL * seen->count &&
        seen->reversed > seen->of[OBJECT])
        return REVERSED;
    if (seen->of[OBJECT] + seen->of[DISC] + seen->reversed < NEARLY_ALL * seen->count)
        return "not clearly of an object";
    if (masks < NEARLY_ALL * scene->view_count)
        return "of an object, but of some of the photos alone";
    *doubt = false;
    return NULL;
}

/* ---- masks of a rig's cameras ---- */

typedef struct content {
    int64_t bytes;
    uint64_t digest; /* of those of files as long as others */
    const char *path;
} content;

static int by_content(const void *a, const void *b)
{
    const content *x = a, *y = b;

    if (x->bytes != y->bytes)
        return x->bytes < y->bytes ? -1 : 1;
    return x->digest < y->digest ? -1 : x->digest > y->digest;
}

/* The content of a file that others are as long as; one that cannot be read is refused later. */
static cln_status read_content(content *c)
{
    cln_status st = CLN_OK;
    char *data = NULL;
    size_t bytes = 0;

    st = cln_read_file(c->path, MOST_BYTES, &data, &bytes);
    if (st == CLN_INPUT) {
        cln_clear_error();
        st = CLN_OK;
    }
    c->digest = cln_digest(CLN_DIGEST_START, data, data ? bytes : 0);
    free(data);
    return st;
}

/* Has nearly every mask the same file as others, as each camera of a rig has one? Silhouettes of an
 * object differ from photo to photo. */
static cln_status are_fixed(const cln_scene *scene, int masks, bool *fixed)
{
    cln_status st = CLN_OK;
    content *all = NULL;
    int count = 0, kinds = 0;

    *fixed = false;
    CLN_TRY(cln_alloc(&all, (size_t)masks, sizeof *all, "masks"));
    for (int i = 0; i < scene->view_count; i++) {
        struct stat info;

        if (!is_mask(&scene->views[i]))
            continue;
        all[count].path = scene->views[i].mask_path;
        all[count++].bytes = stat(scene->views[i].mask_path, &info) == 0 ? info.st_size : -1;
    }
    qsort(all, (size_t)count, sizeof *all, by_content);
    for (int i = 0; i < count; i++)
        if ((i > 0 && all[i - 1].bytes == all[i].bytes) ||
            (i + 1 < count && all[i + 1].bytes == all[i].bytes))
            CLN_TRY(read_content(&all[i]));
    qsort(all, (size_t)count, sizeof *all, by_content);
    for (int i = 0; i < count; i++)
        kinds += i == 0 || by_content(&all[i - 1], &all[i]) != 0;
    *fixed = FIXED_KINDS * kinds <= count;
done:
    free(all);
    return st;
}

/* A view's alpha in coarse cells, one pixel of each. `alpha`: room for CELLS * CELLS. */
static void fill_of_view(grid *g, const cln_view *view, uint8_t *alpha)
{
    const int wide = view->camera.width, high = view->camera.height;
    const int longer = wide > high ? wide : high, step = (longer + CELLS - 1) / CELLS;
    const int columns = (wide + step - 1) / step, rows = (high + step - 1) / step;

    for (int i = 0; i < columns * rows; i++) {
        const int x = i % columns * step + step / 2, y = i / columns * step + step / 2;
        uint8_t p[4];

        cln_view_bytes(view, x < wide ? x : wide - 1, y < high ? y : high - 1, p);
        alpha[i] = p[3];
    }
    fill(g, alpha, columns, rows, 1);
}

cln_status cln_alpha_shapes(const cln_scene *scene, uint8_t *shapes)
{
    cln_status st = CLN_OK;
    grid *g = NULL;
    int *stack = NULL;
    uint8_t *alpha = NULL;

    CLN_TRY(cln_alloc(&g, 2, sizeof *g, "masks"));
    CLN_TRY(cln_alloc(&stack, CELLS * CELLS, sizeof *stack, "masks"));
    CLN_TRY(cln_alloc(&alpha, CELLS * CELLS, 1, "masks"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        shapes[i] = CLN_ALPHA_NONE;
        if (view->channels != 4 || !cln_view_is_loaded(view) || !cln_view_is_here(view))
            continue;
        fill_of_view(&g[0], view, alpha);
        g[1] = g[0];
        reverse(&g[1]);
        shapes[i] = shape_of(&g[0], stack) == OBJECT   ? CLN_ALPHA_OBJECT
                    : shape_of(&g[1], stack) == OBJECT ? CLN_ALPHA_REVERSED
                                                       : CLN_ALPHA_OTHER;
    }
done:
    free(g);
    free(stack);
    free(alpha);
    return st;
}

/* black: is that what they keep? */
static void take_as_alpha(cln_scene *scene, bool black)
{
    scene->masks_alpha = true;
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];

        if (!is_mask(v))
            continue;
        free(v->alpha_path);
        v->alpha_path = v->mask_path;
        v->mask_path = NULL;
        v->alpha_mask = true;
        v->alpha_black = black;
    }
}

/* As programs write them that find people and cars. */
static void count_black(cln_scene *scene)
{
    for (int i = 0; i < scene->view_count; i++)
        scene->views[i].mask_black |= is_mask(&scene->views[i]);
}

static void drop_masks(cln_scene *scene)
{
    int dropped = 0;

    for (int i = 0; i < scene->view_count; i++) {
        dropped += scene->views[i].mask_path != NULL;
        free(scene->views[i].mask_path);
        scene->views[i].mask_path = NULL;
    }
    if (dropped)
        cln_warn("%s: the run began without masks, so those of %d image%s are not read; a new run "
                 "has them",
                 scene->folder, dropped, cln_plural(dropped, "", "s"));
}

cln_status cln_scene_read_masks(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    const int asked = desc->config->masks;
    looks seen = {0};
    const char *why = NULL;
    int masks = 0;
    bool fixed = false;

    if (desc->without_masks)
        drop_masks(scene);
    for (int i = 0; i < scene->view_count; i++) {
        masks += is_mask(&scene->views[i]);
        scene->mask_count += scene->views[i].mask_path != NULL;
    }
    if (!scene->mask_count)
        goto done;
    if (!masks) {
        CLN_TRY(cln_strdup(&scene->masks_rule, "dynamic masks: what is not black does not count"));
        goto done;
    }
    if (asked == CLN_MASKS_AUTO) {
        CLN_TRY(look(scene, masks, desc->callbacks, &seen));
        why = why_not(scene, masks, &seen, &scene->masks_doubtful);
        if (!why)
            CLN_TRY(are_fixed(scene, masks, &fixed));
        scene->masks_doubtful |= fixed;
        if (fixed)
            why = "the same for several photos each, as of the cameras of a rig";
    }
    scene->masks_reversed = why == REVERSED;
    if (asked == CLN_MASKS_ALPHA || asked == CLN_MASKS_INVERTED ||
        (asked == CLN_MASKS_AUTO && !why))
        take_as_alpha(scene, asked == CLN_MASKS_INVERTED);
    if (asked == CLN_MASKS_IGNORE_WHITE) {
        count_black(scene);
        CLN_TRY(cln_strdup(&scene->masks_rule, "what is white in them does not count"));
    } else if (asked == CLN_MASKS_ALPHA)
        CLN_TRY(cln_strdup(&scene->masks_rule, "read as alpha: outside of them is nothing"));
    else if (asked == CLN_MASKS_INVERTED)
        CLN_TRY(cln_strdup(&scene->masks_rule,
                           "read as inverted alpha: where they are white is nothing"));
    else if (asked == CLN_MASKS_IGNORE)
        CLN_TRY(cln_strdup(&scene->masks_rule, "what they drop does not count"));
    else if (why)
        CLN_TRY(cln_asprintf(&scene->masks_rule,
                             "%s: what they drop does not count; --masks %s reads them as alpha, "
                             "the silhouette of an object",
                             why, scene->masks_reversed ? "inverted" : "alpha"));
    else
        CLN_TRY(cln_asprintf(&scene->masks_rule,
                             "of an object (%d of them keep %.2g %% of the pixels, one part around "
                             "the middle): read as alpha, outside of them is nothing; --masks "
                             "ignore: what they drop only does not count",
                             seen.count, 100 * seen.kept / seen.count));
done:
    return st;
}
