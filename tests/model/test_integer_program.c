/* The integer program of the structure optimisation (method.md 12.2, 12.3). Tested: it finds the
 * optimum, every answer obeys the rules, ties are broken consistently, an infeasible budget is
 * reported and approached, and the LP text is the same program.
 * Oracles: hand-made cases, costs calculated in comments; every assignment of n, s and g to the
 * leaves of small trees; a MIP solver (glpsol) on the LP text of random trees; for big trees the
 * bracket of Lagrange's relaxation. Costs and rules are reimplemented here from the header. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "model/integer_program.h"
#include "near.h"
#include "scratch.h"
#include "tests.h"

enum { SEED = 20240611, BRUTE_PROGRAMS = 80, SOLVER_PROGRAMS = 300, ALL_WAYS = 257 };

/* desc points into the other members: do not copy. */
typedef struct problem {
    cln_octree tree;
    cln_leaf_measure *measures; /* [slot] */
    cln_integer_program_desc desc;
    uint32_t draws;
} problem;

/* ---- problems ---- */

static uint32_t draw(problem *p)
{
    uint32_t c[4] = {p->draws++, 0, 0, 0}, key[2] = {SEED, 0}, out[4];

    cln_philox(c, key, out);
    return out[0];
}

static double uniform(problem *p)
{
    return draw(p) / 4294967296.0;
}

/* A full tree; each problem `number` has its own random draws. */
static void start(problem *p, int level, int number)
{
    memset(p, 0, sizeof *p);
    p->draws = (uint32_t)number << 18;
    assert_int_equal(cln_octree_create(level, &p->tree), CLN_OK);
}

static void end(problem *p)
{
    free(p->measures);
    cln_octree_free(&p->tree);
}

/* Splits or culls the marked leaves; frees the marks. */
static void apply(problem *p, uint8_t *marks, bool cull)
{
    cln_octree_change change;

    if (cull)
        assert_int_equal(cln_octree_cull(&p->tree, marks, &change), CLN_OK);
    else
        assert_int_equal(cln_octree_split(&p->tree, marks, &change), CLN_OK);
    cln_octree_change_free(&change);
    free(marks);
}

/* Splits or culls `count` random leaves. */
static void reshape(problem *p, int count, bool cull)
{
    int leaves = p->tree.leaf_count;
    uint8_t *marks = calloc((size_t)leaves, 1);

    assert_non_null(marks);
    assert_in_range(count, 0, leaves);
    while (count > 0) {
        uint32_t slot = cln_bounded(draw(p), (uint32_t)leaves);
        count -= !marks[slot];
        marks[slot] = 1;
    }
    apply(p, marks, cull);
}

/* Splits or culls one leaf. */
static void reshape_slot(problem *p, int slot, bool cull)
{
    uint8_t *marks = calloc((size_t)p->tree.leaf_count, 1);

    assert_non_null(marks);
    marks[slot] = 1;
    apply(p, marks, cull);
}

/* Every leaf costs 1 and may split. */
static void measure(problem *p, int max_leaves)
{
    p->measures = calloc((size_t)p->tree.leaf_count + 1, sizeof *p->measures);
    assert_non_null(p->measures);
    for (int s = 0; s < p->tree.leaf_count; s++)
        p->measures[s] = (cln_leaf_measure){1, 1, NAN, 8, true};
    p->desc = (cln_integer_program_desc){.tree = &p->tree,
                                         .measures = p->measures,
                                         .max_leaves = max_leaves,
                                         .max_level = CLN_MAX_LEVEL,
                                         .split_factor = 0.75,
                                         .merge_factor = 1.1};
}

/* Costs of 1e-4 to 1e5, some zero, some saved, some equal; a split makes 0 to 8 leaves. */
static void measure_random(problem *p, int max_leaves)
{
    measure(p, max_leaves);
    for (int s = 0; s < p->tree.leaf_count; s++) {
        cln_leaf_measure *m = &p->measures[s];
        m->error = uniform(p) < 0.05 ? 0 : pow(10, -3 + 6 * uniform(p));
        m->density = pow(10, -1 + 3 * uniform(p));
        m->saved = uniform(p) < 0.3 ? m->error * m->density * pow(10, -2 + 3 * uniform(p)) : NAN;
        m->may_split = uniform(p) < 0.8;
        if (uniform(p) < 0.5)
            m->children = (int)(draw(p) % 9);
        if (s > 0 && uniform(p) < 0.1)
            *m = m[-1];
    }
    p->desc.split_factor = 0.3 + 0.8 * uniform(p);
    p->desc.merge_factor = 0.9 + uniform(p);
    if (uniform(p) < 0.3)
        p->desc.max_level = cln_octree_depth(&p->tree);
    p->desc.no_merges = uniform(p) < 0.2;
}

