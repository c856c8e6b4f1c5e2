/* The tables of option_table.h and the look-ups in them. To add an option: a row in cln_args and a
 * field in cln_options; a command: a row in cln_commands and its cmd_*.c; an export: a row in
 * export/list.h. */
#include "cli/option_table.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include "base/text.h"
#include "cli/commands.h"
#include "cli/options.h"
#include "export/list.h"

/* clang-format off */
const cln_command cln_commands[] = {
    {"train", CLN_TRAIN, "SCENE", false,
     "train SCENE -o RUN [OPTIONS]\n       cl-nascent train --resume RUN [SCENE] [OPTIONS]",
     "Trains a scene from its posed photos",
     "SCENE is a folder or a transforms JSON file. Training ends when the first budget is used up "
     "(--steps, --time-limit, --target-psnr; else --epochs). Ctrl-C or SIGTERM writes a checkpoint "
     "and stops, a second one leaves at once; SIGUSR1 writes a checkpoint and goes on. With --view "
     "a browser can watch, pause and stop it, too.",
     cln_cmd_train},
    {"eval", CLN_EVAL, "RUN", true, "eval RUN [OPTIONS]",
     "PSNR and SSIM of a run's renders against held-out photos",
     "Writes RUN/eval/STEP-SPLIT.json, for fewer views than all STEP-SPLIT-COUNT*.json, and renews "
     "RUN/report.html. Figures of another scene than the run's need a folder of their own: -o.",
     cln_cmd_eval},
    {"render", CLN_RENDER, "RUN", true, "render RUN [OPTIONS]",
     "Pictures and depth from a split's poses, a file's, or a path",
     "Writes NAME.png, NAME.depth.npy (float32, scene units), NAME.depth.png and NAME.opacity.png. "
     "Frames that exist already are skipped, so an interrupted render goes on where it stopped.",
     cln_cmd_render},
    {"view", CLN_VIEW, "RUN", true, "view RUN [OPTIONS]",
     "A run in the browser: fly through it, beside its photos",
     "Prints an address for a browser on this machine, or elsewhere through ssh -L; Ctrl-C ends "
     "it. Nothing is loaded from elsewhere, and only films are written, while they are made.",
     cln_cmd_view},
    {"info", CLN_INFO, "SCENE|RUN", true,
     "info SCENE|RUN [OPTIONS]\n       cl-nascent info RUN RUN... [--json]",
     "What is in a scene or a run, or differs between runs",
     "A folder with a run.json of ours is a run, anything else a scene, read as train would "
     "read it. Several runs stand side by side: settings that differ, results, and which is best.",
     cln_cmd_info},
    {"poses", CLN_POSES, "PHOTOS", true, "poses PHOTOS -o SCENE [OPTIONS]",
     "Finds where photos were taken, with COLMAP's program",
     "PHOTOS is a folder of PNG and JPEG files, or a video (with ffmpeg). Needs the program colmap "
     "(Debian: apt install colmap), whose output goes to SCENE/colmap.log.",
     cln_cmd_poses},
    {"check", CLN_CHECK_SCENE, "SCENE", true, "check SCENE [OPTIONS]",
     "What is likely wrong with a scene, and what a training would need",
     "Compares photos and poses with each other, and measures the time of training steps here. "
     "Takes the options of train, for the training to come. Findings are not errors: the exit "
     "code is 0.",
     cln_cmd_check},
    {"export", CLN_EXPORT, "RUN", true, "export RUN --mesh FILE.ply [OPTIONS]",
     "Surface, volume, cameras, octree of a run, for other programs",
     "Exports the newest checkpoint, in the scene's coordinates and units: --scale changes these; "
     "in GLB, and with --up, it is turned. The octree and cameras need no device.",
     cln_cmd_export},
    {"devices", CLN_DEVICES, NULL, false, "devices [OPTIONS]",
     "The OpenCL devices, and whether they compute correctly",
     "The row number is what -d takes.",
     cln_cmd_devices},
    {"selftest", CLN_SELFTEST, NULL, false, "selftest [OPTIONS]",
     "The kernels on one device against the float64 reference",
     "Exit code 10 if a check fails.",
     cln_cmd_selftest},
    {"tune", CLN_TUNE, NULL, false, "tune [OPTIONS]",
     "Finds the kernel parameters that are fastest on a device",
     "For the leaves (voxels or networks) of a preset, or of the options given. Sets of parameters "
     "are timed only after they have passed against the float64 reference; the best becomes a row "
     "in your own file, which the other commands read.",
     cln_cmd_tune},
    {"bugreport", CLN_BUGREPORT, "RUN", false, "bugreport [RUN] [OPTIONS]",
     "What to send with a report of something that went wrong",
     "A text on standard output: versions, devices with a quick self-test, and RUN's settings and "
     "state. Nothing is sent anywhere.",
     cln_cmd_bugreport},
    {"completion", CLN_COMPLETION, "SHELL", true, "completion " CLN_SHELLS,
     "Completion of command lines for a shell",
     "On standard output. `make install` puts it where bash, zsh and fish look; for one session of "
     "bash: source <(cl-nascent completion bash).",
     cln_cmd_completion},
};
/* clang-format on */
const int cln_command_count = sizeof cln_commands / sizeof cln_commands[0];

