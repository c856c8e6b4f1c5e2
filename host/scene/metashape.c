/* See metashape.h. Elements that are read, with the ones they stand in:
 *   chunk > sensors > sensor (id, type) > resolution, calibration (type, class) > f cx cy ...
 *   chunk > cameras > [group >] camera (label, sensor_id, component_id, enabled) > transform
 *   chunk > components > component (id) > transform > rotation translation scale
 *   chunk > transform > ..., chunk > [components > component >] region > center size R
 *   chunk > reference
 * Text is read at the end of its element; what stands elsewhere is passed. */
#include "scene/metashape.h"

#ifdef CLN_WITH_EXPAT

#include <expat.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "scene/dataset.h"

enum { MOST_BYTES = 1 << 28, DEPTH = 12, NAME = 32, TEXT = 1024 };

typedef struct reader {
    XML_Parser parser;
    cln_metashape *out;
    cln_status status;
    char reason[128];
    char stack[DEPTH][NAME]; /* names of the open elements */
    int depth;               /* of them, also beyond DEPTH */
    char text[TEXT];
    size_t used;
    bool full; /* the text is longer than any that is read */
    bool done; /* a chunk with aligned cameras has been read: others are counted alone */
    bool adjusted;
    bool any; /* this chunk has an aligned camera */
} reader;

static void refuse(reader *r, cln_status st, const char *reason)
{
    if (r->status != CLN_OK)
        return;
    r->status = st;
    snprintf(r->reason, sizeof r->reason, "%s", reason);
    XML_StopParser(r->parser, XML_FALSE);
}

/* The element that is `up` levels above the innermost one; "" if there is none. */
static const char *above(const reader *r, int up)
{
    const int i = r->depth - 1 - up;

    return i >= 0 && i < DEPTH ? r->stack[i] : "";
}

static bool is_within(const reader *r, const char *parent, const char *grandparent)
{
    return strcmp(above(r, 1), parent) == 0 && strcmp(above(r, 2), grandparent) == 0;
}

static const char *value_of(const XML_Char **attributes, const char *name)
{
    for (int i = 0; attributes[i]; i += 2)
        if (strcmp(attributes[i], name) == 0)
            return attributes[i + 1];
    return NULL;
}

static int whole_of(reader *r, const XML_Char **attributes, const char *name, int otherwise)
{
    const char *text = value_of(attributes, name);
    long long value = 0;

    if (!text)
        return otherwise;
    if (!cln_integer_read(text, &value) || value < 0 || value > 1 << 30)
        refuse(r, CLN_INPUT, "an id or a size is no whole number");
    return (int)value;
}

/* ---- elements begin ---- */

static void begin_sensor(reader *r, const XML_Char **attributes)
{
    cln_metashape *m = r->out;
    const char *type = value_of(attributes, "type");

    if (cln_grow(&m->sensors, m->sensor_count, sizeof *m->sensors, "sensors") != CLN_OK) {
        refuse(r, CLN_MEMORY, "no memory");
        return;
    }
    m->sensors[m->sensor_count++] = (cln_metashape_sensor){
        .id = whole_of(r, attributes, "id", 0),
        .kind = !type || strcmp(type, "frame") == 0        ? CLN_METASHAPE_FRAME
                : strcmp(type, "fisheye") == 0             ? CLN_METASHAPE_FISHEYE
                : strcmp(type, "equidistant_fisheye") == 0 ? CLN_METASHAPE_FISHEYE
                : strcmp(type, "spherical") == 0           ? CLN_METASHAPE_SPHERICAL
                                                           : CLN_METASHAPE_OTHER};
}

static void begin_calibration(reader *r, const XML_Char **attributes)
{
    const char *class = value_of(attributes, "class");
    cln_metashape_sensor *s = &r->out->sensors[r->out->sensor_count - 1];

    r->adjusted = class && strcmp(class, "adjusted") == 0;
    if (s->calibrated && !r->adjusted) /* the initial one stands first, or is not wanted */
        return;
    s->calibrated = true;
    s->adjusted = r->adjusted;
    s->f = s->cx = s->cy = s->b1 = s->b2 = 0;
    memset(s->k, 0, sizeof s->k);
    memset(s->p, 0, sizeof s->p);
}

