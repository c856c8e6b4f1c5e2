/* Films: the bytes of .y4m against values worked out by hand; for other films, the input of a
 * stand-in for ffmpeg. */
#include "unit.h"
#include <dirent.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include "io/film.h"
#include "comma.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

/* black, white; red, blue */
static const uint8_t pictures[2][6] = {{0, 0, 0, 255, 255, 255}, {255, 0, 0, 0, 0, 255}};

/* what ffmpeg gets: even sides, by the last row again */
static const uint8_t sent[24] = {0,   0, 0, 255, 255, 255, 0,   0, 0, 255, 255, 255,
                                 255, 0, 0, 0,   0,   255, 255, 0, 0, 0,   0,   255};

static void assert_bytes(const char *path, const void *want, size_t bytes)
{
    char *text = NULL;
    size_t got = 0;

    assert_int_equal(cln_read_file(path, 4096, &text, &got), CLN_OK);
    assert_int_equal(got, bytes);
    assert_memory_equal(text, want, bytes);
    free(text);
}

static cln_status make(const char *path, bool overwrite)
{
    const cln_film_form form = {.width = 2, .height = 1, .fps = 12.5, .overwrite = overwrite};
    cln_film *film = NULL;
    cln_status st = cln_film_begin(path, &form, &film);

    for (int i = 0; i < 2 && st == CLN_OK; i++)
        st = cln_film_add(film, pictures[i]);
    if (st == CLN_OK)
        return cln_film_end(film);
    cln_film_abandon(film);
    return st;
}

/* BT.709 in the narrow range: red is Y 63, Cb 102, Cr 240; blue Y 32, Cb 240, Cr 118. */
static const char y4m[] = "YUV4MPEG2 W2 H1 F25:2 Ip A1:1 C444\n"
                          "FRAME\n\x10\xEB\x80\x80\x80\x80"
                          "FRAME\n\x3F\x20\x66\xF0\xF0\x76";

static void test_y4m(void **state)
{
    const char *path = scratch_path(*state, "a.y4m");

    assert_int_equal(make(path, false), CLN_OK);
    assert_bytes(path, y4m, sizeof y4m - 1);
    assert_int_equal(make(path, false), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "--overwrite"));
    cln_clear_error();
    assert_int_equal(make(path, true), CLN_OK);
}

/* Puts a shell script as "ffmpeg" on PATH, with nothing else there. */
static void put_ffmpeg(void **state, const char *script)
{
    const char *path = scratch_path(*state, "ffmpeg");

    scratch_put(path, script, strlen(script));
    assert_int_equal(chmod(path, 0755), 0);
}

/* to: the last argument, the file's URL */
#define FFMPEG "#!/bin/sh\nfor to; do :; done\n"

static int count_files(const char *folder)
{
    int files = 0;
    DIR *dir = opendir(folder);

    assert_non_null(dir);
    for (const struct dirent *e = readdir(dir); e; e = readdir(dir))
        files += e->d_name[0] != '.';
    closedir(dir);
    return files;
}

static void test_ffmpeg(void **state)
{
    const char *path = scratch_path(*state, "a.mp4");
    char *own = strdup(getenv("PATH"));
    int warnings = 0;

    assert_int_equal(setenv("PATH", *state, 1), 0);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    assert_int_equal(make(path, false), CLN_OK); /* there is none */
    assert_int_equal(warnings, 1);
    assert_bytes(scratch_path(*state, "a.y4m"), y4m, sizeof y4m - 1);
    assert_false(cln_is_file(path));
    put_ffmpeg(state, FFMPEG "/bin/cat >\"${to#file:}\"\n");
    assert_int_equal(make(path, false), CLN_OK);
    assert_bytes(path, sent, sizeof sent);
    assert_int_equal(make(path, false), CLN_OUTPUT);
    cln_clear_error();
    put_ffmpeg(state, FFMPEG "echo part >\"${to#file:}\"\n/bin/cat >/dev/null\n"
                             "echo no such encoder >&2\nexit 3\n");
    assert_int_equal(make(path, true), CLN_FAILED);
    assert_non_null(strstr(cln_error_text(), "code 3: no such encoder"));
    cln_clear_error();
    assert_int_equal(count_files(*state), 3); /* a.y4m, a.mp4, ffmpeg: no part */
    assert_bytes(path, sent, sizeof sent);    /* the film before stays */
    setenv("PATH", own, 1);
    free(own);
}

