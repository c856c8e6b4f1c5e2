/* Rays in a shell space, on the device, against float64: their lines are the host's (space.h), also
 * from a near distance on; leaves, counts, places and rows of samples are the reference's; networks
 * get the place and direction that the scene's ray has there; depths are distances in the scene;
 * cropped rays are what is inside a box of the scene; cells are in view where cameras see them;
 * rays are pulled to known points where they pass nearest to these. */
#include "unit.h"
#include "device_test.h"
#include "sampling_test.h"
#include "tests.h"

enum { VIEWS = 6, RAYS = 360, WIDTH = 60, HEIGHT = 40 };

static const cln_space space = {.centre = {3, -2, 0.5}, .half = 1.5, .shell = true};

/* In the core, looking out; just outside, looking in and along the cube; far away; and far beyond
 * an edge. */
static const double poses[VIEWS][6] = {
    {0.1, -0.2, 0.3, 0.9, 0.2, -0.1}, {-0.5, 0.6, 0.05, -0.2, 1, 0.7},
    {2.1, 0.3, -0.4, -1, 0.1, 0.15},  {0.2, -3, 1.2, 0.4, 0.6, 0.31},
    {-9, 7, 12.5, 0.62, -0.5, -0.83}, {1.5, 1.45, -1.4, -0.3, -0.8, 0.35},
};

static void make_camera(int v, cln_camera *c)
{
    const double *eye = poses[v], *ahead = poses[v] + 3;
    const double length = sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2]);
    const double across = hypot(ahead[0], ahead[1]);
    double right[3] = {-ahead[1] / across, ahead[0] / across, 0}, z[3];

    memset(c, 0, sizeof *c);
    for (int a = 0; a < 3; a++)
        z[a] = ahead[a] / length;
    for (int a = 0; a < 3; a++) {
        c->c2w[4 * a] = right[a];
        c->c2w[4 * a + 1] =
            z[(a + 1) % 3] * right[(a + 2) % 3] - z[(a + 2) % 3] * right[(a + 1) % 3];
        c->c2w[4 * a + 2] = z[a];
        c->c2w[4 * a + 3] = space.centre[a] + space.half * eye[a];
    }
    c->width = WIDTH;
    c->height = HEIGHT;
    c->fx = c->fy = 0.4 * WIDTH; /* wide */
    c->cx = 0.5 * WIDTH + 0.13;
    c->cy = 0.5 * HEIGHT - 0.17;
}

static void make_pixels(cln_pixel pixels[RAYS])
{
    for (int r = 0; r < RAYS; r++)
        pixels[r] = (cln_pixel){.view = (uint32_t)(r % VIEWS),
                                .x = (uint32_t)test_uniform(40, r, 0, WIDTH),
                                .y = (uint32_t)test_uniform(41, r, 0, HEIGHT)};
}

typedef struct rays {
    cln_pipeline *p;
    cln_config config;
    cln_camera cameras[VIEWS];
    cln_pixel pixels[RAYS];
    float (*o)[4], (*d)[4]; /* [ray][CLN_LINE_ROWS] */
} rays;

static cln_config config_of(void)
{
    cln_config config = small_config();

    config.n1 = 5;
    config.start_level = 2;
    return config;
}

static void make_rays(int set, double near, rays *out)
{
    const float white[4] = {1, 1, 1, 1};
    const cln_camera *list[VIEWS];
    const size_t bytes = sizeof(float[4]) * RAYS * CLN_LINE_ROWS;

    out->config = config_of();
    out->config.near = near;
    out->p = test_pipeline_in(&tune_sets[set], &out->config, 0, false, &space);
    for (int v = 0; v < VIEWS; v++) {
        make_camera(v, &out->cameras[v]);
        list[v] = &out->cameras[v];
    }
    make_pixels(out->pixels);
    assert_ok(cln_pipeline_cameras(out->p, list, VIEWS, &space));
    assert_ok(cln_pipeline_batch(out->p, out->pixels, RAYS, NULL, white));
    test_fill(out->p->device, &out->p->ray_o, NULL, bytes);
    test_fill(out->p->device, &out->p->ray_d, NULL, bytes);
    assert_ok(cln_stage_rays(out->p, RAYS));
    out->o = test_read(out->p->device, &out->p->ray_o, bytes, "ray_o");
    out->d = test_read(out->p->device, &out->p->ray_d, bytes, "ray_d");
}

