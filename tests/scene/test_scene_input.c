/* Scenes that must not load. Every case is a row: the text of transforms.json, and words of the
 * sentence; each gives CLN_INPUT, a NULL scene and no leak (run under sanitizers). Then broken
 * files, and the JSON reader's lines, columns and relaxed dialect. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "io/json.h"
#include "scene_fixture.h"
#include "tests.h"

/* Two good images, a.png and b.png; cut.png is truncated; c.png has another size. */
static void put_images(const char *folder)
{
    char *data = NULL;
    size_t bytes = 0;

    put_image(folder, "a.png", 16, 12, 3, 0);
    put_image(folder, "b.png", 16, 12, 3, 1);
    put_image(folder, "c.png", 16, 5, 3, 2);
    data = scratch_get(scratch_path(folder, "a.png"), &bytes);
    scratch_put(scratch_path(folder, "cut.png"), data, bytes - 20);
    free(data);
}

/* A whole document around frames, and one around frame a.png, preceded by other keys. */
#define DOC(frames)  "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" frames "]}"
#define KEYS(keys)   "{" keys ",\"aabb_scale\":1,\"frames\":[" FRAME("a.png", POSE_FRONT) "]}"
#define POSED(pose)  DOC(FRAME("a.png", pose))
#define ROWS(r0, r1) "[" r0 "," r1 ",[0,0,1,4],[0,0,0,1]]"
#define GOOD_ROW     "[1,0,0,0]"
#define DEEP10(x)    x x x x x x x x x x
#define DEEP1000(x)  DEEP10(DEEP10(DEEP10(x)))

typedef struct broken {
    const char *what, *json, *words[3];
} broken;

