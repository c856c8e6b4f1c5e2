/* What the commands share for the person at the terminal: signals and the progress line as the
 * library's callbacks, and results on standard output. Knows no command. */
#ifndef CLN_CONSOLE_H
#define CLN_CONSOLE_H

#include <jansson.h>
#include <stdint.h>
#include "cli/options.h"
#include "io/progress.h"

/* Callbacks of a long command: a progress line, and signals. SIGINT and SIGTERM are handed on
 * through callbacks.interrupted, as SIGTERM also SIGXCPU, SIGUSR2 and, unless it is ignored
 * (nohup), SIGHUP; a second one leaves at once; SIGUSR1 asks for a checkpoint. SIGQUIT ends at
 * once. */
typedef struct cln_console {
    cln_callbacks callbacks; /* for the library; valid until close */
    cln_progress *progress;
    bool announced; /* the log says that a signal came */
    /* The work that is under way, for the time that is left: its name, how much of it was done when
     * it was first seen and when that was (monotonic seconds), and how much is done. */
    const char *work;
    int work_first, work_done;
    double work_began;
} cln_console;

/* Opens those of standard input, output and error that the caller closed (2>&-), so that no file of
 * ours gets their number and then log lines. Reading or writing them stays an error. */
void cln_standard_hold(void);

/* PoCL, and LLVM, in which it compiles, answer a full disk by abort() and exit(1), without a way
 * out: while this is on, such an end has a sentence of ours and the exit code of CLN_OUTPUT. Other
 * ends stay as they are. */
void cln_exit_watch(bool on);

cln_status cln_console_open(const cln_options *options, cln_console *console);
void cln_console_close(cln_console *console); /* ends the line; signals have their defaults */

/* The live line of a training, as the manual shows it. */
void cln_train_line(const cln_train_progress *progress, char *out, size_t bytes);

/* Columns of the terminal behind standard output, at least 40; `otherwise` if there is none. */
int cln_stdout_columns(int otherwise);

/* Prints a text and a newline to standard output, of which `column` characters are printed already,
 * in lines of at most `columns` characters where its words allow it; all but the first begin with
 * `indent` spaces. The text keeps its spaces, but for those where a line ends;
 * control characters become '?', as a dataset's names may have some. */
void cln_print_wrapped(int column, int indent, int columns, const char *text);

/* Prints a name, which may be a dataset's, and spaces up to `width` characters; its characters. */
void cln_print_name(const char *name, int width);
int cln_name_width(const char *name);

/* One JSON document and a newline on standard output; takes the reference. */
cln_status cln_print_json(json_t *document);

/* From here on what is warned of is kept for cln_print_json. */
void cln_warnings_keep(void);

/* "%.2f", or "-" when not finite. */
void cln_format_real(double value, int decimals, char out[32]);

/* Flushes standard output; CLN_OUTPUT if not all of it could be written. A reader that went away
 * (`cl-nascent ... | head`) ends the process quietly, as SIGPIPE would have. */
cln_status cln_flush_stdout(void);
/* Writes bytes, not text, to standard output and flushes it likewise. */
cln_status cln_write_stdout(const void *data, size_t bytes);

#endif
