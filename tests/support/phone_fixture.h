/* The scene of format_fixture.h as apps of phones export it, by their specifications, independent
 * of the readers' code. Axes of cameras are OpenGL's there: y up, z backwards. */
#ifndef CLN_TESTS_PHONE_FIXTURE_H
#define CLN_TESTS_PHONE_FIXTURE_H

#include "format_fixture.h"

/* ---- grey PNG of 8 or 16 bits ---- */

static inline void phone_chunk(FILE *f, const char *type, const uint8_t *data, size_t bytes)
{
    uint8_t whole[1 << 16];
    uLong sum = 0;
    const uint8_t size[4] = {0, 0, (uint8_t)(bytes >> 8), (uint8_t)bytes};

    assert_in_range(bytes, 0, sizeof whole - 4);
    memcpy(whole, type, 4);
    if (bytes)
        memcpy(whole + 4, data, bytes);
    sum = crc32(0, whole, (uInt)bytes + 4);
    fwrite(size, 1, 4, f);
    fwrite(whole, 1, bytes + 4, f);
    for (int i = 3; i >= 0; i--)
        fputc((int)(sum >> 8 * i & 255), f);
}

static inline void phone_grey(const char *folder, const char *name, bool deep, int width,
                              int height, const uint16_t *values)
{
    static const char mark[8] = "\x89PNG\r\n\x1a\n";
    const uint8_t head[13] = {0, 0, 0, (uint8_t)width, 0, 0, 0, (uint8_t)height, deep ? 16 : 8};
    uint8_t rows[1 << 14], packed[1 << 15];
    uLongf bytes = sizeof packed;
    size_t used = 0;
    FILE *f = format_open(folder, name);

    assert_in_range((size_t)height * (1 + 2 * (size_t)width), 1, sizeof rows);
    for (int y = 0; y < height; y++) {
        rows[used++] = 0; /* no filter */
        for (int x = 0; x < width; x++) {
            const uint16_t value = values[y * width + x];

            if (deep)
                rows[used++] = (uint8_t)(value >> 8);
            rows[used++] = (uint8_t)value;
        }
    }
    assert_int_equal(compress(packed, &bytes, rows, (uLong)used), Z_OK);
    fwrite(mark, 1, sizeof mark, f);
    phone_chunk(f, "IHDR", head, sizeof head);
    phone_chunk(f, "IDAT", packed, bytes);
    phone_chunk(f, "IEND", NULL, 0);
    fclose(f);
}

/* ---- Polycam ---- */

enum { PHONE_DEPTH_WIDTH = 24, PHONE_DEPTH_HEIGHT = 18 };

/* keyframes with cameras and images, or with corrected ones; size: of the images. */
static inline void phone_polycam(const char *folder, const cln_camera *cameras, bool corrected,
                                 int size)
{
    const char *frames = corrected ? "keyframes/corrected_cameras" : "keyframes/cameras";
    const char *images = corrected ? "keyframes/corrected_images" : "keyframes/images";

    format_images(scratch_path(folder, images), size);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const cln_camera *c = &cameras[v];
        char name[32];
        FILE *f = NULL;

        snprintf(name, sizeof name, "view_%02d.json", v);
        f = format_open(scratch_path(folder, frames), name);
        fprintf(f,
                "{\"blur_score\": %d, \"cx\": %.17g, \"cy\": %.17g, \"fx\": %.17g, \"fy\": %.17g, "
                "\"height\": %d, \"manual_keyframe\": false, \"neighbors\": [1], \"width\": %d",
                40 + v, size * c->cx, size * c->cy, size * c->fx, size * c->fy, size * c->height,
                size * c->width);
        for (int i = 0; i < 12; i++)
            fprintf(f, ", \"t_%d%d\": %.17g", i / 4, i % 4,
                    i % 4 == 1 || i % 4 == 2 ? -c->c2w[i] : c->c2w[i]);
        fprintf(f, ", \"timestamp\": %d}\n", 1000 + v);
        fclose(f);
    }
}

