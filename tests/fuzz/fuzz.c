/* Fuzz targets: every reader of bytes from outside, in one program. The name that it is called by
 * (a link) chooses the target; `NAME --seeds FOLDER` writes the target's good inputs instead.
 * Linked with libFuzzer (make fuzz) or with alone.c, which replays a corpus (make test).
 *
 * An input is the contents of the target's file; if it has several files, a first byte '0', '1' or
 * so on says which of them, and the others are good. Digests and checksums are 0 in this program
 * (-Wl,--wrap), so that inputs get past them; a seed's are 0, too.
 *
 * Besides crashes and what the sanitizers find, an input fails that is refused without a sentence
 * or by a status of our own mistakes, or accepted with cameras or a cube that nobody can use. */
#include "unit.h"
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/number.h"
#include "cli/parse.h"
#include "device/tune.h"
#include "exif_fixture.h"
#include "format_fixture.h"
#include "io/json.h"
#include "io/npy.h"
#include "io/run_folder.h"
#include "io/safetensors.h"
#include "model/model.h"
#include "phone_fixture.h"
#include "render/frames.h"
#include "report/report.h"
#include "scene/cameras_file.h"
#include "scene/dataset.h"
#include "scene/origin.h"
#include "view/request.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes);
uint64_t __wrap_cln_digest(uint64_t digest, const void *data, size_t bytes);
uLong __wrap_crc32(uLong sum, const Bytef *data, uInt bytes);

uint64_t __wrap_cln_digest(uint64_t digest, const void *data, size_t bytes)
{
    (void)digest, (void)data, (void)bytes;
    return 0;
}

uLong __wrap_crc32(uLong sum, const Bytef *data, uInt bytes)
{
    (void)sum, (void)data, (void)bytes;
    return 0;
}

enum { MOST_FILES = 8, MOST_WORDS = 64, MOST_PIXELS = 1 << 22 };

/* make: writes the good files into the current folder; read: reads the files there, good ones by
 * `accepts` calls that accept them. */
typedef struct target {
    const char *name;
    const char *files[MOST_FILES];
    void (*make)(void);
    void (*read)(void);
    int accepts;
} target;

static const target *chosen;
static struct {
    char *data;
    size_t bytes;
} good[MOST_FILES];
static int damaged = -1; /* the file that is not good */
static int accepted;

static void require(bool condition, const char *what)
{
    if (!condition) {
        fprintf(stderr, "fuzz: %s: %s\n", what, cln_error_text());
        abort();
    }
}

/* Clears the error, which must blame the input. */
static bool refused(cln_status st)
{
    require(st == CLN_OK || cln_error_text()[0], "refused without a sentence");
    require(st != CLN_INTERNAL && st != CLN_OUTPUT, "refused with a status of our own mistakes");
    if (st != CLN_OK && getenv("FUZZ_TELL"))
        fprintf(stderr, "%s\n", cln_error_text());
    cln_clear_error();
    accepted += st == CLN_OK;
    return st != CLN_OK;
}

static void put(const char *name, const char *text)
{
    scratch_put(name, text, strlen(text));
}

/* ---- scenes ---- */

/* Zeroes the checksums of a PNG's chunks, as this program computes 0. */
static void clear_checksums(uint8_t *png, size_t bytes)
{
    for (size_t at = 8; at + 12 <= bytes;) {
        at += 12 + ((size_t)png[at] << 24 | png[at + 1] << 16 | png[at + 2] << 8 | png[at + 3]);
        memset(png + at - 4, 0, 4);
    }
}

/* Images whose pixels can be read. */
/* Photos called as `pattern` says of their number, which are there. */
static void clear_photos(const char *folder, const char *pattern)
{
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[64], last[32];
        size_t bytes = 0;
        char *file = NULL;

        cln_format(last, sizeof last, pattern, v);
        snprintf(name, sizeof name, "%s/%s", folder, last);
        file = scratch_get(name, &bytes);
        clear_checksums((uint8_t *)file, bytes);
        scratch_put(name, file, bytes);
        free(file);
    }
}

static void make_photos(const char *folder)
{
    format_images(folder, 1);
    clear_photos(folder, "view_%02d.png");
}

