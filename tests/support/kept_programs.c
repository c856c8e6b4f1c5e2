/* Programs that build/tests has built stay built: PoCL reads a header of 18,000 lines for each
 * program, also for one that its cache has, and a group of tests opens a device dozens of times.
 * The linker sends three calls of OpenCL here (--wrap, Makefile): a device's context is made once
 * in a process, and a program of the same text in it is built once. Kernels, buffers and queues
 * are made and released as ever; builds that fail are not kept. A text must be built with the same
 * options each time, as they are not known yet when a program is made: others are refused. So a
 * program or context that is not released is no leak here, but it is to tests/cli/leaks.sh. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "cl.h"

enum { CONTEXTS = 8, PROGRAMS = 64 };

typedef void(CL_CALLBACK *context_notify)(const char *, const void *, size_t, void *);
typedef void(CL_CALLBACK *build_notify)(cl_program, void *);

cl_context __real_clCreateContext(const cl_context_properties *properties, cl_uint count,
                                  const cl_device_id *devices, context_notify notify, void *user,
                                  cl_int *code);
cl_context __wrap_clCreateContext(const cl_context_properties *properties, cl_uint count,
                                  const cl_device_id *devices, context_notify notify, void *user,
                                  cl_int *code);
cl_program __real_clCreateProgramWithSource(cl_context context, cl_uint count, const char **texts,
                                            const size_t *lengths, cl_int *code);
cl_program __wrap_clCreateProgramWithSource(cl_context context, cl_uint count, const char **texts,
                                            const size_t *lengths, cl_int *code);
cl_int __real_clBuildProgram(cl_program program, cl_uint count, const cl_device_id *devices,
                             const char *options, build_notify notify, void *user);
cl_int __wrap_clBuildProgram(cl_program program, cl_uint count, const cl_device_id *devices,
                             const char *options, build_notify notify, void *user);

static struct {
    cl_device_id device;
    cl_context context;
} contexts[CONTEXTS];

/* The last programs, in a ring. */
static struct {
    cl_context context;
    cl_program program;
    char *text;    /* NULL: no program */
    char *options; /* it was built with; NULL: it was not */
} programs[PROGRAMS];
static int next_program;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

cl_context __wrap_clCreateContext(const cl_context_properties *properties, cl_uint count,
                                  const cl_device_id *devices, context_notify notify, void *user,
                                  cl_int *code)
{
    cl_context context = NULL;
    int i = 0;

    pthread_mutex_lock(&lock);
    while (i < CONTEXTS && contexts[i].context && contexts[i].device != devices[0])
        i++;
    if (count == 1 && i < CONTEXTS && contexts[i].context) {
        context = contexts[i].context;
        *code = clRetainContext(context);
    } else {
        context = __real_clCreateContext(properties, count, devices, notify, user, code);
        if (context && count == 1 && i < CONTEXTS && clRetainContext(context) == CL_SUCCESS) {
            contexts[i].device = devices[0];
            contexts[i].context = context;
        }
    }
    pthread_mutex_unlock(&lock);
    return context;
}

static char *join(cl_uint count, const char **texts)
{
    size_t bytes = 1, at = 0;
    char *all = NULL;

    for (cl_uint i = 0; i < count; i++)
        bytes += strlen(texts[i]);
    all = malloc(bytes);
    for (cl_uint i = 0; all && i < count; i++) {
        const size_t n = strlen(texts[i]);

        memcpy(all + at, texts[i], n + 1);
        at += n;
    }
    return all;
}

cl_program __wrap_clCreateProgramWithSource(cl_context context, cl_uint count, const char **texts,
                                            const size_t *lengths, cl_int *code)
{
    char *text = lengths ? NULL : join(count, texts);
    cl_program program = NULL;

    pthread_mutex_lock(&lock);
    for (int i = 0; i < PROGRAMS && text && !program; i++)
        if (programs[i].options && programs[i].context == context &&
            strcmp(programs[i].text, text) == 0) {
            program = programs[i].program;
            *code = clRetainProgram(program);
        }
    if (!program) {
        program = __real_clCreateProgramWithSource(context, count, texts, lengths, code);
        if (program && text && clRetainProgram(program) == CL_SUCCESS) {
            if (programs[next_program].text)
                clReleaseProgram(programs[next_program].program);
            free(programs[next_program].text);
            free(programs[next_program].options);
            programs[next_program].context = context;
            programs[next_program].program = program;
            programs[next_program].text = text;
            programs[next_program].options = NULL;
            text = NULL; /* handed over */
            next_program = (next_program + 1) % PROGRAMS;
        }
    }
    pthread_mutex_unlock(&lock);
    free(text);
    return program;
}

cl_int __wrap_clBuildProgram(cl_program program, cl_uint count, const cl_device_id *devices,
                             const char *options, build_notify notify, void *user)
{
    const char *given = options ? options : "";
    cl_int code = CL_BUILD_PROGRAM_FAILURE; /* of one that was not built yet */

    pthread_mutex_lock(&lock);
    for (int i = 0; i < PROGRAMS; i++)
        if (programs[i].text && programs[i].program == program && programs[i].options)
            code = strcmp(programs[i].options, given) == 0 ? CL_SUCCESS : CL_INVALID_BUILD_OPTIONS;
    pthread_mutex_unlock(&lock);
    if (code == CL_INVALID_BUILD_OPTIONS)
        fprintf(stderr, "kept_programs.c: \"%s\" are other options than this text's first\n",
                given);
    if (code != CL_BUILD_PROGRAM_FAILURE)
        return code;
    code = __real_clBuildProgram(program, count, devices, options, notify, user);
    pthread_mutex_lock(&lock);
    for (int i = 0; i < PROGRAMS; i++)
        if (programs[i].text && programs[i].program == program) {
            free(programs[i].options);
            programs[i].options = code == CL_SUCCESS ? strdup(given) : NULL;
        }
    pthread_mutex_unlock(&lock);
    return code;
}
