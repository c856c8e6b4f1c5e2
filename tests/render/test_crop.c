/* Crop boxes (host/render/crop.h): their numbers, as text and turned, against a turn worked out
 * here; and which boxes are known to hold nothing of a tree, in plain, forward and shell spaces,
 * against points of its leaves. */
#include "unit.h"
#include <stdio.h>
#include <string.h>
#include "base/log.h"
#include "base/rng.h"
#include "check/forward_scene.h"
#include "model/shell_tree.h"
#include "near.h"
#include "render/crop.h"
#include "tests.h"

static double draw(uint32_t *seed, double low, double high)
{
    *seed = cln_hash(*seed + 1);
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

/* v turned about an axis by radians. */
static void turn_about(int axis, double angle, double v[3])
{
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    const double u = v[i], w = v[j];

    v[i] = cos(angle) * u - sin(angle) * w;
    v[j] = sin(angle) * u + cos(angle) * w;
}

/* Is a point of the scene in the box of nine numbers? -1: too near to a side to tell. */
static int in_box(const double n[CLN_CROP_NUMBERS], const double point[3])
{
    double from[3], least = 1e30;

    for (int a = 0; a < 3; a++)
        from[a] = point[a] - 0.5 * (n[a] + n[a + 3]);
    for (int a = 2; a >= 0; a--) /* back, in the other order */
        turn_about(a, -n[6 + a] * 3.14159265358979 / 180, from);
    for (int a = 0; a < 3; a++)
        least = fmin(least, 0.5 * (n[a + 3] - n[a]) - fabs(from[a]));
    return fabs(least) < 1e-4 ? -1 : least > 0;
}

/* A box turned upright: an axis of it is up, it is turned by no more than it was off, and one that
 * is upright stays. */
static void boxes_stand_upright(void **state)
{
    uint32_t seed = 7;

    (void)state;
    for (int i = 0; i < 200; i++) {
        double n[CLN_CROP_NUMBERS] = {1, -4, 3, 5, 0, 6}, level[CLN_CROP_NUMBERS], again[9];
        double up[3], length = 0, cosine = 0, most = 0, trace = 0;
        cln_crop crop, turned;

        for (int a = 0; a < 3; a++) {
            n[6 + a] = i < 20 ? 0 : draw(&seed, -180, 180);
            up[a] = draw(&seed, -1, 1);
        }
        length = sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]);
        for (int a = 0; a < 3; a++)
            up[a] /= length;
        assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_OK);
        cosine = cln_crop_level(&crop, up, level);
        assert_memory_equal(level, n, 6 * sizeof *n);
        assert_int_equal(cln_crop_from_numbers("box", level, &turned), CLN_OK);
        for (int axis = 0; axis < 3; axis++) {
            double before[3] = {axis == 0, axis == 1, axis == 2}, after[3], same = 0, along = 0;

            for (int a = 0; a < 3; a++)
                before[a] = cln_crop_is_turned(&crop) ? crop.turn[3 * axis + a] : before[a];
            memcpy(after, turned.turn + 3 * axis, sizeof after);
            for (int a = 0; a < 3; a++) {
                same += before[a] * after[a];
                along += up[a] * after[a];
            }
            trace += same;
            most = fmax(most, fabs(along));
        }
        assert_near(most, 1, 1e-9);
        assert_near((trace - 1) / 2, cosine, 1e-9); /* the cosine of the turn between them */
        assert_near(cln_crop_level(&turned, up, again), 1, 1e-9);
    }
}

static void numbers_are_a_box(void **state)
{
    static const cln_space space = {.centre = {3, -2, 5}, .half = 4};
    double n[CLN_CROP_NUMBERS];
    cln_crop crop;
    int inside = 0;
    uint32_t seed = 1;

    (void)state;
    assert_int_equal(cln_crop_read("box", "1,-3,4,5,-1,6", n), CLN_OK);
    assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_OK);
    assert_true(crop.on && !cln_crop_is_turned(&crop) && crop.box[4] == -1);
    assert_int_equal(cln_crop_read("box", "1,-4,3,5,0,6,20,-35,110", n), CLN_OK);
    assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_OK);
    assert_true(crop.on && cln_crop_is_turned(&crop));
    cln_crop_place(&space, &crop);
    for (int i = 0; i < 3000; i++) {
        double point[3], cube[3];
        bool within = true;
        int wanted = 0;

        for (int a = 0; a < 3; a++)
            point[a] = space.centre[a] + draw(&seed, -4, 4);
        wanted = in_box(n, point);
        cln_space_point_to_cube(&space, point, cube);
        for (int k = 0; k < 6; k++)
            within = within && crop.planes[k][0] * cube[0] + crop.planes[k][1] * cube[1] +
                                       crop.planes[k][2] * cube[2] + crop.planes[k][3] >=
                                   0;
        if (wanted >= 0)
            assert_int_equal(within, wanted);
        inside += within;
    }
    assert_in_range(inside, 100, 1000); /* 48 of 512 */
    assert_int_equal(cln_crop_read("box", "1,-3,4,5,-1,6,7", n), CLN_USAGE);
    assert_int_equal(cln_crop_read("box", "1,-3,4,5,-1", n), CLN_USAGE);
    assert_int_equal(cln_crop_read("box", "1,-3,4,5,-1,6,0,0,1e400", n), CLN_USAGE);
    assert_int_equal(cln_crop_read("box", "1,-3,4,1,-1,6", n), CLN_OK);
    assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_USAGE);
    cln_clear_error();
    assert_int_equal(cln_crop_read("box", "1,-3,4,5,-7,6", n), CLN_OK);
    assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "minimum -3 is not below the maximum -7 along y"));
}

