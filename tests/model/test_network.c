/* Layout, initial weights and folding of the leaf network. Tested: blocks of every shape start at
 * multiples of 16 without overlaps or gaps; parameter counts of method.md section 1; weights are
 * uniform within their bounds, padding is zero; the initial density gives the requested depth; a
 * folded child computes the same as its parent, also after four folds. Oracles: counts and
 * constants calculated by hand, and host/reference/ for the network itself. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/rng.h"
#include "model/network.h"
#include "reference/reference.h"
#include "sanitized.h"
#include "tests.h"

static cln_config paper(void)
{
    cln_config config;

    assert_int_equal(cln_config_preset("paper", &config), CLN_OK);
    return config;
}

static cln_config shape(int width, int depth, int view_width, int bands, int view_bands, bool skip)
{
    cln_config config = paper();

    config.width = width;
    config.depth = depth;
    config.view_width = view_width;
    config.bands = bands;
    config.view_bands = view_bands;
    config.skip = skip;
    return config;
}

/* ---- layout ---- */

/* Marks floats [offset, offset + count) as used; they must be unused. */
static void claim(uint8_t *used, int params, int offset, int count)
{
    assert_int_equal(offset % 16, 0);
    assert_true(offset >= 0 && offset + count <= params);
    for (int i = offset; i < offset + count; i++) {
        assert_int_equal(used[i], 0);
        used[i] = 1;
    }
}

static int up(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

static void check_layout(const cln_config *c)
{
    cln_network net;
    int enc = c->encoding == CLN_ENCODING_GRID ? c->grid_features : 3 + 6 * c->bands;
    int dir = 3 + 6 * c->view_bands, w = c->width, v = c->view_width;
    int skip = c->skip && c->depth >= 6 ? c->depth / 2 + 1 : -1, learned = 0, unused = 0;
    uint8_t *used = NULL;

    assert_int_equal(cln_network_layout(c, &net), CLN_OK);
    assert_int_equal(net.enc, enc);
    assert_int_equal(net.enc_pad, up(enc, 4));
    assert_int_equal(net.skip_layer, skip);
    used = calloc((size_t)net.params, 1);
    assert_non_null(used);
    for (int i = 0; i < c->depth; i++) {
        int real = i == 0 ? enc : w + (i == skip ? enc : 0);
        int rows = i == 0 ? up(enc, 4) : w + (i == skip ? up(enc, 4) : 0);
        assert_int_equal(cln_network_rows(&net, i), rows);
        claim(used, net.params, net.trunk_w[i], up(rows * w, 16));
        claim(used, net.params, net.trunk_b[i], w);
        learned += real * w + w;
    }
    claim(used, net.params, net.sigma_w, w);
    claim(used, net.params, net.sigma_b, 16);
    learned += w + 1;
    if (c->view_dependence) {
        assert_int_equal(net.dir, dir);
        assert_int_equal(net.dir_pad, up(dir, 4));
        claim(used, net.params, net.view_w, (w + up(dir, 4)) * v);
        claim(used, net.params, net.view_b, v);
        learned += (w + dir) * v + v;
    } else {
        assert_int_equal(net.dir_pad, 0);
        assert_int_equal(net.view_w, -1);
        assert_int_equal(net.view_b, -1);
    }
    assert_int_equal(net.colour_width, c->view_dependence ? v : w);
    claim(used, net.params, net.colour_w, 3 * net.colour_width);
    claim(used, net.params, net.colour_b, 16);
    learned += 3 * net.colour_width + 3;
    assert_int_equal(net.grid_w, c->encoding == CLN_ENCODING_GRID ? net.colour_b + 16 : net.params);
    if (c->encoding == CLN_ENCODING_GRID) {
        const int side = c->grid_cells + 1, numbers = side * side * side * c->grid_features;

        claim(used, net.params, net.grid_w, up(numbers, 16));
        learned += numbers;
    }
    assert_int_equal(net.learned, learned);
    for (int i = 0; i < net.params; i++)
        unused += !used[i];
    assert_int_equal(unused, 0);
    free(used);
}

static void test_layout_of_all_shapes(void **state)
{
    static const int widths[] = {16, 32, 64, 128, 256}, views[] = {16, 48, 256};

    (void)state;
    for (int w = 0; w < 5; w++)
        for (int depth = 2; depth <= 8; depth++)
            for (int bands = 1; bands <= 10; bands += 3)
                for (int flags = 0; flags < 4; flags++) {
                    cln_config c = shape(widths[w], depth, views[(w + depth) % 3], bands,
                                         (depth + bands) % 5, flags & 1);
                    c.view_dependence = flags & 2;
                    check_layout(&c);
                    c.encoding = CLN_ENCODING_GRID;
                    c.skip = false;
                    c.grid_cells = 2 * depth;
                    c.grid_features = 4 << bands % 3;
                    check_layout(&c);
                }
}

/* method.md section 1, "Parameters per leaf". */
static void test_known_counts(void **state)
{
    static const struct {
        int width, depth, learned;
        bool skip;
    } known[] = {{64, 8, 57604, false},
                 {64, 8, 61636, true},
                 {64, 4, 40964, true}, /* depth 4 has no skip layer */
                 {128, 8, 164612, false},
                 {256, 8, 550660, false}};

    (void)state;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        cln_config c = shape(known[i].width, known[i].depth, 256, 10, 4, known[i].skip);
        cln_network net;
        assert_int_equal(cln_network_layout(&c, &net), CLN_OK);
        assert_int_equal(net.learned, known[i].learned);
    }
}

