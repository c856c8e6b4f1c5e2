/* Reads a run folder for the report. See report_data.h. A report ends hours of work, so only lack
 * of memory stops it: a damaged file is left out, with a warning. */
#include "report/report_data.h"

#include <dirent.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/json.h"
#include "io/names.h"
#include "io/run_folder.h"

static const size_t metrics_max_bytes = (size_t)1 << 30;

cln_status cln_report_file(const json_t *image, char **file)
{
    const char *given = cln_json_text(image, "file");

    if (given[0] && !strchr(given, '/'))
        return cln_strdup(file, given);
    return cln_view_file_name(cln_json_text(image, "name"), file);
}

/* Warns of a file that cannot be used, and clears its error. */
static void skip_file(cln_status before)
{
    cln_warn("report: left out %s", cln_error_text());
    if (before == CLN_OK)
        cln_clear_error();
}

/* ---- metrics.jsonl ---- */

static int count_lines(const char *text)
{
    int lines = 0;

    for (; *text; lines++) {
        text += strcspn(text, "\n");
        text += *text == '\n';
    }
    return lines;
}

static void add_stages(cln_report_rows *rows, const json_t *stages)
{
    const char *name = NULL;
    json_t *value = NULL;

    json_object_foreach((json_t *)stages, name, value)
    {
        int i = 0;

        if (!json_is_number(value))
            continue;
        while (i < rows->stage_count && strncmp(rows->stages[i].name, name, 47) != 0)
            i++;
        if (i == CLN_REPORT_STAGES)
            continue;
        if (i == rows->stage_count) {
            strncpy(rows->stages[i].name, name, 47);
            rows->stage_count++;
        }
        rows->stages[i].seconds += json_number_value(value);
    }
}

static void add_row(cln_report_rows *rows, const json_t *row)
{
    int i = rows->count++;

    rows->step[i] = cln_json_number(row, "step");
    rows->seconds[i] = cln_json_number(row, "seconds");
    rows->psnr_train[i] = cln_json_number(row, "psnr_train");
    rows->psnr_test[i] = cln_json_number(row, "psnr_test");
    rows->rays_per_s[i] = cln_json_number(row, "rays_per_s");
    rows->samples_per_ray[i] = cln_json_number(row, "samples_per_ray");
    rows->leaves[i] = cln_json_number(row, "leaves");
    rows->params[i] = cln_json_number(row, "params");
    add_stages(rows, json_object_get(row, "stages"));
}

static cln_report_decision decision_of(const json_t *row)
{
    return (cln_report_decision){.step = cln_json_number(row, "step"),
                                 .seconds = cln_json_number(row, "seconds"),
                                 .leaves_before = cln_json_number(row, "leaves_before"),
                                 .leaves = cln_json_number(row, "leaves"),
                                 .split = cln_json_number(row, "split"),
                                 .merged = cln_json_number(row, "merged"),
                                 .budget = cln_json_number(row, "budget"),
                                 .psnr_before = cln_json_number(row, "psnr_before"),
                                 .psnr_after = cln_json_number(row, "psnr_after"),
                                 .psnr_pretrained = cln_json_number(row, "psnr_pretrained"),
                                 .work_seconds = cln_json_number(row, "work_seconds"),
                                 .over_budget = json_is_true(json_object_get(row, "infeasible"))};
}

static void add_ranks_stages(cln_report_ranks_sum *sum, const json_t *stages)
{
    const char *name = NULL;
    json_t *ends = NULL;

    json_object_foreach((json_t *)stages, name, ends)
    {
        int i = 0;

        while (i < sum->stage_count && strncmp(sum->stages[i].name, name, 47) != 0)
            i++;
        if (i == CLN_REPORT_STAGES)
            continue;
        if (i == sum->stage_count) {
            strncpy(sum->stages[i].name, name, 47);
            sum->stage_count++;
        }
        sum->stages[i].least += json_number_value(json_array_get(ends, 0));
        sum->stages[i].most += json_number_value(json_array_get(ends, 1));
    }
}

/* Takes over a row's time. Returns whether another process wrote it than the row before: it began
 * after another step or, as far as older runs tell, its clock is behind. */
static bool add_clock(cln_report_clock *clock, const json_t *row)
{
    const double from = cln_json_number(row, "from_step");
    const double wall = cln_json_number(row, "wall_seconds");
    const bool same = from == clock->from_step || (isnan(from) && isnan(clock->from_step));
    const bool other = !same || wall < clock->wall;

    if (other)
        clock->earlier += clock->wall;
    clock->from_step = from;
    clock->wall = isfinite(wall) ? wall : other ? 0 : clock->wall;
    return other;
}

