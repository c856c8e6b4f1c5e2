/* Finds leaves that the training views show nothing of. See carve.h. */
#include "train/carve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { PLACES = 4 }; /* tested along each axis of a leaf, faces included */

/* Whether at least `least` training views see the same tested place of a box of the cube. */
static bool is_seen(const cln_scene *scene, const cln_space *space, const float box[4], int least)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    for (int k = 0; k < PLACES * PLACES * PLACES; k++) {
        const int at[3] = {k % PLACES, k / PLACES % PLACES, k / PLACES / PLACES};
        double point[3];
        double u, v;
        int seen = 0;

        for (int a = 0; a < 3; a++)
            point[a] = (double)box[a] + (double)box[3] * at[a] / (PLACES - 1);
        cln_space_point_to_scene(space, point, point);
        for (int i = 0; i < views && seen < least; i++)
            seen += cln_camera_shows(&cln_scene_training_view(scene, i)->camera, point, &u, &v);
        if (seen >= least)
            return true;
    }
    return false;
}

static bool is_within(const cln_scene *scene, const cln_space *space, const float box[4])
{
    for (int a = 0; a < 3; a++) {
        const double low = space->centre[a] + space->half * (double)box[a];

        if (low >= scene->box[3 + a] || low + space->half * (double)box[3] <= scene->box[a])
            return false;
    }
    return true;
}

/* ---- sparse points ---- */

/* Numbers of points in cells of the cube, summed: sum[z][y][x] of all cells below. */
enum { CELLS = 64, CORNERS = CELLS + 1 };
typedef uint32_t points_table[CORNERS][CORNERS][CORNERS];

static int cell_of(double x)
{
    const int cell = (int)floor((x + 1) / 2 * CELLS);

    return cell < 0 ? 0 : cell < CELLS ? cell : CELLS - 1;
}

static cln_status count_points(const cln_scene *scene, const cln_space *space, points_table **out)
{
    cln_status st = CLN_OK;
    points_table *sum = NULL;

    CLN_TRY(cln_alloc(&sum, 1, sizeof *sum, "sparse points"));
    for (int64_t i = 0; i < scene->sight_count; i++) {
        double p[3];

        cln_space_point_to_cube(space, scene->sights[i].point, p);
        if (fmax(fabs(p[0]), fmax(fabs(p[1]), fabs(p[2]))) <= 1)
            (*sum)[cell_of(p[2]) + 1][cell_of(p[1]) + 1][cell_of(p[0]) + 1]++;
    }
    for (int z = 1; z < CORNERS; z++)
        for (int y = 1; y < CORNERS; y++)
            for (int x = 1; x < CORNERS; x++)
                (*sum)[z][y][x] += (*sum)[z - 1][y][x] + (*sum)[z][y - 1][x] + (*sum)[z][y][x - 1] -
                                   (*sum)[z - 1][y - 1][x] - (*sum)[z - 1][y][x - 1] -
                                   (*sum)[z][y - 1][x - 1] + (*sum)[z - 1][y - 1][x - 1];
    *out = sum;
done:
    return st;
}

/* Whether cells that touch the box, made larger by `near` on each side, hold points. */
static bool has_points(points_table *sum, const float box[4], double near)
{
    int low[3], high[3];
    uint32_t n = 0;

    for (int a = 0; a < 3; a++) {
        low[a] = cell_of((double)box[a] - near);
        high[a] = cell_of((double)box[a] + (double)box[3] + near) + 1;
    }
    for (int k = 0; k < 8; k++) {
        const int x = k & 1 ? low[0] : high[0], y = k & 2 ? low[1] : high[1];
        const uint32_t part = (*sum)[k & 4 ? low[2] : high[2]][y][x];

        n += ((k & 1) + (k >> 1 & 1) + (k >> 2)) % 2 ? 0u - part : part;
    }
    return n > 0;
}

/* A leaf outside the core of a shell space is not cubical in the scene, and its points are few. */
static bool is_plain(const cln_space *space, const cln_octree *tree, int slot)
{
    return !space->shell || cln_octree_in_middle(tree, tree->leaf[slot]);
}

/* ---- all of it ---- */

cln_status cln_carve_find(const cln_scene *scene, const cln_space *space, const cln_config *config,
                          const cln_octree *tree, bool whole, uint8_t **marks, int *count)
{
    cln_status st = CLN_OK;
    const bool near = whole && config->points_near > 0 && scene->sight_count > 0;
    const double reach = config->points_near * (space->shell ? 0.5 : 1); /* the core's half side */
    points_table *points = NULL;
    const bool slab = config->slab && scene->has_box && !space->forward && !space->shell;

    *count = 0;
    CLN_TRY(cln_alloc(marks, (size_t)tree->leaf_count, 1, "leaf marks"));
    if (near)
        CLN_TRY(count_points(scene, space, &points));
    for (int s = 0; s < tree->leaf_count && (slab || near || config->seen_by > 0); s++) {
        float box[4];

        cln_octree_box(tree, tree->leaf[s], box);
        (*marks)[s] = (slab && !is_within(scene, space, box)) ||
                      (config->seen_by > 0 && !is_seen(scene, space, box, config->seen_by)) ||
                      (near && is_plain(space, tree, s) && !has_points(points, box, reach));
        *count += (*marks)[s];
    }
    if (*count == tree->leaf_count) { /* then the cameras must be wrong */
        memset(*marks, 0, (size_t)tree->leaf_count);
        *count = 0;
    }
done:
    free(points);
    return st;
}

cln_status cln_carve_after(const cln_scene *scene, const cln_space *space, const cln_config *config,
                           bool fresh, cln_octree *tree, cln_octree_change *change, int *count)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;

    CLN_TRY(cln_carve_find(scene, space, config, tree, !fresh, &marks, count));
    if (fresh)
        *count = 0;
    for (int s = 0; fresh && s < change->count; s++) {
        marks[s] = marks[s] && change->octant[s] == CLN_FRESH;
        *count += marks[s];
    }
    if (*count > 0)
        CLN_TRY(cln_octree_cull_after(tree, marks, change));
done:
    free(marks);
    return st;
}
