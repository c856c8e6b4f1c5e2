/* Shell spaces against numbers calculated by hand and against their own definition. Tested: points
 * of the core and of all faces there and back, to infinity; a ray's lines: each straight and in one
 * piece, together all of the ray, no longer than their number allows; depths, directions, normals
 * and densities are those of the point's map; which tree holds the pieces. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/rng.h"
#include "model/shell_tree.h"
#include "near.h"
#include "scene/space.h"
#include "tests.h"

static const cln_space space = {.centre = {10, -20, 0.5}, .half = 4, .shell = true};

static void scene_of(const double u[3], double scene[3])
{
    for (int a = 0; a < 3; a++)
        scene[a] = space.centre[a] + space.half * u[a];
}

static void check_point(const double u[3], const double cube[3])
{
    double scene[3], p[3];

    scene_of(u, scene);
    cln_space_point_to_cube(&space, scene, p);
    for (int a = 0; a < 3; a++)
        assert_near(p[a], cube[a], 1e-15);
    cln_space_point_to_scene(&space, cube, p);
    for (int a = 0; a < 3; a++)
        assert_near(p[a], scene[a], 1e-12);
}

static void test_by_hand(void **state)
{
    double p[3];
    cln_space_line lines[CLN_SPACE_LINES];

    (void)state;
    check_point((double[3]){0, 0.5, -1}, (double[3]){0, 0.25, -0.5});
    check_point((double[3]){2, 0, 0}, (double[3]){0.75, 0, 0}); /* w = 1/2 */
    check_point((double[3]){2, 1, -2}, (double[3]){0.75, 0.25, -0.5});
    check_point((double[3]){-1, -4, 2}, (double[3]){-0.125, -0.875, 0.25});
    check_point((double[3]){3, -6, 10}, (double[3]){0.15, -0.3, 0.95});
    /* infinity is 10^6 half sides away */
    cln_space_point_to_scene(&space, (double[3]){0, 0, 1}, p);
    assert_near(p[2], 0.5 + 4e6, 1e-6);
    assert_near(cln_space_depth_to_scene(&space, 0.75f), 3, 0);
    /* a ray from the middle along x: half a unit of the core, half a unit to infinity */
    assert_int_equal(cln_space_lines(&space, space.centre, (double[3]){1, 0, 0}, 0, lines), 2);
    assert_near(lines[0].begin, 0, 0);
    assert_near(lines[0].end, 0.5, 1e-15);
    assert_near(lines[1].begin, 0.5, 1e-15);
    assert_near(lines[1].end, 1, 1e-15);
    assert_near(lines[1].direction[0], 1, 0);
    /* from half a unit on */
    assert_int_equal(cln_space_lines(&space, space.centre, (double[3]){1, 0, 0}, 0.5, lines), 2);
    assert_near(lines[0].origin[0], 0.25, 1e-15);
    assert_near(lines[0].end, 0.25, 1e-15);
    /* from u = (0, -3, 0) along (0.6, 0.8, 0): face -y, at u = (1.5, -1, 0) ... (0.857, -1.857)
     * face +x */
    scene_of((double[3]){0, -3, 0}, p);
    assert_int_equal(cln_space_lines(&space, p, (double[3]){0.6, 0.8, 0}, 0, lines), 3);
    assert_near(lines[0].origin[1], -5.0 / 6, 1e-15);
    assert_near(lines[0].origin[0] + lines[0].end * lines[0].direction[0], 0.5, 1e-15);
    /* it comes in at u = (9/7, -9/7, 0), w = 7/9 */
    assert_near(lines[0].origin[1] + lines[0].end * lines[0].direction[1], -(1 - 3.5 / 9), 1e-15);
    assert_near(lines[1].origin[0] + lines[1].begin * lines[1].direction[0], 1 - 3.5 / 9, 1e-15);
    /* and ends in the face +y at infinity, where x / y = 3/4 */
    assert_near(lines[2].origin[1] + lines[2].end * lines[2].direction[1], 1, 1e-15);
    assert_near(lines[2].origin[0] + lines[2].end * lines[2].direction[0], 0.375, 1e-15);
}

