/* See lpips.h. Layer by layer for both pictures: each keeps what goes in and what comes out. */
#include "render/lpips.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "device/buffer.h"
#include "device/program.h"
#include "device/queue.h"
#include "io/safetensors.h"

/* NT and XV as in the kernels. */
enum { NT = 4, XV = 3, SLICES = 5, MOST_LAYERS = 13 };

/* A convolution, after a pool of `pool` pixels to two (0: none). Features are compared after the
 * last one of each slice. */
typedef struct layer {
    int slice, number; /* in the names of its weights */
    int outputs, size, stride, border, pool;
} layer;

typedef struct network {
    const char *name;
    int count, least;
    layer layers[MOST_LAYERS];
} network;

static const network networks[] = {
    {"alex",
     5,
     31,
     {{1, 0, 64, 11, 4, 2, 0},
      {2, 3, 192, 5, 1, 2, 3},
      {3, 6, 384, 3, 1, 1, 3},
      {4, 8, 256, 3, 1, 1, 0},
      {5, 10, 256, 3, 1, 1, 0}}},
    {"vgg",
     13,
     16,
     {{1, 0, 64, 3, 1, 1, 0},
      {1, 2, 64, 3, 1, 1, 0},
      {2, 5, 128, 3, 1, 1, 2},
      {2, 7, 128, 3, 1, 1, 0},
      {3, 10, 256, 3, 1, 1, 2},
      {3, 12, 256, 3, 1, 1, 0},
      {3, 14, 256, 3, 1, 1, 0},
      {4, 17, 512, 3, 1, 1, 2},
      {4, 19, 512, 3, 1, 1, 0},
      {4, 21, 512, 3, 1, 1, 0},
      {5, 24, 512, 3, 1, 1, 2},
      {5, 26, 512, 3, 1, 1, 0},
      {5, 28, 512, 3, 1, 1, 0}}},
};

struct cln_lpips {
    cln_device *device;
    const network *net;
    int vw, ls, wg; /* as in cln_tune */
    cln_program program;
    cl_kernel convolve, pool, compare;
    cln_buffer weights[MOST_LAYERS], biases[MOST_LAYERS], lins[SLICES];
    cln_buffer in[2], out[2], differences; /* [picture] */
};

/* [row][channel][column] with a border of zeros; a channel's line has `stride` parts. */
typedef struct features {
    int channels, width, height, border, stride;
    size_t row, line; /* floats */
} features;

static features features_of(int channels, int width, int height, int border, int stride)
{
    features p = {channels, width, height, border, stride, 0, 0};

    p.line = (size_t)stride * cln_groups((size_t)(width + 2 * border), (size_t)stride);
    p.row = p.line * (size_t)channels;
    return p;
}

static size_t floats_of(const features *p)
{
    return p->row * (size_t)(p->height + 2 * p->border);
}

/* With what vectors of the last line's parts read beyond it. */
static size_t bytes_of(const cln_lpips *l, const features *p)
{
    return (floats_of(p) + (size_t)(l->ls * XV * l->vw)) * sizeof(float);
}

/* ---- weights ---- */

static cln_status get(const cln_safetensors *file, const char *path, const char *name,
                      const int64_t shape[4], int dims, float **out)
{
    cln_status st = CLN_OK;
    cln_tensor tensor;
    size_t count = 1;

    *out = NULL;
    if (!cln_safetensors_has(file, name))
        return cln_fail(CLN_INPUT,
                        "%s: has no '%s'; --lpips takes the weights of lpips.LPIPS "
                        "with AlexNet or VGG-16 (man cl-nascent, LPIPS)",
                        path, name);
    CLN_TRY(cln_safetensors_get(file, name, CLN_DTYPE_F32, &tensor));
    for (int i = 0; i < dims; i++) {
        if (tensor.dims != dims || tensor.shape[i] != shape[i])
            CLN_TRY(cln_fail(CLN_INPUT, "%s: '%s' has another shape than in LPIPS's networks", path,
                             name));
        count *= (size_t)shape[i];
    }
    CLN_TRY(cln_alloc(out, count, sizeof **out, path));
    memcpy(*out, tensor.data, count * sizeof **out);
done:
    return st;
}

/* [n / NT][k][v][u][NT] of [n][k][v][u]. */
static void reorder(int outputs, size_t inner, const float *from, float *to)
{
    for (int n = 0; n < outputs; n++)
        for (size_t i = 0; i < inner; i++)
            to[((size_t)(n / NT) * inner + i) * NT + (size_t)(n % NT)] =
                from[(size_t)n * inner + i];
}

