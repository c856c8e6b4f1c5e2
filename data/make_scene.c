/* build/make-scene: renders a small scene with exactly known geometry, colour and depth, in a
 * format of the dataset readers. This file has options, cameras and the writing of files;
 * scene_object.c and scene_room.c have the shapes, trace.c and shade.c the ray tracer. The same
 * options give the same bytes on every run, for any number of threads. */
#include <errno.h>
#include <dirent.h>
#include <getopt.h>
#include <jansson.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/log.h"
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/rng.h"
#include "io/image.h"
#include "io/npy.h"
#include "colmap.h"
#include "faults.h"
#include "picture.h"

/* "axes inverse ..." */
#define X(name, what) #name " "
#define FAULT_WORDS   FAULT_LIST(X)

static const char usage[] =
    "usage: make-scene OUT [options]\n"
    "Renders a scene with exactly known geometry, colour and depth into the folder OUT.\n"
    "  --kind object|room|forward|terrain|street\n"
    "                             an object seen from all sides (default), a room from inside, a\n"
    "                             still life from the front, a village from the air (the first "
    "half\n"
    "                             of the views straight down, the others obliquely), a fountain\n"
    "                             from around, with a town and hills behind it\n"
    "  --format NAME              how the cameras are written:\n"
    "             blender         transforms_SPLIT.json, RGBA images (default)\n"
    "             nerfstudio      one transforms.json that names the splits, RGB images over "
    "white\n"
    "             ngp             as nerfstudio, with aabb_scale and without splits\n"
    "             llff            poses_bounds.npy with exact depths, RGB images, without splits\n"
    "             colmap          sparse/0 with exact points of surfaces, RGB images, without\n"
    "                             splits\n"
    "  --size N                   width and height in pixels, 8 to 4096 (default 200)\n"
    "  --train N --val N --test N number of views of each split (default 60, 0, 8)\n"
    "  --from all|cone|low|near   where the training views of an object are; those of other\n"
    "                             splits stay all around it: everywhere (default), within 40\n"
    "                             degrees of one direction, below 15 degrees of height, at one\n"
    "                             distance (others: 0.55 to 1.8 times that)\n"
    "  --lens MODEL               lens model, by COLMAP's name (not with blender) [OPENCV]\n"
    "  --distortion k1,k2,p1,p2   its parameters, all of them [0]\n"
    "  --depth                    also write NAME.depth.npy, distance along the ray; 0 = nothing\n"
    "                             there\n"
    "  --masks                    also write masks of what is there (nerfstudio: black is "
    "ignored)\n"
    "  --fault NAME               plant a mistake of captures, to test what finds it:\n"
    "                             " FAULT_WORDS "\n"
    "  --seed N                   of camera positions and noise textures (default 1)\n";
#undef X

static const double pi = 3.14159265358979323846;

enum { OBJECT, ROOM, FORWARD, TERRAIN, STREET };
static const char *const kinds[] = {"object", "room", "forward", "terrain", "street", NULL};
static cln_status (*const scenes[])(world *) = {scene_object, scene_room, scene_forward,
                                                scene_terrain, scene_street};

enum { FROM_ALL, FROM_CONE, FROM_LOW, FROM_NEAR };
static const char *const places[] = {"all", "cone", "low", "near", NULL};

enum { BLENDER, NERFSTUDIO, NGP, LLFF, COLMAP };
static const char *const formats[] = {"blender", "nerfstudio", "ngp", "llff", "colmap", NULL};

typedef struct settings {
    const char *out;
    int kind, format, fault, from;
    bool depth, masks;
    int size, seed;
    int views[CLN_SPLITS];
    cln_lens lens;
    const char *bent_by; /* as it is given; NULL */
    double distortion[CLN_LENS_PARAMS];
} settings;

typedef struct job {
    const settings *set;
    world world;
    int view_count;
    cln_camera *cameras; /* [view]: train, val, test */
    char **names;        /* [view] relative to the folder, without extension */
    pthread_mutex_t lock;
    int next; /* view to render */
    cln_status st;
    char error[1024];
} job;

/* ---- cameras ---- */

