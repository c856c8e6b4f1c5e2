/* Connections, answers, and the queue between them and the painter. See server.h;
 * without libmicrohttpd, server_none.c. */
#include "view/server.h"

#ifdef CLN_WITH_MICROHTTPD

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <microhttpd.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "view/pages.h"

enum {
    CONNECTIONS = 64,
    ONCE = 4,                 /* headers that a request has once, if at all */
    OF_ADDRESS = 32,          /* of these, from one address: browsers have 6 each; but by a proxy */
    HEADER_BYTES = 32 * 1024, /* of a connection, for a request's line and headers */
    HEAD_SECONDS = 10,        /* from connecting to the end of the first request's headers */
    SEND_SECONDS = 60,        /* for an answer, and from there to the next request */
    SEND_RATE = 50 * 1000,    /* bytes a second of a slow line: what a long answer has beside it */
    FILM_SECONDS = 3600       /* for a film */
};
static const double SMALL_SECONDS =
    0.5; /* a picture that may take at most this long is painted whole */
static const double TEND_SECONDS = 0.1; /* how often late and vanished connections are looked for */
static const double GAP_SECONDS = 1; /* most between turns; in the rest nothing could be painted */

/* A connection, for its limit in time. MHD's own counts from the last byte, which a slow client can
 * send for ever. */
typedef struct client {
    bool used;
    int socket;
    double deadline; /* monotonic seconds; 0 = none, its answer is being made */
} client;

/* A request, and what the painter makes for it. */
typedef struct request {
    bool waited; /* the painter had it */
    cln_painting painting;
    char viewer[CLN_VIEWER_BYTES];
    bool cancelled;
    struct MHD_Connection *connection;
    int socket;
    struct request *next;
} request;

#define SCRIPT "text/javascript; charset=utf-8"
static const struct {
    const char *path, *type;
    const char *const *lines;
} pages[] = {{"/", "text/html; charset=utf-8", cln_page_html},
             {"/view.css", "text/css; charset=utf-8", cln_page_css},
             {"/view.js", SCRIPT, cln_page_js},
             {"/path.js", SCRIPT, cln_path_js},
             {"/crop.js", SCRIPT, cln_crop_js},
             {"/training.js", SCRIPT, cln_training_js}};
enum { PAGES = sizeof pages / sizeof *pages };

struct cln_server {
    const cln_listener *listener;
    cln_painter *painter;
    const char *facts;
    bool training;
    char *pages[PAGES]; /* their texts */
    char cookie[32];    /* its name, which no other server of the same host name has */
    char id[17];        /* of this server, among those that the port had and will have; random */
    struct MHD_Daemon *daemon;
    double tended_at;     /* the painting thread's, as the next one */
    bool small_before;    /* the piece painted before was a small request */
    bool photo_before;    /* the small request before was a photo */
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t came;
    bool closing;
    client clients[CONNECTIONS];
    request *waiting; /* in order of arrival */
    request *at_work; /* the painting that waits for small ones between its batches, or NULL */
    char *told;       /* what /training or /newest answers; NULL = nothing yet */
    unsigned orders;  /* CLN_ORDER_*, not yet taken */
};

static const char policy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'";

cln_status cln_serve_possible(void)
{
    return CLN_OK;
}

/* ---- connections ---- */

static void set_deadline(cln_server *s, struct MHD_Connection *connection, double seconds)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    client *c = info ? info->socket_context : NULL;

    if (!c)
        return;
    pthread_mutex_lock(&s->lock);
    c->deadline = seconds > 0 ? cln_now() + seconds : 0;
    pthread_mutex_unlock(&s->lock);
}

static void on_connection(void *user, struct MHD_Connection *connection, void **context,
                          enum MHD_ConnectionNotificationCode code)
{
    cln_server *s = user;
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    client *c = *context;

    pthread_mutex_lock(&s->lock);
    if (code == MHD_CONNECTION_NOTIFY_CLOSED && c)
        c->used = false;
    for (int i = 0; code == MHD_CONNECTION_NOTIFY_STARTED && info && i < CONNECTIONS; i++) {
        if (s->clients[i].used)
            continue;
        s->clients[i] = (client){
            .used = true, .socket = info->connect_fd, .deadline = cln_now() + HEAD_SECONDS};
        *context = &s->clients[i];
        break;
    }
    pthread_mutex_unlock(&s->lock);
}

