/* RUN/report.html: one page of HTML with its pictures inside, which refers to nothing elsewhere,
 * made from the run folder's files (docs/formats.md) alone. report_sections.h lists its sections.
 */
#ifndef CLN_REPORT_H
#define CLN_REPORT_H

#include <stdbool.h>
#include <stdint.h>
#include "base/status.h"

/* Held-out views so far below training views, in dB, are of photos that were learnt by heart, or in
 * other light. */
extern const double cln_overfit_db;

/* Do held-out views look wrong (few dB) where training views look better? Poses or lenses are
 * wrong, or photos are few or look elsewhere, or differ in exposure, as a fit of colours shows (of
 * many dB, too): more training does not mend it. `out` says so, in the middle of a sentence, what
 * is known of this scene first; "" if not, or if a PSNR of the first two is not finite. */
enum { CLN_DOUBT_BYTES = 512 };
typedef struct cln_doubt {
    double psnr_train, psnr_test, psnr_fitted; /* the last: NaN if not known */
    double fitted_gain;  /* of cln_eval_result; NaN: not known, the means tell it */
    bool exposed;        /* it was trained with gains of the photos, or alpha has none */
    bool alpha;          /* its photos have alpha */
    bool cube_guessed;   /* from the cameras alone */
    bool masks_doubtful; /* masks are ignored, and may be of an object */
    int training_photos; /* 0: not known */
} cln_doubt;
bool cln_report_doubt(const cln_doubt *of, char out[CLN_DOUBT_BYTES]);

/* Writes it anew, atomically; until: as for cln_report_data_read. Files that are missing or damaged
 * are left out; CLN_OUTPUT if the page cannot be written. */
cln_status cln_report_write(const char *run, int64_t until);

#endif
