/* Camera files of a generated scene, in the formats of the dataset readers. colmap.c writes
 * COLMAP's. */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/npy.h"
#include "colmap.h"
#include "held.h"
#include "job.h"
#include "shade.h"
#include "vec.h"

const char *const job_kinds[] = {"object", "room", "forward", "terrain", "street", NULL};
const char *const job_places[] = {"all", "cone", "low", "near", NULL};
const char *const job_formats[] = {"blender", "nerfstudio", "ngp", "llff", "colmap", NULL};

/* The camera as the files state it, with --unit and --offset, and the planted fault if it concerns
 * cameras. */
static cln_camera written(const job *j, int view)
{
    cln_camera camera = j->cameras[view];

    if (j->set->fault == FAULT_upright && job_orientation(j->set, view) == 3)
        held_camera(3, &camera); /* back again */
    fault_camera((fault)j->set->fault, view < j->set->views[0] ? view : -1, &camera);
    for (int a = 0; a < 3; a++)
        camera.c2w[4 * a + 3] = j->set->unit * camera.c2w[4 * a + 3] + j->set->offset[a];
    return camera;
}

static json_t *matrix_json(const job *j, int view)
{
    /* From OpenCV's camera axes (ours) to OpenGL's (the formats'): y and z change sign. */
    const double sign = j->set->fault == FAULT_axes ? 1 : -1, flip[4] = {1, sign, sign, 1};
    const cln_camera camera = written(j, view);
    double m[12];
    json_t *rows = json_array();

    for (int i = 0; i < 12; i++)
        m[i] = flip[i % 4] * camera.c2w[i];
    if (j->set->fault == FAULT_inverse)
        for (int r = 0; r < 3; r++) {
            m[4 * r + 3] = 0;
            for (int c = 0; c < 3; c++) {
                m[4 * r + c] = flip[r] * camera.c2w[4 * c + r];
                m[4 * r + 3] -= m[4 * r + c] * camera.c2w[4 * c + 3];
            }
        }

    for (int r = 0; r < 4; r++) {
        json_t *row = json_array();
        for (int c = 0; c < 4; c++)
            json_array_append_new(row, json_real(r < 3 ? m[4 * r + c] : c == 3 ? 1 : 0));
        json_array_append_new(rows, row);
    }
    return rows;
}

static cln_status write_json(const char *folder, const char *name, json_t *document)
{
    cln_status st = CLN_OK;
    char *path = NULL, *text = NULL;

    CLN_TRY(cln_path_join(&path, folder, name));
    text = json_dumps(document, JSON_INDENT(1));
    if (!text) {
        st = cln_fail(CLN_MEMORY, "%s: out of memory for its text", path);
        goto done;
    }
    CLN_TRY(cln_write_file(path, text, strlen(text)));
done:
    free(path);
    free(text);
    return st;
}

static cln_status write_blender(const job *j)
{
    cln_status st = CLN_OK;
    char name[64], path[80];

    for (int split = 0, view = 0; split < CLN_SPLITS && st == CLN_OK; split++) {
        if (!j->set->views[split])
            continue;
        const cln_camera camera = written(j, view);
        json_t *frames = json_array();
        for (int i = 0; i < j->set->views[split]; i++, view++) {
            snprintf(path, sizeof path, "./%s", j->names[view]);
            json_array_append_new(frames, json_pack("{s:s, s:o}", "file_path", path,
                                                    "transform_matrix", matrix_json(j, view)));
        }
        json_t *document = json_pack("{s:f, s:o}", "camera_angle_x",
                                     2 * atan(0.5 * camera.width / camera.fx), "frames", frames);
        snprintf(name, sizeof name, "transforms_%s.json", cln_split_names[split]);
        st = write_json(j->set->out, name, document);
        json_decref(document);
    }
    return st;
}

/* nerfstudio and ngp: one file. */
static cln_status write_single(const job *j)
{
    const cln_camera first = written(j, 0), *c = &first;
    const cln_lens_model *lens = &cln_lens_models[c->lens];
    json_t *frames = json_array();
    json_t *document =
        json_pack("{s:s, s:f, s:f, s:f, s:f, s:i, s:i}", "camera_model", lens->name, "fl_x", c->fx,
                  "fl_y", c->fy, "cx", c->cx, "cy", c->cy, "w", c->width, "h", c->height);

    for (int i = 0; i < lens->count; i++)
        json_object_set_new(document, lens->params[i], json_real(c->distortion[i]));
    for (int split = 0, view = 0; split < CLN_SPLITS; split++) {
        char key[32], path[80];
        json_t *names = json_array();
        for (int i = 0; i < j->set->views[split]; i++, view++) {
            snprintf(path, sizeof path, "%s.png", j->names[view]);
            json_array_append_new(names, json_string(path));
            json_t *frame = json_pack("{s:s, s:o}", "file_path", path, "transform_matrix",
                                      matrix_json(j, view));
            if (j->set->masks) {
                snprintf(path, sizeof path, "masks/%s.png", strchr(j->names[view], '/') + 1);
                json_object_set_new(frame, "mask_path", json_string(path));
            }
            json_array_append_new(frames, frame);
        }
        snprintf(key, sizeof key, "%s_filenames", cln_split_names[split]);
        if (j->set->format == NERFSTUDIO)
            json_object_set(document, key, names);
        json_decref(names);
    }
    if (j->set->format == NGP) /* the cube of side 1 / 0.33 around the origin */
        json_object_set_new(document, "aabb_scale", json_integer(1));
    json_object_set_new(document, "frames", frames);
    cln_status st = write_json(j->set->out, "transforms.json", document);
    json_decref(document);
    return st;
}

