/* The files of a COLMAP sparse model, binary or text:
 *   cameras   id, camera model, width, height, parameters
 *   images    id, quaternion w x y z and translation of world-to-camera, id of the camera, name,
 *             and the places of its points, which are skipped
 *   points3D  id, x y z, colour, error, and the images that have it
 * Newer models have rigs and frames besides; images still have every pose. Not the database. */
#include "scene/colmap.h"

#include <math.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/text.h"
#include "base/memory.h"
#include "io/cursor.h"
#include "scene/dataset.h"

static const size_t MAX_BYTES = (size_t)1 << 34;
enum { MAX_POINTS = 100000000, MAX_SIDE = 1000000 };

static cln_status set_size(const char *path, double width, double height, cln_colmap_camera *camera)
{
    if (!(width >= 1 && width <= MAX_SIDE && height >= 1 && height <= MAX_SIDE))
        return cln_fail(CLN_INPUT,
                        "%s: camera %u: absurd image size %g x %g; export the model again", path,
                        camera->id, width, height);
    camera->width = (int)width;
    camera->height = (int)height;
    return CLN_OK;
}

static cln_status too_many(const char *path, size_t count, const char *what, int most)
{
    return cln_fail(CLN_INPUT, "%s: %zu %s, more than the %d that are read; export a smaller model",
                    path, count, what, most);
}

static cln_status add_observation(cln_colmap *out, uint32_t image)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_grow(&out->observations, out->observation_count, sizeof *out->observations,
                     "images of points"));
    out->observations[out->observation_count++] =
        (cln_observation){.point = out->point_count, .view = (int32_t)image};
done:
    return st;
}

/* ---- binary ---- */

static cln_status read_camera(cln_cursor *c, cln_colmap_camera *camera)
{
    cln_status st = CLN_OK;
    int32_t id = 0;
    uint64_t size[2] = {0};

    CLN_TRY(cln_cursor_take(c, "a camera", &camera->id, sizeof camera->id));
    CLN_TRY(cln_cursor_take(c, "a camera", &id, sizeof id));
    CLN_TRY(cln_cursor_take(c, "a camera", size, sizeof size));
    if (id < 0 || id >= CLN_COLMAP_MODELS)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: camera %u has the unknown camera model %d, of 0 to %d; convert it to "
                         "one of these with COLMAP",
                         c->path, camera->id, id, CLN_COLMAP_MODELS - 1));
    camera->model = &cln_colmap_models[id];
    CLN_TRY(set_size(c->path, (double)size[0], (double)size[1], camera));
    CLN_TRY(cln_cursor_take(c, "a camera", camera->params,
                            (size_t)camera->model->count * sizeof *camera->params));
done:
    return st;
}

static cln_status read_cameras(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;
    size_t count = 0;

    CLN_TRY(cln_cursor_count(c, "cameras", 24, &count));
    if (count > CLN_MAX_VIEWS)
        CLN_TRY(too_many(c->path, count, "cameras", CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&out->cameras, count, sizeof *out->cameras, "cameras"));
    for (; out->camera_count < (int)count; out->camera_count++)
        CLN_TRY(read_camera(c, &out->cameras[out->camera_count]));
done:
    return st;
}

static cln_status read_image(cln_cursor *c, cln_colmap_image *image)
{
    cln_status st = CLN_OK;
    const char *name = NULL;
    size_t points = 0;

    CLN_TRY(cln_cursor_take(c, "an image", &image->id, sizeof image->id));
    CLN_TRY(cln_cursor_take(c, "an image", image->pose, sizeof image->pose));
    CLN_TRY(cln_cursor_take(c, "an image", &image->camera, sizeof image->camera));
    CLN_TRY(cln_cursor_text(c, "the name of an image", &name));
    CLN_TRY(cln_dataset_name(c->path, name, &image->name));
    CLN_TRY(cln_cursor_count(c, "points of an image", 24, &points));
    c->at += 24 * points;
done:
    return st;
}

static cln_status read_images(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;
    size_t count = 0;

    CLN_TRY(cln_cursor_count(c, "images", 73, &count));
    if (count > CLN_MAX_VIEWS)
        CLN_TRY(too_many(c->path, count, "images", CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&out->images, count, sizeof *out->images, "images"));
    while (out->image_count < (int)count)
        CLN_TRY(read_image(c, &out->images[out->image_count++]));
done:
    return st;
}

