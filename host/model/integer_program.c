/* The integer program of the structure optimisation, solved exactly. See integer_program.h.
 *
 * Leaves share constraints within their group only, groups share the budget only. So a group has a
 * short list of ways, each with a number of leaves and a cost:
 *
 *   merge      1 leaf     if it may merge
 *   split      l leaves   of all sets of members that may split, the one of least cost with l
 *
 * A way is left out if another one has no more leaves and costs no more. Choosing one way per group
 * under the budget is a multiple-choice knapsack: after each group, cost[c] is the least cost of
 * the groups so far with c leaves in all, of each c that they can reach and that leaves room for
 * the remaining groups: at most budget - fewest + 1, where `fewest` is the sum of the leaves of
 * first ways. A byte for each group and c would record the ways, 300 MB for 40,000 leaves in 15,000
 * groups (voxels, whose empty siblings are culled) and a budget of 60,000. So costs are kept before
 * every block of sqrt(8 groups) groups, and each block is gone through again with such bytes, the
 * last first: twice the time, and there 17 MB. Ties go to fewer leaves, then to the earlier way;
 * among members, to the lower slot.
 */
#include "model/integer_program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"

enum {
    SIBLINGS = 8,
    MORE = SIBLINGS - 1,        /* leaves that a split adds at most */
    SETS = SIBLINGS * MORE + 1, /* numbers of leaves that splits of a group can add */
    WAYS_A_LEAF = MORE + 2,     /* of a group at most, for each member */
    MERGE = -1
};

/* Keeps the sum over all leaves finite. */
static const double LARGEST_COST = 1e300;

typedef struct way {
    double cost;
    int16_t leaves;
    int16_t split; /* bit i: member i is split; or MERGE */
} way;

/* ACTIVE siblings; the root as a leaf is a group of its own. */
typedef struct group {
    int count, slot[SIBLINGS];              /* rising */
    double keep[SIBLINGS], split[SIBLINGS]; /* costs [member] */
    double merge;                           /* cost of the whole group */
    int children[SIBLINGS];                 /* leaves that a split makes of a member */
    bool may_split[SIBLINGS], may_merge;
    int way_count;
    way *ways; /* leaves rise, cost falls */
} group;

typedef struct program {
    int count;
    group *groups;    /* in the order of their first slots */
    way *ways;        /* of all groups */
    int fewest, most; /* leaves, if every group takes its first or its last way */
} program;

/* All groups up to and including one have low..high leaves together. */
typedef struct span {
    int low, high;
} span;

static cln_status check_number(int slot, const char *what, double value)
{
    if (value >= 0 && value <= LARGEST_COST)
        return CLN_OK;
    return cln_fail(CLN_INTERNAL, "integer program: slot %d: %s is %g, not in 0..%g", slot, what,
                    value, LARGEST_COST);
}

/* Collects the siblings of a leaf; returns whether it is the first of them. */
static bool gather(const cln_octree *tree, int slot, group *g)
{
    int parent = tree->parent[tree->leaf[slot]];

    memset(g, 0, sizeof *g);
    if (parent < 0) {
        g->slot[g->count++] = slot;
        return true;
    }
    g->may_merge = true;
    for (int i = 0; i < SIBLINGS; i++) {
        int sibling = tree->child[parent] + i;
        if (tree->state[sibling] == CLN_NODE_ACTIVE)
            g->slot[g->count++] = tree->slot[sibling];
        else if (tree->state[sibling] == CLN_NODE_INNER)
            g->may_merge = false;
    }
    return g->slot[0] == slot;
}

