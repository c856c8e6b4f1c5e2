/* build/device-cases: the table of cases on one device. Every check of the self-test against
 * float64 is a row, and so is each of its outputs, compared with another device's.
 *
 *   -d SPEC         the device, as `cl-nascent -d`
 *   -k FOLDER       kernel folder, as --kernel-dir
 *   -t TUNE         as --tune
 *   -s SHAPES       quick, all (default) or tiny (for simulators)
 *   -r FILE         write the outputs to it
 *   -a FILE         compare with these outputs: whole numbers exactly, floats by the check's bounds
 *
 * Rows: "passed|failed|skipped  CASE  DETAIL"; the last line is "N passed, N failed, N skipped".
 * Exit code 1 if any failed. Buffers start as NaN: a kernel that reads unwritten memory fails its
 * row. tests/device/devices.sh runs it on every device. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/log.h"
#include "check/selftest.h"

typedef struct record {
    char name[96];
    uint32_t discrete;
    uint64_t n;
    double nmse, worst;
} record;

typedef struct table {
    FILE *write, *against;
    int passed, failed, skipped;
} table;

static void row(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    table *t = user;

    *(skipped ? &t->skipped : passed ? &t->passed : &t->failed) += 1;
    printf("%-7s  %-52s  %s\n",
           skipped  ? "skipped"
           : passed ? "passed"
                    : "failed",
           name, detail ? detail : "");
    fflush(stdout);
}

/* Reads the next outputs of the other device, which are in the same order. */
static bool read_other(FILE *f, const cln_output *o, uint32_t **values, char why[256])
{
    record r = {.n = 0};

    *values = NULL;
    if (fread(&r, sizeof r, 1, f) != 1) {
        snprintf(why, 256, "the other device has no outputs here");
        return false;
    }
    *values = malloc((r.n ? r.n : 1) * sizeof **values);
    if (!*values || fread(*values, sizeof **values, r.n, f) != r.n) {
        snprintf(why, 256, "the other device's outputs cannot be read");
        return false;
    }
    if (strcmp(r.name, o->name) != 0 || r.n != o->n || r.discrete != (uint32_t)o->discrete) {
        snprintf(why, 256, "%zu outputs, the other device has %llu of '%s'", o->n,
                 (unsigned long long)r.n, r.name);
        return false;
    }
    return true;
}

static bool same_numbers(const uint32_t *got, const uint32_t *want, size_t n, char text[256])
{
    for (size_t i = 0; i < n; i++)
        if (got[i] != want[i]) {
            snprintf(text, 256, "number %zu of %zu is %u, the other device has %u", i, n, got[i],
                     want[i]);
            return false;
        }
    snprintf(text, 256, "%zu numbers equal", n);
    return true;
}

static bool near_values(const cln_output *o, const uint32_t *bits, char text[256])
{
    bool near = false;
    double *want = malloc((o->n ? o->n : 1) * sizeof *want);

    if (!want) {
        snprintf(text, 256, "out of memory");
        return false;
    }
    for (size_t i = 0; i < o->n; i++) {
        float value;

        memcpy(&value, &bits[i], sizeof value);
        want[i] = value;
    }
    near = cln_compare_values(o->values, want, o->n, o->nmse, o->worst, text);
    free(want);
    return near;
}

static void compare(table *t, const cln_output *o)
{
    char name[128], text[256];
    uint32_t *other = NULL;
    bool same = false;

    snprintf(name, sizeof name, "%s, as on the other", o->name);
    if (read_other(t->against, o, &other, text))
        same =
            o->discrete ? same_numbers(o->numbers, other, o->n, text) : near_values(o, other, text);
    row(name, same, false, text, t);
    free(other);
}

static void on_outputs(const cln_output *o, void *user)
{
    table *t = user;
    record r = {.discrete = o->discrete, .n = o->n, .nmse = o->nmse, .worst = o->worst};

    snprintf(r.name, sizeof r.name, "%s", o->name);
    if (t->write &&
        (fwrite(&r, sizeof r, 1, t->write) != 1 ||
         fwrite(o->discrete ? (const void *)o->numbers : o->values, 4, o->n, t->write) != o->n))
        row(o->name, false, false, "its outputs cannot be written", t);
    if (t->against)
        compare(t, o);
}

static bool open_file(const char *path, const char *mode, FILE **out)
{
    *out = path ? fopen(path, mode) : NULL;
    if (!path || *out)
        return true;
    perror(path);
    return false;
}

int main(int argc, char **argv)
{
    static const char *const sets[] = {[CLN_SHAPES_QUICK] = "quick", "all", "tiny"};
    table t = {.passed = 0};
    cln_device_desc desc = {.spec = NULL};
    cln_selftest_plan plan = {
        .shapes = CLN_SHAPES_ALL, .sink = row, .outputs = on_outputs, .user = &t};
    const char *write = NULL, *against = NULL;
    cln_device *device = NULL;
    cln_status st = CLN_OK;
    int option, set = CLN_SHAPES_ALL;

    cln_log_set_sink(cln_log_stderr, NULL);
    while ((option = getopt(argc, argv, "d:k:t:s:r:a:")) != -1)
        switch (option) {
        case 'd':
            desc.spec = optarg;
            break;
        case 'k':
            desc.kernel_dir = optarg;
            break;
        case 't':
            desc.tune = optarg;
            break;
        case 's':
            for (set = 0; set <= CLN_SHAPES_TINY && strcmp(sets[set], optarg) != 0; set++)
                continue;
            break;
        case 'r':
            write = optarg;
            break;
        case 'a':
            against = optarg;
            break;
        default:
            return 2;
        }
    if (set > CLN_SHAPES_TINY || optind < argc) {
        fputs("usage: device-cases [-d SPEC] [-k FOLDER] [-t TUNE] [-s quick|all|tiny] [-r FILE] "
              "[-a FILE]\n",
              stderr);
        return 2;
    }
    plan.shapes = (cln_shapes)set;
    if (!open_file(write, "wb", &t.write) || !open_file(against, "rb", &t.against))
        return 2;
    st = cln_device_open(&desc, &device);
    if (st == CLN_OK) {
        printf("device   %s, %s, %s\n", device->info.name, device->info.platform,
               device->info.driver);
        device->spoil = true;
        st = cln_selftest_device(device, &plan);
    }
    /* a failed check has its row already, unless it gave no verdict */
    if (st != CLN_OK && t.failed == 0)
        row("device", false, false, cln_error_text(), &t);
    else if (st != CLN_OK && st != CLN_CHECK)
        row("the rest", false, false, cln_error_text(), &t);
    cln_device_close(device);
    if (t.write && fclose(t.write) != 0) {
        perror(write);
        t.failed++;
    }
    if (t.against)
        fclose(t.against);
    printf("%d passed, %d failed, %d skipped\n", t.passed, t.failed, t.skipped);
    return t.failed > 0;
}
