/* main() and nothing else: options -> command -> exit code. Prints the error, once; every other
 * part of the program only reports one. Tests link all of cli/ but this file. */
#include <ctype.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/files.h"
#include "base/log.h"
#include "cli/console.h"
#include "cli/help.h"
#include "cli/option_table.h"
#include "cli/parse.h"
#include "ranks/ranks.h"

/* After an error about a path of Windows, where WSL has it. */
static void tell_drive(const char *error)
{
    const char *end = *error ? strstr(error + 1, ": ") : NULL;

    if (!cln_is_drive_path(error) || !end)
        return;
    fprintf(stderr, "in WSL that is '/mnt/%c", tolower((unsigned char)error[0]));
    for (const char *p = error + 2; p < end; p++)
        fputc(*p == '\\' ? '/' : *p, stderr);
    fputs("'\n", stderr);
}

static void print_error(cln_status st, const cln_options *options)
{
    const cln_command *command = options->command;
    const bool colour = cln_options_colour(options);
    const char *text = cln_error_text();

    if (cln_ranks_me() > 0 && (st == CLN_SIGINT || st == CLN_SIGTERM))
        return;
    if (cln_ranks_me() > 0) /* rank 0 reports an error of all ranks, and ends the others */
        sleep(1);
    fflush(stdout);
    fprintf(stderr, "%scl-nascent:%s %s%s\n", colour ? "\033[1;31m" : "", colour ? "\033[0m" : "",
            cln_ranks_name(), *text ? text : cln_status_phrase(st));
    tell_drive(text);
    if (st == CLN_USAGE)
        fprintf(stderr, "try `cl-nascent %s%s--help`\n", command ? command->name : "",
                command ? " " : "");
}

/* An error of a rank that ends all names it already. */
static void log_ranked(cln_log_level level, const char *line, void *user)
{
    char named[8192 + 256];

    snprintf(named, sizeof named, "%s%s", level == CLN_LOG_WARN ? cln_ranks_name() : "", line);
    cln_log_stderr(level, named, user);
}

/* Refuses several ranks for most commands: each would do, and write, the same. Rank 0 has the log,
 * and the first rank of each other machine its warnings, as that has photos, disks and memory of
 * its own. */
static cln_status join_ranks(const cln_command *command)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_ranks_open());
    if (cln_ranks_me() > 0)
        cln_log_to(cln_ranks_me_here() > 0 ? CLN_LOG_ERROR : CLN_LOG_WARN, log_ranked, NULL);
    if (cln_ranks_count() > 1 && !(command->bit & (CLN_TRAIN | CLN_EVAL | CLN_RENDER | CLN_VIEW)))
        CLN_TRY(cln_fail(CLN_USAGE,
                         "%s: runs in one process, not in %d; start it without mpirun or srun "
                         "(only train, eval, render and view take several)",
                         command->name, cln_ranks_count()));
done:
    return st;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;
    cln_status flushed = CLN_OK;
    cln_options options = {0};
    const char *cache = getenv("POCL_CACHE_DIR");

    if (cache && !*cache) /* PoCL would abort */
        unsetenv("POCL_CACHE_DIR");
    cln_exit_watch(true);
    cln_standard_hold();
    cln_log_to(CLN_LOG_INFO, cln_log_stderr, NULL);
    signal(SIGPIPE, SIG_IGN); /* cln_flush_stdout tells a closed pipe from other errors */
    signal(SIGCHLD, SIG_DFL); /* ignored by who started us, the ends of ffmpeg would be lost */
    signal(SIGXFSZ, SIG_IGN); /* a write beyond the limit of a file's size then fails */
    CLN_TRY(cln_options_parse(argc, argv, &options));
    cln_log_use_colour(cln_options_colour(&options));
    cln_log_to(options.quiet         ? CLN_LOG_WARN
               : options.verbose > 0 ? CLN_LOG_DEBUG
                                     : CLN_LOG_INFO,
               cln_log_stderr, NULL);
    if (options.json)
        cln_warnings_keep();
    if (options.version)
        cln_version_print(stdout, options.verbose > 0);
    else if (options.help && options.help_preset)
        CLN_TRY(cln_help_print_preset(stdout, options.command, options.help_preset));
    else if (options.help && options.help_option)
        CLN_TRY(cln_help_print_option(stdout, options.command, options.help_option));
    else if (options.help)
        cln_help_print(stdout, options.command);
    else {
        CLN_TRY(join_ranks(options.command));
        CLN_TRY(options.command->run(&options));
    }
done:
    cln_exit_watch(false);
    if (st != CLN_OK)
        print_error(st, &options);
    cln_clear_error();
    flushed = cln_flush_stdout();
    if (st == CLN_OK && flushed != CLN_OK) {
        st = flushed;
        print_error(st, &options);
    }
    cln_options_free(&options);
    cln_ranks_close(st != CLN_OK && st != CLN_SIGINT && st != CLN_SIGTERM,
                    cln_status_exit_code(st));
    return cln_status_exit_code(st);
}
