/* cl-nascent: posed photos in, a scene that can be looked at from anywhere out, on any OpenCL device.
 * The library's public interface; everything the command line does, it does through this.
 *
 * Errors: functions return cln_status; cln_error_text() (per thread) has the sentence. Nothing here
 * prints or exits: log lines, progress and interruption go through the callbacks below. One run folder
 * is written by one process at a time. */
#ifndef CL_NASCENT_H
#define CL_NASCENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"
#include "base/config_rows.h"

#define CLN_VERSION "0.1.0"

/* Where the work runs. spec: NULL or "auto" (a GPU if there is one, else a CPU), "gpu", "cpu", a row
 * number of cln_devices_list, or part of a device, vendor or platform name; what is asked for and not
 * there is CLN_NO_DEVICE, never a silent substitute. */
typedef struct cln_device_desc {
    const char *spec;
    const char
        *kernel_dir; /* read kernels from here instead of the embedded ones; NULL = embedded */
    /* Kernel parameters, the first that there is of: tune ("VW=8,TS=6,...", over those of the device's
     * class), a row of tune_file that fits device and network, such a row of the program's own, those
     * of the class. NULL = none. */
    const char *tune;
    const char *tune_file; /* rows of the user, docs/formats.md "Tuning rows" */
    /* No buffer larger than this ("256M"), as if the device allowed no more: batches are cut to it, arrays of a row
     * per leaf split into up to four buffers; CLN_MEMORY beyond. NULL = the device's own. */
    const char *max_alloc;
} cln_device_desc;

typedef struct cln_device_info {
    char name[128], vendor[128], platform[128], driver[128], version[128];
    char type[16];                /* "cpu", "gpu", "accelerator" */
    double global_mem, max_alloc; /* bytes */
    int compute_units;
    char verdict[256]; /* "ok" or what is wrong; empty if not tested */
    /* The kernel parameters for the fast preset's networks, and where they come from; empty if the device
     * cannot be used, or was not asked. */
    char network[32], tune[256], tune_from[512];
} cln_device_info;

/* All OpenCL devices. desc: tune_file, and where kernels are; its spec is not looked at. NULL: only what
 * the loader tells of them. test: run the quick self-test on each. No device at all is CLN_NO_DEVICE with
 * what to install. The caller frees *out. */
cln_status cln_devices_list(const cln_device_desc *desc, bool test, cln_device_info **out,
                            int *count);

/* Numbers of a running training, for a progress display. */
typedef struct cln_train_progress {
    int64_t step, steps; /* steps 0: the budget is time */
    double fraction;     /* of the budget, 0..1 */
    double seconds, eta; /* training seconds so far, and to go */
    double rays_per_s, samples_per_ray;
    double loss, psnr_train, psnr_test; /* psnr_test NaN before the first evaluation */
    int leaves;
    double params, device_bytes;
} cln_train_progress;

typedef struct cln_callbacks {
    void (*train)(const cln_train_progress *progress,
                  void *user); /* about every step; may be NULL */
    void (*work)(const char *what, int done, int total, void *user); /* eval, render; may be NULL */
    /* Polled every step / ray batch: 0 = go on, SIGINT or SIGTERM = write a checkpoint and return
     * CLN_SIGINT / CLN_SIGTERM, SIGUSR1 = write a checkpoint and go on. May be NULL. */
    int (*interrupted)(void *user);
    void *user;
} cln_callbacks;

typedef struct cln_train_desc {
    const char *scene; /* NULL with resume: the run's own */
    const char *run;
    const char *preset; /* for the record: "fast", "paper", "nerf", "kilonerf" */
    bool resume;
    bool skip_selftest;
    cln_config
        config; /* with resume: what the run should now have; the network's shape must agree */
    cln_device_desc device;
    const char *command; /* command line, for run.json; may be NULL */
    /* The integer program of each structure decision goes to this file, in LP format, over the one
     * before; NULL = nowhere. */
    const char *dump_program;
    cln_callbacks callbacks;
} cln_train_desc;

typedef struct cln_train_result {
    int64_t step;
    double seconds; /* training seconds, evaluation not counted */
    double psnr_train, psnr_test;
    int leaves;
    double device_peak, host_peak; /* most bytes of device buffers, and of the process */
    uint64_t digest;               /* model_digest */
} cln_train_result;

/* Trains until a budget is used up. Leaves RUN/ as docs/formats.md says. *result is filled as far as it
 * went, also when interrupted. */
cln_status cln_train(const cln_train_desc *desc, cln_train_result *result);

/* The settings (and scene path, if scene is not NULL; the caller frees it) of an existing run. */
cln_status cln_run_config(const char *run, cln_config *config, char **scene);

typedef struct cln_eval_image {
    char *name;
    int width, height;
    double psnr, psnr_u8, ssim, mse, seconds;
} cln_eval_image;

typedef struct cln_eval_result {
    int count;
    cln_eval_image *images;
    double psnr, psnr_u8, ssim, mse, psnr_of_mean_mse, seconds; /* means over images */
    int64_t step;
    double train_seconds;
    uint64_t digest;
    float background[3];
    char split[8];
} cln_eval_result;

