/* Fetching ahead: requests cache lines of global memory before they are read or written.
 *
 * Four forms, by what is known of the data needed next:
 *
 *   turns     rows of a known number, needed by a later loop of equal turns: each turn of the
 *             present loop first fetches its share (in_turns, fetch_turn; layer.h)
 *   stream    an array worked on from front to back: the line a fixed distance on (FETCH_STREAM;
 *             adam.h)
 *   places    elements in no order: their indices are worked out first, those of a block or of a
 *             distance on, and each is fetched at once (FETCH; roulette.cl, voxel.cl, mlp_*.cl for
 *             the next block's samples, stage1.h's bundle_fetch for the next intervals)
 *   few       some lines, between two stages (fetch_all; mlp_forward.cl)
 *
 * Turns come first: fetches belong one by one between other work, as a burst of them stalls. The
 * other forms are for what has no turns, or for no more than a few dozen lines. They use the
 * compiler's builtin, as PoCL's prefetch() does nothing; without the builtin they do nothing. */

/* FETCHES: whether FETCH does anything. */
#if defined(__x86_64__) || defined(__aarch64__)
#define FETCHES        1
#define FETCH(p)       __builtin_prefetch((const __private void *)(uintptr_t)(p), 0, 3)
#define FETCH_WRITE(p) __builtin_prefetch((const __private void *)(uintptr_t)(p), 1, 3)
#else
#define FETCHES 0
#define FETCH(p)
#define FETCH_WRITE(p)
#endif

#define CACHE_LINE 64 /* bytes */
#define LINE_OF(p) ((int)(CACHE_LINE / sizeof *(p))) /* elements of a line */

/* Data needed next: `rows` rows of `width` bytes; row r is at p + r * stride, or with places at
 * p + places[r] * stride. */
typedef struct ahead {
    const __global char *p;
    const __local int *places; /* or 0 */
    int rows, stride, width, each; /* each: rows fetched per turn */
} ahead;

/* Rows of `columns` elements, `stride` elements apart; n adjacent elements; no rows. */
#define AHEAD_ROWS(p, rows, stride, columns)                                                       \
    ((ahead){(const __global char *)(p), 0, rows, (stride) * (int)sizeof *(p),                     \
             (columns) * (int)sizeof *(p), rows})
#define AHEAD_RUN(p, n)                                                                            \
    AHEAD_ROWS(p, ((n) + LINE_OF(p) - 1) / LINE_OF(p), LINE_OF(p), LINE_OF(p))
#define AHEAD_NOTHING ((ahead){0, 0, 0, 0, 0, 0})

/* Spreads the fetches of `a` over so many turns. */
HELPER ahead in_turns(ahead a, int turns)
{
    if (a.rows > 0)
        a.each = (a.rows + turns - 1) / turns;
    return a;
}

/* Fetches rows first .. first + n - 1, to be read or to be written. */
HELPER void fetch_rows(ahead a, int first, int n, bool write)
{
#if FETCHES
    for (int r = first; r < first + n; r++) {
        const __global char *row = a.p + (a.places ? a.places[r] : r) * a.stride;

        for (int i = 0; i < a.width; i += CACHE_LINE)
            if (write)
                FETCH_WRITE(row + i);
            else
                FETCH(row + i);
    }
#endif
}

/* Fetches a turn's share. */
HELPER void fetch_turn(ahead a, int turn)
{
    if (a.rows > 0)
        fetch_rows(a, turn * a.each, min(a.each, a.rows - turn * a.each), false);
}

HELPER void fetch_all(ahead a)
{
    fetch_rows(a, 0, a.rows, false);
}

/* For an array worked on from front to back: if a line begins with element i, fetches the line
 * `bytes` further on. */
#define FETCH_STREAM(p, i, bytes)                                                             \
    do {                                                                                      \
        if ((int)(i) % LINE_OF(p) == 0)                                                       \
            FETCH_WRITE((p) + (i) + (bytes) / sizeof *(p));                                   \
    } while (0)
