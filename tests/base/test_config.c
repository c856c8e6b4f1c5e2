/* The option table (base/config.h, base/number.h): presets, every row to text and back and to JSON
 * and back, ranges, refused texts with their sentences, units, locale, suggestions, and the small
 * languages of level-at, eval-at, background and bbox. Oracle: literal values. */
#include "unit.h"
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/number.h"
#include "comma.h"
#include "tests.h"

static cln_config preset(const char *name)
{
    cln_config config;

    assert_int_equal(cln_config_preset(name, &config), CLN_OK);
    return config;
}

static const cln_config_row *row_of(const char *option)
{
    const cln_config_row *row = cln_config_find(option);

    assert_non_null(row);
    return row;
}

/* Compares the values of one row as bytes, without conversion to text. */
static void assert_same_row(const cln_config *a, const cln_config *b, const cln_config_row *row)
{
    size_t size = row->type == CLN_ROW_REAL   ? sizeof(double)
                  : row->type == CLN_ROW_BOOL ? sizeof(bool)
                  : row->type == CLN_ROW_TEXT ? CLN_TEXT_BYTES
                                              : sizeof(int);

    if (memcmp((const char *)a + row->offset, (const char *)b + row->offset, size) != 0)
        fail_msg("row --%s differs", row->option);
}

static void assert_same(const cln_config *a, const cln_config *b)
{
    for (int i = 0; i < cln_config_row_count; i++)
        assert_same_row(a, b, &cln_config_rows[i]);
}

/* The call failed with st and its sentence has all the words ("a|b|c"); clears the error. */
static void assert_failed(cln_status got, cln_status st, const char *words)
{
    char copy[512], *save = NULL;

    assert_int_equal(got, st);
    assert_int_equal(cln_error_status(), st);
    snprintf(copy, sizeof copy, "%s", words);
    for (char *word = strtok_r(copy, "|", &save); word; word = strtok_r(NULL, "|", &save)) {
        if (!strstr(cln_error_text(), word))
            fail_msg("'%s' is not in '%s'", word, cln_error_text());
    }
    cln_clear_error();
}

static void assert_refused(const char *option, const char *text, const char *words)
{
    cln_config before = preset("fast"), config = before;

    assert_failed(cln_config_set(&config, row_of(option), text), CLN_USAGE, words);
    assert_same(&before, &config);
}

static void test_presets(void **state)
{
    const cln_config paper = preset("paper"), fast = preset("fast");
    cln_config config = paper;

    (void)state;
    assert_int_equal(paper.width, 64);
    assert_int_equal(paper.depth, 8);
    assert_int_equal(paper.n1, 64);
    assert_true(paper.rrelu_lower == -0.3 && paper.rrelu_upper == -0.1);
    assert_true(paper.skip && !fast.skip);
    assert_int_equal(paper.stage1, CLN_STAGE1_SPLAT);
    assert_int_equal(fast.stage1, CLN_STAGE1_GATHER);
    assert_string_equal(paper.background, "white");
    /* older runs that lack it are read with the paper's value */
    assert_true(paper.depth_until == 0.5 && fast.depth_until == 1);
    assert_true(paper.masks == CLN_MASKS_IGNORE && fast.masks == CLN_MASKS_AUTO);
    assert_failed(cln_config_preset("slow", &config), CLN_USAGE,
                  "--preset|slow|fast|paper|nerf|kilonerf|voxel");
    assert_same(&paper, &config);
    assert_int_equal(cln_config_check(&paper), CLN_OK);
    assert_int_equal(cln_config_check(&fast), CLN_OK);
}

/* A word row that may stand alone, as a switch does; older runs have it as one. */
static void test_switch_with_words(void **state)
{
    static const char *const texts[] = {"no", "false", "0", "yes", "true", "1", "auto"};
    static const int values[] = {0, 0, 0, 1, 1, 1, CLN_EXPOSURE_AUTO};
    const cln_config_row *row = row_of("exposure");
    cln_config config = preset("fast"), back = preset("paper");
    json_t *json = NULL;

    (void)state;
    assert_true(cln_config_is_switch(row) && cln_config_is_switch(row_of("skip")));
    assert_false(cln_config_is_switch(row_of("masks")) || cln_config_is_word(row, "aut"));
    assert_int_equal(config.exposure, CLN_EXPOSURE_AUTO);
    assert_int_equal(back.exposure, CLN_EXPOSURE_NO);
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        assert_int_equal(cln_config_set(&config, row, texts[i]), CLN_OK);
        assert_int_equal(config.exposure, values[i]);
    }
    assert_refused("exposure", "maybe", "--exposure|maybe|no|yes|auto");
    assert_int_equal(cln_config_to_json(&config, &json), CLN_OK);
    for (int i = 0; i < 2; i++) {
        json_object_set_new(json, "exposure", json_boolean(i));
        assert_int_equal(cln_config_from_json(json, &back), CLN_OK);
        assert_int_equal(back.exposure, i);
    }
    json_decref(json);
}

/* Poses are refined by rays of many views, which the paper's splatting does not take. */
static void test_refine_poses(void **state)
{
    cln_config config;

    (void)state;
    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    config.refine_poses = true;
    assert_int_equal(cln_config_check(&config), CLN_OK);
    config.stage1 = CLN_STAGE1_SPLAT;
    assert_int_equal(cln_config_check(&config), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "--stage1 gather"));
    cln_clear_error();
}

/* Is `word` one of "a b c"? */
static bool is_among(const char *words, const char *word)
{
    const size_t length = strlen(word);

    for (const char *at = strstr(words, word); at; at = strstr(at + 1, word)) {
        if ((at == words || at[-1] == ' ') && (at[length] == ' ' || at[length] == 0))
            return true;
    }
    return false;
}

