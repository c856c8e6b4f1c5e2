/* The report's section "The octree": views coloured by the level and the error of the leaf that
 * each pixel shows (RUN/eval/STEM/NAME{.tree,.tree-error}.png, tree.json), and a table of the
 * integer program's decisions. */
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/text.h"
#include "io/json.h"
#include "report/html.h"
#include "io/palette.h"
#include "io/progress.h"

enum { DECISIONS_SHOWN = 64, RAMP_STOPS = 9 };

/* ---- the pictures ---- */

static void put_colour(FILE *to, const uint8_t rgb[3])
{
    fprintf(to, "#%02x%02x%02x", rgb[0], rgb[1], rgb[2]);
}

static void put_key(FILE *to, const uint8_t rgb[3])
{
    fputs("<span><span class=key style='background:", to);
    put_colour(to, rgb);
    fputs("'></span>", to);
}

/* "level 3: 512 leaves", for each level that has any. */
static void put_levels(FILE *to, const json_t *levels)
{
    fputs("<p class=keys>", to);
    for (int level = 0; level < CLN_PALETTE_LEVELS; level++) {
        const double leaves = json_number_value(json_array_get(levels, (size_t)level));
        uint8_t rgb[3];
        char text[32];

        if (!(leaves > 0))
            continue;
        cln_palette_level(level, rgb);
        cln_format_count(leaves, text);
        put_key(to, rgb);
        fprintf(to, "level %d: %s %s</span>\n", level, text, cln_plural(leaves, "leaf", "leaves"));
    }
    fputs("</p>\n", to);
}

static void put_error_scale(FILE *to, double low, double high)
{
    uint8_t rgb[3];

    fprintf(to,
            "<p class=keys><span>error %.2g<i class=ramp style='background:linear-gradient(90deg",
            low);
    for (int i = 0; i < RAMP_STOPS; i++) {
        cln_palette_ramp((double)i / (RAMP_STOPS - 1), rgb);
        fputc(',', to);
        put_colour(to, rgb);
    }
    fprintf(to, ")'></i>%.2g</span>", high);
    cln_palette_error(NAN, low, high, rgb);
    put_key(to, rgb);
    fputs(
        "not measured</span></p>\n<p class=soft>Error of a leaf: the squared error of the training "
        "rays, shared out over the leaves by what each added to a ray's colour, per ray; the scale "
        "is logarithmic.</p>\n",
        to);
}

/* The row of a view in the evaluation; NULL if it has none. */
static const json_t *find_image(const cln_report_data *data, const char *view)
{
    const json_t *images = json_object_get(data->evals[data->shown].document, "images");
    const json_t *image = NULL;

    for (size_t i = 0; (image = json_array_get(images, i)); i++)
        if (strcmp(cln_json_text(image, "name"), view) == 0)
            return image;
    return NULL;
}

static cln_status put_view(FILE *to, const char *folder, const json_t *image, bool errors)
{
    static const struct {
        const char *suffix, *what;
    } pictures[] = {{".png", "render"}, {".tree.png", "level"}, {".tree-error.png", "leaf error"}};
    cln_status st = CLN_OK;
    const char *view = cln_json_text(image, "name");
    char *file = NULL, *path = NULL;

    CLN_TRY(cln_report_file(image, &file));
    fputs("<div class=view><h3><b>", to);
    cln_html_text(to, view);
    fputs("</b></h3><div>", to);
    for (int i = 0; i < (errors ? 3 : 2); i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s/%s%s", folder, file, pictures[i].suffix));
        CLN_TRY(cln_report_picture(to, path, image, pictures[i].what));
    }
    fputs("</div></div>\n", to);
done:
    free(file);
    free(path);
    return st;
}

