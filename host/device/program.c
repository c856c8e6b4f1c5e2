/* Programs from embedded or on-disk kernel files. A program's source is an array of lines with
 * #line marks, so that build errors name the real file and line; the device's compiler includes
 * nothing. */
#include "device/program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "device/cache.h"
#include "device/cl_error.h"
#include "device/kernel_source.h"

enum { FILES = 24, NAME = 32 };

/* Texts for clCreateProgramWithSource; `owned` ones are freed. */
typedef struct source {
    const char **text;
    char *owned[2 * FILES + 1]; /* each file's mark, and its text if it was read */
    char names[FILES][NAME];    /* files so far */
    int count, owned_count, files;
} source;

static cln_status append(source *s, const char *text)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_grow(&s->text, s->count, sizeof *s->text, "kernel source"));
    s->text[s->count++] = text;
done:
    return st;
}

static cln_status own(source *s, char *text)
{
    cln_status st = CLN_OK;

    CLN_ASSERT(s->owned_count < (int)(sizeof s->owned / sizeof s->owned[0]));
    s->owned[s->owned_count++] = text;
    CLN_TRY(append(s, text));
done:
    return st;
}

static const char *const *embedded(const char *name)
{
    for (const cln_kernel_source *k = cln_kernel_sources; k->name; k++)
        if (strcmp(k->name, name) == 0)
            return k->lines;
    return NULL;
}

/* Adds a file's name; false if it is there already. */
static bool enter(source *s, const char *name)
{
    for (int i = 0; i < s->files; i++)
        if (strcmp(s->names[i], name) == 0)
            return false;
    CLN_ASSERT(s->files < FILES);
    snprintf(s->names[s->files++], NAME, "%s", name);
    return true;
}

/* Appends a kernel file, once, after the headers that its first line names, and theirs:
 *   needs: leaves network */
static cln_status append_file(cln_device *device, source *s, const char *name)
{
    cln_status st = CLN_OK;
    static const char needs[] = "/* needs: ";
    const char *const *lines = embedded(name);
    char *mark = NULL, *path = NULL, *text = NULL, header[NAME];
    const char *first = NULL;
    size_t bytes = 0;

    if (!enter(s, name))
        return CLN_OK;
    if (device->kernel_dir) {
        CLN_TRY(cln_path_join(&path, device->kernel_dir, name));
        if (cln_is_file(path)) /* missing files come from the binary */
            CLN_TRY(cln_read_file(path, 1 << 20, &text, &bytes));
    }
    if (!text && !lines)
        CLN_TRY(cln_fail(CLN_INTERNAL, "kernel file %s: no such file", name));
    first = text ? text : lines[0];
    if (strncmp(first, needs, sizeof needs - 1) == 0)
        for (first += sizeof needs - 1; *first && !strchr("*\n", *first);) {
            const size_t length = strcspn(first, " *\n");

            snprintf(header, sizeof header, "%.*s.h", (int)length, first);
            CLN_TRY(append_file(device, s, header));
            first += length + strspn(first + length, " ");
        }
    CLN_TRY(cln_asprintf(&mark, "#line 1 \"%s\"\n", name));
    CLN_TRY(own(s, mark));
    if (text) {
        char *read = text;

        text = NULL; /* handed over */
        CLN_TRY(own(s, read));
        goto done;
    }
    for (int i = 0; lines[i]; i++)
        CLN_TRY(append(s, lines[i]));
done:
    free(text);
    free(path);
    return st;
}

