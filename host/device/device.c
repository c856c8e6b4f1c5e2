/* Lists, picks, opens and closes devices, and chooses an open one's tuning parameters. */
#include "device/device.h"

#include <ctype.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "device/blocks.h"
#include "device/cache.h"
#include "device/cl_error.h"
#include "device/kernel_dir.h"
#include "ranks/ranks.h"

const char *const cln_stage_names[CLN_STAGES] = {
#define X(name, text) text,
    CLN_STAGE_LIST(X)
#undef X
};

const char *cln_stage_text(const char *name, bool voxels)
{
    if (voxels && strcmp(name, cln_stage_names[CLN_STAGE_FORWARD]) == 0)
        return "voxels forward";
    if (voxels && strcmp(name, cln_stage_names[CLN_STAGE_BACKWARD]) == 0)
        return "voxels backward";
    return name;
}

enum { MIN_ALLOC = 65536 };

static void device_text(cl_device_id id, cl_device_info what, char *out, size_t bytes)
{
    memset(out, 0, bytes);
    clGetDeviceInfo(id, what, bytes - 1, out, NULL);
    cln_utf8_repair(out); /* JSON and HTML need valid UTF-8 */
}

void cln_device_describe(cl_device_id id, cln_device_info *info)
{
    cl_platform_id platform = NULL;
    cl_device_type type = 0;
    cl_ulong global = 0, alloc = 0, local = 0;
    cl_bool unified = CL_FALSE;
    size_t group = 0;
    cl_uint units = 0;

    memset(info, 0, sizeof *info);
    clGetDeviceInfo(id, CL_DEVICE_PLATFORM, sizeof platform, &platform, NULL);
    clGetPlatformInfo(platform, CL_PLATFORM_NAME, sizeof info->platform - 1, info->platform, NULL);
    cln_utf8_repair(info->platform);
    device_text(id, CL_DEVICE_NAME, info->name, sizeof info->name);
    device_text(id, CL_DEVICE_VENDOR, info->vendor, sizeof info->vendor);
    device_text(id, CL_DRIVER_VERSION, info->driver, sizeof info->driver);
    device_text(id, CL_DEVICE_VERSION, info->version, sizeof info->version);
    clGetDeviceInfo(id, CL_DEVICE_TYPE, sizeof type, &type, NULL);
    clGetDeviceInfo(id, CL_DEVICE_GLOBAL_MEM_SIZE, sizeof global, &global, NULL);
    clGetDeviceInfo(id, CL_DEVICE_MAX_MEM_ALLOC_SIZE, sizeof alloc, &alloc, NULL);
    clGetDeviceInfo(id, CL_DEVICE_MAX_COMPUTE_UNITS, sizeof units, &units, NULL);
    snprintf(info->type, sizeof info->type, "%s",
             type & CL_DEVICE_TYPE_GPU   ? "gpu"
             : type & CL_DEVICE_TYPE_CPU ? "cpu"
                                         : "accelerator");
    info->global_mem = (double)global;
    info->max_alloc = (double)alloc;
    info->compute_units = (int)units;
    clGetDeviceInfo(id, CL_DEVICE_LOCAL_MEM_SIZE, sizeof local, &local, NULL);
    clGetDeviceInfo(id, CL_DEVICE_MAX_WORK_GROUP_SIZE, sizeof group, &group, NULL);
    clGetDeviceInfo(id, CL_DEVICE_HOST_UNIFIED_MEMORY, sizeof unified, &unified, NULL);
    info->local_mem = (double)local;
    info->max_group = group < INT_MAX ? (int)group : INT_MAX;
    info->shared_mem = unified || strcmp(info->type, "cpu") == 0;
}

static const char *platform_name(cl_platform_id id, char *out, size_t bytes)
{
    out[0] = 0;
    if (clGetPlatformInfo(id, CL_PLATFORM_NAME, bytes, out, NULL) != CL_SUCCESS)
        snprintf(out, bytes, "without a name");
    return out;
}

