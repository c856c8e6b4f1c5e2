/* A leaf network on one sample, forward and backward (method.md 1), in the packed layout of
 * model/network.h. A negative-side slope r is taken literally: x <= 0 gives r x, also for r < 0.
 * See reference.h. */
#include <math.h>
#include <string.h>
#include "reference/reference.h"

enum { MAX_DEPTH = 8, MAX_WIDTH = 256, MAX_ENC = 64, MAX_DIR = 28 };

/* Clamps of the exponential density: its value stays finite in float32; its derivative is bounded
 * as in nerfacc and instant-ngp. */
static const double exp_value_max = 70, exp_gradient_max = 15;

/* Results of a forward pass: pre-activations x, activations h, heads. */
typedef struct pass {
    double enc[MAX_ENC], dir[MAX_DIR];
    double x[MAX_DEPTH][MAX_WIDTH], h[MAX_DEPTH][MAX_WIDTH];
    double view_x[MAX_WIDTH], view_h[MAX_WIDTH];
    double s, sigma, colour[3];
} pass;

/* Weights as float32 or, for a trainer in double, as double: one of the two. */
typedef struct weights {
    const float *narrow;
    const double *wide;
} weights;

static weights weights_of(const ref_network *r, const float *params)
{
    return r->wide ? (weights){NULL, r->wide} : (weights){params, NULL};
}

static weights from(weights w, int offset)
{
    return w.wide ? (weights){NULL, w.wide + offset} : (weights){w.narrow + offset, NULL};
}

static double at(weights w, int i)
{
    return w.wide ? w.wide[i] : (double)w.narrow[i];
}

/* Slope of one element: trunk layers first, the view layer is number `depth`. */
static double slope_of(const cln_network *net, const double *slopes, double slope, int layer, int n)
{
    return slopes ? slopes[layer * net->width + n] : slope;
}

/* x[n] += sum_k in[k] w[k][n] */
static void multiply(const double *in, int rows, weights w, int columns, double *x)
{
    for (int k = 0; k < rows; k++) {
        for (int n = 0; n < columns; n++)
            x[n] += in[k] * at(w, k * columns + n);
    }
}

/* dw[k][n] += in[k] d[n];  din[k] += sum_n d[n] w[k][n] (din may be NULL) */
static void multiply_back(const double *in, int rows, weights w, int columns, const double *d,
                          double *dw, double *din)
{
    for (int k = 0; k < rows; k++) {
        for (int n = 0; n < columns; n++) {
            dw[k * columns + n] += in[k] * d[n];
            if (din)
                din[k] += d[n] * at(w, k * columns + n);
        }
    }
}

static double softplus(double z)
{
    return fmax(z, 0) + log1p(exp(-fabs(z)));
}

static double sigmoid(double z)
{
    return z >= 0 ? 1 / (1 + exp(-z)) : exp(z) / (1 + exp(z));
}

static double density(const ref_network *r, double s)
{
    double z = s + r->bias;

    switch (r->density) {
    case CLN_DENSITY_RELU:
        return r->kappa * fmax(z, 0);
    case CLN_DENSITY_EXP:
        return r->kappa * exp(fmin(z, exp_value_max));
    default:
        return r->kappa * softplus(z);
    }
}

static double density_gradient(const ref_network *r, double s)
{
    double z = s + r->bias;

    switch (r->density) {
    case CLN_DENSITY_RELU:
        return z > 0 ? r->kappa : 0;
    case CLN_DENSITY_EXP:
        return r->kappa * exp(fmin(z, exp_gradient_max));
    default:
        return r->kappa * sigmoid(z);
    }
}

static void run_forward(const ref_network *r, weights p, const double local[3], const double dir[3],
                        const double *slopes, double slope, pass *f)
{
    const cln_network *net = &r->net;
    int w = net->width;
    const double *last = f->h[net->depth - 1], *head = last;

    if (net->encoding == CLN_ENCODING_VOXEL) {
        double raw[4];

        ref_voxel(r, p.narrow, local, dir, raw);
        f->s = raw[3];
        f->sigma = density(r, f->s);
        for (int c = 0; c < 3; c++)
            f->colour[c] = sigmoid(raw[c]);
        return;
    }
    if (net->features > 0)
        ref_grid(net->cells, net->features, p.narrow + net->grid_w, local, f->enc);
    else
        ref_encode(net->bands, local, r->level_bands, net->enc_pad, f->enc);
    for (int i = 0; i < net->depth; i++) {
        const weights own = from(p, net->trunk_w[i]);

        for (int n = 0; n < w; n++)
            f->x[i][n] = at(p, net->trunk_b[i] + n);
        if (i == 0)
            multiply(f->enc, net->enc_pad, own, w, f->x[i]);
        else
            multiply(f->h[i - 1], w, own, w, f->x[i]);
        if (i == net->skip_layer)
            multiply(f->enc, net->enc_pad, from(own, w * w), w, f->x[i]);
        for (int n = 0; n < w; n++)
            f->h[i][n] = f->x[i][n] * (f->x[i][n] > 0 ? 1 : slope_of(net, slopes, slope, i, n));
    }
    f->s = at(p, net->sigma_b);
    for (int n = 0; n < w; n++)
        f->s += last[n] * at(p, net->sigma_w + n);
    f->sigma = density(r, f->s);
    if (net->view_dependence) {
        int v = net->view_width;

        ref_encode(net->view_bands, dir, NULL, net->dir_pad, f->dir);
        for (int n = 0; n < v; n++)
            f->view_x[n] = at(p, net->view_b + n);
        multiply(last, w, from(p, net->view_w), v, f->view_x);
        multiply(f->dir, net->dir_pad, from(p, net->view_w + w * v), v, f->view_x);
        for (int n = 0; n < v; n++)
            f->view_h[n] =
                f->view_x[n] * (f->view_x[n] > 0 ? 1 : slope_of(net, slopes, slope, net->depth, n));
        head = f->view_h;
    }
    for (int c = 0; c < 3; c++) {
        double raw = at(p, net->colour_b + c);

        for (int n = 0; n < net->colour_width; n++)
            raw += head[n] * at(p, net->colour_w + c * net->colour_width + n);
        f->colour[c] = sigmoid(raw);
    }
}

