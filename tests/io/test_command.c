/* Other programs (io/command.h), a shell that stands for them: the lines of its output and errors
 * whatever ends them, the log, and the last line in the error. */
#include "unit.h"
#include <signal.h>
#include <string.h>
#include <sys/time.h>
#include "base/callbacks.h"
#include "io/command.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

static void keep_line(const char *line, void *user)
{
    strcat(user, line);
    strcat(user, "|");
}

static int stop_at_once(void *user)
{
    (void)user;
    return SIGTERM;
}

static int answer_with(void *user)
{
    return *(const int *)user;
}

/* Whatever else a caller's poll answers than 0 and the signals that are told apart stops. */
static void test_polls(void **state)
{
    static const int cases[][2] = {{0, 0},           {1, SIGINT},        {-1, SIGINT},
                                   {SIGINT, SIGINT}, {SIGTERM, SIGTERM}, {SIGUSR1, SIGUSR1}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int answer = cases[i][0];
        const cln_callbacks callbacks = {.interrupted = answer_with, .user = &answer};

        assert_int_equal(cln_poll_signal(&callbacks), cases[i][1]);
    }
}

static void test_lines(void **state)
{
    static const char script[] =
        "printf 'one\\ntwo\\r 3 %%\\r\\n'; printf 'last\\n \\n' >&2; exit 7";
    const char *const argv[] = {"sh", "-c", script, NULL};
    char lines[256] = "", *log = NULL;
    const char *path = scratch_path(*state, "log");
    const cln_command_watch watch = {.line = keep_line, .user = lines, .log = fopen(path, "w")};
    size_t bytes = 0;

    assert_non_null(watch.log);
    assert_fails(cln_command_run(argv, &watch), CLN_FAILED, "sh -c: ended with code 7: last");
    fclose(watch.log);
    assert_string_equal(lines, "one|two| 3 %||last| |");
    log = scratch_get(path, &bytes);
    assert_memory_equal(log, "$ sh -c ", 8);
    assert_non_null(strstr(log, "\none\ntwo\r 3 %\r\nlast\n \n"));
    free(log);
}

static void test_ends(void **state)
{
    const char *const silent[] = {"sh", "-c", "printf 'not ended'", NULL};
    const char *const killed[] = {"sh", "-c", "kill -9 $$", NULL};
    const char *const missing[] = {"no such program", NULL};
    const char *const sleeps[] = {"sleep", "60", NULL};
    char lines[256] = "";
    const cln_command_watch none = {0}, watch = {.line = keep_line, .user = lines};
    const cln_command_watch stopped = {.interrupted = stop_at_once};

    (void)state;
    assert_int_equal(cln_command_run(silent, &watch), CLN_OK);
    assert_string_equal(lines, "not ended|");
    assert_fails(cln_command_run(killed, &none), CLN_FAILED, "ended by signal 9, perhaps for lack");
    assert_fails(cln_command_run(missing, &none), CLN_FAILED, "no such program: No such file");
    assert_fails(cln_command_run(sleeps, &stopped), CLN_SIGTERM, "stopped by a signal in `sleep`");
    assert_true(cln_command_found("sh") && !cln_command_found("no such program"));
}

/* A process that ignores its children never hears how they ended. */
static void test_ignored_children(void **state)
{
    const char *const ends[] = {"sh", "-c", "exit 7", NULL};
    const cln_command_watch none = {0};
    cln_command_feed *feed = NULL;

    (void)state;
    signal(SIGCHLD, SIG_IGN);
    assert_fails(cln_command_run(ends, &none), CLN_FAILED, "sh: how it ended is not known");
    assert_int_equal(cln_command_open(ends, &feed), CLN_OK);
    assert_fails(cln_command_end(feed), CLN_FAILED, "sh: how it ended is not known");
    signal(SIGCHLD, SIG_DFL);
}

static void ring(int number)
{
    (void)number;
}

/* Signals end a write to a program that reads late half way. */
static void test_interrupted_write(void **state)
{
    enum { BYTES = 1 << 20 };
    static uint8_t data[BYTES];
    const char *path = scratch_path(*state, "written");
    const char *const argv[] = {"sh", "-c", "sleep 0.2; cmp - \"$0\"", path, NULL};
    const struct sigaction rings = {.sa_handler = ring};
    const struct itimerval often = {{0, 10000}, {0, 10000}}, never = {{0, 0}, {0, 0}};
    struct sigaction before;
    cln_command_feed *feed = NULL;
    FILE *f = fopen(path, "wb");

    for (uint32_t i = 0; i < BYTES; i++)
        data[i] = (uint8_t)(i ^ i >> 8 ^ i >> 16);
    assert_int_equal(fwrite(data, 1, BYTES, f), BYTES);
    fclose(f);
    assert_ok(cln_command_open(argv, &feed));
    assert_int_equal(sigaction(SIGALRM, &rings, &before), 0);
    setitimer(ITIMER_REAL, &often, NULL);
    assert_ok(cln_command_write(feed, data, BYTES));
    setitimer(ITIMER_REAL, &never, NULL);
    sigaction(SIGALRM, &before, NULL);
    assert_ok(cln_command_end(feed));
}

int test_group_command(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_lines, scratch_make, scratch_remove),
        cmocka_unit_test(test_polls),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_ignored_children),
        cmocka_unit_test_setup_teardown(test_interrupted_write, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("command", tests, NULL, NULL);
}