/* MHD sees the end of the stream and closes it. */
static void end_late(cln_server *s)
{
    const double now = cln_now();

    pthread_mutex_lock(&s->lock);
    for (int i = 0; i < CONNECTIONS; i++) {
        client *c = &s->clients[i];

        if (c->used && c->deadline > 0 && now > c->deadline) {
            shutdown(c->socket, SHUT_RDWR);
            c->deadline = 0;
        }
    }
    pthread_mutex_unlock(&s->lock);
}

static bool is_gone(const request *r)
{
    char byte;
    const ssize_t got = recv(r->socket, &byte, 1, MSG_PEEK | MSG_DONTWAIT);

    return got == 0 || (got < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
}

/* ---- answers ---- */

/* Takes the response, whose body has this many bytes. */
static enum MHD_Result send_response(cln_server *s, struct MHD_Connection *connection, int status,
                                     const char *type, size_t bytes, struct MHD_Response *response)
{
    enum MHD_Result sent;

    if (!response)
        return MHD_NO;
    MHD_add_response_header(response, "Content-Type", type);
    MHD_add_response_header(response, "Content-Security-Policy", policy);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    MHD_add_response_header(response, "Referrer-Policy", "no-referrer");
    MHD_add_response_header(response, "Cross-Origin-Resource-Policy", "same-origin");
    MHD_add_response_header(response, "Cache-Control", "no-store");
    MHD_add_response_header(response, "X-Server", s->id);
    set_deadline(s, connection, SEND_SECONDS + (double)bytes / SEND_RATE);
    sent = MHD_queue_response(connection, (unsigned)status, response);
    MHD_destroy_response(response);
    return sent;
}

/* text lives as long as the server. */
static enum MHD_Result send_text(cln_server *s, struct MHD_Connection *connection, const char *type,
                                 const char *text)
{
    return send_response(
        s, connection, 200, type, strlen(text),
        MHD_create_response_from_buffer(strlen(text), (void *)text, MHD_RESPMEM_PERSISTENT));
}

/* allow: the methods that would do (405), or NULL. A sentence ends its connection, whose place
 * another may need: who has no token could else hold them all. */
static enum MHD_Result answer_with(cln_server *s, struct MHD_Connection *connection, int status,
                                   const char *sentence, const char *allow)
{
    char text[512];
    struct MHD_Response *response;

    snprintf(text, sizeof text, "%s\n", sentence);
    response = MHD_create_response_from_buffer(strlen(text), text, MHD_RESPMEM_MUST_COPY);
    if (response && allow)
        MHD_add_response_header(response, "Allow", allow);
    if (response)
        MHD_add_response_header(response, "Connection", "close");
    return send_response(s, connection, status, "text/plain; charset=utf-8", strlen(text),
                         response);
}

static enum MHD_Result answer(cln_server *s, struct MHD_Connection *connection, int status,
                              const char *sentence)
{
    return answer_with(s, connection, status, sentence, NULL);
}

static enum MHD_Result send_painting(cln_server *s, struct MHD_Connection *connection, request *r)
{
    cln_painting *g = &r->painting;
    struct MHD_Response *response =
        g->is_file ? MHD_create_response_from_fd64(g->bytes, g->file)
                   : MHD_create_response_from_buffer(g->bytes, g->body, MHD_RESPMEM_MUST_FREE);
    enum MHD_Result sent;
    char about[128];

    if (!response)
        return MHD_NO;
    g->body = NULL; /* the response's, and so is the file */
    if (g->is_file) {
        g->is_file = false;
        snprintf(about, sizeof about, "attachment; filename=\"%s\"", g->file_name);
        MHD_add_response_header(response, "Content-Disposition", about);
        sent = send_response(s, connection, g->status, g->type, g->bytes, response);
        set_deadline(s, connection, FILM_SECONDS);
        return sent;
    }
    cln_format(about, sizeof about, "%d %d %.2f %.6g %.6g %d", g->width, g->height,
               1e3 * g->seconds, g->near, g->far, g->finer);
    if (g->width > 0)
        MHD_add_response_header(response, "X-Picture", about);
    return send_response(s, connection, g->status, g->type, g->bytes, response);
}

/* ---- requests ---- */

static const char *header_of(struct MHD_Connection *connection, const char *name)
{
    return MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
}

static const char *query_value(void *connection, const char *name)
{
    return MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, name);
}

