/* The clock that durations are measured with. */
#ifndef CLN_CLOCK_H
#define CLN_CLOCK_H

/* Monotonic seconds: changes of the date do not move them. */
double cln_now(void);

/* Seconds that processors have worked for this process, all its threads; a CPU's driver has its own
 * among them. 0 where the system does not tell. */
double cln_processor_seconds(void);

/* Seconds so far that the machine's processors worked, and that they could have; and those that
 * they worked for this process and its ended children. could 0: the system does not tell. */
typedef struct cln_load {
    double worked, could, own;
} cln_load;
cln_load cln_load_now(void);

/* The share of the processors' time between two moments that other programs had; NaN if unknown. */
double cln_load_of_others(const cln_load *from, const cln_load *to);

#endif