#define ON_DEVICE                                                                          \
    (CLN_TRAIN | CLN_EVAL | CLN_RENDER | CLN_VIEW | CLN_EXPORT | CLN_SELFTEST | CLN_TUNE | \
     CLN_CHECK_SCENE)
#define EVERY     (ON_DEVICE | CLN_INFO | CLN_DEVICES | CLN_BUGREPORT | CLN_POSES | CLN_COMPLETION)
#define AT(field) offsetof(cln_options, field)

/* Rows by kind; a row's other members follow its help: .letter, .standard, .shown, .env,
 * .negatable. */
#define ROW(kind_, commands_, name_, field, help_, ...)                                          \
    {                                                                                            \
        .kind = kind_, .commands = commands_, .name = name_, .offset = AT(field), .help = help_, \
        __VA_ARGS__                                                                              \
    }
#define FLAG(commands, name, field, help, ...) \
    ROW(CLN_ARG_FLAG, commands, name, field, help, __VA_ARGS__)
#define COUNT(commands, name, field, help, ...) \
    ROW(CLN_ARG_COUNT, commands, name, field, help, __VA_ARGS__)
#define TEXT(commands, name, field, form, help, ...) \
    ROW(CLN_ARG_TEXT, commands, name, field, help, .value = form, __VA_ARGS__)
#define WORD(commands, name, field, list, help, ...) \
    ROW(CLN_ARG_WORD, commands, name, field, help, .words = list, __VA_ARGS__)
#define NUMBER(kind, commands, name, field, form, low, high, help, ...) \
    ROW(kind, commands, name, field, help, .value = form, .min = low, .max = high, __VA_ARGS__)
#define INT(...)  NUMBER(CLN_ARG_INT, __VA_ARGS__)
#define REAL(...) NUMBER(CLN_ARG_REAL, __VA_ARGS__)

