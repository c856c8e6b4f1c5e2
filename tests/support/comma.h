/* Support of tests: a locale with a decimal comma, as a calling program may have set. */
#ifndef CLN_TESTS_COMMA_H
#define CLN_TESTS_COMMA_H

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>

/* Compiles de_DE with localedef into a fresh folder, for machines that only have its source. */
static inline const char *comma_locale_make(void)
{
    char folder[64], command[256];
    const char *found = NULL;

    snprintf(folder, sizeof folder, "%.40s/cln-locale-XXXXXX",
             getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp");
    if (!mkdtemp(folder))
        return NULL;
    snprintf(command, sizeof command,
             "localedef -i de_DE -f UTF-8 '%s/de_DE.UTF-8' >/dev/null 2>&1", folder);
    if (system(command) == 0) {
        setenv("LOCPATH", folder, 1);
        found = setlocale(LC_NUMERIC, "de_DE.UTF-8");
        unsetenv("LOCPATH");
    }
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    assert_int_equal(system(command), 0);
    return found;
}

/* Skips the test where there is no such locale and none can be made. */
static inline void comma_locale_begin(void)
{
    static const char *const names[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "nl_NL.UTF-8"};
    const char *found = NULL;

    for (size_t i = 0; i < sizeof names / sizeof names[0] && !found; i++)
        found = setlocale(LC_NUMERIC, names[i]);
    if (!found)
        found = comma_locale_make();
    if (!found) {
        print_message("skipped: no locale with a decimal comma exists or can be made\n");
        skip();
    }
}

/* Before an assertion may jump out of the test. */
static inline void comma_locale_end(void)
{
    setlocale(LC_NUMERIC, "C");
}

#endif