static bool is_viewer(const char *name)
{
    return name && *name && strlen(name) < CLN_VIEWER_BYTES &&
           name[strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789-")] == 0;
}

/* Puts a request to the painter; an earlier picture of the same viewer is no longer wanted. */
static enum MHD_Result put(cln_server *s, struct MHD_Connection *connection, request *r)
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    request **last = &s->waiting;
    bool taken = false;

    r->connection = connection;
    r->socket = info ? info->connect_fd : -1;
    set_deadline(s, connection, 0);
    pthread_mutex_lock(&s->lock);
    if (!s->closing) {
        taken = r->waited = true;
        MHD_suspend_connection(connection);
        for (; *last; last = &(*last)->next)
            if (r->viewer[0] && strcmp((*last)->viewer, r->viewer) == 0)
                (*last)->cancelled = true;
        if (s->at_work && r->viewer[0] && strcmp(s->at_work->viewer, r->viewer) == 0)
            s->at_work->cancelled = true;
        *last = r;
        pthread_cond_signal(&s->came);
    }
    pthread_mutex_unlock(&s->lock);
    return taken ? MHD_YES : answer(s, connection, 503, "the viewer has ended");
}

static enum MHD_Result ask(cln_server *s, struct MHD_Connection *connection, cln_ask_kind kind,
                           request *r)
{
    const char *viewer = header_of(connection, "X-Viewer");
    const cln_painter *painter = s->painter;
    enum MHD_Result refused;

    if (kind != CLN_ASK_PHOTO && kind != CLN_ASK_FILM_FILE && !is_viewer(viewer))
        return answer(s, connection, 403, "the request needs a header X-Viewer with a name");
    if (cln_ask_read(kind, painter->scene, painter->model->background, query_value, connection,
                     &r->painting.ask) == CLN_OK) {
        if (kind == CLN_ASK_PICTURE)
            snprintf(r->viewer, sizeof r->viewer, "%s", viewer);
        return put(s, connection, r);
    }
    refused = answer(s, connection, 400, cln_error_text());
    cln_clear_error();
    return refused;
}

static enum MHD_Result send_told(cln_server *s, struct MHD_Connection *connection)
{
    struct MHD_Response *response = NULL;
    size_t bytes = 0;

    pthread_mutex_lock(&s->lock);
    if (s->told) {
        bytes = strlen(s->told);
        response = MHD_create_response_from_buffer(bytes, s->told, MHD_RESPMEM_MUST_COPY);
    }
    pthread_mutex_unlock(&s->lock);
    if (!response)
        return answer(s, connection, 503, "nothing is known yet");
    return send_response(s, connection, 200, "application/json", bytes, response);
}

static unsigned order_of(const cln_server *s, const char *path)
{
    static const struct {
        const char *path;
        unsigned order;
    } orders[] = {{"/pause", CLN_ORDER_PAUSE},
                  {"/continue", CLN_ORDER_CONTINUE},
                  {"/save", CLN_ORDER_SAVE},
                  {"/stop", CLN_ORDER_STOP}};

    for (size_t i = 0; s->training && i < sizeof orders / sizeof *orders; i++)
        if (strcmp(path, orders[i].path) == 0)
            return orders[i].order;
    return 0;
}

static enum MHD_Result take_order(cln_server *s, struct MHD_Connection *connection, unsigned order)
{
    const unsigned both = CLN_ORDER_PAUSE | CLN_ORDER_CONTINUE;

    if (!is_viewer(header_of(connection, "X-Viewer")))
        return answer(s, connection, 403, "the request needs a header X-Viewer with a name");
    pthread_mutex_lock(&s->lock);
    s->orders = (order & both ? s->orders & ~both : s->orders) | order;
    pthread_cond_signal(&s->came);
    pthread_mutex_unlock(&s->lock);
    return answer(s, connection, 202, "it will be done");
}

