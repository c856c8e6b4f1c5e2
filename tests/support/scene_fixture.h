/* Support of tests of scenes: small images and JSON documents in a scratch folder, and loading with
 * the default settings. */
#ifndef CLN_TESTS_SCENE_FIXTURE_H
#define CLN_TESTS_SCENE_FIXTURE_H

#include "base/config.h"
#include "base/memory.h"
#include "io/image.h"
#include "scene/scene.h"
#include "scratch.h"

/* A camera at distance 4 that looks at the origin; OpenGL's axes, as in the files. */
#define POSE_FRONT "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"

#define FRAME(file, pose) "{\"file_path\":\"" file "\",\"transform_matrix\":" pose "}"

static inline void put_text(const char *folder, const char *name, const char *text)
{
    char *path =
        NULL; /* not scratch_path, which keeps a limited number: tests call this in loops */

    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    scratch_put(path, text, strlen(text));
    free(path);
}

/* A PNG whose colours depend on `seed`; with 4 channels the left half is half transparent. */
static inline void put_image(const char *folder, const char *name, int width, int height,
                             int channels, int seed)
{
    uint8_t *pixels = malloc((size_t)(width * height * channels));

    assert_non_null(pixels);
    for (int i = 0; i < width * height; i++)
        for (int c = 0; c < channels; c++)
            pixels[i * channels + c] = c == 3 ? (i % width < width / 2 ? 128 : 255)
                                              : (uint8_t)(i * 5 + c * 60 + seed * 17);
    assert_int_equal(
        cln_image_write_png(scratch_path(folder, name), width, height, channels, pixels), CLN_OK);
    free(pixels);
}

static inline void put_folder(const char *folder, const char *name)
{
    assert_int_equal(cln_make_dirs(scratch_path(folder, name)), CLN_OK);
}

static inline cln_config default_config(void)
{
    cln_config config;

    assert_int_equal(cln_config_preset("fast", &config), CLN_OK);
    return config;
}

/* Loads with all pixels; NULL config: the defaults. */
static inline cln_status try_load(const char *path, const cln_config *config, cln_scene **scene)
{
    const cln_config defaults = default_config();
    const cln_scene_desc desc = {
        .path = path, .config = config ? config : &defaults, .pixels = {true, true, true}};

    *scene = (cln_scene *)1;
    return cln_scene_load(&desc, scene);
}

static inline cln_scene *load(const char *path, const cln_config *config)
{
    cln_scene *scene = NULL;

    if (try_load(path, config, &scene) != CLN_OK)
        fail_msg("%s: %s", path, cln_error_text());
    return scene;
}

/* Refused with CLN_INPUT, no scene and a sentence that has these words and a way out, behind a
 * semicolon or as what must be; what: names the case. */
static inline void assert_refused(const char *path, const cln_config *config,
                                  const char *const words[3], const char *what)
{
    cln_scene *scene = NULL;
    const cln_status st = try_load(path, config, &scene);

    if (st != CLN_INPUT)
        fail_msg("%s: status %d instead of CLN_INPUT (%s)", what, (int)st, cln_error_text());
    assert_null(scene);
    for (int i = 0; i < 3 && words[i]; i++)
        if (!strstr(cln_error_text(), words[i]))
            fail_msg("%s: '%s' lacks '%s'", what, cln_error_text(), words[i]);
    if (!strstr(cln_error_text(), "; ") && !strstr(cln_error_text(), " must "))
        fail_msg("%s: '%s' has no way out", what, cln_error_text());
    cln_clear_error();
}

#endif
