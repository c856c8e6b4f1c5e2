/* cl-nascent: posed photos in, a scene to be viewed from anywhere out, on any OpenCL device. The
 * library's only public header; the command line works through it alone. docs/api.md shows how the
 * parts go together, with examples.
 *
 * Errors: functions return cln_status; cln_error_text() (per thread) has the sentence. Nothing here
 * prints or exits: log lines go to cln_log_to's sink, progress and interruption through callbacks.
 * The caller frees texts (char **) with free(). Strings are UTF-8; descs and what they point to
 * stay the caller's and need only live during the call. One process at a time trains into a run
 * folder: cln_train holds RUN/lock; if another process does, CLN_OUTPUT names it.
 *
 * Any call may return CLN_MEMORY, and CLN_USAGE for a member that is missing or out of range, or
 * for a desc, result or object that is NULL; one that reads a scene or a run, CLN_INPUT or
 * CLN_CHECKPOINT; one that works on a device, CLN_NO_DEVICE, CLN_CL or CLN_BUILD, and CLN_OUTPUT if
 * its driver has no place for the kernels that it compiles; one that writes, CLN_OUTPUT; one with
 * callbacks, CLN_SIGINT or CLN_SIGTERM. The comments below have the others, and what is special. */
#ifndef CL_NASCENT_H
#define CL_NASCENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Until 1.0 structs get members from one version to the next, and the shared library's name stays:
 * compile with the header of the library that you run with (docs/api.md, "What may change"). */
#define CLN_VERSION "0.2.0-dev"

/* Marks the shared library's exports. */
#define CLN_API __attribute__((visibility("default")))

/* CLN_VERSION of the linked library. */
CLN_API const char *cln_version(void);

/* ---- errors ---- */

/* X(name, exit code of the command line, phrase). Codes and order never change; new rows go
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

/* Exit code and fixed phrase of a status; of one that this library does not know, 1 and "unknown
 * status". */
CLN_API int cln_status_exit_code(cln_status st);
CLN_API const char *cln_status_phrase(cln_status st);

/* This thread's error: sentence ("" if none), status, and clearing. Of several failures the first
 * stays, until it is cleared: by cln_clear_error, or as the next call begins, but of cln_settings_*
 * and cln_eval_json, which keep what is there. The text lives until then. */
CLN_API const char *cln_error_text(void);
CLN_API cln_status cln_error_status(void);
CLN_API void cln_clear_error(void);

/* ---- log ---- */

typedef enum cln_log_level {
    CLN_LOG_ERROR,
    CLN_LOG_WARN, /* changes a result; the line begins with "warning: " */
    CLN_LOG_INFO, /* a training's normal lines */
    CLN_LOG_DEBUG
} cln_log_level;

/* Gets a line without newline, on the working thread. */
typedef void cln_log_sink(cln_log_level level, const char *line, void *user);

/* Sends lines up to level `most` to sink; NULL = nowhere, the default. Applies to the process: call
 * it while no other function of this header runs. */
CLN_API void cln_log_to(cln_log_level most, cln_log_sink *sink, void *user);

/* ---- settings ---- */

/* Every hyperparameter and run option, set and read by name and text, so that a new one does not
 * change this header. Names are the options of `cl-nascent train --help` without dashes ("rays",
 * "view-width"), earlier names included; switches take "yes" and "no". One thread at a time. */
typedef struct cln_settings cln_settings;

/* preset: "voxel", "fast", "paper", "nerf", "kilonerf"; NULL = "voxel". CLN_USAGE for another. */
CLN_API cln_status cln_settings_create(const char *preset, cln_settings **out);
/* An existing run's settings, to resume it with. */
CLN_API cln_status cln_settings_of_run(const char *run, cln_settings **out);
CLN_API void cln_settings_free(cln_settings *settings); /* accepts NULL */

/* Sets a value. Times may have a unit ("90s", "10m"), and sizes ("512M"); in a run's settings,
 * steps, epochs and time-limit take "+N". CLN_USAGE names the mistake and the legal values, and
 * leaves the settings as they are. */
CLN_API cln_status cln_settings_set(cln_settings *settings, const char *name, const char *value);
/* Gets a value as text that set reads back exactly; bytes: of the buffer, CLN_SETTING_BYTES always
 * suffice. */
enum { CLN_SETTING_BYTES = 256 };
CLN_API cln_status cln_settings_get(const cln_settings *settings, const char *name, char *value,
                                    size_t bytes);
/* Checks that all values go together, as cln_train and cln_tune_search also do. CLN_USAGE. */
CLN_API cln_status cln_settings_check(const cln_settings *settings);

typedef struct cln_setting_info {
    const char *name, *alias; /* alias: an earlier name, or NULL */
    const char *group;        /* "network" (of leaves), "tree", "sampling", "optim", "run" */
    const char *help;
    const char *type;  /* "int", "real", "switch", "word", "text" */
    const char *words; /* word: "a|b|c"; else NULL */
    double min, max;   /* int, real */
} cln_setting_info;

