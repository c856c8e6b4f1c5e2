/* The report's page: reads the run folder (report_data.c), writes the head, the headline figures,
 * the table of contents and each section (report_sections.h). Texts from files go through
 * cln_html_text; the page refers to nothing outside itself. */
#include "report/report.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/number.h"
#include "base/text.h"
#include "io/json.h"
#include "report/html.h"
#include "io/progress.h"
#include "io/run_folder.h"
#include "model/model.h"
#include "report/report_sections.h"
#include "report/report_style.h"

static double last_finite(int count, const double *values)
{
    for (int i = count - 1; i >= 0; i--) {
        if (isfinite(values[i]))
            return values[i];
    }
    return NAN;
}

/* The last part of a path, trailing slashes aside. */
static const char *base_name(const char *path, int *length)
{
    const char *end = path + strlen(path);
    const char *start = NULL;

    while (end > path + 1 && end[-1] == '/')
        end--;
    start = end;
    while (start > path && start[-1] != '/')
        start--;
    *length = (int)(end - start);
    return start;
}

static void put_title(FILE *to, const char *run)
{
    char name[256];
    int length = 0;
    const char *start = base_name(run, &length);

    snprintf(name, sizeof name, "%.*s", length, start);
    cln_html_text(to, strcmp(name, ".") == 0 ? "run" : name);
}

/* Chosen on 148 finished runs of real and generated sets: with good poses a gap like this went with
 * more than 20 dB, but for sets of a dozen photos all around; with wrong ones, 13 to 17 dB were
 * reached. A training of few steps has no gap: its training PSNR is a mean over steps that knew
 * less. */
static const double FEW_DB = 20, GAP_DB = 1.5;

const double cln_overfit_db = 8;

/* So few photos are the likeliest cause. */
enum { FEW_PHOTOS = 8 };

bool cln_report_doubt(const cln_doubt *of, char out[CLN_DOUBT_BYTES])
{
    const double psnr_train = of->psnr_train, psnr_test = of->psnr_test;
    const double gap = psnr_train - psnr_test;
    /* blurred renders gain a decibel */
    const double gain = isfinite(of->fitted_gain) ? of->fitted_gain : of->psnr_fitted - psnr_test;
    const bool light = gain > 2 && gain > gap / 2;
    const bool doubtful = (psnr_test < FEW_DB && gap > GAP_DB) || (light && gap > cln_overfit_db);

    char few[64] = "";

    out[0] = 0;
    if (of->training_photos > 0 && of->training_photos <= FEW_PHOTOS)
        snprintf(few, sizeof few, "%d training photo%s few, or ", of->training_photos,
                 cln_plural(of->training_photos, " is", "s are"));
    if (doubtful && light)
        cln_format(
            out, CLN_DOUBT_BYTES,
            "test views are %.1f dB below training views, at %.1f dB, but at %.1f dB after a "
            "fit of colours: exposure or white balance differs between photos%s",
            gap, psnr_test, of->psnr_fitted, of->exposed ? "" : " (--exposure fits gains to them)");
    else if (doubtful)
        cln_format(out, CLN_DOUBT_BYTES,
                   "test views are %.1f dB below training views, at %.1f dB: %s%s%sposes or lenses "
                   "are wrong, or the photos %slook elsewhere, or things moved or the light "
                   "changed between them%s",
                   gap, psnr_test,
                   of->cube_guessed ? "the cube, which is a guess, may be far too large or small "
                                      "(--bbox), or "
                                    : "",
                   of->masks_doubtful ? "the masks may be of an object (--masks alpha), or " : "",
                   few, *few ? "" : "are few, or ",
                   of->alpha ? ""
                             : ", or something stands in every photo (a logo, bars, a "
                               "bonnet): mask it (check --write-mask)");
    return doubtful;
}

