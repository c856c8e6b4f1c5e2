/* Faults on demand, for tests/faults.sh: a library for LD_PRELOAD that counts the program's calls
 * of a kind and makes one of them fail, or ends the process there. Calls of other libraries
 * (drivers, compilers) do not count and do not fail, except those of jansson and zlib for the
 * program.
 *
 *   FAULT_CALL=write|read|memory|device|clock|launch|file|any   which calls; any: the first four
 *   FAULT_AT=K      the K-th of them; 0 or none: they are only counted
 *   FAULT_DO=once   it fails: EIO, no memory, an error of OpenCL                (the default)
 *            full   it and all after it fail: the disk is full, the device is lost
 *            nan    one of the arrays of floats that the kernel writes is NaN after the K-th
 *                   launch of those that write any (FAULT_CALL=launch)
 *            cut, garble, swap   the file that is read, below the folder FAULT_UNDER, has lost its
 *                   second half, has other bytes there, or has become FAULT_WITH (FAULT_CALL=file)
 *            kill   kill -9     term, int   that signal     storm   all that the program handles
 *            jump   the clock jumps by an hour, and the calendar by ten years, back and forth from
 *                   then on (FAULT_CALL=clock)
 *            tick   the clock stands still, but a second passes in each training step, a hundred
 *                   in the K-th
 *   FAULT_GROUPS=N  kernels take groups of at most N work-items, and say so
 *   FAULT_UNTIMED=1 the device cannot tell the times of launches
 *   FAULT_SPEED=N   the program's clock runs N times as fast: checkpoints by time come often
 *   FAULT_LOG=FILE  written at the end: "KIND CALLS", of the failed call also its name
 *
 * write: opening for writing, writes, flushes, closes, renames, new folders; not of standard output
 * and error. read: opening for reading, reads, folders, stat. */
#pragma GCC visibility push(default)
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include "cl.h"

enum { WRITE = 1, READ = 2, MEMORY = 4, DEVICE = 8, CLOCK = 16, LAUNCH = 32, CHANGE = 64 };
enum {
    MOST_RANGES = 16,
    MOST_ARGS = 64,
    MOST_KERNELS = 256,
    ERROR_FLAG = 0x20 /* _IO_ERR_SEEN of glibc */
};

extern void *__libc_malloc(size_t bytes);
extern void *__libc_calloc(size_t count, size_t bytes);
extern void *__libc_realloc(void *p, size_t bytes);
extern void *__libc_memalign(size_t alignment, size_t bytes);

static unsigned wanted;
static long fault_at, speed = 1;
static size_t most_group;
static bool untimed;
static const char *fault_do = "once";
static char failed[96];
static atomic_long calls, ticks;
static bool ticking;
static struct {
    uintptr_t from, to;
} ours[MOST_RANGES];
static int range_count;

static int note_object(struct dl_phdr_info *info, size_t size, void *user)
{
    const bool program = *(int *)user == 0;

    (void)size;
    ++*(int *)user;
    if (!program && !strstr(info->dlpi_name, "/libjansson") && !strstr(info->dlpi_name, "/libz."))
        return 0;
    for (int i = 0; i < info->dlpi_phnum && range_count < MOST_RANGES; i++) {
        const ElfW(Phdr) *part = &info->dlpi_phdr[i];

        if (part->p_type != PT_LOAD || !(part->p_flags & PF_X))
            continue;
        ours[range_count].from = info->dlpi_addr + part->p_vaddr;
        ours[range_count].to = ours[range_count].from + part->p_memsz;
        range_count++;
    }
    return 0;
}

__attribute__((constructor)) static void begin(void)
{
    static const char *const names[] = {"write", "read",   "memory", "device",
                                        "clock", "launch", "file",   "any"};
    static const unsigned kinds[] = {WRITE, READ, MEMORY, DEVICE, CLOCK, LAUNCH, CHANGE, 15};
    const char *call = getenv("FAULT_CALL"), *at = getenv("FAULT_AT"), *how = getenv("FAULT_DO");
    int objects = 0;

    dl_iterate_phdr(note_object, &objects);
    fault_at = at ? atol(at) : 0;
    fault_do = how ? how : fault_do;
    ticking = strcmp(fault_do, "tick") == 0;
    most_group = getenv("FAULT_GROUPS") ? (size_t)atol(getenv("FAULT_GROUPS")) : 0;
    untimed = getenv("FAULT_UNTIMED") != NULL;
    speed = getenv("FAULT_SPEED") ? atol(getenv("FAULT_SPEED")) : 1;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (call && strcmp(call, names[i]) == 0)
            wanted = kinds[i];
    unsetenv("LD_PRELOAD"); /* a driver's linker runs without */
}