static cln_status set_costs(const cln_integer_program_desc *desc, group *g)
{
    cln_status st = CLN_OK;
    double errors = 0, density = 0;

    for (int i = 0; i < g->count; i++) {
        int slot = g->slot[i], level = desc->tree->level[desc->tree->leaf[slot]];
        const cln_leaf_measure *m = &desc->measures[slot];

        CLN_TRY(check_number(slot, "error", m->error));
        CLN_TRY(check_number(slot, "density", m->density));
        g->keep[i] = m->error * m->density;
        g->split[i] = isnan(m->saved) ? desc->split_factor * g->keep[i] : m->saved;
        CLN_TRY(check_number(slot, "the cost of keeping it", g->keep[i]));
        CLN_TRY(check_number(slot, "the cost of its split", g->split[i]));
        if (m->children < 0 || m->children > SIBLINGS)
            CLN_TRY(cln_fail(CLN_INTERNAL, "integer program: slot %d: %d children, not 0..%d", slot,
                             m->children, SIBLINGS));
        g->children[i] = m->children;
        g->may_split[i] =
            m->may_split && m->children > 0 && level < desc->max_level && level < CLN_MAX_LEVEL;
        errors += m->error;
        density = fmax(density, m->density);
    }
    g->merge = desc->merge_factor * errors * density;
    if (desc->no_merges || desc->tree->level[desc->tree->leaf[g->slot[0]]] <= desc->coarsest)
        g->may_merge = false;
    CLN_TRY(check_number(g->slot[0], "the cost of its group's merge", g->merge));
done:
    return st;
}

/* Adds a way to a group. Ways come in ascending order of leaves. */
static void add_way(group *g, int leaves, double cost, int split)
{
    if (g->way_count > 0) {
        const way *last = &g->ways[g->way_count - 1];
        if (cost >= last->cost)
            return;
        if (leaves == last->leaves)
            g->way_count--;
    }
    g->ways[g->way_count++] = (way){cost, (int16_t)leaves, (int16_t)split};
}

/* sets[more]: the members whose splits add `more` leaves at the least cost, cost[more], which is
 * INFINITY if there are none. Of equal ones, those that split lower slots. Costs are summed member
 * by member: subtracting gains from one sum could leave nothing but rounding errors. Returns the
 * most leaves that splits add. */
static int list_sets(const group *g, double cost[SETS], uint8_t sets[SETS])
{
    int most = 0;

    cost[0] = 0;
    sets[0] = 0;
    for (int i = 0; i < g->count; i++) {
        const int adds = g->may_split[i] ? g->children[i] - 1 : 0;

        for (int more = most + 1; more <= most + adds; more++)
            cost[more] = INFINITY;
        most += adds;
        for (int more = most; more >= 0; more--) { /* downwards: reads what is not yet changed */
            const double kept = cost[more] + g->keep[i];
            const double split =
                g->may_split[i] && more >= adds ? cost[more - adds] + g->split[i] : INFINITY;

            if (split < kept)
                sets[more] = (uint8_t)(sets[more - adds] | 1 << i);
            cost[more] = fmin(kept, split);
        }
    }
    return most;
}

static void list_ways(group *g)
{
    double cost[SETS];
    uint8_t sets[SETS];
    const int most = list_sets(g, cost, sets);

    if (g->may_merge && g->count > 1)
        add_way(g, 1, g->merge, MERGE);
    add_way(g, g->count, cost[0], sets[0]);
    if (g->may_merge && g->count == 1) /* frees no leaf: only if cheaper than keeping */
        add_way(g, 1, g->merge, MERGE);
    for (int more = 1; more <= most; more++)
        if (isfinite(cost[more]))
            add_way(g, g->count + more, cost[more], sets[more]);
}

static void free_program(program *p)
{
    free(p->groups);
    free(p->ways);
    memset(p, 0, sizeof *p);
}

