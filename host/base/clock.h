/* The clock that durations are measured with. */
#ifndef CLN_CLOCK_H
#define CLN_CLOCK_H

/* Monotonic seconds: changes of the date do not move them. */
double cln_now(void);

#endif