/* ---- the header's definitions, leaf by leaf ---- */

/* ACTIVE siblings of a leaf, including itself, in order of slot. */
static int siblings(const problem *p, int slot, int out[8], bool *any_inner)
{
    const cln_octree *tree = &p->tree;
    int parent = tree->parent[tree->leaf[slot]], count = 0;

    *any_inner = false;
    if (parent < 0) {
        out[0] = slot;
        return 1;
    }
    for (int i = 0; i < 8; i++) {
        int node = tree->child[parent] + i;
        *any_inner = *any_inner || tree->state[node] == CLN_NODE_INNER;
        if (tree->state[node] == CLN_NODE_ACTIVE)
            out[count++] = tree->slot[node];
    }
    return count;
}

static bool can_merge(const problem *p, int slot)
{
    int group[8];
    bool any_inner = false;

    siblings(p, slot, group, &any_inner);
    return !p->desc.no_merges && !any_inner && p->tree.leaf[slot] != 0;
}

static bool can_split(const problem *p, int slot)
{
    int level = p->tree.level[p->tree.leaf[slot]];

    return p->measures[slot].may_split && p->measures[slot].children > 0 &&
           level < p->desc.max_level && level < CLN_MAX_LEVEL;
}

static double keep_cost(const problem *p, int slot)
{
    return p->measures[slot].error * p->measures[slot].density;
}

static double split_cost(const problem *p, int slot)
{
    double saved = p->measures[slot].saved;

    return isnan(saved) ? p->desc.split_factor * keep_cost(p, slot) : saved;
}

static double merge_cost(const problem *p, int slot)
{
    double errors = 0, density = 0;
    int group[8];
    bool any_inner = false;
    int m = siblings(p, slot, group, &any_inner);

    for (int i = 0; i < m; i++) {
        errors += p->measures[group[i]].error;
        density = fmax(density, p->measures[group[i]].density);
    }
    return p->desc.merge_factor / m * errors * density;
}

/* What a leaf costs if it is no more than one afterwards. */
static double least_cost_of_one(const problem *p, int slot)
{
    double keep = keep_cost(p, slot);

    return can_split(p, slot) && p->measures[slot].children == 1 ? fmin(keep, split_cost(p, slot))
                                                                 : keep;
}

/* Fewest possible leaves; *cost: the least cost with them; *most: most possible leaves. */
static int fewest_leaves(const problem *p, double *cost, int *most)
{
    int fewest = 0;

    *cost = 0;
    *most = 0;
    for (int s = 0; s < p->tree.leaf_count; s++) {
        int group[8];
        bool any_inner = false;
        int m = siblings(p, s, group, &any_inner);

        *most += can_split(p, s) ? p->measures[s].children : 1;
        if (!can_merge(p, s)) {
            fewest++;
            *cost += least_cost_of_one(p, s);
        } else {
            fewest += group[0] == s;
            *cost += m == 1 ? fmin(least_cost_of_one(p, s), merge_cost(p, s)) : merge_cost(p, s);
        }
    }
    return fewest;
}

/* ---- answers ---- */

