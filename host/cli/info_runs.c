/* `cl-nascent info RUN RUN`: the runs' document (report/side_by_side.h), as it is or as a table
 * with a column for each run. A row with a text too long for its column has a line for each run. */
#include "cli/commands.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/number.h"
#include "cli/console.h"
#include "report/side_by_side.h"

enum { INDENT = 2, GAP = 2, NARROWEST = 9, COLUMNS = 80 };

typedef struct table {
    const json_t *names; /* of the runs, as columns have them */
    int label, width;    /* columns of a row's name, and of a run */
    int columns;         /* of the terminal */
} table;

typedef enum { TEXT, LIST, COUNT, DURATION, BYTES, REAL_2, REAL_3, REAL_4 } form; /* reals last */

static const struct {
    const char *key, *label;
    form form;
} labels[] = {
    {"tune", "kernel parameters", LIST},
    {"step", "steps", COUNT},
    {"seconds", "training time", DURATION},
    {"cpu_seconds", "processor time", DURATION},
    {"leaves", "leaves", COUNT},
    {"psnr_train", "PSNR train, of rays", REAL_2},
    {"psnr_test", "PSNR test", REAL_2},
    {"ssim", "SSIM test", REAL_4},
    {"lpips_alex", "LPIPS test, AlexNet", REAL_4},
    {"lpips_vgg", "LPIPS test, VGG-16", REAL_4},
    {"psnr_fitted", "PSNR test, fitted", REAL_2},
    {"psnr_exposed", "PSNR test, exposed", REAL_2},
    {"eval_views", "test views measured", COUNT},
    {"test_views", "of test views", COUNT},
    {"eval_step", "measured at step", COUNT},
    {"seconds_a_view", "seconds a view", REAL_3},
    {"device_peak", "device memory", BYTES},
    {"host_peak", "host memory", BYTES},
};

/* Rows that say nothing where they are as the other one. */
static const char *const pairs[][2] = {{"test_views", "eval_views"}, {"eval_step", "step"}};

/* "A=1,B=2" with spaces, at which a line may end. */
static json_t *list_cell(const char *list)
{
    char text[512];
    size_t used = 0;

    for (; *list && used + 3 < sizeof text; list++) {
        text[used++] = *list;
        if (*list == ',')
            text[used++] = ' ';
    }
    text[used] = 0;
    return json_string(text);
}

/* empty: what an empty text means. */
static json_t *cell_of(form as, const json_t *value, bool best, const char *empty)
{
    double number = json_number_value(value);
    const char *words = json_string_value(value), *end = NULL;
    char text[32];

    if (words && !*words)
        return json_string(empty);
    if (as == LIST && words)
        return list_cell(words);
    if (as == BYTES && words && cln_number_read(words, &number, &end) && !*end && number > 0)
        words = NULL; /* a setting's number is text */
    if (words || json_is_null(value))
        return json_string(words ? words : "-");
    if (as == DURATION)
        cln_format_duration(number, text);
    else if (as == BYTES)
        cln_format_bytes(number, text);
    else if (as >= REAL_2)
        cln_format_real(number, 2 + (int)(as - REAL_2), text);
    else
        cln_format_count(number, text);
    return json_sprintf("%s%s", text, best ? " *" : "");
}