static void look(cln_camera *camera, vec from, vec forward)
{
    vec z = unit(forward), x = unit(cross(z, vec3(0, 0, 1))), y = cross(z, x);
    const vec columns[4] = {x, y, z, from};

    for (int c = 0; c < 4; c++) {
        camera->c2w[c] = columns[c].x;
        camera->c2w[4 + c] = columns[c].y;
        camera->c2w[8 + c] = columns[c].z;
    }
}

/* Forward: a jittered grid of places in a plane before the scene, looking at its middle, as people
 * hold a phone. */
static void place_forward(const settings *set, int split, int i, const float u[4],
                          cln_camera *camera)
{
    const int side = (int)ceil(sqrt(set->views[split]));
    const double x = (i % side + 0.2 + 0.6 * u[0]) / side - 0.5;
    const double z = (i / side + 0.2 + 0.6 * u[1]) / side - 0.5;
    const vec from = vec3(0.9 * x, -3.3 + 0.2 * (u[2] - 0.5), 0.7 * z);
    const vec at = vec3(0.25 * x, 0.4, 0.2 * z);

    look(camera, from, sub(at, from));
}

/* Terrain: the first half of a split in a grid of photos straight down that overlap by half, turned
 * like strips to and fro; the others obliquely, from all around, 35 to 50 degrees steep. */
static void place_terrain(const settings *set, int split, int i, double turn, const float u[4],
                          cln_camera *camera)
{
    const int down = (set->views[split] + 1) / 2, side = (int)ceil(sqrt(down));

    if (i < down) {
        const double x = 2.4 * ((i % side + 0.4 + 0.2 * u[0]) / side - 0.5);
        const double y = 2.4 * ((i / side + 0.4 + 0.2 * u[1]) / side - 0.5);
        const double way = i / side % 2 ? -1 : 1; /* of flight, and the picture's up */

        look(camera, vec3(x, y, 4.5), vec3(0.04 * way * (u[2] + 0.2), 0.01 * (u[3] - 0.5), -1));
    } else {
        const double steep = 0.61 + 0.26 * u[0], far = 5.2;
        const vec at = vec3(1.2 * (u[1] - 0.5), 1.2 * (u[2] - 0.5), -0.2);
        const vec to = vec3(-cos(turn) * cos(steep), -sin(turn) * cos(steep), -sin(steep));

        look(camera, along(at, -far, to), to);
    }
}

/* Object: evenly over the sphere, from a little below the horizon to nearly overhead, by the golden
 * angle; training views by --from: over less of it, and the others at many distances. */
static void place_object(const settings *set, int split, int i, double yaw, const float u[4],
                         cln_camera *camera)
{
    const int from = split == CLN_SPLIT_TRAIN || set->from == FROM_NEAR ? set->from : FROM_ALL;
    const double part = (i + 0.2 + 0.6 * u[0]) / set->views[split], usual = 4.03;
    double z = -0.12 + (from == FROM_LOW ? 0.38 : 1.07) * part, r = sqrt(1 - z * z),
           distance = usual;
    vec at = vec3(r * cos(yaw), r * sin(yaw), z);

    if (from == FROM_CONE) { /* around a direction 25 degrees above the horizon */
        const vec axis = vec3(0.906, 0, 0.423), side = vec3(0, 1, 0), up = vec3(-0.423, 0, 0.906);

        z = 1 - (1 - cos(40 * pi / 180)) * part;
        r = sqrt(1 - z * z);
        at = along(along(scale(axis, z), r * cos(yaw), side), r * sin(yaw), up);
    }
    if (from == FROM_NEAR && split != CLN_SPLIT_TRAIN)
        distance *= 0.55 * pow(1.8 / 0.55, fmod(0.618034 * i, 1));
    at = scale(at, distance);
    look(camera, at, scale(at, -1));
}

/* Room: anywhere in its middle, looking all around. Street: from a walk around. Each split has its
 * own sequence. */
