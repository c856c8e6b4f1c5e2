/* Poses refined by photos (train/refine.h), on a ball whose colour is a smooth function of the
 * place: pictures of it are exact, and so is what a step should find. Then a training whose poses
 * were shaken: they come back, held-out pictures get better, and an interrupted one has the same
 * bits. */
#include "unit.h"
#include "base/rng.h"
#include "near.h"
#include "render/open_run.h"
#include "run_fixture.h"
#include "scene/motion.h"
#include "tests.h"
#include "train/refine.h"

enum { WIDE = 48, VIEWS = 20, HELD = 4, SPOTS = 384 };
static const double FOCAL = 66;

/* What a ray shows of the ball of radius 1: colour over white, opacity, and its depth there. */
static cln_ray_result ball(const double o[3], const double d[3])
{
    double b = 0, c = -1, root = 0, rgb[3];
    cln_ray_result out = {.r = 1, .g = 1, .b = 1};

    for (int a = 0; a < 3; a++) {
        b += o[a] * d[a];
        c += o[a] * o[a];
    }
    root = b * b - c;
    if (root <= 0)
        return out;
    out.depth = (float)(-b - sqrt(root));
    out.opacity = 1;
    for (int a = 0; a < 3; a++) {
        const double p = o[a] + (double)out.depth * d[a];
        const double q = o[(a + 1) % 3] + (double)out.depth * d[(a + 1) % 3];

        rgb[a] = 0.5 + 0.25 * sin(7 * p + a) + 0.2 * cos(6 * q - 2 * a);
    }
    out.r = (float)rgb[0];
    out.g = (float)rgb[1];
    out.b = (float)rgb[2];
    return out;
}

/* The camera of view i, OpenCV's axes. */
static cln_camera camera_of(int i, int views, double phase)
{
    cln_camera c = {.fx = FOCAL,
                    .fy = FOCAL,
                    .cx = WIDE / 2.0,
                    .cy = WIDE / 2.0,
                    .width = WIDE,
                    .height = WIDE};
    double m[3][4];

    fixture_pose(6.283185307 * (2.4 * i + phase) / views, -0.7 + 1.5 * (i + phase) / views, m);
    for (int a = 0; a < 3; a++)
        for (int k = 0; k < 4; k++)
            c.c2w[4 * a + k] = k == 1 || k == 2 ? -m[a][k] : m[a][k];
    return c;
}

/* Half a degree, and half a percent of the distance. */
static void shake(int view, double out[12], const double c2w[12])
{
    double motion[CLN_MOTION], length[2] = {0};

    for (int k = 0; k < CLN_MOTION; k++) {
        motion[k] = cln_hash((uint32_t)(8 * view + k) + 3) / 2147483648.0 - 1;
        length[k / 3] = hypot(length[k / 3], motion[k]);
    }
    for (int k = 0; k < CLN_MOTION; k++)
        motion[k] *= (k < 3 ? 0.5 * M_PI / 180 : 0.005 * 4) / length[k / 3];
    cln_motion_apply(c2w, motion, out);
}

/* Mean distance, in pixels, of where two poses see points of the ball. */
static double apart(const cln_camera *camera, const double a[12], const double b[12])
{
    cln_camera one = *camera, other = *camera;
    double sum = 0;

    memcpy(one.c2w, a, sizeof one.c2w);
    memcpy(other.c2w, b, sizeof other.c2w);
    for (int i = 0; i < 8; i++) {
        const double point[3] = {i & 1 ? 0.5 : -0.5, i & 2 ? 0.5 : -0.5, i & 4 ? 0.5 : -0.5};
        double u = 0, v = 0, u1 = 0, v1 = 0, z = 0;

        assert_true(cln_camera_project(&one, point, &u, &v, &z));
        assert_true(cln_camera_project(&other, point, &u1, &v1, &z));
        sum += hypot(u1 - u, v1 - v) / 8;
    }
    return sum;
}

/* ---- a step ---- */

/* The mean of FINE x FINE rays of a pixel, as a photo has it; the depth is of those that meet the
 * ball. */
