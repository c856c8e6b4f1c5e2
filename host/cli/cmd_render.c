/* `cl-nascent render`: frames into a folder, by default one of the run's own. */
#include "cli/commands.h"

#include <ctype.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/memory.h"
#include "base/text.h"
#include "cli/console.h"
#include "io/film.h"
#include "io/json.h"
#include "ranks/ranks.h"
#include "render/crop.h"
#include "render/up.h"

/* RUN/render/ with the split, "orbit", "spiral", "map", or "poses-" and the name of the file of
 * poses, which may be that of a split; "-path" is added for a path through poses. */
static cln_status standard_folder(const cln_options *options, char **out)
{
    const char *name = options->poses ? cln_last_name(options->poses) : NULL;
    const char *dot = name ? strrchr(name, '.') : NULL;
    const int length = dot && dot > name ? (int)(dot - name) : name ? (int)strlen(name) : 0;

    if (options->orbit_frames > 0 || options->spiral_frames > 0 || options->map)
        return cln_asprintf(out, "%s/render/%s", options->operand,
                            options->map                ? "map"
                            : options->orbit_frames > 0 ? "orbit"
                                                        : "spiral");
    return cln_asprintf(out, "%s/render/%s%.*s%s", options->operand, name ? "poses-" : "",
                        name ? length : (int)strlen(options->split), name ? name : options->split,
                        options->interpolate ? "-path" : "");
}

/* "A-B", "A-" or "A". */
static cln_status read_range(const char *text, cln_render_desc *out)
{
    char *end = NULL;
    long first = 0, last = 0;
    bool open = false;

    if (!text)
        return CLN_OK;
    first = last = strtol(text, &end, 10);
    if (*end == '-' && !end[1]) {
        open = true;
        end++;
    } else if (*end == '-' && isdigit((unsigned char)end[1])) {
        last = strtol(end + 1, &end, 10);
    }
    if (*end || !isdigit((unsigned char)*text) || (!open && last < first) || first > INT_MAX - 1 ||
        last > INT_MAX - 1)
        return cln_fail(CLN_USAGE,
                        "--frames %s: give numbers of frames, from 0, as 100-120, 100- or 100",
                        text);
    out->first_frame = (int)first;
    out->frame_count = open ? 0 : (int)(last - first) + 1;
    return CLN_OK;
}

static cln_status read_rate(const char *text, double *fps)
{
    if (!text || strcmp(text, "0") == 0)
        return CLN_OK;
    if (!cln_film_read_rate(text, fps))
        return cln_fail(CLN_USAGE,
                        "--fps %s: give frames a second, %g to 1000, as 25, 23.976 or 30000/1001",
                        text, CLN_FILM_LEAST_FPS);
    return CLN_OK;
}

/* out: the folder or film that was written. */
static cln_status print_result(const cln_options *options, const char *out,
                               const cln_render_result *result)
{
    char duration[32];

    if (options->json)
        return cln_print_json(json_pack(
            "{s:s s:s s:s s:i s:i s:o s:o s:o}", "schema", "cl-nascent.render/1", "run",
            options->operand, "out", out, "rendered", result->rendered, "skipped", result->skipped,
            "seconds", cln_json_real(result->seconds), "unseen", cln_json_real(result->unseen),
            "hardly_seen", cln_json_real(result->hardly_seen)));
    cln_format_duration(result->seconds, duration);
    printf("%s: %d rendered in %s", out, result->rendered, duration);
    if (result->skipped)
        printf(", %d left as %s (--overwrite renders all again)", result->skipped,
               cln_plural(result->skipped, "it is", "they are"));
    putchar('\n');
    if (!isnan(result->unseen))
        printf("%.3g %% of what they show is seen by no training view, %.3g %% by fewer than three "
               "(NAME.seen.png, render.json)\n",
               100 * result->unseen, 100 * result->hardly_seen);
    return CLN_OK;
}

cln_status cln_cmd_render(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_console console = {0};
    cln_render_result result = {0};
    char *standard_out = NULL, *plain = NULL;
    float background[3] = {0};
    const bool path = options->orbit_frames > 0 || options->spiral_frames > 0 || options->map;
    cln_render_desc desc = {.run = options->operand,
                            .out = options->output,
                            .scene = options->scene,
                            .poses = options->poses,
                            .split = path || options->poses ? NULL : options->split,
                            .interpolate = options->interpolate,
                            .loop = options->loop,
                            .spiral_frames = options->spiral_frames,
                            .orbit_frames = options->orbit_frames,
                            .orbit_elevation = options->elevation,
                            .orbit_circle = options->circle,
                            .orbit_radius = options->radius,
                            .map = options->map,
                            .spacing = options->spacing,
                            .width = options->image_width,
                            .height = options->image_height,
                            .fov = options->fov,
                            .max_images = options->max_images,
                            .views = options->views,
                            .antialias = options->antialias,
                            .fast = options->fast,
                            .overwrite = options->overwrite,
                            .z_depth = options->z_depth,
                            .pfm = options->pfm,
                            .stereo = options->stereo,
                            .normals = options->normals,
                            .seen = options->seen,
                            .transparent = options->transparent,
                            .depth_unit = options->depth_unit,
                            .bits = strcmp(options->bits, "16") == 0 ? 16 : 8,
                            .mean_depth = strcmp(options->depth, "mean") == 0,
                            .device = options->device};

    CLN_TRY(cln_crop_of_option(options->crop, &desc.cropped, desc.crop, desc.crop_turn));
    if (options->offset && !cln_reals_read(options->offset, 3, desc.offset))
        CLN_TRY(cln_fail(CLN_USAGE, "--offset: '%s' is not three numbers X,Y,Z", options->offset));
    CLN_TRY(read_range(options->frame_range, &desc));
    CLN_TRY(read_rate(options->fps, &desc.fps));
    if (options->background)
        CLN_TRY(cln_background_read(options->background, "", background));
    desc.background = options->background ? background : NULL;
    if (options->up)
        CLN_TRY(cln_up_read("--up", options->up, desc.up));
    if (!desc.out) {
        CLN_TRY(standard_folder(options, &standard_out));
        desc.out = standard_out;
    }
    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    st = cln_render(&desc, &result);
    cln_console_close(&console);
    if (st != CLN_OK || cln_ranks_me() > 0)
        goto done;
    if (result.plain_film) {
        CLN_TRY(
            cln_asprintf(&plain, "%.*s.y4m", (int)(strrchr(desc.out, '.') - desc.out), desc.out));
        desc.out = plain;
    }
    CLN_TRY(print_result(options, desc.out, &result));
done:
    cln_console_close(&console);
    free(standard_out);
    free(plain);
    return st;
}
