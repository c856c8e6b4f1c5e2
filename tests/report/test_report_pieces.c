/* What the report is made of: curves of few points, charts with round ticks, escaped texts, base64
 * of pictures. Oracle: literal texts and numbers; for base64, the vectors of RFC 4648. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "report/html.h"
#include "report/report_data.h"
#include "report/svg.h"
#include "page.h"
#include "tests.h"

static void decimation_keeps_ends_and_extremes(void **state)
{
    enum { COUNT = 5000 };
    double x[COUNT], y[COUNT], to_x[CLN_REPORT_POINTS], to_y[CLN_REPORT_POINTS];
    double least = INFINITY, greatest = -INFINITY;
    int kept = 0;

    (void)state;
    for (int i = 0; i < COUNT; i++) {
        x[i] = i;
        y[i] = i % 7 == 3 ? NAN : sin(0.01 * i);
    }
    y[2345] = 9;
    y[4001] = -9;
    kept = cln_report_decimate(COUNT, x, y, to_x, to_y);
    assert_in_range(kept, 500, CLN_REPORT_POINTS);
    for (int i = 0; i < kept; i++) {
        assert_true(isfinite(to_x[i]) && isfinite(to_y[i]));
        assert_true(to_y[i] == y[(int)to_x[i]]);
        assert_true(i == 0 || to_x[i] >= to_x[i - 1]);
        least = fmin(least, to_y[i]);
        greatest = fmax(greatest, to_y[i]);
    }
    assert_true(least == -9 && greatest == 9);
    /* few points: keeps all but the NaN */
    assert_int_equal(cln_report_decimate(10, x, y, to_x, to_y), 9);
    assert_true(to_x[3] == 4);
    assert_int_equal(cln_report_decimate(0, x, y, to_x, to_y), 0);
}

static char *chart_text(const cln_chart *chart, bool drawn)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *stream = open_memstream(&text, &bytes);

    assert_non_null(stream);
    assert_int_equal(cln_svg_chart(stream, chart), drawn);
    assert_int_equal(fclose(stream), 0);
    return text;
}

static void charts_have_round_ticks_and_no_nan(void **state)
{
    const double x[] = {60, 120, 600}, y[] = {20, NAN, 27};
    const double nothing[] = {NAN};
    cln_series series = {"a<b", "#123456", CLN_SERIES_DOTS, 3, x, y};
    cln_chart chart = {.title = "T&T",
                       .x_label = "time",
                       .x_axis = CLN_AXIS_SECONDS,
                       .width = 560,
                       .height = 330,
                       .series_count = 1,
                       .series = &series};
    char *text = chart_text(&chart, true);

    (void)state;
    assert_has(text, "T&amp;T");
    assert_has(text, "a&lt;b");
    assert_has(text, ">10 min</text>");
    assert_has(text, ">20</text>");
    assert_has(text, ">28</text>");
    assert_int_equal(count_of(text, "<title>"), 2);
    assert_has_not(text, "nan");
    free(text);
    series = (cln_series){"one", "#123456", CLN_SERIES_LINE, 1, x, y}; /* a single point */
    text = chart_text(&chart, true);
    assert_has_not(text, "nan");
    assert_has_not(text, "inf");
    free(text);
    series = (cln_series){"none", "#123456", CLN_SERIES_LINE, 1, nothing, nothing};
    text = chart_text(&chart, false);
    assert_string_equal(text, "");
    free(text);
}

static void html_text_is_escaped(void **state)
{
    static const char *const cases[][2] = {
        {"a<b>&\"'", "a&lt;b&gt;&amp;&quot;&#39;"},
        {"\xc3\xbc \xe2\x82\xac\n\t", "\xc3\xbc \xe2\x82\xac\n\t"},
        {"\001\x7f", "&#xFFFD;&#xFFFD;"},
        {"l\xfc \xe2\x82", "l&#xFFFD; &#xFFFD;&#xFFFD;"}, /* Latin-1, and a truncated euro sign */
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char *text = NULL;
        size_t bytes = 0;
        FILE *stream = open_memstream(&text, &bytes);

        assert_non_null(stream);
        cln_html_text(stream, cases[i][0]);
        assert_int_equal(fclose(stream), 0);
        assert_string_equal(text, cases[i][1]);
        free(text);
    }
}

static void base64_agrees_with_rfc_4648(void **state)
{
    static const char *const vectors[][2] = {{"", ""},
                                             {"f", "Zg=="},
                                             {"fo", "Zm8="},
                                             {"foo", "Zm9v"},
                                             {"foob", "Zm9vYg=="},
                                             {"fooba", "Zm9vYmE="},
                                             {"foobar", "Zm9vYmFy"},
                                             {"\xff\xfe\xfd", "//79"}};

    (void)state;
    for (size_t i = 0; i < sizeof vectors / sizeof vectors[0]; i++) {
        char *text = NULL;
        size_t bytes = 0;
        FILE *stream = open_memstream(&text, &bytes);

        assert_non_null(stream);
        cln_base64_write(stream, (const uint8_t *)vectors[i][0], strlen(vectors[i][0]));
        assert_int_equal(fclose(stream), 0);
        assert_string_equal(text, vectors[i][1]);
        free(text);
    }
}

int test_group_report_pieces(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decimation_keeps_ends_and_extremes),
        cmocka_unit_test(charts_have_round_ticks_and_no_nan),
        cmocka_unit_test(html_text_is_escaped),
        cmocka_unit_test(base64_agrees_with_rfc_4648),
    };

    return cmocka_run_group_tests_name("report_pieces", tests, NULL, NULL);
}