/* With a token in the address the browser gets it as a cookie, and the address without it: it is
 * then neither in the history nor on the screen. Without Path, the cookie is for the folder that
 * the browser opened, which a proxy may have put before ours. Lax: a link on another site may lead
 * here; what changes something is asked for by POST, which has no such cookie from there. */
static enum MHD_Result let_in(cln_server *s, struct MHD_Connection *connection)
{
    struct MHD_Response *response =
        MHD_create_response_from_buffer(0, (void *)"", MHD_RESPMEM_PERSISTENT);
    char text[128];

    if (!response)
        return MHD_NO;
    snprintf(text, sizeof text, "%s=%s; HttpOnly; SameSite=Lax", s->cookie, s->listener->token);
    MHD_add_response_header(response, "Set-Cookie", text);
    MHD_add_response_header(response, "Location", "./");
    return send_response(s, connection, 303, "text/plain", 0, response);
}

static const struct {
    const char *path;
    cln_ask_kind kind;
    bool post; /* it changes something */
} asks[] = {
    {"/picture", CLN_ASK_PICTURE, false},      {"/photo", CLN_ASK_PHOTO, false},
    {"/point", CLN_ASK_POINT, false},          {"/film", CLN_ASK_FILM_FILE, false},
    {"/film/begin", CLN_ASK_FILM_BEGIN, true}, {"/film/frame", CLN_ASK_FILM_FRAME, true},
    {"/film/end", CLN_ASK_FILM_END, true},     {"/film/drop", CLN_ASK_FILM_DROP, true},
};

/* GET, or HEAD, of which libmicrohttpd sends the headers alone. */
static bool is_get(const char *method)
{
    return strcmp(method, MHD_HTTP_METHOD_GET) == 0 || strcmp(method, MHD_HTTP_METHOD_HEAD) == 0;
}

static bool wants_post(const cln_server *s, const char *path)
{
    for (size_t i = 0; i < sizeof asks / sizeof *asks; i++)
        if (strcmp(path, asks[i].path) == 0)
            return asks[i].post;
    return order_of(s, path) != 0;
}

static enum MHD_Result route(cln_server *s, struct MHD_Connection *connection, const char *path,
                             request *r)
{
    const char *token = s->listener->token;
    const char *mode = header_of(connection, "Sec-Fetch-Mode");
    const char *named = header_of(connection, "X-Server"), *reason = NULL;
    const unsigned order = order_of(s, path);
    /* a link on another page may lead here; what it leads to sees nothing of that page */
    const bool page = strcmp(path, "/") == 0 && mode && strcmp(mode, "navigate") == 0;

    if (strcmp(path, "/healthz") == 0) /* a probe may send no Host, and has no token */
        return answer(s, connection, 200, "ok");
    if (!cln_ask_allowed(header_of(connection, "Host"), header_of(connection, "Origin"),
                         page ? NULL : header_of(connection, "Sec-Fetch-Site"), s->listener->far,
                         &reason))
        return answer(s, connection, 403, reason);
    if (token[0]) {
        if (strcmp(path, "/") == 0 && cln_ask_same_token(query_value(connection, "token"), token))
            return let_in(s, connection);
        if (!cln_ask_same_token(MHD_lookup_connection_value(connection, MHD_COOKIE_KIND, s->cookie),
                                token))
            return answer(s, connection, 403,
                          "open the whole address that cl-nascent printed, with its token");
    }
    if (!named)
        named = query_value(connection, "server"); /* of pictures that the page has by address */
    if (named && strcmp(named, s->id) != 0)
        return answer(
            s, connection, 410,
            "another viewer has this address by now: reload the page to see what it shows");
    if (order)
        return take_order(s, connection, order);
    for (int i = 0; i < PAGES; i++)
        if (strcmp(path, pages[i].path) == 0)
            return send_text(s, connection, pages[i].type, s->pages[i]);
    if (strcmp(path, "/facts") == 0)
        return send_text(s, connection, "application/json", s->facts);
    if (strcmp(path, s->training ? "/training" : "/newest") == 0)
        return send_told(s, connection);
    for (size_t i = 0; i < sizeof asks / sizeof *asks; i++)
        if (strcmp(path, asks[i].path) == 0)
            return ask(s, connection, asks[i].kind, r);
    return answer(s, connection, 404, "nothing is here; the page is at /");
}

