/* `cl-nascent view`: a run in the browser. Prints the address and serves until a signal, which is
 * its ordinary end: no error once a browser could open the address. */
#include "cli/commands.h"

#include <stdio.h>
#include "base/log.h"
#include "cli/browser.h"
#include "cli/console.h"
#include "render/up.h"

typedef struct shown {
    const cln_options *options;
    cln_console *console;
    bool served; /* a browser could open the address */
} shown;

static void show(const char *address, void *user)
{
    shown *s = user;

    s->served = true;
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
    shown s = {options, &console, false};
    cln_view_desc desc = {.run = options->operand,
                          .scene = options->scene,
                          .listen = options->listen,
                          .port = options->port,
                          .device = options->device,
                          .ready = show,
                          .callbacks = {.interrupted = interrupted, .user = &s}};
    cln_options quiet = *options;

    quiet.progress = "none";
    if (options->up)
        CLN_TRY(cln_up_read("--up", options->up, desc.up));
    CLN_TRY(cln_console_open(&quiet, &console));
    st = cln_view_run(&desc);
    if (s.served && (st == CLN_SIGINT || st == CLN_SIGTERM)) {
        cln_clear_error();
        cln_info("the viewer has ended");
        st = CLN_OK;
    }
done:
    cln_console_close(&console);
    return st;
}
