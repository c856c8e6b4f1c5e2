/* sampling.cl with stage 1 by gather, against the float64 reference: leaves along a ray, counts,
 * positions, deltas; random rays, and rays along axes, faces, edges and corners, from inside a leaf
 * and past the cube; cutting a too large batch. */
#include "unit.h"
#include "device_test.h"
#include "sampling_test.h"
#include "tests.h"

typedef struct sampling_case {
    const char *name;
    int set, allocate, cdf, n1;
    bool jitter;
    double uniform_share, min_transmittance, empty_weight, empty_share;
} sampling_case;

enum { CHORD = CLN_ALLOCATE_CHORD, WEIGHT = CLN_ALLOCATE_WEIGHT };

/* n1 is odd: with an even one, midpoints of an interval from face to face fall exactly between
 * cells, where rounding may choose either. */
static const sampling_case cases[] = {
    {"paper", 0, CHORD, CLN_CDF_SIGMA, 7, true, 0.25, 1e-4, 0, 1},
    {"fast", 1, WEIGHT, CLN_CDF_WEIGHT, 7, true, 0.25, 1e-3, 1e-3, 0.25},
    {"chord by weight", 2, CHORD, CLN_CDF_WEIGHT, 3, false, 0.1, 0, 0, 1},
    {"weight by sigma", 3, WEIGHT, CLN_CDF_SIGMA, 5, true, 0.5, 0, 0.05, 1},
    {"rendering", 4, WEIGHT, CLN_CDF_WEIGHT, 9, false, 0.05, 1e-3, 1e-3, 0},
    {"all uniform", 0, WEIGHT, CLN_CDF_WEIGHT, 5, true, 1, 1e-3, 0, 0},
};

static cln_config config_of(const sampling_case *c)
{
    cln_config config = small_config();

    config.allocate = c->allocate;
    config.cdf = c->cdf;
    config.n1 = c->n1;
    return config;
}

static cln_sampling sampling_of(const sampling_case *c)
{
    return (cln_sampling){.jitter = c->jitter,
                          .min_transmittance = (float)c->min_transmittance,
                          .uniform_share = (float)c->uniform_share,
                          .empty_weight = (float)c->empty_weight,
                          .empty_share = (float)c->empty_share,
                          .seed = 0x123456789ull,
                          .step = 17,
                          .max_samples = 1 << 20};
}

/* ---- stage 1 by gather ---- */

/* *cache: the model's densities as floats, which the caller frees. */
static ref_gather_cache make_gather(const cln_model *model, const float *boxes, float **cache)
{
    const int n1 = model->config.n1, cells = n1 * n1 * n1;

    *cache = test_alloc((size_t)(model->tree.leaf_count * cells), sizeof **cache);
    for (int i = 0; i < model->tree.leaf_count * cells; i++)
        (*cache)[i] = ref_from_bf16(model->density[i]);
    return (ref_gather_cache){.n1 = n1, .boxes = boxes, .cache = *cache};
}

/* ---- rays ---- */

enum { RANDOM_RAYS = 400 };

static void unit(const double v[3], float out[4])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    for (int a = 0; a < 3; a++)
        out[a] = (float)(v[a] / length);
    out[3] = 1;
}

static void random_rays(float (*o)[4], float (*d)[4])
{
    for (int r = 0; r < RANDOM_RAYS; r++) {
        double v[3];

        for (int a = 0; a < 3; a++)
            v[a] = test_uniform(1, 3 * r + a, -1, 1);
        unit(v, d[r]);
        for (int a = 0; a < 3; a++) /* some start inside, some miss the cube */
            o[r][a] = (float)(test_uniform(2, 3 * r + a, -0.9, 0.9) * (r % 10 == 9 ? 3 : 1) -
                              (r % 3 ? 3 * (double)d[r][a] : 0));
        o[r][3] = 0;
    }
}

