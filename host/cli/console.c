/* Signals, progress, results. See console.h. SIGPIPE is ignored while the program runs (main.c), so
 * that a training whose log goes to a closed pipe still writes its checkpoint. */
#include "cli/console.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "base/clock.h"
#include "base/log.h"
#include "base/text.h"
#include "device/cache.h"
#include "io/json.h"
#include "ranks/ranks.h"

/* A terminal that is closed sends SIGHUP, a soft limit of processor time SIGXCPU, Grid Engine
 * SIGUSR2 before it kills (-notify): all are obeyed as SIGTERM; nohup has SIGHUP ignored. */
static const int stop_signals[] = {SIGINT, SIGTERM, SIGHUP, SIGXCPU, SIGUSR2};

/* Written by handlers, read by the poll. */
static volatile sig_atomic_t stop_signal;
static volatile sig_atomic_t checkpoint_wanted;
/* When the command began: */
static bool hangup_ignored;
static struct sigaction quit; /* ends at once by default, with a core file */

/* Whoever stops a command may send its signal twice, to the program and to its group (timeout(1),
 * mpirun, a shell that passes Ctrl-C on): nobody asks twice within this time. */
static const double SAME_SIGNAL = 0.5; /* seconds */

static void on_stop(int number)
{
    static struct timespec first;
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    if (!stop_signal) {
        first = now;
        stop_signal = number;
    } else if ((double)(now.tv_sec - first.tv_sec) + 1e-9 * (double)(now.tv_nsec - first.tv_nsec) >
               SAME_SIGNAL) {
        signal(number, SIG_DFL);
        raise(number); /* delivered when this handler returns */
    }
}

static void on_checkpoint(int number)
{
    (void)number;
    checkpoint_wanted = 1;
}

static void handle(int number, void (*handler)(int))
{
    struct sigaction action = {0};

    action.sa_handler = number == SIGHUP && hangup_ignored ? SIG_IGN : handler;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(number, &action, NULL);
}

static void handle_all(void (*stop)(int), void (*checkpoint)(int))
{
    for (size_t i = 0; i < sizeof stop_signals / sizeof stop_signals[0]; i++)
        handle(stop_signals[i], stop);
    handle(SIGUSR1, checkpoint);
    sigaction(SIGQUIT, &quit, NULL);
}

/* ---- ends by a driver ---- */

static bool exit_watched;

static void tell_exit(void)
{
    static const char begin[] = "cl-nascent: ";
    char why[2048];

    if (!exit_watched || !cln_cache_last_words(why, sizeof why - 1))
        return;
    strcat(why, "\n");
    (void)!write(STDERR_FILENO, begin, sizeof begin - 1);
    (void)!write(STDERR_FILENO, why, strlen(why));
    _exit(cln_status_exit_code(CLN_OUTPUT));
}

static void on_abort(int number)
{
    (void)number;
    tell_exit();
}

void cln_exit_watch(bool on)
{
    static bool registered;

    if (!registered)
        atexit(tell_exit);
    registered = true;
    exit_watched = on;
    signal(SIGABRT, on ? on_abort : SIG_DFL);
}

/* ---- signals ---- */

static int poll_signals(void *user)
{
    cln_console *console = user;

    /* At each poll, because LLVM, which compiles the kernels inside PoCL, replaces our handlers
     * when it is first used, and its handlers for SIGUSR1, SIGXCPU and SIGQUIT do nothing. */
    handle_all(on_stop, on_checkpoint);
    cln_exit_watch(exit_watched);
    if (stop_signal) {
        if (!console->announced)
            cln_info("%s: stopping; a second signal, after half a second, stops at once",
                     stop_signal == SIGINT    ? "interrupted"
                     : stop_signal == SIGHUP  ? "hung up"
                     : stop_signal == SIGXCPU ? "out of processor time"
                                              : "terminated");
        console->announced = true;
        return stop_signal == SIGINT ? SIGINT : SIGTERM;
    }
    if (checkpoint_wanted) {
        checkpoint_wanted = 0;
        return SIGUSR1;
    }
    return 0;
}

