/* One scene of known cameras in every format, written by the formats' definitions, independent of
 * the readers' code. Images are view_00.png ... in a folder, 16 x 12 pixels times `size`. */
#ifndef CLN_TESTS_FORMAT_FIXTURE_H
#define CLN_TESTS_FORMAT_FIXTURE_H

#include <math.h>
#include <zlib.h>
#include "scene/reader.h"
#include "scene_fixture.h"

/* Every image trains, at its size. */
static inline const cln_config *plain(void)
{
    static cln_config config;

    config = default_config();
    config.holdout = 0;
    config.downscale = 1;
    return &config;
}

enum { FORMAT_VIEWS = 6, FORMAT_WIDTH = 16, FORMAT_HEIGHT = 12 };

/* Cameras in a ring at distance 4 that look close to (1, 2, 3), rolled, at different heights. Plain
 * intrinsics: one focal length, principal point in the middle. */
static inline void format_cameras(cln_camera cameras[FORMAT_VIEWS])
{
    memset(cameras, 0, FORMAT_VIEWS * sizeof *cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        cln_camera *c = &cameras[v];
        const double angle = 0.9 * v, roll = 0.2 * v - 0.5;
        const double place[3] = {1 + 4 * cos(angle), 2 + 4 * sin(angle), 3 + 0.3 * v - 1};
        double z[3] = {1.1 - place[0], 2 - 0.05 * v - place[1], 3 - place[2]};
        double length = sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2]), flat = 0;
        double right[3], down[3];

        for (int i = 0; i < 3; i++)
            z[i] /= length;
        flat = hypot(z[0], z[1]);
        right[0] = z[1] / flat; /* z x up */
        right[1] = -z[0] / flat;
        right[2] = 0;
        for (int i = 0; i < 3; i++) /* z x right */
            down[i] = z[(i + 1) % 3] * right[(i + 2) % 3] - z[(i + 2) % 3] * right[(i + 1) % 3];
        for (int i = 0; i < 3; i++) {
            c->c2w[4 * i] = cos(roll) * right[i] + sin(roll) * down[i];
            c->c2w[4 * i + 1] = -sin(roll) * right[i] + cos(roll) * down[i];
            c->c2w[4 * i + 2] = z[i];
            c->c2w[4 * i + 3] = place[i];
        }
        c->width = FORMAT_WIDTH;
        c->height = FORMAT_HEIGHT;
        c->fx = c->fy = 20;
        c->cx = 8;
        c->cy = 6;
    }
}

/* World to camera: x' = rotation x + translation. */
static inline void format_w2c(const cln_camera *camera, double rotation[9], double translation[3])
{
    const double *m = camera->c2w;

    for (int i = 0; i < 3; i++) {
        translation[i] = 0;
        for (int j = 0; j < 3; j++) {
            rotation[3 * i + j] = m[4 * j + i];
            translation[i] -= m[4 * j + i] * m[4 * j + 3];
        }
    }
}

static inline void format_images(const char *folder, int size)
{
    char *path = NULL;

    assert_int_equal(cln_make_dirs(folder), CLN_OK);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        uint8_t pixels[FORMAT_WIDTH * FORMAT_HEIGHT * 3 * 16];
        char name[32];

        assert_in_range(size, 1, 4);
        memset(pixels, 20 * v, sizeof pixels);
        snprintf(name, sizeof name, "view_%02d.png", v);
        assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
        assert_int_equal(
            cln_image_write_png(path, size * FORMAT_WIDTH, size * FORMAT_HEIGHT, 3, pixels),
            CLN_OK);
        free(path);
    }
}

static inline FILE *format_open(const char *folder, const char *name)
{
    char *path = NULL;
    FILE *f = NULL;

    assert_int_equal(cln_make_dirs(folder), CLN_OK);
    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    f = fopen(path, "wb");
    assert_non_null(f);
    free(path);
    return f;
}

/* ---- COLMAP ---- */

static inline void put_u32(FILE *f, uint32_t value)
{
    fwrite(&value, sizeof value, 1, f);
}

static inline void put_u64(FILE *f, uint64_t value)
{
    fwrite(&value, sizeof value, 1, f);
}

static inline void put_reals(FILE *f, int count, const double *values)
{
    fwrite(values, sizeof *values, (size_t)count, f);
}

