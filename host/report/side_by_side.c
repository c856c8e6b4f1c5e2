/* See side_by_side.h. Values of a row stand in the order of the runs. Settings and facts are listed
 * only where runs differ in them. A setting counts by what it came to with the run's scene ("auto"
 * is what was chosen), and is null in a run where it has no effect. */
#include "report/side_by_side.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "base/text.h"
#include "io/json.h"
#include "io/run_history.h"
#include "io/run_folder.h"
#include "model/model.h"
#include "report/report_data.h"
#include "report/report_sections.h"
#include "scene/reader.h"

typedef struct side {
    const char *run;  /* as given */
    char *path;       /* from the root */
    const char *name; /* of the folder; `run` where two have the same */
    cln_report_data data;
    const json_t *dataset;
    int64_t model; /* its step; INT64_MAX: not told, or another process trains it */
    cln_config config;
    bool readable; /* config; else it is another version's */
    bool idle[CLN_SETTINGS_MAX];
    json_t *facts;   /* by key: a text */
    json_t *figures; /* by key: a number or null */
} side;

enum { VALUE_BYTES = CLN_TEXT_BYTES };

/* Figures, and by how many decimals two of a figure of quality are equally good (0: no such). */
static const struct {
    const char *key;
    bool test; /* of test views */
    int quality;
} rows[] = {{"step", false, 0},        {"seconds", false, 0},     {"cpu_seconds", false, 0},
            {"leaves", false, 0},      {"psnr_train", false, 2},  {"psnr_test", true, 2},
            {"ssim", true, 4},         {"lpips_alex", true, 0},   {"lpips_vgg", true, 0},
            {"psnr_fitted", true, 2},  {"psnr_exposed", true, 2}, {"eval_views", true, 0},
            {"test_views", true, 0},   {"eval_step", true, 0},    {"seconds_a_view", true, 0},
            {"device_peak", false, 0}, {"host_peak", false, 0}};
enum { ROWS = sizeof rows / sizeof rows[0] };

/* ---- reading ---- */

/* The last evaluation of all test views as they are or, without one, the last of some; or NULL. */
static const cln_report_eval *choose_eval(const side *s)
{
    const double tests = cln_json_number(json_object_get(s->dataset, "splits"), "test");
    const cln_report_eval *chosen = NULL;
    bool whole = false;

    for (int i = 0; i < s->data.eval_count; i++) {
        const cln_report_eval *e = &s->data.evals[i];

        if (strcmp(e->split, "test") != 0 || e->how[0] || (whole && e->images < tests))
            continue;
        whole = e->images >= tests;
        chosen = e;
    }
    return chosen;
}

static void put(side *s, const char *key, double value)
{
    json_object_set_new(s->figures, key,
                        value == floor(value) && fabs(value) < 1e15
                            ? json_integer((json_int_t)value)
                            : cln_json_real(value));
}

/* What a column of metrics.jsonl has in the last row until `step` with a number in `where`; NaN
 * without. */
static double last_of(const side *s, double step, const double *column, const double *where)
{
    int i = s->data.rows.count - 1;

    while (i >= 0 && (!isfinite(where[i]) || s->data.rows.step[i] > step))
        i--;
    return i >= 0 ? column[i] : NAN;
}

