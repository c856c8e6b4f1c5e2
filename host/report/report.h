/* RUN/report.html: one page of HTML with its pictures inside, which refers to nothing elsewhere,
 * made from the run folder's files (docs/formats.md) alone. report_sections.h lists its sections.
 */
#ifndef CLN_REPORT_H
#define CLN_REPORT_H

#include <stdbool.h>
#include "base/status.h"

/* Do held-out views look wrong (few dB) where training views look better? Poses or lenses are
 * wrong, or photos are few or look elsewhere: more training does not mend it. false if a PSNR is
 * not finite. */
bool cln_report_is_doubtful(double psnr_train, double psnr_test);

/* Writes it anew, atomically. Files that are missing or damaged are left out; CLN_OUTPUT if the
 * page cannot be written. */
cln_status cln_report_write(const char *run);

#endif
