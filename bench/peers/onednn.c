/* oneDNN: single-threaded matmul primitives, fused with bias and activation where the sums are not
 * needed; threads over leaves. See peer.h. */
#include <oneapi/dnnl/dnnl.h>
#include <omp.h>
#include <stdlib.h>

#include "base/memory.h"
#include "peer.h"

enum { W = PEER_WIDTH, BLOCK = 96, MAX_THREADS = 64 };

typedef struct product {
    dnnl_primitive_t primitive;
    dnnl_memory_t from, weights, bias, to;
} product;

typedef struct thread {
    dnnl_stream_t stream;
    product layer, plain, gradient;
} thread;

typedef struct onednn {
    const peer_data *data;
    peer_products products;
    dnnl_engine_t engine;
    thread threads[MAX_THREADS];
} onednn;

/* row, column: strides in floats. */
static dnnl_status_t matrix(dnnl_memory_desc_t *out, int rows, int columns, int row, int column)
{
    const dnnl_dims_t dims = {rows, columns}, strides = {row, column};

    return dnnl_memory_desc_init_by_strides(out, 2, dims, dnnl_f32, strides);
}

/* [rows][inner] x [inner][64]; layer: with bias and activation, else added to the output. */
static dnnl_status_t make(dnnl_engine_t engine, int rows, int inner, bool transposed, bool layer,
                          bool add, product *p)
{
    dnnl_memory_desc_t from, weights, bias, to;
    dnnl_matmul_desc_t matmul;
    dnnl_primitive_desc_t description = NULL;
    dnnl_primitive_attr_t attributes = NULL;
    dnnl_post_ops_t after = NULL;
    dnnl_status_t st = dnnl_success;

    st |= matrix(&from, rows, inner, transposed ? 1 : W, transposed ? W : 1);
    st |= matrix(&weights, inner, W, W, 1);
    st |= matrix(&bias, 1, W, W, 1);
    st |= matrix(&to, rows, W, W, 1);
    st |= dnnl_matmul_desc_init(&matmul, &from, &weights, layer ? &bias : NULL, &to);
    st |= dnnl_primitive_attr_create(&attributes);
    st |= dnnl_post_ops_create(&after);
    if (layer)
        st |= dnnl_post_ops_append_eltwise(after, 1, dnnl_eltwise_relu, PEER_SLOPE, 0);
    if (add)
        st |= dnnl_post_ops_append_sum(after, 1);
    st |= dnnl_primitive_attr_set_post_ops(attributes, after);
    if (st == dnnl_success)
        st = dnnl_primitive_desc_create(&description, &matmul, attributes, engine, NULL);
    if (st == dnnl_success)
        st = dnnl_primitive_create(&p->primitive, description);
    st |= dnnl_memory_create(&p->from, &from, engine, DNNL_MEMORY_NONE);
    st |= dnnl_memory_create(&p->weights, &weights, engine, DNNL_MEMORY_NONE);
    st |= dnnl_memory_create(&p->to, &to, engine, DNNL_MEMORY_NONE);
    if (layer)
        st |= dnnl_memory_create(&p->bias, &bias, engine, DNNL_MEMORY_NONE);
    dnnl_post_ops_destroy(after);
    dnnl_primitive_attr_destroy(attributes);
    dnnl_primitive_desc_destroy(description);
    return st;
}

static void execute(product *p, dnnl_stream_t stream, const float *from, const float *weights,
                    const float *bias, float *to)
{
    const dnnl_exec_arg_t args[] = {{DNNL_ARG_SRC, p->from},
                                    {DNNL_ARG_WEIGHTS, p->weights},
                                    {DNNL_ARG_DST, p->to},
                                    {DNNL_ARG_BIAS, p->bias}};

    dnnl_memory_set_data_handle(p->from, (void *)from);
    dnnl_memory_set_data_handle(p->weights, (void *)weights);
    dnnl_memory_set_data_handle(p->to, to);
    if (bias)
        dnnl_memory_set_data_handle(p->bias, (void *)bias);
    dnnl_primitive_execute(p->primitive, stream, bias ? 4 : 3, args);
}

static thread *own_thread(void *own)
{
    return &((onednn *)own)->threads[omp_get_thread_num()];
}

static void layer(void *own, const float *h, const float *w, const float *bias, float *out)
{
    thread *t = own_thread(own);

    execute(&t->layer, t->stream, h, w, bias, out);
}

static void multiply(void *own, const float *h, const float *w, float *z)
{
    thread *t = own_thread(own);

    execute(&t->plain, t->stream, h, w, NULL, z);
}

static void accumulate(void *own, const float *h, const float *d, float *dw)
{
    thread *t = own_thread(own);

    execute(&t->gradient, t->stream, h, d, NULL, dw);
}

static void free_product(product *p)
{
    dnnl_memory_destroy(p->from);
    dnnl_memory_destroy(p->weights);
    dnnl_memory_destroy(p->bias);
    dnnl_memory_destroy(p->to);
    dnnl_primitive_destroy(p->primitive);
}

static void release(void *own)
{
    onednn *o = own;

    if (!o)
        return;
    for (int i = 0; i < MAX_THREADS; i++) {
        free_product(&o->threads[i].layer);
        free_product(&o->threads[i].plain);
        free_product(&o->threads[i].gradient);
        dnnl_stream_destroy(o->threads[i].stream);
    }
    dnnl_engine_destroy(o->engine);
    free(o);
}

static cln_status prepare(const peer_data *data, cln_device *device, void **own)
{
    cln_status st = CLN_OK;
    onednn *o = NULL;
    const int block = peer_block(data, BLOCK);
    int failed = 0;

    (void)device;
    if (data->threads > MAX_THREADS)
        return cln_fail(CLN_USAGE, "oneDNN: %d threads are too many; use at most %d", data->threads,
                        MAX_THREADS);
    CLN_TRY(cln_alloc(&o, 1, sizeof *o, "oneDNN"));
    o->data = data;
    o->products = (peer_products){o, block, multiply, accumulate, layer};
    failed = dnnl_engine_create(&o->engine, dnnl_cpu, 0) != dnnl_success;
    /* a primitive keeps its creation's thread count: one, inside a parallel region */
#pragma omp parallel num_threads(data->threads) reduction(|| : failed)
    {
        thread *t = own_thread(o);
        dnnl_status_t made = dnnl_stream_create(&t->stream, o->engine, dnnl_stream_in_order);

        made |= make(o->engine, block, W, false, true, false, &t->layer);
        made |= make(o->engine, block, W, false, false, false, &t->plain);
        made |= make(o->engine, W, block, true, false, true, &t->gradient);
        failed = failed || made != dnnl_success;
    }
    if (failed)
        CLN_TRY(cln_fail(CLN_INTERNAL, "oneDNN: a matmul primitive cannot be made"));
    *own = o;
    o = NULL;
done:
    release(o);
    return st;
}

static cln_status forward(void *own)
{
    const onednn *o = own;

    return peer_cpu_forward(o->data, &o->products);
}

static cln_status train(void *own, bool kept)
{
    const onednn *o = own;

    return peer_cpu_train(o->data, &o->products, kept);
}

const peer peer_onednn = {"oneDNN", prepare, forward, train, NULL, release, true};
