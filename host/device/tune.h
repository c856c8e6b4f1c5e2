/* Tuning parameters as text, the rows that say which of them to use, and the choice among all sources.
 * A file of rows has one a line (docs/formats.md, "Tuning rows"):
 *
 *   DEVICE | DRIVER | NETWORK | VW=8,NV=2,...     # comment
 *
 * The first three are shell patterns; of several rows that match, the last counts. Where the user's file
 * is, is the command line's business; fitting a set to a network is pipeline/programs.c's. */
#ifndef CLN_TUNE_H
#define CLN_TUNE_H

#include "device/device.h"

/* Where a kind of device starts; and what runs anywhere: no vectors, no groups, small blocks. */
void cln_tune_class_default(cl_device_id id, bool cpu, cln_tune *out);
void cln_tune_plain(cln_tune *out);

typedef struct cln_tune_row {
    char device[160], driver[160], network[32]; /* patterns */
    char list[CLN_TUNE_TEXT];
    const char *file; /* the rows' text that it is from */
    int line;
} cln_tune_row;

typedef struct cln_tune_rows {
    cln_tune_row *row; /* [count] */
    int count, capacity;
    char *files[16]; /* names, one for each text */
    int file_count;
} cln_tune_rows;

/* Adds the rows of a text to *rows (NULL: made first); CLN_INPUT names file, line and what is wrong. The
 * caller frees *rows, also on failure. */
cln_status cln_tune_rows_add(const char *file, const char *text, cln_tune_rows **rows);
cln_status cln_tune_rows_read(const char *path, cln_tune_rows **rows);
cln_status cln_tune_rows_shipped(cln_tune_rows **rows); /* data/tune, from the program itself */
void cln_tune_rows_free(cln_tune_rows *rows);           /* accepts NULL */

/* The last row that matches, NULL without one. */
const cln_tune_row *cln_tune_rows_find(const cln_tune_rows *rows, const char *device,
                                       const char *driver, const char *network);

/* The line (without newline) of a row for exactly this device, driver and network. comment: after a #. */
void cln_tune_row_text(const cln_device_info *info, const char *network, const cln_tune *tune,
                       const char *comment, char out[1024]);
/* Puts such a line into a file, at its end, in the place of rows with the same three patterns; the file and
 * its folder are made as needed, and all other lines stay. A file with a wrong row is left alone. */
cln_status cln_tune_row_put(const char *path, const char *line);

/* What to use for a network ("W32-D3-V32") on an open device, and where that comes from, as a phrase. */
void cln_tune_choose(const cln_device *device, const char *network, cln_tune *out,
                     char from[CLN_TUNE_FROM]);

#endif
