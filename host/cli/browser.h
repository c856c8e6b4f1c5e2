/* This desktop's browser, for --open. */
#ifndef CLN_BROWSER_H
#define CLN_BROWSER_H

/* Warns if it cannot be opened. */
void cln_open_browser(const char *address);

#endif
