/* The command line (cli/parse.h, cli/option_table.h): every hyperparameter and every other option
 * set through the parser, precedence of line, environment, preset and resumed run, forms,
 * suggestions, refused lines with their sentences. Help texts: test_help.c. Oracle: lines and
 * values written down here, and the rows' own legal values. */
#include "unit.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/settings.h"
#include "cli/option_table.h"
#include "cli/parse.h"
#include "io/run_folder.h"
#include "scratch.h"
#include "tests.h"

enum { WORDS = 32 };

/* Splits a line at spaces and parses it; `words` keeps the arguments alive. */
typedef struct line {
    char text[1024];
    char *words[WORDS];
    int count;
    cln_options options;
    cln_status st;
} line;

static void parse(line *l, const char *text)
{
    char *save = NULL;

    cln_clear_error();
    memset(l, 0, sizeof *l);
    snprintf(l->text, sizeof l->text, "cl-nascent %s", text);
    for (char *word = strtok_r(l->text, " ", &save); word; word = strtok_r(NULL, " ", &save)) {
        assert_in_range(l->count, 0, WORDS - 1);
        l->words[l->count++] = word;
    }
    l->st = cln_options_parse(l->count, l->words, &l->options);
}

/* The same for a line that must be right. The caller ends it with done(). */
static const cln_options *parsed(line *l, const char *text)
{
    parse(l, text);
    if (l->st != CLN_OK)
        fail_msg("%s: %s", text, cln_error_text());
    return &l->options;
}

static void done(line *l)
{
    cln_options_free(&l->options);
    cln_clear_error();
}

/* The line is refused as wrong usage and the sentence has all the words ("a|b"). */
static void assert_refused(const char *text, const char *words)
{
    line l;
    char copy[256], *save = NULL;

    parse(&l, text);
    if (l.st != CLN_USAGE)
        fail_msg("%s: status %d, not CLN_USAGE (%s)", text, l.st, cln_error_text());
    snprintf(copy, sizeof copy, "%s", words);
    for (char *word = strtok_r(copy, "|", &save); word; word = strtok_r(NULL, "|", &save)) {
        if (!strstr(cln_error_text(), word))
            fail_msg("%s: '%s' is not in: %s", text, word, cln_error_text());
    }
    done(&l);
}

static int setup(void **state)
{
    (void)state;
    unsetenv("CL_NASCENT_DEVICE");
    unsetenv("CL_NASCENT_KERNEL_DIR");
    unsetenv("CL_NASCENT_TUNE_FILE");
    unsetenv("CL_NASCENT_PROGRESS");
    unsetenv("CI");
    setenv("TERM", "xterm", 1);
    return 0;
}

/* ---- hyperparameters ---- */

/* A legal value of a row that is neither preset's. */
static void other_value(const cln_config_row *row, const char *fast, const char *paper,
                        char out[CLN_TEXT_BYTES])
{
    static const char *const texts[][2] = {{"level-at", "4:0.5"},
                                           {"eval-at", "30s"},
                                           {"save-at", "30s"},
                                           {"tree-from", "other/run"},
                                           {"test-views", "none/list.txt"},
                                           {"train-views", "none/list.txt"},
                                           {"bbox", "-1,-1,-1,1,1,1"},
                                           {"background", "black"}};
    char words[CLN_TEXT_BYTES], *save = NULL;

    if (row->type == CLN_ROW_TEXT) {
        for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
            if (strcmp(texts[i][0], row->option) == 0) {
                snprintf(out, CLN_TEXT_BYTES, "%s", texts[i][1]);
                return;
            }
        }
        fail_msg("--%s: give this test a value for it", row->option);
    }
    if (row->type == CLN_ROW_BOOL) {
        snprintf(out, CLN_TEXT_BYTES, "%s", strcmp(fast, "yes") == 0 ? "no" : "yes");
        return;
    }
    if (row->type == CLN_ROW_ENUM) {
        snprintf(words, sizeof words, "%s", row->words);
        for (char *w = strtok_r(words, "|", &save); w; w = strtok_r(NULL, "|", &save))
            snprintf(out, CLN_TEXT_BYTES, "%s", w);
        if (strcmp(out, fast) == 0)
            snprintf(out, CLN_TEXT_BYTES, "%.*s", (int)strcspn(row->words, "|"), row->words);
        return;
    }
    snprintf(out, CLN_TEXT_BYTES, "%.6g", row->max);
    if (strcmp(out, fast) == 0 || strcmp(out, paper) == 0)
        snprintf(out, CLN_TEXT_BYTES, "%.6g", row->min);
    if (row->type == CLN_ROW_INT) {
        double value = atof(out);
        snprintf(out, CLN_TEXT_BYTES, "%.0f", value > row->max ? row->max : value);
    }
}

