/* Depth files. See depth_file.h. */
#include "io/depth_file.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/files.h"
#include "base/memory.h"
#include "io/png16.h"

/* Numbers are written as they are in memory. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "PFM of little-endian hosts");

cln_status cln_depth_write_png16(const char *path, int width, int height, const float *depth,
                                 double unit, int *beyond, int *behind)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)width * (size_t)height;
    uint16_t *values = NULL;
    int over = 0, under = 0;

    CLN_TRY(cln_alloc(&values, n, sizeof *values, "depth"));
    for (size_t i = 0; i < n; i++) {
        const double steps = round(depth[i] / unit);

        values[i] = steps > 0 ? (uint16_t)fmin(steps, 65535) : 0;
        over += steps > 65535;
        under += steps < 0;
    }
    CLN_TRY(cln_png16_write(path, width, height, 1, values));
    if (beyond)
        *beyond = over;
    if (behind)
        *behind = under;
done:
    free(values);
    return st;
}

cln_status cln_depth_write_pfm(const char *path, int width, int height, const float *depth)
{
    cln_status st = CLN_OK;
    char head[64];
    const int bytes = snprintf(head, sizeof head, "Pf\n%d %d\n-1.0\n", width, height);
    cln_atomic_file *file = NULL;

    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, head, (size_t)bytes));
    for (int y = height - 1; y >= 0; y--)
        CLN_TRY(cln_atomic_write(file, depth + (size_t)y * (size_t)width,
                                 (size_t)width * sizeof *depth));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
