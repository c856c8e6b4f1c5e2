/* `cl-nascent view`: a run in the browser. Prints the address and serves until a signal. */
#include "cli/commands.h"

#include <stdio.h>
#include "base/log.h"
#include "cli/browser.h"
#include "cli/console.h"

typedef struct shown {
    const cln_options *options;
    cln_console *console;
} shown;

static void show(const char *address, void *user)
{
    const shown *s = user;

    printf("%s\n", address);
    fflush(stdout);
    cln_info("open this address in a browser; Ctrl-C ends the viewer");
    if (s->options->open)
        cln_open_browser(address);
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