static const broken documents[] = {
    /* Documents */
    {"empty file", "", {"transforms.json", "line 1", "the file is empty; copy"}},
    {"malformed",
     "{\n  \"frames\": [\n    {\"file_path\" \"a.png\"}\n  ]\n}",
     {"transforms.json", "line 3", "column"}},
    {"cut off", "{\"camera_angle_x\":0.8,\n\"frames\":[{", {"transforms.json", "line 2"}},
    {"open comment",
     "{\n \"a\": 1,\n  /* \"frames\": [] }",
     {"transforms.json", "line 3 column 3", "comment"}},
    {"not JSON at all", "\x89PNG\r\n\x1a\n", {"transforms.json", "line 1"}},
    {"a number", "42", {"transforms.json", "line 1"}},
    {"an array", "[[],[{}]]", {"transforms.json", "not a JSON object"}},
    {"nested too deep", DEEP1000("[") DEEP1000("[") DEEP1000("["), {"transforms.json", "line 1"}},
    {"not UTF-8",
     "{\"frames\":\"\xff\xfe\"}",
     {"transforms.json", "line 1 is not UTF-8", "CP1252"}},
    /* Frames */
    {"no frames",
     "{\"camera_angle_x\":0.8}",
     {"transforms.json", "it has no frames", "\"Your own poses\""}},
    {"frames an object", "{\"frames\":{\"0\":1}}", {"transforms.json", "frames must be an array"}},
    {"frames a string", "{\"frames\":\"all\"}", {"transforms.json", "frames must be an array"}},
    {"zero frames", DOC(""), {"zero frames"}},
    {"frame a number", DOC("7"), {"transforms.json", "frame 0 is not an object"}},
    {"frame null", DOC(FRAME("a.png", POSE_FRONT) ",null"), {"frame 1 is not an object"}},
    {"frame an array", DOC("[[[{}]]]"), {"frame 0"}},
    {"no file_path", DOC("{\"transform_matrix\":" POSE_FRONT "}"), {"frame 0", "file_path"}},
    {"file_path a number", DOC("{\"file_path\":3}"), {"frame 0", "file_path"}},
    {"file_path empty", DOC(FRAME("", POSE_FRONT)), {"frame 0", "file_path"}},
    {"file_path a folder", DOC(FRAME("../..", POSE_FRONT)), {"frame 0", "names no image file"}},
    {"the same twice",
     DOC(FRAME("a.png", POSE_FRONT) "," FRAME("./a.png", POSE_FRONT)),
     {"'a.png'", "twice"}},
    /* Images */
    {"missing image",
     DOC(FRAME("a.png", POSE_FRONT) "," FRAME("gone/x", POSE_FRONT)),
     {"1 of 2 images is not there", "'gone/x'", "gone/x.png); restore"}},
    {"truncated image",
     DOC(FRAME("a.png", POSE_FRONT) "," FRAME("cut.png", POSE_FRONT)),
     {"cut.png", "truncated"}},
    {"image is JSON", DOC(FRAME("transforms.json", POSE_FRONT)), {"transforms.json", "not a PNG"}},
    {"other shape",
     "{\"fl_x\":9,\"w\":16,\"h\":12,\"frames\":[" FRAME("c.png", POSE_FRONT) "]}",
     {"c.png", "16 x 5", "16 x 12"}},
    /* Poses */
    {"no pose", DOC("{\"file_path\":\"a.png\"}"), {"'a.png'", "no transform_matrix"}},
    {"pose a string", POSED("\"left\""), {"'a.png'", "transform_matrix must be"}},
    {"two rows", POSED("[[1,0,0,0],[0,1,0,0]]"), {"'a.png'", "3 or 4 rows"}},
    {"short row", POSED(ROWS(GOOD_ROW, "[0,1,0]")), {"'a.png'", "row 2"}},
    {"row a number", POSED(ROWS(GOOD_ROW, "5")), {"'a.png'", "row 2"}},
    {"string in the pose", POSED(ROWS(GOOD_ROW, "[0,\"1\",0,0]")), {"'a.png'", "row 2 column 2"}},
    {"null in the pose", POSED(ROWS(GOOD_ROW, "[0,1,0,null]")), {"'a.png'", "row 2 column 4"}},
    {"NaN in the pose",
     "{\"camera_angle_x\":0.8,\n\"frames\":[" FRAME("a.png", ROWS("[NaN,0,0,0]", GOOD_ROW)) "]}",
     {"transforms.json", "frame 0 ('a.png')", "row 1 column 1"}},
    {"infinity in the pose", POSED(ROWS("[1,0,0,1e999]", GOOD_ROW)), {"transforms.json", "line 1"}},
    {"far away", POSED(ROWS("[1,0,0,1e200]", "[0,1,0,0]")), {"'a.png'", "1e+200"}},
    {"scaled", POSED(ROWS("[1,0,0,0]", "[0,1.01,0,0]")), {"'a.png'", "not rigid", "1.01"}},
    {"sheared", POSED(ROWS("[1,0.02,0,0]", "[0,0.9998,0,0]")), {"'a.png'", "not rigid", "off by"}},
    {"mirrored", POSED(ROWS("[-1,0,0,0]", "[0,1,0,0]")), {"'a.png'", "not rigid", "mirrored"}},
    {"zero rotation", POSED(ROWS("[0,0,0,0]", "[0,0,0,0]")), {"'a.png'", "determinant"}},
    {"last row", POSED("[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0.5,1]]"), {"'a.png'", "last row"}},
    /* Intrinsics */
    {"no focal length", KEYS("\"w\":16,\"h\":12"), {"'a.png'", "focal length"}},
    {"angle zero", KEYS("\"camera_angle_x\":0"), {"'a.png'", "camera_angle_x = 0"}},
    {"angle beyond pi", KEYS("\"camera_angle_x\":4"), {"'a.png'", "camera_angle_x = 4"}},
    {"focal length a string",
     KEYS("\"fl_x\":\"687.76\""),
     {"transforms.json: fl_x must be a number", "quotes (\"687.76\")"}},
    {"focal length of a frame a string",
     DOC("{\"fl_x\":\"20\",\"file_path\":\"a.png\",\"transform_matrix\":" POSE_FRONT "}"),
     {"'a.png'): fl_x must be a number"}},
    {"width a string",
     KEYS("\"fl_x\":20,\"h\":12,\"w\":\"16\""),
     {"transforms.json: w must be a number"}},
    {"focal length negative", KEYS("\"fl_x\":-20"), {"'a.png'", "fl_x = -20"}},
    {"focal length zero", KEYS("\"fl_x\":0"), {"'a.png'", "fl_x = 0"}},
    {"absurd width", KEYS("\"fl_x\":20,\"w\":1e12,\"h\":12"), {"'a.png'", "w = 1e+12"}},
    {"half a pixel", KEYS("\"fl_x\":20,\"w\":16.5,\"h\":12"), {"'a.png'", "w = 16.5"}},
    {"negative height", KEYS("\"fl_x\":20,\"w\":16,\"h\":-12"), {"'a.png'", "h = -12"}},
    {"a width that is not the image's, alone",
     KEYS("\"fl_x\":10,\"w\":8"),
     {"'a.png'", "w is 8 without h, but the image has 16 x 12 pixels", "add h"}},
    {"a height that is not the image's, alone",
     KEYS("\"fl_x\":10,\"h\":24"),
     {"'a.png'", "h is 24 without w"}},
    {"a size of another shape",
     KEYS("\"fl_x\":10,\"w\":16,\"h\":5"),
     {"a.png", "given for 16 x 5; correct w and h, after a crop also cx and cy, or replace"}},
    {"absurd distortion", KEYS("\"fl_x\":20,\"k1\":1e300"), {"'a.png'", "k1"}},
    {"k3 and k4",
     KEYS("\"fl_x\":20,\"k3\":0.1,\"k4\":0.1"),
     {"'a.png'", "k3 = 0.1", "FULL_OPENCV"}},
    {"k4", KEYS("\"fl_x\":20,\"k4\":0.1"), {"'a.png'", "k4 = 0.1"}},
    {"unknown model",
     KEYS("\"fl_x\":20,\"camera_model\":\"KANNALA\""),
     {"'a.png'", "KANNALA", "EUCM (alpha beta), EQUIRECTANGULAR; undistort"}},
    {"F-theta", KEYS("\"fl_x\":20,\"ftheta_p0\":1"), {"'a.png'", "F-theta"}},
    {"fisheye with k5",
     KEYS("\"fl_x\":20,\"is_fisheye\":true,\"k5\":0.1"),
     {"'a.png'", "k5 = 0.1", "OPENCV_FISHEYE"}},
    {"fisheye with p1",
     KEYS("\"fl_x\":20,\"camera_model\":\"OPENCV_FISHEYE\",\"p1\":0.5"),
     {"'a.png'", "p1 = 0.5", "OPENCV_FISHEYE; remove it"}},
    {"a thin prism without its model",
     KEYS("\"fl_x\":20,\"k1\":0.1,\"sx1\":7"),
     {"'a.png'", "sx1 = 7", "model OPENCV;"}},
    {"k1 of a panorama",
     KEYS("\"camera_model\":\"EQUIRECTANGULAR\",\"k1\":0.1"),
     {"'a.png'", "k1 = 0.1", "EQUIRECTANGULAR"}},
    {"parameters without meaning",
     KEYS("\"fl_x\":20,\"camera_model\":\"EUCM\",\"alpha\":2,\"beta\":1"),
     {"'a.png'", "EUCM", "alpha must be 0 to 1"}},
    {"lens that sees nothing",
     KEYS("\"fl_x\":20,\"cx\":500,\"k1\":-5"),
     {"'a.png'", "no pixel", "k1 = -5"}},
    {"list of another length",
     KEYS("\"fl_x\":20,\"distortion_params\":[0.1,0,0,0]"),
     {"'a.png'", "distortion_params has 4 numbers", "it has 6 (k1 to p2)"}},
    {"list of six for FISHEYE624",
     KEYS("\"fl_x\":20,\"camera_model\":\"FISHEYE624\",\"distortion_params\":[0.1,0,0,0,0,0]"),
     {"'a.png'", "distortion_params has 6 numbers", "it has 12 (k0 to s3)"}},
    {"list of what the model lacks",
     KEYS("\"fl_x\":20,\"is_fisheye\":true,\"distortion_params\":[0,0,0,0,0,0.1]"),
     {"'a.png'", "p2 = 0.1", "OPENCV_FISHEYE"}},
    {"list with a string",
     KEYS("\"fl_x\":20,\"distortion_params\":[0,\"0\",0,0,0,0]"),
     {"'a.png'", "distortion_params must be a list of numbers"}},
    {"list a number",
     KEYS("\"fl_x\":20,\"distortion_params\":0.1"),
     {"'a.png'", "distortion_params must be a list of numbers"}},
    {"model a number", KEYS("\"fl_x\":20,\"camera_model\":5"), {"'a.png'", "camera_model"}},
    /* Splits and bounds */
    {"a frame twice beside lists",
     "{\"fl_x\":20,\"train_filenames\":[\"a.png\"],\"frames\":[" FRAME(
         "a.png", POSE_FRONT) "," FRAME("a.png", POSE_FRONT) "]}",
     {"'a.png'", "two frames"}},
    {"list of numbers", KEYS("\"fl_x\":20,\"train_filenames\":[1]"), {"train_filenames[0]"}},
    {"list an object",
     KEYS("\"fl_x\":20,\"test_filenames\":{\"a\":1}"),
     {"test_filenames", "array"}},
    {"list names nothing",
     KEYS("\"fl_x\":20,\"train_filenames\":[\"z.png\"]"),
     {"train_filenames", "'z.png'", "'a.png'"}},
    {"no training view", KEYS("\"fl_x\":20,\"test_filenames\":[\"a.png\"]"), {"no training view"}},
    {"another program's",
     "[{\"cameras\": {}, \"shots\": {}}]",
     {"a reconstruction of OpenSfM's", "reconstruction.json"}},
    {"aabb_scale zero",
     "{\"fl_x\":20,\"aabb_scale\":0,\"frames\":[" FRAME("a.png", POSE_FRONT) "]}",
     {"aabb_scale 0"}},
    {"aabb_scale a string",
     "{\"fl_x\":20,\"aabb_scale\":\"big\",\"frames\":[" FRAME("a.png", POSE_FRONT) "]}",
     {"aabb_scale must be a number"}},
    {"absurd aabb_scale",
     "{\"fl_x\":20,\"aabb_scale\":1e300,\"frames\":[" FRAME("a.png", POSE_FRONT) "]}",
     {"absurd scene cube", "--bbox"}},
    {"aabb of one corner", KEYS("\"fl_x\":20,\"aabb\":[[0,0,0]]"), {"aabb[1]"}},
    {"offset of two", KEYS("\"fl_x\":20,\"offset\":[1,2]"), {"offset must be three numbers"}},
    /* From (0, 0, 4) with OpenGL axes turned by half a turn about y: looks along +z, away. */
    {"no camera looks at the cube",
     POSED("[[-1,0,0,0],[0,1,0,0],[0,0,-1,4],[0,0,0,1]]"),
     {"no camera looks at the cube", "--bbox", "instant-ngp"}},
};