/* Values that belong together are checked after all are set, so some rows need another with
 * them. */
static const char *companion(const char *option)
{
    static const char *const with[][2] = {{"holdout-from", "--holdout=0"},
                                          {"start-level", "--level-at="},
                                          {"rrelu-lower", "--rrelu-upper=1"},
                                          {"rrelu-upper", "--rrelu-lower=-1"},
                                          {"structure-from", "--no-adaptive"},
                                          {"max-level", "--no-adaptive"},
                                          {"lr-final", "--lr=1"},
                                          {"encoding", "--no-adaptive"}};

    for (size_t i = 0; i < sizeof with / sizeof with[0]; i++) {
        if (strcmp(with[i][0], option) == 0)
            return with[i][1];
    }
    return "";
}

static void every_row_is_an_option(void **state)
{
    cln_config fast, paper, expected;

    (void)state;
    assert_int_equal(cln_config_preset("fast", &fast), CLN_OK);
    assert_int_equal(cln_config_preset("paper", &paper), CLN_OK);
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        char in_fast[CLN_TEXT_BYTES], in_paper[CLN_TEXT_BYTES], value[CLN_TEXT_BYTES];
        char got[CLN_TEXT_BYTES], wanted[CLN_TEXT_BYTES], text[512];

        cln_config_text(&fast, row, in_fast);
        cln_config_text(&paper, row, in_paper);
        other_value(row, in_fast, in_paper, value);
        expected = fast;
        assert_int_equal(cln_config_set(&expected, row, value), CLN_OK);
        cln_config_text(&expected, row, wanted);
        for (int form = 0; form < 2; form++) {
            line l;

            if (row->type == CLN_ROW_BOOL)
                snprintf(text, sizeof text, "train s -o r --%s%s",
                         strcmp(value, "no") == 0 ? "no-" : "", row->option);
            else
                snprintf(text, sizeof text, "train s --%s%s%s -o r %s", row->option,
                         form ? "=" : " ", value, companion(row->option));
            parsed(&l, text);
            cln_config_text(&l.options.settings->config, row, got);
            assert_string_equal(got, wanted);
            assert_string_not_equal(got, in_fast);
            done(&l);
        }
    }
}

static void presets_are_the_base(void **state)
{
    line l;
    cln_config paper, fast;
    char text[CLN_TEXT_BYTES], wanted[CLN_TEXT_BYTES];

    (void)state;
    assert_int_equal(cln_config_preset("paper", &paper), CLN_OK);
    assert_int_equal(cln_config_preset("fast", &fast), CLN_OK);
    parsed(&l, "train --rays 77 s --preset=paper -o r"); /* the preset may come after */
    assert_string_equal(l.options.preset, "paper");
    assert_int_equal(l.options.settings->config.rays, 77);
    for (int i = 0; i < cln_config_row_count; i++) {
        if (strcmp(cln_config_rows[i].option, "rays") == 0)
            continue;
        cln_config_text(&l.options.settings->config, &cln_config_rows[i], text);
        cln_config_text(&paper, &cln_config_rows[i], wanted);
        assert_string_equal(text, wanted);
    }
    done(&l);
    parsed(&l, "train s -o r --preset fast");
    assert_int_equal(l.options.settings->config.depth, fast.depth);
    assert_string_equal(l.options.preset, "fast");
    done(&l);
    parsed(&l, "train s -o r");
    assert_int_equal(l.options.settings->config.encoding, CLN_ENCODING_VOXEL);
    assert_string_equal(l.options.preset, "voxel");
    done(&l);
    assert_refused("train s -o r --preset=slow", "--preset|slow|voxel|fast|paper|nerf|kilonerf");
}

static void repeated_options_the_last_counts(void **state)
{
    line l;

    (void)state;
    parsed(&l,
           "train s -o a --steps 5 --skip --steps=7 --no-skip -o b --preset paper --preset fast");
    assert_int_equal(l.options.settings->config.steps, 7);
    assert_false(l.options.settings->config.skip);
    assert_string_equal(l.options.output, "b");
    assert_string_equal(l.options.preset, "fast");
    done(&l);
}

