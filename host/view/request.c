/* Reads and checks requests. See request.h. */
#include "view/request.h"

#include <ctype.h>
#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/random.h>

#include "base/number.h"
#include "render/orbit.h"

/* ---- values ---- */

static cln_status read_real(cln_ask_get *get, void *query, const char *name, double low,
                            double high, double standard, double *out)
{
    const char *text = get(query, name);
    double value = standard;

    if (text && (!cln_reals_read(text, 1, &value) || !(value >= low && value <= high)))
        return cln_fail(CLN_USAGE, "%s: give a number from %g to %g", name, low, high);
    *out = value;
    return CLN_OK;
}

static cln_status read_int(cln_ask_get *get, void *query, const char *name, int low, int high,
                           int standard, int *out)
{
    const char *text = get(query, name);
    long long value = standard;

    if (text && (!cln_integer_read(text, &value) || value < low || value > high))
        return cln_fail(CLN_USAGE, "%s: give a whole number from %d to %d", name, low, high);
    *out = (int)value;
    return CLN_OK;
}

/* Index of the given word, 0 without one. */
static cln_status read_word(cln_ask_get *get, void *query, const char *name,
                            const char *const *words, int count, int *out)
{
    const char *text = get(query, name);

    *out = 0;
    if (!text)
        return CLN_OK;
    for (int i = 0; i < count; i++)
        if (strcmp(text, words[i]) == 0) {
            *out = i;
            return CLN_OK;
        }
    return cln_fail(CLN_USAGE, "%s: unknown word", name);
}

/* ---- cameras ---- */

static cln_status check_size(const cln_camera *c)
{
    if (c->width > CLN_ASK_SIDE || c->height > CLN_ASK_SIDE ||
        (int64_t)c->width * c->height > CLN_ASK_PIXELS)
        return cln_fail(CLN_USAGE,
                        "a picture of %d x %d is too large: at most %d pixels a side and %d in all",
                        c->width, c->height, CLN_ASK_SIDE, CLN_ASK_PIXELS);
    return CLN_OK;
}

static cln_status read_free_camera(cln_ask_get *get, void *query, int width, int height,
                                   cln_camera *out)
{
    cln_status st = CLN_OK;
    const char *pose = get(query, "pose");
    double focal = 0;

    if (width < 1 || height < 1)
        CLN_TRY(cln_fail(CLN_USAGE, "width, height: a pose needs both"));
    if (!pose || !cln_reals_read(pose, 12, out->c2w))
        CLN_TRY(cln_fail(CLN_USAGE, "pose: give 12 numbers with commas"));
    CLN_TRY(read_real(get, query, "focal", 1e-3, 1e9, 0, &focal));
    if (!(focal > 0))
        CLN_TRY(cln_fail(CLN_USAGE, "focal: a pose needs it, in pixels"));
    out->width = width;
    out->height = height;
    out->fx = out->fy = focal;
    out->cx = 0.5 * width;
    out->cy = 0.5 * height;
    CLN_TRY(check_size(out));
    st = cln_camera_check(out, "camera");
done:
    return st;
}

static cln_status read_view(const cln_scene *scene, cln_ask_get *get, void *query, int *view)
{
    const int count = scene ? scene->view_count : 0;

    *view = -1;
    if (!get(query, "view"))
        return CLN_OK;
    if (count == 0)
        return cln_fail(CLN_USAGE, "view: the run's scene is not here");
    return read_int(get, query, "view", 0, count - 1, -1, view);
}

/* The view's camera without its pose, which a training on another thread may be refining. */
static const cln_camera *lens_of(const cln_view *view, cln_camera *out)
{
    const size_t from = offsetof(cln_camera, fx);

    memset(out, 0, sizeof *out);
    memcpy((char *)out + from, (const char *)&view->camera + from, sizeof *out - from);
    return out;
}

static cln_status read_camera(const cln_scene *scene, cln_ask_get *get, void *query, cln_ask *out)
{
    cln_status st = CLN_OK;
    cln_camera like;
    int width = 0, height = 0;

    CLN_TRY(read_view(scene, get, query, &out->view));
    CLN_TRY(read_int(get, query, "width", 0, CLN_ASK_SIDE, 0, &width));
    CLN_TRY(read_int(get, query, "height", 0, CLN_ASK_SIDE, 0, &height));
    if (out->view < 0) {
        CLN_TRY(read_free_camera(get, query, width, height, &out->camera));
    } else {
        const bool lies = cln_view_turn(&scene->views[out->view]) >= 5;

        CLN_TRY(cln_orbit_resize(lens_of(&scene->views[out->view], &like), lies ? height : width,
                                 lies ? width : height, &out->camera));
        CLN_TRY(check_size(&out->camera));
    }
done:
    return st;
}

