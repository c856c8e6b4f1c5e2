/* Readers of datasets. One scene of known cameras, written in every format (format_fixture.h), must
 * give the same rays. Then features of single formats: places of files, cubes.
 * test_masks.c tests masks, test_broken_formats.c broken datasets. */
#include "unit.h"
#include "format_fixture.h"
#include "tests.h"

/* Compares every view's rays, at the corners and inside, with those of the camera of its number. */
static void assert_same_rays(const cln_scene *scene, const cln_camera cameras[FORMAT_VIEWS],
                             double size, double bound)
{
    assert_int_equal(scene->view_count, FORMAT_VIEWS);
    for (int i = 0; i < FORMAT_VIEWS; i++) {
        const cln_view *view = &scene->views[i];
        const char *digits = strstr(view->name, "view_");
        const cln_camera *exact = &cameras[atoi(digits ? digits + 5 : "0")];

        assert_non_null(digits);
        for (int p = 0; p < 25; p++) {
            const double u = (p % 5) * 0.25 * exact->width, v = (p / 5) * 0.25 * exact->height;
            double o[3], d[3], origin[3], direction[3];

            assert_true(cln_camera_ray(exact, u, v, o, d));
            assert_true(cln_camera_ray(&view->camera, u * size, v * size, origin, direction));
            for (int k = 0; k < 3; k++)
                if (!(fabs(o[k] - origin[k]) <= bound && fabs(d[k] - direction[k]) <= bound))
                    fail_msg("%s %s at %g, %g: origin %g %g, direction %g %g", scene->dialect,
                             view->name, u, v, o[k], origin[k], d[k], direction[k]);
        }
    }
}

/* The same with a focal length per axis, another principal point, and a lens. */
static void bend(cln_camera cameras[FORMAT_VIEWS])
{
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        cln_camera *c = &cameras[v];

        c->fy = 21 + v;
        c->cx = 7.25;
        c->cy = 6.5 + 0.125 * v;
        c->k1 = -0.05;
        c->k2 = 0.01 * v;
        c->p1 = 0.002;
        c->p2 = -0.003;
    }
}

/* A text file of images with a comma behind each number before the name, as kapture writes it. */
static void put_commas(const char *path)
{
    char *text = NULL, with[16384];
    size_t bytes = 0, n = 0;
    int left = 0;

    assert_int_equal(cln_read_file(path, sizeof with / 2, &text, &bytes), CLN_OK);
    for (size_t i = 0; i < bytes; i++) {
        if (i == 0 || text[i - 1] == '\n')
            left = strchr(text + i, '.') && text[i] != '#' ? 9 : 0;
        if (text[i] == ' ' && left-- > 0)
            with[n++] = ',';
        with[n++] = text[i];
    }
    scratch_put(path, with, n);
    free(text);
}

static void test_colmap(void **state)
{
    static const struct {
        const char *model, *given; /* folders in the scratch folder */
        bool binary;
    } places[] = {
        {"a", "a", true},
        {"b/sparse", "b", true},
        {"c/sparse/0", "c", false},
        {"d/colmap/sparse/0", "d", true},
        {"e/sparse/0", "e/sparse/0", false},
        {"f/sparse/0", "f/sparse/0/", true},
    };
    cln_camera cameras[FORMAT_VIEWS];
    char folder[32];

    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        cln_scene *scene = NULL;

        format_cameras(cameras);
        if (i % 2)
            bend(cameras);
        snprintf(folder, sizeof folder, "%.1s/images", places[i].model);
        format_images(scratch_path(*state, folder), 1);
        format_colmap(scratch_path(*state, places[i].model), places[i].binary, cameras, NULL, NULL,
                      0);
        if (i == 2)
            put_commas(scratch_path(scratch_path(*state, places[i].model), "images.txt"));
        scene = load(scratch_path(*state, places[i].given), plain());
        assert_string_equal(scene->dialect, "COLMAP");
        /* the place as seen from the folder that was given */
        assert_non_null(strstr(
            scene->because, strncmp(places[i].model, places[i].given, strlen(places[i].model)) == 0
                                ? "the folder itself has"
                                : places[i].model + 2));
        assert_same_rays(scene, cameras, 1, 1e-9);
        for (int v = 0; v < FORMAT_VIEWS; v++)
            assert_int_equal(scene->views[v].pixels[0], 20 * v); /* each its own file */
        cln_scene_free(scene);
    }
}

