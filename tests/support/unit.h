/* cmocka, after the headers that it needs but does not include. A test's first include, as the
 * other headers of support/ assert, too. */
#ifndef CLN_TEST_UNIT_H
#define CLN_TEST_UNIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#endif