/* Rays without a margin for rounding; their stage-1 cells are not compared. */
static const double special[][6] = {
    {-3, 0.1, 0.2, 1, 0, 0},
    {0.1, 3, 0.2, 0, -1, 0},
    {0.3, 0.3, -9, 0, 0, 1},
    {-3, 0, 0.3, 1, 0, 0},
    {-3, 0, 0, 1, 0, 0},
    {-3, 1, 0.3, 1, 0, 0},
    {-3, -1, 0.3, 1, 0, 0},
    {-3, 1, 1, 1, 0, 0},
    {3, 0.5, -0.5, -1, 0, 0},
    {-2, -2, -2, 1, 1, 1},
    {2, 2, 2, -1, -1, -1},
    {-2, 2, -2, 1, -1, 1},
    {-2, -2, 0.3, 1, 1, 0},
    {-2, -1, 0.3, 1, 1, 0},
    {0, 0, 0, 1, 0, 0},
    {0, 0, 0, -1, 1, -1},
    {0.1, 0.2, 0.3, 0, 0, 1},
    {1, 0.2, 0.3, -1, 0, 0},
    {0.1, 0.2, 0.3, -0.0, 1, -0.0},
    {-3, 0.999999, 0.3, 1, 0, 0},
    {-3, 1.000001, 0.3, 1, 0, 0},
    {-3, 2, 0, 1, 0, 0},
    {2, 0, 0, 1, 0, 0},
    {-3, 0.1, 0.2, 1, 1e-9, -1e-9},
    {0.25, -2, 0.75, 1e-13, 1, 0},
    {-1e4, 0.1, 0.2, 1, 0, 0},
    {0.5, 0.5, 0.5, 1, -1, 1},
};
enum { SPECIAL_RAYS = sizeof special / sizeof special[0] };

/* ---- tests ---- */

/* Samples of random rays, cropped or not, by the device and by the reference. The caller frees all
 * with free_random(). */
typedef struct random_run {
    cln_config config;
    cln_model model;
    ray_source from;
    ref_gather_cache gather;
    device_samples got;
    float (*o)[4], (*d)[4], *boxes, *cache;
} random_run;

static void run_random(const sampling_case *c, const float (*crop)[4], random_run *r)
{
    cln_pipeline *p = NULL;

    memset(r, 0, sizeof *r);
    r->config = config_of(c);
    p = test_pipeline(&tune_sets[c->set], &r->config, false, false);
    r->o = test_alloc(RANDOM_RAYS, sizeof *r->o);
    r->d = test_alloc(RANDOM_RAYS, sizeof *r->d);
    make_sampling_model(&r->config, &r->model);
    assert_ok(cln_octree_boxes(&r->model.tree, &r->boxes));
    r->gather = make_gather(&r->model, r->boxes, &r->cache);
    r->from = (ray_source){.config = &r->config,
                           .sampling = sampling_of(c),
                           .points = ref_gather_points,
                           .tree = &r->model.tree,
                           .user = &r->gather};
    r->from.sampling.crop = crop;
    random_rays(r->o, r->d);
    assert_ok(cln_pipeline_upload(p, &r->model, false));
    if (crop)
        assert_ok(cln_pipeline_want(p, CLN_PROGRAM_BIT(sampling_crop)));
    test_fill(p->device, &p->ray_o, r->o, RANDOM_RAYS * sizeof *r->o);
    test_fill(p->device, &p->ray_d, r->d, RANDOM_RAYS * sizeof *r->d);
    run_stage(p, RANDOM_RAYS, &r->from.sampling, &r->got);
    assert_int_equal(r->got.rays, RANDOM_RAYS);
}

static void free_random(random_run *r)
{
    device_samples_free(&r->got);
    cln_model_free(&r->model);
    free(r->cache);
    free(r->boxes);
    free(r->o);
    free(r->d);
}

static void check_random(const sampling_case *c)
{
    random_run r;

    run_random(c, NULL, &r);
    assert_true(r.got.n > RANDOM_RAYS);
    check_samples(&r.model.tree, &r.got, r.o, r.d);
    compare_samples(c->name, &r.from, &r.got, r.o, r.d, 0.05);
    free_random(&r);
}

