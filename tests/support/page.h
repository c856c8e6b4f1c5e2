/* Support of the tests of pages: what HTML has, by literal text, and whether it is well formed. */
#ifndef CLN_TESTS_PAGE_H
#define CLN_TESTS_PAGE_H

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

static inline void assert_has(const char *page, const char *text)
{
    if (!strstr(page, text))
        fail_msg("the page has no \"%s\"", text);
}

static inline void assert_has_not(const char *page, const char *text)
{
    if (strstr(page, text))
        fail_msg("the page has \"%s\"", text);
}

static inline int count_of(const char *page, const char *text)
{
    int count = 0;

    for (; (page = strstr(page, text)); page += strlen(text))
        count++;
    return count;
}

/* In the section of this id. */
static inline int count_in(const char *page, const char *id, const char *text)
{
    char head[64];
    const char *from = NULL, *to = NULL;
    int count = 0;

    snprintf(head, sizeof head, "<h2 id='%s'>", id);
    from = strstr(page, head);
    assert_non_null(from);
    to = strstr(from + 1, "<h2 ");
    for (; (from = strstr(from, text)) && (!to || from < to); from += strlen(text))
        count++;
    return count;
}

/* Is there a character reference at `at`: &name; &#39; &#xFFFD; */
static inline bool is_reference(const char *at)
{
    const char *end = at + 1 +
                      strspn(at + 1, "#abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                     "0123456789");

    return end > at + 1 && *end == ';';
}

/* Steps over a tag (a name, then attributes, which may be quoted) and copies its name. */
static inline const char *read_tag(const char *at, char name[16])
{
    size_t length = 0;

    at++;
    length = strspn(at, "!/abcdefghijklmnopqrstuvwxyz0123456789");
    if (length == 0 || length >= 16)
        fail_msg("'<' begins no tag: %.60s", at);
    memcpy(name, at, length);
    name[length] = 0;
    for (at += length; *at != '>';) {
        size_t space = strspn(at, " \n");
        size_t key =
            strspn(at + space, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-:/");
        char quote = 0;

        if (space + key == 0)
            fail_msg("no attribute: %.60s", at);
        at += space + key;
        if (*at != '=')
            continue;
        quote = *++at;
        if (quote != '"' && quote != '\'') {
            at += strcspn(at, " >");
            continue;
        }
        for (at++; *at != quote; at++)
            if (!*at || *at == '<' || (*at == '&' && !is_reference(at)))
                fail_msg("in an attribute: %.60s", at);
        at++;
    }
    return at + 1;
}

/* Every '<' begins a tag and every '&' a reference; elements are closed in order; every link
 * targets one id of the page. */
static inline void assert_well_formed(const char *page)
{
    static const char *const closed[] = {
        "main", "div", "span",  "section", "table", "svg", "h1",     "h2",    "h3",    "p", "code",
        "b",    "i",   "small", "a",       "nav",   "ul",  "footer", "title", "style", "g", "text"};
    char open[64][16];
    int depth = 0;

    for (const char *at = page; *at;) {
        char name[16];
        bool must = false;

        if (*at == '&' && !is_reference(at))
            fail_msg("'&' begins no reference: %.60s", at);
        if (*at != '<') {
            at++;
            continue;
        }
        at = read_tag(at, name);
        for (size_t i = 0; i < sizeof closed / sizeof closed[0]; i++)
            must = must || strcmp(closed[i], name + (name[0] == '/')) == 0;
        if (!must || at[-2] == '/')
            continue;
        if (name[0] != '/') {
            assert_in_range(depth, 0, 63);
            strcpy(open[depth++], name);
        } else if (depth == 0 || strcmp(open[--depth], name + 1) != 0) {
            fail_msg("<%s> closes <%s> before %.60s", name, depth >= 0 ? open[depth] : "", at);
        }
    }
    assert_int_equal(depth, 0);
    for (const char *at = strstr(page, "href="); at; at = strstr(at + 1, "href=")) {
        char id[64];

        assert_int_equal(sscanf(at, "href='#%31[a-z-]'", id + 4), 1);
        memcpy(id, "id='", 4);
        strcat(id, "'");
        assert_int_equal(count_of(page, id), 1);
    }
}

#endif
