/* What the program tells people of itself (cli/help.h, cli/console.h, docs/cl-nascent.1): help and
 * manual name what the option tables hold, with ranges, words and defaults, within 80 columns; the
 * live line reads as the manual shows it; signals reach who polls for them. Oracle: the tables, and
 * texts written down here. */
#include "unit.h"
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include "cli/console.h"
#include "cli/help.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

/* What a printer writes, as one text with single spaces; the caller frees it. */
static char *printed(void (*print)(FILE *, const cln_command *), const cln_command *command,
                     bool flat)
{
    char *text = NULL, *to = NULL;
    size_t bytes = 0;
    FILE *stream = open_memstream(&text, &bytes);

    assert_non_null(stream);
    print(stream, command);
    assert_int_equal(fclose(stream), 0);
    if (!flat)
        return text;
    to = text;
    for (const char *from = text; *from; from++) {
        bool space = *from == ' ' || *from == '\n';
        if (!space)
            *to++ = *from;
        else if (to > text && to[-1] != ' ')
            *to++ = ' ';
    }
    *to = 0;
    return text;
}

static void help_names_every_option_with_its_defaults(void **state)
{
    (void)state;
    for (int c = 0; c < cln_command_count; c++) {
        const cln_command *command = &cln_commands[c];
        char *text = printed(cln_help_print, command, true);
        char wanted[128];

        for (int i = 0; i < cln_arg_count; i++) {
            snprintf(wanted, sizeof wanted, "--%s%s ", cln_args[i].negatable ? "[no-]" : "",
                     cln_args[i].name);
            if (cln_command_takes_arg(command, &cln_args[i]) && !strstr(text, wanted))
                fail_msg("help %s: no %s", command->name, wanted);
        }
        for (int i = 0; i < cln_config_row_count; i++) {
            const cln_config_row *row = &cln_config_rows[i];
            const bool is_switch = cln_config_is_switch(row);

            snprintf(wanted, sizeof wanted, "--%s%s%s", is_switch ? "[no-]" : "", row->option,
                     is_switch && row->words ? "=" : " ");
            if (cln_command_takes_row(command, row) && !strstr(text, wanted))
                fail_msg("help %s: no %s", command->name, wanted);
        }
        free(text);
    }
}

static void help_shows_ranges_words_and_presets(void **state)
{
    char *text = printed(cln_help_print, cln_command_find("train"), true);
    char wanted[1024], voxel[CLN_TEXT_BYTES], fast[CLN_TEXT_BYTES], paper[CLN_TEXT_BYTES];
    cln_config in_voxel, in_fast, in_paper;
    const cln_config_row *row = cln_config_find("n1");

    (void)state;
    assert_non_null(row);
    assert_int_equal(cln_config_preset("voxel", &in_voxel), CLN_OK);
    assert_int_equal(cln_config_preset("fast", &in_fast), CLN_OK);
    assert_int_equal(cln_config_preset("paper", &in_paper), CLN_OK);
    cln_config_text(&in_voxel, row, voxel);
    cln_config_text(&in_fast, row, fast);
    cln_config_text(&in_paper, row, paper);
    assert_string_not_equal(fast, paper);
    snprintf(wanted, sizeof wanted, "(2 to 128; voxel %s, fast %s, paper %s)", voxel, fast, paper);
    assert_non_null(strstr(text, wanted));
    assert_non_null(strstr(text, "voxel and fast 0.7, paper 0)")); /* --regrow */
    assert_non_null(strstr(text, "default 0.25)"));                /* --uniform-share */
    assert_non_null(strstr(text, "--cull guarded|mean "));
    assert_non_null(strstr(text, "CL_NASCENT_DEVICE"));
    assert_non_null(strstr(text, "also --t-min)"));
    assert_null(strstr(text, "  --t-min"));
    free(text);
}

static void print_kilonerf(FILE *to, const cln_command *command)
{
    assert_int_equal(cln_help_print_preset(to, command, "kilonerf"), CLN_OK);
}

static void help_lists_a_presets_values(void **state)
{
    const cln_command *command = cln_command_find("train");
    char *text = printed(print_kilonerf, command, true), wanted[64];

    (void)state;
    for (int i = 0; i < cln_config_row_count; i++) {
        snprintf(wanted, sizeof wanted, " --%s ", cln_config_rows[i].option);
        if (cln_command_takes_row(command, &cln_config_rows[i]) && !strstr(text, wanted))
            fail_msg("help train --preset kilonerf: no %s", wanted);
    }
    assert_non_null(strstr(text, " --depth 2 (3) --view-width 32 --bands 10 (6) "));
    assert_non_null(strstr(text, " --level-at none (3:"));
    free(text);
    assert_int_equal(cln_help_print_preset(stdout, command, "mine"), CLN_USAGE);
    cln_clear_error();
}