/* The baselines: their shape; all other rows are the fast preset's. */
static void test_baselines(void **state)
{
    static const struct {
        const char *name, *rows;
    } cases[] = {
        {"nerf",
         "start-level level-at adaptive cull-from width depth skip view-width bands view-bands "
         "rrelu-lower rrelu-upper lr lr-final beta2 epsilon n1 refresh-every cdf "
         "samples-per-leaf samples-per-ray min-leaf-samples"},
        {"kilonerf", "start-level level-at adaptive width depth skip view-width bands view-bands "
                     "rrelu-lower rrelu-upper"},
    };
    const cln_config fast = preset("fast"), nerf = preset("nerf"), kilonerf = preset("kilonerf");
    double fraction[CLN_LEVELS];

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        const cln_config config = preset(cases[k].name);

        assert_int_equal(cln_config_check(&config), CLN_OK);
        assert_false(config.adaptive);
        assert_true(config.rrelu_lower == 0 && config.rrelu_upper == 0); /* ReLU */
        assert_int_equal(config.bands, 10);
        assert_int_equal(config.view_bands, 4);
        assert_true(config.view_dependence);
        assert_int_equal(cln_config_levels(&config, fraction), CLN_OK);
        for (int level = 0; level < 6; level++)
            assert_true(fraction[level] == 2); /* the tree does not grow */
        for (int i = 0; i < cln_config_row_count; i++) {
            if (!is_among(cases[k].rows, cln_config_rows[i].option))
                assert_same_row(&fast, &config, &cln_config_rows[i]);
        }
    }
    assert_int_equal(nerf.start_level, 0);
    assert_true(nerf.cull_from == 1); /* its one leaf stays */
    assert_int_equal(nerf.width, 256);
    assert_int_equal(nerf.depth, 8);
    assert_int_equal(nerf.view_width, 128);
    assert_true(nerf.skip);
    assert_int_equal(nerf.samples_per_leaf, 64);
    assert_int_equal(nerf.samples_per_ray, 64);
    assert_int_equal(nerf.cdf, CLN_CDF_WEIGHT);
    assert_true(nerf.lr == 5e-4 && nerf.lr_final == 5e-5);
    assert_int_equal(nerf.min_leaf_samples, 1);
    assert_int_equal(kilonerf.start_level, 4);
    assert_int_equal(kilonerf.width, 32);
    assert_int_equal(kilonerf.depth, 2);
    assert_int_equal(kilonerf.view_width, 32);
    assert_false(kilonerf.skip);
    assert_true(kilonerf.cull_from < 1); /* empty cells go */
}

/* The preset has voxels instead of networks, and its settings agree with each other. */
static void test_voxel_preset(void **state)
{
    const cln_config config = preset("voxel");
    double fraction[CLN_LEVELS];

    (void)state;
    assert_int_equal(cln_config_check(&config), CLN_OK);
    assert_int_equal(config.encoding, CLN_ENCODING_VOXEL);
    assert_int_equal(cln_config_levels(&config, fraction), CLN_OK);
    assert_true(fraction[5] < config.structure_from && fraction[6] > 1);
    assert_true(config.adaptive && !cln_config_merges(&config));
    assert_int_equal(cln_config_deepest(&config), 7);
    assert_int_equal(cln_config_most_leaves(&config, false), 16384);
    assert_true(config.beta1 == 0 && config.density_rate > 1 && config.harmonic_rate < 1);
    assert_true(config.smooth_density > 0 && config.smooth_colour > 0);
}

static const char *const preset_names[] = {"paper", "fast", "nerf", "kilonerf", "voxel"};
enum { PRESETS = sizeof preset_names / sizeof preset_names[0] };

/* The table itself: unique names, help texts, presets inside the ranges. */
static void test_rows(void **state)
{
    cln_config all[PRESETS];

    (void)state;
    for (int p = 0; p < PRESETS; p++)
        all[p] = preset(preset_names[p]);
    assert_true(cln_config_row_count > 60);
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        assert_ptr_equal(cln_config_find(row->option), row);
        assert_true(strlen(row->help) > 3);
        assert_non_null(row->group);
        assert_int_equal(strspn(row->option, "abcdefghijklmnopqrstuvwxyz0123456789-"),
                         strlen(row->option));
        for (int p = 0; p < PRESETS; p++) {
            const char *field = (const char *)&all[p] + row->offset;
            double value = 0;

            if (row->type == CLN_ROW_INT)
                value = *(const int *)(const void *)field;
            else if (row->type == CLN_ROW_REAL)
                value = *(const double *)(const void *)field;
            else
                continue;
            assert_true(row->min < row->max);
            assert_true(value >= row->min && value <= row->max);
        }
    }
    assert_string_equal(row_of("width")->group, "network");
    assert_string_equal(row_of("cull")->group, "tree");
    assert_string_equal(row_of("n1")->group, "sampling");
    assert_string_equal(row_of("lr")->group, "optim");
    assert_string_equal(row_of("seed")->group, "run");
    assert_null(cln_config_find("--rays"));
    assert_null(cln_config_find(""));
}

/* Setting the text of every row of one preset in another one gives the first. */
static void test_round_trip(void **state)
{
    (void)state;
    for (int p = 0; p < PRESETS; p++) {
        const cln_config from = preset(preset_names[p]);
        cln_config to = preset(preset_names[(p + 1) % PRESETS]);

        for (int i = 0; i < cln_config_row_count; i++) {
            char text[CLN_TEXT_BYTES];

            cln_config_text(&from, &cln_config_rows[i], text);
            assert_int_equal(cln_config_set(&to, &cln_config_rows[i], text), CLN_OK);
        }
        assert_same(&from, &to);
    }
}