/* Rows of a member of the document as they are printed: label -> texts. */
static json_t *shown(const json_t *document, const char *member)
{
    const json_t *rows = json_object_get(document, member);
    const bool settings = strcmp(member, "settings") == 0;
    const json_t *readable = settings ? json_object_get(document, "readable") : NULL;
    json_t *out = json_object(), *values = NULL;
    const char *key = NULL;

    json_object_foreach((json_t *)rows, key, values)
    {
        const json_t *best = json_object_get(json_object_get(document, "best"), key);
        const cln_config_row *row = settings ? cln_config_find(key) : NULL;
        const char *label = key;
        form as = row && row->flags & CLN_ROW_BYTES ? BYTES : TEXT;
        json_t *cells = NULL;
        bool told = false;

        for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++)
            told |= strcmp(key, pairs[i][0]) == 0 &&
                    (!json_object_get(rows, pairs[i][1]) ||
                     json_equal(values, json_object_get(rows, pairs[i][1])));
        if (told)
            continue;
        cells = json_array();
        for (size_t i = 0; i < sizeof labels / sizeof labels[0]; i++)
            if (strcmp(labels[i].key, key) == 0) {
                label = labels[i].label;
                as = labels[i].form;
            }
        for (size_t i = 0; i < json_array_size(values); i++) {
            const json_t *value = json_array_get(values, i);
            bool is_best = false;

            for (size_t k = 0; k < json_array_size(best); k++)
                is_best |= json_integer_value(json_array_get(best, k)) == (json_int_t)i;
            json_array_append_new(cells,
                                  json_is_null(value) && json_is_false(json_array_get(readable, i))
                                      ? json_string("?")
                                      : cell_of(as, value, is_best, settings ? "none" : "?"));
        }
        json_object_set_new(out, label, cells);
    }
    return out;
}

static int widest(const json_t *cells)
{
    int width = 0;

    for (size_t i = 0; i < json_array_size(cells); i++) {
        const int own = cln_name_width(json_string_value(json_array_get(cells, i)));

        width = own > width ? own : width;
    }
    return width;
}

static void print_row(const table *t, const char *label, const json_t *cells)
{
    const size_t count = json_array_size(cells);
    const int names = widest(t->names);

    printf("%*s", INDENT, "");
    if (widest(cells) > t->width) {
        printf("%s\n", label);
        for (size_t i = 0; i < count; i++) {
            const int begin = 2 * INDENT + names + GAP;

            printf("%*s", 2 * INDENT, "");
            cln_print_name(json_string_value(json_array_get(t->names, i)), names + GAP);
            cln_print_wrapped(begin, begin, t->columns,
                              json_string_value(json_array_get(cells, i)));
        }
        return;
    }
    cln_print_name(label, t->label);
    for (size_t i = 0; i < count; i++) {
        printf("%*s", GAP, "");
        cln_print_name(json_string_value(json_array_get(cells, i)), i + 1 < count ? t->width : 0);
    }
    putchar('\n');
}

static void print_rows(const table *t, const char *title, const json_t *rows)
{
    const char *label = NULL;
    json_t *cells = NULL;

    if (json_object_size(rows) > 0)
        printf("%s\n", title);
    json_object_foreach((json_t *)rows, label, cells) print_row(t, label, cells);
}

/* Makes columns as wide as the widest of the texts that fit, so that all runs do. */
static void measure(int count, const json_t *const sections[3], table *t)
{
    const char *label = NULL;
    json_t *cells = NULL;
    int most = 0;

    for (int s = 0; s < 3; s++)
        json_object_foreach((json_t *)sections[s], label, cells)
        {
            const int own = cln_name_width(label);
            t->label = own > t->label ? own : t->label;
        }
    most = (t->columns - INDENT - t->label) / count - GAP;
    t->width = NARROWEST;
    for (int s = 0; s < 3; s++)
        json_object_foreach((json_t *)sections[s], label, cells)
        {
            const int own = widest(cells);
            t->width = own > t->width && own <= most ? own : t->width;
        }
    if (widest(t->names) > t->width && widest(t->names) <= most)
        t->width = widest(t->names);
}

/* Whether a setting has no effect in one of the runs. */
static bool has_idle(const json_t *document)
{
    const json_t *readable = json_object_get(document, "readable");
    const char *key = NULL;
    json_t *values = NULL;

    json_object_foreach(json_object_get(document, "settings"), key, values)
    {
        for (size_t i = 0; i < json_array_size(values); i++)
            if (json_is_null(json_array_get(values, i)) &&
                json_is_true(json_array_get(readable, i)))
                return true;
    }
    return false;
}

