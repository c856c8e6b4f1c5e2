/* Tuning parameters as text, and rows that give them by device, driver and network. A file has a
 * row per line (docs/formats.md, "Tuning rows"):
 *
 *   DEVICE | DRIVER | NETWORK | VW=8,NV=2,...     # comment
 *
 * The first three are shell patterns; the last matching row counts. The command line knows the
 * user's file; device.c chooses among the sources; pipeline/programs.c fits a set to a network. */
#ifndef CLN_TUNE_H
#define CLN_TUNE_H

#include "cl.h"
#include "cl_nascent.h"

/* Tuning parameters: X(field, name, cpu, gpu, plain, min, max, meaning). The list generates the
 * struct, the defaults, the parser of "VW=8,TS=6" with its range check, the text form and the
 * kernels' "#define" lines. cpu, gpu: a class's defaults; plain: values that run anywhere. */
#define CLN_TUNE_LIST(X)                                                                \
    X(vw, "VW", 0, 1, 1, 1, 16, "floats per vector; cpu 0 = the device's native width") \
    X(nv, "NV", 2, 1, 1, 1, 8, "vectors per work-item in a tile")                       \
    X(ls, "LS", 1, 64, 1, 1, 1024, "work-items of a network work-group")                \
    X(ts, "TS", 6, 8, 1, 1, 32, "samples of a register tile")                           \
    X(nb, "NB", 48, 16, 8, 1, 1024, "samples of a leaf in local memory at a time")      \
    X(sl, "SL", 480, 128, 128, 1, 65536, "most samples of a slice (one work-group)")    \
    X(wg, "WG", 16, 64, 1, 1, 1024, "work-items of a group of the scalar kernels")      \
    X(sg, "SG", 1, 256, 1, 1, 1024, "work-items of a scan, sort or sum group; 2^k")     \
    X(db, "DB", 12, 8, 1, 1, 12, "most bits of a digit of the sort")                    \
    X(chunk, "CHUNK", 1024, 2048, 1024, 16, 65536,                                      \
      "fewest elements of a scan or sort group's turn")                                 \
    X(native, "NATIVE", 0, 0, 0, 0, 1, "native_exp and the like in networks")           \
    X(half, "HALF", 0, 0, 0, 0, 1, "activations kept for backward in 16 bits")          \
    X(leaf, "LEAF", 1, 0, 0, 0, 1, "a leaf's gradient and transposed weights in local memory")

typedef struct cln_tune {
#define X(field, name, cpu, gpu, plain, min, max, meaning) int field;
    CLN_TUNE_LIST(X)
#undef X
} cln_tune;

enum { CLN_TUNE_TEXT = 256, CLN_TUNE_FROM = 512 }; /* bytes: a set as text; its source */

/* Writes all parameters as "VW=8,NV=2,...". */
void cln_tune_text(const cln_tune *tune, char out[CLN_TUNE_TEXT]);
/* Applies "VW=8,TS=6"; CLN_USAGE names the mistake and the values allowed. */
cln_status cln_tune_parse(const char *text, cln_tune *tune);
/* Writes which values of such a list `used`, which was fitted to a network, does not have:
 * "VW=16 (8 is used), ...", or "". */
void cln_tune_unmet(const char *text, const cln_tune *used, char out[CLN_TUNE_TEXT]);

/* Class default: the column cpu or gpu. Plain: no vectors, no groups, small blocks. */
void cln_tune_class_default(cl_device_id id, bool cpu, cln_tune *out);
void cln_tune_plain(cln_tune *out);

typedef struct cln_tune_row {
    char device[160], driver[160], network[32]; /* patterns */
    char list[CLN_TUNE_TEXT];
    const char *file; /* where it was read */
    int line;
} cln_tune_row;

typedef struct cln_tune_rows {
    cln_tune_row *row; /* [count] */
    int count;
    char *files[16]; /* names, one for each text */
    int file_count;
} cln_tune_rows;

/* Add the rows of a text to *rows (allocated if NULL); CLN_INPUT names file, line and mistake. The
 * caller frees *rows, also on failure. */
cln_status cln_tune_rows_add(const char *file, const char *text, cln_tune_rows **rows);
cln_status cln_tune_rows_read(const char *path, cln_tune_rows **rows);
cln_status cln_tune_rows_shipped(cln_tune_rows **rows); /* data/tune, from the program itself */
void cln_tune_rows_free(cln_tune_rows *rows);           /* accepts NULL */

/* The last row that matches, NULL without one. For voxels with a decoder, rows for those without
 * count as rows for all networks do. */
const cln_tune_row *cln_tune_rows_find(const cln_tune_rows *rows, const char *device,
                                       const char *driver, const char *network);
/* Applies the row's list, which reading has checked. */
void cln_tune_row_apply(const cln_tune_row *row, cln_tune *tune);

/* Writes a row for just this device, driver and network, without newline; comment: after a #. */
void cln_tune_row_text(const cln_device_info *info, const char *network, const cln_tune *tune,
                       const char *comment, char out[1024]);
/* Appends such a line to a file and removes rows with the same three patterns; all other lines
 * stay. Creates the file and its folder as needed. CLN_INPUT if a row is wrong; the file then stays
 * as it is. */
cln_status cln_tune_row_put(const char *path, const char *line);

#endif