/* Rigs and frames beside the three files, which newer versions write: images keep their own poses,
 * and nothing is said of the files. */
static void test_colmap_rigs(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    bend(cameras);
    for (int binary = 0; binary < 2; binary++) {
        const char *folder = scratch_path(*state, binary ? "binary" : "text");
        const char *model = scratch_path(folder, "sparse/0");
        cln_scene *scene = NULL;
        int warnings = 0;

        format_images(scratch_path(folder, "images"), 1);
        format_colmap(model, binary, cameras, NULL, NULL, 0);
        format_colmap_rigs(model, binary, cameras);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "COLMAP");
        assert_same_rays(scene, cameras, 1, 1e-9);
        assert_int_equal(warnings, 0);
        assert_int_equal(json_array_size(scene->ignored), 0);
        cln_scene_free(scene);
    }
}

static void test_transforms(void **state)
{
    static const char *const dialects[] = {"blender", "nerfstudio", "instant-ngp"};

    for (int i = 0; i < 3; i++) {
        const char *folder = scratch_path(*state, dialects[i]);
        cln_camera cameras[FORMAT_VIEWS];
        cln_scene *scene = NULL;

        format_cameras(cameras);
        if (i > 0)
            bend(cameras);
        for (int v = 1; v < FORMAT_VIEWS && i == 2; v++) { /* one lens for all */
            cln_camera own = cameras[0];

            memcpy(own.c2w, cameras[v].c2w, sizeof own.c2w);
            cameras[v] = own;
        }
        format_images(scratch_path(folder, "images"), 1);
        format_transforms(folder, dialects[i], cameras);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, dialects[i]);
        assert_same_rays(scene, cameras, 1, 1e-9);
        cln_scene_free(scene);
    }
}

/* The model's cameras have 16 x 12 pixels, the images other sizes. */
static void test_colmap_images(void **state)
{
    static const struct {
        const char *scene, *folders[3]; /* with images */
        int sizes[3], size;             /* of their images, and of the chosen one */
    } cases[] = {
        {"a", {"images_2", "images"}, {1, 2}, 2},
        {"b", {"images_8", "images_4"}, {1, 2}, 2},
        {"c", {"photos of 2019"}, {3}, 3},
        {"d", {"."}, {1}, 1},
    };
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].scene);
        cln_scene *scene = NULL;

        for (int k = 0; cases[i].folders[k]; k++)
            format_images(scratch_path(folder, cases[i].folders[k]), cases[i].sizes[k]);
        format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
        scene = load(folder, plain());
        assert_int_equal(scene->views[0].file_width, cases[i].size * FORMAT_WIDTH);
        assert_same_rays(scene, cameras, cases[i].size, 1e-9);
        cln_scene_free(scene);
    }
}

/* Keeps what is said of the choice of a folder. */
static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN && strstr(line, "images are taken from"))
        snprintf(user, 512, "%s", line);
}

/* Without a folder images: pictures of views that are no photos come last, then the number counts,
 * and what cannot be told is said. */
static void test_folders_beside_photos(void **state)
{
    static const struct {
        const char *folders[3]; /* with images, the first of which is chosen */
        int views[3];           /* 0: all */
        const char *warning;
    } cases[] = {
        {{"rgb", "masks", "Depth_maps"}, {0, 0, 0}, ""},
        {{"photos", "masks"}, {1, 0}, ""},
        {{"photos", "colour"}, {0, 1}, ""},
        {{"photos", "rgb", "masks"}, {0, 0, 0}, "'rgb' has as many"},
        {{"masks"}, {0}, "'masks', which is the name of a folder of masks"},
    };
    cln_config config = *plain();
    cln_camera cameras[FORMAT_VIEWS];

    config.missing = CLN_MISSING_SKIP;
    format_cameras(cameras);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int sfm = 0; sfm < 2; sfm++) {
            const char *folder = scratch_path(scratch_path(*state, sfm ? "s" : "c"),
                                              (const char[]){(char)('a' + i), 0});
            char warning[512] = "";
            const char *from = NULL;
            cln_scene *scene = NULL;

            for (int k = 0; k < 3 && cases[i].folders[k]; k++)
                for (int v = 0; v < (cases[i].views[k] ? cases[i].views[k] : FORMAT_VIEWS); v++) {
                    char name[64];

                    put_folder(folder, cases[i].folders[k]);
                    snprintf(name, sizeof name, "%s/view_%02d.png", cases[i].folders[k], v);
                    put_image(folder, name, FORMAT_WIDTH, FORMAT_HEIGHT, 3, v);
                }
            if (sfm)
                format_opensfm(folder, cameras, "perspective", NULL, 0);
            else
                format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
            cln_log_set_sink(keep_warning, warning);
            scene = load(folder, &config);
            from = strstr(scene->because, "images are from ") + 16;
            assert_int_equal(strcspn(from, ","), strlen(cases[i].folders[0])); /* masks follow */
            assert_memory_equal(from, cases[i].folders[0], strlen(cases[i].folders[0]));
            assert_true(warning[0] ? strstr(warning, cases[i].warning) && cases[i].warning[0]
                                   : !cases[i].warning[0]);
            cln_scene_free(scene);
            cln_log_set_sink(NULL, NULL);
        }
}