static cln_ray_result seen(const cln_camera *camera, int x, int y)
{
    enum { FINE = 4 };
    cln_ray_result mean = {0};

    for (int k = 0; k < FINE * FINE; k++) {
        const double u = x + (k % FINE + 0.5) / FINE, v = y + (k / FINE + 0.5) / FINE;
        const float part = 1.0f / (FINE * FINE);
        double o[3], d[3];
        cln_ray_result one;

        assert_true(cln_camera_ray(camera, u, v, o, d));
        one = ball(o, d);
        mean.r += part * one.r;
        mean.g += part * one.g;
        mean.b += part * one.b;
        mean.opacity += part * one.opacity;
        mean.depth += part * one.depth;
    }
    if (mean.opacity > 0)
        mean.depth /= mean.opacity;
    return mean;
}

/* Spots all over the photo that the true camera took, and what the other one renders there. */
static void look(const cln_camera *truth, const cln_camera *now, cln_spot *spots,
                 cln_ray_result (*looks)[CLN_SPOT_LOOKS])
{
    static const int across[] = {0, -1, 1, 0, 0}, down[] = {0, 0, 0, -1, 1};

    for (int i = 0; i < SPOTS; i++) {
        const int x = 1 + (int)(cln_hash((uint32_t)i) % (WIDE - 2));
        const int y = 1 + (int)(cln_hash((uint32_t)i + 9999) % (WIDE - 2));
        const cln_ray_result photo = seen(truth, x, y);

        spots[i] = (cln_spot){i % 11 ? x : -1, y, {photo.r, photo.g, photo.b}};
        for (int k = 0; k < CLN_SPOT_LOOKS; k++)
            looks[i][k] = seen(now, x + across[k], y + down[k]);
    }
}

/* Steps end at the true pose: with a lens, in a cube of another size, with a darker photo; a few
 * pixels that are entirely wrong matter little. */
static void test_steps(void **state)
{
    cln_spot spots[SPOTS];
    cln_ray_result looks[SPOTS][CLN_SPOT_LOOKS];

    (void)state;
    for (int kind = 0; kind < 4; kind++)
        for (int i = 0; i < 6; i++) {
            cln_camera truth = camera_of(i, 6, 0.3), now;
            cln_space space = cln_space_unit;
            double before = 0, after = 0;
            cln_pose_step step;

            if (kind == 1)
                truth.k1 = -0.2;
            if (kind == 2)
                space.half = 2.5;
            now = truth;
            shake(i, now.c2w, truth.c2w);
            before = apart(&truth, truth.c2w, now.c2w);
            for (int round = 0; round < 20; round++) {
                look(&truth, &now, spots, looks);
                for (int s = 0; s < SPOTS; s++) {
                    for (int a = 0; a < 3 && kind == 2; a++) /* less light */
                        spots[s].photo[a] *= 0.85f;
                    if (kind == 3 && s % 10 == 0) /* something stood there for that photo */
                        spots[s].photo[0] = spots[s].photo[1] = spots[s].photo[2] = 0;
                    for (int k = 0; k < CLN_SPOT_LOOKS; k++)
                        looks[s][k].depth /= (float)space.half;
                }
                assert_true(cln_refine_solve(&now, &space, SPOTS, spots,
                                             (const cln_ray_result(*)[CLN_SPOT_LOOKS])looks,
                                             &step));
                cln_motion_apply(now.c2w, step.motion, now.c2w);
            }
            after = apart(&truth, truth.c2w, now.c2w);
            if (!(before > 0.3 && after < 0.1 * before))
                fail_msg("kind %d, view %d: off by %.4f pixels, then %.5f", kind, i, before, after);
        }
}

/* No step: without anything opaque, without spots, and with nothing that moves in the picture. */
static void test_no_step(void **state)
{
    cln_spot spots[SPOTS];
    cln_ray_result looks[SPOTS][CLN_SPOT_LOOKS];
    const cln_camera c = camera_of(0, 6, 0);
    cln_pose_step step;

    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        look(&c, &c, spots, looks);
        for (int s = 0; s < SPOTS; s++)
            for (int k = 0; k < CLN_SPOT_LOOKS; k++) {
                if (kind == 0)
                    looks[s][k].opacity = 0;
                if (kind == 1)
                    spots[s].x = -1;
                if (kind == 2)
                    looks[s][k].r = looks[s][k].g = looks[s][k].b = 0.5f;
            }
        assert_false(cln_refine_solve(&c, &cln_space_unit, SPOTS, spots,
                                      (const cln_ray_result(*)[CLN_SPOT_LOOKS])looks, &step));
    }
}