static cln_status put_pictures(FILE *to, const cln_report_data *data)
{
    cln_status st = CLN_OK;
    const json_t *views = json_object_get(data->tree, "views");
    const json_t *error = json_object_get(data->tree, "error");
    const double low = cln_json_number(error, "low"), high = cln_json_number(error, "high");
    const bool errors = isfinite(low) && isfinite(high);
    const double leaves = cln_json_number(data->tree, "leaves");
    char *folder = NULL, text[32];

    cln_format_count(leaves, text);
    fprintf(to, "<p>%s %s with a model", isfinite(leaves) ? text : "&ndash;",
            cln_plural(leaves, "leaf", "leaves"));
    cln_format_count(cln_json_number(data->tree, "step"), text);
    fprintf(
        to,
        " at step %s. A pixel has the colour of the leaf that holds the surface it shows; the "
        "dark lines are borders of leaves. What is mostly transparent, or lies in no leaf, is as "
        "rendered.</p>\n",
        text);
    put_levels(to, json_object_get(data->tree, "leaves_by_level"));
    if (errors)
        put_error_scale(to, low, high);
    fprintf(to, "<div class=captions><span>render</span><span>level</span><span>%s</span></div>\n",
            errors ? "error" : "");
    CLN_TRY(cln_asprintf(&folder, "%s/eval/%s", data->folder, data->evals[data->shown].stem));
    for (size_t i = 0; i < json_array_size(views); i++) {
        const char *view = json_string_value(json_array_get(views, i));
        const json_t *image = view ? find_image(data, view) : NULL;

        if (image)
            CLN_TRY(put_view(to, folder, image, errors));
    }
done:
    free(folder);
    return st;
}

/* ---- the decisions ---- */

static void put_count(FILE *to, double count)
{
    char text[32];

    cln_format_count(count, text);
    fprintf(to, "<td class=n>%s", isfinite(count) ? text : "&ndash;");
}

static void put_psnr(FILE *to, double psnr)
{
    fputs("<td class=n>", to);
    cln_report_number(to, psnr, 2);
}

static void put_decision(FILE *to, const cln_report_decision *d, bool merges)
{
    char text[32];

    cln_format_duration(d->seconds, text);
    fprintf(to, "<tr><td>%s", text);
    put_count(to, d->step);
    put_count(to, d->leaves_before);
    put_count(to, d->split);
    if (merges)
        put_count(to, d->merged);
    put_count(to, d->leaves);
    put_psnr(to, d->psnr_before);
    put_psnr(to, d->psnr_after);
    if (merges)
        put_psnr(to, d->psnr_pretrained);
    fputs("<td class=n>", to);
    cln_report_number(to, d->work_seconds, 1);
    fprintf(to, "<td>%s\n", d->over_budget ? "over budget" : "");
}

static void put_decisions(FILE *to, const cln_report_data *data)
{
    const int count = data->decision_count;
    const int shown = count < DECISIONS_SHOWN ? count : DECISIONS_SHOWN;
    const double budget = data->decisions[count - 1].budget;
    const bool merges = !cln_report_of_voxels(data);
    char text[32];

    fprintf(to,
            "<h3>Decisions on single leaves</h3>\n<p class=soft>Split: leaves that became "
            "eight%s. PSNR is of a fixed batch of training rays: before the change%s.",
            merges ? "; merged: groups of up to eight that became one" : "",
            merges ? ", after it, and with the merged leaves trained on the old ones"
                   : " and after it");
    if (isfinite(budget)) {
        cln_format_count(budget, text);
        fprintf(to, " At most %s leaves were allowed.", text);
    }
    fprintf(to,
            "</p>\n<table><tr><th>training time<th class=n>steps<th class=n>leaves<th class=n>split"
            "%s<th class=n>leaves after<th class=n>PSNR before<th class=n>after"
            "%s<th class=n>seconds<td>\n",
            merges ? "<th class=n>merged" : "", merges ? "<th class=n>pre-trained" : "");
    for (int k = 0; k < shown; k++)
        put_decision(to, &data->decisions[shown > 1 ? (int64_t)k * (count - 1) / (shown - 1) : 0],
                     merges);
    fputs("</table>\n", to);
    if (shown < count)
        fprintf(to, "<p class=soft>%d of %d, in even steps.</p>\n", shown, count);
}

bool cln_report_has_tree(const cln_report_data *data)
{
    return data->tree || data->decision_count > 0;
}

cln_status cln_report_tree(FILE *to, const cln_report_data *data)
{
    cln_status st = CLN_OK;

    if (data->tree)
        CLN_TRY(put_pictures(to, data));
    if (data->decision_count > 0)
        put_decisions(to, data);
done:
    return st;
}