/* The log has the number of images without a pose. */
static void test_colmap_without_pose(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    int warnings = 0;

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse"), true, cameras, NULL, NULL, 0);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 0);
    put_image(folder, "images/more.png", 16, 12, 3, 0);
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 1);
}

/* Every camera model has its numbers in the right places in the reader, even if devices do not
 * trace its lens. */
static void test_colmap_models(void **state)
{
    static const format_model models[] = {
        {0, "SIMPLE_PINHOLE", 3, {20, 8, 6}},
        {1, "PINHOLE", 4, {20, 21, 8, 6}},
        {2, "SIMPLE_RADIAL", 4, {20, 8, 6, .01}},
        {3, "RADIAL", 5, {20, 8, 6, .01, .02}},
        {4, "OPENCV", 8, {20, 21, 8, 6, .01, .02, .03, .04}},
        {5, "OPENCV_FISHEYE", 8, {20, 21, 8, 6, .01, .02, .03, .04}},
        {6, "FULL_OPENCV", 12, {20, 21, 8, 6, .01, .02, .03, .04, .05, .06, .07, .08}},
        {7, "FOV", 5, {20, 21, 8, 6, .9}},
        {8, "SIMPLE_RADIAL_FISHEYE", 4, {20, 8, 6, .01}},
        {9, "RADIAL_FISHEYE", 5, {20, 8, 6, .01, .02}},
        {10, "THIN_PRISM_FISHEYE", 12, {20, 21, 8, 6, .01, .02, .03, .04, .05, .06, .07, .08}},
        {11,
         "RAD_TAN_THIN_PRISM_FISHEYE",
         16,
         {20, 21, 8, 6, .01, .02, .03, .04, .05, .06, .001, .002, .003, .004, .005, .006}},
        {12, "SIMPLE_DIVISION", 4, {20, 8, 6, .01}},
        {13, "DIVISION", 5, {20, 21, 8, 6, .01}},
        {14, "SIMPLE_FISHEYE", 3, {20, 8, 6}},
        {15, "FISHEYE", 4, {20, 21, 8, 6}},
        {16, "EUCM", 6, {20, 21, 8, 6, .5, 1.1}},
        {17, "EQUIRECTANGULAR", 2, {16, 12}},
    };
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    for (size_t i = 0; i < 2 * sizeof models / sizeof *models; i++) {
        const format_model *m = &models[i / 2];
        const bool two = m->count >= 4 && m->params[1] == 21, sphere = m->id == 17;
        const int lens_params = sphere ? 0 : m->count - 3 - two;
        const char *sub = scratch_path(folder, i % 2 ? "text" : "binary");
        cln_reader_result result = {0};

        format_colmap(sub, i % 2 == 0, cameras, m, NULL, 0);
        if (cln_reader_colmap.read(sub, &result) != CLN_OK)
            fail_msg("%s: %s", m->name, cln_error_text());
        for (int v = 0; v < result.view_count; v++) {
            const cln_camera *c = &result.views[v].camera;

            assert_int_equal(c->lens, cln_lens_find(m->name));
            assert_float_equal(c->fx, sphere ? 16 / 6.283185307179586 : 20, 1e-12);
            assert_float_equal(c->fy, sphere ? 12 / 3.141592653589793 : two ? 21 : 20, 1e-12);
            assert_float_equal(c->cx, 8, 0);
            assert_float_equal(c->cy, 6, 0);
            for (int k = 0; k < CLN_LENS_PARAMS; k++)
                assert_float_equal(c->distortion[k],
                                   k < lens_params ? m->params[m->count - lens_params + k] : 0, 0);
            free(result.views[v].name);
            free(result.views[v].path);
        }
        free(result.views);
        free(result.points);
        free(result.because);
    }
}