static void read_scene(void)
{
    cln_config config = *plain();
    /* pixels that show sparse points are only found for a training */
    const bool points =
        strncmp(chosen->name, "colmap", 6) == 0 || strcmp(chosen->name, "opensfm") == 0;
    const cln_scene_desc desc = {
        .path = ".", .config = &config, .pixels = {[CLN_SPLIT_TRAIN] = points}};
    cln_scene *scene = NULL;
    json_t *about = NULL;

    config.missing = CLN_MISSING_SKIP;
    config.depth_loss = 2;
    if (refused(cln_scene_load(&desc, &scene))) {
        require(!scene, "a scene although it was refused");
        return;
    }
    require(scene->space.half > 0 && isfinite(scene->space.half), "a cube without size");
    for (int i = 0; i < 2 && scene->space.forward; i++)
        require(scene->space.scale[i] > 0 && isfinite(scene->space.scale[i]), "no sides");
    for (int v = 0; v < scene->view_count; v++) {
        const cln_camera *c = &scene->views[v].camera;
        double origin[3], direction[3], norm = 0;

        require(c->width > 0 && c->height > 0, "a camera without pixels");
        cln_camera_ray(c, 0.5 * c->width, 0.5, origin, direction);
        for (int i = 0; i < 3; i++) {
            require(isfinite(origin[i]) && isfinite(scene->space.centre[i]),
                    "a position that is not finite");
            norm += direction[i] * direction[i];
        }
        require(fabs(norm - 1) < 0.01, "a ray without direction");
    }
    if (getenv("FUZZ_TELL"))
        fprintf(stderr, "%lld sights\n", (long long)scene->sight_count);
    for (int64_t i = 0; i < scene->sight_count; i++) {
        const cln_sight *s = &scene->sights[i];
        const cln_camera *c = &scene->views[s->view].camera;

        require(s->x >= 0 && s->y >= 0 && s->x < c->width && s->y < c->height,
                "a sight outside its image");
        require(s->trust >= 0 && s->trust <= 1, "a sight's trust");
        for (int a = 0; a < 3; a++)
            require(isfinite(s->point[a]), "a sight whose point is not finite");
    }
    cln_scene_warn_doubts(scene);
    if (!refused(cln_scene_describe(scene, &about)))
        json_decref(about);
    cln_scene_free(scene);
}

static const cln_point points[2] = {{{1, 2, 3}, {4, 5, 6}, 2, 0}, {{2, 2, 3}, {4, 5, 6}, 3, 0}};

static void make_colmap(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    cameras[1].k1 = 0.1;
    cameras[1].lens = CLN_LENS_OPENCV;
    make_photos("images");
    format_colmap("sparse/0", strcmp(chosen->name, "colmap") == 0, cameras, NULL, points, 2);
    require(!cln_origin_write("sparse/0", (const double[3]){48.2, 16.37, 171},
                              (cln_origin_doubt){.distance = 1.5, .up = 0.25}),
            "origin.txt");
}

static void make_llff(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    make_photos("images");
    format_llff(".", cameras, 1, false);
}

static void make_neus(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    make_photos("image");
    format_neus(".", cameras, true);
}

static void make_nsvf(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_nsvf(".", cameras, "", 1);
    make_photos("rgb");
}

static void make_opensfm(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    make_photos("images");
    format_opensfm(".", cameras, "brown", points, 2);
    format_opensfm_tracks(".", true, points, 2);
}

static void make_metashape(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    make_photos("images");
    format_metashape(".", cameras);
}

static void make_polycam(void)
{
    static const double centre[3] = {1, 2, 3};
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    phone_polycam(".", cameras, false, 1);
    phone_depths(".", cameras, centre, 1, true, 4000);
    clear_photos("keyframes/images", "view_%02d.png");
}

static void make_record3d(void)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    phone_record3d(".", "metadata.json", "rgb", cameras, true);
    clear_photos("rgb", "%d.png");
}

static void make_ply(void)
{
    format_ply(".", "text.ply", false, points, 2);
    format_ply(".", "binary.ply", true, points, 2);
}

static void read_ply(void)
{
    for (int i = 0; i < 2; i++) {
        cln_reader_result result = {0};

        if (!refused(cln_dataset_read_ply(chosen->files[i], &result)))
            for (int k = 0; k < result.point_count; k++)
                for (int a = 0; a < 3; a++)
                    require(isfinite(result.points[k].xyz[a]), "a point that is not finite");
        free(result.points);
    }
}

