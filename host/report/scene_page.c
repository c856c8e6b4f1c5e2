/* See scene_page.h. Drawings are parallel projections along the axes of the scene's frame, with the
 * same scale: what lies beyond their edges is counted below them. */
#include "report/scene_page.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/image.h"
#include "io/json.h"
#include "report/html.h"
#include "report/report_style.h"

enum { SIDE = 340, THUMB_SIDE = 180, PHOTOS = 60, MOST_NAMED = 200, QUALITY = 80, DRAWN = 8 };

static const char style[] =
    ".found{border-left:4px solid #9db4c8;padding:2px 12px;margin:10px 0}"
    ".found.fault{border-color:#c2501c}"
    ".photos{display:grid;grid-template-columns:repeat(auto-fill,minmax(170px,1fr));gap:12px}"
    ".photos figure{margin:0}.photos img{width:100%;border:2px solid var(--line)}"
    ".photos .named img{border-color:#c2501c}.photos figcaption{font-size:12px}"
    ".photos .remarked img{border-color:#9db4c8}"
    ".ring{fill:none;stroke-width:2}"
    ".sides{display:grid;grid-template-columns:repeat(auto-fit,minmax(280px,1fr));gap:16px}";

/* Is the view named by a finding, or by one that is likely a fault? */
static bool is_named(const json_t *document, const char *name, bool fault)
{
    const json_t *findings = json_object_get(document, "findings");

    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i), *views = json_object_get(one, "views");

        for (size_t k = 0; k < json_array_size(views); k++)
            if ((!fault || json_is_true(json_object_get(one, "likely_fault"))) &&
                strcmp(json_string_value(json_array_get(views, k)), name) == 0)
                return true;
    }
    return false;
}

/* Writes the words of the findings that name the view. */
static void put_namers(FILE *to, const json_t *document, const char *name)
{
    const json_t *findings = json_object_get(document, "findings");
    const char *before = "; named by ";

    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i), *views = json_object_get(one, "views");
        size_t k = 0;

        while (k < json_array_size(views) &&
               strcmp(json_string_value(json_array_get(views, k)), name) != 0)
            k++;
        if (k == json_array_size(views))
            continue;
        fprintf(to, "%s%s ", before,
                json_is_true(json_object_get(one, "likely_fault")) ? "the fault" : "the remark");
        cln_html_text(to, cln_json_text(one, "what"));
        before = ", ";
    }
}

static void put_findings(FILE *to, const json_t *findings)
{
    if (!json_array_size(findings))
        fputs("<p>Nothing was found.</p>\n", to);
    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i);

        fprintf(to, "<div class='found%s'><b>",
                json_is_true(json_object_get(one, "likely_fault")) ? " fault" : "");
        cln_html_text(to, cln_json_text(one, "what"));
        fputs("</b> ", to);
        cln_html_text(to, cln_json_text(one, "text"));
        fputs("</div>\n", to);
    }
}

/* ---- from three sides ---- */

typedef struct side {
    const char *title;
    int right, up; /* axes */
} side;

static const side sides[] = {{"from above: x to the right, y up", 0, 1},
                             {"from the front: x to the right, z up", 0, 2},
                             {"from the side: y to the right, z up", 1, 2}};

/* Half the width that is drawn around the cube's centre, so that it shows the cube and most
 * cameras. */
static cln_status find_reach(const cln_scene *scene, double *reach)
{
    cln_status st = CLN_OK;
    double *far = NULL;

    CLN_TRY(cln_alloc(&far, (size_t)scene->view_count, sizeof *far, "cameras"));
    for (int i = 0; i < scene->view_count; i++)
        for (int a = 0; a < 3; a++)
            far[i] =
                fmax(far[i], fabs(scene->views[i].camera.c2w[4 * a + 3] - scene->space.centre[a]));
    cln_reals_sort(far, scene->view_count);
    *reach = 1.15 * fmax((scene->space.forward ? DRAWN : 1) * scene->space.half,
                         far[(int)(0.9 * (scene->view_count - 1))]);
done:
    free(far);
    return st;
}

static bool place(const cln_scene *scene, const side *s, double reach, const double at[3],
                  double out[2])
{
    const double x = (at[s->right] - scene->space.centre[s->right]) / reach;
    const double y = (at[s->up] - scene->space.centre[s->up]) / reach;

    out[0] = SIDE * .5 * (1 + x);
    out[1] = SIDE * .5 * (1 - y);
    return fabs(x) <= 1 && fabs(y) <= 1;
}

