/* build/make-scene: renders a small scene with exactly known geometry, colour and depth, in a
 * format of the dataset readers. This file has options and the writing of photos; place.c places
 * the cameras, write.c writes their files, scene_KIND.c have the shapes, trace.c and shade.c the
 * ray tracer. The same options give the same bytes on every run, for any number of threads. */
#include <errno.h>
#include <dirent.h>
#include <getopt.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/log.h"
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "io/image.h"
#include "io/npy.h"
#include "held.h"
#include "job.h"
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
    "  --depth                    also write NAME.depth.npy, distance along the ray; 0 = no\n"
    "                             surface\n"
    "  --masks                    also write masks of the shapes (nerfstudio: black is "
    "ignored)\n"
    "  --plain                    every shape in one colour, without texture, light or shadow\n"
    "  --unit U                   every position and depth times this, the number of written units "
    "in\n"
    "                             one of the generator's; an object is about 2 of those wide (1)\n"
    "  --offset X,Y,Z             added to every position after that, such as a survey's (0)\n"
    "  --held DIGITS              photos of 4:3 that lie as a phone stores them, with EXIF\n"
    "                             orientations that tell how to turn them, 1, 3, 6 or 8, in turn\n"
    "  --fault NAME               plant a capture mistake, to test what detects it:\n"
    "                             " FAULT_WORDS "\n"
    "  --seed N                   of camera positions and noise textures (default 1)\n";
#undef X

static cln_status (*const scenes[])(world *) = {scene_object, scene_room, scene_forward,
                                                scene_terrain, scene_street};

/* ---- rendering ---- */

