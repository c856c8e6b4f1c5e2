/* Sanitizers see the host's code alone, in which a loop's first rounds do what its later ones do:
 * where SANITIZED is 1, some tests have fewer of the same rounds, as each says. */
#ifndef CLN_TESTS_SANITIZED_H
#define CLN_TESTS_SANITIZED_H

#ifdef __SANITIZE_ADDRESS__
enum { SANITIZED = 1 };
#else
enum { SANITIZED = 0 };
#endif

#endif
