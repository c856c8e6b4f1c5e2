/* Marked cells of the cube, of any levels, as stretches of the Morton curve: memory follows the
 * marks, not the number of cells that the cube has. */
#ifndef CLN_MARKS_H
#define CLN_MARKS_H

#include <stdbool.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_marked {
    uint32_t first, end; /* cells of CLN_MAX_LEVEL in Morton order, `end` not included */
} cln_marked;

typedef struct cln_marks { /* zeros: none */
    int count;
    cln_marked *mark; /* [count] as they came, or in order */
} cln_marks;

void cln_marks_free(cln_marks *marks);

/* Marks a cell of a level, {x, y, z} in 0 .. 2^level - 1. CLN_MEMORY. */
cln_status cln_marks_add(cln_marks *marks, int level, const int cell[3]);

/* Of marks of one level, keeps those that were added at least `times` times, each once. */
void cln_marks_keep(cln_marks *marks, int times);

/* Puts the marks in order and joins those that touch. cln_marks_meet() wants it done after the last
 * cln_marks_add(). */
void cln_marks_order(cln_marks *marks);

/* Does the cell of a level hold a marked cell, or lie in one? */
bool cln_marks_meet(const cln_marks *marks, int level, const int cell[3]);

#endif
