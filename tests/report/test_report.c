/* The report. Tested: the page shows the contents of a hand-made run folder, its HTML is well
 * formed, names with markup stay text, missing and damaged files still give a page. Oracle: literal
 * texts and numbers. */
#include "unit.h"
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/config.h"
#include "io/image.h"
#include "report/report.h"
#include "report/report_data.h"
#include "report/report_sections.h"
#include "io/run_folder.h"
#include "page.h"
#include "scratch.h"
#include "tests.h"

/* ---- a run folder ---- */

static void put_text(const char *run, const char *name, const char *text)
{
    scratch_put(scratch_path(run, name), text, strlen(text));
}

static void put_json(const char *run, const char *name, json_t *document)
{
    assert_non_null(document);
    assert_int_equal(cln_run_write_json(run, name, document), CLN_OK);
    json_decref(document);
}

static void put_run_of(const char *run, const char *preset, const char *state, const char *left_out)
{
    cln_config config;
    json_t *settings = NULL;

    assert_int_equal(cln_config_preset(preset, &config), CLN_OK);
    config.seed = 4711;
    assert_int_equal(cln_config_to_json(&config, &settings), CLN_OK);
    put_json(
        run, "run.json",
        json_pack("{s:s s:s s:s s:s s:o s:{s:s s:f s:f s:i} s:{s:s s:{s:i s:i s:i}} s:s s:s s:[s] "
                  "s:[s] "
                  "s:{s:i s:i s:i}}",
                  "schema", "cl-nascent.run/1", "version", "0.1.0", "command",
                  "cl-nascent train a<b -o run", "preset", preset, "config", settings, "device",
                  "name", "Some \"Device\" & Co", "global_mem", 8589934592.0, "max_alloc",
                  1073741824.0, "compute_units", 12, "dataset", "path", "scenes/pot", "splits",
                  "train", 90, "val", 0, "test", 10, "state", state, "started",
                  "2025-01-02T03:04:05Z", "left_out", left_out, "warnings", "low <light>", "plan",
                  "parameters", 3145728, "images", 1048576, "limit", 8388608));
}

static void put_run(const char *run, const char *state, const char *left_out)
{
    put_run_of(run, "fast", state, left_out);
}

static void add_text(const char *run, const char *name, const char *text)
{
    FILE *f = fopen(scratch_path(run, name), "a");

    assert_non_null(f);
    assert_true(fputs(text, f) >= 0);
    assert_int_equal(fclose(f), 0);
}

/* Writes rows with PSNR rising from 10 to 30, and test PSNR in every tenth. */
static void put_metrics(const char *run, int rows)
{
    FILE *f = NULL;

    assert_int_equal(cln_make_dirs(run), CLN_OK);
    f = fopen(scratch_path(run, "metrics.jsonl"), "w");
    assert_non_null(f);
    for (int i = 1; i <= rows; i++) {
        char test[32] = "null";
        if (i % 10 == 0)
            snprintf(test, sizeof test, "%g", 9 + 20.0 * i / rows);
        fprintf(
            f,
            "{\"step\":%d,\"seconds\":%g,\"wall_seconds\":%g,\"psnr_train\":%g,\"psnr_test\":%s,"
            "\"rays_per_s\":1000,\"samples_per_ray\":9,\"leaves\":%d,\"params\":5000,"
            "\"stages\":{\"forward\":0.3,\"backward\":0.5,\"evaluation\":0.4}}\n",
            i * 25, (double)i, i * 1.1, 10 + 20.0 * i / rows, test, i < rows / 2 ? 64 : 512);
    }
    assert_int_equal(fclose(f), 0);
}

static void put_eval(const char *run, int step, const char *split, double psnr, json_t *images)
{
    char name[64];

    snprintf(name, sizeof name, "eval/%08d-%s.json", step, split);
    put_json(run, name,
             json_pack("{s:s s:i s:f s:s s:[i,i,i] s:{s:f s:f} s:o}", "schema", "cl-nascent.eval/1",
                       "step", step, "train_seconds", step / 25.0, "split", split, "background", 1,
                       1, 1, "mean", "psnr", psnr, "ssim", 0.9375, "images", images));
}

static json_t *one_image(const char *name, double psnr)
{
    return json_pack("{s:s s:i s:i s:o s:f s:f}", "name", name, "width", 16, "height", 12, "psnr",
                     cln_json_real(psnr), "ssim", 0.875, "seconds", 0.5);
}

static void put_picture(const char *run, const char *stem, const char *file)
{
    char folder[64];
    uint8_t pixels[16 * 12 * 3];

    memset(pixels, 77, sizeof pixels);
    snprintf(folder, sizeof folder, "eval/%s", stem);
    assert_int_equal(cln_make_dirs(scratch_path(run, folder)), CLN_OK);
    assert_int_equal(
        cln_image_write_png(scratch_path(scratch_path(run, folder), file), 16, 12, 3, pixels),
        CLN_OK);
}

/* The page of the run; the caller frees it. */
static char *page_until(const char *run, int64_t step)
{
    size_t bytes = 0;
    char *page = NULL;

    if (cln_report_write(run, step) != CLN_OK)
        fail_msg("%s", cln_error_text());
    assert_string_equal(cln_error_text(), ""); /* skipped files leave no error */
    page = scratch_get(scratch_path(run, "report.html"), &bytes);
    assert_int_equal(strlen(page), bytes);
    assert_ptr_equal(strstr(page, "<!doctype html>"), page);
    assert_non_null(strstr(page, "</main>"));
    assert_null(strstr(page, "nan"));
    assert_null(strstr(page, "inf"));
    assert_well_formed(page);
    return page;
}

