/* The distance between two names by dynamic programming over their prefixes (optimal string alignment:
 * Levenshtein's with swaps). See text.h; who suggests what is the callers' affair. */
#include "base/text.h"

#include <string.h>

int cln_edit_distance(const char *a, const char *b)
{
    enum { MAX = 63 };
    int cost[MAX + 1][MAX + 1];
    int na = (int)strnlen(a, MAX), nb = (int)strnlen(b, MAX);

    for (int i = 0; i <= na; i++) {
        for (int j = 0; j <= nb; j++) {
            int best = i + j; /* right for the first row and column */

            if (i > 0 && j > 0) {
                best = cost[i - 1][j - 1] + (a[i - 1] != b[j - 1]);
                if (cost[i - 1][j] + 1 < best)
                    best = cost[i - 1][j] + 1;
                if (cost[i][j - 1] + 1 < best)
                    best = cost[i][j - 1] + 1;
                if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] &&
                    cost[i - 2][j - 2] + 1 < best)
                    best = cost[i - 2][j - 2] + 1;
            }
            cost[i][j] = best;
        }
    }
    return cost[na][nb];
}
