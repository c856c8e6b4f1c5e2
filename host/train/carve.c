/* Finds leaves that the training views show nothing of. See carve.h. */
#include "train/carve.h"

#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"

enum { PLACES = 4 }; /* tested along each axis of a leaf, faces included */

static bool sees(const cln_camera *camera, const double point[3])
{
    double u, v, z;

    return cln_camera_project(camera, point, &u, &v, &z) && z > 0 && u >= 0 && v >= 0 &&
           u < camera->width && v < camera->height;
}

/* Whether at least `least` training views see the same tested place of a box of the cube. */
static bool is_seen(const cln_scene *scene, const cln_space *space, const float box[4], int least)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    for (int i = 0; i < PLACES * PLACES * PLACES; i++) {
        const int at[3] = {i % PLACES, i / PLACES % PLACES, i / PLACES / PLACES};
        double point[3];
        int seen = 0;

        for (int a = 0; a < 3; a++)
            point[a] = (double)box[a] + (double)box[3] * at[a] / (PLACES - 1);
        cln_space_point_to_scene(space, point, point);
        for (int v = 0; v < views && seen < least; v++)
            seen += sees(&cln_scene_training_view(scene, v)->camera, point);
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

cln_status cln_carve_find(const cln_scene *scene, const cln_space *space, const cln_config *config,
                          const cln_octree *tree, uint8_t **marks, int *count)
{
    cln_status st = CLN_OK;
    const bool slab = config->slab && scene->has_box && !space->forward && !space->shell;

    *count = 0;
    CLN_TRY(cln_alloc(marks, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count && (slab || config->seen_by > 0); s++) {
        float box[4];

        cln_octree_box(tree, tree->leaf[s], box);
        (*marks)[s] = (slab && !is_within(scene, space, box)) ||
                      (config->seen_by > 0 && !is_seen(scene, space, box, config->seen_by));
        *count += (*marks)[s];
    }
    if (*count == tree->leaf_count) { /* then the cameras must be wrong */
        memset(*marks, 0, (size_t)tree->leaf_count);
        *count = 0;
    }
done:
    return st;
}

cln_status cln_carve_after(const cln_scene *scene, const cln_space *space, const cln_config *config,
                           bool fresh, cln_octree *tree, cln_octree_change *change, int *count)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;

    CLN_TRY(cln_carve_find(scene, space, config, tree, &marks, count));
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