typedef struct cln_eval_desc {
    const char *run;
    const char *scene; /* NULL = the one it was trained on */
    const char *split; /* "train", "val", "test" */
    int max_images;    /* evenly chosen; 0 = all */
    bool save_images;  /* renders, truths, errors and pictures of the tree under RUN/eval/ */
    cln_device_desc device;
    cln_callbacks callbacks;
} cln_eval_desc;

/* Per-image and mean PSNR and SSIM; writes RUN/eval/STEP-SPLIT.json and the report. */
cln_status cln_eval(const cln_eval_desc *desc, cln_eval_result *result);
/* The text of that file (docs/formats.md); the caller frees it. */
cln_status cln_eval_json(const cln_eval_result *result, char **json);
void cln_eval_free(cln_eval_result *result);

typedef struct cln_render_desc {
    const char *run, *out;
    const char *scene; /* NULL = the one it was trained on */
    const char *split; /* the poses of a split, or NULL for an orbit */
    int orbit_frames;
    double orbit_elevation; /* degrees above the horizon of the training cameras' up axis */
    double orbit_radius;    /* in units of the mean training camera distance */
    int width, height;      /* orbit: image size; 0 = as the training images */
    double fov;             /* orbit: horizontal, degrees; 0 = as the training images */
    int max_images;         /* split: evenly chosen; 0 = all */
    bool overwrite;         /* else frames whose files are there are skipped */
    bool z_depth;           /* depth along the optical axis; else along the ray */
    cln_device_desc device;
    cln_callbacks callbacks;
} cln_render_desc;

typedef struct cln_render_result {
    int rendered, skipped;
    double seconds;
} cln_render_result;

/* OUT/NAME.png (colour), NAME.depth.npy (float32, scene units), NAME.depth.png (to look at),
 * NAME.opacity.png; names as the dataset's, or orbit_0000. */
cln_status cln_render(const cln_render_desc *desc, cln_render_result *result);

typedef struct cln_export_desc {
    const char *run;
    const char *what;   /* "octree": the active leaves as boxes, a PLY file */
    const char *file;   /* the file to write */
    const char *colour; /* octree: "level" or "error"; NULL = "level" */
    bool overwrite;     /* else a file that is there is CLN_OUTPUT */
} cln_export_desc;

typedef struct cln_export_result {
    int64_t step;
    int leaves, levels[CLN_LEVELS]; /* active leaves, and how many of each level */
} cln_export_result;

/* What the newest checkpoint holds, in the scene's coordinates, as a file for other programs
 * (docs/formats.md). Needs no device. CLN_USAGE for an unknown `what`. */
cln_status cln_export(const cln_export_desc *desc, cln_export_result *result);

/* JSON text (the caller frees it) about a scene or a run. */
cln_status cln_info_scene(const char *scene, const cln_config *config, char **json);
cln_status cln_info_run(const char *run, char **json);

/* ---- tuning ---- */

/* A set of kernel parameters that the tuner tried. */
typedef struct cln_tune_try {
    char tune[256];
    enum { CLN_SET_REFUSED, CLN_SET_SLOWER, CLN_SET_TAKEN, CLN_SET_UNDECIDED } verdict;
    char reason[512];        /* why it was refused */
    double seconds, against; /* of a step, and of the best set before it at the same time; NaN */
} cln_tune_try;

typedef struct cln_tune_desc {
    cln_device_desc device; /* tune: where the search begins; NULL = those of the device's class */
    cln_config config;      /* whose networks, sampling and batch */
    double budget;          /* seconds */
    int max_tries;          /* most sets tried; 0 = as many as the budget allows */
    const char *file;       /* the row goes here, over one for the same; NULL = nowhere */
    cln_callbacks callbacks;
} cln_tune_desc;

typedef struct cln_tune_result {
    cln_device_info device;
    char network[32], tune[256]; /* what for, and the best set */
    char row[1024];              /* the same as a line of a file of rows */
    double seconds;              /* of a step with it */
    double gain;                 /* over the set the search began with: its seconds / these */
    int rays, samples, leaves;   /* of the step that was timed */
    bool complete;               /* the search ended by itself, not by the budget */
    cln_tune_try *tries;         /* in order; the first that was taken is where it began */
    int count;
} cln_tune_result;

/* Looks for the kernel parameters that make a training step fastest on a device. A set is timed only after
 * it has passed the self-test's checks with these very networks. CLN_CHECK if not even the plain ones do. */
cln_status cln_tune_search(const cln_tune_desc *desc, cln_tune_result *result);
void cln_tune_free(cln_tune_result *result);

typedef void cln_check_sink(const char *name, bool passed, bool skipped, const char *detail,
                            void *user);

/* Kernels against the float64 reference on one device, small shapes; CLN_CHECK if any fails. quick:
 * about a second. */
cln_status cln_selftest(const cln_device_desc *device, bool quick, cln_check_sink *sink,
                        void *user);

#endif