/* Figures of the end or, before it, of metrics.jsonl; those of test views by an evaluation. */
static void find_figures(side *s)
{
    static const char *const ends[] = {"step",        "seconds",   "cpu_seconds", "leaves",
                                       "psnr_train",  "psnr_test", "eval_views",  "eval_step",
                                       "device_peak", "host_peak"};
    const cln_report_rows *r = &s->data.rows;
    const json_t *result = json_object_get(s->data.run, "result"), *mean = NULL;
    const cln_report_eval *eval = choose_eval(s);
    const char *network = NULL;
    const double tests = cln_json_number(json_object_get(s->dataset, "splits"), "test");

    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++)
        put(s, ends[i], cln_json_number(result, ends[i]));
    if (!json_is_object(result)) {
        /* of one that was killed or went back, what its checkpoint is of: later rows are lost */
        const bool kept = s->model < INT64_MAX;
        const double until = kept ? (double)s->model : INFINITY;

        put(s, "step", kept ? until : last_of(s, until, r->step, r->step));
        put(s, "seconds", last_of(s, until, r->seconds, r->seconds));
        put(s, "leaves", last_of(s, until, r->leaves, r->leaves));
        put(s, "psnr_train", last_of(s, until, r->psnr_train, r->psnr_train));
        put(s, "psnr_test", last_of(s, until, r->psnr_test, r->psnr_test));
        put(s, "eval_views",
            s->readable && isfinite(tests) ? fmin(s->config.eval_images, tests) : NAN);
        put(s, "eval_step", last_of(s, until, r->step, r->psnr_test));
    }
    put(s, "test_views", tests);
    if (!json_is_number(json_object_get(s->figures, "psnr_test")))
        put(s, "eval_views", NAN);
    if (!eval)
        return;
    mean = json_object_get(eval->document, "mean");
    network = cln_json_text(json_object_get(eval->document, "lpips"), "network");
    put(s, "psnr_test", eval->psnr);
    put(s, "ssim", eval->ssim);
    put(s, strcmp(network, "alex") == 0 ? "lpips_alex" : "lpips_vgg",
        cln_json_number(mean, "lpips"));
    put(s, "psnr_fitted", cln_json_number(mean, "psnr_fitted"));
    put(s, "psnr_exposed", cln_json_number(mean, "psnr_exposed"));
    put(s, "seconds_a_view", cln_json_number(mean, "seconds"));
    put(s, "eval_views", eval->images);
    put(s, "eval_step", eval->step);
}

static cln_status find_facts(side *s)
{
    const json_t *run = s->data.run, *device = json_object_get(run, "device");
    const json_t *splits = json_object_get(s->dataset, "splits");
    const char *path = cln_json_text(s->dataset, "path"), *driver = cln_json_text(device, "driver");
    const char *commit = cln_json_text(run, "commit");

    s->facts = json_pack(
        "{s:s, s:o, s:o, s:s, s:i, s:s, s:o, s:s}", "preset", cln_json_text(run, "preset"),
        "version",
        json_sprintf("%s%s%s", cln_json_text(run, "version"), *commit ? " of commit " : "", commit),
        "device",
        json_sprintf("%s%s%s", cln_json_text(device, "name"), *driver ? ", driver " : "", driver),
        "tune", cln_json_text(run, "tune"), "processes",
        s->data.ranks.ranks > 1 ? (int)s->data.ranks.ranks : 1, "scene",
        *path ? path : cln_json_text(s->dataset, "folder"), "views",
        json_sprintf("%d train, %d val, %d test",
                     (int)json_integer_value(json_object_get(splits, "train")),
                     (int)json_integer_value(json_object_get(splits, "val")),
                     (int)json_integer_value(json_object_get(splits, "test"))),
        "digest", cln_json_text(s->dataset, "digest"));
    return s->facts ? CLN_OK : cln_fail(CLN_MEMORY, "%s: cannot describe the run as JSON", s->run);
}

/* The step of the model that the run has: of its newest checkpoint, if one looks whole of that. */
static int64_t find_model(const char *run)
{
    int64_t step = cln_checkpoint_newest_whole(run);

    step = step < 0 ? cln_checkpoint_newest(run) : step;
    return step < 0 || cln_run_is_held(run) ? INT64_MAX : step;
}

static cln_status read_side(const char *run, side *s)
{
    cln_status st = CLN_OK;
    json_t *document = NULL, *dataset = NULL;
    const char *slash = NULL;

    s->run = run;
    s->figures = json_object();
    st = cln_reader_run(run, &document); /* the report's reader takes anything */
    if (st != CLN_OK)
        cln_note("setting runs side by side; `cl-nascent info SCENE` describes a scene, alone");
    CLN_TRY(st);
    CLN_TRY(cln_path_absolute(&s->path, run));
    slash = strrchr(s->path, '/');
    s->name = slash && slash[1] && cln_utf8_valid(slash) ? slash + 1 : run; /* for JSON */
    s->model = find_model(run);
    CLN_TRY(cln_report_data_read(run, s->model, &s->data));
    s->dataset = dataset = json_object_get(s->data.run, "dataset");
    if (!json_object_get(dataset, "downscale_least")) /* an older run: one for all */
        json_object_set(dataset, "downscale_least", json_object_get(dataset, "downscale"));
    s->readable =
        cln_config_from_json(json_object_get(s->data.run, "config"), &s->config) == CLN_OK;
    cln_clear_error();
    cln_report_idle(&s->data, s->idle);
    CLN_TRY(find_facts(s));
    find_figures(s);
done:
    json_decref(document);
    return st;
}