/* Invariants of any answer, optimal or not. */
static void check_answer(const problem *p, const cln_integer_program_result *r)
{
    int splits = 0, more = 0, merges = 0, keeps = 0, leaves = 0, fewest = 0, most = 0;
    double cost = 0, before = 0, least = 0;

    for (int s = 0; s < p->tree.leaf_count; s++) {
        int group[8];
        bool any_inner = false;
        int m = siblings(p, s, group, &any_inner);

        before += keep_cost(p, s);
        assert_in_range(r->split[s], 0, 1);
        assert_in_range(r->merge[s], 0, 1);
        assert_false(r->split[s] && r->merge[s]);
        if (r->split[s]) {
            assert_true(can_split(p, s));
            splits++;
            more += p->measures[s].children - 1;
            leaves += p->measures[s].children;
            cost += split_cost(p, s);
        } else if (r->merge[s]) {
            assert_true(can_merge(p, s));
            for (int i = 0; i < m; i++)
                assert_int_equal(r->merge[group[i]], 1);
            merges += group[0] == s;
            leaves += group[0] == s;
            cost += merge_cost(p, s);
        } else {
            keeps++;
            leaves++;
            cost += keep_cost(p, s);
        }
    }
    assert_int_equal(r->splits, splits);
    assert_int_equal(r->merges, merges);
    assert_int_equal(r->keeps, keeps);
    assert_int_equal(r->leaves, leaves);
    assert_near(r->objective, cost, 1e-10 * cost);
    assert_near(r->cost_before, before, 1e-10 * before);

    fewest = fewest_leaves(p, &least, &most);
    assert_int_equal(r->infeasible, fewest > p->desc.max_leaves);
    if (r->infeasible) {
        assert_int_equal(more, 0);
        assert_int_equal(leaves, fewest);
        assert_near(r->objective, least, 1e-10 * least);
    } else {
        assert_in_range(leaves, fewest, p->desc.max_leaves);
        if (p->tree.leaf_count <= p->desc.max_leaves)
            assert_true(r->objective <= r->cost_before);
    }
}

static cln_integer_program_result solve(const problem *p)
{
    cln_integer_program_result r;

    assert_int_equal(cln_integer_program_solve(&p->desc, &r), CLN_OK);
    check_answer(p, &r);
    return r;
}

/* Solves, and compares marks (one character per slot: n, s or g) and objective. */
static void assert_solution(const problem *p, const char *marks, double objective)
{
    cln_integer_program_result r = solve(p);

    assert_int_equal(strlen(marks), p->tree.leaf_count);
    for (int s = 0; marks[s]; s++)
        if ((r.split[s] ? 's' : r.merge[s] ? 'g' : 'n') != marks[s])
            fail_msg("slot %d: split %d, merge %d, but %s is right", s, r.split[s], r.merge[s],
                     marks);
    assert_near(r.objective, objective, 1e-12 * objective);
    cln_integer_program_result_free(&r);
}

/* ---- hand-made cases ---- */

/* Eight leaves that cost 1, but slot 3 costs 10 and, split, 7.5. */
static void test_split(void **state)
{
    problem p;

    (void)state;
    start(&p, 1, 0);
    measure(&p, 15);
    p.measures[3].error = 10;
    assert_solution(&p, "nnnsnnnn", 7 + 7.5);
    p.desc.max_leaves = 21; /* one leaf short of a second split */
    assert_solution(&p, "nnnsnnnn", 7 + 7.5);
    p.desc.max_leaves = 14;
    assert_solution(&p, "nnnnnnnn", 17);
    p.desc.max_leaves = 64;
    assert_solution(&p, "ssssssss", 0.75 * 17);
    p.measures[3].may_split = false;
    assert_solution(&p, "sssnssss", 0.75 * 7 + 10);
    p.desc.max_level = 1;
    assert_solution(&p, "nnnnnnnn", 17);
    p.desc.max_level = 2;
    p.desc.split_factor = 1; /* a split gains nothing: fewer leaves are better */
    assert_solution(&p, "nnnnnnnn", 17);
    end(&p);
}

/* The budget counts the leaves that a split makes, not eight: of eight leaves with room for three
 * more, two splits of small gain are better than one of larger gain. */
static void test_children(void **state)
{
    problem p;

    (void)state;
    start(&p, 1, 0);
    measure(&p, 11);
    p.measures[1].error = 12; /* gains 3 */
    p.measures[1].children = 4;
    p.measures[2].error = 7; /* gains 1.75 */
    p.measures[2].children = 2;
    p.measures[5].error = 8; /* gains 2 */
    p.measures[5].children = 3;
    assert_solution(&p, "nnsnnsnn", 5 + 12 + 0.75 * 15);
    p.desc.max_leaves = 10; /* no room for both */
    assert_solution(&p, "nnnnnsnn", 5 + 12 + 7 + 6);
    p.measures[1].children = 0; /* nothing would be left of it */
    p.desc.max_leaves = 64;
    assert_solution(&p, "snssssss", 12 + 0.75 * 20);
    for (int s = 0; s < 8; s++)
        p.measures[s].children = 1; /* finer at no cost, even without room */
    p.measures[3].may_split = false;
    p.desc.max_leaves = 8;
    assert_solution(&p, "sssnssss", 1 + 0.75 * 31);
    end(&p);
}