/* ffmpeg 5.1 says what it could not write, and ends with 0. */
static void test_full_disk(void **state)
{
    const char *path = scratch_path(*state, "a.mkv");
    char *own = strdup(getenv("PATH"));

    assert_int_equal(setenv("PATH", *state, 1), 0);
    put_ffmpeg(state,
               FFMPEG "/bin/cat >/dev/null\n"
                      "echo \"Error writing trailer of $to: No space left on device\" >&2\n");
    assert_int_equal(make(path, false), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "a.mkv: no room is left"));
    cln_clear_error();
    assert_int_equal(count_files(*state), 1); /* ffmpeg */
    put_ffmpeg(state, FFMPEG "/bin/cat >/dev/null\necho \"Error closing file $to\" >&2\n");
    assert_int_equal(make(path, false), CLN_FAILED); /* there is room: another reason */
    cln_clear_error();
    assert_int_equal(count_files(*state), 1);
    put_ffmpeg(state, FFMPEG "/bin/cat >\"${to#file:}\"\necho a remark >&2\n");
    assert_int_equal(make(path, false), CLN_OK);
    setenv("PATH", own, 1);
    free(own);
}

/* A last column is repeated, too; pictures of even sides, and a GIF's, go as they are. */
static void test_odd_sides(void **state)
{
    static const uint8_t column[2 * 3] = {1, 2, 3, 4, 5, 6};
    static const uint8_t even[2 * 2 * 3] = {1, 2, 3, 1, 2, 3, 4, 5, 6, 4, 5, 6};
    static const uint8_t high[2 * 3 * 3] = {1,  2,  3,  4,  5,  6,  7,  8,  9,
                                            10, 11, 12, 13, 14, 15, 16, 17, 18};
    uint8_t higher[2 * 4 * 3];
    static const char *const names[] = {"a.mp4", "a.gif"};
    char *own = strdup(getenv("PATH"));

    assert_int_equal(setenv("PATH", *state, 1), 0);
    put_ffmpeg(state, FFMPEG "/bin/cat >\"${to#file:}\"\n");
    for (int i = 0; i < 2; i++) {
        const char *path = scratch_path(*state, names[i]);
        const cln_film_form form = {.width = 1, .height = 2, .fps = 25};
        cln_film *film = NULL;

        assert_int_equal(cln_film_begin(path, &form, &film), CLN_OK);
        assert_int_equal(cln_film_add(film, column), CLN_OK);
        assert_int_equal(cln_film_end(film), CLN_OK);
        if (i == 0)
            assert_bytes(path, even, sizeof even);
        else
            assert_bytes(path, column, sizeof column);
    }
    { /* the last column, not the first, again */
        static const uint8_t wide[3 * 2 * 3] = {1,  2,  3,  4,  5,  6,  7,  8,  9,
                                                10, 11, 12, 13, 14, 15, 16, 17, 18};
        static const uint8_t wider[4 * 2 * 3] = {1,  2,  3,  4,  5,  6,  7,  8,  9,  7,  8,  9,
                                                 10, 11, 12, 13, 14, 15, 16, 17, 18, 16, 17, 18};
        const char *path = scratch_path(*state, "c.mp4");
        const cln_film_form form = {.width = 3, .height = 2, .fps = 25};
        cln_film *film = NULL;

        assert_int_equal(cln_film_begin(path, &form, &film), CLN_OK);
        assert_int_equal(cln_film_add(film, wide), CLN_OK);
        assert_int_equal(cln_film_end(film), CLN_OK);
        assert_bytes(path, wider, sizeof wider);
    }
    { /* the last row again */
        const char *path = scratch_path(*state, "b.mp4");
        const cln_film_form form = {.width = 2, .height = 3, .fps = 25};
        cln_film *film = NULL;

        memcpy(higher, high, sizeof high);
        memcpy(higher + sizeof high, high + 12, 6);
        assert_int_equal(cln_film_begin(path, &form, &film), CLN_OK);
        assert_int_equal(cln_film_add(film, high), CLN_OK);
        assert_int_equal(cln_film_end(film), CLN_OK);
        assert_bytes(path, higher, sizeof higher);
    }
    setenv("PATH", own, 1);
    free(own);
}