/* clang-format off */
const cln_arg cln_args[] = {
    TEXT(CLN_TRAIN, "output", output, "RUN",
         "folder of the new run; made if it is not there", .letter = 'o'),
    TEXT(CLN_EVAL, "output", output, "DIR",
         "folder for figures and pictures, in place of the run's", .letter = 'o',
         .shown = "RUN/eval"),
    TEXT(CLN_RENDER, "output", output, "DIR",
         "folder for the pictures, or a film of the colours: FILE.mp4, .mov, .mkv, .webm, .gif (by "
         "ffmpeg), or .y4m", .letter = 'o', .shown = "RUN/render/ and SPLIT, orbit, spiral, ..."),
    TEXT(CLN_RENDER, "fps", fps, "N[/D]",
         "film: frames a second, 0.001 to 1000; 23.976, 29.97, 59.94 and 119.88 are 24000/1001 and "
         "so on; 0 = as camera_path.json says (fps, or seconds), or 24", .shown = "0"),
    TEXT(CLN_TUNE, "output", output, "FILE",
         "file to put the row in", .letter = 'o', .shown = "that of --tune-file"),
    TEXT(CLN_CHECK_SCENE, "output", output, "FILE.html",
         "a page that shows cameras, points, photos and the cube, too", .letter = 'o'),
    TEXT(CLN_CHECK_SCENE, "write-mask", write_mask, "FILE.png",
         "draw a mask that is black where something stands in all photos (a logo, bars)"),
    TEXT(CLN_POSES, "output", output, "SCENE",
         "folder of the scene; made if it is not there", .letter = 'o'),
    WORD(CLN_POSES, "match", match, "auto|all|next",
         "which photos to compare: all with all, or each with the next ones; auto: next for more "
         "than 120 frames of a video or numbered photos", .standard = "auto"),
    TEXT(CLN_POSES, "lens", lens, "MODEL",
         "the photos' lens by COLMAP's name of the model: OPENCV_FISHEYE or SIMPLE_RADIAL_FISHEYE "
         "of a fisheye, PINHOLE of undistorted photos; auto: SIMPLE_RADIAL, of 30 photos and more "
         "of a camera OPENCV", .standard = "auto"),
    FLAG(CLN_POSES, "gps", gps,
         "turn, scale and move the scene by the photos' GPS positions (EXIF): metres, x east, y "
         "north, z up"),
    TEXT(CLN_POSES, "mask-path", mask_path, "PATH",
         "a folder of masks, or one picture for all photos: what is black is not looked at, as a "
         "turntable's backdrop, a tripod, a logo; copied to SCENE/masks, where training finds it"),
    INT(CLN_POSES, "frames", frames, "N", 3, 10000,
        "frames to take from a video; all, if it has fewer", .standard = "150"),
    WORD(CLN_TRAIN | CLN_TUNE | CLN_CHECK_SCENE | CLN_INFO, "preset", preset, CLN_PRESETS,
         "defaults of the options below: leaves of voxels; of networks, chosen for a CPU (fast) or "
         "the paper's; or baselines (nerf: one network; kilonerf: a uniform grid of small ones); "
         "`help train --preset NAME` lists its values",
         .standard = CLN_DEFAULT_PRESET),
    TEXT(CLN_TRAIN, "settings-of", settings_of, "RUN",
         "begin a new run with that run's settings, in place of a preset's and cl-nascent.conf's; "
         "options that are given replace them"),
    TEXT(CLN_TRAIN, "resume", resume, "RUN",
         "continue a run with its settings; options that are given replace them; --steps, --epochs "
         "and --time-limit take +N for N more"),
    FLAG(CLN_TRAIN, "resume-or-start", resume_or_start,
         "for jobs that may be begun again: continue the run in -o RUN, as --resume does; begin if "
         "there is none, or one without a checkpoint; if it is done, do nothing"),
    TEXT(ON_DEVICE, "device", device.spec, "SPEC",
         "auto, cpu, gpu, a row number of `cl-nascent devices`, or part of a name",
         .letter = 'd', .standard = "auto", .env = "CL_NASCENT_DEVICE"),
    TEXT(ON_DEVICE, "kernel-dir", device.kernel_dir, "DIR",
         "read the kernels from here instead of from the program", .env = "CL_NASCENT_KERNEL_DIR"),
    TEXT(ON_DEVICE, "tune", device.tune, "LIST",
         "kernel parameters that replace the defaults of the device's class: VW=8,TS=6,...; tune: "
         "where the search begins"),
    TEXT(ON_DEVICE | CLN_DEVICES | CLN_BUGREPORT, "tune-file", device.tune_file, "FILE",
         "your rows of kernel parameters, which take precedence over the program's own",
         .shown = "cl-nascent/tune.txt in $XDG_CONFIG_HOME or ~/.config",
         .env = "CL_NASCENT_TUNE_FILE"),
    TEXT(ON_DEVICE, "max-alloc", device.max_alloc, "SIZE",
         "no buffer larger than this (512K, 64M, 4G), as if the device allowed no more: batches "
         "are cut to it, and arrays with a row per leaf are split into up to four"),
    FLAG(CLN_TRAIN, "skip-selftest", skip_selftest,
         "do not check the kernels on this device first"),
    TEXT(CLN_TRAIN, "dump-program", dump_program, "FILE",
         "write the integer program of each structure decision to this file, in LP format; each "
         "replaces the one before"),

    WORD(CLN_EVAL, "split", split, "train|val|test|all",
         "which views of the scene are measured", .standard = "test"),
    WORD(CLN_RENDER, "split", split, "train|val|test",
         "the poses of these views of the scene", .standard = "test"),
    TEXT(CLN_RENDER, "poses", poses, "FILE.json",
         "the poses of a file instead: nerfstudio's camera_path.json, or transforms JSON, with any "
         "lens and size"),
    TEXT(CLN_EVAL | CLN_RENDER | CLN_VIEW | CLN_EXPORT, "scene", scene, "SCENE",
         "where the scene is now, if it has moved since training"),
    TEXT(CLN_INFO, "like", like, "RUN",
         "of a scene: how long a training would take, at the pace of this run"),
    INT(CLN_EVAL | CLN_RENDER, "max-images", max_images, "N", 0, INT_MAX,
         "only N views, evenly chosen (0 = all)", .standard = "0"),
    TEXT(CLN_EVAL | CLN_RENDER, "views", views, "NAME,...",
         "only the split's views of these photos: a file's name or its path in the scene, with or "
         "without the ending"),
    INT(CLN_EVAL | CLN_RENDER, "antialias", antialias, "N", 1, 8,
         "N x N rays for pixels at edges (default: as in training)"),
    FLAG(CLN_EVAL, "seams", seams,
         "also measure how much colour and alpha change at surfaces from leaf to leaf, and over "
         "the same step inside a leaf"),
    TEXT(CLN_EVAL, "lpips", lpips, "FILE",
         "also measure LPIPS, by the weights of AlexNet or VGG-16 in FILE (man cl-nascent, LPIPS)"),
    FLAG(CLN_EVAL | CLN_RENDER, "fast", fast, "fewer samples: less time, a little more error"),
    TEXT(CLN_EVAL | CLN_RENDER, "device-mem", device.device_mem, "SIZE",
         "device memory to stay under, bytes or 512M, 4G (0 = by the device)",
         .shown = "the run's"),
    TEXT(CLN_RENDER, "crop", crop, "X0,Y0,Z0,X1,Y1,Z1[,RX,RY,RZ]",
         "only what is inside this box, in the scene's own frame and units, turned about its "
         "middle by these degrees about x, then y, then z; the viewer shows the numbers of its "
         "crop box"),
    REAL(CLN_EVAL, "min-psnr", min_psnr, "DB", 0, 200,
         "exit with code 9 if the mean PSNR is below this", .standard = "0"),
    FLAG(CLN_EVAL, "save-images", save_images,
         "write renders, truths, error images and pictures of the tree to RUN/eval/ and show them "
         "in the report", .standard = "yes", .negatable = true),

    NUMBER(CLN_ARG_OPTINT, CLN_RENDER, "orbit", orbit_frames, "FRAMES", 1, 100000,
         "around the scene instead of a split's poses: a circle, or to and fro where the training "
         "cameras cover only an arc", .standard = "60"),
    FLAG(CLN_RENDER, "circle", circle,
         "orbit: all around, also where no training camera was"),
    REAL(CLN_RENDER, "elevation", elevation, "DEG", -90, 90,
         "orbit: degrees above the horizon of the training cameras",
         .shown = "their mean"),
    TEXT(CLN_RENDER | CLN_VIEW, "up", up, "X,Y,Z|z|auto",
         "which way is up, in the scene's frame: an axis (x, y, z, -x, -y, -z) or a vector; of "
         "render: for an orbit, spiral, path or map",
         .shown = "auto, as the training cameras tell"),
    REAL(CLN_RENDER, "radius", radius, "R", 1e-3, 1e3,
         "orbit, spiral: distance, 1 = the training cameras' mean; of a spiral in front of the "
         "scene: its width, 1 = that of the cameras", .standard = "1"),
    NUMBER(CLN_ARG_OPTINT, CLN_RENDER, "spiral", spiral_frames, "FRAMES", 1, 100000,
         "two turns within the training cameras' poses: in front of the scene, or all around, up "
         "and down", .standard = "120"),
    NUMBER(CLN_ARG_OPTINT, CLN_RENDER, "interpolate", interpolate, "FRAMES", 1, 100000,
         "a smooth path through the poses of --split or --poses, or --max-images of them",
         .standard = "120"),
    FLAG(CLN_RENDER, "loop", loop,
         "interpolate: on from the last pose to the first, for a film that is shown again and "
         "again"),
    FLAG(CLN_RENDER, "map", map,
         "a map of the crop box or the cube: from straight above by parallel rays, with a world "
         "file and heights (map.pgw, map.height.asc)"),
    INT(CLN_RENDER, "width", image_width, "PX", 0, 32768,
         "image width; 0 = as the photos, or by --height", .standard = "0"),
    INT(CLN_RENDER, "height", image_height, "PX", 0, 32768,
         "image height; 0 = as the photos, or by --width", .standard = "0"),
    REAL(CLN_RENDER, "fov", fov, "DEG", 0, 175,
         "orbit, spiral, interpolate: horizontal field of view; 0 = that of the training images, "
         "along the shorter side of the picture, or of the path's poses", .standard = "0"),
    TEXT(CLN_RENDER, "frames", frame_range, "A-B",
         "only these of all the frames, counted from 0 as they are listed; A- = to the last one"),
    FLAG(CLN_RENDER, "transparent", transparent,
         "NAME.png with alpha, straight: colours without the background; of films .mov (ProRes "
         "4444) and .webm (VP9)"),
    TEXT(CLN_RENDER, "background", background, "R,G,B|white|black",
         "colour behind everything, numbers 0 to 1; also that around the crop box in a file of "
         "poses", .shown = "the run's"),
    TEXT(CLN_EVAL, "background", background, "R,G,B|white|black",
         "colour behind photos with alpha and their renders, numbers 0 to 1", .shown = "the run's"),
    FLAG(CLN_RENDER, "overwrite", overwrite,
         "replace files that exist; otherwise frames of the same model, cameras and settings are "
         "skipped, other ones and films refused"),
    FLAG(CLN_EXPORT | CLN_CHECK_SCENE, "overwrite", overwrite,
         "replace a file that exists; otherwise it is refused"),
    FLAG(CLN_RENDER, "z-depth", z_depth,
         "depth along the optical axis instead of along the ray"),
    REAL(CLN_RENDER, "stereo", stereo, "D", 0, 1e12,
         "pairs side by side, of eyes D scene units apart; 0 = single pictures", .standard = "0"),
    WORD(CLN_RENDER, "bits", bits, "8|16",
         "of colours and opacity in PNG files", .standard = "8"),
    FLAG(CLN_RENDER, "pfm", pfm,
         "also NAME.depth.pfm"),
    FLAG(CLN_RENDER, "normals", normals,
         "also NAME.normal.npy and NAME.normal.png: the surface's normals, from the depths"),
    FLAG(CLN_RENDER, "seen", seen,
         "also NAME.seen.png: by how many training views what it shows is seen"),
    REAL(CLN_RENDER, "depth-unit", depth_unit, "D", 0, 1e12,
         "also NAME.metric.png: 16-bit grey in steps of D scene units; 0 = no such file",
         .standard = "0"),
    WORD(CLN_RENDER, "depth", depth, "median|mean",
         "what depth is: the point where half of a ray's opacity is reached, or the samples' mean",
         .standard = "median"),

#define X(what, needs, form, help) \
    TEXT(CLN_EXPORT, #what, export_file, form, help, .exports = true),
    CLN_EXPORT_LIST(X)
#undef X
    REAL(CLN_RENDER, "spacing", spacing, "D", 1e-12, 1e12,
         "map: of pixels, in scene units", .shown = "so that the longer side has 800 to 2000"),
    REAL(CLN_EXPORT, "spacing", spacing, "D", 1e-12, 1e12,
         "in scene units: of points, in place of --count; of the grid for a mesh or volume",
         .shown = "mesh: by leaf size and views; volume: a 256th of the cube"),
    INT(CLN_EXPORT, "count", count, "N", 1, 100000000,
         "points: how many", .shown = "200000"),
    FLAG(CLN_EXPORT, "closed", closed,
         "points, mesh: also the parts that no training view sees; the mesh is closed then"),
    TEXT(CLN_EXPORT, "crop", crop, "X0,Y0,Z0,X1,Y1,Z1[,RX,RY,RZ]",
         "points, mesh, volume: only what is inside this box, as for render; with --closed a mesh "
         "ends in the box's faces"),
    TEXT(CLN_EXPORT, "up", up, "X,Y,Z|z|auto",
         "points, mesh: which way is up, in the scene's frame (x, y, z, -x, -y, -z, a vector, or "
         "auto, as the training cameras tell): becomes z in what is written. In GLB y is always "
         "up: by this, or by auto"),
    REAL(CLN_EXPORT, "scale", scale, "N", 1e-12, 1e12,
         "all lengths in what is written times N: 0.001 makes metres, which GLB is in, of "
         "millimetres; of a length that is L in truth and D between two points in the viewer: "
         "L / D",
         .standard = "1"),
    TEXT(CLN_RENDER, "offset", offset, "X,Y,Z",
         "map: added to its coordinates and heights, as of export"),
    TEXT(CLN_EXPORT, "offset", offset, "X,Y,Z",
         "points, mesh: added to the coordinates in .ply and .obj, after --up and --scale: where a "
         "survey's origin is, in UTM say"),
    FLAG(CLN_EXPORT, "largest", largest,
         "points, mesh: only the connected part with the most triangles"),
    INT(CLN_EXPORT, "triangles", triangles, "N", 4, 1000000000,
         "mesh: at most N triangles; those that matter least are left out", .shown = "all"),
    WORD(CLN_EXPORT, "colour", box_colour, "level|error",
         "octree: what the boxes' colours show: the level, or the error on a logarithmic scale",
         .standard = "level"),

    FLAG(CLN_TRAIN, "view", watch,
         "watch and steer the training in a browser, at the address that is printed"),
    REAL(CLN_TRAIN, "view-share", view_share, "PERCENT", 1, 90,
         "most percent of the time that viewing may take from training", .standard = "20"),
    INT(CLN_VIEW | CLN_TRAIN, "port", port, "N", 1, 65535,
        "port to listen on", .shown = "7007, or a free one if that is taken"),
    TEXT(CLN_VIEW | CLN_TRAIN, "listen", listen, "ADDRESS",
         "IP address to listen on, for other machines (0.0.0.0: all of this one's); the "
         "printed address then has a token, without which nothing is answered: on a shared "
         "machine, where all accounts can look, also 127.0.0.1",
         .shown = "127.0.0.1, without a token"),
    FLAG(CLN_VIEW | CLN_TRAIN, "open", open,
         "open the address in this desktop's browser (xdg-open)"),

    FLAG(CLN_DEVICES | CLN_BUGREPORT, "test", test,
         "run the quick self-test on each device", .standard = "yes", .negatable = true),
    REAL(CLN_TUNE, "budget", budget, "SECONDS", 1, 1e6,
         "time to search in (also 90s, 10m, 1:30), building of kernels included; the best set "
         "found by then is kept. The first one always ends",
         .standard = "60", .seconds = true),
    FLAG(CLN_SELFTEST, "quick", quick,
         "only the checks that take about a second; with --extremes, no sorts of over 2^17 keys"),
    FLAG(CLN_SELFTEST, "extremes", extremes,
         "every kernel where numbers are large, tiny, saturated or on an edge: worst error, its "
         "place and its bound (docs/stability.md)"),

    REAL(CLN_CHECK_SCENE, "probe", probe, "SECONDS", 0, 600,
         "time to measure training steps in, for an estimate; 0 = none", .standard = "2",
         .seconds = true),

    FLAG(CLN_TRAIN | CLN_INFO | CLN_CHECK_SCENE, "conf", conf,
         "take settings from cl-nascent.conf beside the scene, if it is there",
         .standard = "yes", .negatable = true),

    FLAG(EVERY & ~(CLN_BUGREPORT | CLN_VIEW | CLN_COMPLETION), "json", json,
         "results as one JSON document on standard output"),
    WORD(CLN_TRAIN | CLN_EVAL | CLN_RENDER | CLN_TUNE | CLN_POSES | CLN_EXPORT | CLN_CHECK_SCENE |
             CLN_DEVICES,
         "progress", progress,
         "auto|bar|line|none",
         "a live line on a terminal, plain lines now and then, or neither", .standard = "auto",
         .env = "CL_NASCENT_PROGRESS"),
    WORD(EVERY, "color", color, "auto|always|never",
         "colour of errors and warnings; auto: on a terminal, unless NO_COLOR is set",
         .standard = "auto"),
    FLAG(EVERY, "quiet", quiet,
         "no log but warnings, no progress", .letter = 'q'),
    COUNT(EVERY, "verbose", verbose,
         "log more", .letter = 'v'),
    FLAG(EVERY, "help", help,
         "this help", .letter = 'h'),
    FLAG(EVERY, "version", version,
         "the program's version; with -v also those of libraries and drivers", .letter = 'V'),
};
/* clang-format on */
const int cln_arg_count = sizeof cln_args / sizeof cln_args[0];
_Static_assert(sizeof cln_args / sizeof cln_args[0] <= CLN_ARGS_MAX, "parser keeps a flag per row");

/* ---- names ---- */

bool cln_command_takes_arg(const cln_command *command, const cln_arg *arg)
{
    return (arg->commands & (command ? command->bit : EVERY)) != 0;
}

bool cln_command_takes_row(const cln_command *command, const cln_config_row *row)
{
    switch (command ? command->bit : 0) {
    case CLN_TRAIN:
    case CLN_CHECK_SCENE:
        return true;
    case CLN_INFO:
        return row->flags & CLN_ROW_SCENE;
    case CLN_TUNE:
        return row->flags & CLN_ROW_TUNE;
    default:
        return false;
    }
}

const cln_arg *cln_arg_find(const cln_command *command, const char *name, size_t length)
{
    for (int i = 0; i < cln_arg_count; i++) {
        const cln_arg *arg = &cln_args[i];
        if (cln_command_takes_arg(command, arg) && strlen(arg->name) == length &&
            memcmp(arg->name, name, length) == 0)
            return arg;
    }
    return NULL;
}

const cln_arg *cln_arg_find_letter(const cln_command *command, char letter)
{
    for (int i = 0; i < cln_arg_count; i++) {
        if (cln_command_takes_arg(command, &cln_args[i]) && cln_args[i].letter == letter)
            return &cln_args[i];
    }
    return NULL;
}

const cln_config_row *cln_row_find(const cln_command *command, const char *name, size_t length)
{
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        if (cln_command_takes_row(command, row) && cln_config_named(row, name, length))
            return row;
    }
    return NULL;
}