/* Adds the bytes that ranks had sent by this row; call it after add_row of the row. resumed: it is
 * the first row of its process. */
static void add_ranks(cln_report_ranks_sum *sum, const json_t *row, bool resumed)
{
    const double step = cln_json_number(row, "step"), seconds = cln_json_number(row, "seconds");
    const double bytes = cln_json_number(row, "sent_bytes");
    const double waited = cln_json_number(row, "message_seconds");
    const double vertices = cln_json_number(row, "vertex_bytes");
    const double balance = cln_json_number(row, "balance");
    const double rays = cln_json_number(row, "rays_per_s") * (seconds - sum->last_seconds);
    const double steps = step - sum->last_step;

    if (resumed || bytes < sum->last_bytes) /* counts begin anew */
        sum->last_bytes = sum->last_message_seconds = sum->last_vertex_bytes = 0;
    if (isfinite(bytes) && isfinite(waited) && steps > 0) {
        sum->ranks = cln_json_number(row, "ranks");
        sum->steps += steps;
        sum->seconds += seconds - sum->last_seconds;
        sum->rays += isfinite(rays) ? rays : 0;
        sum->bytes += bytes - sum->last_bytes;
        sum->message_seconds += waited - sum->last_message_seconds;
        if (isfinite(balance)) {
            sum->balanced += balance * steps;
            sum->balance_weight += steps;
        }
        if (isfinite(vertices)) {
            sum->vertex_bytes += vertices - sum->last_vertex_bytes;
            sum->last_vertex_bytes = vertices;
        }
        sum->last_bytes = bytes;
        sum->last_message_seconds = waited;
        add_ranks_stages(sum, json_object_get(row, "ranks_stages"));
        for (size_t i = 0; i < 2; i++)
            sum->photos[i] =
                json_number_value(json_array_get(json_object_get(row, "photo_bytes"), i));
    }
    sum->last_step = step;
    sum->last_seconds = seconds;
}

/* A row of training, a decision on the structure, or a move; other events are not shown. */
static void add_line(cln_report_data *data, const json_t *row)
{
    if (!json_object_get(row, "event")) {
        const bool resumed = add_clock(&data->clock, row);

        add_row(&data->rows, row);
        add_ranks(&data->ranks, row, resumed);
    } else if (strcmp(cln_json_text(row, "event"), "balance") == 0) {
        data->moves[data->move_count++] =
            (cln_report_move){cln_json_number(row, "step"), cln_json_number(row, "moved"),
                              cln_json_number(row, "before"), cln_json_number(row, "after")};
    } else if (strcmp(cln_json_text(row, "event"), "structure") == 0) {
        data->decisions[data->decision_count++] = decision_of(row);
    }
}

/* Exponential mean, forwards then backwards (so without delay), over about 2 % of the rows. */
static void smooth(int count, const double *from, double *to)
{
    double keep = 1 - 1 / (1 + 0.01 * count);
    double mean = NAN;

    for (int i = 0; i < count; i++) {
        if (isfinite(from[i]))
            mean = isfinite(mean) ? keep * mean + (1 - keep) * from[i] : from[i];
        to[i] = isfinite(from[i]) ? mean : NAN;
    }
    mean = NAN;
    for (int i = count - 1; i >= 0; i--) {
        if (!isfinite(to[i]))
            continue;
        mean = isfinite(mean) ? keep * mean + (1 - keep) * to[i] : to[i];
        to[i] = mean;
    }
}

static cln_status read_metrics(const char *run, cln_report_data *data)
{
    cln_status st = CLN_OK;
    cln_report_rows *rows = &data->rows;
    cln_status before = cln_error_status();
    double **const columns[] = {&rows->step,      &rows->seconds,    &rows->psnr_train,
                                &rows->psnr_test, &rows->rays_per_s, &rows->samples_per_ray,
                                &rows->leaves,    &rows->params,     &rows->smooth};
    char *path = NULL, *text = NULL, *line = NULL;
    size_t bytes = 0;
    int lines = 0;

    CLN_TRY(cln_path_join(&path, run, "metrics.jsonl"));
    if (!cln_is_file(path))
        goto done;
    if (cln_read_file(path, metrics_max_bytes, &text, &bytes) != CLN_OK) {
        skip_file(before);
        goto done;
    }
    lines = count_lines(text);
    for (size_t c = 0; c < sizeof columns / sizeof columns[0]; c++)
        CLN_TRY(cln_alloc(columns[c], (size_t)lines, sizeof(double), "report: metrics"));
    CLN_TRY(cln_alloc(&data->decisions, (size_t)lines, sizeof *data->decisions, "report: metrics"));
    CLN_TRY(cln_alloc(&data->moves, (size_t)lines, sizeof *data->moves, "report: metrics"));
    line = text;
    while (*line) {
        size_t length = strcspn(line, "\n");
        json_t *row = json_loadb(line, length, 0, NULL);

        if (json_is_object(row) && !(cln_json_number(row, "step") > (double)data->until))
            add_line(data, row); /* no row: a last line that was cut off */
        json_decref(row);
        line += length + (line[length] == '\n');
    }
    smooth(rows->count, rows->psnr_train, rows->smooth);
done:
    free(path);
    free(text);
    return st;
}