static void test_text(void **state)
{
    cln_network net = {.width = 32, .depth = 3, .view_width = 16};
    char text[32];

    (void)state;
    cln_network_text(&net, text);
    assert_string_equal(text, "W32-D3-V16");
    net.encoding = CLN_ENCODING_GRID;
    net.view_width = 0;
    net.cells = 8;
    net.features = 4;
    cln_network_text(&net, text);
    assert_string_equal(text, "W32-D3-V0-G8x4");
    net.encoding = CLN_ENCODING_VOXEL;
    cln_network_text(&net, text);
    assert_string_equal(text, "X8x4");
}

static void test_layout_refuses(void **state)
{
    static const struct {
        int width, depth, view_width, bands, view_bands;
        const char *word;
    } wrong[] = {{48, 4, 64, 6, 2, "width 48"},      {0, 4, 64, 6, 2, "width 0"},
                 {64, 1, 64, 6, 2, "depth 1"},       {64, 9, 64, 6, 2, "depth 9"},
                 {64, 4, 40, 6, 2, "view-width 40"}, {64, 4, 272, 6, 2, "view-width 272"},
                 {64, 4, 64, 0, 2, "bands 0"},       {64, 4, 64, 11, 2, "bands 11"},
                 {64, 4, 64, 6, 5, "view-bands 5"}};

    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        cln_config c = shape(wrong[i].width, wrong[i].depth, wrong[i].view_width, wrong[i].bands,
                             wrong[i].view_bands, true);
        cln_network net;
        assert_int_equal(cln_network_layout(&c, &net), CLN_USAGE);
        assert_non_null(strstr(cln_error_text(), wrong[i].word));
        cln_clear_error();
    }
}

static void test_grid_layout_refuses(void **state)
{
    static const struct {
        int cells, features, depth;
        const char *word;
    } wrong[] = {{7, 4, 2, "grid-cells 7"},      {0, 4, 2, "grid-cells 0"},
                 {34, 4, 2, "grid-cells 34"},    {8, 6, 2, "grid-features 6"},
                 {8, 20, 2, "grid-features 20"}, {8, 4, 6, "--no-skip"}};

    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        cln_config c = shape(16, wrong[i].depth, 16, 2, 2, true);
        cln_network net;

        c.encoding = CLN_ENCODING_GRID;
        c.grid_cells = wrong[i].cells;
        c.grid_features = wrong[i].features;
        assert_int_equal(cln_network_layout(&c, &net), CLN_USAGE);
        assert_non_null(strstr(cln_error_text(), wrong[i].word));
        cln_clear_error();
    }
}

/* ---- initial weights ---- */

/* rows x columns of weights: inside +-bound, variance of a uniform, mean 0 (both within 5 standard
 * errors); rows from `rows` to `padded` are zero. */
static void check_uniform(const float *w, int rows, int padded, int columns, double bound)
{
    double sum = 0, squares = 0, largest = 0;
    int n = rows * columns;

    for (int i = 0; i < n; i++) {
        sum += w[i];
        squares += (double)w[i] * w[i];
        largest = fmax(largest, fabs(w[i]));
    }
    assert_true(largest <= bound);
    assert_true(largest > bound * (1 - 20.0 / n));
    assert_true(fabs(sum / n) < 5 * bound / sqrt(3.0 * n));
    /* variance of u^2 for a uniform u: 4/45 bound^4 */
    assert_true(fabs(squares / n - bound * bound / 3) < 5 * bound * bound * sqrt(4.0 / 45 / n));
    for (int i = n; i < padded * columns; i++)
        assert_true(w[i] == 0);
}

