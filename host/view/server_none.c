/* The server of a program that was built without libmicrohttpd: it refuses. See server.h. */
#include "view/server.h"

#ifndef CLN_WITH_MICROHTTPD

cln_status cln_serve_possible(void)
{
    return cln_fail(CLN_FAILED,
                    "this program was built without a viewer, as libmicrohttpd was not installed; "
                    "install the Debian package libmicrohttpd-dev and run make again");
}

cln_status cln_server_open(const cln_server_desc *desc, cln_server **out)
{
    (void)desc;
    *out = NULL;
    return cln_serve_possible();
}

cln_status cln_server_turn(cln_server *s, double wait, bool *painted)
{
    (void)s, (void)wait;
    *painted = false;
    return cln_serve_possible();
}

bool cln_server_asked(cln_server *s)
{
    (void)s;
    return false;
}

void cln_server_tell(cln_server *s, char *text)
{
    (void)s, (void)text;
}

unsigned cln_server_orders(cln_server *s)
{
    (void)s;
    return 0;
}

void cln_server_close(cln_server *s)
{
    (void)s;
}

#endif
