/* The report's section "Held-out views": photo, render and error of a few views from the best to
 * the worst (RUN/eval/STEM/NAME{.truth.png,.png,.error.png}), and the figures of all. */
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/json.h"
#include "report/html.h"
#include "io/progress.h"

enum { SHOWN = 6, LISTED = 400 };

static cln_status put_view(FILE *to, const char *folder, const json_t *image)
{
    static const struct {
        const char *suffix, *what;
    } pictures[] = {{".truth.png", "truth"}, {".png", "render"}, {".error.png", "error"}};
    cln_status st = CLN_OK;
    const char *name = cln_json_text(image, "name");
    char *file = NULL, *path = NULL;

    CLN_TRY(cln_report_file(image, &file));
    fputs("<div class=view><h3><b>", to);
    cln_html_text(to, name);
    fputs("</b><span class=soft>PSNR ", to);
    cln_report_number(to, cln_json_number(image, "psnr"), 2);
    fputs(" dB &middot; SSIM ", to);
    cln_report_number(to, cln_json_number(image, "ssim"), 4);
    fputs("</span></h3><div>", to);
    for (size_t i = 0; i < sizeof pictures / sizeof pictures[0]; i++) {
        free(path);
        CLN_TRY(cln_asprintf(&path, "%s/%s%s", folder, file, pictures[i].suffix));
        CLN_TRY(cln_report_picture(to, path, image, pictures[i].what));
    }
    fputs("</div></div>\n", to);
done:
    free(file);
    free(path);
    return st;
}

/* ", mean LPIPS ...", if it was measured. */
static void put_lpips(FILE *to, const json_t *document)
{
    const char *network = cln_json_text(json_object_get(document, "lpips"), "network");

    if (!*network)
        return;
    fputs(", mean LPIPS ", to);
    cln_report_number(to, cln_json_number(json_object_get(document, "mean"), "lpips"), 4);
    fputs(strcmp(network, "alex") == 0 ? " (AlexNet)" : " (VGG-16)", to);
}

static void put_list(FILE *to, const json_t *images)
{
    int count = (int)json_array_size(images);

    fprintf(to, "<h3>All %d</h3><div class=list><table>\n<tr><th>view<th>PSNR, dB<th>SSIM\n",
            count);
    for (int i = 0; i < count && i < LISTED; i++) {
        const json_t *image = json_array_get(images, (size_t)i);

        fputs("<tr><td>", to);
        cln_html_text(to, cln_json_text(image, "name"));
        fputs("<td class=n>", to);
        cln_report_number(to, cln_json_number(image, "psnr"), 2);
        fputs("<td class=n>", to);
        cln_report_number(to, cln_json_number(image, "ssim"), 4);
        fputc('\n', to);
    }
    fputs("</table></div>\n", to);
    if (count > LISTED)
        fprintf(to, "<p class=soft>The first %d are listed.</p>\n", LISTED);
}

typedef struct ranked {
    int index;
    double psnr;
} ranked;

/* Best PSNR first, views without one last. */
static int by_psnr(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    double p = isfinite(x->psnr) ? x->psnr : -1e300, q = isfinite(y->psnr) ? y->psnr : -1e300;

    if (p != q)
        return p > q ? -1 : 1;
    return x->index - y->index;
}

static bool has_picture(const char *folder, const json_t *image)
{
    cln_status before = cln_error_status();
    char *file = NULL, *path = NULL;
    bool found = false;

    if (cln_report_file(image, &file) == CLN_OK &&
        cln_asprintf(&path, "%s/%s.png", folder, file) == CLN_OK)
        found = cln_is_file(path);
    if (before == CLN_OK)
        cln_clear_error();
    free(file);
    free(path);
    return found;
}

static cln_status put_pictures(FILE *to, const char *folder, const json_t *images)
{
    cln_status st = CLN_OK;
    ranked *order = NULL;
    int count = (int)json_array_size(images), saved = 0, shown = 0;

    CLN_TRY(cln_alloc(&order, (size_t)count, sizeof *order, "report: views"));
    for (int i = 0; i < count; i++) {
        const json_t *image = json_array_get(images, (size_t)i);
        if (has_picture(folder, image))
            order[saved++] = (ranked){i, cln_json_number(image, "psnr")};
    }
    if (saved == 0) {
        fputs("<p class=soft>The evaluation saved no pictures.</p>\n", to);
        goto done;
    }
    qsort(order, (size_t)saved, sizeof *order, by_psnr);
    shown = saved < SHOWN ? saved : SHOWN;
    if (shown < saved)
        fprintf(
            to,
            "<p class=soft>%d of %d, from the best PSNR to the worst in even steps of rank.</p>\n",
            shown, saved);
    fputs("<div class=captions><span>photo</span><span>render</span><span>error, "
          "brightened</span></div>\n",
          to);
    for (int k = 0; k < shown; k++) {
        int rank = shown > 1 ? (int)((int64_t)k * (saved - 1) / (shown - 1)) : 0;
        CLN_TRY(put_view(to, folder, json_array_get(images, (size_t)order[rank].index)));
    }
done:
    free(order);
    return st;
}

static void put_background(FILE *to, const json_t *background)
{
    double sum = 0;

    if (json_array_size(background) != 3)
        return;
    for (size_t i = 0; i < 3; i++)
        sum += json_number_value(json_array_get(background, i));
    fputs(" on background ", to);
    if (sum == 0 || sum == 3) {
        fputs(sum == 0 ? "black" : "white", to);
        return;
    }
    for (size_t i = 0; i < 3; i++)
        fprintf(to, "%s%g", i ? "," : "", json_number_value(json_array_get(background, i)));
}

cln_status cln_report_views(FILE *to, const cln_report_data *data)
{
    cln_status st = CLN_OK;
    const cln_report_eval *e = data->shown >= 0 ? &data->evals[data->shown] : NULL;
    const json_t *images = e ? json_object_get(e->document, "images") : NULL;
    char *folder = NULL;
    char time[32], steps[32];

    if (!e) {
        fputs("<p class=soft>Not evaluated yet: <code>cl-nascent eval</code> renders the held-out "
              "views, compares them, and renews this page.</p>\n",
              to);
        return CLN_OK;
    }
    if (strcmp(e->split, "train") == 0)
        fputs("<p class=soft>No held-out view was evaluated; these are training views.</p>\n", to);
    if (strcmp(e->split, "all") == 0)
        fputs(
            "<p class=soft>No held-out view was evaluated by itself; these are all views, training "
            "views among them.</p>\n",
            to);
    cln_format_duration(e->seconds, time);
    cln_format_count(e->step, steps);
    fprintf(to, "<p>%d view%s of the split <b>", e->images, cln_plural(e->images, "", "s"));
    cln_html_text(to, e->split);
    fprintf(to, "</b> at step %s, after %s of training%s", steps, time, e->how);
    put_background(to, json_object_get(e->document, "background"));
    fputs(": mean PSNR ", to);
    cln_report_number(to, e->psnr, 2);
    fputs(" dB, mean SSIM ", to);
    cln_report_number(to, e->ssim, 4);
    put_lpips(to, e->document);
    if (json_object_get(e->document, "apart"))
        fprintf(to, " (without %d that show nothing of the cube)",
                (int)json_integer_value(json_object_get(e->document, "apart")));
    fputs(".</p>\n", to);
    CLN_TRY(cln_asprintf(&folder, "%s/eval/%s", data->folder, e->stem));
    CLN_TRY(put_pictures(to, folder, images));
    if (e->images > SHOWN)
        put_list(to, images);
done:
    free(folder);
    return st;
}