static cln_status read_crop(cln_ask_get *get, void *query, cln_crop *out)
{
    cln_status st = CLN_OK;
    const char *text = get(query, "crop");
    double numbers[CLN_CROP_NUMBERS];

    if (!text)
        return CLN_OK;
    CLN_TRY(cln_crop_read("crop", text, numbers));
    CLN_TRY(cln_crop_from_numbers("crop", numbers, out));
done:
    return st;
}

/* ---- films ---- */

static cln_status read_film(cln_ask_get *get, void *query, cln_ask *out)
{
    cln_status st = CLN_OK;

    CLN_TRY(read_int(get, query, "width", 16, CLN_ASK_SIDE, 0, &out->width));
    CLN_TRY(read_int(get, query, "height", 16, CLN_ASK_SIDE, 0, &out->height));
    CLN_TRY(read_int(get, query, "frames", 1, CLN_FILM_FRAMES, 0, &out->frames));
    CLN_TRY(read_real(get, query, "fps", 1, 240, 24, &out->fps));
    if (out->width == 0 || out->height == 0 || out->frames == 0)
        CLN_TRY(cln_fail(CLN_USAGE, "width, height, frames: a film needs all three"));
    if ((int64_t)out->width * out->height > CLN_ASK_PIXELS ||
        (double)out->width * out->height * out->frames > CLN_FILM_PIXELS)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "a film of %d x %d x %d is too large: at most %d pixels a frame and %g in "
                         "all",
                         out->width, out->height, out->frames, CLN_ASK_PIXELS, CLN_FILM_PIXELS));
done:
    return st;
}

static cln_status read_film_name(cln_ask_get *get, void *query, char out[CLN_FILM_NAME])
{
    const char *text = get(query, "film");

    if (!text || strlen(text) != CLN_FILM_NAME - 1 ||
        strspn(text, "0123456789abcdef") != CLN_FILM_NAME - 1)
        return cln_fail(CLN_USAGE, "film: give the name of a film");
    memcpy(out, text, CLN_FILM_NAME);
    return CLN_OK;
}

/* ---- all ---- */

static cln_status read_photo(const cln_scene *scene, cln_ask_get *get, void *query, cln_ask *out)
{
    cln_status st = CLN_OK;

    CLN_TRY(read_view(scene, get, query, &out->view));
    if (out->view < 0)
        CLN_TRY(cln_fail(CLN_USAGE, "view: give the number of a photo"));
    CLN_TRY(read_int(get, query, "side", 16, CLN_ASK_PHOTO_SIDE, 1024, &out->side));
done:
    return st;
}

/* Of a view's picture as it is seen, to one of the camera's. */
static cln_status read_point(const cln_scene *scene, cln_ask_get *get, void *query, cln_ask *out)
{
    cln_status st = CLN_OK;
    const int turn = out->view >= 0 ? cln_view_turn(&scene->views[out->view]) : 1;
    const double wide = out->camera.width, high = out->camera.height;
    double x = 0, y = 0;

    CLN_TRY(read_real(get, query, "x", 0, turn >= 5 ? high : wide, -1, &x));
    CLN_TRY(read_real(get, query, "y", 0, turn >= 5 ? wide : high, -1, &y));
    if (x < 0 || y < 0)
        CLN_TRY(cln_fail(CLN_USAGE, "x, y: give a position in the picture"));
    out->x = turn == 3 ? wide - x : turn == 6 ? y : turn == 8 ? wide - y : x;
    out->y = turn == 3 ? high - y : turn == 6 ? high - x : turn == 8 ? x : y;
done:
    return st;
}

static cln_status read_background(const float standard[3], cln_ask_get *get, void *query,
                                  cln_ask *out)
{
    const char *colour = get(query, "background");
    double rgb[3] = {standard[0], standard[1], standard[2]};

    if (colour && !cln_reals_read(colour, 3, rgb))
        return cln_fail(CLN_USAGE, "background: give three numbers with commas");
    for (int c = 0; c < 3; c++) {
        if (!(rgb[c] >= 0 && rgb[c] <= 1))
            return cln_fail(CLN_USAGE, "background: give numbers from 0 to 1");
        out->background[c] = (float)rgb[c];
    }
    return CLN_OK;
}