static void units_and_negative_numbers_are_values(void **state)
{
    line l;

    (void)state;
    parsed(&l, "train s -o r --time-limit 10m --device-mem 512M --rrelu-lower -0.5 --skip=yes");
    assert_true(l.options.settings->config.time_limit == 600);
    assert_true(l.options.settings->config.device_mem == 512.0 * 1024 * 1024);
    assert_true(l.options.settings->config.rrelu_lower == -0.5);
    assert_true(l.options.settings->config.skip);
    done(&l);
    parsed(&l, "render r --orbit --elevation -30");
    assert_true(l.options.elevation == -30);
    done(&l);
    parsed(&l, "render r --orbit --up -z --elevation 60");
    assert_string_equal(l.options.up, "-z");
    done(&l);
    parsed(&l, "export r --mesh x.glb --up y");
    assert_string_equal(l.options.up, "y");
    done(&l);
    parsed(&l, "view r --up -0.1,0,1");
    assert_string_equal(l.options.up, "-0.1,0,1");
    done(&l);
}

/* ---- the other options ---- */

static void every_other_option_is_read(void **state)
{
    line l;
    const cln_options *o = parsed(&l, "train scene -o run -d gpu --kernel-dir k --tune VW=8 "
                                      "--skip-selftest --dump-program p.lp --json --progress=bar "
                                      "-qvv");

    (void)state;
    assert_string_equal(o->command->name, "train");
    assert_string_equal(o->operand, "scene");
    assert_string_equal(o->output, "run");
    assert_string_equal(o->device.spec, "gpu");
    assert_string_equal(o->device.kernel_dir, "k");
    assert_string_equal(o->device.tune, "VW=8");
    assert_true(o->skip_selftest && o->json && o->quiet);
    assert_string_equal(o->dump_program, "p.lp");
    assert_int_equal(o->verbose, 2);
    assert_string_equal(o->progress, "bar");
    done(&l);

    o = parsed(&l,
               "eval run --split val --scene s --max-images 9 --no-save-images --min-psnr 28.5");
    assert_string_equal(o->split, "val");
    assert_string_equal(o->scene, "s");
    assert_int_equal(o->max_images, 9);
    assert_false(o->save_images);
    assert_true(o->min_psnr == 28.5);
    assert_null(o->views);
    done(&l);
    o = parsed(&l, "render run --bits 16");
    assert_string_equal(o->bits, "16");
    done(&l);
    o = parsed(&l, "render run --split train --views a,b.png");
    assert_string_equal(o->bits, "8");
    assert_string_equal(o->views, "a,b.png");
    done(&l);

    o = parsed(&l, "render run -oout --orbit 12 --radius 0.5 --width 64 --height 48 --fov 40 "
                   "--overwrite --z-depth");
    assert_string_equal(o->output, "out");
    assert_int_equal(o->orbit_frames, 12);
    assert_true(o->radius == 0.5 && o->fov == 40);
    assert_int_equal(o->image_width, 64);
    assert_int_equal(o->image_height, 48);
    assert_true(o->overwrite && o->z_depth);
    done(&l);

    o = parsed(&l, "info a --json b c");
    assert_int_equal(o->operand_count, 3);
    assert_string_equal(o->operand, "a");
    assert_string_equal(o->operands[2], "c");
    done(&l);

    o = parsed(&l, "export run --octree tree.ply --colour error --overwrite");
    assert_string_equal(o->operand, "run");
    assert_string_equal(o->export_file, "tree.ply");
    assert_string_equal(o->export_what, "octree");
    assert_string_equal(o->box_colour, "error");
    assert_true(o->overwrite);
    done(&l);

    o = parsed(&l, "export run --mesh m.glb --spacing 0.05 --closed --largest --triangles 90 "
                   "--scene s -d 1");
    assert_string_equal(o->export_what, "mesh");
    assert_string_equal(o->export_file, "m.glb");
    assert_string_equal(o->scene, "s");
    assert_string_equal(o->device.spec, "1");
    assert_true(o->spacing == 0.05 && o->closed && o->count == 0 && o->triangles == 90);
    assert_true(o->largest);
    done(&l);
    o = parsed(&l, "export run --points p.ply --count 1000 --crop -1,0,0,1,1,1");
    assert_true(o->spacing == 0 && !o->closed && o->count == 1000);
    assert_string_equal(o->crop, "-1,0,0,1,1,1");
    assert_false(o->largest);
    done(&l);

    o = parsed(&l, "devices --no-test");
    assert_false(o->test);
    done(&l);
    o = parsed(&l, "selftest --quick -d 0");
    assert_true(o->quick);
    assert_string_equal(o->device.spec, "0");
    done(&l);
    o = parsed(&l, "tune -o rows.txt --budget 5.5 --preset paper --width 128 -d 0");
    assert_string_equal(o->output, "rows.txt");
    assert_true(o->budget == 5.5);
    assert_int_equal(o->settings->config.width, 128);
    assert_int_equal(o->settings->config.depth, 8);
    done(&l);
    o = parsed(&l, "info scene --downscale 4");
    assert_int_equal(o->settings->config.downscale, 4);
    done(&l);
}

