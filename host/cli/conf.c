/* cl-nascent.conf, line by line into settings. See conf.h; values are read and refused by
 * base/settings.h. */
#include "cli/conf.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/settings.h"
#include "base/text.h"
#include "cli/option_table.h"
#include "render/recorded.h"
#include "scene/scene.h"

#define NAME "cl-nascent.conf"

enum { MOST_BYTES = 1 << 20, MESSAGE_BYTES = 1024 };

static cln_status path_beside(const char *scene, char **out)
{
    cln_status st = CLN_OK;
    const char *slash = strrchr(scene, '/');
    char *folder = NULL;

    if (cln_is_dir(scene))
        return cln_path_join(out, scene, NAME);
    CLN_TRY(cln_asprintf(&folder, "%.*s", slash ? (int)(slash - scene) + 1 : 0, scene));
    CLN_TRY(cln_path_join(out, folder, NAME));
done:
    free(folder);
    return st;
}

cln_status cln_conf_set(cln_settings *settings, const cln_config_row *row, const char *value,
                        const char *folder)
{
    cln_status st = CLN_OK;
    char *path = NULL, *whole = NULL;

    if (!(row->flags & CLN_ROW_FILE) || !*value || strcmp(value, "none") == 0)
        return cln_settings_set(settings, row->option, value);
    CLN_TRY(folder ? cln_path_join(&path, folder, value) : cln_strdup(&path, value));
    if (cln_is_file(path)) {
        CLN_TRY(cln_path_absolute(&whole, path));
        if (strlen(whole) < CLN_TEXT_BYTES && cln_utf8_valid(whole)) {
            free(path);
            path = whole;
            whole = NULL;
        }
    }
    CLN_TRY(cln_settings_set(settings, row->option, path));
done:
    free(path);
    free(whole);
    return st;
}

/* "rays 2048", "rays = 2048", "rays: 2048", "--rays=2048", "skip", "no-skip", and
 * "level-at = \"\"". */
static const char *split(char *line, char **value)
{
    char *name = line + (strncmp(line, "--", 2) == 0 ? 2 : 0);
    char *end = name + strcspn(name, " \t=:");
    size_t length = 0;

    *value = end + strspn(end, " \t");
    *value += **value == '=' || **value == ':';
    *value += strspn(*value, " \t");
    *end = 0;
    length = strlen(*value);
    if (length >= 2 && (**value == '"' || **value == '\'') && (*value)[length - 1] == **value) {
        (*value)[length - 1] = 0;
        ++*value;
    }
    return name;
}

/* Adds "NAME VALUE" to the line for the log. */
static cln_status say(char **said, const char *path, const char *name, const char *value)
{
    const char *shown = *value ? value : "\"\"";

    return *said ? cln_append(said, ", %s %s", name, shown)
                 : cln_asprintf(said, "from %s: %s %s", path, name, shown);
}

/* What a file is read into. */
typedef struct reading {
    const bool *overridden; /* by row of the settings */
    bool keep_preset;
    const char *path;
    const char *folder; /* its own */
    cln_settings *settings;
    char **said;
    int line;
    int *set_at; /* by row of the settings: the line that set it, 0 = none */
    int preset_at;
} reading;

/* *at: the line that set it before, 0 = none; from now on this one. */
static void warn_again(const reading *r, const char *name, int *at)
{
    if (*at)
        cln_warn("%s: line %d sets %s again, after line %d; the last one counts", r->path, r->line,
                 name, *at);
    *at = r->line;
}

/* Begins with another preset. No setting may be given yet. */
static cln_status take_preset(reading *r, const char *value)
{
    cln_status st = CLN_OK;
    cln_settings *fresh = NULL;

    if (!*value)
        return cln_fail(CLN_INPUT, "'preset' has no value; write: preset %s", CLN_PRESETS);
    if (cln_settings_create(value, &fresh) != CLN_OK)
        return CLN_INPUT;
    *r->settings = *fresh;
    warn_again(r, "preset", &r->preset_at);
    st = say(r->said, r->path, "preset", value);
    cln_settings_free(fresh);
    return st;
}

/* presets: takes the preset only, which comes before all settings, else all but that. */
static cln_status take_line(reading *r, char *line, bool presets)
{
    char *value = NULL;
    const bool is_text = cln_utf8_valid(line);
    const char *name = split(line, &value);
    const cln_config_row *row = cln_config_find(name);
    const bool bare = !*value && value[-1] != '"' && value[-1] != '\'';

    if (!is_text)
        return cln_fail(CLN_INPUT, "this is not UTF-8, and run.json could not hold it; save the "
                                   "file as UTF-8");
    if (strcmp(name, "preset") == 0)
        return presets && !r->keep_preset ? take_preset(r, value) : CLN_OK;
    if (presets)
        return CLN_OK;
    if (!row && strncmp(name, "no-", 3) == 0 && bare) {
        row = cln_config_find(name + 3);
        if (row && !cln_config_is_switch(row))
            return cln_fail(CLN_INPUT,
                            "'%s': %s is not a switch; leave the line out, or give it a value",
                            name, row->option);
        value = "no";
    } else if (row && cln_config_is_switch(row) && bare) {
        value = "yes";
    } else if (bare && row) {
        return cln_fail(CLN_INPUT, "'%s' has no value; write: %s VALUE", name, name);
    }
    if (!row && cln_arg_find(cln_command_find("train"), name, strlen(name)))
        return cln_fail(CLN_INPUT,
                        "'%s' belongs on the command line; only settings of the training "
                        "can be here",
                        name);
    if (row && r->overridden[row - cln_config_rows])
        return CLN_OK;
    if ((row ? cln_conf_set(r->settings, row, value, r->folder)
             : cln_settings_set(r->settings, name, value)) != CLN_OK)
        return CLN_INPUT;
    warn_again(r, row->option, &r->set_at[row - cln_config_rows]);
    return say(r->said, r->path, row->option, value);
}

