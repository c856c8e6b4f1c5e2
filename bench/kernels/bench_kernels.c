/* build/bench-kernels: every kernel of the pipeline, through the stages that training calls, from
 * tiny to large: time, GFLOP/s and GB/s beside ceilings measured in the same run, error against
 * float64. Exit code 10 if a result is wrong or a row is above the FMA ceiling. docs/benches.md
 * explains the columns. */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "bench.h"

static const bench_family *const families[] = {
    &bench_networks, &bench_arithmetic,   &bench_upload, &bench_rays,       &bench_splat,
    &bench_scan,     &bench_sort,         &bench_sort64, &bench_group,      &bench_composite,
    &bench_leaf,     &bench_distil,       &bench_stats,  &bench_regularise, &bench_carry,
    &bench_voxels,   &bench_carry_voxels,
};
enum { FAMILIES = sizeof families / sizeof families[0], ONLY = 32 };

/* Kernels that some family's list must contain; not those for ranks, which a bench of one process
 * does not run, nor intervals_crop, which is intervals_fill with a few more lines. */
static const char *const all_kernels[] = {
#define X(member, kernel, program, when) #member,
    CLN_KERNEL_LIST(X)
#undef X
};

static const char usage[] =
    "usage: build/bench-kernels [OPTION]...\n"
    "Times every kernel beside this device's ceilings, and compares it with float64.\n"
    "  -d, --device SPEC      auto, gpu, cpu, a number or part of a name (CL_NASCENT_DEVICE)\n"
    "      --tune LIST        parameters over the device's, such as VW=8,TS=6\n"
    "      --kernel-dir DIR   kernels from this folder\n"
    "      --only NAME[,...]  rows whose name, family or a kernel of it begins so; may be "
    "repeated\n"
    "      --budget SECONDS   of timing a row (default 0.3)\n"
    "      --list             the rows' names and kernels, nothing is run\n"
    "      --json             one JSON object a row on standard output\n"
    "      --csv FILE         all rows as CSV\n"
    "      --results DIR      DIR/DEVICE.csv, .html (a page with plots) and .md (tables)\n"
    "  -h, --help             this text\n";

typedef struct arguments {
    cln_device_desc device;
    char *only[ONLY]; /* prefixes */
    int only_count;
    double budget;
    bool list, json, help;
    const char *csv, *results;
} arguments;

static cln_status add_only(arguments *a, const char *text)
{
    cln_status st = CLN_OK;

    while (*text) {
        const size_t length = strcspn(text, ",");

        if (a->only_count == ONLY)
            return cln_fail(CLN_USAGE, "--only: at most %d names; give shorter ones", ONLY);
        if (length > 0)
            CLN_TRY(cln_asprintf(&a->only[a->only_count++], "%.*s", (int)length, text));
        text += length + (text[length] == ',');
    }
done:
    return st;
}

static cln_status read_arguments(int argc, char **argv, arguments *a)
{
    enum { TUNE = 256, KERNEL_DIR, ONLY_NAME, BUDGET, LIST, JSON, CSV, RESULTS };
    static const struct option options[] = {{"device", required_argument, NULL, 'd'},
                                            {"tune", required_argument, NULL, TUNE},
                                            {"kernel-dir", required_argument, NULL, KERNEL_DIR},
                                            {"only", required_argument, NULL, ONLY_NAME},
                                            {"budget", required_argument, NULL, BUDGET},
                                            {"list", no_argument, NULL, LIST},
                                            {"json", no_argument, NULL, JSON},
                                            {"csv", required_argument, NULL, CSV},
                                            {"results", required_argument, NULL, RESULTS},
                                            {"help", no_argument, NULL, 'h'},
                                            {NULL, 0, NULL, 0}};
    cln_status st = CLN_OK;
    const char *end = NULL;
    int c = 0;

    a->device.spec = getenv("CL_NASCENT_DEVICE");
    a->budget = 0.3;
    opterr = 0;
    while ((c = getopt_long(argc, argv, "d:h", options, NULL)) != -1) {
        if (c == 'd')
            a->device.spec = optarg;
        else if (c == TUNE)
            a->device.tune = optarg;
        else if (c == KERNEL_DIR)
            a->device.kernel_dir = optarg;
        else if (c == ONLY_NAME)
            CLN_TRY(add_only(a, optarg));
        else if (c == LIST)
            a->list = true;
        else if (c == JSON)
            a->json = true;
        else if (c == CSV)
            a->csv = optarg;
        else if (c == RESULTS)
            a->results = optarg;
        else if (c == 'h')
            a->help = true;
        else if (c != BUDGET)
            return cln_fail(CLN_USAGE, "%s: no such option, or its value is missing; see --help",
                            argv[optind - 1]);
        else if (!cln_number_read(optarg, &a->budget, &end) || *end || !(a->budget > 0))
            return cln_fail(CLN_USAGE, "--budget %s: it takes seconds above 0", optarg);
    }
    if (optind < argc)
        return cln_fail(CLN_USAGE, "%s: unexpected argument; give names of rows with --only",
                        argv[optind]);
done:
    return st;
}