/* The line that proposes a check of the scene. */
static void put_doubt(FILE *to, const json_t *document)
{
    const json_t *result = json_object_get(document, "result");
    const json_t *dataset = json_object_get(document, "dataset");
    const char *path = cln_json_text(dataset, "path");
    const bool alpha = json_is_true(json_object_get(dataset, "alpha"));
    const cln_doubt of = {.psnr_train = cln_json_number(result, "psnr_train"),
                          .psnr_test = cln_json_number(result, "psnr_test"),
                          .psnr_fitted = cln_json_number(result, "psnr_fitted"),
                          .fitted_gain = cln_json_number(result, "fitted_gain"),
                          .exposed = alpha || json_is_true(json_object_get(result, "exposed")),
                          .alpha = alpha,
                          .cube_guessed = json_is_true(json_object_get(dataset, "cube_guessed")),
                          .masks_doubtful = json_is_true(
                              json_object_get(json_object_get(dataset, "masks"), "doubtful")),
                          .training_photos = (int)json_integer_value(
                              json_object_get(json_object_get(dataset, "splits"), "train"))};
    char doubt[CLN_DOUBT_BYTES], quoted[CLN_QUOTED_BYTES];

    if (!cln_report_doubt(&of, doubt))
        return;
    fprintf(to, "<p>Doubtful: %s. <code>cl-nascent check ", doubt);
    cln_html_text(to, *path ? cln_shell_quote(path, quoted, sizeof quoted) : "SCENE");
    fputs("</code> looks for what is wrong.</p>\n", to);
}

/* The line that says what became of a run whose process is gone, and the way on. */
static void put_broken_off(FILE *to, const char *run)
{
    char quoted[CLN_QUOTED_BYTES];

    fputs("<p>Broken off: " CLN_RUN_BROKEN_OFF, to);
    if (cln_checkpoint_newest(run) >= 0) {
        fputs("; <code>cl-nascent train --resume ", to);
        cln_html_text(to, cln_shell_quote(run, quoted, sizeof quoted));
        fputs("</code> goes on from its last checkpoint.</p>\n", to);
    } else {
        fputs(CLN_RUN_NO_CHECKPOINT ".</p>\n", to);
    }
}

static void put_head(FILE *to, const char *run, const json_t *document)
{
    const char *state = cln_run_state(run, document);
    const char *started = cln_json_text(document, "started");
    const char *ended = cln_json_text(document, "ended");
    const char *command = cln_json_text(document, "command");
    const char *path = cln_json_text(json_object_get(document, "dataset"), "path");

    fputs("<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n"
          "<meta name=viewport content=\"width=device-width,initial-scale=1\">\n<title>",
          to);
    put_title(to, run);
    fprintf(to, " &ndash; cl-nascent</title>\n<style>%s</style>\n<main>\n<h1>", report_style);
    put_title(to, run);
    if (*state) {
        fprintf(to, " <span class='state%s'>", strcmp(state, "done") == 0 ? "" : " other");
        cln_html_text(to, state);
        fputs("</span>", to);
    }
    fputs("</h1>\n<p class=soft>", to);
    if (*path) {
        fputs("trained on ", to);
        cln_html_text(to, path);
    }
    if (*started) {
        fputs(*path ? " &middot; " : "", to);
        cln_html_text(to, started);
        fputs(*ended ? " to " : "", to);
        cln_html_text(to, ended);
    }
    fputs("</p>\n", to);
    if (*command) {
        fputs("<p><code>", to);
        cln_html_text(to, command);
        fputs("</code></p>\n", to);
    }
    if (strcmp(state, "broken off") == 0)
        put_broken_off(to, run);
    if (json_object_size(document) == 0)
        fputs("<p class=soft>There is no readable run.json in this folder.</p>\n", to);
}

static void open_card(FILE *to, bool main_one)
{
    fprintf(to, "<div class='card%s'><b>", main_one ? " main" : "");
}

static void close_card(FILE *to, const char *caption)
{
    fputs("</b><span>", to);
    cln_html_text(to, caption);
    fputs("</span></div>\n", to);
}

static void put_psnr_card(FILE *to, double psnr, const char *caption, bool main_one)
{
    open_card(to, main_one);
    cln_report_number(to, psnr, 2);
    fputs(" <small>dB</small>", to);
    close_card(to, caption);
}