/* Quaternion w x y z of a rotation, by its largest component; q and -q are the same. */
static inline void format_quaternion(const double r[9], double q[4])
{
    const double squares[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8],
                               1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]};
    const double products[4][4] = {
        {squares[0], r[7] - r[5], r[2] - r[6], r[3] - r[1]},
        {r[7] - r[5], squares[1], r[3] + r[1], r[2] + r[6]},
        {r[2] - r[6], r[3] + r[1], squares[2], r[7] + r[5]},
        {r[3] - r[1], r[2] + r[6], r[7] + r[5], squares[3]},
    };
    int k = 0;

    for (int i = 1; i < 4; i++)
        k = squares[i] > squares[k] ? i : k;
    for (int i = 0; i < 4; i++)
        q[i] = products[k][i] / (2 * sqrt(squares[k]));
}

/* A camera model in a COLMAP file: its parameters follow those of the given camera. */
typedef struct format_model {
    int id;
    const char *name;
    int count;
    double params[16];
} format_model;

/* PINHOLE or OPENCV, as the camera needs. */
static inline format_model format_model_of(const cln_camera *c)
{
    const format_model plain = {1, "PINHOLE", 4, {c->fx, c->fy, c->cx, c->cy}};
    const format_model bent = {
        4, "OPENCV", 8, {c->fx, c->fy, c->cx, c->cy, c->k1, c->k2, c->p1, c->p2}};

    return cln_camera_is_distorted(c) ? bent : plain;
}

/* Each view has its own camera; ids are 7 + 3 v, in descending order. Each image has one point;
 * points are given. */
static inline void format_colmap(const char *folder, bool binary, const cln_camera *cameras,
                                 const format_model *model, const cln_point *points, int count)
{
    FILE *f = format_open(folder, binary ? "cameras.bin" : "cameras.txt");

    if (binary)
        put_u64(f, FORMAT_VIEWS);
    else
        fprintf(f, "# Camera list\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for (int v = FORMAT_VIEWS - 1; v >= 0; v--) {
        const format_model own = model ? *model : format_model_of(&cameras[v]);

        if (binary) {
            put_u32(f, (uint32_t)(7 + 3 * v));
            put_u32(f, (uint32_t)own.id);
            put_u64(f, (uint64_t)cameras[v].width);
            put_u64(f, (uint64_t)cameras[v].height);
            put_reals(f, own.count, own.params);
            continue;
        }
        fprintf(f, "%d %s %d %d", 7 + 3 * v, own.name, cameras[v].width, cameras[v].height);
        for (int i = 0; i < own.count; i++)
            fprintf(f, " %.17g", own.params[i]);
        fprintf(f, "\n");
    }
    fclose(f);
    f = format_open(folder, binary ? "images.bin" : "images.txt");
    if (binary)
        put_u64(f, FORMAT_VIEWS);
    else
        fprintf(f, "# Image list with two lines of data per image:\n# Number of images: 6\n");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        double rotation[9], pose[7];
        char name[32];

        snprintf(name, sizeof name, "view_%02d.png", v);
        format_w2c(&cameras[v], rotation, pose + 4);
        format_quaternion(rotation, pose);
        if (binary) {
            put_u32(f, (uint32_t)v + 1);
            put_reals(f, 7, pose);
            put_u32(f, (uint32_t)(7 + 3 * v));
            fwrite(name, strlen(name) + 1, 1, f);
            put_u64(f, 1);
            put_reals(f, 2, (double[2]){5.5, 3.25});
            put_u64(f, UINT64_MAX);
            continue;
        }
        fprintf(f, "%d", v + 1);
        for (int i = 0; i < 7; i++)
            fprintf(f, " %.17g", pose[i]);
        fprintf(f, " %d %s\n%s\n", 7 + 3 * v, name, v % 2 ? "" : "5.5 3.25 -1");
    }
    fclose(f);
    f = format_open(folder, binary ? "points3D.bin" : "points3D.txt");
    if (binary)
        put_u64(f, (uint64_t)count);
    for (int i = 0; i < count; i++) {
        const cln_point *p = &points[i];

        if (binary) {
            put_u64(f, (uint64_t)i + 1);
            put_reals(f, 3, p->xyz);
            fwrite(p->rgb, 3, 1, f);
            put_reals(f, 1, (double[1]){0.5});
            put_u64(f, (uint64_t)p->views);
        } else {
            fprintf(f, "%d %.17g %.17g %.17g %d %d %d 0.5", i + 1, p->xyz[0], p->xyz[1], p->xyz[2],
                    p->rgb[0], p->rgb[1], p->rgb[2]);
        }
        for (int k = 0; k < p->views; k++) {
            if (binary) {
                put_u32(f, (uint32_t)k + 1);
                put_u32(f, 0);
            } else {
                fprintf(f, " %d 0", k + 1);
            }
        }
        if (!binary)
            fprintf(f, "\n");
    }
    fclose(f);
}

