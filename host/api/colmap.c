/* COLMAP's program: options and words of its versions, and the steps from photos to a model. See
 * colmap.h. */
#include "api/colmap.h"

#include <errno.h>
#include <ftw.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/callbacks.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "api/photo_cameras.h"
#include "io/command.h"
#include "io/disk.h"
#include "io/progress.h"
#include "scene/reader.h"

#define UNREAD                                                                                \
    "versions before 4 read no PNG of 16 bits; ImageMagick's `mogrify -path FOLDER -depth 8 " \
    "*.png` writes copies of 8, as training makes of them"

enum { PLAIN = 30, FEW = 120, MANY = 200, NEXT = 12, MODELS = 64 };
enum { BLOCK_LEAST = 4, BLOCK_MOST = 50, RANGE = 64, CAMERAS = 32 };
/* Bytes free on a disk: with fewer, a command's files are cut off, or it failed for want of
 * room. */
static const double ROOM_LEAST = 1 << 12, ROOM_FAILED = 1 << 18;
/* Times, of focal lengths: of one camera; what is found against what EXIF data tell, where that on
 * film is by the diagonal. */
static const double ALIKE = 1.02, APART = 1.3;

/* Models of fewer photos than that are thrown away, and other beginnings tried, up to 200. */
static const char SIZE[] = "--Mapper.min_model_size";
/* Photos matched before it says how far it is; its own is 50. */
static const char BLOCK[] = "--ExhaustiveMatching.block_size";
/* A file with the names of the photos to take, from which one run makes one camera. */
static const char LIST[] = "--image_list_path";
/* A folder with PHOTO.png for each photo: black pixels give no features. */
static const char MASKS[] = "--ImageReader.mask_path";
/* The focal length that a photo without one in its EXIF data begins with, over its longest side.
 * COLMAP's 1.2 is an angle of 48 degrees by a fisheye's model, which has 0.3 to 0.5: of 25 drawn
 * photos of 173 pixels it ended at 177 and 180, from 0.4 on at 174 and 175. */
static const char GUESS[] = "--ImageReader.default_focal_length_factor", FISHEYE[] = "0.4";

/* ---- its words ---- */

/* Behind the first of two phrases that the line has; NULL if it has neither. */
static const char *behind(const char *line, const char *phrase, const char *newer)
{
    const char *at = strstr(line, phrase), *other = strstr(line, newer);

    return at ? at + strlen(phrase) : other ? other + strlen(newer) : NULL;
}

/* "  Focal Length:    882.17px (Prior)" */
static void take_focal_length(cln_colmap *c, const char *line)
{
    static const char name[] = "Focal Length:";
    const char *at = strstr(line, name), *end = NULL;
    double pixels = 0;

    c->focal_lengths++;
    if (!at)
        return;
    at += sizeof name - 1;
    at += strspn(at, " ");
    if (!cln_number_read(at, &pixels, &end) || !(pixels > 0))
        return;
    c->focal_least = c->focal_least > 0 ? fmin(c->focal_least, pixels) : pixels;
    c->focal_most = fmax(c->focal_most, pixels);
}

/* COLMAP may begin many models, of which it keeps some: the second one is told. */
static void begin_model(cln_colmap *c)
{
    if (c->from_here > 0 && !c->anew) {
        cln_info("one start led to %d of %d photos; COLMAP begins anew from others", c->from_here,
                 c->photos.count);
        c->anew = true;
    }
    c->from_here = 0;
}

/* "882", or "850 to 900". */
static const char *range(double least, double most, char out[RANGE])
{
    if (round(least) == round(most))
        cln_format(out, RANGE, "%.0f", least);
    else
        cln_format(out, RANGE, "%.0f to %.0f", least, most);
    return out;
}

/* Progress: "Processed file [3/14]", "Matching block [1/2, 1/2]", "Matching image [3/14]",
 * "Registering image #5 (7)". COLMAP 3.13 and newer begin lines with time and place, write
 * "Processing" for "Matching", and "(num_reg_frames=7)". */