static void put_cameras(FILE *to, const cln_scene *scene, const json_t *document, const side *s,
                        double reach, int *outside)
{
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const double *m = view->camera.c2w, at[3] = {m[3], m[7], m[11]};
        const bool named = is_named(document, view->name, true);
        const bool trains = view->split == CLN_SPLIT_TRAIN;
        const char *colour = named ? "#c2501c" : trains ? "#2f6f9f" : "#8a63a6";
        double from[2], end[2], tip[3];

        if (!place(scene, s, reach, at, from)) {
            ++*outside;
            continue;
        }
        for (int a = 0; a < 3; a++)
            tip[a] = at[a] + .12 * reach * m[4 * a + 2];
        (void)place(scene, s, reach, tip, end);
        fprintf(to, "<g stroke='%s' fill='%s'><title>", colour, colour);
        cln_html_text(to, view->name);
        fprintf(to, "</title><line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>", from[0], from[1],
                end[0], end[1]);
        if (trains)
            fprintf(to, "<circle cx='%.1f' cy='%.1f' r='3'/>", from[0], from[1]);
        else
            fprintf(to, "<rect x='%.1f' y='%.1f' width='6' height='6'/>", from[0] - 3, from[1] - 3);
        if (named)
            fprintf(to, "<circle class=ring cx='%.1f' cy='%.1f' r='7'/>", from[0], from[1]);
        fputs("</g>\n", to);
    }
}

/* Draws the edges of a forward space, from the near plane to DRAWN times its distance. */
static void put_frustum(FILE *to, const cln_scene *scene, const side *s, double reach)
{
    static const int edges[12][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {1, 3},
                                     {4, 6}, {5, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};

    fputs("<path fill='none' stroke='#1d2329' d='", to);
    for (int e = 0; e < 12; e++)
        for (int end = 0; end < 2; end++) {
            const int k = edges[e][end];
            const double cube[3] = {k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 - 2.0 / DRAWN : -1};
            double at[3], on[2];

            cln_space_point_to_scene(&scene->space, cube, at);
            (void)place(scene, s, reach, at, on);
            fprintf(to, "%c%.1f %.1f", end ? 'L' : 'M', on[0], on[1]);
        }
    fputs("'/>\n", to);
}

static void put_side(FILE *to, const cln_scene *scene, const json_t *document, const side *s,
                     double reach)
{
    const json_t *points = json_object_get(document, "points");
    const double size = SIDE * scene->space.half / reach;
    int cameras = 0, hidden = 0;

    fprintf(
        to,
        "<figure style='margin:0'><svg viewBox='0 0 %d %d' role=img aria-label='Cameras, points "
        "and cube %s'><rect width='%d' height='%d' fill='#f5f7f8'/>",
        SIDE, SIDE, s->title, SIDE, SIDE);
    if (scene->space.forward)
        put_frustum(to, scene, s, reach);
    else
        fprintf(to,
                "<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' fill='#fff' "
                "stroke='#1d2329'/>\n",
                .5 * (SIDE - size), .5 * (SIDE - size), size, size);
    fputs("<path fill='none' stroke='#5a8f4a' stroke-width='2' stroke-linecap='round' d='", to);
    for (size_t i = 0; i < json_array_size(points); i++) {
        const json_t *point = json_array_get(points, i);
        double at[3], on[2];

        for (size_t a = 0; a < 3; a++)
            at[a] = json_number_value(json_array_get(point, a));
        if (place(scene, s, reach, at, on))
            fprintf(to, "M%.1f %.1fh0", on[0], on[1]);
        else
            hidden++;
    }
    fputs("'/>\n", to);
    put_cameras(to, scene, document, s, reach, &cameras);
    fprintf(to, "</svg><figcaption class=soft>%s", s->title);
    if (cameras || hidden)
        fprintf(to, "; not in the picture: %d camera%s, %d point%s", cameras,
                cln_plural(cameras, "", "s"), hidden, cln_plural(hidden, "", "s"));
    fputs("</figcaption></figure>\n", to);
}

/* ---- photos ---- */

/* A small copy over the background, as people see the photo, grey where it does not count: nearest
 * pixels suffice to recognise it. */
static cln_status put_thumb(FILE *to, const cln_scene *scene, const cln_view *view)
{
    cln_status st = CLN_OK;
    const int wide = view->camera.width, high = view->camera.height;
    const double by = fmin(1, (double)THUMB_SIDE / (wide > high ? wide : high));
    int w = (int)fmax(1, by * wide), h = (int)fmax(1, by * high);
    uint8_t *pixels = NULL, *jpeg = NULL;
    size_t bytes = 0;

    CLN_TRY(cln_alloc(&pixels, (size_t)w * (size_t)h, 3, "a thumbnail"));
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            const int u = x * wide / w, v = y * high / h;
            float rgb[3], alpha = 1;

            cln_view_pixel(view, u, v, scene->background, rgb, &alpha);
            for (int c = 0; c < 3; c++)
                pixels[3 * ((size_t)y * (size_t)w + (size_t)x) + (size_t)c] =
                    cln_to_u8(cln_view_keeps(view, u, v) ? rgb[c] : CLN_LEFT_OUT_GREY);
        }
    CLN_TRY(cln_image_turn(cln_view_turn(view), &w, &h, 3, &pixels));
    CLN_TRY(cln_image_encode_jpeg(w, h, 3, pixels, QUALITY, &jpeg, &bytes));
    fprintf(to, "<img width=%d height=%d alt='' src='data:image/jpeg;base64,", w, h);
    cln_base64_write(to, jpeg, bytes);
    fputs("'>", to);
done:
    free(pixels);
    free(jpeg);
    return st;
}