/* The first question makes a driver begin; PoCL's begins twice if two threads ask at once. */
static pthread_mutex_t asking = PTHREAD_MUTEX_INITIALIZER;

cln_status cln_device_ids(cl_device_id **out, int *count)
{
    cln_status st = CLN_OK;
    cl_uint platforms = 0;
    cl_platform_id ids[64];
    char name[128], *doubt = NULL;
    int total = 0;

    const char *chosen = getenv("POCL_DEVICES");

    *out = NULL;
    *count = 0;
    CLN_TRY(cln_alloc(out, 64 * 16, sizeof **out, "device list"));
    pthread_mutex_lock(&asking);
    if (clGetPlatformIDs(64, ids, &platforms) != CL_SUCCESS)
        platforms = 0;
    for (cl_uint p = 0; p < platforms && p < 64; p++) {
        cl_uint found = 0;

        if (clGetDeviceIDs(ids[p], CL_DEVICE_TYPE_ALL, 16, *out + total, &found) == CL_SUCCESS)
            total += found < 16 ? (int)found : 16;
    }
    pthread_mutex_unlock(&asking);
    *count = total;
    if (total == 0 && platforms)
        cln_cache_doubt(&doubt);
    if (total == 0 && platforms)
        st = cln_fail(
            CLN_NO_DEVICE, "no OpenCL device found, though there is a driver (%s); %s%s%s%s%s",
            platform_name(ids[0], name, sizeof name), chosen ? "POCL_DEVICES is '" : "",
            chosen ? chosen : "", chosen ? "': unset it, if that names no device of PoCL's; " : "",
            doubt ? doubt
                  : "PoCL needs a folder that it can write its cache to: set "
                    "POCL_CACHE_DIR to one",
            doubt ? ""
                  : "; GPUs need their vendor's driver (intel-opencl-icd, "
                    "mesa-opencl-icd, nvidia-opencl-icd)");
    else if (total == 0)
        st = cln_fail(
            CLN_NO_DEVICE,
            "no OpenCL device found (the OpenCL loader found no platform); install a driver: "
            "pocl-opencl-icd runs on any CPU (apt-get install pocl-opencl-icd), GPUs need their "
            "vendor's (intel-opencl-icd, mesa-opencl-icd, nvidia-opencl-icd)");
done:
    free(doubt);
    if (st != CLN_OK) {
        free(*out);
        *out = NULL;
    }
    return st;
}

static bool contains(const char *text, const char *part)
{
    const size_t n = strlen(part);

    for (; *text; text++) {
        size_t i = 0;

        while (i < n && text[i] &&
               tolower((unsigned char)text[i]) == tolower((unsigned char)part[i]))
            i++;
        if (i == n)
            return true;
    }
    return false;
}

/* Returns whether device number `row` matches spec, which is not "auto". */
static bool matches(const char *spec, int row, const cln_device_info *info)
{
    char number[16];

    snprintf(number, sizeof number, "%d", row);
    if (strcmp(spec, number) == 0)
        return true;
    if (strcasecmp(spec, "gpu") == 0 || strcasecmp(spec, "cpu") == 0)
        return strcasecmp(info->type, spec) == 0;
    if (spec[strspn(spec, "0123456789")] == 0)
        return false;
    return contains(info->name, spec) || contains(info->vendor, spec) ||
           contains(info->platform, spec);
}

/* Keeps of `count` CPUs, which are of one machine, those with most compute units. */
static int keep_largest(const cl_device_id *ids, int *found, int count)
{
    int most = 0, kept = 0;
    cln_device_info info;

    for (int i = 0; i < count; i++) {
        cln_device_describe(ids[found[i]], &info);
        most = info.compute_units > most ? info.compute_units : most;
    }
    for (int i = 0; i < count; i++) {
        cln_device_describe(ids[found[i]], &info);
        if (info.compute_units == most)
            found[kept++] = found[i];
    }
    return kept;
}

/* A listed device may be unusable: lost, or without a compiler (embedded profiles). NULL: it is
 * not. */