static void check_init(const cln_config *c, double gain)
{
    cln_network net;
    float *p = NULL;
    int w = c->width;

    assert_int_equal(cln_network_layout(c, &net), CLN_OK);
    p = malloc((size_t)net.params * sizeof *p);
    assert_non_null(p);
    for (int i = 0; i < net.params; i++)
        p[i] = NAN; /* exposes unwritten floats */
    cln_network_init(&net, c, p);
    for (int i = 0; i < net.params; i++)
        assert_true(isfinite(p[i]));
    for (int i = 0; i < net.depth; i++) {
        int rows = i == 0 ? net.enc : i == net.skip_layer ? w + net.enc : w;
        check_uniform(p + net.trunk_w[i], rows, cln_network_rows(&net, i), w,
                      gain * sqrt(3.0 / rows));
        check_uniform(p + net.trunk_b[i], 1, 1, w, 1 / sqrt(rows));
    }
    check_uniform(p + net.sigma_w, 1, 1, w, 0.1 * gain * sqrt(3.0 / w));
    check_uniform(p + net.view_w, w + net.dir, w + net.dir_pad, net.view_width,
                  gain * sqrt(3.0 / (w + net.dir)));
    check_uniform(p + net.view_b, 1, 1, net.view_width, 1 / sqrt(w + net.dir));
    check_uniform(p + net.colour_w, 3, 3, net.colour_width, sqrt(6.0 / (net.colour_width + 3)));
    for (int i = 0; i < 16; i++)
        assert_true(p[net.sigma_b + i] == 0 && p[net.colour_b + i] == 0);
    free(p);
}

static void test_init(void **state)
{
    cln_config c = shape(64, 8, 128, 10, 4, true);

    (void)state;
    check_init(&c, 1.38454); /* slopes -0.3..-0.1: E[r^2] = 0.043333 */
    c.rrelu_lower = c.rrelu_upper = 0;
    check_init(&c, 1.41422); /* ReLU: sqrt 2 */
    c.init = CLN_INIT_FAN_IN;
    check_init(&c, 0.577351); /* 1/sqrt(fan_in): gain 1/sqrt 3 */
}

static void test_init_is_a_function_of_the_seed(void **state)
{
    cln_config c = shape(32, 3, 32, 6, 2, false);
    cln_network net;
    float *a = NULL, *b = NULL;
    int equal = 0;

    (void)state;
    assert_int_equal(cln_network_layout(&c, &net), CLN_OK);
    a = malloc((size_t)net.params * sizeof *a);
    b = malloc((size_t)net.params * sizeof *b);
    cln_network_init(&net, &c, a);
    cln_network_init(&net, &c, b);
    assert_memory_equal(a, b, (size_t)net.params * sizeof *a);
    for (int i = 0; i < 32 * 32; i++) /* layers do not share random numbers */
        equal += a[net.trunk_w[1] + i] == a[net.trunk_w[2] + i];
    assert_true(equal < 5);
    c.seed++;
    cln_network_init(&net, &c, b);
    equal = 0;
    for (int i = 0; i < 32 * 32; i++)
        equal += a[net.trunk_w[1] + i] == b[net.trunk_w[1] + i];
    assert_true(equal < 5);
    free(a);
    free(b);
}

/* With s = 0, density times the cube's side of 2 is the requested depth. */
static void test_density_bias(void **state)
{
    static const double depths[] = {1e-4, 0.5, 1, 10}, kappas[] = {1e-3, 1, 10, 1e4};
    cln_config c = paper();

    (void)state;
    assert_true(fabs(cln_network_density_bias(&c) + 2.97063) < 1e-4); /* method.md: about -2.97 */
    for (int i = 0; i < 16; i++) {
        double b = 0, want = depths[i / 4];
        c.initial_depth = want;
        c.density_scale = kappas[i % 4];
        c.density = CLN_DENSITY_SOFTPLUS;
        b = cln_network_density_bias(&c);
        assert_true(isfinite(b));
        b = b > 30 ? b : log1p(exp(b)); /* softplus; beyond 30 it is the identity to 1e-13 */
        assert_true(fabs(2 * c.density_scale * b - want) < 1e-9 * want);
        c.density = CLN_DENSITY_RELU;
        b = cln_network_density_bias(&c);
        assert_true(fabs(2 * c.density_scale * b - want) < 1e-12 * want);
        c.density = CLN_DENSITY_EXP;
        b = cln_network_density_bias(&c);
        assert_true(fabs(2 * c.density_scale * exp(b) - want) < 1e-9 * want);
    }
}