/* ---- which rows ---- */

static bool begins(const char *text, const char *with)
{
    return strncmp(text, with, strlen(with)) == 0;
}

static bool any_kernel_begins(const char *kernels, const char *with)
{
    for (const char *at = kernels; at; at = strchr(at, ' ')) {
        at += *at == ' ';
        if (begins(at, with))
            return true;
    }
    return false;
}

/* Does the name of this part match one of the prefixes? */
static bool is_wanted(const arguments *a, const bench_family *family, const bench_part *part,
                      const char *name)
{
    for (int i = 0; i < a->only_count; i++)
        if (begins(name, a->only[i]) || begins(family->name, a->only[i]) ||
            any_kernel_begins(part->kernels, a->only[i]))
            return true;
    return a->only_count == 0;
}

/* Marks the wanted parts of a shape in b->wanted; returns their number. */
static int want(bench *b, const arguments *a, const bench_family *family, int shape)
{
    int count = 0;

    CLN_ASSERT(family->part_count <= BENCH_PARTS);
    b->family = family;
    family->shape(shape, b->shape);
    for (int p = 0; p < family->part_count; p++) {
        char name[BENCH_NAME];

        bench_name(family, p, b->shape, name);
        b->wanted[p] = is_wanted(a, family, &family->parts[p], name);
        count += b->wanted[p];
        if (b->wanted[p] && a->list)
            printf("%-44s %s\n", name, family->parts[p].kernels);
    }
    return count;
}

/* A kernel that no row covers is a bug of this program. */
static cln_status check_coverage(void)
{
    for (size_t k = 0; k < sizeof all_kernels / sizeof all_kernels[0]; k++) {
        const size_t length = strlen(all_kernels[k]);
        bool covered = begins(all_kernels[k], "share_") || begins(all_kernels[k], "stretch_") ||
                       begins(all_kernels[k], "halo_") || begins(all_kernels[k], "walk_") ||
                       strcmp(all_kernels[k], "intervals_crop") == 0;

        for (int f = 0; f < FAMILIES; f++)
            for (int p = 0; p < families[f]->part_count; p++)
                for (const char *at = families[f]->parts[p].kernels; at; at = strchr(at, ' ')) {
                    at += *at == ' ';
                    covered = covered || (strcspn(at, " ") == length && begins(at, all_kernels[k]));
                }
        if (!covered)
            return cln_fail(CLN_INTERNAL, "kernel %s is in no bench; add it to one of bench/",
                            all_kernels[k]);
    }
    return CLN_OK;
}

/* ---- files ---- */

/* "Intel(R) Arc A770" -> "intel-r-arc-a770" */
static void slug_of(const char *name, char out[128])
{
    int used = 0;

    for (const char *c = name; *c && used < 127; c++) {
        const bool upper = *c >= 'A' && *c <= 'Z';

        if (upper || (*c >= 'a' && *c <= 'z') || (*c >= '0' && *c <= '9'))
            out[used++] = (char)(upper ? *c - 'A' + 'a' : *c);
        else if (used > 0 && out[used - 1] != '-')
            out[used++] = '-';
    }
    while (used > 0 && out[used - 1] == '-')
        used--;
    out[used] = 0;
}