/* ---- the cube from points ---- */

/* A box of 4 x 2 x 1 around (1, 2, 3) on a grid, then `outliers` far away, in `views` images
 * each. */
static int make_points(cln_point points[1100], int outliers, int views)
{
    int count = 0;

    for (int i = 0; i < 1000; i++, count++) {
        const int x = i % 10, y = i / 10 % 10, z = i / 100;

        points[count] =
            (cln_point){{x / 9.0 * 4 - 1, y / 9.0 * 2 + 1, z / 9.0 + 2.5}, {1, 2, 3}, 4, 0};
    }
    for (int i = 0; i < outliers; i++, count++)
        points[count] = (cln_point){{1e6 * (i + 1), -1e5, 1e4 * i}, {0, 0, 0}, views, 0};
    return count;
}

static void test_cube_of_points(void **state)
{
    static const struct {
        int outliers, views;
    } cases[] = {{0, 0}, {8, 5}, {100, 2}};
    cln_point points[1100];
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();

    format_cameras(cameras);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, i == 0 ? "a" : i == 1 ? "b" : "c");
        const int count = make_points(points, cases[i].outliers, cases[i].views);
        const double centre[3] = {1, 2, 3}, half[3] = {2.4, 1.2, 0.6}; /* with a tenth of margin */
        cln_scene *scene = NULL;

        format_images(scratch_path(folder, "images"), 1);
        format_colmap(scratch_path(folder, "sparse/0"), i != 1, cameras, NULL, points, count);
        scene = load(folder, &config);
        assert_non_null(strstr(scene->bounds_rule, "sparse points"));
        for (int k = 0; k < 3; k++) {
            if (fabs(scene->space.centre[k] - centre[k]) > 0.5)
                fail_msg("case %zu: centre %g along %d", i, scene->space.centre[k], k);
            for (int sign = -1; sign <= 1; sign += 2)
                assert_true(fabs(centre[k] + sign * half[k] - scene->space.centre[k]) <=
                            scene->space.half + 1e-9);
        }
        assert_in_range((long)(1000 * scene->space.half), 2400, 3200); /* 2.4, and the images' */
        /* with a shell, as the reason says */
        assert_true(scene->space.shell);
        assert_non_null(strstr(scene->bounds_rule, "shell"));
        cln_scene_free(scene);
    }
    for (int i = 0; i < 4; i++) { /* with a box, by splatting, or on request: no shell */
        cln_scene *scene = NULL;

        config = *plain();
        if (i == 0)
            snprintf(config.bbox, sizeof config.bbox, "-1,0,2,3,4,4");
        config.stage1 = i == 1 ? CLN_STAGE1_SPLAT : CLN_STAGE1_GATHER;
        config.space = i == 2 ? CLN_SPACE_CUBE : i == 3 ? CLN_SPACE_SHELL : CLN_SPACE_AUTO;
        scene = load(scratch_path(*state, "c"), &config);
        assert_int_equal(scene->space.shell, i == 3);
        assert_int_equal(strstr(scene->bounds_rule, "shell") != NULL, i == 3);
        cln_scene_free(scene);
    }
    config = *plain();
    /* Three points are too few: the cameras decide, as without points. */
    format_colmap(scratch_path(*state, "a/sparse/0"), true, cameras, NULL, points, 3);
    cln_scene *scene = load(scratch_path(*state, "a"), &config);
    assert_non_null(strstr(scene->bounds_rule, "optical axes"));
    assert_true(scene->space.shell);
    cln_scene_free(scene);
}

/* nerfstudio's points give the same cube and shell; without the file, or without points, the
 * cameras decide; a box in the file has precedence. */