__attribute__((destructor)) static void end(void)
{
    const char *path = getenv("FAULT_LOG");
    char line[128];
    int fd = -1;

    wanted = 0;
    if (path && (fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666)) >= 0) {
        snprintf(line, sizeof line, "%ld %s\n", atomic_load(&calls), failed);
        (void)!write(fd, line, strlen(line));
        close(fd);
    }
}

static bool is_ours(const void *caller)
{
    const uintptr_t p = (uintptr_t)caller;

    for (int i = 0; i < range_count; i++)
        if (p >= ours[i].from && p < ours[i].to)
            return true;
    return false;
}

/* Counts a call; true if it is to fail. */
static bool fails(unsigned kind, const char *name, const void *caller)
{
    static const int storm[] = {SIGUSR1, SIGWINCH, SIGUSR1, SIGCHLD, SIGPIPE, SIGURG, SIGTERM};
    const bool full = strcmp(fault_do, "full") == 0;
    long now = 0;

    if (!(wanted & kind) || !is_ours(caller))
        return false;
    now = atomic_fetch_add(&calls, 1) + 1;
    if (fault_at == 0 || now < fault_at || (now > fault_at && !full))
        return false;
    if (now == fault_at)
        strncpy(failed, name, sizeof failed - 1);
    if (full || kind == LAUNCH || kind == CHANGE || strcmp(fault_do, "once") == 0)
        return true;
    if (strcmp(fault_do, "kill") == 0)
        kill(getpid(), SIGKILL);
    else if (strcmp(fault_do, "term") == 0)
        raise(SIGTERM);
    else if (strcmp(fault_do, "int") == 0)
        raise(SIGINT);
    for (size_t i = 0; i < sizeof storm / sizeof storm[0] && strcmp(fault_do, "storm") == 0; i++)
        kill(getpid(), storm[i]);
    return false;
}

#define FAILS(kind) fails(kind, __func__, __builtin_return_address(0))
#define REAL(name)                 \
    static __typeof__(&name) real; \
    if (!real)                     \
    *(void **)&real = dlsym(RTLD_NEXT, #name)

static int disk(void)
{
    errno = strcmp(fault_do, "full") == 0 ? ENOSPC : EIO;
    return -1;
}

static bool standard(int fd)
{
    return fd >= 0 && fd <= 2;
}

/* ---- files ---- */

int open(const char *path, int flags, ...)
{
    mode_t mode = 0;
    va_list args;

    REAL(open);
    va_start(args, flags);
    if (flags & O_CREAT)
        mode = (mode_t)va_arg(args, int);
    va_end(args);
    if (flags & (O_WRONLY | O_RDWR)) {
        if (FAILS(WRITE))
            return disk();
    } else if (FAILS(READ)) {
        errno = ENOENT;
        return -1;
    }
    return real(path, flags, mode);
}

FILE *fopen(const char *path, const char *mode)
{
    REAL(fopen);
    if (*mode == 'r' ? FAILS(READ) : FAILS(WRITE)) {
        disk();
        errno = *mode == 'r' ? ENOENT : errno;
        return NULL;
    }
    return real(path, mode);
}

/* Is it a file below FAULT_UNDER? path: its name. */
static bool is_under(int fd, char path[4096])
{
    const char *folder = getenv("FAULT_UNDER");
    char link[40];
    ssize_t length = 0;

    if (!folder || wanted != CHANGE)
        return false;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, 4095);
    path[length > 0 ? length : 0] = 0;
    return length > 0 && strncmp(path, folder, strlen(folder)) == 0;
}

/* Changes a file that is open for reading. */
static void change(const char *path)
{
    static char bytes[1 << 20];
    const bool swap = strcmp(fault_do, "swap") == 0;
    const int from = swap ? open(getenv("FAULT_WITH"), O_RDONLY) : -1;
    const int to = open(path, O_WRONLY | (swap ? O_TRUNC : 0));
    const off_t half = to < 0 ? -1 : lseek(to, 0, SEEK_END) / 2;
    ssize_t count = 0;
    bool done = half >= 0 && (from >= 0 || !swap);

    snprintf(failed, sizeof failed, "%s", strrchr(path, '/') + 1);
    if (swap) {
        while (done && (count = read(from, bytes, sizeof bytes)) > 0)
            done = write(to, bytes, (size_t)count) == count;
    } else if (strcmp(fault_do, "cut") == 0) {
        done = done && ftruncate(to, half) == 0;
    } else {
        memset(bytes, 'Z', sizeof bytes);
        for (off_t at = half; done && at < 2 * half; at += count) {
            const off_t left = 2 * half - at;

            count = pwrite(to, bytes, left < 1 << 20 ? (size_t)left : 1 << 20, at);
            done = count > 0;
        }
    }
    if (!done)
        abort();
    close(from);
    close(to);
}