/* Reals that are hard to print, and both ends of every range. */
static void test_round_trip_extremes(void **state)
{
    static const double hard[] = {0.1,           1.0 / 3,    DBL_MIN,
                                  5e-324,        DBL_MAX,    0x1p53 + 1,
                                  6.02214076e23, 1e22 + 1e6, 0.30000000000000004,
                                  123456.7};

    (void)state;
    for (size_t i = 0; i < sizeof hard / sizeof hard[0]; i++) {
        char text[CLN_NUMBER_BYTES];
        const char *end = NULL;
        double back = 0;

        cln_number_write(hard[i], text);
        assert_true(cln_number_read(text, &back, &end));
        assert_true(back == hard[i] && *end == 0);
    }
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        cln_config config = preset("fast");

        if (row->type != CLN_ROW_INT && row->type != CLN_ROW_REAL)
            continue;
        for (int e = 0; e < 2; e++) {
            char text[CLN_TEXT_BYTES], back[CLN_TEXT_BYTES];
            cln_config again;

            snprintf(text, sizeof text, "%.17g", e ? row->max : row->min);
            if (row->type == CLN_ROW_INT)
                snprintf(text, sizeof text, "%.0f", e ? row->max : row->min);
            assert_int_equal(cln_config_set(&config, row, text), CLN_OK);
            cln_config_text(&config, row, back);
            if (row->flags & CLN_ROW_AUTO && !e) /* a word is the least value */
                assert_string_equal(back, "auto");
            else
                assert_true(strtod(back, NULL) == (e ? row->max : row->min));
            again = preset("fast");
            assert_int_equal(cln_config_set(&again, row, back), CLN_OK);
            cln_config_text(&again, row, text);
            assert_string_equal(text, back);
        }
    }
}

/* Values just below and above every range are refused; the sentence names option, text, range. */
static void test_ranges(void **state)
{
    (void)state;
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        char text[64], words[256], min[CLN_NUMBER_BYTES], max[CLN_NUMBER_BYTES];

        if (row->type != CLN_ROW_INT && row->type != CLN_ROW_REAL)
            continue;
        for (int e = 0; e < 2; e++) {
            double limit = e ? row->max : row->min;

            if (row->type == CLN_ROW_INT) {
                snprintf(text, sizeof text, "%.0f", limit + (e ? 1 : -1));
                snprintf(min, sizeof min, "%.0f", row->min);
                snprintf(max, sizeof max, "%.0f", row->max);
            } else {
                snprintf(text, sizeof text, "%.17g", nextafter(limit, e ? INFINITY : -INFINITY));
                cln_number_write(row->min, min);
                cln_number_write(row->max, max);
            }
            snprintf(words, sizeof words, "--%s|'%s'|%s to %s", row->option, text, min, max);
            assert_refused(row->option, text, words);
        }
    }
    assert_refused("depth", "9", "--depth|'9'|whole number|2 to 8");
    assert_refused("seed", "99999999999999999999", "--seed|2147483647");
}

static void test_bad_texts(void **state)
{
    static const char *const not_real[] = {"",      " 1",    "1 ",    "nan",  "inf", "-inf",
                                           "0x1p3", "1,5",   "1e",    "1e5x", "--1", "e5",
                                           ".",     "1.2.3", "1e999", "abc",  "0.5s"};
    static const char *const not_int[] = {"",     " 1",  "1 ", "1.5", "1.5e0", "2e4x",
                                          "0x10", "ten", "-",  "16k", "1e-3",  "1e30"};
    static const char *const not_bool[] = {"", "Yes", "2", "on ", "y", "yes|no", "truefalse"};

    (void)state;
    for (size_t i = 0; i < sizeof not_real / sizeof not_real[0]; i++)
        assert_refused("uniform-share", not_real[i], "--uniform-share|number|0 to 1");
    for (size_t i = 0; i < sizeof not_int / sizeof not_int[0]; i++)
        assert_refused("rays", not_int[i], "--rays|whole number|16 to 1048576");
    for (size_t i = 0; i < sizeof not_bool / sizeof not_bool[0]; i++)
        assert_refused("skip", not_bool[i], "--skip|yes|no|true|false|1|0");
    assert_refused("stage1", "gathe", "--stage1|'gathe'|splat|gather");
    assert_refused("stage1", "splat|gather", "--stage1|not one of");
    assert_refused("stage1", "", "--stage1|''|splat");
    assert_refused("time-limit", "10x", "--time-limit|'10x'|90s, 10m, 2h");
    assert_refused("time-limit", "-5", "--time-limit|'-5'|0 to");
    assert_refused("time-limit", "10mm", "--time-limit");
    assert_refused("device-mem", "512X", "--device-mem|'512X'|512M, 4G");
    assert_refused("time-limit", "1h30", "--time-limit");
    assert_refused("time-limit", "1h-5m", "--time-limit");
    assert_refused("device-mem", "4GX", "--device-mem");
    assert_refused("device-mem", "4B", "--device-mem");
}