/* ---- what differs ---- */

static void add_note(json_t *notes, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void add_note(json_t *notes, const char *format, ...)
{
    char text[1024];
    va_list args;

    va_start(args, format);
    cln_format_list(text, sizeof text, format, args);
    va_end(args);
    json_array_append_new(notes, json_string(text));
}

typedef enum { SAME, UNTOLD, DIFFERENT } likeness; /* the worse the later */

/* Of a member of the runs' scenes. UNTOLD: not all have it, and those that do have the same. */
static likeness compare_scenes(int count, const side *sides, const char *key)
{
    const json_t *first = NULL;
    likeness found = SAME;

    for (int i = 0; i < count; i++) {
        const json_t *value = json_object_get(sides[i].dataset, key);

        if (!value)
            found = UNTOLD;
        else if (first && !json_equal(first, value))
            return DIFFERENT;
        else
            first = value;
    }
    return found;
}

/* What a setting of the scene came to; the setting itself where the run does not tell. */
static void find_outcome(const side *s, const char *option, const char *setting,
                         char out[VALUE_BYTES])
{
    static const char *const pairs[][2] = {{"space", "space"},
                                           {"downscale", "downscale"},
                                           {"background", "background"},
                                           {"format", "dialect"}};
    const json_t *value = NULL;

    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++)
        if (strcmp(option, pairs[i][0]) == 0)
            value = json_object_get(s->dataset, pairs[i][1]);
    if (strcmp(option, "masks") == 0 && s->config.masks == CLN_MASKS_AUTO)
        value = json_object_get(json_object_get(s->dataset, "masks"), "as");
    if (strcmp(option, "downscale") == 0 && json_is_integer(value)) {
        char span[CLN_SPAN_BYTES];

        cln_format_span((int)json_integer_value(json_object_get(s->dataset, "downscale_least")),
                        (int)json_integer_value(value), span);
        cln_format(out, VALUE_BYTES, "%s", span);
    } else if (json_is_integer(value))
        cln_format(out, VALUE_BYTES, "%d", (int)json_integer_value(value));
    else if (json_array_size(value) == 3)
        cln_format(out, VALUE_BYTES, "%.3g,%.3g,%.3g", json_number_value(json_array_get(value, 0)),
                   json_number_value(json_array_get(value, 1)),
                   json_number_value(json_array_get(value, 2)));
    else
        cln_format(out, VALUE_BYTES, "%s",
                   json_is_string(value) ? json_string_value(value) : setting);
}

static void add_settings(int count, const side *sides, json_t *settings)
{
    for (int r = 0; r < cln_config_row_count; r++) {
        const cln_config_row *row = &cln_config_rows[r];
        char first[VALUE_BYTES] = "", outcome[VALUE_BYTES], text[CLN_TEXT_BYTES];
        json_t *values = json_array();
        bool any = false, differ = false, used = false;

        for (int i = 0; i < count; i++) {
            if (!sides[i].readable) {
                json_array_append_new(values, json_null());
                continue;
            }
            cln_config_text(&sides[i].config, row, text);
            find_outcome(&sides[i], row->option, text, outcome);
            differ |= any && strcmp(first, outcome) != 0;
            used |= !sides[i].idle[r];
            cln_format(first, sizeof first, "%s", outcome);
            any = true;
            json_array_append_new(values, sides[i].idle[r] ? json_null()
                                          : strcmp(outcome, text) == 0
                                              ? json_string(text)
                                              : json_sprintf("%s (%s)", outcome, text));
        }
        if (differ && used)
            json_object_set(settings, row->option, values);
        json_decref(values);
    }
}

/* Adds a row for each of the facts that the runs do not have in common. */
static void add_facts(int count, const side *sides, json_t *facts)
{
    const char *key = NULL;
    json_t *first = NULL;

    json_object_foreach(sides[0].facts, key, first)
    {
        json_t *values = json_array();
        bool differ = false;

        for (int i = 0; i < count; i++) {
            json_t *value = json_object_get(sides[i].facts, key);

            differ |= !json_equal(value, first);
            json_array_append(values, value);
        }
        if (differ)
            json_object_set(facts, key, values);
        json_decref(values);
    }
    if (compare_scenes(count, sides, "digest") == SAME) /* the same one, elsewhere */
        json_object_del(facts, "scene");
}

/* ---- which one is better ---- */