/* Describes setting number `index`, from 0; false after the last one, or if info is NULL. The texts
 * live forever. */
CLN_API bool cln_setting_describe(int index, cln_setting_info *info);

/* ---- devices ---- */

/* The device to work on. spec: NULL or "auto" (a GPU if there is one, else an accelerator, else a
 * CPU), "gpu", "cpu", a row number of cln_devices_list, or part of a device, vendor or platform
 * name. CLN_NO_DEVICE if none matches; there is no silent substitute. */
typedef struct cln_device_desc {
    const char *spec;
    const char *kernel_dir; /* kernels are read from here; NULL = the embedded ones */
    /* Source of kernel parameters, the first one of: tune ("VW=8,TS=6,...", on top of the device
     * class's defaults), a row of tune_file that fits device and leaves, such a row that came with
     * the program, the class's defaults. NULL = none. */
    const char *tune;
    const char *tune_file; /* the user's rows, docs/formats.md "Tuning rows" */
    /* The largest buffer ("256M"), as if the device allowed no more: batches are cut to it, arrays
     * of a row per leaf split into up to four buffers, CLN_MEMORY beyond. NULL = the device's
     * own. */
    const char *max_alloc;
    /* eval, render: the device memory that they stay under ("512M"), CLN_MEMORY if it is not
     * enough. NULL = the run's own setting. Training has it as a setting and does not read this. */
    const char *device_mem;
} cln_device_desc;

typedef struct cln_device_info {
    char name[128], vendor[128], platform[128], driver[128], version[128];
    char type[16];                           /* "cpu", "gpu", "accelerator" */
    double global_mem, max_alloc, local_mem; /* bytes; local: of a work-group */
    int compute_units, max_group;            /* max_group: work-items of a group */
    bool shared_mem;   /* its memory is the host's, as of processors, and of GPUs on one chip */
    char verdict[256]; /* "ok" or the defect; empty if not tested */
    /* The fast preset's networks, their kernel parameters and the source of these; empty if the
     * device cannot be opened, or was not. */
    char network[32], tune[256], tune_from[512];
    char voxel_network[32], voxel_tune[256], voxel_tune_from[512]; /* the same of preset voxel */
} cln_device_info;

/* Lists all OpenCL devices. desc: its tune_file and kernel_dir count, its spec does not; NULL: list
 * without opening devices. test: run the quick self-test on each. CLN_NO_DEVICE without any, with
 * what to install. The caller frees *out. */
CLN_API cln_status cln_devices_list(const cln_device_desc *desc, bool test, cln_device_info **out,
                                    int *count);

/* ---- training ---- */

/* Numbers of a running training, for a progress display. The results of a step arrive with the
 * next one: after the first step, rays_per_s, samples_per_ray, loss and psnr_train are NaN. */
typedef struct cln_train_progress {
    int64_t step, steps; /* steps 0: the budget is time */
    double fraction;     /* of the budget, 0..1 */
    double seconds;      /* of training so far */
    double eta;          /* seconds to go, evaluations included; NaN at first */
    int unmeasured;      /* evaluations to come that eta leaves out, as none was timed yet */
    double rays_per_s, samples_per_ray;
    double loss, psnr_train; /* over the rays since the last row of metrics.jsonl; dB */
    double psnr_test;        /* dB, of the last evaluation; NaN before the first */
    int leaves;
    double params, device_bytes; /* learned numbers; bytes of device buffers */
    /* Estimate for those, from rays_per_s: off by up to 2 times; NaN if that is. */
    double unmeasured_seconds;
} cln_train_progress;

typedef struct cln_callbacks {
    void (*train)(const cln_train_progress *progress,
                  void *user); /* after every step; may be NULL */
    /* Parts done of any other work: views of eval and render, kernels checked before a training,
     * an export's depths, photos that are read (`what` names it). May be NULL. */
    void (*work)(const char *what, int done, int total, void *user);
    /* Polled every step / ray batch: 0 = go on, SIGINT or SIGTERM = write a checkpoint and return
     * CLN_SIGINT / CLN_SIGTERM, SIGUSR1 = write a checkpoint and go on; any other is SIGINT. May be
     * NULL. */
    int (*interrupted)(void *user);
    void *user;
} cln_callbacks;

/* A training that can be watched and steered from a browser while it runs: pictures as of
 * cln_view_run, error against run time, stage times; pause, checkpoint, stop. What is trained does
 * not depend on it, and its time is not training's. */
typedef struct cln_live_desc {
    const char *listen; /* a numeric address, which then needs a token; NULL = 127.0.0.1, without */
    int port;           /* 0 = 7007, or a free one if that is taken */
    double share;       /* of the time, 0..0.9, for all pictures but the first; 0 = 0.2 */
    /* Called once, when a browser can open the address (token included). May be NULL. */
    void (*ready)(const char *address, void *user);
    void *user;
} cln_live_desc;

