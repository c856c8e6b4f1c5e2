/* Films. See film.h. Colours become YCbCr by BT.709, in its narrow range. Files by ffmpeg declare
 * that; y4m has no field for it. */
#include "io/film.h"

#include <errno.h>
#include <fcntl.h>
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

struct cln_film {
    int width, height;
    char *path, *part; /* part: where ffmpeg writes; NULL for y4m */
    cln_command_feed *feed;
    cln_atomic_file *file;
    uint8_t *planes; /* y4m: [3][height][width] */
    int wide, high;  /* of the pictures that ffmpeg gets */
    uint8_t *even;   /* [high][wide][3], where those are larger */
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

static cln_status start_ffmpeg(cln_film *f, double fps)
{
    static const char even[] = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";
    static const char palette[] = "split[a][b];[a]palettegen[p];[b][p]paletteuse";
    cln_status st = CLN_OK;
    const bool gif = strcasecmp(ending(f->path), ".gif") == 0;
    const bool webm = strcasecmp(ending(f->path), ".webm") == 0;
    char size[32], rate[32], *url = NULL;

    /* most players need even sides and subsampled colours */
    f->wide = f->width + (gif ? 0 : f->width % 2);
    f->high = f->height + (gif ? 0 : f->height % 2);
    if (f->wide > f->width || f->high > f->height)
        CLN_TRY(cln_alloc(&f->even, (size_t)f->wide * (size_t)f->high, 3, "film"));
    snprintf(size, sizeof size, "%dx%d", f->wide, f->high);
    cln_format(rate, sizeof rate, "%.6f", fps);
    CLN_TRY(make_part(f));
    CLN_TRY(cln_asprintf(&url, "file:%s", f->part)); /* "a:1.mp4" would be a protocol's */
    {
        const char *argv[40] = {
            "ffmpeg", "-nostdin", "-y",       "-v",     "error", "-xerror",
            "-f",     "rawvideo", "-pix_fmt", "rgb24",  "-s",    size,
            "-r",     rate,       "-i",       "pipe:0", "-vf",   gif ? palette : even};
        int n = 18;

        if (!gif) {
            static const char *const about[] = {"-colorspace", "bt709",      "-color_primaries",
                                                "bt709",       "-color_trc", "iec61966-2-1",
                                                "-crf"};

            for (size_t i = 0; i < sizeof about / sizeof *about; i++)
                argv[n++] = about[i];
            argv[n++] = webm ? "24" : "18";
        }
        if (webm) {
            argv[n++] = "-b:v";
            argv[n++] = "0";
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
    const int bytes = snprintf(head, sizeof head, "YUV4MPEG2 W%d H%d F%ld:1000 Ip A1:1 C444\n",
                               f->width, f->height, lround(1000 * fps));

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

cln_status cln_film_begin(const char *path, int width, int height, double fps, bool overwrite,
                          cln_film **out)
{
    cln_status st = CLN_OK;
    cln_film *f = NULL;
    bool plain = strcasecmp(ending(path), ".y4m") == 0;

    *out = NULL;
    CLN_TRY(cln_alloc(&f, 1, sizeof *f, "film"));
    f->width = width;
    f->height = height;
    if (!plain && !cln_command_found("ffmpeg")) {
        plain = true;
        CLN_TRY(cln_asprintf(&f->path, "%.*s.y4m", (int)(ending(path) - path), path));
        cln_warn("%s: ffmpeg is not installed (Debian: apt install ffmpeg), so the film is written "
                 "to %s, uncompressed",
                 path, f->path);
    } else {
        CLN_TRY(cln_strdup(&f->path, path));
    }
    CLN_TRY(cln_disk_check_new(f->path, overwrite));
    if (plain)
        CLN_TRY(start_y4m(f, fps));
    else
        CLN_TRY(start_ffmpeg(f, fps));
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
static void make_even(cln_film *f, const uint8_t *rgb)
{
    const size_t row = 3 * (size_t)f->width, whole = 3 * (size_t)f->wide;

    for (int y = 0; y < f->high; y++) {
        const uint8_t *from = rgb + (size_t)(y < f->height ? y : f->height - 1) * row;
        uint8_t *to = f->even + (size_t)y * whole;

        memcpy(to, from, row);
        if (whole > row)
            memcpy(to + row, from + row - 3, 3);
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

cln_status cln_film_add(cln_film *f, const uint8_t *rgb)
{
    cln_status st = CLN_OK;
    const size_t bytes = (size_t)f->width * (size_t)f->height * 3;

    if (f->even)
        make_even(f, rgb);
    if (f->feed)
        return explain(f, cln_command_write(f->feed, f->even ? f->even : rgb,
                                            3 * (size_t)f->wide * (size_t)f->high));
    to_planes(f, rgb);
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