static bool is_word(char c)
{
    return c == '_' || (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
}

/* Returns whether a word occurs in the files. */
static bool mentions(const source *s, const char *word, size_t length)
{
    for (int i = 0; i < s->count; i++)
        for (const char *at = s->text[i]; (at = strstr(at, word)); at += length)
            if ((at == s->text[i] || !is_word(at[-1])) && !is_word(at[length]))
                return true;
    return false;
}

/* *out = the "#define NAME ..." lines whose names the files mention. So a setting that a program
 * does not read leaves its text as it is, and the driver's cache can have it already. */
static cln_status keep_defines(const source *s, const char *defines, char **out)
{
    static const char directive[] = "#define ";
    cln_status st = CLN_OK;
    char name[64], *end = NULL;

    CLN_TRY(cln_alloc(out, strlen(defines) + 1, 1, "kernel defines"));
    end = *out;
    for (const char *line = defines, *next = NULL; *line; line = next) {
        const char *word = line + sizeof directive - 1;
        size_t length = 0;

        next = strchr(line, '\n');
        next = next ? next + 1 : line + strlen(line);
        CLN_ASSERT(strncmp(line, directive, sizeof directive - 1) == 0);
        while (is_word(word[length]))
            length++;
        snprintf(name, sizeof name, "%.*s", (int)length, word);
        if (mentions(s, name, length)) {
            memcpy(end, line, (size_t)(next - line));
            end += next - line;
        }
    }
    *end = 0;
done:
    return st;
}

/* *log = the driver's words on a build; the caller frees it. NULL if there are none. */
static void read_log(cln_device *device, const cln_program *program, char **log)
{
    size_t bytes = 0;

    *log = NULL;
    clGetProgramBuildInfo(program->program, device->id, CL_PROGRAM_BUILD_LOG, 0, NULL, &bytes);
    if (bytes > 1 && cln_alloc(log, bytes + 1, 1, "build log") == CLN_OK)
        clGetProgramBuildInfo(program->program, device->id, CL_PROGRAM_BUILD_LOG, bytes, *log,
                              NULL);
}

/* The reason of a failed build: a place that the driver cannot write to, or the kernel, whose log
 * is then shown. */
static cln_status build_failed(cln_device *device, const cln_program *program, cl_int code)
{
    cln_status st = CLN_OK;
    char *log = NULL, *rest = NULL;

    read_log(device, program, &log);
    CLN_TRY(cln_cache_blame(device->info.platform, !log || !strstr(log, "error:")));
    if (log)
        for (char *line = strtok_r(log, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest))
            cln_warn("%s.cl: %s", program->name, line);
    CLN_TRY(cln_fail(CLN_BUILD,
                     "kernel program %s.cl does not build on %s (driver %s): %s; its log is above, "
                     "%s",
                     program->name, device->info.name, device->info.driver, cln_cl_name(code),
                     device->kernel_dir
                         ? "mend the file in --kernel-dir or leave the option out"
                         : "please report it with the output of `cl-nascent devices`"));
done:
    free(log);
    return st;
}

/* Processors' seconds of a build beyond which the driver compiled, and of such builds until that is
 * said: one that finds the program in its folder takes 0.02, one that compiles 0.3 to 3. */
static const double FOUND = 0.2, QUIET = 1;

/* Says once per device that kernels are compiled, which takes long, and that others will find
 * them: those whose constants are the same (pipeline/programs.c). */
static void note_build(cln_device *device, double seconds)
{
    const double before = device->compile_seconds;

    device->compile_seconds += seconds;
    if (before < QUIET && device->compile_seconds >= QUIET)
        cln_info("building kernels for %s, %s: up to a minute or two", device->info.name,
                 cln_cache_keeps(device->info.platform)
                     ? "once for scenes and settings of this kind"
                     : "each time unless its driver keeps them");
}

cln_status cln_program_build(cln_device *device, const char *name, const char *defines,
                             cln_program *out)
{
    cln_status st = CLN_OK;
    char *kept = NULL, *file = NULL;
    source s = {0};
    cl_int code = CL_SUCCESS;
    double seconds = 0;

    memset(out, 0, sizeof *out);
    snprintf(out->name, sizeof out->name, "%s", name);
    CLN_TRY(cln_stopped_by(cln_poll_signal(device->callbacks), NULL));
    CLN_TRY(append(&s, "")); /* place of the defines */
    CLN_TRY(append_file(device, &s, "device_abi.h"));
    CLN_TRY(append_file(device, &s, "lanes.h"));
    CLN_TRY(cln_asprintf(&file, "%s.cl", name));
    CLN_TRY(append_file(device, &s, file));
    CLN_TRY(keep_defines(&s, defines ? defines : "", &kept));
    s.text[0] = kept;
    out->program =
        clCreateProgramWithSource(device->context, (cl_uint)s.count, s.text, NULL, &code);
    if (code != CL_SUCCESS)
        CLN_TRY(cln_cl_failed("clCreateProgramWithSource", code));
    CLN_TRY(cln_cache_ready(device->info.platform, &device->cache_ready));
    CLN_TRY(cln_cache_take_turn(device->info.platform, false, device->callbacks, &device->turn));
    seconds = -cln_processor_seconds();
    code = clBuildProgram(out->program, 1, &device->id, "-cl-std=CL1.2 -w", NULL, NULL);
    seconds += cln_processor_seconds();
    if (code != CL_SUCCESS)
        CLN_TRY(build_failed(device, out, code));
    if (seconds > FOUND) {
        note_build(device, seconds);
        CLN_TRY(cln_cache_take_turn(device->info.platform, true, device->callbacks, &device->turn));
    }
done:
    for (int i = 0; i < s.owned_count; i++)
        free(s.owned[i]);
    free(s.text);
    free(kept);
    free(file);
    if (st != CLN_OK)
        cln_program_free(out);
    return st;
}

void cln_program_free(cln_program *program)
{
    if (program->program)
        clReleaseProgram(program->program);
    program->program = NULL;
}

cln_status cln_kernel_create(const cln_program *program, const char *name, cl_kernel *out)
{
    cl_int code = CL_SUCCESS;

    *out = clCreateKernel(program->program, name, &code);
    if (code == CL_SUCCESS)
        return CLN_OK;
    *out = NULL;
    cln_cl_failed("clCreateKernel", code);
    cln_note("creating kernel %s of %s.cl", name, program->name);
    return CLN_CL;
}

void cln_kernel_free(cl_kernel *kernel)
{
    if (*kernel)
        clReleaseKernel(*kernel);
    *kernel = NULL;
}