/* Figures of the shown evaluation, else of the last test while training, else of training alone. */
static void put_headline(FILE *to, const cln_report_data *data)
{
    const cln_report_rows *r = &data->rows;
    const json_t *result = json_object_get(data->run, "result");
    const cln_report_eval *e = data->shown >= 0 ? &data->evals[data->shown] : NULL;
    double seconds = fmax(last_finite(r->count, r->seconds), cln_json_number(result, "seconds"));
    double step = fmax(last_finite(r->count, r->step), cln_json_number(result, "step"));
    double leaves = last_finite(r->count, r->leaves), params = last_finite(r->count, r->params);
    double test = last_finite(r->count, r->psnr_test);
    char caption[160], text[32];

    fputs("<div class=cards>\n", to);
    if (e) {
        cln_format_duration(e->seconds, text);
        snprintf(caption, sizeof caption, "%s PSNR after %s%s", e->split, text, e->how);
        put_psnr_card(to, e->psnr, caption, true);
        open_card(to, false);
        cln_report_number(to, e->ssim, 4);
        snprintf(caption, sizeof caption, "%s SSIM, %d view%s%s", e->split, e->images,
                 cln_plural(e->images, "", "s"), e->how);
        close_card(to, caption);
    } else if (isfinite(test)) {
        put_psnr_card(to, test, "test PSNR, some views, while training", true);
    }
    put_psnr_card(to, last_finite(r->count, r->psnr_train), "train PSNR, of rays", false);
    open_card(to, false);
    cln_format_duration(seconds, text);
    fputs(text, to);
    cln_format_short(last_finite(r->count, r->rays_per_s), text);
    snprintf(caption, sizeof caption, "training time%s%s%s", *text != '?' ? ", at the end " : "",
             *text != '?' ? text : "", *text != '?' ? " rays/s" : "");
    close_card(to, caption);
    open_card(to, false);
    cln_format_count(step, text);
    fputs(isfinite(step) ? text : "&ndash;", to);
    close_card(to, "steps");
    open_card(to, false);
    cln_format_count(leaves, text);
    fputs(isfinite(leaves) ? text : "&ndash;", to);
    cln_format_short(params, text);
    snprintf(caption, sizeof caption, "leaves%s%s%s", isfinite(params) ? ", " : "",
             isfinite(params) ? text : "", isfinite(params) ? " parameters" : "");
    close_card(to, caption);
    fputs("</div>\n", to);
}

static void put_foot(FILE *to, const json_t *run)
{
    const char *version = cln_json_text(run, "version"), *commit = cln_json_text(run, "commit");
    const char *digest = cln_json_text(json_object_get(run, "result"), "model_digest");

    fputs("<footer>cl-nascent ", to);
    cln_html_text(to, version);
    if (*commit) {
        fputs(" of commit ", to);
        cln_html_text(to, commit);
    }
    if (*digest) {
        fputs(" &middot; model ", to);
        cln_html_text(to, digest);
    }
    fputs("</footer>\n</main>\n", to);
}

static void put_contents(FILE *to, const cln_report_data *data)
{
    fputs("<nav>\n", to);
    for (int i = 0; i < cln_report_section_count; i++) {
        const cln_report_section *s = &cln_report_sections[i];

        if (s->when(data))
            fprintf(to, "<a href='#%s'>%s</a>\n", s->id, s->title);
    }
    fputs("</nav>\n", to);
}

static cln_status put_page(FILE *to, const cln_report_data *data)
{
    cln_status st = CLN_OK;

    put_head(to, data->folder, data->run);
    if (isfinite(data->gone))
        fprintf(to,
                "<p>It ended at step %.0f, but the checkpoint of that is gone or cannot be read: "
                "all here is of step %lld.</p>\n",
                data->gone, (long long)data->until);
    put_doubt(to, data->run);
    put_headline(to, data);
    put_contents(to, data);
    for (int i = 0; i < cln_report_section_count; i++) {
        const cln_report_section *s = &cln_report_sections[i];

        if (!s->when(data))
            continue;
        fprintf(to, "<h2 id='%s'>%s</h2>\n", s->id, s->title);
        CLN_TRY(s->put(to, data));
    }
    put_foot(to, data->run);
done:
    return st;
}

cln_status cln_report_write(const char *run, int64_t until)
{
    cln_status st = CLN_OK;
    cln_report_data data = {.shown = -1};
    cln_atomic_file *file = NULL;
    char *path = NULL;
    /* CSS and SVG need decimal points, whatever locale the calling program has set. */
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t outside = uselocale(c_locale);

    CLN_TRY(cln_report_data_read(run, until, &data));
    CLN_TRY(cln_path_join(&path, run, "report.html"));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(put_page(cln_atomic_stream(file), &data));
    st = cln_atomic_commit(&file);
done:
    cln_atomic_abandon(file);
    cln_report_data_free(&data);
    free(path);
    uselocale(outside);
    if (c_locale)
        freelocale(c_locale);
    return st;
}
