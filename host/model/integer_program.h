/* The integer program of the structure optimisation (method.md 12.2, 12.3; NAScenT section 4, after
 * ACORN and NeAT): decides which ACTIVE leaves split and which sibling groups merge, under a budget
 * of leaves. Solved exactly: siblings are coupled within their group only, groups by one row only,
 * so it is a multiple-choice knapsack over sibling groups. octree.h carries the decisions out.
 *
 *   min  sum_b keep_b n_b + split_b s_b + merge_b g_b                     n_b, s_b, g_b binary
 *   s.t. n_b + s_b + g_b = 1                                              every leaf b
 *        g_b = g_q for siblings b, q; g_b = 0 with no_merges, or if a sibling of b is an INNER node
 *        sum_b n_b + c_b s_b + g_b / m_b <= max_leaves                 m_b: ACTIVE siblings and b
 *
 *   keep_b  = e_b d_b
 *   split_b = saved_b if it is not NaN, else split_factor e_b d_b
 *   merge_b = merge_factor / m_b * (sum of the group's e) * (largest d of the group) */
#ifndef CLN_INTEGER_PROGRAM_H
#define CLN_INTEGER_PROGRAM_H

#include <stdbool.h>
#include "model/octree.h"

/* Measures of an ACTIVE leaf. */
typedef struct cln_leaf_measure {
    double error;   /* e_b: aggregated reprojection error, >= 0 */
    double density; /* d_b = D_b^cost-density, >= 0 */
    double saved;   /* cost of its children, measured before they were merged; NaN = not known */
    int children;   /* c_b: leaves that a split makes of it, 0..8; of 0 it is not split */
    bool may_split; /* it met enough samples; the solver checks the depth limit */
} cln_leaf_measure;

typedef struct cln_integer_program_desc {
    const cln_octree *tree;
    const cln_leaf_measure *measures; /* [slot] */
    int max_leaves, max_level;
    double split_factor, merge_factor;
    bool no_merges; /* voxels: eight grids do not fit into one */
    int coarsest;   /* leaves of this level and above do not merge: 2 in a shell, else 0 */
} cln_integer_program_desc;

typedef struct cln_integer_program_result {
    uint8_t *split, *merge;        /* [slot] marks; merge: on every ACTIVE leaf of a group */
    int splits, merges, keeps;     /* leaves split; groups merged; leaves kept */
    int leaves;                    /* ACTIVE leaves afterwards */
    double objective, cost_before; /* of the solution; of keeping every leaf */
    bool infeasible; /* no choice meets the budget: every merge that may be, no leaf more */
} cln_integer_program_result;

/* Finds the optimum; of several equal ones, always the same. CLN_MEMORY; CLN_INTERNAL for a measure
 * that is negative or not finite. */
cln_status cln_integer_program_solve(const cln_integer_program_desc *desc,
                                     cln_integer_program_result *out);
void cln_integer_program_result_free(cln_integer_program_result *result); /* accepts a zeroed one */

/* Writes the program in CPLEX's LP format, for a MIP solver (cbc, glpsol --lp): variables nSLOT,
 * sSLOT, gSLOT; the budget row counts a merge once, by its group's first g. CLN_OUTPUT;
 * CLN_INTERNAL for a tree without leaves. */
cln_status cln_integer_program_write_lp(const cln_integer_program_desc *desc, const char *path);

#endif