static void help_fits_eighty_columns(void **state)
{
    (void)state;
    for (int c = -1; c < cln_command_count; c++) {
        char *text = printed(cln_help_print, c < 0 ? NULL : &cln_commands[c], false);
        for (const char *at = text; *at; at += strcspn(at, "\n"), at += *at == '\n') {
            if (strcspn(at, "\n") > 80)
                fail_msg("%.*s", (int)strcspn(at, "\n"), at);
        }
        free(text);
    }
}

/* Whether a text has --NAME, and not only as the beginning of a longer option. */
static bool has_option(const char *text, const char *name)
{
    char wanted[64];

    snprintf(wanted, sizeof wanted, "--%s", name);
    for (const char *at = text; (at = strstr(at, wanted)); at++) {
        const char after = at[strlen(wanted)];

        if (after != '-' && !isalnum((unsigned char)after))
            return true;
    }
    return false;
}

static void manual_names_every_option(void **state)
{
    char *page = NULL, *to = NULL;
    size_t bytes = 0;

    (void)state;
    if (!cln_is_file("docs/cl-nascent.1"))
        skip(); /* not run from the repository's root */
    page = scratch_get("docs/cl-nascent.1", &bytes);
    to = page;
    for (const char *from = page; *from; from++) {
        if (*from != '\\')
            *to++ = *from;
    }
    *to = 0;
    for (int i = 0; i < cln_arg_count; i++) {
        if (!has_option(page, cln_args[i].name))
            fail_msg("docs/cl-nascent.1: no --%s", cln_args[i].name);
        if (cln_args[i].env && !strstr(page, cln_args[i].env))
            fail_msg("docs/cl-nascent.1: no %s", cln_args[i].env);
    }
    for (int i = 0; i < cln_config_row_count; i++)
        if (!has_option(page, cln_config_rows[i].option))
            fail_msg("docs/cl-nascent.1: no --%s", cln_config_rows[i].option);
    free(page);
}

/* ---- the live line ---- */

static void train_line_reads_as_the_manual_says(void **state)
{
    cln_train_progress p = {.step = 12400,
                            .steps = 30000,
                            .fraction = 0.4133,
                            .seconds = 492,
                            .eta = 707,
                            .rays_per_s = 182000,
                            .loss = 0.0031,
                            .psnr_train = 27.9,
                            .psnr_test = 26.4,
                            .leaves = 1184,
                            .params = 3.1e6,
                            .device_bytes = 612.0 * 1024 * 1024};
    char text[512];

    (void)state;
    cln_train_line(&p, text, sizeof text);
    assert_string_equal(text,
                        "train 41% | PSNR 27.9 train, 26.4 test | 11:47 left | 08:12 trained | "
                        "step 12,400/30,000 | 182 k rays/s | loss 0.0031 | 1,184 leaves 3.1 M "
                        "params | 612 MiB dev");
    p.steps = 0;
    p.psnr_test = NAN;
    p.eta = INFINITY;
    p.unmeasured = 1;
    p.unmeasured_seconds = 42;
    cln_train_line(&p, text, sizeof text);
    assert_string_equal(
        text, "train 41% | PSNR 27.9 train | --:-- left | "
              "evaluation ~00:42 more | 08:12 trained | step 12,400 | 182 k rays/s | loss 0.0031 | "
              "1,184 leaves 3.1 M params | "
              "612 MiB dev");
    cln_train_line(&p, text, 20); /* cut, not overrun */
    assert_int_equal(strlen(text), 19);
}

/* ---- signals ---- */

static void deaf(int number)
{
    (void)number;
}

static void signals_reach_the_poll(void **state)
{
    cln_options options = {.progress = "none"};
    cln_console console;

    (void)state;
    cln_log_set_level(CLN_LOG_WARN);
    assert_int_equal(cln_console_open(&options, &console), CLN_OK);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), 0);
    raise(SIGUSR1);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), SIGUSR1);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), 0); /* once */
    signal(SIGUSR1, deaf); /* as a kernel compiler in this process does */
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), 0);
    raise(SIGUSR1);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), SIGUSR1);
    signal(SIGUSR2, deaf);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), 0);
    raise(SIGUSR2);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), SIGTERM);
    assert_int_equal(console.callbacks.interrupted(console.callbacks.user), SIGTERM); /* stays */
    cln_console_close(&console);
    cln_log_set_level(CLN_LOG_INFO);
}

/* As when the command began, whatever a kernel compiler does. */
static void quit_ends_at_once(void **state)
{
    cln_options options = {.progress = "none"};
    void (*const before[])(int) = {SIG_DFL, SIG_IGN};
    cln_console console;
    struct sigaction now;

    (void)state;
    for (int i = 0; i < 2; i++) {
        signal(SIGQUIT, before[i]);
        assert_int_equal(cln_console_open(&options, &console), CLN_OK);
        signal(SIGQUIT, deaf);
        assert_int_equal(console.callbacks.interrupted(console.callbacks.user), 0);
        assert_int_equal(sigaction(SIGQUIT, NULL, &now), 0);
        assert_true(now.sa_handler == before[i]);
        cln_console_close(&console);
    }
    signal(SIGQUIT, SIG_DFL);
}