static void read_line(const char *line, void *user)
{
    cln_colmap *c = user;
    const char *at = NULL;
    int a = 0, b = 0, of_a = 0, of_b = 0;

    /* SQLite's words, and the system's; the commands of 3.8 may end with 0 all the same */
    if (strstr(line, "database or disk is full") || strstr(line, "No space left on device"))
        c->full = true;
    if (strstr(line, "amera model does not exist") || strstr(line, "ExistsCameraModelWithName"))
        c->strange = true;
    c->kept = c->kept || strstr(line, "already extracted");
    if (strstr(line, "(Prior)"))
        take_focal_length(c, line);
    if ((at = strstr(line, " Name:")))
        snprintf(c->name, sizeof c->name, "%.127s", at + 6 + strspn(at + 6, " "));
    if (strstr(line, "ailed to read") && strstr(line, "image file format") && c->unread++ == 0)
        snprintf(c->unread_name, sizeof c->unread_name, "%s", c->name);
    if (behind(line, "Initializing with image pair", "Registering initial image pair"))
        begin_model(c);
    if ((at = strstr(line, "Registering image #")) && (at = strchr(at, '(')) &&
        (sscanf(at, "(%d)", &a) == 1 || sscanf(at, "(num_reg_frames=%d)", &a) == 1)) {
        c->from_here = a;
        c->together = a > c->together ? a : c->together;
        c->done = c->together; /* another model begins small */
    } else if ((at = behind(line, "Matching block [", "Processing block ["))) {
        const int found = sscanf(at, "%d/%d, %d/%d]", &a, &of_a, &b, &of_b);

        if (found == 4 && of_a > 0 && of_b > 0)
            c->done = (int)((a - 1 + (b - 1) / (double)of_b) / of_a * c->photos.count);
    } else if ((at = strstr(line, "Processed file [")) &&
               sscanf(at, "Processed file [%d", &a) == 1) {
        c->done = c->before + a;
    } else if ((at = behind(line, "Matching image [", "Processing image [")) &&
               sscanf(at, "%d", &a) == 1) {
        c->done = a;
    } else {
        return;
    }
    cln_show_work(&c->desc->callbacks, c->stage, c->done, c->photos.count);
}

static int is_interrupted(void *user)
{
    return cln_poll_signal(&((cln_colmap *)user)->desc->callbacks);
}

/* After a command: was the disk full? A model that is cut off for it is no error of COLMAP's. */
static cln_status check_room(const cln_colmap *c, cln_status st, double least)
{
    if (st != CLN_OK && st != CLN_FAILED)
        return st;
    if (!c->full && cln_disk_room(c->desc->out) >= least)
        return st;
    cln_clear_error();
    return cln_fail(CLN_OUTPUT,
                    "%s: no room is left on the disk for what COLMAP writes (%s has all that it "
                    "said); make room, or give a folder on another disk with -o",
                    c->desc->out, c->log_path);
}

static cln_status run(cln_colmap *c, const char *stage, const char *const *argv)
{
    const cln_command_watch watch = {read_line, is_interrupted, c, c->log};
    cln_status st = CLN_OK;

    c->stage = stage;
    c->done = c->before;
    cln_show_work(&c->desc->callbacks, stage, c->done, c->photos.count);
    st = cln_command_run(argv, &watch);
    CLN_TRY(check_room(c, st, st == CLN_OK ? ROOM_LEAST : ROOM_FAILED));
done:
    if (st == CLN_FAILED && c->strange && c->lens) {
        cln_clear_error();
        st = cln_fail(CLN_FAILED,
                      "--lens %s: the COLMAP that is installed has no such camera model; give "
                      "another one, or install a newer COLMAP",
                      c->lens->name);
    }
    if (st == CLN_FAILED)
        cln_note("finding poses; %s has all that it said", c->log_path);
    return st;
}

/* ---- its options ---- */