static enum MHD_Result count_one(void *user, enum MHD_ValueKind kind, const char *key,
                                 const char *value)
{
    static const char *const once[ONCE] = {"Host", "Content-Length", "Origin", "X-Server"};
    int *counts = user;

    (void)kind, (void)value;
    for (int i = 0; i < ONCE; i++)
        counts[i] += strcasecmp(key, once[i]) == 0;
    return MHD_YES;
}

/* Of a header given twice, a proxy and this server may each take another. */
static bool has_doubles(struct MHD_Connection *connection)
{
    int counts[ONCE] = {0};
    bool doubles = false;

    MHD_get_connection_values(connection, MHD_HEADER_KIND, count_one, counts);
    for (int i = 0; i < ONCE; i++)
        doubles = doubles || counts[i] > 1;
    return doubles;
}

/* MHD calls this when the headers are there (an answer then ends the connection), next to get the
 * answer, and again when the painter has resumed the connection. */
static enum MHD_Result on_request(void *user, struct MHD_Connection *connection, const char *path,
                                  const char *method, const char *version, const char *data,
                                  size_t *bytes, void **context)
{
    cln_server *s = user;
    const char *length = header_of(connection, "Content-Length");
    request *r = *context;

    (void)version, (void)data, (void)bytes;
    if (!r) {
        if (has_doubles(connection))
            return answer(s, connection, 400, "a header is given twice");
        if (wants_post(s, path) && strcmp(method, MHD_HTTP_METHOD_POST) != 0)
            return answer_with(s, connection, 405, "an order is given by POST", "POST");
        if (!wants_post(s, path) && !is_get(method))
            return answer_with(s, connection, 405, "only GET and HEAD are answered", "GET, HEAD");
        if ((length && strcmp(length, "0") != 0) || header_of(connection, "Transfer-Encoding"))
            return answer(s, connection, 413, "a request has no body here");
        if (cln_alloc(&r, 1, sizeof *r, "request") != CLN_OK) {
            cln_clear_error();
            return MHD_NO;
        }
        *context = r;
        return MHD_YES;
    }
    return r->waited ? send_painting(s, connection, r) : route(s, connection, path, r);
}

static void on_completed(void *user, struct MHD_Connection *connection, void **context,
                         enum MHD_RequestTerminationCode code)
{
    request *r = *context;

    (void)user, (void)connection, (void)code;
    if (r)
        free(r->painting.body);
    if (r && r->painting.is_file)
        close(r->painting.file);
    free(r);
    *context = NULL;
}

/* ---- painting ---- */

/* Gives an answered request back to its connection. */
static void hand_back(request *r)
{
    cln_rendering_end(&r->painting.rendering);
    MHD_resume_connection(r->connection);
}

/* A photo of a camera takes much longer to decode than a picture that moves may take. */
static bool is_photo(const request *r)
{
    return r->painting.ask.kind == CLN_ASK_PHOTO;
}

static bool is_small(const request *r)
{
    const cln_ask *ask = &r->painting.ask;

    return (ask->kind != CLN_ASK_PICTURE && ask->kind != CLN_ASK_FILM_FRAME) ||
           (ask->budget > 0 && ask->budget <= SMALL_SECONDS);
}

/* Ends waiting requests whose clients have gone, as the number of connections is limited. */
static void drop_gone(cln_server *s)
{
    request *gone = NULL;

    pthread_mutex_lock(&s->lock);
    for (request **at = &s->waiting; *at;) {
        request *r = *at;

        if (r->cancelled || is_gone(r)) {
            *at = r->next;
            r->next = gone;
            gone = r;
        } else {
            at = &r->next;
        }
    }
    pthread_mutex_unlock(&s->lock);
    for (request *next = NULL; gone; gone = next) {
        next = gone->next;
        cln_painter_forget(s->painter, &gone->painting);
        cln_painting_say(&gone->painting, 409, "a later picture was asked for");
        hand_back(gone);
    }
}

