/* The pipeline: one struct that owns the programs of kernel_list.h and the buffers of
 * buffer_list.h. This header has the struct and its transfers. A file of this room calls only files
 * below it:
 *
 *   room                  what of a tree and of photos memory has room for
 *   plan                  the memory plan, before anything is allocated
 *   field                 a trained field at points
 *   carry                 a change of the tree on the device
 *   networks, sampling    the stages (stages.h)
 *   transfer              tree, weights, cameras and batches, in and out
 *   halo                  vertices of voxels that leaves of several ranks have
 *   stretch               a step's rays shared by ranks
 *   share                 what ranks tell each other
 *   stage1_methods        the table of stage-1 methods (stage1.h)
 *   splat                 one of them
 *   sort                  scan and sort
 *   regularise            points of regularisers
 *   turns                 how far loops go, for the self-test: no part of a pipeline
 *   programs              creates, builds, frees; fits tuning parameters to a network
 *   buffers               reserves, fills and releases */
#ifndef CLN_PIPELINE_H
#define CLN_PIPELINE_H

#include "device/program.h"
#include "device/queue.h"
#include "model/model.h"
#include "pipeline/buffer_list.h"
#include "pipeline/kernel_list.h"
#include "scene/scene.h"

typedef enum cln_program_id {
#define X(member, file, text, when) CLN_PROGRAM_##member,
    CLN_PROGRAM_LIST(X)
#undef X
        CLN_PROGRAMS
} cln_program_id;

/* Sets of programs: bits of cln_program_id. All: what training needs. Pictures need no gradients
 * and do not change the tree; a crop (cln_sampling) needs sampling_crop, too. */
#define CLN_PROGRAM_BIT(member) (1u << CLN_PROGRAM_##member)
#define CLN_PROGRAMS_ALL        (CLN_PROGRAM_BIT(halo) * 2u - 1u)
#define CLN_PROGRAMS_PICTURES                                                      \
    (CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(sort64) | CLN_PROGRAM_BIT(rays) |     \
     CLN_PROGRAM_BIT(sampling) | CLN_PROGRAM_BIT(splat) | CLN_PROGRAM_BIT(group) | \
     CLN_PROGRAM_BIT(mlp_density) | CLN_PROGRAM_BIT(mlp_forward_eval) |            \
     CLN_PROGRAM_BIT(voxel_eval) | CLN_PROGRAM_BIT(composite) | CLN_PROGRAM_BIT(share))

/* Those with the code of lenses (kernels/lens.h). */
#define CLN_PROGRAMS_SEEING \
    (CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(splat) | CLN_PROGRAM_BIT(stats))

/* Numbers that ranks exchange once in a training step, beside the sums of stretches (share.h):
 * every rank gets the largest of each. First come those that must be equal on all ranks, each with
 * either sign, then a rank's samples, then the trainer's. */
enum {
    CLN_TOLD_SAMPLES,
    CLN_TOLD_STRETCHES = 2,
    CLN_TOLD_OWN = 4, /* samples of a rank */
    CLN_TOLD_CLOCK,
    CLN_TOLD_SAVE,
    CLN_TOLD_SIGNAL,
    CLN_TOLD
};

/* What a pipeline's kernels are built for, besides its settings. */
typedef struct cln_pipeline_facts {
    unsigned lenses;        /* of its cameras (cln_camera_lenses) */
    bool alpha;             /* its images have it; without it, alpha counts as 1 (opaque_loss) */
    bool no_sights;         /* no ray shows a sparse point, so there is no depth_loss */
    int depth;              /* of its tree (cln_octree_depth), which may exceed the settings' */
    bool in_parts;          /* begin with arrays P in parts, as they were (cln_model.in_parts) */
    const cln_space *space; /* of its cube; cameras must be given in the same */
} cln_pipeline_facts;

/* Common vertices of this rank and others (halo.h); empty without other ranks, or of networks.
 * Links as kernels/halo.cl has them, those of each other rank adjacent, in the same order there. */