static void test_words_and_flags(void **state)
{
    static const char *const yes[] = {"yes", "true", "1"}, *const no[] = {"no", "false", "0"};
    cln_config config = preset("fast");
    char text[CLN_TEXT_BYTES + 1];

    (void)state;
    for (int i = 0; i < 3; i++) {
        assert_int_equal(cln_config_set(&config, row_of("skip"), yes[i]), CLN_OK);
        assert_true(config.skip);
        assert_int_equal(cln_config_set(&config, row_of("skip"), no[i]), CLN_OK);
        assert_false(config.skip);
    }
    assert_int_equal(cln_config_set(&config, row_of("steps"), "2e4"), CLN_OK);
    assert_int_equal(config.steps, 20000);
    assert_int_equal(cln_config_set(&config, row_of("rrelu-scope"), "element"), CLN_OK);
    assert_int_equal(config.rrelu_scope, CLN_RRELU_ELEMENT);
    assert_int_equal(cln_config_set(&config, row_of("rrelu-scope"), "neuron"), CLN_OK);
    assert_int_equal(config.rrelu_scope, CLN_RRELU_NEURON);
    assert_int_equal(cln_config_set(&config, row_of("density"), "exp"), CLN_OK);
    assert_int_equal(config.density, CLN_DENSITY_EXP);
    assert_int_equal(cln_config_set(&config, row_of("init"), "fan-in"), CLN_OK);
    assert_int_equal(config.init, CLN_INIT_FAN_IN);
    assert_int_equal(cln_config_set(&config, row_of("loss"), "huber"), CLN_OK);
    assert_int_equal(config.loss, CLN_LOSS_HUBER);

    memset(text, 'x', sizeof text);
    text[CLN_TEXT_BYTES] = 0;
    assert_refused("bbox", text, "--bbox|xxx|255");
    text[CLN_TEXT_BYTES - 1] = 0;
    assert_int_equal(cln_config_set(&config, row_of("bbox"), text), CLN_OK);
    assert_string_equal(config.bbox, text);
    assert_int_equal(cln_config_set(&config, row_of("bbox"), ""), CLN_OK);
    for (int i = 0; i < CLN_TEXT_BYTES; i++)
        assert_int_equal(config.bbox[i],
                         0); /* no rest of the longer text, so equal settings are equal bytes */
    /* Six numbers of 17 digits, as a program writes them, have room. */
    assert_int_equal(cln_config_set(&config, row_of("bbox"),
                                    "-1.2345678901234567e-100,-2.2345678901234567e+100,"
                                    "-3.2345678901234567e+100,1.2345678901234567e+100,"
                                    "2.2345678901234567e+100,3.2345678901234567e+100"),
                     CLN_OK);
    assert_int_equal(cln_config_check(&config), CLN_OK);
}

static void test_units(void **state)
{
    static const char *const texts[] = {"level-at", "eval-at",    "save-at",    "tree-from",
                                        "bbox",     "test-views", "train-views"};
    static const struct {
        const char *text;
        double value;
    } times[] = {{"1h30m", 5400}, {"1h0.5m2s", 3632}, {"10min", 600},
                 {"2min5s", 125}, {"1min", 60},       {"1m", 60}},
      sizes[] = {{"2GB", 0x1p31}, {"2GiB", 0x1p31}, {"2g", 0x1p31}, {"1.5kb", 1536}};
    cln_config config = preset("fast");
    double value = 0, three[3] = {7, 7, 7};

    (void)state;
    assert_int_equal(cln_config_set(&config, row_of("time-limit"), "10m"), CLN_OK);
    assert_true(config.time_limit == 600);
    assert_int_equal(cln_config_set(&config, row_of("time-limit"), "1.5h"), CLN_OK);
    assert_true(config.time_limit == 5400);
    assert_int_equal(cln_config_set(&config, row_of("time-limit"), "90"), CLN_OK);
    assert_true(config.time_limit == 90);
    assert_int_equal(cln_config_set(&config, row_of("save-every"), "90s"), CLN_OK);
    assert_true(config.save_every == 90);
    assert_int_equal(cln_config_set(&config, row_of("device-mem"), "512M"), CLN_OK);
    assert_true(config.device_mem == 512.0 * 1024 * 1024);
    assert_int_equal(cln_config_set(&config, row_of("device-mem"), "4G"), CLN_OK);
    assert_true(config.device_mem == 4.0 * 1024 * 1024 * 1024);
    assert_int_equal(cln_config_set(&config, row_of("device-mem"), "1e9"), CLN_OK);
    assert_true(config.device_mem == 1e9);
    config.downscale = 3;
    assert_int_equal(cln_config_set(&config, row_of("downscale"), "auto"), CLN_OK);
    assert_true(config.downscale == 0);
    assert_failed(cln_config_set(&config, row_of("rays"), "auto"), CLN_USAGE, "'auto'|--rays");
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) { /* as help and info say it */
        char got[CLN_TEXT_BYTES];

        assert_int_equal(cln_config_set(&config, row_of(texts[i]), "none"), CLN_OK);
        cln_config_text(&config, row_of(texts[i]), got);
        assert_string_equal(got, "");
    }
    assert_int_equal(cln_config_check(&config), CLN_OK);

    assert_int_equal(cln_config_set(&config, row_of("time-limit"), "1:30"), CLN_OK);
    assert_true(config.time_limit == 90);
    assert_int_equal(cln_config_set(&config, row_of("time-limit"), "1:02:03"), CLN_OK);
    assert_true(config.time_limit == 3723);
    assert_refused("time-limit", "1:60", "--time-limit|'1:60'|1:30");
    assert_refused("time-limit", "1:5", "'1:5'");
    assert_refused("time-limit", "1:00:00:00", "'1:00:00:00'");
    assert_refused("time-limit", ":30", "':30'");
    assert_int_equal(cln_parse_bytes("--size", "2K", &value), CLN_OK);
    assert_true(value == 2048);
    for (size_t i = 0; i < sizeof times / sizeof times[0]; i++) {
        assert_true(cln_seconds_read(times[i].text, &value, NULL));
        assert_true(value == times[i].value);
    }
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        assert_int_equal(cln_parse_bytes("--size", sizes[i].text, &value), CLN_OK);
        assert_true(value == sizes[i].value);
    }
    assert_false(cln_seconds_read("2d", &value, NULL) || cln_seconds_read("-2m", &value, NULL));
    assert_false(cln_seconds_read("1234567890:00", &value, NULL));
    value = 2048;
    assert_failed(cln_parse_bytes("--size", "M", &value), CLN_USAGE, "--size|'M'|512M");
    assert_failed(cln_parse_bytes("--size", "2048iB", &value), CLN_USAGE, "'2048iB'|512M");
    assert_failed(cln_parse_bytes("--size", "5Ki", &value), CLN_USAGE, "'5Ki'|512M");
    assert_failed(cln_parse_bytes("--size", "5Kix", &value), CLN_USAGE, "'5Kix'|512M");
    assert_true(value == 2048);
    assert_int_equal(cln_parse_reals("1,-2.5,3e2", 3, three), CLN_OK);
    assert_true(three[0] == 1 && three[1] == -2.5 && three[2] == 300);
    assert_failed(cln_parse_reals("1,2", 3, three), CLN_USAGE, "'1,2'|3 numbers");
    assert_failed(cln_parse_reals("1,2,3,4", 3, three), CLN_USAGE, "3 numbers");
    assert_failed(cln_parse_reals("1,2,", 3, three), CLN_USAGE, "3 numbers");
    assert_failed(cln_parse_reals("1;2;3", 3, three), CLN_USAGE, "3 numbers");
    assert_true(three[0] == 1 && three[1] == -2.5 && three[2] == 300);
}