ssize_t read(int fd, void *out, size_t bytes)
{
    char path[4096];

    REAL(read);
    if (is_under(fd, path) && FAILS(CHANGE))
        change(path);
    if (!standard(fd) && FAILS(READ)) {
        errno = EIO;
        return -1;
    }
    return real(fd, out, bytes);
}

size_t fread(void *out, size_t size, size_t count, FILE *f)
{
    REAL(fread);
    if (FAILS(READ)) {
        errno = EIO;
        f->_flags |= ERROR_FLAG;
        return 0;
    }
    return real(out, size, count, f);
}

DIR *opendir(const char *path)
{
    REAL(opendir);
    if (FAILS(READ)) {
        errno = ENOENT;
        return NULL;
    }
    return real(path);
}

int stat(const char *path, struct stat *out)
{
    REAL(stat);
    if (FAILS(READ)) {
        errno = ENOENT;
        return -1;
    }
    return real(path, out);
}

ssize_t write(int fd, const void *data, size_t bytes)
{
    REAL(write);
    if (!standard(fd) && FAILS(WRITE))
        return disk();
    return real(fd, data, bytes);
}

ssize_t pwrite(int fd, const void *data, size_t bytes, off_t at)
{
    REAL(pwrite);
    return FAILS(WRITE) ? disk() : real(fd, data, bytes, at);
}

size_t fwrite(const void *data, size_t size, size_t count, FILE *f)
{
    REAL(fwrite);
    if (!standard(fileno(f)) && FAILS(WRITE)) {
        disk();
        f->_flags |= ERROR_FLAG;
        return 0;
    }
    return real(data, size, count, f);
}

int fputs(const char *text, FILE *f)
{
    REAL(fputs);
    if (!standard(fileno(f)) && FAILS(WRITE)) {
        f->_flags |= ERROR_FLAG;
        return disk();
    }
    return real(text, f);
}

int fprintf(FILE *f, const char *format, ...)
{
    int written = 0;
    va_list args;

    if (!standard(fileno(f)) && FAILS(WRITE)) {
        f->_flags |= ERROR_FLAG;
        return disk();
    }
    va_start(args, format);
    written = vfprintf(f, format, args);
    va_end(args);
    return written;
}

int fflush(FILE *f)
{
    REAL(fflush);
    if (f && !standard(fileno(f)) && FAILS(WRITE)) {
        f->_flags |= ERROR_FLAG;
        return disk();
    }
    return real(f);
}

int fclose(FILE *f)
{
    const int flags = fileno(f) > 2 ? fcntl(fileno(f), F_GETFL) : O_RDONLY;

    REAL(fclose);
    if (flags >= 0 && (flags & (O_WRONLY | O_RDWR)) && FAILS(WRITE)) {
        real(f);
        return disk();
    }
    return real(f);
}

int fsync(int fd)
{
    REAL(fsync);
    return FAILS(WRITE) ? disk() : real(fd);
}

int rename(const char *from, const char *to)
{
    REAL(rename);
    return FAILS(WRITE) ? disk() : real(from, to);
}

int mkdir(const char *path, mode_t mode)
{
    REAL(mkdir);
    return FAILS(WRITE) ? disk() : real(path, mode);
}

int ftruncate(int fd, off_t bytes)
{
    REAL(ftruncate);
    return FAILS(WRITE) ? disk() : real(fd, bytes);
}

/* ---- memory ---- */

static void *none(void)
{
    errno = ENOMEM;
    return NULL;
}

void *malloc(size_t bytes)
{
    return FAILS(MEMORY) ? none() : __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes)
{
    return FAILS(MEMORY) ? none() : __libc_calloc(count, bytes);
}

void *realloc(void *p, size_t bytes)
{
    return FAILS(MEMORY) ? none() : __libc_realloc(p, bytes);
}