static void test_rate_in_other_locale(void **state)
{
    const char *path = scratch_path(*state, "a.mp4");
    char *own = NULL;
    cln_status st = CLN_OK;

    comma_locale_begin();
    own = strdup(getenv("PATH"));
    assert_int_equal(setenv("PATH", *state, 1), 0);
    put_ffmpeg(state, FFMPEG "echo \"$*\" >\"${to#file:}\"\n/bin/cat >/dev/null\n"
                             "case \"$*\" in *' -r 25/2 '*) ;; *) exit 1 ;; esac\n");
    st = make(path, false);
    comma_locale_end();
    setenv("PATH", own, 1);
    free(own);
    assert_int_equal(st, CLN_OK);
}

/* Pictures with alpha go as they are, with their last column again, to encoders that keep it; other
 * kinds of film, and one that cannot be made, are refused. */
static void test_alpha(void **state)
{
    static const uint8_t pixels[4] = {1, 2, 3, 4},
                         even[16] = {1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4};
    static const struct {
        const char *name, *words;
    } rows[] = {{"a.mov", "'-pix_fmt rgba '*format=yuva444p10le*' prores_ks '*' 4444 '"},
                {"a.webm", "'-pix_fmt rgba '*format=yuva420p*' libvpx-vp9 '"}};
    const cln_film_form form = {.width = 1, .height = 1, .fps = 25, .alpha = true};
    char *own = strdup(getenv("PATH")), script[512];
    cln_film *film = NULL;

    assert_int_equal(setenv("PATH", *state, 1), 0);
    assert_int_equal(cln_film_begin(scratch_path(*state, "a.mov"), &form, &film), CLN_FAILED);
    assert_non_null(strstr(cln_error_text(), "a film with alpha needs ffmpeg"));
    cln_clear_error();
    assert_int_equal(cln_film_begin(scratch_path(*state, "a.mp4"), &form, &film), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "has no alpha; name it .mov"));
    cln_clear_error();
    assert_true(!cln_film_takes_alpha("a.y4m") && !cln_film_takes_alpha("mov") &&
                cln_film_takes_alpha("b/A.MOV"));
    for (int i = 0; i < 2; i++) {
        const char *path = scratch_path(*state, rows[i].name);

        snprintf(script, sizeof script,
                 FFMPEG "case \"$*\" in *%s*) ;; *) exit 4 ;; esac\n/bin/cat >\"${to#file:}\"\n",
                 rows[i].words);
        put_ffmpeg(state, script);
        assert_int_equal(cln_film_begin(path, &form, &film), CLN_OK);
        assert_int_equal(cln_film_add(film, pixels), CLN_OK);
        assert_int_equal(cln_film_end(film), CLN_OK);
        assert_bytes(path, even, sizeof even);
    }
    setenv("PATH", own, 1);
    free(own);
}