static void free_rays(rays *r)
{
    free(r->o);
    free(r->d);
}

static void ray_of(const rays *b, int r, double o[3], double d[3])
{
    assert_true(cln_camera_ray(&b->cameras[b->pixels[r].view], b->pixels[r].x + 0.5,
                               b->pixels[r].y + 0.5, o, d));
}

/* The host's line at t, its end included. */
static const cln_space_line *line_at(const cln_space_line *lines, int count, double t)
{
    int k = 0;

    while (k + 1 < count && t >= lines[k + 1].begin)
        k++;
    return &lines[k];
}

static void check_lines(const rays *b, int r, double near)
{
    const float(*rows)[4] = (const float(*)[4])b->o + r * CLN_LINE_ROWS;
    const float(*along)[4] = (const float(*)[4])b->d + r * CLN_LINE_ROWS;
    cln_space_line lines[CLN_SPACE_LINES];
    double o[3], d[3], end = 0;
    int count = 0, rest = 1;

    ray_of(b, r, o, d);
    count = cln_space_lines(&space, o, d, near, lines);
    for (int a = 0; a < 3; a++) { /* row 0: the scene's ray */
        assert_true(fabs((double)rows[0][a] - (o[a] - space.centre[a]) / space.half) < 2e-6);
        assert_true(fabs((double)along[0][a] - d[a]) < 2e-6);
    }
    assert_true(along[0][3] == 0 && rows[0][3] == 0);
    for (; rest < CLN_LINE_ROWS && rows[rest][3] < 1e30f; rest++) {
        assert_true(fabs((double)rows[rest][3] - end) < 1e-6);
        end = (double)along[rest][3];
        assert_true(end > (double)rows[rest][3]);
    }
    assert_true(fabs(end - lines[count - 1].end) < 1e-5);
    for (; rest < CLN_LINE_ROWS; rest++)
        assert_true(rows[rest][3] >= 1e30f);
    for (int k = 0; k < 40; k++) {
        const double t = (k + 0.5) / 40 * end;
        const cln_space_line *line = line_at(lines, count, t);
        int row = 1;

        if (fmin(t - line->begin, line->end - t) < 2e-5)
            continue;
        while (row + 1 < CLN_LINE_ROWS && (double)rows[row + 1][3] <= t)
            row++;
        for (int a = 0; a < 3; a++) {
            const double want = line->origin[a] + t * line->direction[a];
            const double got = (double)rows[row][a] + t * (double)along[row][a];

            if (!(fabs(got - want) < 1e-5))
                fail_msg("view %u, ray %d at %g: %.9g, not %.9g", b->pixels[r].view, r, t, got,
                         want);
        }
    }
}

static void test_lines(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        for (int near = 0; near < 2; near++) {
            rays b;

            if (near && set % 4)
                continue;
            make_rays(set, 0.4 * near, &b);
            for (int r = 0; r < RAYS; r++)
                check_lines(&b, r, 0.4 * near);
            free_rays(&b);
        }
}

/* ---- samples ---- */

typedef struct shell_run {
    rays b;
    cln_model model;
    float *boxes, *cache;
    ref_gather_cache gather;
    ray_source from;
    device_samples got;
} shell_run;

