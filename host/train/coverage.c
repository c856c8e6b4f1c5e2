/* Leaves projected into the training views. See coverage.h. */
#include "train/coverage.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "ranks/ranks.h"
#include "scene/dealt.h"

/* Tile side in pixels, and tiles along an image's longer side: small tiles follow an outline
 * closely, MOST_TILES bound the cost for large images. */
enum { SMALLEST_TILE = 4, MOST_TILES = 64 };

/* Pixels by which rounding may move a border, the device's float32 rays included. */
static const double SLACK = 0.02;

/* One size for all views, so that all tiles are drawn alike. */
static int tile_side(const cln_scene *scene)
{
    const int n = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int side = SMALLEST_TILE;

    for (int i = 0; i < n; i++) {
        const cln_camera *c = &cln_scene_training_view(scene, i)->camera;
        const int longest = c->width > c->height ? c->width : c->height;

        if ((longest + MOST_TILES - 1) / MOST_TILES > side)
            side = (longest + MOST_TILES - 1) / MOST_TILES;
    }
    return side;
}

typedef struct grid {
    int across, down;
} grid;

static grid grid_of(const cln_camera *c, int side)
{
    return (grid){(c->width + side - 1) / side, (c->height + side - 1) / side};
}

/* Tiles of all training views; first (may be NULL): [views + 1]. */
static size_t count_tiles(const cln_scene *scene, size_t *first)
{
    const int n = cln_scene_split_count(scene, CLN_SPLIT_TRAIN), side = tile_side(scene);
    size_t tiles = 0;

    for (int i = 0; i < n; i++) {
        const grid g = grid_of(&cln_scene_training_view(scene, i)->camera, side);

        tiles += (size_t)g.across * (size_t)g.down;
        if (first)
            first[i + 1] = tiles;
    }
    return tiles;
}

static bool has_masks(const cln_scene *scene)
{
    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++)
        if (cln_scene_training_view(scene, i)->kept || cln_scene_training_view(scene, i)->mask_path)
            return true;
    return false;
}

double cln_coverage_bytes(const cln_scene *scene)
{
    return (double)count_tiles(scene, NULL) *
               (sizeof(cln_tile) + sizeof(float) + (has_masks(scene) ? sizeof(uint32_t) : 0)) +
           (double)cln_scene_split_count(scene, CLN_SPLIT_TRAIN) * 2 * sizeof(size_t);
}

/* Columns and rows of a tile inside the image. */
static grid inside(const cln_camera *c, const cln_tile *tile, int side)
{
    const int wide = c->width - tile->column * side, high = c->height - tile->row * side;

    return (grid){wide < side ? wide : side, high < side ? high : side};
}

/* Tile number k of training view i. */
static cln_tile tile_of(grid g, int i, int k)
{
    return (cln_tile){(uint32_t)i, (uint16_t)(k % g.across), (uint16_t)(k / g.across)};
}

static void count_kept(const cln_scene *scene, cln_coverage *coverage)
{
    const int side = coverage->side;

    for (int i = 0; i < coverage->views; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        const grid g = grid_of(&view->camera, side);
        uint32_t *kept = coverage->kept + coverage->first[i];

        for (int k = 0; k < g.across * g.down; k++) {
            const cln_tile tile = tile_of(g, i, k);
            const grid part = inside(&view->camera, &tile, side);

            for (int n = 0; n < part.across * part.down; n++)
                kept[k] += cln_view_keeps(view, tile.column * side + n % part.across,
                                          tile.row * side + n / part.across);
        }
    }
}

cln_status cln_coverage_create(const cln_scene *scene, cln_coverage *out)
{
    cln_status st = CLN_OK;
    const size_t views = (size_t)cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    size_t tiles = 0;

    *out = (cln_coverage){.side = tile_side(scene), .views = (int)views, .whole = true, .share = 1};
    CLN_TRY(cln_alloc(&out->first, views + 1, sizeof *out->first, "coverage"));
    CLN_TRY(cln_alloc(&out->start, views + 1, sizeof *out->start, "coverage"));
    tiles = count_tiles(scene, out->first);
    CLN_TRY(cln_alloc(&out->tiles, tiles, sizeof *out->tiles, "coverage"));
    CLN_TRY(cln_alloc(&out->error, tiles, sizeof *out->error, "coverage"));
    for (size_t i = 0; i < tiles; i++)
        out->error[i] = -1;
    if (has_masks(scene)) {
        CLN_TRY(cln_alloc(&out->kept, tiles, sizeof *out->kept, "coverage"));
        count_kept(scene, out);
    }
done:
    if (st != CLN_OK)
        cln_coverage_free(out);
    return st;
}

void cln_coverage_free(cln_coverage *coverage)
{
    free(coverage->first);
    free(coverage->start);
    free(coverage->tiles);
    free(coverage->error);
    free(coverage->kept);
    memset(coverage, 0, sizeof *coverage);
}

/* ---- a leaf in a view ---- */

