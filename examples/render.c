/* Renders an orbit around a trained scene: colour, depth and opacity as files.
 *   cc render.c $(pkg-config --cflags --libs cl-nascent) -o render
 *   ./render RUN FOLDER [FRAMES]
 * Existing frames are skipped, so an interrupted call can be repeated. */
#include <cl_nascent.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static void progress(const char *what, int done, int total, void *user)
{
    (void)user;
    printf("%s: %d of %d\n", what, done, total);
}

int main(int argc, char **argv)
{
    cln_render_desc desc = {.orbit_elevation = NAN, /* as the photos were taken */
                            .width = 64,            /* the height follows the photos' shape */
                            .callbacks = {.work = progress}};
    cln_render_result result;
    cln_status st = CLN_OK;

    if (argc < 3) {
        fprintf(stderr, "usage: %s RUN FOLDER [FRAMES]\n", argv[0]);
        return 2;
    }
    desc.run = argv[1];
    desc.out = argv[2];
    desc.orbit_frames = argc > 3 ? atoi(argv[3]) : 8;
    st = cln_render(&desc, &result);
    if (st != CLN_OK) {
        fprintf(stderr, "%s: %s\n", argv[0], cln_error_text());
        return cln_status_exit_code(st);
    }
    printf("%d frames in %.1f s; %d existed already\n", result.rendered, result.seconds,
           result.skipped);
    return 0;
}
