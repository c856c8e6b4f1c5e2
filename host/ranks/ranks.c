/* Ranks by MPI, or one rank. See ranks.h. Compiled with CLN_WITH_MPI by `make MPI=1`. */
#include "ranks/ranks.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/number.h"
#include "io/progress.h"

static struct {
    int count, me, me_here, here;
    char name[128];
    cln_ranks_traffic sent;
} self = {.count = 1, .here = 1};

enum { HOST_BYTES = 64 };

/* By rank; of several. */
static char hosts[CLN_RANKS_MOST][HOST_BYTES];

int cln_ranks_count(void)
{
    return self.count;
}

int cln_ranks_me(void)
{
    return self.me;
}

int cln_ranks_me_here(void)
{
    return self.me_here;
}

int cln_ranks_here(void)
{
    return self.here;
}

#ifdef CLN_WITH_MPI

/* Open MPI and MPICH tell a process its place before it asks. */
static void name_early(void)
{
    static const char *const places[][2] = {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                            {"PMI_RANK", "PMI_SIZE"}};
    char host[HOST_BYTES] = "";

    gethostname(host, sizeof host - 1);
    for (int i = 0; i < 2 && !self.name[0]; i++) {
        const char *me = getenv(places[i][0]), *count = getenv(places[i][1]);

        if (me && count && atoi(count) > 1)
            snprintf(self.name, sizeof self.name, "rank %d of %d on %s: ", atoi(me), atoi(count),
                     host);
    }
}

#endif

const char *cln_ranks_name(void)
{
#ifdef CLN_WITH_MPI
    if (!self.name[0])
        name_early();
#endif
    return self.name;
}

cln_ranks_traffic cln_ranks_sent(void)
{
    return self.sent;
}

cln_status cln_ranks_agree(uint64_t digest, const char *what)
{
    uint64_t digests[CLN_RANKS_MOST] = {0};
    int first[CLN_RANKS_MOST + 1];

    for (int r = 0; r <= self.count; r++)
        first[r] = r;
    digests[self.me] = digest;
    cln_ranks_gather(digests, sizeof digest, first, true);
    for (int r = 1; r < self.count; r++)
        if (digests[r] != digests[0])
            return cln_fail(CLN_USAGE,
                            "rank %d on %s has another %s than rank 0 on %s; start all ranks with "
                            "the same program, scene, options and kind of device",
                            r, hosts[r], what, hosts[0]);
    return CLN_OK;
}

cln_status cln_ranks_have(bool here, const char *run)
{
    bool has[CLN_RANKS_MOST] = {0};
    int first[CLN_RANKS_MOST + 1], one = 0;

    for (int r = 0; r <= self.count; r++)
        first[r] = r;
    has[self.me] = here;
    cln_ranks_gather(has, sizeof here, first, true);
    while (one < self.count && !has[one])
        one++;
    for (int r = 0; r < self.count && one < self.count; r++)
        if (!has[r])
            return cln_fail(CLN_USAGE,
                            "%s: rank %d on %s does not have this run, and rank %d on %s goes on "
                            "with it; copy it to all machines, to the same path, or have it on a "
                            "disk that they share",
                            run, r, hosts[r], one, hosts[one]);
    return CLN_OK;
}

#ifdef CLN_WITH_MPI

#include <mpi.h>
#include <sched.h>

/* Rows as MPI's elements, so that its counts, which are ints, count rows. */
static MPI_Datatype type_of(size_t row_bytes)
{
    MPI_Datatype type;

    MPI_Type_contiguous((int)row_bytes, MPI_BYTE, &type);
    MPI_Type_commit(&type);
    return type;
}

/* ---- a rank that does not come ---- */

enum { QUESTION = 1, ANSWER = 2 };
enum { SWAP = 3 }; /* the tag of cln_ranks_swap */

/* Questions and answers without content. A rank that waits long asks the others whether they live;
 * each answers when it begins to wait, or while it waits. So who does not answer works, hangs, or
 * is stopped. */
static struct {
    MPI_Comm comm;                /* for these alone */
    double clock;                 /* seconds that this rank has waited in all */
    double heard[CLN_RANKS_MOST]; /* on this clock */
    bool asked[CLN_RANKS_MOST];   /* and not yet answered */
    double patience;
} roll;