static void place_camera(const settings *set, int split, int i, cln_camera *camera)
{
    const double golden = pi * (3 - sqrt(5));
    static const double fovs[] = {
        [OBJECT] = 0.76, [ROOM] = 1.25, [FORWARD] = 0.56, [TERRAIN] = 0.3, [STREET] = 0.95};
    const double fov = fovs[set->kind];
    float start[4], u[4];

    *camera = (cln_camera){.width = set->size, .height = set->size};
    camera->fx = camera->fy = 0.5 * set->size / tan(0.5 * fov);
    camera->cx = camera->cy = 0.5 * set->size;
    camera->lens = set->lens;
    memcpy(camera->distortion, set->distortion, sizeof set->distortion);
    if (set->lens == CLN_LENS_EQUIRECTANGULAR)
        cln_camera_span_sphere(camera);

    cln_uniform4((uint64_t)set->seed, CLN_STREAM_SCENE, 1, (uint32_t)split, 0, start);
    cln_uniform4((uint64_t)set->seed, CLN_STREAM_SCENE, 2 + (uint32_t)split, (uint32_t)i, 0, u);
    double yaw = 2 * pi * start[0] + golden * i;
    if (set->kind == FORWARD) {
        place_forward(set, split, i, u, camera);
    } else if (set->kind == TERRAIN) {
        place_terrain(set, split, i, yaw, u, camera);
    } else if (set->kind == STREET) {
        const double far = 2.5 + 0.8 * u[0];
        const vec from = vec3(far * cos(yaw), far * sin(yaw), 1.1 * u[1] - 0.1);
        const vec at = vec3(0.5 * (u[2] - 0.5), 0.5 * (u[3] - 0.5), -0.1);

        look(camera, from, sub(at, from));
    } else if (set->kind == ROOM) {
        double pitch = 0.8 * (u[0] - 0.55);
        look(camera, vec3(1.1 * (u[1] - 0.5), 1.1 * (u[2] - 0.5), 0.7 * (u[3] - 0.4)),
             vec3(cos(yaw) * cos(pitch), sin(yaw) * cos(pitch), sin(pitch)));
    } else {
        place_object(set, split, i, yaw, u, camera);
    }
}

/* ---- JSON ---- */

/* What the files say: with the fault, if it is one of cameras. */
static cln_camera written(const job *j, int view)
{
    cln_camera camera = j->cameras[view];

    fault_camera((fault)j->set->fault, view < j->set->views[0] ? view : -1, &camera);
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
        row[15] = (float)near;
        row[16] = (float)far;
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
                                .names = j->names};

    CLN_TRY(cln_alloc(&cameras, (size_t)j->view_count, sizeof *cameras, "cameras"));
    for (int v = 0; v < j->view_count; v++)
        cameras[v] = written(j, v);
    CLN_TRY(colmap_write(&scene, cameras));
done:
    free(cameras);
    return st;
}

/* generator.json records the options, and marks the folder as one that may be overwritten. */
static cln_status write_marker(const settings *set)
{
    json_t *distortion = json_array();

    for (int i = 0; i < cln_lens_models[set->lens].count; i++)
        json_array_append_new(distortion, json_real(set->distortion[i]));
    json_t *document = json_pack(
        "{s:s, s:s, s:s, s:i, s:[i,i,i], s:s, s:s, s:o, s:b, s:b, s:s, s:i}", "generator",
        "make-scene", "kind", kinds[set->kind], "format", formats[set->format], "size", set->size,
        "views", set->views[0], set->views[1], set->views[2], "from", places[set->from], "lens",
        cln_lens_models[set->lens].name, "distortion", distortion, "depth", set->depth, "masks",
        set->masks, "fault", fault_names[set->fault], "seed", set->seed);
    cln_status st = write_json(set->out, "generator.json", document);
    json_decref(document);
    return st;
}

/* ---- rendering ---- */

/* White where at least half of the pixel is covered. */
static cln_status write_mask(const job *j, int view, const uint8_t *rgba)
{
    cln_status st = CLN_OK;
    const int size = j->set->size;
    const size_t pixels = (size_t)size * (size_t)size;
    uint8_t *mask = NULL;
    char *path = NULL;

    CLN_TRY(cln_alloc(&mask, pixels, 3, "a mask"));
    for (size_t i = 0; i < pixels; i++)
        memset(mask + 3 * i, (rgba[4 * i + 3] > 127) == (j->set->fault != FAULT_mask) ? 255 : 0, 3);
    CLN_TRY(cln_asprintf(&path, "%s/masks/%s.png", j->set->out, strchr(j->names[view], '/') + 1));
    CLN_TRY(cln_image_write_png(path, size, size, 3, mask));
done:
    free(mask);
    free(path);
    return st;
}