static void test_points_of_transforms(void **state)
{
    static const struct {
        const char *keys;
        const char *rule; /* of its choice */
        bool shell, points;
    } cases[] = {
        {"\"ply_file_path\": \"text.ply\",", "1008 sparse points", true, true},
        {"\"ply_file_path\": \"./binary.ply\",", "1008 sparse points", true, true},
        {"\"ply_file_path\": \"gone.ply\",", "optical axes", true, false},
        {"\"ply_file_path\": \"text.ply\", \"aabb_scale\": 4,", "aabb_scale 4", false, false},
        {"\"ply_file_path\": \"text.ply\", \"scale\": 1,", "1008 sparse points", true, true},
        {"\"scale\": 0.1,", "scale and offset in instant-ngp's unit box", false, false},
    };
    const char *folder = *state;
    cln_point points[1100];
    const int count = make_points(points, 8, 0);
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_ply(folder, "text.ply", false, points, count);
    format_ply(folder, "binary.ply", true, points, count);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        FILE *f = format_open(folder, "transforms.json");
        cln_scene *scene = NULL;
        int warnings = 0;

        fprintf(f, "{%s \"frames\": [", cases[i].keys);
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            const cln_camera *c = &cameras[v];

            fprintf(f, "%s{\"file_path\": \"images/view_%02d.png\", \"fl_x\": %.17g,", v ? "," : "",
                    v, c->fx);
            fprintf(f, "\"fl_y\": %.17g, \"cx\": %.17g, \"cy\": %.17g,", c->fy, c->cx, c->cy);
            fprintf(f, "\"transform_matrix\": [");
            for (int row = 0; row < 3; row++) /* OpenGL's axes */
                fprintf(f, "[%.17g,%.17g,%.17g,%.17g],", c->c2w[4 * row], -c->c2w[4 * row + 1],
                        -c->c2w[4 * row + 2], c->c2w[4 * row + 3]);
            fprintf(f, "[0,0,0,1]]}");
        }
        fprintf(f, "]}");
        fclose(f);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        if (!strstr(scene->bounds_rule, cases[i].rule))
            fail_msg("case %zu: %s", i, scene->bounds_rule);
        assert_int_equal(scene->space.shell, cases[i].shell);
        assert_int_equal(warnings, i == 2);
        if (cases[i].points)
            assert_in_range((long)(1000 * scene->space.half), 2400, 3200);
        cln_scene_free(scene);
    }
}

/* ---- LLFF, NeuS ---- */

static void test_llff(void **state)
{
    static const struct {
        const char *scene, *folders[3];
        int sizes[3], camera_size, size; /* of the cameras, and of the images read */
    } cases[] = {
        {"a", {"images", "images_4"}, {1, 2}, 1, 1},
        {"b", {"images_8", "images_4"}, {1, 2}, 4, 2},
    };
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].scene);
        double far_corner[3], o[3], d[3];
        cln_scene *scene = NULL;

        for (int k = 0; cases[i].folders[k]; k++)
            format_images(scratch_path(folder, cases[i].folders[k]), cases[i].sizes[k]);
        format_llff(folder, cameras, cases[i].camera_size, i == 1);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "LLFF");
        assert_same_rays(scene, cameras, cases[i].size, 1e-9);
        assert_float_equal(scene->views[3].near, 2, 0);
        assert_float_equal(scene->views[3].far, 9, 0);
        /* The cube holds what a corner shows at the far depth, 9 of view 3. */
        assert_non_null(strstr(scene->bounds_rule, "near and far"));
        assert_true(cln_camera_ray(&cameras[3], 0, 0, o, d));
        for (int a = 0; a < 3; a++) /* the corner is at (-8, -6) / 20 from the axis */
            far_corner[a] = o[a] + d[a] * 9 * sqrt(1 + 0.16 + 0.09);
        assert_true(cln_space_holds(&scene->space, far_corner));
        assert_in_range((long)scene->space.half, 6, 12);
        cln_scene_free(scene);
    }
}

static void test_neus(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        cameras[v].fy = 21 + v;
        cameras[v].cx = 7.25;
    }
    for (int deflate = 0; deflate < 2; deflate++) {
        const char *folder = scratch_path(*state, deflate ? "deflated" : "stored");
        cln_scene *scene = NULL;

        format_images(scratch_path(folder, "image"), 1);
        format_neus(folder, cameras, deflate);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "NeuS");
        assert_same_rays(scene, cameras, 1, 1e-9);
        assert_float_equal(scene->space.centre[0], 1, 0);
        assert_float_equal(scene->space.centre[1], 2, 0);
        assert_float_equal(scene->space.centre[2], 3, 0);
        assert_float_equal(scene->space.half, 2, 0);
        assert_false(scene->has_alpha);
        cln_scene_free(scene);
    }
}

