/* See callbacks.h. */
#include "base/callbacks.h"

#include <signal.h>
#include "base/status.h"

void cln_show_work(const cln_callbacks *callbacks, const char *what, int done, int total)
{
    if (callbacks && callbacks->work && total > 0)
        callbacks->work(what, done, total, callbacks->user);
}

int cln_poll_signal(const cln_callbacks *callbacks)
{
    const int value =
        callbacks && callbacks->interrupted ? callbacks->interrupted(callbacks->user) : 0;

    return value && value != SIGTERM && value != SIGUSR1 ? SIGINT : value; /* 1: "yes" */
}

cln_status cln_stopped_by(int signal, const char *left)
{
    if (signal != SIGINT && signal != SIGTERM)
        return CLN_OK;
    return cln_fail(signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal%s%s",
                    left ? "; " : "", left ? left : "");
}

cln_status cln_tell_work(const cln_callbacks *callbacks, const char *what, int done, int total)
{
    cln_show_work(callbacks, what, done, total);
    return cln_stopped_by(cln_poll_signal(callbacks), NULL);
}