static char *page_of(const char *run)
{
    return page_until(run, INT64_MAX);
}

/* ---- the page ---- */

static void page_shows_what_the_run_left(void **state)
{
    const char *run = scratch_path(*state, "pot");
    json_t *images = json_array();
    char *page = NULL;

    put_run(run, "done", "lens distortion: all cameras are pinholes");
    put_metrics(run, 100);
    json_array_append_new(images, one_image("test/r_0.png", 27.25));
    json_array_append_new(images, one_image("test/r_1.png", 26.75));
    put_eval(run, 2500, "test", 27.0, images);
    put_picture(run, "00002500-test", "test_r_0.png");
    put_picture(run, "00002500-test", "test_r_0.truth.png");
    put_picture(run, "00002500-test", "test_r_0.error.png");
    page = page_of(run);
    assert_has(page, "<h1>pot <span class='state'>done</span>");
    assert_has(page, "27.00 <small>dB</small></b><span>test PSNR after 01:40");
    assert_has(page, "0.9375");
    assert_has(page, "cl-nascent train a&lt;b -o run");
    assert_has(page, "Some &quot;Device&quot; &amp; Co");
    assert_has(page, "8.0 GiB, largest allocation 1.0 GiB");
    assert_has(page, "lens distortion: all cameras are pinholes");
    assert_has(page, "<b>test/r_0.png</b>");
    assert_has(page, "PSNR 27.25 dB &middot; SSIM 0.8750");
    assert_has(page, "on background white");
    assert_int_equal(count_of(page, "data:image/png;base64,"), 3);
    assert_has(page, "alt=\"error of test/r_0.png\"");
    assert_has(page, "4711 <span class=soft>(42)</span>"); /* differs from the preset */
    assert_int_equal(count_of(page, "<tr class=set>"), 1);
    assert_has(page, "backward");
    assert_has(page, "50.0"); /* of 100 seconds of training: 100 x 0.5 */
    assert_has(page, "20.0"); /* and the rest, between the stages */
    assert_has(page, "Not in the table: evaluation 00:40. Training took 01:40; 01:50 by the clock");
    assert_has(page, "90 train, 0 val, 10 test");
    assert_has(page, "<th scope=row class=soft>total<td class=n>4.0 MiB"); /* without the limit */
    assert_has(page, "<th scope=row class=soft>limit<td class=n>8.0 MiB");
    assert_int_equal(count_in(page, "error", "<svg "), 5);
    assert_int_equal(count_of(page, "r='4.5'"), 2); /* the evaluation, in both PSNR curves */
    /* test points of the metrics, in both curves */
    assert_int_equal(count_of(page, "r='2.6'"), 20);
    free(page);
}

/* Of voxels: files say networks for the stages of leaves, the page says what they are. Settings
 * that do nothing are named below the tables. */
static void words_are_those_of_the_leaves(void **state)
{
    static const struct {
        const char *preset, *has, *has_not, *listed, *idle;
    } runs[] = {
        {"voxel", "voxels backward", "networks ", "<th scope=row>harmonics<td",
         "<th scope=row>view-width<td"},
        {"fast", "networks backward", "voxels ", "<th scope=row>view-width<td",
         "<th scope=row>harmonics<td"},
    };

    for (int i = 0; i < 2; i++) {
        const char *run = scratch_path(*state, runs[i].preset), *named = NULL;
        char *page = NULL;

        assert_int_equal(cln_make_dirs(run), CLN_OK);
        put_run_of(run, runs[i].preset, "done", "nothing");
        put_text(run, "metrics.jsonl",
                 "{\"step\":10,\"seconds\":2,\"rays_per_s\":500,\"ranks\":2,\"sent_bytes\":9000,"
                 "\"message_seconds\":0.5,\"stages\":{\"networks forward\":0.5,"
                 "\"networks backward\":1},\"ranks_stages\":{\"networks forward\":[0.1,0.3]}}\n"
                 "{\"event\":\"structure\",\"step\":9,\"seconds\":1.5,\"leaves\":8,\"split\":1}\n");
        page = page_of(run);
        assert_int_equal(count_of(page, "merged"), 3 * i); /* voxels only split */
        assert_has(page, runs[i].has);
        assert_int_equal(count_in(page, "stages", runs[i].has_not), 0);
        assert_int_equal(count_in(page, "ranks", runs[i].has_not), 0);
        assert_has(page, runs[i].listed);
        assert_null(strstr(page, runs[i].idle));
        named = strstr(page, "Not listed, as they have no effect with these: ");
        assert_non_null(named);
        assert_non_null(strstr(named, i ? "harmonics" : "view-width"));
        free(page);
    }
}