int posix_memalign(void **out, size_t alignment, size_t bytes)
{
    if (FAILS(MEMORY))
        return ENOMEM;
    *out = __libc_memalign(alignment, bytes);
    return *out ? 0 : ENOMEM;
}

char *strdup(const char *text)
{
    const size_t bytes = strlen(text) + 1;
    char *copy = FAILS(MEMORY) ? none() : __libc_malloc(bytes);

    return copy ? memcpy(copy, text, bytes) : NULL;
}

char *strndup(const char *text, size_t most)
{
    const size_t bytes = strnlen(text, most);
    char *copy = FAILS(MEMORY) ? none() : __libc_calloc(bytes + 1, 1);

    return copy ? memcpy(copy, text, bytes) : NULL;
}

char *realpath(const char *path, char *out)
{
    REAL(realpath);
    return FAILS(MEMORY) ? none() : real(path, out);
}

/* ---- clock ---- */

/* Monotonic time only jumps forwards. */
static long jumped(bool calendar)
{
    const bool jumps = strcmp(fault_do, "jump") == 0 && fault_at > 0;
    const long now = atomic_load(&calls);

    if (!jumps || now < fault_at)
        return 0;
    return calendar ? (now % 2 ? 1 : -1) * 315360000L : 3600;
}

int clock_gettime(clockid_t clock, struct timespec *out)
{
    int rc = 0;

    REAL(clock_gettime);
    rc = real(clock, out);
    FAILS(CLOCK);
    if (is_ours(__builtin_return_address(0))) {
        const __int128 fast = (out->tv_sec * (__int128)1000000000 + out->tv_nsec) * speed;

        if (clock == CLOCK_MONOTONIC && ticking) {
            *out = (struct timespec){.tv_sec = 1000000 + atomic_load(&ticks)};
        } else if (clock == CLOCK_MONOTONIC && speed > 1) {
            out->tv_sec = (time_t)(fast / 1000000000);
            out->tv_nsec = (long)(fast % 1000000000);
        }
        out->tv_sec += jumped(clock == CLOCK_REALTIME);
    }
    return rc;
}

time_t time(time_t *out)
{
    time_t now = 0;

    REAL(time);
    now = real(NULL);
    FAILS(CLOCK);
    if (is_ours(__builtin_return_address(0)))
        now += jumped(true);
    if (out)
        *out = now;
    return now;
}

/* ---- OpenCL ---- */

#define RETURNS(name, list, args, code)            \
    CL_API_ENTRY cl_int CL_API_CALL name list      \
    {                                              \
        REAL(name);                                \
        return FAILS(DEVICE) ? (code) : real args; \
    }

#define MAKES(type, name, list, args, code) \
    CL_API_ENTRY type CL_API_CALL name list \
    {                                       \
        REAL(name);                         \
        if (!FAILS(DEVICE))                 \
            return real args;               \
        if (status)                         \
            *status = (code);               \
        return NULL;                        \
    }

RETURNS(clGetPlatformIDs, (cl_uint most, cl_platform_id *out, cl_uint *count), (most, out, count),
        CL_OUT_OF_HOST_MEMORY)
RETURNS(clGetDeviceIDs,
        (cl_platform_id platform, cl_device_type type, cl_uint most, cl_device_id *out,
         cl_uint *count),
        (platform, type, most, out, count), CL_OUT_OF_HOST_MEMORY)
RETURNS(clGetDeviceInfo,
        (cl_device_id device, cl_device_info what, size_t bytes, void *out, size_t *needed),
        (device, what, bytes, out, needed), CL_OUT_OF_RESOURCES)
RETURNS(clGetKernelInfo,
        (cl_kernel kernel, cl_kernel_info what, size_t bytes, void *out, size_t *needed),
        (kernel, what, bytes, out, needed), CL_OUT_OF_RESOURCES)
RETURNS(clEnqueueReadBuffer,
        (cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t bytes,
         void *out, cl_uint count, const cl_event *events, cl_event *event),
        (queue, buffer, blocking, offset, bytes, out, count, events, event), CL_OUT_OF_RESOURCES)
RETURNS(clEnqueueWriteBuffer,
        (cl_command_queue queue, cl_mem buffer, cl_bool blocking, size_t offset, size_t bytes,
         const void *data, cl_uint count, const cl_event *events, cl_event *event),
        (queue, buffer, blocking, offset, bytes, data, count, events, event),
        CL_MEM_OBJECT_ALLOCATION_FAILURE)
