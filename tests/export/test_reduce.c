/* Fewer triangles of a mesh (host/export/reduce.h): balls and a sheet with exact places, far from
 * 0, too. Places, normals and colours must be those of earlier vertices; no new edge may be open;
 * and the surface must stay where it was. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "export/crowded.h"
#include "export/mesh.h"
#include "export/reduce.h"
#ifdef CLN_WITH_MESHOPTIMIZER
#include <meshoptimizer.h>
#endif
#include "near.h"
#include "tests.h"

#define NEED_MESHOPTIMIZER()                        \
    do {                                            \
        (void)state;                                \
        if (cln_mesh_reduce_possible() != CLN_OK) { \
            cln_clear_error();                      \
            skip();                                 \
        }                                           \
    } while (0)

enum { RINGS = 60, SECTORS = 120, SIDE = 50 };

static void make_mesh(cln_mesh *mesh, size_t vertices, size_t faces)
{
    memset(mesh, 0, sizeof *mesh);
    assert_int_equal(cln_export_mesh_make(mesh, vertices), CLN_OK);
    assert_int_equal(cln_alloc(&mesh->face, faces, sizeof *mesh->face, "faces"), CLN_OK);
}

static void free_mesh(cln_mesh *mesh)
{
    free(mesh->face);
    cln_export_mesh_free(mesh);
}

static void add_face(cln_mesh *mesh, size_t a, size_t b, size_t c)
{
    uint32_t *face = mesh->face[mesh->faces++];

    face[0] = (uint32_t)a, face[1] = (uint32_t)b, face[2] = (uint32_t)c;
}

/* How many views see a vertex, by its number. */
static uint8_t views_of(size_t number)
{
    return (uint8_t)(number % 101);
}

/* A ball of radius 1 about mesh->origin, of rings and sectors between two poles. The colour is the
 * vertex' number, and the views follow from it. */
static void add_ball(cln_mesh *mesh, size_t first, const double middle[3])
{
    const size_t south = first + (RINGS - 1) * SECTORS, north = south + 1;

    for (size_t v = first; v <= north; v++) {
        const size_t i = v - first;
        const double polar = v == south   ? M_PI
                             : v == north ? 0
                                          : M_PI * (double)(i / SECTORS + 1) / RINGS;
        const double round = 2 * M_PI * (double)(i % SECTORS) / SECTORS;
        const double n[3] = {sin(polar) * cos(round), sin(polar) * sin(round), cos(polar)};

        for (int a = 0; a < 3; a++) {
            mesh->at[v][a] = middle[a] + n[a];
            mesh->normal[v][a] = (float)n[a];
            mesh->colour[v][a] = (uint8_t)(v >> 8 * a);
        }
        mesh->views[v] = views_of(v);
    }
    for (size_t s = 0; s < SECTORS; s++) {
        const size_t t = (s + 1) % SECTORS, last = first + (RINGS - 2) * SECTORS;

        add_face(mesh, north, first + s, first + t);
        add_face(mesh, south, last + t, last + s);
        for (size_t r = first; r < last; r += SECTORS) {
            add_face(mesh, r + s, r + SECTORS + s, r + SECTORS + t);
            add_face(mesh, r + s, r + SECTORS + t, r + t);
        }
    }
}

enum { BALL_VERTICES = (RINGS - 1) * SECTORS + 2, BALL_FACES = 2 * (RINGS - 1) * SECTORS };

/* Height of vertex `number` above the middle. */
static double polar_height(size_t number)
{
    if (number >= BALL_VERTICES - 2)
        return number == BALL_VERTICES - 2 ? -1 : 1;
    return cos(M_PI * (double)(number / SECTORS + 1) / RINGS);
}

static int by_value(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

    return x < y ? -1 : x > y;
}