/* Each section of the table is on the page, with its link, exactly if its row says so. */
static void sections_are_those_of_the_table(void **state)
{
    const char *const runs[] = {"empty", "full"};

    for (int full = 0; full < 2; full++) {
        const char *run = scratch_path(*state, runs[full]);
        cln_report_data data;
        char *page = NULL;
        int there = 0;

        assert_int_equal(cln_make_dirs(run), CLN_OK);
        if (full) {
            put_run(run, "done", "nothing");
            put_metrics(run, 30);
            add_text(run, "metrics.jsonl",
                     "{\"event\":\"structure\",\"step\":760,\"seconds\":30.5}\n"
                     "{\"step\":775,\"seconds\":31,\"ranks\":2,\"sent_bytes\":1,"
                     "\"message_seconds\":1}\n");
        }
        page = page_of(run);
        assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
        for (int i = 0; i < cln_report_section_count; i++) {
            const cln_report_section *s = &cln_report_sections[i];
            char title[128], link[128];

            snprintf(title, sizeof title, "<h2 id='%s'>%s</h2>\n", s->id, s->title);
            snprintf(link, sizeof link, "<a href='#%s'>%s</a>", s->id, s->title);
            assert_int_equal(count_of(page, title), s->when(&data));
            assert_int_equal(count_of(page, link), s->when(&data));
            there += s->when(&data);
        }
        assert_int_equal(count_of(page, "<h2"), there);
        assert_int_equal(count_of(page, "href="), there);
        if (full)
            assert_int_equal(there, cln_report_section_count);
        else
            assert_in_range(there, 1, cln_report_section_count - 1);
        cln_report_data_free(&data);
        free(page);
    }
}

static void page_refers_to_nothing_outside(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;

    put_run(run, "done", "nothing");
    put_metrics(run, 30);
    put_eval(run, 750, "test", 20, json_pack("[o]", one_image("r.png", 20)));
    page = page_of(run);
    assert_has_not(page, "http:");
    assert_has_not(page, "https:");
    assert_has_not(page, "//");
    assert_has_not(page, "<script");
    assert_has_not(page, "<link");
    assert_has_not(page, "@import");
    assert_has_not(page, "url(");
    free(page);
}

static void hostile_texts_stay_text(void **state)
{
    static const char name[] = "<script>alert(1)</script>\"'&\xc3\xbc %41#?.png";
    const char *run = scratch_path(*state, "<b>run</b>");
    char *page = NULL;
    FILE *f = NULL;

    put_run(run, "<i>odd</i>", "<script>x</script>");
    f = fopen(scratch_path(run, "metrics.jsonl"), "w");
    assert_non_null(f);
    fputs("{\"step\":1,\"seconds\":1,\"psnr_train\":5,\"stages\":{\"<img src=x>'\":1}}\n", f);
    assert_int_equal(fclose(f), 0);
    put_eval(run, 25, "test", 20, json_pack("[o]", one_image(name, 20)));
    /* '/' in the name becomes '_', its extension is removed */
    put_picture(run, "00000025-test", "<script>alert(1)<_script>\"'&\xc3\xbc %41#?.png");
    page = page_of(run);
    assert_has_not(page, "<script");
    assert_has_not(page, "<img src=x");
    assert_has_not(page, "<i>odd");
    assert_has_not(page, "<b>run");
    assert_has(page,
               "<b>&lt;script&gt;alert(1)&lt;/script&gt;&quot;&#39;&amp;\xc3\xbc %41#?.png</b>");
    assert_has(page, "&lt;img src=x&gt;&#39;");
    assert_has(page, "&lt;i&gt;odd&lt;/i&gt;");
    assert_int_equal(count_of(page, "data:image/png;base64,"), 1);
    free(page);
}

static void missing_and_damaged_files_give_a_page(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;
    int warnings = 0;

    assert_int_equal(cln_make_dirs(run), CLN_OK);
    page = page_of(run); /* an empty folder */
    assert_has(page, "no readable run.json");
    assert_has(page, "Nothing was measured yet");
    assert_has(page, "Not evaluated yet");
    assert_has(page, "No stage was timed");
    assert_int_equal(count_of(page, "<svg "), 0);
    free(page);

    cln_log_set_sink(scratch_count_warnings, &warnings);
    put_text(run, "run.json", "{ broken");
    put_text(run, "metrics.jsonl",
             "{\"step\":25,\"seconds\":1,\"psnr_train\":11}\nnot json\n[]\n"
             "{\"step\":50,\"seconds\":2,\"psnr_train\":null,\"psnr_test\":null}\n"
             "{\"step\":75,\"seconds\":\"3\",\"psnr_train\":12}\n{\"step\":100,\"sec");
    assert_int_equal(cln_make_dirs(scratch_path(run, "eval")), CLN_OK);
    put_text(run, "eval/00000025-test.json", "[1, 2");
    put_text(run, "eval/00000050-test.json", "{}");
    put_text(run, "eval/notes.txt", "?");
    page = page_of(run);
    assert_int_equal(warnings, 2);
    assert_int_equal(count_of(page, "<svg "), 2); /* PSNR; no leaves, rays or samples */
    assert_has(page, "0 views of the split");
    free(page);
}

static void null_figures_are_dashes(void **state)
{
    const char *run = scratch_path(*state, "run");
    json_t *images = json_array();
    char *page = NULL;

    put_run(run, "interrupted", "nothing");
    put_metrics(run, 10);
    json_array_append_new(images, one_image("a.png", NAN));
    json_array_append_new(images, one_image("b.png", 21.5));
    put_json(run, "eval/00000250-test.json",
             json_pack("{s:i s:n s:s s:{s:n s:n} s:o}", "step", 250, "train_seconds", "split",
                       "test", "mean", "psnr", "ssim", "images", images));
    put_picture(run, "00000250-test", "a.png");
    page = page_of(run);
    assert_has(page, "<span class='state other'>interrupted");
    assert_has(page, "PSNR &ndash; dB &middot; SSIM 0.8750");
    assert_has(page, "no truth picture");
    free(page);
}