typedef enum comparable { NONE, OF_TESTS, ALL } comparable;

/* How a run reads its masks; "" if it has none. */
static const char *masks_of(const side *s)
{
    const char *as = json_string_value(json_object_get(json_object_get(s->dataset, "masks"), "as"));

    if (as && s->readable && s->config.masks == CLN_MASKS_INVERTED)
        return "inverted";
    if (as && s->readable && s->config.masks == CLN_MASKS_IGNORE_WHITE)
        return "ignore-white";
    return as ? as : "";
}

/* Which figures of quality compare; a note says why not all do. */
static comparable check_comparable(int count, const side *sides, json_t *notes)
{
    static const struct {
        const char *keys[2], *differ, *untold;
    } reasons[] = {
        {{"digest"},
         "Scenes or their test photos differ (scene, views, digest)",
         "Not every run tells which scene it is of (digest)"},
        {{"downscale", "downscale_least"},
         "Photos differ in size (downscale)",
         "Not every run tells the size of its photos (downscale)"},
        {{"background"},
         "Backgrounds differ, also behind test photos with alpha",
         "Not every run tells its background, which is also behind test photos with alpha"},
    };
    const bool only_tests = compare_scenes(count, sides, "digest") != SAME &&
                            compare_scenes(count, sides, "test_digest") == SAME;
    bool alpha = false;

    for (int i = 0; i < count; i++)
        alpha |= json_is_true(json_object_get(sides[i].dataset, "alpha"));
    for (size_t r = only_tests; r < 2 + (size_t)alpha; r++) {
        likeness found = SAME;

        for (int k = 0; k < 2 && reasons[r].keys[k]; k++) {
            const likeness one = compare_scenes(count, sides, reasons[r].keys[k]);

            found = one > found ? one : found;
        }

        if (found != SAME) {
            add_note(notes, "%s, so figures of quality do not compare",
                     found == UNTOLD ? reasons[r].untold : reasons[r].differ);
            return NONE;
        }
    }
    for (int i = 1; i < count; i++)
        if (strcmp(masks_of(&sides[i]), masks_of(&sides[0])) != 0) {
            add_note(notes, "Masks are read in different ways (masks), by which other test pixels "
                            "count, so figures of quality do not compare");
            return NONE;
        }
    if (only_tests)
        add_note(notes, "Test photos are the same and compare; training photos differ");
    return only_tests ? OF_TESTS : ALL;
}

/* The places of the greatest numbers, to so many decimals; none if all are equal, or one alone. */
static json_t *best_of(const json_t *values, int decimals)
{
    const double unit = pow(10, decimals);
    double most = -INFINITY, least = INFINITY;
    json_t *best = json_array();

    for (size_t i = 0; i < json_array_size(values); i++) {
        const json_t *value = json_array_get(values, i);

        if (json_is_number(value)) {
            most = fmax(most, round(unit * json_number_value(value)));
            least = fmin(least, round(unit * json_number_value(value)));
        }
    }
    for (size_t i = 0; i < json_array_size(values) && most > least; i++) {
        const json_t *value = json_array_get(values, i);

        if (json_is_number(value) && round(unit * json_number_value(value)) == most)
            json_array_append_new(best, json_integer((json_int_t)i));
    }
    return best;
}

/* Adds the rows that any run has a number for, and the best of those of quality. Returns whether
 * figures of test views are of the same ones. */
static bool add_results(int count, const side *sides, comparable compare, json_t *document)
{
    json_t *results = json_object_get(document, "results"),
           *best = json_object_get(document, "best");
    const json_t *views = NULL;
    bool same_views = true, told = true;
    int tested = 0;

    for (int i = 0; i < count; i++) {
        const json_t *own = json_object_get(sides[i].figures, "eval_views");

        if (!json_is_number(json_object_get(sides[i].figures, "psnr_test")))
            continue;
        told &= json_is_number(own);
        same_views &= !views || json_equal(views, own);
        views = own;
        tested++;
    }
    same_views &= told || tested < 2;
    if (compare != NONE && !same_views)
        add_note(json_object_get(document, "notes"),
                 "Test figures %s over different numbers of views, so they do not compare; "
                 "`cl-nascent eval RUN` measures all views",
                 told ? "are" : "may be");
    for (int r = 0; r < ROWS; r++) {
        json_t *values = json_array();
        bool any = false;

        for (int i = 0; i < count; i++) {
            json_t *value = json_object_get(sides[i].figures, rows[r].key);

            any |= json_is_number(value);
            json_array_append_new(values, value ? json_incref(value) : json_null());
        }
        if (any)
            json_object_set(results, rows[r].key, values);
        if (any && rows[r].quality)
            json_object_set_new(best, rows[r].key,
                                (rows[r].test ? compare != NONE && same_views : compare == ALL)
                                    ? best_of(values, rows[r].quality)
                                    : json_array());
        json_decref(values);
    }
    return same_views;
}

