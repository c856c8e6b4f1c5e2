/* See origin.h. The file is one line of words and one of three numbers, and two of one number. */
#include "scene/origin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/json.h"
#include "scene/vectors.h"

static const char NAME[] = "origin.txt", FIRST[] = "# cl-nascent: ";
enum { MOST = 4096 };
/* The ellipsoid: half axis in metres, flattening. */
static const double EQUATOR = 6378137, FLATTENING = 1 / 298.257223563;

/* Earth-centred coordinates. */
static void centred(const double place[3], double out[3])
{
    const double e2 = FLATTENING * (2 - FLATTENING);
    const double latitude = place[0] * M_PI / 180, longitude = place[1] * M_PI / 180;
    const double normal = EQUATOR / sqrt(1 - e2 * sin(latitude) * sin(latitude));

    out[0] = (normal + place[2]) * cos(latitude) * cos(longitude);
    out[1] = (normal + place[2]) * cos(latitude) * sin(longitude);
    out[2] = (normal * (1 - e2) + place[2]) * sin(latitude);
}

void cln_origin_of_centred(const double at[3], double place[3])
{
    const double e2 = FLATTENING * (2 - FLATTENING), pole = EQUATOR * (1 - FLATTENING);
    const double axis = hypot(at[0], at[1]);
    const double reduced = atan2(at[2] * EQUATOR, axis * pole);
    const double s = sin(reduced), c = cos(reduced);
    const double latitude =
        atan2(at[2] + e2 / (1 - e2) * pole * s * s * s, axis - e2 * EQUATOR * c * c * c);
    const double normal = EQUATOR / sqrt(1 - e2 * sin(latitude) * sin(latitude));

    place[0] = latitude * 180 / M_PI;
    place[1] = atan2(at[1], at[0]) * 180 / M_PI;
    place[2] = fabs(latitude) < 0.8 ? axis / cos(latitude) - normal
                                    : at[2] / sin(latitude) - (1 - e2) * normal;
}

void cln_origin_axes(const double origin[3], double axes[3][3])
{
    const double latitude = origin[0] * M_PI / 180, longitude = origin[1] * M_PI / 180;

    memcpy(axes,
           (const double[3][3]){
               {-sin(longitude), cos(longitude), 0},
               {-sin(latitude) * cos(longitude), -sin(latitude) * sin(longitude), cos(latitude)},
               {cos(latitude) * cos(longitude), cos(latitude) * sin(longitude), sin(latitude)}},
           9 * sizeof **axes);
}

void cln_origin_local(const double origin[3], const double place[3], double out[3])
{
    double from[3], to[3], axes[3][3];

    cln_origin_axes(origin, axes);
    centred(origin, from);
    centred(place, to);
    for (int a = 0; a < 3; a++)
        to[a] -= from[a];
    for (int a = 0; a < 3; a++)
        out[a] = cln_dot(axes[a], to);
}

void cln_origin_round(double origin[3])
{
    for (int a = 0; a < 3; a++)
        origin[a] = a < 2 ? round(origin[a] * 1e8) / 1e8 : round(origin[a] * 1e3) / 1e3;
}

cln_status cln_origin_write(const char *folder, const double origin[3], cln_origin_doubt doubt)
{
    cln_status st = CLN_OK;
    char *path = NULL, text[512];

    CLN_TRY(cln_path_join(&path, folder, NAME));
    cln_format(
        text, sizeof text,
        "%scoordinates of this model are metres east, north and up from this latitude and "
        "longitude (degrees, WGS 84) and height (metres); half of the cameras are within as many "
        "metres of their GPS positions as the third line says, and up is known to as many degrees "
        "as "
        "the last says\n%.8f %.8f %.3f\n%.3f\n%.2f\n",
        FIRST, origin[0], origin[1], origin[2], doubt.distance, doubt.up);
    CLN_TRY(cln_write_file(path, text, strlen(text)));
done:
    free(path);
    return st;
}

cln_status cln_origin_hide(json_t *dataset)
{
    cln_status st = CLN_OK;
    const char *because = cln_json_text(dataset, "because"), *at = strstr(because, ", latitude ");
    const char *height = at ? strstr(at, "height ") : NULL;
    char *left = NULL;

    json_object_del(dataset, "origin");
    if (!height)
        return CLN_OK;
    height += strlen("height ");
    height += strspn(height, "0123456789.-");
    CLN_TRY(cln_asprintf(&left, "%.*s%s", (int)(at - because), because, height));
    json_object_set_new(dataset, "because", json_string(left));
done:
    free(left);
    return st;
}

bool cln_origin_is_there(const char *folder)
{
    return cln_has_file(folder, NAME);
}

bool cln_origin_is_named(const char *name)
{
    return strcmp(name, NAME) == 0;
}

bool cln_origin_read(const char *folder, double origin[3], cln_origin_doubt *doubt)
{
    const double most[3] = {90, 180, 100e3};
    char *path = NULL, *text = NULL;
    const char *at = NULL;
    size_t bytes = 0;
    int read = 0;

    if (cln_origin_is_there(folder) && cln_path_join(&path, folder, NAME) == CLN_OK &&
        cln_read_file(path, MOST, &text, &bytes) == CLN_OK &&
        strncmp(text, FIRST, sizeof FIRST - 1) == 0)
        at = strchr(text, '\n');
    while (at && read < 3 && cln_number_read(at + 1, &origin[read], &at) &&
           fabs(origin[read]) <= most[read] &&
           (*at == ' ' || (read == 2 && (*at == 0 || *at == '\n' || *at == '\r'))))
        read++;
    at = read == 3 ? strchr(at, '\n') : NULL;
    for (int i = 0; i < 2; i++) {
        double *to = i ? &doubt->up : &doubt->distance;
        const bool is = at && cln_number_read(at + 1, to, &at) && *to >= 0;

        if (!is)
            *to = NAN;
        at = is ? strchr(at, '\n') : NULL;
    }
    cln_clear_error();
    free(path);
    free(text);
    return read == 3;
}