/* COLMAP 3.13 renamed SiftExtraction.use_gpu to FeatureExtraction.use_gpu, and so for matching. */
static void learn_names(const char *line, void *user)
{
    cln_colmap *c = user;

    if (strstr(line, "--FeatureExtraction.use_gpu"))
        c->extraction = "--FeatureExtraction.use_gpu";
    if (strstr(line, "--FeatureMatching.use_gpu"))
        c->matching = "--FeatureMatching.use_gpu";
    for (int i = 0; i < 2; i++) {
        static const char *const threads[] = {"--SiftExtraction.num_threads",
                                              "--FeatureExtraction.num_threads"};
        static const char *const sides[] = {"--SiftExtraction.max_image_size",
                                            "--FeatureExtraction.max_image_size"};

        c->threads = strstr(line, threads[i]) ? threads[i] : c->threads;
        c->side = strstr(line, sides[i]) ? sides[i] : c->side;
    }
    c->sized = c->sized || strstr(line, SIZE);
    c->blocks = c->blocks || strstr(line, BLOCK);
    c->lists = c->lists || strstr(line, LIST);
    c->guesses = c->guesses || strstr(line, GUESS);
}

/* "COLMAP 4.1.1 (Commit ...", the first line of its help. */
static void learn_version(const char *line, void *user)
{
    cln_colmap *c = user;
    int major = 0, minor = 0;

    if (sscanf(line, "COLMAP %d.%d", &major, &minor) != 2)
        return;
    c->spheres = major > 4 || (major == 4 && minor >= 1);
    c->by_matrix = major < 3 || (major == 3 && minor <= 8);
}

void cln_colmap_ask(cln_colmap *c)
{
    static const char *const commands[] = {"feature_extractor", "exhaustive_matcher", "mapper"};
    const cln_command_watch watch = {learn_names, NULL, c, NULL};
    const cln_command_watch version = {learn_version, NULL, c, NULL};

    c->extraction = "--SiftExtraction.use_gpu";
    c->matching = "--SiftMatching.use_gpu";
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (cln_command_run((const char *const[]){"colmap", commands[i], "-h", NULL}, &watch) !=
            CLN_OK)
            cln_clear_error(); /* some versions end help with another code than 0 */
    if (cln_command_run((const char *const[]){"colmap", "help", NULL}, &version) != CLN_OK)
        cln_clear_error();
}

/* ---- its steps ---- */

cln_colmap_room cln_colmap_fit(double memory, int processors, int longest, double pixels)
{
    /* COLMAP 3.8, by photos of 3200 x 2400 and 1600 x 1200: 284 and 292 bytes a pixel of each
     * photo, beside 140 and 60 MiB */
    const double bytes = 300, besides = 200e6, room = 0.8 * memory - besides;
    const int most = 3200, least = 640; /* COLMAP's own most */
    const double scale = longest > most ? (double)most / longest : 1;
    cln_colmap_room out = {.each = bytes * pixels * scale * scale};

    if (room < out.each) {
        out.threads = 1;
        out.side = (int)(scale * longest * sqrt(fmax(room, 0) / out.each));
        out.side = out.side > least ? out.side : least;
        out.each *= pow(out.side / (scale * longest), 2);
    } else if (room < out.each * processors) {
        out.threads = (int)(room / out.each);
    }
    return out;
}

static void fit_memory(cln_colmap *c, const cln_photo_cameras *cameras)
{
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    const double memory = fmin(cln_host_memory(), cln_available_memory(""));
    char whole[32], each[32], smaller[64] = "";

    c->room = cln_colmap_fit(memory, processors > 0 ? (int)processors : 1, cameras->longest,
                             cameras->pixels);
    if (!c->threads || !c->side)
        c->room = (cln_colmap_room){0};
    if (c->room.threads == 0)
        return;
    cln_format_bytes(memory, whole);
    cln_format_bytes(c->room.each, each);
    if (c->room.side)
        snprintf(smaller, sizeof smaller, ", and in photos of at most %d pixels a side",
                 c->room.side);
    cln_info("memory: features of a photo take %s, and %s are free: COLMAP looks for them in %d "
             "photo%s at a time%s",
             each, whole, c->room.threads, cln_plural(c->room.threads, "", "s"), smaller);
}

/* Finds the features of photos that a camera took, or of all, each with a camera of its own. list:
 * their names, NULL for all; lens: NULL for one by their number, as a few photos cannot tell four
 * parameters of a lens. */
