/* CLBlast: GemmStridedBatched over all leaves, a layer at a time, on the leaf networks' device,
 * with a small kernel for bias and activation between. Forward only. See peer.h. */
#include "cl.h"

#include <clblast_c.h>
#include <stdlib.h>

#include "base/memory.h"
#include "device/buffer.h"
#include "device/cl_error.h"
#include "device/program.h"
#include "device/queue.h"
#include "peer.h"

enum { W = PEER_WIDTH, L = PEER_LAYERS };

static const char *const source =
    "__kernel void activate(__global float16 *h, __global const float16 *bias, uint samples,\n"
    "                       uint layer, uint layers, float slope)\n"
    "{\n"
    "    const uint i = get_global_id(0), part = i & 3u, leaf = i / 4u / samples;\n"
    "    const float16 v = h[i] + bias[(leaf * layers + layer) * 4u + part];\n"
    "    h[i] = select(slope * v, v, v > 0.0f);\n"
    "}\n";

typedef struct clblast {
    const peer_data *data;
    cln_device *device;
    cl_program program;
    cl_kernel activate;
    cln_buffer x, w, bias, h[2];
} clblast;

static void release(void *own)
{
    clblast *c = own;

    if (!c)
        return;
    cln_buffer_free(c->device, &c->x);
    cln_buffer_free(c->device, &c->w);
    cln_buffer_free(c->device, &c->bias);
    cln_buffer_free(c->device, &c->h[0]);
    cln_buffer_free(c->device, &c->h[1]);
    cln_kernel_free(&c->activate);
    if (c->program)
        clReleaseProgram(c->program);
    CLBlastClearCache();
    free(c);
}

static cln_status put(cln_device *device, cln_buffer *buffer, const float *data, size_t floats)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(device, buffer, floats * sizeof *data, "CLBlast"));
    CLN_TRY(cln_buffer_write(device, buffer, 0, data, floats * sizeof *data));
done:
    return st;
}

static cln_status prepare(const peer_data *data, cln_device *device, void **own)
{
    cln_status st = CLN_OK;
    clblast *c = NULL;
    const size_t leaves = (size_t)data->leaves, all = leaves * (size_t)data->samples * W;
    cl_int code = CL_SUCCESS;

    CLN_TRY(cln_alloc(&c, 1, sizeof *c, "CLBlast"));
    c->data = data;
    c->device = device;
    c->program = clCreateProgramWithSource(device->context, 1, (const char **)&source, NULL, &code);
    CLN_CL(code);
    CLN_CL(clBuildProgram(c->program, 1, &device->id, "-cl-std=CL1.2", NULL, NULL));
    c->activate = clCreateKernel(c->program, "activate", &code);
    CLN_CL(code);
    CLN_TRY(put(device, &c->x, data->x, all));
    CLN_TRY(put(device, &c->w, data->w, leaves * L * PEER_CELLS));
    CLN_TRY(put(device, &c->bias, data->bias, leaves * L * W));
    for (int i = 0; i < 2; i++)
        CLN_TRY(cln_buffer_reserve(device, &c->h[i], all * sizeof(float), "CLBlast"));
    *own = c;
    c = NULL;
done:
    release(c);
    return st;
}

static cln_status layer(clblast *c, cl_uint number, cl_mem from, cl_mem to)
{
    cln_status st = CLN_OK;
    const size_t samples = (size_t)c->data->samples, leaves = (size_t)c->data->leaves;
    const cl_uint n = (cl_uint)samples, layers = L;
    const cl_float slope = PEER_SLOPE;
    const CLBlastStatusCode code = CLBlastSgemmStridedBatched(
        CLBlastLayoutRowMajor, CLBlastTransposeNo, CLBlastTransposeNo, samples, W, W, 1, from, 0, W,
        samples * W, c->w.mem, (size_t)number * PEER_CELLS, W, (size_t)L * PEER_CELLS, 0, to, 0, W,
        samples * W, leaves, &c->device->queue, NULL);

    if (code != CLBlastSuccess)
        CLN_TRY(cln_fail(CLN_CL, "CLBlast: GemmStridedBatched failed with code %d", (int)code));
    CLN_TRY(CLN_LAUNCH(c->device, c->activate, CLN_STAGE_OTHER, samples * leaves * 4 / 16, 16,
                       CLN_ARG(to), CLN_ARG(c->bias.mem), CLN_ARG(n), CLN_ARG(number),
                       CLN_ARG(layers), CLN_ARG(slope)));
done:
    return st;
}

static cln_status forward(void *own)
{
    cln_status st = CLN_OK;
    clblast *c = own;

    for (cl_uint i = 0; i < L; i++)
        CLN_TRY(layer(c, i, i ? c->h[(i + 1) % 2].mem : c->x.mem, c->h[i % 2].mem));
    CLN_TRY(cln_device_finish(c->device));
done:
    return st;
}

static cln_status fetch(void *own)
{
    const clblast *c = own;
    const size_t floats = (size_t)c->data->leaves * (size_t)c->data->samples * W;

    return cln_buffer_read(c->device, &c->h[(L - 1) % 2], 0, c->data->out, floats * sizeof(float));
}

const peer peer_clblast = {"CLBlast, batched", prepare, forward, NULL, fetch, release, false};