static cln_status put(cln_lpips *l, cln_buffer *buffer, const float *data, size_t count)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(l->device, buffer, count * sizeof *data, "LPIPS's weights"));
    CLN_TRY(cln_buffer_write(l->device, buffer, 0, data, count * sizeof *data));
done:
    return st;
}

static cln_status take_layer(cln_lpips *l, const cln_safetensors *file, const char *path, int i)
{
    cln_status st = CLN_OK;
    const layer *a = &l->net->layers[i];
    const int inputs = i ? l->net->layers[i - 1].outputs : 3;
    const size_t inner = (size_t)(inputs * a->size * a->size);
    float *weights = NULL, *ordered = NULL, *bias = NULL, *lin = NULL;
    char name[64];

    snprintf(name, sizeof name, "net.slice%d.%d.weight", a->slice, a->number);
    CLN_TRY(get(file, path, name, (const int64_t[4]){a->outputs, inputs, a->size, a->size}, 4,
                &weights));
    CLN_TRY(cln_alloc(&ordered, (size_t)a->outputs * inner, sizeof *ordered, path));
    reorder(a->outputs, inner, weights, ordered);
    CLN_TRY(put(l, &l->weights[i], ordered, (size_t)a->outputs * inner));
    snprintf(name, sizeof name, "net.slice%d.%d.bias", a->slice, a->number);
    CLN_TRY(get(file, path, name, (const int64_t[4]){a->outputs}, 1, &bias));
    CLN_TRY(put(l, &l->biases[i], bias, (size_t)a->outputs));
    /* each is in the state twice, of which files keep one */
    snprintf(name, sizeof name, "lin%d.model.1.weight", a->slice - 1);
    if (!cln_safetensors_has(file, name))
        snprintf(name, sizeof name, "lins.%d.model.1.weight", a->slice - 1);
    CLN_TRY(get(file, path, name, (const int64_t[4]){1, a->outputs, 1, 1}, 4, &lin));
    CLN_TRY(put(l, &l->lins[a->slice - 1], lin, (size_t)a->outputs));
done:
    free(weights);
    free(ordered);
    free(bias);
    free(lin);
    return st;
}

static cln_status build(cln_lpips *l)
{
    cln_status st = CLN_OK;
    const cln_tune *tune = &l->device->tune;
    char defines[64];

    l->vw = tune->vw;
    l->ls = tune->ls;
    l->wg = tune->wg;
    while ((size_t)l->ls > l->device->max_group)
        l->ls /= 2;
    while ((size_t)l->wg > l->device->max_group)
        l->wg /= 2;
    snprintf(defines, sizeof defines, "#define VW %d\n#define LS %d\n", l->vw, l->ls);
    CLN_TRY(cln_program_build(l->device, "lpips", defines, &l->program));
    CLN_TRY(cln_kernel_create(&l->program, "lpips_convolve", &l->convolve));
    CLN_TRY(cln_kernel_create(&l->program, "lpips_pool", &l->pool));
    CLN_TRY(cln_kernel_create(&l->program, "lpips_compare", &l->compare));
done:
    return st;
}

cln_status cln_lpips_open(cln_device *device, const char *path, cln_lpips **out)
{
    cln_status st = CLN_OK;
    cln_safetensors *file = NULL;
    cln_lpips *l = NULL;

    *out = NULL;
    CLN_TRY(cln_alloc(&l, 1, sizeof *l, "LPIPS"));
    l->device = device;
    CLN_TRY(cln_safetensors_read_foreign(path, &file));
    l->net = &networks[cln_safetensors_has(file, "net.slice1.2.weight")];
    for (int i = 0; i < l->net->count; i++)
        CLN_TRY(take_layer(l, file, path, i));
    CLN_TRY(build(l));
    *out = l;
    l = NULL;
done:
    cln_safetensors_free(file);
    cln_lpips_close(l);
    return st;
}

