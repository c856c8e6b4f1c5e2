/* A parsed command line. The tables of option_table.h say where each option goes, parse.h fills
 * it. */
#ifndef CLN_OPTIONS_H
#define CLN_OPTIONS_H

#include "cl_nascent.h"

struct cln_command;

typedef struct cln_options {
    const struct cln_command *command; /* NULL with help or version of the whole program */
    bool help, version;
    const char *operand;   /* SCENE or RUN as given; NULL without */
    const char **operands; /* all that were given */
    int operand_count;
    char *line;      /* the whole command line, quoted for a shell */
    char *tune_path; /* file of the user's tuning rows, which may not exist; NULL = no home */

    const char *output, *write_mask, *settings_of, *resume, *scene, *like, *preset, *split,
        *progress, *color;
    const char *help_option; /* help: which alone is told; NULL = all of the command */
    const char *help_preset; /* help: whose values; NULL = an option's in several presets */
    const char *dump_program, *match, *lens, *mask_path, *views, *lpips;
    const char *box_colour;                /* export --octree: "level" or "error" */
    const char *export_what, *export_file; /* "mesh", FILE */
    cln_device_desc device;
    bool conf;            /* cl-nascent.conf beside the scene is read */
    char *conf_said;      /* for the log: its settings, or what --resume leaves out; may be NULL */
    bool resume_or_start; /* if there is a run to go on, `resume` is its folder, `output` NULL */
    bool circle, map, gps, fast, json, quiet, test, quick, extremes, skip_selftest, save_images,
        overwrite, z_depth, seams;
    int verbose, max_images, antialias, frames;
    int orbit_frames, spiral_frames, interpolate; /* 0 = none */
    const char *poses, *depth, *crop, *up, *offset;
    bool pfm, normals, seen, transparent;
    const char *frame_range, *fps, *background, *bits;
    double elevation, radius, fov, depth_unit, stereo, min_psnr, budget, probe, scale;
    double spacing;       /* 0 = not given */
    int count, triangles; /* 0 = not given */
    bool closed, largest, loop;
    int image_width, image_height;
    const char *listen;
    int port;
    bool open, watch;
    double view_share; /* percent */

    /* Of train, check, info and tune: the preset or resumed run, then the options given. */
    cln_settings *settings;
} cln_options;

#endif