static void run_shell(int set, bool whole, const float (*crop)[4], shell_run *s)
{
    const int n1 = config_of().n1, cells = n1 * n1 * n1;

    memset(s, 0, sizeof *s);
    make_rays(set, 0, &s->b);
    assert_ok(cln_model_create_shell(&s->b.config, &s->model));
    s->model.space = space;
    if (!whole)
        vary_sampling_model(&s->b.config, &s->model);
    assert_ok(cln_octree_boxes(&s->model.tree, &s->boxes));
    s->cache = test_alloc((size_t)(s->model.tree.leaf_count * cells), sizeof *s->cache);
    for (int i = 0; i < s->model.tree.leaf_count * cells; i++)
        s->cache[i] = ref_from_bf16(s->model.density[i]);
    s->gather = (ref_gather_cache){.n1 = n1, .boxes = s->boxes, .cache = s->cache};
    s->from = (ray_source){.tree = &s->model.tree,
                           .config = &s->b.config,
                           .sampling = {.jitter = true,
                                        .uniform_share = 0.25f,
                                        .empty_weight = whole ? 0 : 1e-3f,
                                        .empty_share = whole ? 1 : 0.25f,
                                        .min_transmittance = whole ? 0 : 1e-3f,
                                        .seed = 0x123456789ull,
                                        .step = 17,
                                        .max_samples = 1 << 20,
                                        .crop = crop},
                           .points = ref_gather_points,
                           .user = &s->gather,
                           .lines = true};
    assert_ok(cln_pipeline_upload(s->b.p, &s->model, false));
    if (crop)
        assert_ok(cln_pipeline_want(s->b.p, CLN_PROGRAM_BIT(sampling_crop)));
    run_stage(s->b.p, RAYS, &s->from.sampling, &s->got);
}

static void free_shell(shell_run *s)
{
    device_samples_free(&s->got);
    cln_model_free(&s->model);
    free(s->boxes);
    free(s->cache);
    free_rays(&s->b);
}

static void test_samples(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        shell_run s;

        run_shell(set, false, NULL, &s);
        assert_true(s.got.n > RAYS);
        compare_samples(tune_sets[set].name, &s.from, &s.got, s.b.o, s.b.d, 0.15);
        free_shell(&s);
    }
    test_report("samples of rays in a shell");
}

/* In a tree without holes, samples fill the whole of every ray. */
static void test_whole(void **state)
{
    shell_run s;

    (void)state;
    run_shell(2, true, NULL, &s);
    for (int r = 0; r < RAYS; r++) {
        cln_space_line lines[CLN_SPACE_LINES];
        double o[3], d[3], filled = 0;

        ray_of(&s.b, r, o, d);
        for (uint32_t i = s.got.starts[r]; i < s.got.starts[r + 1]; i++)
            filled += (double)s.got.samples[i].delta;
        filled -= lines[cln_space_lines(&space, o, d, 0, lines) - 1].end;
        if (!(fabs(filled) < 3e-4))
            fail_msg("ray %d: samples cover %g more than the ray is long", r, filled);
    }
    free_shell(&s);
}

/* ---- a box of the scene ---- */

/* Where the ray is inside the box, in the scene's distance; false if it is not. */
static bool inside_box(const double box[6], const double o[3], const double d[3], double *begin,
                       double *end)
{
    *begin = 0;
    *end = INFINITY;
    for (int a = 0; a < 3; a++) {
        const double low = (box[a] - o[a]) / d[a], high = (box[a + 3] - o[a]) / d[a];

        *begin = fmax(*begin, fmin(low, high));
        *end = fmin(*end, fmax(low, high));
    }
    return *begin < *end;
}

/* t of the ray at a distance in the scene. */
static double t_of(const double o[3], const double d[3], double distance)
{
    cln_space_line lines[CLN_SPACE_LINES];
    const int count = cln_space_lines(&space, o, d, 0, lines);
    double best = INFINITY, t = 0;

    for (int k = 0; k < count; k++) {
        double p[3], off = 0, along = 0;

        cln_space_depth_to_cube(&space, o, d, distance / space.half, p);
        for (int a = 0; a < 3; a++)
            along += (p[a] - lines[k].origin[a]) * lines[k].direction[a];
        along = fmax(lines[k].begin, fmin(lines[k].end, along));
        for (int a = 0; a < 3; a++)
            off = hypot(off, lines[k].origin[a] + along * lines[k].direction[a] - p[a]);
        if (off < best) {
            best = off;
            t = along;
        }
    }
    assert_true(best < 1e-9);
    return t;
}