RETURNS(clEnqueueFillBuffer,
        (cl_command_queue queue, cl_mem buffer, const void *pattern, size_t width, size_t offset,
         size_t bytes, cl_uint count, const cl_event *events, cl_event *event),
        (queue, buffer, pattern, width, offset, bytes, count, events, event),
        CL_MEM_OBJECT_ALLOCATION_FAILURE)
RETURNS(clEnqueueMarkerWithWaitList,
        (cl_command_queue queue, cl_uint count, const cl_event *events, cl_event *event),
        (queue, count, events, event), CL_OUT_OF_RESOURCES)
RETURNS(clFlush, (cl_command_queue queue), (queue), CL_OUT_OF_RESOURCES)

/* These fail once the device has ended, as it goes on in fact: before, it might still read what the
 * program frees next. */
#define WAITS(name, list, args, code)         \
    CL_API_ENTRY cl_int CL_API_CALL name list \
    {                                         \
        const bool faulty = FAILS(DEVICE);    \
        cl_int done = CL_SUCCESS;             \
                                              \
        REAL(name);                           \
        done = real args;                     \
        return faulty ? (code) : done;        \
    }

WAITS(clWaitForEvents, (cl_uint count, const cl_event *events), (count, events),
      CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST)
WAITS(clFinish, (cl_command_queue queue), (queue), CL_OUT_OF_RESOURCES)
MAKES(cl_context, clCreateContext,
      (const cl_context_properties *properties, cl_uint count, const cl_device_id *devices,
       void (*notify)(const char *, const void *, size_t, void *), void *user, cl_int *status),
      (properties, count, devices, notify, user, status), CL_OUT_OF_HOST_MEMORY)
CL_API_ENTRY cl_command_queue CL_API_CALL clCreateCommandQueue(
    cl_context context, cl_device_id device, cl_command_queue_properties properties, cl_int *status)
{
    REAL(clCreateCommandQueue);
    if (FAILS(DEVICE) || (untimed && properties)) {
        *status = untimed ? CL_INVALID_QUEUE_PROPERTIES : CL_OUT_OF_HOST_MEMORY;
        return NULL;
    }
    return real(context, device, properties, status);
}

MAKES(cl_mem, clCreateBuffer,
      (cl_context context, cl_mem_flags flags, size_t bytes, void *host, cl_int *status),
      (context, flags, bytes, host, status), CL_MEM_OBJECT_ALLOCATION_FAILURE)
MAKES(cl_program, clCreateProgramWithSource,
      (cl_context context, cl_uint count, const char **texts, const size_t *lengths,
       cl_int *status),
      (context, count, texts, lengths, status), CL_OUT_OF_HOST_MEMORY)
MAKES(cl_kernel, clCreateKernel, (cl_program program, const char *name, cl_int *status),
      (program, name, status), CL_OUT_OF_RESOURCES)

/* A training step launches one kernel of this name. */
static void tick(cl_kernel kernel)
{
    static long steps;
    char name[48] = "";

    clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, NULL);
    if (strcmp(name, "composite_train") == 0)
        atomic_fetch_add(&ticks, ++steps == fault_at ? 100 : 1);
}

/* Kernels with their buffers by the arguments' places (of other arguments, any bytes), and the
 * places of the arrays of floats, or of vectors of them, that they may write. */
typedef struct kernel_args {
    cl_kernel kernel;
    cl_mem buffers[MOST_ARGS];
    cl_uint outputs[MOST_ARGS], count;
} kernel_args;

static bool is_output(cl_kernel kernel, cl_uint at)
{
    cl_kernel_arg_address_qualifier space = 0;
    cl_kernel_arg_type_qualifier more = 0;
    char type[64] = "";

    return clGetKernelArgInfo(kernel, at, CL_KERNEL_ARG_ADDRESS_QUALIFIER, sizeof space, &space,
                              NULL) == CL_SUCCESS &&
           space == CL_KERNEL_ARG_ADDRESS_GLOBAL &&
           clGetKernelArgInfo(kernel, at, CL_KERNEL_ARG_TYPE_QUALIFIER, sizeof more, &more, NULL) ==
               CL_SUCCESS &&
           !(more & CL_KERNEL_ARG_TYPE_CONST) &&
           clGetKernelArgInfo(kernel, at, CL_KERNEL_ARG_TYPE_NAME, sizeof type, type, NULL) ==
               CL_SUCCESS &&
           strncmp(type, "float", 5) == 0;
}

