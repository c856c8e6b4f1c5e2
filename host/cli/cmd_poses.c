/* `cl-nascent poses`: photos or a video -> cln_find_poses, what was registered, and what to
 * type next. */
#include "cli/commands.h"

#include <stdio.h>
#include "base/text.h"
#include "cli/console.h"

cln_status cln_cmd_poses(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_console console = {0};
    cln_poses_result r = {0};
    cln_poses_desc desc = {.photos = options->operand,
                           .out = options->output,
                           .match = options->match,
                           .lens = options->lens,
                           .frames = options->frames};
    char quoted[CLN_QUOTED_BYTES];

    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    CLN_TRY(cln_find_poses(&desc, &r));
    cln_console_close(&console);
    if (options->json) {
        CLN_TRY(cln_print_json(json_pack(
            "{s:s, s:s, s:i, s:i, s:i}", "schema", "cl-nascent.poses/1", "scene", options->output,
            "photos", r.photos, "registered", r.registered, "focal_lengths", r.focal_lengths)));
        goto done;
    }
    cln_shell_quote(options->output, quoted, sizeof quoted);
    printf("scene       %s\n", options->output);
    printf("registered  %d of %d photos\n", r.registered, r.photos);
    printf("next        cl-nascent check %s\n", quoted);
    printf("            cl-nascent train %s -o RUN --time-limit 10m\n", quoted);
done:
    cln_console_close(&console);
    return st;
}