const cln_command *cln_command_find(const char *name)
{
    for (int i = 0; i < cln_command_count; i++) {
        if (strcmp(cln_commands[i].name, name) == 0)
            return &cln_commands[i];
    }
    return NULL;
}

/* ---- errors ---- */

/* Keeps the nearer of *best and candidate. */
static void consider(const char *name, const char *candidate, int *distance, const char **best)
{
    int d = cln_edit_distance(name, candidate);

    if (d < *distance) {
        *distance = d;
        *best = candidate;
    }
}

/* Suggestions have fewer edits than this: at most 3, and of short names half their characters. */
static int limit_for(size_t length)
{
    return length >= 6 ? 4 : (int)length / 2 + 1;
}

/* Adds "--name" to a list in words; the last of more than eight is "...". */
static void add_name(const char *name, int *count, char *out, size_t bytes)
{
    const size_t used = strlen(out);

    ++*count;
    if (*count <= 8)
        snprintf(out + used, bytes - used, "%s--%s", used ? ", " : "", name);
    else if (*count == 9)
        snprintf(out + used, bytes - used, ", ...");
}

/* Lists the options that begin with this name, as abbreviations do; "" if none does. */
static void list_longer(const cln_command *command, const char *name, char *out, size_t bytes)
{
    const size_t length = strlen(name);
    int count = 0;

    out[0] = 0;
    for (int i = 0; i < cln_arg_count && length > 2; i++)
        if (cln_command_takes_arg(command, &cln_args[i]) &&
            strncmp(cln_args[i].name, name, length) == 0)
            add_name(cln_args[i].name, &count, out, bytes);
    for (int i = 0; i < cln_config_row_count && length > 2; i++)
        if (cln_command_takes_row(command, &cln_config_rows[i]) &&
            strncmp(cln_config_rows[i].option, name, length) == 0)
            add_name(cln_config_rows[i].option, &count, out, bytes);
}