/* A locale with a decimal comma changes neither texts nor JSON. */
static void test_locale(void **state)
{
    char text[CLN_TEXT_BYTES], number[32], formatted[32];
    cln_config config = preset("fast"), back = preset("paper");
    double pair[2] = {0, 0};
    json_t *object = NULL;

    (void)state;
    comma_locale_begin();
    snprintf(number, sizeof number, "%g", 0.5);
    cln_format(formatted, sizeof formatted, "%g %.*f %d", 0.5, 2, 0.25, 7);
    config.uniform_share = 0.375;
    cln_config_text(&config, row_of("uniform-share"), text);
    config.uniform_share = 0;
    cln_status st = cln_config_set(&config, row_of("uniform-share"), text);
    cln_status refused = cln_config_set(&config, row_of("lr"), "0,5");
    cln_clear_error();
    cln_status reals = cln_parse_reals("0.5,1.5", 2, pair);
    cln_status json = cln_config_to_json(&config, &object);
    if (json == CLN_OK)
        json = cln_config_from_json(object, &back);
    comma_locale_end(); /* before the first assertion may jump out */
    assert_string_equal(number, "0,5");
    assert_string_equal(formatted, "0.5 0.25 7");
    assert_string_equal(text, "0.375");
    assert_int_equal(st, CLN_OK);
    assert_true(config.uniform_share == 0.375);
    assert_int_equal(refused, CLN_USAGE);
    assert_int_equal(reals, CLN_OK);
    assert_int_equal(json, CLN_OK);
    assert_same(&config, &back);
    json_decref(object);
    assert_true(pair[0] == 0.5 && pair[1] == 1.5);
}

static void test_nearest(void **state)
{
    (void)state;
    assert_string_equal(cln_config_nearest("ray"), "rays");
    assert_string_equal(cln_config_nearest("sampels-per-ray"), "samples-per-ray");
    assert_string_equal(cln_config_nearest("--widht"), "width");
    assert_string_equal(cln_config_nearest("no-view-dependance"), "view-dependence");
    assert_string_equal(cln_config_nearest("time_limit"), "time-limit");
    for (int i = 0; i < cln_config_row_count; i++)
        assert_string_equal(cln_config_nearest(cln_config_rows[i].option),
                            cln_config_rows[i].option);
    assert_null(cln_config_nearest(""));
    assert_null(cln_config_nearest("foo"));
    assert_null(cln_config_nearest("a-name-that-is-very-much-longer-than-the-longest-option-of-"
                                   "this-program-and-goes-on"));
}

static json_t *to_json(const cln_config *config)
{
    json_t *object = NULL;

    assert_int_equal(cln_config_to_json(config, &object), CLN_OK);
    assert_non_null(object);
    return object;
}

/* Through an object and through printed text, as in run.json. */
static void test_json(void **state)
{
    (void)state;
    for (int p = 0; p < 2; p++) {
        cln_config from = preset(p ? "paper" : "fast"), to = preset(p ? "fast" : "paper");
        json_t *object = NULL, *parsed = NULL;
        char *text = NULL;

        from.lr = 0.1 + 0.2;
        from.time_limit = 1;
        snprintf(from.bbox, sizeof from.bbox, "-1,-1,-1,1,1,1");
        object = to_json(&from);
        assert_int_equal(json_object_size(object), cln_config_row_count);
        assert_string_equal(json_string_value(json_object_get(object, "stage1")),
                            p ? "splat" : "gather");
        text = json_dumps(object, JSON_INDENT(1));
        parsed = json_loads(text, 0, NULL);
        assert_non_null(parsed);
        assert_int_equal(cln_config_from_json(parsed, &to), CLN_OK);
        assert_same(&from, &to);
        free(text);
        json_decref(parsed);
        json_decref(object);
    }
}

/* Replaces one value of a good object; reading must fail and leave the target unchanged. */
static void assert_json_refused(const char *field, json_t *value, const char *words)
{
    cln_config config = preset("paper"), before = config;
    json_t *object = to_json(&config);

    if (value)
        assert_int_equal(json_object_set_new(object, field, value), 0);
    else
        assert_int_equal(json_object_del(object, field), 0);
    assert_failed(cln_config_from_json(object, &config), CLN_INPUT, words);
    assert_same(&before, &config);
    json_decref(object);
}