static cln_status read_points(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;
    size_t count = 0, track = 0;
    uint64_t id = 0;
    double error = 0;

    CLN_TRY(cln_cursor_count(c, "points", 51, &count));
    if (count > MAX_POINTS)
        CLN_TRY(too_many(c->path, count, "points", MAX_POINTS));
    CLN_TRY(cln_alloc(&out->points, count, sizeof *out->points, "points"));
    for (; out->point_count < (int)count; out->point_count++) {
        cln_point *point = &out->points[out->point_count];

        CLN_TRY(cln_cursor_take(c, "a point", &id, sizeof id));
        CLN_TRY(cln_cursor_take(c, "a point", point->xyz, sizeof point->xyz));
        for (int i = 0; i < 3; i++)
            if (!isfinite(point->xyz[i]))
                CLN_TRY(cln_fail(CLN_INPUT,
                                 "%s: the position of point %llu is not finite; export the model "
                                 "again",
                                 c->path, (unsigned long long)id));
        CLN_TRY(cln_cursor_take(c, "a point", point->rgb, sizeof point->rgb));
        CLN_TRY(cln_cursor_take(c, "a point", &error, sizeof error));
        point->error = error > 0 && error < 1e6 ? (float)error : 0;
        CLN_TRY(cln_cursor_count(c, "images of a point", 8, &track));
        for (size_t i = 0; i < track; i++) {
            uint32_t seen[2]; /* the image's id, and which of its points it is there */

            CLN_TRY(cln_cursor_take(c, "an image of a point", seen, sizeof seen));
            CLN_TRY(add_observation(out, seen[0]));
        }
        point->views = track < CLN_MAX_VIEWS ? (int)track : CLN_MAX_VIEWS;
    }
done:
    return st;
}

/* ---- text ---- */

/* Up to `most` commas behind numbers become blanks, as COLMAP takes them, and kapture writes them;
 * an image's name keeps its own. */
static void open_commas(char *line, int most)
{
    static const char numbers[] = "0123456789+-.eE \t";

    for (int i = 0; i < most; i++) {
        line += strspn(line, numbers);
        if (*line != ',')
            return;
        *line = ' ';
    }
}

/* The next line with data, "#" begins a comment; NULL after the last. */
static char *data_line(cln_cursor *c)
{
    for (char *line = NULL; (line = cln_cursor_line(c));)
        if (line[strspn(line, " \t")] && line[strspn(line, " \t")] != '#')
            return line;
    return NULL;
}

static cln_status bad_line(const cln_cursor *c, const char *form)
{
    return cln_fail(CLN_INPUT,
                    "%s: line %d is not: %s; correct the line, or export the model again", c->path,
                    c->line, form);
}

/* *name: what the model is called, if it is not known. */
static bool parse_camera(char *line, cln_colmap_camera *camera, double size[2], const char **name)
{
    double id = 0;
    char *word = NULL;

    if (!cln_field_whole(&line, UINT32_MAX, &id) || !cln_field_word(&line, &word))
        return false;
    camera->id = (uint32_t)id;
    for (int i = 0; i < CLN_COLMAP_MODELS; i++)
        if (!strcmp(cln_colmap_models[i].name, word))
            camera->model = &cln_colmap_models[i];
    if (!cln_field_number(&line, &size[0]) || !cln_field_number(&line, &size[1]))
        return false;
    *name = camera->model ? NULL : word;
    if (!camera->model)
        return false;
    for (int i = 0; i < camera->model->count; i++)
        if (!cln_field_number(&line, &camera->params[i]))
            return false;
    return !cln_field_word(&line, &word);
}

/* A line that cannot be parsed; name: NULL, or a model that is not known, as a panorama's in
 * SphereSfM and in branches of COLMAP, whose directions are those of COLMAP's. */