typedef struct cln_common {
    bool there;                    /* up to date with tree and rank_first */
    int32_t (*around)[CLN_AROUND]; /* [leaf] neighbours of all leaves */
    cl_uint4 *up, *down;           /* [link] owner there; owner here */
    int *up_first, *down_first;    /* [ranks + 1] */
    int far_leaves;                /* of other ranks, in `down` */
    cl_uint *far, *met;            /* [leaf]; [far leaf][met_of(p)]: what came in a step */
    double bytes; /* that this rank sent so far: in steps, at changes of the tree */
} cln_common;

struct cln_pipeline {
    cln_device *device;
    cln_config config;
    double opacity_loss;  /* config.alpha_loss, or opaque_loss where images have no alpha */
    double depth_loss;    /* config.depth_loss, or 0 where no ray shows a sparse point */
    double harmonic_rate; /* of the next update: config.harmonic_rate, or less (train/step.h) */
    double decoder_rate;  /* likewise config.decoder_rate, or less */
    bool decodes;         /* the decoder was updated: before, it adds 0 and is left out */
    cln_network net;
    cln_tune tune; /* chosen for the network, fitted to its shape and the local memory */
    char tune_from[CLN_TUNE_FROM]; /* its source, as a phrase */
    int line_bits;       /* widest digit of a sort that writes whole lines (scan.cl, SG = 1) */
    uint32_t wanted;     /* programs to build, if settings and device need them */
    unsigned lenses;     /* lenses whose code is built in (cln_camera_lenses) */
    cln_space space;     /* space of its cube; kernels are built for this space */
    bool ray_background; /* one background per ray (random_background) */
    bool averaged;       /* in training pixels may be the mean of several rays (config.antialias) */
    double rays_per_pixel; /* of the newest batch, on the mean */
    /* Arrays P have a row per leaf (grads: per slice). Each is one buffer; if one of them would
     * exceed the device's largest allocation, each becomes CLN_PARTS buffers of part_leaves (or
     * part_slices) rows (kernels/leaves.h). */
    int parts, part_leaves, part_slices;

#define X(member, file, text, when) cln_program member;
    CLN_PROGRAM_LIST(X)
#undef X
    struct {
#define X(member, kernel, program, when) cl_kernel member;
        CLN_KERNEL_LIST(X)
#undef X
    } k;
#define X(member, ...)    cln_buffer member;
#define PAIR(member, ...) cln_buffer member[2];
    CLN_BUFFER_LIST(X, PAIR)
#undef X
#undef PAIR

    int deepest;                    /* level that its tree may have */
    int leaves, depth;              /* of the uploaded tree */
    uint32_t leaf_levels;           /* bit l: it has leaves of level l */
    int most_intervals;             /* of a ray with its leaves */
    int decoder_groups;             /* of slices, in the last backward pass */
    int first, own;                 /* leaves whose weights are here: all, unless shared by ranks */
    int view_count, training_views; /* the first ones are for training */
    int max_rays;                   /* of a batch (memory plan); 0 = any number */
    size_t max_samples;             /* likewise */
    uint32_t sample_total;          /* of the newest batch, once cln_stage_sample has returned */

    int seen_first, seen_end; /* leaves whose cells in p->seen are marked */
    cln_common common;

    /* Shared by ranks (share.h): number of ranks, 0 or 1 if not shared; each one's first leaf; work
     * on leaves in training, in which recent steps count most; room for messages. */
    int ranks, *rank_first; /* [ranks + 1] */
    double *load;           /* [leaf]: of this rank's leaves at least */
    int most_own; /* leaves that a rank may get by a move: the least of all ranks (plan.h) */
    bool leaf_rank_there;  /* p->leaf_rank is up to date with rank_first */
    bool stretched;        /* the batch has only samples of this rank's leaves (stretch.h) */
    uint32_t samples_here; /* samples that are here; if stretched, also stretches */
    uint32_t stretch_total, interval_total; /* of the newest batch; interval_total: see walk.h */
    /* Samples since the start: this rank's, the busiest rank's of each batch, all. */
    double samples_own, samples_busiest, samples_all;
    double stretches_own, stretches_all; /* likewise */
    double intervals_all;                /* of steps by stretches */
    double told[CLN_TOLD];
    char *message;
    size_t message_bytes;