/* Events are not rows of training: they become marks in the curves and a separate table. */
static void decisions_are_marks_and_a_table(void **state)
{
    const char *run = scratch_path(*state, "run");
    cln_report_data data;
    char *page = NULL;
    FILE *f = NULL;

    put_run(run, "done", "nothing");
    put_metrics(run, 20); /* from 64 leaves in the row of step 225 to 512 in that of step 250 */
    page = page_of(run);
    assert_int_equal(count_of(page, "class='event'"), 3); /* looks like one more level */
    assert_int_equal(count_of(page, "class='mark'"), 0);
    assert_has_not(page, "The octree");
    free(page);

    f = fopen(scratch_path(run, "metrics.jsonl"), "a");
    assert_non_null(f);
    fputs("{\"event\":\"other\",\"step\":225,\"leaves\":9,\"psnr_test\":99}\n"
          "{\"event\":\"structure\",\"step\":225,\"seconds\":9.5,\"wall_seconds\":10,"
          "\"leaves_before\":64,\"leaves\":1234,\"split\":170,\"merged\":3,\"kept\":40,"
          "\"budget\":2048,\"infeasible\":true,\"objective\":0.5,\"objective_before\":0.7,"
          "\"psnr_before\":21.25,\"psnr_after\":21.5,\"psnr_pretrained\":null,"
          "\"distil_steps\":0,\"work_seconds\":1.5}\n"
          "{\"event\":\"structure\",\"step\":\"no number\"}\n",
          f);
    assert_int_equal(fclose(f), 0);
    assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
    assert_int_equal(data.rows.count, 20);
    assert_int_equal(data.decision_count, 2);
    assert_true(data.decisions[0].split == 170 && data.decisions[0].over_budget);
    assert_true(isnan(data.decisions[1].step) && !data.decisions[1].over_budget);
    cln_report_data_free(&data);
    page = page_of(run);
    assert_has(page, "The octree");
    assert_has(page, "<tr><td>00:10<td class=n>225<td class=n>64<td class=n>170<td class=n>3"
                     "<td class=n>1,234<td class=n>21.25<td class=n>21.50<td class=n>&ndash;"
                     "<td class=n>1.5<td>over budget\n");
    assert_int_equal(count_of(page, "class='mark'"), 5); /* one in each curve */
    assert_int_equal(count_of(page, "class='event'"), 0);
    assert_has(page, "512</b><span>leaves"); /* from the rows of training */
    free(page);
}

/* 10 steps of 100 rays, then a resumed run's 10 of 200, which counts bytes from 0 again. */
static void processes_are_summed_up(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;

    put_run(run, "done", "nothing");
    put_text(run, "metrics.jsonl",
             "{\"step\":10,\"seconds\":2,\"rays_per_s\":500,\"ranks\":2,\"sent_bytes\":9000,"
             "\"message_seconds\":0.5,\"balance\":1.5,\"ranks_stages\":{\"adam\":[0.1,0.3],"
             "\"messages\":[0.2,0.5]}}\n"
             "{\"event\":\"balance\",\"step\":10,\"moved\":7,\"before\":1.5,\"after\":1.02}\n"
             "{\"step\":20,\"seconds\":4,\"rays_per_s\":1000,\"ranks\":4,\"sent_bytes\":6000,"
             "\"message_seconds\":0.3,\"balance\":1.1,\"ranks_stages\":{\"messages\":[0.1,0.2]},"
             "\"photo_bytes\":[1024,3072]}\n");
    page = page_of(run);
    assert_has(page, "<th scope=row>processes<td class=n>4\n");
    assert_has(page, "sent, per step<td class=n>750\n");
    assert_has(page, "the same, per ray<td class=n>5.0\n");
    assert_has(page, " (20.0&thinsp;% of training)");
    assert_has(page, "over the mean<td class=n>1.30\n");
    assert_has(page, "<tr><td>adam<td class=n>5.00<td class=n>15.00\n");
    assert_has(page, "<tr><td>messages<td class=n>15.00<td class=n>35.00\n");
    assert_has(page, "the least of them<td class=n>1.0 KiB\n");
    assert_has(page, "the most<td class=n>3.0 KiB\n");
    assert_has(page, "<td class=n>10<td class=n>7<td class=n>1.50<td class=n>1.02\n");
    free(page);
}

/* The same, but the resumed run has sent more than the one before; its clock began anew. */
static void processes_of_a_long_resumed_run(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;

    put_run(run, "done", "nothing");
    put_text(run, "metrics.jsonl",
             "{\"step\":10,\"seconds\":2,\"wall_seconds\":9,\"rays_per_s\":500,\"ranks\":2,"
             "\"sent_bytes\":3000,\"message_seconds\":0.3,\"vertex_bytes\":1000}\n"
             "{\"step\":20,\"seconds\":4,\"wall_seconds\":3,\"rays_per_s\":1000,\"ranks\":2,"
             "\"sent_bytes\":8000,\"message_seconds\":0.5,\"vertex_bytes\":2000}\n"
             "{\"step\":30,\"seconds\":6,\"wall_seconds\":6,\"rays_per_s\":1000,\"ranks\":2,"
             "\"sent_bytes\":10000,\"message_seconds\":0.7,\"vertex_bytes\":2600}\n");
    page = page_of(run);
    assert_has(page, "sent, per step<td class=n>433\n"); /* (3000 + 10000) / 30 */
    assert_has(page, " (16.7&thinsp;% of training)");    /* (0.3 + 0.7) / 6 */
    free(page);
}

