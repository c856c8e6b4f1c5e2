/* Comparing doubles in tests (cmocka 1.1.5 has only floats). A NaN is never near. */
#ifndef CLN_TESTS_NEAR_H
#define CLN_TESTS_NEAR_H

#include <math.h>

#define assert_near(got, want, bound)                                                        \
    do {                                                                                     \
        const double got_ = (got), want_ = (want);                                           \
        if (!(fabs(got_ - want_) <= (bound)))                                                \
            fail_msg("%s = %.17g, not %.17g within %g", #got, got_, want_, (double)(bound)); \
    } while (0)

#endif