/* ---- folding ---- */

static void bands_at(const cln_config *c, int level, ref_network *r)
{
    for (int k = 0; k < 10; k++)
        r->level_bands[k] = c->bands_by_level ? fmin(fmax(11 - level - k, 0), 1) : 1;
}

/* Largest difference over the four outputs, each relative to its own standard deviation, between
 * the root at a point and the network folded along octants[0..times) at the same point, on a
 * grid of the innermost box that includes its faces and corners. */
static double fold_error(const cln_config *c, int level, const int *octants, int times)
{
    enum { GRID = 7, POINTS = GRID * GRID * GRID };
    static double want[POINTS][4], got[POINTS][4];
    ref_network r = {.density = c->density, .kappa = c->density_scale};
    float *nets[2] = {NULL, NULL}, *root = NULL;
    double worst = 0;
    size_t bytes = 0;

    r.bias = cln_network_density_bias(c);
    assert_int_equal(cln_network_layout(c, &r.net), CLN_OK);
    bytes = (size_t)r.net.params * sizeof(float);
    root = malloc(bytes);
    nets[0] = malloc(bytes);
    nets[1] = malloc(bytes);
    cln_network_init(&r.net, c, root);
    for (int i = 0; c->encoding == CLN_ENCODING_VOXEL && i < r.net.params; i++)
        root[i] = (float)(cln_hash((uint32_t)i) / 0x1p31 - 1);
    memcpy(nets[0], root, bytes);
    for (int t = 0; t < times; t++)
        cln_network_fold(&r.net, nets[t % 2], octants[t], nets[(t + 1) % 2]);
    for (int i = 0; i < POINTS; i++) {
        int cell[3] = {i % GRID, i / GRID % GRID, i / GRID / GRID};
        double local[3], outer[3], dir[3] = {0.48, -0.6, 0.64};
        for (int a = 0; a < 3; a++) {
            outer[a] = local[a] = -1 + 2.0 * cell[a] / (GRID - 1);
            for (int t = times - 1; t >= 0; t--)
                outer[a] = 0.5 * outer[a] + (octants[t] >> a & 1 ? 0.5 : -0.5);
        }
        bands_at(c, level, &r);
        ref_forward(&r, root, outer, dir, NULL, -0.2, want[i]);
        bands_at(c, level + times, &r);
        ref_forward(&r, nets[times % 2], local, dir, NULL, -0.2, got[i]);
    }
    for (int k = 0; k < 4; k++) {
        double sum = 0, squares = 0, largest = 0, std = 0;
        for (int i = 0; i < POINTS; i++) {
            sum += want[i][k];
            squares += want[i][k] * want[i][k];
            largest = fmax(largest, fabs(want[i][k] - got[i][k]));
        }
        std = sqrt(squares / POINTS - sum / POINTS * sum / POINTS);
        assert_true(std > 1e-4);
        worst = fmax(worst, largest / std);
    }
    free(root);
    free(nets[0]);
    free(nets[1]);
    return worst;
}

/* Bounds: about five times the worst measured; with few bands the error is the fit's
 * (encoding.c). */
