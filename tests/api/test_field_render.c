/* Pictures in memory (cl_nascent.h: cln_field_render) against the files of cln_render for the same
 * poses, which have the same pixels: by every kind of lens, depth and leaf; over other backgrounds;
 * whatever was asked of the field before, also if that failed; refused cameras. */
#include "unit.h"
#include <signal.h>
#include <stdlib.h>
#include "io/npy.h"
#include "model/checkpoint.h"
#include "pipeline/pipeline.h"
#include "run_fixture.h"
#include "tests.h"

enum { FRAMES = 4, MOST = 40 * 32 };

/* Larger and smaller, of several lenses, from around the ball, the panorama from within. */
static const struct {
    int width, height;
    double yaw, distance;
    const char *lens;
    double k1, k2;
} frames[FRAMES] = {{24, 24, 0.4, 4, NULL, 0, 0},
                    {40, 32, 1.9, 4, "OPENCV", -0.2, 0.05},
                    {17, 31, 3.3, 3, "OPENCV_FISHEYE", 0.1, 0},
                    {32, 16, 4.0, 1.1, "EQUIRECTANGULAR", 0, 0}};

typedef struct arrays {
    float rgb[MOST][3], depth[MOST], opacity[MOST];
} arrays;

/* OpenGL's axes, as in transforms JSON. */
static void pose_of(int i, double m[3][4])
{
    fixture_pose(frames[i].yaw, 0.2, m);
    for (int a = 0; a < 3; a++)
        m[a][3] *= frames[i].distance / 4;
}

static cln_frame_desc frame_of(int i)
{
    cln_frame_desc frame = {.width = frames[i].width,
                            .height = frames[i].height,
                            .fx = 1.4 * frames[i].width,
                            .fy = 1.3 * frames[i].width,
                            .cx = 0.5 * frames[i].width + 0.3,
                            .cy = 0.45 * frames[i].height,
                            .lens = frames[i].lens,
                            .params = {frames[i].k1, frames[i].k2}};
    double m[3][4];

    pose_of(i, m);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 4; b++)
            frame.c2w[4 * a + b] = b == 1 || b == 2 ? -m[a][b] : m[a][b];
    return frame;
}

/* The same frames as a file of poses. */
static const char *write_poses(void)
{
    json_t *list = json_array(), *document = NULL;
    char name[32], *text = NULL;

    for (int i = 0; i < FRAMES; i++) {
        const cln_frame_desc f = frame_of(i);
        json_t *rows = json_array(), *frame = NULL;
        double m[3][4];

        pose_of(i, m);
        for (int a = 0; a < 3; a++)
            json_array_append_new(rows, json_pack("[f,f,f,f]", m[a][0], m[a][1], m[a][2], m[a][3]));
        json_array_append_new(rows, json_pack("[i,i,i,i]", 0, 0, 0, 1));
        snprintf(name, sizeof name, "f%d.png", i);
        frame = json_pack("{s:s, s:o, s:i, s:i}", "file_path", name, "transform_matrix", rows, "w",
                          f.width, "h", f.height);
        if (f.lens)
            json_object_set_new(frame, "camera_model", json_string(f.lens));
        if (!f.lens || strcmp(f.lens, "EQUIRECTANGULAR") != 0) {
            json_object_set_new(frame, "fl_x", json_real(f.fx));
            json_object_set_new(frame, "fl_y", json_real(f.fy));
            json_object_set_new(frame, "cx", json_real(f.cx));
            json_object_set_new(frame, "cy", json_real(f.cy));
            json_object_set_new(frame, "k1", json_real(f.params[0]));
            json_object_set_new(frame, "k2", json_real(f.params[1]));
        }
        json_array_append_new(list, frame);
    }
    document = json_pack("{s:o}", "frames", list);
    text = json_dumps(document, JSON_REAL_PRECISION(17));
    scratch_put(fixture_path("poses.json"), text, strlen(text));
    free(text);
    json_decref(document);
    return fixture_path("poses.json");
}

/* Fills arrays with what no picture has, so that pixels that are not written show. */
static void render(cln_field *field, const cln_frame_desc *frame, arrays *out)
{
    for (int i = 0; i < MOST; i++)
        out->rgb[i][0] = out->rgb[i][1] = out->rgb[i][2] = out->depth[i] = out->opacity[i] = -7;
    assert_ok(cln_field_render(field, frame, out->rgb[0], out->depth, out->opacity));
}

static void assert_same(const arrays *a, const arrays *b)
{
    assert_memory_equal(a, b, sizeof *a);
}