static void test_rates(void **state)
{
    static const struct {
        double fps;
        int64_t num, den;
    } rows[] = {{24, 24, 1},
                {12.5, 25, 2},
                {23.976, 24000, 1001},
                {29.97, 30000, 1001},
                {59.94, 60000, 1001},
                {119.88, 120000, 1001},
                {30000.0 / 1001, 30000, 1001},
                {25000.0 / 1001, 25000, 1001},
                {100.0 / 3, 100, 3},
                {23.97, 2397, 100},
                {29.968, 3746, 125},
                {0.001, 1, 1000},
                {1000, 1000, 1}};
    static const char *const bad[] = {"",
                                      "x",
                                      "24/",
                                      "/2",
                                      "24/0",
                                      "24/-1",
                                      "-1",
                                      "24 ",
                                      "nan",
                                      "1001",
                                      "1/1001",
                                      "24/1/2",
                                      "24.00000000000000000000000000000000x"};
    double fps = 0;
    int64_t num = 0, den = 0;

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_film_rate(rows[i].fps, &num, &den);
        if (num != rows[i].num || den != rows[i].den)
            fail_msg("%.17g is %lld/%lld", rows[i].fps, (long long)num, (long long)den);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (cln_film_read_rate(bad[i], &fps))
            fail_msg("'%s' is read as %g", bad[i], fps);
    assert_true(cln_film_read_rate("30000/1001", &fps) && fps == 30000.0 / 1001);
    assert_true(cln_film_read_rate("23.976", &fps) && fps == 23.976);
}

/* The user's files stay, whatever their names; a colon makes no protocol of a name, and a dash no
 * option. */
static void test_ffmpeg_names(void **state)
{
    const char *part = scratch_path(*state, "take:1.part.mp4");
    char *own = strdup(getenv("PATH")), *here = realpath(".", NULL);

    put_ffmpeg(state, FFMPEG "case $to in file:*) ;; *) exit 4 ;; esac\n"
                             "[ -f \"${to#file:}\" ] || exit 5\n/bin/cat >\"${to#file:}\"\n");
    assert_int_equal(setenv("PATH", *state, 1), 0);
    scratch_put(part, "mine", 4);
    assert_int_equal(chdir(*state), 0);
    assert_int_equal(make("take:1.mp4", false), CLN_OK);
    assert_int_equal(make("-a.mp4", false), CLN_OK);
    assert_int_equal(chdir(here), 0);
    assert_bytes(part, "mine", 4);
    assert_bytes(scratch_path(*state, "take:1.mp4"), sent, sizeof sent);
    assert_bytes(scratch_path(*state, "-a.mp4"), sent, sizeof sent);
    setenv("PATH", own, 1);
    free(own);
    free(here);
}

/* A GIF of more frames a second than it can tell, or than memory has room for, is refused before
 * any is made. */
static void test_gif(void **state)
{
    const char *path = scratch_path(*state, "a.gif");
    cln_film_form form = {.width = 30000, .height = 30000, .frames = 1000000, .fps = 51};
    cln_film *film = NULL;

    assert_fails(cln_film_begin(path, &form, &film), CLN_USAGE, "at most 50 frames a second");
    form.fps = 50;
    assert_fails(cln_film_begin(path, &form, &film), CLN_MEMORY, "all 1000000 frames of a GIF");
    assert_null(film);
    assert_int_equal(count_files(*state), 0);
}

static void test_names(void **state)
{
    (void)state;
    assert_true(cln_film_named("a.mp4") && cln_film_named("x/b.WEBM") && cln_film_named("c.y4m"));
    assert_false(cln_film_named("mp4") || cln_film_named("a.mp4/b") || cln_film_named("d/.mp4") ||
                 cln_film_named("a.png"));
}

int test_group_film(void)
{
#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)
    const struct CMUnitTest tests[] = {
        ON_DISK(test_y4m),           ON_DISK(test_ffmpeg),    ON_DISK(test_ffmpeg_names),
        ON_DISK(test_gif),           ON_DISK(test_alpha),     cmocka_unit_test(test_rates),
        ON_DISK(test_full_disk),     ON_DISK(test_odd_sides), ON_DISK(test_rate_in_other_locale),
        cmocka_unit_test(test_names)};

    return cmocka_run_group_tests_name("film", tests, NULL, NULL);
}