/* Our name of an option that other programs call `name`: an option, with a value where theirs has
 * none, or in capitals an argument that has none. */
static const char *name_elsewhere(const cln_command *command, const char *name)
{
    static const struct {
        const char *theirs, *ours; /* "-" for "_" */
    } rows[] = {{"iterations", "steps"},
                {"iters", "steps"},
                {"n-iters", "steps"},
                {"max-iterations", "steps"},
                {"max-steps", "steps"},
                {"num-steps", "steps"},
                {"n-steps", "steps"},
                {"max-num-iterations", "steps"},
                {"auto-resume", "resume-or-start"},
                {"learning-rate", "lr"},
                {"lrate", "lr"},
                {"batch-size", "rays"},
                {"batch", "rays"},
                {"layers", "depth"},
                {"n-layers", "depth"},
                {"num-layers", "depth"},
                {"num-rays", "rays"},
                {"n-rand", "rays"},
                {"gpu", "device"},
                {"cuda", "device"},
                {"factor", "downscale"},
                {"data-factor", "downscale"},
                {"downscale-factor", "downscale"},
                {"max-resolution", "downscale"},
                {"images", "downscale"},
                {"resolution", "downscale"},
                {"downsample", "downscale"},
                {"llffhold", "holdout"},
                {"test-hold", "holdout"},
                {"test-every", "holdout"},
                {"eval-split-every", "holdout"},
                {"eval-interval", "holdout"},
                {"eval", "holdout 8"},
                {"depths", "depth-loss"},
                {"white-background", "background"},
                {"aabb", "bbox"},
                {"near-plane", "near"},
                {"no-ndc", "space cube"},
                {"ndc", "space ndc"},
                {"camera-path", "poses"},
                {"camera-path-filename", "poses"},
                {"path", "interpolate"},
                {"trajectory", "orbit"},
                {"traj", "orbit"},
                {"masks", "mask-path"},
                {"mask-dir", "mask-path"},
                {"size", "width"},
                {"resolution", "width"},
                {"res", "width"},
                {"quality", "antialias"},
                {"samples", "antialias"},
                {"supersample", "antialias"},
                {"force", "overwrite"},
                {"ply", "points"},
                {"glb", "mesh"},
                {"gltf", "mesh"},
                {"obj", "mesh"},
                {"stl", "mesh"},
                {"tsdf", "mesh"},
                {"poisson", "mesh"},
                {"splat", "points"},
                {"keep-lcc", "largest"},
                {"data", "SCENE"},
                {"datadir", "SCENE"},
                {"data-dir", "SCENE"},
                {"source-path", "SCENE"},
                {"input", "SCENE"},
                {"scene", "SCENE"},
                {"model-path", "RUN"},
                {"load-config", "RUN"},
                {"checkpoint", "RUN"},
                {"ckpt", "RUN"},
                {"run", "RUN"},
                {"model-path", "output"},
                {"output-dir", "output"},
                {"output-path", "output"},
                {"expname", "output"},
                {"workspace", "output"},
                {"mp4", "output"},
                {"film", "output"},
                {"video", "output"},
                {"seconds", "fps"},
                {"duration", "fps"},
                {"out", "output"}};
    char plain[64];

    snprintf(plain, sizeof plain, "%s", name);
    for (char *c = plain; *c; c++)
        *c = *c == '_' ? '-' : *c;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const char *ours = rows[i].ours;
        const size_t n = strcspn(ours, " ");

        if (strcmp(plain, rows[i].theirs) == 0 &&
            (cln_arg_find(command, ours, n) || cln_row_find(command, ours, n) ||
             (command->operand && strstr(command->operand, ours))))
            return ours;
    }
    return NULL;
}