static cln_status extract(cln_colmap *c, int photos, const cln_colmap_model *lens, bool one_camera,
                          const char *list)
{
    char threads[16], side[16];
    const char *argv[32] = {"colmap",
                            "feature_extractor",
                            "--database_path",
                            c->database,
                            "--image_path",
                            c->images,
                            "--ImageReader.camera_model",
                            lens             ? lens->name
                            : photos < PLAIN ? "SIMPLE_RADIAL"
                                             : "OPENCV",
                            "--ImageReader.single_camera",
                            one_camera ? "1" : "0",
                            c->extraction,
                            "0"};
    const bool guess = lens && c->guesses && cln_lens_is_fisheye(lens->lens);
    const char *const more[][2] = {{list ? LIST : NULL, list},
                                   {guess ? GUESS : NULL, FISHEYE},
                                   {c->masks ? MASKS : NULL, c->masks},
                                   {c->room.threads ? c->threads : NULL, threads},
                                   {c->room.side ? c->side : NULL, side}};
    int n = 12;

    snprintf(threads, sizeof threads, "%d", c->room.threads);
    snprintf(side, sizeof side, "%d", c->room.side);
    for (size_t i = 0; i < sizeof more / sizeof *more; i++)
        if (more[i][0]) {
            argv[n++] = more[i][0];
            argv[n++] = more[i][1];
        }
    return run(c, "poses: features", argv);
}

/* A run for each camera: its photos, and no others, get one in the database. */
static cln_status extract_by_camera(cln_colmap *c, const cln_photo_cameras *cameras)
{
    cln_status st = CLN_OK;
    const cln_colmap_model *sphere =
        c->mixed ? &cln_colmap_models[CLN_COLMAP_EQUIRECTANGULAR] : NULL;
    char *list = NULL;

    CLN_TRY(cln_path_join(&list, c->desc->out, "colmap.photos"));
    for (int k = 0; k < cameras->count; k++) {
        CLN_TRY(cln_photo_cameras_list(cameras, &c->photos, k, list));
        CLN_TRY(extract(c, cameras->photos[k], cameras->sphere[k] && !c->lens ? sphere : c->lens,
                        true, list));
        c->before += cameras->photos[k];
    }
done:
    c->before = 0;
    if (list)
        (void)unlink(list);
    free(list);
    return st;
}

/* It goes on without photos that it cannot read, and counts them as without a pose. */
static cln_status tell_unread(const cln_colmap *c)
{
    char which[160] = "";

    if (c->unread == 0)
        return CLN_OK;
    if (*c->unread_name)
        snprintf(which, sizeof which, " (%s%s)", c->unread_name, c->unread > 1 ? ", ..." : "");
    if (c->photos.count - c->unread < CLN_POSES_LEAST)
        return cln_fail(CLN_INPUT, "%s: COLMAP cannot read %d of %d photos%s: " UNREAD,
                        c->desc->photos, c->unread, c->photos.count, which);
    cln_warn("%s: COLMAP cannot read %d of %d photos%s, so they get no pose: " UNREAD,
             c->desc->photos, c->unread, c->photos.count, which);
    return CLN_OK;
}

/* One kind of lens for all photos, or a run for each camera? */
static bool takes_lists(const cln_colmap *c, const cln_photo_cameras *cameras)
{
    return cameras->count <= CAMERAS && c->lists && cln_photo_cameras_listable(&c->photos);
}

#define ORDINARY "; if these are ordinary photos, --lens SIMPLE_RADIAL says so"

