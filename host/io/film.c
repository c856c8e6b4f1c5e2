/* Films. See film.h. Colours become YCbCr by BT.709, in its narrow range. Files by ffmpeg declare
 * that; y4m has no field for it. Alpha stays straight, as browsers take it of VP9, and as what
 * imports ProRes is told or guesses. */
#include "io/film.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/command.h"
#include "io/disk.h"
#include "io/progress.h"

struct cln_film {
    int width, height, channels;
    char *path, *part; /* part: where ffmpeg writes; NULL for y4m */
    cln_command_feed *feed;
    cln_atomic_file *file;
    uint8_t *planes; /* y4m: [3][height][width] */
    int wide, high;  /* of the pictures that ffmpeg gets */
    uint8_t *even;   /* [high][wide][channels], where those are larger */
};

static const char *ending(const char *path)
{
    const char *dot = strrchr(path, '.');

    return dot && dot > path && !strchr(dot, '/') && dot[-1] != '/' ? dot : "";
}

bool cln_film_named(const char *path)
{
    static const char *const endings[] = {".mp4", ".mov", ".mkv", ".webm", ".gif", ".y4m"};

    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (strcasecmp(ending(path), endings[i]) == 0)
            return true;
    return false;
}

bool cln_film_takes_alpha(const char *path)
{
    return strcasecmp(ending(path), ".mov") == 0 || strcasecmp(ending(path), ".webm") == 0;
}

void cln_film_rate(double fps, int64_t *num, int64_t *den)
{
    static const int broadcast[] = {24, 30, 60, 120};
    double rest = fps;
    int64_t before[2] = {0, 1}; /* fractions of the continued one: the one before the last */

    for (size_t i = 0; i < sizeof broadcast / sizeof *broadcast; i++)
        if (fabs(1.001 * fps / broadcast[i] - 1) < 1.5e-6) {
            *num = 1000 * broadcast[i];
            *den = 1001;
            return;
        }
    *num = 1;
    *den = 0;
    for (int i = 0; i < 20; i++) {
        const int64_t whole = (int64_t)floor(rest), n = whole * *num + before[0],
                      d = whole * *den + before[1];

        before[0] = *num;
        before[1] = *den;
        *num = n;
        *den = d;
        if (fabs((double)n / (double)d - fps) <= 1e-9 * fps || rest - (double)whole < 1e-9)
            return;
        rest = 1 / (rest - (double)whole);
    }
}

bool cln_film_read_rate(const char *text, double *fps)
{
    const char *slash = strchr(text, '/');
    char first[32];
    double of = 1;

    snprintf(first, sizeof first, "%.*s", slash ? (int)(slash - text) : 31, text);
    return strlen(text) < sizeof first && cln_reals_read(first, 1, fps) &&
           (!slash || cln_reals_read(slash + 1, 1, &of)) && of > 0 &&
           (*fps /= of) >= CLN_FILM_LEAST_FPS && *fps <= 1000;
}

/* An empty file of our own beside the film, with its ending, by which ffmpeg takes the format. */
static cln_status make_part(cln_film *f)
{
    static atomic_uint counter;
    cln_status st = CLN_OK;
    const int stem = (int)(ending(f->path) - f->path);
    int fd = -1;

    for (int attempt = 0; attempt < 100 && fd < 0; attempt++) {
        free(f->part);
        f->part = NULL;
        CLN_TRY(cln_asprintf(&f->part, "%.*s.tmp.%ld.%u%s", stem, f->path, (long)getpid(),
                             atomic_fetch_add(&counter, 1), ending(f->path)));
        fd = open(f->part, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd < 0 && errno != EEXIST)
            break;
    }
    if (fd < 0) {
        st = cln_fail(CLN_OUTPUT, "%s: cannot create a file there: %s", f->path, strerror(errno));
        free(f->part); /* not ours, if it is there */
        f->part = NULL;
    }
done:
    if (fd >= 0)
        close(fd);
    return st;
}

/* Adds words up to a NULL. */
static int add_words(const char **argv, int n, const char *const *words)
{
    while (*words)
        argv[n++] = *words++;
    return n;
}

