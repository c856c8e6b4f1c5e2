/* See commit.h. Compiled anew when the Makefile finds another commit. */
#include "base/commit.h"

#ifndef CLN_COMMIT /* by the Makefile */
#define CLN_COMMIT "unknown"
#endif

const char *cln_commit(void)
{
    return CLN_COMMIT;
}
