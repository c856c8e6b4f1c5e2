/* cl-nascent: posed photos in, a scene that can be looked at from anywhere out, on any OpenCL
 * device. The library's one public header; everything the command line does, it does through this.
 * How the parts go together, with examples: docs/api.md.
 *
 * Errors: functions return cln_status; cln_error_text() (per thread) has the sentence. Nothing here
 * prints or exits: log lines go to cln_log_to's sink, progress and interruption through callbacks.
 * Texts that a function hands out (char **) are freed with free(). Strings are UTF-8; descs and
 * what they point to stay the caller's and need only live during the call. One run folder is
 * written by one process at a time: cln_train holds RUN/lock, and CLN_OUTPUT names who does. */
#ifndef CL_NASCENT_H
#define CL_NASCENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CLN_VERSION "0.1.0"

/* What the shared library exports. */
#define CLN_API __attribute__((visibility("default")))

/* CLN_VERSION of the library that is linked. */
CLN_API const char *cln_version(void);

/* ---- errors ---- */

/* X(name, exit code of the command line, phrase). Codes and order never change; new ones come
 * last. */
#define CLN_STATUS_LIST(X)                                 \
    X(OK, 0, "ok")                                         \
    X(FAILED, 1, "failed")                                 \
    X(INTERNAL, 1, "internal error")                       \
    X(USAGE, 2, "wrong usage")                             \
    X(INPUT, 3, "input data unreadable or invalid")        \
    X(NO_DEVICE, 4, "no usable OpenCL device")             \
    X(CL, 4, "OpenCL call failed")                         \
    X(BUILD, 4, "kernel does not build")                   \
    X(MEMORY, 5, "out of memory")                          \
    X(DIVERGED, 6, "training diverged")                    \
    X(OUTPUT, 7, "cannot write output")                    \
    X(CHECKPOINT, 8, "checkpoint corrupt or incompatible") \
    X(THRESHOLD, 9, "quality threshold not met")           \
    X(CHECK, 10, "self-test failed")                       \
    X(SIGINT, 130, "interrupted")                          \
    X(SIGTERM, 143, "terminated")
typedef enum cln_status {
#define X(name, code, phrase) CLN_##name,
    CLN_STATUS_LIST(X)
#undef X
} cln_status;

/* Exit code and fixed phrase of a status. */
CLN_API int cln_status_exit_code(cln_status st);
CLN_API const char *cln_status_phrase(cln_status st);

/* This thread's standing error: its sentence ("" if none), its status, and forgetting it. The first
 * failure wins until it is forgotten: call cln_clear_error when one has been dealt with. The text
 * lives until the next failure or cln_clear_error of this thread. */
CLN_API const char *cln_error_text(void);
CLN_API cln_status cln_error_status(void);
CLN_API void cln_clear_error(void);

/* ---- log ---- */

typedef enum cln_log_level {
    CLN_LOG_ERROR,
    CLN_LOG_WARN, /* changes a result; the line begins with "warning: " */
    CLN_LOG_INFO, /* what a training says of itself */
    CLN_LOG_DEBUG
} cln_log_level;

/* One finished line, without newline; called on the thread that works. */
typedef void cln_log_sink(cln_log_level level, const char *line, void *user);

/* Lines up to level `most` go to sink; NULL = nowhere, as before the first call. For the whole
 * process: call it while no other function of this header runs. */
CLN_API void cln_log_to(cln_log_level most, cln_log_sink *sink, void *user);

/* ---- settings ---- */

/* Every hyperparameter and run option, set and read by name and text, so that a new one changes
 * nothing here. Names are the options of `cl-nascent train --help` without dashes ("rays",
 * "view-width"), earlier names included; switches take "yes" and "no". One thread at a time. */
typedef struct cln_settings cln_settings;

/* preset: "fast", "paper", "nerf", "kilonerf"; NULL = "fast". CLN_USAGE for another. */
CLN_API cln_status cln_settings_create(const char *preset, cln_settings **out);
/* Those of an existing run, to resume it with. */
CLN_API cln_status cln_settings_of_run(const char *run, cln_settings **out);
CLN_API void cln_settings_free(cln_settings *settings); /* accepts NULL */

/* CLN_USAGE names what is wrong and what is legal; the settings are then as before. Times may have
 * a unit ("90s", "10m"), sizes, too ("512M"); of a run's settings, steps, epochs and time-limit
 * take "+N". */