static cln_status bad_camera(const cln_cursor *c, uint32_t id, const char *name,
                             const double size[2])
{
    if (name && (strcmp(name, "SPHERE") == 0 || strcmp(name, "SPHERICAL") == 0))
        return cln_fail(CLN_INPUT,
                        "%s: line %d: %s is no camera model of COLMAP; that of a panorama is "
                        "EQUIRECTANGULAR: make the line \"%u EQUIRECTANGULAR %.9g %.9g %.9g %.9g\"",
                        c->path, c->line, name, id, size[0], size[1], size[0], size[1]);
    return bad_line(c, "id, one of COLMAP's camera models, width, height and the model's "
                       "parameters");
}

static cln_status parse_cameras(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;

    for (char *line = NULL; (line = data_line(c));) {
        double size[2] = {0};
        const char *name = NULL;

        if (out->camera_count >= CLN_MAX_VIEWS)
            CLN_TRY(too_many(c->path, CLN_MAX_VIEWS + 1, "cameras", CLN_MAX_VIEWS));
        CLN_TRY(cln_grow(&out->cameras, out->camera_count, sizeof *out->cameras, "cameras"));
        if (!parse_camera(line, &out->cameras[out->camera_count], size, &name))
            CLN_TRY(bad_camera(c, out->cameras[out->camera_count].id, name, size));
        CLN_TRY(set_size(c->path, size[0], size[1], &out->cameras[out->camera_count]));
        out->camera_count++;
    }
done:
    return st;
}

/* Parses an image's line up to its name, which is the rest and may have blanks: *line. */
static bool parse_image(char **line, cln_colmap_image *image)
{
    double id = 0, camera = 0;
    bool good = false;

    open_commas(*line, 9);
    good = cln_field_whole(line, UINT32_MAX, &id);
    for (int i = 0; i < 7 && good; i++)
        good = cln_field_number(line, &image->pose[i]);
    if (!good || !cln_field_whole(line, UINT32_MAX, &camera))
        return false; /* numbers may be out of range */
    image->id = (uint32_t)id;
    image->camera = (uint32_t)camera;
    *line += strspn(*line, " \t");
    return **line;
}

/* Is it an image's line, where that of the points of the one before it belongs? Points are numbers
 * alone. */
static bool is_next_image(const cln_colmap *model, char *line)
{
    cln_colmap_image image;
    double number = 0;
    bool known = false;

    if (!line || !parse_image(&line, &image) || cln_field_number(&line, &number))
        return false;
    for (int i = 0; i < model->camera_count; i++)
        known = known || model->cameras[i].id == image.camera;
    return known;
}

static cln_status parse_images(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;

    for (char *line = NULL; (line = data_line(c));) {
        cln_colmap_image *image = NULL;

        if (out->image_count >= CLN_MAX_VIEWS)
            CLN_TRY(too_many(c->path, CLN_MAX_VIEWS + 1, "images", CLN_MAX_VIEWS));
        CLN_TRY(cln_grow(&out->images, out->image_count, sizeof *out->images, "images"));
        image = &out->images[out->image_count];
        if (!parse_image(&line, image))
            CLN_TRY(bad_line(c, "id, quaternion, translation, id of the camera and name of an "
                                "image"));
        CLN_TRY(cln_dataset_name(c->path, line, &image->name));
        out->image_count++;
        if (is_next_image(out, cln_cursor_line(c))) /* its points, which may be none */
            CLN_TRY(
                cln_fail(CLN_INPUT,
                         "%s: line %d is an image, where the line of the points of '%s' belongs; "
                         "add an empty line after each image",
                         c->path, c->line, image->name));
    }
done:
    return st;
}

