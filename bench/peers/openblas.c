/* OpenBLAS: sgemm by one thread, threads over leaves. See peer.h. */
#include <cblas.h>
#include <stdlib.h>

#include "base/memory.h"
#include "peer.h"

enum { W = PEER_WIDTH, BLOCK = 384 };

typedef struct openblas {
    const peer_data *data;
    peer_products products;
} openblas;

static void multiply(void *own, const float *h, const float *w, float *z)
{
    const openblas *o = own;

    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, o->products.block, W, W, 1, h, W, w, W,
                0, z, W);
}

static void accumulate(void *own, const float *h, const float *d, float *dw)
{
    const openblas *o = own;

    cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, W, W, o->products.block, 1, h, W, d, W, 1,
                dw, W);
}

static cln_status prepare(const peer_data *data, cln_device *device, void **own)
{
    cln_status st = CLN_OK;
    openblas *o = NULL;

    (void)device;
    CLN_TRY(cln_alloc(&o, 1, sizeof *o, "OpenBLAS"));
    openblas_set_num_threads(1);
    *o = (openblas){data, {o, peer_block(data, BLOCK), multiply, accumulate, NULL}};
    *own = o;
done:
    return st;
}

static cln_status forward(void *own)
{
    const openblas *o = own;

    return peer_cpu_forward(o->data, &o->products);
}

static cln_status train(void *own, bool kept)
{
    const openblas *o = own;

    return peer_cpu_train(o->data, &o->products, kept);
}

const peer peer_openblas = {"OpenBLAS", prepare, forward, train, NULL, free, true};