/* Frame i is the one in the folder; both were made with the same choices. */
static void compare(const char *folder, int i, const arrays *got)
{
    const int n = frames[i].width * frames[i].height;
    int width = 0, height = 0, channels = 0, dims = 0, shape[4], seen = 0;
    uint8_t *colour = NULL, *opacity = NULL;
    float *depth = NULL;
    char name[64];

    snprintf(name, sizeof name, "%s/f%d.png", folder, i);
    assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &colour));
    assert_true(width == frames[i].width && height == frames[i].height && channels == 3);
    snprintf(name, sizeof name, "%s/f%d.opacity.png", folder, i);
    assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &opacity));
    snprintf(name, sizeof name, "%s/f%d.depth.npy", folder, i);
    assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &depth));
    for (int k = 0; k < n; k++) {
        for (int c = 0; c < 3; c++)
            assert_int_equal(cln_to_u8(got->rgb[k][c]), colour[3 * k + c]);
        assert_int_equal(cln_to_u8(got->opacity[k]), opacity[channels * k]);
        assert_true(got->depth[k] == depth[k]);
        seen += got->opacity[k] > 0.5f;
    }
    assert_true(seen > 20);
    for (int k = n; k < MOST; k++) /* nothing is written beyond the picture */
        assert_true(got->rgb[k][2] == -7 && got->depth[k] == -7 && got->opacity[k] == -7);
    free(colour);
    free(opacity);
    free(depth);
}

/* All frames by one field, with these choices, and as files. */
static void check_frames(const char *run, cln_field *field, const cln_frame_desc *choices)
{
    static arrays got;
    static int number;
    char folder[32];
    cln_render_result result;
    cln_render_desc desc = {.run = fixture_path(run),
                            .poses = fixture_path("poses.json"),
                            .antialias = choices->antialias,
                            .z_depth = choices->z_depth,
                            .mean_depth = choices->mean_depth,
                            .device = fixture_device()};

    snprintf(folder, sizeof folder, "files %d", number++);
    desc.out = fixture_path(folder);
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, FRAMES);
    for (int i = 0; i < FRAMES; i++) {
        cln_frame_desc frame = frame_of(i);

        frame.antialias = choices->antialias;
        frame.z_depth = choices->z_depth;
        frame.mean_depth = choices->mean_depth;
        render(field, &frame, &got);
        compare(folder, i, &got);
    }
}

/* The run "whole" with projected samples as its stage 1, whose lists depend on a picture's size. */
static const char *make_splatted(void)
{
    json_t *document = fixture_json("whole/run.json");
    cln_model model = {0};

    assert_ok(cln_checkpoint_read(fixture_path("whole"), true, &model));
    model.config.stage1 = CLN_STAGE1_SPLAT;
    assert_ok(cln_make_dirs(fixture_path("splatted")));
    assert_ok(cln_run_write(fixture_path("splatted"), document));
    json_decref(document);
    assert_ok(cln_checkpoint_write(fixture_path("splatted"), &model));
    cln_model_free(&model);
    return "splatted";
}

static void test_as_files(void **state)
{
    static const cln_frame_desc choices[] = {
        {.antialias = 0}, {.antialias = 2, .z_depth = true}, {.mean_depth = true}};
    const cln_device_desc device = fixture_device();
    cln_field *field = NULL;

    NEED_DEVICE();
    write_poses();
    assert_ok(cln_field_open(fixture_path("whole"), &device, &field));
    for (size_t i = 0; i < sizeof choices / sizeof *choices; i++)
        check_frames("whole", field, &choices[i]);
    cln_field_close(field);
    assert_ok(cln_field_open(fixture_path(make_splatted()), &device, &field));
    check_frames("splatted", field, &choices[1]);
    cln_field_close(field);
}

static void test_voxels_as_files(void **state)
{
    cln_config config = fixture_voxels();
    const cln_device_desc device = fixture_device();
    cln_field *field = NULL;

    NEED_DEVICE();
    config.steps = 40;
    write_poses();
    assert_ok(fixture_train("voxels", false, &config, NULL, &(cln_train_result){0}));
    assert_ok(cln_field_open(fixture_path("voxels"), &device, &field));
    check_frames("voxels", field, &(cln_frame_desc){.z_depth = true});
    cln_field_close(field);
}