/* The children's cost before their merge decides, not the factor. */
static void test_saved(void **state)
{
    problem p;

    (void)state;
    start(&p, 1, 0);
    measure(&p, 15);
    p.measures[2].saved = 0.5;  /* gains 0.5, twice the others */
    p.measures[6].saved = 0.25; /* gains more */
    assert_solution(&p, "nnnnnnsn", 7.25);
    p.desc.max_leaves = 64;
    p.measures[4].saved = 1.5; /* would lose */
    assert_solution(&p, "ssssnsss", 0.5 + 0.25 + 1 + 5 * 0.75);
    p.measures[4].saved = 0;
    p.desc.max_leaves = 15;
    assert_solution(&p, "nnnnsnnn", 7);
    end(&p);
}

/* Slots 0..7 are the children of the first octant, 8..14 its seven siblings, which cannot merge
 * because the octant is an inner node. Merging the eight costs 0.8 and allows one split. */
static void test_merge(void **state)
{
    problem p;

    (void)state;
    start(&p, 1, 0);
    reshape_slot(&p, 0, false);
    measure(&p, 15);
    p.measures[8].error = 100;
    assert_solution(&p, "ggggggggsnnnnnn", 8.8 + 75 + 6);
    p.measures[3].density = 2; /* 1.1 x sum of e x largest d = 17.6, 8.6 more than keeping */
    assert_solution(&p, "ggggggggsnnnnnn", 17.6 + 75 + 6);
    p.measures[3].density = 4; /* 35.2, 24.2 more than keeping; the split gains 25 */
    assert_solution(&p, "ggggggggsnnnnnn", 35.2 + 75 + 6);
    p.measures[3].density = 4.2; /* 36.96, 25.76 more */
    assert_solution(&p, "nnnnnnnnnnnnnnn", 11.2 + 106);
    p.desc.max_leaves = 8;
    assert_solution(&p, "ggggggggnnnnnnn", 36.96 + 106);
    p.desc.max_leaves = 7; /* cannot be met */
    assert_solution(&p, "ggggggggnnnnnnn", 36.96 + 106);
    end(&p);
}

/* Culled siblings cost nothing and do not prevent a merge; the other two share its cost. */
static void test_merge_with_culled(void **state)
{
    problem p;

    (void)state;
    start(&p, 1, 0);
    while (p.tree.leaf_count > 2)
        reshape_slot(&p, p.tree.leaf_count - 1, true);
    measure(&p, 1);
    p.measures[0].error = 3;
    p.measures[1].density = 5;
    assert_solution(&p, "gg", 1.1 * (3 + 1) * 5);
    p.desc.max_leaves = 2;
    assert_solution(&p, "nn", 3 + 5);
    end(&p);

    start(&p, 1, 0); /* one alone: merging frees no leaf, so it must be cheaper */
    while (p.tree.leaf_count > 1)
        reshape_slot(&p, 0, true);
    measure(&p, 1);
    assert_solution(&p, "n", 1);
    p.desc.merge_factor = 1;
    assert_solution(&p, "n", 1);
    p.desc.merge_factor = 0.9;
    assert_solution(&p, "g", 0.9);
    p.desc.coarsest = 1; /* a shell has no coarser leaves */
    assert_solution(&p, "n", 1);
    p.desc.coarsest = 0;
    p.desc.max_leaves = 8;
    assert_solution(&p, "s", 0.75);
    end(&p);
}

static void test_root(void **state)
{
    problem p;
    cln_integer_program_result r;

    (void)state;
    start(&p, 0, 0);
    measure(&p, 7);
    assert_solution(&p, "n", 1);
    p.desc.merge_factor = 0; /* the root has no parent to merge into */
    assert_solution(&p, "n", 1);
    p.desc.max_leaves = 8;
    assert_solution(&p, "s", 0.75);
    p.desc.max_leaves = 0;
    assert_solution(&p, "n", 1);
    end(&p);

    start(&p, 1, 0); /* no leaf at all */
    reshape(&p, 8, true);
    measure(&p, 10);
    r = solve(&p);
    assert_int_equal(r.leaves, 0);
    assert_false(r.infeasible);
    cln_integer_program_result_free(&r);
    assert_int_equal(cln_integer_program_write_lp(&p.desc, "/nowhere/none.lp"), CLN_INTERNAL);
    cln_clear_error();
    end(&p);
}

