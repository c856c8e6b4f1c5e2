/* Creates and frees the pipeline, and builds its programs for one network and scene: a run's
 * constants are constants of the kernels, and code that the scene does not need is left out. */
#include "pipeline/pipeline.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "model/shell_tree.h"
#include "ranks/ranks.h"

/* Local memory of a work-group of mlp_backward, which needs the most: bytes per sample of a block
 * of NB. */
static size_t bytes_per_sample(const cln_network *net)
{
    const int view = net->view_dependence ? net->view_width : 0;

    return sizeof(float) *
           (size_t)(net->enc_pad + net->dir_pad + 3 * net->width + 2 * view + 4 + 3 + 6);
}

/* Bytes for the leaf's weights and gradients (tune.leaf). */
static size_t bytes_per_leaf(const cln_network *net)
{
    return sizeof(float) * (size_t)(net->params + cln_pipeline_transposed(net));
}

/* Local memory of a work-group of decoder_backward. */
static size_t decoder_local(const cln_network *net, const cln_tune *tune)
{
    const int in = net->features - 1 + CLN_DECODER_HARMONICS, lanes = tune->ls * tune->vw;
    const int sums = net->decoder_params * (tune->ls == 1 ? tune->vw : 1);

    return net->decoder ? sizeof(float) * (size_t)((in + net->decoder + 3) * lanes + sums) : 0;
}

/* Local memory of the largest work-group of scan.cl with 64-bit keys. SG = 1: places and counts of
 * digits, lines of output; else a tile and its ranks. */
static size_t sort_local(const cln_tune *tune, int line_bits)
{
    const size_t sg = (size_t)tune->sg, digits = (size_t)1 << tune->db;

    if (sg == 1)
        return digits * 8 + ((size_t)1 << line_bits) * 256;
    return digits * 8 + sg * (8 * (8 + 4) + 16 * 2 + 2 * 4);
}

/* Least common multiple of small numbers. */
static int common(int a, int b)
{
    int multiple = a;

    while (multiple % b)
        multiple += a;
    return multiple;
}

/* Lowers the work-items to a power of two, then work-items, lines and digits until they fit the
 * local memory. */
static void fit_sort(const cln_device *device, cln_tune *tune, int *line_bits)
{
    const size_t local = device->local_mem * 7 / 8;

    *line_bits = 10;
    while (tune->sg & (tune->sg - 1))
        tune->sg &= tune->sg - 1;
    while (tune->sg > 1 &&
           ((size_t)tune->sg > device->max_group || sort_local(tune, *line_bits) > local))
        tune->sg /= 2;
    if (tune->sg == 2) /* PoCL 3.1 for AVX-512 sorts wrong with two, and nothing has such groups */
        tune->sg = 1;
    while (*line_bits > 4 && sort_local(tune, *line_bits) > local)
        --*line_bits;
    while (tune->db > 4 && sort_local(tune, *line_bits) > local)
        tune->db--;
}

void cln_pipeline_fit(const cln_device *device, const cln_network *net, cln_tune *tune)
{
    const int view = net->view_dependence ? net->view_width : net->width;
    const int narrow = net->width < view ? net->width : view;
    const size_t local = device->local_mem * 7 / 8;
    int step = 0, bits = 0;

    while (tune->vw > narrow)
        tune->vw /= 2;
    while (tune->vw > 1 && (net->width % tune->vw || view % tune->vw))
        tune->vw--;
    while (tune->ls > 1 && ((size_t)tune->ls > device->max_group || tune->vw * tune->ls > narrow ||
                            net->width % (tune->vw * tune->ls) || view % (tune->vw * tune->ls)))
        tune->ls /= 2;
    while (tune->vw > 1 && decoder_local(net, tune) > local)
        tune->vw /= 2;
    while (tune->wg > 1 && (size_t)tune->wg > device->max_group)
        tune->wg /= 2;
    while (tune->nv > 1 && (net->width % (tune->vw * tune->nv * tune->ls) ||
                            view % (tune->vw * tune->nv * tune->ls)))
        tune->nv--;
    /* blocks are whole tiles and whole vectors */
    while (tune->ts > 1 && (size_t)common(tune->ts, tune->vw) * bytes_per_sample(net) > local)
        tune->ts--;
    step = common(tune->ts, tune->vw);
    tune->nb = tune->nb < step ? step : tune->nb / step * step;
    while (tune->nb > step && (size_t)tune->nb * bytes_per_sample(net) > local)
        tune->nb -= step;
    /* slices are an even number of blocks (kernels/group.cl) */
    tune->sl = tune->sl < 2 * tune->nb ? 2 * tune->nb : tune->sl / (2 * tune->nb) * 2 * tune->nb;
    if (!cln_leaf_kind_of(net->encoding)->network ||
        bytes_per_leaf(net) + (size_t)tune->nb * bytes_per_sample(net) > local)
        tune->leaf = 0;
    fit_sort(device, tune, &bits);
}

