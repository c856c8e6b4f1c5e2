/* See callbacks.h. */
#include "base/callbacks.h"

#include <signal.h>
#include "base/status.h"

cln_status cln_tell_work(const cln_callbacks *callbacks, const char *what, int done, int total)
{
    int wanted = 0;

    if (callbacks && callbacks->work && total > 0)
        callbacks->work(what, done, total, callbacks->user);
    if (callbacks && callbacks->interrupted)
        wanted = callbacks->interrupted(callbacks->user);
    if (wanted == SIGINT || wanted == SIGTERM)
        return cln_fail(wanted == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal");
    return CLN_OK;
}