/* Ties: fewer leaves win, then lower slots; the marks are reproducible. */
static void test_ties(void **state)
{
    problem p;
    cln_integer_program_result a, b;

    (void)state;
    start(&p, 1, 0);
    measure(&p, 22);
    assert_solution(&p, "ssnnnnnn", 6 + 1.5);
    for (int s = 0; s < 8; s++)
        p.measures[s].error = 0;
    assert_solution(&p, "gggggggg", 0);
    end(&p);

    for (int number = 0; number < 20; number++) {
        start(&p, 2, 1000 + number);
        reshape(&p, 10, false);
        measure(&p, 90 + 5 * number);
        for (int s = 0; s < p.tree.leaf_count; s++)
            p.measures[s].error = draw(&p) % 3;
        a = solve(&p);
        b = solve(&p);
        assert_memory_equal(a.split, b.split, (size_t)p.tree.leaf_count);
        assert_memory_equal(a.merge, b.merge, (size_t)p.tree.leaf_count);
        assert_true(a.objective == b.objective);
        cln_integer_program_result_free(&a);
        cln_integer_program_result_free(&b);
        end(&p);
    }
}

static void test_refused_measures(void **state)
{
    static const struct {
        cln_leaf_measure measure;
        const char *what;
    } wrong[] = {
        {{-1, 1, NAN, 8, true}, "error"},       {{NAN, 1, NAN, 8, true}, "error"},
        {{INFINITY, 1, NAN, 8, true}, "error"}, {{1, -1e-9, NAN, 8, true}, "density"},
        {{1, NAN, NAN, 8, false}, "density"},   {{0, INFINITY, 1, 8, true}, "density"},
        {{1, 1, -2, 8, true}, "split"},         {{1, 1, INFINITY, 8, false}, "split"},
        {{1e200, 1e200, 1, 8, true}, "keep"},   {{1, 1, NAN, 9, true}, "children"},
        {{1, 1, NAN, -1, true}, "children"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        problem p;
        cln_integer_program_result r;

        start(&p, 1, 0);
        measure(&p, 8);
        p.measures[5] = wrong[i].measure;
        assert_int_equal(cln_integer_program_solve(&p.desc, &r), CLN_INTERNAL);
        assert_non_null(strstr(cln_error_text(), "slot 5"));
        assert_non_null(strstr(cln_error_text(), wrong[i].what));
        assert_null(r.split);
        assert_null(r.merge);
        cln_clear_error();
        assert_int_equal(cln_integer_program_write_lp(&p.desc, "/nowhere/none.lp"), CLN_INTERNAL);
        cln_clear_error();
        cln_integer_program_result_free(&r); /* a failed one is empty */
        end(&p);
    }
}

/* ---- every assignment ---- */

typedef struct way {
    int leaves;
    double cost;
} way;

/* All assignments of n, s and g that a group's rows allow. */
static int list_ways(const problem *p, const int *group, int m, way ways[ALL_WAYS])
{
    int codes = 1, count = 0;

    for (int i = 0; i < m; i++)
        codes *= 3;
    for (int code = 0; code < codes; code++) {
        way w = {0, 0};
        int merged = 0, rest = code;
        bool allowed = true;

        for (int i = 0; i < m; i++, rest /= 3) {
            if (rest % 3 == 0) {
                w.leaves++;
                w.cost += keep_cost(p, group[i]);
            } else if (rest % 3 == 1) {
                allowed = allowed && can_split(p, group[i]);
                w.leaves += p->measures[group[i]].children;
                w.cost += split_cost(p, group[i]);
            } else {
                merged++;
                w.cost += merge_cost(p, group[i]);
            }
        }
        if (merged > 0)
            allowed = allowed && merged == m && can_merge(p, group[0]);
        w.leaves += merged > 0; /* m times 1/m */
        if (allowed) {
            assert_in_range(count, 0, ALL_WAYS - 1);
            ways[count++] = w;
        }
    }
    return count;
}

/* The least cost over all assignments, for at most three groups; infinite if none fits. */
static double brute_force(const problem *p)
{
    static way ways[3][ALL_WAYS];
    int counts[3] = {1, 1, 1}, groups = 0;
    double least = INFINITY;

    memset(ways, 0, sizeof ways);
    for (int s = 0; s < p->tree.leaf_count; s++) {
        int group[8];
        bool any_inner = false;
        int m = siblings(p, s, group, &any_inner);

        if (group[0] != s)
            continue;
        assert_in_range(groups, 0, 2);
        counts[groups] = list_ways(p, group, m, ways[groups]);
        groups++;
    }
    for (int a = 0; a < counts[0]; a++)
        for (int b = 0; b < counts[1]; b++) {
            int leaves = ways[0][a].leaves + ways[1][b].leaves;
            double cost = ways[0][a].cost + ways[1][b].cost;

            if (leaves > p->desc.max_leaves)
                continue;
            for (int c = 0; c < counts[2]; c++)
                if (leaves + ways[2][c].leaves <= p->desc.max_leaves)
                    least = fmin(least, cost + ways[2][c].cost);
        }
    return least;
}

/* From an infeasible budget to one that never binds. */
static int random_budget(problem *p)
{
    double least = 0;
    int most = 0, fewest = fewest_leaves(p, &least, &most);

    switch (draw(p) % 8) {
    case 0:
        return fewest - 1 - (int)(draw(p) % 3);
    case 1:
        return fewest;
    case 2:
        return most + (int)(draw(p) % 9);
    case 3:
        return p->tree.leaf_count;
    default:
        return fewest + (int)(draw(p) % (uint32_t)(most - fewest + 1));
    }
}

static void test_against_all_assignments(void **state)
{
    int met = 0, unmet = 0, splits = 0, merges = 0;

    (void)state;
    for (int number = 0; number < BRUTE_PROGRAMS; number++) {
        problem p;
        cln_integer_program_result r;
        double least = 0;

        start(&p, 1, number);
        reshape(&p, (int)(draw(&p) % 3), false);
        reshape(&p, (int)(draw(&p) % (uint32_t)(p.tree.leaf_count - 2)), true);
        measure_random(&p, 0);
        p.desc.max_leaves = random_budget(&p);
        r = solve(&p);
        least = brute_force(&p);
        if (r.infeasible != isinf(least))
            fail_msg("random program %d of %d leaves: infeasible %d, brute force finds %g", number,
                     p.tree.leaf_count, r.infeasible, least);
        if (!r.infeasible && !(fabs(r.objective - least) <= 1e-12 * least))
            fail_msg("random program %d of %d leaves: objective %.17g, brute force finds %.17g",
                     number, p.tree.leaf_count, r.objective, least);
        met += !r.infeasible;
        unmet += r.infeasible;
        splits += r.splits;
        merges += r.infeasible ? 0 : r.merges;
        cln_integer_program_result_free(&r);
        end(&p);
    }
    assert_true(met > BRUTE_PROGRAMS / 2 && unmet > 0 && splits > met && merges > 5);
}

/* ---- the LP text and a MIP solver ---- */

/* Slots 0 and 1 of a level-1 tree, six siblings culled; slot 1 may not split. */
static void test_lp_text(void **state)
{
    static const char want[] = "Minimize\n"
                               " obj:\n"
                               "  + 6 n0 + 4.5 s0 + 9 g0\n"
                               "  + 4 n1 + 9 g1\n"
                               "Subject To\n"
                               " one0: n0 + s0 + g0 = 1\n"
                               " one1: n1 + g1 = 1\n"
                               " same1: g0 - g1 = 0\n"
                               " budget:\n"
                               "  + n0 + 8 s0 + g0\n"
                               "  + n1\n"
                               "  <= 9\n"
                               "Binary\n"
                               " n0 s0 g0\n"
                               " n1 g1\n"
                               "End\n";
    const char *path = scratch_path(*state, "small.lp");
    problem p;
    char *text = NULL;
    size_t bytes = 0, line = 0;

    start(&p, 1, 0);
    while (p.tree.leaf_count > 2)
        reshape_slot(&p, 1, true);
    measure(&p, 9);
    p.measures[0] = (cln_leaf_measure){2, 3, NAN, 8, true};
    p.measures[1] = (cln_leaf_measure){1, 4, NAN, 8, false};
    p.desc.merge_factor = 1.5; /* 1.5 x 3 x 4 = 18, half for each */
    assert_int_equal(cln_integer_program_write_lp(&p.desc, path), CLN_OK);
    text = scratch_get(path, &bytes);
    assert_non_null(strstr(text, "Minimize"));
    assert_string_equal(strstr(text, "Minimize"), want);
    free(text);
    assert_solution(&p, "sn", 8.5);
    assert_int_equal(cln_integer_program_write_lp(&p.desc, "/nowhere/none.lp"), CLN_OUTPUT);
    cln_clear_error();
    end(&p);

    start(&p, 2, 0); /* zeros have no sign, lines are short */
    measure_random(&p, 80);
    p.measures[0].error = -0.0;
    assert_int_equal(cln_integer_program_write_lp(&p.desc, path), CLN_OK);
    text = scratch_get(path, &bytes);
    assert_non_null(strstr(text, "+ 0 n0"));
    assert_null(strstr(text, " -0")); /* an exponent has no space before it */
    for (size_t i = 0; i < bytes; i++) {
        line = text[i] == '\n' ? 0 : line + 1;
        assert_in_range(line, 0, 199);
    }
    free(text);
    end(&p);
}

/* Runs glpsol: 'o' and the optimum; 'f' and the best found in time; else no solution. */
static char run_solver(const char *lp, const char *solution, const char *log, double *objective)
{
    char *command = NULL, *text = NULL, *line = NULL, status = 0;
    size_t bytes = 0;
    int rc =
        asprintf(&command, "glpsol --lp '%s' --tmlim 5 --write '%s' >'%s' 2>&1", lp, solution, log);

    assert_true(rc > 0);
    rc = system(command);
    if (rc != 0)
        fail_msg("%s: wait status %d", command, rc);
    free(command);
    text = scratch_get(solution, &bytes);
    line = strstr(text, "\ns mip ");
    assert_non_null(line);
    assert_int_equal(sscanf(line, "\ns mip %*d %*d %c %lf", &status, objective), 2);
    free(text);
    if (status != 'o' && status != 'f') {
        text = scratch_get(log, &bytes);
        if (!strstr(text, "FEASIBLE SOLUTION")) /* HAS NO PRIMAL / INTEGER ... */
            fail_msg("glpsol gave up:\n%s", text);
        free(text);
    }
    return status;
}

/* Trees of up to a few hundred leaves, with splits on two levels and culled leaves. */
static void random_tree(problem *p, int number)
{
    int level = number == 0 ? 0 : number % 8 < 6 ? 1 : 2;

    start(p, level, number);
    for (int round = 0; round < 2; round++)
        reshape(p, (int)(uniform(p) * (level == 2 ? 0.15 : 0.5) * p->tree.leaf_count), false);
    if (draw(p) % 2)
        reshape(p, (int)(uniform(p) * 0.6 * p->tree.leaf_count), true);
    measure_random(p, 0);
    p->desc.max_leaves = random_budget(p);
}

static void test_against_solver(void **state)
{
    const char *lp = scratch_path(*state, "program.lp");
    const char *solution = scratch_path(*state, "solution.txt");
    const char *log = scratch_path(*state, "log.txt");
    int optima = 0, unproved = 0, unmet = 0;

    if (system("glpsol --version >/dev/null 2>&1") != 0) {
        print_message("skipped: no glpsol (Debian's package glpk-utils)\n");
        skip();
    }
    for (int number = 0; number < SOLVER_PROGRAMS; number++) {
        problem p;
        cln_integer_program_result r;
        double theirs = 0, bound = 0;
        char status = 0;

        random_tree(&p, number);
        r = solve(&p);
        assert_int_equal(cln_integer_program_write_lp(&p.desc, lp), CLN_OK);
        status = run_solver(lp, solution, log, &theirs);
        if ((status != 'o' && status != 'f') != r.infeasible)
            fail_msg("random program %d of %d leaves: infeasible %d, glpsol's status is %c", number,
                     p.tree.leaf_count, r.infeasible, status);
        bound = 1e-6 * fmax(1, theirs); /* glpsol prunes at 1e-7 (1 + |objective|) */
        if (!r.infeasible &&
            (r.objective > theirs + bound || (status == 'o' && r.objective < theirs - bound)))
            fail_msg("random program %d of %d leaves, budget %d: objective %.17g, glpsol's %.17g",
                     number, p.tree.leaf_count, p.desc.max_leaves, r.objective, theirs);
        unmet += r.infeasible;
        optima += status == 'o';
        unproved += status == 'f';
        cln_integer_program_result_free(&r);
        end(&p);
    }
    if (unproved)
        print_message("glpsol ran out of time on %d of %d programs: bounds only\n", unproved,
                      SOLVER_PROGRAMS);
    assert_true(unmet > SOLVER_PROGRAMS / 20 && optima > 9 * unproved);
}

/* ---- big trees ---- */

/* Lagrange's relaxation: each leaf has a price instead of a budget row. Returns the least cost with
 * the price, a lower bound of the optimum for any price >= 0; *cost and *leaves of that choice: an
 * upper bound if the leaves fit. */
static double relaxed(const problem *p, double price, double *cost, int *leaves)
{
    double total = 0;

    *cost = 0;
    *leaves = 0;
    for (int s = 0; s < p->tree.leaf_count; s++) {
        int group[8], apart_leaves = 0;
        bool any_inner = false;
        int m = siblings(p, s, group, &any_inner);
        double apart = 0, merged = 0;

        if (group[0] != s)
            continue;
        for (int i = 0; i < m; i++) {
            double keep = keep_cost(p, group[i]), split = split_cost(p, group[i]);
            int more = p->measures[group[i]].children - 1;
            bool splits = can_split(p, group[i]) && split + more * price < keep;
            apart += splits ? split : keep;
            apart_leaves += splits ? p->measures[group[i]].children : 1;
        }
        merged = can_merge(p, s) ? m * merge_cost(p, s) : INFINITY;
        if (merged + price < apart + apart_leaves * price) {
            apart = merged;
            apart_leaves = 1;
        }
        *cost += apart;
        *leaves += apart_leaves;
        total += apart + apart_leaves * price;
    }
    return total - price * p->desc.max_leaves;
}

static void test_big_trees(void **state)
{
    static const struct {
        int level, splits, culls, leaves, max_leaves;
    } sizes[] = {
        {3, 320, 52, 2700, 2700}, /* the paper's scale */
        {4, 0, 0, 4096, 10000},   /* long lists of ways */
        {4, 0, 0, 4096, 262144},  /* the budget never binds */
        {5, 0, 0, 32768, 20000},  /* the most groups, merges only */
    };

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        problem p;
        cln_integer_program_result r;
        double low = 0, high = 1, below = 0, above = 0, cost = 0;
        int leaves = 0;

        start(&p, sizes[i].level, 2000 + (int)i);
        reshape(&p, sizes[i].splits, false);
        reshape(&p, sizes[i].culls, true);
        measure_random(&p, sizes[i].max_leaves);
        p.desc.max_level = CLN_MAX_LEVEL;
        assert_int_equal(p.tree.leaf_count, sizes[i].leaves);
        r = solve(&p);
        assert_false(r.infeasible);

        below = relaxed(&p, 0, &above, &leaves);
        if (leaves > p.desc.max_leaves) {
            for (below = relaxed(&p, high, &above, &leaves); leaves > p.desc.max_leaves;
                 below = relaxed(&p, high, &above, &leaves))
                high *= 2;
            for (int step = 0; step < 50; step++) {
                double price = (low + high) / 2, bound = relaxed(&p, price, &cost, &leaves);
                below = fmax(below, bound);
                if (leaves > p.desc.max_leaves) {
                    low = price;
                } else {
                    high = price;
                    above = cost;
                }
            }
        }
        if (!(r.objective >= below - 1e-9 * below && r.objective <= above + 1e-9 * above))
            fail_msg("%d leaves, at most %d: objective %.17g, not in %.17g .. %.17g",
                     p.tree.leaf_count, p.desc.max_leaves, r.objective, below, above);
        assert_true(above - below <= 0.02 * below); /* the bracket is tight */
        cln_integer_program_result_free(&r);
        end(&p);
    }
}

int test_group_integer_program(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_split),
        cmocka_unit_test(test_children),
        cmocka_unit_test(test_saved),
        cmocka_unit_test(test_merge),
        cmocka_unit_test(test_merge_with_culled),
        cmocka_unit_test(test_root),
        cmocka_unit_test(test_ties),
        cmocka_unit_test(test_refused_measures),
        cmocka_unit_test(test_against_all_assignments),
        cmocka_unit_test_setup_teardown(test_lp_text, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_against_solver, scratch_make, scratch_remove),
        cmocka_unit_test(test_big_trees),
    };

    return cmocka_run_group_tests_name("integer_program", tests, NULL, NULL);
}