/* A text of fixed capacity; st: status of its allocation. */
typedef struct text {
    char *text;
    size_t used, capacity;
    cln_status st;
} text;

static void line(text *t, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void line(text *t, const char *fmt, ...)
{
    va_list args;

    if (t->st != CLN_OK || t->used + 512 > t->capacity)
        return;
    va_start(args, fmt);
    t->used += (size_t)cln_format_list(t->text + t->used, t->capacity - t->used, fmt, args);
    va_end(args);
    t->text[t->used++] = '\n';
    t->text[t->used] = 0;
}

/* Defines a float literal that reads back exactly. */
static void real(text *t, const char *name, double value)
{
    if (isinf(value))
        line(t, "#define %s (%sINFINITY)", name, value < 0 ? "-" : "");
    else
        line(t, "#define %s (%.9ef)", name, value);
}

/* Of a square that turns linear at delta (0, or in a shell space: never): 1 / delta^2, as far as
 * floats hold it: times the square of a difference of 0, infinity is no number. */
static double bend(const cln_pipeline *p, double delta)
{
    return delta > 0 && !p->space.shell ? fmin(1 / (delta * delta), 1e30) : 0;
}

cln_status cln_pipeline_defines(const cln_pipeline *p, char **out)
{
    const cln_config *c = &p->config;
    const cln_network *net = &p->net;
    text t = {.capacity = 8192};

    *out = NULL;
    t.st = cln_alloc(&t.text, t.capacity, 1, "kernel defines");
#define X(field, name, cpu, gpu, plain, min, max, meaning) \
    line(&t, "#define %s %d", name, p->tune.field);
    CLN_TUNE_LIST(X)
#undef X
    line(&t, "#define LINE_BITS %d", p->line_bits);
    line(&t, "#define WIDTH %d\n#define DEPTH %d\n#define BANDS %d\n#define ENC_PAD %d", net->width,
         net->depth, net->bands, net->enc_pad);
    line(&t, "#define SKIP (%d)", net->skip_layer);
    line(&t, "#define VIEW %d\n#define VIEW_BANDS %d\n#define DIR_PAD %d\n#define COLOUR %d",
         net->view_dependence ? net->view_width : 0, net->view_bands, net->dir_pad,
         net->colour_width);
    line(&t, "#define SIGMA_W %d\n#define SIGMA_B %d\n#define VIEW_W %d\n#define VIEW_B %d",
         net->sigma_w, net->sigma_b, net->view_w, net->view_b);
    line(&t, "#define COLOUR_W %d\n#define COLOUR_B %d\n#define PARAMS %d", net->colour_w,
         net->colour_b, net->params);
    line(&t, "#define ENCODING %d\n#define CELLS %d\n#define FEATURES %d\n#define GRID_W %d",
         net->encoding, net->cells, net->features, net->grid_w);
    if (net->encoding == CLN_ENCODING_VOXEL) {
        line(&t, "#define SMOOTH %d", c->smooth_density > 0 || c->smooth_colour > 0);
        real(&t, "SMOOTH_DENSITY", c->smooth_density);
        real(&t, "SMOOTH_COLOUR", c->smooth_colour);
        real(&t, "BEND_DENSITY", bend(p, c->smooth_density_delta));
        real(&t, "BEND_COLOUR", bend(p, c->smooth_colour_delta));
        real(&t, "DENSITY_RATE", c->density_rate);
    }
    line(&t, "#define DECODER %d", net->decoder);
    line(&t, "#define DENSITY %d", c->density);
    real(&t, "KAPPA", c->density_scale);
    real(&t, "BIAS", cln_network_density_bias(c));
    line(&t, "#define LEVELS %du", p->deepest + 1);
    real(&t, "SLOPE_LOWER", c->rrelu_lower);
    real(&t, "SLOPE_UPPER", c->rrelu_upper);
    line(&t, "#define RRELU %d\n#define BANDS_BY_LEVEL %d", c->rrelu_scope, c->bands_by_level);
    line(&t, "#define NOISE_ON %d", c->density_noise > 0);
    real(&t, "NOISE", c->density_noise);
    line(&t, "#define LENSES %u\n#define RAY_BACKGROUND %d", p->lenses, p->ray_background);
    if (p->space.forward) { /* else kernels/space.h has the defaults */
        line(&t, "#define NDC 1");
        real(&t, "NDC_X", p->space.scale[0]);
        real(&t, "NDC_Y", p->space.scale[1]);
    }
    if (p->space.shell)
        line(&t, "#define SHELL 1");
    if (c->near > 0 && !p->space.forward) {
        line(&t, "#define BEGINS 1");
        real(&t, "BEGIN", c->near);
    }
    line(&t, "#define DROPPED %d", c->splat_min_alpha > 0);
    line(&t, "#define STAGE1 %d\n#define ALLOCATE %d\n#define CDF %d\n#define PADDED %d", c->stage1,
         c->allocate, c->cdf, c->lists);
    line(&t, "#define LOSS %d\n#define ALPHA %d\n#define CAUCHY %d\n#define OPACITY %d", c->loss,
         p->opacity_loss > 0, c->cauchy > 0, c->opacity_entropy > 0);
    line(&t, "#define DISTORT %d\n#define DEPTH_LOSS %d", c->distortion_loss > 0,
         p->depth_loss > 0);
    line(&t, "#define AVERAGED %d\n#define MEASURES %d", p->averaged, cln_pipeline_measures(c));
    line(&t, "#define PART %d\n#define EACH %d", CLN_ADAM_PART, CLN_ADAM_EACH);
    real(&t, "BETA1", c->beta1);
    real(&t, "BETA2", c->beta2);
    real(&t, "EPSILON", c->epsilon);
    line(&t, "#define MOMENTUM %d", cln_first_moment_bytes(c) > 0);
    real(&t, "DECAY1", -log(c->beta1));
    real(&t, "DECAY2", -log(c->beta2));
    line(&t, "#define VIEW_L2 %d", c->view_l2 > 0 && net->view_dependence);
    real(&t, "VIEW_L2_WEIGHT", c->view_l2);
    line(&t, "#define MOMENTS %d", c->moments == CLN_MOMENTS_BFLOAT16);
    *out = t.text;
    return t.st;
}

/* Rows of one buffer of the device's largest allocation. */
static int rows_of(const cln_pipeline *p, double row_bytes)
{
    return (int)fmax(1, fmin((double)p->device->max_alloc / row_bytes, 1 << 24));
}

int cln_pipeline_part_leaves(const cln_pipeline *p)
{
    const double n1 = p->config.n1, weights = (double)sizeof(float) * p->net.params;

    if (p->parts > 1)
        return p->part_leaves;
    return rows_of(p, fmax(weights, n1 * n1 * n1 * sizeof(uint16_t)));
}

int cln_pipeline_part_slices(const cln_pipeline *p)
{
    return p->parts > 1 ? p->part_slices : rows_of(p, (double)sizeof(float) * p->net.params);
}

bool cln_pipeline_in_parts(const cln_pipeline *p, int leaves)
{
    const int room = cln_pipeline_part_leaves(p);

    return p->parts > 1 || leaves > (p->tune.leaf ? room : room / 2);
}

/* Lines that follow the pipeline's "#define" lines, and when programs and kernels are built
 * (kernel_list.h). */
enum text_kind { PLAIN, WIDE, PARTS, TRAIN, EVAL, CROP, TEXTS };
enum when {
    ALWAYS,
    NETWORK,
    VOXEL,
    DECODER,
    SPLATTING,
    REGULARISED,
    MEASURED,
    SERIAL,
    SHARED,
    HALO,
    AVERAGED
};

static const struct {
    const char *file;
    size_t at; /* in cln_pipeline */
    enum text_kind text;
    enum when when;
} programs[CLN_PROGRAMS] = {
#define X(member, file, text, when) {#file, offsetof(cln_pipeline, member), text, when},
    CLN_PROGRAM_LIST(X)
#undef X
};

static const struct {
    const char *name;
    size_t at;
    cln_program_id program;
    enum when when;
} kernels[] = {
#define X(member, kernel, program, when) \
    {#kernel, offsetof(cln_pipeline, k.member), CLN_PROGRAM_##program, when},
    CLN_KERNEL_LIST(X)
#undef X
};
enum { KERNELS = sizeof kernels / sizeof kernels[0] };

static bool is_true(const cln_pipeline *p, enum when when)
{
    switch (when) {
    case ALWAYS:
        return true;
    case NETWORK:
        return cln_leaf_kind_of(p->net.encoding)->network;
    case VOXEL:
        return p->net.encoding == CLN_ENCODING_VOXEL;
    case DECODER:
        return p->net.decoder > 0;
    case SPLATTING:
        return p->config.stage1 == CLN_STAGE1_SPLAT;
    case REGULARISED:
        return p->config.sparsity > 0 || p->config.edge > 0;
    case MEASURED:
        return cln_pipeline_measures(&p->config) > 0;
    case SERIAL:
        return p->tune.sg == 1;
    case SHARED:
        return p->ranks > 1;
    case HALO:
        return p->ranks > 1 && cln_leaf_kind_of(p->net.encoding)->joined;
    case AVERAGED:
        return p->averaged;
    }
    return false;
}

int cln_pipeline_rows(const cln_pipeline *p)
{
    return p->space.shell ? CLN_LINE_ROWS : 1;
}

double cln_pipeline_most_intervals(const cln_pipeline *p, int depth)
{
    return p->space.shell ? cln_shell_most_intervals(depth) : 3 * ldexp(1, depth);
}

static cln_program *program_of(cln_pipeline *p, int i)
{
    return (cln_program *)((char *)p + programs[i].at);
}

static cl_kernel *kernel_of(cln_pipeline *p, int i)
{
    return (cl_kernel *)((char *)p + kernels[i].at);
}

/* Frees the programs of a set. */
static void free_programs(cln_pipeline *p, uint32_t set)
{
    for (int i = 0; i < KERNELS; i++)
        if (set >> kernels[i].program & 1)
            cln_kernel_free(kernel_of(p, i));
    for (int i = 0; i < CLN_PROGRAMS; i++)
        if (set >> i & 1)
            cln_program_free(program_of(p, i));
}

/* Moves those of a set from one pipeline to another, which has none of them. */
static void move_programs(cln_pipeline *from, cln_pipeline *to, uint32_t set)
{
    for (int i = 0; i < CLN_PROGRAMS; i++)
        if (set >> i & 1) {
            *program_of(to, i) = *program_of(from, i);
            *program_of(from, i) = (cln_program){0};
        }
    for (int i = 0; i < KERNELS; i++)
        if (set >> kernels[i].program & 1) {
            *kernel_of(to, i) = *kernel_of(from, i);
            *kernel_of(from, i) = NULL;
        }
}

/* A kernel may take smaller groups than its device does, by its registers or local memory. Lowers
 * WG to what it takes. CLN_BUILD: its group is part of its text (LS, SG). */
static cln_status fit_kernel(cln_pipeline *p, cl_kernel kernel, const char *name)
{
    cln_status st = CLN_OK;
    const cl_device_id id = p->device->id;
    size_t most = 0, fixed[3] = {0};

    if (clGetKernelWorkGroupInfo(kernel, id, CL_KERNEL_WORK_GROUP_SIZE, sizeof most, &most, NULL) !=
            CL_SUCCESS ||
        most == 0)
        return CLN_OK; /* its launch will tell */
    clGetKernelWorkGroupInfo(kernel, id, CL_KERNEL_COMPILE_WORK_GROUP_SIZE, sizeof fixed, fixed,
                             NULL);
    if (fixed[0] > most)
        CLN_TRY(cln_fail(CLN_BUILD,
                         "kernel %s takes groups of at most %zu work-items there, not %zu", name,
                         most, fixed[0]));
    while (fixed[0] == 0 && (size_t)p->tune.wg > most)
        p->tune.wg /= 2;
done:
    return st;
}

/* Builds the programs and kernels that are needed and missing. */
static cln_status build(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    char *texts[TEXTS] = {NULL};

    CLN_TRY(cln_pipeline_defines(p, &texts[PLAIN]));
    CLN_TRY(cln_asprintf(&texts[WIDE], "%s#define KEY_BITS 64\n", texts[PLAIN]));
    CLN_TRY(cln_asprintf(&texts[PARTS],
                         "%s#define PARTS %d\n#define PART_LEAVES %du\n#define PART_SLICES %du\n",
                         texts[PLAIN], p->parts, p->part_leaves, p->part_slices));
    CLN_TRY(cln_asprintf(&texts[TRAIN], "%s#define TRAIN 1\n", texts[PARTS]));
    CLN_TRY(cln_asprintf(&texts[EVAL], "%s#define TRAIN 0\n", texts[PARTS]));
    CLN_TRY(cln_asprintf(&texts[CROP], "%s#define CROP 1\n", texts[PARTS]));
    for (int i = 0; i < CLN_PROGRAMS; i++)
        if (!program_of(p, i)->program && p->wanted >> i & 1 && is_true(p, programs[i].when))
            CLN_TRY(cln_program_build(p->device, programs[i].file, texts[programs[i].text],
                                      program_of(p, i)));
    for (int i = 0; i < KERNELS; i++) {
        const cln_program *program = program_of(p, (int)kernels[i].program);

        if (*kernel_of(p, i) || !program->program || !is_true(p, kernels[i].when))
            continue;
        CLN_TRY(cln_kernel_create(program, kernels[i].name, kernel_of(p, i)));
        CLN_TRY(fit_kernel(p, *kernel_of(p, i), kernels[i].name));
    }
done:
    for (int i = 0; i < TEXTS; i++)
        free(texts[i]);
    return st;
}

cln_status cln_pipeline_want(cln_pipeline *p, uint32_t wanted)
{
    cln_status st = CLN_OK;
    const uint32_t before = p->wanted;

    if ((before & wanted) == wanted)
        return CLN_OK;
    p->wanted |= wanted;
    st = build(p);
    if (st != CLN_OK)
        p->wanted = before;
    return st;
}

cln_status cln_pipeline_lenses(cln_pipeline *p, unsigned lenses)
{
    cln_status st = CLN_OK;
    const unsigned before = p->lenses;
    cln_pipeline old = {0};

    if ((before | lenses) == before)
        return CLN_OK;
    cln_debug("building kernels for another lens");
    p->lenses |= lenses;
    move_programs(p, &old, CLN_PROGRAMS_SEEING);
    st = build(p);
    if (st != CLN_OK) {
        p->lenses = before;
        free_programs(p, CLN_PROGRAMS_SEEING);
        move_programs(&old, p, CLN_PROGRAMS_SEEING);
    }
    free_programs(&old, CLN_PROGRAMS_SEEING);
    return st;
}

static void divide(cln_pipeline *p)
{
    p->part_leaves = cln_pipeline_part_leaves(p);
    p->part_slices = cln_pipeline_part_slices(p);
    p->parts = CLN_PARTS;
}

cln_status cln_pipeline_rebuild(cln_pipeline *p, int leaves)
{
    cln_status st = CLN_OK;
    const int room = cln_pipeline_part_leaves(p);

    if (leaves > CLN_PARTS * room)
        return cln_fail(CLN_MEMORY,
                        "%d leaves do not fit: %d buffers of the largest size that %s allows hold "
                        "%d; lower --start-level, --max-leaves, --n1 or the leaves' size "
                        "(--width, --grid-cells)",
                        leaves, CLN_PARTS, p->device->info.name, CLN_PARTS * room);
    if (p->parts > 1 || !cln_pipeline_in_parts(p, leaves))
        return CLN_OK;
    cln_debug("per-leaf arrays in parts of %d leaves: building kernels for that", room);
    divide(p);
    for (int i = 0; i < CLN_PROGRAMS; i++)
        if (programs[i].text >= PARTS)
            free_programs(p, 1u << i);
    CLN_TRY(build(p));
done:
    return st;
}

cln_status cln_pipeline_share(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    if (cln_ranks_count() == 1)
        return CLN_OK;
    p->ranks = cln_ranks_count();
    CLN_TRY(cln_alloc(&p->rank_first, (size_t)p->ranks + 1, sizeof *p->rank_first, "ranks"));
    CLN_TRY(build(p));
done:
    return st;
}

/* The deepest level that a tree may have: by the settings, or as deep as it is. */
static int deepest(const cln_config *config, const cln_pipeline_facts *facts)
{
    const int asked = cln_config_deepest(config) + facts->space->shell;
    const int most = facts->depth > asked ? facts->depth : asked;

    return most < CLN_MAX_LEVEL ? most : CLN_MAX_LEVEL;
}

static cln_status outline(cln_device *device, const cln_config *config,
                          const cln_pipeline_facts *facts, const cln_tune *tune, cln_pipeline *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    out->device = device;
    out->parts = out->part_leaves = out->part_slices = 1;
    out->max_counted = UINT32_MAX;
    out->config = *config;
    out->harmonic_rate = config->harmonic_rate;
    out->decoder_rate = config->decoder_rate;
    out->lenses = facts->lenses;
    out->space = *facts->space;
    out->deepest = deepest(config, facts);
    out->ray_background = config->random_background;
    out->averaged = cln_config_antialias(config) > 1;
    out->rays_per_pixel = 1;
    out->opacity_loss = facts->alpha ? config->alpha_loss : config->opaque_loss;
    out->depth_loss = facts->no_sights ? 0 : config->depth_loss;
    CLN_TRY(cln_network_layout(config, &out->net));
    out->tune = *tune;
    cln_pipeline_fit(device, &out->net, &out->tune);
    fit_sort(device, &out->tune, &out->line_bits);
    if (facts->in_parts)
        divide(out);
done:
    return st;
}

cln_status cln_pipeline_outline(cln_device *device, const cln_config *config,
                                const cln_pipeline_facts *facts, cln_pipeline *out)
{
    cln_status st = CLN_OK;
    cln_network net;
    cln_tune tune;
    char network[32], from[CLN_TUNE_FROM];

    CLN_TRY(cln_network_layout(config, &net));
    cln_network_text(&net, network);
    cln_device_tune(device, network, &tune, from);
    CLN_TRY(outline(device, config, facts, &tune, out));
done:
    return st;
}

/* *unfit: whether it failed because of the kernel parameters. */
static cln_status create(cln_device *device, const cln_config *config,
                         const cln_pipeline_facts *facts, uint32_t wanted, const cln_tune *tune,
                         cln_pipeline *out, bool *unfit)
{
    cln_status st = CLN_OK;

    *unfit = false;
    CLN_TRY(outline(device, config, facts, tune, out));
    out->wanted = wanted;
    if ((size_t)out->tune.nb * bytes_per_sample(&out->net) > device->local_mem) {
        *unfit = true;
        st = cln_fail(CLN_MEMORY,
                      "width %d with view width %d needs %zu bytes of local memory per sample, but "
                      "%s has %zu in all; lower --width or --view-width",
                      out->net.width, out->net.view_width, bytes_per_sample(&out->net),
                      device->info.name, device->local_mem);
        goto done;
    }
    CLN_TRY(build(out));
done:
    *unfit = *unfit || st == CLN_BUILD;
    if (st != CLN_OK)
        cln_pipeline_free(out);
    return st;
}

cln_status cln_pipeline_create(cln_device *device, const cln_config *config,
                               const cln_pipeline_facts *facts, uint32_t wanted, cln_pipeline *out)
{
    cln_status st = CLN_OK;
    cln_network net;
    cln_tune tune;
    bool unfit = false;
    char network[32], from[CLN_TUNE_FROM], list[CLN_TUNE_TEXT];

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_network_layout(config, &net));
    cln_network_text(&net, network);
    cln_device_tune(device, network, &tune, from);
    st = create(device, config, facts, wanted, &tune, out, &unfit);
    if (unfit && !device->tune_exact) {
        cln_tune_text(&tune, list);
        cln_warn("kernel parameters %s (%s) cannot be used for %s of %s: %s; plain ones are "
                 "used, which are slower",
                 list, from, cln_leaf_kind_of(config->encoding)->name, network, cln_error_text());
        cln_clear_error();
        cln_tune_plain(&tune);
        snprintf(from, sizeof from, "plain, because others could not be used");
        st = create(device, config, facts, wanted, &tune, out, &unfit);
    }
    CLN_TRY(st);
    snprintf(out->tune_from, sizeof out->tune_from, "%.400s%s%s", from,
             memcmp(&tune, &out->tune, sizeof tune) != 0 ? ", fitted to " : "",
             memcmp(&tune, &out->tune, sizeof tune) != 0 ? network : "");
done:
    return st;
}

void cln_pipeline_free(cln_pipeline *p)
{
    if (!p->device)
        return;
    clFinish(p->device->queue);
    cln_pipeline_release_all(p);
    free_programs(p, UINT32_MAX);
    free(p->host_pixels);
    free(p->host_cameras);
    free(p->rank_first);
    free(p->load);
    free(p->message);
    free(p->common.around);
    free(p->common.up);
    free(p->common.down);
    free(p->common.up_first);
    free(p->common.down_first);
    free(p->common.far);
    free(p->common.met);
    memset(p, 0, sizeof *p);
}