void cln_lpips_close(cln_lpips *l)
{
    if (!l)
        return;
    for (int i = 0; i < MOST_LAYERS; i++) {
        cln_buffer_free(l->device, &l->weights[i]);
        cln_buffer_free(l->device, &l->biases[i]);
    }
    for (int i = 0; i < SLICES; i++)
        cln_buffer_free(l->device, &l->lins[i]);
    for (int i = 0; i < 2; i++) {
        cln_buffer_free(l->device, &l->in[i]);
        cln_buffer_free(l->device, &l->out[i]);
    }
    cln_buffer_free(l->device, &l->differences);
    cln_kernel_free(&l->convolve);
    cln_kernel_free(&l->pool);
    cln_kernel_free(&l->compare);
    cln_program_free(&l->program);
    free(l);
}

const char *cln_lpips_network(const cln_lpips *l)
{
    return l->net->name;
}

int cln_lpips_least(const cln_lpips *l)
{
    return l->net->least;
}

/* ---- pictures ---- */

/* A picture's colours, -1 to 1, less the mean of ImageNet's and over their deviation. */
static cln_status put_picture(cln_lpips *l, const features *p, const uint8_t *kept,
                              const float *picture, cln_buffer *to)
{
    static const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
    cln_status st = CLN_OK;
    const size_t part = p->line / (size_t)p->stride, stride = (size_t)p->stride;
    float *values = NULL;

    CLN_TRY(cln_alloc(&values, floats_of(p), sizeof *values, "picture")); /* zeros */
    for (size_t c = 0; c < 3; c++)
        for (size_t y = 0; y < (size_t)p->height; y++)
            for (size_t x = 0; x < (size_t)p->width; x++) {
                const size_t i = y * (size_t)p->width + x, column = x + (size_t)p->border;
                const float value = kept && !kept[i] ? 0 : picture[3 * i + c];

                values[c * p->line + (y + (size_t)p->border) * p->row + column % stride * part +
                       column / stride] =
                    (float)((2 * (double)fminf(fmaxf(value, 0), 1) - 1 - shift[c]) / scale[c]);
            }
    CLN_TRY(cln_buffer_reserve(l->device, to, bytes_of(l, p), "LPIPS's features"));
    CLN_TRY(cln_buffer_write(l->device, to, 0, values, floats_of(p) * sizeof *values));
done:
    free(values);
    return st;
}

/* Makes room for features in l->out, with zeros where a border needs them. */
static cln_status make_room(cln_lpips *l, const features *p)
{
    cln_status st = CLN_OK;

    for (int i = 0; i < 2; i++) {
        CLN_TRY(cln_buffer_reserve(l->device, &l->out[i], bytes_of(l, p), "LPIPS's features"));
        if (p->border)
            CLN_TRY(cln_buffer_zero(l->device, &l->out[i], floats_of(p) * sizeof(float)));
    }
done:
    return st;
}

/* What came out goes in next. */
static void turn(cln_lpips *l)
{
    for (int i = 0; i < 2; i++) {
        const cln_buffer out = l->out[i];

        l->out[i] = l->in[i];
        l->in[i] = out;
    }
}

static cln_status pool(cln_lpips *l, int size, const features *from, const features *to)
{
    cln_status st = CLN_OK;
    const cl_uint channels = (cl_uint)to->channels, across = (cl_uint)size;
    const cl_uint row = (cl_uint)from->row, line = (cl_uint)from->line;
    const cl_uint width = (cl_uint)to->width, height = (cl_uint)to->height;
    const cl_uint out_row = (cl_uint)to->row, out_line = (cl_uint)to->line;
    const cl_uint border = (cl_uint)to->border;

    CLN_TRY(make_room(l, to));
    for (int i = 0; i < 2; i++)
        CLN_TRY(CLN_LAUNCH(l->device, l->pool, CLN_STAGE_OTHER,
                           cln_groups((size_t)channels * width * height, (size_t)l->wg),
                           (size_t)l->wg, CLN_ARG(l->in[i].mem), CLN_ARG(l->out[i].mem),
                           CLN_ARG(channels), CLN_ARG(across), CLN_ARG(row), CLN_ARG(line),
                           CLN_ARG(width), CLN_ARG(height), CLN_ARG(out_row), CLN_ARG(out_line),
                           CLN_ARG(border)));
    turn(l);
done:
    return st;
}