static const char *why_unusable(cl_device_id id)
{
    cl_bool available = CL_TRUE, compiler = CL_TRUE;

    clGetDeviceInfo(id, CL_DEVICE_AVAILABLE, sizeof available, &available, NULL);
    clGetDeviceInfo(id, CL_DEVICE_COMPILER_AVAILABLE, sizeof compiler, &compiler, NULL);
    return !available  ? "it is not available now"
           : !compiler ? "it has no OpenCL C compiler"
                       : NULL;
}

/* Picks a device that matches: the first one; several ranks of this machine take turns. */
static cln_status pick(const char *spec, const cl_device_id *ids, int count, int *out)
{
    static const char *const preference[] = {"gpu", "accelerator", "cpu"};
    int found[64 * 16], found_count = 0; /* as many as cln_device_ids lists */
    char which[64];

    if (!spec || !*spec || strcasecmp(spec, "auto") == 0) {
        int p = 0;

        for (; p < 3 && found_count == 0; p++)
            for (int i = 0; i < count; i++) {
                cln_device_info info;

                cln_device_describe(ids[i], &info);
                if (strcmp(info.type, preference[p]) == 0 && !why_unusable(ids[i]))
                    found[found_count++] = i;
            }
        if (p == 3 && found_count > 1)
            found_count = keep_largest(ids, found, found_count);
        *out = found_count > 0 ? found[cln_ranks_me_here() % found_count] : 0;
        return CLN_OK;
    }
    for (int i = 0; i < count; i++) {
        cln_device_info info;

        cln_device_describe(ids[i], &info);
        if (matches(spec, i, &info))
            found[found_count++] = i;
    }
    if (found_count > 0) {
        *out = found[cln_ranks_me_here() % found_count];
        return CLN_OK;
    }
    if (count == 1)
        snprintf(which, sizeof which, "the only OpenCL device does not match");
    else
        snprintf(which, sizeof which, "none of the %d OpenCL devices matches", count);
    return cln_fail(CLN_NO_DEVICE,
                    "--device %s: %s; `cl-nascent devices` lists what there is, --device takes a "
                    "row number, cpu, gpu or part of a name",
                    spec, which);
}

/* --max-alloc: for drivers that promise more than they keep, and to imitate a smaller device. */
static cln_status limit_alloc(cln_device *device, const char *text)
{
    double bytes = 0;

    if (!cln_bytes_read(text, &bytes) || bytes < MIN_ALLOC)
        return cln_fail(
            CLN_USAGE,
            "--max-alloc: '%s' is not a size of %d or more: give bytes, or 512K, 64M, 4G", text,
            MIN_ALLOC);
    if (bytes < device->info.max_alloc)
        device->info.max_alloc = bytes;
    return CLN_OK;
}

static cln_status check_usable(const cln_device *device)
{
    const char *why = why_unusable(device->id);

    return !why ? CLN_OK
                : cln_fail(CLN_NO_DEVICE,
                           "%s (%s): its driver says that %s; choose another with --device, "
                           "`cl-nascent devices` lists them",
                           device->info.name, device->info.platform, why);
}

cln_status cln_device_check(const cln_device_desc *desc)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;
    cln_tune ignored;
    cln_device_info info;
    int count = 0, index = 0;

    CLN_TRY(cln_kernel_dir_check(desc->kernel_dir));
    if (desc->tune)
        CLN_TRY(cln_tune_parse(desc->tune, &ignored));
    CLN_TRY(cln_device_ids(&ids, &count));
    CLN_TRY(pick(desc->spec, ids, count, &index));
    cln_device_describe(ids[index], &info);
    CLN_TRY(cln_cache_check(info.platform));
done:
    free(ids);
    return st;
}