/* The files that COLMAP 3.12 and newer write beside the three: a rig of two cameras (those of views
 * 0 and 1) and one for each other camera; a frame with views 0 and 1, and one for each other
 * view. */
static inline void format_colmap_rigs(const char *folder, bool binary, const cln_camera *cameras)
{
    FILE *f = format_open(folder, binary ? "rigs.bin" : "rigs.txt");
    const double beside[7] = {1, 0, 0, 0, -0.1, 0, 0};

    if (binary)
        put_u64(f, FORMAT_VIEWS - 1);
    else
        fprintf(f, "# Rig calib list with one line of data per calib:\n"
                   "#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as "
                   "(SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n");
    for (int v = 0; v < FORMAT_VIEWS; v += v ? 1 : 2) {
        if (!binary) {
            fprintf(f, "%d %d CAMERA %d%s\n", v + 1, v ? 1 : 2, 7 + 3 * v,
                    v ? "" : " CAMERA 10 1 1 0 0 0 -0.1 0 0");
            continue;
        }
        put_u32(f, (uint32_t)v + 1);
        put_u32(f, v ? 1 : 2);
        put_u32(f, 0); /* a camera */
        put_u32(f, (uint32_t)(7 + 3 * v));
        if (v)
            continue;
        put_u32(f, 0);
        put_u32(f, 10);
        fputc(1, f);
        put_reals(f, 7, beside);
    }
    fclose(f);
    f = format_open(folder, binary ? "frames.bin" : "frames.txt");
    if (binary)
        put_u64(f, FORMAT_VIEWS - 1);
    else
        fprintf(f, "# Frame list with one line of data per frame:\n");
    for (int v = 0; v < FORMAT_VIEWS; v += v ? 1 : 2) {
        double rotation[9], pose[7];

        format_w2c(&cameras[v], rotation, pose + 4);
        format_quaternion(rotation, pose);
        if (binary) {
            put_u32(f, (uint32_t)v + 1);
            put_u32(f, (uint32_t)v + 1);
            put_reals(f, 7, pose);
            put_u32(f, v ? 1 : 2);
        } else {
            fprintf(f, "%d %d", v + 1, v + 1);
            for (int i = 0; i < 7; i++)
                fprintf(f, " %.17g", pose[i]);
            fprintf(f, " %d", v ? 1 : 2);
        }
        for (int k = v; k < v + (v ? 1 : 2); k++) {
            if (binary) {
                put_u32(f, 0);
                put_u32(f, (uint32_t)(7 + 3 * k));
                put_u64(f, (uint64_t)k + 1);
            } else {
                fprintf(f, " CAMERA %d %d", 7 + 3 * k, k + 1);
            }
        }
        if (!binary)
            fprintf(f, "\n");
    }
    fclose(f);
}

/* ---- transforms JSON ---- */

/* In Blender's form (one field of view, names without their ending), nerfstudio's (each frame with
 * its own intrinsics) or instant-ngp's (the first camera's intrinsics for all, a box). Camera axes
 * are OpenGL's in all three. */