static void what_is_not_given_has_its_default(void **state)
{
    line l;
    const cln_options *o = parsed(&l, "eval run");

    (void)state;
    assert_string_equal(o->split, "test");
    assert_string_equal(o->device.spec, "auto");
    assert_null(o->scene);
    assert_int_equal(o->max_images, 0);
    assert_true(o->save_images);
    assert_false(o->json);
    assert_string_equal(o->progress, "auto");
    done(&l);
    o = parsed(&l, "render run");
    assert_int_equal(o->orbit_frames, 0);
    assert_null(o->output);
    done(&l);
    o = parsed(&l, "export run --octree tree.ply");
    assert_string_equal(o->box_colour, "level");
    assert_false(o->overwrite);
    done(&l);
    o = parsed(&l, "train s -o r");
    assert_null(o->dump_program);
    done(&l);
    o = parsed(&l, "devices");
    assert_true(o->test);
    done(&l);
}

static void orbit_takes_only_digits_for_its_value(void **state)
{
    line l;

    (void)state;
    parsed(&l, "render --orbit run");
    assert_int_equal(l.options.orbit_frames, 60);
    assert_string_equal(l.options.operand, "run");
    done(&l);
    parsed(&l, "render run --orbit");
    assert_int_equal(l.options.orbit_frames, 60);
    done(&l);
    parsed(&l, "render --orbit=7 run");
    assert_int_equal(l.options.orbit_frames, 7);
    done(&l);
    assert_refused("render run --orbit 0", "--orbit|'0'|1 to 100000");
    parsed(&l, "render --orbit -- run"); /* "--" is no number */
    assert_int_equal(l.options.orbit_frames, 60);
    assert_string_equal(l.options.operand, "run");
    done(&l);
    parsed(&l, "render --spiral -- -run");
    assert_string_equal(l.options.operand, "-run");
    done(&l);
    parsed(&l, "render --interpolate -- run");
    assert_string_equal(l.options.operand, "run");
    done(&l);
}

static void two_dashes_end_the_options(void **state)
{
    line l;

    (void)state;
    parsed(&l, "eval --json -- --split");
    assert_string_equal(l.options.operand, "--split");
    assert_true(l.options.json);
    done(&l);
}

static void environment_gives_way_to_the_line(void **state)
{
    line l;

    (void)state;
    setenv("CL_NASCENT_DEVICE", "cpu", 1);
    setenv("CL_NASCENT_KERNEL_DIR", "kernels", 1);
    parsed(&l, "selftest");
    assert_string_equal(l.options.device.spec, "cpu");
    assert_string_equal(l.options.device.kernel_dir, "kernels");
    done(&l);
    parsed(&l, "selftest -d gpu");
    assert_string_equal(l.options.device.spec, "gpu");
    assert_string_equal(l.options.device.kernel_dir, "kernels");
    done(&l);
    setenv("CL_NASCENT_DEVICE", "", 1); /* empty is unset */
    parsed(&l, "selftest");
    assert_string_equal(l.options.device.spec, "auto");
    done(&l);
}

/* The standard file of rows is read if it is there; one that is named must be, but for tune's
 * own. */
