/* A process's turn at compiling (device/cache.h): who has it, who waits and until when, and that
 * nothing stands still where no lock can be had. Oracle: locks of this process, taken by hand. */
#include "unit.h"
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include "device/cache.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

static const char pocl[] = "Portable Computing Language";
static char *kept; /* POCL_CACHE_DIR of the tests, or NULL */

/* Makes DIR/cache the folder of kernels, if it is given, else what it was before. */
static const char *use_cache(const char *dir)
{
    const char *path = dir ? scratch_path(dir, "cache") : kept;

    if (path)
        setenv("POCL_CACHE_DIR", path, 1);
    else
        unsetenv("POCL_CACHE_DIR");
    return path;
}

static int make(void **state)
{
    const char *before = getenv("POCL_CACHE_DIR");

    kept = before ? strdup(before) : NULL;
    unsetenv("POCL_KERNEL_CACHE");
    cln_log_set_level(CLN_LOG_WARN);
    return scratch_make(state);
}

static int restore(void **state)
{
    use_cache(NULL);
    free(kept);
    cln_log_set_level(CLN_LOG_INFO);
    return scratch_remove(state);
}

/* Opens the lock as another process would. */
static int other(const char *cache)
{
    const int file = open(scratch_path(cache, "cl-nascent.lock"), O_RDWR | O_CREAT, 0666);

    assert_true(file >= 0);
    return file;
}

static void one_has_its_turn(void **state)
{
    const char *cache = use_cache(*state);
    cln_cache_turn turn = {.due = true};
    int file = -1;

    assert_ok(cln_cache_take_turn("another's", true, NULL, &turn));
    assert_true(turn.due && !turn.held);
    assert_ok(cln_cache_take_turn(pocl, false, NULL, &turn)); /* no program is there */
    assert_true(turn.held && !turn.due);
    file = other(cache);
    assert_int_not_equal(flock(file, LOCK_EX | LOCK_NB), 0);
    assert_ok(cln_cache_take_turn(pocl, true, NULL, &turn)); /* it has one */
    cln_cache_end_turn(&turn);
    assert_int_equal(flock(file, LOCK_EX | LOCK_NB), 0);
    close(file);
    assert_ok(cln_cache_take_turn(pocl, true, NULL, &turn)); /* none is due any more */
    assert_false(turn.held);
    cln_cache_end_turn(&turn);
}

/* With programs in the folder only who compiles takes a turn, and waits. */
static void who_finds_programs_goes_on(void **state)
{
    const char *cache = use_cache(*state);
    cln_cache_turn turn = {.due = true};
    int file = -1;

    assert_ok(cln_make_dirs(scratch_path(cache, "AP")));
    file = other(cache);
    assert_int_equal(flock(file, LOCK_EX), 0);
    assert_ok(cln_cache_take_turn(pocl, false, NULL, &turn));
    assert_true(turn.due && !turn.held);
    close(file);
    assert_ok(cln_cache_take_turn(pocl, true, NULL, &turn));
    assert_true(turn.held);
    cln_cache_end_turn(&turn);
}

/* Says SIGTERM when it is asked for the third time. */
static int stop_soon(void *user)
{
    return ++*(int *)user == 3 ? SIGTERM : 0;
}

static void a_signal_ends_the_wait(void **state)
{
    const char *cache = use_cache(*state);
    cln_cache_turn turn = {.due = true};
    int asked = 0, file = -1;
    const cln_callbacks callbacks = {.interrupted = stop_soon, .user = &asked};

    assert_ok(cln_make_dirs(cache));
    file = other(cache);
    assert_int_equal(flock(file, LOCK_EX), 0);
    assert_fails(cln_cache_take_turn(pocl, false, &callbacks, &turn), CLN_SIGTERM, "");
    assert_false(turn.held);
    close(file);
}

/* The other one is killed: its turn ends, and who waited goes on without one. */
static void the_wait_ends_with_the_process(void **state)
{
    const char *cache = use_cache(*state);
    cln_cache_turn turn = {.due = true};
    int ready[2], file = -1;
    char byte = 0;
    pid_t child = -1;

    assert_ok(cln_make_dirs(cache));
    assert_int_equal(pipe(ready), 0);
    child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        cln_cache_turn its = {.due = true};

        if (cln_cache_take_turn(pocl, false, NULL, &its) != CLN_OK || !its.held ||
            write(ready[1], "x", 1) != 1)
            _exit(1);
        usleep(300000);
        raise(SIGKILL);
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    assert_ok(cln_cache_take_turn(pocl, false, NULL, &turn));
    assert_true(!turn.held && !turn.due && turn.waited > 0);
    assert_int_equal(waitpid(child, NULL, 0), child);
    file = other(cache);
    assert_int_equal(flock(file, LOCK_EX | LOCK_NB), 0); /* who waited keeps no lock */
    close(file);
    close(ready[0]);
    close(ready[1]);
}

static void without_a_lock_it_goes_on(void **state)
{
    const char *cache = use_cache(*state);
    cln_cache_turn turn = {.due = true};

    assert_ok(cln_make_dirs(scratch_path(cache, "cl-nascent.lock")));
    assert_ok(cln_cache_take_turn(pocl, false, NULL, &turn));
    assert_true(!turn.held && !turn.due);
    setenv("POCL_CACHE_DIR", "/proc/none", 1); /* cannot be made */
    turn.due = true;
    assert_ok(cln_cache_take_turn(pocl, false, NULL, &turn));
    assert_true(!turn.held && !turn.due);
    assert_string_equal(cln_error_text(), "");
}

int test_group_cache(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(one_has_its_turn, make, restore),
        cmocka_unit_test_setup_teardown(who_finds_programs_goes_on, make, restore),
        cmocka_unit_test_setup_teardown(a_signal_ends_the_wait, make, restore),
        cmocka_unit_test_setup_teardown(the_wait_ends_with_the_process, make, restore),
        cmocka_unit_test_setup_teardown(without_a_lock_it_goes_on, make, restore),
    };

    return cmocka_run_group_tests_name("cache", tests, NULL, NULL);
}