static void test_documents(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();

    config.holdout = 0;
    put_images(folder);
    for (size_t i = 0; i < sizeof documents / sizeof *documents; i++) {
        put_text(folder, "transforms.json", documents[i].json);
        assert_refused(folder, &config, documents[i].words, documents[i].what);
    }
    /* The unmodified frame of the cases is good; so is one side that is the image's. */
    put_text(folder, "transforms.json", POSED(POSE_FRONT));
    cln_scene_free(load(folder, &config));
    put_text(folder, "transforms.json", KEYS("\"fl_x\":20,\"h\":12"));
    cln_scene_free(load(folder, &config));
}

/* Every prefix of a good document is refused; random damage does no harm. */
static void test_cut_documents(void **state)
{
    const char *folder = *state;
    const char *file = scratch_path(folder, "transforms.json");
    const char json[] = KEYS("\"fl_x\":20,\"k1\":0.1, /* c */ \"offset\":[0.5,0.5,0.5] // d\n");
    cln_config config = default_config();

    config.holdout = 0;
    put_images(folder);
    for (size_t cut = 0; cut < sizeof json - 1; cut++) {
        scratch_put(file, json, cut);
        assert_refused(folder, &config, (const char *const[3]){"transforms.json", "line"},
                       "prefix");
    }
    for (size_t at = 0; at < sizeof json - 1; at++)
        for (const char *c = "\"[{}],:/*\\0e-\n"; *c; c++) {
            char damaged[sizeof json];
            cln_scene *scene = NULL;

            memcpy(damaged, json, sizeof json);
            damaged[at] = *c;
            scratch_put(file, damaged, strlen(damaged));
            if (try_load(folder, &config, &scene) != CLN_OK) {
                assert_null(scene);
                assert_true(cln_error_text()[0]);
            }
            cln_scene_free(scene);
            cln_clear_error();
        }
}