static inline void format_transforms(const char *folder, const char *dialect,
                                     const cln_camera *cameras)
{
    const bool blender = strcmp(dialect, "blender") == 0, ngp = strcmp(dialect, "instant-ngp") == 0;
    FILE *f = format_open(folder, blender ? "transforms_train.json" : "transforms.json");

    fprintf(f, "{");
    if (blender)
        fprintf(f, "\"camera_angle_x\": %.17g, ", 2 * atan(0.5 * cameras->width / cameras->fx));
    else
        fprintf(f, "\"camera_model\": \"OPENCV\", \"w\": %d, \"h\": %d, ", cameras->width,
                cameras->height);
    if (ngp)
        fprintf(f, "\"aabb_scale\": 16, ");
    for (int v = -1; v < FORMAT_VIEWS; v++) { /* -1: what holds for all */
        const cln_camera *c = &cameras[v < 0 ? 0 : v];

        if (v >= 0)
            fprintf(f, "%s\n{\"file_path\": \"./images/view_%02d%s\", ", v ? "," : "", v,
                    blender ? "" : ".png");
        if ((ngp && v < 0) || (!ngp && !blender && v >= 0)) {
            fprintf(f, "\"fl_x\": %.17g, \"fl_y\": %.17g, ", c->fx, c->fy);
            fprintf(f, "\"cx\": %.17g, \"cy\": %.17g, ", c->cx, c->cy);
            fprintf(f, "\"k1\": %.17g, \"k2\": %.17g, ", c->k1, c->k2);
            fprintf(f, "\"p1\": %.17g, \"p2\": %.17g, ", c->p1, c->p2);
        }
        if (v < 0) {
            fprintf(f, "\"frames\": [");
            continue;
        }
        fprintf(f, "\"transform_matrix\": [");
        for (int row = 0; row < 3; row++)
            fprintf(f, "[%.17g,%.17g,%.17g,%.17g],", c->c2w[4 * row], -c->c2w[4 * row + 1],
                    -c->c2w[4 * row + 2], c->c2w[4 * row + 3]);
        fprintf(f, "[0,0,0,1]]}");
    }
    fprintf(f, "]}\n");
    fclose(f);
}

/* ---- LLFF and NeuS: arrays ---- */

/* The bytes of a .npy file of rows x columns numbers, float64 or float32; `fortran`: stored column
 * by column. The caller frees them. */
static inline char *format_npy(int rows, int columns, const double *values, bool single,
                               bool fortran, size_t *bytes)
{
    char *data = NULL, header[128];
    FILE *f = open_memstream(&data, bytes);
    int length = 0;

    assert_non_null(f);
    length = snprintf(header, sizeof header,
                      "{'descr': '%s', 'fortran_order': %s, 'shape': (%d, %d), }\n",
                      single ? "<f4" : "<f8", fortran ? "True" : "False", rows, columns);
    fwrite("\x93NUMPY\x01\0", 8, 1, f);
    fputc(length, f);
    fputc(0, f);
    fwrite(header, (size_t)length, 1, f);
    for (int i = 0; i < rows * columns; i++) {
        const double value = values[fortran ? i % rows * columns + i / rows : i];
        const float narrow = (float)value;

        fwrite(single ? (const void *)&narrow : &value, single ? 4 : 8, 1, f);
    }
    fclose(f);
    return data;
}

/* poses_bounds.npy; cameras of `size` times the images' sides; depths from 2 to 6 + v. */
static inline void format_llff(const char *folder, const cln_camera *cameras, int size,
                               bool fortran)
{
    double rows[FORMAT_VIEWS * 17];
    size_t bytes = 0;
    char *data = NULL;
    FILE *f = NULL;

    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const cln_camera *c = &cameras[v];
        const double intrinsics[3] = {size * c->height, size * c->width, size * c->fx};

        for (int i = 0; i < 3; i++) { /* down, right, backwards, position */
            rows[17 * v + 5 * i] = c->c2w[4 * i + 1];
            rows[17 * v + 5 * i + 1] = c->c2w[4 * i];
            rows[17 * v + 5 * i + 2] = -c->c2w[4 * i + 2];
            rows[17 * v + 5 * i + 3] = c->c2w[4 * i + 3];
            rows[17 * v + 5 * i + 4] = intrinsics[i];
        }
        rows[17 * v + 15] = 2;
        rows[17 * v + 16] = 6 + v;
    }
    data = format_npy(FORMAT_VIEWS, 17, rows, false, fortran, &bytes);
    f = format_open(folder, "poses_bounds.npy");
    fwrite(data, bytes, 1, f);
    fclose(f);
    free(data);
}

static inline void put_u16(FILE *f, unsigned value)
{
    fputc((int)(value & 255), f);
    fputc((int)(value >> 8), f);
}

/* A zip archive being written: keeps its directory until the end. */
typedef struct format_zip {
    FILE *file, *directory;
    char *entries;
    size_t entry_bytes;
    unsigned count;
    bool deflate;
} format_zip;