typedef struct cln_train_desc {
    const char *scene; /* NULL with resume: the run's own */
    const char *run;
    bool resume;
    bool skip_selftest;
    /* With resume: the run's new settings (cln_settings_of_run with changes); those that a
     * checkpoint fixes cannot change. NULL = the default preset's; with resume, the run's. */
    const cln_settings *settings;
    cln_device_desc device;
    const char *command; /* command line, for run.json; may be NULL */
    /* File for each structure decision's integer program, in LP format, which overwrites the one
     * before; NULL = none. */
    const char *dump_program;
    /* NULL = nobody can watch. CLN_FAILED if the library was built without libmicrohttpd. */
    const cln_live_desc *live;
    cln_callbacks callbacks;
    bool restart; /* without resume: a run that ended before its first checkpoint is begun again */
} cln_train_desc;

typedef struct cln_train_result {
    int64_t step;
    double seconds;               /* training seconds, without evaluation */
    double wall_seconds;          /* of the call */
    double psnr_train, psnr_test; /* dB, the newest; NaN if there is none */
    double psnr_exposed;          /* of the same test views; see cln_eval_image */
    int eval_views, test_views;   /* number of views of psnr_test (0 if it is NaN), and of all
                                     test views */
    int leaves;
    double device_peak, host_peak; /* most bytes of device buffers, and of the process, of all
                                      starts of the run */
    uint64_t digest;               /* model_digest */
    int psnr_train_steps;          /* psnr_train is over the last so many steps; 0 if unknown */
    double cpu_seconds; /* of processors for `seconds`; NaN if earlier starts tell none */
    int64_t eval_step;  /* that psnr_test is of, of an interrupted training an earlier one; -1 if
                           psnr_test is NaN */
} cln_train_result;

/* Trains until a budget is used up; docs/formats.md describes RUN/. Where memory is short, a new
 * training whose settings were not given batch-samples takes fewer, and records them. *result is
 * filled in as far as training went, also when interrupted. */
CLN_API cln_status cln_train(const cln_train_desc *desc, cln_train_result *result);

/* ---- measuring and rendering ---- */

typedef struct cln_eval_image {
    char *name;
    char *file; /* of its pictures: FILE.png, FILE.truth.png, FILE.error.png */
    int width, height;
    /* PSNRs in dB: psnr_u8 of the render rounded to 8 bits, psnr_fitted after an affine fit of its
     * colours to the photo's, NAN where that has one colour alone. ssim: NAN if no 11 x 11 pixels
     * all count. mse: of colours in 0..1. seconds: to render it. */
    double psnr, psnr_u8, ssim, mse, seconds;
    double psnr_fitted;
    /* PSNR of the render times the photo's exposure as photos before and after it tell it; a
     * training photo's own. NAN if no gains were fitted */
    double psnr_exposed;
    double opacity_error; /* RMS of opacity - alpha; NAN for an image without alpha */
    double opaque_air;    /* share of its transparent pixels (alpha 0) with an opacity above 0.5;
                             NAN where there are none */
    double depth; /* median distance of what it shows, scene units; NAN if it is transparent in most
                     of its pixels */
    bool hidden;  /* by something right before its camera: far below the other images, in dB, and
                     its depth is a small part of theirs */
    double psnr_most; /* without the 7 % of its pixels that are farthest off; NAN with alpha */
    bool partly;      /* that is 9 dB better, and 4 more than in the best of the others: a small
                         part of it is not as its photo, as where something moved */
    int turn; /* EXIF orientation (1, 3, 6, 8) that its pictures, which are as its pixels are
                 stored, are to be turned by to be seen as people see the photo; 1: as they are */
    int file_width, file_height, downscale; /* of the photo's file, which was divided by so much */
    bool apart; /* no ray of it meets the cube, or, with a shell, the box that was given */
    bool empty; /* it is not apart, and its render shows nothing: no opacity above 1/4 */
    bool off;   /* of 8 images and more, its PSNR is far below the others', fitted or not, and it is
                 not hidden: its pose, its photo or what stood there is likely another */
    double lpips; /* NAN unless asked for */
} cln_eval_image;

/* Changes of the field over a small step: of the colour (mean over channels), and of the alpha of a
 * short length; their mean over the pairs of points, and the value that 95 % of the pairs do not
 * exceed. NAN without pairs. */
typedef struct cln_eval_jump {
    int pairs;
    double colour, colour_95, alpha, alpha_95;
} cln_eval_jump;

typedef struct cln_eval_seams {
    bool measured;
    cln_eval_jump across, inside; /* from leaf to leaf; inside of leaves */
} cln_eval_seams;