/* What is over the background is the same over any; the run's own is white. */
static void test_backgrounds(void **state)
{
    static arrays own, over[2];
    static const float colours[2][3] = {{0, 0, 0}, {1, 0.5f, 0.25f}};
    const cln_device_desc device = fixture_device();
    cln_frame_desc frame = frame_of(0);
    cln_field *field = NULL;

    NEED_DEVICE();
    assert_ok(cln_field_open(fixture_path("whole"), &device, &field));
    render(field, &frame, &own);
    for (int i = 0; i < 2; i++) {
        frame.background = colours[i];
        render(field, &frame, &over[i]);
        assert_memory_equal(over[i].depth, own.depth, sizeof own.depth);
        assert_memory_equal(over[i].opacity, own.opacity, sizeof own.opacity);
    }
    for (int k = 0; k < frame.width * frame.height; k++)
        for (int c = 0; c < 3; c++) {
            const double behind = 1 - (double)own.opacity[k], black = (double)over[0].rgb[k][c];

            assert_true(fabs(own.rgb[k][c] - (black + behind)) < 1e-5);
            assert_true(fabs(over[1].rgb[k][c] - (black + behind * colours[1][c])) < 1e-5);
        }
    cln_field_close(field);
}

static int stop_at_once(void *user)
{
    (void)user;
    return SIGTERM;
}

/* A picture does not depend on what was asked for before, or beside it. */
static void test_again_and_in_part(void **state)
{
    static arrays first[FRAMES], again, part;
    const cln_device_desc device = fixture_device();
    const double at[1][3] = {{0, 0, 0.9}};
    float sigma[2];
    cln_field *field = NULL;

    NEED_DEVICE();
    assert_ok(cln_field_open(fixture_path("whole"), &device, &field));
    assert_ok(cln_field_at(field, 1, at, NULL, NULL, &sigma[0]));
    for (int i = 0; i < FRAMES; i++) {
        const cln_frame_desc frame = frame_of(i);

        render(field, &frame, &first[i]);
        assert_ok(cln_field_at(field, 1, at, NULL, NULL, &sigma[1]));
        assert_true(sigma[0] == sigma[1]);
    }
    for (int i = FRAMES - 1; i >= 0; i--) {
        cln_frame_desc frame = frame_of(i);

        part = first[i];
        memset(part.rgb, 0, sizeof part.rgb);
        assert_ok(cln_field_render(field, &frame, part.rgb[0], NULL, NULL));
        assert_memory_equal(part.rgb, first[i].rgb,
                            (size_t)(frame.width * frame.height) * sizeof *part.rgb);
        memset(part.depth, 0, sizeof part.depth);
        assert_ok(cln_field_render(field, &frame, NULL, part.depth, NULL));
        memset(part.opacity, 0, sizeof part.opacity);
        assert_ok(cln_field_render(field, &frame, NULL, NULL, part.opacity));
        assert_memory_equal(part.depth, first[i].depth,
                            (size_t)(frame.width * frame.height) * sizeof *part.depth);
        assert_memory_equal(part.opacity, first[i].opacity,
                            (size_t)(frame.width * frame.height) * sizeof *part.opacity);
        assert_ok(cln_field_render(field, &frame, NULL, NULL, NULL));
        frame.callbacks.interrupted = stop_at_once;
        assert_fails(cln_field_render(field, &frame, part.rgb[0], NULL, NULL), CLN_SIGTERM, "");
        frame.callbacks.interrupted = NULL;
        render(field, &frame, &again);
        assert_same(&again, &first[i]);
    }
    cln_field_close(field);
}

/* A field that cannot build a lens, or has no memory for a large picture, still has the others. */
static void test_after_failures(void **state)
{
    static arrays first, again;
    cln_device_desc device = fixture_device();
    cln_frame_desc frame = frame_of(0), lens = frame_of(2), large = frame_of(0);
    cln_config config = fixture_config();
    cln_field *field = NULL;

    NEED_DEVICE();
    device.kernel_dir = fixture_kernels_changed("no lenses", "lens.h", "#if LENSES",
                                                "#if LENSES\n#error no lenses\n#endif\n#if LENSES");
    config.steps = 1;
    config.host_mem = 600.0 * (1 << 20);
    assert_ok(fixture_train("frugal", false, &config, NULL, &(cln_train_result){0}));
    assert_ok(cln_field_open(fixture_path("frugal"), &device, &field));
    render(field, &frame, &first);
    assert_fails(cln_field_render(field, &lens, again.rgb[0], NULL, NULL), CLN_BUILD, "rays");
    render(field, &frame, &again);
    assert_same(&again, &first);
    large.width = large.height = 4000; /* 320 MB of pictures alone */
    large.fx = large.fy = 4000;
    assert_fails(cln_field_render(field, &large, NULL, NULL, NULL), CLN_MEMORY,
                 "batches and pictures");
    render(field, &frame, &again);
    assert_same(&again, &first);
    cln_field_close(field);
}

