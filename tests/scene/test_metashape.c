/* Cameras of Metashape (scene/reader_metashape.c): poses and places in the picture against the
 * formulas of Metashape's manual; local coordinates, and those on the earth; what is left out; the
 * region; what is refused. */
#include "unit.h"
#include "format_fixture.h"
#include "near.h"
#include "tests.h"

#ifdef CLN_WITH_EXPAT

static const double turn_z[9] = {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1};
static const double shift[3] = {10, -20, 5};
static const double scale = 2.5;

/* What the chunk's coordinates are of a scene's, by scale, turn_z and shift. */
static void to_chunk(const cln_camera *c, double pose[12])
{
    for (int i = 0; i < 3; i++) {
        pose[4 * i + 3] = 0;
        for (int j = 0; j < 3; j++)
            pose[4 * i + j] = 0;
        for (int k = 0; k < 3; k++) {
            for (int j = 0; j < 3; j++)
                pose[4 * i + j] += turn_z[3 * k + i] * c->c2w[4 * k + j];
            pose[4 * i + 3] += turn_z[3 * k + i] * (c->c2w[4 * k + 3] - shift[k]) / scale;
        }
    }
}

static const char lens[] = "<f>20</f><cx>-0.75</cx><cy>0.5</cy><k1>-0.05</k1><k2>0.01</k2>"
                           "<k3>0.002</k3><p1>0.002</p1><p2>-0.003</p2><b1>0.5</b1>";

/* cameras.xml: two sensors; the cameras; one that is not aligned, one that is disabled and one of
 * another component; a region with sides 2, 4 and 6 about (1, 2, 3) of the chunk. */
static void put_cameras(const char *folder, const cln_camera *cameras, const char *transform,
                        const char *reference, const char *type, const char *calibration)
{
    static const char region[] = "<region><center>1 2 3</center><size>2 4 6</size>"
                                 "<R>1 0 0 0 1 0 0 0 1</R></region>";
    const bool of_component = strcmp(type, "fisheye") == 0; /* as newer ones have it */
    FILE *f = format_open(folder, "cameras.xml");

    fprintf(f, "<?xml version=\"1.0\"?>\n<document><chunk label=\"none\"><cameras>"
               "<camera id=\"0\" sensor_id=\"0\" label=\"other\"/></cameras></chunk>\n"
               "<chunk label=\"one\" enabled=\"true\"><sensors next_id=\"2\">\n");
    for (int s = 0; s < 2; s++)
        fprintf(f,
                "<sensor id=\"%d\" label=\"A &amp; B\" type=\"%s\"><resolution width=\"%d\" "
                "height=\"%d\"/><calibration type=\"frame\" class=\"initial\"><f>3</f><k4>1</k4>"
                "</calibration><calibration class=\"adjusted\"><resolution width=\"1\" "
                "height=\"1\"/>%s</calibration></sensor>\n",
                s, type, FORMAT_WIDTH, FORMAT_HEIGHT, calibration);
    fprintf(f,
            "</sensors><components><component id=\"0\"><transform>%s</transform>%s</component>"
            "<component id=\"1\"><region><center>9 9 9</center><size>1 1 1</size>"
            "<R>1 0 0 0 1 0 0 0 1</R></region></component></components><cameras>\n",
            transform, of_component ? region : "");
    for (int v = 0; v < FORMAT_VIEWS + 3; v++) {
        double pose[12];

        to_chunk(&cameras[v % FORMAT_VIEWS], pose);
        fprintf(f, "%s<camera id=\"%d\" sensor_id=\"%d\" component_id=\"%d\" label=\"%s%02d%s\"%s>",
                v == 3 ? "<group>" : "", v, v % 2, v == FORMAT_VIEWS + 2,
                v < FORMAT_VIEWS ? "view_" : "else_", v, v % 2 ? "" : ".png",
                v == FORMAT_VIEWS + 1 ? " enabled=\"false\"" : "");
        for (int i = 0; i < 12 && v != FORMAT_VIEWS; i++)
            fprintf(f, "%s%.17g", i ? " " : "<transform>", pose[i]);
        fprintf(f, "%s<reference x=\"1\"/></camera>%s\n",
                v != FORMAT_VIEWS ? " 0 0 0 1</transform>" : "", v == 4 ? "</group>" : "");
    }
    fprintf(f, "</cameras><reference>%s</reference>%s</chunk></document>\n", reference,
            of_component ? "" : region);
    fclose(f);
}