static void send_roll(int rank, int tag)
{
    MPI_Request request;

    MPI_Isend(NULL, 0, MPI_BYTE, rank, tag, roll.comm, &request);
    MPI_Request_free(&request);
}

static void listen_roll(void)
{
    MPI_Status status;
    int there = self.count > 1;

    while (there) {
        MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, roll.comm, &there, &status);
        if (!there)
            return;
        MPI_Recv(NULL, 0, MPI_BYTE, status.MPI_SOURCE, status.MPI_TAG, roll.comm,
                 MPI_STATUS_IGNORE);
        if (status.MPI_TAG == QUESTION) {
            send_roll(status.MPI_SOURCE, ANSWER);
        } else {
            roll.asked[status.MPI_SOURCE] = false;
            roll.heard[status.MPI_SOURCE] = roll.clock;
        }
    }
}

/* For how long a rank has not answered, at most since this wait began. */
static double silence(int rank, double began)
{
    return rank == self.me ? 0 : roll.clock - fmax(roll.heard[rank], began);
}

/* Ends all. Who has not answered for almost as long is missing, too. */
static void give_up(double began)
{
    const struct timespec turn = {.tv_sec = 3};
    int missing = 0, first = 0, speaker = self.count;
    char text[HOST_BYTES + 512], others[32] = "", waited[32];

    for (int r = self.count - 1; r >= 0; r--)
        if (silence(r, began) > 0.75 * roll.patience) {
            missing++;
            first = r;
        } else {
            speaker = r;
        }
    if (missing > 1)
        snprintf(others, sizeof others, " (and %d more)", missing - 1);
    cln_format_duration(roll.patience, waited);
    snprintf(
        text, sizeof text,
        "rank %d of %d on %.63s%s has kept others waiting for %s without an answer: it hangs, is "
        "stopped or cut off; look for the reason there, then start all again, a training from "
        "its last checkpoint by --resume; CL_NASCENT_RANK_WAIT=SECONDS waits longer",
        first, self.count, hosts[first], others, waited);
    if (speaker < self.me) /* it finds the same in a moment, and one sentence is enough */
        nanosleep(&turn, NULL);
    cln_log(CLN_LOG_ERROR, "%s%s", self.name, text);
    MPI_Abort(MPI_COMM_WORLD, cln_status_exit_code(CLN_FAILED));
}

/* In a wait since `began`, on the waits' clock: asks those who have not answered lately, and gives
 * up if one does not for too long. */
static void call_roll(double began)
{
    for (int r = 0; r < self.count; r++)
        if (silence(r, began) > roll.patience)
            give_up(began);
        else if (r != self.me && !roll.asked[r]) {
            roll.asked[r] = true;
            send_roll(r, QUESTION);
        }
}

/* Seconds of rest in a wait of so many: a hundredth, so that a long one, as for a viewer's next
 * picture, leaves the core alone and still ends in time. */
static double rest_after(double waited)
{
    return fmin(fmax(0.01 * waited, 50e-6), 2e-3);
}

/* Waits for a message without holding the core for long: OpenMPI itself would poll, at the cost of
 * other ranks on the same core, and of this one's device if that is the processor. */
static void await_status(MPI_Request *request, MPI_Status *status)
{
    const double began = roll.clock;
    double last = 0, called = began;
    int done = 0;

    listen_roll();
    for (int tries = 0; !done; tries++) {
        MPI_Test(request, &done, status);
        if (!done && tries < 1000) {
            sched_yield();
        } else if (!done) {
            const double before = last;
            const struct timespec rest = {.tv_nsec = (long)(1e9 * rest_after(roll.clock - began))};

            nanosleep(&rest, NULL);
            listen_roll();
            last = cln_now();
            if (before > 0) /* a longer while is one in which this rank stood still itself */
                roll.clock += fmin(last - before, 1);
            if (roll.patience > 0 && roll.clock - called > roll.patience / 8) {
                called = roll.clock;
                call_roll(began);
            }
        }
    }
}

static void await(MPI_Request *request)
{
    await_status(request, MPI_STATUS_IGNORE);
}