static void test_json_refused(void **state)
{
    cln_config config = preset("fast");
    json_t *array = json_array();

    (void)state;
    assert_json_refused("rays", NULL, "'rays'|missing");
    assert_json_refused("gloss", json_integer(1), "'gloss'|unknown");
    assert_json_refused("rays", json_real(100.5), "--rays|100.5|16 to");
    assert_json_refused("rays", json_integer(3), "--rays|'3'|16 to");
    assert_json_refused("rays", json_integer((json_int_t)1 << 40), "--rays");
    assert_json_refused("lr", json_integer(7), "--lr|'7'|to 1");
    assert_json_refused("lr", json_string("0.1"), "--lr");
    assert_json_refused("lr", json_null(), "--lr|null");
    assert_json_refused("skip", json_integer(1), "--skip");
    assert_json_refused("stage1", json_integer(0), "--stage1|splat");
    assert_json_refused("stage1", json_string("walk"), "--stage1|walk|splat");
    assert_json_refused("bbox", json_false(), "--bbox");
    assert_failed(cln_config_from_json(array, &config), CLN_INPUT, "object");
    json_decref(array);
}

/* A row that is missing in an older run's settings gets the value of the behaviour at that time. */
static void test_json_of_before(void **state)
{
    cln_config from = preset("fast"), to = preset("fast");
    json_t *object = to_json(&from);

    (void)state;
    assert_true(from.skip_uncovered);
    assert_true(from.roulette > 0);
    assert_int_equal(json_object_del(object, "skip_uncovered"), 0);
    assert_int_equal(json_object_del(object, "roulette"), 0);
    assert_int_equal(json_object_del(object, "moments"), 0);
    assert_int_equal(json_object_del(object, "cull_after"), 0);
    assert_int_equal(cln_config_from_json(object, &to), CLN_OK);
    from.skip_uncovered = false;
    from.roulette = 0;
    from.moments = CLN_MOMENTS_FLOAT32;
    from.cull_after = 0;
    assert_same(&from, &to);
    assert_int_equal(json_object_set_new(object, "skip_uncoverd", json_true()), 0);
    assert_failed(cln_config_from_json(object, &to), CLN_INPUT, "'skip_uncoverd'|unknown");
    json_decref(object);
}

/* The former name of a renamed row is still an option, and a key in older runs. */
static void test_alias(void **state)
{
    static const char *const names[][2] = {{"min_transmittance", "t_min"},
                                           {"render_min_transmittance", "render_t_min"}};
    cln_config from = preset("fast"), to = preset("paper");
    json_t *object = NULL;

    (void)state;
    assert_ptr_equal(row_of("t-min"), row_of("min-transmittance"));
    assert_ptr_equal(row_of("render-t-min"), row_of("render-min-transmittance"));
    assert_null(cln_config_find("t-mi"));
    from.min_transmittance = 0.125;
    from.render_min_transmittance = 0.0625;
    object = to_json(&from);
    for (int i = 0; i < 2; i++) {
        json_t *value = json_incref(json_object_get(object, names[i][0]));

        assert_null(json_object_get(object, names[i][1])); /* never written */
        assert_int_equal(json_object_del(object, names[i][0]), 0);
        assert_int_equal(json_object_set_new(object, names[i][1], value), 0);
    }
    assert_int_equal(cln_config_from_json(object, &to), CLN_OK);
    assert_same(&from, &to);
    assert_int_equal(json_object_set_new(object, "min_transmittance", json_real(0.25)), 0);
    assert_failed(cln_config_from_json(object, &to), CLN_INPUT, "'t_min'|unknown");
    assert_int_equal(json_object_del(object, "min_transmittance"), 0);
    assert_int_equal(json_object_del(object, "t_min"), 0);
    assert_failed(cln_config_from_json(object, &to), CLN_INPUT, "'min_transmittance'|missing");
    json_decref(object);
    assert_refused("t-min", "2", "--min-transmittance|'2'|0 to 0.5");
}

/* Finds a different value in every row that has the flag, of every type. */
static void test_differs(void **state)
{
    static const unsigned flags[] = {0, CLN_ROW_FIXED, CLN_ROW_SHAPE,
                                     CLN_ROW_FIXED | CLN_ROW_LATER};

    (void)state;
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        const cln_config a = preset("fast");
        cln_config b = a;
        char *field = (char *)&b + row->offset;

        if (row->type == CLN_ROW_TEXT)
            field[0] ^= 1;
        else if (row->type == CLN_ROW_BOOL)
            *(bool *)field = !*(bool *)field;
        else if (row->type == CLN_ROW_REAL)
            *(double *)(void *)field += 1e-3;
        else
            *(int *)(void *)field += 1;
        for (size_t f = 0; f < sizeof flags / sizeof flags[0]; f++) {
            const bool has = (row->flags & flags[f]) == flags[f];

            assert_null(cln_config_differs(&a, &a, flags[f]));
            assert_ptr_equal(cln_config_differs(&a, &b, flags[f]), has ? row : NULL);
        }
    }
    assert_true(row_of("n1")->flags & CLN_ROW_FIXED);
    assert_false(row_of("rays")->flags & CLN_ROW_FIXED);
}

/* Runs of before a row lack its key: unless it is CLN_ROW_LATER, they cannot be read any more. */
static void test_rows_of_first_runs(void **state)
{
    enum { ROWS_OF_FIRST_RUNS = 94 };
    int rows = 0;

    (void)state;
    for (int i = 0; i < cln_config_row_count; i++)
        rows += !(cln_config_rows[i].flags & CLN_ROW_LATER);
    if (rows != ROWS_OF_FIRST_RUNS)
        fail_msg(
            "%d rows are not CLN_ROW_LATER, %d are in the first runs: give a new row that flag",
            rows, ROWS_OF_FIRST_RUNS);
}

/* `info --like` names the rows that a step's time depends on, and none that it does not. */
static void test_time(void **state)
{
    static const char *const with[] = {"n1",        "samples-per-leaf", "stage1",     "grid-cells",
                                       "harmonics", "decoder-width",    "view-bands", "rays",
                                       "level-at",  "refresh-every",    "max-leaves"};
    static const char *const without[] = {"seed", "lr", "steps", "epochs", "save-every", "init"};

    (void)state;
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        if (row->flags & CLN_ROW_TUNE) /* what is tuned is a step's time */
            assert_true(row->flags & CLN_ROW_TIME);
    }
    for (size_t i = 0; i < sizeof with / sizeof *with; i++)
        assert_true(row_of(with[i])->flags & CLN_ROW_TIME);
    for (size_t i = 0; i < sizeof without / sizeof *without; i++)
        assert_false(row_of(without[i])->flags & CLN_ROW_TIME);
}

