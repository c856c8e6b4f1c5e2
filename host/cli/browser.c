/* Opens an address by xdg-open. See browser.h. */
#include "cli/browser.h"

#include <errno.h>
#include <spawn.h>
#include <string.h>
#include <sys/wait.h>
#include "base/log.h"

extern char **environ;

/* Runs xdg-open in the background: without a desktop it becomes the browser itself. */
void cln_open_browser(const char *address)
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