static double length_between(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static void point_at(const cln_space_line *line, double t, double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = line->origin[a] + t * line->direction[a];
}

/* Places of the line that are one in the scene: the point of the scene at `s` along the ray is the
 * line's at some t, and t grows with s. */
static void check_line(const double o[3], const double d[3], const cln_space_line *line)
{
    double last = -1;

    assert_near(length_between(line->direction, (double[3]){0, 0, 0}), 1, 1e-14);
    assert_true(line->end > line->begin);
    for (int k = 0; k <= 8; k++) {
        double p[3], scene[3], back[3], s = 0, error = 0;

        point_at(line, line->begin + (line->end - line->begin) * (0.001 + 0.998 * k / 8), p);
        assert_true(cln_shell_holds(p));
        if (fmax(fabs(p[0]), fmax(fabs(p[1]), fabs(p[2]))) > 1 - 1e-5)
            continue; /* as far as infinity */
        cln_space_point_to_scene(&space, p, scene);
        for (int a = 0; a < 3; a++)
            s += (scene[a] - o[a]) * d[a];
        assert_true(s > last);
        last = s;
        for (int a = 0; a < 3; a++)
            error = fmax(error, fabs(o[a] + s * d[a] - scene[a]));
        if (!(error < 1e-9 * (1 + s)))
            fail_msg("%g off the ray at %g", error, s);
        cln_space_depth_to_cube(&space, o, d, s / space.half, back);
        assert_near(length_between(p, back), 0, 1e-9);
    }
}

static void random_vector(uint32_t i, uint32_t draw, double size, double out[3])
{
    float u[4];

    cln_uniform4(5, CLN_STREAM_SCENE, draw, i, 0, u);
    for (int a = 0; a < 3; a++)
        out[a] = size * (2 * (double)u[a] - 1);
}

static void random_direction(uint32_t i, double out[3])
{
    double length = 0;

    random_vector(i, 1, 1, out);
    if (i % 5 == 4) /* nearly along an axis */
        out[i % 3] *= 1e3;
    if (i % 7 == 6)
        out[i % 3] = 0;
    length = length_between(out, (double[3]){0, 0, 0});
    for (int a = 0; a < 3; a++)
        out[a] /= length;
}

/* Rays from inside, from just outside and from far away. */
static void test_lines(void **state)
{
    static const double sizes[] = {0.9, 1.5, 4, 60};
    int counted[CLN_SPACE_LINES + 1] = {0}, most[2] = {0, 0};

    (void)state;
    for (uint32_t i = 0; i < 20000; i++) {
        double u[3], o[3], d[3], p[3], q[3];
        cln_space_line lines[CLN_SPACE_LINES];
        int count = 0;

        random_vector(i, 0, sizes[i % 4], u);
        random_direction(i, d);
        scene_of(u, o);
        count = cln_space_lines(&space, o, d, 0, lines);
        assert_true(count >= 1);
        counted[count]++;
        most[i % 4 != 0] = count > most[i % 4 != 0] ? count : most[i % 4 != 0];
        cln_space_point_to_cube(&space, o, p);
        point_at(&lines[0], 0, q);
        assert_near(length_between(p, q), 0, 1e-14);
        assert_near(lines[0].begin, 0, 0);
        for (int k = 0; k < count; k++) {
            check_line(o, d, &lines[k]);
            if (k > 0)
                assert_near(lines[k].begin, lines[k - 1].end, 0);
        }
        point_at(&lines[count - 1], lines[count - 1].end, p);
        assert_near(fmax(fabs(p[0]), fmax(fabs(p[1]), fabs(p[2]))), 1, 1e-14);
        for (int a = 0; a < 3; a++) /* nothing is missed between the lines */
            q[a] = o[a] + 1e-3 * d[a];
    }
    /* from the core at most three faces follow it; else there are at most five, and the core */
    assert_int_equal(most[0], 4);
    assert_true(most[1] >= 5 && most[1] <= 6);
    assert_true(counted[2] > 100 && counted[3] > 100 && counted[5] > 10);
}

/* Between one line's end and the next one's begin, no more of the scene is left than rounding's. */
static void test_joints(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 4000; i++) {
        double u[3], o[3], d[3];
        cln_space_line lines[CLN_SPACE_LINES];
        int count = 0;

        random_vector(i, 2, i % 2 ? 0.9 : 3, u);
        random_direction(i, d);
        scene_of(u, o);
        count = cln_space_lines(&space, o, d, 0, lines);
        for (int k = 1; k < count; k++) {
            double before[3], after[3];

            point_at(&lines[k - 1], lines[k - 1].end, before);
            point_at(&lines[k], lines[k].begin, after);
            cln_space_point_to_scene(&space, before, before);
            cln_space_point_to_scene(&space, after, after);
            if (!(length_between(before, after) <
                  1e-9 * (1 + length_between(before, space.centre))))
                fail_msg("a gap of %g", length_between(before, after));
        }
    }
}

/* The map's derivative, as cln_space_direction_to_cube(), _density_to_scene() and
 * _normal_to_scene() have it, by differences. */