/* Every kind of leaf has a row; where leaves are no networks, nothing can be trained to merge. */
static void test_leaf_kinds(void **state)
{
    const char *words = row_of("encoding")->words;
    int kinds = 1;

    (void)state;
    for (const char *c = words; *c; c++)
        kinds += *c == '|';
    for (int i = 0; i < kinds; i++) {
        const cln_leaf_kind *kind = cln_leaf_kind_of(i);

        assert_int_equal(kind->merges, kind->network);
        assert_int_equal(kind->joined, i == CLN_ENCODING_VOXEL);
        assert_int_equal(kind->levels_first, i == CLN_ENCODING_VOXEL);
    }
}

/* Steps of epochs, and back. */
static void test_epochs(void **state)
{
    cln_config config = preset("fast");

    (void)state;
    config.epochs = 3;
    config.rays = 1000;
    assert_int_equal(cln_config_epoch_steps(&config, 1e6), 300);
    assert_true(cln_config_step_epochs(&config, 1e6, 250) == 2.5);
}

static cln_status levels(const char *text, int start, double fraction[CLN_LEVELS])
{
    cln_config config = preset("fast");

    config.start_level = start;
    snprintf(config.level_at, sizeof config.level_at, "%s", text);
    return cln_config_levels(&config, fraction);
}

static void test_level_at(void **state)
{
    double f[CLN_LEVELS] = {9, 9, 9, 9, 9, 9};

    (void)state;
    assert_int_equal(levels("3:0.08,4:0.25", 2, f), CLN_OK);
    assert_true(f[0] == 2 && f[1] == 2 && f[2] == 2 && f[3] == 0.08 && f[4] == 0.25 && f[5] == 2);
    assert_int_equal(levels("", 2, f), CLN_OK);
    for (int i = 0; i < 6; i++)
        assert_true(f[i] == 2);
    assert_int_equal(levels("1:0,2:0,5:1", 0, f),
                     CLN_OK); /* levels may be skipped or start at once */
    assert_true(f[1] == 0 && f[2] == 0 && f[3] == 2 && f[5] == 1);
    f[0] = 9;
    assert_failed(levels("3:0.3,4:0.2", 2, f), CLN_USAGE, "--level-at|4:0.2|before");
    assert_failed(levels("4:0.1,3:0.2", 2, f), CLN_USAGE, "--level-at|level 3|8");
    assert_failed(levels("3:0.1,3:0.2", 2, f), CLN_USAGE, "--level-at|ascend");
    assert_failed(levels("2:0.1", 2, f), CLN_USAGE, "--level-at|--start-level 2");
    assert_failed(levels("9:0.1", 2, f), CLN_USAGE, "--level-at|level 9|8");
    assert_failed(levels("3:1.1", 2, f), CLN_USAGE, "--level-at|3:1.1|0..1");
    assert_failed(levels("3:-0.1", 2, f), CLN_USAGE, "--level-at");
    assert_failed(levels("3", 2, f), CLN_USAGE, "--level-at|'3'|LEVEL:FRACTION");
    assert_failed(levels("3:", 2, f), CLN_USAGE, "--level-at");
    assert_failed(levels(":0.1", 2, f), CLN_USAGE, "--level-at");
    assert_failed(levels("3:0.1x", 2, f), CLN_USAGE, "--level-at");
    assert_failed(levels("3:0.1,", 2, f), CLN_USAGE, "--level-at|empty");
    assert_failed(levels(",3:0.1", 2, f), CLN_USAGE, "--level-at|empty");
    assert_failed(levels("3:0.1,,4:0.2", 2, f), CLN_USAGE, "--level-at|empty");
    assert_true(f[0] == 9);
}

static void test_points(void **state)
{
    static const char *const wrong[][2] = {
        {"2m,60s", "--eval-at|'60s'|later"},
        {"200,100", "--eval-at|'100'"},
        {"0", "--eval-at"},
        {"0s", "--eval-at"},
        {"1.5", "--eval-at|'1.5'"},
        {"soon", "--eval-at|'soon'"},
        {"10,", "--eval-at|empty"},
    };
    char many[256] = "1";
    cln_points p;

    (void)state;
    assert_int_equal(cln_config_points("eval-at", "60s,2m,5000", &p), CLN_OK);
    assert_int_equal(p.count, 3);
    assert_true(p.seconds[0] == 60 && p.seconds[1] == 120 && p.seconds[2] == 0);
    assert_true(p.steps[0] == 0 && p.steps[1] == 0 && p.steps[2] == 5000);
    assert_int_equal(cln_config_points("eval-at", "100,30s,200,1h", &p), CLN_OK);
    assert_int_equal(p.count, 4);
    assert_true(p.steps[0] == 100 && p.seconds[1] == 30 && p.steps[2] == 200 &&
                p.seconds[3] == 3600);
    assert_int_equal(cln_config_points("eval-at", "", &p), CLN_OK);
    assert_int_equal(p.count, 0);
    for (int i = 2; i <= CLN_POINTS + 1; i++)
        snprintf(many + strlen(many), sizeof many - strlen(many), ",%d", i);
    assert_failed(cln_config_points("save-at", many, &p), CLN_USAGE, "--save-at|more than 32");
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_failed(cln_config_points("eval-at", wrong[i][0], &p), CLN_USAGE, wrong[i][1]);
}