static cln_status make_program(const cln_integer_program_desc *desc, program *p)
{
    cln_status st = CLN_OK;
    const int leaves = desc->tree->leaf_count;
    way *next = NULL;

    memset(p, 0, sizeof *p);
    CLN_TRY(cln_alloc(&p->groups, (size_t)leaves, sizeof *p->groups, "sibling groups"));
    CLN_TRY(cln_alloc(&p->ways, (size_t)leaves * WAYS_A_LEAF, sizeof *p->ways, "sibling groups"));
    next = p->ways;
    for (int s = 0; s < leaves; s++) {
        group *g = &p->groups[p->count];

        if (!gather(desc->tree, s, g))
            continue;
        CLN_TRY(set_costs(desc, g));
        g->ways = next;
        list_ways(g);
        next += g->way_count;
        p->fewest += g->ways[0].leaves;
        p->most += g->ways[g->way_count - 1].leaves;
        p->count++;
    }
done:
    if (st != CLN_OK)
        free_program(p);
    return st;
}

/* Takes a way for each of `count` numbers of leaves where it costs less than those before. */
static void take_way(const double *before, double more, uint8_t taking, int count, double *cost,
                     uint8_t *taken)
{
    for (int c = 0; c < count; c++) {
        const double with = before[c] + more;
        const bool less = with < cost[c];

        cost[c] = less ? with : cost[c];
        taken[c] = less ? taking : taken[c];
    }
}

static int width_of(const span *s)
{
    return s->high - s->low + 1;
}

/* Which numbers of leaves the groups up to each one can have together; returns the widest span's
 * width. spans: [group + 1], the first is before any group. */
static int find_spans(const program *p, int max_leaves, span *spans)
{
    int widest = 1;

    for (int i = 0; i < p->count; i++) {
        const group *g = &p->groups[i];
        span *after = &spans[i + 1];
        int room = 0;

        after->low = spans[i].low + g->ways[0].leaves;
        after->high = spans[i].high + g->ways[g->way_count - 1].leaves;
        room = max_leaves - (p->fewest - after->low);
        if (after->high > room)
            after->high = room;
        widest = width_of(after) > widest ? width_of(after) : widest;
    }
    return widest;
}

/* Adds group i: cost[c] from before[c], both by the number of leaves so far, and the way of each:
 * taken[c - low]. */
static void add_group(const program *p, const span *spans, int i, const double *before,
                      double *cost, uint8_t *taken)
{
    const group *g = &p->groups[i];
    const span *from = &spans[i], *to = &spans[i + 1];

    for (int c = to->low; c <= to->high; c++)
        cost[c] = INFINITY;
    for (int w = 0; w < g->way_count; w++) {
        const int more = g->ways[w].leaves, low = from->low + more;
        const int high = from->high + more < to->high ? from->high + more : to->high;

        take_way(before + from->low, g->ways[w].cost, (uint8_t)w, high - low + 1, cost + low,
                 taken + (low - to->low));
    }
}

