/* How long the film of a viewer lives (view/reel.h): while its page asks for frames, and not much
 * longer; the finished one long enough to be fetched. Without ffmpeg, so that files are y4m. */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "outcome.h"
#include "scratch.h"
#include "tests.h"
#include "view/reel.h"

enum { WIDE = 16, HIGH = 16, FRAMES = 3, MINUTE = 60, HOUR = 3600 };

static const cln_ask film = {.width = WIDE, .height = HIGH, .frames = FRAMES, .fps = 24};
static const uint8_t picture[WIDE * HIGH * 3];

static void begin(cln_reel *reel)
{
    memset(reel, 0, sizeof *reel);
    assert_ok(cln_reel_begin(reel, &film));
    assert_true(cln_is_dir(reel->folder));
}

static void assert_gone(const cln_reel *reel, const char *folder)
{
    assert_int_equal(reel->name[0], 0);
    assert_null(reel->film);
    assert_false(cln_is_dir(folder));
}

/* Dropped once nobody asked for minutes on end; each frame begins these anew. */
static void test_unfinished(void **state)
{
    cln_reel reel;
    char folder[PATH_MAX];

    (void)state;
    begin(&reel);
    snprintf(folder, sizeof folder, "%s", reel.folder);
    for (int i = 0; i < FRAMES; i++) {
        cln_reel_tend(&reel, MINUTE);
        cln_reel_tend(&reel, MINUTE / 2);
        assert_ok(cln_reel_add(&reel, picture));
    }
    for (int i = 0; i < 3; i++) {
        assert_true(cln_is_dir(folder));
        cln_reel_tend(&reel, MINUTE);
    }
    assert_gone(&reel, folder);
    cln_reel_tend(&reel, HOUR); /* of none */
    begin(&reel);
    snprintf(folder, sizeof folder, "%s", reel.folder);
    cln_reel_tend(&reel, MINUTE); /* the one before does not count */
    assert_true(cln_is_dir(folder));
    cln_reel_drop(&reel);
    assert_gone(&reel, folder);
}

/* The finished film has no name on the disk, can be read for the better part of an hour, and not
 * for hours. */
static void test_whole(void **state)
{
    cln_reel reel;
    char folder[PATH_MAX], bytes[9];

    (void)state;
    begin(&reel);
    snprintf(folder, sizeof folder, "%s", reel.folder);
    for (int i = 0; i < FRAMES; i++)
        assert_ok(cln_reel_add(&reel, picture));
    cln_reel_tend(&reel, MINUTE + MINUTE / 2);
    assert_ok(cln_reel_end(&reel)); /* an hour begins */
    assert_false(cln_is_dir(folder));
    for (int i = 0; i < 59; i++)
        cln_reel_tend(&reel, MINUTE);
    assert_true(reel.whole && reel.name[0]);
    assert_int_equal(pread(reel.file, bytes, sizeof bytes, 0), sizeof bytes);
    assert_memory_equal(bytes, "YUV4MPEG2", sizeof bytes);
    for (int i = 0; i < 20; i++)
        cln_reel_tend(&reel, MINUTE);
    assert_gone(&reel, folder);
    assert_false(reel.whole);
}

static char *own_path, *own_tmpdir;

static int setup(void **state)
{
    own_path = strdup(getenv("PATH"));
    own_tmpdir = getenv("TMPDIR") ? strdup(getenv("TMPDIR")) : NULL;
    if (scratch_make(state) != 0)
        return -1;
    return setenv("TMPDIR", *state, 1) || setenv("PATH", *state, 1);
}

static int teardown(void **state)
{
    setenv("PATH", own_path, 1);
    if (own_tmpdir)
        setenv("TMPDIR", own_tmpdir, 1);
    else
        unsetenv("TMPDIR");
    free(own_path);
    free(own_tmpdir);
    return scratch_remove(state);
}

int test_group_reel(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_unfinished),
        cmocka_unit_test(test_whole),
    };

    return cmocka_run_group_tests_name("reel", tests, setup, teardown);
}