/* ---- NSVF, OpenSfM ---- */

static void test_nsvf(void **state)
{
    static const struct {
        const char *scene, *prefixes;
        int splits[CLN_SPLITS];
    } cases[] = {
        {"a", "", {6, 0, 0}},
        {"b", "001122", {2, 2, 2}},
        {"c", "010010", {4, 0, 2}}, /* no 2_: 1_ is test */
        {"d", "000000", {6, 0, 0}},
    };
    static const double box[6] = {-1, 0, 1, 3, 4.5, 5};
    cln_camera cameras[FORMAT_VIEWS];

    for (int i = 0; i < 4; i++) {
        const char *folder = scratch_path(*state, cases[i].scene);
        cln_scene *scene = NULL;
        int warnings = 0;

        format_cameras(cameras);
        for (int v = 0; v < FORMAT_VIEWS && i; v++) { /* form 0 has one focal length */
            cameras[v].fy = 22;
            cameras[v].cx = 7.5;
        }
        format_nsvf(folder, cameras, cases[i].prefixes, i);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "NSVF");
        assert_same_rays(scene, cameras, 1, 1e-9);
        for (int s = 0; s < CLN_SPLITS; s++)
            assert_int_equal(cln_scene_split_count(scene, (cln_split)s), cases[i].splits[s]);
        assert_float_equal(scene->space.centre[1], 2.25, 0);
        assert_float_equal(scene->space.half, 2.25, 0);
        assert_true(scene->has_box); /* what --slab keeps */
        for (int k = 0; k < 6; k++)
            assert_float_equal(scene->box[k], box[k], 0);
        cln_scene_free(scene);
        assert_int_equal(warnings, 0);
        put_image(folder, "rgb/0_more.png", 16, 12, 3, 0); /* has no pose */
        scene = load(folder, plain());
        assert_int_equal(scene->view_count, FORMAT_VIEWS);
        assert_int_equal(warnings, 1);
        cln_scene_free(scene);
    }
}

static void test_opensfm(void **state)
{
    static const struct {
        const char *scene, *place, *type, *dialect;
    } cases[] = {
        {"a", "a", "perspective", "it has reconstruction.json"},
        {"b", "b", "brown", "it has reconstruction.json"},
        {"c", "c/opensfm", "brown", "it has opensfm/reconstruction.json"}, /* as ODM has it */
    };
    cln_camera cameras[FORMAT_VIEWS];
    cln_point points[1100];

    for (int i = 0; i < 3; i++) {
        const char *folder = scratch_path(*state, cases[i].scene);
        /* in the last one, those that two images show would be in the box if all were */
        const int count = i < 2 ? make_points(points, 8, 0) : make_points(points, 100, 2);
        cln_scene *scene = NULL;

        format_cameras(cameras);
        if (i)
            bend(cameras);
        else
            for (int v = 0; v < FORMAT_VIEWS; v++)
                cameras[v].k1 = -0.03;
        if (i == 1)
            cameras[1].fy = cameras[1].fx; /* which is left out of the file */
        format_images(scratch_path(folder, "images"), 1);
        format_opensfm(scratch_path(*state, cases[i].place), cameras, cases[i].type, points,
                       i ? count : 0);
        if (i == 2)
            format_opensfm_tracks(scratch_path(*state, cases[i].place), true, points, count);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "OpenSfM");
        assert_non_null(strstr(scene->because, cases[i].dialect));
        assert_same_rays(scene, cameras, 1, 1e-7);
        if (i) {
            assert_non_null(
                strstr(scene->bounds_rule, i < 2 ? "1008 sparse points" : "1100 sparse points"));
            assert_in_range((long)(1000 * scene->space.half), 2400, 3200);
        }
        assert_true(scene->space.shell);
        cln_scene_free(scene);
    }
    { /* its folder alone has the photos beside it */
        cln_scene *scene = load(scratch_path(*state, "c/opensfm"), plain());

        assert_same_rays(scene, cameras, 1, 1e-7);
        assert_non_null(strstr(scene->because, "tracks.csv"));
        cln_scene_free(scene);
    }
}