/* Whether a run went on with other settings than it began with. */
static bool has_resumed(const json_t *document)
{
    const json_t *resumed = json_object_get(document, "resumed");

    for (size_t i = 0; i < json_array_size(resumed); i++)
        if (json_array_size(json_array_get(resumed, i)) > 0)
            return true;
    return false;
}

/* "PSNR test 27.82 +- 0.73, ..." of runs that differ by their seeds alone. */
static void print_spread(int columns, const json_t *document)
{
    const json_t *spread = json_object_get(document, "over_seeds");
    char line[512];
    size_t used =
        (size_t)snprintf(line, sizeof line, "Over %zu seeds, mean and standard deviation: ",
                         json_array_size(json_object_get(document, "runs")));

    if (json_object_size(spread) == 0)
        return;
    for (size_t i = 0; i < sizeof labels / sizeof labels[0]; i++) {
        const json_t *row = json_object_get(spread, labels[i].key);
        char mean[32], deviation[32];

        if (!row)
            continue;
        cln_format_real(json_number_value(json_object_get(row, "mean")),
                        2 + (int)(labels[i].form - REAL_2), mean);
        cln_format_real(json_number_value(json_object_get(row, "deviation")),
                        2 + (int)(labels[i].form - REAL_2), deviation);
        used += (size_t)snprintf(line + used, sizeof line - used, "%s %s +- %s; ", labels[i].label,
                                 mean, deviation);
    }
    line[used - 2] = 0;
    cln_print_wrapped(0, INDENT, columns, line);
}

static void print_table(const json_t *document)
{
    json_t *settings = shown(document, "settings"), *facts = shown(document, "facts");
    json_t *results = shown(document, "results"), *numbers = json_array();
    const json_t *const sections[3] = {settings, facts, results};
    const json_t *notes = json_object_get(document, "notes");
    table t = {.names = json_object_get(document, "names"), .columns = cln_stdout_columns(COLUMNS)};
    const int count = (int)json_array_size(t.names);
    const char *key = NULL;
    json_t *best = NULL;
    bool starred = false, numbered = false, all_read = true;

    measure(count, sections, &t);
    numbered = widest(t.names) > t.width;
    for (int i = 0; i < count; i++) {
        all_read &= json_is_true(json_array_get(json_object_get(document, "readable"), (size_t)i));
        for (int k = 0; k < i; k++)
            numbered |=
                json_equal(json_array_get(t.names, (size_t)i), json_array_get(t.names, (size_t)k));
    }
    for (int i = 0; i < count && numbered; i++) {
        json_array_append_new(numbers, json_sprintf("(%d)", i + 1));
        printf("(%d) ", i + 1);
        cln_print_name(json_string_value(json_array_get(t.names, (size_t)i)), 0);
        putchar('\n');
    }
    t.names = numbered ? numbers : t.names;
    print_row(&t, "", t.names);
    print_rows(&t, "settings that differ", settings);
    print_rows(&t, "also different", facts);
    print_rows(&t, "results", results);
    putchar('\n');
    json_object_foreach(json_object_get(document, "best"), key, best) starred |=
        json_array_size(best) > 0;
    if (starred)
        puts("*: the best of its row");
    if (has_idle(document))
        puts("-: without effect there");
    if (all_read && json_object_size(settings) == 0)
        puts(has_resumed(document) ? "No setting of the last start differs."
                                   : "No setting differs.");
    print_spread(t.columns, document);
    for (size_t i = 0; i < json_array_size(notes); i++)
        cln_print_wrapped(0, INDENT, t.columns, json_string_value(json_array_get(notes, i)));
    json_decref(settings);
    json_decref(facts);
    json_decref(results);
    json_decref(numbers);
}

cln_status cln_info_runs(const cln_options *options)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    CLN_TRY(cln_side_by_side(options->operand_count, options->operands, &document));
    if (options->json)
        CLN_TRY(cln_print_json(json_incref(document)));
    else
        print_table(document);
done:
    json_decref(document);
    return st;
}