/* The nearest and the farthest thing of a picture along its axis, from the exact geometry. */
static void find_depths(const job *j, int view, double *near, double *far)
{
    const cln_camera *camera = &j->cameras[view];

    *near = INFINITY;
    *far = 0;
    for (int k = 0; k < camera->width * camera->height; k++) {
        double o[3], d[3], depth = 0;
        hit h;

        if (!cln_camera_ray(camera, k % camera->width + 0.5, k / camera->width + 0.5, o, d) ||
            !shapes_hit(&j->world.shapes, vec3(o[0], o[1], o[2]), vec3(d[0], d[1], d[2]), 0,
                        INFINITY, &h))
            continue;
        for (int a = 0; a < 3; a++)
            depth += h.t * d[a] * camera->c2w[4 * a + 2];
        *near = fmin(*near, depth);
        *far = fmax(*far, depth);
    }
}

/* Rows of 17 numbers: columns down, right, backwards, position and (height, width, focal length) of
 * a 3 x 5 matrix, row-major; near and far. */
static cln_status write_llff(const job *j)
{
    cln_status st = CLN_OK;
    enum { ROW = 17 };
    const int sides[2] = {j->view_count, ROW};
    float *rows = NULL;
    char *path = NULL;

    CLN_TRY(cln_alloc(&rows, (size_t)j->view_count * ROW, sizeof *rows, "poses"));
    for (int v = 0; v < j->view_count; v++) {
        const cln_camera c = written(j, v);
        const double last[3] = {c.height, c.width, c.fx};
        float *row = rows + (size_t)v * ROW;
        double near = 0, far = 0;

        for (int i = 0; i < 3; i++) {
            const double columns[5] = {c.c2w[4 * i + 1], c.c2w[4 * i], -c.c2w[4 * i + 2],
                                       c.c2w[4 * i + 3], last[i]};

            for (int k = 0; k < 5; k++)
                row[5 * i + k] = (float)columns[k];
        }
        find_depths(j, v, &near, &far);
        row[15] = (float)(j->set->unit * near);
        row[16] = (float)(j->set->unit * far);
    }
    CLN_TRY(cln_path_join(&path, j->set->out, "poses_bounds.npy"));
    CLN_TRY(cln_npy_write_f32(path, 2, sides, rows));
done:
    free(rows);
    free(path);
    return st;
}

static cln_status write_colmap(const job *j)
{
    cln_status st = CLN_OK;
    cln_camera *cameras = NULL;
    const colmap_scene scene = {.out = j->set->out,
                                .world = &j->world,
                                .count = j->view_count,
                                .seed = j->set->seed,
                                .exact = j->cameras,
                                .unit = j->set->unit,
                                .offset = j->set->offset,
                                .names = j->names};

    CLN_TRY(cln_alloc(&cameras, (size_t)j->view_count, sizeof *cameras, "cameras"));
    for (int v = 0; v < j->view_count; v++)
        cameras[v] = written(j, v);
    CLN_TRY(colmap_write(&scene, cameras));
done:
    free(cameras);
    return st;
}

cln_status job_write(const job *j)
{
    return j->set->format == BLENDER  ? write_blender(j)
           : j->set->format == LLFF   ? write_llff(j)
           : j->set->format == COLMAP ? write_colmap(j)
                                      : write_single(j);
}

cln_status job_mark(const settings *set)
{
    json_t *distortion = json_array();

    for (int i = 0; i < cln_lens_models[set->lens].count; i++)
        json_array_append_new(distortion, json_real(set->distortion[i]));
    json_t *document = json_pack(
        "{s:s, s:s, s:s, s:i, s:[i,i,i], s:s, s:s, s:o, s:b, s:b, s:s, s:i, s:f, s:[f,f,f]}",
        "generator", "make-scene", "kind", job_kinds[set->kind], "format", job_formats[set->format],
        "size", set->size, "views", set->views[0], set->views[1], set->views[2], "from",
        job_places[set->from], "lens", cln_lens_models[set->lens].name, "distortion", distortion,
        "depth", set->depth, "masks", set->masks, "fault", fault_names[set->fault], "seed",
        set->seed, "unit", set->unit, "offset", set->offset[0], set->offset[1], set->offset[2]);
    if (set->plain)
        json_object_set_new(document, "plain", json_true());
    if (set->held)
        json_object_set_new(document, "held", json_string(set->held));
    cln_status st = write_json(set->out, "generator.json", document);
    json_decref(document);
    return st;
}