cln_status cln_fail_output(void)
{
    return cln_fail(CLN_USAGE, "export has no --output, -o: the file's name stands behind what is "
                               "written, as in --mesh FILE.ply");
}

/* Fails for an option of other commands: `bits` says whose. */
static cln_status fail_of_others(const cln_command *command, const char *name, unsigned bits)
{
    const char *here = name_elsewhere(command, name);
    char owners[128] = "";

    if (strcmp(name, "scene") == 0 && command->operand && strstr(command->operand, "SCENE"))
        return cln_fail(CLN_USAGE,
                        "--scene is not an option of %s; SCENE needs none: `cl-nascent %s%s"
                        " SCENE`",
                        command->name, command->name,
                        command->bit == CLN_TRAIN ? " --resume RUN" : "");
    if (strcmp(name, "output") == 0 && command->bit == CLN_EXPORT)
        return cln_fail_output();
    for (int i = 0; i < cln_command_count; i++) {
        const size_t used = strlen(owners);

        if (bits & cln_commands[i].bit)
            snprintf(owners + used, sizeof owners - used, "%s%s", used ? ", " : "",
                     cln_commands[i].name);
    }
    return cln_fail(CLN_USAGE, "--%s is not an option of %s, only of %s%s%s%s", name, command->name,
                    owners, here ? "; did you mean --" : "", here ? here : "", here ? "?" : "");
}