/* Whether a request for the film waits: then its client is not silent, the painter is late. */
static bool film_waits(cln_server *s)
{
    const cln_reel *reel = &s->painter->reel;
    bool waits = false;

    pthread_mutex_lock(&s->lock);
    waits = s->at_work && cln_reel_is(reel, s->at_work->painting.ask.film);
    for (const request *r = s->waiting; r && !waits; r = r->next)
        waits = cln_reel_is(reel, r->painting.ask.film);
    pthread_mutex_unlock(&s->lock);
    return waits;
}

static void tend(cln_server *s)
{
    const double now = cln_now(), gap = now - s->tended_at;

    if (gap < TEND_SECONDS)
        return;
    s->tended_at = now;
    end_late(s);
    drop_gone(s);
    cln_reel_tend(&s->painter->reel, film_waits(s) ? 0 : fmin(gap, GAP_SECONDS));
}

/* The small one whose turn it is, taken out, or NULL: in order, but after a photo another one. */
static request *take_small(cln_server *s)
{
    request **turn = NULL, *r = NULL;

    for (request **at = &s->waiting; *at; at = &(*at)->next) {
        if (!(*at)->cancelled && !is_small(*at))
            continue;
        turn = turn ? turn : at;
        if (s->photo_before && is_photo(*turn) && !is_photo(*at))
            turn = at;
    }
    if (!turn)
        return NULL;
    r = *turn;
    *turn = r->next;
    s->photo_before = is_photo(r);
    return r;
}

/* Takes the next one to paint: small ones in order, each whole; in between a batch of the large one
 * at work, so that neither waits for ever. NULL after `wait` seconds without any. */
static request *take(cln_server *s, double wait)
{
    request *r = NULL;
    struct timespec until;

    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_nsec += (long)(wait * 1e9);
    until.tv_sec += until.tv_nsec / 1000000000;
    until.tv_nsec %= 1000000000;
    pthread_mutex_lock(&s->lock);
    if (wait > 0 && !s->waiting && !s->at_work)
        pthread_cond_timedwait(&s->came, &s->lock, &until);
    if (!s->at_work || !s->small_before)
        r = take_small(s);
    s->small_before = r != NULL;
    if (!r && !s->at_work && s->waiting) {
        s->at_work = s->waiting;
        s->waiting = s->waiting->next;
    }
    if (!r)
        r = s->at_work;
    if (r)
        r->next = NULL;
    pthread_mutex_unlock(&s->lock);
    return r;
}

/* Paints r: a small one to its end, of a large one a batch. */
static cln_status paint(cln_server *s, request *r)
{
    cln_status st = CLN_OK;
    bool cancelled = false;

    do {
        pthread_mutex_lock(&s->lock);
        cancelled = r->cancelled;
        pthread_mutex_unlock(&s->lock);
        if (cancelled || is_gone(r)) {
            cln_painter_forget(s->painter, &r->painting);
            cln_painting_say(&r->painting, 409, "a later picture was asked for");
        } else {
            CLN_TRY(cln_painter_step(s->painter, &r->painting));
        }
    } while (r->painting.status == 0 && is_small(r));
done:
    if (st != CLN_OK)
        cln_painting_say(&r->painting, 500, cln_error_text());
    if (r->painting.status != 0) {
        pthread_mutex_lock(&s->lock);
        if (s->at_work == r)
            s->at_work = NULL;
        pthread_mutex_unlock(&s->lock);
        hand_back(r);
    }
    return st;
}

/* Nobody waits any more: MHD cannot stop while connections are suspended. */
static void send_all_away(cln_server *s)
{
    request *r = NULL;

    pthread_mutex_lock(&s->lock);
    s->closing = true;
    r = s->waiting;
    s->waiting = NULL;
    if (s->at_work) {
        s->at_work->next = r;
        r = s->at_work;
        s->at_work = NULL;
    }
    pthread_mutex_unlock(&s->lock);
    while (r) {
        request *next = r->next;

        cln_painting_say(&r->painting, 503, "the viewer has ended");
        hand_back(r);
        r = next;
    }
}

/* ---- the server ---- */

static cln_status join(const char *const *lines, char **out)
{
    cln_status st = CLN_OK;
    size_t bytes = 1, at = 0;

    for (int i = 0; lines[i]; i++)
        bytes += strlen(lines[i]);
    CLN_TRY(cln_alloc(out, bytes, 1, "page"));
    for (int i = 0; lines[i]; i++) {
        const size_t length = strlen(lines[i]);

        memcpy(*out + at, lines[i], length);
        at += length;
    }
done:
    return st;
}