static void begin_camera(reader *r, const XML_Char **attributes)
{
    cln_metashape *m = r->out;
    const char *label = value_of(attributes, "label"), *on = value_of(attributes, "enabled");
    cln_metashape_camera camera = {.sensor = whole_of(r, attributes, "sensor_id", -1),
                                   .component = whole_of(r, attributes, "component_id", -1),
                                   .enabled = !on || (strcmp(on, "false") && strcmp(on, "0"))};

    if (m->camera_count >= CLN_MAX_VIEWS) {
        refuse(r, CLN_INPUT, "more cameras than are read");
        return;
    }
    if (!label || !*label || strlen(label) >= sizeof camera.label) {
        refuse(r, CLN_INPUT, "a camera has no label, or too long a one");
        return;
    }
    strcpy(camera.label, label);
    if (cln_grow(&m->cameras, m->camera_count, sizeof *m->cameras, "cameras") != CLN_OK) {
        refuse(r, CLN_MEMORY, "no memory");
        return;
    }
    m->cameras[m->camera_count++] = camera;
}

static void begin_transform(reader *r, int component)
{
    cln_metashape *m = r->out;

    if (cln_grow(&m->transforms, m->transform_count, sizeof *m->transforms, "transforms") !=
        CLN_OK) {
        refuse(r, CLN_MEMORY, "no memory");
        return;
    }
    m->transforms[m->transform_count++] = (cln_metashape_transform){.component = component};
}

static void XMLCALL begin(void *data, const XML_Char *name, const XML_Char **attributes)
{
    reader *r = data;
    const int at = r->depth++;

    if (at < DEPTH)
        snprintf(r->stack[at], NAME, "%s", name);
    r->used = 0;
    r->full = false;
    if (strcmp(name, "chunk") == 0)
        r->any = false;
    if (r->done)
        return;
    if (strcmp(name, "sensor") == 0 && is_within(r, "sensors", "chunk"))
        begin_sensor(r, attributes);
    else if (strcmp(name, "resolution") == 0 && is_within(r, "sensor", "sensors") &&
             r->out->sensor_count > 0) {
        cln_metashape_sensor *s = &r->out->sensors[r->out->sensor_count - 1];

        s->width = whole_of(r, attributes, "width", 0);
        s->height = whole_of(r, attributes, "height", 0);
    } else if (strcmp(name, "calibration") == 0 && is_within(r, "sensor", "sensors") &&
               r->out->sensor_count > 0)
        begin_calibration(r, attributes);
    else if (strcmp(name, "camera") == 0 &&
             (is_within(r, "cameras", "chunk") || is_within(r, "group", "cameras")))
        begin_camera(r, attributes);
    else if (strcmp(name, "component") == 0 && is_within(r, "components", "chunk"))
        begin_transform(r, whole_of(r, attributes, "id", 0));
    else if (strcmp(name, "transform") == 0 && strcmp(above(r, 1), "chunk") == 0)
        begin_transform(r, -1);
}

/* ---- texts ---- */

static void XMLCALL add_text(void *data, const XML_Char *text, int length)
{
    reader *r = data;
    const size_t room = TEXT - 1 - r->used, bytes = (size_t)length < room ? (size_t)length : room;

    memcpy(r->text + r->used, text, bytes);
    r->used += bytes;
    r->full = r->full || bytes < (size_t)length;
}

/* The text's numbers, with blanks between them. */
static bool numbers(reader *r, int count, double *out)
{
    const char *at = r->text;

    r->text[r->used] = 0;
    for (int i = 0; i < count; i++) {
        at += strspn(at, " \t\r\n");
        if (r->full || !cln_number_read(at, &out[i], &at) || !isfinite(out[i]) ||
            (*at && !strchr(" \t\r\n", *at))) {
            refuse(r, CLN_INPUT, "not the finite numbers that belong there");
            return false;
        }
    }
    if (at[strspn(at, " \t\r\n")]) {
        refuse(r, CLN_INPUT, "more numbers than belong there");
        return false;
    }
    return true;
}

static void end_calibration(reader *r, const char *name)
{
    cln_metashape_sensor *s = &r->out->sensors[r->out->sensor_count - 1];
    const struct {
        const char *name;
        double *to;
    } rows[] = {{"f", &s->f},     {"cx", &s->cx},   {"cy", &s->cy},   {"b1", &s->b1},
                {"b2", &s->b2},   {"k1", &s->k[0]}, {"k2", &s->k[1]}, {"k3", &s->k[2]},
                {"k4", &s->k[3]}, {"p1", &s->p[0]}, {"p2", &s->p[1]}, {"p3", &s->p[2]},
                {"p4", &s->p[3]}};

    for (size_t i = 0; i < sizeof rows / sizeof *rows && r->adjusted == s->adjusted; i++)
        if (strcmp(name, rows[i].name) == 0)
            (void)numbers(r, 1, rows[i].to);
}