/* The command's option that a name resembles by at most so many edits, NULL without one; off: the
 * name stood behind "no-". */
static const char *nearest_option(const cln_command *command, const char *name, bool off,
                                  int distance)
{
    const char *best = NULL;

    for (int i = 0; i < cln_arg_count; i++) {
        if (cln_command_takes_arg(command, &cln_args[i]) && (!off || cln_args[i].negatable))
            consider(name, cln_args[i].name, &distance, &best);
    }
    for (int i = 0; i < cln_config_row_count; i++) {
        if (cln_command_takes_row(command, &cln_config_rows[i]) &&
            (!off || cln_config_is_switch(&cln_config_rows[i])))
            consider(name, cln_config_rows[i].option, &distance, &best);
    }
    return best;
}

/* Fails for a name that is in no table of this command: says which commands have it, or which name
 * it resembles. */
cln_status cln_fail_option(const cln_command *command, const char *name, size_t length)
{
    char wanted[64], longer[256];
    const char *best = NULL, *plain = wanted;
    const cln_arg *arg = NULL;
    unsigned bits = 0;
    bool off = false;

    snprintf(wanted, sizeof wanted, "%.*s", (int)length, name);
    for (int i = 0; i < cln_command_count; i++) {
        if (cln_arg_find(&cln_commands[i], name, length) ||
            cln_row_find(&cln_commands[i], name, length))
            bits |= cln_commands[i].bit;
    }
    if (bits && command)
        return fail_of_others(command, wanted, bits);
    if (length == 1 && cln_arg_find_letter(command, *name))
        return cln_fail(CLN_USAGE, "unknown option --%s; did you mean -%s?", wanted, wanted);
    best = name_elsewhere(command, wanted);
    if (best && *best <= 'Z')
        return cln_fail(CLN_USAGE, "unknown option --%s; %s needs none: `cl-nascent %s %s`", wanted,
                        best, command->name, best);
    if (best)
        return cln_fail(CLN_USAGE, "unknown option --%s; did you mean --%s?", wanted, best);
    if (strcmp(wanted, "threads") == 0 || strcmp(wanted, "num-threads") == 0 ||
        strcmp(wanted, "cores") == 0 || strcmp(wanted, "workers") == 0)
        return cln_fail(
            CLN_USAGE,
            "unknown option --%s; `taskset -c 0 cl-nascent ...` keeps the program, and a "
            "device that is the processor, on one core",
            wanted);
    off = strncmp(wanted, "no-", 3) == 0;
    plain += off ? 3 : 0;
    for (int i = 0; i < cln_command_count && off; i++)
        if (cln_row_find(&cln_commands[i], plain, strlen(plain)))
            bits |= cln_commands[i].bit;
    if (bits && command && !(bits & command->bit))
        return fail_of_others(command, wanted, bits);
    arg = off ? cln_arg_find(command, plain, strlen(plain)) : NULL;
    if (arg && arg->kind == CLN_ARG_FLAG)
        return cln_fail(CLN_USAGE,
                        "unknown option --%s: --%s is off unless it is given; leave it out", wanted,
                        plain);
    if (arg || (off && cln_row_find(command, plain, strlen(plain))))
        return cln_fail(CLN_USAGE,
                        "unknown option --%s: --%s is not a switch; leave it out, or give "
                        "it a value",
                        wanted, plain);
    list_longer(command, wanted, longer, sizeof longer);
    if (*longer)
        return cln_fail(CLN_USAGE, "unknown option --%s; did you mean %s?", wanted, longer);
    best = nearest_option(command, plain, off, limit_for(length));
    if (best)
        return cln_fail(CLN_USAGE, "unknown option --%s; did you mean --%s%s?", wanted,
                        off ? "no-" : "", best);
    return cln_fail(CLN_USAGE, "unknown option --%s", wanted);
}