/* Solves the knapsack: chosen[group] is its way, for fewest <= max_leaves < most. */
static cln_status choose(const program *p, int max_leaves, uint8_t *chosen)
{
    cln_status st = CLN_OK;
    const int each = (int)ceil(sqrt(sizeof(double) * (double)p->count)); /* groups of a block */
    const int blocks = (p->count + each - 1) / each;
    span *spans = NULL;
    double *costs[2] = {NULL}; /* [leaves], of the groups so far */
    double *kept = NULL;       /* [block][widest]: costs before it */
    uint8_t *taken = NULL;     /* [group of a block][widest] */
    size_t widest = 0;
    int leaves = 0;

    CLN_TRY(cln_alloc(&spans, (size_t)p->count + 1, sizeof *spans, "integer program"));
    widest = (size_t)find_spans(p, max_leaves, spans);
    for (int k = 0; k < 2; k++)
        CLN_TRY(cln_alloc(&costs[k], (size_t)max_leaves + 1, sizeof *costs[k], "integer program"));
    CLN_TRY(cln_alloc(&kept, (size_t)blocks * widest, sizeof *kept, "integer program"));
    CLN_TRY(cln_alloc(&taken, (size_t)each * widest, sizeof *taken, "integer program"));

    for (int i = 0; i < p->count; i++) {
        if (i % each == 0)
            memcpy(kept + (size_t)(i / each) * widest, costs[i % 2] + spans[i].low,
                   (size_t)width_of(&spans[i]) * sizeof *kept);
        add_group(p, spans, i, costs[i % 2], costs[(i + 1) % 2], taken);
    }
    leaves = spans[p->count].low;
    for (int c = leaves + 1; c <= spans[p->count].high; c++)
        if (costs[p->count % 2][c] < costs[p->count % 2][leaves])
            leaves = c;
    for (int b = blocks - 1; b >= 0; b--) { /* the same costs again, now with their ways */
        const int first = b * each, end = first + each < p->count ? first + each : p->count;

        memcpy(costs[first % 2] + spans[first].low, kept + (size_t)b * widest,
               (size_t)width_of(&spans[first]) * sizeof *kept);
        for (int i = first; i < end; i++)
            add_group(p, spans, i, costs[i % 2], costs[(i + 1) % 2],
                      taken + (size_t)(i - first) * widest);
        for (int i = end - 1; i >= first; i--) {
            const span *after = &spans[i + 1];

            CLN_ASSERT(leaves >= after->low && leaves <= after->high);
            chosen[i] = taken[(size_t)(i - first) * widest + (size_t)(leaves - after->low)];
            leaves -= p->groups[i].ways[chosen[i]].leaves;
        }
    }
    CLN_ASSERT(leaves == 0);
done:
    free(spans);
    free(costs[0]);
    free(costs[1]);
    free(kept);
    free(taken);
    return st;
}

static void mark(const group *g, const way *w, cln_integer_program_result *out)
{
    double kept = 0; /* summed in the order of slots */

    for (int i = 0; i < g->count; i++)
        kept += g->keep[i];
    if (w->split == MERGE) {
        for (int i = 0; i < g->count; i++)
            out->merge[g->slot[i]] = 1;
        out->merges++;
    } else {
        for (int i = 0; i < g->count; i++) {
            const bool split = w->split >> i & 1;

            out->split[g->slot[i]] = split;
            out->splits += split;
            out->keeps += !split;
        }
    }
    out->leaves += w->leaves;
    out->objective += w->cost;
    out->cost_before += kept;
}

void cln_integer_program_result_free(cln_integer_program_result *result)
{
    free(result->split);
    free(result->merge);
    memset(result, 0, sizeof *result);
}

cln_status cln_integer_program_solve(const cln_integer_program_desc *desc,
                                     cln_integer_program_result *out)
{
    cln_status st = CLN_OK;
    program p = {0};
    uint8_t *chosen = NULL; /* [group] */
    size_t slots = (size_t)desc->tree->leaf_count;

    memset(out, 0, sizeof *out);
    CLN_TRY(make_program(desc, &p));
    CLN_TRY(cln_alloc(&out->split, slots, sizeof *out->split, "split marks"));
    CLN_TRY(cln_alloc(&out->merge, slots, sizeof *out->merge, "merge marks"));
    CLN_TRY(cln_alloc(&chosen, (size_t)p.count, sizeof *chosen, "integer program"));

    /* If the first ways together exceed the budget, they come nearest to it: no split that adds
     * leaves, and every merge that frees some. */
    out->infeasible = p.fewest > desc->max_leaves;
    if (!out->infeasible && p.most > desc->max_leaves)
        CLN_TRY(choose(&p, desc->max_leaves, chosen));
    else if (!out->infeasible) /* the budget does not bind: each group's cheapest way */
        for (int i = 0; i < p.count; i++)
            chosen[i] = (uint8_t)(p.groups[i].way_count - 1);
    for (int i = 0; i < p.count; i++)
        mark(&p.groups[i], &p.groups[i].ways[chosen[i]], out);
done:
    free(chosen);
    free_program(&p);
    if (st != CLN_OK)
        cln_integer_program_result_free(out);
    return st;
}

