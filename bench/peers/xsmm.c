/* libxsmm: small products compiled for their shape, threads over leaves. Its matrices are
 * column-major: a row-major [samples][64] is its 64 x samples. See peer.h. */
#include <libxsmm.h>
#include <stdlib.h>

#include "base/memory.h"
#include "peer.h"

enum { W = PEER_WIDTH, BLOCK = 96 };

typedef struct xsmm {
    const peer_data *data;
    peer_products products;
    libxsmm_smmfunction product, gradient;
} xsmm;

static void multiply(void *own, const float *h, const float *w, float *z)
{
    ((const xsmm *)own)->product(w, h, z);
}

static void accumulate(void *own, const float *h, const float *d, float *dw)
{
    ((const xsmm *)own)->gradient(d, h, dw);
}

static void release(void *own)
{
    free(own);
}

static cln_status prepare(const peer_data *data, cln_device *device, void **own)
{
    cln_status st = CLN_OK;
    xsmm *x = NULL;
    const int block = peer_block(data, BLOCK), plain = LIBXSMM_GEMM_FLAG_NONE;
    const int transposed = LIBXSMM_GEMM_FLAG_TRANS_B, prefetch = LIBXSMM_PREFETCH_NONE;
    const libxsmm_blasint ld = W;
    const float one = 1, zero = 0;

    (void)device;
    CLN_TRY(cln_alloc(&x, 1, sizeof *x, "libxsmm"));
    libxsmm_init();
    *x = (xsmm){data, {x, block, multiply, accumulate, NULL}, NULL, NULL};
    x->product = libxsmm_smmdispatch(W, block, W, &ld, &ld, &ld, &one, &zero, &plain, &prefetch);
    x->gradient =
        libxsmm_smmdispatch(W, W, block, &ld, &ld, &ld, &one, &one, &transposed, &prefetch);
    if (!x->product || !x->gradient)
        CLN_TRY(
            cln_fail(CLN_INTERNAL, "libxsmm: no kernel for %d x 64 x 64 on this processor", block));
    *own = x;
    x = NULL;
done:
    release(x);
    return st;
}

static cln_status forward(void *own)
{
    const xsmm *x = own;

    return peer_cpu_forward(x->data, &x->products);
}

static cln_status train(void *own, bool kept)
{
    const xsmm *x = own;

    return peer_cpu_train(x->data, &x->products, kept);
}

const peer peer_xsmm = {"libxsmm", prepare, forward, train, NULL, release, true};