static kernel_args *args_of(cl_kernel kernel)
{
    static kernel_args all[MOST_KERNELS];
    static int kernels;
    kernel_args *args = all;
    cl_uint count = 0;

    for (int i = 0; i < kernels; i++, args++)
        if (args->kernel == kernel)
            return args;
    if (kernels++ == MOST_KERNELS ||
        clGetKernelInfo(kernel, CL_KERNEL_NUM_ARGS, sizeof count, &count, NULL) != CL_SUCCESS)
        abort();
    args->kernel = kernel;
    for (cl_uint i = 0; i < count && i < MOST_ARGS; i++)
        if (is_output(kernel, i))
            args->outputs[args->count++] = i;
    return args;
}

/* Fills one of the kernel's outputs. */
static void fill_with_nan(cl_command_queue queue, const kernel_args *args)
{
    const cl_uint nan = 0x7fc00000;
    const cl_mem one = args->buffers[args->outputs[(cl_uint)fault_at % args->count]];
    size_t bytes = 0;
    char name[48] = "";

    clGetKernelInfo(args->kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, NULL);
    snprintf(failed, sizeof failed, "%s, output %u of %u", name,
             (cl_uint)fault_at % args->count + 1, args->count);
    if (!one) { /* an array of which this launch has no part */
        snprintf(failed, sizeof failed, "%s, an output that is not there", name);
        return;
    }
    if (clGetMemObjectInfo(one, CL_MEM_SIZE, sizeof bytes, &bytes, NULL) != CL_SUCCESS ||
        clEnqueueFillBuffer(queue, one, &nan, sizeof nan, 0, bytes / 4 * 4, 0, NULL, NULL) !=
            CL_SUCCESS)
        abort();
}

CL_API_ENTRY cl_int CL_API_CALL clBuildProgram(cl_program program, cl_uint count,
                                               const cl_device_id *devices, const char *options,
                                               void (*notify)(cl_program, void *), void *user)
{
    char more[1024];

    REAL(clBuildProgram);
    if (FAILS(DEVICE))
        return CL_BUILD_PROGRAM_FAILURE;
    snprintf(more, sizeof more, "%s%s", options ? options : "",
             wanted == LAUNCH ? " -cl-kernel-arg-info" : ""); /* for is_output */
    return real(program, count, devices, more, notify, user);
}

CL_API_ENTRY cl_int CL_API_CALL clSetKernelArg(cl_kernel kernel, cl_uint at, size_t bytes,
                                               const void *value)
{
    REAL(clSetKernelArg);
    if (FAILS(DEVICE))
        return CL_OUT_OF_RESOURCES;
    if (wanted == LAUNCH && at < MOST_ARGS)
        args_of(kernel)->buffers[at] =
            value && bytes == sizeof(cl_mem) ? *(const cl_mem *)value : NULL;
    return real(kernel, at, bytes, value);
}

CL_API_ENTRY cl_int CL_API_CALL clGetKernelWorkGroupInfo(cl_kernel kernel, cl_device_id device,
                                                         cl_kernel_work_group_info what,
                                                         size_t bytes, void *value, size_t *needed)
{
    REAL(clGetKernelWorkGroupInfo);
    const cl_int code = real(kernel, device, what, bytes, value, needed);

    if (code == CL_SUCCESS && what == CL_KERNEL_WORK_GROUP_SIZE && value && most_group &&
        *(size_t *)value > most_group)
        *(size_t *)value = most_group;
    return code;
}

CL_API_ENTRY cl_int CL_API_CALL clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel,
                                                       cl_uint dims, const size_t *offset,
                                                       const size_t *global, const size_t *local,
                                                       cl_uint count, const cl_event *events,
                                                       cl_event *event)
{
    cl_int code = CL_SUCCESS;
    bool spoils = false;
    size_t group = 1;

    REAL(clEnqueueNDRangeKernel);
    if (FAILS(DEVICE))
        return CL_OUT_OF_RESOURCES;
    for (cl_uint i = 0; i < dims; i++)
        group *= local ? local[i] : 1;
    if (most_group && group > most_group)
        return CL_INVALID_WORK_GROUP_SIZE;
    if (ticking)
        tick(kernel);
    spoils = wanted == LAUNCH && args_of(kernel)->count > 0 && FAILS(LAUNCH);
    code = real(queue, kernel, dims, offset, global, local, count, events, event);
    if (spoils && code == CL_SUCCESS)
        fill_with_nan(queue, args_of(kernel));
    return code;
}
