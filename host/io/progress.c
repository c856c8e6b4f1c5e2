/* The progress line, and figures as people read them. See progress.h. Only stderr is written; once
 * open, nothing here blocks or fails. */
#include "io/progress.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"

enum { TEXT_BYTES = 512 };
enum { MODE_BAR, MODE_LINE, MODE_NONE };

static const double bar_seconds = 0.1;          /* between redraws of a bar */
static const double line_seconds = 10;          /* between plain lines, at least */
static const double line_fraction = 0.01;       /* progress between plain lines, at least ... */
static const double line_patience_seconds = 60; /* ... unless it has been this long */

struct cln_progress {
    int mode;
    bool shown;      /* something has been written */
    double shown_at; /* monotonic seconds of the last write */
    double shown_fraction;
    bool stale; /* text is newer than what was written */
    char text[TEXT_BYTES];
};

int cln_terminal_columns(int stream, int otherwise)
{
    struct winsize size = {0};

    return ioctl(stream, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : otherwise;
}

/* How many bytes of a text fit: whole fields (" | " separates them), as half a number is another
 * number; of the first field, as much as fits. */
static int shown_bytes(const char *text, int columns)
{
    int fits = 0;

    if ((int)strlen(text) <= columns)
        return (int)strlen(text);
    for (const char *end = strstr(text, " | "); end; end = strstr(end + 1, " | "))
        if (end - text <= columns)
            fits = (int)(end - text);
    return fits ? fits : columns;
}

static void write_out(cln_progress *progress)
{
    if (progress->mode == MODE_BAR)
        fprintf(stderr, "\r%.*s\033[K",
                /* a line of full width wraps, and "\r" cannot take it back */
                shown_bytes(progress->text, cln_terminal_columns(STDERR_FILENO, 80) - 1),
                progress->text);
    else
        fprintf(stderr, "%s\n", progress->text);
    fflush(stderr);
    progress->stale = false;
    progress->shown = true;
}

static void log_line(cln_log_level level, const char *line, void *user)
{
    cln_progress *progress = user;

    if (progress->mode == MODE_BAR && progress->shown)
        fputs("\r\033[K", stderr);
    cln_log_stderr(level, line, NULL);
    if (progress->mode == MODE_BAR && progress->shown)
        write_out(progress);
}

cln_status cln_progress_open(const char *mode, cln_progress **out)
{
    cln_status st = CLN_OK;
    cln_progress *progress = NULL;

    *out = NULL;
    CLN_TRY(cln_alloc(&progress, 1, sizeof *progress, "progress line"));
    if (strcmp(mode, "auto") == 0)
        progress->mode = isatty(STDERR_FILENO) ? MODE_BAR : MODE_LINE;
    else if (strcmp(mode, "bar") == 0)
        progress->mode = MODE_BAR;
    else if (strcmp(mode, "line") == 0)
        progress->mode = MODE_LINE;
    else if (strcmp(mode, "none") == 0)
        progress->mode = MODE_NONE;
    else
        CLN_TRY(cln_fail(CLN_USAGE, "--progress: '%s' is not one of auto|bar|line|none", mode));
    cln_log_set_sink(log_line, progress);
    *out = progress;
    progress = NULL;
done:
    free(progress);
    return st;
}

void cln_progress_show(cln_progress *progress, double fraction, const char *text)
{
    double now = cln_now();
    double waited = now - progress->shown_at;
    /* other work begins with another word */
    const bool other = strncmp(progress->text, text, strcspn(text, " ") + 1) != 0;
    bool due = !progress->shown;

    if (progress->mode == MODE_NONE)
        return;
    snprintf(progress->text, sizeof progress->text, "%s", text);
    progress->stale = true;
    if (progress->mode == MODE_BAR)
        due = due || waited >= bar_seconds || fraction < progress->shown_fraction || other;
    else
        due = due ||
              (waited >= line_seconds && (fraction >= progress->shown_fraction + line_fraction ||
                                          fraction < progress->shown_fraction || /* other work */
                                          waited >= line_patience_seconds));
    if (!due)
        return;
    write_out(progress);
    progress->shown_at = now;
    progress->shown_fraction = fraction;
}

void cln_progress_close(cln_progress *progress)
{
    if (!progress)
        return;
    if (progress->stale)
        write_out(progress);
    if (progress->mode == MODE_BAR && progress->shown)
        fputc('\n', stderr);
    cln_log_set_sink(cln_log_stderr, NULL);
    free(progress);
}

void cln_format_duration(double seconds, char out[32])
{
    long long whole = 0;

    if (!isfinite(seconds) || seconds < 0 || seconds > 1e12) {
        snprintf(out, 32, "--:--");
        return;
    }
    whole = (long long)(seconds + 0.5);
    if (whole < 3600)
        snprintf(out, 32, "%02lld:%02lld", whole / 60, whole % 60);
    else
        snprintf(out, 32, "%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
}

void cln_format_bytes(double bytes, char out[32])
{
    static const char *const unit[] = {"B", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"};
    int i = 0;

    if (!isfinite(bytes) || bytes < 0) {
        snprintf(out, 32, "?");
        return;
    }
    while (bytes >= 1023.5 && i < 6) {
        bytes /= 1024;
        i++;
    }
    snprintf(out, 32, "%.*f %s", i > 0 && bytes < 99.95 ? 1 : 0, bytes, unit[i]);
}

void cln_format_count(double count, char out[32])
{
    char digits[32];
    int length = 0, used = 0;

    if (!isfinite(count) || fabs(count) > 1e15) {
        snprintf(out, 32, "?");
        return;
    }
    length = snprintf(digits, sizeof digits, "%.0f", fabs(count));
    if (count <= -0.5)
        out[used++] = '-';
    for (int i = 0; i < length; i++) {
        if (i > 0 && (length - i) % 3 == 0)
            out[used++] = ',';
        out[used++] = digits[i];
    }
    out[used] = 0;
}

void cln_format_short(double value, char out[32])
{
    static const char *const unit[] = {"", " k", " M", " G", " T"};
    char digits[24];
    int i = 0;

    if (!isfinite(value) || value < 0 || value > 1e17) {
        snprintf(out, 32, "?");
        return;
    }
    while (value >= 999.5 && i < 4) {
        value /= 1000;
        i++;
    }
    if (i == 0 || value >= 99.5)
        snprintf(digits, sizeof digits, "%.0f", value);
    else
        snprintf(digits, sizeof digits, "%.1f", value);
    snprintf(out, 32, "%s%s", digits, unit[i]);
}
