/* The kernel benches as one HTML page with plots, and as tables in Markdown. A plot places the
 * variants of arithmetic: agreement with float64 over run time; up and left is better. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/files.h"
#include "bench.h"
#include "report/html.h"
#include "report/report_style.h"
#include "common/plot.h"

enum { POINTS = 32 };

static const char *time_text(double seconds, char out[32])
{
    if (seconds < 1e-3)
        snprintf(out, 32, "%.3g us", seconds * 1e6);
    else if (seconds < 1)
        snprintf(out, 32, "%.3g ms", seconds * 1e3);
    else
        snprintf(out, 32, "%.3g s", seconds);
    return out;
}

static bool is_arithmetic(const bench_row *row)
{
    return strcmp(row->family, bench_arithmetic.name) == 0;
}

/* ---- the page ---- */

/* One plot per kernel of the arithmetic family. */
static void put_plot(FILE *to, const bench *b, int part)
{
    const bench_part *of = &bench_arithmetic.parts[part];
    plot_line lines[POINTS];
    char title[96];
    int count = 0;

    for (int i = 0; i < b->row_count && count < POINTS; i++) {
        const bench_row *row = &b->rows[i];

        if (!is_arithmetic(row) || strcmp(row->kernel, of->kernel) != 0)
            continue;
        lines[count++] = (plot_line){.label = row->shape,
                                     .end_seconds = row->time.min,
                                     .end_psnr = -10 * log10(row->errors.nmse)};
    }
    if (count == 0)
        return;
    snprintf(title, sizeof title, "%s: agreement with float64 over run time", of->kernel);
    plot_write(to, &(plot_text){title, "seconds of a call", "-10 log10 NMSE, dB"}, lines, count);
}

static void put_row(FILE *to, const bench_row *row)
{
    const char *bound = NULL;
    const double share = bench_share(row, &bound);
    char text[32];

    fprintf(to, "<tr><td class='name'><code>%s</code></td><td>%s</td><td class='n'>%s</td>",
            row->kernel, row->shape, time_text(row->time.min, text));
    fprintf(to, "<td class='n'>%s</td>", time_text(row->time.max, text));
    if (row->work.flop > 0)
        fprintf(to, "<td class='n'>%.4g</td>", row->work.flop / row->time.min * 1e-9);
    else
        fputs("<td></td>", to);
    fprintf(to, "<td class='n'>%.3g</td><td class='n'>%.1f %%</td>",
            row->work.bytes / row->time.min * 1e-9, 100 * share);
    fprintf(to, "<td><span class='bar' style='width:%.0fpx'></span> %s</td>",
            140 * fmin(share, 1.3), bound);
    if (row->errors.exact)
        fprintf(to, "<td class='n' colspan='2'>%s</td></tr>\n",
                row->errors.failed ? "WRONG" : "equal");
    else
        fprintf(to, "<td class='n'>%.1e</td><td class='n'>%.1e%s</td></tr>\n", row->errors.nmse,
                row->errors.worst, row->errors.failed ? " WRONG" : "");
}

cln_status bench_write_page(const bench *b, const char *path)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    const cln_device_info *info = &b->device->info;
    FILE *to = NULL;
    const char *family = "";

    CLN_TRY(cln_atomic_open(path, &file));
    to = cln_atomic_stream(file);
    fputs("<!doctype html><html lang='en'><meta charset='utf-8'><title>Kernel benches: ", to);
    cln_html_text(to, info->name);
    fprintf(to, "</title><style>%s</style><main><h1>Kernel benches</h1><p class='soft'>",
            report_style);
    cln_html_text(to, info->name);
    fputs(", driver ", to);
    cln_html_text(to, info->driver);
    fputs(", cl-nascent " CLN_VERSION "</p><p>A bar is the share of the binding ceiling, FMA or "
          "copy, measured between the row's series of calls. GFLOP/s and GB/s count what the "
          "method needs "
          "at least (docs/benches.md). Times: the fastest and the slowest of five series of calls."
          "</p><h2>Arithmetic</h2>",
          to);
    for (int part = 0; part < bench_arithmetic.part_count; part++)
        put_plot(to, b, part);
    for (int i = 0; i < b->row_count; i++) {
        const bench_row *row = &b->rows[i];

        if (strcmp(family, row->family) != 0) {
            fprintf(to,
                    "%s<h2>%s</h2><table class='wide'><tr><th>kernel<th>shape<th "
                    "class='n'>fastest<th class='n'>slowest<th class='n'>GFLOP/s<th "
                    "class='n'>GB/s<th class='n'>share<th>of<th class='n'>NMSE<th "
                    "class='n'>worst / rms</tr>\n",
                    *family ? "</table>" : "", row->family);
            family = row->family;
        }
        put_row(to, row);
    }
    fprintf(to, "%s</main></html>\n", *family ? "</table>" : "");
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}

/* ---- Markdown ---- */

/* The strict row of the same kernel and preset; it precedes row i. */
static const bench_row *strict_of(const bench *b, int i)
{
    const size_t same = strcspn(b->rows[i].shape, " ");

    for (int k = 0; k < b->row_count; k++)
        if (is_arithmetic(&b->rows[k]) && strcmp(b->rows[k].kernel, b->rows[i].kernel) == 0 &&
            strncmp(b->rows[k].shape, b->rows[i].shape, same + 1) == 0)
            return &b->rows[k];
    return &b->rows[i];
}

static void put_arithmetic(FILE *to, const bench *b)
{
    fputs(
        "| kernel | network, leaves x samples, arithmetic | time | of strict | NMSE | worst / rms "
        "|\n|---|---|---|---|---|---|\n",
        to);
    for (int i = 0; i < b->row_count; i++) {
        const bench_row *row = &b->rows[i];
        char text[32];

        if (is_arithmetic(row))
            fprintf(to, "| %s | %s | %s | %.0f %% | %.1e | %.1e |\n", row->kernel, row->shape,
                    time_text(row->time.min, text), 100 * row->time.min / strict_of(b, i)->time.min,
                    row->errors.nmse, row->errors.worst);
    }
}

cln_status bench_write_markdown(const bench *b, const char *path)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    FILE *to = NULL;

    CLN_TRY(cln_atomic_open(path, &file));
    to = cln_atomic_stream(file);
    fprintf(to,
            "%s, driver %s:\n\n| kernel | shape | time | GFLOP/s | GB/s | share of ceiling | NMSE "
            "|\n|---|---|---|---|---|---|---|\n",
            b->device->info.name, b->device->info.driver);
    for (int i = 0; i < b->row_count; i++) {
        const bench_row *row = &b->rows[i];
        const char *bound = NULL;
        const double share = bench_share(row, &bound);
        char text[32];

        if (is_arithmetic(row))
            continue;
        fprintf(to, "| %s | %s | %s | %.3g | %.3g | %.0f %% %s | ", row->kernel, row->shape,
                time_text(row->time.min, text), row->work.flop / row->time.min * 1e-9,
                row->work.bytes / row->time.min * 1e-9, 100 * share, bound);
        if (row->errors.exact)
            fputs("equal |\n", to);
        else
            fprintf(to, "%.1e |\n", row->errors.nmse);
    }
    fputs("\nArithmetic:\n\n", to);
    put_arithmetic(to, b);
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