static cln_status render_view(const job *j, int view)
{
    cln_status st = CLN_OK;
    const int train = j->set->views[0], trained = view < train ? view : -1;
    const int shown = trained < 0 ? view : fault_photo((fault)j->set->fault, view, train);
    const cln_camera *camera = &j->cameras[shown];
    int size = j->set->size, sides[2] = {size, size};
    size_t pixels = (size_t)size * (size_t)size;
    uint8_t *rgba = NULL;
    float *depth = NULL;
    char *stem = NULL, *path = NULL, *depth_path = NULL;

    CLN_TRY(cln_alloc(&rgba, pixels, 4, "an image"));
    CLN_TRY(cln_alloc(&depth, pixels, sizeof *depth, "a depth image"));
    CLN_TRY(cln_path_join(&stem, j->set->out, j->names[view]));
    CLN_TRY(cln_asprintf(&path, "%s.png", stem));
    CLN_TRY(cln_asprintf(&depth_path, "%s.depth.npy", stem));
    picture_render(&j->world, camera, rgba, depth);
    if (j->set->masks)
        CLN_TRY(write_mask(j, view, rgba));
    if (j->set->format != BLENDER)
        picture_over_white((int)pixels, rgba);
    CLN_TRY(fault_pixels((fault)j->set->fault, trained, size, size,
                         j->set->format == BLENDER ? 4 : 3, rgba));
    CLN_TRY(cln_image_write_png(path, size, size, j->set->format == BLENDER ? 4 : 3, rgba));
    if (j->set->depth)
        CLN_TRY(cln_npy_write_f32(depth_path, 2, sides, depth));
done:
    free(rgba);
    free(depth);
    free(stem);
    free(path);
    free(depth_path);
    return st;
}

static void *render_views(void *user)
{
    job *j = user;

    for (;;) {
        pthread_mutex_lock(&j->lock);
        int view = j->st == CLN_OK && j->next < j->view_count ? j->next++ : -1;
        pthread_mutex_unlock(&j->lock);
        if (view < 0)
            return NULL;
        cln_status st = render_view(j, view);
        pthread_mutex_lock(&j->lock);
        if (st != CLN_OK && j->st == CLN_OK) {
            j->st = st;
            snprintf(j->error, sizeof j->error, "%s", cln_error_text());
        }
        pthread_mutex_unlock(&j->lock);
    }
}

static cln_status render_all(job *j)
{
    enum { MAX_THREADS = 64 };
    pthread_t threads[MAX_THREADS];
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    int wanted = cores < 1 ? 1 : cores > MAX_THREADS ? MAX_THREADS : (int)cores, started = 0;

    while (started < wanted && !pthread_create(&threads[started], NULL, render_views, j))
        started++;
    if (!started) /* no thread starts: this one does the work */
        render_views(j);
    for (int i = 0; i < started; i++)
        pthread_join(threads[i], NULL);
    return j->st == CLN_OK ? CLN_OK : cln_fail(j->st, "%s", j->error);
}

/* Checks that the folder is missing, empty or a generated scene. */
static cln_status check_folder(const char *folder)
{
    cln_status st = CLN_OK;
    char *marker = NULL;
    DIR *dir = opendir(folder);

    if (!dir)
        return errno == ENOENT ? CLN_OK : cln_fail(CLN_OUTPUT, "%s: %s", folder, strerror(errno));
    CLN_TRY(cln_path_join(&marker, folder, "generator.json"));
    if (!cln_is_file(marker))
        for (struct dirent *entry; (entry = readdir(dir)) && st == CLN_OK;)
            if (strcmp(entry->d_name, ".") && strcmp(entry->d_name, ".."))
                st = cln_fail(
                    CLN_OUTPUT,
                    "%s: this folder holds other files than a generated scene's (it has no "
                    "generator.json); name another folder",
                    folder);
done:
    free(marker);
    closedir(dir);
    return st;
}