static void test_derivative(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 3000; i++) {
        double u[3], at[3], d[3], along[3], before[3], after[3], cube[3], other[3], cosine = 0;
        const double step = 1e-6;
        float normal[3], turned[3];

        random_vector(i, 3, i % 3 ? 4 : 0.9, u);
        random_direction(i, d);
        scene_of(u, at);
        for (int a = 0; a < 3; a++) {
            before[a] = at[a] - step * d[a];
            after[a] = at[a] + step * d[a];
        }
        cln_space_point_to_cube(&space, at, cube);
        cln_space_point_to_cube(&space, before, before);
        cln_space_point_to_cube(&space, after, after);
        if (length_between(before, after) > 3 * step / space.half) /* over an edge */
            continue;
        cln_space_direction_to_cube(&space, at, d, along);
        for (int a = 0; a < 3; a++)
            assert_near((after[a] - before[a]) / length_between(before, after), along[a], 1e-5);
        assert_near(cln_space_density_to_scene(&space, at, d, 7) * 2 * step,
                    7 * length_between(before, after), 1e-5 * 7 * step);
        /* a normal stays at right angles to what it is at right angles to */
        random_vector(i, 4, 1, other);
        for (int a = 0; a < 3; a++)
            normal[a] = (float)(along[(a + 1) % 3] * other[(a + 2) % 3] -
                                along[(a + 2) % 3] * other[(a + 1) % 3]);
        cln_space_normal_to_scene(&space, cube, normal, turned);
        for (int a = 0; a < 3; a++)
            cosine += d[a] * (double)turned[a];
        assert_near(cosine, 0, 3e-6);
    }
}

static void test_other(void **state)
{
    const cln_space cube = {.centre = {10, -20, 0.5}, .half = 4};
    const double c2w[12] = {0, 0, 1, 50, 1, 0, 0, -20, 0, 1, 0, -1.5};
    float out[12];

    (void)state;
    assert_false(cln_space_equal(&space, &cube));
    assert_false(cln_space_equal(&cube, &space));
    assert_true(cln_space_equal(&space, &space));
    cln_space_pose_to_cube(&space, c2w, out); /* cameras are in u */
    assert_near(out[3], 10, 0);
    assert_near(out[11], -0.5, 0);
    assert_true(cln_space_holds(&space, (double[3]){1e5, 0, 0}));
    assert_true(cln_space_met_by(&space, (double[3]){1e5, 0, 0}, (double[3]){1, 0, 0}));
}

/* The tree has the core and the faces, nothing else, and leaves of one size on both sides of the
 * core's border but for a level. */
static void test_tree(void **state)
{
    (void)state;
    for (int level = 2; level <= 4; level++) {
        const int n = 2 << level; /* cells of the core's leaves along the root's side */
        cln_octree tree;
        int most = 0, core = 0;

        assert_int_equal(cln_shell_tree_create(level, &tree), CLN_OK);
        assert_int_equal(tree.leaf_count, (1 << (3 * level)) + 24 * (1 << (3 * (level - 2))));
        assert_int_equal(cln_octree_depth(&tree), level + 1);
        for (int i = 0; i < n * n * n; i++) {
            double at[3];
            int slot = 0;

            for (int a = 0; a < 3; a++)
                at[a] = 2 * ((i >> (a * (level + 1)) & (n - 1)) + 0.5) / n - 1;
            slot = cln_octree_find(&tree, at);
            assert_int_equal(slot >= 0, cln_shell_holds(at));
            core += slot >= 0 && tree.level[tree.leaf[slot]] == level + 1;
        }
        assert_int_equal(core, 1 << (3 * level));
        /* by hand: a length of 4 over cells of 2 / n, and four more for each of six lines */
        assert_int_equal(cln_shell_tree_most_intervals(&tree, &most), CLN_OK);
        assert_int_equal(most, 2 * n + 24);
        assert_true(most == cln_shell_most_intervals(level + 1));
        cln_octree_free(&tree);
    }
}

static int by_value(const void *a, const void *b)
{
    const double d = *(const double *)a - *(const double *)b;

    return (d > 0) - (d < 0);
}

/* Leaves that a ray passes: between all planes of cells of `side` that its lines cross. */
static int count_leaves(const cln_octree *tree, double side, const double o[3], const double d[3])
{
    cln_space_line lines[CLN_SPACE_LINES];
    const int count = cln_space_lines(&space, o, d, 0, lines);
    int met = 0;

    for (int k = 0; k < count; k++) {
        const cln_space_line *l = &lines[k];
        double at[512];
        int n = 0;

        at[n++] = l->begin;
        at[n++] = l->end;
        for (int a = 0; a < 3; a++)
            for (double plane = -1; plane <= 1; plane += side) {
                const double t = (plane - l->origin[a]) / l->direction[a];

                if (t > l->begin && t < l->end)
                    at[n++] = t;
            }
        qsort(at, (size_t)n, sizeof *at, by_value);
        for (int i = 0; i + 1 < n; i++) {
            double p[3];

            for (int a = 0; a < 3; a++)
                p[a] = l->origin[a] + 0.5 * (at[i] + at[i + 1]) * l->direction[a];
            met += at[i + 1] - at[i] > 1e-5 && cln_octree_find(tree, p) >= 0;
        }
    }
    return met;
}