static cln_status convolve(cln_lpips *l, int number, const features *from, const features *to)
{
    cln_status st = CLN_OK;
    const layer *a = &l->net->layers[number];
    const cl_uint channels = (cl_uint)a->outputs, inputs = (cl_uint)from->channels;
    const cl_uint size = (cl_uint)a->size, stride = (cl_uint)a->stride;
    const cl_uint row = (cl_uint)from->row, line = (cl_uint)from->line;
    const cl_uint width = (cl_uint)to->width, height = (cl_uint)to->height;
    const cl_uint out_row = (cl_uint)to->row, out_line = (cl_uint)to->line;
    const cl_uint border = (cl_uint)to->border;
    const size_t tiles = cln_groups(width, (size_t)(l->ls * XV * l->vw));

    CLN_TRY(make_room(l, to));
    for (int i = 0; i < 2; i++)
        CLN_TRY(CLN_LAUNCH(l->device, l->convolve, CLN_STAGE_OTHER, channels / NT * tiles * height,
                           (size_t)l->ls, CLN_ARG(l->in[i].mem), CLN_ARG(l->weights[number].mem),
                           CLN_ARG(l->biases[number].mem), CLN_ARG(l->out[i].mem),
                           CLN_ARG(channels), CLN_ARG(inputs), CLN_ARG(size), CLN_ARG(stride),
                           CLN_ARG(row), CLN_ARG(line), CLN_ARG(width), CLN_ARG(height),
                           CLN_ARG(out_row), CLN_ARG(out_line), CLN_ARG(border)));
    turn(l);
done:
    return st;
}

/* The mean of a slice's differences over its pixels. */
static cln_status compare(cln_lpips *l, int slice, const features *p, double *mean)
{
    cln_status st = CLN_OK;
    const size_t pixels = (size_t)p->width * (size_t)p->height;
    const cl_uint channels = (cl_uint)p->channels, row = (cl_uint)p->row;
    const cl_uint line = (cl_uint)p->line, border = (cl_uint)p->border;
    const cl_uint width = (cl_uint)p->width, height = (cl_uint)p->height;
    float *values = NULL;

    CLN_TRY(cln_buffer_reserve(l->device, &l->differences, pixels * sizeof *values,
                               "LPIPS's differences"));
    CLN_TRY(cln_alloc(&values, pixels, sizeof *values, "LPIPS's differences"));
    CLN_TRY(CLN_LAUNCH(l->device, l->compare, CLN_STAGE_OTHER, cln_groups(pixels, (size_t)l->wg),
                       (size_t)l->wg, CLN_ARG(l->in[0].mem), CLN_ARG(l->in[1].mem),
                       CLN_ARG(l->lins[slice].mem), CLN_ARG(l->differences.mem), CLN_ARG(channels),
                       CLN_ARG(row), CLN_ARG(line), CLN_ARG(width), CLN_ARG(height),
                       CLN_ARG(border)));
    CLN_TRY(cln_buffer_read(l->device, &l->differences, 0, values, pixels * sizeof *values));
    *mean = 0;
    for (size_t i = 0; i < pixels; i++)
        *mean += (double)values[i] / (double)pixels;
done:
    free(values);
    return st;
}

cln_status cln_lpips_measure(cln_lpips *l, int width, int height, const uint8_t *kept,
                             const float *a, const float *b, double *distance)
{
    cln_status st = CLN_OK;
    const network *net = l->net;
    features from = features_of(3, width, height, net->layers[0].border, net->layers[0].stride);
    double mean = 0;

    *distance = 0;
    CLN_TRY(put_picture(l, &from, kept, a, &l->in[0]));
    CLN_TRY(put_picture(l, &from, kept, b, &l->in[1]));
    for (int i = 0; i < net->count; i++) {
        const layer *at = &net->layers[i], *next = i + 1 < net->count ? at + 1 : NULL;
        features to;

        if (at->pool) {
            to = features_of(from.channels, (from.width - at->pool) / 2 + 1,
                             (from.height - at->pool) / 2 + 1, at->border, 1);
            CLN_TRY(pool(l, at->pool, &from, &to));
            from = to;
        }
        to = features_of(at->outputs, (from.width + 2 * at->border - at->size) / at->stride + 1,
                         (from.height + 2 * at->border - at->size) / at->stride + 1,
                         next && !next->pool ? next->border : 0, 1);
        CLN_TRY(convolve(l, i, &from, &to));
        from = to;
        if (!next || next->slice != at->slice) {
            CLN_TRY(compare(l, at->slice - 1, &from, &mean));
            *distance += mean;
        }
    }
done:
    if (st == CLN_MEMORY)
        cln_note("keeping the features of a picture of %d x %d pixels (leave --lpips out, or take "
                 "AlexNet, which has fewer)",
                 width, height);
    return st;
}