static void second_stop_leaves_at_once(void **state)
{
    cln_options options = {.progress = "none"};
    cln_console console;
    int status = 0;
    pid_t child = fork();

    (void)state;
    assert_true(child >= 0);
    if (child == 0) {
        if (cln_console_open(&options, &console) != CLN_OK)
            _exit(1);
        raise(SIGINT);
        if (console.callbacks.interrupted(console.callbacks.user) != SIGINT)
            _exit(2);
        raise(SIGTERM); /* at once: the same wish, as timeout(1) sends it to the group, too */
        if (console.callbacks.interrupted(console.callbacks.user) != SIGINT)
            _exit(3);
        usleep(600000);
        raise(SIGXCPU); /* another than before, so that the end tells which of them it was */
        _exit(4);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), SIGXCPU);
}

/* The program's help: every command's name and purpose, with a space between them. */
static void commands_stand_apart_from_purposes(void **state)
{
    char *text = printed(cln_help_print, NULL, true);
    char wanted[256];

    (void)state;
    for (int c = 0; c < cln_command_count; c++) {
        snprintf(wanted, sizeof wanted, " %s %s", cln_commands[c].name, cln_commands[c].purpose);
        if (!strstr(text, wanted))
            fail_msg("help: no '%s'", wanted);
    }
    free(text);
}

/* What help prints of one option, as one line of text. */
static const char *wanted_option, *wanted_command;

static void print_option(FILE *to, const cln_command *command)
{
    (void)command;
    assert_int_equal(cln_help_print_option(to,
                                           wanted_command ? cln_command_find(wanted_command) : NULL,
                                           wanted_option),
                     CLN_OK);
}

static void help_tells_one_option(void **state)
{
    static const char *const rows[][4] = {
        /* command, option; what is printed, what is not */
        {NULL, "--orbit", "--orbit, of render:", "--circle"},
        {NULL, "orbit", "--orbit [FRAMES]", "--circle"},
        {NULL, "-o", "--output, of train: -o, --output RUN", "-d"},
        {NULL, "--output=x", "--output, of poses:", "--up"},
        {"eval", "--output", "(default RUN/eval)", "--output SCENE"},
        {"train", "--no-adaptive", "--[no-]adaptive", "--orbit"},
        {NULL, "no-adaptive", "--[no-]adaptive", "--orbit"},
        {NULL, "--n1", "--n1, of train, check: --n1 N", "--n2"},
        {"train", "--t-min", "also --t-min", "--orbit"}};
    FILE *none = NULL;

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char *text = NULL;

        wanted_command = rows[i][0];
        wanted_option = rows[i][1];
        text = printed(print_option, NULL, true);
        if (!strstr(text, rows[i][2]) || strstr(text, rows[i][3]))
            fail_msg("help %s: %s", rows[i][1], text);
        free(text);
    }
    none = fopen("/dev/null", "w");
    assert_non_null(none);
    assert_fails(cln_help_print_option(none, NULL, "--orbitz"), CLN_USAGE, "no command");
    assert_fails(cln_help_print_option(none, cln_command_find("render"), "--lr"), CLN_USAGE,
                 "--lr is not an option of render");
    assert_fails(cln_help_print_option(none, cln_command_find("train"), "--orbit"), CLN_USAGE,
                 "only of render");
    assert_fails(cln_help_print_option(none, cln_command_find("train"), "--no-width"), CLN_USAGE,
                 "--width is not a switch");
    assert_fails(cln_help_print_option(none, NULL, "--no-orbit"), CLN_USAGE, "no command");
    assert_non_null(cln_command_of_option("no-adaptive"));
    assert_null(cln_command_of_option("no-width"));
    fclose(none);
}

int test_group_help(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(help_names_every_option_with_its_defaults),
        cmocka_unit_test(help_lists_a_presets_values),
        cmocka_unit_test(help_tells_one_option),
        cmocka_unit_test(commands_stand_apart_from_purposes),
        cmocka_unit_test(help_shows_ranges_words_and_presets),
        cmocka_unit_test(help_fits_eighty_columns),
        cmocka_unit_test(manual_names_every_option),
        cmocka_unit_test(train_line_reads_as_the_manual_says),
        cmocka_unit_test(signals_reach_the_poll),
        cmocka_unit_test(quit_ends_at_once),
        cmocka_unit_test(second_stop_leaves_at_once),
    };

    return cmocka_run_group_tests_name("help", tests, NULL, NULL);
}
