/* build/bench-floaters: opacity where a generated scene is known to be empty, for docs/results.md.
 *
 *   bench-floaters SCENE RUN...
 *
 * SCENE is one that make-scene wrote with --depth. Along rays of its test views, GRID x GRID a
 * view, the run's density is integrated from the camera to SHARE of the true depth. Prints a line
 * per run: the mean opacity there, the share of rays on which it is above a half (a floater hides
 * the scene), and the mean within the first tenth of the way, before the lens; for rays that end in
 * the run's cube, then for those that end beyond it, whose depth photos barely show. Exit status as
 * cl-nascent's. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cl_nascent.h"
#include "base/config.h"
#include "base/memory.h"
#include "io/npy.h"
#include "scene/scene.h"

enum { GRID = 24, STEPS = 256 };
static const double SHARE = 0.9;

static const char usage[] = "usage: bench-floaters SCENE RUN...\n";

typedef struct sums {
    double rays, opacity, hidden, first;
} sums;

/* Points of a ray, denser near the camera: at share (k / STEPS)^2 of `end`. */
static cln_status add_ray(cln_field *field, const double o[3], const double d[3], double end,
                          sums *out)
{
    cln_status st = CLN_OK;
    double at[STEPS][3], depth = 0, first = 0;
    float towards[STEPS][3], sigma[STEPS];

    for (int k = 0; k < STEPS; k++) {
        const double s = end * (k + 0.5) * (k + 0.5) / STEPS / STEPS;

        for (int a = 0; a < 3; a++) {
            at[k][a] = o[a] + s * d[a];
            towards[k][a] = (float)d[a];
        }
    }
    CLN_TRY(cln_field_at(field, STEPS, (const double(*)[3])at, (const float(*)[3])towards, NULL,
                         sigma));
    for (int k = 0; k < STEPS; k++) {
        depth += sigma[k] * end * (2 * k + 1) / STEPS / STEPS;
        if ((double)(k + 1) * (k + 1) <= 0.1 * STEPS * STEPS)
            first = depth;
    }
    out->rays++;
    out->opacity -= expm1(-depth);
    out->hidden += depth > log(2);
    out->first -= expm1(-first);
done:
    return st;
}

/* sums: [2], of rays that end in the cube, and beyond it. */
static cln_status add_view(cln_field *field, const cln_view *view, sums *out)
{
    cln_status st = CLN_OK;
    char *path = NULL, *dot = NULL;
    float *depth = NULL;
    int dims = 0, shape[4];

    CLN_TRY(cln_asprintf(&path, "%s.depth.npy", view->path));
    dot = strstr(path, ".png.depth");
    if (dot)
        memmove(dot, dot + 4, strlen(dot + 4) + 1);
    CLN_TRY(cln_npy_read_f32(path, &dims, shape, &depth));
    if (dims != 2 || shape[0] != view->camera.height || shape[1] != view->camera.width)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: the depth map is not as large as its photo", path));
    for (int i = 0; i < GRID * GRID; i++) {
        const int x = (int)((i % GRID + 0.5) / GRID * shape[1]);
        const int y = (int)((i / GRID + 0.5) / GRID * shape[0]);
        const double end = depth[y * shape[1] + x];
        double o[3], d[3], min[3], max[3];
        bool beyond = false;

        if (!(end > 0 && cln_camera_ray(&view->camera, x + 0.5, y + 0.5, o, d)))
            continue;
        cln_field_box(field, min, max);
        for (int a = 0; a < 3; a++)
            beyond = beyond || o[a] + end * d[a] < min[a] || o[a] + end * d[a] > max[a];
        CLN_TRY(add_ray(field, o, d, SHARE * end, &out[beyond]));
    }
done:
    free(path);
    free(depth);
    return st;
}

static cln_status measure(const cln_scene *scene, const char *run)
{
    cln_status st = CLN_OK;
    cln_field *field = NULL;
    sums sum[2] = {{0}};

    CLN_TRY(cln_field_open(run, NULL, &field));
    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TEST); i++)
        CLN_TRY(
            add_view(field, &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TEST, i)], sum));
    for (int beyond = 0; beyond < 2; beyond++)
        printf("| %s | %s | %.0f | %.4f | %.2f %% | %.4f |\n", run, beyond ? "beyond" : "cube",
               sum[beyond].rays, sum[beyond].opacity / sum[beyond].rays,
               100 * sum[beyond].hidden / sum[beyond].rays, sum[beyond].first / sum[beyond].rays);
done:
    cln_field_close(field);
    return st;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;
    cln_config config;
    cln_scene *scene = NULL;

    if (argc < 3) {
        fputs(usage, stderr);
        return CLN_USAGE;
    }
    CLN_TRY(cln_config_preset("fast", &config));
    config.holdout = 8;
    CLN_TRY(cln_scene_load(&(cln_scene_desc){.path = argv[1], .config = &config}, &scene));
    printf("| run | end in | rays | opacity in empty space | rays hidden | in the first tenth |\n"
           "|---|---|---|---|---|---|\n");
    for (int i = 2; i < argc; i++)
        CLN_TRY(measure(scene, argv[i]));
done:
    if (st != CLN_OK)
        fprintf(stderr, "bench-floaters: %s\n", cln_error_text());
    cln_scene_free(scene);
    return st;
}
