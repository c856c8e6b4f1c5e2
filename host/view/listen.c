/* Binding. See listen.h. */
#include "view/listen.h"

#include <arpa/inet.h>
#include <errno.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/log.h"
#include "view/request.h"

typedef union {
    struct sockaddr any;
    struct sockaddr_in v4;
    struct sockaddr_in6 v6;
} place;

static cln_status read_address(const char *text, place *out, socklen_t *bytes)
{
    memset(out, 0, sizeof *out);
    if (inet_pton(AF_INET, text, &out->v4.sin_addr) == 1) {
        out->v4.sin_family = AF_INET;
        *bytes = sizeof out->v4;
        return CLN_OK;
    }
    if (inet_pton(AF_INET6, text, &out->v6.sin6_addr) == 1) {
        out->v6.sin6_family = AF_INET6;
        *bytes = sizeof out->v6;
        return CLN_OK;
    }
    return cln_fail(CLN_USAGE,
                    "--listen: '%s' is not an IP address; give one in numbers, such as "
                    "192.168.1.5, or 0.0.0.0 for all addresses of this machine",
                    text);
}

static int try_bind(const place *at, socklen_t bytes, int port)
{
    place with_port = *at;
    const int yes = 1;
    int s = socket(at->any.sa_family, SOCK_STREAM | SOCK_CLOEXEC, 0);

    if (s < 0)
        return -1;
    (void)setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (at->any.sa_family == AF_INET)
        with_port.v4.sin_port = htons((uint16_t)port);
    else
        with_port.v6.sin6_port = htons((uint16_t)port);
    if (bind(s, &with_port.any, bytes) == 0 && listen(s, 64) == 0)
        return s;
    {
        const int reason = errno;

        close(s);
        errno = reason;
    }
    return -1;
}

static void put_address(const cln_listener *l, const char *host, char *out, size_t bytes)
{
    const bool v6 = strchr(host, ':') != NULL;

    snprintf(out, bytes, "http://%s%s%s:%d/%s%s", v6 ? "[" : "", host, v6 ? "]" : "", l->port,
             l->far ? "?token=" : "", l->token);
}

/* Lists the addresses by which other machines may reach this one, as they need not know its name:
 * IPv4 ones, the first few. Without any the list stays empty. */
static void list_others(cln_listener *out)
{
    struct ifaddrs *all = NULL;
    char host[INET_ADDRSTRLEN], line[160];

    if (getifaddrs(&all) != 0)
        return;
    for (const struct ifaddrs *at = all; at; at = at->ifa_next) {
        const size_t used = strlen(out->others);

        if (!at->ifa_addr || at->ifa_addr->sa_family != AF_INET || at->ifa_flags & IFF_LOOPBACK ||
            !(at->ifa_flags & IFF_UP) ||
            !inet_ntop(AF_INET, &((const place *)(const void *)at->ifa_addr)->v4.sin_addr, host,
                       sizeof host))
            continue;
        put_address(out, host, line, sizeof line);
        if (used + strlen(line) + 3 > sizeof out->others)
            break;
        snprintf(out->others + used, sizeof out->others - used, "%s%s", used ? "; " : "", line);
    }
    freeifaddrs(all);
}

/* A token that outlives a restart, as from a secret of a service; on a command line all could see
 * it. */
static cln_status choose_token(char out[33])
{
    const char *given = getenv("CL_NASCENT_TOKEN");

    if (!given || !*given)
        return cln_ask_make_token(out);
    if (strlen(given) != 32 || strspn(given, "0123456789abcdef") != 32)
        return cln_fail(CLN_USAGE,
                        "CL_NASCENT_TOKEN: not 32 hexadecimal digits (0 to 9, a to f); make one "
                        "with `openssl rand -hex 16`, or leave it unset for one of each start");
    memcpy(out, given, 33);
    return CLN_OK;
}

cln_status cln_listen_open(const char *address, int port, cln_listener *out)
{
    cln_status st = CLN_OK;
    const char *text = address ? address : "127.0.0.1";
    const char *shown = text;
    place at, bound;
    socklen_t bytes = 0, length = sizeof bound;

    memset(out, 0, sizeof *out);
    out->socket = -1;
    if (port < 0 || port > 65535)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "port %d does not exist; give 1 to 65535, or 0 for %d or "
                         "a free one",
                         port, CLN_VIEW_PORT));
    CLN_TRY(read_address(text, &at, &bytes));
    out->socket = try_bind(&at, bytes, port ? port : CLN_VIEW_PORT);
    if (out->socket < 0 && port == 0 && errno == EADDRINUSE) {
        out->socket = try_bind(&at, bytes, 0);
        out->moved = true;
    }
    if (out->socket < 0)
        CLN_TRY(cln_fail(CLN_USAGE, "cannot listen on %s port %d: %s; choose another with %s", text,
                         port ? port : CLN_VIEW_PORT, strerror(errno),
                         errno == EADDRINUSE || errno == EACCES ? "--port" : "--listen"));
    if (getsockname(out->socket, &bound.any, &length) != 0)
        CLN_TRY(cln_fail(CLN_FAILED, "the address of a socket: %s", strerror(errno)));
    out->port = ntohs(at.any.sa_family == AF_INET ? bound.v4.sin_port : bound.v6.sin6_port);
    if (gethostname(out->own, sizeof out->own - 1) != 0)
        out->own[0] = 0;
    out->far = address != NULL;
    out->loopback = at.any.sa_family == AF_INET
                        ? ntohl(at.v4.sin_addr.s_addr) >> 24 == 127
                        : memcmp(&at.v6.sin6_addr, &in6addr_loopback, sizeof in6addr_loopback) == 0;
    if (out->far)
        CLN_TRY(choose_token(out->token));
    if (strcmp(text, "0.0.0.0") == 0 || strcmp(text, "::") == 0) {
        shown = out->own[0] ? out->own : text;
        list_others(out);
    }
    put_address(out, shown, out->address, sizeof out->address);
done:
    if (st != CLN_OK)
        cln_listen_close(out);
    return st;
}

void cln_listen_say(const cln_listener *listener)
{
    if (listener->moved && listener->far)
        cln_warn("port %d is taken, by another program or another viewer: this one has port %d",
                 CLN_VIEW_PORT, listener->port);
    else if (listener->moved)
        cln_warn("port %d is taken, by another program or another viewer: this one has port %d; "
                 "from another machine: ssh -L %d:127.0.0.1:%d %s",
                 CLN_VIEW_PORT, listener->port, listener->port, listener->port,
                 *listener->own ? listener->own : "HOST");
    if (*listener->others)
        cln_info("where this machine's name is not known: %s", listener->others);
}

void cln_listen_close(cln_listener *listener)
{
    if (listener->socket >= 0)
        close(listener->socket);
    listener->socket = -1;
}
