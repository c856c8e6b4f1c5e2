/* What is warned of, kept for documents (base/log.h), and its place in JSON (io/json.h). */
#include "unit.h"
#include "base/log.h"
#include "io/json.h"
#include "tests.h"

static void warnings_are_kept(void **state)
{
    cln_warned outer, inner;

    (void)state;
    cln_warn("before");
    cln_warned_open(&outer);
    cln_warn("first %d", 1);
    cln_warned_open(&inner);
    cln_warn("second\n");
    cln_info("no warning");
    cln_warn("second\n");
    cln_warn("\xff beyond UTF-8");
    assert_int_equal(inner.count, 2);
    assert_string_equal(inner.lines[0], "second?");
    assert_string_equal(inner.lines[1], "? beyond UTF-8");
    cln_warned_close(&inner);
    for (int i = 0; i < 2 * CLN_WARNED_MOST; i++)
        cln_warn("many %d", i);
    assert_int_equal(outer.count, CLN_WARNED_MOST);
    assert_string_equal(outer.lines[0], "first 1");
    assert_string_equal(outer.lines[3], "many 0");
    cln_warned_close(&outer);
    cln_warn("after");
}

static void documents_tell_each_once(void **state)
{
    cln_warned list;
    json_t *document = json_pack("{s:[s, s]}", "warnings", "of a start before", "again");
    const json_t *all = json_object_get(document, "warnings");

    (void)state;
    cln_warned_open(&list);
    cln_warn("again");
    cln_warn("new");
    cln_json_add_warned(document, &list);
    cln_json_add_warned(document, &list);
    cln_warned_close(&list);
    assert_int_equal(json_array_size(all), 3);
    assert_string_equal(json_string_value(json_array_get(all, 2)), "new");
    json_decref(document);
    document = json_pack("{s:i}", "warnings", 1); /* a file that is damaged */
    cln_warned_open(&list);
    cln_json_add_warned(document, &list);
    cln_warned_close(&list);
    assert_true(json_is_array(json_object_get(document, "warnings")));
    json_decref(document);
}

int test_group_log(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(warnings_are_kept),
                                       cmocka_unit_test(documents_tell_each_once)};

    return cmocka_run_group_tests_name("log", tests, NULL, NULL);
}