static cln_status background(const char *text, float rgb[3])
{
    cln_config config = preset("fast");
    cln_background_kind kind = CLN_BACKGROUND_GIVEN;
    cln_status st = CLN_OK;

    snprintf(config.background, sizeof config.background, "%s", text);
    st = cln_config_background(&config, &kind, rgb);
    assert_int_equal(kind, strcmp(text, "auto") == 0   ? CLN_BACKGROUND_AUTO
                           : strcmp(text, "mean") == 0 ? CLN_BACKGROUND_MEAN
                                                       : CLN_BACKGROUND_GIVEN);
    return st;
}

static void test_background(void **state)
{
    float rgb[3] = {9, 9, 9};

    (void)state;
    assert_int_equal(background("white", rgb), CLN_OK);
    assert_true(rgb[0] == 1 && rgb[1] == 1 && rgb[2] == 1);
    assert_int_equal(background("black", rgb), CLN_OK);
    assert_true(rgb[0] == 0 && rgb[1] == 0 && rgb[2] == 0);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(background(i ? "mean" : "auto", rgb), CLN_OK);
        assert_true(rgb[0] == 1 && rgb[1] == 1 && rgb[2] == 1);
    }
    assert_int_equal(background("0.25,0.5,1", rgb), CLN_OK);
    assert_true(rgb[0] == 0.25f && rgb[1] == 0.5f && rgb[2] == 1);
    assert_failed(background("1.5,0,0", rgb), CLN_USAGE, "--background|0..1");
    assert_failed(background("grey", rgb), CLN_USAGE, "--background|'grey'|white");
    assert_failed(background("", rgb), CLN_USAGE, "--background");
    assert_failed(background("0,0", rgb), CLN_USAGE, "--background");
    assert_true(rgb[0] == 0.25f);
}

/* Breaks each rule between rows separately. */
static void test_check(void **state)
{
    static const struct {
        const char *option, *value, *words;
    } cases[] = {
        {"width", "48", "--width|48|16, 32, 64"},
        {"view-width", "40", "--view-width|40|16"},
        {"rrelu-lower", "0.5", "--rrelu-lower|--rrelu-upper"},
        {"lr-final", "0.5", "--lr-final|--lr"},
        {"level-at", "3", "--level-at"},
        {"start-level", "4", "--level-at|--start-level 4"},
        {"eval-at", "x", "--eval-at"},
        {"save-at", "x", "--save-at"},
        {"background", "red", "--background"},
        {"bbox", "0,0,0,1,1", "--bbox|minx"},
        {"bbox", "0,0,0,0,1,1", "--bbox|along x"},
        {"bbox", "0,0,0,1,-1,1", "--bbox|along y"},
        {"bbox", "0,0,1,1,1,1", "--bbox|along z"},
        {"structure-from", "0.9", "--structure-from|0.9|--structure-until|--no-adaptive"},
        {"structure-until", "0.01", "--structure-from|--structure-until 0.01"},
        {"structure-from", "0.7", "--structure-from|0.7|not below|--structure-until 0.7"},
        {"max-level", "1", "--max-level|1|--start-level 2|--no-adaptive"},
        {"holdout-from", "8", "--holdout-from: 8|--holdout 8|from 0 to 7"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cln_config config = preset("fast");

        assert_int_equal(cln_config_set(&config, row_of(cases[i].option), cases[i].value), CLN_OK);
        assert_failed(cln_config_check(&config), CLN_USAGE, cases[i].words);
    }
    for (int max = 3; max <= 4; max++) {
        cln_config config = preset("fast");

        config.max_level = max;
        snprintf(config.level_at, sizeof config.level_at, "3:0.1,4:0.2");
        if (max == 4)
            assert_int_equal(cln_config_check(&config), CLN_OK);
        else
            assert_failed(cln_config_check(&config), CLN_USAGE,
                          "--max-level: 3|level 4|--level-at '3:0.1,4:0.2'|--no-adaptive");
    }
    /* The adaptive rows matter only if the tree adapts. */
    for (int kept = 0; kept < 3; kept++) {
        cln_config config = preset("fast");

        config.max_level = 1;
        config.structure_from = 0.9;
        config.adaptive = kept == 0;
        snprintf(config.tree_from, sizeof config.tree_from, "%s", kept == 1 ? "run" : "");
        if (kept == 0)
            assert_failed(cln_config_check(&config), CLN_USAGE, "--structure-from");
        else
            assert_int_equal(cln_config_check(&config), CLN_OK);
    }
    for (int width = 16; width <= 256; width *= 2) {
        cln_config config = preset("fast");

        config.width = width;
        snprintf(config.bbox, sizeof config.bbox, "-1,-2,-3,1,2,3");
        assert_int_equal(cln_config_check(&config), CLN_OK);
    }
}

int test_group_config(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_presets),
        cmocka_unit_test(test_switch_with_words),
        cmocka_unit_test(test_refine_poses),
        cmocka_unit_test(test_baselines),
        cmocka_unit_test(test_voxel_preset),
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_round_trip_extremes),
        cmocka_unit_test(test_ranges),
        cmocka_unit_test(test_bad_texts),
        cmocka_unit_test(test_words_and_flags),
        cmocka_unit_test(test_units),
        cmocka_unit_test(test_locale),
        cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_json),
        cmocka_unit_test(test_json_refused),
        cmocka_unit_test(test_json_of_before),
        cmocka_unit_test(test_alias),
        cmocka_unit_test(test_differs),
        cmocka_unit_test(test_rows_of_first_runs),
        cmocka_unit_test(test_time),
        cmocka_unit_test(test_epochs),
        cmocka_unit_test(test_leaf_kinds),
        cmocka_unit_test(test_level_at),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_background),
        cmocka_unit_test(test_check),
    };

    return cmocka_run_group_tests_name("config", tests, NULL, NULL);
}