/* Pictures that look like panoramas and of which COLMAP would find wrong poses without a word. */
static cln_status refuse_like_panoramas(const cln_colmap *c, const cln_photo_cameras *cameras)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    bool circles = false;

    if (cameras->cuts)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %d of %d photos ('%s') are panoramas, by their XMP data, of which a "
                         "part is cut off: fill them up to 2 : 1 (exiftool shows how much is "
                         "missing where: GPano:CroppedArea...), and give --mask-path with what was "
                         "filled in black",
                         c->desc->photos, cameras->cuts, c->photos.count,
                         c->photos.name[cameras->cut]));
    if (cameras->guessed < 0)
        goto done;
    CLN_TRY(cln_path_join(&path, c->images, c->photos.name[cameras->guessed]));
    CLN_TRY(cln_photo_has_circles(path, &circles));
    if (circles)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: '%s' has two circles of fisheye lenses side by side, as cameras that "
                         "see all around write before their pictures are put together: do that by "
                         "the camera's own program first, or by ffmpeg (man cl-nascent, "
                         "EXAMPLES)" ORDINARY,
                         c->desc->photos, c->photos.name[cameras->guessed]));
done:
    free(path);
    return st;
}

/* Photos that are panoramas of the whole sphere, where no lens was given. A few of 2 : 1 among
 * others may have been cut so. */
static cln_status take_panoramas(cln_colmap *c, cln_photo_cameras *cameras, bool *taken)
{
    cln_status st = CLN_OK;
    const int all = c->photos.count, panoramas = cameras->panoramas, few = 3;
    const char *by = cameras->told == panoramas ? "panoramas of the whole sphere, by their XMP data"
                                                : "2 : 1, as panoramas of the whole sphere are";

    *taken = false;
    if (c->lens) /* of which a part cannot be told */
        return c->lens->lens == CLN_LENS_EQUIRECTANGULAR && cameras->cuts
                   ? refuse_like_panoramas(c, cameras)
                   : CLN_OK;
    if (!cameras->told && panoramas < few && 2 * panoramas <= all)
        return cameras->cuts ? refuse_like_panoramas(c, cameras) : CLN_OK;
    CLN_TRY(refuse_like_panoramas(c, cameras));
    if (panoramas == 0)
        goto done;
    if (!c->spheres)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%d of %d photos are %s, of which this COLMAP finds no poses: install "
                         "version 4.1 or newer, or find the poses of panoramas by OpenSfM or "
                         "Metashape, which `train` reads, or cut them into pictures of 90 degrees "
                         "(man cl-nascent, EXAMPLES)" ORDINARY,
                         panoramas, all, by));
    if (panoramas < all && !takes_lists(c, cameras))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%d of %d photos are %s, beside others of many sizes: find the poses of "
                         "each kind in a folder of its own" ORDINARY,
                         panoramas, all, by));
    *taken = true;
    if (panoramas < all) {
        c->mixed = true;
        cln_info("lens: %s of %d photos, as they are %s; of ordinary ones give --lens "
                 "SIMPLE_RADIAL",
                 cln_colmap_models[CLN_COLMAP_EQUIRECTANGULAR].name, panoramas, by);
        goto done;
    }
    c->lens = &cln_colmap_models[CLN_COLMAP_EQUIRECTANGULAR];
    cln_info("lens: %s, as the photos are %s; of ordinary ones give --lens SIMPLE_RADIAL",
             c->lens->name, by);
done:
    return st;
}

cln_status cln_colmap_features(cln_colmap *c)
{
    cln_status st = CLN_OK;
    cln_photo_cameras cameras = {0};
    char focal[RANGE], several[96];
    bool taken = false;

    CLN_TRY(cln_photo_cameras_find(c->images, &c->photos, &cameras));
    cln_format(several, sizeof several, "of several %s",
               !cameras.lengths ? "sizes"
               : cameras.sizes  ? "sizes and focal lengths by EXIF, or none"
                                : "focal lengths by EXIF, or none");
    CLN_TRY(take_panoramas(c, &cameras, &taken));
    fit_memory(c, &cameras);
    if (c->lens && !taken)
        cln_info("lens: %s, as given by --lens", c->lens->name);
    if (cameras.count == 1) {
        cln_info("%d photos, all of one size: one camera", c->photos.count);
        CLN_TRY(extract(c, c->photos.count, c->lens, true, NULL));
    } else if (!takes_lists(c, &cameras)) {
        cln_info("%d photos, %s: a camera for each photo", c->photos.count, several);
        CLN_TRY(extract(c, c->photos.count, c->lens, false, NULL));
    } else {
        cln_info("%d photos, %s: %d cameras", c->photos.count, several, cameras.count);
        CLN_TRY(extract_by_camera(c, &cameras));
    }
    CLN_TRY(tell_unread(c));
    if (c->lens && c->lens->lens == CLN_LENS_EQUIRECTANGULAR)
        goto done; /* which has none */
    if (c->focal_lengths)
        cln_info("EXIF tells the focal length of %d photo%s: %s pixels", c->focal_lengths,
                 cln_plural(c->focal_lengths, "", "s"),
                 range(c->focal_least, c->focal_most, focal));
    else if (!c->kept)
        cln_info("EXIF tells no focal length: COLMAP estimates it from the photos");
done:
    cln_photo_cameras_free(&cameras);
    return st;
}