typedef struct cln_eval_result {
    int count;
    cln_eval_image *images;
    double psnr, psnr_u8, ssim, mse, psnr_of_mean_mse, seconds; /* means over images with a value */
    double psnr_fitted, psnr_exposed;                           /* means over images */
    double fitted_gain; /* what the fit gains, dB, in the mean over the images that it brings among
                           the others: of 1 and more, exposure or white balance differs */
    double opacity_error, opaque_air; /* means over images that have a value; else NAN */
    int64_t step;
    int antialias; /* n x n rays for pixels at edges; 1 = one ray a pixel */
    bool fast;     /* with fewer samples */
    cln_eval_seams seams;
    double train_seconds;
    uint64_t digest;
    float background[3];
    char split[8];
    uint64_t scene_digest; /* of the scene that the views are of */
    int apart;             /* images that are, and count in no mean unless all are */
    double lpips;          /* mean over images; NAN unless asked for */
    char lpips_network[8]; /* "alex" or "vgg"; "" */
} cln_eval_result;

typedef struct cln_eval_desc {
    const char *run;
    const char *scene; /* NULL = the run's own */
    const char *split; /* "train", "val", "test", "all"; NULL = "test" */
    int max_images;    /* evenly chosen, of those that are not apart if any is; 0 = all */
    int antialias;     /* n x n rays for pixels at edges, 1..8; 0 = as in training */
    bool fast;         /* fewer samples: less time, a little more error */
    bool seams;        /* also jumps between leaves at surfaces, of up to 16 training views */
    bool save_images;  /* renders, truths, errors and pictures of the tree */
    const char *out;   /* the folder to write to, of no run or frames (CLN_USAGE); NULL = RUN/eval,
                          and the report is renewed */
    cln_device_desc device;
    cln_callbacks callbacks;
    const char *views; /* only views of the split with these photos' names, with commas between: a
                          path in the scene or a file's name, with or without the ending. NULL = as
                          max_images says, which must be 0 with it */
    const float *background; /* [3] r, g, b in 0..1, sRGB, behind photos with alpha and renders;
                                NULL = the run's own */
    const char *lpips;       /* file of a network's weights (docs/formats.md), by which LPIPS is
                                measured, too; NULL = not */
} cln_eval_desc;

/* Measures per-image and mean PSNR and SSIM; writes STEP-SPLIT.json, or STEP-SPLIT-COUNT.json for
 * fewer views than the split has, of `views` with eight digits of a digest of their names behind
 * COUNT, and -overRRGGBB for another background. CLN_USAGE for a name in `views` that no view has,
 * or a `background` of photos without alpha. CLN_OUTPUT with a filled *result (count above 0): all
 * was measured, but not all could be written. CLN_INPUT for another scene than the run's without
 * `out`. */
CLN_API cln_status cln_eval(const cln_eval_desc *desc, cln_eval_result *result);
/* The text of that file (docs/formats.md); the caller frees it. */
CLN_API cln_status cln_eval_json(const cln_eval_result *result, char **json);
CLN_API void cln_eval_free(cln_eval_result *result); /* accepts NULL */

