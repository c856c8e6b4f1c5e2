/* Leaves that are empty by geometry: those that too few training views see, against a count over
 * many places of each leaf, those outside the scene's box, and those far from all sparse points. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "format_fixture.h"
#include "tests.h"
#include "train/carve.h"

static cln_scene *make_scene(const char *folder, const char *bbox, int holdout)
{
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    const cln_scene_desc desc = {.path = folder, .config = &config};
    cln_scene *scene = NULL;

    config.holdout = holdout;
    snprintf(config.bbox, sizeof config.bbox, "%s", bbox);
    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    if (cln_scene_load(&desc, &scene) != CLN_OK)
        fail_msg("%s", cln_error_text());
    return scene;
}

/* The most training views that see one of n^3 places of a box. */
static int most_views(const cln_scene *scene, const float box[4], int n)
{
    int most = 0;

    for (int i = 0; i < n * n * n; i++) {
        const int at[3] = {i % n, i / n % n, i / n / n};
        double p[3], u, v, z;
        int seen = 0;

        for (int a = 0; a < 3; a++)
            p[a] = scene->space.centre[a] +
                   scene->space.half * (box[a] + (double)box[3] * at[a] / (n - 1));
        for (int k = 0; k < scene->view_count; k++)
            seen += scene->views[k].split == CLN_SPLIT_TRAIN &&
                    cln_camera_project(&scene->views[k].camera, p, &u, &v, &z) && z > 0 && u >= 0 &&
                    v >= 0 && u < FORMAT_WIDTH && v < FORMAT_HEIGHT;
        most = seen > most ? seen : most;
    }
    return most;
}

/* A cube around the ring of cameras, so that much of it is behind them or beside their views. Few
 * views see a marked leaf by the finer count either; a leaf seen by the coarse count is not
 * marked. */