static void make_blender(void)
{
    make_photos("train");
    put("transforms_train.json",
        "{\"camera_angle_x\": 0.7, \"frames\": [" FRAME("./train/view_00", POSE_FRONT) ", " FRAME(
            "./train/view_01", "[[0,0,1,4],[0,1,0,0],[-1,0,0,0],[0,0,0,1]]") "]}");
    put("transforms_test.json",
        "{\"camera_angle_x\": 0.7, \"frames\": [" FRAME("./train/view_02", POSE_FRONT) "]}");
}

static void make_transforms(void)
{
    make_photos("images");
    put("transforms.json",
        "{ // a comment\n\"camera_model\": \"OPENCV\", \"fl_x\": 20, \"fl_y\": 21.5, \"cx\": 8, "
        "\"cy\": 6, \"w\": 16, \"h\": 12, \"k1\": 0.1, \"k2\": -0.01, \"p1\": 0.001, \"p2\": 0,\n"
        "\"aabb_scale\": 2, \"scale\": 0.5, \"offset\": [0.5, 0.5, 0.5], \"frames\": [" FRAME(
            "images/view_00.png",
            POSE_FRONT) ", /* another */ " FRAME("./images/view_01.png",
                                                 POSE_FRONT) ", "
                                                             "{\"file_path\": "
                                                             "\"images/view_02.png\", \"fl_x\": "
                                                             "30, \"mask_path\": "
                                                             "\"images/view_03.png\", "
                                                             "\"transform_matrix\": " POSE_FRONT
                                                             "},],\n"
                                                             "\"train_filenames\": "
                                                             "[\"images/view_00.png\", "
                                                             "\"images/view_02.png\"],\n"
                                                             "\"test_filenames\": "
                                                             "[\"images/view_01.png\"]}\n");
}

static void make_cameras(void)
{
    put("cameras.json",
        "{\"schema\": \"cl-nascent.cameras/1\",\n\"digest\": \"0000000000000000\",\n"
        "\"folder\": \"/scene\",\n\"split_rule\": \"as the dataset names them\",\n"
        "\"box\": [-1, -1, -1, 1, 1, 0.5],\n\"cameras\": [\n"
        "{\"width\":8,\"height\":6,\"file_width\":16,\"file_height\":12,\"downscale\":2,\"fx\":10,"
        "\"fy\":10.25,\"cx\":4,\"cy\":3,\"lens\":\"OPENCV\",\"params\":[0.1,-0.01,0,0.001]},\n"
        "{\"width\":9,\"height\":6,\"file_width\":9,\"file_height\":6,\"downscale\":1,\"fx\":10,"
        "\"fy\":10,\"cx\":4.5,\"cy\":3,\"lens\":\"OPENCV_FISHEYE\",\"params\":[0,0.01,0,0]}\n],\n"
        "\"views\": "
        "[\n{\"name\":\"a\",\"split\":\"train\",\"camera\":0,\"pose\":[1,0,0,0,0,1,0,0,0,"
        "0,1,4],\"file\":\"images/a.png\",\"mask\":\"masks/a.png\",\"mask_black\":true},\n"
        "{\"name\":\"b.png\",\"split\":\"test\",\"camera\":1,\"pose\":[0,0,1,4,0,1,0,0,-1,0,0,0],"
        "\"alpha\":\"b.alpha.png\",\"turned\":true,\"leads_out\":true}\n]}\n");
}

static void read_cameras(void)
{
    cln_scene *scene = NULL;

    if (refused(cln_cameras_read(".", &scene))) {
        require(!scene, "a scene although it was refused");
        return;
    }
    require(cln_scene_split_count(scene, CLN_SPLIT_TRAIN) > 0, "no training view");
    for (int v = 0; v < scene->view_count; v++) {
        const cln_view *view = &scene->views[v];
        double origin[3], direction[3], norm = 0;

        require(*view->name && view->file && !strchr(view->file, '/'), "a view's name");
        require(view->camera.width > 0 && view->file_width > 0 && view->downscale > 0, "a size");
        cln_camera_ray(&view->camera, 0.5 * view->camera.width, 0.5, origin, direction);
        for (int i = 0; i < 3; i++)
            norm += direction[i] * direction[i];
        require(fabs(norm - 1) < 0.01, "a ray without direction");
    }
    cln_scene_free(scene);
}

