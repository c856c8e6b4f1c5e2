/* Support of tests of brightness: photos of a painted wall that is nearer to the left, from cameras
 * that move towards it, under light of known strength. */
#ifndef CLN_TESTS_LIT_FIXTURE_H
#define CLN_TESTS_LIT_FIXTURE_H

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/rng.h"
#include "scene_fixture.h"

enum { LIT_MOST = 64, LIT_TURNS = 15, LIT_WIDE = 64, LIT_HIGH = 48 };

/* Where the camera of a photo is: each goes on a step, and so many of them there and back again. */
static inline void lit_place(int photo, double from[3])
{
    const int way = photo % (2 * LIT_TURNS), step = way <= LIT_TURNS ? way : 2 * LIT_TURNS - way;

    from[0] = .05 * step;
    from[1] = .05 * (step % 3);
    from[2] = .12 * step;
}

/* The wall is where z = 1.5 + 0.8 x, y down. */
static inline void paint_lit(int photo, double falloff, double stops, uint8_t *pixels)
{
    double from[3];

    lit_place(photo, from);

    for (int p = 0; p < LIT_WIDE * LIT_HIGH; p++) {
        const double u = (p % LIT_WIDE + .5) / LIT_WIDE - .5;
        const double v = (p / LIT_WIDE + .5 - LIT_HIGH / 2.0) / LIT_WIDE;
        const double z = (1.5 + .8 * from[0] - from[2]) / (1 - .8 * u);
        const double paint = cln_uniform_hash(3, 1, 0, (uint32_t)(1000 + 20 * (from[1] + z * v)), 0,
                                              (uint32_t)(1000 + 20 * (from[0] + z * u)));
        const double light = pow(z * sqrt(1 + u * u + v * v), -falloff) * pow(2, stops);

        memset(pixels + 3 * p, (int)fmin(255, (40 + 110 * paint) * pow(light, 1 / 2.2)), 3);
    }
}

/* 0.png and so on, in natural order; light of `stops` factors of 2, which falls with this power of
 * the distance from the camera. */
static inline cln_scene *lit_photos(const char *folder, int count, double falloff,
                                    const double *stops)
{
    static uint8_t pixels[LIT_WIDE * LIT_HIGH * 3];
    char json[LIT_MOST * 160] = "{\"camera_angle_x\":0.9272952180016122,\"frames\":[";

    for (int i = 0; i < count; i++) {
        char name[32], frame[160];
        double from[3];

        lit_place(i, from);
        paint_lit(i, falloff, stops[i], pixels);
        snprintf(name, sizeof name, "%d.png", i);
        assert_int_equal(
            cln_image_write_png(scratch_path(folder, name), LIT_WIDE, LIT_HIGH, 3, pixels), CLN_OK);
        snprintf(frame, sizeof frame,
                 "%s{\"file_path\":\"%d\",\"transform_matrix\":[[1,0,0,%g],[0,-1,0,%g],"
                 "[0,0,-1,%g],[0,0,0,1]]}",
                 i ? "," : "", i, from[0], from[1], from[2]);
        strcat(json, frame);
    }
    strcat(json, "]}");
    put_text(folder, "transforms_train.json", json);
    put_text(folder, "transforms_test.json", "{\"camera_angle_x\":0.9,\"frames\":[]}");
    return load(folder, NULL);
}

#endif