static void test_paths(void **state)
{
    const char *folder = *state;
    const char *empty = NULL;

    put_folder(folder, "empty");
    empty = scratch_path(folder, "empty");
    assert_refused(empty, NULL, (const char *const[3]){empty, "transforms.json"}, "empty folder");
    assert_refused("/nonexistent/scene", NULL,
                   (const char *const[3]){"/nonexistent/scene", "No such file"}, "no folder");
    put_text(folder, "scene.txt", "{}");
    assert_refused(scratch_path(folder, "scene.txt"), NULL,
                   (const char *const[3]){"scene.txt", "give the folder"}, "not JSON");
    assert_refused(scratch_path(folder, "other.json"), NULL,
                   (const char *const[3]){"other.json", "No such file"}, "no file");
    put_folder(folder, "empty/transforms.json"); /* a folder of that name */
    assert_refused(empty, NULL, (const char *const[3]){empty}, "folder as JSON");
    /* Blender: val or test without train. */
    put_text(folder, "transforms_test.json", "{}");
    assert_refused(folder, NULL, (const char *const[3]){"transforms_train.json"}, "no train");
    assert_refused(scratch_path(folder, "transforms_test.json"), NULL,
                   (const char *const[3]){"transforms_train.json", "No such file"}, "no train");
}

