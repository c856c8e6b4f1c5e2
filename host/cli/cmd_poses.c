/* `cl-nascent poses`: photos or a video -> cln_find_poses, what was registered, and what to
 * type next. */
#include "cli/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "base/text.h"
#include "cli/conf.h"
#include "cli/console.h"

/* Does cl-nascent.conf beside the scene have a cube, which was told of the coordinates before? */
static bool has_cube(const char *scene)
{
    bool *overridden = NULL, has = false;
    cln_settings *settings = NULL;
    char *said = NULL;

    if (cln_alloc(&overridden, (size_t)cln_config_row_count, sizeof *overridden, scene) == CLN_OK &&
        cln_settings_create(NULL, &settings) == CLN_OK &&
        cln_conf_read(scene, overridden, true, settings, &said) == CLN_OK)
        has = cln_settings_given(settings, cln_config_find("bbox"));
    cln_clear_error(); /* train will say it */
    cln_settings_free(settings);
    free(overridden);
    free(said);
    return has;
}

cln_status cln_cmd_poses(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_console console = {0};
    cln_poses_result r = {0};
    cln_poses_desc desc = {.photos = options->operand,
                           .out = options->output,
                           .match = options->match,
                           .lens = options->lens,
                           .gps = options->gps,
                           .masks = options->mask_path,
                           .frames = options->frames};
    char quoted[CLN_QUOTED_BYTES];

    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    CLN_TRY(cln_find_poses(&desc, &r));
    cln_console_close(&console);
    if (options->json) {
        json_t *origin =
            r.placed ? json_pack("{s:f, s:f, s:f, s:f, s:i, s:f, s:f, s:f}", "latitude",
                                 r.origin[0], "longitude", r.origin[1], "height", r.origin[2],
                                 "gps_distance", r.gps_distance, "gps_used", r.gps_used, "up_sd",
                                 r.up_sd, "north_sd", r.north_sd, "length_sd", r.length_sd)
                     : json_null();

        CLN_TRY(cln_print_json(json_pack(
            "{s:s, s:s, s:i, s:i, s:i, s:i, s:o}", "schema", "cl-nascent.poses/1", "scene",
            options->output, "photos", r.photos, "registered", r.registered, "focal_lengths",
            r.focal_lengths, "gps_photos", r.gps_photos, "origin", origin)));
        goto done;
    }
    cln_shell_quote(options->output, quoted, sizeof quoted);
    printf("scene       %s\n", options->output);
    printf("registered  %d of %d photos\n", r.registered, r.photos);
    if (r.placed) {
        char origin[96];

        cln_format(origin, sizeof origin, "latitude %.8f, longitude %.8f, height %.3f", r.origin[0],
                   r.origin[1], r.origin[2]);
        printf("origin      %s\n", origin);
        printf(
            "            metres east, north and up from there, the middle of the cameras; half of "
            "them are\n            within %.2f m of their GPS positions\n"
            "accuracy    by %d positions: up is known to about %.2g degrees, north to %.2g, length "
            "to %.2g %%\n",
            r.gps_distance, r.gps_used, fmax(r.up_sd, 0.01), fmax(r.north_sd, 0.01),
            fmax(100 * r.length_sd, 0.01));
        if (has_cube(options->output))
            printf(
                "            the bbox in its cl-nascent.conf is of the coordinates before; give it "
                "anew\n");
    }
    printf("next        cl-nascent check %s\n", quoted);
    printf("            cl-nascent train %s -o RUN --time-limit 10m\n", quoted);
done:
    cln_console_close(&console);
    return st;
}