CLN_API cln_status cln_settings_set(cln_settings *settings, const char *name, const char *value);
/* The value as text that set takes back exactly; bytes: of the buffer, CLN_SETTING_BYTES always
 * do. */
enum { CLN_SETTING_BYTES = 128 };
CLN_API cln_status cln_settings_get(const cln_settings *settings, const char *name, char *value,
                                    size_t bytes);
/* Whether all values go together; cln_train and cln_tune_search check that, too. CLN_USAGE. */
CLN_API cln_status cln_settings_check(const cln_settings *settings);

typedef struct cln_setting_info {
    const char *name, *alias; /* alias: an earlier name, or NULL */
    const char *group;        /* "network", "tree", "sampling", "optim", "run" */
    const char *help;
    const char *type;  /* "int", "real", "switch", "word", "text" */
    const char *words; /* word: "a|b|c"; else NULL */
    double min, max;   /* int, real */
} cln_setting_info;

/* All settings: *info of number `index`, 0 ...; false behind the last one. The texts live
 * forever. */
CLN_API bool cln_setting_describe(int index, cln_setting_info *info);

/* ---- devices ---- */

/* Where the work runs. spec: NULL or "auto" (a GPU if there is one, else a CPU), "gpu", "cpu", a
 * row number of cln_devices_list, or part of a device, vendor or platform name; what is asked for
 * and not there is CLN_NO_DEVICE, never a silent substitute. */
typedef struct cln_device_desc {
    const char *spec;
    const char
        *kernel_dir; /* read kernels from here instead of the embedded ones; NULL = embedded */
    /* Kernel parameters, the first that there is of: tune ("VW=8,TS=6,...", over those of the
     * device's class), a row of tune_file that fits device and network, such a row of the program's
     * own, those of the class. NULL = none. */
    const char *tune;
    const char *tune_file; /* rows of the user, docs/formats.md "Tuning rows" */
    /* No buffer larger than this ("256M"), as if the device allowed no more: batches are cut to it,
     * arrays of a row per leaf split into up to four buffers; CLN_MEMORY beyond. NULL = the
     * device's own. */
    const char *max_alloc;
} cln_device_desc;

typedef struct cln_device_info {
    char name[128], vendor[128], platform[128], driver[128], version[128];
    char type[16];                /* "cpu", "gpu", "accelerator" */
    double global_mem, max_alloc; /* bytes */
    int compute_units;
    char verdict[256]; /* "ok" or what is wrong; empty if not tested */
    /* The kernel parameters for the fast preset's networks, and where they come from; empty if the
     * device cannot be used, or was not asked. */
    char network[32], tune[256], tune_from[512];
} cln_device_info;

/* All OpenCL devices. desc: tune_file, and where kernels are; its spec is not looked at. NULL: only
 * what the loader tells of them. test: run the quick self-test on each. No device at all is
 * CLN_NO_DEVICE with what to install. The caller frees *out. */
CLN_API cln_status cln_devices_list(const cln_device_desc *desc, bool test, cln_device_info **out,
                                    int *count);

/* ---- training ---- */

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
    bool resume;
    bool skip_selftest;
    /* With resume: what the run should now have (cln_settings_of_run and changes); what shapes its
     * networks cannot change. */
    const cln_settings *settings;
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

/* Trains until a budget is used up. Leaves RUN/ as docs/formats.md says. *result is filled as far
 * as it went, also when interrupted. */
CLN_API cln_status cln_train(const cln_train_desc *desc, cln_train_result *result);

/* ---- measuring and rendering ---- */

typedef struct cln_eval_image {
    char *name;
    int width, height;
    double psnr, psnr_u8, ssim, mse, seconds;
    double opacity_error; /* RMS of opacity - alpha; NAN for an image without alpha */
    double opaque_air;    /* share of its transparent pixels (alpha 0) with an opacity above 0.5;
                             NAN where there are none */
} cln_eval_image;

