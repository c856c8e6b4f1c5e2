/* The tables of option_table.h and the look-ups in them. To add an option: a row in cln_args and a
 * field in cln_options; to add a command: a row in cln_commands and its cmd_*.c. */
#include "cli/option_table.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include "base/text.h"
#include "cli/commands.h"
#include "cli/options.h"

/* clang-format off */
const cln_command cln_commands[] = {
    {"train", CLN_TRAIN, "SCENE", false,
     "train SCENE -o RUN [OPTIONS]\n       cl-nascent train --resume RUN [OPTIONS]",
     "Trains a scene from its posed photos",
     "SCENE is a folder or a transforms JSON file. Training ends when the first budget is used up "
     "(--steps, --time-limit, --target-psnr; else --epochs). Ctrl-C or SIGTERM writes a checkpoint "
     "and stops, a second one leaves at once; SIGUSR1 writes a checkpoint and goes on.",
     cln_cmd_train},
    {"eval", CLN_EVAL, "RUN", true, "eval RUN [OPTIONS]",
     "PSNR and SSIM of a run's renders against held-out photos",
     "Leaves RUN/eval/STEP-SPLIT.json and renews RUN/report.html.",
     cln_cmd_eval},
    {"render", CLN_RENDER, "RUN", true, "render RUN [OPTIONS]",
     "Colour, depth and opacity images from a split's poses or an orbit",
     "Writes NAME.png, NAME.depth.npy (float32, scene units), NAME.depth.png and NAME.opacity.png. "
     "Frames that are there already are skipped, so an interrupted render goes on where it stopped.",
     cln_cmd_render},
    {"info", CLN_INFO, "SCENE|RUN", true, "info SCENE|RUN [OPTIONS]",
     "What is in a scene or a run",
     "A folder with a run.json of ours is a run, anything else a scene, read as train would read it.",
     cln_cmd_info},
    {"export", CLN_EXPORT, "RUN", true, "export RUN --octree FILE.ply [OPTIONS]",
     "The octree of a run as boxes, for programs that show meshes",
     "The active leaves of the newest checkpoint, in the scene's coordinates. Needs no device.",
     cln_cmd_export},
    {"devices", CLN_DEVICES, NULL, false, "devices [OPTIONS]",
     "The OpenCL devices, what they have, and whether they compute rightly",
     "The row number is what -d takes.",
     cln_cmd_devices},
    {"selftest", CLN_SELFTEST, NULL, false, "selftest [OPTIONS]",
     "The kernels on one device against the float64 reference",
     "Exit code 10 if a check fails.",
     cln_cmd_selftest},
    {"tune", CLN_TUNE, NULL, false, "tune [OPTIONS]",
     "Finds the kernel parameters that are fastest on a device",
     "For the networks of a preset, or of the options given. Sets of parameters are timed only after "
     "they have passed against the float64 reference; the best becomes a row in your own file, "
     "which the other commands read.",
     cln_cmd_tune},
};
/* clang-format on */
const int cln_command_count = sizeof cln_commands / sizeof cln_commands[0];

#define ON_DEVICE (CLN_TRAIN | CLN_EVAL | CLN_RENDER | CLN_SELFTEST | CLN_TUNE)
#define EVERY     (ON_DEVICE | CLN_INFO | CLN_EXPORT | CLN_DEVICES)
#define AT(field) offsetof(cln_options, field)

/* Rows by kind. */
/* clang-format off */
#define FLAG(commands, name, letter, field, help)                                                  \
    {name, letter, CLN_ARG_FLAG, NULL, NULL, 0, 0, false, NULL, NULL, commands, AT(field), help}
#define SWITCH(commands, name, field, standard, help)                                              \
    {name, 0, CLN_ARG_FLAG, NULL, NULL, 0, 0, true, NULL, standard, commands, AT(field), help}
#define COUNT(commands, name, letter, field, help)                                                 \
    {name, letter, CLN_ARG_COUNT, NULL, NULL, 0, 0, false, NULL, NULL, commands, AT(field), help}
#define TEXT(commands, name, letter, field, value, env, standard, help)                            \
    {name, letter, CLN_ARG_TEXT, value, NULL, 0, 0, false, env, standard, commands, AT(field), help}
#define WORD(commands, name, field, words, standard, help)                                         \
    {name, 0, CLN_ARG_WORD, NULL, words, 0, 0, false, NULL, standard, commands, AT(field), help}
#define NUMBER(commands, name, field, kind, value, min, max, standard, help)                       \
    {name, 0, kind, value, NULL, min, max, false, NULL, standard, commands, AT(field), help}