static const struct fold_case {
    const char *name;
    int width, depth, bands, times;
    bool skip, by_level;
    double bound;
    int cells; /* of a grid with 4 features; 0: frequencies; below 0: -CLN_ENCODING_* of another */
} fold_cases[] = {
    {"paper's 8 x 64 with skip", 64, 8, 10, 1, true, false, 2e-5, 0},
    {"8 x 64 without skip", 64, 8, 10, 1, false, false, 2e-5, 0},
    {"fast preset's 3 x 32", 32, 3, 6, 1, false, false, 2e-5, 0},
    {"four bands", 32, 3, 4, 1, false, false, 2e-5, 0},
    {"three bands", 32, 3, 3, 1, false, false, 1e-4, 0},
    {"two bands", 32, 3, 2, 1, false, false, 2e-3, 0},
    {"one band", 32, 3, 1, 1, false, false, 1e-1, 0},
    {"bands by level, 3 to 4", 64, 8, 10, 1, true, true, 2e-5, 0},
    {"five levels down", 64, 8, 10, 5, true, false, 5e-5, 0},
    {"five levels down, fast", 32, 3, 6, 5, false, false, 1e-4, 0},
    {"grid, one level down", 16, 2, 1, 1, false, false, 1e-5, 8},
    {"grid, five levels down", 32, 3, 1, 5, false, false, 1e-5, 6},
    {"voxel, one level down", 32, 3, 1, 1, false, false, 1e-5, -CLN_ENCODING_VOXEL},
    {"voxel, five levels down", 32, 3, 1, 5, false, false, 1e-5, -CLN_ENCODING_VOXEL},
};

static void test_fold(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof fold_cases / sizeof fold_cases[0]; i++) {
        const struct fold_case *f = &fold_cases[i];
        cln_config c = shape(f->width, f->depth, 32, f->bands, 2, f->skip);
        double worst = 0;
        c.bands_by_level = f->by_level;
        c.encoding = f->cells > 0 ? CLN_ENCODING_GRID : -f->cells;
        if (f->cells > 0)
            c.grid_cells = f->cells;
        for (int octant = 0; octant < 8; octant += SANITIZED ? 7 : 1) { /* the first and last */
            int path[5] = {octant, (octant * 3 + 1) % 8, 7 - octant, (octant * 5) % 8, octant ^ 2};
            double error = 0;
            c.seed = 100 + octant;
            error = fold_error(&c, f->by_level ? 3 : 0, path, f->times);
            worst = !(error <= worst) ? error : worst;
        }
        if (!(worst <= f->bound))
            fail_msg("fold[%s]: error %.3g of the output's std, bound %.3g", f->name, worst,
                     f->bound);
        print_message("fold[%s]: %.2g of std, bound %.0e\n", f->name, worst, f->bound);
    }
}

/* Folding changes only encoding rows and biases of layer 0 and the skip layer; the top band becomes
 * zero. */
static void test_fold_touches(void **state)
{
    cln_config c = shape(64, 8, 64, 10, 4, true);
    cln_network net;
    float *a = NULL, *b = NULL;
    int skip = 0;

    (void)state;
    assert_int_equal(cln_network_layout(&c, &net), CLN_OK);
    a = malloc((size_t)net.params * sizeof *a);
    b = malloc((size_t)net.params * sizeof *b);
    cln_network_init(&net, &c, a);
    cln_network_fold(&net, a, 5, b);
    skip = net.trunk_w[net.skip_layer] + 64 * 64;
    for (int i = 0; i < net.params; i++) {
        bool first = i < net.trunk_w[1];
        bool again = i >= skip && i < net.trunk_b[net.skip_layer] + 64;
        if (!first && !again)
            assert_true(a[i] == b[i]);
    }
    for (int i = 0; i < 64; i++) {
        for (int row = 57; row < 64; row++) { /* band 9 and the padding row */
            assert_true(b[net.trunk_w[0] + row * 64 + i] == 0);
            assert_true(b[skip + row * 64 + i] == 0);
        }
        assert_true(a[net.trunk_b[0] + i] != b[net.trunk_b[0] + i]);
        assert_true(a[net.trunk_b[net.skip_layer] + i] != b[net.trunk_b[net.skip_layer] + i]);
    }
    free(a);
    free(b);
}

/* Merging of a grid: at the parent's vertices in the child's octant, the parent computes what the
 * child does. */