static inline void format_zip_add(format_zip *z, const char *name, const char *data, size_t bytes)
{
    const uint32_t place = (uint32_t)ftell(z->file);
    const uint32_t sum = (uint32_t)crc32(0, (const Bytef *)data, (uInt)bytes);
    Bytef packed[4096];
    z_stream s = {.next_in = (Bytef *)(uintptr_t)data, .avail_in = (uInt)bytes};
    size_t packed_bytes = bytes;

    if (z->deflate) {
        s.next_out = packed;
        s.avail_out = sizeof packed;
        assert_int_equal(deflateInit2(&s, 9, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
        assert_int_equal(deflate(&s, Z_FINISH), Z_STREAM_END);
        packed_bytes = s.total_out;
        deflateEnd(&s);
    }
    for (int local = 1; local >= 0; local--) {
        FILE *f = local ? z->file : z->directory;

        fwrite(local ? "PK\3\4" : "PK\1\2", 4, 1, f);
        if (!local)
            put_u16(f, 20);
        put_u16(f, 20);
        put_u16(f, 0);
        put_u16(f, z->deflate ? 8 : 0);
        put_u32(f, 0);
        put_u32(f, sum);
        put_u32(f, (uint32_t)packed_bytes);
        put_u32(f, (uint32_t)bytes);
        put_u16(f, (unsigned)strlen(name));
        put_u16(f, local ? 4 : 0); /* extra field, only in the local header */
        if (!local) {
            put_u16(f, 0);
            put_u32(f, 0);
            put_u32(f, 0);
            put_u32(f, place);
        }
        fwrite(name, strlen(name), 1, f);
        if (local)
            put_u32(f, 0x00001234);
    }
    fwrite(z->deflate ? (const char *)packed : data, packed_bytes, 1, z->file);
    z->count++;
}

static inline void format_zip_end(format_zip *z)
{
    const uint32_t place = (uint32_t)ftell(z->file);

    fclose(z->directory);
    fwrite(z->entries, z->entry_bytes, 1, z->file);
    fwrite("PK\5\6", 4, 1, z->file);
    put_u32(z->file, 0);
    put_u16(z->file, z->count);
    put_u16(z->file, z->count);
    put_u32(z->file, (uint32_t)z->entry_bytes);
    put_u32(z->file, place);
    put_u16(z->file, 0);
    fclose(z->file);
    free(z->entries);
}

/* cameras_sphere.npz: P = s K [R|t] with varying factors s, and a ball of radius 2 around
 * (1, 2, 3). */
static inline void format_neus(const char *folder, const cln_camera *cameras, bool deflate)
{
    static const double scale_mat[16] = {0, 2, 0, 1, 0, 0, 2, 2, 2, 0, 0, 3, 0, 0, 0, 1};
    format_zip z = {.file = format_open(folder, "cameras_sphere.npz"), .deflate = deflate};

    z.directory = open_memstream(&z.entries, &z.entry_bytes);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const cln_camera *c = &cameras[v];
        const double s = v % 2 ? -3.5 : 0.25;
        const double k[9] = {c->fx, 0, c->cx - 0.5, 0, c->fy, c->cy - 0.5, 0, 0, 1};
        double r[9], t[3], p[16] = {[15] = 1};
        char name[32], *data = NULL;
        size_t bytes = 0;

        format_w2c(c, r, t);
        for (int i = 0; i < 3; i++)
            for (int a = 0; a < 3; a++) {
                for (int b = 0; b < 3; b++)
                    p[4 * i + b] += s * k[3 * i + a] * r[3 * a + b];
                p[4 * i + 3] += s * k[3 * i + a] * t[a];
            }
        data = format_npy(4, 4, p, false, v == 1, &bytes);
        snprintf(name, sizeof name, "world_mat_%d.npy", v);
        format_zip_add(&z, name, data, bytes);
        free(data);
        data = format_npy(4, 4, scale_mat, true, false, &bytes);
        snprintf(name, sizeof name, "scale_mat_%d.npy", v);
        format_zip_add(&z, name, data, bytes);
        free(data);
    }
    format_zip_end(&z);
}

/* ---- NSVF, OpenSfM: text ---- */

/* pose/NAME.txt for rgb/NAME.png, NAME with the prefix of its split: "012" gives it view by view,
 * "" means none. Intrinsics in one of four forms. */
static inline void format_nsvf(const char *folder, const cln_camera *cameras, const char *prefixes,
                               int form)
{
    const cln_camera *c = cameras;
    FILE *f = format_open(folder, "intrinsics.txt");

    if (form == 0)
        fprintf(f, "%.17g %.17g %.17g 0.\n0. 0. 0.\n1.\n800 800\n", c->fx, c->cx, c->cy);
    else if (form == 1)
        fprintf(f, "%.17g 0 %.17g 0\n0 %.17g %.17g 0\n0 0 1 0\n0 0 0 1\n", c->fx, c->cx, c->fy,
                c->cy);
    else if (form == 2)
        fprintf(f, "%.17g 0 %.17g\r\n0 %.17g %.17g\r\n0 0 1\r\n", c->fx, c->cx, c->fy, c->cy);
    else
        fprintf(f, "%.17g 0 %.17g 0 0 %.17g %.17g 0 0 0 1 0 0 0 0 1", c->fx, c->cx, c->fy, c->cy);
    fclose(f);
    format_images(scratch_path(folder, "rgb"), 1);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[64], plain_name[64];
        const double *m = cameras[v].c2w;

        snprintf(plain_name, sizeof plain_name, "rgb/view_%02d.png", v);
        snprintf(name, sizeof name, "rgb/%.1s%sview_%02d.png", prefixes + (*prefixes ? v : 0),
                 *prefixes ? "_" : "", v);
        assert_int_equal(rename(scratch_path(folder, plain_name), scratch_path(folder, name)), 0);
        snprintf(name, sizeof name, "%.1s%sview_%02d.txt", prefixes + (*prefixes ? v : 0),
                 *prefixes ? "_" : "", v);
        f = format_open(scratch_path(folder, "pose"), name);
        for (int i = 0; i < 12; i++)
            fprintf(f, "%.17g%c", m[i], i % 4 < 3 ? ' ' : '\n');
        fprintf(f, "0 0 0 1\n");
        fclose(f);
    }
    f = format_open(folder, "bbox.txt");
    fprintf(f, "-1 0 1 3 4.5 5 0.4\n");
    fclose(f);
}