/* ---- poses ---- */

static void make_poses(void)
{
    make_transforms();
    put("path.json",
        "{\"camera_type\": \"perspective\", \"render_width\": 64, \"render_height\": 48.0, "
        "\"fps\": 24, \"seconds\": 2, \"crop\": {\"crop_center\": [0, 0.5, 1], \"crop_scale\": "
        "[2, 2, 1.5], \"crop_rot\": [0, 0.25, -1], \"crop_bg_color\": {\"r\": 38, \"g\": 42, "
        "\"b\": 255}}, \"camera_path\": [{\"fov\": 50, \"aspect\": 1.5, \"camera_to_world\": [1, "
        "0, "
        "0, 0, 0, 1, 0, 0, 0, 0, 1, 4, 0, 0, 0, 1]}, {\"fov\": 75.5, \"camera_to_world\": [[0, 0, "
        "1, 4], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]}]}\n");
}

static void check_frames(const cln_frames *f)
{
    require(f->count > 0 && f->fps >= 0 && f->fps <= 1000, "frames without number or pace");
    for (int a = 0; a < 3 && f->crop.on; a++)
        require(f->crop.box[a] < f->crop.box[3 + a], "a crop's box");
    for (int i = 0; i < f->count; i++) {
        const cln_camera *c = &f->frame[i].camera;

        require(f->frame[i].name && *f->frame[i].name && !strchr(f->frame[i].name, '/'),
                "a frame's name");
        require(c->width > 0 && c->height > 0, "a frame without pixels");
        for (int k = 0; k < 12; k++)
            require(isfinite(c->c2w[k]), "a frame's pose");
        require(isfinite(c->fx) && c->fx > 0 && isfinite(c->fy) && c->fy > 0,
                "a frame's focal length");
    }
}

/* What `render --poses` reads, and a path through them. */
static void read_poses(void)
{
    for (int i = 0; i < 2; i++) {
        const cln_frame_sizes sizes = {
            .width = 80, .height = 60, .file_width = 160, .file_height = 120};
        cln_frames keys = {0}, path = {0};

        if (!refused(cln_frames_read(chosen->files[i], &sizes, &keys))) {
            check_frames(&keys);
            if (keys.count < 100 &&
                !refused(cln_frames_through(&keys, 7, NULL, NULL, false, &path)))
                check_frames(&path);
        }
        cln_frames_free(&keys);
        cln_frames_free(&path);
    }
}

/* ---- files ---- */

static char *contents(const char *name, size_t *bytes)
{
    return scratch_get(name, bytes);
}

static void make_images(void)
{
    uint8_t pixels[9 * 5 * 4], *file = NULL;
    size_t bytes = 0;

    for (size_t i = 0; i < sizeof pixels; i++)
        pixels[i] = (uint8_t)(i * i);
    require(!cln_image_encode_png(9, 5, 4, pixels, &file, &bytes), "a PNG");
    clear_checksums(file, bytes);
    scratch_put("a.png", file, bytes);
    free(file);
    require(!cln_image_encode_jpeg(9, 5, 3, pixels, 70, &file, &bytes), "a JPEG");
    scratch_put("a.jpg", file, bytes);
    free(file);
    file = exif_jpeg(9, 5, pixels, 6, &bytes);
    require(file != NULL, "a JPEG with EXIF data");
    scratch_put("b.jpg", file, bytes);
    free(file);
}

static void read_images(void)
{
    for (int i = 0; i < 3; i++) {
        const char *name = chosen->files[i];
        cln_image_head head;
        int width = 0, height = 0, channels = 0;
        size_t bytes = 0;
        char *file = contents(name, &bytes);
        uint8_t *pixels = NULL;

        if (!refused(cln_image_info(name, &width, &height, &channels))) {
            require(width > 0 && height > 0 && (channels == 3 || channels == 4), "a size");
            if ((int64_t)width * height <= MOST_PIXELS &&
                !refused(cln_image_load(name, &width, &height, &channels, &pixels)) && width > 1 &&
                height > 1)
                refused(cln_image_downscale(2, &width, &height, channels, &pixels));
            if (pixels && !refused(cln_image_read_head(name, &head))) {
                require(head.orientation >= 1 && head.orientation <= 8, "an orientation");
                require(!cln_image_turn(head.orientation, &width, &height, channels, &pixels),
                        "a turned image");
            }
        }
        free(pixels);
        free(file);
    }
}

