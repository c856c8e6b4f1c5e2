/* See found_anew.h. Moments of one rig, say, are trained one by one with the settings of the first:
 * a cube or a background of their own would be seen as flicker. */
#include "train/found_anew.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/number.h"
#include "io/json.h"
#include "io/run_folder.h"

enum { LIST_BYTES = 512 };
static const double SAME_CUBE = 1e-9;        /* half sides: digits of an option */
static const double SAME_COLOUR = 1.0 / 255; /* of 1 */

/* What differs, as words, and as options. */
typedef struct differences {
    char words[LIST_BYTES], options[LIST_BYTES];
} differences;

static void add(differences *to, const char *what, const char *here, const char *there)
{
    const size_t used = strlen(to->words);

    cln_format(to->words + used, LIST_BYTES - used, "%s%s %s (there %s)", used ? ", " : "", what,
               here, there);
}

static void add_option(differences *to, const char *name, const char *value)
{
    const size_t used = strlen(to->options);

    cln_format(to->options + used, LIST_BYTES - used, " --%s=%s", name, value);
}

static void write_numbers(const double *values, int count, char out[CLN_SETTING_BYTES])
{
    char number[CLN_NUMBER_BYTES];

    out[0] = 0;
    for (int i = 0; i < count; i++) {
        const size_t used = strlen(out);

        cln_number_write(values[i], number);
        cln_format(out + used, CLN_SETTING_BYTES - used, "%s%s", i ? "," : "", number);
    }
}

static bool read_numbers(const json_t *list, double out[3])
{
    for (size_t i = 0; i < 3; i++)
        out[i] = json_number_value(json_array_get(list, i));
    return json_array_size(list) == 3;
}

static void compare_masks(const cln_scene *scene, const json_t *its, differences *to)
{
    const char *there = cln_json_text(json_object_get(its, "masks"), "as");
    const char *here = scene->masks_alpha ? "alpha" : "ignore";

    if (!scene->mask_count || !*there || strcmp(here, there) == 0)
        return;
    add(to, "masks", here, there);
    add_option(to, "masks", there);
}

static void compare_space(const cln_scene *scene, const json_t *its, differences *to)
{
    const char *there = cln_json_text(its, "space"), *here = cln_space_name(&scene->space);

    if (!*there || strcmp(here, there) == 0)
        return;
    add(to, "space", here, there);
    add_option(to, "space", there);
}

static void compare_background(const cln_scene *scene, const json_t *its, differences *to)
{
    char here[CLN_SETTING_BYTES], there[CLN_SETTING_BYTES];
    double ours[3], theirs[3], off = 0;

    if (!read_numbers(json_object_get(its, "background"), theirs))
        return;
    for (int c = 0; c < 3; c++) {
        ours[c] = cln_json_digits(scene->background[c]);
        off = fmax(off, fabs(ours[c] - theirs[c]));
    }
    if (off <= SAME_COLOUR)
        return;
    write_numbers(ours, 3, here);
    write_numbers(theirs, 3, there);
    add(to, "background", here, there);
    add_option(to, "background", there);
}

/* found: the box that alpha told the run, or "". */
static void compare_cube(const cln_scene *scene, const json_t *its, const char *found,
                         differences *to)
{
    const cln_space *ours = &scene->space;
    const double half = json_number_value(json_object_get(its, "half"));
    char here[CLN_NUMBER_BYTES + 32], there[CLN_NUMBER_BYTES + 32], box[CLN_SETTING_BYTES];
    double centre[3], corners[6], off = fabs(half - ours->half);

    if (ours->forward || strcmp(cln_json_text(its, "space"), "ndc") == 0 || !(half > 0) ||
        !read_numbers(json_object_get(its, "centre"), centre))
        return;
    for (int a = 0; a < 3; a++) {
        off = fmax(off, fabs(centre[a] - ours->centre[a]));
        corners[a] = centre[a] - half;
        corners[3 + a] = centre[a] + half;
    }
    if (off <= SAME_CUBE * half)
        return;
    write_numbers(corners, 6, box);
    cln_format(here, sizeof here, "%.4g", ours->half);
    cln_format(there, sizeof there, "%.4g", half);
    if (strcmp(here, there) == 0)
        cln_format(there, sizeof there, "%.4g, elsewhere", half);
    add(to, "cube of half side", here, there);
    add_option(to, "bbox", *found ? found : box);
}

cln_status cln_found_anew_tell(const cln_scene *scene, const cln_settings *settings)
{
    cln_status st = CLN_OK;
    const cln_config *config = &settings->config;
    cln_background_kind kind = CLN_BACKGROUND_GIVEN;
    differences all = {{0}, {0}};
    const char *found = "";
    json_t *document = NULL;
    const json_t *its = NULL;
    float rgb[3];

    if (!settings->run)
        return CLN_OK;
    CLN_TRY(cln_run_read(settings->run, &document));
    its = json_object_get(document, "dataset");
    if (json_is_true(json_object_get(document, "bbox_found")))
        found = cln_json_text(json_object_get(document, "config"), "bbox");
    CLN_TRY(cln_config_background(config, &kind, rgb));
    if (config->masks == CLN_MASKS_AUTO)
        compare_masks(scene, its, &all);
    if (config->space == CLN_SPACE_AUTO)
        compare_space(scene, its, &all);
    if (kind == CLN_BACKGROUND_AUTO)
        compare_background(scene, its, &all);
    if (!config->bbox[0] && !config->tree_from[0]) /* a tree brings its cube */
        compare_cube(scene, its, found, &all);
    if (all.words[0])
        cln_info(
            "settings of %s: what it found by itself is found anew for this scene, and differs: "
            "%s; to keep the run's:%s",
            settings->run, all.words, all.options);
done:
    json_decref(document);
    return st;
}