static cln_status start_ffmpeg(cln_film *f, double fps)
{
    static const char even[] = "scale=out_color_matrix=bt709:out_range=tv,format=";
    static const char *const tags[] = {
        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", NULL};
    static const char *const none[] = {NULL}, *const usual[] = {"-crf", "18", NULL};
    static const char *const web[] = {"-crf", "24", "-b:v", "0", NULL};
    static const char *const vp9[] = {"-c:v", "libvpx-vp9", NULL};
    static const char *const prores[] = {"-c:v", "prores_ks",   "-profile:v", "4444", "-vendor",
                                         "apl0", "-alpha_bits", "16",         NULL};
    cln_status st = CLN_OK;
    const bool gif = strcasecmp(ending(f->path), ".gif") == 0;
    const bool webm = strcasecmp(ending(f->path), ".webm") == 0, alpha = f->channels == 4;
    char size[32], rate[48], filter[160], *url = NULL;
    int64_t num = 0, den = 0;

    /* most players need even sides and subsampled colours */
    f->wide = f->width + (gif ? 0 : f->width % 2);
    f->high = f->height + (gif ? 0 : f->height % 2);
    if (f->wide > f->width || f->high > f->height)
        CLN_TRY(
            cln_alloc(&f->even, (size_t)f->wide * (size_t)f->high, (size_t)f->channels, "film"));
    if (f->even)
        cln_info("%s: %d x %d pixels, not %d x %d, as players need even sides", f->path, f->wide,
                 f->high, f->width, f->height);
    snprintf(size, sizeof size, "%dx%d", f->wide, f->high);
    cln_film_rate(fps, &num, &den);
    snprintf(rate, sizeof rate, "%" PRId64 "/%" PRId64, num, den);
    /* pictures have the tags, too: ProRes has those, and ffmpeg 9 drops the others */
    snprintf(filter, sizeof filter, "%s%s%s", gif ? "split[a][b];[a]palettegen[p];[b][p]" : even,
             gif      ? "paletteuse"
             : !alpha ? "yuv420p"
             : webm   ? "yuva420p"
                      : "yuva444p10le",
             gif ? "" : ",setparams=colorspace=bt709:color_primaries=bt709:color_trc=iec61966-2-1");
    CLN_TRY(make_part(f));
    CLN_TRY(cln_asprintf(&url, "file:%s", f->part)); /* "a:1.mp4" would be a protocol's */
    {
        const char *argv[48] = {
            "ffmpeg",  "-nostdin", "-y",       "-v",       "error",
            "-xerror", "-f",       "rawvideo", "-pix_fmt", alpha ? "rgba" : "rgb24",
            "-s",      size,       "-r",       rate,       "-i",
            "pipe:0",  "-vf",      filter};
        int n = 18;

        if (!gif) {
            n = add_words(argv, n, tags);
            n = add_words(argv, n, webm ? web : alpha ? prores : usual);
            n = add_words(argv, n, webm && alpha ? vp9 : none);
        }
        argv[n++] = url;
        CLN_TRY(cln_command_open(argv, &f->feed));
    }
done:
    free(url);
    return st;
}

static cln_status start_y4m(cln_film *f, double fps)
{
    cln_status st = CLN_OK;
    char head[128];
    int64_t num = 0, den = 0;
    int bytes = 0;

    cln_film_rate(fps, &num, &den);
    bytes = snprintf(head, sizeof head, "YUV4MPEG2 W%d H%d F%" PRId64 ":%" PRId64 " Ip A1:1 C444\n",
                     f->width, f->height, num, den);
    CLN_TRY(cln_alloc(&f->planes, (size_t)f->width * (size_t)f->height, 3, "film"));
    CLN_TRY(cln_atomic_open(f->path, &f->file));
    CLN_TRY(cln_atomic_write(f->file, head, (size_t)bytes));
done:
    return st;
}

const char *cln_film_path(const cln_film *f)
{
    return f->path;
}

bool cln_film_is_plain(const cln_film *f)
{
    return f->planes != NULL;
}

static cln_status check_alpha(const char *path)
{
    if (!cln_film_takes_alpha(path))
        return cln_fail(CLN_USAGE, CLN_FILM_NO_ALPHA, path);
    if (!cln_command_found("ffmpeg"))
        return cln_fail(CLN_FAILED,
                        "%s: a film with alpha needs ffmpeg, which is not installed (Debian: apt "
                        "install ffmpeg); without --transparent it is written, uncompressed",
                        path);
    return CLN_OK;
}

/* ffmpeg finds a .gif's palette by all of its frames, and keeps them until then. */
static cln_status check_gif(const char *path, const cln_film_form *form)
{
    const double bytes = 4.0 * form->width * form->height * form->frames;
    char need[32];

    if (strcasecmp(ending(path), ".gif") != 0)
        return CLN_OK;
    if (form->fps > CLN_FILM_GIF_FPS)
        return cln_fail(CLN_USAGE,
                        "%s: a GIF has at most %d frames a second (its delays are hundredths of a "
                        "second, and players slow the shortest down), not %g; give --fps %d or "
                        "less, or another kind of film",
                        path, CLN_FILM_GIF_FPS, form->fps, CLN_FILM_GIF_FPS);
    if (bytes < 0.5 * cln_available_memory(""))
        return CLN_OK;
    cln_format_bytes(bytes, need);
    return cln_fail(
        CLN_MEMORY,
        "%s: ffmpeg keeps all %d frames of a GIF in memory, %s, which is too much here; "
        "make a film of another kind (.mp4, .webm), or fewer or smaller frames",
        path, form->frames, need);
}

cln_status cln_film_begin(const char *path, const cln_film_form *form, cln_film **out)
{
    cln_status st = CLN_OK;
    cln_film *f = NULL;
    bool plain = strcasecmp(ending(path), ".y4m") == 0;

    *out = NULL;
    CLN_TRY(form->alpha ? check_alpha(path) : CLN_OK);
    CLN_TRY(check_gif(path, form));
    CLN_TRY(cln_alloc(&f, 1, sizeof *f, "film"));
    f->width = form->width;
    f->height = form->height;
    f->channels = form->alpha ? 4 : 3;
    if (!plain && !cln_command_found("ffmpeg")) {
        plain = true;
        CLN_TRY(cln_asprintf(&f->path, "%.*s.y4m", (int)(ending(path) - path), path));
        cln_warn("%s: ffmpeg is not installed (Debian: apt install ffmpeg), so the film is written "
                 "to %s, uncompressed",
                 path, f->path);
    } else {
        CLN_TRY(cln_strdup(&f->path, path));
    }
    CLN_TRY(cln_disk_check_new(f->path, form->overwrite));
    if (plain)
        CLN_TRY(start_y4m(f, form->fps));
    else
        CLN_TRY(start_ffmpeg(f, form->fps));
    *out = f;
    f = NULL;
done:
    cln_film_abandon(f);
    return st;
}

/* To YCbCr by BT.709, in 16..235 and 16..240. */
static void to_planes(const cln_film *f, const uint8_t *rgb)
{
    const size_t n = (size_t)f->width * (size_t)f->height;

    for (size_t i = 0; i < n; i++) {
        const double r = rgb[3 * i], g = rgb[3 * i + 1], b = rgb[3 * i + 2];
        const double y = 0.2126 * r + 0.7152 * g + 0.0722 * b;

        f->planes[i] = (uint8_t)lround(16 + 219 * y / 255);
        f->planes[n + i] = (uint8_t)lround(128 + 224 * (b - y) / (1.8556 * 255));
        f->planes[2 * n + i] = (uint8_t)lround(128 + 224 * (r - y) / (1.5748 * 255));
    }
}

/* Repeats the last column and row, as far as the sides are odd. */
static void make_even(cln_film *f, const uint8_t *pixels)
{
    const size_t each = (size_t)f->channels, row = each * (size_t)f->width,
                 whole = each * (size_t)f->wide;

    for (int y = 0; y < f->high; y++) {
        const uint8_t *from = pixels + (size_t)(y < f->height ? y : f->height - 1) * row;
        uint8_t *to = f->even + (size_t)y * whole;

        memcpy(to, from, row);
        if (whole > row)
            memcpy(to + row, from + row - each, each);
    }
}

/* Of a failure of ffmpeg: whether the disk was full decides about the code and the way out. */
static cln_status explain(const cln_film *f, cln_status st)
{
    char said[1024];

    if (st != CLN_FAILED ||
        (!strstr(cln_error_text(), "No space left on device") &&
         !strstr(cln_error_text(), "Disk quota exceeded") && cln_disk_room(f->part) >= 4096))
        return st;
    snprintf(said, sizeof said, "%s", cln_error_text());
    cln_clear_error();
    return cln_fail(CLN_OUTPUT,
                    "%s: no room is left on the disk for the film; make room, or choose another "
                    "folder (%s)",
                    f->path, said);
}

cln_status cln_film_add(cln_film *f, const uint8_t *pixels)
{
    cln_status st = CLN_OK;
    const size_t bytes = (size_t)f->width * (size_t)f->height * 3;

    if (f->even)
        make_even(f, pixels);
    if (f->feed)
        return explain(f,
                       cln_command_write(f->feed, f->even ? f->even : pixels,
                                         (size_t)f->channels * (size_t)f->wide * (size_t)f->high));
    to_planes(f, pixels);
    CLN_TRY(cln_atomic_write(f->file, "FRAME\n", 6));
    CLN_TRY(cln_atomic_write(f->file, f->planes, bytes));
done:
    return st;
}

cln_status cln_film_end(cln_film *f)
{
    cln_status st = CLN_OK;
    cln_command_feed *feed = f->feed;
    cln_atomic_file *file = f->file;

    f->feed = NULL;
    f->file = NULL;
    if (file)
        CLN_TRY(cln_atomic_commit(&file));
    if (feed)
        CLN_TRY(explain(f, cln_command_end(feed)));
    if (f->part && rename(f->part, f->path) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", f->path, strerror(errno)));
    free(f->part);
    f->part = NULL;
done:
    cln_film_abandon(f);
    return st;
}

void cln_film_abandon(cln_film *f)
{
    if (!f)
        return;
    cln_command_kill(f->feed);
    cln_atomic_abandon(f->file);
    if (f->part)
        (void)unlink(f->part);
    free(f->part);
    free(f->path);
    free(f->planes);
    free(f->even);
    free(f);
}