/* Only as many spots count as it is given: another one behind them changes no bit. */
static void test_given_spots(void **state)
{
    cln_spot spots[SPOTS];
    cln_ray_result looks[SPOTS][CLN_SPOT_LOOKS];
    const cln_ray_result(*const seen_there)[CLN_SPOT_LOOKS] = (const void *)looks;
    const cln_camera truth = camera_of(0, 6, 0.3);
    cln_camera now = truth;
    cln_pose_step step, other;
    int last = SPOTS - 1;

    (void)state;
    shake(0, now.c2w, truth.c2w);
    look(&truth, &now, spots, looks);
    while (spots[last].x < 0 || looks[last][0].opacity < 1)
        last--;
    assert_true(cln_refine_solve(&now, &cln_space_unit, last, spots, seen_there, &step));
    for (int a = 0; a < 3; a++)
        spots[last].photo[a] = 1 - spots[last].photo[a];
    assert_true(cln_refine_solve(&now, &cln_space_unit, last, spots, seen_there, &other));
    assert_memory_equal(step.motion, other.motion, sizeof step.motion);
    assert_true(cln_refine_solve(&now, &cln_space_unit, last + 1, spots, seen_there, &other));
    assert_memory_not_equal(step.motion, other.motion, sizeof step.motion);
}

/* What spots say of a step. So many get nearer to the photo, the others as much farther from it. */
typedef struct checked {
    cln_spot spots[SPOTS / 2];
    cln_ray_result before[SPOTS / 2], after[SPOTS / 2];
} checked;

static void put_checked(checked *c, int better, float gain)
{
    for (int i = 0; i < SPOTS / 2; i++) {
        const float here = i < better ? 0.65f : 0.55f, there = 1.2f - here;

        c->spots[i] = (cln_spot){0, 1, {0.5f * gain, 0.5f * gain, 0.5f * gain}};
        c->before[i] = (cln_ray_result){.r = here, .g = here, .b = here};
        c->after[i] = (cln_ray_result){.r = there, .g = there, .b = there};
    }
}

static bool agree(const checked *c, double gain)
{
    const cln_pose_step step = {.scale = 0.1, .gain = {gain, gain, gain}};

    return cln_refine_is_better(SPOTS / 2, c->spots, c->before, c->after, &step);
}

/* Not by chance: of 192 spots 96 would get nearer, with a standard error of 7. */
static void test_checked(void **state)
{
    static const struct {
        int better;
        bool agree;
    } cases[] = {{0, false}, {72, false}, {96, false}, {106, false}, {120, true}, {192, true}};
    checked c;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int bright = 0; bright < 2; bright++) { /* or a brighter photo of the same */
            put_checked(&c, cases[i].better, bright ? 1.5f : 1);
            if (agree(&c, bright ? 1.5 : 1) != cases[i].agree)
                fail_msg("%d spots of a photo %d get nearer", cases[i].better, bright);
        }
    put_checked(&c, 106, 1);
    for (int i = 106; i < 140; i++) /* spots that are not there say nothing */
        c.spots[i].x = -1;
    assert_true(agree(&c, 1));
    put_checked(&c, 120, 1);
    for (int i = 0; i < 30; i++)
        c.spots[i].x = -1;
    assert_false(agree(&c, 1));
    for (int i = 0; i < SPOTS / 2; i++)
        c.spots[i].x = -1;
    assert_false(agree(&c, 1));
    put_checked(&c, 188, 1);
    for (int i = 188; i < 192; i++) /* and a few that are entirely wrong little */
        c.after[i].r = c.after[i].g = c.after[i].b = 9;
    assert_true(agree(&c, 1));
    memcpy(c.after, c.before, sizeof c.after);
    assert_false(agree(&c, 1));
}

/* ---- a training ---- */