/* No ray meets more leaves than a shell's tree says, and the bound is not far above the most that
 * any meets: a tree whose leaves are all of one size, rays from anywhere to anywhere. */
static void test_most_leaves(void **state)
{
    cln_octree_change change;
    cln_octree tree;
    uint8_t *marks = NULL;
    int most = 0, largest = 0;

    (void)state;
    assert_int_equal(cln_shell_tree_create(4, &tree), CLN_OK);
    marks = calloc((size_t)tree.leaf_count, 1); /* the faces, too, down to level 5 */
    for (int s = 0; s < tree.leaf_count; s++)
        marks[s] = tree.level[tree.leaf[s]] < 5;
    assert_int_equal(cln_octree_split(&tree, marks, &change), CLN_OK);
    cln_octree_change_free(&change);
    free(marks);
    assert_int_equal(cln_shell_tree_most_intervals(&tree, &most), CLN_OK);
    assert_int_equal(most, 2 * 32 + 24);
    for (int i = 0; i < 20000; i++) {
        static const double far[] = {0, 1, 3, 100, 1e5};
        float draws[2][4];
        double u[3], o[3], d[3], length = 0;
        int met = 0;

        for (uint32_t k = 0; k < 2; k++)
            cln_uniform4(5, CLN_STREAM_SCENE, 0, (uint32_t)i, k, draws[k]);
        for (int a = 0; a < 3; a++) {
            u[a] = 3 * draws[0][a] - 1.5;
            d[a] = 2 * draws[1][a] - 1;
            length = hypot(length, d[a]);
        }
        for (int a = 0; a < 3; a++) {
            d[a] /= length;
            u[a] -= far[i % 5] * d[a];
        }
        scene_of(u, o);
        met = count_leaves(&tree, 2.0 / 32, o, d);
        largest = met > largest ? met : largest;
    }
    print_message("at most %d leaves on a ray, counted for %d\n", largest, most);
    assert_true(largest <= most && largest >= 2 * 32 - 4);
    cln_octree_free(&tree);
}

/* What merged above level 2, in a checkpoint of an older program, has its planes counted. */
static void test_coarse_leaves(void **state)
{
    cln_octree tree;
    int most = 0;

    (void)state;
    for (int level = 0; level < 2; level++) {
        assert_int_equal(cln_octree_create(level, &tree), CLN_OK);
        assert_int_equal(cln_shell_tree_most_intervals(&tree, &most), CLN_OK);
        assert_true(most >= 3 * ((1 << level) + 1));
        cln_octree_free(&tree);
    }
}

/* The settings' largest tree has room for whole levels of core and faces; a cube's has no faces. */
static void test_whole_levels(void **state)
{
    cln_config config;
    cln_octree tree;

    (void)state;
    memset(&config, 0, sizeof config);
    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    config.adaptive = false;
    config.level_at[0] = 0;
    for (int level = 1; level < 5; level++) {
        config.start_level = level;
        assert_int_equal(cln_shell_tree_create(level > 2 ? level : 2, &tree), CLN_OK);
        assert_int_equal(cln_config_most_leaves(&config, true), tree.leaf_count);
        cln_octree_free(&tree);
        assert_int_equal(cln_octree_create(level, &tree), CLN_OK);
        assert_int_equal(cln_config_most_leaves(&config, false), tree.leaf_count);
        cln_octree_free(&tree);
    }
    config.start_level = 5;
    snprintf(config.level_at, sizeof config.level_at, "6:0.5");
    assert_int_equal(cln_config_most_leaves(&config, false), 8 * 64 * 64);
    assert_int_equal(cln_config_most_leaves(&config, true), 11 * 64 * 64);
}

int test_group_shell(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_hand),      cmocka_unit_test(test_lines),
        cmocka_unit_test(test_joints),       cmocka_unit_test(test_derivative),
        cmocka_unit_test(test_other),        cmocka_unit_test(test_tree),
        cmocka_unit_test(test_most_leaves),  cmocka_unit_test(test_coarse_leaves),
        cmocka_unit_test(test_whole_levels),
    };

    return cmocka_run_group_tests_name("shell", tests, NULL, NULL);
}