static void test_random_rays(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_random(&cases[i]);
    test_report("samples of random rays");
}

/* Splits the leaves on both sides of the cube's centre until there are some of level `deepest`. */
static void deepen(cln_model *model, int deepest)
{
    static const double sides[2][3] = {{1e-3, 1e-3, 1e-3}, {-1e-3, -1e-3, -1e-3}};

    while (cln_octree_depth(&model->tree) < deepest) {
        cln_octree_change change = {0};
        uint8_t *marks = test_alloc((size_t)model->tree.leaf_count, 1);

        memset(marks, 0, (size_t)model->tree.leaf_count);
        for (int i = 0; i < 2; i++)
            marks[cln_octree_find(&model->tree, sides[i])] = 1;
        assert_ok(cln_octree_split(&model->tree, marks, &change));
        assert_ok(cln_model_apply(model, &change));
        cln_octree_change_free(&change);
        free(marks);
    }
}

/* In full trees of all levels, and in deeper ones, exactly the leaves that the reference finds on a
 * special ray have samples. On faces and edges float32 may choose the neighbour; there lengths must
 * agree. */
static void check_special(int set, int level, int deepest)
{
    const sampling_case *c = &cases[0];
    cln_config config = config_of(c);
    cln_sampling sampling = sampling_of(c);
    cln_pipeline *p = NULL;
    float o[SPECIAL_RAYS][4], d[SPECIAL_RAYS][4];
    device_samples got;
    cln_model model;

    config.n1 = 2;
    config.max_level = deepest;
    p = test_pipeline(&tune_sets[set], &config, false, false);
    config.start_level = level;
    sampling.min_transmittance = 0;
    assert_ok(cln_model_create(&config, &model));
    deepen(&model, deepest);
    for (int r = 0; r < SPECIAL_RAYS; r++) {
        unit(special[r] + 3, d[r]);
        for (int a = 0; a < 3; a++)
            o[r][a] = (float)special[r][a];
        o[r][3] = 0;
    }
    assert_ok(cln_pipeline_upload(p, &model, false));
    test_fill(p->device, &p->ray_o, o, sizeof o);
    test_fill(p->device, &p->ray_d, d, sizeof d);
    run_stage(p, SPECIAL_RAYS, &sampling, &got);
    for (int r = 0; r < SPECIAL_RAYS; r++) {
        const double from[3] = {o[r][0], o[r][1], o[r][2]}, along[3] = {d[r][0], d[r][1], d[r][2]};
        ref_interval iv[REF_MOST_INTERVALS];
        const int n = ref_intervals(&model.tree, from, along, iv, REF_MOST_INTERVALS);
        /* float32 resolves a point 1e4 away to 1e-3 */
        const double within = 1e-5 + 2e-7 * fabs(special[r][0]);
        double length = 0, filled = 0;
        int leaves = 0;

        for (int i = 0; i < n; i++)
            length += iv[i].t_out - iv[i].t_in;
        for (uint32_t i = got.starts[r]; i < got.starts[r + 1]; i++) {
            const cln_sample *s = &got.samples[i];

            assert_true(isfinite(s->t) && isfinite(s->delta) && s->delta >= 0);
            assert_true(i == got.starts[r] || s->t >= s[-1].t);
            leaves += i == got.starts[r] || s->slot != s[-1].slot;
            filled += (double)s->delta;
        }
        if (!(fabs(length - filled) <= within * (n + 1)))
            fail_msg("level %d, ray %d: samples cover %.9g of %.9g", deepest, r, filled, length);
        if (leaves != n)
            fail_msg("level %d, ray %d: samples in %d leaves, not %d", deepest, r, leaves, n);
    }
    device_samples_free(&got);
    cln_model_free(&model);
}

static void test_special_rays(void **state)
{
    (void)state;
    for (int level = 0; level <= 5; level++)
        check_special(level % TUNE_SETS, level, level);
    for (int level = 6; level <= CLN_MAX_LEVEL; level++)
        check_special(level % TUNE_SETS, 2, level);
}