typedef struct cln_render_desc {
    const char *run, *out;
    const char *scene; /* NULL = the run's own, or else the cameras that RUN keeps */
    /* The poses, of which one must be given: a file's (nerfstudio's camera_path.json, or transforms
     * JSON), else the poses of a split, else a spiral of so many frames within the training
     * cameras' poses, else an orbit; or `map`. What these poses do not use of interpolate, loop,
     * up, orbit_circle, fov, max_images, first_frame and frame_count must be 0 (CLN_USAGE);
     * orbit_elevation and orbit_radius are not looked at then. */
    const char *poses, *split;
    int spiral_frames, orbit_frames;
    double orbit_elevation; /* degrees above the horizon of the training cameras' up axis; NaN: the
                               mean of theirs */
    double orbit_radius;    /* in units of the mean training camera distance; of a spiral of
                               forward-facing cameras, of the extent of their poses */
    int interpolate;        /* frames of a smooth path through the file's or split's poses, in
                               their order; 0 = only these poses */
    bool loop;              /* interpolate: from the last pose on to the first; the last frame is
                               the one before the first again */
    double up[3];           /* orbit, spiral, path: in the scene's frame, of any length; all 0: as
                               the training cameras tell */
    bool orbit_circle;      /* all around, even if the training cameras cover only an arc */
    int width, height;      /* image size; 0 = as the photos, or in their shape */
    double fov;             /* orbit, spiral, interpolate: horizontal, degrees; 0 = as the training
                               images, or as the poses that are passed */
    int max_images;         /* file, split: evenly chosen; 0 = all */
    int antialias;          /* n x n rays for pixels at edges, 1..8; 0 = as in training */
    bool fast;              /* fewer samples: less time, a little more error */
    bool cropped;           /* to `crop`: nothing outside of it is seen */
    double crop[6];         /* x0, y0, z0, x1, y1, z1: a box in the scene's frame and units */
    double crop_turn[3];    /* degrees by which the box is turned about its middle: about x, then
                               y, then z */
    double stereo;          /* for each pose a pair side by side, left and right, of eyes this many
                               scene units apart; 0 = single pictures */
    bool normals;           /* also NAME.normal.npy and NAME.normal.png */
    bool seen;              /* also NAME.seen.png: how many training views see what a pixel shows;
                               needs the cameras of the scene or the run */
    double fps;             /* film: frames a second, 0.001 or more; 0 = the file of poses', or
                               24; a folder's is 0 */
    bool overwrite;         /* else existing frames are skipped if they were made from the same
                               model, camera and settings; if not, CLN_OUTPUT */
    bool z_depth;           /* depth along the optical axis; else along the ray */
    bool pfm;               /* also NAME.depth.pfm */
    double depth_unit;      /* also NAME.metric.png, 16-bit grey in steps of this many scene units;
                               0 = not */
    bool mean_depth; /* depth is the mean over the ray; else half of its opacity is before it */
    cln_device_desc device;
    cln_callbacks callbacks;
    const char *views; /* split: only these, as in cln_eval_desc; NULL = as max_images says */
    int first_frame, frame_count; /* of all of these frames, only so many from that one on, which is
                                     0 or more, as in names; 0 = all the others */
    bool transparent;        /* NAME.png has alpha: colours without the background, straight, not
                                premultiplied; else colours on it. Of films: .mov and .webm */
    const float *background; /* [3] r, g, b in 0..1, sRGB; NULL = the run's own, or that of the
                                crop box in the file of poses */
    int bits;                /* of colours and opacity in PNG files: 8 or 16; 0 = 8 */
    bool map;                /* instead of poses: one picture, `map`, from straight above by
                                parallel rays, of the crop box or the cube, with map.pgw (a world
                                file) and map.height.asc (an ESRI ASCII grid). up: all 0: the
                                scene's z, or where that is not up, as the training cameras tell */
    double spacing;          /* map: of pixels, scene units; 0 = so that 800 to 2000 are a side */
    double offset[3];        /* map: added to its coordinates and heights */
} cln_render_desc;

typedef struct cln_render_result {
    int rendered, skipped;
    double seconds;
    bool plain_film; /* it is in OUT with the ending .y4m, as ffmpeg is not installed */
    /* With `seen`, means over the frames: of what they show, the shares that no training view and
     * that fewer than three see; else, or if they show nothing, NaN. */
    double unseen, hardly_seen;
} cln_render_result;

/* Writes OUT/NAME.png (colour), NAME.depth.npy (float32, scene units), NAME.depth.png (for
 * viewing), NAME.opacity.png. If OUT ends in .mp4, .mov, .mkv, .webm, .gif or .y4m, it is a film of
 * the colours instead, by ffmpeg (.y4m without; if ffmpeg is not installed, OUT with that ending),
 * always from its first frame. Names are the dataset's, or orbit_0000, spiral_0000, path_0000. */
CLN_API cln_status cln_render(const cln_render_desc *desc, cln_render_result *result);

/* ---- looking at it live ---- */

typedef struct cln_view_desc {
    const char *run;
    const char *scene;  /* NULL = the run's own; without one there are no photos */
    const char *listen; /* a numeric address, which then needs a token; NULL = 127.0.0.1, without */
    int port;           /* 0 = 7007, or a free one if that is taken */
    double up[3];       /* which way is up in the scene's frame; all 0: as the cameras tell */
    cln_device_desc device;
    /* Called once, when a browser can open the address (token included). May be NULL. */
    void (*ready)(const char *address, void *user);
    cln_callbacks callbacks; /* interrupted: the way to end it; gets its `user`, as ready does */
} cln_view_desc;

/* Shows a run's newest model in a browser: serves a page and the pictures that it asks for, until
 * interrupted (CLN_SIGINT, CLN_SIGTERM). Writes nothing but films while they are made, in TMPDIR.
 * CLN_FAILED if the library was built without libmicrohttpd. */
CLN_API cln_status cln_view_run(const cln_view_desc *desc);

/* ---- the field itself ---- */

/* A trained run, opened for evaluation at points and for pictures in memory: its newest checkpoint
 * on a device (NULL: as "auto"). Needs neither scene nor, once open, run folder. One thread at a
 * time; close frees it. */
typedef struct cln_field cln_field;

CLN_API cln_status cln_field_open(const char *run, const cln_device_desc *device, cln_field **out);
CLN_API void cln_field_close(cln_field *field); /* accepts NULL */

/* The cube that holds the scene, in scene units; it is empty outside, unless the run has a shell
 * (--space shell). Of a run in normalised device coordinates: a box around what its cameras see as
 * far as 1,000 near planes; the scene continues beyond it. Writes nothing if a pointer is NULL. */
CLN_API void cln_field_box(const cln_field *field, double min[3], double max[3]);