/* ---- progress ---- */

void cln_train_line(const cln_train_progress *progress, char *out, size_t bytes)
{
    char step[32], steps[32], trained[32], left[32], rays[32], train[32], leaves[32];
    char params[32], memory[32], loss[32], later[32], test[48] = "", evals[64] = "";

    cln_format_count((double)progress->step, step);
    cln_format_count((double)progress->steps, steps);
    cln_format_duration(progress->seconds, trained);
    cln_format_duration(progress->eta, left);
    cln_format_short(progress->rays_per_s, rays);
    cln_format_real(progress->loss, 4, loss);
    cln_format_real(progress->psnr_train, 1, train);
    if (isfinite(progress->psnr_test))
        snprintf(test, sizeof test, ", %.1f test", progress->psnr_test);
    if (progress->unmeasured > 0) {
        cln_format_duration(progress->unmeasured_seconds, later);
        snprintf(evals, sizeof evals, " | evaluation%s ~%s more",
                 progress->unmeasured > 1 ? "s" : "", later);
    }
    cln_format_count(progress->leaves, leaves);
    cln_format_short(progress->params, params);
    cln_format_bytes(progress->device_bytes, memory);
    /* the most important fields first: a narrow terminal shows those that it has room for */
    snprintf(out, bytes,
             "train %.0f%% | PSNR %s train%s | %s left%s | %s trained | step %s%s%s | %s rays/s | "
             "loss %s | %s %s %s params | %s dev",
             floor(100 * progress->fraction), train, test, left, evals, trained, step,
             progress->steps > 0 ? "/" : "", progress->steps > 0 ? steps : "", rays, loss, leaves,
             cln_plural(progress->leaves, "leaf", "leaves"), params, memory);
}

static void show_train(const cln_train_progress *progress, void *user)
{
    cln_console *console = user;
    char line[512];

    if (!(progress->rays_per_s > 0))
        return;
    cln_train_line(progress, line, sizeof line);
    cln_progress_show(console->progress, progress->fraction, line);
}

/* Most scenes are read at once, and a line about it would only be noise before the work itself. */
#define QUIET_SECONDS 2.0

static void show_work(const char *what, int done, int total, void *user)
{
    cln_console *console = user;
    double fraction = total > 0 ? (double)done / total : 0;
    const double now = cln_now();
    char line[512], count[32], of[32], left[48] = "";

    if (!console->work || strcmp(console->work, what) != 0 || done < console->work_done) {
        console->work = what;
        console->work_began = now;
        console->work_first = done;
    }
    console->work_done = done;
    if (strcmp(what, "images") == 0 && now - console->work_began < QUIET_SECONDS)
        return;
    if (done > console->work_first && done < total) {
        const int counted = done - console->work_first;

        snprintf(left, sizeof left, " | ");
        cln_format_duration((now - console->work_began) / counted * (total - done), left + 3);
        strcat(left, " left");
    }
    cln_format_count(done, count);
    cln_format_count(total, of);
    if (total > 0)
        snprintf(line, sizeof line, "%s %s/%s %.0f%%%s", what, count, of, floor(100 * fraction),
                 left);
    else /* not known yet */
        snprintf(line, sizeof line, "%s", what);
    cln_progress_show(console->progress, fraction, line);
}