static cln_status parse_points(cln_cursor *c, cln_colmap *out)
{
    cln_status st = CLN_OK;

    for (char *line = NULL; (line = data_line(c));) {
        cln_point *point = NULL;
        double value = 0;
        char *word = NULL;
        int words = 0;
        bool good = false;

        open_commas(line, INT_MAX);
        good = cln_field_number(&line, &value);
        if (out->point_count >= MAX_POINTS)
            CLN_TRY(too_many(c->path, (size_t)MAX_POINTS + 1, "points", MAX_POINTS));
        CLN_TRY(cln_grow(&out->points, out->point_count, sizeof *out->points, "points"));
        point = &out->points[out->point_count];
        for (int i = 0; i < 3 && good; i++)
            good = cln_field_number(&line, &point->xyz[i]);
        for (int i = 0; i < 3 && good; i++) {
            good = cln_field_whole(&line, 255, &value);
            if (good)
                point->rgb[i] = (uint8_t)value;
        }
        if (!good || !cln_field_number(&line, &value))
            CLN_TRY(bad_line(c, "id, position, colour, error and images of a point"));
        point->error = value > 0 && value < 1e6 ? (float)value : 0;
        for (; words < 2 * CLN_MAX_VIEWS && cln_field_word(&line, &word); words++)
            if (words % 2 == 0) {
                double image = 0;

                if (cln_field_whole(&word, UINT32_MAX, &image))
                    CLN_TRY(add_observation(out, (uint32_t)image));
            }
        point->views = words / 2; /* two words for an image: its id, the point's number in it */
        out->point_count++;
    }
done:
    return st;
}

/* ---- both ---- */

int cln_colmap_images(const char *folder)
{
    const bool binary = cln_has_file(folder, "images.bin");
    static const char says[] = "# Number of images: ";
    char *path = NULL, head[512] = "";
    const char *said = NULL;
    uint64_t count = 0;
    FILE *f = NULL;

    if (cln_path_join(&path, folder, binary ? "images.bin" : "images.txt") == CLN_OK &&
        cln_is_file(path))
        f = fopen(path, "rb");
    if (f && binary && fread(&count, sizeof count, 1, f) != 1)
        count = 0;
    if (f && !binary && fread(head, 1, sizeof head - 1, f) > 0 && (said = strstr(head, says)))
        count = strtoull(said + sizeof says - 1, NULL, 10);
    if (f)
        fclose(f);
    cln_clear_error();
    free(path);
    return count > (uint64_t)CLN_MAX_VIEWS ? 0 : (int)count;
}

bool cln_colmap_is_model(const char *folder, const char **missing)
{
    const bool cameras[2] = {cln_has_file(folder, "cameras.bin"),
                             cln_has_file(folder, "cameras.txt")};
    const bool images[2] = {cln_has_file(folder, "images.bin"), cln_has_file(folder, "images.txt")};

    if ((cameras[0] && images[0]) || (cameras[1] && images[1]))
        return true;
    if (cameras[0] || cameras[1])
        *missing = "there are cameras, but no images beside them";
    else if (images[0] || images[1])
        *missing = "there are images, but no cameras beside them";
    return false;
}

static cln_status read_file(const char *path, cln_status (*read)(cln_cursor *, cln_colmap *),
                            cln_colmap *out)
{
    cln_status st = CLN_OK;
    cln_cursor cursor = {.path = path};

    CLN_TRY((cln_ends_with(path, ".txt") ? cln_read_text : cln_read_file)(
        path, MAX_BYTES, &cursor.data, &cursor.size));
    CLN_TRY(read(&cursor, out));
done:
    free(cursor.data);
    return st;
}

cln_status cln_colmap_read(const char *folder, cln_colmap *out)
{
    cln_status st = CLN_OK;
    const bool binary = cln_has_file(folder, "cameras.bin") && cln_has_file(folder, "images.bin");
    char *points = NULL;

    CLN_TRY(cln_path_join(&out->camera_file, folder, binary ? "cameras.bin" : "cameras.txt"));
    CLN_TRY(cln_path_join(&out->image_file, folder, binary ? "images.bin" : "images.txt"));
    CLN_TRY(cln_path_join(&points, folder, binary ? "points3D.bin" : "points3D.txt"));
    CLN_TRY(read_file(out->camera_file, binary ? read_cameras : parse_cameras, out));
    CLN_TRY(read_file(out->image_file, binary ? read_images : parse_images, out));
    if (cln_is_file(points))
        CLN_TRY(read_file(points, binary ? read_points : parse_points, out));
done:
    free(points);
    return st;
}

void cln_colmap_free(cln_colmap *model)
{
    for (int i = 0; i < model->image_count; i++)
        free(model->images[i].name);
    free(model->images);
    free(model->cameras);
    free(model->points);
    free(model->observations);
    free(model->camera_file);
    free(model->image_file);
    *model = (cln_colmap){0};
}