static void make_json(void)
{
    put("a.json", "{\"a\": [1, -2.5e3, true, null], // b\n \"c\": {\"d\": \"\\u00e4\"}, /* e */ }");
}

static void read_json(void)
{
    json_t *document = NULL;

    if (!refused(cln_json_read("a.json", true, &document)))
        json_decref(document);
    if (!refused(cln_json_read("a.json", false, &document)))
        json_decref(document);
}

static void make_npy(void)
{
    const float values[6] = {1, 2, 3, 4, 5, 6};

    require(!cln_npy_write_f32("a.npy", 2, (const int[2]){2, 3}, values), "a.npy");
}

static void read_npy(void)
{
    int dims = 0, shape[4];
    size_t bytes = 0, count = 1;
    char *file = contents("a.npy", &bytes);
    float *narrow = NULL;
    double *wide = NULL, sum = 0;

    if (!refused(cln_npy_read_f32("a.npy", &dims, shape, &narrow)))
        free(narrow);
    if (!refused(cln_npy_decode("a.npy", file, bytes, &dims, shape, &wide))) {
        for (int i = 0; i < dims; i++)
            count *= (size_t)shape[i];
        for (size_t i = 0; i < count; i++) /* they are all there */
            sum += wide[i];
        require(sum != 4711, "the numbers");
        free(wide);
    }
    free(file);
}

static void make_safetensors(void)
{
    const float values[4] = {1, 2, 3, 4};
    const int32_t whole[3] = {1, 2, 3};
    const cln_tensor tensors[2] = {{"a", CLN_DTYPE_F32, 2, {2, 2}, values},
                                   {"b", CLN_DTYPE_I32, 1, {3}, whole}};

    require(!cln_safetensors_write("a.safetensors", 2, tensors, NULL), "a.safetensors");
}

static void read_safetensors(void)
{
    static const char *const names[3] = {"a", "b", ""};
    cln_safetensors *file = NULL;

    if (refused(cln_safetensors_read_foreign("a.safetensors", &file)))
        return;
    for (int i = 0; i < 3; i++)
        for (int dtype = CLN_DTYPE_F32; dtype <= CLN_DTYPE_BF16; dtype++) {
            cln_tensor tensor;

            if (refused(cln_safetensors_get(file, names[i], (cln_dtype)dtype, &tensor)))
                continue;
            void *copy = malloc(cln_tensor_bytes(&tensor) + 1);
            require(copy, "memory");
            memcpy(copy, tensor.data, cln_tensor_bytes(&tensor));
            free(copy);
        }
    cln_safetensors_free(file);
}

/* ---- runs ---- */

/* A checkpoint of the smallest network, with what training needs. */
static void make_run(void)
{
    cln_config config = *plain();
    cln_model model;
    json_t *run = NULL, *settings = NULL;

    config.start_level = 0;
    config.width = config.view_width = 16;
    config.depth = 2;
    config.bands = 1;
    config.view_bands = 0;
    config.n1 = 2;
    require(!cln_model_create(&config, &model), "a model");
    model.space.half = 1;
    model.step = 5;
    require(!cln_checkpoint_write("run", &model), "a checkpoint");
    cln_model_free(&model);
    require(!cln_config_to_json(&config, &settings), "settings");
    run = json_pack("{s:s, s:s, s:o, s:{s:i, s:f}, s:{s:s}}", "schema", "cl-nascent.run/1",
                    "version", CLN_VERSION, "config", settings, "training", "steps", 5, "seconds",
                    1.5, "scene", "path", "scene");
    require(!cln_run_write("run", run), "run.json");
    json_decref(run);
    put("run/metrics.jsonl", "{\"step\": 1, \"psnr\": 10.5, \"leaves\": 8}\n"
                             "{\"step\": 2, \"event\": \"growth\", \"level\": 1}\n"
                             "{\"step\": 5, \"psnr\": 12.5, \"loss\": 0.01}\n");
}

