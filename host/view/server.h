/* The HTTP server of a viewer, over libmicrohttpd: its thread takes requests and sends answers, the
 * caller's thread has the device and paints. A slow or vanished browser costs a connection, which
 * has a limit in time; a request is bounded in size, and its answer in memory.
 *
 *   GET /  /view.css  /view.js  /path.js  /crop.js  /training.js
 *                                        the page, which is in the program
 *   GET /facts                           facts.h
 *   GET /picture?...  /photo?...  /point?...   request.h; pictures and points need a header
 *                                        X-Viewer: NAME, which no page of another site can send; a
 *                                        later picture of the same viewer cancels an earlier one
 *   POST /film/begin?...  /film/frame?...  /film/end?...  /film/drop?...
 *                                        a film (reel.h), frame by frame as the page asks for them;
 *                                        with X-Viewer. If a frame's client vanishes, the film ends
 *   GET /film?film=NAME                  the whole film
 *   GET /newest                          {"newer": null}, or the step of the model that the run has
 *                                        by now
 *   GET /healthz                         "ok": of anybody, without Host or token
 * Every answer names its server, X-Server: ID. A request that names another one, in that header or
 * by server=ID, gets 410: a page that outlives its viewer mixes no two runs, and does not order
 * about the next training.
 * For a training, instead of /newest:
 *   GET /training                        its progress (train/watch.h)
 *   POST /pause /continue /save /stop    orders; with X-Viewer, too */
#ifndef CLN_SERVER_H
#define CLN_SERVER_H

#include "view/listen.h"
#include "view/painter.h"

/* CLN_FAILED, with the missing package, in a program that was built without libmicrohttpd. */
cln_status cln_serve_possible(void);

/* All that it points to is the caller's and lives as long as the server. */
typedef struct cln_server_desc {
    const cln_listener *listener;
    cln_painter *painter;
    const char *facts; /* JSON text */
    bool training;     /* answers /training and takes orders, too */
} cln_server_desc;

typedef struct cln_server cln_server;

/* Requests are answered from here on; those for the painter wait for turns. CLN_FAILED,
 * CLN_MEMORY. */
cln_status cln_server_open(const cln_server_desc *desc, cln_server **out);

/* Paints a piece of what was asked for: a small picture, a photo, a point, or a batch of a large
 * picture. Waits up to `wait` seconds (below 1) for a request; *painted: there was one. On the
 * thread that has the device, whose errors it returns: CLN_CL, CLN_BUILD, CLN_INTERNAL. */
cln_status cln_server_turn(cln_server *s, double wait, bool *painted);

/* Whether a turn would find something. The same thread. */
bool cln_server_asked(cln_server *s);

/* tell: sets the JSON text that GET /newest or /training answers from now on, and takes it over.
 * orders: a training's since the last call, never both pause and continue. Any thread. */
enum {
    CLN_ORDER_PAUSE = 1,
    CLN_ORDER_CONTINUE = 2,
    CLN_ORDER_SAVE = 4, /* a checkpoint */
    CLN_ORDER_STOP = 8
};
void cln_server_tell(cln_server *s, char *text);
unsigned cln_server_orders(cln_server *s);

/* Ends the requests that wait. Accepts NULL. */
void cln_server_close(cln_server *s);

#endif