void cln_ranks_answer(void)
{
    listen_roll();
}

static void account(double began, double bytes)
{
    self.sent.seconds += cln_now() - began;
    self.sent.bytes += bytes;
}

/* All learn each other's hosts and rank 0's patience. */
static cln_status meet_first(const char *host)
{
    const char *patience = getenv("CL_NASCENT_RANK_WAIT");
    int first[CLN_RANKS_MOST + 1];

    snprintf(self.name, sizeof self.name, "rank %d of %d on %s: ", self.me, self.count, host);
    roll.patience = CLN_RANKS_PATIENCE;
    if (self.me == 0 && patience && *patience &&
        (!cln_seconds_read(patience, &roll.patience, NULL) ||
         (roll.patience > 0 && roll.patience < 5)))
        return cln_fail(CLN_USAGE,
                        "CL_NASCENT_RANK_WAIT: '%s' is not a time of 5 seconds or more; give 600 "
                        "or 10m, 0 to wait for ever, or unset it",
                        patience);
    MPI_Comm_dup(MPI_COMM_WORLD, &roll.comm);
    for (int r = 0; r <= self.count; r++)
        first[r] = r;
    memcpy(hosts[self.me], host, HOST_BYTES);
    cln_ranks_gather(hosts, HOST_BYTES, first, true);
    cln_ranks_tell(&roll.patience, sizeof roll.patience);
    self.sent = (cln_ranks_traffic){0};
    return CLN_OK;
}

/* MPI's own errors end all ranks with a sentence of MPI's (MPI_ERRORS_ARE_FATAL, the default). */
cln_status cln_ranks_open(void)
{
    int there = 0, level = 0;
    char host[HOST_BYTES] = "";
    MPI_Comm here;

    MPI_Initialized(&there);
    if (there)
        return CLN_OK;
    MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &level);
    MPI_Comm_size(MPI_COMM_WORLD, &self.count);
    MPI_Comm_rank(MPI_COMM_WORLD, &self.me);
    if (self.count > CLN_RANKS_MOST)
        return cln_fail(CLN_USAGE,
                        "%d ranks are more than the %d that this program takes; start fewer",
                        self.count, CLN_RANKS_MOST);
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &here);
    MPI_Comm_rank(here, &self.me_here);
    MPI_Comm_size(here, &self.here);
    MPI_Comm_free(&here);
    gethostname(host, sizeof host - 1);
    return self.count > 1 ? meet_first(host) : CLN_OK;
}

void cln_ranks_close(bool failed, int exit_code)
{
    int there = 0;
    MPI_Request request;

    MPI_Initialized(&there);
    if (!there)
        return;
    if (failed && self.count > 1)
        MPI_Abort(MPI_COMM_WORLD, exit_code);
    MPI_Ibarrier(MPI_COMM_WORLD, &request); /* MPI_Finalize would wait without answering */
    await(&request);
    MPI_Finalize();
}

static MPI_Request asked = MPI_REQUEST_NULL;

void cln_ranks_largest_begin(double *values, int n)
{
    const double began = cln_now();

    if (self.count > 1)
        MPI_Iallreduce(MPI_IN_PLACE, values, n, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD, &asked);
    account(began, (double)n * sizeof *values);
}

void cln_ranks_largest_end(void)
{
    const double began = cln_now();

    await(&asked);
    account(began, 0);
}

void cln_ranks_largest(double *values, int n)
{
    cln_ranks_largest_begin(values, n);
    cln_ranks_largest_end();
}

void cln_ranks_tell_from(int rank, void *data, size_t bytes)
{
    const double began = cln_now();

    MPI_Request request = MPI_REQUEST_NULL;

    if (self.count > 1)
        MPI_Ibcast(data, (int)bytes, MPI_BYTE, rank, MPI_COMM_WORLD, &request);
    await(&request);
    account(began, self.me == rank ? (double)bytes : 0);
}

void cln_ranks_tell(void *data, size_t bytes)
{
    cln_ranks_tell_from(0, data, bytes);
}