static void read_checkpoint(void)
{
    cln_model model;

    for (int training = 0; training < 2; training++)
        if (!refused(cln_checkpoint_read("run", training, &model))) {
            require(model.tree.leaf_count >= 0 && model.net.params > 0, "a model");
            cln_model_free(&model);
        }
}

static void read_run(void)
{
    cln_settings *settings = NULL;
    cln_metrics *metrics = NULL;
    char *text = NULL;

    if (!refused(cln_info_run("run", &text)))
        free(text);
    if (!refused(cln_settings_of_run("run", &settings)))
        cln_settings_free(settings);
    refused(cln_report_write("run", INT64_MAX));
    if (!refused(cln_metrics_open("run", 2, &metrics)))
        cln_metrics_close(metrics);
}

/* ---- texts ---- */

static void make_tune(void)
{
    put("tune.txt", "# DEVICE | DRIVER | NETWORK | LIST\n"
                    "* | * | * | VW=8,NV=2\ncpu-* | [3-9].* | w32* | TS=6,HALF=1 # fast\n");
}

static void read_tune(void)
{
    cln_tune_rows *rows = NULL;
    cln_tune tune;

    cln_tune_plain(&tune);
    if (!refused(cln_tune_rows_read("tune.txt", &rows))) {
        const cln_tune_row *row = cln_tune_rows_find(rows, "cpu-haswell", "3.1", "w32d3");

        if (row)
            cln_tune_row_apply(row, &tune);
    }
    cln_tune_rows_free(rows);
    refused(cln_tune_row_put("tune.txt", "a | b | c | VW=4"));
    damaged = 0;
}

static void make_options(void)
{
    make_transforms();
    make_run();
    put("command", "train\n.\n-o\nout\n--steps=5\n--no-adaptive\n--rays\n2048\n-q\n");
    put("cl-nascent.conf", "# settings\nrays = 2048\n--width=32\nlevel-at = \"\"\n");
}

/* The command's words, a line each; those of `train .` with cl-nascent.conf. */
static void read_options(void)
{
    size_t bytes = 0;
    char *text = contents("command", &bytes), *words[MOST_WORDS + 1] = {NULL}, *at = text;
    char *plain_words[] = {"cl-nascent", "train", ".", "-o", "out", NULL};
    cln_options options;
    int count = 1;

    words[0] = "cl-nascent";
    while (count < MOST_WORDS && at && *at) {
        words[count++] = at;
        at = strchr(at, '\n');
        if (at)
            *at++ = 0;
    }
    refused(cln_options_parse(count, words, &options));
    (void)cln_options_colour(&options);
    cln_options_free(&options);
    refused(cln_options_parse(5, plain_words, &options));
    cln_options_free(&options);
    free(text);
}

static void make_request(void)
{
    put("query", "pose=1,0,0,4,0,1,0,5,0,0,1,6\nfocal=50\nwidth=64\nheight=32\nms=45\nshow=depth\n"
                 "background=1,0,0.25\nformat=png\nx=1\ny=2\ncrop=-1,-1,-1,1,1,0.5,0,30,-200\n"
                 "frames=24\nfps=12\nfilm=0123456789abcdef0123456789abcdef\n"
                 "host=127.0.0.1:8080\norigin=http://127.0.0.1:8080\nsite=same-origin\n");
}

static const char *value_of(void *query, const char *name)
{
    const size_t length = strlen(name);

    for (char **line = query; *line; line++)
        if (strncmp(*line, name, length) == 0 && (*line)[length] == '=')
            return *line + length + 1;
    return NULL;
}