/* A full tree of level 3 without a share of its leaves. */
static void make_tree(bool shell, uint32_t seed, cln_octree *tree)
{
    uint8_t *cull = NULL;
    cln_octree_change change = {0};

    if (shell)
        assert_int_equal(cln_shell_tree_create(2, tree), CLN_OK);
    else
        assert_int_equal(cln_octree_create(3, tree), CLN_OK);
    cull = calloc((size_t)tree->leaf_count, 1);
    assert_non_null(cull);
    for (int i = 0; i < tree->leaf_count; i++)
        cull[i] = draw(&seed, 0, 1) < 0.9;
    assert_int_equal(cln_octree_cull(tree, cull, &change), CLN_OK);
    cln_octree_change_free(&change);
    free(cull);
}

static void hear(cln_log_level level, const char *line, void *user)
{
    (void)level;
    snprintf(user, 400, "%s", line);
}

/* Warned of are the boxes that are refused elsewhere: what is beyond the cube is little, not none.
 */
static void assert_warned(const cln_space *space, const cln_octree *tree, cln_crop *crop, bool any,
                          bool passes)
{
    char heard[400] = "";

    cln_log_to(CLN_LOG_WARN, hear, heard);
    cln_crop_warn("box", space, tree, crop);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    if (!strstr(heard, passes ? ""
                       : any  ? ": little is in"
                              : ": nothing is in") ||
        (passes && *heard))
        fail_msg("of a box with %s: \"%s\"", passes ? "much" : any ? "little" : "none", heard);
}

/* A box with a point of an active leaf in it is never empty; of small boxes at random most are, as
 * most leaves are gone, and most of them are known to be. */
static void empty_boxes_are_found(void **state)
{
    const cln_space plain = {.centre = {3, -2, 5}, .half = 4};
    const cln_space shell = {.centre = {3, -2, 5}, .half = 4, .shell = true};
    const cln_space forward = cln_check_forward_space(1);
    const cln_space *spaces[] = {&plain, &shell, &forward};

    (void)state;
    for (int k = 0; k < 3; k++) {
        const cln_space *space = spaces[k];
        const cln_space core_space = cln_space_core(space);
        int empty = 0, missed = 0, full = 0, refused = 0, beyond = 0;
        uint32_t seed = 7;
        cln_octree tree;

        make_tree(space->shell, 5, &tree);
        for (int i = 0; i < 400; i++) {
            const int slot = (int)draw(&seed, 0, tree.leaf_count);
            double n[CLN_CROP_NUMBERS] = {0}, cube[3], middle[3];
            float box[4];
            bool any = false, passes = false;
            cln_crop crop;

            cln_octree_box(&tree, tree.leaf[slot], box);
            for (int a = 0; a < 3; a++)
                cube[a] = i % 2 ? box[a] + box[3] * draw(&seed, 0.05, 0.95)
                                : draw(&seed, -0.95, space->forward ? 0.5 : 0.95);
            cln_space_point_to_scene(space, cube, middle);
            if (i % 2 == 0 &&
                (cln_octree_find(&tree, cube) >= 0 || (space->shell && !cln_shell_holds(cube))))
                continue;
            for (int a = 0; a < 3; a++) {
                n[a] = middle[a] - 1e-3 * space->half;
                n[a + 3] = middle[a] + 1e-3 * space->half;
                n[a + 6] = i % 4 < 2 ? draw(&seed, -180, 180) : 0;
            }
            assert_int_equal(cln_crop_from_numbers("box", n, &crop), CLN_OK);
            any = !cln_crop_is_empty(space, &tree, &crop);
            passes = cln_crop_check("box", space, &tree, &crop) == CLN_OK;
            if (!space->shell)
                assert_int_equal(passes, any);
            assert_true(any || !passes);
            assert_warned(space, &tree, &crop, any, passes);
            if (i % 2 && space->shell) { /* where only what is beyond the cube is in it */
                const bool core =
                    fabs(cube[0]) < 0.49 && fabs(cube[1]) < 0.49 && fabs(cube[2]) < 0.49;

                refused += !passes;
                beyond += !cln_space_holds(&core_space, middle);
                assert_true(!core || passes);
            }
            cln_clear_error();
            if (i % 2)
                assert_true(any);
            full += any;
            empty += i % 2 == 0;
            missed += i % 2 == 0 && any;
            assert_false(any && k == 0 && i % 4 == 2); /* along the cube's axes, sides tell all */
        }
        print_message("    %s: %d boxes with something, %d without, %d of these not known to be\n",
                      cln_space_name(space), full - missed, empty, missed);
        assert_true(empty > 100 && missed < empty / 4);
        assert_true(!space->shell || (refused > 20 && refused <= beyond && refused > beyond / 2));
        cln_octree_free(&tree);
    }
}

int test_group_crop(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_stand_upright),
        cmocka_unit_test(numbers_are_a_box),
        cmocka_unit_test(empty_boxes_are_found),
    };

    return cmocka_run_group_tests_name("crop", tests, NULL, NULL);
}