static void points_that_are_left_out_are_told(void **state)
{
    const char *run = scratch_path(*state, "many");
    char *page = NULL;

    put_run(run, "done", "");
    put_metrics(run, 160);
    page = page_of(run);
    assert_has_not(page, "in even steps");
    free(page);
    put_metrics(run, 200);
    page = page_of(run);
    assert_int_equal(count_of(page, "<td>some images, while training"), 16);
    assert_has(page, "16 of 20, in even steps.");
    free(page);
}

static json_t *tree_of(json_t *error)
{
    return json_pack("{s:s s:i s:i s:[i,i,i,i,i,i] s:o s:[s]}", "schema", "cl-nascent.tree/1",
                     "step", 25, "leaves", 1213, "leaves_by_level", 0, 0, 0, 12, 1200, 1, "error",
                     error, "views", "test/r<0>.png");
}

static void the_tree_is_shown_with_its_legend(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;
    int warnings = 0;

    put_run(run, "done", "nothing");
    put_eval(run, 25, "test", 20, json_pack("[o]", one_image("test/r<0>.png", 20)));
    put_picture(run, "00000025-test", "test_r<0>.png");
    put_picture(run, "00000025-test", "test_r<0>.tree.png");
    put_picture(run, "00000025-test", "test_r<0>.tree-error.png");
    put_json(run, "eval/00000025-test/tree.json",
             tree_of(json_pack("{s:f s:f}", "low", 1e-5, "high", 0.01)));
    page = page_of(run);
    assert_has(page, "1,213 leaves with a model at step 25.");
    assert_has(page, "background:#f0e442'></span>level 3: 12 leaves</span>");
    assert_has(page, "background:#d55e00'></span>level 5: 1 leaf</span>");
    assert_has_not(page, "level 2:");
    assert_has(page, "error 1e-05<i class=ramp style='background:linear-gradient(90deg,#0d0887,");
    assert_has(page, "#f0f921)'></i>0.01</span>");
    assert_has(page, "alt=\"level of test/r&lt;0&gt;.png\"");
    assert_has(page, "alt=\"leaf error of test/r&lt;0&gt;.png\"");
    assert_int_equal(count_of(page, "data:image/png;base64,"), 4); /* the render twice */
    free(page);

    put_json(run, "eval/00000025-test/tree.json", tree_of(json_null()));
    page = page_of(run);
    assert_has(page, "level 4: 1,200 leaves");
    assert_has_not(page, "linear-gradient");
    assert_int_equal(count_of(page, "data:image/png;base64,"), 3);
    free(page);

    put_text(run, "eval/00000025-test/tree.json", "{ broken");
    cln_log_set_sink(scratch_count_warnings, &warnings);
    page = page_of(run);
    assert_int_equal(warnings, 1);
    assert_has_not(page, "The octree");
    free(page);
}

/* Every colour of the style has a value for light and one for dark screens. */
static void colours_are_for_light_and_dark(void **state)
{
    const char *run = *state, *dark = NULL;
    char *page = NULL;
    int used = 0;

    put_run(run, "done", "nothing");
    page = page_of(run);
    dark = strstr(page, "(prefers-color-scheme:dark)");
    assert_non_null(dark);
    for (const char *at = page; (at = strstr(at, "var(--")); at++) {
        char name[32];
        const char *light = NULL;

        snprintf(name, sizeof name, "--%.*s:", (int)strcspn(at + 6, ")"), at + 6);
        light = strstr(page, name);
        if (!light || light > dark || !strstr(dark, name))
            fail_msg("%s lacks a value", name);
        used++;
    }
    assert_true(used > 10);
    assert_has_not(strstr(page, "body{"), "background:#fff");
    free(page);
}

/* The report shows the newest evaluation of the first available split: test, val, train. */
static void shown_views_are_the_most_held_out(void **state)
{
    const char *run = scratch_path(*state, "run");
    cln_report_data data;

    put_eval(run, 900, "train", 30, json_array());
    assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
    assert_int_equal(data.shown, 0);
    cln_report_data_free(&data);
    put_eval(run, 100, "test", 20, json_array());
    put_eval(run, 300, "test", 22, json_array());
    put_eval(run, 500, "val", 21, json_array());
    assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
    assert_int_equal(data.eval_count, 4);
    assert_string_equal(data.evals[data.shown].stem, "00000300-test");
    assert_true(data.evals[data.shown].psnr == 22);
    cln_report_data_free(&data);
}

/* Of a run that went back, what is of later steps or of another model is not shown. */
static void what_is_of_a_dropped_model_is_left_out(void **state)
{
    const char *run = scratch_path(*state, "run"), *digest = "{\"model_digest\":\"a1\"}";
    cln_report_data data;
    json_t *document = NULL;
    char *page = NULL;

    put_run(run, "done", "nothing");
    put_metrics(run, 20);
    assert_int_equal(cln_run_read(run, &document), CLN_OK);
    json_object_set_new(document, "result",
                        json_pack("{s:i s:s}", "step", 500, "model_digest", "b2"));
    put_json(run, "run.json", document);
    put_eval(run, 250, "test", 21.5, json_array());
    put_eval(run, 500, "test", 28.25, json_array());
    assert_int_equal(cln_report_data_read(run, 500, &data), CLN_OK);
    assert_int_equal(data.eval_count, 2);
    assert_true(isnan(data.gone));
    cln_report_data_free(&data);

    page = page_until(run, 250);
    assert_has(page, "21.50 <small>dB</small></b><span>test PSNR");
    assert_has(page, "<b>250</b><span>steps");
    assert_has(page, "It ended at step 500, but the checkpoint of that is gone");
    assert_has_not(page, "28.25");
    assert_has_not(page, "model b2");
    free(page);

    put_json(run, "eval/00000250-test-8.json",
             json_pack("{s:s s:i s:s s:s s:{s:f} s:[]}", "schema", "cl-nascent.eval/1", "step", 250,
                       "model_digest", "b2", "split", "test", "mean", "psnr", 23.0, "images"));
    assert_int_equal(cln_make_dirs(scratch_path(run, "checkpoint")), CLN_OK);
    put_text(run, "checkpoint/00000250.json", digest);
    assert_int_equal(cln_report_data_read(run, 250, &data), CLN_OK);
    assert_int_equal(data.eval_count, 1); /* of the same step, another model */
    cln_report_data_free(&data);
    put_text(run, "checkpoint/00000250.json", "{\"model_digest\":\"b2\"}");
    assert_int_equal(cln_report_data_read(run, 250, &data), CLN_OK);
    assert_int_equal(data.eval_count, 2);
    cln_report_data_free(&data);
}