/* White where at least half of the pixel is covered. */
static cln_status write_mask(const job *j, int view, const uint8_t *rgba)
{
    cln_status st = CLN_OK;
    const int width = j->cameras[view].width, height = j->cameras[view].height;
    const size_t pixels = (size_t)width * (size_t)height;
    uint8_t *mask = NULL;
    char *path = NULL;

    CLN_TRY(cln_alloc(&mask, pixels, 3, "a mask"));
    for (size_t i = 0; i < pixels; i++)
        memset(mask + 3 * i, (rgba[4 * i + 3] > 127) == (j->set->fault != FAULT_mask) ? 255 : 0, 3);
    CLN_TRY(cln_asprintf(&path, "%s/masks/%s.png", j->set->out, strchr(j->names[view], '/') + 1));
    CLN_TRY(cln_image_write_png(path, width, height, 3, mask));
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
    const int width = camera->width, height = camera->height, sides[2] = {height, width};
    const size_t pixels = (size_t)width * (size_t)height;
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
    CLN_TRY(fault_pixels((fault)j->set->fault, trained, width, height,
                         j->set->format == BLENDER ? 4 : 3, rgba));
    CLN_TRY(cln_image_write_png(path, width, height, j->set->format == BLENDER ? 4 : 3, rgba));
    if (j->set->held)
        CLN_TRY(held_tag(path, job_orientation(j->set, shown)));
    for (size_t i = 0; i < pixels; i++)
        depth[i] = (float)(j->set->unit * depth[i]);
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
            job_place(set, split, i, &j->cameras[view]);
            if (set->held)
                held_camera(job_orientation(set, view), &j->cameras[view]);
            if (set->format == BLENDER)
                CLN_TRY(cln_asprintf(&j->names[view], "%s/r_%03d", cln_split_names[split], i));
            else
                CLN_TRY(cln_asprintf(&j->names[view], "images/frame_%05d", view + 1));
        }
    j->world.plain = set->plain;
    world_noise(&j->world, (uint64_t)set->seed);
    CLN_TRY(scenes[set->kind](&j->world));
    CLN_TRY(check_folder(set->out));
    CLN_TRY(make_folders(set));
    CLN_TRY(job_mark(set));
    CLN_TRY(render_all(j));
    /* Last, so that a folder with transforms is complete. */
    CLN_TRY(job_write(j));
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
        {"kind", required_argument, NULL, 'k'},  {"format", required_argument, NULL, 'f'},
        {"size", required_argument, NULL, 's'},  {"train", required_argument, NULL, 't'},
        {"val", required_argument, NULL, 'v'},   {"test", required_argument, NULL, 'e'},
        {"from", required_argument, NULL, 'w'},  {"distortion", required_argument, NULL, 'd'},
        {"lens", required_argument, NULL, 'l'},  {"depth", no_argument, NULL, 'z'},
        {"masks", no_argument, NULL, 'm'},       {"plain", no_argument, NULL, 'p'},
        {"fault", required_argument, NULL, 'x'}, {"seed", required_argument, NULL, 'r'},
        {"unit", required_argument, NULL, 'u'},  {"offset", required_argument, NULL, 'o'},
        {"held", required_argument, NULL, 'h'},  {NULL, 0, NULL, 0}};
    cln_status st = CLN_OK;

    for (int c; (c = getopt_long(argc, argv, "", options, NULL)) != -1;)
        switch (c) {
        case 'k':
            CLN_TRY(parse_word("kind", optarg, job_kinds, &set->kind));
            break;
        case 'f':
            CLN_TRY(parse_word("format", optarg, job_formats, &set->format));
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
            CLN_TRY(parse_word("from", optarg, job_places, &set->from));
            break;
        case 'd':
            set->bent_by = optarg;
            break;
        case 'l':
            set->lens = cln_lens_find(optarg);
            if (set->lens == CLN_LENSES)
                return cln_fail(CLN_USAGE,
                                "--lens %s: unknown model; give COLMAP's name, such as OPENCV",
                                optarg);
            break;
        case 'z':
            set->depth = true;
            break;
        case 'm':
            set->masks = true;
            break;
        case 'p':
            set->plain = true;
            break;
        case 'x':
            CLN_TRY(parse_word("fault", optarg, fault_names, &set->fault));
            break;
        case 'u':
            CLN_TRY(cln_parse_reals(optarg, 1, &set->unit));
            if (!(set->unit > 0))
                return cln_fail(CLN_USAGE, "--unit %s: must be above 0", optarg);
            break;
        case 'o':
            CLN_TRY(cln_parse_reals(optarg, 3, set->offset));
            break;
        case 'h':
            set->held = optarg;
            if (!*optarg || optarg[strspn(optarg, "1368")])
                return cln_fail(CLN_USAGE, "--held %s: give digits of 1, 3, 6 and 8", optarg);
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
                        "--lens, --distortion: the %s format cannot store them; add --format "
                        "nerfstudio",
                        job_formats[set->format]);
    if (set->from != FROM_ALL && set->kind != OBJECT)
        return cln_fail(CLN_USAGE, "--from %s: needs --kind object", job_places[set->from]);
    if (set->format == NGP && set->unit != 1)
        return cln_fail(CLN_USAGE,
                        "--unit: the ngp format has a cube of fixed size; choose another "
                        "--format");
    for (int a = 0; a < 3; a++)
        if (set->offset[a] != 0 && (set->format == NGP || set->format == LLFF))
            return cln_fail(CLN_USAGE, "--offset: the %s format has %s; choose another --format",
                            job_formats[set->format],
                            set->format == NGP ? "a cube of fixed place" : "positions as floats");
    if (set->masks && set->format != NERFSTUDIO)
        return cln_fail(CLN_USAGE, "--masks: add --format nerfstudio");
    if (set->fault == FAULT_mask && !set->masks)
        return cln_fail(CLN_USAGE, "--fault mask: add --masks");
    if (set->fault == FAULT_upright && !(set->held && strchr(set->held, '3')))
        return cln_fail(CLN_USAGE, "--fault upright: add --held 3");
    if ((set->format == LLFF || set->format == COLMAP) &&
        (set->fault == FAULT_axes || set->fault == FAULT_inverse))
        return cln_fail(CLN_USAGE, "--fault %s: choose another --format than %s",
                        fault_names[set->fault], job_formats[set->format]);
done:
    return st;
}

int main(int argc, char **argv)
{
    settings set = {.size = 200, .seed = 1, .views = {60, 0, 8}, .unit = 1};
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
           job_kinds[set.kind], job_formats[set.format], set.size,
           set.held ? set.size / 4 * 3 : set.size, set.views[CLN_SPLIT_TRAIN],
           set.views[CLN_SPLIT_VAL], set.views[CLN_SPLIT_TEST]);
    return 0;
}
