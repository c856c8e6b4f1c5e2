/* The progress line as a bar, as plain lines and off, and human-readable figures. Oracle: literal
 * texts. */
#include "unit.h"
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "io/progress.h"
#include "scratch.h"
#include "tests.h"

static int count_of(const char *text, const char *what)
{
    int count = 0;

    for (; (text = strstr(text, what)); text += strlen(what))
        count++;
    return count;
}

/* The output of `show` on stderr; the caller frees it. */
static char *stderr_of(const char *folder, void (*show)(void))
{
    const char *path = scratch_path(folder, "stderr");
    int saved = dup(STDERR_FILENO);
    int file = open(path, O_CREAT | O_TRUNC | O_WRONLY, 0600);
    size_t bytes = 0;

    assert_true(saved >= 0 && file >= 0);
    fflush(stderr);
    assert_int_equal(dup2(file, STDERR_FILENO), STDERR_FILENO);
    show();
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    close(saved);
    close(file);
    return scratch_get(path, &bytes);
}

static void show_steps(const char *mode)
{
    cln_progress *progress = NULL;
    char text[32];

    assert_int_equal(cln_progress_open(mode, &progress), CLN_OK);
    for (int i = 0; i <= 100; i++) {
        snprintf(text, sizeof text, "step %d", i);
        cln_progress_show(progress, i / 100.0, text);
        if (i == 50)
            cln_info("a log line");
    }
    cln_progress_close(progress);
    cln_info("after");
}

static void show_auto(void)
{
    show_steps("auto");
}

static void show_bar(void)
{
    show_steps("bar");
}

static void show_none(void)
{
    show_steps("none");
}

static void progress_off_a_terminal_is_plain_lines(void **state)
{
    char *text = stderr_of(*state, show_auto);

    /* The first line at once, none within ten seconds, the last at the end. */
    assert_string_equal(text, "step 0\na log line\nstep 100\nafter\n");
    free(text);
}

static void progress_as_a_bar_redraws_its_line(void **state)
{
    char *text = stderr_of(*state, show_bar);

    assert_ptr_equal(strstr(text, "\rstep 0\033[K"), text);
    assert_non_null(strstr(text, "\r\033[Ka log line\n\rstep 50\033[K"));
    assert_non_null(strstr(text, "\rstep 100\033[K\nafter\n"));
    assert_in_range(count_of(text, "\rstep"), 3, 20); /* ten a second at most */
    free(text);
}

static void show_two(void)
{
    cln_progress *progress = NULL;

    assert_int_equal(cln_progress_open("bar", &progress), CLN_OK);
    cln_progress_show(progress, 1, "images 9/9 100%");
    cln_progress_show(progress, 1, "timing 2/2 100%");
    cln_progress_show(progress, 1, "timing 3/3 100%"); /* now, or when it is closed */
    cln_progress_close(progress);
}

/* Even if it begins at once and is as far: it may be long. */
static void progress_as_a_bar_shows_other_work_at_once(void **state)
{
    char *text = stderr_of(*state, show_two);

    assert_string_equal(text, "\rimages 9/9 100%\033[K\rtiming 2/2 100%\033[K"
                              "\rtiming 3/3 100%\033[K\n");
    free(text);
}

static void show_fields(void)
{
    cln_progress *progress = NULL;

    assert_int_equal(cln_progress_open("bar", &progress), CLN_OK);
    cln_progress_show(progress, 0,
                      "train 41% | PSNR 27.9 train, 26.4 test | 08:12 trained, 11:47 left | "
                      "step 12,400/30,000 | loss 0.0031");
    cln_progress_close(progress);
}

/* 79 columns off a terminal, which would cut "step 12,4". */
static void progress_as_a_bar_shows_whole_fields(void **state)
{
    char *text = stderr_of(*state, show_fields);

    assert_string_equal(text, "\rtrain 41% | PSNR 27.9 train, 26.4 test | 08:12 trained, 11:47 "
                              "left\033[K\n");
    free(text);
}

static void progress_can_be_off(void **state)
{
    cln_progress *progress = NULL;
    char *text = stderr_of(*state, show_none);

    assert_string_equal(text, "a log line\nafter\n");
    free(text);
    assert_int_equal(cln_progress_open("fancy", &progress), CLN_USAGE);
    assert_null(progress);
    cln_clear_error();
    cln_progress_close(NULL);
}

static void formats_are_for_people(void **state)
{
    static const struct {
        void (*format)(double, char[32]);
        double value;
        const char *text;
    } cases[] = {
        {cln_format_duration, 0, "00:00"},
        {cln_format_duration, 491.6, "08:12"},
        {cln_format_duration, 3723, "1:02:03"},
        {cln_format_duration, NAN, "--:--"},
        {cln_format_duration, 3599.6, "1:00:00"},
        {cln_format_duration, -1, "--:--"},
        {cln_format_bytes, 0, "0 B"},
        {cln_format_bytes, 1023, "1023 B"},
        {cln_format_bytes, 641728512, "612 MiB"},
        {cln_format_bytes, 1288490189, "1.2 GiB"},
        {cln_format_bytes, 1048575, "1.0 MiB"},
        {cln_format_bytes, NAN, "?"},
        {cln_format_count, 0, "0"},
        {cln_format_count, 999, "999"},
        {cln_format_count, 12400, "12,400"},
        {cln_format_count, 1234567, "1,234,567"},
        {cln_format_count, -1234, "-1,234"},
        {cln_format_count, INFINITY, "?"},
        {cln_format_short, 0, "0"},
        {cln_format_short, 950, "950"},
        {cln_format_short, 999.7, "1.0 k"},
        {cln_format_short, 182345, "182 k"},
        {cln_format_short, 3.1e6, "3.1 M"},
        {cln_format_short, 2.5e13, "25.0 T"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[32];
        cases[i].format(cases[i].value, text);
        assert_string_equal(text, cases[i].text);
    }
}

#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)

int test_group_progress(void)
{
    const struct CMUnitTest tests[] = {
        ON_DISK(progress_off_a_terminal_is_plain_lines),
        ON_DISK(progress_as_a_bar_redraws_its_line),
        ON_DISK(progress_as_a_bar_shows_other_work_at_once),
        ON_DISK(progress_as_a_bar_shows_whole_fields),
        ON_DISK(progress_can_be_off),
        cmocka_unit_test(formats_are_for_people),
    };

    return cmocka_run_group_tests_name("progress", tests, NULL, NULL);
}