static void test_seen(void **state)
{
    cln_scene *scene = make_scene(*state, "-5,-4,-3,7,8,9", 3);
    cln_config config = default_config();
    cln_octree tree = {0};
    int before = 0;

    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TRAIN), 4);
    assert_int_equal(cln_octree_create(3, &tree), CLN_OK);
    for (int least = 0; least <= 5; least++) {
        uint8_t *marks = NULL;
        int count = 0, found = 0;

        config.seen_by = least;
        assert_int_equal(cln_carve_find(scene, &scene->space, &config, &tree, true, &marks, &count),
                         CLN_OK);
        for (int s = 0; s < tree.leaf_count; s++) {
            float box[4];

            cln_octree_box(&tree, tree.leaf[s], box);
            found += marks[s];
            if (least > 0 && least <= 4)
                assert_int_equal(marks[s], most_views(scene, box, 4) < least);
            if (marks[s] && least <= 4) /* little of a leaf is missed between the places */
                assert_true(most_views(scene, box, 7) <= least);
        }
        if (least == 0)
            assert_true(count == 0 && found == 0);
        if (least == 5) /* more than there are: all would be left out, so none is */
            assert_true(count == 0 && found == 0);
        assert_int_equal(count, found);
        if (least >= 1 && least <= 4)
            assert_true(count > before && count < tree.leaf_count);
        before = count;
        free(marks);
    }
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* A slab of a quarter of the cube's height: by hand, the leaves of level 3 whose z is in it. */
static void test_slab(void **state)
{
    cln_scene *scene = make_scene(*state, "-1,0,2.5,3,4,3.5", 0);
    cln_config config = default_config();
    cln_octree tree = {0};

    assert_true(scene->has_box);
    assert_int_equal(cln_octree_create(3, &tree), CLN_OK);
    for (int slab = 0; slab < 2; slab++) {
        uint8_t *marks = NULL;
        int count = 0;

        config.slab = slab;
        assert_int_equal(cln_carve_find(scene, &scene->space, &config, &tree, true, &marks, &count),
                         CLN_OK);
        for (int s = 0; s < tree.leaf_count; s++) {
            const int z = tree.pos[tree.leaf[s]][2]; /* cells of half a unit, from 1 to 5 */

            assert_int_equal(marks[s], slab && (z < 3 || z > 4));
        }
        assert_int_equal(count, slab ? 384 : 0);
        free(marks);
    }
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* Leaves of a whole level that no sparse point is near, by the largest distance along an axis; a
 * point counts for all of its cell of the table. */
static void test_points(void **state)
{
    enum { POINTS = 5 };
    static const double places[POINTS][3] = {
        {-0.9, -0.9, -0.9}, {0.01, 0.6, -0.3}, {0.999, -0.999, 0}, {0.3, 0.3, 0.7}, {5, 0, 0}};
    const double near = 0.2, cell = 2.0 / 64;
    cln_scene *scene = make_scene(*state, "-1,0,2,3,4,6", 0);
    cln_config config = default_config();
    cln_octree tree = {0};

    free(scene->sights);
    scene->sights = calloc(POINTS, sizeof *scene->sights);
    assert_non_null(scene->sights);
    scene->sight_count = POINTS;
    for (int i = 0; i < POINTS; i++)
        cln_space_point_to_scene(&scene->space, places[i], scene->sights[i].point);
    config.points_near = (float)near;
    assert_int_equal(cln_octree_create(3, &tree), CLN_OK);
    for (int whole = 0; whole < 2; whole++) {
        uint8_t *marks = NULL;
        int count = 0, surely = 0;

        assert_int_equal(
            cln_carve_find(scene, &scene->space, &config, &tree, whole, &marks, &count), CLN_OK);
        for (int s = 0; s < tree.leaf_count; s++) {
            float box[4];
            double least = INFINITY;

            cln_octree_box(&tree, tree.leaf[s], box);
            for (int i = 0; i < POINTS - 1; i++) { /* the last is outside the cube */
                double far = 0;

                for (int a = 0; a < 3; a++)
                    far = fmax(far, fabs(places[i][a] - (double)box[a] - 0.5 * (double)box[3]) -
                                        0.5 * (double)box[3]);
                least = fmin(least, far);
            }
            if (!whole || least < near)
                assert_int_equal(marks[s], 0);
            else if (least > near + 2 * cell)
                assert_int_equal(marks[s], 1), surely++;
        }
        assert_true(whole ? count >= surely && surely > 200 : count == 0);
        free(marks);
    }
    cln_octree_free(&tree);
    cln_scene_free(scene);
}

/* The same slab right after another change: all of its leaves, or of those that came back alone. */
static void test_after(void **state)
{
    cln_scene *scene = make_scene(*state, "-1,0,2.5,3,4,3.5", 0);
    cln_config config = default_config();

    config.slab = true;
    for (int fresh = 0; fresh < 2; fresh++) {
        cln_octree tree = {0};
        cln_octree_change change;
        int count = 0;

        assert_int_equal(cln_octree_create(2, &tree), CLN_OK);
        assert_int_equal(cln_octree_split(&tree, NULL, &change), CLN_OK);
        for (int s = 0; s < tree.leaf_count && fresh; s++) /* an eighth of the cube */
            if (tree.pos[tree.leaf[s]][0] == 0)
                change.octant[s] = CLN_FRESH;
        assert_int_equal(
            cln_carve_after(scene, &scene->space, &config, fresh, &tree, &change, &count), CLN_OK);
        assert_int_equal(count, fresh ? 384 / 8 : 384);
        assert_int_equal(change.count, 512 - count);
        assert_int_equal(tree.leaf_count, 512 - count);
        for (int s = 0; s < tree.leaf_count; s++) {
            const int z = tree.pos[tree.leaf[s]][2];

            if (!fresh || change.octant[s] == CLN_FRESH)
                assert_true(z == 3 || z == 4);
        }
        cln_octree_change_free(&change);
        cln_octree_free(&tree);
    }
    cln_scene_free(scene);
}

int test_group_carve(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_seen, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_slab, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_points, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_after, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("carve", tests, NULL, NULL);
}