static void end_transform(reader *r, const char *name)
{
    cln_metashape_transform *t = &r->out->transforms[r->out->transform_count - 1];

    if (strcmp(name, "rotation") == 0)
        t->has_rotation = numbers(r, 9, t->rotation);
    else if (strcmp(name, "translation") == 0)
        t->has_translation = numbers(r, 3, t->translation);
    else if (strcmp(name, "scale") == 0)
        t->has_scale = numbers(r, 1, &t->scale);
}

static void end_region(reader *r, int component, const char *name)
{
    cln_metashape *m = r->out;

    if (strcmp(name, "center") == 0)
        (void)numbers(r, 3, m->region_centre);
    else if (strcmp(name, "size") == 0)
        (void)numbers(r, 3, m->region_size);
    else if (strcmp(name, "R") == 0)
        m->has_region = numbers(r, 9, m->region_turn);
    m->region_component = component;
}

/* A chunk without aligned cameras is as if it were not there. */
static void end_chunk(reader *r)
{
    cln_metashape *m = r->out;
    const int chunks = m->chunks + r->any;

    if (!r->done && !r->any) {
        cln_metashape_free(m);
        *m = (cln_metashape){0};
    }
    m->chunks = chunks;
    r->done = r->done || r->any;
}

static void XMLCALL end(void *data, const XML_Char *name)
{
    reader *r = data;
    cln_metashape *m = r->out;

    if (strcmp(name, "transform") == 0 &&
        (is_within(r, "camera", "cameras") || is_within(r, "camera", "group"))) {
        r->any = true;
        if (!r->done && m->camera_count > 0)
            m->cameras[m->camera_count - 1].aligned =
                numbers(r, 16, m->cameras[m->camera_count - 1].pose);
    } else if (strcmp(name, "chunk") == 0) {
        end_chunk(r);
    } else if (r->done) {
        ;
    } else if (is_within(r, "calibration", "sensor") && m->sensor_count > 0) {
        end_calibration(r, name);
    } else if ((is_within(r, "transform", "component") || is_within(r, "transform", "chunk")) &&
               m->transform_count > 0) {
        end_transform(r, name);
    } else if (is_within(r, "region", "chunk")) {
        end_region(r, -1, name);
    } else if (is_within(r, "region", "component") && !m->has_region && m->transform_count > 0) {
        end_region(r, m->transforms[m->transform_count - 1].component, name);
    } else if (strcmp(name, "reference") == 0 && strcmp(above(r, 1), "chunk") == 0) {
        snprintf(m->reference, sizeof m->reference, "%.*s", (int)r->used, r->text);
    }
    r->depth--;
    r->used = 0;
}

cln_status cln_metashape_read(const char *path, cln_metashape *out)
{
    cln_status st = CLN_OK;
    reader r = {.out = out};
    char *data = NULL;
    size_t bytes = 0;

    *out = (cln_metashape){0};
    CLN_TRY(cln_read_file(path, MOST_BYTES, &data, &bytes));
    r.parser = XML_ParserCreate(NULL);
    if (!r.parser)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: no memory", path));
    XML_SetUserData(r.parser, &r);
    XML_SetElementHandler(r.parser, begin, end);
    XML_SetCharacterDataHandler(r.parser, add_text);
    if (XML_Parse(r.parser, data, (int)bytes, XML_TRUE) != XML_STATUS_OK || r.status != CLN_OK)
        CLN_TRY(
            cln_fail(r.status != CLN_OK ? r.status : CLN_INPUT,
                     "%s: line %lu column %lu: %s; export the cameras again", path,
                     XML_GetCurrentLineNumber(r.parser), XML_GetCurrentColumnNumber(r.parser) + 1,
                     r.status != CLN_OK ? r.reason : XML_ErrorString(XML_GetErrorCode(r.parser))));
done:
    if (r.parser)
        XML_ParserFree(r.parser);
    free(data);
    return st;
}

#else

#include <stdlib.h>

cln_status cln_metashape_read(const char *path, cln_metashape *out)
{
    *out = (cln_metashape){0};
    return cln_fail(CLN_INPUT,
                    "%s: this program was built without expat, which reads XML: build it with "
                    "libexpat1-dev, or export from Metashape as type Colmap (2.2 or later)",
                    path);
}

#endif

void cln_metashape_free(cln_metashape *m)
{
    free(m->sensors);
    free(m->cameras);
    free(m->transforms);
    *m = (cln_metashape){0};
}