/* Where the manual has a direction. */
static void by_the_manual(bool fisheye, const double d[3], double at[2])
{
    const double f = 20, b1 = 0.5, k[3] = {-0.05, 0.01, 0.002}, p[2] = {0.002, -0.003};
    double x = d[0] / d[2], y = d[1] / d[2], r2 = x * x + y * y, radial = 1;

    if (fisheye) {
        const double angle = atan(sqrt(r2)) / sqrt(r2);

        x *= angle;
        y *= angle;
        r2 = x * x + y * y;
    }
    radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
    at[0] = 0.5 * FORMAT_WIDTH - 0.75 +
            (x * radial + p[0] * (r2 + 2 * x * x) + 2 * p[1] * x * y) * (f + b1);
    at[1] =
        0.5 * FORMAT_HEIGHT + 0.5 + (y * radial + p[1] * (r2 + 2 * y * y) + 2 * p[0] * x * y) * f;
}

static void assert_lens(const cln_camera *c, bool fisheye)
{
    static const double directions[][3] = {{0.1, 0.2, 1}, {-0.3, 0.15, 1}, {0.2, -0.25, 0.9}};

    for (size_t i = 0; i < sizeof directions / sizeof *directions; i++) {
        double point[3], at[2], u, v, z;

        for (int a = 0; a < 3; a++)
            point[a] = c->c2w[4 * a + 3] + c->c2w[4 * a] * directions[i][0] +
                       c->c2w[4 * a + 1] * directions[i][1] + c->c2w[4 * a + 2] * directions[i][2];
        by_the_manual(fisheye, directions[i], at);
        assert_true(cln_camera_project(c, point, &u, &v, &z));
        assert_near(u, at[0], 1e-9);
        assert_near(v, at[1], 1e-9);
    }
}

enum { WARNINGS = 4096 };

static char *transform_of(const double turn[9], const double to[3])
{
    static char text[1024];
    size_t used = (size_t)snprintf(text, sizeof text, "<rotation locked=\"true\">");

    for (int i = 0; i < 12; i++)
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%.17g",
                                 i == 9 ? "</rotation><translation>" : " ",
                                 i < 9 ? turn[i] : to[i - 9]);
    snprintf(text + used, sizeof text - used, "</translation><scale>%.17g</scale>", scale);
    return text;
}

static void keep_warnings(cln_log_level level, const char *line, void *user)
{
    const size_t used = strlen(user);

    if (level == CLN_LOG_WARN)
        snprintf((char *)user + used, WARNINGS - used, "%s", line);
}

static void test_local(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    char warnings[WARNINGS] = "";

    format_cameras(cameras);
    format_images(scratch_path(folder, "photos"), 1);
    for (int fisheye = 0; fisheye < 2; fisheye++) {
        cln_scene *scene = NULL;

        put_cameras(folder, cameras, transform_of(turn_z, shift),
                    "LOCAL_CS[\"Local\",UNIT[\"metre\",1]]"
                    "</reference><transform><scale>7</scale></transform><reference>", /* chunk's */
                    fisheye ? "fisheye" : "frame", lens);
        cln_log_set_sink(keep_warnings, warnings);
        scene = load(fisheye ? scratch_path(folder, "cameras.xml") : folder, plain());
        cln_log_set_sink(NULL, NULL);
        assert_string_equal(scene->dialect, "Metashape");
        assert_non_null(strstr(scene->because, "local ones"));
        assert_int_equal(scene->view_count, FORMAT_VIEWS);
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            const cln_view *view = &scene->views[v];
            const int number = atoi(view->name + 5);

            for (int i = 0; i < 12; i++)
                assert_near(view->camera.c2w[i], cameras[number].c2w[i], 1e-9);
            assert_lens(&view->camera, fisheye);
        }
        /* 0.8 and 0.6 of the chunk's centre and sides, times 2.5 */
        assert_near(scene->space.centre[0], 10 + 2.5 * (0.8 * 1 - 0.6 * 2), 1e-9);
        assert_near(scene->space.centre[1], -20 + 2.5 * (0.6 * 1 + 0.8 * 2), 1e-9);
        assert_near(scene->space.centre[2], 5 + 2.5 * 3, 1e-9);
        assert_near(scene->box[5] - scene->box[2], 2.5 * 6, 1e-9);
        assert_near(scene->box[3] - scene->box[0], 2.5 * (0.8 * 2 + 0.6 * 4), 1e-9);
        cln_scene_free(scene);
    }
    assert_non_null(strstr(warnings, "2 of its 9 cameras are not aligned, or disabled"));
    assert_non_null(strstr(warnings, "1 camera is of other components"));
}

