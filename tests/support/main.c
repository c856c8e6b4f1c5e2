/* build/tests: runs each test group in its own process, so that a crash, a sanitizer's report or a
 * hang is one failure and does not end the run.
 *
 *   build/tests               all groups
 *   build/tests NAME...       some; NAME/PATTERN runs the tests of a group that match (* and ?)
 *   build/tests -l            lists the groups
 *   build/tests -v            also shows passed tests
 *   build/tests -x            ends at the first failed test, for tests/mutate.sh
 *
 * The last line is "N passed, N failed", and ", N skipped" if any were; exit code 1 if any failed.
 * It counts cmocka's output: a test that started and did not end well has failed. */
#include "unit.h"
#include <errno.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#endif
#include "base/log.h"
#include "tests.h"

enum { GROUP_SECONDS = 900 }; /* longer means a hang */

typedef struct counts {
    int passed, failed, skipped;
} counts;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static bool starts(const char *line, const char *with)
{
    return !strncmp(line, with, strlen(with));
}

/* Checks for leaks and ends a group's process without the driver's destructors, whose threads may
 * still run. PoCL's threads report their end before they release their last objects (its
 * clReleaseContext.c), so only memory that is still allocated half a second later counts. */
static _Noreturn void leave(int status)
{
    fflush(NULL);
#ifdef __SANITIZE_ADDRESS__
    if (__lsan_do_recoverable_leak_check()) {
        usleep(500000);
        if (__lsan_do_recoverable_leak_check())
            status = 23;
    }
#endif
    _exit(status);
}

static void run_child(const test_group *group, const char *pattern, int out)
{
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    close(out);
    setvbuf(stdout, NULL, _IOLBF, 0);
    cmocka_set_message_output(CM_OUTPUT_STDOUT);
    if (pattern)
        cmocka_set_test_filter(pattern);
    cln_log_set_sink(cln_log_stderr, NULL);
    alarm(GROUP_SECONDS);
    leave(group->run() ? 1 : 0);
}

/* Copies the child's lines (cmocka's progress only if verbose) and counts its tests. A failed test
 * ends the child if its number is given. */
static counts read_child(int in, bool verbose, pid_t end_if_failed)
{
    counts c = {0, 0, 0};
    FILE *stream = fdopen(in, "r");
    char *line = NULL;
    size_t size = 0;
    bool over = false, report = false; /* report: a sanitizer's */
    int begun = 0, teardown = 0;

    while (stream && getline(&line, &size, stream) >= 0) {
        bool chatter = starts(line, "[ RUN      ]") || starts(line, "[==========]") ||
                       starts(line, "[  PASSED  ]") || strstr(line, "[       OK ] ");
        over = over || (starts(line, "[==========]") && strstr(line, " run."));
        if (!over) { /* the summary repeats failed and skipped tests */
            begun += strstr(line, "[ RUN      ]") != NULL;
            teardown += strstr(line, "GROUP TEARDOWN") != NULL;
            c.passed += strstr(line, "[       OK ] ") != NULL;
            c.skipped += strstr(line, "[  SKIPPED ] ") != NULL;
        }
        report = report || (starts(line, "==") && strstr(line, "ERROR: "));
        if (verbose || report || !(chatter || over))
            fputs(line, stdout);
        if (end_if_failed > 0 && !over && starts(line, "[  FAILED  ]")) {
            kill(end_if_failed, SIGKILL);
            break;
        }
    }
    free(line);
    if (stream)
        fclose(stream);
    c.failed = begun - c.passed - c.skipped + teardown;
    if (c.failed < 0) /* a line was torn apart */
        c.failed = 1;
    return c;
}

static counts run_group(const test_group *group, const char *pattern, bool verbose, bool first)
{
    counts c = {0, 1, 0};
    int ends[2], status = 0;
    double start = now();

    fflush(stdout);
    if (pipe(ends)) {
        printf("%s: no pipe: %s\n", group->name, strerror(errno));
        return c;
    }
    pid_t child = fork();
    if (child == 0) {
        close(ends[0]);
        run_child(group, pattern, ends[1]);
    }
    close(ends[1]);
    if (child < 0) {
        printf("%s: no process: %s\n", group->name, strerror(errno));
        close(ends[0]);
        return c;
    }
    c = read_child(ends[0], verbose, first ? child : 0);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (WIFSIGNALED(status))
        printf("%s: ended by signal %d (%s)\n", group->name, WTERMSIG(status),
               strsignal(WTERMSIG(status)));
    else if (WEXITSTATUS(status) && !c.failed)
        printf("%s: exit status %d after its tests\n", group->name, WEXITSTATUS(status));
    if (status && !c.failed)
        c.failed = 1;
    printf("%-12s %4d passed, %d failed, %d skipped, %.1f s\n", group->name, c.passed, c.failed,
           c.skipped, now() - start);
    return c;
}

/* Does the argument `wanted` (NAME or NAME/PATTERN) select this group? */
static bool wants(const char *wanted, const char *name, const char **pattern)
{
    size_t length = strcspn(wanted, "/");

    if (strlen(name) != length || strncmp(wanted, name, length))
        return false;
    *pattern = wanted[length] ? wanted + length + 1 : NULL;
    return true;
}

int main(int argc, char **argv)
{
    counts total = {0, 0, 0};
    bool verbose = false, first = false;
    int option;

    while ((option = getopt(argc, argv, "lvx")) != -1) {
        if (option == 'l') {
            for (const test_group *g = test_groups; g->name; g++)
                puts(g->name);
            return 0;
        }
        if (option != 'v' && option != 'x') {
            fputs("usage: tests [-l] [-v] [-x] [GROUP[/PATTERN]...]\n", stderr);
            return 2;
        }
        verbose = verbose || option == 'v';
        first = first || option == 'x';
    }
    for (int i = optind; (i < argc || i == optind) && !(first && total.failed); i++) {
        bool found = false;
        for (const test_group *g = test_groups; g->name && !(first && total.failed); g++) {
            const char *pattern = NULL;
            if (i < argc && !wants(argv[i], g->name, &pattern))
                continue;
            found = true;
            counts c = run_group(g, pattern, verbose, first);
            total.passed += c.passed;
            total.failed += c.failed;
            total.skipped += c.skipped;
        }
        if (!found) {
            printf("%s: no such group\n", i < argc ? argv[i] : "test_groups");
            total.failed++;
        }
    }
    printf("%d passed, %d failed", total.passed, total.failed);
    if (total.skipped)
        printf(", %d skipped", total.skipped);
    putchar('\n');
    return total.failed > 0;
}
