/* `cl-nascent view`: a run in the browser. Prints the address and serves until a signal. */
#include "cli/commands.h"

#include <errno.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include "base/log.h"
#include "cli/console.h"

extern char **environ;

typedef struct shown {
    const cln_options *options;
    cln_console *console;
} shown;

/* In the background: where there is no desktop, xdg-open is the browser itself. */
static void open_browser(const char *address)
{
    static const char script[] =
        "command -v xdg-open >/dev/null || exit 1; xdg-open \"$0\" >/dev/null 2>&1 &";
    char *const words[] = {"sh", "-c", (char *)script, (char *)address, NULL};
    pid_t child = 0;
    const int failed = posix_spawnp(&child, words[0], NULL, NULL, words, environ);
    int status = 0;

    if (failed == 0)
        while (waitpid(child, &status, 0) < 0 && errno == EINTR)
            ;
    if (failed != 0 || status != 0)
        cln_warn("no browser was opened (%s); open the address by hand",
                 failed ? strerror(failed)
                        : "xdg-open, of the Debian package xdg-utils, is "
                          "missing");
}

static void show(const char *address, void *user)
{
    const shown *s = user;

    printf("%s\n", address);
    fflush(stdout);
    cln_info("open this address in a browser; Ctrl-C ends the viewer");
    if (s->options->open)
        open_browser(address);
}

static int interrupted(void *user)
{
    const shown *s = user;

    return s->console->callbacks.interrupted(s->console->callbacks.user);
}

cln_status cln_cmd_view(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_console console = {0};
    shown s = {options, &console};
    const cln_view_desc desc = {.run = options->operand,
                                .scene = options->scene,
                                .listen = options->listen,
                                .port = options->port,
                                .device = options->device,
                                .ready = show,
                                .callbacks = {.interrupted = interrupted, .user = &s}};
    cln_options quiet = *options;

    quiet.progress = "none";
    CLN_TRY(cln_console_open(&quiet, &console));
    st = cln_view_run(&desc);
done:
    cln_console_close(&console);
    return st;
}