void ref_forward(const ref_network *r, const float *params, const double local[3],
                 const double dir[3], const double *slopes, double slope, double out[4])
{
    pass f;

    run_forward(r, weights_of(r, params), local, dir, slopes, slope, &f);
    for (int c = 0; c < 3; c++)
        out[c] = f.colour[c];
    out[3] = f.sigma;
}

double ref_margin(const ref_network *r, const float *params, const double local[3],
                  const double dir[3], const double *slopes, double slope)
{
    const cln_network *net = &r->net;
    double margin = INFINITY;
    pass f;

    if (net->encoding == CLN_ENCODING_VOXEL)
        return ref_decoder_margin(r, params, local, dir);
    run_forward(r, weights_of(r, params), local, dir, slopes, slope, &f);
    for (int i = 0; i < net->depth; i++)
        for (int n = 0; n < net->width; n++)
            margin = fmin(margin, fabs(f.x[i][n]));
    for (int n = 0; n < net->view_width; n++)
        margin = fmin(margin, fabs(f.view_x[n]));
    return margin;
}

double ref_colour_slope(double colour, double gradient)
{
    const double slope = colour * (1 - colour);

    return (gradient > 0) == (colour > 0.5) ? fmax(slope, REF_SLOPE_LEAST) : slope;
}

/* d[n] *= act'(x[n]) */
static void activation_back(const cln_network *net, const double *slopes, double slope, int layer,
                            int width, const double *x, double *d)
{
    for (int n = 0; n < width; n++)
        d[n] *= x[n] > 0 ? 1 : slope_of(net, slopes, slope, layer, n);
}

void ref_backward(const ref_network *r, const float *params, const double local[3],
                  const double dir[3], const double *slopes, double slope, const double dout[4],
                  double *grad)
{
    const cln_network *net = &r->net;
    const weights p = weights_of(r, params);
    int w = net->width, v = net->view_width, cw = net->colour_width;
    double d[MAX_WIDTH] = {0}, dview[MAX_WIDTH] = {0}, denc[MAX_ENC] = {0}, ds = 0;
    double *dhead = net->view_dependence ? dview : d;
    const double *last = NULL, *head = NULL;
    pass f;

    run_forward(r, p, local, dir, slopes, slope, &f);
    if (net->encoding == CLN_ENCODING_VOXEL) {
        double draw[4] = {[3] = dout[3] * density_gradient(r, f.s)};

        for (int c = 0; c < 3; c++)
            draw[c] = dout[c] * ref_colour_slope(f.colour[c], dout[c]);
        ref_voxel_backward(r, p.narrow, local, dir, draw, grad);
        return;
    }
    last = f.h[net->depth - 1];
    head = net->view_dependence ? f.view_h : last;
    for (int c = 0; c < 3; c++) {
        double draw = dout[c] * ref_colour_slope(f.colour[c], dout[c]);

        grad[net->colour_b + c] += draw;
        multiply_back(&draw, 1, from(p, net->colour_w + c * cw), cw, head,
                      grad + net->colour_w + c * cw, NULL);
        for (int n = 0; n < cw; n++)
            dhead[n] += draw * at(p, net->colour_w + c * cw + n);
    }
    if (net->view_dependence) {
        activation_back(net, slopes, slope, net->depth, v, f.view_x, dview);
        for (int n = 0; n < v; n++)
            grad[net->view_b + n] += dview[n];
        multiply_back(last, w, from(p, net->view_w), v, dview, grad + net->view_w, d);
        multiply_back(f.dir, net->dir_pad, from(p, net->view_w + w * v), v, dview,
                      grad + net->view_w + w * v, NULL);
    }
    ds = dout[3] * density_gradient(r, f.s);
    grad[net->sigma_b] += ds;
    for (int n = 0; n < w; n++) {
        grad[net->sigma_w + n] += ds * last[n];
        d[n] += ds * at(p, net->sigma_w + n);
    }
    for (int i = net->depth - 1; i >= 0; i--) {
        const weights own = from(p, net->trunk_w[i]);
        double *dw = grad + net->trunk_w[i], below[MAX_WIDTH] = {0};

        activation_back(net, slopes, slope, i, w, f.x[i], d);
        for (int n = 0; n < w; n++)
            grad[net->trunk_b[i] + n] += d[n];
        if (i == net->skip_layer)
            multiply_back(f.enc, net->enc_pad, from(own, w * w), w, d, dw + w * w, NULL);
        if (i == 0)
            multiply_back(f.enc, net->enc_pad, own, w, d, dw, denc);
        else
            multiply_back(f.h[i - 1], w, own, w, d, dw, below);
        memcpy(d, below, sizeof below);
    }
    if (net->features > 0)
        ref_grid_backward(net->cells, net->features, local, denc, grad + net->grid_w);
}