static cln_status start(cln_server *s)
{
    cln_status st = CLN_OK;
    /* MHD closes it; programs that are begun, as a browser, must not hold it */
    const int copy = fcntl(s->listener->socket, F_DUPFD_CLOEXEC, 0);

    if (copy >= 0)
        s->daemon = MHD_start_daemon(
            MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_AUTO | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ITC,
            0, NULL, NULL, on_request, s, MHD_OPTION_LISTEN_SOCKET, copy,
            MHD_OPTION_CONNECTION_LIMIT, (unsigned)CONNECTIONS, MHD_OPTION_PER_IP_CONNECTION_LIMIT,
            (unsigned)(s->listener->loopback ? CONNECTIONS : OF_ADDRESS),
            MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)HEADER_BYTES, MHD_OPTION_CONNECTION_TIMEOUT,
            (unsigned)SEND_SECONDS, MHD_OPTION_NOTIFY_CONNECTION, on_connection, s,
            MHD_OPTION_NOTIFY_COMPLETED, on_completed, s, MHD_OPTION_END);
    if (!s->daemon) {
        if (copy >= 0)
            close(copy);
        CLN_TRY(cln_fail(CLN_FAILED, "the viewer's server does not start: %s", strerror(errno)));
    }
done:
    return st;
}

cln_status cln_server_open(const cln_server_desc *desc, cln_server **out)
{
    cln_status st = CLN_OK;
    cln_server *s = NULL;
    pthread_condattr_t monotonic;
    char random[33], digest[CLN_DIGEST_TEXT];

    *out = NULL;
    CLN_TRY(cln_ask_make_token(random));
    CLN_TRY(cln_alloc(&s, 1, sizeof *s, "viewer"));
    s->listener = desc->listener;
    s->painter = desc->painter;
    s->facts = desc->facts;
    s->training = desc->training;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&s->came, &monotonic);
    pthread_condattr_destroy(&monotonic);
    pthread_mutex_init(&s->lock, NULL);
    snprintf(s->id, sizeof s->id, "%.16s", random);
    /* a viewer that is started again with the same token knows its pages */
    cln_digest_text(cln_digest(CLN_DIGEST_START, s->listener->token, strlen(s->listener->token)),
                    digest);
    snprintf(s->cookie, sizeof s->cookie, "cl-nascent-%s", digest);
    for (int i = 0; i < PAGES; i++)
        CLN_TRY(join(pages[i].lines, &s->pages[i]));
    CLN_TRY(start(s));
    *out = s;
    s = NULL;
done:
    cln_server_close(s);
    return st;
}

cln_status cln_server_turn(cln_server *s, double wait, bool *painted)
{
    cln_status st = CLN_OK;
    request *r = NULL;

    tend(s);
    r = take(s, wait);
    *painted = r != NULL;
    if (r)
        CLN_TRY(paint(s, r));
done:
    return st;
}

bool cln_server_asked(cln_server *s)
{
    bool asked = false;

    tend(s);
    pthread_mutex_lock(&s->lock);
    asked = s->waiting || s->at_work;
    pthread_mutex_unlock(&s->lock);
    return asked;
}

void cln_server_tell(cln_server *s, char *text)
{
    char *before = NULL;

    pthread_mutex_lock(&s->lock);
    before = s->told;
    s->told = text;
    pthread_mutex_unlock(&s->lock);
    free(before);
}

unsigned cln_server_orders(cln_server *s)
{
    unsigned orders = 0;

    pthread_mutex_lock(&s->lock);
    orders = s->orders;
    s->orders = 0;
    pthread_mutex_unlock(&s->lock);
    return orders;
}

void cln_server_close(cln_server *s)
{
    if (!s)
        return;
    if (s->daemon) {
        send_all_away(s);
        MHD_stop_daemon(s->daemon);
    }
    cln_reel_drop(&s->painter->reel);
    pthread_mutex_destroy(&s->lock);
    pthread_cond_destroy(&s->came);
    for (int i = 0; i < PAGES; i++)
        free(s->pages[i]);
    free(s->told);
    free(s);
}

#endif