static void test_crop(void **state)
{
    /* in the cube, across its border, and beyond it */
    static const double boxes[3][6] = {{2.2, -3, -0.2, 3.9, -1.3, 1.1},
                                       {2.5, -4.5, -0.7, 6.5, -1.7, 3.1},
                                       {5, -7.5, -4.5, 13, 2.5, 7}};
    int met = 0;

    (void)state;
    for (int k = 0; k < 3; k++)
        for (int set = 0; set < TUNE_SETS; set += 2) {
            float planes[6][4];
            shell_run s;

            cln_space_box_to_planes(&space, boxes[k], planes);
            run_shell(set, true, (const float(*)[4])planes, &s);
            for (int r = 0; r < RAYS; r++) {
                double o[3], d[3], begin = 0, end = 0, filled = 0, want = 0;

                ray_of(&s.b, r, o, d);
                if (inside_box(boxes[k], o, d, &begin, &end))
                    want = t_of(o, d, end) - t_of(o, d, begin);
                for (uint32_t i = s.got.starts[r]; i < s.got.starts[r + 1]; i++)
                    filled += (double)s.got.samples[i].delta;
                met += want > 0;
                if (!(fabs(filled - want) < 3e-4))
                    fail_msg("box %d, ray %d: %g of it inside instead of %g", k, r, filled, want);
            }
            free_shell(&s);
        }
    assert_true(met > 300);
}

/* ---- networks and depths ---- */

static void check_field(int set)
{
    const float white[4] = {1, 1, 1, 1};
    shell_run s;
    cln_ray_result *results = test_alloc(RAYS, sizeof *results);
    cln_pipeline *p = NULL;
    float(*out)[4] = NULL, *got = NULL, depths[RAYS];
    double *want = NULL, want_depths[RAYS];
    uint32_t slices = 0;
    int far = 0;

    (void)white;
    run_shell(set, false, NULL, &s);
    p = s.b.p;
    assert_ok(cln_stage_group(p, s.got.n, &slices));
    assert_ok(cln_stage_forward(p, s.got.n, slices, false, 0));
    assert_ok(cln_stage_composite(p, RAYS, 0));
    out = test_alloc(s.got.n, sizeof *out);
    got = test_alloc(4 * s.got.n, sizeof *got);
    want = test_alloc(4 * s.got.n, sizeof *want);
    assert_ok(cln_buffer_read(p->device, &p->out, 0, out, s.got.n * sizeof *out));
    assert_ok(cln_buffer_read(p->device, &p->results, 0, results, RAYS * sizeof *results));
    for (int r = 0; r < RAYS; r++) {
        cln_space_line lines[CLN_SPACE_LINES];
        double o[3], d[3], values[256][4], t[256], delta[256], at[3], place[3];
        const uint32_t first = s.got.starts[r], n = s.got.starts[r + 1] - first;
        int count = 0;

        assert_true(n <= 256);
        ray_of(&s.b, r, o, d);
        count = cln_space_lines(&space, o, d, 0, lines);
        for (uint32_t i = 0; i < n; i++) {
            const cln_sample *sample = &s.got.samples[first + i];
            const float *box = s.boxes + 4 * sample->slot;
            const ref_network net = cln_check_network(&s.b.config, &s.model, sample->slot);
            const cln_space_line *line = line_at(lines, count, (double)sample->t);
            double local[3];

            t[i] = (double)sample->t;
            delta[i] = (double)sample->delta;
            for (int a = 0; a < 3; a++)
                local[a] = 2 * (line->origin[a] + t[i] * line->direction[a] - (double)box[a]) /
                               (double)box[3] -
                           1;
            ref_forward(&net, s.model.params + sample->slot * p->net.params, local, d, NULL,
                        (s.b.config.rrelu_lower + s.b.config.rrelu_upper) / 2, values[i]);
            for (int k = 0; k < 4; k++) {
                got[4 * (first + i) + (uint32_t)k] = out[first + i][k];
                want[4 * (first + i) + (uint32_t)k] = values[i][k];
            }
        }
        want_depths[r] = ref_median_depth((int)n, (const double(*)[4])values, t, delta);
        /* as a place of the cube: depths end at infinity */
        {
            const cln_space_line *line = line_at(lines, count, want_depths[r]);

            for (int a = 0; a < 3; a++)
                place[a] = line->origin[a] + want_depths[r] * line->direction[a];
            cln_space_depth_to_cube(&space, o, d, (double)results[r].depth, at);
            depths[r] = 0;
            for (int a = 0; a < 3 && n > 0; a++)
                depths[r] = (float)hypot((double)depths[r], at[a] - place[a]);
            want_depths[r] = 0;
            far += (double)results[r].depth > 5;
        }
        if (!(depths[r] < 2e-4f))
            fail_msg("ray %d: depth %g is %g off", r, (double)results[r].depth, (double)depths[r]);
    }
    assert_true(far > 10);
    compare("networks in a shell", got, want, 4 * s.got.n, (bounds){1e-8, 1e-3});
    free(results);
    free(out);
    free(got);
    free(want);
    free_shell(&s);
}

