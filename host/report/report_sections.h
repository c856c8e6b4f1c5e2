/* The report's sections. To add one: a file with its function, and a row in this table, from which
 * come the page, its table of contents and the tests. Internal to the report. */
#ifndef CLN_REPORT_SECTIONS_H
#define CLN_REPORT_SECTIONS_H

#include <stdbool.h>
#include <stdio.h>
#include "base/settings.h"
#include "report/report_data.h"

/* In the page's order: id (of its link), title, the function that writes what stands below the
 * title, and the condition. A section without condition that has nothing to show says so in a
 * sentence. */
/* clang-format off */
#define CLN_REPORT_SECTIONS(ROW) \
    ROW("error", "Error against run time", cln_report_curves, cln_report_always) \
    ROW("views", "Held-out views", cln_report_views, cln_report_always) \
    ROW("octree", "The octree", cln_report_tree, cln_report_has_tree) \
    ROW("stages", "Time per stage", cln_report_stages, cln_report_always) \
    ROW("ranks", "Processes", cln_report_ranks, cln_report_has_ranks) \
    ROW("warnings", "Warnings", cln_report_warnings, cln_report_has_warnings) \
    ROW("left-out", "What was left out", cln_report_left_out, cln_report_has_left_out) \
    ROW("settings", "Settings", cln_report_settings, cln_report_has_settings) \
    ROW("machine", "Machine and data", cln_report_machine, cln_report_has_machine)
/* clang-format on */

typedef struct cln_report_section {
    const char *id, *title; /* HTML, as they are */
    cln_status (*put)(FILE *to, const cln_report_data *data);
    bool (*when)(const cln_report_data *data);
} cln_report_section;

extern const cln_report_section cln_report_sections[];
extern const int cln_report_section_count;

bool cln_report_always(const cln_report_data *data);

#define ROW(id, title, function, when)                          \
    cln_status function(FILE *to, const cln_report_data *data); \
    bool when(const cln_report_data *data);
CLN_REPORT_SECTIONS(ROW)
#undef ROW

/* ---- what sections write in common ---- */

/* "27.93", or an en dash where the value is not finite. */
void cln_report_number(FILE *to, double value, int decimals);

/* Whether the run's leaves are voxels, which only split. */
bool cln_report_of_voxels(const cln_report_data *data);

/* Marks the rows of settings that have no effect in the run; none, if they cannot be read. */
void cln_report_idle(const cln_report_data *data, bool idle[CLN_SETTINGS_MAX]);

/* A stage's name, as texts for people have it for this run's leaves. */
const char *cln_report_stage(const cln_report_data *data, const char *name);

/* An <img> of the file, a picture of an evaluation's image, turned as that says and scaled down for
 * the page, or the note "no WHAT picture" without such a file. CLN_MEMORY is the only error. */
cln_status cln_report_picture(FILE *to, const char *path, const json_t *image, const char *what);

#endif