/* Directed edges without their opposite; none may occur twice. */
static size_t open_edges(const cln_mesh *mesh)
{
    const size_t n = 3 * mesh->faces;
    uint64_t *edges = NULL;
    size_t open = 0;

    assert_int_equal(cln_alloc(&edges, n, sizeof *edges, "edges"), CLN_OK);
    for (size_t f = 0; f < mesh->faces; f++)
        for (size_t k = 0; k < 3; k++)
            edges[3 * f + k] = (uint64_t)mesh->face[f][k] << 32 | mesh->face[f][(k + 1) % 3];
    qsort(edges, n, sizeof *edges, by_value);
    for (size_t e = 0; e < n; e++) {
        const uint64_t back = edges[e] << 32 | edges[e] >> 32;

        assert_true(e == 0 || edges[e - 1] != edges[e]);
        open += !bsearch(&back, edges, n, sizeof *edges, by_value);
    }
    free(edges);
    return open;
}

static double area_of(const cln_mesh *mesh, size_t f, double middle[3])
{
    const uint32_t *v = mesh->face[f];
    double u[3], w[3], sum = 0;

    for (int a = 0; a < 3; a++) {
        u[a] = mesh->at[v[1]][a] - mesh->at[v[0]][a];
        w[a] = mesh->at[v[2]][a] - mesh->at[v[0]][a];
        middle[a] = mesh->at[v[0]][a] + (u[a] + w[a]) / 3;
    }
    for (int a = 0; a < 3; a++)
        sum += pow(u[(a + 1) % 3] * w[(a + 2) % 3] - u[(a + 2) % 3] * w[(a + 1) % 3], 2);
    return sqrt(sum) / 2;
}

static void a_ball_stays_round_and_closed(void **state)
{
    static const double middles[][3] = {{0, 0, 0}, {500000, 4100000, 200}};

    NEED_MESHOPTIMIZER();
#ifdef CLN_WITH_MESHOPTIMIZER /* so that the library is linked: tests/api/test_exports.c wraps it */
    assert_true(meshopt_simplifyScale((const float[3]){0, 1, 2}, 1, 3 * sizeof(float)) >= 0);
#endif
    for (int m = 0; m < 2; m++) {
        const double *middle = middles[m];
        size_t crowded = 0, bent = 0;
        double error = 0, worst = 0, area = 0;
        bool met[BALL_VERTICES] = {false};
        cln_mesh mesh;

        make_mesh(&mesh, BALL_VERTICES, BALL_FACES);
        memcpy(mesh.origin, middle, sizeof mesh.origin);
        add_ball(&mesh, 0, middle);
        assert_int_equal(mesh.faces, BALL_FACES);
        assert_int_equal(open_edges(&mesh), 0);
        assert_int_equal(cln_mesh_reduce(&mesh, 1000, NULL, &error, &crowded, &bent), CLN_OK);
        assert_in_range(mesh.faces, 900, 1000);
        assert_int_equal(open_edges(&mesh), 0);
        assert_int_equal(mesh.vertices, mesh.faces / 2 + 2); /* Euler: still one ball */
        for (size_t v = 0; v < mesh.vertices; v++) {
            size_t number = 0;

            for (int a = 0; a < 3; a++) {
                number |= (size_t)mesh.colour[v][a] << 8 * a;
                assert_near(mesh.at[v][a] - middle[a], mesh.normal[v][a], 1e-6);
            }
            assert_true(number < BALL_VERTICES && !met[number]);
            assert_int_equal(mesh.views[v], views_of(number));
            assert_near(mesh.normal[v][2], polar_height(number), 1e-6);
            met[number] = true;
        }
        for (size_t f = 0; f < mesh.faces; f++) {
            double at[3], r = 0;

            area += area_of(&mesh, f, at);
            for (int a = 0; a < 3; a++)
                r += pow(at[a] - middle[a], 2);
            worst = fmax(worst, 1 - sqrt(r));
        }
        print_message("    %zu of %d triangles: at most %.4f inside, area %.4f, error %.4f\n",
                      mesh.faces, BALL_FACES, worst, area / (4 * M_PI), error);
        assert_true(worst < 0.02); /* 1,000 equal triangles: 0.0048 */
        assert_near(area / (4 * M_PI), 1, 0.02);
        assert_near(error, worst, 0.002); /* vertices move less far than middles are inside */
        free_mesh(&mesh);
    }
}