/* Rays from corner to corner of cells through a tree full of holes: every step may round to either
 * side of an edge; the walk must end, with samples front to back. */
static void check_corners(int set)
{
    enum { RAYS = 4096 };
    const sampling_case *c = &cases[0];
    cln_config config = config_of(c);
    const cln_sampling sampling = sampling_of(c);
    cln_pipeline *p = NULL;
    float(*o)[4] = test_alloc(RAYS, sizeof *o), (*d)[4] = test_alloc(RAYS, sizeof *d);
    uint8_t *marks = NULL;
    cln_octree_change change = {0};
    device_samples got;
    cln_model model;

    config.start_level = 5;
    config.n1 = 2;
    p = test_pipeline(&tune_sets[set], &config, false, false);
    assert_ok(cln_model_create(&config, &model));
    marks = test_alloc((size_t)model.tree.leaf_count, 1);
    for (int s = 0; s < model.tree.leaf_count; s++)
        marks[s] = test_uniform(3, s, 0, 1) < 0.97;
    assert_ok(cln_octree_cull(&model.tree, marks, &change));
    assert_ok(cln_model_apply(&model, &change));
    for (int r = 0; r < RAYS; r++) {
        double from[3], along[3];

        for (int a = 0; a < 3; a++) {
            from[a] = floor(test_uniform(4, 6 * r + a, 0, 33)) / 16 - 1;
            along[a] = floor(test_uniform(4, 6 * r + 3 + a, 0, 33)) / 16 - 1 - from[a];
        }
        if (along[0] == 0 && along[1] == 0 && along[2] == 0)
            along[0] = 1;
        unit(along, d[r]);
        for (int a = 0; a < 3; a++)
            o[r][a] = (float)(from[a] - 3 * (double)d[r][a]);
        o[r][3] = 0;
    }
    assert_ok(cln_pipeline_upload(p, &model, false));
    test_fill(p->device, &p->ray_o, o, RAYS * sizeof *o);
    test_fill(p->device, &p->ray_d, d, RAYS * sizeof *d);
    run_stage(p, RAYS, &sampling, &got);
    assert_true(got.n > RAYS / 2);
    for (int r = 0; r < RAYS; r++)
        for (uint32_t i = got.starts[r]; i < got.starts[r + 1]; i++) {
            const cln_sample *s = &got.samples[i];

            assert_true(isfinite(s->t) && isfinite(s->delta) && s->delta >= 0);
            assert_true(i == got.starts[r] || s->t >= s[-1].t);
        }
    device_samples_free(&got);
    cln_octree_change_free(&change);
    cln_model_free(&model);
    free(marks);
    free(o);
    free(d);
}

static void test_corners(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        check_corners(set);
}

/* Slots on rays with exact coordinates: axis-parallel ones in the interior, and on faces, where
 * half-open boxes decide. */
static void test_exact_slots(void **state)
{
    const sampling_case *c = &cases[0];
    cln_config config = config_of(c);
    cln_sampling sampling = sampling_of(c);
    cln_pipeline *p = NULL;
    float o[64][4] = {{0}}, d[64][4] = {{0}};
    device_samples got;
    cln_model model;

    (void)state;
    config.n1 = 2;
    p = test_pipeline(&tune_sets[1], &config, false, false);
    config.start_level = 2;
    sampling.min_transmittance = 0;
    for (int r = 0; r < 64; r++) {
        const int axis = r % 3, sign = r / 3 % 2 ? 1 : -1;

        for (int a = 0; a < 3; a++) /* multiples of 1/4 are faces of level 3, of 1/2 of level 2 */
            o[r][a] = a == axis ? (float)(-3 * sign)
                                : (float)(round(test_uniform(5, 3 * r + a, -4, 4)) / 4);
        d[r][axis] = (float)sign;
        d[r][3] = 1;
    }
    assert_ok(cln_model_create(&config, &model));
    assert_ok(cln_pipeline_upload(p, &model, false));
    test_fill(p->device, &p->ray_o, o, sizeof o);
    test_fill(p->device, &p->ray_d, d, sizeof d);
    run_stage(p, 64, &sampling, &got);
    for (int r = 0; r < 64; r++) {
        const double from[3] = {o[r][0], o[r][1], o[r][2]}, along[3] = {d[r][0], d[r][1], d[r][2]};
        ref_interval iv[REF_MOST_INTERVALS];
        const int n = ref_intervals(&model.tree, from, along, iv, REF_MOST_INTERVALS);
        int i = -1;

        assert_int_equal(n, 4);
        for (uint32_t k = got.starts[r]; k < got.starts[r + 1]; k++) {
            i += k == got.starts[r] || got.samples[k].slot != got.samples[k - 1].slot;
            assert_true(i < n);
            assert_int_equal(got.samples[k].slot, iv[i].slot);
        }
        assert_int_equal(i, n - 1);
    }
    device_samples_free(&got);
    cln_model_free(&model);
}

