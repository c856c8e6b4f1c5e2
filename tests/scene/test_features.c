/* Marks of photos (scene/features.h) on painted pictures: a random field of blobs, the same moved,
 * turned, larger, darker. Most marks must be found again at the very place where the
 * picture has moved them; another field has hardly any in common. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "scene/features.h"
#include "tests.h"

enum { SIDE = 96, BLOBS = 60 };

/* From a place in the picture, relative to its middle, to one in the field: turned and scaled,
 * then moved; grey is darkened. */
typedef struct look {
    uint32_t field;
    double degrees, scale, move[2], light;
} look;

static double hash(uint32_t field, int blob, uint32_t draw)
{
    return cln_uniform_hash(11, field, 0, (uint32_t)blob, 0, draw);
}

static double field_at(uint32_t field, double x, double y)
{
    double sum = 0.5;

    for (int i = 0; i < BLOBS; i++) {
        const double dx = x - SIDE * (hash(field, i, 0) - 0.5);
        const double dy = y - SIDE * (hash(field, i, 1) - 0.5);
        const double size = 1.5 + 3 * hash(field, i, 2);

        sum += (i % 2 ? 0.4 : -0.4) * exp(-(dx * dx + dy * dy) / (2 * size * size));
    }
    return fmin(1, fmax(0, sum));
}

static void to_field(const look *l, double u, double v, double out[2])
{
    const double a = l->degrees * 3.14159265358979 / 180, c = cos(a), s = sin(a);
    const double x = (u - SIDE / 2.0) / l->scale, y = (v - SIDE / 2.0) / l->scale;

    out[0] = c * x - s * y + l->move[0];
    out[1] = s * x + c * y + l->move[1];
}

static cln_features look_at(const look *l)
{
    uint8_t *pixels = malloc((size_t)SIDE * SIDE * 3);
    cln_view view = {.channels = 3, .pixels = pixels};
    cln_features found;

    assert_non_null(pixels);
    view.camera.width = view.camera.height = SIDE;
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            double at[2];

            to_field(l, x + 0.5, y + 0.5, at);
            memset(pixels + 3 * (y * SIDE + x),
                   (int)(255 * l->light * field_at(l->field, at[0], at[1]) + 0.5), 3);
        }
    assert_int_equal(cln_features_find(&view, &found), CLN_OK);
    free(pixels);
    return found;
}

/* Of the marks that two looks share: how many, and how many at the same place of the field. */
static void compare(const look *a, const look *b, int *shared, int *right)
{
    cln_features of_a = look_at(a), of_b = look_at(b);
    cln_match matches[CLN_FEATURES_MOST];

    *right = 0;
    *shared = cln_features_match(&of_a, &of_b, matches);
    for (int i = 0; i < *shared; i++) {
        const cln_feature *fa = &of_a.list[matches[i].a], *fb = &of_b.list[matches[i].b];
        double at_a[2], at_b[2];

        to_field(a, fa->u, fa->v, at_a);
        to_field(b, fb->u, fb->v, at_b);
        *right += hypot(at_a[0] - at_b[0], at_a[1] - at_b[1]) < 1;
    }
    print_message("%d and %d marks, %d shared, %d at the same place\n", of_a.count, of_b.count,
                  *shared, *right);
    free(of_a.list);
    free(of_b.list);
}

static void test_same_field(void **state)
{
    static const look straight = {1, 0, 1, {0, 0}, 1};
    static const look others[] = {{1, 0, 1, {7.25, -4.5}, 1},
                                  {1, 30, 1, {0, 0}, 1},
                                  {1, 90, 1, {3, 2}, 1},
                                  {1, 0, 1.5, {2, 2}, 1},
                                  {1, 0, 1, {0, 0}, 0.5}};
    int shared, right;

    (void)state;
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        compare(&straight, &others[i], &shared, &right);
        assert_true(right >= 12);
        assert_true(right >= 0.8 * shared);
    }
}

static void test_other_field(void **state)
{
    static const look one = {1, 0, 1, {0, 0}, 1}, other = {2, 0, 1, {0, 0}, 1};
    int shared, right;

    (void)state;
    compare(&one, &other, &shared, &right);
    assert_true(shared < 12);
}

