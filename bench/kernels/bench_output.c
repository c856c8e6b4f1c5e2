/* Rows of the kernel benches as lines of a table, as JSON and as CSV. Columns: docs/benches.md. */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/commit.h"
#include "base/files.h"
#include "bench.h"
#include "common/csv.h"

#ifndef BENCH_COMMIT /* make gives git's description of the checkout */
#define BENCH_COMMIT "unknown"
#endif

static double gflops(const bench_row *row)
{
    return row->work.flop / row->time.min * 1e-9;
}

static double gbps(const bench_row *row)
{
    return row->work.bytes / row->time.min * 1e-9;
}

void bench_print_row(const bench *b, const bench_row *row)
{
    const char *bound = NULL;
    const double share = bench_share(row, &bound);

    if (row == b->rows)
        printf("%-20s %-32s %10s %9s %8s %14s %9s %9s\n", "kernel", "shape", "ms", "GFLOP/s",
               "GB/s", "of ceiling", "NMSE", "worst");
    printf("%-20s %-32s %10.4g %9.4g %8.4g %7.1f %% %-4s %9.2g %9.2g%s\n", row->kernel, row->shape,
           row->time.min * 1e3, gflops(row), gbps(row), 100 * share, bound, row->errors.nmse,
           row->errors.worst,
           row->errors.failed ? "  WRONG"
           : row->above       ? "  ABOVE THE CEILING"
                              : "");
    fflush(stdout);
}

/* Numbers that JSON cannot hold become null. */
static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *kernels_of(const bench_row *row)
{
    json_t *list = json_array();

    for (const char *at = row->kernels; *at;) {
        const size_t length = strcspn(at, " ");

        json_array_append_new(list, json_stringn(at, length));
        at += length + (at[length] == ' ');
    }
    return list;
}

void bench_print_json(const bench *b, const bench_row *row)
{
    const char *bound = NULL;
    const double share = bench_share(row, &bound);
    json_t *seconds = json_pack("{s:o,s:o,s:o}", "min", number(row->time.min), "median",
                                number(row->time.median), "max", number(row->time.max));
    json_t *object = json_pack(
        "{s:s,s:s,s:s,s:o,s:s,s:o,s:o,s:o,s:o,s:o,s:o,s:s,s:o,s:o,s:b,s:I,s:b,s:s,s:s,s:s,s:s}",
        "name", row->name, "family", row->family, "kernel", row->kernel, "kernels", kernels_of(row),
        "shape", row->shape, "seconds", seconds, "gflops", number(gflops(row)), "gbps",
        number(gbps(row)), "fma_gflops", number(row->fma * 1e-9), "copy_gbps",
        number(row->copy * 1e-9), "share", number(share), "bound", bound, "nmse",
        number(row->errors.nmse), "worst", number(row->errors.worst), "exact", row->errors.exact,
        "compared", (json_int_t)row->errors.compared, "ok", bench_ok(row), "tune", row->tune,
        "device", b->device->info.name, "driver", b->device->info.driver, "commit", cln_commit());

    if (object && json_dumpf(object, stdout, JSON_REAL_PRECISION(6)) == 0)
        putchar('\n');
    fflush(stdout);
    json_decref(object);
}

cln_status bench_write_csv(const bench *b, const char *path)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    FILE *to = NULL;

    CLN_TRY(cln_atomic_open(path, &file));
    to = cln_atomic_stream(file);
    fputs("name,kernel,shape,seconds_min,seconds_median,seconds_max,gflops,gbps,fma_gflops,"
          "copy_gbps,share,bound,nmse,worst,exact,compared,ok,tune,device,driver,version,commit\n",
          to);
    for (int i = 0; i < b->row_count; i++) {
        const bench_row *row = &b->rows[i];
        const char *bound = NULL;
        const double share = bench_share(row, &bound);

        fprintf(to,
                "%s,%s,%s,%.5g,%.5g,%.5g,%.5g,%.5g,%.5g,%.5g,%.4g,%s,%.3g,%.3g,%d,%zu,%d,\"%s\",",
                row->name, row->kernel, row->shape, row->time.min, row->time.median, row->time.max,
                gflops(row), gbps(row), row->fma * 1e-9, row->copy * 1e-9, share, bound,
                row->errors.nmse, row->errors.worst, row->errors.exact, row->errors.compared,
                bench_ok(row), row->tune);
        csv_text(to, b->device->info.name);
        fputc(',', to);
        csv_text(to, b->device->info.driver);
        fprintf(to, ",%s,%s\n", CLN_VERSION, cln_commit());
    }
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
