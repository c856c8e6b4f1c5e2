/* Formats log lines and hands them to the sink. Level and sink belong to the process. */
#include "base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/text.h"

static cln_log_level max_level = CLN_LOG_INFO;
static cln_log_sink *sink_fn;
static void *sink_user;
static bool colour;
static _Thread_local cln_warned *lists; /* the innermost */

void cln_log_set_level(cln_log_level level)
{
    max_level = level;
}

void cln_log_set_sink(cln_log_sink *sink, void *user)
{
    sink_fn = sink;
    sink_user = user;
}

void cln_log_to(cln_log_level most, cln_log_sink *sink, void *user)
{
    cln_log_set_level(most);
    cln_log_set_sink(sink, user);
}

void cln_log_use_colour(bool on)
{
    colour = on;
}

void cln_log_stderr(cln_log_level level, const char *line, void *user)
{
    static const char word[] = "warning:";

    (void)user;
    if (colour && level == CLN_LOG_WARN && strncmp(line, word, sizeof word - 1) == 0)
        fprintf(stderr, "\033[1;33m%s\033[0m%s\n", word, line + sizeof word - 1);
    else
        fprintf(stderr, "%s\n", line);
}

void cln_warned_open(cln_warned *list)
{
    list->count = 0;
    list->outer = lists;
    lists = list;
}

void cln_warned_close(cln_warned *list)
{
    lists = list->outer;
    while (list->count > 0)
        free(list->lines[--list->count]);
}

/* Without memory it is on stderr alone. */
static void keep(cln_warned *list, const char *line)
{
    char *copy = list->count < CLN_WARNED_MOST ? strdup(line) : NULL;
    bool is_new = copy;

    if (copy)
        cln_utf8_repair(copy); /* for JSON */
    for (int i = 0; i < list->count && is_new; i++)
        is_new = strcmp(list->lines[i], copy) != 0;
    if (is_new)
        list->lines[list->count++] = copy;
    else
        free(copy);
}

void cln_log(cln_log_level level, const char *fmt, ...)
{
    static const char *const prefix[] = {"error: ", "warning: ", "", ""};
    char line[8192];
    int used = 0;
    va_list args;

    if ((level > max_level || !sink_fn) && !(level == CLN_LOG_WARN && lists))
        return;
    used = snprintf(line, sizeof line, "%s", prefix[level]);
    va_start(args, fmt);
    vsnprintf(line + used, sizeof line - (size_t)used, fmt, args);
    va_end(args);
    cln_text_plain(line);
    for (cln_warned *list = level == CLN_LOG_WARN ? lists : NULL; list; list = list->outer)
        keep(list, line + used);
    if (level <= max_level && sink_fn)
        sink_fn(level, line, sink_user);
}