/* depth and confidence of each: a ball of this radius about `centre`, in millimetres; what misses
 * it is `beside`, of low confidence. */
static inline void phone_depths(const char *folder, const cln_camera *cameras,
                                const double centre[3], double radius, bool rated, uint16_t beside)
{
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const cln_camera *c = &cameras[v];
        uint16_t depth[PHONE_DEPTH_WIDTH * PHONE_DEPTH_HEIGHT];
        uint16_t sure[PHONE_DEPTH_WIDTH * PHONE_DEPTH_HEIGHT];
        char name[32];

        snprintf(name, sizeof name, "view_%02d.png", v);
        for (int i = 0; i < PHONE_DEPTH_WIDTH * PHONE_DEPTH_HEIGHT; i++) {
            const double u = (i % PHONE_DEPTH_WIDTH + 0.5) * c->width / PHONE_DEPTH_WIDTH;
            const double w = (i / PHONE_DEPTH_WIDTH + 0.5) * c->height / PHONE_DEPTH_HEIGHT;
            double o[3], d[3], along = 0, square = -radius * radius, cosine = 0, root = 0;

            assert_true(cln_camera_ray(c, u, w, o, d));
            for (int a = 0; a < 3; a++) {
                along += d[a] * (centre[a] - o[a]);
                square += (centre[a] - o[a]) * (centre[a] - o[a]);
                cosine += d[a] * c->c2w[4 * a + 2];
            }
            root = along * along - square;
            depth[i] = (uint16_t)(root > 0 ? 1000 * cosine * (along - sqrt(root)) + 0.5 : beside);
            sure[i] = root > 0 ? 255 : 127;
        }
        phone_grey(scratch_path(folder, "keyframes/depth"), name, true, PHONE_DEPTH_WIDTH,
                   PHONE_DEPTH_HEIGHT, depth);
        if (rated)
            phone_grey(scratch_path(folder, "keyframes/confidence"), name, false, PHONE_DEPTH_WIDTH,
                       PHONE_DEPTH_HEIGHT, sure);
    }
}

/* ---- Record3D ---- */

/* metadata of the photos 0.png, 1.png, ... in `images`; each: every photo has its intrinsics. */
static inline void phone_record3d(const char *folder, const char *metadata, const char *images,
                                  const cln_camera *cameras, bool each)
{
    const cln_camera *c = cameras;
    FILE *f = format_open(folder, metadata);

    fprintf(f, "{\"w\": %d, \"h\": %d, \"dw\": 192, \"dh\": 256, \"fps\": 60, ", FORMAT_WIDTH,
            FORMAT_HEIGHT);
    fprintf(f, "\"K\": [%.17g, 0, 0, 0, %.17g, 0, %.17g, %.17g, 1], \"poses\": [", c->fx, c->fy,
            c->cx, c->cy);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        double q[4], pose[12];

        for (int i = 0; i < 12; i++)
            pose[i] = i % 4 == 1 || i % 4 == 2 ? -cameras[v].c2w[i] : cameras[v].c2w[i];
        cln_pose_quaternion(pose, q);
        fprintf(f, "%s\n[%.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g]", v ? "," : "", q[1],
                q[2], q[3], q[0], pose[3], pose[7], pose[11]);
    }
    fprintf(f, "]");
    for (int v = 0; v < FORMAT_VIEWS && each; v++)
        fprintf(f, "%s[%.17g, %.17g, %.17g, %.17g]%s",
                v ? ", " : ", \"perFrameIntrinsicCoeffs\": [", cameras[v].fx, cameras[v].fy,
                cameras[v].cx, cameras[v].cy, v == FORMAT_VIEWS - 1 ? "]" : "");
    fprintf(f, "}\n");
    fclose(f);
    format_images(scratch_path(folder, images), 1);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char from[64], to[64];

        snprintf(from, sizeof from, "%s/view_%02d.png", images, v);
        snprintf(to, sizeof to, "%s/%d.png", images, v);
        assert_int_equal(rename(scratch_path(folder, from), scratch_path(folder, to)), 0);
    }
}

#endif