static void tune_file_is_found(void **state)
{
    char *folder = NULL, path[PATH_MAX + 32];
    void *scratch = NULL;
    line l;

    (void)state;
    assert_int_equal(scratch_make(&scratch), 0);
    folder = scratch;
    setenv("XDG_CONFIG_HOME", folder, 1);
    snprintf(path, sizeof path, "%s/cl-nascent/tune.txt", folder);
    parsed(&l, "selftest");
    assert_null(l.options.device.tune_file);
    assert_string_equal(l.options.tune_path, path);
    done(&l);
    *strrchr(path, '/') = 0;
    assert_int_equal(cln_make_dirs(path), CLN_OK);
    path[strlen(path)] = '/';
    scratch_put(path, "", 0);
    parsed(&l, "devices");
    assert_string_equal(l.options.device.tune_file, path);
    done(&l);
    setenv("CL_NASCENT_TUNE_FILE", "mine.txt", 1);
    parsed(&l, "eval run");
    assert_string_equal(l.options.device.tune_file, "mine.txt");
    done(&l);
    parsed(&l, "eval run --tune-file other.txt");
    assert_string_equal(l.options.device.tune_file, "other.txt");
    done(&l);
    parsed(&l, "tune --tune-file other.txt");
    assert_null(l.options.device.tune_file);
    assert_string_equal(l.options.tune_path, "other.txt");
    done(&l);
    unsetenv("CL_NASCENT_TUNE_FILE");
    unsetenv("XDG_CONFIG_HOME");
    assert_int_equal(scratch_remove(&scratch), 0);
}

static void terminals_that_cannot_redraw_get_lines(void **state)
{
    line l;

    (void)state;
    setenv("TERM", "dumb", 1);
    parsed(&l, "eval r");
    assert_string_equal(l.options.progress, "line");
    done(&l);
    parsed(&l, "eval r --progress bar");
    assert_string_equal(l.options.progress, "bar");
    done(&l);
    setenv("TERM", "xterm", 1);
    setenv("CI", "true", 1);
    parsed(&l, "eval r");
    assert_string_equal(l.options.progress, "line");
    done(&l);
    unsetenv("CI");
    parsed(&l, "eval r -q");
    assert_string_equal(l.options.progress, "none");
    done(&l);
    setenv("CL_NASCENT_PROGRESS", "line", 1);
    parsed(&l, "eval r");
    assert_string_equal(l.options.progress, "line");
    done(&l);
    parsed(&l, "eval r --progress bar");
    assert_string_equal(l.options.progress, "bar");
    done(&l);
    setenv("CL_NASCENT_PROGRESS", "lines", 1);
    assert_refused("eval r", "CL_NASCENT_PROGRESS|'lines'|auto|line");
    parsed(&l, "eval r --progress none"); /* what is given goes before */
    assert_string_equal(l.options.progress, "none");
    done(&l);
    parsed(&l, "eval --help");
    assert_true(l.options.help);
    done(&l);
    unsetenv("CL_NASCENT_PROGRESS");
}

static void the_line_is_kept_as_it_could_be_typed_again(void **state)
{
    char *words[] = {"cl-nascent", "eval", "my run's", "--split", "val"};
    cln_options options;

    (void)state;
    assert_int_equal(cln_options_parse(5, words, &options), CLN_OK);
    assert_string_equal(options.line, "cl-nascent eval 'my run'\\''s' --split val");
    cln_options_free(&options);
}

/* ---- resume ---- */

/* RUN/run.json with budgets as given, as train leaves it. */
static void make_run(const char *run, int steps, double time_limit)
{
    cln_config config;
    json_t *settings = NULL, *document = NULL;

    assert_int_equal(cln_config_preset("paper", &config), CLN_OK);
    config.steps = steps;
    config.time_limit = time_limit;
    config.seed = 7;
    assert_int_equal(cln_config_to_json(&config, &settings), CLN_OK);
    document = json_pack("{s:s s:s s:s s:s s:o s:s s:{s:s}}", "schema", "cl-nascent.run/1",
                         "version", CLN_VERSION, "command", "cl-nascent train s", "preset", "paper",
                         "config", settings, "state", "interrupted", "dataset", "path", "s");
    assert_non_null(document);
    assert_int_equal(cln_run_write_json(run, "run.json", document), CLN_OK);
    json_decref(document);
}