/* Of one step, the figures are those of pictures as they are; how others were rendered is said. */
static void figures_say_how_they_were_rendered(void **state)
{
    static const struct {
        const char *name;
        double psnr;
        int antialias, fast;
    } rows[] = {{"a-fast", 21, 1, true},
                {"b", 20, 1, false},
                {"c-antialias2", 22, 2, false},
                {"d-antialias3-fast", 23, 3, true},
                {"00000100-test-1-471c02c9", 24, 1, false}};
    const int count = (int)(sizeof rows / sizeof rows[0]);
    const char *run = scratch_path(*state, "run");
    cln_report_data data;
    char *page = NULL;

    put_run(run, "done", "nothing");
    for (int pass = 0; pass < 2; pass++) {
        for (int i = count - 1; i >= 0; i--) {
            json_t *document =
                json_pack("{s:s s:i s:f s:s s:{s:f s:f} s:[o]}", "schema", "cl-nascent.eval/1",
                          "step", 100, "train_seconds", 4.0, "split", "test", "mean", "psnr",
                          rows[i].psnr, "ssim", 0.5, "images", one_image("r.png", rows[i].psnr));
            char name[64];

            if (rows[i].antialias > 1)
                json_object_set_new(document, "antialias", json_integer(rows[i].antialias));
            if (rows[i].fast)
                json_object_set_new(document, "fast", json_true());
            snprintf(name, sizeof name, "eval/%s.json", rows[i].name);
            put_json(run, name, document);
        }
        if (pass == 1)
            assert_int_equal(remove(scratch_path(run, "eval/b.json")), 0);
        assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
        assert_int_equal(data.eval_count, count - pass);
        assert_string_equal(data.evals[data.shown].stem, pass ? "d-antialias3-fast" : "b");
        cln_report_data_free(&data);
        page = page_of(run);
        if (pass == 0)
            assert_has(page, "20.00 <small>dB</small></b><span>test PSNR after 00:04</span>");
        else
            assert_has(page, "23.00 <small>dB</small></b><span>test PSNR after 00:04 with "
                             "--antialias 3 --fast</span>");
        assert_has(page, "<td>an evaluation of 1 image with --fast\n");
        assert_has(page, "<td>an evaluation of 1 image with --antialias 2\n");
        assert_has(page, "<td>an evaluation of 1 image of chosen views\n");
        assert_int_equal(count_of(page, "<td>an evaluation of 1 image\n"), pass == 0);
        free(page);
    }
}

/* Views chosen by name or number tell nothing of the others: curves leave their evaluations out. */
static void curves_are_without_chosen_views(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;

    put_run(run, "done", "nothing");
    put_metrics(run, 20);
    put_eval(run, 250, "test", 21.5, json_array());
    put_eval(run, 500, "test-1-471c02c9", 28.25, json_array());
    put_eval(run, 500, "test-1-471c02c9-fast", 28.75, json_array());
    put_eval(run, 500, "train", 27.75, json_array());
    page = page_of(run);
    assert_int_equal(count_of(page, "r='4.5'"), 2); /* over steps and over time */
    assert_int_equal(count_of(page, "<title>21.50</title>"), 2);
    assert_has_not(page, "<title>28.25");
    assert_has_not(page, "<title>28.75");
    assert_has_not(page, "<title>27.75");
    free(page);
}

/* Evaluations of chosen views are known by the digest in their files' names, of eight digits. */
static void chosen_views_are_known_by_name(void **state)
{
    static const struct {
        const char *stem;
        bool chosen;
    } rows[] = {
        {"00000100-test", false},
        {"00000100-test-8", false},
        {"00000100-test-8-471c02c9", true},
        {"00000100-test-8-471c02c9-fast", true},
        {"00000100-val-12-deadbeef-antialias2", true},
        {"00000100-test-8-face", false},
        {"00000100-test-8-faded1", false},
        {"00000100-test-8-471c02c9a", false},
        {"00000100-test-8-fast", false},
        {"00000100-test-471c02c9", false},
    };
    const int count = (int)(sizeof rows / sizeof rows[0]);
    const char *run = scratch_path(*state, "run");
    cln_report_data data;

    put_run(run, "done", "nothing");
    for (int i = 0; i < count; i++)
        put_eval(run, 100, rows[i].stem + strlen("00000100-"), 20, json_array());
    assert_int_equal(cln_report_data_read(run, INT64_MAX, &data), CLN_OK);
    assert_int_equal(data.eval_count, count);
    for (int i = 0; i < count; i++)
        for (int k = 0; k < count; k++)
            if (strcmp(data.evals[k].stem, rows[i].stem) == 0 &&
                (data.evals[k].chosen != rows[i].chosen ||
                 !strstr(data.evals[k].how, "chosen") == rows[i].chosen))
                fail_msg("%s: chosen %d, '%s'", rows[i].stem, data.evals[k].chosen,
                         data.evals[k].how);
    cln_report_data_free(&data);
}