static void test_field(void **state)
{
    (void)state;
    check_field(0);
    check_field(4);
}

/* ---- cells ---- */

/* Is the place in the picture? 1 or 0; -1 near the picture's border. */
static int in_picture(const cln_camera *c, const double at[3])
{
    double q[3] = {0}, u = 0, v = 0;

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            q[k] += c->c2w[4 * a + k] * (at[a] - c->c2w[4 * a + 3]);
    if (q[2] < 0)
        return 0;
    u = c->fx * q[0] / q[2] + c->cx;
    v = c->fy * q[1] / q[2] + c->cy;
    if (u < -0.1 || v < -0.1 || u > WIDTH + 0.1 || v > HEIGHT + 0.1)
        return 0;
    return u > 0.1 && v > 0.1 && u < WIDTH - 0.1 && v < HEIGHT - 0.1 ? 1 : -1;
}

/* Cells around the core are in view where the camera sees their places in the scene. */
static void test_points(void **state)
{
    const cln_config config = config_of();
    const int n1 = config.n1, cells = n1 * n1 * n1;
    cln_pipeline *p = test_pipeline_in(&tune_sets[0], &config, 0, false, &space);
    cln_model model;
    float *boxes = NULL;
    int inside = 0, outside = 0;

    (void)state;
    assert_ok(cln_pipeline_want(p, CLN_PROGRAM_BIT(stats)));
    assert_ok(cln_model_create_shell(&config, &model));
    assert_ok(cln_pipeline_upload(p, &model, false));
    assert_ok(cln_octree_boxes(&model.tree, &boxes));
    for (int v = 0; v < VIEWS; v++) {
        const size_t all = (size_t)(model.tree.leaf_count * cells);
        const cln_camera *list = NULL;
        cln_camera camera;
        uint8_t *seen = NULL;

        make_camera(v, &camera);
        list = &camera;
        assert_ok(cln_pipeline_cameras(p, &list, 1, &space));
        p->training_views = 1;
        test_fill(p->device, &p->seen, NULL, all);
        assert_ok(cln_stage_seen(p));
        seen = test_read(p->device, &p->seen, all, "seen");
        for (int i = 0; i < (int)all; i++) {
            const int xyz[3] = {i % n1, i / n1 % n1, i % cells / (n1 * n1)};
            const float *box = boxes + 4 * (i / cells);
            double at[3], cube[3];
            int want = 0;

            for (int a = 0; a < 3; a++)
                cube[a] = box[a] + (xyz[a] + 0.5) / n1 * (double)box[3];
            cln_space_point_to_scene(&space, cube, at);
            want = in_picture(&camera, at);
            if (want >= 0 && seen[i] != want)
                fail_msg("view %d: %g %g %g is %s the picture", v, at[0], at[1], at[2],
                         want ? "in" : "not in");
            for (int a = 0; a < 3; a++) /* of those around the core */
                if (fabs(cube[a]) > 0.5) {
                    inside += want == 1;
                    outside += want == 0;
                    break;
                }
        }
        free(seen);
    }
    assert_true(inside > 1000 && outside > 1000);
    free(boxes);
    cln_model_free(&model);
}

/* How far the ray is from a point at t: where one line ends and the next begins elsewhere, by the
 * nearer of the two. *end: of the whole ray. */
static double gap_at(const rays *b, int r, const float point[4], double t, double *end)
{
    const float(*o)[4] = (const float(*)[4])b->o + r * CLN_LINE_ROWS;
    const float(*d)[4] = (const float(*)[4])b->d + r * CLN_LINE_ROWS;
    double least = INFINITY;

    for (int row = 1; row < CLN_LINE_ROWS && o[row][3] < 1e30f; row++) {
        double square = 0;

        *end = (double)d[row][3];
        for (int a = 0; a < 3; a++)
            square += pow((double)o[row][a] + t * (double)d[row][a] - (double)point[a], 2);
        if (t > (double)o[row][3] - 1e-5 && t < (double)d[row][3] + 1e-5)
            least = fmin(least, sqrt(square));
    }
    return least;
}