/* Of a portrait photo, too, c_x and c_y are in units of the longer side. */
static void test_portrait_opensfm(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    format_cameras(cameras);
    bend(cameras);
    put_folder(folder, "images");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[32];

        cameras[v].width = FORMAT_HEIGHT;
        cameras[v].height = FORMAT_WIDTH;
        snprintf(name, sizeof name, "images/view_%02d.png", v);
        put_image(folder, name, FORMAT_HEIGHT, FORMAT_WIDTH, 3, v);
    }
    format_opensfm(folder, cameras, "brown", NULL, 0);
    scene = load(folder, plain());
    assert_same_rays(scene, cameras, 1, 1e-7);
    cln_scene_free(scene);
}

/* Files of thousands of photos are larger than other JSON may be: this one is refused for its
 * contents, which are a hole of zeros. */
static void test_large_opensfm(void **state)
{
    const char *path = scratch_path(*state, "reconstruction.json");
    cln_scene *scene = NULL;

    scratch_put(path, "[", 1);
    assert_int_equal(truncate(path, 513 << 20), 0);
    assert_int_equal(try_load(*state, plain(), &scene), CLN_INPUT);
    if (!strstr(cln_error_text(), "reconstruction.json: line 1 column"))
        fail_msg("%s", cln_error_text());
    cln_clear_error();
}

/* A key that is read of frames alone, or of the document alone, is named if it is in the other. */
static void test_keys_elsewhere(void **state)
{
    static const char *const elsewhere[] = {"alpha_path", "transform_matrix", "near", "aabb_scale",
                                            "ply_file_path"};
    enum { ELSEWHERE = sizeof elsewhere / sizeof *elsewhere };
    const char *folder = *state;
    cln_scene *scene = NULL;

    format_images(folder, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"alpha_path\":\"m.png\",\"transform_matrix\":[],"
             "\"near\":1,\"frames\":[{\"aabb_scale\":4,\"ply_file_path\":\"p.ply\",\"near\":1,"
             "\"fl_x\":21,\"k1\":0,\"file_path\":\"view_00.png\",\"transform_matrix\":" POSE_FRONT
             "}," FRAME("view_01.png", POSE_FRONT) "]}");
    scene = load(folder, plain());
    assert_int_equal(json_array_size(scene->ignored), ELSEWHERE);
    for (size_t i = 0; i < ELSEWHERE; i++)
        assert_string_equal(json_string_value(json_array_get(scene->ignored, i)), elsewhere[i]);
    cln_scene_free(scene);
}

/* ---- --format ---- */

static void test_format(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    put_text(
        folder, "transforms.json",
        "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" FRAME("images/view_00.png", POSE_FRONT) "]}");
    scene = load(folder, &config); /* the first in order; the log names the other */
    assert_string_equal(scene->dialect, "instant-ngp");
    assert_non_null(strstr(scene->because, "--format colmap"));
    cln_scene_free(scene);
    config.format = CLN_FORMAT_COLMAP;
    scene = load(folder, &config);
    assert_string_equal(scene->dialect, "COLMAP");
    assert_null(strstr(scene->because, "--format"));
    cln_scene_free(scene);
    /* Missing: the sentence is only about that format. */
    assert_int_equal(remove(scratch_path(folder, "sparse/0/images.bin")), 0);
    assert_int_equal(try_load(folder, &config, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "not a scene of this --format"));
    assert_non_null(strstr(cln_error_text(), "cameras, but no images"));
    assert_non_null(strstr(cln_error_text(), "it is one of --format transforms; give that"));
    assert_null(strstr(cln_error_text(), "transforms reader"));
    cln_clear_error();
    /* The first one is broken: the sentence names the other. */
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    put_text(folder, "transforms.json", "{");
    config.format = CLN_FORMAT_AUTO;
    assert_int_equal(try_load(folder, &config, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "transforms.json: line 1"));
    assert_non_null(strstr(cln_error_text(), "--format colmap"));
    cln_clear_error();
}

int test_group_formats(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_colmap, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_rigs, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_transforms, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_images, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_folders_beside_photos, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_without_pose, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_models, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_cube_of_points, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_llff, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_neus, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_nsvf, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_opensfm, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_portrait_opensfm, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_large_opensfm, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_points_of_transforms, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_keys_elsewhere, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_format, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("formats", tests, NULL, NULL);
}
