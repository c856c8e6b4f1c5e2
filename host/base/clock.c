/* See clock.h. */
#include "base/clock.h"

#include <math.h>
#include <stdio.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

double cln_now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double worked_for(int who)
{
    struct rusage usage;

    if (getrusage(who, &usage) != 0)
        return 0;
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
           1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

double cln_processor_seconds(void)
{
    return worked_for(RUSAGE_SELF);
}

cln_load cln_load_now(void)
{
    enum { USER, NICE, SYSTEM, IDLE, WAITING, IRQ, SOFTIRQ, STOLEN, KINDS }; /* proc(5) */
    const double second = (double)sysconf(_SC_CLK_TCK);
    cln_load load = {.own = worked_for(RUSAGE_SELF) + worked_for(RUSAGE_CHILDREN)};
    double ticks[KINDS] = {0};
    FILE *f = fopen("/proc/stat", "r");
    int read = f ? fscanf(f, "cpu %lf %lf %lf %lf %lf %lf %lf %lf", &ticks[USER], &ticks[NICE],
                          &ticks[SYSTEM], &ticks[IDLE], &ticks[WAITING], &ticks[IRQ],
                          &ticks[SOFTIRQ], &ticks[STOLEN])
                 : 0;

    if (f)
        fclose(f);
    if (read <= IDLE || !(second > 0))
        return load;
    for (int k = 0; k < KINDS; k++) {
        load.could += ticks[k] / second;
        if (k != IDLE && k != WAITING)
            load.worked += ticks[k] / second;
    }
    return load;
}

double cln_load_of_others(const cln_load *from, const cln_load *to)
{
    const double could = to->could - from->could;
    const double others = to->worked - from->worked - (to->own - from->own);

    return from->could > 0 && could > 0 ? fmin(fmax(others / could, 0), 1) : NAN;
}