static cln_status make_folders(const settings *set)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    for (int split = 0; split < CLN_SPLITS; split++) {
        if (!set->views[split])
            continue;
        CLN_TRY(cln_path_join(&path, set->out,
                              set->format == BLENDER ? cln_split_names[split] : "images"));
        CLN_TRY(cln_make_dirs(path));
        free(path);
        path = NULL;
    }
    if (set->masks) {
        CLN_TRY(cln_path_join(&path, set->out, "masks"));
        CLN_TRY(cln_make_dirs(path));
    }
done:
    free(path);
    return st;
}

static cln_status make_scene(const settings *set)
{
    cln_status st = CLN_OK;
    job *j = NULL;
    int total = set->views[0] + set->views[1] + set->views[2];

    CLN_TRY(cln_alloc(&j, 1, sizeof *j, "the scene"));
    j->set = set;
    pthread_mutex_init(&j->lock, NULL);
    CLN_TRY(cln_alloc(&j->cameras, (size_t)total, sizeof *j->cameras, "cameras"));
    CLN_TRY(cln_alloc(&j->names, (size_t)total, sizeof *j->names, "view names"));
    for (int split = 0; split < CLN_SPLITS; split++)
        for (int i = 0; i < set->views[split]; i++) {
            int view = j->view_count++;
            place_camera(set, split, i, &j->cameras[view]);
            if (set->format == BLENDER)
                CLN_TRY(cln_asprintf(&j->names[view], "%s/r_%03d", cln_split_names[split], i));
            else
                CLN_TRY(cln_asprintf(&j->names[view], "images/frame_%05d", view + 1));
        }
    world_noise(&j->world, (uint64_t)set->seed);
    CLN_TRY(scenes[set->kind](&j->world));
    CLN_TRY(check_folder(set->out));
    CLN_TRY(make_folders(set));
    CLN_TRY(write_marker(set));
    CLN_TRY(render_all(j));
    /* Last, so that a folder with transforms is complete. */
    CLN_TRY(set->format == BLENDER  ? write_blender(j)
            : set->format == LLFF   ? write_llff(j)
            : set->format == COLMAP ? write_colmap(j)
                                    : write_single(j));
done:
    if (j) {
        for (int i = 0; i < j->view_count; i++)
            free(j->names[i]);
        free(j->names);
        free(j->cameras);
        shapes_free(&j->world.shapes);
        pthread_mutex_destroy(&j->lock);
    }
    free(j);
    return st;
}

/* ---- options ---- */

static cln_status parse_int(const char *option, const char *text, int min, int max, int *out)
{
    char *end;
    errno = 0;
    long value = strtol(text, &end, 10);

    if (errno || end == text || *end || value < min || value > max)
        return cln_fail(CLN_USAGE, "--%s %s: must be a whole number from %d to %d", option, text,
                        min, max);
    *out = (int)value;
    return CLN_OK;
}

static cln_status parse_word(const char *option, const char *text, const char *const *words,
                             int *out)
{
    char list[128] = "";

    for (int i = 0; words[i]; i++) {
        if (!strcmp(text, words[i])) {
            *out = i;
            return CLN_OK;
        }
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", i ? ", " : "", words[i]);
    }
    return cln_fail(CLN_USAGE, "--%s %s: must be one of %s", option, text, list);
}