/* A PLY file of points as nerfstudio writes it (text), or with doubles, a normal and a face behind
 * it (binary). */
static inline void format_ply(const char *folder, const char *name, bool binary,
                              const cln_point *points, int count)
{
    FILE *f = format_open(folder, name);
    const char *real = binary ? "double" : "float";

    fprintf(f, "ply\nformat %s 1.0\ncomment of a test\nelement vertex %d\n",
            binary ? "binary_little_endian" : "ascii", count);
    fprintf(f, "property %s x\nproperty %s y\nproperty %s z\n", real, real, real);
    fprintf(f, binary ? "property float nx\n" : "");
    fprintf(f, "property uint8 red\nproperty uint8 green\nproperty uint8 blue\n");
    fprintf(f, binary ? "element face 1\nproperty list uchar int vertex_indices\n" : "");
    fprintf(f, "end_header\n");
    for (int i = 0; i < count; i++) {
        const cln_point *p = &points[i];
        const float normal = 1;

        if (!binary) {
            fprintf(f, "%.9g %.9g %.9g %d %d %d\n", p->xyz[0], p->xyz[1], p->xyz[2], p->rgb[0],
                    p->rgb[1], p->rgb[2]);
            continue;
        }
        fwrite(p->xyz, sizeof *p->xyz, 3, f);
        fwrite(&normal, sizeof normal, 1, f);
        fwrite(p->rgb, 1, 3, f);
    }
    fwrite(binary ? "\3\0\0\0\0\0\0\0\0\0\0\0" : "", 1, binary ? 13 : 0, f);
    fclose(f);
}

/* cameras.xml of a chunk with a local coordinate system, scaled by 2, with a sensor for all. */
static inline void format_metashape(const char *folder, const cln_camera *cameras)
{
    FILE *f = format_open(folder, "cameras.xml");

    fprintf(f,
            "<document><chunk><sensors><sensor id=\"0\" type=\"frame\"><resolution width=\"%d\" "
            "height=\"%d\"/><calibration class=\"adjusted\"><f>20</f><cx>1</cx><k1>0.01</k1>"
            "</calibration></sensor></sensors><components><component id=\"0\"><transform>"
            "<scale>2</scale></transform></component></components><cameras>",
            FORMAT_WIDTH, FORMAT_HEIGHT);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        fprintf(f,
                "<camera id=\"%d\" sensor_id=\"0\" component_id=\"0\" label=\"view_%02d\">"
                "<transform>",
                v, v);
        for (int i = 0; i < 12; i++)
            fprintf(f, "%.17g ", cameras[v].c2w[i]);
        fprintf(f, "0 0 0 1</transform></camera>");
    }
    fprintf(f, "</cameras><reference>LOCAL_CS</reference><region><center>0 0 0</center>"
               "<size>2 2 2</size><R>1 0 0 0 1 0 0 0 1</R></region></chunk></document>");
    fclose(f);
}

