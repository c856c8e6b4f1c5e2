/* Which sparse points masks drop: those that are on what is masked in all photos that they were
 * found in, as on who carries the camera. They are often far off, as that moves along, and would
 * make the cube too large. Only where a few masks are those of all photos: each is read once more
 * for this. */
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "scene/build.h"

enum { MOST_MASKS = 16 };

/* Masks that were read, each with the view that it was read for. */
typedef struct masks {
    int count;
    cln_view read[MOST_MASKS];
} masks;

static bool is_same(const cln_view *a, const cln_view *b)
{
    return strcmp(a->mask_path, b->mask_path) == 0 && a->mask_turn == b->mask_turn &&
           a->mask_black == b->mask_black && a->mask_least == b->mask_least &&
           a->file_width == b->file_width && a->file_height == b->file_height &&
           a->downscale == b->downscale;
}

/* The view's mask as it was read, or -1 if that is not done. */
static int find(const masks *m, const cln_view *view)
{
    for (int i = 0; i < m->count; i++)
        if (is_same(&m->read[i], view))
            return i;
    return -1;
}

/* Lists the masks to read; false: none, or more than MOST_MASKS. */
static bool list(const cln_scene *scene, masks *m)
{
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        if (!view->mask_path || find(m, view) >= 0)
            continue;
        if (m->count == MOST_MASKS)
            return false;
        m->read[m->count] = *view;
        m->read[m->count].kept = m->read[m->count].masked = NULL;
        m->count++;
    }
    return m->count > 0;
}

/* *all = false if one cannot be read, of which others tell. */
static cln_status read_masks(masks *m, bool *all)
{
    cln_status st = CLN_OK;

    *all = true;
    for (int i = 0; i < m->count && *all; i++) {
        st = cln_view_read_mask(&m->read[i]);
        *all = st != CLN_INPUT;
        if (!*all)
            cln_clear_error();
        else
            CLN_TRY(st);
    }
    st = CLN_OK;
done:
    return st;
}

/* Is the point on what the view's mask drops? Not if its picture does not show it. */
static bool is_dropped(const masks *m, const cln_view *view, const double point[3])
{
    double u, v;

    return view->mask_path && cln_camera_shows(&view->camera, point, &u, &v) &&
           !cln_view_keeps(&m->read[find(m, view)], (int)u, (int)v);
}

cln_status cln_scene_drop_points(const cln_scene *scene, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const int views = scene->view_count + scene->missing;
    int *view_of = NULL;
    uint8_t *found = NULL; /* [point] 1: dropped in a photo, 2: kept in one */
    bool all = false;
    masks m = {0};

    if (result->observation_count == 0 || !list(scene, &m))
        return CLN_OK;
    CLN_TRY(read_masks(&m, &all));
    if (!all)
        goto done;
    CLN_TRY(cln_alloc(&view_of, (size_t)views, sizeof *view_of, "views"));
    CLN_TRY(cln_alloc(&found, (size_t)result->point_count, 1, "points"));
    for (int i = 0; i < views; i++)
        view_of[i] = -1;
    for (int i = 0; i < scene->view_count; i++)
        view_of[scene->views[i].number] = i;
    for (int64_t i = 0; i < result->observation_count; i++) {
        const cln_observation *o = &result->observations[i];
        const int view = view_of[o->view];

        if (view >= 0)
            found[o->point] |=
                is_dropped(&m, &scene->views[view], result->points[o->point].xyz) ? 1 : 2;
    }
    CLN_TRY(cln_alloc(&result->dropped, (size_t)result->point_count, sizeof *result->dropped,
                      "points"));
    for (int i = 0; i < result->point_count; i++) {
        result->dropped[i] = found[i] == 1;
        result->dropped_count += found[i] == 1;
    }
done:
    for (int i = 0; i < m.count; i++)
        free(m.read[i].masked);
    free(view_of);
    free(found);
    return st;
}
