/* Leaves, layers, bias and activation around a library's products. See peer.h. */
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "peer.h"

enum { W = PEER_WIDTH, L = PEER_LAYERS };

int peer_block(const peer_data *data, int most)
{
    int block = data->samples < most ? data->samples : most;

    while (data->samples % block)
        block--;
    return block;
}

/* Room of one thread: `blocks` blocks of samples. */
static float *scratch(const peer_products *p, int blocks)
{
    return aligned_alloc(64, (size_t)blocks * (size_t)p->block * W * sizeof(float));
}

static inline float activation(float z)
{
    return z > 0 ? z : PEER_SLOPE * z;
}

/* z = activation(z + bias) */
static void activate(int n, const float *restrict bias, float *restrict z)
{
    for (int s = 0; s < n; s++)
        for (int i = 0; i < W; i++)
            z[s * W + i] = activation(z[s * W + i] + bias[i]);
}

/* z += bias, h = activation(z) */
static void activate_to(int n, const float *restrict bias, float *restrict z, float *restrict h)
{
    for (int s = 0; s < n; s++)
        for (int i = 0; i < W; i++) {
            z[s * W + i] += bias[i];
            h[s * W + i] = activation(z[s * W + i]);
        }
}

/* d *= activation'(z) */
static void derive(int n, const float *restrict z, float *restrict d)
{
    for (int i = 0; i < n * W; i++)
        d[i] *= z[i] > 0 ? 1 : PEER_SLOPE;
}

static void forward_block(const peer_data *data, const peer_products *p, int leaf, int first,
                          float *room[2])
{
    const size_t at = ((size_t)leaf * (size_t)data->samples + (size_t)first) * W;
    const float *h = data->x + at;

    for (int i = 0; i < L; i++) {
        const size_t layer = (size_t)leaf * L + (size_t)i;
        const float *w = data->w + layer * PEER_CELLS, *bias = data->bias + layer * W;
        float *out = i == L - 1 ? data->out + at : room[i % 2];

        if (p->layer) {
            p->layer(p->own, h, w, bias, out);
        } else {
            p->multiply(p->own, h, w, out);
            activate(p->block, bias, out);
        }
        h = out;
    }
}

cln_status peer_cpu_forward(const peer_data *data, const peer_products *p)
{
    int failed = 0;

#pragma omp parallel num_threads(data->threads)
    {
        float *room = scratch(p, 2);
        float *two[2] = {room, room ? room + p->block * W : NULL};

        if (!room) {
#pragma omp atomic write
            failed = 1;
        }
#pragma omp for schedule(dynamic)
        for (int leaf = 0; leaf < data->leaves; leaf++)
            for (int first = 0; room && first < data->samples; first += p->block)
                forward_block(data, p, leaf, first, two);
        free(room);
    }
    return failed ? cln_fail(CLN_MEMORY, "peers: out of host memory") : CLN_OK;
}

/* room: z and h of every layer, and two of gradients. */
static void train_block(const peer_data *data, const peer_products *p, int leaf, int first,
                        float *room)
{
    const size_t size = (size_t)p->block * W;
    const size_t at = ((size_t)leaf * (size_t)data->samples + (size_t)first) * W;
    float *z = room, *h = room + L * size, *d = room + 2 * L * size, *next = d + size;

    for (int i = 0; i < L; i++) {
        const size_t layer = (size_t)leaf * L + (size_t)i;

        p->multiply(p->own, i ? h + (size_t)(i - 1) * size : data->x + at,
                    data->w + layer * PEER_CELLS, z + (size_t)i * size);
        activate_to(p->block, data->bias + layer * W, z + (size_t)i * size, h + (size_t)i * size);
    }
    memcpy(d, data->dout + at, size * sizeof *d);
    for (int i = L - 1; i >= 0; i--) {
        const size_t layer = (size_t)leaf * L + (size_t)i;
        float *done = d;

        derive(p->block, z + (size_t)i * size, d);
        p->accumulate(p->own, i ? h + (size_t)(i - 1) * size : data->x + at, d,
                      data->dw + layer * PEER_CELLS);
        if (i == 0) /* nobody asks for the input's gradient */
            break;
        p->multiply(p->own, d, data->wt + layer * PEER_CELLS, next);
        d = next;
        next = done;
    }
}

cln_status peer_cpu_train(const peer_data *data, const peer_products *p)
{
    const size_t cells = (size_t)L * PEER_CELLS;
    int failed = 0;

#pragma omp parallel num_threads(data->threads)
    {
        float *room = scratch(p, 2 * L + 2);

        if (!room) {
#pragma omp atomic write
            failed = 1;
        }
#pragma omp for schedule(dynamic)
        for (int leaf = 0; leaf < data->leaves; leaf++) {
            memset(data->dw + (size_t)leaf * cells, 0, cells * sizeof(float));
            for (int first = 0; room && first < data->samples; first += p->block)
                train_block(data, p, leaf, first, room);
        }
        free(room);
    }
    return failed ? cln_fail(CLN_MEMORY, "peers: out of host memory") : CLN_OK;
}