const char *cln_command_of_option(const char *name)
{
    const size_t length = strcspn(name += strspn(name, "-"), "=");

    for (int i = 0; i < cln_command_count; i++)
        if (cln_arg_find(&cln_commands[i], name, length) ||
            cln_row_find(&cln_commands[i], name, length))
            return cln_commands[i].name;
    if (strncmp(name, "no-", 3) != 0)
        return NULL;
    for (int i = 0; i < cln_command_count; i++) {
        const cln_arg *arg = cln_arg_find(&cln_commands[i], name + 3, length - 3);
        const cln_config_row *row = cln_row_find(&cln_commands[i], name + 3, length - 3);

        if (arg ? arg->negatable : row && cln_config_is_switch(row))
            return cln_commands[i].name;
    }
    return NULL;
}

cln_status cln_fail_command(const char *name)
{
    static const char *const others[][2] = {
        /* what other programs have */
        {"resume", "a run goes on with train --resume RUN"},
        {"continue", "a run goes on with train --resume RUN"},
        {"runs", "info RUN RUN compares runs"},
        {"compare", "info RUN RUN compares runs"},
        {"report", "train and eval write RUN/report.html"},
        {"film", "render RUN --orbit -o FILE.mp4 makes one"},
        {"video", "render RUN --orbit -o FILE.mp4 makes one, poses VIDEO -o SCENE takes one"},
        {"viewer", "view RUN opens it in a browser"},
        {"test", "eval RUN measures its test views, selftest the device"}};
    const char *best = NULL;
    int distance = limit_for(strlen(name));

    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++)
        if (strcmp(name, others[i][0]) == 0)
            return cln_fail(CLN_USAGE, "unknown command '%s'; %s", name, others[i][1]);
    for (int i = 0; i < cln_command_count; i++)
        consider(name, cln_commands[i].name, &distance, &best);
    for (int i = 0; i < cln_command_count && !best && strlen(name) >= 3; i++)
        if (strncmp(cln_commands[i].name, name, strlen(name)) == 0)
            best = cln_commands[i].name;
    if (!best && cln_command_of_option(name))
        return cln_fail(CLN_USAGE,
                        "unknown command '%s'; --%s is an option: `cl-nascent help --%s` tells",
                        name, name + strspn(name, "-"), name + strspn(name, "-"));
    if (best)
        return cln_fail(CLN_USAGE, "unknown command '%s'; did you mean '%s'?", name, best);
    return cln_fail(CLN_USAGE,
                    "unknown command '%s'; `cl-nascent help` lists them, and the manual "
                    "explains words (man cl-nascent)",
                    name);
}

cln_status cln_fail_before_command(const char *argument)
{
    static const char *const alone[] = {"version", "help", "verbose"};
    const char *name = argument + strspn(argument, "-"), *option = NULL, *command = NULL;
    int distance = limit_for(strlen(name));

    if (cln_command_of_option(name))
        return cln_fail(CLN_USAGE, "%s: options come after the command", argument);
    for (size_t i = 0; i < sizeof alone / sizeof alone[0]; i++)
        consider(name, alone[i], &distance, &option);
    for (int i = 0; i < cln_command_count; i++)
        consider(name, cln_commands[i].name, &distance, &command);
    if (command)
        return cln_fail(CLN_USAGE, "%s: commands have no dashes; did you mean `cl-nascent %s`?",
                        argument, command);
    if (option)
        return cln_fail(CLN_USAGE, "unknown option %s; did you mean --%s?", argument, option);
    return cln_fail(CLN_USAGE, "%s: options come after the command", argument);
}