/* A chunk whose own z is up, on the earth at this latitude and longitude (degrees): the scene is
 * the chunk, scaled, about the middle of the cameras, whose place is told. */
static void check_on_earth(const char *folder, double latitude, double longitude)
{
    const double a = 6378137, b = 6356752.314245, lat = latitude * M_PI / 180,
                 lon = longitude * M_PI / 180;
    const double n = a * a / sqrt(pow(a * cos(lat), 2) + pow(b * sin(lat), 2));
    const double origin[3] = {n * cos(lat) * cos(lon), n * cos(lat) * sin(lon),
                              b * b / (a * a) * n * sin(lat)};
    const double east_north_up[9] = {-sin(lon),
                                     -sin(lat) * cos(lon),
                                     cos(lat) * cos(lon),
                                     cos(lon),
                                     -sin(lat) * sin(lon),
                                     cos(lat) * sin(lon),
                                     0,
                                     cos(lat),
                                     sin(lat)};
    cln_camera cameras[FORMAT_VIEWS];
    double middle[3] = {0}, told[3], across = 0, place[3];
    char reference[3000] = "";
    const char *words = NULL;
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_images(scratch_path(folder, "photos"), 1);
    memset(reference, 'x', sizeof reference - 1); /* as long as some are */
    memcpy(reference, "PROJCS[", 7);
    put_cameras(folder, cameras, transform_of(east_north_up, origin), reference, "frame", lens);
    scene = load(folder, plain());
    words = strstr(scene->because, "metres east, north and up");
    assert_non_null(words);
    assert_int_equal(sscanf(strstr(words, "latitude"), "latitude %lf, longitude %lf, height %lf",
                            &told[0], &told[1], &told[2]),
                     3);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        double pose[12];

        to_chunk(&cameras[v], pose);
        for (int i = 0; i < 3; i++)
            middle[i] += scale * pose[4 * i + 3] / FORMAT_VIEWS;
    }
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        double pose[12];

        to_chunk(&cameras[atoi(scene->views[v].name + 5)], pose);
        for (int i = 0; i < 3; i++) {
            for (int k = 0; k < 3; k++)
                assert_near(scene->views[v].camera.c2w[4 * i + k], pose[4 * i + k], 1e-5);
            assert_near(scene->views[v].camera.c2w[4 * i + 3], scale * pose[4 * i + 3] - middle[i],
                        1e-3);
        }
    }
    told[0] *= M_PI / 180;
    told[1] *= M_PI / 180;
    across = a * a / sqrt(pow(a * cos(told[0]), 2) + pow(b * sin(told[0]), 2));
    place[0] = (across + told[2]) * cos(told[0]) * cos(told[1]);
    place[1] = (across + told[2]) * cos(told[0]) * sin(told[1]);
    place[2] = (b * b / (a * a) * across + told[2]) * sin(told[0]);
    for (int i = 0; i < 3; i++)
        assert_near(place[i],
                    origin[i] + east_north_up[3 * i] * middle[0] +
                        east_north_up[3 * i + 1] * middle[1] + east_north_up[3 * i + 2] * middle[2],
                    2e-3);
    cln_scene_free(scene);
}