static void read_request(void)
{
    static const float grey[3] = {0.5f, 0.5f, 0.5f};
    size_t bytes = 0;
    char *text = contents("query", &bytes), *lines[MOST_WORDS + 1] = {NULL}, *at = text;
    cln_view view = {0};
    cln_scene scene = {.views = &view, .view_count = 1};
    const char *reason = NULL;

    view.camera = (cln_camera){.c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                               .fx = 100,
                               .fy = 110,
                               .cx = 40,
                               .cy = 30,
                               .width = 80,
                               .height = 60};
    for (int count = 0; count < MOST_WORDS && at && *at; count++) {
        lines[count] = at;
        at = strchr(at, '\n');
        if (at)
            *at++ = 0;
    }
    for (int kind = CLN_ASK_PICTURE; kind < CLN_ASK_KINDS; kind++) {
        cln_ask ask;

        if (refused(cln_ask_read((cln_ask_kind)kind, &scene, grey, value_of, lines, &ask)))
            continue;
        if (kind == CLN_ASK_PHOTO) {
            require(ask.view == 0 && ask.side > 0, "a photo");
            continue;
        }
        if (kind > CLN_ASK_FILM_BEGIN)
            require(strlen(ask.film) == CLN_FILM_NAME - 1 && !strpbrk(ask.film, "./"),
                    "a film's name");
        if (kind == CLN_ASK_FILM_BEGIN) {
            require(ask.width > 0 && ask.height > 0 && ask.frames > 0 && ask.fps > 0 &&
                        (double)ask.width * ask.height * ask.frames <= CLN_FILM_PIXELS,
                    "a film's size");
            continue;
        }
        if (kind > CLN_ASK_FILM_FRAME)
            continue;
        require(ask.crop.on == (value_of(lines, "crop") != NULL), "a crop");
        for (int a = 0; a < 3 && ask.crop.on; a++)
            require(ask.crop.box[a] < ask.crop.box[3 + a], "a crop's box");
        require(ask.camera.width > 0 && ask.camera.height > 0 &&
                    (int64_t)ask.camera.width * ask.camera.height <= CLN_ASK_PIXELS,
                "a picture's size");
        for (int i = 0; i < 12; i++)
            require(isfinite(ask.camera.c2w[i]), "a pose");
        require(isfinite(ask.camera.fx) && ask.camera.fx > 0, "a focal length");
    }
    for (int far = 0; far < 2; far++)
        require(cln_ask_allowed(value_of(lines, "host"), value_of(lines, "origin"),
                                value_of(lines, "site"), far, &reason) ||
                    reason,
                "refused without a reason");
    free(text);
}

static const target targets[] = {
    {"blender", {"transforms_train.json", "transforms_test.json"}, make_blender, read_scene, 2},
    {"transforms", {"transforms.json"}, make_transforms, read_scene, 2},
    {"colmap",
     {"sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin",
      "sparse/0/origin.txt"},
     make_colmap,
     read_scene,
     2},
    {"colmap-text",
     {"sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt"},
     make_colmap,
     read_scene,
     2},
    {"llff", {"poses_bounds.npy"}, make_llff, read_scene, 2},
    {"neus", {"cameras_sphere.npz"}, make_neus, read_scene, 2},
    {"nsvf", {"intrinsics.txt", "pose/view_00.txt", "bbox.txt"}, make_nsvf, read_scene, 2},
    {"opensfm", {"reconstruction.json", "tracks.csv"}, make_opensfm, read_scene, 2},
    {"metashape", {"cameras.xml"}, make_metashape, read_scene, 2},
    {"polycam",
     {"keyframes/cameras/view_00.json", "keyframes/depth/view_00.png",
      "keyframes/confidence/view_00.png"},
     make_polycam,
     read_scene,
     2},
    {"record3d", {"metadata.json"}, make_record3d, read_scene, 2},
    {"cameras", {"cameras.json"}, make_cameras, read_cameras, 1},
    {"poses", {"path.json", "transforms.json"}, make_poses, read_poses, 4},
    {"ply", {"text.ply", "binary.ply"}, make_ply, read_ply, 2},
    {"image", {"a.png", "a.jpg", "b.jpg"}, make_images, read_images, 12},
    {"json", {"a.json"}, make_json, read_json, 1},
    {"npy", {"a.npy"}, make_npy, read_npy, 2},
    {"safetensors", {"a.safetensors"}, make_safetensors, read_safetensors, 3},
    {"checkpoint",
     {"run/checkpoint/00000005.json", "run/checkpoint/00000005.safetensors"},
     make_run,
     read_checkpoint,
     2},
    {"run", {"run/run.json", "run/metrics.jsonl"}, make_run, read_run, 4},
    {"tune", {"tune.txt"}, make_tune, read_tune, 2},
    {"options", {"command", "cl-nascent.conf"}, make_options, read_options, 2},
    {"request", {"query"}, make_request, read_request, 7},
};

/* ---- what libFuzzer calls ---- */

static char *folder, *inner;