static cln_status read_looks(cln_ask_get *get, void *query, cln_ask *out)
{
    static const char *const shows[CLN_SHOWS] = {"colour", "depth", "opacity", "level", "error"};
    static const char *const formats[] = {"jpeg", "png"}, *const flags[] = {"0", "1"};
    cln_status st = CLN_OK;
    double ms = 0;
    int show = 0, format = 0, edges = 0;

    CLN_TRY(read_real(get, query, "ms", 0, 60000, 0, &ms));
    CLN_TRY(read_word(get, query, "show", shows, CLN_SHOWS, &show));
    CLN_TRY(read_word(get, query, "format", formats, 2, &format));
    CLN_TRY(read_word(get, query, "edges", flags, 2, &edges));
    out->budget = out->kind == CLN_ASK_PICTURE ? ms / 1000 : 0;
    out->edges = edges == 1 || out->kind == CLN_ASK_FILM_FRAME;
    out->show = (cln_show)show;
    out->png = format == 1;
done:
    return st;
}

cln_status cln_ask_read(cln_ask_kind kind, const cln_scene *scene, const float background[3],
                        cln_ask_get *get, void *query, cln_ask *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    out->kind = kind;
    out->view = -1;
    if (kind >= CLN_ASK_FILM_FRAME)
        CLN_TRY(read_film_name(get, query, out->film));
    if (kind == CLN_ASK_PHOTO)
        CLN_TRY(read_photo(scene, get, query, out));
    if (kind == CLN_ASK_FILM_BEGIN)
        CLN_TRY(read_film(get, query, out));
    if (kind == CLN_ASK_PICTURE || kind == CLN_ASK_POINT || kind == CLN_ASK_FILM_FRAME) {
        CLN_TRY(read_camera(scene, get, query, out));
        CLN_TRY(read_crop(get, query, &out->crop));
    }
    if (kind == CLN_ASK_POINT)
        CLN_TRY(read_point(scene, get, query, out));
    if (kind == CLN_ASK_PICTURE || kind == CLN_ASK_FILM_FRAME)
        CLN_TRY(read_looks(get, query, out));
    if (kind == CLN_ASK_PICTURE || kind == CLN_ASK_FILM_FRAME || kind == CLN_ASK_PHOTO)
        CLN_TRY(read_background(background, get, query, out));
done:
    return st;
}

/* ---- who asks ---- */

/* "host", "host:port" or "[address]:port" -> host, lower case; false if it is none of these. */
static bool host_name(const char *host, char *out, size_t bytes)
{
    const bool bracket = *host == '[';
    const char *from = host + bracket;
    const size_t length = strcspn(from, bracket ? "]" : ":");
    const char *rest = from + length;

    if (bracket && *rest++ != ']')
        return false;
    if (length == 0 || length >= bytes)
        return false;
    for (size_t i = 0; i < length; i++) { /* of names and numeric addresses */
        const char c = from[i];

        if (!isalnum((unsigned char)c) && !strchr("-._", c) && !(bracket && strchr(":%", c)))
            return false;
    }
    if (*rest == ':' && strspn(rest + 1, "0123456789") <= 5)
        rest += 1 + strspn(rest + 1, "0123456789");
    if (*rest)
        return false;
    for (size_t i = 0; i < length; i++)
        out[i] = (char)(from[i] >= 'A' && from[i] <= 'Z' ? from[i] - 'A' + 'a' : from[i]);
    out[length] = 0;
    return true;
}

bool cln_ask_allowed(const char *host, const char *origin, const char *site, bool far,
                     const char **reason)
{
    char name[256];

    *reason = "the Host of the request is not this viewer's; open it as http://localhost with its "
              "port (from another machine through ssh -L), or start it with --listen 0.0.0.0, "
              "which takes any name, with a token";
    if (!host || !host_name(host, name, sizeof name))
        return false;
    if (!far && strcmp(name, "localhost") != 0 && strcmp(name, "127.0.0.1") != 0 &&
        strcmp(name, "::1") != 0)
        return false;
    *reason = "the request comes from a page of another Origin";
    if (origin) {
        const char *rest = strncmp(origin, "http://", 7) == 0    ? origin + 7
                           : strncmp(origin, "https://", 8) == 0 ? origin + 8
                                                                 : NULL;

        if (!rest || strcasecmp(rest, host) != 0)
            return false;
    }
    return !site || strcmp(site, "same-origin") == 0 || strcmp(site, "none") == 0;
}

cln_status cln_ask_make_token(char out[33])
{
    unsigned char bytes[16];

    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return cln_fail(CLN_FAILED, "no random numbers for a token: %s", strerror(errno));
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(out + 2 * i, 3, "%02x", bytes[i]);
    return CLN_OK;
}

bool cln_ask_same_token(const char *given, const char *wanted)
{
    const size_t length = wanted ? strlen(wanted) : 0;
    unsigned char differs = 0;

    if (!given || !wanted || strlen(given) != length)
        return false;
    for (size_t i = 0; i < length; i++)
        differs |= (unsigned char)(given[i] ^ wanted[i]);
    return differs == 0;
}