static void test_on_earth(void **state)
{
    check_on_earth(*state, 48, 11);
    check_on_earth(*state, -12, -170);
}

/* Photos in a folder beside that of the file: as it has them all; one that is called like one of
 * them may be another's. */
static void test_photos_beside(void **state)
{
    const char *folder = scratch_path(*state, "export");
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;
    char path[128];

    format_cameras(cameras);
    put_cameras(folder, cameras, "", "", "frame", lens);
    put_folder(*state, "old");
    put_image(*state, "old/view_01.png", FORMAT_WIDTH, FORMAT_HEIGHT, 3, 1);
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "none of its 6 images"));
    cln_clear_error();
    put_image(*state, "old/view_02.png", FORMAT_WIDTH, FORMAT_HEIGHT, 3, 1);
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "none of its 6 images"));
    cln_clear_error();
    put_image(*state, "old/view_03.png", FORMAT_WIDTH, FORMAT_HEIGHT, 3, 1);
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "3 of 6 images are not there")); /* it is theirs */
    cln_clear_error();
    format_images(scratch_path(*state, "DCIM"), 1);
    scene = load(folder, plain());
    assert_int_equal(scene->view_count, FORMAT_VIEWS);
    snprintf(path, sizeof path, "%s/../DCIM/view_01.png", folder);
    assert_string_equal(scene->views[1].path, path);
    cln_scene_free(scene);
}

static void test_refused(void **state)
{
    static const struct {
        const char *type, *calibration, *words;
    } rows[] = {
        {"frame", "<f>20</f><p3>0.1</p3>", "p3 or p4"},
        {"frame", "<k1>0.1</k1>", "no focal length"},
        {"frame", "<f>20 21</f>", "more numbers than belong there"},
        {"frame", "<f>nan</f>", "not the finite numbers"},
        {"frame", "<f></f>", "not the finite numbers"},
        {"frame", "<f>20</g>", "mismatched tag; export the cameras again"},
        {"cylindrical", "<f>20</f>", "neither of type frame"},
    };
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_images(scratch_path(folder, "photos"), 1);
    put_cameras(folder, cameras, "", "", "frame", "<f>20</f><k1>-0.1</k1><k4>0.1</k4>");
    scene = load(folder, plain()); /* a fourth term is not, as a quotient is near it */
    assert_int_equal(scene->views[0].camera.lens, CLN_LENS_FULL_OPENCV);
    cln_scene_free(scene);
    /* the adjusted calibration counts, also where the initial one follows it */
    put_cameras(folder, cameras, "", "", "frame",
                "<f>20</f><k1>-0.1</k1></calibration><calibration class=\"initial\"><f>3</f>");
    scene = load(folder, plain());
    assert_true(scene->views[0].camera.fx == 20 && scene->views[0].camera.k1 == -0.1);
    cln_scene_free(scene);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        put_cameras(folder, cameras, "", "", rows[i].type, rows[i].calibration);
        assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
        if (!strstr(cln_error_text(), rows[i].words))
            fail_msg("'%s' is not in '%s'", rows[i].words, cln_error_text());
        cln_clear_error();
    }
    put_text(folder, "cameras.xml",
             "<document><chunk><cameras><camera id=\"0\" label=\"view_00\"/></cameras></chunk>"
             "</document>");
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "none of its cameras is aligned"));
    cln_clear_error();
}

#else

static void test_without_expat(void **state)
{
    const char *folder = *state;
    cln_scene *scene = NULL;

    put_text(folder, "cameras.xml", "<document><chunk></chunk></document>");
    assert_int_equal(try_load(folder, NULL, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "built without expat"));
    cln_clear_error();
}

#endif

int test_group_metashape(void)
{
    const struct CMUnitTest tests[] = {
#ifdef CLN_WITH_EXPAT
        cmocka_unit_test_setup_teardown(test_local, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_on_earth, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_photos_beside, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refused, scratch_make, scratch_remove),
#else
        cmocka_unit_test_setup_teardown(test_without_expat, scratch_make, scratch_remove),
#endif
    };

    return cmocka_run_group_tests_name("metashape", tests, NULL, NULL);
}