cln_status cln_device_open(const cln_device_desc *desc, cln_device **out)
{
    cln_status st = CLN_OK;
    cl_device_id *ids = NULL;
    cln_device *device = NULL;
    cl_int code = CL_SUCCESS;
    int count = 0, index = 0;

    *out = NULL;
    CLN_TRY(cln_kernel_dir_check(desc->kernel_dir));
    cln_kernel_dir_say(desc->kernel_dir);
    CLN_TRY(cln_device_ids(&ids, &count));
    CLN_TRY(pick(desc->spec, ids, count, &index));
    CLN_TRY(cln_alloc(&device, 1, sizeof *device, "device"));
    CLN_TRY(cln_blocks_create(&device->blocks));
    device->booked = CLN_STAGES;
    device->id = ids[index];
    cln_device_describe(device->id, &device->info);
    CLN_TRY(check_usable(device));
    device->max_group = (size_t)(device->info.max_group > 0 ? device->info.max_group : 1);
    device->unified = device->info.shared_mem;
    device->local_mem = (size_t)device->info.local_mem;
    device->own_alloc = (size_t)device->info.max_alloc;
    if (desc->max_alloc)
        CLN_TRY(limit_alloc(device, desc->max_alloc));
    device->max_alloc = (size_t)device->info.max_alloc;
    cln_tune_class_default(device->id, strcmp(device->info.type, "cpu") == 0, &device->tune);
    if (desc->tune) {
        CLN_TRY(cln_tune_parse(desc->tune, &device->tune));
        snprintf(device->tune_from, sizeof device->tune_from, "--tune");
    }
    if (desc->tune_file)
        CLN_TRY(cln_tune_rows_read(desc->tune_file, &device->rows[0]));
    CLN_TRY(cln_tune_rows_shipped(&device->rows[1]));
    CLN_TRY(cln_strdup(&device->kernel_dir, desc->kernel_dir));
    device->context = clCreateContext(NULL, 1, &device->id, NULL, NULL, &code);
    if (code != CL_SUCCESS)
        CLN_TRY(cln_cl_failed("clCreateContext", code));
    device->queue =
        clCreateCommandQueue(device->context, device->id, CL_QUEUE_PROFILING_ENABLE, &code);
    if (code == CL_INVALID_QUEUE_PROPERTIES) /* times of stages are all that it lacks */
        device->queue = clCreateCommandQueue(device->context, device->id, 0, &code);
    if (code != CL_SUCCESS)
        CLN_TRY(cln_cl_failed("clCreateCommandQueue", code));
    cln_debug("device %d: %s (%s, driver %s)", index, device->info.name, device->info.platform,
              device->info.driver);
    *out = device;
    device = NULL;
done:
    free(ids);
    cln_device_close(device);
    return st;
}

void cln_device_close(cln_device *device)
{
    if (!device)
        return;
    if (device->queue) {
        clFinish(device->queue);
        for (int i = 0; i < device->pending_count; i++)
            clReleaseEvent(device->pending[i].event);
        clReleaseCommandQueue(device->queue);
    }
    if (device->context)
        clReleaseContext(device->context);
    cln_cache_end_turn(&device->turn);
    cln_blocks_close(device->blocks);
    cln_tune_rows_free(device->rows[0]);
    cln_tune_rows_free(device->rows[1]);
    free(device->pending);
    free(device->kernel_dir);
    free(device);
}

void cln_device_tune(const cln_device *device, const char *network, cln_tune *out,
                     char from[CLN_TUNE_FROM])
{
    *out = device->tune;
    snprintf(from, CLN_TUNE_FROM, "%s", device->tune_from);
    if (device->tune_exact || *from)
        return;
    for (int i = 0; i < 2; i++) {
        const cln_tune_row *row =
            cln_tune_rows_find(device->rows[i], device->info.name, device->info.driver, network);

        if (row) { /* on top of the class's defaults */
            cln_tune_row_apply(row, out);
            snprintf(from, CLN_TUNE_FROM, "%.400s, line %d", row->file, row->line);
            return;
        }
    }
    snprintf(from, CLN_TUNE_FROM, "built-in %s defaults",
             strcmp(device->info.type, "cpu") == 0   ? "CPU"
             : strcmp(device->info.type, "gpu") == 0 ? "GPU"
                                                     : device->info.type);
}