/* A ball whose lower half is pressed flat: known to lie in a plane, its base stays there. */
static void a_base_stays_flat(void **state)
{
    NEED_MESHOPTIMIZER();
    for (int known = 0; known < 2; known++) {
        size_t crowded = 0, bent = 0, based = 0;
        double error = 0, base = 0, at[3];
        uint8_t plane[BALL_FACES] = {0};
        cln_mesh mesh;

        make_mesh(&mesh, BALL_VERTICES, BALL_FACES);
        add_ball(&mesh, 0, (const double[3]){0, 0, 0});
        for (size_t v = 0; v < mesh.vertices; v++)
            mesh.at[v][2] = fmax(mesh.at[v][2], 0);
        for (size_t f = 0; f < mesh.faces; f++)
            plane[f] = mesh.at[mesh.face[f][0]][2] + mesh.at[mesh.face[f][1]][2] +
                                   mesh.at[mesh.face[f][2]][2] <
                               1e-9
                           ? 3
                           : 0;
        assert_int_equal(cln_mesh_reduce(&mesh, 800, known ? plane : NULL, &error, &crowded, &bent),
                         CLN_OK);
        assert_in_range(mesh.faces, 600, 800);
        assert_int_equal(open_edges(&mesh), 0);
        for (size_t f = 0; f < mesh.faces; f++) {
            const double high = mesh.at[mesh.face[f][0]][2] + mesh.at[mesh.face[f][1]][2] +
                                mesh.at[mesh.face[f][2]][2];

            if (high < 1e-9) {
                base += area_of(&mesh, f, at);
                based++;
            }
        }
        print_message("    base %.4f of the disc's, of %zu triangles; moved by %.4f\n", base / M_PI,
                      based, error);
        assert_int_equal(bent, 0);
        if (known)
            assert_near(base / M_PI, 1, 0.001); /* a polygon of so many sides: 0.99954 */
        assert_true(error < 0.05);
        if (known) { /* the outline alone takes more than a quarter of so few */
            uint8_t flat[BALL_FACES] = {0};

            for (size_t f = 0; f < mesh.faces; f++)
                flat[f] = mesh.at[mesh.face[f][0]][2] + mesh.at[mesh.face[f][1]][2] +
                              mesh.at[mesh.face[f][2]][2] <
                          1e-9;
            assert_int_equal(cln_mesh_reduce(&mesh, 200, flat, &error, &crowded, &bent), CLN_OK);
            assert_in_range(bent, 51, 140);
            assert_in_range(mesh.faces, 100, 200);
        }
        free_mesh(&mesh);
    }
}

/* What is not flat may have fewer triangles than are left for it: all of them stay. */
static void a_base_leaves_the_rest(void **state)
{
    size_t crowded = 0, bent = 0, rest = 0;
    double error = 0;
    uint8_t plane[BALL_FACES] = {0};
    cln_mesh mesh;

    NEED_MESHOPTIMIZER();
    make_mesh(&mesh, BALL_VERTICES, BALL_FACES);
    add_ball(&mesh, 0, (const double[3]){0, 0, 0});
    for (size_t v = 0; v < mesh.vertices; v++)
        mesh.at[v][2] = fmax(mesh.at[v][2], 0);
    for (size_t f = 0; f < mesh.faces; f++) {
        plane[f] = mesh.at[mesh.face[f][0]][2] + mesh.at[mesh.face[f][1]][2] +
                       mesh.at[mesh.face[f][2]][2] <
                   1e-9;
        rest += !plane[f];
    }
    assert_int_equal(cln_mesh_reduce(&mesh, BALL_FACES - 100, plane, &error, &crowded, &bent),
                     CLN_OK);
    assert_in_range(mesh.faces, rest + 50, rest + 500);
    assert_int_equal(open_edges(&mesh), 0);
    assert_true(error < 1e-4);
    free_mesh(&mesh);
}