static void many_views_are_sampled_by_rank(void **state)
{
    const char *run = scratch_path(*state, "run");
    json_t *images = json_array();
    char *page = NULL;

    for (int i = 0; i < 11; i++) {
        char name[32];
        snprintf(name, sizeof name, "v%02d.png", i);
        json_array_append_new(images, one_image(name, 20 + i));
        put_picture(run, "00000100-test", name);
    }
    put_eval(run, 100, "test", 25, images);
    page = page_of(run);
    assert_has(page, "6 of 11, from the best PSNR to the worst");
    assert_has(page, "<b>v10.png</b>");
    assert_has(page, "<b>v00.png</b>");
    assert_has(page, "<b>v08.png</b>");
    assert_has_not(page, "<b>v09.png</b>");
    assert_has(page, "<td>v09.png<td class=n>29.00<td class=n>0.8750"); /* in the full list */
    free(page);
}

static void long_runs_stay_small(void **state)
{
    const char *run = scratch_path(*state, "run");
    char *page = NULL;

    put_metrics(run, 20000);
    page = page_of(run);
    assert_in_range(strlen(page), 1000, 250000);
    free(page);
}

/* Photos of a phone, upright, with grain: a view's three pictures take less than 400 KB, so that a
 * page can be mailed. As PNGs of this size they would take 25 MB, and 1.5 MB if only reduced. */
static void photos_stay_small(void **state)
{
    enum { WIDTH = 1080, HEIGHT = 1920, VIEWS = 2 };
    static const char *const kinds[] = {".truth.png", ".png", ".error.png"};
    const char *run = scratch_path(*state, "run"), *folder = "eval/00000100-test";
    json_t *images = json_array();
    uint8_t *pixels = malloc((size_t)WIDTH * HEIGHT * 3);
    uint32_t grain = 1;
    char *page = NULL, name[64];

    assert_non_null(pixels);
    assert_int_equal(cln_make_dirs(scratch_path(run, folder)), CLN_OK);
    for (int i = 0; i < WIDTH * HEIGHT * 3; i++) {
        grain = grain * 1664525u + 1013904223u;
        pixels[i] = (uint8_t)(40 + i / 3 % WIDTH / 10 + i / 3 / WIDTH / 30 + (int)(grain >> 28));
    }
    for (int i = 0; i < VIEWS; i++) {
        snprintf(name, sizeof name, "v%d.png", i);
        json_array_append_new(images, one_image(name, 20 + i));
        for (int k = 0; k < 3; k++) {
            snprintf(name, sizeof name, "%s/v%d%s", folder, i, kinds[k]);
            assert_int_equal(cln_image_write_png(scratch_path(run, name), WIDTH, HEIGHT, 3, pixels),
                             CLN_OK);
        }
    }
    put_eval(run, 100, "test", 20, images);
    page = page_of(run);
    assert_int_equal(count_of(page, "<img "), 3 * VIEWS);
    assert_in_range(strlen(page), 50000, VIEWS * 400000);
    free(pixels);
    free(page);
}

/* Pictures of a view whose photo people see turned, 20 x 30 then, are turned together. */
static void phone_photos_stand(void **state)
{
    static const char *const kinds[] = {".truth.png", ".png", ".error.png"};
    static const uint8_t lying[30 * 20 * 3] = {0};
    const char *run = scratch_path(*state, "run"), *folder = "eval/00000100-test";
    json_t *images = json_array(), *one = one_image("a.jpg", 20);
    char *page = NULL, name[64];

    assert_int_equal(cln_make_dirs(scratch_path(run, folder)), CLN_OK);
    json_array_append_new(images, one_image("b.jpg", 21));
    json_object_set_new(one, "turn", json_integer(6));
    json_array_append_new(images, one);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            snprintf(name, sizeof name, "%s/%c%s", folder, 'a' + i, kinds[k]);
            assert_int_equal(cln_image_write_png(scratch_path(run, name), 30, 20, 3, lying),
                             CLN_OK);
        }
    put_eval(run, 100, "test", 20, images);
    page = page_of(run);
    assert_int_equal(count_of(page, "<img width=20 height=30 "), 3);
    assert_int_equal(count_of(page, "<img width=30 height=20 "), 3);
    free(page);
}

static void an_unwritable_folder_is_said(void **state)
{
    const char *run = scratch_path(*state, "nowhere");

    assert_int_equal(cln_report_write(run, INT64_MAX), CLN_OUTPUT);
    assert_non_null(strstr(cln_error_text(), "nowhere"));
    cln_clear_error();
}

static void an_earlier_error_is_kept(void **state)
{
    const char *run = scratch_path(*state, "run");
    int warnings = 0;

    assert_int_equal(cln_make_dirs(run), CLN_OK);
    put_text(run, "run.json", "{ broken");
    cln_log_set_sink(scratch_count_warnings, &warnings);
    cln_fail(CLN_DIVERGED, "what really happened");
    assert_int_equal(cln_report_write(run, INT64_MAX), CLN_OK); /* like train at its end */
    assert_string_equal(cln_error_text(), "what really happened");
}

#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)