static void receive(void *data, size_t bytes, int from)
{
    MPI_Request request;

    MPI_Irecv(data, (int)bytes, MPI_BYTE, from, 0, MPI_COMM_WORLD, &request);
    await(&request);
}

void cln_ranks_take(void *baton, size_t bytes)
{
    const double began = cln_now();

    if (self.me > 0)
        receive(baton, bytes, self.me - 1);
    account(began, 0);
}

void cln_ranks_hand(void *baton, size_t bytes)
{
    const double began = cln_now();
    MPI_Request request = MPI_REQUEST_NULL;

    if (self.count > 1)
        MPI_Isend(baton, (int)bytes, MPI_BYTE, (self.me + 1) % self.count, 0, MPI_COMM_WORLD,
                  &request);
    await(&request);
    if (self.me == 0 && self.count > 1)
        receive(baton, bytes, self.count - 1);
    account(began, (double)bytes);
}

void cln_ranks_gather(void *rows, size_t row_bytes, const int *first, bool all)
{
    const double began = cln_now();
    const int mine = first[self.me + 1] - first[self.me];
    int counts[CLN_RANKS_MOST];
    MPI_Datatype type;
    MPI_Request request;

    if (self.count == 1)
        return;
    type = type_of(row_bytes);
    for (int r = 0; r < self.count; r++)
        counts[r] = first[r + 1] - first[r];
    if (all)
        MPI_Iallgatherv(MPI_IN_PLACE, 0, type, rows, counts, first, type, MPI_COMM_WORLD, &request);
    else if (self.me == 0)
        MPI_Igatherv(MPI_IN_PLACE, 0, type, rows, counts, first, type, 0, MPI_COMM_WORLD, &request);
    else
        MPI_Igatherv((char *)rows + (size_t)first[self.me] * row_bytes, mine, type, NULL, NULL,
                     NULL, type, 0, MPI_COMM_WORLD, &request);
    await(&request);
    MPI_Type_free(&type);
    account(began, (double)mine * (double)row_bytes * (all ? self.count - 1 : 1));
}

static struct {
    MPI_Request request;
    MPI_Datatype type;
    int counts[CLN_RANKS_MOST], first[CLN_RANKS_MOST]; /* MPI reads them until the end */
} gathering = {.request = MPI_REQUEST_NULL};

void cln_ranks_gather_begin(void *rows, size_t row_bytes, const int *first)
{
    const double began = cln_now();

    if (self.count == 1)
        return;
    gathering.type = type_of(row_bytes);
    for (int r = 0; r < self.count; r++) {
        gathering.counts[r] = first[r + 1] - first[r];
        gathering.first[r] = first[r];
    }
    MPI_Iallgatherv(MPI_IN_PLACE, 0, gathering.type, rows, gathering.counts, gathering.first,
                    gathering.type, MPI_COMM_WORLD, &gathering.request);
    account(began, (double)gathering.counts[self.me] * (double)row_bytes * (self.count - 1));
}

void cln_ranks_gather_end(void)
{
    const double began = cln_now();

    if (self.count == 1)
        return;
    await(&gathering.request);
    MPI_Type_free(&gathering.type);
    account(began, 0);
}

/* How many rows two ranges share; *at: where they begin, counted from `from`. */
static int common(int from, int end, int other_from, int other_end, int *at)
{
    const int begin = from > other_from ? from : other_from;
    const int last = end < other_end ? end : other_end;

    *at = last > begin ? begin - from : 0;
    return last > begin ? last - begin : 0;
}

void cln_ranks_deal(const void *from, const int *old_first, void *to, const int *new_first,
                    size_t row_bytes)
{
    const double began = cln_now();
    const int me = self.me;
    int sent[CLN_RANKS_MOST], got[CLN_RANKS_MOST], sent_at[CLN_RANKS_MOST], got_at[CLN_RANKS_MOST];
    double bytes = 0;
    MPI_Datatype type = type_of(row_bytes);
    MPI_Request request;

    for (int r = 0; r < self.count; r++) {
        sent[r] =
            common(old_first[me], old_first[me + 1], new_first[r], new_first[r + 1], &sent_at[r]);
        got[r] =
            common(new_first[me], new_first[me + 1], old_first[r], old_first[r + 1], &got_at[r]);
        bytes += r == me ? 0 : (double)sent[r] * (double)row_bytes;
    }
    MPI_Ialltoallv(from, sent, sent_at, type, to, got, got_at, type, MPI_COMM_WORLD, &request);
    await(&request);
    MPI_Type_free(&type);
    account(began, bytes);
}