/* A flat sheet needs two triangles, with its border. */
static void a_sheet_keeps_its_border(void **state)
{
    size_t crowded = 0, bent = 0;
    double error = 0, area = 0, at[3];
    cln_mesh mesh;

    NEED_MESHOPTIMIZER();
    make_mesh(&mesh, (SIDE + 1) * (SIDE + 1), 2 * SIDE * SIDE);
    for (size_t v = 0; v < mesh.vertices; v++) {
        mesh.at[v][0] = (double)(v % (SIDE + 1)) / SIDE;
        mesh.at[v][1] = (double)(v / (SIDE + 1)) / SIDE;
        mesh.at[v][2] = 3;
    }
    for (size_t y = 0; y < SIDE; y++)
        for (size_t x = 0; x < SIDE; x++) {
            const size_t v = y * (SIDE + 1) + x;

            add_face(&mesh, v, v + 1, v + SIDE + 2);
            add_face(&mesh, v, v + SIDE + 2, v + SIDE + 1);
        }
    assert_int_equal(open_edges(&mesh), 4 * SIDE);
    assert_int_equal(cln_mesh_reduce(&mesh, 20, NULL, &error, &crowded, &bent), CLN_OK);
    assert_in_range(mesh.faces, 2, 20);
    for (size_t f = 0; f < mesh.faces; f++)
        area += area_of(&mesh, f, at);
    assert_near(area, 1, 1e-6);
    assert_true(error < 1e-6);
    free_mesh(&mesh);
}

/* Two balls do not become one; enough is left as it is; the smallest number is reached. */
static void parts_stay_and_enough_is_enough(void **state)
{
    const double left[3] = {-2, 0, 0}, right[3] = {2, 0, 0};
    size_t crowded = 0, bent = 0;
    double error = 0;
    size_t on_the_left = 0;
    cln_mesh mesh;

    NEED_MESHOPTIMIZER();
    make_mesh(&mesh, 2 * BALL_VERTICES, 2 * BALL_FACES);
    add_ball(&mesh, 0, left);
    add_ball(&mesh, BALL_VERTICES, right);
    assert_int_equal(cln_mesh_reduce(&mesh, 2 * BALL_FACES, NULL, &error, &crowded, &bent), CLN_OK);
    assert_int_equal(mesh.faces, 2 * BALL_FACES);
    assert_int_equal(mesh.vertices, 2 * BALL_VERTICES);
    assert_true(error == 0);
    assert_int_equal(cln_mesh_reduce(&mesh, 400, NULL, &error, &crowded, &bent), CLN_OK);
    assert_in_range(mesh.faces, 300, 400);
    assert_int_equal(open_edges(&mesh), 0);
    assert_int_equal(mesh.vertices, mesh.faces / 2 + 4);
    for (size_t v = 0; v < mesh.vertices; v++)
        on_the_left += mesh.at[v][0] < 0;
    assert_in_range(on_the_left, mesh.vertices / 3, 2 * mesh.vertices / 3);
    assert_int_equal(cln_mesh_reduce(&mesh, 4, NULL, &error, &crowded, &bent), CLN_OK);
    assert_in_range(mesh.faces, 1, 8);
    assert_int_equal(open_edges(&mesh), 0);
    free_mesh(&mesh);
}

/* Edges of faces that are not passed as often one way as the other. */
static size_t uneven_edges(const cln_mesh *mesh)
{
    size_t uneven = 0;

    for (size_t e = 0; e < 3 * mesh->faces; e++) {
        const uint32_t from = mesh->face[e / 3][e % 3], to = mesh->face[e / 3][(e + 1) % 3];
        int sum = 0;

        for (size_t f = 0; f < mesh->faces; f++)
            for (int k = 0; k < 3; k++) {
                const uint32_t a = mesh->face[f][k], b = mesh->face[f][(k + 1) % 3];

                sum += (a == from && b == to) - (a == to && b == from);
            }
        uneven += sum != 0;
    }
    return uneven;
}

/* Faces over the same corners as a face that is turned the other way. */
static size_t flat_pairs(const cln_mesh *mesh)
{
    size_t pairs = 0;

    for (size_t f = 0; f < mesh->faces; f++)
        for (size_t g = 0; g < f; g++)
            for (int k = 0; k < 3; k++)
                pairs += mesh->face[f][0] == mesh->face[g][k] &&
                         mesh->face[f][1] == mesh->face[g][(k + 2) % 3] &&
                         mesh->face[f][2] == mesh->face[g][(k + 1) % 3];
    return pairs;
}

