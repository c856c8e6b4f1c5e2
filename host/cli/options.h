/* What a command line means: the parser over the tables of option_table.h. Options stand after the
 * command, in any order; of a repeated one the last counts. The only place that reads the
 * environment. Calls no part of the library but the settings. */
#ifndef CLN_OPTIONS_H
#define CLN_OPTIONS_H

#include "cl_nascent.h"
#include "cli/option_table.h"

typedef struct cln_options {
    const cln_command *command; /* NULL with help or version of the whole program */
    bool help, version;
    const char *operand; /* SCENE or RUN as given; NULL without */
    char *line;          /* the whole command line, quoted for a shell */
    char *tune_path;     /* the user's rows, there or not; NULL without a home */

    const char *output, *resume, *scene, *preset, *split, *progress;
    const char *dump_program, *colour;
    const char *export_what, *export_file; /* "octree" */
    cln_device_desc device;
    bool json, quiet, test, quick, skip_selftest, save_images, overwrite, z_depth;
    int verbose, max_images;
    int orbit_frames; /* 0 = no orbit */
    double elevation, radius, fov, min_psnr, budget;
    int image_width, image_height;

    cln_settings *settings; /* train, info, tune: preset or resumed run, then the options given */
} cln_options;

/* Reads a command line into *out, which the caller frees also on failure. CLN_USAGE sentences name
 * the option and what is legal; a name that does not exist brings the nearest one that does. Errors
 * of reading the run of --resume pass through. */
cln_status cln_options_parse(int argc, char **argv, cln_options *out);
void cln_options_free(cln_options *options);

#endif