    /* Splatting: most projected samples at a time (memory plan), the largest number of them that a
     * kernel counts, number in the last batch, and host copies for planning it. */
    size_t max_entries;
    uint64_t max_counted;
    int64_t splat_entries;
    bool splat_short;       /* it was said that lists have fewer samples than --splat-per-ray */
    cln_pixel *host_pixels; /* [ray] */
    int host_rays, batch_view_count, list_total;
    int antialias;          /* n: n x n rays for a picture's pixel at an edge (0 or 1: one) */
    const float (*crop)[4]; /* of pictures: cln_sampling's; the caller's */
    /* [view], then, with antialias > 1, [view] of n times as many pixels a side */
    cln_device_camera *host_cameras;
};

/* A camera's position, in the cube's coordinates or, in a forward space, in camera units: its rays
 * may begin elsewhere (device_abi.h). */
void cln_device_camera_origin(const cln_device_camera *c, double origin[3]);

/* Builds the programs for this network and scene; no buffers yet. wanted: bits of cln_program_id;
 * of these, the programs that settings and device need are built. Kernel parameters come from
 * cln_device_tune; if programs cannot be built with them, plain ones are used, with a warning (not
 * if device->tune_exact). CLN_BUILD, CLN_MEMORY, CLN_CL. */
cln_status cln_pipeline_create(cln_device *device, const cln_config *config,
                               const cln_pipeline_facts *facts, uint32_t wanted, cln_pipeline *out);
/* The same without programs, for plans: only device, settings, network and parameters. Needs no
 * freeing. */
cln_status cln_pipeline_outline(cln_device *device, const cln_config *config,
                                const cln_pipeline_facts *facts, cln_pipeline *out);
/* Shares the pipeline with the other ranks (share.h), if there are any: builds the kernels for
 * that. Call it before the memory plan. */
cln_status cln_pipeline_share(cln_pipeline *p);
void cln_pipeline_free(cln_pipeline *p); /* accepts a zeroed one */

/* An array P as an argument of a kernel. */
#define CLN_LEAF_ARG(p, array) CLN_LEAF_ARG_OF(p, &(p)->array)
#define CLN_LEAF_ARG_OF(p, buffer)                 \
    {                                              \
        sizeof(cl_mem), (buffer)->part, (p)->parts \
    }

/* Rows of a part, for leaves and for gradients: as many as the device's largest allocation holds,
 * at least 1. */
int cln_pipeline_part_leaves(const cln_pipeline *p);
int cln_pipeline_part_slices(const cln_pipeline *p);

/* Returns whether so many leaves need parts. Without tune.leaf, gradients need them before weights:
 * a leaf has a gradient per slice. */
bool cln_pipeline_in_parts(const cln_pipeline *p, int leaves);

/* Builds these programs, too, if they are not there: bits of cln_program_id. CLN_BUILD, CLN_CL. */
cln_status cln_pipeline_want(cln_pipeline *p, uint32_t wanted);

/* Builds the programs for these lenses, too (cln_camera_lenses), if they are not; after a failure,
 * those that there were remain. CLN_BUILD, CLN_CL. */
cln_status cln_pipeline_lenses(cln_pipeline *p, unsigned lenses);

/* Splits the arrays P once `leaves` leaves need it, and builds the programs that read them again;
 * else does nothing. Call it before cln_pipeline_upload or cln_pipeline_carry of a new or grown
 * tree: they refuse leaves that need parts (CLN_INTERNAL). CLN_MEMORY if CLN_PARTS parts do not
 * hold the leaves. */
cln_status cln_pipeline_rebuild(cln_pipeline *p, int leaves);

/* Lowers vectors, tiles and blocks until they divide this network and fit the device's groups and
 * local memory. */
void cln_pipeline_fit(const cln_device *device, const cln_network *net, cln_tune *tune);

/* Writes the "#define" lines of this pipeline's programs (programs.c); the caller frees *text. */
cln_status cln_pipeline_defines(const cln_pipeline *p, char **text);

/* Measures per sample of a training step: 0, 1 or CLN_MEASURES. */
int cln_pipeline_measures(const cln_config *config);