/* Broken images of all kinds, and in the Blender dialect, where sizes come from the image. */
static void test_images(void **state)
{
    const char *folder = *state, *image = scratch_path(folder, "r_0.png");
    char *data = NULL;
    size_t bytes = 0;
    const char *json = "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("./r_0", POSE_FRONT) "]}";

    put_text(folder, "transforms_train.json", json);
    put_text(folder, "transforms_test.json", json);
    assert_refused(folder, NULL,
                   (const char *const[3]){"2 of 2 images are not there", "r_0.png); restore"},
                   "missing");
    put_text(folder, "r_0.png", "");
    assert_refused(folder, NULL, (const char *const[3]){"r_0.png", "empty file"}, "empty");
    put_text(folder, "r_0.png", "<html>404</html>");
    assert_refused(folder, NULL, (const char *const[3]){"r_0.png", "not a PNG or JPEG"}, "html");
    put_image(folder, "r_0.png", 16, 12, 4, 0);
    data = scratch_get(image, &bytes);
    for (size_t cut = 1; cut < bytes; cut += 7) {
        scratch_put(image, data, cut);
        assert_refused(folder, NULL, (const char *const[3]){"r_0.png"}, "cut");
    }
    /* The header of a PNG of 100,000 x 100,000 pixels. */
    memcpy(data + 16, "\0\1\x86\xa0\0\1\x86\xa0", 8);
    scratch_put(image, data, bytes);
    assert_refused(folder, NULL, (const char *const[3]){"r_0.png", "100000 x 100000"}, "huge");
    free(data);
    /* A folder in the image's place. */
    assert_int_equal(remove(image), 0);
    put_folder(folder, "r_0.png");
    assert_refused(folder, NULL, (const char *const[3]){"r_0.png); restore"}, "folder as image");
}

