/* The libraries that peer_gemm.c runs beside the leaf networks: eight layers of 64 x 64 with bias
 * and activation, every leaf with weights of its own. Each library has a file; cpu.c has what they
 * share around the products. Each is as fast as its library allows: a block's layers follow each
 * other while they are in cache, transposed weights are given. They need not compute the biases'
 * gradients.
 *
 * Training has two orders. A scene's: every sample goes forward before the first gradient is known,
 * as a pixel sums over several leaves, so that pre-activations are kept in memory. Block by block,
 * as if gradients were given: forward and back while a block is in cache, which no scene allows. */
#ifndef BENCH_PEER_H
#define BENCH_PEER_H

#include "device/device.h"

enum { PEER_LAYERS = 8, PEER_WIDTH = 64, PEER_CELLS = PEER_WIDTH * PEER_WIDTH };

/* Negative side of the activation, the mean of the settings' random slopes. */
#define PEER_SLOPE (-0.2f)

/* Host arrays that all peers read, and the two that they write. */
typedef struct peer_data {
    int leaves, samples, threads;
    const float *x;      /* [leaf][sample][64] */
    const float *w, *wt; /* [leaf][layer][64 in][64 out], and [64 out][64 in] */
    const float *bias;   /* [leaf][layer][64] */
    const float *dout;   /* [leaf][sample][64] gradient of the last layer's output */
    float *out;          /* [leaf][sample][64] */
    float *dw;           /* [leaf][layer][64 in][64 out] */
    /* [leaf][block][layer][sample of block][64]: pre-activations, in a scene's order */
    float *kept;
} peer_data;

typedef struct peer {
    const char *name;
    /* *own is the peer's; device: for those that run there. */
    cln_status (*prepare)(const peer_data *data, cln_device *device, void **own);
    cln_status (*forward)(void *own); /* data->out, if there is no fetch */
    /* forward, input and weight gradients, to data->dw; by way of data->kept, or block by block;
     * NULL if the peer has none */
    cln_status (*train)(void *own, bool kept);
    cln_status (*fetch)(void *own); /* what forward left elsewhere to data->out; NULL = nothing */
    void (*release)(void *own);     /* accepts NULL */
    bool host; /* on the host's cores: takes part beside a CPU device, which has the same ones */
} peer;

extern const peer peer_xsmm, peer_onednn, peer_openblas, peer_clblast;

/* ---- cpu.c: the layers around a library's products, OpenMP over leaves ---- */

/* Of a block of samples, by the calling thread; w is one layer's matrix. */
typedef struct peer_products {
    void *own;
    int block; /* samples; divides data->samples */
    void (*multiply)(void *own, const float *h, const float *w, float *z);    /* z = h w */
    void (*accumulate)(void *own, const float *h, const float *d, float *dw); /* dw += h^T d */
    /* h = activation(h w + bias) at once; NULL = apart */
    void (*layer)(void *own, const float *h, const float *w, const float *bias, float *out);
} peer_products;

/* Largest block up to `most` that divides the samples. */
int peer_block(const peer_data *data, int most);

cln_status peer_cpu_forward(const peer_data *data, const peer_products *products);
cln_status peer_cpu_train(const peer_data *data, const peer_products *products, bool kept);

#endif