static cln_status parse(int argc, char **argv, settings *set)
{
    static const struct option options[] = {
        {"kind", required_argument, NULL, 'k'}, {"format", required_argument, NULL, 'f'},
        {"size", required_argument, NULL, 's'}, {"train", required_argument, NULL, 't'},
        {"val", required_argument, NULL, 'v'},  {"test", required_argument, NULL, 'e'},
        {"from", required_argument, NULL, 'w'}, {"distortion", required_argument, NULL, 'd'},
        {"lens", required_argument, NULL, 'l'}, {"depth", no_argument, NULL, 'z'},
        {"masks", no_argument, NULL, 'm'},      {"fault", required_argument, NULL, 'x'},
        {"seed", required_argument, NULL, 'r'}, {NULL, 0, NULL, 0}};
    cln_status st = CLN_OK;

    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;)
        switch (c) {
        case 'k':
            CLN_TRY(parse_word("kind", optarg, kinds, &set->kind));
            break;
        case 'f':
            CLN_TRY(parse_word("format", optarg, formats, &set->format));
            break;
        case 's':
            CLN_TRY(parse_int("size", optarg, 8, 4096, &set->size));
            break;
        case 't':
            CLN_TRY(parse_int("train", optarg, 1, 10000, &set->views[CLN_SPLIT_TRAIN]));
            break;
        case 'v':
            CLN_TRY(parse_int("val", optarg, 0, 10000, &set->views[CLN_SPLIT_VAL]));
            break;
        case 'e':
            CLN_TRY(parse_int("test", optarg, 0, 10000, &set->views[CLN_SPLIT_TEST]));
            break;
        case 'w':
            CLN_TRY(parse_word("from", optarg, places, &set->from));
            break;
        case 'd':
            set->bent_by = optarg;
            break;
        case 'l':
            set->lens = cln_lens_find(optarg);
            if (set->lens == CLN_LENSES)
                return cln_fail(CLN_USAGE, "--lens %s: there is no such model", optarg);
            break;
        case 'z':
            set->depth = true;
            break;
        case 'm':
            set->masks = true;
            break;
        case 'x':
            CLN_TRY(parse_word("fault", optarg, fault_names, &set->fault));
            break;
        case 'r':
            CLN_TRY(parse_int("seed", optarg, 0, 2147483647, &set->seed));
            break;
        default: /* getopt has printed the error */
            return cln_fail(CLN_USAGE, "try make-scene --help");
        }
    if (optind + 1 != argc)
        return cln_fail(CLN_USAGE, "give one output folder, not %d", argc - optind);
    set->out = argv[optind];
    if (set->bent_by)
        CLN_TRY(cln_parse_reals(set->bent_by, cln_lens_models[set->lens].count, set->distortion));
    if (!cln_lens_is_pinhole(set->lens, set->distortion) &&
        (set->format == BLENDER || set->format == LLFF || set->format == COLMAP))
        return cln_fail(CLN_USAGE,
                        "--lens, --distortion: the %s format has none; add --format "
                        "nerfstudio",
                        formats[set->format]);
    if (set->from != FROM_ALL && set->kind != OBJECT)
        return cln_fail(CLN_USAGE, "--from %s: is for --kind object", places[set->from]);
    if (set->masks && set->format != NERFSTUDIO)
        return cln_fail(CLN_USAGE, "--masks: add --format nerfstudio");
    if (set->fault == FAULT_mask && !set->masks)
        return cln_fail(CLN_USAGE, "--fault mask: add --masks");
    if ((set->format == LLFF || set->format == COLMAP) &&
        (set->fault == FAULT_axes || set->fault == FAULT_inverse))
        return cln_fail(CLN_USAGE, "--fault %s: choose another --format than %s",
                        fault_names[set->fault], formats[set->format]);
done:
    return st;
}

int main(int argc, char **argv)
{
    settings set = {.size = 200, .seed = 1, .views = {60, 0, 8}};
    cln_status st;
    bool help = false;

    cln_log_set_sink(cln_log_stderr, NULL);
    for (int i = 1; i < argc; i++)
        help |= !strcmp(argv[i], "--help");
    if (argc < 2 || help) {
        fputs(usage, argc < 2 ? stderr : stdout);
        return argc < 2 ? 2 : 0;
    }
    st = parse(argc, argv, &set);
    if (st == CLN_OK)
        st = make_scene(&set);
    if (st != CLN_OK) {
        fprintf(stderr, "make-scene: %s\n", cln_error_text());
        return cln_status_exit_code(st);
    }
    printf("%s: %s, %s format, %d x %d, views: %d train, %d val, %d test\n", set.out,
           kinds[set.kind], formats[set.format], set.size, set.size, set.views[CLN_SPLIT_TRAIN],
           set.views[CLN_SPLIT_VAL], set.views[CLN_SPLIT_TEST]);
    return 0;
}
