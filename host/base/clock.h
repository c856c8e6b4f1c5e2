/* The clock that durations are measured with. */
#ifndef CLN_CLOCK_H
#define CLN_CLOCK_H

/* Monotonic seconds: changes of the date do not move them. */
double cln_now(void);

/* Seconds that processors have worked for this process, all its threads; a CPU's driver has its own
 * among them. 0 where the system does not tell. */
double cln_processor_seconds(void);

#endif
