/* Other programs: found on PATH, run without a shell, their output read line by line. */
#ifndef CLN_COMMAND_H
#define CLN_COMMAND_H

#include <stdio.h>
#include "base/status.h"

/* Returns whether a program of that name is on PATH. */
bool cln_command_found(const char *program);

typedef struct cln_command_watch {
    void (*line)(const char *line, void *user); /* each line of its output and errors; or NULL */
    int (*interrupted)(void *user);             /* as cln_callbacks.interrupted; or NULL */
    void *user;
    FILE *log; /* gets the command and its output; or NULL */
} cln_command_watch;

/* Runs argv, which ends with NULL, and waits. CLN_FAILED with the program's last line if it ends
 * with another code than 0; CLN_SIGINT or CLN_SIGTERM if `interrupted` had it stopped. */
cln_status cln_command_run(const char *const *argv, const cln_command_watch *watch);

/* A program that reads what is written to it: open, write, then either end (closes its input and
 * waits) or kill; both free it. Write and end: CLN_FAILED with the last line that it printed if it
 * ended early, with another code than 0, or spoke of an error: ffmpeg ends with 0 after some writes
 * that failed. */
typedef struct cln_command_feed cln_command_feed;
cln_status cln_command_open(const char *const *argv, cln_command_feed **out);
cln_status cln_command_write(cln_command_feed *feed, const void *data, size_t bytes);
cln_status cln_command_end(cln_command_feed *feed);
void cln_command_kill(cln_command_feed *feed); /* accepts NULL */

#endif