static double norm1(const double v[3])
{
    return fabs(v[0]) + fabs(v[1]) + fabs(v[2]);
}

/* Interval that holds x / z over a cube around p. x, z: the camera's axes; px, pz: p along them;
 * reach: half of the cube's side. With u = px / pz, (px + dx) / (pz + dz) - u = (dx - u dz) /
 * (pz + dz). */
static void extent(double px, double pz, const double x[3], const double z[3], double reach,
                   double out[2])
{
    const double u = px / pz, along[3] = {x[0] - u * z[0], x[1] - u * z[1], x[2] - u * z[2]};
    const double most = reach * norm1(along) / (pz - reach * norm1(z));

    out[0] = u - most;
    out[1] = u + most;
}

/* First and last tile of the pixels with centres in [low, high]; false if there are none. */
static bool tiles_between(double low, double high, int pixels, int side, int out[2])
{
    const double first = fmax(ceil(low - 0.5 - SLACK), 0);
    const double last = fmin(floor(high - 0.5 + SLACK), pixels - 1);

    if (!(first <= last))
        return false;
    out[0] = (int)first / side;
    out[1] = (int)last / side;
    return true;
}

static void mark_tiles(const cln_camera *c, int side, const double across[2], const double down[2],
                       uint8_t *marks)
{
    int columns[2], rows[2];

    if (tiles_between(c->fx * across[0] + c->cx, c->fx * across[1] + c->cx, c->width, side,
                      columns) &&
        tiles_between(c->fy * down[0] + c->cy, c->fy * down[1] + c->cy, c->height, side, rows))
        for (int row = rows[0]; row <= rows[1]; row++)
            memset(marks + row * grid_of(c, side).across + columns[0], 1,
                   (size_t)(columns[1] - columns[0] + 1));
}

/* Marks the tiles that may show a cube. middle: world units; reach: half of its side. False if the
 * cube reaches the camera's plane: any tile may show it then. */
static bool mark_cube(const cln_camera *c, int side, const double middle[3], double reach,
                      uint8_t *marks)
{
    const double *m = c->c2w;
    const double x[3] = {m[0], m[4], m[8]}, y[3] = {m[1], m[5], m[9]}, z[3] = {m[2], m[6], m[10]};
    const double to[3] = {middle[0] - m[3], middle[1] - m[7], middle[2] - m[11]};
    const double pz = to[0] * z[0] + to[1] * z[1] + to[2] * z[2], deep = reach * norm1(z);
    double across[2], down[2];

    if (pz + deep <= 0)
        return true; /* behind */
    if (!(pz - deep > 1e-3 * reach))
        return false;
    extent(to[0] * x[0] + to[1] * x[1] + to[2] * x[2], pz, x, z, reach, across);
    extent(to[0] * y[0] + to[1] * y[1] + to[2] * y[2], pz, y, z, reach, down);
    mark_tiles(c, side, across, down, marks);
    return true;
}

/* The same for a box of a forward space (min x, y, z, side), which is convex in the scene: its
 * corners bound it, and those at infinity are directions. pose: of the camera, in camera units. */
static bool mark_frustum(const cln_camera *c, int side, const cln_space *space,
                         const float pose[12], const float box[4], uint8_t *marks)
{
    double across[2] = {INFINITY, -INFINITY}, down[2] = {INFINITY, -INFINITY};
    int behind = 0;

    for (int k = 0; k < 8; k++) {
        double corner[3], q[4], local[3] = {0, 0, 0};

        for (int a = 0; a < 3; a++)
            corner[a] = (double)box[a] + (k >> a & 1 ? (double)box[3] : 0);
        cln_space_point_to_view(space, corner, q);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                local[b] += (double)pose[4 * a + b] * (q[a] - q[3] * (double)pose[4 * a + 3]);
        if (!(local[2] > 1e-6)) { /* behind the camera or beside it */
            behind++;
            continue;
        }
        across[0] = fmin(across[0], local[0] / local[2]);
        across[1] = fmax(across[1], local[0] / local[2]);
        down[0] = fmin(down[0], local[1] / local[2]);
        down[1] = fmax(down[1], local[1] / local[2]);
    }
    if (behind == 0)
        mark_tiles(c, side, across, down, marks);
    return behind == 0 || behind == 8;
}

/* Marks the tiles of a view that may show a leaf; marks: [tile of the view]. */
static void mark_view(const cln_camera *c, int side, const cln_octree *tree, const cln_space *space,
                      uint8_t *marks)
{
    const grid g = grid_of(c, side);
    const size_t tiles = (size_t)g.across * (size_t)g.down;
    bool whole = cln_camera_is_distorted(c) || space->shell; /* a shell space fills every view */
    float pose[12];

    memset(marks, 0, tiles);
    if (whole && !space->shell && !cln_camera_sees(c, space))
        return;
    cln_space_pose_to_cube(space, c->c2w, pose);
    for (int s = 0; s < tree->leaf_count && !whole; s++) {
        double middle[3], reach = 0;
        float box[4];

        cln_octree_box(tree, tree->leaf[s], box);
        if (space->forward) {
            whole = !mark_frustum(c, side, space, pose, box, marks);
            continue;
        }
        reach = 0.5 * (double)box[3];
        for (int a = 0; a < 3; a++)
            middle[a] = (double)box[a] + reach;
        cln_space_point_to_scene(space, middle, middle);
        whole = !mark_cube(c, side, middle, cln_space_distance_to_scene(space, reach), marks);
    }
    if (whole)
        memset(marks, 1, tiles);
}