/* Test views far below training views: whose fault, by what a fit of colours mends. */
#define DOUBT(train, test, fitted, gains)                                                  \
    {                                                                                      \
        .psnr_train = train, .psnr_test = test, .psnr_fitted = fitted, .fitted_gain = NAN, \
        .exposed = gains                                                                   \
    }

static void doubt_knows_exposure(void **state)
{
    const struct {
        cln_doubt of;
        const char *words; /* NULL: no doubt */
    } cases[] = {
        {DOUBT(28.1, 19.2, 19.6, false), "poses or lenses are wrong"},
        {DOUBT(28.1, 19.2, NAN, false), "poses or lenses are wrong"},
        {DOUBT(28.1, 19.2, 27, false), "differs between photos (--exposure fits gains to them)"},
        {DOUBT(28.1, 12, 20.5, true), "after a fit of colours: exposure"},
        {DOUBT(28, 19.9, 20.1, false), "poses or lenses are wrong"},
        {DOUBT(17, 15, 16.9, false), "poses or lenses are wrong"},
        {DOUBT(24, 12, 18.5, true), "white balance differs between photos"},
        {DOUBT(24, 12, 17.5, true), "poses or lenses are wrong"},
        {DOUBT(28, 20.1, 27, false), NULL},
        {DOUBT(35.2, 21.7, 35.1, false), "at 35.1 dB after a fit of colours"},
        {DOUBT(35.2, 21.7, 24, false), NULL},
        {DOUBT(20, 19.2, 19.3, false), NULL},
        {DOUBT(NAN, 12, 27, false), NULL},
        {DOUBT(28, NAN, NAN, false), NULL}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[CLN_DOUBT_BYTES];

        assert_int_equal(cln_report_doubt(&cases[i].of, text), cases[i].words != NULL);
        if (cases[i].words)
            assert_non_null(strstr(text, cases[i].words));
        else
            assert_string_equal(text, "");
    }
}

/* One view behind haze, which a fit mends, lifts the mean alone. */
static void doubt_goes_by_most_views(void **state)
{
    cln_doubt of = DOUBT(28.1, 19.2, 27, false);
    char text[CLN_DOUBT_BYTES];

    (void)state;
    of.fitted_gain = 0.2;
    assert_true(cln_report_doubt(&of, text));
    assert_non_null(strstr(text, "poses or lenses are wrong"));
    of.fitted_gain = 7;
    assert_true(cln_report_doubt(&of, text));
    assert_non_null(strstr(text, "(--exposure fits gains to them)"));
}

/* What is known of the scene comes first, and a mask for all photos last. */
static void doubt_knows_the_scene(void **state)
{
    static const cln_doubt wrong = DOUBT(28, 12, 12, false);
    cln_doubt of = wrong;
    char text[CLN_DOUBT_BYTES];

    (void)state;
    of.training_photos = 40;
    assert_true(cln_report_doubt(&of, text));
    assert_string_equal(
        text, "test views are 16.0 dB below training views, at 12.0 dB: poses or lenses "
              "are wrong, or the photos are few, or look elsewhere, or things moved or the "
              "light changed between them, or something stands "
              "in every photo (a logo, bars, a bonnet): mask it (check --write-mask)");
    of.cube_guessed = of.masks_doubtful = true;
    of.training_photos = 8;
    assert_true(cln_report_doubt(&of, text));
    assert_non_null(strstr(text, "dB: the cube, which is a guess, may be far too large or small "
                                 "(--bbox), or the masks may be of an object (--masks alpha), or "
                                 "8 training photos are few, or poses or lenses are wrong, or the "
                                 "photos look elsewhere, or things moved or the light changed "
                                 "between them, or something"));
    assert_non_null(strstr(text, "mask it (check --write-mask)"));
    of = wrong;
    of.alpha = true;
    assert_true(cln_report_doubt(&of, text));
    assert_non_null(strstr(text, "or look elsewhere"));
    assert_null(strstr(text, "write-mask"));
}

int test_group_report(void)
{
    const struct CMUnitTest tests[] = {
        ON_DISK(page_shows_what_the_run_left),
        ON_DISK(words_are_those_of_the_leaves),
        ON_DISK(sections_are_those_of_the_table),
        ON_DISK(processes_are_summed_up),
        ON_DISK(page_refers_to_nothing_outside),
        ON_DISK(hostile_texts_stay_text),
        ON_DISK(missing_and_damaged_files_give_a_page),
        ON_DISK(null_figures_are_dashes),
        ON_DISK(decisions_are_marks_and_a_table),
        ON_DISK(points_that_are_left_out_are_told),
        ON_DISK(the_tree_is_shown_with_its_legend),
        ON_DISK(shown_views_are_the_most_held_out),
        ON_DISK(what_is_of_a_dropped_model_is_left_out),
        ON_DISK(figures_say_how_they_were_rendered),
        ON_DISK(curves_are_without_chosen_views),
        ON_DISK(chosen_views_are_known_by_name),
        ON_DISK(processes_of_a_long_resumed_run),
        ON_DISK(many_views_are_sampled_by_rank),
        ON_DISK(long_runs_stay_small),
        ON_DISK(photos_stay_small),
        ON_DISK(phone_photos_stand),
        ON_DISK(an_unwritable_folder_is_said),
        ON_DISK(an_earlier_error_is_kept),
        ON_DISK(colours_are_for_light_and_dark),
        cmocka_unit_test(doubt_knows_exposure),
        cmocka_unit_test(doubt_goes_by_most_views),
        cmocka_unit_test(doubt_knows_the_scene),
    };

    return cmocka_run_group_tests_name("report", tests, NULL, NULL);
}