/* What is thin would become faces back to back, which enclose nothing, with four at an edge. */
static void a_thin_ring_leaves_no_pairs(void **state)
{
    enum { ALONG = 200, AROUND = 12 };
    size_t crowded = 0, bent = 0;
    double error = 0;
    cln_mesh mesh;

    NEED_MESHOPTIMIZER();
    make_mesh(&mesh, ALONG * AROUND, 2 * ALONG * AROUND);
    for (size_t i = 0; i < ALONG; i++)
        for (size_t k = 0; k < AROUND; k++) {
            const double u = 2 * M_PI * (double)i / ALONG, v = 2 * M_PI * (double)k / AROUND;
            const size_t j = (i + 1) % ALONG * AROUND, next = (k + 1) % AROUND;
            double *at = mesh.at[i * AROUND + k];

            at[0] = (1 + 0.02 * cos(v)) * cos(u);
            at[1] = (1 + 0.02 * cos(v)) * sin(u);
            at[2] = 0.02 * sin(v);
            add_face(&mesh, i * AROUND + k, j + k, j + next);
            add_face(&mesh, i * AROUND + k, j + next, i * AROUND + next);
        }
    assert_int_equal(open_edges(&mesh), 0);
    assert_int_equal(cln_mesh_reduce(&mesh, 62, NULL, &error, &crowded, &bent), CLN_OK);
    assert_in_range(mesh.faces, 20, 62);
    assert_int_equal(flat_pairs(&mesh), 0);
    assert_int_equal(uneven_edges(&mesh), 0);
    free_mesh(&mesh);
}

/* Edges that have not two triangles, by the corners' places, as an STL file has them. */
static size_t odd_edges(const cln_mesh *mesh)
{
    const size_t n = 3 * mesh->faces;
    uint32_t *same = NULL;
    uint64_t *edges = NULL;
    size_t odd = 0;

    assert_int_equal(cln_alloc(&same, mesh->vertices, sizeof *same, "vertices"), CLN_OK);
    assert_int_equal(cln_alloc(&edges, n, sizeof *edges, "edges"), CLN_OK);
    for (size_t v = 0; v < mesh->vertices; v++)
        for (same[v] = 0; same[v] < v; same[v]++) {
            const double *a = mesh->at[v], *b = mesh->at[same[v]];

            if ((float)a[0] == (float)b[0] && (float)a[1] == (float)b[1] &&
                (float)a[2] == (float)b[2])
                break;
        }
    for (size_t e = 0; e < n; e++) {
        const uint32_t a = same[mesh->face[e / 3][e % 3]];
        const uint32_t b = same[mesh->face[e / 3][(e % 3 + 1) % 3]];

        edges[e] = (uint64_t)(a < b ? a : b) << 32 | (a < b ? b : a);
    }
    qsort(edges, n, sizeof *edges, by_value);
    for (size_t e = 0, run = 0; e < n; e += run) {
        for (run = 1; e + run < n && edges[e + run] == edges[e];)
            run++;
        odd += run != 2;
    }
    free(same);
    free(edges);
    return odd;
}

/* A flat ring: a tube of an oval, thin one way. */
static void add_ring(cln_mesh *mesh, size_t along, size_t around, double wide, double thin)
{
    for (size_t i = 0; i < along; i++)
        for (size_t k = 0; k < around; k++) {
            const double u = 2 * M_PI * (double)i / (double)along;
            const double v = 2 * M_PI * (double)k / (double)around;
            const size_t j = (i + 1) % along * around, next = (k + 1) % around;
            double *at = mesh->at[i * around + k];

            at[0] = (1 + wide * cos(v)) * cos(u);
            at[1] = (1 + wide * cos(v)) * sin(u);
            at[2] = thin * sin(v);
            mesh->normal[i * around + k][2] = 1;
            add_face(mesh, i * around + k, j + k, j + next);
            add_face(mesh, i * around + k, j + next, i * around + next);
        }
}

