/* The commit that the program was built from, beside its version. */
#ifndef CLN_COMMIT_H
#define CLN_COMMIT_H

/* 12 hex digits of git, or those of the archive (make dist), "-dirty" behind them if the tree
 * differed; "unknown" if neither tells. */
const char *cln_commit(void);

#endif