/* Writes " + cost xSLOT". Costs are >= 0; fabs removes the sign of a negative zero. */
static void write_term(FILE *f, double cost, char variable, int slot)
{
    char number[CLN_NUMBER_BYTES];

    cln_number_write(fabs(cost), number);
    fprintf(f, " + %s %c%d", number, variable, slot);
}

static void write_objective(FILE *f, const program *p)
{
    fprintf(f, "Minimize\n obj:\n");
    for (int i = 0; i < p->count; i++) {
        const group *g = &p->groups[i];

        for (int k = 0; k < g->count; k++) {
            fputc(' ', f);
            write_term(f, g->keep[k], 'n', g->slot[k]);
            if (g->may_split[k])
                write_term(f, g->split[k], 's', g->slot[k]);
            if (g->may_merge)
                write_term(f, g->merge / g->count, 'g', g->slot[k]);
            fputc('\n', f);
        }
    }
}

static void write_rows(FILE *f, const program *p, int max_leaves)
{
    fprintf(f, "Subject To\n");
    for (int i = 0; i < p->count; i++) {
        const group *g = &p->groups[i];

        for (int k = 0; k < g->count; k++) {
            int slot = g->slot[k];

            fprintf(f, " one%d: n%d", slot, slot);
            if (g->may_split[k])
                fprintf(f, " + s%d", slot);
            if (g->may_merge)
                fprintf(f, " + g%d", slot);
            fprintf(f, " = 1\n");
        }
        for (int k = 1; k < g->count && g->may_merge; k++)
            fprintf(f, " same%d: g%d - g%d = 0\n", g->slot[k], g->slot[0], g->slot[k]);
    }
    fprintf(f, " budget:\n");
    for (int i = 0; i < p->count; i++) {
        const group *g = &p->groups[i];

        for (int k = 0; k < g->count; k++) {
            fprintf(f, "  + n%d", g->slot[k]);
            if (g->may_split[k])
                fprintf(f, " + %d s%d", g->children[k], g->slot[k]);
            if (g->may_merge && k == 0)
                fprintf(f, " + g%d", g->slot[k]);
            fputc('\n', f);
        }
    }
    fprintf(f, "  <= %d\n", max_leaves);
}

static void write_binaries(FILE *f, const program *p)
{
    fprintf(f, "Binary\n");
    for (int i = 0; i < p->count; i++) {
        const group *g = &p->groups[i];

        for (int k = 0; k < g->count; k++) {
            fprintf(f, " n%d", g->slot[k]);
            if (g->may_split[k])
                fprintf(f, " s%d", g->slot[k]);
            if (g->may_merge)
                fprintf(f, " g%d", g->slot[k]);
            fputc('\n', f);
        }
    }
}

/* Only keywords begin in the first column: glpsol tells them from names that way. */
cln_status cln_integer_program_write_lp(const cln_integer_program_desc *desc, const char *path)
{
    cln_status st = CLN_OK;
    program p = {0};
    cln_atomic_file *file = NULL;
    FILE *f = NULL;

    CLN_TRY(make_program(desc, &p));
    if (p.count == 0)
        CLN_TRY(cln_fail(CLN_INTERNAL, "%s: a tree without leaves has no integer program", path));
    CLN_TRY(cln_atomic_open(path, &file));
    f = cln_atomic_stream(file);
    fprintf(f,
            "\\ Structure optimisation of an octree of %d leaves; by slot: n = the leaf stays,\n"
            "\\ s = it is split, g = it is merged with its siblings.\n"
            "\\ The g of a group are equal (rows same...), so in the budget the first of them\n"
            "\\ stands for all with 1, instead of each of the m with 1/m.\n",
            desc->tree->leaf_count);
    write_objective(f, &p);
    write_rows(f, &p, desc->max_leaves);
    write_binaries(f, &p);
    fprintf(f, "End\n");
    CLN_TRY(cln_atomic_commit(&file)); /* reports failed writes, too */
done:
    cln_atomic_abandon(file);
    free_program(&p);
    return st;
}
