/* See command.h. The other program runs as a child, its output goes to a pipe; it shares the
 * terminal, so that Ctrl-C reaches it, too. */
#include "io/command.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/text.h"

enum { POLL_MS = 200, LINE = 1024 };

bool cln_command_found(const char *program)
{
    const char *path = getenv("PATH");
    char *file = NULL;
    bool found = false;

    while (path && *path && !found) {
        const size_t length = strcspn(path, ":");

        if (length && cln_asprintf(&file, "%.*s/%s", (int)length, path, program) == CLN_OK)
            found = access(file, X_OK) == 0;
        free(file);
        file = NULL;
        path += length + (path[length] == ':');
    }
    return found;
}

static void write_command(FILE *log, const char *const *argv)
{
    char quoted[CLN_QUOTED_BYTES];

    fputs("$", log);
    for (int i = 0; argv[i]; i++)
        fprintf(log, " %s", cln_shell_quote(argv[i], quoted, sizeof quoted));
    fputc('\n', log);
}

static void child(const char *const *argv, int out, pid_t parent)
{
    const int null = open("/dev/null", O_RDONLY);

    /* it does not outlive the program, even one that is killed: the next may have its files */
    if (prctl(PR_SET_PDEATHSIG, SIGTERM) != 0 || getppid() != parent)
        _exit(127);
    dup2(null, STDIN_FILENO);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    close(out);
    signal(SIGPIPE, SIG_DFL);
    setenv("QT_QPA_PLATFORM", "offscreen", 0); /* COLMAP asks for a display otherwise */
    execvp(argv[0], (char *const *)argv);
    dprintf(STDERR_FILENO, "%s: %s\n", argv[0], strerror(errno));
    _exit(127);
}

/* Cuts what is read into lines; the last line that is not empty stays in last[]. */
typedef struct lines {
    char now[LINE], last[LINE];
    size_t used;
} lines;

static void end_line(lines *l, const cln_command_watch *watch)
{
    l->now[l->used] = 0;
    if (l->now[strspn(l->now, " \t")])
        memcpy(l->last, l->now, sizeof l->last);
    if (watch->line)
        watch->line(l->now, watch->user);
    l->used = 0;
}

static void take(lines *l, const char *bytes, size_t count, const cln_command_watch *watch)
{
    if (watch->log)
        fwrite(bytes, 1, count, watch->log);
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] == '\n' || bytes[i] == '\r')
            end_line(l, watch);
        else if (l->used < LINE - 1)
            l->now[l->used++] = bytes[i];
    }
}

/* Reads until the program closes its output. *stop: the signal for which it was stopped, or 0. */
static void read_output(int from, pid_t pid, lines *l, const cln_command_watch *watch, int *stop)
{
    struct pollfd wait = {.fd = from, .events = POLLIN};
    char bytes[4096];

    for (;;) {
        const int ready = poll(&wait, 1, POLL_MS);

        if (watch->interrupted && !*stop) {
            const int number = watch->interrupted(watch->user);

            if (number == SIGINT || number == SIGTERM) {
                *stop = number;
                kill(pid, SIGTERM);
            }
        }
        if (ready > 0) {
            const ssize_t count = read(from, bytes, sizeof bytes);

            if (count == 0 || (count < 0 && errno != EINTR))
                break;
            if (count > 0)
                take(l, bytes, (size_t)count, watch);
        }
    }
    if (l->used)
        end_line(l, watch);
}

static const char unknown_end[] =
    "%s: how it ended is not known, as this process ignores SIGCHLD or waits for all its children; "
    "set SIGCHLD to SIG_DFL, and wait for other processes by their numbers";

/* false: its end is lost. */
static bool wait_for(pid_t pid, int *code)
{
    pid_t got = 0;

    do
        got = waitpid(pid, code, 0);
    while (got < 0 && errno == EINTR);
    return got == pid;
}