static void put_split(const char *folder, const char *split, int count, double phase, bool shaken)
{
    uint8_t rgba[WIDE * WIDE * 4];
    json_t *frames = json_array(), *document = NULL;
    char name[64], path[PATH_MAX + 64], *text = NULL;

    snprintf(path, sizeof path, "%s/%s", folder, split);
    assert_ok(cln_make_dirs(path));
    for (int i = 0; i < count; i++) {
        cln_camera c = camera_of(i, count, phase);
        json_t *rows = json_array();
        double m[12];

        for (int k = 0; k < WIDE * WIDE; k++) {
            const cln_ray_result r = seen(&c, k % WIDE, k / WIDE);

            const float over[3] = {r.r, r.g, r.b}; /* white */

            for (int a = 0; a < 3; a++)
                rgba[4 * k + a] =
                    r.opacity > 0 ? cln_to_u8((over[a] - 1 + r.opacity) / r.opacity) : 0;
            rgba[4 * k + 3] = cln_to_u8(r.opacity);
        }
        memcpy(m, c.c2w, sizeof m);
        if (shaken)
            shake(i, m, c.c2w);
        for (int a = 0; a < 3; a++)
            json_array_append_new(
                rows, json_pack("[f,f,f,f]", m[4 * a], -m[4 * a + 1], -m[4 * a + 2], m[4 * a + 3]));
        json_array_append_new(rows, json_pack("[i,i,i,i]", 0, 0, 0, 1));
        snprintf(name, sizeof name, "./%s/r_%02d", split, i);
        json_array_append_new(frames,
                              json_pack("{s:s, s:o}", "file_path", name, "transform_matrix", rows));
        snprintf(path, sizeof path, "%s/%s.png", folder, name + 2);
        assert_ok(cln_image_write_png(path, WIDE, WIDE, 4, rgba));
    }
    document =
        json_pack("{s:f, s:o}", "camera_angle_x", 2 * atan(WIDE / 2.0 / FOCAL), "frames", frames);
    text = json_dumps(document, 0);
    snprintf(path, sizeof path, "%s/transforms_%s.json", folder, split);
    scratch_put(path, text, strlen(text));
    free(text);
    json_decref(document);
}

static cln_config settings(bool refine)
{
    cln_config config = fixture_config();

    config.start_level = 2;
    config.bands = 4;
    config.rays = 512;
    config.batch_samples = 8192;
    config.log_every = 50;
    config.steps = 700;
    config.refine_poses = refine;
    return config;
}

/* Mean distance, in pixels, of a run's training poses from the true ones. */
static double off(const char *run)
{
    const bool pixels[CLN_SPLITS] = {false};
    cln_open_run v;
    double sum = 0;

    assert_ok(cln_open_run_open(fixture_path(run), NULL, pixels, NULL, &v));
    for (int i = 0; i < VIEWS; i++) {
        const cln_camera *c =
            &v.scene->views[cln_scene_split_view(v.scene, CLN_SPLIT_TRAIN, i)].camera;
        const cln_camera truth = camera_of(i, VIEWS, 0);

        sum += apart(&truth, truth.c2w, c->c2w) / VIEWS;
    }
    for (int i = 0; i < HELD; i++) { /* they stay where they are */
        const cln_camera *c =
            &v.scene->views[cln_scene_split_view(v.scene, CLN_SPLIT_TEST, i)].camera;
        const cln_camera truth = camera_of(i, HELD, 0.37);

        assert_true(apart(&truth, truth.c2w, c->c2w) < 1e-9);
    }
    cln_open_run_close(&v);
    return sum;
}

static void test_shaken(void **state)
{
    const cln_config plain = settings(false), refined = settings(true);
    cln_train_result without, with;
    double before = 0, after = 0;

    (void)state;
    NEED_DEVICE();
    assert_ok(fixture_train("plain", false, &plain, NULL, &without));
    assert_ok(fixture_train("refined", false, &refined, NULL, &with));
    before = off("plain");
    after = off("refined");
    print_message("poses off by %.3f pixels, refined %.3f; test PSNR %.2f, %.2f\n", before, after,
                  without.psnr_test, with.psnr_test);
    assert_true(before > 0.4);
    assert_true(after < 0.5 * before);
    assert_true(with.psnr_test > without.psnr_test + 0.5);
}