/* ---- all of them ---- */

/* Pixels that count of tile number k of training view i. */
static int64_t kept_in(const cln_coverage *coverage, const cln_view *view, int i, int k)
{
    const cln_tile tile = tile_of(grid_of(&view->camera, coverage->side), i, k);
    const grid part = inside(&view->camera, &tile, coverage->side);

    return coverage->kept ? coverage->kept[coverage->first[i] + (size_t)k]
                          : (int64_t)part.across * part.down;
}

/* Sum, over a tile's pixels, of the squared error (mean over channels) of a picture that shows only
 * the background. */
static double background_error(const cln_scene *scene, const cln_view *view, const cln_tile *tile,
                               int side)
{
    const grid g = inside(&view->camera, tile, side);
    const int left = tile->column * side, top = tile->row * side;
    double sum = 0;

    for (int y = top; y < top + g.down; y++)
        for (int x = left; x < left + g.across; x++) {
            float rgb[3], alpha = 0;

            if (!cln_view_keeps(view, x, y))
                continue;
            cln_view_pixel(view, x, y, scene->background, rgb, &alpha);
            for (int k = 0; k < 3; k++) {
                const double error = (double)rgb[k] - (double)scene->background[k];

                sum += error * error / 3;
            }
        }
    return sum;
}

/* Finds the errors of tiles that are not covered and were not known; of several ranks, each those
 * of its own photos. False: all were known. */
static bool find_errors(cln_coverage *coverage, const cln_scene *scene, int i, const uint8_t *marks)
{
    const int side = coverage->side;
    const cln_view *view = cln_scene_training_view(scene, i);
    const grid g = grid_of(&view->camera, side);
    float *errors = coverage->error + coverage->first[i];
    bool any = false;

    for (int k = 0; k < g.across * g.down; k++) {
        const cln_tile tile = tile_of(g, i, k);

        if (marks[k] || errors[k] >= 0)
            continue;
        any = true;
        if (cln_view_is_here(view))
            errors[k] = (float)background_error(scene, view, &tile, side);
    }
    return any;
}

/* Brings the errors of all photos' tiles to all ranks. */
static void share_errors(cln_coverage *coverage, const cln_scene *scene)
{
    int first[CLN_RANKS_MOST + 1];

    cln_scene_dealt(scene, CLN_SPLIT_TRAIN, first);
    CLN_ASSERT(coverage->first[coverage->views] <= INT_MAX);
    for (int r = 0; r <= cln_ranks_count(); r++)
        first[r] = (int)coverage->first[first[r]];
    cln_ranks_gather(coverage->error, sizeof *coverage->error, first, true);
}

void cln_coverage_update(cln_coverage *coverage, const cln_scene *scene, const cln_octree *tree,
                         const cln_space *space)
{
    const int side = coverage->side;
    uint8_t marks[MOST_TILES * MOST_TILES];
    int64_t all = 0, other = 0;
    double error = 0;
    size_t found = 0;
    bool asked = false;

    for (int i = 0; i < coverage->views; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        const grid g = grid_of(&view->camera, side);

        mark_view(&view->camera, side, tree, space, marks);
        for (int k = 0; k < g.across * g.down; k++) {
            const int64_t kept = kept_in(coverage, view, i, k);

            all += kept;
            if (marks[k] && kept > 0)
                coverage->tiles[found++] = tile_of(g, i, k);
        }
        coverage->start[i + 1] = found;
        asked |= find_errors(coverage, scene, i, marks);
    }
    if (asked)
        share_errors(coverage, scene);
    found = 0;
    for (int i = 0; i < coverage->views; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        const grid g = grid_of(&view->camera, side);

        for (int k = 0; k < g.across * g.down; k++) {
            const cln_tile tile = tile_of(g, i, k), *next = &coverage->tiles[found];
            const int64_t kept = kept_in(coverage, view, i, k);

            if (found < coverage->start[i + 1] && next->column == tile.column &&
                next->row == tile.row) {
                found++; /* a covered one */
                continue;
            }
            error += kept > 0 ? (double)coverage->error[coverage->first[i] + (size_t)k] : 0;
            other += kept;
        }
    }
    coverage->whole = found == coverage->first[coverage->views];
    coverage->share = (double)(all - other) / (double)all;
    coverage->error_other = error / (double)all;
}