/* Every edge of what is closed has two triangles, however few are left: slicers ask for it. */
static void thin_parts_stay_tight(void **state)
{
    enum { ALONG = 120, AROUND = 12 };
    size_t parted = 0;

    NEED_MESHOPTIMIZER();
    for (size_t most = 44; most < 400; most += 6) /* of fewer it is flat */
        for (int kind = 0; kind < 3; kind++) {
            size_t crowded = 0, bent = 0, corners = 0;
            double error = 0;
            cln_mesh mesh;

            make_mesh(&mesh, ALONG * AROUND, 2 * ALONG * AROUND);
            add_ring(&mesh, ALONG, AROUND, kind == 2 ? 0.1 : 0.02, kind == 1 ? 0.002 : 0.02);
            assert_int_equal(cln_mesh_reduce(&mesh, most, NULL, &error, &crowded, &bent), CLN_OK);
            assert_int_equal(crowded, 0);
            if (odd_edges(&mesh) != 0)
                fail_msg("ring %d, %zu triangles of %zu: %zu edges have not two", kind, mesh.faces,
                         most, odd_edges(&mesh));
            assert_true(mesh.faces <= most);
            for (size_t v = 0; v < mesh.vertices; v++) { /* on the ring's net, or beside it */
                const double u = atan2(mesh.at[v][1], mesh.at[v][0]) / (2 * M_PI) * ALONG;

                corners += fabs(u - round(u)) > 1e-6;
            }
            parted += corners;
            free_mesh(&mesh);
        }
    print_message("    %zu edges were parted\n", parted);
    assert_true(parted > 0);
}

/* A tetrahedron with its triangles outwards; a to d turn to the right. */
static void add_tetrahedron(cln_mesh *mesh, size_t a, size_t b, size_t c, size_t d)
{
    add_face(mesh, a, c, b);
    add_face(mesh, a, b, d);
    add_face(mesh, b, c, d);
    add_face(mesh, a, d, c);
}

/* Two tetrahedra have an edge in common, which is parted: as few views see its new middle as see
 * the end that fewer do. */
static void a_middle_is_seen_by_the_fewest(void **state)
{
    static const double at[6][3] = {{0, 0, -1},   {0, 0, 1},    {1, 0.3, 0},
                                    {1, -0.3, 0}, {-1, 0.3, 0}, {-1, -0.3, 0}};

    (void)state;
    for (int turned = 0; turned < 2; turned++) {
        cln_mesh_edges edges;
        size_t left = 0;
        cln_mesh mesh;

        make_mesh(&mesh, 8, 12);
        mesh.vertices = 6;
        memcpy(mesh.at, at, sizeof at);
        for (size_t v = 0; v < mesh.vertices; v++)
            mesh.views[v] = 9;
        mesh.views[turned] = 2;
        mesh.views[!turned] = 5;
        add_tetrahedron(&mesh, 0, 1, 3, 2);
        add_tetrahedron(&mesh, 0, 1, 4, 5);
        assert_int_equal(cln_mesh_count_edges(&mesh, &edges), CLN_OK);
        assert_int_equal(edges.crowded, 1);
        assert_int_equal(cln_mesh_part_crowded(&mesh, 8, 12, &left), CLN_OK);
        assert_int_equal(left, 0);
        assert_int_equal(mesh.vertices, 7);
        assert_int_equal(mesh.views[6], 2);
        free_mesh(&mesh);
    }
}

int test_group_reduce(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_stays_round_and_closed),
        cmocka_unit_test(a_base_stays_flat),
        cmocka_unit_test(a_base_leaves_the_rest),
        cmocka_unit_test(a_sheet_keeps_its_border),
        cmocka_unit_test(parts_stay_and_enough_is_enough),
        cmocka_unit_test(a_thin_ring_leaves_no_pairs),
        cmocka_unit_test(thin_parts_stay_tight),
        cmocka_unit_test(a_middle_is_seen_by_the_fewest),
    };

    return cmocka_run_group_tests_name("reduce", tests, NULL, NULL);
}