static void test_grid_merge(void **state)
{
    enum { CELLS = 6 };
    cln_config c = shape(16, 2, 16, 1, 1, false);
    ref_network r = {.density = c.density, .kappa = c.density_scale};
    float *child = NULL, *parent = NULL;

    (void)state;
    c.encoding = CLN_ENCODING_GRID;
    c.grid_cells = CELLS;
    assert_int_equal(cln_network_layout(&c, &r.net), CLN_OK);
    child = calloc((size_t)r.net.params, sizeof *child);
    parent = calloc((size_t)r.net.params, sizeof *parent);
    assert_true(child && parent);
    cln_network_init(&r.net, &c, child);
    for (int octant = 0; octant < 8; octant++) {
        cln_network_unfold(&r.net, child, octant, parent);
        for (int i = 0; i < (CELLS / 2 + 1) * (CELLS / 2 + 1) * (CELLS / 2 + 1); i++) {
            const int side = CELLS / 2 + 1, at[3] = {i % side, i / side % side, i / side / side};
            const double dir[3] = {0.48, -0.6, 0.64};
            double inner[3], outer[3], want[4], got[4];

            for (int a = 0; a < 3; a++) {
                inner[a] = -1 + 4.0 * at[a] / CELLS;
                outer[a] = 0.5 * inner[a] + (octant >> a & 1 ? 0.5 : -0.5);
            }
            ref_forward(&r, child, inner, dir, NULL, -0.2, want);
            ref_forward(&r, parent, outer, dir, NULL, -0.2, got);
            for (int k = 0; k < 4; k++)
                assert_true(fabs(want[k] - got[k]) < 1e-6 * (k == 3 ? c.density_scale : 1));
        }
    }
    free(child);
    free(parent);
}

/* Unfolding: in the child's octant the parent computes the same as the child with its top band
 * zeroed. */
static void check_unfold(const cln_config *c, int octant)
{
    enum { GRID = 5 };
    ref_network r = {.density = c->density, .kappa = c->density_scale};
    float *child = NULL, *parent = NULL;
    double worst = 0;

    r.bias = cln_network_density_bias(c);
    bands_at(c, 0, &r);
    assert_int_equal(cln_network_layout(c, &r.net), CLN_OK);
    child = calloc((size_t)r.net.params, sizeof *child);
    parent = calloc((size_t)r.net.params, sizeof *parent);
    cln_network_init(&r.net, c, child);
    for (int layer = 0; layer < r.net.depth; layer++) {
        const int rows = layer == 0                  ? r.net.trunk_w[0]
                         : layer == r.net.skip_layer ? r.net.trunk_w[layer] + c->width * c->width
                                                     : -1;
        const int top = 3 + 6 * (c->bands - 1);

        for (int i = 0; rows >= 0 && i < 6 * c->width; i++)
            child[rows + top * c->width + i] = 0;
    }
    cln_network_unfold(&r.net, child, octant, parent);
    for (int i = 0; i < GRID * GRID * GRID; i++) {
        const int cell[3] = {i % GRID, i / GRID % GRID, i / GRID / GRID};
        const double dir[3] = {0.48, -0.6, 0.64};
        double inner[3], outer[3], want[4], got[4];

        for (int a = 0; a < 3; a++) {
            inner[a] = -1 + 2.0 * cell[a] / (GRID - 1);
            outer[a] = 0.5 * inner[a] + (octant >> a & 1 ? 0.5 : -0.5);
        }
        ref_forward(&r, child, inner, dir, NULL, -0.2, want);
        ref_forward(&r, parent, outer, dir, NULL, -0.2, got);
        for (int k = 0; k < 4; k++)
            worst = fmax(worst, fabs(want[k] - got[k]) / (k == 3 ? c->density_scale : 1));
    }
    if (!(worst < 3e-6)) /* rounding of the weights to float */
        fail_msg("unfold of octant %d: off by %.3g", octant, worst);
    free(child);
    free(parent);
}

static void test_unfold(void **state)
{
    (void)state;
    for (int octant = 0; octant < 8; octant++) {
        const cln_config paper = shape(64, 8, 32, 10, 2, true);
        const cln_config fast = shape(32, 3, 32, 6, 2, false);
        const cln_config one = shape(16, 2, 16, 1, 1, false);

        check_unfold(&paper, octant);
        check_unfold(&fast, octant);
        check_unfold(&one, octant);
    }
}

int test_group_network(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_layout_of_all_shapes),
        cmocka_unit_test(test_known_counts),
        cmocka_unit_test(test_text),
        cmocka_unit_test(test_layout_refuses),
        cmocka_unit_test(test_grid_layout_refuses),
        cmocka_unit_test(test_init),
        cmocka_unit_test(test_init_is_a_function_of_the_seed),
        cmocka_unit_test(test_density_bias),
        cmocka_unit_test(test_fold),
        cmocka_unit_test(test_fold_touches),
        cmocka_unit_test(test_unfold),
        cmocka_unit_test(test_grid_merge),
    };

    return cmocka_run_group_tests_name("network", tests, NULL, NULL);
}