static void resume_starts_from_the_runs_settings(void **state)
{
    const char *run = scratch_path(*state, "run");
    char text[512];
    line l;
    cln_config paper;

    assert_int_equal(cln_config_preset("paper", &paper), CLN_OK);
    make_run(run, 1000, 600);
    snprintf(text, sizeof text, "train --resume %s --lr 0.125", run);
    parsed(&l, text);
    assert_null(l.options.operand);
    assert_string_equal(l.options.resume, run);
    assert_int_equal(l.options.settings->config.seed, 7);
    assert_int_equal(l.options.settings->config.steps, 1000);
    assert_int_equal(l.options.settings->config.depth, paper.depth);
    assert_true(l.options.settings->config.lr == 0.125);
    done(&l);
    snprintf(text, sizeof text, "train --resume %s --steps +500 --time-limit=+5m", run);
    parsed(&l, text);
    assert_int_equal(l.options.settings->config.steps, 1500);
    assert_true(l.options.settings->config.time_limit == 900);
    done(&l);
    snprintf(text, sizeof text, "train --resume %s --steps +500 --steps +20", run);
    parsed(&l, text);
    assert_int_equal(l.options.settings->config.steps, 1020);
    done(&l);
    snprintf(text, sizeof text, "train --resume %s --steps 300", run);
    parsed(&l, text);
    assert_int_equal(l.options.settings->config.steps, 300);
    done(&l);
}

static void resume_refuses_what_contradicts_it(void **state)
{
    const char *run = scratch_path(*state, "run");
    char text[512];
    line l;

    make_run(run, 0, 600);
    snprintf(text, sizeof text, "train --resume %s --steps +500", run);
    assert_refused(text, "--steps +500|no such budget");
    snprintf(text, sizeof text, "train --resume %s --time-limit +x", run);
    assert_refused(text, "--time-limit|'x'");
    snprintf(text, sizeof text, "train --resume %s --preset fast", run);
    assert_refused(text, "--preset");
    snprintf(text, sizeof text, "train --resume %s -o elsewhere", run);
    assert_refused(text, "elsewhere|--resume");
    assert_refused("train s -o r --steps +500", "--steps|--resume");
    parse(&l, "train --resume /nonexistent/run");
    assert_int_not_equal(l.st, CLN_OK);
    assert_int_not_equal(l.st, CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "/nonexistent/run"));
    done(&l);
}

/* The same line begins a run and goes on with it, by whether it has a checkpoint. */
static void resume_or_start_looks_for_a_checkpoint(void **state)
{
    const char *run = scratch_path(*state, "run"), *checkpoints = scratch_path(run, "checkpoint");
    char text[512];
    line l;

    snprintf(text, sizeof text,
             "train s -o %s --resume-or-start --preset paper --lr 0.125 --steps 1000", run);
    for (int i = 0; i < 3; i++) { /* no folder; a run; one killed in its first checkpoint */
        parsed(&l, text);
        assert_null(l.options.resume);
        assert_string_equal(l.options.output, run);
        assert_int_not_equal(l.options.settings->config.seed, 7);
        done(&l);
        make_run(run, 1000, 600);
        if (i == 1) {
            assert_int_equal(cln_make_dirs(checkpoints), CLN_OK);
            scratch_put(scratch_path(checkpoints, "00000100.safetensors.tmp.5"), "", 0);
        }
    }
    scratch_put(scratch_path(checkpoints, "00000100.json"), "", 0); /* whole or not */
    parsed(&l, text);
    assert_string_equal(l.options.resume, run);
    assert_null(l.options.output);
    assert_string_equal(l.options.operand, "s");
    assert_int_equal(l.options.settings->config.seed, 7);
    assert_true(l.options.settings->config.lr == 0.125);
    assert_true(cln_settings_has(l.options.settings, "lr"));
    assert_false(cln_settings_has(l.options.settings, "steps")); /* the run's own */
    done(&l);
    snprintf(text, sizeof text, "train s -o %s --resume-or-start --settings-of gone", run);
    parsed(&l, text); /* it began with them */
    done(&l);
    snprintf(text, sizeof text, "train s -o %s --resume-or-start --preset fast", run);
    assert_refused(text, "--preset fast|began with preset paper");
    snprintf(text, sizeof text, "train -o %s --resume-or-start", run);
    assert_refused(text, "SCENE");
    assert_refused("train s --resume-or-start", "-o RUN");
    assert_refused("train --resume r --resume-or-start", "--resume-or-start|--resume|-o RUN");
    assert_int_equal(unlink(scratch_path(run, "run.json")), 0);
    snprintf(text, sizeof text, "train s -o %s --resume-or-start", run);
    parsed(&l, text); /* no run of ours, so it is a new one's that is refused */
    assert_null(l.options.resume);
    done(&l);
}

/* ---- refused lines ---- */