/* reconstruction.json: an empty reconstruction, then that of the cameras, one camera per view;
 * `type`: brown or perspective. */
static inline void format_opensfm(const char *folder, const cln_camera *cameras, const char *type,
                                  const cln_point *points, int count)
{
    FILE *f = format_open(folder, "reconstruction.json");

    fprintf(f, "[{\"cameras\": {}, \"shots\": {}, \"points\": {}},\n{\"cameras\": {");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const cln_camera *c = &cameras[v];
        const double longest = c->width > c->height ? c->width : c->height;

        fprintf(f, "%s\n\"v2 cam %d\": {\"projection_type\": \"%s\", \"width\": %d, ", v ? "," : "",
                v, type, c->width);
        fprintf(f, "\"height\": %d, ", c->height);
        if (strcmp(type, "brown") != 0) {
            fprintf(f, "\"focal\": %.17g, \"k1\": %.17g, \"k2\": %.17g}", c->fx / longest, c->k1,
                    c->k2);
            continue;
        }
        fprintf(f, "\"focal_x\": %.17g, ", c->fx / longest);
        if (c->fy != c->fx)
            fprintf(f, "\"focal_y\": %.17g, ", c->fy / longest);
        fprintf(f, "\"c_x\": %.17g, \"c_y\": %.17g, ", (c->cx - 0.5 * c->width) / longest,
                (c->cy - 0.5 * c->height) / longest);
        fprintf(f, "\"k1\": %.17g, \"k2\": %.17g, \"p1\": %.17g, \"p2\": %.17g, \"k3\": 0.0}",
                c->k1, c->k2, c->p1, c->p2);
    }
    fprintf(f, "},\n\"shots\": {");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        double r[9], q[4], t[3], axis[3], half = 0;

        format_w2c(&cameras[v], r, t);
        format_quaternion(r, q);
        half = acos(q[0] > 1 ? 1 : q[0] < -1 ? -1 : q[0]);
        for (int i = 0; i < 3; i++)
            axis[i] = half > 0 ? q[i + 1] / sin(half) * 2 * half : 0;
        fprintf(f, "%s\n\"view_%02d.png\": {\"camera\": \"v2 cam %d\", ", v ? "," : "", v, v);
        fprintf(f, "\"rotation\": [%.17g, %.17g, %.17g], ", axis[0], axis[1], axis[2]);
        fprintf(f, "\"translation\": [%.17g, %.17g, %.17g]}", t[0], t[1], t[2]);
    }
    fprintf(f, "},\n\"points\": {");
    for (int i = 0; i < count; i++)
        fprintf(f, "%s\"%d\": {\"coordinates\": [%.17g, %.17g, %.17g], \"color\": [1.0, 2, 3]}",
                i ? ",\n" : "", i, points[i].xyz[0], points[i].xyz[1], points[i].xyz[2]);
    fprintf(f, "}}]\n");
    fclose(f);
}

/* tracks.csv beside it: point i is in the first points[i].views views. Also rows of unknown points
 * or views, and one that is cut off. */
static inline void format_opensfm_tracks(const char *folder, bool version, const cln_point *points,
                                         int count)
{
    FILE *f = format_open(folder, "tracks.csv");

    fprintf(f, version ? "OPENSFM_TRACKS_VERSION_v2\n" : "");
    fprintf(f, "other.png\t0\t7\t0.1\t0.2\t0.004\t9\t9\t9\t-1\t-1\n");
    for (int i = 0; i < count; i++)
        for (int v = 0; v < points[i].views; v++)
            fprintf(f, "view_%02d.png\t%d\t%d\t0.1\t-0.2\t0.004\t9\t9\t9\t-1\t-1\n", v, i, i + 3);
    fprintf(f, "view_00.png\t%d\t3\t0\t0\t1\t9\t9\t9\nview_01.png", count);
    fclose(f);
}

#endif