static cln_status take_lines(reading *r, const char *from, bool presets)
{
    cln_status st = CLN_OK;
    char *text = NULL, message[MESSAGE_BYTES];

    r->line = 0;
    CLN_TRY(cln_asprintf(&text, "%s", from));
    /* skips the byte order mark of Windows editors */
    for (char *line = text + (strncmp(text, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0), *next = NULL; line;
         line = next) {
        next = strchr(line, '\n');
        if (next)
            *next++ = 0;
        r->line++;
        line = cln_trim(line);
        if (!*line || take_line(r, line, presets) == CLN_OK)
            continue;
        snprintf(message, sizeof message, "%s", cln_error_text());
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_INPUT, "%s: line %d: %s", r->path, r->line, message));
    }
done:
    free(text);
    return st;
}

/* Editors of Windows add an ending that its folders hide. */
static cln_status say_ending(const char *conf, char **said)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(cln_asprintf(&path, "%s.txt", conf));
    if (cln_is_file(path))
        CLN_TRY(cln_asprintf(said, "are not read from %s, whose name has to be " NAME, path));
done:
    free(path);
    return st;
}

cln_status cln_conf_read(const char *scene, const bool *overridden, bool keep_preset,
                         cln_settings *settings, char **said)
{
    cln_status st = CLN_OK;
    char *path = NULL, *text = NULL, *folder = NULL;
    size_t bytes = 0;
    struct stat info;
    reading r = {.overridden = overridden, .keep_preset = keep_preset, .settings = settings};

    *said = NULL;
    CLN_TRY(path_beside(scene, &path));
    if (lstat(path, &info) != 0) {
        st = say_ending(path, said);
        goto done;
    }
    if (!cln_is_file(path))
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: is not a file, so there are no settings in it; rename it, or give --no-conf",
            path));
    CLN_TRY(cln_read_file(path, MOST_BYTES, &text, &bytes));
    CLN_TRY(cln_scene_folder(scene, &folder));
    CLN_TRY(cln_alloc(&r.set_at, (size_t)cln_config_row_count, sizeof *r.set_at, path));
    r.path = path;
    r.folder = folder;
    r.said = said;
    CLN_TRY(take_lines(&r, text, true));
    CLN_TRY(take_lines(&r, text, false));
done:
    free(r.set_at);
    free(path);
    free(text);
    free(folder);
    return st;
}

/* Adds "NAME VALUE (there VALUE)" to the line for the log. */
static cln_status say_other(char **said, const char *path, const cln_config_row *row,
                            const cln_settings *run, const cln_settings *there)
{
    cln_status st = CLN_OK;
    char ours[CLN_TEXT_BYTES], theirs[CLN_TEXT_BYTES];

    cln_config_text(&run->config, row, ours);
    cln_config_text(&there->config, row, theirs);
    if (!strcmp(ours, theirs))
        goto done;
    CLN_TRY(*said ? cln_append(said, ", ")
                  : cln_asprintf(said, "%s is not read on --resume: the run keeps ", path));
    CLN_TRY(cln_append(said, "%s %s (there %s)", row->option, *ours ? ours : "\"\"",
                       *theirs ? theirs : "\"\""));
done:
    return st;
}

cln_status cln_conf_compare(const char *run, const char *scene, const bool *overridden,
                            const cln_settings *settings, char **said)
{
    cln_status st = CLN_OK;
    char *found = NULL, *path = NULL, *taken = NULL;
    cln_settings *there = NULL;

    *said = NULL;
    if (!scene)
        CLN_TRY(cln_recorded_scene(run, &found));
    scene = scene ? scene : found;
    CLN_TRY(path_beside(scene, &path));
    CLN_TRY(cln_settings_create(NULL, &there));
    there->config = there->base = settings->config;
    CLN_TRY(cln_conf_read(scene, overridden, true, there, &taken));
    for (int i = 0; i < cln_config_row_count; i++)
        if (cln_settings_given(there, &cln_config_rows[i]))
            CLN_TRY(say_other(said, path, &cln_config_rows[i], settings, there));
done:
    if (st == CLN_INPUT || st == CLN_USAGE) { /* of no file, or of one that the run does not need */
        cln_clear_error();
        st = CLN_OK;
    }
    free(found);
    free(path);
    free(taken);
    cln_settings_free(there);
    return st;
}
