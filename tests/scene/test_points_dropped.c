/* Sparse points that masks drop in all their photos do not widen the cube. Oracle: points on rays
 * of known cameras, near and far. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "format_fixture.h"
#include "tests.h"

enum { HERE = 120, AWAY = 40, LEFT = 6 };

/* A point of view 0, on the ray of a pixel's middle. */
static cln_point point_at(const cln_camera *camera, int x, int y, double distance, int views)
{
    cln_point p = {.rgb = {1, 2, 3}, .views = views};
    double o[3], d[3];

    assert_true(cln_camera_ray(camera, x + 0.5, y + 0.5, o, d));
    for (int a = 0; a < 3; a++)
        p.xyz[a] = o[a] + distance * d[a];
    return p;
}

/* Black to the left of column `from`. */
static void put_mask(const char *folder, const char *name, int from)
{
    uint8_t pixels[FORMAT_WIDTH * FORMAT_HEIGHT];

    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        pixels[i] = i % FORMAT_WIDTH >= from ? 255 : 0;
    put_folder(folder, "masks");
    assert_int_equal(
        cln_image_write_png(scratch_path(folder, name), FORMAT_WIDTH, FORMAT_HEIGHT, 1, pixels),
        CLN_OK);
}

static void test_cube(void **state)
{
    static const struct {
        const char *mask; /* NULL: none */
        int from, far_views, downscale;
        bool dropped;
    } rows[] = {{NULL, 0, 1, 1, false},
                {"masks/all.png", LEFT, 1, 1, true},
                {"masks/all.png", LEFT, 1, 2, true},
                {"masks/view_00.png.png", LEFT, 1, 1, true},
                {"masks/view_01.png.png", LEFT, 1, 1, false}, /* that of a photo without them */
                {"masks/all.png", 1, 1, 1, false},     /* farther to the left than they are */
                {"masks/all.png", LEFT, 0, 1, false}}; /* nobody knows where they were found */

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char name[32];
        const char *folder = NULL;
        cln_camera cameras[FORMAT_VIEWS];
        cln_point points[HERE + AWAY];
        cln_config config = *plain();
        cln_scene *scene = NULL;

        snprintf(name, sizeof name, "%d", (int)i);
        folder = scratch_path(*state, name);
        format_cameras(cameras);
        for (int k = 0; k < HERE; k++)
            points[k] = point_at(&cameras[0], 8 + k % 7, 2 + k / 7 % 8, 4 + 0.01 * k, 1);
        for (int k = 0; k < AWAY; k++)
            points[HERE + k] =
                point_at(&cameras[0], 2 + k % 3, 2 + k % 8, 300 + k, rows[i].far_views);
        format_images(scratch_path(folder, "images"), 1);
        format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points, HERE + AWAY);
        if (rows[i].mask)
            put_mask(folder, rows[i].mask, rows[i].from);
        config.downscale = rows[i].downscale;
        config.masks = CLN_MASKS_IGNORE;
        scene = load(folder, &config);
        if (!strstr(scene->bounds_rule, rows[i].dropped ? "120 sparse points that masks do not drop"
                                                        : "160 sparse points and"))
            fail_msg("row %d: %s", (int)i, scene->bounds_rule);
        if (rows[i].dropped != (scene->space.half < 20))
            fail_msg("row %d: half side %g", (int)i, scene->space.half);
        cln_scene_free(scene);
    }
}

int test_group_points_dropped(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_cube, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("points_dropped", tests, NULL, NULL);
}
