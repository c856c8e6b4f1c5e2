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

/* Scratch memory of one thread: `blocks` blocks of samples. */
static float *scratch(const peer_products *p, size_t blocks)
{
    return aligned_alloc(64, blocks * (size_t)p->block * W * sizeof(float));
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

/* h = activation(z), z with its bias */
static void restore(int n, const float *restrict z, float *restrict h)
{
    for (int i = 0; i < n * W; i++)
        h[i] = activation(z[i]);
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

/* A block's pre-activations and activations of layer i start at z + i * size and h + i * h_step;
 * with h_step 0 all layers share one place. */
typedef struct layers {
    float *z, *h;
    size_t size, h_step;
} layers;

static void train_forward(const peer_data *data, const peer_products *p, int leaf, const float *x,
                          layers to)
{
    for (int i = 0; i < L; i++) {
        const size_t layer = (size_t)leaf * L + (size_t)i;
        float *z = to.z + (size_t)i * to.size, *h = to.h + (size_t)i * to.h_step;

        p->multiply(p->own, i ? h - to.h_step : x, data->w + layer * PEER_CELLS, z);
        activate_to(p->block, data->bias + layer * W, z, h);
    }
}

/* d: gradients of a block's outputs; next: room for as many. Overwrites both. */
static void train_back(const peer_data *data, const peer_products *p, int leaf, const float *x,
                       layers from, float *d, float *next)
{
    for (int i = L - 1; i >= 0; i--) {
        const size_t layer = (size_t)leaf * L + (size_t)i;
        const float *z = from.z + (size_t)i * from.size;
        float *below = from.h + (size_t)i * from.h_step - from.h_step, *done = d;

        derive(p->block, z, d);
        if (i > 0 && from.h_step == 0)
            restore(p->block, z - from.size, below);
        p->accumulate(p->own, i ? below : x, d, data->dw + layer * PEER_CELLS);
        if (i == 0) /* the input's gradient is not needed */
            break;
        p->multiply(p->own, d, data->wt + layer * PEER_CELLS, next);
        d = next;
        next = done;
    }
}

/* One pass over a leaf's samples: forward, back, or both; room: as train_room gives it. */
enum { FORWARD = 1, BACK = 2 };

static size_t train_room(bool kept)
{
    return kept ? 3 : 2 * L + 2;
}

static void train_leaf(const peer_data *data, const peer_products *p, int leaf, int passes,
                       bool kept, float *room)
{
    const size_t size = (size_t)p->block * W;
    float *d = room, *next = room + size, *rest = room + 2 * size;

    for (int first = 0; first < data->samples; first += p->block) {
        const size_t at = ((size_t)leaf * (size_t)data->samples + (size_t)first) * W;
        const layers l = kept ? (layers){data->kept + at * L, rest, size, 0}
                              : (layers){rest, rest + L * size, size, size};

        if (passes & FORWARD)
            train_forward(data, p, leaf, data->x + at, l);
        if (!(passes & BACK))
            continue;
        memcpy(d, data->dout + at, size * sizeof *d);
        train_back(data, p, leaf, data->x + at, l, d, next);
    }
}

cln_status peer_cpu_train(const peer_data *data, const peer_products *p, bool kept)
{
    const size_t cells = (size_t)L * PEER_CELLS;
    int failed = 0;

#pragma omp parallel num_threads(data->threads)
    {
        float *room = scratch(p, train_room(kept));

        if (!room) {
#pragma omp atomic write
            failed = 1;
        }
        if (kept) {
#pragma omp for schedule(dynamic)
            for (int leaf = 0; leaf < data->leaves; leaf++)
                if (room)
                    train_leaf(data, p, leaf, FORWARD, kept, room);
        }
#pragma omp for schedule(dynamic)
        for (int leaf = 0; leaf < data->leaves; leaf++) {
            memset(data->dw + (size_t)leaf * cells, 0, cells * sizeof(float));
            if (room)
                train_leaf(data, p, leaf, kept ? BACK : FORWARD | BACK, kept, room);
        }
        free(room);
    }
    return failed ? cln_fail(CLN_MEMORY, "peers: out of host memory") : CLN_OK;
}
