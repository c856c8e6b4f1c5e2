/* The report's sections, each written to the page from what was read; a section with nothing to show
 * says so in a sentence or writes nothing. Internal to the report. */
#ifndef CLN_REPORT_SECTIONS_H
#define CLN_REPORT_SECTIONS_H

#include <stdio.h>
#include "report/report_data.h"

void cln_report_curves(FILE *to, const cln_report_data *data); /* error against run time */
void cln_report_stages(FILE *to, const cln_report_data *data); /* time per stage */
cln_status cln_report_views(FILE *to, const char *run, const cln_report_data *data);
cln_status cln_report_tree(FILE *to, const char *run, const cln_report_data *data);
void cln_report_settings(FILE *to, const cln_report_data *data); /* against the preset */
void cln_report_machine(FILE *to, const cln_report_data *data);  /* device, memory plan, data */

/* An <img> of the file, made smaller for the page, or a note that there is none ("no WHAT picture"); only
 * lack of memory is an error. */
cln_status cln_report_picture(FILE *to, const char *path, const char *view, const char *what);

/* "27.93", or "–". */
void cln_report_number(FILE *to, double value, int decimals);

#endif
