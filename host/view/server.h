/* The HTTP server of a viewer, over libmicrohttpd: its thread takes requests and sends answers, the
 * caller's thread has the device and paints. A slow or vanished browser costs a connection, which
 * has a limit in time; a request is bounded in size, and its answer in memory.
 *
 *   GET /  /view.css  /view.js           the page, which is in the program
 *   GET /facts                           facts.h
 *   GET /picture?...  /photo?...  /point?...   request.h; pictures and points want a header
 *                                        X-Viewer: NAME, which no page of another site can send; a
 *                                        later picture of the same viewer cancels an earlier one */
#ifndef CLN_SERVER_H
#define CLN_SERVER_H

#include "view/listen.h"
#include "view/painter.h"

/* CLN_FAILED in a program that was built without libmicrohttpd: which package is missing. */
cln_status cln_serve_possible(void);

/* Serves until callbacks->interrupted returns SIGINT or SIGTERM (CLN_SIGINT, CLN_SIGTERM), or the
 * device fails. facts: JSON text. ready is called when requests are answered. */
cln_status cln_serve(const cln_listener *listener, cln_painter *painter, const char *facts,
                     const cln_callbacks *callbacks, void (*ready)(const char *address, void *user),
                     void *user);

#endif