/* Only programs with the code of lenses are built again for another one: these call for it. */
static void test_programs_with_lenses(void **state)
{
    static const char *const calls[] = {"pixel_ray(",      "point_pixel(",    "camera_ray(",
                                        "camera_project(", "lens_undistort(", "lens_distort("};
    static const char *const files[] = {
#define X(member, file, text, when) #file,
        CLN_PROGRAM_LIST(X)
#undef X
    };

    (void)state;
    if (!cln_is_file("kernels/lens.h"))
        skip();
    for (int i = 0; i < CLN_PROGRAMS; i++) {
        char path[64], *text = NULL;
        size_t bytes = 0;
        bool sees = false;

        snprintf(path, sizeof path, "kernels/%s.cl", files[i]);
        assert_ok(cln_read_file(path, (size_t)1 << 20, &text, &bytes));
        for (size_t k = 0; k < sizeof calls / sizeof *calls; k++)
            sees |= strstr(text, calls[k]) != NULL;
        if (sees != (CLN_PROGRAMS_SEEING >> i & 1))
            fail_msg("%s %s of CLN_PROGRAMS_SEEING", path, sees ? "is not" : "is one");
        free(text);
    }
}

static void test_refuses(void **state)
{
    static const float bright[3] = {0, 1.5f, 0};
    static arrays out;
    const cln_device_desc device = fixture_device();
    cln_field *field = NULL;
    const struct {
        const char *words;
        size_t at;
        double number;
    } numbers[] = {
        {"fx is 0;", offsetof(cln_frame_desc, fx), 0},
        {"fy is nan;", offsetof(cln_frame_desc, fy), NAN},
        {"cx is inf;", offsetof(cln_frame_desc, cx), INFINITY},
        {"cy is 1000000000;", offsetof(cln_frame_desc, cy), 1e9},
        {"c2w[7] is nan;", offsetof(cln_frame_desc, c2w) + 7 * sizeof(double), NAN},
        {"c2w: the pose is not rigid", offsetof(cln_frame_desc, c2w) + 5 * sizeof(double), 0.25},
        {"params[0] is 1; give 0 to 0", offsetof(cln_frame_desc, params), 1},
    };
    const struct {
        const char *words;
        size_t at;
        int number;
    } counts[] = {
        {"width is 0;", offsetof(cln_frame_desc, width), 0},
        {"height is -3;", offsetof(cln_frame_desc, height), -3},
        {"height is 131073;", offsetof(cln_frame_desc, height), (1 << 17) + 1},
        {"antialias is 9;", offsetof(cln_frame_desc, antialias), 9},
    };
    cln_frame_desc frame = frame_of(0);

    NEED_DEVICE();
    assert_ok(cln_field_open(fixture_path("whole"), &device, &field));
    assert_fails(cln_field_render(NULL, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                 "cln_field_render: field is missing");
    assert_fails(cln_field_render(field, NULL, out.rgb[0], NULL, NULL), CLN_USAGE,
                 "cln_field_render: frame is missing");
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        frame = frame_of(0);
        memcpy((char *)&frame + numbers[i].at, &numbers[i].number, sizeof numbers[i].number);
        assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                     numbers[i].words);
    }
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        frame = frame_of(0);
        memcpy((char *)&frame + counts[i].at, &counts[i].number, sizeof counts[i].number);
        assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                     counts[i].words);
    }
    frame = frame_of(0);
    frame.width = frame.height = 1 << 15;
    assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                 "width x height is 1073741824;");
    frame = frame_of(0);
    frame.background = bright;
    assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                 "background is 1.5;");
    frame = frame_of(2);
    frame.lens = "FISHY";
    assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE, "'FISHY'");
    frame.lens = "FOV"; /* has one parameter */
    frame.params[1] = 1;
    assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE, "params[1]");
    frame.params[1] = 0;
    frame.params[0] = 4;
    assert_fails(cln_field_render(field, &frame, out.rgb[0], NULL, NULL), CLN_USAGE,
                 "no meaning with these params");
    cln_field_close(field);
}

int test_group_field_render(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_as_files),       cmocka_unit_test(test_voxels_as_files),
        cmocka_unit_test(test_backgrounds),    cmocka_unit_test(test_again_and_in_part),
        cmocka_unit_test(test_after_failures), cmocka_unit_test(test_programs_with_lenses),
        cmocka_unit_test(test_refuses),
    };

    return cmocka_run_group_tests_name("field_render", tests, fixture_setup, fixture_teardown);
}