/* Is each photo matched with the next ones alone? *automatic: nobody asked for one of the ways. */
static bool matches_next(const cln_colmap *c, bool ordered, bool *automatic)
{
    const char *how = c->desc->match ? c->desc->match : "auto";

    *automatic = strcmp(how, "auto") == 0;
    return *automatic ? c->photos.count > FEW && ordered : strcmp(how, "next") == 0;
}

static long long pairs_of(const cln_colmap *c)
{
    return (long long)c->photos.count * (c->photos.count - 1) / 2;
}

void cln_colmap_warn_many(const cln_colmap *c, bool ordered)
{
    bool automatic;

    if (!matches_next(c, ordered, &automatic) && c->photos.count > MANY)
        cln_warn(
            "%d photos, each matched with all others, are %lld pairs, which takes long: give "
            "--match next if they were taken one after the other, in the order of their names, "
            "or fewer photos: 100 to 200 are enough for most things",
            c->photos.count, pairs_of(c));
}

cln_status cln_colmap_match(cln_colmap *c, bool ordered)
{
    bool automatic = false;
    const bool next = matches_next(c, ordered, &automatic);
    char overlap[16], block[16];

    snprintf(block, sizeof block, "%d",
             c->photos.count < 10 * BLOCK_LEAST  ? BLOCK_LEAST
             : c->photos.count > 10 * BLOCK_MOST ? BLOCK_MOST
                                                 : c->photos.count / 10);
    snprintf(overlap, sizeof overlap, "%d", NEXT);
    if (next) {
        cln_info("matching each photo with the next %d%s", NEXT,
                 automatic ? ", as there are many and they are numbered" : "");
        return run(c, "poses: matches",
                   (const char *const[]){"colmap", "sequential_matcher", "--database_path",
                                         c->database, "--SequentialMatching.overlap", overlap,
                                         c->matching, "0", NULL});
    }
    cln_info("matching all photos with all: %lld pairs", pairs_of(c));
    return run(c, "poses: matches",
               (const char *const[]){"colmap", "exhaustive_matcher", "--database_path", c->database,
                                     c->matching, "0", c->blocks ? BLOCK : NULL, block, NULL});
}

/* Are the photos of a model all in another one, too? It is a beginning that was given up. */
static cln_status is_within(const char *model, const char *other, bool *within)
{
    cln_status st = CLN_OK;
    cln_names names[2] = {{0}};
    double(*at[2])[3] = {NULL};
    const char *const folders[2] = {model, other};

    *within = true;
    for (int k = 0; k < 2; k++)
        CLN_TRY(cln_colmap_places(folders[k], &names[k], &at[k]));
    cln_dataset_sort_names(&names[1]);
    for (int i = 0; i < names[0].count && *within; i++)
        *within = cln_dataset_has_name(&names[1], names[0].name[i]);
done:
    for (int k = 0; k < 2; k++) {
        cln_dataset_free_names(&names[k]);
        free(at[k]);
    }
    return st;
}