/* Whether runs of one program on one scene and device differ by their seeds alone. */
static bool is_by_seed(int count, const json_t *document)
{
    const json_t *settings = json_object_get(document, "settings");
    const json_t *seeds = json_object_get(settings, "seed");
    const json_t *resumed = json_object_get(document, "resumed");

    if (!seeds || json_object_size(settings) > 1 ||
        json_object_size(json_object_get(document, "facts")) > 0)
        return false;
    for (size_t i = 0; i < (size_t)count; i++) {
        if (!json_is_string(json_array_get(seeds, i)) ||
            json_array_size(json_array_get(resumed, i)) > 0)
            return false;
        for (size_t k = 0; k < i; k++)
            if (json_equal(json_array_get(seeds, i), json_array_get(seeds, k)))
                return false;
    }
    return true;
}

/* Adds the mean and the standard deviation (of a sample) of figures of quality that every run
 * has. */
static void add_spread(int count, comparable compare, bool same_views, json_t *document)
{
    json_t *spread = json_object_get(document, "over_seeds");

    for (int r = 0; r < ROWS && is_by_seed(count, document); r++) {
        const json_t *values = json_object_get(json_object_get(document, "results"), rows[r].key);
        double mean = 0, squares = 0;
        int n = 0;

        if (!rows[r].quality || !(rows[r].test ? compare != NONE && same_views : compare == ALL))
            continue;
        for (int i = 0; i < count; i++) {
            const json_t *value = json_array_get(values, (size_t)i);

            n += json_is_number(value);
            mean += json_number_value(value) / count;
        }
        for (int i = 0; i < count; i++)
            squares += pow(json_number_value(json_array_get(values, (size_t)i)) - mean, 2);
        if (n == count)
            json_object_set_new(
                spread, rows[r].key,
                json_pack("{s:f, s:f}", "mean", mean, "deviation", sqrt(squares / (count - 1))));
    }
}

/* Adds the starts of a run that went on with other settings, and notes them: the settings above are
 * those of the last one. */
static void add_history(const side *s, json_t *histories, json_t *notes)
{
    const json_t *history = json_object_get(s->data.run, "history");
    json_t *changes = json_array();
    char text[CLN_HISTORY_BYTES];

    for (size_t i = 0; i < json_array_size(history); i++) {
        json_t *start = json_array_get(history, i);

        if (!cln_history_changed(start))
            continue;
        cln_history_text(start, text);
        add_note(notes, "%s: %s", s->name, text);
        json_array_append_new(changes,
                              json_pack("{s:O, s:O}", "step", json_object_get(start, "step"),
                                        "changed", json_object_get(start, "changed")));
    }
    json_array_append_new(histories, changes);
}

/* Notes what a reader should know of a run, by itself and beside an earlier one. */
static void note_run(const side *sides, int which, json_t *notes)
{
    const side *s = &sides[which];
    const char *state = cln_run_state(s->run, s->data.run);
    const double step = cln_json_number(s->figures, "step");
    const double measured = cln_json_number(s->figures, "eval_step");

    if (!s->readable)
        add_note(notes, "%s: its settings are another version's and cannot be read", s->name);
    if (!isfinite(step))
        add_note(notes, "%s: it has no results yet (%s)", s->name, state);
    else if (strcmp(state, "done") != 0)
        add_note(notes, "%s: %s at step %.0f", s->name, state, step);
    if (isfinite(s->data.gone))
        add_note(notes,
                 "%s: it ended at step %.0f, but the checkpoint of that is gone or cannot be read",
                 s->name, s->data.gone);
    if (json_object_get(s->data.run, "held_back"))
        add_note(notes,
                 "%s: memory held its tree back from step %.0f on: with more memory the same "
                 "settings give another model",
                 s->name, cln_json_number(json_object_get(s->data.run, "held_back"), "step"));
    if (measured < step)
        add_note(notes, "%s: test figures are of step %.0f; `cl-nascent eval` renews them", s->name,
                 measured);
    for (int k = 0; k < which; k++)
        if (strcmp(sides[k].path, s->path) == 0)
            add_note(notes, "%s and %s are the same run", sides[k].name, s->name);
}