/* A batch that does not fit is cut to its longest prefix of rays that fits, at least one. */
static void test_cut(void **state)
{
    const sampling_case *c = &cases[1];
    const cln_config config = config_of(c);
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    cln_sampling sampling = sampling_of(c);
    float(*o)[4] = test_alloc(RANDOM_RAYS, sizeof *o), (*d)[4] = test_alloc(RANDOM_RAYS, sizeof *d);
    device_samples all, some;
    cln_model model;

    (void)state;
    make_sampling_model(&config, &model);
    random_rays(o, d);
    assert_ok(cln_pipeline_upload(p, &model, false));
    test_fill(p->device, &p->ray_o, o, RANDOM_RAYS * sizeof *o);
    test_fill(p->device, &p->ray_d, d, RANDOM_RAYS * sizeof *d);
    run_stage(p, RANDOM_RAYS, &sampling, &all);
    for (int k = 0; k < 3; k++) {
        sampling.max_samples = k == 0 ? all.n / 2 : k == 1 ? all.n - 1 : 1;
        run_stage(p, RANDOM_RAYS, &sampling, &some);
        assert_true(some.rays >= 1 && some.rays < RANDOM_RAYS);
        assert_int_equal(some.n, all.starts[some.rays]);
        assert_true(some.n <= sampling.max_samples || some.rays == 1);
        assert_true(all.starts[some.rays + 1] > sampling.max_samples);
        assert_memory_equal(some.samples, all.samples, some.n * sizeof *some.samples);
        device_samples_free(&some);
    }
    sampling.max_samples = all.n;
    run_stage(p, RANDOM_RAYS, &sampling, &some);
    assert_int_equal(some.rays, RANDOM_RAYS);
    device_samples_free(&some);
    run_stage(p, 0, &sampling, &some);
    assert_int_equal(some.n, 0);
    device_samples_free(&some);
    /* the first ray alone exceeds the limit: its samples are made nevertheless, in a large enough
     * buffer */
    for (int r = 1; r < RANDOM_RAYS; r++)
        if (all.starts[r + 1] - all.starts[r] > 4) {
            memcpy(o[0], o[r], sizeof o[0]);
            memcpy(d[0], d[r], sizeof d[0]);
        }
    device_samples_free(&all);
    test_fill(p->device, &p->ray_o, o, RANDOM_RAYS * sizeof *o);
    test_fill(p->device, &p->ray_d, d, RANDOM_RAYS * sizeof *d);
    run_stage(p, RANDOM_RAYS, &sampling, &all);
    assert_true(all.starts[1] > 1);
    sampling.max_samples = 1;
    run_stage(p, RANDOM_RAYS, &sampling, &some);
    assert_int_equal(some.rays, 1);
    assert_int_equal(some.n, all.starts[1]);
    assert_memory_equal(some.samples, all.samples, some.n * sizeof *some.samples);
    device_samples_free(&some);
    device_samples_free(&all);
    cln_model_free(&model);
    free(o);
    free(d);
}