static void put_value(FILE *to, const char *name, double value, const char *form)
{
    if (!isnan(value)) {
        fprintf(to, " &middot; %s ", name);
        fprintf(to, form, value);
    }
}

/* Shows the photos that a finding names, and others evenly chosen. */
static cln_status put_photos(FILE *to, const cln_scene *scene, const json_t *document)
{
    cln_status st = CLN_OK;
    const json_t *views = json_object_get(document, "views");
    const int step = (scene->view_count + PHOTOS - 1) / PHOTOS;
    int shown = 0; /* of those that are named */

    if (step > 1)
        fprintf(to, "<p class=soft>One in %d photos, and those that findings name.</p>\n", step);
    fputs("<div class=photos>\n", to);
    for (int i = 0; i < scene->view_count; i++) {
        const json_t *about = json_array_get(views, (size_t)i);
        const bool named = is_named(document, scene->views[i].name, false);
        const bool fault = named && is_named(document, scene->views[i].name, true);

        shown += named;
        if ((!named || shown > MOST_NAMED) && i % step)
            continue;
        fprintf(to, "<figure%s>", fault ? " class=named" : named ? " class=remarked" : "");
        CLN_TRY(put_thumb(to, scene, &scene->views[i]));
        fputs("<figcaption>", to);
        cln_html_text(to, scene->views[i].name);
        fprintf(to, "<br><span class=soft>%s, fits %.0f of %.0f marks",
                cln_json_text(about, "split"), cln_json_number(about, "agreeing"),
                cln_json_number(about, "ties"));
        put_value(to, "exposure", cln_json_number(about, "exposure"), "%+.2f");
        put_value(to, "sharpness", cln_json_number(about, "sharpness"), "%.2f");
        put_namers(to, document, scene->views[i].name);
        fputs("</span></figcaption></figure>\n", to);
    }
    fputs("</div>\n", to);
    if (shown > MOST_NAMED)
        fprintf(to,
                "<p class=soft>And %d more that findings name, of which one in %d is shown.</p>\n",
                shown - MOST_NAMED, step);
done:
    return st;
}

/* ---- measures ---- */

static void put_measures(FILE *to, const json_t *object)
{
    const char *key = NULL;
    json_t *value = NULL;

    fputs("<table>\n", to);
    json_object_foreach((json_t *)object, key, value)
    {
        char *shown = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(6));

        fputs("<tr><th scope=row>", to);
        cln_html_text(to, key);
        fputs("<td class=wide>", to);
        cln_html_text(to, json_is_string(value) ? json_string_value(value) : shown);
        fputs("\n", to);
        free(shown);
    }
    fputs("</table>\n", to);
}

static cln_status put_page(FILE *to, const cln_scene *scene, const json_t *document)
{
    cln_status st = CLN_OK;
    double reach = 1;

    CLN_TRY(find_reach(scene, &reach));
    fputs("<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n"
          "<meta name=viewport content=\"width=device-width,initial-scale=1\">\n<title>",
          to);
    cln_html_text(to, scene->folder);
    fprintf(to, " &ndash; cl-nascent check</title>\n<style>%s%s</style>\n<main>\n<h1>",
            report_style, style);
    cln_html_text(to, scene->folder);
    fprintf(to, "</h1>\n<p class=soft>%d photo%s, read as ", scene->view_count,
            cln_plural(scene->view_count, "", "s"));
    cln_html_text(to, scene->dialect);
    fputs("; cube: ", to);
    cln_html_text(to, scene->bounds_rule);
    fputs("</p>\n<h2>Findings</h2>\n", to);
    put_findings(to, json_object_get(document, "findings"));
    fputs("<h2>Cameras, points and cube</h2>\n<div class=sides>\n", to);
    for (size_t i = 0; i < sizeof sides / sizeof *sides; i++)
        put_side(to, scene, document, &sides[i], reach);
    fputs(
        "</div>\n<p class=soft>Blue dots: training cameras; purple squares: held out; orange with "
        "a ring: named by a fault. Green: points that two photos see. The large square is the "
        "cube.</p>\n"
        "<h2>Photos</h2>\n",
        to);
    CLN_TRY(put_photos(to, scene, document));
    fputs("<h2>Measures</h2>\n", to);
    put_measures(to, json_object_get(document, "measures"));
    fputs("<h2>Training</h2>\n", to);
    put_measures(to, json_object_get(document, "training"));
    fputs("<footer>cl-nascent " CLN_VERSION "</footer>\n</main>\n", to);
done:
    return st;
}

cln_status cln_scene_page(const char *path, const cln_scene *scene, const json_t *document)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    /* CSS and SVG need decimal points, whatever locale the calling program has set. */
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t outside = uselocale(c_locale);

    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(put_page(cln_atomic_stream(file), scene, document));
    st = cln_atomic_commit(&file);
done:
    cln_atomic_abandon(file);
    uselocale(outside);
    if (c_locale)
        freelocale(c_locale);
    return st;
}