/* A ray that shows a known point is pulled to where it passes nearest to that, on one of its lines:
 * not where a line would pass that has ended before. Told by the loss of an opaque sample at 0. */
static void test_known_points(void **state)
{
    enum { TRIALS = 4, PLACES = 2000 };
    const float black[4] = {0};
    cln_config config = config_of();
    cln_sample samples[RAYS];
    uint32_t starts[RAYS + 1];
    float out[RAYS][4], targets[RAYS][4], shown[RAYS][4];
    const size_t bytes = sizeof(float[4]) * RAYS * CLN_LINE_ROWS;
    cln_pipeline *p = NULL;
    int beyond = 0;
    rays b;

    (void)state;
    make_rays(0, 0, &b);
    config.depth_loss = 0.5;
    config.opacity_entropy = config.cauchy = config.distortion_loss = config.alpha_loss = 0;
    p = test_pipeline_in(&tune_sets[0], &config, 0, false, &space);
    for (int trial = 0; trial < TRIALS; trial++) {
        cln_ray_result *results = NULL;

        for (int r = 0; r < RAYS; r++) {
            const float(*o)[4] = (const float(*)[4])b.o + r * CLN_LINE_ROWS;
            const float(*d)[4] = (const float(*)[4])b.d + r * CLN_LINE_ROWS;
            const bool ends = trial % 2 && o[2][3] < 1e30f; /* behind the first line's end */

            starts[r] = (uint32_t)r;
            samples[r] = (cln_sample){.delta = 1, .ray = (uint32_t)r};
            for (int a = 0; a < 3; a++) {
                out[r][a] = targets[r][a] = 0.5f;
                shown[r][a] = ends ? o[1][a] + (d[1][3] + 0.2f) * d[1][a]
                                   : (float)test_uniform(44 + trial, 3 * r + a, -1, 1);
            }
            out[r][3] = 1e6f;
            targets[r][3] = 1;
            shown[r][3] = 1;
            beyond += ends;
        }
        starts[RAYS] = RAYS;
        test_fill(p->device, &p->sample_starts, starts, sizeof starts);
        test_fill(p->device, &p->samples, samples, sizeof samples);
        test_fill(p->device, &p->out, out, sizeof out);
        test_fill(p->device, &p->targets, targets, sizeof targets);
        test_fill(p->device, &p->backgrounds, black, sizeof black);
        test_fill(p->device, &p->ray_o, b.o, bytes);
        test_fill(p->device, &p->ray_d, b.d, bytes);
        test_fill(p->device, &p->shown, shown, sizeof shown);
        test_fill(p->device, &p->results, NULL, RAYS * sizeof *results);
        test_fill(p->device, &p->dout, NULL, sizeof out);
        assert_ok(cln_stage_composite_train(p, RAYS, RAYS));
        results = test_read(p->device, &p->results, RAYS * sizeof *results, "results");
        for (int r = 0; r < RAYS; r++) {
            const double reach = (double)results[r].loss / config.depth_loss;
            double end = 0, least = INFINITY, gap = gap_at(&b, r, shown[r], reach, &end);

            for (int k = 0; k <= PLACES; k++)
                least = fmin(least, gap_at(&b, r, shown[r], end * k / PLACES, &end));
            if (!(gap < least + 1e-4))
                fail_msg("ray %d: %g off at %g of %g, %g at least", r, gap, reach, end, least);
        }
        free(results);
    }
    assert_true(beyond > RAYS);
    free_rays(&b);
}

int test_group_shell_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines),        cmocka_unit_test(test_samples),
        cmocka_unit_test(test_whole),        cmocka_unit_test(test_crop),
        cmocka_unit_test(test_field),        cmocka_unit_test(test_points),
        cmocka_unit_test(test_known_points),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(sampling) |
                  CLN_PROGRAM_BIT(group) | CLN_PROGRAM_BIT(mlp_forward_eval) |
                  CLN_PROGRAM_BIT(composite);
    return cmocka_run_group_tests_name("shell rays", tests, NULL, test_device_close);
}