/* Evaluates colour and density at n points, as in pictures.
 *   positions   [n][3] scene units
 *   directions  [n][3] from the eye to the point, of any length but 0; NULL without rgb
 *   rgb         [n][3] 0..1, sRGB as in the photos; NULL = not wanted
 *   sigma       [n]    per scene unit: over a short distance d, light keeps the share
 *                      exp(-sigma d); NULL = not wanted. Beyond the core of a shell, and in
 *                      normalised device coordinates, it is that along the direction; without
 *                      directions along z, or there along the mean camera's axis
 * Outside leaves (outside the cube, or culled as empty) sigma and rgb are 0. CLN_USAGE for a
 * direction of length 0 or a number that is not finite. */
CLN_API cln_status cln_field_at(cln_field *field, size_t n, const double (*positions)[3],
                                const float (*directions)[3], float (*rgb)[3], float *sigma);

/* A picture of the field: a camera in the scene's own frame and units, which is needed, and how to
 * render. The camera's axes are OpenCV's: x right, y down, z forward (of OpenGL's, as transforms
 * JSON has them, negate the second and third column). The top-left pixel's centre is at (0.5,
 * 0.5). */
typedef struct cln_frame_desc {
    int width, height;     /* pixels */
    double fx, fy, cx, cy; /* pixels */
    double c2w[12];        /* camera to world, 3 x 4, row by row: a rotation, and the position */
    /* NULL = a pinhole. Else a lens model by COLMAP's name ("OPENCV", "OPENCV_FISHEYE"), and its
     * parameters in the order of docs/method.md 3.1, the others 0. Of "EQUIRECTANGULAR" the picture
     * spans the sphere, and fx, fy, cx, cy are not looked at. */
    const char *lens;
    double params[12];
    const float *background; /* [3] r, g, b in 0..1, sRGB; NULL = the run's own */
    int antialias;           /* n x n rays for pixels at edges, 1..8; 0 = as in training */
    bool z_depth;            /* depth along the optical axis; else along the ray */
    bool mean_depth; /* depth is the mean over the ray; else half of its opacity is before it */
    cln_callbacks callbacks; /* interrupted */
} cln_frame_desc;

/* Renders into the caller's arrays, each NULL if not wanted, row by row from the top:
 *   rgb      [height][width][3] 0..1, sRGB as in the photos, over the background
 *   depth    [height][width]    scene units; 0 where opacity is 0
 *   opacity  [height][width]    0..1
 * The pixels are cln_render's before these are rounded to 8 bits, and to the bit its depths. The
 * first picture also computes densities of all leaves, and the first with a lens builds kernels for
 * it; later ones reuse both, and the memory. Of a picture that failed, arrays have no meaning; the
 * field can be used again. CLN_USAGE also for a c2w that is no rotation to 1e-3. */
CLN_API cln_status cln_field_render(cln_field *field, const cln_frame_desc *frame, float *rgb,
                                    float *depth, float *opacity);

/* ---- exports and facts ---- */

/* What to write, and where. Members that the export does not read must be 0 (`scale` 0 or 1), also
 * scene and overwrite of a copy, whose folder is a new one; else scene, and device, are not looked
 * at where they are not needed. */
typedef struct cln_export_desc {
    const char *run;
    /* "points": points of the surface (PLY); "mesh": the surface as triangles (PLY, OBJ, GLB
     * or STL);
     * "volume": colour and density on a grid (npy); "cameras": the scene's cameras (transforms
     * JSON, or a folder of COLMAP's text files); "octree": the active leaves as boxes (PLY);
     * "copy": a run of the newest model without the state of training (a new folder). */
    const char *what;
    const char *file;   /* its ending says the format, and must be one of these; for cameras, a
                           name without any is a folder's */
    const char *colour; /* octree: "level" or "error"; NULL = "level" */
    bool overwrite;     /* else an existing file is CLN_OUTPUT */
    const char *scene;  /* NULL = the run's own, or else the cameras that RUN keeps */
    /* Distance in scene units between points on the surface (0: by count), of the grid that a mesh
     * is made on (0: by leaves and views, wider where leaves are larger), or of a volume's grid (0:
     * a 256th of the cube). */
    double spacing;
    int64_t count;          /* points: how many; 0 = 200,000 */
    bool closed;            /* points, mesh: also the parts that no training view sees */
    int64_t triangles;      /* mesh: the most; 0 = all that its grid makes */
    cln_device_desc device; /* points, mesh, volume */
    cln_callbacks callbacks;
    bool cropped;        /* points, mesh, volume: to `crop`; with `closed`, the mesh ends in its
                            faces */
    double crop[6];      /* x0, y0, z0, x1, y1, z1: a box in the scene's frame and units */
    double crop_turn[3]; /* degrees by which it is turned about its middle: about x, then y, then
                            z */
    bool largest;        /* points, mesh: only the connected part with the most triangles */
    /* points, mesh: which way is up, in the scene's frame, a vector of any length; what is written
     * is turned so that it is z. All 0: the scene's frame. A GLB file's root node brings it to y,
     * or else what the training cameras tell. */
    double up[3];
    bool up_auto; /* points, mesh: the same, by what the training cameras tell; `up` is all 0 */
    double scale; /* of all lengths in what is written, a GLB file's by its root node: 0.001 makes
                     metres of a scene in millimetres; 0 = 1 */
    /* points, mesh: added to x, y and z of what is written, after `up` and `scale`: where a survey
     * has its origin. Not of GLB and STL, whose numbers have 32 bits. */
    double offset[3];
} cln_export_desc;