/* Rows of ray_o and ray_d per ray; the most intervals of a ray, in any tree of this depth. */
int cln_pipeline_rows(const cln_pipeline *p);
double cln_pipeline_most_intervals(const cln_pipeline *p, int depth);

/* Rays and samples that the regularisers of points add to a batch (cln_stage_regularise). */
int cln_pipeline_extra_rays(const cln_pipeline *p);
int cln_pipeline_extra_samples(const cln_pipeline *p);

/* A work-group of the adam kernel updates so many weights per leaf, of so many leaves. */
enum { CLN_ADAM_PART = 1024, CLN_ADAM_EACH = 16 };

/* Bytes of the pre-activations kept per sample, 2 each with tune.half, else 4 (voxels with a
 * decoder keep features, always 4 each); transposed weights per leaf. */
size_t cln_pipeline_act_bytes(const cln_network *net, const cln_tune *tune);
int cln_pipeline_transposed(const cln_network *net);

/* Gradients that an update holds at a time, for so many samples and slices; with tune.leaf only
 * those of slices that share a leaf (kernels/mlp_backward.cl). */
double cln_pipeline_gradients(const cln_tune *tune, double samples, double slices);

/* Uploads a tree alone: boxes, map, room for runs and slices of its leaves. The caller fills the
 * arrays P. CLN_INTERNAL if cln_pipeline_rebuild is missing. */
cln_status cln_pipeline_tree(cln_pipeline *p, const cln_octree *tree);
/* Uploads the neighbours of leaves, which training of voxels needs; nothing for networks. */
cln_status cln_pipeline_around(cln_pipeline *p, const cln_octree *tree);
/* Makes what training derives from leaves and weights: room for norms, transposed weights. */
cln_status cln_pipeline_derive(cln_pipeline *p);

/* Uploads tree and weights, densities if the model has them, the training state if `training`.
 * Download: weights, and the training state if `training`, into the model's arrays, allocated if
 * missing. Reads back. A change of the tree needs neither (carry.h). */
cln_status cln_pipeline_upload(cln_pipeline *p, const cln_model *model, bool training);
cln_status cln_pipeline_download(cln_pipeline *p, cln_model *model, bool training);
/* Downloads likewise, but each of several ranks gets only its own leaves' weights and Adam's
 * state. */
cln_status cln_pipeline_download_own(cln_pipeline *p, cln_model *model, bool training);
/* Adds, after that, what the other ranks have. */
void cln_pipeline_collect(cln_pipeline *p, cln_model *model, bool training);

/* Uploads the cameras of `count` views, brought to normalised space, and with p->antialias > 1
 * those of their finer pictures. */
cln_status cln_pipeline_cameras(cln_pipeline *p, const cln_camera *const *cameras, int count,
                                const cln_space *space);

/* The same for all views of a scene, in its order; the training views come first. */
cln_status cln_pipeline_scene(cln_pipeline *p, const cln_scene *scene, const cln_space *space);

/* Uploads a batch: pixels (spot: CLN_SPOT, or if the stage-1 method is by_view, the index of the
 * view in the batch; rays are then ordered by that, then y), targets ([n][4] in training, else
 * NULL) and backgrounds ([1][4] or [n][4]). Does not wait: the arrays must stay until
 * cln_stage_sample has returned. */
cln_status cln_pipeline_batch(cln_pipeline *p, const cln_pixel *pixels, int n, const float *targets,
                              const float *backgrounds);

/* Uploads the points that a batch's rays show: [n][4], in the cube, each with its weight (0: no
 * point is known). Only with a depth loss. Like cln_pipeline_batch, it does not wait. */
cln_status cln_pipeline_shown(cln_pipeline *p, const float *shown, int n);

/* Points: uploads points instead of rays, each as the origin of its ray; origins and directions
 * [n][4], targets [n][4] or NULL. Samples: uploads samples on these rays, at t = 0. */
cln_status cln_pipeline_points(cln_pipeline *p, const float *origins, const float *directions,
                               const float *targets, uint32_t rays);
cln_status cln_pipeline_samples(cln_pipeline *p, const cln_sample *samples, uint32_t n);

#endif