/* With two threads reading images the sentence is always about the first broken one. */
static void test_first_failure_wins(void **state)
{
    const char *folder = *state;
    char json[4096] = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[";

    for (int i = 0; i < 12; i++) {
        char name[32], frame[256], *data = NULL;
        size_t bytes = 0;

        snprintf(name, sizeof name, "%d.png", i);
        put_image(folder, name, 16, 12, 3, i);
        snprintf(frame, sizeof frame, FRAME("%s", POSE_FRONT) "%s", name, i < 11 ? "," : "]}");
        strcat(json, frame);
        if (i < 3)
            continue;
        data = scratch_get(scratch_path(folder, name), &bytes);
        scratch_put(scratch_path(folder, name), data, bytes - 5);
        free(data);
    }
    put_text(folder, "transforms.json", json);
    for (int i = 0; i < 50; i++)
        assert_refused(folder, NULL, (const char *const[3]){"/3.png", "truncated"}, "threads");
}

static void test_options(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;

    put_images(folder);
    put_text(folder, "transforms.json",
             DOC(FRAME("a.png", POSE_FRONT) "," FRAME("b.png", POSE_FRONT)));
    config.downscale = 13;
    assert_refused(folder, &config, (const char *const[3]){"downscale 13", "16 x 12"}, "downscale");
    config.downscale = 1;
    config.holdout = 1;
    assert_refused(folder, &config, (const char *const[3]){"no training view", "--holdout 0"},
                   "holdout");
    config.holdout = 8;
    strcpy(config.bbox, "10,10,10,11,11,11");
    assert_refused(folder, &config, (const char *const[3]){"no camera looks at the cube", "--bbox"},
                   "bbox");
    strcpy(config.bbox, "0,0,0,1,-1,1");
    assert_int_equal(try_load(folder, &config, &scene), CLN_USAGE);
    assert_null(scene);
    assert_non_null(strstr(cln_error_text(), "--bbox"));
    cln_clear_error();
    config.bbox[0] = 0;
    strcpy(config.background, "purple");
    assert_int_equal(try_load(folder, &config, &scene), CLN_USAGE);
    assert_null(scene);
    cln_clear_error();
}

/* ---- io/json.c ---- */

static void test_json_read(void **state)
{
    static const struct {
        const char *text, *where; /* NULL: it is good JSON */
        bool relaxed;
    } cases[] = {
        {"{\"a\": [1, 2, {\"b\": null}]}", NULL, false},
        {"{\"a\": [1, 2,]}", "line 1 column 13", false},
        {"{\"a\": 1} // no", "line 1 column 10", false},
        {"{\"a\": [1, 2,], \"b\": 3,}", NULL, true},
        {"// first\n{\"a\": /* x\n y */ 1, // last\n}", NULL, true},
        {"{\"a\": \"// /* ,] \\\" ,}\",}", NULL, true},
        {"\xEF\xBB\xBF{}", NULL, true},
        {"[,]", "line 1 column 2", true},
        {"[1,,2]", "line 1 column 4", true},
        {"[1,,]", "line 1", true},
        {"{\"a\":,}", "line 1 column 6", true},
        {"{,}", "line 1 column 2", true},
        {"[1] / [2]", "line 1 column 5", true},
        /* Positions behind comments: a block over two lines, one on the line, one in UTF-8. */
        {"[ /* 1\n 2 */ 1, x]", "line 2 column 10", true},
        {"[ /* \xC3\xA9\xC3\xA9 */ x]", "line 1 column 12", true},
        {"[1, // tail\n  x]", "line 2 column 3", true},
        {"[\"a\n\"]", "line 1", true},
        {"[\"\\", "line 1", true},
        {"/", "line 1", true},
        {"[] /*", "line 1 column 4", true},
        {"[] /*/", "line 1 column 4", true},
        {"{\"a\": [NaN, -Infinity], \"nan\": nan\n}", NULL, true},
        {"[1, NaN]", "line 1 column 7", false},
        {"[nano]", "line 1", true},
    };
    const char *path = scratch_path(*state, "a.json");

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        json_t *document = (json_t *)1;
        cln_status st = CLN_OK;

        put_text(*state, "a.json", cases[i].text);
        st = cln_json_read(path, cases[i].relaxed, &document);
        if (!cases[i].where) {
            if (st != CLN_OK)
                fail_msg("case %zu: %s", i, cln_error_text());
            json_decref(document);
            continue;
        }
        assert_int_equal(st, CLN_INPUT);
        assert_null(document);
        if (!strstr(cln_error_text(), path) || !strstr(cln_error_text(), cases[i].where))
            fail_msg("case %zu: '%s' lacks the path or '%s'", i, cln_error_text(), cases[i].where);
        cln_clear_error();
    }
}

static void test_json_real(void **state)
{
    json_t *values[4] = {cln_json_real(0.1), cln_json_real(NAN), cln_json_real(INFINITY),
                         cln_json_real(-INFINITY)};

    (void)state;
    assert_true(json_real_value(values[0]) == 0.1);
    for (int i = 1; i < 4; i++)
        assert_true(json_is_null(values[i]));
    for (int i = 0; i < 4; i++)
        json_decref(values[i]);
}

int test_group_scene_input(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_documents, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_cut_documents, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_paths, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_images, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_first_failure_wins, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_options, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_json_read, scratch_make, scratch_remove),
        cmocka_unit_test(test_json_real),
    };

    return cmocka_run_group_tests_name("scene_input", tests, NULL, NULL);
}