static void wrong_lines_are_refused_with_a_reason(void **state)
{
    static const struct {
        const char *line, *words;
    } cases[] = {
        {"", "command"},
        {"trian s", "'trian'|did you mean 'train'"},
        {"runs", "'runs'|info RUN RUN"},
        {"report r", "'report'|RUN/report.html"},
        {"xyzzyplugh", "unknown command 'xyzzyplugh'"},
        {"ren", "unknown command 'ren'; did you mean 'render'?"},
        {"orbit", "unknown command 'orbit'; --orbit is an option: `cl-nascent help --orbit` tells"},
        {"resume", "train --resume RUN"},
        {"help rendre", "did you mean 'render'"},
        {"-v train s", "-v|after the command"},
        {"train s -o r --stpes 5", "--stpes|did you mean --steps"},
        {"train s -o r --no-skp", "--no-skp|did you mean --no-skip"},
        {"train s -o r --no-steps", "--no-steps"},
        {"train s -o r --quux", "unknown option --quux"},
        {"info -x", "unknown option -x"},
        {"devices -d cpu", "--device is not an option of devices, only of"},
        {"info s --no-adaptive", "--no-adaptive is not an option of info, only of train, check"},
        {"export r -o m.glb", "-o|--mesh FILE"},
        {"export r --output=m.glb", "--output|--mesh FILE"},
        {"info a b --like c", "--like requires one SCENE|2 names"},
        {"info a --downscale 4 b c", "--downscale requires one SCENE|3 names"},
        {"info a b --preset fast", "--preset requires one SCENE"},
        {"info a b --no-conf", "--no-conf requires one SCENE"},
        {"train s -o r --orbit", "--orbit is not an option of train|only of render"},
        {"eval r --lr 3", "--lr is not an option of eval|only of train"},
        {"train s -o r -z", "-z"},
        {"train s -o r --steps", "--steps needs a value"},
        {"train s -o r --steps --skip", "--steps needs a value"},
        {"train s -o r --json=1", "--json takes no value"},
        {"train s -o", "--output needs a value"},
        {"train s -o -q", "--output needs a value"},
        {"train s -o r --steps 5x", "--steps|'5x'|whole number"},
        {"train s -o r --steps 1.5", "--steps|'1.5'"},
        {"train s -o r --steps -1", "--steps|'-1'|0 to"},
        {"train s -o r --lr fast", "--lr|'fast'"},
        {"train s -o r --lr nan", "--lr|'nan'"},
        {"train s -o r --cull maybe", "--cull|'maybe'|guarded|mean"},
        {"train s -o r --skip=perhaps", "--skip|'perhaps'"},
        {"train s -o r --width 48", "--width|48"},
        {"train s -o r --time-limit 5d", "--time-limit|'5d'|10m"},
        {"train s", "-o RUN"},
        {"train -o r", "SCENE|--resume"},
        {"train s t -o r", "'t'|one SCENE|'s'"},
        {"eval", "eval: RUN is missing"},
        {"export --octree f", "export: RUN is missing"},
        {"export r", "give one of --points FILE.ply, --mesh FILE"},
        {"export r --octree", "--octree needs a value"},
        {"export r --octree f --colour red", "--colour|'red'|level|error"},
        {"export r --octree f --mesh g", "--octree and --mesh|one at a time"},
        {"export r --mesh f --spacing 0", "--spacing|'0'"},
        {"export r --mesh f --triangles 3", "--triangles|'3'|4 to"},
        {"eval r --octree f", "--octree is not an option of eval|only of export"},
        {"devices here", "'here'"},
        {"eval r --max-images many", "--max-images|'many'"},
        {"render r --orbit 3 --views a", "--views cannot be combined with --orbit"},
        {"render r --poses f --views a", "--views cannot be combined with --poses"},
        {"view r --views a", "--views is not an option of view|only of eval, render"},
        {"eval r --max-images 1.5", "--max-images|'1.5'|whole"},
        {"eval r --split every", "--split|'every'|train|val|test|all"},
        {"eval r --scene=", "--scene|empty"},
        {"render r --orbit --split test", "--orbit and --split cannot be combined"},
        {"render r --elevation 6", "--elevation requires --orbit"},
        {"render r --spiral --circle", "--circle requires --orbit"},
        {"train s -o r --lr 0,1", "'0,1' is not a number from 1e-08 to 1; fractions have a point"},
        {"render r --loop", "--loop requires --interpolate"},
        {"render r --orbit --loop", "--loop requires --interpolate; an orbit"},
        {"render r --up z", "--up requires --orbit, --spiral, --map or --interpolate"},
        {"render r --spacing 1", "--spacing requires --map"},
        {"render r --orbit --offset 1,2,3", "--offset requires --map"},
        {"render r --map --views a", "--views cannot be combined with --map"},
        {"render r --map --interpolate", "--interpolate cannot be combined with --map"},
        {"render r --map --orbit", "--orbit and --map cannot be combined"},
        {"render r --map --fov 40", "--fov requires --orbit"},
        {"render r --map --radius 2", "--radius requires --orbit"},
        {"render r --fov 40", "--fov requires --orbit, --spiral or --interpolate"},
        {"render r --poses f.json --split test", "--poses and --split cannot be combined"},
        {"render r --spiral --interpolate", "--interpolate cannot be combined with --spiral"},
        {"train s -o r --tree", "did you mean --tree-from"},
        {"poses p -o s --masks m", "only of train|did you mean --mask-path?"},
        {"train s -o r –steps 5", "'–steps' begins with a dash|type --steps"},
        {"train s —–o r", "type -o"},
        {"train s –", "'–' is a dash alone"},
        {"eval r −-json", "type --json"},
        {"train s -o r --time 5", "did you mean --time-limit"},
        {"train s -o r --no-ndc", "unknown option --no-ndc; did you mean --space cube?"},
        {"info s --no_ndc", "unknown option --no_ndc; did you mean --space cube?"},
        {"check s --ndc", "unknown option --ndc; did you mean --space ndc?"},
        {"render r --no-ndc", "unknown option --no-ndc"}, /* the run has its space */
        {"train s -o r --n_iters 5", "did you mean --steps?"},
        {"train s -o r -steps 5", "-steps|two dashes|--steps"},
        {"tune --budget 5d", "--budget|'5d'|90s"},
        {"bugreport r --json", "--json"},
        {"render r --orbit --fov 200", "--fov|'200'|175"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_refused(cases[i].line, cases[i].words);
}

/* ---- asking for help ---- */

static void help_is_asked_for_in_three_ways(void **state)
{
    static const char *const lines[] = {"help train", "train --help", "train s -h", "train -h s"};
    line l;

    (void)state;
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        parsed(&l, lines[i]); /* nothing that is missing matters then */
        assert_true(l.options.help);
        assert_string_equal(l.options.command->name, "train");
        done(&l);
    }
    parsed(&l, "--help");
    assert_true(l.options.help);
    assert_null(l.options.command);
    done(&l);
    parsed(&l, "help");
    assert_true(l.options.help);
    done(&l);
    parsed(&l, "help train --preset nerf");
    assert_true(l.options.help);
    assert_string_equal(l.options.help_preset, "nerf");
    done(&l);
    parsed(&l, "train --help --preset=paper");
    assert_string_equal(l.options.help_preset, "paper");
    done(&l);
    parsed(&l, "train --help");
    assert_null(l.options.help_preset);
    done(&l);
    parsed(&l, "help --help");
    assert_true(l.options.help);
    done(&l);
    parsed(&l, "--version -v");
    assert_true(l.options.version);
    assert_int_equal(l.options.verbose, 1);
    done(&l);
}

int test_group_options(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_row_is_an_option),
        cmocka_unit_test(presets_are_the_base),
        cmocka_unit_test(repeated_options_the_last_counts),
        cmocka_unit_test(units_and_negative_numbers_are_values),
        cmocka_unit_test(every_other_option_is_read),
        cmocka_unit_test(what_is_not_given_has_its_default),
        cmocka_unit_test(orbit_takes_only_digits_for_its_value),
        cmocka_unit_test(two_dashes_end_the_options),
        cmocka_unit_test_setup_teardown(environment_gives_way_to_the_line, setup, setup),
        cmocka_unit_test_setup_teardown(tune_file_is_found, setup, setup),
        cmocka_unit_test_setup_teardown(terminals_that_cannot_redraw_get_lines, setup, setup),
        cmocka_unit_test(the_line_is_kept_as_it_could_be_typed_again),
        cmocka_unit_test_setup_teardown(resume_starts_from_the_runs_settings, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(resume_refuses_what_contradicts_it, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(resume_or_start_looks_for_a_checkpoint, scratch_make,
                                        scratch_remove),
        cmocka_unit_test(wrong_lines_are_refused_with_a_reason),
        cmocka_unit_test(help_is_asked_for_in_three_ways),
    };

    return cmocka_run_group_tests_name("options", tests, setup, NULL);
}