void cln_ranks_swap(const void *sent, const int *sent_first, const bool *to, void *got,
                    const int *got_first, int *got_count, size_t row_bytes)
{
    const double began = cln_now();
    static MPI_Request sending[CLN_RANKS_MOST], getting[CLN_RANKS_MOST];
    MPI_Datatype type = type_of(row_bytes);
    MPI_Status status;
    double bytes = 0;

    for (int r = 0; r < self.count; r++) {
        const int rows = sent_first[r + 1] - sent_first[r], room = got_first[r + 1] - got_first[r];

        sending[r] = getting[r] = MPI_REQUEST_NULL;
        if (room > 0)
            MPI_Irecv((char *)got + (size_t)got_first[r] * row_bytes, room, type, r, SWAP,
                      MPI_COMM_WORLD, &getting[r]);
        if (to[r])
            MPI_Isend((const char *)sent + (size_t)sent_first[r] * row_bytes, rows, type, r, SWAP,
                      MPI_COMM_WORLD, &sending[r]);
        bytes += (double)rows * (double)row_bytes;
    }
    for (int r = 0; r < self.count; r++) {
        got_count[r] = 0;
        if (getting[r] != MPI_REQUEST_NULL) {
            await_status(&getting[r], &status);
            MPI_Get_count(&status, type, &got_count[r]);
        }
        if (to[r])
            await(&sending[r]);
    }
    MPI_Type_free(&type);
    account(began, bytes);
}

#else

/* Started by mpirun as one of several, each believes that it is alone: a likely slip. */
cln_status cln_ranks_open(void)
{
    static const char *const sizes[] = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}; /* Open MPI; MPICH */

    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        const char *size = getenv(sizes[i]);
        const long count = size ? strtol(size, NULL, 10) : 0;

        if (count > 1)
            cln_warn("this program is built without MPI, so each of the %ld processes works alone; "
                     "`make MPI=1` builds build/mpi/cl-nascent, whose processes train together",
                     count);
    }
    return CLN_OK;
}

void cln_ranks_close(bool failed, int exit_code)
{
    (void)failed;
    (void)exit_code;
}

void cln_ranks_largest(double *values, int n)
{
    (void)values;
    (void)n;
}

void cln_ranks_largest_begin(double *values, int n)
{
    (void)values;
    (void)n;
}

void cln_ranks_largest_end(void)
{
}

void cln_ranks_answer(void)
{
}

void cln_ranks_tell(void *data, size_t bytes)
{
    (void)data;
    (void)bytes;
}

void cln_ranks_tell_from(int rank, void *data, size_t bytes)
{
    (void)rank;
    (void)data;
    (void)bytes;
}

void cln_ranks_take(void *baton, size_t bytes)
{
    (void)baton;
    (void)bytes;
}

void cln_ranks_hand(void *baton, size_t bytes)
{
    (void)baton;
    (void)bytes;
}

void cln_ranks_gather(void *rows, size_t row_bytes, const int *first, bool all)
{
    (void)rows;
    (void)row_bytes;
    (void)first;
    (void)all;
}

void cln_ranks_gather_begin(void *rows, size_t row_bytes, const int *first)
{
    (void)rows;
    (void)row_bytes;
    (void)first;
}

void cln_ranks_gather_end(void)
{
}

void cln_ranks_deal(const void *from, const int *old_first, void *to, const int *new_first,
                    size_t row_bytes)
{
    memcpy(to, from, (size_t)(new_first[1] - old_first[0]) * row_bytes);
}

void cln_ranks_swap(const void *sent, const int *sent_first, const bool *to, void *got,
                    const int *got_first, int *got_count, size_t row_bytes)
{
    got_count[0] = 0;
    (void)sent;
    (void)sent_first;
    (void)got;
    (void)got_first;
    (void)to;
    (void)row_bytes;
}

#endif