int cln_report_decimate(int count, const double *from_x, const double *from_y, double *x, double *y)
{
    int finite = 0, kept = 0, seen = 0;
    int buckets = CLN_REPORT_POINTS / 2;

    for (int i = 0; i < count; i++)
        finite += isfinite(from_x[i]) && isfinite(from_y[i]);
    for (int i = 0; i < count;) {
        int low = -1, high = -1;
        int end = 0;

        /* the next bucket; if there are few points, a bucket is one point */
        if (finite <= CLN_REPORT_POINTS)
            end = seen + 1;
        else
            end = (int)((int64_t)(kept / 2 + 1) * finite / buckets);
        for (; i < count && seen < end; i++) {
            if (!isfinite(from_x[i]) || !isfinite(from_y[i]))
                continue;
            seen++;
            low = low < 0 || from_y[i] < from_y[low] ? i : low;
            high = high < 0 || from_y[i] >= from_y[high] ? i : high;
        }
        if (low < 0)
            break;
        for (int pass = 0; pass < 2; pass++) {
            int at = (pass == 0) == (low < high) ? low : high;
            if (pass == 1 && finite <= CLN_REPORT_POINTS)
                break;
            x[kept] = from_x[at];
            y[kept++] = from_y[at];
        }
    }
    return kept;
}

/* ---- eval/ ---- */

/* Of one step and split, figures of pictures as they are come last: the last is shown. */
static int by_step(const void *a, const void *b)
{
    const cln_report_eval *x = a, *y = b;

    if (x->step != y->step)
        return x->step < y->step ? -1 : 1;
    if (strcmp(x->split, y->split) != 0)
        return strcmp(x->split, y->split);
    if (!x->how[0] != !y->how[0])
        return y->how[0] ? 1 : -1;
    return x->images != y->images ? x->images - y->images : strcmp(x->stem, y->stem);
}

/* Whether the files are of views chosen by name: NNNNNNNN-SPLIT-COUNT-DIGEST..., the digest of
 * eight digits. */
static bool is_chosen(const char *stem)
{
    int at = -1, end = -1;

    sscanf(stem, "%*d-%*[a-z]-%*d-%n%*8[0-9a-f]%n", &at, &end);
    return end - at == 8 && (!stem[end] || stem[end] == '-');
}

/* Writes " of chosen views with --antialias 2 --fast", by the name of its files; nothing for
 * pictures as they are. */
static void say_how(const char *stem, char *out, size_t bytes)
{
    const char *finer = strstr(stem, "-antialias"), *fast = strstr(stem, "-fast");
    const char *over = strstr(stem, "-over");

    if (finer)
        finer += strlen("-antialias");
    snprintf(out, bytes, "%s%s%s%.1s%s%s", is_chosen(stem) ? " of chosen views" : "",
             finer || fast ? " with" : "", finer ? " --antialias " : "", finer ? finer : "",
             fast ? " --fast" : "", over ? " over another background" : "");
}

static int split_rank(const char *split)
{
    return strcmp(split, "test") == 0 ? 2 : strcmp(split, "val") == 0 ? 1 : 0;
}

/* Is it an evaluation of a model that the run no longer has? digest: of the one it has, or "". */
static bool is_of_another(const json_t *document, int64_t until, const char *digest)
{
    const double step = cln_json_number(document, "step");
    const char *own = cln_json_text(document, "model_digest");

    return step > (double)until ||
           (step == (double)until && *own && *digest && strcmp(own, digest) != 0);
}

static cln_status add_eval(const char *folder, const char *name, const char *digest,
                           cln_report_data *data)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    cln_report_eval *e = &data->evals[data->eval_count];
    char *path = NULL;
    const json_t *mean = NULL;

    CLN_TRY(cln_path_join(&path, folder, name));
    if (cln_json_read(path, false, &e->document) != CLN_OK || !json_is_object(e->document)) {
        skip_file(before);
        json_decref(e->document);
        e->document = NULL;
        goto done;
    }
    if (is_of_another(e->document, data->until, digest)) {
        json_decref(e->document);
        e->document = NULL;
        goto done;
    }
    CLN_TRY(cln_asprintf(&e->stem, "%.*s", (int)(strlen(name) - strlen(".json")), name));
    mean = json_object_get(e->document, "mean");
    e->split = cln_json_text(e->document, "split");
    e->step = cln_json_number(e->document, "step");
    e->seconds = cln_json_number(e->document, "train_seconds");
    e->psnr = cln_json_number(mean, "psnr");
    e->ssim = cln_json_number(mean, "ssim");
    say_how(e->stem, e->how, sizeof e->how);
    e->chosen = is_chosen(e->stem);
    e->images = (int)json_array_size(json_object_get(e->document, "images"));
    data->eval_count++;