static const char *model_of(const side *s)
{
    return cln_json_text(json_object_get(s->data.run, "result"), "model_digest");
}

/* Notes which runs ended with the same model: a sentence for all of them. */
static void note_equal(int count, const side *sides, json_t *notes)
{
    enum { NAMED = 12 };

    for (int i = 0; i < count; i++) {
        const char *model = model_of(&sides[i]);
        int first = 0, equal = 1, last = i;
        char names[900];
        size_t used = (size_t)snprintf(names, sizeof names, "%s", sides[i].name);

        while (first < i && strcmp(model_of(&sides[first]), model) != 0)
            first++;
        for (int k = i + 1; k < count && *model && first == i; k++)
            last =
                strcmp(model_of(&sides[k]), model) == 0 && strcmp(sides[k].path, sides[i].path) != 0
                    ? k
                    : last;
        for (int k = i + 1; k <= last; k++) {
            if (strcmp(model_of(&sides[k]), model) != 0 ||
                strcmp(sides[k].path, sides[i].path) == 0)
                continue;
            if (equal++ < NAMED && used < sizeof names)
                used += (size_t)snprintf(names + used, sizeof names - used, "%s%s",
                                         k == last ? " and " : ", ", sides[k].name);
        }
        if (equal > NAMED && used < sizeof names)
            (void)snprintf(names + used, sizeof names - used, " and %d more", equal - NAMED);
        if (equal > 1)
            add_note(notes, "%s ended with the same model, to the bit", names);
    }
}

cln_status cln_side_by_side(int count, const char *const runs[], json_t **out)
{
    cln_status st = CLN_OK;
    side *sides = NULL;
    json_t *document =
        json_pack("{s:s, s:[], s:[], s:[], s:{}, s:[], s:{}, s:{}, s:{}, s:{}, s:b, s:[]}",
                  "schema", "cl-nascent.runs/1", "runs", "names", "readable", "settings", "resumed",
                  "facts", "results", "best", "over_seeds", "comparable", false, "notes");
    json_t *settings = json_object_get(document, "settings"), *presets = NULL;
    json_t *facts = json_object_get(document, "facts"), *notes = json_object_get(document, "notes");
    bool same_names = false, same_views = false;
    comparable compare = NONE;

    *out = NULL;
    if (!document)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot set it beside others as JSON", runs[0]));
    CLN_TRY(cln_alloc(&sides, (size_t)count, sizeof *sides, "runs side by side"));
    for (int i = 0; i < count; i++) {
        CLN_TRY(read_side(runs[i], &sides[i]));
        for (int k = 0; k < i; k++)
            same_names |= strcmp(sides[i].name, sides[k].name) == 0;
    }
    for (int i = 0; i < count; i++) {
        sides[i].name = same_names ? runs[i] : sides[i].name;
        json_array_append_new(json_object_get(document, "runs"), json_string(runs[i]));
        json_array_append_new(json_object_get(document, "names"), json_string(sides[i].name));
        json_array_append_new(json_object_get(document, "readable"),
                              json_boolean(sides[i].readable));
    }
    add_facts(count, sides, facts);
    presets = json_object_get(facts, "preset");
    if (presets) { /* it is an option */
        json_object_set(settings, "preset", presets);
        json_object_del(facts, "preset");
    }
    add_settings(count, sides, settings);
    compare = check_comparable(count, sides, notes);
    json_object_set_new(document, "comparable", json_boolean(compare != NONE));
    if (json_object_get(facts, "device"))
        add_note(notes, "Devices or drivers differ, so times do not compare");
    same_views = add_results(count, sides, compare, document);
    for (int i = 0; i < count; i++) {
        note_run(sides, i, notes);
        add_history(&sides[i], json_object_get(document, "resumed"), notes);
    }
    add_spread(count, compare, same_views, document);
    note_equal(count, sides, notes);
    *out = json_incref(document);
done:
    for (int i = 0; i < count && sides; i++) {
        cln_report_data_free(&sides[i].data);
        json_decref(sides[i].facts);
        json_decref(sides[i].figures);
        free(sides[i].path);
    }
    free(sides);
    json_decref(document);
    return st;
}