cln_status cln_command_run(const char *const *argv, const cln_command_watch *watch)
{
    lines l = {.used = 0};
    const pid_t self = getpid();
    int pipes[2], code = 0, stop = 0;
    bool known = false;
    pid_t pid = 0;

    if (watch->log) {
        write_command(watch->log, argv);
        fflush(watch->log);
    }
    if (pipe2(pipes, O_CLOEXEC) != 0)
        return cln_fail(CLN_FAILED, "%s: cannot make a pipe: %s", argv[0], strerror(errno));
    pid = fork();
    if (pid == 0)
        child(argv, pipes[1], self);
    close(pipes[1]);
    if (pid < 0) {
        close(pipes[0]);
        return cln_fail(CLN_FAILED, "%s: cannot be started: %s", argv[0], strerror(errno));
    }
    read_output(pipes[0], pid, &l, watch, &stop);
    close(pipes[0]);
    known = wait_for(pid, &code);
    if (watch->log)
        fflush(watch->log);
    if (stop)
        return cln_fail(stop == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal in `%s`",
                        argv[0]);
    if (!known)
        return cln_fail(CLN_FAILED, unknown_end, argv[0]);
    if (WIFSIGNALED(code))
        return cln_fail(CLN_FAILED, "%s %s: ended by signal %d%s", argv[0], argv[1] ? argv[1] : "",
                        WTERMSIG(code),
                        WTERMSIG(code) == SIGKILL ? ", perhaps for lack of memory" : "");
    if (WEXITSTATUS(code) != 0)
        return cln_fail(CLN_FAILED, "%s %s: ended with code %d: %s", argv[0],
                        argv[1] ? argv[1] : "", WEXITSTATUS(code), l.last);
    return CLN_OK;
}

/* ---- a program that is written to ---- */

struct cln_command_feed {
    const char *name;
    pid_t pid;
    int to;     /* a socket, so that a program that has ended is an error, not a signal */
    FILE *said; /* its output and errors */
};

static void free_feed(cln_command_feed *f)
{
    if (f->to >= 0)
        close(f->to);
    if (f->said)
        fclose(f->said);
    free(f);
}

/* Waits for the program's end; the error sentence has the last line that it printed. */
static cln_status reap(cln_command_feed *f, bool early)
{
    char line[LINE] = "", last[LINE] = "";
    bool wrong = early;
    int code = 0;
    const bool known = wait_for(f->pid, &code);

    f->pid = 0;
    rewind(f->said);
    while (fgets(line, sizeof line, f->said)) {
        line[strcspn(line, "\r\n")] = 0;
        if (strncmp(line, "ERROR: ld.so:", 13) != 0) /* what it could not preload harms nobody */
            wrong = wrong || strcasestr(line, "error") || strstr(line, "No space left");
        if (line[strspn(line, " \t")])
            memcpy(last, line, sizeof last);
    }
    if (!known)
        return cln_fail(CLN_FAILED, unknown_end, f->name);
    if (!wrong && WIFEXITED(code) && WEXITSTATUS(code) == 0)
        return CLN_OK;
    return cln_fail(CLN_FAILED, "%s: ended with code %d: %s", f->name,
                    WIFEXITED(code) ? WEXITSTATUS(code) : 128 + WTERMSIG(code), last);
}

cln_status cln_command_open(const char *const *argv, cln_command_feed **out)
{
    cln_status st = CLN_OK;
    cln_command_feed *f = NULL;
    int ends[2] = {-1, -1};

    *out = NULL;
    CLN_TRY(cln_alloc(&f, 1, sizeof *f, argv[0]));
    f->name = argv[0];
    f->to = -1;
    f->said = tmpfile();
    if (!f->said || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        CLN_TRY(cln_fail(CLN_FAILED, "%s: cannot make a pipe: %s", argv[0], strerror(errno)));
    f->to = ends[0];
    f->pid = fork();
    if (f->pid == 0) {
        dup2(ends[1], STDIN_FILENO);
        dup2(fileno(f->said), STDOUT_FILENO);
        dup2(fileno(f->said), STDERR_FILENO);
        execvp(argv[0], (char *const *)argv);
        dprintf(STDERR_FILENO, "%s\n", strerror(errno));
        _exit(127);
    }
    close(ends[1]);
    if (f->pid < 0)
        CLN_TRY(cln_fail(CLN_FAILED, "%s: cannot be started: %s", argv[0], strerror(errno)));
    *out = f;
    f = NULL;
done:
    if (f)
        free_feed(f);
    return st;
}

cln_status cln_command_write(cln_command_feed *f, const void *data, size_t bytes)
{
    const char *at = data;

    while (bytes > 0) {
        const ssize_t sent = send(f->to, at, bytes, MSG_NOSIGNAL);

        if (sent < 0 && errno == EINTR)
            continue;
        if (sent <= 0)
            return reap(f, true);
        at += sent;
        bytes -= (size_t)sent;
    }
    return CLN_OK;
}

cln_status cln_command_end(cln_command_feed *f)
{
    cln_status st = CLN_OK;

    close(f->to);
    f->to = -1;
    st = reap(f, false);
    free_feed(f);
    return st;
}

void cln_command_kill(cln_command_feed *f)
{
    if (!f)
        return;
    if (f->pid > 0) {
        kill(f->pid, SIGKILL);
        while (waitpid(f->pid, NULL, 0) < 0 && errno == EINTR)
            ;
    }
    free_feed(f);
}