static cln_status write_results(const bench *b, const char *dir, bool quiet)
{
    static const struct {
        const char *suffix;
        cln_status (*write)(const bench *b, const char *path);
    } files[] = {
        {"csv", bench_write_csv}, {"html", bench_write_page}, {"md", bench_write_markdown}};
    cln_status st = CLN_OK;
    char *path = NULL, slug[128];

    slug_of(b->device->info.name, slug);
    CLN_TRY(cln_make_dirs(dir));
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s/%s.%s", dir, slug, files[i].suffix));
        CLN_TRY(files[i].write(b, path));
        if (!quiet)
            printf("%s\n", path);
    }
done:
    free(path);
    return st;
}

/* Rows that no reader should believe fail the bench. */
static cln_status check_rows(const bench *b)
{
    const bench_row *wrong = NULL, *above = NULL;
    int failed = 0, beyond = 0;

    for (int i = 0; i < b->row_count; i++) {
        const bench_row *row = &b->rows[i];

        failed += row->errors.failed;
        beyond += row->above;
        wrong = row->errors.failed && !wrong ? row : wrong;
        above = row->above && !above ? row : above;
    }
    if (wrong)
        return cln_fail(CLN_CHECK, "%d of %d rows are wrong, first %s: NMSE %.3g, worst %.3g rms",
                        failed, b->row_count, wrong->name, wrong->errors.nmse, wrong->errors.worst);
    if (above)
        return cln_fail(CLN_CHECK,
                        "%d of %d rows are above %.0f %% of the FMA ceiling, first %s: %.4g of "
                        "%.4g GFLOP/s; the probe (kernels/peak.cl) is no ceiling on this device, "
                        "or the row's FLOP (bench_work.c) are too many",
                        beyond, b->row_count, 100 * BENCH_MOST_SHARE, above->name,
                        above->work.flop / above->time.min * 1e-9, above->fma * 1e-9);
    return CLN_OK;
}

static cln_status run(bench *b, const arguments *a)
{
    cln_status st = CLN_OK;
    int rows = 0;

    for (int f = 0; f < FAMILIES; f++)
        for (int s = 0; s < families[f]->shape_count; s++) {
            const int wanted = want(b, a, families[f], s);

            rows += wanted;
            if (wanted == 0 || a->list)
                continue;
            st = families[f]->run(b, s);
            if (st != CLN_OK) {
                cln_note("benching %s, %s", families[f]->name, b->shape);
                goto done;
            }
        }
    if (rows == 0) {
        st = cln_fail(CLN_USAGE,
                      "--only: no row, family or kernel has a name that begins so; see --list");
        goto done;
    }
    if (a->list)
        goto done;
    if (a->csv)
        CLN_TRY(bench_write_csv(b, a->csv));
    if (a->results)
        CLN_TRY(write_results(b, a->results, a->json));
    CLN_TRY(check_rows(b));
done:
    return st;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;
    arguments a = {.budget = 0};
    bench b;

    cln_log_set_sink(cln_log_stderr, NULL);
    memset(&b, 0, sizeof b);
    CLN_TRY(read_arguments(argc, argv, &a));
    if (a.help) {
        fputs(usage, stdout);
        goto done;
    }
    CLN_TRY(check_coverage());
    b.budget = a.budget;
    b.report = a.json ? bench_print_json : bench_print_row;
    if (!a.list) {
        CLN_TRY(bench_open(&b, &a.device));
        if (!a.json)
            printf("%s, driver %s\n", b.device->info.name, b.device->info.driver);
    }
    CLN_TRY(run(&b, &a));
done:
    if (st != CLN_OK)
        fprintf(stderr, "bench-kernels: %s\n", cln_error_text());
    bench_close(&b);
    for (int i = 0; i < a.only_count; i++)
        free(a.only[i]);
    return cln_status_exit_code(st);
}