enum { CLN_LEVELS = 9 }; /* a tree has levels 0 to 8 */

typedef struct cln_export_result {
    int64_t step;
    int leaves, levels[CLN_LEVELS]; /* active leaves, in all and by level */
    int64_t vertices, faces;        /* points, mesh */
    int64_t faces_before;           /* mesh: before `triangles` left some out; 0 = none left out */
    double reduction_error; /* how far that moved the surface at most, as measured; scene units
                                       times `scale` */
    int shape[3];           /* volume: of the grid, z, y, x */
    int views;              /* cameras */
    bool refined;           /* cameras: training views have corrected poses */
    int64_t parts;          /* with `largest`: connected parts that there were; else 0 */
    int64_t faces_left_out; /* triangles of all but the largest, before `triangles` */
    double size[3]; /* points, mesh: along x, y and z of what is written; of a GLB file with y up */
    double box[6];  /* where they are, as `crop` takes it: in the scene's frame and units */
    double written[6];    /* points, mesh: the lowest and the highest corner of what is written, as
                          programs that read it have it: of a GLB file by its root node */
    bool beyond_left_out; /* points, mesh: of a shell, without what lies beyond its cube */
    double area;          /* mesh: in square units of what is written */
    int64_t open_edges;   /* mesh: those without a triangle on either side; 0 = it is closed */
    double volume;        /* of a closed mesh: what it encloses, in cubic units; else 0 */
    double unseen;        /* mesh, with `closed`: share of its area that no training view sees */
    double fine;  /* points, mesh: width of the finest cells, or of the training views' pixels if
                     these are wider; no place of the surface is known better; scene units times
                     `scale`; of a forward space, whose cells grow with depth, 0 */
    double faint; /* points, mesh: share of what training views show, but at outlines, that is seen
                     through (opacity below 0.9): 0 of what is solid */
    double few_views; /* points, mesh: share of the area that training views see, of what only one
                         or two of them do; of more than 100 views, of 100 of them */
    double taken_off[3]; /* STL: of coordinates that 32-bit numbers cannot hold; else 0 */
} cln_export_result;

/* Writes contents of the newest checkpoint, in the scene's coordinates unless `up` turns, `scale`
 * scales or `offset` moves them, to a file for other programs (docs/formats.md). Octree and cameras
 * need no device. CLN_USAGE for an unknown `what`, for options that it does not read, for a grid
 * that is too fine, and for a crop box that nothing of the cube is in; CLN_FAILED for `triangles`
 * in a library that was built without meshoptimizer. */
CLN_API cln_status cln_export(const cln_export_desc *desc, cln_export_result *result);

/* JSON text about a scene or a run; the caller frees it. settings: to read the scene with; NULL =
 * the default preset's. "training" tells what a training with them would need: steps, and memory on
 * the device that "auto" chooses, if there is one. */
CLN_API cln_status cln_info_scene(const char *scene, const cln_settings *settings, char **json);
CLN_API cln_status cln_info_run(const char *run, char **json);

typedef struct cln_check_desc {
    const char *scene;
    const cln_settings *settings; /* for reading it, and for the training to come; NULL = the
                                     default preset's */
    cln_device_desc device;
    double probe;            /* seconds to measure the time of a step in, up to 600; 0 = not */
    const char *page;        /* an HTML file that shows it; NULL = none */
    const char *mask;        /* a PNG, black where something stands in all photos: CLN_INPUT if
                                nothing does; NULL = none */
    bool overwrite;          /* else an existing file is CLN_OUTPUT */
    cln_callbacks callbacks; /* work: of the photos and pairs of them, then of the timed trees */
} cln_check_desc;

/* Looks for mistakes in a scene, by its poses, its photos, and both together, before hours are
 * spent on it; *json (docs/formats.md) has what was found, likely faults first, and what a training
 * would need. The caller frees it. Found mistakes are not an error of the call. */
CLN_API cln_status cln_check(const cln_check_desc *desc, char **json);

/* ---- poses ---- */