const cln_arg cln_args[] = {
    TEXT(CLN_TRAIN | CLN_RENDER | CLN_TUNE, "output", 'o', output, "PATH", NULL, NULL,
         "folder to write; train: the new run; render: by default RUN/render/SPLIT or /orbit; tune: "
         "the file to put the row in, by default that of --tune-file"),
    WORD(CLN_TRAIN | CLN_TUNE, "preset", preset, "fast|paper|nerf|kilonerf", "fast",
         "defaults of the options below: chosen for a CPU, the paper's, or those of the baselines "
         "inside the same program: one network, a uniform grid of small ones"),
    TEXT(CLN_TRAIN, "resume", 0, resume, "RUN", NULL, NULL,
         "go on with a run, with its settings; options given override, and --steps, --epochs and "
         "--time-limit take +N to extend its budget"),
    TEXT(ON_DEVICE, "device", 'd', device.spec, "SPEC", "CL_NASCENT_DEVICE", "auto",
         "auto, cpu, gpu, a row number of `cl-nascent devices`, or part of a name"),
    TEXT(ON_DEVICE, "kernel-dir", 0, device.kernel_dir, "DIR", "CL_NASCENT_KERNEL_DIR", NULL,
         "read the kernels from here instead of from the program"),
    TEXT(ON_DEVICE, "tune", 0, device.tune, "LIST", NULL, NULL,
         "kernel parameters over those of the device's class: VW=8,TS=6,...; tune: where the search "
         "begins"),
    TEXT(ON_DEVICE | CLN_DEVICES, "tune-file", 0, device.tune_file, "FILE", "CL_NASCENT_TUNE_FILE",
         "cl-nascent/tune.txt in $XDG_CONFIG_HOME or ~/.config",
         "your rows of kernel parameters, which go before the program's own"),
    TEXT(ON_DEVICE, "max-alloc", 0, device.max_alloc, "SIZE", NULL, NULL,
         "no buffer larger than this (512K, 64M, 4G), as if the device allowed no more: batches are "
         "cut to it, and what has a row per leaf is split into up to four"),
    FLAG(CLN_TRAIN, "skip-selftest", 0, skip_selftest,
         "do not check the kernels on this device first"),
    TEXT(CLN_TRAIN, "dump-program", 0, dump_program, "FILE", NULL, NULL,
         "write the integer program of each structure decision to this file, in LP format; that of "
         "the last one stays"),

    WORD(CLN_EVAL | CLN_RENDER, "split", split, "train|val|test", "test",
         "which views of the scene; render: their poses"),
    TEXT(CLN_EVAL | CLN_RENDER, "scene", 0, scene, "SCENE", NULL, NULL,
         "where the scene is now, if not where the run found it"),
    NUMBER(CLN_EVAL | CLN_RENDER, "max-images", max_images, CLN_ARG_INT, "N", 0, INT_MAX, "0",
           "only N views, evenly chosen (0 = all)"),
    NUMBER(CLN_EVAL, "min-psnr", min_psnr, CLN_ARG_REAL, "DB", 0, 200, "0",
           "exit with code 9 if the mean PSNR is below this"),
    SWITCH(CLN_EVAL, "save-images", save_images, "yes",
           "leave renders, truths, error images and pictures of the tree in RUN/eval/ and show "
           "them in the report"),

    NUMBER(CLN_RENDER, "orbit", orbit_frames, CLN_ARG_OPTINT, "FRAMES", 1, 100000, "60 frames",
           "a circle around the scene instead of a split's poses"),
    NUMBER(CLN_RENDER, "elevation", elevation, CLN_ARG_REAL, "DEG", -90, 90, "25",
           "orbit: degrees above the horizon of the training cameras"),
    NUMBER(CLN_RENDER, "radius", radius, CLN_ARG_REAL, "R", 1e-3, 1e3, "1",
           "orbit: distance, in mean training camera distances"),
    NUMBER(CLN_RENDER, "width", image_width, CLN_ARG_INT, "PX", 0, 32768, "0",
           "orbit: image width (0 = as the training images)"),
    NUMBER(CLN_RENDER, "height", image_height, CLN_ARG_INT, "PX", 0, 32768, "0",
           "orbit: image height (0 = as the training images)"),
    NUMBER(CLN_RENDER, "fov", fov, CLN_ARG_REAL, "DEG", 0, 175, "0",
           "orbit: horizontal field of view (0 = as the training images)"),
    FLAG(CLN_RENDER | CLN_EXPORT, "overwrite", 0, overwrite,
         "replace what is there already; otherwise render skips such frames, and export refuses"),
    FLAG(CLN_RENDER, "z-depth", 0, z_depth,
         "depth along the optical axis instead of along the ray"),

    TEXT(CLN_EXPORT, "octree", 0, octree, "FILE", NULL, NULL,
         "write the active leaves to this PLY file, as boxes with level and error"),
    WORD(CLN_EXPORT, "colour", colour, "level|error", "level",
         "what the boxes' colours show: the level, or the error on a logarithmic scale"),

    SWITCH(CLN_DEVICES, "test", test, "yes", "run the quick self-test on each device"),
    NUMBER(CLN_TUNE, "budget", budget, CLN_ARG_REAL, "SECONDS", 1, 1e6, "60",
           "time to search in; what is best by then is taken"),
    FLAG(CLN_SELFTEST, "quick", 0, quick, "only the checks that take about a second"),

    FLAG(EVERY, "json", 0, json, "results as one JSON document on standard output"),
    WORD(CLN_TRAIN | CLN_EVAL | CLN_RENDER | CLN_TUNE, "progress", progress, "auto|bar|line|none", "auto",
         "a live line on a terminal, plain lines now and then, or neither"),
    FLAG(EVERY, "quiet", 'q', quiet, "no log but warnings, no progress"),
    COUNT(EVERY, "verbose", 'v', verbose, "log more"),
    FLAG(EVERY, "help", 'h', help, "this help"),
    FLAG(EVERY, "version", 'V', version, "the program's version; with -v also of what it stands on"),
};
/* clang-format on */
const int cln_arg_count = sizeof cln_args / sizeof cln_args[0];
_Static_assert(sizeof cln_args / sizeof cln_args[0] <= CLN_ARGS_MAX, "parser keeps a flag per row");