/* Removes models whose photos are all in model 0; fills counts[] of the others, [0] of that one. */
static cln_status drop_beginnings(const cln_colmap *c, const char *first, int counts[MODELS])
{
    cln_status st = CLN_OK;
    char *model = NULL, name[16];
    bool within = false;

    counts[0] = cln_colmap_images(first);
    for (int i = 1; i < MODELS; i++) {
        free(model);
        model = NULL;
        snprintf(name, sizeof name, "%d", i);
        CLN_TRY(cln_path_join(&model, c->sparse, name));
        counts[i] = cln_colmap_images(model);
        if (counts[i] <= 0)
            continue;
        st = is_within(model, first, &within);
        if (st == CLN_INPUT) { /* it cannot be read: what reads the scene says so */
            cln_clear_error();
            within = false;
            st = CLN_OK;
        }
        CLN_TRY(st);
        if (!within)
            continue;
        CLN_TRY(cln_colmap_remove(model));
        counts[i] = 0;
    }
done:
    free(model);
    return st;
}

/* Groups of photos that do not hang together. */
static void tell_groups(const cln_colmap *c, const int counts[MODELS])
{
    char text[128] = "";
    size_t used = 0;
    int groups = 0, second = 0;

    for (int i = 0; i < MODELS; i++)
        if (counts[i] > 0) {
            groups++;
            second = second ? second : i;
            if (used < sizeof text - 1)
                used += (size_t)snprintf(text + used, sizeof text - used, "%s%d", used ? ", " : "",
                                         counts[i]);
        }
    if (groups > 1)
        cln_warn("the photos fall into %d groups of %s photos: the largest is used. Where they "
                 "show two things, each group is a scene of its own: %s/sparse/%d",
                 groups, text, c->desc->out, second);
}

/* COLMAP writes a model for each group of photos that overlap: the largest becomes number 0. */
static cln_status choose_model(cln_colmap *c)
{
    cln_status st = CLN_OK;
    char *model[2] = {0}, *kept = NULL, *final = NULL, most_text[64] = "";
    int best = -1, most = 0, counts[MODELS];

    for (int i = 0; i < MODELS; i++) {
        char name[16];
        int count = 0;

        snprintf(name, sizeof name, "%d", i);
        free(model[0]);
        model[0] = NULL;
        CLN_TRY(cln_path_join(&model[0], c->sparse, name));
        count = cln_colmap_images(model[0]);
        if (count > most) {
            most = count;
            best = i;
        }
    }
    if (c->together > 0)
        snprintf(most_text, sizeof most_text, " (at most %d of %d hung together)", c->together,
                 c->photos.count);
    if (best < 0)
        CLN_TRY(cln_fail(CLN_FAILED,
                         "%s: COLMAP found no poses: the photos show too little in "
                         "common%s. " CLN_POSES_ADVICE "%s (%s)",
                         c->desc->photos, most_text,
                         c->lens ? "" : "; of a fisheye, give --lens OPENCV_FISHEYE, too",
                         c->log_path));
    if (best > 0) {
        char name[16];

        snprintf(name, sizeof name, "%d", best);
        CLN_TRY(cln_path_join(&model[1], c->sparse, name));
        free(model[0]);
        model[0] = NULL;
        CLN_TRY(cln_path_join(&model[0], c->sparse, "0"));
        CLN_TRY(cln_path_join(&kept, c->sparse, "aside"));
        if (rename(model[0], kept) || rename(model[1], model[0]) || rename(kept, model[1]))
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", c->sparse, strerror(errno)));
    }
    free(model[0]);
    model[0] = NULL;
    CLN_TRY(cln_path_join(&model[0], c->sparse, "0"));
    CLN_TRY(drop_beginnings(c, model[0], counts));
    tell_groups(c, counts);
    CLN_TRY(cln_path_join(&final, c->desc->out, "sparse"));
    if (rename(c->sparse, final))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", final, strerror(errno)));
done:
    free(model[0]);
    free(model[1]);
    free(kept);
    free(final);
    return st;
}

cln_status cln_colmap_map(cln_colmap *c)
{
    cln_status st = CLN_OK;
    char least[16];

    snprintf(least, sizeof least, "%d", CLN_POSES_LEAST);
    CLN_TRY(cln_make_dirs(c->sparse));
    /* COLMAP's ten is much of a few photos; where there are many, a good start has more */
    st = run(c, "poses: registered photos",
             (const char *const[]){"colmap", "mapper", "--database_path", c->database,
                                   "--image_path", c->images, "--output_path", c->sparse,
                                   c->sized && c->photos.count < PLAIN ? SIZE : NULL, least, NULL});
    if (st == CLN_FAILED && strstr(cln_error_text(), "failed to create sparse model")) {
        cln_clear_error(); /* a better sentence follows below */
        st = CLN_OK;
    }
    CLN_TRY(st);
    CLN_TRY(choose_model(c));
done:
    return st;
}