typedef struct cln_poses_desc {
    const char *photos; /* a folder of PNG and JPEG photos, or a video */
    const char *out;    /* the scene's folder; made if it is not there */
    const char *match;  /* "auto", "all" pairs, or each with the "next" ones; NULL = "auto" */
    int frames;         /* of a video, none twice; 0 = 150 */
    const char *lens;   /* COLMAP's name of the cameras' model, in any case; NULL = "auto":
                           SIMPLE_RADIAL, of 30 photos and more of a camera OPENCV */
    bool gps;           /* turn, scale and move the scene by the GPS positions in the photos' EXIF
                           data: metres, x east, y north, z up. Poses that are in out/sparse/0 are
                           placed as they are, also again, by photos of the same names */
    const char *masks;  /* a folder with masks, called as training takes them beside photos, or one
                           picture for all: black is not looked at. They become out/masks. NULL =
                           none */
    cln_callbacks callbacks;
} cln_poses_desc;

typedef struct cln_poses_result {
    int photos, registered; /* all, and those with a pose */
    int focal_lengths;      /* photos with one in their EXIF data; 0 if poses were there already */
    int gps_photos;         /* photos with latitude, longitude and altitude there; where fewer than
                               three have the last, with the first two */
    bool placed;            /* the scene is in metres, east, north and up from: */
    double origin[3];       /* latitude and longitude, degrees (WGS 84), and height, metres as the
                               photos' altitudes are; the middle of the cameras */
    double gps_distance;    /* from the cameras to their GPS positions: the median, metres */
    int gps_used;           /* positions that tell that; others are far off */
    double up_sd, north_sd; /* how well these are known: standard deviations, degrees */
    double length_sd;       /* and lengths, relative */
} cln_poses_result;

/* Finds where photos were taken, by COLMAP's own program (`colmap`, and `ffmpeg` for a video), if
 * it is installed: CLN_FAILED if not, or if it finds nothing, with what it said in out/colmap.log.
 * CLN_INPUT if a photo cannot be read, or fewer than three have a position for `gps`; where these
 * turn out not to fit, the scene stays as COLMAP made it, with a warning. CLN_OUTPUT if the folder
 * has poses already or other things, or its disk has too little room. */
CLN_API cln_status cln_find_poses(const cln_poses_desc *desc, cln_poses_result *result);

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
    char reason[512];        /* why it was refused, or given up while its kernels were built */
    double seconds, against; /* of a step, and of the best set before it at the same time; NaN */
    /* The decision: number of pairs of alternate timings; median of the pairs' ratios of times
     * (below 1 is faster; NaN); number of pairs in which the set was not faster. */
    double ratio;
    int pairs, slower;
} cln_tune_try;

typedef struct cln_tune_desc {
    cln_device_desc device; /* tune: start of the search; NULL = the device class's defaults */
    const cln_settings *settings; /* their leaves, sampling and batch count; NULL = the default
                                     preset's */
    double budget;                /* seconds, up to 1e6; 0 = 60; the first set may take longer */
    int max_tries;                /* most sets tried; 0 = as many as the budget allows */
    const char *file;             /* gets the row, instead of an older one; NULL = none */
    cln_callbacks callbacks;
} cln_tune_desc;

typedef struct cln_tune_result {
    cln_device_info device;
    char network[32], tune[256]; /* the leaves (W32-D3-V32, X8x16) and their best set */
    char row[1024];              /* the same as a line of a file of rows */
    double seconds;              /* of a step with it */
    double gain;                 /* the first set's seconds / these */
    int rays, samples, leaves;   /* of the timed step */
    bool complete;               /* the search ended before the budget */
    cln_tune_try *tries;         /* in order; the first taken one is the start */
    int count;
} cln_tune_result;

/* Searches for the kernel parameters that make a training step fastest on a device. Times a set
 * only after it has passed the self-test's checks with these leaves. CLN_CHECK if even the plain
 * set fails. */
CLN_API cln_status cln_tune_search(const cln_tune_desc *desc, cln_tune_result *result);
CLN_API void cln_tune_free(cln_tune_result *result); /* accepts NULL */

/* ---- self-test ---- */

typedef void cln_check_sink(const char *name, bool passed, bool skipped, const char *detail,
                            void *user);

/* Checks kernels against the float64 reference on a device, on small shapes; CLN_CHECK if any check
 * fails. quick: about a second. device: NULL = as "auto". */
CLN_API cln_status cln_selftest(const cln_device_desc *device, bool quick, cln_check_sink *sink,
                                void *user);

/* The verdict of cln_devices_list on device number `row` alone, with callbacks (NULL: none): fills
 * in info->verdict. CLN_NO_DEVICE without such a row; other errors that are not the caller's are a
 * verdict. */
CLN_API cln_status cln_devices_test(const cln_device_desc *desc, int row,
                                    const cln_callbacks *callbacks, cln_device_info *info);

/* cln_selftest at extremes (docs/stability.md): a check is a row, its detail says what was varied,
 * the worst error, its bound and place. quick: without sorts of over 2^17 elements. */
CLN_API cln_status cln_selftest_extremes(const cln_device_desc *device, bool quick,
                                         cln_check_sink *sink, void *user);

#ifdef __cplusplus
}
#endif

#endif