/* ---- names ---- */

bool cln_command_takes_arg(const cln_command *command, const cln_arg *arg)
{
    return (arg->commands & (command ? command->bit : EVERY)) != 0;
}

bool cln_command_takes_row(const cln_command *command, const cln_config_row *row)
{
    switch (command ? command->bit : 0) {
    case CLN_TRAIN:
        return true;
    case CLN_INFO:
        return row->flags & CLN_ROW_SCENE;
    case CLN_TUNE:
        return row->flags & CLN_ROW_TUNE;
    default:
        return false;
    }
}

const cln_arg *cln_arg_find(const cln_command *command, const char *name, size_t length)
{
    for (int i = 0; i < cln_arg_count; i++) {
        const cln_arg *arg = &cln_args[i];
        if (cln_command_takes_arg(command, arg) && strlen(arg->name) == length &&
            memcmp(arg->name, name, length) == 0)
            return arg;
    }
    return NULL;
}

const cln_arg *cln_arg_find_letter(const cln_command *command, char letter)
{
    for (int i = 0; i < cln_arg_count; i++) {
        if (cln_command_takes_arg(command, &cln_args[i]) && cln_args[i].letter == letter)
            return &cln_args[i];
    }
    return NULL;
}

const cln_config_row *cln_row_find(const cln_command *command, const char *name, size_t length)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        if (cln_command_takes_row(command, row) && cln_config_named(row, name, length))
            return row;
    }
    return NULL;
}

const cln_command *cln_command_find(const char *name)
{
    for (int i = 0; i < cln_command_count; i++) {
        if (strcmp(cln_commands[i].name, name) == 0)
            return &cln_commands[i];
    }
    return NULL;
}

/* ---- errors ---- */

/* Keeps the nearer of *best and candidate. */
static void consider(const char *name, const char *candidate, int *distance, const char **best)
{
    int d = cln_edit_distance(name, candidate);

    if (d < *distance) {
        *distance = d;
        *best = candidate;
    }
}

/* A name that is in no table of this command: whose it is, or which one it resembles. */
cln_status cln_fail_option(const cln_command *command, const char *name, size_t length)
{
    char wanted[64], owners[128] = "";
    const char *best = NULL;
    const char *no = "";
    int distance = 4; /* further off than 3 edits is no suggestion */
    unsigned bits = 0;

    snprintf(wanted, sizeof wanted, "%.*s", (int)length, name);
    for (int i = 0; i < cln_command_count; i++) {
        if (cln_arg_find(&cln_commands[i], name, length) ||
            cln_row_find(&cln_commands[i], name, length))
            bits |= cln_commands[i].bit;
    }
    if (bits && command) {
        for (int i = 0; i < cln_command_count; i++) {
            size_t used = strlen(owners);
            if (bits & cln_commands[i].bit)
                snprintf(owners + used, sizeof owners - used, "%s%s", used ? ", " : "",
                         cln_commands[i].name);
        }
        return cln_fail(CLN_USAGE, "--%s is no option of %s (it is one of: %s)", wanted,
                        command->name, owners);
    }
    name = wanted;
    if (strncmp(wanted, "no-", 3) == 0) {
        name += 3;
        no = "no-";
    }
    for (int i = 0; i < cln_arg_count; i++) {
        if (cln_command_takes_arg(command, &cln_args[i]) && (!*no || cln_args[i].negatable))
            consider(name, cln_args[i].name, &distance, &best);
    }
    for (int i = 0; i < cln_config_row_count; i++) {
        if (cln_command_takes_row(command, &cln_config_rows[i]) &&
            (!*no || cln_config_rows[i].type == CLN_ROW_BOOL))
            consider(name, cln_config_rows[i].option, &distance, &best);
    }
    if (best)
        return cln_fail(CLN_USAGE, "--%s: there is no such option; did you mean --%s%s?", wanted,
                        no, best);
    return cln_fail(CLN_USAGE, "--%s: there is no such option", wanted);
}

cln_status cln_fail_command(const char *name)
{
    const char *best = NULL;
    int distance = 4;

    for (int i = 0; i < cln_command_count; i++)
        consider(name, cln_commands[i].name, &distance, &best);
    if (best)
        return cln_fail(CLN_USAGE, "'%s' is no command; did you mean '%s'?", name, best);
    return cln_fail(CLN_USAGE, "'%s' is no command", name);
}