typedef struct cln_eval_result {
    int count;
    cln_eval_image *images;
    double psnr, psnr_u8, ssim, mse, psnr_of_mean_mse, seconds; /* means over images */
    double opacity_error, opaque_air; /* means over those that have one; else NAN */
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
CLN_API cln_status cln_eval(const cln_eval_desc *desc, cln_eval_result *result);
/* The text of that file (docs/formats.md); the caller frees it. */
CLN_API cln_status cln_eval_json(const cln_eval_result *result, char **json);
CLN_API void cln_eval_free(cln_eval_result *result);

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
CLN_API cln_status cln_render(const cln_render_desc *desc, cln_render_result *result);

/* ---- the field itself ---- */

/* A trained run opened to be asked at points: its newest checkpoint on a device. Needs neither
 * scene nor run folder after it is open. One thread at a time; close frees it. */
typedef struct cln_field cln_field;

CLN_API cln_status cln_field_open(const char *run, const cln_device_desc *device, cln_field **out);
CLN_API void cln_field_close(cln_field *field); /* accepts NULL */

/* The cube that holds the scene, in scene units; outside of it there is nothing. */
CLN_API void cln_field_box(const cln_field *field, double min[3], double max[3]);

/* Colour and density at n points, as pictures are made of them.
 *   positions   [n][3] scene units
 *   directions  [n][3] from the eye to the point, of any length but 0; NULL without rgb
 *   rgb         [n][3] 0..1, sRGB as in the photos; NULL = not asked for
 *   sigma       [n]    per scene unit: light that goes a short way d keeps exp(-sigma d);
 *                      NULL = not asked for
 * Where no leaf is (outside the cube, or culled as empty) sigma and rgb are 0. CLN_USAGE for a
 * direction of length 0 or a number that is not finite. */
CLN_API cln_status cln_field_at(cln_field *field, size_t n, const double (*positions)[3],
                                const float (*directions)[3], float (*rgb)[3], float *sigma);

/* ---- exports and facts ---- */

typedef struct cln_export_desc {
    const char *run;
    const char *what;   /* "octree": the active leaves as boxes, a PLY file */
    const char *file;   /* the file to write */
    const char *colour; /* octree: "level" or "error"; NULL = "level" */
    bool overwrite;     /* else a file that is there is CLN_OUTPUT */
} cln_export_desc;

enum { CLN_LEVELS = 6 }; /* levels that a tree can have, 0 to 5 */

typedef struct cln_export_result {
    int64_t step;
    int leaves, levels[CLN_LEVELS]; /* active leaves, and how many of each level */
} cln_export_result;

/* What the newest checkpoint holds, in the scene's coordinates, as a file for other programs
 * (docs/formats.md). Needs no device. CLN_USAGE for an unknown `what`. */
CLN_API cln_status cln_export(const cln_export_desc *desc, cln_export_result *result);

/* JSON text (the caller frees it) about a scene or a run. settings: how train would read the
 * scene. */
CLN_API cln_status cln_info_scene(const char *scene, const cln_settings *settings, char **json);
CLN_API cln_status cln_info_run(const char *run, char **json);

/* ---- tuning ---- */

typedef enum cln_tune_verdict {
    CLN_SET_REFUSED,
    CLN_SET_SLOWER,
    CLN_SET_TAKEN,
    CLN_SET_UNDECIDED
} cln_tune_verdict;

/* A set of kernel parameters that the tuner tried. */
typedef struct cln_tune_try {
    char tune[256];
    cln_tune_verdict verdict;
    char reason[512];        /* why it was refused */
    double seconds, against; /* of a step, and of the best set before it at the same time; NaN */
} cln_tune_try;

typedef struct cln_tune_desc {
    cln_device_desc device; /* tune: where the search begins; NULL = those of the device's class */
    const cln_settings *settings; /* whose networks, sampling and batch */
    double budget;                /* seconds */
    int max_tries;                /* most sets tried; 0 = as many as the budget allows */
    const char *file;             /* the row goes here, over one for the same; NULL = nowhere */
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

/* Looks for the kernel parameters that make a training step fastest on a device. A set is timed
 * only after it has passed the self-test's checks with these very networks. CLN_CHECK if not even
 * the plain ones do. */
CLN_API cln_status cln_tune_search(const cln_tune_desc *desc, cln_tune_result *result);
CLN_API void cln_tune_free(cln_tune_result *result);

/* ---- self-test ---- */

typedef void cln_check_sink(const char *name, bool passed, bool skipped, const char *detail,
                            void *user);

/* Kernels against the float64 reference on one device, small shapes; CLN_CHECK if any fails. quick:
 * about a second. */
CLN_API cln_status cln_selftest(const cln_device_desc *device, bool quick, cln_check_sink *sink,
                                void *user);

#ifdef __cplusplus
}
#endif

#endif