static void leave(void)
{
    char *command = NULL;

    if (asprintf(&command, "rm -rf '%s'", folder) > 0 && system(command) != 0)
        fprintf(stderr, "fuzz: %s remains\n", folder);
    free(command);
    free(folder);
    free(inner);
    for (int i = 0; i < MOST_FILES; i++)
        free(good[i].data);
}

static int file_count(void)
{
    int count = 0;

    while (count < MOST_FILES && chosen->files[count])
        count++;
    return count;
}

static void no_log(cln_log_level level, const char *line, void *user)
{
    (void)level, (void)line, (void)user;
}

static void write_seeds(const char *where)
{
    for (int i = 0; i < file_count(); i++) {
        const char *slash = strrchr(chosen->files[i], '/');
        char *path = NULL;

        require(asprintf(&path, "%s/%s/%s", where, chosen->name,
                         slash ? slash + 1 : chosen->files[i]) > 0,
                "memory");
        *strrchr(path, '/') = 0;
        require(!cln_make_dirs(path), "a folder of seeds");
        path[strlen(path)] = '/';
        FILE *f = fopen(path, "wb");
        require(f, path);
        if (file_count() > 1)
            fputc('0' + i, f);
        fwrite(good[i].data, 1, good[i].bytes, f);
        require(fclose(f) == 0, path);
        free(path);
    }
}

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    const char *slash = strrchr((*argv)[0], '/'), *name = slash ? slash + 1 : (*argv)[0];
    const bool seeds = *argc == 3 && strcmp((*argv)[1], "--seeds") == 0;
    char *where = seeds ? realpath((*argv)[2], NULL) : NULL;
    const char *base = getenv("TMPDIR");
    int home = open(".", O_RDONLY | O_DIRECTORY);

    for (size_t i = 0; i < sizeof targets / sizeof targets[0]; i++)
        if (strcmp(targets[i].name, name) == 0)
            chosen = &targets[i];
    if (!chosen) { /* called by its own name: lists the targets */
        for (size_t i = 0; i < sizeof targets / sizeof targets[0]; i++)
            puts(targets[i].name);
        exit(0);
    }
    cln_log_set_sink(no_log, NULL);
    require(asprintf(&folder, "%s/cln-fuzz-XXXXXX", base ? base : "/tmp") > 0 && mkdtemp(folder) &&
                asprintf(&inner, "%s/scene", folder) > 0 && mkdir(inner, 0777) == 0 && home >= 0 &&
                chdir(inner) == 0, /* readers may look beside it */
            "a folder for the files");
    atexit(leave);
    setenv("HOME", folder, 1);
    unsetenv("XDG_CONFIG_HOME");
    chosen->make();
    for (int i = 0; i < file_count(); i++)
        good[i].data = contents(chosen->files[i], &good[i].bytes);
    if (seeds) {
        require(where, (*argv)[2]);
        write_seeds(where);
        free(where);
        exit(0);
    }
    chosen->read();
    if (accepted != chosen->accepts) {
        fprintf(stderr, "fuzz: %d calls accept good files, not %d\n", accepted, chosen->accepts);
        abort();
    }
    require(fchdir(home) == 0, "no way back to the first folder");
    close(home);
    return 0;
}

static void write_file(const char *name, const void *data, size_t bytes)
{
    int fd = open(name, O_WRONLY | O_CREAT | O_TRUNC, 0666);

    require(fd >= 0 && write(fd, data, bytes) == (ssize_t)bytes && close(fd) == 0, name);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes)
{
    static int work = -1, home = -1;
    const int count = file_count();
    int which = 0;

    if (work < 0) {
        work = open(inner, O_RDONLY | O_DIRECTORY);
        home = open(".", O_RDONLY | O_DIRECTORY);
    }
    if (count > 1) {
        which = bytes ? *data - '0' : -1;
        if (which < 0 || which >= count)
            return -1;
        data++;
        bytes--;
    }
    require(fchdir(work) == 0, "the folder of the files");
    if (damaged >= 0 && damaged != which)
        write_file(chosen->files[damaged], good[damaged].data, good[damaged].bytes);
    write_file(chosen->files[which], data, bytes);
    damaged = which;
    chosen->read();
    require(fchdir(home) == 0, "no way back to the first folder");
    return 0;
}
