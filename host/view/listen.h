/* The socket that a viewer listens on, the address to open in a browser, and the token. */
#ifndef CLN_LISTEN_H
#define CLN_LISTEN_H

#include "base/status.h"

enum { CLN_VIEW_PORT = 7007 };

typedef struct cln_listener {
    int socket; /* -1 = none */
    int port;
    bool far;          /* an address was given: requests need the token */
    bool loopback;     /* of this machine alone: others come by a proxy, all from one address */
    bool moved;        /* CLN_VIEW_PORT is taken, so that the port is another */
    char token[33];    /* "" without */
    char own[256];     /* this machine's name */
    char address[512]; /* to open, token included */
    char others[512];  /* the same by this machine's numbers, "; "-separated; "" for one address */
} cln_listener;

/* address: numeric, or NULL for 127.0.0.1 without a token; the token is that of the environment's
 * CL_NASCENT_TOKEN, or a new one. port 0: CLN_VIEW_PORT, or a free one if it is taken. CLN_USAGE:
 * no such address or token, or the port is taken. */
cln_status cln_listen_open(const char *address, int port, cln_listener *out);

/* Logs `others`, if there are any, and warns if the port is not the usual one. */
void cln_listen_say(const cln_listener *listener);

void cln_listen_close(cln_listener *listener); /* accepts one that is closed */

#endif
