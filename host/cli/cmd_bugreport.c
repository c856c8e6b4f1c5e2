/* `cl-nascent bugreport`: a text with the facts that developers ask for first. It is made in
 * memory, so that names of home folders can be removed from all of it before it is printed. An
 * error stands where a fact cannot be found out: a report of a broken machine is still a report. */
#include "cli/commands.h"
#include "cli/help.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>
#include <zlib.h>
#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/settings.h"
#include "base/text.h"
#include "cli/console.h"
#include "io/run_folder.h"
#include "scene/origin.h"

/* ---- the machine ---- */

#ifdef __clang__
#define COMPILER __VERSION__ /* names itself */
#else
#define COMPILER "GCC " __VERSION__
#endif

static void put_system(FILE *to)
{
    struct utsname system = {0};
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    char memory[32], now[32];

    uname(&system);
    cln_format_bytes(cln_host_memory(), memory);
    cln_utc_now(now);
    fprintf(to, "Program\n    cl-nascent %s, jansson %s, zlib %s, compiled by %s\n    %s\n",
            cln_version(), jansson_version_str(), zlibVersion(), COMPILER, cln_built_with());
    fprintf(to, "System\n    %s %s %s, %ld processor%s, %s memory, %s\n", system.sysname,
            system.release, system.machine, processors, cln_plural((double)processors, "", "s"),
            memory, now);
}

/* Variables that choose drivers and devices, or change what is printed; no secret. */
static void put_environment(FILE *to)
{
    static const char *const prefixes[] = {
        "CL_NASCENT_",  "OCL_ICD_", "OPENCL_", "POCL_", "CUDA_VISIBLE",
        "ROCR_VISIBLE", "LC_",      "LANG=",   "TERM=", "NO_COLOR"};
    extern char **environ;

    fputs("Environment\n", to);
    for (char **e = environ; *e; e++)
        for (size_t i = 0; i < sizeof prefixes / sizeof prefixes[0]; i++)
            if (strncmp(*e, prefixes[i], strlen(prefixes[i])) == 0 &&
                strncmp(*e, "CL_NASCENT_TOKEN=", 17) != 0)
                fprintf(to, "    %s\n", *e);
}

static void put_devices(FILE *to, const cln_options *options)
{
    cln_device_info *devices = NULL;
    int count = 0;

    fputs("OpenCL devices\n", to);
    if (cln_devices_list(&options->device, options->test, &devices, &count) != CLN_OK) {
        fprintf(to, "    %s\n", cln_error_text());
        cln_clear_error();
    }
    for (int i = 0; i < count; i++)
        cln_print_device(to, i, &devices[i]);
    free(devices);
}

/* ---- the run ---- */

static void put_member(FILE *to, const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    char *text = value ? json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(7)) : NULL;

    if (text)
        fprintf(to, "    %-13s %s\n", key, text);
    free(text);
}

/* Prints the settings that differ from the run's preset. */
static cln_status put_settings(FILE *to, const char *run, const char *preset)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;
    cln_config standard;
    char own[CLN_TEXT_BYTES], usual[CLN_TEXT_BYTES];

    CLN_TRY(cln_settings_of_run(run, &settings));
    CLN_TRY(cln_config_preset(*preset ? preset : "fast", &standard));
    fprintf(to, "    settings      preset %s, except:\n", *preset ? preset : "fast");
    for (int i = 0; i < cln_config_row_count; i++) {
        cln_config_text(&settings->config, &cln_config_rows[i], own);
        cln_config_text(&standard, &cln_config_rows[i], usual);
        if (strcmp(own, usual) != 0)
            fprintf(to, "        %s %s (%s)\n", cln_config_rows[i].option, own, usual);
    }
done:
    cln_settings_free(settings);
    return st;
}

static cln_status put_run(FILE *to, const char *run)
{
    static const char *const keys[] = {
        "version",       "state",     "started", "ended",    "command",         "device",
        "tune",          "tune_from", "step",    "leaves",   "leaves_by_level", "params",
        "train_seconds", "result",    "plan",    "left_out", "warnings"};
    static const char *const paths[] = {"path", "folder", "cameras"};
    cln_status st = CLN_OK;
    char *text = NULL;
    const char *preset = NULL;
    json_t *about = NULL, *dataset = NULL;

    CLN_TRY(cln_info_run(run, &text));
    about = json_loads(text, 0, NULL);
    dataset = json_object_get(about, "dataset");
    preset = json_string_value(json_object_get(about, "preset"));
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; i++)
        json_object_del(dataset, paths[i]);
    CLN_TRY(cln_origin_hide(dataset));
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        put_member(to, about, keys[i]);
    put_member(to, about, "dataset");
    CLN_TRY(put_settings(to, run, preset ? preset : ""));
done:
    json_decref(about);
    free(text);
    return st;
}

/* ---- the text ---- */

/* Prints the text with ~ for every /home/NAME, /Users/NAME and the folder of $HOME. */
static void print_without_homes(const char *text)
{
    static const char *const parents[] = {"/home/", "/Users/"};
    const char *home = getenv("HOME");
    const size_t own = home && strlen(home) > 1 ? strlen(home) : 0;

    while (*text) {
        size_t skipped = own && strncmp(text, home, own) == 0 ? own : 0;

        for (size_t i = 0; i < sizeof parents / sizeof parents[0] && !skipped; i++)
            if (strncmp(text, parents[i], strlen(parents[i])) == 0)
                skipped = strlen(parents[i]) + strcspn(text + strlen(parents[i]), "/ \t\n\"':;,()");
        putchar(skipped ? '~' : *text);
        text += skipped ? skipped : 1;
    }
}

cln_status cln_cmd_bugreport(const cln_options *options)
{
    cln_status st = CLN_OK;
    char *text = NULL;
    size_t bytes = 0;
    FILE *to = open_memstream(&text, &bytes);

    if (!to)
        return cln_fail(CLN_MEMORY, "bugreport: no memory for its text");
    cln_info("asking the devices%s", options->test ? ", with a quick self-test" : "");
    put_system(to);
    put_environment(to);
    put_devices(to, options);
    if (options->operand) {
        fputs("Run\n", to);
        if (put_run(to, options->operand) != CLN_OK) {
            fprintf(to, "    %s\n", cln_error_text());
            cln_clear_error();
        }
    }
    if (fclose(to) != 0)
        CLN_TRY(cln_fail(CLN_MEMORY, "bugreport: no memory for its text"));
    print_without_homes(text);
    CLN_TRY(cln_flush_stdout()); /* the text comes first where both go to one file */
    fprintf(stderr,
            "Nothing was sent. Please remove from this text what you do not want to show, and put "
            "it into your\nreport, with what you did, what happened, and what you expected%s.\n",
            options->operand ? "" : "; `cl-nascent bugreport RUN` adds a run");
done:
    free(text);
    return st;
}
