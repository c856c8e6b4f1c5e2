/* A set of marked cells. See marks.h. */
#include "model/marks.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "device_abi.h"

_Static_assert(3 * CLN_MAX_LEVEL < 32, "the end of the Morton curve is a number of 32 bits");

void cln_marks_free(cln_marks *marks)
{
    free(marks->mark);
    memset(marks, 0, sizeof *marks);
}

/* The stretch of the Morton curve in a cell. */
static cln_marked stretch_of(int level, const int cell[3])
{
    const int finer = 3 * (CLN_MAX_LEVEL - level);
    uint32_t code = 0;

    for (int bit = 0; bit < level; bit++)
        for (int a = 0; a < 3; a++)
            code |= ((uint32_t)cell[a] >> bit & 1) << (3 * bit + a);
    return (cln_marked){code << finer, (code + 1) << finer};
}

cln_status cln_marks_add(cln_marks *marks, int level, const int cell[3])
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_grow(&marks->mark, marks->count, sizeof *marks->mark, "marks of cells"));
    marks->mark[marks->count++] = stretch_of(level, cell);
done:
    return st;
}

static int by_place(const void *left, const void *right)
{
    const cln_marked *a = left, *b = right;

    if (a->first != b->first)
        return a->first < b->first ? -1 : 1;
    return (a->end > b->end) - (a->end < b->end);
}

static void sort(cln_marks *marks)
{
    if (marks->count > 0)
        qsort(marks->mark, (size_t)marks->count, sizeof *marks->mark, by_place);
}

void cln_marks_keep(cln_marks *marks, int times)
{
    int kept = 0;

    sort(marks);
    for (int i = 0, next = 0; i < marks->count; i = next) {
        while (next < marks->count && marks->mark[next].first == marks->mark[i].first)
            next++;
        if (next - i >= times)
            marks->mark[kept++] = marks->mark[i];
    }
    marks->count = kept;
}

void cln_marks_order(cln_marks *marks)
{
    int last = -1;

    sort(marks);
    for (int i = 0; i < marks->count; i++) {
        const cln_marked m = marks->mark[i];

        if (last < 0 || m.first > marks->mark[last].end)
            marks->mark[++last] = m;
        else if (m.end > marks->mark[last].end)
            marks->mark[last].end = m.end;
    }
    marks->count = last + 1;
}

bool cln_marks_meet(const cln_marks *marks, int level, const int cell[3])
{
    const cln_marked wanted = stretch_of(level, cell);
    int low = 0, high = marks->count; /* the first mark that ends behind its begin */

    while (low < high) {
        const int middle = low + (high - low) / 2;

        if (marks->mark[middle].end > wanted.first)
            high = middle;
        else
            low = middle + 1;
    }
    return low < marks->count && marks->mark[low].first < wanted.end;
}