done:
    if (st != CLN_OK) {
        json_decref(e->document);
        e->document = NULL;
    }
    free(path);
    return st;
}

static cln_status read_evals(const char *run, cln_report_data *data)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    char *folder = NULL, *path = NULL;
    DIR *dir = NULL;
    struct dirent *entry = NULL;
    json_t *checkpoint = NULL;
    int files = 0;

    data->shown = -1;
    CLN_TRY(cln_asprintf(&path, "%s/checkpoint/%08" PRId64 ".json", run, data->until));
    if (cln_is_file(path) && cln_json_read(path, false, &checkpoint) != CLN_OK && before == CLN_OK)
        cln_clear_error();
    CLN_TRY(cln_path_join(&folder, run, "eval"));
    dir = opendir(folder);
    if (!dir)
        goto done;
    while ((entry = readdir(dir)))
        files++;
    rewinddir(dir);
    CLN_TRY(cln_alloc(&data->evals, (size_t)files, sizeof *data->evals, "report: evaluations"));
    while ((entry = readdir(dir)) && data->eval_count < files) {
        size_t length = strlen(entry->d_name);
        if (length > 5 && strcmp(entry->d_name + length - 5, ".json") == 0)
            CLN_TRY(
                add_eval(folder, entry->d_name, cln_json_text(checkpoint, "model_digest"), data));
    }
    qsort(data->evals, (size_t)data->eval_count, sizeof *data->evals, by_step);
    for (int i = 0; i < data->eval_count; i++) {
        if (data->shown < 0 ||
            split_rank(data->evals[i].split) >= split_rank(data->evals[data->shown].split))
            data->shown = i;
    }
done:
    if (dir)
        closedir(dir);
    json_decref(checkpoint);
    free(path);
    free(folder);
    return st;
}

/* tree.json of the shown evaluation. */
static cln_status read_tree(const char *run, cln_report_data *data)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    char *path = NULL;

    if (data->shown < 0)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&path, "%s/eval/%s/tree.json", run, data->evals[data->shown].stem));
    if (cln_is_file(path) && cln_json_read(path, false, &data->tree) != CLN_OK)
        skip_file(before);
    if (!json_is_object(data->tree)) {
        json_decref(data->tree);
        data->tree = NULL;
    }
done:
    free(path);
    return st;
}

cln_status cln_report_data_read(const char *run, int64_t until, cln_report_data *out)
{
    cln_status st = CLN_OK;
    cln_status before = cln_error_status();
    char *path = NULL;

    *out = (cln_report_data){.folder = run, .shown = -1, .until = until, .gone = NAN};
    if (until < INT64_MAX && cln_run_is_held(run))
        out->until = INT64_MAX; /* its checkpoint is behind it */
    CLN_TRY(cln_path_join(&path, run, "run.json"));
    if (cln_is_file(path) && cln_json_read(path, false, &out->run) != CLN_OK)
        skip_file(before);
    if (!json_is_object(out->run)) {
        json_decref(out->run);
        out->run = json_object();
    }
    out->gone = cln_run_drop_result(out->run, out->until);
    CLN_TRY(read_metrics(run, out));
    CLN_TRY(read_evals(run, out));
    CLN_TRY(read_tree(run, out));
done:
    free(path);
    if (st != CLN_OK)
        cln_report_data_free(out);
    return st;
}

void cln_report_data_free(cln_report_data *data)
{
    cln_report_rows *r = &data->rows;
    double *const columns[] = {r->step,      r->seconds,    r->psnr_train,
                               r->psnr_test, r->rays_per_s, r->samples_per_ray,
                               r->leaves,    r->params,     r->smooth};

    for (size_t c = 0; c < sizeof columns / sizeof columns[0]; c++)
        free(columns[c]);
    for (int i = 0; i < data->eval_count; i++) {
        free(data->evals[i].stem);
        json_decref(data->evals[i].document);
    }
    free(data->evals);
    free(data->decisions);
    free(data->moves);
    json_decref(data->tree);
    json_decref(data->run);
    *data = (cln_report_data){.shown = -1};
}