/* Marks on what is transparent, and close beside it, stand apart; all are the whole picture's. */
static void test_cut(void **state)
{
    static const look straight = {1, 0, 1, {0, 0}, 1};
    uint8_t *pixels = malloc((size_t)SIDE * SIDE * 4);
    cln_view view = {.channels = 4, .pixels = pixels};
    cln_features whole = look_at(&straight), halves, cut;

    (void)state;
    assert_non_null(pixels);
    view.camera.width = view.camera.height = SIDE;
    for (int i = 0; i < SIDE * SIDE; i++) {
        double at[2];

        to_field(&straight, i % SIDE + 0.5, i / SIDE + 0.5, at);
        memset(pixels + 4 * i, (int)(255 * field_at(1, at[0], at[1]) + 0.5), 3);
        pixels[4 * i + 3] = i % SIDE < SIDE / 2 ? 0 : 255;
    }
    assert_int_equal(cln_features_find(&view, &halves), CLN_OK);
    cut = cln_features_cut(&halves);
    assert_int_equal(halves.count + cut.count, whole.count);
    assert_int_equal(whole.cut, 0);
    assert_true(halves.count > 5 && cut.count > 5);
    for (int i = 0; i < halves.count; i++)
        assert_true(halves.list[i].u >= SIDE / 2);
    for (int i = 0; i < cut.count; i++)
        assert_true(cut.list[i].u < SIDE * 0.7);
    free(halves.list);
    free(whole.list);
    free(pixels);
}

/* A mark's grey is that of what is kept, whatever lies below transparent pixels beside it. */
static void test_kept_grey(void **state)
{
    enum { FIELDS = 8 };
    uint8_t *pixels = malloc((size_t)SIDE * SIDE * 4);
    cln_view view = {.channels = 4, .pixels = pixels};
    cln_features found[2];
    int same = 0;

    (void)state;
    assert_non_null(pixels);
    view.camera.width = view.camera.height = SIDE;
    for (uint32_t field = 1; field <= FIELDS; field++) {
        const look straight = {field, 0, 1, {0, 0}, 1};

        for (int k = 0; k < 2; k++) { /* black, then white */
            for (int i = 0; i < SIDE * SIDE; i++) {
                const bool kept = i % SIDE >= SIDE / 2;
                double at[2];

                to_field(&straight, i % SIDE + 0.5, i / SIDE + 0.5, at);
                memset(pixels + 4 * i,
                       kept ? (int)(255 * field_at(field, at[0], at[1]) + 0.5) : 255 * k, 3);
                pixels[4 * i + 3] = kept ? 255 : 0;
            }
            assert_int_equal(cln_features_find(&view, &found[k]), CLN_OK);
        }
        for (int i = 0; i < found[0].count; i++)
            for (int k = 0; k < found[1].count; k++) {
                const cln_feature *a = &found[0].list[i], *b = &found[1].list[k];

                if (fabsf(a->u - b->u) > 1 || fabsf(a->v - b->v) > 1 || isnan(a->value) ||
                    isnan(b->value) || a->u > SIDE * 0.6f)
                    continue;
                same++;
                if (fabsf(a->value - b->value) > 0.1f)
                    fail_msg("at %g, %g: %g and %g", (double)a->u, (double)a->v, (double)a->value,
                             (double)b->value);
            }
        free(found[0].list);
        free(found[1].list);
    }
    print_message("%d marks beside black and white\n", same);
    assert_true(same >= 3);
    free(pixels);
}

/* Lists of the largest length, each mark unlike all others, one list in the reverse order of the
 * other: every mark finds itself. */
static void test_full_lists(void **state)
{
    cln_features a = {.count = CLN_FEATURES_MOST}, b = {.count = CLN_FEATURES_MOST};
    cln_match matches[CLN_FEATURES_MOST];

    (void)state;
    a.list = calloc(CLN_FEATURES_MOST, sizeof *a.list);
    b.list = calloc(CLN_FEATURES_MOST, sizeof *b.list);
    assert_true(a.list && b.list);
    for (int i = 0; i < CLN_FEATURES_MOST; i++) {
        for (int k = 0; k < CLN_FEATURE_BYTES; k++)
            a.list[i].about[k] = (uint8_t)cln_hash((uint32_t)(CLN_FEATURE_BYTES * i + k));
        b.list[CLN_FEATURES_MOST - 1 - i] = a.list[i];
    }
    assert_int_equal(cln_features_match(&a, &b, matches), CLN_FEATURES_MOST);
    for (int i = 0; i < CLN_FEATURES_MOST; i++)
        assert_true(matches[i].a == i && matches[i].b == CLN_FEATURES_MOST - 1 - i);
    free(a.list);
    free(b.list);
}

int test_group_features(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_same_field),
                                       cmocka_unit_test(test_other_field),
                                       cmocka_unit_test(test_cut), cmocka_unit_test(test_kept_grey),
                                       cmocka_unit_test(test_full_lists)};

    return cmocka_run_group_tests_name("features", tests, NULL, NULL);
}