void cln_standard_hold(void)
{
    for (int number = STDIN_FILENO; number <= STDERR_FILENO; number++)
        if (fcntl(number, F_GETFD) < 0) /* open takes the lowest number that is free */
            (void)open("/dev/null", number == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

cln_status cln_console_open(const cln_options *options, cln_console *console)
{
    cln_status st = CLN_OK;
    struct sigaction before = {0};

    *console = (cln_console){0};
    CLN_TRY(cln_progress_open(options->progress, &console->progress));
    console->callbacks = (cln_callbacks){
        .train = show_train, .work = show_work, .interrupted = poll_signals, .user = console};
    if (cln_ranks_me() > 0) /* only rank 0 shows progress */
        console->callbacks = (cln_callbacks){.interrupted = poll_signals, .user = console};
    stop_signal = 0;
    checkpoint_wanted = 0;
    hangup_ignored = sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler == SIG_IGN;
    sigaction(SIGQUIT, NULL, &quit);
    handle_all(on_stop, on_checkpoint);
done:
    return st;
}

void cln_console_close(cln_console *console)
{
    if (!console->progress)
        return;
    cln_progress_close(console->progress);
    console->progress = NULL;
    handle_all(SIG_DFL, SIG_DFL);
}

/* ---- results ---- */

int cln_stdout_columns(int otherwise)
{
    enum { LEAST = 40 };
    const int has = cln_terminal_columns(STDOUT_FILENO, 0);

    return has == 0 ? otherwise : has > LEAST ? has : LEAST;
}

/* Prints so many bytes, which may quote a file. */
static void put_plain(const char *text, size_t bytes)
{
    for (size_t part = 0; bytes > 0; text += part, bytes -= part) {
        char piece[256];

        part = cln_utf8_whole(text, bytes < sizeof piece ? bytes : sizeof piece - 1);
        part = part ? part : 1; /* of no character */
        memcpy(piece, text, part);
        piece[part] = 0;
        cln_text_plain(piece);
        fputs(piece, stdout);
    }
}

/* Characters of the first `bytes` bytes. */
static int characters(const char *text, size_t bytes)
{
    int count = 0;

    for (size_t i = 0; i < bytes; i++)
        count += ((unsigned char)text[i] & 0xc0) != 0x80; /* not a byte that goes on */
    return count;
}

void cln_print_wrapped(int column, int indent, int columns, const char *text)
{
    bool first = true;

    while (*text) {
        const size_t space = strspn(text, " "), word = strcspn(text + space, " ");
        const int wide = characters(text + space, word);

        if (!first && wide > 0 && column + (int)space + wide > columns && column > indent) {
            printf("\n%*s", indent, "");
            put_plain(text + space, word);
            column = indent + wide;
        } else {
            put_plain(text, space + word);
            column += (int)space + wide;
        }
        text += space + word;
        first = false;
    }
    putchar('\n');
}

int cln_name_width(const char *name)
{
    return characters(name, strlen(name));
}

void cln_print_name(const char *name, int width)
{
    const int own = cln_name_width(name);

    put_plain(name, strlen(name));
    printf("%*s", width > own ? width - own : 0, "");
}

static cln_warned warned;

void cln_warnings_keep(void)
{
    cln_warned_open(&warned);
}

cln_status cln_print_json(json_t *document)
{
    char *text = NULL;

    if (document && !json_object_get(document, "warnings")) /* of a run: its training's */
        cln_json_add_warned(document, &warned);
    text = document ? json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(17)) : NULL;

    json_decref(document);
    if (!text)
        return cln_fail(CLN_MEMORY,
                        "results: cannot be put into JSON (out of memory or not UTF-8)");
    puts(text);
    free(text);
    return CLN_OK;
}

void cln_format_real(double value, int decimals, char out[32])
{
    if (isfinite(value) && fabs(value) < 1e15)
        snprintf(out, 32, "%.*f", decimals, value);
    else
        snprintf(out, 32, "-");
}

static cln_status fail_stdout(int reason)
{
    if (reason == EPIPE) {
        signal(SIGPIPE, SIG_DFL);
        raise(SIGPIPE);
    }
    return cln_fail(CLN_OUTPUT, "standard output: %s", reason ? strerror(reason) : "write error");
}

cln_status cln_flush_stdout(void)
{
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout))
        return CLN_OK;
    return fail_stdout(errno);
}

cln_status cln_write_stdout(const void *data, size_t bytes)
{
    errno = 0;
    if (fwrite(data, 1, bytes, stdout) == bytes)
        return cln_flush_stdout();
    return fail_stdout(errno);
}