/* Rays cropped by six half-spaces: a box with one slanted face. */
static const float box[6][4] = {{1, 0, 0, 0.61f},  {0, 0.8f, 0.6f, 0.33f}, {0, 0, 1, 0.71f},
                                {-1, 0, 0, 0.57f}, {0, -1, 0, 0.83f},      {0, 0, -1, 0.29f}};

static bool is_inside(const double p[3], double margin)
{
    for (int k = 0; k < 6; k++)
        if (!((double)box[k][0] * p[0] + (double)box[k][1] * p[1] + (double)box[k][2] * p[2] +
                  (double)box[k][3] >=
              -margin))
            return false;
    return true;
}

static void check_crop(const sampling_case *c)
{
    random_run r;

    run_random(c, box, &r);
    assert_true(r.got.n > RANDOM_RAYS / 8);
    for (uint32_t i = 0; i < r.got.n; i++) {
        const cln_sample *s = &r.got.samples[i];
        double at[3];

        for (int a = 0; a < 3; a++)
            at[a] = (double)r.o[s->ray][a] + (double)s->t * (double)r.d[s->ray][a];
        if (!is_inside(at, 2e-6))
            fail_msg("%s: a sample of ray %u at %g, %g, %g is outside", c->name, s->ray, at[0],
                     at[1], at[2]);
    }
    compare_samples(c->name, &r.from, &r.got, r.o, r.d, 0.08);
    free_random(&r);
}

static void test_crop(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_crop(&cases[i]);
    test_report("samples of cropped rays");
}

/* Densities in four parts give the same samples. */
static void test_in_parts(void **state)
{
    const sampling_case *c = &cases[0];
    cln_config config = config_of(c);
    const cln_sampling sampling = sampling_of(c);
    cln_pipeline *p = NULL;
    float(*o)[4] = test_alloc(RANDOM_RAYS, sizeof *o), (*d)[4] = test_alloc(RANDOM_RAYS, sizeof *d);
    device_samples whole, parts;
    cln_model model;
    size_t most = 0, row = 0;
    bool in[CLN_PARTS] = {false};

    (void)state;
    config.n1 = 7; /* a separate pipeline */
    p = test_pipeline(&tune_sets[c->set], &config, false, false);
    make_sampling_model(&config, &model);
    random_rays(o, d);
    for (int split = 0; split < 2; split++) {
        if (split) {
            most = p->device->max_alloc;
            row = fmax(4.0 * p->net.params, 2.0 * 7 * 7 * 7);
            p->device->max_alloc = row * cln_groups((size_t)model.tree.leaf_count, CLN_PARTS);
            assert_ok(cln_pipeline_rebuild(p, model.tree.leaf_count));
            p->device->max_alloc = most;
            assert_int_equal(p->parts, CLN_PARTS);
        }
        assert_ok(cln_pipeline_upload(p, &model, false));
        test_fill(p->device, &p->ray_o, o, RANDOM_RAYS * sizeof *o);
        test_fill(p->device, &p->ray_d, d, RANDOM_RAYS * sizeof *d);
        run_stage(p, RANDOM_RAYS, &sampling, split ? &parts : &whole);
    }
    assert_int_equal(parts.n, whole.n);
    assert_memory_equal(parts.samples, whole.samples, whole.n * sizeof *whole.samples);
    for (uint32_t i = 0; i < parts.n; i++)
        in[parts.samples[i].slot / p->part_leaves] = true;
    assert_true(in[0] && in[1] && in[2] && in[3]);
    device_samples_free(&whole);
    device_samples_free(&parts);
    cln_model_free(&model);
    free(o);
    free(d);
}

int test_group_sampling(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random_rays), cmocka_unit_test(test_special_rays),
        cmocka_unit_test(test_corners),     cmocka_unit_test(test_exact_slots),
        cmocka_unit_test(test_cut),         cmocka_unit_test(test_crop),
        cmocka_unit_test(test_in_parts),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(sampling);
    return cmocka_run_group_tests_name("sampling", tests, NULL, test_device_close);
}