cln_status cln_colmap_transform(cln_colmap *c, const char *model, const cln_similarity *by,
                                bool by_matrix, const char *out)
{
    cln_status st = CLN_OK;
    char *path = NULL, text[512];
    double pose[12] = {0}, q[4];
    int bytes = 0;

    CLN_TRY(cln_path_join(&path, c->desc->out, "colmap.transform"));
    for (int k = 0; k < 9; k++)
        pose[4 * (k / 3) + k % 3] = by->turn[k];
    cln_pose_quaternion(pose, q);
    for (int k = 0; k < 3 && by_matrix; k++)
        bytes += cln_format(text + bytes, sizeof text - (size_t)bytes, "%.17g %.17g %.17g %.17g\n",
                            by->scale * by->turn[3 * k], by->scale * by->turn[3 * k + 1],
                            by->scale * by->turn[3 * k + 2], by->shift[k]);
    if (!by_matrix)
        bytes =
            cln_format(text, sizeof text, "%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n",
                       by->scale, q[0], q[1], q[2], q[3], by->shift[0], by->shift[1], by->shift[2]);
    CLN_TRY(cln_write_file(path, text, (size_t)bytes));
    CLN_TRY(run(c, "poses: place by GPS",
                (const char *const[]){"colmap", "model_transformer", "--input_path", model,
                                      "--output_path", out, "--transform_path", path, NULL}));
done:
    if (st == CLN_FAILED && strstr(cln_error_text(), "not recognized")) {
        cln_clear_error();
        st = cln_fail(CLN_FAILED, "the COLMAP that is installed cannot place a scene "
                                  "(model_transformer); install version 3.8 or newer");
    }
    if (path)
        (void)unlink(path);
    free(path);
    return st;
}

static int remove_one(const char *path, const struct stat *info, int kind, struct FTW *where)
{
    (void)info;
    (void)kind;
    (void)where;
    return remove(path);
}

cln_status cln_colmap_remove(const char *folder)
{
    enum { OPEN = 8 };

    if (cln_is_dir(folder) && nftw(folder, remove_one, OPEN, FTW_DEPTH | FTW_PHYS) != 0)
        return cln_fail(CLN_OUTPUT,
                        "%s: of an earlier attempt, and cannot be removed: %s; remove it, or give "
                        "another folder with -o",
                        folder, strerror(errno));
    return CLN_OK;
}

/* What COLMAP made of the focal length, which a person may know. */
void cln_colmap_say_focal_length(const cln_colmap *c, const cln_scene *scene)
{
    double least = INFINITY, most = 0, told = 0;
    int width = 0; /* of all, or -1 */
    char focal[RANGE], wide[64] = "";

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const double pixels = view->camera.fx * view->file_width / view->camera.width;

        if (view->camera.lens == CLN_LENS_EQUIRECTANGULAR) /* it has none */
            continue;
        least = fmin(least, pixels);
        most = fmax(most, pixels);
        width = width == 0 || width == view->file_width ? view->file_width : -1;
    }
    if (width == 0)
        return;
    if (width > 0)
        cln_format(wide, sizeof wide, ", of photos %d pixels wide", width);
    cln_info("COLMAP's focal length: %s pixels%s", range(least, most, focal), wide);
    told = c->focal_least;
    if (c->focal_lengths && c->focal_most < ALIKE * told && most < ALIKE * least &&
        fmax(most, told) > APART * fmin(most, told))
        cln_warn("that is %.2g times what the photos' EXIF data tell: some may have been zoomed or "
                 "cropped, or be of another lens, and poses be wrong for it; leave such out, or "
                 "give them as the camera wrote them",
                 most / told);
}