/* Stopped after poses have moved and resumed, it has the same bits; not with other settings. */
static void test_resumed(void **state)
{
    cln_config config = settings(true);
    fixture_stop stop = {.signal = SIGINT, .step = 200};
    cln_train_result whole, part;
    float motions[VIEWS][CLN_MOTION];
    cln_model model = {0};

    NEED_DEVICE();
    config.steps = 270;
    assert_ok(fixture_train("short", false, &config, NULL, &whole));
    assert_fails(fixture_train("cut", false, &config, &stop, &part), CLN_SIGINT, "");
    assert_ok(fixture_train("cut", true, &config, NULL, &part));
    assert_int_equal(part.digest, whole.digest);
    assert_ok(cln_checkpoint_read(fixture_path("short"), false, &model));
    assert_int_equal(model.motion_views, VIEWS);
    memcpy(motions, model.motions, sizeof motions);
    cln_model_free(&model);
    assert_ok(cln_checkpoint_read(fixture_path("cut"), true, &model));
    assert_memory_equal(motions, model.motions, sizeof motions);
    cln_model_free(&model);
    assert_true(motions[1][0] != 0);
    config.steps = 300;
    config.refine_poses = false;
    assert_fails(fixture_train("cut", true, &config, NULL, &part), CLN_CHECKPOINT, "refine-poses");
}

/* Have cameras moved when a training of this many steps is stopped after its 64th? */
static bool moved_at_64(const char *run, int64_t steps)
{
    fixture_stop stop = {.signal = SIGINT, .step = 65};
    cln_config config = settings(true);
    cln_train_result result;
    cln_model model = {0};
    bool moved = false;

    config.steps = steps;
    assert_fails(fixture_train(run, false, &config, &stop, &result), CLN_SIGINT, "");
    assert_ok(cln_checkpoint_read(fixture_path(run), true, &model));
    assert_int_equal(model.motion_views, VIEWS);
    for (int i = 0; i < VIEWS; i++)
        moved |= model.motions[i][0] != 0;
    cln_model_free(&model);
    return moved;
}

/* They first move in the 64th step, if that is a twentieth of the training. */
static void test_begins(void **state)
{
    (void)state;
    NEED_DEVICE();
    assert_true(moved_at_64("soon", 1270));
    assert_false(moved_at_64("late", 1290));
}

static int setup(void **state)
{
    char path[PATH_MAX];

    if (fixture_setup_folder(state) != 0)
        return -1;
    snprintf(path, sizeof path, "%s/scene", fixture_folder);
    put_split(path, "train", VIEWS, 0, true);
    put_split(path, "test", HELD, 0.37, false);
    return 0;
}

/* The camera that was corrected far more than the others is named, of eight and more. */
static void test_outlier(void **state)
{
    enum { CAMERAS = 9 };
    static const struct {
        int count, index;
        float others, most; /* degrees */
    } cases[] = {{9, 4, 0.01f, 0.2f},  {9, -1, 0.05f, 0.2f}, {9, -1, 0.001f, 0.02f},
                 {7, -1, 0.01f, 0.2f}, {9, 4, 0, 0.2f},      {0, -1, 0, 0}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        float motions[CAMERAS][CLN_MOTION] = {{0}};
        const cln_model model = {.motions = motions, .motion_views = cases[i].count};
        double median = 0;

        for (int k = 0; k < CAMERAS; k++)
            motions[k][k % 3] = (k == 4 ? cases[i].most : cases[i].others) * (float)M_PI / 180;
        assert_int_equal(cln_refine_outlier(&model, &median), cases[i].index);
        if (cases[i].count == CAMERAS)
            assert_near(median, (double)cases[i].others, 1e-6);
    }
}

int test_group_refine(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_outlier), cmocka_unit_test(test_steps),
        cmocka_unit_test(test_no_step), cmocka_unit_test(test_given_spots),
        cmocka_unit_test(test_checked), cmocka_unit_test(test_shaken),
        cmocka_unit_test(test_resumed), cmocka_unit_test(test_begins),
    };

    return cmocka_run_group_tests_name("refine", tests, setup, fixture_teardown);
}
